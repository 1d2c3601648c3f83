//! Writes a plant file.
//!
//! In: a [`PlantFile`]. Out: text that reads back to the same bits: shortest decimals that do. Never writes a comment.

use std::fmt::Write as _;

use rsm_core::number::decimal;

use super::{Named, PlantFile, VelocityFrom};
use crate::effect::Subject;
use crate::kind::PlantKind;
use crate::schema;

impl PlantFile {
    /// The text of the file, effects filled in.
    #[must_use]
    pub fn write(&self) -> String {
        let mut text = format!("format = 1\nplant = \"{}\"\n\n[parameters]\n", self.kind.name());
        for nominal in schema::parameters(self.kind) {
            if let Some(value) = self.parameters.optional(nominal.name) {
                let _ = writeln!(text, "{} = {}", nominal.name, decimal(value));
            }
        }
        if self.kind == PlantKind::Driveline {
            let ratios: Vec<String> = self.parameters.gear_ratios.iter().map(|ratio| decimal(*ratio)).collect();
            let _ = writeln!(text, "gear_ratios = [{}]", ratios.join(", "));
        }
        if self.parameters.velocity_from == VelocityFrom::Difference {
            text.push_str("velocity_from = \"difference\"\n");
        }
        table(&mut text, "tolerance", &self.tolerance);
        table(&mut text, "noise", &self.noise);
        table(&mut text, "initial", &self.initial);
        if !self.columns.is_empty() {
            text.push_str("\n[columns]\n");
        }
        for renamed in &self.columns {
            let unit = renamed.unit.as_ref().map_or(String::new(), |unit| format!(", unit = {}", quoted(unit)));
            let _ = writeln!(text, "{} = {{ column = {}{unit} }}", renamed.signal, quoted(&renamed.column));
        }
        for entry in self.acting() {
            let word = match entry.description.subject {
                Subject::None => "",
                Subject::Parameter => "parameter",
                Subject::Output => "output",
            };
            let subject = entry.arguments.subject.iter().map(|name| format!("{word} = \"{name}\""));
            let numbers = entry.arguments.numbers.iter().map(|(name, value)| format!("{name} = {}", decimal(*value)));
            let all: Vec<String> = subject.chain(numbers).collect();
            let _ =
                write!(text, "\n[[effects]]\nkind = \"{}\"\nparameters = {{ {} }}\n", entry.description.kind, all.join(", "));
        }
        text
    }
}

fn table(text: &mut String, name: &str, values: &[Named]) {
    if values.is_empty() {
        return;
    }
    let _ = write!(text, "\n[{name}]\n");
    for (key, value) in values {
        let _ = writeln!(text, "{key} = {}", decimal(*value));
    }
}

/// A TOML text: quotes, backslashes and control characters escaped.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for symbol in text.chars() {
        match symbol {
            '"' | '\\' => quoted.extend(['\\', symbol]),
            control if control.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(control));
            }
            other => quoted.push(other),
        }
    }
    quoted + "\""
}
