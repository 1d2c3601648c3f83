//! Values of expressions of known numbers, as files of effects have them.
//!
//! In: an expression of a file, names with their values. Out: its value, or the fault at its place.

use std::collections::HashMap;

use rsm_core::source::{Faults, Source};

use crate::flat::{Basic, Flat, Options, Value};
use crate::syntax::tree::Expression;

/// A system without equations, for expressions of known numbers.
pub(super) fn scratch() -> Result<Flat, Faults> {
    Flat::read(&Source::new("", "model Scales\nend Scales;\n"), &Options::default())
}

/// The value of an expression of known names.
pub(super) fn known_number(
    source: &Source,
    scratch: &mut Flat,
    law: &Expression,
    known: &HashMap<String, f64>,
) -> Result<f64, Faults> {
    let mut names = HashMap::new();
    for (name, value) in known {
        names.insert(name.clone(), Value::scalar(scratch.pool.number(*value), Basic::Real));
    }
    let value = scratch.expression(source, law, Some(&names))?;
    let found = value.item().and_then(|it| scratch.known(it)).map(|it| it.0).filter(|it| it.is_finite());
    found.ok_or_else(|| Faults::one(source.fault(law.span.clone(), "this has no finite value")))
}

/// The value of an expression in the file of an effect with these numbers.
pub(super) fn evaluated(source: &Source, law: &Expression, numbers: &[(&str, f64)]) -> Result<f64, Faults> {
    let known = numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
    known_number(source, &mut scratch()?, law, &known)
}
