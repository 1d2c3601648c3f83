//! Plant files of format 1 as plants of equations.
//!
//! In: a [`PlantFile`]. Out: an [`EquationFile`] with a text that is shipped with the project. Names are the same in both. The output or parameter of
//! an effect becomes its place (`at`).

use std::fmt::Write as _;
use std::sync::Arc;

use rsm_core::number::decimal;
use rsm_core::source::{Faults, Source};
use rsm_model::effects::Catalogue;

use super::file::EquationFile;
use crate::parameters::VelocityFrom;
use crate::plant_file::{PlantFile, write};
use crate::schema;

impl EquationFile {
    /// A plant file of format 1 as equations. For an axis, `closed` selects the closed or the open loop.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_sim::{equations::EquationFile, plant_file::PlantFile};
    ///
    /// let text = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2\nforce_gain = 4\nviscous_friction = 0.5\ncommand_limit = 10\n\
    ///             [[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 3 }\n";
    /// let file = EquationFile::of_first_format(&PlantFile::read(&Source::new("axis.toml", text))?, false)?;
    /// assert_eq!(file.places(), ["carriage"]);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// An effect that is not possible at its place.
    pub fn of_first_format(plant: &PlantFile, closed: bool) -> Result<EquationFile, Faults> {
        let source = Source::new("plant.toml", text(plant, closed));
        let open = |name: &str| Ok::<_, Faults>(Source::new(name, ""));
        EquationFile::read_with(&source, &open, &Arc::new(Catalogue::shipped()))
    }
}

fn text(plant: &PlantFile, closed: bool) -> String {
    let name = plant.kind.name();
    let model = match plant.kind.open_loop {
        None => name.to_string(),
        // A text may contain several models.
        Some(open) => format!("{name}#{}", if closed { plant.kind.model } else { open.model }),
    };
    let mut text = format!("format = 2\nmodel = \"rsm:{model}\"\n\n[parameters]\n");
    for nominal in schema::parameters(plant.kind.common.unwrap_or(plant.kind)) {
        // Only a text with the controller has its parameters.
        if let Some(value) = plant.parameters.optional(nominal.name).filter(|_| closed || !nominal.optional) {
            // The name of an element of an array has brackets.
            let _ = writeln!(text, "\"{}\" = {}", nominal.name, decimal(value));
        }
    }
    if closed && plant.parameters.velocity_from == VelocityFrom::Difference {
        text.push_str("velocity_from_difference = true\n");
    }
    for (name, list) in [("tolerance", &write::common_tolerance(plant)), ("noise", &plant.noise), ("initial", &plant.initial)] {
        let _ = write!(text, "\n[{name}]\n");
        // An output that does not determine the start may have a value in format 1 only.
        let counts = |key: &str| name != "initial" || plant.kind.starts().iter().any(|it| it.name == key);
        for (key, value) in list.iter().filter(|it| counts(it.0)) {
            let _ = writeln!(text, "{key} = {}", decimal(*value));
        }
    }
    text.push_str("\n[columns]\n");
    for it in &plant.columns {
        let unit = it.unit.as_ref().map_or(String::new(), |unit| format!(", unit = {unit:?}"));
        let _ = writeln!(text, "{} = {{ name = {:?}{unit} }}", it.signal, it.column);
    }
    write::configurations(&mut text, plant);
    for entry in plant.acting() {
        let _ = write!(text, "\n[[effects]]\nkind = \"{}\"\n", entry.description.kind);
        let (subject, numbers) = write::numbers(entry);
        if let Some(at) = subject {
            let _ = writeln!(text, "at = {at:?}");
        }
        let _ = writeln!(text, "parameters = {{ {} }}", numbers.join(", "));
    }
    text
}
