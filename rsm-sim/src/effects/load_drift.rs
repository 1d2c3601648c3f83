//! A load that grows or falls as time goes by: a belt or a preload that warms, a drive whose zero wanders.
//!
//! Formula      the load gains rate t, t the time of the record, positive against forward motion
//! Source       measured on the EMPS axis (A. Janot, M. Gautier, M. Brunot, 2019); docs/book/src/reference/plants.md, section 3
//! Acts on      the load: behind a joint, where an effect puts one
//! Looks like   a sensor that drifts, friction that changes as it warms
//! Told apart   by a record with both directions: friction changes its sign with the motion
//! Report says  "A load that is not in the record grows by {torque_rate}{force_rate}."
//!
//! In: its arguments. Out: what its hooks change. Never changes anything else.

use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, FirstInstant, Guess, Plausible, Subject, Survey, Unit,
};
use crate::kind::PlantKind;
use crate::schema::Bound;

/// What a file and a report may know of it.
pub const DESCRIPTION: Description = Description {
    kind: "load-drift",
    plants: &[PlantKind::Pmac, PlantKind::ServoAxis],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("torque_rate", Unit::Is("N*m/s"), Bound::Any).plausible(Plausible::EffortPerRecord).on(PlantKind::Pmac),
        Argument::new("force_rate", Unit::Is("N/s"), Bound::Any).plausible(Plausible::EffortPerRecord).on(PlantKind::ServoAxis),
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
    // A twentieth of what the drive can do, over the record.
    vec![Guess::scaled(vec![0.05 * survey.effort / survey.duration], 0.0)]
}

impl Effect for LoadDrift {
    // The time.
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
        let load = build(&Arguments { plant: PlantKind::ServoAxis, subject: None, numbers: vec![("force_rate", -0.02)] });
        let mut rates = [0.0];
        assert_eq!((load.load(&[50.0], &mut rates), rates), (-1.0, [1.0]));
    }
}
