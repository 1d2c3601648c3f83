//! The winding warms up and its resistance increases.
//!
//! Formula      r becomes r (1 + 0.00393 Th); tau dTh/dt = R_th 1.5 r (1 + 0.00393 Th) i^2 - Th, Th = 0 at the start
//! Source       temperature coefficient of copper at 20 degC, IEC 60028; docs/book/src/reference/plants.md, section 3
//! Acts on      the phase resistance
//! Looks like   an error of the resistance in a short record
//! Told apart   by a record longer than the time constant
//! Report says  "The winding heats up: {thermal_resistance} with a time constant of {thermal_time_constant}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Currents, Declared, Description, Effect, Guess, Machine, Scale, Subject, Survey, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "resistance-heating",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("thermal_resistance", Unit::Is("K/W"), Bound::NotNegative),
        Argument::new("thermal_time_constant", Unit::Is("s"), Bound::Positive),
    ],
    sentence: "The winding heats up: {thermal_resistance} with a time constant of {thermal_time_constant}.",
    check: "Measure the winding's resistance cold, and again directly after the record.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

/// The temperature coefficient of copper, per kelvin.
const COPPER: f64 = 0.00393;

struct ResistanceHeating {
    thermal_resistance: f64,
    time_constant: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ResistanceHeating {
        thermal_resistance: arguments.number("thermal_resistance"),
        time_constant: arguments.number("thermal_time_constant"),
    })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Twenty kelvin at a third of the largest current, with a time constant of 3 %, 20 % and 100 % of the record's duration.
    let current = survey.largest[0].hypot(survey.largest[1]) / 3.0;
    let loss = 1.5 * survey.parameters.number("phase_resistance") * current * current;
    let shares = [0.03, 0.2, 1.0];
    shares.iter().map(|share| Guess::scaled(vec![20.0 / loss, share * survey.duration], 0.0)).collect()
}

impl Effect for ResistanceHeating {
    fn states(&self) -> usize {
        1
    }

    fn machine(&self, at: &Currents, own: &[f64], rates: &mut [f64], machine: &mut Machine) {
        machine.resistance *= 1.0 + COPPER * own[0];
        let loss = 1.5 * machine.resistance * (at.i_d * at.i_d + at.i_q * at.i_q);
        rates[0] = (self.thermal_resistance * loss - own[0]) / self.time_constant;
    }

    fn fastest_rate(&self, _scale: &Scale) -> f64 {
        1.0 / self.time_constant
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
    fn a_hot_winding_heats_more() {
        let heating = made(&[("thermal_resistance", 2.0), ("thermal_time_constant", 100.0)]);
        let (mut machine, mut rates) = (Machine { resistance: 0.08, inductance: 9e-4, flux_linkage: 0.06 }, [0.0]);
        heating.machine(&Currents { i_d: 0.0, i_q: 10.0, theta_e: 0.0 }, &[100.0], &mut rates, &mut machine);
        // The resistance is 0.08 * 1.393 = 0.11144 ohm, the power 1.5 * 0.11144 * 100 = 16.716 W, the rate (2 * 16.716 - 100)/100 = -0.66568 K/s.
        assert!((machine.resistance - 0.11144).abs() < 1e-15);
        assert!((rates[0] + 0.66568).abs() < 1e-12);
    }
}
