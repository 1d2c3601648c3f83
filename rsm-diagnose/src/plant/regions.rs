//! The energy of the error by operating region and by record.
//!
//! In: simulations before and after, along the same records. Out: mean squared errors by region, and the regions whose share of the error exceeds
//! their share of the rows. Energies are in units of the noise, and the energy of the noise is subtracted.

use super::noise::NoiseFloor;
use super::quantities::{Classes, Quantity};
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_core::order;
use rsm_sim::kind::OUTPUTS;

/// A region and its share of the error.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The output with the error, by its place in the plant.
    pub output: usize,
    /// The quantity that is divided: "speed", "frequency", "record"; "output" for the whole output.
    pub quantity: String,
    /// The region in words, with numbers and units.
    pub region: String,
    /// The region's share of the squared error above the noise, of all outputs in units of their noise.
    pub share_of_error: f64,
    /// The region's share of the squared error of this output above the noise.
    pub share_of_output: f64,
    /// The region's share of the rows (or of the octaves, or of the lines of a spectrum).
    pub share_of_rows: f64,
}

/// The error of one output in one region, before and after.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorSlice {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The quantity of which the region is a part.
    pub quantity: String,
    /// The region.
    pub region: String,
    /// The number of rows of the output in it.
    pub rows: usize,
    /// Share of the output's rows.
    pub share_of_rows: f64,
    /// Mean squared error of the first simulation over the variance of the noise: 1 is noise.
    pub before: f64,
    /// The same of the second simulation.
    pub after: f64,
    /// The standard deviation of such a ratio if there is only noise.
    pub scatter: f64,
}

/// A region is reported if its share of the error is this many times its share of the rows.
pub const STANDS_OUT: f64 = 1.3;

/// An error counts if it exceeds this many standard deviations of the noise energy. About fifty regions are tested; a normal variable exceeds four
/// standard deviations in any of them once in 600 times.
pub const SIGNIFICANT: f64 = 4.0;

/// The largest number of quantities reported for an output.
const QUANTITIES: usize = 5;

/// Standard deviation of the mean square of n = `rows` noise values, over the variance of the noise. With a correlation r from row to row it is
/// sqrt(2/n (1 + r^2)/(1 - r^2)) (M. S. Bartlett, 1946).
#[must_use]
pub fn scatter(floor: &NoiseFloor, rows: usize) -> f64 {
    let square = floor.correlation * floor.correlation;
    (2.0 / rows.max(1) as f64 * (1.0 + square) / (1.0 - square)).sqrt()
}

/// The errors of all outputs in all classes. The whole output comes first.
#[must_use]
pub fn slices(
    whitened: &WhitenedResiduals,
    before: &[Simulated],
    after: &[Simulated],
    quantities: &[Quantity],
) -> Vec<ErrorSlice> {
    let mut classes = vec![Classes {
        quantity: "output".to_string(),
        names: vec!["everywhere".to_string()],
        of: whitened.records.iter().map(|it| vec![0; it.record.rows()]).collect(),
    }];
    classes.extend(quantities.iter().filter_map(Quantity::classes));
    if whitened.records.len() > 1 {
        classes.push(Classes {
            quantity: "record".to_string(),
            names: whitened.records.iter().map(|it| format!("record {}", name_of(&it.record.file))).collect(),
            of: whitened.records.iter().enumerate().map(|(k, it)| vec![k; it.record.rows()]).collect(),
        });
    }
    let mut list = Vec::new();
    for output in 0..whitened.floors.len() {
        let floor = &whitened.floors[output];
        let mut all = 0;
        for group in &classes {
            let mut sums = vec![(0_usize, 0.0, 0.0); group.names.len()];
            for (record, prepared) in whitened.records.iter().enumerate() {
                let Some(k) = prepared.outputs.iter().position(|it| *it == output) else { continue };
                let measured = prepared.measured(k);
                for (row, used) in prepared.used[k].iter().enumerate() {
                    if *used {
                        let sum = &mut sums[group.of[record][row]];
                        let off = |simulated: &[Simulated]| ((measured[row] - simulated[record][k][row]) / floor.sd).powi(2);
                        *sum = (sum.0 + 1, sum.1 + off(before), sum.2 + off(after));
                    }
                }
            }
            if group.quantity == "output" {
                all = sums[0].0;
            }
            for (name, (rows, before, after)) in group.names.iter().zip(sums) {
                // With fewer rows, the scatter of a mean square is more than a third.
                if rows >= 20 {
                    list.push(ErrorSlice {
                        output,
                        quantity: group.quantity.clone(),
                        region: name.clone(),
                        rows,
                        share_of_rows: rows as f64 / all.max(1) as f64,
                        before: before / rows as f64,
                        after: after / rows as f64,
                        scatter: scatter(floor, rows),
                    });
                }
            }
        }
    }
    list
}

/// A record's file without its folder.
#[must_use]
pub fn name_of(file: &str) -> String {
    std::path::Path::new(file).file_name().map_or(file.to_string(), |name| name.to_string_lossy().into_owned())
}

/// One of the two simulations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The first.
    Before,
    /// The second.
    After,
}

impl ErrorSlice {
    /// The mean squared error of one side, over the variance of the noise.
    #[must_use]
    pub fn ratio(&self, side: Side) -> f64 {
        if side == Side::Before { self.before } else { self.after }
    }

    /// The error of one side above the noise, summed over its rows; 0 if it may be chance.
    #[must_use]
    pub fn excess(&self, side: Side) -> f64 {
        let beyond = self.ratio(side) - 1.0;
        if beyond > SIGNIFICANT * self.scatter { beyond * self.rows as f64 } else { 0.0 }
    }
}

/// The error above the noise of each output, and the sum over all outputs.
#[must_use]
pub fn totals(slices: &[ErrorSlice], side: Side) -> ([f64; OUTPUTS], f64) {
    let mut each = [0.0; OUTPUTS];
    for slice in slices.iter().filter(|slice| slice.quantity == "output") {
        each[slice.output] = slice.excess(side);
    }
    (each, each.iter().sum())
}

/// The regions in which a simulation is wrong: each output as a whole, then the most informative region of each quantity. `spectral` are regions from
/// a spectrum. Sorted by share, the largest first; empty if the error is noise only.
#[must_use]
pub fn regions(slices: &[ErrorSlice], spectral: &[Region], side: Side) -> Vec<Region> {
    let (each, all) = totals(slices, side);
    let mut list = Vec::new();
    for (output, own) in each.iter().enumerate().filter(|(_, own)| **own > 0.0) {
        let mut by_information: Vec<(f64, Region)> = Vec::new();
        for slice in slices.iter().filter(|slice| slice.output == output) {
            let share = (slice.excess(side) / own).min(1.0);
            let region = Region {
                output,
                quantity: slice.quantity.clone(),
                region: slice.region.clone(),
                share_of_error: share * own / all,
                share_of_output: share,
                share_of_rows: slice.share_of_rows,
            };
            if slice.quantity == "output" {
                list.push(region);
            } else if share > STANDS_OUT * slice.share_of_rows {
                by_information.push((information(share, slice.share_of_rows), region));
            }
        }
        order::descending(&mut by_information, |it| it.0);
        let mut quantities: Vec<&str> = Vec::new();
        for (_, region) in &by_information {
            if quantities.len() < QUANTITIES && !quantities.contains(&region.quantity.as_str()) {
                quantities.push(&region.quantity);
                list.push(region.clone());
            }
        }
        list.extend(spectral.iter().filter(|region| region.output == output).cloned());
    }
    order::descending(&mut list, |it| it.share_of_error);
    list
}

/// The information of a region: its part of the divergence between the distributions of the error and of the rows (S. Kullback, R. A. Leibler, 1951).
fn information(error: f64, rows: f64) -> f64 {
    if error > 0.0 { error * (error / rows.max(f64::MIN_POSITIVE)).ln() } else { 0.0 }
}

/// The most informative regions, weighted by the share of their output in the whole error. Whole outputs and whole records are left out.
#[must_use]
pub fn most_informative(regions: &[Region], count: usize) -> Vec<Region> {
    let mut list: Vec<Region> =
        regions.iter().filter(|it| it.quantity != "output" && it.quantity != "record").cloned().collect();
    let weight = |it: &Region| {
        let share = it.share_of_output.max(f64::MIN_POSITIVE);
        information(share, it.share_of_rows) * it.share_of_error / share
    };
    order::descending(&mut list, |it| weight(it));
    list.truncate(count);
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slice(quantity: &str, region: &str, rows: usize, before: f64) -> ErrorSlice {
        let floor = NoiseFloor::white(1.0);
        ErrorSlice {
            output: 0,
            quantity: quantity.to_string(),
            region: region.to_string(),
            rows,
            share_of_rows: rows as f64 / 1000.0,
            before,
            after: 1.0,
            scatter: scatter(&floor, rows),
        }
    }

    #[test]
    fn the_region_with_the_error_is_named_with_its_share_and_noise_with_nothing() {
        // 1000 rows at 3 times the noise's energy: 2000 beyond; 200 of them at 9 times, 1600 beyond: 80 %.
        let list = [
            slice("output", "everywhere", 1000, 3.0),
            slice("speed", "slow", 200, 9.0),
            slice("speed", "fast", 800, 1.5),
            slice("load", "light", 500, 3.1),
            slice("load", "heavy", 500, 2.9),
        ];
        let found = regions(&list, &[], Side::Before);
        let words: Vec<(&str, f64)> = found.iter().map(|it| (it.region.as_str(), it.share_of_error)).collect();
        assert_eq!(words, [("everywhere", 1.0), ("slow", 0.8)]);
        assert_eq!(regions(&list, &[], Side::After), vec![]);
    }

    #[test]
    fn correlated_noise_scatters_more() {
        // (1 + 0.64)/(1 - 0.64) = 4.5556: the root of it times sqrt(2/50).
        let floor = NoiseFloor { correlation: 0.8, ..NoiseFloor::white(2.0) };
        assert!((scatter(&floor, 50) - 0.2 * 4.555555555555555_f64.sqrt()).abs() < 1e-12);
    }
}
