//! A tape with the slots of its arguments and of its results.

use rsm_core::tape::Tape;

use crate::code::{Code, Piece, Slot, Way};

/// A tape with the slots of its arguments and of its results.
#[derive(Debug)]
pub(super) struct Placed {
    pub tape: Tape,
    pub arguments: Vec<Slot>,
    pub results: Vec<Slot>,
}

impl Placed {
    pub(super) fn piece(&self) -> Piece {
        Piece::tape(&self.tape, &self.arguments, &self.results)
    }

    pub(super) fn code(&self, lanes: usize, way: Way) -> Code {
        Code::new(&self.tape, &self.arguments, &self.results, lanes, way)
    }
}
