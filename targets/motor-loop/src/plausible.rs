//! Checks whether a sample is plausible, in range and in rate. One rule for every sensor of both steps.
//!
//! In: a sample, its expected value, its limits. Out: the value to use, and whether the sample was good. A NaN and an infinity are outside every
//! range, so one comparison detects them all. Never branches.

use branch_free::{at_least, magnitude, select};

/// The weight of a good sample of bus voltage or speed in a first-order filter. These signals change slowly (a speed by 0.2 rad/s a period), so a lag
/// of four periods has no effect, and a wild sample in the band moves the value by only a quarter.
const BELIEVED_LEVEL: f32 = 0.25;

/// The plausible readings of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Band {
    /// Middle of the range, in the sensor's unit.
    pub middle: f32,
    /// Half of the range: a sample at this distance from the middle, or farther, is bad.
    pub half: f32,
    /// A sample at this distance from the expected value, or farther, is bad.
    pub rate: f32,
}

/// A value to use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judged {
    /// The sample, or the expected value in its place.
    pub value: f32,
    /// 1 if the sample was good, else 0.
    pub good: f32,
}

/// `open` is 1 if the bridge carries no current (else 0). The expected value is then out of date. So a sample in the range becomes the value although
/// it is bad, and the next sample is compared with it. This is the way back after a real change that was faster than the limit. `fresh` is 1 if there
/// is no expected value yet; then every sample in the range is good.
#[inline(always)]
pub(crate) fn judge(band: &Band, sample: f32, expected: f32, open: f32, fresh: f32) -> Judged {
    let in_range = select(magnitude(sample - band.middle), band.half, 1.0, 0.0);
    let good = in_range * select(magnitude(sample - expected), band.rate, 1.0, fresh);
    let off = select(0.0, in_range, sample - expected, 0.0);
    // The weight is 0 for a bad sample, unless the bridge is open, and 1 for the first one.
    let believed = select(0.0, good, BELIEVED_LEVEL, open);
    Judged { value: expected + at_least(believed, fresh) * off, good }
}
