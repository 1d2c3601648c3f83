//! Plant, inverter, encoder and a controller, in a loop.
//!
//! In: a plant file, the settings of the drive, a controller and a task (what it is asked for, what loads the shaft). Out: a [`Trace`] with a row a
//! millisecond. The order within a PWM period is that of a drive: sample, compute, and the duties act in the next period.

use rsm_core::source::Faults;

use super::controller::{Controller, Demand, Known, Measured, REFERENCE_PERIOD_S, References};
use super::encoder::{self, Encoder};
use super::inverter::{Fidelity, Inverter};
use super::machine::{Machine, Truth};
use super::noise::Noise;
use super::park::{Angle, from_phases, to_phases};
use rsm_sim::plant_file::PlantFile;

/// The drive around the motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// PWM periods in a millisecond.
    pub periods_per_ms: u32,
    /// Dead time of the inverter, in s.
    pub dead_time: f64,
    /// The share of the voltage that references leave to current control.
    pub voltage_margin: f64,
    /// Averaged or switched.
    pub fidelity: Fidelity,
    /// The encoder.
    pub encoder: encoder::Settings,
    /// The seed of the noise of current sensors (`[noise]` of the plant file: i_d, i_q); without one they have none.
    pub noise_seed: Option<u64>,
}

impl Default for Drive {
    /// 10 kHz, 1 us of dead time (between what MOSFET and IGBT bridges of this size take), a coarse encoder, no noise. The margin of 5 % covers
    /// dead-time compensation (1 % of V_dc) and leaves the rest to the current control's transients.
    fn default() -> Self {
        Drive {
            periods_per_ms: 10,
            dead_time: 1e-6,
            voltage_margin: 0.05,
            fidelity: Fidelity::Averaged,
            encoder: encoder::Settings::COARSE,
            noise_seed: None,
        }
    }
}

impl Drive {
    /// The PWM period, in s.
    #[must_use]
    pub fn pwm_period(&self) -> f64 {
        REFERENCE_PERIOD_S / f64::from(self.periods_per_ms)
    }

    /// What a controller is told: nominal parameters and this drive.
    ///
    /// # Panics
    /// When the plant is not `pmac`.
    #[must_use]
    pub fn known(&self, plant: &PlantFile) -> Known {
        Known::new(&plant.parameters, self.voltage_margin, self.pwm_period(), self.dead_time)
    }
}

/// What the drive's sensors say at a millisecond.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensed {
    /// Time, in s.
    pub time: f64,
    /// Mechanical speed by the encoder, in rad/s.
    pub speed: f64,
    /// Mechanical angle by the encoder, in rad.
    pub angle: f64,
}

/// What the drive is asked for and what its shaft is loaded with.
pub trait Task {
    /// Every millisecond: the torque demand, in N m; `None` ends the run.
    fn torque_demand(&mut self, sensed: &Sensed) -> Option<f64>;

    /// Every PWM period: the torque that the load takes, in N m, from the true motion of the shaft.
    fn load_torque(&mut self, time: f64, truth: &Truth) -> f64;
}

/// One millisecond, as it is when the references are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Time, in s.
    pub time: f64,
    /// Torque demand, in N m.
    pub demand: f64,
    /// References.
    pub references: References,
    /// The true state.
    pub truth: Truth,
    /// Nominal air-gap torque k_t i_q (21) of the true current, in N m.
    pub torque: f64,
    /// Speed by the encoder, in rad/s.
    pub speed_measured: f64,
    /// Torque of the load in the first PWM period, in N m.
    pub load: f64,
    /// Length of the voltage vector that was commanded in the first PWM period, in V.
    pub voltage: f64,
}

/// What a run leaves: a row a millisecond.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// The rows.
    pub rows: Vec<Row>,
}

impl Trace {
    /// One quantity of all rows.
    pub fn column(&self, of: impl Fn(&Row) -> f64) -> Vec<f64> {
        self.rows.iter().map(of).collect()
    }
}

/// The loop.
pub struct ClosedLoop {
    machine: Machine,
    inverter: Inverter,
    encoder: Encoder,
    known: Known,
    fidelity: Fidelity,
    periods_per_ms: u32,
    /// Standard deviations of the current sensors in A, and their source.
    noise: Option<([f64; 2], Noise)>,
    /// PWM periods since the start.
    period: u64,
    duties: [f64; 3],
}

impl ClosedLoop {
    /// A drive with its motor, currents at 0, turning at `speed` (rad/s), with `load_inertia` (kg m^2) on the shaft.
    ///
    /// # Errors
    /// A plant that is no motor, or one with an effect that cannot act in a loop.
    pub fn new(plant: &PlantFile, drive: &Drive, load_inertia: f64, speed: f64) -> Result<Self, Faults> {
        let machine = Machine::new(plant, load_inertia, speed)?;
        let known = drive.known(plant);
        let period = drive.pwm_period();
        let sigma = |name: &str| plant.noise.iter().find(|(found, _)| *found == name).map_or(0.0, |(_, sigma)| *sigma);
        Ok(ClosedLoop {
            inverter: Inverter { period, dead_time: drive.dead_time, bus_voltage: known.bus_voltage },
            encoder: Encoder::new(drive.encoder, period, machine.truth().angle, speed),
            known,
            fidelity: drive.fidelity,
            periods_per_ms: drive.periods_per_ms,
            noise: drive.noise_seed.map(|seed| ([sigma("i_d"), sigma("i_q")], Noise::new(seed))),
            period: 0,
            duties: [0.5; 3],
            machine,
        })
    }

    /// The motor with every integration step divided by a whole number.
    #[must_use]
    pub fn refined(mut self, factor: usize) -> Self {
        self.machine = self.machine.refined(factor);
        self
    }

    /// Runs until the task ends.
    pub fn run<C: Controller + ?Sized, T: Task + ?Sized>(&mut self, controller: &mut C, task: &mut T) -> Trace {
        let mut trace = Trace::default();
        while let Some(row) = self.millisecond(controller, task) {
            trace.rows.push(row);
        }
        trace
    }

    /// One millisecond: references once, duties and the plant every PWM period. `None`: the task has ended, nothing was moved.
    pub fn millisecond<C: Controller + ?Sized, T: Task + ?Sized>(&mut self, controller: &mut C, task: &mut T) -> Option<Row> {
        let start = self.time();
        let reading = self.encoder.reading();
        let demand = task.torque_demand(&Sensed { time: start, speed: reading.speed, angle: reading.angle })?;
        let bus_voltage_v = self.inverter.bus_voltage;
        let references = controller.references(&Demand { torque_nm: demand, speed_rad_s: reading.speed, bus_voltage_v });
        let truth = self.machine.truth();
        let torque = self.known.torque_constant() * truth.i_q;
        let mut row =
            Row { time: start, demand, references, truth, torque, speed_measured: reading.speed, load: 0.0, voltage: 0.0 };
        for k in 0..self.periods_per_ms {
            let load = task.load_torque(self.time(), &self.machine.truth());
            let applied = self.pwm_period(controller, load);
            if k == 0 {
                row.load = load;
                row.voltage = applied;
            }
        }
        Some(row)
    }

    /// What a sensor of the shaft's speed reads, in rad/s, without noise.
    #[must_use]
    pub fn speed_reading(&mut self) -> f64 {
        self.machine.readings()[2]
    }

    /// One PWM period; the length of the commanded voltage vector.
    fn pwm_period<C: Controller + ?Sized>(&mut self, controller: &mut C, load: f64) -> f64 {
        let measured = self.measure();
        let next = controller.duties(&measured);
        let now = self.duties;
        match self.fidelity {
            Fidelity::Averaged => {
                // The signs of the currents are those of the middle of the period, about which the edges lie.
                let currents = self.phase_currents(0.5 * self.inverter.period);
                let voltage = self.inverter.average(now, currents);
                self.machine.advance(voltage, load, self.inverter.period);
            }
            Fidelity::Switched => {
                let mut edges = self.inverter.edges(now);
                while let Some((span, voltage)) = edges.next(self.phase_currents(0.0)) {
                    self.machine.advance(voltage, load, span);
                }
            }
        }
        self.duties = next;
        let time = self.time();
        let truth = self.machine.truth();
        self.encoder.read(time, truth.angle, truth.speed);
        self.period += 1;
        let [alpha, beta] = from_phases(next.map(|duty| duty * self.inverter.bus_voltage));
        alpha.hypot(beta)
    }

    fn time(&self) -> f64 {
        self.period as f64 * self.inverter.period
    }

    /// The true phase currents, in `ahead` s if those of the rotor's frame stay what they are.
    fn phase_currents(&self, ahead: f64) -> [f64; 3] {
        let truth = self.machine.truth();
        let angle = truth.angle + ahead * truth.speed;
        to_phases(Angle::new(self.known.pole_pairs * angle).to_stator([truth.i_d, truth.i_q]))
    }

    fn measure(&mut self) -> Measured {
        let [mut i_d, mut i_q, _] = self.machine.readings();
        if let Some((sigma, noise)) = &mut self.noise {
            i_d += sigma[0] * noise.normal();
            i_q += sigma[1] * noise.normal();
        }
        // Sensors sit on the phases; what an effect puts on the angle is in the frame of the readings and in the angle alike.
        let sensed = self.machine.sensed_angle();
        let mechanical = self.machine.truth().angle;
        let reading = self.encoder.reading();
        Measured {
            currents_a: to_phases(Angle::new(sensed).to_stator([i_d, i_q])),
            angle_rad: sensed + self.known.pole_pairs * (reading.angle - mechanical),
            speed_rad_s: reading.speed,
            bus_voltage_v: self.inverter.bus_voltage,
        }
    }
}
