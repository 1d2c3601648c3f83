//! Settings of a run of a plant of equations: the method and the permitted error.

/// The integration method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The series of the solution, or the stiff method where that needs less work.
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
    /// The largest work of a whole run; a run that needs more is stopped. The unit is a step with a linear part that exists: of the order of 0.1 us.
    /// A new linear part or a step of the series counts 8, and a row by one step of the series counts 4.
    pub work: u64,
}

impl Setting {
    /// The work of a step of the series.
    pub const SERIES: u64 = super::choice::SERIES;

    /// A method and the permitted error of a step, with no limit on the work.
    #[must_use]
    pub const fn new(method: Method, tolerance: f64) -> Setting {
        Setting { method, tolerance, work: u64::MAX }
    }
}

impl Default for Setting {
    fn default() -> Self {
        Setting::new(Method::Automatic, 1e-8)
    }
}
