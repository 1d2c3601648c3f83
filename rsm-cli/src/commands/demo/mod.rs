//! `rsm demo`: both experiments of the original work, from the plan to the controller, with every step.
//!
//! Motor: plan -> bench -> fit -> check -> emit -> compare bits -> closed loop. Driveline: plan -> track -> fit -> compensator -> rounds. Then the 1
//! kHz loop against a simulated motor in real time, and one page with the figures. Plants, plans and specifications are part of the program, so the
//! demo runs anywhere. It writes all its files to one folder.

mod chain;
mod driveline;
mod faults;
mod measured_motor;
mod motor;
mod paper;
mod speed;
mod twins;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::{Map, Value, json};

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;
use crate::page::page;
use crate::page::summary::{self, Tone};
use paper::Paper;

/// Duration of the loop in real time in s: short demo, full demo.
const LOOP_S: [f64; 2] = [2.0, 60.0];

#[derive(Args)]
pub struct Arguments {
    /// The folder for all files of the demo
    #[arg(long, default_value = "rsm-demo")]
    out: PathBuf,
    /// Run the long demo: one minute of the real-time loop, all 180 bench points, longer profiles, other gearboxes and loads, and sensor faults in
    /// the motor's loop
    #[arg(long)]
    full: bool,
    /// Duration of the real-time loop in s [default: 2, with --full 60]
    #[arg(long)]
    seconds: Option<f64>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Prints a line on standard output, or on standard error with `--json`.
struct Printer {
    json: bool,
}

impl Printer {
    fn print(&self, line: &str) -> Result<(), Refusal> {
        if self.json {
            stderr_line!("{line}");
            Ok(())
        } else {
            output::line(line)
        }
    }
}

/// The result of a case.
struct Section {
    /// Whether every step succeeded.
    good: bool,
    /// The one plot that shows the result at the head of the page; empty if the case has none.
    plot: String,
    /// Its part of the report.
    html: String,
    json: Value,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let seconds = arguments.seconds.unwrap_or(LOOP_S[usize::from(arguments.full)]);
    if !(seconds > 0.0 && seconds <= 86_400.0) {
        return Err(Refusal::new(format!("--seconds: found {seconds}, expected more than 0 and at most 86400")));
    }
    let begin = Instant::now();
    let printer = Printer { json: arguments.json };
    let mut paper = Paper::default();
    let motor = motor::run(&printer, &arguments.out.join("motor"), arguments.full, &mut paper)?;
    let driveline = driveline::run(&printer, &arguments.out.join("driveline"), arguments.full, &mut paper)?;

    printer.print(&format!("loop     {seconds} s of the motor's 1 kHz loop against the simulated motor ..."))?;
    let run = host_runners::motor::run(&host_loop::Settings::new(1000.0, seconds));
    for line in run.to_string().lines() {
        printer.print(&format!("         {line}"))?;
    }
    paper.note("ticks", run.report.ticks_done as f64);
    paper.note("ticks_late", run.report.ticks_caught_up as f64);
    paper.note("deadlines_missed", run.report.deadlines_missed as f64);
    paper.note("under_runs", run.exchange.under_runs as f64);
    let looped: Value = serde_json::from_str(&run.json()).map_err(|error| Refusal::new(error.to_string()))?;

    let faults = if arguments.full { Some(faults::run(&printer)?) } else { None };

    let missed = paper.missed();
    for what in &missed {
        printer.print(&format!("missed   {what}"))?;
    }
    let report_path = arguments.out.join("report.html");
    let good = motor.good && driveline.good && missed.is_empty() && faults.as_ref().is_none_or(|faults| faults.good);
    let text = report(&paper, good, &motor, &driveline, &run.to_string(), faults.as_ref());
    output::write_all(&[(report_path.clone(), text)])?;
    printer.print(&format!("done     in {:.1} s; report {}", begin.elapsed().as_secs_f64(), report_path.display()))?;
    if arguments.json {
        let mut results = Map::new();
        results.insert("ok".into(), json!(good));
        results.insert("paper".into(), paper.json());
        results.insert("missed".into(), json!(missed));
        results.insert("motor".into(), motor.json);
        results.insert("driveline".into(), driveline.json);
        results.insert("loop".into(), looped);
        if let Some(faults) = faults {
            results.insert("faults".into(), faults.json);
        }
        results.insert("report".into(), json!(report_path.display().to_string()));
        output::json(&results)?;
    }
    Ok(if good { Answer::Positive } else { Answer::Negative })
}

/// The page: first the verdict, three numbers and one plot, then every figure and both cases.
fn report(paper: &Paper, good: bool, motor: &Section, driveline: &Section, looped: &str, faults: Option<&Section>) -> String {
    let missed = paper.missed().len();
    let (tone, state, sentence) = match (good, missed) {
        (true, _) => (
            Tone::Good,
            "all kept",
            "Every figure except the times is inside its bound, and every step from plan to controller succeeded.".to_string(),
        ),
        (false, 0) => (
            Tone::Bad,
            "a step failed",
            "Every figure is inside its bound, but a step from plan to controller failed: see below.".to_string(),
        ),
        (false, count) => (Tone::Bad, "missed", format!("{count} of the figures below are outside their bounds.")),
    };
    let body = format!(
        "<h1>Both experiments, measured again</h1>\n\
         <p class=\"lead\">Two experiments of \"Real-time simulation and control systems design by the Response Surface Methodology and designed experiments\", on \
         simulated plants with sensor noise: a motor controller whose flux weakening is a response surface, and a car whose driveline oscillation (shuffle) is damped with response surfaces. This simple motor has a closed form, which is cheaper \
         than its surfaces. A measured motor has none: there the surfaces take {} (the book, <i>Speed and accuracy</i>). With lash \
         the car's damping ratio stays above the target of 0.7: see the table.</p>\n\
         {}{}<div class=\"plots one\">{}</div>\n<h2>All figures</h2>\n\
         <p>The rows with a colour do not keep their bound.</p>\n{}{}{}<h2>The loop in real time</h2>\n<pre>{}</pre>\n{}",
        measured_motor::cost(),
        summary::verdict(tone, state, &sentence),
        summary::numbers(&paper.numbers()),
        motor.plot,
        paper.table(),
        motor.html,
        driveline.html,
        crate::page::escaped(looped),
        faults.map_or("", |faults| faults.html.as_str())
    );
    page("rsm demo", &body)
}
