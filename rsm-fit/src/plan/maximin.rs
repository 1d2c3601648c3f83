//! Latin hypercubes that maximise the smallest distance between two runs.
//!
//! In: factors, runs, a stream of random numbers. Out: points in the middles of the slices. Two runs exchange their slices of one factor. An exchange
//! is kept if it reduces the sum of the inverse powers of the distances or, early in the search, increases it a little (Morris, Mitchell 1995;
//! thresholds instead of probabilities: Dueck, Scheuer 1990). Squares of distances are integers, in slices, and no library function is used, so the
//! design is the same on every machine.

use super::points::Points;
use crate::random::Random;

/// The largest number of computed distances, in all: about two seconds.
const WORK: usize = 60_000_000;

/// The largest number of exchanges in a search.
const SWAPS: usize = 300_000;

/// The number of searches from a new start.
const STARTS: usize = 8;

/// The share by which an exchange may increase the sum at first.
const THRESHOLD: f64 = 2.0;

pub(super) fn hypercube(factors: usize, runs: usize, random: &mut Random) -> Points {
    let swaps = (WORK / STARTS / (2 * runs * factors)).clamp(100, SWAPS);
    let mut best: Option<(u64, f64, Vec<Vec<u32>>)> = None;
    for _ in 0..STARTS {
        let (slices, sum) = search(factors, runs, swaps, random);
        let least = least_square(&slices);
        if best.as_ref().is_none_or(|(most, of, _)| (least, *of) > (*most, sum)) {
            best = Some((least, sum, slices));
        }
    }
    let slices = best.expect("there is at least one start").2;
    let middle = |slice: &u32| (2.0 * f64::from(*slice) + 1.0) / runs as f64 - 1.0;
    slices.iter().map(|point| point.iter().map(middle).collect()).collect()
}

fn search(factors: usize, runs: usize, swaps: usize, random: &mut Random) -> (Vec<Vec<u32>>, f64) {
    let mut slices = vec![vec![0u32; factors]; runs];
    for factor in 0..factors {
        let mut order: Vec<u32> = (0..runs as u32).collect();
        random.shuffle(&mut order);
        slices.iter_mut().zip(order).for_each(|(point, slice)| point[factor] = slice);
    }
    if runs < 3 || factors < 2 {
        return (slices, 0.0);
    }
    // In units of the squared distance of n equidistant points, so that the powers stay near 1.
    let unit = factors as f64 * (runs * (runs + 1)) as f64 / 6.0;
    let mut sum: f64 = (0..runs).map(|run| share(&slices, run, run, unit)).sum::<f64>() / 2.0;
    let (mut best, mut best_sum) = (slices.clone(), sum);
    for swap in 0..swaps {
        let factor = random.below(factors as u64) as usize;
        let (one, other) = (random.below(runs as u64) as usize, random.below(runs as u64) as usize);
        if one == other {
            continue;
        }
        let before = share(&slices, one, other, unit) + share(&slices, other, one, unit);
        exchange(&mut slices, one, other, factor);
        let after = share(&slices, one, other, unit) + share(&slices, other, one, unit);
        let left = 1.0 - swap as f64 / swaps as f64;
        let threshold = THRESHOLD * left * left;
        if sum + (after - before) <= sum * (1.0 + threshold) {
            sum += after - before;
            if sum < best_sum {
                (best, best_sum) = (slices.clone(), sum);
            }
        } else {
            exchange(&mut slices, one, other, factor);
        }
    }
    (best, best_sum)
}

fn exchange(slices: &mut [Vec<u32>], one: usize, other: usize, factor: usize) {
    let kept = slices[one][factor];
    slices[one][factor] = slices[other][factor];
    slices[other][factor] = kept;
}

/// The sum of d^-16 between a run and all runs except itself and `but`.
fn share(slices: &[Vec<u32>], run: usize, but: usize, unit: f64) -> f64 {
    let of = |other: &Vec<u32>| {
        let ratio = unit / square(&slices[run], other) as f64;
        let two = ratio * ratio;
        let four = two * two;
        four * four
    };
    slices.iter().enumerate().filter(|(k, _)| *k != run && *k != but).map(|(_, other)| of(other)).sum()
}

fn square(one: &[u32], other: &[u32]) -> u64 {
    one.iter().zip(other).map(|(a, b)| u64::from(a.abs_diff(*b)) * u64::from(a.abs_diff(*b))).sum()
}

fn least_square(slices: &[Vec<u32>]) -> u64 {
    let of = |(k, one): (usize, &Vec<u32>)| slices[k + 1..].iter().map(|other| square(one, other)).min();
    slices.iter().enumerate().filter_map(of).min().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::super::points::least_distance;
    use super::*;

    #[test]
    fn least_distances_are_the_best_known() {
        // Van Dam, Husslage, den Hertog, Melissen 2007, table 1 (two factors: proved), and Husslage and others 2011 (three, four and five): squares
        // in slices.
        for (factors, runs, best) in [
            (2, 5, 5),
            (2, 7, 8),
            (2, 10, 10),
            (2, 12, 13),
            (3, 5, 11),
            (3, 6, 14),
            (3, 8, 21),
            (4, 5, 15),
            (4, 6, 22),
            (5, 6, 32),
        ] {
            let points = hypercube(factors, runs, &mut Random::new(1));
            let slices: Vec<Vec<u32>> =
                points.iter().map(|point| point.iter().map(|x| ((x + 1.0) / 2.0 * runs as f64) as u32).collect()).collect();
            for factor in 0..factors {
                let mut column: Vec<u32> = slices.iter().map(|point| point[factor]).collect();
                column.sort_unstable();
                assert_eq!(column, (0..runs as u32).collect::<Vec<_>>());
            }
            assert_eq!(least_square(&slices), best, "{factors} factors, {runs} runs");
        }
    }

    #[test]
    fn least_distances_are_above_those_of_the_r_package_lhs() {
        // R lhs 1.1.6 on the unit cube: the best of ten seeds of each of maximinLHS, optimumLHS (4 sweeps), improvedLHS, geneticLHS (50 of 20
        // generations).
        for (factors, runs, best) in
            [(2, 10, 0.264_470_7), (3, 20, 0.322_757_7), (5, 30, 0.491_937_1), (5, 50, 0.379_383_1), (8, 80, 0.567_865_9)]
        {
            let points = hypercube(factors, runs, &mut Random::new(1));
            // The unit cube is half as wide as the coded one.
            let least = least_distance(&points).sqrt() / 2.0;
            println!("{factors} factors, {runs} runs: {least:.4}, lhs {best}");
            assert!(least >= best, "{factors} factors, {runs} runs: {least} {best}");
        }
    }
}
