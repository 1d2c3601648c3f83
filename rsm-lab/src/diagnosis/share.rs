//! How much of records that are too long is looked at.
//!
//! In: records, the steps that a simulation takes along them. Out: their beginnings, of each record the same share: a simulation starts where a record starts, so a later part
//! would begin at a state that nobody knows. Says how many rows that leaves out. Never drops a record.

use std::fmt;

use super::kernel::{Kernel, Prepared};
use super::model::Model;
use crate::plant_file::PlantFile;
use crate::record::Record;

/// Rows of training records together: derivatives and traces of three outputs for two hundred guesses are then 300 MB.
const MOST_ROWS: usize = 60_000;

/// Sub-steps of one run along them: what comes before and after a search takes a thousand runs, a minute of one core at 150 ns a step.
const MOST_STEPS_A_RUN: u64 = 400_000;

/// Rows of a record that are kept in any case: fewer say nothing about noise.
const LEAST_ROWS: usize = 400;

/// The share of each record that is looked at.
#[derive(Debug, Clone, Copy)]
pub struct Share {
    training: f64,
    validation: f64,
    /// Rows seen, and all.
    rows: (usize, usize),
}

/// Rows that were not looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotSeen {
    /// Rows that were.
    pub seen: usize,
    /// Rows of all records.
    pub of: usize,
}

impl fmt::Display for NotSeen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Of {} rows the first {} were looked at, the same share of each record: all of them would take longer than a diagnosis may; what only later rows show was not asked",
            self.of, self.seen
        )
    }
}

fn rows(records: &[Record]) -> usize {
    records.iter().map(Record::rows).sum()
}

fn kept(rows: usize, share: f64) -> usize {
    if share >= 1.0 { rows } else { ((rows as f64 * share) as usize).max(LEAST_ROWS).min(rows) }
}

impl Share {
    /// By the number of rows.
    #[must_use]
    pub fn of_rows(training: &[Record], validation: &[Record]) -> Self {
        let of = |records: &[Record]| (MOST_ROWS as f64 / rows(records).max(1) as f64).min(1.0);
        let all = rows(training) + rows(validation);
        Share { training: of(training), validation: of(validation), rows: (all, all) }
    }

    /// The beginning of a record for training or validation, by the smaller of the shares: records of one plant are then equally long looks.
    #[must_use]
    pub fn beginning(&self, record: &Record) -> Record {
        let count = kept(record.rows(), self.training.min(self.validation));
        if count < record.rows() { record.piece(0..count) } else { record.clone() }
    }

    /// Cuts records further, where the plant is so fast that one run along them takes too many steps.
    pub fn cut(&mut self, kernel: &mut Kernel, unseen: &mut Kernel, file: &PlantFile) {
        let records: Vec<&Record> = kernel.records.iter().map(|it| &it.record).collect();
        let model = Model::nominal(file, &records, [1.0; 3]);
        let before = kernel.pace.taken();
        // What cannot be simulated is told by whoever needs the run.
        let _ = kernel.run(&model);
        let taken = kernel.pace.taken() - before;
        let share = MOST_STEPS_A_RUN as f64 / taken.max(1) as f64;
        for prepared in kernel.records.iter_mut().chain(&mut unseen.records) {
            let count = kept(prepared.record.rows(), share);
            if count < prepared.record.rows() {
                prepared.keep(0..count);
            }
        }
        let seen =
            |records: &[Prepared]| records.iter().map(|it| it.file_row(it.record.rows() - 1) + 1 - it.from).sum::<usize>();
        if self.training.min(self.validation) < 1.0 || share < 1.0 {
            self.rows.0 = seen(&kernel.records) + seen(&unseen.records);
        }
    }

    /// What is not looked at; `None` where all is.
    #[must_use]
    pub fn not_seen(&self) -> Option<NotSeen> {
        (self.rows.0 < self.rows.1).then_some(NotSeen { seen: self.rows.0, of: self.rows.1 })
    }
}

#[cfg(test)]
mod tests {
    use super::super::axis_under_steps;
    use super::super::noise::Floor;
    use super::*;
    use rsm_core::source::Source;

    fn record(file: &PlantFile, rows: usize) -> Record {
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        for k in 0..rows {
            csv += &format!("{},{},0\n", k as f64 / 1000.0, if k % 200 < 100 { 2.0 } else { -1.5 });
        }
        Record::read(&Source::new("r.csv", csv), file).unwrap()
    }

    fn seen(file: &PlantFile, rows: usize) -> (usize, Option<NotSeen>) {
        let training = [record(file, rows)];
        let mut share = Share::of_rows(&training, &[]);
        let prepared = vec![Prepared::new(share.beginning(&training[0]), 2)];
        let mut kernel = Kernel::new(prepared, [Floor::white(1.0); 3], 1);
        let mut unseen = kernel.on(Vec::new());
        share.cut(&mut kernel, &mut unseen, file);
        (kernel.records[0].record.rows(), share.not_seen())
    }

    #[test]
    fn long_records_are_cut_and_those_of_a_fast_plant_further() {
        let slow = axis_under_steps::file("mass = 0.1", "");
        assert_eq!(seen(&slow, 20_000), (20_000, None));
        assert_eq!(seen(&slow, 90_000), (60_000, Some(NotSeen { seen: 60_000, of: 90_000 })));
        // 50 N over a millimetre a second, on 2 kg: 25 000 1/s where the axis is slow, a hundred steps a row.
        let fast = axis_under_steps::file("mass = 0.1", &axis_under_steps::friction(50.0));
        let (rows, not_seen) = seen(&fast, 20_000);
        assert!((LEAST_ROWS..20_000).contains(&rows) && not_seen.is_some_and(|it| it.seen == rows), "{rows}");
    }
}
