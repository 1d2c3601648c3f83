//! How the functions of [`super::phi`] change with their matrix: their derivatives along directions of the matrix (M. Frechet), four or eight
//! directions in a register.
//!
//! In: a chain of a matrix A over a span H, and for each direction the derivative E of A. Out: [`Along`]: the derivatives of phi_1 and of some
//! columns of phi_2 and phi_3 at a level, and of phi_1 and phi_2 at the level of half its length. They are the exact derivatives of the functions;
//! rounding is that of the functions themselves. The series of the last level is differentiated term by term (A. H. Al-Mohy, N. J. Higham,
//! "Computing the Frechet derivative of the matrix exponential, with an application to condition number estimation", 2009, section 4), then the
//! doublings:
//!
//! ```text
//! phi_1(2z) = phi_1 + z phi_1^2/2    phi_2(2z) = (phi_1^2 + 2 phi_2)/4    phi_3(2z) = (phi_1 phi_2 + phi_2 + 2 phi_3)/8
//! ```
//!
//! The first one needs no e^z, and A and E have few entries, so a doubling costs the two products of the derivative of phi_1^2. What no direction
//! changes is computed once for all of them.

use super::part::MOST_STATES;
use super::phi::{Chain, WEIGHTS, stride};
use crate::code::{Work, by_registers, vectorised};

/// The relative size below which the first omitted term of the derivative of phi_3 changes nothing: a sixteenth of the rounding of f64.
const OMITTED: f64 = f64::EPSILON / 16.0;

/// The lengths of rows that code is written for. Each number of a row is a register of its own, so no length must be a multiple of four. The compiler
/// takes half a second for a short length and 2 s for a long one.
const WIDTHS: [usize; 7] = [4, 5, 6, 7, 8, 12, MOST_STATES];

/// The constant length for rows of `n` numbers.
fn width(n: usize) -> usize {
    WIDTHS.into_iter().find(|width| n <= *width).unwrap_or(MOST_STATES)
}

/// Runs code written for rows of a constant length.
macro_rules! by_width {
    ($states:expr, $length:ident => $run:expr) => {
        match width($states) {
            4 => by_width!(4, $length, $run),
            5 => by_width!(5, $length, $run),
            6 => by_width!(6, $length, $run),
            7 => by_width!(7, $length, $run),
            8 => by_width!(8, $length, $run),
            12 => by_width!(12, $length, $run),
            _ => by_width!(24, $length, $run),
        }
    };
    ($value:literal, $length:ident, $run:expr) => {{
        const $length: usize = $value;
        $run
    }};
}

/// Runs code for each number of a row of constant length, without a loop: the compiler would turn a loop over short rows into gathers along it.
macro_rules! each {
    ($length:ident, $j:ident => $run:expr) => {
        each!(@ $length, $j, $run, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23)
    };
    (@ $length:ident, $j:ident, $run:expr, $($value:literal)*) => {
        $(if $value < $length {
            const $j: usize = $value;
            $run
        })*
    };
}

/// Entries of a sparse matrix, row by row: each with its column.
#[derive(Debug, Clone, Default)]
struct Sparse<T> {
    /// For each row, the end of its entries.
    ends: Vec<usize>,
    entries: Vec<(usize, T)>,
}

impl<T: Copy> Sparse<T> {
    fn clear(&mut self) {
        self.ends.clear();
        self.entries.clear();
    }

    #[inline(always)]
    fn row(&self, i: usize) -> &[(usize, T)] {
        &self.entries[if i == 0 { 0 } else { self.ends[i - 1] }..self.ends[i]]
    }
}

/// What all directions share.
#[derive(Debug, Clone, Default)]
pub(super) struct Shared {
    n: usize,
    span: f64,
    level: usize,
    /// The level of half the length, or `level` if half is not asked for.
    half_level: usize,
    /// The level whose series is differentiated.
    base: usize,
    /// An even number of columns: the last one may stand twice.
    columns: Vec<usize>,
    a: Sparse<f64>,
    /// The matrices that Horner's rule multiplies by z, the last one is phi_2; row by row.
    series: Vec<f64>,
    /// For each level after `level` up to the base: phi_1 and its square, row by row.
    levels: Vec<f64>,
    /// For each of these levels, for each two columns: phi_2, row by row.
    levels_of_two: Vec<[f64; 2]>,
}

/// The derivatives in `W` directions.
#[derive(Debug, Clone)]
pub(super) struct Along<const W: usize> {
    e: Sparse<[f64; W]>,
    /// phi_1 and its square, and two matrices of Horner's rule; row by row.
    one: Vec<[f64; W]>,
    square: Vec<[f64; W]>,
    before: Vec<[f64; W]>,
    earlier: Vec<[f64; W]>,
    /// For each two columns, row by row: phi_2 and phi_3.
    two: Vec<[[f64; W]; 2]>,
    three: Vec<[[f64; W]; 2]>,
    /// phi_1 and these columns of phi_2 at the level of half the length.
    half: Vec<[f64; W]>,
    half_two: Vec<[[f64; W]; 2]>,
}

impl<const W: usize> Default for Along<W> {
    fn default() -> Self {
        Along {
            e: Sparse { ends: Vec::new(), entries: Vec::new() },
            one: Vec::new(),
            square: Vec::new(),
            before: Vec::new(),
            earlier: Vec::new(),
            two: Vec::new(),
            three: Vec::new(),
            half: Vec::new(),
            half_two: Vec::new(),
        }
    }
}

impl Shared {
    /// Prepares the derivatives of the functions of a chain. `jacobian`: A, column by column. `half_level`: the level after `level`, or `level`
    /// again. `columns`: the columns of phi_2 and phi_3. The chain must have computed all levels from `level` on.
    pub(super) fn prepare(
        &mut self,
        (n, jacobian, span): (usize, &[f64], f64),
        chain: &Chain,
        (half_level, level): (usize, usize),
        columns: &[usize],
    ) {
        (self.n, self.span, self.half_level, self.level) = (n, span, half_level, level);
        self.base = chain.base().max(half_level);
        self.columns.clear();
        self.columns.extend_from_slice(columns);
        if columns.len() % 2 == 1 {
            self.columns.extend(columns.last());
        }
        self.a.clear();
        let row = stride(n);
        for i in 0..n {
            self.a.entries.extend((0..n).map(|j| (j, jacobian[j * row + i])).filter(|it| it.1 != 0.0));
            self.a.ends.push(self.a.entries.len());
        }
        by_width!(n, S => vectorised(Prepare::<S> { shared: self, chain }));
    }

    /// The factor of A at a level.
    fn share(&self, level: usize) -> f64 {
        self.span * 0.5_f64.powi(level as i32)
    }
}

struct Prepare<'a, const S: usize> {
    shared: &'a mut Shared,
    chain: &'a Chain,
}

impl<const S: usize> Work for Prepare<'_, S> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Prepare { shared, chain } = self;
        let (n, base) = (shared.n, shared.base);
        let (norm, factor) = (chain.norm(base), shared.share(base));
        // The derivative of the term k of phi_3 is at most k norm^(k-1)/(k+3)!, the first one is 1/4!.
        let mut last = 1;
        let mut power = norm;
        while last + 1 < WEIGHTS.len() && (last + 1) as f64 * power * WEIGHTS[last + 1] > OMITTED * WEIGHTS[1] {
            last += 1;
            power *= norm;
        }
        shared.series.clear();
        shared.series.resize((last + 2) * n * S, 0.0);
        let series = shared.series.as_chunks_mut::<S>().0;
        for (k, row) in series[..n].iter_mut().enumerate() {
            row[k] = WEIGHTS[last];
        }
        for step in 0..=last {
            let weight = if step < last { WEIGHTS[last - 1 - step] } else { 0.5 };
            let (before, next) = series[step * n..(step + 2) * n].split_at_mut(n);
            for (i, next) in next.iter_mut().enumerate() {
                let mut sum = [0.0; S];
                for (k, value) in shared.a.row(i) {
                    add(&mut sum, *value, &before[*k]);
                }
                *next = sum.map(|it| factor * it);
                next[i] += weight;
            }
        }
        shared.levels.clear();
        shared.levels.resize((base - shared.level) * 2 * n * S, 0.0);
        shared.levels_of_two.clear();
        for (level, both) in (shared.level + 1..=base).zip(shared.levels.as_chunks_mut::<S>().0.chunks_mut(2 * n)) {
            let (rows, square) = both.split_at_mut(n);
            for (i, row) in rows.iter_mut().enumerate() {
                for (j, entry) in row.iter_mut().enumerate().take(n) {
                    *entry = chain.entry(level, 0, i, j);
                }
            }
            for pair in shared.columns.as_chunks::<2>().0 {
                shared.levels_of_two.extend((0..n).map(|i| pair.map(|j| chain.entry(level, 1, i, j))));
            }
            for (square, row) in square.iter_mut().zip(&*rows) {
                for (factor, other) in row.iter().zip(&*rows) {
                    add(square, *factor, other);
                }
            }
        }
    }
}

#[inline(always)]
fn add<const S: usize>(sum: &mut [f64; S], factor: f64, row: &[f64; S]) {
    for j in 0..S {
        sum[j] += factor * row[j];
    }
}

impl<const W: usize> Along<W> {
    /// Computes the derivatives along the directions. `e`: the derivative of A, row by row.
    ///
    /// # Panics
    /// For eight directions on an x86-64 machine without AVX-512.
    pub(super) fn compute(&mut self, shared: &Shared, e: impl Iterator<Item = [f64; W]>) {
        let n = shared.n;
        self.e.clear();
        for (k, value) in e.enumerate().take(n * n) {
            // A direction that does not change an entry has a product of 0 with it, and the sums begin with +0: a skipped entry changes no bit.
            if value != [0.0; W] {
                self.e.entries.push((k % n, value));
            }
            if k % n == n - 1 {
                self.e.ends.push(self.e.entries.len());
            }
        }
        by_width!(n, S => by_registers::<W, _>(Compute::<S, W> { along: self, shared }));
    }

    /// The derivative of an entry of phi_1.
    #[inline]
    pub(super) fn one(&self, shared: &Shared, i: usize, j: usize) -> [f64; W] {
        self.one[i * width(shared.n) + j]
    }

    /// The derivative of an entry of phi_1 at the level of half the length.
    #[inline]
    pub(super) fn half(&self, shared: &Shared, i: usize, j: usize) -> [f64; W] {
        self.half[i * width(shared.n) + j]
    }

    /// The derivatives of an entry of phi_2 and phi_3, in the column with this index in the list of columns.
    #[inline]
    pub(super) fn in_column(&self, shared: &Shared, i: usize, column: usize) -> [[f64; W]; 2] {
        let (place, side) = (column / 2 * shared.n + i, column % 2);
        [self.two[place][side], self.three[place][side]]
    }

    /// The derivative of an entry of phi_2 at the level of half the length, in such a column.
    #[inline]
    pub(super) fn half_two(&self, shared: &Shared, i: usize, column: usize) -> [f64; W] {
        self.half_two[column / 2 * shared.n + i][column % 2]
    }
}

struct Compute<'a, const S: usize, const W: usize> {
    along: &'a mut Along<W>,
    shared: &'a Shared,
}

impl<const S: usize, const W: usize> Work for Compute<'_, S, W> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Compute { along, shared } = self;
        let n = shared.n;
        let pairs = shared.columns.as_chunks::<2>().0;
        let Along { e, one, square, before, earlier, two, three, half, half_two } = along;
        for list in [&mut *one, &mut *square, &mut *before, &mut *earlier] {
            list.resize(n * S, [0.0; W]);
        }
        one.fill([0.0; W]);
        let factor = shared.share(shared.base);
        // Horner's rule ends with phi_3, phi_2 and phi_1. Three matrices take turns.
        for values in shared.series.as_chunks::<S>().0.chunks(n) {
            std::mem::swap(earlier, before);
            std::mem::swap(before, one);
            let before = before.as_chunks::<S>().0;
            for (i, to) in one.as_chunks_mut::<S>().0.iter_mut().enumerate() {
                let sum = row_of(i, (e, &shared.a), (values, before));
                for j in 0..S {
                    for lane in 0..W {
                        to[j][lane] = factor * sum[j][lane];
                    }
                }
            }
        }
        columns_of::<S, W>(two, before, pairs);
        columns_of::<S, W>(three, earlier, pairs);
        if shared.base == shared.half_level {
            half.clone_from(one);
            half_two.clone_from(two);
        }
        let levels = shared.levels.as_chunks::<S>().0;
        for level in (shared.level..shared.base).rev() {
            let place = level - shared.level;
            let (rows, values_of_square) = levels[place * 2 * n..(place + 1) * 2 * n].split_at(n);
            let factor = 0.5 * shared.share(level + 1);
            let moved_rows = one.as_chunks::<S>().0;
            for ((moved, row), square) in moved_rows.iter().zip(rows).zip(square.as_chunks_mut::<S>().0) {
                let mut sum = [[0.0; W]; S];
                for ((moved, value), (other, moved_other)) in moved.iter().zip(row).zip(rows.iter().zip(moved_rows)) {
                    each!(S, J => for lane in 0..W {
                        sum[J][lane] += moved[lane] * other[J] + value * moved_other[J][lane];
                    });
                }
                *square = sum;
            }
            let square = square.as_chunks::<S>().0;
            for (k, pair) in pairs.iter().enumerate() {
                let values = &shared.levels_of_two[(place * pairs.len() + k) * n..(place * pairs.len() + k + 1) * n];
                let (two, three) = (&mut two[k * n..(k + 1) * n], &mut three[k * n..(k + 1) * n]);
                // Columns of phi_3, then of phi_2, from those of the level after it.
                for ((moved, row), (two_here, three)) in moved_rows.iter().zip(rows).zip(two.iter().zip(three)) {
                    let mut sum = [[0.0; W]; 2];
                    for ((moved, value), (other, moved_other)) in moved.iter().zip(row).zip(values.iter().zip(&*two)) {
                        for side in 0..2 {
                            for lane in 0..W {
                                sum[side][lane] += moved[lane] * other[side] + value * moved_other[side][lane];
                            }
                        }
                    }
                    let before = *three;
                    let mut next = [[0.0; W]; 2];
                    for side in 0..2 {
                        for lane in 0..W {
                            next[side][lane] = 0.125 * (sum[side][lane] + two_here[side][lane] + 2.0 * before[side][lane]);
                        }
                    }
                    *three = next;
                }
                for (two, square) in two.iter_mut().zip(square) {
                    let (square, before) = (pair.map(|j| square[j]), *two);
                    let mut next = [[0.0; W]; 2];
                    for side in 0..2 {
                        for lane in 0..W {
                            next[side][lane] = 0.25 * (square[side][lane] + 2.0 * before[side][lane]);
                        }
                    }
                    *two = next;
                }
            }
            for (i, to) in one.as_chunks_mut::<S>().0.iter_mut().enumerate() {
                let sum = row_of(i, (e, &shared.a), (values_of_square, square));
                for j in 0..S {
                    for lane in 0..W {
                        to[j][lane] += factor * sum[j][lane];
                    }
                }
            }
            if level == shared.half_level {
                half.clone_from(one);
                half_two.clone_from(two);
            }
        }
    }
}

/// Takes two and two columns out of a matrix.
#[inline(always)]
fn columns_of<const S: usize, const W: usize>(to: &mut Vec<[[f64; W]; 2]>, from: &[[f64; W]], pairs: &[[usize; 2]]) {
    to.clear();
    for pair in pairs {
        to.extend(from.as_chunks::<S>().0.iter().map(|row| pair.map(|j| row[j])));
    }
}

/// A row of the derivative of A M: E M + A dM.
#[inline(always)]
fn row_of<const S: usize, const W: usize>(
    i: usize,
    (e, a): (&Sparse<[f64; W]>, &Sparse<f64>),
    (values, moved): (&[[f64; S]], &[[[f64; W]; S]]),
) -> [[f64; W]; S] {
    let mut sum = [[0.0; W]; S];
    for (k, factor) in e.row(i) {
        let row = &values[*k];
        each!(S, J => for lane in 0..W {
            sum[J][lane] += factor[lane] * row[J];
        });
    }
    for (k, factor) in a.row(i) {
        let row = &moved[*k];
        each!(S, J => for lane in 0..W {
            sum[J][lane] += factor * row[J][lane];
        });
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number from -1 to 1 (a Weyl sequence).
    fn number(k: usize) -> f64 {
        2.0 * (k as f64 * 2.0_f64.sqrt()).fract() - 1.0
    }

    /// The columns of a matrix for a chain.
    fn columns(n: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let row = stride(n);
        let mut all = vec![0.0; n * row];
        for j in 0..n {
            for i in 0..n {
                all[j * row + i] = entry(i, j);
            }
        }
        all
    }

    #[test]
    fn derivatives_are_the_corner_of_the_functions_of_a_block_matrix() {
        derivatives_are_the_corner::<4>();
        if crate::code::has_eight() {
            derivatives_are_the_corner::<8>();
        }
    }

    fn derivatives_are_the_corner<const W: usize>() {
        // f([A E; 0 A]) = [f(A) L; 0 f(A)], where L is the derivative of f at A along E (C. F. Van Loan, "Computing integrals involving the matrix
        // exponential", 1978). The first matrix has a small norm, the last one needs ten doublings.
        let n = 5;
        for (size, levels) in [(0.01, 0..3), (3.0, 0..5), (400.0, 0..4)] {
            let a = |i: usize, j: usize| {
                if (i + j) % 3 == 1 { 0.0 } else { size * (number(1 + i * n + j) - 1.5 * f64::from(u8::from(i == j))) }
            };
            let e = |lane: usize, i: usize, j: usize| {
                if (i * j) % 2 == 1 { 0.0 } else { size * number(100 * (lane + 1) + i * n + j) }
            };
            let mut chain = Chain::default();
            let jacobian = columns(n, a);
            assert!(chain.set_matrix(n, &jacobian, 1.0));
            let wanted: Vec<usize> = vec![1, 4];
            let moved = |k: usize| -> [f64; W] { std::array::from_fn(|lane| e(lane, k / n, k % n)) };
            for level in levels {
                for half_level in [level, level + 1] {
                    assert!(chain.make(level) && chain.make(half_level));
                    let (mut shared, mut along) = (Shared::default(), Along::<W>::default());
                    shared.prepare((n, &jacobian, 1.0), &chain, (half_level, level), &wanted);
                    along.compute(&shared, (0..n * n).map(moved));
                    for lane in 0..W {
                        let both = columns(2 * n, |i, j| match (i < n, j < n) {
                            (true, true) => a(i, j),
                            (false, false) => a(i - n, j - n),
                            (true, false) => e(lane, i, j - n),
                            (false, true) => 0.0,
                        });
                        let mut whole = Chain::default();
                        assert!(whole.set_matrix(2 * n, &both, 1.0) && whole.make(level) && whole.make(half_level));
                        let corner = |level: usize, k: usize, i: usize, j: usize| whole.at::<12>(level)[k][j + n][i];
                        let near = |found: f64, expected: f64, what: &str| {
                            // Each doubling doubles the relative rounding at most: 2^10 times 2 n roundings.
                            let allowed = 1e-15 * (1.0 + size) * 10.0;
                            assert!((found - expected).abs() < allowed, "{size}, level {level}: {what} {found} for {expected}");
                        };
                        for i in 0..n {
                            for j in 0..n {
                                near(along.one(&shared, i, j)[lane], corner(level, 0, i, j), "phi_1");
                                near(along.half(&shared, i, j)[lane], corner(half_level, 0, i, j), "phi_1 of the half");
                            }
                            for (column, j) in wanted.iter().enumerate() {
                                let found = along.in_column(&shared, i, column);
                                for (k, found) in found.iter().enumerate() {
                                    near(found[lane], corner(level, k + 1, i, *j), "a column");
                                }
                                near(
                                    along.half_two(&shared, i, column)[lane],
                                    corner(half_level, 1, i, *j),
                                    "phi_2 of the half",
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}
