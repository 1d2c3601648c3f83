//! Prints one table of the cost of an evaluation.
//!
//! In: criterion's results in the target directory, and `instructions.txt`. Out: nanoseconds and instructions, and the times of the interpreter and
//! of hand-written Horner as multiples of the emitted C. A case without a time is shown as a dash.

use std::path::{Path, PathBuf};

use rsm_bench::budget;
use rsm_bench::counted::Key;
use rsm_core::number::Precision;

const EVALUATORS: [&str; 5] = ["interpreter", "rust", "c", "c_clamped", "horner"];

fn main() {
    let folder = criterion_folder();
    let counts = budget::read();
    println!("{}; times are medians in ns per evaluation, ratios are against `C`\n", counts.compiler);
    println!(
        "{:<8}| {:^54} | {:^54} | {:^27}",
        "", "latency of a dependent chain", "throughput, one call each", "instructions (callgrind)"
    );
    let times = "interp.   Rust      C  clamp Horner  int/C  Hor/C  Ru/C ";
    println!("{:<8}| {times:<54} | {times:<54} |    C clamp Horner  Horner/C", "");
    let dash = "-".to_string();
    for name in ["S1", "S2", "S3", "S4", "S5", "S6"] {
        for precision in Precision::ALL {
            let mut line = format!("{name} {:<5}", precision.name());
            for mode in ["latency", "throughput"] {
                let median = |evaluator| median_ns(&folder.join(name).join(format!("{mode}_{}_{evaluator}", precision.name())));
                let [interpreter, rust, c, clamped, horner] = EVALUATORS.map(median);
                let ns = |time: Option<f64>| time.map_or(dash.clone(), |time| format!("{time:.1}"));
                let over = |time: Option<f64>| time.zip(c).map_or(dash.clone(), |(time, c)| format!("{:.2}", time / c));
                line += &format!(
                    "| {:>7} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>5}  ",
                    ns(interpreter),
                    ns(rust),
                    ns(c),
                    ns(clamped),
                    ns(horner),
                    over(interpreter),
                    over(horner),
                    over(rust)
                );
            }
            let count = |variant: &str| {
                let key = Key { name: name.to_string(), variant: variant.to_string(), precision };
                counts.counts.get(&key).copied()
            };
            let [c, clamped, horner] = ["extrapolate", "clamp", "horner"].map(count);
            let shown = |count: Option<u64>| count.map_or(dash.clone(), |count| count.to_string());
            let ratio = horner.zip(c).map_or(dash.clone(), |(horner, c)| format!("{:.2}", horner as f64 / c as f64));
            println!("{line}| {:>4} {:>5} {:>6}  {ratio:>8}", shown(c), shown(clamped), shown(horner));
        }
    }
}

/// The folder beside the profile folder that contains this program.
fn criterion_folder() -> PathBuf {
    let program = std::env::current_exe().expect("a program knows where it is");
    program.ancestors().nth(2).expect("it lies in the target directory").join("criterion")
}

/// The last median of criterion, in nanoseconds; `None` if the case has not been timed.
fn median_ns(case: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(case.join("new/estimates.json")).ok()?;
    let estimates: serde_json::Value = serde_json::from_str(&text).ok()?;
    estimates["median"]["point_estimate"].as_f64()
}
