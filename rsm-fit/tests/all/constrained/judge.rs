//! Two judges of a fit with constraints: the largest violation that dense points find, and a lower bound of the smallest residual sum of squares.
//!
//! The lower bound is the optimum of a quadratic program with the constraints at some points only (clarabel). Points where its solution violates a
//! constraint are added until it is near enough, so it is a valid bound at every moment.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT};
use nalgebra::{DMatrix, DVector};
use rsm_core::model::HalfSpace;
use rsm_fit::random::Random;

use super::draw::{Asked, Problem};
use super::surface::{Entry, Function};

/// A row n of the terms with n . b >= d.
type Row = (Vec<f64>, f64);

/// A problem with the region in which it was fitted.
pub struct Judge<'a> {
    pub problem: &'a Problem,
    /// In the variables.
    pub support: &'a [HalfSpace],
}

/// The rows of one violation, its size, and its place as shares of the sides.
struct Broken {
    missing: f64,
    shares: Vec<f64>,
    row: Row,
}

impl Judge<'_> {
    fn is_inside(&self, x: &[f64]) -> bool {
        let t = self.problem.basis.variables(x);
        let holds = |space: &HalfSpace| space.normal.iter().zip(&t).map(|(n, t)| n * t).sum::<f64>() <= space.bound;
        self.support.iter().all(holds)
    }

    /// The rows of a constraint at a point; of a curvature, the direction of the smallest one for these coefficients.
    fn rows(&self, asked: &Asked, x: &[f64], b: &[f64]) -> Vec<Row> {
        let basis = &self.problem.basis;
        let scaled = |row: Vec<f64>, sign: f64| row.iter().map(|v| sign * v).collect::<Vec<f64>>();
        match *asked {
            Asked::Bounds(low, high) => {
                let is_odd = basis.axes.iter().any(|axis| axis.entry == Entry::Odd);
                let opposite = |bound: Option<f64>| bound.filter(|_| is_odd).map(|bound| -bound);
                let value = basis.row(x, &[], true);
                let lows = [low, opposite(high)].into_iter().flatten().map(|low| (value.clone(), low));
                let highs = [high, opposite(low)].into_iter().flatten().map(|high| (scaled(value.clone(), -1.0), -high));
                lows.chain(highs).collect()
            }
            Asked::Monotone(input, sign) => {
                let side = |is_above| (scaled(basis.row(x, &[input], is_above), sign), 0.0);
                vec![side(false), side(true)]
            }
            Asked::Bent(sign) => {
                let inputs = basis.axes.len();
                let second: Vec<Vec<Vec<f64>>> =
                    (0..inputs).map(|a| (0..inputs).map(|c| scaled(basis.row(x, &[a, c], true), sign)).collect()).collect();
                let curvature = DMatrix::from_fn(inputs, inputs, |a, c| dot(&second[a][c], b)).symmetric_eigen();
                let u = curvature.eigenvectors.column(curvature.eigenvalues.imin());
                let sum = |k: usize| {
                    (0..inputs).flat_map(|a| (0..inputs).map(move |c| (a, c))).map(|(a, c)| u[a] * u[c] * second[a][c][k]).sum()
                };
                let mut rows: Vec<Row> = vec![((0..basis.terms.len()).map(sum).collect(), 0.0)];
                for (input, function) in &basis.functions {
                    if let Function::Hinge(at) = function {
                        let mut x = x.to_vec();
                        x[*input] = *at;
                        let [below, above] = [false, true].map(|is_above| basis.row(&x, &[*input], is_above));
                        rows.push((above.iter().zip(&below).map(|(a, b)| sign * (a - b)).collect(), 0.0));
                    }
                }
                rows
            }
        }
    }

    fn worst_at(&self, shares: &[f64], b: &[f64]) -> Option<Broken> {
        let x = self.problem.basis.point(shares);
        if !self.is_inside(&x) {
            return None;
        }
        let rows = self.problem.asked.iter().flat_map(|asked| self.rows(asked, &x, b));
        let broken = rows.map(|row| Broken { missing: row.1 - dot(&row.0, b), shares: shares.to_vec(), row });
        broken.max_by(|one, other| one.missing.total_cmp(&other.missing))
    }

    /// The largest violation on a grid, at random points and after descents from the worst of them.
    pub fn violation(&self, b: &[f64], near: &[Vec<f64>]) -> f64 {
        let inputs = self.problem.basis.axes.len();
        let steps = [4001usize, 81, 19, 9][inputs - 1];
        let grid = (0..steps.pow(inputs as u32)).map(|k| {
            (0..inputs).map(|axis| (k / steps.pow(axis as u32) % steps) as f64 / (steps - 1) as f64).collect::<Vec<f64>>()
        });
        let mut random = Random::new(11);
        let mut found: Vec<Broken> = grid.filter_map(|shares| self.worst_at(&shares, b)).collect();
        found.extend((0..4000).filter_map(|_| self.worst_at(&ended(&mut random, inputs), b)));
        found.extend(near.iter().filter_map(|shares| self.worst_at(shares, b)));
        found.sort_by(|one, other| other.missing.total_cmp(&one.missing));
        found.truncate(30);
        found.into_iter().map(|start| self.climbed(start, b, &mut random, 60).missing).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Random steps that become shorter, to a larger violation.
    fn climbed(&self, mut at: Broken, b: &[f64], random: &mut Random, tries: usize) -> Broken {
        let mut reach = 0.1;
        for _ in 0..tries {
            let moved: Vec<f64> = at.shares.iter().map(|share| (share + reach * random.normal()).clamp(0.0, 1.0)).collect();
            match self.worst_at(&moved, b).filter(|next| next.missing > at.missing) {
                Some(next) => at = next,
                None => reach *= 0.85,
            }
        }
        at
    }

    /// A lower bound of the residual sum of squares, within `close` of `found` if the time is sufficient, and whether it was. It starts from the
    /// constraints at the places where the fit with coefficients `of_fit` is nearest to violating them.
    pub fn lower_bound(
        &self,
        found: f64,
        of_fit: &[f64],
        near: &[Vec<f64>],
        close: f64,
        limit: std::time::Duration,
    ) -> (f64, bool) {
        let begin = std::time::Instant::now();
        let basis = &self.problem.basis;
        let (inputs, width) = (basis.axes.len(), basis.terms.len());
        let of_row = |(x, _): &(Vec<f64>, f64)| {
            let sign = basis.sign(x);
            basis.row(x, &[], true).into_iter().map(move |value| sign * value)
        };
        let design = DMatrix::from_row_iterator(self.problem.rows.len(), width, self.problem.rows.iter().flat_map(of_row));
        let response = DVector::from_iterator(self.problem.rows.len(), self.problem.rows.iter().map(|(_, y)| *y));
        // In the variables z = R b the sum of squares is |z - Q'y|^2 and a constant, well conditioned.
        let qr = design.qr();
        let (r, free) = (qr.r(), qr.q().tr_mul(&response));
        let constant = response.norm_squared() - free.norm_squared();
        let upright = r.transpose();
        let mut z = free.clone();
        let mut rows: Vec<(Vec<f64>, f64)> = Vec::new();
        let mut known = near.to_vec();
        let mut random = Random::new(7);
        let sum = |z: &DVector<f64>| (z - &free).norm_squared() + constant.max(0.0);
        let upright_row = |(n, least): Row| {
            let n = upright.solve_lower_triangular(&DVector::from(n)).expect("the terms are independent");
            let length = n.norm();
            (length > 0.0).then(|| ((n / length).as_slice().to_vec(), least / length))
        };
        for place in near {
            for reach in [0.0, 0.0, 0.005, 0.005, 0.005, 0.005] {
                let moved: Vec<f64> = place.iter().map(|s| (s + reach * random.normal()).clamp(0.0, 1.0)).collect();
                let x = basis.point(&moved);
                if self.is_inside(&x) {
                    let all = self.problem.asked.iter().flat_map(|asked| self.rows(asked, &x, of_fit));
                    rows.extend(all.filter_map(upright_row));
                }
                if let Some(start) = self.worst_at(&moved, of_fit) {
                    rows.extend(upright_row(self.climbed(start, of_fit, &mut random, 30).row));
                }
            }
        }
        if !rows.is_empty() {
            z = program(&free, &rows);
        }
        let spread = self.problem.rows.iter().map(|(_, y)| y.abs()).fold(0.0, f64::max);
        loop {
            let best = sum(&z);
            if found / best - 1.0 < close || begin.elapsed() > limit {
                return (best, found / best - 1.0 < close);
            }
            let b: Vec<f64> = r.solve_upper_triangular(&z).expect("the terms are independent").iter().copied().collect();
            let mut points = known.clone();
            points.extend((0..1500).map(|_| ended(&mut random, inputs)));
            let mut broken: Vec<Broken> = points.iter().filter_map(|shares| self.worst_at(shares, &b)).collect();
            broken.retain(|one| one.missing > 1e-9 * spread);
            broken.sort_by(|one, other| other.missing.total_cmp(&one.missing));
            // Half of them climb from the worst points, the others are the worst points of different places.
            let mut apart: Vec<Broken> = Vec::new();
            for one in broken {
                let is_near = |other: &Broken| other.shares.iter().zip(&one.shares).all(|(a, b)| (a - b).abs() < 0.02);
                if apart.len() < 40 && !apart.iter().any(is_near) {
                    apart.push(self.climbed(one, &b, &mut random, 40));
                }
            }
            if apart.is_empty() {
                return (best, true);
            }
            for Broken { shares, row, .. } in apart {
                rows.extend(upright_row(row));
                known.push(shares);
            }
            z = program(&free, &rows);
        }
    }
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(a, b)| a * b).sum()
}

/// A random point; half of the coordinates are at an end, because many constraints are active there.
fn ended(random: &mut Random, inputs: usize) -> Vec<f64> {
    (0..inputs).map(|_| (2.0 * random.share() - 0.5).clamp(0.0, 1.0)).collect()
}

/// The vector nearest to `free` that satisfies the rows. The program is that of the difference, so that its accuracy is relative to it.
fn program(free: &DVector<f64>, rows: &[Row]) -> DVector<f64> {
    let width = free.len();
    let missing: Vec<f64> = rows.iter().map(|(n, least)| least - dot(n, free.as_slice())).collect();
    let scale = missing.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let (mut starts, mut places, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..width {
        places.extend(0..rows.len());
        values.extend(rows.iter().map(|(n, _)| -n[column]));
        starts.push(values.len());
    }
    let matrix = CscMatrix::new(rows.len(), width, starts, places, values);
    let bounds: Vec<f64> = missing.iter().map(|missing| -missing / scale).collect();
    let settings = DefaultSettingsBuilder::default().verbose(false).max_threads(1).build().expect("the settings are ours");
    let cones = [NonnegativeConeT(rows.len())];
    let mut solver = DefaultSolver::new(&CscMatrix::identity(width), &vec![0.0; width], &matrix, &bounds, &cones, settings)
        .expect("a program");
    solver.solve();
    free + DVector::from(solver.solution.x.clone()) * scale
}
