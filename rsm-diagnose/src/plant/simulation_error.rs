//! The error of a simulation, beside which a record may have too little noise.
//!
//! In: records, a fit, noise floors. Out: the smallest noise that each output may have. A record without noise comes from another simulation, by
//! whatever program. Both have an error, and a floor below it would make causes of it.

use super::levenberg::Fit;
use super::noise::NoiseFloor;
use super::whitened_residuals::{Simulated, WhitenedResiduals};
use rsm_sim::kind::OUTPUTS;

/// A noise of this share of the largest reading, or more, is far above the error of a simulation. Up to this noise the permitted error of the search
/// is at most the usual one of 1e-8 a step, a thousandth of it ([`WhitenedResiduals::tolerance`]).
const ABOVE_ANY_ERROR: f64 = 1e-5;

/// A run with this share of the permitted error has an error that is small beside that of the usual run.
const FINER: f64 = 1e-3;

/// The least noise over the error of a simulation. The program that wrote the record may permit a hundred times the error: 1e-6 a step is a careful
/// setting of most solvers. All the error of our own runs adds less than one squared standard deviation to ten thousand readings, so no test sees it.
const TIMES_THE_ERROR: f64 = 100.0;

/// The smallest noise of each output that the error of the simulation of a fit permits. It is 0 for outputs with clearly more noise.
pub(super) fn least_noise(whitened: &WhitenedResiduals, fit: &Fit, floors: &[NoiseFloor; OUTPUTS]) -> [f64; OUTPUTS] {
    let mut least = [0.0; OUTPUTS];
    let largest = largest_readings(whitened);
    let is_quiet = |output: usize| largest[output] > 0.0 && floors[output].sd < ABOVE_ANY_ERROR * largest[output];
    if !(0..OUTPUTS).any(is_quiet) {
        return least;
    }
    let mut finer = whitened.clone();
    finer.work.tolerance *= FINER;
    let Some(exact) = finer.run(&fit.model) else { return least };
    let errors = root_mean_squares(whitened, &fit.simulated, &exact);
    for output in (0..OUTPUTS).filter(|output| is_quiet(*output)) {
        least[output] = TIMES_THE_ERROR * errors[output];
    }
    least
}

/// The largest reading of each output.
fn largest_readings(whitened: &WhitenedResiduals) -> [f64; OUTPUTS] {
    let mut largest = [0.0_f64; OUTPUTS];
    for prepared in &whitened.records {
        for (k, output) in prepared.outputs.iter().enumerate() {
            largest[*output] = largest[*output].max(prepared.largest_reading(k));
        }
    }
    largest
}

/// The root mean square of the difference of two simulations, for each output over all rows that count.
fn root_mean_squares(whitened: &WhitenedResiduals, usual: &[Simulated], exact: &[Simulated]) -> [f64; OUTPUTS] {
    let mut sums = [(0.0, 0_usize); OUTPUTS];
    for ((prepared, usual), exact) in whitened.records.iter().zip(usual).zip(exact) {
        for (k, output) in prepared.outputs.iter().enumerate() {
            let rows = usual[k].iter().zip(&exact[k]).zip(&prepared.used[k]).filter(|(_, used)| **used);
            for ((usual, exact), _) in rows {
                sums[*output].0 += (usual - exact).powi(2);
                sums[*output].1 += 1;
            }
        }
    }
    sums.map(|(sum, count)| (sum / count.max(1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, levenberg};
    use super::*;

    /// The smallest noise of the position of a rubbing axis over its largest reading, and the real error of its simulation over it.
    fn of_a_rubbing_axis(noisy: bool) -> (f64, f64) {
        let file = axis_under_steps::file("", &axis_under_steps::friction(2.0));
        let (mut whitened, model) = axis_under_steps::whitened(&file, &file, noisy);
        whitened.work.tolerance = 1e-6;
        let fit = levenberg::fit(&whitened, model, 1).unwrap();
        let floors = [NoiseFloor::white(if noisy { 1e-5 } else { 1e-12 }); OUTPUTS];
        let largest = largest_readings(&whitened)[0];
        let mut exact = whitened.clone();
        exact.work.tolerance = 1e-13;
        let errors = root_mean_squares(&whitened, &fit.simulated, &exact.run(&fit.model).unwrap());
        (least_noise(&whitened, &fit, &floors)[0] / largest, errors[0] / largest)
    }

    #[test]
    fn a_quiet_output_has_a_hundred_times_the_error_of_its_simulation() {
        let (least, error) = of_a_rubbing_axis(false);
        assert!(error > 1e-11, "{error}");
        // The error of the run that stands for the exact one is small beside it.
        assert!((least / (TIMES_THE_ERROR * error) - 1.0).abs() < 0.1, "{least} {error}");
    }

    #[test]
    fn an_output_with_noise_pays_nothing() {
        let (least, _) = of_a_rubbing_axis(true);
        assert_eq!(least, 0.0);
    }
}
