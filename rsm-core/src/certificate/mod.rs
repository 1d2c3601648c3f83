//! What is certain about a model: theorems over the whole input box, not samples.
//!
//! In: `Checked`. Out: for each surface an enclosure of the true polynomial's range (before `output_range`), and for each precision a bound
//! of |tape - true polynomial, saturated alike| over all arguments of that type in the box, with operations and depth of the tape. Compensators have theirs in `compensator.rs`.

pub mod compensator;

use crate::check::Checked;
use crate::interval::Interval;
use crate::lower;
use crate::number::Precision;
use crate::range;
use crate::rounding;
use crate::source::Faults;

/// What is certain about one surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceCertificate {
    /// The surface.
    pub name: String,
    /// Holds every value of the true polynomial over the box, before `output_range`; in the unit of the response.
    pub range: Interval,
    /// What holds in each precision that was asked for.
    pub tapes: Vec<TapeCertificate>,
}

/// What is certain about one tape.
#[derive(Debug, Clone, PartialEq)]
pub struct TapeCertificate {
    /// The scalar type.
    pub precision: Precision,
    /// Bounds |tape - true polynomial, saturated alike| in the unit of the response; infinite when none can be given.
    pub error: f64,
    /// Arithmetic operations, comparisons and selections.
    pub operations: usize,
    /// The longest chain of dependent operations.
    pub depth: usize,
}

/// The certificate of every surface, in the order of the file.
///
/// # Errors
/// The faults of a precision that cannot hold the model.
pub fn surfaces(checked: &Checked, precisions: &[Precision]) -> Result<Vec<SurfaceCertificate>, Faults> {
    for precision in precisions {
        if let Some(faults) = checked.refusal(*precision) {
            return Err(faults);
        }
    }
    Ok((0..checked.model().surfaces.len()).map(|index| surface(checked, index, precisions)).collect())
}

/// The certificate of one surface in precisions that can hold it.
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
