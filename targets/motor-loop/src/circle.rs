//! Sine and cosine, which `core` does not have, from the surface of `generated/coefficients/circle.toml`; and the second coordinate of a point on the
//! unit circle by a square root.
//!
//! In: an angle in turns, or the square of one coordinate (a leg). Out: sine and cosine with the error that the coefficient file states, or the other
//! leg. No table, no loop, no branch, and the same bits in C.

use branch_free::{magnitude, root};

rsm_macros::include_model!("../../generated/coefficients/circle.toml", precision = "f32");

/// 1.5 * 2^23. A sum with it is rounded to an integer, because all numbers from 2^23 to 2^24 are integers; the difference afterwards is exact. This
/// rounds half to even and is valid for magnitudes up to 2^22 (Goldberg, "What every computer scientist should know", 1991, describes it).
pub(crate) const WHOLE: f32 = 12_582_912.0;

/// With a longer leg than this the other leg is less than sqrt(0.1) = 0.32. sqrt(0.9), rounded down so that its square is at most 0.9.
pub(crate) const LONGEST_LEG: f32 = 0.948_683_2;

/// Cosine and sine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Cosine.
    pub cos: f32,
    /// Sine.
    pub sin: f32,
}

impl Direction {
    /// The direction of an angle in turns, up to 2^22 turns either way. The error is that of the angle, up to 2^-24 of its magnitude, times 2 pi,
    /// plus 1.0e-6. Beyond 2^22 the numbers are still in [-1, 1] but have no meaning; NaN and infinities give NaN.
    #[inline(always)]
    #[must_use]
    pub fn of_turns(turns: f32) -> Self {
        Direction { cos: cosine(turns), sin: cosine(turns - 0.25) }
    }
}

/// With r, the angle without its whole turns, in [-1/2, 1/2]: cos(2 pi r) = sin(pi/2 (1 - 4 |r|)), whose argument is in [-1, 1].
#[inline(always)]
fn cosine(turns: f32) -> f32 {
    let whole = (turns + WHOLE) - WHOLE;
    circle::sine_f32(1.0 - 4.0 * magnitude(turns - whole))
}

/// The square of the circle's radius, slightly reduced, so that the roundings of both legs (about six of 6e-8 each) do not leave the circle.
/// `rsm check --limits` proves this, in fewer steps if the radius is reduced more.
const HELD_BACK: f32 = 0.9996;

/// The largest length of the other leg in a circle of radius 1, from the square of one leg, up to 0.9: never more than sqrt(1 - square), and at most
/// 6.4e-4 less. NaN above [`HELD_BACK`].
#[inline(always)]
pub(crate) fn other_leg(square: f32) -> f32 {
    root(HELD_BACK - square)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    #[test]
    fn sine_and_cosine_hold_over_many_turns() {
        for k in -40_000..=40_000i32 {
            let turns = k as f32 / 7919.0;
            let Direction { cos, sin } = Direction::of_turns(turns);
            let (true_sin, true_cos) = (f64::from(turns) * std::f64::consts::TAU).sin_cos();
            // The polynomial's error of 6.0e-7 (see the coefficient file), about six roundings of numbers up to 1.6 (6e-8 each), and the rounding of
            // `turns - 0.25`: half a unit of 5 turns, 2.4e-7 turns.
            let tolerance = 1.0e-6 + 2.4e-7 * std::f64::consts::TAU;
            let error = (f64::from(sin) - true_sin).abs().max((f64::from(cos) - true_cos).abs());
            assert!(error <= tolerance, "{turns} turns: {error:e}");
        }
    }

    #[test]
    fn the_quarter_turns_are_exact_enough_to_stand_on() {
        for (turns, cos, sin) in [(0.0, 1.0, 0.0), (0.25, 0.0, 1.0), (-0.25, 0.0, -1.0), (0.5, -1.0, 0.0), (3.0, 1.0, 0.0)] {
            let found = Direction::of_turns(turns);
            assert!((found.cos - cos).abs() < 1.0e-6 && (found.sin - sin).abs() < 1.0e-6, "{turns}: {found:?}");
        }
    }

    #[test]
    fn every_number_gives_a_direction_in_the_square_and_nothing_else_does() {
        for turns in [0.0, -0.0, 1e-45, 4.0e6, -4.0e6, 1e7, 3e30, f32::MAX, f32::MIN] {
            let Direction { cos, sin } = Direction::of_turns(turns);
            assert!(cos.abs() <= 1.000_001 && sin.abs() <= 1.000_001, "{turns}: {cos} {sin}");
        }
        for turns in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let Direction { cos, sin } = Direction::of_turns(turns);
            assert!(cos.is_nan() && sin.is_nan());
        }
    }

    #[test]
    fn the_other_leg_never_leaves_the_circle() {
        for k in 0..=90_000u32 {
            let square = k as f32 / 100_000.0;
            let leg = f64::from(other_leg(square));
            let longest = (1.0 - f64::from(square)).sqrt();
            // 4e-4/(2 sqrt 0.1).
            assert!(leg <= longest && leg > longest - 6.4e-4, "{square}: {leg} {longest}");
        }
        assert!(other_leg(5.0).is_nan() && other_leg(f32::NAN).is_nan());
        assert!(f64::from(LONGEST_LEG).powi(2) <= 0.9);
    }
}
