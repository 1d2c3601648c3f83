//! A response of a specification: its surface, and how it is fitted.
//!
//! Plain data with their names in a specification; read by [`super::read`] and `shape.rs`.

use rsm_core::model::{Surface, Transform};

use super::{Constraint, Method, SupportSpec};

/// A response of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseSpec {
    /// The column of the data.
    pub column: String,
    /// Its unit; `None` for that of the data's header.
    pub unit: Option<String>,
    /// Name, inputs, coding, symmetry, knots, sigmoids, waves, reciprocal and output range; without terms, and with the unit if it is given.
    pub surface: Surface,
    /// How the terms are chosen.
    pub method: Method,
    /// The weights of the rows; `None` if all count equally.
    pub weights: Option<Weights>,
    /// The loss that the coefficients minimise.
    pub loss: Loss,
    /// The order of autoregressive errors; `None` if errors are independent.
    pub noise: Option<NoiseOrder>,
    /// The constraints, over its whole supported region.
    pub constraints: Vec<Constraint>,
    /// Whether the model contains the region supported by the data.
    pub support: Option<SupportSpec>,
    /// The allowed forms; `None`: powers, and sigmoids if they are clearly better.
    pub forms: Option<Vec<Form>>,
    /// The spline that is the whole surface; `None` for terms.
    pub spline: Option<SplineSpec>,
    /// The transform of the response that the terms describe; `None`: the response itself.
    pub transform: Option<TransformSpec>,
}

/// The transform of a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransformSpec {
    /// This one.
    Given(Transform),
    /// The one with the largest likelihood, or none (Box, Cox 1964).
    BoxCox,
}

impl TransformSpec {
    /// The name of [`TransformSpec::BoxCox`] in a specification.
    pub const BOX_COX: &str = "box-cox";
}

/// A form of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// Powers of the inputs, and of the variables in the specification.
    Polynomial,
    /// Also sigmoids, with centres chosen by the data.
    Sigmoid,
    /// Cosines and sines of a periodic input, with orders chosen by the data.
    Wave,
    /// A tensor spline over all inputs, in place of terms.
    Spline,
    /// Also hinges, with places chosen by the data.
    Hinge,
}

/// A spline as the whole surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SplineSpec {
    /// 1, a table with linear interpolation, or 3.
    pub degree: u32,
    /// The numbers of cells along each input; `None`: chosen by cross-validation.
    pub cells: Option<Vec<u32>>,
    /// The penalty of second differences; `None`: chosen by cross-validation.
    pub penalty: Option<f64>,
}

impl Default for SplineSpec {
    fn default() -> Self {
        SplineSpec { degree: 3, cells: None, penalty: None }
    }
}

/// The loss that coefficients minimise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Loss {
    /// The sum of squared errors.
    #[default]
    LeastSquares,
    /// Huber's: squares up to 1.345 scales, then lines.
    Huber,
    /// The sum of absolute errors.
    L1,
}

impl Loss {
    /// The name in a specification.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Loss::LeastSquares => "least-squares",
            Loss::Huber => "huber",
            Loss::L1 => "l1",
        }
    }
}

/// The order of autoregressive errors: the number of rows before on which an error depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseOrder {
    /// This order.
    Given(usize),
    /// The order with the smallest AICc, from 0 to this one.
    UpTo(usize),
}

impl NoiseOrder {
    /// The default of a specification: errors of a slow sensor or of a control loop have order 1 or 2.
    pub const DEFAULT: NoiseOrder = NoiseOrder::UpTo(4);

    /// The largest order: each one takes several fits of all rows.
    pub const MOST: usize = 12;
}

/// A column of the data with the weights of the rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Weights {
    /// The weight itself, proportional to 1/sigma^2 of the row.
    Weight(String),
    /// The standard error sigma of the row's response, in any unit or none: only ratios matter.
    StandardError(String),
}

impl Weights {
    /// The column.
    #[must_use]
    pub fn column(&self) -> &str {
        match self {
            Weights::Weight(column) | Weights::StandardError(column) => column,
        }
    }
}
