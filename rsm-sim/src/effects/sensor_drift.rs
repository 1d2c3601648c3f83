//! A sensor whose zero point drifts.
//!
//! Formula      reading = true value + rate t; t is the time of the record
//! Source       calibration; docs/book/src/reference/plants.md, section 3
//! Acts on      a named output
//! Looks like   a slow change of the plant
//! Told apart   by a record that ends in the state in which it began
//! Report says  "The sensor of {output} drifts by {rate}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "sensor-drift",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Output,
    at: None,
    arguments: &[Argument::new("rate", Unit::OfSubjectPerSecond, Bound::Any).plausible(Plausible::ReadingPerRecord)],
    sentence: "The sensor of {output} drifts by {rate}.",
    check: "Read the sensor at a known rest at the beginning and at the end of a long record.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct SensorDrift {
    output: usize,
    rate: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(SensorDrift { output: arguments.output(), rate: arguments.number("rate") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A change of a twentieth of the spread of the readings over the record.
    vec![Guess::scaled(vec![0.05 * survey.spread[survey.output] / survey.duration], 0.0)]
}

impl Effect for SensorDrift {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn reads(&self, output: usize, value: f64, time: f64, _own: &[f64], _rates: &mut [f64]) -> f64 {
        if output == self.output { value + self.rate * time } else { value }
    }

    fn truth(&self, output: usize, reading: f64, time: f64) -> f64 {
        if output == self.output { reading - self.rate * time } else { reading }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: Some("position".to_string()), numbers: numbers.to_vec() })
    }

    #[test]
    fn it_reads_more_and_more() {
        let sensor = made(&[("rate", 0.01)]);
        assert_eq!(sensor.reads(0, 1.0, 50.0, &[], &mut []), 1.5);
        assert_eq!(sensor.truth(0, 1.5, 50.0), 1.0);
    }
}
