//! A campaign: random feasible problems with constraints, drawn from a seed. Each must end with a proof, without a violation that dense points find,
//! near the smallest residual sum of squares. `cargo xtask constraints` runs it.

mod draw;
mod judge;
mod surface;

use std::time::{Duration, Instant};

use rsm_fit::fit::Verdict;
use rsm_fit::random::Random;

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
    if let Verdict::IllConditioned { .. } = response.verdict {
        // The drawn rows do not determine the terms, with or without constraints.
        return (format!("no problem   {}", problem.name), None);
    }
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
    let (bound, is_settled) = if told.active { judge.lower_bound(found, &b, &near, NEAR / 2.0, limit) } else { (found, true) };
    let excess = found / bound - 1.0;
    // A sum below a lower bound, with the tolerance of the solver, 1e-8, is a fault too.
    let fault = match (violation > ROUNDING, (-1e-6..NEAR).contains(&excess)) {
        (true, _) => Some("VIOLATED"),
        // The time was not sufficient for a close bound: the excess may be smaller.
        (false, false) if !is_settled => Some("OPEN"),
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

/// Seeds of every family that take less than a second each.
#[test]
fn feasible_fits_of_every_family_end_with_a_proof_near_the_optimum() {
    for seed in QUICK {
        let (line, fault) = judged(seed, Duration::from_secs(30));
        assert!(fault.is_none(), "{line}");
    }
}

/// Of each family, from plain polynomials to waves.
const QUICK: [u64; 14] = [0, 2, 13, 23, 34, 54, 184, 55, 145, 26, 147, 8, 9, 19];

/// A specification of one input x over [0, 1].
fn of_one(select: &str, rows: &[(f64, f64)]) -> (String, Files) {
    let data: String = rows.iter().map(|(x, y)| format!("{x:e},{y:e}\n")).collect();
    let specification = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.x]\nrange = [0.0, 1.0]\n[responses.y]\ninputs = [\"x\"]\n{select}\n"
    );
    (specification, Files::of("data.csv", &format!("x[1],y[1]\n{data}")))
}

#[test]
fn a_sigmoid_that_the_data_choose_keeps_a_bound() {
    let mut random = Random::new(4);
    let row = |k: i32, random: &mut Random| {
        let x = f64::from(k) / 299.0;
        (x, ((x - 0.5) / 0.04).tanh() + 0.02 * random.normal())
    };
    let rows: Vec<(f64, f64)> = (0..300).map(|k| row(k, &mut random)).collect();
    let select = "forms = [\"polynomial\", \"sigmoid\"]\nselect = { max_order = 3 }\n\
                  constraints = [{ kind = \"bounds\", max = 0.97 }, { kind = \"monotone\", input = \"x\", direction = \"increasing\" }]";
    let (specification, files) = of_one(select, &rows);
    let outcome = fitted(&specification, &files);
    let told = outcome.responses[0].statistics.as_ref().unwrap().constraints.as_ref().unwrap();
    let surface = &outcome.model.surfaces[0];
    assert!(told.active && !surface.sigmoids.is_empty(), "{surface:?}");
    let factors = rsm_core::basis::Factor::all(surface, &outcome.model.inputs);
    let value = |x: f64| -> f64 {
        let values: Vec<f64> = factors.iter().map(|factor| factor.value(x)).collect();
        let of_term = |powers: &[u32]| values.iter().zip(powers).map(|(v, power)| v.powi(*power as i32)).product::<f64>();
        surface.terms.iter().map(|term| term.coefficient * of_term(&term.powers)).sum()
    };
    let all: Vec<f64> = (0..=20000).map(|k| value(f64::from(k) / 20000.0)).collect();
    assert!(all.iter().all(|y| *y <= 0.97) && all.windows(2).all(|pair| pair[1] >= pair[0] - 1e-12));
    assert!(all.iter().any(|y| *y > 0.969), "the bound holds the surface");
}

#[test]
fn a_surface_of_too_many_parts_is_refused_before_the_fit() {
    let select = "waves = [{ input = \"x\", period = 1.0, order = 900 }, { input = \"x\", period = 0.99, order = 900 }]\n\
                  select = { method = \"fixed\" }\nterms = [[0, 0, 0, 0, 0], [0, 1, 0, 0, 0]]\nconstraints = [{ kind = \"bounds\", min = 0.0 }]";
    let rows: Vec<(f64, f64)> = (0..40).map(|k| (f64::from(k) / 39.0, f64::from(k % 7))).collect();
    let (specification, files) = of_one(select, &rows);
    let specification = crate::data::specification(&specification, std::path::Path::new(""));
    let refused = rsm_fit::fit::fit_sources(&specification, &[files.get("data.csv")], &mut |_| {}).unwrap_err().to_string();
    assert!(refused.contains("fit.toml:11:") && refused.contains("parts, and at most 2000 are proved"), "{refused}");
}

/// The test of the warning: of true surfaces that keep the constraint at most one in a hundred gets it; one that falls where it must rise does.
#[test]
fn constraints_that_contradict_the_data_are_named_and_others_rarely() {
    let warned = |seed: u64, slope: f64| {
        let mut random = Random::new(seed);
        let rows: Vec<(f64, f64)> = (0..40).map(|_| random.share()).map(|x| (x, slope * x)).collect();
        let rows: Vec<(f64, f64)> = rows.into_iter().map(|(x, y)| (x, y + random.normal())).collect();
        let select = "select = { method = \"fixed\", order = 3 }\nconstraints = [{ kind = \"monotone\", input = \"x\", direction = \"increasing\" }]";
        let (specification, files) = of_one(select, &rows);
        let outcome = fitted(&specification, &files);
        let statistics = outcome.responses[0].statistics.as_ref().unwrap();
        let is_active = statistics.constraints.as_ref().unwrap().active;
        (is_active, statistics.warnings.iter().any(|warning| warning.kind == "constraints-off-data"))
    };
    // A constant is the worst case: it is on the edge of the constraint.
    let all: Vec<(bool, bool)> = (0..300).map(|seed| warned(seed, 0.0)).collect();
    let [active, false_alarms] = [all.iter().filter(|one| one.0).count(), all.iter().filter(|one| one.1).count()];
    // 1 % of 300, with two standard deviations.
    assert!(active > 200 && false_alarms <= 6, "{active} {false_alarms}");
    let found = (0..40).filter(|seed| warned(1000 + seed, -4.0).1).count();
    assert!(found >= 38, "{found}");
}

#[test]
#[ignore = "takes an hour: cargo xtask constraints"]
fn every_feasible_fit_ends_with_a_proof_near_the_optimum() {
    let text = std::env::var("SEEDS").unwrap_or("0-270".into());
    let (first, end) = text.split_once('-').expect("SEEDS is FIRST-END");
    let seeds = first.parse::<u64>().expect("a number")..end.parse().expect("a number");
    let mut faults = Vec::new();
    for seed in seeds {
        let (line, fault) = judged(seed, Duration::from_secs(60));
        println!("{line}");
        faults.extend(fault);
    }
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}
