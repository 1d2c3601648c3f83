//! The input has a wrong gain.
//!
//! Formula      gain u
//! Source       a wrong scale of an amplifier; docs/book/src/reference/plants.md, section 3
//! Acts on      the first input: both voltages, throttle, command
//! Looks like   an error of a gain of the plant
//! Told apart   not possible if the plant has its own gain in the same place
//! Report says  "The input acts {gain} times as strong as recorded."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Step, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "input-gain",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("gain", Unit::Is("1"), Bound::Any).plausible(Plausible::Factor).step(Step::PerCent)],
    sentence: "The input acts {gain} times as strong as recorded.",
    check: "Measure the input where it acts (terminal voltage, plate angle, force at rest) against what the record says.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct InputGain {
    gain: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(InputGain { gain: arguments.number("gain") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // Five per cent.
    vec![Guess::scaled(vec![1.05], 1.0)]
}

impl Effect for InputGain {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn input(&self, value: f64) -> f64 {
        self.gain * value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_input_is_multiplied() {
        assert_eq!(made(&[("gain", 0.5)]).input(3.0), 1.5);
    }
}
