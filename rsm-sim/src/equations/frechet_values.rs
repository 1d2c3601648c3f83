//! The values from which [`super::frechet`] computes derivatives: what no direction changes.
//!
//! In: a chain of a matrix A over a span, and levels. Out: [`Shared`]: A as a sparse matrix; the powers and sums of the series at its last level;
//! phi_1 with its square, and columns of phi_2, at the levels above. Also the lengths of columns that code is written for.

use super::part::MOST_STATES;
use super::phi::{Chain, WEIGHTS, stride, times};
use crate::code::{Work, vectorised};

/// The largest norm for which the series is used. Five blocks of four terms reach to 1.41 (see [`OMITTED`]). A sixth block, which would reach to 2.3,
/// costs as much as the doubling that it replaces.
const SMALL: f64 = 1.4;

/// The relative size below which the first omitted term of the derivative of phi_3 changes nothing: a sixteenth of the rounding of f64.
const OMITTED: f64 = f64::EPSILON / 16.0;

/// The powers of z in a block of the series.
pub(super) const POWERS: usize = 4;

/// The lengths of columns that code is written for: of derivatives, and of values, which fill complete registers. Each number of a column of
/// derivatives is a register of its own, so its length need not be a multiple of four. The compiler takes half a second for a short length and 2 s
/// for a long one.
const WIDTHS: [usize; 7] = [4, 5, 6, 7, 8, 12, MOST_STATES];

/// The constant length for columns of derivatives of `n` numbers.
pub(super) fn width(n: usize) -> usize {
    WIDTHS.into_iter().find(|width| n <= *width).unwrap_or(MOST_STATES)
}

/// Runs code written for columns of constant lengths.
macro_rules! by_width {
    ($states:expr, $length:ident, $whole:ident => $run:expr) => {
        match $crate::equations::frechet_values::width($states) {
            4 => by_width!(4, 4, $length, $whole, $run),
            5 => by_width!(5, 8, $length, $whole, $run),
            6 => by_width!(6, 8, $length, $whole, $run),
            7 => by_width!(7, 8, $length, $whole, $run),
            8 => by_width!(8, 8, $length, $whole, $run),
            12 => by_width!(12, 12, $length, $whole, $run),
            _ => by_width!(24, 24, $length, $whole, $run),
        }
    };
    ($value:literal, $filled:literal, $length:ident, $whole:ident, $run:expr) => {{
        #[allow(dead_code, reason = "values alone need no length of derivatives")]
        const $length: usize = $value;
        const $whole: usize = $filled;
        $run
    }};
}
pub(super) use by_width;

/// Entries of a sparse matrix, column by column: each with its row.
#[derive(Debug, Clone, Default)]
pub(super) struct Sparse<T> {
    /// For each column, the end of its entries.
    pub ends: Vec<usize>,
    pub entries: Vec<(usize, T)>,
}

impl<T: Copy> Sparse<T> {
    pub(super) fn clear(&mut self) {
        self.ends.clear();
        self.entries.clear();
    }

    #[inline(always)]
    pub(super) fn column(&self, j: usize) -> &[(usize, T)] {
        &self.entries[if j == 0 { 0 } else { self.ends[j - 1] }..self.ends[j]]
    }
}

/// What all directions share.
#[derive(Debug, Clone, Default)]
pub(super) struct Shared {
    pub n: usize,
    span: f64,
    pub level: usize,
    /// The level of half the length, or `level` if half is not asked for.
    pub half_level: usize,
    /// The level whose series is differentiated.
    pub base: usize,
    pub columns: Vec<usize>,
    pub a: Sparse<f64>,
    /// z to z^4 at the base.
    pub powers: Vec<f64>,
    /// The sums that the rule of Horner multiplies by z^4, then phi_3 and phi_2.
    pub sums: Vec<f64>,
    /// For each level after `level` up to the base: phi_1 and its square.
    pub levels: Vec<f64>,
    /// For each of these levels: the columns of phi_2.
    pub levels_of_two: Vec<f64>,
}

impl Shared {
    /// Prepares the derivatives of the functions of a chain. `jacobian`: A, column by column. `half_level`: the level after `level`, or `level`
    /// again. `columns`: the columns of phi_2 and phi_3. The chain must have computed these columns and all levels from `level` on.
    pub(super) fn prepare(
        &mut self,
        (n, jacobian, span): (usize, &[f64], f64),
        chain: &Chain,
        (half_level, level): (usize, usize),
        columns: &[usize],
    ) {
        (self.n, self.span, self.half_level, self.level) = (n, span, half_level, level);
        self.base = chain.base();
        while self.base > half_level && chain.norm(self.base - 1) <= SMALL {
            self.base -= 1;
        }
        self.base = self.base.max(half_level);
        self.columns.clear();
        self.columns.extend_from_slice(columns);
        self.a.clear();
        for column in jacobian.chunks(stride(n)).take(n) {
            self.a.entries.extend(column.iter().copied().enumerate().filter(|it| it.1 != 0.0));
            self.a.ends.push(self.a.entries.len());
        }
        by_width!(n, S, T => vectorised(Prepare::<T> { shared: self, chain }));
    }

    /// The factor of A at a level.
    pub(super) fn share(&self, level: usize) -> f64 {
        self.span * 0.5_f64.powi(level as i32)
    }
}

struct Prepare<'a, const T: usize> {
    shared: &'a mut Shared,
    chain: &'a Chain,
}

impl<const T: usize> Work for Prepare<'_, T> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Prepare { shared, chain } = self;
        let (n, base) = (shared.n, shared.base);
        let factor = shared.share(base);
        let blocks = blocks(chain.norm(base));
        let powers = cleared::<T>(&mut shared.powers, POWERS * n);
        for (j, column) in powers[..n].iter_mut().enumerate() {
            shared.a.column(j).iter().for_each(|(k, value)| column[*k] = factor * value);
        }
        for power in 1..POWERS {
            let (before, next) = powers[(power - 1) * n..].split_at_mut(n);
            times_sparse(&mut next[..n], before, (&shared.a, factor), 0.0);
        }
        let sums = cleared::<T>(&mut shared.sums, (blocks + 1) * n);
        for (step, block) in (0..blocks).rev().enumerate() {
            let (before, next) = sums[step.saturating_sub(1) * n..].split_at_mut(if step == 0 { 0 } else { n });
            for (j, next) in next[..n].iter_mut().enumerate() {
                let mut sum = if step == 0 { [0.0; T] } else { times(before, &powers[(POWERS - 1) * n + j]) };
                (1..POWERS).for_each(|k| add(&mut sum, WEIGHTS[POWERS * block + k], &powers[(k - 1) * n + j]));
                sum[j] += WEIGHTS[POWERS * block];
                *next = sum;
            }
        }
        let (before, next) = sums[(blocks - 1) * n..].split_at_mut(n);
        times_sparse(next, before, (&shared.a, factor), 0.5);
        let count = shared.columns.len();
        let two = cleared::<T>(&mut shared.levels_of_two, (base - shared.level) * count);
        let levels = cleared::<T>(&mut shared.levels, (base - shared.level) * 2 * n);
        for (place, both) in levels.chunks_exact_mut(2 * n).enumerate() {
            let level = shared.level + 1 + place;
            let (one, square) = both.split_at_mut(n);
            for (j, column) in one.iter_mut().enumerate() {
                column[..n].copy_from_slice(chain.column(level, 0, j));
            }
            for (column, j) in two[place * count..].iter_mut().zip(&shared.columns) {
                column[..n].copy_from_slice(chain.column(level, 1, *j));
            }
            for (square, column) in square.iter_mut().zip(&*one) {
                *square = times(one, column);
            }
        }
    }
}

/// The number of blocks of four terms of phi_3 for a norm. The derivative of the term k is at most k norm^(k-1)/(k+3)!, the first one is 1/4!.
fn blocks(norm: f64) -> usize {
    let is_enough = |blocks: &usize| {
        let k = POWERS * blocks;
        k as f64 * norm.powi(k as i32 - 1) * WEIGHTS[k] <= OMITTED * WEIGHTS[1]
    };
    (1..WEIGHTS.len() / POWERS).find(is_enough).unwrap_or(WEIGHTS.len() / POWERS)
}

/// A list of this number of columns of zeros.
#[inline(always)]
fn cleared<const T: usize>(list: &mut Vec<f64>, columns: usize) -> &mut [[f64; T]] {
    list.clear();
    list.resize(columns * T, 0.0);
    list.as_chunks_mut().0
}

/// The product of a matrix and z, plus a value on the diagonal.
#[inline(always)]
fn times_sparse<const T: usize>(to: &mut [[f64; T]], matrix: &[[f64; T]], (a, factor): (&Sparse<f64>, f64), value: f64) {
    for (j, to) in to.iter_mut().enumerate() {
        let mut sum = [0.0; T];
        a.column(j).iter().for_each(|(k, value)| add(&mut sum, *value, &matrix[*k]));
        *to = sum.map(|it| factor * it);
        to[j] += value;
    }
}

#[inline(always)]
fn add<const T: usize>(sum: &mut [f64; T], factor: f64, column: &[f64; T]) {
    for i in 0..T {
        sum[i] += factor * column[i];
    }
}

/// The place of the derivatives of an entry. Columns of phi_2 and phi_3 are given by their indices in the list of columns.
pub(super) fn place(n: usize, i: usize, j: usize) -> usize {
    j * width(n) + i
}
