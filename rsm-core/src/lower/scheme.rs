//! Chooses how the sums of a polynomial are nested: the order of the variables, and the form of each level.
//!
//! In: the terms, when each variable is ready, and where the form of powers is allowed. Out: a scheme. No tape is written: for each candidate the
//! operations are counted (`levels.rs`), and the one with the lowest score is used.

use super::levels::{Form, Level};
use super::nest::{Counted, Nest, ScaledTerm};

/// Up to this many factors every order of nesting is tried (6! = 720 small trees for each choice of forms). With more, only orders that differ by one
/// exchange from the order of the file.
const ALL_ORDERS_UP_TO: usize = 6;

/// Up to this many factors every choice of forms is tried (3! 2^3 = 48 trees). With more, at most one level has the form of powers.
const ALL_FORMS_UP_TO: usize = 3;

/// The properties of a factor that a term has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) factor: usize,
    /// Whether its input clamps, so that it is finite.
    pub(super) is_bounded: bool,
    /// Whether its powers stay inside the exponent range.
    pub(super) has_powers: bool,
}

/// The cost of a scheme on the tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cost {
    pub(super) operations: usize,
    /// The depth at which the result is ready, including the chains of the variables.
    pub(super) ready: usize,
}

impl Cost {
    /// An operation has a cost on every machine: an issue slot, an instruction in memory. A longer chain has a cost only if several operations run in
    /// parallel; a Cortex-M4F executes one at a time. So one more operation must shorten the chain by more than two.
    fn score(self) -> usize {
        2 * self.operations + self.ready
    }
}

/// The scheme with the lowest score, outermost level first. Of equal ones, that with the most levels in Horner form, then with the fewest operations,
/// then the first. `ready`: for each factor that a term has.
pub(super) fn best(scaled_terms: &[&ScaledTerm<'_>], candidates: &[Candidate], ready: &[Option<usize>]) -> Vec<Level> {
    let mut best: Option<((usize, usize, usize), Vec<Level>)> = None;
    let mut consider = |order: &[Candidate]| {
        for levels in forms(order) {
            let cost = cost(scaled_terms, &levels, ready);
            let key = (cost.score(), departures(&levels), cost.operations);
            if best.as_ref().is_none_or(|(lowest, _)| key < *lowest) {
                best = Some((key, levels));
            }
        }
    };
    if candidates.len() <= ALL_ORDERS_UP_TO {
        permutations(candidates, &mut Vec::with_capacity(candidates.len()), &mut consider);
    } else {
        for a in 0..candidates.len() {
            // An exchange of a place with itself gives the order of the file, which comes first.
            for b in a..candidates.len() {
                let mut order = candidates.to_vec();
                order.swap(a, b);
                consider(&order);
            }
        }
    }
    best.expect("there is at least one order").1
}

/// The operations and the depth of a scheme, without writing it.
pub(super) fn cost(scaled_terms: &[&ScaledTerm<'_>], levels: &[Level], ready: &[Option<usize>]) -> Cost {
    let mut output = Counted::default();
    let ready = Nest::new(&mut output, ready).value(scaled_terms, levels);
    Cost { operations: output.operations, ready }
}

/// The choices of forms for an order of nesting; all Horner first.
fn forms(order: &[Candidate]) -> Vec<Vec<Level>> {
    let most = if order.len() <= ALL_FORMS_UP_TO { order.len() } else { 1 };
    let mut all = vec![vec![]];
    for (k, candidate) in order.iter().enumerate() {
        let with = |levels: &Vec<Level>, form| [levels.as_slice(), &[Level { factor: candidate.factor, form }]].concat();
        // A power that underflows to 0, times an infinite coefficient, is NaN, so the inner levels must be finite too.
        let may = candidate.has_powers && order[k..].iter().all(|inside| inside.is_bounded);
        let powers = all.iter().filter(|levels| may && departures(levels) < most).map(|levels| with(levels, Form::Powers));
        all = all.iter().map(|levels| with(levels, Form::Horner)).chain(powers).collect();
    }
    all
}

/// The number of levels that are not in Horner form.
fn departures(levels: &[Level]) -> usize {
    levels.iter().filter(|level| level.form == Form::Powers).count()
}

/// Every order of `rest` after `prefix`, in lexicographic order of `rest`.
fn permutations(rest: &[Candidate], prefix: &mut Vec<Candidate>, visit: &mut impl FnMut(&[Candidate])) {
    if rest.is_empty() {
        visit(prefix);
        return;
    }
    for k in 0..rest.len() {
        let mut others = rest.to_vec();
        prefix.push(others.remove(k));
        permutations(&others, prefix, visit);
        prefix.pop();
    }
}

#[cfg(test)]
mod tests;
