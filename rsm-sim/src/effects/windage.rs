//! Air drag in the air gap and on the fan.
//!
//! Formula      resisting torque c w abs(w)
//! Source       quadratic drag, I. Newton, 1687; docs/book/src/reference/plants.md, section 3
//! Acts on      effort at the rotor
//! Looks like   viscous friction over a narrow range of speed
//! Told apart   by a run-up to high speed: it grows with the square of the speed
//! Report says  "Windage of {coefficient} is missing from the model."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Motion, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "windage",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("coefficient", Unit::Is("N*m*s^2/rad^2"), Bound::NotNegative).plausible(Plausible::EffortPerSpeedSquared)
    ],
    sentence: "Windage of {coefficient} is missing from the model.",
    check: "Coast down from high speed without current: the deceleration must grow with the square of the speed.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct Windage {
    coefficient: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(Windage { coefficient: arguments.number("coefficient") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A twentieth of the drive's effort, at the typical speed.
    vec![Guess::scaled(vec![0.05 * survey.effort / (survey.speed * survey.speed)], 0.0)]
}

impl Effect for Windage {
    fn effort(&self, motion: &Motion) -> f64 {
        -self.coefficient * motion.speed * motion.speed.abs()
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
    fn it_grows_with_the_square_of_the_speed() {
        let windage = made(&[("coefficient", 2e-6)]);
        // The torque is 2e-6 * 500^2 = 0.5 N m against the motion.
        for (speed, expected) in [(500.0, -0.5), (-500.0, 0.5)] {
            assert_eq!(windage.effort(&Motion { position: 0.0, speed, viscous_friction: 0.0 }), expected);
        }
    }
}
