//! `rsm sweep`: runs many simulations or diagnoses as a list of tasks, on all cores, as a shard, or on a Dask cluster.
//!
//! In: a scenario. Out: a folder with a JSON file for each task, then one table and one summary of all tasks. A task whose result exists is not run
//! again.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use rsm_core::source::Source;
use rsm_core::threads;
use rsm_diagnose::plant::{self, Options};
use rsm_sweep::dask::Cluster;
use rsm_sweep::scenario::Scenario;
use rsm_sweep::store::Store;
use rsm_sweep::summary::{self, CONFIDENCE, Summary};
use rsm_sweep::table::Table;
use rsm_sweep::tasks::{self, Task};
use rsm_sweep::{Case, bundle, dask, engine, parquet};
use serde_json::{Value, json};

use crate::commands::diagnose;
use crate::outcome::{Answer, Outcome, Refusal};
use crate::output;
use crate::page::number::{figure, short};

#[derive(Args)]
pub struct Arguments {
    /// The scenario file
    scenario: PathBuf,
    /// The folder of results: tasks/HASH.json for each task, table.csv and summary.json for all tasks
    #[arg(long, required_unless_present = "task", conflicts_with = "task")]
    out: Option<PathBuf>,
    /// Run part K of N of the list, without table and summary, for example as a task of a Slurm array
    #[arg(long, value_name = "K/N", conflicts_with_all = ["merge", "task"])]
    shard: Option<String>,
    /// Run nothing: copy the results of these folders into the folder of --out and write table and summary; exit status 1 if tasks have no result
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "task")]
    merge: Vec<PathBuf>,
    /// Run one task by its hash, and print its result
    #[arg(long, value_name = "HASH")]
    task: Option<String>,
    /// Where the tasks run
    #[arg(long, value_enum, default_value = "local", conflicts_with_all = ["merge", "task"])]
    engine: Engine,
    /// With --engine dask: the address of the scheduler, HOST:PORT
    #[arg(long, value_name = "HOST:PORT", required_if_eq("engine", "dask"))]
    scheduler: Option<String>,
    /// With --engine dask: the Python interpreter of this machine, with the package rsm-sweep-dask
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: String,
    /// With --engine dask: the command `rsm` on the workers
    #[arg(long, value_name = "PROGRAM", default_value = "rsm")]
    worker: String,
    /// The number of parallel tasks on this machine [default: all cores]. Results do not depend on it
    #[arg(long)]
    threads: Option<usize>,
    /// Also write table.parquet; needs a build with the feature parquet
    #[arg(long, conflicts_with_all = ["shard", "task"])]
    parquet: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Engine {
    /// The cores of this machine
    Local,
    /// A Dask cluster
    Dask,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let source = Source::read(&arguments.scenario)?;
    let scenario = if bundle::is_one(source.text()) {
        bundle::read(&source)?
    } else {
        let folder = arguments.scenario.parent().unwrap_or(Path::new(""));
        Scenario::read(&source, &|name| Source::read(&folder.join(name)))?
    };
    let tasks = tasks::list(&scenario)?;
    match (&arguments.task, &arguments.out) {
        (Some(hash), _) => alone(&scenario, &tasks, hash, arguments),
        (None, Some(out)) => all(&scenario, &tasks, out, arguments),
        // Unreachable: clap requires --out here.
        (None, None) => Err(Refusal::new("`--out` is missing")),
    }
}

/// The result of `rsm diagnose` for one case.
fn diagnosis(case: &Case<'_>) -> Result<Value, String> {
    let [training, validation, test] = case.records;
    let options = Options { threads: case.threads, progress: &|_| {} };
    let found = plant::diagnose_and_test(case.plant, training, validation, test, &options);
    found.map(|found| diagnose::value(case.plant.kind, &found)).map_err(|why| why.to_string())
}

fn has_failed(result: &Value) -> bool {
    !result["failed"].is_null()
}

/// Runs one task, as on a worker.
fn alone(scenario: &Scenario, tasks: &[Task], hash: &str, arguments: &Arguments) -> Outcome {
    let Some(task) = tasks.iter().find(|it| it.hash == hash) else {
        return Err(Refusal::new(format!(
            "{}: found no task with the hash `{hash}` in a list of {}: use the version of rsm and the files that made the list",
            arguments.scenario.display(),
            tasks.len()
        )));
    };
    let result = task.run(scenario, arguments.threads.unwrap_or_else(threads::available), &diagnosis);
    output::line(&result.to_string())?;
    Ok(if has_failed(&result) { Answer::Negative } else { Answer::Positive })
}

/// Reads a shard: `2/3` is the second of three.
fn shard(text: &str) -> Result<[usize; 2], Refusal> {
    let numbers = text.split_once('/').and_then(|(k, n)| Some([k.parse().ok()?, n.parse().ok()?]));
    match numbers {
        Some([shard, of]) if (1..=of).contains(&shard) => Ok([shard, of]),
        _ => Err(Refusal::new(format!("--shard: found `{text}`, expected K/N with K from 1 to N"))),
    }
}

fn all(scenario: &Scenario, tasks: &[Task], out: &Path, arguments: &Arguments) -> Outcome {
    if arguments.parquet && !parquet::IS_BUILT {
        return Err(Refusal::new("--parquet: this build writes no Parquet: build rsm with `--features parquet`"));
    }
    if arguments.threads == Some(0) {
        return Err(Refusal::new("--threads: found 0, expected at least 1"));
    }
    let part = arguments.shard.as_deref().map(shard).transpose()?;
    let own_tasks = part.map_or_else(|| tasks.iter().collect(), |part| tasks::shard(tasks, part));
    let others: Vec<Store> =
        arguments.merge.iter().map(|it| Store::open_read_only(it)).collect::<Result<_, _>>().map_err(Refusal)?;
    let store = Store::open(out).map_err(Refusal)?;
    let mut results: Vec<Option<Value>> = own_tasks.iter().map(|it| store.get(it)).collect();
    let remaining: Vec<&Task> =
        own_tasks.iter().zip(&results).filter_map(|(task, result)| result.is_none().then_some(*task)).collect();
    let existing = own_tasks.len() - remaining.len();
    let began = Instant::now();
    if arguments.merge.is_empty() {
        make(scenario, &remaining, &store, existing, arguments)?;
    } else {
        for task in &remaining {
            if let Some(result) = others.iter().find_map(|it| it.get(task)) {
                store.put(task, &result).map_err(Refusal)?;
            }
        }
    }
    let seconds = began.elapsed().as_secs_f64();
    // Each file is read only once: results of earlier runs before the tasks run, new results here.
    for (task, result) in own_tasks.iter().zip(&mut results).filter(|(_, result)| result.is_none()) {
        *result = store.get(task);
    }
    let counts = Counts {
        tasks: own_tasks.len(),
        existing,
        missing: results.iter().filter(|it| it.is_none()).count(),
        failed: results.iter().flatten().filter(|it| has_failed(it)).count(),
        others: store.count().saturating_sub(results.iter().flatten().count()),
    };
    let collected = if part.is_none() && counts.missing == 0 {
        Some(collect(scenario, tasks, &results, out, arguments.parquet, &counts)?)
    } else {
        None
    };
    if arguments.json {
        let path = |name: &str| collected.is_some().then(|| out.join(name).display().to_string());
        output::json(&json!({
            "sweep": scenario.name,
            "program": rsm_sweep::PROGRAM,
            "tasks": counts.tasks,
            "there": counts.existing,
            "run": counts.made(),
            "missing": counts.missing,
            "failed": counts.failed,
            "others": counts.others,
            "shard": arguments.shard,
            "seconds": seconds,
            "out": out.display().to_string(),
            "table": path("table.csv"),
            "parquet": if arguments.parquet { path("table.parquet") } else { None },
            "confidence": CONFIDENCE,
            "summary": collected.as_ref().map(|found| found.iter().map(value).collect::<Vec<_>>()),
        }))?;
    }
    print_result(scenario, &counts, seconds, arguments, collected.as_deref());
    for result in results.iter().flatten().filter(|it| has_failed(it)).take(1) {
        stderr_line!(
            "  the first that failed, {}: {}",
            result["task"].as_str().unwrap_or(""),
            result["failed"].as_str().unwrap_or("")
        );
    }
    Ok(if counts.missing == 0 && counts.failed == 0 { Answer::Positive } else { Answer::Negative })
}

/// Numbers of tasks.
struct Counts {
    tasks: usize,
    existing: usize,
    missing: usize,
    failed: usize,
    /// Results in the folder that belong to other lists.
    others: usize,
}

impl Counts {
    fn made(&self) -> usize {
        self.tasks - self.existing - self.missing
    }
}

/// Runs the remaining tasks, with a progress bar on a terminal.
fn make(
    scenario: &Scenario,
    remaining: &[&Task],
    store: &Store,
    existing: usize,
    arguments: &Arguments,
) -> Result<(), Refusal> {
    if remaining.is_empty() {
        return Ok(());
    }
    // Draws on standard error, and only on a terminal.
    let bar = ProgressBar::new((existing + remaining.len()) as u64);
    let style = ProgressStyle::with_template("{elapsed_precise} {wide_bar} {pos} of {len} tasks, {eta} left");
    bar.set_style(style.expect("the template is ours"));
    bar.set_position(existing as u64);
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    let threads = arguments.threads.unwrap_or_else(threads::available);
    let done = |_: &Task, _: &Value| bar.inc(1);
    let made = match (arguments.engine, arguments.scheduler.as_deref()) {
        (Engine::Dask, Some(scheduler)) => {
            let cluster = Cluster { scheduler, python: &arguments.python, program: &arguments.worker };
            dask::run(scenario, remaining, store, &cluster, &done)
        }
        _ => engine::run(scenario, remaining, store, threads, &diagnosis, &done),
    };
    bar.finish_and_clear();
    made.map_err(Refusal)
}

/// Writes the table and the summary.
fn collect(
    scenario: &Scenario,
    tasks: &[Task],
    results: &[Option<Value>],
    out: &Path,
    with_parquet: bool,
    counts: &Counts,
) -> Result<Vec<Summary>, Refusal> {
    let table = Table::of(scenario, tasks, results);
    let found = summary::of(scenario, &table);
    let summary = json!({
        "sweep": scenario.name,
        "program": rsm_sweep::PROGRAM,
        "tasks": counts.tasks,
        "failed": counts.failed,
        "confidence": CONFIDENCE,
        "summary": found.iter().map(value).collect::<Vec<_>>(),
    });
    let text = serde_json::to_string_pretty(&summary)
        .map_err(|error| Refusal::new(format!("summary.json cannot be written as JSON: {error}")))?;
    let mut files =
        vec![(out.join("table.csv"), table.csv().into_bytes()), (out.join("summary.json"), (text + "\n").into_bytes())];
    if with_parquet {
        files.push((out.join("table.parquet"), parquet::write(&table).map_err(Refusal)?));
    }
    output::write_all(&files)?;
    Ok(found)
}

fn value(summary: &Summary) -> Value {
    let number = output::finite;
    let quantile = |summary: &summary::Quantile| json!({ "share": summary.share, "value": number(summary.value), "low": summary.low, "high": summary.high });
    json!({
        "figure": summary.figure,
        "unit": summary.unit,
        "plant": summary.plant,
        "record": summary.record,
        "count": summary.count,
        "failed": summary.failed,
        "mean": number(summary.mean),
        "mean_interval": summary.mean_interval,
        "sd": number(summary.sd),
        "range": summary.range,
        "quantiles": summary.quantiles.iter().map(quantile).collect::<Vec<_>>(),
    })
}

fn print_result(scenario: &Scenario, counts: &Counts, seconds: f64, arguments: &Arguments, collected: Option<&[Summary]>) {
    let verb = if arguments.merge.is_empty() { "run" } else { "merged" };
    let made = counts.made();
    let rate = if made > 0 && seconds > 0.0 { format!(", {} a second", short(made as f64 / seconds)) } else { String::new() };
    let shard = arguments.shard.as_ref().map_or(String::new(), |it| format!(", shard {it}"));
    stderr_line!(
        "{}{shard}: {} tasks, {} with a result from before, {made} {verb} in {seconds:.1} s{rate}; {} failed, {} missing",
        scenario.name,
        counts.tasks,
        counts.existing,
        counts.failed,
        counts.missing
    );
    if counts.others > 0 && arguments.shard.is_none() {
        stderr_line!("  the folder contains {} results of other lists, which are in no table", counts.others);
    }
    let number = |value: f64| figure(Some(value));
    for it in collected.into_iter().flatten() {
        let interval = |low: Option<f64>, high: Option<f64>| match (low, high) {
            (None, None) => String::new(),
            (low, high) => {
                let end = |it: Option<f64>| it.map_or("?".to_string(), number);
                format!(" [{}, {}]", end(low), end(high))
            }
        };
        let quantiles = it
            .quantiles
            .iter()
            .filter(|it| [0.05, 0.5, 0.95].contains(&it.share))
            .map(|it| format!("{} % {}{}", it.share * 100.0, number(it.value), interval(it.low, it.high)));
        let mean = interval(it.mean_interval.map(|it| it[0]), it.mean_interval.map(|it| it[1]));
        stderr_line!(
            "  {} [{}], {} along {}: mean {}{mean}, {}",
            it.figure,
            it.unit.as_deref().unwrap_or("?"),
            it.plant,
            it.record,
            number(it.mean),
            quantiles.collect::<Vec<_>>().join(", ")
        );
    }
    if collected.is_some_and(|found| found.iter().any(|it| it.mean_interval.is_some())) {
        stderr_line!("  in brackets: intervals of {} % confidence", CONFIDENCE * 100.0);
    }
}
