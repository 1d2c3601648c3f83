//! A tip-in run: coast in gear at a speed, then a full throttle step.
//!
//! In: a plant file, a run of the plan, a seed, a compensator where there is one. Out: a [`Trace`] at 2 kHz with the sensor noise of the plant
//! file. The compensator sees what a controller on the car sees: the pedal, the measured road speed of that millisecond, the gear. The
//! throttle stays within 0 and 1, as a throttle does. Never knows an effect.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_core::tape::Tape;
use rsm_fit::random::Random;

use rsm_sim::equation_plant::driveline;
use rsm_sim::kind::Signal;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{self, Drive, Record};
use rsm_sim::simulate::{Simulator, Stopped};

use super::plan::TipIn;

/// Sample time of the logger, in s: 2 kHz. Sensor noise is white at this rate, with the sigma of the plant file in every sample.
pub const PERIOD: f64 = 0.0005;

/// Rows in a sample time of the controller: 1 kHz.
const ROWS_A_STEP: usize = 2;

/// Sample time of the controller, in s.
pub const CONTROL_PERIOD: f64 = 0.001;

/// Rows before the step: 0.8 s. The start is in balance but for the deceleration of the engine, a hundredth of the step; what swings of it
/// falls by exp(-0.1 * 14 * 0.8) = 0.33 in the first gear.
pub const COAST_ROWS: usize = 1600;

/// Rows in all: 1 s is kept after the step. The slowest shuffle (2.2 Hz in first gear) shows two periods in it, and the car does not yet leave
/// the part of the torque map that a straight line describes.
pub const ROWS: usize = COAST_ROWS + 2001;

/// A compensator of a model, ready for runs.
#[derive(Debug, Clone)]
pub struct Compensation {
    tape: Tape,
    /// What its step takes after the signal, in the order of the file.
    inputs: Vec<ScheduledBy>,
}

/// What a compensator may be scheduled by on this car.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ScheduledBy {
    Speed,
    Gear,
    Ratio,
    Load,
}

impl Compensation {
    /// A compensator of a model by its name, in f64.
    ///
    /// # Errors
    /// A fault for a name that is not there, for an input that the car does not have, for a compensator that is not certain to be stable or that runs
    /// at another sample time.
    pub fn new(checked: &Checked, name: &str) -> Result<Self, Faults> {
        let model = checked.model();
        let refuse = |what: String, help: &str| Faults::one(Fault::whole_file(checked.file(), what).help(help));
        let Some(index) = model.compensators.iter().position(|it| it.name == name) else {
            let known: Vec<&str> = model.compensators.iter().map(|it| it.name.as_str()).collect();
            let found = if known.is_empty() { "it has none".to_string() } else { format!("it has {}", known.join(", ")) };
            return Err(refuse(format!("there is no compensator `{name}`; {found}"), "name one with MODEL.toml:NAME"));
        };
        rsm_core::certificate::compensator::require_stable(checked, index)?;
        let compensator = &model.compensators[index];
        if compensator.sample_time != CONTROL_PERIOD {
            let what = format!("compensator `{name}`: `sample_time` is {} s", compensator.sample_time);
            return Err(refuse(what, "the track runs it every 0.001 s"));
        }
        let mut inputs = Vec::new();
        for input in checked.schedule_of(compensator) {
            inputs.push(match (input.name.as_str(), input.unit.as_str()) {
                ("speed", "m/s") => ScheduledBy::Speed,
                ("gear", "1") => ScheduledBy::Gear,
                ("ratio", "1") => ScheduledBy::Ratio,
                ("load", "kg") => ScheduledBy::Load,
                (other, unit) => {
                    let what = format!("compensator `{name}`: its input `{other}` in {unit} is not measured on this car");
                    return Err(refuse(what, "expected speed in m/s, gear in 1, ratio in 1 or load in kg"));
                }
            });
        }
        Ok(Compensation { tape: lower::compensator(checked, index, Precision::F64), inputs })
    }
}

/// What a run leaves: a row every [`PERIOD`], outputs with sensor noise.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Time, in s; the step is at [`COAST_ROWS`].
    pub time: Vec<f64>,
    /// The pedal, 0 to 1.
    pub demand: Vec<f64>,
    /// The throttle, 0 to 1.
    pub throttle: Vec<f64>,
    /// In rad/s.
    pub engine_speed: Vec<f64>,
    /// In m/s.
    pub road_speed: Vec<f64>,
    /// In m/s^2.
    pub acceleration: Vec<f64>,
    /// The gear.
    pub gear: usize,
}

impl Trace {
    /// As a record that `rsm simulate` reads.
    #[must_use]
    pub fn csv(&self) -> String {
        let gear = vec![self.gear as f64; self.time.len()];
        let (inputs, outputs) = (driveline().inputs(), driveline().outputs());
        record::csv(&[
            (Signal { name: "time", unit: "s" }, &self.time),
            (inputs[0], &self.throttle),
            (Signal { name: "gear", unit: "1" }, &gear),
            (outputs[0], &self.engine_speed),
            (outputs[1], &self.road_speed),
            (outputs[2], &self.acceleration),
        ])
    }
}

/// Noise of variance 1: the sum of twelve uniform numbers less six, bounded as a sensor's is, with the same bits on every machine.
fn normal(random: &mut Random) -> f64 {
    (0..12).map(|_| random.share()).sum::<f64>() - 6.0
}

/// Makes a run. The noise is that of the seed and of the run's number.
///
/// # Errors
/// Faults of the plant file for a record; [`Stopped`] as text when the simulation cannot go on.
pub fn tip_in(plant: &PlantFile, run: &TipIn, seed: u64, compensation: Option<&Compensation>) -> Result<Trace, Faults> {
    let mut plant = plant.clone();
    let mass = plant.parameters.number("mass");
    plant.parameters.set("mass", mass + run.load);
    plant.initial.clear();
    let parameters = plant.effective_parameters();
    let ratio = parameters.number(&format!("gear_ratios[{}]", run.gear));
    let road_speed = run.engine_speed / (ratio * parameters.number("final_drive_ratio")) * parameters.number("wheel_radius");
    let name = format!("run {}", run.run);
    let record = Record {
        settings: vec![("gear", run.gear as f64)],
        file: name.clone(),
        drive: Drive::Inputs,
        time: (0..ROWS).map(|row| row as f64 * PERIOD).collect(),
        period: PERIOD,
        inputs: vec![vec![0.0; ROWS]],
        starts: Vec::new(),
        measured: vec![None, Some(vec![road_speed; ROWS]), None],
        breaks: Vec::new(),
        configuration: None,
    };
    let sigma = driveline().outputs().iter().map(|output| {
        let found = plant.noise.iter().find(|(name, _)| *name == output.name);
        found.map_or(0.0, |(_, sigma)| *sigma)
    });
    let sigma: Vec<f64> = sigma.collect();
    // Odd constant of the golden ratio (Steele, Lea, Flood 2014): neighbouring runs and seeds give unrelated streams.
    let mut random = Random::new(seed ^ u64::from(run.run).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    let mut trace = Trace { time: record.time.clone(), gear: run.gear, ..Trace::default() };
    let mut filter = compensation.map(|it| (Interpreter::<f64>::new(&it.tape), &it.inputs));
    let mut arguments = Vec::new();
    let mut command = 0.0;
    let mut each_row = |row: usize, outputs: &[f64]| -> f64 {
        let [engine_speed, road_speed, acceleration] = [0, 1, 2].map(|k| outputs[k] + sigma[k] * normal(&mut random));
        let demand = if row < COAST_ROWS { 0.0 } else { 1.0 };
        command = match &mut filter {
            None => demand,
            Some(_) if !row.is_multiple_of(ROWS_A_STEP) => command,
            Some((filter, inputs)) => {
                arguments.clear();
                arguments.push(demand);
                arguments.extend(inputs.iter().map(|by| match by {
                    ScheduledBy::Speed => road_speed,
                    ScheduledBy::Gear => run.gear as f64,
                    ScheduledBy::Ratio => ratio,
                    ScheduledBy::Load => run.load,
                }));
                filter.step(&arguments)
            }
        };
        let throttle = command.clamp(0.0, 1.0);
        trace.demand.push(demand);
        trace.throttle.push(throttle);
        trace.engine_speed.push(engine_speed);
        trace.road_speed.push(road_speed);
        trace.acceleration.push(acceleration);
        throttle
    };
    Simulator::new(&plant, &record)?
        .run_controlled(&record, &mut each_row)
        .map_err(|stopped: Stopped| Faults::one(Fault::whole_file(&name, stopped.to_string())))?;
    Ok(trace)
}
