//! Rows that are left out because a cell is missing.
//!
//! In: records with NaN in place of missing numbers. Out: the records without rows that no response can use, the rows of each response, and the
//! counts for each file and column. Never fills a cell: a number of a fit is a number of the data. For one response the fit has the bits of the same
//! files without these rows; only the tests of neighbouring rows differ, because rows on both sides of a gap are no neighbours.

use std::borrow::Cow;

use rsm_core::source::Faults;
use serde::Serialize;

use crate::missing::{Missing, is_missing};
use crate::records::Records;
use crate::sequence::Sequence;
use crate::spec::{ResponseSpec, Specification};
use crate::statistics::Warning;

/// The share of left-out rows above which a fit warns: beyond a tenth, estimates from the complete rows are likely to be biased (Bennett 2001, How
/// can I deal with missing data in my study?).
pub const WARN_ABOVE: f64 = 0.1;

/// Rows that a response leaves out, of one use of rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// The key of the specification that gives the rows: `data`, `validate` or `test`.
    pub key: &'static str,
    /// The number of rows that are left out.
    pub rows: usize,
    /// The number of all rows.
    pub of: usize,
    /// The missing cells. A row that lacks several is counted in each column.
    pub cells: Vec<MissingCells>,
}

/// Missing cells of one column of one file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MissingCells {
    /// The file.
    pub file: String,
    /// The column.
    pub column: String,
    /// The number of cells.
    pub cells: usize,
}

impl LeftOut {
    /// What is left out, as a sentence.
    #[must_use]
    pub fn words(&self) -> String {
        let cell = |it: &MissingCells| format!("{} in `{}` of {}", it.cells, it.column, it.file);
        let (is, cells) = if self.rows == 1 { ("is", "a cell is") } else { ("are", "cells are") };
        let each: Vec<String> = self.cells.iter().map(cell).collect();
        format!(
            "{} of {} rows of `{}` {is} left out because {cells} missing: {}",
            self.rows,
            self.of,
            self.key,
            each.join(", ")
        )
    }
}

/// The warning if a large share of the rows is left out.
pub(crate) fn warning(left_out: &[LeftOut]) -> Option<Warning> {
    let is_large = |it: &&LeftOut| it.rows as f64 > WARN_ABOVE * it.of as f64;
    let each: Vec<String> = left_out
        .iter()
        .filter(is_large)
        .map(|it| format!("{:.0} % of `{}`", 100.0 * it.rows as f64 / it.of as f64, it.key))
        .collect();
    let what = || {
        format!(
            "rows with missing cells are left out, {}: the surface is wrong if cells are missing for a reason that depends on the response",
            each.join(" and ")
        )
    };
    (!each.is_empty()).then(|| Warning { kind: "missing-rows", what: what() })
}

/// The inputs of a response, by their places in the specification.
pub(crate) fn inputs_of(specification: &Specification, response: &ResponseSpec) -> Vec<usize> {
    let place = |name: &String| specification.inputs.iter().position(|input| input.name == *name);
    response.surface.inputs.iter().map(|name| place(name).expect("a read specification names known inputs")).collect()
}

/// The values of an input in the rows of the responses that use it; all values if none does.
pub(crate) fn used_values<'a>(specification: &Specification, fit: &'a Records, input: usize) -> Cow<'a, [f64]> {
    let values = &fit.inputs[input];
    if specification.missing == Missing::Error {
        return Cow::Borrowed(values);
    }
    let mut is_used = vec![false; values.len()];
    let mut is_any = false;
    for (k, response) in specification.responses.iter().enumerate() {
        let inputs = inputs_of(specification, response);
        if inputs.contains(&input) {
            is_any = true;
            fit.complete(&inputs, k).into_iter().for_each(|row| is_used[row] = true);
        }
    }
    let some = (0..values.len()).filter(|row| is_used[*row] || !is_any && !values[*row].is_nan());
    Cow::Owned(some.map(|row| values[row]).collect())
}

/// Removes the rows that no response can use, before any split. Returns what each response leaves out.
pub(crate) fn remove(
    specification: &Specification,
    fit: &mut Records,
    validate: Option<&mut Records>,
    test: Option<&mut Records>,
) -> Result<Vec<Vec<LeftOut>>, Faults> {
    let mut counts = vec![Vec::new(); specification.responses.len()];
    if specification.missing == Missing::Error {
        return Ok(counts);
    }
    let mut clean = |key: &'static str, records: &mut Records| {
        let rows = records.rows();
        let is_complete = uses(specification, records);
        for ((k, counts), is_complete) in counts.iter_mut().enumerate().zip(&is_complete) {
            counts.extend(count(specification, records, key, k, is_complete));
        }
        let kept: Vec<usize> = (0..rows).filter(|row| is_complete.iter().any(|response| response[*row])).collect();
        if kept.is_empty() {
            let what = format!("`{key}`: every row misses a number in a column that each response uses, so no row is left");
            return Err(Faults::one(specification.fault(key, what)));
        }
        records.leave_out(&kept);
        Ok(())
    };
    clean("data", fit)?;
    for (key, records) in [("validate", validate), ("test", test)] {
        records.map_or(Ok(()), |records| clean(key, records))?;
    }
    Ok(counts)
}

/// For every response, whether it can use each row. A row without a group is used by none, because it could be on both sides of a split.
fn uses(specification: &Specification, records: &Records) -> Vec<Vec<bool>> {
    let has_group = |row: usize| !records.labels.iter().any(|column| is_missing(&column[row]));
    let of_one = |(k, response): (usize, &ResponseSpec)| {
        let mut is_used = vec![false; records.rows()];
        for row in records.complete(&inputs_of(specification, response), k) {
            is_used[row] = has_group(row);
        }
        is_used
    };
    specification.responses.iter().enumerate().map(of_one).collect()
}

/// What a response leaves out; `None` if it uses every row.
fn count(
    specification: &Specification,
    records: &Records,
    key: &'static str,
    k: usize,
    is_complete: &[bool],
) -> Option<LeftOut> {
    let rows = is_complete.iter().filter(|is_complete| !**is_complete).count();
    if rows == 0 {
        return None;
    }
    let response = &specification.responses[k];
    let is_nan = |column: &[f64]| column.iter().map(|value| value.is_nan()).collect::<Vec<bool>>();
    let mut columns: Vec<(String, Vec<bool>)> = Vec::new();
    for input in inputs_of(specification, response) {
        columns.push((specification.inputs[input].column.clone(), is_nan(&records.inputs[input])));
    }
    columns.push((response.column.clone(), is_nan(&records.responses[k])));
    if let Some(weights) = response.weights.as_ref().filter(|_| !records.weights[k].is_empty()) {
        columns.push((weights.column().to_string(), is_nan(&records.weights[k])));
    }
    for (name, cells) in specification.labels().iter().zip(&records.labels) {
        columns.push(((*name).to_string(), cells.iter().map(|cell| is_missing(cell)).collect()));
    }
    let mut cells = Vec::new();
    let mut start = 0;
    for file in &records.files {
        for (place, (column, is_missing)) in columns.iter().enumerate() {
            let found = is_missing[start..start + file.rows].iter().filter(|is_missing| **is_missing).count();
            // One column may be an input and a weight.
            if found > 0 && !columns[..place].iter().any(|(earlier, _)| earlier == column) {
                cells.push(MissingCells { file: file.name.clone(), column: column.clone(), cells: found });
            }
        }
        start += file.rows;
    }
    Some(LeftOut { key, rows, of: is_complete.len(), cells })
}

/// The records of one response after the splits: only rows that it can use.
pub(crate) struct OfResponse<'a> {
    pub fit: Cow<'a, Records>,
    pub validate: Option<Cow<'a, Records>>,
    pub test: Option<Cow<'a, Records>>,
    pub sequence: Sequence,
}

/// The rows that a response can use, of those to fit, for validation and for the test.
pub(crate) fn of_response<'a>(
    specification: &Specification,
    [fit, validate, test]: [Option<&'a Records>; 3],
    k: usize,
    left_out: &[LeftOut],
) -> Result<OfResponse<'a>, Faults> {
    let response = &specification.responses[k];
    let used = inputs_of(specification, response);
    let complete = |key: &str, records: &'a Records| {
        let rows = if left_out.is_empty() { (0..records.rows()).collect() } else { records.complete(&used, k) };
        if rows.is_empty() {
            let name = &response.surface.name;
            let what = format!("response `{name}`: every row of `{key}` misses a number in a column that it uses");
            let words: Vec<String> = left_out.iter().map(LeftOut::words).collect();
            let fault = specification.fault(&format!("responses.{name}"), what);
            return Err(Faults::one(fault.help(words.join("; "))));
        }
        let some = if rows.len() == records.rows() { Cow::Borrowed(records) } else { Cow::Owned(records.select(&rows)) };
        Ok((some, rows))
    };
    let all = fit.expect("there are rows to fit");
    let (fit, rows) = complete("data", all)?;
    let apart = |key: &str, records: Option<&'a Records>| {
        records.map(|records| complete(key, records).map(|(some, _)| some)).transpose()
    };
    let (validate, test) = (apart("validate", validate)?, apart("test", test)?);
    Ok(OfResponse { fit, validate, test, sequence: Sequence::of(all, &rows) })
}
