//! Is a sample plausible, in range and in rate? One rule for every sensor of both steps.
//!
//! In: a sample, what is expected of it, its limits. Out: the value to go on with, and whether the sample was good. A NaN and an infinity are in no range, so
//! one comparison finds them all. Never branches.

use branch_free::{at_least, magnitude, select};

/// How much of a good sample of bus or speed is believed. Their samples wander slowly (a speed by 0.2 rad/s a period), so a lag of four periods costs nothing, and a wild one that is in the
/// band moves the value by a quarter.
const BELIEVED_LEVEL: f32 = 0.25;

/// What a sensor may say.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Band {
    /// Middle of the range, in the sensor's unit.
    pub middle: f32,
    /// Half of the range: a sample this far from the middle, or farther, is bad.
    pub half: f32,
    /// A sample this far from what is expected, or farther, is bad.
    pub rate: f32,
}

/// A value to go on with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judged {
    /// The sample, or what was expected in its place.
    pub value: f32,
    /// 1 where the sample was good, else 0.
    pub good: f32,
}

/// Where `open` is 1 (else it is 0) the bridge carries nothing and what is expected is out of date: then a sample in the range is the value though it is bad, so that the
/// next one is compared with it. That is the way back after a true change that was faster than the limit. Where `fresh` is 1 nothing was ever expected, and a sample in the
/// range is good.
#[inline(always)]
pub(crate) fn judge(band: &Band, sample: f32, expected: f32, open: f32, fresh: f32) -> Judged {
    let in_range = select(magnitude(sample - band.middle), band.half, 1.0, 0.0);
    let good = in_range * select(magnitude(sample - expected), band.rate, 1.0, fresh);
    let off = select(0.0, in_range, sample - expected, 0.0);
    // Of a bad sample nothing, unless the bridge is open; of the first one all.
    let believed = select(0.0, good, BELIEVED_LEVEL, open);
    Judged { value: expected + at_least(believed, fresh) * off, good }
}
