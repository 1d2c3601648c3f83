//! The tables of a plant file that give values, columns and surfaces to names of its text.
//!
//! In: the TOML of the file, and the names that the text has. Out: names with their values and their position in the file; every unknown name as a
//! fault with the accepted names.

use std::ops::Range;

use rsm_core::check::Checked;
use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::TableReader;

use super::extended::NamedValue;

/// A signal with a different name in the record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// The input or output of the text.
    pub signal: String,
    /// The column of the record.
    pub name: String,
    /// The unit, if the header of the record has none.
    pub unit: Option<String>,
}

/// A response surface that implements a function of the text.
#[derive(Debug, Clone)]
pub struct Function {
    /// The name of the function in the text.
    pub name: String,
    /// The model that contains the surface.
    pub model: Checked,
    /// The index of the surface in the model.
    pub surface: usize,
}

/// A name with its position in the file.
pub(super) struct Named {
    pub given: NamedValue,
    pub place: Range<usize>,
}

/// A table of numbers with names from the text. Negative numbers are accepted only if `any` is set.
pub(super) fn numbers(top: &mut TableReader<'_>, key: &'static str, any: bool, faults: &mut Collector) -> Vec<Named> {
    let source = top.source();
    let Some(value) = top.optional(key) else { return Vec::new() };
    let Some(table) = TableReader::of(source, value, format!("[{key}]"), faults) else { return Vec::new() };
    let mut list = Vec::new();
    for (name, place, value) in table.entries() {
        let number = match value.get_ref().as_bool() {
            Some(truth) if key == "parameters" => Some(f64::from(u8::from(truth))),
            _ => table.number(&format!("`{name}`"), value, faults),
        };
        match number {
            Some(number) if !any && number < 0.0 => {
                faults.push(
                    table.fault(value.span(), format!("`{name}`: found {number}, expected a number that is not negative")),
                );
            }
            Some(value) => list.push(Named { given: NamedValue { name: name.to_string(), value }, place }),
            None => {}
        }
    }
    list
}

/// The table `[columns]`: each column with its position in the file.
pub(super) fn columns(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<(Column, Range<usize>)> {
    let source = top.source();
    let Some(value) = top.optional("columns") else { return Vec::new() };
    let Some(table) = TableReader::of(source, value, "[columns]", faults) else { return Vec::new() };
    let mut list = Vec::new();
    for (signal, place, value) in table.entries() {
        if let Some(name) = value.get_ref().as_str() {
            list.push((Column { signal: signal.to_string(), name: name.to_string(), unit: None }, place));
            continue;
        }
        let Some(mut inner) = TableReader::of(source, value, format!("[columns]: `{signal}`"), faults) else { continue };
        let (name, unit) = (inner.text("name", faults), inner.optional_text("unit", faults));
        inner.finish(faults);
        if let Some(name) = name {
            list.push((Column { signal: signal.to_string(), name, unit }, place));
        }
    }
    list
}

/// An entry of `[functions]`.
pub(super) struct NamedFunction {
    pub name: String,
    pub place: Range<usize>,
    model: String,
    surface: String,
}

/// The table `[functions]`.
pub(super) fn functions(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<NamedFunction> {
    let source = top.source();
    let Some(value) = top.optional("functions") else { return Vec::new() };
    let Some(table) = TableReader::of(source, value, "[functions]", faults) else { return Vec::new() };
    let mut list = Vec::new();
    for (name, place, value) in table.entries() {
        let Some(mut inner) = TableReader::of(source, value, format!("[functions]: `{name}`"), faults) else { continue };
        let (model, surface) = (inner.text("model", faults), inner.text("surface", faults));
        inner.finish(faults);
        if let Some((model, surface)) = model.zip(surface) {
            list.push(NamedFunction { name: name.to_string(), place, model, surface });
        }
    }
    list
}

impl NamedFunction {
    /// Reads the surface of this entry. It must have as many inputs as the function in the text.
    pub(super) fn read(
        &self,
        declared: &rsm_model::flat::Surface,
        source: &Source,
        open: &dyn Fn(&str) -> Result<Source, Faults>,
    ) -> Result<Function, Faults> {
        let model = Checked::read(&open(&self.model)?)?;
        let refuse =
            |what: String| Faults::one(source.fault(self.place.clone(), format!("[functions]: `{}`: {what}", self.name)));
        let surfaces = &model.model().surfaces;
        let Some(surface) = surfaces.iter().position(|it| it.name == self.surface) else {
            let names: Vec<String> = surfaces.iter().map(|it| format!("`{}`", it.name)).collect();
            return Err(refuse(format!("{} has no surface `{}`; it has {}", self.model, self.surface, names.join(", "))));
        };
        let (found, wanted) = (surfaces[surface].inputs.len(), declared.inputs.len());
        if found != wanted {
            return Err(refuse(format!("the surface `{}` has {found} inputs, the text gives {wanted}", self.surface)));
        }
        Ok(Function { name: self.name.clone(), model, surface })
    }
}

/// Reports every name of a table that the text does not have. `what` says what it should be.
pub(super) fn check(source: &Source, table: &str, list: &[Named], known: &[String], what: &str, faults: &mut Collector) {
    for it in list {
        unknown(source, table, &it.given.name, &it.place, known, what, faults);
    }
}

/// The largest number of names in a message.
const LISTED: usize = 20;

/// Reports a name that the text does not have.
pub(super) fn unknown(
    source: &Source,
    table: &str,
    name: &str,
    place: &Range<usize>,
    known: &[String],
    what: &str,
    faults: &mut Collector,
) {
    if known.iter().any(|it| it == name) {
        return;
    }
    let list: Vec<String> = known.iter().take(LISTED).map(|it| format!("`{it}`")).collect();
    let more = if known.len() > LISTED { ", ..." } else { "" };
    let fault = source.fault(place.clone(), format!("[{table}]: the text has no {what} `{name}`"));
    faults.push(if list.is_empty() { fault } else { fault.help(format!("it has {}{more}", list.join(", "))) });
}
