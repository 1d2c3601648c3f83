//! The cost of a simulation of a plant of equations, compared with the same plant written by hand in Rust ([`crate::by_hand`]).
//!
//! In: the shipped plants as texts, records of [`crate::simulation`]. Out: rows per second with an error that is at most that of the plant in Rust,
//! for one lane and for eight; the time from text to first row. The reference of both errors is the text at a tolerance of 1e-13.

use std::collections::BTreeMap;
use std::time::Instant;

use rsm_core::source::{Fault, Faults, Source};
use rsm_sim::equations::{By, EquationFile, Inputs, Lane, Lanes, Machine, Method, Point, Sensitive, Setting, Signals};
use rsm_sim::record::Record;
use rsm_sim::schema;

use crate::by_hand;
use crate::simulation::Subject;

/// The number of runs; the shortest time is used.
const RUNS: usize = 31;

/// The step of a difference whose time is measured, as a share of the quantity.
const DIFFERENCE: f64 = 1e-4;

/// The step of the central differences that derivatives are compared with, and the tolerance of both. A difference has the errors of two runs,
/// divided by the step: a moved parameter may change the method of a row, so the steps of the runs differ. At this tolerance errors are up to 1e-10
/// of an output, so the step is large; the third derivative then changes a difference by some 1e-5.
const CLOSE_DIFFERENCE: f64 = 1e-3;
const CLOSE: f64 = 1e-12;

/// The size of a value of the start that is 0. The controller of the axis has 39,000 V/m and a limit of 10 V: steps of more than 0.2 mm meet the
/// limit.
const SMALL_START: f64 = 0.1;

/// Lanes that run side by side.
pub const LANES: usize = 8;

/// A shipped plant as a text, with its record.
pub struct Text {
    /// The plant file.
    pub file: EquationFile,
    /// The machine, with the values of its start.
    pub machine: Machine,
    /// The record.
    pub signals: Signals,
    /// The start of a run.
    pub lane: Lane,
    plant: String,
}

/// The shortest time of some runs, in seconds.
pub fn shortest(mut run: impl FnMut()) -> f64 {
    in_turn([&mut run])[0]
}

/// The shortest time of some runs of each, in seconds. Each runs once in every round: a machine that becomes slower for a while changes the times
/// of all, not their ratios.
pub fn in_turn<const N: usize>(mut runs: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut seconds = [f64::INFINITY; N];
    for _ in 0..RUNS {
        for (seconds, run) in seconds.iter_mut().zip(&mut runs) {
            let start = Instant::now();
            run();
            *seconds = seconds.min(start.elapsed().as_secs_f64());
        }
    }
    seconds
}

fn read(plant: &str) -> EquationFile {
    let open = |name: &str| Err(Faults::one(Fault::whole_file(name, "a shipped text stands in the program")));
    EquationFile::read(&Source::new("plant.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

impl Text {
    /// The text of a subject's plant with the values of its plant file.
    ///
    /// # Panics
    /// If it cannot be read: it is part of the project.
    #[must_use]
    pub fn of(subject: &Subject, record: &Record) -> Text {
        let nominal = subject.nominal();
        let numbers: String = schema::parameters(nominal.kind)
            .iter()
            .filter_map(|it| Some(format!("\"{}\" = {:?}\n", it.name, nominal.parameters.optional(it.name)?)))
            .collect();
        let (model, more) = match subject.plant {
            "pmac" => ("pmac", ""),
            "driveline" => ("driveline", "gear = 3\n[initial]\nroad_speed = 15.0\n"),
            _ => ("servo-axis#ServoAxisClosedLoop", "velocity_from_difference = true\n[initial]\nposition = 0.0\n"),
        };
        let plant = format!("format = 2\nmodel = \"rsm:{model}\"\n[parameters]\n{numbers}{more}");
        let file = read(&plant);
        let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
        let names: Vec<String> = machine.inputs().into_iter().map(|it| it.0).collect();
        let mut columns: Vec<(&str, &[f64])> = vec![("time", &record.time)];
        columns.extend(names.iter().zip(&record.inputs).map(|(name, values)| (name.as_str(), values.as_slice())));
        let signals = Signals::in_memory(&file, &machine, &columns).unwrap_or_else(|faults| panic!("{faults}"));
        let start = start_of(&file, &signals, &mut machine);
        let lane = Lane::new(&machine, start);
        Text { file, machine, signals, lane, plant }
    }

    /// The inputs of the record.
    #[must_use]
    pub fn inputs(&self) -> Inputs<'_> {
        Inputs { time: &self.signals.time, values: &self.signals.inputs }
    }

    /// The outputs by name, at a tolerance.
    ///
    /// # Panics
    /// If the run ends early.
    #[must_use]
    pub fn outputs(&self, tolerance: f64) -> Vec<(String, Vec<f64>)> {
        let setting = Setting::new(Method::Automatic, tolerance);
        let found = Lanes::new(&self.machine).run(std::slice::from_ref(&self.lane), self.inputs(), setting).remove(0);
        let found = found.unwrap_or_else(|stopped| panic!("{stopped}"));
        self.machine.outputs().into_iter().map(|it| it.0).zip(found).collect()
    }

    /// A run of this number of lanes.
    ///
    /// # Panics
    /// The run panics if it ends early.
    pub fn run(&self, lanes: usize, tolerance: f64) -> impl FnMut() {
        let setting = Setting::new(Method::Automatic, tolerance);
        let all = vec![self.lane.clone(); lanes];
        let mut code = Lanes::new(&self.machine);
        move || {
            for found in code.run(&all, self.inputs(), setting) {
                found.unwrap_or_else(|stopped| panic!("{stopped}"));
            }
        }
    }

    /// Up to `most` quantities to differentiate by: parameters that change an output, then values of the start.
    ///
    /// # Panics
    /// If a run ends early.
    #[must_use]
    pub fn quantities(&self, most: usize) -> Vec<By> {
        let own = self.outputs(1e-4);
        let setting = Setting::new(Method::Automatic, 1e-4);
        let mut code = Lanes::new(&self.machine);
        let moves = |(name, value): &(String, f64)| {
            let mut machine = self.machine.clone();
            if *value == 0.0 || machine.set(name, value * 1.01).is_err() {
                return false;
            }
            let found = code.run(&[self.lane_of(&mut machine)], self.inputs(), setting).remove(0);
            found.is_ok_and(|found| found.iter().zip(&own).any(|(a, b)| *a != b.1))
        };
        let all = self.machine.parameters().into_iter().map(|it| (it.0, it.2));
        let parameters = all.filter(|it| !it.0.starts_with("record_")).filter(moves).map(|it| By::Parameter(it.0));
        let (given, recorded) = self.signals.start(&self.file, &self.machine);
        parameters.chain((0..given.len() + recorded.len()).map(By::Start)).take(most).collect()
    }

    /// The plant and its record for another solver, as JSON: parameters, states at the start, instants, inputs, and the outputs at a tolerance of
    /// 1e-13.
    ///
    /// # Panics
    /// If it cannot run.
    #[must_use]
    pub fn for_peers(&self, tolerance: f64) -> serde_json::Value {
        let mut machine = self.machine.clone();
        let start = start_of(&self.file, &self.signals, &mut machine);
        let named = |names: Vec<String>, values: &[f64]| -> BTreeMap<String, f64> {
            names.into_iter().zip(values.iter().copied()).collect()
        };
        let columns = |names: Vec<String>, values: &[Vec<f64>]| -> BTreeMap<String, Vec<f64>> {
            names.into_iter().zip(values.iter().cloned()).collect()
        };
        let first_of = |list: Vec<(String, String)>| list.into_iter().map(|it| it.0).collect::<Vec<String>>();
        serde_json::json!({
            "tolerance": tolerance,
            "parameters": machine.parameters().into_iter().map(|it| (it.0, it.2)).collect::<BTreeMap<String, f64>>(),
            "states": named(first_of(machine.states()), &start.states),
            "time": self.signals.time,
            "inputs": columns(first_of(machine.inputs()), &self.signals.inputs),
            "reference": self.outputs(1e-13).into_iter().collect::<BTreeMap<String, Vec<f64>>>(),
        })
    }

    fn lane_of(&self, machine: &mut Machine) -> Lane {
        let start = start_of(&self.file, &self.signals, machine);
        Lane::new(machine, start)
    }

    /// The time of the derivatives with respect to some quantities along the record, in seconds: exact; by differences with one run for each
    /// quantity and one more, separately and in lanes; and, at a smaller tolerance, the largest error against central differences, as a share of a
    /// derivative's magnitude.
    ///
    /// # Panics
    /// If a run ends early.
    #[must_use]
    pub fn sensitivities(&self, by: &[By], tolerance: f64) -> [f64; 4] {
        let mut machine = self.machine.clone();
        let first: Vec<f64> = self.signals.inputs.iter().map(|it| it[0]).collect();
        let (given, recorded) = self.signals.start(&self.file, &machine);
        let known = [&given, &recorded].map(|list| list.iter().map(|it| it.name.clone()).collect::<Vec<String>>());
        let values: Vec<f64> = given.iter().chain(&recorded).map(|it| it.value).collect();
        let starts = machine.starts(&self.file, &known[0], &known[1]).unwrap_or_else(|faults| panic!("{faults}"));
        let of = Sensitive::new(&machine, &starts, self.signals.time[0], &first, &values, by);
        let of = of.unwrap_or_else(|faults| panic!("{faults}"));
        let setting = Setting::new(Method::Automatic, tolerance);
        let mut moved = |share: f64| -> Vec<(Lane, f64)> {
            let lane = |quantity: &By| match quantity {
                By::Parameter(name) => {
                    let value = machine.parameters().iter().find(|it| it.0 == *name).map_or(f64::NAN, |it| it.2);
                    machine.set(name, value + share * value).unwrap_or_else(|faults| panic!("{faults}"));
                    let lane = self.lane_of(&mut machine);
                    machine.set(name, value).unwrap_or_else(|faults| panic!("{faults}"));
                    (lane, share * value)
                }
                By::Start(place) => {
                    let mut moved = values.clone();
                    let step = share * moved[*place].abs().max(SMALL_START);
                    moved[*place] += step;
                    let start = starts.at(&machine, self.signals.time[0], &first, &moved);
                    (Lane::new(&machine, start.unwrap_or_else(|faults| panic!("{faults}"))), step)
                }
            };
            by.iter().map(lane).collect()
        };
        let lanes: Vec<Lane> = [self.lane.clone()].into_iter().chain(moved(DIFFERENCE).into_iter().map(|it| it.0)).collect();
        let (above, below) = (moved(CLOSE_DIFFERENCE), moved(-CLOSE_DIFFERENCE));
        let [mut of_derivatives, mut alone, mut group] = [(); 3].map(|()| Lanes::new(&self.machine));
        let [own, side_by_side, one_by_one] = in_turn([
            &mut || {
                let derivatives = of_derivatives.sensitivities(&of, self.inputs(), setting);
                derivatives.unwrap_or_else(|it| panic!("{it}"));
            },
            &mut || {
                for found in group.run(&lanes, self.inputs(), setting) {
                    found.unwrap_or_else(|it| panic!("{it}"));
                }
            },
            &mut || {
                for lane in &lanes {
                    let found = alone.run(std::slice::from_ref(lane), self.inputs(), setting).remove(0);
                    found.unwrap_or_else(|it| panic!("{it}"));
                }
            },
        ]);
        let close = Setting::new(Method::Automatic, CLOSE);
        let both: Vec<Lane> = above.iter().chain(&below).map(|it| it.0.clone()).collect();
        let found = group.run(&both, self.inputs(), close);
        let found: Vec<Vec<Vec<f64>>> = found.into_iter().map(|it| it.unwrap_or_else(|it| panic!("{it}"))).collect();
        let exact = of_derivatives.sensitivities(&of, self.inputs(), close).unwrap_or_else(|it| panic!("{it}")).derivatives;
        let mut worst = 0.0_f64;
        for (k, (above, below)) in above.iter().zip(&below).enumerate() {
            for (output, derivative) in exact[k].iter().enumerate() {
                let size = derivative.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
                for (row, derivative) in derivative.iter().enumerate().filter(|_| size > 0.0) {
                    let difference = (found[k][output][row] - found[by.len() + k][output][row]) / (above.1 - below.1);
                    worst = worst.max((difference - derivative).abs() / size);
                }
            }
        }
        [own, one_by_one, side_by_side, worst]
    }

    /// The time from the plant file to the first row, in seconds.
    ///
    /// # Panics
    /// If it cannot run.
    #[must_use]
    pub fn first_row(&self) -> f64 {
        shortest(|| {
            let file = read(&self.plant);
            let machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
            let rows = Inputs { time: &self.signals.time[..2], values: self.inputs().values };
            let found = Lanes::new(&machine).run(std::slice::from_ref(&self.lane), rows, Setting::default()).remove(0);
            found.unwrap_or_else(|stopped| panic!("{stopped}"));
        })
    }
}

/// The start of a plant along a record.
fn start_of(file: &EquationFile, signals: &Signals, machine: &mut Machine) -> Point {
    let first: Vec<f64> = signals.inputs.iter().map(|it| it[0]).collect();
    let (given, recorded) = signals.start(file, machine);
    let start = machine.start_along(file, signals.time[0], &first, &given, &recorded);
    start.unwrap_or_else(|faults| panic!("{faults}"))
}

/// The largest difference of any output from a reference, as a share of the output's magnitude.
#[must_use]
pub fn error(found: &[(String, Vec<f64>)], reference: &[(String, Vec<f64>)]) -> f64 {
    let mut worst = 0.0_f64;
    for (name, values) in found {
        let Some((_, wanted)) = reference.iter().find(|it| it.0 == *name) else { continue };
        let size = wanted.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let off = values.iter().zip(wanted).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        worst = worst.max(off / size);
    }
    worst
}

/// The outputs of the plant in Rust.
///
/// # Panics
/// If it cannot run.
#[must_use]
pub fn in_rust(subject: &Subject, record: &Record) -> Vec<(String, Vec<f64>)> {
    let file = subject.nominal();
    file.kind.outputs().iter().map(|it| it.name.to_string()).zip(by_hand::run(&file, record)).collect()
}

/// A run of the plant in Rust.
pub fn run_in_rust<'a>(subject: &Subject, record: &'a Record) -> impl FnMut() + 'a {
    let file = subject.nominal();
    move || {
        std::hint::black_box(by_hand::run(&file, record));
    }
}

/// The largest of some tolerances at which a text is at least as accurate as the plant in Rust; its error at this tolerance, and the error in Rust.
#[must_use]
pub fn comparable(text: &Text, subject: &Subject, record: &Record) -> (f64, f64, f64) {
    let reference = text.outputs(1e-13);
    let rust = error(&in_rust(subject, record), &reference);
    let mut last = (f64::NAN, f64::NAN, rust);
    for digits in 2..12 {
        let tolerance = 10.0_f64.powi(-digits);
        last = (tolerance, error(&text.outputs(tolerance), &reference), rust);
        if last.1 <= rust {
            break;
        }
    }
    last
}
