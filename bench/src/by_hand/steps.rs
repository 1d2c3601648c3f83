//! Steps between two rows: the classical Runge-Kutta method (M. W. Kutta, 1901), or an exponential method (S. M. Cox, P. C. Matthews, "Exponential
//! time differencing for stiff systems", 2002).
//!
//! In: a plant, constant inputs, a state with its rates. Out: the state one row later. The row is divided into equal steps, whose number follows from
//! the plant's rates.

use super::phi::{self, Matrix};
use super::plants::{Plant, Rates};

/// The step length is at most this divided by the fastest rate: the error of fourth order in one time constant is then 0.25^4/120.
const STEP_RATE: f64 = 0.25;

/// A step of the exponential method costs as much as two or three of the classical one.
const PAYS: f64 = 3.0;

/// The largest number of states of these plants.
const MOST: usize = 8;

/// The difference for the Jacobian, relative to a state.
const DIFFERENCE: f64 = 1e-8;

/// The linear part is computed again when the varying rates have changed by this share.
const STALE: f64 = 0.1;

/// The matrices of a step: h phi_1(A h), 2 h (phi_2 - 2 phi_3)(A h), h (4 phi_3 - phi_2)(A h).
struct Step {
    whole: Matrix<MOST>,
    middle: Matrix<MOST>,
    last: Matrix<MOST>,
}

/// A linear part, with the matrices of a span, its half, quarter and so on.
struct Part {
    span: f64,
    varying: f64,
    a: Matrix<MOST>,
    steps: Vec<Step>,
}

/// Everything that the inner loop writes.
pub(super) struct Work {
    pub x: Vec<f64>,
    /// The rates of four stages; the first are those at the state.
    pub k: [Vec<f64>; 4],
    trial: Vec<f64>,
    part: Option<Part>,
}

impl Work {
    pub(super) fn new(states: usize) -> Self {
        let of = || vec![0.0; states];
        Work { x: of(), k: [of(), of(), of(), of()], trial: of(), part: None }
    }
}

/// Integrates over a span with constant inputs.
pub(super) fn hold<P: Plant>(plant: &P, inputs: [f64; 3], work: &mut Work, span: f64) {
    let rates = plant.rates(&work.x);
    let steps = |rate: f64| (span * rate / STEP_RATE).ceil().max(1.0);
    let (small, large) = (steps(rates.fastest.max(rates.nonlinear)), steps(rates.nonlinear));
    if PAYS * large <= small {
        return exponential(plant, inputs, work, &rates, span, large.log2().ceil() as usize);
    }
    let step = span / small;
    let mut outputs = [0.0; 3];
    for k in 0..small as usize {
        let Work { x, trial, k: stages, .. } = &mut *work;
        if k > 0 {
            plant.evaluate(&inputs, x, &mut stages[0], &mut outputs);
        }
        for (stage, share) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
            for ((trial, x), rate) in trial.iter_mut().zip(x.iter()).zip(&stages[stage - 1]) {
                *trial = x + share * step * rate;
            }
            plant.evaluate(&inputs, trial, &mut stages[stage], &mut outputs);
        }
        let [a, b, c, d] = &*stages;
        for ((((x, a), b), c), d) in x.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *x += step / 6.0 * (a + 2.0 * (b + c) + d);
        }
    }
}

fn part<P: Plant>(plant: &P, inputs: &[f64; 3], work: &mut Work, rates: &Rates, span: f64, level: usize) -> Part {
    let n = work.x.len();
    let mut a = Matrix::<MOST>::zero();
    let Work { x, trial, k: [here, there, ..], .. } = &mut *work;
    let mut outputs = [0.0; 3];
    for j in 0..n {
        trial.copy_from_slice(x);
        trial[j] += DIFFERENCE * x[j].abs().max(1.0);
        let moved = trial[j] - x[j];
        plant.evaluate(inputs, trial, there, &mut outputs);
        for i in 0..n {
            a.0[j][i] = (there[i] - here[i]) / moved;
        }
    }
    // A step needs the matrices of its half.
    let steps = phi::functions(&a, span, level + 1).into_iter().enumerate().map(|(level, it)| {
        let h = span * 0.5_f64.powi(level as i32);
        Step {
            whole: it.one.scaled(h, 0.0),
            middle: it.two.combined(2.0 * h, &it.three, -2.0),
            last: it.three.scaled(4.0, 0.0).combined(h, &it.two, -1.0),
        }
    });
    Part { span, varying: rates.varying, a, steps: steps.collect() }
}

/// Takes 2^`level` steps.
fn exponential<P: Plant>(plant: &P, inputs: [f64; 3], work: &mut Work, rates: &Rates, span: f64, level: usize) {
    let is_fresh =
        |it: &Part| it.span == span && (rates.varying - it.varying).abs() <= STALE * it.varying && it.steps.len() >= level + 2;
    let part = match work.part.take().filter(is_fresh) {
        Some(part) => part,
        None => part(plant, &inputs, work, rates, span, level),
    };
    let (Step { whole, middle, last }, half) = (&part.steps[level], &part.steps[level + 1].whole);
    let count = 1_usize << level;
    let mut outputs = [0.0; 3];
    for step in 0..count {
        let Work { x, trial, k: [here, there, ..], .. } = &mut *work;
        let n = x.len();
        if step > 0 {
            plant.evaluate(&inputs, x, here, &mut outputs);
        }
        let mut f = [0.0; MOST];
        f[..n].copy_from_slice(here);
        // With D(y) = f(y) - f(x) - A (y - x): a = x + (h/2) phi_1(A h/2) f(x), b = a + (h/2) phi_1(A h/2) D(a), c = x + h phi_1(A h) f(x) + h
        // phi_1(A h/2) D(b).
        let mut difference = |moved: &[f64; MOST]| {
            for i in 0..n {
                trial[i] = x[i] + moved[i];
            }
            plant.evaluate(&inputs, trial, there, &mut outputs);
            let linear = part.a.times(moved);
            let mut d = [0.0; MOST];
            for i in 0..n {
                d[i] = there[i] - f[i] - linear[i];
            }
            d
        };
        let to_a = half.times(&f);
        let d_a = difference(&to_a);
        let d_b = difference(&plus(&to_a, &half.times(&d_a), 1.0));
        let straight = whole.times(&f);
        let d_c = difference(&plus(&straight, &half.times(&d_b), 2.0));
        let moved = plus(&plus(&straight, &middle.times(&plus(&d_a, &d_b, 1.0)), 1.0), &last.times(&d_c), 1.0);
        for (x, moved) in x.iter_mut().zip(&moved) {
            *x += moved;
        }
    }
    work.part = Some(part);
}

#[inline]
fn plus(one: &[f64; MOST], other: &[f64; MOST], share: f64) -> [f64; MOST] {
    let mut sum = *one;
    for (sum, other) in sum.iter_mut().zip(other) {
        *sum += share * other;
    }
    sum
}
