//! Rows of numbers in memory, in the types that programs use.
//!
//! In: slices, arrays, vectors, nalgebra matrices, or columns with names. Out: [`Inputs`] and [`Responses`]: named columns. Each row is one
//! observation, as in a CSV: `&[[f64; 2]]` holds points of two inputs. Numbers are not checked here.

use nalgebra::{Dim, Matrix, RawStorage};

use super::{Input, Response};
use crate::plan::{Plan, PlanFactor};

/// The columns of the inputs. Created by `into()` from:
///
/// | holds | one row is |
/// |---|---|
/// | `&[[f64; N]]`, `&[[f64; N]; M]`, `&Vec<[f64; N]>` | a point of N inputs |
/// | `&[Vec<f64>]`, `&Vec<Vec<f64>>` | a point; all of one length |
/// | `&[f64]`, `&[f64; M]`, `&Vec<f64>` | a value of the only input |
/// | `&nalgebra::Matrix` | a row of the matrix: a point, a column an input |
/// | `&`[`Plan`] | a run |
/// | [`Input`], `[Input; N]`, `Vec<Input>` | as the columns say |
///
/// Columns without a name are named `x1`, `x2`, ...
#[derive(Debug, Clone)]
pub struct Inputs {
    pub(super) columns: Vec<Input>,
    pub(super) ragged: Option<Ragged>,
}

/// The columns of the responses. Created from the same types as [`Inputs`], with [`Response`] in place of `Input`. Columns without a name are named
/// `y`, or `y1`, `y2`, ... if there are several.
#[derive(Debug, Clone)]
pub struct Responses {
    pub(super) columns: Vec<Response>,
    pub(super) ragged: Option<Ragged>,
}

/// A row whose number of values differs from that of the first row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ragged {
    /// Its number, from 1.
    pub row: usize,
    pub found: usize,
    pub expected: usize,
}

/// The columns of rows with a length known to the compiler.
fn of_points<const N: usize>(points: &[[f64; N]]) -> Vec<Vec<f64>> {
    (0..N).map(|k| points.iter().map(|point| point[k]).collect()).collect()
}

fn of_rows(rows: &[Vec<f64>]) -> (Vec<Vec<f64>>, Option<Ragged>) {
    let expected = rows.first().map_or(0, Vec::len);
    if let Some(k) = rows.iter().position(|row| row.len() != expected) {
        return (Vec::new(), Some(Ragged { row: k + 1, found: rows[k].len(), expected }));
    }
    ((0..expected).map(|k| rows.iter().map(|row| row[k]).collect()).collect(), None)
}

fn of_matrix<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(matrix: &Matrix<f64, R, C, S>) -> Vec<Vec<f64>> {
    matrix.column_iter().map(|column| column.iter().copied().collect()).collect()
}

/// The conversions that inputs and responses share.
macro_rules! columns {
    ($all:ident, $one:ident) => {
        impl $all {
            fn unnamed(columns: Vec<Vec<f64>>) -> Self {
                $all { columns: columns.into_iter().map($one::unnamed).collect(), ragged: None }
            }
        }

        impl From<$one> for $all {
            fn from(column: $one) -> Self {
                $all { columns: vec![column], ragged: None }
            }
        }

        impl<const N: usize> From<[$one; N]> for $all {
            fn from(columns: [$one; N]) -> Self {
                $all { columns: columns.into(), ragged: None }
            }
        }

        impl From<Vec<$one>> for $all {
            fn from(columns: Vec<$one>) -> Self {
                $all { columns, ragged: None }
            }
        }

        impl From<&[f64]> for $all {
            fn from(values: &[f64]) -> Self {
                $all::unnamed(vec![values.to_vec()])
            }
        }

        impl<const M: usize> From<&[f64; M]> for $all {
            fn from(values: &[f64; M]) -> Self {
                $all::from(values.as_slice())
            }
        }

        impl From<&Vec<f64>> for $all {
            fn from(values: &Vec<f64>) -> Self {
                $all::from(values.as_slice())
            }
        }

        impl<const N: usize> From<&[[f64; N]]> for $all {
            fn from(points: &[[f64; N]]) -> Self {
                $all::unnamed(of_points(points))
            }
        }

        impl<const N: usize, const M: usize> From<&[[f64; N]; M]> for $all {
            fn from(points: &[[f64; N]; M]) -> Self {
                $all::from(points.as_slice())
            }
        }

        impl<const N: usize> From<&Vec<[f64; N]>> for $all {
            fn from(points: &Vec<[f64; N]>) -> Self {
                $all::from(points.as_slice())
            }
        }

        impl From<&[Vec<f64>]> for $all {
            fn from(rows: &[Vec<f64>]) -> Self {
                let (columns, ragged) = of_rows(rows);
                $all { ragged, ..$all::unnamed(columns) }
            }
        }

        impl From<&Vec<Vec<f64>>> for $all {
            fn from(rows: &Vec<Vec<f64>>) -> Self {
                $all::from(rows.as_slice())
            }
        }

        impl<R: Dim, C: Dim, S: RawStorage<f64, R, C>> From<&Matrix<f64, R, C, S>> for $all {
            fn from(matrix: &Matrix<f64, R, C, S>) -> Self {
                $all::unnamed(of_matrix(matrix))
            }
        }
    };
}

/// The settings of a plan, with the names and units of its factors.
///
/// ```
/// use rsm_fit::Fit;
/// use rsm_fit::plan::{Experiment, Factor};
///
/// let plan = Experiment::full_factorial([Factor::at("speed", "m/s", [0.0, 10.0, 20.0])]).replicates(2).plan()?;
/// let measured: Vec<f64> = plan.factors[0].values.iter().map(|speed| 5.0 + 2.0 * speed).collect();
/// assert_eq!(Fit::new(&plan, &measured).order(1).fit()?.model.inputs[0].unit, "m/s");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
impl From<&Plan> for Inputs {
    fn from(plan: &Plan) -> Self {
        let of_factor = |factor: &PlanFactor| Input::new(factor.name.clone(), &factor.values).unit(factor.unit.clone());
        Inputs { columns: plan.factors.iter().map(of_factor).collect(), ragged: None }
    }
}

columns!(Inputs, Input);
columns!(Responses, Response);
