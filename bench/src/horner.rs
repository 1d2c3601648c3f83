//! Nested Horner as written by hand in C: the emitted code is compared with it.
//!
//! In: a polynomial of coded variables. Out: one expression, with the first variable outermost, after one line x = (xi - mid) * (1/half) for each
//! variable. This is the peers' `horner`: without a clamp and without a guarantee of bits.

use std::fmt::Write as _;

use rsm_core::model::{Model, Term};
use rsm_core::number::{Precision, decimal, decimal_f32};

/// The way a C function gets its arguments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arguments {
    /// One parameter for each input, as in the emitted functions.
    Values,
    /// `const REAL *in`, as in the peers' benchmark; static, so that it is inlined.
    Pointer,
}

/// A C function `name` of the natural inputs, for the only surface of a model with coding by range and no other options.
#[must_use]
pub fn function(name: &str, arguments: Arguments, model: &Model, precision: Precision) -> String {
    let float = crate::toolchain::c_type(precision);
    let values: Vec<String> = (0..model.inputs.len()).map(|k| format!("{float} in{k}")).collect();
    let mut text = match arguments {
        Arguments::Values => format!("{float} {name}({}) {{\n", values.join(", ")),
        Arguments::Pointer => format!("static {float} {name}(const {float} *in) {{\n"),
    };
    for (k, input) in model.inputs.iter().enumerate() {
        let [low, high] = input.range;
        let (mid, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let (mid, inverse) = (literal(mid, precision), literal(1.0 / half, precision));
        let value = if arguments == Arguments::Values { format!("in{k}") } else { format!("in[{k}]") };
        writeln!(text, "  const {float} x{k} = ({value} - {mid}) * {inverse};").expect("a string takes any text");
    }
    let terms: Vec<&Term> = model.surfaces[0].terms.iter().collect();
    writeln!(text, "  return {};\n}}", nested(&terms, 0, precision)).expect("a string takes any text");
    text
}

/// The nested form c_0 + x (c_1 + x (c_2 + ...)); each c_j is a polynomial in the variables after x.
fn nested(terms: &[&Term], variable: usize, precision: Precision) -> String {
    let Some(degree) = terms.iter().filter_map(|term| term.powers.get(variable)).max() else {
        return literal(terms[0].coefficient, precision);
    };
    let mut sum: Option<String> = None;
    for power in (0..=*degree).rev() {
        let of_power: Vec<&Term> = terms.iter().copied().filter(|term| term.powers[variable] == power).collect();
        let coefficient = (!of_power.is_empty()).then(|| nested(&of_power, variable + 1, precision));
        sum = match (coefficient, sum) {
            (coefficient, None) => coefficient,
            (Some(coefficient), Some(above)) => Some(format!("({coefficient} + x{variable} * ({above}))")),
            (None, Some(above)) => Some(format!("x{variable} * ({above})")),
        };
    }
    sum.expect("the highest power has a term")
}

fn literal(value: f64, precision: Precision) -> String {
    match precision {
        Precision::F64 => decimal(value),
        Precision::F32 => format!("{}f", decimal_f32(value)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_is_nested_from_the_first_variable() {
        let term = |powers: [u32; 2], coefficient| Term { powers: powers.to_vec(), coefficient };
        let terms = [term([0, 0], 1.0), term([0, 1], 2.0), term([2, 0], 3.0), term([1, 1], 4.0)];
        let terms: Vec<&Term> = terms.iter().collect();
        assert_eq!(nested(&terms, 0, Precision::F64), "((1.0 + x1 * (2.0)) + x0 * ((x1 * (4.0) + x0 * (3.0))))");
        let without_linear = [terms[0], terms[2]];
        assert_eq!(nested(&without_linear, 0, Precision::F32), "(1.0f + x0 * (x0 * (3.0f)))");
    }
}
