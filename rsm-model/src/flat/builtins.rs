//! The functions of the language.

use crate::expression::{Binary, Derivative, Id, Node, Symbol, Unary};
use crate::syntax::tree::{Expression, Kind, Span};

use super::translate::{MOST_ELEMENTS, Translator};
use super::value::Value;
use super::{Basic, Role, Sample, derived};

/// Functions of one number, element by element.
const OF_ONE: &[(&str, Unary)] = &[
    ("abs", Unary::Absolute),
    ("sign", Unary::Sign),
    ("sqrt", Unary::Root),
    ("sin", Unary::Sine),
    ("cos", Unary::Cosine),
    ("tan", Unary::Tangent),
    ("asin", Unary::Arcsine),
    ("acos", Unary::Arccosine),
    ("atan", Unary::Arctangent),
    ("sinh", Unary::SineHyperbolic),
    ("cosh", Unary::CosineHyperbolic),
    ("tanh", Unary::TangentHyperbolic),
    ("exp", Unary::Exponential),
    ("log", Unary::Logarithm),
    ("log10", Unary::Logarithm10),
    ("floor", Unary::Floor),
    ("integer", Unary::Floor),
];

/// Functions that are not supported, and what to use instead.
const NOT_READ: &[(&str, &str)] = &[
    (
        "delay",
        "give the delay in the plant file as an effect: `input-delay`, `sensor-delay`; inside the equations write a first-order lag",
    ),
    ("spatialDistribution", "write the transport as a series of volumes"),
    ("initial", "write an `initial equation`"),
    ("terminal", "the end of the record ends a simulation: leave it out"),
    ("terminate", "the end of the record ends a simulation: leave it out"),
    ("Clock", "write `when sample(start, period) then ... end when;`"),
    ("sampleClocked", "write `when sample(start, period) then ... end when;`"),
    ("hold", "a variable that a `when` gives a value holds it: use it as it is"),
    ("previous", "write `pre(x)` in a `when`"),
    ("subSample", "write a `when sample(start, period)` of its own"),
    ("superSample", "write a `when sample(start, period)` of its own"),
    ("shiftSample", "write a `when sample(start, period)` with another start"),
    ("realParameterEqual", "leave the check out"),
    ("cardinality", "flatten the component model first"),
    ("connect", "flatten the component model first"),
    ("semiLinear", "write `if x >= 0 then a*x else b*x`"),
    ("pure", "leave `pure` out: every supported function is pure"),
];

impl Translator<'_> {
    /// A call of a function of the language or of the text.
    pub(super) fn call(
        &mut self,
        name: &str,
        arguments: &[Expression],
        named: &[(String, Expression)],
        span: &Span,
    ) -> Option<Value> {
        if let Some(function) = self.functions.get(name).copied() {
            return self.call_function(function, arguments, named, span);
        }
        if let Some((_, help)) = NOT_READ.iter().find(|(known, _)| *known == name) {
            return self.fault(span, format!("`{name}(...)` is not supported"), help);
        }
        if let Some((argument, _)) = named.first() {
            return self.fault(
                span,
                format!("`{name}` has no argument of the name `{argument}`"),
                "give its arguments by their place",
            );
        }
        let one_of =
            |list: &[(&'static str, Unary)]| list.iter().find(|(known, _)| *known == name).map(|(_, operation)| *operation);
        if let Some(operation) = one_of(OF_ONE) {
            let [argument] = self.arguments(name, arguments, span)?;
            let value = self.numeric(argument)?;
            let basic = match name {
                "abs" => value.basic,
                "sign" | "integer" => Basic::Integer,
                _ => Basic::Real,
            };
            let items = value.items.into_iter().map(|item| self.pool.unary(operation, item)).collect();
            return Some(Value { sizes: value.sizes, items, basic });
        }
        match name {
            "min" | "max" if arguments.len() == 1 => {
                let operation = if name == "min" { Binary::Minimum } else { Binary::Maximum };
                self.folded(&arguments[0], operation, None)
            }
            "sum" => {
                let [argument] = self.arguments(name, arguments, span)?;
                self.folded(argument, Binary::Add, Some(0.0))
            }
            "product" => {
                let [argument] = self.arguments(name, arguments, span)?;
                self.folded(argument, Binary::Multiply, Some(1.0))
            }
            "min" | "max" | "atan2" | "mod" | "rem" | "div" => {
                let [a, b] = self.arguments(name, arguments, span)?;
                let (a, b) = (self.numeric(a), self.numeric(b));
                self.of_two(name, &a?, &b?, span)
            }
            "ceil" => {
                let [argument] = self.arguments(name, arguments, span)?;
                let id = self.number(argument)?;
                let negative = self.pool.negate(id);
                let floor = self.pool.unary(Unary::Floor, negative);
                Some(Value::scalar(self.pool.negate(floor), Basic::Real))
            }
            "der" | "pre" | "edge" | "change" | "sample" | "noEvent" | "smooth" | "homotopy" => {
                self.of_events(name, arguments, span)
            }
            "zeros" | "ones" | "fill" | "size" | "transpose" | "scalar" | "vector" | "identity" | "cross" | "ndims" => {
                self.of_arrays(name, arguments, span)
            }
            "assert" | "reinit" => self.fault(span, format!("`{name}` gives no value"), "write it as a separate equation"),
            _ => {
                let help = "a text from rumoca leaves functions out: write the function before the model. Without an algorithm it is a response \
                            surface, named under [functions] of the plant file";
                self.fault(span, format!("the function `{name}` is not declared"), help)
            }
        }
    }

    /// Checks that a call has the number of arguments that the function takes.
    fn arguments<'a, const N: usize>(
        &mut self,
        name: &str,
        arguments: &'a [Expression],
        span: &Span,
    ) -> Option<[&'a Expression; N]> {
        let found = arguments.len();
        let list: Vec<&Expression> = arguments.iter().collect();
        match list.try_into() {
            Ok(list) => Some(list),
            Err(_) => self.fault(span, format!("`{name}` has {found} arguments here, expected {N}"), ""),
        }
    }

    /// A number or an array of numbers.
    fn numeric(&mut self, expression: &Expression) -> Option<Value> {
        let value = self.value(expression)?;
        if value.basic == Basic::Boolean {
            return self.fault(&expression.span, "found a Boolean, expected a number", "write `if condition then 1 else 0`");
        }
        Some(value)
    }

    fn folded(&mut self, argument: &Expression, operation: Binary, empty: Option<f64>) -> Option<Value> {
        let value = self.numeric(argument)?;
        let folded = value.items.iter().copied().reduce(|a, b| self.pool.binary(operation, a, b));
        match folded.or_else(|| empty.map(|empty| self.pool.number(empty))) {
            Some(id) => Some(Value::scalar(id, value.basic)),
            None => self.fault(&argument.span, "an empty array has no smallest or largest element", ""),
        }
    }

    fn of_two(&mut self, name: &str, a: &Value, b: &Value, span: &Span) -> Option<Value> {
        match name {
            "min" => self.element_wise(a, b, Binary::Minimum, span),
            "max" => self.element_wise(a, b, Binary::Maximum, span),
            "atan2" => {
                let mut value = self.element_wise(a, b, Binary::Arctangent2, span)?;
                value.basic = Basic::Real;
                Some(value)
            }
            _ => {
                let (Some(x), Some(y)) = (a.item(), b.item()) else {
                    return self.fault(span, format!("`{name}` of arrays is not supported"), "write it for each element");
                };
                let quotient = self.pool.divide(x, y);
                let whole = if name == "mod" {
                    self.pool.unary(Unary::Floor, quotient)
                } else {
                    // Rounded towards zero: sign(q) floor(abs(q)).
                    let (sign, size) = (self.pool.unary(Unary::Sign, quotient), self.pool.unary(Unary::Absolute, quotient));
                    let floor = self.pool.unary(Unary::Floor, size);
                    self.pool.multiply(sign, floor)
                };
                let basic = self.common(a.basic, b.basic, span)?;
                if name == "div" {
                    return Some(Value::scalar(whole, basic));
                }
                let multiple = self.pool.multiply(whole, y);
                Some(Value::scalar(self.pool.subtract(x, multiple), basic))
            }
        }
    }

    /// The symbol, if an expression is a declared variable.
    fn variable_of(&mut self, name: &str, item: Id, span: &Span) -> Option<Symbol> {
        match self.pool.node(item) {
            Node::Symbol(symbol) => Some(symbol),
            _ => self.fault(
                span,
                format!("`{name}`: found an expression, expected a variable"),
                "declare a variable, with an equation that gives it this expression",
            ),
        }
    }

    fn of_events(&mut self, name: &str, arguments: &[Expression], span: &Span) -> Option<Value> {
        match name {
            "noEvent" => {
                let [argument] = self.arguments(name, arguments, span)?;
                self.without_switches(argument)
            }
            "smooth" => {
                let [order, argument] = self.arguments(name, arguments, span)?;
                // The order is the smoothness of the expression: 0 means that its slope may have a corner, which must be located.
                if self.whole(order)? >= 1 { self.without_switches(argument) } else { self.value(argument) }
            }
            // The simplified form is for solvers that use continuation to find the start. Here the start is found from the attributes.
            "homotopy" => {
                let [actual, _] = self.arguments(name, arguments, span)?;
                self.value(actual)
            }
            "der" => {
                let [argument] = self.arguments(name, arguments, span)?;
                let value = self.numeric(argument)?;
                let items: Option<Vec<Id>> = value.items.iter().map(|item| self.by_time(*item, span)).collect();
                Some(Value { sizes: value.sizes, items: items?, basic: Basic::Real })
            }
            "pre" => {
                let [argument] = self.arguments(name, arguments, span)?;
                let value = self.value(argument)?;
                let items: Option<Vec<Id>> = value.items.iter().map(|item| self.before(*item, span)).collect();
                Some(Value { items: items?, ..value })
            }
            "edge" | "change" => {
                let [argument] = self.arguments(name, arguments, span)?;
                let (item, basic) = self.scalar(argument)?;
                let before = self.before(item, span)?;
                let id = if name == "edge" {
                    if basic != Basic::Boolean {
                        return self.fault(span, "`edge`: expected a Boolean", "");
                    }
                    let not = self.pool.unary(Unary::Not, before);
                    self.pool.binary(Binary::And, item, not)
                } else {
                    let (under, above) =
                        (self.pool.binary(Binary::LessNow, item, before), self.pool.binary(Binary::LessNow, before, item));
                    self.pool.binary(Binary::Or, under, above)
                };
                Some(Value::scalar(id, Basic::Boolean))
            }
            _ => {
                let [start, period] = self.arguments(name, arguments, span)?;
                let (start, period) = (self.number(start), self.number(period));
                let (start, period) = (start?, period?);
                let number = self.samples.len() as u32;
                self.samples.push(Sample { start, period, place: span.clone() });
                let symbol = derived(&mut self.variables, &mut self.names, Role::Sample(number));
                Some(Value::scalar(self.pool.symbol(symbol), Basic::Boolean))
            }
        }
    }

    fn without_switches(&mut self, argument: &Expression) -> Option<Value> {
        let outside = std::mem::replace(&mut self.without_events, true);
        let value = self.value(argument);
        self.without_events = outside;
        value
    }

    /// The time derivative of an expression.
    fn by_time(&mut self, item: Id, span: &Span) -> Option<Id> {
        let mut seeds = std::collections::HashMap::new();
        for symbol in self.pool.symbols(item) {
            let variable = &self.variables[symbol.0 as usize];
            let seed = match variable.role {
                Role::Unknown | Role::Derivative(_) if variable.basic == Basic::Real => {
                    let derivative = derived(&mut self.variables, &mut self.names, Role::Derivative(symbol));
                    self.pool.symbol(derivative)
                }
                Role::Time => self.pool.number(1.0),
                Role::Input => {
                    let what = format!(
                        "the derivative of the input `{}`: an input is held from row to row and has none",
                        variable.name
                    );
                    return self.fault(span, what, "filter it: der(y) = (u - y)/T gives der(y)");
                }
                Role::Unknown => {
                    let what = format!("the derivative of `{}`, which is {}", variable.name, variable.basic.word());
                    return self.fault(span, what, "");
                }
                _ => continue,
            };
            seeds.insert(symbol, seed);
        }
        Some(Derivative::new(seeds).of(&mut self.pool, item))
    }

    /// The value before an event.
    fn before(&mut self, item: Id, span: &Span) -> Option<Id> {
        let symbol = self.variable_of("pre", item, span)?;
        let variable = &self.variables[symbol.0 as usize];
        if !matches!(variable.role, Role::Unknown) {
            let what = format!("`pre({})`: only a variable that events change has a value before them", variable.name);
            return self.fault(span, what, "leave `pre` out");
        }
        let before = derived(&mut self.variables, &mut self.names, Role::Before(symbol));
        Some(self.pool.symbol(before))
    }

    fn of_arrays(&mut self, name: &str, arguments: &[Expression], span: &Span) -> Option<Value> {
        match name {
            "zeros" | "ones" => {
                let number = if name == "zeros" { 0.0 } else { 1.0 };
                let item = self.pool.number(number);
                self.filled(item, Basic::Integer, arguments, span)
            }
            "fill" => {
                let Some((first, sizes)) = arguments.split_first() else {
                    return self.fault(span, "`fill` has no arguments here, expected a value and sizes", "");
                };
                let (item, basic) = self.scalar(first)?;
                self.filled(item, basic, sizes, span)
            }
            "identity" => {
                let [size] = self.arguments(name, arguments, span)?;
                let n = self.size(size)?;
                self.spend(n.saturating_mul(n), span)?;
                let items = (0..n * n).map(|k| self.pool.number(if k % (n + 1) == 0 { 1.0 } else { 0.0 })).collect();
                Some(Value { sizes: vec![n, n], items, basic: Basic::Integer })
            }
            "size" | "ndims" => {
                let Some((first, rest)) = arguments.split_first() else {
                    return self.fault(span, format!("`{name}` has no arguments here"), "");
                };
                let value = self.value(first)?;
                let found = match (name, rest) {
                    ("ndims", []) => value.sizes.len(),
                    ("size", []) => {
                        let items: Vec<Id> = value.sizes.iter().map(|size| self.pool.number(*size as f64)).collect();
                        return Some(Value { sizes: vec![items.len()], items, basic: Basic::Integer });
                    }
                    ("size", [dimension]) => {
                        let dimension = self.whole(dimension)?;
                        match usize::try_from(dimension - 1).ok().and_then(|at| value.sizes.get(at)) {
                            Some(size) => *size,
                            None => return self.fault(span, format!("{} has no dimension {dimension}", value.shape()), ""),
                        }
                    }
                    _ => return self.fault(span, format!("`{name}` has too many arguments here"), ""),
                };
                Some(Value::scalar(self.pool.number(found as f64), Basic::Integer))
            }
            "scalar" | "vector" => {
                let [argument] = self.arguments(name, arguments, span)?;
                let value = self.value(argument)?;
                if name == "scalar" && value.items.len() != 1 {
                    return self.fault(span, format!("`scalar` of {}", value.shape()), "");
                }
                let sizes = if name == "scalar" { Vec::new() } else { vec![value.items.len()] };
                Some(Value { sizes, ..value })
            }
            "transpose" => {
                let [argument] = self.arguments(name, arguments, span)?;
                let value = self.value(argument)?;
                let [rows, columns] = value.sizes[..] else {
                    return self.fault(span, format!("`transpose` of {}, expected a matrix", value.shape()), "");
                };
                let items =
                    (0..columns).flat_map(|c| (0..rows).map(move |r| r * columns + c)).map(|at| value.items[at]).collect();
                Some(Value { sizes: vec![columns, rows], items, basic: value.basic })
            }
            _ => {
                let [a, b] = self.arguments(name, arguments, span)?;
                let (a, b) = (self.numeric(a), self.numeric(b));
                let (a, b) = (a?, b?);
                if a.sizes != [3] || b.sizes != [3] {
                    return self.fault(span, format!("`cross` of {} and {}, expected vectors of 3", a.shape(), b.shape()), "");
                }
                let mut items = Vec::new();
                for k in 0..3 {
                    let (next, last) = ((k + 1) % 3, (k + 2) % 3);
                    let (left, right) =
                        (self.pool.multiply(a.items[next], b.items[last]), self.pool.multiply(a.items[last], b.items[next]));
                    items.push(self.pool.subtract(left, right));
                }
                Some(Value { sizes: vec![3], items, basic: Basic::Real })
            }
        }
    }

    /// A size: an integer of at least 0.
    pub(super) fn size(&mut self, expression: &Expression) -> Option<usize> {
        let found = self.whole(expression)?;
        match usize::try_from(found) {
            Ok(size) if size <= MOST_ELEMENTS => Some(size),
            _ => self.fault(&expression.span, format!("the size is {found}, expected 0 to {MOST_ELEMENTS}"), ""),
        }
    }

    fn filled(&mut self, item: Id, basic: Basic, sizes: &[Expression], span: &Span) -> Option<Value> {
        let sizes: Option<Vec<usize>> = sizes.iter().map(|size| self.size(size)).collect();
        let sizes = sizes?;
        let count =
            sizes.iter().try_fold(1_usize, |count, size| count.checked_mul(*size).filter(|count| *count <= MOST_ELEMENTS));
        match count {
            Some(count) => {
                self.spend(count, span)?;
                Some(Value { sizes, items: vec![item; count], basic })
            }
            None => self.fault(span, format!("an array of sizes {sizes:?} has more than {MOST_ELEMENTS} elements"), ""),
        }
    }
}

/// The text of an argument, if it is a text.
pub(super) fn text_of(expression: &Expression) -> Option<String> {
    match &expression.kind {
        Kind::Text(text) => Some(text.clone()),
        _ => None,
    }
}
