//! The periodic loop.
//!
//! In: settings, a clock, a step. Out: a [`Report`]. Tick k has the time [k T, (k + 1) T) after the start. The loop sleeps until k T, and runs tick k
//! if it wakes before this time is over. If the time is over, [`Late`] decides: the loop drops the missed ticks and continues with the present one,
//! or it runs them one after another until it has caught up. It never runs a tick twice.

use crate::clock::{Clock, SystemClock};
use crate::realtime::RealTime;
use crate::report::{Report, Summary};

/// What to do with a tick whose time was over before it could start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Late {
    /// It is lost: the loop continues with the present tick. Use this if a step depends on the present time only.
    #[default]
    Drop,
    /// It is run immediately, late, and counted: none is lost. Use this if every sample waits in a buffer and needs an answer.
    CatchUp,
}

/// The settings of a loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The period, in nanoseconds, at least 1.
    pub period_ns: u64,
    /// The number of periods of the run.
    pub ticks: u64,
    /// Whether to request locked memory and real-time priority.
    pub real_time: bool,
    /// What to do with late ticks.
    pub late: Late,
}

impl Settings {
    /// A loop of `rate_hz` for `seconds`, which requests real-time priority and locked memory. Both numbers are rounded to whole nanoseconds and
    /// whole ticks. Impossible values (zero, negative, NaN) become the smallest possible ones: one tick, one nanosecond.
    #[must_use]
    pub fn new(rate_hz: f64, seconds: f64) -> Self {
        // A float-to-integer cast saturates and converts NaN to 0.
        let period_ns = ((1e9 / rate_hz).round() as u64).max(1);
        let ticks = ((seconds * 1e9 / period_ns as f64).round() as u64).max(1);
        Settings { period_ns, ticks, real_time: true, late: Late::Drop }
    }

    /// The same loop, which runs late ticks so that none is lost.
    #[must_use]
    pub fn catching_up(mut self) -> Self {
        self.late = Late::CatchUp;
        self
    }

    /// The same loop as an ordinary process.
    #[must_use]
    pub fn without_real_time(mut self) -> Self {
        self.real_time = false;
        self
    }
}

/// Runs `step` once for each tick, with the number of the tick, on the system's clock. The compute time is the whole time of the step.
pub fn run(settings: &Settings, step: impl FnMut(u64)) -> Report {
    run_with_clock(settings, &mut SystemClock, step)
}

/// As [`run`], for a step that waits for its sample: `step` returns the nanoseconds of it that were compute time.
pub fn run_measured(settings: &Settings, mut step: impl FnMut(u64) -> u64) -> Report {
    run_loop(settings, &mut SystemClock, |tick, _| step(tick))
}

/// As [`run`], on any clock.
pub fn run_with_clock(settings: &Settings, clock: &mut impl Clock, mut step: impl FnMut(u64)) -> Report {
    run_loop(settings, clock, |tick, clock| {
        let began_ns = clock.now_ns();
        step(tick);
        clock.now_ns().saturating_sub(began_ns)
    })
}

/// The first period starts this long after the call, so that the preparations do not make the first tick late: 2 ms, about a hundred times the time
/// for reading the clock and starting to sleep.
const LEAD_NS: u64 = 2_000_000;

fn run_loop<C: Clock>(settings: &Settings, clock: &mut C, mut step: impl FnMut(u64, &mut C) -> u64) -> Report {
    let Settings { period_ns, ticks, real_time, late } = *settings;
    let mut compute_ns = samples(ticks);
    let mut lateness_ns = samples(ticks);
    let granted = if real_time { RealTime::ask() } else { RealTime::not_asked() };

    let start_ns = clock.now_ns() + LEAD_NS;
    let mut lost = 0;
    let mut caught_up = 0;
    let mut deadlines_missed = 0;
    let mut tick = 0;
    while tick < ticks {
        clock.sleep_until_ns(start_ns + tick * period_ns);
        let woke_ns = clock.now_ns();
        let current = (woke_ns.saturating_sub(start_ns) / period_ns).max(tick);
        match late {
            Late::Drop => {
                lost += current.min(ticks) - tick;
                tick = current;
                if tick >= ticks {
                    break;
                }
            }
            Late::CatchUp => caught_up += u64::from(current > tick),
        }
        let computing_ns = step(tick, clock);
        // Both have room for one sample for each tick, so that no push allocates.
        lateness_ns.push(woke_ns.saturating_sub(start_ns + tick * period_ns));
        compute_ns.push(computing_ns);
        deadlines_missed += u64::from(clock.now_ns() > start_ns + (tick + 1) * period_ns);
        tick += 1;
    }

    let (locked_memory, priority) = (granted.memory.clone(), granted.priority.clone());
    drop(granted);
    Report {
        period_ns,
        ticks_wanted: ticks,
        ticks_done: compute_ns.len() as u64,
        ticks_lost: lost,
        ticks_caught_up: caught_up,
        drops: late == Late::Drop,
        deadlines_missed,
        skew_ns: lateness_ns.last().copied().unwrap_or(0),
        compute: Summary::of(&mut compute_ns),
        lateness: Summary::of(&mut lateness_ns),
        locked_memory,
        priority,
    }
}

/// Memory for one sample for each tick. Every page of it is written once, so that the loop has no page fault.
fn samples(ticks: u64) -> Vec<u64> {
    let mut samples = vec![u64::MAX; usize::try_from(ticks).expect("the samples of a loop fit in memory")];
    // Without this the compiler may remove the writes, and the pages would not be mapped.
    std::hint::black_box(samples.as_mut_slice());
    samples.clear();
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::realtime::Grant;

    const MS: u64 = 1_000_000;

    /// A clock for which the test chooses how late each sleep ends. Time passes only in sleeps and in steps.
    struct Injected<F> {
        now_ns: u64,
        oversleep_ns: F,
        sleeps: u64,
    }

    impl<F: FnMut(u64) -> u64> Clock for Injected<F> {
        fn now_ns(&mut self) -> u64 {
            self.now_ns
        }
        fn sleep_until_ns(&mut self, deadline_ns: u64) {
            self.now_ns = self.now_ns.max(deadline_ns) + (self.oversleep_ns)(self.sleeps);
            self.sleeps += 1;
        }
    }

    /// Runs ten ticks of 1 ms, in which sleep number k ends `oversleep(k)` late. Returns the ticks that were run, and the report.
    fn ten_ticks(oversleep_ns: impl FnMut(u64) -> u64) -> (Vec<u64>, Report) {
        let mut clock = Injected { now_ns: 5 * MS, oversleep_ns, sleeps: 0 };
        let mut done = Vec::new();
        let settings = Settings { period_ns: MS, ticks: 10, real_time: false, late: Late::Drop };
        let report = run_with_clock(&settings, &mut clock, |tick| done.push(tick));
        (done, report)
    }

    #[test]
    fn a_punctual_loop_does_every_tick_once() {
        let (done, report) = ten_ticks(|_| 0);
        assert_eq!(done, (0..10).collect::<Vec<_>>());
        assert_eq!((report.ticks_wanted, report.ticks_done, report.ticks_lost), (10, 10, 0));
        assert_eq!(report.lateness.max_ns, 0);
        assert_eq!(report.priority, Grant::NotAsked);
    }

    #[test]
    fn a_tick_that_starts_within_its_period_is_late_but_not_lost() {
        let (done, report) = ten_ticks(|sleep| if sleep == 3 { MS - 1 } else { 0 });
        assert_eq!(done, (0..10).collect::<Vec<_>>());
        assert_eq!((report.ticks_lost, report.lateness.max_ns), (0, MS - 1));
    }

    #[test]
    fn a_tick_whose_whole_period_has_passed_is_lost_and_the_loop_is_on_the_grid_again() {
        // The sleep of tick 3 ends 2.25 ms late: ticks 3 and 4 are over, tick 5 is done 0.25 ms late, tick 6 on time.
        let (done, report) = ten_ticks(|sleep| if sleep == 3 { 2 * MS + MS / 4 } else { 0 });
        assert_eq!(done, [0, 1, 2, 5, 6, 7, 8, 9]);
        assert_eq!((report.ticks_done, report.ticks_lost), (8, 2));
        assert_eq!(report.lateness.max_ns, MS / 4);
    }

    #[test]
    fn a_loop_that_catches_up_does_every_tick_once_and_counts_the_late_ones() {
        // As above, tick 3 starts 2.25 ms late; 4 and 5 follow immediately, 1.25 and 0.25 ms late: 3 and 4 are after their time.
        let mut clock =
            Injected { now_ns: 5 * MS, oversleep_ns: |sleep| if sleep == 3 { 2 * MS + MS / 4 } else { 0 }, sleeps: 0 };
        let mut done = Vec::new();
        let settings = Settings { period_ns: MS, ticks: 10, real_time: false, late: Late::CatchUp };
        let report = run_with_clock(&settings, &mut clock, |tick| done.push(tick));
        assert_eq!(done, (0..10).collect::<Vec<_>>());
        assert_eq!((report.ticks_done, report.ticks_lost, report.ticks_caught_up), (10, 0, 2));
        // The step takes no time: 3 and 4 end when they start.
        assert_eq!((report.deadlines_missed, report.skew_ns), (2, 0));
        assert_eq!(report.lateness.max_ns, 2 * MS + MS / 4);
    }

    #[test]
    fn exactly_one_period_late_is_the_next_ticks_time() {
        let (done, report) = ten_ticks(|sleep| if sleep == 3 { MS } else { 0 });
        assert_eq!(done, [0, 1, 2, 4, 5, 6, 7, 8, 9]);
        assert_eq!((report.ticks_done, report.ticks_lost), (9, 1));
    }

    #[test]
    fn a_loop_that_oversleeps_its_end_loses_the_rest_and_no_more() {
        let (done, report) = ten_ticks(|sleep| if sleep == 4 { 1000 * MS } else { 0 });
        assert_eq!(done, [0, 1, 2, 3]);
        assert_eq!((report.ticks_wanted, report.ticks_done, report.ticks_lost), (10, 4, 6));
    }

    #[test]
    fn a_step_longer_than_its_period_loses_the_ticks_it_covers() {
        let mut clock = Injected { now_ns: 0, oversleep_ns: |_| 0, sleeps: 0 };
        // Every step takes 2.5 periods: after tick 0 the time is 2.5, so tick 1 is over and tick 2 has begun; after tick 2 it is 5.0, so 3 and 4 are
        // over.
        let settings = Settings { period_ns: MS, ticks: 10, real_time: false, late: Late::Drop };
        let mut done = Vec::new();
        let shared = std::cell::RefCell::new(&mut clock);
        struct Shared<'a, C>(&'a std::cell::RefCell<&'a mut C>);
        impl<C: Clock> Clock for Shared<'_, C> {
            fn now_ns(&mut self) -> u64 {
                self.0.borrow_mut().now_ns()
            }
            fn sleep_until_ns(&mut self, deadline_ns: u64) {
                self.0.borrow_mut().sleep_until_ns(deadline_ns);
            }
        }
        let report = run_with_clock(&settings, &mut Shared(&shared), |tick| {
            done.push(tick);
            shared.borrow_mut().now_ns += 5 * MS / 2;
        });
        assert_eq!(done, [0, 2, 5, 7]);
        assert_eq!((report.ticks_done, report.ticks_lost), (4, 6));
        assert_eq!(report.compute.max_ns, 5 * MS / 2);
        // All four end after their period; the last tick, 7, began at 7.5.
        assert_eq!((report.deadlines_missed, report.skew_ns), (4, MS / 2));
    }

    #[test]
    fn settings_that_cannot_be_a_loop_become_the_nearest_that_can() {
        assert_eq!(Settings::new(1000.0, 2.0), Settings { period_ns: MS, ticks: 2000, real_time: true, late: Late::Drop });
        assert_eq!(Settings::new(1000.0, -1.0).ticks, 1);
        assert_eq!(Settings::new(1e12, 1e-9).period_ns, 1);
        assert_eq!(Settings::new(f64::NAN, f64::NAN), Settings { period_ns: 1, ticks: 1, real_time: true, late: Late::Drop });
    }

    #[test]
    fn a_short_real_run_does_its_ticks_at_their_times() {
        let mut ticks = Vec::with_capacity(200);
        let started = std::time::Instant::now();
        let report = run(&Settings::new(1000.0, 0.2), |tick| ticks.push(tick));
        let took = started.elapsed();
        assert_eq!(report.ticks_wanted, 200);
        assert_eq!(report.ticks_done + report.ticks_lost, 200);
        assert_eq!(report.ticks_done, ticks.len() as u64);
        assert!(ticks.is_sorted_by(|a, b| a < b), "a tick was done twice or out of order: {ticks:?}");
        // The last tick starts at 199 ms, or later on a busy machine; the delay is not tested.
        assert!(took.as_millis() >= 199, "{took:?}");
        assert_ne!(report.priority, Grant::NotAsked);
        assert_ne!(report.locked_memory, Grant::NotAsked);
    }
}
