//! Swapped columns: two columns with exchanged headers.
//!
//! In: the nominal plant and a record. Out: the pair of outputs, or of inputs, whose exchange makes the record follow the plant. Each record is
//! tested separately, because the set-up of one logger may be wrong. No exchange is reported if the record follows the plant as it is, or if an
//! exchange leaves more than a fifth of the error: then the search for causes must explain it.

use super::checks::{Finding, SWAPPED};
use super::units;
use rsm_core::order;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{Drive, Record};

/// An exchange must leave at most this share of the squared error above the noise. Exchanged columns that are otherwise right leave hardly any.
const MOST_EXCESS_LEFT: f64 = 0.2;

/// It must also leave at most this share of the squared spread, while the record as given leaves more. A record with a larger error does not follow
/// the plant.
const MOST_SPREAD_LEFT: f64 = 0.5;

/// The number of exchanges that are calibrated.
const CALIBRATED: usize = 2;

/// Two columns that are exchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pair {
    Outputs(usize, usize),
    Inputs(usize, usize),
}

impl Pair {
    /// A copy of the record with the two columns exchanged.
    fn exchanged(self, record: &Record) -> Record {
        let mut record = record.clone();
        match self {
            Pair::Outputs(a, b) => record.measured.swap(a, b),
            Pair::Inputs(a, b) => record.inputs.swap(a, b),
        }
        record
    }

    fn names(self, file: &PlantFile, record: &Record) -> [&'static str; 2] {
        match self {
            Pair::Outputs(a, b) => [a, b].map(|k| file.kind.outputs()[k].name),
            Pair::Inputs(a, b) => [a, b].map(|k| rsm_sim::record::inputs(file.kind, record.drive)[k].name),
        }
    }
}

/// All pairs of columns that a record holds. An input that the drive itself generates has no column.
fn pairs(record: &Record, kind: PlantKind) -> Vec<Pair> {
    let outputs: Vec<usize> = (0..record.measured.len()).filter(|k| record.measured[*k].is_some()).collect();
    let inputs: Vec<usize> = match record.drive {
        Drive::Open => (0..record.inputs.len()).collect(),
        Drive::Inputs if record.absent(kind).is_empty() => (0..record.inputs.len()).collect(),
        Drive::Inputs | Drive::Closed => Vec::new(),
    };
    let each = |list: &[usize], make: fn(usize, usize) -> Pair| -> Vec<Pair> {
        list.iter().enumerate().flat_map(|(k, a)| list[..k].iter().map(move |b| make(*b, *a))).collect()
    };
    [each(&outputs, Pair::Outputs), each(&inputs, Pair::Inputs)].concat()
}

/// The exchange that makes a record follow the plant, if there is one.
fn of_record(file: &PlantFile, record: &Record, threads: usize) -> Option<Pair> {
    let pairs = pairs(record, file.kind);
    if pairs.is_empty() {
        return None;
    }
    let as_given = units::plant_errors(file, record, threads);
    // A record that follows the plant has its columns in the right place: an exchange gives an error as large as the signals.
    if as_given.calibrated < MOST_SPREAD_LEFT || as_given.is_noise() {
        return None;
    }
    let mut promising: Vec<(f64, Pair)> =
        pairs.into_iter().map(|pair| (units::nominal_error(file, &pair.exchanged(record), threads), pair)).collect();
    promising.retain(|it| it.0 < as_given.at_once);
    order::ascending(&mut promising, |it| it.0);
    let beyond = |left: f64| (left - as_given.noise).max(0.0);
    let mut best: Option<(f64, Pair)> = None;
    for (_, pair) in promising.into_iter().take(CALIBRATED) {
        let left = units::plant_errors(file, &pair.exchanged(record), threads).calibrated;
        let is_right = beyond(left) < MOST_EXCESS_LEFT * beyond(as_given.calibrated) && left < MOST_SPREAD_LEFT;
        if is_right && best.is_none_or(|it| left < it.0) {
            best = Some((left, pair));
        }
    }
    best.map(|it| it.1)
}

/// Corrects records with exchanged columns, and returns a finding for each of the two columns.
pub(super) fn correct(file: &PlantFile, records: &mut [Record], threads: usize) -> Vec<Finding> {
    let mut findings = Vec::new();
    for record in records {
        let Some(pair) = of_record(file, record, threads) else { continue };
        for name in pair.names(file, record) {
            findings.push(Finding {
                record: record.file.clone(),
                channel: name.to_string(),
                what: SWAPPED,
                rows: (0, record.rows().saturating_sub(1)),
            });
        }
        *record = pair.exchanged(record);
    }
    findings
}
