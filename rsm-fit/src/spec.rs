//! The fit specification (docs/book/src/reference/formats.md 3): data, inputs, responses, and how terms are chosen.
//!
//! In: a TOML file. Out: a [`Specification`] whose parts fit together as far as possible without the data, or every fault with line and column and
//! what is accepted. Paths are relative to the file. Keys that this version does not support are rejected with a message.
//!
//! In addition to the format's own example: `column` gives the column of an input or response with another name, and a split keeps declared rows on
//! one side:
//!
//! ```toml
//! validate = { share = 0.3, seed = 7, keep_together = ["run"], mirror = ["i_q"] }
//! ```
//!
//! Test rows, which are not used for any choice, are given in the same way; a ladder chooses terms with the rows of `validate`:
//!
//! ```toml
//! test = ["untouched.csv"]         # or { share = 0.2, seed = 7 }, split off before all else
//! ```
//!
//! A response may request a support region, in half-spaces that contain all fitted rows:
//!
//! ```toml
//! support = "data"                 # or { from = "data", margin = 0.05, faces = 8 }: margin in coded units, faces with two inputs
//! ```
//!
//! `weights` gives a column of the data to fit, proportional to 1/sigma^2 of each row, or the column of sigma itself:
//!
//! ```toml
//! weights = "runs"                 # or { standard_error = "damping_ratio_error" }; only ratios of weights count
//! ```
//!
//! An input of text is a category, and `blocks` are columns whose cells tell apart rows that were measured together (`blocks.rs`):
//!
//! ```toml
//! blocks = ["day"]                 # at the top
//! [inputs.fuel]
//! categories = ["diesel", "petrol"]    # the model has an input `fuel_diesel`: 1 for diesel, -1 for petrol
//! ```
//!
//! `transform` says what the terms of a response describe, and the model returns the response itself:
//!
//! ```toml
//! transform = "log"                # or "square-root", "reciprocal" ...; "box-cox" chooses one
//! ```
//!
//! `missing` is what to do with a row that lacks a number:
//!
//! ```toml
//! missing = "drop-row"             # leave it out for the responses that use the number; the default is "error"
//! ```
//!
//! `noise` declares autoregressive errors, and `series` the columns whose cells tell one series of measurements from another:
//!
//! ```toml
//! series = ["run"]                 # at the top; without it the rows of each file are one series
//! noise = "autoregressive"         # of a response; or { order = 2 }, { max_order = 8 }: the order has the smallest AICc
//! ```
//!
//! Rows with the same cell in every column of `keep_together` stay together (a run, a day, a specimen). So do rows whose inputs differ only in the
//! sign of those named by `mirror` (a map with mirrored halves).

mod categories;
mod method;
mod read;
mod response;
mod rules;
mod shape;
mod transform;

use std::path::{Path, PathBuf};

use rsm_core::model::{Category, Outside};
use rsm_core::places::Places;
use rsm_core::source::{Collector, Fault, Faults, Source};

use crate::missing::Missing;

pub(crate) use categories::CONTRAST;
pub use method::{Criterion, Direction, Method, Search, SearchBy};
pub(crate) use method::{MOST_FOR_SUBSETS, PARTS};
pub use response::{Form, Loss, NoiseOrder, ResponseSpec, SplineSpec, TransformSpec, Weights};
pub(crate) use rules::check_basis_against_ranges;
pub use shape::{Constraint, SupportSpec};
pub(crate) use shape::{FACES, MOST_FACES};

/// The largest number of candidate terms: the triangle of all of them is in memory, and each step uses all.
pub const MOST_TERMS: usize = 1000;

/// A fit specification.
#[derive(Debug, Clone)]
pub struct Specification {
    /// The name of the model.
    pub model: String,
    /// Files with the data to fit, as written.
    pub data: Vec<String>,
    /// Validation rows: a ladder chooses terms with them; if terms are given, they are not used for the fit.
    pub validation: Validation,
    /// Test rows, which are used only for the final errors.
    pub test: Validation,
    /// The natural variables, in the order of the file.
    pub inputs: Vec<InputSpec>,
    /// The responses, in the order of the file.
    pub responses: Vec<ResponseSpec>,
    /// What to do with missing cells.
    pub missing: Missing,
    /// Columns: rows that agree in all of them are one series of measurements. Without columns, the rows of each file are one.
    pub series: Vec<String>,
    /// Columns: rows that agree in all of them are one block, which has an effect of its own on every response.
    pub blocks: Vec<String>,
    /// Categories: columns of text, whose contrasts are inputs.
    pub categories: Vec<Category>,
    /// Rows that stay together in every split, in addition to the settings of the splits.
    pub(crate) together: Together,
    /// Its text; `None` if it was made in memory.
    source: Option<Source>,
    folder: PathBuf,
    places: Places,
}

/// Rows that stay together in every split of rows in memory. A file has these settings in each split.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Together {
    /// Columns: rows that agree in all of them stay together.
    pub columns: Vec<String>,
    /// Inputs: rows whose inputs differ only in the sign of these stay together.
    pub mirror: Vec<String>,
}

/// The name of a fit in memory in messages.
pub(crate) const IN_MEMORY: &str = "fit";

/// The source of rows that are not fitted.
#[derive(Debug, Clone, PartialEq)]
pub enum Validation {
    /// None.
    None,
    /// Separate rows: files as written, or the names of rows in memory.
    Files(Vec<String>),
    /// Rows set aside from the data.
    Split(Split),
}

/// A random split of the data.
#[derive(Debug, Clone, PartialEq)]
pub struct Split {
    /// The share of the rows that is set aside, between 0 and 1.
    pub share: f64,
    /// The seed of the random order.
    pub seed: u64,
    /// Columns: rows that agree in all of them stay together.
    pub keep_together: Vec<String>,
    /// Inputs: rows whose inputs differ only in the sign of these stay together.
    pub mirror: Vec<String>,
}

/// An input of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct InputSpec {
    /// Its name.
    pub name: String,
    /// The column of the data.
    pub column: String,
    /// Its unit; `None` for that of the data's header.
    pub unit: Option<String>,
    /// Its range; `None` for that of the data.
    pub range: Option<[f64; 2]>,
    /// The behaviour of an evaluator outside the range.
    pub outside: Outside,
    /// Its period: readings are converted to one period, from the lower end of the range or from 0.
    pub period: Option<f64>,
}

impl Specification {
    /// Reads a specification from a file.
    ///
    /// # Errors
    /// Every fault of the file.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        Self::from_source(Source::read(path)?, folder)
    }

    /// Reads a specification from its text; paths in it are relative to `folder`.
    ///
    /// # Errors
    /// Every fault of the text.
    pub fn from_source(source: Source, folder: PathBuf) -> Result<Self, Faults> {
        let mut faults = Collector::new();
        let draft = read::read(&source, &mut faults);
        let specification = draft.map(|draft| {
            let specification = Specification {
                model: draft.model,
                data: draft.data,
                validation: draft.validation,
                test: draft.test,
                inputs: draft.inputs,
                responses: draft.responses,
                missing: draft.missing,
                series: draft.series,
                blocks: draft.blocks,
                categories: draft.categories,
                together: Together::default(),
                places: draft.places,
                source: Some(source),
                folder,
            };
            rules::check(&specification, &mut faults);
            specification
        });
        faults.finish(specification)
    }

    /// A specification of rows in memory, with the faults of its parts. The caller adds those of the rows.
    pub(crate) fn in_memory(
        model: String,
        (validation, test): (Validation, Validation),
        inputs: Vec<InputSpec>,
        responses: Vec<ResponseSpec>,
        (together, missing, series, blocks): (Together, Missing, Vec<String>, Vec<String>),
        categories: Vec<Category>,
        faults: &mut Collector,
    ) -> Self {
        let (data, folder, places) = (Vec::new(), PathBuf::new(), Places::default());
        let specification = Specification {
            model,
            data,
            validation,
            test,
            inputs,
            responses,
            missing,
            series,
            blocks,
            categories,
            together,
            source: None,
            folder,
            places,
        };
        rules::check(&specification, faults);
        specification
    }

    /// Its text; `None` if it was made in memory.
    #[must_use]
    pub fn source(&self) -> Option<&Source> {
        self.source.as_ref()
    }

    /// The path of a file that it names.
    #[must_use]
    pub(crate) fn path_of(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// Whether some response has autoregressive errors.
    #[must_use]
    pub fn has_series(&self) -> bool {
        self.responses.iter().any(|response| response.noise.is_some())
    }

    /// The columns whose cells are read as text, each once: those of [`Specification::groups`], then those of the series, then those of the blocks.
    #[must_use]
    pub fn labels(&self) -> Vec<&str> {
        let mut labels = self.groups();
        for name in self.series.iter().chain(&self.blocks) {
            if !labels.contains(&name.as_str()) {
                labels.push(name);
            }
        }
        labels
    }

    /// The columns that keep rows together in any split, each once.
    #[must_use]
    pub fn groups(&self) -> Vec<&str> {
        let mut labels: Vec<&str> = Vec::new();
        for name in self.splits().flat_map(|split| &split.keep_together).chain(&self.together.columns) {
            if !labels.contains(&name.as_str()) {
                labels.push(name);
            }
        }
        labels
    }

    /// The splits: of `validate`, then of `test`.
    pub fn splits(&self) -> impl Iterator<Item = &Split> {
        [&self.validation, &self.test].into_iter().filter_map(|rows| match rows {
            Validation::Split(split) => Some(split),
            _ => None,
        })
    }

    /// The input with this name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&InputSpec> {
        self.inputs.iter().find(|input| input.name == name)
    }

    /// A fault at a part of the specification, by its dotted path.
    pub(crate) fn fault(&self, path: &str, what: impl Into<String>) -> Fault {
        match &self.source {
            Some(source) => source.fault(self.places.place(path), what),
            None => Fault::whole_file(IN_MEMORY, what),
        }
    }
}
