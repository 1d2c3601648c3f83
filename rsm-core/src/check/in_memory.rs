//! Rules for a model that was made in memory: faults that the reader of a file would already report.
//!
//! In: a model. Out: a fault for each number that is not finite, each power that is too high, and each name that occurs twice in a table. A model
//! without these faults can be written to a file and read back.

use super::Context;
use crate::model::{Evidence, Scheduled, Surface};
use crate::model_file::HIGHEST_POWER;
use crate::source::Collector;

pub(super) fn check(context: &Context<'_>, faults: &mut Collector) {
    let mut finite = |who: &str, value: f64| {
        if !value.is_finite() {
            faults.push(context.fault("", format!("{who}: found {value}, expected a finite number")));
        }
    };
    let model = context.model();
    for input in &model.inputs {
        input.range.iter().for_each(|end| finite(&format!("input `{}`: `range`", input.name), *end));
    }
    for surface in &model.surfaces {
        numbers_of(surface, &mut finite);
    }
    for compensator in &model.compensators {
        let who = format!("compensator `{}`", compensator.name);
        finite(&format!("{who}: `sample_time`"), compensator.sample_time);
        for (key, scheduled) in compensator.parts() {
            scheduled.fixed().into_iter().for_each(|value| finite(&format!("{who}: `{key}`"), value));
        }
    }
    for surface in &model.surfaces {
        let who = format!("surface `{}`", surface.name);
        for (k, term) in surface.terms.iter().enumerate() {
            for power in term.powers.iter().filter(|power| **power > HIGHEST_POWER) {
                let what = format!("{who}: term {}: found the power {power}, expected at most {HIGHEST_POWER}", k + 1);
                faults.push(context.fault("", what));
            }
        }
        let names: Vec<&String> = surface.symmetry.iter().map(|(name, _)| name).collect();
        for name in repeated(&names) {
            faults.push(context.fault("", format!("{who}: `symmetry` of `{name}` is given twice")));
        }
        for name in repeated_in_evidence(&surface.evidence) {
            faults.push(context.fault("", format!("{who}: `evidence`: `{name}` is given twice")));
        }
    }
    for compensator in &model.compensators {
        for (key, scheduled) in compensator.parts() {
            if matches!(scheduled, Scheduled::Sum(names) if names.is_empty()) {
                let what =
                    format!("compensator `{}`: `{key}`: found a sum of no surface, expected at least one", compensator.name);
                faults.push(context.fault("", what));
            }
        }
    }
}

fn numbers_of(surface: &Surface, finite: &mut impl FnMut(&str, f64)) {
    let who = format!("surface `{}`", surface.name);
    surface.output_range.iter().flatten().for_each(|end| finite(&format!("{who}: `output_range`"), *end));
    for (k, knot) in surface.knots.iter().enumerate() {
        finite(&format!("{who}: knot {}", k + 1), knot.at);
    }
    for (k, sigmoid) in surface.sigmoids.iter().enumerate() {
        [sigmoid.at, sigmoid.width].into_iter().for_each(|number| finite(&format!("{who}: sigmoid {}", k + 1), number));
    }
    for (k, wave) in surface.waves.iter().enumerate() {
        finite(&format!("{who}: wave {}", k + 1), wave.period);
    }
    for (k, term) in surface.terms.iter().enumerate() {
        finite(&format!("{who}: term {}: `coefficient`", k + 1), term.coefficient);
    }
    for coefficient in surface.spline.iter().flat_map(|spline| &spline.coefficients) {
        finite(&format!("{who}: `spline`: `coefficients`"), *coefficient);
    }
    for (k, space) in surface.support.iter().enumerate() {
        space.normal.iter().chain([&space.bound]).for_each(|number| finite(&format!("{who}: half-space {}", k + 1), *number));
    }
}

/// Names that already occurred before.
fn repeated<'a>(names: &[&'a String]) -> Vec<&'a String> {
    let is_repeated = |(k, name): (usize, &&'a String)| names[..k].contains(name).then_some(*name);
    names.iter().enumerate().filter_map(is_repeated).collect()
}

fn repeated_in_evidence(table: &[(String, Evidence)]) -> Vec<&String> {
    let names: Vec<&String> = table.iter().map(|(name, _)| name).collect();
    let below = table.iter().flat_map(|(_, value)| in_value(value));
    repeated(&names).into_iter().chain(below).collect()
}

fn in_value(value: &Evidence) -> Vec<&String> {
    match value {
        Evidence::Table(table) => repeated_in_evidence(table),
        Evidence::List(items) => items.iter().flat_map(in_value).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use crate::check::Checked;
    use crate::model::{Compensator, HalfSpace, Input, Knot, Model, Outside, Symmetry, Term};
    use crate::model_file;
    use crate::source::Source;

    use super::*;

    fn model() -> Model {
        let x = Input { name: "x".into(), unit: "1".into(), range: [-1.0, 1.0], outside: Outside::Clamp };
        let y = Surface {
            name: "y".into(),
            unit: "1".into(),
            inputs: vec!["x".into()],
            output_range: Some([-9.0, 9.0]),
            symmetry: vec![("x".into(), Symmetry::Even)],
            knots: vec![Knot { input: "x".into(), at: 0.5 }],
            terms: vec![Term { powers: vec![2, 0], coefficient: 3.0 }, Term { powers: vec![0, 1], coefficient: -0.0 }],
            support: vec![HalfSpace { normal: vec![1.0], bound: 0.9 }],
            evidence: vec![("rows".into(), Evidence::Whole(3)), ("sd".into(), Evidence::Number(f64::NAN))],
            ..Surface::default()
        };
        let filter = Compensator {
            name: "filter".into(),
            sample_time: 0.001,
            natural_frequency: Scheduled::Fixed(12.0),
            zero_damping: Scheduled::Surface("y".into()),
            pole_damping: Scheduled::Sum(vec!["y".into()]),
            pole_frequency: None,
        };
        Model { name: "m".into(), inputs: vec![x], surfaces: vec![y], compensators: vec![filter] }
    }

    /// A change of the model, and the expected message.
    type Case = (fn(&mut Model), &'static str);

    #[test]
    fn what_no_file_can_say_is_refused_in_memory() {
        let cases: [Case; 13] = [
            (|m| m.inputs[0].range[1] = f64::INFINITY, "input `x`: `range`: found inf, expected a finite number"),
            (
                |m| m.surfaces[0].output_range = Some([f64::NAN, 1.0]),
                "surface `y`: `output_range`: found NaN, expected a finite number",
            ),
            (|m| m.surfaces[0].knots[0].at = f64::NAN, "surface `y`: knot 1: found NaN, expected a finite number"),
            (
                |m| m.surfaces[0].terms[1].coefficient = f64::NAN,
                "surface `y`: term 2: `coefficient`: found NaN, expected a finite number",
            ),
            (
                |m| m.surfaces[0].support[0].bound = f64::NEG_INFINITY,
                "surface `y`: half-space 1: found -inf, expected a finite number",
            ),
            (
                |m| m.compensators[0].sample_time = f64::NAN,
                "compensator `filter`: `sample_time`: found NaN, expected a finite number",
            ),
            (
                |m| m.compensators[0].natural_frequency = Scheduled::Fixed(f64::INFINITY),
                "compensator `filter`: `natural_frequency`: found inf, expected a finite number",
            ),
            (|m| m.surfaces[0].terms[0].powers[0] = 21, "surface `y`: term 1: found the power 21, expected at most 20"),
            (|m| m.surfaces[0].symmetry.push(("x".into(), Symmetry::Even)), "surface `y`: `symmetry` of `x` is given twice"),
            (
                |m| {
                    let twice =
                        Evidence::Table(vec![("file".into(), Evidence::Flag(true)), ("file".into(), Evidence::Flag(true))]);
                    m.surfaces[0].evidence.push(("data".into(), Evidence::List(vec![twice])));
                },
                "surface `y`: `evidence`: `file` is given twice",
            ),
            (
                |m| m.compensators[0].pole_damping = Scheduled::Sum(vec![]),
                "compensator `filter`: `pole_damping`: found a sum of no surface, expected at least one",
            ),
            (|m| m.inputs.push(m.inputs[0].clone()), "input name `x` is given twice"),
            (|m| m.surfaces.clear(), "`surfaces`: found none, expected at least one"),
        ];
        for (change, expected) in cases {
            let mut model = model();
            change(&mut model);
            let faults = Checked::from_model(&model).unwrap_err().to_string();
            assert!(faults.lines().any(|line| line == format!("m.toml: {expected}")), "expected {expected}, found\n{faults}");
            // The file of this model is refused too, with a line.
            assert!(Checked::read(&Source::new("m.toml", model_file::write(&model))).is_err(), "{expected}");
        }
    }

    #[test]
    fn a_sound_model_is_the_same_from_memory_and_from_its_file() {
        let model = model();
        let read = Checked::read(&Source::new("m.toml", model_file::write(&model))).unwrap();
        let made = Checked::from_model(&model).unwrap();
        // Compared as text, because the evidence contains a NaN, which does not equal itself.
        assert_eq!(format!("{:?}", made.model()), format!("{:?}", read.model()));
        assert_eq!(made.file(), read.file());
    }
}
