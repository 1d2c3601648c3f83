//! Rates the models of a path, and selects one.
//!
//! In: models by key, and rows that evaluate them. Out: a rating for each key: the mean square error of cross-validation or on validation rows with
//! its standard error, AICc, or PRESS. A key without a model for some part of the rows has no rating. The smallest rating wins, and of equal ones
//! that with the fewest terms. With the one-standard-error rule, the fewest terms within one standard error of the smallest rating win.
//!
//! Sources: Allen 1974 (PRESS); Hurvich, Tsai 1989 (AICc); Breiman, Friedman, Olshen, Stone 1984, 3.4.3 (one standard error).

use super::gram::{Gram, Swept};
use super::paths::Path;
use crate::spec::Criterion;
use crate::statistics::SizeReport;

/// Errors below this share of the response's square are rounding errors of f64 sums.
const ROUNDING: f64 = 1e-13;

/// A larger model is preferred only if it reduces the error by at least this share.
const LEAST_GAIN: f64 = 1e-9;

/// The limit of multiplications of PRESS over all sizes.
const PRESS_WORK: f64 = 3e8;

#[derive(Debug, Clone, Copy)]
pub(super) struct Rating {
    pub value: f64,
    /// The standard error of a mean over parts.
    pub standard_error: Option<f64>,
}

/// For each key, the sum of squares on some rows, and the number of rows.
pub(super) struct Errors {
    squares: Vec<Option<f64>>,
    weight: f64,
}

pub(super) fn errors(path: &Path, judge: &Gram) -> Errors {
    let of_one = |model: &Option<super::Model>| model.as_ref().map(|model| judge.square(&model.terms, &model.coefficients));
    Errors { squares: path.iter().map(of_one).collect(), weight: judge.weight }
}

/// `square`: that of the response over all rows; errors far below it are rounding errors.
pub(super) fn by_parts(parts: &[Errors], full: &Path, square: f64) -> Vec<Option<Rating>> {
    let weight: f64 = parts.iter().map(|part| part.weight).sum();
    let count = parts.len() as f64;
    let of_key = |key: usize| {
        full[key].as_ref()?;
        let squares = parts.iter().map(|part| part.squares[key]).collect::<Option<Vec<f64>>>()?;
        let mean = squares.iter().sum::<f64>().max(ROUNDING * square) / weight;
        let each = squares.iter().zip(parts).map(|(square, part)| square / part.weight - mean);
        let deviation = (each.map(|gap| gap * gap).sum::<f64>() / (count - 1.0)).sqrt();
        let standard_error = Some(deviation / count.sqrt()).filter(|error| error.is_finite());
        Some(Rating { value: mean, standard_error })
    };
    (0..full.len()).map(of_key).collect()
}

pub(super) fn by_aicc(full: &Path, total: &Gram) -> Vec<Option<Rating>> {
    let rows = total.rows as f64;
    let square = total.at(total.width - 1, total.width - 1);
    let of_one = |model: &Option<super::Model>| {
        let model = model.as_ref()?;
        let left = total.square(&model.terms, &model.coefficients).max(ROUNDING * square);
        // The variance counts as a parameter too.
        let parameters = model.terms.len() as f64 + 1.0;
        let value = rows * (left / rows).ln() + 2.0 * parameters * rows / (rows - parameters - 1.0);
        (value.is_finite() && rows > parameters + 1.0).then_some(Rating { value, standard_error: None })
    };
    full.iter().map(of_one).collect()
}

/// The largest number of terms for which PRESS is computed.
pub(super) fn most_for_press(rows: usize) -> usize {
    (3.0 * PRESS_WORK / rows.max(1) as f64).cbrt() as usize
}

/// `rows`: all rows, scaled, multiplied by the square root of their weight.
pub(super) fn by_press(full: &Path, total: &Gram, rows: &[&Vec<f64>]) -> Vec<Option<Rating>> {
    let square = total.at(total.width - 1, total.width - 1);
    let of_one = |model: &Option<super::Model>| {
        let model = model.as_ref()?;
        let size = model.terms.len();
        // A small matrix with only these terms.
        let mut small = Gram::nothing(size + 1);
        for (row, term) in model.terms.iter().enumerate() {
            for (column, other) in model.terms.iter().enumerate() {
                small.sums[row * (size + 1) + column] = total.at(*term, *other);
            }
        }
        let mut inverse = Swept::new(&small);
        (0..size).for_each(|k| inverse.sweep(k));
        let mut sum = 0.0;
        for row in rows {
            let z: Vec<f64> = model.terms.iter().map(|term| row[*term]).collect();
            let fitted: f64 = z.iter().zip(&model.coefficients).map(|(z, b)| z * b).sum();
            let leverage: f64 = z
                .iter()
                .enumerate()
                .map(|(k, own)| own * z.iter().enumerate().map(|(j, z)| z * inverse.at(k, j)).sum::<f64>())
                .sum();
            let rest = 1.0 - leverage;
            // Without the row, some term would not be determined.
            if rest <= 1e-9 {
                return None;
            }
            sum += ((row[row.len() - 1] - fitted) / rest).powi(2);
        }
        Some(Rating { value: sum.max(ROUNDING * square) / total.weight, standard_error: None })
    };
    full.iter().map(of_one).collect()
}

/// The key of the selected model.
pub(super) fn chosen(ratings: &[Option<Rating>], full: &Path, one_standard_error: bool) -> Option<usize> {
    let size = |key: usize| full[key].as_ref().map_or(usize::MAX, |model| model.terms.len());
    let rated = || ratings.iter().enumerate().filter_map(|(key, rating)| Some((key, (*rating)?)));
    let least = rated().map(|(_, rating)| rating.value).reduce(f64::min)?;
    let limit = least + LEAST_GAIN * least.abs();
    let best = |limit: f64| {
        let within = rated().filter(move |(_, rating)| rating.value <= limit);
        within.min_by(|(a, one), (b, other)| size(*a).cmp(&size(*b)).then(one.value.total_cmp(&other.value)))
    };
    let (key, rating) = best(limit)?;
    match rating.standard_error.filter(|_| one_standard_error) {
        Some(error) => best(least + error).map(|(key, _)| key),
        None => Some(key),
    }
}

/// The criterion by number of terms; an error is in the unit of the response.
pub(super) fn by_size(ratings: &[Option<Rating>], full: &Path, criterion: Criterion, scale: f64) -> Vec<SizeReport> {
    let mut list: Vec<SizeReport> = Vec::new();
    for (rating, model) in ratings.iter().zip(full) {
        let (Some(rating), Some(model)) = (rating, model) else { continue };
        let criterion = if criterion == Criterion::Aicc { rating.value } else { rating.value.sqrt() * scale };
        match list.iter_mut().find(|known| known.terms == model.terms.len()) {
            Some(known) => known.criterion = known.criterion.min(criterion),
            None => list.push(SizeReport { terms: model.terms.len(), criterion }),
        }
    }
    list.sort_by_key(|size| size.terms);
    list
}
