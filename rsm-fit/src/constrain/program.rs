//! The least-distance program: the shortest c with n_k . c >= d_k for every row k.
//!
//! In: rows of unit normals in double-double. Out: c in double-double with the active rows, or that there is none. The interior-point solver clarabel
//! finds the active rows with about 10 digits. The answer then solves the equations of the active rows in double-double, and every sign and every
//! other row is checked. So the last bit of a coefficient does not depend on the solver.
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

/// The result of a program.
#[derive(Debug)]
pub(super) enum Solution {
    /// The shortest c, and the active rows.
    Shortest { c: Vec<Dd>, active: Vec<usize> },
    /// There is none: the rows contradict one another.
    Infeasible,
    /// The solver failed.
    Failed,
}

/// The gap and the infeasibility at which the solver stops: three digits beyond what is needed to select the active rows.
const TOLERANCE: f64 = 1e-10;

/// A multiplier below this share of the largest counts as zero.
const NO_MULTIPLIER: f64 = 1e-6;

/// The largest number of changes of the active rows. Usually there are at most as many as rows, often ten.
const MOST_CHANGES: usize = 300;

/// The allowed violation of a row, as a share of the largest distance. The double-double equations have an error of 10^-25 of it.
const ALLOWED_VIOLATION: f64 = 1e-16;

/// A pivot below this is rounding error: the row depends on the others.
const NO_PIVOT: f64 = 1e-24;

/// Solves the program.
pub(super) fn shortest(rows: &[Row], width: usize) -> Solution {
    let largest = rows.iter().map(|row| row.distance.to_f64()).fold(0.0, f64::max);
    if largest == 0.0 {
        return Solution::Shortest { c: vec![Dd::ZERO; width], active: Vec::new() };
    }
    // The solver's result is only a guess of the active rows, which is refined. A few digits more or less change nothing.
    let settings = DefaultSettingsBuilder::default()
        .verbose(false) // mutant `false to true`: prints.
        // mutant `1 up`: the number of threads changes no result of this size.
        // mutant `1 down`: likewise, 0 lets the solver choose the number.
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
    // mutant `> to >=`: a multiplier exactly at the limit, from a solver that is accurate to eight digits.
    // mutant `NO_MULTIPLIER doubled`: multipliers of active rows are far above the limit, others far below.
    // mutant `* to /`: the largest is about 1, and the guess is refined.
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

/// The matrix of -normal, stored by columns.
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

/// Refines a guess of the active rows: a row with a negative multiplier is removed, and a violated row is added, in exchange for another one if it
/// depends on the active rows. `None` if that does not end, or if the rows contradict one another.
fn polished(rows: &[Row], width: usize, mut active: Vec<usize>, largest: f64) -> Option<(Vec<Dd>, Vec<usize>)> {
    // mutant `0 up`: one change less of very many, which no known program needs.
    // mutant `MOST_CHANGES doubled`: more changes than needed.
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
        if excess(worst) <= ALLOWED_VIOLATION * largest {
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

/// The active row to exchange for a row whose normal is the sum of these shares of the active normals. As the new multiplier grows, the others fall
/// in proportion to the shares. The one that reaches 0 first is removed, so that none becomes negative and c only becomes longer (Goldfarb, Idnani
/// 1983, Math. Programming 27). `None` if no share is positive: then the rows contradict one another.
fn leaving(multipliers: &[Dd], shares: &[Dd]) -> Option<usize> {
    let until = |k: &usize| (multipliers[*k] / shares[*k]).to_f64();
    // A share below the square root of a pivot is rounding error.
    // mutant `> to >=`: a share exactly at the limit.
    let falls = |k: &usize| shares[*k].to_f64() > NO_PIVOT.sqrt();
    (0..shares.len()).filter(falls).min_by(|a, b| until(a).total_cmp(&until(b)))
}

fn product(a: &[Dd], b: &[Dd]) -> Dd {
    a.iter().zip(b).map(|(x, y)| *x * *y).sum()
}

/// Cholesky's factor of the inner products of the active normals, row by row.
struct Factor(Vec<Vec<Dd>>);

impl Factor {
    /// The factor of these rows. Rows that depend on earlier ones are removed from `active`.
    fn of(rows: &[Row], active: &mut Vec<usize>) -> Self {
        let mut factor = Factor(Vec::new());
        let mut kept: Vec<usize> = Vec::new();
        for k in active.iter() {
            let (mut line, pivot) = factor.line(rows, &kept, *k);
            // mutant `> to >=`: a pivot exactly at the limit.
            if pivot.to_f64() > NO_PIVOT {
                line.push(pivot.sqrt());
                factor.0.push(line);
                kept.push(*k);
            }
        }
        *active = kept;
        factor
    }

    /// The line of one more row, and the square of the component of its normal that is independent of the others.
    fn line(&self, rows: &[Row], active: &[usize], k: usize) -> (Vec<Dd>, Dd) {
        let mut line: Vec<Dd> = Vec::new();
        for (j, other) in active.iter().enumerate() {
            let known: Dd = self.0[j][..j].iter().zip(&line).map(|(x, y)| *x * *y).sum();
            line.push((product(&rows[k].normal, &rows[*other].normal) - known) / self.0[j][j]);
        }
        let pivot = product(&rows[k].normal, &rows[k].normal) - line.iter().map(|x| *x * *x).sum();
        (line, pivot)
    }

    /// Whether the normal of a row depends on the active normals.
    fn holds(&self, rows: &[Row], active: &[usize], k: usize) -> bool {
        // mutant `<= to <`: a pivot exactly at the limit.
        self.line(rows, active, k).1.to_f64() <= NO_PIVOT
    }

    /// The shares of the active normals whose sum is nearest to the normal of a row.
    fn shares(&self, rows: &[Row], active: &[usize], k: usize) -> Vec<Dd> {
        self.solved(active.iter().map(|other| product(&rows[*other].normal, &rows[k].normal)))
    }

    /// The solution of the system with this right-hand side. With the rows' distances, it gives the multipliers for which every active row is met
    /// exactly.
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
