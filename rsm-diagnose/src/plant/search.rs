//! Types that the parts of a search for causes share: settings, work limits, accepted causes.
//!
//! In: nothing. Out: types. `selection`, `candidates` and `final_test` use them.

use super::effect_size;
use super::hypotheses::Hypothesis;
use super::levenberg::Fit;
use super::model::Model;
use super::whitened_residuals::WhitenedResiduals;
use rsm_sim::effect::Survey;

/// The amount of work of each stage, as counts instead of seconds: the same records give the same answer on every machine.
#[derive(Debug, Clone, Copy)]
pub struct WorkLimits {
    /// The number of hypotheses whose own parameters are fitted.
    pub profiled: usize,
    /// The number of steps of those fits.
    pub profile_steps: usize,
    /// The number of hypotheses that are fitted together with everything else.
    pub fitted: usize,
    /// The number of steps of those fits.
    pub fit_steps: usize,
    /// The largest number of causes.
    pub causes: usize,
    /// Whether the search ends without a result if one cause does not leave only noise.
    pub one_cause: bool,
    /// The work of simulations after which no further cause is added.
    pub work: u64,
    /// The further work reserved for tests of rivals.
    pub work_for_rivals: u64,
}

/// The reserve for rivals, as a share of the work of a search. A competition takes 300 to 1000 runs of the plant, a search at most 4000. So rivals of
/// one or two causes are tested in any case.
const SHARE_FOR_RIVALS: f64 = 0.25;

impl WorkLimits {
    /// The usual counts, with this limit of the work of simulations.
    #[must_use]
    pub fn within(work: u64) -> Self {
        let work_for_rivals = (SHARE_FOR_RIVALS * work as f64) as u64;
        WorkLimits {
            profiled: 12,
            profile_steps: 5,
            fitted: 5,
            fit_steps: 8,
            causes: 4,
            one_cause: false,
            work,
            work_for_rivals,
        }
    }

    /// The same for a search that ends without a result if one cause does not leave only noise. A second cause may be added: the first one may then
    /// prove superfluous.
    #[must_use]
    pub fn for_one_cause(self) -> Self {
        WorkLimits { one_cause: true, causes: 2, ..self }
    }
}

/// Why a search ended without a result.
#[derive(Debug)]
pub enum Ended {
    /// A first cause alone leaves only noise, and its fit shows that the noise of this search is wrong: a search with other noise must begin.
    WrongNoise(Box<Fit>),
    /// One cause does not leave only noise, and the search was for one cause.
    SeveralCauses,
}

/// An accepted cause.
#[derive(Debug, Clone)]
pub struct AcceptedCause {
    /// Its name in lists.
    pub label: String,
    /// How much the squared residual grows without it.
    pub gain: f64,
    /// Its rivals and how much worse they fit, the best first.
    pub rivals: Vec<(String, f64)>,
    /// Hypotheses with the same trace, which were therefore not fitted.
    pub aliases_not_fitted: Vec<String>,
    /// The rivals as models, for the next experiment.
    pub rival_models: Vec<(String, Model)>,
    /// Whether rivals were tested; false if the work limit was reached first.
    pub rivals_tested: bool,
    /// The plant without it and everything else fitted again. The evidence is relative to this plant.
    pub without: Model,
}

/// A search with its data.
pub struct Search<'a> {
    /// Training records.
    pub whitened: &'a WhitenedResiduals,
    /// Validation records; may be empty.
    pub unseen: &'a WhitenedResiduals,
    /// The nominal plant.
    pub nominal: &'a Model,
    /// The hypotheses.
    pub hypotheses: &'a [Hypothesis],
    /// The scales of the records, which decide whether parameters are plausible.
    pub survey: &'a Survey,
    /// The number of further guesses that were examined to choose these.
    pub further_guesses: usize,
    /// Rounded outputs with their steps.
    pub rounded: &'a [(usize, f64)],
    /// Plants with the causes from the equation errors, fitted, one more cause in each. All of these causes are tested again in the search.
    pub equation_error_fits: &'a [Fit],
    /// The amount of work.
    pub limits: WorkLimits,
    /// Called with progress messages.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl Search<'_> {
    /// The results of the same work for several items, side by side, as [`WhitenedResiduals::jobs`].
    pub(super) fn side_by_side<T: Sync, A: Send>(&self, items: &[T], work: impl Fn(&Search<'_>, &T) -> A + Sync) -> Vec<A> {
        self.whitened.jobs(items, |whitened, item| {
            let unseen = WhitenedResiduals { threads: whitened.threads, work: whitened.work.clone(), ..self.unseen.clone() };
            work(&Search { whitened, unseen: &unseen, ..*self }, item)
        })
    }

    /// The difference of cost above which the better of two explanations is accepted.
    pub(super) fn deciding_difference(&self, fit: &Fit, threshold: f64) -> f64 {
        effect_size::deciding_difference(threshold, fit.cost, self.whitened.rows())
    }
}
