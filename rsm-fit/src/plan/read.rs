//! Reads the keys of a design specification.
//!
//! In: the text. Out: a [`Draft`] whose parts fit together, and every fault. The format is described in [`super::spec`].

use std::ops::Range;
use std::path::Path;

use rsm_core::model_file;
use rsm_core::names;
use rsm_core::places::Places;
use rsm_core::source::{Collector, Source};
use rsm_core::toml_reader::{self, TableReader, Value, describe};
use toml::de::DeValue;

use super::design::{Condition, Criterion, Design, Factor, MOST_RUNS};
use super::levels;
use super::points::{box_behnken_groups, rotatable_alpha};
use super::read_optimal::{Around, read_fraction, read_optimum, read_support, read_terms};
use super::rules::{MOST_FACTORS, check_names, check_size};
use crate::units;

/// The parts of the text with the right shape.
pub(super) struct Draft {
    pub plan: String,
    pub seed: u64,
    pub design: Design,
    pub factors: Vec<Factor>,
    pub terms: Vec<Vec<u32>>,
    pub replicates: usize,
    pub centre_points: usize,
    pub conditions: Vec<Condition>,
}

/// The values of `design`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    FullFactorial,
    CentralComposite,
    BoxBehnken,
    LatinHypercube,
    Random,
    Sobol,
    FractionalFactorial,
    DefinitiveScreening,
    Optimal,
}

/// The values of `criterion`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Best {
    Optimal(Criterion),
    Maximin,
}

const CRITERIA: [(&str, Best); 4] = [
    ("D", Best::Optimal(Criterion::D)),
    ("I", Best::Optimal(Criterion::I)),
    ("A", Best::Optimal(Criterion::A)),
    ("maximin", Best::Maximin),
];

const KINDS: [(&str, Kind); 9] = [
    ("full-factorial", Kind::FullFactorial),
    ("central-composite", Kind::CentralComposite),
    ("box-behnken", Kind::BoxBehnken),
    ("latin-hypercube", Kind::LatinHypercube),
    ("random", Kind::Random),
    ("sobol", Kind::Sobol),
    ("fractional-factorial", Kind::FractionalFactorial),
    ("definitive-screening", Kind::DefinitiveScreening),
    ("optimal", Kind::Optimal),
];

/// `None` if there is a fault.
pub(super) fn read(source: &Source, folder: &Path, faults: &mut Collector) -> Option<(Draft, Places)> {
    let document = toml_reader::parse(source, faults)?;
    let mut top = TableReader::document(source, &document);
    if !model_file::read_format(&mut top, faults) {
        return None;
    }
    let mut places = Places::default();
    let plan = read_name(&mut top, faults);
    let seed = top.required("seed", faults).and_then(|value| top.whole("`seed`", value, 0, i64::MAX, faults));
    let stands = top.entries().any(|(key, _, _)| key == "design");
    let kind = top.choice("design", &KINDS, faults).or((!stands).then_some(Kind::FullFactorial));
    let runs = read_count(&mut top, "runs", 1, faults);
    let replicates = read_count(&mut top, "replicates", 1, faults);
    let centre_points = read_count(&mut top, "centre_points", 0, faults);
    for key in ["replicates", "centre_points", "design", "runs"] {
        if let Some((_, _, value)) = top.entries().find(|(name, _, _)| *name == key) {
            places.note(key, value.span());
        }
    }
    let criterion = top.choice("criterion", &CRITERIA, faults);
    let alpha = top.optional("alpha");
    let conditions = top.optional("where");
    let blocks = top.optional("blocks");
    let section = top.required("factors", faults);
    let mut factors = Vec::new();
    places.each_entry(section, ("factors", "factor"), source, faults, |path, name, reader, places, faults| {
        factors.push(read_factor(path, name, kind, reader, places, faults)?);
        Some(())
    });
    if section.is_some() && factors.is_empty() && !places.has_broken_under("factors") {
        faults.push(source.fault(places.place("factors"), "`factors`: found none, expected at least one"));
    }
    check_names(&factors, &|path, what| source.fault(places.place(path), what), faults);
    // Names of factors cannot be checked if some factors have faults.
    let all_known = !places.has_broken_under("factors");
    let conditions = match conditions {
        Some(value) if all_known => {
            places.note("where", value.span());
            read_conditions(value, &factors, &top, faults)
        }
        _ => Some(Vec::new()),
    };
    let blocks = match blocks {
        Some(value) if all_known && kind == Some(Kind::FullFactorial) => read_blocks(value, &factors, &top, faults).map(Some),
        _ => Some(None),
    };
    let around = Around { factors: &factors, folder };
    let terms = if all_known { read_terms(&mut top, &around, faults) } else { None };
    let support = if all_known { read_support(&mut top, &around, faults) } else { None };
    let runs_of = runs.flatten();
    let fraction = (kind == Some(Kind::FractionalFactorial) && all_known)
        .then(|| read_fraction(&mut top, runs_of, &around, faults))
        .flatten();
    let of_optimal = match criterion {
        Some(Best::Optimal(criterion)) => criterion,
        _ => Criterion::D,
    };
    let optimum = match (kind, runs_of) {
        (Some(Kind::Optimal), Some(runs)) if all_known => read_optimum(&mut top, runs, of_optimal, &around, faults),
        _ => None,
    };
    for key in ["block_sizes", "mandatory", "candidates", "restarts", "generators"] {
        // A known key: for another design, the fault explains where it belongs.
        let _ = top.optional(key);
    }
    let belongs = |key: &str, to: &[Kind], faults: &mut Collector| {
        let Some(kind) = kind else { return };
        if top.entries().any(|(name, _, _)| name == key) && !to.contains(&kind) {
            let names = to.iter().filter_map(|kind| KINDS.iter().find(|(_, of)| of == kind));
            let mut names: Vec<String> = names.map(|(name, _)| format!("\"{name}\"")).collect();
            if let Some(last) = names.pop_if(|_| to.len() > 1) {
                names = vec![format!("{} and {last}", names.join(", "))];
            }
            let names = names.concat();
            faults.push(top.fault(top.key_span(key), format!("`{key}` belongs to {names} only")));
        }
    };
    belongs("blocks", &[Kind::FullFactorial], faults);
    belongs("alpha", &[Kind::CentralComposite], faults);
    let counted = [Kind::LatinHypercube, Kind::Random, Kind::Sobol, Kind::FractionalFactorial, Kind::Optimal];
    belongs("runs", &counted, faults);
    belongs("generators", &[Kind::FractionalFactorial], faults);
    belongs("criterion", &[Kind::LatinHypercube, Kind::Optimal], faults);
    for key in ["block_sizes", "mandatory", "candidates", "restarts"] {
        belongs(key, &[Kind::Optimal], faults);
    }
    for key in ["replicates", "centre_points"] {
        if kind == Some(Kind::Optimal) && top.entries().any(|(name, _, _)| name == key) {
            let fault = top.fault(top.key_span(key), format!("`{key}` does not belong to \"optimal\": its runs are `runs`"));
            faults.push(fault.help("it repeats points automatically; list required points in `mandatory`"));
        }
    }
    let wrong = match (kind, criterion) {
        (Some(Kind::LatinHypercube), Some(Best::Optimal(_))) => Some("\"maximin\""),
        (Some(Kind::Optimal), Some(Best::Maximin)) => Some("\"D\", \"I\" or \"A\""),
        _ => None,
    };
    if let Some(expected) = wrong {
        faults.push(top.fault(top.key_span("criterion"), format!("`criterion`: of this design expected {expected}")));
    }
    let design = kind.and_then(|kind| {
        let needed = |key: &str, faults: &mut Collector| {
            if !top.entries().any(|(name, _, _)| name == key) {
                let name = KINDS.iter().find(|(_, of)| *of == kind).map_or("", |(name, _)| *name);
                faults.push(top.fault(top.key_span("design"), format!("`{key}` is missing: \"{name}\" needs it")));
            }
        };
        match kind {
            Kind::FullFactorial => {
                let own = || vec![factors.iter().map(|factor| factor.levels.clone()).collect()];
                Some(Design::FullFactorial { blocks: blocks?.unwrap_or_else(own) })
            }
            Kind::CentralComposite => {
                needed("alpha", faults);
                needed("centre_points", faults);
                Some(Design::CentralComposite { alpha: read_alpha(alpha?, factors.len(), &top, faults)? })
            }
            Kind::BoxBehnken => {
                needed("centre_points", faults);
                if all_known && box_behnken_groups(factors.len()).is_none() {
                    let what = format!("\"box-behnken\" has 3 to 7 factors, found {}", factors.len());
                    faults.push(top.fault(top.key_span("design"), what));
                }
                Some(Design::BoxBehnken)
            }
            Kind::LatinHypercube | Kind::Random | Kind::Sobol => {
                needed("runs", faults);
                let runs = runs??;
                Some(match (kind, criterion) {
                    (Kind::Random, _) => Design::Random { runs },
                    (Kind::Sobol, _) => Design::Sobol { runs },
                    (_, Some(Best::Maximin)) => Design::MaximinHypercube { runs },
                    _ => Design::LatinHypercube { runs },
                })
            }
            Kind::FractionalFactorial => fraction.map(Design::FractionalFactorial),
            Kind::DefinitiveScreening => {
                if all_known && !(3..=MOST_FACTORS).contains(&factors.len()) {
                    let what = format!("\"definitive-screening\" has 3 to {MOST_FACTORS} factors, found {}", factors.len());
                    faults.push(top.fault(top.key_span("design"), what));
                    return None;
                }
                Some(Design::DefinitiveScreening)
            }
            Kind::Optimal => {
                needed("runs", faults);
                optimum.map(Design::Optimal)
            }
        }
    });
    top.finish(faults);
    let section = places.place("factors");
    let draft = Draft {
        plan: plan?,
        seed: seed?.unsigned_abs(),
        design: design?,
        replicates: replicates?.unwrap_or(1),
        centre_points: centre_points?.unwrap_or(0),
        conditions: conditions?.into_iter().chain(support?).collect(),
        terms: terms?,
        factors,
    };
    let size = (draft.replicates, draft.centre_points);
    check_size((&draft.design, draft.factors.len()), size, &|_, what| source.fault(section.clone(), what), faults);
    Some((draft, places))
}

/// The name of the plan, an identifier like that of a model.
fn read_name(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<String> {
    let plan = top.text("plan", faults)?;
    if let Some(reason) = names::refuse_model(&plan) {
        let place = top.entries().find(|(name, _, _)| *name == "plan").map_or(0..0, |(_, _, value)| value.span());
        faults.push(top.fault(place, format!("plan name `{plan}` {reason}")));
    }
    Some(plan)
}

/// `Some(None)` if absent; `None` if there is a fault.
fn read_count(top: &mut TableReader<'_>, key: &'static str, least: i64, faults: &mut Collector) -> Option<Option<usize>> {
    let Some(value) = top.optional(key) else { return Some(None) };
    let count = top.whole(&format!("`{key}`"), value, least, MOST_RUNS as i64, faults)?;
    usize::try_from(count).ok().map(Some)
}

fn read_factor(
    path: &str,
    name: &str,
    kind: Option<Kind>,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Factor> {
    let unit = reader.text("unit", faults).inspect(|unit| {
        if let Err(reason) = units::check(unit) {
            let place = reader.entries().find(|(key, _, _)| *key == "unit").map_or(reader.span(), |(_, _, value)| value.span());
            faults.push(reader.fault(place, format!("`unit`: {reason}")));
        }
    });
    let levels = reader.optional("levels");
    let range = reader.optional("range");
    let (levels, range) = match kind? {
        Kind::Optimal if levels.is_some() && range.is_some() => {
            faults.push(reader.fault(reader.key_span("range"), "found `levels` and `range`, expected one of them"));
            return None;
        }
        Kind::Optimal if levels.is_some() => {
            let levels = read_levels("`levels`", levels?, reader, faults)?;
            let least = levels.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (levels, [least, greatest])
        }
        Kind::FullFactorial => {
            if range.is_some() {
                let fault = reader.fault(reader.key_span("range"), "`range` belongs to designs other than \"full-factorial\"");
                faults.push(fault.help("give `levels`"));
            }
            let Some(levels) = levels else {
                faults.push(reader.fault(reader.span(), "`levels` is missing"));
                return None;
            };
            let levels = read_levels("`levels`", levels, reader, faults)?;
            let least = levels.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (levels, [least, greatest])
        }
        _ => {
            if levels.is_some() {
                let fault =
                    reader.fault(reader.key_span("levels"), "`levels` belongs to \"full-factorial\" and \"optimal\" only");
                faults.push(fault.help("give `range = [low, high]`, where the coded -1 and 1 lie"));
            }
            let Some(range) = range else {
                faults.push(reader.fault(reader.span(), "`range` is missing"));
                return None;
            };
            let place = range.span();
            let [low, high] = places.range(path, "range", range, reader, faults)?;
            if low >= high {
                faults.push(reader.fault(place, format!("`range`: low {low} is not below high {high}")));
                return None;
            }
            (Vec::new(), [low, high])
        }
    };
    Some(Factor { name: name.to_string(), unit: unit?, levels, range })
}

/// A list of different numbers, or a table with `from`, `to` and either `step` or `count`.
fn read_levels(what: &str, value: Value<'_>, reader: &TableReader<'_>, faults: &mut Collector) -> Option<Vec<f64>> {
    match value.get_ref() {
        DeValue::Array(_) => {
            let items = reader.array(what, value, faults)?;
            let levels = reader.numbers(what, value, faults)?;
            if levels.is_empty() {
                faults.push(reader.fault(value.span(), format!("{what}: found none, expected at least one")));
                return None;
            }
            for (k, level) in levels.iter().enumerate() {
                if levels[..k].contains(level) {
                    faults.push(reader.fault(items[k].span(), format!("{what}: {level} occurs twice")));
                }
            }
            // + 0.0 makes both zeros equal.
            Some(levels.into_iter().map(|level| level + 0.0).collect())
        }
        DeValue::Table(_) => {
            let who = if reader.who().is_empty() { what.to_string() } else { format!("{}: {what}", reader.who()) };
            let mut table = TableReader::of(reader.source(), value, who, faults)?;
            let mut number = |key: &'static str, faults: &mut Collector| {
                let value = table.required(key, faults)?;
                table.number(&format!("`{key}`"), value, faults)
            };
            let ends = number("from", faults).zip(number("to", faults));
            let step = table.optional("step").map(|value| table.number("`step`", value, faults));
            let count = table.optional("count").map(|value| table.whole("`count`", value, 2, MOST_RUNS as i64, faults));
            let levels = match (step, count) {
                (Some(step), None) => ends.zip(step).and_then(|((from, to), step)| {
                    let levels = levels::stepped(from, to, step, MOST_RUNS);
                    levels.map_err(|reason| faults.push(table.fault(table.span(), reason))).ok()
                }),
                (None, Some(count)) => ends.zip(count).and_then(|((from, to), count)| {
                    if from == to {
                        faults.push(table.fault(table.span(), format!("`from` and `to` are both {from}")));
                        return None;
                    }
                    usize::try_from(count).ok().map(|count| levels::counted(from, to, count))
                }),
                (one, _) => {
                    let found = if one.is_some() { "both" } else { "none" };
                    faults
                        .push(table.fault(table.span(), format!("found {found} of `step` and `count`, expected one of them")));
                    None
                }
            };
            table.finish(faults);
            levels
        }
        other => {
            let found = describe(other);
            let what = format!("{what}: found {found}, expected an array of numbers or {{ from = 0, to = 100, step = 10 }}");
            faults.push(reader.fault(value.span(), what));
            None
        }
    }
}

/// The index of a named factor, or a fault.
fn factor_named(
    who: &str,
    name: &str,
    place: Range<usize>,
    factors: &[Factor],
    top: &TableReader<'_>,
    faults: &mut Collector,
) -> Option<usize> {
    let found = factors.iter().position(|factor| factor.name == name);
    if found.is_none() {
        let known: Vec<String> = factors.iter().map(|factor| format!("`{}`", factor.name)).collect();
        let fault = top.fault(place, format!("{who}: there is no factor `{name}`"));
        faults.push(fault.help(format!("the factors are {}", known.join(", "))));
    }
    found
}

fn read_blocks(
    value: Value<'_>,
    factors: &[Factor],
    top: &TableReader<'_>,
    faults: &mut Collector,
) -> Option<Vec<Vec<Vec<f64>>>> {
    let items = top.array("`blocks`", value, faults)?;
    if items.is_empty() {
        faults.push(top.fault(value.span(), "`blocks`: found none, expected at least one"));
    }
    let mut blocks = Vec::new();
    for (k, item) in items.into_iter().enumerate() {
        let who = format!("block {}", k + 1);
        let reader = TableReader::of(top.source(), item, who.clone(), faults)?;
        let mut levels: Vec<Vec<f64>> = factors.iter().map(|factor| factor.levels.clone()).collect();
        for (name, place, value) in reader.entries() {
            let Some(index) = factor_named(&who, name, place, factors, top, faults) else { continue };
            levels[index] = read_levels(&format!("`{name}`"), value, &reader, faults).unwrap_or_default();
        }
        blocks.push(levels);
    }
    Some(blocks)
}

fn read_conditions(
    value: Value<'_>,
    factors: &[Factor],
    top: &TableReader<'_>,
    faults: &mut Collector,
) -> Option<Vec<Condition>> {
    let mut conditions = Vec::new();
    for (k, item) in top.array("`where`", value, faults)?.into_iter().enumerate() {
        let who = format!("`where`: condition {}", k + 1);
        let mut reader = TableReader::of(top.source(), item, who.clone(), faults)?;
        let mut weights = vec![0.0; factors.len()];
        if let Some(sum) = reader.required("sum", faults)
            && let Some(sum) = TableReader::of(top.source(), sum, format!("{who}: `sum`"), faults)
        {
            for (name, place, value) in sum.entries() {
                let weight = sum.number(&format!("`{name}`"), value, faults);
                if let Some(index) = factor_named(&who, name, place, factors, top, faults) {
                    weights[index] = weight.unwrap_or_default();
                }
            }
        }
        let mut bound = |key: &'static str, faults: &mut Collector| {
            reader.optional(key).map(|value| reader.number(&format!("`{key}`"), value, faults))
        };
        let (at_most, at_least) = (bound("at_most", faults), bound("at_least", faults));
        if at_most.is_none() && at_least.is_none() {
            faults.push(reader.fault(reader.span(), "found neither `at_most` nor `at_least`, expected one of them"));
        }
        reader.finish(faults);
        conditions.push(Condition { weights, at_most: at_most.flatten(), at_least: at_least.flatten() });
    }
    Some(conditions)
}

/// "rotatable", "face-centred" or a positive number.
fn read_alpha(value: Value<'_>, factors: usize, top: &TableReader<'_>, faults: &mut Collector) -> Option<f64> {
    let number = rsm_core::number::from_toml(value.get_ref()).filter(|alpha| *alpha > 0.0 && alpha.is_finite());
    let alpha = match value.get_ref() {
        DeValue::String(word) if word == "rotatable" => Some(rotatable_alpha(factors.min(MOST_FACTORS))),
        DeValue::String(word) if word == "face-centred" => Some(1.0),
        _ => number,
    };
    if alpha.is_none() {
        let found = describe(value.get_ref());
        let what = format!("`alpha`: found {found}, expected \"rotatable\", \"face-centred\" or a number above 0");
        faults.push(top.fault(value.span(), what));
    }
    alpha
}
