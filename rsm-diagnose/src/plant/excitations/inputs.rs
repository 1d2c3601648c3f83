//! Excitations for a plant of equations: changes of its inputs within their recorded ranges.
//!
//! In: accepted plants and limits. Out: records in which one input moves about the middle of its range while the others stay at theirs, and one in
//! which all move. Independent of the equations.

use super::shapes::{Path, binary};
use super::{Collected, Excitation, Limits, blank};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Outputs;

/// The levels of a staircase: two on either side of the middle, up and down again.
const STAIRS: [f64; 8] = [0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0];

/// The highest frequency of a sweep as a share of the sample rate: ten rows per period.
const HIGHEST_OF_SWEEP: f64 = 0.1;

/// The number of periods of a sweep's lowest frequency in a record.
const LOWEST: f64 = 2.0;

/// The rows for which a binary sequence holds a value, as shares of a record: two values, a decade apart.
const HOLDS: [f64; 2] = [0.002, 0.02];

/// All excitations of a plant of equations.
pub(super) fn library(accepted: &[&PlantFile], limits: &Limits) -> Vec<Excitation> {
    let Some(plant) = accepted.first() else { return Vec::new() };
    let kind = plant.kind;
    let is_allowed = |_: &PlantFile, outputs: &Outputs| (0..kind.outputs().len()).all(|it| limits.holds(kind, outputs, it));
    let mut list = Collected::new(accepted, &is_allowed);
    let names = kind.inputs();
    for (moved, signal) in names.iter().enumerate().take(limits.inputs.len()) {
        let [low, high] = limits.inputs[moved];
        // An input that never moved in the records may be fixed.
        if high.is_nan() || high <= low {
            continue;
        }
        let mut add = |name: &str, words: &'static str, shape: &dyn Fn(usize) -> Vec<f64>| {
            let make =
                |amplitude: f64| Some(record(limits, &|input, rows| (input == moved).then(|| scaled(shape(rows), amplitude))));
            list.add(&format!("{name} of {}", signal.name), words, &make);
        };
        add("steps", "one input goes through levels of its range, up and down, while the others stay", &|rows| {
            steps(rows, limits.period)
        });
        add("slow ramps", "one input goes slowly through its range and back, while the others stay", &|rows| {
            ramps(rows, limits.period)
        });
        add("sweep", "one input swings, slowly at first and faster and faster, while the others stay", &sweep);
        for (share, speed) in HOLDS.into_iter().zip(["fast", "slow"]) {
            let hold = |rows: usize| ((share * rows as f64) as usize).max(1);
            add(
                &format!("{speed} random steps"),
                "one input jumps between two values at random, while the others stay",
                &|rows| binary(rows, hold(rows), 0),
            );
        }
    }
    if limits.inputs.iter().filter(|[low, high]| high > low).count() > 1 {
        let make = |amplitude: f64| {
            // Sequences that start far apart in the register are uncorrelated.
            Some(record(limits, &|input, rows| Some(scaled(binary(rows, (rows / 100).max(1), 97 * (input + 1)), amplitude))))
        };
        list.add("random steps of all inputs", "all inputs jump between two values at random, each by itself", &make);
    }
    list.list
}

/// A record in which inputs have a shape about the middle of their range. Inputs without a shape stay at the middle.
fn record(limits: &Limits, shape: &dyn Fn(usize, usize) -> Option<Vec<f64>>) -> Record {
    let rows = limits.rows;
    let inputs = limits.inputs.iter().enumerate().map(|(input, [low, high])| {
        let (middle, half) = if low.is_finite() { (0.5 * (low + high), 0.5 * (high - low)) } else { (0.0, 0.0) };
        match shape(input, rows) {
            Some(values) => values.iter().map(|value| middle + half * value).collect(),
            None => vec![middle; rows],
        }
    });
    let mut record = blank("bench", limits, rows, inputs.collect());
    record.measured = limits.starts.iter().map(|start| start.map(|value| vec![value])).collect();
    record
}

fn scaled(mut values: Vec<f64>, amplitude: f64) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value *= amplitude);
    values
}

fn steps(rows: usize, period: f64) -> Vec<f64> {
    let each = rows as f64 * period / STAIRS.len() as f64;
    let mut path = Path::from(STAIRS[0]);
    for level in &STAIRS[1..] {
        path.hold(each);
        path.line_to(*level, 0.0);
    }
    path.sampled(rows, period).0
}

fn ramps(rows: usize, period: f64) -> Vec<f64> {
    let quarter = rows as f64 * period / 4.0;
    let mut path = Path::from(0.0);
    path.line_to(1.0, quarter);
    path.line_to(-1.0, 2.0 * quarter);
    path.line_to(0.0, quarter);
    path.sampled(rows, period).0
}

/// A sine with exponentially growing frequency.
fn sweep(rows: usize) -> Vec<f64> {
    let (first, last) = (LOWEST / rows as f64, HIGHEST_OF_SWEEP);
    let growth = (last / first).ln();
    let phase = |row: usize| {
        let share = row as f64 / rows as f64;
        std::f64::consts::TAU * first * rows as f64 * ((share * growth).exp() - 1.0) / growth
    };
    (0..rows).map(|row| phase(row).sin()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_fill_their_range_and_no_more() {
        for values in [steps(1000, 0.01), ramps(1000, 0.01), sweep(1000)] {
            let (low, high) = values.iter().fold((0.0_f64, 0.0_f64), |(low, high), it| (low.min(*it), high.max(*it)));
            // A row of a sweep need not meet the top of a wave.
            assert!((-1.0..-0.98).contains(&low) && high > 0.98 && high <= 1.0, "{low} {high}");
            assert_eq!(values.len(), 1000);
        }
    }

    #[test]
    fn a_sweep_ends_with_ten_rows_a_period() {
        let values = sweep(4000);
        let crossings = |part: &[f64]| part.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
        // 2 crossings a period: 100 rows have 20 at the end, less by the growth within them, and one or two at the start.
        assert!((17..=21).contains(&crossings(&values[3900..])), "{}", crossings(&values[3900..]));
        assert!(crossings(&values[..100]) <= 2);
    }
}
