//! Checks the result of a search on all rows of records that are too long for the search.
//!
//! In: whole records and the plant at the end of a search. Out: the error in each window of rows. Each window has its own initial state, so only one
//! window is in memory. A window is evaluated like a holdout record: against its own noise, with the parameters of the plant free within their
//! uncertainty. Does not change or name causes.

use rsm_core::order;
use rsm_sim::equations::Setting;
use rsm_sim::kind::OUTPUTS;
use std::fmt;

use super::checks::{self, Finding};
use super::levenberg::Fit;
use super::model::Model;
use super::octave_spectrum::{OCTAVES, Octave};
use super::posterior::Posterior;
use super::prepared::Piece;
use super::row_share;
use super::whitened_residuals::WhitenedResiduals;
use super::{alignment, outlier_correction, own_noise, regions, validation, whiteness};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// The number of rows of a window that count: as many as a search takes of a record without cutting it.
const WINDOW_ROWS: usize = 8000;

/// The limit of the work for all windows together: 15 s of one core, at 150 ns for a step of the series. Windows beyond the limit are
/// not tested, and the report says so.
const MOST_WORK: u64 = 100_000_000 * Setting::SERIES;

/// A window with more error than noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// The record and its rows, as named in messages.
    pub record: String,
    /// The energy above the noise divided by the noise energy.
    pub excess: f64,
}

/// The result of the check on all rows.
#[derive(Debug, Clone, PartialEq)]
pub struct AllRows {
    /// The number of tested rows.
    pub rows: usize,
    /// The number of rows of all records.
    pub total_rows: usize,
    /// The number of tested windows.
    pub windows: usize,
    /// Windows with more error than noise, the worst first.
    pub beyond_noise: Vec<Window>,
    /// Windows that could not be simulated.
    pub not_simulated: Vec<String>,
    /// The energy above the noise divided by the noise energy: of the worst window or of all windows together, whichever is larger.
    pub excess: f64,
    /// What is wrong with the data in rows that the search did not use.
    pub findings: Vec<Finding>,
}

impl AllRows {
    /// Whether all rows were tested and hold only noise. A fault of the data is no objection, unless it takes whole rows or a channel: then the rest
    /// of a window was not tested.
    #[must_use]
    pub fn is_only_noise(&self) -> bool {
        let takes_more = |it: &Finding| ["row", "time"].contains(&it.channel.as_str()) || it.what == checks::CONSTANT;
        self.rows == self.total_rows
            && self.not_simulated.is_empty()
            && !self.findings.iter().any(takes_more)
            && self.excess <= 0.0
    }
}

/// The number of windows that a sentence names.
const NAMED_WINDOWS: usize = 3;

impl fmt::Display for AllRows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "The explanation was then tested on {} of all {} rows, in {} windows: ",
            self.rows, self.total_rows, self.windows
        )?;
        let names: Vec<String> = self.beyond_noise.iter().take(NAMED_WINDOWS).map(|it| regions::name_of(&it.record)).collect();
        match (self.beyond_noise.len(), self.excess > 0.0) {
            (0, false) => write!(f, "the residuals of each window are noise")?,
            (0, true) => write!(
                f,
                "the residuals of each window are noise, but all windows together have {:.1} % more energy than noise",
                100.0 * self.excess
            )?,
            (count, _) => write!(
                f,
                "{count} with more error than noise, at worst {:.1} % of the noise energy ({})",
                100.0 * self.excess,
                names.join("; ")
            )?,
        }
        if self.rows < self.total_rows {
            write!(f, "; the other {} rows were not tested", self.total_rows - self.rows)?;
        }
        Ok(())
    }
}

/// The windows of a record, created one at a time, in an order that spreads the first ones over the record.
fn windows<'a>(record: &'a Record, file: &PlantFile) -> Box<dyn ExactSizeIterator<Item = Piece> + 'a> {
    let rows = record.rows();
    let beginning = record.piece(0..WINDOW_ROWS.min(rows));
    let Some(settling) = row_share::settling(&beginning, file).filter(|settling| 2 * settling <= WINDOW_ROWS) else {
        // A plant that does not forget its initial state needs the whole record in one window.
        return Box::new(std::iter::once_with(|| Piece::whole(record.clone())));
    };
    let count = rows.div_ceil(WINDOW_ROWS);
    let mut order: Vec<usize> = (0..count).collect();
    // The order of reversed bits: halves, quarters, eighths.
    order.sort_by_key(|k| k.reverse_bits());
    let kind = file.kind;
    let one = move |k: usize| {
        let start = k * rows / count;
        let from = start.saturating_sub(settling);
        let end = (k + 1) * rows / count;
        let mut piece = row_share::piece(record, kind, from..end, start - from);
        // Messages name the rows that count.
        piece.record.file = row_share::name_of(record, start..end);
        piece
    };
    Box::new(order.into_iter().map(one))
}

/// Whether two findings are about the same fault: the windows and the search cut the records at other rows.
fn is_same(a: &Finding, b: &Finding) -> bool {
    row_share::file_of(&a.record) == row_share::file_of(&b.record)
        && (&a.channel, a.what) == (&b.channel, b.what)
        && a.rows.0 <= b.rows.1
        && b.rows.0 <= a.rows.1
}

/// The plant on a window after one step from its first readings. A jump that the simulation has too is motion: its finding is removed, and its row
/// counts again.
fn quick_start(there: &mut WhitenedResiduals, model: &Model, findings: &mut Vec<Finding>) -> Option<Fit> {
    let started = validation::one_step(there, model)?;
    let before = findings.len();
    if before == 0 {
        return Some(started);
    }
    alignment::remove_motion_findings(&mut there.records, &started.simulated, model.file.kind, findings);
    if findings.len() < before { validation::one_step(there, model) } else { Some(started) }
}

/// Tests all rows. `whitened` has the noise and the work limit of the search, `known` what the search found in the data.
#[must_use]
pub fn check(records: &[&Record], file: &PlantFile, whitened: &WhitenedResiduals, fit: &Fit, known: &[Finding]) -> AllRows {
    let mut by_record: Vec<_> = records.iter().map(|it| windows(it, file)).collect();
    let tests: usize = by_record.iter().map(|it| it.len()).sum();
    let sds = Posterior::of(fit).deviations().to_vec();
    let mut found = AllRows {
        rows: 0,
        total_rows: records.iter().map(|it| it.rows()).sum(),
        windows: 0,
        beyond_noise: Vec::new(),
        not_simulated: Vec::new(),
        excess: 0.0,
        findings: Vec::new(),
    };
    let mut sums = [[Octave::default(); OCTAVES]; OUTPUTS];
    let begun = whitened.work.done();
    // One window of each record in turn.
    while by_record.iter().any(|it| it.len() > 0) && whitened.work.done() - begun < MOST_WORK {
        for piece in by_record.iter_mut().filter_map(Iterator::next) {
            let counted = piece.record.rows() - piece.settling;
            let name = piece.record.file.clone();
            let (prepared, mut findings) = checks::prepared([piece], file);
            let has_outputs = prepared.iter().any(|it| !it.outputs.is_empty());
            let mut there = outlier_correction::corrected(whitened.with_records(prepared), &fit.model);
            // First a quick start from the first readings. If that leaves an error, the start is fitted as for a holdout record.
            let quick = if has_outputs { quick_start(&mut there, &fit.model, &mut findings) } else { None };
            found.findings.extend(findings.into_iter().filter(|it| !known.iter().any(|known| is_same(known, it))));
            if !has_outputs {
                continue;
            }
            let quick = quick.map(|started| own_noise::remaining_structure(&there, started, tests));
            let left = quick.filter(|it| it.excess <= 0.0).or_else(|| {
                let started = validation::fit_initial_states(&there, &fit.model)?;
                let left = own_noise::remaining_structure(&there, started.clone(), tests);
                if left.excess <= 0.0 {
                    return Some(left);
                }
                let moved = validation::fit_within_uncertainty(&there, &fit.model, &sds, &started);
                Some(moved.map_or(left, |moved| own_noise::remaining_structure(&there, moved, tests)))
            });
            let Some(left) = left else {
                found.not_simulated.push(name);
                continue;
            };
            (found.rows, found.windows) = (found.rows + counted, found.windows + 1);
            for band in &left.bands {
                let sum = &mut sums[band.output][band.octave];
                sum.power += band.ratio * band.lines as f64;
                sum.lines += band.lines as f64;
            }
            if left.excess > 0.0 {
                found.beyond_noise.push(Window { record: name, excess: left.excess });
            }
        }
    }
    order::descending(&mut found.beyond_noise, |it| it.excess);
    let worst = found.beyond_noise.first().map_or(0.0, |it| it.excess);
    found.excess = worst.max(together(whitened, &sums));
    found
}

/// The energy above the noise in the octaves of all windows together, divided by the noise energy.
fn together(whitened: &WhitenedResiduals, sums: &[[Octave; OCTAVES]; OUTPUTS]) -> f64 {
    let all = sums.iter().enumerate().flat_map(|(output, list)| list.iter().enumerate().map(move |(k, it)| (output, k, it)));
    let bands: Vec<_> = all.filter(|(_, _, octave)| octave.lines > 0.0).collect();
    let point = whiteness::point(bands.len(), 1);
    let lines: f64 = bands.iter().map(|it| it.2.lines).sum();
    let beyond = bands.iter().filter(|(output, k, octave)| octave.deviation(&whitened.floors[*output], *k) > point);
    beyond.map(|(_, _, octave)| (octave.ratio() - 1.0) * octave.lines).sum::<f64>() / lines.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::levenberg;
    use super::super::noise::NoiseFloor;
    use super::super::whitened_residuals::Prepared;
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::by_output;
    use rsm_sim::simulate::Simulator;

    /// What all rows say of a car whose throttle reads so much less than it is from two thirds of its record on; the answer was found on its first
    /// 4000 rows.
    fn asked(less: f64) -> AllRows {
        let text = include_str!("../../../rsm-sim/plants/driveline.toml");
        let file = PlantFile::read(&Source::new("car.toml", text)).unwrap();
        let mut csv = "time[s],throttle[1],gear[1],engine_speed[rad/s],road_speed[m/s],acceleration[m/s^2]\n".to_string();
        for k in 0..48_000 {
            csv += &format!("{},{},3,0,12,0\n", f64::from(k) / 100.0, if k % 400 < 150 { 0.5 } else { 0.05 });
        }
        let mut record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let simulated = Simulator::new(&file, &record).unwrap().run(&record).unwrap();
        let sds = by_output(&[0.5, 0.02, 0.05], 1.0);
        let mut random = Random::new(4);
        for (k, name) in ["engine_speed", "road_speed", "acceleration"].iter().enumerate() {
            record.measured[k] =
                Some(simulated.of(name).unwrap().iter().map(|value| value + sds[k] * random.normal()).collect());
        }
        record.inputs[0][32_000..].iter_mut().for_each(|value| *value -= less);
        let first = record.piece(0..4000);
        let whitened = WhitenedResiduals::new(vec![Prepared::new(first.clone(), 3)], sds.map(NoiseFloor::white), 2);
        let fit = levenberg::fit(&whitened, Model::nominal(&file, &[&first], sds), 4).unwrap();
        check(&[&record], &file, &whitened, &fit, &[])
    }

    #[test]
    fn what_only_the_last_third_shows_is_seen_on_all_rows() {
        let in_order = asked(0.0);
        assert_eq!((in_order.rows, in_order.total_rows, in_order.excess), (48_000, 48_000, 0.0), "{in_order}");
        let off = asked(0.01);
        assert!(off.excess > 0.05 && off.not_simulated.is_empty(), "{off}");
        // Six windows of 8000 rows, or one from a start that is not forgotten; the last two are those.
        let rows = |it: &Window| it.record.split("rows ").nth(1).and_then(|rows| rows.split(' ').next()?.parse::<usize>().ok());
        assert!(
            off.windows == 1 || off.beyond_noise.iter().all(|it| rows(it).is_some_and(|first| first > 30_000)),
            "{:?}",
            off.beyond_noise
        );
    }
}
