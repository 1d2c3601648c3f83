//! Points of the voltage limit: current vectors with the speed at which they meet it, from the bench or from a record, and how far surfaces are from
//! them.
//!
//! In: points of the bench, or a record of a motor that turns. Out: [`LimitPoint`]s, and the error of a surface's current advance at each. A record
//! need not come near the limit: in steady turning it shows the flux linkages of its current vector, psi_d = (v_q - r i_q)/w_e and psi_q = -(v_d - r
//! i_d)/w_e after (17) and (18), whatever makes them, and a linkage says at which speed the limit is met: |r i + w_e J psi| = V. Never asks a model
//! of the motor for more than its resistance.

use rsm_core::check::Checked;
use rsm_core::order;
use rsm_core::run::Interpreter;
use rsm_core::source::Faults;

use super::{Outcome, Point};
use crate::motor::controller::Known;
use crate::motor::surface::weakening_tape;
use rsm_sim::record::Record;

/// A current vector at the speed at which it meets the voltage limit, seen forwards: a motor that turns backwards is mirrored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitPoint {
    /// Direct current, in A.
    pub i_d: f64,
    /// Quadrature current, in A; negative when braking.
    pub i_q: f64,
    /// Mechanical speed, in rad/s.
    pub speed: f64,
}

/// Length of a window, in s: currents settle within ten milliseconds, and the means of 0.2 A of noise at 1 kHz are then known to 0.05 A.
const WINDOW: f64 = 0.02;

/// Rows of a window at least.
const LEAST_ROWS: usize = 8;

/// What changes within a window by more than this share is no steady turning: the voltage of L di/dt against the whole, the speed.
const STEADY: f64 = 0.02;

/// Slowest speed of a window, as a share of that at which the magnets alone meet the limit: what is wrong with the resistive drop is carried up by
/// the inverse of it.
const SLOWEST: f64 = 0.25;

/// Shortest current vector, as a share of the longest: the bench's smallest depth. A shorter one has no angle worth the name.
const SHORTEST: f64 = 0.1;

/// The mean and the 99th percentile of the magnitudes of angle errors, in degrees; 0 where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleErrors {
    /// The mean.
    pub mean: f64,
    /// The least that 99 of 100 do not exceed.
    pub p99: f64,
}

impl AngleErrors {
    /// Of magnitudes.
    #[must_use]
    pub fn of(mut errors: Vec<f64>) -> Self {
        order::sort(&mut errors);
        let count = errors.len().max(1);
        let rank = (0.99 * count as f64).ceil() as usize;
        AngleErrors {
            mean: errors.iter().sum::<f64>() / count as f64,
            p99: errors.get(rank.clamp(1, count) - 1).copied().unwrap_or(0.0),
        }
    }
}

/// The points of a bench that came to the limit.
#[must_use]
pub fn of_bench(outcomes: &[Outcome]) -> Vec<LimitPoint> {
    let point = |it: &Outcome| match it {
        Outcome::AtLimit(Point { i_d, i_q, speed, .. }) => Some(LimitPoint { i_d: *i_d, i_q: *i_q, speed: *speed }),
        Outcome::BelowLimit(_) | Outcome::Tripped(_) => None,
    };
    outcomes.iter().filter_map(point).collect()
}

/// The points that a record's steady windows show; none where it lacks a current, a voltage or the speed.
#[must_use]
pub fn of_record(record: &Record, known: &Known) -> Vec<LimitPoint> {
    let output = |k: usize| record.measured.get(k).and_then(Option::as_ref);
    let (Some(i_d), Some(i_q), Some(speed)) = (output(0), output(1), output(2)) else { return Vec::new() };
    let [v_d, v_q, ..] = record.inputs.as_slice() else { return Vec::new() };
    if v_d.len() != record.rows() || v_q.len() != record.rows() {
        return Vec::new();
    }
    let length = ((WINDOW / record.period).round() as usize).max(LEAST_ROWS);
    let limit = known.reference_voltage(known.bus_voltage);
    let slowest = SLOWEST * limit / (known.pole_pairs * known.flux_linkage);
    let mut points = Vec::new();
    let mut row = 0;
    while row + length <= record.rows() {
        let span = row..row + length;
        row += length;
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        // From the first half's mean to the second's half the window passes.
        let slope = |values: &[f64]| {
            let (first, second) = values.split_at(length / 2);
            (mean(second) - mean(first)) / (0.5 * length as f64 * record.period)
        };
        let w = mean(&speed[span.clone()]);
        let turned = slope(&speed[span.clone()]) * length as f64 * record.period;
        let side = 1f64.copysign(w);
        let (d, q) = (mean(&i_d[span.clone()]), side * mean(&i_q[span.clone()]));
        let (of_d, of_q) = (mean(&v_d[span.clone()]), side * mean(&v_q[span.clone()]));
        let [rise_d, rise_q] = [slope(&i_d[span.clone()]), side * slope(&i_q[span])].map(|it| known.inductance * it);
        let w = w.abs();
        let steady = rise_d.hypot(rise_q) < STEADY * of_d.hypot(of_q) && turned.abs() < STEADY * w;
        if !steady || w < slowest || d.hypot(q) < SHORTEST * known.current_limit {
            continue;
        }
        let w_e = known.pole_pairs * w;
        let r = known.resistance;
        let flux_d = (of_q - r * q - rise_q) / w_e;
        let flux_q = -(of_d - r * d - rise_d) / w_e;
        // (r i_d - w psi_q)^2 + (r i_q + w psi_d)^2 = V^2, the positive root.
        let square = flux_d * flux_d + flux_q * flux_q;
        let half = r * (q * flux_d - d * flux_q);
        let rest = r * r * (d * d + q * q) - limit * limit;
        let root = (half * half - square * rest).sqrt();
        let at_limit = (root - half) / square / known.pole_pairs;
        if at_limit.is_finite() && at_limit > 0.0 {
            points.push(LimitPoint { i_d: d, i_q: q, speed: at_limit });
        }
    }
    points
}

/// How far the current advance of a model's surface `weakening_current` is from points of the limit, in degrees, each its absolute value. Points that
/// need no weakening count with an advance of 0.
///
/// # Errors
/// A model without that surface.
pub fn angle_errors(model: &Checked, known: &Known, points: &[LimitPoint]) -> Result<Vec<f64>, Faults> {
    let tape = weakening_tape(model)?;
    let mut surface = Interpreter::<f64>::new(&tape);
    let k_t = known.torque_constant();
    let errors = points.iter().map(|point| {
        let wanted = surface.eval(&[k_t * point.i_q, point.speed]).clamp(0.0, known.current_limit);
        let [found, true_one] = [wanted, (-point.i_d).max(0.0)].map(|it| it.atan2(point.i_q.abs()).to_degrees());
        (found - true_one).abs()
    });
    Ok(errors.collect())
}

/// The range of speeds in which a model's surface `weakening_current` is asked, in rad/s.
///
/// # Errors
/// A model without that surface.
pub fn speeds(model: &Checked) -> Result<[f64; 2], Faults> {
    weakening_tape(model)?;
    let input = model.model().inputs.iter().find(|input| input.name == "speed");
    Ok(input.map_or([0.0, f64::INFINITY], |input| input.range))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rsm_sim::record::Drive;

    #[test]
    fn of_a_hundred_errors_one_is_beyond_the_percentile() {
        let errors = AngleErrors::of((1..=100).rev().map(f64::from).collect());
        assert_eq!(errors, AngleErrors { mean: 50.5, p99: 99.0 });
        assert_eq!(AngleErrors::of(vec![4.0, 2.0]), AngleErrors { mean: 3.0, p99: 4.0 });
        assert_eq!(AngleErrors::of(Vec::new()), AngleErrors { mean: 0.0, p99: 0.0 });
    }

    /// 0.08 ohm, 0.9 mH, 0.06 Wb, 4 pole pairs, 270 V, 60 A, 5 % of margin.
    fn known() -> Known {
        Known {
            resistance: 0.08,
            inductance: 0.0009,
            flux_linkage: 0.06,
            pole_pairs: 4.0,
            current_limit: 60.0,
            bus_voltage: 270.0,
            voltage_margin: 0.05,
            pwm_period: 1e-4,
            dead_time: 0.0,
        }
    }

    fn record(speed: f64, i_d: f64, i_q: f64, flux: f64) -> Record {
        let (r, l, w_e) = (0.08, 0.0009, 4.0 * speed);
        let of = |value: f64| vec![value; 100];
        Record {
            file: "steady".to_string(),
            drive: Drive::Open,
            settings: Vec::new(),
            time: (0..100).map(|k| f64::from(k) * 0.001).collect(),
            period: 0.001,
            inputs: vec![of(r * i_d - w_e * l * i_q), of(r * i_q + w_e * (l * i_d + flux)), of(0.0)],
            starts: Vec::new(),
            breaks: Vec::new(),
            configuration: None,
            measured: vec![Some(of(i_d)), Some(of(i_q)), Some(of(speed))],
        }
    }

    #[test]
    fn a_record_far_below_the_limit_says_where_it_is() {
        // Magnets of 0.054 Wb, which the drive does not know. i_d = -12 A, i_q = 20 A: psi_d = 0.054 - 0.0108 = 0.0432 Wb, psi_q = 0.018 Wb.
        // V = 0.95 * 270/sqrt 3 = 148.0903 V. psi^2 = 0.00219024, half = 0.08 (20 * 0.0432 + 12 * 0.018) = 0.0864, r^2 i^2 = 3.4816.
        // w_e = (sqrt(0.0864^2 + 0.00219024 * (148.0903^2 - 3.4816)) - 0.0864)/0.00219024 = 3124.87 rad/s, 781.22 rad/s of the shaft.
        for side in [1.0, -1.0] {
            let points = of_record(&record(side * 200.0, -12.0, side * 20.0, 0.054), &known());
            assert_eq!(points.len(), 5);
            for point in points {
                assert!((point.speed - 781.218).abs() < 0.01, "{point:?}");
                // Means of equal numbers: rounding only.
                assert!((point.i_d + 12.0).abs() < 1e-9 && (point.i_q - 20.0).abs() < 1e-9, "{point:?}");
            }
        }
        // Slower than a quarter of 617 rad/s, and a current of less than 6 A.
        assert!(of_record(&record(150.0, -12.0, 20.0, 0.06), &known()).is_empty());
        assert!(of_record(&record(200.0, -3.0, 4.0, 0.06), &known()).is_empty());
    }

    #[test]
    fn a_window_in_which_the_currents_rise_does_not_count() {
        let mut rising = record(200.0, -12.0, 20.0, 0.06);
        // 4 kA/s are 3.6 V of some 40 V.
        for (k, value) in rising.measured[1].as_mut().unwrap().iter_mut().enumerate() {
            *value += 4.0 * k as f64;
        }
        assert!(of_record(&rising, &known()).is_empty());
    }
}
