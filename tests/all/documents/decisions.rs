//! docs/decisions: every page is in the list, has its own number and its parts.

use std::collections::{BTreeMap, BTreeSet};

use super::root;

/// The pages of the folder with their texts.
fn pages() -> BTreeMap<String, String> {
    let folder = root().join("docs").join("decisions");
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let paths = entries.map(|entry| entry.expect("an entry of a folder").path());
    let pages = paths.filter(|path| path.extension().is_some_and(|it| it == "md")).map(|path| {
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        (path.file_name().expect("a file has a name").to_string_lossy().to_string(), text)
    });
    pages.collect()
}

/// The fault of a page, if it has one, with its name.
fn fault(name: &str, text: &str) -> Option<String> {
    let number = name.split('-').next().unwrap_or_default();
    if number.len() != 3 || !number.bytes().all(|digit| digit.is_ascii_digit()) {
        return Some(format!("{name} does not begin with three digits"));
    }
    if !text.starts_with(&format!("# {number}: ")) {
        return Some(format!("{name} does not begin with `# {number}: title`"));
    }
    let lacking = ["## Context", "## Decision", "## Cost"].into_iter().find(|part| !text.lines().any(|line| line == *part));
    lacking.map(|part| format!("{name} has no part `{part}`"))
}

#[test]
fn every_page_is_in_the_list_under_its_title() {
    let mut pages = pages();
    let list = pages.remove("README.md").expect("docs/decisions/README.md");
    assert!(pages.len() > 40, "{} pages: the search finds too few", pages.len());
    let told: Vec<&str> = list.lines().filter(|line| line.starts_with("- [")).collect();
    let title = |text: &str| text.lines().next().unwrap_or_default().trim_start_matches("# ").to_string();
    let expected: BTreeSet<String> = pages.iter().map(|(name, text)| format!("- [{}]({name})", title(text))).collect();
    let lacking: Vec<_> = expected.iter().filter(|line| !told.contains(&line.as_str())).collect();
    assert!(lacking.is_empty(), "docs/decisions/README.md lacks these lines: {lacking:#?}");
    let strange: Vec<_> = told.iter().filter(|line| !expected.contains(**line)).collect();
    assert!(
        strange.is_empty() && told.len() == expected.len(),
        "docs/decisions/README.md lists twice or in vain: {strange:#?}"
    );
}

#[test]
fn every_page_has_a_number_of_its_own_and_its_parts() {
    let mut pages = pages();
    pages.remove("README.md");
    let faults: Vec<String> = pages.iter().filter_map(|(name, text)| fault(name, text)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    let numbers: BTreeSet<&str> = pages.keys().map(|name| &name[..3]).collect();
    assert_eq!(numbers.len(), pages.len(), "two pages have one number: {:?}", pages.keys());
    let whole = "# 001: a title\n\n## Context\n\n## Decision\n\n## Cost\n";
    assert_eq!(fault("001-a-title.md", whole), None);
    assert!(fault("01-a-title.md", whole).is_some() && fault("002-a-title.md", whole).is_some());
    assert!(fault("001-a-title.md", &whole.replace("## Cost", "")).is_some());
}
