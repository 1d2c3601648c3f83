//! Multistart for a fit that may be at a local minimum.
//!
//! In: a fit that leaves structure. Out: a better fit of the same unknowns, if one is found. Effects that accumulate along a record, and contacts
//! that bounce, stick or slip at different times for slightly different parameters, give the cost many narrow local minima. A starting point is
//! evaluated by the sum of squares over all rows. Does not change the set of unknowns.

use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::nuisance::Nuisance;
use super::whitened_residuals::{Column, Prepared, Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use crate::engine::levenberg::{CostTolerance, Problem, Rules, descend};
use rsm_core::order;
use rsm_fit::random::Random;

/// The last step of the line search, as a share of a parameter's scale: 2.5 % of a positive parameter, the resolution of an earlier scan.
const LAST_STEP: f64 = 0.25;

/// The factor between steps of the line search.
const STEP_RATIO: f64 = 1.5;

/// The number of further local minima that are tried, and how often a success may repeat the search.
const MOST_MINIMA: usize = 3;

/// A fit is noise if its squared residual is within this many standard deviations of the noise. Then nothing is tried.
const NOISE: f64 = 4.0;

/// The number of parts of a record. A part is short against a motion, of which a record has about ten, and long enough for a stable mean square of
/// the noise.
const PARTS: usize = 100;

/// The loss of a part is linear up to half of its noise energy, and logarithmic above. Noise is reduced by a third. A bounce at the wrong time with
/// 400 times the noise energy counts as little as three times the noise.
const LINEAR_UP_TO: f64 = 0.5;

/// The error is in few parts if this share of the parts holds most of it. A uniform error has a tenth of itself in a tenth of the parts; one that
/// grows along a record has a fifth.
const FEW_PARTS: f64 = 0.1;

/// The largest number of robust steps: ten reduce an error of a tenth to a thousandth.
const ROBUST_STEPS: usize = 20;

/// The robust fit ends when a step gains less than this: the effect of noise on one parameter.
const ROBUST_ENOUGH: f64 = 1.0;

/// The number of dampings tried for such a step, each ten times the one before.
const DAMPINGS: usize = 6;

/// Sizes of random hops, in units of a parameter's scale: 2.5 %, 0.8 % and 0.25 % of a positive parameter. Local minima are that wide, or narrower.
const HOPS: [f64; 3] = [0.25, 0.08, 0.025];

/// The search ends after this many hops without success: three of each size.
pub const MOST_FAILED_HOPS: usize = 9;

/// The largest number of hops.
const MOST_HOPS: usize = 36;

/// The seed of the random hops.
const SEED: u64 = 7;

/// Leaves a local minimum by a line search along each parameter of the last cause: from a step of its standard deviation to the resolution of a scan,
/// with everything else to first order. Repeats while it gains more than `threshold`.
#[must_use]
pub fn line_search_escape(whitened: &WhitenedResiduals, fit: Fit, steps: usize, threshold: f64) -> Fit {
    let mut fit = fit;
    for _ in 0..MOST_MINIMA {
        if is_noise(&fit) || whitened.work.is_limit_reached() {
            break;
        }
        let nuisance = Nuisance::new(&fit);
        let mut models = Vec::new();
        for (&k, column) in fit.free.iter().zip(&fit.columns) {
            let unknown = &fit.model.unknowns[k];
            if !of_last(&fit.model, k) {
                continue;
            }
            let at = unknown.to_search_scale(fit.model.value(k));
            // A step of one standard deviation with all else fixed changes the outputs by as much as the noise.
            let mut step = 1.0 / dot(&column.values, &column.values).sqrt();
            while step < LAST_STEP * unknown.scale {
                for value in [unknown.plant_value(at - step), unknown.plant_value(at + step)] {
                    let mut model = fit.model.clone();
                    model.set(k, value);
                    models.push(model);
                }
                step *= STEP_RATIO;
            }
        }
        let runs = whitened.run_all(&models);
        let costs = runs.into_iter().map(|run| run.map(|run| nuisance.remaining_square(&whitened.residual(&run)).0));
        let mut order: Vec<(f64, Model)> = costs.zip(models).filter_map(|(cost, model)| Some((cost?, model))).collect();
        order::ascending(&mut order, |it| it.0);
        let others = order.into_iter().take(MOST_MINIMA).filter_map(|(_, model)| levenberg::fit(whitened, model, steps));
        let lower = others.into_iter().find(|other| other.cost < fit.cost - threshold);
        let Some(lower) = lower else { break };
        fit = lower;
    }
    fit
}

/// The number of rows of a part.
fn length(prepared: &Prepared) -> usize {
    prepared.record.rows().div_ceil(PARTS).max(1)
}

/// The mean square of each part of each record, in units of the noise.
fn parts(whitened: &WhitenedResiduals, residual: &[f64]) -> Vec<Vec<f64>> {
    let mut first = 0;
    let each = whitened.records.iter().map(|prepared| {
        let (rows, outputs, length) = (prepared.record.rows(), prepared.outputs.len(), length(prepared));
        let mut squares = vec![0.0; rows.div_ceil(length)];
        for values in residual[first..first + rows * outputs].chunks_exact(rows.max(1)) {
            for (square, part) in squares.iter_mut().zip(values.chunks(length)) {
                *square += dot(part, part) / (length * outputs) as f64;
            }
        }
        first += rows * outputs;
        squares
    });
    each.collect()
}

/// Whether a tenth of the parts holds most of the error above the noise.
#[must_use]
pub fn in_few_parts(whitened: &WhitenedResiduals, fit: &Fit) -> bool {
    let mut beyond: Vec<f64> = parts(whitened, &fit.residual).into_iter().flatten().map(|it| (it - 1.0).max(0.0)).collect();
    order::sort(&mut beyond);
    let few = (FEW_PARTS * beyond.len() as f64).ceil() as usize;
    let of_few: f64 = beyond.iter().rev().take(few).sum();
    !is_noise(fit) && of_few > 0.5 * beyond.iter().sum::<f64>()
}

/// The priors plus a robust sum over the parts of records, and the weight of each row in its derivative. A part with mean square E has the loss c
/// ln(1 + E/c): the loss of a Cauchy distribution (P. J. Huber, 1981), for parts in place of rows.
fn robust_sum(whitened: &WhitenedResiduals, model: &Model, residual: &[f64]) -> (f64, Vec<f64>) {
    // The priors alone.
    let (mut sum, mut weights) = (levenberg::cost(model, &[]), Vec::with_capacity(residual.len()));
    for (prepared, squares) in whitened.records.iter().zip(parts(whitened, residual)) {
        let (rows, outputs, length) = (prepared.record.rows(), prepared.outputs.len(), length(prepared));
        sum += squares.iter().map(|it| LINEAR_UP_TO * (1.0 + it / LINEAR_UP_TO).ln() * (length * outputs) as f64).sum::<f64>();
        for _ in 0..outputs {
            weights.extend((0..rows).map(|row| 1.0 / (1.0 + squares[row / length] / LINEAR_UP_TO)));
        }
    }
    (sum, weights)
}

/// The current point of a robust fit: the robust sum and the weights there.
struct Iterate {
    model: Model,
    simulated: Vec<Simulated>,
    residual: Vec<f64>,
    sum: f64,
    weights: Vec<f64>,
}

impl Iterate {
    fn of(whitened: &WhitenedResiduals, model: Model) -> Option<Self> {
        let simulated = whitened.run(&model)?;
        let residual = whitened.residual(&simulated);
        let (sum, weights) = robust_sum(whitened, &model, &residual);
        Some(Iterate { model, simulated, residual, sum, weights })
    }
}

/// A robust fit of all unknowns to most parts of the records, by reweighting at every step (P. W. Holland, R. E. Welsch, 1977).
struct RobustFit<'a>(&'a WhitenedResiduals);

impl Problem for RobustFit<'_> {
    type Iterate = Iterate;
    type Derivatives = Vec<Column>;
    type Equations = levenberg::Equations;

    fn cost(&self, at: &Iterate) -> f64 {
        at.sum
    }

    fn derivatives(&self, at: &Iterate) -> Option<Vec<Column>> {
        let all: Vec<usize> = (0..at.model.unknowns.len()).collect();
        self.0.derivatives(&at.model, &at.simulated, &all)
    }

    fn equations(&self, at: &Iterate, columns: &Vec<Column>) -> levenberg::Equations {
        let roots: Vec<f64> = at.weights.iter().map(|it| it.sqrt()).collect();
        let weighted: Vec<f64> = at.residual.iter().zip(&roots).map(|(value, root)| value * root).collect();
        let mut columns = columns.clone();
        for column in &mut columns {
            column.values.iter_mut().zip(&roots[column.first..]).for_each(|(value, root)| *value *= root);
        }
        levenberg::Equations::new(&at.model, &columns, &weighted)
    }

    fn step(&self, at: &Iterate, equations: &levenberg::Equations, damping: f64) -> (Vec<f64>, f64) {
        let change = equations.change(&at.model, damping);
        let predicted = equations.predicted_gain(&change);
        (change, predicted)
    }

    fn moved(&self, at: &Iterate, equations: &levenberg::Equations, step: &[f64]) -> Option<Iterate> {
        Iterate::of(self.0, equations.moved(&at.model, step))
    }
}

/// A model fitted robustly to most parts of the records. `None` if it cannot be simulated.
#[must_use]
pub fn robust_fit(whitened: &WhitenedResiduals, model: Model) -> Option<Model> {
    let enough = CostTolerance { absolute: ROBUST_ENOUGH, relative: 0.0 };
    let rules = Rules {
        steps: ROBUST_STEPS,
        tries: [DAMPINGS; 2],
        least_predicted_gain: None,
        retries_undamped: false,
        least_gain: enough,
        least_gain_ratio: 0.0,
        follows_valleys: false,
        ends_exact: false,
    };
    Some(descend(&RobustFit(whitened), Iterate::of(whitened, model)?, None, &rules)?.0.model)
}

/// Leaves local minima in several parameters by random hops (D. J. Wales, J. P. K. Doye, 1997): fits from the robust fit, from the given fit, and
/// from points near the two. It ends when only noise is left, or after `hops` hops without success. A gain of at most `enough` does not count.
#[must_use]
pub fn basin_hopping(whitened: &WhitenedResiduals, fit: Fit, steps: usize, hops: usize, enough: f64) -> Fit {
    let mut random = Random::new(SEED);
    let mut fit = fit;
    let mut robust_model = None;
    let mut failed = 0;
    for hop in 0..MOST_HOPS {
        if is_noise(&fit) || failed > hops || whitened.work.is_limit_reached() {
            break;
        }
        let robust = robust_model.get_or_insert_with(|| robust_fit(whitened, fit.model.clone()));
        let from = robust.as_ref().filter(|_| failed % 2 == 0).unwrap_or(&fit.model);
        let mut model = from.clone();
        // The first trial is without a hop.
        if failed > 0 {
            for k in (0..model.unknowns.len()).filter(|k| of_last(from, *k)) {
                let unknown = &from.unknowns[k];
                let to = unknown.to_search_scale(from.value(k)) + HOPS[hop % HOPS.len()] * unknown.scale * random.normal();
                model.set(k, unknown.plant_value(to));
            }
        }
        match levenberg::fit(whitened, model, steps) {
            Some(other) if other.cost < fit.cost - enough => {
                (fit, robust_model, failed) = (other, None, 0);
            }
            _ => failed += 1,
        }
    }
    fit
}

/// Whether an unknown is a parameter of the last cause.
fn of_last(model: &Model, unknown: usize) -> bool {
    let last = model.file.effects.len().saturating_sub(1);
    matches!(model.unknowns[unknown].place, Place::Effect { entry, .. } if entry == last)
}

/// Whether a squared residual is within the scatter of noise.
fn is_noise(fit: &Fit) -> bool {
    let rows = fit.residual.len() as f64;
    fit.cost <= rows + NOISE * (2.0 * rows).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::noise::NoiseFloor;
    use super::*;
    use rsm_core::source::Source;
    use rsm_sim::kind::by_output;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;
    use rsm_sim::simulate::Simulator;

    const NOISE: [f64; 2] = [3e-6, 0.015];

    fn axis(numbers: [f64; 4]) -> PlantFile {
        let [gap, ratio, stiffness, damping] = numbers;
        let text = format!(
            "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 66\nforce_gain = 27\nviscous_friction = 113\ncommand_limit = 10\n\
             position_gain = 28\nvelocity_gain = 136\nvelocity_from = \"state\"\n[[effects]]\nkind = \"backlash\"\nparameters = \
             {{ gap = {gap}, mass_ratio = {ratio}, stiffness = {stiffness}, damping = {damping} }}\n"
        );
        PlantFile::read(&Source::new("axis.toml", text)).unwrap()
    }

    /// Six seconds of an axis with free play that goes to and fro.
    fn recorded(truth: &PlantFile) -> (WhitenedResiduals, Record) {
        let mut csv = "time[s],reference[m],position[m],command[V]\n".to_string();
        let mut reference = 0.0;
        for k in 0..6000 {
            let t = f64::from(k) / 1000.0;
            let speed = [0.2, 0.0, -0.1, 0.05, 0.0, -0.15, 0.3, -0.02][(k / 150 % 8) as usize];
            reference += speed / 1000.0;
            csv += &format!("{t},{reference},0,0\n");
        }
        let mut record = Record::read(&Source::new("r.csv", csv), truth).unwrap();
        let simulated = Simulator::new(truth, &record).unwrap().run(&record).unwrap();
        let mut random = Random::new(11);
        for (k, name) in ["position", "command"].iter().enumerate() {
            let noisy = simulated.of(name).unwrap().iter().map(|value| value + NOISE[k] * random.normal());
            record.measured[k] = Some(noisy.collect());
        }
        let floors = by_output(&NOISE, 1.0).map(NoiseFloor::white);
        (WhitenedResiduals::new(vec![Prepared::new(record.clone(), 2)], floors, 2), record)
    }

    fn started(numbers: [f64; 4], record: &Record) -> Model {
        let nominal = PlantFile { effects: vec![], ..axis(numbers) };
        let model = Model::nominal(&nominal, &[record], by_output(&NOISE, 1.0));
        model.with_cause(&model, axis(numbers).effects[0].clone())
    }

    #[test]
    fn contacts_at_other_moments_hold_a_fit_that_most_parts_of_the_record_lead_on() {
        let truth = [3.5e-4, 0.35, 8.5e5, 640.0];
        let (whitened, record) = recorded(&axis(truth));
        let rows = whitened.rows() as f64;
        for [gap, ratio, stiffness, damping] in [[0.3, 1.0, 0.1, 0.7], [2.5, 0.8, 0.3, 1.0]] {
            let start = [truth[0] * gap, truth[1] * ratio, truth[2] * stiffness, truth[3] * damping];
            let fit = levenberg::fit(&whitened, started(start, &record), 24).unwrap();
            assert!(fit.cost > 20.0 * rows, "{}", fit.cost);
            let found = basin_hopping(&whitened, fit, 8, MOST_FAILED_HOPS, 4.0);
            assert!(is_noise(&found), "{} of {rows}", found.cost);
            let gap = found.model.file.effects[0].arguments.number("gap");
            // A thousandth: the play shows in the phase of every contact, of which there are tens, each to a hundredth.
            assert!((gap / truth[0] - 1.0).abs() < 1e-3, "{gap}");
        }
    }

    #[test]
    fn single_moments_count_by_their_logarithm_and_weigh_as_its_derivative() {
        let truth = [3.5e-4, 0.35, 8.5e5, 640.0];
        let (whitened, record) = recorded(&axis(truth));
        let model = started(truth, &record);
        let rows = whitened.rows();
        let sum = |residual: &[f64]| robust_sum(&whitened, &model, residual);
        let noise: Vec<f64> = (0..rows).map(|row| if row % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let mut bounced = noise.clone();
        // The first of a hundred parts, in the first of two outputs.
        bounced[..60].iter_mut().for_each(|it| *it = 40.0);
        let (plain, with) = (sum(&noise).0, sum(&bounced).0);
        // Of one part of 120 values: c ln(1 + E/c) with E = 800.5 less the same with E = 1.
        let expected = 120.0 * LINEAR_UP_TO * ((1.0 + 800.5 / LINEAR_UP_TO) / (1.0 + 1.0 / LINEAR_UP_TO)).ln();
        assert!((with - plain - expected).abs() < 1e-6 * expected, "{} {expected}", with - plain);
        // d/dr = 2 weight r.
        for row in [7, 3500] {
            let mut other = bounced.clone();
            other[row] += 1e-4;
            let slope = (sum(&other).0 - with) / 1e-4;
            let weight = sum(&bounced).1[row];
            assert!((slope / (2.0 * weight * bounced[row]) - 1.0).abs() < 1e-3, "{row}: {slope}");
        }
    }

    #[test]
    fn an_error_in_one_moment_is_in_few_parts_and_one_that_grows_is_not() {
        let truth = [3.5e-4, 0.35, 8.5e5, 640.0];
        let (whitened, record) = recorded(&axis(truth));
        let mut fit = levenberg::linearised(&whitened, started(truth, &record)).unwrap();
        assert!(!in_few_parts(&whitened, &fit), "noise");
        let rows = whitened.rows();
        let noise = fit.residual.clone();
        let mut with = |error: &dyn Fn(usize) -> f64| {
            fit.residual = noise.iter().enumerate().map(|(row, value)| value + error(row)).collect();
            fit.cost = dot(&fit.residual, &fit.residual);
            in_few_parts(&whitened, &fit)
        };
        assert!(with(&|row| if (1000..1100).contains(&row) { 30.0 } else { 0.0 }));
        assert!(!with(&|row| 10.0 * row as f64 / rows as f64));
    }
}
