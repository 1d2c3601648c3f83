//! `effect_files` of a plant file of format 2: files of effects that belong to one plant.
//!
//! In: the names in the plant file, a catalogue. Out: the catalogue with these effects.

use std::sync::Arc;

use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::TableReader;
use rsm_model::effects::Catalogue;

/// The key in a plant file.
pub(crate) const KEY: &str = "effect_files";

/// The names of the files. Faults go to `faults`.
pub(super) fn read(top: &mut TableReader<'_>, faults: &mut Collector) -> Vec<String> {
    let source = top.source();
    let Some(value) = top.optional(KEY) else { return Vec::new() };
    let names =
        value.get_ref().as_array().map(|list| list.iter().map(|it| it.get_ref().as_str().map(str::to_string)).collect());
    names.flatten().unwrap_or_else(|| {
        faults.push(
            source.fault(value.span(), format!("`{KEY}`: expected a list of file names, as in `{KEY} = [\"law.toml\"]`")),
        );
        Vec::new()
    })
}

/// The catalogue with the effects of these files.
///
/// # Errors
/// A file that cannot be read; faults of an effect; a kind that is already in the catalogue.
pub(super) fn added(
    catalogue: &Arc<Catalogue>,
    files: &[String],
    open: &dyn Fn(&str) -> Result<Source, Faults>,
) -> Result<Arc<Catalogue>, Faults> {
    if files.is_empty() {
        return Ok(catalogue.clone());
    }
    let sources = files.iter().map(|name| open(name)).collect::<Result<Vec<Source>, Faults>>()?;
    let mut with = Catalogue::clone(catalogue);
    with.add(&sources)?;
    Ok(Arc::new(with))
}
