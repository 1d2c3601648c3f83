//! One table of what simulations and diagnoses cost, measured in one run.
//!
//! In: nothing; with `--quick` no diagnoses. Out: rows a second of each plant, nominal and with an effect, their ratio, how many times faster than the plant itself that is; the
//! seconds of a diagnosis of three records of 8000 rows, and how many runs along all three records would take as long. Judges nothing: times are of one machine.

use rsm_bench::simulation::{ROWS, SUBJECTS, diagnosed, rows_per_second};

fn main() {
    let quick = std::env::args().any(|word| word == "--quick");
    let threads = rsm_sim::threads::threads();
    println!(
        "simulation along {ROWS} rows, one thread, the shortest of some runs; diagnosis of three such records on {threads} threads\n"
    );
    println!(
        "{:<11}| {:>12} {:>14} {:>6} {:>10} | {:>11} {:>9}  found",
        "", "rows/s", "with effect", "ratio", "real time", "diagnosis s", "in runs"
    );
    for subject in SUBJECTS {
        let record = subject.record(1);
        let nominal = rows_per_second(&subject.nominal(), &record);
        let hidden = rows_per_second(&subject.hidden(), &record);
        let line = format!(
            "{:<11}| {nominal:>12.0} {hidden:>14.0} {:>6.2} {:>10.0} |",
            subject.plant,
            nominal / hidden,
            nominal * record.period
        );
        if quick {
            println!("{line} {:>11} {:>9}  ({})", "-", "-", subject.effect);
            continue;
        }
        let (found, seconds) = diagnosed(&subject, threads);
        let causes: Vec<&str> = found.causes.iter().map(|cause| cause.kind).collect();
        let runs = seconds * threads as f64 * nominal / (3 * ROWS) as f64;
        println!("{line} {seconds:>11.2} {runs:>9.0}  {} {} ({})", found.verdict.name(), causes.join(", "), subject.effect);
    }
}
