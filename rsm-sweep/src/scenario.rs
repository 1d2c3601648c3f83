//! What is swept: the file of a sweep with all files that it names.
//!
//! In: TOML, and a way to open files. Out: a [`Scenario`] whose plants, records and distributions go together, or every fault with line and column.
//! Never runs anything.

mod read;
mod vary;

use std::ops::Range;

use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_core::toml_reader::{self, TableReader};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

use crate::distribution::Distribution;

/// More tasks than a folder of files holds well.
pub const MOST_TASKS: usize = 1_000_000;

/// Opens a file by the name that the scenario gives it.
pub type Open<'a> = dyn Fn(&str) -> Result<Source, Faults> + 'a;

/// A sweep with the contents of its files.
#[derive(Debug)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// Its random numbers.
    pub seed: u64,
    /// What a task is.
    pub work: Work,
    /// The file itself.
    pub(crate) source: Source,
    /// Every file that was opened: its name in the scenario and its text.
    pub(crate) files: Vec<(String, String)>,
}

/// What a task is.
#[derive(Debug)]
pub enum Work {
    /// A run of a plant along a record.
    Simulate(Simulations),
    /// A diagnosis each.
    Diagnose(Vec<Diagnosis>),
}

/// Runs of plants along records.
#[derive(Debug)]
pub struct Simulations {
    /// The plants.
    pub plants: Vec<Plant>,
    /// The names of the records.
    pub records: Vec<String>,
    /// What is varied.
    pub factors: Vec<Factor>,
    /// Which settings.
    pub(crate) points: Points,
    /// How many settings.
    pub settings: usize,
    /// Whether outputs get the noise of the plant file.
    pub noise: bool,
    /// How often each setting is run, each time with other noise.
    pub repeats: usize,
    /// Which figures of which outputs.
    pub outputs: Vec<(String, Vec<Statistic>)>,
    /// Whether a result has every row of these outputs.
    pub whole_records: bool,
}

/// A plant of a sweep.
#[derive(Debug)]
pub struct Plant {
    /// Its name in the scenario.
    pub name: String,
    /// Itself.
    pub file: PlantFile,
    /// The records, as this plant reads them, in the order of [`Simulations::records`].
    pub records: Vec<Record>,
    /// Where each factor is set, and how it is distributed here.
    pub(crate) places: Vec<Place>,
    /// The files of which it is made, as places in [`Scenario::files`].
    pub(crate) files: Vec<usize>,
}

/// Something that is varied.
#[derive(Debug)]
pub struct Factor {
    /// The name of its column.
    pub name: String,
    /// As messages speak of it.
    pub(crate) who: String,
    /// Where it stands in the scenario.
    pub(crate) span: Range<usize>,
}

/// A number of a plant.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) of: Number,
    pub(crate) unit: String,
    pub(crate) bound: rsm_sim::quantity::Bound,
    pub(crate) law: Law,
}

/// Which number.
#[derive(Debug)]
pub(crate) enum Number {
    /// A parameter.
    Parameter(&'static str),
    /// A number of an effect, by the place of the effect in the file.
    Effect(usize, &'static str),
}

/// Where its values come from.
#[derive(Debug)]
pub(crate) enum Law {
    /// A distribution.
    Drawn(Distribution),
    /// A column of a plan: a value a setting.
    Planned(Vec<f64>),
}

/// The shares at which distributions are taken.
#[derive(Debug)]
pub(crate) enum Points {
    /// Random, by the seed and the number of the setting alone.
    Random,
    /// Of a design: a share for each factor.
    Design(Vec<Vec<f64>>),
}

/// A figure of an output along a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Statistic {
    /// At the last row.
    Final,
    /// The least.
    Min,
    /// The greatest.
    Max,
    /// The mean of all rows.
    Mean,
    /// The root of the mean square of all rows.
    Rms,
    /// The root of the mean squared difference from the record.
    Rmse,
}

impl Statistic {
    /// All, with their names in the file.
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
    /// Records to estimate from, to choose by, and to judge by.
    pub records: [Vec<Record>; 3],
    /// The files of which it is made, as places in [`Scenario::files`]: of the plant, then of the three lists.
    pub(crate) files: [Vec<usize>; 4],
}

impl Scenario {
    /// Reads a scenario and every file that it names.
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

    /// The names of the files that it is made of, each once, in the order in which they were opened.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|it| it.0.as_str())
    }
}
