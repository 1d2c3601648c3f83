//! Order analysis: amplitude and phase of a signal at orders of a revolution.
//!
//! In: a signal and the angle of each value; the angles may be uneven. Out: the wave at each order, by least squares. Decides nothing about the cause
//! of a wave.

use crate::engine::normal::Normal;

/// A wave amplitude sin(order angle + phase) in a signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Waves per revolution.
    pub order: u32,
    /// In the unit of the signal.
    pub amplitude: f64,
    /// In rad, between -pi and pi, relative to the rotor angle, so that it is the same in every record of one machine.
    pub phase: f64,
    /// The share of the signal's variance.
    pub share: f64,
}

/// The wave of a signal at an order, after subtracting the mean. It is a least squares fit to all values, so neither whole revolutions nor uniform
/// sampling are needed.
#[must_use]
pub fn wave(angle: &[f64], values: &[f64], order: u32) -> Wave {
    let mut matrix = [0.0; 9];
    let mut right = [0.0; 3];
    let (mut sum, mut squares) = (0.0, 0.0);
    for (angle, value) in angle.iter().zip(values) {
        let (sin, cos) = (f64::from(order) * angle).sin_cos();
        let row = [1.0, sin, cos];
        for i in 0..3 {
            right[i] += row[i] * value;
            for j in 0..3 {
                matrix[3 * i + j] += row[i] * row[j];
            }
        }
        (sum, squares) = (sum + value, squares + value * value);
    }
    let n = angle.len().min(values.len()).max(1) as f64;
    let solved = Normal::new(&matrix, 3, 0.0).solve(&right);
    let amplitude = solved[1].hypot(solved[2]);
    let variance = squares / n - (sum / n) * (sum / n);
    let share = if variance > 0.0 { 0.5 * amplitude * amplitude / variance } else { 0.0 };
    Wave { order, amplitude, phase: solved[2].atan2(solved[1]), share }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_waves_over_an_uneven_angle_come_back() {
        // Three revolutions with a speed that swings: 2 + 0.5 sin(18 a + 1) + 0.1 sin(5 a - 2).
        let angle: Vec<f64> =
            (0..3000).map(|k| 0.002 * std::f64::consts::PI * f64::from(k) + 0.01 * (0.03 * f64::from(k)).sin()).collect();
        let values: Vec<f64> = angle.iter().map(|a| 2.0 + 0.5 * (18.0 * a + 1.0).sin() + 0.1 * (5.0 * a - 2.0).sin()).collect();
        for (order, amplitude, phase) in [(18, 0.5, 1.0), (5, 0.1, -2.0)] {
            let found = wave(&angle, &values, order);
            // The other wave is not quite orthogonal over an uneven angle: a per cent of it.
            assert!((found.amplitude - amplitude).abs() < 0.006 && (found.phase - phase).abs() < 0.06, "{found:?}");
        }
        // 0.5^2/2 of 0.5^2/2 + 0.1^2/2.
        assert!((wave(&angle, &values, 18).share - 0.25 / 0.26).abs() < 0.02);
    }
}
