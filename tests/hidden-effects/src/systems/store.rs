//! Tanks and heat capacities with the effects that are possible on them.
//!
//! In: numbers of effects. Out: the additional flow. Formulas: docs/book/src/reference/plants.md, section 4.5.

use super::{Site, Truth};

/// A tank or a heat capacity.
#[derive(Debug, Clone)]
pub struct Store {
    conductance: f64,
    rest: f64,
    rim: f64,
    radiation: f64,
    surroundings: f64,
}

impl Store {
    /// The store at a site.
    pub fn new(truth: &Truth, site: &Site) -> Self {
        let or = |kind: &str, number: &str, absent: f64| truth.or(site.name, kind, number, absent);
        Store {
            conductance: or("leak", "conductance", 0.0),
            rest: or("leak", "rest", 0.0),
            rim: or("overflow", "level_limit", f64::INFINITY),
            radiation: or("radiation", "coefficient", 0.0),
            surroundings: or("radiation", "ambient", 0.0),
        }
    }

    /// The inflow in addition to that of the equations.
    pub fn flow(&self, content: f64, capacity: f64) -> f64 {
        let leak = self.conductance * (content - self.rest);
        // A time constant of 10 ms.
        let over = capacity * (content - self.rim).max(0.0) / 0.01;
        let radiated = self.radiation * (content.powi(4) - self.surroundings.powi(4));
        -leak - over - radiated
    }
}
