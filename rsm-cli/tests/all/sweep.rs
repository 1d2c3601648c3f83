//! `rsm sweep`: after kills, with shards, merges and a Dask cluster the bits are those of one undisturbed run, and no task runs twice.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::calls::{folder, json, keys, rsm, text};
use crate::shell::of_the_project;
use crate::skipped::skipped;

/// The time after which an operation on a busy machine is considered to hang.
const PATIENCE: Duration = Duration::from_secs(120);

/// A folder with a motor whose parameters are random within their tolerances, `runs` times.
fn motor(runs: usize) -> tempfile::TempDir {
    let here = folder();
    for name in ["pmac.toml", "pmac.csv"] {
        std::fs::copy(of_the_project("rsm-sim/plants").join(name), here.path().join(name)).unwrap();
    }
    let scenario = format!(
        "format = 1\nsweep = \"motor\"\nplants = [\"pmac.toml\"]\nrecords = [\"pmac.csv\"]\nruns = {runs}\nnoise = true\n\
         outputs.speed = [\"final\", \"max\"]\noutputs.i_q = [\"rms\"]\n\
         [[vary]]\nparameter = \"phase_resistance\"\ndistribution = \"tolerance\"\n\
         [[vary]]\nparameter = \"phase_inductance\"\ndistribution = \"tolerance\"\n"
    );
    std::fs::write(here.path().join("sweep.toml"), scenario).unwrap();
    here
}

fn ok(arguments: &[&str], here: &Path) -> String {
    let output = rsm(arguments, here);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stderr)
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The number of starts of each task in a folder.
fn starts(out: &Path) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    read(&out.join("starts.log")).lines().for_each(|hash| *counts.entry(hash.to_string()).or_insert(0) += 1);
    counts
}

/// The tasks that have a result file.
fn results(out: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(out.join("tasks")).into_iter().flatten().flatten();
    entries.filter_map(|it| it.file_name().into_string().ok()?.strip_suffix(".json").map(String::from)).collect()
}

/// Waits for a condition.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "{what} did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// How often a run is started again when it has ended before its kill. A busy machine may not schedule the test for as long as the rest of the run
/// takes; ten times in a row are not chance.
const KILLS: usize = 10;

/// Runs and kills a process until the kill came before the end of the run.
fn until_killed_in_time(mut is_in_time: impl FnMut() -> bool) {
    assert!((0..KILLS).any(|_| is_in_time()), "{KILLS} runs ended before they were killed");
}

/// A process that ends with its test.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        // Sends SIGKILL.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn threads_shards_and_kills_leave_the_bits_alone_and_no_task_is_repeated() {
    let runs = 1500;
    let here = motor(runs);
    let here = here.path();
    let printed = ok(&["sweep", "sweep.toml", "--out", "one", "--threads", "1"], here);
    assert!(
        printed.contains("1500 tasks, 0 with a result from before, 1500 run") && printed.contains("speed_final [rad/s]"),
        "{printed}"
    );
    let expected = ["table.csv", "summary.json"].map(|name| read(&here.join("one").join(name)));
    let is_equal = |folder: &str| ["table.csv", "summary.json"].map(|name| read(&here.join(folder).join(name))) == expected;
    ok(&["sweep", "sweep.toml", "--out", "two", "--threads", "2"], here);
    assert!(is_equal("two"));

    // Three shards in separate folders, merged.
    for k in 1..=3 {
        let (out, part) = (format!("part-{k}"), format!("{k}/3"));
        let printed = ok(&["sweep", "sweep.toml", "--out", &out, "--shard", &part], here);
        assert!(printed.contains("500 tasks") && !here.join(out).join("table.csv").exists(), "{printed}");
    }
    let output = rsm(&["sweep", "sweep.toml", "--out", "merged", "--merge", "part-1", "part-3"], here);
    assert_eq!(output.status.code(), Some(1), "a third is missing");
    assert!(text(&output.stderr).contains("500 missing") && !here.join("merged/table.csv").exists());
    ok(&["sweep", "sweep.toml", "--out", "merged", "--merge", "part-1", "part-2", "part-3"], here);
    assert!(is_equal("merged") && read(&here.join("merged/starts.log")).is_empty());

    // Killed twice during the run.
    let out = here.join("killed");
    until_killed_in_time(|| {
        let _ = std::fs::remove_dir_all(&out);
        for share in [5, 2] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
            command.args(["sweep", "sweep.toml", "--out", "killed", "--threads", "2"]).current_dir(here).stderr(Stdio::null());
            let running = Guarded(command.spawn().unwrap());
            until("a part of the results", || results(&out).len() > runs / share);
            drop(running);
        }
        results(&out).len() < runs
    });
    let before = results(&out);
    let output = rsm(&["sweep", "sweep.toml", "--out", "killed", "--json"], here);
    let printed = json(&output);
    assert_eq!(
        (printed["there"].as_u64(), printed["run"].as_u64()),
        (Some(before.len() as u64), Some((runs - before.len()) as u64))
    );
    assert!(is_equal("killed"));
    // Tasks with a result at a kill were started once; tasks in progress, two threads at two kills, were started once more.
    let starts = starts(&out);
    assert_eq!(starts.len(), runs);
    let again: usize = starts.values().map(|count| count - 1).sum();
    assert!(again <= 4, "{again} tasks were started again");
    // At the fourth start nothing runs.
    let printed = ok(&["sweep", "sweep.toml", "--out", "killed"], here);
    assert!(printed.contains("1500 with a result from before, 0 run"), "{printed}");
}

#[test]
fn a_changed_input_makes_new_tasks_and_old_results_are_in_no_table() {
    let here = motor(20);
    let here = here.path();
    ok(&["sweep", "sweep.toml", "--out", "out"], here);
    let before = read(&here.join("out/table.csv"));
    let record = read(&here.join("pmac.csv")).replace("0.0,0,5,0.5,0,2,10", "0.0,0,5,0.5,0,2,11");
    std::fs::write(here.join("pmac.csv"), record).unwrap();
    let printed = ok(&["sweep", "sweep.toml", "--out", "out"], here);
    assert!(
        printed.contains("0 with a result from before, 20 run") && printed.contains("20 results of other lists"),
        "{printed}"
    );
    let after = read(&here.join("out/table.csv"));
    assert_eq!(after.lines().count(), 21);
    let hashes = |table: &str| table.lines().skip(1).map(|it| it.rsplit_once(',').unwrap().1.to_string()).collect::<Vec<_>>();
    assert!(hashes(&after).iter().all(|it| !hashes(&before).contains(it)));
    // An incomplete result is ignored: it is computed again, and is the same.
    let broken = here.join("out/tasks").join(format!("{}.json", hashes(&after)[3]));
    let whole = read(&broken);
    std::fs::write(&broken, &whole[..whole.len() / 2]).unwrap();
    let printed = ok(&["sweep", "sweep.toml", "--out", "out"], here);
    assert!(printed.contains("19 with a result from before, 1 run"), "{printed}");
    assert_eq!(read(&broken), whole);
    // One task alone prints the same bytes.
    let output = rsm(&["sweep", "sweep.toml", "--task", &hashes(&after)[3]], here);
    assert_eq!((text(&output.stdout), output.status.code()), (whole, Some(0)));
}

#[test]
fn the_json_has_the_summary_with_its_intervals() {
    let here = motor(100);
    let output = rsm(&["sweep", "sweep.toml", "--out", "out", "--json"], here.path());
    let result = json(&output);
    let expected = [
        "confidence",
        "failed",
        "missing",
        "others",
        "out",
        "parquet",
        "program",
        "run",
        "seconds",
        "shard",
        "summary",
        "sweep",
        "table",
        "tasks",
        "there",
    ];
    assert_eq!(keys(&result), expected);
    let first = &result["summary"][0];
    assert_eq!((first["figure"].as_str(), first["count"].as_u64()), (Some("speed_final"), Some(100)));
    let median = &first["quantiles"][3];
    let [low, value, high] = ["low", "value", "high"].map(|key| median[key].as_f64().unwrap());
    assert!(median["share"] == 0.5 && low < value && value < high, "{median}");
    // With 100 runs, the 99th percentile has no upper bound: 0.99^100 = 0.37.
    assert!(first["quantiles"][6]["high"].is_null());
}

#[test]
fn bad_words_and_bad_files_have_status_2() {
    let here = motor(3);
    let here = here.path();
    let refused = |words: &[&str]| {
        let output = rsm(&[&["sweep"], words].concat(), here);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {}", text(&output.stderr));
        assert!(output.stdout.is_empty());
        text(&output.stderr)
    };
    assert!(refused(&["sweep.toml"]).contains("--out"));
    for part in ["0/3", "4/3", "3", "a/b"] {
        assert!(refused(&["sweep.toml", "--out", "o", "--shard", part]).contains("expected K/N"));
    }
    assert!(refused(&["sweep.toml", "--task", "0123"]).contains("found no task with the hash `0123` in a list of 3"));
    assert!(refused(&["sweep.toml", "--out", "o", "--merge", "nowhere"]).contains("not the output folder of a sweep"));
    assert!(refused(&["sweep.toml", "--out", "o", "--threads", "0"]).contains("--threads"));
    assert!(refused(&["sweep.toml", "--out", "o", "--engine", "dask"]).contains("--scheduler"));
    if cfg!(feature = "parquet") {
        ok(&["sweep", "sweep.toml", "--out", "p", "--parquet"], here);
        let bytes = std::fs::read(here.join("p/table.parquet")).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
        // This file was written by the command, and may be replaced; a file of another origin may not.
        ok(&["sweep", "sweep.toml", "--out", "p", "--parquet"], here);
        std::fs::write(here.join("p/table.parquet"), b"PAR1 of somebody PAR1").unwrap();
        assert!(refused(&["sweep.toml", "--out", "p", "--parquet"]).contains("no such output of rsm"));
    } else {
        assert!(refused(&["sweep.toml", "--out", "o", "--parquet"]).contains("--features parquet"));
    }
    std::fs::write(here.join("bad.toml"), read(&here.join("sweep.toml")).replace("\"rms\"", "\"mode\"")).unwrap();
    assert!(refused(&["bad.toml", "--out", "o"]).contains("bad.toml:8:16: `outputs`: `i_q`: found \"mode\""));
    assert!(!here.join("o").exists(), "nothing is written");
}

#[test]
fn a_run_that_stops_is_counted_and_the_status_is_1() {
    let here = motor(2);
    let here = here.path();
    let scenario = "format = 1\nsweep = \"s\"\nplants = [\"pmac.toml\"]\nrecords = [\"pmac.csv\"]\ndesign = \"full-factorial\"\n\
                    outputs.speed = [\"final\"]\n[[vary]]\nparameter = \"inertia\"\ndistribution = \"list\"\nvalues = [1e-30, 0.01]\n";
    std::fs::write(here.join("sweep.toml"), scenario).unwrap();
    let output = rsm(&["sweep", "sweep.toml", "--out", "out"], here);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("1 failed, 0 missing") && message.contains("the first that failed"), "{message}");
    let table = read(&here.join("out/table.csv"));
    assert!(table.contains("out of proportion") && table.lines().count() == 3, "{table}");
}

#[test]
fn many_diagnoses_are_tasks_and_their_json_is_that_of_diagnose() {
    let here = folder();
    let here = here.path();
    for (from, to) in [("servo-axis.toml", "plant.toml"), ("servo-axis.csv", "motion.csv")] {
        std::fs::copy(of_the_project("rsm-sim/plants").join(from), here.join(to)).unwrap();
    }
    let friction = "\n[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 12.0 }\n";
    std::fs::write(here.join("machine.toml"), read(&here.join("plant.toml")) + friction).unwrap();
    for (plant, out) in [("plant.toml", "good.csv"), ("machine.toml", "rubs.csv")] {
        ok(&["simulate", plant, "--record", "motion.csv", "--out", out], here);
    }
    let entry = |name: &str| format!("[[diagnose]]\nname = \"{name}\"\nplant = \"plant.toml\"\nrecords = [\"{name}.csv\"]\n");
    std::fs::write(here.join("fleet.toml"), format!("format = 1\nsweep = \"fleet\"\n{}{}", entry("good"), entry("rubs")))
        .unwrap();
    ok(&["sweep", "fleet.toml", "--out", "fleet"], here);
    let table = read(&here.join("fleet/table.csv"));
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines[0], "run[1],name,plant,verdict,causes,gain[1],failed,task");
    assert!(lines[1].starts_with("1,good,plant.toml,no-discrepancy,,"), "{table}");
    assert!(lines[2].contains("rubs,plant.toml,") && lines[2].contains("coulomb-friction"), "{table}");
    let hash = lines[2].rsplit_once(',').unwrap().1;
    let task: serde_json::Value = serde_json::from_str(&read(&here.join(format!("fleet/tasks/{hash}.json")))).unwrap();
    let alone = rsm(&["diagnose", "plant.toml", "--record", "rubs.csv", "--json"], here);
    assert_eq!(task["diagnosis"], json(&alone));
}

/// Python with Dask, from the place where `cargo xtask test` puts it; otherwise the test is skipped with a message.
pub fn dask(test: &str) -> Option<String> {
    let fetched = of_the_project("target/xtask/dask");
    let paths = [fetched, of_the_project("rsm-sweep/python")].map(|it| it.canonicalize().unwrap_or(it));
    let path = std::env::join_paths(paths).unwrap().into_string().unwrap();
    let python_output = Command::new("python3").args(["-c", "import distributed"]).env("PYTHONPATH", &path).output();
    if python_output.is_ok_and(|it| it.status.success()) {
        return Some(path);
    }
    skipped(&format!("no Dask (pip install --target target/xtask/dask distributed==2026.8.0): {test}"));
    None
}

/// A scheduler with its workers, on the loopback interface.
pub struct Cluster {
    pub address: String,
    workers: Vec<Guarded>,
    _scheduler: Guarded,
}

pub fn cluster(path: &str, here: &Path, workers: usize) -> Cluster {
    let start = |module: &str, words: &[&str]| {
        let mut command = Command::new("python3");
        command.args(["-m", module]).args(words).env("PYTHONPATH", path).current_dir(here);
        Guarded(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    };
    let file: PathBuf = here.join("scheduler.json");
    // Of an earlier cluster.
    let _ = std::fs::remove_file(&file);
    let scheduler = start(
        "distributed.cli.dask_scheduler",
        &["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", "scheduler.json"],
    );
    let address = || {
        Some(serde_json::from_slice::<serde_json::Value>(&std::fs::read(&file).ok()?).ok()?["address"].as_str()?.to_string())
    };
    until("the scheduler", || address().is_some());
    let address = address().unwrap();
    // Without a nanny process: a killed worker is not restarted.
    let words = [address.as_str(), "--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", "."];
    let workers = (0..workers).map(|_| start("distributed.cli.dask_worker", &words)).collect();
    Cluster { address: address.trim_start_matches("tcp://").to_string(), workers, _scheduler: scheduler }
}

#[test]
fn a_dask_cluster_gives_the_same_bits_and_survives_a_worker() {
    let Some(path) = dask("sweeps on a cluster") else { return };
    let runs = 60;
    let here = motor(runs);
    let here = here.path();
    ok(&["sweep", "sweep.toml", "--out", "one"], here);
    let program = env!("CARGO_BIN_EXE_rsm");
    let out = here.join("two");
    until_killed_in_time(|| {
        let _ = std::fs::remove_dir_all(&out);
        let mut cluster = cluster(&path, here, 2);
        let mut command = Command::new(program);
        command.args(["sweep", "sweep.toml", "--out", "two", "--engine", "dask", "--worker", program]);
        command.args(["--scheduler", &cluster.address]);
        command.env("PYTHONPATH", &path).current_dir(here).stdout(Stdio::null()).stderr(Stdio::piped());
        let running = command.spawn().unwrap();
        until("a sixth of the results", || results(&out).len() > runs / 6);
        drop(cluster.workers.remove(0));
        let at_kill = results(&out).len();
        let output = running.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        at_kill < runs
    });
    assert_eq!(results(&out).len(), runs);
    for name in ["table.csv", "summary.json"] {
        assert_eq!(read(&out.join(name)), read(&here.join("one").join(name)), "{name}");
    }
    // The results themselves are also compared, byte by byte.
    for hash in results(&out) {
        let file = format!("tasks/{hash}.json");
        assert_eq!(read(&out.join(&file)), read(&here.join("one").join(&file)));
    }
}

#[test]
fn a_missing_cluster_is_reported() {
    let Some(path) = dask("a scheduler that is not there") else { return };
    let here = motor(3);
    let mut command = Command::new(env!("CARGO_BIN_EXE_rsm"));
    command.args(["sweep", "sweep.toml", "--out", "out", "--engine", "dask", "--scheduler", "127.0.0.1:1"]);
    let output = command.env("PYTHONPATH", &path).current_dir(here.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let message = text(&output.stderr);
    assert!(message.contains("no scheduler at 127.0.0.1:1") && message.contains("3 of 3 tasks have no result"), "{message}");
}
