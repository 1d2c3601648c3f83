//! The classical Runge-Kutta method of fourth order (M. W. Kutta, 1901), which meets a change of law when it happens.
//!
//! In: a system, its state with the rates there, a step. Out: the state a step later. The laws of joints keep their pieces for the whole step, also a little
//! beyond their ends; where the state at the end belongs to other pieces, the crossing is located on the cubic through both ends, the step is
//! taken up to it, and the rest under the new pieces. Never takes a stage across a kink.

use super::{System, Work};
use crate::plants::Plant;

/// Halvings that place a crossing: 1e-6 of a step, as exact as the cubic itself (a step of a quarter of a radian leaves 0.25^4/384, 1e-5).
const HALVINGS: usize = 20;

/// Crossings in one step; what turns back oftener is chatter between two laws, and the rest of the step is taken under one of them.
const MOST_CROSSINGS: usize = 8;

/// What is left of a step after a crossing is not taken when it is this share of the step: rounding.
const NOTHING: f64 = 1e-9;

/// One step under the pieces that are held; the rates at its start are in place.
pub(super) fn advance<P: Plant>(system: &System<'_, P>, work: &mut Work, held: Option<u32>, time: f64, step: f64) {
    for (k, share) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
        let Work { x, trial, k: rates, outputs, .. } = &mut *work;
        for ((trial, x), rate) in trial.iter_mut().zip(x.iter()).zip(&rates[k - 1]) {
            *trial = x + share * step * rate;
        }
        system.rates(held, time + share * step, trial, &mut rates[k], outputs);
    }
    let Work { x, k: [a, b, c, d], .. } = &mut *work;
    for ((((x, a), b), c), d) in x.iter_mut().zip(&*a).zip(&*b).zip(&*c).zip(&*d) {
        *x += step / 6.0 * (a + 2.0 * (b + c) + d);
    }
}

/// One step in which pieces may change; from and to a state with its rates in place. Answers the pieces at the end.
pub(super) fn across<P: Plant>(system: &System<'_, P>, work: &mut Work, pieces: u32, time: f64, step: f64) -> u32 {
    let (mut pieces, mut time, mut left) = (pieces, time, step);
    for _ in 0..MOST_CROSSINGS {
        work.before.copy_from_slice(&work.x);
        work.first.copy_from_slice(&work.k[0]);
        advance(system, work, Some(pieces), time, left);
        let next = system.rates_here(Some(pieces), time + left, work);
        if next == pieces {
            return pieces;
        }
        let (share, beyond) = crossing(system, work, pieces, next, time, left);
        work.x.copy_from_slice(&work.before);
        work.k[0].copy_from_slice(&work.first);
        advance(system, work, Some(pieces), time, share * left);
        pieces = beyond;
        time += share * left;
        left *= 1.0 - share;
        system.rates_here(Some(pieces), time, work);
        if left <= NOTHING * step {
            return pieces;
        }
    }
    advance(system, work, Some(pieces), time, left);
    system.rates_here(None, time + left, work)
}

/// The share of the step after which other pieces are at work, and which.
fn crossing<P: Plant>(system: &System<'_, P>, work: &mut Work, held: u32, next: u32, time: f64, step: f64) -> (f64, u32) {
    let Work { x, before, first, trial, k: [last, scratch, ..], outputs, .. } = &mut *work;
    let (mut low, mut high, mut beyond) = (0.0, 1.0, next);
    for _ in 0..HALVINGS {
        let s = 0.5 * (low + high);
        // Hermite's cubic through states and rates at both ends.
        let (start, end) = ((1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), s * s * (3.0 - 2.0 * s));
        let (leave, arrive) = (step * s * (1.0 - s) * (1.0 - s), -step * s * s * (1.0 - s));
        for (i, trial) in trial.iter_mut().enumerate() {
            *trial = start * before[i] + end * x[i] + leave * first[i] + arrive * last[i];
        }
        let found = system.rates(Some(held), time + s * step, trial, scratch, outputs);
        if found == held {
            low = s;
        } else {
            (high, beyond) = (s, found);
        }
    }
    (high, beyond)
}
