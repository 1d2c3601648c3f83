//! The plan of an optimal design: conversion of factors to coded variables and back.
//!
//! In: a specification of an optimal design, and runs already made. Out: a [`Plan`] with exactly the requested number of runs, or a reason why there
//! is none.

use rsm_core::order;
use std::path::Path;

use rsm_core::source::{Collector, Faults};

use super::design::{Condition, Design, Factor, Optimum};
use super::optimal::{Failure, Space, Task};
use super::read_optimal::read_points;
use super::{DesignSpecification, Plan, columns, list, physical};
use crate::random::Random;

/// The limit of work of a search, in exchanges of a run along a factor times the square of the number of terms: about ten seconds.
const WORK: usize = 2_000_000_000;

/// The number of searches from a new start, and of redraws without a gain before the next start. With five and thirty, the best-known design of each
/// of 36 published problems with up to five continuous factors is found. With a finite set of points there are many local optima, and new starts find
/// more than redraws.
const ANYWHERE: (usize, usize) = (5, 30);
const FINITE: (usize, usize) = (100, 10);

/// Conditions are tightened by this part of a half range, so that they also hold in the units of the factors after rounding.
const MARGIN: f64 = 1e-9;

/// Runs that were already made, in the units of the factors.
///
/// ```no_run
/// use rsm_core::source::Source;
/// use rsm_fit::plan::{DesignSpecification, Existing, Plan};
///
/// let specification = DesignSpecification::from_source(Source::read("design.toml".as_ref())?)?;
/// let done = Existing::read("done.csv".as_ref(), &specification)?;
/// let more = Plan::augment(&specification, &done)?; // the best runs to add
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Existing {
    /// For each run, one setting for each factor.
    pub points: Vec<Vec<f64>>,
}

impl Existing {
    /// Reads the columns of the factors from a table; the table may have others.
    ///
    /// # Errors
    /// Every fault of the file: a missing factor, or a unit of another kind.
    pub fn read(path: &Path, specification: &DesignSpecification) -> Result<Existing, Faults> {
        Ok(Existing { points: read_points(path, &specification.factors)? })
    }
}

impl Plan {
    /// The best runs to add to those already made: an optimal design that contains these. The plan has only the new runs, numbered after the others.
    /// If the specification has blocks, the existing runs are a separate block.
    ///
    /// # Errors
    /// If the specification is for another design, and the errors of [`Plan::make`].
    pub fn augment(specification: &DesignSpecification, existing: &Existing) -> Result<Plan, Faults> {
        match &specification.design {
            Design::Optimal(wanted) => plan(specification, wanted, existing),
            other => {
                let what = format!("`design`: a \"{}\" design cannot be added to runs that were made", other.name());
                Err(Faults::one(specification.fault("design", what).help("write design = \"optimal\"")))
            }
        }
    }
}

/// The coded setting; 0 for a factor without a range.
pub(super) fn coded(factors: &[Factor], point: &[f64]) -> Vec<f64> {
    factors.iter().zip(point).map(|(factor, xi)| coded_setting(factor, *xi)).collect()
}

fn coded_setting(factor: &Factor, xi: f64) -> f64 {
    let [low, high] = factor.range;
    if high > low { (2.0 * xi - low - high) / (high - low) } else { 0.0 }
}

/// Terms and region of a specification, in coded variables.
pub(super) fn space(specification: &DesignSpecification) -> Space {
    let factors = &specification.factors;
    let mut conditions = Vec::new();
    for condition in &specification.conditions {
        for (bound, sign) in [(condition.at_most, 1.0), (condition.at_least, -1.0)] {
            let Some(bound) = bound else { continue };
            // sign sum w (mid + half x) <= sign bound, divided by the length of the weights of x.
            let weights =
                condition.weights.iter().zip(factors).map(|(w, factor)| sign * w * 0.5 * (factor.range[1] - factor.range[0]));
            let weights: Vec<f64> = weights.collect();
            let middle: f64 = condition.weights.iter().zip(factors).map(|(w, f)| w * 0.5 * (f.range[0] + f.range[1])).sum();
            let size = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
            if size > 0.0 {
                let at_most = Some(sign * (bound - middle) / size - MARGIN);
                conditions.push(Condition { weights: weights.iter().map(|w| w / size).collect(), at_most, at_least: None });
            }
        }
    }
    let of_levels = |factor: &Factor| {
        (!factor.levels.is_empty()).then(|| {
            let mut levels: Vec<f64> = factor.levels.iter().map(|xi| coded_setting(factor, *xi)).collect();
            order::sort(&mut levels);
            levels
        })
    };
    let candidates = match &specification.design {
        Design::Optimal(wanted) => wanted.candidates.as_ref().map(|points| {
            points.iter().filter(|point| specification.allows(point)).map(|point| coded(factors, point)).collect()
        }),
        _ => None,
    };
    Space {
        terms: specification.terms.clone(),
        ends: vec![[-1.0, 1.0]; factors.len()],
        levels: factors.iter().map(of_levels).collect(),
        conditions,
        candidates,
    }
}

pub(super) fn plan(specification: &DesignSpecification, wanted: &Optimum, existing: &Existing) -> Result<Plan, Faults> {
    let mut faults = Collector::new();
    let mut random = Random::new(specification.seed);
    let space = space(specification);
    if space.candidates.as_ref().is_some_and(Vec::is_empty) {
        faults.push(specification.fault("where", "`candidates`: none of them fulfils `where`"));
        return faults.finish(None);
    }
    for (k, point) in wanted.mandatory.iter().enumerate().filter(|(_, point)| !specification.allows(point)) {
        let what = format!("`where`: the mandatory point {} ({}) does not fulfil it", k + 1, list(point));
        faults.push(specification.fault("where", what));
    }
    // The blocks of the runs alternate, so that mandatory points spread over them.
    let mut blocks = Vec::new();
    let mut left = if wanted.block_sizes.is_empty() { vec![wanted.runs] } else { wanted.block_sizes.clone() };
    while blocks.len() < wanted.runs {
        for (block, left) in left.iter_mut().enumerate().filter(|(_, left)| **left > 0) {
            blocks.push(block);
            *left -= 1;
        }
    }
    let own = left.len();
    let done_is_a_block = own > 1 && !existing.points.is_empty();
    let mut fixed: Vec<(Vec<f64>, usize)> =
        wanted.mandatory.iter().zip(&blocks).map(|(point, block)| (coded(&specification.factors, point), *block)).collect();
    let done_in = if done_is_a_block { own } else { 0 };
    fixed.extend(existing.points.iter().map(|point| (coded(&specification.factors, point), done_in)));
    let free = blocks[wanted.mandatory.len().min(blocks.len())..].to_vec();
    let is_finite = space.candidates.is_some() || space.levels.iter().all(Option::is_some);
    let (restarts, kicks) = if is_finite { FINITE } else { ANYWHERE };
    let mut task = Task {
        space: &space,
        criterion: wanted.criterion,
        fixed,
        blocks: free,
        block_count: own + usize::from(done_is_a_block),
        restarts: wanted.restarts.unwrap_or(restarts),
        kicks,
    };
    let (width, runs) = (task.width(), task.fixed.len() + task.blocks.len());
    if runs < width {
        let done = if existing.points.is_empty() {
            String::new()
        } else {
            format!(" and the {} that were made", existing.points.len())
        };
        let of_blocks =
            if task.block_count > 1 { format!(" and {} contrasts of blocks", task.block_count - 1) } else { String::new() };
        let what = format!(
            "`runs`: {} runs{done} cannot estimate the {} terms of the model{of_blocks}: at least {width} runs are needed",
            wanted.runs,
            space.terms.len()
        );
        faults.push(specification.fault("runs", what).help("ask for more runs, or for fewer `terms`"));
    }
    faults.finish(Some(()))?;
    // The work of a sweep over all runs; a search needs about ten.
    let tries = space.candidates.as_ref().map_or(specification.factors.len(), Vec::len);
    let sweep = 10usize.saturating_mul(task.blocks.len()).saturating_mul(tries).saturating_mul(width * width).max(1);
    let searches = WORK / sweep;
    if wanted.restarts.is_none() {
        task.restarts = (searches / 5).clamp(1, task.restarts);
    }
    task.kicks = (searches / task.restarts).min(task.kicks);
    let mut faults = Collector::new();
    let found = task.search(&mut random).map_err(|failure| {
        let what = match failure {
            Failure::EmptyRegion => "`where`: no point within the ranges was found that fulfils it".to_string(),
            Failure::Singular => format!(
                "`terms`: no {} runs of the region can estimate the {} terms of the model",
                wanted.runs,
                space.terms.len()
            ),
        };
        let help = match failure {
            Failure::EmptyRegion => "widen the ranges, loosen `where`, or list the points as `candidates`",
            Failure::Singular => {
                "a factor needs one level more than its highest power; leave terms out, or add levels or candidates"
            }
        };
        Faults::one(specification.fault("where", what).help(help))
    })?;
    let of_coded = |point: &Vec<f64>| -> Vec<f64> {
        let setting = |(factor, x): (&Factor, &f64)| match factor.levels.is_empty() {
            true => physical(factor, *x),
            // The level as written, without the rounding of the coding.
            false => nearest(&factor.levels, physical(factor, *x)),
        };
        specification.factors.iter().zip(point).map(setting).collect()
    };
    let given = |point: &Vec<f64>| {
        let exact =
            wanted.candidates.as_ref().and_then(|all| all.iter().find(|it| coded(&specification.factors, it) == *point));
        exact.cloned().unwrap_or_else(|| of_coded(point))
    };
    let points = wanted.mandatory.iter().cloned().chain(found.iter().map(given));
    let mut all: Vec<(usize, Vec<f64>)> = blocks.into_iter().zip(points).collect();
    // In random order within each block; the blocks follow one another.
    random.shuffle(&mut all);
    all.sort_by_key(|(block, _)| *block);
    if all.len() != wanted.runs || all.iter().any(|(_, point)| !specification.allows(point)) {
        faults.push(
            specification.fault("where", format!("{} runs of {} keep `where`, a fault of the search", all.len(), wanted.runs)),
        );
    }
    let (blocks, points): (Vec<usize>, Vec<Vec<f64>>) = all.into_iter().unzip();
    let first = existing.points.len() as u32;
    let plan = Plan {
        runs: (1..=points.len() as u32).map(|run| first + run).collect(),
        factors: columns(specification, &points),
        kept: None,
        blocks: if own > 1 { blocks.iter().map(|block| *block as u32 + 1).collect() } else { Vec::new() },
        place: None,
    };
    faults.finish(Some(plan))
}

fn nearest(levels: &[f64], value: f64) -> f64 {
    let away = |level: &f64| (level - value).abs();
    levels.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(value)
}
