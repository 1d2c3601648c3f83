//! The family `configurations` of `judge`: writes cases, runs `rsm diagnose` on each, and compares with the truth.
//!
//! In: arguments, a seed. Out: lines of the table. It writes only into the folder of `--out`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use hidden_effects::case::Family;
use hidden_effects::configurations::{Case, cases, judge as judged};

use super::report::{Line, Report};
use super::{Words, first_line, side_by_side, write};

/// Whether the family is asked for, by its name or that of a case. The quick subset has two of its cases.
fn is_asked(words: &Words) -> bool {
    let choice = &words.choice;
    let by_name = choice.name.as_ref().is_some_and(|name| name.starts_with("configurations-"));
    let by_family = choice.family == Some(Family::Configurations) && choice.name.is_none();
    by_name || by_family || choice.quick && choice.family.is_none() && choice.name.is_none()
}

/// Judges the cases of a seed.
pub(super) fn judge(words: &Words, seed: u64, report: &mut Report) -> Result<(), String> {
    if !is_asked(words) {
        return Ok(());
    }
    let choice = &words.choice;
    let cases = cases(seed, choice.name.as_deref(), choice.quick, choice.rows).into_iter();
    report.lines.extend(side_by_side::each(words.at_once(), cases, |case| one(words, seed, &case))?);
    Ok(())
}

fn one(words: &Words, seed: u64, case: &Case) -> Result<Line, String> {
    let folder = words.out.join(format!("{seed}")).join(&case.name);
    let mut diagnose = command(words, case, &folder)?;
    let started = Instant::now();
    let run = diagnose.output().map_err(|error| format!("{}: {error}", words.rsm.display()))?;
    // No signal to noise is computed: the causes are far above it.
    let mut line = Line::of(Family::Configurations, &case.name, f64::NAN, started.elapsed().as_secs_f64());
    match serde_json::from_slice(&run.stdout) {
        Ok(answer) => line.judgement = judged(case, &answer),
        Err(error) => {
            let said = String::from_utf8_lossy(&run.stderr);
            let said = if said.trim().is_empty() { error.to_string() } else { first_line(&said) };
            line.judgement.answer = format!("{}: {said}", run.status);
        }
    }
    println!("{line}");
    Ok(line)
}

/// Writes the files of a case, and calls `rsm diagnose` for them.
fn command(words: &Words, case: &Case, folder: &Path) -> Result<Command, String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let put = |(name, text): &(String, String)| -> Result<PathBuf, String> {
        let path = folder.join(name);
        write(&path, text)?;
        Ok(path)
    };
    let files = case.files.iter().map(put).collect::<Result<Vec<_>, String>>()?;
    let mut diagnose = Command::new(&words.rsm);
    diagnose.arg("diagnose").arg(&files[0]).arg("--json").arg("--out").arg(folder.join("diagnosis"));
    for (option, records) in ["--record", "--validate"].into_iter().zip(&case.records) {
        for record in records {
            diagnose.arg(option).arg(put(record)?);
        }
    }
    Ok(diagnose)
}
