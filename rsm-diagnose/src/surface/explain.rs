//! Finds the combination of causes, outlying runs and noise that explains a sample.
//!
//! In: a sample, hypotheses, thresholds. Out: [`Explained`], the combination with the smallest -2 ln(likelihood) plus costs. Noise that grows looks
//! like outliers if it is assumed uniform, and correlated errors look like drift if they are assumed independent. So each noise model is one starting
//! point. From each, causes, outliers and noise are found in turn until they no longer change. Never uses holdout rows.

use super::choice::causes;
use super::explained::{Explained, Noise, refit, solved, space_of};
use super::hypotheses::Hypothesis;
use super::noise::{self, Growth};
use super::null::Thresholds;
use super::sample::Sample;
use super::whitening::{Shape, Space};
use crate::engine::columns::{Basis, dot, solve};
use crate::engine::significance::f_of;
use crate::engine::work::Work;

/// At most a tenth of the runs may be outliers. More are part of the process.
const MOST_OUTLIERS: f64 = 0.1;

/// With fewer degrees of freedom, noise models are not distinguished: two halves of the residuals have ten each, and their variances differ by a
/// factor of 6 by chance (F test, 0.5 %).
const LEAST_FREEDOM: usize = 20;

/// If this many candidates in a row are not outliers, no further ones are tested, because leaving them out no longer reduces the scatter.
const MOST_WITHOUT_OUTLIER: usize = 15;

/// Up to this many rows, outlying runs are removed one at a time, as in Rosner's test. With more rows, several are removed at a time, so that the
/// number of rounds, each a fit to all rows, stays the same.
const ONE_BY_ONE: usize = 400;

/// The largest number of rounds until causes, outliers and noise no longer change. If they cycle, the best round counts.
const TURNS: usize = 5;

/// The best explanation. If the work limit is reached, further noise models are not tried; uniform noise, the simplest, is the first.
pub(super) fn explain(sample: &Sample, hypotheses: &[Hypothesis], thresholds: &Thresholds, work: &Work<'_>) -> Explained {
    let mut best: Option<Explained> = None;
    let grown = Some(noise::growth(&plain(sample), &sample.nominal).0);
    let every: Vec<usize> = (0..sample.rows()).collect();
    let following = Some(noise::correlation(&plain(sample), &every).0);
    for variance_factor in variance_factors(sample) {
        for (growth, rho) in [(None, None), (grown, None), (None, following), (grown, following)] {
            let noise = Noise { growth, rho };
            if best.is_some() && !work.has_work_left() {
                break;
            }
            let found = from_noise(sample, hypotheses, thresholds, noise, variance_factor, work);
            if best.as_ref().is_none_or(|best| found.score < best.score) {
                best = Some(found);
            }
        }
    }
    best.expect("there are four kinds of noise")
}

/// The best explanation from one noise model. Large outliers can hide behind terms that imitate them, and a large cause can make good runs look like
/// outliers. So two starting points are tried.
pub(super) fn from_noise(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    noise: Noise,
    variance_factor: f64,
    work: &Work<'_>,
) -> Explained {
    let even = Explained {
        set: Vec::new(),
        outliers: Vec::new(),
        noise,
        variance_factor,
        score: f64::INFINITY,
        fitted: sample.nominal.clone(),
        scale: vec![1.0; sample.rows()],
    };
    let outlying = outliers(sample, &even, thresholds);
    let found = turns(sample, hypotheses, thresholds, even.clone(), work);
    if outlying.is_empty() || !work.has_work_left() {
        return found;
    }
    let other = turns(sample, hypotheses, thresholds, Explained { outliers: outlying, ..even }, work);
    if other.score < found.score { other } else { found }
}

/// The smallest variance ratio of the noise of the file's rows to that of the new rows; the largest is its inverse. Beyond these it is another
/// instrument, and the limit is used.
const LEAST_RATIO: f64 = 0.01;

/// Factors for the coefficient uncertainty. If the file does not give an uncertainty, two cases are tried and the likelihood decides: coefficients
/// fitted to as many rows as are new, or exact ones (a formula, a data sheet). If the file gives its noise, [`update_variance_factor`] uses that. The
/// first guesses are from the scatter of the data or, with few rows, from the noise of the file; and a tenth of it, because a file without some terms
/// counted these as noise.
pub(super) fn variance_factors(sample: &Sample) -> Vec<f64> {
    match (sample.sd_of_file, sample.rows_of_file) {
        (Some(_), _) if is_few(sample) => vec![1.0, 1.0 / LEAST_RATIO],
        (Some(old), _) => {
            let left = plain(sample);
            let freedom = left.len().saturating_sub(sample.terms.len() + 2).max(1) as f64;
            vec![ratio(old, (dot(&left, &left) / freedom).sqrt())]
        }
        (None, Some(_)) => vec![1.0],
        (None, None) => vec![1.0, 0.0],
    }
}

fn ratio(old: f64, new: f64) -> f64 {
    (old / new.max(f64::MIN_POSITIVE)).powi(2).clamp(LEAST_RATIO, 1.0 / LEAST_RATIO)
}

/// Updates the factor for the coefficient uncertainty from the noise that the set leaves.
fn update_variance_factor(sample: &Sample, now: &mut Explained) {
    let Some(old) = sample.sd_of_file else { return };
    let space = now.space(sample);
    let solved = solved(sample, &now.set, &space);
    let freedom = space.rows().saturating_sub(solved.rank).max(1) as f64;
    let mean_scale = now.scale.iter().map(|s| s * s).sum::<f64>() / now.scale.len() as f64;
    now.variance_factor = ratio(old, (dot(&solved.residual, &solved.residual) / freedom * mean_scale).sqrt());
}

/// Whether too few rows are left, beyond these unknowns, to estimate the noise.
fn is_few(sample: &Sample) -> bool {
    sample.rows() < sample.terms.len() + 2 + LEAST_FREEDOM
}

/// The residual after fitting other coefficients of the file's terms, a shift and a drift: a first estimate of the noise. An unexplained shift would
/// look like correlated errors, a gain like noise that grows. With few rows beyond these unknowns, the residual itself.
fn plain(sample: &Sample) -> Vec<f64> {
    let rows = sample.rows();
    let residual = sample.residual();
    if is_few(sample) {
        return residual;
    }
    let mut columns = sample.terms.clone();
    columns.push(vec![1.0; rows]);
    columns.push(sample.places.iter().map(|place| *place as f64).collect());
    solve(&columns, &residual).residual
}

/// How often the coefficient uncertainty and the noise are updated in turn. The variance of the file's rows changes that of the new rows only a
/// little.
const AGREEING: usize = 2;

fn turns(sample: &Sample, hypotheses: &[Hypothesis], thresholds: &Thresholds, start: Explained, work: &Work<'_>) -> Explained {
    let mut now = start;
    now.scale = scale(now.noise, &sample.nominal);
    let mut best: Option<Explained> = None;
    for _ in 0..TURNS {
        let entered = now.variance_factor.max(f64::MIN_POSITIVE);
        if best.is_some() && !work.has_work_left() {
            break;
        }
        now.set = causes(sample, hypotheses, thresholds, &now, work);
        for _ in 0..AGREEING {
            update_variance_factor(sample, &mut now);
        }
        refit(sample, &mut now);
        now.score = score(sample, thresholds, &now);
        let before = now.clone();
        if best.as_ref().is_none_or(|best| now.score < best.score) {
            best = Some(now.clone());
        }
        now.outliers = outliers(sample, &now, thresholds);
        refit(sample, &mut now);
        update_noise(sample, &mut now);
        let same_set = now.outliers == before.outliers;
        let close = |a: Option<f64>, b: Option<f64>| a.zip(b).is_none_or(|(a, b)| (a - b).abs() < 0.01);
        let exponent = |it: &Explained| it.noise.growth.map(Growth::exponent);
        let same_noise = close(now.noise.rho, before.noise.rho) && close(exponent(&now), exponent(&before));
        if same_set && same_noise && close(Some(now.variance_factor.max(f64::MIN_POSITIVE).ln()), Some(entered.ln())) {
            break;
        }
    }
    best.expect("there is at least one turn")
}

fn scale(noise: Noise, fitted: &[f64]) -> Vec<f64> {
    noise.growth.map_or_else(|| vec![1.0; fitted.len()], |growth| growth.scale(fitted))
}

/// -2 ln(likelihood) plus the costs of causes, outliers and noise. A row that is left out counts as one that fits exactly.
fn score(sample: &Sample, thresholds: &Thresholds, now: &Explained) -> f64 {
    let space = now.space(sample);
    let rows = sample.rows() as f64;
    let solved = solved(sample, &now.set, &space);
    let square = dot(&solved.residual, &solved.residual).max(f64::MIN_POSITIVE);
    let scales_left_out: f64 = now.outliers.iter().map(|row| 2.0 * now.scale[*row].ln()).sum();
    let width = |it: &Hypothesis| it.columns.len();
    let causes: f64 = now.set.iter().map(|it| thresholds.cost(width(it), space.rows()) + it.prior).sum();
    let freedom = (rows - now.set.iter().map(width).sum::<usize>() as f64 - 3.0).max(2.0);
    let f = f_of((thresholds.alpha_outliers / rows).ln(), 1.0, freedom);
    let outliers = now.outliers.len() as f64 * rows * (f / freedom).ln_1p();
    if !is_noise_proven(sample, thresholds, now) {
        return f64::INFINITY;
    }
    let noise = now.noise.growth.map_or(0.0, |_| thresholds.growth) + now.noise.rho.map_or(0.0, |_| thresholds.correlation);
    // Restricted likelihood (Patterson and Thompson 1971). Otherwise, with enough unknowns to fit some runs nearly exactly, a noise model that gives
    // these runs a small variance would look likely.
    let even = space_of(sample, &now.kept(), &Shape { scale: vec![1.0; sample.rows()], rho: 0.0 }, now.variance_factor);
    let gram = |space: &Space| {
        let columns = now.set.iter().flat_map(|it| &it.columns);
        Basis::of(&columns.map(|column| space.in_whitened_space(column)).collect::<Vec<_>>()).ln_gram()
    };
    let restricted = if now.noise == Noise::default() { 0.0 } else { gram(&space) - gram(&even) };
    rows * (square / space.rows() as f64).ln() + restricted + space.ln_determinant + scales_left_out + causes + outliers + noise
}

/// Whether the growth of noise is visible beyond a few runs, and whether growth and correlation exceed what the fit of the unknowns causes in
/// residuals. Each costs a degree of freedom in likelihood ratios.
fn is_noise_proven(sample: &Sample, thresholds: &Thresholds, now: &Explained) -> bool {
    let kept = now.kept();
    let residual: Vec<f64> = kept.iter().map(|row| sample.response[*row] - now.fitted[*row]).collect();
    let unknowns = sample.terms.len() + now.set.iter().map(|it| it.columns.len()).sum::<usize>();
    let free = kept.len().saturating_sub(unknowns) as f64 / kept.len() as f64;
    if now.noise != Noise::default() && kept.len() < unknowns + LEAST_FREEDOM {
        return false;
    }
    let fitted: Vec<f64> = kept.iter().map(|row| now.fitted[*row]).collect();
    let even: Vec<f64> = residual.iter().zip(&kept).map(|(e, row)| e / now.scale[*row]).collect();
    let grows = || noise::growth_beyond_few(&residual, &fitted) * free >= thresholds.growth;
    let follow = || noise::correlation(&even, &kept).1 * free >= thresholds.correlation;
    (now.noise.growth.is_none() || grows()) && (now.noise.rho.is_none() || follow())
}

/// Outlying runs for given causes. The run with the largest studentised residual is left out, repeatedly, up to a tenth of the runs. All runs up to
/// the last significant one are outliers (Rosner's generalised test, 1983: one outlier does not hide another).
fn outliers(sample: &Sample, now: &Explained, thresholds: &Thresholds) -> Vec<usize> {
    let rows = sample.rows();
    let shape = Shape { scale: now.scale.clone(), rho: 0.0 };
    let mut kept: Vec<usize> = (0..rows).collect();
    let mut removed = Vec::new();
    let mut last = 0;
    let unknowns: usize = now.set.iter().map(|it| it.columns.len()).sum();
    let most = (MOST_OUTLIERS * rows as f64).ceil() as usize;
    let at_once = rows.div_ceil(ONE_BY_ONE);
    while removed.len() < most && kept.len() >= unknowns + 5 {
        let space = space_of(sample, &kept, &shape, now.variance_factor);
        let (all, freedom) = studentised(sample, &now.set, &space);
        let mut order: Vec<usize> = (0..all.len()).collect();
        // Of equal ones the last, as for a maximum.
        order.sort_by(|a, b| all[*b].abs().total_cmp(&all[*a].abs()).then(b.cmp(a)));
        order.truncate(at_once.min(most - removed.len()));
        let mut count = kept.len();
        for place in &order {
            removed.push(kept[*place]);
            if thresholds.is_outlier(all[*place], freedom, count) {
                last = removed.len();
            }
            count -= 1;
        }
        kept.retain(|row| !removed.contains(row));
        if removed.len() > last + MOST_WITHOUT_OUTLIER * at_once {
            break;
        }
    }
    removed.truncate(last);
    removed.sort_unstable();
    removed
}

/// Externally studentised residuals of the rows that count, and their degrees of freedom.
pub(super) fn studentised(sample: &Sample, set: &[Hypothesis], space: &Space) -> (Vec<f64>, f64) {
    let whitened: Vec<Vec<f64>> = set.iter().flat_map(|it| &it.columns).map(|column| space.in_whitened_space(column)).collect();
    let basis = Basis::of(&whitened).directions;
    let solved = solve(&whitened, &space.in_whitened_space(&sample.residual()));
    let (rows, rank) = (space.rows() as f64, basis.len() as f64);
    let square = dot(&solved.residual, &solved.residual);
    let freedom = (rows - rank - 1.0).max(1.0);
    let of_row = |row: usize| {
        let own = (1.0 - basis.iter().map(|direction| direction[row] * direction[row]).sum::<f64>()).max(1e-9);
        let e = solved.residual[row];
        // Rows at rest have no error at all: zero by a number that is not zero.
        let without = (square - e * e / own).max(1e-12 * square).max(f64::MIN_POSITIVE) / freedom;
        e / (without * own).sqrt()
    };
    ((0..space.rows()).map(of_row).collect(), freedom)
}

/// Estimates growth and correlation again, from the residuals of the rows that count.
fn update_noise(sample: &Sample, now: &mut Explained) {
    let kept = now.kept();
    let residual: Vec<f64> = kept.iter().map(|row| sample.response[*row] - now.fitted[*row]).collect();
    let fitted: Vec<f64> = kept.iter().map(|row| now.fitted[*row]).collect();
    if now.noise.growth.is_some() {
        let growth = noise::growth(&residual, &fitted).0;
        now.noise.growth = Some(growth);
        now.scale = growth.scale(&now.fitted);
    }
    if now.noise.rho.is_some() {
        let even: Vec<f64> = residual.iter().zip(&kept).map(|(e, row)| e / now.scale[*row]).collect();
        now.noise.rho = Some(noise::correlation(&even, &kept).0);
    }
}
