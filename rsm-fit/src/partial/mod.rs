//! The fit of one part of the data as sums, and the fit of all parts from their sums.
//!
//! ```text
//!   fit.toml, shard-1.csv --of--> Part --write--> part-1.rsm --read--> Part --+
//!   fit.toml, shard-2.csv --of--> Part --write--> part-2.rsm --read--> Part --+--merge--> Merged { outcome, .. }
//! ```
//!
//! In: a specification and some of the rows. Out: a [`Part`]: for each response the triangle of all candidates (`qr.rs`), counts, sums of weights,
//! ranges, and the text of the specification. [`merge`] stacks the triangles and solves once. A part holds no rows, so that figures of single rows
//! do not exist after a merge. What needs rows to choose terms is refused when the first part is made (`rules.rs`). The order of the parts does not
//! change a bit of the result. Other shards of the same rows change coefficients by less than a bound that is computed (`bound.rs`).
//!
//! ```
//! use rsm_core::source::Source;
//! use rsm_fit::{Specification, partial};
//!
//! let text = "format = 1\nmodel = \"car\"\ndata = [\"a.csv\", \"b.csv\"]\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n\
//!     [responses.drag]\nunit = \"N\"\ninputs = [\"speed\"]\nselect = { method = \"fixed\", order = 1 }\n";
//! let specification = Specification::from_source(Source::new("fit.toml", text), "".into())?;
//! let a = partial::of_sources(&specification, &[Source::new("a.csv", "speed[m/s],drag[N]\n0,5\n5,15\n")])?;
//! let b = partial::of_sources(&specification, &[Source::new("b.csv", "speed[m/s],drag[N]\n20,45\n30,65\n")])?;
//! let merged = partial::merge(vec![a, b])?;
//! assert_eq!(merged.outcome.model.surfaces[0].terms[0].coefficient, 35.0); // 35 N in the middle of the range
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bound;
mod file;
mod merge;
mod rules;

use std::path::Path;

use rsm_core::model::Input;
use rsm_core::source::{Fault, Faults, Source};

use crate::dd::Dd;
use crate::design::{self, Design};
use crate::fit::span;
use crate::left_out::{self, MissingCells};
use crate::outcome::Progress;
use crate::qr::{Compressed, Triangle};
use crate::records::{DataFile, Records, Refused, Rows, Units, hash};
use crate::selection::Sample;
use crate::spec::{Method, ResponseSpec, Specification};

pub use merge::{MergeReport, Merged, MergedReport, merge};

/// The sums of some rows.
#[derive(Debug)]
pub struct Part {
    /// Its name in messages.
    name: String,
    specification: Specification,
    files: Vec<DataFile>,
    /// The units of the inputs, then of the responses.
    units: Vec<String>,
    /// For each input the smallest and the largest value; without rows the first is above the second.
    spans: Vec<[f64; 2]>,
    /// The sums of each response.
    sums: Vec<Sums>,
    /// SHA-256 of its text: the same rows with the same specification have the same one.
    sha256: String,
}

/// The sums of the rows of one response.
#[derive(Debug)]
struct Sums {
    /// All candidates and the response, each row times the square root of its weight.
    triangle: Triangle,
    /// The smallest and the largest response.
    span: [f64; 2],
    rows_outside: usize,
    /// The rows that are left out because a cell is missing.
    left_out: usize,
    cells: Vec<MissingCells>,
    /// The sum of the weights and of their logarithms; `None` if all rows count equally.
    weights: Option<[Dd; 2]>,
}

impl Part {
    /// The number of rows of all its files.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.files.iter().map(|file| file.rows).sum()
    }

    /// Its data files.
    #[must_use]
    pub fn files(&self) -> &[DataFile] {
        &self.files
    }

    /// SHA-256 of its text without the last table, in hexadecimal.
    #[must_use]
    pub fn sha256(&self) -> &str {
        &self.sha256
    }
}

/// The sums of the data files of a specification, or of the files of one shard.
///
/// # Errors
/// What the specification requires and sums do not hold; every fault of the data files.
pub fn of_files(
    specification: &Specification,
    shard: &[impl AsRef<Path>],
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Part, Refused> {
    let shard: Vec<String> = shard.iter().map(|path| path.as_ref().display().to_string()).collect();
    let files = if shard.is_empty() { specification.data.clone() } else { shard.clone() };
    of(specification, &files, &mut |file| {
        progress(Progress::Reading { file });
        Source::read(&if shard.is_empty() { specification.path_of(file) } else { file.into() })
    })
}

/// The sums of data files in memory.
///
/// # Errors
/// Those of [`of_files`].
pub fn of_sources(specification: &Specification, sources: &[Source]) -> Result<Part, Refused> {
    let files: Vec<String> = sources.iter().map(|source| source.name().to_string()).collect();
    of(specification, &files, &mut |file| {
        let found = sources.iter().find(|source| source.name() == file).cloned();
        found.ok_or_else(|| Faults::one(Fault::whole_file(file, "is not among the files in memory")))
    })
}

fn of(
    specification: &Specification,
    files: &[String],
    open: &mut dyn FnMut(&str) -> Result<Source, Faults>,
) -> Result<Part, Refused> {
    rules::check(specification)?;
    let mut units = Units::of(specification);
    let mut records = Records::read(specification, files, Rows::ToFit, &mut units, open)?;
    for file in &mut records.files {
        // Without folders, because these are specific to one machine.
        file.name = file.name.rsplit(['/', '\\']).next().unwrap_or_default().to_string();
    }
    let counts = left_out::remove(specification, &mut records, None, None)?;
    let variables = specification.inputs.len() + specification.responses.len();
    let sums: Vec<Sums> = (0..specification.responses.len())
        .map(|k| {
            let mut sums = sums_of(specification, &records, k)?;
            for one in &counts[k] {
                sums.left_out += one.rows;
                sums.cells.extend(one.cells.iter().cloned());
            }
            Ok(sums)
        })
        .collect::<Result<_, Faults>>()?;
    let part = Part {
        name: String::new(),
        units: (0..variables).map(|k| units.get(k).to_string()).collect(),
        spans: (0..specification.inputs.len()).map(|k| span(&left_out::used_values(specification, &records, k))).collect(),
        files: records.files,
        sums,
        specification: specification.clone(),
        sha256: String::new(),
    };
    let sha256 = hash(&file::body(&part));
    Ok(Part { sha256, ..part })
}

/// The surface of a response, its inputs and its candidates. `ranges`: those of all inputs.
fn design_of(specification: &Specification, response: &ResponseSpec, inputs: &[Input]) -> (Vec<Input>, Design) {
    let used = left_out::inputs_of(specification, response).into_iter().map(|k| inputs[k].clone()).collect::<Vec<_>>();
    let terms = match &response.method {
        Method::Fixed(terms) => terms.clone(),
        Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => design::terms_up_to(&response.surface, *order),
        Method::Search(search) => design::terms_up_to(&response.surface, search.max_order),
    };
    let design = Design::new(&response.surface, &used, terms);
    (used, design)
}

fn sums_of(specification: &Specification, records: &Records, k: usize) -> Result<Sums, Faults> {
    let response = &specification.responses[k];
    // Where no range is given, the terms do not depend on it (`rules.rs`), and every row lies in the range of the data.
    let range = |given: Option<[f64; 2]>| given.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    let input = |input: &crate::spec::InputSpec| Input {
        name: input.name.clone(),
        unit: String::new(),
        range: range(input.range),
        outside: input.outside,
    };
    let inputs: Vec<Input> = specification.inputs.iter().map(input).collect();
    let (_, design) = design_of(specification, response, &inputs);
    let used = left_out::inputs_of(specification, response);
    let rows = records.complete(&used, k);
    let of = |column: &Vec<f64>| rows.iter().map(|row| column[*row]).collect::<Vec<f64>>();
    let weights = &records.weights[k];
    let sample = Sample {
        columns: used.iter().map(|input| of(&records.inputs[*input])).collect(),
        response: of(&records.responses[k]),
        weights: if weights.is_empty() { Vec::new() } else { of(weights) },
        groups: Vec::new(),
    };
    let mut compressed = Compressed::new(design.width() + 1);
    let (mut rows_outside, mut weight, mut logs, mut is_finite) = (0, Dd::ZERO, Dd::ZERO, true);
    sample.observed(|rows| {
        for row in 0..rows.response.len() {
            let point = rows.point(row);
            rows_outside += usize::from(!design.is_inside(&point));
            let terms = design.row_as_measured(&point);
            is_finite &= terms.iter().all(|term| term.is_finite());
            let terms = terms.into_iter().chain([Dd::from(rows.response[row])]);
            if rows.weights.is_empty() {
                compressed.push(terms);
            } else {
                let root = rows.weight(row).sqrt();
                weight += rows.weight(row);
                logs += Dd::from(rows.weights[row].ln());
                compressed.push(terms.map(|term| term * root));
            }
        }
    });
    if !is_finite {
        let what = format!("response `{}`: in some row a term is not a finite number", response.surface.name);
        let help =
            "lower the order, use coding = \"range\", or leave out rows where an input that enters by its reciprocal is 0";
        return Err(Faults::one(specification.fault(&format!("responses.{}", response.surface.name), what).help(help)));
    }
    let triangle = compressed.finish();
    let columns = triangle.columns().iter().map(|column| column.iter().copied().map(plain).collect()).collect();
    Ok(Sums {
        triangle: Triangle::of_columns(columns, triangle.rows()),
        span: span(&sample.response),
        rows_outside,
        left_out: 0,
        cells: Vec::new(),
        weights: (!sample.weights.is_empty() || response.weights.is_some()).then_some([plain(weight), plain(logs)]),
    })
}

/// The same number without negative zeros, as it is read from a file.
fn plain(number: Dd) -> Dd {
    let [high, low] = number.parts();
    Dd::sum_of(high + 0.0, low + 0.0)
}
