//! Runs a plant with its effects along a record.
//!
//! In: a plant file and a record. Out: every output at every row. What stands between two rows is `integrate`'s.
//! The same files give the same bits on one machine. Never allocates in a row, but for the outputs and for a linear part where one is taken.

use std::fmt;

use rsm_core::source::{Fault, Faults};

use crate::equation_plant;
use crate::hooks::Hooks;
use crate::integrate::{self, MOST_STEPS, Span, System, Work};
use crate::kind::{PlantKind, Signal, StartValues};
use crate::plant_file::PlantFile;
use crate::plants::Plant;
use crate::plants::driveline::Driveline;
use crate::plants::pmac::Pmac;
use crate::plants::servo_axis::ServoAxis;
use crate::record::{Drive, Record};

/// The delay is whole periods when it is so near, in periods: decimals of periods and delays do not meet exactly.
const WHOLE: f64 = 1e-9;

/// Why a simulation stopped: a numerical outcome.
#[derive(Debug, Clone, PartialEq)]
pub enum Stopped {
    /// A state is no longer finite after this row (from 0).
    NotFinite {
        /// The row.
        row: usize,
    },
    /// The plant needs more sub-steps a period than are reasonable.
    TooFast {
        /// The row.
        row: usize,
        /// Its fastest rate, in 1/s.
        rate: f64,
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
            Stopped::TooFast { row, rate } => write!(
                f,
                "at row {} of the record the plant moves at {rate:e} 1/s, more than {MOST_STEPS} sub-steps a period: \
                 a stiffness or an inertia is out of proportion",
                row + 1
            ),
            Stopped::TooLong { row } => {
                write!(f, "the simulation took more sub-steps up to row {} of the record than it was allowed", row + 1)
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

enum Equations {
    Pmac(Pmac),
    Driveline(Driveline),
    ServoAxis(ServoAxis),
}

/// A plant with its effects, ready for one record; it can run many times.
pub struct Simulator(Way);

/// By which engine it runs.
enum Way {
    Own(Box<Own>),
    Equations(Box<equation_plant::Run>),
}

/// One of the plants that are code.
struct Own {
    equations: Equations,
    kind: PlantKind,
    hooks: Hooks,
    start: StartValues,
    refinement: usize,
    /// Sub-steps a row that a run may take on average.
    allowed: usize,
    taken: usize,
    work: Work,
}

impl Simulator {
    /// The plant of a file for a record.
    ///
    /// # Errors
    /// A fault when the start is neither in the record nor in `[initial]`; of a plant of equations, when the effects cannot stand there or the start has no solution.
    pub fn new(file: &PlantFile, record: &Record) -> Result<Simulator, Faults> {
        Ok(Simulator(match file.kind {
            PlantKind::Equations(kind) => Way::Equations(Box::new(equation_plant::Run::new(kind, file, record)?)),
            _ => Way::Own(Box::new(Own::new(file, record)?)),
        }))
    }

    /// Divides every sub-step by a whole number: how far the outputs then move shows what the step leaves. A plant of equations has an error of its own choice, and stays as it is.
    #[must_use]
    pub fn refined(mut self, factor: usize) -> Self {
        if let Way::Own(own) = &mut self.0 {
            own.refinement = factor.max(1);
        }
        self
    }

    /// Gives a run up that takes more than so many sub-steps a row, on average over its record.
    #[must_use]
    pub fn at_most(mut self, steps_a_row: usize) -> Self {
        if let Way::Own(own) = &mut self.0 {
            own.allowed = steps_a_row;
        }
        self
    }

    /// Sub-steps of the last run, also of one that was given up.
    #[must_use]
    pub fn taken(&self) -> usize {
        match &self.0 {
            Way::Own(own) => own.taken,
            Way::Equations(run) => run.taken(),
        }
    }

    /// The start as the diagnosis may vary it: true outputs, and what no column holds. A plant of equations takes its start from its file.
    pub fn set_start(&mut self, start: StartValues) {
        if let Way::Own(own) = &mut self.0 {
            own.start = start;
        }
    }

    /// Runs along the record.
    ///
    /// # Errors
    /// [`Stopped`], when the numbers leave no way on.
    pub fn run(&mut self, record: &Record) -> Result<Outputs, Stopped> {
        let mut outputs = Outputs::default();
        self.run_into(record, &mut outputs)?;
        Ok(outputs)
    }

    /// The same into outputs that are used again: no allocation once they have their size.
    ///
    /// # Errors
    /// [`Stopped`], when the numbers leave no way on.
    pub fn run_into(&mut self, record: &Record, outputs: &mut Outputs) -> Result<(), Stopped> {
        match &mut self.0 {
            Way::Own(own) => own.run_with(record, None, outputs),
            Way::Equations(run) => {
                outputs.signals.clear();
                outputs.signals.extend_from_slice(run.outputs());
                outputs.values = run.along(record).map_err(|why| of_equations(&why))?;
                Ok(())
            }
        }
    }

    /// Runs with a controller in the loop: at every row it reads the outputs and says the first input, which is held to the next row; the
    /// record gives the rows, the start and what was said before the first. For a plant whose outputs do not depend on this input at their
    /// own instant: the driveline, where the engine's lag stands between.
    ///
    /// # Panics
    /// For another plant.
    ///
    /// # Errors
    /// [`Stopped`], when the numbers leave no way on.
    pub fn run_controlled(
        &mut self,
        record: &Record,
        controller: &mut Controller<'_>,
        outputs: &mut Outputs,
    ) -> Result<(), Stopped> {
        match &mut self.0 {
            Way::Own(own) if own.kind == PlantKind::Driveline => own.run_with(record, Some(controller), outputs),
            _ => panic!("only the driveline takes a controller row by row"),
        }
    }
}

/// Why a plant of equations stopped.
fn of_equations(stopped: &crate::equations::Stopped) -> Stopped {
    use crate::equations::Stopped as Why;
    match stopped {
        Why::NotFinite { row, .. } | Why::NoSolution { row } => Stopped::NotFinite { row: *row },
        Why::TooManySteps { row } | Why::TooManyEvents { row } => Stopped::TooLong { row: *row },
        Why::Step(_) => Stopped::TooLong { row: 0 },
    }
}

impl Own {
    fn new(file: &PlantFile, record: &Record) -> Result<Own, Faults> {
        let parameters = file.effective_parameters();
        let holds = record.drive == Drive::HoldsDirectCurrent;
        let (hooks, equations) = match file.kind {
            PlantKind::Pmac => {
                let hooks = Hooks::new(file, Pmac::STATES);
                let plant = Pmac::new(&parameters, &hooks, holds);
                (hooks, Equations::Pmac(plant))
            }
            PlantKind::Driveline => {
                let plant = Driveline::new(&parameters, record.gear);
                (Hooks::new(file, Driveline::STATES), Equations::Driveline(plant))
            }
            PlantKind::ServoAxis => {
                let hooks = Hooks::new(file, ServoAxis::STATES);
                let plant = ServoAxis::new(&parameters, &hooks);
                (hooks, Equations::ServoAxis(plant))
            }
            PlantKind::Equations(_) => unreachable!("a plant of equations has a run of its own"),
        };
        let mut start = StartValues::default();
        for place in starting(record, file.kind) {
            let Some(reading) = start_of(file, record, place) else {
                let name = file.kind.starts()[place].name;
                let what = format!("nothing says where `{name}` starts");
                let help = format!("give the column `{name}` in the record, or a value under [initial] of the plant file");
                return Err(Faults::one(Fault::whole_file(&record.file, what).help(help)));
            };
            start[place] = match file.kind.output(file.kind.starts()[place].name) {
                Some(output) => hooks.truth(output, reading, record.time[0]),
                None => reading,
            };
        }
        let work = Work::new(hooks.states());
        Ok(Own { equations, kind: file.kind, hooks, start, refinement: 1, allowed: usize::MAX, taken: 0, work })
    }

    fn run_with(
        &mut self,
        record: &Record,
        controller: Option<&mut Controller<'_>>,
        outputs: &mut Outputs,
    ) -> Result<(), Stopped> {
        let shown = shown(self.kind, record.drive);
        outputs.signals.clear();
        outputs.signals.extend_from_slice(shown);
        outputs.values.resize_with(shown.len(), Vec::new);
        for values in &mut outputs.values {
            values.clear();
            values.reserve(record.rows());
        }
        let first = usize::from(record.drive == Drive::HoldsDirectCurrent);
        let mut run = Run {
            hooks: &self.hooks,
            record,
            work: &mut self.work,
            kind: self.kind,
            refinement: self.refinement,
            left: self.allowed.saturating_mul(record.rows()),
            commands: Vec::new(),
            controller,
        };
        let allowed = run.left;
        let done = match &self.equations {
            Equations::Pmac(plant) => run.along(plant, &self.start, first, outputs),
            Equations::Driveline(plant) => run.along(plant, &self.start, first, outputs),
            Equations::ServoAxis(plant) => run.along(plant, &self.start, first, outputs),
        };
        self.taken = allowed - run.left;
        done
    }
}

/// The outputs that a run along a record with this drive has, in the order of the plant.
///
/// ```
/// use rsm_sim::{kind::PlantKind, record::Drive, simulate::shown};
///
/// // The command of an axis is an output of its controller.
/// assert_eq!(shown(PlantKind::ServoAxis, Drive::Open).len(), 1);
/// assert_eq!(shown(PlantKind::ServoAxis, Drive::Closed).len(), 2);
/// ```
#[must_use]
pub fn shown(kind: PlantKind, drive: Drive) -> &'static [Signal] {
    let all = kind.outputs();
    match drive {
        Drive::HoldsDirectCurrent => &all[1..],
        Drive::Open if kind == PlantKind::ServoAxis => &all[..1],
        _ => all,
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

/// A controller in the loop: from a row and the outputs as they are read there to the first input.
pub type Controller<'a> = dyn FnMut(usize, &[f64; 3]) -> f64 + 'a;

/// A delay in whole periods of a record and a part of one. Beyond the record every row has the first value.
fn periods(delay: f64, record: &Record) -> (usize, f64) {
    let delay = delay / record.period;
    let mut whole = delay.floor();
    let mut part = delay - whole;
    if part > 1.0 - WHOLE {
        (whole, part) = (whole + 1.0, 0.0);
    } else if part < WHOLE {
        part = 0.0;
    }
    (if whole < record.rows() as f64 { whole as usize } else { record.rows() }, part)
}

/// An output that is read late.
struct LateReading {
    output: usize,
    /// Rows by which it is late, the part of a period included.
    rows: usize,
    /// Where between two rows it is read, as a share of the period; 1 is the later row itself.
    offset: f64,
    /// What it read there, after each row.
    between: Vec<f64>,
}

impl LateReading {
    fn new(output: usize, delay: f64, record: &Record) -> Self {
        let (whole, part) = periods(delay, record);
        let rows = if part > 0.0 { whole + 1 } else { whole };
        LateReading { output, rows, offset: 1.0 - part, between: Vec::with_capacity(record.rows()) }
    }

    /// Puts the late readings in the place of those on time.
    fn delay(&self, values: &mut [f64]) {
        let on_time = values.to_vec();
        for (row, value) in values.iter_mut().enumerate() {
            let earlier = row.checked_sub(self.rows);
            // At the end of a period, the reading is that of the row itself: inputs that change there count.
            let read = |row: usize| if self.offset < 1.0 { self.between[row] } else { on_time[row] };
            *value = earlier.map_or(on_time[0], read);
        }
    }
}

struct Run<'a, 'c, 'd> {
    hooks: &'a Hooks,
    record: &'a Record,
    work: &'a mut Work,
    kind: PlantKind,
    refinement: usize,
    /// Sub-steps that the run may still take.
    left: usize,
    /// What the controller said, row by row; empty without one.
    commands: Vec<f64>,
    controller: Option<&'c mut Controller<'d>>,
}

impl Run<'_, '_, '_> {
    fn along<P: Plant>(&mut self, plant: &P, start: &StartValues, first: usize, outputs: &mut Outputs) -> Result<(), Stopped> {
        let record = self.record;
        let (whole, part) = periods(self.hooks.delay(), record);
        let mut late_readings: Vec<LateReading> = (first..first + outputs.values.len())
            .map(|output| (output, self.hooks.reads_late(output)))
            .filter(|(_, delay)| *delay > 0.0)
            .map(|(output, delay)| LateReading::new(output, delay, record))
            .collect();
        late_readings.sort_by(|a, b| a.offset.total_cmp(&b.offset));
        if record.drive == Drive::Closed || self.controller.is_some() {
            self.commands.reserve(record.rows());
        }
        let before_any = match (record.drive, &self.controller) {
            (Drive::Closed, _) => [0.0; 3],
            (_, Some(_)) => [self.hooks.input(record.inputs[0][0]), 0.0, 0.0],
            _ => self.acting(0, 0),
        };
        self.work.restart();
        plant.start(self.hooks, start, record, &before_any, &mut self.work.x);
        // The positions that the drive of an axis read last: it came to its start at its start's speed.
        let mut held = [0.0, 1.0, 2.0].map(|rows| self.work.x[0] - rows * record.period * self.work.x[1]);
        for row in 0..record.rows() {
            let time = record.time[row];
            if record.drive == Drive::Closed {
                held = if row == 0 { held } else { [self.work.x[0], held[0], held[1]] };
                let command = plant.command(record.inputs[0][row], &self.work.x, held, record.period);
                self.commands.push(command);
            }
            if self.controller.is_some() {
                let work = &mut *self.work;
                plant.evaluate(self.hooks, None, &before_any, &work.x, &mut work.k[0], &mut work.outputs);
                if row == 0 {
                    self.hooks.settle(time, work.outputs, &mut work.x, &mut work.k[0]);
                }
                self.hooks.read(time, &work.x, &mut work.k[0], &mut work.outputs);
            }
            if let Some(controller) = &mut self.controller {
                let command = controller(row, &self.work.outputs);
                self.commands.push(command);
            }
            let late = self.acting(row, row.saturating_sub(whole + 1));
            let now = self.acting(row, row.saturating_sub(whole));
            let at_row = if part > 0.0 { late } else { now };
            let work = &mut *self.work;
            let pieces = plant.evaluate(self.hooks, None, &at_row, &work.x, &mut work.k[0], &mut work.outputs);
            if row == 0 {
                self.hooks.settle(time, work.outputs, &mut work.x, &mut work.k[0]);
            }
            // Also the rates of states that follow a reading: the integration begins with them.
            self.hooks.read(time, &work.x, &mut work.k[0], &mut work.outputs);
            for (values, value) in outputs.values.iter_mut().zip(&work.outputs[first..]) {
                values.push(*value);
            }
            if row + 1 == record.rows() {
                break;
            }
            let mut stretch = |inputs: [f64; 3], pieces: Option<u32>, start: f64, length: f64| {
                let system = System { plant, hooks: self.hooks, inputs };
                let pieces = pieces.unwrap_or_else(|| system.rates_here(None, start, self.work));
                let taken = integrate::hold(&system, self.work, pieces, Span { start, length }, self.refinement)
                    .map_err(|rate| Stopped::TooFast { row, rate })?;
                self.left = self.left.checked_sub(taken).ok_or(Stopped::TooLong { row })?;
                Ok(())
            };
            let period = record.period;
            if late_readings.is_empty() {
                if part > 0.0 {
                    stretch(late, Some(pieces), time, part * period)?;
                    stretch(now, None, time + part * period, (1.0 - part) * period)?;
                } else {
                    stretch(now, Some(pieces), time, period)?;
                }
            } else {
                self.between_rows(plant, row, [late, now], part, &mut late_readings)?;
            }
            if self.work.x.iter().any(|value| !value.is_finite()) {
                return Err(Stopped::NotFinite { row });
            }
        }
        for it in &late_readings {
            it.delay(&mut outputs.values[it.output - first]);
        }
        Ok(())
    }

    /// From a row to the next, with readings on the way: those of outputs that are read late, and the change of the first input at `part` of the period.
    fn between_rows<P: Plant>(
        &mut self,
        plant: &P,
        row: usize,
        [late, now]: [[f64; 3]; 2],
        part: f64,
        late_readings: &mut [LateReading],
    ) -> Result<(), Stopped> {
        let (time, period) = (self.record.time[row], self.record.period);
        let mut at = 0.0;
        let mut next = 0;
        while at < 1.0 {
            let inputs = if at < part { late } else { now };
            let reading = late_readings.get(next).map_or(1.0, |it| it.offset);
            let end = if at < part { reading.min(part) } else { reading };
            if end > at {
                let system = System { plant, hooks: self.hooks, inputs };
                let start = time + at * period;
                let pieces = system.rates_here(None, start, self.work);
                let span = Span { start, length: (end - at) * period };
                let taken = integrate::hold(&system, self.work, pieces, span, self.refinement)
                    .map_err(|rate| Stopped::TooFast { row, rate })?;
                self.left = self.left.checked_sub(taken).ok_or(Stopped::TooLong { row })?;
                at = end;
            }
            if next < late_readings.len() && late_readings[next].offset <= at {
                let work = &mut *self.work;
                plant.evaluate(self.hooks, None, &inputs, &work.x, &mut work.k[0], &mut work.outputs);
                self.hooks.read(time + at * period, &work.x, &mut work.k[0], &mut work.outputs);
                late_readings[next].between.push(work.outputs[late_readings[next].output]);
                next += 1;
            }
        }
        Ok(())
    }

    /// The inputs that act at a row, the first as it was at an earlier one.
    fn acting(&self, row: usize, earlier: usize) -> [f64; 3] {
        let inputs = &self.record.inputs;
        match self.kind {
            PlantKind::Pmac => {
                let v_d = inputs[0].get(earlier).copied().unwrap_or(0.0);
                [self.hooks.input(v_d), self.hooks.input(inputs[1][earlier]), inputs[2][row]]
            }
            PlantKind::Driveline => {
                let commands = if self.controller.is_some() { &self.commands } else { &inputs[0] };
                [self.hooks.input(commands[earlier]), 0.0, 0.0]
            }
            PlantKind::ServoAxis => {
                let commands = if self.record.drive == Drive::Closed { &self.commands } else { &inputs[0] };
                [self.hooks.input(commands[earlier]), commands[row], 0.0]
            }
            PlantKind::Equations(_) => unreachable!("a plant of equations has a run of its own"),
        }
    }
}
