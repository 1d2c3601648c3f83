//! Gaps of a few rows, for example from a logger that loses single rows.
//!
//! In: a prepared record with gaps. Out: the same record with rows in the gaps, so that a simulation can run through. Outputs in these rows do not
//! count. Inputs are interpolated linearly across the gap. If the readings after a gap show that an input was higher or lower inside it, the line is
//! moved by that amount. Three kinds of gap are not filled: a long gap, a gap that is not a whole number of rows, and a step back in time. Never
//! changes a recorded row.

use super::levenberg::{self, Fit};
use super::model::Model;
use super::nuisance::Nuisance;
pub use super::prepared::FilledGap;
use super::prepared::{Prepared, PreparedRecords};
use super::whitened_residuals::{Column, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::normal::{Normal, symmetric};
use rsm_core::order;
use rsm_sim::kind::OUTPUTS;

/// The longest gap that is filled, in rows. A time stamp may be wrong by 1 % of a period, so the length of ten rows is known to a tenth of a row. If
/// an input changes once in the gap, its mean shows when it changed; if it changes twice, the mean does not.
pub const LONGEST: usize = 10;

/// A gap must be a whole number of periods within this share of a period: ten times the jitter of a row.
const GRID_TOLERANCE: f64 = 0.1;

/// The effect of an input in a gap, in squared standard deviations of the noise, below which its course does not matter: a hundredth of the gain that
/// a cause needs.
const LEAST_EFFECT: f64 = 0.3;

/// The largest number of gap inputs that are estimated, those with the largest effect. A record of 8000 rows that lost one row in 97 has 82 gaps;
/// with three inputs these are 246. Each needs a simulation of its record. Together they cost a quarter to a half of the search of one cause (500 to
/// 1000 runs).
const MOST_ESTIMATED: usize = 250;

/// The squared residual per row, in squared standard deviations, below which the residual counts as noise. The upper band gives the noise level to 2
/// to 4 %, which is 4 to 8 % in squares: a smaller limit would reject noise. The smallest detectable effect, a third of the noise, adds 10 %: with a
/// larger limit, the gaps would compensate for such an effect.
const NOISE_IS_LEFT: f64 = 1.1;

/// How often the gap inputs are estimated, each time followed by a calibration. The gap inputs and the calibration depend on each other.
const CORRECTIONS: usize = 4;

/// The number of steps of each calibration.
const STEPS: usize = 8;

/// How often the offsets are solved with the same traces. The remaining error of the gaps counts as noise, and it falls each time.
const SOLUTION_ROUNDS: usize = 6;

/// The variance of the mean of an input that changes once in a gap at an unknown instant, about the middle of its two values, divided by the square
/// of the change.
const VARIANCE_OF_A_CHANGE: f64 = 1.0 / 12.0;

/// If all offsets together gain less, in squared standard deviations of the noise, no further calibration is done.
const LEAST_GAIN: f64 = 1.0;

/// The filled gaps of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FilledGaps {
    /// The name of the record in messages.
    pub record: String,
    /// The number of gaps.
    pub gaps: usize,
    /// The number of rows in them.
    pub rows: usize,
    /// The number of rows in the longest gap.
    pub longest: usize,
}

/// The filled gaps of records; records without gaps are left out.
#[must_use]
pub fn filled_gaps<'a>(records: impl IntoIterator<Item = &'a Prepared>) -> Vec<FilledGaps> {
    let of = |it: &Prepared| FilledGaps {
        record: it.record.file.clone(),
        gaps: it.filled_gaps.len(),
        rows: it.filled_gaps.iter().map(|gap| gap.rows.len()).sum(),
        longest: it.filled_gaps.iter().map(|gap| gap.rows.len()).max().unwrap_or(0),
    };
    records.into_iter().filter(|it| !it.filled_gaps.is_empty()).map(of).collect()
}

/// Fills the short gaps of a record. The breaks that remain were not filled.
pub fn fill(prepared: &mut Prepared) {
    let record = &prepared.record;
    let missing = |row: &usize| {
        let periods = (record.time[*row] - record.time[*row - 1]) / record.period;
        let whole = periods.round();
        let fits = (periods - whole).abs() <= GRID_TOLERANCE && whole >= 2.0 && whole <= (LONGEST + 1) as f64;
        if fits { whole as usize - 1 } else { 0 }
    };
    let gaps: Vec<(usize, usize)> = record.breaks.iter().map(|row| (*row, missing(row))).collect();
    if gaps.iter().all(|gap| gap.1 == 0) {
        return;
    }
    let filled = |values: &[f64]| {
        let mut all = Vec::with_capacity(values.len() + gaps.iter().map(|gap| gap.1).sum::<usize>());
        let mut from = 0;
        for (row, count) in &gaps {
            all.extend_from_slice(&values[from..*row]);
            all.extend((1..=*count).map(|k| between(values[*row - 1], values[*row], k as f64 / (*count + 1) as f64)));
            from = *row;
        }
        all.extend_from_slice(&values[from..]);
        all
    };
    let (mut breaks, mut inserted) = (Vec::new(), 0);
    for (row, count) in &gaps {
        let start = row + inserted;
        if *count == 0 {
            breaks.push(start);
        } else {
            prepared.filled_gaps.push(FilledGap { rows: start..start + count, offsets: [0.0; OUTPUTS] });
        }
        inserted += count;
    }
    let mut record = record.clone();
    record.time = filled(&record.time);
    record.inputs = record.inputs.iter().map(|values| filled(values)).collect();
    record.measured = record.measured.iter().map(|values| values.as_ref().map(|values| filled(values))).collect();
    record.breaks = breaks;
    prepared.record = record;
    let rows = prepared.record.rows();
    for used in &mut prepared.used {
        *used = vec![true; rows];
        prepared.filled_gaps.iter().for_each(|it| used[it.rows.clone()].fill(false));
    }
}

fn between(before: f64, after: f64, share: f64) -> f64 {
    before + share * (after - before)
}

/// Writes an input in a gap: the line between the rows beside it, plus an offset.
fn write(prepared: &mut Prepared, place: GapInput, offset: f64) {
    let gap = &mut prepared.filled_gaps[place.gap];
    gap.offsets[place.input] = offset;
    let rows = gap.rows.clone();
    let values = &mut prepared.record.inputs[place.input];
    let (before, after) = (values[rows.start - 1], values[rows.end]);
    for (k, value) in values[rows.clone()].iter_mut().enumerate() {
        *value = between(before, after, (k + 1) as f64 / (rows.len() + 1) as f64) + offset;
    }
}

/// An input in a gap.
#[derive(Debug, Clone, Copy)]
struct GapInput {
    gap: usize,
    input: usize,
    /// Rows of the gap.
    rows: f64,
    /// The standard deviation of the input's difference from the line.
    sd: f64,
}

/// The inputs in gaps of a record. The error of linear interpolation elsewhere in the record gives the expected error here. A change across the gap
/// may lie anywhere in it.
fn gap_inputs(prepared: &Prepared) -> Vec<GapInput> {
    let mut list = Vec::new();
    for (input, values) in prepared.record.inputs.iter().enumerate().filter(|(_, values)| !values.is_empty()) {
        let mut elsewhere = [None; LONGEST + 1];
        for (gap, it) in prepared.filled_gaps.iter().enumerate() {
            let rows = it.rows.len();
            let usual = *elsewhere[rows].get_or_insert_with(|| interpolation_error(values, rows));
            let change = values[it.rows.end] - values[it.rows.start - 1];
            let sd = f64::max(usual, VARIANCE_OF_A_CHANGE * change * change).sqrt();
            if sd > 0.0 {
                list.push(GapInput { gap, input, rows: rows as f64, sd });
            }
        }
    }
    list
}

/// The mean square difference between the mean of this many values and the line between the values beside them.
fn interpolation_error(values: &[f64], rows: usize) -> f64 {
    let off = values.windows(rows + 2).map(|w| {
        let mean = w[1..=rows].iter().sum::<f64>() / rows as f64;
        (mean - 0.5 * (w[0] + w[rows + 1])).powi(2)
    });
    off.sum::<f64>() / values.len().saturating_sub(rows + 1).max(1) as f64
}

/// The gap inputs that matter. The effect of one gap is simulated; the effects of the others follow in proportion.
fn significant(whitened: &WhitenedResiduals, fit: &Fit, record: usize) -> Vec<GapInput> {
    let all = gap_inputs(&whitened.records[record]);
    let mut list: Vec<(f64, GapInput)> = Vec::new();
    for input in 0..whitened.records[record].record.inputs.len() {
        let its: Vec<GapInput> = all.iter().filter(|it| it.input == input).copied().collect();
        // The first gap is simulated, because its effect has the longest time.
        let Some(first) = its.first() else { continue };
        let Some(Some(trace)) = traces(whitened, fit, record, &[*first]).pop() else { continue };
        let energy = trace.dot(&trace);
        let of = |it: &GapInput| energy * (it.sd * it.rows / first.rows).powi(2);
        list.extend(its.iter().map(|it| (of(it), *it)).filter(|it| it.0 > LEAST_EFFECT));
    }
    order::descending(&mut list, |it| it.0);
    list.truncate(MOST_ESTIMATED);
    list.into_iter().map(|it| it.1).collect()
}

/// Records with estimated gap inputs, and the fit to them. `None` if that gains nothing, or if more than noise is left afterwards: then the gap
/// inputs would compensate for another error of the plant.
#[must_use]
pub fn corrected(whitened: &WhitenedResiduals, fit: &Fit) -> Option<(PreparedRecords, Fit)> {
    if whitened.records.iter().all(|it| it.filled_gaps.is_empty()) {
        return None;
    }
    let mut other = whitened.clone();
    let mut best: Option<Fit> = None;
    for _ in 0..CORRECTIONS {
        let from = best.as_ref().unwrap_or(fit);
        if !correct(&mut other, from) {
            break;
        }
        best = Some(levenberg::fit(&other, from.model.clone(), STEPS)?);
    }
    let best = best.filter(|best| best.cost < NOISE_IS_LEFT * best.residual.len() as f64)?;
    Some((other.records, best))
}

/// Moves the inputs in gaps once, to first order. All gaps of a record are solved together with the nuisance parameters. Returns whether that gained
/// something.
fn correct(whitened: &mut WhitenedResiduals, fit: &Fit) -> bool {
    let nuisance = Nuisance::new(fit);
    let mut residual = fit.residual.clone();
    let before = nuisance.remaining_square(&residual).0;
    for record in 0..whitened.records.len() {
        correct_one(whitened, fit, &nuisance, record, &mut residual);
    }
    before - nuisance.remaining_square(&residual).0 > LEAST_GAIN
}

/// The same for one record. The residual of all records is updated.
fn correct_one(whitened: &mut WhitenedResiduals, fit: &Fit, nuisance: &Nuisance<'_>, record: usize, residual: &mut Vec<f64>) {
    let places = significant(whitened, fit, record);
    let traces = traces(whitened, fit, record, &places).into_iter().zip(places);
    let traces: Vec<(GapInput, Column)> = traces.filter_map(|(trace, place)| Some((place, trace?))).collect();
    if traces.is_empty() {
        return;
    }
    let n = traces.len();
    let products: Vec<Vec<f64>> = traces.iter().map(|(_, trace)| nuisance.products_of(trace)).collect();
    let own = symmetric(n, |i, j| nuisance.between(traces[i].1.dot(&traces[j].1), &products[i], &products[j], 0));
    let first = whitened.first(record);
    let mut cost = nuisance.remaining_square(residual).0;
    for _ in 0..SOLUTION_ROUNDS {
        // The remaining error of all gaps in the record counts as noise.
        let its = &residual[first..first + WhitenedResiduals::length(&whitened.records[record])];
        let noise = (dot(its, its) / its.len().max(1) as f64).max(1.0);
        let mut matrix: Vec<f64> = own.iter().map(|product| product / noise).collect();
        let certain: Vec<f64> = traces.iter().map(|(it, _)| 1.0 / (it.sd * it.sd)).collect();
        (0..n).for_each(|i| matrix[i * n + i] += certain[i]);
        let now: Vec<f64> =
            traces.iter().map(|(it, _)| whitened.records[record].filled_gaps[it.gap].offsets[it.input]).collect();
        let asked = nuisance.projections(&traces, &products, residual);
        let right: Vec<f64> = (0..n).map(|i| asked[i] / noise - now[i] * certain[i]).collect();
        let change = Normal::new(&matrix, n, 0.0).solve(&right);
        let mut tried = whitened.records[record].clone();
        for ((place, _), (now, change)) in traces.iter().zip(now.iter().zip(&change)) {
            write(&mut tried, *place, now + change);
        }
        let other = whitened.with_records(vec![tried]);
        let model = Model { starts: vec![fit.model.starts[record]], ..fit.model.clone() };
        let Some(run) = other.run(&model) else { return };
        let mut moved = residual.clone();
        let its = other.residual(&run);
        moved[first..first + its.len()].copy_from_slice(&its);
        let left = nuisance.remaining_square(&moved).0;
        if left >= cost {
            return;
        }
        let gain = cost - left;
        if let Some(tried) = Vec::from(other.records).into_iter().next() {
            whitened.records[record] = tried;
        }
        (*residual, cost) = (moved, left);
        if gain < LEAST_GAIN {
            return;
        }
    }
}

/// The change of the record's outputs for a unit of each offset; `None` if that cannot be simulated.
fn traces(whitened: &WhitenedResiduals, fit: &Fit, record: usize, places: &[GapInput]) -> Vec<Option<Column>> {
    let first = whitened.first(record);
    let mut list = Vec::new();
    // A few at a time: each needs a copy of the record.
    for some in places.chunks(4 * whitened.threads.max(1)) {
        let now = |it: &GapInput| whitened.records[record].filled_gaps[it.gap].offsets[it.input];
        let moved = |it: &GapInput| {
            let mut prepared = whitened.records[record].clone();
            write(&mut prepared, *it, now(it) + it.sd);
            prepared
        };
        let other = whitened.with_records(some.iter().map(moved).collect());
        let model = Model { starts: vec![fit.model.starts[record]; some.len()], ..fit.model.clone() };
        let jobs: Vec<(usize, &Model)> = (0..some.len()).map(|k| (k, &model)).collect();
        let runs = other.simulate(&jobs).into_iter().zip(some);
        list.extend(runs.map(|(run, it)| {
            run.map(|run| Column { first, values: whitened.change(record, &fit.simulated[record], &run, it.sd) })
        }));
    }
    list
}

#[cfg(test)]
mod tests {
    use super::super::noise::NoiseFloor;
    use super::super::{axis_under_steps, levenberg};
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::record::Record;

    const AXIS: &str = "mass = 0.1\nviscous_friction = 0.5";

    fn record(csv: String) -> Record {
        let file = axis_under_steps::file(AXIS, "");
        Record::read_with_gaps(&Source::new("r.csv", csv), &file).unwrap()
    }

    /// An axis with a row each millisecond, without those of a list.
    fn without(rows: usize, lost: &[usize], value: impl Fn(usize) -> (f64, f64)) -> Prepared {
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        for k in (0..rows).filter(|k| !lost.contains(k)) {
            let (command, position) = value(k);
            csv += &format!("{},{command},{position}\n", k as f64 / 1000.0);
        }
        Prepared::new(record(csv), 2)
    }

    #[test]
    fn short_gaps_are_filled_and_rows_are_those_of_the_file() {
        let mut lost = vec![20, 40, 41];
        lost.extend(60..71);
        let mut prepared = without(100, &lost, |k| (k as f64, 2.0 * k as f64));
        fill(&mut prepared);
        assert_eq!(prepared.filled_gaps.iter().map(|it| it.rows.clone()).collect::<Vec<_>>(), [20..21, 40..42]);
        // Eleven rows stay a break: the one before row 71 of the truth, 11 rows are lost there.
        assert_eq!(prepared.record.breaks, [60]);
        assert_eq!(prepared.record.rows(), 100 - 11);
        for (k, value) in prepared.record.inputs[0][..60].iter().enumerate() {
            assert!((value - k as f64).abs() < 1e-9 && (prepared.record.time[k] - k as f64 / 1000.0).abs() < 1e-9);
        }
        let unused: Vec<usize> = (0..89).filter(|k| !prepared.used[0][*k]).collect();
        assert_eq!(unused, [20, 40, 41]);
        // Row 30 of the truth stands in row 29 of the file, row 50 in row 47.
        assert_eq!((prepared.file_row(30), prepared.file_row(50)), (29, 47));
        assert_eq!((prepared.row_of(29), prepared.row_of(47), prepared.row_of(86)), (Some(30), Some(50), None));
        prepared.keep(30..60);
        assert_eq!((prepared.file_row(0), prepared.file_row(20), prepared.row_of(47)), (29, 47, Some(20)));
        assert_eq!(filled_gaps([&prepared]), [FilledGaps { record: "r.csv".to_string(), gaps: 1, rows: 2, longest: 2 }]);
    }

    #[test]
    fn a_gap_that_is_no_whole_number_of_rows_stays_a_break() {
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        for k in 0..60 {
            let time = f64::from(k) / 1000.0 + if k >= 30 { 0.0015 } else { 0.0 };
            csv += &format!("{time},0,0\n");
        }
        let mut prepared = Prepared::new(record(csv), 2);
        fill(&mut prepared);
        assert_eq!((prepared.record.breaks.len(), prepared.filled_gaps.len()), (1, 0));
    }

    #[test]
    fn an_input_that_changed_in_a_gap_is_found_from_the_readings_after_it() {
        // The command goes up at row 100 and down at row 201; rows 100 and 200 are lost. Of the first the value after it is true, of the second the
        // one before.
        let file = axis_under_steps::file(AXIS, "");
        let command = |k: usize| if (100..201).contains(&k) { 4.0 } else { -1.0 };
        let mut whole = without(400, &[], |k| (command(k), 0.0));
        let truth = rsm_sim::simulate::Simulator::new(&file, &whole.record).unwrap().run(&whole.record).unwrap();
        let noise = 1e-6;
        let mut random = Random::new(4);
        let read: Vec<f64> = truth.of("position").unwrap().iter().map(|value| value + noise * random.normal()).collect();
        whole.record.measured[0] = Some(read.clone());
        let mut prepared = without(400, &[100, 200], |k| (command(k), read[k]));
        fill(&mut prepared);
        let floors = [NoiseFloor::white(noise); OUTPUTS];
        let mut whitened = WhitenedResiduals::new(vec![prepared], floors, 1);
        let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
        let model = Model::nominal(&file, &records, [noise; OUTPUTS]);
        let before = levenberg::fit(&whitened, model, 8).unwrap();
        let (records, after) = corrected(&whitened, &before).unwrap();
        whitened.records = records;
        let offsets: Vec<f64> = whitened.records[0].filled_gaps.iter().map(|it| it.offsets[0]).collect();
        // Half of 5 V up.
        assert!((offsets[0] - 2.5).abs() < 0.05 && (offsets[1] - 2.5).abs() < 0.05, "{offsets:?}");
        // Of a plant that is wrong otherwise nothing is asked.
        let mut wrong = before.model.clone();
        wrong.file.parameters.set("force_gain", 3.0);
        let records: Vec<Prepared> = whitened.records.to_vec();
        let there = levenberg::linearised(&whitened.with_records(records), wrong).unwrap();
        assert!(corrected(&whitened, &there).is_none());
        // 398 readings: four standard deviations of their squared noise, 4 sqrt(2 * 398), and what the priors of two offsets leave.
        assert!(after.cost < 398.0 + 113.0 + 10.0, "{} from {}", after.cost, before.cost);
    }
}
