//! Figures and quantiles of a plant whose solution is known: tau dy/dt = u - y with u = 1 V from y = 0, so y = 1 - exp(-t/tau).

use rsm_core::source::{Faults, Source};
use rsm_sweep::scenario::Scenario;
use rsm_sweep::summary::{self, Summary};
use rsm_sweep::table::Table;
use rsm_sweep::{no_diagnosis, tasks};

/// The rows: every 0.1 s, 1 s long.
const ROWS: usize = 11;

fn y(tau: f64, row: usize) -> f64 {
    1.0 - (-0.1 * row as f64 / tau).exp()
}

/// The record has the closed form of tau = 0.5 s.
fn open(name: &str) -> Result<Source, Faults> {
    if name != "step.csv" {
        return super::open(name);
    }
    let rows = (0..ROWS).map(|row| format!("{},1,{}\n", 0.1 * row as f64, y(0.5, row)));
    Ok(Source::new(name, format!("time[s],u[V],y[V]\n{}", rows.collect::<String>())))
}

fn swept(rest: &str) -> (Table, Vec<Summary>) {
    let text = format!(
        "format = 1\nsweep = \"first\"\nplants = [\"first.toml\"]\nrecords = [\"step.csv\"]\n\
         outputs.y = [\"final\", \"min\", \"max\", \"mean\", \"rms\", \"rmse\"]\n{rest}"
    );
    let scenario = Scenario::read(&Source::new("sweep.toml", text), &open).unwrap_or_else(|faults| panic!("{faults}"));
    let tasks = tasks::list(&scenario).unwrap();
    let results: Vec<_> = tasks.iter().map(|task| Some(task.run(&scenario, 1, &no_diagnosis))).collect();
    let table = Table::of(&scenario, &tasks, &results);
    let summary = summary::of(&scenario, &table);
    (table, summary)
}

#[test]
fn every_figure_is_that_of_the_closed_form() {
    let vary = "runs = 60\n[[vary]]\nparameter = \"tau\"\ndistribution = \"log-uniform\"\nrange = [0.1, 2.0]\n";
    let (table, _) = swept(vary);
    let column = |name: &str| -> Vec<f64> { table.numbers(name).unwrap().iter().map(|it| it.unwrap()).collect() };
    let taus = column("tau");
    assert!(taus.iter().all(|tau| (0.1..=2.0).contains(tau)) && taus[0] != taus[1]);
    let found = ["final", "min", "max", "mean", "rms", "rmse"].map(|it| column(&format!("y_{it}")));
    for (run, tau) in taus.iter().enumerate() {
        let over = |of: &dyn Fn(usize) -> f64| (0..ROWS).map(of).sum::<f64>() / ROWS as f64;
        let expected = [
            y(*tau, ROWS - 1),
            0.0,
            y(*tau, ROWS - 1),
            over(&|row| y(*tau, row)),
            over(&|row| y(*tau, row).powi(2)).sqrt(),
            over(&|row| (y(*tau, row) - y(0.5, row)).powi(2)).sqrt(),
        ];
        for (k, expected) in expected.iter().enumerate() {
            // The engine holds the error of a step below 1e-8 of the state; ten rows have some ten steps, and the plant forgets errors.
            assert!((found[k][run] - expected).abs() < 1e-6, "tau {tau}, figure {k}: {} for {expected}", found[k][run]);
        }
    }
}

#[test]
fn quantiles_and_their_intervals_are_those_of_the_distribution() {
    let vary = "runs = 1000\n[[vary]]\nparameter = \"tau\"\ndistribution = \"uniform\"\nrange = [0.25, 1.0]\n";
    let (_, summary) = swept(vary);
    let last = summary.iter().find(|it| it.figure == "y_final").unwrap();
    assert_eq!((last.count, last.failed, last.unit.as_deref()), (1000, 0, Some("V")));
    for it in &last.quantiles {
        // The final value falls with tau: its quantile of p is that of tau at 1 - p.
        let truth = y(1.0 - 0.75 * it.share, ROWS - 1);
        let (low, high) = (it.low.unwrap(), it.high.unwrap());
        assert!(low < it.value && it.value < high);
        // Each interval misses one truth in twenty; the seed is fixed, and its draws hold all seven.
        assert!(low < truth && truth < high, "{}: {truth} not in {low} to {high}", it.share);
        // The estimate has a standard error of sqrt(p (1 - p)/1000)/density in tau: below 0.02 s, five of them.
        assert!((it.value - truth).abs() < 0.06, "{}: {} for {truth}", it.share, it.value);
    }
    // Mean of 1 - exp(-1/tau) over tau from 0.25 to 1, by Simpson's rule.
    let steps = 1000;
    let weight = |k: usize| if k == 0 || k == steps { 1.0 } else { f64::from(2 + 2 * (k % 2) as u32) };
    let sum: f64 = (0..=steps).map(|k| weight(k) * y(0.25 + 0.75 * k as f64 / steps as f64, ROWS - 1)).sum();
    let truth = sum / (3.0 * steps as f64);
    let [low, high] = last.mean_interval.unwrap();
    assert!(low < truth && truth < high && high - low < 0.02, "{truth} not in {low} to {high}");
}

#[test]
fn repeats_draw_the_noise_of_the_plant_file() {
    let (table, summary) = swept("noise = true\nrepeats = 400\n");
    assert_eq!(table.rows(), 400);
    let last = summary.iter().find(|it| it.figure == "y_final").unwrap();
    // Noise of 0.1 V: its standard deviation is known to 0.1/sqrt(800), five of them.
    assert!((last.sd - 0.1).abs() < 0.018, "{}", last.sd);
    let [low, high] = last.mean_interval.unwrap();
    let truth = y(0.5, ROWS - 1);
    assert!(low < truth && truth < high, "{truth} not in {low} to {high}");
    let seeds = table.column("noise_seed").unwrap();
    assert_eq!(seeds.header(), "noise_seed[1]");
}

#[test]
fn intervals_of_independent_draws_are_left_out_where_nothing_is_drawn() {
    let vary = "[[vary]]\nparameter = \"tau\"\ndistribution = \"list\"\nvalues = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]\n";
    let (_, summary) = swept(&format!("design = \"full-factorial\"\n{vary}"));
    assert!(summary[0].mean_interval.is_none() && summary[0].quantiles.iter().all(|it| it.low.is_none()));
    assert_eq!(summary[0].count, 7);
}
