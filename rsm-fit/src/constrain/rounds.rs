//! The rounds of exchange, and the margin of each.
//!
//! In: whether points are still found, and the largest violation of each round. Out: the margin of the next round, as a share of the spread of the
//! response, or the end. Does not see the points.

/// The first margin of the constraints at points, as a share of the spread of the response.
pub const SHIFT: f64 = 1e-7;

/// The number of rounds with the first shift, unless one finds no new point earlier.
const SHIFTED_ROUNDS: usize = 25;

/// After them, a round multiplies the shift by [`GROWTH`] if so many rounds did not halve the largest violation. A convex surface of four inputs and
/// order 5 has some hundred active points, and halves it in about six rounds: with a shift that grew from the 25th round on, it reached the largest
/// shift first.
const PATIENCE: usize = 15;

/// The largest number of rounds.
const MOST_ROUNDS: usize = 250;

/// The factor gives ten rounds for a digit. Exchange gains a digit faster, so both meet soon after the shift begins to grow.
const GROWTH: f64 = 1.25;

/// The factor if all points are known and only the proof is missing: cells of half the width have a quarter of the excess.
const GROWTH_OF_PROOF: f64 = 2.0;

/// The largest shift: below the noise of usual measurements. Above it, the outcome is "not proven".
pub(super) const MOST_SHIFT: f64 = 1e-4;

/// The rounds of exchange, and the margin of each.
pub(super) struct Rounds {
    pub count: usize,
    pub shift: f64,
    /// The violation that the next one must halve, and the round in which it was found.
    pub last: (f64, usize),
}

impl Rounds {
    pub(super) fn new() -> Self {
        Rounds { count: 0, shift: SHIFT, last: (f64::INFINITY, 0) }
    }

    /// Notes the largest violation of a round.
    pub(super) fn note(&mut self, violation: f64) {
        if violation < self.last.0 / 2.0 {
            self.last = (violation, self.count);
        }
    }

    /// The shift of the next round; `None` if it would be too large, or after the last round. `is_complete`: all points are known, and only the proof
    /// is missing.
    pub(super) fn next(&mut self, is_complete: bool) -> Option<f64> {
        self.count += 1;
        let is_slow = self.count > SHIFTED_ROUNDS && self.count > self.last.1 + PATIENCE;
        self.shift *= match (is_complete, is_slow) {
            (true, _) => GROWTH_OF_PROOF,
            (false, true) => GROWTH,
            (false, false) => 1.0,
        };
        (self.shift <= MOST_SHIFT && self.count <= MOST_ROUNDS).then_some(self.shift)
    }
}
