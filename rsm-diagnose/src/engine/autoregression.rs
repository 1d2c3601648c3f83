//! Autocorrelated noise: a first-order autoregressive process.
//!
//! In: the values of rows, each with its row number, and the correlation of neighbouring rows. Out: the innovation of each row. Rows may be missing:
//! the correlation of two rows n apart is the n-th power. The correlation itself is given, not estimated here.

/// The innovation of a row, given the row before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Innovation {
    /// The row number.
    pub row: usize,
    /// The innovation: the value minus its prediction from the row before.
    pub value: f64,
    /// The variance of the innovation, divided by the variance of the noise.
    pub variance: f64,
    /// The square root of `variance`.
    pub sd: f64,
}

/// The innovations of rows in ascending order. The first row has no row before it: its innovation is its value.
pub(crate) fn innovations(correlation: f64, rows: impl IntoIterator<Item = (usize, f64)>) -> impl Iterator<Item = Innovation> {
    let follows = |after: f64| {
        let variance = 1.0 - after * after;
        (after, variance, variance.sqrt())
    };
    // Most rows follow their neighbour.
    let neighbour = follows(correlation);
    let mut last: Option<(usize, f64)> = None;
    rows.into_iter().map(move |(row, value)| {
        let ((after, variance, sd), before) = match last {
            None => ((0.0, 1.0, 1.0), 0.0),
            Some((place, before)) if place + 1 == row => (neighbour, before),
            Some((place, before)) => (follows(correlation.powi(i32::try_from(row - place).unwrap_or(i32::MAX))), before),
        };
        last = Some((row, value));
        Innovation { row, value: value - after * before, variance, sd }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_new_by_what_the_last_one_does_not_say() {
        let found: Vec<Innovation> = innovations(0.5, [(3, 2.0), (4, 3.0), (6, 1.0)]).collect();
        // 3 - 0.5 2; two rows on the correlation is 0.25: 1 - 0.25 3, of a variance of 15/16.
        assert_eq!(found.iter().map(|it| it.value).collect::<Vec<_>>(), [2.0, 2.0, 0.25]);
        assert_eq!(found.iter().map(|it| it.variance).collect::<Vec<_>>(), [1.0, 0.75, 0.9375]);
        assert_eq!((found[2].row, found[1].sd), (6, 0.75_f64.sqrt()));
        // Without a correlation each row is all new, whatever is missing.
        assert!(innovations(0.0, [(0, 7.0), (9, 5.0)]).all(|it| it.variance == 1.0 && it.value >= 5.0));
    }
}
