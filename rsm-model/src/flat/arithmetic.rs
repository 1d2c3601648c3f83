//! Sums, products and powers, of scalars and of arrays.

use crate::expression::Binary;
use crate::syntax::tree::{Expression, Joint, Span};

use super::Basic;
use super::translate::Translator;
use super::value::Value;

impl Translator<'_> {
    pub(super) fn sum(&mut self, terms: &[(bool, Expression)]) -> Option<Value> {
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
                    // After a fault the other terms are still checked.
                    Some(sum.unwrap_or(total))
                }
            };
        }
        total.filter(|_| !broken)
    }

    /// An operation on each pair of elements; a scalar is combined with each element.
    pub(super) fn element_wise(&mut self, a: &Value, b: &Value, operation: Binary, span: &Span) -> Option<Value> {
        let basic = if operation == Binary::Divide || operation == Binary::Power {
            Basic::Real
        } else {
            self.common(a.basic, b.basic, span)?
        };
        let is_sum = matches!(operation, Binary::Add | Binary::Subtract);
        if a.sizes != b.sizes && (is_sum || !(a.is_scalar() || b.is_scalar())) {
            let what = format!("found {} and {} in one operation, expected values of one shape", a.shape(), b.shape());
            return self.fault(span, what, "");
        }
        let long = if a.is_scalar() { b } else { a };
        self.spend(long.items.len(), span)?;
        let at = |value: &Value, k: usize| value.items[if value.is_scalar() { 0 } else { k }];
        let items = (0..long.items.len()).map(|k| self.pool.binary(operation, at(a, k), at(b, k))).collect();
        Some(Value { sizes: long.sizes.clone(), items, basic })
    }

    pub(super) fn product(&mut self, factors: &[(Joint, Expression)]) -> Option<Value> {
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
                    return self.fault(
                        span,
                        format!("found a division by {}, expected a scalar", b.shape()),
                        "write an element-wise division as `./`",
                    );
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
            _ => return self.fault(span, format!("found a product of {}, expected vectors or matrices", a.shape()), ""),
        };
        let (its, columns) = match b.sizes[..] {
            [n] => (n, None),
            [n, m] => (n, Some(m)),
            _ => return self.fault(span, format!("found a product with {}, expected vectors or matrices", b.shape()), ""),
        };
        if inner != its {
            return self.fault(
                span,
                format!("found a product of {} and {}, expected equal inner sizes", a.shape(), b.shape()),
                "",
            );
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

    pub(super) fn power(&mut self, base: &Expression, exponent: &Expression, each: bool) -> Option<Value> {
        let (a, b) = (self.value(base), self.value(exponent));
        let (a, b) = (a?, b?);
        if a.basic == Basic::Boolean || b.basic == Basic::Boolean {
            return self.fault(&base.span, "found a Boolean in a power, expected numbers", "");
        }
        if !(each || a.is_scalar() && b.is_scalar()) {
            return self.fault(&base.span, "a power of an array is not supported", "write an element-wise power as `.^`");
        }
        self.element_wise(&a, &b, Binary::Power, &base.span)
    }
}
