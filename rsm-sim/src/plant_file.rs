//! The plant file (docs/book/src/reference/plants.md 1.1) as the simulation sees it.
//!
//! In: a file, by `read`. Out: [`PlantFile`], and its text again with the effects filled in, by `write`. Only numbers that keep their
//! bounds are in a [`PlantFile`] that was read.

mod read;
mod write;

use crate::effect::{Arguments, Description};
use crate::kind::PlantKind;
use crate::schema;

/// Where the controller of an axis takes the velocity from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VelocityFrom {
    /// The state itself.
    State,
    /// The backward difference of the two-sample mean of the position.
    Difference,
}

/// The nominal parameters of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    kind: PlantKind,
    /// In the order of [`schema::parameters`].
    values: Vec<Option<f64>>,
    /// Gear ratios of a driveline, first gear first; 1 elsewhere.
    pub gear_ratios: [f64; 5],
    /// Of an axis.
    pub velocity_from: VelocityFrom,
}

impl Parameters {
    /// A parameter that may be left out; `gear_ratios[3]` is the ratio of third gear.
    #[must_use]
    pub fn optional(&self, name: &str) -> Option<f64> {
        match schema::index(self.kind, name) {
            Some(index) => self.values[index],
            None => schema::gear(self.kind, name).map(|gear| self.gear_ratios[gear]),
        }
    }

    /// A parameter that the plant requires.
    ///
    /// # Panics
    /// When the plant has no such parameter: the names in the code and in the schema are ours.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name).unwrap_or_else(|| panic!("the parameter `{name}` was checked when the file was read"))
    }

    /// Gives a parameter another value; a name that the plant does not have changes nothing.
    pub fn set(&mut self, name: &str, value: f64) {
        if let Some(index) = schema::index(self.kind, name) {
            self.values[index] = Some(value);
        } else if let Some(gear) = schema::gear(self.kind, name) {
            self.gear_ratios[gear] = value;
        }
    }
}

/// A number by name, as in `[tolerance]`, `[noise]` and `[initial]`.
pub type Named = (&'static str, f64);

/// A column of the record under another name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Renamed {
    /// The name of docs/book/src/reference/plants.md 1.2.
    pub signal: &'static str,
    /// The name in the record.
    pub column: String,
    /// The unit, where the header has none.
    pub unit: Option<String>,
}

/// An effect that stands in a file.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Which effect.
    pub description: &'static Description,
    /// With what.
    pub arguments: Arguments,
}

/// A plant file.
#[derive(Debug, Clone)]
pub struct PlantFile {
    /// The plant.
    pub kind: PlantKind,
    /// Nominal parameters, without what an effect changes of them.
    pub parameters: Parameters,
    /// Relative 1-sigma uncertainty of parameters.
    pub tolerance: Vec<Named>,
    /// 1-sigma noise of outputs, in their units.
    pub noise: Vec<Named>,
    /// Start values of outputs.
    pub initial: Vec<Named>,
    /// Effects that belong to the plant and are not in question: a diagnosis of a plant that comes with effects puts them here. They act before the others.
    pub given: Vec<Entry>,
    /// Effects, in the order of the file.
    pub effects: Vec<Entry>,
    /// Columns of the record under other names.
    pub columns: Vec<Renamed>,
}

impl PlantFile {
    /// All effects in the order in which they act.
    pub fn acting(&self) -> impl Iterator<Item = &Entry> {
        self.given.iter().chain(&self.effects)
    }

    /// The parameters with what effects change of them.
    #[must_use]
    pub fn effective_parameters(&self) -> Parameters {
        let mut parameters = self.parameters.clone();
        for entry in self.acting() {
            (entry.description.build)(&entry.arguments).parameters(&mut parameters);
        }
        parameters
    }
}
