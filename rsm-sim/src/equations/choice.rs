//! The choice between steps of the series and steps by a linear part.
//!
//! In: for a lane, the work of its rows by the method in use, and the number of steps that the series needs for a row. Out: the method of the next
//! step. The work of a row by linear parts is remembered while the lane uses the series. The series is tried again when the work of some rows by
//! linear parts is much more than that of the same rows by one step of the series each, because a plant may be stiff for a part of a record only. All
//! decisions depend on the lane alone.
//!
//! Work is counted in units of one step with the existing matrices of a linear part, because steps of the two methods differ too much in time.

/// The work of a new linear part, of a step of the series, and of a row of a group by one step of the series. Measured on the driveline: 1.6 us for a
/// linear part and 1 to 2 us for a step of the series of one lane, compared with 0.1 us for a step with existing matrices.
pub(super) const PART: u64 = 8;
pub(super) const SERIES: u64 = 8;
pub(super) const ROW_BY_SERIES: u64 = 4;

/// The work of a step with existing matrices.
pub(super) const STEP: u64 = 1;

/// If a row needs more steps of the series than this, linear parts are tried for the first time.
const MANY: f64 = 2.0;

/// The series is tried again when rows by linear parts have needed this much work more than rows by one step of the series: the work of one trial. It
/// is doubled up to the second number as long as the series does not stay for more rows than the third one.
const FIRST_LOSS: u64 = SERIES;
const LARGEST_LOSS: u64 = 256;
const STAYED: usize = 16;

/// After this number of rows by the series, the remembered work of a row by linear parts is halved: the plant may have become stiff.
const HALVED: usize = 32;

/// The choice of a lane so far.
#[derive(Debug, Clone)]
pub(super) struct Choice {
    /// The work of a row by linear parts when the lane left them, and the row. `None` if it has never used them.
    left: Option<(f64, usize)>,
    /// The row, and the work of the lane, from which the work of rows by linear parts is counted.
    since: (usize, u64),
    /// The work lost by linear parts after which the series is tried.
    loss: u64,
    /// The work of a row above which the lane returns to the series.
    budget: u64,
}

impl Default for Choice {
    fn default() -> Self {
        Choice { left: None, since: (0, 0), loss: FIRST_LOSS, budget: u64::MAX }
    }
}

impl Choice {
    /// Whether linear parts are expected to need less work than this number of steps of the series for a row.
    pub(super) fn prefers_linear(&self, steps: f64, row: usize) -> bool {
        match self.left {
            None => steps > MANY,
            Some((work, at)) => {
                let halvings = ((row - at) / HALVED).min(64);
                steps > 1.0 && SERIES as f64 * steps > work * 0.5_f64.powi(halvings as i32)
            }
        }
    }

    /// The lane uses linear parts from here on, in place of this number of steps of the series for a row.
    pub(super) fn enter_linear(&mut self, steps: f64, row: usize, work: u64) {
        self.budget = (SERIES as f64 * steps) as u64;
        self.loss = match self.left {
            Some((_, at)) if row - at <= STAYED => (2 * self.loss).min(LARGEST_LOSS),
            _ => FIRST_LOSS,
        };
        self.since = (row, work);
    }

    /// Whether the series is tried in place of a new linear part: if linear parts have lost enough work. Then the lane leaves them.
    pub(super) fn leaves_linear(&mut self, row: usize, work: u64) -> bool {
        let (rows, work_of_rows) = ((row - self.since.0) as u64, work - self.since.1);
        let Some(loss) = work_of_rows.checked_sub(ROW_BY_SERIES * rows) else {
            // Cheap rows must not hide later ones.
            self.since = (row, work);
            return false;
        };
        let leaves = rows > 0 && loss >= self.loss;
        if leaves {
            self.left = Some((work_of_rows as f64 / rows as f64, row));
        }
        leaves
    }

    /// Whether a row by linear parts that has already needed this work is to be continued by the series. Then the lane leaves the linear parts.
    pub(super) fn exceeds_budget(&mut self, row: usize, work: u64) -> bool {
        let exceeds = work > self.budget;
        if exceeds {
            self.left = Some((work as f64, row));
        }
        exceeds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_parts_are_tried_for_a_row_with_many_steps_and_kept_within_their_budget() {
        let mut choice = Choice::default();
        assert!(!choice.prefers_linear(MANY, 5) && choice.prefers_linear(2.1, 5));
        choice.enter_linear(3.0, 5, 100);
        assert!(!choice.exceeds_budget(5, 24) && choice.exceeds_budget(5, 25));
        // 24 units of work are less than 25, which is forgotten by half after some rows.
        assert!(!choice.prefers_linear(3.0, 6) && choice.prefers_linear(4.0, 6));
        assert!(choice.prefers_linear(3.0, 5 + HALVED) && !choice.prefers_linear(1.0, 5 + 10 * HALVED));
    }

    #[test]
    fn the_series_is_tried_again_after_expensive_rows_only_and_less_and_less_often() {
        let mut choice = Choice::default();
        choice.enter_linear(3.0, 0, 0);
        assert!(!choice.leaves_linear(0, 90), "in the same row");
        assert!(!choice.leaves_linear(100, 300), "the rows were cheap");
        let (mut row, mut work) = (100, 300);
        for loss in [8, 16, 32, 64, 128, 256, 256] {
            // Rows with 9 units of work lose 5 each.
            let rows = (loss as usize).div_ceil(5);
            assert!(!choice.leaves_linear(row + rows - 1, work + 9 * (rows as u64 - 1)));
            (row, work) = (row + rows, work + 9 * rows as u64);
            assert!(choice.leaves_linear(row, work), "{loss}");
            assert!(!choice.prefers_linear(1.0, row) && choice.prefers_linear(2.0, row), "16 units are more than 9");
            choice.enter_linear(2.0, row, work);
        }
        // The series stayed for many rows.
        assert!(choice.leaves_linear(row + 1, work + 1000));
        choice.enter_linear(2.0, row + 2 + STAYED, work);
        assert!(choice.leaves_linear(row + 3 + STAYED, work + ROW_BY_SERIES + FIRST_LOSS));
    }
}
