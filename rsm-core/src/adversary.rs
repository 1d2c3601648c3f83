//! Searches for the point at which a tape has the largest error, relative to its certified bound. Used only by tests.
//!
//! In: a tape, a box, a bound. Out: the largest ratio of observed error to bound. Errors are exact: the interpreter's result minus the tape in
//! rational arithmetic. The search uses corners first, then random restarts with hill climbing from a seed.

use crate::exact;
use crate::number::{Precision, Rational, exact, integer};
use crate::run::Interpreter;
use crate::tape::Tape;

/// Random numbers from a seed: Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014), the finalizer of splitmix64.
#[derive(Debug)]
pub(crate) struct Random(pub u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.bits() % limit as u64) as usize
    }

    pub(crate) fn chance(&mut self, one_in: usize) -> bool {
        self.below(one_in) == 0
    }

    /// In [low, high], both included.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        let share = (self.bits() >> 11) as f64 / ((1u64 << 53) - 1) as f64;
        (low * (1.0 - share) + high * share).clamp(low, high)
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }
}

/// The numbers of a precision in [low, high] that are nearest to its ends.
pub(crate) fn inside(precision: Precision, [low, high]: [f64; 2]) -> [f64; 2] {
    [precision.round_up(&exact(low)), precision.round_down(&exact(high))]
}

/// A point at which `height` is large: from the corners, then from random points, by steps of a few units in the last place and of decreasing parts
/// of the sides.
pub(crate) fn climb(
    random: &mut Random,
    precision: Precision,
    ranges: &[[f64; 2]],
    effort: usize,
    mut height: impl FnMut(&[f64]) -> f64,
) -> (f64, Vec<f64>) {
    let sides: Vec<[f64; 2]> = ranges.iter().map(|range| inside(precision, *range)).collect();
    let of_type = |value: f64, [low, high]: [f64; 2]| precision.round(&exact(value.clamp(low, high))).clamp(low, high);
    let mut best = (f64::NEG_INFINITY, vec![]);
    for corner in 0..1usize << sides.len().min(6) {
        let point: Vec<f64> = sides.iter().enumerate().map(|(k, side)| side[corner >> k & 1]).collect();
        let found = height(&point);
        if found > best.0 {
            best = (found, point);
        }
    }
    let restarts = effort.isqrt().max(1);
    for _ in 0..restarts {
        let mut point: Vec<f64> = sides.iter().map(|side| of_type(random.between(side[0], side[1]), *side)).collect();
        let mut here = height(&point);
        for step in 0..effort / restarts {
            if sides.is_empty() {
                break;
            }
            let k = random.below(sides.len());
            let [low, high] = sides[k];
            let mut moved = point.clone();
            if random.chance(2) {
                for _ in 0..1 + random.below(4) {
                    let up = random.chance(2);
                    moved[k] = if up { precision.next_up(moved[k]) } else { precision.next_down(moved[k]) }.clamp(low, high);
                }
            } else {
                let part = (high - low) * 0.5f64.powi((step % 30) as i32);
                moved[k] = of_type(moved[k] + random.between(-1.0, 1.0) * part, sides[k]);
            }
            let there = height(&moved);
            if there >= here {
                (point, here) = (moved, there);
            }
        }
        if here > best.0 {
            best = (here, point);
        }
    }
    best
}

/// |tape - ideal| at a point; `None` if the result of the tape is not finite.
pub(crate) fn seen_error(tape: &Tape, point: &[f64]) -> Option<Rational> {
    let computed = match tape.precision {
        Precision::F64 => Interpreter::<f64>::new(tape).eval(point),
        Precision::F32 => {
            let narrow: Vec<f32> = point.iter().map(|xi| *xi as f32).collect();
            f64::from(Interpreter::<f32>::new(tape).eval(&narrow))
        }
    };
    let at: Vec<Rational> = point.iter().map(|xi| exact(*xi)).collect();
    let ideal = exact::ideal(tape, &at)?;
    computed.is_finite().then(|| magnitude(exact(computed) - ideal))
}

pub(crate) fn magnitude(value: Rational) -> Rational {
    if value < integer(0) { -value } else { value }
}

/// The largest ratio of observed error to bound that a search finds.
///
/// # Panics
/// If an error exceeds the bound; the message has the point and the tape.
pub(crate) fn worst_ratio(random: &mut Random, tape: &Tape, ranges: &[[f64; 2]], bound: f64, effort: usize) -> f64 {
    assert!(bound >= 0.0, "a bound is a number: {bound}\n{tape}");
    let ratio = |point: &[f64]| {
        if bound.is_infinite() {
            return 0.0;
        }
        let seen = seen_error(tape, point).unwrap_or_else(|| panic!("no finite number at {point:?}, bound {bound:e}\n{tape}"));
        let told = Precision::F64.round(&seen);
        assert!(seen <= exact(bound), "{told:e} seen at {point:?}, {bound:e} promised\n{tape}");
        // For very small numbers the error itself may not be an f64.
        if bound == 0.0 {
            0.0
        } else if bound < 1e-290 {
            Precision::F64.round(&(seen / exact(bound)))
        } else {
            told / bound
        }
    };
    climb(random, tape.precision, ranges, effort, ratio).0
}
