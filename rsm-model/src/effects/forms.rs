//! Simpler forms of an effect: sums of other effects at the same place that act as it does, exactly or nearly.
//!
//! ```toml
//! [[forms]]
//! is = "special"                       # the effect with fewer numbers; "alike": almost the same with as many; "level": the same in both directions
//! given = ["viscous_forward"]          # only if a plant file gives these numbers; `omitted`: only if it gives none of them
//! sum = { coulomb-friction = "0.5*(forward + backward)" }
//! values = { viscous_friction = "0.5*(viscous_forward + viscous_backward)" }   # what roles of the site that are parameters then are
//! ```
//!
//! In: the table of the file of an effect. Out: [`Form`]s, with faults at their places. Evaluates nothing.

use std::ops::Range;

use rsm_core::source::{Collector, Source};
use rsm_core::toml_reader::{TableReader, Value};

use super::site::expression;
use crate::syntax::tree::Expression;

/// How a simpler form relates to its effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FormKind {
    /// The effect with fewer numbers.
    Special,
    /// Almost the same, with the same number of numbers.
    Alike,
    /// The effect if it is independent of the direction.
    Level,
}

impl FormKind {
    const NAMES: [(&'static str, FormKind); 3] =
        [("special", FormKind::Special), ("alike", FormKind::Alike), ("level", FormKind::Level)];
}

/// A simpler form as in the file.
#[derive(Debug, Clone)]
pub(crate) struct Form {
    pub is: FormKind,
    pub given: Vec<String>,
    pub omitted: Vec<String>,
    pub sum: Vec<(String, Expression)>,
    pub values: Vec<(String, Expression)>,
}

/// Reads `[[forms]]`.
pub(crate) fn forms(top: &mut TableReader<'_>, numbers: &[&str], faults: &mut Collector) -> Vec<Form> {
    let source = top.source();
    let Some(value) = top.optional("forms") else { return Vec::new() };
    let Some(items) = top.array("`forms`", value, faults) else { return Vec::new() };
    items.into_iter().filter_map(|item| form(source, item, numbers, faults)).collect()
}

fn form(source: &Source, value: Value<'_>, numbers: &[&str], faults: &mut Collector) -> Option<Form> {
    let mut table = TableReader::of(source, value, "[[forms]]", faults)?;
    if table.entries().all(|(key, ..)| key != "is") {
        table.required("is", faults)?;
    }
    let is = table.choice("is", &FormKind::NAMES, faults);
    let known = |list: Vec<(String, Range<usize>)>, faults: &mut Collector| {
        for (name, place) in &list {
            if !numbers.contains(&name.as_str()) {
                faults
                    .push(source.fault(place.clone(), format!("[[forms]]: found `{name}`, which is no number of the effect")));
            }
        }
        list.into_iter().map(|it| it.0).collect::<Vec<String>>()
    };
    let names = |table: &mut TableReader<'_>, key: &'static str, faults: &mut Collector| {
        let list = table.optional(key).and_then(|value| table.texts(&format!("`{key}`"), value, faults));
        known(list.unwrap_or_default(), faults)
    };
    let (given, omitted) = (names(&mut table, "given", faults), names(&mut table, "omitted", faults));
    let sum = table.required("sum", faults).map(|value| laws(source, value, "`sum`", faults)).unwrap_or_default();
    let values = table.optional("values").map(|value| laws(source, value, "`values`", faults)).unwrap_or_default();
    table.finish(faults);
    Some(Form { is: is?, given, omitted, sum, values })
}

/// A table of names with expressions.
fn laws(source: &Source, value: Value<'_>, what: &'static str, faults: &mut Collector) -> Vec<(String, Expression)> {
    let Some(table) = TableReader::of(source, value, format!("[[forms]]: {what}"), faults) else { return Vec::new() };
    let list: Vec<_> = table.entries().collect();
    list.into_iter().filter_map(|(name, _, value)| Some((name.to_string(), expression(source, value, faults)?))).collect()
}
