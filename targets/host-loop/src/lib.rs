//! A periodic loop on a POSIX host, to test a control step before a board exists.
//!
//! In: a rate, a number of ticks and a step, which is called once for each tick. Out: a [`Report`] with the compute time of the step, the lateness of
//! the loop, and the numbers of ticks done and lost. The loop wakes at absolute times, so lateness never adds up. If the whole period of a tick has
//! passed before it could start, the tick is *lost*, or run late by a loop that catches up; no tick is ever run twice. [`Ring`] passes samples from
//! one thread to another without a lock. While it runs, the loop allocates nothing, writes nothing and calls only the clock and the step. If the
//! system refuses priority or locked memory, the report has the reason, and the loop runs without it.
//!
//! A virtual machine does not keep deadlines of 1 ms, with any priority. On such a machine use only compute time and lost ticks; the lateness depends
//! on the load of the machine during the run.
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
