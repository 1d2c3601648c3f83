//! The properties that an effect declares. A search for effects uses them, so its code contains no effect by name.
//!
//! In: nothing. Out: the numbers of an effect with unit, bounds, plausible range and step; its role; the simpler effects that are special cases of
//! it. Decisions are made elsewhere.

use crate::kind::PlantKind;
use crate::schema::{self, Bound};

use super::Arguments;

/// A number of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Argument {
    /// Its name in the file.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// The permitted values.
    pub bound: Bound,
    /// Whether it may be absent.
    pub optional: bool,
    /// The values that a real machine can have.
    pub plausible: Plausible,
    /// The step of the finite difference for the derivative with respect to the number.
    pub step: Step,
    /// Whether it is a level of friction. The special case of the effect has one such level.
    pub is_level: bool,
    /// Whether it is a share of a body's inertia. The shares of all effects together are below 1.
    pub is_share: bool,
}

impl Argument {
    /// A required number on every plant of the effect, with any plausible value.
    #[must_use]
    pub const fn new(name: &'static str, unit: Unit, bound: Bound) -> Self {
        Argument {
            name,
            unit,
            bound,
            optional: false,
            plausible: Plausible::Any,
            step: Step::Usual,
            is_level: false,
            is_share: false,
        }
    }

    /// The same number, but it may be absent.
    #[must_use]
    pub const fn optional(self) -> Self {
        Argument { optional: true, ..self }
    }

    /// The same number, with a plausible range.
    #[must_use]
    pub const fn plausible(self, plausible: Plausible) -> Self {
        Argument { plausible, ..self }
    }

    /// The same number, with another step.
    #[must_use]
    pub const fn step(self, step: Step) -> Self {
        Argument { step, ..self }
    }
}

/// The unit of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// A fixed unit.
    Is(&'static str),
    /// The unit of the named parameter.
    OfSubject,
}

impl Unit {
    /// The unit as text, on a plant, for a named parameter.
    #[must_use]
    pub fn on(self, plant: PlantKind, subject: Option<&str>) -> String {
        match self {
            Unit::Is(unit) => unit.to_string(),
            Unit::OfSubject => {
                let parameter = subject.and_then(|name| schema::parameters(plant).iter().find(|it| it.name == name));
                parameter.map_or("1", |it| it.unit).to_string()
            }
        }
    }
}

/// The plausible values of a number in a real machine, relative to the magnitudes in its records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Plausible {
    /// Any value.
    Any,
    /// Within the possible error of a plant parameter.
    Parameter,
    /// A factor within the possible relative error of a parameter, or a conversion factor between units.
    FactorOrUnit,
    /// At most this multiple of the largest first guess, with either sign.
    TimesTheGuess(f64),
}

/// The step of the finite difference for the derivative with respect to a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A step determined by the bound and the magnitude of the number.
    Usual,
    /// One per cent of the number: for a number whose neutral value is not 0, such as a gain of 1 or a parameter.
    PerCent,
}

/// The special role of an effect in a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// No special role.
    Ordinary,
    /// Readings are rounded. The simulation has no useful derivative with respect to the rounding step.
    Rounding,
    /// A reading is a multiple of the true value.
    ReadingGain,
    /// A reading follows the true value with a time constant.
    ReadingLag,
    /// A signal is delayed, by rows and fractions of rows.
    Delay,
    /// A periodic effort over the position. If a number is the order (periods per turn of a rotor), it is an integer; otherwise the period is
    /// arbitrary.
    Waves,
}

/// An effect with one number, as a part of a simpler form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// The effect.
    pub kind: &'static str,
    /// The named parameter or output, if the effect needs one.
    pub subject: Option<&'static str>,
    /// Its number.
    pub value: f64,
}

/// Simpler forms of an effect with certain numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Forms {
    /// Special cases of the effect, the simplest first.
    pub special: Vec<Vec<Part>>,
    /// Other effects with the same number of numbers and almost the same behaviour.
    pub alike: Option<Vec<Part>>,
    /// The form of the effect if it is independent of the direction.
    pub level: Option<Level>,
}

/// An effect that is independent of the direction: its special case, and the errors of the plant's own parameters that it then implies.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// The special case.
    pub of: Part,
    /// Errors of parameters.
    pub errors: Vec<Part>,
}

/// The properties that an effect declares in addition to its numbers.
#[derive(Debug)]
pub struct Declared {
    /// Its role.
    pub role: Role,
    /// The effect that is a special case of this one. This effect then always fits at least as well, so a good fit is no evidence for it.
    pub generalises: Option<&'static str>,
    /// Its simpler forms.
    pub forms: FormsOf,
    /// Whether a real machine can have its numbers together.
    pub possible: Possible,
}

/// Whether a real machine can have the numbers of an effect together, as a function of its arguments.
pub struct Possible(pub Option<Box<PossibleFromFile>>);

/// A function that says so.
pub type PossibleFromFile = dyn Fn(&Arguments) -> bool + Send + Sync;

impl Possible {
    /// Whether these numbers are possible together.
    #[must_use]
    pub fn of(&self, arguments: &Arguments) -> bool {
        self.0.as_ref().is_none_or(|of| of(arguments))
    }
}

impl std::fmt::Debug for Possible {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Possible")
    }
}

/// The simpler forms of an effect as a function of its arguments.
pub enum FormsOf {
    /// It has none.
    None,
    /// Computed from the file of the effect, at one place of a plant.
    File(Box<FormsFromFile>),
}

/// A function that computes simpler forms.
pub type FormsFromFile = dyn Fn(&Arguments) -> Forms + Send + Sync;

impl FormsOf {
    /// The simpler forms.
    #[must_use]
    pub fn of(&self, arguments: &Arguments) -> Forms {
        match self {
            FormsOf::None => Forms::default(),
            FormsOf::File(file) => file(arguments),
        }
    }
}

impl std::fmt::Debug for FormsOf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("FormsOf")
    }
}

impl Declared {
    /// The declaration of an effect without a special role.
    pub const NOTHING: Declared =
        Declared { role: Role::Ordinary, generalises: None, forms: FormsOf::None, possible: Possible(None) };
}

#[cfg(test)]
mod tests;
