//! `generated/coefficients/circle.toml` is what this computation gives, digit for digit: only operations that IEEE 754 rounds exactly are in it.
//!
//! `RSM_BLESS=1` writes the file.

use rsm_core::model::{Coding, Evidence, Input, Model, Outside, Surface, Term};
use rsm_core::model_file;

/// A polynomial's coefficients, the constant first, from those of Chebyshev polynomials: T_0 = 1, T_1 = x, T_(n+1) = 2 x T_n - T_(n-1).
fn powers(chebyshev: &[f64]) -> Vec<f64> {
    let n = chebyshev.len();
    let (mut before, mut now) = (vec![0.0; n], vec![0.0; n]);
    before[0] = 1.0;
    now[1] = 1.0;
    let mut sum = vec![0.0; n];
    sum[0] = chebyshev[0];
    sum[1] = chebyshev[1];
    for c in &chebyshev[2..] {
        let next: Vec<f64> = (0..n).map(|k| (if k > 0 { 2.0 * now[k - 1] } else { 0.0 }) - before[k]).collect();
        for k in 0..n {
            sum[k] += c * next[k];
        }
        before = now;
        now = next;
    }
    sum
}

/// J_n(z) = sum over k of (-1)^k (z/2)^(n + 2k)/(k! (n + k)!) (Abramowitz and Stegun, 9.1.10).
fn bessel(n: i32, z: f64) -> f64 {
    let mut term = (1..=n).fold(1.0, |product, k| product * (z / 2.0) / f64::from(k));
    let mut sum = term;
    for k in 1..20 {
        term = -term * (z / 2.0) * (z / 2.0) / (f64::from(k) * f64::from(n + k));
        sum += term;
    }
    sum
}

/// sin(z x) = 2 sum of (-1)^k J_(2k+1)(z) T_(2k+1)(x) (Abramowitz and Stegun, 9.1.45), to T_7.
fn sine() -> Vec<f64> {
    let z = std::f64::consts::FRAC_PI_2;
    let mut chebyshev = vec![0.0; 8];
    for (k, sign) in [(1, 2.0), (3, -2.0), (5, 2.0), (7, -2.0)] {
        chebyshev[k as usize] = sign * bessel(k, z);
    }
    powers(&chebyshev)
}

fn model() -> Model {
    let input = |name: &str, range| Input { name: name.into(), unit: "1".into(), range, outside: Outside::Clamp };
    let surface = |name: &str, input: &str, coefficients: Vec<f64>, evidence: Vec<(&str, String)>| Surface {
        name: name.into(),
        unit: "1".into(),
        inputs: vec![input.into()],
        coding: Coding::Range,
        terms: coefficients
            .into_iter()
            .enumerate()
            .filter(|(_, coefficient)| *coefficient != 0.0)
            .map(|(power, coefficient)| Term { powers: vec![power as u32], coefficient })
            .collect(),
        evidence: evidence.into_iter().map(|(key, text)| (key.to_string(), Evidence::Text(text))).collect(),
        ..Surface::default()
    };
    Model {
        name: "circle".into(),
        inputs: vec![input("quarter_turns", [-1.0, 1.0])],
        surfaces: vec![surface(
            "sine",
            "quarter_turns",
            sine(),
            vec![
                (
                    "source",
                    "sin(pi x/2) = 2 sum (-1)^k J_(2k+1)(pi/2) T_(2k+1)(x), to T_7 (Abramowitz and Stegun, 9.1.45)".into(),
                ),
                ("error", "the rest: 2 J_9(pi/2) + 2 J_11(pi/2) + ... < 6e-7".into()),
            ],
        )],
        compensators: vec![],
    }
}

#[test]
fn the_coefficient_file_is_what_is_computed() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../generated/coefficients/circle.toml");
    let head = "# What a rotating frame needs of the circle: the sine of a quarter turn.\n#\n\
                # Computed by targets/motor-loop/tests/circle.rs; RSM_BLESS=1 writes it.\n";
    let text = format!("{head}{}", model_file::write(&model()));
    if std::env::var_os("RSM_BLESS").is_some() {
        let beside = path.with_extension("new");
        std::fs::write(&beside, &text).and_then(|()| std::fs::rename(&beside, &path)).expect("the folder can be written");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(found, text, "run with RSM_BLESS=1 and look at the difference");
}

#[test]
fn the_rest_of_the_series_is_what_the_file_says() {
    let z = std::f64::consts::FRAC_PI_2;
    let rest: f64 = [9, 11, 13].into_iter().map(|n| 2.0 * bessel(n, z).abs()).sum();
    assert!(rest < 6.0e-7 && rest > 5.9e-7, "{rest:e}");
    // J_1(pi/2) of the tables (Abramowitz and Stegun, table 9.1, interpolated): 0.566825.
    assert!((bessel(1, z) - 0.566825).abs() < 1e-6, "{}", bessel(1, z));
}
