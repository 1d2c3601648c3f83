//! The throttle's step with a simulated car: in real time, and as fast as possible.
//!
//! In: the settings of the loop. Out: its report, counts of the samples, and figures of the car. The step runs in the loop's thread, from A/D counts
//! and gear lines to a compare value as on a board; the car runs in the plant's thread.

use host_loop::{Report, Settings};
use throttle_loop::raw::{CLUTCH_LINE, Counts, RawState, Scaling, raw_step};

use crate::car::Car;
use crate::exchange::{self, Exchange, PlantEnd};

const BOARD: Scaling = Scaling::BOARD;

/// The driver: pedal, gear and clutch at a tick. Tip-in and tip-out every second, in second and in third gear, in a cycle of eight seconds; the
/// clutch is open for 200 ms at a change.
fn driver(tick: u64) -> (f64, usize, bool) {
    let ms = tick % 8000;
    let pedal = if (ms / 1000).is_multiple_of(2) { 0.1 } else { 0.6 };
    let gear = if ms < 4000 { 2 } else { 3 };
    (pedal, gear, ms % 4000 < 200)
}

/// The A/D counts for a value, the inverse of the table.
fn counts_of(channel: &throttle_loop::raw::Channel, value: f64) -> f64 {
    (f64::from(channel.zero) + value / f64::from(channel.per_count)).round().clamp(0.0, 4095.0)
}

/// Figures of the car.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Figures {
    /// The largest step of the throttle between two ticks, 0 to 1.
    pub largest_step: f64,
    /// The largest difference between throttle and pedal.
    pub most_compensated: f64,
    /// The highest acceleration, in m/s^2.
    pub highest_acceleration: f64,
    /// The highest speed, in m/s.
    pub highest_speed: f64,
}

/// One millisecond of the car: its state at the end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The pedal, 0 to 1, before the simulated broken wire.
    pub pedal: f64,
    /// The gear.
    pub gear: usize,
    /// The throttle that acted, 0 to 1.
    pub throttle: f64,
    /// Road speed, in m/s.
    pub speed: f64,
    /// Acceleration, in m/s^2.
    pub acceleration: f64,
}

/// Runs the car's side for this many milliseconds. `exchange` gets the input of [`Step::answer`] and returns the command for the millisecond that
/// begins, or `None` to end the run. `seen` gets every complete millisecond. One sample a second is bad on purpose.
pub fn ride(
    ticks: u64,
    period_ns: u64,
    mut exchange: impl FnMut([f64; 4]) -> Option<[f64; 1]>,
    mut seen: impl FnMut(&Row),
) -> Figures {
    // 8 m/s in second gear is 1950 rpm.
    let mut car = Car::new(8.0, 2);
    let mut figures = Figures::default();
    let mut last = 0.0;
    for tick in 0..ticks {
        let (pedal, gear, clutch) = driver(tick);
        let lines = f64::from(1u32 << (gear - 1) | if clutch { CLUTCH_LINE } else { 0 });
        // A bad sample is a broken wire: no counts.
        let pedal_counts = if crate::is_bad_sample(tick, period_ns) { 0.0 } else { counts_of(&BOARD.pedal, pedal) };
        let plate_counts = counts_of(&BOARD.plate, last);
        let sample = [pedal_counts, plate_counts, counts_of(&BOARD.speed, car.speed()), lines];
        let Some([compare]) = exchange(sample) else { break };
        let throttle = (compare - f64::from(BOARD.compare_closed)) / f64::from(BOARD.compare_span);
        figures.largest_step = figures.largest_step.max((throttle - last).abs());
        figures.most_compensated = figures.most_compensated.max((throttle - pedal).abs());
        last = throttle;
        car.tick(throttle, gear);
        figures.highest_acceleration = figures.highest_acceleration.max(car.acceleration());
        figures.highest_speed = figures.highest_speed.max(car.speed());
        seen(&Row { pedal, gear, throttle, speed: car.speed(), acceleration: car.acceleration() });
    }
    figures
}

/// The compare value of a closed throttle: the command before the first answer.
pub const CLOSED: [f64; 1] = [BOARD.compare_closed as f64];

/// The step alone, from counts: it gets a sample and returns a command.
#[derive(Debug, Clone, Default)]
pub struct Step {
    state: RawState,
}

impl Step {
    /// The compare value of the throttle for a sample: counts of pedal, plate and road speed, and the bits of gear and clutch lines. A value that is
    /// not a valid count is used as 0, like a broken wire.
    pub fn answer(&mut self, [pedal, plate, speed, lines]: [f64; 4]) -> [f64; 1] {
        let counts = Counts { pedal: pedal as u16, plate: plate as u16, speed: speed as u16, lines: lines as u32 };
        [f64::from(raw_step(&mut self.state, &BOARD, &counts))]
    }

    /// Number of bad samples.
    #[must_use]
    pub fn bad_samples(&self) -> u32 {
        self.state.step.bad.all
    }
}

/// The result of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Times and ticks; the compute time is that of the step alone.
    pub report: Report,
    /// Counts of samples.
    pub exchange: Exchange,
    /// Number of ticks with a bad sample.
    pub bad_samples: u32,
    /// Figures of the car.
    pub figures: Figures,
}

/// Runs the loop in real time. A tick is a millisecond for the car, at any rate.
#[must_use]
pub fn run(settings: &Settings) -> Run {
    let (ticks, period_ns) = (settings.ticks, settings.period_ns);
    let mut step = Step::default();
    let plant = |end: &mut PlantEnd<'_, 4, 1>| ride(ticks, period_ns, |sample| Some(end.exchange(sample)), |_| ());
    let (report, exchange, figures) = exchange::run(settings, CLOSED, plant, |sample| step.answer(sample));
    Run { report, exchange, bad_samples: step.bad_samples(), figures }
}

/// The same car and driver without a clock, in one thread. Returns the figures, and the ratio of simulated to elapsed time.
#[must_use]
pub fn simulate(seconds: f64) -> (Figures, f64) {
    let mut step = Step::default();
    let mut command = CLOSED;
    let began = std::time::Instant::now();
    let ticks = (seconds * 1000.0).round().max(1.0) as u64;
    // A command acts one tick after its sample, as in real time.
    let figures = ride(ticks, 1_000_000, |sample| Some(std::mem::replace(&mut command, step.answer(sample))), |_| ());
    (figures, ticks as f64 * 1e-3 / began.elapsed().as_secs_f64())
}

impl Run {
    /// One JSON object.
    #[must_use]
    pub fn json(&self) -> String {
        let Figures { largest_step, most_compensated, highest_acceleration, highest_speed } = self.figures;
        format!(
            r#"{{"loop":"throttle","report":{},"exchange":{},"bad_samples":{},"figures":{{"largest_step":{largest_step},"most_compensated":{most_compensated},"highest_acceleration_m_s2":{highest_acceleration},"highest_speed_m_s":{highest_speed}}}}}"#,
            self.report.json(),
            self.exchange.json(),
            self.bad_samples,
        )
    }
}

impl std::fmt::Display for Run {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Figures { largest_step, most_compensated, highest_acceleration, highest_speed } = self.figures;
        writeln!(f, "{}\n{}", self.report, self.exchange)?;
        write!(
            f,
            "car       up to {highest_speed:.1} m/s and {highest_acceleration:.2} m/s^2, throttle up to {most_compensated:.3} off the pedal, \
             {largest_step:.3} a tick, {} bad samples",
            self.bad_samples
        )
    }
}
