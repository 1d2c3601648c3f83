//! Whether numbers of a model fit into a precision.
//!
//! In: a number, a sigmoid, a ratio, a precision. Out: yes or no, and words for no. Reports no fault itself.

use num_traits::Signed as _;

use crate::model::{Compensator, Input, Model, Sigmoid, Surface};
use crate::number::{Precision, Rational, exact, power_of_two};

pub(super) fn schedule(model: &Model, compensator: &Compensator) -> Vec<Input> {
    let used: Vec<&Surface> = compensator.surfaces().filter_map(|name| model.surface(name)).collect();
    let is_used = |input: &&Input| used.iter().any(|surface| surface.inputs.contains(&input.name));
    model.inputs.iter().filter(is_used).cloned().collect()
}

/// Whether a precision can represent the constants that lowering makes from a fixed number of a compensator. The largest is 1 + g (g + 2 p) < 4 p for
/// large p, because g is below pi/4; the smallest is half of it.
pub(super) fn fits_fixed(precision: Precision, value: f64) -> bool {
    let largest = precision.round(&(exact(value) * exact(4.0)));
    largest.is_finite() && precision.round(&(exact(value) / exact(2.0))) != 0.0
}

/// Whether a precision can represent the squares in a sigmoid for every argument in the range.
pub(super) fn fits_sigmoid(precision: Precision, sigmoid: &Sigmoid, range: [f64; 2]) -> bool {
    let width = exact(sigmoid.width);
    let reach = range.map(|end| (exact(end) - exact(sigmoid.at)).abs() + &width);
    let smallest = precision.smallest_exponent() + precision.significand_bits() - 1;
    let holds = |square: Rational| precision.round(&square).is_finite();
    reach.iter().all(|reach| holds(reach * reach * exact(2.0))) && precision.round(&(&width * &width)) >= power_of_two(smallest)
}

/// The index of `pole_frequency` in [`Compensator::parts`].
pub(super) const POLE_FREQUENCY: usize = 3;

/// Whether a precision can represent the square of the ratio of two fixed frequencies, which is a constant on the tape.
pub(super) fn fits_ratio(precision: Precision, compensator: &Compensator) -> bool {
    let own = compensator.pole_frequency.as_ref().and_then(|scheduled| scheduled.fixed());
    let (Some(poles), Some(zeros)) = (own, compensator.natural_frequency.fixed()) else { return true };
    if poles <= 0.0 || zeros <= 0.0 {
        return true; // reported already
    }
    let ratio = exact(poles) / exact(zeros);
    precision.round(&(&ratio * &ratio)).is_finite()
}

pub(super) fn beyond_ratio(compensator: &Compensator, precision: &str) -> String {
    format!(
        "compensator `{}`: `pole_frequency`: its square over that of `natural_frequency` is {BEYOND} {precision}",
        compensator.name
    )
}

/// The message for a number that does not fit.
pub(super) const BEYOND: &str = "too large or too small for";
