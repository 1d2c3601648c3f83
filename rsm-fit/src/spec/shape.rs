//! The keys `constraints` and `support` of a response.
//!
//! In: the table of a response. Out: [`Constraint`]s and a [`SupportSpec`] of the right shape; then, with the response, faults if they do not fit it.
//! Data are not used.

use rsm_core::model::{Coding, Input, Symmetry};
use rsm_core::model_file;
use rsm_core::places::Places;
use rsm_core::source::Collector;
use rsm_core::toml_reader::{TableReader, Value, describe};
use toml::de::DeValue;

use super::{Form, Loss, Method, NoiseOrder, ResponseSpec, Specification, SplineSpec};

/// The default number of half-spaces of a support: those of a box and of four cut corners.
pub(crate) const FACES: usize = 8;

/// The largest number. With more half-spaces the support test costs more than the surface.
pub(crate) const MOST_FACES: usize = 32;

/// A constraint over the whole supported region.
#[derive(Debug, Clone, PartialEq)]
pub enum Constraint {
    /// The response is between two values.
    Bounds {
        /// The lower bound,
        min: Option<f64>,
        /// and the upper bound.
        max: Option<f64>,
    },
    /// The response is monotone in an input.
    Monotone {
        /// The input.
        input: String,
        /// True if the response must not decrease, false if it must not increase.
        increasing: bool,
    },
    /// The response is convex in all inputs together,
    Convex,
    /// or concave.
    Concave,
}

impl Constraint {
    /// A fault that does not depend on the response, for files and for fits in memory.
    pub(crate) fn fault(&self) -> Option<String> {
        match self {
            Constraint::Bounds { min: None, max: None } => {
                Some("found neither `min` nor `max`, expected one of them".to_string())
            }
            Constraint::Bounds { min: Some(min), max: Some(max) } if min >= max => {
                Some(format!("`min` {min} is not below `max` {max}"))
            }
            _ => None,
        }
    }
}

impl std::fmt::Display for Constraint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Constraint::Bounds { min, max } => {
                let word = |name: &str, value: &Option<f64>| value.map(|value| format!("{name} {value}"));
                let words: Vec<String> = word("min", min).into_iter().chain(word("max", max)).collect();
                write!(f, "bounds {}", words.join(" "))
            }
            Constraint::Monotone { input, increasing } => {
                write!(f, "monotone {input} {}", if *increasing { "increasing" } else { "decreasing" })
            }
            Constraint::Convex => write!(f, "convex"),
            Constraint::Concave => write!(f, "concave"),
        }
    }
}

/// A support from the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportSpec {
    /// The margin beyond the data, in coded units.
    pub margin: f64,
    /// The largest number of half-spaces, for two inputs.
    pub faces: usize,
}

/// Reads `constraints`; empty if the key is absent.
pub(super) fn read_constraints(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Vec<Constraint>> {
    let Some(value) = reader.optional("constraints") else { return Some(Vec::new()) };
    places.note(format!("{path}.constraints"), value.span());
    let mut constraints = Vec::new();
    for (k, item) in reader.array("`constraints`", value, faults)?.into_iter().enumerate() {
        places.note(format!("{path}.constraints.{k}"), item.span());
        let who = format!("{}: constraint {}", reader.who(), k + 1);
        let table = TableReader::of(reader.source(), item, who, faults);
        constraints.push(table.and_then(|mut table| read_constraint(&mut table, faults).inspect(|_| table.finish(faults))));
    }
    constraints.into_iter().collect()
}

fn read_constraint(reader: &mut TableReader<'_>, faults: &mut Collector) -> Option<Constraint> {
    let Some(value) = reader.optional("kind") else {
        faults.push(reader.fault(reader.span(), "`kind` is missing").help(KINDS));
        return None;
    };
    match value.get_ref() {
        DeValue::String(word) if word == "bounds" => {
            let mut bound = |key: &'static str, faults: &mut Collector| match reader.optional(key) {
                None => Some(None),
                Some(value) => reader.number(&format!("`{key}`"), value, faults).map(Some),
            };
            let (min, max) = (bound("min", faults), bound("max", faults));
            let constraint = Constraint::Bounds { min: min?, max: max? };
            if let Some(what) = constraint.fault() {
                faults.push(reader.fault(reader.span(), what));
            }
            Some(constraint)
        }
        DeValue::String(word) if word == "monotone" => {
            let input = reader.text("input", faults);
            let directions = [("increasing", true), ("decreasing", false)];
            let increasing = required_choice("direction", &directions, reader, faults);
            Some(Constraint::Monotone { input: input?, increasing: increasing? })
        }
        DeValue::String(word) if word == "convex" => Some(Constraint::Convex),
        DeValue::String(word) if word == "concave" => Some(Constraint::Concave),
        other => {
            let what = format!("`kind`: found {}", describe(other));
            faults.push(reader.fault(value.span(), what).help(KINDS));
            None
        }
    }
}

/// A required choice among fixed words.
fn required_choice<T: Copy>(
    key: &'static str,
    options: &[(&str, T)],
    reader: &mut TableReader<'_>,
    faults: &mut Collector,
) -> Option<T> {
    if !reader.entries().any(|(name, _, _)| name == key) {
        faults.push(reader.fault(reader.span(), format!("`{key}` is missing")));
    }
    reader.choice(key, options, faults)
}

const KINDS: &str = "accepted: \"bounds\", \"monotone\", \"convex\", \"concave\"";

/// Reads `forms`. `Some(None)` if absent.
pub(super) fn read_forms(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<Vec<Form>>> {
    let Some(value) = reader.optional("forms") else { return Some(None) };
    let span = value.span();
    places.note(format!("{path}.forms"), span.clone());
    let mut forms = Vec::new();
    for (word, span) in reader.texts("`forms`", value, faults)? {
        match word.as_str() {
            "polynomial" => forms.push(Form::Polynomial),
            "sigmoid" => forms.push(Form::Sigmoid),
            "wave" => forms.push(Form::Wave),
            "spline" => forms.push(Form::Spline),
            "hinge" => forms.push(Form::Hinge),
            other => {
                let fault = reader.fault(span, format!("`forms`: found \"{other}\""));
                faults.push(fault.help("accepted: \"polynomial\", \"sigmoid\", \"wave\", \"spline\", \"hinge\""));
                return None;
            }
        }
    }
    if forms.is_empty() {
        faults.push(reader.fault(span, "`forms`: found none, expected at least one"));
        return None;
    }
    Some(Some(forms))
}

/// Reads `noise`. `Some(None)` if absent.
pub(super) fn read_noise(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<NoiseOrder>> {
    let Some(value) = reader.optional("noise") else { return Some(None) };
    let span = value.span();
    places.note(format!("{path}.noise"), span.clone());
    match value.get_ref() {
        DeValue::String(word) if word == "autoregressive" => Some(Some(NoiseOrder::DEFAULT)),
        DeValue::Table(_) => {
            let mut table = TableReader::of(reader.source(), value, format!("{}: `noise`", reader.who()), faults)?;
            let mut whole = |key: &'static str, least: i64| {
                table.optional(key).map(|value| {
                    let found = table.whole(&format!("`{key}`"), value, least, NoiseOrder::MOST as i64, faults);
                    found.and_then(|found| usize::try_from(found).ok())
                })
            };
            let (order, most) = (whole("order", 1), whole("max_order", 1));
            table.finish(faults);
            match (order, most) {
                (Some(order), None) => order.map(|order| Some(NoiseOrder::Given(order))),
                (None, Some(most)) => most.map(|most| Some(NoiseOrder::UpTo(most))),
                _ => {
                    faults.push(reader.fault(span, "`noise`: expected one of `order` and `max_order`"));
                    None
                }
            }
        }
        other => {
            let what = format!(
                "`noise`: found {}, expected \"autoregressive\", {{ order = 2 }} or {{ max_order = 8 }}",
                describe(other)
            );
            faults.push(reader.fault(span, what));
            None
        }
    }
}

/// Reads `spline`. `Some(None)` if absent.
pub(super) fn read_spline(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<SplineSpec>> {
    let Some(value) = reader.optional("spline") else { return Some(None) };
    places.note(format!("{path}.spline"), value.span());
    let mut table = TableReader::of(reader.source(), value, format!("{}: `spline`", reader.who()), faults)?;
    let degree = match table.optional("degree") {
        None => Some(SplineSpec::default().degree),
        Some(value) => model_file::read_degree(&table, value, faults),
    };
    let cells = match table.optional("cells") {
        None => Some(None),
        Some(value) => model_file::read_cells(&table, value, faults).map(Some),
    };
    let penalty = match table.optional("penalty") {
        None => Some(None),
        Some(value) => table.number("`penalty`", value, faults).map(Some),
    };
    table.finish(faults);
    Some(Some(SplineSpec { degree: degree?, cells: cells?, penalty: penalty? }))
}

/// The smallest and the largest accepted penalty: far below and above what cross-validation tries.
const PENALTIES: [f64; 2] = [1e-9, 1e6];

/// A spline is the whole surface: of few inputs that clamp, without other forms and without proofs of constraints.
fn check_spline(specification: &Specification, response: &ResponseSpec, faults: &mut Collector) {
    let is_form = response.forms.as_ref().is_some_and(|forms| forms.contains(&Form::Spline));
    if response.spline.is_none() && !is_form {
        return;
    }
    let surface = &response.surface;
    let key = if response.spline.is_some() { "spline" } else { "forms" };
    let mut refuse = |what: String, help: &str| {
        let place = format!("responses.{}.{key}", surface.name);
        faults.push(specification.fault(&place, format!("response `{}`: `{key}`: {what}", surface.name)).help(help));
    };
    let others = [
        ("symmetry", !surface.symmetry.is_empty()),
        ("knots", !surface.knots.is_empty()),
        ("sigmoids", !surface.sigmoids.is_empty()),
        ("waves", !surface.waves.is_empty()),
        ("reciprocal", !surface.reciprocal.is_empty()),
        ("coding", surface.coding != Coding::default()),
        ("constraints", !response.constraints.is_empty()),
        ("loss", response.loss != Loss::LeastSquares),
        ("noise", response.noise.is_some()),
        ("forms", response.spline.is_some() && response.forms.is_some()),
    ];
    for (other, _) in others.iter().filter(|(_, is_there)| *is_there) {
        let help = "a spline is the whole surface, of natural variables, by least squares: leave out one of the two";
        refuse(format!("a spline cannot be combined with `{other}`"), help);
    }
    let is_fixed = matches!(&response.method, Method::Fixed(terms) if terms.is_empty());
    if response.spline.is_some() && !is_fixed {
        refuse(
            "a spline has no terms to choose".to_string(),
            "use `select = { method = \"fixed\" }`, without `order` and `terms`",
        );
    }
    if is_form && matches!(response.method, Method::Fixed(_)) {
        refuse(
            "\"spline\" is not accepted with `terms`: the given terms fix the form".to_string(),
            "leave `forms` out, or `terms`",
        );
    }
    let of_input = |name: &String| {
        let known = specification.input(name)?;
        // Any range: only the shape is checked here.
        Some(Input { name: name.clone(), unit: String::new(), range: [0.0, 1.0], outside: known.outside })
    };
    let inputs: Vec<Input> = surface.inputs.iter().filter_map(of_input).collect();
    if let Some(name) = surface.inputs.iter().find(|name| specification.input(name).is_some_and(|it| it.period.is_some())) {
        refuse(format!("`{name}` has a period, and a spline would jump at its end"), "leave `period` out, or use waves");
    }
    if inputs.len() != surface.inputs.len() || inputs.is_empty() {
        return;
    }
    let one = vec![1; inputs.len()];
    let (degree, cells) = response.spline.as_ref().map_or((3, &one), |it| (it.degree, it.cells.as_ref().unwrap_or(&one)));
    if let Err((what, help)) = rsm_core::check::spline_fits(degree, cells, &inputs.iter().collect::<Vec<_>>()) {
        refuse(what, help);
    }
    if let Some(penalty) = response.spline.as_ref().and_then(|it| it.penalty)
        && !(PENALTIES[0]..=PENALTIES[1]).contains(&penalty)
    {
        let what = format!("`penalty`: found {penalty}, expected {:e} to {:e}", PENALTIES[0], PENALTIES[1]);
        refuse(what, "leave it out: cross-validation chooses it");
    }
}

/// Reads `support`. `Some(None)` if absent.
pub(super) fn read_support(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<SupportSpec>> {
    let Some(value) = reader.optional("support") else { return Some(None) };
    places.note(format!("{path}.support"), value.span());
    match value.get_ref() {
        DeValue::String(word) if word == "data" => Some(Some(SupportSpec { margin: 0.0, faces: FACES })),
        DeValue::Table(_) => {
            let who = format!("{}: `support`", reader.who());
            let mut table = TableReader::of(reader.source(), value, who, faults)?;
            required_choice("from", &[("data", ())], &mut table, faults);
            let margin = table.optional("margin").map(|value| read_margin(&table, value, faults));
            let faces = table.optional("faces").map(|value| {
                places.note(format!("{path}.support.faces"), value.span());
                table.whole("`faces`", value, 4, MOST_FACES as i64, faults)
            });
            table.finish(faults);
            let faces = faces.map_or(Some(FACES), |faces| faces.and_then(|faces| usize::try_from(faces).ok()));
            Some(Some(SupportSpec { margin: margin.unwrap_or(Some(0.0))?, faces: faces? }))
        }
        other => {
            let found = describe(other);
            let what =
                format!("`support`: found {found}, expected \"data\" or {{ from = \"data\", margin = 0.05, faces = 8 }}");
            faults.push(reader.fault(value.span(), what));
            None
        }
    }
}

fn read_margin(reader: &TableReader<'_>, value: Value<'_>, faults: &mut Collector) -> Option<f64> {
    let margin = reader.number("`margin`", value, faults)?;
    if margin < 0.0 {
        faults.push(reader.fault(value.span(), format!("`margin`: found {margin}, expected 0 or more, in coded units")));
        return None;
    }
    Some(margin)
}

/// Constraints must name inputs of their response and be possible for its form; `faces` needs two inputs.
pub(super) fn check(specification: &Specification, faults: &mut Collector) {
    for response in &specification.responses {
        let faces = format!("responses.{}.support.faces", response.surface.name);
        if specification.places.has(&faces) && response.surface.inputs.len() != 2 {
            let what = format!("response `{}`: `faces` belongs to responses of two inputs", response.surface.name);
            faults.push(specification.fault(&faces, what).help("leave it out: directions of -1, 0 and 1 are taken"));
        }
        check_spline(specification, response, faults);
        if let Some((what, help)) = unwanted_form(response) {
            let place = format!("responses.{}.forms", response.surface.name);
            let what = format!("response `{}`: `forms`: {what}", response.surface.name);
            faults.push(specification.fault(&place, what).help(help));
        }
        for (k, constraint) in response.constraints.iter().enumerate() {
            if let Some((what, help)) = contradiction(specification, response, constraint) {
                let place = format!("responses.{}.constraints.{k}", response.surface.name);
                let what = format!("response `{}`: constraint {}: {what}", response.surface.name, k + 1);
                faults.push(specification.fault(&place, what).help(help));
            }
        }
    }
}

/// A reason against sigmoids or hinges chosen by the data, and what to do.
fn unwanted_form(response: &ResponseSpec) -> Option<(String, &'static str)> {
    let asks = |form| response.forms.as_ref().is_some_and(|forms| forms.contains(&form));
    if !asks(Form::Sigmoid) && !asks(Form::Hinge) {
        return None;
    }
    if let Method::Fixed(_) = response.method {
        return Some(("not accepted with `terms`: the given terms fix the form".to_string(), "leave `forms` out, or `terms`"));
    }
    // Hinges are looked for over the other inputs.
    let reciprocal = response.surface.reciprocal.first().filter(|_| asks(Form::Sigmoid));
    reciprocal
        .map(|input| (format!("\"sigmoid\" cannot be combined with `reciprocal` of `{input}`"), "leave out one of the two"))
}

/// The fault of a constraint, and what to do.
fn contradiction(specification: &Specification, response: &ResponseSpec, constraint: &Constraint) -> Option<(String, String)> {
    let surface = &response.surface;
    let symmetry_of = |name: &str| surface.symmetry.iter().find(|(input, _)| input == name).map(|(_, kind)| *kind);
    let mut odd = surface.symmetry.iter().filter(|(_, kind)| *kind == Symmetry::Odd).map(|(input, _)| input);
    // A sigmoid of such an input is refused anyway.
    if let Some(input) = surface.waves.iter().map(|wave| &wave.input).find(|input| surface.reciprocal.contains(input)) {
        let what = format!("`{input}` enters by its reciprocal and in a wave: constraints are not proved for both");
        return Some((what, "leave out one of them".to_string()));
    }
    // Waves of the response, or those that the data may choose.
    let may_wave = response.forms.as_ref().is_some_and(|forms| forms.contains(&Form::Wave));
    let is_periodic = |name: &String| specification.input(name).is_some_and(|input| input.period.is_some());
    let has_waves = |name: &String| surface.waves.iter().any(|wave| wave.input == *name) || (may_wave && is_periodic(name));
    match constraint {
        Constraint::Bounds { .. } => None,
        Constraint::Monotone { input, .. } => {
            if !surface.inputs.contains(input) {
                let known: Vec<String> = surface.inputs.iter().map(|input| format!("`{input}`")).collect();
                let help = format!("its inputs are {}", known.join(", "));
                return Some((format!("`{input}` is not an input of this response"), help));
            }
            if has_waves(input) {
                let what =
                    format!("the response has waves over `{input}`: if it never falls over a whole period, it is constant");
                return Some((what, "leave out one of the two".to_string()));
            }
            if symmetry_of(input) == Some(Symmetry::Even) {
                let help = "leave out one of the two".to_string();
                return Some((
                    format!("the response is even in `{input}`: if it increases on one side of 0, it decreases on the other"),
                    help,
                ));
            }
            odd.find(|name| *name != input).map(|name| {
                let what = format!("the response is odd in `{name}`: if it increases with `{input}` where `{name}` is positive, it decreases where it is negative");
                (what, "leave out one of the two".to_string())
            })
        }
        Constraint::Convex | Constraint::Concave => {
            if let Some(input) = surface.inputs.iter().find(|input| has_waves(input)) {
                let what = format!(
                    "the response has waves over `{input}`: a response that is convex or concave over a whole period is constant"
                );
                return Some((what, "leave out one of the two".to_string()));
            }
            if let Some((input, _)) = surface.symmetry.first() {
                let what = format!("a response with `symmetry` in `{input}` cannot be constrained to be convex or concave");
                return Some((what, "leave out one of the two".to_string()));
            }
            surface.reciprocal.first().map(|input| {
                let what = format!("`{input}` enters by its reciprocal: convex in 1/{input} is not convex in `{input}`");
                (what, "leave out one of the two".to_string())
            })
        }
    }
}
