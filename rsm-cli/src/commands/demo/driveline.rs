//! Case 2 of the demo: driveline oscillation (shuffle), from tip-in runs to the compensated car.
//!
//! plan -> track -> estimator -> fit -> compensator -> rounds, for the car without lash and the car with lash; then check, emit and compare bits for
//! the car with lash.

use std::path::Path;

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::Input;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_core::threads;
use rsm_rigs::track::figures::{self, Car, Figures, Study};
use rsm_rigs::track::gearbox::{self, OTHER_RATIOS, Prediction, Residual};
use rsm_rigs::track::plan::TrackPlan;
use rsm_rigs::track::rounds;
use rsm_rigs::track::run::{COAST_ROWS, PERIOD, Trace};
use rsm_sim::plant_file::PlantFile;
use serde_json::{Map, Value, json};

use super::paper::Paper;
use super::{Printer, Section, chain};
use crate::outcome::Refusal;
use crate::plot::{self, BLUE, GREY, Mark, ORANGE, PINK, Series, Words};
use crate::{output, report};

/// The shipped car.
const PLANT: &str = include_str!("../../../../rsm-sim/plants/driveline.toml");

/// The seed of the noise, of the run order and of the holdout set. It is the same as that of the shipped data.
const SEED: u64 = 1;

/// The gear and the engine speed (rad/s) whose runs are drawn: second gear, 3000 rpm.
const SHOWN: (usize, f64) = (2, 3000.0 * std::f64::consts::PI / 30.0);

/// Runs the case.
pub fn run(printer: &Printer, folder: &Path, full: bool, paper: &mut Paper) -> Result<Section, Refusal> {
    let mut results = Map::new();
    let plant = PlantFile::read(&Source::new("driveline.toml", PLANT))?;
    output::write_all(&[
        (folder.join("plant.toml"), PLANT.to_string()),
        (folder.join("plan.csv"), TrackPlan::experiment(SEED).csv()),
    ])?;
    printer.print("track    25 tip-in runs, five speeds in each gear, without lash and with 3 degrees of it; rounds of the compensator ...")?;
    let study = Study { seed: SEED, threads: threads::available() };
    let found = figures::figures(&plant, &study)?;
    let Figures { without_lash, with_lash, left } = &found;
    for (name, car) in [("tip-in", without_lash), ("tip-in-lash", with_lash)] {
        let best = &car.tuned.rounds[car.tuned.best];
        output::write_all(&[
            (folder.join(format!("{name}.csv")), rounds::data(&car.tuned.uncompensated, &best.pole_damping)),
            (folder.join(format!("{name}-unseen.csv")), rounds::unseen_data(&car.unseen)),
        ])?;
    }
    for (name, car) in [("without lash", without_lash), ("with lash", with_lash)] {
        printer.print(&format!(
            "track    {name}: error of the damping surface {:.2} % on holdout runs, {:.2} % at second order as the paper has it; compensated damping ratio {:.3}, largest residual {:.3}; overshoot {:.2} of before \
             at worst, rise time {:.2} times; {} rounds",
            car.damping_residual_percent,
            car.damping_residual_percent_second_order,
            car.zeta_mean,
            car.zeta_max_residual,
            car.overshoot_ratio_worst,
            car.rise_time_ratio[0],
            car.tuned.rounds.len()
        ))?;
    }
    paper.note("damping_residual_percent", with_lash.damping_residual_percent);
    paper.note("damping_residual_percent_second_order", with_lash.damping_residual_percent_second_order);
    paper.note("zeta_mean", without_lash.zeta_mean);
    paper.note("zeta_max_residual", without_lash.zeta_max_residual);
    paper.note("zeta_mean_lash", with_lash.zeta_mean);
    paper.note("zeta_max_residual_lash", with_lash.zeta_max_residual);
    paper.note("overshoot_ratio_worst_lash", with_lash.overshoot_ratio_worst);
    paper.note("rise_time_ratio", with_lash.rise_time_ratio[0]);

    chain::print_fit(printer, &with_lash.surfaces)?;
    let model = with_lash.tuned.model();
    let good = chain::compiled(printer, folder, model, &mut results)?;
    output::write_all(&[(folder.join("fit.html"), report::fit(&with_lash.surfaces)?)])?;
    results.insert("without_lash".into(), of_car(without_lash));
    results.insert("with_lash".into(), of_car(with_lash));
    let left_json = left.iter().map(|it| {
        json!({ "without": it.what, "zeta_mean": it.zeta_mean, "zeta_max_residual": it.zeta_max_residual, "overshoot_max": it.overshoot_max })
    });
    results.insert("left".into(), left_json.collect());
    let mut text = html(&found, &Checked::from_model(model)?)?;
    if full {
        text += &other_cars(printer, &plant, &study, &mut results)?;
    }
    Ok(Section { good, plot: String::new(), html: text, json: Value::Object(results) })
}

/// Errors for other cars: of surfaces over the gear ratio, for a gearbox without runs; of surfaces with the load as input, for other loads.
fn other_cars(
    printer: &Printer,
    plant: &PlantFile,
    study: &Study,
    results: &mut Map<String, Value>,
) -> Result<String, Refusal> {
    let Prediction { unseen, other, by_gear_other, .. } = gearbox::prediction(plant, OTHER_RATIOS, study)?;
    let loaded = gearbox::loaded(plant, study)?;
    let lines = [
        ("over the gear ratio, holdout runs", &unseen),
        ("over the gear ratio, a gearbox without runs", &other),
        ("over the gear number, a gearbox without runs", &by_gear_other),
        ("with the load as third factor, holdout loads", &loaded.unseen),
    ];
    let mut table =
        "<table>\n<tr><th>surfaces</th><th>damping, mean residual</th><th>frequency, mean residual</th></tr>\n".to_string();
    let mut found = Map::new();
    for (name, residual) in lines {
        let Residual { damping_percent, frequency_percent, .. } = residual;
        printer.print(&format!(
            "surfaces {name}: error of the damping {damping_percent:.2} %, of the frequency {frequency_percent:.2} %"
        ))?;
        table += &format!("<tr><td>{name}</td><td>{damping_percent:.2} %</td><td>{frequency_percent:.2} %</td></tr>\n");
        found.insert(name.into(), json!({ "damping_percent": damping_percent, "frequency_percent": frequency_percent }));
    }
    results.insert("other_cars".into(), Value::Object(found));
    let [least, most] = loaded.damping_moved_percent;
    Ok(format!(
        "<p>The car without lash: other gearboxes and loads.</p>\n{table}</table>\n\
         <p>The greatest load moves the damping by {least:.1} to {most:.1} %.</p>\n"
    ))
}

fn of_car(car: &Car) -> Value {
    let rounds = car.tuned.rounds.iter().map(|round| {
        json!({
            "zeta_mean": round.zeta_mean,
            "zeta_max_residual": round.zeta_max_residual,
            "overshoot_ratio_worst": round.overshoot_ratio_worst,
        })
    });
    let flagged = car.flagged.iter().map(|(run, reason)| json!({ "run": run, "reason": reason }));
    json!({
        "damping_residual_percent": car.damping_residual_percent,
        "damping_residual_percent_second_order": car.damping_residual_percent_second_order,
        "zeta_mean": car.zeta_mean,
        "zeta_max_residual": car.zeta_max_residual,
        "overshoot_ratio_worst": car.overshoot_ratio_worst,
        "overshoot_runs": car.overshoot_runs,
        "overshoot_elsewhere": car.overshoot_elsewhere,
        "fall_back_ratio_mean_and_largest": car.fall_back_ratio,
        "rise_time_ratio_mean_and_largest": car.rise_time_ratio,
        "rounds": rounds.collect::<Vec<_>>(),
        "best_round": car.tuned.best + 1,
        "flagged": flagged.collect::<Vec<_>>(),
    })
}

/// Acceleration over the time since the step.
fn acceleration(trace: &Trace) -> Vec<(f64, f64)> {
    let step = COAST_ROWS as f64 * PERIOD;
    // The plot begins a tenth of a second before the step, to show the start of the run.
    trace.time.iter().zip(&trace.acceleration).map(|(time, a)| (time - step, *a)).filter(|(time, _)| *time > -0.1).collect()
}

/// Damping ratio of the response over road speed.
fn over_speed(car: &Car, compensated: bool) -> Vec<(f64, f64)> {
    let runs = if compensated { &car.compensated } else { &car.uncompensated };
    runs.iter().map(|(measured, _)| (measured.road_speed, measured.response.shape.damping_ratio)).collect()
}

/// The section of the report.
fn html(found: &Figures, checked: &Checked) -> Result<String, Refusal> {
    let Figures { without_lash, with_lash, left } = found;
    let (gear, engine_speed) = SHOWN;
    let missing = || Refusal::new("the plan lost the run that is shown");
    let mut plots = String::new();
    for (name, car) in [("without lash", without_lash), ("with 3 degrees of lash", with_lash)] {
        let before = figures::nearest(&car.uncompensated, gear, engine_speed).ok_or_else(missing)?;
        let after = figures::nearest(&car.compensated, gear, engine_speed).ok_or_else(missing)?;
        let series = [
            Series::new("as it is", GREY, Mark::Line, acceleration(&before.1)),
            Series::new("compensated", ORANGE, Mark::Line, acceleration(&after.1)),
        ];
        let title = format!("Tip-in in gear {gear}, {name}");
        plots += &plot::curves(&Words { title: &title, x: "time since the step [s]", y: "acceleration [m/s2]" }, &series)?;
    }
    plots += &surface(checked, with_lash)?;
    for (name, car) in [("without lash", without_lash), ("with 3 degrees of lash", with_lash)] {
        let last = car.compensated.iter().map(|(measured, _)| measured.road_speed).fold(0.0, f64::max);
        let series = [
            Series::new("target", BLUE, Mark::Line, vec![(0.0, 0.7), (last, 0.7)]),
            Series::new("as it is", GREY, Mark::Cross, over_speed(car, false)),
            Series::new("compensated", ORANGE, Mark::Circle, over_speed(car, true)),
        ];
        let title = format!("Figure 7: damping ratio of the response, {name}");
        plots += &plot::curves(&Words { title: &title, x: "road speed [m/s]", y: "damping ratio" }, &series)?;
    }
    let mut forms =
        "<table>\n<tr><th>car</th><th>terms of the damping surface</th><th>mean residual on holdout runs</th></tr>\n"
            .to_string();
    for (name, car) in [("without lash", without_lash), ("with lash", with_lash)] {
        let terms =
            car.surfaces.model.surfaces.iter().find(|it| it.name == "damping_ratio").map_or(0, |surface| surface.terms.len());
        forms += &format!("<tr><td>{name}</td><td>{terms}, ours</td><td>{:.2} %</td></tr>\n", car.damping_residual_percent);
        let second = car.damping_residual_percent_second_order;
        forms += &format!("<tr><td>{name}</td><td>6, second order as the paper has it</td><td>{second:.2} %</td></tr>\n");
    }
    forms += "</table>\n";
    let mut rounds = "<table>\n<tr><th>car</th><th>round</th><th>mean damping ratio</th><th>largest residual</th><th>largest overshoot, relative to before</th></tr>\n".to_string();
    for (name, car) in [("without lash", without_lash), ("with lash", with_lash)] {
        for (k, round) in car.tuned.rounds.iter().enumerate() {
            let best = if k == car.tuned.best { " (kept)" } else { "" };
            rounds += &format!(
                "<tr><td>{name}</td><td>{}{best}</td><td>{:.3}</td><td>{:.3}</td><td>{:.2}</td></tr>\n",
                k + 1,
                round.zeta_mean,
                round.zeta_max_residual,
                round.overshoot_ratio_worst
            );
        }
    }
    rounds += "</table>\n";
    let mut rest =
        "<table>\n<tr><th>removed</th><th>mean damping ratio</th><th>largest residual</th><th>largest overshoot</th></tr>\n"
            .to_string();
    for it in left {
        rest += &format!(
            "<tr><td>{}</td><td>{:.3}</td><td>{:.3}</td><td>{:.1} %</td></tr>\n",
            it.what,
            it.zeta_mean,
            it.zeta_max_residual,
            100.0 * it.overshoot_max
        );
    }
    rest += "</table>\n";
    let flagged = |car: &Car| match car.flagged.as_slice() {
        [] => "none".to_string(),
        runs => runs.iter().map(|(run, reason)| format!("run {run} ({reason})")).collect::<Vec<_>>().join(", "),
    };
    Ok(format!(
        "<h2>Case 2: a driveline under a drive-by-wire throttle</h2>\n\
         <p>25 tip-in runs, each reduced by one fixed estimator; surfaces of damping ratio, damping error and shuffle frequency over speed and gear \
         (<a href=\"driveline/fit.html\">report of the fit</a>); the compensator that they schedule, tuned in rounds and then driven again with fresh noise. Flagged runs: \
         {} without lash, {} with it; all runs count.</p>\n<div class=\"plots\">\n{plots}</div>\n\
         <p>The damping surface, beside the form of the original work on the same runs.</p>\n{forms}\
         <p>Rounds of the pole damping.</p>\n{rounds}\
         <p>Causes of the rest of the error with lash: the same compensator on a car without one of its properties.</p>\n{rest}",
        flagged(without_lash),
        flagged(with_lash)
    ))
}

/// The damping surface in the region that the runs support.
fn surface(checked: &Checked, car: &Car) -> Result<String, Refusal> {
    let lost = || Refusal::new("the driveline's model lost its surface `damping_ratio` of speed and gear");
    let index = checked.model().surfaces.iter().position(|surface| surface.name == "damping_ratio").ok_or_else(lost)?;
    let inputs: [Input; 2] = checked.inputs_of(&checked.model().surfaces[index]).try_into().map_err(|_| lost())?;
    let [speed, gear] = inputs.map(|input| (input.range[0], input.range[1]));
    let tape = lower::surface(checked, index, Precision::F64);
    let mut interpreter = Interpreter::<f64>::new(&tape);
    let support = lower::support(checked, index, Precision::F64);
    let mut supported = support.as_ref().map(Interpreter::<f64>::new);
    let mut value = |speed: f64, gear: f64| {
        let inside = supported.as_mut().is_none_or(|supported| supported.eval(&[speed, gear]) == 1.0);
        inside.then(|| interpreter.eval(&[speed, gear]))
    };
    let runs = car.tuned.uncompensated.iter().map(|measured| (measured.road_speed, measured.run.gear as f64)).collect();
    let words = Words { title: "Figure 5: damping ratio of the driveline, with lash", x: "road speed [m/s]", y: "gear" };
    plot::map(&words, "", speed, gear, &mut value, &[Series::new("runs", PINK, Mark::Circle, runs)])
}
