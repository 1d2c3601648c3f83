//! A simulated plant in one thread and a step in another, both at the step's rate by the clock.
//!
//! In: the settings of the loop, the functions of plant and step. Out: the report of the loop and the counts of samples and commands. The plant does
//! not wait for the loop: at the time of tick k it sends sample k, takes the newest command, and simulates the tick. If the loop is in time, this
//! command is the answer to sample k - 1: a command acts one tick after its sample, as on a board. If the loop is late, the plant continues with an
//! older command, and the tick counts as held. The loop's thread wakes by the clock, answers every sample in order, and runs late ticks until it has
//! caught up.
//!
//! A virtual machine does not keep deadlines of a millisecond. So a command counts as an under-run only if it is later than [`BUFFER_NS`] after its
//! tick's time: a play-out buffer would hide smaller delays.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use host_loop::{Clock as _, Numbered, Report, Ring, Sequence, Settings, SystemClock, run_measured};

/// 150 ms: three times the longest observed oversleep of a virtual machine (44 ms).
pub const BUFFER_NS: u64 = 150_000_000;

/// Space in each direction: the buffer at 1 kHz, twice.
const ROOM: usize = 300;

/// The time between two checks of an empty ring. A fiftieth of a millisecond does not delay a tick, and other threads can use the processor.
const NAP: Duration = Duration::from_micros(20);

/// Counts of samples and commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Exchange {
    /// Numbers of samples that the loop did not receive, and of commands that the plant did not receive.
    pub lost: u64,
    /// Numbers that arrived twice.
    pub doubled: u64,
    /// Ticks whose sample had not arrived when they began.
    pub waits: u64,
    /// Commands that arrived later than the buffer allows.
    pub under_runs: u64,
    /// Ticks of the plant with an older command, because the answer to the sample before had not arrived.
    pub held: u64,
    /// Ticks of the plant that began after their period was over.
    pub plant_late: u64,
    /// The delay of the plant's last tick against the clock, in ns.
    pub plant_skew_ns: u64,
}

impl Exchange {
    /// One JSON object.
    #[must_use]
    pub fn json(&self) -> String {
        let Exchange { lost, doubled, waits, under_runs, held, plant_late, plant_skew_ns } = self;
        format!(
            r#"{{"lost":{lost},"doubled":{doubled},"waits":{waits},"under_runs":{under_runs},"held":{held},"plant_late":{plant_late},"plant_skew_ns":{plant_skew_ns}}}"#
        )
    }
}

impl std::fmt::Display for Exchange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Exchange { lost, doubled, waits, under_runs, held, plant_late, plant_skew_ns } = self;
        // The rings have space for twice the buffer: a number is missing only if the loop was stopped for that long.
        if lost + doubled > 0 {
            writeln!(f, "samples   {lost} LOST, {doubled} DOUBLED")?;
        }
        writeln!(
            f,
            "samples   {waits} waited for, {under_runs} commands later than a buffer of {} ms hides",
            BUFFER_NS / 1_000_000
        )?;
        write!(
            f,
            "plant     {held} ticks under an older command, {plant_late} started after their period, {:.0} us behind the clock at the end",
            *plant_skew_ns as f64 * 1e-3
        )
    }
}

/// The plant's end: its thread calls [`PlantEnd::exchange`] once a tick.
pub struct PlantEnd<'r, const S: usize, const C: usize> {
    samples: &'r Ring<S>,
    commands: &'r Ring<C>,
    period_ns: u64,
    start_ns: u64,
    tick: u64,
    seen: Sequence,
    /// The number of the newest command plus one; 0 before the first.
    newest: u64,
    last: [f64; C],
    held: u64,
    late: u64,
    skew_ns: u64,
}

impl<const S: usize, const C: usize> PlantEnd<'_, S, C> {
    /// Waits for the time of this tick, sends its sample, and returns the newest command: in the first ticks the initial command of the run.
    pub fn exchange(&mut self, values: [f64; S]) -> [f64; C] {
        if self.tick == 0 {
            self.start_ns = SystemClock.now_ns();
        }
        let due = self.start_ns + self.tick * self.period_ns;
        SystemClock.sleep_until_ns(due);
        self.skew_ns = SystemClock.now_ns().saturating_sub(due);
        self.late += u64::from(self.skew_ns > self.period_ns);
        // A full ring accepts no sample: the loop notices the gap in the numbers.
        self.samples.push(&Numbered { number: self.tick, values });
        while let Some(command) = self.commands.pop() {
            self.seen.note(command.number);
            self.newest = command.number + 1;
            self.last = command.values;
        }
        self.held += u64::from(self.newest < self.tick);
        self.tick += 1;
        self.last
    }
}

/// The next value of a ring, or `None` if the sender has ended. `waits` is called before every sleep.
fn awaited<const N: usize>(ring: &Ring<N>, ended: &AtomicBool, mut waits: impl FnMut()) -> Option<Numbered<N>> {
    loop {
        // In this order: once the end is read, everything that was sent before it has arrived.
        let over = ended.load(Ordering::Acquire);
        let next = ring.pop();
        if next.is_some() || over {
            return next;
        }
        waits();
        std::thread::sleep(NAP);
    }
}

/// Signals when it is dropped, also after a panic, that this thread sends nothing more.
struct Ended<'r>(&'r AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Runs both sides. `plant` is called once, in a thread of its own; it must exchange once for each tick of the settings. `step` computes the command
/// for a sample. The compute time is that of `step` alone.
pub fn run<const S: usize, const C: usize, T: Send>(
    settings: &Settings,
    first: [f64; C],
    plant: impl FnOnce(&mut PlantEnd<'_, S, C>) -> T + Send,
    mut step: impl FnMut([f64; S]) -> [f64; C],
) -> (Report, Exchange, T) {
    let settings = settings.clone().catching_up();
    let period_ns = settings.period_ns;
    let (samples, commands) = (Ring::new(ROOM), Ring::new(ROOM));
    let plant_ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let plants = scope.spawn(|| {
            let _ended = Ended(&plant_ended);
            let (samples, commands, seen) = (&samples, &commands, Sequence::default());
            let (start_ns, tick, newest, held, late, skew_ns) = (0, 0, 0, 0, 0, 0);
            let last = first;
            let mut end = PlantEnd { samples, commands, period_ns, start_ns, tick, seen, newest, last, held, late, skew_ns };
            let result = plant(&mut end);
            (result, end.seen, [end.held, end.late, end.skew_ns])
        });
        let mut exchange = Exchange::default();
        let mut sequence = Sequence::default();
        let mut due: Option<Instant> = None;
        let report = run_measured(&settings, |tick| {
            let mut waited = false;
            let Some(sample) = awaited(&samples, &plant_ended, || waited = true) else { return 0 };
            sequence.note(sample.number);
            let began = Instant::now();
            let values = step(sample.values);
            let computing = began.elapsed();
            commands.push(&Numbered { number: sample.number, values });
            // The times of all other ticks are counted from the first tick.
            let due = due.get_or_insert(began);
            let late = began.saturating_duration_since(*due).as_nanos() as u64;
            exchange.under_runs += u64::from(late > tick * settings.period_ns + BUFFER_NS);
            exchange.waits += u64::from(waited);
            computing.as_nanos() as u64
        });
        let (result, answered, [held, plant_late, plant_skew_ns]) =
            plants.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        // The last command is never used.
        sequence.note(settings.ticks);
        exchange.lost = sequence.lost + answered.lost;
        exchange.doubled = sequence.doubled + answered.doubled;
        (exchange.held, exchange.plant_late, exchange.plant_skew_ns) = (held, plant_late, plant_skew_ns);
        (report, exchange, result)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_answered_once_and_acts_a_tick_later_or_the_tick_is_held() {
        let settings = Settings::new(1000.0, 0.2).without_real_time();
        let plant = |end: &mut PlantEnd<'_, 1, 2>| (0..200).map(|k| end.exchange([f64::from(k)])).collect::<Vec<_>>();
        let mut answered = Vec::new();
        let (report, exchange, seen) = run(&settings, [-1.0, -2.0], plant, |[k]| {
            answered.push(k);
            [k, 2.0 * k]
        });
        assert_eq!((report.ticks_done, report.ticks_lost), (200, 0));
        assert_eq!((exchange.lost, exchange.doubled), (0, 0));
        assert_eq!(answered, (0..200).map(f64::from).collect::<Vec<_>>());
        // Tick k gets the whole answer to sample k - 1, or an older one: never a newer one, and never one older than before.
        assert_eq!(seen[0], [-1.0, -2.0]);
        let mut held = 0;
        for (k, pair) in seen.windows(2).enumerate() {
            let ([before, _], [number, twice]) = (pair[0], pair[1]);
            assert!(twice == 2.0 * number && number >= before && number <= k as f64, "tick {}: {pair:?}", k + 1);
            held += u64::from(number < k as f64);
        }
        assert_eq!(exchange.held, held);
    }

    #[test]
    fn the_plant_does_not_wait_for_a_loop_that_stands_still() {
        let settings = Settings::new(1000.0, 0.2).without_real_time();
        let plant = |end: &mut PlantEnd<'_, 1, 1>| {
            let began = Instant::now();
            let seen: Vec<f64> = (0..200).map(|k| end.exchange([f64::from(k)])[0]).collect();
            (seen, began.elapsed())
        };
        let (report, exchange, (seen, took)) = run(&settings, [-1.0], plant, |[k]| {
            if k == 50.0 {
                std::thread::sleep(Duration::from_millis(120));
            }
            [k]
        });
        // Ticks 52 to about 170 have no newer command than that of 49, or fewer ticks if the plant's thread is stopped in the meantime; the loop runs
        // every tick anyway.
        assert!(exchange.held >= 30 && seen.iter().filter(|it| **it == 49.0).count() >= 30, "{exchange}");
        assert_eq!((report.ticks_done, exchange.lost), (200, 0), "{exchange}");
        assert!(took >= Duration::from_millis(199), "{took:?}");
        assert!(exchange.to_string().contains("ticks under an older command"));
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
