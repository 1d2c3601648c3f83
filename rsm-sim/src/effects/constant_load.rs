//! A load that is not in the record: gravity, a spring balance.
//!
//! Formula      T (or F) is added to the load, positive against forward motion
//! Source       statics; docs/book/src/reference/plants.md, section 3
//! Acts on      the load: behind a joint, if an effect adds one
//! Looks like   coulomb friction in one direction, a bias of the input
//! Told apart   by a record with both directions
//! Report says  "A constant load of {torque}{force} is missing from the record."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "constant-load",
    plants: &["pmac", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("torque", Unit::Is("N*m"), Bound::Any).plausible(Plausible::Effort).on("pmac"),
        Argument::new("force", Unit::Is("N"), Bound::Any).plausible(Plausible::Effort).on("servo-axis"),
    ],
    sentence: "A constant load of {torque}{force} is missing from the record.",
    check: "Hold the drive at rest in several positions and read the effort; look for gravity, springs, hoses and unrecorded loads.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct ConstantLoad {
    load: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ConstantLoad { load: arguments.either("torque", "force") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A twentieth of the drive's effort.
    vec![Guess::scaled(vec![0.05 * survey.effort], 0.0)]
}

impl Effect for ConstantLoad {
    fn load(&self, _own: &[f64], _rates: &mut [f64]) -> f64 {
        self.load
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn it_is_the_load_whatever_the_motion() {
        assert_eq!(made(&[("force", -3.2)]).load(&[], &mut []), -3.2);
    }
}
