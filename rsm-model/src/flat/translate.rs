//! Expressions: tree to pool.

use std::collections::HashMap;

use rsm_core::source::{Collector, Source};

use crate::expression::{Binary, Id, Pool, Symbol, Unary};
use crate::syntax::tree::{self, Expression, Kind, Span};

use super::known::known;
use super::value::Value;
use super::{Basic, Sample, Surface, Variable};

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
    /// Whether names of the model may be used: true in a loop, false in a function.
    pub(super) is_open: bool,
}

pub(super) struct Translator<'t> {
    pub(super) source: &'t Source,
    pub(super) faults: &'t mut Collector,
    /// The number of reported faults.
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
    /// Whether inside `noEvent` or a function, where comparisons are no switches.
    pub(super) without_events: bool,
    /// Whether inside a `when`.
    pub(super) at_event: bool,
    /// The sizes to which `end` refers, the innermost last.
    pub(super) ends: Vec<usize>,
    /// The depth of nested function calls.
    pub(super) calls: usize,
    /// The number of elements and loop iterations written out so far.
    pub(super) written: usize,
}

/// The largest number of elements of an array, so that a mistyped size does not fill the memory.
pub(super) const MOST_ELEMENTS: usize = 100_000;

/// The largest number of array elements and loop iterations of a text, in all.
const MOST_WRITTEN: usize = 2_000_000;

impl<'t> Translator<'t> {
    /// A translator without declarations.
    pub(super) fn new(source: &'t Source, faults: &'t mut Collector) -> Self {
        Translator {
            source,
            faults,
            told: 0,
            pool: Pool::default(),
            variables: Vec::new(),
            names: HashMap::new(),
            declared: HashMap::new(),
            functions: HashMap::new(),
            surfaces: Vec::new(),
            samples: Vec::new(),
            scopes: Vec::new(),
            without_events: false,
            at_event: false,
            ends: Vec::new(),
            calls: 0,
            written: 0,
        }
    }
}

impl Translator<'_> {
    pub(super) fn fault<T>(&mut self, span: &Span, what: impl Into<String>, help: &str) -> Option<T> {
        self.told += 1;
        let fault = self.source.fault(span.clone(), what);
        self.faults.push(if help.is_empty() { fault } else { fault.help(help) });
        None
    }

    /// Translates an expression; `None` after a reported fault.
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

    /// The translations of several expressions; every fault in them is reported.
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

    /// An integer that is known when the text is read. Parameters that it depends on become structural.
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

    /// Counts the elements that are written out, and stops a text that would become too large.
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

    /// Values of one shape, combined into an array with one more dimension.
    fn stacked(&mut self, values: Vec<Value>, span: &Span) -> Option<Value> {
        let Some(first) = values.first().cloned() else {
            return Some(Value { sizes: vec![0], items: Vec::new(), basic: Basic::Real });
        };
        if let Some(other) = values.iter().find(|value| value.sizes != first.sizes) {
            let what = format!("found an array of {} and {}", first.shape(), other.shape());
            return self.fault(span, what, "all elements of an array must have the same shape");
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
}
