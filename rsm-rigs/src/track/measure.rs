//! What is measured of a run: the mode of the driveline, the response to the pedal, overshoot, settling and rise.
//!
//! In: a trace and the engine's known lag. Out: [`Measured`]. Both fits are by the one estimator, over the same window with the same bounds and
//! weights; they differ in what they are asked:
//!
//! - the **response to the pedal** is (29) from the step of the pedal to the acceleration, engine lag and all: what the driver feels, and
//!   what a target damping is judged by;
//! - the **mode** is (29) behind the engine's lag, which a bench measures: the pair of poles that the zeros of a compensator have to cancel.
//!   In high gears the lag (0.1 s) hides it from the former fit, whose damping there is that of the lag. Two sensors see it: the slip speed
//!   between engine and wheel is the rate of the driveshaft's twist, and the acceleration is twist and its rate (spring and damper).
//!
//! Never sees a parameter of the driveline but the ratio between engine and wheel, the wheel's radius and that lag.

use rsm_core::source::Faults;

use rsm_sim::plant_file::PlantFile;

use super::estimator::{Channel, Column, Estimate, Task, estimate};
use super::plan::TipIn;
use super::run::{COAST_ROWS, PERIOD, Trace};

/// The window begins so many rows before the step: 0.1 s of the coast, whose level is then known to 0.05/sqrt(200) m/s^2.
pub const BEFORE: usize = 200;

/// The damping ratio that a compensated car shall have (the paper's target).
pub const TARGET: f64 = 0.7;

/// Samples in the mean through which overshoot is read: 40 ms, a third of the fastest shuffle's period (8 Hz; it takes 15 % of that, and 6 % of
/// third gear's), and noise over 9.
const SMOOTH: usize = 80;

/// A fit is flagged when what it leaves has more than this root mean square, as a share of its step. A quarter: a response of that misfit is
/// not one of second order.
const MISFIT: f64 = 0.25;

/// A response has settled when it stays within this share of its step.
const SETTLED: f64 = 0.05;

/// What one run gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The run.
    pub run: TipIn,
    /// Ratio of its gear.
    pub ratio: f64,
    /// Road speed just before the step, in m/s.
    pub road_speed: f64,
    /// (29) from the pedal to the acceleration.
    pub response: Estimate,
    /// (29) behind the engine's lag.
    pub mode: Estimate,
    /// Peak of the acceleration over its settled line, as a share of the step; at least 0.
    pub overshoot: f64,
    /// How far the acceleration falls back after a peak, over the settled line, as a share of the step.
    pub fall_back: f64,
    /// Until it stays within 5 % of the step around the settled line, in s.
    pub settling_time: f64,
    /// Until 90 % of the step, in s.
    pub rise_time: f64,
    /// Why the run is flagged; empty when it is not.
    pub flags: Vec<&'static str>,
}

impl Measured {
    /// Whether there is an overshoot: beyond the 5 % within which a response counts as settled. (Noise alone makes 1 to 2 % in the highest gear.)
    #[must_use]
    pub fn has_overshoot(&self) -> bool {
        self.overshoot > SETTLED
    }

    /// What is missing to the target: 0.7 less the damping ratio of the response.
    #[must_use]
    pub fn damping_error(&self) -> f64 {
        TARGET - self.response.shape.damping_ratio
    }
}

/// Measures a trace.
///
/// # Errors
/// None today but those of a plant file without the parameters of a driveline.
pub fn measure(plant: &PlantFile, run: &TipIn, trace: &Trace) -> Result<Measured, Faults> {
    let parameters = plant.effective_parameters();
    let ratio = parameters.number(&format!("gear_ratios[{}]", run.gear));
    let to_wheel = ratio * parameters.number("final_drive_ratio");
    let radius = parameters.number("wheel_radius");
    let noise = |name: &str| plant.noise.iter().find(|(found, _)| *found == name).map_or(0.0, |(_, sigma)| *sigma);
    // A sensor that is said to have no noise: then only the ratio of the weights matters, and these are of ordinary sensors.
    let sigma = |name: &str, ordinary: f64| if noise(name) > 0.0 { noise(name) } else { ordinary };
    let (of_acceleration, of_engine, of_road) =
        (sigma("acceleration", 0.05), sigma("engine_speed", 0.5), sigma("road_speed", 0.02));
    let window = COAST_ROWS - BEFORE..trace.time.len();
    let acceleration = &trace.acceleration[window.clone()];
    let slip: Vec<f64> = window.clone().map(|k| trace.engine_speed[k] / to_wheel - trace.road_speed[k] / radius).collect();
    let of_slip = (of_engine / to_wheel).hypot(of_road / radius);
    let task = |lag: f64, channels: Vec<Channel<'_>>| {
        estimate(&Task { first: -(BEFORE as f64) * PERIOD, period: PERIOD, lag, channels })
    };
    let felt = Channel { values: acceleration, sigma: of_acceleration, columns: &[Column::One, Column::Step, Column::Ramp] };
    let through_damper = [Column::One, Column::Step, Column::Ramp, Column::Rate];
    let twist_rate = [Column::One, Column::Rate, Column::Step];
    let response = task(0.0, vec![felt.clone()]);
    let mode = task(
        parameters.number("torque_lag"),
        vec![Channel { columns: &through_damper, ..felt }, Channel { values: &slip, sigma: of_slip, columns: &twist_rate }],
    );
    let before = COAST_ROWS - BEFORE..COAST_ROWS;
    let road_speed = trace.road_speed[before].iter().sum::<f64>() / BEFORE as f64;
    let settled = Settled::of(&mode);
    let times: Vec<f64> = window.map(|k| (k as f64 - COAST_ROWS as f64) * PERIOD).collect();
    let smooth = moving_mean(acceleration, SMOOTH);
    let over: Vec<f64> = smooth.iter().zip(&times).map(|(a, time)| (a - settled.at(*time)) / settled.step).collect();
    let after = &over[BEFORE..];
    let overshoot = after.iter().copied().fold(0.0, f64::max);
    let mut peak = f64::NEG_INFINITY;
    let mut fall_back: f64 = 0.0;
    for value in after {
        peak = peak.max(*value);
        fall_back = fall_back.max(peak - value);
    }
    let last_out = after.iter().rposition(|value| value.abs() > SETTLED).map_or(0, |row| row + 1);
    let goal = settled.level + 0.9 * settled.step;
    let risen = smooth[BEFORE..].iter().position(|value| *value >= goal).unwrap_or(after.len());
    let mut flags = vec![];
    if response.at_bound || mode.at_bound {
        flags.push("a bound of the fit is reached");
    }
    let misfit = of_acceleration * response.residual_ratio / settled.step;
    if misfit.is_nan() || misfit >= MISFIT {
        flags.push("not a response of second order");
    }
    Ok(Measured {
        run: *run,
        ratio,
        road_speed,
        response,
        mode,
        overshoot,
        fall_back,
        settling_time: last_out as f64 * PERIOD,
        rise_time: risen as f64 * PERIOD,
        flags,
    })
}

/// The line on which a response settles: level of the coast, step, and slope of what goes on changing. From the mode, whose lag is known: the line of
/// the response's own fit bends to its misfit.
struct Settled {
    level: f64,
    step: f64,
    slope: f64,
    since: f64,
}

impl Settled {
    fn of(mode: &Estimate) -> Self {
        let [level, step, slope] = [0, 1, 2].map(|k: usize| mode.coefficients[0][k]);
        let Estimate { shape, lag, .. } = mode;
        // A ramp is followed late by the delay, the lag and 2 zeta/w.
        let since = shape.delay + lag + 2.0 * shape.damping_ratio / shape.natural_frequency;
        Settled { level, step, slope, since }
    }

    fn at(&self, time: f64) -> f64 {
        self.level + self.step + self.slope * (time - self.since)
    }
}

/// Means over a window around each value; at the ends over what there is.
fn moving_mean(values: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let mean = |k: usize| {
        let (from, to) = (k.saturating_sub(half), (k + half + 1).min(values.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    (0..values.len()).map(mean).collect()
}
