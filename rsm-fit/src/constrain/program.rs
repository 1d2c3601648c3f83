//! The least-distance program: the shortest c with n_k . c >= d_k for every row k.
//!
//! In: rows of unit normals in double-double. Out: c in double-double with the rows that hold it, or that there is none. The
//! interior-point solver clarabel finds which rows are active, to some 10 digits; the answer itself then solves the equations of
//! the active rows in double-double, and every sign and every other row is checked. So the last bit of a coefficient does not
//! hang on the path of the solver.
//!
//! Source: Lawson, Hanson, Solving Least Squares Problems, chapter 23 (constrained least squares as least distance).

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};

use crate::dd::Dd;

/// normal . c >= distance, with a normal of length 1.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub normal: Vec<Dd>,
    pub distance: Dd,
}

/// What became of a program.
#[derive(Debug)]
pub(super) enum Solution {
    /// The shortest c, and the rows that hold it.
    Shortest { c: Vec<Dd>, active: Vec<usize> },
    /// There is none: rows contradict each other.
    Infeasible,
    /// The solver gave up.
    Failed,
}

/// Gap and feasibility at which the solver stops: three digits beyond what picks the active rows.
const TOLERANCE: f64 = 1e-10;

/// A multiplier below this share of the largest is none.
const NO_MULTIPLIER: f64 = 1e-6;

/// Changes of the active rows before they are given up: as many as there are rows at most are usual, ten of them often.
const MOST_CHANGES: usize = 300;

/// A row may be missed by this share of the largest distance: the double-double equations leave 10^-25 of it.
const MISSED: f64 = 1e-16;

/// A pivot below this is what rounding leaves of zero: the row depends on the others.
const NO_PIVOT: f64 = 1e-24;

/// Solves the program.
pub(super) fn shortest(rows: &[Row], width: usize) -> Solution {
    let largest = rows.iter().map(|row| row.distance.to_f64()).fold(0.0, f64::max);
    if largest == 0.0 {
        return Solution::Shortest { c: vec![Dd::ZERO; width], active: Vec::new() };
    }
    // What the solver finds is a guess of the active rows, which is polished: a little more or less of its digits changes no answer.
    let settings = DefaultSettingsBuilder::default()
        .verbose(false) // mutant `false to true`: prints.
        // mutant `1 up`: how many threads share the work changes no result of this size.
        // mutant `1 down`: likewise, 0 leaves the number to the solver.
        .max_threads(1)
        .tol_gap_abs(TOLERANCE) // mutant `TOLERANCE doubled`: a guess, see above.
        .tol_gap_rel(TOLERANCE) // mutant `TOLERANCE doubled`: likewise.
        .tol_feas(TOLERANCE) // mutant `TOLERANCE doubled`: likewise.
        .build()
        .expect("the settings are ours");
    let bounds: Vec<f64> = rows.iter().map(|row| -(row.distance / Dd::from(largest)).to_f64()).collect();
    let cones = [NonnegativeConeT(rows.len())];
    let (identity, matrix) = (CscMatrix::identity(width), negated(rows, width));
    let Ok(mut solver) = DefaultSolver::new(&identity, &vec![0.0; width], &matrix, &bounds, &cones, settings) else {
        return Solution::Failed;
    };
    solver.solve();
    let found = &solver.solution;
    let heaviest = found.z.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // mutant `> to >=`: a multiplier of just the share, to the last bit, of a solver whose ninth digit is not right.
    // mutant `NO_MULTIPLIER doubled`: multipliers of rows that matter lie far above it, those of others far below.
    // mutant `* to /`: the heaviest is about 1, and a guess is polished.
    let is_heavy = |k: &usize| found.z[*k] > NO_MULTIPLIER * heaviest;
    match found.status {
        SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => Solution::Infeasible,
        SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress => {
            let guess: Vec<usize> = (0..rows.len()).filter(is_heavy).collect();
            match polished(rows, width, guess.clone(), largest) {
                Some((c, active)) => Solution::Shortest { c, active },
                None => {
                    let c = found.x.iter().map(|x| Dd::from(*x) * Dd::from(largest)).collect();
                    Solution::Shortest { c, active: guess }
                }
            }
        }
        _ => Solution::Failed,
    }
}

/// The matrix of -normal by columns.
fn negated(rows: &[Row], width: usize) -> CscMatrix<f64> {
    let (mut starts, mut places, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..width {
        for (k, row) in rows.iter().enumerate() {
            let value = -row.normal[column].to_f64();
            if value != 0.0 {
                places.push(k);
                values.push(value);
            }
        }
        starts.push(places.len());
    }
    CscMatrix::new(rows.len(), width, starts, places, values)
}

/// From a guess of the active rows to the exact ones: a row with a negative multiplier leaves, a row that is missed comes in. None
/// when that does not end.
fn polished(rows: &[Row], width: usize, mut active: Vec<usize>, largest: f64) -> Option<(Vec<Dd>, Vec<usize>)> {
    // mutant `0 up`: one change of very many that no program is known to need.
    // mutant `MOST_CHANGES doubled`: more of them.
    for _ in 0..MOST_CHANGES {
        let multipliers = multipliers(rows, &mut active);
        let least = (0..active.len()).min_by(|a, b| multipliers[*a].to_f64().total_cmp(&multipliers[*b].to_f64()));
        if let Some(least) = least.filter(|k| multipliers[*k] < Dd::ZERO) {
            active.remove(least);
            continue;
        }
        let mut c = vec![Dd::ZERO; width];
        for (k, multiplier) in active.iter().zip(&multipliers) {
            for (entry, n) in c.iter_mut().zip(&rows[*k].normal) {
                *entry += *multiplier * *n;
            }
        }
        let excess = |k: usize| (rows[k].distance - product(&rows[k].normal, &c)).to_f64();
        let worst = (0..rows.len()).max_by(|a, b| excess(*a).total_cmp(&excess(*b)))?;
        if excess(worst) <= MISSED * largest {
            return Some((c, active));
        }
        if active.contains(&worst) {
            return None;
        }
        active.push(worst);
    }
    None
}

fn product(a: &[Dd], b: &[Dd]) -> Dd {
    a.iter().zip(b).map(|(x, y)| *x * *y).sum()
}

/// The multipliers that put every active row at its distance, by Cholesky's factors of their products. Rows that depend on earlier
/// ones are dropped.
fn multipliers(rows: &[Row], active: &mut Vec<usize>) -> Vec<Dd> {
    let mut factor: Vec<Vec<Dd>> = Vec::new();
    let mut kept: Vec<usize> = Vec::new();
    for k in active.iter() {
        let mut line: Vec<Dd> = Vec::new();
        for (j, other) in kept.iter().enumerate() {
            let known: Dd = factor[j][..j].iter().zip(&line).map(|(x, y)| *x * *y).sum();
            line.push((product(&rows[*k].normal, &rows[*other].normal) - known) / factor[j][j]);
        }
        let pivot = product(&rows[*k].normal, &rows[*k].normal) - line.iter().map(|x| *x * *x).sum();
        // mutant `> to >=`: a pivot of just so much, to the last bit.
        if pivot.to_f64() > NO_PIVOT {
            line.push(pivot.sqrt());
            factor.push(line);
            kept.push(*k);
        }
    }
    *active = kept;
    let mut solved: Vec<Dd> = Vec::new();
    for (line, k) in factor.iter().zip(active.iter()) {
        let known: Dd = line.iter().zip(&solved).map(|(x, y)| *x * *y).sum();
        solved.push((rows[*k].distance - known) / line[solved.len()]);
    }
    for k in (0..solved.len()).rev() {
        let known: Dd = (k + 1..solved.len()).map(|j| factor[j][k] * solved[j]).sum();
        solved[k] = (solved[k] - known) / factor[k][k];
    }
    solved
}

#[cfg(test)]
mod tests;
