//! A load that changes with time: a belt or a preload that warms up, a drive whose zero point drifts.
//!
//! Formula      rate t is added to the load, positive against forward motion; t is the time of the record
//! Source       measured on the EMPS axis (A. Janot, M. Gautier, M. Brunot, 2019); docs/book/src/reference/plants.md, section 3
//! Acts on      the load: behind a joint, if an effect adds one
//! Looks like   a sensor that drifts, friction that changes with the temperature
//! Told apart   by a record with both directions: friction changes its sign with the motion
//! Report says  "A load that is not in the record grows by {torque_rate}{force_rate}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, FirstInstant, Guess, Plausible, Subject, Survey, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "load-drift",
    plants: &["pmac", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("torque_rate", Unit::Is("N*m/s"), Bound::Any).plausible(Plausible::EffortPerRecord).on("pmac"),
        Argument::new("force_rate", Unit::Is("N/s"), Bound::Any).plausible(Plausible::EffortPerRecord).on("servo-axis"),
    ],
    sentence: "A load that is not in the record grows by {torque_rate}{force_rate}.",
    check: "Drive the same motion both ways at the beginning and at the end of an hour and compare the efforts: half their difference is the load.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct LoadDrift {
    rate: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(LoadDrift { rate: arguments.either("torque_rate", "force_rate") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A change of a twentieth of the drive's effort over the record.
    vec![Guess::scaled(vec![0.05 * survey.effort / survey.duration], 0.0)]
}

impl Effect for LoadDrift {
    // One state: the time.
    fn states(&self) -> usize {
        1
    }

    fn start(&self, start: &FirstInstant, own: &mut [f64]) {
        own[0] = start.time;
    }

    fn load(&self, own: &[f64], rates: &mut [f64]) -> f64 {
        rates[0] = 1.0;
        self.rate * own[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_grows_with_the_time() {
        let load = build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: None, numbers: vec![("force_rate", -0.02)] });
        let mut rates = [0.0];
        assert_eq!((load.load(&[50.0], &mut rates), rates), (-1.0, [1.0]));
    }
}
