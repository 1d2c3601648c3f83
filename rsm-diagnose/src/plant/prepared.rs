//! Records, prepared for a diagnosis.
//!
//! In: records. Out: parts of them, the outputs that are compared, the rows that count. Other modules decide which rows count.

use rsm_sim::kind::OUTPUTS;
use std::ops::Range;

use rsm_sim::record::{Drive, Record};

/// A part of a record.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Its rows; messages name them.
    pub record: Record,
    /// Rows of the file before it.
    pub from: usize,
    /// Its first rows, which do not count: they start from an unknown state.
    pub settling: usize,
}

impl Piece {
    /// All of a record.
    #[must_use]
    pub fn whole(record: Record) -> Self {
        Piece { record, from: 0, settling: 0 }
    }
}

/// A gap that was filled.
#[derive(Debug, Clone, PartialEq)]
pub struct Bridge {
    /// The rows that stand for those that are missing.
    pub rows: Range<usize>,
    /// By how much each input is moved from the line between the rows beside the gap.
    pub offsets: [f64; OUTPUTS],
}

/// A record with the rows that count.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The record.
    pub record: Record,
    /// The outputs that it holds and that the simulation shows, by their place in the plant.
    pub outputs: Vec<usize>,
    /// For each of `outputs`, which rows count.
    pub used: Vec<Vec<bool>>,
    /// How many rows of the file stand before its first.
    pub from: usize,
    /// Gaps of a few rows that were filled, in their order.
    pub bridges: Vec<Bridge>,
    /// For each of `outputs`, which of the first rows counted before they were set aside to lead the simulation. Empty where none were.
    pub(super) led: Vec<Vec<bool>>,
}

impl Prepared {
    /// All rows of a record count.
    #[must_use]
    pub fn new(record: Record, outputs_of_plant: usize) -> Self {
        let shown = |output: usize| match record.drive {
            Drive::HoldsDirectCurrent => output > 0,
            // An axis in open loop has its command as an input.
            Drive::Open if outputs_of_plant == 2 => output == 0,
            _ => true,
        };
        let outputs: Vec<usize> = (0..outputs_of_plant).filter(|k| shown(*k) && record.measured[*k].is_some()).collect();
        let used = vec![vec![true; record.rows()]; outputs.len()];
        Prepared { record, outputs, used, from: 0, bridges: Vec::new(), led: Vec::new() }
    }

    /// The measured values of the k-th of its outputs.
    #[must_use]
    pub fn measured(&self, k: usize) -> &[f64] {
        self.record.measured[self.outputs[k]].as_deref().unwrap_or(&[])
    }

    /// The row of the file that a row is; of a row that the file lacks, the one before.
    #[must_use]
    pub fn file_row(&self, row: usize) -> usize {
        let filled: usize = self.bridges.iter().map(|it| (row + 1).clamp(it.rows.start, it.rows.end) - it.rows.start).sum();
        self.from + row - filled
    }

    /// The row that a row of the file is, where it is one of these.
    #[must_use]
    pub fn row_of(&self, file_row: usize) -> Option<usize> {
        let mut row = file_row.checked_sub(self.from)?;
        for bridge in &self.bridges {
            row += if row >= bridge.rows.start { bridge.rows.len() } else { 0 };
        }
        (row < self.record.rows()).then_some(row)
    }

    /// The first rows of it.
    #[must_use]
    pub fn shortened(&self, rows: usize) -> Self {
        let mut short = self.clone();
        short.keep(0..rows.min(self.record.rows()));
        short
    }

    /// Sets the first rows aside: they lead the simulation, and do not count.
    pub(super) fn lead(&mut self, rows: usize) {
        self.led = self.used.iter().map(|used| used[..rows].to_vec()).collect();
        self.used.iter_mut().for_each(|used| used[..rows].fill(false));
    }

    /// The same record, with the rows that were set aside to lead: what was left out for another reason stays out.
    pub(super) fn with_led_rows(&self) -> Self {
        let mut whole = self.clone();
        for (used, led) in whole.used.iter_mut().zip(&self.led) {
            used[..led.len()].copy_from_slice(led);
        }
        whole.led.clear();
        whole
    }

    /// No row of its k-th output counts.
    pub(super) fn leave_out(&mut self, k: usize) {
        self.used[k].fill(false);
        self.led.iter_mut().skip(k).take(1).for_each(|led| led.fill(false));
    }

    /// Keeps some rows.
    pub fn keep(&mut self, rows: Range<usize>) {
        self.from = self.file_row(rows.start);
        self.record = self.record.piece(rows.clone());
        self.bridges.retain(|it| rows.start < it.rows.start && it.rows.end < rows.end);
        for bridge in &mut self.bridges {
            bridge.rows = bridge.rows.start - rows.start..bridge.rows.end - rows.start;
        }
        self.used.iter_mut().for_each(|used| *used = used[rows.clone()].to_vec());
        self.led.iter_mut().for_each(|led| *led = led.iter().take(rows.end).skip(rows.start).copied().collect());
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
        prepared.lead(3);
        let t = true;
        assert_eq!(prepared.used, [[!t, !t, !t, t, t, t, t, t]; 2]);
        assert_eq!(prepared.with_led_rows().used, [[t, !t, t, t, t, t, t, t], [t; 8]]);
        // Shorter records, and an output that is left out afterwards.
        let mut short = prepared.shortened(2);
        assert_eq!(short.with_led_rows().used, [[t, !t], [t, t]]);
        short.leave_out(1);
        assert_eq!(short.with_led_rows().used, [[t, !t], [!t, !t]]);
        let mut late = prepared.clone();
        late.keep(2..5);
        assert_eq!(late.with_led_rows().used, [[t; 3]; 2]);
        let mut later = prepared;
        later.keep(4..6);
        assert_eq!(later.with_led_rows().used, [[t; 2]; 2]);
    }
}
