//! Checks of the data before the first simulation: samples that an intact sensor cannot produce.
//!
//! In: a prepared record. Out: findings. The rows of findings are left out of all later figures. After a gap in time or a repeated block of rows, the
//! state of the plant is unknown, because the inputs are missing. Only one part of the record without such a break is kept. Never corrects a sample.

use super::gaps;
use super::prepared::{Piece, Prepared};
use super::repeated_blocks::{STUCK, find};
use super::standstill::{self, StandstillTest};
use crate::engine::significance::median;
use rsm_core::order;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

/// A channel is noisy if fewer than this share of its readings equal the reading before. A coarsely rounded channel repeats far more often.
const REPEATS: f64 = 0.02;

/// A sample is a jump if its second difference exceeds this many robust standard deviations. Normal noise exceeds 12 standard deviations once in
/// 10^32 samples.
const JUMP: f64 = 12.0;

/// The first part of a record is kept if it has at least this share of the rows, because its initial state is known best.
const FIRST_PART: f64 = 0.25;

/// The effect of a wrong initial state counts as gone when this share of it is left.
const DECAYED: f64 = 1e-3;

/// A channel is stuck if it has one value from some row to the end, and this part is at least one in this many of the record's rows.
const STAYS: usize = 4;

/// The change after equal readings is a jump if it exceeds the largest other change of the channel by this factor. The largest of 400 changes by
/// normal noise is 4.2 standard deviations; of 10^6 it is 6.9 (order statistics), so noise alone gives a factor of 1.6.
const JUMP_AFTER_STUCK: f64 = 3.0;

/// Two clipped readings belong to one clipped interval if they are at most this many rows apart. Noise takes a signal at the limit below it in half
/// of the rows; an interval longer than this has a probability of 2^-20.
const BETWEEN_CLIPPED: usize = 20;

/// The longest run of equal readings is ignored in the test for noise if at least this many other readings are left.
const ENOUGH_BESIDE: usize = 50;

/// The text of a finding for exchanged column headers.
pub const SWAPPED: &str = "swapped with another column";

/// The text of a finding for a channel with one value in all rows.
pub const CONSTANT: &str = "constant";

/// What was found in a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The name of the record in messages.
    pub record: String,
    /// The channel, "row" or "time".
    pub channel: String,
    /// The kind of the finding: "constant", "stuck", "clipped", "jump", "duplicated row", "duplicated block", "gap",
    /// "beyond a gap or a block", "settling after a gap or a block", "shifted in time, late", "shifted in time, early",
    /// "swapped with another column".
    pub what: &'static str,
    /// First and last row, from 0.
    pub rows: (usize, usize),
}

/// The prepared records and what is wrong with them.
pub fn prepared(pieces: impl IntoIterator<Item = Piece>, file: &PlantFile) -> (Vec<Prepared>, Vec<Finding>) {
    let mut findings = Vec::new();
    let one = |piece: Piece| {
        let mut one = Prepared { from: piece.from, ..Prepared::new(piece.record, file.kind.outputs().len()) };
        findings.extend(check(&mut one, file));
        // Row numbers of the file. A check may have left out some rows.
        let settling = (0..one.record.rows()).take_while(|row| one.file_row(*row) < piece.from + piece.settling).count();
        one.used.iter_mut().for_each(|used| used[..settling].fill(false));
        one
    };
    let prepared = pieces.into_iter().map(one).collect();
    (prepared, findings)
}

/// Finds what is wrong with a record, and leaves those rows out.
pub fn check(prepared: &mut Prepared, file: &PlantFile) -> Vec<Finding> {
    gaps::fill(prepared);
    let mut findings = without_constant(prepared, file);
    let names = file.kind.outputs();
    let nominal = nominal_outputs(prepared, file);
    let record = prepared.record.file.clone();
    let rows = prepared.record.rows();
    let count = prepared.outputs.len();
    let noisy: Vec<bool> = (0..count).map(|k| is_noisy(prepared.measured(k))).collect();
    let finding = |channel: &str, what: &'static str, rows: (usize, usize)| Finding {
        record: record.clone(),
        channel: channel.to_string(),
        what,
        rows,
    };
    for row in &prepared.record.breaks {
        findings.push(finding("time", "gap", (row - 1, *row)));
    }
    let mut blocks = find(&(0..count).filter(|k| noisy[*k]).map(|k| prepared.measured(k)).collect::<Vec<_>>());
    // A plant at rest gives equal readings without noise. A recorder that repeats a block repeats its noise as well.
    let resting: Vec<StandstillTest> =
        (0..count).map(|k| StandstillTest::new(prepared.measured(k), nominal[k].as_deref())).collect();
    blocks.retain(|(from, to)| (0..count).any(|k| noisy[k] && !resting[k].is_still(*from..*to)));
    for block in &blocks {
        findings.push(finding("row", "duplicated block", (block.0, block.1 - 1)));
    }

    // A row is duplicated if all its noisy channels equal the row before.
    if count > 1 && noisy.iter().all(|noisy| *noisy) {
        for row in 1..rows {
            let same = |k: usize| prepared.measured(k)[row] == prepared.measured(k)[row - 1];
            if (0..count).all(same)
                && !(row > 1 && (0..count).all(|k| prepared.measured(k)[row - 1] == prepared.measured(k)[row - 2]))
                // A drive that is switched off at rest reads 0 in all channels.
                && !(0..count).all(|k| resting[k].rests(run_at(prepared.measured(k), row)))
            {
                findings.push(finding("row", "duplicated row", (row, row)));
            }
        }
    }
    for k in 0..count {
        if !noisy[k] {
            continue;
        }
        let values = prepared.measured(k);
        let (low, high) = order::ends(values);
        let channel = names[prepared.outputs[k]].name.to_string();
        let jump = largest_jump(values);
        let mut limits = Vec::new();
        let mut first = 0;
        for row in 1..=rows {
            if row < rows && values[row] == values[first] {
                continue;
            }
            let extreme = values[first] == low || values[first] == high;
            if row - first >= STUCK / 2 && resting[k].rests(first..row) {
                first = row;
                continue;
            }
            // At the end of the range, fewer equal readings are enough, because noise does not repeat an extreme value.
            if row - first >= STUCK || (extreme && row - first >= STUCK / 2) {
                // A channel leaves a limit again, and without a jump. If it stays there to the end of the record for a large part of it, it is stuck.
                let stays = row == rows && row - first >= rows / STAYS;
                if extreme && !stays && jump != Some(row) {
                    limits.push(values[first]);
                } else {
                    findings.push(finding(&channel, "stuck", (first, row - 1)));
                }
            }
            first = row;
        }
        order::sort(&mut limits);
        limits.dedup();
        findings
            .extend(limits.into_iter().flat_map(|limit| clipped(values, limit)).map(|rows| finding(&channel, "clipped", rows)));
        let jumps = jumps(values).into_iter().filter(|row| prepared.used[k][*row]);
        findings.extend(jumps.map(|row| finding(&channel, "jump", (row, row))));
    }
    leave_out(prepared, file, &findings);
    let unbroken = longest_part(prepared, &blocks);
    if unbroken != (0..rows) {
        // The state after a break is unknown, because sensors do not show all of it.
        let settled = if unbroken.start == 0 { 0 } else { settling_rows(prepared, file, unbroken.clone()).unwrap_or(0) };
        let first = (unbroken.start + settled).min(unbroken.end);
        for lost in [0..unbroken.start, unbroken.end..rows] {
            if !lost.is_empty() {
                findings.push(finding("row", "beyond a gap or a block", (lost.start, lost.end - 1)));
            }
        }
        if settled > 0 {
            findings.push(finding("row", "settling after a gap or a block", (unbroken.start, first.max(1) - 1)));
        }
        for used in &mut prepared.used {
            used[unbroken.start..first].fill(false);
        }
        in_file(prepared, &mut findings);
        prepared.keep(unbroken);
    } else {
        in_file(prepared, &mut findings);
    }
    findings
}

/// The row at which the channel changes by far more than at any other row, if there is one. A signal reaches and leaves a limit at its own rate. A
/// stuck channel holds a reading that was true, and then changes at once to the present value.
fn largest_jump(values: &[f64]) -> Option<usize> {
    let (mut largest, mut second) = ((0, 0.0), 0.0);
    for row in 1..values.len() {
        let step = (values[row] - values[row - 1]).abs();
        if step > largest.1 {
            (largest, second) = ((row, step), largest.1);
        } else if step > second {
            second = step;
        }
    }
    (largest.1 > JUMP_AFTER_STUCK * second).then_some(largest.0)
}

/// The first and last row of each interval in which a channel is at a limit. Beside the limit, noise decides which readings pass it. Readings below
/// the limit are therefore a biased sample, so a short interval between two clipped readings also counts as clipped.
fn clipped(values: &[f64], limit: f64) -> Vec<(usize, usize)> {
    let mut times: Vec<(usize, usize)> = Vec::new();
    for row in (0..values.len()).filter(|row| values[*row] == limit) {
        match times.last_mut() {
            Some(time) if row <= time.1 + BETWEEN_CLIPPED => time.1 = row,
            _ => times.push((row, row)),
        }
    }
    times
}

/// Converts the rows of findings to row numbers of the file. The file does not have the rows that were filled in.
fn in_file(prepared: &Prepared, findings: &mut [Finding]) {
    for finding in findings {
        finding.rows = (prepared.file_row(finding.rows.0), prepared.file_row(finding.rows.1));
    }
}

/// The nominal plant along a record, one entry for each output; `None` if it cannot be simulated. Used only to decide whether a channel should move
/// at all.
fn nominal_outputs(prepared: &Prepared, file: &PlantFile) -> Vec<Option<Vec<f64>>> {
    let run = Simulator::new(file, &prepared.record).ok().and_then(|mut it| it.run(&prepared.record).ok());
    let of = |output: &usize| run.as_ref()?.of(file.kind.outputs()[*output].name).map(<[f64]>::to_vec);
    prepared.outputs.iter().map(of).collect()
}

/// Removes channels that have one value in all rows while the nominal plant moves: the sensor is stuck, or the column was never filled in.
fn without_constant(prepared: &mut Prepared, file: &PlantFile) -> Vec<Finding> {
    let mut findings = Vec::new();
    let nominal = nominal_outputs(prepared, file);
    for k in (0..prepared.outputs.len()).rev() {
        let values = prepared.measured(k);
        let moves = nominal[k].as_deref().is_some_and(|it| !is_constant(it));
        if values.len() >= STUCK && is_constant(values) && moves {
            let channel = file.kind.outputs()[prepared.outputs[k]].name.to_string();
            findings.push(Finding {
                record: prepared.record.file.clone(),
                channel,
                what: CONSTANT,
                rows: (0, values.len() - 1),
            });
            prepared.outputs.remove(k);
            prepared.used.remove(k);
        }
    }
    findings
}

/// Whether all values are equal.
fn is_constant(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[0] == pair[1])
}

/// Leaves out the rows of findings.
fn leave_out(prepared: &mut Prepared, file: &PlantFile, findings: &[Finding]) {
    let names = file.kind.outputs();
    for finding in findings.iter().filter(|it| it.channel != "time") {
        for k in 0..prepared.outputs.len() {
            if finding.channel == "row" || names[prepared.outputs[k]].name == finding.channel {
                prepared.used[k][finding.rows.0..=finding.rows.1].fill(false);
            }
        }
    }
}

/// The part of a record without breaks that is kept: the first part if it is long enough, otherwise the longest.
fn longest_part(prepared: &Prepared, blocks: &[(usize, usize)]) -> std::ops::Range<usize> {
    let rows = prepared.record.rows();
    let mut cuts: Vec<(usize, usize)> =
        prepared.record.breaks.iter().map(|row| (*row, *row)).chain(blocks.iter().copied()).collect();
    cuts.sort_unstable();
    let mut parts = Vec::new();
    let mut start = 0;
    for (from, to) in cuts {
        parts.push(start..from.max(start));
        start = to.max(start);
    }
    parts.push(start..rows);
    let first = parts[0].clone();
    if first.len() as f64 >= FIRST_PART * rows as f64 {
        return first;
    }
    parts.into_iter().max_by_key(ExactSizeIterator::len).unwrap_or(first)
}

/// The number of rows for which the initial state matters: a simulation that starts in the middle of a part is compared with one from the start of
/// the part. A constant difference is only another start value, which is unknown anyway. `None` if the plant cannot be simulated.
pub(super) fn settling_rows(prepared: &Prepared, file: &PlantFile, part: std::ops::Range<usize>) -> Option<usize> {
    let whole = prepared.record.piece(part.clone());
    let middle = part.len() / 2;
    // Runs with different starts take different steps, so the tolerance is below the accuracy that is compared.
    let run = |record: &Record| Simulator::new(file, record).ok()?.tolerance(1e-12).run(record).ok();
    let long = run(&whole)?;
    let mut later = whole.piece(middle..part.len());
    for (output, measured) in file.kind.outputs().iter().zip(&mut later.measured) {
        if let (Some(measured), Some(values)) = (measured, long.of(output.name)) {
            measured.copy_from_slice(&values[middle..]);
        }
    }
    let short = run(&later)?;
    let of_output = |name: &str| {
        let (long, short) = (long.of(name)?, short.of(name)?);
        let off: Vec<f64> = long[middle..].iter().zip(short).map(|(long, short)| long - short).collect();
        let end = *off.last()?;
        let most = off.iter().fold(0.0_f64, |most, off| most.max((off - end).abs()));
        // A difference within the accuracy of a simulation counts as zero.
        let size = long.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        if most <= 1e-9 * size {
            Some(0)
        } else {
            off.iter().rposition(|off| (off - end).abs() > DECAYED * most).map(|row| row + 1)
        }
    };
    prepared.outputs.iter().filter_map(|output| of_output(file.kind.outputs()[*output].name)).max()
}

/// The run of equal readings that contains a row.
fn run_at(values: &[f64], row: usize) -> std::ops::Range<usize> {
    let same = |it: &&f64| **it == values[row];
    row - values[..row].iter().rev().take_while(same).count()..row + values[row..].iter().take_while(same).count()
}

/// Whether few readings repeat the one before, outside the longest run of equal readings.
fn is_noisy(values: &[f64]) -> bool {
    let mut hangs = 0..0;
    let mut first = 0;
    for row in 1..=values.len() {
        if row == values.len() || values[row] != values[first] {
            if row - first > hangs.len() {
                hangs = first..row;
            }
            first = row;
        }
    }
    let mut beside: Vec<f64> = values[..hangs.start].iter().chain(&values[hangs.end..]).copied().collect();
    if hangs.len() < STUCK || beside.len() < ENOUGH_BESIDE {
        beside = values.to_vec();
    }
    // At a limit and in a dead band, readings repeat whatever the noise. Only readings between them show noise.
    let (low, high) = order::ends(values);
    let between: Vec<f64> = beside.iter().copied().filter(|value| ![low, high, 0.0].contains(value)).collect();
    repeats_little(if between.len() < ENOUGH_BESIDE { &beside } else { &between })
}

fn repeats_little(values: &[f64]) -> bool {
    // A stuck channel repeats for a long run. The other rows show whether the channel is noisy.
    let mut repeats = 0;
    let mut runs = 0;
    for k in 1..values.len() {
        if values[k] == values[k - 1] {
            repeats += 1;
            if k < 2 || values[k - 1] != values[k - 2] {
                runs += 1;
            }
        }
    }
    repeats < values.len() / 2 && (runs as f64) < REPEATS * values.len() as f64
}

/// Single samples far from the line through their neighbours.
#[must_use]
pub fn jumps(values: &[f64]) -> Vec<usize> {
    let second: Vec<f64> = values.windows(3).map(|w| w[1] - 0.5 * (w[0] + w[2])).collect();
    // A channel that repeats its value is at rest and shows no noise.
    let moves = standstill::moving(values);
    let sizes = second.iter().enumerate().filter(|(k, _)| moves[k + 1]).map(|(_, value)| value.abs());
    let mut sizes: Vec<f64> = sizes.collect();
    // For a normal x, the median of |x| is 0.6745 standard deviations.
    let sd = median(&mut sizes) / 0.6745;
    // A rounded sensor on a straight line: four readings, each up to half a step off, give the second difference.
    let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    if sd <= 4.0 * f64::EPSILON * largest {
        return Vec::new();
    }
    let off = |k: usize| k.checked_sub(1).and_then(|k| second.get(k)).copied().unwrap_or(0.0);
    (1..values.len().saturating_sub(1))
        .filter(|&row| {
            // A spike bends the line at its row one way, and at both neighbours half as much the other way. A step or a corner does not.
            let here = off(row);
            let (before, after) = (off(row - 1), off(row + 1));
            here.abs() > JUMP * sd && before * here < -0.16 * here * here && after * here < -0.16 * here * here
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::record::Record;

    fn rows(change: impl Fn(usize, &mut [f64; 3])) -> Vec<String> {
        let mut random = Random::new(3);
        (0..400)
            .map(|k| {
                let mut values = [0.0, 5.0, 100.0].map(|value| value + 0.1 * random.normal());
                values[1] += if k > 200 { 3.0 } else { 0.0 };
                change(k, &mut values);
                format!("{},0,5,0,{},{},{}\n", k as f64 / 1000.0, values[0], values[1], values[2])
            })
            .collect()
    }

    fn prepared(rows: &[String]) -> (Prepared, PlantFile) {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../rsm-sim/plants/pmac.toml")).unwrap();
        let file = PlantFile::read(&Source::new("pmac.toml", text)).unwrap();
        let csv = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string() + &rows.concat();
        (Prepared::new(Record::read_with_gaps(&Source::new("r.csv", csv), &file).unwrap(), 3), file)
    }

    fn motor(change: impl Fn(usize, &mut [f64; 3])) -> (Prepared, PlantFile) {
        prepared(&rows(change))
    }

    fn found(change: impl Fn(usize, &mut [f64; 3])) -> Vec<(String, &'static str, (usize, usize))> {
        let (mut prepared, file) = motor(change);
        let findings = check(&mut prepared, &file);
        for finding in &findings {
            assert!(!prepared.used[prepared.used.len() - 1][finding.rows.0] || finding.channel != "speed");
        }
        findings.into_iter().map(|it| (it.channel, it.what, it.rows)).collect()
    }

    #[test]
    fn a_record_in_order_with_a_step_has_no_findings() {
        assert_eq!(found(|_, _| {}), vec![]);
    }

    #[test]
    fn a_spike_a_hanging_channel_and_a_clipped_one_are_found_where_they_are() {
        let spike = found(|k, values| values[2] += if k == 77 { 5.0 } else { 0.0 });
        assert_eq!(spike, vec![("speed".to_string(), "jump", (77, 77))]);
        let stuck = found(|k, values| {
            if (100..140).contains(&k) {
                values[2] = 100.01;
            }
        });
        assert_eq!(stuck, vec![("speed".to_string(), "stuck", (100, 139))]);
        let clipped = found(|k, values| {
            if (300..330).contains(&k) {
                values[1] = 8.5;
            }
        });
        assert_eq!(clipped, vec![("i_q".to_string(), "clipped", (300, 329))]);
    }

    #[test]
    fn a_channel_that_hangs_at_its_largest_reading_is_stuck_and_one_that_a_limit_cuts_is_clipped() {
        // A speed that swings by 10 rad/s, 400 rows. It hangs from a row before its first maximum until it is far below.
        for first in [55, 58, 61] {
            for last in [110, 140, 170] {
                let swing = |k: usize| 100.0 + 10.0 * (k as f64 / 40.0).sin();
                let hangs = found(|k, values| {
                    let noise = values[2] - 100.0;
                    values[2] = if (first..=last).contains(&k) { 111.0 } else { swing(k) + 0.1 * noise };
                });
                assert_eq!(hangs, vec![("speed".to_string(), "stuck", (first, last))]);
                let cut = found(|k, values| {
                    let noise = values[2] - 100.0;
                    values[2] = (swing(k) + 0.1 * noise).min(108.0);
                });
                assert!(cut.iter().all(|it| it.1 == "clipped") && !cut.is_empty(), "{cut:?}");
            }
        }
    }

    #[test]
    fn a_plant_at_rest_is_no_fault_and_a_channel_that_hangs_for_most_of_a_record_is_one() {
        // A speed that is made from an encoder's counts reads 0 at rest; the motor turns by 100 rad/s at most, and rests where no voltage drives it.
        let file = {
            let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../rsm-sim/plants/pmac.toml")).unwrap();
            PlantFile::read(&Source::new("pmac.toml", text)).unwrap()
        };
        let mut csv = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
        for k in 0..1200 {
            csv += &format!("{},0,{},0,0,0,0\n", f64::from(k) / 1000.0, if (300..600).contains(&k) { 20.0 } else { 0.0 });
        }
        let mut record = Record::read(&Source::new("r.csv", csv), &file).unwrap();
        let simulated = Simulator::new(&file, &record).unwrap().run(&record).unwrap();
        let mut random = Random::new(8);
        for (k, name) in ["i_d", "i_q", "speed"].iter().enumerate() {
            let values = simulated.of(name).unwrap().iter().map(|value| value + 0.1 * random.normal());
            record.measured[k] = Some(values.collect());
        }
        let resting = |record: &Record| {
            let mut record = record.clone();
            for value in record.measured[2].as_mut().unwrap().iter_mut().take(200) {
                *value = 0.0;
            }
            record
        };
        let found = |record: Record| {
            let mut prepared = Prepared::new(record, 3);
            check(&mut prepared, &file).into_iter().map(|it| (it.channel, it.what, it.rows)).collect::<Vec<_>>()
        };
        assert_eq!(found(resting(&record)), vec![]);
        let mut hanging = record.clone();
        let speed = hanging.measured[2].as_mut().unwrap();
        let value = speed[400];
        speed[400..].fill(value);
        assert_eq!(found(hanging), vec![("speed".to_string(), "stuck", (400, 1199))]);
        let mut constant = record.clone();
        constant.measured[2].as_mut().unwrap().fill(0.0);
        assert_eq!(found(constant), vec![("speed".to_string(), "constant", (0, 1199))]);
    }

    #[test]
    fn a_record_ends_at_a_gap_and_begins_after_one_where_little_stands_before() {
        for (missing, kept, from) in [(200..230, 200, 0), (50..80, 320, 80)] {
            let all = rows(|_, _| {});
            let (first, last) = (&all[..missing.start], &all[missing.end..]);
            let (mut prepared, file) = prepared(&[first, last].concat());
            let findings = check(&mut prepared, &file);
            assert_eq!((findings[0].what, findings[0].rows), ("gap", (missing.start - 1, missing.start)));
            assert_eq!((prepared.record.rows(), prepared.record.breaks.len()), (kept, 0));
            // Of the file, whose rows are fewer by those that are missing.
            assert_eq!(prepared.from, if from > 0 { missing.start } else { 0 });
            assert!(prepared.used.iter().all(|used| used.len() == kept && used.iter().all(|used| *used)));
            let period = prepared.record.period;
            assert!((period - 0.001).abs() < 1e-9, "{period}");
        }
    }

    #[test]
    fn a_block_that_stands_twice_ends_a_record() {
        let mut all = rows(|_, _| {});
        for k in 150..170 {
            // The recorder wrote the readings again; time went on.
            let again = all[k].split_once(',').unwrap().1.to_string();
            all[k + 20] = format!("{},{again}", (k + 20) as f64 / 1000.0);
        }
        let (mut prepared, file) = prepared(&all);
        let findings = check(&mut prepared, &file);
        assert_eq!((findings[0].what, findings[0].rows), ("duplicated block", (170, 189)));
        assert_eq!(prepared.record.rows(), 170);
    }
}
