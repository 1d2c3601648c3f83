//! Faults that the readings of a response show by themselves: constant, stuck, clipped, quantised, rows written twice.
//!
//! In: new data of a response, the sample of its rows inside. Out: faults. The argument is always the same: noise of a fine resolution never repeats
//! a reading. The surface is used only to estimate the noise and to distinguish a clipped sensor from a stuck one. Inputs repeat their values by
//! intention, so their faults need a proof ([`super::proven_faults`]).

use rsm_core::order;
use std::collections::HashMap;

use rsm_core::model::Model;

use super::data::NewData;
use super::fault::{Fault, Found, ranges};
use super::proven_faults::{Residual, base, equal_runs};
use super::sample::Sample;

/// A response has a fine resolution if at most this share of its readings has a value that occurs three times or more, apart from the two most
/// frequent values (a stuck value, a limit). Rows written twice give pairs.
const REPEATED_SHARE: f64 = 0.1;

/// This many equal readings of a noisy sensor at different points, one after the other, are no chance. Two may be a row written twice.
const STUCK: usize = 4;

/// This many equal readings at the end of the range are a limit.
const CLIPPED: usize = 4;

/// The share of clipped rows at which the surface gives a value beyond the limit, or within four standard deviations below it.
const BEYOND: f64 = 0.9;
const NOISE: f64 = 4.0;

/// A step of this many standard deviations of the residual or more is reported. Of 1.5, the rounding errors (variance of a twelfth of the square of
/// the step) are a fifth of the variance of the residual.
const COARSE: f64 = 1.5;

/// A share of a step: the decimals of a file are rounded.
const ON_GRID: f64 = 1e-5;

/// The smallest distance of two readings may be two or three steps of the grid, if these readings are few.
const MOST_STEPS: u32 = 4;

/// Rows with equal readings are no duplicates if so many pairs are expected by chance.
const BY_CHANCE: f64 = 0.05;

/// Rows of a block that is written twice.
const BLOCK: usize = 3;

/// Repeated points share a part of their rounding error if their scatter is below this share of a step. With noise of half a step, rounding errors
/// are independent (B. Widrow, 1956): the scatter is then the root of 1/4 + 1/12, 0.577 of a step.
const SAME_ROUNDING: f64 = 0.55;

/// The counts of readings with the same value.
struct Counts(HashMap<u64, usize>);

impl Counts {
    fn of(values: &[f64]) -> Self {
        let mut counts = HashMap::new();
        values.iter().for_each(|value| *counts.entry(key(*value)).or_insert(0) += 1);
        Counts(counts)
    }

    fn at(&self, value: f64) -> usize {
        self.0.get(&key(value)).copied().unwrap_or(0)
    }

    fn is_fine(&self, rows: usize) -> bool {
        let mut counts: Vec<usize> = self.0.values().copied().collect();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        let frequent: usize = counts.iter().take(2).filter(|count| **count > 2).sum();
        let repeated: usize = counts.iter().skip(2).filter(|count| **count > 2).sum();
        repeated as f64 <= REPEATED_SHARE * (rows - frequent) as f64
    }
}

/// Minus zero and zero are one reading.
fn key(value: f64) -> u64 {
    (value + 0.0).to_bits()
}

/// The faults of a response.
pub(super) fn faults(model: &Model, index: usize, data: &NewData, sample: &Sample) -> Found {
    let values = data.responses[index].as_ref().expect("a compared surface has a response");
    let surface = &model.surfaces[index];
    let (name, rows) = (surface.name.as_str(), values.len());
    let counts = Counts::of(values);
    let inputs: Vec<&Vec<f64>> = data.inputs.iter().filter(|column| !column.is_empty()).collect();
    let same_point = |a: usize, b: usize| inputs.iter().all(|column| column[a] == column[b]);
    let mut found = Found::default();
    let moves = sample.nominal.iter().any(|value| *value != sample.nominal[0]);
    if moves && values.iter().all(|value| *value == values[0]) {
        let sentence = format!("The sensor of `{name}` reads {}{} in all rows.", values[0], unit(&surface.unit));
        found.faults.push(Fault::new("constant", name, (0, rows - 1), sentence));
        return found;
    }
    let noise = Residual::new(sample, &base(sample)).noise;
    let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    // Simulated data without noise: equal points give equal readings.
    if noise <= 1e-9 * largest {
        return found;
    }
    if !counts.is_fine(rows) {
        found.quantised(sample, values, noise, &surface.unit, name, &same_point);
        return found;
    }
    let step = grid(values);
    if let Some(step) = step.filter(|step| *step > COARSE * noise) {
        found.faults.push(quantised(name, &surface.unit, step, rows, noise));
    }
    // The surface at the rows inside.
    let mut computed = vec![None; rows];
    sample.places.iter().zip(&sample.nominal).for_each(|(row, value)| computed[*row] = Some(*value));
    let mut faulty = vec![false; rows];
    // Whether readings at one point differ. Otherwise equal readings at one point may be a simulation.
    let mut seen: HashMap<Vec<u64>, f64> = HashMap::new();
    let differ = (0..rows).any(|row| {
        let point: Vec<u64> = inputs.iter().map(|column| key(column[row])).collect();
        *seen.entry(point).or_insert(values[row]) != values[row]
    });
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    for (limit, side, words) in [(low, -1.0, "below"), (high, 1.0, "above")] {
        let at: Vec<usize> = (0..rows).filter(|row| values[*row] == limit).collect();
        let at_one_point = at.iter().all(|row| same_point(*row, at[0]));
        if at.len() < CLIPPED || step.is_some_and(|step| step > COARSE * noise) || (at_one_point && !differ) {
            continue;
        }
        let inside: Vec<f64> = at.iter().filter_map(|row| computed[*row]).collect();
        let beyond = inside.iter().filter(|value| side * (**value - limit) > -NOISE * noise).count();
        if beyond as f64 >= BEYOND * inside.len() as f64 {
            at.iter().for_each(|row| faulty[*row] = true);
            // Near the limit only low noise shows: such readings are a biased sample. The surface selects rows without bias.
            let near = sample.places.iter().zip(&sample.nominal).filter(|(_, value)| side * (**value - limit) > -NOISE * noise);
            found.doubtful.extend(near.map(|(row, _)| *row));
            for range in ranges(&at) {
                let unit = unit(&surface.unit);
                found.faults.push(Fault::new(
                    "clipped",
                    name,
                    range,
                    format!("The sensor of `{name}` does not read {words} {limit}{unit}."),
                ));
            }
        }
    }
    for (first, last) in equal_runs(values) {
        if last - first + 1 >= STUCK && !faulty[first] && (first..=last).any(|row| !same_point(row, first)) {
            faulty[first..=last].fill(true);
            let sentence = format!("The sensor of `{name}` repeats {}{}.", values[first], unit(&surface.unit));
            found.faults.push(Fault::new("stuck", name, (first, last), sentence));
        }
    }
    let again = written_twice(values, &inputs, &faulty, step.map_or(0.0, |step| step / noise), &counts);
    for range in again {
        let what = if range.1 - range.0 + 1 >= BLOCK { "duplicated block" } else { "duplicated row" };
        found.faults.push(Fault::new(what, "row", range, "All readings repeat those of an earlier row.".to_string()));
    }
    found
}

/// ` V`; nothing for a number without unit.
fn unit(unit: &str) -> String {
    if unit == "1" { String::new() } else { format!(" {unit}") }
}

fn quantised(name: &str, unit_of: &str, step: f64, rows: usize, noise: f64) -> Fault {
    let sentence = format!(
        "`{name}` is rounded to steps of {step:.4}{}, {:.1} standard deviations of the residual.",
        unit(unit_of),
        step / noise
    );
    Fault { numbers: vec![("step", step)], is_left_out: false, ..Fault::new("quantised", name, (0, rows - 1), sentence) }
}

impl Found {
    /// A response of which many readings are equal: its step, and the rows whose rounding error is that of another row at the same point.
    fn quantised(
        &mut self,
        sample: &Sample,
        values: &[f64],
        noise: f64,
        unit: &str,
        name: &str,
        same_point: &dyn Fn(usize, usize) -> bool,
    ) {
        let Some(step) = grid(values).filter(|step| *step > COARSE * noise) else { return };
        self.faults.push(quantised(name, unit, step, values.len(), noise));
        let mut order: Vec<usize> = sample.places.clone();
        let point = |row: usize| {
            sample.places.binary_search(&row).map(|k| sample.points.iter().map(|it| it[k]).collect()).unwrap_or_default()
        };
        let points: HashMap<usize, Vec<f64>> = order.iter().map(|row| (*row, point(*row))).collect();
        order.sort_by(|a, b| {
            let by = points[a].iter().zip(&points[b]).map(|(a, b)| a.total_cmp(b));
            by.into_iter().find(|it| it.is_ne()).unwrap_or(a.cmp(b))
        });
        let groups: Vec<&[usize]> = order.chunk_by(|a, b| same_point(*a, *b)).collect();
        let (mut square, mut freedom) = (0.0, 0.0);
        for group in groups.iter().filter(|group| group.len() > 1) {
            let mean = group.iter().map(|row| values[*row]).sum::<f64>() / group.len() as f64;
            square += group.iter().map(|row| (values[*row] - mean).powi(2)).sum::<f64>();
            freedom += group.len() as f64 - 1.0;
        }
        if freedom > 0.0 && (square / freedom).sqrt() < SAME_ROUNDING * step {
            self.doubtful.extend(groups.iter().flat_map(|group| &group[1..]));
            self.dither = step;
        }
        // In a slow sweep too, neighbours share their rounding error until the response has moved by a step.
        if Residual::new(sample, &base(sample)).is_correlated() {
            let mut last: Option<f64> = None;
            for (row, value) in sample.places.iter().zip(&sample.nominal) {
                if last.is_some_and(|last| (value - last).abs() < step) {
                    self.doubtful.push(*row);
                } else {
                    last = Some(*value);
                }
            }
            self.dither = step;
        }
    }
}

/// The step of which all readings are multiples, beside a common offset. `None` if there is none above the resolution of numbers.
fn grid(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    order::sort(&mut sorted);
    sorted.dedup();
    let largest = sorted.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let smallest = sorted
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|difference| *difference > 1e-9 * largest)
        .fold(f64::INFINITY, f64::min);
    if !smallest.is_finite() {
        return None;
    }
    let on_grid = |step: f64| {
        sorted.iter().all(|value| {
            let steps = (value - sorted[0]) / step;
            // The rounding of the readings themselves, in steps.
            (steps - steps.round()).abs() <= ON_GRID + 4.0 * f64::EPSILON * largest / step
        })
    };
    (1..=MOST_STEPS).map(|steps| smallest / f64::from(steps)).find(|step| on_grid(*step))
}

/// Rows whose readings all repeat those of an earlier row, as ranges. `step` is the resolution in standard deviations of the noise.
fn written_twice(values: &[f64], inputs: &[&Vec<f64>], faulty: &[bool], step: f64, counts: &Counts) -> Vec<(usize, usize)> {
    let rows = values.len();
    let mut seen: HashMap<Vec<u64>, usize> = HashMap::new();
    let mut points: HashMap<Vec<u64>, usize> = HashMap::new();
    let mut earlier = vec![None; rows];
    for row in 0..rows {
        let point: Vec<u64> = inputs.iter().map(|column| key(column[row])).collect();
        *points.entry(point.clone()).or_insert(0) += 1;
        if counts.at(values[row]) < 2 || faulty[row] {
            continue;
        }
        let mut all = point;
        all.push(key(values[row]));
        earlier[row] = seen.get(&all).copied();
        seen.insert(all, row);
    }
    // Readings of normal noise at one point: two are equal with a probability of the step times the mean density, 1/(2 root pi).
    let pairs: f64 = points.values().map(|count| (count * (count - 1)) as f64 / 2.0).sum();
    let by_chance = pairs * step / (2.0 * std::f64::consts::PI.sqrt());
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for (row, source) in earlier.iter().enumerate() {
        let Some(source) = source else { continue };
        match ranges.last_mut() {
            Some(range) if row == range.1 + 1 && earlier[row - 1] == source.checked_sub(1) => range.1 = row,
            _ => ranges.push((row, row)),
        }
    }
    ranges.retain(|range| by_chance < BY_CHANCE || range.1 - range.0 + 1 >= BLOCK);
    ranges
}
