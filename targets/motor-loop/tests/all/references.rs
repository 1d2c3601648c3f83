//! The outer step.

use motor_loop::{Demand, Drive, Motor, ReferenceState, References, motor, references};

use crate::{HARD, MOTOR, TUNING, drive};

fn first(torque_nm: f32, speed_rad_s: f32, bus_voltage_v: f32) -> References {
    references(&mut ReferenceState::default(), &drive(), &Demand { torque_nm, speed_rad_s, bus_voltage_v })
}

#[test]
fn the_weakening_current_is_that_of_the_surface_and_torque_that_of_k_t() {
    let found = first(7.2, 700.0, 270.0);
    // The torque goes through amperes and back: two roundings, 1e-6 N m of a surface of 5 A/(N m) at most.
    assert!((found.i_d_a + motor::weakening_current_f32(7.2, 700.0)).abs() < 1e-5);
    assert!(found.i_d_a < -5.0, "at 700 rad/s there is weakening: {found:?}");
    // k_t = 1.5 * 4 * 0.06 = 0.36 N m/A; the quotient and the product are rounded once each, at 20 A to 2e-6.
    assert!((found.i_q_a - 20.0).abs() < 5e-6, "{found:?}");
    assert!((found.resistive_d_v - 0.08 * found.i_d_a).abs() < 1e-6 && (found.resistive_q_v - 1.6).abs() < 1e-6, "{found:?}");
}

#[test]
fn the_other_quadrants_mirror_the_first() {
    let motoring = first(7.2, 700.0, 270.0);
    let mirrored = References { i_q_a: -motoring.i_q_a, resistive_q_v: -motoring.resistive_q_v, ..motoring };
    assert_eq!(first(-7.2, -700.0, 270.0), mirrored);
    // Braking needs less weakening: the resistive drop of 20 A, 1.6 V of 156 V, helps.
    let braking = first(-7.2, 700.0, 270.0);
    assert_eq!(braking.i_q_a, -motoring.i_q_a);
    assert!(braking.i_d_a > motoring.i_d_a && braking.i_d_a < 0.5 * motoring.i_d_a, "{braking:?} {motoring:?}");
}

#[test]
fn the_vector_is_never_longer_than_the_limit_and_a_large_demand_uses_it() {
    for torque in [0.0f32, 5.0, 21.6, 100.0, -1e6] {
        for speed in [0.0, 300.0, 500.0, 700.0, 800.0, 1e6] {
            for bus in [100.0, 270.0, 350.0] {
                let found = first(torque, speed, bus);
                let length = f64::from(found.i_d_a).hypot(f64::from(found.i_q_a));
                // Three roundings of 60 A in f32, 2e-6 each.
                assert!(length <= 60.0 + 6e-6 && found.i_d_a <= 0.0, "{torque} {speed} {bus}: {found:?}");
                if torque.abs() >= 100.0 && bus >= 270.0 && speed <= 300.0 {
                    // Below base speed nothing but the current limits: what the surface `height` gives away is 5e-4 of it, and 1 % is what
                    // `limit_current` may say where there is nothing to weaken (8 A of 60).
                    assert!(length > 60.0 * 0.99, "{torque} {speed} {bus}: {found:?}");
                }
            }
        }
    }
}

#[test]
fn a_lower_bus_is_a_higher_speed() {
    // The voltage circle has the radius V/w_e: 243 V at 630 rad/s is 270 V at 700 rad/s.
    let (low, nominal) = (first(7.2, 630.0, 243.0), first(7.2, 700.0, 270.0));
    // 630 * (270/243) is 700 to a rounding of 6e-5 rad/s; the surface's slope is below 0.5 A s/rad.
    assert!((low.i_d_a - nominal.i_d_a).abs() < 1e-4, "{low:?} {nominal:?}");
}

#[test]
fn one_bad_sample_holds_the_last_good_references_and_is_counted() {
    let good = Demand { torque_nm: 7.2, speed_rad_s: 700.0, bus_voltage_v: 270.0 };
    let mut bad: Vec<Demand> = vec![];
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        bad.push(Demand { torque_nm: value, ..good });
        bad.push(Demand { speed_rad_s: value, ..good });
        bad.push(Demand { bus_voltage_v: value, ..good });
    }
    bad.extend([0.0, -0.0, -270.0, 1e-45].map(|bus_voltage_v| Demand { bus_voltage_v, ..good }));
    for broken in bad {
        let (mut state, drive) = (ReferenceState::default(), drive());
        assert_eq!(references(&mut state, &drive, &broken), References::default(), "nothing before the first good sample");
        let held = references(&mut state, &drive, &good);
        assert_eq!(references(&mut state, &drive, &broken), held, "{broken:?}");
        assert_eq!((state.bad.all, state.bad.in_a_row), (2, 1), "{broken:?}");
        assert_eq!(references(&mut state, &drive, &good), held);
        assert_eq!((state.bad.all, state.bad.in_a_row), (2, 0));
    }
}

#[test]
fn whatever_comes_in_finite_references_go_out() {
    let (mut state, drive) = (ReferenceState::default(), drive());
    for torque_nm in HARD {
        for speed_rad_s in HARD {
            for bus_voltage_v in HARD {
                let demand = Demand { torque_nm, speed_rad_s, bus_voltage_v };
                let References { i_d_a, i_q_a, resistive_d_v, resistive_q_v } = references(&mut state, &drive, &demand);
                assert!([i_d_a, i_q_a, resistive_d_v, resistive_q_v].iter().all(|v| v.is_finite()), "{demand:?}");
                assert!(i_d_a <= 0.0 && i_d_a.hypot(i_q_a) <= 60.001, "{demand:?}");
            }
        }
    }
}

#[test]
fn a_motor_that_is_none_gets_no_current() {
    for motor in [
        Motor { phase_resistance_ohm: f32::NAN, ..MOTOR },
        Motor { flux_linkage_wb: 0.0, ..MOTOR },
        Motor { current_limit_a: -60.0, ..MOTOR },
        Motor { bus_voltage_v: 0.0, ..MOTOR },
    ] {
        let mut state = ReferenceState::default();
        let demand = Demand { torque_nm: 7.2, speed_rad_s: 700.0, bus_voltage_v: 270.0 };
        assert_eq!(references(&mut state, &Drive::new(&motor, &TUNING), &demand), References::default(), "{motor:?}");
        assert_eq!(state.bad.all, 1);
    }
}
