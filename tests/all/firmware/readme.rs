//! What the firmware's README says of costs and memory is what the budget and the types say: it is read from them.

use std::mem::size_of;

use motor_loop::{CurrentState, Drive, ReferenceState};
use throttle_loop::raw::RawState;

use super::image::INTERRUPTS;
use super::{STEPS, builds};

/// A number of the budget.
fn budget(name: &str, level: &str, what: &str) -> String {
    let budget = std::fs::read_to_string(builds::firmware().join("budget.txt")).expect("the budget");
    let name = format!("{name} {level} {what}");
    let line = budget.lines().find_map(|line| line.strip_prefix(name.as_str()));
    line.unwrap_or_else(|| panic!("budget.txt has no line `{name}`")).trim().to_string()
}

/// The instructions of a step in Rust.
fn in_rust(step: &str) -> String {
    let budget = std::fs::read_to_string(builds::firmware().join("rust/budget.txt")).expect("the budget in Rust");
    let line = budget.lines().find_map(|line| line.strip_prefix(step)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("rust/budget.txt has no line `{step}`")).trim().to_string()
}

/// The lines of the tables, as they must stand.
fn lines() -> Vec<String> {
    let levels = ["-O2", "-Os"];
    let costs = STEPS.map(|(_, step)| {
        let [instructions, stack] =
            ["instructions", "stack"].map(|what| levels.map(|level| budget(step, level, what)).join(" | "));
        format!("| `{step}` | {instructions} | {} | {stack} |", in_rust(step))
    });
    let interrupts = INTERRUPTS.into_iter().chain(["both-interrupts"]);
    let interrupts =
        interrupts.map(|name| format!("| `{name}` | {} |", levels.map(|level| budget(name, level, "stack")).join(" | ")));
    // Words of 4 bytes only, in Rust and in C: neither has padding.
    let states = [
        ("motor_reference_state", size_of::<ReferenceState>()),
        ("motor_current_state", size_of::<CurrentState>()),
        ("throttle_raw_state", size_of::<RawState>()),
        ("motor_drive", size_of::<Drive>()),
    ];
    costs.into_iter().chain(interrupts).chain(states.map(|(state, bytes)| format!("| `{state}` | {bytes} |"))).collect()
}

#[test]
fn the_readme_tells_the_costs_of_the_budget_and_the_sizes_of_the_states() {
    let path = builds::firmware().join("README.md");
    let mut text = std::fs::read_to_string(&path).expect("the README");
    if std::env::var_os("RSM_BLESS").is_some() {
        let kept = text.lines().map(|line| {
            let written = lines().into_iter().find(|cost| {
                let head = cost.split('|').nth(1);
                line.starts_with("| `")
                    && head == line.split('|').nth(1)
                    && cost.matches('|').count() == line.matches('|').count()
            });
            written.unwrap_or_else(|| line.to_string()) + "\n"
        });
        text = kept.collect();
        std::fs::write(&path, &text).expect("the README can be written");
    }
    for line in lines() {
        assert!(
            text.lines().any(|found| found == line),
            "{}: expected the line `{line}`; run with RSM_BLESS=1",
            path.display()
        );
    }
}
