//! Fits with autoregressive errors: generalised least squares, with the noise estimated from the same rows.
//!
//! In: the terms, the rows in their order with series and gaps, the order of the noise or the largest one. Out: the noise, and the
//! triangle of the whitened rows, on which least squares is generalised least squares. Chooses no terms.
//!
//! The partial autocorrelations maximise the restricted likelihood (REML), in which the coefficients of the surface are those of generalised least
//! squares with the same noise. So noise and surface agree, as at the end of an iteration between the two:
//!
//! ```text
//! -2 l = m ln(S/m) + ln det V + ln det X'V^-1 X,   S = (y - X b)'V^-1 (y - X b),   m = n - k
//! AICc = -2 l + 2 q m/(m - q - 1),   q = p + 1
//! ```
//!
//! REML instead of the correlations of the residuals (Yule, Walker): residuals are less correlated than errors, because the surface follows a part of
//! them, and standard errors from them are too small (docs/decisions/094).
//!
//! Sources: Patterson, Thompson 1971, Recovery of inter-block information (REML); Barndorff-Nielsen, Schou 1973, On the parametrization of
//! autoregressive models by partial autocorrelations; Hurvich, Tsai 1989 (AICc); Cheang, Reinsel 2000, Bias reduction of autoregressive estimates
//! in time series regression (REML for it).

mod report;
mod whitening;

use nalgebra::{DMatrix, DVector};

use crate::dd::Dd;
use crate::design::Design;
use crate::observations::Observations;
use crate::qr::{Compressed, Dependent, Growing, Triangle};
use crate::sequence::Sequence;
use crate::spec::NoiseOrder;

pub use report::NoiseReport;
pub(crate) use whitening::{Whitening, autocovariances};

/// Bound of atanh of a partial autocorrelation: 0.99999. Beyond it a series of less than 10^5 rows does not differ from a random walk.
const MOST: f64 = 6.1;

/// The distance of difference quotients in atanh of a partial autocorrelation. -2 l is rounded by about 10^-12 for 10^4 rows, which moves a first
/// difference by 10^-9; its formula has an error of the third derivative times h^2/6, which moves the result by about 10^-7.
const STEP: f64 = 1e-3;

/// The search ends when a step is below this: far below the standard error of a correlation, 1/sqrt(rows).
const SETTLED: f64 = 1e-7;

const MOST_STEPS: usize = 40;

/// Errors below this share of the response are rounding errors: there is no noise to estimate.
const NO_NOISE: f64 = 1e-12;

/// A fit with autoregressive errors.
pub(crate) struct Estimate {
    /// Partial autocorrelations; as many as the order.
    pub partial: Vec<f64>,
    pub whitening: Whitening,
    /// The whitened terms and the whitened response.
    pub triangle: Triangle,
    /// AICc of each order that was compared, from the lowest; one value if the order was given.
    pub criteria: Vec<f64>,
}

/// The rows in their order: terms and response, times the root of the weight.
fn ordered(design: &Design, fit: Observations<'_>, sequence: &Sequence) -> Vec<Dd> {
    let row = |row: &usize| {
        let root = if fit.weights.is_empty() { Dd::ONE } else { fit.weight(*row).sqrt() };
        let terms = design.row_as_measured(&fit.point(*row)).into_iter().chain([Dd::from(fit.response[*row])]);
        terms.map(move |x| x * root).collect::<Vec<Dd>>()
    };
    sequence.rows.iter().flat_map(row).collect()
}

impl Whitening {
    /// The whitened terms and response of each row, in the order of the sequence.
    pub(crate) fn rows(&self, design: &Design, fit: Observations<'_>, sequence: &Sequence) -> Vec<Vec<Dd>> {
        let width = design.width() + 1;
        let mut rows = ordered(design, fit, sequence);
        self.apply(&mut rows, width);
        rows.chunks_exact(width).map(<[Dd]>::to_vec).collect()
    }

    /// Their triangle.
    pub(crate) fn triangle(&self, design: &Design, fit: Observations<'_>, sequence: &Sequence) -> Triangle {
        let mut compressed = Compressed::new(design.width() + 1);
        self.rows(design, fit, sequence).into_iter().for_each(|row| compressed.push(row));
        compressed.finish()
    }
}

/// The fewest rows for some terms with noise of an order: with fewer, AICc does not exist.
pub(crate) fn least_rows(terms: usize, order: usize) -> usize {
    terms + order + 3
}

/// Estimates the noise of all terms of a design. `start`: partial autocorrelations near the result, for a given order. Linearly dependent terms are
/// an outcome.
pub(crate) fn estimate(
    design: &Design,
    fit: Observations<'_>,
    sequence: &Sequence,
    order: NoiseOrder,
    start: Option<&[f64]>,
) -> Result<Estimate, Dependent> {
    let plain = Whitening::new(&[], sequence);
    let triangle = plain.triangle(design, fit, sequence);
    let all: Vec<usize> = (0..design.width()).collect();
    let free = Growing::of(&triangle, &all)?;
    let likelihood = Likelihood::of(design, fit, sequence, &free);
    let rows = fit.response.len();
    let square = triangle.response_square().sqrt().to_f64();
    let most = rows.saturating_sub(least_rows(design.width(), 0));
    let (low, high) = match order {
        NoiseOrder::Given(order) => (order, order),
        NoiseOrder::UpTo(order) => (0, order),
    };
    let (mut partial, mut criteria) = (Vec::new(), Vec::new());
    if free.residual_square().sqrt().to_f64() > NO_NOISE * square && most > 0 {
        let mut known: Vec<f64> = start.map(<[f64]>::to_vec).unwrap_or_default();
        let from = if start.is_some() { high.min(most) } else { 0 };
        for order in from..=high.min(most) {
            known.resize(order, 0.0);
            known = likelihood.most_likely(&known);
            if order < low.min(most) {
                continue;
            }
            let criterion = likelihood.aicc(&known);
            // Of equal criteria the lowest order.
            if criteria.iter().all(|other| criterion < *other) {
                partial.clone_from(&known);
            }
            criteria.push(criterion);
        }
    }
    let whitening = Whitening::new(&partial, sequence);
    let triangle = whitening.triangle(design, fit, sequence);
    Ok(Estimate { partial, whitening, triangle, criteria })
}

/// The restricted likelihood of rows as a function of partial autocorrelations.
struct Likelihood<'a> {
    sequence: &'a Sequence,
    /// The rows in their order. The terms are replaced by orthonormal combinations of them and the response by its error of least squares, which
    /// changes the likelihood by a constant and keeps the products of whitened columns far from singular.
    rows: Vec<f64>,
    width: usize,
}

impl<'a> Likelihood<'a> {
    fn of(design: &Design, fit: Observations<'_>, sequence: &'a Sequence, free: &Growing) -> Self {
        let terms = design.width();
        let coefficients = free.coefficients();
        let mut rows = Vec::with_capacity(sequence.rows.len() * (terms + 1));
        for row in ordered(design, fit, sequence).chunks_exact(terms + 1) {
            let (x, y) = row.split_at(terms);
            let fitted: Dd = x.iter().zip(&coefficients).map(|(x, b)| *x * *b).sum();
            rows.extend(free.projected(x.to_vec()).into_iter().chain([y[0] - fitted]).map(Dd::to_f64));
        }
        Likelihood { sequence, rows, width: terms + 1 }
    }

    fn freedom(&self) -> f64 {
        (self.sequence.rows.len() + 1 - self.width) as f64
    }

    /// -2 l. Infinite where the products are singular by rounding.
    fn deviance(&self, partial: &[f64]) -> f64 {
        let whitening = Whitening::new(partial, self.sequence);
        let (mut rows, width) = (self.rows.clone(), self.width);
        whitening.apply(&mut rows, width);
        let mut products = DMatrix::<f64>::zeros(width, width);
        for row in rows.chunks_exact(width) {
            for (column, x) in row.iter().enumerate() {
                for (line, z) in row.iter().enumerate().skip(column) {
                    products[(line, column)] += x * z;
                }
            }
        }
        let Some(root) = products.cholesky() else { return f64::INFINITY };
        let diagonal = root.l_dirty().diagonal();
        let logs: f64 = diagonal.iter().take(width - 1).map(|pivot| 2.0 * pivot.ln()).sum();
        let left = diagonal[width - 1].powi(2);
        self.freedom() * (left / self.freedom()).ln() + whitening.log_determinant() + logs
    }

    fn aicc(&self, partial: &[f64]) -> f64 {
        let (m, q) = (self.freedom(), partial.len() as f64 + 1.0);
        self.deviance(partial) + 2.0 * q * m / (m - q - 1.0)
    }

    /// The partial autocorrelations of largest likelihood, from a start: Newton's method in atanh of them, with difference quotients.
    fn most_likely(&self, start: &[f64]) -> Vec<f64> {
        let order = start.len();
        let value = |at: &DVector<f64>| self.deviance(&at.iter().map(|u| u.tanh()).collect::<Vec<f64>>());
        let mut at = DVector::from_iterator(order, start.iter().map(|r| r.atanh().clamp(-MOST, MOST)));
        let mut now = value(&at);
        for _ in 0..if order == 0 { 0 } else { MOST_STEPS } {
            let moved = |k: usize, by: f64| {
                let mut there = at.clone();
                there[k] += by;
                there
            };
            let sides: Vec<[f64; 2]> = (0..order).map(|k| [value(&moved(k, STEP)), value(&moved(k, -STEP))]).collect();
            let gradient = DVector::from_iterator(order, sides.iter().map(|[up, down]| (up - down) / (2.0 * STEP)));
            let mut curvature = DMatrix::<f64>::zeros(order, order);
            for i in 0..order {
                curvature[(i, i)] = (sides[i][0] - 2.0 * now + sides[i][1]) / STEP.powi(2);
                for j in 0..i {
                    let both = |sign: f64| {
                        let mut there = moved(i, sign * STEP);
                        there[j] += sign * STEP;
                        value(&there)
                    };
                    let own: f64 = sides[i].iter().chain(&sides[j]).sum();
                    let entry = (both(1.0) + both(-1.0) - own + 2.0 * now) / (2.0 * STEP.powi(2));
                    (curvature[(i, j)], curvature[(j, i)]) = (entry, entry);
                }
            }
            // Where -2 l is not convex, down the gradient by half a unit at most.
            let down = match curvature.cholesky() {
                Some(root) => -root.solve(&gradient),
                None => -&gradient / (2.0 * gradient.amax()).max(f64::MIN_POSITIVE),
            };
            // A unit of atanh is more than most correlations.
            let down = &down / down.amax().max(1.0);
            let mut share = 1.0;
            let accepted = loop {
                let there = (&at + &down * share).map(|u| u.clamp(-MOST, MOST));
                let then = value(&there);
                if then <= now {
                    break Some((there, then));
                }
                share *= 0.5;
                if share * down.amax() < SETTLED {
                    break None;
                }
            };
            let Some((there, then)) = accepted else { break };
            let step = (&there - &at).amax();
            (at, now) = (there, then);
            if step < SETTLED {
                break;
            }
        }
        at.iter().map(|u| u.tanh()).collect()
    }
}
