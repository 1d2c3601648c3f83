//! The nested sums of a polynomial of several variables, and their output.
//!
//! In: parts of the nest. Out: their sums, products and powers on a tape, or only their number and depth. Both come from the same code (`levels.rs`),
//! so the cost of a scheme is exact. The scheme is chosen in `scheme.rs`.
//!
//! A product by 1 or by -1 is not written. A product by 1 is the factor itself. A product by -1 is its negative, and the sum that uses it becomes a
//! difference. A product with a negative factor is the negative of the product. All of this is exact. (The negative of a sum is not the sum of the
//! negatives: one may be -0 and the other +0.)
//!
//! A value is ready when the longest chain of operations before it is done. Constants and arguments are ready at 0, as in `Tape::depth`.

use std::collections::BTreeMap;

use crate::number::{Rational, integer};
use crate::tape::{Op, Reg, TapeBuilder};

/// A term whose coefficient may carry the scales of its variables.
pub(super) struct ScaledTerm<'a> {
    pub(super) powers: &'a [u32],
    pub(super) coefficient: Rational,
}

/// The output of the nest.
pub(super) trait NestOutput {
    /// A value in it.
    type Value: Copy;
    fn constant(&mut self, value: &Rational) -> Self::Value;
    fn add(&mut self, a: Self::Value, b: Self::Value) -> Self::Value;
    fn subtract(&mut self, a: Self::Value, b: Self::Value) -> Self::Value;
    fn negate(&mut self, a: Self::Value) -> Self::Value;
    fn multiply(&mut self, a: Self::Value, b: Self::Value) -> Self::Value;
    /// The length of the longest chain of operations from the arguments to a value.
    fn ready(&self, value: Self::Value) -> usize;
}

/// Output to a tape. Each value has its depth.
pub(super) struct Written<'t>(pub(super) &'t mut TapeBuilder);

impl Written<'_> {
    fn push(&mut self, op: Op, [a, b]: [(Reg, usize); 2]) -> (Reg, usize) {
        (self.0.push(op), a.1.max(b.1) + 1)
    }
}

impl NestOutput for Written<'_> {
    type Value = (Reg, usize);

    fn constant(&mut self, value: &Rational) -> Self::Value {
        (self.0.constant(value.clone()), 0)
    }

    fn add(&mut self, a: Self::Value, b: Self::Value) -> Self::Value {
        self.push(Op::Add(a.0, b.0), [a, b])
    }

    fn subtract(&mut self, a: Self::Value, b: Self::Value) -> Self::Value {
        self.push(Op::Subtract(a.0, b.0), [a, b])
    }

    fn negate(&mut self, a: Self::Value) -> Self::Value {
        self.push(Op::Negate(a.0), [a, a])
    }

    fn multiply(&mut self, a: Self::Value, b: Self::Value) -> Self::Value {
        self.push(Op::Multiply(a.0, b.0), [a, b])
    }

    fn ready(&self, value: Self::Value) -> usize {
        value.1
    }
}

/// No output: only operations are counted, and a value is its depth.
#[derive(Default)]
pub(super) struct Counted {
    pub(super) operations: usize,
}

impl NestOutput for Counted {
    type Value = usize;

    fn constant(&mut self, _: &Rational) -> usize {
        0
    }

    fn add(&mut self, a: usize, b: usize) -> usize {
        self.operations += 1;
        a.max(b) + 1
    }

    fn subtract(&mut self, a: usize, b: usize) -> usize {
        self.add(a, b)
    }

    fn negate(&mut self, a: usize) -> usize {
        self.add(a, a)
    }

    fn multiply(&mut self, a: usize, b: usize) -> usize {
        self.add(a, b)
    }

    fn ready(&self, value: usize) -> usize {
        value
    }
}

/// The result of a level or a part of it, with pending operations.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part<'l, V> {
    /// A coefficient.
    Constant(&'l Rational),
    /// A value.
    Value(V),
    /// The opposite of a value.
    Opposite(V),
}

/// A polynomial that is written level by level.
pub(super) struct Nest<'s, S: NestOutput> {
    pub(super) output: &'s mut S,
    /// The existing powers of each factor; the first power exists from the beginning if a term has the factor.
    powers: Vec<BTreeMap<u32, S::Value>>,
}

impl<'s, S: NestOutput> Nest<'s, S> {
    /// `variables`: the value of each factor that a term has.
    pub(super) fn new(output: &'s mut S, variables: &[Option<S::Value>]) -> Self {
        let powers = variables.iter().map(|variable| variable.iter().map(|value| (1, *value)).collect()).collect();
        Nest { output, powers }
    }

    /// A part as a value.
    pub(super) fn written(&mut self, part: Part<'_, S::Value>) -> S::Value {
        match part {
            Part::Constant(value) => self.output.constant(value),
            Part::Value(value) => value,
            Part::Opposite(value) => self.output.negate(value),
        }
    }

    /// The depth at which a part is ready for a sum; a sign has no cost there.
    pub(super) fn ready(&self, part: &Part<'_, S::Value>) -> usize {
        match part {
            Part::Constant(_) => 0,
            Part::Value(value) | Part::Opposite(value) => self.output.ready(*value),
        }
    }

    pub(super) fn sum<'l>(&mut self, a: Part<'_, S::Value>, b: Part<'_, S::Value>) -> Part<'l, S::Value> {
        Part::Value(match (a, b) {
            (a, Part::Opposite(b)) => {
                let a = self.written(a);
                self.output.subtract(a, b)
            }
            (Part::Opposite(a), b) => {
                let b = self.written(b);
                self.output.subtract(b, a)
            }
            (a, b) => {
                let (a, b) = (self.written(a), self.written(b));
                self.output.add(a, b)
            }
        })
    }

    pub(super) fn product<'l>(&mut self, a: Part<'_, S::Value>, b: S::Value) -> Part<'l, S::Value> {
        match a {
            Part::Constant(one) if *one == integer(1) => Part::Value(b),
            Part::Constant(minus_one) if *minus_one == integer(-1) => Part::Opposite(b),
            Part::Opposite(a) => Part::Opposite(self.output.multiply(a, b)),
            a => {
                let a = self.written(a);
                Part::Value(self.output.multiply(a, b))
            }
        }
    }

    /// The variable of a factor itself.
    pub(super) fn variable(&self, factor: usize) -> S::Value {
        self.powers[factor][&1]
    }

    /// A power of a factor: the existing one, or the product of two existing ones (of several such pairs, the one that is ready first), or of its two
    /// halves.
    pub(super) fn power(&mut self, factor: usize, exponent: u32) -> S::Value {
        let known = &self.powers[factor];
        if let Some(value) = known.get(&exponent) {
            return *value;
        }
        let pairs = known.iter().filter_map(|(one, a)| {
            let b = known.get(&exponent.checked_sub(*one)?)?;
            (2 * one >= exponent).then_some([*a, *b])
        });
        let output = &*self.output;
        let pair = pairs.min_by_key(|[a, b]| output.ready(*a).max(output.ready(*b)));
        let [a, b] = pair.unwrap_or_else(|| {
            let half = exponent / 2;
            [self.power(factor, exponent - half), self.power(factor, half)]
        });
        let value = self.output.multiply(a, b);
        self.powers[factor].insert(exponent, value);
        value
    }
}

/// The terms with one power of a factor.
pub(super) fn with_power<'l, 'a>(scaled_terms: &[&'l ScaledTerm<'a>], factor: usize, exponent: u32) -> Vec<&'l ScaledTerm<'a>> {
    scaled_terms.iter().filter(|term| term.powers[factor] == exponent).copied().collect()
}

/// The highest power of a factor among some terms.
pub(super) fn degree(scaled_terms: &[&ScaledTerm<'_>], factor: usize) -> u32 {
    scaled_terms.iter().map(|term| term.powers[factor]).max().expect("there is at least one term")
}

#[cfg(test)]
mod tests;
