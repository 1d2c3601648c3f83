//! The encoder disc is eccentric.
//!
//! Formula      as angle-offset, with delta = e sin(theta)
//! Source       geometry of a disc mounted beside its centre; docs/book/src/reference/plants.md, section 3
//! Acts on      the frame of voltages and currents
//! Looks like   torque ripple of first order
//! Told apart   by its order: once per mechanical turn
//! Report says  "The encoder errs by {amplitude} once a turn."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "angle-eccentricity",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("amplitude", Unit::Is("rad"), Bound::Between(-std::f64::consts::PI, std::f64::consts::PI))
        .plausible(Plausible::Within(1.0))],
    sentence: "The encoder errs by {amplitude} once a turn.",
    check: "Check the concentricity of the encoder and its disc; the error must repeat once a mechanical turn at any speed and current.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct AngleEccentricity {
    amplitude: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(AngleEccentricity { amplitude: arguments.number("amplitude") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // Three degrees.
    vec![Guess::scaled(vec![0.05], 0.0)]
}

impl Effect for AngleEccentricity {
    fn frame_angle(&self, theta: f64) -> f64 {
        self.amplitude * theta.sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equation_plant::pmac;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: pmac(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn a_quarter_turn_is_the_crest() {
        let found = made(&[("amplitude", 0.05)]).frame_angle(std::f64::consts::FRAC_PI_2);
        assert!((found - 0.05).abs() < 1e-17);
    }
}
