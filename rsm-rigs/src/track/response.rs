//! The response (29) of second order with delay, behind a lag of first order, at equal instants.
//!
//! In: delay, natural frequency, damping ratio, lag. Out: response to a unit step and to a unit ramp, and the rate of the former. Exact at any
//! damping, overdamped and critical ones included: the linear system is advanced by its matrix exponential, so nothing is divided by what
//! vanishes where two poles meet. A lag of 0 is none.

/// (29) with what precedes it: s'' + 2 zeta w s' + w^2 s = w^2 e(t), lag e' + e = 1 from t = delay on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Delay, in s.
    pub delay: f64,
    /// Natural frequency w, in rad/s.
    pub natural_frequency: f64,
    /// Damping ratio zeta.
    pub damping_ratio: f64,
}

/// Values of a response at the instants that were asked for.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Samples {
    /// Response to a unit step.
    pub step: Vec<f64>,
    /// Its rate, in 1/s.
    pub rate: Vec<f64>,
    /// Response to a unit ramp: the integral of `step`, in s.
    pub ramp: Vec<f64>,
}

/// s, s', e, integral of s, and the constant 1.
const N: usize = 5;

type Matrix = [[f64; N]; N];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = [[0.0; N]; N];
    for (row, into) in a.iter().zip(&mut c) {
        for (factor, other) in row.iter().zip(b) {
            for (sum, value) in into.iter_mut().zip(other) {
                *sum += factor * value;
            }
        }
    }
    c
}

/// exp(a): Taylor to the twelfth power after halving until the norm is below 1/2, then squared again. What the series leaves is
/// 0.5^13/13! = 2e-14 of a term of 1, below the noise of any sensor by ten orders.
fn exponential(a: &Matrix) -> Matrix {
    let norm = a.iter().map(|row| row.iter().map(|value| value.abs()).sum::<f64>()).fold(0.0, f64::max);
    let halvings = if norm > 0.5 { (norm / 0.5).log2().ceil() as i32 } else { 0 };
    let scale = 0.5f64.powi(halvings);
    let scaled = a.map(|row| row.map(|value| value * scale));
    let mut sum = [[0.0; N]; N];
    for (k, row) in sum.iter_mut().enumerate() {
        row[k] = 1.0;
    }
    let mut term = sum;
    for k in 1..=12 {
        term = times(&term, &scaled).map(|row| row.map(|value| value / f64::from(k)));
        for (row, added) in sum.iter_mut().zip(&term) {
            for (value, added) in row.iter_mut().zip(added) {
                *value += added;
            }
        }
    }
    for _ in 0..halvings {
        sum = times(&sum, &sum);
    }
    sum
}

impl Shape {
    fn system(&self, lag: f64) -> Matrix {
        let (w, zeta) = (self.natural_frequency, self.damping_ratio);
        let mut a = [[0.0; N]; N];
        a[0][1] = 1.0;
        a[1] = [-w * w, -2.0 * zeta * w, 0.0, 0.0, 0.0];
        a[3][0] = 1.0;
        if lag > 0.0 {
            a[1][2] = w * w;
            a[2] = [0.0, 0.0, -1.0 / lag, 0.0, 1.0 / lag];
        } else {
            a[1][4] = w * w;
        }
        a
    }

    /// The responses at `first`, `first + period`, ...: zero up to the delay.
    pub fn sample(&self, lag: f64, first: f64, period: f64, count: usize, into: &mut Samples) {
        for values in [&mut into.step, &mut into.rate, &mut into.ramp] {
            values.clear();
            values.reserve(count);
        }
        let a = self.system(lag);
        let by = |span: f64| exponential(&a.map(|row| row.map(|value| value * span)));
        let advance = by(period);
        let mut x: Option<[f64; N]> = None;
        for k in 0..count {
            let time = first + k as f64 * period;
            x = match x {
                Some(x) => Some(advance.map(|row| row.iter().zip(&x).map(|(a, x)| a * x).sum())),
                // From rest, over what of the first period is left.
                None if time > self.delay => Some(by(time - self.delay).map(|row| row[N - 1])),
                None => None,
            };
            let [step, rate, _, ramp, _] = x.unwrap_or_default();
            into.step.push(step);
            into.rate.push(rate);
            into.ramp.push(ramp);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(shape: Shape, lag: f64, times: usize, period: f64) -> Samples {
        let mut samples = Samples::default();
        shape.sample(lag, 0.0, period, times, &mut samples);
        samples
    }

    #[test]
    fn it_is_the_textbook_response_below_at_and_above_critical_damping() {
        let (w, period, delay) = (20.0f64, 0.01, 0.013);
        for zeta in [0.05f64, 0.7, 1.0, 2.5] {
            let found = at(Shape { delay, natural_frequency: w, damping_ratio: zeta }, 0.0, 100, period);
            for (k, found) in found.step.iter().enumerate() {
                let t = (k as f64 * period - delay).max(0.0);
                // Roots under (29): s = -zeta w +- w sqrt(zeta^2 - 1).
                let expected = if zeta < 1.0 {
                    let w_d = w * (1.0 - zeta * zeta).sqrt();
                    1.0 - (-zeta * w * t).exp() * ((w_d * t).cos() + zeta * w / w_d * (w_d * t).sin())
                } else if zeta == 1.0 {
                    1.0 - (-w * t).exp() * (1.0 + w * t)
                } else {
                    let root = (zeta * zeta - 1.0).sqrt();
                    let (a, b) = (w * (zeta - root), w * (zeta + root));
                    1.0 - (b * (-a * t).exp() - a * (-b * t).exp()) / (b - a)
                };
                // 100 products of matrices whose entries are below w^2 = 400: 100 * 400 * 2^-52 = 9e-12.
                assert!((found - expected).abs() < 1e-11, "zeta {zeta}, {k}: {found} {expected}");
            }
        }
    }

    #[test]
    fn behind_a_lag_it_satisfies_its_equation() {
        let shape = Shape { delay: 0.0, natural_frequency: 30.0, damping_ratio: 0.2 };
        let (lag, h) = (0.1, 1e-4);
        let found = at(shape, lag, 4000, h);
        for k in (10..3990).step_by(97) {
            let e = 1.0 - (-(k as f64) * h / lag).exp();
            let curvature = (found.rate[k + 1] - found.rate[k - 1]) / (2.0 * h);
            let left = curvature + 2.0 * 0.2 * 30.0 * found.rate[k] + 900.0 * found.step[k];
            // Central difference: h^2/6 w^4 max|s| = 1e-8/6 * 8.1e5 * 2 = 2.7e-3 of 900.
            assert!((left - 900.0 * e).abs() < 3e-3, "{k}: {left} {e}");
            let ramp = (found.ramp[k + 1] - found.ramp[k - 1]) / (2.0 * h);
            assert!((ramp - found.step[k]).abs() < 1e-5, "{k}"); // h^2/6 w^2 = 1.5e-6
        }
    }
}
