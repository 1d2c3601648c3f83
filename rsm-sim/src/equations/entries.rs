//! The numbers of a step by a linear part that change with the directions.
//!
//! In: a list of them. Out: [`Entries`]: the same list by the function from which each is computed, so that a loop over a function needs no choice.

use super::frechet_values::place;

/// A number of a step by a linear part that changes with the directions, by its row and column ([`super::exponential::Block`]).
#[derive(Debug, Clone, Copy)]
pub(super) enum Entry {
    /// h/2 phi_1 of the half.
    Half(usize, usize),
    /// h phi_1.
    Whole(usize, usize),
    /// 2 h phi_3, in the column with this index in the list of columns.
    Bent(usize, usize),
    /// h (phi_2 - 2 phi_3), in such a column.
    Off(usize, usize),
    Rest(Rest),
}

/// An entry that is no derivative of a function of the linear part alone.
#[derive(Debug, Clone, Copy)]
pub(super) enum Rest {
    /// The Jacobian.
    Slope(usize, usize),
    /// (h/2)^2 phi_2 of the half times the derivative of the rates with respect to time.
    HalfTime(usize),
    /// h^2 phi_2 times it.
    WholeTime(usize),
    /// This derivative times h/2.
    HalfSlope(usize),
    /// This derivative times h.
    WholeSlope(usize),
}

/// The entries of a step, each with its index: those of the functions also with their places in the derivatives of these functions
/// ([`place`]), and the rest.
#[derive(Debug, Default)]
pub(super) struct Entries {
    pub count: usize,
    pub half: Vec<(usize, usize)>,
    pub whole: Vec<(usize, usize)>,
    pub bent: Vec<(usize, usize)>,
    pub off: Vec<(usize, usize)>,
    pub rest: Vec<(Rest, usize)>,
}

impl Entries {
    /// For a plant with this number of states.
    pub(super) fn new(n: usize, all: &[Entry]) -> Entries {
        let mut it = Entries { count: all.len(), ..Entries::default() };
        for (k, entry) in all.iter().enumerate() {
            match *entry {
                Entry::Half(i, j) => it.half.push((place(n, i, j), k)),
                Entry::Whole(i, j) => it.whole.push((place(n, i, j), k)),
                Entry::Bent(i, column) => it.bent.push((place(n, i, column), k)),
                Entry::Off(i, column) => it.off.push((place(n, i, column), k)),
                Entry::Rest(rest) => it.rest.push((rest, k)),
            }
        }
        it
    }
}
