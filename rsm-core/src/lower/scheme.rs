//! Chooses how the sums of a polynomial are nested: which variable is outermost, and in which of two forms each level is written.
//!
//! In: the terms, when each variable is ready, and for which the form of powers may be used. Out: a scheme. Never writes a tape: candidates
//! are walked through as if they were written (`levels.rs`), and the one of the lowest score is taken.

use super::levels::{Form, Level};
use super::nest::{Counted, Leaf, Nest};

/// Every order of nesting is tried up to this many factors (6! = 720 walks of a small tree, for each choice of forms); beyond it, orders that
/// differ by one exchange from the order of the file.
const ALL_ORDERS_UP_TO: usize = 6;

/// Every choice of forms is tried up to this many factors (3! 2^3 = 48 walks); beyond it at most one level has the form of powers.
const ALL_FORMS_UP_TO: usize = 3;

/// What is known of a factor that a term has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) factor: usize,
    /// Its input clamps, so that it is finite.
    pub(super) is_bounded: bool,
    /// Its powers stay inside the exponent range.
    pub(super) has_powers: bool,
}

/// What a scheme would put on the tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cost {
    pub(super) operations: usize,
    /// When the result is ready, the chains of the variables included.
    pub(super) ready: usize,
}

impl Cost {
    /// An operation costs on every machine: an issue slot, an instruction in memory. A step of the chain costs only where several operations
    /// run side by side; a Cortex-M4F has one at a time. So an operation more must make the chain shorter by more than two.
    fn score(self) -> usize {
        2 * self.operations + self.ready
    }
}

/// The scheme of the lowest score, outermost level first; of equal ones that with the most levels in Horner form, then with the fewest operations,
/// then the first. `ready`: of each factor that a term has.
pub(super) fn best(leaves: &[&Leaf<'_>], candidates: &[Candidate], ready: &[Option<usize>]) -> Vec<Level> {
    let mut best: Option<((usize, usize, usize), Vec<Level>)> = None;
    let mut consider = |order: &[Candidate]| {
        for levels in forms(order) {
            let cost = cost(leaves, &levels, ready);
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
            // A place exchanged with itself is the order of the file, the first of all.
            for b in a..candidates.len() {
                let mut order = candidates.to_vec();
                order.swap(a, b);
                consider(&order);
            }
        }
    }
    best.expect("there is at least one order").1
}

/// Operations and readiness of a scheme, without writing it.
pub(super) fn cost(leaves: &[&Leaf<'_>], levels: &[Level], ready: &[Option<usize>]) -> Cost {
    let mut sheet = Counted::default();
    let ready = Nest::new(&mut sheet, ready).value(leaves, levels);
    Cost { operations: sheet.operations, ready }
}

/// The choices of forms for an order of nesting, Horner throughout first.
fn forms(order: &[Candidate]) -> Vec<Vec<Level>> {
    let most = if order.len() <= ALL_FORMS_UP_TO { order.len() } else { 1 };
    let mut all = vec![vec![]];
    for (k, candidate) in order.iter().enumerate() {
        let with = |levels: &Vec<Level>, form| [levels.as_slice(), &[Level { factor: candidate.factor, form }]].concat();
        // A power that underflows to 0 makes a NaN of an infinite coefficient, so what is nested inside must be finite too.
        let may = candidate.has_powers && order[k..].iter().all(|inside| inside.is_bounded);
        let powers = all.iter().filter(|levels| may && departures(levels) < most).map(|levels| with(levels, Form::Powers));
        all = all.iter().map(|levels| with(levels, Form::Horner)).chain(powers).collect();
    }
    all
}

/// How many levels are not in Horner form.
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
