//! Runs a plant with its effects along a record.
//!
//! In: a plant file and a record. Out: every output at every row. What stands between two rows is `equations`'.
//! The same files give the same bits.

use std::fmt;

use rsm_core::source::{Fault, Faults};

use crate::equation_plant;
pub use crate::equation_plant::shown;
pub use crate::equations::lanes::Controller;
use crate::kind::{PlantKind, Signal};
use crate::plant_file::PlantFile;
use crate::record::{Drive, Record};

/// Why a simulation stopped: a numerical outcome.
#[derive(Debug, Clone, PartialEq)]
pub enum Stopped {
    /// A state is no longer finite after this row (from 0).
    NotFinite {
        /// The row.
        row: usize,
    },
    /// The run took more steps up to this row than it was allowed: see [`Simulator::at_most`].
    TooLong {
        /// The row.
        row: usize,
    },
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
                    "the simulation took more steps up to row {} of the record than it was allowed: is a stiffness or an inertia out of proportion?",
                    row + 1
                )
            }
        }
    }
}

impl std::error::Error for Stopped {}

/// The outputs of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outputs {
    /// Those that this record's drive has, in the order of the plant.
    pub signals: Vec<Signal>,
    /// A value a row, for each of them.
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

/// A plant with its effects, ready for one record; it can run many times.
pub struct Simulator(Box<equation_plant::Run>);

impl Simulator {
    /// The plant of a file for a record.
    ///
    /// # Errors
    /// A fault when the start is neither in the record nor in `[initial]`, when the effects cannot stand together, or when the start has no solution.
    pub fn new(file: &PlantFile, record: &Record) -> Result<Simulator, Faults> {
        if !matches!(file.kind, PlantKind::Equations(_)) {
            let missing = starting(record, file.kind).into_iter().find(|place| start_of(file, record, *place).is_none());
            if let Some(place) = missing {
                let name = file.kind.starts()[place].name;
                let what = format!("nothing says where `{name}` starts");
                let help = format!("give the column `{name}` in the record, or a value under [initial] of the plant file");
                return Err(Faults::one(Fault::whole_file(&record.file, what).help(help)));
            }
        }
        Ok(Simulator(Box::new(equation_plant::Run::new(file, record)?)))
    }

    /// With another error of a step than 1e-8, relative to the largest value that a state has had, or changes by in one row: how far the outputs then move shows what steps leave.
    #[must_use]
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.0.tolerance = tolerance;
        self
    }

    /// Gives a run up that takes more than so many steps a row, on average over its record.
    #[must_use]
    pub fn at_most(mut self, steps_a_row: usize) -> Self {
        self.0.steps_a_row = steps_a_row;
        self
    }

    /// Steps of the last run, also of one that was given up.
    #[must_use]
    pub fn taken(&self) -> u64 {
        self.0.taken()
    }

    /// Runs along the record.
    ///
    /// # Errors
    /// [`Stopped`], when the numbers leave no way on.
    pub fn run(&mut self, record: &Record) -> Result<Outputs, Stopped> {
        self.along(record, None)
    }

    /// Runs with a controller in the loop: at every row it reads the outputs and says the first input, which is held to the next row; the record gives the rows, the start and what was said before the first. What it says does not move what it reads at
    /// the same instant: of the driveline nothing does, where the engine's lag stands between.
    ///
    /// # Errors
    /// [`Stopped`], when the numbers leave no way on.
    pub fn run_controlled(&mut self, record: &Record, controller: &mut Controller<'_>) -> Result<Outputs, Stopped> {
        self.along(record, Some(controller))
    }

    fn along(&mut self, record: &Record, controller: Option<&mut Controller<'_>>) -> Result<Outputs, Stopped> {
        let values = self.0.along(record, controller).map_err(|why| of_equations(&why))?;
        Ok(Outputs { signals: self.0.outputs(record).to_vec(), values })
    }
}

/// Why a plant stopped.
fn of_equations(stopped: &crate::equations::Stopped) -> Stopped {
    use crate::equations::Stopped as Why;
    match stopped {
        Why::NotFinite { row, .. } | Why::NoSolution { row } => Stopped::NotFinite { row: *row },
        Why::TooManySteps { row } | Why::TooManyEvents { row } => Stopped::TooLong { row: *row },
        Why::Step(_) => Stopped::TooLong { row: 0 },
    }
}

/// The places of [`PlantKind::starts`] that decide where a record starts (docs/book/src/reference/plants.md, section 2).
#[must_use]
pub fn starting(record: &Record, kind: PlantKind) -> Vec<usize> {
    match kind {
        PlantKind::Pmac if record.drive == Drive::HoldsDirectCurrent => vec![1, 2],
        PlantKind::Pmac => vec![0, 1, 2],
        PlantKind::Driveline => vec![1, 3, 4, 5],
        PlantKind::ServoAxis => vec![0, 1],
        PlantKind::Equations(kind) => equation_plant::starting(kind, record),
    }
}

/// Where one of them starts: as the plant file says, else as the record's first row; what no column can hold starts at 0 (an axis at rest, a car steadily). `None` where nothing says it.
#[must_use]
pub fn start_of(file: &PlantFile, record: &Record, place: usize) -> Option<f64> {
    let name = file.kind.starts()[place].name;
    let initial = file.initial.iter().find(|(found, _)| *found == name).map(|(_, value)| *value);
    let by_text = match file.kind {
        PlantKind::Equations(kind) => kind.start_values.get(place).copied(),
        _ => None,
    };
    let first = initial.or_else(|| match file.kind.output(name) {
        Some(output) => record.measured[output].as_ref().and_then(|values| values.first().copied()),
        None => Some(by_text.unwrap_or(0.0)),
    });
    first.or(by_text)
}
