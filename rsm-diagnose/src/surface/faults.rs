//! Checks of new data before any statistics: readings that an intact sensor or recorder cannot produce, and readings that depend on more than the
//! point and the run.
//!
//! In: a model, new data, a response. Out: [`CheckedRows`]: the faults, the rows without faulty readings, the response corrected for the direction of
//! approach. Faults of single readings come first ([`super::readings`]); then those that the residual proves ([`super::proven_faults`]), each
//! without the rows of the faults before. Never repairs a reading of a faulty sensor.

use rsm_core::model::Model;
use rsm_fit::random::Random;

use super::approach::{self, DirectionCorrection};
use super::data::NewData;
use super::fault::{Fault, Found};
use super::proven_faults;
use super::readings;
use super::sample::{RowSet, Sample};

/// With fewer rows than this, no fault is looked for: a fault of a few rows then is a tenth of the data or more, and looks like the process.
const LEAST_ROWS: usize = 20;

/// The rows of a response after the checks.
pub(super) struct CheckedRows {
    /// What was found.
    pub faults: Vec<Fault>,
    /// Whether a row is used, in run order.
    pub used: Vec<bool>,
    /// The response, corrected for the direction of approach.
    pub response: Vec<f64>,
}

impl CheckedRows {
    /// Checks the data of a response.
    pub(super) fn new(model: &Model, index: usize, data: &NewData) -> Self {
        let response = data.responses[index].as_ref().expect("a compared surface has a response");
        let mut checked = CheckedRows { faults: Vec::new(), used: vec![true; response.len()], response: response.clone() };
        if response.len() < LEAST_ROWS {
            return checked;
        }
        let from = (model, index, data);
        checked.check(from, RowSet::Inside, |sample| readings::faults(model, index, data, sample));
        // Each proof needs the rows without the faults before it.
        let rows = response.len();
        checked.check(from, RowSet::Inside, proven_faults::inputs);
        if !checked.check(from, RowSet::Inside, |sample| proven_faults::scales(sample, rows)) {
            checked.check(from, RowSet::Near, |sample| proven_faults::scales_beyond(sample, rows));
        }
        let sample = checked.sample(from, RowSet::Inside);
        if sample.rows() >= LEAST_ROWS
            && let Some(DirectionCorrection { fault, rows, unknown }) = approach::direction(model, &sample, data)
        {
            rows.iter().for_each(|(row, amount)| checked.response[*row] -= amount);
            unknown.iter().for_each(|row| checked.used[*row] = false);
            checked.faults.push(fault);
        }
        checked
    }

    fn sample(&self, (model, index, data): (&Model, usize, &NewData), rows: RowSet<'_>) -> Sample {
        Sample::new(model, index, &data.inputs, (&self.response, &self.used), &data.extras, rows)
    }

    /// Adds what a check of the present rows finds. Returns whether it found a fault.
    fn check(&mut self, from: (&Model, usize, &NewData), rows: RowSet<'_>, of: impl Fn(&Sample) -> Found) -> bool {
        let sample = self.sample(from, rows);
        if sample.rows() < LEAST_ROWS {
            return false;
        }
        let found = of(&sample);
        let is_any = !found.faults.is_empty();
        self.add(found);
        is_any
    }

    fn add(&mut self, found: Found) {
        for fault in found.faults {
            if fault.is_left_out {
                self.used[fault.rows.0..=fault.rows.1].fill(false);
            }
            self.faults.push(fault);
        }
        found.doubtful.iter().for_each(|row| self.used[*row] = false);
        if found.dither > 0.0 {
            let mut random = Random::new(0xd17);
            self.response.iter_mut().for_each(|value| *value += found.dither * (random.share() - 0.5));
        }
    }

    /// The fault of a response with one value in all rows.
    pub(super) fn constant(&self) -> Option<Fault> {
        self.faults.iter().find(|it| it.what == "constant").cloned()
    }

    /// The faults in words, each once.
    pub(super) fn names(&self) -> String {
        let mut names: Vec<String> = self.faults.iter().map(|it| format!("{} {}", it.column, it.what)).collect();
        names.dedup();
        names.join(", ")
    }

    /// The number of rows that are left out.
    pub(super) fn left_out(&self) -> usize {
        self.used.iter().filter(|used| !**used).count()
    }
}

#[cfg(test)]
mod tests {
    use rsm_core::check::Checked;
    use rsm_core::source::Source;

    use super::*;

    const MODEL: &str = r#"
format = 1
model = "bench"
[inputs.x]
unit = "1"
range = [-1.0, 1.0]
outside = "clamp"
[inputs.w]
unit = "1"
range = [-1.0, 1.0]
outside = "clamp"
[surfaces.y]
unit = "V"
inputs = ["x", "w"]
terms = [
  { powers = [0, 0], coefficient = 5.0 },
  { powers = [1, 0], coefficient = 2.0 },
  { powers = [0, 1], coefficient = -1.0 },
  { powers = [1, 1], coefficient = 1.0 },
]
"#;

    /// Rows of the correct surface with noise of 0.05 V; the fault changes the columns x, w, y.
    struct Rows([Vec<f64>; 3]);

    impl Rows {
        fn new() -> Self {
            let mut random = Random::new(11);
            let mut number = || 2.0 * random.share() - 1.0;
            let mut columns = [Vec::new(), Vec::new(), Vec::new()];
            for _ in 0..160 {
                let (x, w) = (number(), number());
                // The sum of twelve uniform numbers of -1..1 has the variance 4.
                let noise = (0..12).map(|_| number()).sum::<f64>() / 2.0;
                for (column, value) in columns.iter_mut().zip([x, w, 5.0 + 2.0 * x - w + x * w + 0.05 * noise]) {
                    column.push(value);
                }
            }
            Rows(columns)
        }

        fn checked(&self) -> CheckedRows {
            let model = Checked::read(&Source::new("bench.toml", MODEL.to_string())).unwrap();
            let [x, w, y] = &self.0;
            let data = NewData::in_memory(model.model(), &[("x", x), ("w", w), ("y", y)]).unwrap();
            CheckedRows::new(model.model(), 0, &data)
        }

        /// What is found: the kind, the column, the rows.
        fn found(&self) -> Vec<(&'static str, String, (usize, usize))> {
            self.checked().faults.into_iter().map(|it| (it.what, it.column, it.rows)).collect()
        }
    }

    fn one(what: &'static str, column: &str, rows: (usize, usize)) -> Vec<(&'static str, String, (usize, usize))> {
        vec![(what, column.to_string(), rows)]
    }

    #[test]
    fn correct_readings_have_no_fault_and_all_are_used() {
        let checked = Rows::new().checked();
        assert_eq!(checked.faults, Vec::new());
        assert!(checked.used.iter().all(|used| *used));
    }

    #[test]
    fn a_stuck_response_and_a_stuck_input_are_found_where_they_are_and_their_rows_are_left_out() {
        let mut rows = Rows::new();
        let held = rows.0[2][40];
        rows.0[2][40..55].fill(held);
        assert_eq!(rows.found(), one("stuck", "y", (40, 54)));
        assert_eq!(rows.checked().left_out(), 15);
        let mut rows = Rows::new();
        let held = rows.0[0][40];
        rows.0[0][40..60].fill(held);
        let found = rows.found();
        // The first row reads correctly, and the ends may be within the noise.
        assert!(found.len() == 1 && found[0].0 == "stuck" && found[0].1 == "x", "{found:?}");
        assert!((40..44).contains(&found[0].2.0) && (56..60).contains(&found[0].2.1), "{found:?}");
        assert_eq!(rows.checked().left_out(), 20);
    }

    #[test]
    fn a_response_with_one_value_is_constant() {
        let mut rows = Rows::new();
        rows.0[2].fill(4.0);
        assert_eq!(rows.found(), one("constant", "y", (0, 159)));
        assert_eq!(rows.checked().left_out(), 160);
    }

    #[test]
    fn rows_without_any_scatter_are_no_outliers() {
        // A machine at rest: one point, one reading.
        let model = Checked::read(&Source::new("bench.toml", MODEL.to_string())).unwrap();
        let columns = [("x", vec![0.0; 60]), ("w", vec![0.0; 60]), ("y", vec![5.5; 60])];
        let columns: Vec<(&str, &[f64])> = columns.iter().map(|(name, values)| (*name, values.as_slice())).collect();
        let data = NewData::in_memory(model.model(), &columns).unwrap();
        let found = crate::surface::diagnose(&model, &data, None, &mut |_progress| {}).unwrap();
        assert!(found.responses[0].causes.iter().all(|cause| cause.kind != "outlying-runs"));
    }

    #[test]
    fn a_held_input_whose_response_agrees_is_no_fault() {
        let mut rows = Rows::new();
        for row in 40..60 {
            let moved = 0.3 - rows.0[0][row];
            rows.0[2][row] += moved * (2.0 + rows.0[1][row]);
            rows.0[0][row] = 0.3;
        }
        assert_eq!(rows.found(), Vec::new());
    }

    #[test]
    fn a_clipped_sensor_is_found_in_its_rows() {
        for column in [0, 2] {
            let mut rows = Rows::new();
            let limit = [0.5, 0.0, 6.5][column];
            let beyond: Vec<usize> = (0..160).filter(|row| rows.0[column][*row] > limit).collect();
            rows.0[column].iter_mut().for_each(|value| *value = value.min(limit));
            let found = rows.found();
            let of: Vec<usize> = found.iter().flat_map(|it| it.2.0..=it.2.1).collect();
            assert_eq!(of, beyond);
            assert!(found.iter().all(|it| it.0 == "clipped" && it.1 == ["x", "w", "y"][column]), "{found:?}");
        }
    }

    #[test]
    fn coarse_steps_are_found_and_all_rows_are_used_unless_points_repeat() {
        let mut rows = Rows::new();
        rows.0[2].iter_mut().for_each(|y| *y = (*y / 0.25).round() * 0.25);
        let checked = rows.checked();
        assert_eq!((checked.faults.len(), checked.faults[0].what, checked.left_out()), (1, "quantised", 0));
        assert!((checked.faults[0].numbers[0].1 - 0.25).abs() < 1e-12);
        // A step of a tenth of the noise is the resolution of any instrument.
        let mut rows = Rows::new();
        rows.0[2].iter_mut().for_each(|y| *y = (*y / 0.005).round() * 0.005);
        assert_eq!(rows.found(), Vec::new());
    }

    #[test]
    fn rows_written_twice_are_found_and_repeated_points_are_not() {
        let mut rows = Rows::new();
        for column in &mut rows.0 {
            let again = column[30..42].to_vec();
            column.splice(42..42, again);
        }
        assert_eq!(rows.found(), one("duplicated block", "row", (42, 53)));
        let mut rows = Rows::new();
        for row in (0..160).step_by(4) {
            // The same point, other noise.
            for column in 0..2 {
                rows.0[column][row + 1] = rows.0[column][row];
            }
            rows.0[2][row + 1] = rows.0[2][row] + if row % 8 == 0 { 0.04 } else { -0.04 };
        }
        assert_eq!(rows.found(), Vec::new());
    }

    #[test]
    fn another_scale_is_found_from_its_run_on_and_a_shift_is_none() {
        let mut rows = Rows::new();
        rows.0[2][90..].iter_mut().for_each(|y| *y *= 1.15);
        let faults = rows.checked().faults;
        assert_eq!((faults[0].what, faults[0].rows), ("scaled from a run on", (90, 159)));
        // The standard error of the factor: 0.05/(5 root 70) = 0.0012.
        assert!((faults[0].numbers[0].1 - 1.15).abs() < 0.005, "{faults:?}");
        let mut rows = Rows::new();
        rows.0[0][50..90].iter_mut().for_each(|x| *x *= 0.8);
        let found = rows.found();
        assert_eq!((found[0].0, found[0].1.as_str(), found.len()), ("scaled in a range of runs", "x", 1), "{found:?}");
        let mut rows = Rows::new();
        rows.0[2][90..].iter_mut().for_each(|y| *y += 0.6);
        assert_eq!(rows.found(), Vec::new());
    }

    #[test]
    fn the_direction_of_approach_is_found_and_corrected() {
        let mut rows = Rows::new();
        for row in 1..160 {
            rows.0[2][row] += 0.2 * (rows.0[1][row] - rows.0[1][row - 1]).signum();
        }
        let checked = rows.checked();
        let fault = &checked.faults[0];
        assert_eq!((fault.what, fault.input.as_deref()), ("depends on the direction of approach", Some("w")));
        // Beside the terms, the direction has two thirds of its square: the standard error is 0.05/root(160 2/3) = 0.005.
        assert!((fault.numbers[0].1 - 0.2).abs() < 0.02, "{fault:?}");
        // Only the first row has no direction.
        assert_eq!(checked.left_out(), 1);
        let original = Rows::new();
        let error = |row: usize| (checked.response[row] - original.0[2][row]).abs();
        assert!((1..160).all(|row| error(row) < 0.02));
    }
}
