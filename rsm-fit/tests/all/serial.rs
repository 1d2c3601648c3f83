//! Correlated errors of neighbouring rows: the warning, and intervals that contain the truth.

use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_fit::random::Random;
use rsm_fit::{Fit, Outcome, Select};

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

/// Five recordings of 100 rows, each with a slow input and slow noise; with or without their names. The reported error of rows left out, that on new
/// recordings, and the words of the warning.
fn of_recordings(seed: u64, is_named: bool) -> (f64, f64, String) {
    let mut random = Random::new(seed);
    let (mut rows, mut fresh) = ((vec![], vec![], vec![]), (vec![], vec![]));
    for run in 0..25 {
        let (mut x, mut noise) = (random.normal(), random.normal());
        for _ in 0..100 {
            let mut next = |now: f64| 0.97 * now + (1.0f64 - 0.97 * 0.97).sqrt() * random.normal();
            (x, noise) = (next(x), next(noise));
            let y = 10.0 + 3.0 * x + noise;
            if run < 5 {
                rows.0.push(x);
                rows.1.push(y);
                rows.2.push(run.to_string());
            } else {
                fresh.0.push(x);
                fresh.1.push(y);
            }
        }
    }
    let fit = Fit::new(&rows.0, &rows.1).select(Select::stepwise(8));
    let outcome = if is_named { fit.groups(&rows.2) } else { fit }.fit().unwrap();
    let tape = lower::surface(&outcome.checked().unwrap(), 0, Precision::F64);
    let mut surface = Interpreter::<f64>::new(&tape);
    let square: f64 = fresh.0.iter().zip(&fresh.1).map(|(x, y)| (surface.eval(&[*x]) - y).powi(2)).sum();
    let statistics = outcome.responses[0].statistics.as_ref().unwrap();
    let warned = statistics.warnings.iter().find(|warning| warning.kind == "correlated-residuals");
    let reported = statistics.cross_validation.as_ref().unwrap().errors.rmse;
    (reported, (square / fresh.0.len() as f64).sqrt(), warned.map_or(String::new(), |warning| warning.what.clone()))
}

#[test]
fn rows_left_out_at_random_are_those_of_the_same_recording() {
    for (is_named, [low, high]) in [(false, [0.6, 0.84]), (true, [0.8, 1.1])] {
        let all: Vec<(f64, f64, String)> = (0..12).map(|seed| of_recordings(seed, is_named)).collect();
        let mut shares: Vec<f64> = all.iter().map(|(reported, truth, _)| reported / truth).collect();
        shares.sort_by(f64::total_cmp);
        println!(
            "recordings {}: reported error over that on new ones {:.2} ({shares:.2?})",
            if is_named { "named" } else { "not named" },
            shares[6]
        );
        assert!((low..high).contains(&shares[6]), "{shares:?}");
        for (_, _, words) in &all {
            assert_eq!(words.contains("left out at random"), !is_named && !words.is_empty(), "{words}");
        }
        assert!(all.iter().filter(|it| !it.2.is_empty()).count() > 8);
    }
}
