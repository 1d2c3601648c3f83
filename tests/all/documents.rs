//! Every document that a text or a comment of the repository names exists.

mod comments;
mod contributing;
mod decisions;
mod map;

use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every file of the repository.
fn tracked() -> Vec<String> {
    let listed = Command::new("git").args(["ls-files"]).current_dir(root()).output().unwrap();
    assert!(listed.status.success(), "git ls-files failed: is this a clone?");
    let files: Vec<String> = String::from_utf8(listed.stdout).unwrap().lines().map(str::to_string).collect();
    assert!(files.len() > 100, "{} files", files.len());
    files
}

/// The names of documents in a text: words that end in `.md`, with their folders.
fn cited(text: &str) -> Vec<&str> {
    let is_name = |symbol: char| symbol.is_ascii_alphanumeric() || "._-/".contains(symbol);
    let words = text.split(|symbol: char| !is_name(symbol)).map(|word| word.trim_matches('.').trim_start_matches('/'));
    words.filter(|word| word.len() > 3 && word.ends_with(".md") && !word.starts_with("//")).collect()
}

#[test]
fn no_document_is_cited_that_is_not_there() {
    let files = tracked();
    let mut missing = Vec::new();
    let mut found = 0;
    // The tests of this module name documents that do not exist.
    for file in files.iter().filter(|file| !file.starts_with("tests/all/documents") && *file != "tests/all/book.rs") {
        let Ok(text) = std::fs::read_to_string(root().join(file)) else { continue };
        for (k, line) in text.lines().enumerate() {
            for name in cited(line) {
                found += 1;
                // A name stands for a file of the root (a source may go up to it), of the citing file's folder, or of the end of a path.
                let beside = Path::new(file).parent().unwrap_or(Path::new("")).join(name);
                let is_there = root().join(name.trim_start_matches("../")).is_file()
                    || root().join(beside).is_file()
                    || files.iter().any(|it| it == name || it.ends_with(&format!("/{name}")));
                // Measured data are no part of the repository; their README stands beside them.
                if !is_there && !name.contains("shared/data") {
                    missing.push(format!("{file}:{}: {name}", k + 1));
                }
            }
        }
    }
    assert!(found > 50, "{found} citations: the search finds nothing");
    assert!(missing.is_empty(), "documents that are cited and not there:\n{}", missing.join("\n"));
}

#[test]
fn a_citation_is_seen_in_prose_in_brackets_and_at_the_end_of_a_sentence() {
    assert_eq!(
        cited("see docs/book/src/reference/plants.md, [x](paper.md). And README.md."),
        ["docs/book/src/reference/plants.md", "paper.md", "README.md"]
    );
    assert_eq!(cited("no document: cmd, .md, a.mdx"), [""; 0]);
}
