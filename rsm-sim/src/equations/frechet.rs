//! How the functions of [`super::phi`] change with their matrix: their derivatives along directions of the matrix (M. Frechet), four or eight
//! directions in a register.
//!
//! In: a chain of a matrix A over a span H, and for each direction the derivative E of A. Out: [`Along`]: the derivatives of phi_1 and of some
//! columns of phi_2 and phi_3 at a level, and of phi_1 and phi_2 at the level of half its length. They are the exact derivatives of the functions;
//! rounding is that of the functions themselves. The series of the last level, a sum in blocks of four powers, is differentiated (A. H. Al-Mohy,
//! N. J. Higham, "Computing the Frechet derivative of the matrix exponential, with an application to condition number estimation", 2009, section
//! 4), then the doublings:
//!
//! ```text
//! phi_1(2z) = phi_1 + z phi_1^2/2    phi_2(2z) = (phi_1^2 + 2 phi_2)/4    phi_3(2z) = (phi_1 phi_2 + phi_2 + 2 phi_3)/8
//! ```
//!
//! The first one needs no e^z, and A and E have few entries, so a doubling costs the two products of the derivative of phi_1^2. What no direction
//! changes is computed once for all of them ([`super::frechet_values`]).
//!
//! Matrices are stored column by column. Every product is computed by columns: columns of the first factor times the numbers in a column of the
//! second one.

use super::frechet_values::{POWERS, Shared, Sparse, by_width};
use super::phi::WEIGHTS;
use crate::code::{Work, by_registers};

/// Runs code for each number of a column of constant length, without a loop: the compiler would turn a loop over short columns into gathers along it.
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

/// The derivatives in `W` directions.
#[derive(Debug, Clone)]
pub(super) struct Along<const W: usize> {
    e: Sparse<[f64; W]>,
    /// z to z^4 at the base.
    powers: Vec<[f64; W]>,
    /// phi_1 and its square, and two matrices of the series.
    one: Vec<[f64; W]>,
    square: Vec<[f64; W]>,
    before: Vec<[f64; W]>,
    earlier: Vec<[f64; W]>,
    /// The columns of phi_2 and phi_3.
    two: Vec<[f64; W]>,
    three: Vec<[f64; W]>,
    /// phi_1 and the columns of phi_2 at the level of half the length.
    half: Vec<[f64; W]>,
    half_two: Vec<[f64; W]>,
}

impl<const W: usize> Default for Along<W> {
    fn default() -> Self {
        Along {
            e: Sparse { ends: Vec::new(), entries: Vec::new() },
            powers: Vec::new(),
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

impl<const W: usize> Along<W> {
    /// Computes the derivatives along the directions. `entries`: the rows and columns of the entries of A that change, column by column; `e`: the
    /// derivative of such an entry.
    ///
    /// # Panics
    /// For eight directions on an x86-64 machine without AVX-512.
    pub(super) fn compute(&mut self, shared: &Shared, entries: &[(usize, usize)], e: impl Fn(usize, usize) -> [f64; W]) {
        let n = shared.n;
        self.e.clear();
        let mut entries = entries.iter().copied().peekable();
        for column in 0..n {
            while let Some((i, j)) = entries.next_if(|it| it.1 == column) {
                let value = e(i, j);
                // A direction that does not change an entry has a product of 0 with it, and the sums begin with +0: a skipped entry changes no bit.
                if value != [0.0; W] {
                    self.e.entries.push((i, value));
                }
            }
            self.e.ends.push(self.e.entries.len());
        }
        by_width!(n, S, T => by_registers::<W, _>(Compute::<S, T, W> { along: self, shared }));
    }

    /// The derivatives of phi_1 and of the columns of phi_2 and phi_3, then of phi_1 and the columns of phi_2 at the level of half the length. See
    /// [`super::frechet_values::place`].
    pub(super) fn lists(&self) -> [&[[f64; W]]; 5] {
        [&self.one, &self.two, &self.three, &self.half, &self.half_two]
    }
}

struct Compute<'a, const S: usize, const T: usize, const W: usize> {
    along: &'a mut Along<W>,
    shared: &'a Shared,
}

/// A matrix and its derivatives.
type Both<'a, const S: usize, const T: usize, const W: usize> = (&'a [[f64; T]], &'a [[[f64; W]; S]]);

impl<const S: usize, const T: usize, const W: usize> Work for Compute<'_, S, T, W> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Compute { along, shared } = self;
        let (n, count) = (shared.n, shared.columns.len());
        let Along { e, powers, one, square, before, earlier, two, three, half, half_two } = along;
        for list in [&mut *one, &mut *square, &mut *before, &mut *earlier] {
            list.resize(n * S, [0.0; W]);
        }
        [&mut *two, &mut *three].into_iter().for_each(|list| list.resize(count * S, [0.0; W]));
        let factor = shared.share(shared.base);
        let z = (&*e, &shared.a, factor);
        powers.clear();
        powers.resize(POWERS * n * S, [0.0; W]);
        let values = shared.powers.as_chunks::<T>().0;
        let powers = powers.as_chunks_mut::<S>().0;
        for (j, column) in powers[..n].iter_mut().enumerate() {
            e.column(j).iter().for_each(|(k, value)| column[*k] = value.map(|it| factor * it));
        }
        for power in 1..POWERS {
            let (before, next) = powers[(power - 1) * n..].split_at_mut(n);
            times_z(&mut next[..n], (&values[(power - 1) * n..], before), z);
        }
        let sums = shared.sums.as_chunks::<T>().0;
        let blocks = sums.len() / n - 1;
        for (step, block) in (0..blocks).rev().enumerate() {
            std::mem::swap(earlier, before);
            let before = before.as_chunks::<S>().0;
            for (j, to) in earlier.as_chunks_mut::<S>().0.iter_mut().enumerate() {
                let mut sum = [[0.0; W]; S];
                for k in 1..POWERS {
                    let (weight, column) = (WEIGHTS[POWERS * block + k], &powers[(k - 1) * n + j]);
                    each!(S, I => for lane in 0..W {
                        sum[I][lane] += weight * column[I][lane];
                    });
                }
                if step > 0 {
                    let fourth = (POWERS - 1) * n + j;
                    sum = product((&sums[(step - 1) * n..], before), (&values[fourth], &powers[fourth]), sum);
                }
                *to = sum;
            }
        }
        // The last sum is phi_3; phi_2 and phi_1 follow from it.
        let last = &sums[(blocks - 1) * n..];
        times_z::<S, T, W>(before.as_chunks_mut().0, (last, earlier.as_chunks().0), z);
        times_z::<S, T, W>(one.as_chunks_mut().0, (&last[n..], before.as_chunks().0), z);
        for (list, from) in [(&mut *two, &*before), (&mut *three, &*earlier)] {
            for (to, j) in list.as_chunks_mut::<S>().0.iter_mut().zip(&shared.columns) {
                *to = from.as_chunks().0[*j];
            }
        }
        if shared.base == shared.half_level {
            half.clone_from(one);
            half_two.clone_from(two);
        }
        let levels = shared.levels.as_chunks::<T>().0;
        let levels_of_two = shared.levels_of_two.as_chunks::<T>().0;
        for level in (shared.level..shared.base).rev() {
            let place = level - shared.level;
            let (values, values_of_square) = levels[place * 2 * n..(place + 1) * 2 * n].split_at(n);
            let here = (values, one.as_chunks::<S>().0);
            let square = square.as_chunks_mut::<S>().0;
            for (to, column) in square.iter_mut().zip(values.iter().zip(here.1)) {
                *to = product(here, column, [[0.0; W]; S]);
            }
            // Columns of phi_3, then of phi_2, from those of the level after it.
            let columns = two.as_chunks_mut::<S>().0.iter_mut().zip(three.as_chunks_mut::<S>().0);
            for (k, (two, three)) in columns.enumerate() {
                let sum = product(here, (&levels_of_two[place * count + k], two), [[0.0; W]; S]);
                let square = &square[shared.columns[k]];
                for i in 0..S {
                    for lane in 0..W {
                        three[i][lane] = 0.125 * (sum[i][lane] + two[i][lane] + 2.0 * three[i][lane]);
                        two[i][lane] = 0.25 * (square[i][lane] + 2.0 * two[i][lane]);
                    }
                }
            }
            let factor = 0.5 * shared.share(level + 1);
            for (j, to) in one.as_chunks_mut::<S>().0.iter_mut().enumerate() {
                let sum = column_of(j, (values_of_square, square), (e, &shared.a));
                for i in 0..S {
                    for lane in 0..W {
                        to[i][lane] += factor * sum[i][lane];
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

/// Adds a column of the derivative of a product M N, dM N + M dN, to a sum. `column`: the column of N and dN.
#[inline(always)]
fn product<const S: usize, const T: usize, const W: usize>(
    matrix: Both<'_, S, T, W>,
    column: (&[f64; T], &[[f64; W]; S]),
    mut sum: [[f64; W]; S],
) -> [[f64; W]; S] {
    for ((value, moved), (other, moved_other)) in column.0.iter().zip(column.1).zip(matrix.0.iter().zip(matrix.1)) {
        each!(S, I => for lane in 0..W {
            sum[I][lane] += moved[lane] * other[I] + value * moved_other[I][lane];
        });
    }
    sum
}

/// A column of the derivative of M A, M E + dM A.
#[inline(always)]
fn column_of<const S: usize, const T: usize, const W: usize>(
    j: usize,
    (values, moved): Both<'_, S, T, W>,
    (e, a): (&Sparse<[f64; W]>, &Sparse<f64>),
) -> [[f64; W]; S] {
    let mut sum = [[0.0; W]; S];
    for (k, factor) in e.column(j) {
        let column = &values[*k];
        each!(S, I => for lane in 0..W {
            sum[I][lane] += factor[lane] * column[I];
        });
    }
    for (k, factor) in a.column(j) {
        let column = &moved[*k];
        each!(S, I => for lane in 0..W {
            sum[I][lane] += factor * column[I][lane];
        });
    }
    sum
}

/// The derivative of M z.
#[inline(always)]
fn times_z<const S: usize, const T: usize, const W: usize>(
    to: &mut [[[f64; W]; S]],
    matrix: Both<'_, S, T, W>,
    (e, a, factor): (&Sparse<[f64; W]>, &Sparse<f64>, f64),
) {
    for (j, to) in to.iter_mut().enumerate() {
        let sum = column_of(j, matrix, (e, a));
        for i in 0..S {
            for lane in 0..W {
                to[i][lane] = factor * sum[i][lane];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::frechet_values::place;
    use super::super::phi::{Chain, stride};
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
            assert!(chain.set_matrix(n, &jacobian, 1.0, &(0..n).collect::<Vec<usize>>()));
            let wanted: Vec<usize> = vec![1, 4];
            let all: Vec<(usize, usize)> = (0..n * n).map(|k| (k % n, k / n)).collect();
            let moved = |i: usize, j: usize| -> [f64; W] { std::array::from_fn(|lane| e(lane, i, j)) };
            for level in levels {
                for half_level in [level, level + 1] {
                    assert!(chain.make(level) && chain.make(half_level));
                    let (mut shared, mut along) = (Shared::default(), Along::<W>::default());
                    shared.prepare((n, &jacobian, 1.0), &chain, (half_level, level), &wanted);
                    along.compute(&shared, &all, moved);
                    let [one, two, three, half, half_two] = along.lists();
                    for lane in 0..W {
                        let both = columns(2 * n, |i, j| match (i < n, j < n) {
                            (true, true) => a(i, j),
                            (false, false) => a(i - n, j - n),
                            (true, false) => e(lane, i, j - n),
                            (false, true) => 0.0,
                        });
                        let mut whole = Chain::default();
                        assert!(
                            whole.set_matrix(2 * n, &both, 1.0, &(0..2 * n).collect::<Vec<usize>>())
                                && whole.make(level)
                                && whole.make(half_level)
                        );
                        let corner = |level: usize, k: usize, i: usize, j: usize| whole.at::<12>(level)[k][j + n][i];
                        let near = |found: f64, expected: f64, what: &str| {
                            // Each doubling doubles the relative rounding at most: 2^10 times 2 n roundings.
                            let allowed = 1e-15 * (1.0 + size) * 10.0;
                            assert!((found - expected).abs() < allowed, "{size}, level {level}: {what} {found} for {expected}");
                        };
                        for i in 0..n {
                            for j in 0..n {
                                near(one[place(n, i, j)][lane], corner(level, 0, i, j), "phi_1");
                                near(half[place(n, i, j)][lane], corner(half_level, 0, i, j), "phi_1 of the half");
                            }
                            for (column, j) in wanted.iter().enumerate() {
                                let found = [two, three].map(|list| list[place(n, i, column)]);
                                for (k, found) in found.iter().enumerate() {
                                    near(found[lane], corner(level, k + 1, i, *j), "a column");
                                }
                                near(half_two[place(n, i, column)][lane], corner(half_level, 1, i, *j), "phi_2 of the half");
                            }
                        }
                    }
                }
            }
        }
    }
}
