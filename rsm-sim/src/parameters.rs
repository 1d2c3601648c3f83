//! The nominal parameters of a plant, with the names of [`crate::schema`].

use crate::kind::PlantKind;
use crate::schema;

/// The source of the velocity for the controller of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VelocityFrom {
    /// The state itself.
    State,
    /// The backward difference of the two-sample mean of the position.
    Difference,
}

/// The nominal parameters of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    pub(crate) kind: PlantKind,
    /// In the order of [`schema::parameters`].
    pub(crate) values: Vec<Option<f64>>,
    /// For an axis.
    pub velocity_from: VelocityFrom,
}

impl Parameters {
    /// The value of an optional parameter; `gear_ratios[3]` is the third element of an array.
    #[must_use]
    pub fn optional(&self, name: &str) -> Option<f64> {
        schema::index(self.kind, name).and_then(|index| self.values[index])
    }

    /// The value of a required parameter.
    ///
    /// # Panics
    /// If the plant has no such parameter. This is a fault of the code: names in the code and in the schema must agree.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name).unwrap_or_else(|| panic!("the parameter `{name}` was checked when the file was read"))
    }

    /// Sets a parameter. A name that the plant does not have has no effect.
    pub fn set(&mut self, name: &str, value: f64) {
        if let Some(index) = schema::index(self.kind, name) {
            self.values[index] = Some(value);
        }
    }
}
