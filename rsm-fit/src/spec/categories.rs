//! Categories and blocks: columns of text in a fit specification.
//!
//! In: the table of an input with `categories`; a whole specification. Out: a [`Category`] with the inputs that are its contrasts; faults where
//! categories or blocks do not fit the rest. Data are not used.

use rsm_core::model::{Category, Outside, Symmetry};
use rsm_core::places::Places;
use rsm_core::source::Collector;
use rsm_core::toml_reader::TableReader;

use super::{Form, InputSpec, ResponseSpec, Specification};

/// The most levels: with more, most have few rows, and each needs an input of its own.
const MOST_LEVELS: usize = 100;

/// The unit and the range of a contrast, which is -1, 0 or 1.
pub(crate) const CONTRAST: [f64; 2] = [-1.0, 1.0];

impl InputSpec {
    /// The input of a level of a category.
    pub(crate) fn contrast(name: &str) -> Self {
        InputSpec {
            name: name.to_string(),
            column: name.to_string(),
            unit: Some("1".to_string()),
            range: Some(CONTRAST),
            outside: Outside::Clamp,
            period: None,
        }
    }
}

/// An input that is a category, with its name in the specification. `None`: it is no category; `Some(None)`: there is a fault.
pub(super) fn read(
    path: &str,
    name: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<(String, Category)>> {
    let value = reader.optional("categories")?;
    let span = value.span();
    let levels = reader.texts("`categories`", value, faults);
    let column = reader.optional_text("column", faults);
    let additive = reader.optional_flag("additive", faults);
    let (Some(levels), Some(additive)) = (levels, additive) else { return Some(None) };
    let levels = levels.into_iter().map(|(level, _)| level).collect();
    let category = Category { additive, ..Category::new(name, levels) };
    places.note(format!("{path}.categories"), span.clone());
    for input in &category.inputs {
        places.note(format!("inputs.{input}"), span.clone());
    }
    let category = Category { name: column.unwrap_or_else(|| name.to_string()), ..category };
    Some(Some((name.to_string(), category)))
}

pub(super) fn check(specification: &Specification, faults: &mut Collector) {
    for category in &specification.categories {
        check_levels(specification, category, faults);
        for response in &specification.responses {
            check_use(specification, category, response, faults);
        }
    }
    check_blocks(specification, faults);
}

fn check_levels(specification: &Specification, category: &Category, faults: &mut Collector) {
    let place = category.inputs.first().map_or("inputs".to_string(), |name| format!("inputs.{name}"));
    let levels = &category.levels;
    let mut fault = |what: String| {
        faults.push(specification.fault(&place, format!("input `{}`: `categories`: {what}", category.name)));
    };
    if !(2..=MOST_LEVELS).contains(&levels.len()) {
        fault(format!("found {} levels, expected 2 to {MOST_LEVELS}", levels.len()));
    }
    for (k, level) in levels.iter().enumerate().filter(|(k, level)| levels[..*k].contains(level)) {
        fault(format!("`{level}` is given twice, the second time as number {}", k + 1));
    }
    for (k, name) in category.inputs.iter().enumerate() {
        let first = category.inputs[..k].iter().position(|earlier| earlier == name);
        if let Some(first) = first.filter(|first| levels[*first] != levels[k]) {
            let what = format!("`{}` and `{}` both make an input `{name}`", levels[first], levels[k]);
            fault(format!("{what}: rename one of them in the data"));
        }
    }
}

fn check_use(specification: &Specification, category: &Category, response: &ResponseSpec, faults: &mut Collector) {
    let surface = &response.surface;
    let path = format!("responses.{}", surface.name);
    let used = category.inputs.iter().filter(|name| surface.inputs.contains(name)).count();
    if used == 0 {
        return;
    }
    let mut fault = |what: &str, help: &str| {
        let what = format!("response `{}`: input `{}`: {what}", surface.name, category.name);
        let fault = specification.fault(&format!("{path}.inputs"), what);
        faults.push(if help.is_empty() { fault } else { fault.help(help.to_string()) });
    };
    if used < category.inputs.len() {
        fault("found some of its contrasts, expected all or none", "name the category itself in `inputs`");
    }
    if category.inputs.iter().any(|name| surface.has_form(name)) {
        fault("a category cannot have `symmetry`, `knots`, `sigmoids`, `waves` or `reciprocal`", "");
    }
    if uses_spline(response) {
        fault("a spline cannot have a category", "fit a spline for each level, or use terms");
    }
}

fn uses_spline(response: &ResponseSpec) -> bool {
    response.spline.is_some() || response.forms.iter().flatten().any(|form| *form == Form::Spline)
}

fn check_blocks(specification: &Specification, faults: &mut Collector) {
    let blocks = &specification.blocks;
    let mut fault = |what: String, help: &str| {
        faults.push(specification.fault("blocks", format!("`blocks`: {what}")).help(help.to_string()));
    };
    for (k, name) in blocks.iter().enumerate() {
        if blocks[..k].contains(name) {
            fault(format!("column `{name}` is given twice"), "give each column once");
        }
        if specification.groups().contains(&name.as_str()) {
            let what = format!("column `{name}` is in `keep_together` too, and without its rows a block has no effect");
            fault(what, "use `blocks` if new rows are of the same blocks, `keep_together` if they are of new ones");
        }
        let is_category = specification.categories.iter().any(|category| category.name == *name);
        if is_category || specification.inputs.iter().any(|input| input.column == *name) {
            fault(
                format!("column `{name}` is an input too"),
                "an input is part of the model, a block is not: remove one of them",
            );
        }
    }
    for response in specification.responses.iter().filter(|_| !blocks.is_empty()) {
        let name = &response.surface.name;
        if uses_spline(response) {
            fault(format!("response `{name}` is a spline, which has no terms for blocks"), "use terms, or remove `blocks`");
        }
        if response.surface.symmetry.iter().any(|(_, kind)| *kind == Symmetry::Odd) {
            fault(format!("response `{name}` is odd in an input, and the effect of a block is not"), "remove one of them");
        }
    }
}
