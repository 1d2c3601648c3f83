//! Prints one table of the cost of simulations and diagnoses, measured in one run.
//!
//! In: nothing; with `--quick` no diagnoses. Out: rows per second of each plant, nominal and with an effect, their ratio, and the ratio to real time;
//! the seconds of a diagnosis of three records of 8000 rows, and the number of runs along all three records that would take the same time. Then the
//! same plants as texts of equations: rows per second with an error that is at most that of the plant in Rust, for one lane and for eight, relative
//! to Rust and to one lane; the time from text to first row; exact sensitivities compared with differences; SciPy LSODA and diffsol at the same
//! tolerance, or why they are not available. No limits are checked, because times depend on the machine.

use rsm_bench::engines::{LANES, Text, comparable, error, in_turn, run_in_rust, shortest};
use rsm_bench::peers;
use rsm_bench::simulation::{ROWS, SUBJECTS, diagnosed, rows_per_second};

fn main() {
    let quick = std::env::args().any(|word| word == "--quick");
    let threads = rsm_core::threads::available();
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
    texts();
}

/// The same plants as texts, compared with the plants in Rust.
fn texts() {
    println!(
        "\nplants as texts, without effect; errors against the text at a tolerance of 1e-13, as a share of an output's size\n\n{:<11}| {:>9} {:>9} {:>9} {:>12} {:>8} | {:>12} {:>8} | {:>10}",
        "", "error", "in Rust", "tolerance", "rows/s", "to Rust", "eight lanes", "to one", "first row"
    );
    for subject in SUBJECTS {
        let record = subject.record(1);
        let text = Text::of(&subject, &record);
        let (tolerance, own, rust) = comparable(&text, &subject, &record);
        let seconds =
            in_turn([&mut text.run(1, tolerance), &mut text.run(LANES, tolerance), &mut run_in_rust(&subject, &record)]);
        let [one, eight, old] = seconds.map(|it| text.signals.time.len() as f64 / it);
        let eight = LANES as f64 * eight;
        println!(
            "{:<11}| {own:>9.0e} {rust:>9.0e} {tolerance:>9.0e} {one:>12.0} {:>8.2} | {eight:>12.0} {:>8.2} | {:>7.1} ms",
            subject.plant,
            one / old,
            eight / one,
            1e3 * text.first_row()
        );
    }
    sensitivities();
    peers();
}

/// Exact derivatives with respect to ten parameters and values of the start, or to all that there are, compared with differences.
fn sensitivities() {
    println!(
        "\nsensitivities at a tolerance of 1e-8; differences of one run a quantity (a parameter or a value of the start) and one more; `off`: the largest error against central differences at a tolerance of 1e-12, as a share of a derivative's size\n\n{:<11}| {:>10} {:>9} {:>12} {:>12} {:>9}",
        "", "quantities", "ms", "one by one", "in lanes", "off"
    );
    for subject in SUBJECTS {
        let record = subject.record(1);
        let text = Text::of(&subject, &record);
        let by = text.quantities(10);
        let [own, one_by_one, side_by_side, off] = text.sensitivities(&by, 1e-8);
        println!(
            "{:<11}| {:>10} {:>9.2} {:>12.2} {:>12.2} {off:>9.0e}",
            subject.plant,
            by.len(),
            1e3 * own,
            one_by_one / own,
            side_by_side / own
        );
    }
}

/// The same tolerance for all.
const TOLERANCE: f64 = 1e-6;

/// The same plants with other solvers.
fn peers() {
    let texts: Vec<_> = SUBJECTS.iter().map(|subject| (subject.plant, Text::of(subject, &subject.record(1)))).collect();
    let plants = texts.iter().map(|(name, text)| ((*name).to_string(), text.for_peers(TOLERANCE))).collect();
    let found = match peers::measured(&plants) {
        Ok(found) => found,
        Err(why) => return println!("\nSKIPPED: SciPy LSODA and diffsol: {why}"),
    };
    println!(
        "\nother solvers at a tolerance of {TOLERANCE:.0e}, one call for each stretch of rows with the same inputs; `times`: how many times our rows a second theirs are\n\n{:<11}| {:>12} {:>9} | {:>12} {:>8} {:>9} | {:>12} {:>8} {:>9}",
        "", "rows/s", "error", "LSODA rows/s", "times", "error", "diffsol", "times", "error"
    );
    for (name, text) in &texts {
        let own = text.signals.time.len() as f64 / shortest(text.run(1, TOLERANCE));
        let off = error(&text.outputs(TOLERANCE), &text.outputs(1e-13));
        let of = |solver: &str, key: &str| found[name][solver][key].as_f64().unwrap_or(f64::NAN);
        let [lsoda, diffsol] = ["lsoda", "diffsol"].map(|it| (of(it, "rows_per_second"), of(it, "error")));
        println!(
            "{name:<11}| {own:>12.0} {off:>9.0e} | {:>12.0} {:>8.1} {:>9.0e} | {:>12.0} {:>8.1} {:>9.0e}  {}",
            lsoda.0,
            own / lsoda.0,
            lsoda.1,
            diffsol.0,
            own / diffsol.0,
            diffsol.1,
            found[name]["diffsol"]["method"]
        );
    }
}
