//! Types that the parts of a search for causes share: settings, work limits, accepted causes.
//!
//! In: nothing. Out: types. `selection`, `compete` and `veto` use them.

use super::effect_size;
use super::hypotheses::Hypothesis;
use super::levenberg::Fit;
use super::model::Model;
use super::whitened_residuals::WhitenedResiduals;
use rsm_sim::effect::Survey;

/// How much work a stage may be. Counts, not seconds: the same records give the same answer on every machine.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Hypotheses whose own numbers are fitted.
    pub profiled: usize,
    /// Steps of those fits.
    pub profile_steps: usize,
    /// Hypotheses that are fitted together with everything else.
    pub fitted: usize,
    /// Steps of those fits.
    pub fit_steps: usize,
    /// Causes at most.
    pub causes: usize,
    /// Sub-steps of all simulations after which no cause is looked for any more.
    pub steps: u64,
    /// Further sub-steps that are kept back for the question what else could stand for each cause.
    pub steps_for_rivals: u64,
}

/// Of the work of a search so much again is kept back for rivals. A competition takes 300 to 1000 runs of the plant, a search at most 4000: one or two causes are asked about all the same.
const FOR_RIVALS: f64 = 0.25;

impl Effort {
    /// The usual counts, and this many sub-steps of simulations.
    #[must_use]
    pub fn within(steps: u64) -> Self {
        let steps_for_rivals = (FOR_RIVALS * steps as f64) as u64;
        Effort { profiled: 12, profile_steps: 5, fitted: 5, fit_steps: 8, causes: 4, steps, steps_for_rivals }
    }
}

/// An accepted cause.
#[derive(Debug, Clone)]
pub struct Believed {
    /// Its name in lists.
    pub label: String,
    /// How much worse the fit is without it.
    pub gain: f64,
    /// What competed, with how much worse it does: the best first.
    pub rivals: Vec<(String, f64)>,
    /// Hypotheses of the same trace that were not fitted for that.
    pub alike: Vec<String>,
    /// The rivals as models, for the next experiment.
    pub rival_models: Vec<(String, Model)>,
    /// Whether rivals were looked for; false where the limit of work came first.
    pub asked: bool,
    /// The plant without it, everything else fitted again: what the evidence compares with.
    pub without: Model,
}

/// The search and what it needs.
pub struct Search<'a> {
    /// Training records.
    pub whitened: &'a WhitenedResiduals,
    /// Validation records; may be empty.
    pub unseen: &'a WhitenedResiduals,
    /// The nominal plant.
    pub nominal: &'a Model,
    /// The hypotheses.
    pub hypotheses: &'a [Hypothesis],
    /// Sizes of the records, by which numbers are plausible.
    pub survey: &'a Survey,
    /// How many more guesses were looked at before these were chosen.
    pub looks: usize,
    /// Outputs whose readings are rounded, with their steps.
    pub rounded: &'a [(usize, f64)],
    /// The plant with what the equations say along the recorded signals, term by term, fitted; all of it is asked here again.
    pub said: &'a [Fit],
    /// How much work.
    pub effort: Effort,
    /// Told what happens.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl Search<'_> {
    /// The difference of cost at which the better of two explanations is accepted.
    pub(super) fn decides(&self, fit: &Fit, threshold: f64) -> f64 {
        effect_size::decides(threshold, fit.cost, self.whitened.rows())
    }
}
