//! The steps of the target loops, run on the host in real time.
//!
//! In: how long and how often. Out: the report of the loop and what the step did. The demand is a simple one made here, the same in every
//! run; there is no plant behind it, so nothing here says how well a controller controls. The libraries that run are those that a
//! board would run.

pub mod arguments;
pub mod motor;
pub mod throttle;

/// A sawtooth between 0 and 1 with a period in seconds.
fn triangle(time_s: f64, period_s: f64) -> f64 {
    let phase = (time_s / period_s).fract();
    1.0 - (2.0 * phase - 1.0).abs()
}

/// Whether tick `k` is one whose sample is bad: one a second, so that the runner shows what the step does then.
fn is_bad_sample(tick: u64, period_ns: u64) -> bool {
    let ticks_per_second = 1_000_000_000 / period_ns.max(1);
    tick % ticks_per_second.max(2) == ticks_per_second / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_triangle_goes_up_and_down() {
        let at = |time_s| triangle(time_s, 4.0);
        assert_eq!([at(0.0), at(1.0), at(2.0), at(3.0), at(4.0)], [0.0, 0.5, 1.0, 0.5, 0.0]);
    }

    #[test]
    fn one_sample_a_second_is_bad() {
        let bad = |ticks: u64, period_ns| (0..ticks).filter(|tick| is_bad_sample(*tick, period_ns)).count();
        assert_eq!(bad(3000, 1_000_000), 3);
        // At one tick a second or slower every other tick stays good.
        assert_eq!(bad(10, 2_000_000_000), 5);
    }
}
