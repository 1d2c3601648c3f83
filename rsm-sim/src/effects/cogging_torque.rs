//! Torque between the magnets and the teeth of the stator.
//!
//! Formula      A sin(N theta + phase) on the rotor; A sin(2 pi q/pitch + phase) on the axis
//! Source       D. C. Hanselman, Brushless Permanent-Magnet Motor Design, 1994; docs/book/src/reference/plants.md, section 3
//! Acts on      effort at the rotor; force on the carriage
//! Looks like   torque ripple of the same order, unless the current changes
//! Told apart   by motion without current
//! Report says  "A cogging torque of amplitude {amplitude} acts on the motor."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Declared, Description, Effect, Guess, Motion, Plausible, Role, Scale, Subject, Survey, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "cogging-torque",
    plants: &["pmac", "servo-axis"],
    subject: Subject::None,
    at: None,
    arguments: &[
        Argument::new("amplitude", Unit::Effort, Bound::NotNegative).plausible(Plausible::Effort),
        Argument::new("cycles", Unit::Is("1"), Bound::Count).on("pmac"),
        Argument::new("pitch", Unit::Is("m"), Bound::Positive).on("servo-axis"),
        Argument::new("phase", Unit::Is("rad"), Bound::Any),
    ],
    sentence: "A cogging torque of amplitude {amplitude} acts on the motor.",
    check: "Turn the unpowered motor slowly through a few turns (the axis over a few pitches) with a force gauge: the wave must be there without current.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::role(Role::Waves),
};

struct CoggingTorque {
    amplitude: f64,
    wave_number: f64,
    phase: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(CoggingTorque {
        amplitude: arguments.number("amplitude"),
        wave_number: match arguments.optional("cycles") {
            Some(cycles) => cycles,
            None => std::f64::consts::TAU / arguments.number("pitch"),
        },
        phase: arguments.number("phase"),
    })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A fiftieth of the drive's effort, at every order that is usual for the teeth and poles of small motors; on an axis the waves in the residuals.
    let at = |values: Vec<f64>| Guess { values, neutral: Some((0, 0.0)), phase: Some(2) };
    match survey.plant {
        plant if plant.is("servo-axis") => survey.waves.iter().map(|it| at(vec![it.amplitude, it.pitch, it.phase])).collect(),
        _ => {
            let orders = (1..=24).chain([28, 30, 32, 36, 42, 48, 54, 60, 72]);
            orders.map(|cycles| at(vec![0.02 * survey.effort, f64::from(cycles), 0.0])).collect()
        }
    }
}

impl Effect for CoggingTorque {
    fn effort(&self, motion: &Motion) -> f64 {
        self.amplitude * (self.wave_number * motion.position + self.phase).sin()
    }

    // The natural frequency at a stable equilibrium of this torque, sqrt(A N/J).
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        (self.amplitude * self.wave_number / scale.drive_inertia).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::servo_axis(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn a_quarter_of_the_pitch_is_the_crest() {
        let cogging = made(&[("amplitude", 2.0), ("pitch", 0.01), ("phase", 0.0)]);
        for (position, expected) in [(0.0025, 2.0), (0.0075, -2.0), (0.005, 0.0)] {
            let found = cogging.effort(&Motion { position, speed: 0.0, viscous_friction: 0.0 });
            assert!((found - expected).abs() < 1e-14, "{found} at {position}");
        }
    }
}
