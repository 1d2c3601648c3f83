//! Determines which mutants the tests detect.
//!
//! In: test programs and mutants. Out: for each mutant the test that fails, or that none does. Every test is run once without a mutant, to measure
//! its time and to record the switches that it reaches. Then each mutant is run against the tests that reach it, the fastest first, until one fails.
//! A test that takes much longer than without the mutant has also detected it: an endless loop is a change of meaning.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The time limit of a test: this multiple of its time without a mutant, and never less than the floor. A loaded machine is several times slower for
/// seconds.
const PATIENCE: u32 = 20;
const FLOOR: Duration = Duration::from_secs(20);

/// One test of one program.
pub(crate) struct Test {
    program: PathBuf,
    name: String,
    pub(crate) time: Duration,
    reaches: Vec<usize>,
}

/// The result for a mutant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Fate {
    /// The test that detected it.
    Killed(String),
    Survived,
    /// No test executes this code.
    NotReached,
}

/// The tests of the programs, by name.
pub(crate) fn names(programs: &[PathBuf], folder: &Path) -> Result<Names, String> {
    let mut names = Vec::new();
    for program in programs {
        let output = command(program, folder)
            .args(["--list", "--format", "terse"])
            .stdout(Stdio::piped())
            .output()
            .map_err(|error| format!("{}: {error}", program.display()))?;
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        names
            .extend(text.lines().filter_map(|line| line.strip_suffix(": test")).map(|name| (program.clone(), name.to_owned())));
    }
    Ok(names)
}

/// Tests by program and name.
pub(crate) type Names = Vec<(PathBuf, String)>;

/// Runs the tests, and returns their times and the switches that they reach. Tests that take longer than a limit are ended, and returned by name.
pub(crate) fn survey(
    names: &[(PathBuf, String)],
    folder: &Path,
    scratch: &Path,
    limit: Option<Duration>,
) -> Result<(Vec<Test>, Names), String> {
    let tests = Mutex::new(Vec::new());
    let failed = Mutex::new(Vec::new());
    let slow = Mutex::new(Vec::new());
    in_parallel(names.len(), |k| {
        let (program, name) = &names[k];
        let seen = scratch.join(format!("seen-{k}.txt"));
        let _ = std::fs::remove_file(&seen);
        let begin = Instant::now();
        let mut command = command(program, folder);
        command.args(["--exact", name, "--test-threads", "1"]).env("RSM_MUTANTS_SEEN", &seen);
        let status = status_within(&mut command, limit.unwrap_or(Duration::MAX));
        if status.is_none() {
            slow.lock().expect("no panic").push((program.clone(), name.clone()));
        } else if status.is_some_and(|status| status.success()) {
            let text = std::fs::read_to_string(&seen).unwrap_or_default();
            let reaches = text.lines().filter_map(|line| line.parse().ok()).collect();
            let test = Test { program: program.clone(), name: name.clone(), time: begin.elapsed(), reaches };
            tests.lock().expect("no panic").push(test);
        } else {
            failed.lock().expect("no panic").push(name.clone());
        }
        let _ = std::fs::remove_file(&seen);
    });
    let failed = failed.into_inner().expect("no panic");
    if !failed.is_empty() {
        return Err(format!("these tests fail without any mutant: {}", failed.join(", ")));
    }
    let mut tests = tests.into_inner().expect("no panic");
    tests.sort_by_key(|test| test.time);
    Ok((tests, slow.into_inner().expect("no panic")))
}

/// The result for each of the numbers; `progress` is called for each as soon as it is known.
pub(crate) fn judge(
    tests: &[Test],
    numbers: &[usize],
    folder: &Path,
    progress: impl Fn(usize, &Fate) + Sync,
) -> BTreeMap<usize, Fate> {
    let fates = Mutex::new(BTreeMap::new());
    in_parallel(numbers.len(), |k| {
        let number = numbers[k];
        let mut fate = Fate::NotReached;
        for test in tests.iter().filter(|test| test.reaches.contains(&number)) {
            if notices(test, number, folder) {
                fate = Fate::Killed(test.name.clone());
                break;
            }
            fate = Fate::Survived;
        }
        progress(number, &fate);
        fates.lock().expect("no panic").insert(number, fate);
    });
    fates.into_inner().expect("no panic")
}

fn notices(test: &Test, number: usize, folder: &Path) -> bool {
    let limit = (test.time * PATIENCE).max(FLOOR);
    let mut command = command(&test.program, folder);
    command.args(["--exact", &test.name, "--test-threads", "1"]).env("RSM_MUTANT", number.to_string());
    status_within(&mut command, limit).is_none_or(|status| !status.success())
}

/// The status of a program, or none if it has not ended within the limit and was stopped.
fn status_within(command: &mut Command, limit: Duration) -> Option<ExitStatus> {
    let mut child = command.spawn().expect("a program that was built");
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("a child to wait for") {
            return Some(status);
        }
        if begin.elapsed() > limit {
            let _ = child.kill();
            let _ = child.wait();
            return None;
        }
        std::thread::sleep(Duration::from_millis(if begin.elapsed() < Duration::from_millis(50) { 1 } else { 10 }));
    }
}

fn command(program: &Path, folder: &Path) -> Command {
    let mut command = Command::new(program);
    // The output is discarded: if nobody reads a pipe, a test with much output would block.
    command
        .current_dir(folder)
        .env("CARGO_MANIFEST_DIR", folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// Does the work for each index, with as many threads as there are cores, or as many as `RSM_MUTANTS_THREADS` gives.
fn in_parallel(count: usize, work: impl Fn(usize) + Sync) {
    let next = AtomicUsize::new(0);
    let wanted = std::env::var("RSM_MUTANTS_THREADS").ok().and_then(|text| text.parse().ok());
    let threads: usize = wanted.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= count {
                        return;
                    }
                    work(k);
                }
            });
        }
    });
}
