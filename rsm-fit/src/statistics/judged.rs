//! Errors on rows that were not fitted, as sums that can be added over parts, and their figures.
//!
//! In: a model as written, with saturation, and rows. Out: [`Judged`]. A row is clamped to the range, as in an evaluator. The figures are in the unit
//! of the response. With a transform the shares of the spread, and the error that choices compare, are of its terms: there the noise is even. Fits
//! nothing.

use super::{Observations, ValidationStatistics, lack};
use crate::dd::Dd;
use crate::design::Design;
use crate::design::eight::Seen;

/// Sums of the errors of a model on rows that were not fitted. Sums of several parts can be added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    rows: usize,
    absolute: Dd,
    largest: f64,
    square: Dd,
    square_of_terms: Dd,
    lack: Dd,
    about_zero: Dd,
    about_mean: Dd,
}

impl Judged {
    /// Sums without rows.
    pub const NOTHING: Judged = Judged {
        rows: 0,
        absolute: Dd::ZERO,
        largest: 0.0,
        square: Dd::ZERO,
        square_of_terms: Dd::ZERO,
        lack: Dd::ZERO,
        about_zero: Dd::ZERO,
        about_mean: Dd::ZERO,
    };

    /// The errors of a model as written, with saturation, on some rows. `mean`: the prediction without a surface.
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
            // mutant `< to <=`: at the bound the value is the bound.
            Some([low, _]) if y < low => low,
            // mutant `> to >=`: likewise.
            Some([_, high]) if y > high => high,
            _ => y,
        };
        let mut predictions = observations.values(design, &coefficients, Seen::AsEvaluated);
        predictions.iter_mut().for_each(|prediction| *prediction = saturated(*prediction));
        let mut judged = Judged { rows: observations.response.len(), ..Judged::NOTHING };
        for (prediction, y) in predictions.iter().zip(observations.response) {
            let of_terms = (Dd::from(*y) - *prediction).abs();
            let error = match design.transform() {
                Some(transform) => (transform.response(Dd::from(*y)) - transform.response(*prediction)).abs(),
                None => of_terms,
            };
            judged.absolute += error;
            judged.square += error * error;
            judged.square_of_terms += of_terms * of_terms;
            judged.largest = error.to_f64().max(judged.largest);
        }
        let points = observations.points();
        (judged.lack, judged.about_zero) = lack(observations, &points, |row| predictions[row]);
        let of_blocks = design.of_blocks();
        if of_blocks.is_empty() {
            judged.about_mean = lack(observations, &points, |_| mean).0;
            return judged;
        }
        // What the blocks explain is not explained by the surface. Without a surface the prediction would be the mean of the other rows, less the
        // effects of their blocks; the mean of these rows is a better one, so that less is explained.
        let own: Vec<Dd> =
            (0..design.width()).map(|k| if of_blocks.contains(&k) { coefficients[k] } else { Dd::ZERO }).collect();
        let shifts = observations.values(design, &own, Seen::AsEvaluated);
        judged.about_zero = lack(observations, &points, |row| shifts[row]).0;
        let weight: Dd = (0..observations.response.len()).map(|row| observations.weight(row)).sum();
        let left = |row: usize| observations.weight(row) * (Dd::from(observations.response[row]) - shifts[row]);
        let level = (0..observations.response.len()).map(left).sum::<Dd>() / weight;
        judged.about_mean = lack(observations, &points, |row| level + shifts[row]).0;
        judged
    }

    /// The sum of both.
    #[must_use]
    pub fn and(self, other: Judged) -> Self {
        Judged {
            rows: self.rows + other.rows,
            absolute: self.absolute + other.absolute,
            largest: self.largest.max(other.largest),
            square: self.square + other.square,
            square_of_terms: self.square_of_terms + other.square_of_terms,
            lack: self.lack + other.lack,
            about_zero: self.about_zero + other.about_zero,
            about_mean: self.about_mean + other.about_mean,
        }
    }

    /// The explained share of the spread about the mean, with replicates replaced by their means; negative if the mean alone is better. `None`
    /// without a spread or without rows.
    #[must_use]
    pub fn explained(&self) -> Option<f64> {
        let explained = (Dd::ONE - self.lack / self.about_mean).to_f64();
        explained.is_finite().then_some(explained)
    }

    /// The root mean square error of the terms, that of the response without a transform; `None` without rows.
    #[must_use]
    pub fn rmse_of_terms(&self) -> Option<f64> {
        (self.rows > 0).then(|| (self.square_of_terms / Dd::from(self.rows as f64)).sqrt().to_f64())
    }

    /// The figures, in the unit of the response; `None` without rows.
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
