//! The certificates of a model: statements that are proved over the whole input box.
//!
//! In: `Checked`. Out: for each surface an enclosure of the true polynomial's range (before `output_range`), and for each precision a bound of
//! |tape - true polynomial, with the same saturation| over all arguments of that type in the box, with operations and depth of the tape.
//! Compensators: see `compensator.rs`.

pub mod compensator;
pub mod gradient;

use crate::check::Checked;
use crate::interval::Interval;
use crate::lower;
use crate::number::Precision;
use crate::range;
use crate::rounding;
use crate::source::Faults;

/// The certificate of one surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceCertificate {
    /// The surface.
    pub name: String,
    /// Contains every value of the true polynomial over the box, before `output_range`; in the unit of the response.
    pub range: Interval,
    /// The certificates for the requested precisions.
    pub tapes: Vec<TapeCertificate>,
}

/// The certificate of one tape.
#[derive(Debug, Clone, PartialEq)]
pub struct TapeCertificate {
    /// The scalar type.
    pub precision: Precision,
    /// The bound of |tape - true polynomial, with the same saturation| in the unit of the response; infinite if there is none.
    pub error: f64,
    /// Arithmetic operations, comparisons and selections.
    pub operations: usize,
    /// The longest chain of dependent operations.
    pub depth: usize,
}

/// The certificate of every surface, in the order of the file.
///
/// # Errors
/// The faults of a precision that cannot represent the model.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{certificate, number::Precision};
///
/// let of_drag = &certificate::surfaces(&checked, &[Precision::F64])?[0];
/// assert!(of_drag.range.low <= 5.0 && 65.0 <= of_drag.range.high);
/// assert!(of_drag.tapes[0].error < 1e-13); // N, of 65
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn surfaces(checked: &Checked, precisions: &[Precision]) -> Result<Vec<SurfaceCertificate>, Faults> {
    for precision in precisions {
        if let Some(faults) = checked.refusal(*precision) {
            return Err(faults);
        }
    }
    Ok((0..checked.model().surfaces.len()).map(|index| surface(checked, index, precisions)).collect())
}

/// The certificate of one surface, in precisions that can represent it.
#[must_use]
pub fn surface(checked: &Checked, index: usize, precisions: &[Precision]) -> SurfaceCertificate {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let ranges: Vec<[f64; 2]> = inputs.iter().map(|input| input.range).collect();
    let tapes = precisions.iter().map(|precision| {
        let tape = lower::surface(checked, index, *precision);
        let error = rounding::error_bound(&tape, &ranges);
        TapeCertificate { precision: *precision, error, operations: tape.operation_count(), depth: tape.depth() }
    });
    SurfaceCertificate { name: surface.name.clone(), range: range::range(surface, &inputs), tapes: tapes.collect() }
}

#[cfg(test)]
mod tests;
