//! Best-known designs.

use super::*;
use crate::plan::design::Criterion;
use crate::random::Random;
use crate::plan::optimal::linear::{add_square, cholesky};

fn efficiency(space: &Space, points: &[Vec<f64>]) -> f64 {
    let p = space.terms.len();
    let mut m = vec![0.0; p * p];
    points.iter().for_each(|point| add_square(&mut m, 1.0, &space.row(point)));
    let l = cholesky(&m, p).unwrap();
    let log: f64 = (0..p).map(|k| 2.0 * l[k * p + k].ln()).sum();
    (log / p as f64).exp() / points.len() as f64
}

#[test]
#[ignore]
fn all() {
    let text = std::fs::read_to_string("/work/shared/data/doe-reference/d_optimal_exact.json").unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let r = std::env::var("R").map_or(5, |r| r.parse().unwrap());
    let kk = std::env::var("K").map_or(30, |r| r.parse().unwrap());
    let mut total = 0.0;
    for (n, problem) in json["problems"].as_array().unwrap().iter().enumerate() {
        let of = |key: &str| problem[key].as_u64().unwrap() as usize;
        let (k, order, runs) = (of("k"), of("order"), of("N"));
        let space = Space { terms: all_terms(k, order as u32), ends: vec![[-1.0, 1.0]; k], levels: vec![None; k], ..Space::default() };
        let task = Task { space: &space, criterion: Criterion::D, fixed: vec![], blocks: vec![0; runs], block_count: 1, restarts: r, kicks: kk };
        let start = std::time::Instant::now();
        let points = task.search(&mut Random::new(std::env::var("S").map_or(1, |s| s.parse().unwrap()))).unwrap();
        let d = efficiency(&space, &points);
        let best = problem["best_found_D"].as_f64().unwrap();
        total += start.elapsed().as_secs_f64();
        println!("{n:2} k{k} o{order} N{runs}: {d:.9} {best:.9} {:+.3e} {:.2} s", d / best - 1.0, start.elapsed().as_secs_f64());
    }
    println!("total {total}");
}
