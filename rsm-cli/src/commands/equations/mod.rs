//! Plants of equations (plant files of format 2, or a text alone): `rsm inspect`, `rsm linearise`, and their part of `rsm simulate` and `rsm emit`.
//!
//! In: a plant file or a text of equations. Out: the output of each subcommand. No mathematics.

pub mod effects;
pub mod emit;
pub mod inspect;
pub mod linearise;
pub mod simulate;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rsm_core::source::{Fault, Faults, Source};
use rsm_model::effects::{Catalogue, Room};
use rsm_sim::equations::file::NamedValue;
use rsm_sim::equations::linear::Pole;
use rsm_sim::equations::{EquationFile, Machine, Point};
use rsm_sim::kind::Drive;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use crate::outcome::Refusal;

/// The effects that come with the project, and those of the folder if one is given.
pub fn catalogue(folder: Option<&Path>) -> Result<Arc<Catalogue>, Refusal> {
    let mut catalogue = Catalogue::shipped();
    if let Some(folder) = folder {
        let refuse = |what: String| Faults::one(Fault::whole_file(&folder.display().to_string(), what));
        let entries = std::fs::read_dir(folder).map_err(|error| refuse(format!("cannot be read: {error}")))?;
        let mut files: Vec<PathBuf> = entries.filter_map(Result::ok).map(|it| it.path()).collect();
        files.retain(|it| it.extension().is_some_and(|it| it.eq_ignore_ascii_case("toml")));
        files.sort();
        if files.is_empty() {
            return Err(refuse("the folder has no file of an effect (*.toml)".to_string()).into());
        }
        let sources: Vec<Source> = files.iter().map(|it| Source::read(it)).collect::<Result<_, _>>()?;
        catalogue.add(&sources)?;
    }
    Ok(Arc::new(catalogue))
}

/// Reads a plant of equations from its plant file, or from its text (`.mo`) alone. An axis of format 1 is in open or in closed loop: the columns of a
/// record decide this, and without a record the parameters of the controller.
pub fn file(path: &Path, record: Option<&Source>, effects: Option<&Path>) -> Result<EquationFile, Refusal> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let open = |name: &str| Source::read(&folder.join(name));
    let source = Source::read(path)?;
    if path.extension().is_some_and(|it| it.eq_ignore_ascii_case("mo")) {
        return Ok(EquationFile::of_text(&source)?);
    }
    if rsm_sim::equations::file::format(&source) == Some(1) {
        if effects.is_some() {
            return Err(built_in_effects_only());
        }
        let plant = PlantFile::read(&source)?;
        let closed = match record {
            Some(record) => Record::read(record, &plant)?.drive == Drive::Closed,
            None => plant.parameters.optional("position_gain").is_some(),
        };
        return Ok(EquationFile::of_first_format(&plant, closed)?);
    }
    Ok(EquationFile::read_with(&source, &open, &catalogue(effects)?)?)
}

/// The plant in a configuration of its file, if one is named.
pub fn in_configuration(file: EquationFile, configuration: Option<&str>) -> Result<EquationFile, Refusal> {
    match configuration {
        Some(name) => Ok(file.in_configuration(name)?),
        None => Ok(file),
    }
}

/// Refuses a plant with several configurations if none is chosen.
pub fn refuse_several(path: &Path, file: &EquationFile, option: &str) -> Result<(), Refusal> {
    if file.configurations.is_empty() || file.configuration.is_some() {
        return Ok(());
    }
    let names: Vec<String> = file.configurations.names().map(|it| format!("`{it}`")).collect();
    Err(Refusal::new(format!(
        "{}: found several configurations, expected {option} with one of {}",
        path.display(),
        names.join(", ")
    )))
}

/// A plant of equations, ready to be evaluated.
pub fn plant(path: &Path, effects: Option<&Path>, configuration: Option<&str>) -> Result<(EquationFile, Machine), Refusal> {
    let file = in_configuration(file(path, None, effects)?, configuration)?;
    let machine = Machine::new(&file)?;
    Ok((file, machine))
}

/// The refusal of `--effects` with a plant file of format 1.
pub fn built_in_effects_only() -> Refusal {
    Refusal::new("--effects: found a plant file of format 1, which has built-in effects only; expected format 2")
}

/// Whether a plant file is of format 2.
pub fn is_equations(source: &Source) -> bool {
    rsm_sim::equations::file::format(source) == Some(2)
}

/// Whether a file describes a plant, of format 2 or one of the three of format 1, and not a model of surfaces.
pub fn is_plant(source: &Source) -> bool {
    is_equations(source) || rsm_sim::equations::file::names_a_plant(source)
}

/// The numbers of `--at`: `name=number,...`.
fn numbers(text: &str) -> Result<Vec<(String, f64)>, Refusal> {
    let one = |part: &str| {
        let (name, value) =
            part.split_once('=').ok_or_else(|| Refusal::new(format!("--at: found `{part}`, expected NAME=NUMBER")))?;
        let number: f64 = value
            .trim()
            .parse()
            .map_err(|_| Refusal::new(format!("--at: `{}`: found `{value}`, expected a number", name.trim())))?;
        if number.is_finite() {
            Ok((name.trim().to_string(), number))
        } else {
            Err(Refusal::new(format!("--at: `{name}` is not finite")))
        }
    };
    text.split(',').filter(|part| !part.trim().is_empty()).map(one).collect()
}

/// The point that `--at` gives: inputs, and variables at the start. An input that is not named is 0.
fn point(file: &EquationFile, machine: &mut Machine, at: &str) -> Result<Point, Refusal> {
    let mut inputs = vec![0.0; machine.inputs().len()];
    let mut given: Vec<NamedValue> = Vec::new();
    let mut time = 0.0;
    for (name, value) in numbers(at)? {
        if let Some(place) = machine.inputs().iter().position(|it| it.0 == name) {
            inputs[place] = value;
        } else if name == "time" {
            time = value;
        } else if machine.states().iter().chain(&machine.outputs()).any(|it| it.0 == name) {
            given.push(NamedValue { name, value });
        } else {
            let known: Vec<String> = [machine.inputs(), machine.states(), machine.outputs()]
                .concat()
                .into_iter()
                .map(|it| format!("`{}`", it.0))
                .collect();
            return Err(Refusal::new(format!(
                "--at: the plant has no input, state or output `{name}`; it has {}",
                known.join(", ")
            )));
        }
    }
    for it in &file.initial {
        if !given.iter().any(|other| other.name == it.name) {
            given.push(it.clone());
        }
    }
    Ok(machine.start(file, time, &inputs, &given)?)
}

/// A name with its unit.
fn with_unit((name, unit): &(String, String)) -> String {
    if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") }
}

/// The possible sites of effects as JSON.
fn rooms_json(rooms: &[Room]) -> Vec<serde_json::Value> {
    rooms.iter().map(|it| serde_json::json!({ "at": it.at, "site": it.kind.name(), "kinds": it.effects })).collect()
}

/// The possible sites of effects, one line for each.
fn room_lines(rooms: &[Room]) -> impl Iterator<Item = String> {
    rooms.iter().map(|it| format!("{} ({}): {}", it.at, it.kind.name(), it.effects.join(", ")))
}

/// Poles as JSON.
fn poles_json(poles: &[Pole]) -> Vec<serde_json::Value> {
    let one = |it: &Pole| serde_json::json!({ "real": it.real, "imaginary": it.imaginary, "frequency": it.frequency(), "damping": it.damping() });
    poles.iter().map(one).collect()
}

/// Poles in words, one line each. The second pole of a conjugate pair is left out.
fn pole_lines(poles: &[Pole]) -> Vec<String> {
    let one = |pole: &Pole| match (pole.imaginary == 0.0, pole.damping()) {
        (_, None) => "pole at 0: an integrator".to_string(),
        (true, _) if pole.real < 0.0 => format!("pole {:.6}/s: time constant {:.6} s", pole.real, -1.0 / pole.real),
        (true, _) => format!("pole {:.6}/s: unstable, doubles in {:.6} s", pole.real, std::f64::consts::LN_2 / pole.real),
        (false, Some(damping)) => format!(
            "poles {:.6} +- {:.6}i: {:.6} rad/s ({:.6} Hz), damping ratio {damping:.6}{}",
            pole.real,
            pole.imaginary,
            pole.frequency(),
            pole.frequency() / std::f64::consts::TAU,
            if damping < 0.0 { ", unstable" } else { "" }
        ),
    };
    poles.iter().filter(|it| it.imaginary >= 0.0).map(one).collect()
}
