//! The switches reduce the voltage, against the direction of the current.
//!
//! Formula      the applied voltage is v - V_loss i/sqrt(i^2 + (0.5 A)^2), along the current vector
//! Source       S.-G. Jeong, M.-H. Park, 1991 (dead time of inverters); docs/book/src/reference/plants.md, section 3
//! Acts on      the voltage at the windings
//! Looks like   an error of the resistance at one current
//! Told apart   by small currents: the loss does not decrease with them
//! Report says  "The inverter loses {voltage_loss} against the current."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Scale, Subject, Survey, Unit, Windings,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "inverter-dead-time",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("voltage_loss", Unit::Is("V"), Bound::NotNegative).plausible(Plausible::Input)],
    sentence: "The inverter loses {voltage_loss} against the current.",
    check: "Measure terminal voltage against command at standstill at small currents: the loss must stay as the current shrinks.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

/// The width of the smooth zero crossing, in A.
const WIDTH: f64 = 0.5;

struct InverterDeadTime {
    loss: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(InverterDeadTime { loss: arguments.number("voltage_loss") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A fiftieth of the largest voltage.
    vec![Guess::scaled(vec![0.02 * survey.input], 0.0)]
}

impl Effect for InverterDeadTime {
    // The slope of the loss at the smallest current of the span (V_loss/0.5 A at zero current), divided by the inductance. If the current passes zero
    // faster than this rate, the loss acts like a kink, and the error of a step grows with slope and step. Then the rate is the geometric mean of the
    // slope's rate and the rate of passing.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let Windings { inductance, current, change, .. } = scale.windings;
        let width = (current.0 * current.0 + WIDTH * WIDTH).sqrt();
        let slope = self.loss / (width * inductance);
        slope.max((slope * change / width).sqrt())
    }

    fn voltage_loss(&self, voltage: [f64; 2], current: [f64; 2]) -> [f64; 2] {
        let length = (current[0] * current[0] + current[1] * current[1] + WIDTH * WIDTH).sqrt();
        [voltage[0] - self.loss * current[0] / length, voltage[1] - self.loss * current[1] / length]
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
    fn it_stands_against_the_current_vector() {
        // Currents (0.3, 0.4) A with the width 0.5 A: sqrt(0.25 + 0.25) = 0.70711; the loss is 2 V times (0.42426, 0.56569).
        let found = made(&[("voltage_loss", 2.0)]).voltage_loss([10.0, 10.0], [0.3, 0.4]);
        assert!((found[0] - 9.151471862576143).abs() < 1e-12 && (found[1] - 8.86862915010152).abs() < 1e-12, "{found:?}");
    }
}
