//! Bursts of noise: some rows in which a channel is far noisier than in all others, for example from a switching relay or a loose contact.
//!
//! In: the residuals of an output, in each record. Out: the rows of its bursts. Those rows are left out and reported: they contain little information
//! and would dominate a least squares fit. A real motion can look like a burst too, for example if a contact vibrates or the simulation misses a fast
//! transient. Such residuals are autocorrelated from row to row; noise is not. Autocorrelated bursts are structure and are kept.

use std::ops::Range;

use super::alignment;
use super::checks::Finding;
use super::levenberg::Fit;
use super::outlier_correction::difference;
use super::prepared::Prepared;
use super::tails::{deviation, off_neighbours};
use super::validation;
use super::whitened_residuals::WhitenedResiduals;
use crate::engine::significance::median;

/// The text of a finding.
pub const BURST: &str = "burst of noise";

/// A reading is large if it deviates from its neighbours by more than this many standard deviations. Of normal noise, one reading in 80 is large.
const LARGE_READING: f64 = 2.5;

/// The number of rows in a window.
const WINDOW: usize = 8;

/// With this many large readings in a window, a channel has bursts. Of normal noise one window in 10^8 has as many; of noise six times as large, four
/// in five have.
const LEAST_TO_DETECT: usize = 5;

/// In a channel with bursts, a window with this many large readings belongs to a burst. Of normal noise one window in 10,000 has as many.
const LEAST_IN_BURST: usize = 3;

/// Rows added at each end of a burst, because its first and last readings may be small by chance: with noise six times as large, one reading in three
/// is small.
const MARGIN: usize = 2;

/// The largest share of rows in bursts. With more, the noise level changes, and these are no bursts.
const MOST_IN_BURSTS: f64 = 0.2;

/// With fewer rows in all bursts, their autocorrelation is not tested.
const LEAST_ROWS: usize = 20;

/// The largest lag in rows of the autocorrelation test.
const MOST_LAG: usize = 4;

/// For independent readings, a sum of products exceeds this many of its standard deviations once in a thousand cases.
const CORRELATED: f64 = 3.3;

/// The residual of an output in one record, and which rows count.
pub(super) type OutputResidual<'a> = (&'a [f64], &'a [bool]);

/// The bursts of an output, one list for each record. Empty if there are none, or if the bursts are autocorrelated.
#[must_use]
pub(super) fn of_output(lists: &[OutputResidual<'_>]) -> Vec<Vec<Range<usize>>> {
    let none = vec![Vec::new(); lists.len()];
    if lists.iter().all(|(left, used)| burst_rows(left, used, LEAST_TO_DETECT).is_empty()) {
        return none;
    }
    let bursts: Vec<Vec<Range<usize>>> = lists.iter().map(|(left, used)| burst_rows(left, used, LEAST_IN_BURST)).collect();
    let rows: usize = bursts.iter().flatten().map(ExactSizeIterator::len).sum();
    let few = |(bursts, (_, used)): (&Vec<Range<usize>>, &OutputResidual<'_>)| {
        let counted = used.iter().filter(|used| **used).count();
        bursts.iter().map(ExactSizeIterator::len).sum::<usize>() as f64 <= MOST_IN_BURSTS * counted as f64
    };
    if rows < LEAST_ROWS || !bursts.iter().zip(lists).all(few) || is_autocorrelated(lists, &bursts) {
        return none;
    }
    bursts
}

/// Rows of a record in windows with at least this many large readings.
fn burst_rows(left: &[f64], used: &[bool], least: usize) -> Vec<Range<usize>> {
    let off = off_neighbours(left, used);
    let Some(size) = deviation(&off).filter(|size| *size > 0.0) else { return Vec::new() };
    let large: Vec<bool> = off.iter().map(|off| off.is_some_and(|off| off.abs() > LARGE_READING * size)).collect();
    let mut bursts: Vec<Range<usize>> = Vec::new();
    for start in 0..large.len().saturating_sub(WINDOW - 1) {
        let window = &large[start..start + WINDOW];
        if window.iter().filter(|large| **large).count() < least {
            continue;
        }
        let first = start + window.iter().position(|large| *large).unwrap_or(0);
        let last = start + window.iter().rposition(|large| *large).unwrap_or(0);
        let rows = first.saturating_sub(MARGIN)..(last + 1 + MARGIN).min(left.len());
        match bursts.last_mut() {
            Some(before) if rows.start <= before.end + MARGIN => before.end = before.end.max(rows.end),
            _ => bursts.push(rows),
        }
    }
    bursts
}

/// Whether readings in bursts are autocorrelated. The test uses their mean and the products of readings some rows apart; each sum is divided by the
/// root of its sum of squares.
fn is_autocorrelated(lists: &[OutputResidual<'_>], bursts: &[Vec<Range<usize>>]) -> bool {
    let mut sums = [(0.0, 0.0); MOST_LAG + 1];
    for ((left, used), bursts) in lists.iter().zip(bursts) {
        for burst in bursts {
            // A slow deviation is not part of a burst: the median of the rows beside it is subtracted.
            let near = burst.start.saturating_sub(burst.len())..(burst.end + burst.len()).min(left.len());
            let mut beside: Vec<f64> = near.filter(|row| !burst.contains(row) && used[*row]).map(|row| left[row]).collect();
            let level = if beside.is_empty() { 0.0 } else { median(&mut beside) };
            let mut off: Vec<f64> = burst.clone().map(|row| if used[row] { left[row] - level } else { 0.0 }).collect();
            // Each burst is scaled to the same size, so that all count equally.
            let size = (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt();
            off.iter_mut().for_each(|off| *off /= size.max(f64::MIN_POSITIVE));
            for (later, sum) in sums.iter_mut().enumerate() {
                for row in 0..off.len().saturating_sub(later) {
                    let part = if later == 0 { off[row] } else { off[row] * off[row + later] };
                    (sum.0, sum.1) = (sum.0 + part, sum.1 + part * part);
                }
            }
        }
    }
    sums.iter().any(|(sum, squares)| sum.abs() > CORRELATED * squares.sqrt())
}

/// Leaves out the rows of bursts in both sets of records. Returns whether there were any.
pub(super) fn leave_out(
    whitened: &mut WhitenedResiduals,
    unseen: &mut WhitenedResiduals,
    calibrated: &Fit,
    findings: &mut Vec<Finding>,
) -> bool {
    let there = validation::fit_initial_states(unseen, &calibrated.model).map_or_else(Vec::new, |fit| fit.simulated);
    let mut any = false;
    for (output, signal) in calibrated.model.file.kind.outputs().iter().enumerate() {
        if whitened.tails[output].is_some() {
            continue;
        }
        let records = whitened.records.iter_mut().zip(&calibrated.simulated).chain(unseen.records.iter_mut().zip(&there));
        let kind = calibrated.model.file.kind;
        let mut holding: Vec<(&mut Prepared, usize, Vec<f64>, Vec<bool>)> = Vec::new();
        for (prepared, simulated) in records {
            if let Some(k) = prepared.outputs.iter().position(|it| *it == output) {
                let left = difference(prepared.measured(k), &simulated[k]);
                // The largest readings of a burst may have been left out as jumps.
                let mut used = prepared.used[k].clone();
                alignment::jumps_of(prepared, k, kind, findings).into_iter().for_each(|row| used[row] = true);
                holding.push((prepared, k, left, used));
            }
        }
        let lists: Vec<OutputResidual<'_>> = holding.iter().map(|it| (it.2.as_slice(), it.3.as_slice())).collect();
        let bursts = of_output(&lists);
        for ((prepared, k, ..), bursts) in holding.into_iter().zip(bursts) {
            let (record, channel) = (prepared.record.file.clone(), signal.name.to_string());
            // A jump inside a burst is part of the burst.
            let in_burst =
                |it: &Finding| prepared.row_of(it.rows.0).is_some_and(|row| bursts.iter().any(|burst| burst.contains(&row)));
            findings.retain(|it| it.what != "jump" || it.record != record || it.channel != channel || !in_burst(it));
            any |= !bursts.is_empty();
            for burst in bursts {
                let rows = (prepared.file_row(burst.start), prepared.file_row(burst.end - 1));
                findings.push(Finding { record: record.clone(), channel: channel.clone(), what: BURST, rows });
                prepared.used[k][burst].fill(false);
            }
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    fn found(left: &[f64]) -> Vec<Range<usize>> {
        of_output(&[(left, &vec![true; left.len()])]).remove(0)
    }

    /// Where bursts of 12 to 36 rows stand in 4000.
    fn places() -> Vec<Range<usize>> {
        (0..8).map(|k| 300 + 470 * k..312 + 473 * k).collect()
    }

    #[test]
    fn bursts_of_noise_are_found_where_they_are() {
        let mut random = Random::new(3);
        for draw in 0..20 {
            // A slow motion that the simulation misses, twenty times the noise, is no burst and hides none.
            let mut left: Vec<f64> = (0..4000).map(|k| random.normal() + 20.0 * (f64::from(k) / 300.0).sin()).collect();
            for row in places().into_iter().flatten() {
                left[row] += 6.0 * random.normal();
            }
            let bursts = found(&left);
            let covers = |row: &usize| bursts.iter().any(|it| it.contains(row));
            let all: usize = places().iter().map(ExactSizeIterator::len).sum();
            let hit = places().into_iter().flatten().filter(covers).count();
            let rows: usize = bursts.iter().map(ExactSizeIterator::len).sum();
            // One reading of three is small by chance: of the rows at the ends of a burst some are missed, and a short burst that has many.
            assert!(hit as f64 > 0.75 * all as f64, "{draw}: {hit} of {all}, {bursts:?}");
            // Four rows of margin a burst, as many again by chance.
            assert!(rows < hit + 64, "{draw}: {rows} for {hit}");
        }
    }

    #[test]
    fn noise_without_bursts_has_none_and_neither_has_what_follows_itself() {
        let mut random = Random::new(4);
        for _ in 0..50 {
            assert_eq!(found(&(0..4000).map(|_| random.normal()).collect::<Vec<_>>()), []);
        }
        let with = |mut loud: Box<dyn FnMut(usize) -> f64>| {
            let mut random = Random::new(5);
            let mut left: Vec<f64> = (0..4000).map(|_| random.normal()).collect();
            places().into_iter().for_each(|rows| rows.clone().for_each(|row| left[row] += loud(row - rows.start)));
            found(&left)
        };
        // A contact that rings, a corner that a simulation misses, a knock that decays.
        assert_eq!(with(Box::new(|k| 8.0 * (2.0 * k as f64).sin())), []);
        assert_eq!(with(Box::new(|k| 12.0 - (k as f64 - 6.0).abs() * 2.0)), []);
        assert_eq!(with(Box::new(|k| 20.0 * 0.8_f64.powi(k as i32))), []);
        // The turning points of a motion that the simulation misses, each another time as large, beside a noise that hardly shows there.
        let turns = |k: usize| 3e3 * (1.0 + (k / 900) as f64) * (k as f64 / 110.0).sin();
        assert_eq!(found(&(0..4000).map(|k| random.normal() + turns(k)).collect::<Vec<_>>()), []);
        // The noise of half a record is no burst.
        let mut left: Vec<f64> = (0..4000).map(|_| random.normal()).collect();
        left[2000..].iter_mut().for_each(|it| *it *= 6.0);
        assert_eq!(found(&left), []);
    }
}
