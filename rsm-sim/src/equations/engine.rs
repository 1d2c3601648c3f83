//! How a plant of equations runs: the method, the error that is allowed.

/// How time moves on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The series of the solution, until it needs many steps a row; stiff from there on, where that pays.
    Automatic,
    /// The series of the solution, of as many orders as the tolerance asks for.
    Explicit,
    /// Stiff: what is linear is solved exactly, order 3 to 4, with the exact Jacobian; of more than 24 states RODAS3.
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
    /// Steps of a whole run, at most: one that takes more is given up.
    pub steps: u64,
}

impl Setting {
    /// A method and the error of a step, with any number of steps.
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
