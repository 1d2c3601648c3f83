//! The fit specification (docs/book/src/reference/formats.md 3): which data, which inputs, which responses, how terms are chosen.
//!
//! In: a TOML file. Out: a [`Specification`] whose parts fit together as far as they can be judged without the data, or every
//! fault with line and column and what is accepted. Paths in it are relative to it. What the format names but this version
//! cannot do is refused in words, never ignored. Never opens a data file.
//!
//! Beyond the format's own example: `column` names the column of an input or of a response where it is not called like it, and
//! a split keeps declared rows on one side:
//!
//! ```toml
//! validate = { share = 0.3, seed = 7, keep_together = ["run"], mirror = ["i_q"] }
//! ```
//!
//! Rows that judge and choose nothing are named beside `validate` in the same way; the ladder chooses by the rows of `validate`:
//!
//! ```toml
//! test = ["untouched.csv"]         # or { share = 0.2, seed = 7 }, split off before all else
//! ```
//!
//! and a response says where its data support it, by half-spaces that hold all rows to fit:
//!
//! ```toml
//! support = "data"                 # or { from = "data", margin = 0.05, faces = 8 }: margin in coded units, faces with two inputs
//! ```
//!
//! `weights` names a column of the data to fit, proportional to 1/sigma^2 of each row, or the column of sigma itself:
//!
//! ```toml
//! weights = "runs"                 # or { standard_error = "damping_ratio_error" }; only ratios of weights count
//! ```
//!
//! Rows with the same cell in every column of `keep_together` stay together (a run, a day, a specimen). So do rows that agree
//! in all inputs but for the sign of those named by `mirror` (a map whose halves were made from each other).

mod read;
mod rules;
mod shape;

use std::path::{Path, PathBuf};

use rsm_core::model::{Outside, Surface};
use rsm_core::places::Places;
use rsm_core::source::{Collector, Fault, Faults, Source};

pub(crate) use rules::check_basis_against_ranges;
pub use shape::{Constraint, SupportSpec};
pub(crate) use shape::{FACES, MOST_FACES};

/// So many candidate terms are the most: the triangle of all of them is held in memory and each step looks at all.
pub const MOST_TERMS: usize = 1000;

/// What to fit to what, and how.
#[derive(Debug)]
pub struct Specification {
    /// The name of the model.
    pub model: String,
    /// Files with the data to fit, as written.
    pub data: Vec<String>,
    /// The rows by which a ladder chooses; where terms are given they are unseen.
    pub validation: Validation,
    /// The rows that judge at the very end and choose nothing.
    pub test: Validation,
    /// The natural variables, in the order of the file.
    pub inputs: Vec<InputSpec>,
    /// The responses, in the order of the file.
    pub responses: Vec<ResponseSpec>,
    /// Which rows stay together in every split, beyond what the splits say.
    pub(crate) together: Together,
    /// Its text; none when it was made in memory.
    source: Option<Source>,
    folder: PathBuf,
    places: Places,
}

/// Which rows stay together, whatever is split. A file says it of each split.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Together {
    /// Columns: rows that agree in all of them stay together.
    pub columns: Vec<String>,
    /// Inputs: rows that agree in all inputs but for the sign of these stay together.
    pub mirror: Vec<String>,
}

/// How faults call a fit that was asked for in memory.
pub(crate) const IN_MEMORY: &str = "fit";

/// Where rows that are not fitted come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Validation {
    /// From nowhere.
    None,
    /// From rows of their own: files, as written, or what rows in memory are called.
    Files(Vec<String>),
    /// From the data: rows set aside.
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
    /// Inputs: rows that agree in all inputs but for the sign of these stay together.
    pub mirror: Vec<String>,
}

/// An input of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct InputSpec {
    /// Its name.
    pub name: String,
    /// The column of the data.
    pub column: String,
    /// Its unit; that of the data's header where absent.
    pub unit: Option<String>,
    /// Its range; that of the data where absent.
    pub range: Option<[f64; 2]>,
    /// What an evaluator does outside the range.
    pub outside: Outside,
    /// Where its values repeat: readings are brought into one period, from the bottom of the range or from 0 on.
    pub period: Option<f64>,
}

/// A response of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseSpec {
    /// The column of the data.
    pub column: String,
    /// Its unit; that of the data's header where absent.
    pub unit: Option<String>,
    /// Name, inputs, coding, symmetry, knots, sigmoids, waves, reciprocal and output range; no terms yet, and the unit as far as it is given.
    pub surface: Surface,
    /// How the terms are chosen.
    pub method: Method,
    /// How much each row counts; all alike where absent.
    pub weights: Option<Weights>,
    /// What the surface must keep, over its whole supported region.
    pub constraints: Vec<Constraint>,
    /// Whether the model says where the data support the surface.
    pub support: Option<SupportSpec>,
    /// The forms that may be taken; absent: powers, and sigmoids where they are clearly better.
    pub forms: Option<Vec<Form>>,
}

/// What a surface may be made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// Powers of the inputs, and of what the specification makes of them.
    Polynomial,
    /// Smooth steps too, whose places the data choose.
    Sigmoid,
    /// Cosines and sines over an input with a period, whose orders the data choose.
    Wave,
}

/// A column of the data that says how much each row counts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Weights {
    /// The weight itself, proportional to 1/sigma^2 of the row.
    Weight(String),
    /// The standard error sigma of the row's response, in any unit or none: only ratios count.
    StandardError(String),
}

impl Weights {
    /// The column.
    #[must_use]
    pub fn column(&self) -> &str {
        match self {
            Weights::Weight(column) | Weights::StandardError(column) => column,
        }
    }
}

/// How the terms of a response are chosen.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// Figure 1 of the paper: grow until the confidence C is reached.
    Ladder {
        /// The highest order of a candidate.
        max_order: u32,
        /// C in percent.
        confidence: f64,
    },
    /// These terms, no choice.
    Fixed(Vec<Vec<u32>>),
    /// All terms up to an order, no choice.
    FixedOrder(u32),
    /// Among all terms up to an order, by a criterion.
    Search(Search),
}

/// Rows are left out in ten parts: each fit then has nine tenths of the rows, and is judged a little too hard (by 1 % in the median over random
/// surfaces).
pub(crate) const PARTS: usize = 10;

/// A search among all terms up to an order.
///
/// ```
/// use rsm_fit::spec::{Criterion, Direction, Search, SearchBy};
///
/// let search = Search { criterion: Some(Criterion::Aicc), ..Search::new(SearchBy::Stepwise(Direction::Both), 3) };
/// assert_eq!(search.parts, 10);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Search {
    /// How.
    pub by: SearchBy,
    /// The highest order of a candidate.
    pub max_order: u32,
    /// What picks the number of terms. None: validation rows where there are some, else the fitted rows left out in turn.
    pub criterion: Option<Criterion>,
    /// A term stands only where those of one power less stand.
    pub heredity: bool,
    /// The fewest terms within a standard error of the best.
    pub one_standard_error: bool,
    /// The parts of rows that are left out in turn, from 3 to 100.
    pub parts: usize,
}

impl Search {
    /// A search that decides by rows left out in ten parts, or by validation rows where there are some.
    #[must_use]
    pub fn new(by: SearchBy, max_order: u32) -> Self {
        Search { by, max_order, criterion: None, heredity: false, one_standard_error: false, parts: PARTS }
    }
}

/// How terms are searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchBy {
    /// Term by term.
    Stepwise(Direction),
    /// The best model of each size, by branch and bound.
    BestSubset,
    /// The path of the LASSO, and of least squares on its terms.
    Lasso,
}

impl SearchBy {
    /// As a specification has it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            SearchBy::Stepwise(_) => "stepwise",
            SearchBy::BestSubset => "best-subset",
            SearchBy::Lasso => "lasso",
        }
    }
}

/// Which way steps go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Terms enter.
    Forward,
    /// Terms leave the largest model.
    Backward,
    /// Terms enter, and leave again where that gives a better model of their number.
    Both,
}

/// What picks the number of terms, or the penalty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// Errors at rows left out one at a time, of models chosen with them.
    Press,
    /// Errors on rows left out in parts, of models chosen without them.
    KFold,
    /// Akaike's criterion with its correction for few rows.
    Aicc,
    /// Errors on validation rows.
    HeldOut,
}

impl Criterion {
    /// As a specification has it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Criterion::Press => "press",
            Criterion::KFold => "k-fold",
            Criterion::Aicc => "aicc",
            Criterion::HeldOut => "held-out",
        }
    }
}

/// Best subsets are searched among so many candidates at most: beyond it branch and bound finds no proof in a reasonable time.
pub(crate) const MOST_FOR_SUBSETS: usize = 40;

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

    /// A specification of rows in memory. Gives it with the faults of its parts; the caller adds those of the rows.
    pub(crate) fn in_memory(
        model: String,
        (validation, test): (Validation, Validation),
        inputs: Vec<InputSpec>,
        responses: Vec<ResponseSpec>,
        together: Together,
        faults: &mut Collector,
    ) -> Self {
        let (data, folder, places) = (Vec::new(), PathBuf::new(), Places::default());
        let specification =
            Specification { model, data, validation, test, inputs, responses, together, source: None, folder, places };
        rules::check(&specification, faults);
        specification
    }

    /// The text from which it was read; none when it was made in memory.
    #[must_use]
    pub fn source(&self) -> Option<&Source> {
        self.source.as_ref()
    }

    /// Where a file that is named in it lies.
    #[must_use]
    pub(crate) fn path_of(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// The columns that keep rows together in some split, each once.
    #[must_use]
    pub fn labels(&self) -> Vec<&str> {
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

    /// The input of a name.
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
