//! Columns whose unit is not the one that the record states: rpm for rad/s, km/h for m/s, kgf for N, r.m.s. for peak, per cent for a share.
//!
//! In: a plant file and training records as read. Out: columns with the factor, the unit that it means, and the gain estimated from the records with
//! its interval; and corrected records. This is done first, because a column that is wrong by a factor of ten makes calibration fail. Only a factor
//! that the motion of the plant shows is reported. If two columns explain it equally well, both are named.
//!
//! A candidate is a column, or several columns that usually go wrong together, with one factor of a short list. The nominal plant along the first
//! rows shows which candidates need a calibration. The calibrations choose one. A gain, fitted together with all other free unknowns, confirms the
//! factor.

mod candidates;

use super::checks;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::noise::NoiseFloor;
use super::nuisance::Nuisance;
use super::prepared::Piece;
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::significance::median;
use candidates::{Candidate, candidates, columns};
use rsm_core::order;
use rsm_sim::effect::Role;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// The number of rows from the beginning of a record that are tested.
const ROWS: usize = 3000;

/// A simulation error of this share of an output's spread counts as one standard deviation. Friction that the file lacks has an effect of several
/// times that.
const UNIT: f64 = 0.05;

/// The squared error of an output is limited to this many squared spreads: an error of more than twice the spread is simply wrong.
const WRONG: f64 = 4.0;

/// The number of candidates that are calibrated.
const CALIBRATED: usize = 6;

/// Steps of a calibration.
const STEPS: usize = 8;

/// A factor must leave at most this share of the squared error above the noise. A column with only a wrong unit leaves hardly any after correction.
const MOST_EXCESS_LEFT: f64 = 0.2;

/// It must also leave at most this share of the squared spread; otherwise the record does not belong to this plant.
const MOST_SPREAD_LEFT: f64 = 0.5;

/// Causes of the catalogue can have the effect of a factor between 1/3 and 3. For such a factor, only noise may be left.
const LARGE_FACTOR: f64 = 3.0;

/// At most this many times the noise energy counts as near noise, as in a calibration.
const NEAR_NOISE: f64 = 4.0;

/// Candidates are equally good if their squared errors differ by less than this share.
const ALIKE: f64 = 0.1;

/// A gain confirms a factor within this share, because sensors may be wrong by some per cent.
const NEAR_FACTOR: f64 = 0.02;

/// The same for a large factor before causes are known. Different units of one kind differ by more.
const NEAR_LARGE_FACTOR: f64 = 0.25;

/// A gain with a larger relative uncertainty than this does not identify a unit.
const KNOWN: f64 = 0.1;

/// The number of parts of the rows for the scatter of a gain, and the 97.5 % point of Student's t with nine degrees of freedom.
const PARTS: (usize, f64) = (10, 2.262);

/// The largest number of wrong columns, found one after another.
const MOST_COLUMNS: usize = 3;

/// A column in a wrong unit.
#[derive(Debug, Clone, PartialEq)]
pub struct WrongUnit {
    /// The column, or columns that are wrong together.
    pub columns: Vec<&'static str>,
    /// The unit that the records state.
    pub stated: &'static str,
    /// The probable unit, in words.
    pub unit: String,
    /// The reading divided by the true value, from the units.
    pub factor: f64,
    /// The same as estimated from the records: value and ends of its 95 % interval.
    pub gain: [f64; 3],
    /// Other columns with units that explain the records equally well.
    pub alike: Vec<String>,
}

impl std::fmt::Display for WrongUnit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [value, low, high] = self.gain;
        let reads = if self.columns.len() > 1 { "read" } else { "reads" };
        write!(
            f,
            "{} {reads} {value:.4} times the simulated value (95 %: {low:.4} to {high:.4}). {} is the factor of {}, not {}: the header probably states the wrong unit. The following results use the record in the corrected unit",
            self.columns.join(" and "),
            self.factor,
            self.unit,
            if self.stated == "1" { "a share of 1" } else { self.stated },
        )?;
        if !self.alike.is_empty() {
            write!(f, ". These units explain the records equally well: {}", self.alike.join("; "))?;
        }
        Ok(())
    }
}

/// Records with corrected columns, checked. The rows that count do not depend on a factor, so all candidates use the same ones.
fn prepared(records: &[Record], before: &[Candidate], file: &PlantFile) -> Vec<Prepared> {
    let right = |record: &Record| {
        let mut record = record.clone();
        before.iter().for_each(|it| it.convert(&mut record));
        Piece::whole(record)
    };
    checks::prepared(records.iter().map(right), file).0
}

/// The same with one more corrected column.
fn beside(given: &[Prepared], it: &Candidate) -> Vec<Prepared> {
    let mut right = given.to_vec();
    right.iter_mut().for_each(|prepared| it.convert(&mut prepared.record));
    right
}

/// Whitened residuals in shares of each output's spread.
fn whitened(prepared: Vec<Prepared>, file: &PlantFile, threads: usize) -> WhitenedResiduals {
    let mut whitened = WhitenedResiduals::new(prepared, [NoiseFloor::white(1.0); OUTPUTS], threads);
    for output in 0..file.kind.outputs().len() {
        let lists =
            whitened.records.iter().filter_map(|it| it.outputs.iter().position(|k| *k == output).map(|k| it.measured(k)));
        let all: Vec<f64> = lists.flatten().copied().collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        let spread = (all.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt();
        whitened.floors[output] = NoiseFloor::white((UNIT * spread).max(f64::MIN_POSITIVE));
    }
    whitened
}

fn model(whitened: &WhitenedResiduals, file: &PlantFile) -> Model {
    let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
    Model::nominal(file, &records, whitened.floors.map(|floor| floor.sd))
}

/// The squared error over the squared spread, limited to `WRONG`, as the mean over the outputs. Without a simulation it is `WRONG`.
fn error(whitened: &WhitenedResiduals, residual: Option<&[f64]>) -> f64 {
    let Some(residual) = residual else { return WRONG };
    let (mut sums, mut first) = ([(0.0, 0.0); OUTPUTS], 0);
    for prepared in &whitened.records {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let rows = prepared.record.rows();
            let part = &residual[first..first + rows];
            sums[*output].0 += dot(part, part);
            sums[*output].1 += prepared.used[k].iter().filter(|used| **used).count() as f64;
            first += rows;
        }
    }
    let each: Vec<f64> = sums
        .iter()
        .filter(|it| it.1 > 0.0)
        .map(|it| (UNIT * UNIT * it.0 / it.1).min(WRONG))
        .filter(|it| it.is_finite())
        .collect();
    each.iter().sum::<f64>() / each.len().max(1) as f64
}

/// The noise in that error, from second differences of the readings. Curvature of the motion from row to row counts as noise here.
fn noise(whitened: &WhitenedResiduals) -> f64 {
    let mut each = Vec::new();
    for prepared in &whitened.records {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let seconds = prepared.measured(k).windows(3).map(|w| (w[1] - 0.5 * (w[0] + w[2])).abs());
            // A second difference of white noise has sqrt(1.5) times its standard deviation. The median of |x| is 0.6745 standard deviations.
            let sd = median(&mut seconds.collect::<Vec<_>>()) / 0.6745 / 1.5_f64.sqrt();
            each.push((UNIT * sd / whitened.floors[*output].sd).powi(2));
        }
    }
    each.iter().sum::<f64>() / each.len().max(1) as f64
}

fn calibrated(whitened: &WhitenedResiduals, file: &PlantFile) -> Option<(Fit, f64)> {
    let fit = levenberg::fit(whitened, model(whitened, file), STEPS)?;
    let left = error(whitened, Some(&fit.residual));
    Some((fit, left))
}

/// The errors of a plant along a record: squared errors over squared spreads, as the mean over the outputs.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlantErrors {
    /// The nominal plant.
    pub at_once: f64,
    /// The plant calibrated within its tolerances.
    pub calibrated: f64,
    /// The noise in the error.
    pub noise: f64,
}

impl PlantErrors {
    /// Whether a calibrated plant leaves hardly more than noise.
    pub(super) fn is_noise(self) -> bool {
        self.calibrated < NEAR_NOISE * self.noise
    }
}

fn of_record(file: &PlantFile, record: &Record, threads: usize) -> WhitenedResiduals {
    let some = [record.piece(0..ROWS.min(record.rows()))];
    whitened(prepared(&some, &[], file), file, threads)
}

fn at_once(whitened: &WhitenedResiduals, file: &PlantFile) -> f64 {
    let run = whitened.run(&model(whitened, file));
    error(whitened, run.map(|run| whitened.residual(&run)).as_deref())
}

/// The errors of a plant along a record.
pub(super) fn plant_errors(file: &PlantFile, record: &Record, threads: usize) -> PlantErrors {
    let whitened = of_record(file, record, threads);
    let calibrated = calibrated(&whitened, file).map_or(WRONG, |it| it.1);
    PlantErrors { at_once: at_once(&whitened, file), calibrated, noise: noise(&whitened) }
}

/// The error of the nominal plant only.
pub(super) fn nominal_error(file: &PlantFile, record: &Record, threads: usize) -> f64 {
    at_once(&of_record(file, record, threads), file)
}

/// Columns of training records that are in a wrong unit, one after another.
#[must_use]
pub fn find(file: &PlantFile, training: &[Record], threads: usize) -> Vec<(WrongUnit, UnitCorrection)> {
    let records: Vec<Record> = training.iter().map(|it| it.piece(0..ROWS.min(it.rows()))).collect();
    let columns = columns(file.kind, &records);
    let all = candidates(&columns);
    let mut before: Vec<Candidate> = Vec::new();
    let mut found = Vec::new();
    while before.len() < MOST_COLUMNS {
        let Some((one, candidate)) = next(file, &records, &before, &all, threads) else { break };
        before.push(candidate.clone());
        found.push((one, UnitCorrection(candidate)));
    }
    found
}

/// The gains of corrected columns with the causes in the plant; `None` if a gain cannot be estimated or does not match its factor.
#[must_use]
pub fn gains_with_causes(
    found: &[(WrongUnit, UnitCorrection)],
    plant: &PlantFile,
    right: &[Record],
    noise: &[(usize, f64, f64)],
    threads: usize,
) -> Vec<Option<[f64; 3]>> {
    // Rounded readings have no derivatives.
    let mut plant = plant.clone();
    plant.effects.retain(|it| it.description.declared.role != Role::Rounding);
    let records: Vec<Record> = right.iter().map(|it| it.piece(0..ROWS.min(it.rows()))).collect();
    let mut whitened = whitened(prepared(&records, &[], &plant), &plant, threads);
    noise.iter().for_each(|(output, sd, _)| whitened.floors[*output] = NoiseFloor::white(*sd));
    let fit = calibrated(&whitened, &plant).map(|it| it.0);
    let of = |it: &UnitCorrection| {
        let gain = gain(&whitened, fit.as_ref()?, &it.0)?;
        let stands = gain[1] / (1.0 + NEAR_FACTOR) <= it.0.factor && it.0.factor <= gain[2] * (1.0 + NEAR_FACTOR);
        stands.then_some(gain)
    };
    found.iter().map(|it| of(&it.1)).collect()
}

/// The correction of a record.
#[derive(Debug, Clone)]
pub struct UnitCorrection(Candidate);

impl UnitCorrection {
    /// Converts the record to the unit that it states.
    pub fn apply(&self, record: &mut Record) {
        self.0.convert(record);
    }
}

/// One more wrong column, with the known ones corrected.
fn next(
    file: &PlantFile,
    records: &[Record],
    before: &[Candidate],
    all: &[Candidate],
    threads: usize,
) -> Option<(WrongUnit, Candidate)> {
    let checked = prepared(records, before, file);
    let given = whitened(checked.clone(), file, threads);
    let noise = noise(&given);
    let as_given = calibrated(&given, file).map_or(WRONG, |it| it.1);
    if as_given < NEAR_NOISE * noise {
        return None;
    }
    let plain = |whitened: &WhitenedResiduals| at_once(whitened, file);
    let nominal = plain(&given);
    let taken = |it: &Candidate| before.iter().any(|one| one.which.names.iter().any(|name| it.which.names.contains(name)));
    let mut promising: Vec<(f64, &Candidate)> = Vec::new();
    for it in all.iter().filter(|it| !taken(it)) {
        let whitened = whitened(beside(&checked, it), file, threads);
        promising.push((plain(&whitened), it));
    }
    promising.retain(|it| it.0 < nominal);
    order::ascending(&mut promising, |it| it.0);
    let mut fits: Vec<(f64, &Candidate, WhitenedResiduals, Fit)> = Vec::new();
    for (_, it) in promising.into_iter().take(CALIBRATED) {
        let whitened = whitened(beside(&checked, it), file, threads);
        if let Some((fit, left)) = calibrated(&whitened, file) {
            fits.push((left, it, whitened, fit));
        }
    }
    order::ascending(&mut fits, |it| it.0);
    let beyond = |left: f64| (left - noise).max(0.0);
    let stands = |left: f64, factor: f64| {
        let large = factor.max(1.0 / factor) > LARGE_FACTOR;
        beyond(left) < MOST_EXCESS_LEFT * beyond(as_given) && left < MOST_SPREAD_LEFT && (large || left < NEAR_NOISE * noise)
    };
    let (left, ..) = fits.first()?;
    let enough = (1.0 + ALIKE) * left + ALIKE * noise;
    let mut told: Vec<(&Candidate, [f64; 3])> = Vec::new();
    for (left, it, whitened, fit) in fits.iter().filter(|it| it.0 <= enough) {
        let Some(gain) = gain(whitened, fit, it) else { continue };
        // Other errors of the plant change the gain. A large factor needs only a rough match at first, and is tested again with the causes that a
        // search finds.
        let about = if it.factor.max(1.0 / it.factor) > LARGE_FACTOR { NEAR_LARGE_FACTOR } else { NEAR_FACTOR };
        let near = |factor: f64| gain[1] / (1.0 + about) <= factor && factor <= gain[2] * (1.0 + about);
        // Another factor of the list in the same interval: the records do not distinguish them.
        let only = !all.iter().any(|one| one.which.names == it.which.names && one.factor != it.factor && near(one.factor))
            && !near(1.0);
        if stands(*left, it.factor) && near(it.factor) && only && (gain[2] / gain[1]).ln().abs() < 4.0 * KNOWN.max(about) {
            told.push((it, gain));
        }
    }
    let (candidate, gain) = *told.first()?;
    let alike = told[1..].iter().map(|it| it.0.words()).collect();
    let Candidate { which, factor, unit } = candidate.clone();
    Some((WrongUnit { columns: which.names, stated: which.stated, unit, factor, gain, alike }, candidate.clone()))
}

/// The gain of a corrected column, estimated together with all free unknowns: value (with the factor) and the ends of its 95 % interval. The interval
/// includes noise and tolerances, and also the disagreement between parts of the records, because more than noise may be left.
fn gain(whitened: &WhitenedResiduals, fit: &Fit, it: &Candidate) -> Option<[f64; 3]> {
    /// The step of a finite difference, as a share of an input.
    const STEP: f64 = 0.01;
    let mut trace = vec![0.0; fit.residual.len()];
    if !it.which.inputs.is_empty() {
        let mut moved = whitened.clone();
        for prepared in &mut moved.records {
            for &input in &it.which.inputs {
                prepared.record.inputs[input].iter_mut().for_each(|value| *value *= 1.0 - STEP);
            }
        }
        let run = moved.run(&fit.model)?;
        trace = whitened.changes(&fit.simulated, &run, STEP);
    }
    let mut first = 0;
    for (prepared, simulated) in whitened.records.iter().zip(&fit.simulated) {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let rows = prepared.record.rows();
            if it.which.outputs.contains(output) {
                let sd = whitened.floors[*output].sd;
                for row in (0..rows).filter(|row| prepared.used[k][*row]) {
                    trace[first + row] += simulated[k][row] / sd;
                }
            }
            first += rows;
        }
    }
    let nuisance = Nuisance::new(fit);
    let products = nuisance.products(&trace);
    let own = nuisance.between(dot(&trace, &trace), &products, &products, 0);
    if own <= 0.0 {
        return None;
    }
    let off = nuisance.with_residual(&trace, &products, 0) / own;
    // The free unknowns are projected out first; then each part is estimated.
    let solved = nuisance.solved(&products);
    let mut alone = trace;
    for (column, share) in fit.columns.iter().zip(&solved) {
        for (value, its) in alone[column.first..].iter_mut().zip(&column.values) {
            *value -= share * its;
        }
    }
    let (parts, reach) = PARTS;
    let size = alone.len().div_ceil(parts);
    let squares: f64 = dot(&alone, &alone).max(f64::MIN_POSITIVE);
    let scatter: f64 = alone
        .chunks(size)
        .zip(fit.residual.chunks(size))
        .map(|(alone, residual)| (dot(alone, residual) - off * dot(alone, alone)).powi(2))
        .sum();
    let by_parts = scatter / (squares * squares) * parts as f64 / (parts - 1) as f64;
    // If the noise is unknown, the mean square of the residual takes its place.
    let level = dot(&fit.residual, &fit.residual) / fit.residual.len().max(1) as f64;
    let of_tolerances = (1.0 / own - level.min(1.0) / squares).max(0.0) * level.max(1.0);
    let sd = (by_parts + of_tolerances.min(1.0 / own)).sqrt();
    let of = |off: f64| it.factor * (1.0 + off);
    Some([of(off), of(off - reach * sd), of(off + reach * sd)])
}
