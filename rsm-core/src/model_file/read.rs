//! Reads the model file: TOML text to a [`Model`] with positions.
//!
//! In: a source. Out: every part with the right shape, its position, and all faults. [`crate::check`] checks whether the parts fit together.

use toml::de::DeValue;

use super::FORMAT;
use crate::model::{
    Category, Coding, Compensator, Evidence, HalfSpace, Input, Knot, Model, Outside, Scheduled, Sigmoid, Spline, Surface,
    Symmetry, Term, Transform, Wave,
};
use crate::places::Places;
use crate::source::{Collector, Source};
use crate::toml_reader::{self, TableReader, Value};

/// The highest power of one variable. Horner's rule makes a chain of this length, and in f32 x^20 is negligible for |x| below 0.5.
pub const HIGHEST_POWER: u32 = 20;

/// The highest order of a wave in a file. Above it, the formulas of a wave deviate from the cosine by more than 10^-12.
pub const HIGHEST_ORDER: u32 = 1000;

/// A model with the positions in its file.
#[derive(Debug, Default)]
pub struct Located {
    /// All parts with the right shape.
    pub model: Model,
    /// The position of each part by dotted path, such as `inputs.torque.range`.
    pub places: Places,
}

/// Reads a model file. `None` if it is not TOML or has another format; faults go to the collector.
pub fn read(source: &Source, faults: &mut Collector) -> Option<Located> {
    let document = toml_reader::parse(source, faults)?;
    let mut top = TableReader::document(source, &document);
    if !read_format(&mut top, faults) {
        return None;
    }
    let mut places = Places::default();
    let mut model = Model::default();
    if let Some(value) = top.required("model", faults) {
        places.note("model", value.span());
        if let DeValue::String(name) = value.get_ref() {
            model.name = name.to_string();
        } else {
            let found = toml_reader::describe(value.get_ref());
            faults.push(top.fault(value.span(), format!("`model`: found {found}, expected a name")));
            places.refuse("model");
        }
    }
    let section = top.required("inputs", faults);
    places.each_entry(section, ("inputs", "input"), source, faults, |path, name, reader, places, faults| {
        model.inputs.push(read_input(name, path, reader, places, faults)?);
        Some(())
    });
    let section = top.required("surfaces", faults);
    places.each_entry(section, ("surfaces", "surface"), source, faults, |path, name, reader, places, faults| {
        model.surfaces.push(read_surface(name, path, reader, places, faults));
        Some(())
    });
    let section = top.optional("compensators");
    places.each_entry(section, ("compensators", "compensator"), source, faults, |path, name, reader, places, faults| {
        model.compensators.push(read_compensator(name, path, reader, places, faults)?);
        Some(())
    });
    top.finish(faults);
    Some(Located { model, places })
}

/// Checks the format number first. If this version does not support it, nothing else is checked.
pub fn read_format(top: &mut TableReader<'_>, faults: &mut Collector) -> bool {
    let Some(value) = top.required("format", faults) else { return false };
    match value.get_ref() {
        DeValue::Integer(text) if text.as_str().parse() == Ok(FORMAT) => true,
        other => {
            let found = toml_reader::describe(other);
            let fault = top.fault(value.span(), format!("`format`: found {found}, this version reads format {FORMAT}"));
            faults.push(fault);
            false
        }
    }
}

fn read_input(
    name: &str,
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Input> {
    let unit = reader.text("unit", faults);
    let range = reader.required("range", faults).and_then(|value| places.range(path, "range", value, reader, faults));
    let outside = reader.choice("outside", &[("clamp", Outside::Clamp), ("extrapolate", Outside::Extrapolate)], faults);
    Some(Input { name: name.into(), unit: unit?, range: range?, outside: outside.unwrap_or_default() })
}

/// The parts of a surface with the right shape. The others are marked as broken one by one, so that the rules can still check the rest.
fn read_surface(name: &str, path: &str, reader: &mut TableReader<'_>, places: &mut Places, faults: &mut Collector) -> Surface {
    let mut surface = Surface { name: name.into(), ..Surface::default() };
    surface.unit = reader.text("unit", faults).unwrap_or_default();
    let names = reader.required("inputs", faults).and_then(|value| {
        places.note(format!("{path}.inputs"), value.span());
        reader.texts("`inputs`", value, faults)
    });
    for (k, (input, span)) in places.part(path, "inputs", names).unwrap_or_default().into_iter().enumerate() {
        places.note(format!("{path}.inputs.{k}"), span);
        surface.inputs.push(input);
    }
    if let Some(value) = reader.optional("output_range") {
        surface.output_range = places.range(path, "output_range", value, reader, faults);
    }
    let basis = read_basis(path, reader, places, faults);
    if let Some(basis) = places.part(path, "basis", basis) {
        surface.coding = basis.coding;
        surface.symmetry = basis.symmetry;
        surface.knots = basis.knots;
        surface.sigmoids = basis.sigmoids;
        surface.waves = basis.waves;
        surface.reciprocal = basis.reciprocal;
    }
    if let Some(value) = reader.optional("categories") {
        let categories = read_list("`categories`", "category", value, reader, faults, |k, reader, faults| {
            places.note(format!("{path}.categories.{k}"), reader.span());
            let name = reader.text("name", faults);
            let mut list = |key: &'static str| {
                let value = reader.required(key, faults)?;
                let names = reader.texts(&format!("`{key}`"), value, faults)?;
                Some(names.into_iter().map(|(name, _)| name).collect::<Vec<String>>())
            };
            let (levels, inputs) = (list("levels"), list("inputs"));
            let additive = reader.optional_flag("additive", faults);
            Some(Category { name: name?, levels: levels?, inputs: inputs?, additive: additive? })
        });
        surface.categories = places.part(path, "categories", categories).unwrap_or_default();
    }
    let names = Transform::ALL.map(|transform| (transform.word(), transform));
    let transform = read_transform(path, &names, reader, places, faults);
    surface.transform = places.part(path, "transform", transform).unwrap_or_default();
    let terms = match reader.optional("spline") {
        Some(value) => {
            places.note(format!("{path}.spline"), value.span());
            let spline = read_spline(path, value, reader, places, faults);
            surface.spline = places.part(path, "spline", spline);
            reader.optional("terms")
        }
        None => reader.required("terms", faults),
    };
    if let Some(value) = terms {
        places.note(format!("{path}.terms"), value.span());
        let terms = read_list("`terms`", "term", value, reader, faults, |k, reader, faults| {
            places.note(format!("{path}.terms.{k}"), reader.span());
            read_term(reader, faults)
        });
        surface.terms = places.part(path, "terms", terms).unwrap_or_default();
    } else if !places.has(&format!("{path}.spline")) {
        places.refuse(format!("{path}.terms"));
    }
    if let Some(value) = reader.optional("support") {
        let spaces = read_list("`support`", "half-space", value, reader, faults, |k, reader, faults| {
            places.note(format!("{path}.support.{k}"), reader.span());
            let normal = reader.required("normal", faults);
            let normal = normal.and_then(|value| reader.numbers("`normal`", value, faults));
            let bound = reader.required("bound", faults).and_then(|value| reader.number("`bound`", value, faults));
            Some(HalfSpace { normal: normal?, bound: bound? })
        });
        surface.support = spaces.unwrap_or_default();
    }
    if let Some(value) = reader.optional("evidence") {
        match evidence(value.get_ref()) {
            Evidence::Table(entries) => surface.evidence = entries,
            _ => faults.push(reader.fault(value.span(), "`evidence`: expected a table")),
        }
    }
    surface
}

/// Reads `transform`, which is one of these names. `Some(None)` if it is absent; `None` if it has another name, of which there is a fault.
pub fn read_transform<T: Copy>(
    path: &str,
    names: &[(&str, T)],
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<T>> {
    let Some((_, _, value)) = reader.entries().find(|(name, _, _)| *name == "transform") else { return Some(None) };
    places.note(format!("{path}.transform"), value.span());
    reader.choice("transform", names, faults).map(Some)
}

/// The keys that define the variables of a surface's powers; the fit specification has the same.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Basis {
    /// The coding of the variables.
    pub coding: Coding,
    /// Inputs that enter by their magnitude.
    pub symmetry: Vec<(String, Symmetry)>,
    /// Hinges, in the order of the powers.
    pub knots: Vec<Knot>,
    /// Sigmoids, in the order of the powers.
    pub sigmoids: Vec<Sigmoid>,
    /// Waves, in the order of the powers.
    pub waves: Vec<Wave>,
    /// Inputs that enter by their reciprocal.
    pub reciprocal: Vec<String>,
}

/// Reads `coding`, `symmetry`, `knots`, `sigmoids`, `waves` and `reciprocal`. `None` if any has a wrong shape.
pub fn read_basis(path: &str, reader: &mut TableReader<'_>, places: &mut Places, faults: &mut Collector) -> Option<Basis> {
    let mut basis = Basis::default();
    let mut sound = true;
    let codings = [("range", Coding::Range), ("none", Coding::None)];
    if reader.optional("coding").is_some() {
        match reader.choice("coding", &codings, faults) {
            Some(coding) => basis.coding = coding,
            None => sound = false,
        }
    }
    if let Some(value) = reader.optional("symmetry") {
        places.note(format!("{path}.symmetry"), value.span());
        match TableReader::of(reader.source(), value, format!("{}: `symmetry`", reader.who()), faults) {
            None => sound = false,
            Some(entries) => {
                for (input, span, value) in entries.entries() {
                    places.note(format!("{path}.symmetry.{input}"), span);
                    match value.get_ref() {
                        DeValue::String(word) if word == "even" => basis.symmetry.push((input.into(), Symmetry::Even)),
                        DeValue::String(word) if word == "odd" => basis.symmetry.push((input.into(), Symmetry::Odd)),
                        other => {
                            let found = toml_reader::describe(other);
                            let what = format!("`symmetry` of `{input}`: found {found}, expected \"even\" or \"odd\"");
                            faults.push(reader.fault(value.span(), what));
                            sound = false;
                        }
                    }
                }
            }
        }
    }
    if let Some(value) = reader.optional("knots") {
        let knots = read_list("`knots`", "knot", value, reader, faults, |k, reader, faults| {
            places.note(format!("{path}.knots.{k}"), reader.span());
            let input = reader.text("input", faults);
            let at = reader.required("at", faults).and_then(|value| reader.number("`at`", value, faults));
            Some(Knot { input: input?, at: at? })
        });
        sound &= knots.is_some();
        basis.knots = knots.unwrap_or_default();
    }
    if let Some(value) = reader.optional("sigmoids") {
        let sigmoids = read_list("`sigmoids`", "sigmoid", value, reader, faults, |k, reader, faults| {
            places.note(format!("{path}.sigmoids.{k}"), reader.span());
            let input = reader.text("input", faults);
            let at = reader.required("at", faults).and_then(|value| reader.number("`at`", value, faults));
            let width = reader.required("width", faults).and_then(|value| reader.number("`width`", value, faults));
            Some(Sigmoid { input: input?, at: at?, width: width? })
        });
        sound &= sigmoids.is_some();
        basis.sigmoids = sigmoids.unwrap_or_default();
    }
    if let Some(value) = reader.optional("waves") {
        let waves = read_list("`waves`", "wave", value, reader, faults, |k, reader, faults| {
            places.note(format!("{path}.waves.{k}"), reader.span());
            let input = reader.text("input", faults);
            let period = reader.required("period", faults).and_then(|value| reader.number("`period`", value, faults));
            let order = reader.required("order", faults);
            let order = order.and_then(|value| reader.whole("`order`", value, 1, i64::from(HIGHEST_ORDER), faults));
            Some(Wave { input: input?, period: period?, order: order? as u32 })
        });
        sound &= waves.is_some();
        basis.waves = waves.unwrap_or_default();
    }
    if let Some(value) = reader.optional("reciprocal") {
        match reader.texts("`reciprocal`", value, faults) {
            None => sound = false,
            Some(names) => {
                for (k, (input, span)) in names.into_iter().enumerate() {
                    places.note(format!("{path}.reciprocal.{k}"), span);
                    basis.reciprocal.push(input);
                }
            }
        }
    }
    sound.then_some(basis)
}

/// An array of tables, each read by `read`; `None` if any has a wrong shape.
fn read_list<'a, T>(
    what: &str,
    kind: &str,
    value: Value<'a>,
    reader: &TableReader<'a>,
    faults: &mut Collector,
    mut read: impl FnMut(usize, &mut TableReader<'a>, &mut Collector) -> Option<T>,
) -> Option<Vec<T>> {
    let items = reader.array(what, value, faults)?;
    let mut made = Vec::with_capacity(items.len());
    for (k, item) in items.into_iter().enumerate() {
        let who = format!("{}: {kind} {}", reader.who(), k + 1);
        let element = TableReader::of(reader.source(), item, who, faults).and_then(|mut element| {
            let result = read(k, &mut element, faults);
            element.finish(faults);
            result
        });
        made.push(element);
    }
    made.into_iter().collect()
}

/// A spline: its degree, its cells and its coefficients.
fn read_spline<'a>(
    path: &str,
    value: Value<'a>,
    reader: &TableReader<'a>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Spline> {
    let mut table = TableReader::of(reader.source(), value, format!("{}: `spline`", reader.who()), faults)?;
    let degree = table.required("degree", faults).and_then(|value| read_degree(&table, value, faults));
    let cells = table.required("cells", faults).and_then(|value| read_cells(&table, value, faults));
    let coefficients = table.required("coefficients", faults).and_then(|value| {
        places.note(format!("{path}.spline.coefficients"), value.span());
        table.numbers("`coefficients`", value, faults)
    });
    table.finish(faults);
    Some(Spline { degree: degree?, cells: cells?, coefficients: coefficients? })
}

/// The most cells along one input: see docs/decisions/086-splines.md.
pub const MOST_CELLS: u32 = 200;

/// The degree of a spline; the fit specification has the same.
pub fn read_degree<'a>(table: &TableReader<'a>, value: Value<'a>, faults: &mut Collector) -> Option<u32> {
    let degree = table.whole("`degree`", value, 1, 3, faults)?;
    if degree == 2 {
        faults.push(table.fault(value.span(), "`degree`: found 2, expected 1 or 3"));
        return None;
    }
    Some(degree as u32)
}

/// The cells of a spline along each input; the fit specification has the same.
pub fn read_cells<'a>(table: &TableReader<'a>, value: Value<'a>, faults: &mut Collector) -> Option<Vec<u32>> {
    let items = table.array("`cells`", value, faults)?;
    let each: Vec<_> = items.iter().map(|item| table.whole("`cells`", item, 1, i64::from(MOST_CELLS), faults)).collect();
    each.into_iter().map(|cells| cells.map(|cells| cells as u32)).collect()
}

/// Reads a term completely or not at all.
fn read_term(reader: &mut TableReader<'_>, faults: &mut Collector) -> Option<Term> {
    let powers = reader.required("powers", faults).and_then(|value| {
        let items = reader.array("`powers`", value, faults)?;
        let powers: Vec<_> =
            items.iter().map(|item| reader.whole("`powers`", item, 0, i64::from(HIGHEST_POWER), faults)).collect();
        powers.into_iter().map(|power| power.map(|power| power as u32)).collect::<Option<Vec<u32>>>()
    });
    let coefficient = reader.required("coefficient", faults);
    let coefficient = coefficient.and_then(|value| reader.number("`coefficient`", value, faults));
    Some(Term { powers: powers?, coefficient: coefficient? })
}

fn read_compensator(
    name: &str,
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Compensator> {
    let sample_time = reader.required("sample_time", faults);
    let sample_time = sample_time.and_then(|value| {
        places.note(format!("{path}.sample_time"), value.span());
        reader.number("`sample_time`", value, faults)
    });
    let mut scheduled = |key: &'static str, value: Option<Value<'_>>, reader: &TableReader<'_>, faults: &mut Collector| {
        let value = value?;
        places.note(format!("{path}.{key}"), value.span());
        read_scheduled(key, value, reader, faults)
    };
    let mut required = |key| {
        let value = reader.required(key, faults);
        scheduled(key, value, reader, faults)
    };
    let natural_frequency = required("natural_frequency");
    let zero_damping = required("zero_damping");
    let pole_damping = required("pole_damping");
    let own = reader.optional("pole_frequency");
    let has_own = own.is_some();
    let pole_frequency = scheduled("pole_frequency", own, reader, faults);
    if has_own && pole_frequency.is_none() {
        return None;
    }
    Some(Compensator {
        name: name.into(),
        sample_time: sample_time?,
        natural_frequency: natural_frequency?,
        zero_damping: zero_damping?,
        pole_damping: pole_damping?,
        pole_frequency,
    })
}

/// A number, { surface = "name" } or { sum = ["name", ...] }.
fn read_scheduled<'a>(key: &str, value: Value<'a>, reader: &TableReader<'a>, faults: &mut Collector) -> Option<Scheduled> {
    if !matches!(value.get_ref(), DeValue::Table(_)) {
        return reader.number(&format!("`{key}`"), value, faults).map(Scheduled::Fixed);
    }
    let mut table = TableReader::of(reader.source(), value, format!("{}: `{key}`", reader.who()), faults)?;
    let surface = table.optional_text("surface", faults);
    let sum = table.optional("sum").and_then(|value| table.texts("`sum`", value, faults));
    let fault = table.fault(value.span(), "expected a number, { surface = \"name\" } or { sum = [\"name\", \"name\"] }");
    table.finish(faults);
    match (surface, sum) {
        (Some(surface), None) => Some(Scheduled::Surface(surface)),
        (None, Some(names)) if !names.is_empty() => Some(Scheduled::Sum(names.into_iter().map(|(name, _)| name).collect())),
        _ => {
            faults.push(fault);
            None
        }
    }
}

fn evidence(value: &DeValue<'_>) -> Evidence {
    match value {
        DeValue::String(text) => Evidence::Text(text.to_string()),
        DeValue::Boolean(flag) => Evidence::Flag(*flag),
        DeValue::Integer(text) => match i64::from_str_radix(text.as_str(), text.radix()) {
            Ok(whole) => Evidence::Whole(whole),
            Err(_) => Evidence::Text(text.as_str().to_string()),
        },
        DeValue::Float(_) => Evidence::Number(crate::number::from_toml(value).unwrap_or(f64::NAN)),
        DeValue::Datetime(when) => Evidence::Text(when.to_string()),
        DeValue::Array(items) => Evidence::List(items.iter().map(|item| evidence(item.get_ref())).collect()),
        DeValue::Table(table) => {
            Evidence::Table(table.iter().map(|(key, item)| (key.get_ref().to_string(), evidence(item.get_ref()))).collect())
        }
    }
}
