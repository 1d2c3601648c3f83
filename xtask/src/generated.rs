//! The emitted files of `generated/coefficients`: `generated/rust` and `generated/c`.
//!
//! In: every coefficient file. Out: the emitted files. The program `rsm` of the stage `programs` writes them to a scratch folder; the checked-in
//! files are compared with them or replaced by them. Files are replaced only after everything has been emitted, each by renaming, so that a fault
//! leaves no incomplete file.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::workspace::{program, root, scratch};

const LANGUAGES: [&str; 2] = ["rust", "c"];

/// Relative name and content of every file of the folders of all languages.
type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Reports missing, surplus and different files.
pub(crate) fn is_up_to_date() -> Result<(), String> {
    let wrong = differences(&checked_in()?, &emit()?);
    if wrong.is_empty() {
        return Ok(());
    }
    Err(format!(
        "not what `cargo rsm emit` gives today:\n    {}\nrun `cargo xtask bless` and look at the change",
        wrong.join("\n    ")
    ))
}

/// Replaces the checked-in files by newly emitted ones, and prints which changed.
pub(crate) fn refresh() -> Result<(), String> {
    let (old, new) = (checked_in()?, emit()?);
    for (name, content) in &new {
        if old.get(name) == Some(content) {
            continue;
        }
        let path = root().join("generated").join(name);
        let beside = path.with_extension("new");
        let written = fs::create_dir_all(path.parent().expect("a file stands in a folder"))
            .and_then(|()| fs::write(&beside, content))
            .and_then(|()| fs::rename(&beside, &path));
        written.map_err(|error| format!("{}: {error}", path.display()))?;
    }
    for name in old.keys().filter(|name| !new.contains_key(*name)) {
        let path = root().join("generated").join(name);
        fs::remove_file(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    let changed = differences(&old, &new);
    println!("generated: {}", if changed.is_empty() { "nothing changed".to_string() } else { changed.join(", ") });
    Ok(())
}

/// The names of files that are in only one of two sets, or different, in order.
fn differences(old: &Files, new: &Files) -> Vec<String> {
    let gone = old.keys().filter(|name| !new.contains_key(*name)).map(|name| (name, "left over"));
    let other = new.iter().filter_map(|(name, content)| match old.get(name) {
        None => Some((name, "missing")),
        Some(before) if before != content => Some((name, "different")),
        Some(_) => None,
    });
    let all: BTreeMap<_, _> = gone.chain(other).collect();
    all.into_iter().map(|(name, what)| format!("{} {what}", name.display())).collect()
}

/// The checked-in files.
fn checked_in() -> Result<Files, String> {
    read(&root().join("generated"))
}

/// The files as `rsm emit` writes them now.
fn emit() -> Result<Files, String> {
    let folder = scratch("generated");
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    for model in coefficient_files()? {
        for language in LANGUAGES {
            let mut emit = Command::new(program("debug", "rsm"));
            emit.current_dir(root()).arg("emit");
            // Relative to the root, as a developer would type it, so that messages use the same name.
            emit.arg(model.strip_prefix(root()).unwrap_or(&model));
            emit.args(["--lang", language, "--out"]).arg(folder.join(language));
            // Its output is printed only if it fails.
            let output = emit.output().map_err(|error| format!("cannot start target/debug/rsm: {error}"))?;
            if !output.status.success() {
                let said = String::from_utf8_lossy(&output.stderr);
                return Err(format!("rsm emit {} --lang {language}: {}\n{said}", model.display(), output.status));
            }
        }
    }
    read(&folder)
}

fn coefficient_files() -> Result<Vec<PathBuf>, String> {
    let folder = root().join("generated").join("coefficients");
    let mut files = list(&folder)?;
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    if files.is_empty() { Err(format!("{}: no coefficient file", folder.display())) } else { Ok(files) }
}

fn read(folder: &Path) -> Result<Files, String> {
    let mut files = Files::new();
    for language in LANGUAGES {
        let inside = folder.join(language);
        if !inside.exists() {
            continue;
        }
        for path in list(&inside)? {
            let content = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
            let name = path.file_name().expect("a listed file has a name");
            files.insert(Path::new(language).join(name), content);
        }
    }
    Ok(files)
}

fn list(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = fs::read_dir(folder).and_then(|entries| entries.map(|entry| entry.map(|e| e.path())).collect());
    let mut paths: Vec<PathBuf> = entries.map_err(|error| format!("{}: {error}", folder.display()))?;
    paths.retain(|path| path.is_file());
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(list: &[(&str, &str)]) -> Files {
        list.iter().map(|(name, content)| (PathBuf::from(name), content.as_bytes().to_vec())).collect()
    }

    #[test]
    fn every_kind_of_difference_is_named_once() {
        let old = files(&[("c/a.h", "1"), ("c/b.h", "1"), ("rust/a.rs", "1")]);
        let new = files(&[("c/a.h", "1"), ("c/c.h", "1"), ("rust/a.rs", "2")]);
        assert_eq!(differences(&old, &new), ["c/b.h left over", "c/c.h missing", "rust/a.rs different"]);
        assert!(differences(&new, &new).is_empty());
    }
}
