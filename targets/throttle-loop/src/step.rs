//! The step in physical units.
//!
//! In: pedal, road speed, gear, clutch. Out: the throttle. Never touches hardware: `raw.rs` has counts.

use branch_free::{BadSamples, if_good, magnitude, nothing, select, within};

use crate::driveline;

/// The gears of the car, and of the surfaces.
pub const GEARS: u8 = 5;

/// How much of the way between pedal and compensator is faded in a tick: the whole in 0.1 s, half a period of the shuffle in a middle gear (30 rad/s), so
/// that fading does not excite it.
pub const FADE_PER_TICK: f32 = 0.01;

/// By how much the gear that the surfaces see moves in a tick, in gears: one in 50 ms, about the time in which a clutch closes.
pub const GEAR_PER_TICK: f32 = 0.02;

/// What the step remembers.
#[derive(Debug, Clone)]
pub struct State {
    /// The two integrators.
    compensator: driveline::TipInStateF32,
    /// The last good pedal and speed.
    pedal: f32,
    speed_m_s: f32,
    /// The gear that the surfaces see.
    gear: f32,
    /// How much of the compensator is in the throttle, 0 to 1.
    share: f32,
    /// Ticks with a pedal or speed that was not finite, or a gear that is none.
    pub bad: BadSamples,
}

impl Default for State {
    /// At rest: pedal up, standing, no compensation yet.
    fn default() -> Self {
        let compensator = driveline::tip_in_init_f32();
        State { compensator, pedal: 0.0, speed_m_s: 0.0, gear: 1.0, share: 0.0, bad: BadSamples::default() }
    }
}

/// One tick's measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Pedal, 0 up to 1 down; what is outside counts as the end.
    pub pedal: f32,
    /// Road speed, in m/s. Its sign does not matter.
    pub speed_m_s: f32,
    /// 0 for neutral, 1 to 5; anything else is a bad sample.
    pub gear: u8,
    /// Whether the clutch is open.
    pub clutch: bool,
}

/// One tick's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outputs {
    /// The throttle, 0 to 1.
    pub throttle: f32,
    /// How much of the compensator is in it: 0 is the pedal itself.
    pub share: f32,
}

/// One tick. `inline(never)` so that its object code stands under one name, where a test reads it.
///
/// The throttle is pedal + share * (compensated - pedal), saturated. The share goes to 1 where a driveline is coupled and known: in a gear, clutch
/// closed, speed and gear good samples, and the two inside the support of the damping surface, that is where data were. Everywhere else it goes to 0,
/// and the throttle is the pedal. It goes at [`FADE_PER_TICK`], and the compensator always runs along: no change of the share is a bump. So an unsupported
/// corner (high speed in low gear) is driven as it would be without this program.
///
/// A gear change moves the gear that the surfaces see at [`GEAR_PER_TICK`], through ratios between: the coefficients move, not jump.
///
/// A pedal that is not a number stands where it stood; speed and gear likewise, while the share fades out.
#[inline(never)]
pub fn step(state: &mut State, inputs: &Inputs) -> Outputs {
    advance(state, inputs)
}

/// The same, for [`step`] and the step from counts.
#[inline(always)]
pub(crate) fn advance(state: &mut State, inputs: &Inputs) -> Outputs {
    let pedal_nothing = nothing(inputs.pedal);
    let speed_nothing = nothing(inputs.speed_m_s);
    let pedal = if_good(pedal_nothing, within(inputs.pedal, 0.0, 1.0), state.pedal);
    let speed_m_s = if_good(speed_nothing, magnitude(inputs.speed_m_s), state.speed_m_s);

    let lever = f32::from(inputs.gear);
    // 1 where one of the gears is in, else 0.
    let in_gear = select(0.0, lever, 1.0, 0.0) * select(lever, f32::from(GEARS) + 0.5, 1.0, 0.0);
    let wanted_gear = select(0.0, in_gear, lever, state.gear);
    let gear = state.gear + within(wanted_gear - state.gear, -GEAR_PER_TICK, GEAR_PER_TICK);

    let known = if_good(speed_nothing, 1.0, 0.0) * in_gear * f32::from(u8::from(!inputs.clutch));
    let supported = driveline::damping_ratio_support_f32(speed_m_s, gear) as f32;
    let share = state.share + within(known * supported - state.share, -FADE_PER_TICK, FADE_PER_TICK);

    let compensated = driveline::tip_in_step_f32(&mut state.compensator, pedal, speed_m_s, gear);
    let throttle = within(pedal + share * (compensated - pedal), 0.0, 1.0);

    state.pedal = pedal;
    state.speed_m_s = speed_m_s;
    state.gear = gear;
    state.share = share;
    state.bad.count((pedal_nothing + speed_nothing < 1.0) & (inputs.gear <= GEARS));
    Outputs { throttle, share }
}
