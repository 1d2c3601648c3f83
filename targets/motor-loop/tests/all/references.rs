//! The outer step.

use motor_loop::{Demand, Drive, FOLD_SPEED_RAD_S, Motor, ReferenceState, References, TRIM_FROM, motor, references};

use crate::{HARD, MOTOR, TUNING, drive};

fn first(torque_nm: f32, speed_rad_s: f32, bus_voltage_v: f32) -> References {
    references(&mut ReferenceState::default(), &drive(), &Demand { torque_nm, speed_rad_s, bus_voltage_v, voltage_share: 0.0 })
}

#[test]
fn the_weakening_current_is_that_of_the_surface_and_torque_that_of_k_t() {
    let found = first(7.2, 700.0, 270.0);
    // The torque goes through amperes and back: two roundings, 1e-6 N m of a surface of 5 A/(N m) at most.
    assert!((found.i_d_a + motor::weakening_current_f32(7.2, 700.0)).abs() < 1e-5);
    assert!(found.i_d_a < -5.0, "at 700 rad/s there is weakening: {found:?}");
    // k_t = 1.5 * 4 * 0.06 = 0.36 N m/A; the quotient and the product are rounded once each, at 20 A to 2e-6.
    assert!((found.i_q_a - 20.0).abs() < 5e-6, "{found:?}");
}

#[test]
fn the_other_quadrants_mirror_the_first() {
    let motoring = first(7.2, 700.0, 270.0);
    let mirrored = References { i_q_a: -motoring.i_q_a, ..motoring };
    assert_eq!(first(-7.2, -700.0, 270.0), mirrored);
    // Braking needs less weakening: the resistive drop of 20 A, 1.6 V of 156 V, helps.
    let braking = first(-7.2, 700.0, 270.0);
    assert_eq!(braking.i_q_a, -motoring.i_q_a);
    assert!(braking.i_d_a > motoring.i_d_a && braking.i_d_a < 0.5 * motoring.i_d_a, "{braking:?} {motoring:?}");
}

#[test]
fn the_vector_is_never_longer_than_the_limit_and_a_large_demand_uses_it() {
    for torque in [0.0f32, 5.0, 21.6, 43.0, -43.0] {
        for speed in [0.0, 300.0, 500.0, 700.0, 800.0, 999.0] {
            for bus in [160.0, 270.0, 350.0] {
                let found = first(torque, speed, bus);
                let length = f64::from(found.i_d_a).hypot(f64::from(found.i_q_a));
                // Three roundings of 60 A in f32, 2e-6 each.
                assert!(length <= 60.0 + 6e-6 && found.i_d_a <= 0.0, "{torque} {speed} {bus}: {found:?}");
                if torque.abs() >= 40.0 && bus >= 270.0 && speed <= 300.0 {
                    // Below base speed nothing but the current limits: what `other_leg` gives away is 2e-4 of it, and 1 % is what
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

/// The weakening current of an ideal motor at 0.95 of the nominal voltage: the smaller root of (r i_d - w L i_q)^2 + (r i_q + w (L i_d + lambda))^2 =
/// V^2.
fn needed(i_q: f64, speed: f64) -> f64 {
    let (r, l, lambda, w) = (0.08, 0.9e-3, 0.06, 4.0 * speed);
    let (a, b) = (r * r + w * w * l * l, w * w * l * lambda);
    let c = a * i_q * i_q + 2.0 * r * w * lambda * i_q + w * w * lambda * lambda - (0.95 * 270.0f64).powi(2) / 3.0;
    if c <= 0.0 { 0.0 } else { c / (b + (b * b - a * c).sqrt()) }
}

/// Where the surfaces are asked they have data: at every torque that the limit leaves, from where weakening begins to the edge. Below, there is
/// nothing to weaken.
#[test]
fn the_surface_is_asked_inside_its_support() {
    let mut asked = 0;
    for speed in 0..=156u16 {
        let speed = 5.0 * f32::from(speed);
        assert!(speed <= FOLD_SPEED_RAD_S);
        for torque in -43..=43i8 {
            let mut state = ReferenceState::default();
            let demand =
                Demand { torque_nm: 0.5 * f32::from(torque), speed_rad_s: speed, bus_voltage_v: 270.0, voltage_share: 0.0 };
            references(&mut state, &drive(), &demand);
            let found = references(&mut state, &drive(), &demand);
            let given = 0.36 * found.i_q_a;
            // 1 % of the torque: the two surfaces do not meet to the last digit at the current limit.
            if motor::weakening_current_support_f32(0.99 * given, speed) == 0 {
                // The bench found no limit below 440 rad/s, and none for a strong braking torque below 520: data end where weakening does. There the
                // surface says 0 or as much as its worst error on unseen rows, 1.8 A, from what the circle diagram says.
                let off = found.i_d_a + needed(f64::from(found.i_q_a), f64::from(speed)) as f32;
                assert!(speed < 520.0 && off.abs() < 1.9, "{given} N m at {speed} rad/s: {found:?}, {off} A off");
            } else {
                asked += 1;
            }
        }
    }
    assert!(asked > 3000, "{asked}");
}

#[test]
fn beyond_the_surface_torque_folds_back_and_weakening_grows() {
    let at = |speed: f32, bus: f32| {
        let mut state = ReferenceState::default();
        let demand = Demand { torque_nm: 43.0, speed_rad_s: speed, bus_voltage_v: bus, voltage_share: 0.0 };
        (0..3).map(|_| references(&mut state, &drive(), &demand)).last().expect("three ticks")
    };
    let mut last = at(780.0, 270.0);
    // Circle speeds up to 1600 rad/s.
    for (speed, bus) in [(820.0, 270.0), (900.0, 270.0), (900.0, 230.0), (785.0, 180.0), (900.0, 180.0), (999.0, 168.0)] {
        let found = at(speed, bus);
        assert!(found.i_q_a < last.i_q_a && found.i_d_a <= last.i_d_a, "{speed} {bus}: {found:?} {last:?}");
        // What an ideal motor needs at that torque and voltage, from below: psi = V/w_e, i_d = -lambda/L + sqrt((psi/L)^2 - i_q^2). The trim has the
        // rest: 3 A.
        let flux_a = 0.95 * bus / 3f32.sqrt() / (4.0 * speed) / 0.9e-3;
        let needed = -66.67 + (flux_a * flux_a - found.i_q_a * found.i_q_a).max(0.0).sqrt();
        assert!(found.i_d_a < needed + 3.0 || found.i_d_a < -56.0, "{speed} {bus}: {found:?}, needed {needed}");
        last = found;
    }
}

#[test]
fn a_voltage_that_runs_out_trims_the_weakening_up_and_back() {
    let (mut state, drive) = (ReferenceState::default(), drive());
    let mut tick = |voltage_share: f32| {
        references(&mut state, &drive, &Demand { torque_nm: 7.2, speed_rad_s: 700.0, bus_voltage_v: 270.0, voltage_share })
    };
    let before = tick(0.9);
    let trimmed = (0..10).map(|_| tick(1.06)).last().expect("ten ticks");
    // 5.5 A of 0.1 a tick.
    assert!((before.i_d_a - trimmed.i_d_a - 5.5).abs() < 1e-3, "{before:?} {trimmed:?}");
    // What it sees is bounded: moving the references is no reason to weaken.
    let bounded = tick(40.0);
    assert!((trimmed.i_d_a - bounded.i_d_a - 5.5 * (1.2 - TRIM_FROM)).abs() < 1e-3, "{bounded:?}");
    assert_eq!((0..10).map(|_| tick(0.5)).last(), Some(before));
}

#[test]
fn a_bad_sample_is_replaced_by_the_last_good_one_and_ten_in_a_row_coast() {
    let good = Demand { torque_nm: 7.2, speed_rad_s: 700.0, bus_voltage_v: 270.0, voltage_share: 0.5 };
    let mut bad: Vec<Demand> = vec![];
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, 1001.0, -1001.0] {
        bad.push(Demand { torque_nm: value, ..good });
        bad.push(Demand { speed_rad_s: value, ..good });
        bad.push(Demand { bus_voltage_v: value, ..good });
    }
    bad.extend([f32::NAN, f32::INFINITY].map(|voltage_share| Demand { voltage_share, ..good }));
    bad.extend([0.0, -0.0, -270.0, 1e-45, 100.0, 370.0, 200.0].map(|bus_voltage_v| Demand { bus_voltage_v, ..good }));
    bad.push(Demand { speed_rad_s: 500.0, ..good });
    for broken in bad {
        let (mut state, drive) = (ReferenceState::default(), drive());
        references(&mut state, &drive, &good);
        let held = references(&mut state, &drive, &good);
        for tick in 1..=10 {
            // The trim of a share that is not known stays.
            assert_eq!(references(&mut state, &drive, &broken), held, "{broken:?}");
            assert_eq!((state.bad.all, state.bad.in_a_row), (tick, tick), "{broken:?}");
        }
        let coasting = references(&mut state, &drive, &broken);
        assert_eq!(coasting.i_q_a, 0.0, "{broken:?}");
        assert!(coasting.i_d_a < 0.0 || broken.speed_rad_s == 500.0, "the magnets are still to be weakened: {coasting:?}");
        references(&mut state, &drive, &good);
        references(&mut state, &drive, &good);
        let back = (0..20).map(|_| references(&mut state, &drive, &good)).last().expect("twenty ticks");
        assert!((back.i_q_a - held.i_q_a).abs() < 1e-3, "{broken:?}: {back:?}");
        assert_eq!(state.bad.in_a_row, 0);
    }
}

#[test]
fn whatever_comes_in_finite_references_go_out() {
    let (mut state, drive) = (ReferenceState::default(), drive());
    for torque_nm in HARD {
        for speed_rad_s in HARD {
            for bus_voltage_v in HARD {
                for voltage_share in HARD {
                    let demand = Demand { torque_nm, speed_rad_s, bus_voltage_v, voltage_share };
                    let References { i_d_a, i_q_a } = references(&mut state, &drive, &demand);
                    assert!(i_d_a.is_finite() && i_q_a.is_finite(), "{demand:?}");
                    assert!(i_d_a <= 0.0 && i_d_a.hypot(i_q_a) <= 60.001, "{demand:?}");
                }
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
        let demand = Demand { torque_nm: 7.2, speed_rad_s: 700.0, bus_voltage_v: 270.0, voltage_share: 0.0 };
        assert_eq!(references(&mut state, &Drive::new(&motor, &TUNING), &demand), References::default(), "{motor:?}");
        assert_eq!(state.bad.all, 1);
    }
}
