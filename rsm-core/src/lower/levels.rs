//! Writes or counts the levels of a nest, each in one of two forms.
//!
//! In: terms, and levels from `scheme.rs`, the first outermost. Out: the sum of the terms on a sheet. Both forms are in one file, because a level of
//! one form contains levels of the other.

use super::nest::{Nest, NestOutput, Part, ScaledTerm, degree, with_power};

/// The form of a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// (... (a_d v + a_{d-1}) v + ...) v + a_0. It has the fewest operations, but each of them depends on the one before.
    Horner,
    /// A sum over shared powers: a_0 + a_1 v + a_2 v^2 + ..., with each power of v written once. The products are independent, so the chain grows
    /// with the logarithm of the degree; Horner's grows with twice the degree. It needs one more operation for each power above the first. (Estrin,
    /// "Organization of computer systems: the fixed plus variable structure computer", 1960, splits a sum likewise.)
    ///
    /// It is not allowed where an infinity can occur: inf - inf is NaN, where Horner's rule gives an infinity. `scheme.rs` ensures this.
    Powers,
}

/// A sum over the powers of one factor; its coefficients are the levels inside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Level {
    pub(super) factor: usize,
    pub(super) form: Form,
}

impl<S: NestOutput> Nest<'_, S> {
    /// The sum of some terms as a value, nested as in `levels`, the first outermost.
    pub(super) fn value(&mut self, scaled_terms: &[&ScaledTerm<'_>], levels: &[Level]) -> S::Value {
        let part = self.part(scaled_terms, levels);
        self.written(part)
    }

    /// The same, with the sign or the constant not yet written.
    fn part<'l>(&mut self, scaled_terms: &[&'l ScaledTerm<'_>], levels: &[Level]) -> Part<'l, S::Value> {
        let Some((level, inner)) = levels.split_first() else {
            // Two terms with the same powers are rejected by the check, so one term remains.
            return Part::Constant(&scaled_terms[0].coefficient);
        };
        match level.form {
            Form::Horner => {
                let addends = horner_addends(self, scaled_terms, level.factor, inner);
                addends.into_iter().reduce(|sum, addend| self.sum(sum, addend)).expect("there is at least one term")
            }
            Form::Powers => {
                let addends = power_addends(self, scaled_terms, level.factor, inner);
                shallowest_sum(self, addends)
            }
        }
    }

    /// The same, with the last sum not yet written, so that it can be combined with others.
    fn addends<'l>(&mut self, scaled_terms: &[&'l ScaledTerm<'_>], levels: &[Level]) -> Vec<Part<'l, S::Value>> {
        match levels.split_first() {
            Some((Level { factor, form: Form::Horner }, inner)) => horner_addends(self, scaled_terms, *factor, inner),
            Some((Level { factor, form: Form::Powers }, inner)) => power_addends(self, scaled_terms, *factor, inner),
            None => vec![self.part(scaled_terms, levels)],
        }
    }
}

/// The product with v, then a_0; either may be absent.
fn horner_addends<'l, S: NestOutput>(
    nest: &mut Nest<'_, S>,
    scaled_terms: &[&'l ScaledTerm<'_>],
    factor: usize,
    inner: &[Level],
) -> Vec<Part<'l, S::Value>> {
    let mut sum: Vec<Part<'l, S::Value>> = vec![];
    for exponent in (0..=degree(scaled_terms, factor)).rev() {
        if let Some(total) = sum.into_iter().reduce(|product, here| nest.sum(product, here)) {
            let variable = nest.variable(factor);
            sum = vec![nest.product(total, variable)];
        } else {
            sum = vec![];
        }
        let group = with_power(scaled_terms, factor, exponent);
        if !group.is_empty() {
            sum.push(nest.part(&group, inner));
        }
    }
    sum
}

/// The products a_k v^k, the highest first, then the addends of a_0.
fn power_addends<'l, S: NestOutput>(
    nest: &mut Nest<'_, S>,
    scaled_terms: &[&'l ScaledTerm<'_>],
    factor: usize,
    inner: &[Level],
) -> Vec<Part<'l, S::Value>> {
    let exponents = 1..=degree(scaled_terms, factor);
    let groups: Vec<_> =
        exponents.map(|k| (k, with_power(scaled_terms, factor, k))).filter(|(_, group)| !group.is_empty()).collect();
    // Low powers first, because the higher ones are computed from them.
    let powers: Vec<S::Value> = groups.iter().map(|(k, _)| nest.power(factor, *k)).collect();
    let product = |((_, group), power): (&(u32, Vec<&'l ScaledTerm<'_>>), S::Value)| {
        let coefficient = nest.part(group, inner);
        nest.product(coefficient, power)
    };
    let mut addends: Vec<Part<'l, S::Value>> = groups.iter().zip(powers).rev().map(product).collect();
    let rest = with_power(scaled_terms, factor, 0);
    if !rest.is_empty() {
        addends.extend(nest.addends(&rest, inner));
    }
    addends
}

/// The sum of addends: repeatedly the two that are ready first, of equal ones those that came first. This order has the smallest depth.
pub(super) fn shallowest_sum<'l, S: NestOutput>(
    nest: &mut Nest<'_, S>,
    mut addends: Vec<Part<'l, S::Value>>,
) -> Part<'l, S::Value> {
    while addends.len() > 1 {
        // The sort is stable.
        addends.sort_by_key(|addend| nest.ready(addend));
        let [a, b] = [addends.remove(0), addends.remove(0)];
        let sum = nest.sum(a, b);
        addends.push(sum);
    }
    addends.pop().expect("there is at least one term")
}
