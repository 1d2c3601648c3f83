//! A true plant: its kind, its parameters, its effects, and its simulation along a record.
//!
//! In: numbers with the names of docs/book/src/reference/plants.md. Out: columns of a record without noise. It reads no file.

use crate::axis::Axis;
use crate::car::Car;
use crate::motor::Motor;

/// The three plants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `pmac`
    Motor,
    /// `driveline`
    Car,
    /// `servo-axis` with a command as its input
    OpenAxis,
    /// `servo-axis` with a reference as its input
    ClosedAxis,
}

impl Kind {
    /// The name in a plant file.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Motor => "pmac",
            Kind::Car => "driveline",
            Kind::OpenAxis | Kind::ClosedAxis => "servo-axis",
        }
    }

    /// Columns of inputs, with units.
    pub fn inputs(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Kind::Motor => &[("v_d", "V"), ("v_q", "V"), ("load_torque", "N*m")],
            Kind::Car => &[("throttle", "1"), ("gear", "1")],
            Kind::OpenAxis => &[("command", "V")],
            Kind::ClosedAxis => &[("reference", "m")],
        }
    }

    /// Columns of outputs, with units.
    pub fn outputs(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Kind::Motor => &[("i_d", "A"), ("i_q", "A"), ("speed", "rad/s")],
            Kind::Car => &[("engine_speed", "rad/s"), ("road_speed", "m/s"), ("acceleration", "m/s^2")],
            Kind::OpenAxis => &[("position", "m")],
            Kind::ClosedAxis => &[("position", "m"), ("command", "V")],
        }
    }
}

/// Parameters by name, and the five gear ratios.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// In the order of the file.
    pub values: Vec<(&'static str, f64)>,
    /// For a driveline, else empty.
    pub gear_ratios: Vec<f64>,
    /// For a closed loop: the controller differentiates the position.
    pub velocity_from_difference: bool,
}

impl Parameters {
    /// The value of a parameter; `gear_ratios[3]` is the ratio of third gear.
    ///
    /// # Panics
    /// For a name that the plant does not have: names are used only in this package.
    pub fn get(&self, name: &str) -> f64 {
        if let Some(gear) = gear(name) {
            return self.gear_ratios[gear - 1];
        }
        self.values.iter().find(|(known, _)| *known == name).unwrap_or_else(|| panic!("no parameter {name}")).1
    }

    /// Sets a parameter.
    ///
    /// # Panics
    /// Like `get`.
    pub fn set(&mut self, name: &str, value: f64) {
        if let Some(gear) = gear(name) {
            self.gear_ratios[gear - 1] = value;
            return;
        }
        self.values.iter_mut().find(|(known, _)| *known == name).unwrap_or_else(|| panic!("no parameter {name}")).1 = value;
    }
}

/// The gear, if a name is that of a gear ratio.
fn gear(name: &str) -> Option<usize> {
    name.strip_prefix("gear_ratios[")?.strip_suffix(']')?.parse().ok()
}

/// An effect, from the catalogue or outside it.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// Its name in docs/book/src/reference/plants.md, or a name of this package.
    pub kind: &'static str,
    /// `parameter` or `output`, and its name.
    pub which: Option<(&'static str, &'static str)>,
    /// Its parameters.
    pub values: Vec<(&'static str, f64)>,
}

impl Effect {
    /// An effect without a parameter or output.
    pub fn new(kind: &'static str, values: &[(&'static str, f64)]) -> Self {
        Effect { kind, which: None, values: values.to_vec() }
    }

    /// An effect of a sensor.
    pub fn on(kind: &'static str, output: &'static str, values: &[(&'static str, f64)]) -> Self {
        Effect { kind, which: Some(("output", output)), values: values.to_vec() }
    }
}

/// A true plant.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The kind of plant.
    pub kind: Kind,
    /// True values; they already include a `parameter-error`.
    pub parameters: Parameters,
    /// Effects of the catalogue.
    pub effects: Vec<Effect>,
    /// Effects outside the catalogue.
    pub outside: Vec<Effect>,
}

impl Truth {
    /// A parameter of an effect, if the plant has that effect.
    pub fn effect(&self, kind: &str, name: &str) -> Option<f64> {
        let effect = self.effects.iter().chain(&self.outside).find(|effect| effect.kind == kind)?;
        effect.values.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
    }

    /// The same, or the value that does not change a formula if the effect is absent.
    pub fn or(&self, kind: &str, name: &str, absent: f64) -> f64 {
        self.effect(kind, name).unwrap_or(absent)
    }

    /// The time constants of lags on the outputs, in their order.
    pub fn lags(&self) -> Vec<Option<f64>> {
        let of = |output: &str| {
            let found =
                self.effects.iter().find(|effect| effect.kind == "sensor-lag" && effect.which == Some(("output", output)));
            found.map(|effect| effect.values[0].1)
        };
        self.kind.outputs().iter().map(|(output, _)| of(output)).collect()
    }
}

/// The start of a plant: the true outputs, before any sensor.
#[derive(Debug, Clone, Copy)]
pub enum Start {
    /// At rest, without current.
    Rest,
    /// At a road speed, as in docs/book/src/reference/plants.md 2.2, with the first throttle.
    Rolling(f64),
}

/// A plant that is advanced from row to row.
pub trait Plant {
    /// Sets inputs that are constant from now on.
    fn hold(&mut self, inputs: &[f64]);
    /// Advances by a period.
    fn advance(&mut self, period: f64);
    /// The current outputs, after lags but before the other sensor effects.
    fn outputs(&self) -> Vec<f64>;
}

/// A record.
#[derive(Debug, Clone)]
pub struct Record {
    /// Seconds between rows.
    pub period: f64,
    /// One column for each input.
    pub inputs: Vec<Vec<f64>>,
    /// One column for each output, without noise.
    pub outputs: Vec<Vec<f64>>,
}

/// Simulates a true plant. `drive` computes the inputs of a row from the last outputs, like a controller or a driver. In closed loop it gets the
/// outputs without the command, which follows from the input.
pub fn run(truth: &Truth, start: Start, period: f64, rows: usize, drive: &mut dyn FnMut(usize, &[f64]) -> Vec<f64>) -> Record {
    let first = drive(0, &vec![0.0; truth.kind.outputs().len()]);
    let mut plant: Box<dyn Plant> = match truth.kind {
        Kind::Motor => Box::new(Motor::new(truth, period)),
        Kind::Car => Box::new(Car::new(truth, start, &first, period)),
        Kind::OpenAxis | Kind::ClosedAxis => Box::new(Axis::new(truth, period)),
    };
    let mut record =
        Record { period, inputs: vec![vec![]; truth.kind.inputs().len()], outputs: vec![vec![]; truth.kind.outputs().len()] };
    let late = truth.effects.iter().find(|effect| effect.kind == "sensor-delay").map(|effect| late(truth, effect, period));
    let mut on_the_way = vec![];
    for row in 0..rows {
        let inputs = if row == 0 { first.clone() } else { drive(row, &sensed(truth, &plant.outputs(), row as f64 * period)) };
        plant.hold(&inputs);
        record.inputs.iter_mut().zip(&inputs).for_each(|(column, value)| column.push(*value));
        let outputs = sensed(truth, &plant.outputs(), row as f64 * period);
        record.outputs.iter_mut().zip(outputs).for_each(|(column, value)| column.push(value));
        match &late {
            // A reading that is delayed by whole rows and a rest of a period was taken this rest before the end of a period.
            Some(it) if it.rest > 0.0 => {
                plant.advance(period - it.rest);
                on_the_way.push(plant.outputs()[it.output]);
                plant.advance(it.rest);
            }
            _ => plant.advance(period),
        }
    }
    if let Some(it) = late {
        let column = &mut record.outputs[it.output];
        let first = column[0];
        let taken = if it.rest > 0.0 { on_the_way } else { column.clone() };
        let rows_late = it.rows + usize::from(it.rest > 0.0);
        column
            .iter_mut()
            .enumerate()
            .for_each(|(row, value)| *value = row.checked_sub(rows_late).map_or(first, |at| taken[at]));
    }
    record
}

/// A delayed sensor.
struct Late {
    output: usize,
    rows: usize,
    /// The rest in seconds.
    rest: f64,
}

fn late(truth: &Truth, effect: &Effect, period: f64) -> Late {
    // A delayed input would change its value within this time.
    assert!(truth.effect("input-delay", "delay").is_none(), "an input and a sensor that are both late are not built");
    let output = truth.kind.outputs().iter().position(|(name, _)| effect.which == Some(("output", name))).expect("an output");
    let delay = effect.values[0].1;
    let rows = (delay / period + 1e-9).floor();
    let rest = delay - rows * period;
    Late { output, rows: rows as usize, rest: if rest > 1e-9 * period { rest } else { 0.0 } }
}

/// The effects of sensors without memory on outputs, in the order of the list. Rounding comes later, after the noise.
fn sensed(truth: &Truth, outputs: &[f64], time: f64) -> Vec<f64> {
    let mut read = outputs.to_vec();
    for effect in truth.effects.iter().chain(&truth.outside) {
        let Some(("output", output)) = effect.which else { continue };
        let Some(index) = truth.kind.outputs().iter().position(|(name, _)| *name == output) else { continue };
        let value = effect.values[0].1;
        read[index] = match effect.kind {
            "sensor-gain" => value * read[index],
            "sensor-bias" => read[index] + value,
            "sensor-drift" => read[index] + value * time,
            // A scale with a periodic error: y = x + a sin(2 pi x/p), of an interpolated encoder.
            "scale-error" => read[index] + value * (std::f64::consts::TAU * read[index] / effect.values[1].1).sin(),
            _ => read[index],
        };
    }
    read
}

/// Rounds the readings of a coarse sensor to multiples of its step.
pub fn quantise(truth: &Truth, record: &mut Record) {
    for effect in truth.effects.iter().filter(|effect| effect.kind == "sensor-quantisation") {
        let output = effect.which.map(|(_, output)| output);
        let index = truth.kind.outputs().iter().position(|(name, _)| Some(*name) == output).expect("an output of this plant");
        let step = effect.values[0].1;
        record.outputs[index].iter_mut().for_each(|value| *value = step * (*value / step).round());
    }
}

/// The first input, delayed by `delay` seconds: its values in the two parts of a period.
#[derive(Debug, Clone)]
pub struct Delay {
    /// Whole periods.
    whole: usize,
    /// The rest, in seconds.
    rest: f64,
    history: Vec<Vec<f64>>,
}

impl Delay {
    /// A delay in seconds, for a sampling period.
    pub fn new(delay: f64, period: f64) -> Self {
        // A delay of 3 periods as a decimal must not become 2.9999: a billionth of a period is rounding.
        let whole = (delay / period + 1e-9).floor();
        Delay { whole: whole as usize, rest: (delay - whole * period).max(0.0), history: vec![] }
    }

    /// Sets a new value.
    pub fn push(&mut self, value: Vec<f64>) {
        self.history.push(value);
    }

    /// The parts of the period that begins now: length and value.
    pub fn parts(&self, period: f64) -> Vec<(f64, Vec<f64>)> {
        // Before the record the input had its first value.
        let ago = |rows: usize| self.history[(self.history.len() - 1).saturating_sub(rows)].clone();
        if self.rest > 1e-9 * period {
            vec![(self.rest, ago(self.whole + 1)), (period - self.rest, ago(self.whole))]
        } else {
            vec![(period, ago(self.whole))]
        }
    }
}
