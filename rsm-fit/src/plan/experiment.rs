//! Designs from values in memory: factors, a design, and a plan of runs.
//!
//! In: [`Factor`]s and settings, one method for each. Out: the same [`Plan`] as from a specification in TOML, because the same code makes it.
//! Never reads or writes a file.

use rsm_core::source::{Collector, Fault, Faults};

use super::design::{Condition, Criterion, Design, Factor, MOST_RUNS, Optimum};
use super::points::{box_behnken_groups, rotatable_alpha};
use super::rules::{MOST_FACTORS, MOST_ORDER, check_names, check_size};
use super::spec::{DesignSpecification, IN_MEMORY};
use super::{Evaluation, Plan, Runs};
use crate::design::{count_of_terms, monomials_up_to};
use crate::spec::MOST_TERMS;
use crate::units;

/// The axial points of a central composite design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alpha {
    /// Rotatable: the variance of a prediction depends only on the distance from the centre; alpha is the fourth root of 2^factors.
    Rotatable,
    /// On the faces of the cube, at the ends of the range.
    FaceCentred,
    /// At this coded distance from the centre, above 0.
    At(f64),
}

/// An experiment from values in memory. Nothing is checked before [`Experiment::plan`], which reports all faults together.
///
/// ```
/// use rsm_fit::plan::{Alpha, Experiment, Factor};
///
/// let torque = Factor::within("torque", "N*m", [0.0, 20.0]);
/// let speed = Factor::within("speed", "rad/s", [400.0, 800.0]);
/// let plan = Experiment::central_composite([torque, speed], Alpha::FaceCentred).centre_points(3).seed(7).plan()?;
/// assert_eq!(plan.runs.len(), 4 + 4 + 3); // corners, axial points, centre points
/// assert_eq!(plan.factor("torque").unwrap().values[0], 10.0); // the first run is a centre point
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[derive(Debug, Clone)]
pub struct Experiment {
    factors: Vec<Factor>,
    wanted: Wanted,
    seed: u64,
    replicates: usize,
    centre_points: usize,
    conditions: Vec<Sum>,
    order: u32,
}

/// The requested design.
#[derive(Debug, Clone)]
enum Wanted {
    FullFactorial(Vec<Vec<(String, Vec<f64>)>>),
    CentralComposite(Alpha),
    BoxBehnken,
    LatinHypercube(usize),
    Random(usize),
    Sobol(usize),
    MaximinHypercube(usize),
    DefinitiveScreening,
    Optimal(usize, Criterion),
}

/// A weighted sum of factors with a bound.
#[derive(Debug, Clone)]
struct Sum {
    weights: Vec<(String, f64)>,
    at_most: Option<f64>,
    at_least: Option<f64>,
}

impl Factor {
    /// A factor with a continuous range, for every design except the full factorial. Coded -1 and 1 are at its ends.
    #[must_use]
    pub fn within(name: impl Into<String>, unit: impl Into<String>, range: [f64; 2]) -> Self {
        Factor { name: name.into(), unit: unit.into(), levels: Vec::new(), range }
    }

    /// A factor that is set at these levels, for the full factorial.
    #[must_use]
    pub fn at(name: impl Into<String>, unit: impl Into<String>, levels: impl Into<Vec<f64>>) -> Self {
        // + 0.0 makes both zeros equal.
        let levels: Vec<f64> = levels.into().into_iter().map(|level| level + 0.0).collect();
        let least = levels.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Factor { name: name.into(), unit: unit.into(), levels, range: [least, greatest] }
    }
}

impl Experiment {
    fn new(factors: impl IntoIterator<Item = Factor>, wanted: Wanted) -> Self {
        let factors = factors.into_iter().collect();
        Experiment { factors, wanted, seed: 1, replicates: 1, centre_points: 0, conditions: Vec::new(), order: 2 }
    }

    /// Every combination of the levels of all factors.
    ///
    /// ```
    /// use rsm_fit::plan::{Experiment, Factor};
    ///
    /// let gear = Factor::at("gear", "1", [1.0, 2.0, 3.0]);
    /// let speed = Factor::at("speed", "rpm", [1500.0, 3000.0]);
    /// assert_eq!(Experiment::full_factorial([gear, speed]).plan()?.runs.len(), 6);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn full_factorial(factors: impl IntoIterator<Item = Factor>) -> Self {
        Experiment::new(factors, Wanted::FullFactorial(Vec::new()))
    }

    /// The corners of the cube and two axial points a factor (Box, Wilson 1951).
    #[must_use]
    pub fn central_composite(factors: impl IntoIterator<Item = Factor>, alpha: Alpha) -> Self {
        Experiment::new(factors, Wanted::CentralComposite(alpha))
    }

    /// The middles of the edges, for three to seven factors (Box, Behnken 1960).
    ///
    /// ```
    /// use rsm_fit::plan::{Experiment, Factor};
    ///
    /// let factors = ["a", "b", "c"].map(|name| Factor::within(name, "1", [-1.0, 1.0]));
    /// assert_eq!(Experiment::box_behnken(factors).centre_points(3).plan()?.runs.len(), 15);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn box_behnken(factors: impl IntoIterator<Item = Factor>) -> Self {
        Experiment::new(factors, Wanted::BoxBehnken)
    }

    /// This many runs, one in each slice of each factor (McKay, Beckman, Conover 1979).
    ///
    /// ```
    /// use rsm_fit::plan::{Experiment, Factor};
    ///
    /// let factors = ["a", "b"].map(|name| Factor::within(name, "1", [0.0, 1.0]));
    /// let plan = Experiment::latin_hypercube(factors, 20).at_most([("a", 1.0), ("b", 1.0)], 1.2).plan()?;
    /// assert!((0..20).all(|run| plan.factors[0].values[run] + plan.factors[1].values[run] <= 1.2));
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn latin_hypercube(factors: impl IntoIterator<Item = Factor>, runs: usize) -> Self {
        Experiment::new(factors, Wanted::LatinHypercube(runs))
    }

    /// This many independent, uniformly distributed runs.
    #[must_use]
    pub fn random(factors: impl IntoIterator<Item = Factor>, runs: usize) -> Self {
        Experiment::new(factors, Wanted::Random(runs))
    }

    /// This many points of Sobol's sequence, shifted by random bits: they fill the region evenly.
    #[must_use]
    pub fn sobol(factors: impl IntoIterator<Item = Factor>, runs: usize) -> Self {
        Experiment::new(factors, Wanted::Sobol(runs))
    }

    /// A Latin hypercube with the smallest distance between two runs maximised by a search (Morris, Mitchell 1995).
    #[must_use]
    pub fn maximin_hypercube(factors: impl IntoIterator<Item = Factor>, runs: usize) -> Self {
        Experiment::new(factors, Wanted::MaximinHypercube(runs))
    }

    /// Three levels of three to sixteen factors, in about twice as many runs (Jones, Nachtsheim 2011).
    #[must_use]
    pub fn definitive_screening(factors: impl IntoIterator<Item = Factor>) -> Self {
        Experiment::new(factors, Wanted::DefinitiveScreening)
    }

    /// The best runs to estimate the terms of a model: those of second order, or of [`Experiment::order`].
    ///
    /// ```
    /// use rsm_fit::plan::{Criterion, Experiment, Factor};
    ///
    /// let factors = ["a", "b"].map(|name| Factor::within(name, "1", [-1.0, 1.0]));
    /// let plan = Experiment::optimal(factors, 9, Criterion::D).plan()?;
    /// assert_eq!((plan.runs.len(), plan.points()), (9, 9)); // the corners, the middles of the edges, the centre
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn optimal(factors: impl IntoIterator<Item = Factor>, runs: usize, criterion: Criterion) -> Self {
        Experiment::new(factors, Wanted::Optimal(runs, criterion))
    }

    /// The model of an optimal design has all terms up to this order; 2 by default.
    #[must_use]
    pub fn order(mut self, order: u32) -> Self {
        self.order = order;
        self
    }

    /// The seed of the run order and of random points; 1 by default. A seed gives the same plan on every machine.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// The number of runs of every point.
    #[must_use]
    pub fn replicates(mut self, count: usize) -> Self {
        self.replicates = count;
        self
    }

    /// The number of runs of the centre point, spread over the run order.
    #[must_use]
    pub fn centre_points(mut self, count: usize) -> Self {
        self.centre_points = count;
        self
    }

    /// A block of a full factorial: these levels in place of the factors' own. The plan is the union of all blocks; a point in two of them is
    /// run once.
    #[must_use]
    pub fn block<T: Into<String>, L: Into<Vec<f64>>>(mut self, levels: impl IntoIterator<Item = (T, L)>) -> Self {
        if let Wanted::FullFactorial(blocks) = &mut self.wanted {
            blocks.push(levels.into_iter().map(|(name, levels)| (name.into(), Factor::at("", "", levels).levels)).collect());
        }
        self
    }

    /// Keeps points whose weighted sum of factors, in their units, is at most this.
    #[must_use]
    pub fn at_most<T: Into<String>>(mut self, weights: impl IntoIterator<Item = (T, f64)>, bound: f64) -> Self {
        let weights = weights.into_iter().map(|(name, weight)| (name.into(), weight)).collect();
        self.conditions.push(Sum { weights, at_most: Some(bound), at_least: None });
        self
    }

    /// Keeps points whose weighted sum of factors, in their units, is at least this.
    #[must_use]
    pub fn at_least<T: Into<String>>(mut self, weights: impl IntoIterator<Item = (T, f64)>, bound: f64) -> Self {
        let weights = weights.into_iter().map(|(name, weight)| (name.into(), weight)).collect();
        self.conditions.push(Sum { weights, at_most: None, at_least: Some(bound) });
        self
    }

    /// Makes the runs.
    ///
    /// # Errors
    /// Every fault of the settings; if there are none, those of [`Plan::make`].
    ///
    /// ```
    /// use rsm_fit::plan::{Experiment, Factor};
    ///
    /// let backwards = Factor::within("speed", "rpm", [3000.0, 1500.0]);
    /// let faults = Experiment::random([backwards], 10).plan().unwrap_err();
    /// assert_eq!(faults.to_string(), "design: factor `speed`: `range`: low 3000 is not below high 1500");
    /// ```
    pub fn plan(&self) -> Result<Plan, Faults> {
        let mut faults = Collector::new();
        let specification = self.specification(&mut faults);
        Plan::make(&faults.finish(Some(specification))?)
    }

    /// Evaluates the design that [`Experiment::plan`] makes, for the terms up to [`Experiment::order`].
    ///
    /// # Errors
    /// Those of [`Experiment::plan`] and of [`DesignSpecification::evaluate`].
    ///
    /// ```
    /// use rsm_fit::plan::{Alpha, Experiment, Factor};
    ///
    /// let factors = [Factor::within("torque", "N*m", [0.0, 20.0]), Factor::within("speed", "rad/s", [400.0, 800.0])];
    /// let found = Experiment::central_composite(factors, Alpha::Rotatable).centre_points(5).evaluate()?;
    /// assert_eq!((found.runs, found.parameters, found.freedom.pure_error), (13, 6, 4));
    /// assert!((found.leverage.largest - 0.625).abs() < 1e-12); // the corners and the axial points
    /// assert!((found.terms[1].vif.unwrap() - 1.0).abs() < 1e-12); // torque is orthogonal to all other terms
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn evaluate(&self) -> Result<Evaluation, Faults> {
        let mut faults = Collector::new();
        let specification = self.specification(&mut faults);
        let specification = faults.finish(Some(specification))?;
        specification.evaluate(&Runs::of(&Plan::make(&specification)?))
    }

    /// Evaluates other runs for the factors and terms of this experiment.
    ///
    /// # Errors
    /// Every fault of the settings, and those of [`DesignSpecification::evaluate`].
    pub fn evaluate_runs(&self, runs: &Runs) -> Result<Evaluation, Faults> {
        let mut faults = Collector::new();
        let specification = self.specification(&mut faults);
        let specification = faults.finish(Some(specification))?;
        if let Some(point) = runs.points.iter().find(|point| point.len() != specification.factors.len()) {
            let what = format!("a run has {} settings, expected one for each of {} factors", point.len(), self.factors.len());
            return Err(Faults::one(at("", what)));
        }
        specification.evaluate(runs)
    }

    fn specification(&self, faults: &mut Collector) -> DesignSpecification {
        let factors = &self.factors;
        if factors.is_empty() {
            tell(faults, "`factors`: found none, expected at least one".to_string());
        }
        check_names(factors, &at, faults);
        for factor in factors {
            self.check_factor(factor, faults);
        }
        let design = self.design(faults);
        let counts = [("`replicates`", self.replicates, 1), ("`centre_points`", self.centre_points, 0)];
        let runs = design.runs().map(|runs| ("`runs`", runs, 1));
        for (what, count, least) in counts.into_iter().chain(runs) {
            if !(least..=MOST_RUNS).contains(&count) {
                tell(faults, format!("{what}: found {count}, expected a whole number from {least} to {MOST_RUNS}"));
            }
        }
        check_size((&design, factors.len()), (self.replicates, self.centre_points), &at, faults);
        let conditions = self.conditions.iter().enumerate().map(|(k, sum)| self.condition(k, sum, faults)).collect();
        let (replicates, centre_points) = (self.replicates, self.centre_points);
        let terms = self.terms(faults);
        DesignSpecification::in_memory(self.seed, design, factors.clone(), (replicates, centre_points), conditions, terms)
    }

    fn terms(&self, faults: &mut Collector) -> Vec<Vec<u32>> {
        let is_order = (1..=MOST_ORDER).contains(&self.order);
        let are_few = is_order && count_of_terms(self.factors.len(), self.order) <= MOST_TERMS;
        if !is_order || !are_few && matches!(self.wanted, Wanted::Optimal(..)) {
            let what = format!("`order`: found {}, expected 1 to {MOST_ORDER} and at most {MOST_TERMS} terms", self.order);
            tell(faults, what);
        }
        if are_few { monomials_up_to(self.factors.len(), self.order) } else { Vec::new() }
    }

    fn check_factor(&self, factor: &Factor, faults: &mut Collector) {
        let who = format!("factor `{}`", factor.name);
        if let Err(reason) = units::check(&factor.unit) {
            tell(faults, format!("{who}: `unit`: {reason}"));
        }
        if matches!(self.wanted, Wanted::FullFactorial(_)) {
            check_levels(&who, &factor.levels, faults);
        } else {
            let [low, high] = factor.range;
            let may_have_levels = matches!(self.wanted, Wanted::Optimal(..));
            if may_have_levels && !factor.levels.is_empty() {
                check_levels(&who, &factor.levels, faults);
            } else if !factor.levels.is_empty() {
                tell(faults, format!("{who}: levels belong to the full factorial only; give a range"));
            } else if !(low.is_finite() && high.is_finite()) {
                tell(faults, format!("{who}: `range`: found [{low}, {high}], expected finite numbers"));
            } else if low >= high {
                tell(faults, format!("{who}: `range`: low {low} is not below high {high}"));
            }
        }
    }

    fn design(&self, faults: &mut Collector) -> Design {
        let count = self.factors.len();
        match &self.wanted {
            Wanted::FullFactorial(blocks) => {
                let own: Vec<Vec<f64>> = self.factors.iter().map(|factor| factor.levels.clone()).collect();
                let mut all = Vec::new();
                for (k, block) in blocks.iter().enumerate() {
                    let mut levels = own.clone();
                    for (name, given) in block {
                        check_levels(&format!("block {}: `{name}`", k + 1), given, faults);
                        if let Some(index) = self.factor_named(&format!("block {}", k + 1), name, faults) {
                            levels[index].clone_from(given);
                        }
                    }
                    all.push(levels);
                }
                Design::FullFactorial { blocks: if all.is_empty() { vec![own] } else { all } }
            }
            Wanted::CentralComposite(alpha) => {
                let alpha = match alpha {
                    Alpha::Rotatable => rotatable_alpha(count.min(MOST_FACTORS)),
                    Alpha::FaceCentred => 1.0,
                    Alpha::At(alpha) => *alpha,
                };
                if !(alpha > 0.0 && alpha.is_finite()) {
                    tell(faults, format!("`alpha`: found {alpha}, expected a number above 0"));
                }
                Design::CentralComposite { alpha }
            }
            Wanted::BoxBehnken => {
                if box_behnken_groups(count).is_none() {
                    tell(faults, format!("\"box-behnken\" has 3 to 7 factors, found {count}"));
                }
                Design::BoxBehnken
            }
            Wanted::LatinHypercube(runs) => Design::LatinHypercube { runs: *runs },
            Wanted::Random(runs) => Design::Random { runs: *runs },
            Wanted::Sobol(runs) => Design::Sobol { runs: *runs },
            Wanted::MaximinHypercube(runs) => Design::MaximinHypercube { runs: *runs },
            Wanted::DefinitiveScreening => {
                if !(3..=MOST_FACTORS).contains(&count) {
                    tell(faults, format!("\"definitive-screening\" has 3 to {MOST_FACTORS} factors, found {count}"));
                }
                Design::DefinitiveScreening
            }
            Wanted::Optimal(runs, criterion) => Design::Optimal(Optimum {
                criterion: *criterion,
                runs: *runs,
                block_sizes: Vec::new(),
                mandatory: Vec::new(),
                candidates: None,
                restarts: None,
            }),
        }
    }

    fn condition(&self, k: usize, sum: &Sum, faults: &mut Collector) -> Condition {
        let who = format!("condition {}", k + 1);
        let mut weights = vec![0.0; self.factors.len()];
        for (name, weight) in &sum.weights {
            if let Some(index) = self.factor_named(&who, name, faults) {
                weights[index] = *weight;
            }
        }
        for value in weights.iter().chain(&sum.at_most).chain(&sum.at_least).filter(|value| !value.is_finite()) {
            tell(faults, format!("{who}: found {value}, expected a finite number"));
        }
        Condition { weights, at_most: sum.at_most, at_least: sum.at_least }
    }

    fn factor_named(&self, who: &str, name: &str, faults: &mut Collector) -> Option<usize> {
        let found = self.factors.iter().position(|factor| factor.name == name);
        if found.is_none() {
            let known: Vec<String> = self.factors.iter().map(|factor| format!("`{}`", factor.name)).collect();
            let fault = Fault::whole_file(IN_MEMORY, format!("{who}: there is no factor `{name}`"));
            faults.push(fault.help(format!("the factors are {}", known.join(", "))));
        }
        found
    }
}

fn check_levels(who: &str, levels: &[f64], faults: &mut Collector) {
    if levels.is_empty() {
        tell(faults, format!("{who}: `levels`: found none, expected at least one"));
    }
    for (k, level) in levels.iter().enumerate() {
        if !level.is_finite() {
            tell(faults, format!("{who}: `levels`: found {level}, expected a finite number"));
        } else if levels[..k].contains(level) {
            tell(faults, format!("{who}: `levels`: {level} occurs twice"));
        }
    }
}

fn at(_: &str, what: String) -> Fault {
    Fault::whole_file(IN_MEMORY, what)
}

fn tell(faults: &mut Collector, what: String) {
    faults.push(at("", what));
}
