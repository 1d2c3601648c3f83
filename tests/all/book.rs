//! The book in `docs/book`, checked without mdbook: every chapter is in the summary, the target of every link of every document exists, every file
//! that a chapter names is in the repository. And the README is not too long.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

const SOURCES: &str = "docs/book/src";

/// The README is for the first five minutes: longer explanations belong in the book.
const WORDS_OF_THE_README: usize = 700;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The files of the repository: those that git tracks, and new ones that it does not ignore.
fn files() -> BTreeSet<String> {
    let listed = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard"])
        .current_dir(root())
        .output()
        .expect("git runs");
    assert!(listed.status.success(), "git ls-files failed: is this a clone?");
    let text = String::from_utf8(listed.stdout).expect("names are UTF-8");
    // Deleted files that are not committed yet are listed too.
    text.lines().filter(|name| root().join(name).is_file()).map(str::to_string).collect()
}

fn documents(files: &BTreeSet<String>) -> BTreeMap<String, String> {
    let of_ours = files.iter().filter(|name| name.ends_with(".md"));
    of_ours.map(|name| (name.clone(), std::fs::read_to_string(root().join(name)).expect("it was listed"))).collect()
}

/// The lines of a text that are prose: none of a fenced or indented block of code.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fenced = false;
    text.lines().enumerate().filter(move |(_, line)| {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
            return false;
        }
        !fenced && !line.starts_with("    ")
    })
}

/// Parts of a line between back quotes, and the line without them.
fn code_and_rest(line: &str) -> (Vec<&str>, String) {
    let parts: Vec<&str> = line.split('`').collect();
    let code = parts.iter().skip(1).step_by(2).copied().collect();
    (code, parts.iter().step_by(2).copied().collect::<Vec<_>>().join(" "))
}

/// Targets of links `[words](target)` in a line.
fn links(line: &str) -> Vec<String> {
    let (_, rest) = code_and_rest(line);
    rest.match_indices("](").filter_map(|(place, _)| Some(rest[place + 2..].split_once(')')?.0.to_string())).collect()
}

/// The anchor of a heading, as mdbook and the usual hosts of repositories make it: lower case, spaces as hyphens, nothing but letters, digits, `-`
/// and `_`.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|it| it.is_alphanumeric() || " -_".contains(*it));
    kept.flat_map(char::to_lowercase).map(|it| if it == ' ' { '-' } else { it }).collect()
}

/// The anchors of all headings of a document; of equal ones the second ends with -1.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let headings = prose(text).filter(|(_, line)| line.starts_with('#')).map(|(_, line)| anchor(line.trim_start_matches('#')));
    headings
        .map(|it| {
            let count = seen.entry(it.clone()).or_default();
            *count += 1;
            if *count == 1 { it } else { format!("{it}-{}", *count - 1) }
        })
        .collect()
}

/// A path without `.` and `..`, with slashes.
fn plain(path: &Path) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(parts.pop()),
            Component::Normal(name) => parts.push(name.to_str().expect("names are UTF-8")),
            _ => {}
        }
    }
    parts.join("/")
}

/// Links of documents without a target.
fn broken(documents: &BTreeMap<String, String>, files: &BTreeSet<String>) -> (Vec<String>, usize) {
    let mut broken = Vec::new();
    let mut count = 0;
    for (name, text) in documents {
        for (k, line) in prose(text) {
            for link in links(line).into_iter().filter(|link| !link.contains(':')) {
                count += 1;
                let (file, fragment) = link.split_once('#').unwrap_or((&link, ""));
                let beside = Path::new(name).parent().unwrap_or(Path::new("")).join(file);
                let target = if file.is_empty() { name.clone() } else { plain(&beside) };
                let is_folder = files.iter().any(|it| it.starts_with(&format!("{}/", target.trim_end_matches('/'))));
                let has_anchor =
                    fragment.is_empty() || documents.get(&target).is_some_and(|text| anchors(text).contains(fragment));
                // A page of the book may only link to pages of the book: the built book has no other files.
                let leaves_the_book = name.starts_with(SOURCES) && !target.starts_with(SOURCES) && !is_picture(&target);
                if !(files.contains(&target) || is_folder) || !has_anchor || leaves_the_book {
                    broken.push(format!("{name}:{}: {link}", k + 1));
                }
            }
        }
    }
    (broken, count)
}

fn is_picture(target: &str) -> bool {
    Path::new(target).extension().is_some_and(|it| it == "svg")
}

#[test]
fn every_chapter_stands_in_the_summary_once() {
    let files = files();
    let summary = std::fs::read_to_string(root().join(SOURCES).join("SUMMARY.md")).expect("the summary");
    let mut listed: Vec<String> = prose(&summary).flat_map(|(_, line)| links(line)).collect();
    listed.sort();
    let chapters: Vec<String> = files
        .iter()
        .filter_map(|name| name.strip_prefix(SOURCES)?.strip_prefix('/'))
        .filter(|name| name.ends_with(".md") && *name != "SUMMARY.md")
        .map(str::to_string)
        .collect();
    assert!(chapters.len() > 15, "{chapters:?}");
    assert_eq!(listed, chapters);
}

#[test]
fn every_link_of_every_document_leads_somewhere() {
    let files = files();
    let (broken, count) = broken(&documents(&files), &files);
    assert!(count > 60, "{count} links: the search finds nothing");
    assert!(broken.is_empty(), "links that lead nowhere:\n{}", broken.join("\n"));
}

#[test]
fn every_file_that_a_chapter_names_is_in_the_repository() {
    let files = files();
    let folders: BTreeSet<&str> = files.iter().filter_map(|name| Some(name.split_once('/')?.0)).collect();
    let mut missing = Vec::new();
    let mut count = 0;
    for (name, text) in documents(&files).iter().filter(|(name, _)| name.starts_with(SOURCES) || *name == "README.md") {
        for (k, line) in prose(text) {
            let (code, _) = code_and_rest(line);
            // A command names files too.
            for word in code.iter().flat_map(|it| it.split_whitespace()) {
                let word = word.trim_end_matches('/');
                let Some((folder, _)) = word.split_once('/') else { continue };
                if !folders.contains(folder) || word.contains(|it: char| "*<{".contains(it)) {
                    continue;
                }
                count += 1;
                if !files.contains(word) && !files.iter().any(|it| it.starts_with(&format!("{word}/"))) {
                    missing.push(format!("{name}:{}: {word}", k + 1));
                }
            }
        }
    }
    assert!(count > 40, "{count} files named: the search finds nothing");
    assert!(missing.is_empty(), "files that are named and not there:\n{}", missing.join("\n"));
}

#[test]
fn the_readme_keeps_to_its_length() {
    let readme = std::fs::read_to_string(root().join("README.md")).expect("the README");
    let words = readme.split_whitespace().count();
    assert!(words <= WORDS_OF_THE_README, "README.md has {words} words, {WORDS_OF_THE_README} at most");
}

#[test]
fn the_table_of_instructions_has_the_counts_that_are_checked_in() {
    let counts = std::fs::read_to_string(root().join("bench/instructions.txt")).expect("the counts");
    let page = std::fs::read_to_string(root().join(SOURCES).join("results/demo.md")).expect("the page");
    let count = |surface: &str, form: &str| {
        let mut lines = counts.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
        let found = lines.find(|line| line.len() == 4 && line[..3] == [surface, form, "f64"]);
        found.unwrap_or_else(|| panic!("no count of {surface} {form}"))[3].to_string()
    };
    for surface in ["S1", "S2", "S3", "S4", "S5", "S6"] {
        let [horner, plain, clamped] = ["horner", "extrapolate", "clamp"].map(|form| count(surface, form));
        let row = format!("| {surface} | {horner} | {plain} | {clamped} |");
        assert!(page.contains(&row), "results/demo.md has no row {row}");
        // Without the clamp, evaluators cost the same as hand-written code.
        assert!(plain.parse::<u32>().unwrap() <= horner.parse::<u32>().unwrap() + 1, "{row}");
    }
    let budget = std::fs::read_to_string(root().join("targets/firmware/budget.txt")).expect("the budget");
    for step in ["motor_references", "motor_currents", "throttle_step", "throttle_raw_step"] {
        let line = budget.lines().find(|line| line.starts_with(&format!("{step} -O2 instructions"))).expect("its line");
        let row = format!("`{step}`, every");
        let told = page.lines().find(|line| line.contains(&row)).unwrap_or_else(|| panic!("no row of {step}"));
        assert!(told.ends_with(&format!("| {} |", line.split_whitespace().last().unwrap())), "{told}: {line}");
    }
}

#[test]
fn a_link_to_nothing_is_found() {
    let page = |name: &str, text: &str| (name.to_string(), text.to_string());
    let documents = BTreeMap::from([
        page(
            "docs/book/src/a.md",
            "# One *two*\n[b](b.md#three-four), [x](https://x.org), `[no](no.md)`\n\n```\n[no](no.md)\n```\n[c](c.md)",
        ),
        page("docs/book/src/b.md", "## Three: `four`\n[up](a.md#one-two) [down](#none) [out](../../../README.md)"),
        page("README.md", "[book](docs/book/src/a.md)"),
    ]);
    let files = documents.keys().cloned().collect();
    let (broken, count) = broken(&documents, &files);
    assert_eq!(count, 6);
    let expected = ["docs/book/src/a.md:7: c.md", "docs/book/src/b.md:2: #none", "docs/book/src/b.md:2: ../../../README.md"];
    assert_eq!(broken, expected);
}
