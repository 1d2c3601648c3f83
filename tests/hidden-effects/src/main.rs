//! `hidden-effects`: generates records with hidden effects and evaluates a diagnosis of them.
//!
//! In: arguments, the command `rsm`, an output folder. Out: tables on standard output, progress on standard error; status 0 if every threshold was
//! reached, 1 if not, 2 for unknown arguments. It writes only into that folder.

mod configuration_table;
mod report;
mod side_by_side;
mod surface_table;
mod system_table;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use hidden_effects::case::{Case, Choice, Family, cases};
use hidden_effects::coverage::{self, Coverage};
use hidden_effects::folder::{self, Folder};
use hidden_effects::{files, judge, verification};
use report::{Line, Report};

const USAGE: &str = "\
usage: hidden-effects judge  --rsm PROGRAM --out DIR [--seed N] [--seeds COUNT] [--family singles|nulls|pairs|outside|faults|records|symmetries|far|beyond|missing|noise|data|configurations] [--case NAME] [--quick]
                              [--rows N] [--colour CORRELATION] [--stated FACTOR] [--noise FACTOR]
                              [--lost N] [--growing SHARE] [--tails FREEDOM] [--outliers SHARE] [--without OUTPUT,...] [--late ROWS] [--plants new]
           makes cases, runs `rsm diagnose` on each, compares with the truth
           --case: a case, or all whose names begin so (`servo-axis-*`); --rows: shorter records; --colour: the noise of all outputs, from row to row; --stated: the plant file states the noise times this, 0: not at all; --noise: the records have the noise of the case times this, 0: none
           --lost: one row in N is lost, in gaps of 1 to 3; --growing: noise grows by so many times itself up to the largest reading; --tails: it is Student's t;
           --outliers: such a share of the readings has 20 times the noise;
           families noise, data (records as benches make them) and configurations are made only where --family or --case asks for them, but for --plants new
           --plants new: the plants of examples/plants, families singles, pairs, nulls, outside, missing, noise, data, in place of those that are built in; `make` and `verify` too
           --without: no record holds these outputs; --late: so many rows of each beginning are missing, so that records begin in motion
       hidden-effects make   --out DIR [the same]      makes the cases only
       hidden-effects verify --rsm PROGRAM --out DIR [--seed N] [--quick]
           compares `rsm simulate` with the plants of this package, an effect a line
       hidden-effects examples --out DIR      writes the records of the examples: DIR is examples/plants
       hidden-effects coverage --rsm PROGRAM --out DIR [--seed N] [--seeds COUNT] [the same]
           how often intervals of 95 % hold the truth: parameters are off as their tolerances say; of every seed the nulls, the symmetries and a tenth of the singles
       hidden-effects surfaces --rsm PROGRAM --out DIR [--seed N] [--seeds COUNT] [--family singles|nulls|pairs|triples|outside|swept|stuck|clipped|quantised|duplicated|scaled|direction] [--case NAME] [--quick]
           surfaces against new data with something hidden in them, as many seeds from the first on";

/// The arguments.
struct Words {
    rsm: PathBuf,
    out: PathBuf,
    seed: u64,
    seeds: u64,
    choice: Choice,
    /// Use the plants of examples/plants instead of the built-in ones.
    new_plants: bool,
}

fn words(mut words: impl Iterator<Item = String>, needs_rsm: bool) -> Result<Words, String> {
    let (mut rsm, mut out, mut seed, mut seeds, mut choice) = (None, None, 1, 1, Choice::default());
    let mut new_plants = false;
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} wants a value"));
        match word.as_str() {
            "--rsm" => rsm = Some(PathBuf::from(value()?)),
            "--out" => out = Some(PathBuf::from(value()?)),
            "--seed" => seed = value()?.parse().map_err(|error| format!("--seed: {error}"))?,
            "--seeds" => seeds = value()?.parse().map_err(|error| format!("--seeds: {error}"))?,
            "--family" => {
                let name = value()?;
                let known = Family::ALL.into_iter().find(|family| family.name() == name);
                choice.family = Some(
                    known.ok_or_else(|| format!("no family {name}; there are {}", Family::ALL.map(Family::name).join(", ")))?,
                );
            }
            "--case" => choice.name = Some(value()?),
            "--quick" => choice.quick = true,
            "--plants" => match value()?.as_str() {
                "new" => new_plants = true,
                other => return Err(format!("--plants: found {other}, expected new")),
            },
            "--rows" => choice.rows = Some(value()?.parse().map_err(|error| format!("--rows: {error}"))?),
            "--colour" => choice.colour = Some(value()?.parse().map_err(|error| format!("--colour: {error}"))?),
            "--lost" => choice.untidy.lost = Some(value()?.parse().map_err(|error| format!("--lost: {error}"))?),
            "--growing" => choice.untidy.growing = Some(value()?.parse().map_err(|error| format!("--growing: {error}"))?),
            "--tails" => choice.untidy.tails = Some(value()?.parse().map_err(|error| format!("--tails: {error}"))?),
            "--outliers" => choice.untidy.outliers = Some(value()?.parse().map_err(|error| format!("--outliers: {error}"))?),
            "--noise" => choice.untidy.noise = Some(value()?.parse().map_err(|error| format!("--noise: {error}"))?),
            "--late" => choice.untidy.late = value()?.parse().map_err(|error| format!("--late: {error}"))?,
            "--without" => choice.untidy.without = value()?.split(',').map(str::to_string).collect(),
            "--stated" => choice.stated = Some(value()?.parse().map_err(|error| format!("--stated: {error}"))?),
            _ => return Err(format!("unknown word {word}\n{USAGE}")),
        }
    }
    if needs_rsm && rsm.is_none() {
        return Err(format!("--rsm is missing\n{USAGE}"));
    }
    Ok(Words { rsm: rsm.unwrap_or_default(), out: out.ok_or("--out is missing")?, seed, seeds, choice, new_plants })
}

impl Words {
    /// The number of cases at the same time. Of a whole family the times are figures, so each case has the machine for itself; a diagnosis uses both
    /// cores for three quarters of its time.
    fn at_once(&self) -> usize {
        if self.choice.quick { 2 } else { 1 }
    }
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let result = match arguments.next().as_deref() {
        Some("judge") => words(arguments, true)
            .and_then(|words| if words.new_plants { system_table::judge_all(&words) } else { judge_all(&words) }),
        Some("make") => {
            words(arguments, false).and_then(|words| if words.new_plants { system_table::make(&words) } else { make(&words) })
        }
        Some("examples") => words(arguments, false).and_then(|words| system_table::examples(&words)),
        Some("coverage") => words(arguments, true).and_then(|words| coverage(&words)),
        Some("verify") => words(arguments, true)
            .and_then(|words| if words.new_plants { system_table::verify(&words) } else { verify(&words) }),
        Some("surfaces") => surface_table::run(arguments),
        _ => Err(USAGE.to_string()),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::from(2)
        }
    }
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

/// The requested cases.
fn asked(words: &Words) -> impl Iterator<Item = Case> {
    cases(words.seed, words.choice.clone())
}

fn make(words: &Words) -> Result<bool, String> {
    let mut made = 0;
    for case in asked(words) {
        folder::write_case(&case, &words.out, words.seed)?;
        println!("{:<48} signal to noise {:.2}", case.name, case.signal_to_noise);
        made += 1;
    }
    if made == 0 { Err("no such case".to_string()) } else { Ok(true) }
}

/// The outputs of `rsm simulate`, or its message.
fn simulate(
    rsm: &Path,
    kind: hidden_effects::plant::Kind,
    plant: &Path,
    record: &Path,
    to: &Path,
) -> Result<Vec<Vec<f64>>, String> {
    let mut simulate = Command::new(rsm);
    simulate.arg("simulate").arg(plant).arg("--record").arg(record).arg("--out").arg(to);
    let run = simulate.output().map_err(|error| format!("{}: {error}", rsm.display()))?;
    if !run.status.success() {
        return Err(String::from_utf8_lossy(&run.stderr).trim().to_string());
    }
    let text = std::fs::read_to_string(to).map_err(|error| format!("{}: {error}", to.display()))?;
    files::outputs(kind, &text)
}

/// The mean square error of a plant file for the exact validation records.
fn missed(rsm: &Path, case: &Case, folder: &Folder, plant: &Path) -> Result<f64, String> {
    let to = folder.extended.with_file_name("simulated.csv");
    let runs = folder.exact.iter().map(|record| simulate(rsm, case.truth.kind, plant, record, &to));
    Ok(folder::missed(case, &runs.collect::<Result<Vec<_>, _>>()?))
}

/// The gain of the found extension divided by the gain of the true one. A gain is the share of the nominal file's squared error that is removed, in
/// simulations from the true start, compared with the records without noise.
fn gain_share(rsm: &Path, case: &Case, folder: &Folder, extension: &Path) -> Result<f64, String> {
    let nominal = missed(rsm, case, folder, &folder.nominal)?;
    let best = 1.0 - missed(rsm, case, folder, &folder.extended)? / nominal;
    let found = 1.0 - missed(rsm, case, folder, extension)? / nominal;
    Ok(found / best)
}

/// Calls `rsm diagnose` for a case, with JSON output.
fn command(words: &Words, folder: &Folder, out: &Path) -> Command {
    let mut diagnose = Command::new(&words.rsm);
    diagnose.arg("diagnose").arg(&folder.nominal).arg("--json").arg("--out").arg(out);
    folder.train.iter().for_each(|record| {
        diagnose.arg("--record").arg(record);
    });
    folder.validate.iter().for_each(|record| {
        diagnose.arg("--validate").arg(record);
    });
    diagnose
}

fn diagnose(words: &Words, case: &Case, folder: &Folder) -> Result<Line, String> {
    let out = folder.nominal.with_file_name("diagnosis");
    let mut diagnose = command(words, folder, &out);
    let started = Instant::now();
    let run = diagnose.output().map_err(|error| format!("{}: {error}", words.rsm.display()))?;
    let seconds = started.elapsed().as_secs_f64();
    let (output, said) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    let mut line = Line::new(case, seconds);
    match serde_json::from_str(&output) {
        Ok(answer) => {
            line.judgement = judge::judge(case, &answer, &format!("{output}{said}"));
            let extended = std::fs::read_to_string(out.join("extended.toml")).unwrap_or_default();
            let unnamed = judge::unnamed(&extended, &answer);
            if !extended.contains("[parameters]") || !unnamed.is_empty() {
                line.judgement.right = false;
                line.judgement.answer =
                    format!("{} (extended.toml holds {} besides)", line.judgement.answer, unnamed.join(", "));
            }
            if !case.causes.is_empty() {
                line.gain_share =
                    Some(gain_share(&words.rsm, case, folder, &out.join("extended.toml")).unwrap_or_else(|message| {
                        line.judgement.answer = format!("{} (no gain: {})", line.judgement.answer, first_line(&message));
                        0.0
                    }));
            }
        }
        // Without an answer the case is wrong; the table shows the reason.
        Err(error) => {
            let said = if said.trim().is_empty() { error.to_string() } else { first_line(&said) };
            line.judgement.answer = format!("{}: {said}", run.status);
        }
    }
    Ok(line)
}

fn first_line(text: &str) -> String {
    text.trim().lines().next().unwrap_or_default().to_string()
}

fn judge_all(words: &Words) -> Result<bool, String> {
    let mut report = Report::default();
    for seed in words.seed..words.seed + words.seeds {
        report.lines.extend(side_by_side::each(words.at_once(), cases(seed, words.choice.clone()), |case| {
            let folder = folder::write_case(&case, &words.out, seed)?;
            let line = diagnose(words, &case, &folder)?;
            println!("{line}");
            Ok(line)
        })?);
        configuration_table::judge(words, seed, &mut report)?;
    }
    if report.lines.is_empty() {
        return Err("no such case".to_string());
    }
    println!("\n{report}");
    Ok(report.held())
}

/// Compares intervals with the true values.
fn coverage(words: &Words) -> Result<bool, String> {
    let mut all = Coverage::default();
    for seed in words.seed..words.seed + words.seeds {
        for case in cases(seed, Choice { normal: true, ..words.choice.clone() }.for_coverage(seed)) {
            let folder = folder::write_case(&case, &words.out, seed)?;
            let run = command(words, &folder, &folder.nominal.with_file_name("diagnosis"))
                .output()
                .map_err(|error| format!("{}: {error}", words.rsm.display()))?;
            let answer = serde_json::from_slice(&run.stdout).unwrap_or_default();
            match coverage::numbers(&case, &answer) {
                Some(numbers) => {
                    let told: Vec<String> = numbers.iter().map(|it| format!("{} {:.2}", it.name, it.off)).collect();
                    println!("{seed} {}: {}", case.name, told.join(", "));
                    all.numbers.extend(numbers);
                }
                None => {
                    all.without += 1;
                    println!("{seed} {}: not counted", case.name);
                }
            }
        }
    }
    if all.numbers.is_empty() {
        return Err("no number to count".to_string());
    }
    println!("\n{all}");
    Ok(all.held())
}

/// Compares every single effect with `rsm simulate`.
fn verify(words: &Words) -> Result<bool, String> {
    let folder = words.out.join("verify");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let (plant, record, simulated) = (folder.join("plant.toml"), folder.join("record.csv"), folder.join("simulated.csv"));
    println!("largest difference of two simulations, and what the effect moves, in units of the sensor's noise\n");
    println!("{:<58} {:>10} {:>8} {:>10}  where", "plant, effect", "difference", "allowed", "effect");
    let mut held = true;
    for check in verification::checks(words.seed, words.choice.quick) {
        write(&plant, &check.plant_file)?;
        write(&record, &check.csv())?;
        let outputs = match simulate(&words.rsm, check.kind, &plant, &record, &simulated) {
            Ok(outputs) => outputs,
            Err(message) => {
                held = false;
                println!("{:<58} {message}", check.name);
                continue;
            }
        };
        let (distance, output, row) = check.distance(&outputs);
        let (name, allowed, visible) = (&check.name, check.allowed(), check.visible);
        held &= distance <= allowed;
        let mark = if distance <= allowed { "" } else { "  TOO FAR" };
        println!("{name:<58} {distance:>10.4} {allowed:>8.1} {visible:>10.1}  {output}, row {row}{mark}");
    }
    Ok(held)
}
