//! Sets rows aside. Rows that belong together stay on one side.
//!
//! In: records and the specification of the split. Out: the rows to fit and the rows set aside, both in the order of the data; or parts of nearly
//! equal size, each to be left out in turn. The same seed gives the same split on every machine. Rows at the same point of all inputs (repetitions,
//! and exact copies) always belong together, because the response of one predicts that of the other. No row is on both sides. A group that is larger
//! than the remaining share is taken as a whole. Where rows are series with autoregressive errors, whole series belong together, or blocks of rows if
//! there are few series; the same point in two of them then means two independent measurements.

use crate::points::{self, Groups};
use crate::random::Random;
use crate::records::Records;
use crate::spec::{PARTS, Specification, Split};
use rsm_core::order;

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
    let groups = groups(specification, Some(split), records);
    let mut order: Vec<usize> = (0..groups.count()).collect();
    Random::new(split.seed).shuffle(&mut order);
    let wanted = (split.share * rows as f64).round() as usize;
    let mut is_aside = vec![false; rows];
    let mut count = 0;
    for group in order {
        if count >= wanted {
            break;
        }
        count += groups.get(group).len();
        groups.get(group).iter().for_each(|row| is_aside[*row] = true);
    }
    let (validate, fit) = (0..rows).partition(|row| is_aside[*row]);
    Sides { fit, validate }
}

/// Parts of nearly equal size: the part of each row. There are `parts` of them, or as many as there are groups. Groups are assigned in random order,
/// each to the part with the fewest rows.
#[must_use]
pub fn parts(groups: &[usize], parts: usize, seed: u64) -> Vec<usize> {
    let most = groups.iter().max().map_or(0, |most| most.saturating_add(1));
    // Memory for each number only if there are not many more numbers than rows; those of a fit are numbers of rows.
    if most > 8 * (groups.len() + 1000) {
        let mut sorted = groups.to_vec();
        sorted.sort_unstable();
        sorted.dedup();
        let place = |group: &usize| sorted.binary_search(group).expect("a group is among the groups");
        return self::parts(&groups.iter().map(place).collect::<Vec<usize>>(), parts, seed);
    }
    // Every row is a group of its own: each part in turn, and no group has to be looked up.
    if groups.iter().enumerate().all(|(row, group)| row == *group) {
        let mut order: Vec<u32> = (0..groups.len()).map(|row| u32::try_from(row).expect("fewer than 2^32 rows")).collect();
        Random::new(seed).shuffle(&mut order);
        let mut part_of = vec![0; groups.len()];
        order.iter().zip((0..parts).cycle()).for_each(|(row, part)| part_of[*row as usize] = part);
        return part_of;
    }
    // A number without rows is no group.
    let groups_of = Groups::of_numbers(groups, most);
    let mut order: Vec<usize> = (0..most).filter(|group| !groups_of.get(*group).is_empty()).collect();
    Random::new(seed).shuffle(&mut order);
    let mut sizes = vec![0; parts.min(order.len())];
    let mut part_of = vec![0; groups.len()];
    for group in order {
        let part = (0..sizes.len()).min_by_key(|part| sizes[*part]).expect("a group needs a part");
        let rows = groups_of.get(group);
        sizes[part] += rows.len();
        for row in rows {
            part_of[*row] = part;
        }
    }
    part_of
}

/// The group of every row, numbered by its first row, including everything that the splits of a specification keep together.
#[must_use]
pub fn group_of(specification: &Specification, records: &Records) -> Vec<usize> {
    leaders(specification, None, records)
}

/// Joins groups with rows at the same point. `firsts`: for each row the first row at its point.
#[must_use]
pub(crate) fn joined(groups: &[usize], firsts: &[usize]) -> Vec<usize> {
    let most = groups.iter().max().map_or(0, |most| most + 1);
    let mut leader: Vec<usize> = (0..most).collect();
    for (row, first) in firsts.iter().enumerate().filter(|(row, first)| row != *first) {
        join(&mut leader, groups[*first], groups[row]);
    }
    groups.iter().map(|group| find(&mut leader, *group)).collect()
}

/// The groups of one split, or of all, in the order of their first rows.
fn groups(specification: &Specification, split: Option<&Split>, records: &Records) -> Groups {
    Groups::of_firsts(&leaders(specification, split, records))
}

/// For each row the first row of its group.
fn leaders(specification: &Specification, split: Option<&Split>, records: &Records) -> Vec<usize> {
    let rows = records.rows();
    // The smallest row number in the group of each row.
    let mut leader: Vec<usize> = (0..rows).collect();
    let mut join_all =
        |firsts: Vec<usize>| firsts.into_iter().enumerate().for_each(|(row, first)| join(&mut leader, first, row));
    let labels = specification.labels();
    let splits: Vec<&Split> = split.map_or_else(|| specification.splits().collect(), |split| vec![split]);
    let together = &specification.together;
    for kept in splits.iter().map(|split| &split.keep_together).chain([&together.columns]) {
        if !kept.is_empty() {
            let place = |name: &String| labels.iter().position(|label| label == name).expect("every split's columns are read");
            let columns: Vec<&Vec<String>> = kept.iter().map(|name| &records.labels[place(name)]).collect();
            let hash = |row: usize| columns.iter().fold(1, |hash, column| points::mixed(hash, hash_of(&column[row])));
            join_all(points::firsts(rows, hash, |row, other| columns.iter().all(|column| column[row] == column[other])));
        }
    }
    let sections = sections(records);
    let has_sections = !sections.is_empty();
    if has_sections {
        join_all(points::firsts(
            rows,
            |row| points::mixed(1, sections[row] as u64),
            |row, other| sections[row] == sections[other],
        ));
    }
    let mirrored = splits.iter().flat_map(|split| &split.mirror).chain(&together.mirror);
    let mirrored: Vec<&String> = mirrored.collect();
    let is_mirrored: Vec<bool> = specification.inputs.iter().map(|input| mirrored.contains(&&input.name)).collect();
    // + 0.0 makes both zeros equal.
    let value = |x: f64, mirrored: bool| if mirrored { x.abs() } else { x + 0.0 };
    let columns = || records.inputs.iter().zip(&is_mirrored);
    let hash =
        |row: usize| columns().fold(1, |hash, (column, mirrored)| points::mixed(hash, value(column[row], *mirrored).to_bits()));
    // A point that is not known completely is a point of its own: NaN equals nothing.
    let is_equal = |row: usize, other: usize| {
        columns().all(|(column, mirrored)| value(column[row], *mirrored) == value(column[other], *mirrored))
    };
    if !has_sections || !mirrored.is_empty() {
        join_all(points::firsts(rows, hash, is_equal));
    }
    (0..rows).map(|row| find(&mut leader, row)).collect()
}

/// The same hash on every machine and in every run; only the time depends on it.
fn hash_of(text: &str) -> u64 {
    text.bytes().fold(text.len() as u64, |hash, byte| points::mixed(hash, u64::from(byte)))
}

/// The section of each row: its series, or a block of consecutive rows of it if there are few series. Empty without series.
fn sections(records: &Records) -> Vec<usize> {
    if !has_blocks(&records.series) {
        return records.series.clone();
    }
    let rows = records.rows();
    let mut order: Vec<usize> = (0..rows).collect();
    if !records.order.is_empty() {
        order::ascending(&mut order, |it| records.order[*it]);
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

/// Joins the groups of two rows. The smaller leader leads both.
fn join(leader: &mut [usize], one: usize, other: usize) {
    let (a, b) = (find(leader, one), find(leader, other));
    leader[a.max(b)] = a.min(b);
}

/// The leader of a row. Every row on the way then names a nearer one (Tarjan, van Leeuwen 1984: halving), so that chains stay short.
fn find(leader: &mut [usize], mut row: usize) -> usize {
    while leader[row] != row {
        leader[row] = leader[leader[row]];
        row = leader[row];
    }
    row
}
