//! A sensor with a wrong gain.
//!
//! Formula      reading = gain times true value
//! Source       calibration; docs/book/src/reference/plants.md, section 3
//! Acts on      a named output
//! Looks like   an error of a parameter that scales the same output
//! Told apart   by other outputs that measure the same quantity
//! Report says  "The sensor of {output} reads {gain} times the truth."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Role, Step, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "sensor-gain",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Output,
    at: None,
    arguments: &[Argument::new("gain", Unit::Is("1"), Bound::Positive).plausible(Plausible::FactorOrUnit).step(Step::PerCent)],
    sentence: "The sensor of {output} reads {gain} times the truth.",
    check: "Compare the sensor with a second one, or with a known distance, speed or current.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::role(Role::ReadingGain),
};

struct SensorGain {
    output: usize,
    gain: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(SensorGain { output: arguments.output(), gain: arguments.number("gain") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // Five per cent.
    vec![Guess::scaled(vec![1.05], 1.0)]
}

impl Effect for SensorGain {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn reads(&self, output: usize, value: f64, _time: f64, _own: &[f64], _rates: &mut [f64]) -> f64 {
        if output == self.output { self.gain * value } else { value }
    }

    fn truth(&self, output: usize, reading: f64, _time: f64) -> f64 {
        if output == self.output { reading / self.gain } else { reading }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: Some("position".to_string()), numbers: numbers.to_vec() })
    }

    #[test]
    fn it_reads_a_multiple_and_goes_back() {
        let sensor = made(&[("gain", 1.25)]);
        assert_eq!(sensor.reads(0, 4.0, 0.0, &[], &mut []), 5.0);
        assert_eq!(sensor.reads(1, 4.0, 0.0, &[], &mut []), 4.0);
        assert_eq!(sensor.truth(0, 5.0, 0.0), 4.0);
    }
}
