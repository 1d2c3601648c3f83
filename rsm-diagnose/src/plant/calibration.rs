//! The calibrated plant, and the noise of each output.
//!
//! In: records and a plant file. Out: the parameters (within their tolerances) and initial states that fit the records best, from several starting
//! points, and the noise floors. A floor comes from the residual of this fit or, for a sensor that rounds, from the scatter about the mean reading.
//! Never adds a cause.

use super::levenberg::{self, Fit};
use super::model::{self, InitialMotion, Model};
use super::noise::NoiseFloor;
use super::rounding::Rounding;
use super::simulation_error;
use super::whitened_residuals::{self, WhitenedResiduals};
use rsm_core::threads::in_threads;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// Estimates the noise floor and the calibrated plant in turn: the floor is the residual of the calibrated plant at high frequencies.
pub fn calibrate(whitened: &mut WhitenedResiduals, file: &PlantFile, at_start: InitialMotion) -> Option<(Model, Fit)> {
    let records: Vec<Record> = whitened.records.iter().map(|it| it.record.clone()).collect();
    let records: Vec<&Record> = records.iter().collect();
    let bare = PlantFile { effects: Vec::new(), ..file.clone() };
    let mut nominal = Model::with_initial_motion(&bare, at_start, &records, [1.0; OUTPUTS]);
    nominal.file.effects = file.effects.clone();
    let simulated = whitened.run(&nominal)?;
    whitened.floors = estimate(whitened, &simulated, file);
    nominal = Model::with_initial_motion(file, at_start, &records, whitened.floors.map(|floor| floor.sd));
    let fit = levenberg::fit(whitened, nominal.clone(), 8)?;
    whitened.floors = floors(whitened, &fit, file);
    let fit = converged(whitened, levenberg::fit(whitened, fit.model, 8)?)?;
    if is_near_noise(&fit) {
        return Some((nominal, fit));
    }
    // There may be a better local minimum: try the beginnings of the records, and the opposite side of the calibrated values.
    let mut best = fit;
    let from_beginnings = over_growing_horizon(whitened, &nominal);
    for start in from_beginnings.into_iter().chain([mirrored(&nominal, &best.model)]) {
        let Some(other) = levenberg::fit(whitened, start, 8) else { continue };
        if other.cost < 0.9 * best.cost {
            best = converged(whitened, other)?;
        }
        if is_near_noise(&best) {
            break;
        }
    }
    let floors_there = floors(whitened, &best, file);
    whitened.floors = floors_there;
    let fit = levenberg::fit(whitened, best.model, 8)?;
    Some((nominal, fit))
}

/// Whether the residual is at most twice the noise. Then no other starting point would help much.
fn is_near_noise(fit: &Fit) -> bool {
    fit.cost < 4.0 * fit.residual.len() as f64
}

/// Continues a fit while it gains a thousandth of its cost, at most four times. Eight steps are enough near a minimum, but not far from it.
fn converged(whitened: &WhitenedResiduals, mut fit: Fit) -> Option<Fit> {
    for _ in 0..4 {
        let further = levenberg::refit(whitened, fit.model.clone(), 8, Some(&fit))?;
        let done = fit.cost - further.cost < (1e-3 * fit.cost).max(1.0);
        if further.cost < fit.cost {
            fit = further;
        }
        if done {
            break;
        }
    }
    Some(fit)
}

/// A calibration to the first eighth of each record, then to twice as much, and so on. A rotation or an oscillation is still in phase at the
/// beginning.
fn over_growing_horizon(whitened: &WhitenedResiduals, nominal: &Model) -> Option<Model> {
    let mut model = nominal.clone();
    for share in [8, 4, 2] {
        let records = whitened.records.iter().map(|it| it.shortened(it.record.rows() / share)).collect();
        model = levenberg::fit(&whitened.with_records(records), model, 6)?.model;
    }
    Some(model)
}

/// Calibrated parameters mirrored at their nominal values; the initial states stay as found.
fn mirrored(nominal: &Model, found: &Model) -> Model {
    let mut model = found.clone();
    for k in 0..model.unknowns.len() {
        if let model::Place::Nominal(name) = model.unknowns[k].place {
            let value = 2.0 * nominal.file.parameters.number(name) - found.file.parameters.number(name);
            model.set(k, value);
        }
    }
    model
}

/// The noise of each output from the residual of a fit, at least the one that the error of the simulation permits.
pub fn floors(whitened: &WhitenedResiduals, fit: &Fit, file: &PlantFile) -> [NoiseFloor; OUTPUTS] {
    let floors = estimate(whitened, &fit.simulated, file);
    let least = simulation_error::least_noise(whitened, fit, &floors);
    std::array::from_fn(|output| floors[output].at_least(least[output]))
}

/// Noise floors if some outputs (place, step) are rounded. The floor is the scatter that rounding leaves about the mean reading, if that can be
/// estimated. Otherwise it is at least the rounding error as white noise.
pub fn with_rounding(
    whitened: &WhitenedResiduals,
    fit: &Fit,
    mut floors: [NoiseFloor; OUTPUTS],
    rounded: &[(usize, f64)],
) -> [NoiseFloor; OUTPUTS] {
    for &(output, step) in rounded {
        let mut lists: Vec<(&[f64], &[f64], &[bool])> = Vec::new();
        for (prepared, simulated) in whitened.records.iter().zip(&fit.simulated) {
            if let Some(k) = prepared.outputs.iter().position(|it| *it == output) {
                lists.push((prepared.measured(k), simulated[k].as_slice(), prepared.used[k].as_slice()));
            }
        }
        let rows = lists.iter().flat_map(|(measured, simulated, used)| measured.iter().zip(*simulated).zip(*used));
        let pairs: Vec<(f64, f64)> =
            rows.filter(|(_, used)| **used).map(|((measured, simulated), _)| (*measured, *simulated)).collect();
        let found = Rounding::found(step, &pairs).and_then(|rounding| {
            let left: Vec<Vec<f64>> = lists
                .iter()
                .map(|(measured, simulated, _)| {
                    measured.iter().zip(*simulated).map(|(measured, value)| measured - rounding.expected(*value)).collect()
                })
                .collect();
            let left: Vec<(&[f64], &[bool])> =
                left.iter().zip(&lists).map(|(left, (_, _, used))| (left.as_slice(), *used)).collect();
            let simulated: Vec<&[f64]> = lists.iter().map(|it| it.1).collect();
            NoiseFloor::of_rounding(rounding, &simulated, &left)
        });
        // A rounding error is uniform over a step, so its standard deviation is step/sqrt(12).
        let uniform = step / 12.0_f64.sqrt();
        floors[output] = match found {
            Some(floor) => floor,
            None if floors[output].sd < uniform => NoiseFloor::white(uniform),
            None => floors[output],
        };
    }
    floors
}

/// The noise of each output from the residual of a simulation. If the records are too short for a spectrum: the value in the file, or a thousandth of
/// the largest reading.
fn estimate(
    whitened: &WhitenedResiduals,
    simulated: &[whitened_residuals::Simulated],
    file: &PlantFile,
) -> [NoiseFloor; OUTPUTS] {
    let mut floors = whitened.floors;
    for ((output, floor), noise) in floors.iter_mut().enumerate().zip(noise_estimates(whitened, simulated)) {
        let name = file.kind.outputs().get(output).map_or("", |signal| signal.name);
        let stated = file.noise.iter().find(|(found, _)| *found == name).map(|(_, sd)| *sd).filter(|sd| *sd > 0.0);
        let otherwise = || NoiseFloor::white(stated.unwrap_or(1e-3 * noise.largest).max(noise.least()));
        *floor = noise.floor.unwrap_or_else(otherwise);
    }
    floors
}

/// The noise of an output as estimated from the records.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoiseEstimate {
    /// The floor, if the records are long enough for a spectrum.
    pub floor: Option<NoiseFloor>,
    /// The largest reading.
    pub largest: f64,
}

impl NoiseEstimate {
    /// The smallest noise that is ever assumed, also where the error of the simulation is not measured.
    fn least(&self) -> f64 {
        1e-9 * self.largest.max(1e-291)
    }
}

/// The noise of each output after a simulation is subtracted from the records.
pub fn noise_estimates(whitened: &WhitenedResiduals, simulated: &[whitened_residuals::Simulated]) -> [NoiseEstimate; OUTPUTS] {
    let outputs: Vec<usize> = (0..OUTPUTS).collect();
    let found = in_threads(&outputs, whitened.threads, |&output| {
        let mut noise = NoiseEstimate::default();
        let mut residuals: Vec<(&[f64], Vec<f64>, &[bool])> = Vec::new();
        for (prepared, simulated) in whitened.records.iter().zip(simulated) {
            let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
            let difference = prepared.measured(k).iter().zip(&simulated[k]).map(|(a, b)| a - b).collect();
            noise.largest = noise.largest.max(prepared.largest_reading(k));
            residuals.push((prepared.measured(k), difference, &prepared.used[k]));
        }
        let lists: Vec<(&[f64], &[bool])> = residuals.iter().map(|(_, values, used)| (values.as_slice(), *used)).collect();
        let with_readings: Vec<(&[f64], &[f64], &[bool])> =
            residuals.iter().map(|(measured, values, used)| (*measured, values.as_slice(), *used)).collect();
        let least = noise.least();
        let found = NoiseFloor::of_growing(&with_readings).or_else(|| NoiseFloor::estimate(&lists));
        noise.floor = found.map(|floor| floor.at_least(least));
        noise
    });
    let mut all = [NoiseEstimate::default(); OUTPUTS];
    all.iter_mut().zip(found).for_each(|(to, from)| *to = from);
    all
}
