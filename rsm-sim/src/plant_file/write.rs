//! Writes a plant file.
//!
//! In: a [`PlantFile`]. Out: text that is read back to the same bits: it uses the shortest decimals with this property. It contains no comments.

use std::fmt::Write as _;

use rsm_core::number::decimal;

use super::{Named, PlantFile, VelocityFrom};
use crate::effect::Subject;
use crate::kind::Described;
use crate::schema;

impl PlantFile {
    /// The text of the file, with all effects.
    #[must_use]
    pub fn write(&self) -> String {
        if !self.kind.is_first_format {
            return of_equations(&self.kind, self);
        }
        let mut text = format!("format = 1\nplant = \"{}\"\n\n[parameters]\n", self.kind.name());
        let mut array: Vec<String> = Vec::new();
        let names = schema::parameters(self.kind).iter().map(|it| it.name);
        for (name, next) in names.clone().zip(names.skip(1).map(Some).chain([None])) {
            let Some(value) = self.parameters.optional(name).map(decimal) else { continue };
            let of = |name| schema::element(name).map(|it| it.0);
            let Some(own) = of(name) else {
                let _ = writeln!(text, "{name} = {value}");
                continue;
            };
            array.push(value);
            // The last element writes the array.
            if next.and_then(of) != Some(own) {
                let _ = writeln!(text, "{own} = [{}]", array.join(", "));
                array.clear();
            }
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
                Subject::Site => "at",
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

/// The text of a plant of equations: its file with the current parameters, start values and effects. The files that it names are expected in the same
/// folder, so their names are written without a folder.
fn of_equations(kind: &Described, file: &PlantFile) -> String {
    use toml::{Table, Value};
    let mut whole: Table = kind.text.parse().unwrap_or_default();
    let inside = |whole: &mut Table, key: &str, list: &mut dyn Iterator<Item = (&str, f64)>| {
        for (name, value) in list {
            let entry = whole.entry(key).or_insert_with(|| Value::Table(Table::new()));
            entry.as_table_mut().and_then(|it| it.insert(name.to_string(), Value::Float(value)));
        }
    };
    let changed = kind.parameters.iter().zip(&kind.values).filter_map(|(it, was)| {
        let value = file.parameters.optional(it.name)?;
        (value.to_bits() != was.to_bits()).then_some((it.name, value))
    });
    inside(&mut whole, "parameters", &mut changed.collect::<Vec<_>>().into_iter());
    inside(&mut whole, "initial", &mut file.initial.iter().copied());
    whole.remove("effects");
    let effects = file.acting().map(|entry| {
        let numbers = entry.arguments.numbers.iter().map(|(name, value)| ((*name).to_string(), Value::Float(*value)));
        let mut one = Table::from_iter([("kind".to_string(), Value::String(entry.description.kind.to_string()))]);
        one.extend(entry.arguments.subject.iter().map(|at| ("at".to_string(), Value::String(at.clone()))));
        one.insert("parameters".to_string(), Value::Table(numbers.collect()));
        Value::Table(one)
    });
    let effects: Vec<Value> = effects.collect();
    if !effects.is_empty() {
        whole.insert("effects".to_string(), Value::Array(effects));
    }
    remove_folders(&mut whole);
    whole.to_string()
}

/// Removes the folders from names of files.
fn remove_folders(table: &mut toml::Table) {
    for (key, value) in table.iter_mut() {
        match value {
            toml::Value::String(name) if key == "model" && !name.starts_with("rsm:") => {
                if let Some((_, last)) = name.rsplit_once('/') {
                    *name = last.to_string();
                }
            }
            toml::Value::Table(inner) => remove_folders(inner),
            _ => {}
        }
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

/// A TOML string: quotes, backslashes and control characters are escaped.
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
