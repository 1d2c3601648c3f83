//! The kinds of plants and their signals (docs/book/src/reference/plants.md 1.2).
//!
//! In: the text of a plant, read by [`crate::equation_plant`]. Out: names and units of inputs and outputs, the same for files, records and
//! simulation.

use std::any::Any;
use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use crate::configurations::{Configurations, name_in};
use crate::quantity::Nominal;
pub use crate::quantity::Signal;

/// What drives the plant in a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// The input of a plant whose controller does not act.
    Open,
    /// The controller of the plant, which follows the reference.
    Closed,
    /// The inputs of a plant without a controller. The record contains all of them, except those that it may leave out.
    Inputs,
}

/// The kind of a plant: its data, which all its records and files share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlantKind(pub(crate) &'static Described);

impl std::ops::Deref for PlantKind {
    type Target = Described;

    fn deref(&self) -> &Described {
        self.0
    }
}

/// The data of a plant of equations for files, records and reports. It has the lifetime of the program: a program reads few plants, and all its parts
/// refer to them.
pub struct Described {
    /// The name of its model; for a plant file of format 1, the name in the file.
    pub name: &'static str,
    /// The name of its model in the text.
    pub model: &'static str,
    /// Whether its plant files have format 1.
    pub is_first_format: bool,
    /// The inputs, in the order of the text.
    pub inputs: Vec<Signal>,
    /// The outputs, in the order of the text.
    pub outputs: Vec<Signal>,
    /// Variables that can determine the start of a record, in the order of [`StartValues`]: outputs that follow from states, then parameters on which
    /// only the start depends, then states that are not outputs.
    pub starts: Vec<Signal>,
    /// Their start values from the text alone.
    pub start_values: Vec<f64>,
    /// States whose start no reading of an output determines: the text gives it.
    pub free_starts: Vec<Signal>,
    /// The same plant without its controller, for records that have its input in place of that of the controller.
    pub open_loop: Option<PlantKind>,
    /// The parameters on which only the start depends, with their typical sizes (`nominal` in the text).
    pub start_sizes: Vec<(&'static str, f64)>,
    /// The parameters that may be set.
    pub parameters: Vec<Nominal>,
    /// Parameters that a record determines.
    pub decisions: Vec<Decision>,
    /// The values of the parameters in the plant file, in the order of `parameters`.
    pub values: Vec<f64>,
    /// The text of the plant file.
    pub text: String,
    /// The files that the plant file names, with their texts.
    pub files: Vec<(String, String)>,
    /// The configurations of the plant file.
    pub configurations: Configurations,
    /// The last of `parameters` are those that some configurations have in place of a common one: for each the index of the common parameter, and
    /// that of the configuration.
    pub own: Vec<(usize, usize)>,
    /// The same plant without configurations, which simulates each record; `None` if the plant file has no configurations.
    pub common: Option<PlantKind>,
    /// The equations, in a type that only the module that runs them uses.
    pub equations: &'static (dyn Any + Send + Sync),
}

/// A parameter that a record determines.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// The parameter.
    pub parameter: &'static str,
    /// The column that gives it, with the name of the signal in the plant. The column is constant in a record. `None` if the absence of columns
    /// determines the parameter.
    pub column: Option<&'static str>,
    /// The parameter is 1 if all of these are absent, else 0. Absent inputs are 0.
    pub without: Vec<&'static str>,
    /// The smallest and the largest value, if the text gives both.
    pub range: Option<[f64; 2]>,
    /// Whether the value is a whole number.
    pub is_whole: bool,
}

impl Decision {
    /// Whether the parameter can have a value.
    #[must_use]
    pub fn holds(&self, value: f64) -> bool {
        (!self.is_whole || value.fract() == 0.0) && self.range.is_none_or(|[low, high]| (low..=high).contains(&value))
    }

    /// The possible values in words, after "expected ".
    #[must_use]
    pub fn words(&self) -> String {
        let number = if self.is_whole { "a whole number" } else { "a number" };
        self.range.map_or_else(|| number.to_string(), |[low, high]| format!("{number} from {low} to {high}"))
    }
}

impl Described {
    /// The states for which a record may have a column. Its first value is the start. A speed that was recorded beside the position of a controlled
    /// plant is no exact start.
    #[must_use]
    pub fn start_columns(&self) -> &[Signal] {
        if self.open_loop.is_some() { &[] } else { &self.free_starts }
    }

    /// The name of a number of an effect in a configuration. Each name is stored once.
    #[must_use]
    pub fn number_in(&self, number: &'static str, configuration: &str) -> &'static str {
        static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
        let name = name_in(number, configuration);
        let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = names.get(name.as_str()) {
            return known;
        }
        let name: &'static str = Box::leak(name.into_boxed_str());
        names.insert(name);
        name
    }

    /// Whether a name is that of a parameter on which only the start depends.
    #[must_use]
    pub fn is_of_start(&self, name: &str) -> bool {
        self.start_sizes.iter().any(|it| it.0 == name)
    }
}

impl PartialEq for Described {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

impl Eq for Described {}

impl std::fmt::Debug for Described {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Described({})", self.name)
    }
}

/// The largest number of outputs that a diagnosis compares.
pub const OUTPUTS: usize = 12;

/// A value for each output: separate values for the first outputs, and one value for all others.
#[must_use]
pub fn by_output<T: Copy>(first: &[T], further: T) -> [T; OUTPUTS] {
    std::array::from_fn(|output| first.get(output).copied().unwrap_or(further))
}

/// The largest number of variables that determine a start: outputs, and states that are not outputs.
pub const STARTS: usize = 24;

/// A start of a simulation: a value for each of [`PlantKind::starts`], and 0 for unused entries.
pub type StartValues = [f64; STARTS];

impl PlantKind {
    /// Whether it is the kind of format 1 with this name.
    #[must_use]
    pub fn is(self, name: &str) -> bool {
        self.is_first_format && self.name == name
    }

    /// The name in a file.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.0.name
    }

    /// The names of the configurations of the plant file.
    #[must_use]
    pub fn configuration_names(self) -> Vec<&'static str> {
        self.0.configurations.names().collect()
    }

    /// The kind that simulates a record that this drives: the kind itself, or the plant without its controller.
    #[must_use]
    pub fn driven_by(self, drive: Drive) -> PlantKind {
        self.0.open_loop.filter(|_| drive == Drive::Open).unwrap_or(self)
    }

    /// The inputs of its equations, in the order of the text.
    #[must_use]
    pub fn inputs(self) -> &'static [Signal] {
        &self.0.inputs
    }

    /// The outputs, in the order of the simulation. The command of an axis is an output only in closed loop.
    #[must_use]
    pub fn outputs(self) -> &'static [Signal] {
        &self.0.outputs
    }

    /// The variables that determine a start, in the order of a simulation's start: outputs, and variables without a column. For an axis this is the
    /// speed. For a car these are the differences of the engine's torque, of the driveshaft's twist and of its rate from those of a car that rolls
    /// steadily with its throttle.
    #[must_use]
    pub fn starts(self) -> &'static [Signal] {
        &self.0.starts
    }

    /// The index of an output in [`PlantKind::outputs`].
    #[must_use]
    pub fn output(self, name: &str) -> Option<usize> {
        self.outputs().iter().position(|signal| signal.name == name)
    }

    /// Every column that a record of this plant can have.
    #[must_use]
    pub fn columns(self) -> Vec<Signal> {
        let mut columns = vec![Signal { name: "time", unit: "s" }];
        let without_controller = self.open_loop.map_or(&[][..], PlantKind::inputs);
        for signal in without_controller.iter().chain(self.inputs()).chain(self.outputs()).chain(self.start_columns()) {
            if !columns.contains(signal) {
                columns.push(*signal);
            }
        }
        // A column that determines a parameter is a number without a unit. In format 1 every column states its unit.
        let unit = if self.is_first_format { "1" } else { "" };
        let decides = self.0.decisions.iter().filter_map(|it| it.column).map(|name| Signal { name, unit });
        columns.extend(decides.filter(|it| !it.name.is_empty()));
        columns
    }
}
