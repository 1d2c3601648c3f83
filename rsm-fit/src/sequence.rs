//! The order of fitted rows, with the gaps that left-out rows make.
//!
//! In: records and the rows that a response uses. Out: a [`Sequence`] for everything that compares neighbouring rows. Rows of different series are no
//! neighbours.

use crate::records::Records;
use rsm_core::order;

/// The order of the fitted rows, and the gaps where rows are left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Sequence {
    /// The rows in run order if it is known, else in file order: recordings are in the order of time.
    pub rows: Vec<usize>,
    /// The place of each of them, where left-out rows and the borders of series count too: neighbours differ by 1.
    pub places: Vec<usize>,
    /// The series of each of them; all 0 if the specification has no series.
    pub series: Vec<usize>,
    /// Whether the run order is known.
    pub is_known: bool,
}

impl Sequence {
    /// The sequence of some rows of the records. The others are gaps, as are rows that no response can use.
    pub(crate) fn of(records: &Records, used: &[usize]) -> Self {
        let is_known = !records.order.is_empty();
        let place = |row: usize| records.place(row);
        let mut is_used = vec![false; records.rows()];
        used.iter().for_each(|row| is_used[*row] = true);
        let mut rows: Vec<usize> = (0..used.len()).collect();
        order::ascending(&mut rows, |it| place(used[*it]));
        let others = (0..records.rows()).filter(|row| !is_used[*row]).map(place);
        let mut gaps: Vec<f64> = others.chain(records.left_out.iter().copied()).collect();
        order::sort(&mut gaps);
        let before = |row: usize| gaps.partition_point(|gap| *gap < place(used[row]));
        let series: Vec<usize> = rows.iter().map(|row| records.series.get(used[*row]).copied().unwrap_or(0)).collect();
        let mut borders = 0;
        let mut places = Vec::with_capacity(rows.len());
        for (k, row) in rows.iter().enumerate() {
            borders += usize::from(k > 0 && series[k] != series[k - 1]);
            places.push(k + before(*row) + borders);
        }
        Sequence { rows, places, series, is_known }
    }

    /// The sequence of some of its rows; the others are gaps. The rows that are kept are numbered anew.
    pub(crate) fn only(&self, is_kept: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.rows.len()).filter(|k| is_kept(self.rows[*k])).collect();
        let mut sorted: Vec<usize> = kept.iter().map(|k| self.rows[*k]).collect();
        sorted.sort_unstable();
        let number = |row: usize| sorted.binary_search(&row).expect("a kept row is among the kept ones");
        Sequence {
            rows: kept.iter().map(|k| number(self.rows[*k])).collect(),
            places: kept.iter().map(|k| self.places[*k]).collect(),
            series: kept.iter().map(|k| self.series[*k]).collect(),
            is_known: self.is_known,
        }
    }

    /// Whether rows are missing between the first and the last.
    pub(crate) fn has_gaps(&self) -> bool {
        self.places.windows(2).any(|pair| pair[1] != pair[0] + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_on_both_sides_of_a_gap_are_no_neighbours() {
        let one = |rows: usize| Records { responses: vec![vec![0.0; rows]], ..Records::default() };
        let whole = Sequence::of(&one(4), &[0, 1, 2, 3]);
        assert_eq!(
            (whole.rows.as_slice(), whole.places.as_slice(), whole.has_gaps()),
            (&[0, 1, 2, 3][..], &[0, 1, 2, 3][..], false)
        );
        // Row 1 of five belongs to another response; row 3 was removed for all, so that the last two of four are numbers 2 and 4.
        let records = Records { numbers: vec![0, 1, 2, 4], left_out: vec![3.0], ..one(4) };
        let gaps = Sequence::of(&records, &[0, 2, 3]);
        assert_eq!((gaps.rows.as_slice(), gaps.places.as_slice(), gaps.has_gaps()), (&[0, 1, 2][..], &[0, 2, 4][..], true));
        // In run order 40, 30, 10 with a removed run 20: 10 | 30, 40.
        let records = Records { order: vec![40.0, 30.0, 10.0], numbers: vec![0, 2, 3], left_out: vec![20.0], ..one(3) };
        let runs = Sequence::of(&records, &[0, 1, 2]);
        assert_eq!((runs.rows.as_slice(), runs.places.as_slice(), runs.is_known), (&[2, 1, 0][..], &[0, 2, 3][..], true));
    }
    #[test]
    fn rows_of_two_series_are_no_neighbours() {
        let records = Records { responses: vec![vec![0.0; 5]], series: vec![0, 0, 1, 1, 1], ..Records::default() };
        let all = Sequence::of(&records, &[0, 1, 2, 3, 4]);
        assert_eq!((all.places.as_slice(), all.series.as_slice()), (&[0, 1, 3, 4, 5][..], &[0, 0, 1, 1, 1][..]));
        let some = all.only(|row| row != 0 && row != 3);
        assert_eq!(
            (some.rows.as_slice(), some.places.as_slice(), some.series.as_slice()),
            (&[0, 1, 2][..], &[1, 3, 5][..], &[0, 1, 1][..])
        );
    }
}
