//! Correlated errors of neighbouring rows: the warning, and intervals that contain the truth.

use rsm_fit::random::Random;
use rsm_fit::{Fit, Outcome};

const ROWS: usize = 400;

/// A recording whose input changes slowly. y = 10 + 3 x + noise, noise AR(1) with a standard deviation of 1.
fn recording(seed: u64, memory: f64) -> Outcome {
    let mut random = Random::new(seed);
    let mut next = |now: f64, memory: f64| memory * now + (1.0 - memory * memory).sqrt() * random.normal();
    let (mut x, mut noise) = (next(0.0, 0.0), next(0.0, 0.0));
    let (mut inputs, mut response) = (Vec::new(), Vec::new());
    for _ in 0..ROWS {
        (x, noise) = (next(x, memory), next(noise, memory));
        inputs.push(x);
        response.push(10.0 + 3.0 * x + noise);
    }
    Fit::new(&inputs, &response).order(1).fit().unwrap()
}

#[test]
fn intervals_of_a_recording_hold_the_truth() {
    let (recordings, mut ordinary, mut related) = (200, 0, 0);
    for seed in 0..recordings {
        let outcome = recording(seed, 0.8);
        let statistics = outcome.responses[0].statistics.as_ref().unwrap();
        assert!(statistics.warnings.iter().any(|warning| warning.kind == "correlated-residuals"), "{seed}");
        let serial = statistics.serial.as_ref().unwrap();
        assert_eq!(serial.order, "rows");
        let input = &outcome.model.inputs[0];
        let half = (input.range[1] - input.range[0]) / 2.0;
        let truth = 3.0 * half;
        let place = statistics.terms.iter().position(|term| term.powers == [1]).unwrap();
        let term = &statistics.terms[place];
        ordinary += usize::from((term.coefficient - truth).abs() <= 1.966 * term.standard_error.unwrap());
        let [low, high] = serial.intervals[place];
        related += usize::from(low <= truth && truth <= high);
    }
    let share = |count: usize| count as f64 / recordings as f64;
    // The nominal level is 95 %. The variance is (1 + 0.64)/(1 - 0.64) = 4.6 times the ordinary one, the error 2.1 times, which gives a level of 64
    // %; two standard deviations of 200 recordings are 7 %. The intervals of Newey and West approach 95 % from below; the lower bound is the measured
    // level (0.905) minus two standard deviations.
    assert!(share(ordinary) < 0.75, "ordinary: {}", share(ordinary));
    assert!((0.86..=0.99).contains(&share(related)), "related: {}", share(related));
}

#[test]
fn white_noise_has_no_second_standard_errors() {
    let alarms = (0..100).filter(|seed| recording(*seed, 0.0).responses[0].statistics.as_ref().unwrap().serial.is_some());
    // 1 % of 100, plus four standard deviations.
    assert!(alarms.count() <= 5);
}
