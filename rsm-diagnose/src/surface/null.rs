//! The null distribution of the search on the rows of the data.
//!
//! In: the columns of the hypotheses in the whitened space, and the allowed rate of false alarms. Out: [`Thresholds`]. Pure noise is drawn many times
//! from a fixed seed and analysed like the data, so the number of hypotheses and their correlation need no formula. The response is not used.

use super::noise;
use crate::engine::columns::{Basis, dot};
use crate::engine::significance::{f_of, ln_p_of_squares, ln_two_sided_t};
use rsm_core::order;
use rsm_fit::random::Random;

/// The shares of the false alarms for: causes that change the mean, outlying runs, growing noise, correlated errors, and remaining structure. The
/// mean has by far the most hypotheses.
const SHARES: [f64; 5] = [0.4, 0.15, 0.15, 0.15, 0.15];

/// Draws for the mean: with 2000 draws, the 1.6 % point is accurate to a fifth.
const DRAWS: usize = 2000;

/// The limit of multiplications. Large data have smoother distributions, so fewer draws are sufficient.
const WORK: usize = 1_500_000_000;

/// Draws for the mean of a likelihood ratio. A hundred draws give it to a factor of 1.1.
const RATIO_DRAWS: usize = 200;

/// The evidence that a cause needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Thresholds {
    /// The log probability below which a hypothesis about the mean is significant.
    pub ln_p_mean: f64,
    /// The allowed false alarms of outlying runs.
    pub alpha_outliers: f64,
    /// The 2 ln of the likelihood ratio that growing noise needs,
    pub growth: f64,
    /// and that correlated errors need.
    pub correlation: f64,
    /// The probability of false alarms for all tests of remaining structure together.
    pub alpha_structure: f64,
}

impl Thresholds {
    /// `whitened`: the columns of every hypothesis in the whitened space of all rows; `fitted`: the nominal response there; `alpha`: the allowed
    /// false alarms of this response.
    pub fn new(whitened: &[Vec<Vec<f64>>], fitted: &[f64], rows: usize, alpha: f64) -> Self {
        // The seed is fixed, so that the same data give the same answer.
        let mut random = Random::new(0x5eed);
        let bases: Vec<Basis> = whitened.iter().map(Basis::of).filter(|it| it.rank() > 0).collect();
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
                *largest = largest.max(basis.projected_square(&draw) / square);
            }
            let tails = share.iter().enumerate().filter(|(_, share)| **share > 0.0);
            let ln_p = tails.map(|(width, share)| ln_p_of_share(*share, width, rows)).fold(0.0, f64::min);
            least.push(ln_p);
        }
        order::sort(&mut least);
        let place = (alpha * SHARES[0] * draws as f64).floor() as usize;
        // At most the limit for a single hypothesis.
        let ln_p_mean = least[place.min(draws - 1)].min((alpha * SHARES[0]).ln());
        let mut ratios = [0.0, 0.0];
        for _ in 0..RATIO_DRAWS {
            let draw: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
            let places: Vec<usize> = (0..rows).collect();
            ratios[0] += noise::growth(&draw, fitted).1.max(0.0) / RATIO_DRAWS as f64;
            ratios[1] += noise::correlation(&draw, &places).1.max(0.0) / RATIO_DRAWS as f64;
        }
        // A likelihood ratio with one unknown is chi-squared up to a factor, which its mean gives (Bartlett 1937).
        let ratio = |mean: f64, share: f64| mean.max(1.0) * f_of((alpha * share).ln(), 1.0, 1e7);
        Thresholds {
            ln_p_mean,
            alpha_outliers: alpha * SHARES[1],
            growth: ratio(ratios[0], SHARES[2]),
            correlation: ratio(ratios[1], SHARES[3]),
            alpha_structure: alpha * SHARES[4],
        }
    }

    /// The cost of a hypothesis with `width` unknowns in n ln(sum of squares): its gain at the threshold.
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

/// ln of the probability that `width` arbitrary columns explain this share of pure noise.
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
        let of = |whitened: &[Vec<Vec<f64>>]| Thresholds::new(whitened, &fitted, rows, 0.05).ln_p_mean;
        let one = of(&[vec![column(0)]]);
        let copies = of(&vec![vec![column(0)]; 12]);
        let twelve = of(&(0..12).map(|k| vec![column(k)]).collect::<Vec<_>>());
        // One: the 2 % point of a single test. ln 0.02 = -3.91; of 2000 draws the 40th from below, known to 16 %.
        assert!((one - 0.02_f64.ln()).abs() < 0.5 && one == copies, "{one} {copies}");
        // Twelve that have little in common: ln(0.02/12) = -6.4.
        assert!((twelve - (0.02_f64 / 12.0).ln()).abs() < 0.7, "{twelve}");
    }
}
