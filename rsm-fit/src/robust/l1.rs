//! Least absolute errors, exactly: a simplex search over surfaces through p rows.
//!
//! In: rows, the least-squares fit as the start. Out: a [`Robust`]. An optimum passes through p rows with independent terms. At such a surface every
//! other row pulls with the sign of its error, and multipliers d of the p rows balance these pulls: sum sign_i x_i + sum d_j x_j = 0. If no |d_j| is
//! above 1, the zero vector is a subgradient and the surface is optimal. Otherwise the row with the largest |d_j| is released, and the search goes
//! along the edge to the lowest point, which is a weighted median. All of it in double-double, so the condition is checked to 10^-20.
//!
//! Sources: Barrodale, Roberts 1973, An improved algorithm for discrete l1 linear approximation; Bloomfield, Steiger 1983, Least Absolute Deviations.

use super::{Robust, Rows, product, scale_of};
use crate::dd::Dd;
use crate::qr::Growing;
use crate::random::Random;
use rsm_core::order;

/// Each response is moved by up to this share of the largest one, so that no surface passes through more than p rows and the search cannot circle.
/// 10^-22 is above the rounding of double-double (10^-30 with the condition of usual designs) and below that of f64 data.
const MOVED: f64 = 1e-22;

/// A multiplier may exceed 1 by this: rounding of sums in double-double.
const OPTIMAL: f64 = 1e-18;

/// A multiplier within this of 1 belongs to an edge along which the sum stays equal.
const FLAT: f64 = 1e-12;

/// The largest number of edges for a row. Known data need fewer than one.
const MOST_EDGES: usize = 20;

/// The least part of a row's terms that is independent of the rows before, in the choice of the first rows; the next value if too few are left.
const INDEPENDENT: [f64; 4] = [1e-2, 1e-5, 1e-9, 1e-14];

pub(super) fn fit(rows: &Rows<'_>, start: &Growing) -> Robust {
    let count = rows.count();
    let least: Vec<f64> = rows.errors(&start.coefficients()).into_iter().map(Dd::to_f64).collect();
    let (x, y): (Vec<Vec<Dd>>, Vec<Dd>) = (0..count).map(|row| rows.row(row)).unzip();
    let largest = y.iter().map(|y| y.abs().to_f64()).fold(0.0, f64::max);
    let mut random = Random::new(1);
    let moved: Vec<Dd> = y.iter().map(|y| *y + Dd::from(MOVED * largest * (0.5 + random.share()))).collect();
    let mut basis = first_rows(&x, &least);
    let (mut iterations, mut has_converged, mut is_unique) = (0, false, false);
    let mut coefficients = start.coefficients();
    while let Some(inverse) = inverse(basis.iter().map(|row| x[*row].clone()).collect()) {
        let through = |y: &[Dd]| -> Vec<Dd> {
            inverse.iter().map(|line| line.iter().zip(&basis).map(|(a, row)| *a * y[*row]).sum()).collect()
        };
        coefficients = through(&y);
        let now = through(&moved);
        let errors: Vec<Dd> = (0..count).map(|row| moved[row] - product(&x[row], &now)).collect();
        let mut is_basic = vec![false; count];
        basis.iter().for_each(|row| is_basic[*row] = true);
        let mut pull = vec![Dd::ZERO; basis.len()];
        for row in (0..count).filter(|row| !is_basic[*row]) {
            for (sum, x) in pull.iter_mut().zip(&x[row]) {
                *sum += if errors[row] > Dd::ZERO { *x } else { -*x };
            }
        }
        // d_j = -sum_k pull_k inverse_kj.
        let multiplier = |j: usize| -(0..basis.len()).map(|k| pull[k] * inverse[k][j]).sum::<Dd>();
        let multipliers: Vec<Dd> = (0..basis.len()).map(multiplier).collect();
        let size = |j: &usize| multipliers[*j].abs().to_f64();
        let Some(leaving) = (0..basis.len()).max_by(|a, b| size(a).total_cmp(&size(b))) else { break };
        let worst = multipliers[leaving];
        if (worst.abs() - Dd::ONE).to_f64() <= OPTIMAL {
            has_converged = true;
            is_unique = worst.abs().to_f64() < 1.0 - FLAT;
            break;
        }
        if iterations >= MOST_EDGES * (count + 10) {
            break;
        }
        iterations += 1;
        let side = if worst > Dd::ZERO { Dd::ONE } else { -Dd::ONE };
        // Along a direction with x_j . direction = c, c = 1 or -1, the slope of the sum is 1 + c d_j: below 0 for the sign against d_j.
        let direction: Vec<Dd> = inverse.iter().map(|line| line[leaving] * -side).collect();
        let step = |row: usize| {
            let rate = product(&x[row], &direction);
            let at = errors[row] / rate;
            (at > Dd::ZERO && at.is_finite()).then(|| (at, rate.abs().to_f64(), row))
        };
        let mut crossed: Vec<(Dd, f64, usize)> = (0..count).filter(|row| !is_basic[*row]).filter_map(step).collect();
        crossed.sort_by(|a, b| a.0.partial_cmp(&b.0).expect("no step is NaN"));
        let mut slope = (Dd::ONE - worst.abs()).to_f64();
        let entering = crossed.iter().find(|(_, rate, _)| {
            slope += 2.0 * rate;
            slope >= 0.0
        });
        let Some((_, _, entering)) = entering else { break };
        basis[leaving] = *entering;
    }
    let errors: Vec<f64> = rows.errors(&coefficients).into_iter().map(Dd::to_f64).collect();
    let scale = scale_of(&errors);
    let is_unique = Some(is_unique);
    Robust { coefficients, errors, scale, iterations, has_converged, is_unique, standard_errors: Vec::new() }
}

/// As many rows as there are terms, with independent terms, of those with the smallest errors.
fn first_rows(x: &[Vec<Dd>], errors: &[f64]) -> Vec<usize> {
    let width = x.first().map_or(0, Vec::len);
    let mut order: Vec<usize> = (0..x.len()).collect();
    order::ascending(&mut order, |it| errors[*it].abs());
    let mut chosen: Vec<usize> = Vec::new();
    let mut directions: Vec<Vec<Dd>> = Vec::new();
    for least in INDEPENDENT {
        for row in &order {
            if chosen.len() == width {
                return chosen;
            }
            if chosen.contains(row) {
                continue;
            }
            let mut rest = x[*row].clone();
            // Twice, because one pass leaves rounding of the size of what it removes.
            for direction in directions.iter().chain(&directions) {
                let share = product(&rest, direction);
                rest.iter_mut().zip(direction).for_each(|(rest, x)| *rest -= share * *x);
            }
            let (norm, left) = (product(&x[*row], &x[*row]).sqrt(), product(&rest, &rest).sqrt());
            if left.to_f64() > least * norm.to_f64() {
                directions.push(rest.into_iter().map(|rest| rest / left).collect());
                chosen.push(*row);
            }
        }
    }
    chosen
}

/// The inverse of a square matrix by elimination with row exchanges; `None` if it is singular.
fn inverse(mut a: Vec<Vec<Dd>>) -> Option<Vec<Vec<Dd>>> {
    let size = a.len();
    if a.iter().any(|line| line.len() != size) {
        return None;
    }
    let unit = |k: usize| (0..size).map(move |j| if j == k { Dd::ONE } else { Dd::ZERO });
    a.iter_mut().enumerate().for_each(|(k, line)| line.extend(unit(k)));
    for k in 0..size {
        let pivot = (k..size).max_by(|i, j| a[*i][k].abs().to_f64().total_cmp(&a[*j][k].abs().to_f64()))?;
        a.swap(k, pivot);
        let own = a[k].clone();
        if own[k] == Dd::ZERO {
            return None;
        }
        for line in a.iter_mut().enumerate().filter(|(i, _)| *i != k).map(|(_, line)| line) {
            let share = line[k] / own[k];
            line.iter_mut().zip(&own).for_each(|(entry, own)| *entry -= share * *own);
        }
        a[k].iter_mut().for_each(|entry| *entry = *entry / own[k]);
    }
    Some(a.into_iter().map(|line| line[size..].to_vec()).collect())
}
