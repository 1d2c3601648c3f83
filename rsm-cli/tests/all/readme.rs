//! The README's examples, run as they are pasted.

use std::path::Path;
use std::process::Command;

fn root() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The indented block below a heading of the README, with the command under test in place of `cargo rsm`.
fn block(heading: &str) -> String {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let after = readme.split_once(heading).unwrap_or_else(|| panic!("README has no `{heading}`")).1;
    let lines = after
        .lines()
        .skip_while(|line| !line.starts_with("    "))
        .take_while(|line| line.starts_with("    ") || line.is_empty());
    let script = lines.map(|line| line.strip_prefix("    ").unwrap_or(line)).collect::<Vec<_>>().join("\n");
    script.replace("cargo rsm", env!("CARGO_BIN_EXE_rsm"))
}

fn run(script: &str, folder: &Path) -> String {
    let script = format!("exec 2>&1\n{script}");
    let output = Command::new("sh").args(["-e", "-c", &script]).current_dir(folder).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn the_example_of_the_readme_gives_the_header_that_it_promises() {
    let script = block("## From CSV to a C header");
    let folder = tempfile::tempdir().unwrap();
    let text = run(&script, folder.path());
    // What stands behind the `#` of the last line.
    let promised = script.lines().rev().find_map(|line| line.split_once("# ")).unwrap().1.trim();
    assert!(text.contains(promised), "{promised} is not in\n{text}");
    assert!(folder.path().join("example/report/report.html").is_file());
}

#[test]
fn the_diagnosis_of_the_readme_names_the_cause_that_it_promises() {
    let script = block("## What a simulation gets wrong");
    let folder = tempfile::tempdir().unwrap();
    let (plants, example) = (folder.path().join("rsm-sim/plants"), folder.path().join("example"));
    std::fs::create_dir_all(&plants).unwrap();
    std::fs::create_dir_all(&example).unwrap();
    for name in ["servo-axis.toml", "servo-axis.csv"] {
        std::fs::copy(root().join("rsm-sim/plants").join(name), plants.join(name)).unwrap();
    }
    let text = run(&script, &example);
    let promised = script.lines().rev().find_map(|line| line.split_once("# ")).unwrap().1.trim();
    let extended = text.rsplit_once("[[effects]]").unwrap().1;
    assert!(extended.contains(&format!("kind = \"{promised}\"")), "{promised} is not in\n{text}");
    assert!(example.join("found/report.html").is_file());
}
