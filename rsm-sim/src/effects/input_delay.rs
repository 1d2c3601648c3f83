//! The input is delayed.
//!
//! Formula      u(t - delay); before the record the first value of the record is used
//! Source       transport delay; docs/book/src/reference/plants.md, section 3
//! Acts on      the first input: both voltages, throttle, command
//! Looks like   a lag of an actuator; half a sample of delay looks like the zero-order hold
//! Told apart   by steps of the input
//! Report says  "The input acts {delay} later than recorded."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Role, Step, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "input-delay",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("delay", Unit::Is("s"), Bound::NotNegative)
        .plausible(Plausible::ShareOfRecord)
        .step(Step::OwnSize)],
    sentence: "The input acts {delay} later than recorded.",
    check: "Apply one step of the input and count the samples to the first answer; look for filters, buses and time stamps.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::role(Role::Delay),
};

struct InputDelay {
    delay: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(InputDelay { delay: arguments.number("delay") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Half a sample period, and some periods. For longer delays a fit can be wrong by a full period of a fast oscillation.
    [0.5, 3.0, 10.0].iter().map(|periods| Guess::scaled(vec![periods * survey.period], 0.0)).collect()
}

impl Effect for InputDelay {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn delay(&self) -> f64 {
        self.delay
    }
}

#[cfg(test)]
mod tests {
    use crate::plant_file::PlantFile;
    use crate::record::Record;
    use crate::simulate::Simulator;
    use rsm_core::source::Source;

    #[test]
    fn a_delay_of_a_period_and_a_half_moves_the_step() {
        // An input of 1 V from 1 s on, delayed by 1.5 s, gives 2 N on 1 kg from 2.5 s on; at 4 s q = 1.5^2 = 2.25 m.
        let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 1\nforce_gain = 2\nviscous_friction = 0\n\
                    command_limit = 10\n[[effects]]\nkind = \"input-delay\"\nparameters = { delay = 1.5 }\n";
        let plant = PlantFile::read(&Source::new("axis.toml", text)).unwrap();
        let rows = "time[s],command[V],position[m]\n0,0,0\n1,1,0\n2,1,0\n3,1,0\n4,1,0\n";
        let record = Record::read(&Source::new("in.csv", rows), &plant).unwrap();
        let outputs = Simulator::new(&plant, &record).unwrap().run(&record).unwrap();
        let position = outputs.of("position").unwrap();
        assert!((position[2]).abs() < 1e-15 && (position[3] - 0.25).abs() < 1e-12 && (position[4] - 2.25).abs() < 1e-12);
    }
}
