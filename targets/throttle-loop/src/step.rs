//! The step in physical units.
//!
//! In: pedal, road speed, gear, clutch. Out: the throttle. Never accesses hardware: `raw.rs` converts the counts.

use branch_free::{BadSamples, at_least, at_most, magnitude, select, within};

use crate::driveline;

/// The gears of the car, and of the surfaces.
pub const GEARS: u8 = 5;

/// The change of the share of the compensator in a tick: from 0 to 1 in 0.1 s, half a period of the shuffle in a middle gear (30 rad/s), so
/// that fading does not excite it.
pub const FADE_PER_TICK: f32 = 0.01;

/// The change, in a tick, of the gear that the surfaces get, in gears: one in 50 ms, about the time in which a clutch closes.
pub const GEAR_PER_TICK: f32 = 0.02;

/// For this many bad pedal samples in a row the last good one is held; then the throttle closes. 50 ms: the driver does not feel a short loose
/// contact.
pub const HOLD_TICKS: f32 = 50.0;

/// The rate at which a lost pedal closes the throttle, in a tick: the whole stroke in 0.25 s. Together with the holding time that is 0.3 s; FMVSS 124
/// (49 CFR 571.124, S5.3) requires idle within 1 s after a connection is lost.
pub const CLOSE_PER_TICK: f32 = 0.004;

/// The rate at which the throttle may open again when the pedal signal is back, in a tick: the whole stroke in 1 s. So the car does not jump if the
/// driver has kept the pedal down.
pub const REOPEN_PER_TICK: f32 = 0.001;

/// A pedal reading at least this far from the middle of the stroke is bad: three times the half stroke. A nearer reading outside the stroke counts as
/// its end.
const PEDAL_BAND: f32 = 1.5;

/// A road speed of this or more is bad, in m/s.
const SPEED_BAND_M_S: f32 = 100.0;

/// A road speed that changes by this or more in a tick is bad, in m/s: 200 times the limit of tyres.
const SPEED_PER_TICK_M_S: f32 = 2.0;

/// The state of the step.
#[derive(Debug, Clone)]
pub struct State {
    /// The two integrators.
    compensator: driveline::TipInStateF32,
    /// The last good pedal and speed.
    pedal: f32,
    speed_m_s: f32,
    /// The gear that the surfaces get.
    gear: f32,
    /// The share of the compensator in the throttle, 0 to 1.
    share: f32,
    /// Bad pedal samples in a row.
    lost: f32,
    /// The upper limit of the throttle: 1; less, down to 0, while a fault closes it or while it opens again.
    pub cap: f32,
    /// Ticks with an implausible pedal or speed, or an invalid gear.
    pub bad: BadSamples,
}

impl Default for State {
    /// At rest: pedal up, speed 0, no compensation yet.
    fn default() -> Self {
        let compensator = driveline::tip_in_init_f32();
        State {
            compensator,
            pedal: 0.0,
            speed_m_s: 0.0,
            gear: 1.0,
            share: 0.0,
            lost: 0.0,
            cap: 1.0,
            bad: BadSamples::default(),
        }
    }
}

/// One tick's measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Pedal, 0 (up) to 1 (down); a value outside counts as the nearest end.
    pub pedal: f32,
    /// Road speed, in m/s. Its sign does not matter.
    pub speed_m_s: f32,
    /// 0 for neutral, 1 to 5; anything else is a bad sample.
    pub gear: u8,
    /// Whether the clutch is open.
    pub clutch: bool,
}

/// The results of one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outputs {
    /// The throttle, 0 to 1.
    pub throttle: f32,
    /// The share of the compensator: 0 is the pedal itself.
    pub share: f32,
}

/// One tick. `inline(never)` gives its object code a name of its own, which a test reads.
///
/// The throttle is pedal + share * (compensated - pedal), saturated. The share goes to 1 under four conditions: a gear is engaged, the clutch is
/// closed, the samples of speed and gear are good, and both are inside the support of the damping surface, where there were data. Otherwise it goes
/// to 0, and the throttle is the pedal. The share changes by [`FADE_PER_TICK`], and the compensator always runs, so a change of the share makes no
/// step in the throttle. In an unsupported corner (high speed in low gear) the car behaves as without this program.
///
/// At a gear change the gear that the surfaces get changes by [`GEAR_PER_TICK`], through values between two gears, so the coefficients do not jump.
///
/// If the pedal sample is NaN or far outside its stroke, the last good one is held for [`HOLD_TICKS`]. Then the throttle closes at [`CLOSE_PER_TICK`]
/// and stays closed. When the pedal is back it may open at [`REOPEN_PER_TICK`]. The pedal itself may jump over its whole stroke. If the speed is
/// implausible in range or rate, or the gear is invalid, the last good one is held while the share fades out. At a share of 0 any speed in the range
/// is accepted, so that a real jump is not refused forever.
#[inline(never)]
pub fn step(state: &mut State, inputs: &Inputs) -> Outputs {
    advance(state, inputs, 0.0)
}

/// The same, for [`step`] and the step from counts; `fault` is 1 if another fault than that of the pedal must close the throttle, else 0.
#[inline(always)]
pub(crate) fn advance(state: &mut State, inputs: &Inputs, fault: f32) -> Outputs {
    let pedal_good = select(magnitude(inputs.pedal - 0.5), PEDAL_BAND, 1.0, 0.0);
    let lost = (state.lost + 1.0) * (1.0 - pedal_good);
    let closing = select(HOLD_TICKS, lost, 1.0, fault);
    let closed = at_least(at_most(state.cap, state.pedal) - CLOSE_PER_TICK, 0.0);
    let cap = select(0.0, closing, closed, at_most(state.cap + REOPEN_PER_TICK, 1.0));
    let pedal = at_most(select(0.0, pedal_good, within(inputs.pedal, 0.0, 1.0), state.pedal), cap);

    let road = magnitude(inputs.speed_m_s);
    let in_range = select(road, SPEED_BAND_M_S, 1.0, 0.0);
    let any = select(0.0, state.share, 0.0, 1.0);
    let speed_good = in_range * select(magnitude(road - state.speed_m_s), SPEED_PER_TICK_M_S, 1.0, any);
    let speed_m_s = select(0.0, speed_good, road, state.speed_m_s);

    let lever = f32::from(inputs.gear);
    // 1 if a gear is engaged, else 0.
    let in_gear = select(0.0, lever, 1.0, 0.0) * select(lever, f32::from(GEARS) + 0.5, 1.0, 0.0);
    let wanted_gear = select(0.0, in_gear, lever, state.gear);
    let gear = state.gear + within(wanted_gear - state.gear, -GEAR_PER_TICK, GEAR_PER_TICK);

    let known = speed_good * in_gear * f32::from(u8::from(!inputs.clutch));
    let supported = driveline::damping_ratio_support_f32(speed_m_s, gear) as f32;
    let share = state.share + within(known * supported - state.share, -FADE_PER_TICK, FADE_PER_TICK);

    let compensated = driveline::tip_in_step_f32(&mut state.compensator, pedal, speed_m_s, gear);
    let throttle = within(pedal + share * (compensated - pedal), 0.0, cap);

    state.pedal = pedal;
    state.speed_m_s = speed_m_s;
    state.gear = gear;
    state.share = share;
    state.lost = lost;
    state.cap = cap;
    state.bad.count((0.0 < pedal_good * speed_good) & (inputs.gear <= GEARS));
    Outputs { throttle, share }
}
