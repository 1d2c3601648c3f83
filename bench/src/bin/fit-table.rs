//! Prints tables of `rsm fit` beside other programs, measured in one run: digits, a large table, chosen terms, maps.
//!
//! In: the command `rsm`; `--rows N` of the large table, a million by default; `--quick`: fewer random surfaces. Out: the tables of
//! `bench/peers/fit.py`, or why they are not available. No limits are checked, because times depend on the machine.

use std::path::PathBuf;

use rsm_bench::peers;

/// Random surfaces for the comparison with LassoCV: the median of 60 errors scatters by a tenth.
const SURFACES: u32 = 60;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some(program) = words.first().map(PathBuf::from) else {
        eprintln!("usage: fit-table RSM [--rows N] [--quick]");
        std::process::exit(2);
    };
    let rows = words.iter().position(|word| word == "--rows").and_then(|place| words.get(place + 1)?.parse().ok());
    let surfaces = if words.iter().any(|word| word == "--quick") { SURFACES / 6 } else { SURFACES };
    if let Err(why) = peers::fits(&program, rows.unwrap_or(1_000_000), surfaces) {
        println!("SKIPPED: numpy, statsmodels, polars, duckdb, scikit-learn: {why}");
    }
}
