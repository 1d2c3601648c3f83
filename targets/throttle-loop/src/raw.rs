//! The step with the signals of a small microcontroller: A/D counts and gear lines in, a PWM compare value out.
//!
//! In: three conversions and the pattern of the digital inputs. Out: a compare value. All scaling is in one table, [`Scaling`]; a C program has the
//! same struct. A conversion outside the band of its sensor means a broken or shorted wire, and an impossible pattern of gear lines means a broken
//! line: both become bad samples of [`crate::step()`].

use branch_free::{BadSamples, magnitude, select};

use crate::step::advance;
use crate::{GEARS, Inputs, State};

/// The bit of the clutch switch in [`Counts::lines`].
pub const CLUTCH_LINE: u32 = 1 << GEARS;

/// The commanded and the measured throttle may differ by this much before a tick is counted: 10 % of the stroke.
const PLATE_TOLERANCE: f32 = 0.1;

/// The throttle closes after this many ticks in a row in which the plate does not follow its command: 0.1 s. A third of the time for a whole stroke
/// of the plate would be too short; three strokes are enough.
pub const PLATE_TICKS: f32 = 100.0;

/// A linear sensor on a 12-bit converter: value = (counts - zero) * per_count.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Channel {
    /// Counts at the value 0.
    pub zero: f32,
    /// Value of a count.
    pub per_count: f32,
    /// The lowest count of an intact wire.
    pub lowest: f32,
    /// The highest count of an intact wire.
    pub highest: f32,
}

/// All scaling between the board and the step.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Scaling {
    /// Pedal, 0 to 1.
    pub pedal: Channel,
    /// Throttle plate, 0 to 1.
    pub plate: Channel,
    /// Road speed, in m/s.
    pub speed: Channel,
    /// The compare value of a closed throttle.
    pub compare_closed: f32,
    /// The compare values from closed to open. Closed and this together are 65535 at most.
    pub compare_span: f32,
}

impl Scaling {
    /// A 12-bit converter (0 to 4095). Pedal and plate are potentiometers that use 10 % to 90 % of the reference, so that a torn wire (0 %) and a
    /// short (100 %) are outside; 5 % is left for tolerance. Road speed is 0 V to reference for 0 to 60 m/s, from a converter of wheel pulses whose
    /// output never reaches the last 1 %. PWM with a period of 3600 counts (20 kHz from 72 MHz), 5 % to 95 % of which drive the throttle.
    pub const BOARD: Scaling = Scaling {
        pedal: Channel { zero: 409.5, per_count: 1.0 / 3276.0, lowest: 205.0, highest: 3890.0 },
        plate: Channel { zero: 409.5, per_count: 1.0 / 3276.0, lowest: 205.0, highest: 3890.0 },
        speed: Channel { zero: 0.0, per_count: 60.0 / 4095.0, lowest: 0.0, highest: 4054.0 },
        compare_closed: 180.0,
        compare_span: 3240.0,
    };
}

/// The readings of the board in one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Counts {
    /// Pedal.
    pub pedal: u16,
    /// Throttle plate.
    pub plate: u16,
    /// Road speed.
    pub speed: u16,
    /// Gear lines: bit k - 1 is gear k; no bit is neutral; more than one is a broken line. Bit 5 is the clutch switch; all others must be 0.
    pub lines: u32,
}

/// The state of the raw step.
#[derive(Debug, Clone, Default)]
pub struct RawState {
    /// The state of the step.
    pub step: State,
    /// The last command, 0 to 1.
    throttle: f32,
    /// 1 while the plate's fault closes the throttle, else 0.
    closing: f32,
    /// Ticks in which the plate did not follow its command, or its wire was broken. [`PLATE_TICKS`] of them in a row close the throttle, until the
    /// plate follows again.
    pub plate: BadSamples,
}

/// Counts of a channel as a number: NaN outside the band of the sensor.
#[inline(always)]
fn value(channel: &Channel, counts: u16) -> f32 {
    let counts = f32::from(counts);
    let value = (counts - channel.zero) * channel.per_count;
    let not_low = select(counts, channel.lowest, f32::NAN, value);
    select(channel.highest, counts, f32::NAN, not_low)
}

/// The gear of a pattern of lines: 0 to 5, or 255 if the pattern is impossible.
#[inline(always)]
fn gear(lines: u32) -> u8 {
    let gears = lines & (CLUTCH_LINE - 1);
    // Each bit times its gear: with at most one bit set, the sum is that gear.
    let number = (gears & 1) + (gears & 2) + 3 * (gears >> 2 & 1) + 4 * (gears >> 3 & 1) + 5 * (gears >> 4);
    let several = gears & gears.wrapping_sub(1);
    let torn = u32::from(several | lines >> (GEARS + 1) != 0);
    ((number | 0u32.wrapping_sub(torn)) & 255) as u8
}

/// One tick: the compare value of the PWM.
#[inline(never)]
pub fn raw_step(state: &mut RawState, scaling: &Scaling, counts: &Counts) -> u16 {
    let inputs = Inputs {
        pedal: value(&scaling.pedal, counts.pedal),
        speed_m_s: value(&scaling.speed, counts.speed),
        gear: gear(counts.lines),
        clutch: counts.lines & CLUTCH_LINE != 0,
    };
    let deviation = magnitude(value(&scaling.plate, counts.plate) - state.throttle);
    // If the plate is stuck, slow, or its position is unknown, the throttle closes until the plate follows.
    // It closes completely, even if the command passes the position at which the plate is stuck.
    let still = select(0.0, state.step.cap, state.closing, 0.0);
    let fault = select(PLATE_TICKS, state.plate.in_a_row as f32, 1.0, still);
    state.closing = fault;
    let throttle = advance(&mut state.step, &inputs, fault).throttle;
    state.plate.count(deviation <= PLATE_TOLERANCE);
    state.throttle = throttle;
    // Rounded to the nearest count: the number is finite and in the range of the table, so the conversion only truncates.
    (scaling.compare_closed + scaling.compare_span * throttle + 0.5) as u16
}
