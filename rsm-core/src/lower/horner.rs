//! A level in Horner form: (... (a_d v + a_{d-1}) v + ...) v + a_0.
//!
//! In: the terms of the level, its factor, the levels inside. Out: the addends of the last sum, a_0 last. It has the fewest operations of
//! the two forms, and every one of them waits for the one before.

use super::nest::{Leaf, Nest, Part, Sheet, degree, with_power};
use super::scheme::Level;

/// The product with v, then a_0, either of which may be absent.
pub(super) fn addends<'l, S: Sheet>(
    nest: &mut Nest<'_, S>,
    leaves: &[&'l Leaf<'_>],
    factor: usize,
    inner: &[Level],
) -> Vec<Part<'l, S::Value>> {
    let mut sum: Vec<Part<'l, S::Value>> = vec![];
    for exponent in (0..=degree(leaves, factor)).rev() {
        if let Some(total) = sum.into_iter().reduce(|product, here| nest.sum(product, here)) {
            let variable = nest.variable(factor);
            sum = vec![nest.product(total, variable)];
        } else {
            sum = vec![];
        }
        let group = with_power(leaves, factor, exponent);
        if !group.is_empty() {
            sum.push(nest.part(&group, inner));
        }
    }
    sum
}
