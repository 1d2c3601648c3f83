//! `rsm cosim`: runs a co-simulation from its scenario. Broker and federates are processes of this host; or it prints the commands for each host.
//!
//! In: a scenario. Out: the records of all roles in one folder, the exit status of every process, and whether the records are identical, bit by bit,
//! to those of one process. The processes are `rsm federate`, started by this same program.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use clap::Args;
use rsm_core::source::Source;
use rsm_link::helics::Library;
use rsm_link::loops::{self, Role, Table};
use rsm_link::scenario::{Scenario, Start};
use serde_json::{Map, Value, json};

use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// The scenario file
    scenario: PathBuf,
    /// The folder for the records: each role writes ROLE.csv
    #[arg(long)]
    out: PathBuf,
    /// Print the commands for each host and start nothing. This is the default if the scenario has several hosts and --host is not given
    #[arg(long, conflicts_with_all = ["host", "alone", "check"])]
    commands: bool,
    /// Start only the processes of this host of the scenario
    #[arg(long, conflicts_with_all = ["alone", "check"])]
    host: Option<String>,
    /// Run all roles in one process, without HELICS. The records are the same
    #[arg(long, conflicts_with = "check")]
    alone: bool,
    /// Compare the records bit by bit with those of one process; exit status 1 if they differ
    #[arg(long)]
    check: bool,
    /// The HELICS library, a file or a folder [default: the variable RSM_HELICS, then the system's library path]
    #[arg(long, value_name = "PATH")]
    helics: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// After the first process has failed, the others end by themselves within 5 s. A process that still runs after this time is killed.
const END_TIMEOUT: Duration = Duration::from_secs(10);

pub fn run(arguments: &Arguments) -> Outcome {
    let scenario = Scenario::read(&Source::read(&arguments.scenario)?)?;
    if arguments.alone {
        return alone(arguments, &scenario);
    }
    let hosts = scenario.hosts();
    if let Some(host) = arguments.host.as_deref().filter(|host| !hosts.contains(host)) {
        let known = if hosts.is_empty() { "a scenario with hosts".to_string() } else { format!("one of {}", hosts.join(", ")) };
        return Err(Refusal::new(format!("{}: found no host `{host}`, expected {known}", arguments.scenario.display())));
    }
    let starts = scenario.commands(&arguments.out.display().to_string());
    if arguments.commands || (arguments.host.is_none() && hosts.len() > 1) {
        return print(arguments, &starts);
    }
    // Load the library once here: one error message in place of one from every process.
    Library::load(arguments.helics.as_deref()).map_err(Refusal)?;
    let here = starts.into_iter().filter(|start| arguments.host.is_none() || start.host == arguments.host).collect();
    let ended = start_and_wait(here, arguments.helics.as_deref())?;
    print_result(arguments, &scenario, &ended)
}

/// A word quoted for a shell.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:,=+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.to_string() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

fn print(arguments: &Arguments, starts: &[Start]) -> Outcome {
    let line = |start: &Start| format!("rsm {}", start.arguments.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" "));
    if arguments.json {
        let commands: Vec<Value> =
            starts.iter().map(|it| json!({ "host": it.host, "process": it.process, "command": line(it) })).collect();
        output::json(&json!({ "commands": commands }))?;
        return Ok(Answer::Positive);
    }
    let mut hosts: Vec<Option<&str>> = Vec::new();
    for start in starts {
        if !hosts.contains(&start.host.as_deref()) {
            hosts.push(start.host.as_deref());
        }
    }
    for host in hosts {
        output::line(&format!("# on {}", host.unwrap_or("any host")))?;
        for start in starts.iter().filter(|start| start.host.as_deref() == host) {
            output::line(&line(start))?;
        }
    }
    Ok(Answer::Positive)
}

/// A process that has ended.
struct Ended {
    process: String,
    /// `None` if a signal ended the process.
    status: Option<i32>,
    /// Its output as JSON.
    output: Value,
}

/// A child process that is killed when this value is dropped, for example after an error.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start_and_wait(starts: Vec<Start>, helics: Option<&Path>) -> Result<Vec<Ended>, Refusal> {
    let program = std::env::current_exe()
        .map_err(|error| Refusal::new(format!("the path of this program cannot be determined: {error}")))?;
    let mut running = Vec::new();
    for start in starts {
        let mut command = Command::new(&program);
        command.args(&start.arguments).arg("--json").stdin(Stdio::null()).stdout(Stdio::piped());
        if let Some(helics) = helics {
            command.arg("--helics").arg(helics);
        }
        let child = command.spawn().map_err(|error| Refusal::new(format!("`{}` cannot be started: {error}", start.process)))?;
        running.push((start.process, Guarded(child)));
    }
    let mut ended = Vec::new();
    let mut failed: Option<Instant> = None;
    while !running.is_empty() {
        let mut still = Vec::new();
        for (process, mut child) in running {
            match child.0.try_wait() {
                Ok(None) => still.push((process, child)),
                Ok(Some(status)) => {
                    if !status.success() {
                        failed.get_or_insert_with(Instant::now);
                    }
                    // Each process prints one JSON object, which fits in the buffer of the pipe.
                    let mut output = String::new();
                    let _ = child.0.stdout.take().map(|mut pipe| pipe.read_to_string(&mut output));
                    let output = serde_json::from_str(&output).unwrap_or(Value::Null);
                    ended.push(Ended { process, status: status.code(), output });
                }
                Err(error) => return Err(Refusal::new(format!("`{process}` cannot be waited for: {error}"))),
            }
        }
        running = still;
        if failed.is_some_and(|since| since.elapsed() > END_TIMEOUT) {
            for (process, child) in running.drain(..) {
                stderr_line!("{process}: did not end in time and was stopped");
                drop(child);
                ended.push(Ended { process, status: None, output: Value::Null });
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(ended)
}

/// The records of a run in one process, by role.
fn of_one_process(scenario: &Scenario) -> Vec<(Role, Table)> {
    let loops: Vec<_> = scenario.loops().map(|control_loop| (control_loop, loops::alone(control_loop, scenario.run))).collect();
    let table = |role: Role| {
        let [plant, exchanged] =
            &loops.iter().find(|(control_loop, _)| *control_loop == role.of_loop()).expect("both sides take part").1;
        if matches!(role, Role::Plant(_)) { plant.clone() } else { exchanged.clone() }
    };
    scenario.roles().map(|role| (role, table(role))).collect()
}

fn alone(arguments: &Arguments, scenario: &Scenario) -> Outcome {
    let began = Instant::now();
    let tables = of_one_process(scenario);
    let seconds = began.elapsed().as_secs_f64();
    let path = |role: Role| arguments.out.join(format!("{}.csv", role.unique_name()));
    let files: Vec<_> = tables.iter().map(|(role, table)| (path(*role), table.csv())).collect();
    output::write_all(&files)?;
    let rate = scenario.run.ticks as f64 / seconds;
    if arguments.json {
        let records: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
        output::json(
            &json!({ "scenario": scenario.name, "ticks": scenario.run.ticks, "steps_per_second": rate, "records": records }),
        )?;
    } else {
        stderr_line!("{}: {} ticks in one process, {rate:.0} a second", scenario.name, scenario.run.ticks);
    }
    Ok(Answer::Positive)
}

fn print_result(arguments: &Arguments, scenario: &Scenario, ended: &[Ended]) -> Outcome {
    let all_good = ended.iter().all(|it| it.status == Some(0));
    let mut differ = Vec::new();
    if arguments.check && all_good {
        for (role, table) in of_one_process(scenario) {
            let path = arguments.out.join(format!("{}.csv", role.unique_name()));
            let found = std::fs::read_to_string(&path).unwrap_or_default();
            if found != table.csv() {
                differ.push(role.unique_name());
            }
        }
    }
    let equal = (arguments.check && all_good).then_some(differ.is_empty());
    let status = |it: &Ended| it.status.map_or("ended by a signal".to_string(), |status| format!("status {status}"));
    if arguments.json {
        let processes: Map<String, Value> = ended
            .iter()
            .map(|it| (it.process.clone(), json!({ "status": it.status, "roles": it.output.get("roles") })))
            .collect();
        output::json(&json!({
            "scenario": scenario.name,
            "ticks": scenario.run.ticks,
            "core": scenario.core.name(),
            "processes": processes,
            "equal_to_one_process": equal,
        }))?;
    }
    for it in ended.iter().filter(|it| it.status != Some(0)) {
        stderr_line!("{}: {}", it.process, status(it));
    }
    match equal {
        Some(true) => stderr_line!("{}: the records are identical, bit by bit, to those of one process", scenario.name),
        Some(false) => stderr_line!("{}: the records differ from those of one process: {}", scenario.name, differ.join(", ")),
        None => stderr_line!(
            "{}: {} processes, {}",
            scenario.name,
            ended.len(),
            if all_good { "all processes ended without an error" } else { "not all processes ended without an error" }
        ),
    }
    Ok(if all_good && equal != Some(false) { Answer::Positive } else { Answer::Negative })
}
