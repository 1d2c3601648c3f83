//! A periodic loop on a POSIX host, to test a control step before a board exists.
//!
//! In: a rate, a number of ticks and a step to call once a tick. Out: a [`Report`] of how long the step took, how late the loop woke, and how many
//! ticks were done and lost. The loop wakes at absolute times, so lateness never adds up; a tick is *lost* when its whole period has passed before it
//! could start, or done late by a loop that catches up; no tick is ever done twice. [`Ring`] takes samples from one thread to another without a lock.
//! While it runs it allocates nothing, writes nothing and calls nothing but the clock and the step. What the system refuses (priority, locked memory)
//! is in the report with the reason; the loop runs all the same.
//!
//! A virtual machine does not keep deadlines of 1 ms, with any priority. On such a machine judge compute time and lost ticks only; the lateness
//! depends on its load at the time of the run.
//!
//! ```
//! use host_loop::{Settings, run};
//!
//! let mut sum = 0.0;
//! let report = run(&Settings::new(1000.0, 0.05).without_real_time(), |tick| sum += tick as f64);
//! assert_eq!(report.ticks_wanted, 50);
//! assert_eq!(report.ticks_done + report.ticks_lost, report.ticks_wanted);
//! println!("{report}");
//! ```

mod clock;
mod periodic;
mod realtime;
mod report;
mod ring;

pub use clock::{Clock, SystemClock};
pub use periodic::{Late, Settings, run, run_measured, run_with_clock};
pub use realtime::Grant;
pub use report::{Report, Summary, percentile};
pub use ring::{Numbered, Ring, Sequence};
