//! Faults that only the residual proves: an input that is stuck or clipped, a sensor with another scale in some runs.
//!
//! In: a sample without the faults found before. Out: faults. Every test allows the file to be wrong:
//! its terms, those of the next order, a drift and all further columns may have other coefficients. Errors that follow each other are whitened first.
//! A fault needs a probability below [`CHANCE`], so all of them together add nothing to the false alarms of a diagnosis.

use rsm_core::order;
use rsm_fit::design::{self, terms_up_to};

use super::fault::{Fault, Found, ranges};
use super::sample::Sample;
use crate::engine::columns::{Basis, dot, solve};
use crate::engine::significance::{ln_p_of_squares, ln_upper_f, median};

/// The probability by chance of a fault, of all places that were tried. A diagnosis promises 5 %.
pub(super) const CHANCE: f64 = 1e-6;

/// The base has at most a column for this many rows.
const ROWS_PER_COLUMN: usize = 4;

/// Equal readings of an input, one after the other.
const STUCK: usize = 6;

/// A stuck input repeats its reading in this many rows more than in any other place: levels of a design repeat too.
const LONGER: usize = 2;

/// Readings of an input at the end of its readings.
const CLIPPED: usize = 5;

/// A change is a jump if it exceeds this many usual changes (their median).
const JUMP: f64 = 5.0;

/// The share of its other readings that occur once or twice. An input with levels is not clipped.
const SINGLE: f64 = 0.9;

/// Rows of a faulty input have this many times the mean square of the noise, or more.
const INFLATED: f64 = 4.0;

/// At a limit the true value differs from row to row. The probability of as much scatter about the mean.
const SCATTER: f64 = 1e-3;

/// Changes are looked for at this many rows, evenly spread, and then refined. All pairs of them are tried.
const CHANGES: usize = 120;

/// The least rows with another scale.
const SCALED: usize = 8;

/// 2 ln(likelihood ratio) by which another scale exceeds a shift of the same rows or of another range, and offsets of blocks. e^5 to 1.
const BETTER: f64 = 10.0;

/// The share of the rows with another scale whose errors are smaller with it.
const SMALLER: f64 = 0.75;

/// The effect of another scale on its rows, in standard deviations of the noise (root mean square).
const LEAST_EFFECT: f64 = 1.5;

/// The estimate of a factor of 0.001 (a unit) may be below zero. A factor further below is no scale.
const LEAST_FACTOR: f64 = -0.02;

/// Below this factor, the median quotient is the better estimate: only there the noise is scaled too, far below that of the other rows.
const SMALL_FACTOR: f64 = 0.2;

/// The largest share of the squares that another scale may leave if neighbouring errors are correlated.
const MOST_LEFT: f64 = 0.1;

/// In standard deviations of the noise: a smaller effect of a scale does not show on which side of a change a row is.
const DOUBTFUL: f64 = 3.0;

/// For a normal x, the median of |x| is 0.6745 standard deviations.
const MEDIAN: f64 = 0.6745;

/// The columns that a test allows to be different: constant, terms of the file and of the next order, drift, further columns.
pub(super) fn base(sample: &Sample) -> Vec<Vec<f64>> {
    let rows = sample.rows();
    let mut columns = vec![vec![1.0; rows]];
    columns.extend(sample.terms.iter().cloned());
    columns.push(sample.places.iter().map(|place| *place as f64 / rows as f64).collect());
    let highest = sample.surface.terms.iter().map(|term| design::order(&term.powers)).max().unwrap_or(0);
    let has = |powers: &Vec<u32>| sample.surface.terms.iter().any(|term| term.powers == *powers);
    let width = sample.surface.width();
    // The count is checked first: terms of many inputs are not listed in vain.
    if design::count_of_terms(width, highest + 1) * ROWS_PER_COLUMN <= rows {
        let next: Vec<Vec<u32>> = terms_up_to(&sample.surface, highest + 1).into_iter().filter(|powers| !has(powers)).collect();
        columns.extend(sample.columns_of(&next, &sample.points));
    }
    let room = (rows / ROWS_PER_COLUMN).saturating_sub(columns.len());
    columns.extend(sample.extras.iter().filter_map(|extra| extra.values.clone()).take(room));
    columns
}

/// The residual beside a base, and its noise.
pub(super) struct Residual {
    basis: Basis,
    values: Vec<f64>,
    /// The standard deviation, from the median: faulty rows do not change it much.
    pub noise: f64,
}

impl Residual {
    pub(super) fn new(sample: &Sample, base: &[Vec<f64>]) -> Self {
        let basis = Basis::of(base);
        let mut values = sample.residual();
        basis.project_out(&mut values);
        let free = (values.len() as f64 / values.len().saturating_sub(basis.rank()).max(1) as f64).sqrt();
        let noise = median(&mut values.iter().map(|value| value.abs()).collect::<Vec<f64>>()) / MEDIAN * free;
        Residual { basis, values, noise }
    }

    /// Whether neighbours are correlated beyond four standard errors: by chance once in 30,000 data sets.
    pub(super) fn is_correlated(&self) -> bool {
        correlation(&self.values) > 4.0 / (self.values.len() as f64).sqrt()
    }

    fn freedom(&self) -> f64 {
        self.values.len().saturating_sub(self.basis.rank()).max(1) as f64
    }
}

/// The errors of some rows, predicted from the others, against the errors of the others.
pub(super) struct Predicted {
    /// The errors of these rows.
    pub errors: Vec<f64>,
    /// The mean square of the others, with its degrees of freedom.
    pub mean_square: f64,
    freedom: f64,
}

impl Predicted {
    pub(super) fn new(sample: &Sample, base: &[Vec<f64>], rows: &[usize]) -> Self {
        let residual = sample.residual();
        let others: Vec<usize> = (0..sample.rows()).filter(|row| rows.binary_search(row).is_err()).collect();
        let of = |column: &Vec<f64>, rows: &[usize]| rows.iter().map(|row| column[*row]).collect::<Vec<f64>>();
        let columns: Vec<Vec<f64>> = base.iter().map(|column| of(column, &others)).collect();
        let solved = solve(&columns, &of(&residual, &others));
        let freedom = others.len().saturating_sub(solved.rank).max(1) as f64;
        let predicted = |row: &usize| base.iter().zip(&solved.coefficients).map(|(column, c)| c * column[*row]).sum::<f64>();
        Predicted {
            errors: rows.iter().map(|row| residual[*row] - predicted(row)).collect(),
            mean_square: dot(&solved.residual, &solved.residual) / freedom,
            freedom,
        }
    }

    /// Whether the errors are far larger than those of the other rows.
    pub(super) fn is_inflated(&self, trials: usize) -> bool {
        let count = self.errors.len() as f64;
        let f = dot(&self.errors, &self.errors) / count / self.mean_square;
        f >= INFLATED && ln_upper_f(f, count, self.freedom) + (trials as f64).ln() < CHANCE.ln()
    }

    /// The part with the large errors, first and last: a stuck sensor may repeat a level that it had before. If that is nearly the whole, it is the
    /// whole: some errors are small by chance.
    fn largest_part(&self) -> (usize, usize) {
        let (mut best, mut sum, mut first) = ((0.0, 0, self.errors.len() - 1), 0.0, 0);
        for (k, error) in self.errors.iter().enumerate() {
            if sum <= 0.0 {
                (sum, first) = (0.0, k);
            }
            // A square belongs to the part if it exceeds half of that which proves the fault.
            sum += error * error / self.mean_square - INFLATED / 2.0;
            if sum > best.0 {
                best = (sum, first, k);
            }
        }
        if 3 * (best.2 - best.1 + 1) >= 2 * self.errors.len() { (0, self.errors.len() - 1) } else { (best.1, best.2) }
    }

    /// Whether their scatter about their mean is too.
    fn is_scattered(&self) -> bool {
        let count = self.errors.len() as f64;
        let mean = self.errors.iter().sum::<f64>() / count;
        let square: f64 = self.errors.iter().map(|error| (error - mean).powi(2)).sum();
        ln_upper_f(square / (count - 1.0) / self.mean_square, count - 1.0, self.freedom) < SCATTER.ln()
    }
}

/// Runs of equal values: first and last index.
pub(super) fn equal_runs(values: &[f64]) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut first = 0;
    for row in 1..=values.len() {
        if row == values.len() || values[row] != values[first] {
            runs.push((first, row - 1));
            first = row;
        }
    }
    runs
}

/// Whether a run of equal readings is at the end of all readings, and the input does not jump there. In random order every change is a jump; then the
/// end of the readings is a limit if other rows have it too.
fn is_limit(values: &[f64], (first, last): (usize, usize)) -> bool {
    let value = values[first];
    if values.iter().any(|other| *other < value) && values.iter().any(|other| *other > value) {
        return false;
    }
    let mut steps: Vec<f64> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0).collect();
    let usual = median(&mut steps);
    let step = |row: Option<usize>| row.and_then(|row| values.get(row)).map_or(0.0, |other| (other - value).abs());
    let jump = step(first.checked_sub(1)).max(step(Some(last + 1)));
    let elsewhere = values.iter().filter(|other| **other == value).count() > last - first + 1;
    jump <= JUMP * usual || elsewhere
}

/// Four significant digits.
fn number(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { 3 - value.abs().log10().floor() as i32 };
    format!("{value:.*}", digits.clamp(0, 12) as usize)
}

pub(super) fn with_unit(value: f64, unit: &str) -> String {
    if unit == "1" { number(value) } else { format!("{} {unit}", number(value)) }
}

/// Inputs that are stuck or clipped.
pub(super) fn inputs(sample: &Sample) -> Found {
    let base = base(sample);
    let mut found = Found::default();
    for (_, (input, values)) in sample.inputs.iter().zip(&sample.points).enumerate().filter(|(k, _)| !sample.is_contrast(*k)) {
        let (low, high) = order::ends(values);
        let mut others: Vec<f64> = values.iter().copied().filter(|value| ![low, high].contains(value)).collect();
        order::sort(&mut others);
        let single: usize = others.chunk_by(|a, b| a == b).map(<[f64]>::len).filter(|count| *count <= 2).sum();
        // An input with levels repeats its readings by intention, also the largest one.
        let has_levels = 2 * others.len() < values.len() || (single as f64) < SINGLE * others.len() as f64;
        let mut runs = equal_runs(values);
        runs.sort_by_key(|(first, last)| std::cmp::Reverse(last - first));
        let length = |run: &(usize, usize)| run.1 - run.0 + 1;
        let longest = runs[0];
        if length(&longest) >= STUCK
            && length(&longest) < values.len() / 2
            && (has_levels || !is_limit(values, longest))
            && runs.get(1).is_none_or(|next| length(&longest) >= length(next) + LONGER)
        {
            let rows: Vec<usize> = (longest.0..=longest.1).collect();
            let predicted = Predicted::new(sample, &base, &rows);
            if predicted.is_inflated(sample.inputs.len()) {
                let (first, last) = predicted.largest_part();
                let places = (sample.places[longest.0 + first], sample.places[longest.0 + last]);
                let sentence = format!(
                    "The sensor of `{}` repeats {}, and the response shows that the input moved.",
                    input.name,
                    with_unit(values[longest.0], &input.unit)
                );
                found.faults.push(Fault::new("stuck", &input.name, places, sentence));
                // Small errors at the ends of the run may be of either kind.
                found.doubtful.extend(rows.iter().map(|row| sample.places[*row]));
                continue;
            }
        }
        for (limit, words) in [(low, "below"), (high, "above")] {
            let rows: Vec<usize> = (0..values.len()).filter(|row| values[*row] == limit).collect();
            if has_levels || rows.len() < CLIPPED || 2 * rows.len() > values.len() {
                continue;
            }
            let predicted = Predicted::new(sample, &base, &rows);
            if predicted.is_inflated(2 * sample.inputs.len()) && predicted.is_scattered() {
                let places: Vec<usize> = rows.iter().map(|row| sample.places[*row]).collect();
                let sentence = format!(
                    "The sensor of `{}` does not read {words} {}: in these rows the response shows values beyond.",
                    input.name,
                    with_unit(limit, &input.unit)
                );
                found
                    .faults
                    .extend(ranges(&places).into_iter().map(|rows| Fault::new("clipped", &input.name, rows, sentence.clone())));
            }
        }
    }
    found
}

/// Sums over the rows before each row, of a column beside the base: for any range of rows the squares that this part of the column explains.
struct Parts {
    square: Vec<f64>,
    with_residual: Vec<f64>,
    with_base: Vec<Vec<f64>>,
}

impl Parts {
    fn new(column: &[f64], residual: &Residual) -> Self {
        let sums = |products: &dyn Fn(usize) -> f64| {
            let mut sum = 0.0;
            let mut sums = vec![0.0];
            for row in 0..column.len() {
                sum += products(row);
                sums.push(sum);
            }
            sums
        };
        Parts {
            square: sums(&|row| column[row] * column[row]),
            with_residual: sums(&|row| column[row] * residual.values[row]),
            with_base: residual.basis.directions.iter().map(|direction| sums(&|row| column[row] * direction[row])).collect(),
        }
    }

    /// The squares that the rows `from..to` of the column explain.
    fn explained(&self, from: usize, to: usize) -> f64 {
        let of = |sums: &Vec<f64>| sums[to] - sums[from];
        let square = of(&self.square);
        let own = square - self.with_base.iter().map(|sums| of(sums).powi(2)).sum::<f64>();
        // A part that depends on the base explains nothing.
        if own > 1e-6 * square { of(&self.with_residual).powi(2) / own } else { 0.0 }
    }

    /// The best range of rows, with what it explains: all pairs of some rows, then refined row by row.
    fn best(&self, suffix_only: bool) -> (f64, (usize, usize)) {
        let rows = self.square.len() - 1;
        let step = rows.div_ceil(CHANGES).max(1);
        let mut places: Vec<usize> = (0..rows).step_by(step).collect();
        places.push(rows);
        let mut best = (0.0, (0, rows));
        let mut take = |from: usize, to: usize| {
            let is_whole = from == 0 && to == rows;
            if to >= from + SCALED && rows >= to - from + SCALED && !is_whole && (!suffix_only || to == rows) {
                let explained = self.explained(from, to);
                if explained > best.0 {
                    best = (explained, (from, to));
                }
            }
            best
        };
        for (k, from) in places.iter().enumerate() {
            for to in &places[k + 1..] {
                take(*from, *to);
            }
        }
        // One end at a time, until neither moves.
        for _ in 0..6 {
            let now = take(0, 0).1;
            for near in now.0.saturating_sub(step)..=(now.0 + step).min(rows) {
                take(near, now.1);
            }
            let moved = take(0, 0).1;
            for near in moved.1.saturating_sub(step)..=(moved.1 + step).min(rows) {
                take(moved.0, near);
            }
            if take(0, 0).1 == now {
                break;
            }
        }
        best
    }
}

/// A scale in a range of rows.
struct Scale {
    /// `None`: of the response.
    input: Option<usize>,
    range: (usize, usize),
    factor: f64,
    /// What the factor adds to the response, in all rows.
    added: Vec<f64>,
    /// The squares left.
    left: f64,
}

/// The response with the reading of an input divided by a factor.
fn with_input_divided(sample: &Sample, input: usize, factor: f64) -> Vec<f64> {
    let mut points = sample.points.clone();
    points[input].iter_mut().for_each(|value| *value /= factor);
    sample.polynomial(&points)
}

/// The change of the response for a factor 1 + g of an input, divided by g: -x df/dx.
fn relative_slope(sample: &Sample, input: usize) -> Vec<f64> {
    // The central difference over 10^-3 gives it to six digits.
    const SMALL: f64 = 1e-3;
    let (more, less) = (with_input_divided(sample, input, 1.0 + SMALL), with_input_divided(sample, input, 1.0 - SMALL));
    more.iter().zip(&less).map(|(more, less)| (more - less) / (2.0 * SMALL)).collect()
}

/// The share of the rows beyond the box that the correction of a scale brings into the box, if these rows prove it.
const BROUGHT_INSIDE: f64 = 0.9;

/// A scale of an input that moves readings out of the box: `near` has these rows too.
pub(super) fn scales_beyond(near: &Sample, all_rows: usize) -> Found {
    let found = scales(near, all_rows);
    let Some(fault) = found.faults.first() else { return found };
    let Some(input) = near.inputs.iter().position(|input| input.name == fault.column) else { return Found::default() };
    let factor = fault.numbers[0].1;
    let is_faulty = |place: usize| found.faults.iter().any(|it| (it.rows.0..=it.rows.1).contains(&place));
    let [low, high] = near.inputs[input].range;
    // The factor is an estimate, to about one per cent of the largest reading.
    let margin = 0.02 * (high - low);
    let is_beyond = |value: f64| value < low - margin || value > high + margin;
    let beyond: Vec<(usize, f64)> =
        near.places.iter().copied().zip(near.points[input].iter().copied()).filter(|(_, value)| is_beyond(*value)).collect();
    let brought = beyond.iter().filter(|(place, value)| is_faulty(*place) && !is_beyond(value / factor)).count();
    if brought as f64 >= BROUGHT_INSIDE * beyond.len() as f64 { found } else { Found::default() }
}

/// A sensor with another scale from a run on, or in a range of runs.
pub(super) fn scales(sample: &Sample, all_rows: usize) -> Found {
    let rows = sample.rows();
    let columns = base(sample);
    let residual = Residual::new(sample, &columns);
    let total = dot(&residual.values, &residual.values);
    let freedom = residual.freedom() - 1.0;
    let likelihood = |left: f64| rows as f64 * left.max(f64::MIN_POSITIVE * rows as f64).ln();
    let mut best: Option<Scale> = None;
    let mut take = |scale: Scale| {
        if best.as_ref().is_none_or(|best| scale.left < best.left) {
            best = Some(scale);
        }
    };
    let ends = |parts: &Parts| {
        // A range in the middle needs more than a change at one row: it has one more unknown.
        let (any, suffix) = (parts.best(false), parts.best(true));
        if likelihood(total - suffix.0) - likelihood(total - any.0) > BETTER { any } else { suffix }
    };
    let parts = Parts::new(&sample.nominal, &residual);
    let (explained, range) = ends(&parts);
    let amount = {
        let mut part = within(&sample.nominal, range);
        residual.basis.project_out(&mut part);
        dot(&part, &residual.values) / dot(&part, &part).max(f64::MIN_POSITIVE)
    };
    let added = within(&sample.nominal, range).iter().map(|value| amount * value).collect();
    take(Scale { input: None, range, factor: 1.0 + amount, added, left: total - explained });
    for input in (0..sample.inputs.len()).filter(|input| !sample.is_contrast(*input)) {
        if sample.surface.waves.iter().any(|wave| wave.input == sample.inputs[input].name) {
            continue;
        }
        let slope = relative_slope(sample, input);
        if slope.iter().any(|value| !value.is_finite()) {
            continue;
        }
        let (_, range) = ends(&Parts::new(&slope, &residual));
        let left = |factor: f64| {
            let moved = with_input_divided(sample, input, factor);
            let added: Vec<f64> = moved.iter().zip(&sample.nominal).map(|(moved, nominal)| moved - nominal).collect();
            let added = within(&added, range);
            let mut error: Vec<f64> = residual.values.iter().zip(&added).map(|(e, a)| e - a).collect();
            residual.basis.project_out(&mut error);
            (dot(&error, &error), added)
        };
        // Factors from a half to two in steps of 2 %, then the golden section within one step.
        let around = (-35..=35).map(|k| 1.02_f64.powi(k)).min_by(|a, b| left(*a).0.total_cmp(&left(*b).0)).unwrap_or(1.0);
        let (mut low, mut high) = (around / 1.02, around * 1.02);
        // 0.618^20 of 4 % is below 10^-5.
        for _ in 0..20 {
            let golden = 0.618_033_988_75 * (high - low);
            let (a, b) = (high - golden, low + golden);
            if left(a).0 < left(b).0 { high = b } else { low = a }
        }
        let factor = (low + high) / 2.0;
        let (left, added) = left(factor);
        take(Scale { input: Some(input), range, factor, added, left });
    }
    let Some(mut scale) = best else { return Found::default() };
    // Rivals: a shift of a range of rows, offsets of blocks.
    let shift = Parts::new(&vec![1.0; rows], &residual);
    let mut rivals = vec![total - shift.best(false).0];
    for (names, of) in sample.extras.iter().filter_map(|extra| extra.levels.as_ref()) {
        if names.len() * ROWS_PER_COLUMN > rows {
            continue;
        }
        let level = |k: usize| of.iter().map(|level| if *level == k { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
        let with_levels = Basis::of(columns.iter().cloned().chain((0..names.len()).map(level)).collect::<Vec<_>>().iter());
        let mut left = residual.values.clone();
        with_levels.project_out(&mut left);
        rivals.push(dot(&left, &left));
    }
    if rivals.iter().any(|rival| likelihood(*rival) - likelihood(scale.left) < BETTER) {
        return Found::default();
    }
    // The same file with the range, or with all other rows: the part that agrees with the file has the correct scale.
    let (from, to) = scale.range;
    let error: Vec<f64> = {
        let mut error: Vec<f64> = residual.values.iter().zip(&scale.added).map(|(e, a)| e - a).collect();
        residual.basis.project_out(&mut error);
        error
    };
    // Where neighbouring errors stay correlated, the surface lacks more than a scale: a range of rows of a map may imitate a part of that.
    if correlation(&error) > 0.0 && scale.left > MOST_LEFT * total {
        return Found::default();
    }
    let trials = (rows * rows / 2 * (1 + sample.inputs.len())) as f64;
    let ln_p = whitened_ln_p(sample, &columns, &scale.added, &error, freedom);
    let effect = (dot(&scale.added, &scale.added) / (to - from) as f64).sqrt();
    let noise = (scale.left / freedom).sqrt();
    // Where the factor changes little, as at a zero of the reading, noise decides which error is smaller.
    let shown: Vec<usize> = (from..to).filter(|row| scale.added[*row].abs() > noise).collect();
    let smaller = shown.iter().filter(|row| error[**row].abs() < (error[**row] + scale.added[**row]).abs()).count();
    let is_proven = ln_p + trials.ln() < CHANCE.ln()
        && effect > LEAST_EFFECT * noise
        && smaller as f64 >= SMALLER * shown.len() as f64
        && scale.factor > LEAST_FACTOR;
    if !is_proven {
        return Found::default();
    }
    let off = |rows: &mut dyn Iterator<Item = usize>| {
        median(&mut rows.map(|row| (sample.response[row] - sample.nominal[row]).abs()).collect::<Vec<f64>>())
    };
    if scale.input.is_none() && scale.factor < SMALL_FACTOR {
        let quotients =
            (from..to).map(|row| sample.response[row] / sample.nominal[row]).filter(|quotient| quotient.is_finite());
        scale.factor = median(&mut quotients.collect::<Vec<f64>>());
    }
    let is_inverse = off(&mut (from..to)) < off(&mut (0..rows).filter(|row| !(from..to).contains(row)));
    let mut faulty = vec![(from, to)];
    if is_inverse {
        scale.factor = 1.0 / scale.factor;
        faulty = [(0, from), (to, rows)].into_iter().filter(|(from, to)| from < to).collect();
    }
    let column = scale.input.map_or(&sample.surface.name, |input| &sample.inputs[input].name);
    let sensitivity: Vec<f64> = match scale.input {
        None => sample.nominal.iter().map(|value| value.abs()).collect(),
        Some(input) => relative_slope(sample, input).iter().map(|value| value.abs()).collect(),
    };
    let to_end = faulty.len() == 1 && faulty[0].1 == rows;
    let what = if to_end { "scaled from a run on" } else { "scaled in a range of runs" };
    let of_range = |(from, to): (usize, usize)| {
        // Rows outside the box between two ranges belong to the range before them; those after the last to the last.
        let first = if from == 0 { 0 } else { sample.places[from] };
        let last = if to == rows { all_rows - 1 } else { sample.places[to] - 1 };
        let sentence = format!("The reading of `{column}` is {} times the true value.", number(scale.factor));
        let mut fault = Fault::new(what, column, (first, last), sentence);
        fault.numbers = vec![("factor", scale.factor)];
        fault
    };
    // Beside the ends, rows in which the scale is within the noise may belong to either side.
    let change = (scale.factor - 1.0).abs();
    let is_small = |row: &usize| change * sensitivity[*row] < DOUBTFUL * noise;
    let ends = [from, to].into_iter().filter(|end| (1..rows).contains(end));
    let doubtful = ends
        .flat_map(|end| {
            (0..end).rev().take_while(is_small).chain((end..rows).take_while(is_small)).map(|row| sample.places[row])
        })
        .collect();
    Found { faults: faulty.into_iter().map(of_range).collect(), doubtful, dither: 0.0 }
}

/// A column in a range of rows, zero elsewhere.
fn within(column: &[f64], (from, to): (usize, usize)) -> Vec<f64> {
    (0..column.len()).map(|row| if (from..to).contains(&row) { column[row] } else { 0.0 }).collect()
}

/// The lag-one correlation of errors, 0 if it is not beyond two standard errors.
fn correlation(errors: &[f64]) -> f64 {
    let square = dot(errors, errors).max(f64::MIN_POSITIVE);
    let rho = errors.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / square;
    if rho > 2.0 / (errors.len() as f64).sqrt() { rho.min(0.99) } else { 0.0 }
}

/// ln of the probability that chance explains as much as a column, beside the base: all columns and the residual less the correlation of the errors
/// that are left with the column.
pub(super) fn whitened_ln_p(sample: &Sample, base: &[Vec<f64>], column: &[f64], error: &[f64], freedom: f64) -> f64 {
    let rho = correlation(error);
    let white = |values: &[f64]| -> Vec<f64> { values.windows(2).map(|pair| pair[1] - rho * pair[0]).collect() };
    let base: Vec<Vec<f64>> = base.iter().map(|column| white(column)).collect();
    let basis = Basis::of(&base);
    let (mut own, mut residual) = (white(column), white(&sample.residual()));
    basis.project_out(&mut own);
    basis.project_out(&mut residual);
    let taken = dot(&own, &residual).powi(2) / dot(&own, &own).max(f64::MIN_POSITIVE);
    let left = dot(&residual, &residual) - taken;
    ln_p_of_squares(taken, 1.0, left.max(f64::MIN_POSITIVE), freedom - 1.0)
}
