//! The engine torque ripples with the strokes.
//!
//! Formula      T_e (1 + h sin(3 th_e))
//! Source       J. B. Heywood, Internal Combustion Engine Fundamentals, 1988 (six cylinders, four strokes: three a turn);
//!              docs/book/src/reference/plants.md, section 3
//! Acts on      the torque of the engine
//! Looks like   torque noise of third order
//! Told apart   by its order: three times per turn
//! Report says  "The engine torque ripples by {amplitude} three times a turn."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Scale, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "combustion-ripple",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("amplitude", Unit::Is("1"), Bound::NotNegative)],
    sentence: "The engine torque ripples by {amplitude} three times a turn.",
    check: "Compare with a motored engine: the ripple must vanish with fuel cut off.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct CombustionRipple {
    amplitude: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(CombustionRipple { amplitude: arguments.number("amplitude") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // One tenth.
    vec![Guess::scaled(vec![0.1], 0.0)]
}

impl Effect for CombustionRipple {
    // A quarter of the ripple's frequency of three periods per crank turn. The ripple is an excitation without feedback, so a step is a quadrature;
    // the error of Simpson's rule over one radian of the ripple is 1/2880.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        0.25 * 3.0 * scale.vehicle.crank_speed.abs()
    }

    fn engine_torque(&self, torque: f64, crank_angle: f64) -> f64 {
        torque * (1.0 + self.amplitude * (3.0 * crank_angle).sin())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_crest_is_at_a_sixth_of_half_a_turn() {
        let ripple = made(&[("amplitude", 0.2)]);
        let found = ripple.engine_torque(100.0, std::f64::consts::PI / 6.0);
        assert!((found - 120.0).abs() < 1e-12);
    }
}
