//! The play-out buffer between a network and a loop: values that arrive with jitter are delayed and played out at a constant rate.
//!
//! In: numbered values as they arrive. Out: one result for each tick: the value of that tick, or the last value held, or the safe state. Datagram k
//! is played at a fixed time: the time at which the fastest datagram would have delivered it, plus the length of the buffer. So delays shorter than
//! the buffer have no influence. The buffer uses no sockets and no clock.
//!
//! ```
//! use rsm_link::play_out::{PlayOut, Played};
//!
//! let mut buffer = PlayOut::new(1_000_000, 2_000_000, 1_000_000); // ticks of 1 ms, 2 ms of buffer, 1 ms of holding
//! assert_eq!(buffer.play(0), Played::Waiting);
//! for number in 0..3 {
//!     buffer.receive(number, number * 1_000_000, [number as f64, 0.0, 0.0, 0.0]);
//! }
//! assert_eq!(buffer.play(1_000_000), Played::Waiting);
//! let values: Vec<f64> = (2..5).filter_map(|ms| buffer.play(ms * 1_000_000).values()).map(|values| values[0]).collect();
//! assert_eq!(values, [0.0, 1.0, 2.0]);
//! assert!(matches!(buffer.play(5_000_000), Played::Held { .. }));
//! assert!(matches!(buffer.play(6_000_000), Played::Safe { .. }));
//! ```

use crate::loops::WIDEST;

/// The result of the buffer for a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Played {
    /// Nothing is due yet.
    Waiting,
    /// The values of this tick.
    Fresh {
        /// The number of the tick.
        number: u64,
        /// The values.
        values: [f64; WIDEST],
    },
    /// The values of this tick are missing; the last ones are held for the holding time.
    Held {
        /// The number that is missing.
        number: u64,
        /// The last values that were played.
        values: [f64; WIDEST],
    },
    /// Values have been missing for longer than the holding time: the safe state.
    Safe {
        /// The number that is missing.
        number: u64,
        /// The last values that were played.
        values: [f64; WIDEST],
    },
}

impl Played {
    /// The values, if they are fresh or held.
    #[must_use]
    pub fn values(self) -> Option<[f64; WIDEST]> {
        match self {
            Played::Fresh { values, .. } | Played::Held { values, .. } => Some(values),
            Played::Waiting | Played::Safe { .. } => None,
        }
    }

    /// The code in a record: 0 waiting, 1 fresh, 2 held, 3 safe.
    #[must_use]
    pub fn code(self) -> f64 {
        match self {
            Played::Waiting => 0.0,
            Played::Fresh { .. } => 1.0,
            Played::Held { .. } => 2.0,
            Played::Safe { .. } => 3.0,
        }
    }

    /// The number of this tick; NaN while nothing is due.
    #[must_use]
    pub fn number(self) -> f64 {
        match self {
            Played::Waiting => f64::NAN,
            Played::Fresh { number, .. } | Played::Held { number, .. } | Played::Safe { number, .. } => number as f64,
        }
    }
}

/// Counts of a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Datagrams that arrived, each number once.
    pub heard: u64,
    /// Ticks with their own values.
    pub fresh: u64,
    /// Ticks with the last values held.
    pub held: u64,
    /// Ticks in the safe state.
    pub safe: u64,
    /// Datagrams that arrived after their tick.
    pub late: u64,
    /// Datagrams whose number had already arrived.
    pub doubled: u64,
    /// Datagrams whose number is farther ahead than the buffer reaches; they are dropped.
    pub ahead: u64,
}

impl Counts {
    /// Ticks whose values were missing.
    #[must_use]
    pub fn under_runs(&self) -> u64 {
        self.held + self.safe
    }

    /// Datagrams that were due and never arrived.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.under_runs().saturating_sub(self.late)
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Slot {
    Empty,
    Full([f64; WIDEST]),
    /// It was played, or it arrived late.
    Done,
}

/// The buffer.
#[derive(Debug, Clone)]
pub struct PlayOut {
    period_ns: u64,
    buffer_ns: u64,
    /// Number of ticks for which the last value is held.
    hold: u64,
    /// The slots of the numbers from `from` on: a number uses the slot of its remainder.
    slots: Vec<Slot>,
    /// The earliest number whose slot is kept.
    from: u64,
    /// The number of the next tick; `None` before the first.
    next: Option<u64>,
    /// The time at which the fastest datagram would have delivered number 0.
    base_ns: Option<i128>,
    missing: u64,
    last: [f64; WIDEST],
    counts: Counts,
}

/// Slots for a second at 1 kHz: duplicates of older datagrams are not detected.
const SLOTS_EACH_WAY: u64 = 1000;

impl PlayOut {
    /// A buffer of this length for ticks of this period. The last value is held for the time `hold_ns`. All times in ns.
    #[must_use]
    pub fn new(period_ns: u64, buffer_ns: u64, hold_ns: u64) -> Self {
        let period_ns = period_ns.max(1);
        // As many slots for past as for future numbers, and a second more than the length of the buffer: after an interruption many datagrams may
        // arrive at once.
        let slots = 2 * SLOTS_EACH_WAY + buffer_ns.div_ceil(period_ns);
        PlayOut {
            period_ns,
            buffer_ns,
            hold: hold_ns / period_ns,
            slots: vec![Slot::Empty; usize::try_from(slots).expect("a buffer fits in memory")],
            from: 0,
            next: None,
            base_ns: None,
            missing: 0,
            last: [0.0; WIDEST],
            counts: Counts::default(),
        }
    }

    fn slot(&mut self, number: u64) -> &mut Slot {
        let index = number % self.slots.len() as u64;
        &mut self.slots[index as usize]
    }

    /// Stores a datagram that was received at this time.
    pub fn receive(&mut self, number: u64, at_ns: u64, values: [f64; WIDEST]) {
        if number < self.from {
            // The datagram is so old that its slot is used again: it may be a duplicate.
            self.counts.late += 1;
            self.counts.heard += 1;
            return;
        }
        if number - self.from >= self.slots.len() as u64 {
            self.counts.ahead += 1;
            return;
        }
        let next = self.next;
        let slot = self.slot(number);
        match (*slot, next) {
            (Slot::Full(_) | Slot::Done, _) => {
                self.counts.doubled += 1;
                return;
            }
            (Slot::Empty, Some(next)) if number < next => {
                *slot = Slot::Done;
                self.counts.late += 1;
            }
            (Slot::Empty, _) => *slot = Slot::Full(values),
        }
        self.counts.heard += 1;
        if next.is_none() {
            let base = i128::from(at_ns) - i128::from(number) * i128::from(self.period_ns);
            self.base_ns = Some(self.base_ns.map_or(base, |known| known.min(base)));
        }
    }

    /// The values for the tick at this time. After the first tick with a value, every call plays the next number, so a loop that catches up skips
    /// none.
    pub fn play(&mut self, now_ns: u64) -> Played {
        let Some(number) = self.next.or_else(|| self.first_due(now_ns)) else { return Played::Waiting };
        self.next = Some(number + 1);
        while self.from + SLOTS_EACH_WAY < number {
            let oldest = self.from;
            *self.slot(oldest) = Slot::Empty;
            self.from += 1;
        }
        let slot = self.slot(number);
        if let Slot::Full(values) = *slot {
            *slot = Slot::Done;
            self.last = values;
            self.missing = 0;
            self.counts.fresh += 1;
            return Played::Fresh { number, values };
        }
        self.missing += 1;
        let values = self.last;
        if self.missing <= self.hold {
            self.counts.held += 1;
            Played::Held { number, values }
        } else {
            self.counts.safe += 1;
            Played::Safe { number, values }
        }
    }

    /// The number that is due now, once a number up to it has arrived; `None` before.
    fn first_due(&self, now_ns: u64) -> Option<u64> {
        let due = i128::from(now_ns) - self.base_ns? - i128::from(self.buffer_ns);
        let number = u64::try_from(due.div_euclid(i128::from(self.period_ns))).ok()?;
        // Nothing can be played before the first number has arrived.
        let has_arrived = (self.from..=number).any(|it| self.slots[(it % self.slots.len() as u64) as usize] != Slot::Empty);
        has_arrived.then_some(number)
    }

    /// The counts.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn values(number: u64) -> [f64; WIDEST] {
        [number as f64, 0.0, 0.0, 0.0]
    }

    /// Sends, receives and plays 400 ticks: number k is sent at k ms. `delay(k)` has the delay in ms of each copy that arrives; it is empty for a
    /// lost datagram. Returns the result of each tick.
    fn through(buffer_ms: u64, hold_ms: u64, delay: impl Fn(u64) -> Vec<u64>) -> (Vec<Played>, Counts) {
        let mut buffer = PlayOut::new(MS, buffer_ms * MS, hold_ms * MS);
        let mut arrivals: Vec<(u64, u64)> =
            (0..400).flat_map(|k| delay(k).into_iter().map(move |ms| ((k + ms) * MS, k))).collect();
        arrivals.sort_unstable();
        let mut arrivals = arrivals.into_iter().peekable();
        let mut played = Vec::new();
        for ms in 0..400 + buffer_ms {
            while let Some((at, number)) = arrivals.next_if(|(at, _)| *at <= ms * MS) {
                buffer.receive(number, at, values(number));
            }
            played.push(buffer.play(ms * MS));
        }
        (played, buffer.counts())
    }

    #[test]
    fn whatever_is_delayed_by_less_than_the_buffer_is_not_noticed() {
        let (played, counts) = through(20, 5, |k| vec![(k * 7) % 20]);
        assert_eq!(played[..20], [Played::Waiting; 20]);
        let expected: Vec<Played> = (0..400).map(|number| Played::Fresh { number, values: values(number) }).collect();
        assert_eq!(played[20..], expected);
        assert_eq!(counts, Counts { heard: 400, fresh: 400, ..Counts::default() });
    }

    #[test]
    fn what_is_lost_is_held_and_then_safe_and_back_at_once() {
        // Numbers 100 to 109 never arrive: five are held, five are safe, 110 is fresh.
        let (played, counts) = through(20, 5, |k| if (100..110).contains(&k) { vec![] } else { vec![0] });
        let codes: Vec<f64> = played[119..131].iter().map(|it| it.code()).collect();
        assert_eq!(codes, [1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0, 1.0]);
        assert_eq!(played[120], Played::Held { number: 100, values: values(99) });
        assert_eq!((counts.lost(), counts.under_runs(), counts.fresh), (10, 10, 390));
    }

    #[test]
    fn late_and_doubled_are_counted_and_not_played() {
        // Number 50 arrives after its tick, 60 twice, 70 twice and both late, 80 once in time and once late.
        let (played, counts) = through(20, 5, |k| match k {
            50 => vec![30],
            60 => vec![0, 3],
            70 => vec![30, 40],
            80 => vec![0, 50],
            _ => vec![0],
        });
        assert_eq!((played[70].code(), played[90].code()), (2.0, 2.0));
        assert_eq!((counts.late, counts.doubled, counts.lost(), counts.under_runs()), (2, 3, 0, 2));
        assert_eq!((counts.heard, counts.fresh), (400, 398));
    }

    #[test]
    fn a_first_datagram_that_was_slow_does_not_move_the_rest() {
        let (played, _) = through(20, 5, |k| vec![if k == 0 { 15 } else { 1 }]);
        // The fastest datagram takes 1 ms: number k is played at k + 1 + 20.
        assert_eq!(played[21], Played::Fresh { number: 0, values: values(0) });
    }

    #[test]
    fn a_number_far_ahead_is_dropped_and_one_long_ago_is_late() {
        let mut buffer = PlayOut::new(MS, 10 * MS, 0);
        buffer.receive(0, 0, values(0));
        buffer.receive(1_000_000_000, 0, values(1));
        assert_eq!((buffer.counts().ahead, buffer.counts().heard), (1, 1));
        for ms in 10..3010 {
            buffer.receive(ms, ms * MS, values(ms));
            buffer.play(ms * MS);
        }
        buffer.receive(5, 3010 * MS, values(5));
        assert_eq!(buffer.counts().late, 1);
        // Numbers 1 to 9 did not arrive in time; 5 arrived long after its tick.
        assert_eq!((buffer.counts().lost(), buffer.counts().safe), (8, 9));
    }
}
