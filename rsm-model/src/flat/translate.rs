//! Expressions: tree to pool.

use std::collections::HashMap;

use rsm_core::source::{Collector, Source};

use crate::expression::{Binary, Id, Pool, Symbol, Unary, Values};
use crate::syntax::tree::{self, Compare, Expression, Joint, Kind, Part, Span, Subscript};

use super::value::Value;
use super::{Basic, Role, Sample, Surface, Variable};

/// The scalars of a declared name.
#[derive(Debug, Clone)]
pub(super) struct Declared {
    pub(super) sizes: Vec<usize>,
    pub(super) symbols: Vec<Symbol>,
}

/// The values of names inside a function or a loop.
#[derive(Debug, Default)]
pub(super) struct Scope {
    pub(super) values: HashMap<String, Value>,
    /// Whether names of the model may be used: in a loop, not in a function.
    pub(super) is_open: bool,
}

pub(super) struct Translator<'t> {
    pub(super) source: &'t Source,
    pub(super) faults: &'t mut Collector,
    /// How many faults were told.
    pub(super) told: usize,
    pub(super) pool: Pool,
    pub(super) variables: Vec<Variable>,
    /// Scalars by name.
    pub(super) names: HashMap<String, Symbol>,
    /// What was declared, scalars and arrays.
    pub(super) declared: HashMap<String, Declared>,
    pub(super) functions: HashMap<&'t str, &'t tree::Function>,
    pub(super) surfaces: Vec<Surface>,
    pub(super) samples: Vec<Sample>,
    pub(super) scopes: Vec<Scope>,
    /// Inside `noEvent` or a function: comparisons are not switches.
    pub(super) without_events: bool,
    /// Inside a `when`.
    pub(super) at_event: bool,
    /// Sizes that `end` stands for, innermost last.
    pub(super) ends: Vec<usize>,
    /// How many calls of functions stand in one another.
    pub(super) calls: usize,
    /// Elements and rounds that were written out so far.
    pub(super) written: usize,
}

/// No array has more elements: a size that was mistyped must not fill the memory.
pub(super) const MOST_ELEMENTS: usize = 100_000;

/// Elements of arrays and rounds of loops that a text may be written out to, in all.
const MOST_WRITTEN: usize = 2_000_000;

impl Translator<'_> {
    pub(super) fn fault<T>(&mut self, span: &Span, what: impl Into<String>, help: &str) -> Option<T> {
        self.told += 1;
        let fault = self.source.fault(span.clone(), what);
        self.faults.push(if help.is_empty() { fault } else { fault.help(help) });
        None
    }

    /// The translated expression; a fault is told where there is none.
    pub(super) fn value(&mut self, expression: &Expression) -> Option<Value> {
        let span = &expression.span;
        match &expression.kind {
            Kind::Number(value, is_whole) => {
                let id = self.pool.number(*value);
                Some(Value::scalar(id, if *is_whole { Basic::Integer } else { Basic::Real }))
            }
            Kind::Boolean(is_true) => {
                let id = self.pool.number(f64::from(u8::from(*is_true)));
                Some(Value::scalar(id, Basic::Boolean))
            }
            Kind::Text(_) => self.fault(span, "found a text in quotes, expected a number or a condition", ""),
            Kind::Name(parts) => self.name(parts, span),
            Kind::Call(name, arguments, named) => self.call(name, arguments, named, span),
            Kind::Sum(terms) => self.sum(terms),
            Kind::Product(factors) => self.product(factors),
            Kind::Power(base, exponent, each) => self.power(base, exponent, *each),
            Kind::Relation(compare, left, right) => self.relation(*compare, left, right, span),
            Kind::And(items) => self.conditions(items, Binary::And),
            Kind::Or(items) => self.conditions(items, Binary::Or),
            Kind::Not(inner) => {
                let inner = self.condition(inner)?;
                let id = self.pool.unary(Unary::Not, inner);
                Some(Value::scalar(id, Basic::Boolean))
            }
            Kind::If(branches, otherwise) => self.choice(branches, otherwise, span),
            Kind::Array(items) => {
                let values = self.all(items)?;
                self.stacked(values, span)
            }
            Kind::Comprehension(body, index, range) => {
                let values = self.each(index, range, |translator| translator.value(body))?;
                self.stacked(values, span)
            }
            Kind::Matrix(rows) => {
                let mut stacked = Vec::new();
                for row in rows {
                    let values = self.all(row)?;
                    stacked.push(self.stacked(values, span)?);
                }
                self.stacked(stacked, span)
            }
            Kind::Range(first, step, last) => self.range(first, step.as_deref(), last, span),
            Kind::End => match self.ends.last() {
                Some(size) => {
                    let id = self.pool.number(*size as f64);
                    Some(Value::scalar(id, Basic::Integer))
                }
                None => self.fault(span, "found `end` outside of subscripts", ""),
            },
        }
    }

    /// All of some expressions; every fault in them is told.
    pub(super) fn all(&mut self, expressions: &[Expression]) -> Option<Vec<Value>> {
        let values: Vec<Option<Value>> = expressions.iter().map(|expression| self.value(expression)).collect();
        values.into_iter().collect()
    }

    /// A scalar of any type.
    pub(super) fn scalar(&mut self, expression: &Expression) -> Option<(Id, Basic)> {
        let value = self.value(expression)?;
        match value.item() {
            Some(item) => Some((item, value.basic)),
            None => {
                let what = format!("found {}, expected a scalar", value.shape());
                self.fault(&expression.span, what, "")
            }
        }
    }

    /// A scalar number.
    pub(super) fn number(&mut self, expression: &Expression) -> Option<Id> {
        let (item, basic) = self.scalar(expression)?;
        if basic == Basic::Boolean {
            return self.fault(&expression.span, "found a Boolean, expected a number", "write `if condition then 1 else 0`");
        }
        Some(item)
    }

    /// A condition.
    pub(super) fn condition(&mut self, expression: &Expression) -> Option<Id> {
        let (item, basic) = self.scalar(expression)?;
        if basic != Basic::Boolean {
            let what = format!("found a value of type {}, expected a condition (Boolean)", basic.word());
            return self.fault(&expression.span, what, "compare it, as `x > 0`");
        }
        Some(item)
    }

    /// A whole number that is known while the text is read; parameters that it depends on become structural.
    pub(super) fn whole(&mut self, expression: &Expression) -> Option<i64> {
        let id = self.number(expression)?;
        match self.known(id) {
            Some(value) if value.fract() == 0.0 && value.abs() < 1e15 => Some(value as i64),
            Some(value) => self.fault(&expression.span, format!("found {value}, expected a whole number"), ""),
            None => self.fault(
                &expression.span,
                "expected a number that is known while the text is read",
                "use numbers, constants and parameters that have values",
            ),
        }
    }

    /// The value of an expression of constants and parameters. The parameters become structural.
    pub(super) fn known(&mut self, id: Id) -> Option<f64> {
        let (value, used) = known(&self.pool, &self.variables, id)?;
        for symbol in used {
            self.variables[symbol.0 as usize].is_structural = true;
        }
        Some(value)
    }

    /// Counts what is written out, and stops a text that would not end.
    pub(super) fn spend(&mut self, count: usize, span: &Span) -> Option<()> {
        let before = self.written;
        self.written = before.saturating_add(count);
        if self.written <= MOST_WRITTEN {
            return Some(());
        }
        if before <= MOST_WRITTEN {
            let what = format!("written out, arrays and loops have more than {MOST_WRITTEN} elements up to here");
            let _: Option<()> = self.fault(span, what, "use smaller sizes");
        }
        None
    }

    /// `body` for each value of an index.
    pub(super) fn each<T>(
        &mut self,
        index: &str,
        range: &Expression,
        mut body: impl FnMut(&mut Self) -> Option<T>,
    ) -> Option<Vec<T>> {
        let values = self.value(range)?;
        if values.sizes.len() != 1 {
            let what = format!("found {}, expected a range such as 1:3", values.shape());
            return self.fault(&range.span, what, "");
        }
        let mut all = Vec::new();
        for item in values.items {
            self.spend(1, &range.span)?;
            let scope =
                Scope { values: HashMap::from([(index.to_string(), Value::scalar(item, values.basic))]), is_open: true };
            self.scopes.push(scope);
            let found = body(self);
            self.scopes.pop();
            all.push(found?);
        }
        Some(all)
    }

    fn range(&mut self, first: &Expression, step: Option<&Expression>, last: &Expression, span: &Span) -> Option<Value> {
        let from = self.whole(first)?;
        let by = step.map_or(Some(1), |step| self.whole(step))?;
        let to = self.whole(last)?;
        let count = if by == 0 { 0 } else { ((to - from) / by + 1).max(0) };
        if by == 0 || count as usize > MOST_ELEMENTS {
            return self.fault(span, format!("a range of step {by} from {from} to {to} cannot be written out"), "");
        }
        let items: Vec<Id> = (0..count).map(|k| self.pool.number((from + k * by) as f64)).collect();
        Some(Value { sizes: vec![items.len()], items, basic: Basic::Integer })
    }

    /// Values of one shape as an array of one more dimension.
    fn stacked(&mut self, values: Vec<Value>, span: &Span) -> Option<Value> {
        let Some(first) = values.first().cloned() else {
            return Some(Value { sizes: vec![0], items: Vec::new(), basic: Basic::Real });
        };
        if let Some(other) = values.iter().find(|value| value.sizes != first.sizes) {
            let what = format!("an array of {} and {}", first.shape(), other.shape());
            return self.fault(span, what, "all elements of an array have one shape");
        }
        let mut basic = first.basic;
        for value in &values {
            basic = self.common(basic, value.basic, span)?;
        }
        let mut sizes = vec![values.len()];
        sizes.extend(first.sizes);
        Some(Value { sizes, items: values.into_iter().flat_map(|value| value.items).collect(), basic })
    }

    /// The type that two types have in common.
    pub(super) fn common(&mut self, a: Basic, b: Basic, span: &Span) -> Option<Basic> {
        match (a, b) {
            (a, b) if a == b => Some(a),
            (Basic::Boolean, _) | (_, Basic::Boolean) => {
                self.fault(span, "found a Boolean beside a number", "write `if condition then 1 else 0`")
            }
            _ => Some(Basic::Real),
        }
    }

    /// The joined text of a name whose inner parts may have subscripts, and the subscripts of its last part.
    pub(super) fn joined<'p>(&mut self, parts: &'p [Part]) -> Option<(String, &'p [Subscript])> {
        let mut text = String::new();
        let (last, heads) = parts.split_last()?;
        for part in heads {
            text.push_str(&part.name);
            if !part.subscripts.is_empty() {
                let mut indices = Vec::new();
                for subscript in &part.subscripts {
                    match subscript {
                        Subscript::At(expression) => indices.push(self.whole(expression)?.to_string()),
                        Subscript::All => return None,
                    }
                }
                text.push_str(&format!("[{}]", indices.join(",")));
            }
            text.push('.');
        }
        text.push_str(&last.name);
        Some((text, &last.subscripts))
    }

    fn name(&mut self, parts: &[Part], span: &Span) -> Option<Value> {
        let (name, subscripts) = self.joined(parts)?;
        for k in (0..self.scopes.len()).rev() {
            if let Some(value) = self.scopes[k].values.get(&name) {
                let value = value.clone();
                return self.part(value, subscripts, span);
            }
            if !self.scopes[k].is_open {
                // A function sees constants of the package beside its own names.
                let is_constant = self
                    .declared
                    .get(&name)
                    .and_then(|declared| declared.symbols.first())
                    .is_some_and(|symbol| self.variables[symbol.0 as usize].role == Role::Constant);
                if !is_constant {
                    let what = format!("`{name}` is not declared in this function");
                    return self.fault(span, what, "a function knows its inputs, its own variables and constants alone");
                }
                break;
            }
        }
        let Some(declared) = self.declared.get(&name).cloned() else {
            let (what, help) = self.unknown(&name);
            return self.fault(span, what, &help);
        };
        let basic = declared.symbols.first().map_or(Basic::Real, |symbol| self.variables[symbol.0 as usize].basic);
        let items = declared.symbols.iter().map(|symbol| self.pool.symbol(*symbol)).collect();
        self.part(Value { sizes: declared.sizes, items, basic }, subscripts, span)
    }

    /// What to say of a name that nobody declared.
    fn unknown(&self, name: &str) -> (String, String) {
        let near = self
            .declared
            .keys()
            .filter(|known| known.eq_ignore_ascii_case(name) || distance(known, name) <= 1 + name.len() / 6)
            .min_by_key(|known| (distance(known, name), (*known).clone()));
        (format!("`{name}` is not declared"), near.map_or_else(String::new, |near| format!("there is `{near}`")))
    }

    /// A part of an array.
    fn part(&mut self, value: Value, subscripts: &[Subscript], span: &Span) -> Option<Value> {
        if subscripts.is_empty() {
            return Some(value);
        }
        if subscripts.len() > value.sizes.len() {
            let what = format!("{} subscripts of {}", subscripts.len(), value.shape());
            return self.fault(span, what, "");
        }
        let mut sizes = Vec::new();
        let mut chosen: Vec<Vec<usize>> = Vec::new();
        for (k, size) in value.sizes.iter().enumerate() {
            match subscripts.get(k) {
                None | Some(Subscript::All) => {
                    sizes.push(*size);
                    chosen.push((0..*size).collect());
                }
                Some(Subscript::At(expression)) => {
                    self.ends.push(*size);
                    let at = self.value(expression);
                    self.ends.pop();
                    let at = at?;
                    let mut places = Vec::new();
                    for item in &at.items {
                        let Some(index) = self.known(*item) else {
                            return self.fault(
                                &expression.span,
                                "a subscript that changes while the model runs is not read",
                                "write the choice as an if-expression, or as a response surface",
                            );
                        };
                        if index.fract() != 0.0 || index < 1.0 || index > *size as f64 {
                            return self.fault(&expression.span, format!("the subscript is {index}, expected 1 to {size}"), "");
                        }
                        places.push(index as usize - 1);
                    }
                    if !at.is_scalar() {
                        sizes.push(places.len());
                    }
                    chosen.push(places);
                }
            }
        }
        let mut places = vec![0_usize];
        for (k, size) in value.sizes.iter().enumerate() {
            places = places.iter().flat_map(|head| chosen[k].iter().map(move |index| head * size + index)).collect();
        }
        let items = places.into_iter().map(|place| value.items[place]).collect();
        Some(Value { sizes, items, basic: value.basic })
    }

    fn sum(&mut self, terms: &[(bool, Expression)]) -> Option<Value> {
        let mut total: Option<Value> = None;
        let mut broken = false;
        for (is_minus, term) in terms {
            let Some(mut value) = self.value(term) else {
                broken = true;
                continue;
            };
            if value.basic == Basic::Boolean {
                broken = true;
                let _: Option<()> =
                    self.fault(&term.span, "found a Boolean, expected a number", "write `if condition then 1 else 0`");
                continue;
            }
            total = match total {
                None => {
                    if *is_minus {
                        value.items = value.items.into_iter().map(|item| self.pool.negate(item)).collect();
                    }
                    Some(value)
                }
                Some(total) => {
                    let operation = if *is_minus { Binary::Subtract } else { Binary::Add };
                    let sum = self.element_wise(&total, &value, operation, &term.span);
                    broken |= sum.is_none();
                    // Behind a fault the rest is still looked at.
                    Some(sum.unwrap_or(total))
                }
            };
        }
        total.filter(|_| !broken)
    }

    /// An operation on each pair of elements; a scalar goes with each element.
    pub(super) fn element_wise(&mut self, a: &Value, b: &Value, operation: Binary, span: &Span) -> Option<Value> {
        let basic = if operation == Binary::Divide || operation == Binary::Power {
            Basic::Real
        } else {
            self.common(a.basic, b.basic, span)?
        };
        let is_sum = matches!(operation, Binary::Add | Binary::Subtract);
        if a.sizes != b.sizes && (is_sum || !(a.is_scalar() || b.is_scalar())) {
            let what = format!("found {} beside {}", b.shape(), a.shape());
            return self.fault(span, what, if is_sum { "a sum is of values of one shape" } else { "" });
        }
        let long = if a.is_scalar() { b } else { a };
        self.spend(long.items.len(), span)?;
        let at = |value: &Value, k: usize| value.items[if value.is_scalar() { 0 } else { k }];
        let items = (0..long.items.len()).map(|k| self.pool.binary(operation, at(a, k), at(b, k))).collect();
        Some(Value { sizes: long.sizes.clone(), items, basic })
    }

    fn product(&mut self, factors: &[(Joint, Expression)]) -> Option<Value> {
        let mut total: Option<Value> = None;
        let mut broken = false;
        for (joint, factor) in factors {
            let Some(value) = self.value(factor) else {
                broken = true;
                continue;
            };
            if value.basic == Basic::Boolean {
                broken = true;
                let _: Option<()> =
                    self.fault(&factor.span, "found a Boolean, expected a number", "write `if condition then 1 else 0`");
                continue;
            }
            total = match total {
                None => Some(value),
                Some(total) => {
                    let product = self.times(&total, *joint, &value, &factor.span);
                    broken |= product.is_none();
                    Some(product.unwrap_or(total))
                }
            };
        }
        total.filter(|_| !broken)
    }

    fn times(&mut self, a: &Value, joint: Joint, b: &Value, span: &Span) -> Option<Value> {
        match joint {
            Joint::EachTimes => self.element_wise(a, b, Binary::Multiply, span),
            Joint::EachOver => self.element_wise(a, b, Binary::Divide, span),
            Joint::Over => {
                if !b.is_scalar() {
                    return self.fault(span, format!("a division by {}", b.shape()), "element by element it is written `./`");
                }
                self.element_wise(a, b, Binary::Divide, span)
            }
            Joint::Times if a.is_scalar() || b.is_scalar() => self.element_wise(a, b, Binary::Multiply, span),
            Joint::Times => self.matrix_product(a, b, span),
        }
    }

    /// Vector times vector, matrix times vector, vector times matrix, matrix times matrix.
    fn matrix_product(&mut self, a: &Value, b: &Value, span: &Span) -> Option<Value> {
        let (rows, inner) = match a.sizes[..] {
            [n] => (None, n),
            [n, m] => (Some(n), m),
            _ => return self.fault(span, format!("a product of {}", a.shape()), ""),
        };
        let (its, columns) = match b.sizes[..] {
            [n] => (n, None),
            [n, m] => (n, Some(m)),
            _ => return self.fault(span, format!("a product with {}", b.shape()), ""),
        };
        if inner != its {
            return self.fault(span, format!("a product of {} with {}", a.shape(), b.shape()), "");
        }
        let basic = self.common(a.basic, b.basic, span)?;
        let width = columns.unwrap_or(1);
        self.spend(rows.unwrap_or(1).saturating_mul(width).saturating_mul(inner), span)?;
        let mut items = Vec::new();
        for row in 0..rows.unwrap_or(1) {
            for column in 0..width {
                let mut sum = self.pool.number(0.0);
                for k in 0..inner {
                    let product = self.pool.multiply(a.items[row * inner + k], b.items[k * width + column]);
                    sum = self.pool.add(sum, product);
                }
                items.push(sum);
            }
        }
        Some(Value { sizes: rows.into_iter().chain(columns).collect(), items, basic })
    }

    fn power(&mut self, base: &Expression, exponent: &Expression, each: bool) -> Option<Value> {
        let (a, b) = (self.value(base), self.value(exponent));
        let (a, b) = (a?, b?);
        if a.basic == Basic::Boolean || b.basic == Basic::Boolean {
            return self.fault(&base.span, "a power of Booleans", "");
        }
        if !(each || a.is_scalar() && b.is_scalar()) {
            return self.fault(&base.span, "a power of an array is not read", "element by element it is written `.^`");
        }
        self.element_wise(&a, &b, Binary::Power, &base.span)
    }

    fn relation(&mut self, compare: Compare, left: &Expression, right: &Expression, span: &Span) -> Option<Value> {
        let (a, b) = (self.scalar(left), self.scalar(right));
        let ((a, its), (b, other)) = (a?, b?);
        self.common(its, other, span)?;
        let is_equality = matches!(compare, Compare::Equal | Compare::Different);
        if is_equality && (its == Basic::Real || other == Basic::Real) && self.scopes.iter().all(|scope| scope.is_open) {
            let what = "two real numbers are compared for equality";
            return self.fault(
                span,
                what,
                "compare with `<` or `>`: a number that is computed is hardly ever equal to another",
            );
        }
        // Whole numbers and Booleans change at events alone.
        let operation = if self.without_events || is_equality { Binary::LessNow } else { Binary::Less };
        let below = |pool: &mut Pool, a: Id, b: Id| pool.binary(operation, a, b);
        let id = match compare {
            Compare::Less => below(&mut self.pool, a, b),
            Compare::Greater => below(&mut self.pool, b, a),
            Compare::LessEqual => {
                let above = below(&mut self.pool, b, a);
                self.pool.unary(Unary::Not, above)
            }
            Compare::GreaterEqual => {
                let under = below(&mut self.pool, a, b);
                self.pool.unary(Unary::Not, under)
            }
            Compare::Equal | Compare::Different => {
                let (under, above) = (below(&mut self.pool, a, b), below(&mut self.pool, b, a));
                let different = self.pool.binary(Binary::Or, under, above);
                if compare == Compare::Equal { self.pool.unary(Unary::Not, different) } else { different }
            }
        };
        Some(Value::scalar(id, Basic::Boolean))
    }

    fn conditions(&mut self, items: &[Expression], operation: Binary) -> Option<Value> {
        let found: Vec<Option<Id>> = items.iter().map(|item| self.condition(item)).collect();
        let found: Option<Vec<Id>> = found.into_iter().collect();
        let id = found?.into_iter().reduce(|a, b| self.pool.binary(operation, a, b))?;
        Some(Value::scalar(id, Basic::Boolean))
    }

    fn choice(&mut self, branches: &[(Expression, Expression)], otherwise: &Expression, span: &Span) -> Option<Value> {
        let mut found = Vec::new();
        for (condition, value) in branches {
            found.push((self.condition(condition), self.value(value)));
        }
        let mut result = self.value(otherwise)?;
        for (condition, value) in found.into_iter().rev() {
            let (condition, value) = (condition?, value?);
            if value.sizes != result.sizes {
                let what = format!("the values of `if` are {} and {}", value.shape(), result.shape());
                return self.fault(span, what, "");
            }
            let basic = self.common(value.basic, result.basic, span)?;
            let items = value.items.iter().zip(&result.items).map(|(a, b)| self.pool.choose(condition, *a, *b)).collect();
            result = Value { sizes: value.sizes, items, basic };
        }
        Some(result)
    }
}

/// The value of an expression of constants and parameters, and the parameters that it depends on.
pub(crate) fn known(pool: &Pool, variables: &[Variable], id: Id) -> Option<(f64, Vec<Symbol>)> {
    if let Some(value) = pool.value(id) {
        return Some((value, Vec::new()));
    }
    // Values of symbols that depend on one another, by depth first; a symbol that is open already depends on itself.
    let mut found: HashMap<Symbol, f64> = HashMap::new();
    let mut used = Vec::new();
    let mut open = vec![(None, id)];
    while let Some((symbol, root)) = open.last().copied() {
        let missing = pool.symbols(root).into_iter().find(|symbol| !found.contains_key(symbol));
        if let Some(missing) = missing {
            let variable = &variables[missing.0 as usize];
            let value = variable.value.filter(|_| matches!(variable.role, Role::Constant | Role::Parameter))?;
            if open.iter().any(|(symbol, _)| *symbol == Some(missing)) {
                return None;
            }
            if variable.role == Role::Parameter {
                used.push(missing);
            }
            open.push((Some(missing), value));
            continue;
        }
        let mut values = Values::new(pool);
        for (symbol, value) in &found {
            values.set(*symbol, *value);
        }
        let value = values.of(root);
        match symbol {
            Some(symbol) => {
                found.insert(symbol, value);
                open.pop();
            }
            None => return value.is_finite().then_some((value, used)),
        }
    }
    None
}

/// How many letters differ between two names: changed, left out or added.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}
