//! `rsm import`: makes one record from files of other tools.
//!
//! In: tables in any usual encoding and separator, MDF and MAT files. Out: a CSV file with units at a constant period, complete or not written at
//! all; and a list of the conversions, as comments at the beginning of the file, in words and as JSON.

use std::path::{Path, PathBuf};

use clap::Args;
use rsm_core::source::{Fault, Faults, Source};
use rsm_import::{File, Named, Record, Wishes};
use rsm_sim::plant_file::PlantFile;
use serde_json::{Value, json};

use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// Files of one run. The first gives the time base; the others are aligned with it
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// A column of the record: NAME=COLUMN, or NAME=COLUMN[unit] [default: every column of numbers]
    #[arg(long = "column", value_name = "NAME=COLUMN[unit]")]
    columns: Vec<Named>,
    /// A constant column that is in no file, such as `load_torque=0[N*m]` for an unloaded motor
    #[arg(long = "constant", value_name = "NAME=NUMBER[unit]")]
    constants: Vec<Named>,
    /// The time column, if its name does not show it
    #[arg(long, value_name = "COLUMN[unit]")]
    time: Option<String>,
    /// A column to resample with a zero-order hold
    #[arg(long, value_name = "NAME")]
    hold: Vec<String>,
    /// The sampling period of the record, in s [default: the mean period of the first file]
    #[arg(long, value_name = "SECONDS")]
    period: Option<f64>,
    /// A signal that is in two files, by its name in each (FIRST=SECOND): it aligns their clocks
    #[arg(long, value_name = "FIRST=SECOND")]
    align: Option<Named>,
    /// A plant file: refuse a record that does not fit this plant
    #[arg(long)]
    plant: Option<PathBuf>,
    /// The CSV file to write
    #[arg(long)]
    out: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Outcome {
    let mut files = Vec::new();
    for path in &arguments.files {
        files.push(File { name: path.display().to_string(), bytes: Source::bytes(path)? });
    }
    let wishes = Wishes {
        columns: arguments.columns.clone(),
        constants: arguments.constants.clone(),
        time: arguments.time.clone(),
        hold: arguments.hold.clone(),
        period: arguments.period,
        align: arguments.align.clone(),
    };
    let record = rsm_import::import(&files, &wishes)?;
    let text = record.csv();
    if let Some(path) = &arguments.plant {
        let plant = PlantFile::read(&Source::read(path)?)?;
        let name = arguments.out.display().to_string();
        rsm_sim::record::Record::read_with_gaps(&Source::new(name, &*text), &plant).map_err(|found| of_import(&found, path))?;
    }
    output::write_all(&[(arguments.out.clone(), text.as_bytes())])?;
    for note in &record.notes {
        stderr_line!("{note}");
    }
    if arguments.json {
        output::json(&report(&record, &arguments.out))?;
    } else {
        stderr_line!(
            "{}: {} rows, {} columns, period {} s",
            arguments.out.display(),
            record.rows(),
            record.columns.len(),
            record.period
        );
    }
    Ok(Answer::Positive)
}

/// Faults of a record that was not written: they have no line numbers.
fn of_import(found: &Faults, plant: &Path) -> Faults {
    let first = &found.list()[0];
    let what = format!("the record cannot be read for this plant: {}", first.what);
    let fault = Fault::whole_file(&plant.display().to_string(), what);
    let help = "name the column with --column NAME=COLUMN[unit], or give --constant NAME=NUMBER[unit] (load_torque=0[N*m] of an unloaded motor)";
    Faults::one(match &first.help {
        Some(more) => fault.help(format!("{more}; {help}")),
        None => fault.help(help),
    })
}

fn report(record: &Record, out: &Path) -> Value {
    let columns: Vec<Value> =
        record.columns.iter().map(|column| json!({ "name": column.name, "unit": column.unit, "from": column.from })).collect();
    let alignments: Vec<Value> = record
        .alignments
        .iter()
        .map(|it| {
            json!({
                "file": it.file,
                "by": [it.first, it.second],
                "correlation": it.correlation,
                "offset": it.offset,
                "offset_interval": [it.offset - it.offset_half_width, it.offset + it.offset_half_width],
                "at": it.middle,
                "rate": it.rate,
                "rate_interval": [it.rate - it.rate_half_width, it.rate + it.rate_half_width],
            })
        })
        .collect();
    json!({
        "rows": record.rows(),
        "period": record.period,
        "resampled": record.is_resampled,
        "columns": columns,
        "alignments": alignments,
        "notes": record.notes,
        "out": out.display().to_string(),
    })
}
