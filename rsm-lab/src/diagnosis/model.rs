//! The plant that the diagnosis believes in, and what of it is unknown.
//!
//! In: a plant file, records. Out: the same plant with other values of its unknowns. Knows neither residuals nor hypotheses.

use crate::plant_file::PlantFile;
use crate::record::Record;
use crate::schema::Bound;
use crate::simulate::{start_of, starting};

/// How far from its guess a positive number is searched, as a factor.
const REACH: f64 = 10.0;

/// Where an unknown stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A nominal parameter with a tolerance.
    Nominal(&'static str),
    /// A number of an effect.
    Effect {
        /// Which entry of the file.
        entry: usize,
        /// Its number.
        number: &'static str,
    },
    /// Where a record starts.
    Start {
        /// Which record.
        record: usize,
        /// Which place of the plant's starts.
        place: usize,
    },
}

/// A number that is to be found.
#[derive(Debug, Clone)]
pub struct Unknown {
    /// Where it stands.
    pub place: Place,
    /// Searched on a logarithmic scale: positive numbers that span decades.
    pub logarithmic: bool,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// What counts as one step of it (of its logarithm, where it is logarithmic).
    pub scale: f64,
    /// A Gaussian prior: centre and standard deviation.
    pub prior: Option<(f64, f64)>,
}

impl Unknown {
    /// Of a number with a bound, at a start value.
    #[must_use]
    pub fn bounded(place: Place, bound: Bound, start: f64) -> Self {
        let (low, high) = match bound {
            Bound::Any | Bound::Count => (f64::NEG_INFINITY, f64::INFINITY),
            // Two decades about a guess. A stiffness or a time constant further off makes a simulation of thousands of sub-steps a row, of a
            // motion that no row shows.
            Bound::Positive => (start / REACH, start * REACH),
            Bound::NotNegative if start > 0.0 => (0.0, start * REACH * REACH),
            Bound::NotNegative => (0.0, f64::INFINITY),
            // A share of 2 % at either end is as good as nothing or all.
            Bound::Between(low, high) => (low + 0.02 * (high - low), high - 0.02 * (high - low)),
        };
        let logarithmic = bound == Bound::Positive && start > 0.0;
        let scale = if logarithmic {
            0.1
        } else if start == 0.0 {
            1.0
        } else {
            0.1 * start.abs()
        };
        Unknown { place, logarithmic, low, high, scale, prior: None }
    }

    /// A value on the scale of the search.
    #[must_use]
    pub fn inward(&self, value: f64) -> f64 {
        if self.logarithmic { value.ln() } else { value }
    }

    /// A value of the search as the plant has it, within the bounds.
    #[must_use]
    pub fn outward(&self, searched: f64) -> f64 {
        let value = if self.logarithmic { searched.clamp(-700.0, 700.0).exp() } else { searched };
        value.max(self.low).min(self.high)
    }
}

/// A plant with its starts.
#[derive(Debug, Clone)]
pub struct Model {
    /// The plant; effects are the causes that are believed.
    pub file: PlantFile,
    /// First readings of each record's outputs.
    pub starts: Vec<[f64; 3]>,
    /// What is searched.
    pub unknowns: Vec<Unknown>,
}

impl Model {
    /// The nominal plant: parameters with a tolerance and all starts are unknown.
    #[must_use]
    pub fn nominal(file: &PlantFile, records: &[&Record], sds: [f64; 3]) -> Self {
        let mut unknowns = Vec::new();
        for (name, tolerance) in &file.tolerance {
            let (Some(value), true) = (file.parameters.optional(name), *tolerance > 0.0) else { continue };
            let sd = tolerance * value.abs();
            if sd > 0.0 {
                unknowns.push(Unknown {
                    place: Place::Nominal(name),
                    logarithmic: false,
                    // Beyond two standard deviations it is a cause, not calibration (docs/formats.md 4.3).
                    low: value - 2.0 * sd,
                    high: value + 2.0 * sd,
                    scale: sd,
                    prior: Some((value, sd)),
                });
            }
        }
        let mut model = Model { file: file.clone(), starts: Vec::new(), unknowns };
        model.take_starts(records, sds);
        model
    }

    /// Replaces the records: their starts are the readings of their first rows, and unknown.
    pub fn take_starts(&mut self, records: &[&Record], sds: [f64; 3]) {
        self.unknowns.retain(|unknown| !matches!(unknown.place, Place::Start { .. }));
        self.starts.clear();
        for (k, record) in records.iter().enumerate() {
            let mut start = [0.0; 3];
            for &place in starting(record, self.file.kind) {
                start[place] = start_of(&self.file, record, place).unwrap_or(0.0);
                let scale = self.scale_of_start(record, place, sds);
                self.unknowns.push(Unknown {
                    place: Place::Start { record: k, place },
                    logarithmic: false,
                    low: f64::NEG_INFINITY,
                    high: f64::INFINITY,
                    scale,
                    prior: None,
                });
            }
            self.starts.push(start);
        }
    }

    /// What counts as a step of a start: the noise of its output; of a speed that no output holds, what this noise makes of the difference of two rows.
    fn scale_of_start(&self, record: &Record, place: usize, sds: [f64; 3]) -> f64 {
        match self.file.kind.output(self.file.kind.starts()[place].name) {
            Some(output) => sds[output],
            None => sds[0] * std::f64::consts::SQRT_2 / record.period,
        }
    }

    /// The value of an unknown.
    ///
    /// # Panics
    /// When the plant has no such number: unknowns are made from the plant's own.
    #[must_use]
    pub fn value(&self, unknown: usize) -> f64 {
        match self.unknowns[unknown].place {
            Place::Nominal(name) => self.file.parameters.number(name),
            Place::Effect { entry, number } => self.file.effects[entry].arguments.number(number),
            Place::Start { record, place } => self.starts[record][place],
        }
    }

    /// The model with some unknowns moved, each on the scale of its search and within its bounds.
    #[must_use]
    pub fn moved(&self, unknowns: &[usize], change: &[f64]) -> Model {
        let mut moved = self.clone();
        for (&k, change) in unknowns.iter().zip(change) {
            let unknown = &self.unknowns[k];
            moved.set(k, unknown.outward(unknown.inward(self.value(k)) + change));
        }
        moved
    }

    /// The same plant with another value of an unknown.
    pub fn set(&mut self, unknown: usize, value: f64) {
        match self.unknowns[unknown].place {
            Place::Nominal(name) => self.file.parameters.set(name, value),
            Place::Effect { entry, number } => {
                let numbers = &mut self.file.effects[entry].arguments.numbers;
                if let Some(found) = numbers.iter_mut().find(|(name, _)| *name == number) {
                    found.1 = value;
                }
            }
            Place::Start { record, place } => self.starts[record][place] = value,
        }
    }

    /// The plant file of a record: its start stands under `[initial]`.
    #[must_use]
    pub fn for_record(&self, record: usize, of: &Record) -> PlantFile {
        let mut file = self.file.clone();
        let start = self.starts[record];
        file.initial = starting(of, file.kind).iter().map(|&place| (file.kind.starts()[place].name, start[place])).collect();
        file
    }
}
