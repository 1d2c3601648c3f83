//! Points with their responses, errors on rows, and named values: the data of a fit's figures.
//!
//! In: columns of values. Out: plain structs, and for each row a value or a check of a given design.

use std::ops::Range;

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use crate::dd::Dd;
use crate::dd::lanes::{self, LANES, Lanes};
use crate::design::eight::{Eight, Seen, eight};
use crate::design::{Design, Physical};
use crate::points::{self, Groups};
use crate::threads;

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
        if self.weights.is_empty() {
            return (0..self.response.len()).map(|row| deviation(row) * deviation(row)).sum();
        }
        (0..self.response.len()).map(|row| self.weight(row) * deviation(row) * deviation(row)).sum()
    }

    /// The number of rows with an input outside of its range.
    pub(crate) fn rows_outside(&self, design: &Design) -> usize {
        // Most files have no such row.
        if design.holds_all(self.inputs) {
            return 0;
        }
        let is_outside = |row: &usize| design.has_outside(self.inputs.iter().map(|column| column[*row]));
        (0..self.response.len()).filter(is_outside).count()
    }

    /// Whether in some row some term is not finite.
    pub(crate) fn has_infinite_term(&self, design: &Design, seen: Seen) -> bool {
        let mut found = false;
        let of_range = |range: Range<usize>| {
            let mut terms = Eight::new(design);
            range.step_by(LANES).any(|first| !lanes::are_finite(terms.rows(self.inputs, first, seen)))
        };
        threads::over_rows(self.response.len(), of_range, |is_found| found |= is_found);
        found
    }

    /// The value of a surface at each row.
    pub(crate) fn values(&self, design: &Design, coefficients: &[Dd], seen: Seen) -> Vec<Dd> {
        let coefficients: Vec<Lanes> = coefficients.iter().copied().map(Lanes::splat).collect();
        let mut all = Vec::with_capacity(self.response.len());
        let of_range = |range: Range<usize>| {
            let mut terms = Eight::new(design);
            let mut values = Vec::with_capacity(range.len());
            for first in range.clone().step_by(LANES) {
                let value = lanes::value(terms.rows(self.inputs, first, seen), &coefficients);
                values.extend((0..LANES.min(range.end - first)).map(|lane| value.get(lane)));
            }
            values
        };
        threads::over_rows(self.response.len(), of_range, |values| all.extend(values));
        all
    }

    /// The numbers of some rows, one in each lane; the last one again beyond the end.
    pub(crate) fn responses(&self, first: usize) -> Lanes {
        Lanes::of(eight(self.response, first))
    }

    /// The weights of some rows.
    pub(crate) fn weights(&self, first: usize) -> Lanes {
        if self.weights.is_empty() { Lanes::ONE } else { Lanes::of(eight(self.weights, first)) }
    }

    /// The point of a row.
    #[must_use]
    pub fn point(&self, row: usize) -> Vec<Physical> {
        self.inputs.iter().map(|column| Physical(column[row])).collect()
    }

    /// Rows with identical settings of all inputs, group by group, in the order of their first rows.
    #[must_use]
    pub fn replicates(&self) -> Vec<Vec<usize>> {
        self.points().iter().map(<[usize]>::to_vec).collect()
    }

    /// The same without an allocation for each group.
    pub(crate) fn points(&self) -> Groups {
        Groups::of_firsts(&points::firsts_of_columns(self.response.len(), self.inputs))
    }

    /// The weighted mean response of some rows.
    #[must_use]
    pub fn mean(&self, rows: &[usize]) -> Dd {
        self.mean_of(rows.iter().copied())
    }

    /// The same for rows that are not in memory.
    pub(crate) fn mean_of(&self, rows: impl Iterator<Item = usize> + Clone) -> Dd {
        if self.weights.is_empty() {
            // A product with 1 is exact, and so is the sum of the ones.
            let (mut sum, mut count) = (Dd::ZERO, 0usize);
            for row in rows {
                sum += Dd::from(self.response[row]);
                count += 1;
            }
            // A quotient by 1 is exact.
            return if count == 1 { sum } else { sum / Dd::from(count as f64) };
        }
        let sum: Dd = rows.clone().map(|row| self.weight(row) * Dd::from(self.response[row])).sum();
        sum / rows.map(|row| self.weight(row)).sum()
    }
}
