//! The quadratic program of a step.
//!
//! In: groups of linear pieces, a curvature, a box for the step. Out: the step, the value that it predicts and the multiplier of each piece, by the
//! interior-point solver clarabel. With the variable z of a group: minimise sum of weight z + 1/2 d'B d under z >= value + gradient . d.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};
use nalgebra::DMatrix;

use super::pieces::{Group, Piece};

/// The program.
pub(super) struct Program<'a> {
    /// The pieces at the beginning of the step.
    pub groups: &'a [Group],
    /// Other values of the pieces, for a second-order correction.
    pub shift: Option<&'a [Group]>,
    /// The curvature; zero if there is none.
    pub curvature: Option<&'a DMatrix<f64>>,
    /// The box of the step.
    pub ends: Vec<[f64; 2]>,
}

/// A step.
pub(super) struct Step {
    pub step: Vec<f64>,
    /// The predicted value of the function.
    pub value: f64,
    /// The multipliers of the pieces, group by group: their sum is the weight of the group.
    pub multipliers: Vec<Vec<f64>>,
}

/// The gap and the infeasibility at which the solver stops. A step needs some digits; the search corrects the rest.
const TOLERANCE: f64 = 1e-11;

/// Solves the program. `None` if the solver failed.
pub(super) fn solve(program: &Program<'_>) -> Option<Step> {
    let (n, m) = (program.ends.len(), program.groups.len());
    let mut columns: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n + m];
    let mut bounds = Vec::new();
    for (g, group) in program.groups.iter().enumerate() {
        for (k, piece) in group.pieces.iter().enumerate() {
            let row = bounds.len();
            for (column, slope) in columns.iter_mut().zip(&piece.gradient).filter(|(_, slope)| **slope != 0.0) {
                column.push((row, *slope));
            }
            columns[n + g].push((row, -1.0));
            let value = program.shift.map_or(piece.value, |shift| shift[g].pieces[k].value);
            bounds.push(-value);
        }
    }
    let pieces = bounds.len();
    for (k, [low, high]) in program.ends.iter().enumerate() {
        columns[k].push((bounds.len(), 1.0));
        columns[k].push((bounds.len() + 1, -1.0));
        bounds.extend([*high, -low]);
    }
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in &columns {
        rows.extend(column.iter().map(|(row, _)| *row));
        values.extend(column.iter().map(|(_, value)| *value));
        starts.push(rows.len());
    }
    let matrix = CscMatrix::new(bounds.len(), n + m, starts, rows, values);
    let quadratic = upper(program.curvature, n, m);
    let mut cost = vec![0.0; n];
    cost.extend(program.groups.iter().map(|group| group.weight));
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_threads(1)
        .tol_gap_abs(TOLERANCE)
        .tol_gap_rel(TOLERANCE)
        .tol_feas(TOLERANCE)
        .build()
        .expect("the settings are ours");
    let cones = [NonnegativeConeT(bounds.len())];
    let mut solver = DefaultSolver::new(&quadratic, &cost, &matrix, &bounds, &cones, settings).ok()?;
    solver.solve();
    let found = &solver.solution;
    let is_solved = matches!(
        found.status,
        SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress | SolverStatus::MaxIterations
    );
    if !is_solved || found.x.iter().chain(&found.z).any(|x| !x.is_finite()) {
        return None;
    }
    let inside = |(d, [low, high]): (&f64, &[f64; 2])| d.clamp(*low, *high);
    let step: Vec<f64> = found.x[..n].iter().zip(&program.ends).map(inside).collect();
    // The value of the step itself, without the inaccuracy of the solver's z.
    let of_group = |(g, group): (usize, &Group)| {
        let of_piece = |(k, piece): (usize, &Piece)| {
            let value = program.shift.map_or(piece.value, |shift| shift[g].pieces[k].value);
            value + piece.gradient.iter().zip(&step).map(|(slope, d)| slope * d).sum::<f64>()
        };
        group.weight * group.pieces.iter().enumerate().map(of_piece).fold(f64::NEG_INFINITY, f64::max)
    };
    let bent = program.curvature.map_or(0.0, |b| {
        let d = nalgebra::DVector::from_column_slice(&step);
        0.5 * d.dot(&(b * &d))
    });
    let value = program.groups.iter().enumerate().map(of_group).sum::<f64>() + bent;
    let mut weights = found.z[..pieces].iter().map(|z| z.max(0.0));
    let of_one = |group: &Group| weights.by_ref().take(group.pieces.len()).collect();
    let multipliers = program.groups.iter().map(of_one).collect();
    Some(Step { step, value, multipliers })
}

/// The upper triangle of the curvature, with zeros for the other variables.
fn upper(curvature: Option<&DMatrix<f64>>, n: usize, more: usize) -> CscMatrix<f64> {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..n + more {
        if let Some(b) = curvature.filter(|_| column < n) {
            for row in 0..=column {
                rows.push(row);
                values.push(b[(row, column)]);
            }
        }
        starts.push(rows.len());
    }
    CscMatrix::new(n + more, n + more, starts, rows, values)
}
