//! The readings of a record in the form that the equations need: raw, smoothed, and corrected for what sensors do to them.
//!
//! In: a prepared record. Out: a signal value for each row, and which rows count. Independent of the equations.

use crate::plant::whitened_residuals::Prepared;
use rsm_sim::effect::{AXIS_SIGN_WIDTH, Role};
use rsm_sim::hooks::Hooks;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;

/// The memory in rows. With a longer memory, a constant error of a rate is larger relative to the noise, but so is the plant's response to its own
/// errors.
pub const MEMORY: f64 = 100.0;

/// The number of rows on either side over which a reading is smoothed. Smoothed readings are used to compare two versions of one reading, because the
/// noise is in both and would look like a part of the equation error.
pub const WIDTH: usize = 10;

/// Below this speed, in widths of the smoothed sign, the plant may be at rest; the holding force then does not follow from the speed.
const REST: f64 = 3.0;

/// The noise of the smoothed speed, in units of the position noise per period: the square root of the sum of squared slopes of the Hann window.
const SPEED_NOISE: f64 = 0.043;

/// The readings of a record, by output of the plant.
#[derive(Debug, Clone)]
pub struct Readings {
    raw: [Option<Vec<f64>>; OUTPUTS],
    /// Readings smoothed with a Hann window.
    smooth: [Option<Vec<f64>>; OUTPUTS],
    /// The slope of the smoothed readings, per second.
    slope: [Option<Vec<f64>>; OUTPUTS],
    /// Rows at which an axis rests.
    rests: Vec<bool>,
    /// Rows that count: no reading within their memory is left out.
    pub counts: Vec<bool>,
}

/// Rows at which an axis is at rest, from its position.
fn at_rest(positions: &[f64], speed: &[f64], period: f64) -> Vec<bool> {
    // Five standard deviations: if the noise of the speed exceeds the width of the sign, the direction is unknown too.
    let slowest = (REST * AXIS_SIGN_WIDTH).max(5.0 * SPEED_NOISE * noise(positions) / period);
    let mut rests = vec![false; speed.len()];
    let mut row = 0;
    while row < speed.len() {
        let slow = speed[row..].iter().take_while(|it| it.abs() < slowest).count();
        // A reversal is slow for a few rows. Rest lasts longer than the smoothing.
        if slow >= 3 * WIDTH {
            rests[row..row + slow].fill(true);
        }
        row += slow.max(1);
    }
    rests
}

/// The version of the readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// Unchanged.
    Raw,
    /// Smoothed.
    Smooth,
}

impl Readings {
    /// The readings of a record.
    #[must_use]
    pub fn new(prepared: &Prepared, kind: PlantKind) -> Self {
        let mut raw: [Option<Vec<f64>>; OUTPUTS] = Default::default();
        for (k, output) in prepared.outputs.iter().enumerate() {
            raw[*output] = Some(prepared.measured(k).to_vec());
        }
        let smooth = raw.clone().map(|values| values.map(|values| smoothed(&values)));
        let period = prepared.record.period;
        let slope = smooth.clone().map(|values| {
            values.map(|values| {
                let last = values.len() - 1;
                let (before, after) = (|row: usize| row.saturating_sub(1), |row: usize| (row + 1).min(last));
                let of = |row: usize| {
                    (values[after(row)] - values[before(row)]) / ((after(row) - before(row)).max(1) as f64 * period)
                };
                (0..values.len()).map(of).collect::<Vec<f64>>()
            })
        });
        let rows = prepared.record.rows();
        let rests = match (&raw[0], &slope[0]) {
            (Some(positions), Some(speed)) if kind == PlantKind::ServoAxis => at_rest(positions, speed, period),
            _ => vec![false; rows],
        };
        let memory = MEMORY as usize;
        // The initial speed comes from a few readings. After these rows, a tenth of its error is left.
        let mut left_out = if kind == PlantKind::ServoAxis { 4 * memory } else { 0 };
        let counts = (0..rows)
            .map(|row| {
                // After a reading that does not count, the observer may be far off. The end of a rest is known within the noise.
                left_out = match (prepared.used.iter().all(|used| used[row]), rests[row]) {
                    (false, _) => 4 * memory,
                    (_, true) => left_out.max(3 * memory),
                    _ => left_out.saturating_sub(1),
                };
                left_out == 0
            })
            .collect();
        Readings { raw, smooth, slope, rests, counts }
    }

    /// Rows at which an axis rests.
    #[must_use]
    pub fn rests(&self) -> &[bool] {
        &self.rests
    }

    /// The true values of an output, one for each row, by inverting the sensor effects of a file; `None` if the record does not hold the output.
    #[must_use]
    pub fn truth(&self, output: usize, version: Version, file: &PlantFile, hooks: &Hooks, record: &Record) -> Option<Vec<f64>> {
        let chosen = if version == Version::Raw { &self.raw } else { &self.smooth };
        let (values, slope) = (chosen[output].as_ref()?, self.slope[output].as_ref()?);
        let name = file.kind.outputs()[output].name;
        // The input of a slow sensor is its reading plus its time constant times the slope.
        let is_slow =
            |it: &&Entry| it.description.declared.role == Role::ReadingLag && it.arguments.subject.as_deref() == Some(name);
        let lag = file.acting().find(is_slow).map_or(0.0, |it| it.arguments.number("time_constant"));
        let late = hooks.reads_late(output) / record.period;
        let (whole, part) = (late.round(), late - late.round());
        let last = values.len() - 1;
        let of = |row: usize| {
            let at = (row + whole as usize).min(last);
            let reading = values[at] + (part * record.period + lag) * slope[at];
            hooks.truth(output, reading, record.time[row])
        };
        Some((0..values.len()).map(of).collect())
    }
}

/// A mean with a Hann window (J. von Hann), narrower at the ends.
fn smoothed(values: &[f64]) -> Vec<f64> {
    let weight = |distance: usize| 0.5 + 0.5 * (std::f64::consts::PI * distance as f64 / (WIDTH + 1) as f64).cos();
    let weights: Vec<f64> = (0..=WIDTH).map(weight).collect();
    let of = |row: usize| {
        let reach = WIDTH.min(row).min(values.len() - 1 - row);
        let mut sum = values[row];
        let mut whole = 1.0;
        for (distance, weight) in weights.iter().enumerate().take(reach + 1).skip(1) {
            sum += weight * (values[row - distance] + values[row + distance]);
            whole += 2.0 * weight;
        }
        sum / whole
    };
    (0..values.len()).map(of).collect()
}

/// The noise of positions, from their second differences. A smooth motion hardly contributes to these.
fn noise(positions: &[f64]) -> f64 {
    let curvatures = positions.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]) * (w[2] - 2.0 * w[1] + w[0]));
    (curvatures.sum::<f64>() / (6.0 * positions.len().max(1) as f64)).sqrt()
}
