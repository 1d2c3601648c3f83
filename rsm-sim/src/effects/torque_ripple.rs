//! Harmonics of the flux linkage.
//!
//! Formula      lambda becomes lambda (1 + h cos(6 theta_e)), in EMF and in torque
//! Source       T. M. Jahns, W. L. Soong, 1996; docs/book/src/reference/plants.md, section 3
//! Acts on      the flux linkage
//! Looks like   cogging torque, unless the current changes
//! Told apart   by different currents at one speed: it grows with the current
//! Report says  "The flux linkage ripples by {amplitude} six times an electrical turn."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Currents, Declared, Description, Effect, Guess, Machine, Plausible, Scale, Subject, Survey, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "torque-ripple",
    plants: &["pmac"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("amplitude", Unit::Is("1"), Bound::NotNegative).plausible(Plausible::Within(1.0))],
    sentence: "The flux linkage ripples by {amplitude} six times an electrical turn.",
    check: "Turn the motor from outside with open terminals and look at its back-EMF: the sixth order must be there.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct TorqueRipple {
    amplitude: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(TorqueRipple { amplitude: arguments.number("amplitude") })
}

fn guesses(_survey: &Survey) -> Vec<Guess> {
    // Five per cent.
    vec![Guess::scaled(vec![0.05], 0.0)]
}

impl Effect for TorqueRipple {
    // A quarter of the ripple's frequency of six periods per electrical turn. The ripple is an excitation without feedback, so a step is a
    // quadrature; the error of Simpson's rule over one radian of the ripple is 1/2880.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        0.25 * 6.0 * scale.windings.turning
    }

    fn machine(&self, at: &Currents, _own: &[f64], _rates: &mut [f64], machine: &mut Machine) {
        machine.flux_linkage *= 1.0 + self.amplitude * (6.0 * at.theta_e).cos();
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
    fn six_crests_an_electrical_turn() {
        let ripple = made(&[("amplitude", 0.1)]);
        // The ripple is cos(0) = 1 at angle 0 and cos(pi) = -1 at a sixth of pi.
        for (theta_e, expected) in [(0.0, 0.066), (std::f64::consts::PI / 6.0, 0.054)] {
            let mut machine = Machine { resistance: 0.08, inductance: 9e-4, flux_linkage: 0.06 };
            ripple.machine(&Currents { i_d: 0.0, i_q: 0.0, theta_e }, &[], &mut [], &mut machine);
            assert!((machine.flux_linkage - expected).abs() < 1e-15);
        }
    }
}
