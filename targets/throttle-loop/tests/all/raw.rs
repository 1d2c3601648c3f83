//! The step from counts, and the ends of the scaling table.

use throttle_loop::raw::{CLUTCH_LINE, Counts, RawState, Scaling, raw_step};
use throttle_loop::{Inputs, State, step};

const BOARD: Scaling = Scaling::BOARD;

/// Counts of a pedal or plate of 0 to 1.
fn of_share(share: f32) -> u16 {
    (409.5 + 3276.0 * share).round() as u16
}

/// Counts of a speed.
fn of_speed(speed_m_s: f32) -> u16 {
    (speed_m_s * 4095.0 / 60.0).round() as u16
}

const CRUISE: Counts = Counts { pedal: 1065, plate: 1065, speed: 819, lines: 0b00010 };

fn run(state: &mut RawState, counts: Counts, ticks: u32) -> u16 {
    (0..ticks).map(|_| raw_step(state, &BOARD, &counts)).last().expect("at least one tick")
}

/// The counts of a plate that stands where a compare value puts it.
fn plate_at(compare: u16) -> u16 {
    of_share((f32::from(compare) - 180.0) / 3240.0)
}

/// The same with a plate that follows at once.
fn follow(state: &mut RawState, counts: Counts, ticks: u32) -> u16 {
    let mut compare = 180;
    for _ in 0..ticks {
        compare = raw_step(state, &BOARD, &Counts { plate: plate_at(compare), ..counts });
    }
    compare
}

#[test]
fn the_ends_of_the_table_are_the_ends_of_the_stroke() {
    let at = |pedal: u16| follow(&mut RawState::default(), Counts { pedal, ..CRUISE }, 3000);
    // 0 is 10 % of 4095, closed is 5 % of 3600; 1 is 90 %, open is 95 %.
    assert_eq!((at(410), at(3685)), (180, 3420));
    // Rounded: half a count of pedal is half a count of 3240/3276.
    assert_eq!(at(2048), 1800);
    // Beyond the stroke but inside the band the end holds.
    assert_eq!((at(205), at(3890)), (180, 3420));
}

#[test]
fn a_wire_outside_its_band_is_a_bad_sample() {
    for broken in [
        Counts { pedal: 204, ..CRUISE },
        Counts { pedal: 3891, ..CRUISE },
        Counts { pedal: 0, ..CRUISE },
        Counts { pedal: 65535, ..CRUISE },
        Counts { speed: 4055, ..CRUISE },
        Counts { lines: 0b00011, ..CRUISE },
        Counts { lines: 0b11111, ..CRUISE },
        Counts { lines: 0b1000010, ..CRUISE },
        Counts { lines: 1 << 31, ..CRUISE },
    ] {
        let mut state = RawState::default();
        let held = run(&mut state, CRUISE, 3000);
        assert_eq!(state.step.bad.all, 0);
        assert_eq!(run(&mut state, broken, 7), held, "{broken:?}");
        assert_eq!((state.step.bad.all, state.step.bad.in_a_row), (7, 7), "{broken:?}");
        assert_eq!(run(&mut state, CRUISE, 1), held);
        assert_eq!(state.step.bad.in_a_row, 0);
    }
}

#[test]
fn a_plate_that_is_not_where_it_was_told_to_be_is_counted() {
    let mut state = RawState::default();
    // The first ticks compare with a throttle that is still opening.
    run(&mut state, CRUISE, 3000);
    let before = state.plate.all;
    run(&mut state, CRUISE, 100);
    assert_eq!(state.plate.all, before);
    // The command is 0.2001; 0.11 beside it, and a torn wire.
    run(&mut state, Counts { plate: of_share(0.311), ..CRUISE }, 5);
    run(&mut state, Counts { plate: 0, ..CRUISE }, 5);
    assert_eq!((state.plate.all, state.plate.in_a_row), (before + 10, 10));
    run(&mut state, Counts { plate: of_share(0.295), ..CRUISE }, 1);
    assert_eq!(state.plate.in_a_row, 0);
}

/// Torn and shorted wires of every channel, and a plate that is stuck, after full pedal: the table of limp-home.
#[test]
fn broken_wires_and_a_stuck_plate_close_the_throttle_and_the_way_back_is_no_bump() {
    let full = Counts { pedal: 3685, ..CRUISE };
    // What is broken, how, and whether it closes the throttle within a second; else the pedal goes through.
    type Case = (&'static str, fn(&mut Counts), bool);
    let cases: [Case; 9] = [
        ("pedal torn", |counts| counts.pedal = 0, true),
        ("pedal shorted", |counts| counts.pedal = 4095, true),
        ("plate torn", |counts| counts.plate = 0, true),
        ("plate shorted", |counts| counts.plate = 4095, true),
        // It is closed already: what is tried again stays below 0.1, and 100 ticks of 0.001 more.
        ("plate stuck closed", |counts| counts.plate = 410, true),
        ("plate stuck half open", |counts| counts.plate = 2048, true),
        ("speed torn", |counts| counts.speed = 4095, false),
        ("gear line torn", |counts| counts.lines = 0b00110, false),
        ("another line", |counts| counts.lines = 1 << 20, false),
    ];
    for (name, break_it, closes) in cases {
        let mut state = RawState::default();
        let mut compare = follow(&mut state, full, 3000);
        assert_eq!(compare, 3420, "{name}");
        let mut closed_at = None;
        for tick in 0..1000 {
            let mut counts = Counts { plate: plate_at(compare), ..full };
            break_it(&mut counts);
            let next = raw_step(&mut state, &BOARD, &counts);
            // 0.004 of 3240 a tick, and a rounding.
            assert!(compare.saturating_sub(next) <= 14, "{name}, tick {tick}: {compare} to {next}");
            compare = next;
            if compare == 180 {
                closed_at.get_or_insert(tick);
            }
        }
        assert_eq!(closed_at.is_some(), closes, "{name}");
        if closes {
            assert!(closed_at.is_some_and(|tick| tick < 400), "{name}: {closed_at:?}");
            let most = if name == "plate stuck closed" { 180 + 3240 / 4 } else { 180 };
            assert!(compare <= most, "{name}: {compare}");
        }
        for tick in 0..4000 {
            let next = raw_step(&mut state, &BOARD, &Counts { plate: plate_at(compare), ..full });
            // Up by 0.001 of 3240 a tick, twice for the compensator, and a rounding; a plate that is still being closed goes down first.
            assert!(next <= compare + 8 && compare <= next + 14, "{name}, tick {tick}: {compare} to {next}");
            compare = next;
        }
        // The compensator rests within a count.
        assert!(compare >= 3419, "{name}: the way back: {compare}");
    }
}

#[test]
fn it_is_the_same_step() {
    let (mut raw, mut plain) = (RawState::default(), State::default());
    let mut compare = 180;
    for tick in 0u32..4000 {
        let pedal = if tick / 400 % 2 == 0 { 0.2 } else { 0.8 };
        let gear = [2, 3, 0, 5][(tick / 1000) as usize];
        let clutch = tick % 1000 < 50;
        let speed = 12.0 + tick as f32 / 400.0;
        let lines = if gear == 0 { 0 } else { 1 << (gear - 1) } | if clutch { CLUTCH_LINE } else { 0 };
        let counts = Counts { pedal: of_share(pedal), plate: plate_at(compare), speed: of_speed(speed), lines };
        compare = raw_step(&mut raw, &BOARD, &counts);
        let inputs = Inputs {
            pedal: (f32::from(counts.pedal) - 409.5) / 3276.0,
            speed_m_s: f32::from(counts.speed) * 60.0 / 4095.0,
            gear,
            clutch,
        };
        let throttle = step(&mut plain, &inputs).throttle;
        let expected = 180.0 + 3240.0 * throttle;
        // Half a count of rounding, and the roundings of quotients against products (1e-7 of a stroke, 3e-4 counts).
        assert!((f32::from(compare) - expected).abs() < 0.51, "tick {tick}: {compare} {expected}");
    }
}

#[test]
fn every_count_gives_a_compare_value_of_the_table() {
    let mut state = RawState::default();
    for counts in (0..=65535u16).step_by(97) {
        for lines in [0, 1, 2, 4, 8, 16, 32, 33, 48, 64, 0xFFFF_FFFF] {
            let compare = raw_step(&mut state, &BOARD, &Counts { pedal: counts, plate: counts, speed: counts ^ 0x0F0F, lines });
            assert!((180..=3420).contains(&compare), "{counts} {lines}: {compare}");
        }
    }
}
