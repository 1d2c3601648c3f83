//! Blocks of rows that occur twice in a record, because a recorder wrote its buffer again.
//!
//! In: the noisy channels of a record. Out: the rows of each repeated block. The test includes the probability that rows are equal by chance. It uses
//! neither time nor a plant.

use rsm_core::order;
use std::collections::HashMap;

/// In a noisy channel two equal readings may be chance. This many equal readings mean that the channel is stuck.
pub(super) const STUCK: usize = 8;

/// A block is reported if the probability of its repetition by chance, anywhere in a record, is below this.
const SIGNIFICANCE: f64 = 1e-6;

/// Blocks of rows whose noisy readings all occurred earlier in the record: the first row and the row after the last.
pub fn find(channels: &[&[f64]]) -> Vec<(usize, usize)> {
    let Some(first) = channels.first() else { return Vec::new() };
    let rows = first.len();
    // The probability that two rows are equal by chance: the share of equal pairs in each channel, counting at least one pair.
    let chance = |values: &&[f64]| {
        let mut sorted = values.to_vec();
        order::sort(&mut sorted);
        let equal: f64 = sorted.chunk_by(|a, b| a == b).map(|run| (run.len() * (run.len() - 1)) as f64).sum();
        (equal.max(2.0) / (rows as f64 * (rows as f64 - 1.0)).max(1.0)).ln()
    };
    let of_a_row: f64 = channels.iter().map(chance).sum();
    let same = |a: usize, b: usize| channels.iter().all(|values| values[a] == values[b]);
    // If nothing changes from the row before, the plant is at rest or a channel is stuck. No block begins there, and a long rest is not compared with
    // itself.
    let moves = |row: usize| row == 0 || !same(row - 1, row);
    let mut places: HashMap<u64, Vec<usize>> = HashMap::new();
    // For each row, the longest block from it that occurred before. A block that began one row earlier is not counted again.
    let longest: Vec<(usize, bool)> = (0..rows)
        .map(|row| {
            if !moves(row) {
                return (0, false);
            }
            let before = places.entry(first[row].to_bits()).or_default();
            let length = |start: usize| (0..rows - row).take_while(|k| start + k < row && same(start + k, row + k)).count();
            let best = before.iter().map(|start| (length(*start), *start)).max().unwrap_or((0, 0));
            before.push(row);
            (best.0, best.0 > 0 && (best.1 == 0 || !same(best.1 - 1, row - 1)))
        })
        .collect();
    // If rows were independent, a block of this length would occur twice with a probability below `SIGNIFICANCE`.
    let independent = (SIGNIFICANCE.ln() - 2.0 * (rows as f64).ln()) / of_a_row.min(-f64::MIN_POSITIVE);
    // Rows are not independent if a plant rests or repeats its motion. Short blocks show how often a repeated row is followed by another repeated
    // row.
    let short = |least: usize| longest.iter().filter(|it| it.1 && (least..STUCK).contains(&it.0)).count() as f64;
    let (one, two) = (short(1), short(2));
    let following =
        if two > 0.0 { 1.0 + (SIGNIFICANCE / one).ln() / (two / one).min(1.0 - 1.0 / (one + 1.0)).ln() } else { 0.0 };
    let least = independent.max(following).ceil().max(2.0);
    let mut blocks = Vec::new();
    let mut row = 0;
    while row < rows {
        let length = longest[row].0;
        let stands_twice = length as f64 >= least;
        if stands_twice {
            blocks.push((row, row + length));
        }
        row += if stands_twice { length } else { 1 };
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_fit::random::Random;

    #[test]
    fn blocks_of_coarse_readings_may_stand_twice_by_chance() {
        // Forty readings at random: of 400 rows every run of two occurs twice somewhere, of three some.
        let mut random = Random::new(9);
        let coarse: Vec<f64> = (0..400).map(|_| (40.0 * random.uniform()).floor()).collect();
        assert_eq!(find(&[&coarse]), vec![]);
        let mut doubled = coarse.clone();
        doubled.copy_within(100..120, 300);
        assert_eq!(find(&[&doubled]), vec![(300, 320)]);
    }
}
