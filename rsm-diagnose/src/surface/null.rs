//! The null distribution of the search on the rows of the data.
//!
//! In: the columns of the hypotheses in the whitened space, the allowed rate of false alarms. Out: [`Thresholds`]. Pure noise is drawn many times, from a fixed seed, and analysed as
//! the data are. So the number of hypotheses and their correlation need no formula. The response is not used.

use super::noise;
use crate::engine::columns::{Basis, dot};
use crate::engine::significance::{f_of, ln_p_of_squares, ln_two_sided_t};
use rsm_fit::random::Random;

/// Of all false alarms these shares fall to causes that move the mean, to outlying runs, to noise that grows, to errors that follow each other, and to structure left. The mean has by far the
/// most hypotheses.
const SHARES: [f64; 5] = [0.4, 0.15, 0.15, 0.15, 0.15];

/// Draws for the mean: the 1.6 % point of 2000 draws is known to a fifth of itself.
const DRAWS: usize = 2000;

/// At most this many multiplications; large data have smoother distributions, and fewer draws do.
const WORK: usize = 1_500_000_000;

/// Draws for the mean of a likelihood ratio, which a factor of 1.1 in a hundred draws knows.
const RATIO_DRAWS: usize = 200;

/// What evidence a cause must give.
#[derive(Debug, Clone, PartialEq)]
pub struct Thresholds {
    /// ln of the probability that a hypothesis about the mean must stay below.
    pub ln_p_mean: f64,
    /// The false alarms that are left to outlying runs.
    pub alpha_outliers: f64,
    /// What 2 ln of the likelihood ratio must reach for noise that grows,
    pub growth: f64,
    /// and for errors that follow each other.
    pub correlation: f64,
    /// ln of the probability that the tests for structure left must stay below, one for all of them.
    pub alpha_structure: f64,
}

impl Thresholds {
    /// `carried`: the columns of every hypothesis in the white space of all rows; `fitted` the nominal response there; `alpha` the share of false alarms of this response.
    pub fn new(carried: &[Vec<Vec<f64>>], fitted: &[f64], rows: usize, alpha: f64) -> Self {
        // A seed is a part of the method: the same data, the same answer.
        let mut random = Random::new(0x5eed);
        let bases: Vec<Basis> = carried.iter().map(Basis::of).filter(|it| it.rank() > 0).collect();
        let numbers: usize = bases.iter().map(Basis::rank).sum();
        let draws = (WORK / (rows * numbers).max(1)).clamp(200, DRAWS);
        let widest = bases.iter().map(Basis::rank).max().unwrap_or(0);
        let mut least: Vec<f64> = Vec::with_capacity(draws);
        for _ in 0..draws {
            let draw: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
            let square = dot(&draw, &draw);
            let mut share = vec![0.0_f64; widest + 1];
            for basis in &bases {
                let largest = &mut share[basis.rank()];
                *largest = largest.max(basis.takes(&draw) / square);
            }
            let tails = share.iter().enumerate().filter(|(_, share)| **share > 0.0);
            let ln_p = tails.map(|(width, share)| ln_p_of_share(*share, width, rows)).fold(0.0, f64::min);
            least.push(ln_p);
        }
        least.sort_by(f64::total_cmp);
        let place = (alpha * SHARES[0] * draws as f64).floor() as usize;
        // Never beyond what a single hypothesis would be allowed.
        let ln_p_mean = least[place.min(draws - 1)].min((alpha * SHARES[0]).ln());
        let mut ratios = [0.0, 0.0];
        for _ in 0..RATIO_DRAWS {
            let draw: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
            let places: Vec<usize> = (0..rows).collect();
            ratios[0] += noise::growth(&draw, fitted).1.max(0.0) / RATIO_DRAWS as f64;
            ratios[1] += noise::correlation(&draw, &places).1.max(0.0) / RATIO_DRAWS as f64;
        }
        // A likelihood ratio of one unknown is chi-squared up to a factor, which its mean gives (Bartlett 1937).
        let ratio = |mean: f64, share: f64| mean.max(1.0) * f_of((alpha * share).ln(), 1.0, 1e7);
        Thresholds {
            ln_p_mean,
            alpha_outliers: alpha * SHARES[1],
            growth: ratio(ratios[0], SHARES[2]),
            correlation: ratio(ratios[1], SHARES[3]),
            alpha_structure: alpha * SHARES[4],
        }
    }

    /// What a hypothesis with `width` unknowns costs in n ln(sum of squares): as much as it wins at the threshold.
    pub fn cost(&self, width: usize, rows: usize) -> f64 {
        let freedom = rows.saturating_sub(width + 3).max(2) as f64;
        let f = f_of(self.ln_p_mean, width as f64, freedom);
        rows as f64 * (width as f64 * f / freedom).ln_1p()
    }

    /// Whether a run with this studentised residual is an outlier among `rows` (Bonferroni's bound over the rows, as in Rosner 1983).
    pub fn is_outlier(&self, t: f64, freedom: f64, rows: usize) -> bool {
        ln_two_sided_t(t, freedom) < (self.alpha_outliers / rows as f64).ln()
    }
}

/// ln of the probability that `width` arbitrary columns take this share of pure noise.
fn ln_p_of_share(share: f64, width: usize, rows: usize) -> f64 {
    let freedom = rows.saturating_sub(width).max(1) as f64;
    ln_p_of_squares(share, width as f64, 1.0 - share, freedom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_hypotheses_ask_for_more_and_copies_do_not() {
        let rows = 40;
        let column = |k: usize| (0..rows).map(|row| ((row * (k + 1)) as f64 * 0.37).sin()).collect::<Vec<f64>>();
        let fitted: Vec<f64> = (0..rows).map(|row| row as f64).collect();
        let of = |carried: &[Vec<Vec<f64>>]| Thresholds::new(carried, &fitted, rows, 0.05).ln_p_mean;
        let one = of(&[vec![column(0)]]);
        let copies = of(&vec![vec![column(0)]; 12]);
        let twelve = of(&(0..12).map(|k| vec![column(k)]).collect::<Vec<_>>());
        // One: the 2 % point of a single test. ln 0.02 = -3.91; of 2000 draws the 40th from below, known to 16 %.
        assert!((one - 0.02_f64.ln()).abs() < 0.5 && one == copies, "{one} {copies}");
        // Twelve that have little in common: ln(0.02/12) = -6.4.
        assert!((twelve - (0.02_f64 / 12.0).ln()).abs() < 0.7, "{twelve}");
    }
}
