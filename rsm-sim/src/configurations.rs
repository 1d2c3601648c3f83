//! `[configurations]` of a plant file: records of one plant with several sets of parameters, for example unloaded and loaded.
//!
//! ```toml
//! [configurations]
//! differ = ["viscous_friction"]      # parameters whose true value may differ from configuration to configuration
//! [configurations.unloaded]
//! records = ["unloaded-*.csv"]       # names of record files without their folder; * stands for any characters
//! [configurations.loaded]
//! records = ["loaded-*.csv"]
//! parameters = { mass = 120.0 }      # values in place of [parameters]
//! tolerance = { mass = 0.05 }        # in place of [tolerance]
//! ```
//!
//! In: the table of a plant file, and the parameters of the plant. Out: [`Configurations`], or every fault with its place. A number of one
//! configuration has the name `NUMBER[CONFIGURATION]`: `mass[loaded]` is a parameter, `force[loaded]` a number of an effect.

use std::ops::Range;

use rsm_core::source::{Collector, Fault, Source};
use rsm_core::toml_reader::{TableReader, Value};

use crate::quantity::Bound;

/// The key in a plant file.
pub(crate) const KEY: &str = "configurations";

/// The configurations of a plant file, in its order. Empty if the file has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Configurations {
    /// Parameters that have a value of their own in each configuration.
    pub differ: Vec<String>,
    /// The configurations.
    pub list: Vec<Configuration>,
    /// The plant file and the line of the table.
    place: (String, usize),
}

/// One configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Configuration {
    /// Its name.
    pub name: String,
    /// Patterns of the names of its records.
    pub records: Vec<String>,
    /// Values in place of `[parameters]`.
    pub parameters: Vec<(String, f64)>,
    /// Relative standard deviations in place of `[tolerance]`.
    pub tolerance: Vec<(String, f64)>,
    /// The line of its table.
    line: usize,
}

/// The name of a number in a configuration.
#[must_use]
pub fn name_in(number: &str, configuration: &str) -> String {
    format!("{number}[{configuration}]")
}

/// The number and the configuration of such a name. `None` for other names, also for elements of arrays, such as `gear_ratios[3]`.
#[must_use]
pub fn parts(name: &str) -> Option<(&str, &str)> {
    let (number, configuration) = name.strip_suffix(']')?.rsplit_once('[')?;
    configuration.starts_with(|it: char| it.is_ascii_alphabetic()).then_some((number, configuration))
}

/// The name of a number without its configuration.
#[must_use]
pub fn without(name: &str) -> &str {
    parts(name).map_or(name, |it| it.0)
}

/// Whether a name of a file is one of a pattern, in which * stands for any characters.
fn matches(pattern: &str, name: &str) -> bool {
    let Some((before, after)) = pattern.split_once('*') else { return pattern == name };
    let Some(rest) = name.strip_prefix(before) else { return false };
    let ends = rest.char_indices().map(|it| it.0).chain([rest.len()]);
    ends.into_iter().any(|end| matches(after, &rest[end..]))
}

/// The name of a file without its folder.
fn without_folder(path: &str) -> &str {
    path.rsplit_once(['/', '\\']).map_or(path, |it| it.1)
}

impl Configurations {
    /// Whether the plant file has no configurations.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.list.iter().map(|it| it.name.as_str())
    }

    /// The index of a configuration by its name.
    ///
    /// # Errors
    /// An unknown name.
    pub fn of_name(&self, name: &str) -> Result<usize, Fault> {
        let found = self.list.iter().position(|it| it.name == name);
        found.ok_or_else(|| {
            let what = if self.is_empty() {
                format!("found the configuration `{name}`, but the plant file has no [{KEY}]")
            } else {
                format!("found the configuration `{name}`, expected {}", self.listed())
            };
            Fault::at_line(&self.place.0, self.place.1, 0, what)
        })
    }

    /// The index of the configuration of a record; `None` if the plant file has no configurations.
    ///
    /// # Errors
    /// A record of no configuration, or of two.
    pub fn of_record(&self, record: &str) -> Result<Option<usize>, Fault> {
        if self.is_empty() {
            return Ok(None);
        }
        let name = without_folder(record);
        let is_of = |it: &&Configuration| it.records.iter().any(|pattern| matches(pattern, name));
        let mut found = self.list.iter().filter(is_of);
        match (found.next(), found.next()) {
            (Some(one), None) => Ok(self.list.iter().position(|it| it.name == one.name)),
            (Some(one), Some(other)) => {
                let what = format!("the record {record} is of two configurations, `{}` and `{}`", one.name, other.name);
                let help = "change the patterns under `records`: a record has one configuration";
                Err(Fault::at_line(&self.place.0, other.line, 0, what).help(help))
            }
            (None, _) => {
                let patterns = |it: &Configuration| format!("`{}` has {}", it.name, quoted(&it.records));
                let all: Vec<String> = self.list.iter().map(patterns).collect();
                let what = format!("the record {record} is of no configuration");
                Err(Fault::at_line(&self.place.0, self.place.1, 0, what).help(all.join("; ")))
            }
        }
    }

    /// Whether a parameter has a value of its own in a configuration.
    #[must_use]
    pub fn has_own(&self, configuration: usize, parameter: &str) -> bool {
        let is_set = |it: &Configuration| it.parameters.iter().any(|it| it.0 == parameter);
        self.differ.iter().any(|it| it == parameter) || self.list.get(configuration).is_some_and(is_set)
    }

    /// The value of a parameter in a configuration, in place of `nominal`.
    #[must_use]
    pub fn value(&self, configuration: usize, parameter: &str, nominal: f64) -> f64 {
        let own = self.list[configuration].parameters.iter().find(|it| it.0 == parameter);
        own.map_or(nominal, |it| it.1)
    }

    /// The tolerances of the parameters of each configuration: those of `[tolerance]`, with a parameter of its own for each configuration that has
    /// one. A parameter that no configuration takes from `[parameters]` is left out.
    #[must_use]
    pub fn tolerances(&self, common: &[(&str, f64)]) -> Vec<(String, f64)> {
        let mut list: Vec<(String, f64)> = Vec::new();
        for (name, value) in common {
            if self.is_empty() || (0..self.list.len()).any(|place| !self.has_own(place, name)) {
                list.push(((*name).to_string(), *value));
            }
        }
        for (place, it) in self.list.iter().enumerate() {
            let own = it.tolerance.iter().map(|(name, value)| (name.as_str(), *value));
            let inherited = common.iter().filter(|(name, _)| !it.tolerance.iter().any(|own| own.0 == *name)).copied();
            let all = inherited.chain(own).filter(|(name, _)| self.has_own(place, name));
            list.extend(all.map(|(name, value)| (name_in(name, &it.name), value)));
        }
        list
    }

    fn listed(&self) -> String {
        let names: Vec<String> = self.names().map(|it| format!("`{it}`")).collect();
        names.join(", ")
    }
}

fn quoted(list: &[String]) -> String {
    list.iter().map(|it| format!("\"{it}\"")).collect::<Vec<_>>().join(", ")
}

/// A parameter that a configuration may set.
pub(crate) struct Settable {
    pub(crate) name: String,
    pub(crate) bound: Bound,
}

/// The places of a name and of its value.
type Places = (Range<usize>, Range<usize>);

/// The table as it was read, before its names are compared with the plant.
pub(crate) struct Unchecked {
    configurations: Configurations,
    /// The names under `differ`, with their places.
    differ: Vec<(String, Range<usize>)>,
    /// The place of each parameter and of each tolerance of each configuration.
    places: Vec<[Vec<Places>; 2]>,
    span: Range<usize>,
}

/// Reads the table, if the file has it.
pub(crate) fn read(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<Unchecked> {
    let source = top.source();
    let value = top.optional(KEY)?;
    let span = top.key_span(KEY);
    let mut table = TableReader::of(source, value, format!("[{KEY}]"), faults)?;
    let differ = match table.optional("differ") {
        Some(value) => table.texts("`differ`", value, faults).unwrap_or_default(),
        None => Vec::new(),
    };
    let line = |span: &Range<usize>| source.position(span.start).0;
    let mut read = Unchecked {
        configurations: Configurations {
            differ: differ.iter().map(|it| it.0.clone()).collect(),
            list: Vec::new(),
            place: (source.name().to_string(), line(&span)),
        },
        differ,
        places: Vec::new(),
        span,
    };
    for (name, place, value) in table.entries().filter(|it| it.0 != "differ") {
        if !is_name(name) {
            let what = format!("found the name `{name}`, expected a letter, then letters, digits, `_` or `-`");
            faults.push(table.fault(place.clone(), what));
        }
        let who = format!("[{KEY}.{name}]");
        let Some(mut one) = TableReader::of(source, value, who, faults) else { continue };
        let records = one.required("records", faults).and_then(|value| one.texts("`records`", value, faults));
        let [parameters, tolerance] = ["parameters", "tolerance"].map(|key| numbers(&mut one, key, faults));
        one.finish(faults);
        let values = |list: &[Number]| list.iter().map(|it| (it.name.clone(), it.value)).collect();
        read.configurations.list.push(Configuration {
            name: name.to_string(),
            records: records.unwrap_or_default().into_iter().map(|it| it.0).collect(),
            parameters: values(&parameters),
            tolerance: values(&tolerance),
            line: line(&place),
        });
        read.places.push([parameters, tolerance].map(|list| list.into_iter().map(|it| (it.at, it.value_at)).collect()));
    }
    if read.configurations.is_empty() {
        faults.push(
            table.fault(
                read.span.clone(),
                "found no configuration, expected at least one table, such as [configurations.loaded]",
            ),
        );
    }
    Some(read)
}

fn is_name(name: &str) -> bool {
    let is_part = |it: char| it.is_ascii_alphanumeric() || it == '_' || it == '-';
    name.starts_with(|it: char| it.is_ascii_alphabetic()) && name.chars().all(is_part)
}

/// A number with the places of its name and of its value.
struct Number {
    name: String,
    value: f64,
    at: Range<usize>,
    value_at: Range<usize>,
}

fn numbers(table: &mut TableReader<'_>, key: &'static str, faults: &mut Collector) -> Vec<Number> {
    let Some(value) = table.optional(key) else { return Vec::new() };
    let who = format!("{}: `{key}`", table.who());
    let Some(inner) = TableReader::of(table.source(), value, who, faults) else { return Vec::new() };
    let one = |(name, at, value): (&str, Range<usize>, Value<'_>)| {
        let number = inner.number(&format!("`{name}`"), value, faults)?;
        Some(Number { name: name.to_string(), value: number, at, value_at: value.span() })
    };
    inner.entries().filter_map(one).collect()
}

/// The largest number of names in a message.
const LISTED: usize = 20;

impl Unchecked {
    /// Compares the names and values with the plant. `tolerated` has the parameters of `[tolerance]`.
    pub(crate) fn checked(
        self,
        source: &Source,
        settable: &[Settable],
        tolerated: &[&str],
        faults: &mut Collector,
    ) -> Configurations {
        let find = |name: &str| settable.iter().find(|it| it.name == name);
        let unknown = |who: &str, name: &str, place: &Range<usize>| {
            let list: Vec<String> = settable.iter().take(LISTED).map(|it| format!("`{}`", it.name)).collect();
            let more = if settable.len() > LISTED { ", ..." } else { "" };
            let what = format!("{who}: found `{name}`, expected a parameter of the plant that a file may set");
            source.fault(place.clone(), what).help(format!("these are {}{more}", list.join(", ")))
        };
        let who = format!("[{KEY}]: `differ`");
        for (name, place) in &self.differ {
            if find(name).is_none() {
                faults.push(unknown(&who, name, place));
            } else if !tolerated.contains(&name.as_str())
                && !self.configurations.list.iter().all(|it| it.tolerance.iter().any(|own| own.0 == *name))
            {
                let what = format!("{who}: found `{name}`, expected a parameter with a tolerance");
                let help = "give its relative standard deviation under [tolerance]; without one it is the number of the file";
                faults.push(source.fault(place.clone(), what).help(help));
            }
        }
        for (place, (it, [parameters, tolerance])) in self.configurations.list.iter().zip(&self.places).enumerate() {
            let who = format!("[{KEY}.{}]: `parameters`", it.name);
            for ((name, value), (at, value_at)) in it.parameters.iter().zip(parameters) {
                match find(name) {
                    None => faults.push(unknown(&who, name, at)),
                    Some(known) if !known.bound.holds(*value) => {
                        let what = format!("{who}: `{name}`: found {value}, expected {}", known.bound.words());
                        faults.push(source.fault(value_at.clone(), what));
                    }
                    Some(_) => {}
                }
            }
            let who = format!("[{KEY}.{}]: `tolerance`", it.name);
            for ((name, value), (at, value_at)) in it.tolerance.iter().zip(tolerance) {
                if find(name).is_none() {
                    faults.push(unknown(&who, name, at));
                } else if !self.configurations.has_own(place, name) {
                    let what =
                        format!("{who}: found `{name}`, expected a parameter with a value of its own in this configuration");
                    let help = "set it under `parameters` of this configuration, or name it under `differ`";
                    faults.push(source.fault(at.clone(), what).help(help));
                }
                if *value < 0.0 {
                    let what = format!("{who}: `{name}`: found {value}, expected a number of at least 0");
                    faults.push(source.fault(value_at.clone(), what));
                }
            }
        }
        self.configurations
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::toml_reader::parse;

    fn read_text(text: &str) -> Result<Configurations, String> {
        let source = Source::new("plant.toml", text);
        let mut faults = Collector::new();
        let document = parse(&source, &mut faults).unwrap();
        let mut top = TableReader::document(&source, &document);
        let settable = [("mass", Bound::Positive), ("friction", Bound::NotNegative)];
        let settable = settable.map(|(name, bound)| Settable { name: name.to_string(), bound });
        let found = read(&mut top, &mut faults).map(|it| it.checked(&source, &settable, &["friction"], &mut faults));
        faults.finish(found).map_err(|it| it.to_string())
    }

    const TWO: &str = "[configurations]\ndiffer = [\"friction\"]\n[configurations.light]\nrecords = [\"light-*.csv\", \"run7.csv\"]\n\
                       [configurations.heavy]\nrecords = [\"heavy-*.csv\", \"*-7.csv\"]\nparameters = { mass = 120 }\n\
                       tolerance = { mass = 0.05 }\n";

    #[test]
    fn a_star_stands_for_any_characters() {
        let yes = [
            ("a*.csv", "a.csv"),
            ("a*.csv", "ab.csv.csv"),
            ("*", ""),
            ("*7*", "run-7.csv"),
            ("run.csv", "run.csv"),
            ("ü*", "üb"),
        ];
        assert!(yes.iter().all(|(pattern, name)| matches(pattern, name)));
        let no = [("a*.csv", "b.csv"), ("a*.csv", "a.csvx"), ("run.csv", "run.csv2"), ("", "a"), ("*7*", "run")];
        assert!(!no.iter().any(|(pattern, name)| matches(pattern, name)));
    }

    #[test]
    fn a_record_has_the_configuration_whose_pattern_its_name_has() {
        let found = read_text(TWO).unwrap();
        assert_eq!(found.of_record("runs/light-1.csv"), Ok(Some(0)));
        assert_eq!(found.of_record("run7.csv"), Ok(Some(0)));
        assert_eq!(found.of_record("C:\\runs\\heavy-2.csv"), Ok(Some(1)));
        let none = found.of_record("other/run8.csv").unwrap_err();
        assert_eq!((none.line, none.what.as_str()), (1, "the record other/run8.csv is of no configuration"));
        assert!(none.help.unwrap().contains("`heavy` has \"heavy-*.csv\", \"*-7.csv\""));
        let two = found.of_record("light-7.csv").unwrap_err();
        assert_eq!((two.line, two.what.as_str()), (5, "the record light-7.csv is of two configurations, `light` and `heavy`"));
        assert_eq!(Configurations::default().of_record("light-7.csv"), Ok(None));
    }

    #[test]
    fn each_parameter_of_a_configuration_has_its_tolerance() {
        let found = read_text(TWO).unwrap();
        let own =
            [("friction[light]", 0.1), ("friction[heavy]", 0.1), ("mass[heavy]", 0.05)].map(|it| (it.0.to_string(), it.1));
        // All configurations have a friction of their own; the light one has the mass of [parameters].
        let list = found.tolerances(&[("friction", 0.1), ("mass", 0.01)]);
        assert_eq!(list[0], ("mass".to_string(), 0.01));
        assert_eq!(list[1..], own);
        assert_eq!((found.value(1, "mass", 95.0), found.value(0, "mass", 95.0)), (120.0, 95.0));
    }

    #[test]
    fn names_of_numbers_in_configurations_are_no_elements_of_arrays() {
        assert_eq!(parts(&name_in("mass", "heavy")), Some(("mass", "heavy")));
        assert_eq!(parts("gear_ratios[3][heavy]"), Some(("gear_ratios[3]", "heavy")));
        assert_eq!((parts("gear_ratios[3]"), parts("mass"), parts("mass[")), (None, None, None));
        assert_eq!((without("mass[heavy]"), without("gear_ratios[3]")), ("mass", "gear_ratios[3]"));
    }

    #[test]
    fn every_fault_is_reported_with_its_place() {
        let text = "[configurations]\ndiffer = [\"mass\", \"lenght\"]\nx = 1\n[configurations.\"3\"]\nrecords = []\n[configurations.heavy]\n\
                    parameters = { mass = -3, color = 2 }\ntolerance = { friction = -0.1, mass = 0.1 }\nfiles = []\n";
        let faults = read_text(text).unwrap_err();
        for part in [
            "plant.toml:2:11: [configurations]: `differ`: found `mass`, expected a parameter with a tolerance",
            "plant.toml:2:19: [configurations]: `differ`: found `lenght`, expected a parameter of the plant",
            "plant.toml:3:5: [configurations.x]: found the number 1, expected a table",
            "plant.toml:4:17: [configurations]: found the name `3`, expected a letter",
            "plant.toml:6:1: [configurations.heavy]: `records` is missing",
            "plant.toml:7:23: [configurations.heavy]: `parameters`: `mass`: found -3, expected a number above 0",
            "plant.toml:7:27: [configurations.heavy]: `parameters`: found `color`, expected a parameter of the plant",
            "plant.toml:8:15: [configurations.heavy]: `tolerance`: found `friction`, expected a parameter with a value of its own",
            "plant.toml:9:1: [configurations.heavy]: unknown key `files`",
        ] {
            assert!(faults.contains(part), "{part}\n{faults}");
        }
        assert!(read_text("[configurations]\n").unwrap_err().contains("found no configuration"));
    }
}
