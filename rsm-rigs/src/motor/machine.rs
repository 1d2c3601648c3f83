//! The plant `pmac` under voltages of the stator's frame.
//!
//! In: a plant file, stator-frame voltages held over a span, the load torque. Out: the state after it, and what sensors would read. A motor without
//! effects runs on the file `rotor.rs`; with effects it runs on the equations of its plant file. While the rotor turns, a voltage that stands still
//! in the stator turns in its frame: it is turned anew at every stage of the integration. Never draws random numbers.

use rsm_core::source::{Fault, Faults};

use super::park::Angle;
use super::rotor::Rotor;
use rsm_sim::effect::{Role, Subject};
use rsm_sim::equation_plant::Rates;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// A sub-step is at most this over the fastest rate, electrical turning included. Fourth order then errs by 0.35^5/120 = 4e-5 of what moves that
/// fast, in a step; the test of half the step measures what is left at the end.
const STEP_RATE: f64 = 0.35;

/// A plant with a faster rate, in 1/s, is refused: 3000 sub-steps in a PWM period of 0.1 ms.
const FASTEST: f64 = 1e7;

/// The voltage by which the frame of a recorded voltage is found, in V. It is far below any limit of a bus.
const PROBE: f64 = 1.0;

/// Whether a plant can be driven in a loop.
///
/// # Errors
/// A plant that is not `pmac`; effects that delay an input or a reading, which are those of a record: here the sampled controller makes its own.
pub fn check_plant(file: &PlantFile) -> Result<(), Faults> {
    if !file.kind.is("pmac") {
        let what = format!("`plant`: found \"{}\", expected \"pmac\"", file.kind.name());
        return Err(Faults::one(Fault::whole_file("plant file", what)));
    }
    if let Some(late) = file.acting().find(|it| it.description.declared.role == Role::Delay) {
        let what = format!(
            "found the effect `{}`, which is for records only: a drive in closed loop has its own delay; remove the effect",
            late.description.kind
        );
        return Err(Faults::one(Fault::whole_file("plant file", what)));
    }
    Ok(())
}

/// The equations of a motor.
enum Equations {
    /// Without effects.
    Plain(Rotor),
    /// With effects.
    WithEffects(Box<Effects>),
}

/// A motor with effects: the equations of its plant file, and the places of its states there.
struct Effects {
    rates: Rates,
    /// Direct current, quadrature current, speed and angle.
    places: [usize; 4],
}

impl Effects {
    /// The motor at rest, turned to a speed, in rad/s.
    fn new(file: &PlantFile, speed: f64) -> Result<Effects, Faults> {
        let zero: &[f64] = &[0.0; 2];
        let columns: [(&str, &[f64]); 8] = [
            ("time", &[0.0, 1.0]),
            ("v_d", zero),
            ("v_q", zero),
            ("load_torque", zero),
            ("i_d", zero),
            ("i_q", zero),
            ("speed", &[speed; 2]),
            ("angle", zero),
        ];
        let bare = PlantFile { columns: Vec::new(), initial: Vec::new(), ..file.clone() };
        let rates = Rates::new(&bare, &Record::in_memory(&bare, &columns)?)?;
        let names = rates.states();
        let place = |name: &str| {
            let missing = || Faults::one(Fault::whole_file("plant file", format!("the equations have no state `{name}`")));
            names.iter().position(|it| it == name).ok_or_else(missing)
        };
        let places = [place("current_d")?, place("current_q")?, place("speed")?, place("angle")?];
        Ok(Effects { rates, places })
    }

    /// The angle from the rotor's frame to that of recorded voltages, in rad: the direction in which a direct voltage moves the current.
    fn frame_angle(&mut self, time: f64, x: &[f64]) -> f64 {
        let [d, q, ..] = self.places;
        let [with, without] = [PROBE, 0.0].map(|v_d| self.rates.at(time, x, &[v_d, 0.0, 0.0]));
        (with[q] - without[q]).atan2(with[d] - without[d])
    }
}

/// The motor with its load's inertia.
pub struct Machine {
    equations: Equations,
    pole_pairs: f64,
    time: f64,
    x: Vec<f64>,
    trial: Vec<f64>,
    k: [Vec<f64>; 4],
    refinement: usize,
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
        let pole_pairs = parameters.number("pole_pairs");
        let is_in_equations = |subject: Subject| subject != Subject::Parameter;
        let equations = if file.acting().any(|it| is_in_equations(it.description.subject)) {
            // The values of parameters are those with their errors.
            let mut whole = PlantFile { parameters, ..file.clone() };
            for list in [&mut whole.effects, &mut whole.given] {
                list.retain(|it| is_in_equations(it.description.subject));
            }
            Equations::WithEffects(Box::new(Effects::new(&whole, speed)?))
        } else {
            Equations::Plain(Rotor::new(&parameters))
        };
        let x = match &equations {
            Equations::Plain(_) => vec![0.0, 0.0, speed, 0.0],
            Equations::WithEffects(it) => it.rates.start().to_vec(),
        };
        let of = || vec![0.0; x.len()];
        let (trial, k) = (of(), [of(), of(), of(), of()]);
        let mut machine = Machine { equations, pole_pairs, time: 0.0, x, trial, k, refinement: 1 };
        let rate = machine.fastest();
        if rate < FASTEST {
            Ok(machine)
        } else {
            let what = format!(
                "found a rate of {rate:e} 1/s, expected less than {FASTEST:e} 1/s: check the inductances, the inertia and the stiffnesses"
            );
            Err(Faults::one(Fault::whole_file("plant file", what)))
        }
    }

    /// The fastest rate at the present state, in 1/s.
    fn fastest(&mut self) -> f64 {
        let turning = self.pole_pairs * self.truth().speed.abs();
        match &mut self.equations {
            Equations::Plain(rotor) => rotor.fastest(self.x[2]),
            Equations::WithEffects(it) => it.rates.fastest(self.time, &self.x, &[0.0; 3]).max(turning),
        }
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
        let [i_d, i_q, speed, angle] = match &self.equations {
            Equations::Plain(_) => [0, 1, 2, 3],
            Equations::WithEffects(it) => it.places,
        }
        .map(|place| self.x[place]);
        Truth { i_d, i_q, speed, angle }
    }

    /// What current and speed sensors read: i_d and i_q of the frame at the electrical angle of [`Machine::sensed_angle`], speed.
    #[must_use]
    pub fn readings(&mut self) -> [f64; 3] {
        match &mut self.equations {
            Equations::Plain(_) => [self.x[0], self.x[1], self.x[2]],
            Equations::WithEffects(it) => {
                let found = it.rates.outputs(self.time, &self.x, &[0.0; 3]);
                [found[0], found[1], found[2]]
            }
        }
    }

    /// The electrical angle of the frame of sensors and voltages: the rotor's, and what an angle effect puts on it.
    #[must_use]
    pub fn sensed_angle(&mut self) -> f64 {
        let angle = self.pole_pairs * self.truth().angle;
        match &mut self.equations {
            Equations::Plain(_) => angle,
            Equations::WithEffects(it) => angle + it.frame_angle(self.time, &self.x),
        }
    }

    /// Integrates over a span (s) with a stator-frame voltage (V) and a load torque (N m) held.
    pub fn advance(&mut self, voltage: [f64; 2], load_torque: f64, span: f64) {
        if span <= 0.0 {
            return;
        }
        let rate = self.fastest();
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
        match &mut self.equations {
            Equations::Plain(rotor) => {
                let [v_d, v_q] = Angle::new(self.pole_pairs * x[3]).to_rotor(voltage);
                rotor.evaluate([v_d, v_q, load_torque], x, &mut self.k[k]);
            }
            Equations::WithEffects(it) => {
                let angle = self.pole_pairs * x[it.places[3]] + it.frame_angle(time, x);
                let [v_d, v_q] = Angle::new(angle).to_rotor(voltage);
                self.k[k].copy_from_slice(&it.rates.at(time, x, &[v_d, v_q, load_torque]));
            }
        }
    }
}
