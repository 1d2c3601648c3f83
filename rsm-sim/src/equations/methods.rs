//! One step of an embedded pair of methods: for stiff systems, and for points where the solution has no series.
//!
//! In: rates, a step, and for the stiff pair the exact Jacobian. Out: the states after the step, and an estimate of their error. This file never
//! decides about the error, and never searches for events.

use nalgebra::{DMatrix, DVector, Dyn, LU};

/// States after a step.
pub(super) struct Stepped {
    pub states: Vec<f64>,
    /// For each state, the difference from a method whose order is lower by one.
    pub error: Vec<f64>,
}

/// The pair of orders 5 and 4 of J. R. Dormand and P. J. Prince, "A family of embedded Runge-Kutta formulae", 1980, table 2. `rates` computes the
/// rates at a share of the step and at given states.
pub(super) fn explicit(rates: &mut dyn FnMut(f64, &[f64]) -> Vec<f64>, from: &[f64], h: f64) -> Stepped {
    const NODES: [f64; 7] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0];
    const WEIGHTS: [&[f64]; 7] = [
        &[],
        &[0.2],
        &[3.0 / 40.0, 9.0 / 40.0],
        &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
        &[19_372.0 / 6561.0, -25_360.0 / 2187.0, 64_448.0 / 6561.0, -212.0 / 729.0],
        &[9017.0 / 3168.0, -355.0 / 33.0, 46_732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18_656.0],
        &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ];
    // The weights of order 5 minus those of order 4.
    const ERROR: [f64; 7] =
        [71.0 / 57_600.0, 0.0, -71.0 / 16_695.0, 71.0 / 1920.0, -17_253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];
    let mut stages: Vec<Vec<f64>> = Vec::with_capacity(7);
    let mut states = from.to_vec();
    for (node, weights) in NODES.iter().zip(WEIGHTS) {
        for (k, state) in states.iter_mut().enumerate() {
            *state = from[k] + h * weights.iter().zip(&stages).map(|(weight, stage)| weight * stage[k]).sum::<f64>();
        }
        stages.push(rates(*node, &states));
    }
    let error = (0..from.len()).map(|k| h * ERROR.iter().zip(&stages).map(|(weight, stage)| weight * stage[k]).sum::<f64>());
    Stepped { error: error.collect(), states }
}

/// The exact Jacobian at a point, for one or several steps from there.
pub(super) struct Linear {
    jacobian: DMatrix<f64>,
    by_time: DVector<f64>,
}

impl Linear {
    /// From the derivatives of the rates with respect to the states, row by row, and with respect to the time.
    pub(super) fn new(states: usize, slopes: &[f64]) -> Self {
        let (by_state, by_time) = slopes.split_at(states * states);
        let by_time = if by_time.is_empty() { vec![0.0; states] } else { by_time.to_vec() };
        Linear { jacobian: DMatrix::from_row_slice(states, states, by_state), by_time: DVector::from_vec(by_time) }
    }

    /// Whether every derivative is finite: the square root at 0 has no finite derivative.
    pub(super) fn is_finite(&self) -> bool {
        self.jacobian.iter().chain(self.by_time.iter()).all(|it| it.is_finite())
    }
}

/// The Rosenbrock method RODAS3 of orders 3 and 2, for stiff systems (A. Sandu and others, "Benchmarking stiff ODE solvers for atmospheric chemistry
/// problems II: Rosenbrock solvers", 1997, table 2). `rates` computes the rates at a share of the step and at given states. `None` if the matrix of
/// the method is singular.
pub(super) fn stiff(rates: &mut dyn FnMut(f64, &[f64]) -> Vec<f64>, from: &[f64], h: f64, linear: &Linear) -> Option<Stepped> {
    const GAMMA: f64 = 0.5;
    let n = from.len();
    let matrix = DMatrix::identity(n, n) / (GAMMA * h) - &linear.jacobian;
    let factors: LU<f64, Dyn, Dyn> = matrix.lu();
    let mut at = |terms: &[(f64, &DVector<f64>)], share: f64| {
        let moved: Vec<f64> =
            from.iter().enumerate().map(|(k, x)| x + terms.iter().map(|(weight, it)| weight * it[k]).sum::<f64>()).collect();
        DVector::from_vec(rates(share, &moved))
    };
    let f1 = at(&[], 0.0);
    let k1 = factors.solve(&(&f1 + &linear.by_time * (0.5 * h)))?;
    let k2 = factors.solve(&(&f1 + &k1 * (4.0 / h) + &linear.by_time * (1.5 * h)))?;
    let f3 = at(&[(2.0, &k1)], 1.0);
    let k3 = factors.solve(&(f3 + (&k1 - &k2) / h))?;
    let f4 = at(&[(2.0, &k1), (1.0, &k3)], 1.0);
    let k4 = factors.solve(&(f4 + (&k1 - &k2 - &k3 * (8.0 / 3.0)) / h))?;
    let states = (0..n).map(|k| from[k] + 2.0 * k1[k] + k3[k] + k4[k]).collect();
    Some(Stepped { states, error: k4.iter().copied().collect() })
}
