//! Optimal designs, compared with the best-known designs of published problems, through the public interface.
//!
//! The criterion is computed here with nalgebra, not with the code of the search.

use nalgebra::{DMatrix, DVector};
use rsm_core::source::Source;
use rsm_fit::plan::{Design, DesignSpecification, Plan};
use serde_json::Value;

use crate::folders::shared;

type Points = Vec<Vec<f64>>;

/// A file of published problems.
fn published(file: &str) -> Option<Value> {
    let text = std::fs::read_to_string(shared("doe-reference")?.join(file)).unwrap();
    Some(serde_json::from_str(&text).unwrap())
}

/// An optimal design with this number of factors, each of them with `setting`: `range = [-1, 1]` or `levels = [-1, 1]`.
fn specification(criterion: &str, factors: usize, order: u64, runs: usize, setting: &str, more: &str) -> DesignSpecification {
    let factors: String = (1..=factors).map(|k| format!("[factors.x{k}]\nunit = \"1\"\n{setting}\n")).collect();
    let text = format!(
        "format = 1\nplan = \"p\"\nseed = 1\ndesign = \"optimal\"\ncriterion = \"{criterion}\"\nruns = {runs}\norder = {order}\n{more}{factors}"
    );
    DesignSpecification::from_source(Source::new("design.toml", text)).unwrap()
}

/// Restricts the design to these points.
fn among(specification: &mut DesignSpecification, points: &Points, restarts: usize) {
    let Design::Optimal(wanted) = &mut specification.design else { unreachable!("an optimal design was asked for") };
    (wanted.candidates, wanted.restarts) = (Some(points.clone()), Some(restarts));
}

fn runs(specification: &DesignSpecification) -> Points {
    let plan = Plan::make(specification).unwrap();
    (0..plan.runs.len()).map(|row| plan.factors.iter().map(|factor| factor.values[row]).collect()).collect()
}

/// Every combination of levels.
fn grid(levels: &[Vec<f64>]) -> Points {
    let more = |all: Points, levels: &Vec<f64>| {
        let with = |point: &Vec<f64>| levels.iter().map(|x| [point.as_slice(), &[*x]].concat()).collect::<Points>();
        all.iter().flat_map(with).collect()
    };
    levels.iter().fold(vec![vec![]], more)
}

fn row(terms: &[Vec<u32>], point: &[f64]) -> DVector<f64> {
    let term = |powers: &Vec<u32>| powers.iter().zip(point).map(|(power, x)| x.powi(*power as i32)).product::<f64>();
    DVector::from_iterator(terms.len(), terms.iter().map(term))
}

fn information(terms: &[Vec<u32>], points: &Points) -> DMatrix<f64> {
    let rows = points.iter().map(|point| row(terms, point));
    rows.fold(DMatrix::zeros(terms.len(), terms.len()), |sum, row| sum + &row * row.transpose())
}

/// The criterion |X'X|^(1/p)/N, with the terms of the settings without coding.
fn d_value(terms: &[Vec<u32>], points: &Points) -> f64 {
    let factor = information(terms, points).cholesky().unwrap().unpack();
    let log: f64 = factor.diagonal().iter().map(|x| 2.0 * x.ln()).sum();
    (log / terms.len() as f64).exp() / points.len() as f64
}

/// The published problems with this number of factors.
fn best_known(of_factors: u64, problems: usize) {
    let Some(json) = published("d_optimal_exact.json") else { return };
    let all = json["problems"].as_array().unwrap();
    assert_eq!(all.len(), 36);
    let of_factors: Vec<&Value> = all.iter().filter(|problem| problem["k"] == of_factors).collect();
    assert_eq!(of_factors.len(), problems);
    for problem in of_factors {
        let of = |key: &str| problem[key].as_u64().unwrap();
        let (factors, order, count) = (of("k"), of("order"), of("N"));
        let wanted = specification("D", factors as usize, order, count as usize, "range = [-1, 1]", "");
        let points = runs(&wanted);
        assert_eq!(points.len() as u64, count);
        assert!(points.iter().flatten().all(|x| (-1.0..=1.0).contains(x)));
        let (found, best) = (d_value(&wanted.terms, &points), problem["best_found_D"].as_f64().unwrap());
        // The published numbers have nine decimals. The tolerance is half of the last one; the values are at least 0.18.
        assert!(found >= best - 5e-10, "{factors} factors, order {order}, {count} runs: {found} {best}");
    }
}

// Separate tests, so that they run on several cores.
#[test]
fn designs_of_two_factors_reach_the_best_known_determinant() {
    best_known(2, 15);
}

#[test]
fn designs_of_three_factors_reach_the_best_known_determinant() {
    best_known(3, 11);
}

#[test]
fn designs_of_four_factors_reach_the_best_known_determinant() {
    best_known(4, 7);
}

#[test]
fn designs_of_five_factors_reach_the_best_known_determinant() {
    best_known(5, 3);
}

#[test]
fn points_of_an_engine_map_reach_the_published_design() {
    let Some(json) = published("published_problems.json") else { return };
    // SAS/QC OPTEX: 50 of 192 grid points of an engine map.
    let all = json["problems"].as_array().unwrap();
    let engine = all.iter().find(|problem| problem["name"].as_str().unwrap().starts_with("SAS OPTEX")).unwrap();
    let levels = |name: &str| -> Vec<f64> {
        let levels: Vec<f64> = engine["factors"][name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        let (low, high) = (levels[0], levels[levels.len() - 1]);
        levels.iter().map(|x| (2.0 * x - low - high) / (high - low)).collect()
    };
    let grid = grid(&[levels("AFR"), levels("EGR"), levels("SA")]);
    assert_eq!(grid.len(), 192);
    let mut wanted = specification("D", 3, 2, 50, "range = [-1, 1]", "");
    // Without `restarts`, the limit of work permits 41 starts of five draws each, which end at 46.5237.
    among(&mut wanted, &grid, 100);
    // The published value is 46.5246 percent, printed with four decimals.
    let found = 100.0 * d_value(&wanted.terms, &runs(&wanted));
    assert!(found >= 46.5246 - 5e-5, "{found}");
}

#[test]
fn points_below_a_plane_reach_the_published_design() {
    // The problem of AlgDesign: 15 of the points of 21^3 with a + b + c <= 0, in units of a tenth of the half range. The best-known design has
    // replicates.
    let steps: Vec<f64> = (-10..=10).map(f64::from).collect();
    let mut candidates = grid(&[steps.clone(), steps.clone(), steps]);
    candidates.retain(|x| x.iter().sum::<f64>() <= 0.0);
    assert_eq!(candidates.len(), 4796);
    let mut wanted = specification("D", 3, 2, 15, "range = [-10, 10]", "");
    among(&mut wanted, &candidates, 1);
    // The best value is 300.669722212, reached from each of 2671 starts.
    let found = d_value(&wanted.terms, &runs(&wanted));
    assert!(found >= 300.669722 - 5e-7, "{found}");
}

#[test]
fn a_half_space_is_at_least_as_good_as_its_grid_points() {
    let plane = "where = [{ sum = { x1 = 1, x2 = 1, x3 = 1 }, at_most = 0 }]\n";
    let wanted = specification("D", 3, 2, 15, "range = [-10, 10]", plane);
    let points = runs(&wanted);
    assert!(points.iter().all(|x| x.iter().sum::<f64>() <= 0.0));
    let found = d_value(&wanted.terms, &points);
    assert!(found >= 300.6697, "{found}");
}

#[test]
fn the_mean_variance_over_a_grid_is_the_least_known() {
    // The problem of AlgDesign: I over the 125 points of 5^3 on -2..2, 15 runs. 7.927083 with 100 repeats, 8.096772 published. Five starts end at the
    // published value.
    let steps: Vec<f64> = (-2..=2).map(f64::from).collect();
    let grid = grid(&[steps.clone(), steps.clone(), steps]);
    let mut wanted = specification("I", 3, 2, 15, "range = [-2, 2]", "");
    among(&mut wanted, &grid, 10);
    let inverse = information(&wanted.terms, &runs(&wanted)).try_inverse().unwrap();
    let variance = |point: &Vec<f64>| row(&wanted.terms, point).dot(&(&inverse * row(&wanted.terms, point)));
    let found = 15.0 * grid.iter().map(variance).sum::<f64>() / grid.len() as f64;
    assert!(found <= 7.927083 + 5e-7, "{found}");
}

#[test]
fn main_effects_of_two_levels_reach_the_orthogonal_design() {
    // The candidates are 2^11; main effects in 12 runs: the design of Plackett and Burman has D = 1.
    let wanted = specification("D", 11, 1, 12, "levels = [-1, 1]", "restarts = 5\n");
    let found = d_value(&wanted.terms, &runs(&wanted));
    assert!((found - 1.0).abs() < 1e-12, "{found}");
}

#[test]
fn interactions_of_two_levels_reach_the_best_known_design() {
    // The candidates are 2^7; main effects and two-factor interactions in 34 runs: 0.9223281.
    let mut wanted = specification("D", 7, 2, 34, "levels = [-1, 1]", "restarts = 5\n");
    wanted.terms.retain(|powers| powers.iter().all(|power| *power < 2));
    let found = d_value(&wanted.terms, &runs(&wanted));
    assert!(found >= 0.9223281 - 5e-8, "{found}");
}
