//! Inputs that must be refused, each beside the whole message. Included by path in the tests of other crates.

use std::path::Path;

/// What a message starts with where an input was not refused.
pub const ACCEPTED: &str = "ACCEPTED";

/// The names of the files of a folder with one of the endings, in order.
pub fn files(folder: &Path, endings: &[&str]) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().and_then(|it| it.to_str()).is_some_and(|it| endings.contains(&it)))
        .map(|path| path.file_name().unwrap().to_str().unwrap().to_string())
        .collect();
    names.sort();
    names
}

/// Compares the message of each case with the file of it, and fails with every difference. With `RSM_BLESS=1` it writes the files first;
/// the difference is reviewed like code.
///
/// A case is the name of its message's file and the message. One that starts with [`ACCEPTED`] fails always.
pub fn assert_beside(folder: &Path, cases: impl IntoIterator<Item = (String, String)>) {
    let mut wrong = Vec::new();
    for (name, found) in cases {
        let path = folder.join(&name);
        let found = found + "\n";
        if found.starts_with(ACCEPTED) {
            wrong.push(format!("--- {name}\n{found}"));
            continue;
        }
        if std::env::var_os("RSM_BLESS").is_some() {
            std::fs::write(&path, &found).unwrap();
        }
        let expected = std::fs::read_to_string(&path).unwrap_or_default();
        if found != expected {
            wrong.push(format!("--- {name}\nexpected:\n{expected}found:\n{found}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
