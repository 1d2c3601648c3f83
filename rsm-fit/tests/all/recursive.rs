//! Recursive least squares, compared with batch least squares.

use rsm_fit::dd::Dd;
use rsm_fit::qr::{Compressed, Growing};
use rsm_fit::recursive::RecursiveLeastSquares;

use crate::folders::nist;

/// Powers 0 to `order` of x, in double-double.
fn powers(x: f64, order: usize) -> Vec<Dd> {
    (0..=order).scan(Dd::ONE, |power, _| Some(std::mem::replace(power, *power * Dd::from(x)))).collect()
}

fn batch(rows: &[(Vec<Dd>, f64)], weight: impl Fn(usize) -> f64) -> Vec<f64> {
    let width = rows[0].0.len();
    let mut compressed = Compressed::new(width + 1);
    for (k, (row, y)) in rows.iter().enumerate() {
        let root = Dd::from(weight(k)).sqrt();
        compressed.push(row.iter().copied().chain([Dd::from(*y)]).map(|x| x * root));
    }
    let candidates: Vec<usize> = (0..width).collect();
    Growing::of(&compressed.finish(), &candidates).unwrap().coefficients().into_iter().map(Dd::to_f64).collect()
}

fn one_at_a_time(rows: &[(Vec<Dd>, f64)], forgetting: f64) -> Vec<f64> {
    let mut state = RecursiveLeastSquares::new(rows[0].0.len(), forgetting);
    for (row, y) in rows {
        assert!(state.update(row, *y));
    }
    state.coefficients().expect("the rows determine the coefficients")
}

/// Both compute in double-double, so 12 digits remain even if f64 would have lost all: this is the bound that the function must satisfy.
fn agree_to_twelve_digits(found: &[f64], expected: &[f64]) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 1e-12, "found {found:e}, batch {expected:e}");
    }
}

/// A reproducible sequence of numbers in -1..1: the top bits of a linear congruential generator (Knuth's MMIX constants).
fn noise(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / f64::from(1 << 26) / f64::from(1 << 26) - 1.0
}

#[test]
fn factor_one_is_batch_on_random_rows() {
    let mut seed = 7;
    let rows: Vec<(Vec<Dd>, f64)> = (0..400)
        .map(|_| {
            let x: Vec<f64> = (0..6).map(|_| noise(&mut seed)).collect();
            let y = 3.0 + 2.0 * x[0] - x[1] + 0.1 * noise(&mut seed);
            (std::iter::once(Dd::ONE).chain(x.into_iter().map(Dd::from)).collect(), y)
        })
        .collect();
    agree_to_twelve_digits(&one_at_a_time(&rows, 1.0), &batch(&rows, |_| 1.0));
}

#[test]
fn factor_one_is_batch_on_the_worst_of_the_nist_sets() {
    let folder = nist();
    for (set, order) in [("Filip", 10), ("Wampler5", 5), ("Pontius", 2)] {
        let text = std::fs::read_to_string(folder.join(format!("{set}.csv"))).unwrap();
        let row = |line: &str| {
            let (y, x) = line.split_once(',').unwrap();
            (powers(x.trim().parse().unwrap(), order), y.trim().parse().unwrap())
        };
        let rows: Vec<(Vec<Dd>, f64)> = text.lines().skip(1).map(row).collect();
        agree_to_twelve_digits(&one_at_a_time(&rows, 1.0), &batch(&rows, |_| 1.0));
    }
}

#[test]
fn a_forgetting_factor_is_batch_with_fading_weights() {
    let mut seed = 3;
    let rows: Vec<(Vec<Dd>, f64)> = (0..120).map(|_| noise(&mut seed)).map(|x| (powers(x, 3), x.exp())).collect();
    let last = rows.len() - 1;
    agree_to_twelve_digits(&one_at_a_time(&rows, 0.95), &batch(&rows, |k| 0.95f64.powi((last - k) as i32)));
}
