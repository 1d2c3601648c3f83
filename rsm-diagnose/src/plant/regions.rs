//! The energy of the error by operating region and by record.
//!
//! In: simulations before and after, along the same records. Out: mean squared errors by region, and the regions that hold more of the error than of the rows.
//! Energies are in units of the noise, and the energy of the noise is subtracted.

use super::noise::Floor;
use super::quantities::{Classes, Quantity};
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_sim::kind::OUTPUTS;

/// A region with its share.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The output that is wrong, by its place in the plant.
    pub output: usize,
    /// The quantity of which it is a part: "speed", "frequency", "record"; "output" for all of an output.
    pub quantity: &'static str,
    /// Where, in words with numbers and units.
    pub region: String,
    /// Share of the squared error of all outputs beyond noise, in units of their noise.
    pub share_of_error: f64,
    /// Share of the squared error of this output beyond noise.
    pub share_of_output: f64,
    /// Share of the rows (of the octaves, of the lines of a spectrum).
    pub share_of_rows: f64,
}

/// The error of an output in a region, before and after.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The quantity of which the region is a part.
    pub quantity: &'static str,
    /// The region.
    pub region: String,
    /// Rows of the output in it.
    pub rows: usize,
    /// Share of the output's rows.
    pub share_of_rows: f64,
    /// Mean squared error of the first simulation over the noise's: 1 is noise.
    pub before: f64,
    /// Of the second.
    pub after: f64,
    /// Standard deviation of such a figure under noise alone.
    pub scatter: f64,
}

/// A region is worth a line when its share of the error is this many times its share of the rows.
pub const STANDS_OUT: f64 = 1.3;

/// An error counts from this many standard deviations of the noise's energy on: some fifty regions are looked at, and normal scatter passes four of them
/// once in 600 times.
pub const SIGNIFICANT: f64 = 4.0;

/// Quantities of an output that get a line.
const QUANTITIES: usize = 5;

/// Standard deviation of the mean square of `rows` values of the noise, over its own: with a correlation of r from row to row sqrt(2/n (1 + r^2)/(1 - r^2))
/// (M. S. Bartlett, 1946).
#[must_use]
pub fn scatter(floor: &Floor, rows: usize) -> f64 {
    let square = floor.correlation * floor.correlation;
    (2.0 / rows.max(1) as f64 * (1.0 + square) / (1.0 - square)).sqrt()
}

/// The errors of all outputs in all classes; the whole of an output first.
#[must_use]
pub fn slices(whitened: &WhitenedResiduals, before: &[Simulated], after: &[Simulated], quantities: &[Quantity]) -> Vec<Slice> {
    let mut classes = vec![Classes {
        quantity: "output",
        names: vec!["everywhere".to_string()],
        of: whitened.records.iter().map(|it| vec![0; it.record.rows()]).collect(),
    }];
    classes.extend(quantities.iter().filter_map(Quantity::classes));
    if whitened.records.len() > 1 {
        classes.push(Classes {
            quantity: "record",
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
                // Fewer rows than this have no mean square worth the name: its scatter is a third.
                if rows >= 20 {
                    list.push(Slice {
                        output,
                        quantity: group.quantity,
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

/// Which of the two simulations is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The first.
    Before,
    /// The second.
    After,
}

impl Slice {
    /// Its mean squared error over that of noise.
    #[must_use]
    pub fn ratio(&self, side: Side) -> f64 {
        if side == Side::Before { self.before } else { self.after }
    }

    /// Its error beyond noise, summed over its rows; 0 where chance may have made it.
    #[must_use]
    pub fn excess(&self, side: Side) -> f64 {
        let beyond = self.ratio(side) - 1.0;
        if beyond > SIGNIFICANT * self.scatter { beyond * self.rows as f64 } else { 0.0 }
    }
}

/// The error of each output beyond noise, and of all.
#[must_use]
pub fn totals(slices: &[Slice], side: Side) -> ([f64; OUTPUTS], f64) {
    let mut each = [0.0; OUTPUTS];
    for slice in slices.iter().filter(|slice| slice.quantity == "output") {
        each[slice.output] = slice.excess(side);
    }
    (each, each.iter().sum())
}

/// The lines that say where a simulation is wrong: each output as a whole, then the most telling region of each quantity. `spectral` are the lines that a
/// spectrum adds. The largest share first; empty where noise explains everything.
#[must_use]
pub fn regions(slices: &[Slice], spectral: &[Region], side: Side) -> Vec<Region> {
    let (each, all) = totals(slices, side);
    let mut list = Vec::new();
    for (output, own) in each.iter().enumerate().filter(|(_, own)| **own > 0.0) {
        let mut telling: Vec<(f64, Region)> = Vec::new();
        for slice in slices.iter().filter(|slice| slice.output == output) {
            let share = (slice.excess(side) / own).min(1.0);
            let region = Region {
                output,
                quantity: slice.quantity,
                region: slice.region.clone(),
                share_of_error: share * own / all,
                share_of_output: share,
                share_of_rows: slice.share_of_rows,
            };
            if slice.quantity == "output" {
                list.push(region);
            } else if share > STANDS_OUT * slice.share_of_rows {
                telling.push((information(share, slice.share_of_rows), region));
            }
        }
        telling.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut quantities: Vec<&str> = Vec::new();
        for (_, region) in &telling {
            if quantities.len() < QUANTITIES && !quantities.contains(&region.quantity) {
                quantities.push(region.quantity);
                list.push(region.clone());
            }
        }
        list.extend(spectral.iter().filter(|region| region.output == output).cloned());
    }
    list.sort_by(|a, b| b.share_of_error.total_cmp(&a.share_of_error));
    list
}

/// How much a region tells: its part of the divergence between where the error is and where the rows are (S. Kullback, R. A. Leibler, 1951).
fn information(error: f64, rows: f64) -> f64 {
    if error > 0.0 { error * (error / rows.max(f64::MIN_POSITIVE)).ln() } else { 0.0 }
}

/// The regions that tell most, weighed by how much of all error their output has. Whole outputs and records are no place in a plant.
#[must_use]
pub fn telling(regions: &[Region], count: usize) -> Vec<Region> {
    let mut list: Vec<Region> =
        regions.iter().filter(|it| it.quantity != "output" && it.quantity != "record").cloned().collect();
    let weight = |it: &Region| {
        let share = it.share_of_output.max(f64::MIN_POSITIVE);
        information(share, it.share_of_rows) * it.share_of_error / share
    };
    list.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    list.truncate(count);
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slice(quantity: &'static str, region: &str, rows: usize, before: f64) -> Slice {
        let floor = Floor::white(1.0);
        Slice {
            output: 0,
            quantity,
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
        let floor = Floor { correlation: 0.8, ..Floor::white(2.0) };
        assert!((scatter(&floor, 50) - 0.2 * 4.555555555555555_f64.sqrt()).abs() < 1e-12);
    }
}
