//! The final fit: noise floors from its own residual, parameters in their usual form, and the file of the extended plant.
//!
//! In: the fit of a search. Out: the same causes, fitted with the noise floors of their own residual. Never adds or removes a cause.

use rsm_sim::kind::OUTPUTS;
use std::f64::consts::{PI, TAU};

use super::identifiability;
use super::levenberg::{self, Fit};
use super::model::{InitialMotion, Model, Place};
use super::noise::NoiseFloor;
use super::whitened_residuals::WhitenedResiduals;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::simulate::starting;

/// Steps of a fit that starts near its minimum.
const STEPS: usize = 4;

/// Two rounds: the residual of a fit gives noise floors, and these give another fit. A third round changes nothing visible.
const ROUNDS: usize = 2;

/// Fits again with the noise floors of the residual, and stores these floors in the whitening.
#[must_use]
pub fn final_fit(
    whitened: &mut WhitenedResiduals,
    mut fit: Fit,
    floors: impl Fn(&WhitenedResiduals, &Fit) -> [NoiseFloor; OUTPUTS],
) -> Fit {
    fit.model = with_normalised_waves(fit.model);
    for _ in 0..ROUNDS {
        let found = floors(whitened, &fit);
        if found == whitened.floors {
            break;
        }
        whitened.floors = found;
        match levenberg::fit(whitened, fit.model.clone(), STEPS) {
            Some(better) => fit = better,
            None => break,
        }
    }
    identifiability::converged(whitened, fit)
}

/// The extended plant as a file. A parameter at the end of its tolerance gets its nominal value again if the records no longer determine it, because
/// an accepted effect replaces it. An output that no record holds, and the speed of an axis that begins in motion, get the initial value fitted to
/// the first record; without it the file could not be simulated.
#[must_use]
pub fn extended_plant_file(file: &PlantFile, whitened: &WhitenedResiduals, nominal: &Model, fit: &Fit) -> PlantFile {
    let mut plant = fit.model.file.clone();
    for held in &fit.held {
        let Place::Nominal(name) = fit.model.unknowns[held.unknown].place else { continue };
        let mut back = fit.model.clone();
        back.file.parameters.set(name, nominal.file.parameters.number(name));
        let costs = whitened.run(&back).map(|simulated| levenberg::cost(&back, &whitened.residual(&simulated)));
        // A loss of one squared standard deviation of the noise.
        if costs.is_some_and(|cost| cost < fit.cost + 1.0) {
            plant.parameters.set(name, nominal.file.parameters.number(name));
        }
    }
    plant.initial = file.initial.clone();
    let Some((first, mut starts)) = whitened.records.first().zip(fit.model.starts.first().copied()) else { return plant };
    let places = starting(&first.record, file.kind);
    let is_hidden = |place: &usize| file.kind.output(file.kind.starts()[*place].name).is_none();
    let mut in_motion = false;
    if let Some((whitened, fit)) = fit_of_initial_state(whitened, fit) {
        starts = fit.model.starts[0];
        in_motion = places.iter().filter(|it| is_hidden(it)).any(|place| moves(&whitened, &fit, *place));
    }
    for place in places {
        let name = file.kind.starts()[place].name;
        let wanted = match file.kind.output(name) {
            Some(output) => whitened.records.iter().all(|it| it.record.measured[output].is_none()),
            None => in_motion,
        };
        if wanted && plant.initial.iter().all(|(found, _)| *found != name) {
            plant.initial.push((name, starts[place]));
        }
    }
    plant
}

/// A fit of only the initial state of the first record, with its records; `None` if records begin steadily. The first rows, which no other fit
/// compares, determine the initial state best, now that the causes are known.
fn fit_of_initial_state(whitened: &WhitenedResiduals, fit: &Fit) -> Option<(WhitenedResiduals, Fit)> {
    if fit.model.at_start == InitialMotion::Steady {
        return None;
    }
    let first = whitened.records.first()?.with_settling_rows();
    let of_first = |place: &Place| matches!(place, Place::Start { record: 0, .. });
    let unknowns = fit.model.unknowns.iter().filter(|it| of_first(&it.place)).cloned().collect();
    let model = Model { starts: fit.model.starts[..1].to_vec(), unknowns, ..fit.model.clone() };
    let whitened = whitened.with_records(vec![first]);
    let fit = levenberg::fit(&whitened, model, STEPS)?;
    Some((whitened, fit))
}

/// Whether a record begins in motion, for one initial value: zero would worsen the fit by more than three standard deviations of the noise.
fn moves(whitened: &WhitenedResiduals, fit: &Fit, place: usize) -> bool {
    let mut at_rest = fit.model.clone();
    at_rest.starts[0][place] = 0.0;
    let costs = whitened.run(&at_rest).map(|simulated| levenberg::cost(&at_rest, &whitened.residual(&simulated)));
    costs.is_none_or(|cost| cost > fit.cost + 9.0)
}

/// Waves with positive amplitudes, and phases between -pi and pi.
fn with_normalised_waves(mut model: Model) -> Model {
    for entry in &mut model.file.effects {
        let numbers = &mut entry.arguments.numbers;
        for amplitude in 0..numbers.len() {
            // A wave of one configuration has its own phase.
            let Some(of_wave) = numbers[amplitude].0.strip_prefix("amplitude") else { continue };
            let its_phase = format!("phase{of_wave}");
            let Some(phase) = numbers.iter().position(|it| it.0 == its_phase) else { continue };
            if numbers[amplitude].1 < 0.0 {
                numbers[amplitude].1 = -numbers[amplitude].1;
                numbers[phase].1 += PI;
            }
            numbers[phase].1 -= TAU * (numbers[phase].1 / TAU).round();
        }
    }
    model
}
