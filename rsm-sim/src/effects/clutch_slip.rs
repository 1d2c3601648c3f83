//! The torque of the clutch is limited.
//!
//! Formula      abs(T_c) is limited to a capacity
//! Source       C. A. Coulomb, 1785 (dry friction between discs); docs/book/src/reference/plants.md, section 3
//! Acts on      the law of the clutch, after all other effects
//! Looks like   an error of the torque map at full load
//! Told apart   by engine speed against road speed
//! Report says  "The clutch slips above {capacity}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Carried, Declared, Description, Effect, Guess, Joint, Scale, Subject, Survey, Unit};
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "clutch-slip",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new("capacity", Unit::Is("N*m"), Bound::Positive)],
    sentence: "The clutch slips above {capacity}.",
    check: "Compare engine speed with road speed times the gear ratio under full load; where they part, inspect lining and clamp load.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct ClutchSlip {
    capacity: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ClutchSlip { capacity: arguments.number("capacity") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Shares of the engine's largest torque.
    let ratio = survey.parameters.number("gear_ratios[2]") * survey.parameters.number("final_drive_ratio");
    [0.95, 0.8, 0.65, 0.5].iter().map(|share| Guess::at(vec![share * survey.effort / ratio])).collect()
}

impl Effect for ClutchSlip {
    fn has_pieces(&self) -> bool {
        true
    }

    // A torque above the capacity is found if it lasts for a sixth of the clutch's oscillation period. While the discs slide fast, the spring's
    // torque changes from one limit to the other in 2 capacity/(stiffness rate); a step is half of this time.
    fn nonlinear_rate(&self, scale: &Scale) -> f64 {
        let (stiffness, _, rate) = scale.vehicle.clutch;
        0.25 * scale.vehicle.swing.0.max(stiffness * rate / self.capacity)
    }

    /// The piece is 0 if the discs stick, 1 if they slip forward, 2 if they slip backward.
    fn joint_limit(&self, joint: Joint, effort: f64, held: Option<u32>) -> Carried {
        if joint != Joint::Clutch {
            return Carried { effort, piece: 0 };
        }
        let piece = if effort > self.capacity { 1 } else { 2 * u32::from(effort < -self.capacity) };
        let effort = match held.unwrap_or(piece) {
            0 => effort,
            1 => self.capacity,
            _ => -self.capacity,
        };
        Carried { effort, piece }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: crate::equation_plant::driveline(), subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_clutch_carries_its_capacity_and_no_more() {
        let slip = made(&[("capacity", 200.0)]);
        let carried = |joint, effort, held| {
            let found = slip.joint_limit(joint, effort, held);
            (found.effort, found.piece)
        };
        assert_eq!(carried(Joint::Clutch, -250.0, None), (-200.0, 2));
        assert_eq!(carried(Joint::Clutch, 150.0, None), (150.0, 0));
        assert_eq!(carried(Joint::Driveshaft, 2500.0, None), (2500.0, 0));
        // A held law is also used outside of its range; the returned piece is the one to which the state belongs.
        assert_eq!(carried(Joint::Clutch, 250.0, Some(0)), (250.0, 1));
        assert_eq!(carried(Joint::Clutch, 150.0, Some(1)), (200.0, 0));
    }
}
