//! The throttle's step with a drive through the gears.
//!
//! In: the settings of the loop. Out: its report, and the step's last answer and counts.

use host_loop::{Report, Settings};
use throttle_loop::{GEARS, Inputs, Outputs, State, step};

/// The range of the surface.
const TOP_SPEED_MPH: f64 = 70.0;
/// From rest to top speed and back in two seconds, so that a short run sees every gear.
const RUN_S: f64 = 2.0;

/// What a run gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Times and ticks.
    pub report: Report,
    /// The answer of the last tick; `None` when every tick was lost.
    pub last: Option<Outputs>,
    /// How many ticks had a bad sample, and held the answer.
    pub bad_samples: u32,
    /// How many ticks were bypassed: neutral, or no positive damping ratio.
    pub bypassed: u64,
    /// The largest deficit to the target damping.
    pub largest_deficit: f64,
}

/// The drive at a tick: a speed triangle, a gear for each fifth of the speed, neutral below 1 mph, one bad sample a second.
#[must_use]
pub fn drive(tick: u64, period_ns: u64) -> Inputs {
    let time_s = tick as f64 * (period_ns as f64 * 1e-9);
    let share = crate::triangle(time_s, RUN_S);
    let speed = share * TOP_SPEED_MPH;
    let gear = if speed < 1.0 { 0 } else { 1 + ((share * f64::from(GEARS)) as u8).min(GEARS - 1) };
    let speed_mph = if crate::is_bad_sample(tick, period_ns) { f64::NAN } else { speed };
    Inputs { speed_mph, gear }
}

/// Runs the loop. The compute time is that of the drive and the step.
#[must_use]
pub fn run(settings: &Settings) -> Run {
    let mut state = State::new();
    let mut last = None;
    let mut bypassed = 0;
    let mut largest_deficit = 0.0;
    let report = host_loop::run(settings, |tick| {
        let outputs = step(&mut state, drive(tick, settings.period_ns));
        if outputs.damping_deficit > largest_deficit {
            largest_deficit = outputs.damping_deficit;
        }
        bypassed += u64::from(outputs.bypass);
        last = Some(outputs);
    });
    Run { report, last, bad_samples: state.bad_samples(), bypassed, largest_deficit }
}

impl Run {
    /// One JSON object.
    #[must_use]
    pub fn json(&self) -> String {
        let last = self.last.map_or("null".to_string(), |last| {
            let Outputs { damping_ratio, damping_deficit, bypass, .. } = last;
            format!(r#"{{"damping_ratio":{damping_ratio},"damping_deficit":{damping_deficit},"bypass":{bypass}}}"#)
        });
        format!(
            r#"{{"loop":"throttle","report":{},"bad_samples":{},"bypassed":{},"largest_deficit":{},"last":{last}}}"#,
            self.report.json(),
            self.bad_samples,
            self.bypassed,
            self.largest_deficit
        )
    }
}

impl std::fmt::Display for Run {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", self.report)?;
        write!(
            f,
            "step      largest damping deficit {:.3}, {} ticks bypassed, {} bad samples held",
            self.largest_deficit, self.bypassed, self.bad_samples
        )
    }
}
