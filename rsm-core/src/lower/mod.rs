//! Lowers a checked surface or compensator to a tape.
//!
//! In: `Checked`. Out: `Tape`. Never fails, and rounds each constant once. All decisions about arithmetic are made here: the order of variables, the
//! folding of the coding, the meaning of a clamp. The order of evaluation is part of the result: a change of it changes bits, see CHANGELOG
//! "Generated bits change".
//!
//! ```text
//! argument -> clamp -> variable v, with x = v * scale -> nested sums over powers of v, each level in one of
//!             two forms, scales folded into the coefficients
//!          -> sign of odd inputs -> response of a transform -> those bounds of output_range that a value can reach
//! ```
//!
//! A compensator's surfaces are lowered into its tape by the same code, its filter by `compensator.rs`. A surface that follows measured responses has
//! its coefficients in a state: `recursive.rs`.

mod compensator;
mod gradient;
mod inside;
mod levels;
mod nest;
mod polynomial;
mod recursive;
mod saturation;
mod scheme;
mod spline;
mod transform;
mod variables;

use crate::check::Checked;
use crate::model::{Input, Outside, Surface, Symmetry};
use crate::number::{Precision, Rational, exact, integer};
use crate::tape::{Op, Port, Reg, Tape, TapeBuilder};

use variables::Variables;

pub use crate::names::SIGNAL;
pub use compensator::compensator;
pub use gradient::gradient;
pub(crate) use gradient::gradient_before_saturation;
pub use inside::{Inside, inside};
pub use recursive::{Follower, Frozen, Recursive, recursive, variances_of};
pub use saturation::Saturation;

/// The tape of a surface, by its index in the model.
///
/// # Panics
/// When the precision cannot represent the model: see [`Checked::refusal`].
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{lower, number::Precision, run::Interpreter};
///
/// let tape = lower::surface(&checked, 0, Precision::F64);
/// assert_eq!(tape.inputs, ["speed"]);
/// assert_eq!(Interpreter::<f64>::new(&tape).eval(&[15.0]), 35.0);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn surface(checked: &Checked, index: usize, precision: Precision) -> Tape {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let mut tape = TapeBuilder::new(precision);
    let arguments = arguments(&mut tape, inputs.len());
    let output = value(&mut tape, surface, &inputs, arguments);
    tape.finish(&surface.name, surface.inputs.clone(), output)
}

/// The saturated value of a surface on any tape. `arguments`: the registers of its inputs, in its order.
fn value(tape: &mut TapeBuilder, surface: &Surface, inputs: &[Input], arguments: Vec<Reg>) -> Reg {
    let value = unsaturated(tape, surface, inputs, arguments);
    let Some(saturation) = saturation_of(surface, inputs, tape.precision()) else { return value };
    let [low, high] = saturation.bounds;
    let above = if saturation.below { at_least(tape, value, low) } else { value };
    if saturation.above { at_most(tape, above, high) } else { above }
}

/// The value of a surface before `output_range`.
fn unsaturated(tape: &mut TapeBuilder, surface: &Surface, inputs: &[Input], arguments: Vec<Reg>) -> Reg {
    polynomial_of(tape, surface, inputs, &mut Variables::new(surface, inputs, arguments))
}

/// The value of these variables, before `output_range`.
fn polynomial_of(tape: &mut TapeBuilder, surface: &Surface, inputs: &[Input], variables: &mut Variables<'_>) -> Reg {
    let terms = terms_of(tape, surface, inputs, variables);
    surface.transform.map_or(terms, |transform| transform::lower(tape, transform, surface, inputs, terms))
}

/// The polynomial or spline of these variables, with the sign of odd inputs.
fn terms_of(tape: &mut TapeBuilder, surface: &Surface, inputs: &[Input], variables: &mut Variables<'_>) -> Reg {
    if let Some(spline) = &surface.spline {
        return spline::lower(tape, variables, spline, inputs);
    }
    let terms = polynomial::terms(surface);
    let polynomial = polynomial::lower(tape, variables, surface, &terms);
    let guarded = pass_nan_of_unused_inputs(tape, variables, inputs, polynomial);
    give_sign_of_odd_inputs(tape, variables, surface, inputs, guarded)
}

/// The bounds of `output_range` on the tape of a surface; `None` for a surface without them.
///
/// # Panics
/// When the precision cannot represent the model: see [`Checked::refusal`].
#[must_use]
pub fn saturation(checked: &Checked, index: usize, precision: Precision) -> Option<Saturation> {
    let surface = &checked.model().surfaces[index];
    saturation_of(surface, &checked.inputs_of(surface), precision)
}

fn saturation_of(surface: &Surface, inputs: &[Input], precision: Precision) -> Option<Saturation> {
    let bounds = surface.output_range?;
    let mut tape = TapeBuilder::new(precision);
    let arguments = arguments(&mut tape, inputs.len());
    let output = unsaturated(&mut tape, surface, inputs, arguments);
    Some(Saturation::of(surface, inputs, bounds, &tape.finish(&surface.name, surface.inputs.clone(), output)))
}

/// The tape of a surface's support test: 1 if every half-space holds, otherwise 0. `None` for a surface without `support`. A NaN argument gives 0.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{lower, number::Precision};
///
/// assert!(lower::support(&checked, 0, Precision::F64).is_none()); // the file has no `support`
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn support(checked: &Checked, index: usize, precision: Precision) -> Option<Tape> {
    let surface = &checked.model().surfaces[index];
    if surface.support.is_empty() {
        return None;
    }
    let inputs = checked.inputs_of(surface);
    let mut tape = TapeBuilder::new(precision);
    let arguments = arguments(&mut tape, inputs.len());
    let mut variables = Variables::unclamped(surface, &inputs, arguments);
    let (zero, one) = (tape.constant(integer(0)), tape.constant(integer(1)));
    let inside = half_spaces(&mut tape, surface, &mut variables, one, zero);
    Some(tape.finish(format!("{}_support", surface.name), surface.inputs.clone(), inside))
}

/// `inside` if every half-space of the support holds, else `zero`.
fn half_spaces(tape: &mut TapeBuilder, surface: &Surface, variables: &mut Variables<'_>, inside: Reg, zero: Reg) -> Reg {
    let mut inside = inside;
    for space in &surface.support {
        // sum of normal_k x_k with x_k = v_k scale_k
        let mut sum: Option<Reg> = None;
        for (k, entry) in space.normal.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
            let variable = variables.of(tape, k);
            let weight = exact(*entry) * &variable.scale;
            let product = if polynomial::is_ordinary(tape.precision(), &weight) {
                tape.times(variable.value, weight)
            } else {
                let divisor = tape.constant(integer(1) / variable.scale);
                let coded = tape.push(Op::Divide(variable.value, divisor));
                tape.times(coded, exact(*entry))
            };
            sum = Some(sum.map_or(product, |sum| tape.push(Op::Add(sum, product))));
        }
        let sum = sum.expect("a checked normal is not zero");
        // not (sum <= bound): with NaN the comparison below is false, and 0 is selected. `sum <= bound` is `sum < next number above bound`.
        let bound = exact(space.bound);
        let precision = tape.precision();
        let above = precision.next_up(precision.round_down(&bound));
        let limit = tape.rounded_constant(above, exact(above));
        let condition = tape.push(Op::Less(sum, limit));
        inside = tape.push(Op::Select { condition, then: inside, otherwise: zero });
    }
    inside
}

/// A lower bound, rounded into the range, so that the result is never outside. NaN passes.
fn at_least(tape: &mut TapeBuilder, value: Reg, low: f64) -> Reg {
    let low = exact(low);
    let bound = tape.rounded_constant(tape.precision().round_up(&low), low);
    tape.at_least(value, bound)
}

fn at_most(tape: &mut TapeBuilder, value: Reg, high: f64) -> Reg {
    let high = exact(high);
    let bound = tape.rounded_constant(tape.precision().round_down(&high), high);
    tape.at_most(value, bound)
}

/// A NaN in an input that no term contains also makes the result NaN: v - v is 0 for a number and NaN for NaN. (An infinite value of an unused input
/// that extrapolates gives NaN too; one that clamps is finite here.)
fn pass_nan_of_unused_inputs(tape: &mut TapeBuilder, variables: &mut Variables<'_>, inputs: &[Input], value: Reg) -> Reg {
    let mut guarded = value;
    for k in 0..inputs.len() {
        if !variables.is_used(k) {
            let seen = variables.seen(tape, k);
            let nothing = tape.push(Op::Subtract(seen, seen));
            guarded = tape.push(Op::Add(guarded, nothing));
        }
    }
    guarded
}

/// y(-xi) = -y(xi) for each odd input.
fn give_sign_of_odd_inputs(
    tape: &mut TapeBuilder,
    variables: &Variables<'_>,
    surface: &Surface,
    inputs: &[Input],
    value: Reg,
) -> Reg {
    let mut signed = value;
    for (name, _) in surface.symmetry.iter().filter(|(_, symmetry)| *symmetry == Symmetry::Odd) {
        let k = inputs.iter().position(|input| input.name == *name).expect("a checked symmetry names an input");
        let zero = tape.constant(integer(0));
        let condition = tape.push(Op::Less(variables.argument(k), zero));
        let negated = tape.push(Op::Negate(signed));
        signed = tape.push(Op::Select { condition, then: negated, otherwise: signed });
    }
    signed
}

/// The arguments of a tape, one register each, written first so that ports and registers have the same numbers.
fn arguments(tape: &mut TapeBuilder, count: usize) -> Vec<Reg> {
    (0..count).map(|k| tape.push(Op::Input(Port(k as u32)))).collect()
}

/// Whether an evaluator clamps this input.
fn is_clamped(input: &Input) -> bool {
    input.outside == Outside::Clamp
}

/// A variable of the polynomial on the tape: x = value * scale, exactly except for the rounding of `value`.
#[derive(Debug, Clone)]
struct Lowered {
    value: Reg,
    scale: Rational,
}
