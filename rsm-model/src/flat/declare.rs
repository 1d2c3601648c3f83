//! Declarations: tree to scalar variables, and the order in which a text is written out.

use rsm_core::source::{Collector, Fault, Source};

use crate::expression::{Id, Symbol};
use crate::syntax::tree::{
    self, Attribute, AttributeValue, Declaration, Direction, Kind, Modification, Subscript, Variability,
};

use super::equations::Written;
use super::translate::{Declared, MOST_ELEMENTS, Translator};
use super::value::{Value, indices, shape};
use super::{Basic, Equation, Flat, Options, Preference, Role, Variable};

/// Attributes without effect on the equations.
const FOR_DISPLAY: [&str; 4] = ["quantity", "displayUnit", "unbounded", "uncertain"];

const ATTRIBUTES: &str = "`unit`, `start`, `fixed`, `min`, `max`, `nominal`, `stateSelect`, `quantity`, `displayUnit`";

/// The flat system of a text.
pub(super) fn flat(text: &tree::Text, source: &Source, options: &Options, faults: &mut Collector) -> Option<Flat> {
    let model = chosen(text, source, options, faults)?;
    let mut translator = Translator::new(source, faults);
    translator.functions = text.functions.iter().map(|function| (function.name.as_str(), function)).collect();
    translator.time();
    let mut all: Vec<(&Declaration, Resolved<'_>)> = Vec::new();
    for declaration in text.constants.iter().chain(&model.declarations) {
        if let Some(resolved) = translator.resolve(declaration, text) {
            all.push((declaration, resolved));
        }
    }
    let bindings = translator.declare_all(&all, options);
    let mut written = Written::default();
    for (declaration, value) in bindings {
        let _: Option<()> = translator.bind(declaration, value, &mut written.equations);
    }
    for (declaration, resolved) in &all {
        let _: Option<()> = translator.attributes(declaration, resolved);
    }
    // Before the equations, because a condition on parameters may choose among them.
    translator.override_parameters(options);
    translator.write_out(&model.equations, false, &mut written);
    let mut initial = Written::default();
    translator.write_out(&model.initial_equations, true, &mut initial);
    translator.require_values();
    written.checks.append(&mut initial.checks);
    Some(Flat {
        name: model.name.clone(),
        description: model.description.clone(),
        source: source.clone(),
        pool: translator.pool,
        variables: translator.variables,
        equations: written.equations,
        initial_equations: initial.equations,
        clauses: written.clauses,
        samples: translator.samples,
        checks: written.checks,
        surfaces: translator.surfaces,
        names: translator.names,
        declared: translator.declared,
        fragments: Vec::new(),
    })
}

/// The requested model, or the last one.
fn chosen<'t>(text: &'t tree::Text, source: &Source, options: &Options, faults: &mut Collector) -> Option<&'t tree::Model> {
    let found = match &options.model {
        Some(name) => text.models.iter().find(|model| model.name == *name),
        None => text.models.last(),
    };
    if found.is_none() {
        let names: Vec<String> = text.models.iter().map(|model| format!("`{}`", model.name)).collect();
        let what = match (&options.model, names.is_empty()) {
            (_, true) => "found no model in the text, expected `model NAME ... end NAME;`".to_string(),
            (Some(name), false) => format!("found no model `{name}` in the text; there is {}", names.join(", ")),
            (None, false) => unreachable!("the last one is found"),
        };
        faults.push(Fault::whole_file(source.name(), what));
    }
    found
}

/// A declaration with the attributes of its type.
pub(super) struct Resolved<'t> {
    basic: Basic,
    sizes: Vec<&'t Subscript>,
    attributes: Vec<&'t Attribute>,
    value: Option<&'t tree::Expression>,
}

impl Translator<'_> {
    fn time(&mut self) {
        let mut time = Variable::new("time".to_string(), Role::Time, Basic::Real, 0..0);
        time.unit = Some("s".to_string());
        self.variables.push(time);
        self.names.insert("time".to_string(), Symbol(0));
        self.declared.insert("time".to_string(), Declared { sizes: Vec::new(), symbols: vec![Symbol(0)] });
    }

    /// Follows the type of a declaration to Real, Integer or Boolean.
    fn resolve<'t>(&mut self, declaration: &'t Declaration, text: &'t tree::Text) -> Option<Resolved<'t>> {
        let mut sizes: Vec<&Subscript> = declaration.sizes.iter().collect();
        let mut parts: Vec<&Modification> = vec![&declaration.modification];
        let mut name = declaration.type_name.as_str();
        // A chain of types has at most as many members as there are types.
        for _ in 0..=text.types.len() {
            let basic = match name {
                "Real" => Some(Basic::Real),
                "Integer" => Some(Basic::Integer),
                "Boolean" => Some(Basic::Boolean),
                _ => None,
            };
            if let Some(basic) = basic {
                // Attributes of the declaration come last and take precedence.
                let attributes = parts.iter().rev().flat_map(|part| &part.attributes).collect();
                let value = declaration.modification.value.as_ref();
                return Some(Resolved { basic, sizes, attributes, value });
            }
            let Some(definition) = text.types.iter().find(|definition| definition.name == name) else { break };
            sizes.extend(&definition.sizes);
            parts.push(&definition.modification);
            name = &definition.base;
        }
        let help = if declaration.type_name == "String" {
            "leave the text out: a plant computes numbers"
        } else {
            "the types are Real, Integer and Boolean, and those that the text declares with `type`; a component model is flattened first"
        };
        self.fault(&declaration.type_span, format!("the type `{}` is not declared", declaration.type_name), help)
    }

    /// Declares every name. Sizes may depend on integers declared anywhere. Returns the values that must still be assigned.
    fn declare_all<'a, 't>(
        &mut self,
        all: &'a [(&'t Declaration, Resolved<'t>)],
        options: &Options,
    ) -> Vec<(&'t Declaration, &'a Resolved<'t>)> {
        let mut later = Vec::new();
        for (declaration, resolved) in all {
            if resolved.sizes.is_empty() {
                self.declare(declaration, resolved, Vec::new());
            }
        }
        for (declaration, resolved) in all {
            let is_early = resolved.sizes.is_empty()
                && resolved.basic == Basic::Integer
                && matches!(declaration.variability, Variability::Constant | Variability::Parameter);
            let is_bound = is_early && resolved.value.is_some_and(|value| self.is_known_so_far(value));
            if is_bound {
                let _: Option<()> = self.bind(declaration, resolved, &mut Vec::new());
                if let Some((_, value)) = options.parameters.iter().find(|(name, _)| *name == declaration.name) {
                    let value = self.pool.number(*value);
                    self.set_value(&declaration.name, value);
                }
            } else {
                later.push((*declaration, resolved));
            }
        }
        for (declaration, resolved) in all {
            if !resolved.sizes.is_empty()
                && let Some(sizes) = self.sizes(declaration, resolved)
            {
                self.declare(declaration, resolved, sizes);
            }
        }
        later
    }

    fn set_value(&mut self, name: &str, value: Id) {
        if let Some(symbol) = self.names.get(name).copied() {
            self.variables[symbol.0 as usize].value = Some(value);
        }
    }

    fn sizes(&mut self, declaration: &Declaration, resolved: &Resolved<'_>) -> Option<Vec<usize>> {
        let mut sizes = Vec::new();
        for (k, size) in resolved.sizes.iter().enumerate() {
            sizes.push(match size {
                Subscript::At(expression) => self.size(expression)?,
                Subscript::All => {
                    // The size is that of the value.
                    let found = resolved.value.and_then(|value| self.value(value));
                    match found.and_then(|value| value.sizes.get(k).copied()) {
                        Some(size) => size,
                        None => {
                            let what = format!("the size of `{}` is unknown", declaration.name);
                            return self.fault(&declaration.span, what, "write it as a number: Real x[3]");
                        }
                    }
                }
            });
        }
        let count =
            sizes.iter().try_fold(1_usize, |count, size| count.checked_mul(*size).filter(|count| *count <= MOST_ELEMENTS));
        if count.is_none() {
            let what = format!("`{}` has more than {MOST_ELEMENTS} elements", declaration.name);
            return self.fault(&declaration.span, what, "");
        }
        Some(sizes)
    }

    fn declare(&mut self, declaration: &Declaration, resolved: &Resolved<'_>, sizes: Vec<usize>) {
        let name = &declaration.name;
        if let Some(before) = self.declared.get(name) {
            let at = before.symbols.first().map_or(0, |symbol| self.variables[symbol.0 as usize].place.start);
            let (line, _) = self.source.position(at);
            let _: Option<()> = self.fault(
                &declaration.span,
                format!("`{name}` is declared twice"),
                &format!("the first declaration is in line {line}: rename one of the two"),
            );
            return;
        }
        let role = match (declaration.variability, declaration.direction) {
            (Variability::Constant, _) => Role::Constant,
            (Variability::Parameter, _) => Role::Parameter,
            // An input with a value in the text is an unknown of the system: rumoca writes inputs of components like this.
            (_, Direction::Input) if resolved.value.is_none() => Role::Input,
            _ => Role::Unknown,
        };
        let mut symbols = Vec::new();
        if self.spend(sizes.iter().product(), &declaration.span).is_none() {
            return;
        }
        for index in indices(&sizes) {
            let element = if sizes.is_empty() {
                name.clone()
            } else {
                let index: Vec<String> = index.iter().map(usize::to_string).collect();
                format!("{name}[{}]", index.join(","))
            };
            let symbol = Symbol(self.variables.len() as u32);
            let mut variable = Variable::new(element.clone(), role, resolved.basic, declaration.span.clone());
            variable.is_output = declaration.direction == Direction::Output;
            variable.is_discrete |= declaration.variability == Variability::Discrete;
            variable.description.clone_from(&declaration.description);
            self.variables.push(variable);
            self.names.insert(element.clone(), symbol);
            if !sizes.is_empty() {
                self.declared.insert(element, Declared { sizes: Vec::new(), symbols: vec![symbol] });
            }
            symbols.push(symbol);
        }
        self.declared.insert(name.clone(), Declared { sizes, symbols });
    }

    /// Gives a declared name the value after `=`: constants and parameters store it, others get an equation.
    fn bind(&mut self, declaration: &Declaration, resolved: &Resolved<'_>, equations: &mut Vec<Equation>) -> Option<()> {
        let expression = resolved.value?;
        let value = self.value(expression)?;
        let declared = self.declared.get(&declaration.name)?.clone();
        if !resolved.basic.takes(value.basic) {
            let what =
                format!("`{}` is {}, found a value of type {}", declaration.name, resolved.basic.word(), value.basic.word());
            return self.fault(&expression.span, what, "");
        }
        let value = self.spread(value, &declared, &declaration.name, expression)?;
        let is_number = matches!(declaration.variability, Variability::Constant | Variability::Parameter);
        for (symbol, item) in declared.symbols.iter().zip(value.items) {
            if is_number {
                self.variables[symbol.0 as usize].value = Some(item);
            } else {
                let left = self.pool.symbol(*symbol);
                let place = declaration.span.start..expression.span.end;
                equations.push(Equation { left, right: item, place, pairs: Vec::new() });
            }
        }
        Some(())
    }

    /// A value for every element; a scalar is used for all of them.
    fn spread(&mut self, value: Value, declared: &Declared, name: &str, at: &tree::Expression) -> Option<Value> {
        if value.sizes == declared.sizes {
            return Some(value);
        }
        if let Some(item) = value.item() {
            return Some(Value {
                sizes: declared.sizes.clone(),
                items: vec![item; declared.symbols.len()],
                basic: value.basic,
            });
        }
        self.fault(&at.span, format!("found {}, and `{name}` is {}", value.shape(), shape(&declared.sizes)), "")
    }

    fn attributes(&mut self, declaration: &Declaration, resolved: &Resolved<'_>) -> Option<()> {
        let declared = self.declared.get(&declaration.name)?.clone();
        for attribute in &resolved.attributes {
            let _: Option<()> = self.attribute(declaration, attribute, &declared, resolved.basic);
        }
        Some(())
    }

    fn attribute(&mut self, declaration: &Declaration, attribute: &Attribute, declared: &Declared, basic: Basic) -> Option<()> {
        let name = attribute.name.as_str();
        let expression = match &attribute.value {
            AttributeValue::Nested => {
                let what =
                    format!("found `{name}(...)` in the attributes of `{}`, expected `{name} = value`", declaration.name);
                return self.fault(&attribute.span, what, "a flat variable is a scalar or an array, and has no parts");
            }
            AttributeValue::Text(text) => {
                match name {
                    "unit" => {
                        for symbol in &declared.symbols {
                            self.variables[symbol.0 as usize].unit = (!text.is_empty()).then(|| text.clone());
                        }
                    }
                    _ if FOR_DISPLAY.contains(&name) => {}
                    _ => return self.fault(&attribute.span, format!("`{name}` is a text here, expected a value"), ""),
                }
                return Some(());
            }
            AttributeValue::Expression(expression) => expression,
        };
        match name {
            "start" => {
                let value = self.value(expression)?;
                if !basic.takes(value.basic) {
                    let what = format!("`start` of a variable of type {} is of type {}", basic.word(), value.basic.word());
                    return self.fault(&expression.span, what, "");
                }
                let value = self.spread(value, declared, &declaration.name, expression)?;
                for (symbol, item) in declared.symbols.iter().zip(value.items) {
                    self.variables[symbol.0 as usize].start = Some(item);
                }
            }
            "fixed" | "min" | "max" | "nominal" => {
                let value = self.value(expression)?;
                let value = self.spread(value, declared, &declaration.name, expression)?;
                for (symbol, item) in declared.symbols.iter().zip(value.items) {
                    // A bound that depends on parameters is evaluated with their values in the text; it does not restrict the equations.
                    let Some((number, _)) = super::known::known(&self.pool, &self.variables, item) else {
                        return self.fault(
                            &expression.span,
                            format!(
                                "`{name}`: expected a number, or an expression of constants and parameters that have values"
                            ),
                            "",
                        );
                    };
                    let variable = &mut self.variables[symbol.0 as usize];
                    match name {
                        "fixed" => variable.fixed = Some(number != 0.0),
                        "min" => variable.min = Some(number),
                        "max" => variable.max = Some(number),
                        _ => variable.nominal = Some(number),
                    }
                }
            }
            "stateSelect" => {
                let choice = match &expression.kind {
                    Kind::Name(parts) if parts.len() == 2 && parts[0].name == "StateSelect" => match parts[1].name.as_str() {
                        "never" => Some(Preference::Never),
                        "avoid" => Some(Preference::Avoid),
                        "default" => Some(Preference::Default),
                        "prefer" => Some(Preference::Prefer),
                        "always" => Some(Preference::Always),
                        _ => None,
                    },
                    _ => None,
                };
                let Some(choice) = choice else {
                    let what = "expected StateSelect.never, avoid, default, prefer or always";
                    return self.fault(&expression.span, what, "");
                };
                for symbol in &declared.symbols {
                    self.variables[symbol.0 as usize].preference = choice;
                }
            }
            _ if FOR_DISPLAY.contains(&name) => {}
            _ => {
                return self.fault(
                    &attribute.span,
                    format!("`{name}` is not an attribute"),
                    &format!("attributes are {ATTRIBUTES}"),
                );
            }
        }
        Some(())
    }

    /// Replaces values of parameters in the text by given ones.
    fn override_parameters(&mut self, options: &Options) {
        for (name, value) in &options.parameters {
            let symbol = self.names.get(name).copied();
            match symbol.map(|symbol| self.variables[symbol.0 as usize].role) {
                Some(Role::Parameter) => {
                    let value = self.pool.number(*value);
                    self.set_value(name, value);
                }
                Some(_) => {
                    self.faults
                        .push(Fault::whole_file(self.source.name(), format!("`{name}` is not a parameter of the model")));
                }
                None => self.faults.push(Fault::whole_file(self.source.name(), format!("the model has no parameter `{name}`"))),
            }
        }
    }

    /// Reports constants and parameters without a value.
    fn require_values(&mut self) {
        // A value with a fault is already reported.
        let is_clean = self.faults.is_clean();
        for variable in &self.variables {
            let is_number = matches!(variable.role, Role::Constant | Role::Parameter);
            if is_number && variable.value.is_none() && is_clean {
                let fault =
                    self.source.fault(variable.place.clone(), format!("the parameter `{}` has no value", variable.name));
                self.faults.push(fault.help("write `= value` behind it, or give it under [parameters] of the plant file"));
            }
            if variable.role == Role::Parameter && variable.fixed == Some(false) {
                let what = format!(
                    "the parameter `{}` has fixed = false; a parameter that the start determines is not supported",
                    variable.name
                );
                self.faults.push(self.source.fault(variable.place.clone(), what).help("give it a value, or leave `fixed` out"));
            }
        }
    }

    /// Whether every name in an expression is already declared. Arrays of unknown size are not.
    fn is_known_so_far(&self, expression: &tree::Expression) -> bool {
        match &expression.kind {
            Kind::Number(..) | Kind::Boolean(_) => true,
            Kind::Name(parts) => {
                parts.iter().all(|part| part.subscripts.is_empty())
                    && self.declared.contains_key(&parts.iter().map(|part| part.name.as_str()).collect::<Vec<_>>().join("."))
            }
            Kind::Sum(terms) => terms.iter().all(|(_, term)| self.is_known_so_far(term)),
            Kind::Product(factors) => factors.iter().all(|(_, factor)| self.is_known_so_far(factor)),
            Kind::If(branches, otherwise) => {
                branches.iter().all(|(condition, value)| self.is_known_so_far(condition) && self.is_known_so_far(value))
                    && self.is_known_so_far(otherwise)
            }
            Kind::Relation(_, left, right) => self.is_known_so_far(left) && self.is_known_so_far(right),
            _ => false,
        }
    }
}
