//! Coulomb friction.
//!
//! Formula      resisting torque T_c tanh(w/w_s), w_s = 1 rad/s; force F_c tanh(v/v_s), v_s = 1 mm/s
//! Source       C. A. Coulomb, 1785; docs/book/src/reference/plants.md, section 3
//! Acts on      effort at the rotor; force on the carriage
//! Looks like   constant load in one direction of motion, stribeck friction at low speed
//! Told apart   by a record with both directions and a slow reversal
//! Report says  "A dry friction of {torque}{force} is missing from the model."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, Guess, Motion, Plausible, Scale, Subject, Survey, Unit, sign_width,
    smooth_sign, smooth_sign_rate,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "coulomb-friction",
    plants: &["pmac", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("torque", Unit::Is("N*m"), Bound::NotNegative).plausible(Plausible::Effort).on("pmac"),
        Argument::new("force", Unit::Is("N"), Bound::NotNegative).plausible(Plausible::Effort).on("servo-axis"),
    ],
    sentence: "A dry friction of {torque}{force} is missing from the model.",
    check: "Drive slowly both ways at constant speed: the effort must jump by twice this level at the reversal.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct CoulombFriction {
    level: f64,
    width: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(CoulombFriction { level: arguments.either("torque", "force"), width: sign_width(arguments.plant) })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A twentieth of the drive's effort.
    vec![Guess::scaled(vec![0.05 * survey.effort], 0.0)]
}

impl Effect for CoulombFriction {
    fn effort(&self, motion: &Motion) -> f64 {
        -self.level * smooth_sign(motion.speed, self.width)
    }

    // Its steepest slope in the span (T_c/w_s at rest), divided by the inertia.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        smooth_sign_rate(self.level, self.width, scale)
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
    fn it_opposes_motion_in_both_directions() {
        let friction = made(&[("torque", 0.35)]);
        // At w_s the factor is tanh(1) = 0.76159; far from rest it is 1.
        for (speed, expected) in [(1.0, -0.35 * 0.7615941559557649), (-100.0, 0.35), (0.0, 0.0)] {
            let found = friction.effort(&Motion { position: 0.0, speed, viscous_friction: 0.0 });
            assert!((found - expected).abs() < 1e-15, "{found} at {speed}");
        }
    }
}
