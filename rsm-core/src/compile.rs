//! The whole compiler in one call: a model file in, source text out.
//!
//! The macro, build.rs and the command line call these functions and no others, so they give the same text and the same errors.

use crate::check::Checked;
use crate::emit::{self, Function, Kind, Unit};
use crate::lower;
use crate::number::Precision;
use crate::source::{Fault, Faults, Source};

/// A model as a Rust module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RustModule {
    /// The name of the model, which is to be the name of the module.
    pub model: String,
    /// The text of the module.
    pub text: String,
}

/// The evaluators of a checked model, ready for a printer. `precisions` empty: every precision that can hold the model.
///
/// # Errors
/// The faults of a precision that was asked for and cannot hold the model; a model with a compensator, which has no evaluator yet.
pub fn unit(checked: &Checked, precisions: &[Precision]) -> Result<Unit, Faults> {
    let model = checked.model();
    if let Some(compensator) = model.compensators.first() {
        let what = format!("compensator `{}`: this version evaluates surfaces only", compensator.name);
        return Err(Faults::one(Fault::whole_file(checked.file(), what)));
    }
    let mut functions = Vec::new();
    for precision in held(checked, precisions)? {
        for (index, surface) in model.surfaces.iter().enumerate() {
            let function = |kind, tape| Function {
                surface: surface.name.clone(),
                kind,
                unit: surface.unit.clone(),
                inputs: checked.inputs_of(surface),
                output_range: surface.output_range,
                tape,
            };
            functions.push(function(Kind::Surface, lower::surface(checked, index, precision)));
            functions.extend(lower::support(checked, index, precision).map(|tape| function(Kind::Support, tape)));
        }
    }
    Ok(Unit { model: model.name.clone(), functions })
}

/// The precisions that were asked for, all of which must hold the model; none asked for: those that do. f64 holds every checked model.
///
/// # Errors
/// The faults of a precision that cannot hold the model.
pub fn held(checked: &Checked, precisions: &[Precision]) -> Result<Vec<Precision>, Faults> {
    if precisions.is_empty() {
        return Ok(Precision::ALL.into_iter().filter(|precision| checked.refusal(*precision).is_none()).collect());
    }
    match precisions.iter().find_map(|precision| checked.refusal(*precision)) {
        Some(faults) => Err(faults),
        None => Ok(precisions.to_vec()),
    }
}

/// A model file as a Rust module.
///
/// # Errors
/// Every fault of the file.
pub fn rust(source: &Source, precisions: &[Precision]) -> Result<RustModule, Faults> {
    let unit = unit(&Checked::read(source)?, precisions)?;
    Ok(RustModule { text: emit::rust::emit(&unit), model: unit.model })
}
