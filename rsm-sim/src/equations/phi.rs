//! Functions of small matrices, for steps that solve the linear part exactly.
//!
//! In: a matrix A and a time span H. Out: [`Chain`]: the functions phi_1, phi_2, phi_3 of A H/2^k for the levels k = 0, 1, 2, ..., where phi_0(z) =
//! e^z and phi_k+1(z) = (phi_k(z) - 1/k!)/z. If the norm of a level is small, its functions are the sum of a series. If it is not, they are computed
//! from the next level, whose span is half as long, by doubling (B. V. Minchev, W. M. Wright, "A review of exponential integrators for first order
//! semi-linear problems", 2005, section 7). A level is computed at its first use, and has the same bits whichever levels were computed before. No
//! matrix is inverted, so a singular matrix, for example of a free body, is no special case. No memory is allocated after the lists have reached
//! their length.
//!
//! Matrices are stored column by column, each column with [`stride`] numbers: zeros fill it up to complete vector registers.

use super::norm::{balance, largest_row};
use crate::code::{Work, vectorised};

/// The norm of A H/2^k below which the series is used.
const SMALL: f64 = 0.5;

/// Blocks of four terms of phi_3, and the largest norm for which this number of blocks is sufficient. The first omitted term is at most 3e-19 of the
/// first term: 0.5^16 3!/19!, 0.25^12 3!/15!, (1/32)^8 3!/11!, 2^-56 3!/7!. Powers up to the fourth are used for all blocks (M. S. Paterson, L. J.
/// Stockmeyer, 1973).
const BLOCKS: [(usize, f64); 3] = [(1, 1.0 / 16384.0), (2, 1.0 / 32.0), (3, 0.25)];
const MOST_BLOCKS: usize = 4;

/// 1/(k + 3)!, the terms of phi_3: those of the blocks here, and what derivatives need for larger norms.
pub(super) const WEIGHTS: [f64; 24] = {
    let mut weights = [0.0; 24];
    let (mut factorial, mut k) = (2.0, 0);
    while k < weights.len() {
        factorial *= (k + 3) as f64;
        weights[k] = 1.0 / factorial;
        k += 1;
    }
    weights
};

/// The largest number of doublings. With a larger norm, results in f64 have no meaning.
const MOST: usize = 60;

/// The length of a column.
pub(super) fn stride(n: usize) -> usize {
    n.div_ceil(4) * 4
}

/// Runs code written for columns of a constant length.
macro_rules! by_stride {
    ($states:expr, $length:ident => $run:expr) => {
        match $crate::equations::phi::stride($states) {
            4 => by_stride!(4, $length, $run),
            8 => by_stride!(8, $length, $run),
            12 => by_stride!(12, $length, $run),
            16 => by_stride!(16, $length, $run),
            20 => by_stride!(20, $length, $run),
            _ => by_stride!(24, $length, $run),
        }
    };
    ($value:literal, $length:ident, $run:expr) => {{
        const $length: usize = $value;
        $run
    }};
}
pub(super) use by_stride;

/// The functions of a matrix over a span, its half, its quarter and so on.
#[derive(Debug, Clone, Default)]
pub(super) struct Chain {
    n: usize,
    /// The first level with a small norm.
    base: usize,
    /// The norm of that level.
    norm: f64,
    /// For each level, phi_1, phi_2, phi_3.
    values: Vec<f64>,
    /// For each level, whether it is computed.
    made: Vec<bool>,
    /// The columns of phi_2 and phi_3 that are computed. The others are 0 where a level is computed by doubling.
    columns: Vec<usize>,
    /// z to z^4 at the base; then e^z at the longest span that doubling has reached; then working memory.
    work: Vec<f64>,
}

impl Chain {
    /// The first level with a small norm. The levels before it are computed by doubling.
    pub(super) fn base(&self) -> usize {
        self.base
    }

    /// The number of rows.
    pub(super) fn rows(&self) -> usize {
        self.n
    }

    /// The columns of phi_2 and phi_3 that are computed.
    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// An entry of phi_1, phi_2 or phi_3 at a level that is computed; `function` begins with 0.
    pub(super) fn entry(&self, level: usize, function: usize, i: usize, j: usize) -> f64 {
        self.column(level, function, j)[i]
    }

    /// A column of phi_1, phi_2 or phi_3 at a level that is computed; `function` begins with 0.
    pub(super) fn column(&self, level: usize, function: usize, j: usize) -> &[f64] {
        &self.values[((3 * level + function) * self.n + j) * stride(self.n)..][..self.n]
    }

    /// The norm of the matrix of a level.
    pub(super) fn norm(&self, level: usize) -> f64 {
        self.norm * 0.5_f64.powi(level as i32 - self.base as i32)
    }

    fn size(&self) -> usize {
        self.n * stride(self.n)
    }

    /// phi_1, phi_2, phi_3 of A H/2^level. [`Chain::make`] must have computed this level.
    #[inline(always)]
    pub(super) fn at<const S: usize>(&self, level: usize) -> [&[[f64; S]]; 3] {
        let n = self.n;
        let (one, other) = self.values.as_chunks().0[3 * level * n..3 * (level + 1) * n].split_at(n);
        let (two, three) = other.split_at(n);
        [one, two, three]
    }

    /// Replaces the matrix; then no level is computed. `columns`: the columns of phi_2 and phi_3 that are asked for. Returns `false` if the matrix is
    /// too large or not finite.
    pub(super) fn set_matrix(&mut self, n: usize, a: &[f64], span: f64, columns: &[usize]) -> bool {
        if self.n != n {
            self.n = n;
            self.work = vec![0.0; 6 * n * stride(n)];
        }
        self.made.clear();
        self.columns.clear();
        self.columns.extend_from_slice(columns);
        by_stride!(n, S => vectorised(SetMatrix::<S> { chain: self, a, span }))
    }

    /// Computes a level, and the levels between it and the base. Returns `false` if the result is not finite.
    pub(super) fn make(&mut self, level: usize) -> bool {
        if self.made.get(level) == Some(&true) {
            return true;
        }
        let levels = self.made.len().max(level.max(self.base) + 1);
        self.made.resize(levels, false);
        self.values.resize(self.values.len().max(3 * levels * self.size()), 0.0);
        by_stride!(self.n, S => vectorised(Make::<S> { chain: self, level }))
    }

    /// Computes a level by its series.
    #[inline(always)]
    fn sum<const S: usize>(&mut self, level: usize) -> bool {
        let (n, base) = (self.n, self.base);
        let share = 0.5_f64.powi((level - base) as i32);
        let norm = self.norm * share;
        let blocks = BLOCKS.into_iter().find(|it| norm <= it.1).map_or(MOST_BLOCKS, |it| it.0);
        let (powers, rest) = self.work.as_chunks_mut().0.split_at_mut(4 * n);
        let (zero, spare) = rest.split_at_mut(n);
        let (z, other) = powers.split_at(n);
        let (z2, other) = other.split_at(n);
        let (z3, z4) = other.split_at(n);
        let [one, two, three] = three_of::<S>(&mut self.values.as_chunks_mut().0[3 * level * n..3 * (level + 1) * n]);
        // The matrix of this level is z times a power of two.
        let shares: [f64; 5] = std::array::from_fn(|k| share.powi(k as i32));
        for block in (0..blocks).rev() {
            let weights: [f64; 4] = std::array::from_fn(|k| WEIGHTS[4 * block + k] * shares[k]);
            let is_first = block + 1 == blocks;
            if !is_first {
                product(spare, three, z4);
            }
            for j in 0..n {
                for i in 0..S {
                    let before = if is_first { 0.0 } else { shares[4] * spare[j][i] };
                    three[j][i] = before + weights[1] * z[j][i] + weights[2] * z2[j][i] + weights[3] * z3[j][i];
                }
                three[j][j] += weights[0];
            }
        }
        further(two, z, three, share, 0.5);
        further(one, z, two, share, 1.0);
        if level == base {
            further(zero, z, one, 1.0, 1.0);
        }
        self.made[level] = is_finite(one) & is_finite(two) & is_finite(three);
        self.made[level]
    }

    /// Computes a level from the next one; `work` contains e^z of the next level.
    #[inline(always)]
    fn double<const S: usize>(&mut self, level: usize) -> bool {
        let (n, columns) = (self.n, self.columns.as_slice());
        let (zero, spare) = self.work.as_chunks_mut().0[4 * n..].split_at_mut(n);
        let (before, behind) = self.values.as_chunks_mut().0.split_at_mut(3 * (level + 1) * n);
        let [next_one, next_two, next_three] = three_of::<S>(&mut before[3 * level * n..]);
        let [one, two, three] = three_of(&mut behind[..3 * n]);
        // phi_1(2z) = (e^z + 1) phi_1/2, phi_2(2z) = (phi_1^2 + 2 phi_2)/4, phi_3(2z) = (phi_1 phi_2 + phi_2 + 2 phi_3)/8
        product(next_one, zero, one);
        for (next, one) in next_one.iter_mut().zip(&*one) {
            for i in 0..S {
                next[i] = 0.5 * (next[i] + one[i]);
            }
        }
        if columns.len() < n {
            next_two.fill([0.0; S]);
            next_three.fill([0.0; S]);
        }
        for j in columns.iter().copied() {
            let (square, both) = (times(one, &one[j]), times(one, &two[j]));
            for i in 0..S {
                next_two[j][i] = 0.25 * (square[i] + 2.0 * two[j][i]);
                next_three[j][i] = 0.125 * (both[i] + two[j][i] + 2.0 * three[j][i]);
            }
        }
        // e^2z, for the previous level, if there is one.
        if level > 0 {
            product(spare, zero, zero);
            zero.copy_from_slice(spare);
        }
        self.made[level] = is_finite(next_one) & is_finite(next_two) & is_finite(next_three);
        self.made[level]
    }
}

struct SetMatrix<'a, const S: usize> {
    chain: &'a mut Chain,
    a: &'a [f64],
    span: f64,
}

impl<const S: usize> Work for SetMatrix<'_, S> {
    type Found = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Chain { n, base, norm, work, .. } = self.chain;
        let n = *n;
        let (z, rest) = work.as_chunks_mut::<S>().0.split_at_mut(n);
        let (z2, rest) = rest.split_at_mut(n);
        let (z3, rest) = rest.split_at_mut(n);
        let z4 = &mut rest[..n];
        z.as_flattened_mut().iter_mut().zip(self.a).for_each(|(z, a)| *z = a * self.span);
        let mut whole = largest_row(z);
        if whole > SMALL && whole.is_finite() {
            // The norm of the balanced matrix determines the number of doublings. The functions themselves are computed from the original matrix.
            z2.copy_from_slice(z);
            balance(z2);
            whole = largest_row(z2);
        }
        if !whole.is_finite() {
            return false;
        }
        let mut share = 1.0;
        *base = 0;
        while whole * share > SMALL {
            (*base, share) = (*base + 1, 0.5 * share);
            if *base > MOST {
                return false;
            }
        }
        *norm = whole * share;
        z.as_flattened_mut().iter_mut().for_each(|it| *it *= share);
        product(z2, z, z);
        product(z3, z2, z);
        product(z4, z2, z2);
        true
    }
}

struct Make<'a, const S: usize> {
    chain: &'a mut Chain,
    level: usize,
}

impl<const S: usize> Work for Make<'_, S> {
    type Found = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Make { chain, level } = self;
        let base = chain.base;
        let first = level.max(base);
        if !chain.made[first] && !chain.sum::<S>(first) {
            return false;
        }
        let top = (level..first).find(|it| chain.made[*it]).unwrap_or(first);
        // A loop, not a closure: a closure that is not inlined would have no vector instructions.
        for k in (level..top).rev() {
            if !chain.double::<S>(k) {
                return false;
            }
        }
        true
    }
}

#[inline(always)]
fn three_of<const S: usize>(all: &mut [[f64; S]]) -> [&mut [[f64; S]]; 3] {
    let n = all.len() / 3;
    let (one, other) = all.split_at_mut(n);
    let (two, three) = other.split_at_mut(n);
    [one, two, three]
}

#[inline(always)]
fn is_finite<const S: usize>(matrix: &[[f64; S]]) -> bool {
    matrix.as_flattened().iter().fold(true, |all, it| all & it.is_finite())
}

/// The product a b.
#[inline(always)]
fn product<const S: usize>(to: &mut [[f64; S]], a: &[[f64; S]], b: &[[f64; S]]) {
    for (to, b) in to.iter_mut().zip(b) {
        *to = times(a, b);
    }
}

/// A phi function from the next one: share a b plus `value` on the diagonal.
#[inline(always)]
fn further<const S: usize>(to: &mut [[f64; S]], a: &[[f64; S]], b: &[[f64; S]], share: f64, value: f64) {
    for (j, (to, b)) in to.iter_mut().zip(b).enumerate() {
        *to = times(a, b).map(|it| share * it);
        to[j] += value;
    }
}

/// A matrix, by its columns, times a vector.
#[inline(always)]
pub(super) fn times<const S: usize>(columns: &[[f64; S]], by: &[f64; S]) -> [f64; S] {
    let mut sum = [0.0; S];
    for (column, factor) in columns.iter().zip(by) {
        for (sum, value) in sum.iter_mut().zip(column) {
            *sum += value * factor;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both columns of two.
    const ALL: [usize; 2] = [0, 1];

    /// phi_1 to phi_3 of a number, from their definition. For numbers of magnitude 1 and more it loses no digits.
    fn plain(z: f64) -> [f64; 3] {
        let one = (z.exp() - 1.0) / z;
        let two = (one - 1.0) / z;
        [one, two, (two - 0.5) / z]
    }

    fn flat(chain: &Chain, level: usize) -> [&[f64]; 3] {
        chain.at::<4>(level).map(|it| it.as_flattened())
    }

    /// A matrix of two rows, column by column.
    fn columns([a, b, c, d]: [f64; 4]) -> [f64; 8] {
        [a, c, 0.0, 0.0, b, d, 0.0, 0.0]
    }

    #[test]
    fn a_triangular_matrix_by_its_eigenvectors() {
        // A = [-2 3; 0 -800] has the eigenvectors (1, 0) and (3, -798): f(A)(3, -798) = f(-800)(3, -798), so the corner is 3 (f(-2) - f(-800))/798.
        let mut chain = Chain::default();
        assert!(chain.set_matrix(2, &columns([-2.0, 3.0, 0.0, -800.0]), 1.0, &ALL));
        assert!(chain.base() > 9, "{}", chain.base());
        for level in 0..4 {
            assert!(chain.make(level));
            let h = 0.5_f64.powi(level as i32);
            let (slow, fast) = (plain(-2.0 * h), plain(-800.0 * h));
            for (k, matrix) in flat(&chain, level).into_iter().enumerate() {
                let corner = 3.0 * (slow[k] - fast[k]) / 798.0;
                // The tolerance covers eleven doublings of numbers near 1, and the digits that the definition loses at -0.25.
                for (found, expected) in [(matrix[0], slow[k]), (matrix[5], fast[k]), (matrix[4], corner), (matrix[1], 0.0)] {
                    assert!((found - expected).abs() < 1e-12, "level {level}, phi_{}: {found} for {expected}", k + 1);
                }
            }
        }
    }

    #[test]
    fn a_level_has_the_same_bits_whichever_were_asked_for_before() {
        let a = columns([-3.0, 40.0, -5.0, -60.0]);
        let of = |order: &[usize]| -> Vec<Vec<f64>> {
            let mut chain = Chain::default();
            assert!(chain.set_matrix(2, &a, 0.7, &ALL) && order.iter().all(|level| chain.make(*level)));
            (0..chain.base() + 4)
                .map(|level| if chain.make(level) { flat(&chain, level).concat() } else { Vec::new() })
                .collect()
        };
        let usual = of(&[]);
        assert_eq!(usual.iter().map(Vec::len).collect::<Vec<usize>>(), vec![24; usual.len()]);
        for order in [vec![0], vec![3, 1, 2], vec![9, 5, 0], (0..9).rev().collect()] {
            assert_eq!(of(&order), usual, "{order:?}");
        }
    }

    #[test]
    fn a_level_by_its_series_is_the_next_one_doubled() {
        // Norms from 0.4 to 0.4/2^18 need 4 blocks of terms, then fewer.
        let a = columns([-0.1, 0.3, -0.2, -0.15]);
        let mut chain = Chain::default();
        assert!(chain.set_matrix(2, &a, 1.0, &ALL) && chain.base() == 0);
        for level in 0..18 {
            assert!(chain.make(level) && chain.make(level + 1));
            let (longer, [one, two, three]) = (flat(&chain, level), flat(&chain, level + 1));
            let product = |a: &[f64], b: &[f64], at: usize| a[at % 4] * b[at / 4 * 4] + a[4 + at % 4] * b[at / 4 * 4 + 1];
            let z = a.map(|it| it * 0.5_f64.powi(level as i32 + 1));
            for at in [0, 1, 4, 5] {
                // e^z + 1 = 2 + z phi_1
                let sum = 2.0 * one[at] + product(&z, &(0..8).map(|k| product(one, one, k)).collect::<Vec<f64>>(), at);
                let doubled = [
                    0.5 * sum,
                    0.25 * (product(one, one, at) + 2.0 * two[at]),
                    0.125 * (product(one, two, at) + two[at] + 2.0 * three[at]),
                ];
                for (k, (found, expected)) in longer.iter().zip(doubled).enumerate() {
                    // The tolerance covers a few roundings of numbers of magnitude 1.
                    assert!((found[at] - expected).abs() < 1e-15, "level {level}, phi_{} at {at}", k + 1);
                }
            }
        }
    }

    #[test]
    fn states_of_other_units_have_the_same_functions() {
        // The same matrix with its second state in thousandths: the off-diagonal entries change by factors of 1000 and 1/1000.
        let (mut plain, mut scaled) = (Chain::default(), Chain::default());
        assert!(plain.set_matrix(2, &columns([-3.0, 4.0, -5.0, -60.0]), 0.7, &ALL));
        assert!(scaled.set_matrix(2, &columns([-3.0, 4e-3, -5e3, -60.0]), 0.7, &ALL));
        assert!(plain.make(0) && scaled.make(0));
        for (one, other) in flat(&plain, 0).into_iter().zip(flat(&scaled, 0)) {
            for (place, factor) in [(0, 1.0), (4, 1e-3), (1, 1e3), (5, 1.0)] {
                // The tolerance covers eight doublings.
                assert!((one[place] * factor - other[place]).abs() <= 1e-13 * factor, "{place}");
            }
        }
    }

    #[test]
    fn columns_that_are_asked_for_have_the_same_bits_as_with_all_others() {
        let a = columns([-3.0, 40.0, -5.0, -60.0]);
        let of = |asked: &[usize]| {
            let mut chain = Chain::default();
            assert!(chain.set_matrix(2, &a, 0.7, asked) && chain.make(0) && chain.base() > 0);
            chain
        };
        let (all, second) = (of(&ALL), of(&[1]));
        for level in 0..=all.base() {
            for function in 0..3 {
                assert_eq!(
                    all.column(level, function, 1),
                    second.column(level, function, 1),
                    "level {level}, phi_{}",
                    function + 1
                );
            }
            assert_eq!(all.column(level, 0, 0), second.column(level, 0, 0), "phi_1 is whole");
        }
        assert_eq!(second.column(0, 2, 0), [0.0; 2], "not asked for");
    }

    #[test]
    fn of_nothing_they_are_the_first_terms_and_of_no_number_nothing() {
        let mut chain = Chain::default();
        assert!(chain.set_matrix(3, &[0.0; 12], 0.1, &[0, 1, 2]) && chain.make(1));
        assert_eq!(flat(&chain, 1).map(|it| it[5]), [1.0, 0.5, 1.0 / 6.0]);
        let one = |a: f64| [a, 0.0, 0.0, 0.0];
        assert!(!chain.set_matrix(1, &one(f64::NAN), 0.1, &[0]) && !chain.set_matrix(1, &one(1e300), 1e10, &[0]));
    }
}
