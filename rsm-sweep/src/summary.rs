//! Summary of many runs: mean and quantiles of each figure, with their confidence intervals.
//!
//! In: the table of a list of runs. Out: a [`Summary`] for each plant, record and figure. Intervals are given only if the runs are independent draws.
//! They are not valid for a design (Sobol, Latin hypercube, plan), and repeats of one setting are not draws of the settings.
//!
//! The interval of a quantile lies between two order statistics (W. J. Conover, Practical Nonparametric Statistics, 3.2): the number of draws below
//! the true quantile is binomial, for any distribution. If there are too few runs for such a bound, there is none.

use rsm_core::order;
use rsm_fit::distributions::quantile_t;
use statrs::function::beta::beta_reg;

use crate::scenario::{Points, Scenario, Simulations, Work};
use crate::table::{Cells, Column, Table, figure};

/// The confidence of every interval.
pub const CONFIDENCE: f64 = 0.95;

/// The shares of the reported quantiles.
pub const SHARES: [f64; 7] = [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99];

/// A figure over all runs of a plant along a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The name of its column.
    pub figure: String,
    /// Its unit.
    pub unit: Option<String>,
    /// The plant.
    pub plant: String,
    /// The record.
    pub record: String,
    /// The number of runs with a value.
    pub count: usize,
    /// The number of runs without one.
    pub failed: usize,
    /// The mean of the values.
    pub mean: f64,
    /// Its interval, by Student's t.
    pub mean_interval: Option<[f64; 2]>,
    /// Their standard deviation.
    pub sd: f64,
    /// The smallest and the largest value.
    pub range: [f64; 2],
    /// Quantiles.
    pub quantiles: Vec<Quantile>,
}

/// A quantile.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantile {
    /// The share below it.
    pub share: f64,
    /// The estimate: linear interpolation between the two nearest runs (Hyndman and Fan 1996, type 7).
    pub value: f64,
    /// The lower end of its interval.
    pub low: Option<f64>,
    /// The upper end.
    pub high: Option<f64>,
}

/// Whether the runs are independent draws of the varied quantities.
fn is_independent(all: &Simulations) -> bool {
    let draws = matches!(all.points, Points::Random) && all.settings > 1 && all.repeats == 1;
    let planned = all.plants.iter().flat_map(|it| &it.places).any(|it| matches!(it.law, crate::scenario::Law::Planned(_)));
    // Or the runs repeat a single setting with independent noise.
    (draws && !planned) || (all.settings == 1 && all.noise)
}

/// A summary of each figure; empty for diagnoses.
#[must_use]
pub fn of(scenario: &Scenario, table: &Table) -> Vec<Summary> {
    let Work::Simulate(all) = &scenario.work else { return Vec::new() };
    let independent = is_independent(all);
    let names = |key: &str| match table.column(key).map(|it| &it.cells) {
        Some(Cells::Texts(cells)) => cells.as_slice(),
        _ => &[],
    };
    let (plants, records) = (names("plant"), names("record"));
    let mut found = Vec::new();
    for plant in &all.plants {
        for record in &all.records {
            let is_here = |row: &usize| {
                plants.get(*row).and_then(Option::as_ref) == Some(&plant.name)
                    && records.get(*row).and_then(Option::as_ref) == Some(record)
            };
            let rows: Vec<usize> = (0..table.rows()).filter(is_here).collect();
            for (output, statistics) in &all.outputs {
                for it in statistics {
                    let name = figure(output, it.name());
                    let Some(column) = table.column(&name) else { continue };
                    found.extend(summary(column, &rows, independent, [&plant.name, record]));
                }
            }
        }
    }
    found
}

fn summary(column: &Column, rows: &[usize], independent: bool, [plant, record]: [&str; 2]) -> Option<Summary> {
    let Cells::Numbers(cells) = &column.cells else { return None };
    let mut values: Vec<f64> = rows.iter().filter_map(|row| cells[*row]).collect();
    // The sum follows the order of the list, so it does not depend on the order of equal numbers after sorting.
    let count = values.len();
    let mean = values.iter().sum::<f64>() / count as f64;
    let sd = (values.iter().map(|it| (it - mean) * (it - mean)).sum::<f64>() / (count as f64 - 1.0)).sqrt();
    order::sort(&mut values);
    let [Some(least), Some(most)] = [values.first(), values.last()] else { return None };
    let range = [*least, *most];
    let mean_interval = (independent && count > 1).then(|| {
        let half = quantile_t(CONFIDENCE, count - 1) * sd / (count as f64).sqrt();
        [mean - half, mean + half]
    });
    let quantiles = SHARES.map(|share| {
        let [low, high] = if independent { order_statistics(share, count) } else { [None, None] };
        let at = |place: Option<usize>| place.map(|place| values[place]);
        Quantile { share, value: quantile(&values, share), low: at(low), high: at(high) }
    });
    Some(Summary {
        figure: column.name.clone(),
        unit: column.unit.clone(),
        plant: plant.into(),
        record: record.into(),
        count,
        failed: rows.len() - count,
        mean,
        mean_interval,
        sd,
        range,
        quantiles: quantiles.into(),
    })
}

/// The quantile of sorted values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (below, part) = (place.floor() as usize, place.fract());
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] * (1.0 - part) + sorted[above] * part
}

/// P(at most `most` of `count` draws fall below the quantile of a share) = I_{1-share}(count - most, most + 1).
fn at_most(most: usize, count: usize, share: f64) -> f64 {
    if most >= count { 1.0 } else { beta_reg((count - most) as f64, most as f64 + 1.0, 1.0 - share) }
}

/// The indices (from 0) of the two sorted draws that enclose the quantile with the confidence; half of the remaining probability is on each side.
fn order_statistics(share: f64, count: usize) -> [Option<usize>; 2] {
    let doubt = (1.0 - CONFIDENCE) / 2.0;
    // The lower end x_(l+1) is above the quantile if at most l draws are below it. Finds the largest l for which that is unlikely.
    let is_unlikely = |l: usize| at_most(l, count, share) <= doubt;
    let first = partition(count, is_unlikely);
    let low = first.checked_sub(1);
    // The upper end x_(u+1) is at most the quantile if at least u + 1 draws are below it: 1 - P(at most u).
    let is_likely = |u: usize| 1.0 - at_most(u, count, share) > doubt;
    let high = partition(count, is_likely);
    [low, (high < count).then_some(high)]
}

/// The first number below `count` for which a condition is false, by bisection. The condition must be true before and false after it.
fn partition(count: usize, holds: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (0, count);
    while low < high {
        let middle = low + (high - low) / 2;
        if holds(middle) { low = middle + 1 } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_median_is_that_of_the_tables() {
        // Binomial with 1/2: of 10 draws P(at most 1) = 11/1024 = 0.0107, P(at most 2) = 56/1024 = 0.0547. So from the second to the ninth.
        assert_eq!(order_statistics(0.5, 10), [Some(1), Some(8)]);
        // Of 5 draws P(none) = 1/32 = 0.031: there is no interval.
        assert_eq!(order_statistics(0.5, 5), [None, None]);
        // The largest of 59 draws is above the quantile of 95 % with a probability of 95.15 %. For 97.5 % it takes 72 draws: 0.95^72 = 0.0249.
        assert_eq!(order_statistics(0.95, 71)[1], None);
        assert_eq!(order_statistics(0.95, 72)[1], Some(71));
    }

    #[test]
    fn intervals_hold_the_true_quantile_as_often_as_they_say() {
        let mut random = rsm_fit::random::Random::new(3);
        for share in [0.05, 0.5, 0.95] {
            let mut held = 0;
            for _ in 0..2000 {
                let mut values: Vec<f64> = (0..200).map(|_| random.share()).collect();
                values.sort_by(f64::total_cmp);
                let [Some(low), Some(high)] = order_statistics(share, 200) else { panic!("200 are enough") };
                held += usize::from(values[low] <= share && share <= values[high]);
            }
            // The coverage is at least 95 %; the steps of a binomial of 200 add at most 2 %. Three standard deviations of 2000 trials are 1.5 %.
            let rate = held as f64 / 2000.0;
            assert!((0.935..0.99).contains(&rate), "{share}: {rate}");
        }
    }

    #[test]
    fn quantiles_lie_between_runs() {
        assert_eq!(quantile(&[1.0, 2.0, 4.0, 8.0, 16.0], 0.5), 4.0);
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.75), 3.0);
        assert_eq!(quantile(&[7.0], 0.99), 7.0);
    }
}
