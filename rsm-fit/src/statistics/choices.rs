//! What a fit chose, for `rsm fit --json`: terms, form, spline, transform.
//!
//! Plain structs with their words. Computes no figure.

use rsm_core::model::{Spline, Transform};
use serde::Serialize;

use crate::observations::ValidationStatistics;
use crate::spec::Form;

/// How the terms were chosen, for `rsm fit --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SelectionReport {
    /// "stepwise", "best-subset" or "lasso".
    pub method: &'static str,
    /// "press", "k-fold", "aicc" or "held-out".
    pub criterion: &'static str,
    /// Whether a term requires the terms with one power less.
    pub heredity: bool,
    /// Whether the smallest model within one standard error of the best was taken.
    pub one_standard_error: bool,
    /// The number of candidates.
    pub candidates: usize,
    /// For best subsets: whether it is proved that no better subset of its size exists. Null for other methods.
    pub proved: Option<bool>,
    /// For the LASSO: the weight of the penalised coefficients, from 0 (least squares on the chosen terms) to 1. Null for other methods.
    pub shrinkage: Option<f64>,
    /// The criterion for each number of terms: the root mean square error on rows left out or held out, that of PRESS, or AICc. For the LASSO the
    /// smallest value of each number.
    pub path: Vec<SizeReport>,
}

/// One size of a path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeReport {
    /// The number of terms.
    pub terms: usize,
    /// The criterion.
    pub criterion: f64,
}

/// The forms of a response, for `rsm fit --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FormsReport {
    /// The tried forms, each with its cross-validation error.
    pub tried: Vec<Tried>,
    /// The accepted form.
    pub chosen: Form,
    /// The reason, in words.
    pub why: String,
}

impl FormsReport {
    /// The accepted form and the reason, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let form = match self.chosen {
            Form::Polynomial => "powers alone",
            Form::Sigmoid => "sigmoids and powers",
            Form::Wave => "waves and powers of the other inputs",
            Form::Spline => "a spline",
            Form::Hinge => "hinges and powers",
        };
        format!("{form}: {}", self.why)
    }
}

/// A spline that is the whole surface, for `rsm fit --json`. Its coefficients are in the model file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SplineReport {
    /// 1 or 3.
    pub degree: u32,
    /// The numbers of cells along each input.
    pub cells: Vec<u32>,
    /// The number of coefficients.
    pub coefficients: usize,
    /// How many free coefficients it is worth with its penalty.
    pub effective: f64,
    /// The penalty of second differences.
    pub penalty: f64,
    /// The number of cells without a row.
    pub empty_cells: usize,
    /// The numbers of cells that were tried, with their errors on rows left out.
    pub tried: Vec<TriedCells>,
}

impl SplineReport {
    /// Kind, size and penalty, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let shape = Spline { degree: self.degree, cells: self.cells.clone(), coefficients: vec![] };
        format!("{}, {} coefficients, second differences penalised by {:e}", shape.words(), self.coefficients, self.penalty)
    }
}

/// Numbers of cells with their error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TriedCells {
    /// The numbers of cells along each input.
    pub cells: Vec<u32>,
    /// The penalty with the smallest error.
    pub penalty: f64,
    /// The root mean square error on rows left out.
    pub rmse: f64,
}

/// A form that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tried {
    /// The form.
    pub form: Form,
    /// The number of its sigmoids.
    pub sigmoids: usize,
    /// The number of its hinges.
    pub hinges: usize,
    /// The orders of its waves.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub orders: Vec<u32>,
    /// The cells of its spline along each input.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cells: Vec<u32>,
    /// The root mean square error of cross-validation; null if it was not computed.
    pub rmse: Option<f64>,
}

/// The transform of a response, for `rsm fit --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TransformReport {
    /// Its name in files; "none" if "box-cox" chose none.
    pub transform: &'static str,
    /// The power lambda of Box and Cox: 0 for the logarithm, 1 for none.
    pub lambda: f64,
    /// The tried transforms; empty if it was given.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<TriedTransform>,
    /// The reason, in words.
    pub why: String,
    /// Errors on fitted rows, in the unit of the response. `None` for "none", and in a merge of parts, which has no rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fitted: Option<ValidationStatistics>,
}

impl TransformReport {
    /// The report of a transform that was given.
    pub(crate) fn given(transform: Transform, fitted: Option<ValidationStatistics>) -> Self {
        let (word, lambda) = (transform.word(), transform.lambda());
        TransformReport { transform: word, lambda, tried: vec![], why: "it was given".to_string(), fitted }
    }

    /// The transform and the reason, in words.
    #[must_use]
    pub fn words(&self) -> String {
        format!("{}: {}", self.transform, self.why)
    }
}

/// A transform that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TriedTransform {
    /// Its name; "none" for the response itself.
    pub transform: &'static str,
    /// Its power lambda.
    pub lambda: f64,
    /// The log likelihood of the measured responses for normal noise, from the errors of rows left out one at a time; null without a surface.
    pub log_likelihood: Option<f64>,
    /// The number of terms.
    pub terms: usize,
}
