//! Lowers the gradient of a surface: its derivatives with respect to its inputs, in the unit of the response per unit of the input.
//!
//! In: `Checked`. Out: a tape with one result for each input, from the tangent of the surface's own tape. Outside the range of a clamped input the
//! derivative with respect to it is 0, and all are 0 where the result saturates at `output_range`. A NaN argument gives NaN: y - y, which is 0 for a
//! number, is added to every derivative.

use crate::check::Checked;
use crate::model::{Input, Surface};
use crate::number::Precision;
use crate::tangent::{self, Variable};
use crate::tape::{Reg, Seam, Tape, TapeBuilder};

/// The tape of a surface's gradient, by the surface's index in the model.
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
/// let tape = lower::gradient(&checked, 0, Precision::F64);
/// let mut drag = Interpreter::<f64>::new(&tape);
/// assert_eq!(drag.eval(&[15.0]), 2.0); // N per m/s
/// assert_eq!(drag.eval(&[31.0]), 0.0); // clamped
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn gradient(checked: &Checked, index: usize, precision: Precision) -> Tape {
    let surface = &checked.model().surfaces[index];
    of(&super::surface(checked, index, precision), surface, &ranges_of(&checked.inputs_of(surface)))
}

fn ranges_of(inputs: &[Input]) -> Vec<[f64; 2]> {
    inputs.iter().map(|input| input.range).collect()
}

/// The gradient before `output_range`, valid where the result does not saturate.
pub(crate) fn gradient_before_saturation(checked: &Checked, index: usize, precision: Precision) -> Tape {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let mut tape = TapeBuilder::new(precision);
    let arguments = super::arguments(&mut tape, inputs.len());
    let output = super::unsaturated(&mut tape, surface, &inputs, arguments);
    of(&tape.finish(&surface.name, surface.inputs.clone(), output), surface, &ranges_of(&inputs))
}

fn of(tape: &Tape, surface: &Surface, ranges: &[[f64; 2]]) -> Tape {
    let mut builder = TapeBuilder::sharing(tape.precision);
    let inputs = super::arguments(&mut builder, surface.inputs.len());
    let variables: Vec<Variable> = (0..inputs.len()).map(Variable::Input).collect();
    let written = tangent::write(&mut builder, tape, &inputs, &[], &variables);
    let value = written.values[0];
    let nothing = builder.subtract(value, value);
    let derivatives: Vec<Reg> = written.derivatives[0].iter().map(|derivative| builder.add(*derivative, nothing)).collect();
    if let Some(spline) = &surface.spline {
        let arguments: Vec<Reg> = builder.seams().iter().map(|seam| seam.argument).collect();
        let sizes = super::spline::jumps_of_derivatives(spline, ranges);
        for (result, sizes) in derivatives.iter().zip(sizes) {
            for (argument, (power, size)) in arguments.iter().zip(sizes) {
                builder.add_seam(Seam { result: *result, argument: *argument, power, size });
            }
        }
    }
    let outputs = surface.inputs.iter().cloned().zip(derivatives);
    builder.finish_with_results(format!("{}_gradient", surface.name), surface.inputs.clone(), outputs, [] as [(String, Reg); 0])
}
