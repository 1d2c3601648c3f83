//! The share of long records that a search uses.
//!
//! In: records, and the integration steps that a simulation takes along them. Out: the beginning of each record and pieces spread over the rest, the
//! same share of each record. The first readings of a piece show its state only in part, so rows do not count until the plant has forgotten that
//! state. For a plant that does not forget, only the beginnings are used. Reports how many rows are left out; `all_rows` checks the result on them
//! afterwards. Never drops a record.

use rsm_sim::equations::Setting;
use rsm_sim::kind::OUTPUTS;
use std::fmt;
use std::ops::Range;

use super::checks;
use super::model::Model;
pub use super::prepared::Piece;
use super::prepared::Prepared;
use super::whitened_residuals::WhitenedResiduals;
use rsm_sim::equation_plant::bodies;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// The largest number of rows of all training records. Derivatives and traces of three outputs for two hundred guesses then need 300 MB.
const MOST_ROWS: usize = 60_000;

/// The number of rows of all training records that a search uses if there are more than [`MOST_ROWS`]: as many as three records of 8000 rows, which
/// take half a minute. All rows are used to check the result.
const SEARCHED: usize = 24_000;

/// The number of rows of all training records that the first search uses. The judged cases of `tests/hidden-effects` have 3000, and as many right
/// answers as cases with 24,000. What a part does not distinguish is compared on more rows (`more_rows`).
const FIRST_SEARCHED: usize = 4000;

/// With fewer rows, the first search uses all: if an answer from a part does not hold on all rows, the search on the part was in vain. It takes at
/// most a third of the time of the second one.
const LEAST_FOR_TWO_SEARCHES: usize = 16_000;

/// The limit of the work of one run along these rows. Before and after a search there are a thousand runs: a minute of one core,
/// at 150 ns for a step of the series.
const MOST_WORK_A_RUN: u64 = 400_000 * Setting::SERIES;

/// The smallest number of rows kept of a record. Fewer are not enough to estimate noise.
const LEAST_ROWS: usize = 400;

/// The number of pieces beside the beginning, which has as many rows as all pieces together. A slow effect (heat) shows in one long piece, an
/// intermittent one in many. Fewer pieces are used if the plant forgets slowly.
const PIECES: [usize; 3] = [4, 2, 1];

/// The rows that do not count may be one part in this many of a piece.
const SETTLING: usize = 2;

/// How many rows a search uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Searched {
    /// A part of long records, for a quick answer. It must hold on all rows.
    Part,
    /// As many as the work limit allows.
    Most,
}

/// The share of each record that is used.
#[derive(Debug, Clone, Copy)]
pub struct RowShare {
    training: f64,
    validation: f64,
    searched: Searched,
    /// The used rows, and all rows.
    rows: (usize, usize),
}

/// The rows that the search did not use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnusedRows {
    /// The number of used rows.
    pub used: usize,
    /// The number of rows of all records.
    pub total: usize,
}

impl fmt::Display for UnusedRows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "The search for causes used {} of {} rows: the beginning of each record and, if the plant forgets its initial state fast enough, parts of the rest",
            self.used, self.total
        )
    }
}

fn rows(records: &[Record]) -> usize {
    records.iter().map(Record::rows).sum()
}

/// Whether a search on a part of the rows takes much less time than one on most of them.
#[must_use]
pub fn has_enough_for_a_part(training: &[Record], validation: &[Record]) -> bool {
    rows(training).max(rows(validation)) > LEAST_FOR_TWO_SEARCHES
}

fn kept(rows: usize, share: f64) -> usize {
    if share >= 1.0 { rows } else { ((rows as f64 * share) as usize).max(LEAST_ROWS).min(rows) }
}

impl RowShare {
    /// The share from the number of rows.
    #[must_use]
    pub fn of_rows(training: &[Record], validation: &[Record], searched: Searched) -> Self {
        let (most, used) = match searched {
            Searched::Part => (LEAST_FOR_TWO_SEARCHES, FIRST_SEARCHED),
            Searched::Most => (MOST_ROWS, SEARCHED),
        };
        let of = |records: &[Record]| {
            let all = rows(records);
            if all <= most { 1.0 } else { used as f64 / all as f64 }
        };
        let all = rows(training) + rows(validation);
        RowShare { training: of(training), validation: of(validation), searched, rows: (all, all) }
    }

    /// The used pieces of a training or validation record. The smaller of the two shares applies, so that all records are cut alike.
    #[must_use]
    pub fn pieces(&self, record: &Record, file: &PlantFile) -> Vec<Piece> {
        let count = kept(record.rows(), self.training.min(self.validation));
        if count >= record.rows() {
            return vec![Piece::whole(record.clone())];
        }
        let part = |rows, settling| piece(record, file.kind, rows, settling);
        let half = count / 2;
        let beginning = part(0..count - half, 0);
        let Some(settling) = settling(&beginning.record, file) else { return vec![part(0..count, 0)] };
        let fits = |each: usize| settling + LEAST_ROWS <= each && SETTLING * settling <= each;
        let Some(pieces) = PIECES.into_iter().find(|pieces| fits(half / pieces)) else { return vec![part(0..count, 0)] };
        let each = half / pieces;
        let rest = beginning.record.rows()..record.rows() - each;
        // Evenly spaced from the end of the beginning to the end of the record.
        let starts = (1..=pieces).map(|k| rest.start + (rest.len() * k) / pieces);
        let later: Vec<Piece> = starts.map(|start| part(start..start + each, settling)).collect();
        // A position that is not read is known at the start of a record only. An effect over the position has another phase in each piece.
        if self.searched == Searched::Part && later.iter().any(|it| !it.record.starts.is_empty()) {
            return vec![part(0..count, 0)];
        }
        std::iter::once(beginning).chain(later).collect()
    }

    /// Cuts records further if the plant is so fast that one run along them takes too much work.
    pub fn cut(&mut self, whitened: &mut WhitenedResiduals, unseen: &mut WhitenedResiduals, file: &PlantFile) {
        self.cut_to(MOST_WORK_A_RUN, whitened, unseen, file);
    }

    fn cut_to(&mut self, most: u64, whitened: &mut WhitenedResiduals, unseen: &mut WhitenedResiduals, file: &PlantFile) {
        let records: Vec<&Record> = whitened.records.iter().map(|it| &it.record).collect();
        let model = Model::nominal(file, &records, [1.0; OUTPUTS]);
        let before = whitened.work.done();
        // A failure of this run is reported where its result is needed.
        let _ = whitened.run(&model);
        let taken = whitened.work.done() - before;
        let share = most as f64 / taken.max(1) as f64;
        for prepared in whitened.records.iter_mut().chain(&mut unseen.records) {
            let settled = prepared.used.iter().filter_map(|used| used.iter().position(|used| *used)).min().unwrap_or(0);
            let rows = prepared.record.rows();
            let count = settled + kept(rows - settled, share);
            if count < rows {
                prepared.keep(0..count);
            }
        }
        let seen =
            |records: &[Prepared]| records.iter().map(|it| it.file_row(it.record.rows() - 1) + 1 - it.from).sum::<usize>();
        if self.training.min(self.validation) < 1.0 || share < 1.0 {
            self.rows.0 = seen(&whitened.records) + seen(&unseen.records);
        }
    }

    /// The rows that are not used; `None` if all are.
    #[must_use]
    pub fn unused_rows(&self) -> Option<UnusedRows> {
        (self.rows.0 < self.rows.1).then_some(UnusedRows { used: self.rows.0, total: self.rows.1 })
    }
}

/// The number of rows for which the initial state matters, for the nominal plant; `None` if it cannot be simulated.
#[must_use]
pub fn settling(beginning: &Record, file: &PlantFile) -> Option<usize> {
    let prepared = Prepared::new(beginning.clone(), file.kind.outputs().len());
    checks::settling_rows(&prepared, file, 0..beginning.rows())
}

/// The name of some rows of a record in messages.
#[must_use]
pub fn name_of(record: &Record, rows: Range<usize>) -> String {
    format!("{}{PART}{} to {}", record.file, rows.start + 1, rows.end)
}

/// What separates the file from the rows in such a name.
const PART: &str = ", rows ";

/// The file of a record, from its name or that of a part of it.
#[must_use]
pub fn file_of(name: &str) -> &str {
    name.split(PART).next().unwrap_or(name)
}

/// Some rows of a record, which its name states. A position that is not read, such as the angle of a rotor, starts at its value in the record plus
/// the integral of the measured speed.
#[must_use]
pub fn piece(record: &Record, kind: PlantKind, rows: Range<usize>, settling: usize) -> Piece {
    let mut part = record.piece(rows.clone());
    if rows.len() < record.rows() {
        part.file = name_of(record, rows.clone());
    }
    for body in bodies(kind).iter().filter(|_| rows.start > 0) {
        let start = kind.start_columns().iter().find(|it| Some(it.name) == body.position);
        let speed = body.speed.and_then(|it| record.measured.get(kind.output(it)?)?.as_ref());
        if let Some((start, speed)) = start.zip(speed) {
            let moved: f64 = speed[..rows.start].windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum();
            part.starts.push((start.name, record.start(start.name).unwrap_or(0.0) + record.period * moved));
        }
    }
    Piece { record: part, from: rows.start, settling }
}

#[cfg(test)]
mod tests {
    use super::super::axis_under_steps;
    use super::super::noise::NoiseFloor;
    use super::*;
    use rsm_core::source::Source;

    fn record(file: &PlantFile, rows: usize) -> Record {
        let mut csv = "time[s],command[V],position[m]\n".to_string();
        for k in 0..rows {
            csv += &format!("{},{},0\n", k as f64 / 1000.0, if k % 200 < 100 { 2.0 } else { -1.5 });
        }
        Record::read(&Source::new("r.csv", csv), file).unwrap()
    }

    fn seen(file: &PlantFile, rows: usize, most: u64) -> (usize, Option<UnusedRows>) {
        let training = [record(file, rows)];
        let mut share = RowShare::of_rows(&training, &[], Searched::Most);
        let pieces = share.pieces(&training[0], file).into_iter();
        let prepared = pieces.map(|it| Prepared { from: it.from, ..Prepared::new(it.record, 2) }).collect();
        let mut whitened = WhitenedResiduals::new(prepared, [NoiseFloor::white(1.0); OUTPUTS], 1);
        let mut unseen = whitened.with_records(Vec::new());
        share.cut_to(most, &mut whitened, &mut unseen, file);
        (whitened.records.iter().map(|it| it.record.rows()).sum(), share.unused_rows())
    }

    #[test]
    fn long_records_are_cut_and_those_of_a_fast_plant_further() {
        let slow = axis_under_steps::file("mass = 0.1", "");
        assert_eq!(seen(&slow, 20_000, MOST_WORK_A_RUN), (20_000, None));
        assert_eq!(seen(&slow, 60_000, MOST_WORK_A_RUN), (60_000, None));
        assert_eq!(seen(&slow, 90_000, MOST_WORK_A_RUN), (24_000, Some(UnusedRows { used: 24_000, total: 90_000 })));
        // A step of the series a row, with a work of 4, and a friction that takes several where the axis turns: a limit between them cuts the one and
        // not the other.
        let fast = axis_under_steps::file("mass = 0.1", &axis_under_steps::friction(5.0));
        assert_eq!(seen(&slow, 20_000, 80_000), (20_000, None));
        let (rows, not_seen) = seen(&fast, 20_000, 80_000);
        assert!((LEAST_ROWS..20_000).contains(&rows) && not_seen.is_some_and(|it| it.used == rows), "{rows}");
    }

    #[test]
    fn a_plant_that_forgets_is_looked_at_all_along_its_records() {
        // 2 kg against 60 N s/m forget in a thirtieth of a second, to a thousandth in 0.23 s.
        let mut file = axis_under_steps::file("mass = 0.1", "");
        file.parameters.set("viscous_friction", 60.0);
        let training = [record(&file, 200_000)];
        let share = RowShare::of_rows(&training, &[], Searched::Most);
        let pieces = share.pieces(&training[0], &file);
        let of: Vec<(usize, usize)> = pieces.iter().map(|it| (it.from, it.from + it.record.rows())).collect();
        assert_eq!(of, [(0, 12_000), (58_250, 61_250), (104_500, 107_500), (150_750, 153_750), (197_000, 200_000)]);
        assert!(pieces[1..].iter().all(|it| (200..300).contains(&it.settling)), "{}", pieces[1].settling);
        assert!(pieces[1].record.file.ends_with("rows 58251 to 61250") && pieces[1].record.time[0] == 58.25);
        let (prepared, _) = checks::prepared(pieces.clone(), &file);
        assert_eq!(prepared[1].file_row(0), 58_250);
    }

    #[test]
    fn a_part_is_a_sixth_of_three_records_of_8000_rows_and_nothing_of_short_ones() {
        let mut file = axis_under_steps::file("mass = 0.1", "");
        file.parameters.set("viscous_friction", 60.0);
        let long: Vec<Record> = (0..3).map(|_| record(&file, 8000)).collect();
        let short = [record(&file, 16_000)];
        assert!(
            has_enough_for_a_part(&long, &[]) && has_enough_for_a_part(&short, &long) && !has_enough_for_a_part(&short, &short)
        );
        let used = |pieces: Vec<Piece>| pieces.iter().map(|it| (it.from, it.record.rows() - it.settling)).collect::<Vec<_>>();
        let part = RowShare::of_rows(&long, &[], Searched::Part);
        let pieces = used(part.pieces(&long[0], &file));
        // Half of 1333 rows are the beginning, the rest is one piece: two would be shorter than the rows that settle (0.23 s) and 400 more.
        assert_eq!(pieces, [(0, 667), (7334, 437)]);
        assert_eq!(used(RowShare::of_rows(&short, &[], Searched::Part).pieces(&short[0], &file)), [(0, 16_000)]);
        assert_eq!(used(RowShare::of_rows(&long, &[], Searched::Most).pieces(&long[0], &file)), [(0, 8000)]);
    }

    /// A motor's record with a voltage and a speed for each row.
    fn motor(rows: u32, voltage: impl Fn(u32) -> f64, speed: impl Fn(u32) -> f64) -> (PlantFile, Record) {
        let text = include_str!("../../../rsm-sim/plants/pmac.toml");
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let mut csv = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
        for k in 0..rows {
            csv += &format!("{},0,{},0,0,0,{}\n", f64::from(k) / 1000.0, voltage(k), speed(k));
        }
        let record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        (file, record)
    }

    #[test]
    fn a_part_of_a_motors_record_is_its_beginning() {
        let (file, record) = motor(20_000, |k| if k % 400 < 200 { 5.0 } else { 2.0 }, |_| 0.0);
        let long = [record];
        let rows = |searched| {
            let pieces = RowShare::of_rows(&long, &[], searched).pieces(&long[0], &file);
            pieces.iter().map(|it| it.record.rows()).collect::<Vec<_>>()
        };
        assert_eq!(rows(Searched::Part), [4000]);
        assert_eq!(rows(Searched::Most), [20_000]);
    }

    #[test]
    fn a_piece_of_a_motors_record_begins_at_the_angle_that_its_speed_has_made() {
        let (file, record) = motor(300, |_| 5.0, f64::from);
        // The integral of 1000 t from 0 to 0.2 s, less the last half row: 199^2/2 ms.
        let angle = piece(&record, file.kind, 200..300, 0).record.start("angle").unwrap();
        assert!((angle - 19.8005).abs() < 1e-9, "{angle}");
    }
}
