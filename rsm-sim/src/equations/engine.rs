//! Runs a plant of equations along its inputs.
//!
//! In: a machine at its start, the inputs at every row. Out: the outputs at every row. Inputs hold from row to row. A step is as long as its estimated error allows; where a comparison changes inside a step, the instant
//! is located and the step ends there, and what the text wants to happen then happens. The same machine and inputs give the same bits.

use super::lanes::Lanes;
use super::machine::{Machine, Point};
use super::rows::{Inputs, Stopped};
use super::walk::Lane;

/// How time moves on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The series of the solution, until it needs many steps a row; stiff from there on.
    Automatic,
    /// The series of the solution, of as many orders as the tolerance asks for.
    Explicit,
    /// Stiff, orders 3 and 2, with the exact Jacobian.
    Stiff,
    /// The classical Runge-Kutta method with steps of one length, a whole share of the time between two rows. Its error is not estimated, and nothing is located in time.
    Fixed {
        /// The length of a step in s.
        step: f64,
    },
}

/// How a plant runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// How time moves on.
    pub method: Method,
    /// The error of a step, relative to the largest value that a state has had, or changes by in one row.
    pub tolerance: f64,
}

impl Default for Setting {
    fn default() -> Self {
        Setting { method: Method::Automatic, tolerance: 1e-8 }
    }
}

/// Runs a machine from its start along inputs. By output: its value at every row.
///
/// # Errors
/// Why a row could not be reached.
///
/// # Panics
/// When an input has fewer rows than the time.
pub fn run(machine: &Machine, start: Point, inputs: Inputs<'_>, setting: Setting) -> Result<Vec<Vec<f64>>, Stopped> {
    let lane = Lane::new(machine, start);
    Lanes::new(machine).run(&[lane], inputs, setting).remove(0)
}
