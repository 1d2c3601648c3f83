//! Sets rows aside as unseen data, so that rows which belong together stay on one side.
//!
//! In: records and what the specification says about the split. Out: the rows to fit and the rows to validate, both in the
//! order of the data. The same seed gives the same split on every machine. Never puts a row on both sides; a group larger than
//! what is still wanted is taken whole.

use std::collections::BTreeMap;

use crate::random::Random;
use crate::records::Records;
use crate::spec::{Specification, Split};

/// Row numbers on either side.
#[derive(Debug, Clone, PartialEq)]
pub struct Sides {
    /// Rows to fit.
    pub fit: Vec<usize>,
    /// Rows set aside.
    pub validate: Vec<usize>,
}

/// Splits the rows. Groups come in a random order and are set aside until the share is reached.
#[must_use]
pub fn split(specification: &Specification, split: &Split, records: &Records) -> Sides {
    let rows = records.rows();
    let mut groups = groups(specification, split, records);
    Random::new(split.seed).shuffle(&mut groups);
    let wanted = (split.share * rows as f64).round() as usize;
    let mut validate = Vec::new();
    for group in groups {
        if validate.len() >= wanted {
            break;
        }
        validate.extend(group);
    }
    validate.sort_unstable();
    let fit = (0..rows).filter(|row| validate.binary_search(row).is_err()).collect();
    Sides { fit, validate }
}

/// The groups in the order of their first rows.
fn groups(specification: &Specification, split: &Split, records: &Records) -> Vec<Vec<usize>> {
    let rows = records.rows();
    // The smallest row of the group of each row.
    let mut leader: Vec<usize> = (0..rows).collect();
    let mut join = |keys: Vec<String>| {
        let mut first: BTreeMap<String, usize> = BTreeMap::new();
        for (row, key) in keys.into_iter().enumerate() {
            let other = *first.entry(key).or_insert(row);
            let (a, b) = (find(&leader, other), find(&leader, row));
            leader[a.max(b)] = a.min(b);
        }
    };
    if !split.keep_together.is_empty() {
        let key = |row: usize| records.labels.iter().map(|column| format!("{:?},", column[row])).collect();
        join((0..rows).map(key).collect());
    }
    if !split.mirror.is_empty() {
        let is_mirrored: Vec<bool> = specification.inputs.iter().map(|input| split.mirror.contains(&input.name)).collect();
        let value = |x: f64, mirrored: bool| if mirrored { x.abs() } else { x + 0.0 };
        let columns = || records.inputs.iter().zip(&is_mirrored);
        let key = |row: usize| columns().map(|(column, mirrored)| format!("{},", value(column[row], *mirrored))).collect();
        join((0..rows).map(key).collect());
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for row in 0..rows {
        groups.entry(find(&leader, row)).or_default().push(row);
    }
    groups.into_values().collect()
}

fn find(leader: &[usize], mut row: usize) -> usize {
    while leader[row] != row {
        row = leader[row];
    }
    row
}
