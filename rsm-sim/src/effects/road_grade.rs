//! The grade of the road differs from the plant file.
//!
//! Formula      the number `grade` replaces the parameter grade
//! Source       statics of a slope; docs/book/src/reference/plants.md, section 3
//! Acts on      the parameter grade, before the simulation
//! Looks like   brake drag, an error of rolling resistance, if the car always rolls forward; `parameter-error` of grade is the same effect
//! Told apart   by coasting in both directions of the road
//! Report says  "The road has a grade of {grade}."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::declared::STEEPEST_ROAD;
use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Subject, Survey, Unit};
use crate::parameters::Parameters;
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "road-grade",
    plants: &["driveline"],
    subject: Subject::None,
    at: None,
    arguments: &[Argument::new(
        "grade",
        Unit::Is("rad"),
        Bound::Between(-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2),
    )
    .plausible(Plausible::Within(STEEPEST_ROAD))],
    sentence: "The road has a grade of {grade}.",
    check: "Measure the slope, or drive the same road both ways; the scale and a coast-down tell it from drag.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct RoadGrade {
    grade: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(RoadGrade { grade: arguments.number("grade") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // Two per cent more than the value of the plant file.
    let nominal = survey.parameters.number("grade");
    vec![Guess::scaled(vec![nominal + 0.02], nominal)]
}

impl Effect for RoadGrade {
    fn parameters(&self, parameters: &mut Parameters) {
        parameters.set("grade", self.grade);
    }
}

#[cfg(test)]
mod tests {
    use crate::plant_file::PlantFile;
    use rsm_core::source::Source;

    #[test]
    fn the_grade_takes_the_place_of_the_nominal_one() {
        let text = include_str!("../../plants/driveline.toml").to_string()
            + "\n[[effects]]\nkind = \"road-grade\"\nparameters = { grade = 0.03 }\n";
        let file = PlantFile::read(&Source::new("car.toml", text)).unwrap();
        assert_eq!(file.effective_parameters().number("grade"), 0.03);
    }
}
