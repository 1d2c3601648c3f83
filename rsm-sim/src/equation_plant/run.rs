//! A plant of equations along a record.
//!
//! In: a plant file of kind Equations, a record. Out: every output at every row. The same files give the same bits.
//! Equations with the same effects at the same places are compiled once: another value of a number compiles nothing.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rsm_core::source::{Fault, Faults};

use super::plant_of;
use crate::effect::Subject;
use crate::equations::file::{EquationFile, Given, of_rows};
use crate::equations::{self, Inputs, Lane, Lanes, Machine, Point, Setting, Signals, Starts, Stopped, lanes};
use crate::kind::Described;
use crate::plant_file::{Entry, PlantFile};
use crate::quantity::Signal;
use crate::record::Record;

/// Steps that a run is said to take a row. The engine chooses its steps by their error; a row of a record takes one or a few.
pub(super) const STEPS_A_ROW: usize = 4;

/// Rows of a record at which sizes are looked at, evenly spread.
const ROWS: usize = 400;

/// What is known of the models of a plant. It lives as long as its kind, and so do they.
#[derive(Default)]
pub(super) struct Models {
    /// Which outputs say where a record starts, by which outputs it holds.
    starting: Mutex<HashMap<Vec<bool>, Vec<usize>>>,
    /// By what a record decides and which effects stand where.
    built: Mutex<HashMap<String, &'static Model>>,
}

/// Equations with effects, compiled.
struct Model {
    file: EquationFile,
    machine: Machine,
    /// Programs of the start, by the names of what is given and of what is recorded.
    starts: Mutex<HashMap<[Vec<String>; 2], Arc<Starts>>>,
    /// Room and code for runs that go on side by side.
    slots: Mutex<Vec<Slot>>,
}

/// What one run needs for itself.
struct Slot {
    /// A copy that has the numbers of the run.
    machine: Machine,
    lanes: Lanes<'static>,
}

fn open<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Models {
    /// Places of [`Described::starts`] that count for a record.
    pub(super) fn starting(&self, kind: &'static Described, record: &Record) -> Vec<usize> {
        let holds: Vec<bool> = record.measured.iter().map(Option::is_some).collect();
        open(&self.starting).entry(holds.clone()).or_insert_with(|| count(kind, &holds)).clone()
    }

    /// The equations of a plant file for a record.
    fn of(&self, kind: &'static Described, file: &PlantFile, record: &Record) -> Result<&'static Model, Faults> {
        let mut name = String::new();
        for it in decided(record) {
            let _ = write!(name, "{}={:x};", it.name, it.value.to_bits());
        }
        for entry in in_equations(file) {
            let numbers: Vec<&str> = entry.arguments.numbers.iter().map(|it| it.0).collect();
            let at = entry.arguments.subject.as_deref().unwrap_or_default();
            let _ = write!(name, "{}@{at}({});", entry.description.kind, numbers.join(","));
        }
        if let Some(model) = open(&self.built).get(&name) {
            return Ok(model);
        }
        // Compiled without the lock: two may do it at the same time, and the first counts.
        let file = file_of(kind, file, record)?;
        let machine = Machine::new(&file)?;
        let model = Model { file, machine, starts: Mutex::default(), slots: Mutex::default() };
        Ok(open(&self.built).entry(name).or_insert_with(|| Box::leak(Box::new(model))))
    }
}

fn count(kind: &'static Described, holds: &[bool]) -> Vec<usize> {
    let place = |name: &str| kind.outputs.iter().position(|it| it.name == name);
    let file = &plant_of(kind).file;
    let Ok(mut machine) = Machine::new(file) else { return Vec::new() };
    let (counts, by_text) = machine.start_by(&|output| holds.get(output) == Some(&true)).unwrap_or_default();
    let is_in = |signal: &Signal| match place(signal.name) {
        Some(output) if counts.contains(&output) => true,
        _ => by_text.iter().any(|it| it == signal.name),
    };
    (0..kind.starts.len()).filter(|k| is_in(&kind.starts[*k])).collect()
}

/// The equations of a plant file without its effects, and where they stand at some rows of a record, evenly spread.
pub(super) fn without_effects(
    kind: &'static Described,
    file: &PlantFile,
    record: &Record,
) -> Result<(EquationFile, Machine, Vec<Point>), Faults> {
    let bare = PlantFile { effects: Vec::new(), given: Vec::new(), ..file.clone() };
    let whole = file_of(kind, &bare, record)?;
    let mut machine = Machine::new(&whole)?;
    let start = started(&whole, &mut machine, &file.initial, record)?;
    let inputs = Inputs { time: &record.time, values: &record.inputs };
    let points = lanes::points(&machine, start, inputs, Setting::default(), (record.rows() / ROWS).max(1));
    Ok((whole, machine, points))
}

/// How large each of the starts of a kind becomes along a record.
pub(super) fn largest(kind: &'static Described, file: &PlantFile, record: &Record) -> Result<Vec<f64>, Faults> {
    let (_, machine, points) = without_effects(kind, file, record)?;
    let names: Vec<String> = machine.states().into_iter().chain(machine.outputs()).map(|it| it.0).collect();
    let mut most = vec![0.0_f64; names.len()];
    for point in &points {
        let values = point.states.iter().copied().chain(machine.outputs_at(point));
        for (most, value) in most.iter_mut().zip(values).filter(|(_, value)| value.is_finite()) {
            *most = most.max(value.abs());
        }
    }
    let of = |signal: &Signal| names.iter().position(|it| it == signal.name).map_or(0.0, |k| most[k]);
    Ok(kind.starts.iter().map(of).collect())
}

/// The effects that change equations: another value of a parameter does not.
fn in_equations(file: &PlantFile) -> impl Iterator<Item = &Entry> {
    file.acting().filter(|it| it.description.subject != Subject::Parameter || it.description.at.is_some())
}

/// What a record decides of the parameters.
fn decided(record: &Record) -> Vec<Given> {
    let given = |(name, value): &(&str, f64)| Given { name: (*name).to_string(), value: *value };
    record.settings.iter().map(given).chain(of_rows(record.period, record.first_time())).collect()
}

/// The equations of a plant file for a record, with its effects and numbers.
fn file_of(kind: &'static Described, file: &PlantFile, record: &Record) -> Result<EquationFile, Faults> {
    let parameters = file.effective_parameters();
    let numbers: Vec<Given> = kind
        .parameters
        .iter()
        .filter_map(|it| Some(Given { name: it.name.to_string(), value: parameters.optional(it.name)? }))
        .collect();
    let effects: Vec<equations::Entry> = in_equations(file)
        .map(|it| equations::Entry::new(it.description.kind, it.arguments.subject.as_deref(), &it.arguments.numbers))
        .collect();
    plant_of(kind).file.with(&numbers, &effects, &decided(record))
}

/// The first row of a record, which alone says where it starts.
fn first_row(record: &Record) -> Signals {
    let first = |values: &Vec<f64>| values.iter().take(1).copied().collect::<Vec<f64>>();
    Signals {
        file: record.file.clone(),
        time: first(&record.time),
        period: record.period,
        inputs: record.inputs.iter().map(first).collect(),
        measured: record.measured.iter().map(|it| it.as_ref().map(first)).collect(),
    }
}

/// A machine at its start along a record.
fn started(file: &EquationFile, machine: &mut Machine, initial: &[(&str, f64)], record: &Record) -> Result<Point, Faults> {
    let signals = first_row(record);
    let (given, recorded) = start_of(machine, initial, &signals, record)?;
    let inputs: Vec<f64> = signals.inputs.iter().flatten().copied().collect();
    machine.start_along(file, record.first_time(), &inputs, &given, &recorded)
}

fn start_of(
    machine: &Machine,
    initial: &[(&str, f64)],
    signals: &Signals,
    record: &Record,
) -> Result<(Vec<Given>, Vec<Given>), Faults> {
    if record.rows() == 0 || record.inputs.iter().any(Vec::is_empty) {
        return Err(Faults::one(Fault::whole_file(&record.file, "the record has no rows")));
    }
    let initial: Vec<Given> = initial.iter().map(|(name, value)| Given { name: (*name).to_string(), value: *value }).collect();
    Ok(signals.start_from(&initial, machine))
}

impl Model {
    /// Room and code for a run.
    fn slot(&'static self) -> Slot {
        let free = open(&self.slots).pop();
        free.unwrap_or_else(|| Slot { machine: self.machine.clone(), lanes: Lanes::new(&self.machine) })
    }

    /// Gives a machine the numbers of a plant file. Out: where it starts along a record.
    fn begin(
        &self,
        kind: &'static Described,
        machine: &mut Machine,
        file: &PlantFile,
        record: &Record,
    ) -> Result<Point, Faults> {
        let parameters = file.effective_parameters();
        for nominal in &kind.parameters {
            let value = parameters.optional(nominal.name);
            value.map_or(Ok(()), |value| machine.set(nominal.name, value))?;
        }
        for (place, entry) in in_equations(file).enumerate() {
            for (number, value) in &entry.arguments.numbers {
                if let Some(name) = self.file.parameter_of(place, number) {
                    machine.set(name, *value)?;
                }
            }
        }
        let signals = first_row(record);
        let (given, recorded) = start_of(machine, &file.initial, &signals, record)?;
        let names = [&given, &recorded].map(|list| list.iter().map(|it| it.name.clone()).collect::<Vec<String>>());
        let known = open(&self.starts).get(&names).cloned();
        let starts = match known {
            Some(starts) => starts,
            None => {
                let [given, recorded] = &names;
                let starts = Arc::new(machine.starts(&self.file, given, recorded)?);
                open(&self.starts).entry(names).or_insert(starts).clone()
            }
        };
        let inputs: Vec<f64> = signals.inputs.iter().flatten().copied().collect();
        let values: Vec<f64> = given.iter().chain(&recorded).map(|it| it.value).collect();
        starts.at(machine, record.first_time(), &inputs, &values)
    }
}

/// Every output at every row.
pub type Values = Vec<Vec<f64>>;

/// Plants with the same effects at the same places, and other numbers, along one record, side by side: each has the bits that it has alone. `None` where a plant cannot follow the record.
///
/// # Panics
/// Never: all that stand side by side have one model.
#[must_use]
pub fn together(kind: &'static Described, files: &[PlantFile], record: &Record) -> Vec<Option<Values>> {
    let mut done: Vec<Option<Values>> = vec![None; files.len()];
    let Some(Ok(model)) = files.first().map(|file| plant_of(kind).models.of(kind, file, record)) else { return done };
    let mut slot = model.slot();
    let mut lanes = Vec::with_capacity(files.len());
    for (place, file) in files.iter().enumerate() {
        debug_assert!(plant_of(kind).models.of(kind, file, record).is_ok_and(|it| std::ptr::eq(it, model)));
        if let Ok(start) = model.begin(kind, &mut slot.machine, file, record) {
            lanes.push((place, Lane::new(&slot.machine, start)));
        }
    }
    let (places, lanes): (Vec<usize>, Vec<Lane>) = lanes.into_iter().unzip();
    let inputs = Inputs { time: &record.time, values: &record.inputs };
    for (place, found) in places.into_iter().zip(slot.lanes.run(&lanes, inputs, Setting::default())) {
        done[place] = found.ok();
    }
    open(&model.slots).push(slot);
    done
}

/// A plant of equations, ready for a record.
pub struct Run {
    kind: &'static Described,
    model: &'static Model,
    slot: Option<Slot>,
    start: Option<Point>,
    rows: usize,
}

impl Run {
    /// The plant of a file for a record.
    ///
    /// # Errors
    /// Effects that cannot stand together; a start that has no solution.
    pub fn new(kind: &'static Described, file: &PlantFile, record: &Record) -> Result<Run, Faults> {
        let model = plant_of(kind).models.of(kind, file, record)?;
        let mut slot = model.slot();
        let start = model.begin(kind, &mut slot.machine, file, record);
        let mut run = Run { kind, model, slot: Some(slot), start: None, rows: 0 };
        run.start = Some(start?);
        Ok(run)
    }

    /// The outputs that it gives, in their order.
    #[must_use]
    pub fn outputs(&self) -> &'static [Signal] {
        &self.kind.outputs
    }

    /// Steps of the last run: a count that grows with its rows, not with their difficulty.
    #[must_use]
    pub fn taken(&self) -> usize {
        STEPS_A_ROW * self.rows
    }

    /// Every output at every row.
    ///
    /// # Errors
    /// Why a row could not be reached.
    ///
    /// # Panics
    /// Never: a run has its room until it is dropped.
    pub fn along(&mut self, record: &Record) -> Result<Vec<Vec<f64>>, Stopped> {
        self.rows = record.rows();
        let (slot, start) = self.slot.as_mut().zip(self.start.clone()).expect("room and a start until it is dropped");
        let lane = Lane::new(&slot.machine, start);
        let inputs = Inputs { time: &record.time, values: &record.inputs };
        slot.lanes.run(&[lane], inputs, Setting::default()).remove(0)
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        open(&self.model.slots).extend(self.slot.take());
    }
}
