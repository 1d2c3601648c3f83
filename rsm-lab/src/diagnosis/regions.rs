//! Where the nominal plant is wrong: the error's energy by operating region, time and output.
//!
//! In: the residual of a fit on records. Out: regions that hold more of the error than of the rows, the worst first. Never names a cause.

use super::kernel::Kernel;
use super::levenberg::Fit;
use crate::kind::PlantKind;

/// A region with its share.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The output that is wrong, by its place in the plant.
    pub output: usize,
    /// Where, in words.
    pub region: String,
    /// Share of the squared error of all outputs, in units of their noise.
    pub share_of_error: f64,
    /// Share of the rows.
    pub share_of_rows: f64,
}

/// A region is worth a line when its share of the error is this many times its share of the rows.
const STANDS_OUT: f64 = 1.3;

/// Lines at most.
const LINES: usize = 8;

/// Regions of a fit's error.
#[must_use]
pub fn regions(kernel: &Kernel, fit: &Fit) -> Vec<Region> {
    let kind = fit.model.file.kind;
    // Error and rows of each output in each region.
    let mut sums: Vec<(usize, String, f64, f64)> = Vec::new();
    let mut all = 0.0;
    let mut rows_of = [0.0_f64; 3];
    for (prepared, simulated) in kernel.records.iter().zip(&fit.simulated) {
        let words = words(kind, prepared, simulated);
        for (k, values) in simulated.iter().enumerate() {
            let output = prepared.outputs[k];
            let sd = kernel.floors[output].sd;
            for (row, (measured, value)) in prepared.measured(k).iter().zip(values).enumerate() {
                if !prepared.used[k][row] {
                    continue;
                }
                let error = (measured - value) / sd;
                all += error * error;
                rows_of[output] += 1.0;
                for word in &words[row] {
                    match sums.iter_mut().find(|it| it.0 == output && it.1 == *word) {
                        Some(sum) => (sum.2, sum.3) = (sum.2 + error * error, sum.3 + 1.0),
                        None => sums.push((output, (*word).to_string(), error * error, 1.0)),
                    }
                }
            }
        }
    }
    let whole = |output: usize, sums: &[(usize, String, f64, f64)]| {
        sums.iter().filter(|it| it.0 == output && it.1 == "everywhere").map(|it| it.2).sum::<f64>()
    };
    let mut list: Vec<Region> = Vec::new();
    for (output, word, error, rows) in &sums {
        let share_of_rows = rows / rows_of[*output].max(1.0);
        let of_output = error / whole(*output, &sums).max(f64::MIN_POSITIVE);
        if word == "everywhere" || of_output > STANDS_OUT * share_of_rows {
            list.push(Region {
                output: *output,
                region: word.clone(),
                share_of_error: error / f64::max(all, f64::MIN_POSITIVE),
                share_of_rows,
            });
        }
    }
    list.sort_by(|a, b| b.share_of_error.total_cmp(&a.share_of_error));
    list.truncate(LINES);
    list
}

/// The regions of each row.
fn words(kind: PlantKind, prepared: &super::kernel::Prepared, simulated: &[Vec<f64>]) -> Vec<Vec<&'static str>> {
    let rows = prepared.record.rows();
    let of = |output: usize| prepared.outputs.iter().position(|it| *it == output).map(|k| simulated[k].as_slice());
    let mut words: Vec<Vec<&'static str>> = vec![vec!["everywhere"]; rows];
    for (row, list) in words.iter_mut().enumerate() {
        list.push(match 3 * row / rows.max(1) {
            0 => "the first third of the record",
            1 => "the second third of the record",
            _ => "the last third of the record",
        });
    }
    match kind {
        PlantKind::Pmac => {
            if let Some(speed) = of(2) {
                by_size(&mut words, speed, ["near standstill", "at medium speed", "at high speed"]);
            }
            if let Some(i_q) = of(1) {
                let i_d = of(0);
                let current: Vec<f64> = i_q.iter().enumerate().map(|(k, q)| q.hypot(i_d.map_or(0.0, |d| d[k]))).collect();
                by_size(&mut words, &current, ["at low current", "at medium current", "at high current"]);
            }
        }
        PlantKind::Driveline => {
            by_size(&mut words, &prepared.record.inputs[0], ["with closed throttle", "at part load", "at full load"]);
            if let Some(speed) = of(1) {
                by_size(&mut words, speed, ["near standstill", "at medium speed", "at high speed"]);
            }
        }
        PlantKind::ServoAxis => {
            if let Some(position) = of(0) {
                let mut speed: Vec<f64> = position.windows(2).map(|w| (w[1] - w[0]) / prepared.record.period).collect();
                speed.push(speed.last().copied().unwrap_or(0.0));
                for (list, value) in words.iter_mut().zip(&speed) {
                    list.push(if *value >= 0.0 { "moving forward" } else { "moving backward" });
                }
                by_size(&mut words, &speed, ["near reversals", "at medium speed", "at high speed"]);
            }
        }
    }
    words
}

/// Small, medium or large against the largest of a record.
fn by_size(words: &mut [Vec<&'static str>], values: &[f64], names: [&'static str; 3]) {
    let most = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    for (list, value) in words.iter_mut().zip(values) {
        let share = value.abs() / most.max(f64::MIN_POSITIVE);
        list.push(if share < 0.15 {
            names[0]
        } else if share < 0.6 {
            names[1]
        } else {
            names[2]
        });
    }
}
