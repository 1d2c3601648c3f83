//! The statistics of a fitted surface: the figures of docs/book/src/reference/formats.md 4.1.
//!
//! In: the design of the chosen terms, the solved problem, points and responses. Out: plain structs whose serialised keys are those of `rsm fit
//! --json`. A figure that does not exist (no degree of freedom, a residual of exactly zero) is `None`, never NaN. Sums are computed in double-double.
//!
//! Sources: Myers, Montgomery, Anderson-Cook, Response Surface Methodology, 2.3 to 2.7 (t, R^2, PRESS, lack of fit); the paper's (14), (15) for C.
//! Without a constant term R^2 is uncentred, as with NIST and R.

use std::ops::Range;

use serde::Serialize;

use crate::analysis::Report;
use crate::autoregressive::NoiseReport;
use crate::canonical::Canonical;
use crate::constrain::ConstraintStatistics;
use crate::dd::Dd;
use crate::dd::lanes::{self, LANES, Lanes};
use crate::design::eight::{Eight, Seen};
use crate::design::{Design, order};
use crate::distributions::{two_sided_t, upper_f};
use crate::points::Groups;
use crate::qr::{Growing, Triangle};
use crate::robust::LossReport;
use crate::support::SupportStatistics;
use crate::threads;

mod choices;
mod judged;
pub(crate) mod serial;

pub use crate::blocks::{BlockEffect, BlocksReport};
pub use crate::observations::{Named, Observations, ValidationStatistics};
pub use choices::{FormsReport, SelectionReport, SizeReport, SplineReport, TransformReport, Tried, TriedCells, TriedTransform};
pub use judged::Judged;
pub use serial::Serial;

/// A residual, or a term's orthogonal component, below this share of the response is a double-double rounding error: 2^-104 per operation, with a
/// margin of 2^20 for the number of operations.
const NO_RESIDUAL: f64 = 1.0 / (1u128 << 84) as f64;

/// With leverage 1 the surface passes through a point whatever its response is; without the point some term is not determined. This limit is well
/// above the rounding error of the leverage for columns that count as independent.
const NO_REST: f64 = 1.0 / (1u64 << 40) as f64;

/// A fitted term.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermStatistics {
    /// A power for every input, then one for every knot.
    pub powers: Vec<u32>,
    /// The coefficient of the coded variables, in the unit of the response.
    pub coefficient: f64,
    /// Its standard error.
    pub standard_error: Option<f64>,
    /// Coefficient divided by standard error.
    pub t: Option<f64>,
    /// The two-sided probability of such a t by chance, if the term is not needed.
    pub p: Option<f64>,
}

/// The test of lack of fit against the scatter of replicates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LackOfFit {
    /// Mean square of lack of fit divided by that of pure error; `None` if replicates do not scatter.
    pub f: Option<f64>,
    /// The probability of such an F by chance, if there is no lack of fit.
    pub p: Option<f64>,
    /// Degrees of freedom: lack of fit, pure error.
    pub df: [usize; 2],
}

/// Cross-validation errors: fitted rows are left out in turn, and everything that depends on rows, including the choice of terms, is repeated without
/// them. So the rows are not used for any choice.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CrossValidation {
    /// The errors, over all rows.
    #[serde(flatten)]
    pub errors: ValidationStatistics,
    /// The number of parts, each left out once.
    pub parts: usize,
    /// The explained share of the spread about the mean.
    pub r2: Option<f64>,
}

/// What the rows were used for, in words.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct RowsUsed {
    /// Rows from which the coefficients were computed.
    pub coefficients: String,
    /// Rows used to choose the terms; "none" if the terms were given.
    pub terms: String,
    /// Rows of `validation`.
    pub validation: String,
    /// Rows that did not influence the fit or the choice of terms: the error estimate is computed on them.
    pub error: String,
}

/// Something that the user should know before the surface is used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Warning {
    /// The kind, for programs.
    pub kind: &'static str,
    /// The message.
    pub what: String,
}

/// One response, with the keys of docs/book/src/reference/formats.md 4.1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseStatistics {
    /// The terms, in the order of the model file.
    pub terms: Vec<TermStatistics>,
    /// The number of fitted rows.
    pub rows: usize,
    /// The square root of the residual mean square.
    pub residual_sd: Option<f64>,
    /// The explained share of the response's sum of squares about its mean (about 0 without a constant term).
    pub r2: Option<f64>,
    /// The same with mean squares.
    pub r2_adjusted: Option<f64>,
    /// The same with PRESS.
    pub r2_predicted: Option<f64>,
    /// The sum of squared errors of rows that are left out one at a time.
    pub press: Option<f64>,
    /// The transform of the response that the terms describe, and the errors in the unit of the response. `None` without a transform.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transform: Option<TransformReport>,
    /// C of (14), (15) on the fitted data.
    pub confidence_c: Option<f64>,
    /// `None` without replicates.
    pub lack_of_fit: Option<LackOfFit>,
    /// Errors on validation rows: a ladder chose terms with them; if terms were given, they were not used. `None` without validation data.
    pub validation: Option<ValidationStatistics>,
    /// Only for second-order surfaces of plain coded variables.
    pub canonical: Option<Canonical>,
    /// Errors on test rows, which were not used for any choice. `None` without test data.
    pub test: Option<ValidationStatistics>,
    /// Cross-validation errors. `None` if there are other rows that were not used for any choice, or if it is not possible.
    pub cross_validation: Option<CrossValidation>,
    /// What the rows were used for.
    pub rows_used: RowsUsed,
    /// Warnings about the surface.
    pub warnings: Vec<Warning>,
    /// Analysis of variance, intervals, influence and criteria. `None` if constraints or a penalty affect the coefficients, without a constant term,
    /// a degree of freedom or a residual, and for large fits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub analysis: Option<Report>,
    /// If errors of neighbouring rows are correlated: standard errors that allow for this. Otherwise `None`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<Serial>,
    /// How a search chose the terms; `None` for other methods.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub selection: Option<SelectionReport>,
    /// The tried forms and the accepted one; `None` if only powers were tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forms: Option<FormsReport>,
    /// The spline that is the whole surface; `terms` is then empty.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spline: Option<SplineReport>,
    /// The region supported by the data; `None` if the specification does not request it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub support: Option<SupportStatistics>,
    /// The report on the constraints; `None` if the specification has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constraints: Option<ConstraintStatistics>,
    /// The report on a robust loss; `None` with least squares.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loss: Option<LossReport>,
    /// The report on autoregressive noise; `None` with independent errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseReport>,
    /// The effects of the blocks; `None` if the specification has none, or if all rows are in one block.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blocks: Option<BlocksReport>,
}

impl ResponseStatistics {
    /// Keeps the terms for which `powers` returns the powers of the surface, in every list with an entry for each term.
    pub(crate) fn keep_terms(&mut self, powers: &mut dyn FnMut(&[u32]) -> Option<Vec<u32>>) {
        let own: Vec<Option<Vec<u32>>> = self.terms.iter().map(|term| powers(&term.powers)).collect();
        fn keep<T>(list: &mut Vec<T>, own: &[Option<Vec<u32>>]) {
            let mut is_own = own.iter().map(Option::is_some);
            list.retain(|_| is_own.next().unwrap_or(true));
        }
        self.analysis.iter_mut().for_each(|analysis| keep(&mut analysis.terms, &own));
        self.noise.iter_mut().for_each(|noise| keep(&mut noise.intervals, &own));
        if let Some(serial) = &mut self.serial {
            keep(&mut serial.standard_errors, &own);
            keep(&mut serial.intervals, &own);
        }
        keep(&mut self.terms, &own);
        self.terms.iter_mut().zip(own.into_iter().flatten()).for_each(|(term, powers)| term.powers = powers);
    }
}

/// The value of a polynomial at a row of its design.
pub(crate) fn value(row: &[Dd], coefficients: &[Dd]) -> Dd {
    row.iter().zip(coefficients).map(|(x, b)| *x * *b).sum()
}

/// Coefficients and residual sum of squares, with rounding errors replaced by 0.
struct Solved {
    coefficients: Vec<Dd>,
    residual_square: Dd,
    /// Whether there is no residual.
    is_exact: bool,
}

impl Solved {
    /// `square`: that of the response.
    fn of(growing: &Growing, square: Dd) -> Self {
        let negligible = NO_RESIDUAL * square.sqrt().to_f64();
        let mut coefficients = growing.coefficients();
        for (place, coefficient) in coefficients.iter_mut().enumerate() {
            if coefficient.to_f64().abs() * growing.norm(place) <= negligible {
                *coefficient = Dd::ZERO;
            }
        }
        let residual_square = growing.residual_square();
        let is_exact = residual_square.sqrt().to_f64() <= negligible;
        Solved { coefficients, residual_square: if is_exact { Dd::ZERO } else { residual_square }, is_exact }
    }

    /// The figures of the terms with standard errors, t and p.
    fn tested(&self, terms: Vec<TermStatistics>, growing: &Growing, rows: usize) -> Vec<TermStatistics> {
        let freedom = rows - self.coefficients.len();
        let mean_square = mean_square(self.residual_square, freedom);
        let columns = terms.into_iter().zip(&self.coefficients).zip(growing.variances());
        let tested = |((term, coefficient), variance): ((TermStatistics, &Dd), Dd)| {
            let error = mean_square.map(|square| (square * variance).sqrt());
            let t = error.filter(|error| *error > Dd::ZERO).map(|error| (*coefficient / error).to_f64());
            let p = t.and_then(|t| two_sided_t(t, freedom as f64));
            TermStatistics { standard_error: error.map(Dd::to_f64), t, p, ..term }
        };
        columns.map(tested).collect()
    }
}

/// All figures except validation and canonical analysis. `growing` contains the terms of `design` in its order.
#[must_use]
pub fn of_fit(design: &Design, growing: &Growing, observations: Observations<'_>) -> ResponseStatistics {
    of_fit_with_leverages(design, growing, observations).0
}

/// The same, and the leverage of each row, times its weight.
#[must_use]
pub(crate) fn of_fit_with_leverages(
    design: &Design,
    growing: &Growing,
    observations: Observations<'_>,
) -> (ResponseStatistics, Vec<f64>) {
    let rows = observations.response.len();
    let solved = Solved::of(growing, observations.square_about(Dd::ZERO));
    let (coefficients, residual_square) = (&solved.coefficients, solved.residual_square);
    let in_lanes: Vec<Lanes> = coefficients.iter().copied().map(Lanes::splat).collect();
    let of_range = |range: Range<usize>| {
        let mut terms = Eight::new(design);
        let mut row = vec![Lanes::ZERO; design.width()];
        let mut found = OfRows::default();
        for first in range.clone().step_by(LANES) {
            row.copy_from_slice(terms.rows(observations.inputs, first, Seen::AsMeasured));
            let prediction = lanes::value(&row, &in_lanes);
            let weight = observations.weights(first);
            let leverage = weight.mul(growing.leverages(&mut row));
            let own = Lanes::ONE.sub(leverage);
            let error = observations.responses(first).sub(prediction).div(own);
            let square = weight.mul(error).mul(error);
            for lane in 0..LANES.min(range.end - first) {
                found.predictions.push(prediction.get(lane));
                found.leverages.push(leverage.get(lane).to_f64());
                found.has_no_rest |= own.get(lane).to_f64() <= NO_REST;
                found.squares.push(square.get(lane));
            }
        }
        found
    };
    let mut press = Some(Dd::ZERO);
    let (mut predictions, mut leverages) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
    threads::over_rows(rows, of_range, |found| {
        predictions.extend(found.predictions);
        leverages.extend(found.leverages);
        press = press.filter(|_| !found.has_no_rest).map(|sum| found.squares.iter().fold(sum, |sum, square| sum + *square));
    });
    let press = if solved.is_exact { press.map(|_| Dd::ZERO) } else { press };
    let total = total_square(design, observations);
    let points = observations.points();
    let lack = lack(observations, &points, |row| predictions[row]);
    let figures = ResponseStatistics {
        transform: None,
        confidence_c: confidence(lack),
        lack_of_fit: lack_of_fit(observations, &points, lack.0, coefficients.len()),
        r2_predicted: share(press, Some(total)),
        press: press.map(Dd::to_f64),
        ..figures(design, coefficients, residual_square, total, rows)
    };
    (ResponseStatistics { terms: solved.tested(figures.terms, growing, rows), ..figures }, leverages)
}

/// Figures of consecutive rows.
#[derive(Default)]
struct OfRows {
    predictions: Vec<Dd>,
    leverages: Vec<f64>,
    /// The squared error without the row, times its weight.
    squares: Vec<Dd>,
    /// Whether some row has a leverage of 1.
    has_no_rest: bool,
}

/// The leverage of each row, times its weight.
pub(crate) fn leverages(design: &Design, growing: &Growing, observations: Observations<'_>) -> Vec<f64> {
    let mut all = Vec::with_capacity(observations.response.len());
    let of_range = |range: Range<usize>| {
        let mut terms = Eight::new(design);
        let mut row = vec![Lanes::ZERO; design.width()];
        let mut leverages = Vec::with_capacity(range.len());
        for first in range.clone().step_by(LANES) {
            row.copy_from_slice(terms.rows(observations.inputs, first, Seen::AsMeasured));
            let leverage = observations.weights(first).mul(growing.leverages(&mut row));
            leverages.extend((0..LANES.min(range.end - first)).map(|lane| leverage.get(lane).to_f64()));
        }
        leverages
    };
    threads::over_rows(observations.response.len(), of_range, |leverages| all.extend(leverages));
    all
}

/// The figures that need no rows, from the triangle of all candidates; `growing` contains the terms of `design` in its order. `given`: coefficients
/// that are not those of least squares, which have no standard errors. Figures of single rows and of repeated points are `None`.
#[must_use]
pub(crate) fn of_triangle(
    design: &Design,
    growing: &Growing,
    triangle: &Triangle,
    given: Option<&[f64]>,
) -> ResponseStatistics {
    let (rows, square) = (triangle.rows(), triangle.response_square());
    // The sum of squares about the mean is what a fit of the constant alone leaves.
    let constant = design.terms().iter().position(|powers| order(powers) == 0);
    let total = constant.map_or(square, |place| {
        let alone = Growing::of(triangle, &[growing.chosen()[place]]);
        alone.map_or(square, |alone| alone.residual_square())
    });
    match given {
        None => {
            let solved = Solved::of(growing, square);
            let figures = figures(design, &solved.coefficients, solved.residual_square, total, rows);
            ResponseStatistics { terms: solved.tested(figures.terms, growing, rows), ..figures }
        }
        Some(given) => {
            let exact: Vec<Dd> = given.iter().copied().map(Dd::from).collect();
            figures(design, &exact, triangle.sum_of_squares(growing.chosen(), &exact), total, rows)
        }
    }
}

/// The figures if active constraints affect the coefficients. Figures that need the distribution of unconstrained least squares do not exist:
/// standard errors, t and p (an estimate on the edge of its region has a mixture of distributions, and is not normal even with many rows: Geyer 1994,
/// Silvapulle and Sen 2005, chapter 4), the p of lack of fit, and PRESS, for which each row would need a separate constrained fit. Degrees of freedom
/// count every term as if it were unconstrained, so the residual standard deviation is rather too large.
#[must_use]
pub(crate) fn of_constrained(design: &Design, coefficients: &[f64], observations: Observations<'_>) -> ResponseStatistics {
    let exact: Vec<Dd> = coefficients.iter().copied().map(Dd::from).collect();
    let predictions = observations.values(design, &exact, Seen::AsMeasured);
    let error = |(row, prediction): (usize, &Dd)| {
        let error = Dd::from(observations.response[row]) - *prediction;
        observations.weight(row) * error * error
    };
    let residual_square: Dd = predictions.iter().enumerate().map(error).sum();
    let points = observations.points();
    let lack = lack(observations, &points, |row| predictions[row]);
    let lack_of_fit = lack_of_fit(observations, &points, lack.0, coefficients.len());
    let rows = observations.response.len();
    ResponseStatistics {
        transform: None,
        confidence_c: confidence(lack),
        lack_of_fit: lack_of_fit.map(|lack| LackOfFit { p: None, ..lack }),
        ..figures(design, &exact, residual_square, total_square(design, observations), rows)
    }
}

/// The figures of sums of squares, which do not depend on the method of the coefficients. `total`: [`total_square`].
fn figures(design: &Design, coefficients: &[Dd], residual_square: Dd, total: Dd, rows: usize) -> ResponseStatistics {
    let term = |(powers, coefficient): (&Vec<u32>, &Dd)| TermStatistics {
        powers: powers.clone(),
        coefficient: coefficient.to_f64(),
        standard_error: None,
        t: None,
        p: None,
    };
    // A spline with a penalty may have more coefficients than points.
    let unexplained = mean_square(residual_square, rows.saturating_sub(coefficients.len()));
    let spread = mean_square(total, rows - usize::from(has_constant(design)));
    ResponseStatistics {
        terms: design.terms().iter().zip(coefficients).map(term).collect(),
        rows,
        residual_sd: unexplained.map(|square| square.sqrt().to_f64()),
        r2: share(Some(residual_square), Some(total)),
        r2_adjusted: share(unexplained, spread),
        r2_predicted: None,
        press: None,
        transform: None,
        confidence_c: None,
        lack_of_fit: None,
        validation: None,
        test: None,
        cross_validation: None,
        rows_used: RowsUsed::default(),
        warnings: Vec::new(),
        canonical: None,
        analysis: None,
        serial: None,
        selection: None,
        forms: None,
        spline: None,
        support: None,
        constraints: None,
        loss: None,
        noise: None,
        blocks: None,
    }
}

/// `None` without a degree of freedom.
fn mean_square(sum: Dd, freedom: usize) -> Option<Dd> {
    (freedom > 0).then(|| sum / Dd::from(freedom as f64))
}

/// 1 - part/whole; `None` if the whole is zero.
fn share(part: Option<Dd>, whole: Option<Dd>) -> Option<f64> {
    let (part, whole) = (part?, whole.filter(|whole| *whole > Dd::ZERO)?);
    Some((Dd::ONE - part / whole).to_f64())
}

fn has_constant(design: &Design) -> bool {
    design.terms().iter().any(|powers| order(powers) == 0)
}

/// The sum of squares of the response about its mean, or about 0 without a constant term.
fn total_square(design: &Design, observations: Observations<'_>) -> Dd {
    let mean = || observations.mean_of(0..observations.response.len());
    observations.square_about(if has_constant(design) { mean() } else { Dd::ZERO })
}

/// (14), (15). `None` if every mean response is 0.
fn confidence((ss_lof, ss_y): (Dd, Dd)) -> Option<f64> {
    let confidence = 100.0 - 100.0 * (ss_lof / ss_y).to_f64();
    confidence.is_finite().then_some(confidence)
}

/// SS_lof of (14) and SS_y of (15). `predicted`: the prediction at a row.
pub(crate) fn lack(observations: Observations<'_>, points: &Groups, predicted: impl Fn(usize) -> Dd + Sync) -> (Dd, Dd) {
    let of_group = |rows: &[usize]| {
        let mean = observations.mean(rows);
        // Replicates have the same point and the same prediction.
        let gap = mean - predicted(rows[0]);
        // n_i of the paper, generalised to the sum of weights.
        let count = observations.weight_of(rows);
        (count * gap * gap, count * mean * mean)
    };
    let (mut ss_lof, mut ss_y) = (Dd::ZERO, Dd::ZERO);
    let of_range = |range: Range<usize>| range.map(|group| of_group(points.get(group))).collect::<Vec<(Dd, Dd)>>();
    threads::over_rows(points.count(), of_range, |parts| {
        for (lof, y) in parts {
            ss_lof += lof;
            ss_y += y;
        }
    });
    (ss_lof, ss_y)
}

fn lack_of_fit(observations: Observations<'_>, points: &Groups, ss_lof: Dd, terms: usize) -> Option<LackOfFit> {
    let df = [points.count().saturating_sub(terms), observations.response.len() - points.count()];
    if df.contains(&0) {
        return None;
    }
    let pure = |group: &[usize]| {
        let mean = observations.mean(group);
        let error = |row: &usize| Dd::from(observations.response[*row]) - mean;
        group.iter().map(|row| observations.weight(*row) * error(row) * error(row)).sum::<Dd>()
    };
    let mut ss_pure = Dd::ZERO;
    let of_range = |range: Range<usize>| range.map(|group| pure(points.get(group))).collect::<Vec<Dd>>();
    threads::over_rows(points.count(), of_range, |parts| parts.into_iter().for_each(|part| ss_pure += part));
    let freedom = df.map(|df| df as f64);
    let f = ((ss_lof / Dd::from(freedom[0])) / (ss_pure / Dd::from(freedom[1]))).to_f64();
    let f = f.is_finite().then_some(f);
    Some(LackOfFit { f, p: f.and_then(|f| upper_f(f, freedom)), df })
}

#[cfg(test)]
mod tests;
