//! Derives the constants of `coefficients.rs` in exact rationals, with a proven bound of each polynomial's error.
//!
//! In: the Taylor coefficients of a function and an interval. Out: a polynomial of lower degree with f64 coefficients, and a bound of
//! |polynomial - function| over the interval. The Taylor polynomial is expressed in Chebyshev polynomials of the interval. Dropping the last of these
//! has an error of at most its coefficient (Lanczos, "Applied Analysis", 1956, chapter 7: economisation). The bound is the sum of the dropped
//! coefficients, of the remainder of the Taylor series, and of the rounding of the coefficients.
//!
//! Only tests use this file: one of them compares `coefficients.rs` with the derived constants (`RSM_BLESS=1` writes them).

use num_traits::Signed;

use crate::number::{Precision, Rational, exact, integer};

/// A polynomial with f64 coefficients, and the bound of its error.
pub(super) struct Derived {
    pub coefficients: Vec<f64>,
    pub bound: Rational,
}

/// The polynomial for sum a(i) z^i over [low, high], with |z| < 1 there, or with coefficients that fall as fast as those of exp. Terms up to 40 are
/// used, and `ratio` bounds |a(i+1) z / a(i)| from there on.
pub(super) fn economised(taylor: impl Fn(u32) -> Rational, [low, high]: [f64; 2], ratio: f64, terms: usize) -> Derived {
    const TAYLOR: u32 = 40;
    let (low, high) = (exact(low), exact(high));
    let all: Vec<Rational> = (0..TAYLOR).map(&taylor).collect();
    let largest = low.abs().max(high.abs());
    // A geometric series from the first omitted term.
    let rest = taylor(TAYLOR).abs() * crate::number::power(&largest, TAYLOR) / (integer(1) - exact(ratio));
    // z = middle + half u, u in [-1, 1].
    let (middle, half) = ((&low + &high) / integer(2), (&high - &low) / integer(2));
    let mut in_u = shifted(&all, &middle, &half);
    let mut dropped = integer(0);
    while in_u.len() > terms {
        let degree = in_u.len() - 1;
        let chebyshev = chebyshev(degree);
        let share = &in_u[degree] / &chebyshev[degree];
        dropped += share.abs();
        in_u.iter_mut().zip(&chebyshev).for_each(|(a, t)| *a -= &share * t);
        in_u.pop();
    }
    // u = (z - middle)/half
    let in_z = shifted(&in_u, &(-&middle / &half), &(integer(1) / &half));
    let coefficients: Vec<f64> = in_z.iter().map(|a| Precision::F64.round(a)).collect();
    let moved = in_z.iter().zip(&coefficients).enumerate();
    let moved = moved.map(|(k, (a, rounded))| (exact(*rounded) - a).abs() * crate::number::power(&largest, k as u32));
    Derived { bound: rest + dropped + moved.sum::<Rational>(), coefficients }
}

/// The polynomial in u of a polynomial in z = shift + scale u.
fn shifted(polynomial: &[Rational], shift: &Rational, scale: &Rational) -> Vec<Rational> {
    // Horner's rule on polynomials: p := p (shift + scale u) + a
    let mut result: Vec<Rational> = vec![];
    for a in polynomial.iter().rev() {
        let mut next = vec![integer(0); (result.len() + 1).min(polynomial.len())];
        for (k, b) in result.iter().enumerate() {
            next[k] += b * shift;
            if k + 1 < next.len() {
                next[k + 1] += b * scale;
            }
        }
        next[0] += a;
        result = next;
    }
    result
}

/// The coefficients of T_n: T_n = 2 u T_(n-1) - T_(n-2).
fn chebyshev(degree: usize) -> Vec<Rational> {
    let (mut below, mut this) = (vec![integer(1)], vec![integer(0), integer(1)]);
    if degree == 0 {
        return below;
    }
    for _ in 1..degree {
        let mut next = vec![integer(0)];
        next.extend(this.iter().map(|a| integer(2) * a));
        next.iter_mut().zip(&below).for_each(|(a, b)| *a -= b);
        below = std::mem::replace(&mut this, next);
    }
    this
}

pub(super) fn factorial(n: u32) -> Rational {
    (1..=n).fold(integer(1), |product, k| product * integer(i64::from(k)))
}

/// atan(1/n) by its series, to 2^-400.
fn atan_of_inverse(n: i64) -> Rational {
    let square = integer(n * n);
    let mut power = integer(1) / integer(n);
    let mut sum = integer(0);
    // 25^-k, 4^-k: 200 terms are more than enough.
    for k in 0..200 {
        let term = &power / integer(2 * k + 1);
        sum = if k % 2 == 0 { sum + term } else { sum - term };
        power /= &square;
    }
    sum
}

/// Machin, 1706: pi/4 = 4 atan(1/5) - atan(1/239).
pub(super) fn half_pi() -> Rational {
    integer(2) * (integer(4) * atan_of_inverse(5) - atan_of_inverse(239))
}

pub(super) fn atan_of_half() -> Rational {
    atan_of_inverse(2)
}

/// log(a/b) = 2 atanh((a - b)/(a + b)) by its series, to 2^-400 for ratios up to 2.
fn log_of(ratio: &Rational) -> Rational {
    let s = (ratio - integer(1)) / (ratio + integer(1));
    let square = &s * &s;
    let mut power = s;
    let mut sum = integer(0);
    for k in 0..150 {
        sum += &power / integer(2 * k + 1);
        power *= &square;
    }
    integer(2) * sum
}

pub(super) fn log_of_two() -> Rational {
    log_of(&integer(2))
}

/// log 10 = 3 log 2 + log(10/8)
pub(super) fn log_of_ten() -> Rational {
    integer(3) * log_of_two() + log_of(&(integer(5) / integer(4)))
}

/// A number as a sum of parts. Each part except the last has few enough bits that its product with an integer of the remaining bits is exact.
pub(super) fn parts(value: &Rational, bits: u32, count: usize) -> Vec<f64> {
    let mut rest = value.clone();
    let mut parts = vec![];
    for k in 0..count {
        let nearest = Precision::F64.round(&rest);
        let part = if k + 1 == count {
            nearest
        } else {
            // Truncated, not rounded, so that every part has the sign of the number.
            f64::from_bits(nearest.to_bits() >> (53 - bits) << (53 - bits))
        };
        rest -= exact(part);
        parts.push(part);
    }
    parts
}

/// (name, description, polynomial)
pub(super) fn polynomials() -> Vec<(&'static str, &'static str, Derived)> {
    let sign = |i: u32| integer(if i.is_multiple_of(2) { 1 } else { -1 });
    let whole = |n: u32| integer(i64::from(n));
    vec![
        (
            "EXP",
            "exp r = 1 + r + r^2 EXP(r), |r| <= 0.3466",
            economised(|i| integer(1) / factorial(i + 2), [-0.3466, 0.3466], 0.5, 11),
        ),
        (
            "LOG",
            "log m = 2 atanh s = 2 s + s z LOG(z), z = s^2 <= 0.02945",
            economised(|i| integer(2) / whole(2 * i + 3), [0.0, 0.02945], 0.5, 7),
        ),
        (
            "SIN",
            "sin r = r + r z SIN(z), z = r^2 <= 0.617",
            economised(|i| -sign(i) / factorial(2 * i + 3), [0.0, 0.617], 0.5, 7),
        ),
        (
            "COS",
            "cos r = 1 - z/2 + z^2 COS(z), z = r^2 <= 0.617",
            economised(|i| sign(i) / factorial(2 * i + 4), [0.0, 0.617], 0.5, 6),
        ),
        (
            "SINH",
            "sinh r = r + r z SINH(z), z = r^2 <= 0.1202",
            economised(|i| integer(1) / factorial(2 * i + 3), [0.0, 0.1202], 0.5, 6),
        ),
        (
            "COSH",
            "cosh r = 1 + z/2 + z^2 COSH(z), z = r^2 <= 0.1202",
            economised(|i| integer(1) / factorial(2 * i + 4), [0.0, 0.1202], 0.5, 5),
        ),
        (
            "ATAN",
            "atan t = t + t z ATAN(z), z = t^2 <= 0.1112",
            economised(|i| -sign(i) / whole(2 * i + 3), [0.0, 0.1112], 0.5, 11),
        ),
        (
            "ASIN",
            "asin s = s + s z ASIN(z), z = s^2 <= 0.25",
            economised(
                |i| {
                    let n = i + 1;
                    factorial(2 * n) / (integer(4).pow(n as i32) * factorial(n) * factorial(n) * whole(2 * n + 1))
                },
                [0.0, 0.25],
                0.5,
                14,
            ),
        ),
    ]
}

/// The bound of a polynomial's error over its interval.
pub(super) fn polynomial_bound(name: &str) -> f64 {
    static BOUNDS: std::sync::OnceLock<Vec<(&str, f64)>> = std::sync::OnceLock::new();
    let bounds = BOUNDS.get_or_init(|| {
        let all = polynomials().into_iter();
        all.map(|(name, _, derived)| (name, Precision::F64.round_up(&derived.bound))).collect()
    });
    bounds.iter().find(|(other, _)| *other == name).expect("a polynomial of `coefficients.rs`").1
}
