//! Evaluations of designs: closed forms, published and certified numbers, and a computation with nalgebra that shares no code with the library.

use nalgebra::{DMatrix, DVector};
use rsm_core::source::Source;
use rsm_fit::plan::{Alpha, Criterion, DesignSpecification, Evaluation, Experiment, Factor, Runs};
use serde_json::Value;

use crate::folders::shared;

type Points = Vec<Vec<f64>>;

fn within(count: usize) -> Vec<Factor> {
    (0..count).map(|k| Factor::within(format!("x{}", k + 1), "1", [-1.0, 1.0])).collect()
}

/// Numbers of size 1 from a few hundred operations.
const NEAR: f64 = 1e-11;

fn near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= NEAR * (1.0 + expected.abs()), "{what}: {found} {expected}");
}

#[test]
fn a_factorial_of_two_levels_is_ideal_for_its_interactions() {
    let text = "format = 1\nplan = \"p\"\nseed = 1\nterms = [[0,0,0],[1,0,0],[0,1,0],[0,0,1],[1,1,0],[1,0,1],[0,1,1]]\n\
                [factors.a]\nunit = \"K\"\nlevels = [300, 400]\n[factors.b]\nunit = \"1\"\nlevels = [0, 1]\n[factors.c]\nunit = \"1\"\nlevels = [2, 6]\n";
    let specification = DesignSpecification::from_source(Source::new("p.toml", text)).unwrap();
    let plan = rsm_fit::plan::Plan::make(&specification).unwrap();
    let found = specification.evaluate(&Runs::of(&plan)).unwrap();
    assert!(found.is_estimable() && found.dependent.is_empty());
    assert_eq!((found.runs, found.points, found.parameters, found.runs_outside), (8, 8, 7, 0));
    let efficiency = &found.efficiency;
    for value in [efficiency.d, efficiency.a.unwrap(), efficiency.g.unwrap()] {
        near(value, 1.0, "efficiency");
    }
    // The mean of 1 + sum x^2 + sum x^2 y^2 over the cube: 1 + 3/3 + 3/9.
    let prediction = found.prediction.as_ref().unwrap();
    near(prediction.mean, 7.0 / 3.0, "mean");
    near(prediction.max, 7.0, "largest, at a corner");
    assert!(prediction.at.0.iter().zip([[300.0, 400.0], [0.0, 1.0], [2.0, 6.0]]).all(|((_, x), ends)| ends.contains(x)));
    near(efficiency.i.unwrap(), 3.0, "I");
    for term in &found.terms {
        near(term.variance.unwrap(), 0.125, &term.term);
        assert!(term.vif.is_none_or(|vif| (vif - 1.0).abs() < NEAR));
        assert_eq!(term.vif.is_none(), term.term == "1");
    }
    assert_eq!(found.leverage.runs.len(), 8);
    found.leverage.of_runs.iter().for_each(|leverage| near(*leverage, 7.0 / 8.0, "leverage"));
    // a b c, and the squares, which are 1 on every run.
    let aliases = found.aliases.unwrap();
    let of_constant: Vec<&str> = aliases[0].with.iter().map(|it| it.term.as_str()).collect();
    assert_eq!((aliases[0].term.as_str(), of_constant), ("1", vec!["a^2", "b^2", "c^2"]));
    assert!(aliases.iter().flat_map(|row| &row.with).all(|alias| (alias.factor - 1.0).abs() < NEAR));
}

#[test]
fn a_rotatable_design_of_two_factors_has_the_numbers_of_the_textbook() {
    let found = Experiment::central_composite(within(2), Alpha::Rotatable).centre_points(5).evaluate().unwrap();
    // Myers, Montgomery, Anderson-Cook, 7.4: 1/8 for first order, 0.1438 for squares, 1/4 for the interaction, 1/5 for the constant.
    let variances: Vec<f64> = found.terms.iter().map(|term| term.variance.unwrap()).collect();
    for (found, expected) in variances.iter().zip([0.2, 0.125, 0.125, 0.14375, 0.25, 0.14375]) {
        near(*found, expected, "variance");
    }
    // Sum x^2 is 8, sum x^4 is 12 over 13 runs.
    near(found.terms[3].vif.unwrap(), 0.14375 * (12.0 - 64.0 / 13.0), "VIF of a square");
    near(found.terms[4].vif.unwrap(), 1.0, "VIF of the interaction");
    near(found.leverage.largest, 0.625, "corners and axial points");
    assert_eq!(found.leverage.runs.len(), 8);
    assert_eq!((found.freedom.residual, found.freedom.lack_of_fit, found.freedom.pure_error), (7, 3, 4));
    assert_eq!((found.points, found.runs_outside), (9, 4));
    // Rotatable: in the square the variance is largest at a corner, at the distance of the axial points.
    near(found.prediction.as_ref().unwrap().max, 13.0 * 0.625, "variance at a corner");
    // x1^3 is in x1 with sum x^4 over sum x^2, x1 x2^2 with 4/8.
    let aliases = found.aliases.unwrap();
    let of_x1: Vec<(&str, f64)> = aliases[0].with.iter().map(|it| (it.term.as_str(), it.factor)).collect();
    assert_eq!((aliases[0].term.as_str(), of_x1.len()), ("x1", 2));
    assert_eq!((of_x1[0].0, of_x1[1].0), ("x1^3", "x1*x2^2"));
    near(of_x1[0].1, 1.5, "x1^3");
    near(of_x1[1].1, 0.5, "x1*x2^2");
}

#[test]
fn terms_that_runs_cannot_determine_are_named() {
    let corners = vec![vec![-1.0, -1.0], vec![1.0, -1.0], vec![-1.0, 1.0], vec![1.0, 1.0], vec![1.0, 1.0]];
    let found = Experiment::optimal(within(2), 6, Criterion::D).evaluate_runs(&Runs::new(corners)).unwrap();
    assert!(!found.is_estimable());
    assert_eq!((found.rank, found.parameters, found.efficiency.d), (4, 6, 0.0));
    let relations: Vec<&str> = found.dependent.iter().map(|it| it.relation.as_str()).collect();
    assert_eq!(relations, ["x1^2 = 1", "x2^2 = 1"]);
    let names = |estimable: bool| -> Vec<&str> {
        found.terms.iter().filter(|it| it.estimable == estimable).map(|it| it.term.as_str()).collect()
    };
    assert_eq!(names(false), ["1", "x1^2", "x2^2"]);
    assert_eq!(names(true), ["x1", "x2", "x1*x2"]);
    // The others have the numbers of the model without the squares. X'X of 1, x1, x2, x1 x2: 5 on the diagonal, 1 elsewhere; its inverse has
    // (5 + 2)/(4 * 8) on the diagonal.
    for term in found.terms.iter().filter(|it| it.estimable) {
        near(term.variance.unwrap(), 7.0 / 32.0, &term.term);
        // Centred: 5 - 1/5.
        near(term.vif.unwrap(), 7.0 / 32.0 * 4.8, &term.term);
    }
    assert!(found.prediction.is_none() && found.efficiency.g.is_none());
    assert_eq!((found.freedom.residual, found.freedom.pure_error, found.freedom.lack_of_fit), (1, 1, 0));
}

#[test]
fn the_determinant_is_that_of_the_search() {
    // The design of nine runs is the grid 3 x 3, with |X'X|^(1/6)/9 = 0.46224085.
    let found = Experiment::optimal(within(2), 9, Criterion::D).evaluate().unwrap();
    assert!((found.efficiency.d - 0.46224085).abs() < 5e-9, "{}", found.efficiency.d);
}

/// The certified column of the file, by gloptipoly; a grid finds maxima that are too small by up to 2.6 points.
#[test]
fn largest_variances_of_published_designs_are_those_that_are_certified() {
    let Some(folder) = shared("doe-reference") else { return };
    let text = std::fs::read_to_string(folder.join("g_optimal_exact.json")).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    let designs = json["designs"].as_array().unwrap();
    assert_eq!(designs.len(), 29);
    let mut missed = Vec::new();
    for design in designs {
        let points: Points = serde_json::from_value(design["design"].clone()).unwrap();
        let factors = points[0].len();
        let found = Experiment::optimal(within(factors), points.len(), Criterion::I).evaluate_runs(&Runs::new(points)).unwrap();
        let (g, certified) = (found.efficiency.g.unwrap(), design["certified_G_eff_percent_gloptipoly"].as_f64().unwrap());
        // The designs have six digits behind the point, the percentages four: a few of the last.
        if (100.0 * g - certified).abs() > 5e-4 {
            missed.push(format!("{factors} factors, {} runs: {} {certified}", found.runs, 100.0 * g));
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// A generator of our own for this file (Knuth's 64-bit linear congruence), so that nothing is shared.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        2.0 * ((self.0 >> 11) as f64 / (1u64 << 53) as f64) - 1.0
    }
}

fn term(powers: &[u32], point: &[f64]) -> f64 {
    powers.iter().zip(point).map(|(power, x)| x.powi(*power as i32)).product()
}

fn matrix(terms: &[Vec<u32>], points: &Points) -> DMatrix<f64> {
    DMatrix::from_fn(points.len(), terms.len(), |row, column| term(&terms[column], &points[row]))
}

/// Compares everything with pseudo-inverses by singular values, regressions of one column on the others, and a grid.
fn compare(found: &Evaluation, terms: &[Vec<u32>], points: &Points, blocks: &[u32], in_region: &dyn Fn(&[f64]) -> bool) {
    let mut x = matrix(terms, points);
    let last = blocks.iter().max().copied().unwrap_or(0);
    for block in 1..last {
        let contrast = |of: &u32| if *of == last { -1.0 } else { f64::from(u8::from(*of == block)) };
        let column = DVector::from_iterator(points.len(), blocks.iter().map(contrast));
        let place = x.ncols();
        x = x.insert_column(place, 0.0);
        x.set_column(place, &column);
    }
    let (n, p) = (x.nrows() as f64, x.ncols());
    let singular = x.clone().svd(false, false).singular_values;
    let log: f64 = singular.iter().map(|s| 2.0 * s.ln()).sum();
    near(found.efficiency.d, (log / p as f64).exp() / n, "D");
    let pseudo = x.clone().pseudo_inverse(1e-12).unwrap();
    let inverse = &pseudo * pseudo.transpose();
    let width = terms.len();
    let trace: f64 = (0..width).map(|k| inverse[(k, k)]).sum();
    near(found.efficiency.a.unwrap(), width as f64 / (n * trace), "A");
    let hat = &x * &pseudo;
    for (run, leverage) in found.leverage.of_runs.iter().enumerate() {
        near(*leverage, hat[(run, run)], "leverage");
    }
    for (k, it) in found.terms.iter().enumerate() {
        near(it.variance.unwrap(), inverse[(k, k)], "variance");
        if let Some(vif) = it.vif {
            // 1/(1 - R^2) of this column on the others.
            let column = x.column(k).into_owned();
            let others = x.clone().remove_column(k);
            let left = &column - &others * (others.clone().pseudo_inverse(1e-12).unwrap() * &column);
            let mean = column.mean();
            let spread: f64 = column.iter().map(|x| (x - mean) * (x - mean)).sum();
            // A division by a small residual: some digits fewer.
            assert!((vif - spread / left.norm_squared()).abs() < 1e-9 * vif, "{}: {vif}", it.term);
        }
    }
    for row in found.aliases.as_ref().unwrap() {
        let place = found.terms.iter().position(|it| it.term == row.term).unwrap();
        for alias in &row.with {
            let powers = powers_of(&alias.term, terms[0].len());
            let column = DVector::from_iterator(points.len(), points.iter().map(|point| term(&powers, point)));
            near(alias.factor, (&pseudo * column)[place], "alias");
        }
    }
    // A grid of 25 points a factor.
    let factors = terms[0].len();
    let variance = |point: &[f64]| {
        let f = DVector::from_iterator(p, terms.iter().map(|powers| term(powers, point)).chain(vec![0.0; p - width]));
        n * f.dot(&(&inverse * &f))
    };
    let prediction = found.prediction.as_ref().unwrap();
    let at: Vec<f64> = prediction.at.0.iter().map(|(_, x)| *x).collect();
    // The region is tightened by 1e-9 for rounding; the variance has slopes of at most some hundred.
    assert!(in_region(&at) && (variance(&at) - prediction.max).abs() < 1e-6 * prediction.max);
    let (mut sum, mut count, mut largest) = (0.0, 0.0, 0f64);
    let mut values = Vec::new();
    for k in 0..25usize.pow(factors as u32) {
        let point: Vec<f64> = (0..factors).map(|factor| (k / 25usize.pow(factor as u32) % 25) as f64 / 12.5 - 0.96).collect();
        if in_region(&point) {
            let value = variance(&point);
            (sum, count, largest) = (sum + value, count + 1.0, largest.max(value));
            values.push(value);
        }
    }
    assert!(largest <= prediction.max * (1.0 + 1e-9), "{largest} {}", prediction.max);
    // Middles of cells: the grid is a rule of second order with steps of 0.08; cells at the edge of the region are counted whole or not.
    assert!((prediction.mean - sum / count).abs() < 0.05 * prediction.mean, "{} {}", prediction.mean, sum / count);
    values.sort_by(f64::total_cmp);
    for quantile in &prediction.quantiles {
        let here = values[((quantile.share * count) as usize).min(values.len() - 1)];
        // 8192 random points: a share has a standard deviation of at most 0.0055; the density of values is at least a tenth of its mean.
        assert!((quantile.value - here).abs() < 0.12 * here, "{quantile:?} {here}");
    }
}

/// x1^2*x3.
fn powers_of(name: &str, factors: usize) -> Vec<u32> {
    let mut powers = vec![0; factors];
    for part in name.split('*').filter(|part| *part != "1") {
        let (factor, power) = part.split_once('^').unwrap_or((part, "1"));
        powers[factor[1..].parse::<usize>().unwrap() - 1] = power.parse().unwrap();
    }
    powers
}

fn second_order(factors: usize) -> Vec<Vec<u32>> {
    let unit = |k: usize| (0..factors).map(|j| u32::from(j == k)).collect::<Vec<u32>>();
    let sum = |a: &[u32], b: &[u32]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<u32>>();
    let mut terms = vec![vec![0; factors]];
    terms.extend((0..factors).map(unit));
    terms.extend((0..factors).flat_map(|i| (i..factors).map(move |j| sum(&unit(i), &unit(j)))));
    terms
}

#[test]
fn random_designs_have_the_numbers_of_another_computation() {
    let mut draws = Draws(7);
    for runs in [12, 15, 40] {
        let points: Points = (0..runs).map(|_| (0..3).map(|_| draws.next()).collect()).collect();
        let found = Experiment::random(within(3), runs).evaluate_runs(&Runs::new(points.clone())).unwrap();
        compare(&found, &second_order(3), &points, &[], &|_| true);
    }
}

#[test]
fn a_region_with_a_condition_and_blocks_has_the_numbers_of_another_computation() {
    let mut draws = Draws(3);
    let mut points: Points = (0..60).map(|_| vec![draws.next(), draws.next()]).collect();
    points.retain(|point| point[0] + point[1] <= 0.5);
    points.truncate(20);
    let blocks: Vec<u32> = (0..20).map(|run| 1 + run % 3).collect();
    let runs = Runs { blocks: blocks.clone(), ..Runs::new(points.clone()) };
    let experiment = Experiment::random(within(2), 20).at_most([("x1", 1.0), ("x2", 1.0)], 0.5);
    let found = experiment.evaluate_runs(&runs).unwrap();
    assert_eq!((found.parameters, found.terms_of_model), (8, 6));
    compare(&found, &second_order(2), &points, &blocks, &|point| point[0] + point[1] <= 0.5);
}

#[test]
fn the_power_of_a_factorial_is_that_of_its_closed_form() {
    // Sixteen runs of 2^4, first order: variance 1/16, 11 degrees of freedom. An effect of two standard deviations is a coefficient of one:
    // noncentrality 4.
    let factors = ["a", "b", "c", "d"].map(|name| Factor::at(name, "1", [-1.0, 1.0]));
    let found = Experiment::full_factorial(factors).order(1).evaluate().unwrap();
    assert_eq!(found.freedom.residual, 11);
    // The distribution by integration over the chi distribution with a step of 1/1000, in normal probabilities by a rule of its own.
    let normal = |z: f64| {
        let step = 1e-3;
        let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
        (0..20_000).map(|k| step * density(z + step * (f64::from(k) + 0.5))).sum::<f64>()
    };
    let t = rsm_fit::distributions::quantile_t(0.95, 11);
    let (mut sum, mut total) = (0.0, 0.0);
    for k in 1..300 {
        let s = f64::from(k) / 100.0;
        let density = s.powi(10) * (-5.5 * s * s).exp();
        total += density;
        sum += density * (normal(t * s - 4.0) + normal(t * s + 4.0));
    }
    for term in &found.terms[1..] {
        // Steps of 0.01 of a smooth density that vanishes at both ends, and a normal probability to 1e-7.
        assert!((term.power.unwrap()[1] - sum / total).abs() < 1e-6, "{:?} {}", term.power, sum / total);
        assert!(term.power.unwrap()[0] < term.power.unwrap()[1]);
    }
    assert!(found.terms[0].power.is_none());
}

#[test]
fn bad_runs_are_refused_with_file_and_line() {
    let text = "format = 1\nplan = \"p\"\nseed = 1\norder = 1\n[factors.a]\nunit = \"K\"\nlevels = [300, 400]\n[factors.b]\nunit = \"1\"\nlevels = [0, 1]\n";
    let specification = DesignSpecification::from_source(Source::new("p.toml", text)).unwrap();
    let refused = |text: &str| Runs::from_source(&Source::new("runs.csv", text), &specification).unwrap_err().to_string();
    assert!(refused("a[K],c[1]\n300,1\n").contains("runs.csv:1: there is no column `b`"), "{}", refused("a[K],c[1]\n300,1\n"));
    assert!(refused("a[m],b[1]\n300,1\n").starts_with("runs.csv:1: column 1 `a`: "));
    assert!(
        refused("run[1],a[K],b[1]\n1,300,0\n1.5,400,1\n")
            .starts_with("runs.csv:3: column 1 `run`: found 1.5, expected a whole number")
    );
    assert!(refused("run[1],block[1],a[K],b[1]\n1,0,300,0\n").starts_with("runs.csv:2: column 2 `block`: found 0"));
    assert!(refused("a[K],b[1]\n300,x\n").starts_with("runs.csv:2"));
    // Units are converted.
    let runs = Runs::from_source(&Source::new("runs.csv", "b[1],a[mK]\n0,300000\n"), &specification).unwrap();
    assert_eq!(runs.points, [[300.0, 0.0]]);
    let faults = specification.evaluate(&Runs::new(Vec::new())).unwrap_err();
    assert!(faults.to_string().contains("the design has no run"), "{faults}");
}
