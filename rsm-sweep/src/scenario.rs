//! The file of a sweep, with all files to which it refers.
//!
//! In: TOML, a function that opens files. Out: a [`Scenario`] whose plants, records and distributions fit together, or every fault with line and
//! column. Runs nothing.

mod read;
mod vary;

use std::ops::Range;

use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_core::toml_reader::{self, TableReader};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use crate::distribution::Distribution;

/// The largest number of tasks: a folder with more files is slow.
pub const MOST_TASKS: usize = 1_000_000;

/// Opens a file by its name in the scenario.
pub type Open<'a> = dyn Fn(&str) -> Result<Source, Faults> + 'a;

/// A sweep with the contents of its files.
#[derive(Debug)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// The seed of its random numbers.
    pub seed: u64,
    /// What its tasks do.
    pub work: Work,
    /// The file itself.
    pub(crate) source: Source,
    /// Every file that was opened: its name in the scenario and its text.
    pub(crate) files: Vec<(String, String)>,
}

/// What the tasks of a sweep do.
#[derive(Debug)]
pub enum Work {
    /// A run of a plant along a record.
    Simulate(Simulations),
    /// Diagnoses, one in each task.
    Diagnose(Vec<Diagnosis>),
}

/// Runs of plants along records.
#[derive(Debug)]
pub struct Simulations {
    /// The plants.
    pub plants: Vec<Plant>,
    /// The names of the records.
    pub records: Vec<String>,
    /// The varied factors.
    pub factors: Vec<Factor>,
    /// The settings.
    pub(crate) points: Points,
    /// The number of settings.
    pub settings: usize,
    /// Whether the noise of the plant file is added to outputs.
    pub noise: bool,
    /// The number of runs of each setting, each with different noise.
    pub repeats: usize,
    /// The outputs, each with its figures.
    pub outputs: Vec<(String, Vec<Statistic>)>,
    /// Whether a result contains every row of these outputs.
    pub whole_records: bool,
}

/// A plant of a sweep.
#[derive(Debug)]
pub struct Plant {
    /// Its name in the scenario.
    pub name: String,
    /// The plant file.
    pub file: PlantFile,
    /// The records, as this plant reads them, in the order of [`Simulations::records`].
    pub records: Vec<Record>,
    /// The number and the distribution of each factor in this plant.
    pub(crate) places: Vec<Place>,
    /// The files that it consists of, as indices in [`Scenario::files`].
    pub(crate) files: Vec<usize>,
}

/// A varied factor.
#[derive(Debug)]
pub struct Factor {
    /// The name of its column.
    pub name: String,
    /// Its name in messages.
    pub(crate) who: String,
    /// Its position in the scenario.
    pub(crate) span: Range<usize>,
}

/// A number of a plant, with its distribution.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) of: Number,
    pub(crate) unit: String,
    pub(crate) bound: rsm_sim::quantity::Bound,
    pub(crate) law: Law,
}

/// The number of a plant.
#[derive(Debug)]
pub(crate) enum Number {
    /// A parameter.
    Parameter(&'static str),
    /// A number of an effect; the first field is the index of the effect in the file.
    Effect(usize, &'static str),
}

/// The source of the values.
#[derive(Debug)]
pub(crate) enum Law {
    /// A distribution.
    Drawn(Distribution),
    /// A column of a plan: one value for each setting.
    Planned(Vec<f64>),
}

/// The shares at which distributions are evaluated.
#[derive(Debug)]
pub(crate) enum Points {
    /// Random; they depend only on the seed and the number of the setting.
    Random,
    /// From a design: one share for each factor.
    Design(Vec<Vec<f64>>),
}

/// A figure of an output along a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Statistic {
    /// The value at the last row.
    Final,
    /// The smallest value.
    Min,
    /// The largest value.
    Max,
    /// The mean of all rows.
    Mean,
    /// The root mean square of all rows.
    Rms,
    /// The root mean square of the difference from the record.
    Rmse,
}

impl Statistic {
    /// All figures with their names in the file.
    pub const ALL: [(&'static str, Statistic); 6] = [
        ("final", Statistic::Final),
        ("min", Statistic::Min),
        ("max", Statistic::Max),
        ("mean", Statistic::Mean),
        ("rms", Statistic::Rms),
        ("rmse", Statistic::Rmse),
    ];

    /// The name in the file.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|it| it.1 == self).map_or("", |it| it.0)
    }
}

/// A diagnosis that is a task.
#[derive(Debug)]
pub struct Diagnosis {
    /// Its name.
    pub name: String,
    /// The name of the plant file.
    pub plant_name: String,
    /// The plant.
    pub plant: PlantFile,
    /// Records for training, validation and test.
    pub records: [Vec<Record>; 3],
    /// The files that it consists of, as indices in [`Scenario::files`]: those of the plant, then of the three lists.
    pub(crate) files: [Vec<usize>; 4],
}

impl Scenario {
    /// Reads a scenario and every file to which it refers.
    ///
    /// # Errors
    /// Every fault, with its place.
    pub fn read(source: &Source, open: &Open<'_>) -> Result<Scenario, Faults> {
        let mut faults = Collector::new();
        let document = toml_reader::parse(source, &mut faults);
        let scenario = document.and_then(|document| {
            let mut top = TableReader::document(source, &document);
            let scenario = read::scenario(&mut top, open, &mut faults);
            top.finish(&mut faults);
            scenario
        });
        faults.finish(scenario)
    }

    /// A fault at a factor.
    pub(crate) fn fault(&self, factor: &Factor, what: &str) -> Fault {
        self.source.fault(factor.span.clone(), format!("{}: {what}", factor.who))
    }

    /// The names of all files that it consists of, each once, in the order of opening.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|it| it.0.as_str())
    }
}
