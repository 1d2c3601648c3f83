//! The rates and outputs of a plant at given states, without a run.
//!
//! In: a plant file, a record for what it determines of the plant; states and inputs. Out: the rate of each state, and the outputs. Never advances
//! the time.

use nalgebra::DMatrix;
use rsm_core::source::Faults;

use super::run::models;
use crate::equations::{Machine, Point};
use crate::plant_file::PlantFile;
use crate::record::Record;

/// A plant with its effects, ready to be evaluated at points.
#[derive(Debug, Clone)]
pub struct Rates {
    machine: Machine,
    point: Point,
    /// Whether a reading or an input is delayed. A delay has a history, which a point does not contain.
    pub is_late: bool,
}

impl Rates {
    /// The plant of a file along a record. The record gives the parameters that it determines, and the start.
    ///
    /// # Errors
    /// Effects that cannot be combined; a start without a solution.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_sim::{equation_plant::Rates, plant_file::PlantFile, record::Record};
    ///
    /// let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\nviscous_friction = 1.0\ncommand_limit = 10.0\n";
    /// let plant = PlantFile::read(&Source::new("axis.toml", axis))?;
    /// let record = Record::in_memory(&plant, &[("time", &[0.0, 1.0]), ("command", &[0.0; 2]), ("position", &[0.0; 2])])?;
    /// let mut rates = Rates::new(&plant, &record)?;
    /// let place = |name: &str| rates.states().iter().position(|it| it == name).unwrap();
    /// let (position, speed) = (place("position"), place("speed"));
    /// let mut states = [0.0; 2];
    /// states[speed] = 0.5;
    /// let found = rates.at(0.0, &states, &[3.0]);
    /// // 2 kg: 4 N/V of 3 V, less 1 N s/m of 0.5 m/s.
    /// assert_eq!((found[position], found[speed]), (0.5, 5.75));
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn new(file: &PlantFile, record: &Record) -> Result<Rates, Faults> {
        let model = models(file, record).of(file, record)?;
        let mut machine = model.machine.clone();
        let point = model.begin(&mut machine, file, record)?;
        let is_late = machine.is_late();
        Ok(Rates { machine, point, is_late })
    }

    /// The names of the states, in their order.
    #[must_use]
    pub fn states(&self) -> Vec<String> {
        self.machine.states().into_iter().map(|it| it.0).collect()
    }

    /// The states at the start.
    #[must_use]
    pub fn start(&self) -> &[f64] {
        &self.point.states
    }

    /// The rate of each state in its unit per s, at a time in s. Inputs are in the order of the text.
    ///
    /// # Panics
    /// If there are not as many states or inputs as the plant has.
    pub fn at(&mut self, time: f64, states: &[f64], inputs: &[f64]) -> Vec<f64> {
        self.set(time, states, inputs);
        self.machine.rates(&self.point)
    }

    /// The outputs, in the order of the text.
    ///
    /// # Panics
    /// If there are not as many states or inputs as the plant has.
    pub fn outputs(&mut self, time: f64, states: &[f64], inputs: &[f64]) -> Vec<f64> {
        self.set(time, states, inputs);
        self.machine.outputs_at(&self.point)
    }

    /// The fastest rate at a state, in 1/s: the largest magnitude of an eigenvalue of the equations that are linearised there; NaN if a derivative is
    /// not finite.
    ///
    /// # Panics
    /// If there are not as many states or inputs as the plant has.
    pub fn fastest(&mut self, time: f64, states: &[f64], inputs: &[f64]) -> f64 {
        self.set(time, states, inputs);
        let slopes = self.machine.slopes_at(&self.point);
        // An eigenvalue iteration does not terminate if an entry is not finite.
        if slopes.iter().any(|it| !it.is_finite()) {
            return f64::NAN;
        }
        let n = states.len();
        DMatrix::from_row_slice(n, n, &slopes).complex_eigenvalues().iter().map(|it| it.norm()).fold(0.0, f64::max)
    }

    fn set(&mut self, time: f64, states: &[f64], inputs: &[f64]) {
        self.point.time = time;
        self.point.states.copy_from_slice(states);
        self.point.inputs[..inputs.len()].copy_from_slice(inputs);
        self.machine.compare(&mut self.point);
    }
}
