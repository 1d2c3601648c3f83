//! Significance: noise with the statistics of the noise floors, and the gain that the best of many trials seldom exceeds by chance.
//!
//! In: noise floors, gains of null draws, counts of trials. Out: numbers in squared standard deviations. Never looks at a residual.

use super::random::Random;
use super::whitened_residuals::WhitenedResiduals;
use super::whiteness::quantile;

/// How rarely noise alone may pass for a cause. With as much for whiteness, and what models of noise miss, false alarms stay below 5 %.
pub const ALARM: f64 = 0.01;

/// Slower noise than this is a drift.
const SLOWEST: f64 = 0.995;

/// Noise as it comes out of the whitening: white but for the error of the floor's correlation, which is drawn, too.
#[must_use]
pub fn noise(whitened: &WhitenedResiduals, random: &mut Random) -> Vec<f64> {
    let off: Vec<f64> = whitened
        .floors
        .iter()
        .map(|floor| (floor.correlation + floor.error * random.normal()).clamp(-SLOWEST, SLOWEST) - floor.correlation)
        .collect();
    let mut stack = Vec::with_capacity(whitened.rows());
    for prepared in &whitened.records {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let correlation = whitened.floors[*output].correlation + off[*output];
            // In units of what is new in a row; it begins as it goes on.
            let mut last = random.normal() / (1.0 - correlation * correlation).sqrt();
            for used in &prepared.used[k] {
                let new = random.normal();
                // (1 - found B)/(1 - true B) on white noise
                stack.push(if *used { new + off[*output] * last } else { 0.0 });
                last = correlation * last + new;
            }
        }
    }
    stack
}

/// What the largest of many gains passes with the probability `ALARM`, from some draws of it: the tail of a maximum is Gumbel's (E. J. Gumbel, 1958), whose mean
/// and standard deviation settle long before a percentile does.
#[must_use]
pub fn point(largest: &[f64]) -> f64 {
    let n = largest.len().max(1) as f64;
    let mean = largest.iter().sum::<f64>() / n;
    let sd = (largest.iter().map(|gain| (gain - mean) * (gain - mean)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
    // Scale sd sqrt(6)/pi; Euler's constant stands between mean and mode.
    let scale = sd * 6.0_f64.sqrt() / std::f64::consts::PI;
    mean + scale * (-(-(1.0 - ALARM).ln()).ln() - 0.577_215_664_9)
}

/// What the best of so many trials gains with the probability `ALARM`, if each may fit so many numbers to noise: chi squared by Wilson and Hilferty's cube root
/// (1931), shared out among the trials (C. E. Bonferroni, 1936). It sees what first-order draws do not: numbers that bend a trace, and trials that were chosen by
/// looking at the residual.
#[must_use]
pub fn best_of(trials: usize, numbers: usize) -> f64 {
    let freedom = numbers.max(1) as f64;
    let ninth = 2.0 / (9.0 * freedom);
    freedom * (1.0 - ninth + quantile(ALARM / trials.max(1) as f64) * ninth.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_of_a_hundred_trials_with_two_numbers() {
        // Chi squared with two degrees of freedom passes x with the probability exp(-x/2): 2 ln(100/0.01) = 18.42. Wilson and Hilferty are 5 % above out there.
        assert!((best_of(100, 2) / 18.42 - 1.0).abs() < 0.06, "{}", best_of(100, 2));
        assert!((best_of(1, 1) / 6.635 - 1.0).abs() < 0.03, "{}", best_of(1, 1));
    }

    #[test]
    fn the_point_of_maxima_is_passed_once_in_a_hundred() {
        // The largest of 30 exponentials: its 99 % point is -ln(1 - 0.99^(1/30)) = 8.00.
        let mut random = Random::new(4);
        let largest: Vec<f64> = (0..4000).map(|_| (0..30).map(|_| -random.uniform().ln()).fold(0.0, f64::max)).collect();
        // 4000 draws know the mean to 0.02 and the standard deviation of 1.28 to 0.03: 3.1 times that.
        assert!((point(&largest) - 8.0).abs() < 0.15, "{}", point(&largest));
    }
}
