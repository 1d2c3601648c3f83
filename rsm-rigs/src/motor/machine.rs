//! The plant `pmac` under voltages of the stator's frame.
//!
//! In: a plant file, stator-frame voltages held over a span, the load torque. Out: the state after it, and what sensors would read. The equations are
//! those of [`rsm_sim::plants::pmac`] with the effects of the plant file. While the rotor turns, a voltage that stands still in the stator turns in
//! its frame: it is turned anew at every stage of the integration. Never draws random numbers.

use rsm_core::source::{Fault, Faults};

use super::park::Angle;
use rsm_sim::hooks::Hooks;
use rsm_sim::kind::StartValues;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::plants::Plant;
use rsm_sim::plants::pmac::Pmac;
use rsm_sim::record::{Drive, Record};

/// A sub-step is at most this over the fastest rate, electrical turning included. Fourth order then errs by 0.35^5/120 = 4e-5 of what moves that
/// fast, in a step; the test of half the step measures what is left at the end.
const STEP_RATE: f64 = 0.35;

/// A plant with a faster rate, in 1/s, is refused: 3000 sub-steps in a PWM period of 0.1 ms.
const FASTEST: f64 = 1e7;

/// Whether a plant can be driven in a loop.
///
/// # Errors
/// A plant that is not `pmac`; the effects `input-delay` and `sensor-delay`, which are those of a record: here the sampled controller makes its own.
pub fn check_plant(file: &PlantFile) -> Result<(), Faults> {
    if !file.kind.is("pmac") {
        let what = format!("`plant`: found \"{}\", expected \"pmac\"", file.kind.name());
        return Err(Faults::one(Fault::whole_file("plant file", what)));
    }
    let hooks = Hooks::new(file, Pmac::STATES);
    if (0..3).any(|output| hooks.reads_late(output) > 0.0) {
        let what = "found the effect `sensor-delay`, which is for records only: a drive in closed loop has its own delay; remove the effect";
        return Err(Faults::one(Fault::whole_file("plant file", what)));
    }
    if hooks.delay() > 0.0 {
        let what = "found the effect `input-delay`, which is for records only: a drive in closed loop has its own delay; remove the effect";
        return Err(Faults::one(Fault::whole_file("plant file", what)));
    }
    Ok(())
}

/// The order of the states of the plant.
const SPEED: usize = 2;
const ANGLE: usize = 3;

/// The motor with its load's inertia.
pub struct Machine {
    plant: Pmac,
    hooks: Hooks,
    pole_pairs: f64,
    time: f64,
    x: Vec<f64>,
    trial: Vec<f64>,
    k: [Vec<f64>; 4],
    outputs: [f64; 3],
    refinement: usize,
    /// No effect stands between the state and what is read of it.
    plain: bool,
}

/// The true state: for traces and figures, never for a controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Direct current in the rotor's frame, in A.
    pub i_d: f64,
    /// Quadrature current, in A.
    pub i_q: f64,
    /// Mechanical speed, in rad/s.
    pub speed: f64,
    /// Mechanical angle, in rad.
    pub angle: f64,
}

impl Machine {
    /// The motor of a plant file at rest, with `load_inertia` (kg m^2) on its shaft, turned to `speed` (rad/s).
    ///
    /// # Errors
    /// See [`check_plant`]; parameters out of proportion.
    pub fn new(file: &PlantFile, load_inertia: f64, speed: f64) -> Result<Machine, Faults> {
        check_plant(file)?;
        let mut parameters = file.effective_parameters();
        parameters.set("inertia", parameters.number("inertia") + load_inertia);
        let hooks = Hooks::new(file, Pmac::STATES);
        let plant = Pmac::new(&parameters, &hooks, false);
        let of = || vec![0.0; hooks.states()];
        let mut machine = Machine {
            plant,
            pole_pairs: parameters.number("pole_pairs"),
            time: 0.0,
            x: of(),
            trial: of(),
            k: [of(), of(), of(), of()],
            outputs: [0.0; 3],
            refinement: 1,
            plain: file.acting().next().is_none(),
            hooks,
        };
        machine.start(speed);
        let rate = machine.plant.rates(&machine.hooks, &machine.x, &machine.k[0], 0.0).fastest;
        if rate < FASTEST {
            Ok(machine)
        } else {
            let what = format!(
                "found a rate of {rate:e} 1/s, expected less than {FASTEST:e} 1/s: check the inductances, the inertia and the stiffnesses"
            );
            Err(Faults::one(Fault::whole_file("plant file", what)))
        }
    }

    fn start(&mut self, speed: f64) {
        let record = Record {
            settings: Vec::new(),
            file: String::new(),
            drive: Drive::Open,
            time: Vec::new(),
            period: 0.0,
            inputs: Vec::new(),
            starts: Vec::new(),
            measured: Vec::new(),
            breaks: Vec::new(),
        };
        let mut start = StartValues::default();
        start[2] = speed;
        self.plant.start(&self.hooks, &start, &record, &[0.0; 3], &mut self.x);
        self.plant.evaluate(&self.hooks, None, &[0.0; 3], &self.x, &mut self.k[0], &mut self.outputs);
        self.hooks.settle(0.0, self.outputs, &mut self.x, &mut self.k[0]);
    }

    /// Divides every sub-step by a whole number.
    #[must_use]
    pub fn refined(mut self, factor: usize) -> Self {
        self.refinement = factor.max(1);
        self
    }

    /// The state.
    #[must_use]
    pub fn truth(&self) -> Truth {
        Truth { i_d: self.x[0], i_q: self.x[1], speed: self.x[SPEED], angle: self.x[ANGLE] }
    }

    /// What current and speed sensors read: i_d and i_q of the frame at the electrical angle of [`Machine::sensed_angle`], speed.
    #[must_use]
    pub fn readings(&mut self) -> [f64; 3] {
        if self.plain {
            return [self.x[0], self.x[1], self.x[SPEED]];
        }
        self.plant.evaluate(&self.hooks, None, &[0.0; 3], &self.x, &mut self.k[0], &mut self.outputs);
        self.hooks.read(self.time, &self.x, &mut self.k[0], &mut self.outputs);
        self.outputs
    }

    /// The electrical angle of the frame of sensors and voltages: the rotor's, and what an angle effect puts on it.
    #[must_use]
    pub fn sensed_angle(&self) -> f64 {
        self.electrical(self.x[ANGLE])
    }

    fn electrical(&self, angle: f64) -> f64 {
        self.pole_pairs * angle + self.hooks.frame_angle(angle)
    }

    /// Integrates over a span (s) with a stator-frame voltage (V) and a load torque (N m) held.
    pub fn advance(&mut self, voltage: [f64; 2], load_torque: f64, span: f64) {
        if span <= 0.0 {
            return;
        }
        let voltage = voltage.map(|v| self.hooks.input(v));
        // An effect may need the present rates of the state.
        if !self.plain {
            self.rates(voltage, load_torque, self.time, 0);
        }
        let rate = self.plant.rates(&self.hooks, &self.x, &self.k[0], span).fastest;
        if rate.is_nan() || rate > FASTEST {
            // The control has lost the current, because the inductance falls as the current rises: no number of sub-steps is sufficient.
            self.x.fill(f64::NAN);
            return;
        }
        let steps = (span * rate / STEP_RATE).ceil().max(1.0) as usize * self.refinement;
        let step = span / steps as f64;
        for _ in 0..steps {
            self.rates(voltage, load_torque, self.time, 0);
            for (k, share) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
                for ((trial, x), rate) in self.trial.iter_mut().zip(&self.x).zip(&self.k[k - 1]) {
                    *trial = x + share * step * rate;
                }
                self.rates(voltage, load_torque, self.time + share * step, k);
            }
            let [a, b, c, d] = &self.k;
            for (i, x) in self.x.iter_mut().enumerate() {
                *x += step / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
            }
            self.time += step;
        }
    }

    fn rates(&mut self, voltage: [f64; 2], load_torque: f64, time: f64, k: usize) {
        let x = if k == 0 { &self.x } else { &self.trial };
        let [v_d, v_q] = Angle::new(self.electrical(x[ANGLE])).to_rotor(voltage);
        self.plant.evaluate(&self.hooks, None, &[v_d, v_q, load_torque], x, &mut self.k[k], &mut self.outputs);
        if self.hooks.reads_with_memory() {
            self.hooks.read(time, x, &mut self.k[k], &mut self.outputs);
        }
    }
}
