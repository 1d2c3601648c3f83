//! A brake that does not release.
//!
//! Formula      torque T tanh(w_w/w_s) against the rotation of the wheel, w_s = 1 rad/s as on every rotor
//! Source       C. A. Coulomb, 1785; docs/book/src/reference/plants.md, section 3
//! Acts on      effort at the wheel
//! Looks like   road grade, an error of rolling_resistance_1: they are identical while the car rolls forward
//! Told apart   by standstill or backward motion
//! Report says  "A brake drags with {torque}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, Guess, Motion, Plausible, ROTOR_SIGN_WIDTH, Scale, Subject, Survey,
    Unit, smooth_sign, smooth_sign_rate,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "brake-drag",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("torque", Unit::Is("N*m"), Bound::NotNegative).plausible(Plausible::Effort)],
    sentence: "A brake drags with {torque}.",
    check: "Jack the wheels up and turn them by hand, or measure the temperature of the brakes after driving without braking.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct BrakeDrag {
    torque: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(BrakeDrag { torque: arguments.number("torque") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A twentieth of the engine's torque at the wheel.
    vec![Guess::scaled(vec![0.05 * survey.effort], 0.0)]
}

impl Effect for BrakeDrag {
    fn effort(&self, motion: &Motion) -> f64 {
        -self.torque * smooth_sign(motion.speed, ROTOR_SIGN_WIDTH)
    }

    fn fastest_rate(&self, scale: &Scale) -> f64 {
        smooth_sign_rate(self.torque, ROTOR_SIGN_WIDTH, &Scale { drive_inertia: scale.vehicle.wheel.0, ..*scale })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn it_stands_against_the_rotation() {
        let brake = made(&[("torque", 80.0)]);
        for (speed, expected) in [(30.0, -80.0), (-30.0, 80.0), (0.0, 0.0)] {
            assert_eq!(brake.effort(&Motion { position: 0.0, speed, viscous_friction: 0.0 }), expected);
        }
    }
}
