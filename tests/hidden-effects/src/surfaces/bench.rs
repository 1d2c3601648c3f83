//! Faults of the new data, as test benches make them: a sensor that is stuck, clipped, coarse or wrongly scaled, rows written twice, a response that
//! depends on the direction of approach.
//!
//! In: a seed, a name, the kind of the fault. Out: [`Case`]. The surface itself is correct, so the data fault is the only correct answer. Every fault
//! changes readings by at least three standard deviations of the noise (root mean square over its rows), a direction by at least one and a half. It
//! never uses an answer.

use super::Case;
use super::draw::{NAMES, design, root_mean_square};
use super::files::{model_file, table};
use super::polynomial::{Input, Powers, fit, up_to, value};
use super::swept::{Lack, way};
use crate::random::Random;

/// A kind of data fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// A sensor repeats one reading over a range of rows.
    Stuck,
    /// A sensor does not read beyond a limit.
    Clipped,
    /// The response is rounded to steps larger than its noise.
    Quantised,
    /// Rows are written twice.
    Duplicated,
    /// A sensor has another scale from a run on, or in a range of runs.
    Scaled,
    /// The response depends on the direction in which an input was approached.
    Direction,
}

/// The fault of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// The beginning of its name in a diagnosis.
    pub what: &'static str,
    /// Its column; `row` for rows written twice.
    pub column: String,
    /// Its rows; empty if all rows are affected.
    pub rows: Vec<usize>,
}

/// The smallest effect, in standard deviations of the noise.
const LEAST: f64 = 3.0;

/// Rows of a design or of a way through the inputs.
struct World {
    inputs: Vec<Input>,
    terms: Vec<(Powers, f64)>,
    points: Vec<Vec<f64>>,
    /// Whether the inputs have few levels.
    levels: bool,
    sigma: f64,
}

impl World {
    fn new(random: &mut Random) -> Self {
        let is_way = random.whole(0, 3) == 0;
        let count = if is_way { 2 } else { random.whole(2, 3) as usize };
        let first = random.whole(0, 4) as usize;
        let inputs: Vec<Input> = (0..count)
            .map(|k| NAMES[(first + k) % NAMES.len()])
            .map(|(name, unit, low, high)| Input { name, unit, range: [low, high] })
            .collect();
        let points = if is_way {
            way(random, Lack::Nothing)
        } else {
            let rows = random.whole(80, 200) as usize;
            design(random, count, rows)
        };
        let order = random.whole(1, if count == 2 { 3 } else { 2 }) as u32;
        let scale = random.spread(0.5, 200.0);
        let size = |random: &mut Random, powers: &Powers| match powers.iter().sum::<u32>() {
            0 => random.uniform(3.0, 6.0),
            order => random.sign() * random.uniform(0.4, 1.2) / f64::from(order),
        };
        let terms: Vec<(Powers, f64)> = up_to(count, order)
            .into_iter()
            .map(|powers| {
                let coefficient = scale * size(random, &powers);
                (powers, coefficient)
            })
            .collect();
        let spread = root_mean_square(points.iter().map(|x| value(&terms[1..], x)));
        let mut seen: Vec<u64> = points.iter().map(|x| x[0].to_bits()).collect();
        seen.sort_unstable();
        seen.dedup();
        let levels = seen.len() * 2 < points.len();
        World { inputs, terms, points, levels, sigma: spread * random.uniform(0.01, 0.05) }
    }

    fn rows(&self) -> usize {
        self.points.len()
    }

    fn value(&self, x: &[f64]) -> f64 {
        value(&self.terms, x)
    }

    /// The root mean square of the change of the response if an input reads as `read` gives it.
    fn effect(&self, rows: &[usize], input: usize, read: impl Fn(usize) -> f64) -> f64 {
        let change = |row: &usize| {
            let mut there = self.points[*row].clone();
            there[input] = read(*row);
            self.value(&there) - self.value(&self.points[*row])
        };
        root_mean_square(rows.iter().map(change)) / self.sigma
    }
}

/// Readings with a fault: coded inputs, the response.
struct Readings {
    points: Vec<Vec<f64>>,
    y: Vec<f64>,
    fault: Fault,
}

/// The readings of a kind of fault; `None` if its drawn size is too small to be visible, or the design does not show it.
fn readings(random: &mut Random, world: &World, kind: FaultKind) -> Option<Readings> {
    let (rows, count, sigma) = (world.rows(), world.inputs.len(), world.sigma);
    let mut points = world.points.clone();
    let noise = random.noise(rows, sigma, 0.0);
    let mut y: Vec<f64> = points.iter().zip(&noise).map(|(x, e)| world.value(x) + e).collect();
    // Half of the faults of a sensor are of the response's, the others of an input's.
    let input = (random.whole(0, 1) == 1).then(|| random.whole(0, count as u64 - 1) as usize);
    let named = |input: Option<usize>| input.map_or("y".to_string(), |k| world.inputs[k].name.to_string());
    let fault = match kind {
        FaultKind::Stuck => {
            let length = random.whole(10, (rows as u64 / 6).max(11)) as usize;
            let from = random.whole(0, (rows - length) as u64) as usize;
            let held: Vec<usize> = (from..from + length).collect();
            let seen = match input {
                Some(k) => {
                    let at = points[from][k];
                    held.iter().for_each(|row| points[*row][k] = at);
                    world.effect(&held, k, |row| points[row][k])
                }
                None => {
                    let at = y[from];
                    let seen = root_mean_square(held.iter().map(|row| y[*row] - at)) / sigma;
                    held.iter().for_each(|row| y[*row] = at);
                    seen
                }
            };
            if seen < LEAST {
                return None;
            }
            Fault { what: "stuck", column: named(input), rows: held }
        }
        FaultKind::Clipped => {
            // With few levels, a clipped level reads as another level: nothing in the data shows it.
            let input = input.filter(|_| !world.levels);
            let of = |row: usize| input.map_or(y[row], |k| points[row][k]);
            let mut sorted: Vec<f64> = (0..rows).map(of).collect();
            sorted.sort_by(f64::total_cmp);
            let upper = random.whole(0, 1) == 1;
            let share = random.uniform(0.07, 0.25);
            let limit = sorted[((if upper { 1.0 - share } else { share }) * rows as f64) as usize];
            let limit = limit + 0.01 * sigma;
            let beyond: Vec<usize> = (0..rows).filter(|row| if upper { of(*row) > limit } else { of(*row) < limit }).collect();
            let seen = match input {
                Some(k) => world.effect(&beyond, k, |_| limit),
                None => root_mean_square(beyond.iter().map(|row| y[*row] - limit)) / sigma,
            };
            if seen < LEAST || beyond.len() < 6 {
                return None;
            }
            for row in &beyond {
                *input.map_or(&mut y[*row], |k| &mut points[*row][k]) = limit;
            }
            Fault { what: "clipped", column: named(input), rows: beyond }
        }
        FaultKind::Quantised => {
            let step = sigma * random.spread(2.0, 10.0);
            y.iter_mut().for_each(|y| *y = (*y / step).round() * step);
            Fault { what: "quantised", column: "y".into(), rows: Vec::new() }
        }
        FaultKind::Duplicated => {
            let block = random.whole(0, 1) == 1;
            let length = if block { random.whole(5, (rows as u64 / 6).max(6)) as usize } else { 1 };
            let mut faulty = Vec::new();
            for _ in 0..if block { 1 } else { random.whole(3, 10) } {
                let from = random.whole(0, (points.len() - length) as u64) as usize;
                if faulty.iter().any(|row| from + length > *row || from == *row) {
                    continue;
                }
                let at = from + length;
                let again: Vec<Vec<f64>> = points[from..at].to_vec();
                points.splice(at..at, again);
                let again: Vec<f64> = y[from..at].to_vec();
                y.splice(at..at, again);
                faulty.extend(at..at + length);
            }
            // Each insertion before a faulty row moves that row; insertions are only made before all of them.
            let count = faulty.len();
            if !block {
                for (k, row) in faulty.iter_mut().enumerate() {
                    *row += count - 1 - k;
                }
            }
            Fault { what: "duplicated", column: "row".into(), rows: faulty }
        }
        FaultKind::Scaled => {
            let from = random.whole(rows as u64 / 5, 4 * rows as u64 / 5) as usize;
            let in_block = random.whole(0, 3) == 0;
            let to = if in_block { from + (rows - from) / 2 } else { rows };
            let faulty: Vec<usize> = (from..to).collect();
            if faulty.len() < 10 {
                return None;
            }
            match input {
                Some(k) => {
                    let factor = 1.0 + random.sign() * random.spread(0.04, 0.4);
                    let read = |x: f64| world.inputs[k].coded(factor * world.inputs[k].natural(x));
                    let seen = world.effect(&faulty, k, |row| read(points[row][k]));
                    faulty.iter().for_each(|row| points[*row][k] = read(points[*row][k]));
                    if !(LEAST..=40.0).contains(&seen) {
                        return None;
                    }
                }
                None => {
                    let fault_of_unit = random.whole(0, 3) == 0;
                    let unit = random.one_of(&[0.001, 0.1, 10.0, 1000.0]);
                    let factor = if fault_of_unit { unit } else { 1.0 + random.sign() * random.spread(0.04, 0.4) };
                    let seen = root_mean_square(faulty.iter().map(|row| (factor - 1.0) * y[*row])) / sigma;
                    faulty.iter().for_each(|row| y[*row] *= factor);
                    if seen < LEAST {
                        return None;
                    }
                }
            }
            Fault { what: "scaled", column: named(input), rows: faulty }
        }
        FaultKind::Direction => {
            let k = random.whole(0, count as u64 - 1) as usize;
            let mut way = random.sign();
            let mut ways = Vec::with_capacity(rows);
            for row in 0..rows {
                let change = if row == 0 { 0.0 } else { points[row][k] - points[row - 1][k] };
                if change != 0.0 {
                    way = change.signum();
                }
                ways.push(way);
            }
            let ups = ways.iter().filter(|way| **way > 0.0).count();
            let turns = ways.windows(2).filter(|pair| pair[0] != pair[1]).count();
            // A design that approaches nearly all points from one side does not show it.
            if turns < 8 || 4 * ups < rows || 4 * ups > 3 * rows {
                return None;
            }
            // Only the part that the terms of the file and of the next order cannot approximate counts.
            let visible = |shape: &[f64]| {
                let order = world.terms.iter().map(|(powers, _)| powers.iter().sum::<u32>()).max().unwrap_or(0);
                let imitating = up_to(count, order + 1);
                let imitation: Vec<(Powers, f64)> = {
                    let coefficients = fit(&imitating, &points, shape);
                    imitating.into_iter().zip(coefficients).collect()
                };
                // With fewer levels than powers, the terms depend on each other, and their least squares fail.
                let left = root_mean_square(points.iter().zip(shape).map(|(x, y)| y - value(&imitation, x)));
                (left <= root_mean_square(shape.iter().copied())).then_some(left)
            };
            if random.whole(0, 1) == 1 {
                let shown = visible(&ways).filter(|shown| *shown > 0.4)?;
                let size = sigma * random.spread(1.5, 6.0) / shown;
                y.iter_mut().zip(&ways).for_each(|(y, way)| *y += size * way);
            } else {
                // Lost motion: the input itself lags behind its reading.
                let lag = random.uniform(0.02, 0.15);
                let moved: Vec<f64> = (0..rows)
                    .map(|row| {
                        let mut x = points[row].clone();
                        x[k] -= lag * ways[row];
                        world.value(&x)
                    })
                    .collect();
                let change: Vec<f64> = moved.iter().zip(&points).map(|(there, x)| there - world.value(x)).collect();
                let seen = visible(&change)? / sigma;
                if !(1.5..=6.0).contains(&seen) {
                    return None;
                }
                (0..rows).for_each(|row| y[row] = moved[row] + noise[row]);
            }
            Fault { what: "depends on the direction of approach", column: "y".into(), rows: Vec::new() }
        }
    };
    Some(Readings { points, y, fault })
}

/// The case of a name.
pub fn make(seed: u64, name: &str, kind: FaultKind) -> Case {
    let random = &mut Random::new(seed, name);
    let (world, readings) = loop {
        let world = World::new(random);
        if let Some(readings) = readings(random, &world, kind) {
            break (world, readings);
        }
    };
    let count = world.inputs.len();
    let powers: Vec<Powers> = world.terms.iter().map(|(powers, _)| powers.clone()).collect();
    let fitted = random.whole(0, 1) == 1;
    let rows_of_file = (powers.len() * 3).max(30) + random.whole(0, 60) as usize;
    let (nominal, evidence) = if fitted {
        let old: Vec<Vec<f64>> = (0..rows_of_file).map(|_| (0..count).map(|_| random.uniform(-1.0, 1.0)).collect()).collect();
        let y: Vec<f64> = old.iter().map(|x| world.value(x) + world.sigma * random.normal()).collect();
        let found: Vec<(Powers, f64)> = powers.iter().cloned().zip(fit(&powers, &old, &y)).collect();
        let square: f64 = old.iter().zip(&y).map(|(x, y)| (y - value(&found, x)).powi(2)).sum();
        (found, Some((rows_of_file, (square / (rows_of_file - powers.len()) as f64).sqrt())))
    } else {
        (world.terms.clone(), None)
    };
    let natural = |points: &[Vec<f64>]| -> Vec<Vec<f64>> {
        points.iter().map(|x| world.inputs.iter().zip(x).map(|(input, x)| input.natural(*x)).collect()).collect()
    };
    let unseen: Vec<Vec<f64>> = (0..60).map(|_| (0..count).map(|_| random.uniform(-0.9, 0.9)).collect()).collect();
    let exact: Vec<f64> = unseen.iter().map(|x| world.value(x)).collect();
    let measured: Vec<f64> = exact.iter().map(|y| y + world.sigma * random.normal()).collect();
    Case {
        name: name.to_string(),
        verdict: "no-discrepancy",
        truths: Vec::new(),
        model: model_file(&world.inputs, &nominal, evidence),
        data: table(&world.inputs, &natural(&readings.points), &readings.y, None, None),
        unseen: table(&world.inputs, &natural(&unseen), &measured, None, None),
        nominal: unseen.iter().map(|x| value(&nominal, x)).collect(),
        exact,
        in_file: false,
        fault: Some(readings.fault),
    }
}
