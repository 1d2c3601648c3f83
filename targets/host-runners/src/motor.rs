//! The motor's step with a run-up and a run-down under changing torque.
//!
//! In: the settings of the loop. Out: its report, and the step's last references and counts.

use host_loop::{Report, Settings};
use motor_loop::{Inputs, Limits, Outputs, State, step};

/// The motor of the coefficient file's remarks: 60 A, and with it 21.6 N m.
const CURRENT_A: f32 = 60.0;
const TORQUE_NM: f32 = 21.6;
/// 7500 rpm, the end of the paper's run-up (figure 6).
const TOP_SPEED_RAD_S: f64 = 785.4;
/// Up and down again in two seconds, so that a demo of that length sees the whole range.
const RUN_S: f64 = 2.0;

/// What a run gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Times and ticks.
    pub report: Report,
    /// The references of the last tick; `None` when every tick was lost.
    pub last: Option<Outputs>,
    /// How many ticks had a bad sample, and held the references.
    pub bad_samples: u32,
    /// The largest advance angle, in degrees.
    pub largest_advance_deg: f32,
}

/// The demand at a tick: a speed triangle, torque in steps of a quarter second with braking among them, one bad sample a second.
#[must_use]
pub fn demand(tick: u64, period_ns: u64) -> Inputs {
    let time_s = tick as f64 * (period_ns as f64 * 1e-9);
    let speed = crate::triangle(time_s, RUN_S) * TOP_SPEED_RAD_S;
    let share = match (time_s * 4.0) as u64 % 4 {
        0 => 1.0,
        1 => 0.5,
        2 => 0.25,
        _ => -0.5,
    };
    let speed_rad_s = if crate::is_bad_sample(tick, period_ns) { f32::NAN } else { speed as f32 };
    Inputs { torque_nm: TORQUE_NM * share, speed_rad_s, current_a: CURRENT_A * share.abs() }
}

/// Runs the loop. The compute time is that of the demand and the step.
#[must_use]
pub fn run(settings: &Settings) -> Run {
    // 90 degrees in 20 ms, some time constants of the d axis of the motor above (0.9 mH / 0.08 ohm = 11 ms).
    let limits = Limits { current_a: CURRENT_A, advance_rate_deg_s: 4500.0 };
    let mut state = State::new(limits, settings.period_ns as f32 * 1e-9);
    let mut last = None;
    let mut largest_advance_deg = 0.0;
    let report = host_loop::run(settings, |tick| {
        let outputs = step(&mut state, demand(tick, settings.period_ns));
        if outputs.advance_deg > largest_advance_deg {
            largest_advance_deg = outputs.advance_deg;
        }
        last = Some(outputs);
    });
    Run { report, last, bad_samples: state.bad_samples(), largest_advance_deg }
}

impl Run {
    /// One JSON object.
    #[must_use]
    pub fn json(&self) -> String {
        let last = self.last.map_or("null".to_string(), |last| {
            let Outputs { advance_deg, i_d_a, i_q_a, .. } = last;
            format!(r#"{{"advance_deg":{advance_deg},"i_d_a":{i_d_a},"i_q_a":{i_q_a}}}"#)
        });
        format!(
            r#"{{"loop":"motor","report":{},"bad_samples":{},"largest_advance_deg":{},"last":{last}}}"#,
            self.report.json(),
            self.bad_samples,
            self.largest_advance_deg
        )
    }
}

impl std::fmt::Display for Run {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", self.report)?;
        write!(f, "step      largest advance {:.2} deg, {} bad samples held", self.largest_advance_deg, self.bad_samples)?;
        if let Some(last) = self.last {
            write!(f, ", last i_d {:.2} A, i_q {:.2} A", last.i_d_a, last.i_q_a)?;
        }
        Ok(())
    }
}
