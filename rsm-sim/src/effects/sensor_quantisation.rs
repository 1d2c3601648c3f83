//! A sensor that rounds its readings.
//!
//! Formula      reading = step round(true value/step)
//! Source       B. Widrow, 1956 (rounding as noise); docs/book/src/reference/plants.md, section 3
//! Acts on      a named output
//! Looks like   noise
//! Told apart   by readings that are multiples of a step
//! Report says  "The sensor of {output} rounds to multiples of {step}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Role, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "sensor-quantisation",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Output,
    at: None,
    arguments: &[Argument::new("step", Unit::OfSubject, Bound::Positive)],
    sentence: "The sensor of {output} rounds to multiples of {step}.",
    check: "Look up the resolution of the sensor and of the log, and take a finer one where control needs it.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::role(Role::Rounding),
};

struct SensorQuantisation {
    output: usize,
    step: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(SensorQuantisation { output: arguments.output(), step: arguments.number("step") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // The quantum of the readings, if they are integer multiples of one. Otherwise steps near the noise level, because noise hides smaller steps.
    let noise = survey.noise[survey.output];
    match survey.quantum[survey.output] {
        Some(step) => vec![Guess::at(vec![step])],
        None => [2.0, 3.0, 4.5, 7.0, 10.0, 15.0].iter().map(|share| Guess::at(vec![share * noise])).collect(),
    }
}

impl Effect for SensorQuantisation {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn reads(&self, output: usize, value: f64, _time: f64, _own: &[f64], _rates: &mut [f64]) -> f64 {
        if output == self.output { self.step * (value / self.step).round() } else { value }
    }

    // The inverse hook `truth` has its default, the reading itself: the rounding error cannot be recovered.
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: Some("position".to_string()), numbers: numbers.to_vec() })
    }

    #[test]
    fn it_reads_the_nearest_multiple() {
        let sensor = made(&[("step", 0.25)]);
        assert_eq!(sensor.reads(0, 0.9, 0.0, &[], &mut []), 1.0);
        assert_eq!(sensor.reads(0, -0.1, 0.0, &[], &mut []).abs(), 0.0);
    }
}
