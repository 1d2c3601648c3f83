//! The figures of case 2: what the rounds reach, without lash and with it, what it costs, and what is left.
//!
//! In: a plant file of the car without lash, seeds. Out: [`Study`]: both cars tuned, driven again with fresh noise, and every figure
//! of that last drive. Nothing here is chosen by the figures that it reports: rounds are chosen by their own runs.

use rsm_core::check::Checked;
use rsm_core::source::{Faults, Source};
use rsm_fit::fit::Outcome;

use rsm_sim::plant_file::PlantFile;

use super::experiment::experiment;
use super::measure::Measured;
use super::plan::{TipIn, TrackPlan};
use super::rounds::{
    COMPENSATOR, Poles, SECOND_ORDER, Settings, Tuned, fit_surfaces, overshoot_ratio, tune, worst_ratio, zeta,
};
use super::run::{Compensation, Trace};

/// Total lash of the paper's car, 3 degrees at the wheel, in rad.
pub const LASH: f64 = 0.0524;

/// Where a study takes its noise from.
#[derive(Debug, Clone, Copy)]
pub struct Study {
    /// The seed of everything: orders, noise, unseen sets.
    pub seed: u64,
    /// On so many threads.
    pub threads: usize,
}

/// A car, tuned, and driven again.
#[derive(Debug, Clone)]
pub struct Car {
    /// How it was tuned.
    pub tuned: Tuned,
    /// The surfaces, judged on unseen runs.
    pub surfaces: Outcome,
    /// Unseen runs without compensator.
    pub unseen: Vec<Measured>,
    /// Runs of the plan with the compensator of the best round and fresh noise, each with its trace.
    pub compensated: Vec<(Measured, Trace)>,
    /// The same runs without compensator, with fresh noise.
    pub uncompensated: Vec<(Measured, Trace)>,
    /// Mean absolute residual of the damping surface on the unseen runs over their mean measured damping, in percent.
    pub damping_residual_percent: f64,
    /// The same of a surface of second order through the same runs, the paper's own form.
    pub damping_residual_percent_second_order: f64,
    /// Mean damping ratio of the response to the pedal.
    pub zeta_mean: f64,
    /// Largest |zeta - 0.7|.
    pub zeta_max_residual: f64,
    /// Largest overshoot over that without compensator, of the runs that have one.
    pub overshoot_ratio_worst: f64,
    /// So many runs have one.
    pub overshoot_runs: usize,
    /// Largest overshoot that the others have with the compensator, as a share of the step.
    pub overshoot_elsewhere: f64,
    /// How far the acceleration falls back after a peak, over that without compensator: mean and largest.
    pub fall_back_ratio: [f64; 2],
    /// Rise time to 90 % of the step over that without compensator: mean and largest.
    pub rise_time_ratio: [f64; 2],
    /// Runs of the plan that are flagged, without and with compensator: run and reason.
    pub flagged: Vec<(u32, &'static str)>,
}

/// What the damping is when something that the car has is taken away, under the compensator of the car with everything.
#[derive(Debug, Clone, PartialEq)]
pub struct Without {
    /// What was taken away.
    pub what: &'static str,
    /// Mean damping ratio.
    pub zeta_mean: f64,
    /// Largest |zeta - 0.7|.
    pub zeta_max_residual: f64,
    /// Largest overshoot, as a share of the step.
    pub overshoot_max: f64,
}

/// All figures of case 2.
#[derive(Debug, Clone)]
pub struct Figures {
    /// The car without lash.
    pub without_lash: Car,
    /// The car with it.
    pub with_lash: Car,
    /// What is left of the target with lash.
    pub left: Vec<Without>,
}

/// A car with lash.
///
/// # Errors
/// None for a driveline; faults where the file has a lash already that cannot stand twice.
pub fn with_lash(plant: &PlantFile, gap: f64) -> Result<PlantFile, Faults> {
    let text = format!("{}\n[[effects]]\nkind = \"backlash\"\nparameters = {{ gap = {gap} }}\n", plant.write());
    PlantFile::read(&Source::new("the car with lash", text))
}

/// Tunes a car and drives it again.
///
/// # Errors
/// What the track or the fit refuses.
pub fn car(plant: &PlantFile, study: &Study, poles: Poles) -> Result<Car, Faults> {
    let plan = TrackPlan::experiment(study.seed);
    let settings = Settings { seed: study.seed, poles, threads: study.threads };
    let tuned = tune(plant, &plan, &settings)?;
    // Seeds that no round had: there are fewer than 1000 rounds.
    let drive = |plan: &TrackPlan, after: u64, compensation: Option<&Compensation>| {
        experiment(plant, plan, study.seed + 1000 + after, compensation, study.threads)
    };
    let unseen: Vec<Measured> =
        drive(&TrackPlan::unseen(study.seed + 1), 0, None)?.into_iter().map(|(measured, _)| measured).collect();
    let best = &tuned.rounds[tuned.best];
    let surfaces = fit_surfaces(&tuned.uncompensated, &best.pole_damping, Some(&unseen), poles.damping_terms)?;
    let compensation = Compensation::new(&Checked::from_model(tuned.model())?, COMPENSATOR)?;
    let uncompensated = drive(&plan, 1, None)?;
    let compensated = drive(&plan, 2, Some(&compensation))?;
    let only = |runs: &[(Measured, Trace)]| runs.iter().map(|(measured, _)| measured.clone()).collect::<Vec<_>>();
    let (before, after) = (only(&uncompensated), only(&compensated));
    let (zeta_mean, zeta_max_residual) = zeta(&after);
    let mean_of_unseen = unseen.iter().map(|it| it.mode.shape.damping_ratio).sum::<f64>() / unseen.len() as f64;
    let residual_percent = |surfaces: &Outcome| {
        let of_damping = surfaces.responses.iter().find(|it| it.name == "damping_ratio").and_then(|it| it.statistics.as_ref());
        let residual = of_damping.and_then(|it| it.validation.as_ref()).map_or(f64::NAN, |it| it.mean_abs_error);
        100.0 * residual / mean_of_unseen
    };
    let second_order = fit_surfaces(&tuned.uncompensated, &best.pole_damping, Some(&unseen), SECOND_ORDER)?;
    let mean_and_largest = |ratio: fn(&Measured, &Measured) -> f64| {
        let ratios: Vec<f64> = before.iter().zip(&after).map(|(before, after)| ratio(before, after)).collect();
        [ratios.iter().sum::<f64>() / ratios.len() as f64, ratios.iter().copied().fold(0.0, f64::max)]
    };
    let all = [&tuned.uncompensated, &unseen, &after];
    let flagged = all.into_iter().flatten().flat_map(|it| it.flags.iter().map(|flag| (it.run.run, *flag))).collect();
    Ok(Car {
        damping_residual_percent: residual_percent(&surfaces),
        damping_residual_percent_second_order: residual_percent(&second_order),
        zeta_mean,
        zeta_max_residual,
        overshoot_ratio_worst: worst_ratio(&before, &after),
        overshoot_runs: before.iter().zip(&after).filter(|(before, after)| overshoot_ratio(before, after).is_some()).count(),
        overshoot_elsewhere: before
            .iter()
            .zip(&after)
            .filter(|(before, _)| !before.has_overshoot())
            .map(|(_, after)| after.overshoot)
            .fold(0.0, f64::max),
        fall_back_ratio: mean_and_largest(|before, after| after.fall_back / before.fall_back),
        rise_time_ratio: mean_and_largest(|before, after| after.rise_time / before.rise_time),
        flagged,
        tuned,
        surfaces,
        unseen,
        compensated,
        uncompensated,
    })
}

/// Everything: both cars, and what is left with lash.
///
/// # Errors
/// What the track or the fit refuses.
pub fn figures(plant: &PlantFile, study: &Study) -> Result<Figures, Faults> {
    let lash = with_lash(plant, LASH)?;
    let without_lash = car(plant, study, Poles::WITHOUT_LASH)?;
    let with_lash = car(&lash, study, Poles::WITH_LASH)?;
    let left = left(plant, &lash, &with_lash, study)?;
    Ok(Figures { without_lash, with_lash, left })
}

/// What is left, by taking away lash, lag and the bend of the torque map, one at a time.
fn left(plant: &PlantFile, lash: &PlantFile, car: &Car, study: &Study) -> Result<Vec<Without>, Faults> {
    let compensation = Compensation::new(&Checked::from_model(car.tuned.model())?, COMPENSATOR)?;
    let mut no_lag = lash.clone();
    // A tenth: 10 ms, which no shuffle sees (0.5 rad at 50 rad/s); a lag of 0 is not a driveline of docs/book/src/reference/plants.md.
    let lag = no_lag.parameters.number("torque_lag");
    no_lag.parameters.set("torque_lag", lag / 10.0);
    let mut straight = lash.clone();
    // The torque of the map in the middle of the plan, 3000 rpm, at every speed.
    let middle = 3000.0 * super::plan::RPM;
    let [t_0, t_1, t_2] = ["torque_0", "torque_1", "torque_2"].map(|name| lash.parameters.number(name));
    straight.parameters.set("torque_0", t_0 + t_1 * middle + t_2 * middle * middle);
    straight.parameters.set("torque_1", 0.0);
    straight.parameters.set("torque_2", 0.0);
    let cars = [("nothing", lash), ("lash", plant), ("engine lag", &no_lag), ("bend of the torque map", &straight)];
    let plan = TrackPlan::experiment(study.seed);
    let mut left = vec![];
    for (what, plant) in cars {
        let runs = experiment(plant, &plan, study.seed + 2000, Some(&compensation), study.threads)?;
        let measured: Vec<Measured> = runs.into_iter().map(|(measured, _)| measured).collect();
        let (zeta_mean, zeta_max_residual) = zeta(&measured);
        let overshoot_max = measured.iter().map(|it| it.overshoot).fold(0.0, f64::max);
        left.push(Without { what, zeta_mean, zeta_max_residual, overshoot_max });
    }
    Ok(left)
}

/// The run of a gear whose engine speed is nearest to one in rad/s: for a plot of one trace.
#[must_use]
pub fn nearest(runs: &[(Measured, Trace)], gear: usize, engine_speed: f64) -> Option<&(Measured, Trace)> {
    let distance = |run: &TipIn| (run.engine_speed - engine_speed).abs();
    let of_gear = runs.iter().filter(|(measured, _)| measured.run.gear == gear);
    of_gear.min_by(|a, b| distance(&a.0.run).total_cmp(&distance(&b.0.run)))
}
