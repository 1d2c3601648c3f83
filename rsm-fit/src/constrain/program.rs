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

/// From a guess of the active rows to the exact ones: a row with a negative multiplier leaves, a row that is missed comes in, in exchange for another where
/// the active ones already hold its direction. None when that does not end, or the rows contradict each other.
fn polished(rows: &[Row], width: usize, mut active: Vec<usize>, largest: f64) -> Option<(Vec<Dd>, Vec<usize>)> {
    // mutant `0 up`: one change of very many that no program is known to need.
    // mutant `MOST_CHANGES doubled`: more of them.
    for _ in 0..MOST_CHANGES {
        let factor = Factor::of(rows, &mut active);
        let multipliers = factor.solved(active.iter().map(|k| rows[*k].distance));
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
        if factor.holds(rows, &active, worst) {
            let place = leaving(&multipliers, &factor.shares(rows, &active, worst))?;
            active.remove(place);
        }
        active.push(worst);
    }
    None
}

/// The active row that leaves for one whose normal is the sum of these shares of theirs: as the new multiplier grows, theirs fall by the shares, and the one that
/// reaches 0 first leaves, so that none gets negative and c only gets longer (Goldfarb, Idnani 1983, Math. Programming 27). None where no share is positive: then the
/// rows contradict each other.
fn leaving(multipliers: &[Dd], shares: &[Dd]) -> Option<usize> {
    let until = |k: &usize| (multipliers[*k] / shares[*k]).to_f64();
    // A share below the root of a pivot is what rounding leaves of zero.
    // mutant `> to >=`: a share of just so much, to the last bit.
    let falls = |k: &usize| shares[*k].to_f64() > NO_PIVOT.sqrt();
    (0..shares.len()).filter(falls).min_by(|a, b| until(a).total_cmp(&until(b)))
}

fn product(a: &[Dd], b: &[Dd]) -> Dd {
    a.iter().zip(b).map(|(x, y)| *x * *y).sum()
}

/// Cholesky's factor of the products of the active rows' normals, a line a row.
struct Factor(Vec<Vec<Dd>>);

impl Factor {
    /// Rows that depend on earlier ones are dropped.
    fn of(rows: &[Row], active: &mut Vec<usize>) -> Self {
        let mut factor = Factor(Vec::new());
        let mut kept: Vec<usize> = Vec::new();
        for k in active.iter() {
            let (mut line, pivot) = factor.line(rows, &kept, *k);
            // mutant `> to >=`: a pivot of just so much, to the last bit.
            if pivot.to_f64() > NO_PIVOT {
                line.push(pivot.sqrt());
                factor.0.push(line);
                kept.push(*k);
            }
        }
        *active = kept;
        factor
    }

    /// The line of one more row, and the square of the part of its normal that the others do not hold.
    fn line(&self, rows: &[Row], active: &[usize], k: usize) -> (Vec<Dd>, Dd) {
        let mut line: Vec<Dd> = Vec::new();
        for (j, other) in active.iter().enumerate() {
            let known: Dd = self.0[j][..j].iter().zip(&line).map(|(x, y)| *x * *y).sum();
            line.push((product(&rows[k].normal, &rows[*other].normal) - known) / self.0[j][j]);
        }
        let pivot = product(&rows[k].normal, &rows[k].normal) - line.iter().map(|x| *x * *x).sum();
        (line, pivot)
    }

    /// Whether the normal of a row depends on those of the active ones.
    fn holds(&self, rows: &[Row], active: &[usize], k: usize) -> bool {
        // mutant `<= to <`: a pivot of just so much, to the last bit.
        self.line(rows, active, k).1.to_f64() <= NO_PIVOT
    }

    /// The shares of the active rows' normals whose sum is nearest to the normal of a row.
    fn shares(&self, rows: &[Row], active: &[usize], k: usize) -> Vec<Dd> {
        self.solved(active.iter().map(|other| product(&rows[*other].normal, &rows[k].normal)))
    }

    /// The solution of the system with these products: with the rows' distances on the right, the multipliers that put every active row at its distance.
    fn solved(&self, right: impl Iterator<Item = Dd>) -> Vec<Dd> {
        let factor = &self.0;
        let mut solved: Vec<Dd> = Vec::new();
        for (line, right) in factor.iter().zip(right) {
            let known: Dd = line.iter().zip(&solved).map(|(x, y)| *x * *y).sum();
            solved.push((right - known) / line[solved.len()]);
        }
        for k in (0..solved.len()).rev() {
            let known: Dd = (k + 1..solved.len()).map(|j| factor[j][k] * solved[j]).sum();
            solved[k] = (solved[k] - known) / factor[k][k];
        }
        solved
    }
}

#[cfg(test)]
mod tests;
