//! Reads a plant file and reports every fault in it.
//!
//! In: a [`Source`]. Out: a [`PlantFile`], or every fault with line, column and the accepted names. It never panics, for any text.

use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{TableReader, Value, parse};

use super::{configured, effects_on, first_format, kept, plant_of};
use crate::configurations::{self, Settable, name_in};
use crate::effect::{Arguments, Description, Subject};
use crate::kind::PlantKind;
use crate::plant_file::{Entry, Named, Parameters, PlantFile, Renamed, VelocityFrom};
use crate::schema::{self, Bound, Nominal};

impl PlantFile {
    /// Reads a plant file.
    ///
    /// # Errors
    /// Every fault, in the order of the file.
    pub fn read(source: &Source) -> Result<PlantFile, Faults> {
        let mut faults = Collector::new();
        let Some(document) = parse(source, &mut faults) else { return faults.finish(None) };
        let mut top = TableReader::document(source, &document);
        let file = read(&mut top, &mut faults);
        if file.is_some() {
            top.finish(&mut faults);
        }
        faults.finish(file)
    }
}

fn read(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<PlantFile> {
    if let Some(value) = top.required("format", faults) {
        top.whole("`format`", value, 1, 1, faults);
    }
    // Without the kind, no other name can be checked.
    let kind = required_choice(top, "plant", &first_format::kinds(), faults)?;
    let parameters = top.required("parameters", faults).and_then(|value| parameters(kind, top.source(), value, faults));
    let by_configuration = configurations::read(top, faults);
    let tolerated: Vec<&'static str> = schema::parameters(kind).iter().map(|nominal| nominal.name).collect();
    let outputs: Vec<&'static str> = kind.outputs().iter().map(|signal| signal.name).collect();
    let tolerance = named(top, "tolerance", &tolerated, Bound::NotNegative, faults);
    let common = kind;
    let kind = match by_configuration {
        Some(it) => {
            let settable = schema::parameters(kind).iter();
            let settable = settable.map(|it| Settable { name: it.name.to_string(), bound: it.bound });
            let tolerated: Vec<&str> = tolerance.iter().map(|it| it.0).collect();
            let found = it.checked(top.source(), &settable.collect::<Vec<_>>(), &tolerated, faults);
            PlantKind(configured::kind(kind.0, &found))
        }
        None => kind,
    };
    let tolerance = configured::tolerances(kind.0, &tolerance);
    let noise = named(top, "noise", &outputs, Bound::NotNegative, faults);
    let initial = named(top, "initial", &starts(kind), Bound::Any, faults);
    let effects = entries(kind, top, faults);
    let columns = renamed(kind, top, faults);
    // An incomplete file is checked to its end, and then refused.
    let parameters = parameters.unwrap_or(Parameters {
        kind: common,
        values: vec![None; schema::parameters(common).len()],
        velocity_from: VelocityFrom::State,
    });
    let parameters = configured::parameters(kind, &parameters);
    Some(PlantFile { kind, parameters, tolerance, noise, initial, given: Vec::new(), effects, columns })
}

/// A required choice. The key is read only once, because a list of accepted names must contain it only once.
fn required_choice<T: Copy>(
    table: &mut TableReader<'_>,
    key: &'static str,
    options: &[(&str, T)],
    faults: &mut Collector,
) -> Option<T> {
    let is_there = table.entries().any(|(found, _, _)| found == key);
    if is_there {
        table.choice(key, options, faults)
    } else {
        table.required(key, faults)?;
        None
    }
}

/// A number within its bound.
fn bounded(table: &TableReader<'_>, what: &str, value: Value<'_>, bound: Bound, faults: &mut Collector) -> Option<f64> {
    let text = table.source();
    let number = match rsm_core::number::from_toml(value.get_ref()) {
        Some(number) if number.is_finite() => number,
        Some(number) => {
            faults.push(text.fault(value.span(), format!("{what}: found {number}, expected a finite number")));
            return None;
        }
        None => {
            let found = rsm_core::toml_reader::describe(value.get_ref());
            faults.push(text.fault(value.span(), format!("{what}: found {found}, expected a number")));
            return None;
        }
    };
    if !bound.holds(number) {
        faults.push(text.fault(value.span(), format!("{what}: found {number}, expected {}", bound.words())));
        return None;
    }
    Some(number)
}

fn parameters(kind: PlantKind, source: &Source, value: Value<'_>, faults: &mut Collector) -> Option<Parameters> {
    let mut table = TableReader::of(source, value, "[parameters]", faults)?;
    let mut values = Vec::new();
    for nominal in schema::parameters(kind) {
        if let Some((array, place)) = schema::element(nominal.name) {
            // The array is read with its first element.
            if place == 1 {
                values.extend(elements(kind, &mut table, array, nominal, faults));
            }
            continue;
        }
        let found = if nominal.optional { table.optional(nominal.name) } else { table.required(nominal.name, faults) };
        let what = format!("[parameters]: `{}` [{}]", nominal.name, nominal.unit);
        values.push(found.and_then(|value| bounded(&table, &what, value, nominal.bound, faults)));
    }
    let mut velocity_from = VelocityFrom::State;
    if kind.open_loop.is_some() {
        let options = [("state", VelocityFrom::State), ("difference", VelocityFrom::Difference)];
        velocity_from = table.choice("velocity_from", &options, faults).unwrap_or(VelocityFrom::State);
        gains_come_together(&table, &values, kind, faults);
    }
    table.finish(faults);
    Some(Parameters { kind, values, velocity_from })
}

/// One gain alone is not sufficient for a closed loop.
fn gains_come_together(table: &TableReader<'_>, values: &[Option<f64>], kind: PlantKind, faults: &mut Collector) {
    let has = |name| schema::index(kind, name).is_some_and(|index| values[index].is_some());
    for (given, missing) in [("position_gain", "velocity_gain"), ("velocity_gain", "position_gain")] {
        if has(given) && !has(missing) {
            let what = format!("`{given}` stands alone: the closed loop needs `{missing}` too");
            faults.push(table.fault(table.key_span(given), what));
        }
    }
}

/// The elements of an array of parameters, like `first`; `None` for elements that are missing or wrong.
fn elements(
    kind: PlantKind,
    table: &mut TableReader<'_>,
    array: &'static str,
    first: &Nominal,
    faults: &mut Collector,
) -> Vec<Option<f64>> {
    let count = schema::parameters(kind).iter().filter(|it| schema::element(it.name).is_some_and(|it| it.0 == array)).count();
    let none = vec![None; count];
    let Some(value) = table.required(array, faults) else { return none };
    let Some(items) = table.array(&format!("`{array}`"), value, faults) else { return none };
    if items.len() != count {
        let what = format!("`{array}`: found {} numbers, expected {count}", items.len());
        faults.push(table.fault(value.span(), what));
        return none;
    }
    let what = format!("[parameters]: `{array}` [{}]", first.unit);
    items.into_iter().map(|item| bounded(table, &what, item, first.bound, faults)).collect()
}

/// The names under `[initial]`: outputs, and variables of the start that are neither outputs nor states.
fn starts(kind: PlantKind) -> Vec<&'static str> {
    let outputs = kind.outputs().iter().map(|it| it.name);
    let further = kind.0.start_sizes.iter().map(|it| it.0);
    // A state of a plant with a controller has no column.
    let states = kind.0.free_starts.iter().filter(|it| !kind.start_columns().contains(it)).map(|it| it.name);
    outputs.chain(further).chain(states).collect()
}

/// An optional table of numbers with known names.
fn named(
    top: &mut TableReader<'_>,
    key: &'static str,
    names: &[&'static str],
    bound: Bound,
    faults: &mut Collector,
) -> Vec<Named> {
    let Some(value) = top.optional(key) else { return Vec::new() };
    let Some(mut table) = TableReader::of(top.source(), value, format!("[{key}]"), faults) else { return Vec::new() };
    let mut found = Vec::new();
    for name in names {
        if let Some(value) = table.optional(name) {
            let number = bounded(&table, &format!("[{key}]: `{name}`"), value, bound, faults);
            found.extend(number.map(|number| (*name, number)));
        }
    }
    table.finish(faults);
    found
}

fn entries(kind: PlantKind, top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<Entry> {
    let Some(value) = top.optional("effects") else { return Vec::new() };
    let Some(items) = top.array("`effects`", value, faults) else { return Vec::new() };
    let mut found: Vec<Entry> = Vec::new();
    let mut split = 0.0;
    for item in items {
        let Some(entry) = entry(kind, top.source(), item, faults) else { continue };
        if !kind.configurations.is_empty() && entry.acts_in().is_empty() {
            let what = format!("effect `{}`: it has all of its numbers in no configuration", entry.description.kind);
            let help = "give each number once, or for the same configurations";
            faults.push(top.source().fault(item.span(), what).help(help));
        }
        split += entry.split();
        if split >= 1.0 {
            let what = format!(
                "effect `{}`: with those before it {split} of the inertia is split off, nothing is left at the drive",
                entry.description.kind
            );
            faults.push(top.source().fault(item.span(), what));
        }
        found.extend(configured::entries(kind.0, &entry));
    }
    found
}

fn entry(kind: PlantKind, source: &Source, item: Value<'_>, faults: &mut Collector) -> Option<Entry> {
    let mut table = TableReader::of(source, item, "[[effects]]", faults)?;
    let name = table.text("kind", faults)?;
    let allowed = effects_on(kind);
    let Some(&description) = allowed.iter().find(|description| description.kind == name) else {
        let known = plant_of(kind.0).given.find(&name).is_some();
        let what = if known {
            format!("the effect \"{name}\" cannot stand on the plant \"{}\"", kind.name())
        } else {
            format!("unknown effect \"{name}\"")
        };
        let mut names: Vec<&str> = allowed.iter().map(|description| description.kind).collect();
        names.dedup();
        let names = names.join(", ");
        let span = table.optional("kind").map_or(table.span(), |value| value.span());
        faults.push(table.fault(span, what).help(format!("effects of this plant: {names}")));
        return None;
    };
    let value = table.required("parameters", faults)?;
    let arguments = arguments(kind, description, source, value, faults);
    table.finish(faults);
    let arguments = arguments?;
    // An effect on an output has a description for each output.
    let is_it = |it: &&&Description| it.kind == name && it.at.is_some() && it.at == arguments.subject.as_deref();
    let description = allowed.iter().find(is_it).copied().unwrap_or(description);
    Some(Entry { description, arguments })
}

/// The parameters without those of single configurations.
fn common_parameters(kind: PlantKind) -> Vec<&'static str> {
    let common = kind.common.unwrap_or(kind);
    schema::parameters(common).iter().map(|nominal| nominal.name).collect()
}

fn arguments(
    kind: PlantKind,
    description: &'static Description,
    source: &Source,
    value: Value<'_>,
    faults: &mut Collector,
) -> Option<Arguments> {
    let mut table = TableReader::of(source, value, format!("effect `{}`", description.kind), faults)?;
    let (key, names): (&'static str, Vec<&'static str>) = match description.subject {
        Subject::None | Subject::Site => ("", Vec::new()),
        Subject::Parameter => ("parameter", common_parameters(kind)),
        Subject::Output => ("output", kind.outputs().iter().map(|signal| signal.name).collect()),
    };
    let mut complete = true;
    let mut subject = None;
    if !names.is_empty() {
        let options: Vec<(&str, &'static str)> = names.iter().map(|name| (*name, *name)).collect();
        subject = required_choice(&mut table, key, &options, faults);
        complete &= subject.is_some();
    }
    let mut numbers = Vec::new();
    for argument in description.arguments.iter() {
        let found = if argument.optional { table.optional(argument.name) } else { table.required(argument.name, faults) };
        let Some(value) = found else {
            complete &= argument.optional;
            continue;
        };
        // A parameter with an error must keep the physical bound of the parameter.
        let bound = match (description.subject, subject) {
            (Subject::Parameter, Some(name)) => schema::parameters(kind)
                .iter()
                .find(|nominal| nominal.name == name)
                .map_or(argument.bound, |nominal| nominal.bound),
            _ => argument.bound,
        };
        let what = format!("effect `{}`: `{}`", description.kind, argument.name);
        // A table has a number for each configuration.
        if !kind.configurations.is_empty()
            && value.get_ref().is_table()
            && let Some(each) = TableReader::of(source, value, what.clone(), faults)
        {
            for (name, place, value) in each.entries() {
                if let Err(fault) = kind.configurations.of_name(name) {
                    faults.push(each.fault(place, fault.what));
                }
                match bounded(&table, &format!("{what}: `{name}`"), value, bound, faults) {
                    Some(number) => numbers.push((kept(&name_in(argument.name, name)), number)),
                    None => complete = false,
                }
            }
            continue;
        }
        match bounded(&table, &what, value, bound, faults) {
            Some(number) => numbers.push((argument.name, number)),
            None => complete = false,
        }
    }
    table.finish(faults);
    complete.then_some(Arguments { plant: kind, subject: subject.map(str::to_string), numbers })
}

fn renamed(kind: PlantKind, top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<Renamed> {
    let Some(value) = top.optional("columns") else { return Vec::new() };
    let Some(mut table) = TableReader::of(top.source(), value, "[columns]", faults) else { return Vec::new() };
    let mut found: Vec<Renamed> = Vec::new();
    for signal in kind.columns() {
        let Some(value) = table.optional(signal.name) else { continue };
        let who = format!("[columns]: `{}`", signal.name);
        let Some(mut one) = TableReader::of(top.source(), value, who, faults) else { continue };
        let column = one.text("column", faults);
        let unit = one.optional_text("unit", faults);
        if let Some(unit) = &unit
            && let Err(why) = rsm_fit::units::Conversion::between(unit, signal.unit)
        {
            faults.push(one.fault(one.key_span("unit"), why));
        }
        one.finish(faults);
        found.extend(column.map(|column| Renamed { signal: signal.name, column, unit }));
    }
    table.finish(faults);
    found
}
