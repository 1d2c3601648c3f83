//! Field-oriented current control with a replaceable source of references.
//!
//! In: what a controller is given. Out: references by a [`Weakening`], duties by the [`CurrentLoop`]. The full controller and the one with a
//! response surface differ in the source of references and in nothing else, so a comparison shows the surface and nothing else.

use super::circle_diagram::CircleDiagram;
pub use super::controller::Weakening;
use super::controller::{Controller, Demand, Known, Measured, References};
use super::current_loop::CurrentLoop;

/// A controller: references at 1 kHz, currents at the PWM rate.
#[derive(Debug, Clone)]
pub struct FieldOriented<W> {
    weakening: W,
    currents: CurrentLoop,
    held: References,
}

/// The full controller: the circle diagram solved every millisecond.
pub type FullController = FieldOriented<CircleDiagram>;

impl FullController {
    /// The full controller of a motor.
    #[must_use]
    pub fn full(known: Known) -> Self {
        FieldOriented::new(known, CircleDiagram::new(known))
    }
}

impl<W: Weakening> FieldOriented<W> {
    /// Current control of a motor behind a source of references.
    #[must_use]
    pub fn new(known: Known, weakening: W) -> Self {
        FieldOriented { weakening, currents: CurrentLoop::new(known), held: References::default() }
    }
}

impl<W> FieldOriented<W> {
    /// The source of references.
    pub fn weakening(&mut self) -> &mut W {
        &mut self.weakening
    }

    /// The current control.
    #[must_use]
    pub fn currents(&self) -> &CurrentLoop {
        &self.currents
    }
}

impl<W: Weakening> Controller for FieldOriented<W> {
    fn references(&mut self, demand: &Demand) -> References {
        self.held = self.weakening.references(demand);
        self.held
    }

    fn duties(&mut self, measured: &Measured) -> [f64; 3] {
        self.currents.duties(&self.held, measured)
    }
}
