//! The plant file of format 2: a text of equations, and the numbers that this machine has.
//!
//! In: a [`Source`] and a way to open the files that it names. Out: [`EquationFile`], or every fault with line, column and the accepted names.
//!
//! ```toml
//! format = 2
//! model = "axis.mo"             # or "axis.mo#Axis", where the text holds several, or "rsm:pmac", a shipped text
//! [parameters]                  # values in place of those of the text, in its units
//! mass = 95.1
//! [tolerance]                   # relative standard deviations
//! viscous_friction = 0.1
//! [noise]                       # standard deviations of the outputs
//! position = 1e-6
//! [initial]                     # states or outputs at the start
//! speed = 0.0
//! [columns]                     # signals that a record calls otherwise
//! position = { name = "x", unit = "m" }
//! [functions]                   # functions that the text declares without an algorithm
//! engine_map = { model = "engine.toml", surface = "torque" }
//! ```

use std::ops::Range;

use rsm_core::check::Checked;
use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{TableReader, parse};
use rsm_model::flat::{Basic, Flat, Options};
use rsm_model::system::System;

/// A number that a plant file gives a name of the text.
#[derive(Debug, Clone, PartialEq)]
pub struct Given {
    /// The name in the text.
    pub name: String,
    /// The value, in the unit of the text.
    pub value: f64,
}

/// A signal that a record holds under another name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// The input or output of the text.
    pub signal: String,
    /// The column of the record.
    pub name: String,
    /// The unit, where the header has none.
    pub unit: Option<String>,
}

/// A response surface that stands for a function of the text.
#[derive(Debug, Clone)]
pub struct Function {
    /// The name of the function in the text.
    pub name: String,
    /// The model that holds the surface.
    pub model: Checked,
    /// The place of the surface among the model's.
    pub surface: usize,
}

/// A plant file of format 2 with its text, read and sorted.
#[derive(Debug, Clone)]
pub struct EquationFile {
    /// The plant file, as messages speak of it.
    pub file: String,
    /// The equations, with the parameters of this file.
    pub system: System,
    /// `[parameters]`.
    pub parameters: Vec<Given>,
    /// `[tolerance]`: relative standard deviations of parameters.
    pub tolerance: Vec<Given>,
    /// `[noise]`: standard deviations of outputs.
    pub noise: Vec<Given>,
    /// `[initial]`: values at the start.
    pub initial: Vec<Given>,
    /// `[columns]`.
    pub columns: Vec<Column>,
    /// `[functions]`, in the order in which the text calls them.
    pub functions: Vec<Function>,
}

/// The format of a plant file, where it can be read: 1 names one of the plants that are built in, 2 names a text of equations.
#[must_use]
pub fn format(source: &Source) -> Option<i64> {
    let document = parse(source, &mut Collector::new())?;
    let value = document.get_ref().get("format")?;
    value.get_ref().as_integer().and_then(|number| i64::from_str_radix(number.as_str(), number.radix()).ok())
}

/// A name with the place where it stands.
struct Entry {
    given: Given,
    place: Range<usize>,
}

impl EquationFile {
    /// Reads a plant file. `open` gives the text of a file that it names, relative to the folder of the plant file.
    ///
    /// # Errors
    /// Every fault of the plant file; those of the text, of a surface.
    pub fn read(source: &Source, open: &dyn Fn(&str) -> Result<Source, Faults>) -> Result<EquationFile, Faults> {
        let mut faults = Collector::new();
        let Some(document) = parse(source, &mut faults) else { return faults.finish(None) };
        let mut top = TableReader::document(source, &document);
        if let Some(value) = top.required("format", &mut faults) {
            top.whole("`format`", value, 2, 2, &mut faults);
        }
        let model = top.text("model", &mut faults);
        let parameters = numbers(&mut top, "parameters", true, &mut faults);
        let tolerance = numbers(&mut top, "tolerance", false, &mut faults);
        let noise = numbers(&mut top, "noise", false, &mut faults);
        let initial = numbers(&mut top, "initial", true, &mut faults);
        let columns = columns(&mut top, &mut faults);
        let functions = functions(&mut top, &mut faults);
        for (key, what) in [
            ("sites", "effects on a plant of equations are not simulated yet"),
            ("effects", "effects on a plant of equations are not simulated yet"),
            ("record", "parameters that a record sets are not read yet"),
        ] {
            if let Some(value) = top.optional(key) {
                faults.push(source.fault(value.span(), format!("`{key}`: {what}")).help("take it out of the file"));
            }
        }
        top.finish(&mut faults);
        let Some(model) = faults.finish(Some(model))? else { unreachable!("a missing model is a fault") };
        let (file, name) = model.split_once('#').map_or((model.as_str(), None), |(file, name)| (file, Some(name.to_string())));
        let text = match file.strip_prefix("rsm:") {
            None => open(file)?,
            Some(name) => rsm_model::shipped::text(name).ok_or_else(|| {
                let names: Vec<String> = rsm_model::shipped::names().map(|it| format!("`rsm:{it}`")).collect();
                let what = format!("`model`: no plant `{name}` is shipped");
                Faults::one(source.fault(document.span(), what).help(format!("shipped are {}", names.join(", "))))
            })?,
        };
        let options = Options { model: name.clone(), parameters: Vec::new() };
        let mut faults = Collector::new();
        let plain = Flat::read(&text, &options)?;
        let known = |wanted: &dyn Fn(&rsm_model::flat::Variable) -> bool| -> Vec<String> {
            plain.symbols().map(|it| plain.variable(it)).filter(|it| wanted(it)).map(|it| it.name.clone()).collect()
        };
        let is_parameter = |it: &rsm_model::flat::Variable| it.role == rsm_model::flat::Role::Parameter;
        let names = known(&is_parameter);
        check(source, "parameters", &parameters, &names, "parameter", &mut faults);
        check(source, "tolerance", &tolerance, &names, "parameter", &mut faults);
        let outputs = known(&|it| it.is_output);
        check(source, "noise", &noise, &outputs, "output", &mut faults);
        let free = known(&|it| it.role == rsm_model::flat::Role::Unknown && it.basic == Basic::Real);
        check(source, "initial", &initial, &free, "variable", &mut faults);
        let signals = known(&|it| it.is_output || it.role == rsm_model::flat::Role::Input);
        for (column, place) in &columns {
            unknown(source, "columns", &column.signal, place, &signals, "input or output", &mut faults);
        }
        let declared: Vec<String> = plain.surfaces.iter().map(|it| it.name.clone()).collect();
        for it in &functions {
            unknown(source, "functions", &it.name, &it.place, &declared, "function without an algorithm", &mut faults);
        }
        for surface in &plain.surfaces {
            if !functions.iter().any(|it| it.name == surface.name) {
                let what = format!("the function `{}` has no algorithm, and [functions] does not name it", surface.name);
                let help = format!("write `{} = {{ model = \"FILE\", surface = \"NAME\" }}` under [functions]", surface.name);
                faults.push(source.fault(document.span(), what).help(help));
            }
        }
        faults.finish(Some(()))?;
        let functions = plain
            .surfaces
            .iter()
            .filter_map(|surface| functions.iter().find(|it| it.name == surface.name).map(|it| (surface, it)))
            .map(|(surface, it)| it.read(surface, source, open))
            .collect::<Result<Vec<Function>, Faults>>()?;
        let plain = |list: Vec<Entry>| -> Vec<Given> { list.into_iter().map(|it| it.given).collect() };
        let parameters = plain(parameters);
        let options = Options { model: name, parameters: parameters.iter().map(|it| (it.name.clone(), it.value)).collect() };
        let system = System::new(&Flat::read(&text, &options)?)?;
        Ok(EquationFile {
            file: source.name().to_string(),
            system,
            parameters,
            tolerance: plain(tolerance),
            noise: plain(noise),
            initial: plain(initial),
            columns: columns.into_iter().map(|it| it.0).collect(),
            functions,
        })
    }

    /// A text alone: its own numbers, no tolerances, no noise.
    ///
    /// # Errors
    /// Those of the text; a function without an algorithm, which only a plant file can name a surface for.
    pub fn of_text(text: &Source) -> Result<EquationFile, Faults> {
        let system = System::new(&Flat::read(text, &Options::default())?)?;
        if let Some(surface) = system.flat().surfaces.first() {
            let what = format!("the function `{}` has no algorithm", surface.name);
            let help = "write a plant file (`format = 2`) that names a response surface for it under [functions]";
            return Err(Faults::one(text.fault(surface.place.clone(), what).help(help)));
        }
        Ok(EquationFile {
            file: text.name().to_string(),
            system,
            parameters: Vec::new(),
            tolerance: Vec::new(),
            noise: Vec::new(),
            initial: Vec::new(),
            columns: Vec::new(),
            functions: Vec::new(),
        })
    }

    /// The name of a signal's column in records, and its unit where the header has none.
    #[must_use]
    pub fn column<'a>(&'a self, signal: &'a str) -> (&'a str, Option<&'a str>) {
        match self.columns.iter().find(|it| it.signal == signal) {
            Some(it) => (&it.name, it.unit.as_deref()),
            None => (signal, None),
        }
    }
}

/// A table of numbers by names of the text. Negative ones only where they may be.
fn numbers(top: &mut TableReader<'_>, key: &'static str, any: bool, faults: &mut Collector) -> Vec<Entry> {
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
            Some(value) => list.push(Entry { given: Given { name: name.to_string(), value }, place }),
            None => {}
        }
    }
    list
}

fn columns(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<(Column, Range<usize>)> {
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

/// A function as the file names it.
struct Named {
    name: String,
    place: Range<usize>,
    model: String,
    surface: String,
}

fn functions(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<Named> {
    let source = top.source();
    let Some(value) = top.optional("functions") else { return Vec::new() };
    let Some(table) = TableReader::of(source, value, "[functions]", faults) else { return Vec::new() };
    let mut list = Vec::new();
    for (name, place, value) in table.entries() {
        let Some(mut inner) = TableReader::of(source, value, format!("[functions]: `{name}`"), faults) else { continue };
        let (model, surface) = (inner.text("model", faults), inner.text("surface", faults));
        inner.finish(faults);
        if let Some((model, surface)) = model.zip(surface) {
            list.push(Named { name: name.to_string(), place, model, surface });
        }
    }
    list
}

impl Named {
    /// The surface that it names, if it takes as many arguments as the text gives.
    fn read(
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

fn check(source: &Source, table: &str, list: &[Entry], known: &[String], what: &str, faults: &mut Collector) {
    for it in list {
        unknown(source, table, &it.given.name, &it.place, known, what, faults);
    }
}

/// How many names a message lists.
const LISTED: usize = 20;

fn unknown(
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
