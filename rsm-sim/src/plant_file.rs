//! The plant file (docs/book/src/reference/plants.md 1.1) as the simulation sees it.
//!
//! In: a file, by `read`. Out: [`PlantFile`], and its text again with the effects filled in, by `write`. Only numbers that keep their
//! bounds are in a [`PlantFile`] that was read.

mod read;
mod write;

pub use crate::effect::Entry;
use crate::kind::PlantKind;
pub use crate::parameters::{Parameters, VelocityFrom};

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
