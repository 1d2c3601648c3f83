//! Prints tables of `rsm fit` beside other programs, measured in one run: digits, a large table, chosen terms, maps.
//!
//! In: the command `rsm`; `--rows N` of the large table, a million by default; `--quick`: fewer random surfaces. Out: the tables of
//! `bench/peers/fit.py`, or why they are not available. No limits are checked, because times depend on the machine.

use std::path::Path;
use std::process::ExitCode;

use rsm_bench::peers;

/// Random surfaces for the comparison with LassoCV: the median of 60 errors scatters by a tenth.
const SURFACES: u32 = 60;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some((program, rows, surfaces)) = arguments(&words) else {
        eprintln!("usage: fit-table RSM [--rows N] [--quick]");
        return ExitCode::from(2);
    };
    match peers::fits(Path::new(program), rows, surfaces) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => {
            println!("SKIPPED: numpy, statsmodels, polars, duckdb, scikit-learn: {why}");
            ExitCode::SUCCESS
        }
    }
}

/// The command, the rows of the large table and the number of surfaces; `None` for any other words.
fn arguments(words: &[String]) -> Option<(&str, u32, u32)> {
    let (program, mut rest) = words.split_first()?;
    let (mut rows, mut surfaces) = (1_000_000, SURFACES);
    while let Some((word, after)) = rest.split_first() {
        rest = after;
        match word.as_str() {
            "--quick" => surfaces = SURFACES / 6,
            "--rows" => {
                rows = rest.first()?.parse().ok()?;
                rest = &rest[1..];
            }
            _ => return None,
        }
    }
    Some((program, rows, surfaces))
}
