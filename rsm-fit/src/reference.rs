//! Least squares by normal equations in exact rational arithmetic, as a reference for the double-double solution.
//!
//! In: rows, responses and weights as rational numbers. Out: coefficients, (X'WX)^-1, sums of squares, all exact. Shares no code with `qr.rs`. Used
//! only by tests.
//! reflection, no root, no rounding. For tests alone.

use num_traits::ToPrimitive;
use rsm_core::number::{Rational, exact, integer};

use crate::dd::Dd;
use crate::random::Random;

/// Rows of terms, responses and weights.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub rows: Vec<Vec<Rational>>,
    pub response: Vec<Rational>,
    pub weights: Vec<Rational>,
}

/// The solution.
#[derive(Debug)]
pub(crate) struct Answer {
    pub coefficients: Vec<Rational>,
    /// (X'WX)^-1.
    pub inverse: Vec<Vec<Rational>>,
    pub residual_square: Rational,
}

impl Problem {
    pub(crate) fn of(rows: &[Vec<f64>], response: &[f64]) -> Self {
        let all = |values: &[f64]| values.iter().map(|value| exact(*value)).collect::<Vec<Rational>>();
        Problem {
            rows: rows.iter().map(|row| all(row)).collect(),
            response: all(response),
            weights: vec![integer(1); response.len()],
        }
    }

    pub(crate) fn weighted(self, weights: &[f64]) -> Self {
        Problem { weights: weights.iter().map(|weight| exact(*weight)).collect(), ..self }
    }

    /// Some of the columns.
    pub(crate) fn only(&self, columns: &[usize]) -> Self {
        let rows = self.rows.iter().map(|row| columns.iter().map(|k| row[*k].clone()).collect()).collect();
        Problem { rows, ..self.clone() }
    }

    /// All rows but one.
    pub(crate) fn without(&self, row: usize) -> Self {
        let mut other = self.clone();
        other.rows.remove(row);
        other.response.remove(row);
        other.weights.remove(row);
        other
    }

    /// sum of weight (response - row b)^2.
    pub(crate) fn left_by(&self, coefficients: &[Rational]) -> Rational {
        let each = self.rows.iter().zip(&self.response).zip(&self.weights);
        each.map(|((row, y), weight)| {
            let error = y - dot(row, coefficients);
            weight * &error * &error
        })
        .sum()
    }

    /// `None` if the columns are linearly dependent.
    pub(crate) fn solve(&self) -> Option<Answer> {
        let width = self.rows.first().map_or(0, Vec::len);
        let sum =
            |of: &dyn Fn(usize) -> Rational| (0..self.rows.len()).map(|row| of(row) * &self.weights[row]).sum::<Rational>();
        // X'WX next to the unit matrix, then Gauss-Jordan elimination.
        let mut lines: Vec<Vec<Rational>> = (0..width)
            .map(|a| {
                let square = (0..width).map(|b| sum(&|row| &self.rows[row][a] * &self.rows[row][b]));
                square.chain((0..width).map(|b| integer(i64::from(a == b)))).collect()
            })
            .collect();
        for k in 0..width {
            let pivot = (k..width).find(|row| lines[*row][k] != integer(0))?;
            lines.swap(k, pivot);
            let scale = lines[k][k].clone();
            lines[k].iter_mut().for_each(|entry| *entry = &*entry / &scale);
            let pivot = lines[k].clone();
            for line in lines.iter_mut().enumerate().filter(|(other, _)| *other != k).map(|(_, line)| line) {
                let factor = line[k].clone();
                for (entry, of_pivot) in line.iter_mut().zip(&pivot) {
                    *entry -= &factor * of_pivot;
                }
            }
        }
        let inverse: Vec<Vec<Rational>> = lines.into_iter().map(|line| line[width..].to_vec()).collect();
        let right: Vec<Rational> = (0..width).map(|a| sum(&|row| &self.rows[row][a] * &self.response[row])).collect();
        let coefficients: Vec<Rational> = inverse.iter().map(|line| dot(line, &right)).collect();
        let residual_square = self.left_by(&coefficients);
        Some(Answer { coefficients, inverse, residual_square })
    }
}

impl Answer {
    /// x (X'WX)^-1 x'.
    pub(crate) fn leverage(&self, row: &[Rational]) -> Rational {
        dot(row, &self.inverse.iter().map(|line| dot(line, row)).collect::<Vec<_>>())
    }
}

pub(crate) fn dot(a: &[Rational], b: &[Rational]) -> Rational {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The exact value of a double-double from its public functions: the high part and the remainder.
pub(crate) fn rational(value: Dd) -> Rational {
    let high = value.to_f64();
    exact(high) + exact((value - Dd::from(high)).to_f64())
}

/// Whether two numbers agree within a share of the second one, or of 1 if that is smaller.
pub(crate) fn agree(found: &Rational, expected: &Rational, share: f64) -> bool {
    let scale = expected.to_f64().expect("a number").abs().max(1.0);
    (found - expected).to_f64().expect("a number").abs() <= share * scale
}

/// An integer from -`largest` to `largest`.
pub(crate) fn whole(random: &mut Random, largest: u64) -> f64 {
    random.below(2 * largest + 1) as f64 - largest as f64
}
