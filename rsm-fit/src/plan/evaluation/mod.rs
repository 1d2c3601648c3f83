//! The evaluation of a design before it is run: what its runs can determine, for the terms of a model.
//!
//! In: a [`DesignSpecification`] (factors, terms, region) and [`Runs`]. Out: an [`Evaluation`]. No response is needed. The definitions are those of
//! the search for optimal designs: rows of coded terms, contrasts of blocks after them, the same region and the same moments.
//!
//! Sources: Myers, Montgomery, Anderson-Cook, Response Surface Methodology, chapter 8 (efficiencies, scaled variance, alias matrix); Kiefer,
//! Wolfowitz 1960 (the bound of G); Zahran, Anderson-Cook, Myers 2003 (fraction of design space); Marquardt 1970 (variance inflation).

mod basis;
mod power;
mod runs;

use rsm_core::order;
use std::collections::BTreeSet;

use rsm_core::model::Surface;
use rsm_core::source::{Collector, Faults};
use serde::Serialize;

use super::optimal::{Space, Variance, dot};
use super::optimum::{coded, space};
use super::{Design, DesignSpecification, bits, physical};
use crate::design::{count_of_terms, monomials_up_to, order};
use crate::spec::MOST_TERMS;
use crate::statistics::Named;
use basis::Basis;

pub use runs::Runs;

/// The largest number of entries (runs times columns) of a design: 160 MB for its basis.
const MOST_ENTRIES: usize = 20_000_000;

/// The shares of the region for which a bound of the variance is given.
const SHARES: [f64; 6] = [0.1, 0.25, 0.5, 0.75, 0.9, 0.95];

/// Leverages and entries of the alias matrix within this are equal: both are of size 1, with errors of about 1e-14.
const EQUAL: f64 = 1e-9;

/// What a design can determine.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// The number of runs, N.
    pub runs: usize,
    /// The number of different points; in a design with blocks, points in different blocks are different.
    pub points: usize,
    /// The number of runs outside the region of the specification, such as the axial points of a rotatable design.
    pub runs_outside: usize,
    /// The number of columns of the design, p: the terms and the contrasts of blocks.
    pub parameters: usize,
    /// The number of terms.
    pub terms_of_model: usize,
    /// The number of parameters that the runs can determine.
    pub rank: usize,
    /// The efficiencies, 1 for the ideal.
    pub efficiency: Efficiency,
    /// The variance of predictions over the region; `None` if a term cannot be estimated.
    pub prediction: Option<PredictionVariance>,
    /// Degrees of freedom.
    pub freedom: Freedom,
    /// The leverages of the runs.
    pub leverage: Leverage,
    /// The terms of the model, in its order.
    pub terms: Vec<TermEvaluation>,
    /// Relations between columns that hold at every run. Empty if all terms can be estimated.
    pub dependent: Vec<Relation>,
    /// The terms of one order more than the model, or missing in it, that change an estimated coefficient: the alias matrix without its zeros.
    /// `None` if there are more than 1000 such terms.
    pub aliases: Option<Vec<AliasRow>>,
}

/// Efficiencies of a design with information matrix X'X of N runs and p parameters.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Efficiency {
    /// |X'X|^(1/p)/N: 1 for an orthogonal design with all settings at the ends of the ranges; 0 if a term cannot be estimated.
    pub d: f64,
    /// p/(N tr (X'X)^-1) over the terms: 1 for the same design.
    pub a: Option<f64>,
    /// p/(largest scaled variance): 1 for the best possible design measure (Kiefer, Wolfowitz 1960).
    pub g: Option<f64>,
    /// p/(mean scaled variance): 1 for runs that are spread evenly over the region. A good design exceeds 1.
    pub i: Option<f64>,
}

/// The scaled variance of predictions: N f'(X'X)^-1 f, the variance of a prediction times the number of runs, in units of the noise variance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PredictionVariance {
    /// Its mean over the region: N times the criterion I.
    pub mean: f64,
    /// Its largest value that was found,
    pub max: f64,
    /// and the point, in the units of the factors.
    pub at: Named<f64>,
    /// Its bounds for shares of the region (fraction of design space).
    pub quantiles: Vec<Quantile>,
    /// The number of points that represent the region in the quantiles.
    pub sample: usize,
}

/// The share of the region in which the scaled variance is at most this value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantile {
    /// The share.
    pub share: f64,
    /// The value.
    pub value: f64,
}

/// Degrees of freedom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Freedom {
    /// Of the residual: runs without parameters.
    pub residual: usize,
    /// Of lack of fit: different points without parameters.
    pub lack_of_fit: usize,
    /// Of pure error: repeated runs.
    pub pure_error: usize,
}

/// The leverages of the runs: the weight of a run in its own prediction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Leverage {
    /// Their mean, parameters over runs.
    pub mean: f64,
    /// The largest.
    pub largest: f64,
    /// The numbers of the runs that have it.
    pub runs: Vec<u32>,
    /// The leverage of every run, in the order of the runs.
    pub of_runs: Vec<f64>,
}

/// A term of the model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermEvaluation {
    /// Its name.
    pub term: String,
    /// Its powers, in the order of the factors.
    pub powers: Vec<u32>,
    /// Whether the runs determine its coefficient. If not, all that follows is `None`.
    pub estimable: bool,
    /// The variance of its coefficient, in units of the noise variance.
    pub variance: Option<f64>,
    /// Variance inflation: the variance relative to a model with this term alone. `None` for the constant.
    pub vif: Option<f64>,
    /// The probability that a test at 5 % finds the term if its effect is one and two standard deviations of the noise. The effect is the change of
    /// the response that the term alone causes over the region: twice the coefficient, or the coefficient if all powers are even. `None` for the
    /// constant, and without degrees of freedom of the residual.
    pub power: Option<[f64; 2]>,
}

/// A relation between columns of a design.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Relation {
    /// The column that the others make up.
    pub term: String,
    /// The relation in words, as `a^2 = b^2`.
    pub relation: String,
}

/// What changes the estimate of a coefficient.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AliasRow {
    /// The term of the model.
    pub term: String,
    /// The terms that the model does not have. If the response contains one of them, its coefficient times `factor` is added to the estimate.
    pub with: Vec<Alias>,
}

/// An entry of the alias matrix.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alias {
    /// A term that the model does not have.
    pub term: String,
    /// The entry.
    pub factor: f64,
}

impl Evaluation {
    /// Whether the runs determine every parameter.
    #[must_use]
    pub fn is_estimable(&self) -> bool {
        self.rank == self.parameters
    }
}

impl DesignSpecification {
    /// Evaluates runs for the terms of this specification.
    ///
    /// # Errors
    /// If there is no run, no term or no point of the region, or if the design is too large.
    pub fn evaluate(&self, runs: &Runs) -> Result<Evaluation, Faults> {
        let mut faults = Collector::new();
        let space = region(self);
        let contrasts = (runs.blocks.iter().collect::<BTreeSet<_>>().len()).saturating_sub(1);
        let parameters = space.terms.len() + contrasts;
        let entries = runs.points.len().saturating_mul(parameters);
        if runs.points.is_empty() {
            faults.push(self.fault("factors", "the design has no run, expected at least one"));
        }
        if let Some(run) = runs.points.iter().position(|point| point.iter().any(|x| !x.is_finite())) {
            faults.push(self.fault("factors", format!("run {}: found a setting that is not finite", run + 1)));
        }
        if space.terms.is_empty() {
            faults.push(self.fault("order", format!("the model has no term or too many, expected 1 to {MOST_TERMS}")));
        }
        if entries > MOST_ENTRIES {
            let what = format!(
                "{} runs with {parameters} parameters have {entries} numbers, at most {MOST_ENTRIES} are accepted",
                runs.points.len()
            );
            faults.push(self.fault("factors", what).help("evaluate fewer runs, or a model with fewer terms"));
        }
        faults.finish(Some(()))?;
        let sample = space.sample();
        if sample.is_empty() {
            return Err(Faults::one(self.fault("where", "`where`: no point within the ranges was found that fulfils it")));
        }
        Ok(evaluated(self, &space, runs, &sample))
    }
}

/// The region of predictions: that of an optimal design has its levels or candidates; that of any other design is continuous.
fn region(specification: &DesignSpecification) -> Space {
    let mut space = space(specification);
    for (levels, factor) in space.levels.iter_mut().zip(&specification.factors) {
        // A factor with a single level is always at its coded 0.
        if factor.range[0] >= factor.range[1] {
            *levels = Some(vec![0.0]);
        } else if !matches!(specification.design, Design::Optimal(_)) {
            *levels = None;
        }
    }
    space
}

fn evaluated(specification: &DesignSpecification, space: &Space, runs: &Runs, sample: &[Vec<f64>]) -> Evaluation {
    let factors = &specification.factors;
    let points: Vec<Vec<f64>> = runs.points.iter().map(|point| coded(factors, point)).collect();
    let blocks: Vec<u32> = runs.blocks.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let contrasts = blocks.len().saturating_sub(1);
    let row = |(run, point): (usize, &Vec<f64>)| {
        let mut row = space.row(point);
        let own = runs.blocks.get(run);
        // The last block is minus the sum of the others, as in the search for optimal designs.
        let contrast = |block: &u32| if own == blocks.last() { -1.0 } else { f64::from(u8::from(own == Some(block))) };
        row.extend(blocks.iter().take(contrasts).map(contrast));
        row
    };
    let rows: Vec<Vec<f64>> = points.iter().enumerate().map(row).collect();
    let basis = Basis::of(&rows);
    let (n, p, rank, width) = (rows.len(), space.terms.len() + contrasts, basis.kept.len(), space.terms.len());
    let count = n as f64;
    let names = Names::of(specification, &blocks);
    let different = (0..n).map(|run| (runs.blocks.get(run), bits(&runs.points[run]))).collect::<BTreeSet<_>>().len();
    let freedom = Freedom { residual: n - rank, lack_of_fit: different.saturating_sub(rank), pure_error: n - different };
    let prediction = (rank == p).then(|| prediction(specification, space, &basis, (&points, sample)));
    let trace: f64 = (0..width.min(rank)).map(|k| basis.covariance(k, k)).sum();
    let scaled = |value: f64| width as f64 / value;
    let efficiency = Efficiency {
        d: if rank == p { (basis.log_determinant() / p as f64).exp() / count } else { 0.0 },
        a: (rank == p).then(|| scaled(count * trace)),
        g: prediction.as_ref().map(|it| scaled(it.max)),
        i: prediction.as_ref().map(|it| scaled(it.mean)),
    };
    let of_runs = basis.leverages(n);
    let largest = of_runs.iter().copied().fold(0.0, f64::max);
    let with_largest = of_runs.iter().zip(&runs.numbers).filter(|(leverage, _)| **leverage >= largest - EQUAL);
    let leverage =
        Leverage { mean: rank as f64 / count, largest, runs: with_largest.map(|(_, number)| *number).collect(), of_runs };
    let relation = |it: &basis::Dependent| Relation { term: names.of_column(it.column), relation: names.relation(it) };
    Evaluation {
        runs: n,
        points: different,
        runs_outside: points.iter().filter(|point| !is_inside(space, point)).count(),
        parameters: p,
        terms_of_model: width,
        rank,
        efficiency,
        prediction,
        freedom,
        leverage,
        terms: terms(space, &rows, &basis, &names, freedom.residual),
        dependent: basis.dependent.iter().map(relation).collect(),
        aliases: aliases(space, &points, &basis, &names),
    }
}

fn is_inside(space: &Space, point: &[f64]) -> bool {
    match &space.candidates {
        Some(candidates) => candidates.iter().any(|candidate| candidate.iter().zip(point).all(|(a, b)| (a - b).abs() <= EQUAL)),
        None => space.holds(point),
    }
}

/// The variance of predictions over the region. All columns are independent.
fn prediction(
    specification: &DesignSpecification,
    space: &Space,
    basis: &Basis,
    (points, sample): (&[Vec<f64>], &[Vec<f64>]),
) -> PredictionVariance {
    let (n, p) = (points.len() as f64, space.terms.len());
    let inverse: Vec<f64> = (0..p * p).map(|k| basis.covariance(k / p, k % p)).collect();
    let moments = space.moments(0).unwrap_or_default();
    let mean = dot(&inverse, &moments);
    let variance = Variance::new(space, inverse);
    let mut values: Vec<f64> = sample.iter().map(|point| n * variance.at(point)).collect();
    order::sort(&mut values);
    // The smallest value that is not exceeded at this share of the points.
    let place = |share: f64| ((share * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1;
    let quantiles = SHARES.map(|share| Quantile { share, value: values[place(share)] }).to_vec();
    let mut starts = points.to_vec();
    if points.first().map_or(0, Vec::len) <= MOST_CORNERS {
        let ends: Vec<Vec<f64>> = space
            .ends
            .iter()
            .zip(&space.levels)
            .map(|(ends, levels)| levels.as_ref().map_or(ends.to_vec(), Clone::clone))
            .map(|levels| if levels.len() > 2 { vec![levels[0], levels[levels.len() - 1]] } else { levels })
            .collect();
        starts.extend(super::points::full_factorial(&ends));
    }
    let (point, max) = variance.largest(&starts, sample).unwrap_or_default();
    let setting = |(factor, x): (&super::Factor, &f64)| (factor.name.clone(), physical(factor, *x));
    let at = Named(specification.factors.iter().zip(&point).map(setting).collect());
    PredictionVariance { mean: n * mean, max: n * max, at, quantiles, sample: sample.len() }
}

/// The corners of the region are starts of the search for the largest variance up to this number of factors: 1024 corners.
const MOST_CORNERS: usize = 10;

fn terms(space: &Space, rows: &[Vec<f64>], basis: &Basis, names: &Names, residual: usize) -> Vec<TermEvaluation> {
    let critical = (residual > 0).then(|| power::critical_t(residual));
    let has_constant = space.terms.iter().any(|powers| order(powers) == 0);
    let n = rows.len() as f64;
    let of_one = |(column, powers): (usize, &Vec<u32>)| {
        let estimable = basis.is_estimable(column);
        let place = basis.kept.iter().position(|kept| *kept == column).filter(|_| estimable);
        let variance = place.map(|place| basis.covariance(place, place));
        let is_constant = order(powers) == 0;
        let values = || rows.iter().map(|row| row[column]);
        let mean = if has_constant { values().sum::<f64>() / n } else { 0.0 };
        let spread: f64 = values().map(|x| (x - mean) * (x - mean)).sum();
        // The change over the region is twice the coefficient if the term takes both signs.
        let coefficient = if powers.iter().all(|power| power % 2 == 0) { 1.0 } else { 0.5 };
        let power = variance.zip(critical).filter(|_| !is_constant).map(|(variance, critical)| {
            [1.0, 2.0].map(|effect| power::power(effect * coefficient / variance.sqrt(), critical, residual))
        });
        TermEvaluation {
            term: names.of_column(column),
            powers: powers.clone(),
            estimable,
            variance,
            vif: variance.filter(|_| !is_constant).map(|variance| variance * spread),
            power,
        }
    };
    space.terms.iter().enumerate().map(of_one).collect()
}

/// The alias matrix of the terms that can be estimated, with the terms that the model does not have.
fn aliases(space: &Space, points: &[Vec<f64>], basis: &Basis, names: &Names) -> Option<Vec<AliasRow>> {
    let width = space.terms.first().map_or(0, Vec::len);
    let next = space.terms.iter().map(|powers| order(powers)).max().unwrap_or(0) + 1;
    if count_of_terms(width, next) > MOST_TERMS {
        return None;
    }
    let missing: Vec<Vec<u32>> =
        monomials_up_to(width, next).into_iter().filter(|powers| !space.terms.contains(powers)).collect();
    let of_missing = Space { terms: missing, ..Space::default() };
    let rows: Vec<Vec<f64>> = points.iter().map(|point| of_missing.row(point)).collect();
    let matrix: Vec<Vec<f64>> =
        (0..of_missing.terms.len()).map(|k| basis.coefficients(&rows.iter().map(|row| row[k]).collect::<Vec<f64>>())).collect();
    let of_term = |place: usize| {
        let with = of_missing.terms.iter().zip(&matrix).filter(|(_, column)| column[place].abs() > EQUAL);
        let with = with.map(|(powers, column)| Alias { term: names.of_powers(powers), factor: column[place] }).collect();
        AliasRow { term: names.of_column(basis.kept[place]), with }
    };
    let is_term = |place: &usize| basis.kept[*place] < space.terms.len() && basis.is_estimable(basis.kept[*place]);
    Some((0..basis.kept.len()).filter(is_term).map(of_term).filter(|row: &AliasRow| !row.with.is_empty()).collect())
}

/// The names of columns.
struct Names {
    surface: Surface,
    terms: Vec<Vec<u32>>,
    blocks: Vec<u32>,
}

impl Names {
    fn of(specification: &DesignSpecification, blocks: &[u32]) -> Names {
        let inputs = specification.factors.iter().map(|factor| factor.name.clone()).collect();
        let surface = Surface { inputs, ..Surface::default() };
        Names { surface, terms: specification.terms.clone(), blocks: blocks.to_vec() }
    }

    fn of_powers(&self, powers: &[u32]) -> String {
        self.surface.term_name(powers)
    }

    fn of_column(&self, column: usize) -> String {
        match self.terms.get(column) {
            Some(powers) => self.of_powers(powers),
            None => format!("block {}", self.blocks[column - self.terms.len()]),
        }
    }

    /// `a^2 = b^2`, `a*b = 1 - 0.5*c`.
    fn relation(&self, it: &basis::Dependent) -> String {
        let mut text = String::new();
        for (column, weight) in &it.sum {
            let name = self.of_column(*column);
            let size = short(weight.abs());
            let product = match (name.as_str(), size.as_str()) {
                ("1", size) => size.to_string(),
                (name, "1") => name.to_string(),
                (name, size) => format!("{size}*{name}"),
            };
            text += match (text.is_empty(), *weight < 0.0) {
                (true, true) => "-",
                (true, false) => "",
                (false, true) => " - ",
                (false, false) => " + ",
            };
            text += &product;
        }
        format!("{} = {}", self.of_column(it.column), if text.is_empty() { "0" } else { &text })
    }
}

/// A factor with four decimals, without zeros at the end.
fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}
