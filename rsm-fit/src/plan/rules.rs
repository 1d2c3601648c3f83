//! The rules for the factors and the size of a design from any source. Each rule is one function.
//!
//! In: factors or a whole design, and how to make a fault at one of its parts. Out: faults. Never makes a point.

use rsm_core::names;
use rsm_core::source::{Collector, Fault};

use super::design::{Design, Factor, MOST_RUNS};

/// The largest number of factors. With more, the 2^factors corners of a cube exceed [`MOST_RUNS`].
pub(super) const MOST_FACTORS: usize = 16;

/// The highest order. A higher one would need more runs than a bench can make.
pub(super) const MOST_ORDER: u32 = 8;

/// A fault at a part of the specification, by its dotted path.
pub(super) type At<'a> = &'a dyn Fn(&str, String) -> Fault;

pub(super) fn check_names(factors: &[Factor], fault: At<'_>, faults: &mut Collector) {
    for (k, factor) in factors.iter().enumerate() {
        let clash = || factors[..k].iter().find_map(|earlier| names::clash(&earlier.name, &factor.name));
        // `run` is the column of the run order.
        let taken = (factor.name == "run").then(|| "is taken: it is the column of the run order".to_string());
        if let Some(reason) = taken.or_else(|| names::refuse(&factor.name)).or_else(clash) {
            faults.push(fault(&format!("factors.{}", factor.name), format!("factor name `{}` {reason}", factor.name)));
        }
    }
    if factors.len() > MOST_FACTORS {
        faults.push(fault("factors", format!("`factors`: found {}, at most {MOST_FACTORS} are accepted", factors.len())));
    }
}

/// Rejects a plan with more runs than [`MOST_RUNS`] before its points are created.
pub(super) fn check_size(
    (design, factors): (&Design, usize),
    (replicates, centre_points): (usize, usize),
    fault: At<'_>,
    faults: &mut Collector,
) {
    let factors = factors.min(MOST_FACTORS);
    let points = match design {
        Design::FullFactorial { blocks } => {
            let of_block = |levels: &Vec<Vec<f64>>| levels.iter().fold(1usize, |count, of| count.saturating_mul(of.len()));
            blocks.iter().map(of_block).fold(0usize, usize::saturating_add)
        }
        Design::CentralComposite { .. } => (1 << factors) + 2 * factors,
        // 7 factors have 56 points.
        Design::BoxBehnken => 56,
        Design::FractionalFactorial(fraction) => 1 << (fraction.factors - fraction.generators.len()).min(MOST_FACTORS),
        // 16 factors have 33 points.
        Design::DefinitiveScreening => 33,
        other => other.runs().unwrap_or(0),
    };
    let runs = points.saturating_mul(replicates).saturating_add(centre_points);
    if runs > MOST_RUNS {
        faults.push(fault("factors", format!("the plan has up to {runs} runs, at most {MOST_RUNS} are accepted")));
    }
}
