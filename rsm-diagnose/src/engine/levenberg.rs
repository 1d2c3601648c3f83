//! Levenberg-Marquardt: damped steps of least squares (K. Levenberg, 1944; D. W. Marquardt, 1963).
//!
//! In: a [`Problem`], which knows its unknowns and their bounds, and [`Rules`]. Out: the best point that was found. Independent of the meaning of unknowns and residuals.

/// The first damping, as a share of each unknown's own curvature.
const FIRST_DAMPING: f64 = 1e-3;

/// The least: nine digits are what differences hold.
pub(crate) const LEAST_DAMPING: f64 = 1e-9;

/// A damping that follows the least one where a step was none.
const LEAST_MORE: f64 = 1e-6;

/// What is fitted.
pub(crate) trait Problem {
    /// Values of the unknowns with what a simulation there leaves.
    type Place;
    /// Derivatives at a place.
    type Derivatives;
    /// The normal equations of derivatives at a place.
    type Equations;

    /// Squared residual, with priors where there are any.
    fn cost(&self, at: &Self::Place) -> f64;

    /// Derivatives. `None`: the problem cannot be evaluated there.
    fn derivatives(&self, at: &Self::Place) -> Option<Self::Derivatives>;

    /// The normal equations.
    fn equations(&self, at: &Self::Place, derivatives: &Self::Derivatives) -> Self::Equations;

    /// The damped step within the bounds, and by how much it lowers the cost in first order.
    fn step(&self, at: &Self::Place, equations: &Self::Equations, damping: f64) -> (Vec<f64>, f64);

    /// Where a step leads. `None`: the problem cannot be evaluated there.
    fn moved(&self, at: &Self::Place, equations: &Self::Equations, step: &[f64]) -> Option<Self::Place>;

    /// Derivatives corrected by what a step showed. `None`: they are taken anew after each step.
    fn corrected(&self, _: Self::Derivatives, _from: &Self::Place, _to: &Self::Place) -> Option<Self::Derivatives> {
        None
    }

    /// Whether a further step may be begun.
    fn goes_on(&self) -> bool {
        true
    }
}

/// An amount of the cost: the larger of an absolute value and a share of the cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Amount {
    /// So much.
    pub least: f64,
    /// Of the cost.
    pub share: f64,
}

impl Amount {
    fn of(self, cost: f64) -> f64 {
        self.least.max(self.share * cost)
    }
}

/// When a search tries and when it ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rules {
    /// Steps at most.
    pub steps: usize,
    /// Dampings that are tried a step, each ten times the one before: with derivatives of the place, and with corrected ones.
    pub tries: [usize; 2],
    /// A step that promises less is not tried; `None`: every step is.
    pub worth: Option<Amount>,
    /// Whether a step that promises too little is asked for once more with the least damping: an open direction is curved by its prior alone, a millionth as much as records curve each unknown
    /// by itself, and damping would hold it where it happens to be.
    pub undamps: bool,
    /// A step that gains less is the last with these derivatives.
    pub enough: Amount,
    /// The same of a step that gains less than this share of what it promised: the derivatives point elsewhere.
    pub kept_promise: f64,
    /// Whether the search ends only with derivatives of the place where it ends.
    pub ends_exact: bool,
}

/// The damping after a step that lowered the cost.
fn less(damping: f64) -> f64 {
    (damping / 10.0).max(LEAST_DAMPING)
}

/// The damping after a step that did not.
fn more(damping: f64) -> f64 {
    (damping * 10.0).max(LEAST_MORE)
}

/// Steps from a place until they gain little. `derivatives` are those that are known there, and whether they are exact.
///
/// Out: the place, and the equations there if `ends_exact`, else those of the last step. `None` where the problem cannot be evaluated.
pub(crate) fn descend<P: Problem>(
    problem: &P,
    start: P::Place,
    derivatives: Option<(P::Derivatives, bool)>,
    rules: &Rules,
) -> Option<(P::Place, P::Equations)> {
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
            let (step, promised) = problem.step(&at, &equations, damping);
            if rules.worth.is_some_and(|worth| promised < worth.of(problem.cost(&at))) {
                if damping <= LEAST_DAMPING || !rules.undamps {
                    break;
                }
                damping = LEAST_DAMPING;
                continue;
            }
            match problem.moved(&at, &equations, &step).filter(|to| problem.cost(to) < problem.cost(&at)) {
                Some(to) => {
                    damping = less(damping);
                    taken = Some((to, promised));
                    break;
                }
                None => damping = more(damping),
            }
        }
        let mut goes_on = false;
        let mut corrected = Some(derivatives);
        if let Some((to, promised)) = taken {
            let gained = problem.cost(&at) - problem.cost(&to);
            let is_much = gained > rules.enough.of(problem.cost(&to));
            goes_on = is_much && gained > rules.kept_promise * promised;
            exact = exact && !is_much;
            corrected = corrected.and_then(|it| problem.corrected(it, &at, &to));
            at = to;
            steps += 1;
        }
        let is_last = !goes_on || steps >= rules.steps || !problem.goes_on();
        if is_last && (exact || !rules.ends_exact) {
            return Some((at, equations));
        }
        (derivatives, exact) = match corrected.filter(|_| !is_last) {
            Some(corrected) => (corrected, exact),
            None => (problem.derivatives(&at)?, true),
        };
    }
}
