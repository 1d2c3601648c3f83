//! The certificate of the gradient of a surface.
//!
//! In: a checked model, a surface, a precision. Out: for each input the range of the computed derivative over the whole box, and a bound of its
//! difference from the exact derivative. The bound holds where the result does not saturate: at a bound of `output_range` the exact derivative jumps
//! to 0, and a rounded result may jump slightly earlier or later.

use crate::check::Checked;
use crate::interval::Interval;
use crate::lower;
use crate::number::{Precision, exact};
use crate::rounding;
use crate::values::Values;

/// The certificate of the derivative with respect to one input.
#[derive(Debug, Clone, PartialEq)]
pub struct Derivative {
    /// The input.
    pub input: String,
    /// Contains every computed derivative over the box, saturated or not, in the unit of the response per unit of the input. Infinite if there is no
    /// bound.
    pub range: Interval,
    /// The bound of |computed - exact derivative| over the box before `output_range`. Infinite if there is none: at a hinge the derivative jumps, and
    /// a rounded difference may be on the other side.
    pub error: f64,
}

/// The largest number of cells of the box for the ranges.
const CELLS: usize = 4096;

/// The derivatives of a surface, in the order of its inputs.
///
/// # Panics
/// When the precision cannot represent the model: see [`Checked::refusal`].
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{certificate::gradient, number::Precision};
///
/// let by_speed = &gradient::derivatives(&checked, 0, Precision::F64)[0];
/// assert_eq!((by_speed.range.low, by_speed.range.high), (2.0, 2.0)); // N per m/s
/// assert!(by_speed.error < 1e-15);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn derivatives(checked: &Checked, index: usize, precision: Precision) -> Vec<Derivative> {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let ranges: Vec<[f64; 2]> = inputs.iter().map(|input| input.range).collect();
    let errors = rounding::error_bounds(&lower::gradient_before_saturation(checked, index, precision), &ranges);
    let found = ranges_of_results(&lower::gradient(checked, index, precision), &ranges);
    let each = inputs.into_iter().zip(found).zip(errors);
    each.map(|((input, range), error)| Derivative { input: input.name, range, error }).collect()
}

/// The hull of the possible values of every result, over the cells of the box.
fn ranges_of_results(tape: &crate::tape::Tape, ranges: &[[f64; 2]]) -> Vec<Interval> {
    let mut per_side = 1usize;
    while (2 * per_side).checked_pow(ranges.len() as u32).is_some_and(|cells| cells <= CELLS) && per_side < 256 {
        per_side *= 2;
    }
    // The ends are in the box and numbers of the type, like the arguments.
    let end = |[low, high]: [f64; 2], k: usize| {
        let share = k as f64 / per_side as f64;
        let at = (low * (1.0 - share) + high * share).clamp(low, high);
        let (least, most) = (tape.precision.round_up(&exact(low)), tape.precision.round_down(&exact(high)));
        if k == 0 {
            least
        } else if k == per_side {
            most
        } else {
            tape.precision.round(&exact(at)).clamp(least, most)
        }
    };
    let mut values = Values::new(tape);
    let mut hulls: Vec<Option<Interval>> = vec![None; tape.outputs.len()];
    let mut cell = vec![0usize; ranges.len()];
    loop {
        let sides: Vec<Interval> =
            ranges.iter().zip(&cell).map(|(range, k)| Interval { low: end(*range, *k), high: end(*range, k + 1) }).collect();
        let _ = values.over(&sides);
        for (hull, output) in hulls.iter_mut().zip(&tape.outputs) {
            let found = values.of(output.reg);
            *hull = Some(hull.map_or(found, |hull| hull.hull(found)));
        }
        let Some(next) = cell.iter().position(|k| *k + 1 < per_side) else { break };
        cell[next] += 1;
        cell[..next].fill(0);
    }
    hulls.into_iter().map(|hull| hull.expect("a box has a cell")).collect()
}
