//! The stiffness of the clutch disc's springs increases with the twist.
//!
//! Formula      k_3 phi^3 is added to T_c
//! Source       G. Duffing, 1918; docs/book/src/reference/plants.md, section 3
//! Acts on      the law of the clutch
//! Looks like   an error of the clutch stiffness at one torque
//! Told apart   by tip-ins of different size
//! Report says  "The clutch stiffens with {cubic_stiffness}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{
    Argument, Arguments, Carried, Declared, Description, Effect, Guess, Joint, Scale, Subject, Survey, Twist, Unit,
};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "clutch-stiffening",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("cubic_stiffness", Unit::Is("N*m/rad^3"), Bound::NotNegative)],
    sentence: "The clutch stiffens with {cubic_stiffness}.",
    check: "Measure the clutch's torque against its twist on a bench, beyond the first stage of its springs.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct ClutchStiffening {
    cubic: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ClutchStiffening { cubic: arguments.number("cubic_stiffness") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // One tenth more torque at the twist of the engine's typical torque.
    let stiffness = survey.parameters.number("clutch_stiffness");
    let ratio = survey.parameters.number("gear_ratios[2]") * survey.parameters.number("final_drive_ratio");
    let twist = survey.effort / ratio / stiffness;
    vec![Guess::scaled(vec![0.1 * stiffness / (twist * twist)], 0.0)]
}

impl Effect for ClutchStiffening {
    fn joint(&self, twist: &Twist, effort: f64, _held: Option<u32>) -> Carried {
        if twist.joint != Joint::Clutch {
            return Carried { effort, piece: 0 };
        }
        Carried { effort: effort + self.cubic * twist.angle * twist.angle * twist.angle, piece: 0 }
    }

    // The natural frequency with the slope of the cubic term, 3 k_3 phi^2, alone. Half of it is sufficient, because the damper stops the oscillation
    // before the error of a step becomes visible.
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        let twist = scale.vehicle.clutch.1;
        0.5 * (3.0 * self.cubic * twist * twist * scale.vehicle.clutch_mobility).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_torque_gains_the_cube_of_the_twist() {
        let twist = Twist { joint: Joint::Clutch, angle: 0.5, rate: 0.0, stiffness: 1000.0, damping: 0.0 };
        // The torque is 1000 * 0.5 + 80 * 0.125 = 510.
        assert_eq!(made(&[("cubic_stiffness", 80.0)]).joint(&twist, 500.0, None).effort, 510.0);
    }
}
