//! Reads a study from its file.
//!
//! In: the text. Out: a [`Study`] whose parts have the right shape, or every fault with line and column. Names and bounds are checked against the
//! model later.
//!
//! ```toml
//! format = 1
//! study = "tyre"
//! seed = 1                          # of the starts of the search
//! # starts = 32                     # searches from different starts
//! # support = false                 # true is the default: settings stay where the data support every response
//! # where = [{ sum = { silica = 1.0, silane = -0.02 }, at_most = 1.0 }]   # in the units of the model
//!
//! [responses.abrasion]
//! goal = "maximise"                 # "maximise" | "minimise" | "target" | "range"
//! low = 120.0
//! high = 170.0
//! # target = 500.0                  # with goal "target": between low and high
//! # weight = 1.0                    # the exponent; with goal "target" weights = [1.0, 1.0], below and above the target
//! # importance = 1.0
//! # at_least = 100.0; at_most = 200.0        # bounds that settings must keep
//!
//! [inputs.silica]
//! range = [0.7, 1.7]                # operating limits within the range of the model, or
//! # value = 1.2                     # a fixed setting
//! ```

use rsm_core::model_file;
use rsm_core::names;
use rsm_core::places::Places;
use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{self, TableReader, Value};

use super::desirability::Goal;
use super::study::{STARTS, Study, Sum, Wish};

/// The largest number of searches: some minutes.
const MOST_STARTS: i64 = 100_000;

/// The values of `goal`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Maximise,
    Minimise,
    Target,
    Range,
}

const KINDS: [(&str, Kind); 4] =
    [("maximise", Kind::Maximise), ("minimise", Kind::Minimise), ("target", Kind::Target), ("range", Kind::Range)];

impl Study {
    /// Reads a study from its text.
    ///
    /// # Errors
    /// Every fault of the text.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_fit::optimise::{Goal, Study};
    ///
    /// let text = "format = 1\nstudy = \"pump\"\nseed = 1\n[responses.flow]\ngoal = \"maximise\"\nlow = 20\nhigh = 60\n";
    /// let study = Study::from_source(Source::new("pump-goals.toml", text))?;
    /// assert_eq!(study.responses[0].goal, Goal::Maximise { low: 20.0, high: 60.0, weight: 1.0 });
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn from_source(source: Source) -> Result<Study, Faults> {
        let mut faults = Collector::new();
        let study = read(&source, &mut faults);
        let study = study.map(|study| Study { source: Some(source), ..study });
        faults.finish(study)
    }
}

fn read(source: &Source, faults: &mut Collector) -> Option<Study> {
    let document = toml_reader::parse(source, faults)?;
    let mut top = TableReader::document(source, &document);
    if !model_file::read_format(&mut top, faults) {
        return None;
    }
    let mut places = Places::default();
    let name = top.text("study", faults).inspect(|name| {
        if let Some(reason) = names::refuse_model(name) {
            let place = top.entries().find(|(key, _, _)| *key == "study").map_or(0..0, |(_, _, value)| value.span());
            faults.push(top.fault(place, format!("study name `{name}` {reason}")));
        }
    });
    let seed = top.required("seed", faults).and_then(|value| top.whole("`seed`", value, 0, i64::MAX, faults));
    let starts = match top.optional("starts") {
        Some(value) => top.whole("`starts`", value, 1, MOST_STARTS, faults),
        None => Some(STARTS as i64),
    };
    let support = match top.optional("support") {
        None => Some(true),
        Some(value) => top.flag("`support`", value, faults),
    };
    let conditions = match top.optional("where") {
        None => Some(Vec::new()),
        Some(value) => {
            places.note("where", value.span());
            conditions(value, &top, faults)
        }
    };
    let mut responses = Vec::new();
    let section = top.required("responses", faults);
    places.each_entry(section, ("responses", "response"), source, faults, |_, name, reader, _, faults| {
        responses.push(wish(name, reader, faults)?);
        Some(())
    });
    let mut limits = Vec::new();
    let section = top.optional("inputs");
    places.each_entry(section, ("inputs", "input"), source, faults, |path, name, reader, places, faults| {
        limits.push((name.to_string(), limit(path, reader, places, faults)?));
        Some(())
    });
    top.finish(faults);
    Some(Study {
        name: name?,
        seed: seed?.unsigned_abs(),
        starts: starts? as usize,
        responses,
        limits,
        conditions: conditions?,
        support: support?,
        source: None,
        places,
    })
}

/// `Some(None)` if absent; `None` if there is a fault.
fn optional_number(reader: &mut TableReader<'_>, key: &'static str, faults: &mut Collector) -> Option<Option<f64>> {
    let Some(value) = reader.optional(key) else { return Some(None) };
    reader.number(&format!("`{key}`"), value, faults).map(Some)
}

fn number(reader: &mut TableReader<'_>, key: &'static str, faults: &mut Collector) -> Option<f64> {
    let value = reader.required(key, faults)?;
    reader.number(&format!("`{key}`"), value, faults)
}

fn wish(name: &str, reader: &mut TableReader<'_>, faults: &mut Collector) -> Option<Wish> {
    let has_goal = reader.entries().any(|(key, _, _)| key == "goal");
    let kind = reader.choice("goal", &KINDS, faults);
    if !has_goal {
        faults.push(reader.fault(reader.span(), "`goal` is missing"));
    }
    let importance = optional_number(reader, "importance", faults);
    let (at_least, at_most) = (optional_number(reader, "at_least", faults), optional_number(reader, "at_most", faults));
    let Some(kind) = kind else {
        // Which of these keys belong here is not known without the goal.
        for key in ["low", "target", "high", "weight", "weights"] {
            let _ = reader.optional(key);
        }
        return None;
    };
    let goal = match kind {
        Kind::Range => {
            let (low, high) = (optional_number(reader, "low", faults), optional_number(reader, "high", faults));
            refuse(reader, &["target", "weight", "weights", "importance"], "range", faults);
            Goal::InRange { low: low?, high: high? }
        }
        Kind::Target => {
            let (low, target, high) =
                (number(reader, "low", faults), number(reader, "target", faults), number(reader, "high", faults));
            let weights = match reader.optional("weights") {
                None => Some(vec![1.0, 1.0]),
                Some(value) => reader.numbers("`weights`", value, faults).and_then(|weights| {
                    if weights.len() != 2 {
                        let what =
                            format!("`weights`: found {} numbers, expected two: below and above the target", weights.len());
                        faults.push(reader.fault(value.span(), what));
                        return None;
                    }
                    Some(weights)
                }),
            };
            refuse(reader, &["weight"], "target", faults);
            let weights = weights?;
            Goal::Target { low: low?, target: target?, high: high?, weights: [weights[0], weights[1]] }
        }
        kind => {
            let (low, high) = (number(reader, "low", faults), number(reader, "high", faults));
            let weight = optional_number(reader, "weight", faults);
            let is_maximum = kind == Kind::Maximise;
            refuse(reader, &["target", "weights"], if is_maximum { "maximise" } else { "minimise" }, faults);
            let (low, high, weight) = (low?, high?, weight?.unwrap_or(1.0));
            if is_maximum { Goal::Maximise { low, high, weight } } else { Goal::Minimise { low, high, weight } }
        }
    };
    let importance = importance?.unwrap_or(1.0);
    Some(Wish { response: name.to_string(), goal, importance, at_least: at_least?, at_most: at_most? })
}

/// Keys of other goals, each with the goals to which it belongs.
fn refuse(reader: &mut TableReader<'_>, keys: &[&'static str], goal: &str, faults: &mut Collector) {
    for key in keys {
        if reader.entries().any(|(name, _, _)| name == *key) {
            let _ = reader.optional(key);
            faults.push(reader.fault(reader.key_span(key), format!("`{key}` does not belong to goal \"{goal}\"")));
        }
    }
}

fn limit(path: &str, reader: &mut TableReader<'_>, places: &mut Places, faults: &mut Collector) -> Option<[f64; 2]> {
    let (range, value) = (reader.optional("range"), reader.optional("value"));
    match (range, value) {
        (Some(range), None) => places.range(path, "range", range, reader, faults),
        (None, Some(value)) => reader.number("`value`", value, faults).map(|value| [value; 2]),
        (range, _) => {
            let found = if range.is_some() { "both" } else { "none" };
            faults.push(reader.fault(reader.span(), format!("found {found} of `range` and `value`, expected one of them")));
            None
        }
    }
}

fn conditions(value: Value<'_>, top: &TableReader<'_>, faults: &mut Collector) -> Option<Vec<Sum>> {
    let mut conditions = Vec::new();
    for (k, item) in top.array("`where`", value, faults)?.into_iter().enumerate() {
        let who = format!("`where`: condition {}", k + 1);
        let mut reader = TableReader::of(top.source(), item, who.clone(), faults)?;
        let mut weights = Vec::new();
        if let Some(sum) = reader.required("sum", faults)
            && let Some(sum) = TableReader::of(top.source(), sum, format!("{who}: `sum`"), faults)
        {
            for (name, _, value) in sum.entries() {
                weights.extend(sum.number(&format!("`{name}`"), value, faults).map(|weight| (name.to_string(), weight)));
            }
        }
        let (at_most, at_least) =
            (optional_number(&mut reader, "at_most", faults), optional_number(&mut reader, "at_least", faults));
        if (at_most, at_least) == (Some(None), Some(None)) {
            faults.push(reader.fault(reader.span(), "found neither `at_most` nor `at_least`, expected one of them"));
        }
        reader.finish(faults);
        conditions.push(Sum { weights, at_most: at_most.flatten(), at_least: at_least.flatten() });
    }
    Some(conditions)
}
