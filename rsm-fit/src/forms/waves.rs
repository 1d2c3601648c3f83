//! Finds the orders of waves over inputs with a period.
//!
//! In: rows to fit. Out: a surface with waves, or none. Every order up to a limit is tried: cosine and sine together, in addition to the powers of
//! the other inputs and the accepted orders (orthogonal matching pursuit; a Lomb-Scargle periodogram is its first step). The order that reduces the
//! residual most is accepted if it is significant: with pure noise and the same number of orders, the largest reduction is as large in only one of a
//! thousand cases.

use nalgebra::DVector;
use rsm_core::basis::Factor;
use rsm_core::model::{Input, Surface, Wave};

use super::drawn;
use crate::design;
use crate::selection::Sample;

/// The highest order that is tried.
const HIGHEST: u32 = 200;

/// The largest number of accepted orders. Each costs two terms and up to a dozen operations.
const MOST: usize = 6;

/// With more rows, a random sample is used: more rows cost time and hardly improve the orders.
const MOST_ROWS: usize = 6000;

/// The number of rows for each order; two rows per period are needed to exclude aliases.
const ROWS_PER_ORDER: usize = 4;

/// The highest power of other inputs in the search.
const HIGHEST_OTHER_POWER: u32 = 2;

pub(super) struct Search<'a> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    pub periods: &'a [Option<f64>],
    pub highest: u32,
}

impl Search<'_> {
    /// The surface with the significant waves; `None` if there is none.
    pub(super) fn run(&self, sample: &Sample) -> Option<Surface> {
        let (picked, roots, mut rest) = drawn(sample, MOST_ROWS);
        let count = picked.len();
        // Powers of the inputs that are not periodic.
        let factors = Factor::all(self.surface, self.inputs);
        let is_periodic = |factor: &Factor| self.periods[factor.input].is_some();
        let mut terms = design::terms_up_to(self.surface, self.highest.min(HIGHEST_OTHER_POWER));
        terms.retain(|powers| factors.iter().zip(powers).all(|(factor, power)| *power == 0 || !is_periodic(factor)));
        let column = |powers: &Vec<u32>| -> DVector<f64> {
            let value = |(row, root): (&usize, &f64)| {
                let of =
                    |(factor, power): (&Factor, &u32)| factor.value(sample.columns[factor.input][*row]).powi(*power as i32);
                root * factors.iter().zip(powers).filter(|(_, power)| **power > 0).map(of).product::<f64>()
            };
            DVector::from_iterator(count, picked.iter().zip(&roots).map(value))
        };
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for powers in &terms {
            take(&mut basis, &mut rest, column(powers));
        }
        let limit = HIGHEST.min(u32::try_from(count / ROWS_PER_ORDER).unwrap_or(HIGHEST));
        let mut candidates: Vec<(Wave, [DVector<f64>; 2])> = Vec::new();
        for (k, (input, period)) in self.inputs.iter().zip(self.periods).enumerate() {
            let Some(period) = *period else { continue };
            let middle = input.range[0] / 2.0 + input.range[1] / 2.0;
            for order in 1..=limit {
                let angle = |row: usize| std::f64::consts::TAU * f64::from(order) * (sample.columns[k][row] - middle) / period;
                let of = |function: fn(f64) -> f64| {
                    DVector::from_iterator(count, picked.iter().zip(&roots).map(|(row, root)| root * function(angle(*row))))
                };
                candidates.push((Wave { input: input.name.clone(), period, order }, [of(f64::cos), of(f64::sin)]));
            }
        }
        let mut waves = Vec::new();
        while waves.len() < MOST && !candidates.is_empty() {
            let taken = |columns: &[DVector<f64>; 2]| -> f64 {
                let mut own: Vec<DVector<f64>> = Vec::new();
                for column in columns {
                    let mut free = column.clone();
                    basis.iter().chain(&own).for_each(|known| free.axpy(-known.dot(column), known, 1.0));
                    let norm = free.norm();
                    if norm > 1e-6 * column.norm() {
                        own.push(free / norm);
                    }
                }
                own.iter().map(|direction| direction.dot(&rest).powi(2)).sum()
            };
            let gains: Vec<f64> = candidates.iter().map(|(_, columns)| taken(columns)).collect();
            let best = (0..gains.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b]))?;
            let freedom = count.saturating_sub(basis.len() + 2);
            let noise = (rest.norm_squared() - gains[best]).max(0.0) / freedom.max(1) as f64;
            // Each order has twice an exponential variable; the largest of N exceeds 2 (ln N + 6.9) once in a thousand cases.
            let threshold = 2.0 * ((candidates.len() as f64).ln() + 6.9) * noise;
            if freedom == 0 || gains[best].is_nan() || gains[best] <= threshold {
                break;
            }
            let (wave, columns) = candidates.swap_remove(best);
            for column in columns {
                take(&mut basis, &mut rest, column);
            }
            waves.push(wave);
        }
        if waves.is_empty() {
            return None;
        }
        waves.sort_by(|a, b| a.input.cmp(&b.input).then(a.order.cmp(&b.order)));
        Some(Surface { waves, ..self.surface.clone() })
    }
}

/// Adds a column to the orthonormal basis, and projects the residual. Orthogonalised twice, for accuracy to rounding.
fn take(basis: &mut Vec<DVector<f64>>, rest: &mut DVector<f64>, mut column: DVector<f64>) {
    let before = column.norm();
    for _ in 0..2 {
        let shares: Vec<f64> = basis.iter().map(|known| known.dot(&column)).collect();
        basis.iter().zip(shares).for_each(|(known, share)| column.axpy(-share, known, 1.0));
    }
    let norm = column.norm();
    if norm <= 1e-9 * before {
        return;
    }
    column /= norm;
    let share = column.dot(rest);
    rest.axpy(-share, &column, 1.0);
    basis.push(column);
}
