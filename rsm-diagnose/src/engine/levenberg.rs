//! Levenberg-Marquardt: damped steps of least squares (K. Levenberg, 1944; D. W. Marquardt, 1963).
//!
//! In: a [`Problem`] with its unknowns and their bounds, and [`Rules`]. Out: the best point found. Independent of the meaning of unknowns and
//! residuals.

/// The first damping, relative to each unknown's own curvature.
const FIRST_DAMPING: f64 = 1e-3;

/// The smallest damping. Finite differences are accurate to nine digits.
pub(crate) const LEAST_DAMPING: f64 = 1e-9;

/// The damping after a failed step with a smaller damping.
const LEAST_INCREASED_DAMPING: f64 = 1e-6;

/// A least squares problem.
pub(crate) trait Problem {
    /// Values of the unknowns, with the simulation at these values.
    type Iterate;
    /// Derivatives of the residual at a place.
    type Derivatives;
    /// The normal equations at a place.
    type Equations;

    /// The squared residual, plus the priors if there are any.
    fn cost(&self, at: &Self::Iterate) -> f64;

    /// The derivatives at a place. `None` if the problem cannot be evaluated there.
    fn derivatives(&self, at: &Self::Iterate) -> Option<Self::Derivatives>;

    /// The normal equations.
    fn equations(&self, at: &Self::Iterate, derivatives: &Self::Derivatives) -> Self::Equations;

    /// The damped step within the bounds, and the first-order prediction of how much it lowers the cost.
    fn step(&self, at: &Self::Iterate, equations: &Self::Equations, damping: f64) -> (Vec<f64>, f64);

    /// The place after a step. `None` if the problem cannot be evaluated there.
    fn moved(&self, at: &Self::Iterate, equations: &Self::Equations, step: &[f64]) -> Option<Self::Iterate>;

    /// Derivatives updated with the result of a step. `None`: compute them again after each step.
    fn corrected(&self, _: Self::Derivatives, _from: &Self::Iterate, _to: &Self::Iterate) -> Option<Self::Derivatives> {
        None
    }

    /// Whether another step may begin.
    fn may_continue(&self) -> bool {
        true
    }
}

/// An amount of cost: the larger of an absolute value and a share of the current cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CostTolerance {
    /// The absolute value.
    pub absolute: f64,
    /// The share of the cost.
    pub relative: f64,
}

impl CostTolerance {
    fn of(self, cost: f64) -> f64 {
        self.absolute.max(self.relative * cost)
    }
}

/// The rules for trying steps and for ending the search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rules {
    /// The largest number of steps.
    pub steps: usize,
    /// How many dampings to try at each step, each ten times the one before: first with exact derivatives, second with corrected derivatives.
    pub tries: [usize; 2],
    /// A step with a smaller predicted gain is not tried. `None`: every step is tried.
    pub least_predicted_gain: Option<CostTolerance>,
    /// Whether a step with too small a predicted gain is computed once more with the smallest damping. In a direction that the records do not
    /// determine, only the prior has curvature, about a millionth of the curvature that records give a single unknown. Normal damping would stop all
    /// motion in that direction.
    pub retries_undamped: bool,
    /// After a step with a smaller gain, these derivatives are not used again.
    pub least_gain: CostTolerance,
    /// The same, if the gain is less than this share of its prediction: then the derivatives are not accurate.
    pub least_gain_ratio: f64,
    /// Whether the search may end only with exact derivatives at the final place.
    pub ends_exact: bool,
}

/// The damping after a successful step.
fn decreased_damping(damping: f64) -> f64 {
    (damping / 10.0).max(LEAST_DAMPING)
}

/// The damping after a failed step.
fn increased_damping(damping: f64) -> f64 {
    (damping * 10.0).max(LEAST_INCREASED_DAMPING)
}

/// Takes steps until they gain little. `derivatives` are known derivatives at the start, and whether they are exact.
///
/// Returns the final place and the normal equations: those at the final place if `ends_exact`, otherwise those of the last step. `None` if the
/// problem cannot be evaluated.
pub(crate) fn descend<P: Problem>(
    problem: &P,
    start: P::Iterate,
    derivatives: Option<(P::Derivatives, bool)>,
    rules: &Rules,
) -> Option<(P::Iterate, P::Equations)> {
    let mut at = start;
    let (mut derivatives, mut exact) = match derivatives {
        Some(known) => known,
        None => (problem.derivatives(&at)?, true),
    };
    let (mut damping, mut steps) = (FIRST_DAMPING, 0);
    loop {
        let equations = problem.equations(&at, &derivatives);
        let tries = if steps == rules.steps { 0 } else { rules.tries[usize::from(!exact)] };
        let mut taken = None;
        for _ in 0..tries {
            let (step, predicted) = problem.step(&at, &equations, damping);
            if rules.least_predicted_gain.is_some_and(|least| predicted < least.of(problem.cost(&at))) {
                if damping <= LEAST_DAMPING || !rules.retries_undamped {
                    break;
                }
                damping = LEAST_DAMPING;
                continue;
            }
            match problem.moved(&at, &equations, &step).filter(|to| problem.cost(to) < problem.cost(&at)) {
                Some(to) => {
                    damping = decreased_damping(damping);
                    taken = Some((to, predicted));
                    break;
                }
                None => damping = increased_damping(damping),
            }
        }
        let mut continues = false;
        let mut corrected = Some(derivatives);
        if let Some((to, predicted)) = taken {
            let gained = problem.cost(&at) - problem.cost(&to);
            let is_much = gained > rules.least_gain.of(problem.cost(&to));
            continues = is_much && gained > rules.least_gain_ratio * predicted;
            exact = exact && !is_much;
            corrected = corrected.and_then(|it| problem.corrected(it, &at, &to));
            at = to;
            steps += 1;
        }
        let is_last = !continues || steps >= rules.steps || !problem.may_continue();
        if is_last && (exact || !rules.ends_exact) {
            return Some((at, equations));
        }
        (derivatives, exact) = match corrected.filter(|_| !is_last) {
            Some(corrected) => (corrected, exact),
            None => (problem.derivatives(&at)?, true),
        };
    }
}
