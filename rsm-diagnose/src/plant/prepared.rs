//! Records, prepared for a diagnosis.
//!
//! In: records. Out: parts of them, the outputs to compare, the rows that count. Other modules decide which rows count.

use rsm_sim::equations::Setting;
use rsm_sim::kind::OUTPUTS;
use std::ops::{Deref, DerefMut, Range};
use std::sync::Arc;

use rsm_sim::record::{Drive, Record};

/// A part of a record.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Its rows; messages use its name.
    pub record: Record,
    /// The number of rows of the file before it.
    pub from: usize,
    /// The number of its first rows that do not count, because they start from an unknown state.
    pub settling: usize,
}

impl Piece {
    /// The whole record as one piece.
    #[must_use]
    pub fn whole(record: Record) -> Self {
        Piece { record, from: 0, settling: 0 }
    }
}

/// A filled gap.
#[derive(Debug, Clone, PartialEq)]
pub struct FilledGap {
    /// The rows that were added.
    pub rows: Range<usize>,
    /// The offset of each input from the line between the rows beside the gap.
    pub offsets: [f64; OUTPUTS],
}

/// A record with the rows that count.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The record.
    pub record: Record,
    /// The outputs that the record holds and the simulation gives, by their place in the plant.
    pub outputs: Vec<usize>,
    /// For each of `outputs`, which rows count.
    pub used: Vec<Vec<bool>>,
    /// The number of rows of the file before its first row.
    pub from: usize,
    /// The filled gaps, in their order.
    pub filled_gaps: Vec<FilledGap>,
    /// For each of `outputs`, which of the first rows counted before they were set aside to let the simulation settle. Empty if none were set aside.
    pub(super) used_before_settling: Vec<Vec<bool>>,
}

/// Several records. Clones share them until one of them is changed, so jobs side by side need little memory.
#[derive(Debug, Clone, Default)]
pub struct PreparedRecords(Arc<Vec<Prepared>>);

impl From<Vec<Prepared>> for PreparedRecords {
    fn from(records: Vec<Prepared>) -> Self {
        PreparedRecords(Arc::new(records))
    }
}

impl From<PreparedRecords> for Vec<Prepared> {
    fn from(records: PreparedRecords) -> Self {
        Arc::unwrap_or_clone(records.0)
    }
}

impl Deref for PreparedRecords {
    type Target = Vec<Prepared>;

    fn deref(&self) -> &Vec<Prepared> {
        &self.0
    }
}

impl DerefMut for PreparedRecords {
    fn deref_mut(&mut self) -> &mut Vec<Prepared> {
        Arc::make_mut(&mut self.0)
    }
}

impl<'a> IntoIterator for &'a PreparedRecords {
    type Item = &'a Prepared;
    type IntoIter = std::slice::Iter<'a, Prepared>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a> IntoIterator for &'a mut PreparedRecords {
    type Item = &'a mut Prepared;
    type IntoIter = std::slice::IterMut<'a, Prepared>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

/// The permitted error of a step of a simulation as a share of the noise. If a thousand steps have the largest permitted error with one sign, the
/// error of a simulation is as large as the noise. A step of the series or of a linear part has an error far below the permitted one.
const SHARE_OF_NOISE: f64 = 1e-3;

/// The largest permitted error of a step. A larger one saves little: nearly every row is then one step.
const LARGEST_TOLERANCE: f64 = 1e-7;

/// The smallest noise of a sensor beside its largest reading: a resolution of 23 bits. Records with less come from a simulation. Its error is of that
/// size, so a candidate must have the usual permitted error to follow them.
const LEAST_NOISE: f64 = 1e-7;

impl Prepared {
    /// A record of which all rows count.
    #[must_use]
    pub fn new(record: Record, outputs_of_plant: usize) -> Self {
        let shown = |output: usize| match record.drive {
            // The command of an axis in open loop is an input, not an output.
            Drive::Open if outputs_of_plant == 2 => output == 0,
            _ => true,
        };
        let outputs: Vec<usize> = (0..outputs_of_plant).filter(|k| shown(*k) && record.measured[*k].is_some()).collect();
        let used = vec![vec![true; record.rows()]; outputs.len()];
        Prepared { record, outputs, used, from: 0, filled_gaps: Vec::new(), used_before_settling: Vec::new() }
    }

    /// The measured values of the k-th of its outputs.
    #[must_use]
    pub fn measured(&self, k: usize) -> &[f64] {
        self.record.measured[self.outputs[k]].as_deref().unwrap_or(&[])
    }

    /// The largest magnitude of the measured values of the k-th of its outputs.
    #[must_use]
    pub fn largest_reading(&self, k: usize) -> f64 {
        self.measured(k).iter().map(|it| it.abs()).filter(|it| it.is_finite()).fold(0.0, f64::max)
    }

    /// The permitted error of a step of a simulation, relative to the largest magnitude of a state: a thousandth of the noise of that output
    /// whose noise is smallest beside its largest reading. `noise` is the standard deviation of each of its outputs. If one is smaller than
    /// 1e-7 of that reading, the value is the usual one of [`Setting`].
    #[must_use]
    pub fn tolerance(&self, noise: &[f64]) -> f64 {
        let share = |(k, noise): (usize, &f64)| if *noise > 0.0 { noise / self.largest_reading(k).max(*noise) } else { 0.0 };
        let smallest = noise.iter().enumerate().map(share).fold(1.0, f64::min);
        if smallest < LEAST_NOISE { Setting::default().tolerance } else { (SHARE_OF_NOISE * smallest).min(LARGEST_TOLERANCE) }
    }

    /// The row of the file for a row of the record; for an added row, the row before it.
    #[must_use]
    pub fn file_row(&self, row: usize) -> usize {
        let filled: usize = self.filled_gaps.iter().map(|it| (row + 1).clamp(it.rows.start, it.rows.end) - it.rows.start).sum();
        self.from + row - filled
    }

    /// The row of the record for a row of the file, if the record has it.
    #[must_use]
    pub fn row_of(&self, file_row: usize) -> Option<usize> {
        let mut row = file_row.checked_sub(self.from)?;
        for gap in &self.filled_gaps {
            row += if row >= gap.rows.start { gap.rows.len() } else { 0 };
        }
        (row < self.record.rows()).then_some(row)
    }

    /// A copy with only the first rows.
    #[must_use]
    pub fn shortened(&self, rows: usize) -> Self {
        let mut short = self.clone();
        short.keep(0..rows.min(self.record.rows()));
        short
    }

    /// Sets the first rows aside: the simulation settles there, and they do not count.
    pub(super) fn set_settling_rows(&mut self, rows: usize) {
        self.used_before_settling = self.used.iter().map(|used| used[..rows].to_vec()).collect();
        self.used.iter_mut().for_each(|used| used[..rows].fill(false));
    }

    /// The same record with those first rows counting again. Rows left out for other reasons stay out.
    pub(super) fn with_settling_rows(&self) -> Self {
        let mut whole = self.clone();
        for (used, before) in whole.used.iter_mut().zip(&self.used_before_settling) {
            used[..before.len()].copy_from_slice(before);
        }
        whole.used_before_settling.clear();
        whole
    }

    /// No row of its k-th output counts any more.
    pub(super) fn leave_out(&mut self, k: usize) {
        self.used[k].fill(false);
        self.used_before_settling.iter_mut().skip(k).take(1).for_each(|before| before.fill(false));
    }

    /// Keeps only these rows.
    pub fn keep(&mut self, rows: Range<usize>) {
        self.from = self.file_row(rows.start);
        self.record = self.record.piece(rows.clone());
        self.filled_gaps.retain(|it| rows.start < it.rows.start && it.rows.end < rows.end);
        for gap in &mut self.filled_gaps {
            gap.rows = gap.rows.start - rows.start..gap.rows.end - rows.start;
        }
        self.used.iter_mut().for_each(|used| *used = used[rows.clone()].to_vec());
        self.used_before_settling
            .iter_mut()
            .for_each(|before| *before = before.iter().take(rows.end).skip(rows.start).copied().collect());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;
    use rsm_sim::plant_file::PlantFile;

    #[test]
    fn rows_that_lead_count_again_from_the_start_and_rows_that_a_finding_left_out_do_not() {
        let text = include_str!("../../../rsm-sim/plants/servo-axis.toml");
        let file = PlantFile::read(&Source::new("axis.toml", text)).unwrap();
        let rows: String = (0..8).map(|k| format!("{},0,0,0\n", f64::from(k) / 100.0)).collect();
        let csv = format!("time[s],reference[m],position[m],command[V]\n{rows}");
        let record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let mut prepared = Prepared::new(record, 2);
        prepared.used[0][1] = false;
        prepared.set_settling_rows(3);
        let t = true;
        assert_eq!(prepared.used, [[!t, !t, !t, t, t, t, t, t]; 2]);
        assert_eq!(prepared.with_settling_rows().used, [[t, !t, t, t, t, t, t, t], [t; 8]]);
        // Shorter records, and an output that is left out afterwards.
        let mut short = prepared.shortened(2);
        assert_eq!(short.with_settling_rows().used, [[t, !t], [t, t]]);
        short.leave_out(1);
        assert_eq!(short.with_settling_rows().used, [[t, !t], [!t, !t]]);
        let mut late = prepared.clone();
        late.keep(2..5);
        assert_eq!(late.with_settling_rows().used, [[t; 3]; 2]);
        let mut later = prepared;
        later.keep(4..6);
        assert_eq!(later.with_settling_rows().used, [[t; 2]; 2]);
    }
}
