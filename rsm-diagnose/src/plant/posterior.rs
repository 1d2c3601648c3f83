//! The posterior of each parameter from records and tolerances: standard deviations and 95 % intervals.
//!
//! In: a fit with its derivatives. Out: a standard deviation and an interval for each unknown. Three assumptions: readings are normal about the
//! simulation, which is linear near the fit; tolerances are normal up to two standard deviations, where a cause begins; and a parameter is never
//! beyond its physical bound. A bound does not reduce the uncertainty of an unknown: it stays in the covariance, and its interval is the shortest one
//! that holds 95 % of the truncated normal distribution. If no bound is near, this is 1.96 standard deviations to both sides.

use super::levenberg::{self, Fit};
use super::model::{Place, Unknown};
use super::normal::Normal;
use super::random::Random;
use super::whitened_residuals::Column;
use rsm_core::order;

/// Half the width of a 95 % interval of a normal variable, in standard deviations.
pub const REACH: f64 = 1.96;

/// A bound matters if more than one case in a thousand would be beyond it: up to 3.1 standard deviations away. Fewer do not change a 95 % interval.
const WITHIN_REACH: f64 = 3.1;

/// The number of draws if a bound matters. They give the ends of an interval to 2 % of a standard deviation, although successive draws are
/// correlated.
const DRAWS: usize = 20_000;

/// Draws that are discarded at the beginning, until the draws have moved from a corner, where most bounds meet, to the bulk of the distribution.
const BURN_IN: usize = 500;

/// A share of the draws, or of their range, that is below the accuracy of the shortest interval.
const NEGLIGIBLE_SHARE: f64 = 0.005;

/// The share of the draws in an interval.
const SHARE_OF_DRAWS: f64 = 0.95;

/// Standard deviations and intervals of a fit's unknowns, each on the scale of its search; `None` for an unknown that does not move. An unknown that
/// changes no simulated row has an interval without ends.
#[derive(Debug, Clone)]
pub struct Posterior {
    deviations: Vec<Option<f64>>,
    ends: Vec<Option<(f64, f64)>>,
}

impl Posterior {
    /// The posterior of a fit.
    #[must_use]
    pub fn of(fit: &Fit) -> Self {
        let model = &fit.model;
        let bounded = |unknown: &Unknown| unknown.prior.is_some() || !unknown.logarithmic;
        // An unknown at an end of its search that is no physical bound has no meaningful interval.
        let moves = |column: &Column| column.values.iter().any(|value| *value != 0.0);
        let held = fit.held.iter().filter(|it| bounded(&model.unknowns[it.unknown]) && moves(&it.column));
        // No row and no tolerance says anything about an unknown without a column, such as a limit that no record reaches.
        let (known, unknown): (Vec<_>, Vec<_>) =
            fit.free.iter().zip(&fit.columns).partition(|it| model.unknowns[*it.0].prior.is_some() || moves(it.1));
        let free = known.len();
        let which: Vec<usize> = known.iter().map(|it| *it.0).chain(held.clone().map(|it| it.unknown)).collect();
        let columns: Vec<_> = known.iter().map(|it| it.1).chain(held.map(|it| &it.column)).cloned().collect();
        let n = which.len();
        // If more than noise is left, the weight of the records is reduced accordingly. The tolerances keep their weight.
        let spread = (levenberg::cost(model, &fit.residual) / fit.residual.len().max(1) as f64).max(1.0);
        let prior = |k: usize| model.unknowns[which[k]].prior.map_or(0.0, |(_, sd)| 1.0 / (sd * sd));
        let mut matrix = levenberg::gram(model, &which, &columns);
        for i in 0..n {
            for j in 0..n {
                let prior = if i == j { prior(i) } else { 0.0 };
                matrix[i * n + j] = (matrix[i * n + j] - prior) / spread + prior;
            }
        }
        let normal = Normal::fine(&matrix, n);
        // Initial states stay in the covariance, but their intervals are not needed.
        let results: Vec<usize> = (0..n).filter(|k| !matches!(model.unknowns[which[*k]].place, Place::Start { .. })).collect();
        let covariances: Vec<Vec<f64>> = results.iter().map(|k| normal.covariances(*k)).collect();
        let m = results.len();
        let covariance: Vec<f64> =
            (0..m).flat_map(|i| results.iter().map(move |j| (i, *j))).map(|(i, j)| covariances[i][j]).collect();
        // The mean of the unbounded normal distribution: it differs from the fit only for held unknowns.
        let pull = levenberg::negative_gradient(model, &which, &columns, &fit.residual);
        let pressed: Vec<f64> = (0..n).map(|k| if k < free { 0.0 } else { pull[k] / spread }).collect();
        let beyond: Vec<f64> = covariances.iter().map(|it| it.iter().zip(&pressed).map(|(c, p)| c * p).sum()).collect();
        let bell = TruncatedNormal::new(&covariance, &beyond, |k| {
            let unknown = &model.unknowns[which[results[k]]];
            let at = unknown.to_search_scale(model.value(which[results[k]]));
            let ends = if bounded(unknown) {
                (unknown.to_search_scale(unknown.low), unknown.to_search_scale(unknown.high))
            } else {
                (f64::NEG_INFINITY, f64::INFINITY)
            };
            (ends.0 - at, ends.1 - at)
        });
        let marginals = bell.marginals();
        let (mut deviations, mut ends) = (vec![None; model.unknowns.len()], vec![None; model.unknowns.len()]);
        for (k, (deviation, low, high)) in results.iter().zip(marginals) {
            let at = model.unknowns[which[*k]].to_search_scale(model.value(which[*k]));
            deviations[which[*k]] = Some(deviation);
            ends[which[*k]] = Some((at + low, at + high));
        }
        unknown.iter().for_each(|it| ends[*it.0] = Some((f64::NEG_INFINITY, f64::INFINITY)));
        Posterior { deviations, ends }
    }

    /// The standard deviation of each unknown.
    #[must_use]
    pub fn deviations(&self) -> &[Option<f64>] {
        &self.deviations
    }

    /// The interval of an unknown, in its own unit.
    #[must_use]
    pub fn interval(&self, fit: &Fit, unknown: usize) -> Option<(f64, f64)> {
        let (low, high) = self.ends[unknown]?;
        let it = &fit.model.unknowns[unknown];
        let outward = |end: f64| if it.logarithmic { end.exp() } else { end };
        Some((outward(low), outward(high)))
    }
}

/// A normal distribution relative to the fit at 0, truncated by bounds.
struct TruncatedNormal {
    /// The lower triangle of the Cholesky factor of the covariance.
    factor: Vec<f64>,
    /// The mean without bounds.
    top: Vec<f64>,
    bounds: Vec<(f64, f64)>,
}

impl TruncatedNormal {
    fn new(covariance: &[f64], top: &[f64], bounds: impl Fn(usize) -> (f64, f64)) -> Self {
        let n = top.len();
        let mut factor = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let sum = covariance[i * n + j] - (0..j).map(|k| factor[i * n + k] * factor[j * n + k]).sum::<f64>();
                factor[i * n + j] = if i == j {
                    sum.max(0.0).sqrt()
                } else if factor[j * n + j] > 0.0 {
                    sum / factor[j * n + j]
                } else {
                    0.0
                };
            }
        }
        TruncatedNormal { factor, top: top.to_vec(), bounds: (0..n).map(bounds).collect() }
    }

    fn row(&self, k: usize) -> &[f64] {
        let n = self.top.len();
        &self.factor[k * n..(k + 1) * n]
    }

    fn deviation(&self, k: usize) -> f64 {
        self.row(k).iter().map(|it| it * it).sum::<f64>().sqrt()
    }

    /// For each unknown: its standard deviation and the two ends of its interval.
    fn marginals(&self) -> Vec<(f64, f64, f64)> {
        let n = self.top.len();
        let is_within = |k: &usize| {
            let (deviation, (low, high)) = (self.deviation(*k), self.bounds[*k]);
            low > self.top[*k] - WITHIN_REACH * deviation || high < self.top[*k] + WITHIN_REACH * deviation
        };
        let bounded: Vec<usize> = (0..n).filter(is_within).collect();
        if bounded.is_empty() {
            let plain =
                |k| (self.deviation(k), self.top[k] - REACH * self.deviation(k), self.top[k] + REACH * self.deviation(k));
            return (0..n).map(plain).collect();
        }
        let draws = self.draws(&bounded);
        draws.into_iter().zip(&self.bounds).map(|(list, bounds)| shortest(list, *bounds)).collect()
    }

    /// Draws of each unknown within its bounds, by Gibbs sampling of the whitened coordinates (S. Geman, D. Geman, 1984). Whitened coordinates depend
    /// on each other only through the bounds, so the draws mix fast even if one direction is a thousand times as long as another.
    fn draws(&self, bounded: &[usize]) -> Vec<Vec<f64>> {
        let n = self.top.len();
        let mut random = Random::new(1);
        // The fit itself is within all bounds.
        let mut at = vec![0.0; n];
        for k in 0..n {
            let row = self.row(k);
            let known: f64 = (0..k).map(|j| row[j] * at[j]).sum();
            at[k] = if row[k] > 0.0 { (-self.top[k] - known) / row[k] } else { 0.0 };
        }
        let mut values: Vec<f64> =
            (0..n).map(|k| self.top[k] + self.row(k).iter().zip(&at).map(|(f, z)| f * z).sum::<f64>()).collect();
        let mut draws = vec![Vec::with_capacity(DRAWS); n];
        for turn in 0..BURN_IN + DRAWS {
            for (j, at) in at.iter_mut().enumerate() {
                let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
                for &k in bounded {
                    let slope = self.row(k)[j];
                    if slope == 0.0 {
                        continue;
                    }
                    let (a, b) = ((self.bounds[k].0 - values[k]) / slope + *at, (self.bounds[k].1 - values[k]) / slope + *at);
                    low = low.max(a.min(b));
                    high = high.min(a.max(b));
                }
                // By rounding, the fit may be slightly beyond its own bound.
                let next = if low < high { truncated(&mut random, low, high) } else { *at };
                for (k, value) in values.iter_mut().enumerate().skip(j) {
                    *value += self.factor[k * n + j] * (next - *at);
                }
                *at = next;
            }
            if turn >= BURN_IN {
                draws.iter_mut().zip(&values).for_each(|(list, value)| list.push(*value));
            }
        }
        draws
    }
}

/// A standard normal variable between two ends (C. P. Robert, "Simulation of truncated normal variables", 1995).
fn truncated(random: &mut Random, low: f64, high: f64) -> f64 {
    if high < 0.0 {
        return -truncated(random, -high, -low);
    }
    if low <= 0.0 && high - low > 2.5 {
        loop {
            let drawn = random.normal();
            if (low..=high).contains(&drawn) {
                return drawn;
            }
        }
    }
    let nearest = low.max(0.0);
    if low > 0.0 && (high - low) * low > 1.0 {
        // The tail of a normal distribution is nearly exponential.
        loop {
            let drawn = low - random.uniform().ln() / low;
            let over = drawn - low;
            if drawn <= high && random.uniform() < (-0.5 * over * over).exp() {
                return drawn;
            }
        }
    }
    loop {
        let drawn = low + (high - low) * random.uniform();
        if random.uniform() < (0.5 * (nearest * nearest - drawn * drawn)).exp() {
            return drawn;
        }
    }
}

/// The standard deviation of a list, and its shortest 95 % interval. If almost no draws lie between the interval and the end of the list, it is
/// extended to that end, and to the bound if this is near. It always contains the fit, 0.
fn shortest(mut list: Vec<f64>, bounds: (f64, f64)) -> (f64, f64, f64) {
    order::sort(&mut list);
    let count = list.len();
    let held = (SHARE_OF_DRAWS * count as f64).ceil() as usize;
    let width = |first: usize| list[first + held - 1] - list[first];
    let first = (0..=count - held).min_by(|a, b| width(*a).total_cmp(&width(*b))).unwrap_or(0);
    let mean = list.iter().sum::<f64>() / count as f64;
    let square = list.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / count as f64;
    // If the truncated distribution ends at the edge, so does the interval.
    let few = (NEGLIGIBLE_SHARE * count as f64) as usize;
    let (least, most) = (list[0], list[count - 1]);
    let near = NEGLIGIBLE_SHARE * (most - least);
    let low = if first >= few {
        list[first]
    } else if least - bounds.0 < near {
        bounds.0
    } else {
        least
    };
    let high = if first + held + few <= count {
        list[first + held - 1]
    } else if bounds.1 - most < near {
        bounds.1
    } else {
        most
    };
    (square.sqrt(), low.min(0.0), high.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two numbers of deviations 1 and 10 that are nearly one, the first within two of its standard deviations.
    fn bell(top: f64) -> TruncatedNormal {
        let covariance = [1.0, 9.99, 9.99, 100.0];
        TruncatedNormal::new(&covariance, &[top, 10.0 * top], |k| {
            if k == 0 { (-2.0, 2.0) } else { (f64::NEG_INFINITY, f64::INFINITY) }
        })
    }

    #[test]
    fn a_bell_that_bounds_cut_at_two_deviations_holds_95_of_100_within_1_68() {
        let marginals = bell(0.0).marginals();
        // erf(2/sqrt 2) = 0.9545, of which 95 % is 0.9068 = erf(1.68/sqrt 2). The ends are known to some hundredths by this many draws, more where
        // the bell is flat.
        for (k, scale) in [(0, 1.0), (1, 10.0)] {
            let (deviation, low, high) = marginals[k];
            assert!((low / scale + 1.68).abs() < 0.1 && (high / scale - 1.68).abs() < 0.1, "{low} {high}");
            // The variance of a normal number within two is 1 - 4 phi(2)/0.9545 = 0.774.
            assert!((deviation / scale - 0.774_f64.sqrt()).abs() < 0.02, "{deviation}");
        }
    }

    #[test]
    fn a_bell_beyond_its_bound_leaves_a_tail_and_no_point() {
        // Its top is four deviations beyond the upper end: what is left falls as an exponential of 1/6 there, 95 % within ln(20)/6 = 0.5 and a little
        // less.
        let mut bell = bell(6.0);
        bell.bounds[0] = (-2.0, 0.0);
        bell.top = vec![6.0, 60.0];
        let (deviation, low, high) = bell.marginals()[0];
        assert_eq!(high, 0.0);
        assert!((-0.5..-0.42).contains(&low) && (0.1..0.17).contains(&deviation), "{low} {deviation}");
    }

    #[test]
    fn an_edge_that_another_number_makes_is_not_a_bound_of_ones_own() {
        // The first number is at its upper end, the second goes along with it, down from 0 by 20, and might be as low as -100 by itself.
        let bell =
            TruncatedNormal::new(
                &[1.0, 9.999, 9.999, 100.0],
                &[3.0, 30.0],
                |k| if k == 0 { (-2.0, 0.0) } else { (-100.0, 100.0) },
            );
        let (_, low, high) = bell.marginals()[1];
        assert!((-12.0..-6.0).contains(&low) && (0.0..1.0).contains(&high), "{low} {high}");
    }

    #[test]
    fn without_a_bound_within_reach_an_interval_is_1_96_deviations() {
        let marginals = TruncatedNormal::new(&[4.0], &[0.0], |_| (-7.0, 7.0)).marginals();
        assert_eq!(marginals, [(2.0, -3.92, 3.92)]);
    }

    #[test]
    fn a_number_that_no_row_depends_on_has_an_interval_without_ends() {
        use super::super::axis_under_steps;
        // The axis never moves backward.
        let friction = "[[effects]]\nkind = \"asymmetric-friction\"\nparameters = { forward = 0.8, backward = 0.5 }\n";
        let truth = axis_under_steps::file("mass = 0.01", friction);
        let nominal = axis_under_steps::file("mass = 0.01", "");
        let (whitened, nominal) = axis_under_steps::whitened_between(&nominal, &truth, true, [2.0, 1.5]);
        let fit = levenberg::fit(&whitened, nominal.with_effects(&nominal, truth.effects), 8).unwrap();
        let posterior = Posterior::of(&fit);
        let place = |name: &str| {
            let is_named = |it: &Unknown| matches!(it.place, Place::Effect { number, .. } if number == name);
            fit.model.unknowns.iter().position(is_named).unwrap()
        };
        let (low, high) = posterior.interval(&fit, place("backward")).unwrap();
        assert!(low <= 0.0 && high == f64::INFINITY, "{low} {high}");
        assert_eq!(posterior.deviations()[place("backward")], None);
        let (low, high) = posterior.interval(&fit, place("forward")).unwrap();
        // The tolerance of the mass alone moves the force by 1 % of some 8 N at most, two deviations to both sides.
        assert!(low < 0.8 && 0.8 < high && high - low < 0.4, "{low} {high}");
    }

    #[test]
    fn truncated_numbers_stay_within_their_ends_and_have_their_mean() {
        let mut random = Random::new(3);
        // Means of a standard normal between two ends: (phi(low) - phi(high))/(Phi(high) - Phi(low)).
        for (low, high, mean) in [
            (-1.0, 1.0, 0.0),
            (0.5, 0.8, 0.6452),
            (3.0, f64::INFINITY, 3.2831),
            (f64::NEG_INFINITY, -3.0, -3.2831),
            (-0.5, 6.0, 0.5092),
        ] {
            let drawn: Vec<f64> = (0..20_000).map(|_| truncated(&mut random, low, high)).collect();
            assert!(drawn.iter().all(|it| (low..=high).contains(it)));
            let found = drawn.iter().sum::<f64>() / drawn.len() as f64;
            // A deviation of 0.8 at most, over sqrt 20000, four times.
            assert!((found - mean).abs() < 0.023, "{low} {high}: {found}");
        }
    }
}
