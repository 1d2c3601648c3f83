//! Functions for the refit on both rigs: the plant in a form that an experiment can use, and the gain of a refit.
//!
//! In: a plant file as a diagnosis leaves it. Out: one that a bench or a track can run. Never fits.

use rsm_sim::effect::Subject;
use rsm_sim::plant_file::PlantFile;

/// A plant in a form that an experiment can use. Errors of parameters become the parameters, because a drive gets the corrected parameters after a
/// diagnosis. Effects that an experiment cannot have are left out, and named.
#[must_use]
pub fn usable(plant: &PlantFile, never: &[&str]) -> (PlantFile, Vec<String>) {
    let mut usable = plant.clone();
    usable.initial.clear();
    usable.effects.clear();
    let mut left_out = Vec::new();
    for entry in &plant.effects {
        let kind = entry.description.kind;
        match (entry.description.subject, entry.arguments.subject.as_deref(), entry.arguments.optional("value")) {
            (Subject::Parameter, Some(name), Some(value)) => usable.parameters.set(name, value),
            _ if never.contains(&kind) => left_out.push(kind.to_string()),
            _ => usable.effects.push(entry.clone()),
        }
    }
    (usable, left_out)
}

/// The share of an error that is gone.
#[must_use]
pub fn gain(before: f64, after: f64) -> f64 {
    if before > 0.0 { 1.0 - after / before } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;

    #[test]
    fn errors_of_parameters_become_parameters_and_what_no_experiment_has_is_named() {
        let text = include_str!("../../rsm-sim/plants/pmac.toml").to_string()
            + "\n[[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"flux_linkage\", value = 0.05 }\n"
            + "[[effects]]\nkind = \"input-delay\"\nparameters = { delay = 0.001 }\n"
            + "[[effects]]\nkind = \"windage\"\nparameters = { coefficient = 1e-5 }\n";
        let plant = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let (usable, left_out) = usable(&plant, &["input-delay"]);
        assert_eq!(usable.parameters.number("flux_linkage"), 0.05);
        assert_eq!(usable.effects.iter().map(|it| it.description.kind).collect::<Vec<_>>(), ["windage"]);
        assert_eq!(left_out, ["input-delay"]);
        assert_eq!([gain(4.0, 1.0), gain(0.0, 1.0), gain(1.0, 3.0)], [0.75, 0.0, -2.0]);
    }
}
