//! A model's evaluators as files.
//!
//! In: a checked model. Out: paths and texts of the model file and of the evaluators in C and Rust. Never writes.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::emit::Unit;
use rsm_core::{compile, emit, model_file};

use crate::outcome::Refusal;

/// The model file in a folder, and its evaluators in the subfolder `emitted`, in every precision that can represent the model; and the unit from
/// which they are printed. A compensator without a proof of stability is refused.
pub fn files(checked: &Checked, folder: &Path) -> Result<(Unit, Vec<(PathBuf, String)>), Refusal> {
    let unit = compile::unit(checked, &[])?;
    let (c, rust) = (emit::c::emit(&unit), emit::rust::emit(&unit));
    let (name, emitted) = (&checked.model().name, folder.join("emitted"));
    let files = vec![
        (folder.join(format!("{name}.toml")), model_file::write(checked.model())),
        (emitted.join(format!("{name}.h")), c.header),
        (emitted.join(format!("{name}.c")), c.source),
        (emitted.join(format!("{name}.rs")), rust),
    ];
    Ok((unit, files))
}
