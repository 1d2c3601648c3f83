//! Reads the keys of a fit specification.
//!
//! In: the text. Out: a [`Draft`] of the parts with the right shape, the position of each part, and every fault. [`super::rules`] checks whether the
//! parts fit together.

use std::ops::Range;

use rsm_core::model::{Category, Outside, Surface};
use rsm_core::model_file::{self, HIGHEST_POWER};
use rsm_core::places::Places;
use rsm_core::source::{Collector, Source};
use rsm_core::toml_reader::{self, TableReader, Value, describe};
use toml::de::DeValue;

use crate::missing::Missing;

use super::{
    Criterion, Direction, InputSpec, Loss, Method, ResponseSpec, Search, SearchBy, Split, Validation, Weights, categories,
    shape, transform,
};

/// The parts of the text with the right shape.
pub(super) struct Draft {
    pub model: String,
    pub data: Vec<String>,
    pub validation: Validation,
    pub test: Validation,
    pub missing: Missing,
    pub series: Vec<String>,
    pub blocks: Vec<String>,
    pub categories: Vec<Category>,
    pub inputs: Vec<InputSpec>,
    pub responses: Vec<ResponseSpec>,
    pub places: Places,
}

/// Reads the whole text. `None` if nothing more can be checked; then there is a fault.
pub(super) fn read(source: &Source, faults: &mut Collector) -> Option<Draft> {
    let document = toml_reader::parse(source, faults)?;
    let mut top = TableReader::document(source, &document);
    if !model_file::read_format(&mut top, faults) {
        return None;
    }
    let mut places = Places::default();
    note_key(&mut places, "model", "model", &top);
    let model = top.text("model", faults);
    let data = top.required("data", faults).and_then(|value| {
        places.note("data", value.span());
        files("`data`", value, &top, faults)
    });
    let mut apart = |key: &'static str| match top.optional(key) {
        None => Some(Validation::None),
        Some(value) => {
            places.note(key, value.span());
            read_validation(key, value, &top, &mut places, faults)
        }
    };
    let (validation, test) = (apart("validate"), apart("test"));
    let missing = top.choice("missing", &[("error", Missing::Error), ("drop-row", Missing::DropRow)], faults);
    let mut columns = |key: &'static str| {
        top.optional(key).map_or(Some(Vec::new()), |value| {
            places.note(key, value.span());
            Some(top.texts(&format!("`{key}`"), value, faults)?.into_iter().map(|(name, _)| name).collect())
        })
    };
    let (series, blocks) = (columns("series"), columns("blocks"));
    let mut known = Vec::new();
    let mut inputs = Vec::new();
    let section = top.required("inputs", faults);
    places.each_entry(section, ("inputs", "input"), source, faults, |path, name, reader, places, faults| {
        if let Some(category) = categories::read(path, name, reader, places, faults) {
            let (key, category) = category?;
            inputs.extend(category.inputs.iter().map(|name| InputSpec::contrast(name)));
            known.push((key, category));
            return Some(());
        }
        inputs.push(read_input(path, name, reader, places, faults)?);
        Some(())
    });
    let mut responses = Vec::new();
    let section = top.required("responses", faults);
    places.each_entry(section, ("responses", "response"), source, faults, |path, name, reader, places, faults| {
        responses.push(read_response(path, name, &known, reader, places, faults)?);
        Some(())
    });
    top.finish(faults);
    Some(Draft {
        model: model.unwrap_or_default(),
        data: data.unwrap_or_default(),
        validation: validation.unwrap_or(Validation::None),
        test: test.unwrap_or(Validation::None),
        missing: missing.unwrap_or_default(),
        series: series.unwrap_or_default(),
        blocks: blocks.unwrap_or_default(),
        categories: known.into_iter().map(|(_, category)| category).collect(),
        inputs,
        responses,
        places,
    })
}

/// A list of at least one file.
fn files<'a>(what: &str, value: Value<'a>, reader: &TableReader<'a>, faults: &mut Collector) -> Option<Vec<String>> {
    let names: Vec<String> = reader.texts(what, value, faults)?.into_iter().map(|(name, _)| name).collect();
    if names.is_empty() {
        faults.push(reader.fault(value.span(), format!("{what}: found no file, expected at least one")));
        return None;
    }
    Some(names)
}

fn read_validation<'a>(
    key: &'static str,
    value: Value<'a>,
    top: &TableReader<'a>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Validation> {
    match value.get_ref() {
        DeValue::Array(_) => files(&format!("`{key}`"), value, top, faults).map(Validation::Files),
        DeValue::Table(_) => {
            let mut reader = TableReader::of(top.source(), value, format!("`{key}`"), faults)?;
            let share = reader.required("share", faults).and_then(|value| {
                places.note(format!("{key}.share"), value.span());
                reader.number("`share`", value, faults)
            });
            let seed = reader.required("seed", faults).and_then(|value| reader.whole("`seed`", value, 0, i64::MAX, faults));
            let mut list = |part: &'static str| match reader.optional(part) {
                None => Some(Vec::new()),
                Some(value) => {
                    places.note(format!("{key}.{part}"), value.span());
                    let names = reader.texts(&format!("`{part}`"), value, faults)?;
                    Some(names.into_iter().map(|(name, _)| name).collect())
                }
            };
            let (keep_together, mirror) = (list("keep_together"), list("mirror"));
            reader.finish(faults);
            Some(Validation::Split(Split {
                share: share?,
                seed: seed?.unsigned_abs(),
                keep_together: keep_together?,
                mirror: mirror?,
            }))
        }
        other => {
            let found = describe(other);
            let what = format!("`{key}`: found {found}, expected an array of files or {{ share = 0.3, seed = 7 }}");
            faults.push(top.fault(value.span(), what));
            None
        }
    }
}

fn read_input(
    path: &str,
    name: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<InputSpec> {
    let column = optional_text("column", path, reader, places, faults);
    let unit = optional_text("unit", path, reader, places, faults);
    let range = optional_range("range", path, reader, places, faults);
    let period = read_period(path, reader, places, faults);
    let outside = reader.choice("outside", &[("clamp", Outside::Clamp), ("extrapolate", Outside::Extrapolate)], faults);
    Some(InputSpec {
        name: name.to_string(),
        column: column?.unwrap_or_else(|| name.to_string()),
        unit: unit?,
        range: range?,
        outside: outside.unwrap_or_default(),
        period: period?,
    })
}

/// A number above 0, or a text such as "2*pi", "pi/6". `Some(None)` if absent; `None` if there is a fault.
fn read_period(path: &str, reader: &mut TableReader<'_>, places: &mut Places, faults: &mut Collector) -> Option<Option<f64>> {
    let Some(value) = reader.optional("period") else { return Some(None) };
    let span = value.span();
    places.note(format!("{path}.period"), span.clone());
    let found = match value.get_ref() {
        DeValue::String(text) => multiple_of_pi(text),
        _ => reader.number("`period`", value, faults).map(Some)?,
    };
    let found = found.filter(|period| *period > 0.0 && period.is_finite());
    if found.is_none() {
        let fault = reader.fault(span, "`period`: expected a number above 0, or a text such as \"2*pi\" or \"pi/6\"");
        faults.push(fault.help("in the unit of the input; for a column of turns, 1"));
    }
    found.map(Some)
}

/// `a*pi/b`, where a and b may be omitted.
fn multiple_of_pi(text: &str) -> Option<f64> {
    let text = text.replace(' ', "");
    let (before, after) = text.split_once("pi")?;
    let factor = if before.is_empty() { 1.0 } else { before.strip_suffix('*')?.parse::<f64>().ok()? };
    let divisor = if after.is_empty() { 1.0 } else { after.strip_prefix('/')?.parse::<f64>().ok()? };
    Some(factor * std::f64::consts::PI / divisor)
}

/// `Some(None)` if absent; `None` if there is a fault.
fn optional_text(
    key: &'static str,
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<String>> {
    let stands = note_key(places, format!("{path}.{key}"), key, reader);
    let text = reader.optional_text(key, faults);
    if stands && text.is_none() { None } else { Some(text) }
}

/// `Some(None)` if absent; `None` if there is a fault.
fn optional_range(
    key: &'static str,
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<[f64; 2]>> {
    let Some(value) = reader.optional(key) else { return Some(None) };
    places.range(path, key, value, reader, faults).map(Some)
}

/// Records the position of a key that is read elsewhere. Returns whether it is present.
fn note_key(places: &mut Places, path: impl Into<String>, key: &str, reader: &TableReader<'_>) -> bool {
    let found = reader.entries().find(|(name, _, _)| *name == key);
    if let Some((_, _, value)) = &found {
        places.note(path, value.span());
    }
    found.is_some()
}

fn read_response(
    path: &str,
    name: &str,
    categories: &[(String, Category)],
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<ResponseSpec> {
    let column = optional_text("column", path, reader, places, faults);
    let unit = optional_text("unit", path, reader, places, faults);
    let inputs = reader.required("inputs", faults).and_then(|value| {
        places.note(format!("{path}.inputs"), value.span());
        let names = reader.texts("`inputs`", value, faults)?;
        // The name of a category stands for all its contrasts.
        let all = names.into_iter().flat_map(|(name, span)| {
            let category = categories.iter().find(|(key, _)| *key == name);
            let inputs = category.map_or_else(|| vec![name], |(_, category)| category.inputs.clone());
            inputs.into_iter().map(move |input| (input, span.clone()))
        });
        let note = |(k, (input, span)): (usize, (String, Range<usize>))| {
            places.note(format!("{path}.inputs.{k}"), span);
            input
        };
        Some(all.enumerate().map(note).collect::<Vec<String>>())
    });
    let output_range = optional_range("output_range", path, reader, places, faults);
    let basis = model_file::read_basis(path, reader, places, faults);
    let spline = shape::read_spline(path, reader, places, faults);
    let transform = transform::read(path, reader, places, faults);
    let terms = match reader.optional("terms") {
        None => Some(None),
        Some(value) => {
            places.note(format!("{path}.terms"), value.span());
            read_terms(path, value, reader, places, faults).map(Some)
        }
    };
    let select = reader.required("select", faults).and_then(|value| {
        places.note(format!("{path}.select"), value.span());
        let given = (terms.clone().flatten(), terms.is_none(), !matches!(spline, Some(None)));
        read_select(value, given, path, reader, places, faults)
    });
    let constraints = shape::read_constraints(path, reader, places, faults);
    let support = shape::read_support(path, reader, places, faults);
    let weights = read_weights(path, reader, places, faults);
    let forms = shape::read_forms(path, reader, places, faults);
    note_key(places, format!("{path}.loss"), "loss", reader);
    let losses = [Loss::LeastSquares, Loss::Huber, Loss::L1].map(|loss| (loss.word(), loss));
    let loss = reader.choice("loss", &losses, faults);
    let noise = shape::read_noise(path, reader, places, faults);
    let (unit, basis, inputs) = (unit?, basis?, inputs?);
    let categories =
        categories.iter().map(|(_, category)| category).filter(|category| category.is_in(&inputs)).cloned().collect();
    let surface = Surface {
        name: name.to_string(),
        unit: unit.clone().unwrap_or_default(),
        inputs,
        categories,
        output_range: output_range?,
        coding: basis.coding,
        symmetry: basis.symmetry,
        knots: basis.knots,
        sigmoids: basis.sigmoids,
        waves: basis.waves,
        reciprocal: basis.reciprocal,
        ..Surface::default()
    };
    Some(ResponseSpec {
        column: column?.unwrap_or_else(|| name.to_string()),
        unit,
        surface,
        method: select?,
        weights: weights?,
        loss: loss.unwrap_or_default(),
        noise: noise?,
        constraints: constraints?,
        support: support?,
        forms: forms?,
        spline: spline?,
        transform: transform?,
    })
}

/// `Some(None)` if absent.
fn read_weights(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<Weights>> {
    let Some(value) = reader.optional("weights") else { return Some(None) };
    places.note(format!("{path}.weights"), value.span());
    match value.get_ref() {
        DeValue::String(column) => Some(Some(Weights::Weight(column.to_string()))),
        DeValue::Table(_) => {
            let mut table = TableReader::of(reader.source(), value, format!("{}: `weights`", reader.who()), faults)?;
            let column = table.text("standard_error", faults);
            table.finish(faults);
            Some(Some(Weights::StandardError(column?)))
        }
        other => {
            let found = describe(other);
            let what = format!("`weights`: found {found}, expected the name of a column or {{ standard_error = \"column\" }}");
            faults.push(reader.fault(value.span(), what));
            None
        }
    }
}

fn read_terms<'a>(
    path: &str,
    value: Value<'a>,
    reader: &TableReader<'a>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Vec<Vec<u32>>> {
    let items = reader.array("`terms`", value, faults)?;
    let mut terms = Vec::new();
    for (k, item) in items.into_iter().enumerate() {
        places.note(format!("{path}.terms.{k}"), item.span());
        let what = format!("term {}", k + 1);
        let powers = reader.array(&what, item, faults).map(|powers| {
            let whole = |power: &Value<'a>| {
                let power = reader.whole(&what, power, 0, i64::from(HIGHEST_POWER), faults)?;
                u32::try_from(power).ok()
            };
            powers.iter().map(whole).collect::<Vec<Option<u32>>>()
        });
        terms.push(powers.and_then(|powers| powers.into_iter().collect::<Option<Vec<u32>>>()));
    }
    terms.into_iter().collect()
}

/// `terms`: those of the response, if there are any; `terms_broken`: they have the wrong shape; `has_spline`: a spline takes their place.
fn read_select<'a>(
    value: Value<'a>,
    (terms, terms_broken, has_spline): (Option<Vec<Vec<u32>>>, bool, bool),
    path: &str,
    response: &TableReader<'a>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Method> {
    let mut reader = TableReader::of(response.source(), value, format!("{}: `select`", response.who()), faults)?;
    let method_path = format!("{path}.select.method");
    let is_named = note_key(places, &method_path, "method", &reader);
    // On new rows the LASSO had the smallest error: docs/decisions/062.
    let method = if is_named { reader.text("method", faults)? } else { "lasso".to_string() };
    let method_place = places.place(&method_path);
    let mut order = |key: &'static str, reader: &mut TableReader<'a>, faults: &mut Collector| {
        reader.optional(key).map(|value| {
            places.note(format!("{path}.select.{key}"), value.span());
            let order = reader.whole(&format!("`{key}`"), value, 1, i64::from(HIGHEST_POWER), faults)?;
            u32::try_from(order).ok()
        })
    };
    let selected = match method.as_str() {
        "ladder" => {
            let max_order = order("max_order", &mut reader, faults);
            if max_order.is_none() {
                faults.push(reader.fault(reader.span(), "`max_order` is missing"));
            }
            let max_order = max_order.flatten();
            let confidence = reader.required("confidence", faults).and_then(|value| {
                places.note(format!("{path}.select.confidence"), value.span());
                reader.number("`confidence`", value, faults)
            });
            if terms.is_some() || terms_broken {
                let what = "`terms` is for method \"fixed\" only; \"ladder\" chooses the terms";
                faults.push(response.fault(places.place(&format!("{path}.terms")), what));
            }
            max_order.zip(confidence).map(|(max_order, confidence)| Method::Ladder { max_order, confidence })
        }
        "fixed" => {
            let order = order("order", &mut reader, faults);
            match (terms, order) {
                (Some(terms), None) => Some(Method::Fixed(terms)),
                (None, Some(order)) if !terms_broken => order.map(Method::FixedOrder),
                (None, None) if terms_broken => None,
                (None, None) if has_spline => Some(Method::Fixed(vec![])),
                (None, None) => {
                    let what = "method \"fixed\" needs `terms = [[0, 0], ...]` beside `select`, or `order` in it";
                    faults.push(reader.fault(method_place.clone(), what));
                    None
                }
                _ => {
                    let what = "found both `terms` and `order`, expected one of them";
                    faults.push(reader.fault(places.place(&format!("{path}.select.order")), what));
                    None
                }
            }
        }
        "stepwise" | "best-subset" | "lasso" => {
            let by = match method.as_str() {
                "stepwise" => {
                    let words = [("both", Direction::Both), ("forward", Direction::Forward), ("backward", Direction::Backward)];
                    SearchBy::Stepwise(reader.choice("direction", &words, faults).unwrap_or(Direction::Both))
                }
                "best-subset" => SearchBy::BestSubset,
                _ => SearchBy::Lasso,
            };
            let max_order = order("max_order", &mut reader, faults);
            if max_order.is_none() {
                faults.push(reader.fault(reader.span(), "`max_order` is missing"));
            }
            if terms.is_some() || terms_broken {
                let what = format!("`terms` is for method \"fixed\" only; \"{method}\" chooses the terms");
                faults.push(response.fault(places.place(&format!("{path}.terms")), what));
            }
            let search = read_search(Search::new(by, max_order.flatten().unwrap_or(1)), path, &mut reader, places, faults);
            search.filter(|_| max_order.flatten().is_some()).map(Method::Search)
        }
        other => {
            let fault = reader.fault(method_place.clone(), format!("`method`: \"{other}\" is not a method"));
            faults.push(fault.help("accepted: \"ladder\", \"stepwise\", \"best-subset\", \"lasso\", \"fixed\""));
            // The keys of an unknown method cannot be checked.
            return None;
        }
    };
    reader.finish(faults);
    selected
}

/// Reads the keys of every search.
fn read_search(
    mut search: Search,
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Search> {
    let words = [
        ("k-fold", Criterion::KFold),
        ("held-out", Criterion::HeldOut),
        ("press", Criterion::Press),
        ("aicc", Criterion::Aicc),
    ];
    note_key(places, format!("{path}.select.criterion"), "criterion", reader);
    search.criterion = reader.choice("criterion", &words, faults);
    let mut flag = |key: &'static str| match reader.optional(key) {
        None => Some(false),
        Some(value) => {
            places.note(format!("{path}.select.{key}"), value.span());
            reader.flag(&format!("`{key}`"), value, faults)
        }
    };
    let (heredity, one_standard_error) = (flag("heredity"), flag("one_standard_error"));
    let parts = match reader.optional("parts") {
        None => Some(search.parts),
        Some(value) => {
            places.note(format!("{path}.select.parts"), value.span());
            reader.whole("`parts`", value, 3, 100, faults).and_then(|parts| usize::try_from(parts).ok())
        }
    };
    Some(Search { heredity: heredity?, one_standard_error: one_standard_error?, parts: parts?, ..search })
}
