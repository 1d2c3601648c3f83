//! The file of an effect.
//!
//! In: a text of format 1. Out: [`Effect`], or every fault with line and column. Roles and units can be checked only at a site, so `rewrite` reports
//! those faults.

use std::ops::Range;

use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{TableReader, Value, parse};

use super::forms::{Form, forms};
use super::known::evaluated;
use super::site::{SiteKind, expression};
use crate::syntax::tree::{Expression, Kind};

/// A parameter of an effect.
#[derive(Debug, Clone)]
pub struct Number {
    /// Its name in a plant file.
    pub name: String,
    /// The kind of site on which the effect has it; `None` for all.
    pub on: Option<SiteKind>,
    /// Its unit on a kind of site, or on all. `{role}` is replaced by the unit of a role.
    pub(crate) units: Vec<(Option<SiteKind>, String)>,
    /// The smallest value.
    pub min: Option<f64>,
    /// The largest value.
    pub max: Option<f64>,
    /// Whether `min` itself is excluded.
    pub is_above_min: bool,
    /// Whether it must be an integer.
    pub is_whole: bool,
    /// The least and the largest value in a real machine, as expressions of the other numbers. A search refuses others; a plant file may have them.
    pub(crate) least: Option<Expression>,
    pub(crate) most: Option<Expression>,
    /// The value if a plant file omits it; without one it is required.
    pub(crate) default: Option<Expression>,
    /// The value at which the effect changes nothing, if there is one.
    pub(crate) neutral: Option<Expression>,
    /// Whether it is a phase: then a shift by a quarter period gives an independent effect.
    pub is_phase: bool,
    /// Whether it is a level of friction. The special case of the effect has one such level.
    pub is_level: bool,
    /// Whether it is a share of a body's inertia.
    pub is_share: bool,
    /// First guesses on a kind of site, or on all, in scales of the records.
    pub(crate) guesses: Vec<(Option<SiteKind>, Expression)>,
}

/// The trace of an effect that a search knows by another means than its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TraceRole {
    /// A reading is a multiple of the true value.
    ReadingGain,
    /// A reading follows the true value with a time constant.
    ReadingLag,
    /// A signal is delayed.
    Delay,
    /// A periodic effort over the position.
    Waves,
}

impl TraceRole {
    /// The names in a file.
    pub(crate) const NAMES: [(&'static str, TraceRole); 4] = [
        ("reading-gain", TraceRole::ReadingGain),
        ("reading-lag", TraceRole::ReadingLag),
        ("delay", TraceRole::Delay),
        ("waves", TraceRole::Waves),
    ];
}

/// A state of an effect.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub name: String,
    pub on: Option<SiteKind>,
    pub unit: Option<String>,
    pub start: Expression,
    pub rate: Expression,
}

/// A change that an effect makes to a role.
#[derive(Debug, Clone)]
pub(crate) enum Change {
    /// Adds to the balance of the site.
    Balance(Expression),
    /// Adds to the load, which acts against forward motion.
    Load(Expression),
    /// Replaces a role by a law.
    Replace(String, Expression),
    /// Replaces roles by laws, inside the equation that defines another role.
    Inside(String, Vec<(String, Expression)>),
    /// Defines a role by another equation.
    Define(String, Expression),
    /// Changes the readings of a role by outputs.
    Reading(String, Expression),
    /// Delays a signal, in s.
    Delay(Expression),
    /// Replaces a role by a law in the initial equations.
    Start(String, Expression),
}

/// The texts of an effect.
#[derive(Debug, Clone, Default)]
pub struct Words {
    /// The sentence of a report. `{name}` is replaced by a parameter with its unit, `{site}` by the site.
    pub sentence: String,
    /// What to measure to confirm the effect.
    pub check: String,
    /// Other effects, or other things, that look like it.
    pub looks_like: Vec<String>,
    /// How it can be distinguished from them.
    pub told_apart: String,
}

/// A helper: an expression, possibly different for each kind of site. With a unit it is a constant.
#[derive(Debug, Clone)]
pub(crate) struct Helper {
    pub name: String,
    pub unit: Option<String>,
    pub list: Vec<(Option<SiteKind>, Expression)>,
}

impl Helper {
    /// Its expression on a kind of site.
    pub(crate) fn on(&self, kind: SiteKind) -> Option<&Expression> {
        self.list.iter().find(|it| it.0.is_none_or(|on| on == kind)).map(|it| &it.1)
    }
}

/// An effect, as its file describes it.
#[derive(Debug, Clone)]
pub struct Effect {
    /// Its name in plant files.
    pub kind: String,
    /// The kinds of sites on which it is possible.
    pub sites: Vec<SiteKind>,
    /// The source of its law.
    pub reference: String,
    /// Its numbers.
    pub numbers: Vec<Number>,
    /// Its texts.
    pub words: Words,
    /// The effect that it contains as a special case, if the file names one.
    pub generalises: Option<String>,
    /// How a search treats the effect, if it differs from other effects.
    pub role: Option<TraceRole>,
    /// Whether it acts after all other effects on its kind of site.
    pub is_outermost: bool,
    /// Whether the true value can be computed from a reading. If not, because it is rounded or clipped, the reading is used as the true value.
    pub reads_back: bool,
    /// The parameter to whose multiples a reading is rounded. A simulation has no derivative with respect to it.
    pub rounds_to: Option<String>,
    pub(crate) forms: Vec<Form>,
    pub(crate) helpers: Vec<Helper>,
    pub(crate) states: Vec<State>,
    pub(crate) changes: Vec<Change>,
    pub(crate) source: Source,
}

impl Effect {
    /// Reads the file of an effect.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_model::effects::Effect;
    ///
    /// let text = "format = 1\nkind = \"bell-drag\"\nsites = [\"translation\"]\nsource = \"ours\"\n\
    ///             [numbers]\nlevel = { unit = \"N\", min = 0.0 }\n[changes]\neffort = \"-level*tanh(speed)\"\n\
    ///             [words]\nsentence = \"A bell drags with {level}.\"\ncheck = \"Take it off.\"\n";
    /// let effect = Effect::read(&Source::new("bell-drag.toml", text))?;
    /// assert_eq!((effect.kind.as_str(), effect.numbers[0].name.as_str()), ("bell-drag", "level"));
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// Every fault.
    pub fn read(source: &Source) -> Result<Effect, Faults> {
        let mut faults = Collector::new();
        let Some(document) = parse(source, &mut faults) else { return faults.finish(None) };
        let mut top = TableReader::document(source, &document);
        if let Some(value) = top.required("format", &mut faults) {
            top.whole("`format`", value, 1, 1, &mut faults);
        }
        let kind = top.text("kind", &mut faults);
        let sites = sites(&mut top, &mut faults);
        let reference = top.text("source", &mut faults);
        let generalises = top.optional_text("generalises", &mut faults);
        let role = top.choice("role", &TraceRole::NAMES, &mut faults);
        let reads_back = top.optional("reads_back").and_then(|it| it.get_ref().as_bool()).unwrap_or(true);
        let is_outermost = top.optional("outermost").and_then(|it| it.get_ref().as_bool()).unwrap_or(false);
        let rounds_to = top.optional_text("rounds_to", &mut faults);
        let numbers: Vec<Number> = entries(&mut top, "numbers", &mut faults)
            .into_iter()
            .filter_map(|(name, _, value)| number(source, name, value, &mut faults))
            .collect();
        let names: Vec<&str> = numbers.iter().map(|it| it.name.as_str()).collect();
        let forms = forms(&mut top, &names, &mut faults);
        let helpers = entries(&mut top, "helpers", &mut faults)
            .into_iter()
            .filter_map(|(name, _, value)| helper(source, name, value, &mut faults))
            .collect();
        let states = entries(&mut top, "states", &mut faults)
            .into_iter()
            .filter_map(|(name, _, value)| state(source, name, value, &mut faults))
            .collect();
        let changes = match top.required("changes", &mut faults) {
            Some(value) => changes(source, value, &mut faults),
            None => Vec::new(),
        };
        let words = match top.required("words", &mut faults) {
            Some(value) => words(source, value, &mut faults),
            None => None,
        };
        if let Some(name) = rounds_to.as_ref().filter(|it| !numbers.iter().any(|number| number.name == **it)) {
            faults
                .push(source.fault(document.span(), format!("`rounds_to`: found `{name}`, which is no number of the effect")));
        }
        top.finish(&mut faults);
        // An unknown name in a limit would otherwise show in no search.
        let ones: Vec<(&str, f64)> = names.iter().map(|name| (*name, 1.0)).collect();
        for law in numbers.iter().flat_map(|it| [&it.least, &it.most]).flatten() {
            if let Err(found) = evaluated(source, law, &ones) {
                found.list().iter().for_each(|fault| faults.push(fault.clone()));
            }
        }
        let whole = kind.zip(sites).zip(reference).zip(words).map(|(((kind, sites), reference), words)| Effect {
            kind,
            sites,
            reference,
            numbers,
            words,
            generalises,
            role,
            is_outermost,
            reads_back,
            rounds_to,
            forms,
            helpers,
            states,
            changes,
            source: source.clone(),
        });
        faults.finish(whole)
    }

    /// The parameters that it has on a kind of site.
    pub fn numbers_on(&self, kind: SiteKind) -> impl Iterator<Item = &Number> {
        self.numbers.iter().filter(move |number| number.on.is_none_or(|on| on == kind))
    }

    /// Whether it only changes the value of a parameter, so that no equation changes.
    #[must_use]
    pub fn is_value(&self) -> bool {
        let is_number = |law: &Expression| {
            let mut names = Vec::new();
            law.names(&mut names);
            let [number] = &self.numbers[..] else { return false };
            names == [number.name.clone()] && self.source.text().get(law.span.clone()) == Some(&number.name)
        };
        self.sites == [SiteKind::Parameter]
            && self.states.is_empty()
            && matches!(&self.changes[..], [Change::Replace(role, law)] if role == "signal" && is_number(law))
    }

    /// Whether a parameter may be omitted.
    #[must_use]
    pub fn has_default(&self, number: &str) -> bool {
        self.numbers.iter().any(|it| it.name == number && it.default.is_some())
    }

    /// Its changes on a site. Changes of roles that the site does not have are left out.
    pub(super) fn changes_on<'e>(&'e self, has: &'e dyn Fn(&str) -> bool) -> impl Iterator<Item = &'e Change> {
        self.changes.iter().filter(move |change| match change {
            Change::Balance(_) | Change::Load(_) | Change::Delay(_) => true,
            Change::Replace(role, _)
            | Change::Define(role, _)
            | Change::Reading(role, _)
            | Change::Start(role, _)
            | Change::Inside(role, _) => has(role),
        })
    }

    /// The names in its laws on a site, including those in the helpers that they use.
    pub(super) fn names(&self, kind: SiteKind, has: &dyn Fn(&str) -> bool) -> Vec<String> {
        let mut names = Vec::new();
        for change in self.changes_on(has) {
            match change {
                Change::Balance(law)
                | Change::Load(law)
                | Change::Delay(law)
                | Change::Replace(_, law)
                | Change::Define(_, law)
                | Change::Start(_, law)
                | Change::Reading(_, law) => law.names(&mut names),
                Change::Inside(_, laws) => {
                    for (role, law) in laws {
                        names.push(role.clone());
                        law.names(&mut names);
                    }
                }
            }
        }
        self.numbers_on(kind).filter_map(|it| it.default.as_ref()).for_each(|it| it.names(&mut names));
        for state in self.states_on(kind) {
            [&state.start, &state.rate].into_iter().for_each(|it| it.names(&mut names));
        }
        let mut at = 0;
        while at < names.len() {
            let helper = self.helpers.iter().find(|it| it.name == names[at] && !names[..at].contains(&it.name));
            if let Some(law) = helper.and_then(|it| it.on(kind)) {
                law.names(&mut names);
            }
            at += 1;
        }
        names
    }

    pub(super) fn states_on(&self, kind: SiteKind) -> impl Iterator<Item = &State> {
        self.states.iter().filter(move |state| state.on.is_none_or(|on| on == kind))
    }
}

/// One unit, or one for each kind of site.
fn units(source: &Source, value: Value<'_>, faults: &mut Collector) -> Option<Vec<(Option<SiteKind>, String)>> {
    if let Some(unit) = value.get_ref().as_str() {
        return Some(vec![(None, unit.to_string())]);
    }
    let table = TableReader::of(source, value, "`unit`", faults)?;
    let each = table.entries().map(|(name, place, value)| {
        let kind = kind_of(source, name, place, faults)?;
        Some((Some(kind), value.get_ref().as_str()?.to_string()))
    });
    each.collect()
}

impl Number {
    /// Its unit on a kind of site. `{role}` in it is to be replaced by the unit of a role.
    #[must_use]
    pub fn unit(&self, kind: SiteKind) -> &str {
        self.units.iter().find(|(on, _)| on.is_none_or(|on| on == kind)).map_or("", |it| &it.1)
    }

    /// Whether it is a factor, with 1 as the value that changes nothing.
    #[must_use]
    pub fn scales_from_one(&self) -> bool {
        self.neutral.as_ref().is_some_and(|it| matches!(it.kind, Kind::Number(value, _) if value == 1.0))
    }

    /// What is wrong with a value, or `None`.
    #[must_use]
    pub fn refuses(&self, value: f64) -> Option<String> {
        let bound = |what: String| Some(format!("found {value}, expected {what}"));
        match (self.min, self.max) {
            (Some(min), _) if self.is_above_min && value <= min => bound(format!("a number above {min}")),
            (Some(min), _) if value < min => bound(format!("a number of at least {min}")),
            (_, Some(max)) if value > max => bound(format!("a number of at most {max}")),
            _ if self.is_whole && value.fract() != 0.0 => bound("a whole number".to_string()),
            _ => None,
        }
    }
}

fn entries<'a>(
    top: &mut TableReader<'a>,
    key: &'static str,
    faults: &mut Collector,
) -> Vec<(&'a str, Range<usize>, Value<'a>)> {
    let source = top.source();
    let Some(value) = top.optional(key) else { return Vec::new() };
    match TableReader::of(source, value, format!("[{key}]"), faults) {
        Some(table) => table.entries().collect(),
        None => Vec::new(),
    }
}

fn kind_of(source: &Source, name: &str, place: Range<usize>, faults: &mut Collector) -> Option<SiteKind> {
    let found = SiteKind::NAMES.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind);
    if found.is_none() {
        let names: Vec<String> = SiteKind::NAMES.iter().map(|(name, _)| format!("`{name}`")).collect();
        let what = format!("found \"{name}\", which is no kind of site");
        faults.push(source.fault(place, what).help(format!("kinds are {}", names.join(", "))));
    }
    found
}

fn sites(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<Vec<SiteKind>> {
    let source = top.source();
    let value = top.required("sites", faults)?;
    let list = top.texts("`sites`", value, faults)?;
    if list.is_empty() {
        faults.push(source.fault(value.span(), "`sites`: found none, expected one kind of site or more"));
    }
    list.into_iter().map(|(name, place)| kind_of(source, &name, place, faults)).collect()
}

fn number(source: &Source, name: &str, value: Value<'_>, faults: &mut Collector) -> Option<Number> {
    let mut table = TableReader::of(source, value, format!("[numbers]: `{name}`"), faults)?;
    let on = table.optional("on").and_then(|it| {
        let text = it.get_ref().as_str().unwrap_or_default();
        kind_of(source, text, it.span(), faults)
    });
    let value = table.required("unit", faults)?;
    let units = units(source, value, faults)?;
    let mut bound = |table: &mut TableReader<'_>, key: &'static str| {
        let value = table.optional(key)?;
        table.number(&format!("`{key}`"), value, faults)
    };
    let (min, max, above) = (bound(&mut table, "min"), bound(&mut table, "max"), bound(&mut table, "above"));
    let mut flag = |key: &'static str| table.optional(key).and_then(|it| it.get_ref().as_bool()).unwrap_or(false);
    let (is_whole, is_phase) = (flag("whole"), flag("phase"));
    let (is_level, is_share) = (flag("level"), flag("share"));
    let written = |table: &mut TableReader<'_>, key: &'static str, faults: &mut Collector| {
        table.optional(key).and_then(|it| expression(source, it, faults))
    };
    let (default, neutral) = (written(&mut table, "default", faults), written(&mut table, "neutral", faults));
    let (least, most) = (written(&mut table, "least", faults), written(&mut table, "most", faults));
    let guesses = table.optional("guess").map_or_else(Vec::new, |value| guesses(source, value, faults));
    table.finish(faults);
    Some(Number {
        name: name.to_string(),
        on,
        units,
        min: above.or(min),
        max,
        is_above_min: above.is_some(),
        is_whole,
        least,
        most,
        default,
        neutral,
        is_phase,
        is_level,
        is_share,
        guesses,
    })
}

/// Guesses: one, a list, or one of these for each kind of site.
fn guesses(source: &Source, value: Value<'_>, faults: &mut Collector) -> Vec<(Option<SiteKind>, Expression)> {
    let mut list = Vec::new();
    let mut take = |on: Option<SiteKind>, value: Value<'_>, faults: &mut Collector| match value.get_ref().as_array() {
        Some(items) => list.extend(items.iter().filter_map(|it| expression(source, it, faults)).map(|it| (on, it))),
        None => list.extend(expression(source, value, faults).map(|it| (on, it))),
    };
    if value.get_ref().as_table().is_none() {
        take(None, value, faults);
    } else if let Some(table) = TableReader::of(source, value, "`guess`", faults) {
        for (name, place, value) in table.entries() {
            if let Some(kind) = kind_of(source, name, place, faults) {
                take(Some(kind), value, faults);
            }
        }
    }
    list
}

fn helper(source: &Source, name: &str, value: Value<'_>, faults: &mut Collector) -> Option<Helper> {
    let name = name.to_string();
    if value.get_ref().as_table().is_none() {
        return Some(Helper { name, unit: None, list: vec![(None, expression(source, value, faults)?)] });
    }
    let table = TableReader::of(source, value, format!("[helpers]: `{name}`"), faults)?;
    let mut list = Vec::new();
    let mut unit = None;
    for (key, place, value) in table.entries() {
        if key == "unit" {
            unit = value.get_ref().as_str().map(str::to_string);
            continue;
        }
        let kind = if key == "value" { None } else { Some(kind_of(source, key, place, faults)?) };
        list.push((kind, expression(source, value, faults)?));
    }
    Some(Helper { name, unit, list })
}

fn state(source: &Source, name: &str, value: Value<'_>, faults: &mut Collector) -> Option<State> {
    let mut table = TableReader::of(source, value, format!("[states]: `{name}`"), faults)?;
    let on = table.optional("on").and_then(|it| kind_of(source, it.get_ref().as_str().unwrap_or_default(), it.span(), faults));
    let unit = table.optional_text("unit", faults);
    let start = table.required("start", faults).and_then(|it| expression(source, it, faults));
    let rate = table.required("rate", faults).and_then(|it| expression(source, it, faults));
    table.finish(faults);
    Some(State { name: name.to_string(), on, unit, start: start?, rate: rate? })
}

fn laws(table: &mut TableReader<'_>, key: &'static str, faults: &mut Collector) -> Vec<(String, Expression)> {
    entries(table, key, faults)
        .into_iter()
        .filter_map(|(role, _, value)| expression(table.source(), value, faults).map(|it| (role.to_string(), it)))
        .collect()
}

fn changes(source: &Source, value: Value<'_>, faults: &mut Collector) -> Vec<Change> {
    let mut list = Vec::new();
    let Some(mut table) = TableReader::of(source, value, "[changes]", faults) else { return list };
    for key in ["effort", "flow", "rate"] {
        list.extend(table.optional(key).and_then(|it| expression(source, it, faults)).map(Change::Balance));
    }
    list.extend(table.optional("load").and_then(|it| expression(source, it, faults)).map(Change::Load));
    list.extend(table.optional("delay").and_then(|it| expression(source, it, faults)).map(Change::Delay));
    if let Some(value) = table.optional("inside")
        && let Some(inner) = TableReader::of(source, value, "[changes.inside]", faults)
    {
        for (role, _, value) in inner.entries() {
            let Some(laws) = TableReader::of(source, value, format!("[changes.inside.{role}]"), faults) else { continue };
            let laws = laws.entries().filter_map(|(name, _, it)| Some((name.to_string(), expression(source, it, faults)?)));
            list.push(Change::Inside(role.to_string(), laws.collect()));
        }
    }
    list.extend(laws(&mut table, "start", faults).into_iter().map(|(role, it)| Change::Start(role, it)));
    list.extend(laws(&mut table, "define", faults).into_iter().map(|(role, it)| Change::Define(role, it)));
    list.extend(laws(&mut table, "replace", faults).into_iter().map(|(role, it)| Change::Replace(role, it)));
    list.extend(laws(&mut table, "reading", faults).into_iter().map(|(role, it)| Change::Reading(role, it)));
    table.finish(faults);
    if list.is_empty() {
        faults.push(source.fault(value.span(), "[changes]: the effect changes nothing"));
    }
    list
}

fn words(source: &Source, value: Value<'_>, faults: &mut Collector) -> Option<Words> {
    let mut table = TableReader::of(source, value, "[words]", faults)?;
    let (sentence, check) = (table.text("sentence", faults), table.text("check", faults));
    let looks_like = match table.optional("looks_like") {
        Some(value) => table.texts("`looks_like`", value, faults)?.into_iter().map(|it| it.0).collect(),
        None => Vec::new(),
    };
    let told_apart = table.optional_text("told_apart", faults).unwrap_or_default();
    table.finish(faults);
    Some(Words { sentence: sentence?, check: check?, looks_like, told_apart })
}
