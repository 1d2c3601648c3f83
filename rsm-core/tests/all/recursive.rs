//! A surface that follows measured responses: against exact weighted least squares, bounded and positive without excitation, frozen on bad samples.

use crate::random::Random;
use num_rational::BigRational as Rational;
use num_traits::{ToPrimitive as _, Zero as _};
use rsm_core::check::Checked;
use rsm_core::lower::{self, Follower, Frozen, Recursive};
use rsm_core::number::{Precision, exact, integer, power};
use rsm_core::run::Interpreter;
use rsm_core::source::Source;

/// Two inputs on [-1, 1], so that the coded variables are the inputs; the support cuts one corner.
const MODEL: &str = "format = 1\nmodel = \"m\"\n\
    [inputs.a]\nunit = \"A\"\nrange = [-1.0, 1.0]\noutside = \"clamp\"\n\
    [inputs.b]\nunit = \"V\"\nrange = [-1.0, 1.0]\noutside = \"extrapolate\"\n\
    [surfaces.s]\nunit = \"N\"\ninputs = [\"a\", \"b\"]\noutput_range = [-3.0, 3.0]\n\
    support = [{ normal = [1.0, 1.0], bound = 1.5 }]\n\
    terms = [{ powers = [0, 0], coefficient = 1.25 }, { powers = [1, 0], coefficient = -0.5 }, { powers = [0, 1], coefficient = 0.75 },\n\
    { powers = [2, 1], coefficient = 0.0 }]\n";

/// Powers of each term of `MODEL`.
const POWERS: [[u32; 2]; 4] = [[0, 0], [1, 0], [0, 1], [2, 1]];

fn checked(text: &str) -> Checked {
    Checked::read(&Source::new("m.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

fn follower(precision: Precision, settings: &Recursive) -> Follower {
    let checked = checked(MODEL);
    assert_eq!(settings.refusal(&checked.model().surfaces[0]), None);
    lower::recursive(&checked, 0, precision, settings)
}

fn started<'f>(follower: &'f Follower) -> Interpreter<'f, f64> {
    let mut interpreter = Interpreter::new(&follower.update);
    interpreter.set_states(&follower.start);
    interpreter
}

/// In [-1, 1], a multiple of 1/8: exact references stay short.
fn eighths(random: &mut Random) -> f64 {
    (random.share() * 17.0).floor() / 8.0 - 1.0
}

fn row(a: f64, b: f64) -> Vec<Rational> {
    POWERS.iter().map(|[of_a, of_b]| power(&exact(a), *of_a) * power(&exact(b), *of_b)).collect()
}

/// The rows of a least-squares problem, with their weights.
#[derive(Default)]
struct Rows(Vec<(Vec<Rational>, Rational, Rational)>);

impl Rows {
    fn fade(&mut self, forgetting: f64) {
        self.0.iter_mut().for_each(|(_, _, weight)| *weight *= exact(forgetting));
    }

    fn push(&mut self, row: Vec<Rational>, response: f64, weight: Rational) {
        self.0.push((row, exact(response), weight));
    }

    /// The solution, and the inverse of the information matrix, exactly: Gauss-Jordan elimination of the normal equations.
    fn solved(&self) -> (Vec<Rational>, Vec<Vec<Rational>>) {
        let n = POWERS.len();
        let sum = |of: &dyn Fn(&[Rational], &Rational) -> Rational| {
            self.0.iter().fold(Rational::zero(), |sum, (row, response, weight)| sum + of(row, response) * weight)
        };
        let mut matrix: Vec<Vec<Rational>> = (0..n)
            .map(|i| {
                let own = (0..n).map(|j| sum(&|row, _| &row[i] * &row[j]));
                let unit = (0..n).map(|j| integer(i64::from(i == j)));
                own.chain([sum(&|row, response| &row[i] * response)]).chain(unit).collect()
            })
            .collect();
        for k in 0..n {
            let pivot = matrix[k][k].clone();
            matrix[k].iter_mut().for_each(|it| *it /= &pivot);
            let own = matrix[k].clone();
            for other in (0..n).filter(|other| *other != k) {
                let factor = matrix[other][k].clone();
                matrix[other].iter_mut().zip(&own).for_each(|(it, own)| *it -= own * &factor);
            }
        }
        let solution = matrix.iter().map(|row| row[n].clone()).collect();
        (solution, matrix.into_iter().map(|row| row[n + 1..].to_vec()).collect())
    }
}

fn number(value: &Rational) -> f64 {
    value.to_f64().expect("a number")
}

/// Settings whose numbers are short in binary, so that exact references stay short.
fn settings(forgetting: f64) -> Recursive {
    Recursive { forgetting, noise: 0.25, gate: 64.0, limit: 0.5, start: 0.25 }
}

/// The variance of the measurement of one coefficient, s = p lambda^(n-1)/(1 - lambda^n), and that at the start, from the words of the module.
fn variances(settings: &Recursive) -> (Rational, Rational) {
    let n = POWERS.len() as u32;
    let (forgetting, ratio) = (exact(settings.forgetting), exact(settings.limit) / exact(settings.noise));
    let largest = &ratio * &ratio;
    let s = &largest * power(&forgetting, n - 1) / (integer(1) - power(&forgetting, n));
    let start = exact(settings.start) / exact(settings.noise);
    (s, (&start * &start).min(largest * power(&forgetting, n)))
}

#[test]
fn coefficients_and_covariance_are_those_of_exact_weighted_least_squares() {
    for forgetting in [1.0, 0.9375] {
        let settings = settings(forgetting);
        let follower = follower(Precision::F64, &settings);
        let mut update = started(&follower);
        let n = POWERS.len();
        let (s, start) = if forgetting == 1.0 { (integer(1), integer(1)) } else { variances(&settings) };
        let mut rows = Rows::default();
        let unit = |k: usize| (0..n).map(|j| integer(i64::from(j == k))).collect::<Vec<Rational>>();
        for k in 0..n {
            rows.push(unit(k), follower.start[k], integer(1) / &start);
        }
        let mut random = Random(17);
        for step in 0..60 {
            let (a, b) = (eighths(&mut random), eighths(&mut random).min(0.5));
            let measured = eighths(&mut random) * 2.0;
            if forgetting < 1.0 {
                rows.fade(forgetting);
                let k = step % n;
                rows.push(unit(k), update.states()[k], integer(1) / &s);
            }
            rows.push(row(a, b), measured, integer(1));
            update.step(&[a, b, measured]);
            assert_eq!(update.results().nth(2), Some(0.0), "step {step} at {a} {b}");
        }
        let (solution, inverse) = rows.solved();
        // A step rounds about 8 n times on the way to one number, relative to numbers up to the largest coefficient on the way (2). The condition
        // of P bounds how the rounding of one entry changes the others: n times the largest entry of P times the sum of the weights, which is the
        // largest entry of its inverse at most.
        let information: f64 = rows.0.iter().map(|(_, _, weight)| number(weight)).sum();
        let largest = inverse.iter().flatten().map(|it| number(it).abs()).fold(0.0, f64::max);
        let bound = 60.0 * 8.0 * n as f64 * f64::EPSILON / 2.0 * (n as f64 * information * largest);
        assert!(bound < 1e-10, "{bound:e}");
        let states = update.states();
        for k in 0..n {
            let off = number(&(exact(states[k]) - &solution[k])).abs();
            assert!(off <= 2.0 * bound, "forgetting {forgetting}, coefficient {k}: {off:e}, bound {bound:e}");
        }
        let found = lower::variances_of(states, n);
        for k in 0..n {
            let off = (found[k] - number(&inverse[k][k])).abs();
            assert!(off <= largest * bound, "forgetting {forgetting}, variance {k}: {off:e}, bound {bound:e}");
        }
    }
}

#[test]
fn a_high_limit_leaves_exponential_weights_alone() {
    let settings = Recursive { forgetting: 0.9375, noise: 0.25, gate: 1e5, limit: 2048.0, start: 2048.0 };
    let follower = follower(Precision::F64, &settings);
    let mut update = started(&follower);
    let (mut rows, mut random) = (Rows::default(), Random(5));
    let mut way: Vec<Vec<f64>> = vec![follower.start[..POWERS.len()].to_vec()];
    for _ in 0..80 {
        let (a, b) = (eighths(&mut random), eighths(&mut random).min(0.5));
        let measured = eighths(&mut random) * 2.0;
        rows.fade(0.9375);
        rows.push(row(a, b), measured, integer(1));
        update.step(&[a, b, measured]);
        assert_eq!(update.results().nth(2), Some(0.0));
        way.push(update.states()[..POWERS.len()].to_vec());
    }
    let (solution, inverse) = rows.solved();
    // The rows of the bound have together at most the information lambda^(1-n)/p in each direction, and pull towards earlier coefficients:
    // b - b_pure = (A + L)^-1 L (b_earlier - b_pure).
    let pull = 0.9375f64.powi(-3) / (2048.0f64 / 0.25).powi(2);
    let sum_of_inverse = |k: usize| inverse[k].iter().map(|it| number(it).abs()).sum::<f64>();
    let farthest = |k: usize| way.iter().map(|b| (b[k] - number(&solution[k])).abs()).fold(0.0, f64::max);
    let all = (0..POWERS.len()).map(farthest).fold(0.0, f64::max);
    for (k, (found, truth)) in update.states().iter().zip(&solution).enumerate() {
        let off = (found - number(truth)).abs();
        // 10^-9 for rounding, see the test above.
        let bound = pull * sum_of_inverse(k) * all + 1e-9;
        assert!(off <= bound, "coefficient {k}: {off:e}, bound {bound:e}");
        assert!(bound < 1e-4, "{bound:e}");
    }
}

/// The covariance U D U' of a state.
fn covariance(states: &[f64], n: usize) -> Vec<Vec<f64>> {
    let mut factor = states[2 * n..].iter();
    let rows: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let entry = |j: usize, factor: &mut std::slice::Iter<'_, f64>| match j {
                j if j < i => 0.0,
                j if j == i => 1.0,
                _ => *factor.next().expect("an entry of each pair"),
            };
            (0..n).map(|j| entry(j, &mut factor)).collect()
        })
        .collect();
    let entry = |i: usize, j: usize| (0..n).map(|k| rows[i][k] * states[n + k] * rows[j][k]).sum();
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

/// A step in one precision: from a sample to the reason and the states.
type Step<'f> = Box<dyn FnMut(&[f64; 3]) -> (f64, Vec<f64>) + 'f>;

/// 10^5 steps at one point, then moved by tiny amounts, with bad rows between: the largest variance over the limit's, and the states.
fn without_excitation(precision: Precision) -> f64 {
    let settings = Recursive { forgetting: 0.99, noise: 0.25, gate: 5.0, limit: 0.5, start: 0.25 };
    let follower = follower(precision, &settings);
    let n = POWERS.len();
    let mut random = Random(3);
    let mut worst: f64 = 0.0;
    let mut frozen = 0;
    let mut step: Step<'_> = match precision {
        Precision::F64 => {
            let mut update = Interpreter::<f64>::new(&follower.update);
            update.set_states(&follower.start);
            Box::new(move |at| {
                update.step(at);
                (update.results().nth(2).expect("a reason"), update.states().to_vec())
            })
        }
        Precision::F32 => {
            let mut update = Interpreter::<f32>::new(&follower.update);
            update.set_states(&follower.start.iter().map(|it| *it as f32).collect::<Vec<_>>());
            Box::new(move |at| {
                update.step(&at.map(|it| it as f32));
                let states = update.states().iter().map(|it| f64::from(*it)).collect();
                (f64::from(update.results().nth(2).expect("a reason")), states)
            })
        }
    };
    for k in 0..100_000 {
        let noise = 0.5 * (random.share() - 0.5);
        let still = if k < 50_000 { 0.0 } else { 1e-7 * (random.share() - 0.5) };
        let at = match k % 100 {
            7 => [f64::NAN, 0.5, 1.0],
            23 => [0.25, 0.5, f64::INFINITY],
            51 => [0.25, 1.5, 1.0],
            77 => [0.25, 0.5, 1e9],
            _ => [0.25 + still, 0.5, 1.5 + noise],
        };
        let (reason, states) = step(&at);
        frozen += i32::from(reason != 0.0);
        assert!(states.iter().all(|it| it.is_finite()), "step {k}: {states:?}");
        assert!(states[n..2 * n].iter().all(|d| *d > 0.0), "step {k}: {states:?}");
        let p = covariance(&states, n);
        // The largest eigenvalue is at most the limit; the diagonal is a lower bound of it, and the power method finds it from below.
        let mut x = vec![1.0; n];
        for _ in 0..if k % 1000 == 0 { 200 } else { 1 } {
            let y: Vec<f64> = p.iter().map(|row| row.iter().zip(&x).map(|(a, b)| a * b).sum()).collect();
            let length = y.iter().map(|it| it * it).sum::<f64>().sqrt();
            let before = x.iter().map(|it| it * it).sum::<f64>().sqrt();
            worst = worst.max(length / before);
            x = y.into_iter().map(|it| it / length).collect();
        }
        worst = (0..n).fold(worst, |worst, i| worst.max(p[i][i]));
    }
    assert_eq!(frozen, 4000, "{frozen} frozen");
    worst / (0.5f64 / 0.25).powi(2)
}

#[test]
fn without_excitation_and_with_bad_rows_the_covariance_is_positive_and_below_its_limit() {
    // About 8 n roundings a step, which fade with a memory of n/(1 - lambda^n) = 100 steps: 100 * 8 * 4 units of roundoff.
    let share = without_excitation(Precision::F64);
    assert!((0.9..=1.0 + 3200.0 * f64::EPSILON / 2.0).contains(&share), "{share}");
    let share = without_excitation(Precision::F32);
    assert!((0.9..=1.0 + 3200.0 * f64::from(f32::EPSILON) / 2.0).contains(&share), "{share}");
}

#[test]
fn a_frozen_sample_changes_no_bit_of_the_state() {
    let follower = follower(Precision::F64, &settings(0.9375));
    let mut update = started(&follower);
    let mut random = Random(11);
    let bits = |update: &Interpreter<'_, f64>| update.states().iter().map(|it| it.to_bits()).collect::<Vec<u64>>();
    for _ in 0..50 {
        update.step(&[eighths(&mut random), eighths(&mut random).min(0.5), eighths(&mut random)]);
        let before = bits(&update);
        for (at, why) in [
            ([f64::NAN, 0.0, 0.0], Frozen::NotFinite),
            ([0.0, f64::NEG_INFINITY, 0.0], Frozen::NotFinite),
            ([0.0, 0.0, f64::NAN], Frozen::NotFinite),
            ([0.0, 0.0, f64::INFINITY], Frozen::NotFinite),
            ([1.0f64.next_up(), 0.0, 0.0], Frozen::Outside),
            ([0.0, (-1.0f64).next_down(), 0.0], Frozen::Outside),
            // Inside both ranges, outside the support.
            ([1.0, 0.75, 0.0], Frozen::Outside),
            ([0.0, 0.0, 1e5], Frozen::Error),
            ([0.0, 0.0, -1e300], Frozen::Error),
        ] {
            update.step(&at);
            assert_eq!(update.results().nth(2).and_then(Frozen::of_number), Some(why), "{at:?}");
            assert_eq!(bits(&update), before, "{at:?}");
        }
        // At the bounds a sample is used.
        update.step(&[1.0, 0.5, 0.0]);
        assert_eq!(update.results().nth(2), Some(0.0));
        assert_ne!(bits(&update), before);
    }
    // The product of a variance and a regressor overflows.
    let mut states = follower.start.clone();
    let (d1, u0_1, turn) = (POWERS.len() + 1, 2 * POWERS.len(), states.len() - 1);
    (states[d1], states[u0_1], states[turn]) = (1e200, 1e200, 2.0);
    update.set_states(&states);
    update.step(&[1.0, 0.5, 1.0]);
    assert_eq!(update.results().nth(2).and_then(Frozen::of_number), Some(Frozen::State));
    assert_eq!(update.states(), states);
}

#[test]
fn the_gate_is_a_number_of_standard_deviations_of_the_error() {
    let follower = follower(Precision::F64, &Recursive { gate: 3.0, ..settings(0.9375) });
    let mut update = started(&follower);
    let mut random = Random(29);
    for _ in 0..200 {
        let states = update.states().to_vec();
        let (a, b) = (eighths(&mut random), eighths(&mut random).min(0.5));
        update.step(&[a, b, 0.0]);
        let results: Vec<f64> = update.results().collect();
        let (predicted, limit) = (-results[0], 3.0 * 0.25 * results[1].sqrt());
        // A millionth of the limit on both sides, far above rounding.
        for (share, is_used) in [(1.0 - 1e-6, true), (1.0 + 1e-6, false), (-1.0 + 1e-6, true), (-1.0 - 1e-6, false)] {
            update.set_states(&states);
            update.step(&[a, b, predicted + share * limit]);
            assert_eq!(update.results().nth(2) == Some(0.0), is_used, "{share}");
            // One step moves no coefficient by more than the gate times the limit.
            let moved = (0..POWERS.len()).map(|k| (update.states()[k] - states[k]).abs()).fold(0.0, f64::max);
            assert!(moved <= 3.0 * 0.5, "{moved}");
        }
    }
}

#[test]
fn the_adapted_surface_begins_as_the_surface_and_follows() {
    for precision in Precision::ALL {
        let text = MODEL.replace("powers = [2, 1], coefficient = 0.0", "powers = [2, 1], coefficient = 3.3");
        let checked = checked(&text);
        let follower = lower::recursive(&checked, 0, precision, &settings(0.9375));
        let surface = lower::surface(&checked, 0, precision);
        // Four terms of at most 3.3: 16 roundings of numbers below 8.
        let bound = 16.0 * 8.0 * precision.unit_roundoff();
        let mut limited = 0;
        for a in -8..=8 {
            for b in -8..=8 {
                let at = [f64::from(a) / 8.0, f64::from(b) / 8.0];
                let (found, truth) = match precision {
                    Precision::F64 => {
                        let mut adapted = Interpreter::<f64>::new(&follower.adapted);
                        adapted.set_states(&follower.start[..4]);
                        (adapted.step(&at), Interpreter::<f64>::new(&surface).eval(&at))
                    }
                    Precision::F32 => {
                        let mut adapted = Interpreter::<f32>::new(&follower.adapted);
                        adapted.set_states(&[0, 1, 2, 3].map(|k| follower.start[k] as f32));
                        let at = at.map(|it| it as f32);
                        (f64::from(adapted.step(&at)), f64::from(Interpreter::<f32>::new(&surface).eval(&at)))
                    }
                };
                limited += i32::from(truth == 3.0);
                assert!((found - truth).abs() <= bound, "{at:?}: {found} {truth}");
            }
        }
        assert!(limited > 5, "{limited}");
    }
}

#[test]
fn an_odd_surface_with_a_hinge_follows_on_both_sides() {
    let text = "format = 1\nmodel = \"m\"\n[inputs.i]\nunit = \"A\"\nrange = [-4.0, 4.0]\n[surfaces.s]\nunit = \"N\"\ninputs = [\"i\"]\n\
        symmetry = { i = \"odd\" }\nknots = [{ input = \"i\", at = 2.0 }]\n\
        terms = [{ powers = [1, 0], coefficient = 2.0 }, { powers = [0, 1], coefficient = 0.0 }]\n";
    let checked = checked(text);
    let follower = lower::recursive(&checked, 0, Precision::F64, &Recursive { forgetting: 0.98, limit: 64.0, ..settings(1.0) });
    let mut update = started(&follower);
    // y = 3 i/4 up to 2 A, then 1 N more for an ampere: coefficients 3 and 4 of the coded variables |i|/4 and max(0, |i|/4 - 1/2).
    let truth = |i: f64| i.signum() * (0.75 * i.abs() + (i.abs() - 2.0).max(0.0));
    let mut random = Random(8);
    for _ in 0..600 {
        let i = 8.0 * random.share() - 4.0;
        let before = update.states().to_vec();
        update.step(&[i, truth(i)]);
        let phi = [i.abs() / 4.0, (i.abs() / 4.0 - 0.5).max(0.0)];
        let error = truth(i) - i.signum() * (before[0] * phi[0] + before[1] * phi[1]);
        // A few roundings of numbers below 8.
        assert!((update.results().next().expect("an error") - error).abs() < 1e-14);
    }
    // 0.98^600 = 5e-6 of the start is left.
    assert!((update.states()[0] - 3.0).abs() < 1e-4 && (update.states()[1] - 4.0).abs() < 1e-4, "{:?}", update.states());
    let mut adapted = Interpreter::<f64>::new(&follower.adapted);
    adapted.set_states(&update.states()[..2]);
    assert!((adapted.step(&[-3.5]) - truth(-3.5)).abs() < 1e-3);
}

#[test]
fn settings_that_do_not_suit_are_refused() {
    let surface = &checked(MODEL).model().surfaces[0].clone();
    let good = settings(0.99);
    for (settings, words) in [
        (Recursive { forgetting: 0.4, ..good.clone() }, "forgetting: found 0.4, expected 0.5 to 1"),
        (Recursive { forgetting: f64::NAN, ..good.clone() }, "forgetting: found NaN"),
        (Recursive { noise: 0.0, ..good.clone() }, "noise: found 0, expected a finite number above 0"),
        (Recursive { gate: f64::INFINITY, ..good.clone() }, "gate: found inf"),
        (Recursive { start: 0.75, ..good.clone() }, "start: found 0.75, expected at most the limit 0.5"),
        (Recursive { limit: 1e7, ..good.clone() }, "limit: found 4e7 times the noise"),
        (Recursive { gate: 1e31, ..good.clone() }, "for the product with the gate"),
    ] {
        let why = settings.refusal(surface).unwrap_or_else(|| panic!("{words}"));
        assert!(why.contains(words), "{why}");
    }
    let natural = MODEL.replace("output_range", "coding = \"none\"\noutput_range");
    assert!(good.refusal(&checked(&natural).model().surfaces[0]).is_some_and(|why| why.contains("expected coded ones")));
    let named = MODEL.replace("inputs.b]", "inputs.measured]").replace("\"b\"", "\"measured\"");
    assert!(good.refusal(&checked(&named).model().surfaces[0]).is_some_and(|why| why.contains("its input `measured`")));
}
