//! The report of a loop: numbers in public fields, a few lines of text, one JSON object.
//!
//! In: the samples of a run. Out: percentiles. Each is one of the samples, never an interpolation between two.

use std::fmt;

use crate::realtime::Grant;

/// The distribution of a time, in nanoseconds. All values are zero if there was no sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Summary {
    /// At least half of the samples are not above this.
    pub p50_ns: u64,
    /// At least 99 % of the samples are not above this.
    pub p99_ns: u64,
    /// At least 99.9 % of the samples are not above this.
    pub p999_ns: u64,
    /// The largest sample.
    pub max_ns: u64,
}

impl Summary {
    /// The distribution of samples. Sorts the samples.
    pub fn of(samples: &mut [u64]) -> Self {
        samples.sort_unstable();
        Summary {
            p50_ns: percentile(samples, 500),
            p99_ns: percentile(samples, 990),
            p999_ns: percentile(samples, 999),
            max_ns: samples.last().copied().unwrap_or(0),
        }
    }

    fn json(&self) -> String {
        let Summary { p50_ns, p99_ns, p999_ns, max_ns } = self;
        format!(r#"{{"p50_ns":{p50_ns},"p99_ns":{p99_ns},"p999_ns":{p999_ns},"max_ns":{max_ns}}}"#)
    }
}

/// The smallest sample such that at least `per_mille` thousandths of the samples are not above it (the nearest-rank definition); 0 if there is no
/// sample. `sorted` must be sorted.
#[must_use]
pub fn percentile(sorted: &[u64], per_mille: usize) -> u64 {
    // rank = ceil(n p), from 1: in integers, because 0.999 * 1000 in f64 is not 999.
    let rank = (sorted.len() * per_mille).div_ceil(1000).max(1);
    sorted.get(rank - 1).or(sorted.last()).copied().unwrap_or(0)
}

/// The report of a loop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// The period of a tick.
    pub period_ns: u64,
    /// Number of ticks of the run.
    pub ticks_wanted: u64,
    /// Number of ticks that were run, each once.
    pub ticks_done: u64,
    /// Number of ticks that were not run: their whole period had passed before they could start. Done and lost ticks add up to the wanted ones.
    pub ticks_lost: u64,
    /// Number of ticks that started after their period had passed, in a loop that catches up.
    pub ticks_caught_up: u64,
    /// Whether a tick can be lost; false for a loop that catches up.
    pub drops: bool,
    /// Number of ticks that ended after their period, whenever they started.
    pub deadlines_missed: u64,
    /// The lateness of the last tick: at the end the loop is behind the clock by this time.
    pub skew_ns: u64,
    /// The compute time of the step: from its call to its end, or as the step reports it.
    pub compute: Summary,
    /// The time from the start of the tick's period to waking, for the ticks that were run.
    pub lateness: Summary,
    /// Whether the memory was locked.
    pub locked_memory: Grant,
    /// Whether the loop ran at real-time priority.
    pub priority: Grant,
}

impl Report {
    /// One JSON object: counts, the two summaries in nanoseconds, and the grants ("yes", "not asked for", "no: reason"). A loop that drops ticks has
    /// `ticks_lost`, one that catches up has `ticks_caught_up`. The number that is always 0 is left out.
    #[must_use]
    pub fn json(&self) -> String {
        let late = if self.drops {
            format!(r#""ticks_lost":{}"#, self.ticks_lost)
        } else {
            format!(r#""ticks_caught_up":{}"#, self.ticks_caught_up)
        };
        format!(
            r#"{{"period_ns":{},"ticks_wanted":{},"ticks_done":{},{late},"deadlines_missed":{},"skew_ns":{},"compute":{},"lateness":{},"locked_memory":{},"priority":{}}}"#,
            self.period_ns,
            self.ticks_wanted,
            self.ticks_done,
            self.deadlines_missed,
            self.skew_ns,
            self.compute.json(),
            self.lateness.json(),
            json_string(&self.locked_memory.to_string()),
            json_string(&self.priority.to_string()),
        )
    }
}

/// A JSON string: the reasons of the operating system may contain any character.
fn json_string(text: &str) -> String {
    let mut quoted = String::from("\"");
    for character in text.chars() {
        match character {
            '"' | '\\' => quoted.extend(['\\', character]),
            control if control < ' ' => quoted.push_str(&format!("\\u{:04x}", control as u32)),
            other => quoted.push(other),
        }
    }
    quoted.push('"');
    quoted
}

/// Microseconds, printed with the measured nanoseconds.
struct Us(u64);

impl fmt::Display for Us {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:03} us", self.0 / 1000, self.0 % 1000)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Report { compute, lateness, .. } = self;
        write!(f, "ticks     {} wanted, {} done, ", self.ticks_wanted, self.ticks_done)?;
        // Each kind of loop reports only what can happen in it: one that catches up loses no tick, and one that drops starts no tick after its
        // period.
        if self.drops {
            write!(f, "{} lost, ", self.ticks_lost)?;
        } else {
            write!(f, "{} started after their period, ", self.ticks_caught_up)?;
        }
        writeln!(f, "{} ended after it, period {}", self.deadlines_missed, Us(self.period_ns))?;
        writeln!(
            f,
            "compute   p50 {}, p99 {}, p99.9 {}, max {}",
            Us(compute.p50_ns),
            Us(compute.p99_ns),
            Us(compute.p999_ns),
            Us(compute.max_ns)
        )?;
        writeln!(
            f,
            "wake-up   late by p50 {}, p99 {}, max {}; {} behind the clock at the end",
            Us(lateness.p50_ns),
            Us(lateness.p99_ns),
            Us(lateness.max_ns),
            Us(self.skew_ns)
        )?;
        writeln!(f, "priority  {}", self.priority)?;
        write!(f, "memory    locked: {}", self.locked_memory)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_samples_by_the_nearest_rank() {
        let thousand: Vec<u64> = (1..=1000).collect();
        assert_eq!(percentile(&thousand, 500), 500);
        assert_eq!(percentile(&thousand, 990), 990);
        assert_eq!(percentile(&thousand, 999), 999);
        assert_eq!(percentile(&thousand, 1000), 1000);
        assert_eq!(percentile(&thousand, 0), 1);
        // Of three samples, only the last one is not below 99 % of them.
        assert_eq!(percentile(&[10, 20, 30], 990), 30);
        assert_eq!(percentile(&[10, 20, 30], 500), 20);
        assert_eq!(percentile(&[7], 999), 7);
        assert_eq!(percentile(&[], 500), 0);
    }

    #[test]
    fn a_summary_does_not_mind_the_order_of_the_samples() {
        let mut samples = [5, 1, 4, 2, 3];
        let summary = Summary { p50_ns: 3, p99_ns: 5, p999_ns: 5, max_ns: 5 };
        assert_eq!(Summary::of(&mut samples), summary);
        assert_eq!(Summary::of(&mut []), Summary::default());
    }

    fn example() -> Report {
        Report {
            period_ns: 1_000_000,
            ticks_wanted: 10,
            ticks_done: 9,
            ticks_lost: 1,
            ticks_caught_up: 3,
            drops: true,
            deadlines_missed: 4,
            skew_ns: 61_000,
            compute: Summary { p50_ns: 51, p99_ns: 1200, p999_ns: 1300, max_ns: 1_000_001 },
            lateness: Summary { p50_ns: 60_000, p99_ns: 90_000, p999_ns: 95_000, max_ns: 99_000 },
            locked_memory: Grant::Granted,
            priority: Grant::Refused("the \"limit\"".to_string()),
        }
    }

    #[test]
    fn the_report_is_five_lines() {
        let expected = "\
ticks     10 wanted, 9 done, 1 lost, 4 ended after it, period 1000.000 us
compute   p50 0.051 us, p99 1.200 us, p99.9 1.300 us, max 1000.001 us
wake-up   late by p50 60.000 us, p99 90.000 us, max 99.000 us; 61.000 us behind the clock at the end
priority  no: the \"limit\"
memory    locked: yes";
        assert_eq!(example().to_string(), expected);
        let catching = Report { drops: false, ticks_lost: 0, ..example() }.to_string();
        assert!(
            catching.starts_with("ticks     10 wanted, 9 done, 3 started after their period, 4 ended after it, period"),
            "{catching}"
        );
        assert!(!catching.contains("lost"), "nothing can be lost in a loop that catches up: {catching}");
    }

    #[test]
    fn the_json_escapes_what_the_system_says() {
        let json = example().json();
        assert!(
            json.starts_with(r#"{"period_ns":1000000,"ticks_wanted":10,"ticks_done":9,"ticks_lost":1,"deadlines_missed":4,"skew_ns":61000,"compute":{"p50_ns":51,"#),
            "{json}"
        );
        let catching = Report { drops: false, ticks_lost: 0, ..example() }.json();
        assert!(catching.contains(r#""ticks_done":9,"ticks_caught_up":3,"deadlines_missed":4"#), "{catching}");
        assert!(!catching.contains("lost"), "nothing can be lost in a loop that catches up: {catching}");
        assert!(json.ends_with(r#""locked_memory":"yes","priority":"no: the \"limit\""}"#), "{json}");
    }
}
