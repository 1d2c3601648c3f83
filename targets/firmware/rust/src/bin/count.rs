//! Counts the instructions of the steps in Rust, as `../../../programs/count.c` does in C: "STEP INSTRUCTIONS", under `-icount shift=6`.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use firmware::board;
use motor_loop::{CurrentState, Demand, Drive, Measured, Motor, ReferenceState, References, Tuning, currents, references};
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
    let motor = Motor {
        phase_resistance_ohm: 0.08,
        phase_inductance_h: 0.0009,
        flux_linkage_wb: 0.06,
        pole_pairs: 4.0,
        bus_voltage_v: 270.0,
        current_limit_a: 60.0,
    };
    let tuning = Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 1e-6, dead_time_current_a: 1.0 };
    let drive = black_box(Drive::new(&motor, &tuning));
    let nothing = count(|| {
        black_box(&drive);
    });
    let (mut outer, mut inner) = (ReferenceState::default(), CurrentState::default());
    let demand = Demand { torque_nm: 9.0, speed_rad_s: 300.0, bus_voltage_v: 270.0, voltage_share: 0.5 };
    let measured = Measured { currents_a: [1.0, 2.0, -3.0], angle_turns: 0.1, speed_rad_s: 300.0, bus_voltage_v: 270.0 };
    let wanted = References { i_d_a: -3.0, i_q_a: 10.0 };
    let print = |name: &str, instructions: u32| hprintln!("{} {}", name, instructions - nothing);
    print("motor_references", count(|| {
        black_box(references(black_box(&mut outer), black_box(&drive), black_box(&demand)));
    }));
    print("motor_currents", count(|| {
        black_box(currents(black_box(&mut inner), black_box(&drive), black_box(&wanted), black_box(&measured)));
    }));
    let (mut state, mut raw) = (State::default(), RawState::default());
    let inputs = Inputs { pedal: 0.4, speed_m_s: 12.0, gear: 2, clutch: false };
    print("throttle_step", count(|| {
        black_box(step(black_box(&mut state), black_box(&inputs)));
    }));
    let counts = Counts { pedal: 2000, plate: 1000, speed: 800, lines: 2 };
    print("throttle_raw_step", count(|| {
        black_box(raw_step(black_box(&mut raw), black_box(&Scaling::BOARD), black_box(&counts)));
    }));
    debug::exit(debug::EXIT_SUCCESS);
    loop {}
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    debug::exit(debug::EXIT_FAILURE);
    loop {}
}
