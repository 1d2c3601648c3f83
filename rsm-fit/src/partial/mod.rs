//! The fit of one part of the data as sums, and the fit of all parts from their sums.
//!
//! ```text
//!   fit.toml, shard-1.csv --of--> Part --write--> part-1.rsm --read--> Part --+
//!   fit.toml, shard-2.csv --of--> Part --write--> part-2.rsm --read--> Part --+--merge--> Merged { outcome, .. }
//! ```
//!
//! In: a specification and some of the rows. Out: a [`Part`]: for each response the triangle of all candidates (`qr.rs`), counts, sums of weights,
//! ranges, and the text of the specification. Files are read block by block (`blocks.rs`). [`merge`] stacks the triangles and solves once. A part
//! holds no rows, so that figures of single rows do not exist after a merge. What needs rows to choose terms is refused when the first part is made
//! (`rules.rs`). The order of the parts does not change a bit of the result. Other shards of the same rows change coefficients by less than a bound
//! that is computed (`bound.rs`).
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

mod blocks;
mod bound;
mod file;
mod merge;
mod rules;

use std::path::Path;
use std::sync::Mutex;
use std::sync::mpsc::sync_channel;

use rsm_core::model::Input;
use rsm_core::source::{Fault, Faults, Source};

use crate::columnar::{self, Format};
use crate::content::{self, Content};
use crate::dd::Dd;
use crate::dd::lanes::{LANES, Lanes};
use crate::design::eight::Eight;
use crate::design::{self, Design};
use crate::fit::span;
use crate::hash::{self, hash};
use crate::left_out::{self, MissingCells};
use crate::observations::Observations;
use crate::outcome::Progress;
use crate::qr::Triangle;
use crate::qr::table::{self, GROUP, Gathered};
use crate::records::{DataFile, Records, Refused, Rows, Units};
use crate::selection::{self, Sample};
use crate::spec::{Method, ResponseSpec, Specification, TransformSpec};
use crate::table::Table;
use crate::threads;
use crate::transformed;
use blocks::Blocks;

pub use merge::{MergeReport, Merged, MergedReport, combine, merge};

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

/// The sums of the data files of a specification, or of the files of one shard. Files are read once, block by block, so the memory does not depend
/// on the number of rows. They may be compressed with gzip. Only a file with a fault, and one that is not a regular file, is read as a whole.
///
/// # Errors
/// What the specification requires and sums do not hold; every fault of the data files.
pub fn of_files(
    specification: &Specification,
    shard: &[impl AsRef<Path>],
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Part, Refused> {
    rules::check(specification)?;
    let shard: Vec<String> = shard.iter().map(|path| path.as_ref().display().to_string()).collect();
    let files = if shard.is_empty() { specification.data.clone() } else { shard.clone() };
    let path_of = |file: &str| if shard.is_empty() { specification.path_of(file) } else { file.into() };
    let in_blocks = |file: &String| std::fs::metadata(path_of(file)).is_ok_and(|found| found.is_file());
    if files.iter().all(in_blocks) {
        let mut builder = Builder::new(specification);
        let all = files.iter().all(|file| {
            progress(Progress::Reading { file });
            let path = path_of(file);
            match Format::of_file(&path) {
                Some(format) => builder.read_columnar(format, file, &path).is_ok(),
                None => builder.read(file, &path).is_some(),
            }
        });
        // A fault is found again below, with its line in the file and beside all others.
        if let Some(part) = all.then(|| builder.finish().ok()).flatten() {
            return Ok(part);
        }
    }
    of(specification, &files, &mut |file| {
        progress(Progress::Reading { file });
        Content::read(&path_of(file))
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
        found.map(Content::from).ok_or_else(|| Faults::one(Fault::whole_file(file, "is not among the files in memory")))
    })
}

fn of(
    specification: &Specification,
    files: &[String],
    open: &mut dyn FnMut(&str) -> Result<Content, Faults>,
) -> Result<Part, Refused> {
    rules::check(specification)?;
    let mut builder = Builder::new(specification);
    let mut records = Records::read(specification, files, Rows::ToFit, &mut builder.units, open)?;
    records.files.iter_mut().for_each(|file| file.name = short(&file.name));
    builder.files = records.files.clone();
    builder.add(records)?;
    Ok(builder.finish()?)
}

/// A name without folders, because these are specific to one machine.
fn short(name: &str) -> String {
    name.rsplit(['/', '\\']).next().unwrap_or_default().to_string()
}

/// Sums to which rows are added.
struct Builder<'a> {
    specification: &'a Specification,
    units: Units,
    files: Vec<DataFile>,
    spans: Vec<[f64; 2]>,
    sums: Vec<Open>,
}

/// Sums of one response.
struct Open {
    design: Design,
    gathered: Gathered,
    /// Rows that are not in `gathered` yet.
    pending: Sample,
    span: [f64; 2],
    rows_outside: usize,
    left_out: usize,
    cells: Vec<MissingCells>,
    is_weighted: bool,
    weight: Dd,
    logs: Dd,
    is_finite: bool,
}

/// The number of blocks that are read at once, and of groups of rows that are reduced at once: two for each of two cores, so that both have work when
/// one is slower. They are all that is in memory of a file: some megabytes.
const AT_ONCE: usize = 4;

/// No number: the first is above the second.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

fn both([low, high]: [f64; 2], [other, further]: [f64; 2]) -> [f64; 2] {
    [low.min(other), high.max(further)]
}

impl<'a> Builder<'a> {
    fn new(specification: &'a Specification) -> Self {
        let open = |response: &ResponseSpec| {
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
            Open {
                gathered: Gathered::new(design.width() + 1),
                pending: Sample { columns: vec![Vec::new(); response.surface.inputs.len()], ..Sample::default() },
                design,
                span: NOTHING,
                rows_outside: 0,
                left_out: 0,
                cells: Vec::new(),
                is_weighted: response.weights.is_some(),
                weight: Dd::ZERO,
                logs: Dd::ZERO,
                is_finite: true,
            }
        };
        Builder {
            units: Units::of(specification),
            files: Vec::new(),
            spans: vec![NOTHING; specification.inputs.len()],
            sums: specification.responses.iter().map(open).collect(),
            specification,
        }
    }

    /// Adds a file block by block. `None` if there is any fault.
    fn read(&mut self, file_name: &str, path: &Path) -> Option<()> {
        // A file that cannot be read is a fault too, before a thread reads it.
        let file = Source::open(path).ok()?;
        let wanted = Records::wanted(self.specification, Rows::ToFit);
        let name = short(file_name);
        let mut rows = 0;
        let (specification, units) = (self.specification, self.units.clone());
        // Every block has the header of the file, so all find the same units.
        let read = |block: Vec<u8>| {
            let table = Table::read(&Source::new(name.clone(), String::from_utf8(block).ok()?), &wanted).ok()?;
            let (mut records, mut units) = (Records::without_rows(specification, &wanted), units.clone());
            let rows = records.add(specification, &table, Rows::ToFit, &mut units).ok()?;
            records.files = vec![DataFile { name: name.clone(), sha256: String::new(), rows }];
            Some((records, units))
        };
        let sha256 = std::thread::scope(|scope| {
            let (send, receive) = sync_channel(AT_ONCE);
            let reader = scope.spawn(move || {
                let mut blocks = Blocks::new(content::decoded(file).ok()?, blocks::BLOCK);
                while let Some(block) = blocks.next().ok()? {
                    // A send fails if a block had a fault.
                    send.send(block).ok()?;
                }
                Some(blocks.sha256())
            });
            // The receiver ends with this closure, so the reader ends too if a block has a fault.
            let receive = receive;
            loop {
                let blocks: Vec<Vec<u8>> = receive.iter().take(AT_ONCE).collect();
                if blocks.is_empty() {
                    break;
                }
                let blocks: Vec<Mutex<Vec<u8>>> = blocks.into_iter().map(Mutex::new).collect();
                let take = |block: usize| std::mem::take(&mut *blocks[block].lock().expect("each block is taken once"));
                for found in threads::all(blocks.len(), threads::ROWS, |block| read(take(block))) {
                    let (records, units) = found?;
                    self.units = units;
                    rows += records.rows();
                    self.add(records).ok()?;
                }
            }
            reader.join().expect("the reader never panics")
        })?;
        self.files.push(DataFile { name, sha256, rows });
        (rows > 0).then_some(())
    }

    /// Adds a file of numbered columns in batches of rows.
    fn read_columnar(&mut self, format: Format, file: &str, path: &Path) -> Result<(), Faults> {
        let wanted = Records::wanted(self.specification, Rows::ToFit);
        let name = short(file);
        let rows = columnar::read(format, &name, path, &wanted, &mut |table| {
            let mut records = Records::without_rows(self.specification, &wanted);
            let rows = records.add(self.specification, &table, Rows::ToFit, &mut self.units)?;
            records.files = vec![DataFile { name: name.clone(), sha256: String::new(), rows }];
            self.add(records)
        })?;
        let sha256 = hash::of_file(path)?;
        self.files.push(DataFile { name, sha256, rows });
        Ok(())
    }

    fn add(&mut self, mut records: Records) -> Result<(), Faults> {
        let counts = left_out::remove(self.specification, &mut records, None, None)?;
        for (k, span_of) in self.spans.iter_mut().enumerate() {
            *span_of = both(*span_of, span(&left_out::used_values(self.specification, &records, k)));
        }
        for (k, (sums, counts)) in self.sums.iter_mut().zip(counts).enumerate() {
            sums.add(self.specification, &records, k)?;
            for one in counts {
                sums.left_out += one.rows;
                for cells in one.cells {
                    let is_same = |known: &&mut MissingCells| known.file == cells.file && known.column == cells.column;
                    match sums.cells.iter_mut().find(is_same) {
                        Some(known) => known.cells += cells.cells,
                        None => sums.cells.push(cells),
                    }
                }
            }
        }
        Ok(())
    }

    fn finish(self) -> Result<Part, Faults> {
        let specification = self.specification;
        let responses = specification.responses.iter().zip(self.sums);
        let sums = responses
            .map(|(response, sums)| sums.finish(specification, response, &self.files))
            .collect::<Result<_, Faults>>()?;
        let variables = specification.inputs.len() + specification.responses.len();
        let part = Part {
            name: String::new(),
            units: (0..variables).map(|k| self.units.get(k).to_string()).collect(),
            spans: self.spans,
            files: self.files,
            sums,
            specification: specification.clone(),
            sha256: String::new(),
        };
        let sha256 = hash(&file::body(&part));
        Ok(Part { sha256, ..part })
    }
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

impl Open {
    fn add(&mut self, specification: &Specification, records: &Records, k: usize) -> Result<(), Faults> {
        let response = &specification.responses[k];
        let used = left_out::inputs_of(specification, response);
        let rows = records.complete(&used, k);
        let is_complete = rows.len() == records.rows();
        let of = |column: &'_ [f64]| rows.iter().map(|row| column[*row]).collect::<Vec<f64>>();
        let columns = used.iter().map(|input| records.inputs[*input].as_slice());
        let (response_column, weights) = (records.responses[k].as_slice(), records.weights[k].as_slice());
        if is_complete && !matches!(response.transform, Some(TransformSpec::Given(_))) {
            let columns: Vec<&[f64]> = columns.collect();
            self.append(Observations { inputs: &columns, response: response_column, weights });
        } else {
            let mut sample = Sample {
                columns: columns.map(of).collect(),
                response: of(response_column),
                weights: if weights.is_empty() { Vec::new() } else { of(weights) },
                groups: Vec::new(),
            };
            if let Some(TransformSpec::Given(transform)) = response.transform {
                transformed::of_sample(specification, response, transform, &mut sample, "to fit")?;
            }
            sample.observed(|rows| self.append(rows));
        }
        if self.pending.rows() >= AT_ONCE * GROUP {
            self.reduce_groups();
        }
        Ok(())
    }

    /// Adds rows to the pending ones.
    fn append(&mut self, rows: Observations<'_>) {
        self.span = both(self.span, span(rows.response));
        self.rows_outside += rows.rows_outside(&self.design);
        for weight in rows.weights {
            self.weight += Dd::from(*weight);
            self.logs += Dd::from(weight.ln());
        }
        self.pending.columns.iter_mut().zip(rows.inputs).for_each(|(all, own)| all.extend_from_slice(own));
        self.pending.response.extend_from_slice(rows.response);
        self.pending.weights.extend_from_slice(rows.weights);
    }

    /// Reduces all whole groups of the pending rows. The groups are those of all rows of the response, wherever blocks of a file end.
    fn reduce_groups(&mut self) {
        let groups = self.pending.rows() / GROUP;
        let (design, gathered, is_finite) = (&self.design, &mut self.gathered, &mut self.is_finite);
        self.pending.observed(|rows| {
            let of_group = |group: usize| {
                let (mut terms, mut is_finite) = (Eight::new(design), true);
                let lanes = table::group_of(design.width() + 1, |first, out| {
                    is_finite &= selection::rows_at(rows, &mut terms, group * GROUP + first, out);
                });
                (lanes, is_finite)
            };
            threads::in_order(groups, of_group, |(lanes, is_all_finite)| {
                gathered.add_lanes(&lanes);
                *is_finite &= is_all_finite;
            });
        });
        let Sample { columns, response, weights, .. } = &mut self.pending;
        for column in columns.iter_mut().chain([response, weights]) {
            column.drain(..(groups * GROUP).min(column.len()));
        }
    }

    /// All sums, once every row was added.
    fn reduce_rest(&mut self) {
        self.reduce_groups();
        let (design, gathered, is_finite) = (&self.design, &mut self.gathered, &mut self.is_finite);
        self.pending.observed(|rows| {
            let (mut terms, mut out) = (Eight::new(design), vec![Lanes::ZERO; design.width() + 1]);
            for first in (0..rows.response.len()).step_by(LANES) {
                *is_finite &= selection::rows_at(rows, &mut terms, first, &mut out);
                for lane in 0..LANES.min(rows.response.len() - first) {
                    gathered.push(out.iter().map(|value| value.get(lane)));
                }
            }
        });
    }

    fn finish(mut self, specification: &Specification, response: &ResponseSpec, files: &[DataFile]) -> Result<Sums, Faults> {
        self.reduce_rest();
        if !self.is_finite {
            let what = format!("response `{}`: in some row a term is not a finite number", response.surface.name);
            let help =
                "lower the order, use coding = \"range\", or leave out rows where an input that enters by its reciprocal is 0";
            return Err(Faults::one(specification.fault(&format!("responses.{}", response.surface.name), what).help(help)));
        }
        // In the order of the files and of the columns, whatever the order of the blocks in which they were found.
        let mut cells = self.cells;
        let used = left_out::inputs_of(specification, response).into_iter().map(|k| &specification.inputs[k].column);
        let weights = response.weights.as_ref().map(|weights| weights.column());
        let columns: Vec<&str> = used.map(String::as_str).chain([response.column.as_str()]).chain(weights).collect();
        cells.sort_by_key(|it| {
            let file = files.iter().position(|file| file.name == it.file);
            (file, columns.iter().position(|column| *column == it.column))
        });
        let triangle = self.gathered.finish();
        let columns = triangle.columns().iter().map(|column| column.iter().copied().map(plain).collect()).collect();
        Ok(Sums {
            triangle: Triangle::of_columns(columns, triangle.rows()),
            span: self.span,
            rows_outside: self.rows_outside,
            left_out: self.left_out,
            cells,
            weights: self.is_weighted.then_some([plain(self.weight), plain(self.logs)]),
        })
    }
}

/// The same number without negative zeros, as it is read from a file.
fn plain(number: Dd) -> Dd {
    let [high, low] = number.parts();
    Dd::sum_of(high + 0.0, low + 0.0)
}
