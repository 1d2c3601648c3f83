//! One step of an integrator.
//!
//! In: a machine at a point, a step. Out: the states behind it, and an estimate of their error. Never judges the error, never looks for events.

use nalgebra::{DMatrix, DVector, Dyn, LU};

use super::machine::{Machine, Point};

/// States behind a step.
pub(super) struct Stepped {
    pub states: Vec<f64>,
    /// Of each state, what a method of one order less gives otherwise.
    pub error: Vec<f64>,
}

/// The states of a point, moved by h times a sum of rates.
fn along(point: &Point, h: f64, share: f64, terms: &[(f64, &[f64])]) -> Point {
    let mut moved = point.clone();
    moved.time = point.time + share * h;
    for (k, state) in moved.states.iter_mut().enumerate() {
        let sum: f64 = terms.iter().map(|(weight, rates)| weight * rates[k]).sum();
        *state += h * sum;
    }
    moved
}

/// The pair of orders 5 and 4 of J. R. Dormand and P. J. Prince, "A family of embedded Runge-Kutta formulae", 1980, table 2. `first` are the rates at the point.
pub(super) fn explicit(machine: &Machine, point: &Point, h: f64, first: &[f64]) -> Stepped {
    let k1 = first;
    let k2 = machine.rates(&along(point, h, 0.2, &[(0.2, k1)]));
    let k3 = machine.rates(&along(point, h, 0.3, &[(3.0 / 40.0, k1), (9.0 / 40.0, &k2)]));
    let k4 = machine.rates(&along(point, h, 0.8, &[(44.0 / 45.0, k1), (-56.0 / 15.0, &k2), (32.0 / 9.0, &k3)]));
    let terms: [(f64, &[f64]); 4] =
        [(19_372.0 / 6561.0, k1), (-25_360.0 / 2187.0, &k2), (64_448.0 / 6561.0, &k3), (-212.0 / 729.0, &k4)];
    let k5 = machine.rates(&along(point, h, 8.0 / 9.0, &terms));
    let terms: [(f64, &[f64]); 5] =
        [(9017.0 / 3168.0, k1), (-355.0 / 33.0, &k2), (46_732.0 / 5247.0, &k3), (49.0 / 176.0, &k4), (-5103.0 / 18_656.0, &k5)];
    let k6 = machine.rates(&along(point, h, 1.0, &terms));
    let fifth: [(f64, &[f64]); 5] =
        [(35.0 / 384.0, k1), (500.0 / 1113.0, &k3), (125.0 / 192.0, &k4), (-2187.0 / 6784.0, &k5), (11.0 / 84.0, &k6)];
    let end = along(point, h, 1.0, &fifth);
    let k7 = machine.rates(&end);
    // The weights of order 5 less those of order 4.
    let error = |k: usize| {
        h * (71.0 / 57_600.0 * k1[k] - 71.0 / 16_695.0 * k3[k] + 71.0 / 1920.0 * k4[k] - 17_253.0 / 339_200.0 * k5[k]
            + 22.0 / 525.0 * k6[k]
            - 1.0 / 40.0 * k7[k])
    };
    let error = (0..point.states.len()).map(error).collect();
    Stepped { states: end.states, error }
}

/// The exact Jacobian at a point, for several steps from there.
pub(super) struct Linear {
    jacobian: DMatrix<f64>,
    by_time: DVector<f64>,
}

impl Linear {
    /// Whether every derivative is a number: a square root of 0 has none.
    pub(super) fn is_finite(&self) -> bool {
        self.jacobian.iter().chain(self.by_time.iter()).all(|it| it.is_finite())
    }

    pub(super) fn at(machine: &Machine, point: &Point) -> Self {
        let n = point.states.len();
        let (slopes, by_time) = machine.slopes(point);
        Linear { jacobian: DMatrix::from_row_slice(n, n, &slopes), by_time: DVector::from_vec(by_time) }
    }
}

/// The Rosenbrock method RODAS3 of orders 3 and 2, for stiff systems (A. Sandu and others, "Benchmarking stiff ODE solvers for atmospheric chemistry problems II: Rosenbrock
/// solvers", 1997, table 2). `None` where its matrix is singular.
pub(super) fn stiff(machine: &Machine, point: &Point, h: f64, linear: &Linear) -> Option<Stepped> {
    const GAMMA: f64 = 0.5;
    let n = point.states.len();
    let matrix = DMatrix::identity(n, n) / (GAMMA * h) - &linear.jacobian;
    let factors: LU<f64, Dyn, Dyn> = matrix.lu();
    let rates = |terms: &[(f64, &DVector<f64>)], share: f64| {
        let mut moved = point.clone();
        moved.time = point.time + share * h;
        for (k, state) in moved.states.iter_mut().enumerate() {
            *state += terms.iter().map(|(weight, it)| weight * it[k]).sum::<f64>();
        }
        DVector::from_vec(machine.rates(&moved))
    };
    let f1 = rates(&[], 0.0);
    let k1 = factors.solve(&(&f1 + &linear.by_time * (0.5 * h)))?;
    let k2 = factors.solve(&(&f1 + &k1 * (4.0 / h) + &linear.by_time * (1.5 * h)))?;
    let f3 = rates(&[(2.0, &k1)], 1.0);
    let k3 = factors.solve(&(f3 + (&k1 - &k2) / h))?;
    let f4 = rates(&[(2.0, &k1), (1.0, &k3)], 1.0);
    let k4 = factors.solve(&(f4 + (&k1 - &k2 - &k3 * (8.0 / 3.0)) / h))?;
    let states = (0..n).map(|k| point.states[k] + 2.0 * k1[k] + k3[k] + k4[k]).collect();
    Some(Stepped { states, error: k4.iter().copied().collect() })
}
