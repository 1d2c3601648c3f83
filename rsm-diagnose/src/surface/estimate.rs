//! The parameters of a cause, with their intervals.
//!
//! In: a sample and its explanation. Out: the unknowns of each cause with standard errors; and the explanation with the columns of input sensors
//! updated to the estimate. Gain and bias of an input sensor act through the polynomial, which is not linear, so these columns are iterated
//! (Gauss-Newton). Never adds or removes a cause.

use super::explained::{Explained, refit, solved};
use super::hypotheses::{HypothesisKind, moved};
use super::sample::Sample;
use crate::engine::columns::{LeastSquares, dot, solve};
use crate::engine::significance::t_of;

/// The estimated unknowns of one cause.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterEstimates {
    /// One estimate for each column.
    pub values: Vec<f64>,
    /// Half the width of the 95 % interval of each.
    pub halves: Vec<f64>,
}

/// Estimates of all causes of an explanation.
#[derive(Debug, Clone)]
pub struct Estimates {
    /// In the order of the set.
    pub causes: Vec<ParameterEstimates>,
    /// The residual standard deviation in whitened units.
    pub sd: f64,
    /// Its degrees of freedom.
    pub freedom: f64,
}

/// Gauss-Newton steps. They converge quadratically; if they have not converged after these, they never do.
const STEPS: usize = 15;

/// The smallest gain of a sensor; the largest is its inverse. Beyond these it would be another sensor.
const LEAST_GAIN: f64 = 0.3;

/// The two-sided probability outside an interval.
const OUTSIDE: f64 = 0.05;

/// Updates the columns of input sensors to the estimate.
pub(super) fn refine(sample: &Sample, found: &mut Explained) {
    let moves = |kind: &HypothesisKind| matches!(kind, HypothesisKind::InputGain(_) | HypothesisKind::InputBias(_));
    if !found.set.iter().any(|it| moves(&it.kind)) {
        return;
    }
    let inputs = sample.inputs.len();
    let space = found.space(sample);
    let start = solved(sample, &found.set, &space);
    // (gain, bias) of every input.
    let mut sensors = vec![(1.0, 0.0); inputs];
    let mut place = 0;
    for it in &found.set {
        match it.kind {
            HypothesisKind::InputGain(input) => {
                sensors[input].0 = (1.0 + start.coefficients[place]).clamp(LEAST_GAIN, 1.0 / LEAST_GAIN);
            }
            HypothesisKind::InputBias(input) => sensors[input].1 = start.coefficients[place],
            _ => {}
        }
        place += it.columns.len();
    }
    for _ in 0..STEPS {
        let base = at(sample, &sensors);
        let mut columns = Vec::new();
        for it in &found.set {
            match it.kind {
                HypothesisKind::InputGain(input) => {
                    columns.push(space.in_whitened_space(&slope(sample, &sensors, input, (1e-4, 0.0))));
                }
                HypothesisKind::InputBias(input) => {
                    let [low, high] = sample.inputs[input].range;
                    columns.push(space.in_whitened_space(&slope(sample, &sensors, input, (0.0, 1e-4 * (high - low)))));
                }
                HypothesisKind::ResponseGain => columns.push(space.in_whitened_space(&base)),
                _ => columns.extend(it.columns.iter().map(|column| space.in_whitened_space(column))),
            }
        }
        let left: Vec<f64> = sample.response.iter().zip(&base).map(|(y, f)| y - f).collect();
        let solved = solve(&columns, &space.in_whitened_space(&left));
        let mut place = 0;
        let mut largest: f64 = 0.0;
        for it in &found.set {
            let step = solved.coefficients[place];
            match it.kind {
                HypothesisKind::InputGain(input) => {
                    // At most a fifth in one step, because the polynomial is not linear.
                    let step = step.clamp(-0.2, 0.2);
                    sensors[input].0 = (sensors[input].0 + step).clamp(LEAST_GAIN, 1.0 / LEAST_GAIN);
                    largest = largest.max(step.abs());
                }
                HypothesisKind::InputBias(input) => {
                    let width = sample.inputs[input].range[1] - sample.inputs[input].range[0];
                    let step = step.clamp(-0.1 * width, 0.1 * width);
                    sensors[input].1 = (sensors[input].1 + step).clamp(-0.5 * width, 0.5 * width);
                    largest = largest.max((step / width).abs());
                }
                _ => {}
            }
            place += it.columns.len();
        }
        if largest < 1e-9 {
            break;
        }
    }
    let base = at(sample, &sensors);
    for it in &mut found.set {
        match it.kind {
            // The gain is applied first, then the bias; their sum is the whole change.
            HypothesisKind::InputGain(input) => {
                let gain = sensors[input].0;
                it.columns = vec![secant(&moved(sample, input, (gain, 0.0)), &sample.nominal, gain - 1.0)];
            }
            HypothesisKind::InputBias(input) => {
                let (gain, bias) = sensors[input];
                let without = moved(sample, input, (gain, 0.0));
                it.columns = vec![secant(&moved(sample, input, (gain, bias)), &without, bias)];
            }
            HypothesisKind::ResponseGain => it.columns = vec![base.clone()],
            _ => {}
        }
    }
    refit(sample, found);
}

/// Gains and biases of each input's sensor that are not ruled out: ends and middle of twice the 95 % interval; only (1, 0) for an input without such
/// a cause. `None` if no input sensor is named. The interval is doubled because rows are selected by it: the one in twenty intervals that is wrong
/// would remove the rows that could correct it.
pub(super) fn plausible_sensors(sample: &Sample, found: &Explained, estimates: &Estimates) -> Option<Vec<Vec<(f64, f64)>>> {
    let mut gains = vec![vec![1.0]; sample.inputs.len()];
    let mut biases = vec![vec![0.0]; sample.inputs.len()];
    let mut is_named = false;
    for (it, numbers) in found.set.iter().zip(&estimates.causes) {
        let (value, half) = (numbers.values[0], 2.0 * numbers.halves[0]);
        let believed = [value - half, value, value + half];
        match it.kind {
            // A gain near zero would move every reading into the range.
            HypothesisKind::InputGain(input) => gains[input] = believed.iter().map(|it| (1.0 + it).max(LEAST_GAIN)).collect(),
            HypothesisKind::InputBias(input) => biases[input] = believed.to_vec(),
            _ => continue,
        }
        is_named = true;
    }
    let pairs = |(gains, biases): (&Vec<f64>, &Vec<f64>)| {
        gains.iter().flat_map(|gain| biases.iter().map(move |bias| (*gain, *bias))).collect()
    };
    is_named.then(|| gains.iter().zip(&biases).map(pairs).collect())
}

fn secant(there: &[f64], here: &[f64], change: f64) -> Vec<f64> {
    // If nothing changes, the column is zero, so the cause gains nothing.
    let change = if change.abs() < 1e-12 { f64::INFINITY } else { change };
    there.iter().zip(here).map(|(a, b)| (a - b) / change).collect()
}

/// The polynomial at the true inputs, for these sensors.
fn at(sample: &Sample, sensors: &[(f64, f64)]) -> Vec<f64> {
    let mut points = sample.points.clone();
    for (column, (gain, bias)) in points.iter_mut().zip(sensors) {
        column.iter_mut().for_each(|xi| *xi = (*xi - bias) / gain);
    }
    sample.polynomial(&points)
}

/// Its derivative with respect to the gain or bias of one input, by a central difference with an error of second order.
fn slope(sample: &Sample, sensors: &[(f64, f64)], input: usize, (gain, bias): (f64, f64)) -> Vec<f64> {
    let with = |sign: f64| {
        let mut sensors = sensors.to_vec();
        sensors[input].0 += sign * gain;
        sensors[input].1 += sign * bias;
        at(sample, &sensors)
    };
    secant(&with(1.0), &with(-1.0), 2.0 * (gain + bias))
}

/// The parameters of every cause.
pub(super) fn numbers(sample: &Sample, found: &Explained) -> Estimates {
    let space = found.space(sample);
    let solved: LeastSquares = solved(sample, &found.set, &space);
    let freedom = space.rows().saturating_sub(solved.rank).max(1) as f64;
    let sd = (dot(&solved.residual, &solved.residual) / freedom).sqrt();
    let t = t_of(OUTSIDE, freedom);
    let mut place = 0;
    let mut causes = Vec::new();
    for it in &found.set {
        let range = place..place + it.columns.len();
        let halves = range.clone().map(|k| t * sd * solved.covariance[k][k].sqrt()).collect();
        causes.push(ParameterEstimates { values: solved.coefficients[range.clone()].to_vec(), halves });
        place = range.end;
    }
    Estimates { causes, sd, freedom }
}
