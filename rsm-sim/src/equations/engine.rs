//! Settings of a run of a plant of equations: the method and the permitted error.

/// The integration method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The series of the solution, until it needs many steps in a row; from then on the stiff method, if it costs less.
    Automatic,
    /// The series of the solution, with as many orders as the tolerance needs.
    Explicit,
    /// For stiff plants: the linear part is solved exactly, with order 3 to 4 and the exact Jacobian. With more than 24 states: RODAS3.
    Stiff,
    /// The classical Runge-Kutta method with steps of constant length. The time between two rows is an integer multiple of this length. The error is
    /// not estimated, and events are not located in time.
    Fixed {
        /// The step length in s.
        step: f64,
    },
}

/// The settings of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// The integration method.
    pub method: Method,
    /// The permitted error of a step, relative to the largest magnitude that a state has had, or to its change in one row.
    pub tolerance: f64,
    /// The largest number of steps of a whole run. A run that needs more is stopped.
    pub steps: u64,
}

impl Setting {
    /// A method and the permitted error of a step, with no limit on the number of steps.
    #[must_use]
    pub const fn new(method: Method, tolerance: f64) -> Setting {
        Setting { method, tolerance, steps: u64::MAX }
    }
}

impl Default for Setting {
    fn default() -> Self {
        Setting::new(Method::Automatic, 1e-8)
    }
}
