//! The command for the plants of `examples/plants/`: cases, answers, the comparison of two simulations, and the records of the examples.
//!
//! In: arguments, the command `rsm`. Out: tables. It writes only into the folder of `--out`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use hidden_effects::systems::cases::{Case, Choice, Run, cases};
use hidden_effects::systems::{ALL, Cause, examples, files, judge, verify};
use serde_json::{Value, json};

use crate::report::{Line, Report};
use crate::{Words, write};

fn asked(words: &Words, seed: u64) -> impl Iterator<Item = Case> {
    let it = &words.choice;
    let choice = Choice {
        family: it.family,
        name: it.name.clone(),
        quick: it.quick,
        rows: it.rows,
        colour: it.colour,
        stated: it.stated,
        untidy: it.untidy.clone(),
    };
    cases(seed, choice, |name| println!("{name}: no draw shows after calibration; not asked"))
}

/// Files of a case.
struct Folder {
    nominal: PathBuf,
    train: Vec<PathBuf>,
    validate: Vec<PathBuf>,
}

fn write_case(case: &Case, parent: &Path, seed: u64) -> Result<Folder, String> {
    let folder = parent.join(&case.name);
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    let for_judge = folder.join("judge");
    std::fs::create_dir_all(&for_judge).map_err(|error| format!("{}: {error}", for_judge.display()))?;
    let system = case.truth.system;
    for place in [&folder, &for_judge] {
        write(&place.join(format!("{}.mo", system.name)), system.text)?;
    }
    let nominal = folder.join("nominal.toml");
    write(&nominal, &files::plant_file(&case.file, &case.stated, None, &[]))?;
    write(&for_judge.join("extended.toml"), &files::plant_file(&case.truth, &case.noise, None, &case.truth.causes))?;
    let records = |name: &str, runs: &[Run]| -> Result<Vec<PathBuf>, String> {
        let each = runs.iter().enumerate().map(|(number, run)| {
            let path = folder.join(format!("{name}-{}.csv", number + 1));
            write(&path, &files::record(system, &run.noisy, None, &case.without, &run.left_out))?;
            write(
                &for_judge.join(format!("{name}-{}-exact.csv", number + 1)),
                &files::record(system, &run.exact.record, None, &[], &[]),
            )?;
            Ok(path)
        });
        each.collect()
    };
    let (train, validate) = (records("train", &case.train)?, records("validate", &case.validate)?);
    let described = |it: &Cause| {
        let numbers: serde_json::Map<String, Value> =
            it.numbers.iter().map(|(name, value)| (name.clone(), json!(value))).collect();
        json!({ "kind": it.kind, "at": it.at, "numbers": numbers })
    };
    let truth = json!({
        "case": case.name,
        "plant": system.name,
        "family": case.family.name(),
        "seed": seed,
        "causes": case.truth.causes.iter().map(described).collect::<Vec<_>>(),
        "outside_the_catalogue": case.truth.outside.iter().map(described).collect::<Vec<_>>(),
        "without": case.without,
        "spoiled": case.damage.as_ref().map(|it| format!("{:?} {:?}", it.what, it.outputs.iter().map(|place| system.outputs[*place].name).collect::<Vec<_>>())),
        "signal_to_noise": case.signal_to_noise,
        "remains_after_calibration": if case.remains.is_finite() { Some(case.remains) } else { None },
    });
    write(&folder.join("truth.json"), &format!("{truth:#}\n"))?;
    Ok(Folder { nominal, train, validate })
}

/// Writes the cases.
pub(crate) fn make(words: &Words) -> Result<bool, String> {
    let mut made = 0;
    for case in asked(words, words.seed) {
        write_case(&case, &words.out, words.seed)?;
        println!("{:<48} signal to noise {:>8.2}, {:>8.2} after calibration", case.name, case.signal_to_noise, case.remains);
        made += 1;
    }
    if made == 0 { Err("no such case".to_string()) } else { Ok(true) }
}

/// Runs `rsm diagnose` for every case.
pub(crate) fn judge_all(words: &Words) -> Result<bool, String> {
    let mut report = Report::default();
    for seed in words.seed..words.seed + words.seeds {
        for case in asked(words, seed) {
            let folder = write_case(&case, &words.out, seed)?;
            let out = folder.nominal.with_file_name("diagnosis");
            let mut diagnose = Command::new(&words.rsm);
            diagnose.arg("diagnose").arg(&folder.nominal).arg("--json").arg("--out").arg(&out);
            folder.train.iter().for_each(|record| {
                diagnose.arg("--record").arg(record);
            });
            folder.validate.iter().for_each(|record| {
                diagnose.arg("--validate").arg(record);
            });
            let started = Instant::now();
            let run = diagnose.output().map_err(|error| format!("{}: {error}", words.rsm.display()))?;
            let mut line = Line::of(case.family, &case.name, case.signal_to_noise, started.elapsed().as_secs_f64());
            let output = String::from_utf8_lossy(&run.stdout);
            match serde_json::from_str(&output) {
                Ok(answer) => line.judgement = judge::judge(&case, &answer),
                // Without an answer the case is wrong; the table shows the reason.
                Err(error) => {
                    let said = String::from_utf8_lossy(&run.stderr);
                    let said = said.trim().lines().next().map_or(error.to_string(), str::to_string);
                    line.judgement.answer = format!("{}: {said}", run.status);
                }
            }
            println!("{line}");
            report.lines.push(line);
        }
    }
    if report.lines.is_empty() {
        return Err("no such case".to_string());
    }
    println!("\n{report}");
    Ok(report.held())
}

/// Compares every single effect at every place with `rsm simulate`.
pub(crate) fn verify(words: &Words) -> Result<bool, String> {
    let folder = words.out.join("verify");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for system in ALL {
        write(&folder.join(format!("{}.mo", system.name)), system.text)?;
    }
    let (plant, record, simulated) = (folder.join("plant.toml"), folder.join("record.csv"), folder.join("simulated.csv"));
    println!("largest difference of two simulations, and what the effect moves, in units of the sensor's noise\n");
    println!("{:<58} {:>10} {:>8} {:>10}  where", "plant, effect", "difference", "allowed", "effect");
    let mut held = true;
    for check in verify::checks(words.seed, words.choice.quick) {
        write(&plant, &check.plant_file)?;
        write(&record, &check.csv())?;
        let mut simulate = Command::new(&words.rsm);
        simulate.arg("simulate").arg(&plant).arg("--record").arg(&record).arg("--out").arg(&simulated);
        let run = simulate.output().map_err(|error| format!("{}: {error}", words.rsm.display()))?;
        if !run.status.success() {
            held = false;
            println!("{:<58} {}", check.name, String::from_utf8_lossy(&run.stderr).trim());
            continue;
        }
        let text = std::fs::read_to_string(&simulated).map_err(|error| format!("{}: {error}", simulated.display()))?;
        let (distance, output, row) = check.distance(&files::outputs(check.system, &text)?);
        held &= distance <= verify::ALLOWED;
        let mark = if distance <= verify::ALLOWED { "" } else { "  TOO FAR" };
        let (name, allowed, visible) = (&check.name, verify::ALLOWED, check.visible);
        println!("{name:<58} {distance:>10.4} {allowed:>8.1} {visible:>10.1}  {output}, row {row}{mark}");
    }
    Ok(held)
}

/// Writes the records of the examples.
pub(crate) fn examples(words: &Words) -> Result<bool, String> {
    for (name, text) in examples::files() {
        write(&words.out.join(name), &text)?;
    }
    Ok(true)
}
