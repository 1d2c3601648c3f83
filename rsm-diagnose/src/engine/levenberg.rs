//! Levenberg-Marquardt: damped steps of least squares (K. Levenberg, 1944; D. W. Marquardt, 1963).
//!
//! In: a [`Problem`] with its unknowns and their bounds, and [`Rules`]. Out: the best point found. Independent of the meaning of unknowns and
//! residuals.

/// The first damping, relative to each unknown's own curvature.
const FIRST_DAMPING: f64 = 1e-3;

/// The smallest damping. Finite differences are accurate to nine digits.
pub(crate) const LEAST_DAMPING: f64 = 1e-9;

/// The damping falls by this factor after a successful step.
const DAMPING_DECREASE: f64 = 10.0;

/// The same along a curved valley. Two unknowns that nearly cancel have a millionth of their own curvature along their common direction, so even a
/// small damping shortens the step there.
const DAMPING_DECREASE_IN_VALLEY: f64 = 1000.0;

/// The largest number of steps with the same derivatives that lead back to the bottom of a curved valley. Each of them lowers the cost four- to
/// tenfold there, eight of them by 10^5 to 10^8.
const MOST_RETURNS: usize = 8;

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
    /// Whether steps are long along a curved valley: the damping falls faster, and a step that raises the cost may be followed by steps with the same
    /// derivatives, while each of them halves the cost. A full step along such a valley ends high on its side.
    pub follows_valleys: bool,
    /// Whether the search may end only with exact derivatives at the final place.
    pub ends_exact: bool,
}

/// The damping after a successful step.
fn decreased_damping(damping: f64, decrease: f64) -> f64 {
    (damping / decrease).max(LEAST_DAMPING)
}

/// The damping after a failed step.
fn increased_damping(damping: f64) -> f64 {
    (damping * 10.0).max(LEAST_INCREASED_DAMPING)
}

/// The place after a step, if its cost is lower than before. If the cost is higher, steps with the same derivatives follow while they halve it.
fn moved_below<P: Problem>(
    problem: &P,
    at: &P::Iterate,
    (derivatives, equations): (&P::Derivatives, &P::Equations),
    (step, damping): (Vec<f64>, f64),
    returns: usize,
) -> Option<P::Iterate> {
    let mut to = problem.moved(at, equations, &step)?;
    for _ in 0..returns {
        if problem.cost(&to) < problem.cost(at) {
            return Some(to);
        }
        let there = problem.equations(&to, derivatives);
        let (step, _) = problem.step(&to, &there, damping);
        let next = problem.moved(&to, &there, &step)?;
        if problem.cost(&next) > 0.5 * problem.cost(&to) {
            return None;
        }
        to = next;
    }
    (problem.cost(&to) < problem.cost(at)).then_some(to)
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
    let (decrease, returns) =
        if rules.follows_valleys { (DAMPING_DECREASE_IN_VALLEY, MOST_RETURNS) } else { (DAMPING_DECREASE, 0) };
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
            match moved_below(problem, &at, (&derivatives, &equations), (step, damping), returns) {
                Some(to) => {
                    damping = decreased_damping(damping, decrease);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::normal::{Normal, symmetric};

    /// A gain and the logarithm of a friction. Records show their ratio a thousand times as well as the friction, so the minimum is at the end of a
    /// curved valley. With `exact` the derivatives are computed at each place, else they stay those of the first place.
    struct Ratio {
        exact: bool,
        computed: std::cell::Cell<usize>,
    }

    const RATIO: f64 = 1e4;
    const FRICTION: f64 = 10.0;

    fn residual([gain, friction]: [f64; 2]) -> [f64; 2] {
        [RATIO * (gain / friction.exp() - 1.0), FRICTION * friction]
    }

    impl Problem for Ratio {
        type Iterate = [f64; 2];
        type Derivatives = [[f64; 2]; 2];
        type Equations = ([f64; 4], [f64; 2]);

        fn cost(&self, at: &[f64; 2]) -> f64 {
            residual(*at).iter().map(|it| it * it).sum()
        }

        fn derivatives(&self, [gain, friction]: &[f64; 2]) -> Option<[[f64; 2]; 2]> {
            self.computed.set(self.computed.get() + 1);
            Some([[RATIO / friction.exp(), 0.0], [-RATIO * gain / friction.exp(), FRICTION]])
        }

        fn equations(&self, at: &[f64; 2], columns: &[[f64; 2]; 2]) -> ([f64; 4], [f64; 2]) {
            let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
            let matrix = symmetric(2, |i, j| dot(columns[i], columns[j]));
            ([matrix[0], matrix[1], matrix[2], matrix[3]], columns.map(|column| -dot(column, residual(*at))))
        }

        fn step(&self, _: &[f64; 2], (matrix, right): &([f64; 4], [f64; 2]), damping: f64) -> (Vec<f64>, f64) {
            let step = Normal::new(matrix, 2, damping).solve(right);
            let predicted = step.iter().zip(right).map(|(step, right)| step * right).sum();
            (step, predicted)
        }

        fn moved(&self, at: &[f64; 2], _: &([f64; 4], [f64; 2]), step: &[f64]) -> Option<[f64; 2]> {
            Some([at[0] + step[0], at[1] + step[1]])
        }

        fn corrected(&self, columns: [[f64; 2]; 2], _: &[f64; 2], _: &[f64; 2]) -> Option<[[f64; 2]; 2]> {
            (!self.exact).then_some(columns)
        }
    }

    #[test]
    fn a_curved_valley_is_followed_in_a_few_steps() {
        let enough = CostTolerance { absolute: 1e-9, relative: 0.0 };
        let rules = Rules {
            steps: 8,
            tries: [5, 2],
            least_predicted_gain: Some(enough),
            retries_undamped: true,
            least_gain: enough,
            least_gain_ratio: 0.5,
            follows_valleys: true,
            ends_exact: true,
        };
        for exact in [true, false] {
            for friction in [0.1, 0.2, 0.3, -0.1, -0.2, -0.3] {
                let problem = Ratio { exact, computed: std::cell::Cell::new(0) };
                let (at, _) = descend(&problem, [f64::exp(friction), friction], None, &rules).unwrap();
                // A thousandth of one standard deviation of noise.
                assert!(problem.cost(&at) < 1e-3, "{exact} {friction}: {at:?} costs {}", problem.cost(&at));
                assert!(problem.computed.get() <= 9, "{exact} {friction}: {}", problem.computed.get());
            }
        }
    }
}
