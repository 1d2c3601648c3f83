//! `rsm federate`: sides of a loop, recorders and the broker of a lock-step on HELICS.
//!
//! In: roles and the address of the broker. Out: a CSV file for each role, with complete rows even if a peer was lost, and figures. Exit status 1: a
//! peer or the broker was lost during the run.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use host_loop::Summary;
use rsm_link::federate::{self, Done, Settings};
use rsm_link::helics::{Address, Core, Library};
use rsm_link::loops::{Loop, Role, Run};
use serde_json::{Value, json};

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The roles of this process: sides of the motor's loop (`motor`, `controller`), sides of the car's loop (`driveline`, `throttle`), a `recorder`;
    /// or only the `broker`
    #[arg(required = true, value_parser = ["motor", "controller", "driveline", "throttle", "recorder", "broker"])]
    roles: Vec<String>,
    /// The address of the broker, HOST:PORT
    #[arg(long, value_parser = Address::parse)]
    broker: Address,
    /// The transport: `tcp_ss` between hosts, `ipc` on one host (the port is then a name)
    #[arg(long, default_value = "tcp_ss", value_parser = core)]
    core: Core,
    /// Duration of the run, in s of simulated time
    #[arg(long, default_value_t = 2.0, value_parser = seconds)]
    seconds: f64,
    /// Moment of inertia of the load on the motor's shaft, in kg m^2
    #[arg(long, default_value_t = 0.0, value_parser = inertia)]
    load_inertia: f64,
    /// The loop that a recorder records
    #[arg(long = "loop", default_value = "motor", value_parser = loop_of)]
    listened: Loop,
    /// For the broker: the number of federates, one for each role
    #[arg(long, value_name = "N", required_if_eq("roles", "broker"), value_parser = clap::value_parser!(u16).range(1..))]
    federates: Option<u16>,
    /// The folder for the records: each role writes ROLE.csv
    #[arg(long)]
    out: Option<PathBuf>,
    /// The HELICS library, a file or a folder [default: the variable RSM_HELICS, then the system's library path]
    #[arg(long, value_name = "PATH")]
    helics: Option<PathBuf>,
    /// Time limit for the broker and all federates to join, in s
    #[arg(long, default_value_t = 30.0, value_parser = seconds)]
    wait: f64,
    /// Time without progress after which a peer counts as lost, in s
    #[arg(long, default_value_t = 4.0, value_parser = seconds)]
    silence: f64,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn core(word: &str) -> Result<Core, String> {
    let found = Core::ALL.into_iter().find(|(name, _)| *name == word);
    found.map(|(_, core)| core).ok_or_else(|| format!("expected one of {}", Core::ALL.map(|(name, _)| name).join(", ")))
}

pub(super) fn loop_of(word: &str) -> Result<Loop, String> {
    let found = Loop::ALL.into_iter().find(|it| it.name() == word);
    found.ok_or_else(|| format!("expected one of {}", Loop::ALL.map(Loop::name).join(", ")))
}

/// A time in s: above 0, at most one day, because all rows (one for each millisecond) are kept in memory.
pub(super) fn seconds(word: &str) -> Result<f64, String> {
    let number = word.parse::<f64>().ok().filter(|number| (0.001..=86_400.0).contains(number));
    number.ok_or_else(|| "expected seconds from 0.001 to 86400".to_string())
}

pub(super) fn inertia(word: &str) -> Result<f64, String> {
    // Larger moments of inertia are refused. 1000 kg m^2 is 1000 kg at a radius of 1 m: this motor cannot turn such a load.
    let number = word.parse::<f64>().ok().filter(|number| (0.0..=1000.0).contains(number));
    number.ok_or_else(|| "expected kg m^2 from 0 to 1000".to_string())
}

pub fn run(arguments: &Arguments) -> Outcome {
    let ticks = (arguments.seconds * 1000.0).round() as u64;
    let settings = Settings {
        broker: arguments.broker.clone(),
        core: arguments.core,
        run: Run { ticks, load_inertia: arguments.load_inertia },
        wait: Duration::from_secs_f64(arguments.wait),
        silence: Duration::from_secs_f64(arguments.silence),
    };
    let roles: Option<Vec<Role>> = arguments.roles.iter().map(|word| Role::of(word, arguments.listened)).collect();
    let Some(roles) = roles else { return broker(arguments, &settings) };
    if let Some(twice) = roles.iter().enumerate().find(|(place, role)| roles[..*place].contains(role)) {
        return Err(Refusal::new(format!(
            "found the role `{}` twice, expected each role once in a federation",
            twice.1.name()
        )));
    }
    if arguments.federates.is_some() {
        return Err(Refusal::new("--federates: found without the role `broker`; only the broker takes this option"));
    }
    let library = Library::load(arguments.helics.as_deref()).map_err(Refusal)?;
    let names = || roles.iter().map(|role| role.unique_name()).collect::<Vec<_>>().join(", ");
    let done = federate::run(library, &roles, &settings, || output::stderr(format_args!("{}: the run begins\n", names())));
    print_result(arguments, &done)
}

fn broker(arguments: &Arguments, settings: &Settings) -> Outcome {
    if arguments.roles.len() > 1 {
        return Err(Refusal::new("found `broker` with other roles, expected `broker` alone: it needs a process of its own"));
    }
    let library = Library::load(arguments.helics.as_deref()).map_err(Refusal)?;
    let federates = usize::from(arguments.federates.unwrap_or(1));
    let begins = || output::stderr(format_args!("broker at {}: all have joined: {federates}\n", settings.broker));
    federate::broker(library, federates, settings, begins)
        .map_err(|words| Refusal::new(format!("broker at {}: {words}", settings.broker)))?;
    if arguments.json {
        output::json(&json!({ "broker": settings.broker.to_string(), "core": settings.core.name(), "federates": federates }))?;
    }
    Ok(Answer::Positive)
}

/// Writes the records and prints the result of each role.
fn print_result(arguments: &Arguments, done: &[Done]) -> Outcome {
    let mut files = Vec::new();
    let mut objects = Vec::new();
    for it in done {
        let record = arguments.out.as_ref().map(|folder| folder.join(format!("{}.csv", it.role.unique_name())));
        objects.push(object(it, record.as_deref()));
        // A record without rows is not written.
        files.extend(record.filter(|_| it.table.rows() > 0).map(|path| (path, it.table.csv())));
    }
    output::write_all(&files)?;
    let mut lines = Vec::new();
    for it in done {
        let name = it.role.unique_name();
        if let Some(lost) = &it.lost {
            lines.push(format!("{name}: {lost}\n  {} whole ticks are recorded", it.table.rows()));
        } else {
            let trips = it.round_trip.map_or(String::new(), |trip| {
                format!(", round trips {:.0} us p50, {:.0} us p99", us(trip.p50_ns), us(trip.p99_ns))
            });
            lines.push(format!("{name}: {} ticks, {:.0} a second{trips}", it.table.rows(), it.steps_per_second));
        }
    }
    let lines = lines.join("\n");
    if arguments.json {
        output::json(&json!({ "roles": objects }))?;
    }
    let lost = done.iter().any(|it| it.lost.is_some());
    if lost && !done.iter().any(|it| it.began) {
        return Err(Refusal(lines));
    }
    stderr_line!("{lines}");
    Ok(if lost { Answer::Negative } else { Answer::Positive })
}

fn object(done: &Done, record: Option<&std::path::Path>) -> Value {
    json!({
        "role": done.role.unique_name(),
        "loop": done.role.of_loop().name(),
        "ticks": done.table.rows(),
        "steps_per_second": output::finite(done.steps_per_second),
        "round_trip_us": done.round_trip.map(|trip| micros(&trip)),
        "bad_samples": done.bad_samples,
        "record": record.map(|path| path.display().to_string()),
        "lost": done.lost,
    })
}

fn us(ns: u64) -> f64 {
    ns as f64 * 1e-3
}

/// A distribution of times in microseconds.
pub(super) fn micros(of: &Summary) -> Value {
    json!({ "p50": us(of.p50_ns), "p99": us(of.p99_ns), "max": us(of.max_ns) })
}
