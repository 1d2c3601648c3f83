//! The encoder is mounted with an angular offset.
//!
//! Formula      the true quantities are x_d = cos(delta) rec_d - sin(delta) rec_q, x_q = sin(delta) rec_d + cos(delta) rec_q
//! Source       the rotation of (19); docs/book/src/reference/plants.md, section 3
//! Acts on      the frame of voltages and currents
//! Looks like   an error of the flux linkage if i_d is 0
//! Told apart   by currents on both axes
//! Report says  "The recorded frame is turned by {angle}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "angle-offset",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("angle", Unit::Is("rad"), Bound::Between(-std::f64::consts::PI, std::f64::consts::PI))
        .plausible(Plausible::Within(std::f64::consts::FRAC_PI_2))],
    sentence: "The recorded frame is turned by {angle}.",
    check: "Align the encoder again: turn the rotor from outside with open terminals, the back-EMF must stand on the q axis alone.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct AngleOffset {
    angle: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(AngleOffset { angle: arguments.number("angle") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // Three degrees.
    vec![Guess::scaled(vec![0.05], 0.0)]
}

impl Effect for AngleOffset {
    fn frame_angle(&self, _theta: f64) -> f64 {
        self.angle
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
    fn the_frame_is_turned_by_the_angle_everywhere() {
        let offset = made(&[("angle", 0.1)]);
        assert_eq!([offset.frame_angle(0.0), offset.frame_angle(7.0)], [0.1, 0.1]);
    }
}
