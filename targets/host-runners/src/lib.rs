//! The steps of the target loops, run on the host against simulated plants.
//!
//! In: duration and rate. Out: the report of the loop, counts of the samples between the threads, and figures of the plant. The libraries are
//! those that a board would run. `run` is in real time, the plant in a thread of its own; `simulate` is the same plant and task without a clock.

pub mod arguments;
pub mod campaign;
pub mod car;
mod driveline;
pub mod exchange;
pub mod motor;
pub mod throttle;

/// Whether the sample of tick `k` is bad: one in each second, to show the reaction of the step.
fn is_bad_sample(tick: u64, period_ns: u64) -> bool {
    let ticks_per_second = 1_000_000_000 / period_ns.max(1);
    tick % ticks_per_second.max(2) == ticks_per_second / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_sample_a_second_is_bad() {
        let bad = |ticks: u64, period_ns| (0..ticks).filter(|tick| is_bad_sample(*tick, period_ns)).count();
        assert_eq!(bad(3000, 1_000_000), 3);
        // At one tick a second or slower, every second tick stays good.
        assert_eq!(bad(10, 2_000_000_000), 5);
    }
}
