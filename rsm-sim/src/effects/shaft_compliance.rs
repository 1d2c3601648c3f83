//! The shaft between drive and load is elastic.
//!
//! Formula      J is split: (1 - rho) J at the drive, rho J behind k (th_1 - th_2) + c (w_1 - w_2); the load acts on the second body, sensors and
//!              friction remain at the first
//! Source       S. P. Timoshenko, Vibration Problems in Engineering, 1928 (two inertias on a shaft); docs/book/src/reference/plants.md, section 3
//! Acts on      the joint between drive and load
//! Looks like   backlash at large amplitudes, sensor lag
//! Told apart   by an excitation near the resonance
//! Report says  "The load hangs on a spring of {stiffness}, with {inertia_ratio} of the inertia behind it."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Carried, Declared, Description, Effect, FirstInstant, Guess, Motion, Scale, Split, Subject, Survey,
    Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "shaft-compliance",
    plants: &["pmac", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("inertia_ratio", Unit::Is("1"), Bound::Between(0.0, 1.0)),
        Argument::new("stiffness", Unit::Stiffness, Bound::Positive),
        Argument::new("damping", Unit::EffortPerSpeed, Bound::NotNegative),
    ],
    sentence: "The load hangs on a spring of {stiffness}, with {inertia_ratio} of the inertia behind it.",
    check: "Clamp the load and twist the drive, or excite the drive by a sweep and look for a resonance above an antiresonance.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct ShaftCompliance {
    ratio: f64,
    stiffness: f64,
    damping: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ShaftCompliance {
        ratio: arguments.number("inertia_ratio"),
        stiffness: arguments.number("stiffness"),
        damping: arguments.number("damping"),
    })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Lightly damped resonances from a hundredth to a fifth of the sample rate, with one third and with two thirds of the inertia behind the spring.
    let inertia = survey.parameters.optional("inertia").unwrap_or_else(|| survey.parameters.number("mass"));
    let mut guesses = Vec::new();
    for share in [0.01, 0.025, 0.06, 0.2] {
        for ratio in [0.33, 0.67] {
            let rate = std::f64::consts::TAU * share / survey.period;
            let reduced = inertia * ratio * (1.0 - ratio);
            guesses.push(Guess::at(vec![ratio, rate * rate * reduced, 2.0 * 0.05 * rate * reduced]));
        }
    }
    guesses
}

impl Effect for ShaftCompliance {
    fn states(&self) -> usize {
        2
    }

    // The far body starts at the position and speed of the drive, so the joint is at rest.
    fn start(&self, start: &FirstInstant, own: &mut [f64]) {
        own.copy_from_slice(&[start.motion.position, start.motion.speed]);
    }

    fn split(&self) -> Option<f64> {
        Some(self.ratio)
    }

    fn far_motion(&self, own: &[f64]) -> Motion {
        Motion { position: own[0], speed: own[1], viscous_friction: 0.0 }
    }

    fn passes(&self, body: &Split, own: &[f64], rates: &mut [f64]) -> Carried {
        let effort = self.stiffness * (body.near.position - own[0]) + self.damping * (body.near.speed - own[1]);
        rates[0] = own[1];
        rates[1] = (effort - body.load) / (self.ratio * body.inertia);
        Carried { effort, piece: 0 }
    }

    fn nonlinear_rate(&self, _scale: &Scale) -> f64 {
        0.0
    }

    // The natural frequency of the two bodies on the spring, and the rate of the damper against the lighter one.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let mobility = 1.0 / scale.drive_inertia + 1.0 / (self.ratio * scale.inertia);
        (self.stiffness * mobility).sqrt().max(self.damping * mobility)
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
    fn the_spring_pulls_the_far_body() {
        let shaft = made(&[("inertia_ratio", 0.25), ("stiffness", 40.0), ("damping", 2.0)]);
        let mut rates = [0.0; 2];
        // A twist of 0.25 rad and a rate of 1 rad/s give 10 + 2 = 12 N m; minus a load of 4 N m, on 0.25 * 8 kg m^2: 4 rad/s^2.
        let near = Motion { position: 0.5, speed: 3.0, viscous_friction: 0.0 };
        let body = Split { near, inertia: 8.0, load: 4.0, held: None };
        assert_eq!(shaft.passes(&body, &[0.25, 2.0], &mut rates).effort, 12.0);
        assert_eq!(rates, [2.0, 4.0]);
    }
}
