//! Compares the nominal plants with an independent solver, and with cases calculated by hand.

use ode_solvers::{Dopri5, SVector, System};

use rsm_sim::simulate::Simulator;

use super::{effect, plant, record, run};

/// The equations of docs/book/src/reference/plants.md section 2, written here again from the text, with constant inputs.
struct Motor;
struct Car;

impl System<f64, SVector<f64, 3>> for Motor {
    fn system(&self, _t: f64, x: &SVector<f64, 3>, dx: &mut SVector<f64, 3>) {
        let (r, l, lambda, p, j, b) = (0.08, 9e-4, 0.06, 4.0, 0.01, 0.001);
        let w_e = p * x[2];
        dx[0] = (-3.0 - r * x[0]) / l + w_e * x[1];
        dx[1] = (20.0 - r * x[1] - w_e * lambda) / l - w_e * x[0];
        dx[2] = (1.5 * p * lambda * x[1] - b * x[2] - 0.5) / j;
    }
}

impl System<f64, SVector<f64, 7>> for Car {
    fn system(&self, _t: f64, x: &SVector<f64, 7>, dx: &mut SVector<f64, 7>) {
        let (i_t, i_f, r, m) = (2.2, 3.7, 0.32, 1560.0);
        let [t_e, th_e, w_e, th_t, w_t, th_w, w_w] = [x[0], x[1], x[2], x[3], x[4], x[5], x[6]];
        let t_c = 1e4 * (th_e - i_t * th_t) + 30.0 * (w_e - i_t * w_t);
        let t_d = 5000.0 * (th_t / i_f - th_w) + 65.0 * (w_t / i_f - w_w);
        dx[0] = (0.5 * (120.0 + 0.6 * w_e - 0.001 * w_e * w_e) - t_e) / 0.1;
        dx[1] = w_e;
        dx[2] = (t_e - (15.0 + 0.03 * w_e) - t_c) / 0.17;
        dx[3] = w_t;
        dx[4] = (i_t * t_c - (0.1 + 0.1 / (i_f * i_f)) * w_t - t_d / i_f) / (0.014 + 0.031 / (i_f * i_f));
        dx[5] = w_w;
        let drag = 0.5 * 0.81 * 1.2 * r * r * r * w_w * w_w;
        dx[6] = (t_d - 0.1 * w_w - drag - r * m * 0.0980665) / (1.0 + m * r * r);
    }
}

/// The largest difference over all rows, relative to the largest value.
fn difference(ours: &[f64], theirs: &[f64]) -> f64 {
    let largest = theirs.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest
}

/// The error of a step is at most 1e-8 of a state, and the error of a step has decayed after less than a hundred steps: the currents of the motor
/// decay in 11 rows, its speed more slowly.
const AGREE: f64 = 1e-6;

/// The permitted error of a step for the closer comparison. It shows that the remaining difference is due to the steps, not to the equations.
const FINE: f64 = 1e-11;

/// A hundred times that error. The solver of the comparison has a smaller error.
const AGREE_FINE: f64 = 1e-9;

#[test]
fn the_motor_agrees_with_an_independent_solver() {
    let file = plant("pmac", "");
    let mut text = "time[s],v_d[V],v_q[V],load_torque[N*m],i_d[A],i_q[A],speed[rad/s]\n".to_string();
    for k in 0..=200 {
        text += &format!("{},-3,20,0.5,1,2,10\n", f64::from(k) / 1000.0);
    }
    let rows = record(&text, &file);
    let ours = run(&file, &rows);
    let finer = Simulator::new(&file, &rows).unwrap().tolerance(FINE).run(&rows).unwrap();
    let start = SVector::<f64, 3>::new(1.0, 2.0, 10.0);
    let mut solver = Dopri5::new(Motor, 0.0, 0.2, 1e-3, start, 1e-12, 1e-12);
    solver.integrate().unwrap();
    assert_eq!(solver.y_out().len(), 201);
    for k in 0..3 {
        let theirs: Vec<f64> = solver.y_out().iter().map(|y| y[k]).collect();
        let found = difference(&ours.values[k], &theirs);
        println!("motor, output {k}: {found:.1e}");
        assert!(found < AGREE, "output {k}: {found:e}");
        let found = difference(&finer.values[k], &theirs);
        println!("with a thousandth of the error: {found:.1e}");
        assert!(found < AGREE_FINE, "output {k}: {found:e}");
    }
}

#[test]
fn the_car_agrees_with_an_independent_solver() {
    let file = plant("driveline", "");
    let mut text = "time[s],throttle[1],gear[1],road_speed[m/s]\n".to_string();
    for k in 0..=500 {
        text += &format!("{},0.5,2,8\n", f64::from(k) / 500.0);
    }
    let rows = record(&text, &file);
    let ours = run(&file, &rows);
    let finer = Simulator::new(&file, &rows).unwrap().tolerance(FINE).run(&rows).unwrap();
    let w_w = 8.0 / 0.32;
    let w_e = 2.2 * 3.7 * w_w;
    let t_e = 0.5 * (120.0 + 0.6 * w_e - 0.001 * w_e * w_e);
    let t_c = t_e - 15.0 - 0.03 * w_e;
    let t_d = 2.2 * 3.7 * t_c;
    let start = SVector::<f64, 7>::from_column_slice(&[t_e, t_c / 1e4, w_e, 0.0, 3.7 * w_w, -t_d / 5000.0, w_w]);
    let mut solver = Dopri5::new(Car, 0.0, 1.0, 2e-3, start, 1e-12, 1e-12);
    solver.integrate().unwrap();
    let theirs: Vec<Vec<f64>> =
        vec![solver.y_out().iter().map(|y| y[2]).collect(), solver.y_out().iter().map(|y| 0.32 * y[6]).collect()];
    for (k, theirs) in theirs.iter().enumerate() {
        assert_eq!(theirs.len(), 501);
        let found = difference(&ours.values[k], theirs);
        println!("car, output {k}: {found:.1e}");
        assert!(found < AGREE, "output {k}: {found:e}");
        let found = difference(&finer.values[k], theirs);
        println!("with a thousandth of the error: {found:.1e}");
        assert!(found < AGREE_FINE, "output {k}: {found:e}");
    }
}

#[test]
fn the_open_axis_follows_its_step_response() {
    let file = plant("servo-axis", "");
    let mut text = "time[s],command[V],position[m]\n".to_string();
    for k in 0..=1000 {
        text += &format!("{},2,0.001\n", f64::from(k) / 1000.0);
    }
    let ours = run(&file, &record(&text, &file));
    // The solution of M dv/dt = F - b v from rest: q = q_0 + v_e (t - tau (1 - exp(-t/tau))), v_e = F/b, tau = M/b.
    let (v_e, tau) = (2.0 * 35.15065188248547 / 203.5034, 95.1089 / 203.5034);
    for (k, position) in ours.values[0].iter().enumerate() {
        let t = k as f64 / 1000.0;
        let expected = 0.001 + v_e * (t + tau * (-t / tau).exp_m1());
        // The axis moves 0.2 m; a hundred steps may each have an error of 1e-8 of the position.
        assert!((position - expected).abs() < AGREE * expected, "{position} at {t}, expected {expected}");
    }
}

#[test]
fn the_motor_settles_where_its_powers_balance() {
    let file = plant("pmac", "");
    let mut text = "time[s],v_q[V],load_torque[N*m],i_q[A],speed[rad/s]\n".to_string();
    for k in 0..=6000 {
        text += &format!("{},20,0.5,0,0\n", f64::from(k) / 1000.0);
    }
    let ours = run(&file, &record(&text, &file));
    let last = |name: &str| *ours.of(name).unwrap().last().unwrap();
    let (i_q, w) = (last("i_q"), last("speed"));
    // The equations k_t i_q = b w + T and v_q = r i_q + p w lambda with k_t = 0.36 are two straight lines; this is their intersection.
    let i_expected = (0.001 * 20.0 / 0.24 + 0.5) / (0.36 + 0.001 * 0.08 / 0.24);
    assert!((i_q - i_expected).abs() < 1e-9, "{i_q} expected {i_expected}");
    assert!((w - (20.0 - 0.08 * i_q) / 0.24).abs() < 1e-9);
    // Electrical input power = copper loss + friction + load.
    let balance = 1.5 * 20.0 * i_q - (1.5 * 0.08 * i_q * i_q + 0.001 * w * w + 0.5 * w);
    assert!(balance.abs() < 1e-7, "{balance} W are lost");
}

#[test]
fn the_car_settles_where_pull_meets_resistance() {
    let file = plant("driveline", "");
    let tyre = plant("driveline", &effect("tyre-slip", "slip_stiffness = 1e6"));
    let mut text = "time[s],throttle[1],gear[1],road_speed[m/s]\n".to_string();
    for k in 0..=8000 {
        text += &format!("{},0.3,3,15\n", f64::from(k) / 100.0);
    }
    let rows = record(&text, &file);
    let v = *run(&file, &rows).of("road_speed").unwrap().last().unwrap();
    let w_w = v / 0.32;
    let (w_t, w_e) = (3.7 * w_w, 1.5 * 3.7 * w_w);
    let engine = 0.3 * (120.0 + 0.6 * w_e - 0.001 * w_e * w_e) - 15.0 - 0.03 * w_e;
    let shaft = (1.5 * engine - (0.1 + 0.1 / (3.7 * 3.7)) * w_t) * 3.7;
    let resistance = 0.1 * w_w + 0.32 * (1560.0 * 0.0980665 + 0.5 * 0.81 * 1.2 * v * v);
    let accelerating = (shaft - resistance) / (1560.0 * 0.32);
    // After 80 s the speed still approaches its final value slowly. This rate must agree with the output `acceleration`.
    let last = *run(&file, &rows).of("acceleration").unwrap().last().unwrap();
    assert!((accelerating - last).abs() < 2e-3 && last.abs() < 0.05, "{accelerating} against {last} m/s^2");
    // A very stiff tyre behaves like a rigid one: 1e6 N for a slip of 1, so 1 kN gives a slip of 1e-3.
    let with_tyre = *run(&tyre, &rows).of("road_speed").unwrap().last().unwrap();
    assert!((with_tyre / v - 1.0).abs() < 2e-3, "{with_tyre} against {v} m/s");
}
