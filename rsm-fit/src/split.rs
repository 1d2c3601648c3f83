//! Sets rows aside. Rows that belong together stay on one side.
//!
//! In: records and the specification of the split. Out: the rows to fit and the rows set aside, both in the order of the data; or parts of nearly
//! equal size, each to be left out in turn. The same seed gives the same split on every machine. Rows at the same point of all inputs (repetitions,
//! and exact copies) always belong together, because the response of one predicts that of the other. No row is on both sides. A group that is larger
//! than the remaining share is taken as a whole. Where rows are series with autoregressive errors, whole series belong together, or blocks of rows if
//! there are few series; the same point in two of them then means two independent measurements.

use std::collections::BTreeMap;

use crate::random::Random;
use crate::records::Records;
use crate::spec::{PARTS, Specification, Split};

/// With fewer series than this, rows are set aside in blocks: a fifth of the rows at once leaves most fits possible.
const LEAST_SERIES: usize = 5;

/// The number of blocks: each is a part of cross-validation.
const BLOCKS: usize = PARTS;

/// Row numbers on either side.
#[derive(Debug, Clone, PartialEq)]
pub struct Sides {
    /// Rows to fit.
    pub fit: Vec<usize>,
    /// Rows set aside.
    pub validate: Vec<usize>,
}

/// Splits the rows. Groups are set aside in random order until the share is reached.
#[must_use]
pub fn split(specification: &Specification, split: &Split, records: &Records) -> Sides {
    let rows = records.rows();
    let mut groups = groups(specification, Some(split), records);
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

/// Parts of nearly equal size: the part of each row. There are `parts` of them, or as many as there are groups. Groups are assigned in random order,
/// each to the part with the fewest rows.
#[must_use]
pub fn parts(groups: &[usize], parts: usize, seed: u64) -> Vec<usize> {
    let mut rows: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (row, group) in groups.iter().enumerate() {
        rows.entry(*group).or_default().push(row);
    }
    let mut order: Vec<Vec<usize>> = rows.into_values().collect();
    Random::new(seed).shuffle(&mut order);
    let mut sizes = vec![0; parts.min(order.len())];
    let mut part_of = vec![0; groups.len()];
    for group in order {
        let part = (0..sizes.len()).min_by_key(|part| sizes[*part]).expect("a group needs a part");
        sizes[part] += group.len();
        for row in group {
            part_of[row] = part;
        }
    }
    part_of
}

/// The group of every row, numbered by its first row, including everything that the splits of a specification keep together.
#[must_use]
pub fn group_of(specification: &Specification, records: &Records) -> Vec<usize> {
    let mut group_of = vec![0; records.rows()];
    for group in groups(specification, None, records) {
        for row in &group {
            group_of[*row] = group[0];
        }
    }
    group_of
}

/// Joins groups with rows at the same point. `points`: the rows of each point.
#[must_use]
pub fn joined(groups: &[usize], points: &[Vec<usize>]) -> Vec<usize> {
    let most = groups.iter().max().map_or(0, |most| most + 1);
    let mut leader: Vec<usize> = (0..most).collect();
    for point in points {
        for row in &point[1..] {
            let (a, b) = (find(&leader, groups[point[0]]), find(&leader, groups[*row]));
            leader[a.max(b)] = a.min(b);
        }
    }
    groups.iter().map(|group| find(&leader, *group)).collect()
}

/// The groups of one split, or of all, in the order of their first rows.
fn groups(specification: &Specification, split: Option<&Split>, records: &Records) -> Vec<Vec<usize>> {
    let rows = records.rows();
    // The smallest row number in the group of each row.
    let mut leader: Vec<usize> = (0..rows).collect();
    let mut join = |keys: Vec<String>| {
        let mut first: BTreeMap<String, usize> = BTreeMap::new();
        for (row, key) in keys.into_iter().enumerate() {
            let other = *first.entry(key).or_insert(row);
            let (a, b) = (find(&leader, other), find(&leader, row));
            leader[a.max(b)] = a.min(b);
        }
    };
    let labels = specification.labels();
    let splits: Vec<&Split> = split.map_or_else(|| specification.splits().collect(), |split| vec![split]);
    let together = &specification.together;
    for kept in splits.iter().map(|split| &split.keep_together).chain([&together.columns]) {
        if !kept.is_empty() {
            let place = |name: &String| labels.iter().position(|label| label == name).expect("every split's columns are read");
            let columns: Vec<&Vec<String>> = kept.iter().map(|name| &records.labels[place(name)]).collect();
            let key = |row: usize| columns.iter().map(|column| format!("{:?},", column[row])).collect();
            join((0..rows).map(key).collect());
        }
    }
    let sections = sections(records);
    let has_sections = !sections.is_empty();
    if has_sections {
        join(sections.into_iter().map(|section| section.to_string()).collect());
    }
    let mirrored = splits.iter().flat_map(|split| &split.mirror).chain(&together.mirror);
    let mirrored: Vec<&String> = mirrored.collect();
    let is_mirrored: Vec<bool> = specification.inputs.iter().map(|input| mirrored.contains(&&input.name)).collect();
    let value = |x: f64, mirrored: bool| if mirrored { x.abs() } else { x + 0.0 };
    let columns = || records.inputs.iter().zip(&is_mirrored);
    // A point that is not known completely is a point of its own.
    let own = |x: f64, row: usize| if x.is_nan() { format!("row {row},") } else { String::new() };
    let cell = |x: f64, mirrored: bool, row: usize| format!("{},{}", value(x, mirrored), own(x, row));
    let key = |row: usize| columns().map(|(column, mirrored)| cell(column[row], *mirrored, row)).collect();
    if !has_sections || !mirrored.is_empty() {
        join((0..rows).map(key).collect());
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for row in 0..rows {
        groups.entry(find(&leader, row)).or_default().push(row);
    }
    groups.into_values().collect()
}

/// The section of each row: its series, or a block of consecutive rows of it if there are few series. Empty without series.
fn sections(records: &Records) -> Vec<usize> {
    if !has_blocks(&records.series) {
        return records.series.clone();
    }
    let rows = records.rows();
    let mut order: Vec<usize> = (0..rows).collect();
    if !records.order.is_empty() {
        order.sort_by(|a, b| records.order[*a].total_cmp(&records.order[*b]));
    }
    let mut sections = vec![0; rows];
    for (k, row) in order.into_iter().enumerate() {
        sections[row] = records.series[row] * BLOCKS + k * BLOCKS / rows;
    }
    sections
}

/// Whether rows of these series are set aside in blocks instead of whole series.
pub(crate) fn has_blocks(series: &[usize]) -> bool {
    let count = series.iter().max().map_or(0, |most| most + 1);
    (1..LEAST_SERIES).contains(&count)
}

fn find(leader: &[usize], mut row: usize) -> usize {
    while leader[row] != row {
        row = leader[row];
    }
    row
}
