//! The step of a drive-by-wire throttle that damps driveline shuffle: how much damping the driveline has, and how much it lacks.
//!
//! In, once a tick: road speed and gear. Out: the damping ratio from the response surface `throttle`, the published surface (32), and the
//! deficit to the target 0.7. They are the b and the d of the feedforward (a s^2 + b s + c)/(a s^2 + d s + c) on the pedal demand: b cancels
//! the lightly damped pair, d places the new one. The step allocates nothing, cannot panic and has no loop; it needs nothing outside `core`. It does not touch the
//! throttle: where its answer is not to be relied on it says `bypass`, and the pedal demand is to be passed on as it is.
//!
//! ```
//! use throttle_loop::{Inputs, State, step};
//!
//! let mut state = State::new();
//! let outputs = step(&mut state, Inputs { speed_mph: 40.0, gear: 3 });
//! assert_eq!(outputs.damping_ratio, 0.4079);   // the centre of the surface: its constant term
//! assert_eq!(outputs.damping_deficit, 0.7 - 0.4079);
//! assert!(!outputs.bypass);
//! ```
#![no_std]
// Denied, not forbidden: on a host the emitted evaluator clamps with SSE2 instructions, which are `unsafe` functions to Rust. There is no other.
#![deny(unsafe_code)]

/// The evaluator, made by build.rs from `generated/coefficients/throttle.toml`.
// Double precision: the compensator that takes these numbers has its poles within 0.02 of 1 at a 1 ms tick, where single precision
// would leave five digits of their distance.
pub mod throttle {
    include!(concat!(env!("OUT_DIR"), "/throttle.rs"));
}

/// The damping ratio that the compensated driveline is to have, section 4 of the paper.
pub const TARGET_DAMPING: f64 = 0.7;

/// The gears of the car, and of the surface.
pub const GEARS: u8 = 5;

/// What the step remembers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct State {
    /// Nothing before the first good tick.
    last: Option<Outputs>,
    bad_samples: u32,
    bad_in_a_row: u32,
}

/// One tick's measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Road speed, in mph. Its sign does not matter.
    pub speed_mph: f64,
    /// The gear as read from the digital inputs: 0 for neutral, 1 to 5; anything else is a bad sample.
    pub gear: u8,
}

/// One tick's damping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outputs {
    /// The surface's damping ratio of the driveline as it is.
    pub damping_ratio: f64,
    /// What is missing to [`TARGET_DAMPING`], never negative: damping that is there is not taken away.
    pub damping_deficit: f64,
    /// Pass the pedal demand on as it is: neutral, no good sample yet, or a damping ratio that no driveline has (see [`step`]).
    pub bypass: bool,
    /// Whether this is the answer of an earlier tick, because this tick's inputs were bad.
    pub held: bool,
}

impl Outputs {
    /// What is answered before anything is known, and in neutral.
    const NOTHING: Outputs = Outputs { damping_ratio: TARGET_DAMPING, damping_deficit: 0.0, bypass: true, held: false };
}

impl State {
    /// Nothing known yet.
    #[must_use]
    pub fn new() -> Self {
        State::default()
    }

    /// How many ticks had a speed that was not finite or a gear that is none; stays at the largest number when it gets there.
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
///
/// The published surface is negative on a quarter of its box, probably by a misprint (see the coefficient file). With b from a negative
/// ratio the compensator's zeros would lie in the right half plane and the car would first answer the pedal backwards; with b = 0 it would
/// ring for ever. So the compensator is bypassed where the ratio is not above 0.
#[inline(never)]
pub fn step(state: &mut State, inputs: Inputs) -> Outputs {
    let Inputs { speed_mph, gear } = inputs;
    if !speed_mph.is_finite() || gear > GEARS {
        state.bad_samples = state.bad_samples.saturating_add(1);
        state.bad_in_a_row = state.bad_in_a_row.saturating_add(1);
        return Outputs { held: true, ..state.last.unwrap_or(Outputs::NOTHING) };
    }
    state.bad_in_a_row = 0;
    let outputs = if gear == 0 {
        // The engine is not coupled to the wheels: there is no shuffle to damp.
        Outputs::NOTHING
    } else {
        let damping_ratio = throttle::damping_ratio(speed_mph.abs(), f64::from(gear));
        let missing = TARGET_DAMPING - damping_ratio;
        let damping_deficit = if missing > 0.0 { missing } else { 0.0 };
        Outputs { damping_ratio, damping_deficit, bypass: damping_ratio <= 0.0, held: false }
    };
    state.last = Some(outputs);
    outputs
}
