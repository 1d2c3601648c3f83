//! The inner step, one period at a time.

use std::f64::consts::TAU;

use motor_loop::{CurrentState, Drive, Measured, References, Tuning, currents};

use crate::{HARD, TUNING, drive};

const AT_REST: Measured = Measured { currents_a: [0.0; 3], angle_turns: 0.0, speed_rad_s: 0.0, bus_voltage_v: 270.0 };

fn i_q(i_q_a: f32) -> References {
    References { i_q_a, ..References::default() }
}

fn first(references: References, measured: Measured) -> [f32; 3] {
    currents(&mut CurrentState::default(), &drive(), &references, &measured)
}

/// The voltage vector of duties, in the stator's frame, in V.
fn vector([a, b, c]: [f32; 3], bus: f64) -> [f64; 2] {
    let [a, b, c] = [a, b, c].map(|duty| f64::from(duty) * bus);
    [(2.0 * a - b - c) / 3.0, (b - c) / 3f64.sqrt()]
}

#[test]
fn no_current_and_no_speed_is_half_of_the_bus_on_every_leg() {
    assert_eq!(first(i_q(0.0), AT_REST), [0.5; 3]);
}

#[test]
fn an_error_becomes_a_voltage_at_its_place() {
    for k in 0..24 {
        let angle = f64::from(k) / 24.0;
        let duties = first(i_q(10.0), Measured { angle_turns: angle as f32, ..AT_REST });
        // 1500 rad/s * 0.9 mH * 10 A = 13.5 V on the q axis, a quarter turn before the d axis.
        let [alpha, beta] = vector(duties, 270.0);
        let expected = [-13.5 * (angle * TAU).sin(), 13.5 * (angle * TAU).cos()];
        // Duties near 0.5 in f32 are 6e-8 apart: 270 V of them 1.6e-5 V; some ten roundings.
        assert!(
            (alpha - expected[0]).abs() < 2e-4 && (beta - expected[1]).abs() < 2e-4,
            "{angle}: {alpha} {beta} {expected:?}"
        );
    }
}

#[test]
fn measured_currents_are_turned_into_the_rotor() {
    // 10 A on the q axis at 30 degrees: along phase b (see `rsm-lab/src/motor/park.rs`). As wanted: no voltage.
    let measured = Measured { currents_a: [-5.0, 10.0, -5.0], angle_turns: 1.0 / 12.0, ..AT_REST };
    let [alpha, beta] = vector(first(i_q(10.0), measured), 270.0);
    assert!(alpha.hypot(beta) < 2e-4, "{alpha} {beta}");
    // A part common to all three phases is none that flows.
    let shifted = Measured { currents_a: [-2.0, 13.0, -2.0], ..measured };
    let [alpha, beta] = vector(first(i_q(10.0), shifted), 270.0);
    assert!(alpha.hypot(beta) < 2e-4, "{alpha} {beta}");
}

#[test]
fn back_emf_is_met_where_the_rotor_will_be() {
    // 500 rad/s: w_e lambda = 2000 * 0.06 = 120 V on the q axis, 1.5 * 1e-4 s * 2000 rad/s = 0.3 rad later.
    let [alpha, beta] = vector(first(i_q(0.0), Measured { speed_rad_s: 500.0, ..AT_REST }), 270.0);
    assert!((alpha + 120.0 * 0.3f64.sin()).abs() < 1e-3 && (beta - 120.0 * 0.3f64.cos()).abs() < 1e-3, "{alpha} {beta}");
}

#[test]
fn the_voltage_stays_in_the_circle_and_a_large_error_uses_it() {
    let radius = 270.0 / 3f64.sqrt();
    for (i_d_a, i_q_a) in [(0.0, 1e4), (-1e4, 0.0), (-1e4, 1e4), (-100.0, 1e6), (1e6, -1e6)] {
        let length = (0..60).map(|k| {
            let wanted = References { i_d_a, i_q_a, ..References::default() };
            let duties = first(wanted, Measured { angle_turns: k as f32 / 60.0, ..AT_REST });
            assert!(duties.iter().all(|duty| (0.0..=1.0).contains(duty)), "{duties:?}");
            let [alpha, beta] = vector(duties, 270.0);
            alpha.hypot(beta)
        });
        for length in length {
            // What `height` gives away is 5e-4 of the radius at most; v_d alone is 0.949 of it. The circle is reached to 2e-3 V, some ten roundings.
            assert!(length < radius + 2e-3 && length > 0.948 * radius, "{i_d_a} {i_q_a}: {length}");
            if i_d_a != 0.0 && i_q_a != 0.0 {
                assert!(length > (1.0 - 5e-4) * radius, "{i_d_a} {i_q_a}: {length}");
            }
        }
    }
}

#[test]
fn integrals_do_not_wind_up_at_the_limit() {
    let (mut state, drive) = (CurrentState::default(), drive());
    // A locked rotor that takes no current: an hour of it.
    for _ in 0..36_000 {
        currents(&mut state, &drive, &i_q(1000.0), &AT_REST);
    }
    // Conditioned, the integral settles where gain * error + its own part, less what the limit took off, adds nothing: at the limit itself. Without,
    // it would be at 0.012 V a period times 1000 A.
    assert!((f64::from(state.integral_q_v) - 270.0 / 3f64.sqrt()).abs() < 0.1, "{state:?}");
}

#[test]
fn the_loss_of_the_dead_time_is_given_back_against_the_current() {
    let tuning = Tuning { dead_time_s: 2e-6, dead_time_current_a: 2.0, ..TUNING };
    let with = Drive::new(&super::MOTOR, &tuning);
    let measured = Measured { currents_a: [10.0, -1.0, -9.0], ..AT_REST };
    let without = first(i_q(0.0), measured);
    let duties = currents(&mut CurrentState::default(), &with, &i_q(0.0), &measured);
    // 2 us of 100 us; half of it where the current is half of 2 A.
    let given = [0.02, -0.01, -0.02];
    for k in 0..3 {
        assert!((duties[k] - without[k] - given[k]).abs() < 2e-7, "{duties:?} {without:?}");
    }
}

#[test]
fn a_bad_sample_holds_duties_and_integrals_and_is_counted() {
    let good = Measured { currents_a: [1.0, 2.0, -3.0], angle_turns: 0.3, speed_rad_s: 400.0, bus_voltage_v: 270.0 };
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for which in 0..6 {
            let mut broken = good;
            match which {
                0..3 => broken.currents_a[which] = value,
                3 => broken.angle_turns = value,
                4 => broken.speed_rad_s = value,
                _ => broken.bus_voltage_v = value,
            }
            check_held(good, broken);
        }
    }
    for bus_voltage_v in [0.0, -0.0, -270.0, 1e-45] {
        check_held(good, Measured { bus_voltage_v, ..good });
    }
}

fn check_held(good: Measured, broken: Measured) {
    let (mut state, drive) = (CurrentState::default(), drive());
    assert_eq!(currents(&mut state, &drive, &i_q(20.0), &broken), [0.5; 3], "no voltage before the first good sample");
    let held = currents(&mut state, &drive, &i_q(20.0), &good);
    let before = state.clone();
    assert_eq!(currents(&mut state, &drive, &i_q(20.0), &broken), held, "{broken:?}");
    assert_eq!((state.bad.all, state.bad.in_a_row), (2, 1), "{broken:?}");
    assert_eq!((state.integral_d_v, state.integral_q_v), (before.integral_d_v, before.integral_q_v));
    currents(&mut state, &drive, &i_q(20.0), &good);
    assert_eq!((state.bad.all, state.bad.in_a_row), (2, 0));
}

#[test]
fn whatever_comes_in_duties_between_0_and_1_go_out() {
    let (mut state, drive) = (CurrentState::default(), drive());
    for a in HARD {
        for angle_turns in HARD {
            for speed_rad_s in HARD {
                for bus_voltage_v in HARD {
                    let measured = Measured { currents_a: [a, -0.5 * a, 3.0], angle_turns, speed_rad_s, bus_voltage_v };
                    let duties = currents(&mut state, &drive, &i_q(20.0), &measured);
                    assert!(duties.iter().all(|duty| (0.0..=1.0).contains(duty)), "{measured:?}: {duties:?}");
                    assert!(state.integral_d_v.is_finite() && state.integral_q_v.is_finite(), "{measured:?}: {state:?}");
                }
            }
        }
    }
}
