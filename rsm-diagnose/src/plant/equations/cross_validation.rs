//! Least squares with cross-validation: the fit to even blocks of time is evaluated on odd blocks, and the reverse.
//!
//! In: columns in blocks (one for each record and equation), and a target. Out: the residual of the columns on the other blocks. Independent of the
//! meaning of a column.

use crate::engine::columns::dot;
use crate::engine::normal::Normal;

/// The number of rows of a block of time: four times the memory of an equation, so that neighbouring blocks are nearly independent.
const BLOCK: usize = 400;

/// A column in blocks; `None` for a block of zeros.
pub type Blocks = Vec<Option<Vec<f64>>>;

/// A column with its zero blocks removed; `None` if all are zero.
#[must_use]
pub fn blocks(column: Vec<Vec<f64>>) -> Option<Blocks> {
    let blocks: Blocks = column.into_iter().map(|block| block.iter().any(|value| *value != 0.0).then_some(block)).collect();
    blocks.iter().any(Option::is_some).then_some(blocks)
}

/// Inner products over the even and over the odd blocks of time.
#[must_use]
pub fn products(a: &Blocks, b: &Blocks) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (a, b) in a.iter().zip(b) {
        let (Some(a), Some(b)) = (a, b) else { continue };
        for (place, (a, b)) in a.chunks(BLOCK).zip(b.chunks(BLOCK)).enumerate() {
            sums[place % 2] += dot(a, b);
        }
    }
    sums
}

/// The prior of a column's factor: its distance from the prior mean in standard deviations; `None` without a prior.
pub type Prior = Option<f64>;

/// The columns that are always present, with the target.
pub struct Base {
    columns: Vec<Blocks>,
    priors: Vec<Prior>,
    target: Blocks,
    /// Inner products among the columns and with the target, for each fold.
    grams: [Vec<f64>; 2],
    rights: [Vec<f64>; 2],
    squares: [f64; 2],
}

/// The effect of further columns.
#[derive(Debug, Clone, PartialEq)]
pub struct FurtherColumns {
    /// The reduction of the squared residual on the other blocks.
    pub gain: f64,
    /// Their factors, fitted to all rows.
    pub factors: Vec<f64>,
}

impl Base {
    /// A base of columns with priors, and the target that they must explain.
    #[must_use]
    pub fn new(columns: Vec<Blocks>, priors: Vec<Prior>, target: Blocks) -> Self {
        let n = columns.len();
        let (mut grams, mut rights) = ([vec![0.0; n * n], vec![0.0; n * n]], [vec![0.0; n], vec![0.0; n]]);
        for i in 0..n {
            for j in 0..=i {
                let both = products(&columns[i], &columns[j]);
                for fold in 0..2 {
                    (grams[fold][i * n + j], grams[fold][j * n + i]) = (both[fold], both[fold]);
                }
            }
            let right = products(&columns[i], &target);
            (rights[0][i], rights[1][i]) = (right[0], right[1]);
        }
        let squares = products(&target, &target);
        Base { columns, priors, target, grams, rights, squares }
    }

    /// The factors of its columns, fitted to all rows.
    #[must_use]
    pub fn factors(&self) -> Vec<f64> {
        factors_of(&self.sums(), &self.priors)
    }

    /// The squared residual of its columns on the other blocks, and the squared target.
    #[must_use]
    pub fn left(&self) -> (f64, f64) {
        let folds = [0, 1].map(|fold| Sums { gram: &self.grams[fold], right: &self.rights[fold], square: self.squares[fold] });
        (cross_validated(&folds, &self.priors), self.squares.iter().sum())
    }

    /// The effect of further columns together with these.
    #[must_use]
    pub fn with_columns(&self, more: &[Blocks]) -> FurtherColumns {
        let (before, n) = (self.columns.len(), self.columns.len() + more.len());
        let mut grams = [vec![0.0; n * n], vec![0.0; n * n]];
        let mut rights = [vec![0.0; n], vec![0.0; n]];
        for fold in 0..2 {
            for i in 0..before {
                let from = &self.grams[fold][i * before..(i + 1) * before];
                grams[fold][i * n..i * n + before].copy_from_slice(from);
            }
            rights[fold][..before].copy_from_slice(&self.rights[fold]);
        }
        for (k, column) in more.iter().enumerate() {
            let others = self.columns.iter().chain(&more[..=k]);
            for (j, other) in others.enumerate() {
                let both = products(column, other);
                for fold in 0..2 {
                    (grams[fold][(before + k) * n + j], grams[fold][j * n + before + k]) = (both[fold], both[fold]);
                }
            }
            let right = products(column, &self.target);
            (rights[0][before + k], rights[1][before + k]) = (right[0], right[1]);
        }
        let priors: Vec<Prior> = self.priors.iter().copied().chain(more.iter().map(|_| None)).collect();
        let folds = [0, 1].map(|fold| Sums { gram: &grams[fold], right: &rights[fold], square: self.squares[fold] });
        let gain = self.left().0 - cross_validated(&folds, &priors);
        let whole = AllRows::of(&folds);
        let factors = factors_of(&whole, &priors)[before..].to_vec();
        FurtherColumns { gain: if gain.is_finite() { gain } else { 0.0 }, factors }
    }

    fn sums(&self) -> AllRows {
        AllRows::of(&[0, 1].map(|fold| Sums { gram: &self.grams[fold], right: &self.rights[fold], square: 0.0 }))
    }
}

/// The normal equations of one fold.
struct Sums<'a> {
    gram: &'a [f64],
    right: &'a [f64],
    square: f64,
}

/// The normal equations of both folds.
struct AllRows {
    gram: Vec<f64>,
    right: Vec<f64>,
}

impl AllRows {
    fn of([a, b]: &[Sums<'_>; 2]) -> Self {
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        AllRows { gram: sum(a.gram, b.gram), right: sum(a.right, b.right) }
    }
}

/// Solves normal equations with priors for the factors.
fn factors_of(sums: &AllRows, priors: &[Prior]) -> Vec<f64> {
    let n = priors.len();
    let (mut gram, mut right) = (sums.gram.clone(), sums.right.clone());
    for (k, prior) in priors.iter().enumerate() {
        if let Some(off) = prior {
            gram[k * n + k] += 1.0;
            right[k] -= off;
        }
    }
    Normal::new(&gram, n, 0.0).solve(&right)
}

/// The squared residual of each fold's factors on the other fold.
fn cross_validated(folds: &[Sums<'_>; 2], priors: &[Prior]) -> f64 {
    let n = priors.len();
    let on = |made: &Sums<'_>, judged: &Sums<'_>| {
        let factors = factors_of(&AllRows { gram: made.gram.to_vec(), right: made.right.to_vec() }, priors);
        let mut left = judged.square;
        for i in 0..n {
            left -= 2.0 * factors[i] * judged.right[i];
            left += factors[i] * dot(&judged.gram[i * n..(i + 1) * n], &factors);
        }
        left
    };
    on(&folds[0], &folds[1]) + on(&folds[1], &folds[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    fn drawn(random: &mut Random, rows: usize) -> Vec<f64> {
        (0..rows).map(|_| random.normal()).collect()
    }

    #[test]
    fn what_holds_on_other_rows_gains_and_what_does_not_loses() {
        let mut random = Random::new(3);
        let (rows, factor) = (4000, 0.5);
        let (cause, other, noise) = (drawn(&mut random, rows), drawn(&mut random, rows), drawn(&mut random, rows));
        let target: Vec<f64> = cause.iter().zip(&noise).map(|(cause, noise)| factor * cause + noise).collect();
        let base = Base::new(Vec::new(), Vec::new(), vec![Some(target), None]);
        let given = base.with_columns(&[vec![Some(cause), None]]);
        // A quarter of 4000 rows, with a standard deviation of 2 factor sqrt(rows).
        assert!((given.gain - 1000.0).abs() < 4.0 * 63.0, "{}", given.gain);
        // 1/sqrt(rows) is a standard deviation.
        assert!((given.factors[0] - factor).abs() < 4.0 / 63.0, "{:?}", given.factors);
        // A column without a part in it loses what its factor takes from noise, about 2, in each fold.
        let given = base.with_columns(&[vec![Some(other), None]]);
        assert!(given.gain < 6.0 && given.gain > -30.0, "{}", given.gain);
        // What acts in the even blocks alone is judged by the odd ones.
        let even = (0..rows).map(|row| if (row / BLOCK).is_multiple_of(2) { noise[row] } else { -noise[row] }).collect();
        assert!(base.with_columns(&[vec![Some(even), None]]).gain < 0.0);
    }

    #[test]
    fn a_column_that_is_there_already_gives_nothing_and_a_prior_holds() {
        let mut random = Random::new(4);
        let cause = drawn(&mut random, 2000);
        let target: Vec<f64> = cause.iter().map(|value| 3.0 * value).collect();
        let column = vec![Some(cause)];
        let free = Base::new(vec![column.clone()], vec![None], vec![Some(target.clone())]);
        assert!((free.factors()[0] - 3.0).abs() < 1e-6 && free.left().0 < 1e-6 * free.left().1);
        assert!(free.with_columns(&[column]).gain.abs() < 1e-3);
        // 0.02 of the column has a square of 0.8: a prior of one standard deviation about 0 holds the factor of 3 of it at 2.4 of 1.8.
        let small: Vec<f64> = (0..2000).map(|row| target[row] / 3.0 * 0.02).collect();
        let square: f64 = small.iter().map(|value| value * value).sum();
        let held = Base::new(vec![vec![Some(small)]], vec![Some(0.0)], vec![Some(target)]);
        let expected = 150.0 * square / (square + 1.0);
        assert!((held.factors()[0] / expected - 1.0).abs() < 1e-6, "{:?}", held.factors());
    }
}
