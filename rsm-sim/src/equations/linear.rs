//! The linear model of a plant at a point.
//!
//! In: a machine and a point. Out: the matrices of dx/dt = A x + B u, y = C x + D u for small changes about the point, and the poles. All derivatives
//! are exact.

use nalgebra::DMatrix;
use rsm_core::source::Faults;
use rsm_model::expression::{Id, Symbol};

use super::file::EquationFile;
use super::machine::{Machine, Point};
use super::numbers::DelaySource;

/// A linear model, in the units of the text.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearised {
    /// One row for each state, one column for each state.
    pub a: Vec<Vec<f64>>,
    /// One row for each state, one column for each input.
    pub b: Vec<Vec<f64>>,
    /// One row for each output, one column for each state.
    pub c: Vec<Vec<f64>>,
    /// One row for each output, one column for each input.
    pub d: Vec<Vec<f64>>,
    /// The poles, slowest first. In a pair, the pole with the positive imaginary part comes first. The list is empty if a derivative in A is not
    /// finite.
    pub poles: Vec<Pole>,
}

/// An eigenvalue of A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pole {
    /// The real part in 1/s.
    pub real: f64,
    /// The imaginary part in rad/s.
    pub imaginary: f64,
}

impl Pole {
    /// The magnitude of the pole in rad/s: the natural frequency of a pair.
    #[must_use]
    pub fn frequency(&self) -> f64 {
        self.real.hypot(self.imaginary)
    }

    /// The damping ratio: 1 for a real stable pole, 0 for an undamped pair, -1 for a real unstable pole. `None` for a pole at 0.
    #[must_use]
    pub fn damping(&self) -> Option<f64> {
        let frequency = self.frequency();
        (frequency > 0.0).then(|| -self.real / frequency)
    }
}

/// The linear model of a plant at a point.
///
/// # Errors
/// Faults that the compiler can detect only now: a derivative needs a symbol that has no value.
pub fn linearise(file: &EquationFile, machine: &Machine, point: &Point) -> Result<Linearised, Faults> {
    let mut system = machine.system().clone();
    let (states, inputs, outputs) = (system.states().to_vec(), system.inputs(), system.outputs());
    let rates = system.rates();
    let values: Vec<Id> = outputs.iter().map(|it| system.value(*it)).collect();
    let mut matrix = |of: &[Id], by: &[Symbol]| -> Result<Vec<Vec<f64>>, Faults> {
        let derivatives: Vec<Id> = of
            .iter()
            .flat_map(|row| by.iter().map(|column| (*row, *column)))
            .map(|(row, column)| system.derivative(row, column))
            .collect();
        let found = machine.evaluated(file, &system, &derivatives, point)?;
        Ok(if by.is_empty() { vec![Vec::new(); of.len()] } else { found.chunks(by.len()).map(<[f64]>::to_vec).collect() })
    };
    let (a, mut b) = (matrix(&rates, &states)?, matrix(&rates, &inputs)?);
    let (c, mut d) = (matrix(&values, &states)?, matrix(&values, &inputs)?);
    // Delays are ignored: a delayed copy of an input acts together with the input. Followers come after the inputs of a record and are removed in
    // reverse order.
    for delayed_input in machine.delayed_inputs().iter().rev() {
        for row in b.iter_mut().chain(&mut d) {
            let late = row.remove(delayed_input.input);
            if let DelaySource::Input(place) = delayed_input.of {
                row[place] += late;
            }
        }
    }
    let poles = poles(&a);
    Ok(Linearised { a, b, c, d, poles })
}

fn poles(a: &[Vec<f64>]) -> Vec<Pole> {
    let n = a.len();
    // An eigenvalue iteration does not terminate if an entry is not finite.
    if n == 0 || a.iter().flatten().any(|it| !it.is_finite()) {
        return Vec::new();
    }
    let matrix = DMatrix::from_fn(n, n, |row, column| a[row][column]);
    // Rounding changes an eigenvalue by some units in the last place of the matrix norm (G. H. Golub, C. F. Van Loan, "Matrix Computations", 7.5.6).
    // A value within this limit is set to 0.
    let rounding = 16.0 * n as f64 * f64::EPSILON * matrix.norm();
    let clean = |value: f64| if value.abs() <= rounding { 0.0 } else { value };
    let mut poles: Vec<Pole> =
        matrix.complex_eigenvalues().iter().map(|it| Pole { real: clean(it.re), imaginary: clean(it.im) }).collect();
    poles.sort_by(|p, q| p.frequency().total_cmp(&q.frequency()).then(q.imaginary.total_cmp(&p.imaginary)));
    poles
}
