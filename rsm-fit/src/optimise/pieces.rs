//! Sums of maxima of smooth functions at one point.
//!
//! In: the values and exact gradients of smooth functions. Out: groups of pieces; the value of a group is its weight times its largest piece.

/// A function with its gradient.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub value: f64,
    pub gradient: Vec<f64>,
}

/// The largest of some pieces, times a weight above 0.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub weight: f64,
    pub pieces: Vec<Piece>,
}

impl Group {
    pub(super) fn value(&self) -> f64 {
        self.weight * self.pieces.iter().map(|piece| piece.value).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The sum of the groups.
pub(super) fn value(groups: &[Group]) -> f64 {
    groups.iter().map(Group::value).sum()
}
