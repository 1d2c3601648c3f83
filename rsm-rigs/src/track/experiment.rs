//! Runs a plan on the track, on every core, and writes what was measured as data for a fit.
//!
//! In: a plant file, a plan, a seed, a compensator where there is one. Out: [`Measured`] and [`Trace`] of every run, in the order of the plan: the
//! same bits, whatever the number of threads, because every run has its own stream of noise.

use std::fmt::Write as _;

use rsm_core::number::decimal;
use rsm_core::source::{Collector, Fault, Faults};
use rsm_core::threads::in_threads;
use rsm_sim::plant_file::PlantFile;

use super::measure::{Measured, measure};
use super::plan::{TipIn, TrackPlan};
use super::run::{Compensation, Trace, tip_in};

/// At most so many runs of a plan may be flagged: one in twelve, the paper's two of 25.
pub const FLAGGED_AT_MOST: f64 = 1.0 / 12.0;

/// Makes every run of a plan and measures it.
///
/// # Errors
/// A plant that is no driveline; every run that could not be simulated.
pub fn experiment(
    plant: &PlantFile,
    plan: &TrackPlan,
    seed: u64,
    compensation: Option<&Compensation>,
    threads: usize,
) -> Result<Vec<(Measured, Trace)>, Faults> {
    if !plant.kind.is("driveline") {
        let what = format!("the track needs a plant of kind \"driveline\", found \"{}\"", plant.kind.name());
        return Err(Faults::one(Fault::whole_file("the plant file", what)));
    }
    let one = |run: &TipIn| {
        let trace = tip_in(plant, run, seed, compensation)?;
        Ok::<_, Faults>((measure(plant, run, &trace)?, trace))
    };
    let mut faults = Collector::new();
    let mut done = vec![];
    for result in in_threads(&plan.runs, threads, one) {
        match result {
            Ok(it) => done.push(it),
            Err(found) => found.list().iter().for_each(|fault| faults.push(fault.clone())),
        }
    }
    faults.finish(Some(done))
}

/// A column of the data: its header and its value.
type DataColumn = (&'static str, fn(&Measured) -> f64);

/// The columns of the data, in order.
pub const COLUMNS: &[DataColumn] = &[
    ("run[1]", |it| f64::from(it.run.run)),
    ("gear[1]", |it| it.run.gear as f64),
    ("ratio[1]", |it| it.ratio),
    ("load[kg]", |it| it.run.load),
    ("speed[m/s]", |it| it.road_speed),
    ("engine_speed[rad/s]", |it| it.run.engine_speed),
    ("delay[s]", |it| it.response.shape.delay),
    ("natural_frequency[rad/s]", |it| it.response.shape.natural_frequency),
    ("damping_ratio[1]", |it| it.response.shape.damping_ratio),
    ("damping_error[1]", Measured::damping_error),
    ("overshoot[1]", |it| it.overshoot),
    ("fall_back[1]", |it| it.fall_back),
    ("settling_time[s]", |it| it.settling_time),
    ("rise_time[s]", |it| it.rise_time),
    ("delay_se[s]", |it| it.response.standard_error[0]),
    ("natural_frequency_se[rad/s]", |it| it.response.standard_error[1]),
    ("damping_ratio_se[1]", |it| it.response.standard_error[2]),
    ("shuffle_frequency[rad/s]", |it| it.mode.shape.natural_frequency),
    ("shuffle_damping[1]", |it| it.mode.shape.damping_ratio),
    ("shuffle_frequency_se[rad/s]", |it| it.mode.standard_error[1]),
    ("shuffle_damping_se[1]", |it| it.mode.standard_error[2]),
    ("flagged[1]", |it| f64::from(u8::from(!it.flags.is_empty()))),
];

/// What was measured, a row a run, with further columns.
#[must_use]
pub fn csv(measured: &[Measured], further: &[(&str, &[f64])]) -> String {
    let header: Vec<&str> = COLUMNS.iter().map(|(name, _)| *name).chain(further.iter().map(|(name, _)| *name)).collect();
    let mut text = header.join(",") + "\n";
    for (row, it) in measured.iter().enumerate() {
        let values = COLUMNS.iter().map(|(_, value)| value(it)).chain(further.iter().map(|(_, values)| values[row]));
        // An error that the data do not hold: a number all the same, as a table has no infinity.
        let cells: Vec<String> = values.map(|value| decimal(if value.is_finite() { value } else { f64::MAX })).collect();
        let _ = writeln!(text, "{}", cells.join(","));
    }
    text
}
