//! Plants of equations (plant files of format 2, or a text alone): `rsm inspect`, `rsm linearise`, and their part of `rsm simulate` and `rsm emit`.
//!
//! In: a plant file or a text. Out: what each subcommand prints or writes. No mathematics.

pub mod emit;
pub mod inspect;
pub mod linearise;
pub mod simulate;

use std::path::Path;

use rsm_core::source::Source;
use rsm_sim::equations::file::Given;
use rsm_sim::equations::{EquationFile, Machine, Point};

use crate::outcome::Refusal;

/// A plant of equations, by its plant file or by its text (`.mo`) alone.
pub fn plant(path: &Path) -> Result<(EquationFile, Machine), Refusal> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let open = |name: &str| Source::read(&folder.join(name));
    let file = if path.extension().is_some_and(|it| it.eq_ignore_ascii_case("mo")) {
        EquationFile::of_text(&Source::read(path)?)?
    } else {
        EquationFile::read(&Source::read(path)?, &open)?
    };
    let machine = Machine::new(&file)?;
    Ok((file, machine))
}

/// Whether a plant file is of format 2.
pub fn is_equations(source: &Source) -> bool {
    rsm_sim::equations::file::format(source) == Some(2)
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
    let mut given: Vec<Given> = Vec::new();
    let mut time = 0.0;
    for (name, value) in numbers(at)? {
        if let Some(place) = machine.inputs().iter().position(|it| it.0 == name) {
            inputs[place] = value;
        } else if name == "time" {
            time = value;
        } else if machine.states().iter().chain(&machine.outputs()).any(|it| it.0 == name) {
            given.push(Given { name, value });
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
