//! ARCHITECTURE.md is correct: short, complete, and everything that it names exists.

use std::collections::BTreeSet;
use std::path::Path;

use super::root;
use crate::layers::LAWS;

/// The limit of its length: some six pages of a book.
const MOST_WORDS: usize = 1500;

/// Folders whose entries must all be named, each under a heading of its own.
const COMPLETE: [&str; 12] = [
    "rsm-core/src/",
    "rsm-macros/src/",
    "rsm-fit/src/",
    "rsm-diagnose/src/engine/",
    "rsm-diagnose/src/surface/",
    "rsm-import/src/",
    "rsm-model/src/",
    "rsm-sim/src/",
    "rsm-rigs/src/",
    "rsm-sweep/src/",
    "rsm-diagnose/src/plant/",
    "rsm-cli/src/",
];

fn read(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// What stands between backticks in a line.
pub(super) fn quoted(line: &str) -> Vec<&str> {
    line.split('`').skip(1).step_by(2).collect()
}

/// Whether a quoted text is the name of a file or of a folder.
pub(super) fn is_path(name: &str) -> bool {
    !name.contains(' ') && (name.ends_with('/') || name.ends_with(".rs") || name.ends_with(".md") || name.ends_with(".txt"))
}

/// Sections of level 3 by the folder in their heading, each with the files and folders that it names.
fn sections(map: &str) -> Vec<(&str, BTreeSet<&str>)> {
    let mut sections: Vec<(&str, BTreeSet<&str>)> = vec![];
    let mut is_inside = false;
    for line in map.lines() {
        if line.starts_with('#') {
            is_inside = line.starts_with("### ");
            if is_inside {
                sections.push((quoted(line).first().copied().unwrap_or_default(), BTreeSet::new()));
            }
        } else if is_inside && let Some((_, names)) = sections.last_mut() {
            names.extend(quoted(line).into_iter().filter(|name| is_path(name)));
        }
    }
    sections
}

/// Names in a map that lead to nothing. A name is that of a file of the root, of the folder in the heading, or of the folder of the last whole path
/// before it.
fn missing(map: &str, exists: impl Fn(&str) -> bool) -> Vec<String> {
    let mut missing = vec![];
    let mut folder = String::new();
    for line in map.lines() {
        for name in quoted(line).into_iter().filter(|name| is_path(name)) {
            if exists(name) {
                if line.starts_with('#') {
                    folder = name.to_string();
                } else if folder.is_empty() || !exists(&format!("{folder}{name}")) {
                    folder =
                        name.trim_end_matches('/').rsplit_once('/').map_or(String::new(), |(parent, _)| format!("{parent}/"));
                }
            } else if !exists(&format!("{folder}{name}")) {
                missing.push(format!("{name} (in `{folder}`)"));
            }
        }
    }
    missing
}

/// Whether a path of the root is there: a folder if it ends in `/`, else a file.
pub(super) fn is_there(path: &str) -> bool {
    let whole = root().join(path);
    if path.ends_with('/') { whole.is_dir() } else { whole.is_file() }
}

/// Modules of a source folder: files, and folders that no file of the same name speaks for.
fn modules(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let names = entries.filter_map(|entry| {
        let path = entry.expect("an entry of a folder").path();
        let name = path.file_name()?.to_string_lossy().to_string();
        match path.is_dir() {
            true => (!path.with_extension("rs").is_file()).then(|| format!("{name}/")),
            false => Some(name),
        }
    });
    names.filter(|name| !["lib.rs", "mod.rs", "tests.rs", "tests/"].contains(&name.as_str())).collect()
}

/// A row of the table of crates: the crate and what it imports of ours.
fn imports(line: &str) -> Option<(&str, BTreeSet<&str>)> {
    let cells: Vec<&str> = line.split('|').collect();
    let [_, package, _, used, _] = cells[..] else { return None };
    Some((quoted(package).first()?, quoted(used).into_iter().collect()))
}

#[test]
fn it_is_short() {
    let words = read("ARCHITECTURE.md").split_whitespace().count();
    assert!(
        words <= MOST_WORDS,
        "ARCHITECTURE.md has {words} words, of at most {MOST_WORDS}: reasons belong into docs/decisions"
    );
}

#[test]
fn everything_that_it_names_exists() {
    let missing = missing(&read("ARCHITECTURE.md"), is_there);
    assert!(missing.is_empty(), "ARCHITECTURE.md names what is not there:\n  {}", missing.join("\n  "));
}

#[test]
fn every_module_is_named() {
    let map = read("ARCHITECTURE.md");
    let sections = sections(&map);
    for folder in COMPLETE {
        let section = sections.iter().find(|section| section.0 == folder);
        let (_, named) = section.unwrap_or_else(|| panic!("ARCHITECTURE.md has no section of {folder}"));
        let there = modules(&root().join(folder));
        assert!(!there.is_empty(), "{folder} has no modules");
        let lacking: Vec<_> = there.iter().filter(|name| !named.contains(name.as_str())).collect();
        assert!(lacking.is_empty(), "ARCHITECTURE.md, section {folder}, does not name {lacking:?}");
    }
}

#[test]
fn every_crate_stands_in_the_table_with_the_imports_of_the_law() {
    let map = read("ARCHITECTURE.md");
    let table: Vec<_> = map.lines().filter_map(imports).filter(|(package, _)| !is_path(package)).collect();
    for law in LAWS {
        let row = table.iter().find(|(package, _)| *package == law.package);
        let (_, told) = row.unwrap_or_else(|| panic!("ARCHITECTURE.md has no crate {}", law.package));
        assert_eq!(*told, law.ours.iter().copied().collect::<BTreeSet<_>>(), "imports of {}", law.package);
    }
    assert_eq!(table.len(), LAWS.len(), "a row of the table is no crate: {table:?}");
}

#[test]
fn a_name_that_leads_nowhere_is_found() {
    let exists = |name: &str| ["a/src/", "a/src/one.rs", "a/src/two/", "b/src/three.rs", "b/src/four.rs"].contains(&name);
    assert_eq!(missing("### `a/src/`\n\n| `one.rs`, `two/` | `b/src/three.rs` and `four.rs` |", exists), [""; 0]);
    assert_eq!(missing("### `a/src/`\n\n| `one.rs`, `none.rs` | x |", exists), ["none.rs (in `a/src/`)"]);
    assert_eq!(missing("`b/src/three.rs` reads `five.rs`, not `a word`.", exists), ["five.rs (in `b/src/`)"]);
    let named = sections("## All\n\n`x.rs`\n\n### `a/src/`\n\n| `one.rs`, `two/` | of `a word` |\n\n## Next\n\n`y.rs`\n");
    assert_eq!(named, [("a/src/", BTreeSet::from(["one.rs", "two/"]))]);
    assert_eq!(imports("| `a` | for `it` | `b`, `c` |"), Some(("a", BTreeSet::from(["b", "c"]))));
}
