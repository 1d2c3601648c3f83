//! A sensor with a delay.
//!
//! Formula      y(t) = x(t - delay); before the record the first value is used
//! Source       transport delay; docs/book/src/reference/plants.md, section 3
//! Acts on      a named output
//! Looks like   a lag of the sensor; a delay of the input, if there is no other output
//! Told apart   by steps, which a lag makes smooth; by another output without delay
//! Report says  "The sensor of {output} reads {delay} late."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Role, Step, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "sensor-delay",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Output,
    at: None,
    arguments: &[Argument::new("delay", Unit::Is("s"), Bound::NotNegative)
        .plausible(Plausible::ShareOfRecord)
        .step(Step::OwnSize)],
    sentence: "The sensor of {output} reads {delay} late.",
    check: "Record one step with the sensor and with one whose time stamps are known; look at the bus, the logger's queue and its clock.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::role(Role::Delay),
};

struct SensorDelay {
    output: usize,
    delay: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(SensorDelay { output: arguments.output(), delay: arguments.number("delay") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // The same guesses as for a delay of the input.
    [0.5, 3.0, 10.0].iter().map(|periods| Guess::scaled(vec![periods * survey.period], 0.0)).collect()
}

impl Effect for SensorDelay {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn reads_late(&self, output: usize) -> f64 {
        if output == self.output { self.delay } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use crate::plant_file::PlantFile;
    use crate::record::Record;
    use crate::simulate::Simulator;
    use rsm_core::source::Source;

    #[test]
    fn a_reading_that_is_late_by_a_period_and_a_half_is_that_of_the_middle_between_rows() {
        // An input of 1 V from 0 s on gives 2 N on 1 kg, so q = t^2 m. With a delay of 1.5 s the reading is 2.5^2 = 6.25 m at 4 s, 0.25 m at 2 s, and
        // the first value before 1.5 s. With a delay of 2 s it is 4 m at 4 s and 0 at 2 s.
        let read = |delay: f64| {
            let text = format!(
                "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 1\nforce_gain = 2\nviscous_friction = 0\ncommand_limit = 10\n\
                 [[effects]]\nkind = \"sensor-delay\"\nparameters = {{ output = \"position\", delay = {delay} }}\n"
            );
            let plant = PlantFile::read(&Source::new("axis.toml", text)).unwrap();
            let rows = "time[s],command[V],position[m]\n0,1,0\n1,1,0\n2,1,0\n3,1,0\n4,1,0\n";
            let record = Record::read(&Source::new("in.csv", rows), &plant).unwrap();
            let outputs = Simulator::new(&plant, &record).unwrap().run(&record).unwrap();
            outputs.of("position").unwrap().to_vec()
        };
        for (delay, expected) in [(1.5, [0.0, 0.0, 0.25, 2.25, 6.25]), (2.0, [0.0, 0.0, 0.0, 1.0, 4.0]), (9.5, [0.0; 5])] {
            let found = read(delay);
            assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12), "{delay}: {found:?}");
        }
    }
}
