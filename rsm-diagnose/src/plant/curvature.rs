//! The curvature of the simulation with respect to the calibrated parameters.
//!
//! In: records and a fit. Out: whitened second derivatives, one for each parameter and each pair. Does not change the fit.

use super::levenberg::Fit;
use super::model::{Model, Place};
use super::whitened_residuals::{Simulated, WhitenedResiduals};

/// A second derivative of the simulation with respect to one unknown, or to a pair of unknowns.
#[derive(Debug, Clone)]
pub struct Curvature {
    /// The two unknowns; equal for a pure second derivative.
    pub unknowns: (usize, usize),
    /// Half of the pure second derivative, or the mixed one, whitened, in the scales of the unknowns.
    pub trace: Vec<f64>,
}

/// The second derivatives of the simulation with respect to the calibrated parameters of the plant. If a wave is missing, calibration may be wrong by
/// two standard deviations of a tolerance; the second-order effect of that is then larger than the wave. Derivatives that cannot be simulated are
/// left out.
#[must_use]
pub fn curvatures(whitened: &WhitenedResiduals, fit: &Fit) -> Vec<Curvature> {
    let calibrated = |k: &usize| matches!(fit.model.unknowns[*k].place, Place::Nominal(_));
    let which: Vec<usize> = (0..fit.model.unknowns.len()).filter(calibrated).collect();
    let pairs: Vec<(usize, usize)> =
        which.iter().enumerate().flat_map(|(place, &a)| which[..=place].iter().map(move |&b| (b, a))).collect();
    let moved = |(a, b): (usize, usize), sign: f64| {
        let mut model = fit.model.clone();
        for k in [a, b].into_iter().take(if a == b { 1 } else { 2 }) {
            // Bounds limit a search, not a finite difference.
            (model.unknowns[k].low, model.unknowns[k].high) = (f64::NEG_INFINITY, f64::INFINITY);
            model.set(k, model.value(k) + sign * model.unknowns[k].scale);
        }
        model
    };
    let models: Vec<Model> = pairs.iter().flat_map(|pair| [moved(*pair, 1.0), moved(*pair, -1.0)]).collect();
    let runs = whitened.run_all(&models);
    // Second differences over a scale: s(1) + s(-1) - 2 s(0).
    let both = |runs: &[Option<Vec<Simulated>>]| {
        let [one, other] = runs else { return None };
        let mut sum = whitened.changes(&fit.simulated, one.as_ref()?, 1.0);
        sum.iter_mut().zip(whitened.changes(&fit.simulated, other.as_ref()?, 1.0)).for_each(|(a, b)| *a = 0.5 * (*a + b));
        Some(sum)
    };
    let halves: Vec<Option<Vec<f64>>> = runs.chunks(2).map(both).collect();
    let half = |pair: (usize, usize)| pairs.iter().position(|it| *it == pair).and_then(|place| halves[place].as_ref());
    let bend = |&(a, b): &(usize, usize)| {
        let mut trace = half((a, b))?.clone();
        if a != b {
            // Half the second derivative along both unknowns is the sum of the two halves and the mixed one.
            for own in [half((a, a))?, half((b, b))?] {
                trace.iter_mut().zip(own).for_each(|(value, own)| *value -= own);
            }
        }
        Some(Curvature { unknowns: (a, b), trace })
    };
    pairs.iter().filter_map(bend).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, levenberg};
    use super::*;

    #[test]
    fn bends_tell_what_traces_miss_of_a_move_of_two_parameters() {
        let file = axis_under_steps::file("mass = 0.04\nviscous_friction = 0.08", "");
        let (whitened, nominal) = axis_under_steps::whitened(&file, &file, false);
        let fit = levenberg::linearised(&whitened, nominal.clone()).unwrap();
        let steps = [1.5, -1.0];
        let mut moved = nominal.clone();
        for (k, step) in steps.iter().enumerate() {
            moved.set(k, nominal.value(k) + step * nominal.unknowns[k].scale);
        }
        let mut missed = whitened.changes(&fit.simulated, &whitened.run(&moved).unwrap(), 1.0);
        let length = |values: &[f64]| values.iter().map(|it| it * it).sum::<f64>().sqrt();
        for (k, step) in steps.iter().enumerate() {
            let column = &fit.columns[fit.free.iter().position(|it| *it == k).unwrap()];
            let step = step * nominal.unknowns[k].scale;
            missed[column.first..].iter_mut().zip(&column.values).for_each(|(value, slope)| *value -= step * slope);
        }
        let straight = length(&missed);
        let curvatures = curvatures(&whitened, &fit);
        assert_eq!(curvatures.len(), 3);
        for Curvature { unknowns: (a, b), trace } in &curvatures {
            missed.iter_mut().zip(trace).for_each(|(value, bend)| *value -= steps[*a] * steps[*b] * bend);
        }
        // The third order of a move by 6 and 8 %.
        assert!(length(&missed) < 0.15 * straight, "{} {straight}", length(&missed));
    }
}
