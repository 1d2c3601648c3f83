//! A proof by weighted sums of squares that a symmetric matrix of polynomials is positive semidefinite over a region.
//!
//! In: the entries of H(x), the box and the half-spaces of the region. Out: a lower bound of all eigenvalues of H(x) in the region, or `None`. Does
//! not search for points where H is not positive semidefinite.
//!
//! Branch and bound encloses H in cells. If its smallest eigenvalue is close to 0 along whole curves or surfaces of x, the number of cells grows with
//! a power of 1/distance from 0. A sum of squares needs no cells. With x = c + h t, so that every t_k is in [-1, 1],
//!
//! ```text
//! u'(H(x) - m I)u = sum over k of g_k(t) v_k'X_k v_k + u'R(t)u,    v_k = u times every monomial of t up to a degree
//! ```
//!
//! with weights g_k that are not negative in the region (`region.rs`) and positive semidefinite X_k: m minus the norm of R is a bound. For a matrix
//! that is positive definite over the region such sums exist if the degree is high enough (Putinar 1993, Indiana Univ. Math. J. 42; for matrices
//! Scherer, Hol 2006, Math. Programming 107). The largest m of a degree is a semidefinite program (Parrilo 2003, Math. Programming 96; `moments.rs`).
//! If the lowest degree and the next one are not sufficient, the region is halved, and each half gets its own squares.

mod matrix;
mod moments;
mod region;

use rsm_core::bernstein::Monomial;
use rsm_core::interval::Interval;
use rsm_core::model::HalfSpace;

use moments::{Outcome, Program};
use region::{Polynomial, Scaling};

/// The largest number of cells of one proof. Tested surfaces of four inputs took at most 11.
const MOST_CELLS: usize = 64;

/// The remaining multiplications, approximately. A step of a program counts the cube of its number of unknown moments.
pub(super) struct Work {
    pub left: u64,
}

/// A lower bound of the eigenvalues of the matrix with these entries (on and above its diagonal, row by row), over the part of the box in which the
/// half-spaces hold. It is at least `aim`; `None` if the work was not sufficient for that.
pub(super) fn least_eigenvalue(
    entries: &[Vec<Monomial>],
    sides: &[Interval],
    spaces: &[HalfSpace],
    aim: f64,
    work: &mut Work,
) -> Option<f64> {
    in_cells(entries, sides, spaces, aim, work, MOST_CELLS)
}

/// The same with a limited number of cells.
fn in_cells(
    entries: &[Vec<Monomial>],
    sides: &[Interval],
    spaces: &[HalfSpace],
    aim: f64,
    work: &mut Work,
    mut left: usize,
) -> Option<f64> {
    let mut least = f64::INFINITY;
    let mut cells = vec![sides.to_vec()];
    while let Some(cell) = cells.pop() {
        match of_cell(entries, &cell, spaces, aim, work) {
            Outcome::Bound(bound) => least = least.min(bound),
            Outcome::Open(spreads) => {
                // Both halves are added to the waiting cells.
                left = left.checked_sub(2)?;
                let axis = widest(&cell, sides, &spreads)?;
                let middle = cell[axis].low.midpoint(cell[axis].high);
                for half in [Interval::new(cell[axis].low, middle), Interval::new(middle, cell[axis].high)] {
                    let mut part = cell.clone();
                    part[axis] = half;
                    cells.push(part);
                }
            }
            Outcome::Stopped => return None,
        }
    }
    Some(least)
}

/// The variable with the largest variation in a cell, as a share of its side; of equal ones the first.
fn widest(cell: &[Interval], sides: &[Interval], spreads: &[(usize, f64)]) -> Option<usize> {
    let share = |k: usize| (cell[k].high - cell[k].low) / (sides[k].high - sides[k].low);
    let variance = |(k, of_cell): &(usize, f64)| of_cell * share(*k).powi(2);
    let (axis, _) = spreads.iter().reduce(|one, other| if variance(other) > variance(one) { other } else { one })?;
    Some(*axis)
}

/// The number of rows of a symmetric matrix with this many entries on and above its diagonal.
fn rows_of(entries: usize) -> usize {
    // mutant `1 down`: every matrix has an entry.
    (1..).find(|rows| rows * (rows + 1) / 2 == entries).expect("a matrix has a size")
}

/// The index of an entry of a symmetric matrix among those on and above its diagonal, row by row.
fn place(size: usize, a: usize, b: usize) -> usize {
    let (row, column) = (a.min(b), a.max(b));
    row * size - row * (row + 1) / 2 + column
}

fn of_cell(entries: &[Vec<Monomial>], sides: &[Interval], spaces: &[HalfSpace], aim: f64, work: &mut Work) -> Outcome {
    let size = rows_of(entries.len());
    let scaling = Scaling::of(sides);
    let entries: Vec<Polynomial> = entries.iter().map(|entry| scaling.polynomial(entry)).collect();
    let entry = |a: usize, b: usize| &entries[place(size, a, b)];
    let live: Vec<usize> = (0..size).filter(|a| (0..size).any(|b| !entry(*a, b).is_empty())).collect();
    // An input without curvature has the eigenvalue 0 exactly.
    let most = if live.len() < size { 0.0 } else { f64::INFINITY };
    if most < aim {
        return Outcome::Stopped;
    }
    let powers = |k: usize| entries.iter().flat_map(|entry| entry.keys()).map(move |powers| powers[k]);
    let axes: Vec<usize> = (0..sides.len()).filter(|k| powers(*k).any(|power| power > 0)).collect();
    // H depends on no other variables, so a half-space with one of them is left out.
    let kept = |powers: &Vec<u32>| axes.iter().map(|k| powers[*k]).collect::<Vec<u32>>();
    let of_live = |(k, a): (usize, &usize)| live[k..].iter().map(|b| entry(*a, *b)).collect::<Vec<_>>();
    let matrix: Vec<Polynomial> = live
        .iter()
        .enumerate()
        .flat_map(of_live)
        .map(|entry| entry.iter().map(|(powers, value)| (kept(powers), *value)).collect())
        .collect();
    let Some(weights) = scaling.weights(spaces, &axes) else { return Outcome::Bound(f64::INFINITY) };
    let degree = matrix.iter().flat_map(|entry| entry.keys()).map(|powers| powers.iter().sum::<u32>()).max();
    let Some(degree) = degree else { return Outcome::Bound(most) };
    // mutant `1 down`: a matrix of degree 0 has no variables, and then only the monomial 1 at every degree.
    let least = degree.div_ceil(2).max(1);
    let mut outcome = Outcome::Stopped;
    for half in [least, least + 1] {
        let Some(program) = Program::new(&matrix, live.len(), &weights, half) else { break };
        outcome = match program.solved(aim, work) {
            Outcome::Bound(found) => return Outcome::Bound(found.min(most)),
            Outcome::Open(spreads) => Outcome::Open(spreads.into_iter().map(|(k, spread)| (axes[k], spread)).collect()),
            Outcome::Stopped => return Outcome::Stopped,
        };
    }
    outcome
}

#[cfg(test)]
mod tests;
