//! The flux per ampere decreases with the current.
//!
//! Formula      L becomes L/(1 + (i/i_sat)^2), i = sqrt(i_d^2 + i_q^2)
//! Source       a one-parameter form after F. de Leon, A. Semlyen, 1992; docs/book/src/reference/plants.md, section 3
//! Acts on      the inductance in all equations
//! Looks like   an error of the inductance at one current
//! Told apart   by steps at small and large currents
//! Report says  "The inductance halves at a current of {saturation_current}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Currents, Declared, Description, Effect, Guess, Machine, Scale, Subject, Survey, Unit, Windings,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "magnetic-saturation",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("saturation_current", Unit::Is("A"), Bound::Positive)],
    sentence: "The inductance halves at a current of {saturation_current}.",
    check: "Measure the inductance at small and at large current at standstill, by a small step on top of each.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct MagneticSaturation {
    current: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(MagneticSaturation { current: arguments.number("saturation_current") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // The largest current of the records, and a value far above it.
    let current = survey.largest[0].hypot(survey.largest[1]);
    vec![Guess::at(vec![3.0 * current]), Guess::at(vec![current])]
}

impl Effect for MagneticSaturation {
    fn machine(&self, at: &Currents, _own: &[f64], _rates: &mut [f64], machine: &mut Machine) {
        machine.inductance /= 1.0 + (at.i_d * at.i_d + at.i_q * at.i_q) / (self.current * self.current);
    }

    // Decay rate and oscillation frequency at the smallest inductance of the span, and the slope of 1/L at the voltage that changes the current: with
    // u = di/dt (1 + q)^-1 L and q = (i/i_sat)^2, the derivative of u (1 + q)/L with respect to i is di/dt 2 i/(i_sat^2 + i^2), at most di/dt divided
    // by i_sat.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let Windings { decay, swing, current: (least, most), change, .. } = scale.windings;
        let more = 1.0 + (most / self.current) * (most / self.current);
        let i = self.current.max(least).min(most);
        let slope = 2.0 * i / (self.current * self.current + i * i);
        (decay * more).max(swing * more.sqrt()) + change * slope
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
    fn half_is_left_at_the_saturation_current() {
        let mut machine = Machine { resistance: 0.08, inductance: 9e-4, flux_linkage: 0.06 };
        // The length of the current vector is sqrt(30^2 + 40^2) = 50.
        made(&[("saturation_current", 50.0)]).machine(
            &Currents { i_d: -30.0, i_q: 40.0, theta_e: 0.0 },
            &[],
            &mut [],
            &mut machine,
        );
        assert!((machine.inductance - 4.5e-4).abs() < 1e-18);
    }
}
