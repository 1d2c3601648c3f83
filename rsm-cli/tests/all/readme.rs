//! The README's example, run as it is pasted.

use std::path::Path;
use std::process::Command;

/// The indented block below a heading.
fn block(readme: &str, heading: &str) -> String {
    let after = readme.split_once(heading).unwrap_or_else(|| panic!("README has no `{heading}`")).1;
    let lines = after
        .lines()
        .skip_while(|line| !line.starts_with("    "))
        .take_while(|line| line.starts_with("    ") || line.is_empty());
    lines.map(|line| line.strip_prefix("    ").unwrap_or(line)).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_example_of_the_readme_gives_the_header_that_it_promises() {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md")).unwrap();
    let script = block(&readme, "## From CSV to a C header").replace("cargo rsm", env!("CARGO_BIN_EXE_rsm"));
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new("sh").args(["-e", "-c", &script]).current_dir(folder.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    // What stands behind the `#` of the last line.
    let promised = script.lines().rev().find_map(|line| line.split_once("# ")).unwrap().1.trim();
    assert!(text.contains(promised), "{promised} is not in\n{text}");
}

#[test]
fn the_example_of_new_data_names_what_the_readme_says() {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md")).unwrap();
    let first = block(&readme, "## From CSV to a C header");
    let script = format!("{first}\n{}", block(&readme, "## A surface against new data"));
    let folder = tempfile::tempdir().unwrap();
    let script = script.replace("cargo rsm", env!("CARGO_BIN_EXE_rsm"));
    let output = Command::new("sh").args(["-e", "-c", &script]).current_dir(folder.path()).output().unwrap();
    let (text, said) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success(), "{text}\n{said}");
    let promised = script.lines().rev().find_map(|line| line.split_once("# ")).unwrap().1.trim();
    assert!(text.contains(&format!("\"kind\": \"{promised}\"")), "{promised} is not in\n{text}");
    // The figures of the sentence below the example.
    assert!(said.contains("b 3.1") && said.contains("run 11 ("), "{said}");
}
