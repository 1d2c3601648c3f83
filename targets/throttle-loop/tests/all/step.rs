//! The step in physical units.

use throttle_loop::{CLOSE_PER_TICK, FADE_PER_TICK, HOLD_TICKS, Inputs, Outputs, REOPEN_PER_TICK, State, driveline, step};

const CRUISE: Inputs = Inputs { pedal: 0.2, speed_m_s: 12.0, gear: 2, clutch: false };

/// How far from the pedal the compensator may rest: |z - p|/(2 g) units in the last place of 0.2 (see `rsm-core/src/lower/compensator.rs`),
/// with z - p = -0.32 and g = 0.0065 some 25 of 1.5e-8.
const REST: f32 = 5e-7;

/// Runs the same inputs for some ticks; the last answer.
fn run(state: &mut State, inputs: Inputs, ticks: u32) -> Outputs {
    (0..ticks).map(|_| step(state, &inputs)).last().expect("at least one tick")
}

/// A car in gear, its compensator faded in.
fn cruising() -> State {
    let mut state = State::default();
    let found = run(&mut state, CRUISE, 3000);
    assert!((found.throttle - 0.2).abs() < REST && found.share == 1.0, "{found:?}");
    state
}

#[test]
fn a_tip_in_is_that_of_the_compensator_in_double_precision() {
    let mut state = cruising();
    let mut alone = driveline::tip_in_init();
    for _ in 0..3000 {
        driveline::tip_in_step(&mut alone, f64::from(0.2f32), 12.0, 2.0);
    }
    let mut least: f32 = 1.0;
    for tick in 0..3000 {
        let found = step(&mut state, &Inputs { pedal: 0.8, ..CRUISE }).throttle;
        let expected = driveline::tip_in_step(&mut alone, f64::from(0.8f32), 12.0, 2.0).clamp(0.0, 1.0);
        // The dead zone of rest in f32, four times as wide at 0.8 as at 0.2, twice: where it came from and where it goes.
        assert!((f64::from(found) - expected).abs() <= f64::from(8.0 * REST), "tick {tick}: {found} {expected}");
        least = least.min(found - 0.8);
    }
    assert!(least < -0.05, "the compensator does something: {least}");
}

#[test]
fn where_nothing_is_to_be_compensated_the_pedal_goes_through_to_the_bit() {
    let open = Inputs { clutch: true, ..CRUISE };
    let neutral = Inputs { gear: 0, ..CRUISE };
    // High speed in low gear, low speed in high gear: no engine runs there, no data are there.
    let too_fast = Inputs { speed_m_s: 48.0, gear: 1, ..CRUISE };
    let too_slow = Inputs { speed_m_s: 3.0, gear: 5, ..CRUISE };
    let no_speed = Inputs { speed_m_s: f32::NAN, ..CRUISE };
    let no_gear = Inputs { gear: 6, ..CRUISE };
    for bypassed in [open, neutral, too_fast, too_slow, no_speed, no_gear] {
        let mut state = cruising();
        run(&mut state, bypassed, 500);
        for pedal in [0.9, 0.1, 1.0, 0.0] {
            let found = step(&mut state, &Inputs { pedal, ..bypassed });
            assert_eq!(found, Outputs { throttle: pedal, share: 0.0 }, "{bypassed:?}");
        }
    }
}

#[test]
fn fading_is_no_bump() {
    let mut state = cruising();
    let pressed = Inputs { pedal: 0.7, ..CRUISE };
    // In the middle of a tip-in, where pedal and compensator differ most.
    let mut last = run(&mut state, pressed, 40).throttle;
    let apart = 0.7 - last;
    assert!(apart > 0.05, "{apart}");
    for inputs in [Inputs { clutch: true, ..pressed }, pressed, Inputs { speed_m_s: f32::INFINITY, ..pressed }, pressed] {
        for tick in 0..30 {
            let now = step(&mut state, &inputs).throttle;
            // A fade of 1 % of what lies between, and what the compensator itself moves: below 2 % of the step of 0.5 a tick.
            assert!((now - last).abs() < FADE_PER_TICK * 0.5 + 0.01, "{inputs:?}, tick {tick}: {last} to {now}");
            last = now;
        }
    }
}

#[test]
fn a_gear_change_is_no_bump() {
    let pressed = Inputs { pedal: 0.7, ..CRUISE };
    let mut quiet = cruising();
    let mut shifting = cruising();
    run(&mut quiet, pressed, 20);
    let mut last = run(&mut shifting, pressed, 20).throttle;
    for tick in 0..100 {
        let moved = step(&mut quiet, &pressed).throttle;
        let now = step(&mut shifting, &Inputs { gear: 3, ..pressed }).throttle;
        assert!((now - last).abs() < 0.02, "tick {tick}: {last} to {now}, {moved} without the change");
        last = now;
    }
    // At rest a gear change moves nothing at all.
    let mut state = cruising();
    for gear in [3, 1, 4, 2] {
        for _ in 0..60 {
            assert!((step(&mut state, &Inputs { gear, ..CRUISE }).throttle - 0.2).abs() < REST);
        }
    }
}

#[test]
fn a_bad_pedal_stands_where_it_stood_and_bad_samples_are_counted() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut state = cruising();
        let found = run(&mut state, Inputs { pedal: value, ..CRUISE }, 3);
        assert!((found.throttle - 0.2).abs() < REST && found.share == 1.0, "{found:?}");
        assert_eq!((state.bad.all, state.bad.in_a_row), (3, 3));
        step(&mut state, &CRUISE);
        step(&mut state, &Inputs { speed_m_s: value, ..CRUISE });
        step(&mut state, &Inputs { gear: 6, ..CRUISE });
        assert_eq!((state.bad.all, state.bad.in_a_row), (5, 2));
        // Neutral and an open clutch are no faults.
        step(&mut state, &Inputs { gear: 0, clutch: true, ..CRUISE });
        assert_eq!((state.bad.all, state.bad.in_a_row), (5, 0));
    }
}

/// FMVSS 124 (49 CFR 571.124, S5.3): back to idle within 1 s after a connection is lost. It once stayed open for ever.
#[test]
fn a_pedal_wire_that_is_torn_at_full_pedal_closes_the_throttle() {
    for value in [f32::NAN, f32::INFINITY, 2.0, -1.0, 1e30] {
        let mut state = cruising();
        let full = Inputs { pedal: 1.0, ..CRUISE };
        let mut last = run(&mut state, full, 3000).throttle;
        assert!(last > 0.99);
        let torn = Inputs { pedal: value, ..full };
        for tick in 0..3000 {
            let now = step(&mut state, &torn).throttle;
            if (tick as f32) < HOLD_TICKS {
                assert!((now - last).abs() < 1e-5, "{value}, tick {tick}: held");
            }
            assert!(last - now < CLOSE_PER_TICK + 1e-6 && now <= last + 1e-6, "{value}, tick {tick}: {last} to {now}");
            assert!(tick < 310 || now == 0.0, "{value}: {now} after {tick} ms");
            last = now;
        }
        // Back, with the foot still down: no bump, and all of it after a second and what the compensator takes.
        for tick in 0..3000 {
            let now = step(&mut state, &full).throttle;
            assert!((now - last).abs() < 2.0 * REOPEN_PER_TICK, "{value}, tick {tick}: {last} to {now}");
            last = now;
        }
        assert!(last > 0.99 && state.cap == 1.0, "{value}: {last}");
    }
}

#[test]
fn a_loose_contact_is_not_felt() {
    let mut state = cruising();
    for tick in 0..5000 {
        let pedal = if tick % 60 < 50 { f32::NAN } else { 0.2 };
        assert!((step(&mut state, &Inputs { pedal, ..CRUISE }).throttle - 0.2).abs() < REST, "tick {tick}");
    }
    assert_eq!(state.cap, 1.0);
}

#[test]
fn a_speed_that_jumps_is_bad_and_is_taken_when_the_share_is_gone() {
    let mut state = cruising();
    let jumped = Inputs { speed_m_s: 20.0, ..CRUISE };
    for _ in 0..100 {
        assert_eq!(state.bad.all, state.bad.in_a_row);
        step(&mut state, &jumped);
    }
    assert!(state.bad.all >= 99, "{:?}", state.bad);
    run(&mut state, jumped, 200);
    let good = state.bad.in_a_row;
    assert_eq!(good, 0);
    // A single wild sample costs a hundredth of the share.
    let mut state = cruising();
    step(&mut state, &Inputs { speed_m_s: 60.0, ..CRUISE });
    assert_eq!(state.bad.all, 1);
    assert_eq!(run(&mut state, CRUISE, 2).share, 1.0);
}

#[test]
fn whatever_comes_in_a_throttle_between_0_and_1_goes_out() {
    let hard = [0.0, -0.0, 1e-45, -1e-45, 0.5, 1.5, 30.0, f32::MAX, f32::MIN, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let mut state = State::default();
    for gear in [0, 1, 2, 3, 4, 5, 6, 255] {
        for clutch in [false, true] {
            for pedal in hard {
                for speed_m_s in hard {
                    let Outputs { throttle, share } = run(&mut state, Inputs { pedal, speed_m_s, gear, clutch }, 3);
                    assert!(
                        (0.0..=1.0).contains(&throttle) && (0.0..=1.0).contains(&share),
                        "{pedal} {speed_m_s} {gear} {clutch}"
                    );
                }
            }
        }
    }
}
