//! Both steps with a motor behind them: the equations (17), (18) in the rotor frame under the duties of an averaged inverter, one period late.
//!
//! A few lines, so that this package's tests need no laboratory; the full plant with a switched inverter is in `rsm-rigs`.

use std::f64::consts::TAU;

use motor_loop::{CurrentState, Demand, Measured, ReferenceState, currents, references};

use crate::{MOTOR, TUNING, drive};

/// The motor: currents, angle (electrical, rad) and mechanical speed.
struct Plant {
    i_d: f64,
    i_q: f64,
    angle: f64,
    speed: f64,
    /// Inertia in kg m^2, or none: the speed is held by a dynamometer.
    inertia: Option<f64>,
}

impl Plant {
    fn phases(&self) -> [f32; 3] {
        let (sin, cos) = self.angle.sin_cos();
        let (alpha, beta) = (cos * self.i_d - sin * self.i_q, sin * self.i_d + cos * self.i_q);
        let side = 0.75f64.sqrt() * beta;
        [alpha, side - 0.5 * alpha, -side - 0.5 * alpha].map(|phase| phase as f32)
    }

    /// A period under duties, in steps of Euler that are a thousandth of a turn and of the winding's time constant at most.
    fn run(&mut self, duties: [f32; 3], bus: f64, period: f64) {
        const STEPS: u32 = 100;
        let dt = period / f64::from(STEPS);
        let [a, b, c] = duties.map(|duty| f64::from(duty) * bus);
        let (alpha, beta) = ((2.0 * a - b - c) / 3.0, (b - c) / 3f64.sqrt());
        let (r, l, lambda) = (0.08, 0.9e-3, 0.06);
        for _ in 0..STEPS {
            let (sin, cos) = self.angle.sin_cos();
            let (v_d, v_q) = (cos * alpha + sin * beta, cos * beta - sin * alpha);
            let w_e = 4.0 * self.speed;
            let rate_d = (v_d - r * self.i_d + w_e * l * self.i_q) / l;
            let rate_q = (v_q - r * self.i_q - w_e * (l * self.i_d + lambda)) / l;
            self.i_d += rate_d * dt;
            self.i_q += rate_q * dt;
            self.angle += w_e * dt;
            if let Some(inertia) = self.inertia {
                self.speed += 0.36 * self.i_q / inertia * dt;
            }
        }
    }
}

/// What a run saw, a millisecond a row: speed, torque, and the length of the current vector.
fn run(plant: &mut Plant, torque_nm: impl Fn(f64) -> f64, seconds: f64) -> Vec<[f64; 3]> {
    let (mut outer, mut inner, drive) = (ReferenceState::default(), CurrentState::default(), drive());
    let bus = f64::from(MOTOR.bus_voltage_v);
    let period = f64::from(TUNING.pwm_period_s);
    let mut wanted = outer.last;
    // The bridge closes after eleven good samples of a motor without current; the run begins then.
    let at_rest = Measured {
        currents_a: plant.phases(),
        angle_turns: (plant.angle / TAU).fract() as f32,
        speed_rad_s: plant.speed as f32,
        bus_voltage_v: bus as f32,
    };
    let mut duties = [0.5; 3];
    while inner.last.closed < 0.5 {
        let angle_turns = inner.angle_turns;
        let sample = if inner.bus_voltage_v > 0.0 { Measured { angle_turns, ..at_rest } } else { at_rest };
        duties = currents(&mut inner, &drive, &wanted, &sample).duties;
    }
    plant.angle = f64::from(inner.angle_turns) * TAU;
    let mut rows = vec![];
    for k in 0..(seconds / period).round() as u32 {
        let time = f64::from(k) * period;
        let (speed_rad_s, bus_voltage_v) = (plant.speed as f32, bus as f32);
        if k % 10 == 0 {
            let voltage_share = inner.voltage_share;
            let demand = Demand { torque_nm: torque_nm(time) as f32, speed_rad_s, bus_voltage_v, voltage_share };
            wanted = references(&mut outer, &drive, &demand);
            rows.push([plant.speed, 0.36 * plant.i_q, plant.i_d.hypot(plant.i_q)]);
        }
        let angle_turns = (plant.angle / TAU).fract() as f32;
        let next = currents(
            &mut inner,
            &drive,
            &wanted,
            &Measured { currents_a: plant.phases(), angle_turns, speed_rad_s, bus_voltage_v },
        );
        plant.run(duties, bus, period);
        assert!(next.closed > 0.5, "the bridge opened at {time} s");
        duties = next.duties;
    }
    rows
}

/// At 700 and 780 rad/s the drive is switched on while the back-EMF is beyond the bus: without current there is no weakening yet.
#[test]
fn torque_follows_its_demand_at_every_speed_that_has_it() {
    for speed in [-600.0, 0.0, 100.0, 450.0, 600.0, 700.0, 780.0] {
        let mut plant = Plant { i_d: 0.0, i_q: 0.0, angle: 0.0, speed, inertia: None };
        // 5 N m is 14 A: within both circles up to 780 rad/s.
        let rows = run(&mut plant, |time| if time < 0.05 { 0.0 } else { 5.0 }, 0.15);
        for [_, torque, _] in &rows[30..50] {
            assert!(torque.abs() < 0.15, "{speed} rad/s, no demand: {torque}");
        }
        // 10 ms after the step, 1 % of the peak torque.
        for [_, torque, _] in &rows[60..] {
            assert!((torque - 5.0).abs() < 0.2, "{speed} rad/s: {torque}");
        }
    }
}

#[test]
fn a_torque_step_is_there_within_three_milliseconds() {
    let mut plant = Plant { i_d: 0.0, i_q: 0.0, angle: 0.3, speed: 300.0, inertia: None };
    let rows = run(&mut plant, |time| if time < 0.02 { 0.0 } else { 10.0 }, 0.04);
    // One tick to see the demand, then three time constants 1/1500 s and 1.5 periods: 2.15 ms.
    assert!((rows[24][1] - 10.0).abs() < 1.0, "{}", rows[24][1]);
    // And it does not overshoot by more than a tenth.
    let highest = rows[20..].iter().map(|row| row[1]).fold(0.0, f64::max);
    assert!(highest < 11.0, "{highest}");
}

#[test]
fn the_motor_runs_up_through_flux_weakening_with_its_current_in_the_circle() {
    let mut plant = Plant { i_d: 0.0, i_q: 0.0, angle: 0.0, speed: 0.0, inertia: Some(0.01) };
    // Full torque as far as the circle gives it; the surface is asked for half beyond 460 rad/s.
    let rows = run(&mut plant, |_| 9.0, 1.0);
    let reached = rows.iter().position(|row| row[0] >= 785.4).expect("the run-up reaches 7500 rpm");
    // 9 N m on 0.01 kg m^2 are 900 rad/s^2: 873 ms if the demand were met all the way; it is, to 5 %.
    assert!((870..=920).contains(&reached), "{reached} ms");
    let longest = rows.iter().map(|row| row[2]).fold(0.0, f64::max);
    // 60 A, and 10 % of overshoot while references move.
    assert!(longest < 66.0, "{longest} A");
}
