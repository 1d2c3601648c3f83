//! The voltage of the bus is too low.
//!
//! Formula      a voltage vector longer than V_max is scaled back to V_max; with i_d held at 0 the vector is v_q alone
//! Source       the circle (20) of the paper; docs/book/src/reference/plants.md, section 3
//! Acts on      the voltage limit of the bus
//! Looks like   a gain of the input at high voltage
//! Told apart   by records with voltages below and above the limit
//! Report says  "The bus allows {limit} only."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "voltage-limit",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("limit", Unit::Is("V"), Bound::Positive)],
    sentence: "The bus allows {limit} only.",
    check: "Record the bus voltage under load; compare it with the value from which the limit was computed.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct VoltageLimit {
    limit: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(VoltageLimit { limit: arguments.number("limit") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Shares of the largest voltage; a higher limit would have no effect.
    [0.95, 0.85, 0.7, 0.5].iter().map(|share| Guess::at(vec![share * survey.input])).collect()
}

impl Effect for VoltageLimit {
    fn voltage_limit(&self, voltage: [f64; 2]) -> [f64; 2] {
        let length = (voltage[0] * voltage[0] + voltage[1] * voltage[1]).sqrt();
        // mutant `> to >=`: a vector as long as the limit is scaled by 1.
        let share = if length > self.limit { self.limit / length } else { 1.0 };
        [voltage[0] * share, voltage[1] * share]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equation_plant::pmac;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: pmac(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn long_vectors_keep_their_direction() {
        let limit = made(&[("limit", 50.0)]);
        assert_eq!(limit.voltage_limit([-60.0, 80.0]), [-30.0, 40.0]);
        assert_eq!(limit.voltage_limit([-6.0, 8.0]), [-6.0, 8.0]);
    }
}
