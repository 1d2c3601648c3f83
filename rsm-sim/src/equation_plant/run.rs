//! Runs a plant along a record.
//!
//! In: a plant file, a record. Out: every output at every row. The same files give the same bits. Equations with the same effects at the same places
//! are compiled once: a changed parameter value needs no compilation.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rsm_core::source::{Fault, Faults};

use super::{first_format, plant_of};
use crate::configurations::name_in;
use crate::effect::Subject;
use crate::equations::file::{EquationFile, NamedValue, of_rows};
use crate::equations::lanes::Controller;
use crate::equations::used_parameters;
use crate::equations::{self, Inputs, Lane, Lanes, Machine, Method, Point, Setting, Signals, Starts, Stopped, lanes};
use crate::kind::Described;
use crate::kind::PlantKind;
use crate::plant_file::{Entry, PlantFile};
use crate::quantity::Signal;
use crate::record::{Drive, Record};

/// The number of rows of a record at which sizes are evaluated, evenly spread.
pub(super) const ROWS: usize = 400;

/// Whether a record has each output, and the parameters that it sets.
type Given = (Vec<bool>, String);

/// The compiled models of a plant. They have the lifetime of the kind.
#[derive(Default)]
pub(super) struct Models {
    /// The start variables that a record determines, by the set of its outputs and by the parameters that it sets.
    starting: Mutex<HashMap<Given, Vec<usize>>>,
    /// Models, by the values that a record determines, and by the effects and their places.
    built: Mutex<HashMap<String, &'static Model>>,
}

/// Compiled equations with effects.
pub(super) struct Model {
    file: EquationFile,
    pub(super) machine: Machine,
    /// The indices of the parameters that can be set, by name.
    places: HashMap<String, usize>,
    /// Programs of the start, by the names of the given and of the recorded variables.
    starts: Mutex<HashMap<[Vec<String>; 2], Arc<Starts>>>,
    /// Memory and code for runs in parallel threads.
    pub(super) slots: Mutex<Vec<Slot>>,
}

/// The data of one run.
pub(super) struct Slot {
    /// A copy with the parameters of the run.
    pub(super) machine: Machine,
    pub(super) lanes: Lanes<'static>,
}

pub(super) fn open<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Models {
    /// The indices in [`Described::starts`] that apply to a record.
    pub(super) fn starting(&self, kind: &'static Described, record: &Record) -> Vec<usize> {
        let holds: Vec<bool> = record.measured.iter().map(Option::is_some).collect();
        let settings = record_values(record);
        let named = key(record.settings.iter().map(|it| (it.0, it.1)));
        open(&self.starting).entry((holds.clone(), named)).or_insert_with(|| count(kind, &holds, &settings)).clone()
    }

    /// The equations of a plant file for a record.
    pub(super) fn of(&self, file: &PlantFile, record: &Record) -> Result<&'static Model, Faults> {
        let file = &*file.along(record);
        let decides = decided(file, record);
        let mut name = key(decides.iter().map(|it| (it.name.as_str(), it.value)));
        for entry in in_equations(file) {
            let numbers: Vec<&str> = entry.arguments.numbers.iter().map(|it| it.0).collect();
            let at = entry.arguments.subject.as_deref().unwrap_or_default();
            let _ = write!(name, "{}@{at}({});", entry.description.kind, numbers.join(","));
        }
        if let Some(model) = open(&self.built).get(&name) {
            return Ok(model);
        }
        // The lock is not held during compilation. If two threads compile the same model, the first result is used.
        let kind = file.kind.driven_by(record.drive);
        let file = if kind.is_first_format {
            // The numbers of a plant file of format 1 are set later: the code is the same for all of them, in any order of calls.
            plant_of(kind.0).file.with(&[], &placed(file), &decides)?
        } else {
            file_of(kind.0, file, record)?
        };
        let machine = Machine::new(&file)?;
        let places = machine.parameters().into_iter().enumerate().map(|(place, it)| (it.0, place)).collect();
        let model = Model { file, machine, places, starts: Mutex::default(), slots: Mutex::default() };
        Ok(open(&self.built).entry(name).or_insert_with(|| Box::leak(Box::new(model))))
    }
}

/// Names with values, as a key.
fn key<'a>(values: impl Iterator<Item = (&'a str, f64)>) -> String {
    values.fold(String::new(), |mut text, (name, value)| {
        let _ = write!(text, "{name}={:x};", value.to_bits());
        text
    })
}

fn count(kind: &'static Described, holds: &[bool], settings: &[NamedValue]) -> Vec<usize> {
    let place = |name: &str| kind.outputs.iter().position(|it| it.name == name);
    let machine = plant_of(kind).file.with(&[], &[], settings).and_then(|file| Machine::new(&file));
    let Ok(mut machine) = machine else { return Vec::new() };
    let (counts, by_text) = machine.start_by(&|output| holds.get(output) == Some(&true)).unwrap_or_default();
    let is_in = |signal: &Signal| match place(signal.name) {
        Some(output) if counts.contains(&output) => true,
        _ => kind.is_of_start(signal.name) || by_text.iter().any(|it| it == signal.name),
    };
    (0..kind.starts.len()).filter(|k| is_in(&kind.starts[*k])).collect()
}

/// The equations of a plant file without its effects, and the points of a run at some rows of a record, evenly spread.
pub(super) fn without_effects(file: &PlantFile, record: &Record) -> Result<(EquationFile, Machine, Vec<Point>), Faults> {
    let without = PlantFile { effects: Vec::new(), given: Vec::new(), ..file.along(record).into_owned() };
    let (whole, machine, start) = begun(&without, record)?;
    let points = points(&machine, start, record, spread(record));
    Ok((whole, machine, points))
}

/// The equations of a plant file without configurations, and the start along a record.
fn begun(file: &PlantFile, record: &Record) -> Result<(EquationFile, Machine, Point), Faults> {
    let kind = file.kind.driven_by(record.drive).0;
    let whole = file_of(kind, file, record)?;
    let mut machine = Machine::new(&whole)?;
    let start = started(&whole, &mut machine, &initial(kind, file, record), record)?;
    Ok((whole, machine, start))
}

/// The points of a run at every row of a record, at every second one, and so on.
fn points(machine: &Machine, start: Point, record: &Record, every: usize) -> Vec<Point> {
    let inputs = Inputs { time: &record.time, values: &record.inputs };
    lanes::points(machine, start, inputs, Setting::default(), every)
}

/// The distance of a few hundred rows that are evenly spread over a record.
pub(super) fn spread(record: &Record) -> usize {
    (record.rows() / ROWS).max(1)
}

/// The equations of a plant file without its effects, and the points of a run with its effects at every row of a record, at every second one, and so
/// on: time, states and inputs of the equations without effects.
pub(super) fn with_effects(
    file: &PlantFile,
    record: &Record,
    every: usize,
) -> Result<(EquationFile, Machine, Vec<Point>), Faults> {
    let file = &*file.along(record);
    let without = PlantFile { effects: Vec::new(), given: Vec::new(), ..file.clone() };
    let (plain, plain_machine, start) = begun(&without, record)?;
    let (_, machine, begin) = begun(file, record)?;
    let points = points(&machine, begin, record, every);
    let states = machine.states();
    let places: Vec<Option<usize>> =
        plain_machine.states().iter().map(|it| states.iter().position(|other| other.0 == it.0)).collect();
    let of = |point: &Point| {
        let mut found = start.clone();
        found.time = point.time;
        for (value, place) in found.states.iter_mut().zip(&places) {
            *value = place.map_or(*value, |place| point.states[place]);
        }
        let count = found.inputs.len();
        found.inputs.copy_from_slice(&point.inputs[..count]);
        found
    };
    let points = points.iter().map(of).collect();
    Ok((plain, plain_machine, points))
}

/// The largest magnitude of each start variable of a kind along a record.
pub(super) fn largest(kind: &'static Described, file: &PlantFile, record: &Record) -> Result<Vec<f64>, Faults> {
    let (_, machine, points) = without_effects(file, record)?;
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

/// The parameters of a plant that occur in no equation of any of these records, such as the ratio of a gear that none of them uses, or a parameter of
/// another configuration.
#[must_use]
pub fn unused(file: &PlantFile, records: &[&Record]) -> Vec<&'static str> {
    let without = PlantFile { effects: Vec::new(), given: Vec::new(), ..file.clone() };
    let mut unused: Vec<&'static str> = file.kind.parameters.iter().map(|it| it.name).collect();
    for record in records {
        // A record that the plant cannot follow shows nothing.
        let Ok(model) = models(&without, record).of(&without, record) else { return Vec::new() };
        let used = used_parameters(model.machine.system().flat());
        let configurations = &file.kind.configurations;
        let name_there = |name: &str| match record.configuration {
            Some(place) if configurations.has_own(place, name) => name_in(name, &configurations.list[place].name),
            _ => name.to_string(),
        };
        let used: Vec<String> = used.iter().map(|name| name_there(name)).collect();
        unused.retain(|name| !used.iter().any(|it| it == name));
    }
    unused
}

/// The effects that change equations. A changed parameter value does not.
fn in_equations(file: &PlantFile) -> impl Iterator<Item = &Entry> {
    file.acting().filter(|it| it.description.subject != Subject::Parameter || it.description.at.is_some())
}

/// Parameters that a record determines.
fn record_values(record: &Record) -> Vec<NamedValue> {
    let given = |(name, value): &(&str, f64)| NamedValue { name: (*name).to_string(), value: *value };
    record.settings.iter().map(given).chain(of_rows(record.period, record.first_time())).collect()
}

/// Values that determine the structure of the equations of a plant file along a record. Names that the text does not have are not used.
fn decided(file: &PlantFile, record: &Record) -> Vec<NamedValue> {
    let mut values = record_values(record);
    if file.kind.is_first_format {
        values.extend(first_format::switches(&file.parameters));
    }
    values
}

/// The equations of a plant file for a record, with its effects and parameters.
fn file_of(kind: &'static Described, file: &PlantFile, record: &Record) -> Result<EquationFile, Faults> {
    let parameters = file.effective_parameters();
    let numbers: Vec<NamedValue> = kind
        .parameters
        .iter()
        .filter_map(|it| Some((it.name, parameters.optional(it.name)?)))
        .chain(at_start(kind, file))
        .map(|(name, value)| NamedValue { name: name.to_string(), value })
        .collect();
    plant_of(kind).file.with(&numbers, &placed(file), &decided(file, record))
}

/// The effects that change equations, in the form that the equations need.
fn placed(file: &PlantFile) -> Vec<equations::Entry> {
    let one = |it: &Entry| equations::Entry::new(it.description.kind, it.arguments.subject.as_deref(), &it.arguments.numbers);
    in_equations(file).map(one).collect()
}

/// The compiled models of a plant file for a record.
pub(super) fn models(file: &PlantFile, record: &Record) -> &'static Models {
    &plant_of(file.kind.driven_by(record.drive).0).models
}

/// The instants of a record's rows. If a controller acts, they are multiples of the period, as for the controller: jitter of less than a hundredth of
/// the period has no effect, and a gap that has not been cut out counts as one row.
pub(super) fn instants(record: &Record) -> Cow<'_, [f64]> {
    if record.drive != Drive::Closed {
        return Cow::Borrowed(&record.time);
    }
    let begin = record.first_time();
    Cow::Owned((0..record.rows()).map(|row| begin + row as f64 * record.period).collect())
}

/// The first row of a record. Only this row determines the start.
fn first_row(inputs: &[Vec<f64>], record: &Record) -> Signals {
    let first = |values: &Vec<f64>| values.iter().take(1).copied().collect::<Vec<f64>>();
    Signals {
        file: record.file.clone(),
        time: first(&record.time),
        period: record.period,
        inputs: inputs.iter().map(first).collect(),
        measured: record.measured.iter().map(|it| it.as_ref().map(first)).collect(),
    }
}

/// A machine at its start along a record.
fn started(file: &EquationFile, machine: &mut Machine, initial: &[NamedValue], record: &Record) -> Result<Point, Faults> {
    let signals = first_row(&record.inputs, record);
    let (given, recorded) = start_of(machine, initial, &signals)?;
    let inputs: Vec<f64> = signals.inputs.iter().flatten().copied().collect();
    machine.start_along(file, record.first_time(), &inputs, &given, &recorded)
}

/// The parameters on which only the start depends, as the plant file gives them.
fn at_start(kind: &'static Described, file: &PlantFile) -> Vec<(&'static str, f64)> {
    let own = kind.starts.iter().zip(&kind.start_values).filter(|it| kind.is_of_start(it.0.name));
    own.map(|(it, by_text)| (it.name, file.initial.iter().find(|own| own.0 == it.name).map_or(*by_text, |own| own.1))).collect()
}

/// The known start values: those of the plant file, then those of the record for variables that are no outputs. A variable that the record
/// determines by another rule is left out. In format 1, an output that does not determine the start may have a value too, which is not used.
fn initial(kind: &'static Described, file: &PlantFile, record: &Record) -> Vec<NamedValue> {
    let absent = record.absent(file.kind);
    let counts = |name: &str| !kind.is_first_format || kind.starts.iter().any(|it| it.name == name);
    let own = file.initial.iter().filter(|it| !absent.contains(&it.0) && !kind.is_of_start(it.0) && counts(it.0));
    let further = record.starts.iter().filter(|it| !file.initial.iter().any(|own| own.0 == it.0));
    own.chain(further).map(|(name, value)| NamedValue { name: (*name).to_string(), value: *value }).collect()
}

fn start_of(
    machine: &Machine,
    initial: &[NamedValue],
    signals: &Signals,
) -> Result<(Vec<NamedValue>, Vec<NamedValue>), Faults> {
    if signals.time.is_empty() || signals.inputs.iter().any(Vec::is_empty) {
        return Err(Faults::one(Fault::whole_file(&signals.file, "the record has no rows")));
    }
    Ok(signals.start_from(initial, machine))
}

impl Model {
    /// Memory and code for a run.
    pub(super) fn slot(&'static self) -> Slot {
        let free = open(&self.slots).pop();
        free.unwrap_or_else(|| Slot { machine: self.machine.clone(), lanes: Lanes::new(&self.machine) })
    }

    /// The index of a parameter.
    fn place(&self, name: &str) -> Result<usize, Faults> {
        self.places.get(name).copied().map_or_else(|| self.machine.place_of(name), Ok)
    }

    /// Gives a machine the parameters of a plant file. Returns its start along a record.
    pub(super) fn begin(&self, machine: &mut Machine, file: &PlantFile, record: &Record) -> Result<Point, Faults> {
        let file = &*file.along(record);
        let parameters = file.effective_parameters();
        let kind = file.kind.driven_by(record.drive).0;
        let own = kind.parameters.iter().filter_map(|it| Some((it.name, parameters.optional(it.name)?)));
        let mut values = Vec::with_capacity(kind.parameters.len());
        for (name, value) in own.chain(at_start(kind, file)) {
            values.push((self.place(name)?, value));
        }
        let initial = initial(kind, file, record);
        for (place, entry) in in_equations(file).enumerate() {
            for (number, value) in &entry.arguments.numbers {
                if let Some(name) = self.file.parameter_of(place, number) {
                    values.push((self.place(name)?, *value));
                }
            }
        }
        machine.set_at(&values)?;
        let signals = first_row(&record.inputs, record);
        let (given, recorded) = start_of(machine, &initial, &signals)?;
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

/// The settings of a run with a limit on its work per row, on average over its record.
pub(super) fn setting(record: &Record, method: Method, tolerance: f64, work_a_row: usize) -> Setting {
    let work = u64::try_from(work_a_row.saturating_mul(record.rows())).unwrap_or(u64::MAX);
    Setting { method, tolerance, work }
}

/// Runs plants of one kind side by side along one record. They must have the same effects at the same places; their numbers may differ. Each result
/// has the same bits as in a run alone. Returns, for each plant, every output of the kind at every row, or `None` if the plant cannot follow the
/// record or needs more than `work_a_row`; and the total work. `tolerance` is that of [`Setting`].
///
/// # Panics
/// Never: plants that run side by side have one model.
#[must_use]
pub fn together(files: &[PlantFile], record: &Record, tolerance: f64, work_a_row: usize) -> (Vec<Option<Values>>, u64) {
    let mut done: Vec<Option<Values>> = vec![None; files.len()];
    let Some(Group { model, mut slot, places, lanes }) = Group::of(files, record) else { return (done, 0) };
    let setting = setting(record, Setting::default().method, tolerance, work_a_row);
    let time = instants(record);
    let inputs = Inputs { time: &time, values: &record.inputs };
    for (place, found) in places.into_iter().zip(slot.lanes.run(&lanes, inputs, setting)) {
        done[place] = found.ok();
    }
    let work = slot.lanes.work().iter().sum();
    open(&model.slots).push(slot);
    (done, work)
}

/// Plants with the same effects at the same places, at their start along one record.
pub(super) struct Group {
    pub(super) model: &'static Model,
    pub(super) slot: Slot,
    /// The index of each lane in the list of plants. A plant whose start has no solution has no lane.
    pub(super) places: Vec<usize>,
    pub(super) lanes: Vec<Lane>,
}

impl Group {
    pub(super) fn of(files: &[PlantFile], record: &Record) -> Option<Group> {
        let first = files.first()?;
        let model = models(first, record).of(first, record).ok()?;
        let mut slot = model.slot();
        let mut lanes = Vec::with_capacity(files.len());
        for (place, file) in files.iter().enumerate() {
            debug_assert!(models(file, record).of(file, record).is_ok_and(|it| std::ptr::eq(it, model)));
            if let Ok(start) = model.begin(&mut slot.machine, file, record) {
                lanes.push((place, Lane::new(&slot.machine, start)));
            }
        }
        let (places, lanes) = lanes.into_iter().unzip();
        Some(Group { model, slot, places, lanes })
    }
}

/// The outputs of a run along a record, in the order of the plant.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_sim::{plant_file::PlantFile, record::Record, simulate::shown};
///
/// let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\nviscous_friction = 0.0\ncommand_limit = 10.0\n";
/// let plant = PlantFile::read(&Source::new("axis.toml", axis))?;
/// let record = Record::in_memory(&plant, &[("time", &[0.0, 0.5]), ("command", &[1.0, 1.0]), ("position", &[0.0, 0.0])])?;
/// // The command of an axis is an output of its controller, and this record has none.
/// assert_eq!(shown(plant.kind, &record).len(), 1);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn shown(kind: PlantKind, record: &Record) -> Vec<Signal> {
    let absent = record.absent(kind);
    kind.driven_by(record.drive).outputs().iter().filter(|it| !absent.contains(&it.name)).copied().collect()
}

/// A plant that is prepared for a record.
pub struct Run {
    kind: PlantKind,
    model: &'static Model,
    slot: Option<Slot>,
    start: Option<Point>,
    /// The integration method.
    pub(crate) method: Method,
    /// The permitted error of a step, as in [`Setting`].
    pub(crate) tolerance: f64,
    /// The largest work per row, on average over the record.
    pub(crate) work_a_row: usize,
}

impl Run {
    /// The plant of a file for a record.
    ///
    /// # Errors
    /// Effects that cannot be combined; a start without a solution.
    pub fn new(file: &PlantFile, record: &Record) -> Result<Run, Faults> {
        let model = models(file, record).of(file, record)?;
        let mut slot = model.slot();
        let start = model.begin(&mut slot.machine, file, record);
        let Setting { method, tolerance, .. } = Setting::default();
        let mut run = Run { kind: file.kind, model, slot: Some(slot), start: None, method, tolerance, work_a_row: usize::MAX };
        run.start = Some(start?);
        Ok(run)
    }

    /// The outputs that it computes for a record, in order.
    #[must_use]
    pub fn outputs(&self, record: &Record) -> Vec<Signal> {
        shown(self.kind, record)
    }

    /// The work of the last run, in the unit of [`Setting::work`], also if it was stopped early.
    #[must_use]
    pub fn work(&self) -> u64 {
        self.slot.iter().flat_map(|it| it.lanes.work()).sum()
    }

    /// Computes the outputs of [`Run::outputs`] at every row. A controller, if there is one, sets the first input row by row.
    ///
    /// # Errors
    /// The reason why a row could not be reached.
    ///
    /// # Panics
    /// Never: a run has its slot until it is dropped.
    pub fn along(&mut self, record: &Record, controller: Option<&mut Controller<'_>>) -> Result<Values, Stopped> {
        let shown = self.outputs(record);
        let (slot, start) = self.slot.as_mut().zip(self.start.clone()).expect("room and a start until it is dropped");
        let lane = Lane::new(&slot.machine, start);
        let time = instants(record);
        let inputs = Inputs { time: &time, values: &record.inputs };
        let setting = setting(record, self.method, self.tolerance, self.work_a_row);
        let mut found = match controller {
            Some(_) if matches!(self.method, Method::Fixed { .. }) => {
                return Err(Stopped::Step(
                    "found a fixed step with a controller in the loop, expected another method".to_string(),
                ));
            }
            Some(controller) => slot.lanes.controlled(&lane, inputs, setting, controller)?,
            // The code of the lanes has the parameters of the model; a fixed step has those of its machine.
            None if matches!(self.method, Method::Fixed { .. }) => {
                Lanes::new(&slot.machine).run(&[lane], inputs, setting).remove(0)?
            }
            None => slot.lanes.run(&[lane], inputs, setting).remove(0)?,
        };
        let computed =
            self.kind.driven_by(record.drive).outputs().iter().zip(&mut found).filter(|(signal, _)| shown.contains(signal));
        Ok(computed.map(|(_, values)| std::mem::take(values)).collect())
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        open(&self.model.slots).extend(self.slot.take());
    }
}
