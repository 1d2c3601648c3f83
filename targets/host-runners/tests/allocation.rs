//! The steps allocate nothing. A binary of its own, since another test in it could allocate meanwhile.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static COUNTING: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// How many times `run` calls the allocator. A thread of the test harness may call it at any moment, so the smallest number of
/// three runs counts: allocations of the steps would be in all three.
fn allocator_calls(mut run: impl FnMut()) -> usize {
    let calls = (0..3).map(|_| {
        let region = Region::new(COUNTING);
        run();
        let change = region.change();
        change.allocations + change.reallocations + change.deallocations
    });
    calls.min().expect("three runs")
}

#[test]
fn the_steps_allocate_nothing() {
    let counted = allocator_calls(|| drop(std::hint::black_box(Box::new(1))));
    assert_eq!(counted, 2, "the counting itself: one allocation, one release");

    let motor = motor_loop::Motor {
        phase_resistance_ohm: 0.08,
        phase_inductance_h: 0.9e-3,
        flux_linkage_wb: 0.06,
        pole_pairs: 4.0,
        bus_voltage_v: 270.0,
        current_limit_a: 60.0,
    };
    let tuning =
        motor_loop::Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 1e-6, dead_time_current_a: 1.0 };
    let drive = motor_loop::Drive::new(&motor, &tuning);
    let mut outer = motor_loop::ReferenceState::default();
    let mut inner = motor_loop::CurrentState::default();
    let mut throttle = throttle_loop::raw::RawState::default();
    // Ten seconds of ticks, bad samples among them.
    let counted = allocator_calls(|| {
        for tick in 0..10_000u16 {
            let torn = tick % 1000 == 500;
            let speed_rad_s = if torn { f32::NAN } else { f32::from(tick) * 0.08 };
            let demand = motor_loop::Demand { torque_nm: 5.0, speed_rad_s, bus_voltage_v: 270.0, voltage_share: 0.0 };
            let wanted = motor_loop::references(&mut outer, &drive, std::hint::black_box(&demand));
            let measured =
                motor_loop::Measured { currents_a: [1.0, 2.0, -3.0], angle_turns: 0.3, speed_rad_s, bus_voltage_v: 270.0 };
            std::hint::black_box(motor_loop::currents(&mut inner, &drive, &wanted, std::hint::black_box(&measured)));
            let pedal = if torn { 0 } else { 400 + tick % 3000 };
            let counts = throttle_loop::raw::Counts { pedal, plate: 1000, speed: 800, lines: 2 };
            let board = throttle_loop::raw::Scaling::BOARD;
            std::hint::black_box(throttle_loop::raw::raw_step(&mut throttle, &board, std::hint::black_box(&counts)));
        }
    });
    assert_eq!(counted, 0);
    assert!(outer.bad.all > 0 && inner.bad.all > 0 && throttle.step.bad.all > 0, "the held ticks were not among them");
}
