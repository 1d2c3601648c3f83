//! Fits rows that are in memory: the main interface of the library.
//!
//! In: inputs and responses as slices, nalgebra matrices or named columns; settings, one method for each. Out: the same [`Outcome`] as from files,
//! because the same code makes the fit. Reads and writes no file.
//!
//! ```
//! use rsm_fit::{Fit, Input, Response};
//!
//! // The drag of a car, N, at speeds in m/s and two loads in kg.
//! let speed = Input::new("speed", [0.0, 10.0, 20.0, 30.0, 0.0, 10.0, 20.0, 30.0]).unit("m/s");
//! let load = Input::new("load", [0.0, 0.0, 0.0, 0.0, 300.0, 300.0, 300.0, 300.0]).unit("kg");
//! let drag = Response::new("drag", [120.0, 165.0, 300.0, 525.0, 150.0, 195.0, 330.0, 555.0]).unit("N");
//!
//! let outcome = Fit::new([speed, load], drag).name("car").order(2).ladder(99.0).fit()?;
//! assert!(outcome.reached());
//! let statistics = outcome.statistics("drag").unwrap();
//! assert!(statistics.residual_sd.unwrap() < 1e-9); // 120 + 0.45 speed^2 + 0.1 load, without noise
//! # Ok::<(), rsm_fit::Refused>(())
//! ```

mod columns;
mod rows;
mod select;

use rsm_core::model::Category;
use rsm_core::source::{Collector, Fault};
use sha2::{Digest, Sha256};

pub use columns::{Input, Response};
pub use rows::{Inputs, Responses};
pub use select::Select;

use crate::fit::{Data, Outcome, Progress, fit_rows};
use crate::hash::hexadecimal;
use crate::missing::Missing;
use crate::records::{DataFile, Records, Refused, Units};
use crate::spec::{IN_MEMORY, InputSpec, Specification, Split, Together, Validation};
use crate::table::magnitude_fault;
use columns::RowWeights;

/// The name of the column of groups in the specification.
const GROUPS: &str = "groups";

/// The name of the column of series.
const SERIES: &str = "series";

/// The name of the column of blocks.
const BLOCKS: &str = "blocks";

/// A fit of rows in memory. Nothing is checked before [`Fit::fit`], which reports all faults together.
///
/// ```
/// use rsm_fit::Fit;
///
/// // Points of two inputs, a row each, and one response.
/// let points = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [0.0, 0.0], [0.0, 1.0]];
/// let response = points.map(|[a, b]| 3.0 + 2.0 * a - b);
/// let outcome = Fit::new(&points, &response).order(1).fit()?;
/// let terms: Vec<_> = outcome.model.surfaces[0].terms.iter().map(|term| (&term.powers[..], term.coefficient.round())).collect();
/// assert_eq!(terms, [(&[0, 0][..], 3.0), (&[1, 0], 2.0), (&[0, 1], -1.0)]);
/// # Ok::<(), rsm_fit::Refused>(())
/// ```
#[derive(Debug, Clone)]
pub struct Fit {
    name: String,
    inputs: Inputs,
    responses: Responses,
    select: Select,
    validation: Apart,
    test: Apart,
    groups: Option<Vec<String>>,
    series: Option<Vec<String>>,
    blocks: Option<Vec<String>>,
    mirror: Vec<String>,
    run_order: Option<Vec<f64>>,
    missing: Missing,
}

/// Rows that are not fitted.
#[derive(Debug, Clone)]
enum Apart {
    None,
    Rows(Inputs, Responses),
    Share(f64, u64),
}

impl Fit {
    /// A fit of responses to inputs, with one row for each observation. See [`Inputs`] for the possible types.
    ///
    /// ```
    /// use nalgebra::{DMatrix, DVector};
    /// use rsm_fit::Fit;
    ///
    /// let inputs = DMatrix::from_fn(9, 2, |row, column| if column == 0 { (row % 3) as f64 } else { (row / 3) as f64 });
    /// let response = DVector::from_fn(9, |row, _| 1.0 + inputs[(row, 0)] * inputs[(row, 1)]);
    /// assert!(Fit::new(&inputs, &response).order(2).ladder(99.0).fit()?.reached());
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn new(inputs: impl Into<Inputs>, responses: impl Into<Responses>) -> Self {
        Fit {
            name: "model".to_string(),
            inputs: inputs.into(),
            responses: responses.into(),
            select: Select::default(),
            validation: Apart::None,
            test: Apart::None,
            groups: None,
            series: None,
            blocks: None,
            mirror: Vec::new(),
            run_order: None,
            missing: Missing::default(),
        }
    }

    /// The name of the model and the prefix of emitted names; `model` by default.
    #[must_use]
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// How the terms are chosen, for every response without its own [`Response::select`]. The three methods below are shortcuts.
    #[must_use]
    pub fn select(mut self, select: Select) -> Self {
        self.select = select;
        self
    }

    /// All terms up to this order; with [`Fit::ladder`], the highest order of a candidate. The default is 2.
    #[must_use]
    pub fn order(mut self, order: u32) -> Self {
        self.select.order = Some(order);
        self
    }

    /// A ladder chooses the terms: it adds terms until the confidence C, in percent, is reached.
    #[must_use]
    pub fn ladder(mut self, confidence: f64) -> Self {
        self.select.confidence = Some(confidence);
        self
    }

    /// Exactly these terms. Each has a power for every input, then one for every knot.
    ///
    /// ```
    /// use rsm_fit::Fit;
    ///
    /// let (x, y) = ([0.0, 1.0, 2.0, 3.0], [1.0, 2.0, 5.0, 10.0]);
    /// let outcome = Fit::new(&x, &y).terms([[0], [1], [2]]).fit()?;
    /// assert_eq!(outcome.model.surfaces[0].terms.len(), 3);
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn terms<T: Into<Vec<u32>>>(mut self, terms: impl IntoIterator<Item = T>) -> Self {
        self.select.terms = Some(terms.into_iter().map(Into::into).collect());
        self
    }

    /// Validation rows: a ladder chooses terms with them; if terms are given, they are not used for the fit. The same columns as those to fit, in the
    /// same order.
    #[must_use]
    pub fn validate(mut self, inputs: impl Into<Inputs>, responses: impl Into<Responses>) -> Self {
        self.validation = Apart::Rows(inputs.into(), responses.into());
        self
    }

    /// Sets a share of the rows, between 0 and 1, aside as validation rows. A seed gives the same split on every machine.
    #[must_use]
    pub fn validate_share(mut self, share: f64, seed: u64) -> Self {
        self.validation = Apart::Share(share, seed);
        self
    }

    /// Test rows, used only for the final errors. The same columns as those to fit, in the same order.
    ///
    /// ```
    /// use rsm_fit::Fit;
    ///
    /// let (x, y) = ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [0.1, 0.9, 2.1, 2.9, 4.1, 4.9]);
    /// let outcome = Fit::new(&x, &y).order(1).test(&[1.5, 3.5], &[1.5, 3.5]).fit()?;
    /// let judged = outcome.statistics("y").unwrap().test.as_ref().unwrap();
    /// assert_eq!(judged.rows, 2);
    /// assert!(judged.max_abs_error < 0.1);
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn test(mut self, inputs: impl Into<Inputs>, responses: impl Into<Responses>) -> Self {
        self.test = Apart::Rows(inputs.into(), responses.into());
        self
    }

    /// Sets a share of the rows, between 0 and 1, aside as test rows, before that of [`Fit::validate_share`].
    #[must_use]
    pub fn test_share(mut self, share: f64, seed: u64) -> Self {
        self.test = Apart::Share(share, seed);
        self
    }

    /// The group of each row (a run, a day, a specimen). Rows of one group are set aside, or left out in turn, together.
    #[must_use]
    pub fn groups<T: ToString>(mut self, groups: impl IntoIterator<Item = T>) -> Self {
        self.groups = Some(groups.into_iter().map(|group| group.to_string()).collect());
        self
    }

    /// The series of each row (a run, a recording), for responses with [`Response::noise`]. Without it all rows are one series.
    #[must_use]
    pub fn series<T: ToString>(mut self, series: impl IntoIterator<Item = T>) -> Self {
        self.series = Some(series.into_iter().map(|one| one.to_string()).collect());
        self
    }

    /// The block of each row (a day, a batch). Each block has an effect of its own, which is no part of the model: the surface is the mean over the
    /// blocks. Not for responses with constraints, splines or odd symmetry.
    ///
    /// ```
    /// use rsm_fit::Fit;
    ///
    /// // On the second day the sensor reads 3 more.
    /// let (x, day) = ([0.0, 1.0, 2.0, 0.0, 1.0, 2.0], ["mon", "mon", "mon", "tue", "tue", "tue"]);
    /// let outcome = Fit::new(&x, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).order(1).blocks(day).fit()?;
    /// assert_eq!(outcome.model.surfaces[0].terms.len(), 2);
    /// let blocks = outcome.statistics("y").unwrap().blocks.as_ref().unwrap();
    /// assert!((blocks.effects[1].effect - 1.5).abs() < 1e-12);
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn blocks<T: ToString>(mut self, blocks: impl IntoIterator<Item = T>) -> Self {
        self.blocks = Some(blocks.into_iter().map(|one| one.to_string()).collect());
        self
    }

    /// Rows whose inputs differ only in the sign of these inputs also stay together, for a map with mirrored halves.
    #[must_use]
    pub fn mirror<T: Into<String>>(mut self, inputs: impl IntoIterator<Item = T>) -> Self {
        self.mirror = inputs.into_iter().map(Into::into).collect();
        self
    }

    /// The place of each row in run order. The residual is then tested for drift.
    #[must_use]
    pub fn run_order(mut self, order: impl AsRef<[f64]>) -> Self {
        self.run_order = Some(order.as_ref().to_vec());
        self
    }

    /// What to do with a row that has NaN in place of a number. By default it is refused.
    ///
    /// ```
    /// use rsm_fit::{Fit, Missing};
    ///
    /// let (x, y) = ([0.0, 1.0, 2.0, 3.0, f64::NAN], [1.0, 3.0, f64::NAN, 7.0, 9.0]);
    /// let outcome = Fit::new(&x, &y).order(1).missing(Missing::DropRow).fit()?;
    /// assert_eq!(outcome.statistics("y").unwrap().rows, 3);
    /// assert_eq!(outcome.left_out[0][0].rows, 2);
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn missing(mut self, missing: Missing) -> Self {
        self.missing = missing;
        self
    }

    /// Fits.
    ///
    /// # Errors
    /// Every fault of the settings and of the rows; if there are none, those that need both, such as fewer rows than terms. A numerical outcome (a
    /// confidence that is not reached) is no error: each of [`Outcome::responses`] has a verdict.
    ///
    /// ```
    /// use rsm_fit::Fit;
    ///
    /// let refused = Fit::new(&[1.0, 2.0, f64::NAN], &[1.0, 2.0]).fit().unwrap_err();
    /// assert_eq!(
    ///     refused.to_string(),
    ///     "fit: input `x1`: row 3: found NaN, expected a finite number; no other value is NaN\n  \
    ///      help: `Fit::missing(Missing::DropRow)` leaves such rows out\nfit: response `y`: found 2 rows, expected 3"
    /// );
    /// ```
    pub fn fit(&self) -> Result<Outcome, Refused> {
        self.fit_with(&mut |_| {})
    }

    /// Fits, and reports progress.
    ///
    /// # Errors
    /// As [`Fit::fit`].
    pub fn fit_with(&self, progress: &mut dyn FnMut(Progress<'_>)) -> Result<Outcome, Refused> {
        let mut faults = Collector::new();
        let data = self.data(&mut faults);
        let specification = self.specification(&mut faults);
        let specification = faults.finish(Some(specification))?;
        let specification = specification.expect("a fit without a specification has a fault");
        let data = Data { units: Units::of(&specification), ..data };
        fit_rows(&specification, data, progress)
    }

    fn input_names(&self) -> Vec<String> {
        names(self.inputs.columns.iter().map(|column| &column.name), "x", true)
    }

    fn response_names(&self) -> Vec<String> {
        names(self.responses.columns.iter().map(|column| &column.name), "y", self.responses.columns.len() > 1)
    }

    fn specification(&self, faults: &mut Collector) -> Option<Specification> {
        let pairs = self.inputs.columns.iter().zip(self.input_names());
        let inputs: Vec<InputSpec> = pairs.map(|(input, name)| input.specification(&name)).collect();
        let mut responses = Vec::new();
        let mut is_whole = true;
        for (response, name) in self.responses.columns.iter().zip(self.response_names()) {
            for what in response.faults(inputs.len(), &self.select) {
                tell(faults, format!("response `{name}`: {what}"));
                is_whole = false;
            }
            for (what, value) in response.numbers().filter(|(_, value)| !value.is_finite()) {
                tell(faults, format!("response `{name}`: {what}: found {value}, expected a finite number"));
                is_whole = false;
            }
            responses.extend(response.specification(&name, &inputs, &self.select));
        }
        for (input, spec) in self.inputs.columns.iter().zip(&inputs) {
            for (what, value) in input.numbers().filter(|(_, value)| !value.is_finite()) {
                tell(faults, format!("input `{}`: {what}: found {value}, expected a finite number", spec.name));
                is_whole = false;
            }
        }
        for name in self.mirror.iter().filter(|name| !inputs.iter().any(|input| input.name == **name)) {
            let known: Vec<String> = inputs.iter().map(|input| format!("`{}`", input.name)).collect();
            let fault = Fault::whole_file(IN_MEMORY, format!("`mirror`: there is no input `{name}`"));
            faults.push(fault.help(format!("the inputs are {}", known.join(", "))));
        }
        if !is_whole || self.inputs.ragged.is_some() || self.responses.ragged.is_some() {
            // Parts with faults would cause further faults in the rules.
            return None;
        }
        let together =
            Together { columns: self.groups.iter().map(|_| GROUPS.to_string()).collect(), mirror: self.mirror.clone() };
        let apart = (self.validation.specification(VALIDATE), self.test.specification(TEST));
        let series = self.series.iter().map(|_| SERIES.to_string()).collect();
        let blocks = self.blocks.iter().map(|_| BLOCKS.to_string()).collect();
        let mut categories: Vec<Category> = Vec::new();
        for (category, _) in self.inputs.columns.iter().filter_map(|input| input.category.as_ref()) {
            if !categories.contains(category) {
                categories.push(category.clone());
            }
        }
        for response in &mut responses {
            let is_used = |category: &&Category| category.is_in(&response.surface.inputs);
            response.surface.categories = categories.iter().filter(is_used).cloned().collect();
        }
        let rows = (together, self.missing, series, blocks);
        Some(Specification::in_memory(self.name.clone(), apart, inputs, responses, rows, categories, faults))
    }

    fn data(&self, faults: &mut Collector) -> Data {
        let rows = self.inputs.columns.first().map_or(0, |column| column.values.len());
        let mut fit = self.records("", (&self.inputs, &self.responses), "rows in memory", faults);
        if let Some(groups) = &self.groups {
            same_length(faults, "the groups", groups.len(), rows);
            fit.labels.push(groups.clone());
        }
        if let Some(series) = &self.series {
            same_length(faults, "the series", series.len(), rows);
            fit.labels.push(series.clone());
        }
        if let Some(blocks) = &self.blocks {
            same_length(faults, "the blocks", blocks.len(), rows);
            fit.labels.push(blocks.clone());
        }
        if let Some(order) = &self.run_order {
            same_length(faults, "the run order", order.len(), rows);
            if let Some(bad) = order.iter().find(|place| !self.is_accepted(**place)) {
                tell(faults, format!("the run order: found {bad}, expected a finite number"));
            }
            // If rows may be left out, only the kept ones must be different.
            let is_settled = self.missing == Missing::Error || order.len() != rows;
            fit.order = if is_settled { crate::records::distinct(order.clone(), rows) } else { order.clone() };
        }
        for (response, name) in self.responses.columns.iter().zip(self.response_names()) {
            fit.weights.push(self.weights(response, &name, faults));
        }
        let mut apart = |key: &str, rows: &Apart| match rows {
            Apart::Rows(inputs, responses) => {
                let mut records =
                    self.records(&format!("{key} rows: "), (inputs, responses), &format!("{key} rows in memory"), faults);
                records.weights = vec![Vec::new(); self.responses.columns.len()];
                // Separate rows are in no group with those to fit.
                records.labels = self.groups.iter().map(|_| (0..records.rows()).map(|row| row.to_string()).collect()).collect();
                Some(records)
            }
            _ => None,
        };
        let (validate, test) = (apart(VALIDATE, &self.validation), apart(TEST, &self.test));
        Data { fit, validate, test, units: Units::default() }
    }

    /// Converts columns to records, with a fault for each number that cannot be fitted. `who`: the name of the rows in messages.
    fn records(&self, who: &str, (inputs, responses): (&Inputs, &Responses), name: &str, faults: &mut Collector) -> Records {
        let mut columns = Vec::new();
        for (k, known) in self.input_names().into_iter().enumerate() {
            let Some(column) = inputs.columns.get(k) else { continue };
            columns.push((format!("{who}input `{known}`"), known, &column.name, &column.values, false));
        }
        for (k, known) in self.response_names().into_iter().enumerate() {
            let Some(column) = responses.columns.get(k) else { continue };
            columns.push((format!("{who}response `{known}`"), known, &column.name, &column.values, true));
        }
        let counts = [
            ("inputs", inputs.columns.len(), self.inputs.columns.len(), inputs.ragged),
            ("responses", responses.columns.len(), self.responses.columns.len(), responses.ragged),
        ];
        for (kind, found, expected, ragged) in counts {
            if let Some(ragged) = ragged {
                let (row, found, expected) = (ragged.row, ragged.found, ragged.expected);
                tell(faults, format!("{who}{kind}: row {row}: found {found} values, expected {expected}"));
            } else if found != expected {
                tell(faults, format!("{who}found {found} {kind}, expected {expected}"));
            }
        }
        let rows = columns.first().map_or(0, |(_, _, _, values, _)| values.len());
        if rows == 0 && columns.len() > 1 {
            tell(faults, format!("{who}found no row, expected at least one"));
        }
        let mut told: Vec<String> = Vec::new();
        let mut hash = Sha256::new();
        let mut records = Records::default();
        for (who, known, given, values, is_response) in columns {
            if let Some(given) = given.as_ref().filter(|given| **given != known) {
                tell(faults, format!("{who}: found `{given}` in its place, expected the same order as in the rows to fit"));
            }
            same_length(faults, &who, values.len(), rows);
            let of_category = inputs.columns.iter().find(|input| input.name.as_ref() == Some(&known));
            if let Some((_, Some(fault))) = of_category.and_then(|input| input.category.as_ref()) {
                if !told.contains(fault) {
                    tell(faults, fault.clone());
                    told.push(fault.clone());
                }
                continue;
            }
            if let Some(row) = values.iter().position(|value| !self.is_accepted(*value)) {
                faults.push(not_finite(&who, values, row));
            } else if let Some((row, what, help)) = magnitude_fault(values).filter(|_| is_response) {
                let what = format!("{who}: row {}: found {:?}, {what}", row + 1, values[row]);
                faults.push(Fault::whole_file(IN_MEMORY, what).help(help));
            }
            values.iter().for_each(|value| hash.update(value.to_le_bytes()));
            if is_response { &mut records.responses } else { &mut records.inputs }.push(values.clone());
        }
        let sha256 = hexadecimal(&hash.finalize());
        records.files = vec![DataFile { name: name.to_string(), sha256, rows }];
        records
    }

    /// Whether the value can be in the rows: a finite number, or NaN if rows may be left out.
    fn is_accepted(&self, value: f64) -> bool {
        value.is_finite() || value.is_nan() && self.missing == Missing::DropRow
    }

    fn weights(&self, response: &Response, name: &str, faults: &mut Collector) -> Vec<f64> {
        let (given, weights): (&Vec<f64>, Vec<f64>) = match &response.weights {
            None => return Vec::new(),
            Some(RowWeights::Weights(weights)) => (weights, weights.clone()),
            Some(RowWeights::StandardErrors(sigma)) => (sigma, sigma.iter().map(|sigma| 1.0 / (sigma * sigma)).collect()),
        };
        same_length(faults, &format!("response `{name}`: the weights"), given.len(), response.values.len());
        if let Some(row) = (0..given.len()).find(|row| {
            given[*row] <= 0.0 || !self.is_accepted(given[*row]) || !(given[*row].is_nan() || weights[*row].is_normal())
        }) {
            let what =
                format!("response `{name}`: the weight of row {}: found {}, expected a number above 0", row + 1, given[row]);
            faults.push(Fault::whole_file(IN_MEMORY, what).help("leave the row out if it must not count"));
        }
        weights
    }
}

/// The name of validation rows in messages.
const VALIDATE: &str = "validation";
const TEST: &str = "test";

impl Apart {
    fn specification(&self, key: &str) -> Validation {
        match self {
            Apart::None => Validation::None,
            Apart::Rows(..) => Validation::Files(vec![format!("{key} rows in memory")]),
            Apart::Share(share, seed) => {
                Validation::Split(Split { share: *share, seed: *seed, keep_together: Vec::new(), mirror: Vec::new() })
            }
        }
    }
}

/// The given names; a column without one gets a letter, with a number from 1 if `numbered`.
fn names<'a>(given: impl Iterator<Item = &'a Option<String>>, letter: &str, numbered: bool) -> Vec<String> {
    let own = |k: usize| if numbered { format!("{letter}{}", k + 1) } else { letter.to_string() };
    given.enumerate().map(|(k, name)| name.clone().unwrap_or_else(|| own(k))).collect()
}

/// The fault of the first number that is not finite. Missing ones are counted, with the method that leaves them out.
fn not_finite(who: &str, values: &[f64], row: usize) -> Fault {
    let what = format!("{who}: row {}: found {}, expected a finite number", row + 1, values[row]);
    if !values[row].is_nan() {
        return Fault::whole_file(IN_MEMORY, what);
    }
    let what = match values.iter().filter(|value| value.is_nan()).count() {
        1 => format!("{what}; no other value is NaN"),
        all => format!("{what}; {all} values are NaN"),
    };
    Fault::whole_file(IN_MEMORY, what).help("`Fit::missing(Missing::DropRow)` leaves such rows out")
}

fn same_length(faults: &mut Collector, who: &str, found: usize, expected: usize) {
    if found != expected {
        tell(faults, format!("{who}: found {found} rows, expected {expected}"));
    }
}

fn tell(faults: &mut Collector, what: String) {
    faults.push(Fault::whole_file(IN_MEMORY, what));
}
