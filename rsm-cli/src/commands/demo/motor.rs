//! Case 1 of the demo: the motor in flux weakening, from the dynamometer to the loop.
//!
//! plan -> bench -> fit -> check -> emit -> compare bits -> comparison of the surface's controller with the full one: commands, run-ups, times.

use std::path::Path;

use host_runners::motor::Steps;
use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::Input;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_fit::fit::Outcome as Fitted;
use rsm_fit::spec::Specification;
use rsm_rigs::bench::{self, Bench};
use rsm_rigs::motor::closed_loop::{Drive, Row, Trace};
use rsm_rigs::motor::field_oriented::FullController;
use rsm_rigs::motor::figures::{self, RUN_UP_SPEED};
use rsm_rigs::motor::surface::Surfaces;
use rsm_sim::plant_file::PlantFile;
use serde_json::{Map, Value, json};

use super::paper::Paper;
use super::{Printer, Section, chain, speed};
use crate::commands::fit;
use crate::outcome::Refusal;
use crate::page::escaped;
use crate::plot::{self, GREY, Mark, ORANGE, PINK, Series, Words};
use crate::weakening::{self, FIT, PLANS, SEEDS};
use crate::{output, report};

/// The shipped plant and the shipped study of forms.
const PLANT: &str = include_str!("../../../../rsm-sim/plants/pmac.toml");
const STUDY: &str = include_str!("../../../demo/motor/study.toml");

/// Seeds of the random profiles. No experiment uses them.
const PROFILES: std::ops::Range<u64> = 100..104;

/// Duration of a profile in s: short demo, full demo.
const PROFILE_S: [f64; 2] = [10.0, 60.0];

/// Runs the case.
pub fn run(printer: &Printer, folder: &Path, full: bool, paper: &mut Paper) -> Result<Section, Refusal> {
    let mut results = Map::new();
    let plant = PlantFile::read(&Source::new("pmac.toml", PLANT))?;
    let (points, fitted) = measure_and_fit(printer, folder, &plant, full, paper)?;
    let mut good = fitted.reached();
    results.insert("fit".into(), serde_json::to_value(fitted.report()).map_err(|error| Refusal::new(error.to_string()))?);

    good &= chain::compiled(printer, folder, &fitted.model, &mut results)?;
    output::write_all(&[(folder.join("fit.html"), report::fit(&fitted)?)])?;
    let checked = Checked::from_model(&fitted.model)?;

    let forms = commands(printer, &plant, &checked, folder, full, paper)?;
    let run_ups = run_ups(printer, &plant, paper)?;
    let times = speed::measure(printer, &plant, paper)?;
    results.insert("forms".into(), json!(forms.iter().map(Form::json).collect::<Vec<_>>()));
    results.insert("times".into(), times.json());

    let (plot, html) = html(Drive::default().known(&plant).torque_constant(), &checked, &points, &forms, &run_ups, &times)?;
    Ok(Section { good, plot, html, json: Value::Object(results) })
}

/// A measured point of the bench: torque, speed, weakening current.
type Points = Vec<[f64; 3]>;

/// Writes the plans, runs both sets of points on the bench and fits the first.
fn measure_and_fit(
    printer: &Printer,
    folder: &Path,
    plant: &PlantFile,
    full: bool,
    paper: &mut Paper,
) -> Result<(Points, Fitted), Refusal> {
    let mut files = vec![(folder.join("pmac.toml"), PLANT.to_string())];
    let mut plans = Vec::new();
    for (name, text) in PLANS {
        let (plan, settings) = weakening::plan(name, text)?;
        files.push((folder.join(format!("{name}.csv")), plan.csv()));
        plans.push(settings);
    }
    paper.note("points_measured", plans[0].len() as f64);
    paper.note("points_full", plans[1].len() as f64);
    printer.print(&format!(
        "plan     motor: {} of the {} points of modulation depth and current advance, in random order",
        plans[0].len(),
        plans[1].len()
    ))?;
    let bench = Bench::default();
    let measured = weakening::measure(plant, &bench, &plans[0], FIT)?;
    let weakening::Measured { outcomes: [outcomes, _], fitted, files: of_fit } = measured;
    output::write_all(&of_fit.into_iter().map(|(name, text)| (folder.join(name), text)).collect::<Vec<_>>())?;
    let points: Points = outcomes
        .iter()
        .filter_map(|outcome| match outcome {
            bench::Outcome::AtLimit(point) => Some([point.torque, point.speed, -point.i_d]),
            bench::Outcome::BelowLimit(_) | bench::Outcome::Tripped(_) => None,
        })
        .collect();
    let (run, at) = (outcomes.len(), points.len());
    printer.print(&format!(
        "bench    {run} runs to steady state, {at} of them at the voltage limit; the other half of the map is the holdout set"
    ))?;
    if full {
        files.push((folder.join("dyno-180-data.csv"), bench::csv(&bench.run(plant, &plans[1], SEEDS[0])?)));
    }
    output::write_all(&files)?;
    chain::print_fit(printer, &fitted)?;
    Ok((points, fitted))
}

/// A form of surface: the distance of its commands from the full controller's, and its cost.
struct Form {
    name: String,
    mean: f64,
    p99: f64,
    /// Number of operations of its f64 tape.
    operations: usize,
}

impl Form {
    fn json(&self) -> Value {
        json!({ "form": self.name, "angle_error_mean_deg": self.mean, "angle_error_p99_deg": self.p99, "operations": self.operations })
    }
}

/// Commands over holdout profiles: the controller with its surfaces, and every form of the study.
fn commands(
    printer: &Printer,
    plant: &PlantFile,
    checked: &Checked,
    folder: &Path,
    full: bool,
    paper: &mut Paper,
) -> Result<Vec<Form>, Refusal> {
    let drive = Drive::default();
    let seeds: Vec<u64> = PROFILES.collect();
    let seconds = PROFILE_S[usize::from(full)];
    let differences = figures::command_difference(plant, &drive, &Surfaces::new(checked)?, &seeds, seconds)?;
    let operations = |checked: &Checked, index: usize| lower::surface(checked, index, Precision::F64).operation_count();
    let (mean, p99) = (differences.mean(), differences.quantile(0.99));
    paper.note("angle_error_mean_deg", mean);
    paper.note("angle_error_p99_deg", p99);
    let mut forms = vec![Form { name: "as embedded".to_string(), mean, p99, operations: operations(checked, 0) }];
    printer.print(&format!(
        "command  {mean:.3} deg mean and {p99:.3} deg at the 99th percentile from the full controller, in {} of {} ms that weaken",
        differences.angles.len(),
        differences.ticks
    ))?;

    output::write_all(&[(folder.join("study.toml"), STUDY)])?;
    let study = fit::with_progress(&Specification::read(&folder.join("study.toml"))?)?;
    let model = Checked::from_model(&study.model)?;
    for (index, surface) in study.model.surfaces.iter().enumerate() {
        let found = figures::surface_difference(plant, &drive, &model, &surface.name, &seeds, seconds)?;
        let name = surface.name.replace('_', " ");
        forms.push(Form { name, mean: found.mean(), p99: found.quantile(0.99), operations: operations(&model, index) });
    }
    let second =
        forms.iter().find(|form| form.name == "angle order 2").ok_or_else(|| Refusal::new("study.toml lost a form"))?;
    paper.note("angle_error_mean_deg_second_order", second.mean);
    printer.print(&format!("         second order in torque and speed, as the paper has it: {:.3} deg mean", second.mean))?;
    Ok(forms)
}

/// Run-ups from rest with a coarse encoder: with the full controller and with the embedded steps.
fn run_ups(printer: &Printer, plant: &PlantFile, paper: &mut Paper) -> Result<[Trace; 2], Refusal> {
    let drive = Drive::default();
    let known = drive.known(plant);
    let full = figures::run_up(plant, &drive, &mut FullController::full(known))?;
    let surface = figures::run_up(plant, &drive, &mut Steps::new(&known))?;
    let compared = figures::compare_run_ups(&full, &surface);
    paper.note("runup_torque_rms_percent", compared.torque_rms_percent);
    paper.note("runup_time_percent", compared.time_percent.abs());
    printer.print(&format!(
        "run-up   to {:.0} rpm in {:.3} s with the surface, {:.3} s with the full controller; torque differs by {:.3} % r.m.s. of its peak",
        RUN_UP_SPEED * 30.0 / std::f64::consts::PI,
        figures::run_up_time(&surface),
        figures::run_up_time(&full),
        compared.torque_rms_percent
    ))?;
    Ok([full, surface])
}

/// The plot at the head of the report (a run-up with and without the surface), and the section.
fn html(
    k_t: f64,
    checked: &Checked,
    points: &Points,
    forms: &[Form],
    [full, surface]: &[Trace; 2],
    times: &speed::Times,
) -> Result<(String, String), Refusal> {
    let index = checked.model().surfaces.iter().position(|surface| surface.name == "weakening_current");
    let index = index.ok_or_else(|| Refusal::new("the motor's model lost its surface `weakening_current`"))?;
    let inputs: [Input; 2] = checked
        .inputs_of(&checked.model().surfaces[index])
        .try_into()
        .map_err(|_| Refusal::new("`weakening_current` is no longer of torque and speed"))?;
    let [torque, speed] = inputs.map(|input| (input.range[0], input.range[1]));
    let tape = lower::surface(checked, index, Precision::F64);
    let mut interpreter = Interpreter::<f64>::new(&tape);
    // At zero torque and without weakening the current vector has no length and thus no angle.
    let mut angle = |torque: f64, speed: f64| Some(interpreter.eval(&[torque, speed]).atan2((torque / k_t).abs()).to_degrees());
    let measured =
        points.iter().filter(|[_, at, _]| (speed.0..=speed.1).contains(at)).map(|[torque, speed, _]| (*torque, *speed));
    let words = Words { title: "Figure 2: current advance over torque and speed", x: "torque [N m]", y: "speed [rad/s]" };
    let map = plot::map(
        &words,
        "deg",
        torque,
        speed,
        &mut angle,
        &[Series::new("points of the bench at the voltage limit", PINK, Mark::Circle, measured.collect())],
    )?;

    let column = |trace: &Trace, of: fn(&Row) -> f64| trace.rows.iter().map(|row| (row.time, of(row))).collect::<Vec<_>>();
    let pair = |title: &str, y: &str, of: fn(&Row) -> f64| {
        let series = [
            Series::new("full controller", GREY, Mark::Line, column(full, of)),
            Series::new("surface, embedded step", ORANGE, Mark::Line, column(surface, of)),
        ];
        plot::curves(&Words { title, x: "time [s]", y }, &series)
    };
    let torque = pair("Figure 6: torque in a run-up, coarse encoder", "torque [N m]", |row| row.torque)?;
    let speed = pair("Figure 6: speed in a run-up, coarse encoder", "speed [rad/s]", |row| row.truth.speed)?;
    let current = pair("d-axis reference in a run-up", "i_d [A]", |row| row.references.i_d_a)?;

    let mut table =
        "<table>\n<tr><th>surface</th><th>mean, deg</th><th>99th percentile, deg</th><th>operations</th></tr>\n".to_string();
    for Form { name, mean, p99, operations } in forms {
        table += &format!("<tr><td>{}</td><td>{mean:.3}</td><td>{p99:.2}</td><td>{operations}</td></tr>\n", escaped(name));
    }
    table += "</table>\n";
    let section = format!(
        "<h2>Case 1: a motor in flux weakening</h2>\n\
         <p>A dynamometer plan of 90 of 180 points, run to steady state with sensor noise; surfaces of the weakening current from those at the voltage \
         limit (<a href=\"motor/fit.html\">report of the fit</a>); the controller with these surfaces beside the full one, which solves the circle diagram every \
         millisecond.</p>\n<div class=\"plots\">\n{map}{speed}{current}</div>\n\
         <p>Difference of the current advance from the full controller's, over unseen random profiles, in the weakening region only; every form fitted to \
         the same points.</p>\n{table}{}",
        times.html()
    );
    Ok((torque, section))
}
