//! A campaign: random feasible problems with constraints, drawn from a seed. Each must end with a proof, without a violation that dense points find,
//! near the smallest residual sum of squares. `cargo xtask constraints` runs it.

mod draw;
mod judge;
mod surface;

use std::time::{Duration, Instant};

use rsm_fit::fit::Verdict;

use crate::data::{Files, fitted};
use draw::{Problem, problem};
use judge::Judge;

/// The share by which a sum of squares may exceed the smallest one.
const NEAR: f64 = 1e-4;

/// The largest violation as a share of the spread: roundings of values and of second derivatives.
const ROUNDING: f64 = 1e-9;

/// Fits the problem of a seed. A line for the table, and the fault, if there is one.
fn judged(seed: u64, limit: Duration) -> (String, Option<String>) {
    let problem = problem(seed);
    let begin = Instant::now();
    let outcome = fitted(&problem.specification, &Files::of("data.csv", &problem.data));
    let seconds = begin.elapsed().as_secs_f64();
    let response = &outcome.responses[0];
    if response.verdict != Verdict::Fitted {
        let kind = if matches!(response.verdict, Verdict::NotProven(_)) { "NOT PROVEN" } else { "NO SURFACE" };
        let line = format!("{kind:<12} {seconds:7.1} s  {}\n    {}", problem.name, response.verdict);
        return (line.clone(), Some(line));
    }
    let statistics = response.statistics.as_ref().expect("a fitted response has figures");
    let told = statistics.constraints.as_ref().expect("it has constraints");
    let surface = &outcome.model.surfaces[0];
    let judge = Judge { problem: &problem, support: &surface.support };
    let b: Vec<f64> = coefficients(&problem, &statistics.terms);
    let near = told.constraints.iter().flat_map(|one| &one.points).map(|point| shares(&problem, &point.0)).collect::<Vec<_>>();
    let spread = {
        let y = || problem.rows.iter().map(|(_, y)| *y);
        y().fold(f64::NEG_INFINITY, f64::max) - y().fold(f64::INFINITY, f64::min)
    };
    let violation = judge.violation(&b, &near) / spread;
    let freedom = (statistics.rows - statistics.terms.len()) as f64;
    let found = statistics.residual_sd.expect("there are more rows than terms").powi(2) * freedom;
    let bound = if told.active { judge.lower_bound(found, &near, NEAR / 2.0, limit) } else { found };
    let excess = found / bound - 1.0;
    // A sum below a lower bound, with the tolerance of the solver, 1e-8, is a fault too.
    let fault = match (violation > ROUNDING, (-1e-6..NEAR).contains(&excess)) {
        (true, _) => Some("VIOLATED"),
        (false, false) => Some("FAR"),
        (false, true) => None,
    };
    let line = format!(
        "{:<12} {seconds:7.1} s  violation {violation:8.1e}  excess {excess:8.1e}  {} rounds  shift {:.1e}  {}",
        fault.unwrap_or(if told.active { "proven" } else { "inactive" }),
        told.rounds,
        told.shift / spread,
        problem.name
    );
    (line.clone(), fault.map(|_| line))
}

/// The coefficients in the order of the problem's terms.
fn coefficients(problem: &Problem, terms: &[rsm_fit::statistics::TermStatistics]) -> Vec<f64> {
    let of = |powers: &Vec<u32>| terms.iter().find(|term| term.powers == *powers).map_or(0.0, |term| term.coefficient);
    problem.basis.terms.iter().map(of).collect()
}

/// A reported point as shares of the sides.
fn shares(problem: &Problem, point: &[(String, f64)]) -> Vec<f64> {
    let share = |((_, x), axis): (&(String, f64), &surface::Axis)| {
        let [low, high] = axis.side();
        ((x - low) / (high - low)).clamp(0.0, 1.0)
    };
    point.iter().zip(&problem.basis.axes).map(share).collect()
}

#[test]
#[ignore = "takes an hour: cargo xtask constraints"]
fn every_feasible_fit_ends_with_a_proof_near_the_optimum() {
    let text = std::env::var("SEEDS").unwrap_or("0-270".into());
    let (first, end) = text.split_once('-').expect("SEEDS is FIRST-END");
    let seeds = first.parse::<u64>().expect("a number")..end.parse().expect("a number");
    let mut faults = Vec::new();
    for seed in seeds {
        let (line, fault) = judged(seed, Duration::from_secs(30));
        println!("{line}");
        faults.extend(fault);
    }
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}
