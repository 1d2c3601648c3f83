//! Linear systems, solved symbolically.
//!
//! Where it is safe, pivots are chosen at compile time: entries of constants and parameters that are not small relative to their row near the start;
//! among these, the entry whose elimination creates the fewest new entries (H. M. Markowitz, 1957). If every remaining entry may vanish during a
//! simulation (because it depends on states or on a switch), the program compares the rows of a column and uses the one with the largest entry as the
//! pivot, without a branch.

use crate::expression::{Binary, Id, Pool, Unary};

use super::work::Work;

/// An entry below this share of the largest of its row is not a safe pivot.
const SMALLEST: f64 = 1e-3;

#[derive(Debug, Clone)]
struct Row {
    entries: Vec<Option<Id>>,
    right: Id,
}

impl Work {
    /// Solves `rows` times x = `right`; `None` where the matrix is singular near the start.
    pub(super) fn solve_linear(&mut self, rows: Vec<Vec<Id>>, right: Vec<Id>) -> Option<Vec<Id>> {
        let count = rows.len();
        let zero = self.flat.pool.number(0.0);
        let mut rows: Vec<Row> = rows
            .into_iter()
            .zip(right)
            .map(|(entries, right)| Row {
                entries: entries.into_iter().map(|entry| (entry != zero).then_some(entry)).collect(),
                right,
            })
            .collect();
        let mut open_columns: Vec<usize> = (0..count).collect();
        // Rows in the order of elimination, each with the column of its unknown.
        let mut done: Vec<(usize, Row)> = Vec::new();
        while !rows.is_empty() {
            let (row, column) = match self.safe_pivot(&rows, &open_columns) {
                Some(pivot) => pivot,
                None => self.compared_pivot(&mut rows, &open_columns)?,
            };
            let pivot_row = rows.swap_remove(row);
            let pivot = pivot_row.entries[column]?;
            for other in &mut rows {
                let Some(entry) = other.entries[column] else { continue };
                let pool = &mut self.flat.pool;
                let factor = pool.divide(entry, pivot);
                for (k, above) in pivot_row.entries.iter().enumerate() {
                    let Some(above) = above.filter(|_| k != column) else { continue };
                    let product = pool.multiply(factor, above);
                    let value = match other.entries[k] {
                        Some(value) => pool.subtract(value, product),
                        None => pool.negate(product),
                    };
                    other.entries[k] = (value != zero).then_some(value);
                }
                other.entries[column] = None;
                let product = pool.multiply(factor, pivot_row.right);
                other.right = pool.subtract(other.right, product);
            }
            open_columns.retain(|open| *open != column);
            done.push((column, pivot_row));
        }
        let mut solution: Vec<Option<Id>> = vec![None; count];
        for (column, row) in done.into_iter().rev() {
            let pool = &mut self.flat.pool;
            let mut rest = row.right;
            for (k, entry) in row.entries.iter().enumerate() {
                let Some(entry) = entry.filter(|_| k != column) else { continue };
                let product = pool.multiply(entry, solution[k]?);
                rest = pool.subtract(rest, product);
            }
            solution[column] = Some(pool.divide(rest, row.entries[column]?));
        }
        solution.into_iter().collect()
    }

    /// The safe pivot that creates the fewest new entries.
    fn safe_pivot(&mut self, rows: &[Row], columns: &[usize]) -> Option<(usize, usize)> {
        let in_column = |column: usize| rows.iter().filter(|row| row.entries[column].is_some()).count();
        let mut best: Option<((usize, usize), usize, usize)> = None;
        for (r, row) in rows.iter().enumerate() {
            let in_row = columns.iter().filter(|column| row.entries[**column].is_some()).count();
            let mut largest = 0.0_f64;
            let mut candidates = Vec::new();
            for column in columns {
                let Some(entry) = row.entries[*column] else { continue };
                let value = self.at_point(entry).abs();
                largest = largest.max(value);
                if self.is_constant(entry) {
                    candidates.push((*column, entry, value));
                }
            }
            for (column, entry, value) in candidates {
                if value.is_nan() || value <= SMALLEST * largest {
                    continue;
                }
                let fill = (in_row - 1) * (in_column(column) - 1);
                // Among equals, a constant is preferred to a parameter, because it cannot change.
                let key = (fill, usize::from(self.flat.pool.value(entry).is_none()));
                if best.is_none_or(|(known, ..)| key < known) {
                    best = Some((key, r, column));
                }
            }
        }
        best.map(|(_, row, column)| (row, column))
    }

    /// Moves the largest entry of a column into one row, by comparisons in the program.
    fn compared_pivot(&mut self, rows: &mut [Row], columns: &[usize]) -> Option<(usize, usize)> {
        let column = columns
            .iter()
            .copied()
            .filter(|column| rows.iter().any(|row| row.entries[*column].is_some()))
            .min_by_key(|column| rows.iter().filter(|row| row.entries[*column].is_some()).count())?;
        let candidates: Vec<usize> = (0..rows.len()).filter(|row| rows[*row].entries[column].is_some()).collect();
        let (first, others) = candidates.split_first()?;
        let zero = self.flat.pool.number(0.0);
        for other in others {
            let pool = &mut self.flat.pool;
            let (a, b) = (rows[*first].entries[column]?, rows[*other].entries[column]?);
            let (size_a, size_b) = (pool.unary(Unary::Absolute, a), pool.unary(Unary::Absolute, b));
            let swaps = pool.binary(Binary::LessNow, size_a, size_b);
            let width = rows[*first].entries.len();
            for k in 0..width {
                let (x, y) = (rows[*first].entries[k], rows[*other].entries[k]);
                if x.is_none() && y.is_none() {
                    continue;
                }
                let (upper, lower) = swapped(pool, swaps, x.unwrap_or(zero), y.unwrap_or(zero));
                rows[*first].entries[k] = (upper != zero).then_some(upper);
                rows[*other].entries[k] = (lower != zero).then_some(lower);
            }
            let (upper, lower) = swapped(pool, swaps, rows[*first].right, rows[*other].right);
            rows[*first].right = upper;
            rows[*other].right = lower;
        }
        Some((*first, column))
    }
}

fn swapped(pool: &mut Pool, swaps: Id, a: Id, b: Id) -> (Id, Id) {
    (pool.choose(swaps, b, a), pool.choose(swaps, a, b))
}
