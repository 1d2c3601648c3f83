//! Waves of torque over the angle of a rotor: for every order, the column that it adds to the equation of the speed.
//!
//! In: the recorded speed of a motor. Out: two columns for each order, a quarter of a wave apart. The angle is the integral of the recorded speed, so
//! even a wave of 90 cycles per turn stays in phase. The simulated angle would be several cycles off. Fits nothing.

use super::readings::MEMORY;

/// The highest order. 36 slots with 42 poles have 252 cycles per turn, but at a hundred turns per second even order four is above a third of a
/// kilohertz. Orders above 120 are beyond what the sampling resolves.
pub const MOST: usize = 120;

/// A rotor along a record.
pub struct Turning {
    /// The angle at every row, in rad.
    angle: Vec<f64>,
    period: f64,
}

impl Turning {
    /// From speeds in rad/s; `start` is the first angle.
    #[must_use]
    pub fn new(speed: &[f64], start: f64, period: f64) -> Self {
        let mut angle = Vec::with_capacity(speed.len());
        let mut at = start;
        for row in 0..speed.len() {
            at += if row > 0 { 0.5 * period * (speed[row - 1] + speed[row]) } else { 0.0 };
            angle.push(at);
        }
        Turning { angle, period }
    }

    /// The number of turns, with both directions added.
    #[must_use]
    pub fn turns(&self) -> f64 {
        self.angle.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / std::f64::consts::TAU
    }

    /// The columns that sin(order angle) and cos(order angle), each divided by an inertia, add to the error of the speed.
    #[must_use]
    pub fn wave(&self, order: usize, inertia: f64) -> [Vec<f64>; 2] {
        let order = order as f64;
        let mut columns = [0, 1].map(|_| Vec::with_capacity(self.angle.len()));
        let mut said = [0.0; 2];
        let mut before: Option<(f64, [f64; 2])> = None;
        for angle in &self.angle {
            let phase = order * angle;
            let (sin, cos) = phase.sin_cos();
            if let Some((last, [last_sin, last_cos])) = before {
                let moved = phase - last;
                // The mean over the row, with the angle linear in time: a wave of high order turns by radians between the ends. For changes below
                // 1e-4, the mean of both ends is accurate to 1e-9.
                let mean = if moved.abs() < 1e-4 {
                    [0.5 * (sin + last_sin), 0.5 * (cos + last_cos)]
                } else {
                    [(last_cos - cos) / moved, (sin - last_sin) / moved]
                };
                for (said, mean) in said.iter_mut().zip(mean) {
                    *said += self.period / inertia * mean;
                }
            }
            for (column, said) in columns.iter_mut().zip(&mut said) {
                column.push(*said);
                *said -= *said / MEMORY;
            }
            before = Some((phase, [sin, cos]));
        }
        columns
    }
}
