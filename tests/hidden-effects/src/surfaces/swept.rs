//! Runs in the order of a machine: sweeps, maps row by row, trips. A missing term then gives correlated errors, like slow noise.
//!
//! In: a seed, a name, the missing part. Out: [`Case`]. If something is missing that is not a term of the catalogue, `unexplained` is correct. If the
//! noise is correlated and independent of the inputs, it is the cause. It never uses an answer.

use std::f64::consts::TAU;

use super::files::{model_file, table};
use super::polynomial::{Input, Powers, fit, monomial, up_to, value};
use super::{Case, Truth};
use crate::random::Random;

/// The missing part of the file's surface, or the kind of noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lack {
    /// A cogging map: one to eight waves per revolution, orders 5 to 50, along sweeps over the angle.
    Teeth,
    /// A map row by row, with all powers of fourth and fifth order missing.
    Order,
    /// A trip: the inputs change slowly, and the response has a bend or waves over one of them.
    Trip,
    /// Nothing is missing, for any of these orders of runs, with independent noise.
    Nothing,
    /// Nothing is missing, with correlated noise.
    Noise,
}

const ANGLE: Input = Input { name: "angle", unit: "rad", range: [0.0, TAU] };
const CURRENT: Input = Input { name: "current", unit: "A", range: [-12.0, 20.0] };

/// Coded points in the order of the runs: the first input passes through its range repeatedly, or both change slowly.
pub(super) fn way(random: &mut Random, lack: Lack) -> Vec<Vec<f64>> {
    let kind = match lack {
        Lack::Teeth => 0,
        Lack::Order => 1,
        Lack::Trip => 2,
        Lack::Nothing | Lack::Noise => random.whole(0, 2),
    };
    match kind {
        0 => {
            // Sweeps in both directions at levels of the second input, with one step of the angle per row.
            let (sweeps, rows) = (random.whole(5, 8), random.whole(110, 180));
            let at = |sweep: u64, row: u64| if sweep.is_multiple_of(2) { row } else { rows - 1 - row };
            let level = |sweep: u64| 2.0 * sweep as f64 / (sweeps - 1) as f64 - 1.0;
            let point = |sweep: u64, row: u64| vec![2.0 * at(sweep, row) as f64 / (rows - 1) as f64 - 1.0, level(sweep)];
            (0..sweeps).flat_map(|sweep| (0..rows).map(move |row| point(sweep, row))).collect()
        }
        1 => {
            let (across, down) = (random.whole(16, 30), random.whole(12, 20));
            let coded = |k: u64, of: u64| 2.0 * k as f64 / (of - 1) as f64 - 1.0;
            (0..down).flat_map(|row| (0..across).map(move |column| vec![coded(column, across), coded(row, down)])).collect()
        }
        _ => {
            let rows = random.whole(400, 900);
            let phases: Vec<[f64; 2]> = (0..6).map(|_| [random.uniform(2.0, 14.0), random.uniform(0.0, TAU)]).collect();
            // Three oscillations of each input, with incommensurable periods.
            let swings = |of: &[[f64; 2]], t: f64| of.iter().map(|[times, at]| (TAU * times * t + at).sin()).sum::<f64>() / 3.0;
            let point = |k: u64| {
                let t = k as f64 / rows as f64;
                vec![swings(&phases[..3], t).clamp(-1.0, 1.0), swings(&phases[3..], t).clamp(-1.0, 1.0)]
            };
            (0..rows).map(point).collect()
        }
    }
}

/// The part of a shape that the terms of the file and of the next order cannot approximate, with a root mean square of one.
fn lacking(order: u32, points: &[Vec<f64>], shape: &dyn Fn(&[f64]) -> f64) -> Vec<f64> {
    let values: Vec<f64> = points.iter().map(|x| shape(x)).collect();
    let imitating = up_to(2, order + 1);
    let coefficients = fit(&imitating, points, &values);
    let imitation: Vec<(Powers, f64)> = imitating.into_iter().zip(coefficients).collect();
    let left: Vec<f64> = points.iter().zip(&values).map(|(x, y)| y - value(&imitation, x)).collect();
    let size = (left.iter().map(|y| y * y).sum::<f64>() / left.len() as f64).sqrt();
    left.iter().map(|y| y / size).collect()
}

/// The case of a name.
pub fn make(seed: u64, name: &str, lack: Lack) -> Case {
    let random = &mut Random::new(seed, name);
    let inputs = vec![ANGLE, CURRENT];
    let order = if lack == Lack::Order { 2 } else { random.whole(1, 3) as u32 };
    let mut truth: Vec<(Powers, f64)> = up_to(2, order).into_iter().map(|powers| (powers, random.uniform(-1.0, 1.0))).collect();
    truth[0].1 = random.uniform(3.0, 6.0);
    let points = way(random, lack);
    let sigma = random.uniform(0.01, 0.05);
    let strength = sigma * random.spread(0.7, 30.0);
    let count = random.whole(1, 8);
    let waves: Vec<(f64, f64)> = (0..count).map(|_| (random.whole(5, 50) as f64, random.uniform(0.0, TAU))).collect();
    let high: Vec<(Powers, f64)> = up_to(2, 5)
        .into_iter()
        .filter(|powers| powers.iter().sum::<u32>() > 3)
        .map(|powers| (powers, random.uniform(-1.0, 1.0)))
        .collect();
    let (bent, at, wave) = (random.whole(0, 1) as usize, random.uniform(-0.4, 0.4), random.whole(0, 1) == 1);
    let turns = |x: f64, slower: f64| -> f64 {
        waves.iter().map(|(order, phase)| (TAU * slower * order * (x + 1.0) / 2.0 + phase).sin()).sum()
    };
    let shape = |x: &[f64]| match lack {
        Lack::Teeth => turns(x[0], 1.0),
        Lack::Order => high.iter().map(|(powers, c)| c * monomial(powers, x)).sum(),
        Lack::Trip if wave => turns(x[bent], 0.25),
        Lack::Trip => (x[bent] - at).abs(),
        Lack::Nothing | Lack::Noise => 0.0,
    };
    let is_lacking = !matches!(lack, Lack::Nothing | Lack::Noise);
    let extra = if is_lacking { lacking(order, &points, &shape) } else { vec![0.0; points.len()] };
    let colour = if lack == Lack::Noise { random.uniform(0.5, 0.9) } else { 0.0 };
    let noise = random.noise(points.len(), sigma, colour);
    let y: Vec<f64> =
        points.iter().zip(&extra).zip(&noise).map(|((x, extra), noise)| value(&truth, x) + strength * extra + noise).collect();
    let read: Vec<Vec<f64>> =
        points.iter().map(|x| inputs.iter().zip(x).map(|(input, x)| input.natural(*x)).collect()).collect();
    // The same runs once more, with different noise.
    let again = random.noise(points.len(), sigma, colour);
    let exact: Vec<f64> = points.iter().zip(&extra).map(|(x, extra)| value(&truth, x) + strength * extra).collect();
    let unseen: Vec<f64> = exact.iter().zip(&again).map(|(y, noise)| y + noise).collect();
    Case {
        name: name.to_string(),
        verdict: match lack {
            Lack::Nothing => "no-discrepancy",
            Lack::Noise => "explained",
            _ => "unexplained",
        },
        truths: if lack == Lack::Noise { vec![Truth { label: "correlated-errors".into(), number: None }] } else { Vec::new() },
        model: model_file(&inputs, &truth, None),
        data: table(&inputs, &read, &y, None, None),
        unseen: table(&inputs, &read, &unseen, None, None),
        nominal: points.iter().map(|x| value(&truth, x)).collect(),
        exact,
        in_file: false,
        fault: None,
    }
}
