//! Park's transform (19) in its amplitude-invariant form: a vector of length I is three phases of peak I.
//!
//! In: phase quantities or a vector, and an electrical angle. Out: the other. The angle is that from the axis of phase a to the d axis; q leads
//! d by a quarter turn. A zero-sequence part of the phases is dropped: without a neutral conductor none flows.

/// Sine and cosine of an electrical angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angle {
    /// Sine.
    pub sin: f64,
    /// Cosine.
    pub cos: f64,
}

impl Angle {
    /// Of an angle in rad.
    #[must_use]
    pub fn new(angle_rad: f64) -> Self {
        let (sin, cos) = angle_rad.sin_cos();
        Angle { sin, cos }
    }

    /// A vector of the stator's frame (alpha along phase a) seen from the rotor.
    #[must_use]
    pub fn to_rotor(self, [alpha, beta]: [f64; 2]) -> [f64; 2] {
        [self.cos * alpha + self.sin * beta, self.cos * beta - self.sin * alpha]
    }

    /// A vector of the rotor's frame seen from the stator.
    #[must_use]
    pub fn to_stator(self, [d, q]: [f64; 2]) -> [f64; 2] {
        [self.cos * d - self.sin * q, self.sin * d + self.cos * q]
    }
}

/// sqrt(3)/2
const HALF_ROOT_3: f64 = 0.866_025_403_784_438_6;

/// Three phases as a vector of the stator's frame (Clarke): 2/3 (a - b/2 - c/2), (b - c)/sqrt 3.
#[must_use]
pub fn from_phases([a, b, c]: [f64; 3]) -> [f64; 2] {
    [(2.0 * a - b - c) / 3.0, (b - c) / (2.0 * HALF_ROOT_3)]
}

/// A vector of the stator's frame as three phases whose sum is 0.
#[must_use]
pub fn to_phases([alpha, beta]: [f64; 2]) -> [f64; 3] {
    let half = 0.5 * alpha;
    [alpha, HALF_ROOT_3 * beta - half, -HALF_ROOT_3 * beta - half]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, TAU};

    use super::*;

    #[test]
    fn there_and_back_is_where_one_was() {
        for k in 0..64 {
            let theta = f64::from(k) * 0.37 - 9.0;
            let vector = [3.0 * (1.7 * theta).cos(), -5.0 * (0.3 * theta).sin()];
            let angle = Angle::new(theta);
            let back = angle.to_rotor(from_phases(to_phases(angle.to_stator(vector))));
            // Some ten roundings of numbers below 6.
            assert!((back[0] - vector[0]).abs() < 1e-14 && (back[1] - vector[1]).abs() < 1e-14, "{theta}: {back:?} {vector:?}");
        }
    }

    #[test]
    fn currents_on_the_q_axis_peak_a_quarter_turn_after_the_rotor() {
        // i_q = 10 A at theta = 30 degrees: the vector stands at 120 degrees, along phase b: b = 10, a = c = -5.
        let phases = to_phases(Angle::new(TAU / 12.0).to_stator([0.0, 10.0]));
        let expected = [-5.0, 10.0, -5.0];
        assert!(phases.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-13), "{phases:?}");
        // And a zero sequence is dropped.
        let shifted = phases.map(|phase| phase + 3.0);
        let rotor = Angle::new(TAU / 12.0).to_rotor(from_phases(shifted));
        assert!(rotor[0].abs() < 1e-13 && (rotor[1] - 10.0).abs() < 1e-13, "{rotor:?}");
        assert!((Angle::new(FRAC_PI_2).sin - 1.0).abs() < 1e-15);
    }
}
