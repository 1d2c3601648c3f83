//! A sensor with a wrong zero point.
//!
//! Formula      reading = true value + bias
//! Source       calibration; docs/book/src/reference/plants.md, section 3
//! Acts on      a named output
//! Looks like   a wrong start of the record
//! Told apart   by a known state at rest
//! Report says  "The sensor of {output} reads {bias} too much."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "sensor-bias",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Output,
    at: None,
    arguments: &[Argument::new("bias", Unit::OfSubject, Bound::Any).plausible(Plausible::Reading)],
    sentence: "The sensor of {output} reads {bias} too much.",
    check: "Read the sensor at a known rest, before and after a record.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct SensorBias {
    output: usize,
    bias: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(SensorBias { output: arguments.output(), bias: arguments.number("bias") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A twentieth of the spread of the readings.
    vec![Guess::scaled(vec![0.05 * survey.spread[survey.output]], 0.0)]
}

impl Effect for SensorBias {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn reads(&self, output: usize, value: f64, _time: f64, _own: &[f64], _rates: &mut [f64]) -> f64 {
        if output == self.output { value + self.bias } else { value }
    }

    fn truth(&self, output: usize, reading: f64, _time: f64) -> f64 {
        if output == self.output { reading - self.bias } else { reading }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: Some("position".to_string()), numbers: numbers.to_vec() })
    }

    #[test]
    fn it_reads_more_and_goes_back() {
        let sensor = made(&[("bias", 0.5)]);
        assert_eq!(sensor.reads(0, 4.0, 0.0, &[], &mut []), 4.5);
        assert_eq!(sensor.truth(0, 4.5, 0.0), 4.0);
    }
}
