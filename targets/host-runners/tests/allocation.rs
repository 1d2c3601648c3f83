//! The steps allocate nothing. A binary of its own, since another test in it could allocate meanwhile.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static COUNTING: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// How many times `run` goes to the allocator. The test harness has a thread of its own that may do so at any moment, so the least of
/// three runs counts: what the steps themselves allocate, they allocate in all three.
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

    let limits = motor_loop::Limits { current_a: 60.0, advance_rate_deg_s: 4500.0 };
    let mut motor = motor_loop::State::new(limits, 0.001);
    let mut throttle = throttle_loop::State::new();
    // Ten seconds of ticks, bad samples among them.
    let counted = allocator_calls(|| {
        for tick in 0..10_000 {
            let inputs = host_runners::motor::demand(tick, 1_000_000);
            std::hint::black_box(motor_loop::step(&mut motor, std::hint::black_box(inputs)));
            let inputs = host_runners::throttle::drive(tick, 1_000_000);
            std::hint::black_box(throttle_loop::step(&mut throttle, std::hint::black_box(inputs)));
        }
    });
    assert_eq!(counted, 0);
    assert!(motor.bad_samples() > 0 && throttle.bad_samples() > 0, "the held ticks were not among them");
}
