//! `cargo xtask mutants`: finds changes of meaning that the tests of a package do not detect.
//!
//! In: a package and files of it. Out: a table of mutants by file, and the surviving mutants by line; exit status 1 if one survived without an
//! argument. All mutants of a run are compiled at once, each with a switch, so a mutant costs only the run of the tests that reach it, and no
//! compilation. cargo-mutants compiles each mutant separately, which takes about 20 s per mutant in rsm-core, and days for all files.

mod argued;
mod instrument;
mod judge;
mod tree;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use instrument::Mutant;
use judge::Fate;

const USAGE: &str = "\
usage: mutants --root WORKSPACE --scratch FOLDER [--build FOLDER] [--package NAME] [--file PART] [--function NAME] [--line N] [--change TEXT] [--sample N] [--seed N] [--unit] [--near] [--within SECONDS] [--optimised] [--list]
  --build FOLDER    cargo compiles here: a target folder that has the crates from outside already; without it one for each package in --scratch
  --package NAME    rsm-core, rsm-fit, rsm-sim or rsm-diagnose; without it all four, each with the files that are listed below
  --file PART       only files whose name contains PART (several may be given)
  --function NAME   only mutants inside this function
  --line N          only mutants of this line
  --change TEXT     only this change, as it is printed
  --sample N        N mutants of each package only, spread evenly over all
  --seed N          the sample is drawn from this seed
  --unit            only the unit tests of the library: nothing else is compiled or run, and what they leave is known in minutes
  --near            only the unit tests of the changed files' own modules; what they leave is listed
  --within SECONDS  only tests that take no longer without a mutant; survivors of these may still be noticed by the others
  --optimised       unit tests are compiled as usual: minutes more to compile, and loops of numbers take a tenth of the time
  --list            names the mutants, runs no test
A mutant that means the same is argued in a comment on its line or right above: // mutant `< to <=`: why no test can notice it";

/// The files whose behaviour is guaranteed: the package's own tests must detect each change in them.
const FILES: &[(&str, &[&str])] = &[
    (
        "rsm-core",
        &[
            "src/rounding",
            "src/range",
            "src/pieces",
            "src/interval",
            "src/bernstein",
            "src/certificate",
            "src/lower",
            "src/run",
            "src/emit",
        ],
    ),
    ("rsm-fit", &["src/statistics", "src/qr", "src/recursive", "src/canonical", "src/ladder", "src/constrain", "src/verdict"]),
    ("rsm-sim", &["src/effect", "src/effects"]),
    ("rsm-diagnose", &["src/plant/verdict"]),
];

/// Of a sample, tests that take longer run only if mutants remain: three tests of rsm-core take most of its time without optimisation.
const QUICK_TEST: Duration = Duration::from_secs(5);

#[derive(Default)]
struct Request {
    root: PathBuf,
    scratch: PathBuf,
    build: Option<PathBuf>,
    package: Option<String>,
    parts: Vec<String>,
    function: Option<String>,
    line: Option<usize>,
    change: Option<String>,
    sample: Option<usize>,
    seed: Option<u64>,
    unit: bool,
    near: bool,
    optimised: bool,
    within: Option<usize>,
    list: bool,
}

fn main() -> ExitCode {
    let request = match request(std::env::args().skip(1)) {
        Ok(request) => request,
        Err(why) => {
            eprintln!("{why}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    let mut held = true;
    for (package, files) in FILES {
        if request.package.as_deref().is_some_and(|wanted| wanted != *package) {
            continue;
        }
        match run(&request, package, files) {
            Ok(all_noticed) => held &= all_noticed,
            Err(why) => {
                eprintln!("{package}: {why}");
                return ExitCode::from(2);
            }
        }
    }
    if held { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn request(mut words: impl Iterator<Item = String>) -> Result<Request, String> {
    let mut request = Request::default();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--list" => {
                request.list = true;
                continue;
            }
            "--unit" => {
                request.unit = true;
                continue;
            }
            "--optimised" => {
                request.optimised = true;
                continue;
            }
            "--near" => {
                request.unit = true;
                request.near = true;
                continue;
            }
            _ => {}
        }
        let value = words.next().ok_or_else(|| format!("{word} wants a value"))?;
        let number = || value.parse::<usize>().map_err(|_| format!("{word} wants a number, found {value}"));
        match word.as_str() {
            "--root" => request.root = value.into(),
            "--scratch" => request.scratch = value.into(),
            "--build" => request.build = Some(value.into()),
            "--package" if FILES.iter().any(|(package, _)| *package == value) => request.package = Some(value),
            "--file" => request.parts.push(value),
            "--function" => request.function = Some(value),
            "--line" => request.line = Some(number()?),
            "--change" => request.change = Some(value),
            "--sample" => request.sample = Some(number()?),
            "--within" => request.within = Some(number()?),
            "--seed" => request.seed = Some(number()? as u64),
            _ => return Err(format!("{word} {value} is not known")),
        }
    }
    if request.root.as_os_str().is_empty() || request.scratch.as_os_str().is_empty() {
        return Err("--root and --scratch are wanted".to_owned());
    }
    Ok(request)
}

/// Whether every mutant of a package was detected or has an argument.
fn run(request: &Request, package: &str, listed: &[&str]) -> Result<bool, String> {
    let files = files(request, package, listed)?;
    if files.is_empty() {
        return Ok(true);
    }
    println!("{package}: {} files", files.len());
    let scratch = request.scratch.join(package);
    std::fs::create_dir_all(&scratch).map_err(|error| format!("{}: {error}", scratch.display()))?;
    let targets = tree::Targets { unit: request.unit, plain: request.unit && !request.optimised };
    let folder = request.build.clone().unwrap_or_else(|| scratch.join("build"));
    let built = tree::build(&request.root, &scratch, &folder, package, &files, targets)?;
    let texts = texts(&request.root, &files)?;
    let wanted = |mutant: &&Mutant| {
        request.function.as_ref().is_none_or(|name| *name == mutant.function)
            && request.line.is_none_or(|line| line == mutant.line)
            && request.change.as_ref().is_none_or(|change| *change == mutant.change)
    };
    let mut mutants: Vec<&Mutant> = built.mutants.iter().filter(wanted).collect();
    if let Some(count) = request.sample {
        mutants = sample(mutants.len(), count, request.seed).into_iter().map(|k| mutants[k]).collect();
    }
    println!("{package}: {} mutants, {} more do not compile", mutants.len(), built.refused);
    if request.list {
        mutants.iter().for_each(|mutant| println!("{}", told(mutant)));
        return Ok(true);
    }
    // For a sample, the quick tests of its own files run first, and the others only if mutants remain: every test once would take most of the time.
    let names = judge::names(&built.programs, &built.folder)?;
    let modules: Vec<String> = files.iter().map(|file| module(file, package)).collect();
    let all_at_once = request.sample.is_none() && !request.near;
    let (near, mut others): (Vec<_>, Vec<_>) =
        names.into_iter().partition(|(_, name)| all_at_once || modules.iter().any(|module| name.starts_with(module)));
    if request.near {
        others.clear();
    }
    let limit = request.sample.map(|_| QUICK_TEST);
    let (mut tests, slow) = judge::survey(&near, &built.folder, &scratch, limit)?;
    let all = tests.len() + slow.len();
    others.extend(slow);
    if let Some(seconds) = request.within {
        tests.retain(|test| test.time.as_secs_f64() <= seconds as f64);
    }
    println!("{package}: {all} tests, {} of them are run", tests.len());
    let by_number: BTreeMap<usize, &Mutant> = mutants.iter().map(|mutant| (mutant.number, *mutant)).collect();
    let numbers: Vec<usize> = by_number.keys().copied().collect();
    let is_argued = |number: usize| {
        let mutant = by_number[&number];
        argued::is_argued(&lines(&texts[&mutant.file]), mutant.line, &mutant.change)
    };
    let (begin, done) = (Instant::now(), AtomicUsize::new(0));
    let mut fates = judge::judge(&tests, &numbers, &built.folder, |number, fate| {
        let count = done.fetch_add(1, Ordering::Relaxed) + 1;
        if !matches!(fate, Fate::Killed(_)) && !is_argued(number) {
            println!("   {}: {}", if *fate == Fate::Survived { "SURVIVED" } else { "NOT REACHED" }, told(by_number[&number]));
        }
        if count.is_multiple_of(200) {
            println!("   {count} of {} in {} s", numbers.len(), begin.elapsed().as_secs());
        }
    });
    let is_left = |(number, fate): &(&usize, &Fate)| !matches!(fate, Fate::Killed(_)) && !is_argued(**number);
    let left: Vec<usize> = fates.iter().filter(is_left).map(|(number, _)| *number).collect();
    if !left.is_empty() && !others.is_empty() {
        println!("   {} of them against {} other tests", left.len(), others.len());
        let (further, _) = judge::survey(&others, &built.folder, &scratch, None)?;
        for (number, fate) in judge::judge(&further, &left, &built.folder, |_, _| {}) {
            if fate != Fate::NotReached {
                fates.insert(number, fate);
            }
        }
    }
    Ok(report(package, &by_number, &fates, &texts))
}

/// Selects `count` of `all`: evenly spread, or at random from a seed.
fn sample(all: usize, count: usize, seed: Option<u64>) -> Vec<usize> {
    let count = count.min(all);
    let Some(mut state) = seed else { return (0..count).map(|k| k * all / count).collect() };
    // SplitMix64 (Steele, Lea, Flood 2014): any seed is suitable, also 0.
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let mut left: Vec<usize> = (0..all).collect();
    let mut drawn: Vec<usize> = (0..count).map(|_| left.swap_remove((next() % left.len() as u64) as usize)).collect();
    drawn.sort_unstable();
    drawn
}

/// Prints the table by file. Returns whether nothing remains to be done.
fn report(
    package: &str,
    mutants: &BTreeMap<usize, &Mutant>,
    fates: &BTreeMap<usize, Fate>,
    texts: &BTreeMap<String, String>,
) -> bool {
    #[derive(Default)]
    struct Row {
        all: usize,
        killed: usize,
        argued: usize,
        left: usize,
    }
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    let mut refuted = Vec::new();
    for (number, fate) in fates {
        let mutant = mutants[number];
        let row = rows.entry(&mutant.file).or_default();
        row.all += 1;
        let argued = argued::is_argued(&lines(&texts[&mutant.file]), mutant.line, &mutant.change);
        match fate {
            // The comment does not distinguish two changes of the same kind in one line, so an argument is refuted only if all of them are detected.
            Fate::Killed(test) => {
                row.killed += 1;
                let alike = mutants
                    .values()
                    .filter(|other| other.file == mutant.file && other.line == mutant.line && other.change == mutant.change);
                let all_killed = alike.clone().all(|other| matches!(fates.get(&other.number), Some(Fate::Killed(_))));
                if argued && all_killed {
                    refuted.push(format!("{} is argued to mean the same, and {test} notices it", told(mutant)));
                }
            }
            _ if argued => row.argued += 1,
            _ => row.left += 1,
        }
    }
    println!("| {package} | mutants | killed | the same, argued | left |\n|---|---|---|---|---|");
    let mut total = Row::default();
    for (file, row) in &rows {
        println!("| {file} | {} | {} | {} | {} |", row.all, row.killed, row.argued, row.left);
        total.all += row.all;
        total.killed += row.killed;
        total.argued += row.argued;
        total.left += row.left;
    }
    println!("| all | {} | {} | {} | {} |", total.all, total.killed, total.argued, total.left);
    refuted.iter().for_each(|words| println!("   REFUTED: {words}"));
    total.left == 0 && refuted.is_empty()
}

/// The prefix of the names of a file's unit tests: `src/plant/verdict.rs` has those of `plant::verdict::`.
fn module(file: &str, package: &str) -> String {
    let inside = file.strip_prefix(package).and_then(|rest| rest.strip_prefix("/src/")).unwrap_or(file);
    let path = inside.trim_end_matches(".rs").trim_end_matches("/mod");
    format!("{}::", path.replace('/', "::"))
}

fn told(mutant: &Mutant) -> String {
    format!("{}:{}:{}: {} (in {})", mutant.file, mutant.line, mutant.column, mutant.change, mutant.function)
}

fn lines(text: &str) -> Vec<&str> {
    text.lines().collect()
}

fn texts(root: &Path, files: &[String]) -> Result<BTreeMap<String, String>, String> {
    let read = |name: &String| std::fs::read_to_string(root.join(name)).map_err(|error| format!("{name}: {error}"));
    files.iter().map(|name| Ok((name.clone(), read(name)?))).collect()
}

/// The listed files of a package that are requested. Files with only tests are not included.
fn files(request: &Request, package: &str, listed: &[&str]) -> Result<Vec<String>, String> {
    let mut found = Vec::new();
    let mut folders = vec![request.root.join(package).join("src")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?.flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(&request.root).map_err(|error| error.to_string())?.to_string_lossy().into_owned();
            let inside = name.strip_prefix(&format!("{package}/")).unwrap_or(&name);
            let is_listed = listed.iter().any(|part| inside == format!("{part}.rs") || inside.starts_with(&format!("{part}/")));
            let is_source = name.ends_with(".rs") && !name.ends_with("/tests.rs") && !name.contains("/tests/");
            if is_listed
                && is_source
                && (request.parts.is_empty() || request.parts.iter().any(|part| name.contains(part.as_str())))
            {
                found.push(name);
            }
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::{module, sample};

    #[test]
    fn the_tests_of_a_file_are_named_by_its_module() {
        assert_eq!(module("rsm-diagnose/src/plant/verdict.rs", "rsm-diagnose"), "plant::verdict::");
        assert_eq!(module("rsm-sim/src/equations/mod.rs", "rsm-sim"), "equations::");
    }

    #[test]
    fn a_sample_is_spread_or_drawn_each_once() {
        assert_eq!(sample(10, 5, None), [0, 2, 4, 6, 8]);
        assert_eq!(sample(3, 9, None), [0, 1, 2]);
        assert_eq!(sample(3, 9, Some(4)), [0, 1, 2]);
        let (one, other) = (sample(1000, 30, Some(1)), sample(1000, 30, Some(2)));
        assert!(one.len() == 30 && one.windows(2).all(|pair| pair[0] < pair[1]) && one[29] < 1000);
        assert_eq!(one, sample(1000, 30, Some(1)));
        assert_ne!(one, other);
        // Every index can be selected.
        let mut seen: Vec<usize> = (0..60).flat_map(|seed| sample(20, 3, Some(seed))).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 20);
    }
}
