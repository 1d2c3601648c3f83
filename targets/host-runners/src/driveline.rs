//! The driveline in one gear without effects, (27), (28): the equations of the shipped text, written by hand for the speed of a campaign.
//!
//! In: parameters, a gear, throttle, a state. Out: rates and outputs. A test compares them with the text.

use rsm_sim::plant_file::Parameters;

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

/// The number of states: engine torque, angle and speed of the engine, of the shaft between clutch and driveshaft, of the wheel.
pub const STATES: usize = 7;

const TORQUE: usize = 0;
const ENGINE_ANGLE: usize = 1;
const ENGINE_SPEED: usize = 2;
const SHAFT_ANGLE: usize = 3;
const SHAFT_SPEED: usize = 4;
const WHEEL_ANGLE: usize = 5;
const WHEEL_SPEED: usize = 6;

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

    /// The states of a car that rolls steadily at a road speed, in m/s.
    pub fn start(&self, road_speed: f64, throttle: f64, x: &mut [f64; STATES]) {
        let wheel = road_speed / self.radius;
        let shaft = self.final_ratio * wheel;
        let engine = self.gear_ratio * shaft;
        // The shaft between clutch and driveshaft is light, so both transmit the same torque.
        let torque = self.commanded(throttle, engine);
        let clutch = torque - self.engine_drag(engine);
        let driveshaft = self.gear_ratio * self.final_ratio * clutch;
        x[TORQUE] = torque;
        x[ENGINE_ANGLE] = clutch / self.clutch.0;
        x[ENGINE_SPEED] = engine;
        x[SHAFT_ANGLE] = 0.0;
        x[SHAFT_SPEED] = shaft;
        x[WHEEL_ANGLE] = -(driveshaft / self.driveshaft.0);
        x[WHEEL_SPEED] = wheel;
    }

    /// Sets the rate of each state. Returns engine speed (rad/s), road speed (m/s) and acceleration (m/s^2).
    pub fn evaluate(&self, throttle: f64, x: &[f64; STATES], dx: &mut [f64; STATES]) -> [f64; 3] {
        let (engine, shaft, wheel) = (x[ENGINE_SPEED], x[SHAFT_SPEED], x[WHEEL_SPEED]);
        dx[TORQUE] = (self.commanded(throttle, engine) - x[TORQUE]) / self.torque_lag;
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
        // With V = r w_w the forces below, times r, are the terms of (28).
        let speed = self.radius * wheel;
        let rolling = self.mass * (self.rolling.0 + self.rolling.1 * speed / self.radius);
        let resistance = rolling + self.drag * speed * speed + self.slope_force;
        let inertia = self.wheel_inertia + self.mass * self.radius * self.radius;
        dx[WHEEL_SPEED] = (driveshaft - self.wheel_damping * wheel - self.radius * resistance) / inertia;
        [engine, speed, self.radius * dx[WHEEL_SPEED]]
    }

    /// The fastest rate that is visible in the outputs, in 1/s.
    #[must_use]
    pub fn fastest(&self) -> f64 {
        // The mode of a damper decays fast and is not visible in the outputs. A quarter of its rate permits a sub-step of one time constant of this
        // mode; the fourth-order method is stable up to 2.78 time constants.
        let joint =
            |(stiffness, damping): (f64, f64), mobility: f64| (stiffness * mobility).sqrt().max(damping * mobility / 4.0);
        let clutch_mobility = 1.0 / self.engine_inertia + self.gear_ratio * self.gear_ratio / self.shaft_inertia;
        let shaft_mobility = 1.0 / (self.final_ratio * self.final_ratio * self.shaft_inertia) + 1.0 / self.wheel_inertia;
        joint(self.clutch, clutch_mobility).max(joint(self.driveshaft, shaft_mobility)).max(1.0 / self.torque_lag)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::cases::Draw;
    use rsm_core::source::Source;
    use rsm_sim::equation_plant::Rates;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;

    /// Names of the states in the text, in the order of this file, with typical sizes.
    const NAMES: [(&str, f64); STATES] = [
        ("engine_torque", 200.0),
        ("engine_angle", 1.0),
        ("engine_speed", 500.0),
        ("shaft_angle", 1.0),
        ("shaft_speed", 300.0),
        ("wheel_angle", 1.0),
        ("wheel_speed", 90.0),
    ];

    #[test]
    fn the_text_has_the_same_rates_outputs_and_start_in_each_gear() {
        let text = include_str!("../../../rsm-sim/plants/driveline.toml");
        let file = PlantFile::read(&Source::new("driveline.toml", text)).unwrap();
        for gear in 1..=5 {
            let own = Driveline::new(&file.parameters, gear);
            let (column, speed) = ([gear as f64; 2], [8.0; 2]);
            let columns: [(&str, &[f64]); 4] =
                [("time", &[0.0, 0.01]), ("throttle", &[0.3; 2]), ("gear", &column), ("road_speed", &speed)];
            let mut text = Rates::new(&file, &Record::in_memory(&file, &columns).unwrap()).unwrap();
            let names = text.states();
            let places = NAMES.map(|(name, _)| names.iter().position(|it| it == name).unwrap());
            let near = |found: f64, wanted: f64, what: &str| {
                // Sums of a handful of terms, in two orders; terms of large torques cancel to rates of some thousand 1/s^2.
                assert!((found - wanted).abs() <= 1e-10 * wanted.abs().max(1e2), "{what} in gear {gear}: {found} {wanted}");
            };
            let mut x = [0.0; STATES];
            own.start(8.0, 0.3, &mut x);
            places.iter().zip(x).zip(NAMES).for_each(|((place, wanted), (name, _))| near(text.start()[*place], wanted, name));
            let mut draw = Draw::new(7);
            let mut next = || 2.0 * draw.uniform() - 1.0;
            for _ in 0..100 {
                let x = NAMES.map(|(_, size)| size * next());
                let throttle = next();
                let mut dx = [0.0; STATES];
                let outputs = own.evaluate(throttle, &x, &mut dx);
                let mut at = vec![0.0; STATES];
                places.iter().zip(x).for_each(|(place, x)| at[*place] = x);
                let found = text.at(0.0, &at, &[throttle]);
                places.iter().zip(dx).zip(NAMES).for_each(|((place, wanted), (name, _))| near(found[*place], wanted, name));
                let found = text.outputs(0.0, &at, &[throttle]);
                found.iter().zip(outputs).for_each(|(found, wanted)| near(*found, wanted, "an output"));
            }
        }
    }
}
