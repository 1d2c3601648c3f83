//! The functions of the two interrupts: `../../image.c` in Rust, with the same bits.

use core::sync::atomic::{AtomicU32, Ordering};

use motor_loop::{Command, CurrentState, Demand, Drive, Measured, ReferenceState, References, currents, references};
use throttle_loop::raw::{Counts, RawState, Scaling, raw_step};

use crate::handover::Handover;

/// Periods of the currents between two calls of the references.
pub const PERIODS: u32 = 10;

/// The functions of a board for the currents' interrupt.
pub trait Bridge {
    /// Samples of the motor, at the centre of the PWM's period.
    fn sample(&mut self) -> Measured;
    /// Sets the bridge for the next period.
    fn command(&mut self, command: &Command);
}

/// The functions of a board for the references' interrupt.
pub trait Driver {
    /// The torque demand, in N m.
    fn torque_demand_nm(&mut self) -> f32;
    /// Converters and lines of the throttle.
    fn counts(&mut self) -> Counts;
    /// Sets the compare value of the throttle's PWM, and the limit: 0 if the drive of the plate must be switched off.
    fn throttle(&mut self, compare: u16, cap: f32);
    /// Restarts the watchdog's count.
    fn feed_watchdog(&mut self);
}

/// The samples of the inner step that the outer step needs, as one set.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    speed_rad_s: f32,
    bus_voltage_v: f32,
    voltage_share: f32,
}

/// The data shared by the interrupts.
#[derive(Debug)]
pub struct Between {
    reference: Handover<References>,
    seen: Handover<Seen>,
    periods: AtomicU32,
}

impl Between {
    /// Without current and samples.
    pub const fn new() -> Self {
        Between {
            reference: Handover::new(References { i_d_a: 0.0, i_q_a: 0.0 }),
            seen: Handover::new(Seen { speed_rad_s: 0.0, bus_voltage_v: 0.0, voltage_share: 0.0 }),
            periods: AtomicU32::new(0),
        }
    }
}

impl Default for Between {
    fn default() -> Self {
        Between::new()
    }
}

/// The interrupt every 0.1 ms, with the higher priority. `inline(never)` gives its stack frame a name of its own, which a test reads.
///
/// # Safety
/// Only this interrupt calls it.
#[inline(never)]
pub unsafe fn current_interrupt(state: &mut CurrentState, drive: &Drive, between: &Between, board: &mut impl Bridge) {
    // SAFETY: the references' interrupt is the only writer, and cannot run in between.
    let reference = unsafe { between.reference.take() };
    let measured = board.sample();
    let command = currents(state, drive, &reference, &measured);
    board.command(&command);
    let seen =
        Seen { speed_rad_s: measured.speed_rad_s, bus_voltage_v: measured.bus_voltage_v, voltage_share: state.voltage_share };
    // SAFETY: this is the only writer; it comes again after 0.1 ms, and a reading takes about ten instructions.
    unsafe { between.seen.put(seen) };
    between.periods.store(between.periods.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// Sets the safe state immediately: bridge open, the drive of the plate switched off. For the watchdog's alarm, and after a reset by it.
pub fn safe_state(bridge: &mut impl Bridge, driver: &mut impl Driver) {
    bridge.command(&Command { duties: [0.5; 3], closed: 0.0 });
    driver.throttle((Scaling::BOARD.compare_closed + 0.5) as u16, 0.0);
}

/// The state of the references' interrupt.
#[derive(Debug, Clone, Default)]
pub struct Slow {
    /// The state of the motor's step.
    pub references: ReferenceState,
    /// The state of the throttle's step.
    pub throttle: RawState,
    /// The number of periods of the currents at the last call.
    pub periods_before: u32,
}

/// The interrupt every millisecond, with the lower priority. Feeds the watchdog if the currents were controlled in the meantime. `inline(never)` as
/// above.
///
/// # Safety
/// Only this interrupt calls it.
#[inline(never)]
pub unsafe fn reference_interrupt(state: &mut Slow, drive: &Drive, between: &Between, board: &mut impl Driver) {
    // SAFETY: this is the only reader; the writer comes every 0.1 ms.
    let seen = unsafe { between.seen.take() };
    let periods = between.periods.load(Ordering::Relaxed);
    let demand = Demand {
        torque_nm: board.torque_demand_nm(),
        speed_rad_s: seen.speed_rad_s,
        bus_voltage_v: seen.bus_voltage_v,
        voltage_share: seen.voltage_share,
    };
    let wanted = references(&mut state.references, drive, &demand);
    // SAFETY: this is the only writer; its reader interrupts it and is never interrupted by it.
    unsafe { between.reference.put(wanted) };

    let compare = raw_step(&mut state.throttle, &Scaling::BOARD, &board.counts());
    board.throttle(compare, state.throttle.step.cap);

    if periods.wrapping_sub(state.periods_before) >= PERIODS / 2 {
        board.feed_watchdog();
    }
    state.periods_before = periods;
}
