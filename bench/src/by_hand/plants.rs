//! Equations of docs/book/src/reference/plants.md, section 2, and the rates of each plant.
//!
//! In: parameters. Out: rates and outputs at a state.

use rsm_sim::plant_file::{Parameters, VelocityFrom};

/// The rates of a plant at a state, in 1/s.
pub(super) struct Rates {
    /// The fastest visible rate.
    pub fastest: f64,
    /// The fastest rate of the part that a linear model does not contain.
    pub nonlinear: f64,
    /// A quantity that varies with the state: when it has changed, a linear part is out of date.
    pub varying: f64,
}

/// The equations of a plant.
pub(super) trait Plant {
    /// How many states it has.
    const STATES: usize;

    /// The states at the start, from first readings and the first input.
    fn start(&self, outputs: &[f64], input: f64, x: &mut [f64]);

    /// Rates and outputs.
    fn evaluate(&self, inputs: &[f64; 3], x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]);

    /// The rates at a state.
    fn rates(&self, x: &[f64]) -> Rates;

    /// The command of a controller that is part of the plant, from its position (this row and the previous two).
    fn command(&self, reference: f64, _x: &[f64], _positions: [f64; 3], _period: f64) -> f64 {
        reference
    }
}

/// A surface permanent-magnet motor in the rotor frame.
pub(super) struct Pmac {
    resistance: f64,
    inductance: f64,
    flux_linkage: f64,
    pole_pairs: f64,
    inertia: f64,
    viscous_friction: f64,
}

impl Pmac {
    pub(super) fn new(parameters: &Parameters) -> Self {
        let of = |name: &str| parameters.number(name);
        Pmac {
            resistance: of("phase_resistance"),
            inductance: of("phase_inductance"),
            flux_linkage: of("flux_linkage"),
            pole_pairs: of("pole_pairs"),
            inertia: of("inertia"),
            viscous_friction: of("viscous_friction"),
        }
    }
}

impl Plant for Pmac {
    const STATES: usize = 4;

    fn start(&self, outputs: &[f64], _input: f64, x: &mut [f64]) {
        x[..3].copy_from_slice(&outputs[..3]);
    }

    fn evaluate(&self, inputs: &[f64; 3], x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]) {
        let (i_d, i_q, speed) = (x[0], x[1], x[2]);
        let (r, l, lambda) = (self.resistance, self.inductance, self.flux_linkage);
        let w_e = self.pole_pairs * speed;
        dx[0] = (inputs[0] - r * i_d + w_e * l * i_q) / l;
        dx[1] = (inputs[1] - r * i_q - w_e * (l * i_d + lambda)) / l;
        let torque = 1.5 * self.pole_pairs * lambda * i_q;
        dx[2] = (torque - self.viscous_friction * speed - inputs[2]) / self.inertia;
        dx[3] = speed;
        *outputs = [i_d, i_q, speed];
    }

    fn rates(&self, x: &[f64]) -> Rates {
        let own = self.resistance / self.inductance + self.viscous_friction / self.inertia;
        let swing = (1.5 / (self.inductance * self.inertia)).sqrt() * self.pole_pairs * self.flux_linkage;
        let machine = swing.max(self.pole_pairs * x[2].abs());
        Rates { fastest: own.max(machine), nonlinear: machine, varying: own }
    }
}

/// Engine, clutch, transmission, driveshaft, wheel and vehicle, in one gear.
pub(super) struct Driveline {
    engine_inertia: f64,
    shaft_inertia: f64,
    wheel_inertia: f64,
    mass: f64,
    radius: f64,
    gear_ratio: f64,
    final_ratio: f64,
    clutch: (f64, f64),
    driveshaft: (f64, f64),
    shaft_damping: f64,
    wheel_damping: f64,
    rolling: (f64, f64),
    drag: f64,
    slope_force: f64,
    torque: [f64; 3],
    torque_lag: f64,
    engine_friction: (f64, f64),
}

impl Driveline {
    pub(super) fn new(parameters: &Parameters, gear: usize) -> Self {
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
            slope_force: mass * 9.80665 * of("grade").sin(),
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

    fn start(&self, outputs: &[f64], input: f64, x: &mut [f64]) {
        let wheel = outputs[1] / self.radius;
        let (shaft, ratio) = (self.final_ratio * wheel, self.gear_ratio * self.final_ratio);
        let engine = self.gear_ratio * shaft;
        let torque = self.commanded(input, engine);
        let clutch = torque - self.engine_drag(engine);
        x.copy_from_slice(&[torque, clutch / self.clutch.0, engine, 0.0, shaft, -ratio * clutch / self.driveshaft.0, wheel]);
    }

    fn evaluate(&self, inputs: &[f64; 3], x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]) {
        let (engine, shaft, wheel) = (x[ENGINE_SPEED], x[SHAFT_SPEED], x[WHEEL_SPEED]);
        dx[TORQUE] = (self.commanded(inputs[0], engine) - x[TORQUE]) / self.torque_lag;
        let twist = x[ENGINE_ANGLE] - self.gear_ratio * x[SHAFT_ANGLE];
        let clutch = self.clutch.0 * twist + self.clutch.1 * (engine - self.gear_ratio * shaft);
        let twist = x[SHAFT_ANGLE] / self.final_ratio - x[WHEEL_ANGLE];
        let driveshaft = self.driveshaft.0 * twist + self.driveshaft.1 * (shaft / self.final_ratio - wheel);
        dx[ENGINE_ANGLE] = engine;
        dx[ENGINE_SPEED] = (x[TORQUE] - self.engine_drag(engine) - clutch) / self.engine_inertia;
        dx[SHAFT_ANGLE] = shaft;
        let carried = driveshaft / self.final_ratio;
        dx[SHAFT_SPEED] = (self.gear_ratio * clutch - self.shaft_damping * shaft - carried) / self.shaft_inertia;
        dx[WHEEL_ANGLE] = wheel;
        let speed = self.radius * wheel;
        let rolling = self.mass * (self.rolling.0 + self.rolling.1 * wheel);
        let resistance = rolling + self.drag * speed * speed + self.slope_force;
        let inertia = self.wheel_inertia + self.mass * self.radius * self.radius;
        dx[WHEEL_SPEED] = (driveshaft - self.wheel_damping * wheel - self.radius * resistance) / inertia;
        *outputs = [engine, speed, self.radius * dx[WHEEL_SPEED]];
    }

    fn rates(&self, x: &[f64]) -> Rates {
        // The mode of a damper itself decays at once and is not visible.
        let joint =
            |(stiffness, damping): (f64, f64), mobility: f64| (stiffness * mobility).sqrt().max(damping * mobility / 4.0);
        let clutch = 1.0 / self.engine_inertia + self.gear_ratio * self.gear_ratio / self.shaft_inertia;
        let shaft = 1.0 / (self.final_ratio * self.final_ratio * self.shaft_inertia) + 1.0 / self.wheel_inertia;
        let fastest = joint(self.clutch, clutch).max(joint(self.driveshaft, shaft)).max(1.0 / self.torque_lag);
        // The torque map closes a loop through the lag and the engine.
        let slope = (self.torque[1] + 2.0 * self.torque[2] * x[ENGINE_SPEED]).abs();
        Rates { fastest, nonlinear: (slope / (self.torque_lag * self.engine_inertia)).sqrt(), varying: 0.0 }
    }
}

/// A driven linear axis, alone or with its controller.
pub(super) struct ServoAxis {
    mass: f64,
    force_gain: f64,
    viscous_friction: f64,
    command_limit: f64,
    gains: Option<(f64, f64)>,
    velocity_from: VelocityFrom,
}

impl ServoAxis {
    pub(super) fn new(parameters: &Parameters) -> Self {
        ServoAxis {
            mass: parameters.number("mass"),
            force_gain: parameters.number("force_gain"),
            viscous_friction: parameters.number("viscous_friction"),
            command_limit: parameters.number("command_limit"),
            gains: parameters.optional("position_gain").zip(parameters.optional("velocity_gain")),
            velocity_from: parameters.velocity_from,
        }
    }
}

impl Plant for ServoAxis {
    const STATES: usize = 2;

    fn start(&self, outputs: &[f64], _input: f64, x: &mut [f64]) {
        x[0] = outputs[0];
    }

    fn evaluate(&self, inputs: &[f64; 3], x: &[f64], dx: &mut [f64], outputs: &mut [f64; 3]) {
        dx[0] = x[1];
        dx[1] = (self.force_gain * inputs[0] - self.viscous_friction * x[1]) / self.mass;
        (outputs[0], outputs[1]) = (x[0], inputs[0]);
    }

    fn rates(&self, _x: &[f64]) -> Rates {
        Rates { fastest: self.viscous_friction / self.mass, nonlinear: 0.0, varying: 0.0 }
    }

    fn command(&self, reference: f64, x: &[f64], positions: [f64; 3], period: f64) -> f64 {
        let Some((position_gain, velocity_gain)) = self.gains else { return 0.0 };
        let speed = match self.velocity_from {
            VelocityFrom::State => x[1],
            VelocityFrom::Difference => (positions[0] - positions[2]) / (2.0 * period),
        };
        let command = velocity_gain * (position_gain * (reference - positions[0]) - speed);
        command.min(self.command_limit).max(-self.command_limit)
    }
}
