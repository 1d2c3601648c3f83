//! How many rows a second each shipped plant runs, on the shipped record. In: nothing. Out: a line a plant. Judges nothing.

use std::path::Path;
use std::time::Instant;

use rsm_core::source::Source;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::{Outputs, Simulator};

/// Runs of each record: together a second or so.
const RUNS: usize = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("plants");
    for name in ["pmac", "driveline", "servo-axis"] {
        let plant = PlantFile::read(&Source::read(&folder.join(format!("{name}.toml")))?)?;
        let record = Record::read(&Source::read(&folder.join(format!("{name}.csv")))?, &plant)?;
        let mut simulator = Simulator::new(&plant, &record)?;
        let mut outputs = Outputs::default();
        let start = Instant::now();
        for _ in 0..RUNS {
            simulator.run_into(&record, &mut outputs)?;
        }
        let rate = (RUNS * record.rows()) as f64 / start.elapsed().as_secs_f64();
        println!("{name}: {rate:.0} rows/s, {:.0} times real time", rate * record.period);
    }
    Ok(())
}
