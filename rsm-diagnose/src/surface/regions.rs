//! The squared error of a surface by region.
//!
//! In: a sample, measured minus computed (by the nominal file or after the causes), the rows that count. Out: regions (a third of an input's range, a
//! third of the run order, a level of a further column). Regions with more error than their share of rows come first. Names no cause.

use super::sample::Sample;
use rsm_core::order;

/// A region of the runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The region in words.
    pub region: String,
    /// Its share of the squared error.
    pub share_of_error: f64,
    /// Its share of the runs.
    pub share_of_rows: f64,
}

/// A region is named if its share of the error is this many times its share of the runs. With ten or more runs, noise alone scatters by less.
const CONCENTRATED: f64 = 1.25;

/// The largest number of named regions.
const MOST_REGIONS: usize = 6;

/// The regions.
pub fn regions(sample: &Sample, residual: &[f64], kept: &[usize]) -> Vec<Region> {
    let total: f64 = kept.iter().map(|row| residual[*row] * residual[*row]).sum();
    if total <= 0.0 || kept.is_empty() {
        return Vec::new();
    }
    let mut found = Vec::new();
    let mut add = |region: String, inside: &dyn Fn(usize) -> bool| {
        let rows: Vec<usize> = kept.iter().copied().filter(|row| inside(*row)).collect();
        if rows.is_empty() || rows.len() == kept.len() {
            return;
        }
        let square: f64 = rows.iter().map(|row| residual[*row] * residual[*row]).sum();
        found.push(Region { region, share_of_error: square / total, share_of_rows: rows.len() as f64 / kept.len() as f64 });
    };
    for (input, column) in sample.inputs.iter().zip(&sample.points) {
        let [low, high] = input.range;
        for third in 0..3 {
            let at = |k: i32| low + (high - low) * f64::from(k) / 3.0;
            let (from, to) = (at(third), at(third + 1));
            let words = format!("{} from {} to {} {}", input.name, short(from), short(to), input.unit);
            // Readings beyond the range, from a faulty sensor, belong to the outer thirds.
            add(words, &|row| (column[row] >= from || third == 0) && (column[row] < to || third == 2));
        }
    }
    for third in 0..3 {
        let rows = sample.rows();
        let (from, to) = (rows * third / 3, rows * (third + 1) / 3);
        let words = ["first third of the runs", "middle third of the runs", "last third of the runs"][third];
        add(words.to_string(), &|row| (from..to).contains(&row));
    }
    for extra in &sample.extras {
        if let Some((names, of)) = &extra.levels {
            for (level, name) in names.iter().enumerate() {
                add(format!("{} {name}", extra.name), &|row| of[row] == level);
            }
        }
    }
    let weight = |it: &Region| it.share_of_error / it.share_of_rows;
    found.retain(|it| weight(it) >= CONCENTRATED);
    order::descending(&mut found, |it| weight(it));
    found.truncate(MOST_REGIONS);
    found
}

/// Four digits are enough for the bound of a region.
fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}
