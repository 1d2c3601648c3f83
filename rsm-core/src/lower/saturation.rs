//! Finds which bounds of `output_range` are needed on a tape: those that some argument could reach.
//!
//! In: a surface and its inputs, its tape without the clamp. Out: an enclosure of every value of that tape, and the result for each bound. A bound
//! that no value exceeds is left out. This changes no bit, because such a clamp returns every value unchanged, including a NaN.
//!
//! The enclosure is that of the true polynomial (`range.rs`), widened by the bound of the tape's rounding error (`rounding.rs`). Both are valid for
//! arguments in the box. An input that clamps moves every argument into it, including an infinity. An odd input only changes the sign, which the
//! enclosure includes. An input that extrapolates does not, so a surface with such an input keeps its clamp.

use crate::interval::Interval;
use crate::model::{Input, Surface};
use crate::number::{Precision, decimal, exact};
use crate::range;
use crate::rounding;
use crate::tape::Tape;

use super::is_clamped;

/// The bounds of `output_range` on a tape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saturation {
    /// The bounds in the model.
    pub bounds: [f64; 2],
    /// Whether the lower bound is on the tape.
    pub below: bool,
    /// Whether the upper bound is on the tape.
    pub above: bool,
    /// Contains every value of the tape before its clamp, for every argument of the type except NaN. `None` if it was not computed, because an input
    /// extrapolates or because the true polynomial reaches both bounds.
    pub values: Option<Interval>,
}

impl Saturation {
    /// `tape`: that of the surface, without a clamp.
    pub(super) fn of(surface: &Surface, inputs: &[Input], bounds: [f64; 2], tape: &Tape) -> Self {
        let both = Saturation { bounds, below: true, above: true, values: None };
        let precision = tape.precision;
        if !inputs.iter().all(is_clamped) {
            return both;
        }
        let [low, high] = inward(bounds, precision);
        let truth = range::range(surface, inputs);
        if truth.low < low && truth.high > high {
            return both;
        }
        let ranges: Vec<[f64; 2]> = inputs.iter().map(|input| input.range).collect();
        let error = rounding::error_bound(tape, &ranges);
        if !error.is_finite() {
            return both;
        }
        // mutant `+ to -`: the interval of the errors is symmetric.
        let values = truth + Interval::new(-error, error);
        Saturation { bounds, below: values.low < low, above: values.high > high, values: Some(values) }
    }

    /// The bounds of the result, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let [low, high] = self.bounds.map(decimal);
        match (self.below, self.above) {
            (true, true) => format!("The result saturates at {low} and {high}."),
            (true, false) => format!("The result saturates at {low}; no argument takes it above {high}."),
            (false, true) => format!("The result saturates at {high}; no argument takes it below {low}."),
            (false, false) => format!("No argument takes the result below {low} or above {high}: it needs no clamp."),
        }
    }
}

/// Bounds rounded inward, so that a clamped result is never outside the range.
pub(super) fn inward([low, high]: [f64; 2], precision: Precision) -> [f64; 2] {
    [precision.round_up(&exact(low)), precision.round_down(&exact(high))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_rounded_into_their_range_to_the_nearest_number() {
        for [low, high] in [[0.1, 0.9], [-0.9, -0.1], [-0.1, 0.1]] {
            let [inner_low, inner_high] = inward([low, high], Precision::F32);
            let number = |value: f64| f64::from(value as f32) == value;
            assert!(number(inner_low) && number(inner_high) && low <= inner_low && inner_high <= high);
            assert!(Precision::F32.next_down(inner_low) < low && high < Precision::F32.next_up(inner_high));
            assert_eq!(inward([low, high], Precision::F64), [low, high]);
        }
    }
}
