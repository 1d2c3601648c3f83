//! The analysis of a linear model: analysis of variance, variance inflation, influence of rows, information criteria, intervals.
//!
//! In: groups of columns (blocks, first order, interactions ...) and a response. Out: an [`Analysis`]. Sums are computed in double-double. Linearly
//! dependent columns are rejected. No term is chosen and no coefficient is changed here.
//!
//! ```
//! use rsm_fit::analysis::{Analysis, Group};
//!
//! // Two days (blocks) and one factor: y = 10 + 2 x, a day worth 1, and some scatter.
//! let day = vec![-1.0, -1.0, -1.0, 1.0, 1.0, 1.0];
//! let x = vec![-1.0, 0.0, 1.0, -1.0, 0.0, 1.0];
//! let y = [7.1, 8.9, 11.0, 9.0, 11.1, 12.9];
//! let groups = [Group::new("day", [day]), Group::new("x", [x])];
//! let analysis = Analysis::new(&groups, &y)?;
//! assert_eq!(analysis.sequential[0].source, "day");
//! assert!(analysis.sequential[1].p.unwrap() < 0.001);
//! # Ok::<(), rsm_fit::analysis::Refusal>(())
//! ```
//!
//! Sources: Myers, Montgomery, Anderson-Cook, Response Surface Methodology, 2.3 to 2.7; Cook, Weisberg 1982, chapter 3 (distance, studentised
//! residuals); Durbin, Watson 1950; Hurvich, Tsai 1989 (AICc); Schwarz 1978 (BIC).

mod box_cox;
mod quadratic;
mod report;

use serde::Serialize;

use crate::dd::Dd;
use crate::dd::lanes::{LANES, Lanes};
use crate::distributions::{quantile_t, two_sided_t, upper_f};
use crate::points::{self, Groups};
use crate::qr::{Growing, table};
use crate::threads;

pub use box_cox::{BoxCox, box_cox};
pub use quadratic::{PathPoint, Quadratic};
pub use report::{Report, RowReport, TermReport};
pub(crate) use report::{of as report, of_triangle as report_of_triangle};

/// With a leverage this near to 1, the model passes through the row whatever its response is.
const NO_REST: f64 = 1e-12;

/// Columns that enter the model together.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    name: String,
    columns: Vec<Vec<Dd>>,
}

impl Group {
    /// Columns with a name; each has one value per row.
    #[must_use]
    pub fn new<T: AsRef<[f64]>>(name: impl Into<String>, columns: impl IntoIterator<Item = T>) -> Self {
        let exact = |column: T| column.as_ref().iter().copied().map(Dd::from).collect();
        Group { name: name.into(), columns: columns.into_iter().map(exact).collect() }
    }
}

/// Why there is no analysis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The number of values of a column or of the weights differs from the number of rows.
    Lengths,
    /// A number is not finite, or a weight is not above 0.
    NotFinite,
    /// Columns are linearly dependent, or there are as many columns as rows.
    Dependent,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Refusal::Lengths => "columns and response: found different numbers of rows",
            Refusal::NotFinite => "columns and response: found a number that is not finite, or a weight that is not above 0",
            Refusal::Dependent => "the columns are linearly dependent, or there are no more rows than columns",
        })
    }
}

impl std::error::Error for Refusal {}

/// A line of an analysis of variance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// The source of variation.
    pub source: String,
    /// Degrees of freedom.
    pub df: usize,
    /// Sum of squares.
    pub ss: f64,
    /// Mean square.
    pub ms: f64,
    /// Mean square divided by that of the residual; for lack of fit, divided by that of pure error.
    pub f: Option<f64>,
    /// The probability of at least this F by chance.
    pub p: Option<f64>,
}

/// A column of the model, the constant first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coefficient {
    /// Its value.
    pub value: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// Value over standard error.
    pub t: f64,
    /// Two-sided probability.
    pub p: f64,
    /// Bounds of the 95 % interval.
    pub interval: [f64; 2],
    /// Variance inflation factor: the variance relative to a model with this column alone. `None` for the constant.
    pub vif: Option<f64>,
    /// The increase of the residual sum of squares without this column.
    pub partial_ss: f64,
}

/// A row of the data.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Influence {
    /// Response minus model.
    pub residual: f64,
    /// Leverage: the weight of the row in its own prediction, from 0 to 1.
    pub leverage: f64,
    /// The residual divided by its standard deviation, from the residual mean square of all rows. `None` if the leverage is 1.
    pub standardised: Option<f64>,
    /// The same with the residual mean square without this row: it has Student's t distribution.
    pub studentised: Option<f64>,
    /// Cook's distance: how far the coefficients move without the row.
    pub cook: Option<f64>,
}

/// The value of the model at a point, with intervals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Prediction {
    /// The value.
    pub value: f64,
    /// The interval of the mean response.
    pub confidence: [f64; 2],
    /// The interval of one new measurement.
    pub prediction: [f64; 2],
}

/// The analysis of a linear model with a constant.
#[derive(Debug, Clone)]
pub struct Analysis {
    /// The constant, then the columns in their order.
    pub coefficients: Vec<Coefficient>,
    /// One line for each group, after the groups before it; then the residual and, if rows are repeated, lack of fit and pure error.
    pub sequential: Vec<Line>,
    /// The rows in their order.
    pub rows: Vec<Influence>,
    /// The square root of the residual mean square.
    pub residual_sd: f64,
    /// R^2 about the mean.
    pub r2: f64,
    /// R^2 from mean squares (adjusted R^2).
    pub r2_adjusted: f64,
    /// The sum of squared errors of rows left out one at a time; `None` if a row has leverage 1.
    pub press: Option<f64>,
    /// The log likelihood for normal noise.
    pub log_likelihood: f64,
    /// Akaike's criterion. The variance counts as a parameter.
    pub aic: f64,
    /// The same with the correction for few rows; `None` if there are too few.
    pub aicc: Option<f64>,
    /// Schwarz's criterion.
    pub bic: f64,
    /// The Durbin-Watson statistic of the rows in their order: 2 without serial correlation, near 0 if neighbours are similar.
    pub durbin_watson: f64,
    growing: Growing,
    exact: Vec<Dd>,
    freedom: usize,
}

impl Analysis {
    /// Analyses the model with a constant and these groups, in this order.
    ///
    /// # Errors
    /// A [`Refusal`].
    pub fn new(groups: &[Group], response: &[f64]) -> Result<Self, Refusal> {
        Analysis::weighted(groups, response, &[])
    }

    /// The same with a weight for each row, proportional to 1/sigma^2. Without weights, all rows count equally.
    ///
    /// # Errors
    /// A [`Refusal`].
    pub fn weighted(groups: &[Group], response: &[f64], weights: &[f64]) -> Result<Self, Refusal> {
        let count = response.len();
        let columns: Vec<&Vec<Dd>> = groups.iter().flat_map(|group| &group.columns).collect();
        if columns.iter().any(|column| column.len() != count) || !(weights.is_empty() || weights.len() == count) {
            return Err(Refusal::Lengths);
        }
        let is_finite =
            columns.iter().all(|column| column.iter().all(|x| x.is_finite())) && response.iter().all(|y| y.is_finite());
        if !is_finite {
            return Err(Refusal::NotFinite);
        }
        let plain = |row: usize| std::iter::once(Dd::ONE).chain(columns.iter().map(|column| column[row])).collect();
        let names: Vec<(&str, usize)> = groups.iter().map(|group| (group.name.as_str(), group.columns.len())).collect();
        Analysis::of_rows(&names, &plain, response, weights)
    }

    /// The same for columns that are not in memory. `groups`: names and numbers of columns; `plain`: the columns of a row, the constant first.
    pub(crate) fn of_rows(
        groups: &[(&str, usize)],
        plain: &(dyn Fn(usize) -> Vec<Dd> + Sync),
        response: &[f64],
        weights: &[f64],
    ) -> Result<Self, Refusal> {
        let count = response.len();
        if weights.iter().any(|weight| !weight.is_normal() || *weight <= 0.0) {
            return Err(Refusal::NotFinite);
        }
        let width = groups.iter().map(|(_, columns)| columns).sum::<usize>() + 1;
        let freedom = count.checked_sub(width).filter(|freedom| *freedom > 0).ok_or(Refusal::Dependent)?;
        let weight = |row: usize| weights.get(row).map_or(Dd::ONE, |weight| Dd::from(*weight));
        let rows_at = |(): &mut (), first: usize, out: &mut [Lanes]| {
            for lane in 0..LANES {
                let row = (first + lane).min(count - 1);
                let root = weight(row).sqrt();
                let terms = plain(row).into_iter().chain([Dd::from(response[row])]);
                out.iter_mut().zip(terms).for_each(|(out, x)| out.set(lane, x * root));
            }
        };
        let mut growing = Growing::new(&table::triangle(width + 1, count, || (), rows_at));
        growing.add(0).map_err(|_| Refusal::Dependent)?;
        // Before other columns are added: about the mean.
        let spreads: Vec<Dd> = (1..width).map(|column| growing.own_square(column)).collect();
        let mut left = vec![growing.residual_square()];
        let mut next = 1;
        for (_, columns) in groups {
            for _ in 0..*columns {
                growing.add(next).map_err(|_| Refusal::Dependent)?;
                next += 1;
            }
            left.push(growing.residual_square());
        }
        let (total, residual) = (left[0], growing.residual_square());
        let mean_square = residual / Dd::from(freedom as f64);
        let exact = growing.coefficients();
        let rows = rows_of(plain, &weight, response, &growing, &exact, residual, freedom);
        let mut sequential: Vec<Line> = Vec::new();
        for (k, (name, columns)) in groups.iter().enumerate().filter(|(_, (_, columns))| *columns > 0) {
            let ss = left[k] - left[k + 1];
            sequential.push(line(name, *columns, ss, Some((mean_square, freedom))));
        }
        sequential.push(line("residual", freedom, residual, None));
        sequential.extend(lack_of_fit(plain, &weight, response, residual, width));
        let spread_of = |place: usize| place.checked_sub(1).map(|k| spreads[k]);
        let coefficients = coefficients(&exact, &growing, mean_square, freedom, spread_of);
        let criteria = Criteria::of(weights.iter().map(|weight| weight.ln()).sum(), count, residual, width);
        let errors: Vec<f64> = (0..count).map(|row| rows[row].residual * weight(row).sqrt().to_f64()).collect();
        let neighbours: f64 = errors.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
        let press = (0..count).map(|row| {
            let rest = 1.0 - rows[row].leverage;
            (rest > NO_REST).then(|| (errors[row] / rest).powi(2))
        });
        let share = |part: f64| 1.0 - part;
        Ok(Analysis {
            coefficients,
            sequential,
            residual_sd: mean_square.sqrt().to_f64(),
            r2: share((residual / total).to_f64()),
            r2_adjusted: share((mean_square / (total / Dd::from((count - 1) as f64))).to_f64()),
            press: press.sum(),
            log_likelihood: criteria.log_likelihood,
            aic: criteria.aic,
            aicc: criteria.aicc,
            bic: criteria.bic,
            durbin_watson: neighbours / errors.iter().map(|error| error * error).sum::<f64>(),
            rows,
            growing,
            exact,
            freedom,
        })
    }

    /// The value of the model at a point, given by its columns without the constant, and the intervals of a level such as 0.95. The interval of a new
    /// measurement is for a row of weight 1.
    ///
    /// # Panics
    /// If the number of values of the point differs from the number of columns, or if the level is not between 0 and 1.
    ///
    /// ```
    /// use rsm_fit::analysis::{Analysis, Group};
    ///
    /// let x = [0.0, 1.0, 2.0, 3.0, 4.0];
    /// let analysis = Analysis::new(&[Group::new("x", [x])], &[1.0, 3.1, 4.9, 7.0, 9.1])?;
    /// let there = analysis.predict(&[2.0], 0.95);
    /// assert!((there.value - 5.02).abs() < 1e-12); // the mean of the responses
    /// assert!(there.prediction[0] < there.confidence[0] && there.confidence[0] < 5.02);
    /// # Ok::<(), rsm_fit::analysis::Refusal>(())
    /// ```
    #[must_use]
    pub fn predict(&self, point: &[f64], level: f64) -> Prediction {
        assert_eq!(point.len() + 1, self.exact.len(), "a point has a value for every column");
        assert!(level > 0.0 && level < 1.0, "a level lies between 0 and 1");
        let row: Vec<Dd> = std::iter::once(Dd::ONE).chain(point.iter().copied().map(Dd::from)).collect();
        let value = row.iter().zip(&self.exact).map(|(x, b)| *x * *b).sum::<Dd>().to_f64();
        let leverage = self.growing.leverage(&row).to_f64();
        let half = quantile_t(level, self.freedom) * self.residual_sd;
        let around = |half: f64| [value - half, value + half];
        Prediction { value, confidence: around(half * leverage.sqrt()), prediction: around(half * (1.0 + leverage).sqrt()) }
    }
}

/// The information criteria of a fit with normal noise.
struct Criteria {
    log_likelihood: f64,
    aic: f64,
    aicc: Option<f64>,
    bic: f64,
}

impl Criteria {
    /// `logs`: the sum of the logarithms of the weights; `residual`: the sum of squares.
    fn of(logs: f64, rows: usize, residual: Dd, terms: usize) -> Self {
        let n = rows as f64;
        let log_likelihood = 0.5 * (logs - n * ((2.0 * std::f64::consts::PI).ln() + (residual.to_f64() / n).ln() + 1.0));
        let parameters = terms as f64 + 1.0;
        let aic = 2.0 * parameters - 2.0 * log_likelihood;
        let correction = 2.0 * parameters * (parameters + 1.0) / (n - parameters - 1.0);
        Criteria {
            log_likelihood,
            aic,
            aicc: (n > parameters + 1.0).then_some(aic + correction),
            bic: parameters * n.ln() - 2.0 * log_likelihood,
        }
    }
}

/// The figures of the coefficients, in the order in which the columns were added. `spread`: the sum of squares of a column about its mean; `None` for
/// the constant.
fn coefficients(
    exact: &[Dd],
    growing: &Growing,
    mean_square: Dd,
    freedom: usize,
    spread: impl Fn(usize) -> Option<Dd>,
) -> Vec<Coefficient> {
    let quantile = quantile_t(0.95, freedom);
    let of_one = |(place, (value, variance)): (usize, (&Dd, Dd))| {
        let error = (mean_square * variance).sqrt().to_f64();
        let t = value.to_f64() / error;
        Coefficient {
            value: value.to_f64(),
            standard_error: error,
            t,
            p: two_sided_t(t, freedom as f64).unwrap_or(f64::NAN),
            interval: [value.to_f64() - quantile * error, value.to_f64() + quantile * error],
            vif: spread(place).map(|spread| (variance * spread).to_f64()),
            partial_ss: (*value * *value / variance).to_f64(),
        }
    };
    exact.iter().zip(growing.variances()).enumerate().map(of_one).collect()
}

fn line(source: &str, df: usize, ss: Dd, against: Option<(Dd, usize)>) -> Line {
    let ms = ss / Dd::from(df as f64);
    let f = against.map(|(mean_square, _)| (ms / mean_square).to_f64()).filter(|f| f.is_finite());
    let p = f.zip(against).and_then(|(f, (_, freedom))| upper_f(f, [df as f64, freedom as f64]));
    Line { source: source.to_string(), df, ss: ss.to_f64(), ms: ms.to_f64(), f, p }
}

fn rows_of(
    plain: &(dyn Fn(usize) -> Vec<Dd> + Sync),
    weight: &(dyn Fn(usize) -> Dd + Sync),
    response: &[f64],
    growing: &Growing,
    coefficients: &[Dd],
    residual: Dd,
    freedom: usize,
) -> Vec<Influence> {
    let width = coefficients.len() as f64;
    let mean_square = residual.to_f64() / freedom as f64;
    let of_one = |row: usize| {
        let x = plain(row);
        let predicted: Dd = x.iter().zip(coefficients).map(|(x, b)| *x * *b).sum();
        let error = (Dd::from(response[row]) - predicted).to_f64();
        let leverage = (weight(row) * growing.leverage(&x)).to_f64();
        let rest = 1.0 - leverage;
        let weighted = error * weight(row).sqrt().to_f64();
        let standardised = (rest > NO_REST).then(|| weighted / (mean_square * rest).sqrt());
        let without = (residual.to_f64() - weighted * weighted / rest) / (freedom as f64 - 1.0);
        let studentised = (rest > NO_REST && freedom > 1 && without > 0.0).then(|| weighted / (without * rest).sqrt());
        let cook = standardised.map(|standardised| standardised * standardised * leverage / (rest * width));
        Influence { residual: error, leverage, standardised, studentised, cook }
    };
    let mut all = Vec::with_capacity(response.len());
    let of_range = |range: std::ops::Range<usize>| range.map(of_one).collect::<Vec<Influence>>();
    threads::over_rows(response.len(), of_range, |rows| all.extend(rows));
    all
}

/// Lack of fit and pure error, if there are repeated rows.
fn lack_of_fit(
    plain: &(dyn Fn(usize) -> Vec<Dd> + Sync),
    weight: &dyn Fn(usize) -> Dd,
    response: &[f64],
    residual: Dd,
    width: usize,
) -> Vec<Line> {
    // + 0.0 makes both zeros equal.
    let bits = |x: &Dd| (x.to_f64() + 0.0).to_bits();
    let mut hashes = Vec::with_capacity(response.len());
    let hash = |row: usize| plain(row).iter().fold(1, |hash, x| points::mixed(hash, bits(x)));
    let of_range = |range: std::ops::Range<usize>| range.map(hash).collect::<Vec<u64>>();
    threads::over_rows(response.len(), of_range, |found| hashes.extend(found));
    let is_equal = |row: usize, other: usize| plain(row).iter().map(bits).eq(plain(other).iter().map(bits));
    let groups = Groups::of_firsts(&points::firsts(response.len(), |row| hashes[row], is_equal));
    let (Some(lack), pure) = (groups.count().checked_sub(width), response.len() - groups.count()) else { return Vec::new() };
    if lack == 0 || pure == 0 {
        return Vec::new();
    }
    let scatter = |rows: &[usize]| {
        let sum: Dd = rows.iter().map(|row| weight(*row)).sum();
        let mean = rows.iter().map(|row| weight(*row) * Dd::from(response[*row])).sum::<Dd>() / sum;
        rows.iter().map(|row| weight(*row) * (Dd::from(response[*row]) - mean) * (Dd::from(response[*row]) - mean)).sum::<Dd>()
    };
    let ss: Dd = groups.iter().map(scatter).sum();
    let mean_square = ss / Dd::from(pure as f64);
    vec![line("lack of fit", lack, residual - ss, Some((mean_square, pure))), line("pure error", pure, ss, None)]
}

#[cfg(test)]
mod tests;
