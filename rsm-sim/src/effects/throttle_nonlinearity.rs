//! The throttle plate is not linear.
//!
//! Formula      throttle^n replaces throttle
//! Source       flow through a plate, approximated by a power; docs/book/src/reference/plants.md, section 3
//! Acts on      the throttle
//! Looks like   an error of the torque map at part load
//! Told apart   by records with several throttle openings
//! Report says  "The throttle acts with the power {exponent}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "throttle-nonlinearity",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("exponent", Unit::Is("1"), Bound::Positive).plausible(Plausible::Factor)],
    sentence: "The throttle acts with the power {exponent}.",
    check: "Measure torque or air mass at several throttle openings at one engine speed.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct ThrottleNonlinearity {
    exponent: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ThrottleNonlinearity { exponent: arguments.number("exponent") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // An exponent that differs by a tenth from the linear case.
    vec![Guess::scaled(vec![1.1], 1.0)]
}

impl Effect for ThrottleNonlinearity {
    fn acts_between_rows(&self) -> bool {
        false
    }

    // A recorded throttle can be negative because of noise; it is treated as closed.
    fn input(&self, value: f64) -> f64 {
        value.max(0.0).powf(self.exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn half_the_throttle_squared_is_a_quarter() {
        let throttle = made(&[("exponent", 2.0)]);
        assert_eq!([throttle.input(0.5), throttle.input(1.0), throttle.input(-1e-3)], [0.25, 1.0, 0.0]);
    }
}
