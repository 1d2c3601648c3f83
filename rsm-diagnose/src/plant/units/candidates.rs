//! Columns that may be in another unit, alone or together, with the factors of the units that they may be in.
//!
//! In: records of one kind. Out: candidates. This file does not decide between them.

use rsm_sim::kind::PlantKind;
use rsm_sim::quantity::Signal;
use rsm_sim::record::{Drive, Record};

use super::super::other_units::{OF_A_WAVE, alternative_units};

/// Columns that are usually wrong together.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    pub(super) names: Vec<&'static str>,
    pub(super) stated: &'static str,
    pub(super) inputs: Vec<usize>,
    pub(super) outputs: Vec<usize>,
    /// Whether they belong to a rotating frame.
    of_frame: bool,
}

impl Columns {
    /// These columns and others together.
    fn with(&self, other: &Columns) -> Columns {
        Columns {
            names: [&self.names[..], &other.names].concat(),
            inputs: [&self.inputs[..], &other.inputs].concat(),
            outputs: [&self.outputs[..], &other.outputs].concat(),
            ..self.clone()
        }
    }
}

/// The name along the other axis of a rotating frame: `i_q` for `i_d`, and the reverse.
fn across(name: &str) -> Option<String> {
    let (stem, axis) = name.rsplit_once('_')?;
    let other = match axis {
        "d" => "q",
        "q" => "d",
        _ => return None,
    };
    Some(format!("{stem}_{other}"))
}

/// A column with a factor.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub(super) which: Columns,
    pub(super) factor: f64,
    pub(super) unit: String,
}

impl Candidate {
    /// Converts the readings.
    pub(super) fn convert(&self, record: &mut Record) {
        for &input in &self.which.inputs {
            record.inputs[input].iter_mut().for_each(|value| *value /= self.factor);
        }
        for &output in &self.which.outputs {
            record.measured[output].iter_mut().flatten().for_each(|value| *value /= self.factor);
        }
    }

    pub(super) fn words(&self) -> String {
        format!("{} in {}", self.which.names.join(" and "), self.unit)
    }
}

/// Columns of records of one kind that may be wrong: each column that varies, and groups that belong to one frame or one axis.
pub(super) fn columns(kind: PlantKind, records: &[Record]) -> Vec<Columns> {
    let Some(first) = records.first() else { return Vec::new() };
    let moves = |values: &[f64]| values.iter().any(|value| *value != 0.0);
    let mut list = Vec::new();
    let inputs = rsm_sim::record::inputs(kind, first.drive);
    let signals = || inputs.iter().chain(kind.outputs());
    let of_frame = |name: &str| across(name).is_some_and(|other| signals().any(|it| it.name == other));
    let one = |signal: &Signal, inputs: Vec<usize>, outputs: Vec<usize>| Columns {
        names: vec![signal.name],
        stated: signal.unit,
        inputs,
        outputs,
        of_frame: of_frame(signal.name),
    };
    for (k, signal) in inputs.iter().enumerate() {
        if records.iter().any(|it| it.inputs.get(k).is_some_and(|values| moves(values))) {
            list.push(one(signal, vec![k], vec![]));
        }
    }
    for (k, signal) in kind.outputs().iter().enumerate() {
        let is_input = first.drive == Drive::Open && inputs.iter().any(|input| input.name == signal.name);
        if !is_input && records.iter().any(|it| it.measured[k].as_ref().is_some_and(|values| moves(values))) {
            list.push(one(signal, vec![], vec![k]));
        }
    }
    let partner = |name: &str| match name {
        "reference" => Some("position".to_string()),
        // Each pair once.
        _ => across(name).filter(|_| name.ends_with('d')),
    };
    let pair = |one: &Columns| {
        let other = partner(one.names[0])?;
        Some(one.with(list.iter().find(|it| it.names[0] == other)?))
    };
    let pairs: Vec<Columns> = list.iter().filter_map(pair).collect();
    list.extend(pairs);
    list
}

pub(super) fn candidates(columns: &[Columns]) -> Vec<Candidate> {
    let mut list = Vec::new();
    for which in columns {
        let stated = if which.stated == "1" { "a share of 1" } else { which.stated };
        let of_a_wave = OF_A_WAVE.into_iter().filter(|_| which.of_frame);
        for other in alternative_units(which.stated).into_iter().chain(of_a_wave) {
            let read = Candidate { which: which.clone(), factor: other.factor, unit: other.name.to_string() };
            // The header may state the other unit while the values are already in this one. Reading then converts them once too often.
            let converted = Candidate {
                which: which.clone(),
                factor: 1.0 / other.factor,
                unit: format!("{stated} under a header of {}", other.name),
            };
            list.extend([read, converted]);
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use rsm_core::source::Source;
    use rsm_sim::plant_file::PlantFile;

    use super::*;

    /// The columns of a shipped plant's record that may be in r.m.s. values, as a header or as readings.
    fn of_a_wave(plant: &str) -> Vec<Vec<&'static str>> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants");
        let read = |ending: &str| Source::read(&folder.join(format!("{plant}.{ending}"))).unwrap();
        let file = PlantFile::read(&read("toml")).unwrap();
        let record = Record::read(&read("csv"), &file).unwrap();
        let all = candidates(&columns(file.kind, &[record]));
        all.into_iter().filter(|it| it.unit == "r.m.s. values").map(|it| it.which.names).collect()
    }

    #[test]
    fn only_quantities_of_a_rotating_frame_have_root_mean_squares() {
        // The record has no readings of i_d.
        assert_eq!(of_a_wave("pmac"), [vec!["v_d"], vec!["v_q"], vec!["i_q"], vec!["v_d", "v_q"]]);
        // Its input is a voltage too, and no part of a wave.
        assert!(of_a_wave("servo-axis").is_empty());
    }
}
