//! A sensor with a first-order lag.
//!
//! Formula      T dy/dt = x - y, the reading is y; in steady state at the start
//! Source       first-order low-pass; docs/book/src/reference/plants.md, section 3
//! Acts on      a named output
//! Looks like   input delay
//! Told apart   by another output without lag
//! Report says  "The sensor of {output} lags with a time constant of {time_constant}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Role, Scale, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "sensor-lag",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Output,
    at: None,
    arguments: &[Argument::new("time_constant", Unit::Is("s"), Bound::Positive).plausible(Plausible::ShareOfRecord)],
    sentence: "The sensor of {output} lags with a time constant of {time_constant}.",
    check: "Compare the sensor with a faster one on one step; look for a filter in its electronics or in the log.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::role(Role::ReadingLag),
};

struct SensorLag {
    output: usize,
    time_constant: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(SensorLag { output: arguments.output(), time_constant: arguments.number("time_constant") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Time constants of one, four and fifteen sample periods.
    [1.0, 4.0, 15.0].iter().map(|periods| Guess::at(vec![periods * survey.period])).collect()
}

impl Effect for SensorLag {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn states(&self) -> usize {
        1
    }

    fn settle(&self, outputs: &[f64; 3], own: &mut [f64]) {
        own[0] = outputs[self.output];
    }

    fn fastest_rate(&self, _scale: &Scale) -> f64 {
        1.0 / self.time_constant
    }

    fn nonlinear_rate(&self, _scale: &Scale) -> f64 {
        0.0
    }

    fn reads_with_memory(&self) -> bool {
        true
    }

    fn reads(&self, output: usize, value: f64, _time: f64, own: &[f64], rates: &mut [f64]) -> f64 {
        if output != self.output {
            return value;
        }
        rates[0] = (value - own[0]) / self.time_constant;
        own[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: Some("position".to_string()), numbers: numbers.to_vec() })
    }

    #[test]
    fn it_follows_with_its_time_constant() {
        let sensor = made(&[("time_constant", 0.5)]);
        let mut rates = [0.0];
        // The true value is 3 m and the reading 2 m: (3 - 2)/0.5 = 2 m/s.
        assert_eq!(sensor.reads(0, 3.0, 0.0, &[2.0], &mut rates), 2.0);
        assert_eq!(rates, [2.0]);
        let mut own = [0.0];
        sensor.settle(&[7.0, 0.0, 0.0], &mut own);
        assert_eq!(own, [7.0]);
    }
}
