//! A simulated plant in one thread and a step in another, at the step's rate.
//!
//! In: the settings of the loop, what the plant does with a command, what the step does with a sample. Out: the report of the loop and what became of
//! samples and commands. The plant's thread sends sample k, and simulates tick k under command k - 1: a command acts one tick after its
//! sample, as on a board. The loop's thread wakes by the clock, answers every sample in order, and does late ticks until it has caught up.
//!
//! A virtual machine does not hold deadlines of a millisecond. So commands count as played out [`BUFFER_NS`] after their tick's time, as over a network:
//! a command that comes later than that is an under-run, and nothing less is.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use host_loop::{Numbered, Report, Ring, Sequence, Settings, run_measured};

/// 150 ms: three times the longest time that a virtual machine was seen to sleep too long (44 ms).
pub const BUFFER_NS: u64 = 150_000_000;

/// Room in each direction: the buffer at 1 kHz, and as much again.
const ROOM: usize = 300;

/// Between two looks at an empty ring: a fiftieth of a millisecond is no delay for a tick, and leaves the processor to others.
const NAP: Duration = Duration::from_micros(20);

/// What became of samples and commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Exchange {
    /// Numbers of samples that the loop did not see, and of commands that the plant did not see.
    pub lost: u64,
    /// Numbers that came twice.
    pub doubled: u64,
    /// Ticks whose sample was not there yet when they began.
    pub waits: u64,
    /// Commands that came later than the buffer allows.
    pub under_runs: u64,
}

impl Exchange {
    /// One JSON object.
    #[must_use]
    pub fn json(&self) -> String {
        let Exchange { lost, doubled, waits, under_runs } = self;
        format!(r#"{{"lost":{lost},"doubled":{doubled},"waits":{waits},"under_runs":{under_runs}}}"#)
    }
}

impl std::fmt::Display for Exchange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Exchange { lost, doubled, waits, under_runs } = self;
        // Both rings have room for all that can be under way: a number that is missing or comes twice is a fault of the program, and is said only where it is there.
        if lost + doubled > 0 {
            writeln!(f, "samples   {lost} LOST, {doubled} DOUBLED")?;
        }
        write!(
            f,
            "samples   {waits} waited for, {under_runs} commands later than a buffer of {} ms hides",
            BUFFER_NS / 1_000_000
        )
    }
}

/// The plant's end: its thread calls [`PlantEnd::exchange`] once a tick.
pub struct PlantEnd<'r, const S: usize, const C: usize> {
    samples: &'r Ring<S>,
    commands: &'r Ring<C>,
    loop_ended: &'r AtomicBool,
    tick: u64,
    seen: Sequence,
    last: [f64; C],
}

impl<const S: usize, const C: usize> PlantEnd<'_, S, C> {
    /// Sends this tick's sample, and waits for the command of the tick before; the first tick has the command that the run starts with.
    pub fn exchange(&mut self, values: [f64; S]) -> [f64; C] {
        // The loop is a tick behind at most, so there is always room.
        self.samples.push(&Numbered { number: self.tick, values });
        if self.tick > 0
            && let Some(command) = awaited(self.commands, self.loop_ended, || ())
        {
            self.seen.note(command.number);
            self.last = command.values;
        }
        self.tick += 1;
        self.last
    }
}

/// The next of a ring, or `None` where the sender has ended. `waits` hears of every nap.
fn awaited<const N: usize>(ring: &Ring<N>, ended: &AtomicBool, mut waits: impl FnMut()) -> Option<Numbered<N>> {
    loop {
        // In this order: what was sent before the end is there once the end is seen.
        let over = ended.load(Ordering::Acquire);
        let next = ring.pop();
        if next.is_some() || over {
            return next;
        }
        waits();
        std::thread::sleep(NAP);
    }
}

/// Says at its end, also by a panic, that this thread sends no more.
struct Ended<'r>(&'r AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Runs both. `plant` is called once, in a thread of its own, and is to exchange once a tick for as many ticks as the settings have; `step` answers a
/// sample. The compute time is that of `step` alone.
pub fn run<const S: usize, const C: usize, T: Send>(
    settings: &Settings,
    first: [f64; C],
    plant: impl FnOnce(&mut PlantEnd<'_, S, C>) -> T + Send,
    mut step: impl FnMut([f64; S]) -> [f64; C],
) -> (Report, Exchange, T) {
    let settings = settings.clone().catching_up();
    let (samples, commands) = (Ring::new(ROOM), Ring::new(ROOM));
    let (plant_ended, loop_ended) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let plants = scope.spawn(|| {
            let _ended = Ended(&plant_ended);
            let (samples, commands, loop_ended) = (&samples, &commands, &loop_ended);
            let mut end = PlantEnd { samples, commands, loop_ended, tick: 0, seen: Sequence::default(), last: first };
            let result = plant(&mut end);
            (result, end.seen)
        });
        let mut exchange = Exchange::default();
        let mut sequence = Sequence::default();
        let ended = Ended(&loop_ended);
        let mut due: Option<Instant> = None;
        let report = run_measured(&settings, |tick| {
            let mut waited = false;
            let Some(sample) = awaited(&samples, &plant_ended, || waited = true) else { return 0 };
            sequence.note(sample.number);
            let began = Instant::now();
            let values = step(sample.values);
            let computing = began.elapsed();
            commands.push(&Numbered { number: sample.number, values });
            // The first tick is the one that the others are counted from.
            let due = due.get_or_insert(began);
            let late = began.saturating_duration_since(*due).as_nanos() as u64;
            exchange.under_runs += u64::from(late > tick * settings.period_ns + BUFFER_NS);
            exchange.waits += u64::from(waited);
            computing.as_nanos() as u64
        });
        drop(ended);
        let (result, answered) = plants.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        // The last command has nobody to play it out.
        sequence.note(settings.ticks);
        exchange.lost = sequence.lost + answered.lost;
        exchange.doubled = sequence.doubled + answered.doubled;
        (report, exchange, result)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_answered_once_and_acts_a_tick_later() {
        let settings = Settings::new(1000.0, 0.2).without_real_time();
        let plant = |end: &mut PlantEnd<'_, 1, 2>| (0..200).map(|k| end.exchange([f64::from(k)])).collect::<Vec<_>>();
        let (report, exchange, seen) = run(&settings, [-1.0, 0.0], plant, |[k]| [k, 2.0 * k]);
        assert_eq!((report.ticks_done, report.ticks_lost), (200, 0));
        assert_eq!((exchange.lost, exchange.doubled), (0, 0));
        let expected: Vec<[f64; 2]> =
            (-1..199).map(|k| if k < 0 { [-1.0, 0.0] } else { [f64::from(k), 2.0 * f64::from(k)] }).collect();
        assert_eq!(seen, expected);
    }

    #[test]
    fn a_plant_that_ends_early_leaves_its_ticks_lost_and_hangs_nothing() {
        let settings = Settings::new(1000.0, 0.02).without_real_time();
        let plant = |end: &mut PlantEnd<'_, 1, 1>| {
            for k in 0..5 {
                let _ = end.exchange([f64::from(k)]);
            }
        };
        let (_, exchange, ()) = run(&settings, [0.0], plant, |[k]| [k]);
        assert_eq!(exchange.lost, 15);
    }
}
