//! Reads the keys of a scenario.
//!
//! In: a TOML table, a function that opens files. Out: a [`Scenario`]. One function for each part of the file.

use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_core::toml_reader::{TableReader, Value};
use rsm_fit::plan::{Experiment, Factor as Axis, MOST_RUNS, Plan};
use rsm_model::effects::Catalogue;
use rsm_sim::equation_plant;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::{self, Simulator};

use super::{Diagnosis, Factor, MOST_TASKS, Open, Plant, Points, Scenario, Simulations, Statistic, Work};
use crate::scenario::vary::{self, VaryEntry};

/// The largest seed: every JSON reader represents integers up to this exactly.
const LARGEST_SEED: i64 = (1 << 53) - 1;

/// The opened files, each once.
struct Files<'a> {
    open: &'a Open<'a>,
    opened: RefCell<Vec<(String, String)>>,
}

impl Files<'_> {
    /// Opens a file. Returns its index in the list and its text.
    fn open(&self, name: &str) -> Result<(usize, Source), Faults> {
        let source = (self.open)(name)?;
        let mut opened = self.opened.borrow_mut();
        let place = opened.iter().position(|it| it.0 == name).unwrap_or_else(|| {
            opened.push((name.to_string(), source.text().to_string()));
            opened.len() - 1
        });
        Ok((place, source))
    }

    /// The same for a name in the scenario. A file that cannot be read is a fault at that name.
    fn open_at(
        &self,
        name: &str,
        top: &TableReader<'_>,
        span: &Range<usize>,
        faults: &mut Collector,
    ) -> Option<(usize, Source)> {
        self.open(name).map_err(|found| tell(&found, top, span, faults)).ok()
    }
}

/// Reports the faults of a file at their own positions; a fault of the whole file is reported at its name.
fn tell(found: &Faults, top: &TableReader<'_>, span: &Range<usize>, faults: &mut Collector) {
    for fault in found.list() {
        if fault.line > 0 {
            faults.push(fault.clone());
            continue;
        }
        let here = top.fault(span.clone(), format!("{}: {}", fault.file, fault.what));
        faults.push(Fault { help: fault.help.clone(), ..here });
    }
}

pub(super) fn scenario(top: &mut TableReader<'_>, open: &Open<'_>, faults: &mut Collector) -> Option<Scenario> {
    if let Some(value) = top.required("format", faults) {
        top.whole("`format`", value, 1, 1, faults);
    }
    let name = top.text("sweep", faults);
    let seed = top.optional("seed").map_or(Some(1), |value| top.whole("`seed`", value, 0, LARGEST_SEED, faults));
    let files = Files { open, opened: RefCell::new(Vec::new()) };
    let catalogue = catalogue(top, &files, faults);
    let diagnoses = top.optional("diagnose");
    let work = match diagnoses {
        Some(value) => diagnoses_of(top, value, &files, catalogue.as_ref(), faults).map(Work::Diagnose),
        None => simulations(top, &files, catalogue.as_ref(), seed, faults).map(Work::Simulate),
    };
    Some(Scenario {
        name: name?,
        seed: seed? as u64,
        work: work?,
        source: top.source().clone(),
        files: files.opened.into_inner(),
    })
}

/// The effects for plants of equations, and the files of those that are not part of the project.
struct Effects {
    catalogue: Arc<Catalogue>,
    files: Vec<usize>,
}

fn catalogue(top: &mut TableReader<'_>, files: &Files<'_>, faults: &mut Collector) -> Option<Effects> {
    let mut catalogue = Catalogue::shipped();
    let mut places = Vec::new();
    if let Some(value) = top.optional("effects") {
        let names = top.texts("`effects`", value, faults)?;
        let mut sources = Vec::new();
        for (name, span) in names {
            let (place, source) = files.open_at(&name, top, &span, faults)?;
            places.push(place);
            sources.push(source);
        }
        catalogue.add(&sources).map_err(|found| tell(&found, top, &value.span(), faults)).ok()?;
    }
    Some(Effects { catalogue: Arc::new(catalogue), files: places })
}

/// A plant file of either format, with the files that it consists of.
fn plant(
    (name, span): &(String, Range<usize>),
    top: &TableReader<'_>,
    files: &Files<'_>,
    effects: &Effects,
    faults: &mut Collector,
) -> Option<(PlantFile, Vec<usize>)> {
    let (place, source) = files.open_at(name, top, span, faults)?;
    if rsm_sim::equations::file::format(&source) != Some(2) {
        let plant = PlantFile::read(&source).map_err(|found| tell(&found, top, span, faults)).ok()?;
        return Some((plant, vec![place]));
    }
    let places = RefCell::new(vec![place]);
    let folder = name.rsplit_once('/').map_or(String::new(), |it| format!("{}/", it.0));
    let open = |file: &str| {
        let (place, source) = files.open(&format!("{folder}{file}"))?;
        places.borrow_mut().push(place);
        Ok(source)
    };
    let plant = equation_plant::read_with(&source, &open, &effects.catalogue);
    let plant = plant.map_err(|found| tell(&found, top, span, faults)).ok()?;
    let mut places = places.into_inner();
    places.extend(&effects.files);
    Some((plant, places))
}

/// A record of a plant, under its name in the scenario, so that results do not depend on the folder.
fn record(
    (name, span): &(String, Range<usize>),
    plant: &PlantFile,
    gaps: bool,
    top: &TableReader<'_>,
    files: &Files<'_>,
    faults: &mut Collector,
) -> Option<(Record, usize)> {
    let (place, source) = files.open_at(name, top, span, faults)?;
    let record = if gaps { Record::read_with_gaps(&source, plant) } else { Record::read(&source, plant) };
    let mut record = record.map_err(|found| tell(&found, top, span, faults)).ok()?;
    record.file.clone_from(name);
    Some((record, place))
}

/// A required list of names without duplicates, not empty.
fn names(
    top: &mut TableReader<'_>,
    key: &'static str,
    required: bool,
    faults: &mut Collector,
) -> Option<Vec<(String, Range<usize>)>> {
    let value = if required { top.required(key, faults)? } else { top.optional(key)? };
    let names = top.texts(&format!("`{key}`"), value, faults)?;
    if names.is_empty() {
        faults.push(top.fault(value.span(), format!("`{key}`: found none, expected at least one")));
        return None;
    }
    for (k, (name, span)) in names.iter().enumerate() {
        if names[..k].iter().any(|it| it.0 == *name) {
            faults.push(top.fault(span.clone(), format!("`{key}`: \"{name}\" occurs twice")));
        }
    }
    Some(names)
}

fn flag(top: &mut TableReader<'_>, key: &'static str, faults: &mut Collector) -> Option<bool> {
    use toml::de::DeValue;
    let Some(value) = top.optional(key) else { return Some(false) };
    match value.get_ref() {
        DeValue::Boolean(flag) => Some(*flag),
        other => {
            let found = rsm_core::toml_reader::describe(other);
            faults.push(top.fault(value.span(), format!("`{key}`: found {found}, expected true or false")));
            None
        }
    }
}

fn simulations(
    top: &mut TableReader<'_>,
    files: &Files<'_>,
    effects: Option<&Effects>,
    seed: Option<i64>,
    faults: &mut Collector,
) -> Option<Simulations> {
    let plant_names = names(top, "plants", true, faults);
    let record_names = names(top, "records", true, faults);
    let noise = flag(top, "noise", faults);
    let whole_records = flag(top, "whole_records", faults);
    let repeats = top.optional("repeats").map_or(Some(1), |value| {
        let found = top.whole("`repeats`", value, 1, MOST_TASKS as i64, faults)?;
        if found > 1 && noise == Some(false) {
            let what = "`repeats`: without `noise = true` every repeat is the same run";
            faults.push(top.fault(value.span(), what));
        }
        Some(found)
    });
    let vary_entries = vary::vary_entries(top, faults);
    let plan = plan(top, files, faults);
    let points = points(top, vary_entries.as_deref(), plan.as_ref().map(Option::is_some), seed, faults);
    let outputs = outputs(top, faults);
    // The following parts read other files. Stop here, so that a fault of the scenario is not reported twice.
    let (effects, plan, vary_entries) = (effects?, plan?, vary_entries?);
    let (points, asked) = points?;
    vary::plan_and_factors(top, &vary_entries, plan.as_ref(), faults);
    let settings = plan.as_ref().map_or(asked, |it| it.runs.len());
    let mut plants: Vec<Plant> = Vec::new();
    let (plant_names, record_names) = (plant_names?, record_names?);
    for named in &plant_names {
        let Some((file, places)) = plant(named, top, files, effects, faults) else { continue };
        if noise == Some(true) && file.noise.is_empty() {
            faults.push(top.fault(top.key_span("noise"), format!("`noise`: {} has no table [noise]", named.0)));
        }
        let found =
            vary_entries.iter().filter_map(|vary_entry| vary::place(vary_entry, &file, &named.0, plan.as_ref(), top, faults));
        let of_factors: Vec<_> = found.collect();
        let mut records = Vec::new();
        for of_record in &record_names {
            let Some((record, _)) = record(of_record, &file, false, top, files, faults) else { continue };
            if let Err(found) = Simulator::new(&file, &record) {
                tell(&found, top, &of_record.1, faults);
            }
            check_outputs(&outputs, &file, &record, (&named.0, &of_record.0), top, faults);
            records.push(record);
        }
        plants.push(Plant { name: named.0.clone(), file, records, places: of_factors, files: places });
    }
    let repeats = repeats? as usize;
    let count = settings.saturating_mul(repeats).saturating_mul(plant_names.len()).saturating_mul(record_names.len());
    if count > MOST_TASKS {
        let what = format!("the list has {count} tasks, at most {MOST_TASKS} are accepted");
        faults.push(top.fault(top.key_span("sweep"), what));
    }
    let factors = vary_entries.into_iter().map(|it| Factor { name: it.name, who: it.who, span: it.span }).collect();
    let outputs = outputs.into_iter().map(|it| (it.name, it.statistics)).collect();
    let records = record_names.into_iter().map(|it| it.0).collect();
    Some(Simulations {
        plants,
        records,
        factors,
        points,
        settings,
        noise: noise?,
        repeats,
        outputs,
        whole_records: whole_records?,
    })
}

/// The plan, if the file refers to one.
fn plan(top: &mut TableReader<'_>, files: &Files<'_>, faults: &mut Collector) -> Option<Option<Plan>> {
    let Some(value) = top.optional("plan") else { return Some(None) };
    let name = top.optional_text("plan", faults)?;
    let (_, source) = files.open_at(&name, top, &value.span(), faults)?;
    Plan::read(&source).map_err(|found| tell(&found, top, &value.span(), faults)).ok().map(Some)
}

/// The designs of shares.
#[derive(Clone, Copy, PartialEq)]
enum Shape {
    Random,
    LatinHypercube,
    Sobol,
    FullFactorial,
}

/// The shares of every setting, and the number of settings.
fn points(
    top: &mut TableReader<'_>,
    vary_entries: Option<&[VaryEntry]>,
    has_plan: Option<bool>,
    seed: Option<i64>,
    faults: &mut Collector,
) -> Option<(Points, usize)> {
    let shapes = [
        ("random", Shape::Random),
        ("latin-hypercube", Shape::LatinHypercube),
        ("sobol", Shape::Sobol),
        ("full-factorial", Shape::FullFactorial),
    ];
    let has_design = top.optional("design").is_some();
    let shape = if has_design { top.choice("design", &shapes, faults)? } else { Shape::Random };
    let runs = top.optional("runs");
    let (vary_entries, has_plan) = (vary_entries?, has_plan?);
    let forbidden = |key: &'static str, why: &str| top.fault(top.key_span(key), format!("`{key}`: {why}"));
    let by_itself = if has_plan {
        Some("not accepted together with `plan`, which lists the settings")
    } else if vary_entries.is_empty() {
        Some("not accepted without [[vary]]: every run would be the same; use `repeats` with `noise = true` for several runs")
    } else if shape == Shape::FullFactorial {
        Some("not accepted with \"full-factorial\", which has one run for each combination of the lists")
    } else {
        None
    };
    if let (Some(why), true) = (by_itself, runs.is_some()) {
        faults.push(forbidden("runs", why));
        return None;
    }
    if let (Some(why), true) = (by_itself, has_design && shape != Shape::FullFactorial) {
        faults.push(forbidden("design", why));
        return None;
    }
    if has_design && (has_plan || vary_entries.is_empty()) {
        faults.push(forbidden(
            "design",
            "not accepted together with `plan`, nor without [[vary]]: there are no settings to choose",
        ));
        return None;
    }
    if by_itself.is_some() && shape != Shape::FullFactorial {
        return Some((Points::Random, 1));
    }
    let mut axes = Vec::new();
    for (k, vary_entry) in vary_entries.iter().enumerate() {
        let name = format!("factor_{}", k + 1);
        match (shape, vary_entry.levels()) {
            (Shape::FullFactorial, Some(count)) => {
                // The midpoints of equal intervals: the shares of the list's values.
                let shares: Vec<f64> = (0..count).map(|level| (level as f64 + 0.5) / count as f64).collect();
                axes.push(Axis::at(name, "1", shares));
            }
            (Shape::FullFactorial, None) => {
                let what = format!("{}: a full factorial needs `distribution = \"list\"` for every number", vary_entry.who);
                faults.push(top.fault(vary_entry.span.clone(), what));
                return None;
            }
            _ => axes.push(Axis::within(name, "1", [0.0, 1.0])),
        }
    }
    let most = if shape == Shape::Random { MOST_TASKS } else { MOST_RUNS };
    let asked = match (shape, runs) {
        (Shape::FullFactorial, _) => 0,
        (_, Some(value)) => top.whole("`runs`", value, 1, most as i64, faults)? as usize,
        (_, None) => {
            top.required("runs", faults);
            return None;
        }
    };
    let experiment = match shape {
        Shape::Random => return Some((Points::Random, asked)),
        Shape::LatinHypercube => Experiment::latin_hypercube(axes, asked),
        Shape::Sobol => Experiment::sobol(axes, asked),
        Shape::FullFactorial => Experiment::full_factorial(axes),
    };
    match experiment.seed(seed? as u64).plan() {
        Ok(plan) => {
            let settings = plan.runs.len();
            let of = |run: usize| plan.factors.iter().map(|it| it.values[run]).collect();
            Some((Points::Design((0..settings).map(of).collect()), settings))
        }
        Err(found) => {
            tell(&found, top, &top.key_span("design"), faults);
            None
        }
    }
}

/// The figures of an output, with their position in the file.
struct Wanted {
    name: String,
    statistics: Vec<Statistic>,
    span: Range<usize>,
}

fn outputs(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<Wanted> {
    let mut wanted = Vec::new();
    let Some(value) = top.required("outputs", faults) else { return wanted };
    let Some(table) = TableReader::of(top.source(), value, "`outputs`", faults) else { return wanted };
    for (name, span, value) in table.entries() {
        let Some(words) = table.texts(&format!("`{name}`"), value, faults) else { continue };
        let mut statistics = Vec::new();
        for (word, span) in words {
            match Statistic::ALL.iter().find(|it| it.0 == word) {
                Some((_, it)) if statistics.contains(it) => {
                    faults.push(table.fault(span, format!("`{name}`: \"{word}\" occurs twice")));
                }
                Some((_, it)) => statistics.push(*it),
                None => {
                    let known = Statistic::ALL.map(|it| format!("\"{}\"", it.0)).join(", ");
                    faults.push(table.fault(span, format!("`{name}`: found \"{word}\", expected one of {known}")));
                }
            }
        }
        wanted.push(Wanted { name: name.to_string(), statistics, span });
    }
    if table.entries().next().is_none() {
        faults.push(top.fault(value.span(), "`outputs`: found none, expected at least one"));
    }
    wanted
}

/// Checks that a plant along a record has the requested outputs.
fn check_outputs(
    outputs: &[Wanted],
    plant: &PlantFile,
    record: &Record,
    (plant_name, record_name): (&str, &str),
    top: &TableReader<'_>,
    faults: &mut Collector,
) {
    let shown = simulate::shown(plant.kind, record);
    for wanted in outputs {
        let who = format!("`outputs`: `{}`", wanted.name);
        if !shown.iter().any(|it| it.name == wanted.name) {
            let known: Vec<String> = shown.iter().map(|it| format!("`{}`", it.name)).collect();
            let what = format!("{who}: {plant_name} along {record_name} has no such output");
            faults.push(top.fault(wanted.span.clone(), what).help(format!("it has {}", known.join(", "))));
            continue;
        }
        let measured = plant.kind.output(&wanted.name).and_then(|place| record.measured[place].as_ref());
        if wanted.statistics.contains(&Statistic::Rmse) && measured.is_none() {
            let what = format!("{who}: \"rmse\" needs a measured column of this name, and {record_name} has none");
            faults.push(top.fault(wanted.span.clone(), what));
        }
    }
}

fn diagnoses_of(
    top: &TableReader<'_>,
    value: Value<'_>,
    files: &Files<'_>,
    effects: Option<&Effects>,
    faults: &mut Collector,
) -> Option<Vec<Diagnosis>> {
    let items = top.array("`diagnose`", value, faults)?;
    let effects = effects?;
    if items.is_empty() {
        faults.push(top.fault(value.span(), "`diagnose`: found none, expected at least one"));
    }
    let mut found: Vec<Diagnosis> = Vec::new();
    for (k, item) in items.into_iter().enumerate() {
        let Some(mut table) = TableReader::of(top.source(), item, "[[diagnose]]", faults) else { continue };
        let name = table.optional_text("name", faults).unwrap_or_else(|| (k + 1).to_string());
        if found.iter().any(|it| it.name == name) {
            faults.push(table.fault(table.key_span("name"), format!("`name`: \"{name}\" occurs twice")));
        }
        let plant_span = table.optional("plant").map_or(table.span(), |value| value.span());
        let plant_name = table.text("plant", faults);
        let lists = ["records", "validate", "test"].map(|key| names(&mut table, key, key == "records", faults));
        table.finish(faults);
        let Some(plant_name) = plant_name else { continue };
        let named = (plant_name.clone(), plant_span);
        let Some((file, of_plant)) = plant(&named, top, files, effects, faults) else { continue };
        let mut records: [Vec<Record>; 3] = Default::default();
        let mut places = [of_plant, Vec::new(), Vec::new(), Vec::new()];
        for (role, list) in lists.into_iter().enumerate() {
            for named in list.into_iter().flatten() {
                let Some((record, place)) = record(&named, &file, true, top, files, faults) else { continue };
                records[role].push(record);
                places[role + 1].push(place);
            }
        }
        found.push(Diagnosis { name, plant_name, plant: file, records, files: places });
    }
    Some(found)
}
