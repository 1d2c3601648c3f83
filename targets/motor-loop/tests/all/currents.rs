//! The inner step, one period at a time.

use std::f64::consts::TAU;

use motor_loop::{CurrentState, Drive, Measured, References, Tuning, currents};

use crate::{HARD, TUNING, drive};

const AT_REST: Measured = Measured { currents_a: [0.0; 3], angle_turns: 0.0, speed_rad_s: 0.0, bus_voltage_v: 270.0 };

fn i_q(i_q_a: f32) -> References {
    References { i_q_a, ..References::default() }
}

/// A step whose bridge has just closed: it expects what is measured.
fn closed(measured: Measured) -> CurrentState {
    let (mut state, drive) = (CurrentState::default(), drive());
    // Without current, so that references and integrals are 0.
    let at_rest = Measured { currents_a: [0.0; 3], ..measured };
    while state.waiting > 0.0 || state.bus_voltage_v == 0.0 {
        let angle_turns = if state.bus_voltage_v == 0.0 { measured.angle_turns } else { state.angle_turns };
        currents(&mut state, &drive, &References::default(), &Measured { angle_turns, ..at_rest });
    }
    // As if it had been there all the time.
    state.angle_turns = measured.angle_turns;
    state
}

/// The duties of the first period in operation, with references that have arrived.
fn first(references: References, measured: Measured) -> [f32; 3] {
    let mut state = closed(measured);
    (state.reference_d_a, state.reference_q_a) = (references.i_d_a, references.i_q_a);
    let command = currents(&mut state, &drive(), &references, &measured);
    assert_eq!((command.closed, state.bad.all), (1.0, 0), "{measured:?}: {state:?}");
    command.duties
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
        // 1500 rad/s * 0.9 mH * 10 A = 13.5 V on the q axis, a quarter turn before the d axis, and 0.08 ohm * 10 A.
        let [alpha, beta] = vector(duties, 270.0);
        let expected = [-14.3 * (angle * TAU).sin(), 14.3 * (angle * TAU).cos()];
        // Duties near 0.5 in f32 are 6e-8 apart: 270 V of them 1.6e-5 V; some ten roundings.
        assert!(
            (alpha - expected[0]).abs() < 2e-4 && (beta - expected[1]).abs() < 2e-4,
            "{angle}: {alpha} {beta} {expected:?}"
        );
    }
}

#[test]
fn measured_currents_are_turned_into_the_rotor() {
    // 10 A on the q axis at 30 degrees: along phase b (see `rsm-rigs/src/motor/park.rs`). As wanted: no voltage but that of the resistance.
    let measured = Measured { currents_a: [-5.0, 10.0, -5.0], angle_turns: 1.0 / 12.0, ..AT_REST };
    let [alpha, beta] = vector(first(i_q(10.0), measured), 270.0);
    assert!((alpha.hypot(beta) - 0.8).abs() < 2e-4, "{alpha} {beta}");
    // A part common to all three phases is none that flows.
    let shifted = Measured { currents_a: [-2.0, 13.0, -2.0], ..measured };
    let [alpha, beta] = vector(first(i_q(10.0), shifted), 270.0);
    assert!((alpha.hypot(beta) - 0.8).abs() < 2e-4, "{alpha} {beta}");
}

#[test]
fn back_emf_is_met_where_the_rotor_will_be() {
    // 500 rad/s: w_e lambda = 2000 * 0.06 = 120 V on the q axis, 1.5 * 1e-4 s * 2000 rad/s = 0.3 rad later.
    let [alpha, beta] = vector(first(i_q(0.0), Measured { speed_rad_s: 500.0, ..AT_REST }), 270.0);
    assert!((alpha + 120.0 * 0.3f64.sin()).abs() < 1e-3 && (beta - 120.0 * 0.3f64.cos()).abs() < 1e-3, "{alpha} {beta}");
}

#[test]
fn the_voltage_stays_in_the_circle_and_a_large_error_uses_all_of_it_in_its_direction() {
    let radius = 270.0 / 3f64.sqrt();
    for (i_d_a, i_q_a) in [(0.0, 1e4), (-1e4, 0.0), (-1e4, 1e4), (-300.0, 1e4), (1e4, -1e4)] {
        for k in 0..60 {
            let wanted = References { i_d_a, i_q_a };
            let angle_turns = k as f32 / 60.0 - 0.5;
            let duties = first(wanted, Measured { angle_turns, ..AT_REST });
            assert!(duties.iter().all(|duty| (0.0..=1.0).contains(duty)), "{duties:?}");
            let [alpha, beta] = vector(duties, 270.0);
            // Two steps of Newton's method leave 5e-6 of the radius, 8e-4 V, and some ten roundings.
            assert!((alpha.hypot(beta) - radius).abs() < 2e-3, "{i_d_a} {i_q_a}: {}", alpha.hypot(beta));
            // The nearest point of a circle is straight back: the direction is kept.
            let (sin, cos) = (f64::from(angle_turns) * TAU).sin_cos();
            let (v_d, v_q) = (cos * alpha + sin * beta, cos * beta - sin * alpha);
            assert!((v_d * f64::from(i_q_a) - v_q * f64::from(i_d_a)).abs() < 1e-4 * radius * f64::from(i_d_a.hypot(i_q_a)));
        }
    }
}

#[test]
fn integrals_do_not_wind_up_at_the_limit() {
    let (mut state, drive) = (closed(AT_REST), drive());
    // A locked rotor that takes no current: an hour of it. The bridge opens, since the model sees that; the integral is none then. Without the model
    // it is bounded.
    let mut most: f32 = 0.0;
    for period in 0..36_000 {
        currents(&mut state, &drive, &i_q(60.0), &AT_REST);
        most = most.max(state.integral_q_v.abs());
        if period > 100 {
            (state.waiting, state.bad.in_a_row) = (0.0, 0);
            (state.expected_d_a, state.expected_q_a) = (0.0, 0.0);
        }
    }
    // A fifth of the radius.
    assert!(most > 10.0 && f64::from(most) <= 0.2 * 270.0 / 3f64.sqrt() + 1e-4, "{most}");
}

#[test]
fn the_loss_of_the_dead_time_is_given_back_against_the_current() {
    let tuning = Tuning { dead_time_s: 2e-6, dead_time_current_a: 2.0, ..TUNING };
    let with = Drive::new(&super::MOTOR, &tuning);
    // -1 A on the q axis at 90 degrees.
    let wanted = i_q(-1.0);
    let measured = Measured { angle_turns: 0.25, ..AT_REST };
    let without = first(wanted, measured);
    let mut state = closed(measured);
    state.reference_q_a = -1.0;
    let duties = currents(&mut state, &with, &wanted, &measured).duties;
    // 2 us of 100 us, in proportion below 2 A: phases of 1, -1/2, -1/2 A.
    let given = [0.01, -0.005, -0.005];
    for k in 0..3 {
        assert!((duties[k] - without[k] - given[k]).abs() < 3e-7, "{duties:?} {without:?}");
    }
}

/// A rotor at speed with a settled current; what whole sensors say next.
fn turning() -> (CurrentState, Measured) {
    let mut state = closed(Measured { speed_rad_s: 400.0, ..AT_REST });
    for _ in 0..300 {
        let measured = expected(&state);
        currents(&mut state, &drive(), &i_q(20.0), &measured);
    }
    let next = expected(&state);
    (state, next)
}

/// The sample that the step expects.
fn expected(state: &CurrentState) -> Measured {
    let (sin, cos) = (f64::from(state.angle_turns) * TAU).sin_cos();
    let (d, q) = (f64::from(state.expected_d_a), f64::from(state.expected_q_a));
    let (alpha, beta) = (cos * d - sin * q, sin * d + cos * q);
    let side = 0.75f64.sqrt() * beta;
    let currents_a = [alpha, side - 0.5 * alpha, -side - 0.5 * alpha].map(|phase| phase as f32);
    Measured { currents_a, angle_turns: state.angle_turns, speed_rad_s: 400.0, bus_voltage_v: 270.0 }
}

fn spoilt(good: Measured) -> Vec<Measured> {
    let mut bad = vec![];
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 1500.0] {
        for which in 0..6 {
            let mut broken = good;
            match which {
                0..3 => broken.currents_a[which] = value,
                3 => broken.angle_turns = value,
                4 => broken.speed_rad_s = value,
                _ => broken.bus_voltage_v = value,
            }
            bad.push(broken);
        }
    }
    bad.extend([0.0, -0.0, -270.0, 1e-45, 149.0, 361.0, 215.0].map(|bus_voltage_v| Measured { bus_voltage_v, ..good }));
    bad.extend([290.0, 510.0, -400.0].map(|speed_rad_s| Measured { speed_rad_s, ..good }));
    bad.extend([0.05, -0.05, 0.5].map(|off| Measured { angle_turns: good.angle_turns + off, ..good }));
    bad.push(Measured { currents_a: [good.currents_a[0] + 13.0, good.currents_a[1], good.currents_a[2]], ..good });
    bad.push(Measured { currents_a: [0.0; 3], ..good });
    bad
}

#[test]
fn a_bad_sample_is_as_if_the_expected_one_had_come_and_is_counted() {
    let (state, good) = turning();
    let mut whole = state.clone();
    let command = currents(&mut whole, &drive(), &i_q(20.0), &good);
    for broken in spoilt(good) {
        let mut state = state.clone();
        let held = currents(&mut state, &drive(), &i_q(20.0), &broken);
        for k in 0..3 {
            // Roundings of the expected sample, which went through its phases: 1e-6 of 20 A, 1.35 V/A over 270 V.
            assert!((held.duties[k] - command.duties[k]).abs() < 1e-6, "{broken:?}: {held:?} {command:?}");
        }
        assert_eq!((held.closed, state.bad.all, state.bad.in_a_row), (1.0, 1, 1), "{broken:?}");
        let next = expected(&state);
        currents(&mut state, &drive(), &i_q(20.0), &next);
        assert_eq!((state.bad.all, state.bad.in_a_row), (1, 0), "{broken:?}");
    }
}

#[test]
fn ten_bad_samples_open_the_bridge_and_ten_good_ones_close_it_without_a_bump() {
    let (state, good) = turning();
    for broken in spoilt(good) {
        if broken.bus_voltage_v != 270.0 && (150.0..360.0).contains(&broken.bus_voltage_v)
            || broken.speed_rad_s.abs() < 1000.0 && broken.speed_rad_s != 400.0
        {
            // In range: a true jump looks like this, and is believed while the bridge is open.
            continue;
        }
        let mut state = state.clone();
        let tick = |state: &mut CurrentState, whole: bool| {
            let sample = expected(state);
            let sample = if whole { sample } else { broken_like(&broken, &good, sample) };
            currents(state, &drive(), &i_q(20.0), &sample).closed
        };
        for k in 1..=60 {
            assert_eq!(tick(&mut state, false), if k < 10 { 1.0 } else { 0.0 }, "{k}: {broken:?}");
        }
        let mut waited = 0;
        while tick(&mut state, true) == 0.0 {
            waited += 1;
            assert!(waited < 15, "{broken:?}: {state:?}");
        }
        assert!(waited >= 8, "{waited}: {broken:?}");
        // The references are the measured currents, and no integral is left.
        assert_eq!((state.integral_d_v, state.integral_q_v), (0.0, 0.0));
        assert!(
            (state.reference_d_a - state.expected_d_a).abs() < 1e-3 && (state.reference_q_a - state.expected_q_a).abs() < 1e-3
        );
    }
}

/// The expected sample, with what is broken of `broken` beside `good`.
fn broken_like(broken: &Measured, good: &Measured, mut sample: Measured) -> Measured {
    for k in 0..3 {
        if broken.currents_a[k].to_bits() != good.currents_a[k].to_bits() {
            sample.currents_a[k] = if broken.currents_a == [0.0; 3] { f32::NAN } else { broken.currents_a[k] + 100.0 };
        }
    }
    if broken.angle_turns.to_bits() != good.angle_turns.to_bits() {
        sample.angle_turns = f32::NAN;
    }
    if broken.speed_rad_s.to_bits() != good.speed_rad_s.to_bits() {
        sample.speed_rad_s = broken.speed_rad_s;
    }
    if broken.bus_voltage_v.to_bits() != good.bus_voltage_v.to_bits() {
        sample.bus_voltage_v = broken.bus_voltage_v;
    }
    sample
}

#[test]
fn a_current_beyond_the_circle_opens_the_bridge_at_once() {
    let (mut state, _) = turning();
    (state.expected_d_a, state.expected_q_a) = (0.0, 65.0);
    let sample = expected(&state);
    assert_eq!(currents(&mut state, &drive(), &i_q(20.0), &sample).closed, 0.0);
    assert_eq!(state.bad.all, 0, "it was no bad sample");
}

#[test]
fn before_the_first_good_samples_the_bridge_is_open() {
    let (mut state, drive) = (CurrentState::default(), drive());
    for _ in 0..20 {
        assert_eq!(currents(&mut state, &drive, &i_q(20.0), &Measured { speed_rad_s: f32::NAN, ..AT_REST }).closed, 0.0);
    }
    for _ in 0..9 {
        assert_eq!(currents(&mut state, &drive, &i_q(20.0), &AT_REST).closed, 0.0);
    }
}

#[test]
fn whatever_comes_in_duties_between_0_and_1_go_out() {
    let (mut state, drive) = (CurrentState::default(), drive());
    for a in HARD {
        for angle_turns in HARD {
            for speed_rad_s in HARD {
                for bus_voltage_v in HARD {
                    let measured = Measured { currents_a: [a, -0.5 * a, 3.0], angle_turns, speed_rad_s, bus_voltage_v };
                    let command = currents(&mut state, &drive, &i_q(20.0), &measured);
                    assert!(command.duties.iter().all(|duty| (0.0..=1.0).contains(duty)), "{measured:?}: {command:?}");
                    assert!(command.closed == 0.0 || command.closed == 1.0);
                    let CurrentState { expected_d_a, expected_q_a, angle_turns: at, speed_rad_s: speed, .. } = state;
                    assert!(
                        [state.integral_d_v, state.integral_q_v, expected_d_a, expected_q_a, at, speed]
                            .iter()
                            .all(|v| v.is_finite()),
                        "{measured:?}: {state:?}"
                    );
                }
            }
        }
    }
}
