//! Effects at the places of a plant: descriptions for plant files, reports and a search, and the arguments of an effect.
//!
//! In: files of effects, described by [`crate::equation_plant`]. Out: [`Description`]s and [`Entry`]s. The laws of effects are in their files.

pub mod declared;

use crate::configurations::{parts, without};
use crate::kind::{OUTPUTS, PlantKind};
use crate::parameters::Parameters;

pub use declared::{Argument, Declared, Plausible, Role, Step, Unit};

/// The kind of name that an effect needs in addition to its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// No name.
    None,
    /// `parameter`: a nominal parameter of the plant.
    Parameter,
    /// `output`: an output of the plant.
    Output,
    /// `at`: a site or an input.
    Site,
}

/// An effect in a plant file.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The effect.
    pub description: &'static Description,
    /// Its arguments.
    pub arguments: Arguments,
}

impl Entry {
    /// The parameter that the effect changes, with its new value; `None` for an effect that changes equations.
    #[must_use]
    pub fn changed_parameter(&self) -> Option<(&str, f64)> {
        let is_value = self.description.subject == Subject::Parameter && self.description.at.is_none();
        // A value of some configurations changes the parameter of their records only.
        let is_common = |it: &&(&'static str, f64)| is_value && parts(it.0).is_none();
        let value = self.arguments.numbers.first().filter(is_common)?.1;
        Some((self.arguments.subject.as_deref()?, value))
    }

    /// The share of a body's inertia that the effect puts behind a joint; 0 for most effects.
    #[must_use]
    pub fn split(&self) -> f64 {
        let is_share = |it: &&(&'static str, f64)| self.description.argument(it.0).is_some_and(|argument| argument.is_share);
        let of = |entry: &Entry| -> f64 { entry.arguments.numbers.iter().filter(is_share).map(|it| it.1).sum() };
        self.variants().iter().map(of).fold(0.0, f64::max)
    }
}

/// The arguments of one effect, as written in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Arguments {
    /// The plant of the effect.
    pub plant: PlantKind,
    /// The named parameter or output, if the effect needs one.
    pub subject: Option<String>,
    /// Numbers by name, in the order of the description.
    pub numbers: Vec<(&'static str, f64)>,
}

impl Arguments {
    /// An optional number.
    #[must_use]
    pub fn optional(&self, name: &str) -> Option<f64> {
        self.numbers.iter().find(|(found, _)| *found == name).map(|(_, value)| *value)
    }

    /// A number that the description requires.
    ///
    /// # Panics
    /// If the number is missing. The reader of plant files refuses such an effect.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name)
            .unwrap_or_else(|| panic!("the effect's required number `{name}` was checked when the file was read"))
    }
}

/// The start points of a search for the numbers of an effect, computed from the scales of the records.
pub struct Guesses(pub(crate) Box<FromFile>);

/// A function that computes guesses from the scales of the records.
pub type FromFile = dyn Fn(&Survey) -> Vec<Guess> + Send + Sync;

impl Guesses {
    /// The start points.
    #[must_use]
    pub fn of(&self, survey: &Survey) -> Vec<Guess> {
        (self.0)(survey)
    }
}

impl std::fmt::Debug for Guesses {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Guesses")
    }
}

/// The magnitudes of the quantities at a place where effects can act, by name: the roles of a site, and the scales that effect files define.
#[derive(Debug, Clone, PartialEq)]
pub struct Scales {
    /// The place.
    pub at: String,
    /// The magnitudes, each with its name.
    pub sizes: Vec<(String, f64)>,
}

/// The description of an effect for plant files, reports and tests.
#[derive(Debug)]
pub struct Description {
    /// The name of the kind in a plant file.
    pub kind: &'static str,
    /// Whether the effect refers to a parameter, an output or a site.
    pub subject: Subject,
    /// The only place where it acts; `None` if a plant file names no place, or if any name of the right kind is permitted.
    pub at: Option<&'static str>,
    /// Its numbers.
    pub arguments: &'static [Argument],
    /// The sentence in the report; `{name}` is replaced by an argument with its unit.
    pub sentence: &'static str,
    /// A sentence: how an engineer can verify the effect by a measurement or an inspection.
    pub check: &'static str,
    /// The start points of a search for its numbers.
    pub guesses: Guesses,
    /// Further data for a search.
    pub declared: Declared,
}

/// The magnitudes of quantities in the records and the nominal plant. They are the scales of the first guesses.
#[derive(Debug, Clone)]
pub struct Survey {
    /// The plant.
    pub plant: PlantKind,
    /// Its nominal parameters.
    pub parameters: Parameters,
    /// Sample period, in s.
    pub period: f64,
    /// Length of the longest record, in s.
    pub duration: f64,
    /// Largest first input (length of the voltage vector; throttle; command).
    pub input: f64,
    /// The largest magnitude of a reading in these records, for each output of the plant.
    pub largest: [f64; OUTPUTS],
    /// The lowest and the highest reading of each output.
    pub ends: [(f64, f64); OUTPUTS],
    /// Spread (standard deviation about the mean) of each output.
    pub spread: [f64; OUTPUTS],
    /// The noise of each output.
    pub noise: [f64; OUTPUTS],
    /// For an axis: periodic forces over the position in the residuals, the strongest first.
    pub waves: Vec<Wave>,
    /// The quantum of each output, if its readings are integer multiples of one.
    pub quantum: [Option<f64>; OUTPUTS],
    /// Parameters that occur in no equation of any record.
    pub unused: Vec<&'static str>,
    /// The index of the named output, for an effect on an output.
    pub output: usize,
    /// The nominal value of the named parameter, for an effect on a parameter.
    pub nominal: f64,
    /// Magnitudes at the places of the plant.
    pub scales: Vec<Scales>,
    /// Parameters with a tolerance of 0 in the plant file. They are exact, so an error of them is not considered.
    pub exact: Vec<&'static str>,
}

/// A force amplitude sin(2 pi q/pitch + phase) over the position of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// In N.
    pub amplitude: f64,
    /// In m.
    pub pitch: f64,
    /// In rad.
    pub phase: f64,
}

/// The numbers of an effect at which a search begins, in the order of [`Description::arguments`]. NaN means that an optional number is absent.
#[derive(Debug, Clone, PartialEq)]
pub struct Guess {
    /// The numbers.
    pub values: Vec<f64>,
    /// The index of the number that scales the effect, and its neutral value. Near the neutral value the effect is proportional to the difference.
    pub neutral: Option<(usize, f64)>,
    /// The index of the number that is a phase. A shift by a quarter of a period gives an independent second effect.
    pub phase: Option<usize>,
}

impl Guess {
    /// A guess for an effect that is scaled by its first number; `without` is the neutral value.
    #[must_use]
    pub fn scaled(values: Vec<f64>, without: f64) -> Self {
        Guess { values, neutral: Some((0, without)), phase: None }
    }

    /// A guess for an effect that is not scaled by a number.
    #[must_use]
    pub fn at(values: Vec<f64>) -> Self {
        Guess { values, neutral: None, phase: None }
    }
}

impl Description {
    /// The number with this name. A number of one configuration, such as `force[loaded]`, is declared as the number itself.
    #[must_use]
    pub fn argument(&self, name: &str) -> Option<&'static Argument> {
        let name = without(name);
        self.arguments.iter().find(|argument| argument.name == name)
    }
}

/// The formula tanh(x/x_s): a smooth sign of x with the width x_s.
#[must_use]
pub fn smooth_sign(x: f64, scale: f64) -> f64 {
    (x / scale).tanh()
}

/// Width of the smooth sign on a rotor, in rad/s (docs/book/src/reference/plants.md, section 3).
pub const ROTOR_SIGN_WIDTH: f64 = 1.0;

/// Width of the smooth sign on an axis, in m/s (docs/book/src/reference/plants.md, section 3).
pub const AXIS_SIGN_WIDTH: f64 = 1e-3;
