//! Effects, sites and the rules of `[record]` in a plant file of format 2.
//!
//! ```toml
//! [sites.carriage]              # where an effect can stand
//! kind = "translation"
//! position = "position"
//! speed = "speed"
//! inertia = "mass"
//! [[effects]]
//! kind = "coulomb-friction"
//! at = "carriage"               # left out where only one fits
//! parameters = { force = 20.0 } # or { force = { unloaded = 20.0, loaded = 35.0 } }, by configuration
//! [record]
//! gear = "gear"                 # a parameter that a column gives; the column is constant in a record
//! holds_i_d = "without v_d, i_d"   # a Boolean one: whether these columns are absent. Absent inputs are 0
//! start = ["road_speed"]        # the outputs whose first readings give the start, in place of all that can
//! ```
//!
//! In: tables of the file. Out: [`Entry`]s, sites, [`Rule`]s. It never changes an equation.

use std::ops::Range;

use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_core::toml_reader::{TableReader, Value};
use rsm_fit::table::{Table, Wanted};
use rsm_model::effects::{Catalogue, Placed};

use crate::configurations::{Configurations, name_in, parts, without};

/// A value that a plant file assigns to a name of the text.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedValue {
    /// The name in the text.
    pub name: String,
    /// The value, in the unit of the text.
    pub value: f64,
}

/// An effect with its place, as in a plant file.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its kind.
    pub kind: String,
    /// Its site; `None` if only one site fits.
    pub at: Option<String>,
    /// Its parameters.
    pub numbers: Vec<NamedValue>,
    /// The position in the file.
    pub(super) place: Range<usize>,
}

impl Entry {
    /// An effect that is not read from a file.
    #[must_use]
    pub fn new(kind: &str, at: Option<&str>, numbers: &[(&str, f64)]) -> Entry {
        let numbers = numbers.iter().map(|(name, value)| NamedValue { name: (*name).to_string(), value: *value }).collect();
        Entry { kind: kind.to_string(), at: at.map(str::to_string), numbers, place: 0..0 }
    }

    /// Whether it has numbers by configuration.
    pub(super) fn differs(&self) -> bool {
        self.numbers.iter().any(|it| parts(&it.name).is_some())
    }

    /// The effect with the numbers of a configuration. `None` if it does not act there, because a number is given for other configurations only.
    pub(super) fn in_configuration(&self, configuration: Option<&str>) -> Option<Entry> {
        let mut numbers: Vec<NamedValue> = Vec::new();
        for it in &self.numbers {
            match parts(&it.name) {
                None => numbers.push(it.clone()),
                Some((number, its)) if Some(its) == configuration => {
                    numbers.push(NamedValue { name: number.to_string(), value: it.value });
                }
                Some(_) => {}
            }
        }
        let has_all = self.numbers.iter().all(|it| numbers.iter().any(|own| own.name == without(&it.name)));
        has_all.then(|| Entry { numbers, ..self.clone() })
    }
}

/// How a record determines a parameter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeterminedBy {
    /// By a column, which is constant in a record.
    Column(String),
    /// By whether these columns are absent.
    Without(Vec<String>),
}

/// A parameter that a record determines.
#[derive(Debug, Clone)]
pub struct Rule {
    /// The parameter.
    pub parameter: String,
    /// How it is determined.
    pub by: DeterminedBy,
    pub(super) place: Range<usize>,
}

/// `[record]`.
#[derive(Debug, Clone, Default)]
pub struct Rules {
    /// Parameters that a record determines.
    pub parameters: Vec<Rule>,
    /// Outputs whose first readings determine the start. If empty, all suitable outputs are used.
    pub start: Vec<String>,
}

/// Reads `[[effects]]`.
pub(super) fn effects(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<Entry> {
    let source = top.source();
    let Some(value) = top.optional("effects") else { return Vec::new() };
    let Some(items) = top.array("`effects`", value, faults) else { return Vec::new() };
    items.into_iter().filter_map(|item| entry(source, item, faults)).collect()
}

fn entry(source: &Source, value: Value<'_>, faults: &mut Collector) -> Option<Entry> {
    let mut table = TableReader::of(source, value, "[[effects]]", faults)?;
    let place = table.key_span("kind");
    let (kind, at) = (table.text("kind", faults), table.optional_text("at", faults));
    let mut numbers = Vec::new();
    if let Some(value) = table.optional("parameters")
        && let Some(inner) = TableReader::of(source, value, "[[effects]]: `parameters`", faults)
    {
        for (name, _, value) in inner.entries() {
            // A table has a number for each configuration.
            if value.get_ref().is_table()
                && let Some(each) = TableReader::of(source, value, format!("[[effects]]: `{name}`"), faults)
            {
                for (configuration, _, value) in each.entries() {
                    let value = each.number(&format!("`{configuration}`"), value, faults);
                    numbers.extend(value.map(|value| NamedValue { name: name_in(name, configuration), value }));
                }
                continue;
            }
            let value = inner.number(&format!("`{name}`"), value, faults);
            numbers.extend(value.map(|value| NamedValue { name: name.to_string(), value }));
        }
    }
    table.finish(faults);
    Some(Entry { kind: kind?, at, numbers, place })
}

/// Reports numbers of effects for configurations that the file does not have.
pub(super) fn known_configurations(source: &Source, entries: &[Entry], known: &Configurations, faults: &mut Collector) {
    for entry in entries {
        for (number, name) in entry.numbers.iter().filter_map(|it| parts(&it.name)) {
            if let Err(fault) = known.of_name(name) {
                let what = format!("[[effects]]: `{}`: `{number}`: {}", entry.kind, fault.what);
                faults.push(source.fault(entry.place.clone(), what));
            }
        }
    }
}

/// Reads `[record]`.
pub(super) fn rules(top: &mut TableReader<'_>, faults: &mut Collector) -> Rules {
    let source = top.source();
    let mut rules = Rules::default();
    let Some(value) = top.optional("record") else { return rules };
    let Some(mut table) = TableReader::of(source, value, "[record]", faults) else { return rules };
    if let Some(value) = table.optional("start") {
        rules.start = match value.get_ref().as_str() {
            Some(one) => vec![one.to_string()],
            None => table.texts("`start`", value, faults).unwrap_or_default().into_iter().map(|it| it.0).collect(),
        };
    }
    for (name, place, value) in table.entries().filter(|it| it.0 != "start") {
        let Some(text) = value.get_ref().as_str() else {
            faults
                .push(source.fault(value.span(), format!("[record]: `{name}`: expected a column, or \"without COLUMN, ...\"")));
            continue;
        };
        let by = match text.strip_prefix("without ") {
            Some(list) => DeterminedBy::Without(list.split(',').map(|it| it.trim().to_string()).collect()),
            None => DeterminedBy::Column(text.trim().to_string()),
        };
        rules.parameters.push(Rule { parameter: name.to_string(), by, place });
    }
    rules
}

/// Finds the effects of a file in a catalogue.
///
/// # Errors
/// Kinds that are not in the catalogue.
pub(super) fn placed<'c>(source: &Source, entries: &[Entry], catalogue: &'c Catalogue) -> Result<Vec<Placed<'c>>, Faults> {
    let mut faults = Collector::new();
    let mut list = Vec::new();
    for entry in entries {
        let Some(effect) = catalogue.find(&entry.kind) else {
            let near = near(&entry.kind, catalogue);
            let fault = source.fault(entry.place.clone(), format!("[[effects]]: no effect is called `{}`", entry.kind));
            faults.push(fault.help(format!("near it are {near}; `rsm effects` lists all of them")));
            continue;
        };
        list.push(Placed {
            effect,
            at: entry.at.clone(),
            numbers: entry.numbers.iter().map(|it| (it.name.clone(), it.value)).collect(),
            source: source.clone(),
            place: entry.place.clone(),
        });
    }
    faults.finish(Some(list))
}

/// The largest number of names in a message.
const LISTED: usize = 5;

/// The names that have most pairs of letters in common with a misspelled one.
fn near(kind: &str, catalogue: &Catalogue) -> String {
    let pairs = |text: &str| -> Vec<(char, char)> { text.chars().zip(text.chars().skip(1)).collect() };
    let own = pairs(kind);
    let mut names: Vec<(usize, &str)> = catalogue
        .effects()
        .iter()
        .map(|it| (pairs(&it.kind).iter().filter(|pair| own.contains(pair)).count(), it.kind.as_str()))
        .collect();
    names.sort_by(|a, b| b.cmp(a));
    let names: Vec<String> = names.into_iter().take(LISTED).map(|it| format!("`{}`", it.1)).collect();
    names.join(", ")
}

/// Values that a record determines: values of parameters, and the absent inputs.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct RecordValues {
    pub parameters: Vec<(String, f64)>,
    pub absent: Vec<String>,
}

impl Rules {
    /// Evaluates the rules for a record. `open` reads its columns; `column` gives the column name of a signal.
    ///
    /// # Errors
    /// A record that cannot be read; a column that is not constant. If only some of the columns of a `without` rule are absent, this is no fault
    /// here: the parameter is then 0.
    pub(super) fn record_values(
        &self,
        open: &dyn Fn(&Wanted) -> Result<Table, Faults>,
        column: &dyn Fn(&str) -> String,
    ) -> Result<RecordValues, Faults> {
        let mut record_values = RecordValues::default();
        if self.parameters.is_empty() {
            return Ok(record_values);
        }
        let header = open(&Wanted::default())?;
        let has = |name: &str| header.column(&column(name)).is_some();
        let mut faults = Collector::new();
        for rule in &self.parameters {
            match &rule.by {
                DeterminedBy::Column(name) if has(name) => {
                    let name = column(name);
                    let table = open(&Wanted { numbers: vec![name.clone()], ..Wanted::default() })?;
                    let values = table.column(&name).map(|it| it.values.clone()).unwrap_or_default();
                    let Some(first) = values.first().copied() else { continue };
                    if let Some(row) = values.iter().position(|it| *it != first) {
                        let what =
                            format!("column `{name}` is {first} in the first row and {} in row {}", values[row], row + 1);
                        let help = format!(
                            "it sets the parameter `{}`, which is one number a record: cut the record there",
                            rule.parameter
                        );
                        faults.push(Fault::at_line(&table.file, table.header_line + 1 + row, 0, what).help(help));
                    }
                    record_values.parameters.push((rule.parameter.clone(), first));
                }
                DeterminedBy::Column(_) => {}
                DeterminedBy::Without(names) => {
                    let missing: Vec<&String> = names.iter().filter(|it| !has(it)).collect();
                    if missing.len() == names.len() {
                        record_values.absent.extend(names.iter().cloned());
                    }
                    record_values.parameters.push((rule.parameter.clone(), f64::from(u8::from(missing.len() == names.len()))));
                }
            }
        }
        faults.finish(Some(record_values))
    }
}
