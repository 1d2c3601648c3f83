//! A response that depends on the direction in which an input is approached: play, hysteresis, a sensor that lags.
//!
//! In: a sample without the faults found before, all rows in run order. Out: the fault, and the amount that the direction adds to each row. The test
//! is that of [`super::proven_faults`]: the terms of the file, those of the next order and a drift may have other coefficients.

use rsm_core::model::Model;

use super::data::NewData;
use super::fault::Fault;
use super::proven_faults::{CHANCE, base, whitened_ln_p, with_unit};
use super::sample::Sample;
use crate::engine::columns::{Basis, dot};

/// The least reversals of an input, and the least share of rows in each direction. Rows of a map approach their first point backwards, one in twenty.
const REVERSALS: usize = 6;
const EACH_WAY: f64 = 0.2;

/// The highest power of the input in the base of the test of directions: the mean direction of a random design is a function of the input.
const POWERS: i32 = 5;

/// The mean direction effect over its standard error between reversals. With few reversals, the largest possible value times a share.
const BETWEEN_REVERSALS: f64 = 4.0;
const OF_POSSIBLE: f64 = 0.8;

/// A response that depends on the direction of approach.
pub(super) struct DirectionCorrection {
    /// The fault.
    pub fault: Fault,
    /// Rows in run order, each with the amount that the direction adds.
    pub rows: Vec<(usize, f64)>,
    /// Rows before the first movement: their direction is unknown.
    pub unknown: Vec<usize>,
}

/// The direction of the last movement of an input, for each row; 0 before the first.
fn directions(values: &[f64]) -> Vec<f64> {
    let mut way = 0.0;
    (0..values.len())
        .map(|row| {
            if row > 0 && values[row] != values[row - 1] {
                way = (values[row] - values[row - 1]).signum();
            }
            way
        })
        .collect()
}

/// Tests every input for an effect of its direction: an offset of the response, or lost motion of the input.
pub(super) fn direction(model: &Model, sample: &Sample, data: &NewData) -> Option<DirectionCorrection> {
    let rows = sample.rows();
    let residual = sample.residual();
    let mut best: Option<(f64, usize, bool, Vec<f64>, f64, f64)> = None;
    for (input, it) in sample.inputs.iter().enumerate().filter(|(input, _)| !sample.is_contrast(*input)) {
        let way = column_ways(model, sample, data, input)?;
        let reversals = way.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let ups = way.iter().filter(|way| **way > 0.0).count() as f64 / rows as f64;
        if reversals < REVERSALS || !(EACH_WAY..=1.0 - EACH_WAY).contains(&ups) {
            continue;
        }
        let coded = sample.coded(input);
        let mut columns = base(sample);
        columns.extend((2..=POWERS).map(|power| coded.iter().map(|x| x.powi(power)).collect::<Vec<f64>>()));
        let half = (it.range[1] - it.range[0]) / 2.0;
        let slope = {
            let moved = |by: f64| {
                let mut points = sample.points.clone();
                points[input].iter_mut().for_each(|x| *x += by);
                sample.polynomial(&points)
            };
            // The central difference over 10^-3 of half the range gives the slope to six digits.
            let (more, less) = (moved(1e-3 * half), moved(-1e-3 * half));
            more.iter().zip(&less).map(|(more, less)| (more - less) / (2e-3 * half)).collect::<Vec<f64>>()
        };
        let lost: Vec<f64> = slope.iter().zip(&way).map(|(slope, way)| -slope * way).collect();
        let basis = Basis::of(&columns);
        let mut left = residual.clone();
        basis.project_out(&mut left);
        for (is_lost_motion, column) in [(false, way.clone()), (true, lost)] {
            let mut own = column.clone();
            basis.project_out(&mut own);
            let square = dot(&own, &own);
            // A direction that is a function of the inputs cannot be distinguished from an error of the surface.
            if !square.is_finite() || square < 0.05 * dot(&column, &column) || square <= 0.0 {
                continue;
            }
            let amount = dot(&own, &left) / square;
            let error: Vec<f64> = left.iter().zip(&own).map(|(e, c)| e - amount * c).collect();
            let freedom = rows.saturating_sub(basis.rank() + 1).max(2) as f64;
            let ln_p = whitened_ln_p(sample, &columns, &column, &error, freedom) + (2.0 * sample.inputs.len() as f64).ln();
            // Between two reversals, errors may have a common cause: each such piece counts once.
            let mut pieces = vec![0.0];
            for row in 0..rows {
                if row > 0 && way[row] != way[row - 1] {
                    pieces.push(0.0);
                }
                *pieces.last_mut().expect("there is one") += own[row] * left[row];
            }
            let t = pieces.iter().sum::<f64>().abs() / dot(&pieces, &pieces).sqrt().max(f64::MIN_POSITIVE);
            if ln_p < CHANCE.ln()
                && t >= BETWEEN_REVERSALS.min(OF_POSSIBLE * (pieces.len() as f64).sqrt())
                && best.as_ref().is_none_or(|best| ln_p < best.0)
            {
                let deviation = (dot(&error, &error) / freedom / square).sqrt();
                best = Some((ln_p, input, is_lost_motion, column, amount, deviation));
            }
        }
    }
    let (_, index, is_lost_motion, column, mut amount, deviation) = best?;
    let ways = column_ways(model, sample, data, index)?;
    let mut added: Vec<f64> = column.iter().map(|column| amount * column).collect();
    if is_lost_motion {
        (amount, added) = lost_motion(sample, index, &ways, amount);
    }
    let (input, surface) = (&sample.inputs[index], &sample.surface);
    let half = 1.96 * deviation;
    let (name, sentence) = if is_lost_motion {
        let size = with_unit(amount.abs(), &input.unit);
        let words = format!(
            "`{}` depends on the direction in which `{}` is approached, as if the input {} its reading by {size}.",
            surface.name,
            input.name,
            if amount > 0.0 { "lagged behind" } else { "led" }
        );
        ("lag", words)
    } else {
        let size = with_unit(amount.abs(), &surface.unit);
        let words = format!(
            "`{}` depends on the direction in which `{}` is approached: {size} {} for rising values, as much {} for falling ones.",
            surface.name,
            input.name,
            if amount > 0.0 { "higher" } else { "lower" },
            if amount > 0.0 { "lower" } else { "higher" }
        );
        ("half_difference", words)
    };
    let fault = Fault {
        what: "depends on the direction of approach",
        column: surface.name.clone(),
        rows: (0, data.rows() - 1),
        numbers: vec![(name, amount), ("low", amount - half), ("high", amount + half)],
        input: Some(input.name.clone()),
        is_left_out: false,
        sentence,
    };
    let rows = sample.places.iter().copied().zip(added).collect();
    let unknown = sample.places.iter().zip(&ways).filter(|(_, way)| **way == 0.0).map(|(place, _)| *place).collect();
    Some(DirectionCorrection { fault, rows, unknown })
}

/// The directions of an input at the rows of a sample. Rows that are not in the sample count as movements too.
fn column_ways(model: &Model, sample: &Sample, data: &NewData, input: usize) -> Option<Vec<f64>> {
    let place = model.inputs.iter().position(|other| other.name == sample.inputs[input].name)?;
    let ways = directions(&data.inputs[place]);
    Some(sample.places.iter().map(|place| ways[*place]).collect())
}

/// The lag of an input behind its reading that leaves the smallest error, and what it adds to the response. The linear estimate is the start.
fn lost_motion(sample: &Sample, input: usize, way: &[f64], linear: f64) -> (f64, Vec<f64>) {
    let basis = Basis::of(&base(sample));
    let added = |lag: f64| -> Vec<f64> {
        let mut points = sample.points.clone();
        points[input].iter_mut().zip(way).for_each(|(x, way)| *x -= lag * way);
        sample.polynomial(&points).iter().zip(&sample.nominal).map(|(moved, nominal)| moved - nominal).collect()
    };
    let left = |lag: f64| {
        let mut error: Vec<f64> = sample.residual().iter().zip(added(lag)).map(|(e, a)| e - a).collect();
        basis.project_out(&mut error);
        dot(&error, &error)
    };
    // The second derivative changes a lag of a tenth of the range by less than half.
    let (mut low, mut high) = (0.5 * linear, 1.5 * linear);
    // 0.618^20 is below 10^-4.
    for _ in 0..20 {
        let golden = 0.618_033_988_75 * (high - low);
        let (a, b) = (high - golden, low + golden);
        if left(a) < left(b) { high = b } else { low = a }
    }
    let lag = (low + high) / 2.0;
    (lag, added(lag))
}
