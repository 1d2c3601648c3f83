//! The README's examples, run as they are pasted.

use crate::shell::{of_the_project, read, run};

/// The indented block below a heading of the README.
fn block(heading: &str) -> String {
    let readme = read("README.md");
    let after = readme.split_once(heading).unwrap_or_else(|| panic!("README has no `{heading}`")).1;
    let lines = after
        .lines()
        .skip_while(|line| !line.starts_with("    "))
        .take_while(|line| line.starts_with("    ") || line.is_empty());
    lines.map(|line| line.strip_prefix("    ").unwrap_or(line)).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_example_of_the_readme_gives_the_header_that_it_promises() {
    let script = block("## From CSV to a C header");
    let folder = tempfile::tempdir().unwrap();
    let text = run(&script, folder.path());
    // The text after the `#` of the last line.
    let promised = script.lines().rev().find_map(|line| line.split_once("# ")).unwrap().1.trim();
    assert!(text.contains(promised), "{promised} is not in\n{text}");
    assert!(folder.path().join("example/report/report.html").is_file());
}

#[test]
fn the_diagnosis_of_the_readme_names_the_cause_that_it_promises() {
    let script = block("## The error of a simulation");
    let folder = tempfile::tempdir().unwrap();
    let (plants, example) = (folder.path().join("rsm-sim/plants"), folder.path().join("example"));
    std::fs::create_dir_all(&plants).unwrap();
    std::fs::create_dir_all(&example).unwrap();
    for name in ["servo-axis.toml", "servo-axis.csv"] {
        std::fs::copy(of_the_project("rsm-sim/plants").join(name), plants.join(name)).unwrap();
    }
    let text = run(&script, &example);
    let promised = script.lines().rev().find_map(|line| line.split_once("# ")).unwrap().1.trim();
    let extended = text.rsplit_once("[[effects]]").unwrap().1;
    assert!(extended.contains(&format!("kind = \"{promised}\"")), "{promised} is not in\n{text}");
    assert!(example.join("found/report.html").is_file());
}
