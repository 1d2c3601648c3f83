//! The plant file (docs/book/src/reference/plants.md 1.1) for the simulation.
//!
//! In: a file, which `equation_plant` reads. Out: [`PlantFile`], and, by `write`, its text again with the effects included. All numbers of a
//! [`PlantFile`] that was read are within their bounds.

pub(crate) mod write;

pub use crate::effect::Entry;
use crate::kind::PlantKind;
pub use crate::parameters::{Parameters, VelocityFrom};

/// A number by name, as in `[tolerance]`, `[noise]` and `[initial]`.
pub type Named = (&'static str, f64);

/// A column with a different name in the record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Renamed {
    /// The name of docs/book/src/reference/plants.md 1.2.
    pub signal: &'static str,
    /// The name in the record.
    pub column: String,
    /// The unit, if the header of the record has none.
    pub unit: Option<String>,
}

/// A plant file.
#[derive(Debug, Clone)]
pub struct PlantFile {
    /// The plant.
    pub kind: PlantKind,
    /// Nominal parameters, without changes by effects.
    pub parameters: Parameters,
    /// Relative 1-sigma uncertainty of parameters.
    pub tolerance: Vec<Named>,
    /// 1-sigma noise of outputs, in their units.
    pub noise: Vec<Named>,
    /// Start values of outputs.
    pub initial: Vec<Named>,
    /// Effects that belong to the plant and are not to be diagnosed. If a plant file already has effects, the diagnosis moves them to this list. They
    /// act before the others.
    pub given: Vec<Entry>,
    /// Effects, in the order of the file.
    pub effects: Vec<Entry>,
    /// Columns with a different name in the record.
    pub columns: Vec<Renamed>,
}

impl PlantFile {
    /// All effects in the order in which they act.
    pub fn acting(&self) -> impl Iterator<Item = &Entry> {
        self.given.iter().chain(&self.effects)
    }

    /// The share of a body's inertia that all effects put behind joints. A plant needs less than 1.
    #[must_use]
    pub fn split(&self) -> f64 {
        self.acting().map(Entry::split).sum()
    }

    /// The parameters with the changes by effects.
    #[must_use]
    pub fn effective_parameters(&self) -> Parameters {
        let mut parameters = self.parameters.clone();
        for entry in self.acting() {
            if let Some((name, value)) = entry.changed_parameter() {
                parameters.set(name, value);
            }
        }
        parameters
    }
}
