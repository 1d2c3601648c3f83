//! What a fitted surface is worth: the figures of docs/formats.md 4.1.
//!
//! In: the design of the chosen terms, the solved problem, points and responses. Out: plain structs whose serialised keys are
//! those of `rsm fit --json`. A figure that does not exist (no degree of freedom, a residual of exactly zero) is `None`, never
//! NaN. Sums are taken in double-double.
//!
//! Sources: Myers, Montgomery, Anderson-Cook, Response Surface Methodology, 2.3 to 2.7 (t, R^2, PRESS, lack of fit); the
//! paper's (14), (15) for C. Without a constant term R^2 is uncentred, as NIST and R have it.

use std::collections::BTreeMap;

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};
use statrs::function::beta::beta_reg;

use crate::canonical::Canonical;
use crate::constrain::ConstraintStatistics;
use crate::dd::Dd;
use crate::design::{Design, Physical, order};
use crate::qr::Growing;
use crate::support::SupportStatistics;

/// A residual, or a term's part, below this share of the response is what double-double rounding leaves of zero: 2^-104 an operation, and a margin
/// of 2^20 for the number of operations.
const NO_RESIDUAL: f64 = 1.0 / (1u128 << 84) as f64;

/// Named values in their own order, serialised as a map.
#[derive(Debug, Clone, PartialEq)]
pub struct Named<T>(pub Vec<(String, T)>);

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, value) in &self.0 {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

/// A fitted term.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermStatistics {
    /// A power for every input, then one for every knot.
    pub powers: Vec<u32>,
    /// The coefficient, of the coded variables, in the unit of the response.
    pub coefficient: f64,
    /// Its standard error.
    pub standard_error: Option<f64>,
    /// Coefficient over standard error.
    pub t: Option<f64>,
    /// Two-sided probability of such a t when the term is not there.
    pub p: Option<f64>,
}

/// The test of lack of fit against the scatter of replicates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LackOfFit {
    /// Mean square of lack of fit over that of pure error; none when replicates do not scatter.
    pub f: Option<f64>,
    /// Probability of such an F when nothing is lacking.
    pub p: Option<f64>,
    /// Degrees of freedom: lack of fit, pure error.
    pub df: [usize; 2],
}

/// Errors on rows from which no coefficient was computed, with the coefficients and the saturation of the model as it is written.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ValidationStatistics {
    /// How many rows.
    pub rows: usize,
    /// Mean of the magnitudes of the errors.
    pub mean_abs_error: f64,
    /// The largest magnitude.
    pub max_abs_error: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// C of (14), (15).
    pub confidence_c: Option<f64>,
}

/// Errors on fitted rows that are left out in turn, with everything that depends on rows done again without them: the choice of
/// terms too. So the rows that judge chose nothing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CrossValidation {
    /// The errors, over all rows.
    #[serde(flatten)]
    pub errors: ValidationStatistics,
    /// So many parts were left out, each once.
    pub parts: usize,
    /// The share of the spread about the mean that is explained.
    pub r2: Option<f64>,
}

/// What the rows were used for, in words.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct RowsUsed {
    /// Rows from which the coefficients were computed.
    pub coefficients: String,
    /// Rows by which the terms were chosen; "none" where they were given.
    pub terms: String,
    /// Rows on which `validation` is.
    pub validation: String,
    /// Rows that chose nothing and on which the error is to be believed.
    pub error: String,
}

/// Something that the user should know before the surface is used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Warning {
    /// For programs.
    pub kind: &'static str,
    /// In words.
    pub what: String,
}

/// One response, with the keys of docs/formats.md 4.1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseStatistics {
    /// The terms, in the order of the model file.
    pub terms: Vec<TermStatistics>,
    /// Rows fitted.
    pub rows: usize,
    /// Root of the residual mean square.
    pub residual_sd: Option<f64>,
    /// Share of the response's square about its mean (about 0 without a constant term) that is explained.
    pub r2: Option<f64>,
    /// The same with mean squares.
    pub r2_adjusted: Option<f64>,
    /// The same with PRESS.
    pub r2_predicted: Option<f64>,
    /// Sum of squares of the errors at rows that are left out one at a time.
    pub press: Option<f64>,
    /// C of (14), (15) on the fitted data.
    pub confidence_c: Option<f64>,
    /// None without replicates.
    pub lack_of_fit: Option<LackOfFit>,
    /// On the rows by which a ladder chose, or unseen where terms were given. None without validation data.
    pub validation: Option<ValidationStatistics>,
    /// None but for second-order surfaces of plain coded variables.
    pub canonical: Option<Canonical>,
    /// On rows that chose nothing. None without test data.
    pub test: Option<ValidationStatistics>,
    /// On rows left out in turn. None where there are other rows that chose nothing, and where it cannot be done.
    pub cross_validation: Option<CrossValidation>,
    /// What the rows were used for.
    pub rows_used: RowsUsed,
    /// What to know before the surface is used.
    pub warnings: Vec<Warning>,
    /// Where the data support the surface; absent where the specification does not ask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub support: Option<SupportStatistics>,
    /// What the constraints cost; absent where the specification has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constraints: Option<ConstraintStatistics>,
}

/// Points with their responses.
#[derive(Debug, Clone, Copy)]
pub struct Observations<'a> {
    /// For every input of the surface its values.
    pub inputs: &'a [&'a [f64]],
    /// The response.
    pub response: &'a [f64],
    /// How much each row counts, with a mean of 1; empty where all count alike.
    pub weights: &'a [f64],
}

impl Observations<'_> {
    /// How much a row counts.
    #[must_use]
    pub fn weight(&self, row: usize) -> Dd {
        self.weights.get(row).map_or(Dd::ONE, |weight| Dd::from(*weight))
    }

    /// How much some rows count together.
    #[must_use]
    pub fn weight_of(&self, rows: &[usize]) -> Dd {
        rows.iter().map(|row| self.weight(*row)).sum()
    }

    /// The sum of squares of the response about a value.
    fn square_about(&self, value: Dd) -> Dd {
        let deviation = |row: usize| Dd::from(self.response[row]) - value;
        (0..self.response.len()).map(|row| self.weight(row) * deviation(row) * deviation(row)).sum()
    }

    /// The point of a row.
    #[must_use]
    pub fn point(&self, row: usize) -> Vec<Physical> {
        self.inputs.iter().map(|column| Physical(column[row])).collect()
    }

    /// Rows with identical settings of all inputs, group by group, in the order of their first rows.
    #[must_use]
    pub fn replicates(&self) -> Vec<Vec<usize>> {
        let mut group_of: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for row in 0..self.response.len() {
            // + 0.0 makes one of the two zeros.
            let key = self.inputs.iter().map(|column| (column[row] + 0.0).to_bits()).collect();
            let group = *group_of.entry(key).or_insert(groups.len());
            if group == groups.len() {
                groups.push(Vec::new());
            }
            groups[group].push(row);
        }
        groups
    }

    /// The mean response of some rows, each with its weight.
    #[must_use]
    pub fn mean(&self, rows: &[usize]) -> Dd {
        let sum: Dd = rows.iter().map(|row| self.weight(*row) * Dd::from(self.response[*row])).sum();
        sum / self.weight_of(rows)
    }
}

/// The value of a polynomial at a row of its design.
pub(crate) fn value(row: &[Dd], coefficients: &[Dd]) -> Dd {
    row.iter().zip(coefficients).map(|(x, b)| *x * *b).sum()
}

/// All but validation and canonical analysis. `growing` holds the terms of `design` in its order.
#[must_use]
pub fn of_fit(design: &Design, growing: &Growing, observations: Observations<'_>) -> ResponseStatistics {
    let rows = observations.response.len();
    let mut coefficients = growing.coefficients();
    let freedom = rows - coefficients.len();
    let y_square = observations.square_about(Dd::ZERO);
    for (place, coefficient) in coefficients.iter_mut().enumerate() {
        if coefficient.to_f64().abs() * growing.norm(place) <= NO_RESIDUAL * y_square.sqrt().to_f64() {
            *coefficient = Dd::ZERO;
        }
    }
    let mut rss = growing.residual_square();
    if rss.sqrt().to_f64() <= NO_RESIDUAL * y_square.sqrt().to_f64() {
        rss = Dd::ZERO;
    }
    let has_constant = design.terms().iter().any(|powers| order(powers) == 0);
    let total = total_square(observations, has_constant);
    let mean_square = (freedom > 0).then(|| rss / Dd::from(freedom as f64));
    let mut press = Some(Dd::ZERO);
    let mut predictions = Vec::with_capacity(rows);
    for row in 0..rows {
        let x = design.row_as_measured(&observations.point(row));
        let prediction = value(&x, &coefficients);
        let weight = observations.weight(row);
        let own = Dd::ONE - weight * growing.leverage(&x);
        let error = Dd::from(observations.response[row]) - prediction;
        // With leverage 1 the surface goes through this point whatever it is: left out, nothing holds the term. 2^-40 is well
        // above the rounding of the leverage for columns that pass as independent.
        press = press.filter(|_| own.to_f64() > 1e-12).map(|sum| sum + weight * (error / own) * (error / own));
        predictions.push(prediction);
    }
    if rss == Dd::ZERO {
        press = press.map(|_| Dd::ZERO);
    }
    let terms = terms(design, growing, &coefficients, mean_square, freedom);
    let share = |part: Option<Dd>, whole: Option<Dd>| {
        let (part, whole) = (part?, whole?);
        (whole > Dd::ZERO).then(|| (Dd::ONE - part / whole).to_f64())
    };
    let total_freedom = rows - usize::from(has_constant);
    let total_mean_square = (total_freedom > 0).then(|| total / Dd::from(total_freedom as f64));
    ResponseStatistics {
        terms,
        rows,
        residual_sd: mean_square.map(|square| square.sqrt().to_f64()),
        r2: share(Some(rss), Some(total)),
        r2_adjusted: share(mean_square, total_mean_square),
        r2_predicted: share(press, Some(total)),
        press: press.map(Dd::to_f64),
        confidence_c: confidence(observations, &predictions),
        lack_of_fit: lack_of_fit(observations, &predictions, coefficients.len()),
        validation: None,
        test: None,
        cross_validation: None,
        rows_used: RowsUsed::default(),
        warnings: Vec::new(),
        canonical: None,
        support: None,
        constraints: None,
    }
}

/// The figures of coefficients that active constraints hold. Residuals are what they are; what rests on the distribution of free
/// least squares does not exist: standard errors, t and p (an estimate on the edge of its region has a mixture of distributions,
/// and a normal one not even with many rows: Geyer 1994, Silvapulle and Sen 2005, chapter 4), the p of lack of fit, and PRESS,
/// whose rows would each have to be left out in a constrained fit of its own. Degrees of freedom count every term, as if all were
/// free: the residual standard deviation is rather too large.
#[must_use]
pub fn of_constrained(design: &Design, coefficients: &[f64], observations: Observations<'_>) -> ResponseStatistics {
    let rows = observations.response.len();
    let exact: Vec<Dd> = coefficients.iter().copied().map(Dd::from).collect();
    let predictions: Vec<Dd> = (0..rows).map(|row| value(&design.row_as_measured(&observations.point(row)), &exact)).collect();
    let error = |row: usize| Dd::from(observations.response[row]) - predictions[row];
    let rss: Dd = (0..rows).map(|row| observations.weight(row) * error(row) * error(row)).sum();
    let has_constant = design.terms().iter().any(|powers| order(powers) == 0);
    let total = total_square(observations, has_constant);
    let mean = |sum: Dd, freedom: usize| (freedom > 0).then(|| sum / Dd::from(freedom as f64));
    let mean_square = mean(rss, rows.saturating_sub(coefficients.len()));
    let share = |part: Option<Dd>, whole: Option<Dd>| {
        let (part, whole) = (part?, whole?);
        (whole > Dd::ZERO).then(|| (Dd::ONE - part / whole).to_f64())
    };
    let term = |(powers, coefficient): (&Vec<u32>, &f64)| TermStatistics {
        powers: powers.clone(),
        coefficient: *coefficient,
        standard_error: None,
        t: None,
        p: None,
    };
    ResponseStatistics {
        terms: design.terms().iter().zip(coefficients).map(term).collect(),
        rows,
        residual_sd: mean_square.map(|square| square.sqrt().to_f64()),
        r2: share(Some(rss), Some(total)),
        r2_adjusted: share(mean_square, mean(total, rows - usize::from(has_constant))),
        r2_predicted: None,
        press: None,
        confidence_c: confidence(observations, &predictions),
        lack_of_fit: lack_of_fit(observations, &predictions, coefficients.len()).map(|lack| LackOfFit { p: None, ..lack }),
        validation: None,
        test: None,
        cross_validation: None,
        rows_used: RowsUsed::default(),
        warnings: Vec::new(),
        canonical: None,
        support: None,
        constraints: None,
    }
}

fn total_square(observations: Observations<'_>, centred: bool) -> Dd {
    let all: Vec<usize> = (0..observations.response.len()).collect();
    let mean = if centred { observations.mean(&all) } else { Dd::ZERO };
    observations.square_about(mean)
}

fn terms(
    design: &Design,
    growing: &Growing,
    coefficients: &[Dd],
    mean_square: Option<Dd>,
    freedom: usize,
) -> Vec<TermStatistics> {
    let columns = design.terms().iter().zip(coefficients).zip(growing.variances());
    let of_one = |((powers, coefficient), variance): ((&Vec<u32>, &Dd), Dd)| {
        let error = mean_square.map(|square| (square * variance).sqrt());
        let t = error.filter(|error| *error > Dd::ZERO).map(|error| (*coefficient / error).to_f64());
        TermStatistics {
            powers: powers.clone(),
            coefficient: coefficient.to_f64(),
            standard_error: error.map(Dd::to_f64),
            t,
            p: t.and_then(|t| two_sided_t(t, freedom as f64)),
        }
    };
    columns.map(of_one).collect()
}

/// P(|T| > |t|) = I_{df/(df + t^2)}(df/2, 1/2).
pub(crate) fn two_sided_t(t: f64, freedom: f64) -> Option<f64> {
    let p = beta_reg(freedom / 2.0, 0.5, freedom / (freedom + t * t));
    p.is_finite().then_some(p)
}

/// P(F > f) = I_{d2/(d2 + d1 f)}(d2/2, d1/2).
fn upper_f(f: f64, [d1, d2]: [f64; 2]) -> Option<f64> {
    let p = beta_reg(d2 / 2.0, d1 / 2.0, d2 / (d2 + d1 * f));
    p.is_finite().then_some(p)
}

/// (14), (15). None when every mean response is 0.
fn confidence(observations: Observations<'_>, predictions: &[Dd]) -> Option<f64> {
    let (ss_lof, ss_y) = lack(observations, predictions);
    let confidence = 100.0 - 100.0 * (ss_lof / ss_y).to_f64();
    confidence.is_finite().then_some(confidence)
}

/// SS_lof of (14) and SS_y of (15).
pub(crate) fn lack(observations: Observations<'_>, predictions: &[Dd]) -> (Dd, Dd) {
    let (mut ss_lof, mut ss_y) = (Dd::ZERO, Dd::ZERO);
    for group in observations.replicates() {
        // n_i of the paper: a row counts as much as it weighs.
        let count = observations.weight_of(&group);
        let mean = observations.mean(&group);
        // Replicates have one point, so one prediction.
        let gap = mean - predictions[group[0]];
        ss_lof += count * gap * gap;
        ss_y += count * mean * mean;
    }
    (ss_lof, ss_y)
}

fn lack_of_fit(observations: Observations<'_>, predictions: &[Dd], terms: usize) -> Option<LackOfFit> {
    let groups = observations.replicates();
    let pure_freedom = observations.response.len() - groups.len();
    let freedom = groups.len().checked_sub(terms).filter(|freedom| *freedom > 0)?;
    if pure_freedom == 0 {
        return None;
    }
    let (mut ss_lof, mut ss_pure) = (Dd::ZERO, Dd::ZERO);
    for group in &groups {
        let mean = observations.mean(group);
        let gap = mean - predictions[group[0]];
        ss_lof += observations.weight_of(group) * gap * gap;
        for row in group {
            let error = Dd::from(observations.response[*row]) - mean;
            ss_pure += observations.weight(*row) * error * error;
        }
    }
    let df = [freedom as f64, pure_freedom as f64];
    let f = ((ss_lof / Dd::from(df[0])) / (ss_pure / Dd::from(df[1]))).to_f64();
    let f = f.is_finite().then_some(f);
    Some(LackOfFit { f, p: f.and_then(|f| upper_f(f, df)), df: [freedom, pure_freedom] })
}

/// Sums of the errors of a model on rows that were not fitted. Sums of several parts add up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    rows: usize,
    absolute: Dd,
    largest: f64,
    square: Dd,
    lack: Dd,
    about_zero: Dd,
    about_mean: Dd,
}

impl Judged {
    /// Nothing judged yet.
    pub const NOTHING: Judged = Judged {
        rows: 0,
        absolute: Dd::ZERO,
        largest: 0.0,
        square: Dd::ZERO,
        lack: Dd::ZERO,
        about_zero: Dd::ZERO,
        about_mean: Dd::ZERO,
    };

    /// The errors of a model as it is written, saturated, on some rows. `mean`: what would be predicted without a surface.
    #[must_use]
    pub fn of(
        design: &Design,
        coefficients: &[f64],
        output_range: Option<[f64; 2]>,
        observations: Observations<'_>,
        mean: Dd,
    ) -> Self {
        let coefficients: Vec<Dd> = coefficients.iter().copied().map(Dd::from).collect();
        let saturated = |y: Dd| match output_range.map(|range| range.map(Dd::from)) {
            Some([low, _]) if y < low => low,
            Some([_, high]) if y > high => high,
            _ => y,
        };
        let predict = |row: usize| saturated(value(&design.row(&observations.point(row)), &coefficients));
        let predictions: Vec<Dd> = (0..observations.response.len()).map(predict).collect();
        let mut judged = Judged { rows: observations.response.len(), ..Judged::NOTHING };
        for (prediction, y) in predictions.iter().zip(observations.response) {
            let error = (Dd::from(*y) - *prediction).abs();
            judged.absolute += error;
            judged.square += error * error;
            judged.largest = error.to_f64().max(judged.largest);
        }
        (judged.lack, judged.about_zero) = lack(observations, &predictions);
        let none = vec![mean; observations.response.len()];
        judged.about_mean = lack(observations, &none).0;
        judged
    }

    /// Both together.
    #[must_use]
    pub fn and(self, other: Judged) -> Self {
        Judged {
            rows: self.rows + other.rows,
            absolute: self.absolute + other.absolute,
            largest: self.largest.max(other.largest),
            square: self.square + other.square,
            lack: self.lack + other.lack,
            about_zero: self.about_zero + other.about_zero,
            about_mean: self.about_mean + other.about_mean,
        }
    }

    /// The share of the spread about the mean that the surface explains, replicates taken by their means; negative where the mean alone
    /// does better. `None` where there is no spread.
    #[must_use]
    pub fn explained(&self) -> Option<f64> {
        let explained = (Dd::ONE - self.lack / self.about_mean).to_f64();
        (self.rows > 0 && explained.is_finite()).then_some(explained)
    }

    /// The figures. None without rows.
    #[must_use]
    pub fn statistics(&self) -> Option<ValidationStatistics> {
        let count = Dd::from(self.rows as f64);
        let confidence = 100.0 - 100.0 * (self.lack / self.about_zero).to_f64();
        (self.rows > 0).then(|| ValidationStatistics {
            rows: self.rows,
            mean_abs_error: (self.absolute / count).to_f64(),
            max_abs_error: self.largest,
            rmse: (self.square / count).sqrt().to_f64(),
            confidence_c: confidence.is_finite().then_some(confidence),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_agree_with_tables() {
        // R: 2 * pt(-1.2088, 4) = 0.2933; pf(95.7335, 2, 2, lower.tail = FALSE) = 0.01034; 2 * pt(-1056.067, 7) = 1.8e-19.
        assert!((two_sided_t(1.2088, 4.0).unwrap() - 0.2933).abs() < 5e-5);
        assert!((upper_f(95.7335, [2.0, 2.0]).unwrap() - 0.01034).abs() < 5e-6);
        // Two degrees of freedom have closed forms: P(|T| > t) = 1 - t/sqrt(2 + t^2), P(F > f) = 1/(1 + f) for (2, 2).
        let t: f64 = 30.0;
        assert!((two_sided_t(t, 2.0).unwrap() / (1.0 - t / (2.0 + t * t).sqrt()) - 1.0).abs() < 1e-11);
        assert!((upper_f(1e6, [2.0, 2.0]).unwrap() * (1.0 + 1e6) - 1.0).abs() < 1e-11);
        assert_eq!(two_sided_t(0.0, 5.0), Some(1.0));
    }

    /// The figures of some terms (powers of one natural variable) on points.
    fn of_line(powers: &[u32], x: &[f64], y: &[f64]) -> ResponseStatistics {
        use rsm_core::model::{Coding, Input, Outside, Surface};
        let surface = Surface { inputs: vec!["x".into()], coding: Coding::None, ..Surface::default() };
        let input = Input { name: "x".into(), unit: "1".into(), range: [-10.0, 10.0], outside: Outside::Clamp };
        let design = Design::new(&surface, &[input], powers.iter().map(|power| vec![*power]).collect());
        let columns: [&[f64]; 1] = [x];
        let rows = Observations { inputs: &columns, response: y, weights: &[] };
        let mut compressed = crate::qr::Compressed::new(powers.len() + 1);
        for (row, y) in y.iter().enumerate() {
            compressed.push(design.row_as_measured(&rows.point(row)).into_iter().chain([Dd::from(*y)]));
        }
        let all: Vec<usize> = (0..powers.len()).collect();
        of_fit(&design, &Growing::of(&compressed.finish(), &all).unwrap(), rows)
    }

    #[test]
    fn degrees_of_freedom_count_the_constant_only_where_there_is_one() {
        // Through the origin: b = (1 + 4 + 12)/14, residual square 21 - 289/14 = 5/14 with 2 degrees, total 21 with all 3: 1 - (5/28)/7.
        let found = of_line(&[1], &[1.0, 2.0, 3.0], &[1.0, 2.0, 4.0]);
        assert!((found.r2_adjusted.unwrap() - (1.0 - 5.0 / 196.0)).abs() < 1e-15, "{found:?}");
        assert!((found.r2.unwrap() - (1.0 - 5.0 / 294.0)).abs() < 1e-15);
        // With a constant: slope 1.5, residual square 1/6 with 1 degree, total 14/3 with 2: 1 - (1/6)/(7/3).
        let found = of_line(&[0, 1], &[1.0, 2.0, 3.0], &[1.0, 2.0, 4.0]);
        assert!((found.r2_adjusted.unwrap() - (1.0 - 1.0 / 14.0)).abs() < 1e-15, "{found:?}");
        assert!((found.residual_sd.unwrap() - (1.0f64 / 6.0).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_negative_slope_is_as_significant_as_a_positive_one() {
        let (x, y) = ([1.0, 2.0, 3.0, 4.0], [1.0, 2.5, 2.0, 4.0]);
        let (up, down) = (of_line(&[0, 1], &x, &y), of_line(&[0, 1], &x, &y.map(|y| -y)));
        assert!(down.terms[1].t.unwrap() < 0.0 && up.terms[1].t.unwrap() > 0.0);
        assert_eq!(up.terms[1].t.map(|t| -t), down.terms[1].t);
        assert_eq!(up.terms[1].p, down.terms[1].p);
        // Two degrees of freedom: p = 1 - |t|/sqrt(2 + t^2).
        let t = up.terms[1].t.unwrap();
        assert!((down.terms[1].p.unwrap() - (1.0 - t / (2.0 + t * t).sqrt())).abs() < 1e-14);
    }

    #[test]
    fn judged_parts_add_up_to_the_whole() {
        let surface =
            rsm_core::model::Surface { inputs: vec!["x".into()], coding: rsm_core::model::Coding::None, ..Default::default() };
        let outside = rsm_core::model::Outside::Clamp;
        let input = rsm_core::model::Input { name: "x".into(), unit: "1".into(), range: [0.0, 4.0], outside };
        let design = Design::new(&surface, &[input], vec![vec![1]]);
        // y = 2 x, held to 6, at 0, 1, 1, 4 and 5 (clamped to 4): predictions 0, 2, 2, 6, 6; errors 1, 1, -1, -2, 4.
        let of = |x: &[f64], y: &[f64]| {
            let columns: [&[f64]; 1] = [x];
            let rows = Observations { inputs: &columns, response: y, weights: &[] };
            Judged::of(&design, &[2.0], Some([0.0, 6.0]), rows, Dd::from(3.0))
        };
        let whole = of(&[0.0, 1.0, 1.0, 4.0, 5.0], &[1.0, 3.0, 1.0, 4.0, 10.0]);
        let parts = of(&[0.0, 1.0, 1.0], &[1.0, 3.0, 1.0]).and(of(&[4.0, 5.0], &[4.0, 10.0]));
        assert_eq!(whole, parts);
        let found = whole.statistics().unwrap();
        assert_eq!((found.rows, found.mean_abs_error, found.max_abs_error), (5, 9.0 / 5.0, 4.0));
        assert_eq!(found.rmse, (23.0f64 / 5.0).sqrt());
        // By means of repeated points: 1 + 2 0 + 4 + 16 = 21 of 1 + 2 4 + 16 + 100 = 125 about zero, of 4 + 2 1 + 1 + 49 = 56 about 3.
        assert_eq!(found.confidence_c, Some(100.0 - 100.0 * 21.0 / 125.0));
        assert_eq!(whole.explained(), Some(1.0 - 21.0 / 56.0));
        assert_eq!((Judged::NOTHING.statistics(), Judged::NOTHING.explained()), (None, None));
    }
}
