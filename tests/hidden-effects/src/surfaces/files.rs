//! The files of a case as text.
//!
//! In: inputs, terms, rows. Out: a model file, a table. Every number is written so that it reads back the same.

use std::fmt::Write as _;

use super::polynomial::{Input, Powers};

/// `torque^2*speed`, as reports write terms.
pub fn term_name(inputs: &[Input], powers: &[u32]) -> String {
    let factor = |(input, power): (&Input, &u32)| match power {
        0 => None,
        1 => Some(input.name.to_string()),
        power => Some(format!("{}^{power}", input.name)),
    };
    inputs.iter().zip(powers).filter_map(factor).collect::<Vec<_>>().join("*")
}

/// A model file of one surface, with evidence (rows, scatter) or without.
pub fn model_file(inputs: &[Input], terms: &[(Powers, f64)], evidence: Option<(usize, f64)>) -> String {
    let mut text = String::from("format = 1\nmodel = \"hidden\"\n");
    for input in inputs {
        let [low, high] = input.range;
        let _ = write!(
            text,
            "\n[inputs.{}]\nunit = \"{}\"\nrange = [{low:?}, {high:?}]\noutside = \"clamp\"\n",
            input.name, input.unit
        );
    }
    let names: Vec<String> = inputs.iter().map(|input| format!("\"{}\"", input.name)).collect();
    let _ = write!(text, "\n[surfaces.y]\nunit = \"V\"\ninputs = [{}]\nterms = [\n", names.join(", "));
    for (powers, coefficient) in terms {
        let _ = writeln!(text, "  {{ powers = {powers:?}, coefficient = {coefficient:?} }},");
    }
    text += "]\n";
    if let Some((rows, sd)) = evidence {
        let _ = write!(text, "\n[surfaces.y.evidence]\nrows = {rows}\nresidual_sd = {sd:?}\n");
    }
    text
}

/// New data: inputs, response, and optionally another column and blocks.
pub fn table(
    inputs: &[Input],
    rows: &[Vec<f64>],
    y: &[f64],
    extra: Option<(&Input, &[f64])>,
    blocks: Option<&[usize]>,
) -> String {
    let mut names: Vec<String> = inputs.iter().map(|input| format!("{}[{}]", input.name, input.unit)).collect();
    names.push("y[V]".into());
    names.extend(extra.map(|(input, _)| format!("{}[{}]", input.name, input.unit)));
    names.extend(blocks.map(|_| "block".to_string()));
    let mut text = names.join(",") + "\n";
    for (k, row) in rows.iter().enumerate() {
        let mut cells: Vec<String> = row.iter().chain([&y[k]]).map(|x| format!("{x:?}")).collect();
        cells.extend(extra.map(|(input, z)| format!("{:?}", input.natural(z[k]))));
        cells.extend(blocks.map(|of| format!("B{}", of[k] + 1)));
        text += &(cells.join(",") + "\n");
    }
    text
}
