//! What an effect declares of itself, so that nobody who searches for effects needs to know its name.
//!
//! In: nothing. Out: the numbers of an effect with unit, bounds, plausible range and step; its role; the plainer effects that it holds. Never decides anything.

use crate::kind::PlantKind;
use crate::schema::{self, Bound};

use super::Arguments;

/// The steepest public roads climb by 35 to 38 %; in rad.
pub const STEEPEST_ROAD: f64 = 0.36;

/// A number that an effect takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Argument {
    /// Its name in the file.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// Which values it may have.
    pub bound: Bound,
    /// May be left out.
    pub optional: bool,
    /// Only on this plant; `None` on all on which the effect can stand.
    pub on: Option<PlantKind>,
    /// Which values a real machine may have.
    pub plausible: Plausible,
    /// The step at which a derivative with respect to it is taken.
    pub step: Step,
    /// Whether it is a level of friction: the special case of the effect has one of them.
    pub is_level: bool,
}

impl Argument {
    /// A required number on every plant of the effect, with any plausible value.
    #[must_use]
    pub const fn new(name: &'static str, unit: Unit, bound: Bound) -> Self {
        Argument { name, unit, bound, optional: false, on: None, plausible: Plausible::Any, step: Step::Usual, is_level: false }
    }

    /// The same, on one plant only.
    #[must_use]
    pub const fn on(self, plant: PlantKind) -> Self {
        Argument { on: Some(plant), ..self }
    }

    /// The same, but it may be left out.
    #[must_use]
    pub const fn optional(self) -> Self {
        Argument { optional: true, ..self }
    }

    /// The same, with a plausible range.
    #[must_use]
    pub const fn plausible(self, plausible: Plausible) -> Self {
        Argument { plausible, ..self }
    }

    /// The same, with another step.
    #[must_use]
    pub const fn step(self, step: Step) -> Self {
        Argument { step, ..self }
    }

    /// The same, a level of friction.
    #[must_use]
    pub const fn level(self) -> Self {
        Argument { is_level: true, ..self }
    }
}

/// The unit of a number; what depends on the plant is that of its first body, a rotor or a carriage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// This one.
    Is(&'static str),
    /// That of the named parameter or output.
    OfSubject,
    /// That of the named output, per second.
    OfSubjectPerSecond,
    /// Torque or force.
    Effort,
    /// Torque or force per speed.
    EffortPerSpeed,
    /// Torque or force per way.
    Stiffness,
    /// Angular or linear speed.
    Speed,
    /// Angle in a driveline, way elsewhere.
    Gap,
}

impl Unit {
    /// The unit in words, on a plant, for a named parameter or output.
    #[must_use]
    pub fn on(self, plant: PlantKind, subject: Option<&str>) -> String {
        let rotor = plant == PlantKind::Pmac;
        let by_body = |of_rotor: &str, of_carriage: &str| if rotor { of_rotor } else { of_carriage }.to_string();
        let of_subject = || {
            let name = subject.unwrap_or_default();
            let output = plant.output(name).map(|k| plant.outputs()[k].unit);
            output.or_else(|| schema::named(plant).find(|it| it.name == name).map(|it| it.unit)).unwrap_or("1")
        };
        match self {
            Unit::Is(unit) => unit.to_string(),
            Unit::OfSubject => of_subject().to_string(),
            Unit::OfSubjectPerSecond => format!("{}/s", of_subject()),
            Unit::Effort => by_body("N*m", "N"),
            Unit::EffortPerSpeed => by_body("N*m*s/rad", "N*s/m"),
            Unit::Stiffness => by_body("N*m/rad", "N/m"),
            Unit::Speed => by_body("rad/s", "m/s"),
            Unit::Gap => if plant == PlantKind::Driveline { "rad" } else { "m" }.to_string(),
        }
    }
}

/// Which values of a number a real machine may have, by the sizes that its records show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Plausible {
    /// Any.
    Any,
    /// As far from 0 as this, either way.
    Within(f64),
    /// As a parameter of the plant may be wrong.
    Parameter,
    /// A factor as a parameter may be wrong by.
    Factor,
    /// The same, or a factor between units.
    FactorOrUnit,
    /// Of the size of the drive's effort, either way.
    Effort,
    /// Of that size, not negative.
    EffortOneWay,
    /// Of that size in the time of a record.
    EffortPerRecord,
    /// Of that size at the square of the usual speed.
    EffortPerSpeedSquared,
    /// Of the size of the named output's readings.
    Reading,
    /// Of that size in the time of a record.
    ReadingPerRecord,
    /// A share of the time of a record.
    ShareOfRecord,
    /// Of the size of the usual speed.
    Speed,
    /// Of the size of the first input.
    Input,
    /// So many times the largest first guess, either way.
    TimesTheGuess(f64),
}

/// The step at which a derivative with respect to a number is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// As its bound and its size say.
    Usual,
    /// Its own size.
    OwnSize,
    /// A per cent of it: near a value in proportion to which nothing is, a gain of 1 or a parameter.
    PerCent,
}

/// What sets an effect apart for a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Nothing.
    Ordinary,
    /// Readings are rounded: a simulation has no derivative along its step.
    Rounding,
    /// A reading is a multiple of the truth.
    ReadingGain,
    /// A reading follows the truth with a time constant.
    ReadingLag,
    /// Something comes late by whole rows and parts of them.
    Delay,
    /// Waves of effort over the position: an order of a rotor where a number counts them, else of any length.
    Waves,
}

/// An effect with its one number, as a part of a plainer form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Which effect.
    pub kind: &'static str,
    /// The named parameter or output, if it takes one.
    pub subject: Option<&'static str>,
    /// Its number.
    pub value: f64,
}

impl Part {
    /// An effect without a subject.
    #[must_use]
    pub const fn new(kind: &'static str, value: f64) -> Self {
        Part { kind, subject: None, value }
    }
}

/// Plainer forms of an effect with certain numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Forms {
    /// Special cases that it holds, the simplest first.
    pub special: Vec<Vec<Part>>,
    /// Other effects with as many numbers that do nearly the same.
    pub alike: Option<Vec<Part>>,
    /// What it is when it does not differ with the direction.
    pub level: Option<Level>,
}

/// An effect that does not differ with the direction: its special case, and what else it then says of the plant's own parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// The special case.
    pub of: Part,
    /// Errors of parameters.
    pub errors: Vec<Part>,
}

/// What an effect declares beside its numbers.
#[derive(Debug)]
pub struct Declared {
    /// Its role.
    pub role: Role,
    /// The effect that it holds as its special case: it then always fits as well, and that says nothing.
    pub generalises: Option<&'static str>,
    /// Its plainer forms.
    pub forms: fn(&Arguments) -> Forms,
}

impl Declared {
    /// Of an effect that nothing sets apart.
    pub const NOTHING: Declared = Declared { role: Role::Ordinary, generalises: None, forms: |_| Forms::default() };

    /// Of an effect with a role.
    #[must_use]
    pub const fn role(role: Role) -> Self {
        Declared { role, ..Declared::NOTHING }
    }
}

#[cfg(test)]
mod tests;
