//! What a driveline engineer expects of the step.

use throttle_loop::{GEARS, Inputs, Outputs, State, TARGET_DAMPING, step};

fn first(speed_mph: f64, gear: u8) -> Outputs {
    step(&mut State::new(), Inputs { speed_mph, gear })
}

#[test]
fn the_damping_is_that_of_the_surface_and_the_deficit_fills_it_up() {
    // (32) at x1 = -1 (10 mph), x2 = 0 (third gear): 0.4079 + 0.804 + 0.0519 = 1.2638, more than the target: nothing is missing.
    let slow = first(10.0, 3);
    // Three sums of numbers near 1 in f64, 1.1e-16 each.
    assert!((slow.damping_ratio - 1.2638).abs() < 1e-15, "{slow:?}");
    assert_eq!(slow.damping_deficit, 0.0);
    // x1 = 0 (40 mph), x2 = -1 (first gear): 0.4079 - 0.3809 - 0.0429 = -0.0159: no driveline has that.
    assert!(first(40.0, 1).bypass);
    // x1 = 0, x2 = 1 (fifth gear): 0.4079 + 0.3809 - 0.0429 = 0.7459.
    let fifth = first(40.0, 5);
    assert!((fifth.damping_ratio - 0.7459).abs() < 1e-15 && fifth.damping_deficit == 0.0 && !fifth.bypass, "{fifth:?}");
}

#[test]
fn the_compensator_is_bypassed_exactly_where_the_published_surface_is_not_positive() {
    let mut bypassed = 0;
    for gear in 1..=GEARS {
        for speed in 10..=70 {
            let outputs = first(f64::from(speed), gear);
            assert_eq!(outputs.bypass, outputs.damping_ratio <= 0.0, "{speed} mph, gear {gear}");
            assert!(outputs.damping_deficit >= 0.0);
            if outputs.damping_ratio < TARGET_DAMPING {
                // The sum is what places the new pair: the target, to one rounding.
                assert!((outputs.damping_ratio + outputs.damping_deficit - TARGET_DAMPING).abs() <= f64::EPSILON);
            }
            bypassed += u32::from(outputs.bypass);
        }
    }
    // The misprint shows: about a quarter of the box.
    assert!((40..=120).contains(&bypassed), "{bypassed} of 305");
}

#[test]
fn in_neutral_there_is_nothing_to_damp() {
    let outputs = first(40.0, 0);
    assert!(outputs.bypass && !outputs.held);
    assert_eq!(outputs.damping_deficit, 0.0);
}

#[test]
fn a_bad_sample_holds_the_last_answer_and_is_counted() {
    for bad in [
        Inputs { speed_mph: f64::NAN, gear: 3 },
        Inputs { speed_mph: f64::INFINITY, gear: 3 },
        Inputs { speed_mph: 40.0, gear: 6 },
        Inputs { speed_mph: 40.0, gear: 255 },
    ] {
        let mut state = State::new();
        assert!(step(&mut state, bad).bypass, "nothing is known yet");
        let good = step(&mut state, Inputs { speed_mph: 40.0, gear: 3 });
        assert_eq!(step(&mut state, bad), Outputs { held: true, ..good });
        assert_eq!((state.bad_samples(), state.bad_in_a_row()), (2, 1));
        assert_eq!(step(&mut state, Inputs { speed_mph: 40.0, gear: 3 }), good);
        assert_eq!((state.bad_samples(), state.bad_in_a_row()), (2, 0));
    }
}

#[test]
fn outside_the_map_the_edge_of_the_map_holds() {
    assert_eq!(first(300.0, 4), first(70.0, 4));
    assert_eq!(first(0.0, 4), first(10.0, 4));
    assert_eq!(first(-40.0, 4), first(40.0, 4));
}
