//! The 1 kHz step of a permanent-magnet AC motor in flux weakening.
//!
//! In, once a tick: torque demand, rotor speed and the length of the current vector. Out: the current advance angle from the response surface
//! `pmac`, the published surface (26), and the references i_d, i_q of the current controller. The step allocates nothing, cannot panic and has no loop; it
//! needs nothing outside `core`. It does not control currents: at 7500 rpm with 4 pole pairs a millisecond is half an electrical turn, so
//! an inner step at 10 kHz or more does that and takes its references from here.
//!
//! A sample that is not a number (a torn wire, a failed conversion, a division by zero upstream) never reaches the inverter: the
//! references of the last good tick are held, and counted. How many are too many is for the caller to say.
//!
//! ```
//! use motor_loop::{Inputs, Limits, State, step};
//!
//! let mut state = State::new(Limits { current_a: 60.0, advance_rate_deg_s: 4500.0 }, 0.001);
//! let outputs = step(&mut state, Inputs { torque_nm: 10.8, speed_rad_s: 400.0, current_a: 30.0 });
//! assert_eq!(outputs.advance_deg, 38.19);   // the centre of the surface: its constant term
//! let held = step(&mut state, Inputs { torque_nm: f32::NAN, speed_rad_s: 400.0, current_a: 30.0 });
//! assert!(held.held && held.i_q_a == outputs.i_q_a && state.bad_samples() == 1);
//! ```
#![no_std]
// Denied, not forbidden: on a host the emitted evaluator clamps with SSE2 instructions, which are `unsafe` functions to Rust. There is no other.
#![deny(unsafe_code)]

mod angle;

// Single precision: the FPU of the drives that this is for (Cortex-M4F) has no other, and 1e-5 degrees is far below an encoder.
rsm_macros::include_model!("../../generated/coefficients/pmac.toml", precision = "f32");

/// What the drive allows. A limit that is negative or not a number allows nothing: its value is taken as 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The longest current vector, in amperes.
    pub current_a: f32,
    /// The fastest change of the advance angle, in degrees a second; infinite for no limit. A torque step moves the surface's angle at once,
    /// the flux behind it follows with the time constant of the d axis.
    pub advance_rate_deg_s: f32,
}

/// What the step remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    current_limit_a: f32,
    advance_step_deg: f32,
    /// Nothing before the first good tick.
    last: Option<Outputs>,
    bad_samples: u32,
    bad_in_a_row: u32,
}

/// One tick's measurements and demands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Torque demand, in N m. Negative brakes.
    pub torque_nm: f32,
    /// Rotor speed, in mechanical rad/s. Negative turns backwards.
    pub speed_rad_s: f32,
    /// The wanted length of the current vector, in amperes; clamped to 0 and the limit.
    pub current_a: f32,
}

/// One tick's references.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outputs {
    /// Current advance gamma in degrees, 0 to 90, after the rate limit.
    pub advance_deg: f32,
    /// The same in radians.
    pub advance_rad: f32,
    /// i_d = -I sin gamma, in amperes: never positive, it weakens the magnets' flux.
    pub i_d_a: f32,
    /// i_q = I cos gamma with the sign of the torque demand, in amperes (21).
    pub i_q_a: f32,
    /// Whether these are the references of an earlier tick, because this tick's inputs were not finite.
    pub held: bool,
}

impl Outputs {
    /// No current: what is commanded before anything is known.
    const NOTHING: Outputs = Outputs { advance_deg: 0.0, advance_rad: 0.0, i_d_a: 0.0, i_q_a: 0.0, held: true };
}

impl State {
    /// A controller at rest, called every `tick_s` seconds.
    #[must_use]
    pub fn new(limits: Limits, tick_s: f32) -> Self {
        State {
            current_limit_a: allowed(limits.current_a),
            advance_step_deg: allowed(limits.advance_rate_deg_s * tick_s),
            last: None,
            bad_samples: 0,
            bad_in_a_row: 0,
        }
    }

    /// How many ticks had an input that was not finite; stays at the largest number when it gets there.
    #[must_use]
    pub fn bad_samples(&self) -> u32 {
        self.bad_samples
    }

    /// How many such ticks came one after another up to now: 0 after a good one.
    #[must_use]
    pub fn bad_in_a_row(&self) -> u32 {
        self.bad_in_a_row
    }
}

/// One tick. `inline(never)` so that its object code stands under one name, where a test reads it.
#[inline(never)]
pub fn step(state: &mut State, inputs: Inputs) -> Outputs {
    let Inputs { torque_nm, speed_rad_s, current_a } = inputs;
    if !(torque_nm.is_finite() && speed_rad_s.is_finite() && current_a.is_finite()) {
        state.bad_samples = state.bad_samples.saturating_add(1);
        state.bad_in_a_row = state.bad_in_a_row.saturating_add(1);
        return Outputs { held: true, ..state.last.unwrap_or(Outputs::NOTHING) };
    }
    state.bad_in_a_row = 0;

    // The surface was measured with positive torque and speed. The machine is the same in the other quadrants: braking turns i_q, i_d stays.
    let wanted_deg = pmac::current_advance_f32(torque_nm.abs(), speed_rad_s.abs());
    let advance_deg = match state.last {
        Some(last) => towards(last.advance_deg, wanted_deg, state.advance_step_deg),
        // A drive may be switched on while its motor turns: there is no earlier angle to be gentle with, and 0 may be far from safe.
        None => wanted_deg,
    };
    let (sin, cos) = angle::sin_cos(advance_deg);
    let length_a = clamped(current_a, state.current_limit_a);
    let outputs = Outputs {
        advance_deg,
        advance_rad: advance_deg.to_radians(),
        i_d_a: -(length_a * sin),
        i_q_a: (length_a * cos).copysign(torque_nm),
        held: false,
    };
    state.last = Some(outputs);
    outputs
}

/// From one value towards another, by at most `most`.
fn towards(from: f32, to: f32, most: f32) -> f32 {
    let change = to - from;
    if change > most {
        from + most
    } else if change < -most {
        from - most
    } else {
        to
    }
}

/// A finite value, at least 0 and at most `high`.
fn clamped(value: f32, high: f32) -> f32 {
    let positive = if value < 0.0 { 0.0 } else { value };
    if high < positive { high } else { positive }
}

/// A limit as given, or 0 when it is none.
fn allowed(limit: f32) -> f32 {
    if limit > 0.0 { limit } else { 0.0 }
}
