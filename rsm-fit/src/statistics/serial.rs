//! Serial correlation of the errors, and standard errors that allow for it.
//!
//! In: the fitted rows with their errors, in run order if it is known, otherwise in the order of the rows. Out: the correlation of neighbours with
//! its probability for random orders; if they are correlated, standard errors and intervals by Newey and West. Changes no coefficient.
//!
//! ```text
//! u_t = (X'WX)^-1 x_t w_t e_t                       what row t does to the coefficients
//! V   = n/(n - p) (S_0 + sum_l (1 - l/(L + 1)) (S_l + S_l')),  S_l = sum_t u_t u_(t-l)'
//! L   = 1.1447 (alpha n)^(1/3),  alpha = 4 r^2/((1 - r)^2 (1 + r)^2)
//! ```
//!
//! Sources: Newey, West 1987, A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix; Andrews 1991,
//! Heteroskedasticity and autocorrelation consistent covariance matrix estimation, (6.2) and (6.4): L for the Bartlett kernel, of an AR(1) series,
//! here that of the errors, so that L does not depend on the units of the terms; Andrews, Monahan 1992: r at most 0.97; Wald, Wolfowitz 1943: random
//! orders.

use std::num::NonZeroUsize;
use std::ops::Range;

use serde::Serialize;

use crate::dd::lanes::{LANES, Lanes};
use crate::design::Design;
use crate::design::eight::{Eight, Seen, eight};
use crate::distributions::{quantile_t, two_sided_t};
use crate::observations::Observations;
use crate::qr::Growing;
use crate::random::Random;
use crate::sequence::Sequence;
use crate::threads;

/// With fewer rows, no test is made.
const LEAST_ROWS: usize = 8;

/// The number of random orders for comparison: if the actual order has the largest correlation of all, its probability is 1/1000.
const ORDERS: u64 = 999;

/// From this number of rows, the correlation of neighbours in a random order is normal with mean -1/(n - 1) and variance 1/(n - 1), to about 1/n
/// (Wald, Wolfowitz 1943).
const MANY_ROWS: usize = 500;

/// The largest correlation used in the rule of the lags (Andrews, Monahan 1992).
const MOST_ALIKE: f64 = 0.97;

/// The limit of multiplications: in double-double 10^8 take a second, in double precision a tenth of it.
const WORK: f64 = 1e8;

/// Correlated errors of neighbours, and standard errors for this case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Serial {
    /// "run-order", or "rows" if the run order is not known.
    pub order: &'static str,
    /// The correlation of the errors of neighbours.
    pub correlation: f64,
    /// The probability of such a correlation in a random order.
    pub p: f64,
    /// L: up to this distance in rows, errors count as correlated; `None` without standard errors.
    pub lags: Option<usize>,
    /// The Newey-West standard error of each term; empty if constraints or a penalty affect the coefficients, and for large fits.
    pub standard_errors: Vec<f64>,
    /// Bounds of the 95 % intervals with them.
    pub intervals: Vec<[f64; 2]>,
}

impl Serial {
    /// The largest ratio of these standard errors to the ordinary ones.
    pub(crate) fn largest_ratio(&self, ordinary: impl Iterator<Item = Option<f64>>) -> Option<f64> {
        let ratio = |(here, ordinary): (&f64, Option<f64>)| Some(here / ordinary.filter(|error| *error > 0.0)?);
        self.standard_errors.iter().zip(ordinary).filter_map(ratio).reduce(f64::max)
    }
}

/// The correlation of neighbours and its probability in a random order. `places`: where the errors are; neighbours are 1 apart. `None` with too few
/// rows or neighbours.
pub(crate) fn of_neighbours(errors: &[f64], places: &[usize]) -> Option<(f64, f64)> {
    let count = errors.len() as f64;
    if errors.len() < LEAST_ROWS {
        return None;
    }
    let mean = errors.iter().sum::<f64>() / count;
    let mut errors: Vec<f64> = errors.iter().map(|error| error - mean).collect();
    let square: f64 = errors.iter().map(|error| error * error).sum();
    // The places of the second of two neighbours; all but the first without gaps.
    let seconds: Vec<usize> = (1..errors.len()).filter(|k| places[*k] == places[*k - 1] + 1).collect();
    let pairs = seconds.len() as f64;
    if seconds.len() + 1 < LEAST_ROWS {
        return None;
    }
    // Beside gaps the mean over the pairs, as without gaps. The factor is exactly 1 there.
    let scale = (count - 1.0) / pairs;
    let serial = |errors: &[f64]| scale * (seconds.iter().map(|k| errors[*k - 1] * errors[*k]).sum::<f64>() / square);
    let found = serial(&errors);
    if errors.len() >= MANY_ROWS {
        // The mean over fewer pairs has the variance 1/pairs.
        let z = (found + 1.0 / (count - 1.0)) * pairs.sqrt();
        let p = two_sided_t(z, count)? / 2.0;
        // mutant `> to >=`: at 0 both are a half.
        return Some((found, if z > 0.0 { p } else { 1.0 - p }));
    }
    // mutant `1 up`, mutant `1 down`: other random orders give the same within their accuracy.
    let mut random = Random::new(1);
    // mutant `0 up`: so does one order less.
    let as_much = (0..ORDERS).filter(|_| {
        random.shuffle(&mut errors);
        serial(&errors) >= found
    });
    Some((found, (as_much.count() + 1) as f64 / (ORDERS + 1) as f64))
}

/// Andrews' rule for the Bartlett kernel.
fn lags(correlation: f64, rows: usize) -> usize {
    let r = correlation.clamp(0.0, MOST_ALIKE);
    let alpha = 4.0 * r * r / ((1.0 - r).powi(2) * (1.0 + r).powi(2));
    // mutant: with all rows but one apart every product already counts.
    ((1.1447 * (alpha * rows as f64).cbrt()) as usize).min(rows - 1)
}

/// The variance of a sum of ordered parts, if parts up to `lags` apart are correlated.
fn variance_of_sum(parts: &[f64], lags: usize) -> f64 {
    let apart = |lag: usize| parts[lag..].iter().zip(parts).map(|(here, before)| here * before).sum::<f64>();
    let weight = |lag: usize| 1.0 - lag as f64 / (lags as f64 + 1.0);
    apart(0) + 2.0 * (1..=lags).map(|lag| weight(lag) * apart(lag)).sum::<f64>()
}

/// Whether the influences of the rows (double-double) or the sums over lags (double precision) would take more than about a second.
fn takes_too_long(rows: usize, width: usize, lags: usize) -> bool {
    let each = rows as f64 * width as f64;
    each * width as f64 > WORK || each * lags as f64 > 10.0 * WORK
}

/// The number of lags, with a standard error for each term. `errors`: sqrt(w) (y - yhat), by row. A left-out row is a part of 0 (Parzen 1963, On
/// spectral analysis with missing observations), so that rows keep their distance and no variance is negative. `None` if it would take too long.
pub(crate) fn newey_west(
    design: &Design,
    solved: &Growing,
    fit: Observations<'_>,
    sequence: &Sequence,
    errors: &[f64],
    correlation: f64,
) -> Option<(usize, Vec<f64>)> {
    let (rows, width) = (sequence.rows.len(), design.width());
    let lags = lags(correlation, rows);
    let freedom = NonZeroUsize::new(rows.checked_sub(width)?)?;
    let first = *sequence.places.first()?;
    if takes_too_long(sequence.places.last()? - first + 1, width, lags) {
        return None;
    }
    let effects = effects(design, solved, fit, errors);
    let mut parts = vec![Vec::with_capacity(rows); width];
    for (row, place) in sequence.rows.iter().zip(&sequence.places) {
        for (part, effect) in parts.iter_mut().zip(&effects[row * width..]) {
            part.resize(place - first, 0.0);
            part.push(*effect);
        }
    }
    let few = rows as f64 / freedom.get() as f64;
    // By rounding, a variance of zero may become negative.
    let error = |term: usize| (few * variance_of_sum(&parts[term], lags)).max(0.0).sqrt();
    Some((lags, threads::all(width, rows, error)))
}

/// u_t of each row, term by term.
fn effects(design: &Design, solved: &Growing, fit: Observations<'_>, errors: &[f64]) -> Vec<f64> {
    let width = design.width();
    let mut all = Vec::with_capacity(errors.len() * width);
    let of_range = |range: Range<usize>| {
        let mut terms = Eight::new(design);
        let mut row = vec![Lanes::ZERO; width];
        let mut effects = Vec::with_capacity(range.len() * width);
        for first in range.clone().step_by(LANES) {
            row.copy_from_slice(terms.rows(fit.inputs, first, Seen::AsMeasured));
            solved.effects(&mut row);
            let pushed = Lanes::of(eight(errors, first)).mul(fit.weights(first).sqrt());
            row.iter_mut().for_each(|effect| *effect = effect.mul(pushed));
            for lane in 0..LANES.min(range.end - first) {
                effects.extend(row.iter().map(|effect| effect.get(lane).to_f64()));
            }
        }
        effects
    };
    threads::over_rows(errors.len(), of_range, |effects| all.extend(effects));
    all
}

/// Bounds of the 95 % intervals.
pub(crate) fn intervals(coefficients: impl Iterator<Item = f64>, errors: &[f64], freedom: usize) -> Vec<[f64; 2]> {
    let quantile = quantile_t(0.95, freedom);
    coefficients.zip(errors).map(|(value, error)| [value - quantile * error, value + quantile * error]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn alike(errors: &[f64]) -> Option<(f64, f64)> {
        of_neighbours(errors, &(0..errors.len()).collect::<Vec<usize>>())
    }

    #[test]
    fn a_sum_of_four_parts_worked_by_hand() {
        // 4 squares; neighbours 1 - 1 + 1; two apart -1 - 1; three apart -1.
        let parts = [1.0, 1.0, -1.0, -1.0];
        assert_eq!(variance_of_sum(&parts, 0), 4.0);
        assert_eq!(variance_of_sum(&parts, 1), 4.0 + 2.0 * 0.5);
        assert_eq!(variance_of_sum(&parts, 3), 4.0 + 2.0 * (0.75 - 0.5 * 2.0 - 0.25));
    }

    #[test]
    fn lags_follow_the_rule() {
        // r = 1/2: alpha = 1/(1/4 * 9/4) = 16/9; (16/9 * 486)^(1/3) = 864^(1/3) = 9.524; times 1.1447: 10.90.
        assert_eq!(lags(0.5, 486), 10);
        assert_eq!(lags(-0.5, 486), 0);
        assert_eq!(lags(0.5, 8), 2);
        assert_eq!(lags(1.0, 8), 7);
        // As at 0.97: alpha = 4 * 0.9409/(0.0009 * 3.8809) = 1077.5; (1.0775e8)^(1/3) = 475.86; times 1.1447: 544.7.
        assert_eq!(lags(1.0, 100_000), 544);
    }

    /// What a fit says of twelve rows.
    fn of_rows(response: impl Into<crate::in_memory::Responses>, terms: &[[u32; 1]]) -> Serial {
        let turns: Vec<f64> = (0..12).map(|row| if row % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let outcome = crate::Fit::new(&turns, response).terms(terms.to_vec()).fit().unwrap();
        outcome.responses[0].statistics.as_ref().unwrap().serial.clone().expect("neighbours that are alike")
    }

    fn near(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        // Some ten roundings of numbers near 1.
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-13), "{found:?} {expected:?}");
    }

    #[test]
    fn standard_errors_worked_by_hand() {
        // Six errors of 1, then six of -1: r = (5 - 1 + 5)/12, alpha = 4 * 0.5625/(0.0625 * 3.0625) = 11.755, L = 1.1447 * 5.206 = 5.96. Neighbours l
        // apart: 12 - 3 l. Of the constant 12 + 2 (5/6 * 9 + 4/6 * 6 + 3/6 * 3 + 0 - 1/6 * 3) = 37; of an input that turns at each row the odd ones
        // have the other sign: 3.
        let halves: Vec<f64> = (0..12).map(|row| if row < 6 { 1.0 } else { -1.0 }).collect();
        let found = of_rows(&halves, &[[0], [1]]);
        assert_eq!((found.order, found.correlation, found.lags), ("rows", 0.75, Some(5)));
        let expected = [37.0, 3.0].map(|sum: f64| (12.0 / 10.0 * sum).sqrt() / 12.0);
        near(&found.standard_errors, &expected);
        // Student's t with 10 degrees of freedom: 2.228139 at 95 %, seven digits of any table.
        let wide = found.intervals[0];
        assert!((wide[1] - 2.228139 * expected[0]).abs() < 1e-6 && (wide[0] + wide[1]).abs() < 1e-13, "{wide:?}");
        // The second half weighs twice: the mean is -1/3, the errors 4/3 and -2/3, and what a row does to it +-(2/27).
        let weights = halves.iter().map(|error| 1.5 - 0.5 * error).collect::<Vec<f64>>();
        let found = of_rows(crate::Response::new("y", &halves).weights(weights), &[[0]]);
        near(&found.standard_errors, &[(12.0_f64 / 11.0 * 37.0).sqrt() * 2.0 / 27.0]);
    }

    #[test]
    fn a_second_of_work_is_the_limit() {
        // 10^4 rows of 100 terms: 10^8 multiplications in double-double. 10^6 rows of 10 terms with 100 lags: 10^9 in double precision.
        assert!(!takes_too_long(10_000, 100, 0));
        assert!(takes_too_long(10_001, 100, 0));
        assert!(!takes_too_long(1_000_000, 10, 100));
        assert!(takes_too_long(1_000_000, 10, 101));
    }

    #[test]
    fn the_largest_ratio_leaves_terms_without_an_error_out() {
        let serial = Serial {
            order: "rows",
            correlation: 0.5,
            p: 0.001,
            lags: Some(1),
            standard_errors: vec![1.0, 3.0, 9.0, 9.0],
            intervals: Vec::new(),
        };
        assert_eq!(serial.largest_ratio([Some(0.4), Some(2.0), None, Some(0.0)].into_iter()), Some(2.5));
        assert_eq!(serial.largest_ratio([None; 4].into_iter()), None);
    }

    #[test]
    fn the_correlation_of_neighbours_worked_by_hand() {
        // 0 to 7 less their mean: squares 42, neighbours 8.75 + 3.75 + 0.75 - 0.25 + 0.75 + 3.75 + 8.75 = 26.25. Of 8! = 40,320 orders only few are
        // as alike.
        let rows: Vec<f64> = (0..8).map(f64::from).collect();
        let (found, p) = alike(&rows).unwrap();
        assert_eq!(found, 0.625);
        assert!(p <= 0.005, "{p}");
        assert_eq!(alike(&rows[1..]), None);
        // Of 20! orders none is met that is as alike: the order itself, of 1000 with it.
        let rows: Vec<f64> = (0..20).map(f64::from).collect();
        assert_eq!(alike(&rows).unwrap().1, 0.001);
        // Four of each sign have 70 orders; two of them have a single change, as many as this one: 2/70 = 0.029, which 999 orders find to 0.005.
        let halves = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0];
        let (found, p) = alike(&halves).unwrap();
        assert_eq!(found, 0.625);
        assert!((p - 2.0 / 70.0).abs() < 0.02, "{p}");
        assert_eq!((p * 1000.0).round() / 1000.0, p);
        // 500 rows + + - - + + - -: of 499 pairs 250 have one sign, so 1/500 = 0.002. z = (1/500 + 1/499) sqrt(499) = 0.089443, and Student's t with
        // 500 degrees of freedom lies above it with 0.464383 (normal: 0.464365).
        let signs: Vec<f64> = (0..MANY_ROWS).map(|row| if row % 4 < 2 { 1.0 } else { -1.0 }).collect();
        let (found, p) = alike(&signs).unwrap();
        assert_eq!(found, 0.002);
        assert!((p - 0.464_383).abs() < 2e-6, "{p}");
        let turns: Vec<f64> = (0..MANY_ROWS).map(|row| if row % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(alike(&turns).unwrap().1 > 0.999);
    }

    #[test]
    fn pairs_over_a_gap_do_not_count() {
        // 0 to 7 again, with a gap before 3: less 0.75, 25.5 are left of six pairs. One pair fewer than seven is too few, so row 8 is added: the mean
        // is 4, the squares 60, neighbours 12 + 6 + 0 + 0 + 2 + 6 + 12 = 38 without the pair 2 * 1 = 2 over the gap; 8/7 of them by the pairs.
        let rows: Vec<f64> = (0..9).map(f64::from).collect();
        let places: Vec<usize> = (0..9).map(|k| if k < 3 { k } else { k + 1 }).collect();
        let (found, p) = of_neighbours(&rows, &places).unwrap();
        // Three roundings.
        assert!((found - 8.0 / 7.0 * 38.0 / 60.0).abs() < 1e-15, "{found}");
        assert!(p <= 0.01, "{p}");
        assert_eq!(of_neighbours(&rows[..8], &places[..8]), None);
        // 600 rows in pairs of one sign, +1 or -1 in turn, with a gap after each pair: 300 pairs, all alike. Against random orders that is certain.
        let signs: Vec<f64> = (0..600).map(|row| if row % 4 < 2 { 1.0 } else { -1.0 }).collect();
        let places: Vec<usize> = (0..600).map(|row| row + row / 2).collect();
        let (found, p) = of_neighbours(&signs, &places).unwrap();
        assert!((found - 599.0 / 600.0).abs() < 1e-15 && p < 1e-30, "{found} {p}");
    }

    #[test]
    fn both_ways_to_a_probability_agree_and_follow_their_level() {
        // Series of white noise on either side of the limit. 1 % of 400: 4 alarms, with a standard deviation of 2; 10 % of 60, as orders take time: 6
        // and 2.3. Five of them above, and at least one.
        for (rows, series, level, most) in [(MANY_ROWS - 1, 60, 0.1, 17), (MANY_ROWS, 400, 0.01, 14)] {
            let alarms = (0..series).filter(|seed| {
                let mut random = Random::new(*seed);
                let errors: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
                alike(&errors).unwrap().1 <= level
            });
            let alarms = alarms.count();
            assert!((1..=most).contains(&alarms), "{rows} rows: {alarms}");
        }
        let mut random = Random::new(3);
        let errors: Vec<f64> = (0..MANY_ROWS).map(|_| random.normal()).collect();
        let (short, long) = (alike(&errors[1..]).unwrap().1, alike(&errors).unwrap().1);
        // One row less moves the correlation by about 1/500; 999 orders tell a probability to 0.016 (one standard deviation), three of them.
        assert!((short - long).abs() < 0.08, "{short} {long}");
    }
}
