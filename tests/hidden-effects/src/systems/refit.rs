//! Decides whether another explanation has the same effect on the records. Records are compared after an optimal choice of everything that a
//! diagnosis may choose.
//!
//! In: records without noise, a plant with a nominal file, causes with first numbers; the noise of an output that was not recorded is infinite. Out:
//! the smallest misfit over the parameters within their tolerance, the starts of the records and the numbers of the causes, by the method of K.
//! Levenberg, 1944, with finite differences. There is no list of similar effects: similarity is determined by simulation.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::{Cause, Truth, run};
use crate::plant::Record;

/// A record without noise, and the true outputs at its start.
#[derive(Debug, Clone)]
pub struct Trace {
    /// The record, with all sensor effects except noise.
    pub record: Record,
    /// Outputs at the start, before any sensor.
    pub start: Vec<f64>,
}

/// The permitted change of a parameter, in its standard deviations: beyond 2 it is a cause (docs/book/src/reference/formats.md 4.3), and an estimate
/// has an error.
const FREE: f64 = 2.5;

/// The number of compared rows of a record.
const COMPARED: usize = 400;

/// The number of steps of the method. If a step does not at least halve a misfit, further steps would not either.
const STEPS: usize = 8;

/// The best result of an explanation.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The root mean square over the rows at the output where it is largest, in units of noise.
    pub misfit: f64,
    /// The causes with the numbers of this result.
    pub causes: Vec<Cause>,
}

/// An unknown of the fit.
#[derive(Debug, Clone, Copy)]
enum Unknown {
    /// A parameter with a tolerance: its index, its standard deviation.
    Parameter(usize, f64),
    /// The start of an output: record, output.
    Start(usize, usize),
    /// A number: cause, number.
    Number(usize, usize),
}

struct Problem<'a> {
    file: &'a Truth,
    causes: &'a [Cause],
    traces: &'a [Trace],
    noise: &'a [f64],
    unknowns: Vec<Unknown>,
}

/// Numbers that are changed by a sum; all others are changed by a factor and keep their sign.
const BY_A_SUM: [&str; 5] = ["phase", "rest", "low", "high", "ambient"];
/// Numbers that are not changed: integers, and one of which a record is not a smooth function.
const FIXED: [&str; 2] = ["cycles", "step"];

impl Problem<'_> {
    fn truth(&self, values: &[f64]) -> Truth {
        let mut truth = self.file.clone();
        truth.causes = self.causes.to_vec();
        for (unknown, value) in self.unknowns.iter().zip(values) {
            match *unknown {
                Unknown::Parameter(place, sigma) => truth.parameters[place] *= 1.0 + sigma * value,
                Unknown::Number(cause, number) => {
                    let (name, it) = &mut truth.causes[cause].numbers[number];
                    if BY_A_SUM.contains(&name.as_str()) {
                        *it += 0.1 * it.abs().max(0.1) * value;
                    } else {
                        *it *= (0.1 * value).exp();
                        if name == "inertia_ratio" {
                            *it = it.min(0.95);
                        }
                    }
                }
                Unknown::Start(..) => {}
            }
        }
        truth
    }

    /// Misfits of a record in units of noise, for each output, at the compared rows. A simulation that fails has an infinite misfit.
    fn misfits(&self, values: &[f64], which: usize) -> Vec<Vec<f64>> {
        let trace = &self.traces[which];
        let truth = self.truth(values);
        let mut start = trace.start.clone();
        for (unknown, value) in self.unknowns.iter().zip(values) {
            if let Unknown::Start(record, output) = *unknown
                && record == which
            {
                start[output] += self.file.system.outputs[output].noise * value;
            }
        }
        let simulated = catch_unwind(AssertUnwindSafe(|| {
            let mut record = run::again(&truth, &start, &trace.record.inputs);
            run::finish(&truth, &mut record);
            record
        }));
        let rows = trace.record.inputs[0].len();
        let every = rows.div_ceil(COMPARED);
        let outputs = trace.record.outputs.iter().enumerate();
        outputs
            .map(|(output, true_column)| {
                (0..rows)
                    .step_by(every)
                    .map(|row| match &simulated {
                        Ok(record) => (record.outputs[output][row] - true_column[row]) / self.noise[output],
                        Err(_) => f64::INFINITY,
                    })
                    .collect()
            })
            .collect()
    }

    fn all(&self, values: &[f64]) -> Vec<Vec<Vec<f64>>> {
        (0..self.traces.len()).map(|which| self.misfits(values, which)).collect()
    }
}

fn square(misfits: &[Vec<Vec<f64>>]) -> f64 {
    misfits.iter().flatten().flatten().map(|it| it * it).sum()
}

fn worst(misfits: &[Vec<Vec<f64>>]) -> f64 {
    let outputs = misfits.first().map_or(0, Vec::len);
    let of = |output: usize| {
        let all: Vec<f64> = misfits.iter().flat_map(|it| it[output].iter().map(|it| it * it)).collect();
        (all.iter().sum::<f64>() / all.len().max(1) as f64).sqrt()
    };
    (0..outputs).map(of).fold(0.0, f64::max)
}

/// The smallest misfit of a nominal file with these causes for these records; the numbers of the causes are first guesses. It stops when the misfit
/// is below `enough`.
pub fn refit(file: &Truth, causes: &[Cause], traces: &[Trace], noise: &[f64], enough: f64) -> Fitted {
    let system = file.system;
    let is_error = |name: &str| causes.iter().any(|it| it.kind == "parameter-error" && it.at == name);
    let tolerance = system.tolerance.iter().filter(|(name, _)| !is_error(name));
    let mut unknowns: Vec<Unknown> = tolerance.map(|(name, sigma)| Unknown::Parameter(file.place(name), *sigma)).collect();
    for (cause, it) in causes.iter().enumerate() {
        let moved = it.numbers.iter().enumerate().filter(|(_, it)| !FIXED.contains(&it.0.as_str()) && it.1 != 0.0);
        unknowns.extend(moved.map(|(number, _)| Unknown::Number(cause, number)));
    }
    for record in 0..traces.len() {
        unknowns.extend((0..system.outputs.len()).map(|output| Unknown::Start(record, output)));
    }
    let problem = Problem { file, causes, traces, noise, unknowns };
    let n = problem.unknowns.len();
    let mut values = vec![0.0; n];
    let mut misfits = problem.all(&values);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let before = square(&misfits);
        if !before.is_finite() || worst(&misfits) < enough {
            break;
        }
        // A hundredth of a unit: a thousandth of a number, a hundredth of a tolerance.
        const STEP: f64 = 0.01;
        let columns: Vec<Vec<Option<Vec<f64>>>> = (0..n)
            .map(|place| {
                let mut moved = values.clone();
                moved[place] += STEP;
                let only = match problem.unknowns[place] {
                    Unknown::Start(record, _) => Some(record),
                    _ => None,
                };
                (0..traces.len())
                    .map(|which| {
                        only.is_none_or(|it| it == which).then(|| {
                            let there = problem.misfits(&moved, which);
                            let pairs = there.iter().flatten().zip(misfits[which].iter().flatten());
                            pairs.map(|(there, here)| (there - here) / STEP).collect()
                        })
                    })
                    .collect()
            })
            .collect();
        let here: Vec<Vec<f64>> = misfits.iter().map(|it| it.iter().flatten().copied().collect()).collect();
        let dot = |one: &[f64], other: &[f64]| one.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
        let mut normal = vec![vec![0.0; n]; n];
        let mut right = vec![0.0; n];
        for i in 0..n {
            for which in 0..traces.len() {
                let Some(one) = &columns[i][which] else { continue };
                right[i] -= dot(one, &here[which]);
                for (j, column) in columns.iter().enumerate().take(i + 1) {
                    if let Some(other) = &column[which] {
                        normal[i][j] += dot(one, other);
                    }
                }
            }
        }
        let mut is_better = false;
        for _ in 0..5 {
            let mut damped = normal.clone();
            (0..n).for_each(|i| damped[i][i] += damping * damped[i][i] + 1e-9);
            let step = solve(damped, &right);
            let mut next: Vec<f64> = values.iter().zip(&step).map(|(value, step)| value + step).collect();
            for (unknown, value) in problem.unknowns.iter().zip(&mut next) {
                match unknown {
                    Unknown::Parameter(..) => *value = value.clamp(-FREE, FREE),
                    Unknown::Number(..) => *value = value.clamp(-20.0, 20.0),
                    Unknown::Start(..) => {}
                }
            }
            let there = problem.all(&next);
            let after = square(&there);
            if after.is_finite() && after < before {
                is_better = after < 0.98 * before;
                (values, misfits) = (next, there);
                damping *= 0.1;
                break;
            }
            damping *= 10.0;
        }
        if !is_better {
            break;
        }
    }
    Fitted { misfit: worst(&misfits), causes: problem.truth(&values).causes }
}

/// Solves a symmetric positive system, given by its lower half, with the factors of A.-L. Cholesky. The unknown of a dependent column is not changed.
fn solve(mut a: Vec<Vec<f64>>, right: &[f64]) -> Vec<f64> {
    let n = right.len();
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - sum;
            a[i][j] = if i != j {
                if a[j][j] == 0.0 { 0.0 } else { rest / a[j][j] }
            } else if rest > 1e-12 * a[i][i].abs() {
                rest.sqrt()
            } else {
                0.0
            };
        }
    }
    let mut x = right.to_vec();
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| a[i][k] * x[k]).sum();
        x[i] = if a[i][i] == 0.0 { 0.0 } else { (x[i] - sum) / a[i][i] };
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| a[k][i] * x[k]).sum();
        x[i] = if a[i][i] == 0.0 { 0.0 } else { (x[i] - sum) / a[i][i] };
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::systems::{gear_motor, road_vehicle};

    fn trace(truth: &Truth, rows: usize) -> Trace {
        let (start, mut drive) = (truth.system.drive)(Random::new(5, "refit"), truth.system.period);
        Trace { record: run::run(truth, &start, rows, &mut drive), start }
    }

    fn misfit(truth: &Truth, rows: usize, causes: &[Cause]) -> Fitted {
        let noise: Vec<f64> = truth.system.outputs.iter().map(|it| it.noise).collect();
        refit(&Truth::nominal(truth.system), causes, &[trace(truth, rows)], &noise, 0.0)
    }

    #[test]
    fn a_load_and_an_offset_of_its_sensor_are_one() {
        let mut truth = Truth::nominal(&gear_motor::SYSTEM);
        truth.causes.push(Cause::new("constant-load", "shaft", &[("torque", 0.4)]));
        let offset = misfit(&truth, 900, &[Cause::new("input-bias", "load", &[("bias", 0.3)])]);
        assert!(offset.misfit < 0.01, "{}", offset.misfit);
        assert!((offset.causes[0].numbers[0].1 - 0.4).abs() < 0.001, "{:?}", offset.causes);
        // Dry friction changes its sign with the motion.
        let dry = misfit(&truth, 900, &[Cause::new("coulomb-friction", "shaft", &[("torque", 0.3)])]);
        assert!(dry.misfit > 1.0, "{}", dry.misfit);
    }

    #[test]
    fn what_tolerances_take_up_does_not_remain() {
        let mut truth = Truth::nominal(&road_vehicle::SYSTEM);
        let place = truth.place("drag_area");
        truth.parameters[place] *= 1.08;
        assert!(misfit(&truth, 1200, &[]).misfit < 0.05);
        truth.parameters[place] *= 1.3;
        assert!(misfit(&truth, 1200, &[]).misfit > 1.0);
    }

    #[test]
    fn a_system_of_three_is_solved() {
        // The product of (2 1 0; 1 3 1; 0 1 4) and (1, -2, 3).
        let a = vec![vec![2.0, 0.0, 0.0], vec![1.0, 3.0, 0.0], vec![0.0, 1.0, 4.0]];
        let x = solve(a, &[0.0, -2.0, 10.0]);
        assert!(x.iter().zip([1.0, -2.0, 3.0]).all(|(x, wanted)| (x - wanted).abs() < 1e-12), "{x:?}");
    }
}
