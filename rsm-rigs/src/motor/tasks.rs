//! What a drive is asked for in the studies: a run-up, random profiles on a dynamometer, a step of position of a flight surface.
//!
//! In: the settings of each, a seed where there is chance. Out: tasks for [`super::closed_loop::ClosedLoop`]. Never sees a controller.

use super::closed_loop::{Sensed, Task};
use super::controller::REFERENCE_PERIOD_S;
use super::machine::Truth;
use super::noise::Noise;

/// Full torque from rest until a speed is reached, against a load that grows with the speed squared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunUp {
    /// Demand, in N m.
    pub torque: f64,
    /// Until this true speed, in rad/s.
    pub speed: f64,
    /// The load, in N m at 1 rad/s: torque = this times speed squared.
    pub fan: f64,
    /// It ends here at the latest, in s.
    pub at_most: f64,
    reached: bool,
}

impl RunUp {
    /// A run-up.
    #[must_use]
    pub fn new(torque: f64, speed: f64, fan: f64, at_most: f64) -> Self {
        RunUp { torque, speed, fan, at_most, reached: false }
    }
}

impl Task for RunUp {
    fn torque_demand(&mut self, sensed: &Sensed) -> Option<f64> {
        (!self.reached && sensed.time < self.at_most).then_some(self.torque)
    }

    fn load_torque(&mut self, _time: f64, truth: &Truth) -> f64 {
        self.reached |= truth.speed >= self.speed;
        self.fan * truth.speed * truth.speed.abs()
    }
}

/// A dynamometer that holds a speed: proportional and integral, with its set point's slope fed forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamometer {
    /// Inertia of the whole shaft, in kg m^2.
    pub inertia: f64,
    /// Bandwidth, in rad/s.
    pub bandwidth: f64,
    integral: f64,
}

/// Inertia of a dynamometer's rotor, in kg m^2: five times that of the shipped motor, so that steps of its torque hardly move the speed.
pub const DYNAMOMETER_INERTIA: f64 = 0.05;

/// Bandwidth of a dynamometer's speed control, in rad/s: some 10 Hz, a tenth of what its sampled control could hold and usual for test benches.
pub const DYNAMOMETER_BANDWIDTH: f64 = 60.0;

impl Dynamometer {
    /// A dynamometer with a shaft of this inertia in all.
    #[must_use]
    pub fn new(inertia: f64) -> Self {
        Dynamometer { inertia, bandwidth: DYNAMOMETER_BANDWIDTH, integral: 0.0 }
    }

    /// The torque that it takes, in N m, to bring `speed` to `wanted`, which moves by `slope` (rad/s^2), for the next `period` s.
    pub fn torque(&mut self, speed: f64, wanted: f64, slope: f64, period: f64) -> f64 {
        // Both poles of the loop at the bandwidth: proportional 2 J w, integral J w^2.
        let error = speed - wanted;
        self.integral += self.inertia * self.bandwidth * self.bandwidth * error * period;
        2.0 * self.inertia * self.bandwidth * error + self.integral - self.inertia * slope
    }
}

/// Random torque demands at random speeds, which a dynamometer holds: speed moves in straight lines between random speeds, torque in steps.
#[derive(Debug, Clone)]
pub struct RandomProfile {
    /// Demands are equally likely between minus and plus this, in N m.
    pub torque: f64,
    /// Speeds are equally likely between 0 and this, in rad/s.
    pub speed: f64,
    /// How long it lasts, in s.
    pub duration: f64,
    period: f64,
    noise: Noise,
    dynamometer: Dynamometer,
    demand: f64,
    next_step: f64,
    /// From (time, speed) to (time, speed).
    line: [(f64, f64); 2],
}

impl RandomProfile {
    /// A profile from a seed. `inertia`: that of the whole shaft, in kg m^2; `period`: of the PWM, in s.
    #[must_use]
    pub fn new(seed: u64, torque: f64, speed: f64, duration: f64, inertia: f64, period: f64) -> Self {
        let mut noise = Noise::new(seed);
        let start = noise.between(0.0, speed);
        RandomProfile {
            torque,
            speed,
            duration,
            period,
            noise,
            dynamometer: Dynamometer::new(inertia),
            demand: 0.0,
            next_step: 0.0,
            line: [(0.0, start), (0.0, start)],
        }
    }

    /// The speed at which it starts, in rad/s.
    #[must_use]
    pub fn first_speed(&self) -> f64 {
        self.line[0].1
    }
}

impl Task for RandomProfile {
    fn torque_demand(&mut self, sensed: &Sensed) -> Option<f64> {
        if sensed.time >= self.next_step {
            // 20 to 100 ms: current control settles in 2.
            self.next_step = sensed.time + self.noise.between(0.02, 0.1);
            self.demand = self.noise.between(-self.torque, self.torque);
        }
        (sensed.time < self.duration).then_some(self.demand)
    }

    fn load_torque(&mut self, time: f64, truth: &Truth) -> f64 {
        if time >= self.line[1].0 {
            // The whole speed range in half a second is 1600 rad/s^2, what this motor does by itself.
            let until = (time + self.noise.between(0.3, 0.8), self.noise.between(0.0, self.speed));
            self.line = [(time, self.line[1].1), until];
        }
        let [(from, low), (to, high)] = self.line;
        let slope = (high - low) / (to - from);
        let wanted = low + slope * (time - from);
        self.dynamometer.torque(truth.speed, wanted, slope, self.period)
    }
}

/// A flight surface behind a gear, loaded by the air: hinge moment = stiffness x deflection + damping x rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightSurface {
    /// Turns of the motor for one of the surface.
    pub gear: f64,
    /// Inertia of the surface, in kg m^2.
    pub inertia: f64,
    /// Aerodynamic hinge moment over deflection, in N m/rad: dynamic pressure x area x chord x |C_h delta|.
    pub hinge_stiffness: f64,
    /// Aerodynamic damping, in N m s/rad.
    pub hinge_damping: f64,
}

impl FlightSurface {
    /// An aileron of 0.3 m^2 and 0.35 m of chord at 12 kPa (500 km/h near the ground) with C_h delta = -0.6 1/rad: 756 N m/rad; one
    /// turn of the surface is 150 of the motor, so 25 degrees take 330 N m there and 2.2 N m here.
    pub const AILERON: FlightSurface =
        FlightSurface { gear: 150.0, inertia: 0.4, hinge_stiffness: 0.6 * 12_000.0 * 0.3 * 0.35, hinge_damping: 6.0 };

    /// Its inertia as the motor feels it, in kg m^2.
    #[must_use]
    pub fn reflected_inertia(&self) -> f64 {
        self.inertia / (self.gear * self.gear)
    }

    /// Its torque at the motor, in N m.
    #[must_use]
    pub fn torque(&self, motor: &Truth) -> f64 {
        (self.hinge_stiffness * motor.angle + self.hinge_damping * motor.speed) / (self.gear * self.gear)
    }
}

/// A PID position loop at 1 kHz around the drive: a step of the surface's deflection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionStep {
    /// The surface.
    pub surface: FlightSurface,
    /// The step, in rad of the surface.
    pub deflection: f64,
    /// How long it lasts, in s.
    pub duration: f64,
    /// The largest torque demand, in N m.
    pub torque: f64,
    /// Inertia of the shaft, reflected surface included, in kg m^2.
    inertia: f64,
    /// Bandwidth of the loop, in rad/s.
    bandwidth: f64,
    integral: f64,
}

impl PositionStep {
    /// A step. `inertia` is that of the shaft with the reflected surface, in kg m^2; `torque` the most that may be asked for, in N m.
    #[must_use]
    pub fn new(surface: FlightSurface, deflection: f64, duration: f64, inertia: f64, torque: f64) -> Self {
        // 8 Hz, as fast as flight-control actuators are; the drive's torque follows within a fiftieth of its time constant.
        PositionStep { surface, deflection, duration, torque, inertia, bandwidth: 50.0, integral: 0.0 }
    }
}

impl Task for PositionStep {
    fn torque_demand(&mut self, sensed: &Sensed) -> Option<f64> {
        // PID in the form of a cascade: the error asks for a speed w e, and the speed's error for torque by 3 J w and J w^2 / s. On the inertia J
        // that is s^3 + 3 w s^2 + 4 w^2 s + w^3: poles at -0.32 w and (-1.34 +- 1.16 j) w. The form allows to limit the speed so that the torque
        // suffices to stop.
        let (j, w) = (self.inertia, self.bandwidth);
        let error = self.surface.gear * self.deflection - sensed.angle;
        // Braking with half the torque from speed v takes v^2 J/torque: within the error, v = sqrt(error torque/J).
        let fastest = (error.abs() * self.torque / j).sqrt();
        let speed = (w * error).clamp(-fastest, fastest);
        let wanted = 3.0 * j * w * (speed - sensed.speed) + self.integral;
        let torque = wanted.clamp(-self.torque, self.torque);
        if torque == wanted {
            // Held while the torque is at its limit: anti-windup.
            self.integral += j * w * w * (speed - sensed.speed) * REFERENCE_PERIOD_S;
        }
        (sensed.time < self.duration).then_some(torque)
    }

    fn load_torque(&mut self, _time: f64, truth: &Truth) -> f64 {
        self.surface.torque(truth)
    }
}
