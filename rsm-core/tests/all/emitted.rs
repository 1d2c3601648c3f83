//! The output of the printers, byte for byte: the models of `generated/`, and cases with every option of the file. `RSM_BLESS=1` rewrites the cases
//! (`cargo xtask bless` also `generated/`); the difference is reviewed like code.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::emit::{self, Unit};
use rsm_core::number::Precision;
use rsm_core::source::Source;

fn models(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    found.sort();
    found
}

fn unit(path: &Path, precisions: &[Precision], gradients: bool) -> Unit {
    let checked = Checked::read(&Source::read(path).unwrap()).unwrap_or_else(|faults| panic!("{faults}"));
    let unit = if gradients { compile::unit_with_gradients } else { compile::unit };
    unit(&checked, precisions).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The files of a unit: name and text.
fn texts(unit: &Unit) -> Vec<(&'static str, String)> {
    let c = emit::c::emit(unit);
    vec![("rs", emit::rust::emit(unit)), ("h", c.header), ("c", c.source)]
}

fn assert_same(path: &Path, found: &str) {
    let expected = std::fs::read_to_string(path).unwrap_or_default();
    let same = expected.lines().zip(found.lines()).take_while(|(old, new)| old == new).count();
    assert!(expected == found, "{} differs from line {}: {:?}", path.display(), same + 1, found.lines().nth(same));
}

#[test]
fn every_option_is_printed_as_it_was() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/emitted");
    let models = models(&folder);
    assert!(models.len() >= 3, "only {} cases found", models.len());
    for path in models {
        // A file with only one precision has its own helpers and refusals: the smallest case shows them.
        let all: &[(&str, &[Precision])] = if path.ends_with("small.toml") {
            &[("", &[]), ("-f64", &[Precision::F64]), ("-f32", &[Precision::F32]), ("-gradient", &[])]
        } else {
            &[("", &[])]
        };
        for (suffix, precisions) in all {
            for (extension, text) in texts(&unit(&path, precisions, *suffix == "-gradient")) {
                let stem = path.file_stem().unwrap().to_str().unwrap();
                let expected = folder.join(format!("{stem}{suffix}.{extension}.txt"));
                if std::env::var_os("RSM_BLESS").is_some() {
                    std::fs::write(&expected, text).unwrap();
                } else {
                    assert_same(&expected, &text);
                }
            }
        }
    }
}

#[test]
fn generated_models_are_printed_as_they_are_checked_in() {
    let generated = Path::new(env!("CARGO_MANIFEST_DIR")).join("../generated");
    for path in models(&generated.join("coefficients")) {
        let unit = unit(&path, &[], false);
        for (extension, text) in texts(&unit) {
            let language = if extension == "rs" { "rust" } else { "c" };
            assert_same(&generated.join(language).join(format!("{}.{extension}", unit.model)), &text);
        }
    }
}
