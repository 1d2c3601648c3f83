//! The driveline, with twists in place of angles.
//!
//! The states are the twist of the clutch th_e - i_t th_t, the twist of the driveshaft th_t/i_f - th_w, the speeds and the engine's torque. The
//! angles of docs/book/src/reference/plants.md (27), (28) grow without bound, and only these differences have an effect; only combustion needs th_e
//! itself. In: throttle and gear. Out: engine speed, road speed, acceleration.

use crate::flow::{Flow, STATES, State, Stepper};
use crate::plant::{Delay, Plant, Start, Truth};

const CLUTCH: usize = 0;
const SHAFT: usize = 1;
const ENGINE: usize = 2;
const GEARBOX: usize = 3;
const WHEEL: usize = 4;
const TORQUE: usize = 5;
const ENGINE_ANGLE: usize = 6;
const ROAD: usize = 7;
/// A resonant mount of the accelerometer: reading and its rate.
const MOUNT: usize = 8;
const MOUNT_RATE: usize = 9;
/// Three lags.
const LAG: usize = 10;
/// The distance, for the hills.
const DISTANCE: usize = 13;

/// Standard gravity (3rd CGPM, 1901), m/s^2.
const G: f64 = 9.80665;

struct Law {
    engine_inertia: f64,
    /// The inertia J_t + J_f/i_f^2.
    gearbox_inertia: f64,
    wheel_inertia: f64,
    mass: f64,
    r: f64,
    /// The ratio i_t of the record's gear.
    gear: f64,
    i_f: f64,
    clutch: (f64, f64),
    shaft: (f64, f64),
    /// The damping d_t + d_f/i_f^2.
    gearbox_damping: f64,
    wheel_damping: f64,
    rolling_1: f64,
    rolling_2: f64,
    /// The factor 1/2 c_a A rho.
    drag: f64,
    grade: f64,
    map: [f64; 3],
    torque_lag: f64,
    engine_friction: (f64, f64),
    // Effects of the catalogue.
    gap: f64,
    cubic: f64,
    capacity: f64,
    slip_stiffness: Option<f64>,
    wind: f64,
    brake: f64,
    exponent: f64,
    gain: f64,
    ripple: f64,
    lags: Vec<Option<f64>>,
    // Effects outside the catalogue.
    mount: Option<(f64, f64)>,
    hill: f64,
    wavelength: f64,
    intake: f64,
    intake_speed: f64,
    burst: f64,
    burst_time: f64,
    /// The constant throttle.
    throttle: f64,
    /// The time of the row: after a tyre burst the rolling resistance is higher.
    now: f64,
}

/// A running car.
pub struct Car {
    law: Law,
    y: State,
    stepper: Stepper,
    delay: Delay,
}

impl Car {
    /// The start of docs/book/src/reference/plants.md 2.2.
    pub fn new(truth: &Truth, start: Start, first: &[f64], period: f64) -> Self {
        let of = |name| truth.parameters.get(name);
        let i_f = of("final_drive_ratio");
        let law = Law {
            engine_inertia: of("engine_inertia"),
            gearbox_inertia: of("transmission_inertia") + of("final_drive_inertia") / (i_f * i_f),
            wheel_inertia: of("wheel_inertia"),
            mass: of("mass"),
            r: of("wheel_radius"),
            gear: truth.parameters.gear_ratios[first[1] as usize - 1],
            i_f,
            clutch: (of("clutch_stiffness"), of("clutch_damping")),
            shaft: (of("driveshaft_stiffness"), of("driveshaft_damping")),
            gearbox_damping: of("transmission_damping") + of("final_drive_damping") / (i_f * i_f),
            wheel_damping: of("wheel_damping"),
            rolling_1: of("rolling_resistance_1"),
            rolling_2: of("rolling_resistance_2"),
            drag: 0.5 * of("drag_area") * of("air_density"),
            grade: truth.or("road-grade", "grade", of("grade")),
            map: [of("torque_0"), of("torque_1"), of("torque_2")],
            torque_lag: of("torque_lag"),
            engine_friction: (of("engine_friction_0"), of("engine_friction_1")),
            gap: truth.or("backlash", "gap", 0.0),
            cubic: truth.or("clutch-stiffening", "cubic_stiffness", 0.0),
            capacity: truth.or("clutch-slip", "capacity", f64::INFINITY),
            slip_stiffness: truth.effect("tyre-slip", "slip_stiffness"),
            wind: truth.or("headwind", "wind", 0.0),
            brake: truth.or("brake-drag", "torque", 0.0),
            exponent: truth.or("throttle-nonlinearity", "exponent", 1.0),
            gain: truth.or("input-gain", "gain", 1.0),
            ripple: truth.or("combustion-ripple", "amplitude", 0.0),
            lags: truth.lags(),
            mount: truth.effect("mount-resonance", "frequency").zip(truth.effect("mount-resonance", "damping_ratio")),
            hill: truth.or("rolling-hills", "slope", 0.0),
            wavelength: truth.or("rolling-hills", "wavelength", 1.0),
            intake: truth.or("intake-resonance", "share", 0.0),
            intake_speed: truth.or("intake-resonance", "period", 1.0),
            burst: truth.or("tyre-burst", "times", 1.0),
            burst_time: truth.or("tyre-burst", "time", f64::INFINITY),
            throttle: first[0],
            now: 0.0,
        };
        let Start::Rolling(road_speed) = start else { panic!("a car starts rolling: at rest its clutch would be open") };
        let mut y = [0.0; STATES];
        y[WHEEL] = road_speed / law.r;
        y[GEARBOX] = law.i_f * y[WHEEL];
        y[ENGINE] = law.gear * y[GEARBOX];
        y[ROAD] = road_speed;
        y[TORQUE] = law.command(y[ENGINE]);
        let clutch = y[TORQUE] - law.engine_friction.0 - law.engine_friction.1 * y[ENGINE];
        let shaft = law.gear * law.i_f * clutch;
        y[CLUTCH] = clutch / law.clutch.0;
        y[ENGINE_ANGLE] = y[CLUTCH];
        y[SHAFT] = shaft / law.shaft.0 + shaft.signum() * law.gap / 2.0;
        let mut car =
            Car { law, y, stepper: Stepper::new(1e-4), delay: Delay::new(truth.or("input-delay", "delay", 0.0), period) };
        let truth = car.law.read(&car.y);
        car.y[MOUNT] = truth[2];
        car.y[LAG..LAG + 3].copy_from_slice(&truth);
        car
    }
}

/// The scales: twists of a hundredth of a radian, speeds, a hundred newton metres, metres.
const SCALE: State = [0.01, 0.01, 100.0, 100.0, 10.0, 100.0, 10.0, 10.0, 1.0, 100.0, 100.0, 10.0, 1.0, 10.0];

impl Law {
    fn command(&self, w_e: f64) -> f64 {
        let full = self.map[0] + w_e * (self.map[1] + w_e * self.map[2]);
        let full = full * (1.0 + self.intake * (std::f64::consts::TAU * w_e / self.intake_speed).sin());
        (self.gain * self.throttle).powf(self.exponent) * full
    }

    /// The torque before the capacity limits it.
    fn clutch_torque(&self, y: &State) -> f64 {
        let twist = y[CLUTCH];
        (self.clutch.0 + self.cubic * twist * twist) * twist + self.clutch.1 * (y[ENGINE] - self.gear * y[GEARBOX])
    }

    fn shaft_torque(&self, y: &State, contact: u8) -> f64 {
        let side = match contact {
            0 => return 0.0,
            1 => 0.5 * self.gap,
            _ => -0.5 * self.gap,
        };
        self.shaft.0 * (y[SHAFT] - side) + self.shaft.1 * (y[GEARBOX] / self.i_f - y[WHEEL])
    }

    /// Rolling resistance and climb, m/s^2, without the parts that grow with speed.
    fn climb(&self, y: &State) -> f64 {
        let grade = self.grade + self.hill * (std::f64::consts::TAU * y[DISTANCE] / self.wavelength).sin();
        let burst = if self.now >= self.burst_time { self.burst } else { 1.0 };
        burst * self.rolling_1 + G * grade.sin()
    }

    fn read(&self, y: &State) -> [f64; 3] {
        let dy = self.derivative(y, self.regime(y));
        match self.slip_stiffness {
            None => [y[ENGINE], self.r * y[WHEEL], self.r * dy[WHEEL]],
            Some(_) => [y[ENGINE], y[ROAD], dy[ROAD]],
        }
    }
}

impl Flow for Law {
    /// The contact of the driveshaft (0 open, 1 drive, 2 coast), plus three times the slip state of the clutch (0 no slip, 1 drive, 2 coast).
    fn regime(&self, y: &State) -> u8 {
        let contact = if self.gap == 0.0 || y[SHAFT] > 0.5 * self.gap { 1 } else { 2 * u8::from(y[SHAFT] < -0.5 * self.gap) };
        let clutch = self.clutch_torque(y);
        let slip = if clutch > self.capacity { 1 } else { 2 * u8::from(clutch < -self.capacity) };
        contact + 3 * slip
    }

    fn derivative(&self, y: &State, regime: u8) -> State {
        let mut dy = [0.0; STATES];
        let clutch = match regime / 3 {
            0 => self.clutch_torque(y),
            1 => self.capacity,
            _ => -self.capacity,
        };
        let shaft = self.shaft_torque(y, regime % 3);
        let friction = self.engine_friction.0 + self.engine_friction.1 * y[ENGINE];
        dy[CLUTCH] = y[ENGINE] - self.gear * y[GEARBOX];
        dy[SHAFT] = y[GEARBOX] / self.i_f - y[WHEEL];
        dy[ENGINE_ANGLE] = y[ENGINE];
        dy[TORQUE] = (self.command(y[ENGINE]) - y[TORQUE]) / self.torque_lag;
        let burning = y[TORQUE] * (1.0 + self.ripple * (3.0 * y[ENGINE_ANGLE]).sin());
        dy[ENGINE] = (burning - friction - clutch) / self.engine_inertia;
        dy[GEARBOX] = (self.gear * clutch - self.gearbox_damping * y[GEARBOX] - shaft / self.i_f) / self.gearbox_inertia;
        match self.slip_stiffness {
            None => {
                let road = self.r * y[WHEEL];
                let against = self.mass * self.r * (self.climb(y) + self.rolling_2 * y[WHEEL])
                    + self.r * self.drag * (road + self.wind).powi(2)
                    + self.wheel_damping * y[WHEEL]
                    + self.brake;
                dy[WHEEL] = (shaft - against) / (self.wheel_inertia + self.mass * self.r * self.r);
                dy[DISTANCE] = road;
            }
            Some(stiffness) => {
                let road = y[ROAD];
                let force = stiffness * (self.r * y[WHEEL] - road) / road.abs().max(1.0);
                dy[WHEEL] = (shaft - self.wheel_damping * y[WHEEL] - self.brake - self.r * force) / self.wheel_inertia;
                dy[ROAD] = force / self.mass
                    - self.climb(y)
                    - self.rolling_2 * road / self.r
                    - self.drag * (road + self.wind).powi(2) / self.mass;
                dy[DISTANCE] = road;
            }
        }
        let reading = match self.slip_stiffness {
            None => [y[ENGINE], self.r * y[WHEEL], self.r * dy[WHEEL]],
            Some(_) => [y[ENGINE], y[ROAD], dy[ROAD]],
        };
        if let Some((frequency, damping)) = self.mount {
            let w = std::f64::consts::TAU * frequency;
            dy[MOUNT] = y[MOUNT_RATE];
            dy[MOUNT_RATE] = w * w * (reading[2] - y[MOUNT]) - 2.0 * damping * w * y[MOUNT_RATE];
        }
        for (index, (lag, truth)) in self.lags.iter().zip(reading).enumerate() {
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

impl Plant for Car {
    fn hold(&mut self, inputs: &[f64]) {
        self.delay.push(inputs[..1].to_vec());
    }

    fn advance(&mut self, period: f64) {
        for (duration, throttle) in self.delay.parts(period) {
            self.law.throttle = throttle[0];
            self.stepper.advance(&self.law, &mut self.y, duration);
        }
        self.law.now += period;
    }

    fn outputs(&self) -> Vec<f64> {
        let truth = self.law.read(&self.y);
        let lags = self.law.lags.iter().enumerate();
        let mut read: Vec<f64> =
            lags.zip(truth).map(|((index, lag), truth)| lag.map_or(truth, |_| self.y[LAG + index])).collect();
        if self.law.mount.is_some() {
            read[2] = self.y[MOUNT];
        }
        read
    }
}
