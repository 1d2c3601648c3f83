//! The motor of `rsm-sim/plants/pmac.toml` at 10 kHz, as in `../tables.c`. A test compares the bits of the results.

use motor_loop::{Drive, Motor, Tuning};

/// The constants of its drive.
#[must_use]
pub fn drive() -> Drive {
    let motor = Motor {
        phase_resistance_ohm: 0.08,
        phase_inductance_h: 0.0009,
        flux_linkage_wb: 0.06,
        pole_pairs: 4.0,
        bus_voltage_v: 270.0,
        current_limit_a: 60.0,
    };
    let tuning = Tuning { pwm_period_s: 1e-4, bandwidth_rad_s: 1500.0, dead_time_s: 1e-6, dead_time_current_a: 1.0 };
    Drive::new(&motor, &tuning)
}
