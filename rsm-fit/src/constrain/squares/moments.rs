//! The semidefinite program of one degree: the largest m for which a sum of squares exists.
//!
//! In: a matrix of polynomials, weights, half the degree. Out: a proven bound, or the variances of t from the last moments. The dual problem has
//! moments y, one for every monomial of t and product of two entries of u. It minimises <b, y> for the coefficients b of u'Hu, where the moment of
//! u'u is 1 and the matrices Z_k of the products g_k v_k v_k' are positive semidefinite. It starts from the moments of points in the region. Every
//! such y is an upper bound of m.
//!
//! A primal-dual interior-point method solves it in about 15 steps (Nesterov, Nemirovskii 1994, Interior-Point Polynomial Algorithms in Convex
//! Programming; the direction is that of Helmberg, Rendl, Vanderbei, Wolkowicz 1996, SIAM J. Optimization 6; predictor and corrector of Mehrotra
//! 1992, SIAM J. Optimization 2). This part is plain f64 and proves nothing. The proof uses the X_k as computed (Peyrl, Parrilo 2008, Theoretical
//! Computer Science 409): they are positive semidefinite by their Cholesky factors, and the remainder of u'(H - m I)u is enclosed by intervals.

use std::collections::HashMap;

use rsm_core::interval::Interval;

use super::matrix::{Factor, Matrix, dot};
use super::region::{Polynomial, Weight};
use super::{Work, place};
use crate::random::Random;

/// The number of points whose moments start a program. There are more points than rows of any matrix, so the start is not on the boundary.
const POINTS: usize = 4096;

/// The largest number of unknown moments. A step takes about its third power in multiplications. Five inputs and order 4 have 1890 at the second
/// degree.
const MOST_MOMENTS: usize = 2000;

/// The largest number of steps of a program; 15 are usual.
const MOST_STEPS: usize = 50;

/// A step goes this share of the distance to the boundary of the cone.
const SHARE_OF_WAY: f64 = 0.95;

/// A step that is too long is multiplied by this.
const SHORTER: f64 = 0.9;

/// If no longer step is possible, rounding errors dominate.
const SHORTEST: f64 = 1e-4;

/// The relative increase of the diagonal of the equations, which keeps them positive definite in spite of rounding. Refinement removes its effect.
const DIAGONAL_INCREASE: f64 = 1e-14;

/// The number of refinements of the solution of the equations.
const REFINEMENTS: usize = 2;

/// The result of a program.
pub(super) enum Outcome {
    /// A lower bound of all eigenvalues.
    Bound(f64),
    /// No squares of this degree exist for the requested bound. Holds the variables with their variances.
    Open(Vec<(usize, f64)>),
    /// The work limit is reached, or rounding prevents further progress.
    Stopped,
}

/// A weight g with its basis v: the index of each entry of vv' among the products of two monomials, and every such product times g as a sum of
/// moments.
struct Block {
    rows: usize,
    /// Indices, row by row.
    products: Vec<usize>,
    /// For every product, the sum of moments.
    moments: Vec<Vec<(usize, f64)>>,
}

pub(super) struct Program {
    /// The number of entries of u.
    size: usize,
    /// The entries a <= b of u in every pair.
    pairs: Vec<[usize; 2]>,
    /// For every moment, the coefficient of u'Hu divided by the scale; entries off the diagonal count twice.
    wanted: Vec<Interval>,
    /// The same of u'u.
    unit: Vec<f64>,
    blocks: Vec<Block>,
    /// The first moments; `None` if no point in the region was found.
    first: Option<Vec<f64>>,
    /// The indices of t_k and its square among the monomials.
    of_sides: Vec<[usize; 2]>,
    /// A power of 2.
    scale: f64,
}

/// All monomials of so many variables up to a degree, the lowest first.
fn monomials(variables: usize, degree: u32) -> Vec<Vec<u32>> {
    let mut all = vec![Vec::new()];
    for _ in 0..variables {
        let longer = |begun: &Vec<u32>| {
            let left = degree - begun.iter().sum::<u32>();
            (0..=left).map(|power| [&begun[..], &[power]].concat()).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(longer).collect();
    }
    all.sort_by_key(|powers| powers.iter().sum::<u32>());
    all
}

fn sum_of(one: &[u32], other: &[u32]) -> Vec<u32> {
    one.iter().zip(other).map(|(a, b)| a + b).collect()
}

impl Program {
    /// A program for a symmetric matrix with `size` rows, from its entries on and above the diagonal row by row, each of a degree of at most twice
    /// `half`. `None` if it has too many moments or its coefficients are out of range.
    pub(super) fn new(entries: &[Polynomial], size: usize, weights: &[Weight], half: u32) -> Option<Self> {
        let variables = weights[0].terms[0].0.len();
        let all = monomials(variables, 2 * half);
        let pairs: Vec<[usize; 2]> = (0..size).flat_map(|a| (a..size).map(move |b| [a, b])).collect();
        let count = all.len() * pairs.len();
        let largest = entries.iter().flat_map(|entry| entry.values()).map(|value| value.magnitude()).fold(0.0, f64::max);
        let scale = largest.log2().ceil().exp2();
        // mutant `> to >=`: no number of moments is 2000: of its divisors 1 and 10 are numbers of pairs, and there are never 2000 or 200 monomials.
        if count > MOST_MOMENTS || !scale.is_normal() {
            return None;
        }
        let known: HashMap<&[u32], usize> = all.iter().enumerate().map(|(k, powers)| (&powers[..], k)).collect();
        let block = |weight: &Weight| {
            let of_basis = half - weight.degree().div_ceil(2);
            let basis = monomials(variables, of_basis);
            let rows = basis.len() * size;
            let product = |row: usize, column: usize| {
                known[&sum_of(&basis[row / size], &basis[column / size])[..]] * pairs.len()
                    + place(size, row % size, column % size)
            };
            let products = (0..rows * rows).map(|k| product(k / rows, k % rows)).collect();
            // The lowest monomials come first, so the products of the basis do too.
            let count = monomials(variables, 2 * of_basis).len() * pairs.len();
            let moment = |k: usize, (powers, factor): &(Vec<u32>, f64)| {
                (known[&sum_of(&all[k / pairs.len()], powers)[..]] * pairs.len() + k % pairs.len(), *factor)
            };
            let moments = (0..count).map(|k| weight.terms.iter().map(|term| moment(k, term)).collect()).collect();
            Block { rows, products, moments }
        };
        let blocks = weights.iter().filter(|weight| weight.degree() <= 2 * half).map(block).collect();
        let unit = (0..count).map(|k| if k < pairs.len() && pairs[k][0] == pairs[k][1] { 1.0 } else { 0.0 }).collect();
        let mut wanted = vec![Interval::point(0.0); count];
        for (k, (entry, [a, b])) in entries.iter().zip(&pairs).enumerate() {
            let times = Interval::point(if a == b { 1.0 } else { 2.0 } / scale);
            for (powers, value) in entry {
                wanted[known[&powers[..]] * pairs.len() + k] = *value * times;
            }
        }
        let power =
            |k: usize, power: u32| known[&(0..variables).map(|j| if j == k { power } else { 0 }).collect::<Vec<_>>()[..]];
        let of_sides = (0..variables).map(|k| [power(k, 1), power(k, 2)]).collect();
        let first = first_moments(&all, weights, &pairs, size);
        Some(Program { size, pairs, wanted, unit, blocks, first, of_sides, scale })
    }

    /// The matrices Z for these moments.
    fn matrices(&self, moments: &[f64]) -> Vec<Matrix> {
        let of_block = |block: &Block| {
            let value = |terms: &Vec<(usize, f64)>| terms.iter().map(|(k, factor)| factor * moments[*k]).sum::<f64>();
            let values: Vec<f64> = block.moments.iter().map(value).collect();
            Matrix { size: block.rows, entries: block.products.iter().map(|k| values[*k]).collect() }
        };
        self.blocks.iter().map(of_block).collect()
    }

    /// The coefficients of the sum of g v'Xv.
    fn coefficients(&self, squares: &[Matrix]) -> Vec<f64> {
        let mut sums = vec![0.0; self.wanted.len()];
        for (block, square) in self.blocks.iter().zip(squares) {
            let mut products = vec![0.0; block.moments.len()];
            block.products.iter().zip(&square.entries).for_each(|(k, x)| products[*k] += x);
            for (terms, product) in block.moments.iter().zip(&products) {
                terms.iter().for_each(|(k, factor)| sums[*k] += factor * product);
            }
        }
        sums
    }

    /// The equations of a step: the coefficients of the sum of g v'(X dZ Z^-1)v for every moment of dZ.
    fn equations(&self, squares: &[Matrix], inverses: &[Matrix]) -> Matrix {
        let mut equations = Matrix::zeros(self.wanted.len());
        for ((block, x), inverse) in self.blocks.iter().zip(squares).zip(inverses) {
            let rows = block.rows;
            let mut own = Matrix::zeros(block.moments.len());
            for i in 0..rows {
                for j in 0..=i {
                    let line = own.row_mut(block.products[i * rows + j]);
                    // An entry off the diagonal occurs at two places.
                    let twice = if i == j { 0.0 } else { 1.0 };
                    for k in 0..rows {
                        let (one, other) = (x.row(i)[k], twice * x.row(j)[k]);
                        let places = &block.products[k * rows..][..rows];
                        for ((place, z), mirrored) in places.iter().zip(inverse.row(j)).zip(inverse.row(i)) {
                            line[*place] += one * z + other * mirrored;
                        }
                    }
                }
            }
            for (k, terms) in block.moments.iter().enumerate() {
                for (at, factor) in terms {
                    let line = equations.row_mut(*at);
                    for (others, value) in block.moments.iter().zip(own.row(k)) {
                        others.iter().for_each(|(place, other)| line[*place] += factor * other * value);
                    }
                }
            }
        }
        equations.symmetric()
    }

    /// A bound of at least `aim`, or another result.
    pub(super) fn solved(&self, aim: f64, work: &mut Work) -> Outcome {
        let Some(mut moments) = self.first.clone() else {
            return Outcome::Open((0..self.of_sides.len()).map(|k| (k, 1.0)).collect());
        };
        let aim = aim / self.scale;
        let wanted: Vec<f64> = self.wanted.iter().map(|value| value.low.midpoint(value.high)).collect();
        let of_step = (self.wanted.len() as u64).pow(3);
        let mut z = self.matrices(&moments);
        let Some(mut x) = inverses(&z) else { return Outcome::Stopped };
        // mutant `MOST_STEPS doubled`: 15 are usual, and the steps of a program without a solution become too short earlier.
        // mutant `0 up`: likewise.
        for _ in 0..MOST_STEPS {
            // An upper bound of m below `aim` cannot be improved by further steps.
            if dot(&wanted, &moments) < aim {
                break;
            }
            if work.left < of_step {
                return Outcome::Stopped;
            }
            work.left -= of_step;
            let Some(equations) = Equations::of(self, &wanted, &x, &z) else { break };
            let step = equations.step();
            // Two candidates for the squares: near the centre of the cone, and near its boundary with a larger m.
            for (m, squares) in [equations.centre(), (step.m, step.whole(&x))] {
                // mutant `>= to >`: the proven bound is below m.
                let bound = if m >= aim { self.proven(&equations.refined(m, squares), m) } else { f64::NEG_INFINITY };
                if bound >= aim {
                    return Outcome::Bound(bound * self.scale);
                }
            }
            x = moved(&x, step.of_squares, &step.squares);
            moments.iter_mut().zip(&step.moments).for_each(|(moment, change)| *moment += step.of_moments * change);
            z = self.matrices(&moments);
            if step.is_too_short() {
                break;
            }
        }
        Outcome::Open(self.variances(&moments).into_iter().enumerate().collect())
    }

    /// The variance of every t, if the moments are those of a measure.
    fn variances(&self, moments: &[f64]) -> Vec<f64> {
        let pairs = self.pairs.len();
        let trace = |k: usize| dot(&self.unit[..pairs], &moments[k * pairs..][..pairs]);
        self.of_sides.iter().map(|[one, two]| trace(*two) - trace(*one).powi(2)).collect()
    }

    /// The proven bound for m and these squares, in units of the scale: m minus the norm of the remainder; minus infinity if a square is not proven
    /// positive semidefinite.
    pub(super) fn proven(&self, squares: &[Matrix], m: f64) -> f64 {
        if !squares.iter().all(Matrix::is_positive) {
            return f64::NEG_INFINITY;
        }
        let mut rest = self.wanted.clone();
        for (rest, unit) in rest.iter_mut().zip(&self.unit) {
            *rest = *rest - Interval::point(m * unit);
        }
        for (block, square) in self.blocks.iter().zip(squares) {
            let mut products = vec![Interval::point(0.0); block.moments.len()];
            for row in 0..block.rows {
                for column in 0..=row {
                    // Entries above the diagonal are not read, as in `is_positive`.
                    let times = if row == column { 1.0 } else { 2.0 };
                    let product = &mut products[block.products[row * block.rows + column]];
                    *product = *product + Interval::point(times * square.row(row)[column]);
                }
            }
            for (terms, product) in block.moments.iter().zip(&products) {
                terms.iter().for_each(|(k, factor)| rest[*k] = rest[*k] - Interval::point(*factor) * *product);
            }
        }
        // |t_k| is at most 1, so each entry of R is at most the sum of its coefficients, and the norm at most the largest row sum.
        let mut rows = vec![Interval::point(0.0); self.size];
        for (k, rest) in rest.iter().enumerate() {
            let magnitude = Interval::point(rest.magnitude());
            match self.pairs[k % self.pairs.len()] {
                // mutant `guard to false`: two halves are added to the same row, which is valid, and larger by at most an upward rounding.
                [a, b] if a == b => rows[a] = rows[a] + magnitude,
                both => both.into_iter().for_each(|a| rows[a] = rows[a] + magnitude.halved()),
            }
        }
        let norm = rows.iter().map(|row| row.high).fold(0.0, f64::max);
        less(m, norm)
    }
}

/// A lower bound of m minus the norm.
fn less(m: f64, norm: f64) -> f64 {
    (m - norm).next_down()
}

/// The linear equations at one point, for all directions.
struct Equations<'a> {
    program: &'a Program,
    wanted: &'a [f64],
    x: &'a [Matrix],
    z: &'a [Matrix],
    /// The inverses of z.
    inverse: Vec<Matrix>,
    factor: Factor,
    /// The solution for u'u.
    unit: Vec<f64>,
    /// The mean of the products of x and z; at the optimum it is the same for every row.
    mean: f64,
}

/// A change of the variables, and the possible step length.
struct Step {
    m: f64,
    squares: Vec<Matrix>,
    moments: Vec<f64>,
    dz: Vec<Matrix>,
    of_squares: f64,
    of_moments: f64,
}

impl Step {
    /// The squares after the whole change.
    fn whole(&self, from: &[Matrix]) -> Vec<Matrix> {
        moved(from, 1.0, &self.squares)
    }

    fn is_too_short(&self) -> bool {
        self.of_squares.max(self.of_moments) < SHORTEST
    }
}

/// The target of the corrector as a share of the mean, from the remaining products after the predictor.
fn share_of_mean(after: f64, before: f64) -> f64 {
    (after / before).clamp(0.0, 1.0).powi(3)
}

impl<'a> Equations<'a> {
    /// The equations at one point. `None` if by rounding a matrix is not positive definite.
    fn of(program: &'a Program, wanted: &'a [f64], x: &'a [Matrix], z: &'a [Matrix]) -> Option<Self> {
        let inverse = inverses(z)?;
        let mut equations = program.equations(x, &inverse);
        equations.increase_diagonal(DIAGONAL_INCREASE);
        let factor = equations.factor()?;
        let unit = factor.solved(&program.unit);
        let mean = products(x, z) / x.iter().map(|x| x.size as f64).sum::<f64>();
        Some(Equations { program, wanted, x, z, inverse, factor, unit, mean })
    }

    /// X dZ Z^-1, symmetric.
    fn bent(&self, x: &[Matrix], dz: &[Matrix]) -> Vec<Matrix> {
        (0..x.len()).map(|k| x[k].times(&dz[k]).times(&self.inverse[k]).symmetric()).collect()
    }

    /// The excess of these squares over the coefficients of u'(H - m I)u.
    fn excess(&self, squares: &[Matrix], m: f64) -> Vec<f64> {
        let mut excess = self.program.coefficients(squares);
        for ((excess, wanted), unit) in excess.iter_mut().zip(self.wanted).zip(&self.program.unit) {
            *excess += m * unit - wanted;
        }
        excess
    }

    /// The changes of m and of the moments for which the squares target - X dZ Z^-1 have the coefficients of u'(H - m I)u, while the moment of u'u
    /// stays the same: m, the moments, their matrices and the squares.
    fn direction(&self, targets: &[Matrix]) -> (f64, Vec<f64>, Vec<Matrix>, Vec<Matrix>) {
        let mut moments = self.factor.solved(&self.excess(targets, 0.0));
        let m = -dot(&self.program.unit, &moments) / dot(&self.program.unit, &self.unit);
        moments.iter_mut().zip(&self.unit).for_each(|(change, unit)| *change += m * unit);
        let dz = self.program.matrices(&moments);
        let squares = moved(targets, -1.0, &self.bent(self.x, &dz));
        (m, moments, dz, squares)
    }

    /// The squares for which all products of x and z equal their mean, with their m.
    fn centre(&self) -> (f64, Vec<Matrix>) {
        let targets: Vec<Matrix> = self.inverse.iter().map(|z| z.scaled(self.mean)).collect();
        let (m, _, _, squares) = self.direction(&targets);
        (m, squares)
    }

    /// The squares, corrected by the rounding error of the coefficients of u'(H - m I)u.
    fn refined(&self, m: f64, mut squares: Vec<Matrix>) -> Vec<Matrix> {
        for _ in 0..REFINEMENTS {
            let missing = self.program.matrices(&self.factor.solved(&self.excess(&squares, m)));
            squares = moved(&squares, -1.0, &self.bent(self.x, &missing));
        }
        squares
    }

    /// The predictor step towards products of 0, then the corrector towards their mean.
    fn step(&self) -> Step {
        let nothing: Vec<Matrix> = self.x.iter().map(|x| Matrix::zeros(x.size)).collect();
        let tried = self.step_to(&nothing);
        let after = products(&moved(self.x, tried.of_squares, &tried.squares), &moved(self.z, tried.of_moments, &tried.dz));
        let share = share_of_mean(after, products(self.x, self.z));
        let centre: Vec<Matrix> = self.inverse.iter().map(|z| z.scaled(share * self.mean)).collect();
        self.step_to(&moved(&centre, -1.0, &self.bent(&tried.squares, &tried.dz)))
    }

    fn step_to(&self, targets: &[Matrix]) -> Step {
        let (m, moments, dz, squares) = self.direction(targets);
        let squares = moved(&squares, -1.0, self.x);
        let (of_squares, of_moments) = (longest(self.x, &squares), longest(self.z, &dz));
        Step { m, squares, moments, dz, of_squares, of_moments }
    }
}

/// The moments of points in the region, with all directions of u equally likely.
fn first_moments(all: &[Vec<u32>], weights: &[Weight], pairs: &[[usize; 2]], size: usize) -> Option<Vec<f64>> {
    let mut random = Random::new(0);
    let (mut sums, mut count) = (vec![0.0; all.len()], 0.0);
    for _ in 0..POINTS {
        let point: Vec<f64> = all[0].iter().map(|_| 2.0 * random.share() - 1.0).collect();
        let value = |powers: &[u32]| {
            let power = |(t, power): (&f64, &u32)| (0..*power).fold(1.0, |product, _| product * t);
            point.iter().zip(powers).map(power).product::<f64>()
        };
        let of_weight = |weight: &Weight| weight.terms.iter().map(|(powers, factor)| factor * value(powers)).sum::<f64>();
        if weights.iter().all(|weight| of_weight(weight) > 0.0) {
            count += 1.0;
            sums.iter_mut().zip(all).for_each(|(sum, powers)| *sum += value(powers));
        }
    }
    let of_pair = |sum: f64, [a, b]: &[usize; 2]| if a == b { sum / (count * size as f64) } else { 0.0 };
    (count > 0.0).then(|| sums.iter().flat_map(|sum| pairs.iter().map(|pair| of_pair(*sum, pair))).collect())
}

fn inverses(matrices: &[Matrix]) -> Option<Vec<Matrix>> {
    matrices.iter().map(|matrix| Some(matrix.factor()?.inverse())).collect()
}

fn products(x: &[Matrix], z: &[Matrix]) -> f64 {
    x.iter().zip(z).map(|(x, z)| dot(&x.entries, &z.entries)).sum()
}

fn moved(from: &[Matrix], share: f64, by: &[Matrix]) -> Vec<Matrix> {
    from.iter().zip(by).map(|(from, by)| from.plus(share, by)).collect()
}

/// The share of a change, at most 1, for which every matrix stays positive definite.
fn longest(from: &[Matrix], by: &[Matrix]) -> f64 {
    let mut tried = 1.0 / SHARE_OF_WAY;
    // mutant `>= to >`: no power of 0.9 is equal to a ten-thousandth.
    while tried * SHARE_OF_WAY >= SHORTEST {
        if from.iter().zip(by).all(|(from, by)| from.plus(tried, by).factor().is_some()) {
            return tried * SHARE_OF_WAY;
        }
        tried *= SHORTER;
    }
    0.0
}

#[cfg(test)]
mod tests;
