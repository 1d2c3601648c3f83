//! The clutch cannot carry more.
//!
//! Formula      abs(T_c) is limited to a capacity
//! Source       C. A. Coulomb, 1785 (dry friction between discs); PLANTS.md, section 3
//! Acts on      the law of the clutch, after what other effects make of it
//! Looks like   an error of the torque map at full load
//! Told apart   by engine speed against road speed
//! Report says  "The clutch slips above {capacity} N m."
//!
//! In: its arguments. Out: what its hooks change. Never changes anything else.

use crate::effect::{Argument, Arguments, Description, Effect, Guess, Joint, Subject, Survey};
use crate::kind::PlantKind;
use crate::schema::Bound;

/// What a file and a report may know of it.
pub const DESCRIPTION: Description = Description {
    kind: "clutch-slip",
    plants: &[PlantKind::Driveline],
    subject: Subject::None,
    arguments: &[Argument::new("capacity", "N*m", Bound::Positive)],
    sentence: "The clutch slips above {capacity} N m.",
    check: "Compare engine speed with road speed times the gear ratio under full load; where they part, inspect lining and clamp load.",
    build,
    guesses,
};

struct ClutchSlip {
    capacity: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ClutchSlip { capacity: arguments.number("capacity") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Shares of what the engine can do.
    let ratio = survey.parameters.gear_ratios[1] * survey.parameters.number("final_drive_ratio");
    [0.95, 0.8, 0.65, 0.5].iter().map(|share| Guess::at(vec![share * survey.effort / ratio])).collect()
}

impl Effect for ClutchSlip {
    fn joint_limit(&self, joint: Joint, effort: f64) -> f64 {
        if joint == Joint::Clutch && effort.abs() > self.capacity { self.capacity.copysign(effort) } else { effort }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(numbers: &[(&'static str, f64)]) -> Box<dyn Effect> {
        build(&Arguments { plant: PlantKind::Driveline, subject: None, numbers: numbers.to_vec() })
    }

    #[test]
    fn the_clutch_carries_its_capacity_and_no_more() {
        let slip = made(&[("capacity", 200.0)]);
        assert_eq!(slip.joint_limit(Joint::Clutch, -250.0), -200.0);
        assert_eq!(slip.joint_limit(Joint::Clutch, 150.0), 150.0);
        assert_eq!(slip.joint_limit(Joint::Driveshaft, 2500.0), 2500.0);
    }
}
