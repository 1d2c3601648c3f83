//! Chooses how the sums of a polynomial are nested: which variable is outermost, and in which of two forms each level is written.
//!
//! In: the terms, when each variable is ready, and for which the form of powers may be used. Out: a scheme. Never writes a tape: candidates
//! are walked through as if they were written (`nest.rs`), and the one of the lowest score is taken.

use super::nest::{Counted, Leaf, Nest};

/// Every order of nesting is tried up to this many factors (6! = 720 walks of a small tree, for each choice of forms); beyond it, orders that
/// differ by one exchange from the order of the file.
const ALL_ORDERS_UP_TO: usize = 6;

/// Every choice of forms is tried up to this many factors (3! 2^3 = 48 walks); beyond it at most one level has the form of powers.
const ALL_FORMS_UP_TO: usize = 3;

/// How a level is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// `horner.rs`
    Horner,
    /// `powers.rs`
    Powers,
}

/// A sum over the powers of one factor; its coefficients are the levels inside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Level {
    pub(super) factor: usize,
    pub(super) form: Form,
}

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
            let departures = levels.iter().filter(|level| level.form == Form::Powers).count();
            let key = (cost.score(), departures, cost.operations);
            if best.as_ref().is_none_or(|(lowest, _)| key < *lowest) {
                best = Some((key, levels));
            }
        }
    };
    if candidates.len() <= ALL_ORDERS_UP_TO {
        permutations(candidates, &mut Vec::with_capacity(candidates.len()), &mut consider);
    } else {
        consider(candidates);
        for a in 0..candidates.len() {
            for b in a + 1..candidates.len() {
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
    // A power that underflows to 0 makes a NaN of an infinite coefficient, so what is nested inside must be finite too.
    let may: Vec<bool> =
        (0..order.len()).map(|k| order[k].has_powers && order[k..].iter().all(|candidate| candidate.is_bounded)).collect();
    let scheme = |is_powers: &dyn Fn(usize) -> bool| -> Vec<Level> {
        let form = |k| if is_powers(k) { Form::Powers } else { Form::Horner };
        order.iter().enumerate().map(|(k, candidate)| Level { factor: candidate.factor, form: form(k) }).collect()
    };
    let mut all = vec![scheme(&|_| false)];
    if order.len() <= ALL_FORMS_UP_TO {
        let subsets = (1..1usize << order.len()).filter(|set| (0..order.len()).all(|k| set >> k & 1 == 0 || may[k]));
        all.extend(subsets.map(|set| scheme(&|k| set >> k & 1 == 1)));
    } else {
        all.extend((0..order.len()).filter(|k| may[*k]).map(|level| scheme(&|k| k == level)));
    }
    all
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
mod tests {
    use crate::lower::nest::Written;
    use crate::number::{Precision, integer};
    use crate::tape::{Op, Port, TapeBuilder};

    use super::*;

    /// Terms and schemes of every kind, by a linear congruential generator (Knuth, MMIX): deterministic, and nothing is asked of it but variety.
    #[test]
    fn a_cost_is_that_of_the_written_tape() {
        let mut seed = 1u64;
        let mut below = |limit: u64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) % limit
        };
        for _ in 0..300 {
            let factors = 1 + below(4) as usize;
            let mut powers: Vec<Vec<u32>> =
                (0..1 + below(12)).map(|_| (0..factors).map(|_| below(8) as u32).collect()).collect();
            powers.sort();
            powers.dedup();
            // 1 and -1 among them.
            let number = |k: usize| integer([-2, -1, 3, 1, 5][k % 5]);
            let leaves: Vec<Leaf<'_>> =
                powers.iter().enumerate().map(|(k, powers)| Leaf { powers, coefficient: number(k) }).collect();
            let leaves: Vec<&Leaf<'_>> = leaves.iter().collect();
            let mut levels: Vec<Level> = (0..factors)
                .map(|factor| Level { factor, form: if below(2) == 0 { Form::Horner } else { Form::Powers } })
                .collect();
            levels.rotate_left(below(factors as u64) as usize);

            let mut tape = TapeBuilder::new(Precision::F64);
            let mut variables = vec![];
            for k in 0..factors {
                let mut reg = tape.push(Op::Input(Port(k as u32)));
                for _ in 0..below(4) {
                    reg = tape.push(Op::Absolute(reg));
                }
                variables.push(Some((reg, tape.depth_of(reg))));
            }
            let ready: Vec<Option<usize>> = variables.iter().map(|variable| variable.map(|(_, ready)| ready)).collect();
            let (output, told) = Nest::new(&mut Written(&mut tape), &variables).value(&leaves, &levels);
            let counted = cost(&leaves, &levels, &ready);
            let tape = tape.finish("s", vec![], output);
            let of_the_sums = |op: &&Op| matches!(op, Op::Add(..) | Op::Subtract(..) | Op::Multiply(..) | Op::Negate(_));
            let written = Cost { operations: tape.ops.iter().filter(of_the_sums).count(), ready: tape.depth() };
            assert_eq!((counted, told), (written, written.ready), "{powers:?} {levels:?}");
        }
    }
}
