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
mod convert;
mod rows;
mod select;

use rsm_core::source::Collector;

pub use columns::{Input, Response};
pub use rows::{Inputs, Responses};
pub use select::Select;

use crate::fit::{Data, Outcome, Progress, fit_rows};
use crate::missing::Missing;
use crate::records::{Refused, Units};

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
}
