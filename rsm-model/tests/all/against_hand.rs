//! Models, compared with solutions calculated by hand: formulas, or equations in explicit form that share no code with the compiler.

use crate::simulator::{Simulator, names, system};

/// The classical Runge-Kutta method for explicit equations.
fn by_hand(mut x: Vec<f64>, end: f64, steps: usize, rates: impl Fn(f64, &[f64]) -> Vec<f64>) -> Vec<f64> {
    let h = end / steps as f64;
    for k in 0..steps {
        let t = k as f64 * h;
        let along = |x: &[f64], k: &[f64], h: f64| -> Vec<f64> { x.iter().zip(k).map(|(x, k)| x + h * k).collect() };
        let k1 = rates(t, &x);
        let k2 = rates(t + h / 2.0, &along(&x, &k1, h / 2.0));
        let k3 = rates(t + h / 2.0, &along(&x, &k2, h / 2.0));
        let k4 = rates(t + h, &along(&x, &k3, h));
        for i in 0..x.len() {
            x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
    x
}

/// Both sides take the same steps, so only roundings differ: 1e-16 in each of thousands of steps, amplified by the plant.
const SAME_STEPS: f64 = 1e-10;

fn assert_close(found: &[f64], wanted: &[f64], tolerance: f64) {
    for (k, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let scale = wanted.abs().max(1e-3);
        assert!((found - wanted).abs() <= tolerance * scale, "{k}: {found}, by hand {wanted}");
    }
    assert_eq!(found.len(), wanted.len());
}

#[test]
fn the_axis_follows_its_exponential() {
    let inputs = |_: f64| vec![2.0];
    let mut axis = Simulator::new("axis", &["position", "speed"], &inputs);
    axis.run_to(1.0, 1e-3, &inputs);
    let (m, b, f): (f64, f64, f64) = (95.1, 203.5, 35.15 * 2.0);
    let speed = f / b * (1.0 - (-b / m).exp());
    let position = f / b * (1.0 - m / b * (1.0 - (-b / m).exp()));
    // The error of Runge-Kutta: (b h/m)^4/120 in each step, about 1e-13 in total.
    assert_close(&axis.wanted(&inputs), &[position, speed], 1e-11);
}

#[test]
fn two_inertias_on_a_spring_in_both_forms() {
    let inputs = |_: f64| vec![3.0];
    let (j, l, c, d) = (0.1, 2.0, 300.0, 0.4);
    let wanted = by_hand(vec![0.0; 4], 1.0, 2000, |_, x| {
        let torque = c * (x[2] - x[0]) + d * (x[3] - x[1]);
        vec![x[1], (3.0 + torque) / j, x[3], -torque / l]
    });
    for text in ["two-inertias", "quoted"] {
        let mut plant = Simulator::new(text, &["motor.phi", "motor.w", "load.phi", "load.w", "speed", "shaft.twist"], &inputs);
        plant.run_to(1.0, 5e-4, &inputs);
        let mut all = wanted.clone();
        all.extend([wanted[3], wanted[2] - wanted[0]]);
        assert_close(&plant.wanted(&inputs), &all, SAME_STEPS);
    }
}

#[test]
fn rigid_inertias_on_a_gear_are_one_inertia() {
    let inputs = |_: f64| vec![2.0];
    let mut plant = Simulator::new("gear-train", &["motor.w", "load.w", "motor.phi", "load.phi", "gear.a.tau"], &inputs);
    assert_eq!(names(&system("gear-train"), system("gear-train").states()), ["motor.phi", "motor.w"]);
    plant.run_to(1.0, 0.01, &inputs);
    let inertia = 0.1 + 2.0 / 49.0;
    let (w, phi) = (2.0 / inertia, 1.0 / inertia);
    // Polynomials of second degree: Runge-Kutta is exact, only rounding remains.
    let passed_on = 2.0 - 0.1 * 2.0 / inertia;
    assert_close(&plant.wanted(&inputs), &[w, w / 7.0, phi, phi / 7.0, passed_on], 1e-12);
}

#[test]
fn a_circuit_with_a_loop_of_resistors() {
    let inputs = |t: f64| vec![12.0 + t];
    let mut plant = Simulator::new("rlc", &["l.i", "c.v", "current"], &inputs);
    plant.run_to(0.2, 1e-5, &inputs);
    let node = |t: f64, i: f64| ((12.0 + t) / 10.0 - i) / (1.0 / 10.0 + 1.0 / 20.0);
    let x = by_hand(vec![0.0, 0.0], 0.2, 20000, |t, x| vec![(node(t, x[0]) - 5.0 * x[0] - x[1]) / 0.1, x[0] / 1e-3]);
    let current = (12.2 - node(0.2, x[0])) / 10.0;
    assert_close(&plant.wanted(&inputs), &[x[0], x[1], current], SAME_STEPS);
}

#[test]
fn a_tank_runs_over_at_its_edge() {
    let inputs = |_: f64| vec![0.1];
    let mut plant = Simulator::new("tank", &["level", "overflow"], &inputs);
    plant.run_to(8.0, 0.01, &inputs);
    // Below the edge: level = 5 + (0.2 - 5) exp(-t/25). Above it the weir adds to the rate.
    let reached = 25.0 * (4.8_f64 / 4.0).ln();
    assert!(reached < 8.0);
    let (rate, rest) = ((0.02 + 3.0) / 0.5, (0.1 + 3.0) / (0.02 + 3.0));
    let level = rest + (1.0 - rest) * (-(8.0 - reached) * rate).exp();
    // The event is located to rounding. The remaining error is that of the method, (6 h)^4 in each step.
    assert_close(&plant.wanted(&inputs), &[level, 3.0 * (level - 1.0)], 1e-6);
}

#[test]
fn heat_runs_along_a_rod() {
    let inputs = |t: f64| vec![50.0 * (0.1 * t).sin()];
    let mut plant = Simulator::new("thermal", &["T[1]", "T[2]", "T[3]", "T[4]", "hot"], &inputs);
    plant.run_to(20.0, 0.02, &inputs);
    let mut x = by_hand(vec![293.15; 4], 20.0, 1000, |t, x| {
        let q = 50.0 * (0.1 * t).sin();
        let flow = |a: f64, b: f64| 2.0 * (a - b);
        vec![
            (q - flow(x[0], x[1])) / 100.0,
            (flow(x[0], x[1]) - flow(x[1], x[2])) / 100.0,
            (flow(x[1], x[2]) - flow(x[2], x[3])) / 100.0,
            (flow(x[2], x[3]) - flow(x[3], 293.15)) / 100.0,
        ]
    });
    x.push(x[0]);
    assert_close(&plant.wanted(&inputs), &x, SAME_STEPS);
}

#[test]
fn a_quadrotor_pitches() {
    let inputs = |t: f64| vec![5.9 + 0.2 * (3.0 * t).sin(), 5.9 - 0.2 * (3.0 * t).sin()];
    let mut plant = Simulator::new("pitch", &["f", "r", "pitch", "rate", "x", "vx", "vz"], &inputs);
    plant.run_to(2.0, 1e-3, &inputs);
    let start = vec![5.88399, 5.88399, 0.05, 0.0, 0.0, 0.0, 0.0];
    let x = by_hand(start, 2.0, 2000, |t, s| {
        let speed = (s[5] * s[5] + s[6] * s[6]).sqrt();
        let wave = 0.2 * (3.0 * t).sin();
        vec![
            (5.9 + wave - s[0]) / 0.04,
            (5.9 - wave - s[1]) / 0.04,
            s[3],
            0.2 * (s[0] - s[1]) / 0.015,
            s[5],
            ((s[0] + s[1]) * s[2].sin() - 0.1 * s[5] * speed) / 1.2,
            ((s[0] + s[1]) * s[2].cos() - 0.1 * s[6] * speed) / 1.2 - 9.80665,
        ]
    });
    assert_close(&plant.wanted(&inputs), &x, SAME_STEPS);
}

#[test]
fn a_cylinder_moves_behind_its_valve() {
    let inputs = |_: f64| vec![0.6];
    let mut plant = Simulator::new("cylinder", &["a", "b", "position", "speed"], &inputs);
    plant.run_to(0.1, 1e-5, &inputs);
    let x = by_hand(vec![2e6, 2e6, 0.0, 0.0], 0.1, 10000, |_, x| {
        let orifice = |d: f64| 2e-7 * 0.6 * d.signum() * d.abs().sqrt();
        let (area, volume, bulk) = (1e-3, 5e-4, 1.2e9);
        vec![
            (orifice(1e7 - x[0]) - area * x[3]) * bulk / (volume + area * x[2]),
            (area * x[3] - orifice(x[1])) * bulk / (volume - area * x[2]),
            x[3],
            (area * (x[0] - x[1]) - 800.0 * x[3] - 20000.0 * x[2]) / 50.0,
        ]
    });
    assert_close(&plant.wanted(&inputs), &x, 1e-8);
}

#[test]
fn a_ball_bounces_at_the_instants_of_its_formula() {
    let inputs = |_: f64| vec![];
    let mut ball = Simulator::new("ball", &["height", "speed", "bounces"], &inputs);
    ball.run_to(1.5, 0.01, &inputs);
    let (g, e) = (9.81_f64, 0.8);
    let first = (2.0 / g).sqrt();
    let after = e * g * first;
    // The second touch occurs 2 v/g later.
    let second = first + 2.0 * after / g;
    assert!(second < 1.5 && 1.5 < second + 2.0 * e * after / g);
    let (t, v) = (1.5 - second, e * after);
    // Parabolas: Runge-Kutta is exact. Each touch is located to about 1e-14 s.
    assert_close(&ball.wanted(&inputs), &[v * t - g * t * t / 2.0, v - g * t, 2.0], 1e-9);
}

#[test]
fn a_controller_is_computed_at_instants_and_holds() {
    let inputs = |_: f64| vec![1.0];
    let mut plant = Simulator::new("sampled", &["y", "u", "e", "sum"], &inputs);
    plant.run_to(0.305, 1e-3, &inputs);
    let (mut y, mut sum, mut u, mut e) = (0.0, 0.0, 0.0, 0.0);
    for k in 0..=30 {
        e = 1.0 - y;
        sum += 0.01 * e;
        u = 2.0 * e + 5.0 * sum;
        let held: f64 = if k == 30 { 0.005 } else { 0.01 };
        y = u + (y - u) * (-held / 0.1).exp();
    }
    // The plant by its exponential function; Runge-Kutta has an error of 0.01^5/120 in each step.
    assert_close(&plant.wanted(&inputs), &[y, u, e, sum], 1e-10);
}

#[test]
fn a_thermostat_remembers_which_way_it_came() {
    let inputs = |_: f64| vec![];
    let mut plant = Simulator::new("hysteresis", &["temperature", "on"], &inputs);
    // Up to 360 K towards 393.15 K, down to 350 K towards 293.15 K, with a time constant of 50 s.
    let up = 50.0 * ((393.15_f64 - 340.0) / (393.15 - 360.0)).ln();
    let down = 50.0 * ((360.0_f64 - 293.15) / (350.0 - 293.15)).ln();
    plant.run_to(up + 0.5 * down, 0.05, &inputs);
    let cooling = 293.15 + (360.0 - 293.15) * (-0.5 * down / 50.0_f64).exp();
    assert_close(&plant.wanted(&inputs), &[cooling, 0.0], 1e-9);
    let rest = 10.0;
    plant.run_to(up + down + rest, 0.05, &inputs);
    let warming = 393.15 + (350.0 - 393.15) * (-rest / 50.0_f64).exp();
    assert_close(&plant.wanted(&inputs), &[warming, 1.0], 1e-9);
}

#[test]
fn a_nonlinear_loop_is_solved_at_every_instant() {
    let inputs = |_: f64| vec![2.0];
    let mut plant = Simulator::new("diode", &["v", "i", "drop"], &inputs);
    plant.run_to(0.005, 1e-6, &inputs);
    // By hand: the current by bisection.
    let current = |v: f64| {
        let (mut low, mut high) = (0.0_f64, 0.2);
        for _ in 0..200 {
            let i = 0.5 * (low + high);
            let drop = 0.05 * (i / 1e-9).ln_1p();
            if 10.0 * i + drop + v < 2.0 { low = i } else { high = i }
        }
        0.5 * (low + high)
    };
    let x = by_hand(vec![0.0], 0.005, 5000, |_, x| vec![current(x[0]) / 1e-4]);
    let i = current(x[0]);
    // Newton's steps leave a residual of the magnitude of rounding, 1e-16 times 2 V, so the error of the current is about 1e-17 A.
    assert!(plant.residual < 1e-12, "{}", plant.residual);
    assert_close(&plant.wanted(&inputs), &[x[0], i, 0.05 * (i / 1e-9).ln_1p()], 1e-9);
}

#[test]
fn a_pendulum_in_cartesian_coordinates_keeps_its_energy_and_its_length() {
    let inputs = |_: f64| vec![];
    let mut plant = Simulator::new("pendulum", &["x", "y", "vx", "vy"], &inputs);
    assert_eq!(plant.states.len(), 2);
    plant.run_to(2.0, 1e-4, &inputs);
    let found = plant.wanted(&inputs);
    let angle = by_hand(vec![0.2_f64.atan2(0.7745966692414834), 0.0], 2.0, 20000, |_, x| vec![x[1], -9.81 / 0.8 * x[0].sin()]);
    let (x, y) = (0.8 * angle[0].sin(), -0.8 * angle[0].cos());
    // Two methods of order four with a step of 1e-4: errors of 1e-14 and less, and the residual of Newton's steps.
    assert_close(&found, &[x, y, angle[1] * 0.8 * angle[0].cos(), angle[1] * 0.8 * angle[0].sin()], 1e-8);
}
