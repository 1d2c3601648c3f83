//! Another gearbox and the vehicle's load: damping and frequency of the shuffle against road speed and gear ratio, and against the load as well.
//!
//! In: a plant file, the ratios of a second gearbox, seeds. Out: [`Prediction`] and [`Loaded`], what the surfaces
//! leave on runs that no fit saw, as plain numbers. The second car is never fitted, and no term was chosen by it.
//!
//! The coordinates are road speed and 1/ratio. The inertia of the engine at the wheel goes with the square of the ratio, so frequency and damping of
//! the mode go nearly with 1/ratio. And the speeds between 1200 and 4800 rpm lie between two straight lines in these coordinates, so that half-spaces
//! hold the runs without a gap. A gear number knows none of this about another gearbox.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_fit::{Constraint, Fit, Input, Outcome, Response, Select};

use rsm_sim::plant_file::PlantFile;

use super::experiment::experiment;
use super::figures::Study;
use super::measure::Measured;
use super::plan::{ENGINE_SPEEDS_RPM, TrackPlan};

/// Ratios of a second gearbox: all between those of the first (3.5 to 0.9), none of them among those.
pub const OTHER_RATIOS: [f64; 5] = [3.2, 2.4, 1.75, 1.25, 0.95];

/// Loads of the experiment, in kg (`tip-in-load.toml`): nobody, two more persons, four and their luggage.
pub const LOADS: [f64; 3] = [0.0, 160.0, 320.0];

/// Loads of the unseen runs, in kg: between them.
pub const UNSEEN_LOADS: [f64; 2] = [80.0, 240.0];

/// Engine speeds of the unseen runs with load, in rpm: between those of the experiment, as in `tip-in-unseen.toml`.
pub const UNSEEN_WITH_LOAD_RPM: [f64; 4] = [1650.0, 2550.0, 3450.0, 4350.0];

/// What the surfaces are drawn against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Against {
    /// Road speed and gear number.
    Gear,
    /// Road speed and gear ratio.
    Ratio,
    /// Road speed, gear ratio and load.
    RatioAndLoad,
}

/// Ranges of the model: in m/s, in gears, of ratios, in kg; where the evaluators of the damping and of the frequency saturate.
const SPEEDS: [f64; 2] = [2.5, 50.0];
const GEARS: [f64; 2] = [1.0, 5.0];
const RATIOS: [f64; 2] = [0.85, 3.6];
const LOADS_OF_MODEL: [f64; 2] = [0.0, 320.0];
const DAMPINGS: [f64; 2] = [0.05, 1.0];
const FREQUENCIES: [f64; 2] = [8.0, 80.0];

/// Faces of the support with two inputs: four sides of the box and the two lines of the engine.
const FACES: usize = 6;

/// The powers of the terms, a list an order of the ratio.
fn terms(against: Against) -> Vec<Vec<u32>> {
    let of_mode = (0..=3).flat_map(|ratio| (0..=2).map(move |speed| vec![speed, ratio]));
    if against != Against::RatioAndLoad {
        return of_mode.collect();
    }
    of_mode.map(|powers| [powers, vec![0]].concat()).chain([vec![0, 0, 1], vec![0, 1, 1]]).collect()
}

/// The text of the specification of `damping_ratio` and `shuffle_frequency`: what [`fit_mode`] fits in memory, for data in files.
///
/// The terms: second order in the speed, as the engine's torque map bends that much, times third order in 1/ratio, the order that the surfaces
/// against the gear have; the load moves little and is straight, with a slope of its own in each gear. The weights: in fifth gear a run knows its
/// damping to 0.01, and with lash to 0.1 where the step is hardly wider than the gap; in first gear to 0.0003.
#[must_use]
pub fn specification(against: Against, data: &str, unseen: Option<&str>) -> String {
    let unseen = unseen.map_or(String::new(), |file| format!("validate = [\"{file}\"]\n"));
    let (name, title) = match against {
        Against::Gear => ("driveline_gear", "road speed and gear number"),
        Against::Ratio => ("driveline_ratio", "road speed and gear ratio, for a car with another gearbox"),
        Against::RatioAndLoad => (
            "driveline_load",
            "road speed, gear ratio and the load of the vehicle.\n\
             # The data: `rsm design tip-in-load.toml --out plan.csv` and `rsm experiment driveline --plan plan.csv --plant PLANT.toml --out tip-in-load.csv`;\n\
             # the unseen set likewise from tip-in-load-unseen.toml, with another seed",
        ),
    };
    let (second, reciprocal, comment) = if against == Against::Gear {
        (format!("[inputs.gear]\nunit = \"1\"\nrange = {GEARS:?}\n"), "", "")
    } else {
        let comment = "# In 1/ratio both are nearly straight, and the runs lie between two straight lines: the engine's lowest and highest speed.\n";
        (format!("[inputs.ratio]\nunit = \"1\"\nrange = {RATIOS:?}\n"), "reciprocal = [\"ratio\"]\n", comment)
    };
    let (third, inputs) = match against {
        Against::Gear => (String::new(), "\"speed\", \"gear\""),
        Against::Ratio => (String::new(), "\"speed\", \"ratio\""),
        Against::RatioAndLoad => {
            (format!("\n[inputs.load]\nunit = \"kg\"\nrange = {LOADS_OF_MODEL:?}\n"), "\"speed\", \"ratio\", \"load\"")
        }
    };
    // Four sides of the box and the two lines of the engine; with three inputs the directions are given: -1, 0 and 1.
    let with_load = against == Against::RatioAndLoad;
    let support = if with_load { "\"data\"".to_string() } else { format!("{{ from = \"data\", faces = {FACES} }}") };
    let common = format!("{reciprocal}terms = {:?}\nselect = {{ method = \"fixed\" }}", terms(against));
    format!(
        r#"# The mode of the driveline in tip-in runs (`rsm experiment driveline`) against {title}.
format = 1
model = "{name}"
data = ["{data}"]
{unseen}
[inputs.speed]
unit = "m/s"
range = {SPEEDS:?}

{second}{third}
{comment}# A run in first gear knows its mode thirty times better than one in fifth: each counts by its standard error.
[responses.damping_ratio]
column = "shuffle_damping"
unit = "1"
inputs = [{inputs}]
weights = {{ standard_error = "shuffle_damping_se" }}
output_range = {DAMPINGS:?}
constraints = [{{ kind = "bounds", min = 0.0 }}]
support = {support}
{common}

[responses.shuffle_frequency]
unit = "rad/s"
inputs = [{inputs}]
weights = {{ standard_error = "shuffle_frequency_se" }}
output_range = {FREQUENCIES:?}
{common}
"#
    )
}

/// What a surface leaves: the mean absolute residual over the mean measured value, in percent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Of the damping ratio.
    pub damping_percent: f64,
    /// Of the shuffle frequency.
    pub frequency_percent: f64,
    /// So many of the runs lie outside the support of the damping ratio.
    pub outside: usize,
}

/// The surfaces of one car, and what they say of another.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Surfaces against the ratio, on unseen runs of the car that was fitted.
    pub unseen: Residual,
    /// The same on unseen runs of the car with the other gearbox.
    pub other: Residual,
    /// Surfaces of the same terms against the gear number, on unseen runs of the car that was fitted.
    pub by_gear_unseen: Residual,
    /// The same on the car with the other gearbox: they cannot know it.
    pub by_gear_other: Residual,
    /// The fit against the ratio.
    pub outcome: Outcome,
}

/// The load as a third factor.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// Surfaces with the load, on unseen runs with loads between those that were fitted.
    pub unseen: Residual,
    /// How much the greatest load moves the damping of the surface, in percent of the empty car's: by the fitted runs, the least and the greatest.
    pub damping_moved_percent: [f64; 2],
    /// The same of the shuffle frequency.
    pub frequency_moved_percent: [f64; 2],
    /// The fit.
    pub outcome: Outcome,
}

/// The same car with other ratios.
#[must_use]
pub fn with_ratios(plant: &PlantFile, ratios: [f64; 5]) -> PlantFile {
    let mut other = plant.clone();
    for (gear, ratio) in (1..).zip(ratios) {
        other.parameters.set(&format!("gear_ratios[{gear}]"), ratio);
    }
    other
}

/// Fits runs.
///
/// # Errors
/// What the fit refuses.
pub fn fit_mode(against: Against, measured: &[Measured]) -> Result<Outcome, Faults> {
    let column = |of: fn(&Measured) -> f64| measured.iter().map(of).collect::<Vec<f64>>();
    let speed = Input::new("speed", column(|it| it.road_speed)).unit("m/s").range(SPEEDS);
    let gear = || Input::new("gear", column(|it| it.run.gear as f64)).range(GEARS);
    let ratio = || Input::new("ratio", column(|it| it.ratio)).range(RATIOS);
    let load = || Input::new("load", column(|it| it.run.load)).unit("kg").range(LOADS_OF_MODEL);
    let (name, inputs) = match against {
        Against::Gear => ("driveline_gear", vec![speed, gear()]),
        Against::Ratio => ("driveline_ratio", vec![speed, ratio()]),
        Against::RatioAndLoad => ("driveline_load", vec![speed, ratio(), load()]),
    };
    let damping = Response::new("damping_ratio", column(|it| it.mode.shape.damping_ratio))
        .standard_errors(column(|it| it.mode.standard_error[2]))
        .output_range(DAMPINGS)
        .constraint(Constraint::Bounds { min: Some(0.0), max: None })
        .supported_by_data(0.0);
    let damping = if against == Against::RatioAndLoad { damping } else { damping.support_faces(FACES) };
    let frequency = Response::new("shuffle_frequency", column(|it| it.mode.shape.natural_frequency))
        .unit("rad/s")
        .standard_errors(column(|it| it.mode.standard_error[1]))
        .output_range(FREQUENCIES);
    let common = |response: Response| {
        let response = if against == Against::Gear { response } else { response.reciprocal("ratio") };
        response.select(Select::terms(terms(against)))
    };
    let runs = column(|it| f64::from(it.run.run));
    Ok(Fit::new(inputs, [common(damping), common(frequency)]).name(name).run_order(runs).fit()?)
}

/// The values of a surface of a model, or of its support test, at runs.
fn values(checked: &Checked, name: &str, support: bool, runs: &[[f64; 4]]) -> Result<Vec<f64>, Faults> {
    let refuse = |what: String| Faults::one(Fault::whole_file(checked.file(), what));
    let model = checked.model();
    let Some(index) = model.surfaces.iter().position(|it| it.name == name) else {
        return Err(refuse(format!("there is no surface `{name}`")));
    };
    let tape = if support {
        lower::support(checked, index, Precision::F64)
    } else {
        Some(lower::surface(checked, index, Precision::F64))
    };
    let Some(tape) = tape else { return Err(refuse(format!("surface `{name}` has no support"))) };
    let known = ["speed", "gear", "ratio", "load"];
    let mut places = vec![];
    for input in &model.surfaces[index].inputs {
        match known.iter().position(|it| it == input) {
            Some(place) => places.push(place),
            None => {
                return Err(refuse(format!(
                    "surface `{name}`: found the input `{input}`, expected one of {}",
                    known.join(", ")
                )));
            }
        }
    }
    let mut interpreter = Interpreter::<f64>::new(&tape);
    Ok(runs.iter().map(|run| interpreter.eval(&places.iter().map(|place| run[*place]).collect::<Vec<f64>>())).collect())
}

/// Speed, gear, ratio and load of runs.
fn points(measured: &[Measured]) -> Vec<[f64; 4]> {
    measured.iter().map(|it| [it.road_speed, it.run.gear as f64, it.ratio, it.run.load]).collect()
}

/// What `damping_ratio` and `shuffle_frequency` of a model leave on runs.
///
/// # Errors
/// A model without these surfaces, without a support, or of other inputs than speed, gear, ratio and load.
pub fn residual(checked: &Checked, measured: &[Measured]) -> Result<Residual, Faults> {
    let points = points(measured);
    let percent = |name: &str, of: fn(&Measured) -> f64| {
        let found = values(checked, name, false, &points)?;
        let left: f64 = found.iter().zip(measured).map(|(found, it)| (found - of(it)).abs()).sum();
        Ok::<_, Faults>(100.0 * left / measured.iter().map(of).sum::<f64>())
    };
    Ok(Residual {
        damping_percent: percent("damping_ratio", |it| it.mode.shape.damping_ratio)?,
        frequency_percent: percent("shuffle_frequency", |it| it.mode.shape.natural_frequency)?,
        outside: values(checked, "damping_ratio", true, &points)?.iter().filter(|inside| **inside == 0.0).count(),
    })
}

fn drive(plant: &PlantFile, plan: &TrackPlan, seed: u64, study: &Study) -> Result<Vec<Measured>, Faults> {
    Ok(experiment(plant, plan, seed, None, study.threads)?.into_iter().map(|(measured, _)| measured).collect())
}

/// Fits the 25 runs of a car and judges the surfaces on unseen runs of it and of the same car with another gearbox.
///
/// # Errors
/// What the track or the fit refuses.
pub fn prediction(plant: &PlantFile, ratios: [f64; 5], study: &Study) -> Result<Prediction, Faults> {
    let fitted = drive(plant, &TrackPlan::experiment(study.seed), study.seed, study)?;
    let plan = TrackPlan::unseen(study.seed + 1);
    let unseen = drive(plant, &plan, study.seed + 1, study)?;
    let other = drive(&with_ratios(plant, ratios), &plan, study.seed + 2, study)?;
    let outcome = fit_mode(Against::Ratio, &fitted)?;
    let by_ratio = Checked::from_model(&outcome.model)?;
    let by_gear = Checked::from_model(&fit_mode(Against::Gear, &fitted)?.model)?;
    Ok(Prediction {
        unseen: residual(&by_ratio, &unseen)?,
        other: residual(&by_ratio, &other)?,
        by_gear_unseen: residual(&by_gear, &unseen)?,
        by_gear_other: residual(&by_gear, &other)?,
        outcome,
    })
}

/// Fits the 75 runs of a car with three loads and judges the surfaces on unseen runs with loads between them.
///
/// # Errors
/// What the track or the fit refuses.
pub fn loaded(plant: &PlantFile, study: &Study) -> Result<Loaded, Faults> {
    let fitted = drive(plant, &TrackPlan::full(&ENGINE_SPEEDS_RPM, &LOADS, study.seed), study.seed, study)?;
    let plan = TrackPlan::full(&UNSEEN_WITH_LOAD_RPM, &UNSEEN_LOADS, study.seed + 1);
    let unseen = drive(plant, &plan, study.seed + 1, study)?;
    let outcome = fit_mode(Against::RatioAndLoad, &fitted)?;
    let checked = Checked::from_model(&outcome.model)?;
    let points = points(&fitted);
    let at = |load: f64| points.iter().map(|[speed, gear, ratio, _]| [*speed, *gear, *ratio, load]).collect::<Vec<_>>();
    let moved = |name: &str| {
        let (empty, full) = (values(&checked, name, false, &at(LOADS[0]))?, values(&checked, name, false, &at(LOADS[2]))?);
        let percent = empty.iter().zip(&full).map(|(empty, full)| 100.0 * (full / empty - 1.0));
        let ends = percent.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], it| [low.min(it), high.max(it)]);
        Ok::<_, Faults>(ends)
    };
    Ok(Loaded {
        unseen: residual(&checked, &unseen)?,
        damping_moved_percent: moved("damping_ratio")?,
        frequency_moved_percent: moved("shuffle_frequency")?,
        outcome,
    })
}
