//! The series of rows with autoregressive errors.
//!
//! In: a specification and its rows. Out: the number of the series of each row, in the records. A series is the rows with the same cells in the
//! columns of `series`, or the rows of a file. Its rows are consecutive in time, so rows of another series between them are a fault.

use rsm_core::order;
use std::collections::BTreeMap;

use rsm_core::source::Faults;

use crate::records::Records;
use crate::spec::Specification;

/// Numbers the series, and the rows, so that rows which are set aside later leave gaps.
pub(crate) fn mark(specification: &Specification, records: &mut Records) -> Result<(), Faults> {
    let rows = records.rows();
    if records.numbers.is_empty() {
        records.numbers = (0..rows).collect();
    }
    let labels = specification.labels();
    let place = |name: &String| labels.iter().position(|label| label == name).expect("the columns of series are read");
    let columns: Vec<&Vec<String>> = specification.series.iter().map(|name| &records.labels[place(name)]).collect();
    // The number of the first row behind each file.
    let ends: Vec<usize> = records
        .files
        .iter()
        .scan(0, |end, file| {
            *end += file.rows;
            Some(*end)
        })
        .collect();
    let key = |row: usize| match columns.is_empty() {
        true => ends.partition_point(|end| *end <= records.numbers[row]).to_string(),
        false => columns.iter().map(|column| format!("{:?},", column[row])).collect(),
    };
    let mut known: BTreeMap<String, usize> = BTreeMap::new();
    let mut series = Vec::with_capacity(rows);
    for row in 0..rows {
        let next = known.len();
        series.push(*known.entry(key(row)).or_insert(next));
    }
    let mut order: Vec<usize> = (0..rows).collect();
    order::ascending(&mut order, |it| records.place(*it));
    let mut has_ended = vec![false; known.len()];
    for pair in order.windows(2) {
        let [before, now] = [series[pair[0]], series[pair[1]]];
        if before != now {
            has_ended[before] = true;
        }
        if has_ended[now] {
            let cells: Vec<String> = columns.iter().map(|column| format!("\"{}\"", column[pair[1]])).collect();
            let of = if cells.is_empty() { "a file".to_string() } else { format!("the series {}", cells.join(", ")) };
            let what = format!("rows of {of} are before and behind rows of another one");
            let fault = specification.fault("series", what);
            return Err(Faults::one(fault.help("sort the rows by series, and by time within each")));
        }
    }
    records.series = series;
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::spec::NoiseOrder;
    use crate::{Fit, Response};

    #[test]
    fn rows_of_one_series_are_together() {
        let x = [0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 0.5, 1.5];
        let y = [0.1, 1.0, 2.2, 0.0, 1.3, 1.9, 0.5, 1.4];
        let fit =
            |series: [&str; 8]| Fit::new(&x, Response::new("y", y).noise(NoiseOrder::Given(1))).order(1).series(series).fit();
        let found = fit(["b", "b", "b", "b", "a", "a", "a", "a"]).unwrap();
        assert_eq!(found.fitted.series, [0, 0, 0, 0, 1, 1, 1, 1]);
        assert_eq!(found.responses[0].statistics.as_ref().unwrap().noise.as_ref().unwrap().series, 2);
        let refused = fit(["b", "b", "a", "a", "b", "b", "b", "b"]).unwrap_err().to_string();
        assert!(refused.contains("rows of the series \"b\" are before and behind rows of another one"), "{refused}");
    }
}
