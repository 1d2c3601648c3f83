//! Comparisons, conditions and choices.

use crate::expression::{Binary, Id, Pool, Unary};
use crate::syntax::tree::{Compare, Expression, Span};

use super::Basic;
use super::translate::Translator;
use super::value::Value;

impl Translator<'_> {
    pub(super) fn relation(&mut self, compare: Compare, left: &Expression, right: &Expression, span: &Span) -> Option<Value> {
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
        // Integers and Booleans change only at events.
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

    pub(super) fn conditions(&mut self, items: &[Expression], operation: Binary) -> Option<Value> {
        let found: Vec<Option<Id>> = items.iter().map(|item| self.condition(item)).collect();
        let found: Option<Vec<Id>> = found.into_iter().collect();
        let id = found?.into_iter().reduce(|a, b| self.pool.binary(operation, a, b))?;
        Some(Value::scalar(id, Basic::Boolean))
    }

    pub(super) fn choice(
        &mut self,
        branches: &[(Expression, Expression)],
        otherwise: &Expression,
        span: &Span,
    ) -> Option<Value> {
        let mut found = Vec::new();
        for (condition, value) in branches {
            found.push((self.condition(condition), self.value(value)));
        }
        let mut result = self.value(otherwise)?;
        for (condition, value) in found.into_iter().rev() {
            let (condition, value) = (condition?, value?);
            if value.sizes != result.sizes {
                let what = format!("the values of `if` are {} and {}, expected one shape", value.shape(), result.shape());
                return self.fault(span, what, "");
            }
            let basic = self.common(value.basic, result.basic, span)?;
            let items = value.items.iter().zip(&result.items).map(|(a, b)| self.pool.choose(condition, *a, *b)).collect();
            result = Value { sizes: value.sizes, items, basic };
        }
        Some(result)
    }
}
