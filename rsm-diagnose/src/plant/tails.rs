//! Noise with heavy tails: a reading far from its neighbours gets the weight of Student's t distribution.
//!
//! In: the residuals of the outputs. Out: the distribution of the noise of each output with heavy tails, and readings in which each outlier is moved
//! towards its neighbours, so that a least squares fit solves the likelihood equations of Student's t (pseudo-values; P. J. Huber, "Robust
//! statistics", 1981, section 7.8). Later steps then see noise of one size, with the variance of the best estimate, so costs, thresholds and
//! intervals stay valid (`outlier_correction.rs`). Normal noise is not changed. A reading is compared with its neighbours, not with the simulation
//! alone, so structure that lasts some rows is no outlier. If the noise is correlated from row to row, its innovations are used: each reading minus
//! the prediction from the corrected reading before it.

use super::noise::NoiseFloor;
use crate::engine::significance::median;
use rsm_core::order;
use statrs::function::gamma::ln_gamma;

/// Rows on either side that give the expected value of a row: outliers do not change their median.
const NEIGHBOURS: usize = 4;

/// The tested degrees of freedom. Above ten, least squares loses less than 4 % of the information, 3 f/((f + 3)(f - 2)) of it (R. A. Fisher, 1922).
/// Larger values only show whether there are tails at all.
const DEGREES_OF_FREEDOM: [f64; 12] = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, NEARLY_NORMAL, 14.0, 20.0, 30.0];

/// With this many degrees of freedom or more, tails are ignored.
const NEARLY_NORMAL: f64 = 10.0;

/// With fewer rows, the outermost fiftieth is too small for the tests.
const LEAST_ROWS: usize = 2000;

/// Twice the log likelihood ratio that tails must reach. Chi squared with two degrees of freedom (scale and freedom) exceeds 40 twice in 10^9 cases.
/// Heavy-tailed noise is far above this limit, and normal noise must not be changed.
const LEAST_RATIO_OF_TAILS: f64 = 40.0;

/// The share of outermost rows that are tested for clusters: one in fifty.
const OUTERMOST: f64 = 0.02;

/// Rows within which a cluster is counted.
const CLUSTER_ROWS: usize = 8;

/// How many times the chance frequency of clusters is allowed. Independent noise has no clusters; slow noise with tails has up to twice the chance
/// frequency. Contacts, ripples and noise in only some part of a record have ten times and more.
const TIMES_CHANCE: f64 = 3.0;

/// The allowed median deviation of the rows beside the outermost ones, relative to all rows. An outlier is alone; a corner or a bend that the
/// simulation misses is not. For forty rows with two neighbours each, this median scatters by a seventh. Slow noise with tails has 1.2.
const BESIDE_OUTERMOST: f64 = 1.6;

/// The share of readings equal to the one before from which a sensor is coarse. Its readings are one step off or none, which is no tail.
const REPEATS: f64 = 0.02;

/// The median of |x| for a standard normal x.
const MEDIAN_SIZE: f64 = 0.6745;

/// A reading counts as an outlier in the report beyond this many scales; of normal noise that is one in 16,000.
const OUTLYING: f64 = 4.0;

/// The number of passes in which outliers of earlier rows are replaced. The first finds single outliers, the next ones find neighbouring outliers.
const PASSES: usize = 4;

/// Iterations of the scale. Each reduces the error by at least the factor f/(f + 3).
const ROUNDS: usize = 60;

/// The residual of an output in one record.
#[derive(Debug, Clone)]
pub struct OutputResidual<'a> {
    /// Readings.
    pub measured: &'a [f64],
    /// Their residuals.
    pub left: &'a [f64],
    /// Rows that count.
    pub used: &'a [bool],
    /// Rows that do not count because they were taken for jumps.
    pub jumps: Vec<usize>,
}

impl OutputResidual<'_> {
    fn with_jumps(&self) -> Vec<bool> {
        let mut used = self.used.to_vec();
        self.jumps.iter().for_each(|row| used[*row] = true);
        used
    }
}

/// Readings, their residuals, and which rows count.
type Used<'a> = (&'a [f64], &'a [f64], &'a [bool]);

/// The heavy-tailed distribution of an output's noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tails {
    /// Degrees of freedom of Student's t.
    pub freedom: f64,
    /// Its scale divided by the standard deviation from the median in a record, because records may have different noise.
    pub scale: f64,
    /// The mean slope of the influence function over the deviations.
    pub slope: f64,
    /// The share of rows more than four scales away from their neighbours.
    pub outlying: f64,
    /// The correlation of the noise from row to row, without outliers.
    pub correlation: f64,
}

impl Tails {
    /// A deviation after the correction, in scales.
    fn corrected_deviation(&self, deviation: f64) -> f64 {
        deviation / (1.0 + deviation * deviation / self.freedom) / self.slope
    }

    /// The distribution from the residuals of an output, one list for each record: readings, residuals, rows that count, rows left out as jumps.
    /// `None` if there are no significant heavy tails. Light tails are ignored, except if jumps were left out: without its outermost part, a
    /// distribution looks lighter than it is. If the distribution with the jumps is heavy, the one without them is used, however light. Jumps in
    /// normal noise are faults of single readings and no sign of tails.
    #[must_use]
    pub fn found(lists: &[OutputResidual<'_>]) -> Option<Tails> {
        let rest: Vec<Used<'_>> = lists.iter().map(|it| (it.measured, it.left, it.used)).collect();
        let correlation = correlation(&rest);
        let law = Tails::likely(&rest, correlation)?;
        if law.freedom < NEARLY_NORMAL {
            return Some(law);
        }
        let counts: Vec<Vec<bool>> = lists.iter().map(OutputResidual::with_jumps).collect();
        let all: Vec<Used<'_>> = lists.iter().zip(&counts).map(|(it, used)| (it.measured, it.left, used.as_slice())).collect();
        let heavy = lists.iter().any(|it| !it.jumps.is_empty())
            && Tails::likely(&all, correlation).is_some_and(|all| all.freedom < NEARLY_NORMAL);
        heavy.then_some(law)
    }

    /// The most likely distribution, if the tails are significant.
    fn likely(lists: &[Used<'_>], correlation: f64) -> Option<Tails> {
        let mut all = Vec::new();
        let mut beside_outermost = Vec::new();
        let (mut together, mut places, mut outermost) = (0, 0, 0);
        for (measured, left, used) in lists {
            let repeats = measured.windows(2).filter(|pair| pair[0] == pair[1]).count();
            let off = off_expected(left, used, correlation);
            let size = deviation(&off)?;
            if repeats as f64 > REPEATS * measured.len() as f64 || size <= 0.0 {
                return None;
            }
            let off: Vec<Option<f64>> = off.iter().map(|it| it.map(|off| off / size)).collect();
            all.extend(off.iter().flatten());
            let mut sizes: Vec<f64> = off.iter().flatten().map(|it| it.abs()).collect();
            order::sort(&mut sizes);
            let limit = sizes[((1.0 - OUTERMOST) * (sizes.len() - 1) as f64) as usize];
            let is_out = |row: usize| off[row].is_some_and(|it| it.abs() > limit);
            for row in (0..off.len()).filter(|row| is_out(*row)) {
                outermost += 1;
                let near = row + 1..off.len().min(row + 1 + CLUSTER_ROWS);
                places += near.clone().filter(|row| off[*row].is_some()).count();
                together += near.filter(|row| is_out(*row)).count();
                let beside = [row.wrapping_sub(1), row + 1].map(|row| off.get(row).copied().flatten());
                beside_outermost.extend(beside.into_iter().flatten().map(f64::abs));
            }
        }
        if all.len() < LEAST_ROWS {
            return None;
        }
        // The number expected by chance, plus four standard deviations of a count.
        let chance = outermost as f64 / all.len() as f64 * places as f64;
        if together as f64 > TIMES_CHANCE * chance + 4.0 * chance.sqrt() {
            return None;
        }
        if median(&mut beside_outermost) > BESIDE_OUTERMOST * MEDIAN_SIZE {
            return None;
        }
        let n = all.len() as f64;
        let normal = 0.5 * n * (1.0 + (all.iter().map(|it| it * it).sum::<f64>() / n).ln() + std::f64::consts::TAU.ln());
        let laws = DEGREES_OF_FREEDOM.map(|freedom| (freedom, scale(&all, freedom)));
        let (freedom, scale) = laws.into_iter().min_by(|a, b| cost(&all, *a).total_cmp(&cost(&all, *b)))?;
        if 2.0 * (normal - cost(&all, (freedom, scale))) < LEAST_RATIO_OF_TAILS {
            return None;
        }
        let slope = all.iter().map(|it| (it / scale).powi(2) / freedom).map(|u| (1.0 - u) / ((1.0 + u) * (1.0 + u)));
        let slope = slope.sum::<f64>() / n;
        let outlying = all.iter().filter(|it| it.abs() > OUTLYING * scale).count() as f64 / n;
        (slope > 0.0).then_some(Tails { freedom, scale, slope, outlying, correlation })
    }

    /// The readings of a record with outliers moved towards their neighbours. `left` is the residual of a simulation.
    pub(super) fn corrected_readings(&self, measured: &[f64], left: &[f64], used: &[bool], law: &NoiseFloor) -> Vec<f64> {
        let (even, uneven) = scaled_to_uniform(law, measured, left);
        let off = off_expected(&even, used, self.correlation);
        let Some(size) = deviation(&off).filter(|size| *size > 0.0) else { return measured.to_vec() };
        let scale = self.scale * size;
        // Through the correlation, a corrected innovation also changes the following rows; after whitening they are the corrected innovations.
        let mut follows = 0.0;
        let mut corrected = measured.to_vec();
        for (row, value) in corrected.iter_mut().enumerate() {
            follows *= self.correlation;
            if let Some(off) = off[row] {
                let accepted = limited(off, size);
                follows += scale * self.corrected_deviation(off / scale) - accepted;
                *value += uneven[row] * (accepted - off + follows);
            }
        }
        corrected
    }
}

/// The residual scaled to uniform noise if the noise grows with the reading, and the divisor of each row.
pub(super) fn scaled_to_uniform(floor: &NoiseFloor, measured: &[f64], left: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut even, mut units) = (left.to_vec(), vec![1.0; left.len()]);
    floor.scale_to_uniform(measured, &mut even);
    floor.scale_to_uniform(measured, &mut units);
    (even, units.into_iter().map(|unit| 1.0 / unit).collect())
}

/// Each row minus the median of the rows beside it; `None` if it does not count or has no neighbours that count.
pub(super) fn off_neighbours(left: &[f64], used: &[bool]) -> Vec<Option<f64>> {
    let mut beside = Vec::with_capacity(2 * NEIGHBOURS);
    (0..left.len())
        .map(|row| {
            if !used[row] {
                return None;
            }
            beside.clear();
            let near = row.saturating_sub(NEIGHBOURS)..(row + NEIGHBOURS + 1).min(left.len());
            beside.extend(near.filter(|at| *at != row && used[*at]).map(|at| left[at]));
            (beside.len() >= NEIGHBOURS).then(|| left[row] - median(&mut beside))
        })
        .collect()
}

/// Each row minus its expected value, from the rows beside it and, for correlated noise, from the row before. The innovation of a row is compared
/// with the innovations beside it. An outlier contains no information about the next row, so its expected value is used there. After a gap only the
/// rows beside it are used; up to a correlation of 0.8 the deviation is then the same within a tenth.
fn off_expected(left: &[f64], used: &[bool], correlation: f64) -> Vec<Option<f64>> {
    let plain = off_neighbours(left, used);
    if correlation == 0.0 {
        return plain;
    }
    let counts: Vec<bool> = (0..left.len()).map(|row| row > 0 && used[row] && used[row - 1]).collect();
    let mut off = plain.clone();
    for _ in 0..PASSES {
        let before = without_outliers(left, &off);
        let new = |row: usize| if counts[row] { left[row] - correlation * before[row - 1] } else { 0.0 };
        let new: Vec<f64> = (0..left.len()).map(new).collect();
        off = off_neighbours(&new, &counts);
        off.iter_mut().zip(&plain).zip(&counts).filter(|(_, counts)| !**counts).for_each(|((off, plain), _)| *off = *plain);
    }
    off
}

/// The residual with outliers replaced by their expected values.
fn without_outliers(left: &[f64], off: &[Option<f64>]) -> Vec<f64> {
    let size = deviation(off).unwrap_or(0.0);
    left.iter().zip(off).map(|(left, off)| off.map_or(*left, |off| left - off + limited(off, size))).collect()
}

/// A deviation with outliers limited.
fn limited(off: f64, size: f64) -> f64 {
    if off.abs() > OUTLYING * size { 0.0 } else { off }
}

/// The correlation of the noise from row to row, without outliers.
fn correlation(lists: &[Used<'_>]) -> f64 {
    let without = |(_, left, used): &Used<'_>| without_outliers(left, &off_neighbours(left, used));
    let without: Vec<Vec<f64>> = lists.iter().map(without).collect();
    let without: Vec<(&[f64], &[bool])> = without.iter().zip(lists).map(|(left, it)| (left.as_slice(), it.2)).collect();
    // A negative correlation means no slow noise that medians could miss.
    NoiseFloor::estimate(&without).map_or(0.0, |floor| floor.correlation.max(0.0))
}

/// The standard deviation estimated from the median of absolute deviations.
pub(super) fn deviation(off: &[Option<f64>]) -> Option<f64> {
    let mut sizes: Vec<f64> = off.iter().flatten().map(|it| it.abs()).collect();
    (!sizes.is_empty()).then(|| median(&mut sizes) / MEDIAN_SIZE)
}

/// The scale of Student's t by iterated weights (A. P. Dempster, N. M. Laird, D. B. Rubin, 1980).
fn scale(values: &[f64], freedom: f64) -> f64 {
    let mut square = 1.0;
    for _ in 0..ROUNDS {
        let weighted = values.iter().map(|it| (freedom + 1.0) * it * it / (freedom + it * it / square)).sum::<f64>();
        let next = weighted / values.len() as f64;
        let done = (next / square - 1.0).abs() < 1e-6;
        square = next;
        if done {
            break;
        }
    }
    square.sqrt()
}

/// The negative log likelihood of Student's t.
fn cost(values: &[f64], (freedom, scale): (f64, f64)) -> f64 {
    let level =
        ln_gamma(0.5 * freedom) - ln_gamma(0.5 * (freedom + 1.0)) + 0.5 * (freedom * std::f64::consts::PI).ln() + scale.ln();
    let tail = |value: &f64| 0.5 * (freedom + 1.0) * ((value / scale).powi(2) / freedom).ln_1p();
    values.len() as f64 * level + values.iter().map(tail).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::super::checks::jumps;
    use super::super::{Options, Verdict, axis_under_steps, diagnose};
    use super::*;
    use rsm_fit::random::Random;
    use rsm_sim::record::Record;

    /// Student's t with this many degrees of freedom, of scale one.
    fn student(random: &mut Random, freedom: usize) -> f64 {
        let chi: f64 = (0..freedom).map(|_| random.normal().powi(2)).sum();
        random.normal() / (chi / freedom as f64).sqrt()
    }

    fn found(rows: usize, mut noise: impl FnMut(usize) -> f64) -> Option<Tails> {
        let left: Vec<f64> = (0..rows).map(&mut noise).collect();
        let measured: Vec<f64> = left.iter().enumerate().map(|(k, left)| 20.0 * (k as f64 / 150.0).sin() + left).collect();
        Tails::found(&[OutputResidual { measured: &measured, left: &left, used: &vec![true; rows], jumps: Vec::new() }])
    }

    #[test]
    fn tails_are_found_and_normal_noise_has_none() {
        let mut random = Random::new(3);
        let law = found(6000, |_| 0.2 * student(&mut random, 3)).expect("three degrees of freedom");
        assert!((2.0..=5.0).contains(&law.freedom) && law.outlying > 0.01, "{law:?}");
        let law = found(6000, |_| if random.uniform() < 0.01 { 4.0 } else { 0.2 } * random.normal()).expect("outliers");
        assert!(law.freedom < 10.0, "{law:?}");
        for _ in 0..100 {
            assert_eq!(found(2000, |_| random.normal()), None);
        }
        // Slow noise, two sizes of noise, a wave: none has tails.
        let mut last = 0.0;
        let mut slow = || {
            last = 0.8 * last + 0.6 * random.normal();
            last
        };
        assert_eq!(found(4000, |_| slow()), None);
        assert_eq!(found(4000, |k| if k < 2000 { 1.0 } else { 1.5 } * random.normal()), None);
        assert_eq!(found(4000, |k| 3.0 * (k as f64 / 3.0).sin() + random.normal()), None);
    }

    #[test]
    fn tails_are_found_on_noise_that_follows_itself_and_its_colour_stays() {
        let mut random = Random::new(8);
        for correlation in [0.4, 0.6, 0.8] {
            let mut slow = || {
                let mut last = random.normal();
                (0..6000)
                    .map(|_| {
                        last = correlation * last + (1.0_f64 - correlation * correlation).sqrt() * random.normal();
                        last
                    })
                    .collect::<Vec<f64>>()
            };
            // Normal noise has none, whatever its colour.
            for _ in 0..20 {
                let normal = slow();
                assert_eq!(found(6000, |k| normal[k]), None, "{correlation}");
            }
            let normal = slow();
            // A reading in a hundred is off by 20 times the noise, and a structure ten times as large as the noise lies under all.
            let under = |k: usize| 10.0 * (k as f64 / 300.0).sin();
            let mut left = normal.clone();
            left.iter_mut().step_by(100).for_each(|it| *it += 20.0);
            left.iter_mut().enumerate().for_each(|(k, it)| *it += under(k));
            let law = found(6000, |k| left[k]).unwrap_or_else(|| panic!("{correlation}"));
            // Four of the upper band's errors, the structure being there: 0.043 at 0.6.
            assert!((law.correlation - correlation).abs() < 0.17 && law.freedom < 10.0, "{correlation}: {law:?}");
            let corrected = law.corrected_readings(&left, &left, &vec![true; 6000], &NoiseFloor::white(1.0));
            let of_noise = |noise: &[f64]| {
                let square = noise.iter().map(|it| it * it).sum::<f64>() / 6000.0;
                (square, noise.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / 6000.0 / square)
            };
            let corrected: Vec<f64> = corrected.iter().enumerate().map(|(k, it)| it - under(k)).collect();
            let ((before, follows), (after, then)) = (of_noise(&normal), of_noise(&corrected));
            // A law of three to five degrees takes a sixth of what normal noise says, and 60 of 6000 rows are gone; 3 % by chance, twice.
            assert!(
                (after / before - 1.0).abs() < 0.25 && (then - follows).abs() < 0.05,
                "{correlation}: {before} {after} {follows} {then}"
            );
        }
    }

    #[test]
    fn jumps_belong_to_tails_where_the_other_readings_have_some() {
        let mut random = Random::new(9);
        let law = |left: &[f64], jumps: Vec<usize>| {
            let mut used = vec![true; left.len()];
            jumps.iter().for_each(|row| used[*row] = false);
            Tails::found(&[OutputResidual { measured: left, left, used: &used, jumps }])
        };
        // A reading in a hundred has 20 times the noise, which follows itself: most of those are left out as jumps, and the rest alone is nearly
        // normal.
        let mut last = 0.0;
        let mut slow = || {
            last = 0.8 * last + 0.6 * random.normal();
            if random.uniform() < 0.01 { 20.0 * last } else { last }
        };
        let left: Vec<f64> = (0..6000).map(|_| slow()).collect();
        let rows = jumps(&left);
        assert!(rows.len() > 30, "{}", rows.len());
        let rest = law(&left, rows).expect("outliers");
        assert!(rest.freedom >= NEARLY_NORMAL && (rest.correlation - 0.8).abs() < 0.05, "{rest:?}");
        // Six readings of a sensor that loses contact, in normal noise: faults, and no law.
        let mut left: Vec<f64> = (0..6000).map(|_| random.normal()).collect();
        left.iter_mut().skip(500).step_by(1000).for_each(|it| *it += 100.0);
        let rows = jumps(&left);
        assert_eq!((rows.len(), law(&left, rows)), (6, None));
    }

    #[test]
    fn what_comes_in_bunches_is_no_tail() {
        let mut random = Random::new(4);
        // A contact rings for twelve rows, once in two hundred.
        let ring = |k: usize| if k % 200 < 12 { 8.0 * (2.0 * k as f64).sin() } else { 0.0 };
        assert_eq!(found(6000, |k| ring(k) + random.normal()), None);
        // Corners of what a simulation misses, a hundred times as high as the noise.
        let corners = |k: usize| 30.0 * (k as f64 / 20.0).sin().asin();
        assert_eq!(found(6000, |k| corners(k) + random.normal()), None);
    }

    /// Over many draws the variance of the mean of corrected readings, times their number, and the mean of a slow wave that is in them.
    fn of_means(mut noise: impl FnMut() -> f64) -> (f64, f64) {
        let (rows, draws) = (2000, 200);
        let mut means = Vec::new();
        let mut waves = 0.0;
        for _ in 0..draws {
            let wave = |k: usize| (std::f64::consts::TAU * 5.0 * k as f64 / rows as f64).sin();
            let left: Vec<f64> = (0..rows).map(|k| wave(k) + noise()).collect();
            let used = vec![true; rows];
            // A record that holds few outliers by chance counts as normal.
            let law = Tails::found(&[OutputResidual { measured: &left, left: &left, used: &used, jumps: Vec::new() }]);
            let corrected =
                law.map_or(left.clone(), |law| law.corrected_readings(&left, &left, &used, &NoiseFloor::white(1.0)));
            means.push(corrected.iter().sum::<f64>() / rows as f64);
            waves += corrected.iter().enumerate().map(|(k, it)| 2.0 * wave(k) * it / rows as f64).sum::<f64>() / draws as f64;
        }
        (rows as f64 * means.iter().map(|it| it * it).sum::<f64>() / draws as f64, waves)
    }

    #[test]
    fn least_squares_on_tamed_readings_is_as_good_as_the_likelihood() {
        let mut random = Random::new(5);
        // The best there is: (f + 3)/(f + 1) of the squared scale, 1.5 for three degrees of freedom; the plain mean has f/(f - 2), which is 3. Two
        // hundred draws know a variance to 10 %, three of it.
        let (variance, wave) = of_means(|| student(&mut random, 3));
        assert!((1.05..1.95).contains(&variance) && (wave - 1.0).abs() < 0.02, "{variance} {wave}");
        // One reading in a hundred has 20 times the noise: 0.99 is the best, the plain mean has 5.
        let (variance, wave) = of_means(|| if random.uniform() < 0.01 { 20.0 } else { 1.0 } * random.normal());
        assert!((0.7..1.5).contains(&variance) && (wave - 1.0).abs() < 0.02, "{variance} {wave}");
    }

    #[test]
    fn a_cause_is_found_under_outliers_and_explains() {
        let nominal = axis_under_steps::file("mass = 0.01", "");
        let truth = axis_under_steps::file("mass = 0.01", &axis_under_steps::friction(0.5));
        let mut random = Random::new(6);
        let records: Vec<Record> = (0..6)
            .map(|number| {
                let mut record = axis_under_steps::whitened(&nominal, &truth, false).0.records[0].record.clone();
                record.file = format!("record {number}");
                for value in record.measured[0].as_mut().unwrap() {
                    *value += if random.uniform() < 0.01 { 2e-4 } else { 1e-5 } * random.normal();
                }
                record
            })
            .collect();
        let options = Options { threads: 2, progress: &|_| {} };
        let found = diagnose(&nominal, &records[..4], &records[4..], &options).unwrap();
        let kinds: Vec<&str> = found.entries().map(|cause| cause.kind).collect();
        assert_eq!((found.verdict, kinds), (Verdict::Explained, vec!["coulomb-friction"]), "{:?}", found.left);
        assert!(found.tails.len() == 1 && found.tails[0].1.outlying > 0.003, "{:?}", found.tails);
        // The deviation of the readings without outliers, and a tenth.
        assert!(found.noise[0].1 < 1.1e-5, "{:?}", found.noise);
        let force = &found.causes[0].parameters[0];
        assert!(force.low <= 0.5 && 0.5 <= force.high, "{force:?}");
    }
}
