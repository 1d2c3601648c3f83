//! Points with their responses, errors on rows, and named values: the data of a fit's figures.
//!
//! In: columns of values. Out: plain structs. Independent of models and terms.

use std::collections::BTreeMap;

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use crate::dd::Dd;
use crate::design::Physical;

/// Named values in their own order, serialised as a map.
#[derive(Debug, Clone, PartialEq)]
pub struct Named<T>(pub Vec<(String, T)>);

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, value) in &self.0 {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

/// Errors on rows that were not used for the coefficients, of the model as written, including its saturation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ValidationStatistics {
    /// The number of rows.
    pub rows: usize,
    /// The mean absolute error.
    pub mean_abs_error: f64,
    /// The largest absolute error.
    pub max_abs_error: f64,
    /// The root mean square error.
    pub rmse: f64,
    /// C of (14), (15).
    pub confidence_c: Option<f64>,
}

/// Points with their responses.
#[derive(Debug, Clone, Copy)]
pub struct Observations<'a> {
    /// The values of every input of the surface.
    pub inputs: &'a [&'a [f64]],
    /// The response.
    pub response: &'a [f64],
    /// The weight of each row, with a mean of 1; empty if all rows count equally.
    pub weights: &'a [f64],
}

impl Observations<'_> {
    /// The weight of a row.
    #[must_use]
    pub fn weight(&self, row: usize) -> Dd {
        self.weights.get(row).map_or(Dd::ONE, |weight| Dd::from(*weight))
    }

    /// The sum of the weights of some rows.
    #[must_use]
    pub(crate) fn weight_of(&self, rows: &[usize]) -> Dd {
        rows.iter().map(|row| self.weight(*row)).sum()
    }

    /// The sum of squares of the response about a value.
    pub(crate) fn square_about(&self, value: Dd) -> Dd {
        let deviation = |row: usize| Dd::from(self.response[row]) - value;
        (0..self.response.len()).map(|row| self.weight(row) * deviation(row) * deviation(row)).sum()
    }

    /// The point of a row.
    #[must_use]
    pub fn point(&self, row: usize) -> Vec<Physical> {
        self.inputs.iter().map(|column| Physical(column[row])).collect()
    }

    /// Rows with identical settings of all inputs, group by group, in the order of their first rows.
    #[must_use]
    pub fn replicates(&self) -> Vec<Vec<usize>> {
        let mut group_of: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for row in 0..self.response.len() {
            // + 0.0 makes both zeros equal.
            let key = self.inputs.iter().map(|column| (column[row] + 0.0).to_bits()).collect();
            let group = *group_of.entry(key).or_insert(groups.len());
            if group == groups.len() {
                groups.push(Vec::new());
            }
            groups[group].push(row);
        }
        groups
    }

    /// The weighted mean response of some rows.
    #[must_use]
    pub fn mean(&self, rows: &[usize]) -> Dd {
        let sum: Dd = rows.iter().map(|row| self.weight(*row) * Dd::from(self.response[*row])).sum();
        sum / self.weight_of(rows)
    }
}
