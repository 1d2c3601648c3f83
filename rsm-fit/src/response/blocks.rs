//! The blocks of a response: further inputs of its fit that are no inputs of its surface.
//!
//! In: a task with blocks, a surface. Out: the surface with the contrasts of the blocks for the fit, and without them for all that is written.

use rsm_core::model::{Input, Surface, Term};
use rsm_core::source::Faults;

use super::Task;
use crate::blocks::{Blocks, BlocksReport};
use crate::canonical;
use crate::outcome::{Progress, ResponseOutcome};
use crate::qr::Growing;
use crate::statistics::ResponseStatistics;

impl Task<'_> {
    /// Chooses the form, fits, and sets the surface's sigmoids and terms. Blocks are further inputs of the fit, and no inputs of the surface.
    pub(crate) fn run(&self, surface: &mut Surface, progress: &mut dyn FnMut(Progress<'_>)) -> Result<ResponseOutcome, Faults> {
        let Some(blocks) = self.blocks else { return self.run_whole(surface, progress) };
        let mut whole = blocks.with(surface);
        let mut outcome = self.run_whole(&mut whole, progress)?;
        *surface = self.own(&whole);
        if let Some(statistics) = &mut outcome.statistics {
            let inputs = surface.inputs.len();
            statistics.keep_terms(&mut |powers| blocks.without(powers, inputs));
        }
        Ok(outcome)
    }

    /// The surface without the contrasts of blocks, which is its mean over the blocks.
    pub(super) fn own(&self, surface: &Surface) -> Surface {
        let Some(blocks) = self.blocks else { return surface.clone() };
        let mut own = surface.clone();
        let inputs = own.inputs.len() - blocks.width();
        own.inputs.truncate(inputs);
        own.categories.pop();
        let term = |term: &Term| Some(Term { powers: blocks.without(&term.powers, inputs)?, ..*term });
        own.terms = surface.terms.iter().filter_map(term).collect();
        own
    }

    /// The places of the terms of [`Task::own`] among those of the surface.
    pub(super) fn own_places(&self, surface: &Surface) -> Vec<usize> {
        let Some(blocks) = self.blocks else { return (0..surface.terms.len()).collect() };
        let inputs = surface.inputs.len() - blocks.width();
        (0..surface.terms.len()).filter(|k| blocks.without(&surface.terms[*k].powers, inputs).is_some()).collect()
    }

    /// The inputs without the contrasts of blocks.
    pub(crate) fn own_inputs(&self) -> &[Input] {
        &self.inputs[..self.inputs.len() - self.blocks.map_or(0, Blocks::width)]
    }

    /// The stationary point and the support of the surface itself.
    pub(super) fn add_shape(&self, surface: &Surface, statistics: &mut ResponseStatistics) {
        let own = self.own(surface);
        statistics.canonical = canonical::analyse(&own, self.own_inputs());
        statistics.support = self.support(&own);
    }

    /// The effects of the blocks. `solution`: the solved terms with the residual mean square, if the coefficients have standard errors.
    pub(super) fn blocks_of(&self, terms: &[Term], solution: Option<(&Growing, f64)>) -> Option<BlocksReport> {
        let inputs = self.own_inputs().len();
        Some(self.blocks?.report(terms, inputs, solution, &self.fit.columns[inputs..]))
    }
}
