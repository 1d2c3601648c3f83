//! What a motor engineer expects of the step.

use motor_loop::{Inputs, Limits, Outputs, State, pmac, step};

const TICK_S: f32 = 0.001;
const UNLIMITED: Limits = Limits { current_a: 60.0, advance_rate_deg_s: f32::INFINITY };

fn inputs(torque_nm: f32, speed_rad_s: f32) -> Inputs {
    Inputs { torque_nm, speed_rad_s, current_a: 30.0 }
}

fn first(limits: Limits, inputs: Inputs) -> Outputs {
    step(&mut State::new(limits, TICK_S), inputs)
}

#[test]
fn the_angle_is_that_of_the_surface() {
    // (26) at the centre of the box and at torque 21.6 (x1 = 1), speed 400 (x2 = 0): 38.19 + 25.46 - 11.04 = 52.61.
    assert_eq!(first(UNLIMITED, inputs(10.8, 400.0)).advance_deg, 38.19);
    let at_edge = first(UNLIMITED, inputs(21.6, 400.0)).advance_deg;
    // Within 4 steps of f32 at 52 (3.8e-6 each): the rounded coefficients and three sums.
    assert!((at_edge - 52.61).abs() < 1.6e-5, "{at_edge}");
}

#[test]
fn the_current_vector_has_the_wanted_length_and_direction() {
    let outputs = first(UNLIMITED, inputs(5.0, 700.0));
    let gamma = f64::from(outputs.advance_deg).to_radians();
    // 30 A times the 2e-7 of sine and cosine, and the rounding of 30 in f32 (2e-6).
    assert!((f64::from(outputs.i_d_a) + 30.0 * gamma.sin()).abs() < 1e-5, "{outputs:?}");
    assert!((f64::from(outputs.i_q_a) - 30.0 * gamma.cos()).abs() < 1e-5, "{outputs:?}");
    assert!((f64::from(outputs.advance_rad) - gamma).abs() < 1e-6, "{outputs:?}");
}

#[test]
fn the_other_quadrants_mirror_the_first() {
    let motoring = first(UNLIMITED, inputs(5.0, 700.0));
    let braking = first(UNLIMITED, inputs(-5.0, 700.0));
    let reversed = first(UNLIMITED, inputs(5.0, -700.0));
    assert_eq!(braking, Outputs { i_q_a: -motoring.i_q_a, ..motoring });
    assert_eq!(reversed, motoring);
}

#[test]
fn the_current_is_limited_and_never_negative() {
    let length = |current_a| {
        let outputs = first(UNLIMITED, Inputs { current_a, ..inputs(10.8, 400.0) });
        f64::from(outputs.i_d_a).hypot(f64::from(outputs.i_q_a))
    };
    assert!((length(1e6) - 60.0).abs() < 1e-4);
    assert_eq!(length(-5.0), 0.0);
    let nothing_allowed = Limits { current_a: f32::NAN, ..UNLIMITED };
    let outputs = first(nothing_allowed, inputs(10.8, 400.0));
    assert_eq!((outputs.i_d_a.abs(), outputs.i_q_a.abs()), (0.0, 0.0));
}

#[test]
fn outside_the_map_the_edge_of_the_map_holds() {
    let edge = first(UNLIMITED, inputs(21.6, 800.0));
    assert_eq!(first(UNLIMITED, inputs(1e30, 1e30)), edge);
}

#[test]
fn the_angle_moves_no_faster_than_the_limit() {
    // 4500 degrees a second is 4.5 degrees a tick. From (10.8, 400), 38.19 degrees, to (21.6, 400), 52.61 degrees, are 14.42 degrees.
    let limits = Limits { advance_rate_deg_s: 4500.0, ..UNLIMITED };
    let mut state = State::new(limits, TICK_S);
    let mut angle = step(&mut state, inputs(10.8, 400.0)).advance_deg;
    let goal = first(UNLIMITED, inputs(21.6, 400.0)).advance_deg;
    for tick in 1..=4 {
        let next = step(&mut state, inputs(21.6, 400.0)).advance_deg;
        // One rounding of the sum at 50 degrees, 2e-6, and of the product of rate and tick.
        let expected = if tick <= 3 { angle + 4.5 } else { goal };
        assert!((next - expected).abs() < 1e-5, "tick {tick}: {next}");
        angle = next;
    }
    // And down again.
    let down = step(&mut state, inputs(10.8, 400.0)).advance_deg;
    assert!((down - (goal - 4.5)).abs() < 1e-5, "{down}");
}

#[test]
fn one_bad_sample_holds_the_last_good_references_and_is_counted() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    for value in bad {
        for which in 0..3 {
            let mut state = State::new(UNLIMITED, TICK_S);
            let good = step(&mut state, inputs(5.0, 700.0));
            let mut broken = inputs(5.0, 700.0);
            *[&mut broken.torque_nm, &mut broken.speed_rad_s, &mut broken.current_a][which] = value;
            assert_eq!(step(&mut state, broken), Outputs { held: true, ..good }, "{broken:?}");
            assert_eq!(step(&mut state, broken), Outputs { held: true, ..good }, "{broken:?}");
            assert_eq!((state.bad_samples(), state.bad_in_a_row()), (2, 2));
            assert_eq!(step(&mut state, inputs(5.0, 700.0)), good);
            assert_eq!((state.bad_samples(), state.bad_in_a_row()), (2, 0));
        }
    }
}

#[test]
fn before_the_first_good_sample_no_current_is_commanded() {
    let outputs = first(UNLIMITED, inputs(f32::NAN, 700.0));
    assert!(outputs.held);
    assert_eq!((outputs.i_d_a, outputs.i_q_a, outputs.advance_deg), (0.0, 0.0, 0.0));
}

#[test]
fn whatever_comes_in_finite_references_go_out() {
    let hard = [0.0, -0.0, 1e-45, -1e-45, 21.6, 800.0, f32::MAX, f32::MIN, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3.7];
    let mut state = State::new(Limits { advance_rate_deg_s: 100.0, ..UNLIMITED }, TICK_S);
    for torque_nm in hard {
        for speed_rad_s in hard {
            for current_a in hard {
                let outputs = step(&mut state, Inputs { torque_nm, speed_rad_s, current_a });
                let Outputs { advance_deg, advance_rad, i_d_a, i_q_a, .. } = outputs;
                assert!([advance_deg, advance_rad, i_d_a, i_q_a].iter().all(|v| v.is_finite()), "{outputs:?}");
                assert!((0.0..=90.0).contains(&advance_deg) && i_d_a <= 0.0 && i_d_a.hypot(i_q_a) <= 60.001, "{outputs:?}");
            }
        }
    }
}

#[test]
fn the_evaluator_is_that_of_the_module() {
    assert_eq!(first(UNLIMITED, inputs(3.0, 100.0)).advance_deg, pmac::current_advance_f32(3.0, 100.0));
}
