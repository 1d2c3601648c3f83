//! The order of fitted rows, with the gaps that left-out rows make.
//!
//! In: records and the rows that a response uses. Out: a [`Sequence`] for everything that compares neighbouring rows.

use crate::records::Records;

/// The order of the fitted rows, and the gaps where rows are left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Sequence {
    /// The rows in run order if it is known, else in file order: recordings are in the order of time.
    pub rows: Vec<usize>,
    /// The place of each of them, where left-out rows count too: neighbours differ by 1.
    pub places: Vec<usize>,
    /// Whether the run order is known.
    pub is_known: bool,
}

impl Sequence {
    /// The sequence of some rows of the records. The others are gaps, as are rows that no response can use.
    pub(crate) fn of(records: &Records, used: &[usize]) -> Self {
        let is_known = !records.order.is_empty();
        let number = |row: usize| records.numbers.get(row).copied().unwrap_or(row) as f64;
        let place = |row: usize| if is_known { records.order[row] } else { number(row) };
        let mut is_used = vec![false; records.rows()];
        used.iter().for_each(|row| is_used[*row] = true);
        let mut rows: Vec<usize> = (0..used.len()).collect();
        rows.sort_by(|a, b| place(used[*a]).total_cmp(&place(used[*b])));
        let others = (0..records.rows()).filter(|row| !is_used[*row]).map(place);
        let mut gaps: Vec<f64> = others.chain(records.left_out.iter().copied()).collect();
        gaps.sort_by(f64::total_cmp);
        let before = |row: usize| gaps.partition_point(|gap| *gap < place(used[row]));
        let places = rows.iter().enumerate().map(|(k, row)| k + before(*row)).collect();
        Sequence { rows, places, is_known }
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
}
