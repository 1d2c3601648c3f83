//! Simulates a plant with its effects along a record.
//!
//! In: a plant file and a record. Out: every output at every row. The integration between two rows is in `equations`. The same files give the same
//! bits.

use std::fmt;

use rsm_core::source::{Fault, Faults};

use crate::equation_plant;
pub use crate::equation_plant::shown;
pub use crate::equations::Method;
pub use crate::equations::lanes::Controller;
use crate::kind::{PlantKind, Signal};
use crate::plant_file::PlantFile;
use crate::record::Record;

/// Why a simulation stopped. This is a numerical result, not a program fault.
#[derive(Debug, Clone, PartialEq)]
pub enum Stopped {
    /// A state is no longer finite after this row (from 0).
    NotFinite {
        /// The row.
        row: usize,
    },
    /// The run needed more work up to this row than permitted: see [`Simulator::at_most`].
    TooLong {
        /// The row.
        row: usize,
    },
    /// The fixed step or the method does not fit the record or the plant; a sentence.
    Step(String),
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Stopped::NotFinite { row } => {
                write!(
                    f,
                    "the simulation grows without bound after row {} of the record: are its inputs those of this plant?",
                    row + 1
                )
            }
            Stopped::TooLong { row } => {
                write!(
                    f,
                    "the simulation took more steps up to row {} of the record than the limit: is a stiffness or an inertia out of proportion?",
                    row + 1
                )
            }
            Stopped::Step(what) => f.write_str(what),
        }
    }
}

impl std::error::Error for Stopped {}

/// The outputs of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outputs {
    /// The outputs for this record's drive, in the order of the plant.
    pub signals: Vec<Signal>,
    /// For each of them, the value at every row.
    pub values: Vec<Vec<f64>>,
}

impl Outputs {
    /// The values of an output.
    #[must_use]
    pub fn of(&self, name: &str) -> Option<&[f64]> {
        let index = self.signals.iter().position(|signal| signal.name == name)?;
        Some(&self.values[index])
    }
}

/// A plant with its effects, prepared for one record. It can run many times.
pub struct Simulator(Box<equation_plant::Run>);

impl Simulator {
    /// The plant of a file for a record.
    ///
    /// # Errors
    /// A fault if the start is neither in the record nor in `[initial]`, if the effects cannot be combined, or if the start has no solution.
    pub fn new(file: &PlantFile, record: &Record) -> Result<Simulator, Faults> {
        if file.kind.is_first_format
            && let Some(name) = without_start(file, record)
        {
            let what = format!("nothing says where `{name}` starts");
            let help = format!("give the column `{name}` in the record, or a value under [initial] of the plant file");
            return Err(Faults::one(Fault::whole_file(&record.file, what).help(help)));
        }
        Ok(Simulator(Box::new(equation_plant::Run::new(file, record)?)))
    }

    /// Sets the permitted error of a step. The default is 1e-8, relative to the largest magnitude that a state has had, or to its change in one row.
    /// The change of the outputs with the tolerance shows the error of the steps.
    #[must_use]
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.0.tolerance = tolerance;
        self
    }

    /// Sets the integration method. The default is [`Method::Automatic`]. A run with a controller accepts no fixed step.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_sim::{plant_file::PlantFile, record::Record, simulate::{Method, Simulator}};
    ///
    /// let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\nviscous_friction = 0.0\ncommand_limit = 10.0\n";
    /// let plant = PlantFile::read(&Source::new("axis.toml", axis))?;
    /// let record = Record::read(&Source::new("in.csv", "time[s],command[V],position[m]\n0,1,0\n0.5,1,0\n1,1,0\n"), &plant)?;
    /// let found = Simulator::new(&plant, &record)?.method(Method::Fixed { step: 0.25 }).run(&record)?;
    /// // q = t^2: a method of order 4 has no error, except for rounding.
    /// assert!((found.of("position").unwrap()[2] - 1.0).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn method(mut self, method: Method) -> Self {
        self.0.method = method;
        self
    }

    /// Stops a run that needs more than this work per row, on average over its record. The unit is that of [`crate::equations::Setting::work`].
    #[must_use]
    pub fn at_most(mut self, work_a_row: usize) -> Self {
        self.0.work_a_row = work_a_row;
        self
    }

    /// The work of the last run, also if it was stopped early.
    #[must_use]
    pub fn work(&self) -> u64 {
        self.0.work()
    }

    /// Runs along the record.
    ///
    /// # Errors
    /// [`Stopped`], if a value is not finite or the run needs too many steps.
    pub fn run(&mut self, record: &Record) -> Result<Outputs, Stopped> {
        self.along(record, None)
    }

    /// Runs with a controller in the loop. At every row the controller reads the outputs and returns the first input, which is constant until the
    /// next row. The record gives the rows, the start and the first input before the first row. The returned input must not change the outputs at the
    /// same instant. In the driveline it does not, because the engine's lag is between them.
    ///
    /// # Errors
    /// [`Stopped`], if a value is not finite or the run needs too many steps.
    pub fn run_controlled(&mut self, record: &Record, controller: &mut Controller<'_>) -> Result<Outputs, Stopped> {
        self.along(record, Some(controller))
    }

    fn along(&mut self, record: &Record, controller: Option<&mut Controller<'_>>) -> Result<Outputs, Stopped> {
        let values = self.0.along(record, controller).map_err(|why| of_equations(&why))?;
        Ok(Outputs { signals: self.0.outputs(record), values })
    }
}

/// The first output of a plant of format 1 that needs a start and has none.
fn without_start(file: &PlantFile, record: &Record) -> Option<&'static str> {
    let shown = shown(file.kind, record);
    let mut needed = file.kind.starts().iter().filter(|it| shown.contains(it)).map(|it| it.name);
    needed.find(|name| {
        let is_read = file.kind.output(name).is_none_or(|output| record.measured[output].is_some());
        !is_read && !file.initial.iter().any(|it| it.0 == *name)
    })
}

/// Converts the reason why a plant stopped.
fn of_equations(stopped: &crate::equations::Stopped) -> Stopped {
    use crate::equations::Stopped as Why;
    match stopped {
        Why::NotFinite { row, .. } | Why::NoSolution { row } => Stopped::NotFinite { row: *row },
        Why::TooManySteps { row } | Why::TooManyEvents { row } => Stopped::TooLong { row: *row },
        Why::Step(what) => Stopped::Step(what.clone()),
    }
}

/// The indices in [`PlantKind::starts`] that determine the start of a record (docs/book/src/reference/plants.md, section 2).
#[must_use]
pub fn starting(record: &Record, kind: PlantKind) -> Vec<usize> {
    if !kind.is_first_format {
        return equation_plant::starting(kind, record);
    }
    // Every output that the run computes has a start, also without a reading.
    let shown = shown(kind, record);
    let is_in = |it: &Signal| shown.contains(it) || kind.free_starts.contains(it) || kind.is_of_start(it.name);
    (0..kind.starts().len()).filter(|it| is_in(&kind.starts()[*it])).collect()
}

/// The start value of one of them: from the plant file, else from the record's first row. A variable without a column starts at 0 (an axis at rest, a
/// car in steady motion) or at the value of the text. `None` if no value is known.
#[must_use]
pub fn start_of(file: &PlantFile, record: &Record, place: usize) -> Option<f64> {
    let name = file.kind.starts()[place].name;
    let known = file.initial.iter().chain(&record.starts);
    let initial = known.into_iter().find(|(found, _)| *found == name).map(|(_, value)| *value);
    let by_text = file.kind.start_values.get(place).copied();
    let first = initial.or_else(|| match file.kind.output(name) {
        Some(output) => record.measured[output].as_ref().and_then(|values| values.first().copied()),
        None => Some(by_text.unwrap_or(0.0)),
    });
    first.or(by_text)
}
