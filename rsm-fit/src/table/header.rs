//! The header of a table: names with units, and which columns are wanted.
//!
//! In: the cells of a header, the requested columns. Out: [`Column`]s without rows, the use of each, and every fault. Knows no format of a file.

use std::collections::{BTreeMap, BTreeSet};

use super::{Column, Wanted, is_run};

/// The largest number of columns named in a message.
const MOST_NAMES: usize = 40;

/// What is called with a fault of a header, and with what to do about it.
type Tell<'a> = &'a mut dyn FnMut(String, Option<&'static str>);

/// The columns of a header whose cells are `name` or `name[unit]`.
pub(crate) fn columns<'a>(cells: impl Iterator<Item = &'a str>, tell: Tell<'_>) -> Vec<Column> {
    let mut columns: Vec<Column> = Vec::new();
    let mut places: BTreeMap<&str, usize> = BTreeMap::new();
    for (k, cell) in cells.map(str::trim).enumerate() {
        let place = k + 1;
        let (name, unit) = match cell.split_once('[') {
            None => (cell, None),
            Some((name, rest)) => match rest.strip_suffix(']').filter(|unit| !unit.contains(['[', ']'])) {
                Some(unit) => (name.trim_end(), Some(unit.trim().to_string())),
                None => {
                    tell(format!("column {place} is headed `{cell}`, expected `name` or `name[unit]`"), None);
                    (name, None)
                }
            },
        };
        if name.is_empty() {
            tell(format!("column {place} has no name"), None);
        } else if let Some(first) = places.get(name) {
            tell(format!("columns {first} and {place} are both named `{name}`"), Some("rename or remove one of them"));
        } else {
            places.insert(name, place);
        }
        columns.push(Column { name: name.to_string(), unit, place, values: Vec::new(), labels: Vec::new() });
    }
    columns
}

/// For every column of the file: requested as numbers, requested as labels. Reports missing ones.
pub(crate) fn roles(columns: &[Column], wanted: &Wanted, tell: Tell<'_>) -> Vec<(bool, bool)> {
    let known: BTreeSet<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    for name in wanted.numbers.iter().chain(&wanted.labels) {
        if !known.contains(name.as_str()) {
            let mut names: Vec<String> = columns.iter().take(MOST_NAMES).map(|column| format!("`{}`", column.name)).collect();
            if columns.len() > MOST_NAMES {
                names.push(format!("{} more", columns.len() - MOST_NAMES));
            }
            tell(format!("there is no column `{name}`; the columns are {}", names.join(", ")), None);
        }
    }
    let numbers: BTreeSet<&String> = wanted.numbers.iter().collect();
    let labels: BTreeSet<&String> = wanted.labels.iter().collect();
    let of = |column: &Column| {
        let is_run = wanted.run && is_run(&column.name);
        (wanted.every_number || numbers.contains(&column.name), is_run || labels.contains(&column.name))
    };
    columns.iter().map(of).collect()
}
