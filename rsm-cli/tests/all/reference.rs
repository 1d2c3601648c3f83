//! The page of commands in the book contains exactly the subcommands and options that `--help` prints.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

fn help(words: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_rsm")).args(words).arg("--help").output().unwrap();
    assert!(output.status.success(), "{words:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// The first words of the lines of the list of subcommands.
fn subcommands(help: &str) -> Vec<String> {
    let Some((_, list)) = help.split_once("Commands:\n") else { return vec![] };
    let lines = list.lines().take_while(|line| !line.is_empty());
    lines.filter_map(|line| Some(line.split_whitespace().next()?.to_string())).collect()
}

/// The long options: at the beginning of a line, or after a short one.
fn options(help: &str) -> BTreeSet<String> {
    let option = |line: &str| {
        let line = line.trim_start();
        let line = if line.starts_with("--") { line } else { line.split_once(", ").filter(|it| it.0.len() == 2)?.1 };
        let name = line.strip_prefix("--")?;
        Some(name.split(|it: char| !it.is_ascii_alphanumeric() && it != '-').next()?.to_string())
    };
    help.lines().filter_map(option).collect()
}

/// The options in the tables of a page, by the heading above them.
fn tables(page: &str) -> BTreeMap<String, BTreeSet<String>> {
    let mut tables: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut heading = String::new();
    for line in page.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            heading = name.trim_matches('`').to_string();
            tables.insert(heading.clone(), BTreeSet::new());
        } else if let Some(option) = line.strip_prefix("| `--") {
            let name = option.split('`').next().unwrap().to_string();
            tables.get_mut(&heading).expect("a heading stands above").insert(name);
        }
    }
    tables
}

#[test]
fn the_page_of_commands_has_what_help_prints() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/book/src/reference/commands.md");
    let mut documented = tables(&std::fs::read_to_string(page).unwrap());
    let everywhere = documented.remove("All subcommands").expect("a section of that name");
    assert_eq!(options(&help(&[])), everywhere);
    let mut printed = BTreeMap::new();
    let mut names: Vec<Vec<String>> = subcommands(&help(&[])).into_iter().map(|name| vec![name]).collect();
    assert!(names.len() > 8, "{names:?}");
    while let Some(name) = names.pop() {
        let words: Vec<&str> = name.iter().map(String::as_str).collect();
        if words.last() == Some(&"help") {
            if words.len() == 1 {
                printed.insert("rsm help".to_string(), BTreeSet::new());
            }
            continue;
        }
        let text = help(&words);
        let below = subcommands(&text);
        if below.is_empty() {
            let own = options(&text).difference(&everywhere).cloned().collect();
            printed.insert(format!("rsm {}", words.join(" ")), own);
        }
        names.extend(below.into_iter().map(|last| [name.clone(), vec![last]].concat()));
    }
    assert_eq!(printed, documented);
}

#[test]
fn options_are_read_from_help_and_from_tables() {
    let help = "Commands:\n  one    First\n  help   Help\n\nOptions:\n      --out <OUT>  A file, --not this\n  -h, --help       Print\n  --a-b\n";
    assert_eq!(subcommands(help), ["one", "help"]);
    assert_eq!(options(help), ["a-b", "help", "out"].map(str::to_string).into());
    let tables = tables("## `rsm one`\n| option | x |\n| `--out` | y `--no` |\n## Two\n");
    assert_eq!(tables["rsm one"], ["out".to_string()].into());
    assert!(tables["Two"].is_empty());
}
