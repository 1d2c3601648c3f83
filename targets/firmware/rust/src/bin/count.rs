//! Counts the instructions of the steps in Rust, as `../../../programs/count.c` does in C: "STEP KIND INSTRUCTIONS", for inputs of several kinds,
//! under `-icount shift=6`.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use firmware::{board, nominal, stack};
use motor_loop::{CurrentState, Demand, Measured, ReferenceState, References, currents, references};
use throttle_loop::raw::{Counts, RawState, Scaling, raw_step};
use throttle_loop::{Inputs, State, step};

const CALLS: u32 = 1000;

/// Instructions of a call: a tick of the timer is 40 ns, an instruction 64 ns.
fn count(mut call: impl FnMut()) -> u32 {
    board::count_from_now(0);
    let before = board::elapsed(0);
    for _ in 0..CALLS {
        call();
    }
    let ticks = board::elapsed(0) - before;
    (ticks * 40 / 64 + CALLS / 2) / CALLS
}

#[entry]
fn main() -> ! {
    let drive = black_box(nominal::drive());
    let nothing = count(|| {
        black_box(&drive);
    });
    let (mut outer, mut inner) = (ReferenceState::default(), CurrentState::default());
    let (mut state, mut raw) = (State::default(), RawState::default());
    let wanted = References { i_d_a: -3.0, i_q_a: 10.0 };
    let kinds = [
        ("zero", 0.0),
        ("ordinary", 37.3),
        ("negative", -37.3),
        ("large", 1e30),
        ("subnormal", f32::from_bits(1)),
        ("nan", f32::NAN),
        ("infinite", f32::INFINITY),
    ];
    for (gear, (kind, it)) in kinds.into_iter().enumerate() {
        let print = |step: &str, instructions: u32| hprintln!("{} {} {}", step, kind, instructions - nothing);
        let demand = Demand { torque_nm: it, speed_rad_s: it, bus_voltage_v: it, voltage_share: it };
        let references_cost = count(|| {
            black_box(references(black_box(&mut outer), black_box(&drive), black_box(&demand)));
        });
        print("motor_references", references_cost);
        let measured = Measured { currents_a: [it; 3], angle_turns: it, speed_rad_s: it, bus_voltage_v: it };
        let currents_cost = count(|| {
            black_box(currents(black_box(&mut inner), black_box(&drive), black_box(&wanted), black_box(&measured)));
        });
        print("motor_currents", currents_cost);
        let inputs = Inputs { pedal: it, speed_m_s: it, gear: gear as u8, clutch: gear == 3 };
        let throttle_cost = count(|| {
            black_box(step(black_box(&mut state), black_box(&inputs)));
        });
        print("throttle_step", throttle_cost);
        let counts = Counts { pedal: gear as u16 * 700, plate: 1000, speed: 800, lines: 1 << gear };
        let raw_cost = count(|| {
            black_box(raw_step(black_box(&mut raw), black_box(&Scaling::BOARD), black_box(&counts)));
        });
        print("throttle_raw_step", raw_cost);
    }
    let measured = Measured { currents_a: [0.0; 3], angle_turns: 0.0, speed_rad_s: 0.0, bus_voltage_v: 270.0 };
    let demand = Demand { torque_nm: 9.0, speed_rad_s: 600.0, bus_voltage_v: 270.0, voltage_share: 0.5 };
    let inputs = Inputs { pedal: 0.5, speed_m_s: 5.0, gear: 2, clutch: false };
    let counts = Counts { pedal: 2000, plate: 1000, speed: 800, lines: 2 };
    let none = stack::used_by(|| {
        black_box(&drive);
    });
    let bytes = [
        ("nothing", none),
        (
            "motor_references",
            stack::used_by(|| {
                black_box(references(black_box(&mut outer), black_box(&drive), black_box(&demand)));
            }),
        ),
        (
            "motor_currents",
            stack::used_by(|| {
                black_box(currents(black_box(&mut inner), black_box(&drive), black_box(&wanted), black_box(&measured)));
            }),
        ),
        (
            "throttle_step",
            stack::used_by(|| {
                black_box(step(black_box(&mut state), black_box(&inputs)));
            }),
        ),
        (
            "throttle_raw_step",
            stack::used_by(|| {
                black_box(raw_step(black_box(&mut raw), black_box(&Scaling::BOARD), black_box(&counts)));
            }),
        ),
    ];
    for (step, bytes) in bytes {
        hprintln!("{} stack {}", step, bytes);
    }
    debug::exit(debug::EXIT_SUCCESS);
    loop {}
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    debug::exit(debug::EXIT_FAILURE);
    loop {}
}
