//! What a motor engineer expects of the steps.

mod circle;
mod closed_loop;
mod currents;
mod references;

use motor_loop::{Drive, Motor, Tuning};

/// The trial motor of the project (`rsm-sim/plants/pmac.toml`).
const MOTOR: Motor = Motor {
    phase_resistance_ohm: 0.08,
    phase_inductance_h: 0.9e-3,
    flux_linkage_wb: 0.06,
    pole_pairs: 4.0,
    bus_voltage_v: 270.0,
    current_limit_a: 60.0,
};

/// 10 kHz, and a bandwidth of 1/(6 T).
const TUNING: Tuning = Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 0.0, dead_time_current_a: 1.0 };

fn drive() -> Drive {
    Drive::new(&MOTOR, &TUNING)
}

/// Numbers that hurt.
const HARD: [f32; 12] =
    [0.0, -0.0, 1e-45, -1e-45, 0.37, -21.6, 800.0, f32::MAX, f32::MIN, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
