//! A level as a sum over shared powers: a_0 + a_1 v + a_2 v^2 + ..., each power of v written once.
//!
//! In: the terms of the level, its factor, the levels inside. Out: the addends. They do not wait for each other, so the chain grows with
//! the logarithm of the degree where Horner's grows with twice the degree, for an operation a power beyond the first.
//! (Estrin, "Organization of computer systems: the fixed plus variable structure computer", 1960, splits a sum likewise.)
//!
//! It may not stand where an infinity can come in: inf - inf is NaN where Horner gives an infinity. `scheme.rs` sees to it.

use super::nest::{Leaf, Nest, Part, Sheet, degree, with_power};
use super::scheme::Level;

/// The products a_k v^k, the highest first, then the addends of a_0.
pub(super) fn addends<'l, S: Sheet>(
    nest: &mut Nest<'_, S>,
    leaves: &[&'l Leaf<'_>],
    factor: usize,
    inner: &[Level],
) -> Vec<Part<'l, S::Value>> {
    let exponents = 1..=degree(leaves, factor);
    let groups: Vec<_> = exponents.map(|k| (k, with_power(leaves, factor, k))).filter(|(_, group)| !group.is_empty()).collect();
    // Low powers first: the higher are made of them.
    let powers: Vec<S::Value> = groups.iter().map(|(k, _)| nest.power(factor, *k)).collect();
    let product = |((_, group), power): (&(u32, Vec<&'l Leaf<'_>>), S::Value)| {
        let coefficient = nest.part(group, inner);
        nest.product(coefficient, power)
    };
    let mut addends: Vec<Part<'l, S::Value>> = groups.iter().zip(powers).rev().map(product).collect();
    let rest = with_power(leaves, factor, 0);
    if !rest.is_empty() {
        addends.extend(nest.addends(&rest, inner));
    }
    addends
}

/// The sum of addends: again and again the two that are ready first, of equal ones those that came first. No other order is shallower.
pub(super) fn sum<'l, S: Sheet>(nest: &mut Nest<'_, S>, mut addends: Vec<Part<'l, S::Value>>) -> Part<'l, S::Value> {
    while addends.len() > 1 {
        // The sort is stable.
        addends.sort_by_key(|addend| nest.ready(addend));
        let [a, b] = [addends.remove(0), addends.remove(0)];
        let sum = nest.sum(a, b);
        addends.push(sum);
    }
    addends.pop().expect("there is at least one term")
}
