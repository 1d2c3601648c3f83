//! The entries `[[vary]]`: the varied numbers and their distributions.
//!
//! In: entries, a plant, a plan. Out: for each entry the number of the plant and its distribution, with unit and bound.

use std::ops::Range;

use rsm_core::names;
use rsm_core::source::Collector;
use rsm_core::toml_reader::{TableReader, Value};
use rsm_fit::plan::Plan;
use rsm_sim::effect::Subject;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::schema;

use super::{Law, Number, Place};
use crate::distribution::Distribution;

/// An entry.
pub(super) struct VaryEntry {
    pub(super) name: String,
    pub(super) who: String,
    pub(super) span: Range<usize>,
    target: Target,
    law: Wanted,
}

/// The number that an entry varies.
enum Target {
    Parameter(String),
    Effect { kind: String, on: Option<String>, number: String },
}

/// The distribution, before the plant is known.
enum Wanted {
    Tolerance { within: Option<[f64; 2]> },
    Normal { mean: Option<f64>, sd: Option<f64>, relative: Option<f64>, within: Option<[f64; 2]> },
    Known(Distribution),
    Planned { column: String },
}

impl VaryEntry {
    /// The number of values in its list, if it has one.
    pub(super) fn levels(&self) -> Option<usize> {
        match &self.law {
            Wanted::Known(Distribution::List(values)) => Some(values.len()),
            _ => None,
        }
    }
}

#[derive(Clone, Copy)]
enum Shape {
    Tolerance,
    Normal,
    Uniform,
    LogUniform,
    List,
    Planned,
}

const SHAPES: [(&str, Shape); 6] = [
    ("tolerance", Shape::Tolerance),
    ("normal", Shape::Normal),
    ("uniform", Shape::Uniform),
    ("log-uniform", Shape::LogUniform),
    ("list", Shape::List),
    ("plan", Shape::Planned),
];

/// All entries; `None` if any has a fault.
pub(super) fn vary_entries(top: &mut TableReader<'_>, faults: &mut Collector) -> Option<Vec<VaryEntry>> {
    let Some(value) = top.optional("vary") else { return Some(Vec::new()) };
    let items = top.array("`vary`", value, faults)?;
    let mut vary_entries: Vec<VaryEntry> = Vec::new();
    let mut whole = true;
    for item in items {
        let Some(vary_entry) = vary_entry(top, item, faults) else {
            whole = false;
            continue;
        };
        let clash = vary_entries.iter().find_map(|it| names::clash(&it.name, &vary_entry.name));
        if let Some(reason) = names::refuse(&vary_entry.name).or(clash) {
            let what = format!("{}: the column `{}` {reason}", vary_entry.who, vary_entry.name);
            faults.push(top.fault(vary_entry.span.clone(), what).help("give the entry another `name`"));
            whole = false;
        }
        vary_entries.push(vary_entry);
    }
    whole.then_some(vary_entries)
}

fn vary_entry(top: &TableReader<'_>, item: Value<'_>, faults: &mut Collector) -> Option<VaryEntry> {
    let mut table = TableReader::of(top.source(), item, "[[vary]]", faults)?;
    let parameter = table.optional_text("parameter", faults);
    let effect = table.optional_text("effect", faults);
    let on = table.optional_text("on", faults);
    let number = table.optional_text("number", faults);
    let target = match (parameter, effect, number) {
        (Some(name), None, None) if on.is_none() => Some(Target::Parameter(name)),
        (None, Some(kind), Some(number)) => Some(Target::Effect { kind, on, number }),
        _ => {
            let what = "expected `parameter`, or `effect` with `number` (and `on` where it occurs twice)";
            faults.push(table.fault(table.span(), what));
            None
        }
    };
    let own_name = table.optional_text("name", faults);
    table.required("distribution", faults)?;
    let shape = table.choice("distribution", &SHAPES, faults)?;
    let law = law(&mut table, shape, target.as_ref(), faults);
    let span = table.span();
    table.finish(faults);
    let target = target?;
    let (who, plain) = match &target {
        Target::Parameter(name) => (format!("`{name}`"), name.clone()),
        Target::Effect { kind, on: None, number } => (format!("`{kind}`, `{number}`"), format!("{kind} {number}")),
        Target::Effect { kind, on: Some(on), number } => {
            (format!("`{kind}` on `{on}`, `{number}`"), format!("{kind} {on} {number}"))
        }
    };
    let plain: Vec<&str> = plain.split(|c: char| !c.is_ascii_alphanumeric()).filter(|it| !it.is_empty()).collect();
    Some(VaryEntry {
        name: own_name.unwrap_or_else(|| plain.join("_")),
        who: format!("[[vary]] {who}"),
        span,
        target,
        law: law?,
    })
}

/// Two ends with the first below the second.
fn ends(table: &TableReader<'_>, key: &str, value: Value<'_>, faults: &mut Collector) -> Option<[f64; 2]> {
    let numbers = table.numbers(&format!("`{key}`"), value, faults)?;
    match numbers[..] {
        [low, high] if low < high => Some([low, high]),
        _ => {
            let what = format!("`{key}`: expected two numbers, the first below the second");
            faults.push(table.fault(value.span(), what));
            None
        }
    }
}

/// A number above 0.
fn positive(table: &mut TableReader<'_>, key: &'static str, faults: &mut Collector) -> Option<f64> {
    let value = table.optional(key)?;
    let found = table.number(&format!("`{key}`"), value, faults)?;
    if found <= 0.0 {
        faults.push(table.fault(value.span(), format!("`{key}`: found {found}, expected a number above 0")));
        return None;
    }
    Some(found)
}

fn law(table: &mut TableReader<'_>, shape: Shape, target: Option<&Target>, faults: &mut Collector) -> Option<Wanted> {
    Some(match shape {
        Shape::Tolerance | Shape::Normal => {
            let within = match table.optional("within") {
                Some(value) => Some(ends(table, "within", value, faults)?),
                None => None,
            };
            if matches!(shape, Shape::Tolerance) {
                if matches!(target, Some(Target::Effect { .. })) {
                    let what = "\"tolerance\" is for parameters of the plant file; a number of an effect has no tolerance";
                    faults.push(table.fault(table.span(), what));
                }
                return Some(Wanted::Tolerance { within });
            }
            let mean = match table.optional("mean") {
                Some(value) => Some(table.number("`mean`", value, faults)?),
                None => None,
            };
            let (sd, relative) = (positive(table, "sd", faults), positive(table, "relative_sd", faults));
            if sd.is_some() == relative.is_some() {
                faults.push(table.fault(table.span(), "expected one of `sd` and `relative_sd`"));
                return None;
            }
            if let (Some(mean), Some([low, high]), Some(sd)) = (mean, within, sd)
                && (mean - high > FAR * sd || low - mean > FAR * sd)
            {
                faults.push(table.fault(
                    table.key_span("within"),
                    "`within`: the distribution has almost no probability between these two values",
                ));
            }
            Wanted::Normal { mean, sd, relative, within }
        }
        Shape::Uniform | Shape::LogUniform => {
            let value = table.required("range", faults)?;
            let [low, high] = ends(table, "range", value, faults)?;
            if matches!(shape, Shape::Uniform) {
                return Some(Wanted::Known(Distribution::Uniform([low, high])));
            }
            if low <= 0.0 {
                let what = format!("`range`: found {low}, expected a number above 0: \"log-uniform\" takes its logarithm");
                faults.push(table.fault(value.span(), what));
                return None;
            }
            Wanted::Known(Distribution::LogUniform([low, high]))
        }
        Shape::List => {
            let value = table.required("values", faults)?;
            let values = table.numbers("`values`", value, faults)?;
            let twice = (1..values.len()).find(|k| values[..*k].contains(&values[*k]));
            if let Some(k) = twice {
                faults.push(table.fault(value.span(), format!("`values`: {} occurs twice", values[k])));
            }
            if values.is_empty() {
                faults.push(table.fault(value.span(), "`values`: found none, expected at least one"));
                return None;
            }
            Wanted::Known(Distribution::List(values))
        }
        Shape::Planned => {
            let column = table.optional_text("column", faults);
            let own = match target {
                Some(Target::Parameter(name)) => Some(name.clone()),
                _ => None,
            };
            let Some(column) = column.or(own) else {
                faults.push(table.fault(table.span(), "`column` is missing: name the column of the plan that has the values"));
                return None;
            };
            Wanted::Planned { column }
        }
    })
}

/// Beyond this many standard deviations, shares of a normal distribution are no longer distinguished.
const FAR: f64 = 8.0;

/// Checks that entries use a plan, and that they use all its factors.
pub(super) fn plan_and_factors(top: &TableReader<'_>, vary_entries: &[VaryEntry], plan: Option<&Plan>, faults: &mut Collector) {
    let columns: Vec<&str> = vary_entries
        .iter()
        .filter_map(|it| match &it.law {
            Wanted::Planned { column } => Some(column.as_str()),
            _ => None,
        })
        .collect();
    match plan {
        None => {
            for vary_entry in vary_entries.iter().filter(|it| matches!(it.law, Wanted::Planned { .. })) {
                faults.push(top.fault(
                    vary_entry.span.clone(),
                    format!("{}: `distribution = \"plan\"` needs the key `plan` with the name of a plan file", vary_entry.who),
                ));
            }
        }
        Some(plan) => {
            for factor in plan.factors.iter().filter(|it| !columns.contains(&it.name.as_str())) {
                let what = format!("`plan`: no [[vary]] uses its column `{}`", factor.name);
                let help = "write an entry with `distribution = \"plan\"` for it, or remove the column";
                faults.push(top.fault(top.key_span("plan"), what).help(help));
            }
        }
    }
}

/// The number of a plant that an entry refers to, with its distribution.
pub(super) fn place(
    vary_entry: &VaryEntry,
    plant: &PlantFile,
    plant_name: &str,
    plan: Option<&Plan>,
    top: &TableReader<'_>,
    faults: &mut Collector,
) -> Option<Place> {
    let mut refuse = |what: String, help: String| {
        let fault = top.fault(vary_entry.span.clone(), format!("{}: {what}", vary_entry.who));
        faults.push(if help.is_empty() { fault } else { fault.help(help) });
        None::<Place>
    };
    let list = |names: &mut dyn Iterator<Item = String>| names.map(|it| format!("`{it}`")).collect::<Vec<_>>().join(", ");
    let (of, unit, bound, now) = match &vary_entry.target {
        Target::Parameter(name) => {
            let Some(nominal) = schema::parameters(plant.kind).iter().find(|it| it.name == *name) else {
                let known = list(&mut schema::parameters(plant.kind).iter().map(|it| it.name.to_string()));
                return refuse(format!("{plant_name} has no such parameter"), format!("it has {known}"));
            };
            let Some(now) = plant.parameters.optional(nominal.name) else {
                return refuse(format!("{plant_name} has no value for this parameter"), String::new());
            };
            (Number::Parameter(nominal.name), nominal.unit.to_string(), nominal.bound, now)
        }
        Target::Effect { kind, on, number } => {
            let is_it = |it: &rsm_sim::plant_file::Entry| {
                it.description.kind == *kind && on.as_ref().is_none_or(|on| it.arguments.subject.as_ref() == Some(on))
            };
            let found: Vec<usize> = (0..plant.effects.len()).filter(|k| is_it(&plant.effects[*k])).collect();
            let [index] = found[..] else {
                let what = format!("{plant_name} has {} such effects, expected one", found.len());
                let known = plant.effects.iter().map(|it| match &it.arguments.subject {
                    Some(on) => format!("{} on {on}", it.description.kind),
                    None => it.description.kind.to_string(),
                });
                let known = list(&mut { known });
                return refuse(what, format!("its effects are: {}", if known.is_empty() { "none" } else { &known }));
            };
            let entry = &plant.effects[index];
            let described = entry.description.argument(number);
            let given = entry.arguments.numbers.iter().find(|it| it.0 == *number);
            let (Some(argument), Some((name, now))) = (described, given) else {
                let known = list(&mut entry.arguments.numbers.iter().map(|it| it.0.to_string()));
                return refuse(
                    format!("the effect in {plant_name} has no number of this name"),
                    format!("its numbers are {known}"),
                );
            };
            let of_parameter = match (entry.description.subject, &entry.arguments.subject) {
                (Subject::Parameter, Some(name)) => schema::parameters(plant.kind).iter().find(|it| it.name == *name),
                _ => None,
            };
            // The same rule as for plant files: a parameter error keeps the sign that physics requires.
            let bound = of_parameter.map_or(argument.bound, |it| it.bound);
            let unit = argument.unit.on(plant.kind, entry.arguments.subject.as_deref());
            (Number::Effect(index, name), unit, bound, *now)
        }
    };
    let law = match &vary_entry.law {
        Wanted::Known(distribution) => Law::Drawn(distribution.clone()),
        Wanted::Tolerance { within } => {
            let Number::Parameter(name) = of else { return None };
            match plant.tolerance.iter().find(|it| it.0 == name) {
                Some((_, share)) if *share > 0.0 && now != 0.0 => {
                    Law::Drawn(Distribution::Normal { mean: now, sd: share * now.abs(), within: *within })
                }
                _ => {
                    return refuse(format!("{plant_name} has no [tolerance] above 0 for it, or its value is 0"), String::new());
                }
            }
        }
        Wanted::Normal { mean, sd, relative, within } => {
            let mean = mean.unwrap_or(now);
            let sd = sd.unwrap_or_else(|| relative.unwrap_or(0.0) * mean.abs());
            if sd <= 0.0 {
                return refuse("`relative_sd` of a mean of 0 is 0".to_string(), "give `sd`".to_string());
            }
            Law::Drawn(Distribution::Normal { mean, sd, within: *within })
        }
        Wanted::Planned { column } => match plan.map(|plan| plan.settings(column, &unit)) {
            Some(Ok(values)) => Law::Planned(values),
            Some(Err(fault)) => {
                faults.push(fault);
                return None;
            }
            None => return None,
        },
    };
    Some(Place { of, unit, bound, law })
}
