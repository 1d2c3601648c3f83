//! Functions of the text, inlined at their calls.
//!
//! An algorithm of assignments and `if` is executed with expressions in place of numbers: after an `if`, a name has a conditional value. Comparisons
//! inside a function are no switches, as the language defines. A function without an algorithm is a response surface.

use std::collections::HashMap;

use crate::expression::Id;
use crate::syntax::tree::{self, Direction, Expression, Part, Span, Statement, StatementKind, Subscript};

use super::translate::{Scope, Translator};
use super::value::Value;
use super::{Basic, Surface};

/// The largest depth of nested calls.
const DEEPEST: usize = 64;

impl Translator<'_> {
    /// The type of a declaration in a function.
    fn basic_of(&mut self, declaration: &tree::Declaration) -> Option<Basic> {
        match declaration.type_name.as_str() {
            "Real" => Some(Basic::Real),
            "Integer" => Some(Basic::Integer),
            "Boolean" => Some(Basic::Boolean),
            other => {
                let what = format!("the type `{other}` in a function, expected Real, Integer or Boolean");
                self.fault(&declaration.type_span, what, "")
            }
        }
    }

    pub(super) fn call_function(
        &mut self,
        function: &tree::Function,
        arguments: &[Expression],
        named: &[(String, Expression)],
        span: &Span,
    ) -> Option<Value> {
        if self.calls >= DEEPEST {
            return self.fault(span, format!("`{}` calls itself, or {DEEPEST} calls are nested", function.name), "");
        }
        self.spend(1, span)?;
        let of = |direction: Direction| function.declarations.iter().filter(move |item| item.direction == direction);
        let inputs: Vec<&tree::Declaration> = of(Direction::Input).collect();
        let mut outputs = of(Direction::Output);
        let (Some(output), None) = (outputs.next(), outputs.next()) else {
            let what = format!("the function `{}` has {} results, expected one", function.name, of(Direction::Output).count());
            return self.fault(&function.span, what, "write a function for each result");
        };
        // Positional arguments first, then named ones.
        if arguments.len() > inputs.len() {
            let what = format!("`{}` has {} arguments here, expected {}", function.name, arguments.len(), inputs.len());
            return self.fault(span, what, "");
        }
        let mut given: Vec<Option<&Expression>> = arguments.iter().map(Some).collect();
        given.resize(inputs.len(), None);
        for (name, value) in named {
            match inputs.iter().position(|input| input.name == *name) {
                Some(at) if given[at].is_none() => given[at] = Some(value),
                Some(_) => return self.fault(&value.span, format!("the argument `{name}` is given twice"), ""),
                None => return self.fault(&value.span, format!("`{}` has no argument `{name}`", function.name), ""),
            }
        }
        let mut values: HashMap<String, Value> = HashMap::new();
        let mut scalars = Vec::new();
        for (input, argument) in inputs.iter().zip(given) {
            let Some(argument) = argument else {
                let what = format!("the argument `{}` of `{}` is missing", input.name, function.name);
                return self.fault(span, what, "");
            };
            let basic = self.basic_of(input)?;
            let value = self.value(argument)?;
            if !basic.takes(value.basic) {
                let what =
                    format!("found a value of type {}, expected {} for `{}`", value.basic.word(), basic.word(), input.name);
                return self.fault(&argument.span, what, "");
            }
            if input.sizes.len() != value.sizes.len() {
                let what =
                    format!("found {} for the argument `{}` of {} dimensions", value.shape(), input.name, input.sizes.len());
                return self.fault(&argument.span, what, "");
            }
            scalars.extend(value.items.iter().copied());
            values.insert(input.name.clone(), value);
        }
        if function.algorithm.is_none() {
            return self.surface(function, &inputs, output, scalars, span);
        }
        let outside = std::mem::replace(&mut self.without_events, true);
        self.scopes.push(Scope { values, is_open: false });
        self.calls += 1;
        let result = self.body(function, &inputs, output);
        self.calls -= 1;
        self.scopes.pop();
        self.without_events = outside;
        result
    }

    /// A call of a function without an algorithm.
    fn surface(
        &mut self,
        function: &tree::Function,
        inputs: &[&tree::Declaration],
        output: &tree::Declaration,
        arguments: Vec<Id>,
        span: &Span,
    ) -> Option<Value> {
        if inputs.iter().any(|input| !input.sizes.is_empty()) || !output.sizes.is_empty() {
            return self.fault(span, format!("`{}` has no algorithm, and a response surface takes scalars", function.name), "");
        }
        let unit = |declaration: &tree::Declaration| {
            declaration.modification.attributes.iter().find_map(|attribute| match &attribute.value {
                tree::AttributeValue::Text(text) if attribute.name == "unit" => Some(text.clone()),
                _ => None,
            })
        };
        let number = self.surfaces.iter().position(|surface| surface.name == function.name).unwrap_or_else(|| {
            self.surfaces.push(Surface {
                name: function.name.clone(),
                inputs: inputs.iter().map(|input| (input.name.clone(), unit(input))).collect(),
                unit: unit(output),
                place: function.span.clone(),
            });
            self.surfaces.len() - 1
        });
        let orders = vec![0; arguments.len()];
        Some(Value::scalar(self.pool.surface(number as u32, arguments, orders), Basic::Real))
    }

    fn body(&mut self, function: &tree::Function, inputs: &[&tree::Declaration], output: &tree::Declaration) -> Option<Value> {
        let mut types: HashMap<&str, Basic> = HashMap::new();
        for declaration in &function.declarations {
            let basic = self.basic_of(declaration)?;
            types.insert(&declaration.name, basic);
            if inputs.iter().any(|input| input.name == declaration.name) {
                continue;
            }
            let Some(value) = &declaration.modification.value else { continue };
            let value = self.value(value)?;
            self.here(declaration.name.clone(), value);
        }
        self.run(function.algorithm.as_deref().unwrap_or_default(), &types)?;
        match self.scopes.last().and_then(|scope| scope.values.get(&output.name)).cloned() {
            Some(value) => Some(value),
            None => {
                let what = format!("the result `{}` of `{}` does not get a value in every branch", output.name, function.name);
                self.fault(&function.span, what, "")
            }
        }
    }

    /// Gives a name a value in the innermost function.
    fn here(&mut self, name: String, value: Value) {
        let scope = self.scopes.iter_mut().rev().find(|scope| !scope.is_open);
        scope.expect("a statement stands in a function").values.insert(name, value);
    }

    fn run(&mut self, statements: &[Statement], types: &HashMap<&str, Basic>) -> Option<()> {
        for statement in statements {
            match &statement.kind {
                StatementKind::Assign(parts, value) => {
                    let value = self.value(value)?;
                    self.assign(parts, value, types, &statement.span)?;
                }
                StatementKind::If(branches, otherwise) => self.run_if(branches, otherwise, types)?,
                StatementKind::For(index, range, body) => {
                    self.each(index, range, |translator| translator.run(body, types))?;
                }
                StatementKind::Call(call) => {
                    return self.fault(&call.span, "a call that gives no value in a function is not supported", "leave it out");
                }
            }
        }
        Some(())
    }

    fn assign(&mut self, parts: &[Part], value: Value, types: &HashMap<&str, Basic>, span: &Span) -> Option<()> {
        let [Part { name, subscripts }] = parts else {
            return self.fault(span, "a name with points cannot take a value in a function", "");
        };
        let Some(basic) = types.get(name.as_str()).copied() else {
            return self.fault(span, format!("`{name}` is not declared in this function"), "");
        };
        if !basic.takes(value.basic) {
            let what = format!("found a value of type {}, expected {} for `{name}`", value.basic.word(), basic.word());
            return self.fault(span, what, "");
        }
        if subscripts.is_empty() {
            self.here(name.clone(), Value { basic, ..value });
            return Some(());
        }
        let known = self.scopes.iter().rev().find(|scope| !scope.is_open).and_then(|scope| scope.values.get(name)).cloned();
        let Some(mut array) = known else {
            let what = format!("an element of `{name}` takes a value before `{name}` has one");
            return self.fault(span, what, "give the whole array a value first: `x := zeros(3)`");
        };
        let mut at = 0;
        for (k, subscript) in subscripts.iter().enumerate() {
            let Subscript::At(index) = subscript else {
                return self.fault(span, "a range of elements cannot take a value", "write a `for`");
            };
            let found = self.whole(index)?;
            let size = array.sizes.get(k).copied().unwrap_or(0);
            if found < 1 || found as usize > size {
                return self.fault(&index.span, format!("the subscript is {found}, expected 1 to {size}"), "");
            }
            at = at * size + found as usize - 1;
        }
        let (Some(item), true) = (value.item(), subscripts.len() == array.sizes.len()) else {
            return self.fault(span, format!("found {}, expected a scalar for an element", value.shape()), "");
        };
        array.items[at] = item;
        self.here(name.clone(), array);
        Some(())
    }

    /// Every branch starts with the same values. Afterwards a name has the value of the selected branch.
    fn run_if(
        &mut self,
        branches: &[(Expression, Vec<Statement>)],
        otherwise: &[Statement],
        types: &HashMap<&str, Basic>,
    ) -> Option<()> {
        let at = self.scopes.iter().rposition(|scope| !scope.is_open).expect("a statement stands in a function");
        let before = self.scopes[at].values.clone();
        let mut ends = Vec::new();
        for (condition, body) in branches {
            let condition = self.condition(condition)?;
            self.run(body, types)?;
            ends.push((condition, std::mem::replace(&mut self.scopes[at].values, before.clone())));
        }
        self.run(otherwise, types)?;
        let mut result = std::mem::take(&mut self.scopes[at].values);
        for (condition, end) in ends.into_iter().rev() {
            // A name that has no value in one of the branches has none afterwards.
            result.retain(|name, _| end.contains_key(name));
            for (name, value) in &mut result {
                let other = &end[name];
                if other.sizes != value.sizes {
                    let what = format!("`{name}` is {} in one branch and {} in the other", other.shape(), value.shape());
                    return self.fault(&branches[0].0.span, what, "");
                }
                for (item, other) in value.items.iter_mut().zip(&other.items) {
                    *item = self.pool.choose(condition, *other, *item);
                }
            }
        }
        self.scopes[at].values = result;
        Some(())
    }
}
