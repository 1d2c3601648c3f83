//! The true value of a parameter differs from its nominal value.
//!
//! Formula      p becomes value; `gear_ratios[3]` is the ratio of third gear
//! Source       the definition of a wrong data sheet; docs/book/src/reference/plants.md, section 3
//! Acts on      the parameters, before the simulation
//! Looks like   the physical effect of the parameter; an error of grade is the same as `road-grade`
//! Told apart   by a record in which the other parameters of the plant have an influence
//! Report says  "The parameter {parameter} is {value}, not what the plant file says."
//!
//! In: its arguments. Out: the changes of its hooks. It changes nothing else.

use crate::effect::{Argument, Arguments, Declared, Description, Effect, Guess, Plausible, Step, Subject, Survey, Unit};
use crate::parameters::Parameters;
use crate::schema::Bound;

/// The description for plant files and reports.
pub const DESCRIPTION: Description = Description {
    kind: "parameter-error",
    plants: &["pmac", "driveline", "servo-axis"],
    subject: Subject::Parameter,
    at: None,
    arguments: &[Argument::new("value", Unit::OfSubject, Bound::Any).plausible(Plausible::Parameter).step(Step::PerCent)],
    sentence: "The parameter {parameter} is {value}, not what the plant file says.",
    check: "Measure the parameter by itself, or look up where its value in the plant file comes from.",
    build,
    guesses: crate::effect::Guesses::Code(guesses),
    declared: Declared::NOTHING,
};

struct ParameterError {
    name: String,
    value: f64,
}

fn build(arguments: &Arguments) -> Box<dyn Effect> {
    Box::new(ParameterError { name: arguments.subject.clone().unwrap_or_default(), value: arguments.number("value") })
}

fn guesses(survey: &Survey) -> Vec<Guess> {
    // A change of five per cent: far more than finite differences need, and small enough for a linear response. A parameter of 0 is changed by a
    // hundredth of its unit.
    let value = if survey.nominal == 0.0 { 0.01 } else { 1.05 * survey.nominal };
    vec![Guess::scaled(vec![value], survey.nominal)]
}

impl Effect for ParameterError {
    fn acts_between_rows(&self) -> bool {
        false
    }

    fn parameters(&self, parameters: &mut Parameters) {
        parameters.set(&self.name, self.value);
    }
}

#[cfg(test)]
mod tests {
    use crate::plant_file::PlantFile;
    use rsm_core::source::Source;

    #[test]
    fn the_value_takes_the_place_of_the_nominal_one() {
        let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 4\nviscous_friction = 0\n\
                    command_limit = 10\n[[effects]]\nkind = \"parameter-error\"\n\
                    parameters = { parameter = \"mass\", value = 3 }\n";
        let file = PlantFile::read(&Source::new("axis.toml", text)).unwrap();
        assert_eq!(file.parameters.number("mass"), 2.0);
        assert_eq!(file.effective_parameters().number("mass"), 3.0);
    }

    #[test]
    fn one_gear_may_be_wrong_and_the_others_stay() {
        let entry = "\n[[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"gear_ratios[3]\", value = 1.6 }\n";
        let text = include_str!("../../plants/driveline.toml").to_string() + entry;
        let file = PlantFile::read(&Source::new("car.toml", text)).unwrap();
        let mut expected = file.parameters.clone();
        expected.set("gear_ratios[3]", 1.6);
        assert_eq!(file.effective_parameters(), expected);
        assert_ne!(file.parameters, expected);
        assert!(file.write().contains(entry.trim_start()));
        assert!(PlantFile::read(&Source::new("again.toml", file.write())).is_ok());
    }
}
