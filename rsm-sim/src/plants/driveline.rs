//! Engine, clutch, transmission, driveshaft, wheel and vehicle, (27), (28).
//!
//! In: throttle, in one gear. Out: engine speed, road speed, acceleration. If no effect changes the contact, the wheel rolls without slip, and wheel
//! and vehicle are one inertia J_w + m r^2.

use super::{Plant, Rates};
use crate::effect::{Contact, FirstInstant, Joint, Motion, Scale, Twist, Vehicle};
use crate::hooks::Hooks;
use crate::kind::StartValues;
use crate::parameters::Parameters;
use crate::record::Record;

/// Standard gravity, in m/s^2 (docs/book/src/reference/plants.md 2.2).
const GRAVITY: f64 = 9.80665;

/// The driveline in one gear.
pub struct Driveline {
    engine_inertia: f64,
    /// J_t + J_f/i_f^2
    shaft_inertia: f64,
    wheel_inertia: f64,
    mass: f64,
    radius: f64,
    gear_ratio: f64,
    final_ratio: f64,
    clutch: (f64, f64),
    driveshaft: (f64, f64),
    /// d_t + d_f/i_f^2
    shaft_damping: f64,
    wheel_damping: f64,
    rolling: (f64, f64),
    /// 1/2 c_a A rho
    drag: f64,
    /// m g sin(grade)
    slope_force: f64,
    torque: [f64; 3],
    torque_lag: f64,
    engine_friction: (f64, f64),
}

impl Driveline {
    /// The driveline of these parameters in a gear (1 to 5).
    #[must_use]
    pub fn new(parameters: &Parameters, gear: usize) -> Self {
        let of = |name: &str| parameters.number(name);
        let final_ratio = of("final_drive_ratio");
        let mass = of("mass");
        Driveline {
            engine_inertia: of("engine_inertia"),
            shaft_inertia: of("transmission_inertia") + of("final_drive_inertia") / (final_ratio * final_ratio),
            wheel_inertia: of("wheel_inertia"),
            mass,
            radius: of("wheel_radius"),
            gear_ratio: of(&format!("gear_ratios[{gear}]")),
            final_ratio,
            clutch: (of("clutch_stiffness"), of("clutch_damping")),
            driveshaft: (of("driveshaft_stiffness"), of("driveshaft_damping")),
            shaft_damping: of("transmission_damping") + of("final_drive_damping") / (final_ratio * final_ratio),
            wheel_damping: of("wheel_damping"),
            rolling: (of("rolling_resistance_1"), of("rolling_resistance_2")),
            drag: 0.5 * of("drag_area") * of("air_density"),
            slope_force: mass * GRAVITY * of("grade").sin(),
            torque: [of("torque_0"), of("torque_1"), of("torque_2")],
            torque_lag: of("torque_lag"),
            engine_friction: (of("engine_friction_0"), of("engine_friction_1")),
        }
    }

    fn commanded(&self, throttle: f64, speed: f64) -> f64 {
        throttle * (self.torque[0] + self.torque[1] * speed + self.torque[2] * speed * speed)
    }

    fn engine_drag(&self, speed: f64) -> f64 {
        self.engine_friction.0 + self.engine_friction.1 * speed
    }
}

/// The order of the states.
const TORQUE: usize = 0;
const ENGINE_ANGLE: usize = 1;
const ENGINE_SPEED: usize = 2;
const SHAFT_ANGLE: usize = 3;
const SHAFT_SPEED: usize = 4;
const WHEEL_ANGLE: usize = 5;
const WHEEL_SPEED: usize = 6;

impl Plant for Driveline {
    const STATES: usize = 7;

    fn start(&self, hooks: &Hooks, outputs: &StartValues, record: &Record, inputs: &[f64; 3], x: &mut [f64]) {
        let [_, road_speed, _, torque_offset, twist_offset, twist_rate, ..] = *outputs;
        let wheel = road_speed / self.radius;
        let shaft = self.final_ratio * (wheel + twist_rate);
        let engine = self.gear_ratio * shaft;
        // A car in steady motion, plus the given offsets. The shaft between clutch and driveshaft is light, so both transmit the same torque.
        let steady = self.gear_ratio * (self.final_ratio * wheel);
        let ratio = self.gear_ratio * self.final_ratio;
        let clutch = self.commanded(inputs[0], steady) - self.engine_drag(steady) + self.driveshaft.0 * twist_offset / ratio;
        let torque = self.commanded(inputs[0], steady) + torque_offset;
        let driveshaft = ratio * clutch;
        let sign = if driveshaft == 0.0 { 0.0 } else { driveshaft.signum() };
        x[TORQUE] = torque;
        x[ENGINE_ANGLE] = clutch / self.clutch.0;
        x[ENGINE_SPEED] = engine;
        x[SHAFT_ANGLE] = 0.0;
        x[SHAFT_SPEED] = shaft;
        x[WHEEL_ANGLE] = -(driveshaft / self.driveshaft.0 + sign * hooks.slack(Joint::Driveshaft) / 2.0);
        x[WHEEL_SPEED] = wheel;
        let motion = Motion { position: x[WHEEL_ANGLE], speed: wheel, viscous_friction: self.wheel_damping };
        hooks.start(&FirstInstant { motion, road_speed, time: record.first_time() }, x);
    }

    fn evaluate(
        &self,
        hooks: &Hooks,
        held: Option<u32>,
        inputs: &[f64; 3],
        x: &[f64],
        dx: &mut [f64],
        outputs: &mut [f64; 3],
    ) -> u32 {
        let (engine, shaft, wheel) = (x[ENGINE_SPEED], x[SHAFT_SPEED], x[WHEEL_SPEED]);
        dx[TORQUE] = (self.commanded(inputs[0], engine) - x[TORQUE]) / self.torque_lag;
        let clutch = Twist {
            joint: Joint::Clutch,
            angle: x[ENGINE_ANGLE] - self.gear_ratio * x[SHAFT_ANGLE],
            rate: engine - self.gear_ratio * shaft,
            stiffness: self.clutch.0,
            damping: self.clutch.1,
        };
        let clutch = hooks.joint(&clutch, held);
        let driveshaft = Twist {
            joint: Joint::Driveshaft,
            angle: x[SHAFT_ANGLE] / self.final_ratio - x[WHEEL_ANGLE],
            rate: shaft / self.final_ratio - wheel,
            stiffness: self.driveshaft.0,
            damping: self.driveshaft.1,
        };
        let driveshaft = hooks.joint(&driveshaft, held);
        dx[ENGINE_ANGLE] = engine;
        let torque = hooks.engine_torque(x[TORQUE], x[ENGINE_ANGLE]);
        dx[ENGINE_SPEED] = (torque - self.engine_drag(engine) - clutch.effort) / self.engine_inertia;
        dx[SHAFT_ANGLE] = shaft;
        let carried = driveshaft.effort / self.final_ratio;
        dx[SHAFT_SPEED] = (self.gear_ratio * clutch.effort - self.shaft_damping * shaft - carried) / self.shaft_inertia;
        dx[WHEEL_ANGLE] = wheel;

        // With V = r w_w the forces below, times r, are the terms of (28).
        let speed = hooks.vehicle_speed(x).unwrap_or(self.radius * wheel);
        let air = hooks.air_speed(speed);
        let rolling = self.mass * (self.rolling.0 + self.rolling.1 * speed / self.radius);
        let resistance = rolling + self.drag * air * air + self.slope_force;
        let motion = Motion { position: x[WHEEL_ANGLE], speed: wheel, viscous_friction: self.wheel_damping };
        let on_wheel = driveshaft.effort - self.wheel_damping * wheel + hooks.effort(&motion);
        let contact = Contact { surface_speed: self.radius * wheel, resistance, mass: self.mass };
        let acceleration = if let Some(force) = hooks.traction(&contact, x, dx) {
            dx[WHEEL_SPEED] = (on_wheel - self.radius * force) / self.wheel_inertia;
            (force - resistance) / self.mass
        } else {
            let inertia = self.wheel_inertia + self.mass * self.radius * self.radius;
            dx[WHEEL_SPEED] = (on_wheel - self.radius * resistance) / inertia;
            self.radius * dx[WHEEL_SPEED]
        };
        *outputs = [engine, speed, acceleration];
        clutch.piece | driveshaft.piece
    }

    fn rates(&self, hooks: &Hooks, x: &[f64], dx: &[f64], span: f64) -> Rates {
        // The mode of a damper decays fast and is not visible in the outputs. A quarter of its rate permits a sub-step of one time constant of this
        // mode; the fourth-order method is stable up to 2.78 time constants. The test with half the step measures the remaining error.
        let joint =
            |(stiffness, damping): (f64, f64), mobility: f64| (stiffness * mobility).sqrt().max(damping * mobility / 4.0);
        let clutch_mobility = 1.0 / self.engine_inertia + self.gear_ratio * self.gear_ratio / self.shaft_inertia;
        let shaft_mobility = 1.0 / (self.final_ratio * self.final_ratio * self.shaft_inertia) + 1.0 / self.wheel_inertia;
        let engine = x[ENGINE_SPEED];
        // The present torque, plus the largest increase that the lag permits within the span.
        let torque = x[TORQUE].abs() + span / self.torque_lag * self.commanded(1.0, engine).abs();
        let twist = (x[ENGINE_ANGLE] - self.gear_ratio * x[SHAFT_ANGLE]).abs().max(torque / self.clutch.0);
        let scale = Scale {
            vehicle: Vehicle {
                wheel: (self.wheel_inertia, self.radius),
                speed: hooks.vehicle_speed(x).unwrap_or(self.radius * x[WHEEL_SPEED]),
                crank_speed: engine,
                clutch_mobility,
                clutch: (self.clutch.0, twist, (engine - self.gear_ratio * x[SHAFT_SPEED]).abs()),
                swing: ((self.clutch.0 * clutch_mobility).sqrt(), (self.driveshaft.0 * shaft_mobility).sqrt()),
            },
            ..Scale::of(self.mass, self.mass, (x[WHEEL_SPEED], dx[WHEEL_SPEED]), span)
        };
        let dynamics =
            joint(self.clutch, clutch_mobility).max(joint(self.driveshaft, shaft_mobility)).max(1.0 / self.torque_lag);
        // The torque map forms a feedback loop with the lag and the engine. The throttle scales this loop by at most 1. Drag is slower by orders of
        // magnitude.
        let slope = (self.torque[1] + 2.0 * self.torque[2] * engine).abs();
        let map = (slope / (self.torque_lag * self.engine_inertia)).sqrt();
        let effects = hooks.fastest_rate(&scale);
        let dampers = (self.clutch.1 * clutch_mobility).max(self.driveshaft.1 * shaft_mobility);
        Rates {
            fastest: dynamics.max(effects),
            excited: dynamics.max(dampers).max(effects),
            nonlinear: map.max(hooks.nonlinear_rate(&scale)),
            varying: hooks.sum_of_rates(&scale),
        }
    }
}
