//! The clock of the loop: nanoseconds that never go back, and a sleep until a time.
//!
//! In: an absolute time. Out: the present time. Tests pass a clock of their own to the loop; no other code of this package reads the time.

/// A clock for a loop.
pub trait Clock {
    /// Nanoseconds since the origin of the clock. Never less than a value returned before.
    fn now_ns(&mut self) -> u64;
    /// Returns at or after `deadline_ns`, immediately if that time has passed.
    fn sleep_until_ns(&mut self, deadline_ns: u64);
}

/// The monotonic clock of this system. Changes of the time of day do not affect it.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

#[cfg(target_os = "linux")]
mod system {
    use nix::sys::time::TimeSpec;
    use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

    const NS_PER_S: u64 = 1_000_000_000;

    impl super::Clock for super::SystemClock {
        fn now_ns(&mut self) -> u64 {
            let now = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("every POSIX host has a monotonic clock");
            now.tv_sec() as u64 * NS_PER_S + now.tv_nsec() as u64
        }

        fn sleep_until_ns(&mut self, deadline_ns: u64) {
            let request = TimeSpec::new((deadline_ns / NS_PER_S) as i64, (deadline_ns % NS_PER_S) as i64);
            // A signal ends the sleep early (EINTR). The deadline is absolute, so the same call is repeated.
            while clock_nanosleep(ClockId::CLOCK_MONOTONIC, ClockNanosleepFlags::TIMER_ABSTIME, &request)
                == Err(nix::errno::Errno::EINTR)
            {}
        }
    }
}

/// The standard library cannot sleep until a time: sleep for the remaining time, and again if the sleep was too short.
#[cfg(not(target_os = "linux"))]
mod system {
    use std::sync::OnceLock;
    use std::time::{Duration, Instant};

    static ORIGIN: OnceLock<Instant> = OnceLock::new();

    impl super::Clock for super::SystemClock {
        fn now_ns(&mut self) -> u64 {
            ORIGIN.get_or_init(Instant::now).elapsed().as_nanos() as u64
        }

        fn sleep_until_ns(&mut self, deadline_ns: u64) {
            while let Some(left) = deadline_ns.checked_sub(self.now_ns()).filter(|left| *left > 0) {
                std::thread::sleep(Duration::from_nanos(left));
            }
        }
    }
}
