//! The motion of one body in its records, and the response to a force that depends on it.
//!
//! In: prepared records and the simulation of a fit. Out: whitened responses of the linear body and its controller to forces that depend on position,
//! speed and command, and positions from a simulation corrected by the readings. Fits nothing.

use std::f64::consts::TAU;
use std::ops::Range;

use super::levenberg::Fit;
use super::one_body::{Controller, Linear, OneBody};
use super::whitened_residuals::{Prepared, WhitenedResiduals};
use crate::engine::angle::{Multiples, TOGETHER, no_sines, sin_cos};
use rsm_core::vector::{Work, widest};
use rsm_sim::effect::Wave;
use rsm_sim::record::Drive;

/// Rows on either side for the speed, of which only the sign is needed. A difference over eleven rows has a tenth of the noise of one over two.
const WIDTH: usize = 5;

/// A record, and the plant's response to a force along it.
struct RecordTrace<'k> {
    prepared: &'k Prepared,
    record: usize,
    /// The index of the position among its outputs.
    place: usize,
    position: Vec<f64>,
    speed: Vec<f64>,
    command: Vec<f64>,
    /// Its first index in the stack of residuals.
    first: usize,
    period: f64,
    answer: RowResponse,
}

/// The two points of Gauss quadrature in a row, as shares of the row (C. F. Gauss, 1814). A wave of half a turn per row is integrated to 2 %, of a
/// quarter of a turn to 0.1 %.
const NODES: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

/// The response of the linear plant over one row, and the controller if the loop is closed.
#[derive(Clone, Copy)]
struct RowResponse {
    /// The speed after a row: coefficients of the speed before, of a constant force, and of the forces at the two nodes.
    speed: [f64; 4],
    /// The displacement in a row, likewise.
    displacement: [f64; 4],
    force_gain: f64,
    controller: Option<Controller>,
}

impl RowResponse {
    /// M dv/dt + b v = f with a constant force in each row.
    fn new(linear: &Linear, period: f64) -> Self {
        let mass = linear.inertia;
        let w = linear.damping / mass * period;
        // phi_1 = (1 - e^-w)/w and phi_2 = (1 - phi_1)/w; below 1e-4 the first two terms of their series hold eight digits.
        let (one, two) = if w < 1e-4 {
            (1.0 - w / 2.0, 0.5 - w / 6.0)
        } else {
            let one = -(-w).exp_m1() / w;
            (one, (1.0 - one) / w)
        };
        let rest = |node: usize| 1.0 - NODES[node];
        let blow = 0.5 * period / mass;
        let displacement = |node: usize| period * rest(node) * (1.0 - 0.5 * w * rest(node));
        RowResponse {
            // A force at a node acts as an impulse of half a row. It decays until the end of the row.
            speed: [(-w).exp(), period * one / mass, blow * (-w * rest(0)).exp(), blow * (-w * rest(1)).exp()],
            displacement: [period * one, period * period * two / mass, blow * displacement(0), blow * displacement(1)],
            force_gain: linear.force_gain,
            controller: linear.controller,
        }
    }
}

impl RecordTrace<'_> {
    /// The position and the speed at a node of a row, and the command.
    fn node(&self, row: usize, node: usize) -> (f64, f64, f64) {
        let next = (row + 1).min(self.position.len() - 1);
        let at = |values: &[f64]| values[row] + NODES[node] * (values[next] - values[row]);
        (at(&self.position), at(&self.speed), self.command[row])
    }

    /// The positions at the nodes of all rows, one row after another.
    fn positions(&self) -> impl Iterator<Item = f64> {
        (0..self.position.len()).flat_map(|row| [self.node(row, 0).0, self.node(row, 1).0])
    }

    /// The changes of position and command by each of some forces at the nodes of each row, one at a time. A force is a function of the row and the
    /// node.
    fn run<const N: usize>(&self, force: impl Fn(usize, usize) -> [f64; N]) -> [[Vec<f64>; 2]; N] {
        let rows = self.position.len();
        let mut outputs = std::array::from_fn(|_| [vec![0.0; rows], vec![0.0; rows]]);
        widest(Motions { trace: self, force, outputs: &mut outputs });
        outputs
    }

    /// The same, whitened and written into the stacks.
    fn answer<const N: usize>(
        &self,
        whitened: &WhitenedResiduals,
        force: impl Fn(usize, usize) -> [f64; N],
        stacks: &mut [Vec<f64>; N],
    ) {
        let mut white = Vec::with_capacity(2 * self.position.len());
        for (outputs, stack) in self.run(force).iter().zip(stacks) {
            white.clear();
            for (k, output) in self.prepared.outputs.iter().enumerate() {
                let place = if *output == self.prepared.outputs[self.place] { 0 } else { 1 };
                let mut values = outputs[place].clone();
                whitened.floors[*output].scale_to_uniform(self.prepared.measured(k), &mut values);
                whitened.floors[*output].whiten(&values, &self.prepared.used[k], &mut white);
            }
            stack[self.first..self.first + white.len()].copy_from_slice(&white);
        }
    }

    /// Uses a path as the true positions, corrected by the readings around each row.
    fn follow(&mut self, path: &[f64], reach: usize) {
        let (measured, used) = (self.prepared.measured(self.place), &self.prepared.used[self.place]);
        let mut sums = vec![(0.0, 0.0)];
        let (mut sum, mut count) = (0.0, 0.0);
        for row in 0..path.len() {
            if used[row] {
                (sum, count) = (sum + measured[row] - path[row], count + 1.0);
            }
            sums.push((sum, count));
        }
        for row in 0..path.len() {
            let (low, high) = (sums[row.saturating_sub(reach)], sums[(row + reach + 1).min(path.len())]);
            self.position[row] = path[row] + (high.0 - low.0) / f64::max(high.1 - low.1, 1.0);
        }
    }
}

/// Motions by some forces along a record. Each force has its own position and command.
struct Motions<'a, F, const N: usize> {
    trace: &'a RecordTrace<'a>,
    force: F,
    outputs: &'a mut [[Vec<f64>; 2]; N],
}

impl<F: Fn(usize, usize) -> [f64; N], const N: usize> Work for Motions<'_, F, N> {
    type Found = ();

    #[inline(always)]
    fn run(self) {
        let Motions { trace, force, outputs } = self;
        let it = trace.answer;
        let (mut q, mut v) = ([0.0; N], [0.0; N]);
        let mut past = [[0.0; N]; 2];
        for row in 0..trace.position.len() {
            let (a, b) = (force(row, 0), force(row, 1));
            let mut command = [0.0; N];
            // A command at its limit does not respond.
            if let Some(it) = it.controller.filter(|it| trace.command[row].abs() < it.limit) {
                for k in 0..N {
                    let speed = if it.is_difference { (q[k] - past[1][k]) / (2.0 * trace.period) } else { v[k] };
                    command[k] = it.speed_gain * (-it.position_gain * q[k] - speed);
                }
            }
            for ([positions, commands], (q, command)) in outputs.iter_mut().zip(q.iter().zip(&command)) {
                (positions[row], commands[row]) = (*q, *command);
            }
            past = [q, past[0]];
            for k in 0..N {
                let held = it.force_gain * command[k];
                let displacement = it.displacement[0] * v[k]
                    + it.displacement[1] * held
                    + it.displacement[2] * a[k]
                    + it.displacement[3] * b[k];
                q[k] += displacement;
                v[k] = it.speed[0] * v[k] + it.speed[1] * held + it.speed[2] * a[k] + it.speed[3] * b[k];
            }
        }
    }
}

/// All records with a position.
pub struct PositionTraces<'k> {
    /// The records.
    pub whitened: &'k WhitenedResiduals,
    list: Vec<RecordTrace<'k>>,
    rows: usize,
}

impl<'k> PositionTraces<'k> {
    /// The traces for the plant of a fit.
    #[must_use]
    pub fn new(whitened: &'k WhitenedResiduals, fit: &Fit) -> Self {
        let mut list = Vec::new();
        let body = OneBody::of(fit.model.file.kind);
        // Records of one configuration have one equation.
        let mut equations: Vec<(Option<usize>, Drive, Option<Linear>)> = Vec::new();
        for (record, prepared) in whitened.records.iter().enumerate() {
            let Some(body) = body else { continue };
            let Some(k) = prepared.outputs.iter().position(|it| *it == body.position) else { continue };
            let of = &prepared.record;
            let known = equations.iter().find(|it| (it.0, it.1) == (of.configuration, of.drive)).map(|it| it.2);
            let linear = known.unwrap_or_else(|| {
                let linear = body.linear(&fit.model.file, of);
                equations.push((of.configuration, of.drive, linear));
                linear
            });
            let Some(linear) = linear else { continue };
            let (position, closed) = (prepared.measured(k), of.drive == Drive::Closed);
            let command = match prepared.outputs.iter().position(|it| Some(*it) == body.command).filter(|_| closed) {
                Some(k) => prepared.measured(k).to_vec(),
                // Without the command of the controller, the force is not known.
                None if closed => continue,
                None => of.inputs[0].clone(),
            };
            let rows = position.len();
            if command.len() != rows || rows < 4 * WIDTH {
                continue;
            }
            let speed = |row: usize| {
                let (a, b) = (row.saturating_sub(WIDTH), (row + WIDTH).min(rows - 1));
                (position[b] - position[a]) / ((b - a) as f64 * of.period)
            };
            list.push(RecordTrace {
                speed: (0..rows).map(speed).collect(),
                prepared,
                record,
                place: k,
                position: position.to_vec(),
                command,
                first: whitened.first(record),
                period: of.period,
                answer: RowResponse::new(&linear, of.period),
            });
        }
        PositionTraces { whitened, list, rows: fit.residual.len() }
    }

    /// The whitened responses to forces that depend on position, speed and command.
    #[must_use]
    pub fn answer<const N: usize>(&self, law: impl Fn(f64, f64, f64) -> [f64; N]) -> [Vec<f64>; N] {
        let mut stacks = std::array::from_fn(|_| vec![0.0; self.rows]);
        for it in &self.list {
            let force = |row: usize, node: usize| {
                let (position, speed, command) = it.node(row, node);
                law(position, speed, command)
            };
            it.answer(self.whitened, force, &mut stacks);
        }
        stacks
    }

    /// Uses the simulation of another fit to the same records as the true positions, corrected by the readings.
    pub fn follow(&mut self, fit: &Fit, reach: usize) {
        for it in &mut self.list {
            it.follow(&fit.simulated[it.record][it.place], reach);
        }
    }

    /// Uses the positions of `before`, changed by this plant's response to a wave.
    pub fn follow_with(&mut self, fit: &Fit, before: &PositionTraces<'_>, wave: &Wave, reach: usize) {
        let number = TAU / wave.pitch;
        for (it, before) in self.list.iter_mut().zip(&before.list) {
            it.position.clone_from(&before.position);
            let [[moved, _]] = it.run(|row, node| [wave.amplitude * sin_cos(number * it.node(row, node).0 + wave.phase).0]);
            let path: Vec<f64> = fit.simulated[it.record][it.place].iter().zip(&moved).map(|(a, b)| a + b).collect();
            it.follow(&path, reach);
        }
    }

    /// The responses to a wave along the measured positions, and to the same wave a quarter period further.
    #[must_use]
    pub fn traces(&self, wave: &Wave) -> [Vec<f64>; 2] {
        let number = TAU / wave.pitch;
        self.answer(|q, _, _| {
            let (sin, cos) = sin_cos(number * q + wave.phase);
            [wave.amplitude * sin, wave.amplitude * cos]
        })
    }

    /// The responses to a unit wave of phase 0 and to the same a quarter period further, for some multiples of a wave number in rad per unit of the
    /// position.
    #[must_use]
    pub fn multiples(&self, number: f64, multiples: Range<usize>) -> Vec<[Vec<f64>; 2]> {
        let groups = multiples.len().div_ceil(TOGETHER);
        let mut list: Vec<[Vec<f64>; 2 * TOGETHER]> =
            (0..groups).map(|_| std::array::from_fn(|_| vec![0.0; self.rows])).collect();
        for it in &self.list {
            let mut sines = Multiples::new(it.positions().map(|q| number * q).collect(), multiples.start);
            let mut together = no_sines(2 * it.position.len());
            for stacks in &mut list {
                sines.take(&mut together);
                let force = |row: usize, node: usize| -> [f64; 2 * TOGETHER] {
                    let (sines, cosines) = &together[2 * row + node];
                    std::array::from_fn(|k| if k < TOGETHER { sines[k] } else { cosines[k - TOGETHER] })
                };
                it.answer(self.whitened, force, stacks);
            }
        }
        let pairs = |stacks: [Vec<f64>; 2 * TOGETHER]| {
            let mut sines = Vec::from(stacks);
            let cosines = sines.split_off(TOGETHER);
            sines.into_iter().zip(cosines).map(<[Vec<f64>; 2]>::from)
        };
        list.into_iter().flat_map(pairs).take(multiples.len()).collect()
    }
}
