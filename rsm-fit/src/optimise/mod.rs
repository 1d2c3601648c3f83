//! The best settings for several responses at once, and fronts of responses that contradict one another.
//!
//! In: a checked model and a [`Study`]. Out: an [`Optimum`] or a [`Front`]. The search uses the exact gradients of the surfaces, from many starts
//! of a seed. It finds local optima and takes the best one; nothing proves that there is no better one. No coefficient is changed here, and no file
//! is written.

mod descent;
mod desirability;
mod front;
mod limits;
mod pieces;
mod program;
mod read;
mod study;
mod surfaces;

use rsm_core::check::Checked;
use rsm_core::order;
use rsm_core::source::Faults;
use serde::Serialize;

use crate::random::Random;
use crate::statistics::Named;
use descent::minimum;
use limits::Limits;
use pieces::{Group, value};
use surfaces::Surfaces;

pub use desirability::Goal;
pub use front::Front;
pub use limits::Limit;
pub use study::{Study, Sum, Wish};

/// Up to this part of the way to the best value, the logarithm of a desirability goes on along its tangent. A search begins with the first one.
const LEAST_SHARES: [f64; 3] = [1e-2, 1e-4, 1e-8];

/// The weight of a violated limit in the search, in units of the logarithm of the total desirability, and its growth if limits are still violated.
const PENALTY: f64 = 1e3;
const STRONGER: f64 = 1e3;

/// The number of points, per start, of which the best ones are starts.
const POINTS_A_START: usize = 16;

/// Two searches ended at the same optimum if their total desirabilities differ by less: ten times what a search leaves.
const SAME: f64 = 1e-6;

/// The best settings that were found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Optimum {
    /// The settings of the inputs, in the units of the model.
    pub settings: Named<f64>,
    /// The responses, in the order of the study.
    pub responses: Vec<ResponseValue>,
    /// The total desirability, from 0 to 1.
    pub desirability: f64,
    /// Limits that these settings touch.
    pub active: Vec<Limit>,
    /// Limits that these settings violate, because no settings that hold all were found. Empty if all hold.
    pub violated: Vec<Limit>,
    /// The number of searches,
    pub starts: usize,
    /// and how many of them ended with the same total desirability.
    pub agreeing: usize,
}

/// A response at settings.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseValue {
    /// Its name.
    pub response: String,
    /// Its unit.
    pub unit: String,
    /// Its goal: `maximise`, `minimise`, `target` or `range`.
    pub goal: &'static str,
    /// The prediction of the surface, with the bits of the evaluators.
    pub value: f64,
    /// Its desirability.
    pub desirability: f64,
}

impl Optimum {
    /// Whether all limits hold and every response is acceptable.
    #[must_use]
    pub fn is_acceptable(&self) -> bool {
        self.violated.is_empty() && self.desirability > 0.0
    }
}

impl Study {
    /// Finds the best settings for a model.
    ///
    /// # Errors
    /// Every fault of the study with this model.
    pub fn optimise(&self, checked: &Checked) -> Result<Optimum, Faults> {
        self.check(checked)?;
        let names: Vec<&str> = self.responses.iter().map(|wish| wish.response.as_str()).collect();
        let limits = |input: &rsm_core::model::Input| self.limits_of(input);
        let surfaces = Surfaces::new(checked, &names, &limits);
        let search = Search::new(self, &surfaces);
        let objective = |coded: &[f64], least: f64, penalty: f64| search.goals(coded, least, penalty);
        let first = |coded: &[f64]| objective(coded, LEAST_SHARES[0], PENALTY);
        let mut ends = Vec::new();
        for start in search.starts(&first, self.starts) {
            let mut x = start;
            for least in LEAST_SHARES {
                x = minimum(&|coded: &[f64]| objective(coded, least, PENALTY), &x, &search.ends).0;
            }
            if search.excess(&x) > 0.0 {
                x = minimum(&|coded: &[f64]| objective(coded, LEAST_SHARES[2], PENALTY * STRONGER), &x, &search.ends).0;
            }
            let found = search.optimum(&x);
            let left = value(&objective(&x, LEAST_SHARES[2], PENALTY));
            ends.push((found, left));
        }
        // The first of equal ones, so that the order of starts decides and not rounding.
        let (mut best, _) = ends
            .iter()
            .enumerate()
            .reduce(|best, next| if is_better(next.1, best.1) { next } else { best })
            .map(|(_, best)| best.clone())
            .expect("there is a start");
        best.starts = ends.len();
        let agrees = |it: &&(Optimum, f64)| {
            it.0.violated.is_empty() == best.violated.is_empty() && (it.0.desirability - best.desirability).abs() <= SAME
        };
        best.agreeing = ends.iter().filter(agrees).count();
        Ok(best)
    }

    fn limits_of(&self, input: &rsm_core::model::Input) -> [f64; 2] {
        self.limits.iter().find(|(name, _)| *name == input.name).map_or(input.range, |(_, limits)| *limits)
    }
}

/// Settings that hold all limits are better, then a larger desirability, then a smaller objective.
fn is_better((one, left): &(Optimum, f64), (other, others): &(Optimum, f64)) -> bool {
    let holds = |it: &Optimum| it.violated.is_empty();
    if holds(one) != holds(other) {
        return holds(one);
    }
    if holds(one) && one.desirability.max(other.desirability) > 0.0 {
        return one.desirability > other.desirability + 1e-12;
    }
    left < others
}

/// The search of a study over its surfaces.
struct Search<'a> {
    study: &'a Study,
    surfaces: &'a Surfaces<'a>,
    limits: Limits<'a>,
    ends: Vec<[f64; 2]>,
    /// Random points of the box, in coded variables.
    pool: Vec<Vec<f64>>,
}

impl<'a> Search<'a> {
    fn new(study: &'a Study, surfaces: &'a Surfaces<'a>) -> Search<'a> {
        let mut random = Random::new(study.seed);
        let width = surfaces.free.len();
        let mut point = || (0..width).map(|_| 2.0 * random.share() - 1.0).collect::<Vec<f64>>();
        let count = if width == 0 { 1 } else { study.starts * POINTS_A_START };
        let pool: Vec<Vec<f64>> = (0..count).map(|_| point()).collect();
        let limits = Limits::new(study, surfaces, &pool);
        Search { study, surfaces, limits, ends: vec![[-1.0, 1.0]; width], pool }
    }

    /// Starts: half of them are the best points of the pool, the others its first points.
    fn starts(&self, function: descent::Function<'_>, count: usize) -> Vec<Vec<f64>> {
        let mut values: Vec<(usize, f64)> =
            self.pool.iter().enumerate().map(|(k, point)| (k, value(&function(point)))).collect();
        order::ascending(&mut values, |it| it.1);
        let mut places: Vec<usize> = values.iter().take(count.div_ceil(2)).map(|(k, _)| *k).collect();
        for k in 0..self.pool.len() {
            if places.len() < count && !places.contains(&k) {
                places.push(k);
            }
        }
        places.into_iter().map(|k| self.pool[k].clone()).collect()
    }

    /// Minus the logarithm of the total desirability, and the penalties of limits.
    fn goals(&self, coded: &[f64], least: f64, penalty: f64) -> Vec<Group> {
        let responses = self.surfaces.responses(coded);
        let wishes = self.study.responses.iter().zip(&responses).filter(|(wish, _)| wish.goal.is_objective());
        let sum: f64 = wishes.clone().map(|(wish, _)| wish.importance).sum();
        let group =
            |(wish, response): (&Wish, _)| Group { weight: wish.importance / sum, pieces: wish.goal.pieces(response, least) };
        wishes.map(group).chain(self.limits.penalties(coded, &responses, penalty)).collect()
    }

    /// The largest violation of a limit, 0 if all hold.
    fn excess(&self, coded: &[f64]) -> f64 {
        self.limits.at(coded).iter().map(|limit| limit.excess).fold(0.0, f64::max)
    }

    fn optimum(&self, coded: &[f64]) -> Optimum {
        let settings = self.surfaces.settings(coded);
        let responses = self.values(&settings);
        let (active, violated) = self.limits.active_and_violated(coded);
        let desirability = self.total(&responses);
        let names = self.surfaces.inputs.iter().map(|input| input.name.clone());
        let settings = Named(names.zip(settings).collect());
        Optimum { settings, responses, desirability, active, violated, starts: 1, agreeing: 1 }
    }

    fn values(&self, settings: &[f64]) -> Vec<ResponseValue> {
        let of_one = |(k, wish): (usize, &Wish)| {
            let value = self.surfaces.value(k, settings);
            let desirability = self.limits.desirability(k, value);
            let unit = self.surfaces.unit(k).to_string();
            ResponseValue { response: wish.response.clone(), unit, goal: wish.goal.name(), value, desirability }
        };
        self.study.responses.iter().enumerate().map(of_one).collect()
    }

    /// The weighted geometric mean of the desirabilities; ranges take part if they do not hold.
    fn total(&self, values: &[ResponseValue]) -> f64 {
        if values.iter().any(|it| it.desirability <= 0.0) {
            return 0.0;
        }
        let objectives = || self.study.responses.iter().zip(values).filter(|(wish, _)| wish.goal.is_objective());
        let sum: f64 = objectives().map(|(wish, _)| wish.importance).sum();
        if sum == 0.0 {
            return 1.0;
        }
        (objectives().map(|(wish, it)| wish.importance * it.desirability.ln()).sum::<f64>() / sum).exp()
    }
}
