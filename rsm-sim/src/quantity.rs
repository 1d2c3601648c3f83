//! Quantities: names, units and the permitted values of a number.
//!
//! In: nothing. Out: types that kinds of plants, files and effects share. This file contains no values.

/// A named quantity with its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signal {
    /// Its name in a record.
    pub name: &'static str,
    /// Its unit inside the code.
    pub unit: &'static str,
}

/// The permitted values of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bound {
    /// Any finite number.
    Any,
    /// Above zero.
    Positive,
    /// Zero or above.
    NotNegative,
    /// Between two numbers, both excluded.
    Between(f64, f64),
    /// An integer of at least one.
    Count,
}

impl Bound {
    /// Whether a finite number is within the bound.
    #[must_use]
    pub fn holds(self, value: f64) -> bool {
        match self {
            Self::Any => true,
            Self::Positive => value > 0.0,
            Self::NotNegative => value >= 0.0,
            Self::Between(low, high) => value > low && value < high,
            Self::Count => value >= 1.0 && value.fract() == 0.0,
        }
    }

    /// The bound in words, after "expected ".
    #[must_use]
    pub fn words(self) -> String {
        match self {
            Self::Any => "a finite number".to_string(),
            Self::Positive => "a number above 0".to_string(),
            Self::NotNegative => "a number of at least 0".to_string(),
            Self::Between(low, high) => format!("a number between {low} and {high}, both excluded"),
            Self::Count => "a whole number of at least 1".to_string(),
        }
    }
}

/// A nominal parameter that is a single number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nominal {
    /// Its name in the file.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The physical bound.
    pub bound: Bound,
    /// Whether it may be omitted.
    pub optional: bool,
}
