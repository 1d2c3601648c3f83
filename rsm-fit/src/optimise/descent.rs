//! Minimises a sum of maxima of smooth functions in a box.
//!
//! In: groups of pieces, each piece with its value and its exact gradient: f(x) = sum over groups of weight times the largest piece. Out: a local
//! minimum. Desirabilities, penalties of constraints and Chebyshev distances all have this form. Each step solves a quadratic program: the pieces are
//! linear, their curvature is that of the Lagrangian, in a trust region (Fletcher 1982, sequential l1 quadratic programming), with a second-order
//! correction.

use nalgebra::{DMatrix, SymmetricEigen};

use super::pieces::{Group, Piece, value};
use super::program::{Program, solve};

/// The groups at a point; their number and the numbers of their pieces are the same at every point.
pub(super) type Function<'a> = &'a dyn Fn(&[f64]) -> Vec<Group>;

/// The largest number of steps. A search needs ten to thirty.
const STEPS: usize = 150;

/// The first trust region, in half ranges, and the one at which a search ends.
const FIRST_RADIUS: f64 = 0.5;
const LAST_RADIUS: f64 = 1e-11;

/// A predicted gain below this part of the value is rounding of the quadratic program.
const LEAST_GAIN: f64 = 1e-13;

/// A variable within this distance of a bound is set to the bound.
const SNAP: f64 = 1e-9;

/// The step of the differences of gradients: the cube root of the rounding of a number.
const DIFFERENCE: f64 = 6e-6;

/// Curvatures below this get this value, so that the program has one solution.
const LEAST_CURVATURE: f64 = 1e-10;

/// A local minimum from `start`, with its value. `ends`: the box.
pub(super) fn minimum(function: Function<'_>, start: &[f64], ends: &[[f64; 2]]) -> (Vec<f64>, f64) {
    let mut x = start.to_vec();
    let mut groups = function(&x);
    let mut now = value(&groups);
    if x.is_empty() {
        return (x, now);
    }
    let mut multipliers: Option<Vec<Vec<f64>>> = None;
    let mut radius = FIRST_RADIUS;
    for _ in 0..STEPS {
        let curvature = multipliers.as_ref().map(|multipliers| curvature(function, &x, multipliers, ends));
        let program = |shift: Option<&[Group]>| {
            let reach = |(x, [low, high]): (&f64, &[f64; 2])| [(low - x).max(-radius), (high - x).min(radius)];
            let box_of_step = x.iter().zip(ends).map(reach).collect();
            solve(&Program { groups: &groups, shift, curvature: curvature.as_ref(), ends: box_of_step })
        };
        let Some(step) = program(None) else {
            // The solver failed: a smaller region has a better scale.
            radius *= 0.25;
            if radius < LAST_RADIUS {
                break;
            }
            continue;
        };
        let predicted = now - step.value;
        if predicted.is_nan() || predicted <= LEAST_GAIN * (1.0 + now.abs()) {
            break;
        }
        let moved = |step: &[f64]| -> Vec<f64> {
            let sum = |((x, d), [low, high]): ((&f64, &f64), &[f64; 2])| (x + d).clamp(*low, *high);
            x.iter().zip(step).zip(ends).map(sum).collect()
        };
        let mut next = moved(&step.step);
        let mut there = function(&next);
        let mut gain = now - value(&there);
        let mut taken = step;
        if gain < 0.5 * predicted {
            // Second-order correction: the same program with the values of the pieces at the end of the step.
            let linear = |piece: &Piece| -> f64 { piece.gradient.iter().zip(&taken.step).map(|(g, d)| g * d).sum() };
            let mut shifted = there.clone();
            for (new, old) in shifted.iter_mut().zip(&groups) {
                for (new, old) in new.pieces.iter_mut().zip(&old.pieces) {
                    new.value -= linear(old);
                }
            }
            if let Some(corrected) = program(Some(&shifted)) {
                let other = moved(&corrected.step);
                let at_other = function(&other);
                if now - value(&at_other) > gain.max(0.0) {
                    gain = now - value(&at_other);
                    (next, there, taken) = (other, at_other, corrected);
                }
            }
        }
        let ratio = gain / predicted;
        let length = taken.step.iter().map(|d| d.abs()).fold(0.0, f64::max);
        if ratio > 1e-4 {
            (x, groups, now) = (next, there, now - gain);
        }
        multipliers = Some(taken.multipliers);
        if ratio > 0.75 {
            radius = radius.max(2.0 * length).min(2.0);
        } else if ratio < 0.25 {
            radius = 0.25 * length.min(radius);
        }
        if radius < LAST_RADIUS {
            break;
        }
    }
    let last = value(&groups);
    // A step ends at a bound up to the accuracy of the program: on the bound, if that is not worse.
    let at_end = |(x, ends): (&f64, &[f64; 2])| ends.iter().copied().find(|end| (x - end).abs() <= SNAP).unwrap_or(*x);
    let snapped: Vec<f64> = x.iter().zip(ends).map(at_end).collect();
    let there = value(&function(&snapped));
    if there <= last + LEAST_GAIN * (1.0 + last.abs()) { (snapped, there) } else { (x, last) }
}

/// The curvature of the Lagrangian by central differences of exact gradients, with the magnitudes of its eigenvalues.
fn curvature(function: Function<'_>, x: &[f64], multipliers: &[Vec<f64>], ends: &[[f64; 2]]) -> DMatrix<f64> {
    let n = x.len();
    let gradient = |x: &[f64]| {
        let mut sum = vec![0.0; n];
        for (group, weights) in function(x).iter().zip(multipliers) {
            for (piece, weight) in group.pieces.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                sum.iter_mut().zip(&piece.gradient).for_each(|(sum, g)| *sum += weight * g);
            }
        }
        sum
    };
    let mut matrix = DMatrix::zeros(n, n);
    for k in 0..n {
        let (mut below, mut above) = (x.to_vec(), x.to_vec());
        below[k] = (x[k] - DIFFERENCE).max(ends[k][0]);
        above[k] = (x[k] + DIFFERENCE).min(ends[k][1]);
        let width = above[k] - below[k];
        if width <= 0.0 {
            continue;
        }
        let (low, high) = (gradient(&below), gradient(&above));
        for j in 0..n {
            matrix[(j, k)] = (high[j] - low[j]) / width;
        }
    }
    let symmetric = 0.5 * (&matrix + matrix.transpose());
    if symmetric.iter().any(|entry| !entry.is_finite()) {
        return DMatrix::identity(n, n);
    }
    let eigen = SymmetricEigen::new(symmetric);
    let sizes = eigen.eigenvalues.map(|value| value.abs().max(LEAST_CURVATURE));
    &eigen.eigenvectors * DMatrix::from_diagonal(&sizes) * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(weight: f64, pieces: Vec<(f64, Vec<f64>)>) -> Group {
        Group { weight, pieces: pieces.into_iter().map(|(value, gradient)| Piece { value, gradient }).collect() }
    }

    #[test]
    fn a_smooth_minimum_inside_and_one_on_a_bound_are_found() {
        // Rosenbrock's function, with its minimum 0 at (1, 1), and at x = 0.5 on a bound: y = 0.25, value 0.25.
        let rosenbrock = |x: &[f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            vec![group(1.0, vec![(a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * b * x[0], 200.0 * b])])]
        };
        let (x, value) = minimum(&rosenbrock, &[-1.2, 1.0], &[[-2.0, 2.0]; 2]);
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6 && value < 1e-12, "{x:?} {value}");
        let (x, value) = minimum(&rosenbrock, &[-1.2, 1.0], &[[-2.0, 0.5], [-2.0, 2.0]]);
        assert!((x[0] - 0.5).abs() < 1e-9 && (x[1] - 0.25).abs() < 1e-6 && (value - 0.25).abs() < 1e-10, "{x:?} {value}");
    }

    #[test]
    fn a_minimum_at_a_kink_is_found() {
        // max(x^2 + y^4, (2 - x)^2 + (2 - y)^2, 2 e^(y - x)): 1.9522245 at (1.1390376, 0.8995599) (Charalambous, Conn 1978).
        let kinked = |x: &[f64]| {
            let (x, y) = (x[0], x[1]);
            let exponential = 2.0 * (y - x).exp();
            vec![group(
                1.0,
                vec![
                    (x * x + y.powi(4), vec![2.0 * x, 4.0 * y.powi(3)]),
                    ((2.0 - x).powi(2) + (2.0 - y).powi(2), vec![-2.0 * (2.0 - x), -2.0 * (2.0 - y)]),
                    (exponential, vec![-exponential, exponential]),
                ],
            )]
        };
        let (x, value) = minimum(&kinked, &[1.0, -0.1], &[[-3.0, 3.0]; 2]);
        // Half a unit of the last published digit.
        assert!((value - 1.9522245).abs() < 5e-8, "{x:?} {value}");
        assert!((x[0] - 1.1390376).abs() < 1e-6 && (x[1] - 0.8995599).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn a_penalty_holds_a_curved_constraint() {
        // Minimise x + y in the unit disc, by the penalty 10 max(0, x^2 + y^2 - 1): -sqrt 2.
        let disc = |x: &[f64]| {
            vec![
                group(1.0, vec![(x[0] + x[1], vec![1.0, 1.0])]),
                group(10.0, vec![(0.0, vec![0.0; 2]), (x[0] * x[0] + x[1] * x[1] - 1.0, vec![2.0 * x[0], 2.0 * x[1]])]),
            ]
        };
        let (x, value) = minimum(&disc, &[0.9, -0.3], &[[-2.0, 2.0]; 2]);
        assert!((value + std::f64::consts::SQRT_2).abs() < 1e-8, "{x:?} {value}");
    }
}
