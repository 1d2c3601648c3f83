//! Computes the errors of a model on holdout records.
//!
//! In: a model and validation records. Out: errors of each output, with the initial states of the records as unknowns. The parameters of the plant
//! are fixed, but for numbers on which no training row depends, such as a limit that only a holdout record reaches: these records show them.

use super::levenberg;
use super::model::{Model, Place, Unknown};
use super::whitened_residuals::{Prepared, Simulated, WhitenedResiduals};
use crate::engine::holdout::{excess, removed_share};
use rsm_sim::kind::OUTPUTS;
use rsm_sim::record::Record;

/// Steps for the initial states. The problem is nearly linear if errors are small.
const STEPS: usize = 3;

/// Steps with exact derivatives, of a fit with open numbers. A limit comes nearer by the mean of what the readings exceed it; ten halvings leave a
/// thousandth of the way.
const MOST_EXACT_STEPS: usize = 10;

/// Such a fit ends if a step gains less than the effect of noise on one parameter.
const ENOUGH: f64 = 1.0;

/// The initial state is fitted to this part of its record first, then to twice as much, and so on. Over a whole record, an initial speed that is
/// wrong by the noise of one reading changes an angle by several turns, and the fit would end in a wrong local minimum.
const FIRST_SHARE: usize = 16;

/// A beginning with fewer rows is not fitted separately.
const LEAST_ROWS: usize = 30;

/// Whether holdout records determine an unknown: their initial states, and numbers on which no training row depends.
fn is_free_there(unknown: &Unknown) -> bool {
    unknown.open || matches!(unknown.place, Place::Start { .. })
}

/// The model with the initial states of other records, from their first readings, and its open numbers as its only unknowns.
fn with_free_starts(whitened: &WhitenedResiduals, model: &Model) -> Model {
    let mut other = model.clone();
    let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
    other.take_starts(&records, whitened.floors.map(|floor| floor.sd));
    other.unknowns.retain(is_free_there);
    other
}

/// The unknown initial states of the records of a fit.
fn starts_of(fit: &levenberg::Fit) -> impl Iterator<Item = Unknown> + '_ {
    fit.model.unknowns.iter().filter(|it| matches!(it.place, Place::Start { .. })).cloned()
}

/// A model with all its unknowns, on the records of a fit and from its initial states.
#[must_use]
pub fn with_starts_of(model: &Model, there: &levenberg::Fit) -> Model {
    let own = model.unknowns.iter().filter(|it| !matches!(it.place, Place::Start { .. })).cloned();
    Model { starts: there.model.starts.clone(), unknowns: own.chain(starts_of(there)).collect(), ..model.clone() }
}

/// The model on other records, after one step of the initial states from the first readings. Enough if these are nearly right.
#[must_use]
pub fn one_step(whitened: &WhitenedResiduals, model: &Model) -> Option<levenberg::Fit> {
    levenberg::fit(whitened, with_free_starts(whitened, model), 1)
}

/// The fit of the initial states to other records, with the residual.
#[must_use]
pub fn fit_initial_states(whitened: &WhitenedResiduals, model: &Model) -> Option<levenberg::Fit> {
    let mut other = with_free_starts(whitened, model);
    let mut share = FIRST_SHARE;
    while share > 1 {
        let cut = |it: &Prepared| it.shortened(it.record.rows() / share);
        if whitened.records.iter().all(|it| it.record.rows() / share >= LEAST_ROWS) {
            let records: Vec<Prepared> = whitened.records.iter().map(cut).collect();
            other = fit_unknowns(&whitened.with_records(records), other)?.model;
        }
        share /= 2;
    }
    fit_unknowns(whitened, other)
}

/// A fit of all unknowns of a model. With an open number each step has exact derivatives: a limit that moves changes the rows in which it acts, and
/// derivatives of the rows before would carry it beyond all readings, where it does nothing.
fn fit_unknowns(whitened: &WhitenedResiduals, model: Model) -> Option<levenberg::Fit> {
    if !model.unknowns.iter().any(|it| it.open) {
        return levenberg::fit(whitened, model, STEPS);
    }
    let mut fit = levenberg::fit(whitened, model, 1)?;
    for _ in 1..MOST_EXACT_STEPS {
        let next = levenberg::refit(whitened, fit.model.clone(), 1, Some(&fit))?;
        let gained = fit.cost - next.cost;
        fit = next;
        if gained < ENOUGH {
            break;
        }
    }
    Some(fit)
}

/// The same, starting from the initial states of an earlier fit to these records. For fast rotation, the phase depends strongly on them, and the
/// first readings may be too inaccurate.
#[must_use]
pub fn fit_from_starts_of(whitened: &WhitenedResiduals, model: &Model, earlier: &levenberg::Fit) -> Option<levenberg::Fit> {
    let unknowns = model.unknowns.iter().filter(|it| it.open).cloned().chain(starts_of(earlier)).collect();
    let other = Model { starts: earlier.model.starts.clone(), unknowns, ..model.clone() };
    fit_unknowns(whitened, other)
}

/// The fit to other records in which the parameters may also move within their uncertainty: each has a prior with its value and its standard
/// deviation, on the scale of its search. Initial states start from an earlier fit to these records.
#[must_use]
pub fn fit_within_uncertainty(
    whitened: &WhitenedResiduals,
    model: &Model,
    sds: &[Option<f64>],
    earlier: &levenberg::Fit,
) -> Option<levenberg::Fit> {
    let mut other = Model { starts: earlier.model.starts.clone(), unknowns: Vec::new(), ..model.clone() };
    for (k, (unknown, sd)) in model.unknowns.iter().zip(sds).enumerate() {
        if unknown.open {
            other.unknowns.push(unknown.clone());
            continue;
        }
        let value = model.value(k);
        let (false, Some(sd)) = (matches!(unknown.place, Place::Start { .. }), sd.filter(|sd| *sd > 0.0 && sd.is_finite()))
        else {
            continue;
        };
        let sd = unknown.deviation(value, sd);
        other.unknowns.push(Unknown { prior: Some((value, sd)), ..unknown.clone() });
    }
    other.unknowns.extend(starts_of(earlier));
    fit_unknowns(whitened, other)
}

/// The whitened squared residual; 0 without records.
#[must_use]
pub fn squared_residual(whitened: &WhitenedResiduals, model: &Model) -> Option<f64> {
    if whitened.records.is_empty() {
        return Some(0.0);
    }
    fit_initial_states(whitened, model).map(|fit| fit.cost)
}

/// The error of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Error {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The root mean square error.
    pub rmse: f64,
    /// The same divided by the noise.
    pub noise_ratio: f64,
}

/// The worst of some errors, relative to the noise.
#[must_use]
pub fn worst(errors: &[Error]) -> Option<&Error> {
    errors.iter().max_by(|a, b| a.noise_ratio.total_cmp(&b.noise_ratio))
}

/// Errors of a fit, by output.
#[must_use]
pub fn errors(whitened: &WhitenedResiduals, fit: &levenberg::Fit) -> Vec<Error> {
    errors_of(whitened, &fit.simulated)
}

/// Errors of simulations of all records, by output.
#[must_use]
pub fn errors_of(whitened: &WhitenedResiduals, simulated: &[Simulated]) -> Vec<Error> {
    let mut sums = [(0.0, 0usize); OUTPUTS];
    for (prepared, simulated) in whitened.records.iter().zip(simulated) {
        for (k, values) in simulated.iter().enumerate() {
            for ((measured, value), used) in prepared.measured(k).iter().zip(values).zip(&prepared.used[k]) {
                if *used {
                    let off = measured - whitened.floors[prepared.outputs[k]].mean_reading(*value);
                    let sum = &mut sums[prepared.outputs[k]];
                    sum.0 += off * off;
                    sum.1 += 1;
                }
            }
        }
    }
    let each = sums.iter().enumerate().filter(|(_, (_, count))| *count > 0);
    each.map(|(output, (sum, count))| {
        let rmse = (sum / *count as f64).sqrt();
        Error { output, rmse, noise_ratio: rmse / whitened.floors[output].sd }
    })
    .collect()
}

/// The removed share of the squared error above the noise, over all outputs in units of their noise.
pub fn gain(before: &[Error], after: &[Error]) -> f64 {
    let [before, after] = [before, after].map(|errors| errors.iter().map(|it| excess(it.noise_ratio * it.noise_ratio)).sum());
    removed_share(before, after)
}

/// The same from sums over each output: squares over the noise before and after, and counts.
pub fn gain_of<const N: usize>(sums: &[[f64; 3]; N]) -> f64 {
    let of = |which: usize| sums.iter().filter(|it| it[2] > 0.0).map(|it| excess(it[which] / it[2])).sum();
    removed_share(of(0), of(1))
}

#[cfg(test)]
mod tests {
    use super::super::noise::NoiseFloor;
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::by_output;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::simulate::Simulator;

    #[test]
    fn a_start_is_found_where_its_error_turns_the_phase_of_a_ripple() {
        let text = include_str!("../../../rsm-sim/plants/driveline.toml").to_string()
            + "\n[[effects]]\nkind = \"combustion-ripple\"\nparameters = { amplitude = 0.8 }\n";
        let file = PlantFile::read(&Source::new("car.toml", text)).unwrap();
        let mut csv = "time[s],throttle[1],gear[1],engine_speed[rad/s],road_speed[m/s],acceleration[m/s^2]\n".to_string();
        for k in 0..1500 {
            csv += &format!("{},{},3,0,{},0\n", f64::from(k) / 100.0, if k % 400 < 150 { 0.5 } else { 0.05 }, 12.0);
        }
        let mut record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let simulated = Simulator::new(&file, &record).unwrap().run(&record).unwrap();
        let sds = by_output(&[0.1, 0.02, 0.05], 1.0);
        let mut random = Random::new(4);
        for (k, name) in ["engine_speed", "road_speed", "acceleration"].iter().enumerate() {
            let noisy = simulated.of(name).unwrap().iter().map(|value| value + sds[k] * random.normal());
            record.measured[k] = Some(noisy.collect());
        }
        // Two standard deviations off, the first reading is two radians of the ripple off at the end.
        record.measured[1].as_mut().unwrap()[0] = 12.04;
        let whitened = WhitenedResiduals::new(vec![Prepared::new(record.clone(), 3)], sds.map(NoiseFloor::white), 1);
        let model = Model::nominal(&PlantFile { tolerance: Vec::new(), ..file }, &[&record], sds);
        // White noise in 4500 readings: four standard deviations, 4 sqrt(2 * 4500), and the four squared ones of the first.
        let left = squared_residual(&whitened, &model).unwrap();
        assert!((left - 4500.0).abs() < 384.0, "{left}");
    }

    /// Errors of this many times the noise, one an output.
    fn times(ratios: &[f64]) -> Vec<Error> {
        ratios.iter().enumerate().map(|(output, ratio)| Error { output, rmse: 0.1 * ratio, noise_ratio: *ratio }).collect()
    }

    #[test]
    fn a_gain_is_the_share_of_the_energy_above_the_noise_that_is_gone() {
        // 8 and 3 above the noise; 1.25 and nothing are left. What is below the noise counts as nothing.
        assert_eq!(gain(&times(&[3.0, 2.0]), &times(&[1.5, 0.5])), 1.0 - 1.25 / 11.0);
        // Above by 0.05 and 0.15 % of the noise's energy: the scatter of a million rows, and more.
        assert_eq!(gain(&times(&[1.0005_f64.sqrt()]), &times(&[1.0])), 0.0);
        assert_eq!(gain(&times(&[1.0015_f64.sqrt()]), &times(&[1.0])), 1.0);
        // What is made worse many times is worse by all.
        assert_eq!(gain(&times(&[2.0]), &times(&[10.0])), -1.0);
    }

    #[test]
    fn the_gain_of_sums_is_that_of_their_errors_and_asks_for_rows() {
        // Per row 9, 9 and 0.5 before, 2, 2 and 2 after. Of the second there is one row.
        assert_eq!(gain_of(&[[90.0, 20.0, 10.0], [9.0, 2.0, 1.0], [5.0, 20.0, 10.0]]), 1.0 - 3.0 / 16.0);
        // An output without rows says nothing.
        assert_eq!(gain_of(&[[90.0, 20.0, 10.0], [5.0, 5.0, 0.0], [0.0; 3]]), 1.0 - 1.0 / 8.0);
        assert_eq!(gain_of(&[[10.005, 10.0, 10.0], [0.0; 3], [0.0; 3]]), 0.0);
        assert_eq!(gain_of(&[[10.015, 10.0, 10.0], [0.0; 3], [0.0; 3]]), 1.0);
        assert_eq!(gain_of(&[[20.0, 1000.0, 10.0], [0.0; 3], [0.0; 3]]), -1.0);
    }
}
