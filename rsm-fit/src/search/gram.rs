//! Sums of products of candidates and response, and the sweep operator that adds candidates to a least-squares fit and removes them.
//!
//! In: rows of a sample. Out: [`Gram`]: X'X of all candidates and the response in f64. Columns are centred and scaled once for all rows; matrices of
//! parts of the rows can be added and subtracted. [`Swept`]: the same matrix with some candidates fitted. Only the choice of terms uses it; the
//! coefficients of the model are computed again in double-double. A candidate counts as linearly dependent on the others if its orthogonal component
//! is below 1e-5 of its norm: sums of products in f64 do not resolve less.
//!
//! Source: Goodnight 1979, A tutorial on the SWEEP operator.

use crate::dd::Dd;
use crate::design::Design;
use crate::qr::Triangle;
use crate::selection::Sample;
use crate::statistics::Observations;

/// The smallest orthogonal component of a candidate, as a share of its square: 1e-5 of the norm. Sums of products have errors of 1e-16 of the square,
/// and the margin of 10^6 covers sums over some thousand rows and previous sweeps.
const OWN: f64 = 1e-10;

/// The centring and scaling of columns: z = (x - middle)/scale. The response is the last.
#[derive(Debug, Clone)]
pub(super) struct Scales {
    pub middles: Vec<f64>,
    pub scales: Vec<f64>,
    /// The candidate that is the constant, if there is one. It is neither centred nor scaled.
    pub constant: Option<usize>,
}

impl Scales {
    /// The scales from all rows that will be summed.
    pub(super) fn of(design: &Design, sample: &Sample, constant: Option<usize>) -> Self {
        let width = design.width();
        let (mut sums, mut squares, mut weight) = (vec![0.0; width + 1], vec![0.0; width + 1], 0.0);
        // Relative to the first row, because sums of squares of values far from 0 would lose accuracy.
        let mut first: Vec<f64> = Vec::new();
        rows_of(design, sample, true, |row, w| {
            if first.is_empty() {
                first = row.to_vec();
            }
            weight += w;
            for (k, (x, from)) in row.iter().zip(&first).enumerate() {
                sums[k] += w * (x - from);
                squares[k] += w * (x - from) * (x - from);
            }
        });
        let (mut middles, mut scales) = (vec![0.0; width + 1], vec![1.0; width + 1]);
        for k in 0..=width {
            if Some(k) == constant || first.is_empty() {
                continue;
            }
            let mean = sums[k] / weight;
            let middle = if constant.is_some() { first[k] + mean } else { 0.0 };
            let about_first = squares[k] / weight - mean * mean;
            let square = if constant.is_some() { about_first } else { about_first + (first[k] + mean).powi(2) };
            middles[k] = middle;
            scales[k] = if square > 0.0 { square.sqrt() } else { 1.0 };
        }
        Scales { middles, scales, constant }
    }

    /// The scales from the triangle of all rows: an orthogonal transformation keeps the products of columns.
    pub(super) fn of_triangle(triangle: &Triangle, constant: Option<usize>) -> Self {
        let columns = triangle.columns();
        let ones = constant.map(|constant| &columns[constant]);
        let weight = ones.map_or(Dd::from(triangle.rows() as f64), |ones| product(ones, ones));
        let (mut middles, mut scales) = (vec![0.0; columns.len()], vec![1.0; columns.len()]);
        for (k, column) in columns.iter().enumerate().filter(|(k, _)| Some(*k) != constant) {
            middles[k] = ones.map_or(0.0, |ones| (product(ones, column) / weight).to_f64());
            let own = about(column, middles[k], ones);
            let square = (product(&own, &own) / weight).to_f64();
            scales[k] = if square > 0.0 { square.sqrt() } else { 1.0 };
        }
        Scales { middles, scales, constant }
    }

    /// Coefficients of unscaled columns from those of scaled ones. Zeros are left out of `terms` and `coefficients`.
    pub(super) fn natural(&self, terms: &[usize], coefficients: &[f64]) -> Vec<f64> {
        let response = self.middles.len() - 1;
        let of = |(term, b): (&usize, &f64)| b * self.scales[response] / self.scales[*term];
        let mut natural: Vec<f64> = terms.iter().zip(coefficients).map(of).collect();
        if let Some(place) = terms.iter().position(|term| Some(*term) == self.constant) {
            let moved: f64 = terms
                .iter()
                .zip(&natural)
                .enumerate()
                .filter(|(k, _)| *k != place)
                .map(|(_, (t, b))| b * self.middles[*t])
                .sum();
            natural[place] = self.middles[response] + natural[place] - moved;
        }
        natural
    }
}

fn product(one: &[Dd], other: &[Dd]) -> Dd {
    one.iter().zip(other).map(|(x, y)| *x * *y).sum()
}

/// A column less a multiple of the constant.
fn about(column: &[Dd], middle: f64, ones: Option<&Vec<Dd>>) -> Vec<Dd> {
    match ones {
        Some(ones) => column.iter().zip(ones).map(|(x, one)| *x - Dd::from(middle) * *one).collect(),
        None => column.to_vec(),
    }
}

/// Calls `act` with every row of candidates and response, and its weight.
fn rows_of(design: &Design, sample: &Sample, as_measured: bool, mut act: impl FnMut(&[f64], f64)) {
    sample.observed(|rows: Observations<'_>| {
        let mut values = Vec::with_capacity(design.width() + 1);
        for row in 0..rows.response.len() {
            let point = rows.point(row);
            let terms = if as_measured { design.row_as_measured(&point) } else { design.row(&point) };
            values.clear();
            values.extend(terms.iter().map(|x| x.to_f64()));
            values.push(rows.response[row]);
            act(&values, rows.weight(row).to_f64());
        }
    });
}

/// Every row, scaled, multiplied by the square root of its weight.
pub(super) fn scaled_rows(design: &Design, sample: &Sample, scales: &Scales) -> Vec<Vec<f64>> {
    let mut all = Vec::with_capacity(sample.rows());
    rows_of(design, sample, true, |row, weight| {
        let scaled = row.iter().enumerate().map(|(k, x)| weight.sqrt() * (x - scales.middles[k]) / scales.scales[k]);
        all.push(scaled.collect());
    });
    all
}

/// sum w z z' of the rows.
#[derive(Debug, Clone)]
pub(super) struct Gram {
    /// Candidates and, last, the response.
    pub width: usize,
    pub sums: Vec<f64>,
    pub rows: usize,
    pub weight: f64,
}

impl Gram {
    pub(super) fn nothing(width: usize) -> Self {
        Gram { width, sums: vec![0.0; width * width], rows: 0, weight: 0.0 }
    }

    /// `as_measured`: points as measured; otherwise clamped as by an evaluator.
    pub(super) fn of(design: &Design, sample: &Sample, scales: &Scales, as_measured: bool) -> Self {
        let width = design.width() + 1;
        let mut gram = Gram::nothing(width);
        let mut z = vec![0.0; width];
        rows_of(design, sample, as_measured, |row, weight| {
            for (k, (z, x)) in z.iter_mut().zip(row).enumerate() {
                *z = (x - scales.middles[k]) / scales.scales[k];
            }
            for (k, own) in z.iter().enumerate() {
                let own = own * weight;
                // The upper triangle; the lower one is filled in below.
                for (sum, other) in gram.sums[k * width + k..(k + 1) * width].iter_mut().zip(&z[k..]) {
                    *sum += own * other;
                }
            }
            gram.rows += 1;
            gram.weight += weight;
        });
        for k in 0..width {
            for other in 0..k {
                gram.sums[k * width + other] = gram.sums[other * width + k];
            }
        }
        gram
    }

    /// The same from the triangle of all rows.
    pub(super) fn of_triangle(triangle: &Triangle, scales: &Scales) -> Self {
        let columns = triangle.columns();
        let ones = scales.constant.map(|constant| &columns[constant]);
        let own = |(k, column): (usize, &Vec<Dd>)| -> Vec<Dd> {
            let scale = Dd::from(scales.scales[k]);
            about(column, scales.middles[k], ones).into_iter().map(|x| x / scale).collect()
        };
        let own: Vec<Vec<Dd>> = columns.iter().enumerate().map(own).collect();
        let mut gram = Gram::nothing(own.len());
        for (row, one) in own.iter().enumerate() {
            for (column, other) in own.iter().enumerate() {
                gram.sums[row * gram.width + column] = product(one, other).to_f64();
            }
        }
        gram.rows = triangle.rows();
        gram.weight = ones.map_or(gram.rows as f64, |ones| product(ones, ones).to_f64());
        gram
    }

    pub(super) fn and(mut self, other: &Gram) -> Self {
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, more)| *sum += more);
        Gram { rows: self.rows + other.rows, weight: self.weight + other.weight, ..self }
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f64 {
        self.sums[row * self.width + column]
    }

    /// sum w (y - z b)^2 for some candidates; at least 0.
    pub(super) fn square(&self, terms: &[usize], coefficients: &[f64]) -> f64 {
        let response = self.width - 1;
        let mut square = self.at(response, response);
        for (term, b) in terms.iter().zip(coefficients) {
            let row = &self.sums[term * self.width..(term + 1) * self.width];
            let inner: f64 = terms.iter().zip(coefficients).map(|(other, b)| row[*other] * b).sum();
            square += b * (inner - 2.0 * row[response]);
        }
        square.max(0.0)
    }
}

/// A Gram matrix with some candidates swept in. For a set A: G_AA^-1, G_AA^-1 G_AB, -G_BA G_AA^-1, and the Schur complement of G_BB.
#[derive(Debug, Clone)]
pub(super) struct Swept {
    pub width: usize,
    pub entries: Vec<f64>,
    pub is_in: Vec<bool>,
    squares: Vec<f64>,
}

impl Swept {
    pub(super) fn new(gram: &Gram) -> Self {
        let squares = (0..gram.width).map(|k| gram.at(k, k)).collect();
        Swept { width: gram.width, entries: gram.sums.clone(), is_in: vec![false; gram.width - 1], squares }
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f64 {
        self.entries[row * self.width + column]
    }

    /// Whether a candidate that is not fitted is linearly independent of the fitted ones.
    pub(super) fn has_own_part(&self, candidate: usize) -> bool {
        self.at(candidate, candidate) > OWN * self.squares[candidate]
    }

    /// Adds a candidate to the fit, or removes it.
    pub(super) fn sweep(&mut self, pivot: usize) {
        let width = self.width;
        let own: Vec<f64> = self.entries[pivot * width..(pivot + 1) * width].to_vec();
        let inverse = 1.0 / own[pivot];
        for row in 0..width {
            if row == pivot {
                continue;
            }
            let entries = &mut self.entries[row * width..(row + 1) * width];
            let share = entries[pivot] * inverse;
            if share != 0.0 {
                for (entry, x) in entries.iter_mut().zip(&own) {
                    *entry -= share * x;
                }
            }
            entries[pivot] = -share;
        }
        let entries = &mut self.entries[pivot * width..(pivot + 1) * width];
        entries.iter_mut().for_each(|entry| *entry *= inverse);
        entries[pivot] = inverse;
        self.is_in[pivot] = !self.is_in[pivot];
    }

    /// The residual sum of squares of the response.
    pub(super) fn left(&self) -> f64 {
        self.at(self.width - 1, self.width - 1).max(0.0)
    }

    /// Its reduction by adding a candidate.
    pub(super) fn gain(&self, candidate: usize) -> f64 {
        let product = self.at(candidate, self.width - 1);
        product * product / self.at(candidate, candidate)
    }

    /// Its increase by removing a fitted candidate.
    pub(super) fn loss(&self, candidate: usize) -> f64 {
        let b = self.at(candidate, self.width - 1);
        b * b / self.at(candidate, candidate)
    }

    /// The fitted candidates by number.
    pub(super) fn terms(&self) -> Vec<usize> {
        (0..self.width - 1).filter(|k| self.is_in[*k]).collect()
    }

    /// Their coefficients.
    pub(super) fn coefficients(&self, terms: &[usize]) -> Vec<f64> {
        terms.iter().map(|term| self.at(*term, self.width - 1)).collect()
    }
}
