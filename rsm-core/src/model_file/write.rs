//! Writes the model file: a [`Model`] to TOML text.
//!
//! In: a model. Out: text that reads back to the same model bit for bit, with small differences between versions.

use std::fmt::Write as _;

use super::FORMAT;
use crate::model::{
    Category, Coding, Compensator, Evidence, HalfSpace, Knot, Model, Outside, Scheduled, Sigmoid, Spline, Surface, Symmetry,
    Wave,
};
use crate::number::decimal;

/// The text of a model file. Reading it gives the same model bit for bit.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{check::Checked, model_file, source::Source};
///
/// let written = model_file::write(checked.model());
/// assert_eq!(Checked::read(&Source::new("car.toml", written))?.model(), checked.model());
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn write(model: &Model) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "format = {FORMAT}\nmodel = {}", quoted(&model.name));
    for input in &model.inputs {
        let [low, high] = input.range.map(decimal);
        let outside = match input.outside {
            Outside::Clamp => "clamp",
            Outside::Extrapolate => "extrapolate",
        };
        let (name, unit) = (&input.name, quoted(&input.unit));
        let _ = writeln!(out, "\n[inputs.{name}]\nunit = {unit}\nrange = [{low}, {high}]\noutside = \"{outside}\"");
    }
    for surface in &model.surfaces {
        write_surface(&mut out, surface);
    }
    for compensator in &model.compensators {
        let Compensator { name, sample_time, .. } = compensator;
        let _ = writeln!(out, "\n[compensators.{name}]\nsample_time = {}", decimal(*sample_time));
        for (key, scheduled) in compensator.parts() {
            let _ = writeln!(out, "{key} = {}", scheduled_text(scheduled));
        }
    }
    out
}

fn write_surface(out: &mut String, surface: &Surface) {
    let name = &surface.name;
    let _ = writeln!(out, "\n[surfaces.{name}]\nunit = {}\ninputs = {}", quoted(&surface.unit), texts(&surface.inputs));
    if let Some([low, high]) = surface.output_range {
        let _ = writeln!(out, "output_range = [{}, {}]", decimal(low), decimal(high));
    }
    if surface.coding == Coding::None {
        let _ = writeln!(out, "coding = \"none\"");
    }
    if !surface.symmetry.is_empty() {
        let entry = |(input, symmetry): &(String, Symmetry)| match symmetry {
            Symmetry::Even => format!("{input} = \"even\""),
            Symmetry::Odd => format!("{input} = \"odd\""),
        };
        let entries: Vec<_> = surface.symmetry.iter().map(entry).collect();
        let _ = writeln!(out, "symmetry = {{ {} }}", entries.join(", "));
    }
    if !surface.knots.is_empty() {
        let entry = |knot: &Knot| format!("{{ input = {}, at = {} }}", quoted(&knot.input), decimal(knot.at));
        let entries: Vec<_> = surface.knots.iter().map(entry).collect();
        let _ = writeln!(out, "knots = [{}]", entries.join(", "));
    }
    if !surface.sigmoids.is_empty() {
        let entry = |Sigmoid { input, at, width }: &Sigmoid| {
            format!("{{ input = {}, at = {}, width = {} }}", quoted(input), decimal(*at), decimal(*width))
        };
        let entries: Vec<_> = surface.sigmoids.iter().map(entry).collect();
        let _ = writeln!(out, "sigmoids = [{}]", entries.join(", "));
    }
    if !surface.waves.is_empty() {
        let entry = |Wave { input, period, order }: &Wave| {
            format!("{{ input = {}, period = {}, order = {order} }}", quoted(input), decimal(*period))
        };
        let entries: Vec<_> = surface.waves.iter().map(entry).collect();
        let _ = writeln!(out, "waves = [{}]", entries.join(", "));
    }
    if !surface.reciprocal.is_empty() {
        let _ = writeln!(out, "reciprocal = {}", texts(&surface.reciprocal));
    }
    if !surface.categories.is_empty() {
        let entry = |Category { name, levels, inputs, additive }: &Category| {
            let additive = if *additive { ", additive = true" } else { "" };
            format!("{{ name = {}, levels = {}, inputs = {}{additive} }}", quoted(name), texts(levels), texts(inputs))
        };
        let entries: Vec<_> = surface.categories.iter().map(entry).collect();
        let _ = writeln!(out, "categories = [{}]", entries.join(", "));
    }
    if let Some(transform) = surface.transform {
        let _ = writeln!(out, "transform = {}", quoted(transform.word()));
    }
    if let Some(Spline { degree, cells, coefficients }) = &surface.spline {
        let counts: Vec<_> = cells.iter().map(u32::to_string).collect();
        let _ = writeln!(out, "spline = {{ degree = {degree}, cells = [{}], coefficients = [", counts.join(", "));
        // One line for each coefficient along the inputs before the last.
        let last = cells.last().map_or(1, |cells| (cells + degree) as usize);
        for row in coefficients.chunks(last.max(1)) {
            let row: Vec<_> = row.iter().copied().map(decimal).collect();
            let _ = writeln!(out, "  {},", row.join(", "));
        }
        let _ = writeln!(out, "] }}");
    }
    if !surface.terms.is_empty() || surface.spline.is_none() {
        write_terms(out, surface);
    }
    if !surface.support.is_empty() {
        let _ = writeln!(out, "support = [");
        for HalfSpace { normal, bound } in &surface.support {
            let normal: Vec<_> = normal.iter().copied().map(decimal).collect();
            let _ = writeln!(out, "  {{ normal = [{}], bound = {} }},", normal.join(", "), decimal(*bound));
        }
        let _ = writeln!(out, "]");
    }
    if !surface.evidence.is_empty() {
        let _ = writeln!(out, "\n[surfaces.{name}.evidence]");
        for (key, value) in &surface.evidence {
            let _ = writeln!(out, "{} = {}", key_text(key), evidence_text(value));
        }
    }
}

fn write_terms(out: &mut String, surface: &Surface) {
    let _ = writeln!(out, "terms = [");
    for term in &surface.terms {
        let powers: Vec<_> = term.powers.iter().map(u32::to_string).collect();
        let _ = writeln!(out, "  {{ powers = [{}], coefficient = {} }},", powers.join(", "), decimal(term.coefficient));
    }
    let _ = writeln!(out, "]");
}

fn scheduled_text(scheduled: &Scheduled) -> String {
    match scheduled {
        Scheduled::Fixed(value) => decimal(*value),
        Scheduled::Surface(name) => format!("{{ surface = {} }}", quoted(name)),
        Scheduled::Sum(names) => format!("{{ sum = {} }}", texts(names)),
    }
}

fn evidence_text(value: &Evidence) -> String {
    match value {
        Evidence::Whole(whole) => whole.to_string(),
        Evidence::Number(number) if number.is_nan() => "nan".into(),
        Evidence::Number(number) => decimal(*number),
        Evidence::Flag(flag) => flag.to_string(),
        Evidence::Text(text) => quoted(text),
        Evidence::List(items) => format!("[{}]", items.iter().map(evidence_text).collect::<Vec<_>>().join(", ")),
        Evidence::Table(entries) => {
            let entries: Vec<_> =
                entries.iter().map(|(key, item)| format!("{} = {}", key_text(key), evidence_text(item))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
    }
}

fn key_text(key: &str) -> String {
    let bare = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { key.to_string() } else { quoted(key) }
}

fn texts(items: &[String]) -> String {
    format!("[{}]", items.iter().map(|item| quoted(item)).collect::<Vec<_>>().join(", "))
}

/// A TOML basic string.
#[must_use]
pub fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            '\t' => out.push_str("\\t"),
            '\r' => out.push_str("\\r"),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", c as u32);
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Input, Term, Transform};
    use crate::model_file::read;
    use crate::source::{Collector, Source};

    #[test]
    fn what_is_written_reads_back_to_the_same_model() {
        let knot = Knot { input: "b".into(), at: 0.1 + 0.2 };
        let surface = Surface {
            name: "s".into(),
            unit: "V*s \"peak\"\n".into(),
            inputs: vec!["b".into(), "a".into()],
            output_range: Some([-1e-310, 1e300]),
            coding: Coding::None,
            symmetry: vec![("a".into(), Symmetry::Odd)],
            knots: vec![knot],
            sigmoids: vec![Sigmoid { input: "a".into(), at: -0.1, width: 1.0 / 3.0 }],
            waves: vec![Wave { input: "b".into(), period: 0.1, order: 12 }],
            spline: Some(Spline { degree: 3, cells: vec![1, 2], coefficients: vec![1.0 / 3.0, -0.0, 5e-324, 1e300, -2.5] }),
            reciprocal: vec!["b".into()],
            categories: vec![
                Category::new("fuel", vec!["E10 \"plus\"".into(), "diesel".into()]),
                Category { additive: true, ..Category::new("day", vec!["1".into(), "2".into(), "3".into()]) },
            ],
            transform: Some(Transform::ReciprocalSquareRoot),
            terms: vec![
                Term { powers: vec![0, 1, 0, 0, 0, 0], coefficient: -0.0 },
                Term { powers: vec![3, 1, 2, 1, 0, 1], coefficient: 5e-324 },
            ],
            support: vec![HalfSpace { normal: vec![1.0, -1.0 / 3.0], bound: 1.2 }],
            evidence: vec![
                ("rows".into(), Evidence::Whole(-3)),
                ("a key".into(), Evidence::List(vec![Evidence::Number(f64::INFINITY), Evidence::Flag(true)])),
                ("nested".into(), Evidence::Table(vec![("text".into(), Evidence::Text("\u{1}".into()))])),
            ],
        };
        let compensator = Compensator {
            name: "k".into(),
            sample_time: 0.001,
            natural_frequency: Scheduled::Fixed(9.5),
            zero_damping: Scheduled::Surface("s".into()),
            pole_damping: Scheduled::Sum(vec!["s".into(), "s".into()]),
            pole_frequency: Some(Scheduled::Fixed(0.1)),
        };
        let input = |name: &str, outside| Input { name: name.into(), unit: "1".into(), range: [0.5, 1.0], outside };
        let model = Model {
            name: "m".into(),
            inputs: vec![input("b", Outside::Clamp), input("a", Outside::Extrapolate)],
            surfaces: vec![surface],
            compensators: vec![compensator],
        };
        let source = Source::new("m.toml", write(&model));
        let mut faults = Collector::new();
        let located = read(&source, &mut faults).unwrap();
        assert!(faults.is_clean(), "{faults:?}");
        assert_eq!(located.model, model, "{}", source.text());
        // PartialEq takes -0 for 0: the sign too must survive.
        assert!(located.model.surfaces[0].terms[0].coefficient.is_sign_negative());
    }
}
