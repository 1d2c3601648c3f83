//! The costs and memory in the firmware's README equal those of the budget and the types.

use std::mem::size_of;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use motor_loop::{CurrentState, Drive, ReferenceState};
use throttle_loop::raw::RawState;

use super::image::INTERRUPTS;
use super::{STEPS, blessed, builds};

/// A number of the budget.
fn budget(name: &str, level: &str, what: &str) -> String {
    let budget = std::fs::read_to_string(builds::firmware().join("budget.txt")).expect("the budget");
    let name = format!("{name} {level} {what}");
    let line = budget.lines().find_map(|line| line.strip_prefix(name.as_str()));
    line.unwrap_or_else(|| panic!("budget.txt has no line `{name}`")).trim().to_string()
}

/// A number of the budget in Rust.
fn in_rust(name: &str, what: &str) -> String {
    let budget = std::fs::read_to_string(builds::firmware().join("rust/budget.txt")).expect("the budget in Rust");
    let name = format!("{name} {what} ");
    let line = budget.lines().find_map(|line| line.strip_prefix(name.as_str()));
    line.unwrap_or_else(|| panic!("rust/budget.txt has no line `{name}`")).trim().to_string()
}

/// The numbers at both levels in C, then that in Rust.
fn row(name: &str, what: &str) -> String {
    let [o2, os] = ["-O2", "-Os"].map(|level| budget(name, level, what));
    format!("{o2} | {os} | {}", in_rust(name, what))
}

/// The lines of the tables, as they must stand.
fn lines() -> Vec<String> {
    let costs = STEPS.map(|(_, step)| {
        let rows = ["instructions", "stack", "flash"].map(|what| row(step, what));
        format!("| `{step}` | {} |", rows.join(" | "))
    });
    let interrupts = INTERRUPTS.into_iter().chain(["both-interrupts"]);
    let interrupts = interrupts.map(|name| format!("| `{name}` | {} |", row(name, "stack")));
    // Words of 4 bytes only, in Rust and in C: neither has padding.
    let states = [
        ("motor_reference_state", size_of::<ReferenceState>()),
        ("motor_current_state", size_of::<CurrentState>()),
        ("throttle_raw_state", size_of::<RawState>()),
        ("motor_drive", size_of::<Drive>()),
    ];
    costs.into_iter().chain(interrupts).chain(states.map(|(state, bytes)| format!("| `{state}` | {bytes} |"))).collect()
}

/// Budgets and page change together: the tests of this program run side by side.
static PAGE: Mutex<()> = Mutex::new(());

fn page() -> PathBuf {
    builds::firmware().join("README.md")
}

/// Checks a budget. With RSM_BLESS=1 it is written, and the page is updated from it, whichever test writes last.
pub fn blessed_budget(name: &str, text: &str) -> bool {
    let _alone = PAGE.lock().unwrap_or_else(PoisonError::into_inner);
    let same = blessed(name, text);
    bless_page();
    same
}

/// With RSM_BLESS=1, writes the lines of the tables.
fn bless_page() {
    if std::env::var_os("RSM_BLESS").is_none() {
        return;
    }
    let text = std::fs::read_to_string(page()).expect("the README");
    assert!(blessed("README.md", &with_lines(&text, &lines())));
}

/// The page with these lines in the place of those of the same first cell and as many cells.
fn with_lines(text: &str, lines: &[String]) -> String {
    let kept = text.lines().map(|line| {
        let written = lines.iter().find(|cost| {
            let head = cost.split('|').nth(1);
            line.starts_with("| `") && head == line.split('|').nth(1) && cost.matches('|').count() == line.matches('|').count()
        });
        written.map_or(line, String::as_str).to_string() + "\n"
    });
    kept.collect()
}

/// The tables of a page that have one of these lines, for `cargo xtask bench loops`.
fn tables(text: &str, lines: &[String]) -> Vec<String> {
    let paragraphs = text.split("\n\n");
    paragraphs.filter(|it| it.lines().any(|row| lines.iter().any(|line| line == row))).map(|it| format!("{it}\n")).collect()
}

#[test]
fn the_readme_tells_the_costs_of_the_budget_and_the_sizes_of_the_states() {
    let _alone = PAGE.lock().unwrap_or_else(PoisonError::into_inner);
    bless_page();
    let text = std::fs::read_to_string(page()).expect("the README");
    let lines = lines();
    tables(&text, &lines).iter().for_each(|table| println!("{table}"));
    for line in lines {
        assert!(
            text.lines().any(|found| found == line),
            "{}: expected the line `{line}`; run with RSM_BLESS=1",
            page().display()
        );
    }
}
