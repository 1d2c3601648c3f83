//! The functions for build.rs.
//!
//! ```no_run
//! // build.rs
//! rsm_core::build_script::compile("models/throttle.toml", &[]);
//! ```
//!
//! ```ignore
//! // src/lib.rs
//! mod throttle {
//!     include!(concat!(env!("OUT_DIR"), "/throttle.rs"));
//! }
//! ```

use std::path::{Path, PathBuf};

use crate::compile::{self, Parts, RustModule};
use crate::number::Precision;
use crate::source::{Fault, Faults, Source};

/// Compiles a model file to `OUT_DIR/<model>.rs`, and makes cargo run the script again when the file changes. The path is relative to the package.
/// `precisions` empty: every precision that can represent the model. Nothing is written to a source folder.
///
/// # Panics
/// With every fault of the file, so that the build fails with file, line and column; and if cargo's environment is missing.
pub fn compile(model_file: impl AsRef<Path>, precisions: &[Precision]) {
    let model_file = model_file.as_ref();
    println!("cargo::rerun-if-changed={}", model_file.display());
    let folder = std::env::var_os("OUT_DIR").expect("OUT_DIR is set by cargo: call this from build.rs");
    if let Err(faults) = compile_into(model_file, precisions, Path::new(&folder)) {
        panic!("\n{faults}\n");
    }
}

/// As [`compile()`], and after each surface the function of its gradient.
///
/// # Panics
/// As [`compile()`].
pub fn compile_with_gradients(model_file: impl AsRef<Path>, precisions: &[Precision]) {
    compile_with_parts(model_file, precisions, &Parts { gradient: true, ..Parts::default() });
}

/// As [`compile()`], and after each surface the requested parts, such as the step with which it follows measured responses.
///
/// # Panics
/// As [`compile()`]; if a part is not possible.
///
/// ```no_run
/// use rsm_core::build_script;
/// use rsm_core::compile::Parts;
/// use rsm_core::lower::Recursive;
/// use rsm_core::number::Precision;
///
/// // build.rs: a memory of 50 rows with noise of 0.01.
/// let settings = Recursive { forgetting: 0.98, ..Recursive::new(0.01) };
/// let parts = Parts { recursive: vec![("damping_ratio".to_string(), settings)], ..Parts::default() };
/// build_script::compile_with_parts("models/driveline.toml", &[Precision::F32], &parts);
/// ```
pub fn compile_with_parts(model_file: impl AsRef<Path>, precisions: &[Precision], parts: &Parts) {
    let model_file = model_file.as_ref();
    println!("cargo::rerun-if-changed={}", model_file.display());
    let folder = std::env::var_os("OUT_DIR").expect("OUT_DIR is set by cargo: call this from build.rs");
    let module = Source::read(model_file).and_then(|source| compile::rust_with_parts(&source, precisions, parts));
    if let Err(faults) = module.and_then(|module| write_module(&module, Path::new(&folder))) {
        panic!("\n{faults}\n");
    }
}

/// Compiles a model file to `<folder>/<model>.rs` and returns that path.
///
/// # Errors
/// Every fault of the file; a folder that cannot be written.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::build_script;
///
/// let folder = std::env::temp_dir();
/// let file = folder.join(format!("car-{}.toml", std::process::id()));
/// std::fs::write(&file, text).unwrap();
/// let module = build_script::compile_into(&file, &[], &folder)?;
/// assert!(std::fs::read_to_string(&module).unwrap().contains("pub fn drag("));
/// # std::fs::remove_file(file).unwrap();
/// # std::fs::remove_file(module).unwrap();
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
pub fn compile_into(model_file: &Path, precisions: &[Precision], folder: &Path) -> Result<PathBuf, Faults> {
    write_module(&compile::rust(&Source::read(model_file)?, precisions)?, folder)
}

fn write_module(module: &RustModule, folder: &Path) -> Result<PathBuf, Faults> {
    let path = folder.join(format!("{}.rs", module.model));
    // An unchanged file keeps its time stamp, so cargo does not recompile the crates that depend on it.
    if std::fs::read_to_string(&path).is_ok_and(|old| old == module.text) {
        return Ok(path);
    }
    let failed = |error: std::io::Error| {
        Faults::one(Fault::whole_file(&path.display().to_string(), format!("cannot be written: {error}")))
    };
    let temporary = path.with_extension("rs.part");
    std::fs::write(&temporary, &module.text).and_then(|()| std::fs::rename(&temporary, &path)).map_err(failed)?;
    Ok(path)
}
