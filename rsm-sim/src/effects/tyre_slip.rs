//! The force of the tyre depends on its slip.
//!
//! Formula      m dV/dt = F - resistances, F = C (r w_w - V)/max(abs(V), 1 m/s); the inertia of the wheel is J_w; road_speed = V
//! Source       H. B. Pacejka, Tyre and Vehicle Dynamics, 2002 (linear longitudinal slip); docs/book/src/reference/plants.md, section 3
//! Acts on      the contact of wheel and road
//! Looks like   driveshaft damping
//! Told apart   by engine speed against road speed
//! Report says  "The tyres slip: {slip_stiffness} for a slip of 1."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Contact, Declared, Description, Effect, FirstInstant, Guess, Scale, Subject, Survey, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "tyre-slip",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("slip_stiffness", Unit::Is("N"), Bound::Positive)],
    sentence: "The tyres slip: {slip_stiffness} for a slip of 1.",
    check: "Compare wheel speed with ground speed (GPS) while accelerating and while coasting.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

/// The smallest denominator of the slip, in m/s.
const SLOWEST: f64 = 1.0;

struct TyreSlip {
    stiffness: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(TyreSlip { stiffness: arguments.number("slip_stiffness") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Twenty times and five times the weight for a slip of 1: usual tyres are between these values.
    let weight = 9.80665 * survey.parameters.number("mass");
    vec![Guess::at(vec![20.0 * weight]), Guess::at(vec![5.0 * weight])]
}

impl Effect for TyreSlip {
    fn states(&self) -> usize {
        1
    }

    fn start(&self, start: &FirstInstant, own: &mut [f64]) {
        // The start is without slip: road_speed = r w_w. The plant computes its wheel speed at the start from the same road speed.
        own[0] = start.road_speed;
    }

    fn vehicle_speed(&self, own: &[f64]) -> Option<f64> {
        Some(own[0])
    }

    fn traction(&self, contact: &Contact, own: &[f64], rates: &mut [f64]) -> Option<f64> {
        let force = self.stiffness * (contact.surface_speed - own[0]) / own[0].abs().max(SLOWEST);
        rates[0] = (force - contact.resistance) / contact.mass;
        Some(force)
    }

    // The force is linear except for the speed in the denominator, which changes slowly. A linear part is wrong by at most a tenth before it is
    // computed again, and the denominator changes by no more than that within a span.
    fn nonlinear_rate(&self, scale: &Scale) -> f64 {
        0.1 * self.fastest_rate(scale)
    }

    // The rate is largest at rest, where the denominator is 1 m/s.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let (inertia, radius) = scale.vehicle.wheel;
        let gain = self.stiffness / scale.vehicle.speed.abs().max(SLOWEST);
        gain * (radius * radius / inertia + 1.0 / scale.inertia)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_slip_pulls_the_vehicle() {
        let tyre = made(&[("slip_stiffness", 20000.0)]);
        let contact = Contact { surface_speed: 20.2, resistance: 100.0, mass: 1000.0 };
        let mut rates = [0.0];
        // The force is 20000 * 0.2/20 = 200 N, the acceleration (200 - 100)/1000 = 0.1 m/s^2.
        let force = tyre.traction(&contact, &[20.0], &mut rates).unwrap();
        assert!((force - 200.0).abs() < 1e-9 && (rates[0] - 0.1).abs() < 1e-12);
    }
}
