//! The motor, in the stator frame.
//!
//! In docs/book/src/reference/plants.md, (17) and (18) are in the rotor frame. With complex numbers, i = i_d + j i_q there and s = i exp(j th_e)
//! here,
//!
//! ```text
//! L ds/dt = v exp(j th_e) - r s - j w_e lambda exp(j th_e),
//! ```
//!
//! so nothing is coupled. Quantities that docs/book/src/reference/plants.md has in rotor coordinates are rotated at the interfaces: voltages in,
//! currents out. In: voltages as recorded and the load torque. Out: currents as recorded and the speed.

use crate::flow::{Flow, STATES, State, Stepper};
use crate::plant::{Delay, Plant, Truth};

const ALPHA: usize = 0;
const BETA: usize = 1;
const SPEED: usize = 2;
const ANGLE: usize = 3;
/// For the second inertia, if there is one.
const LOAD_SPEED: usize = 4;
const TWIST: usize = 5;
const HEAT: usize = 6;
/// Three lags.
const LAG: usize = 7;
const TIME: usize = 10;

struct Law {
    r: f64,
    l: f64,
    lambda: f64,
    pairs: f64,
    inertia: f64,
    // Effects of the catalogue; an absent effect has the value that does not change the formula.
    coulomb: f64,
    forward: f64,
    backward: f64,
    viscous_forward: f64,
    viscous_backward: f64,
    stribeck_coulomb: f64,
    stribeck_static: f64,
    stribeck_velocity: f64,
    windage: f64,
    constant_load: f64,
    load_drift: f64,
    cogging: f64,
    cycles: f64,
    phase: f64,
    ripple: f64,
    saturation: f64,
    thermal_resistance: f64,
    thermal_time: f64,
    voltage_loss: f64,
    limit: f64,
    offset: f64,
    eccentricity: f64,
    gain: f64,
    ratio: f64,
    stiffness: f64,
    damping: f64,
    lags: Vec<Option<f64>>,
    // Effects outside the catalogue.
    unbalance: f64,
    sag: f64,
    flywheel: f64,
    grip: f64,
    friction_swing: f64,
    friction_period: f64,
    /// Constant inputs: voltages as recorded, load torque.
    voltage: (f64, f64),
    load: f64,
}

/// A running motor.
pub struct Motor {
    law: Law,
    y: State,
    stepper: Stepper,
    delay: Delay,
}

impl Motor {
    /// A motor at rest, without current, at angle 0.
    pub fn new(truth: &Truth, period: f64) -> Self {
        let of = |name| truth.parameters.get(name);
        let viscous = of("viscous_friction");
        let law = Law {
            r: of("phase_resistance"),
            l: of("phase_inductance"),
            lambda: of("flux_linkage"),
            pairs: of("pole_pairs"),
            inertia: of("inertia"),
            coulomb: truth.or("coulomb-friction", "torque", 0.0),
            forward: truth.or("asymmetric-friction", "forward", 0.0),
            backward: truth.or("asymmetric-friction", "backward", 0.0),
            viscous_forward: truth.or("asymmetric-friction", "viscous_forward", viscous),
            viscous_backward: truth.or("asymmetric-friction", "viscous_backward", viscous),
            stribeck_coulomb: truth.or("stribeck-friction", "coulomb", 0.0),
            stribeck_static: truth.or("stribeck-friction", "static", 0.0),
            stribeck_velocity: truth.or("stribeck-friction", "stribeck_velocity", 1.0),
            windage: truth.or("windage", "coefficient", 0.0),
            constant_load: truth.or("constant-load", "torque", 0.0),
            load_drift: truth.or("load-drift", "torque_rate", 0.0),
            cogging: truth.or("cogging-torque", "amplitude", 0.0),
            cycles: truth.or("cogging-torque", "cycles", 0.0),
            phase: truth.or("cogging-torque", "phase", 0.0),
            ripple: truth.or("torque-ripple", "amplitude", 0.0),
            saturation: truth.or("magnetic-saturation", "saturation_current", f64::INFINITY),
            thermal_resistance: truth.or("resistance-heating", "thermal_resistance", 0.0),
            thermal_time: truth.or("resistance-heating", "thermal_time_constant", 1.0),
            voltage_loss: truth.or("inverter-dead-time", "voltage_loss", 0.0),
            limit: truth.or("voltage-limit", "limit", f64::INFINITY),
            offset: truth.or("angle-offset", "angle", 0.0),
            eccentricity: truth.or("angle-eccentricity", "amplitude", 0.0),
            gain: truth.or("input-gain", "gain", 1.0),
            ratio: truth.or("shaft-compliance", "inertia_ratio", 0.0),
            stiffness: truth.or("shaft-compliance", "stiffness", 0.0),
            damping: truth.or("shaft-compliance", "damping", 0.0),
            lags: truth.lags(),
            unbalance: truth.or("phase-unbalance", "share", 0.0),
            sag: truth.or("bus-sag", "per_square_ampere", 0.0),
            flywheel: truth.or("slipping-flywheel", "inertia", 0.0),
            grip: truth.or("slipping-flywheel", "torque", 0.0),
            friction_swing: truth.or("breathing-friction", "share", 0.0),
            friction_period: truth.or("breathing-friction", "period", 1.0),
            voltage: (0.0, 0.0),
            load: 0.0,
        };
        let delay = Delay::new(truth.or("input-delay", "delay", 0.0), period);
        Motor { law, y: [0.0; STATES], stepper: Stepper::new(0.1 * period), delay }
    }
}

/// The scales of currents, speeds, angles, twists and temperatures of such a motor. A twist is a hundredth of a radian.
const SCALE: State = [10.0, 10.0, 100.0, 10.0, 100.0, 0.01, 10.0, 10.0, 10.0, 100.0, 1.0, 1.0, 1.0, 1.0];

impl Law {
    /// The rotation exp(j th_e).
    fn rotor(&self, y: &State) -> (f64, f64) {
        let (sin, cos) = (self.pairs * y[ANGLE]).sin_cos();
        (cos, sin)
    }

    /// The error of the recorded frame's angle.
    fn delta(&self, y: &State) -> f64 {
        self.offset + self.eccentricity * y[ANGLE].sin()
    }

    fn torque(&self, y: &State) -> f64 {
        let (cos, sin) = self.rotor(y);
        let i_q = cos * y[BETA] - sin * y[ALPHA];
        1.5 * self.pairs * self.flux(y) * i_q
    }

    fn flux(&self, y: &State) -> f64 {
        self.lambda * (1.0 + self.ripple * (6.0 * self.pairs * y[ANGLE]).cos())
    }

    /// All resisting torques at the rotor, except those of a shaft and the load.
    fn friction(&self, w: f64, angle: f64, time: f64) -> f64 {
        // With w_s = 1 rad/s.
        let sign = w.tanh();
        let (level, viscous) =
            if w < 0.0 { (self.backward, self.viscous_backward) } else { (self.forward, self.viscous_forward) };
        let breath = 1.0 + self.friction_swing * (std::f64::consts::TAU * time / self.friction_period).sin();
        let stribeck = self.stribeck_coulomb
            + (self.stribeck_static - self.stribeck_coulomb) * (-(w / self.stribeck_velocity).powi(2)).exp();
        viscous * breath * w
            + (self.coulomb + level + stribeck) * sign
            + self.windage * w * w.abs()
            + self.constant_load
            + self.load_drift * time
            - self.cogging * (self.cycles * angle + self.phase).sin()
    }

    /// The sensor readings of a state.
    fn read(&self, y: &State) -> [f64; 3] {
        // From the stator frame into the recorded frame: exp(-j (th_e + delta)).
        let (sin, cos) = (self.pairs * y[ANGLE] + self.delta(y)).sin_cos();
        [cos * y[ALPHA] + sin * y[BETA], cos * y[BETA] - sin * y[ALPHA], y[SPEED]]
    }
}

impl Flow for Law {
    /// The direction of rotation: friction that depends on the direction has a kink at reversal.
    fn regime(&self, y: &State) -> u8 {
        u8::from(y[SPEED] < 0.0)
    }

    fn derivative(&self, y: &State, _: u8) -> State {
        let mut dy = [0.0; STATES];
        let (cos, sin) = self.rotor(y);
        let square = y[ALPHA] * y[ALPHA] + y[BETA] * y[BETA];

        // The acting voltage, in the stator frame.
        let (sin_in, cos_in) = (self.pairs * y[ANGLE] + self.delta(y)).sin_cos();
        let (v_d, v_q) = (self.gain * self.voltage.0, self.gain * self.voltage.1);
        let radius = v_d.hypot(v_q);
        let back = if radius > self.limit { self.limit / radius } else { 1.0 } * (1.0 - self.sag * square);
        let lost = self.voltage_loss / (square + 0.25).sqrt();
        let v_alpha = back * (cos_in * v_d - sin_in * v_q) - lost * y[ALPHA];
        let v_beta = back * (sin_in * v_d + cos_in * v_q) - lost * y[BETA];

        // The temperature coefficient 0.00393 1/K of copper, as in docs/book/src/reference/plants.md.
        let hot = self.r * (1.0 + 0.00393 * y[HEAT]);
        let inductance = self.l / (1.0 + square / (self.saturation * self.saturation));
        let emf = self.pairs * y[SPEED] * self.flux(y);
        dy[ALPHA] = (v_alpha - hot * (1.0 + self.unbalance) * y[ALPHA] + emf * sin) / inductance;
        dy[BETA] = (v_beta - hot * (1.0 - self.unbalance) * y[BETA] - emf * cos) / inductance;
        dy[HEAT] = (self.thermal_resistance * 1.5 * hot * square - y[HEAT]) / self.thermal_time;

        dy[ANGLE] = y[SPEED];
        let mut rest = self.torque(y) - self.friction(y[SPEED], y[ANGLE], y[TIME]);
        if self.ratio > 0.0 {
            let shaft = self.stiffness * y[TWIST] + self.damping * (y[SPEED] - y[LOAD_SPEED]);
            dy[TWIST] = y[SPEED] - y[LOAD_SPEED];
            dy[LOAD_SPEED] = (shaft - self.load) / (self.ratio * self.inertia);
            rest -= shaft;
        } else {
            rest -= self.load;
        }
        if self.flywheel > 0.0 {
            // The flywheel is driven by dry friction, which has its full value above about 1 rad/s.
            let carried = self.grip * (y[SPEED] - y[LOAD_SPEED]).tanh();
            dy[LOAD_SPEED] = carried / self.flywheel;
            rest -= carried;
        }
        dy[SPEED] = rest / ((1.0 - self.ratio) * self.inertia);
        dy[TIME] = 1.0;

        for (index, (lag, truth)) in self.lags.iter().zip(self.read(y)).enumerate() {
            if let Some(time_constant) = lag {
                dy[LAG + index] = (truth - y[LAG + index]) / time_constant;
            }
        }
        dy
    }

    fn scale(&self) -> &State {
        &SCALE
    }
}

impl Plant for Motor {
    fn hold(&mut self, inputs: &[f64]) {
        self.delay.push(inputs[..2].to_vec());
        self.law.load = inputs[2];
    }

    fn advance(&mut self, period: f64) {
        for (duration, voltage) in self.delay.parts(period) {
            self.law.voltage = (voltage[0], voltage[1]);
            self.stepper.advance(&self.law, &mut self.y, duration);
        }
    }

    fn outputs(&self) -> Vec<f64> {
        let truth = self.law.read(&self.y);
        let lags = self.law.lags.iter().enumerate();
        lags.zip(truth).map(|((index, lag), truth)| lag.map_or(truth, |_| self.y[LAG + index])).collect()
    }
}
