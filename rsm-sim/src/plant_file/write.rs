//! Writes a plant file.
//!
//! In: a [`PlantFile`]. Out: text that is read back to the same bits: it uses the shortest decimals with this property. It contains no comments.

use std::fmt::Write as _;

use rsm_core::number::decimal;

use super::{Entry, Named, PlantFile, VelocityFrom};
use crate::configurations::{name_in, parts};
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
        let common = self.kind.common.unwrap_or(self.kind);
        let names = schema::parameters(common).iter().map(|it| it.name);
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
        table(&mut text, "tolerance", &common_tolerance(self));
        table(&mut text, "noise", &self.noise);
        table(&mut text, "initial", &self.initial);
        if !self.columns.is_empty() {
            text.push_str("\n[columns]\n");
        }
        for renamed in &self.columns {
            let unit = renamed.unit.as_ref().map_or(String::new(), |unit| format!(", unit = {}", quoted(unit)));
            let _ = writeln!(text, "{} = {{ column = {}{unit} }}", renamed.signal, quoted(&renamed.column));
        }
        configurations(&mut text, self);
        for entry in self.acting() {
            let word = match entry.description.subject {
                Subject::None => "",
                Subject::Parameter => "parameter",
                Subject::Output => "output",
                Subject::Site => "at",
            };
            let (subject, numbers) = numbers(entry);
            let subject = subject.iter().map(|name| format!("{word} = \"{name}\""));
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
    let (own, common): (Vec<_>, Vec<_>) = changed.partition(|it| parts(it.0).is_some());
    inside(&mut whole, "parameters", &mut common.into_iter());
    for (name, value) in own {
        let Some((name, configuration)) = parts(name) else { continue };
        let its = whole.get_mut("configurations").and_then(Value::as_table_mut).and_then(|it| it.get_mut(configuration));
        if let Some(its) = its.and_then(Value::as_table_mut) {
            inside(its, "parameters", &mut std::iter::once((name, value)));
        }
    }
    inside(&mut whole, "initial", &mut file.initial.iter().copied());
    whole.remove("effects");
    let effects = file.acting().map(|entry| {
        let (subject, numbers) = by_configuration(entry);
        let numbers = numbers.into_iter().map(|(name, value)| {
            let value = match value {
                ByConfiguration::One(value) => Value::Float(value),
                ByConfiguration::Each(list) => {
                    Value::Table(list.into_iter().map(|it| (it.0.to_string(), Value::Float(it.1))).collect())
                }
            };
            (name.to_string(), value)
        });
        let mut one = Table::from_iter([("kind".to_string(), Value::String(entry.description.kind.to_string()))]);
        one.extend(subject.iter().map(|at| ("at".to_string(), Value::String((*at).to_string()))));
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

/// A number of an effect: one for all configurations, or one for each of some.
enum ByConfiguration<'e> {
    One(f64),
    Each(Vec<(&'e str, f64)>),
}

/// The subject of an entry and its numbers, those of configurations together. An error of a parameter of one configuration is the error of the
/// parameter in this configuration.
fn by_configuration(entry: &Entry) -> (Option<&str>, Vec<(&str, ByConfiguration<'_>)>) {
    let subject = entry.arguments.subject.as_deref();
    let of_subject = subject.and_then(parts).filter(|_| entry.description.subject == Subject::Parameter);
    let mut numbers: Vec<(&str, ByConfiguration<'_>)> = Vec::new();
    for (name, value) in &entry.arguments.numbers {
        let (name, configuration) = match (parts(name), of_subject) {
            (Some((name, its)), _) => (name, Some(its)),
            (None, Some((_, its))) => (*name, Some(its)),
            (None, None) => (*name, None),
        };
        match (configuration, numbers.last_mut()) {
            (None, _) => numbers.push((name, ByConfiguration::One(*value))),
            (Some(its), Some((last, ByConfiguration::Each(list)))) if *last == name => list.push((its, *value)),
            (Some(its), _) => numbers.push((name, ByConfiguration::Each(vec![(its, *value)]))),
        }
    }
    (of_subject.map(|it| it.0).or(subject), numbers)
}

/// The subject of an entry and its numbers as in a file.
pub(crate) fn numbers(entry: &Entry) -> (Option<&str>, Vec<String>) {
    let (subject, numbers) = by_configuration(entry);
    let one = |(name, number): (&str, ByConfiguration<'_>)| match number {
        ByConfiguration::One(value) => format!("{name} = {}", decimal(value)),
        ByConfiguration::Each(list) => {
            let each: Vec<String> = list.iter().map(|(name, value)| format!("{name} = {}", decimal(*value))).collect();
            format!("{name} = {{ {} }}", each.join(", "))
        }
    };
    (subject, numbers.into_iter().map(one).collect())
}

/// `[tolerance]` of a plant file: that of a parameter without a common value follows from its configurations.
pub(crate) fn common_tolerance(file: &PlantFile) -> Vec<Named> {
    let mut list: Vec<Named> = file.tolerance.iter().filter(|it| parts(it.0).is_none()).copied().collect();
    // A parameter under `differ` has no common tolerance any more.
    for name in &file.kind.configurations.differ {
        let Some(nominal) = schema::parameters(file.kind).iter().find(|it| it.name == name) else { continue };
        let own = file.tolerance.iter().find(|it| parts(it.0).is_some_and(|it| it.0 == name));
        if !list.iter().any(|it| it.0 == nominal.name) {
            list.extend(own.map(|it| (nominal.name, it.1)));
        }
    }
    list
}

/// `[configurations]` of a plant file of format 1, with the current parameters.
pub(crate) fn configurations(text: &mut String, file: &PlantFile) {
    let all = &file.kind.configurations;
    if all.is_empty() {
        return;
    }
    text.push_str("\n[configurations]\n");
    let names = |list: &[String]| list.iter().map(|it| quoted(it)).collect::<Vec<_>>().join(", ");
    if !all.differ.is_empty() {
        let _ = writeln!(text, "differ = [{}]", names(&all.differ));
    }
    for (place, it) in all.list.iter().enumerate() {
        let _ = write!(text, "\n[configurations.{}]\nrecords = [{}]\n", it.name, names(&it.records));
        let own = |name: &str| parts(name).filter(|found| found.1 == it.name).map(|found| found.0.to_string());
        let values = file.kind.own.iter().filter(|found| found.1 == place).filter_map(|(index, _)| {
            let name = file.kind.parameters[*index].name;
            file.parameters.optional(&name_in(name, &it.name)).map(|value| (name.to_string(), value))
        });
        let tolerances = file.tolerance.iter().filter_map(|(name, value)| own(name).map(|name| (name, *value)));
        for (key, list) in [("parameters", values.collect::<Vec<_>>()), ("tolerance", tolerances.collect())] {
            if !list.is_empty() {
                let each: Vec<String> =
                    list.iter().map(|(name, value)| format!("{} = {}", toml_key(name), decimal(*value))).collect();
                let _ = writeln!(text, "{key} = {{ {} }}", each.join(", "));
            }
        }
    }
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
        let _ = writeln!(text, "{} = {}", toml_key(key), decimal(*value));
    }
}

/// A name as a TOML key: the name of an element of an array has brackets.
fn toml_key(name: &str) -> String {
    if name.contains('[') { quoted(name) } else { name.to_string() }
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
