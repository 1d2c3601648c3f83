//! Lists the files of effects and sites, so that a further one needs no line of Rust.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// The files of a folder with an ending, by what stands before it.
fn list(folder: &Path, ending: &str) -> Vec<(String, PathBuf)> {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<(String, PathBuf)> = entries
        .filter_map(Result::ok)
        .filter_map(|entry| Some((entry.file_name().to_str()?.strip_suffix(ending)?.to_string(), entry.path())))
        .collect();
    files.sort();
    files
}

fn main() {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    let mut text = String::new();
    for (name, folder, ending) in [("EFFECTS", "effects", ".toml"), ("SITES", "models", ".sites.toml")] {
        println!("cargo::rerun-if-changed={folder}");
        let _ = writeln!(text, "pub(super) const {name}: &[(&str, &str)] = &[");
        for (stem, path) in list(&root.join(folder), ending) {
            let _ = writeln!(text, "    ({stem:?}, include_str!({:?})),", path.display().to_string());
        }
        text.push_str("];\n");
    }
    fs::write(out.join("files.rs"), text).expect("the folder of a build can be written");
}
