//! The damping surface of the driveline follows the wear of the car, in f32.
//!
//! In: after each tip-in that was followed without the compensator, road speed, gear and the damping ratio that the speed showed. Out: the surface
//! with adapted coefficients. The step is recursive least squares of constant cost without a branch; a bad value changes nothing. The compensator of
//! [`crate::step`] keeps the surface of the file, for which `rsm check` proved that it is stable.
//!
//! ```
//! use throttle_loop::wear::Wear;
//!
//! let mut wear = Wear::new();
//! let new = wear.damping_ratio(10.0, 2);
//! for _ in 0..100 {
//!     wear.measured(10.0, 2, 0.7 * new);                          // the car lost three tenths of its damping there
//! }
//! assert!((wear.damping_ratio(10.0, 2) / new - 0.7).abs() < 0.01);
//! ```

use crate::driveline::{DampingRatioStateF32, damping_ratio_adapted_f32, damping_ratio_init_f32, damping_ratio_update_f32};

/// The damping surface with its adapted coefficients.
pub struct Wear {
    state: DampingRatioStateF32,
}

/// What a measured damping did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// The measured damping minus that of the surface before.
    pub error: f32,
    /// The variance of this error, in units of that of the noise.
    pub variance: f32,
    /// 0, or why the sample changed nothing: 1 a number is not finite, 2 outside the range of an input or the support, 3 an error above five standard
    /// deviations, 4 a coefficient would not be finite.
    pub frozen: f32,
}

impl Wear {
    /// The surface of the coefficient file.
    #[must_use]
    pub fn new() -> Self {
        Wear { state: damping_ratio_init_f32() }
    }

    /// One step with a measured damping ratio.
    pub fn measured(&mut self, speed_m_s: f32, gear: u8, damping_ratio: f32) -> Update {
        let [error, variance, frozen] = damping_ratio_update_f32(&mut self.state, speed_m_s, f32::from(gear), damping_ratio);
        Update { error, variance, frozen }
    }

    /// The damping ratio of the adapted surface.
    #[must_use]
    pub fn damping_ratio(&self, speed_m_s: f32, gear: u8) -> f32 {
        damping_ratio_adapted_f32(&self.state, speed_m_s, f32::from(gear))
    }
}

impl Default for Wear {
    fn default() -> Self {
        Self::new()
    }
}
