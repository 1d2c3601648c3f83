//! Figures against exact rational arithmetic, closed forms of tails, and boundaries.

use num_traits::ToPrimitive;
use rsm_core::model::{Coding, Input, Outside, Surface};
use rsm_core::number::{Rational, exact, integer};

use super::*;
use crate::qr::Compressed;
use crate::random::Random;
use crate::reference::{Problem, dot, whole};

/// Rows of inputs, response and weights (none: all alike).
#[derive(Debug, Clone, Default)]
struct Data {
    columns: Vec<Vec<f64>>,
    response: Vec<f64>,
    weights: Vec<f64>,
}

impl Data {
    fn line(x: &[f64], y: &[f64]) -> Self {
        Data { columns: vec![x.to_vec()], response: y.to_vec(), weights: Vec::new() }
    }

    fn observed<T>(&self, act: impl FnOnce(Observations<'_>) -> T) -> T {
        let inputs: Vec<&[f64]> = self.columns.iter().map(Vec::as_slice).collect();
        act(Observations { inputs: &inputs, response: &self.response, weights: &self.weights })
    }

    fn design(&self, terms: &[Vec<u32>]) -> Design {
        let names: Vec<String> = (0..self.columns.len()).map(|k| format!("x{k}")).collect();
        let input =
            |name: &String| Input { name: name.clone(), unit: "1".into(), range: [-10.0, 10.0], outside: Outside::Clamp };
        let inputs: Vec<Input> = names.iter().map(input).collect();
        let surface = Surface { inputs: names, coding: Coding::None, ..Surface::default() };
        Design::new(&surface, &inputs, terms.to_vec())
    }

    fn row(&self, terms: &[Vec<u32>], row: usize) -> Vec<f64> {
        let power = |(column, power): (&Vec<f64>, &u32)| column[row].powi(*power as i32);
        terms.iter().map(|powers| self.columns.iter().zip(powers).map(power).product()).collect()
    }

    fn exact(&self, terms: &[Vec<u32>]) -> Problem {
        let rows: Vec<Vec<f64>> = (0..self.response.len()).map(|row| self.row(terms, row)).collect();
        let problem = Problem::of(&rows, &self.response);
        if self.weights.is_empty() { problem } else { problem.weighted(&self.weights) }
    }

    fn figures(&self, terms: &[Vec<u32>]) -> ResponseStatistics {
        let design = self.design(terms);
        self.observed(|rows| {
            let mut compressed = Compressed::new(terms.len() + 1);
            for (row, y) in self.response.iter().enumerate() {
                let terms = design.row_as_measured(&rows.point(row)).into_iter().chain([Dd::from(*y)]);
                compressed.push(terms.map(|x| x * rows.weight(row).sqrt()));
            }
            let all: Vec<usize> = (0..terms.len()).collect();
            of_fit(&design, &Growing::of(&compressed.finish(), &all).unwrap(), rows)
        })
    }
}

fn powers(of: &[u32]) -> Vec<Vec<u32>> {
    of.iter().map(|power| vec![*power]).collect()
}

/// Double-double leaves the last f64 digit right: an ulp or two for what is rounded in between (C, the division in the check).
fn is_near(what: &str, found: Option<f64>, expected: f64) {
    let found = found.unwrap_or_else(|| panic!("{what}: none, expected {expected}"));
    assert!((found - expected).abs() <= 4e-16 * expected.abs().max(1e-300), "{what}: {found:e}, expected {expected:e}");
}

/// As it is written, to f64.
fn rounded(value: &Rational) -> f64 {
    value.to_f64().unwrap()
}

#[test]
fn tails_agree_with_tables() {
    // R: 2 * pt(-1.2088, 4) = 0.2933; pf(95.7335, 2, 2, lower.tail = FALSE) = 0.01034; 2 * pt(-1056.067, 7) = 1.8e-19.
    assert!((two_sided_t(1.2088, 4.0).unwrap() - 0.2933).abs() < 5e-5);
    assert!((upper_f(95.7335, [2.0, 2.0]).unwrap() - 0.01034).abs() < 5e-6);
    assert_eq!(two_sided_t(0.0, 5.0), Some(1.0));
}

#[test]
fn tails_agree_with_their_closed_forms() {
    // Two degrees of freedom: P(|T| > t) = 1 - t/sqrt(2 + t^2). Four: with s = t/sqrt(4 + t^2) it is 1 - s (3 - s^2)/2.
    for t in [0.1, 0.7, 1.0, 3.0, 30.0] {
        for sign in [1.0, -1.0] {
            let [two, four] = [2.0, 4.0].map(|freedom| two_sided_t(sign * t, freedom).unwrap());
            let s: f64 = t / (4.0 + t * t).sqrt();
            // The difference from 1 loses up to three digits at t = 30.
            assert!((two / (1.0 - t / (2.0 + t * t).sqrt()) - 1.0).abs() < 1e-12, "{t}");
            assert!((four - (1.0 - s * (3.0 - s * s) / 2.0)).abs() < 1e-14, "{t}");
        }
    }
    // P(F > f) of 2 and d: (1 + 2 f/d)^(-d/2). Of d and 2: 1 - (d f/(2 + d f))^(d/2).
    for f in [0.2f64, 1.0, 2.5, 40.0] {
        for d in [1.0, 2.0, 3.0, 8.0] {
            let (of_two, in_two) = (upper_f(f, [2.0, d]).unwrap(), upper_f(f, [d, 2.0]).unwrap());
            assert!((of_two / (1.0 + 2.0 * f / d).powf(-d / 2.0) - 1.0).abs() < 1e-12, "{f} {d}");
            assert!((in_two - (1.0 - (d * f / (2.0 + d * f)).powf(d / 2.0))).abs() < 1e-13, "{f} {d}");
        }
    }
}

#[test]
fn four_points_worked_by_hand() {
    // Slope 9/10, intercept 1/10; residuals 0, 0.6, -0.8... worked: mean 2.375, Sxx 5, Sxy 4.25, slope 0.85, intercept 0.25;
    // fits 1.1, 1.95, 2.8, 3.65, residuals -0.1, 0.55, -0.8, 0.35: square 1.075 with 2 degrees; total 4.6875 with 3.
    let found = Data::line(&[1.0, 2.0, 3.0, 4.0], &[1.0, 2.5, 2.0, 4.0]).figures(&powers(&[0, 1]));
    is_near("intercept", Some(found.terms[0].coefficient), 0.25);
    is_near("slope", Some(found.terms[1].coefficient), 0.85);
    is_near("residual sd", found.residual_sd, 0.5375f64.sqrt());
    is_near("R2", found.r2, 1.0 - 1.075 / 4.6875);
    is_near("adjusted R2", found.r2_adjusted, 1.0 - 0.5375 / 1.5625);
    // The variance of the slope is s^2/5, of the intercept s^2 (1/4 + 2.5^2/5) = 3 s^2/2.
    is_near("error of the slope", found.terms[1].standard_error, (0.5375f64 / 5.0).sqrt());
    is_near("error of the intercept", found.terms[0].standard_error, (0.5375f64 * 1.5).sqrt());
    let t = 0.85 / (0.5375f64 / 5.0).sqrt();
    is_near("t", found.terms[1].t, t);
    let p = 1.0 - t / (2.0 + t * t).sqrt();
    assert!((found.terms[1].p.unwrap() - p).abs() < 1e-14);
    // Leverages 0.7, 0.3, 0.3, 0.7: the errors without the point are -1/3, 11/14, -8/7, 7/6.
    let press = 1.0 / 9.0 + 121.0 / 196.0 + 64.0 / 49.0 + 49.0 / 36.0;
    is_near("PRESS", found.press, press);
    is_near("predicted R2", found.r2_predicted, 1.0 - press / 4.6875);
    assert_eq!(found.lack_of_fit, None, "no replicates");
    assert_eq!(found.rows, 4);
}

#[test]
fn a_value_is_the_sum_of_products_of_terms_and_coefficients() {
    // 1 + 3 x - 2 x^2 at 5.
    let numbers = |of: [f64; 3]| of.map(Dd::from);
    assert_eq!(value(&numbers([1.0, 5.0, 25.0]), &numbers([1.0, 3.0, -2.0])).to_f64(), -34.0);
}

#[test]
fn degrees_of_freedom_count_the_constant_only_where_there_is_one() {
    // Through the origin: b = (1 + 4 + 12)/14, residual square 21 - 289/14 = 5/14 with 2 degrees, total 21 with all 3: 1 - (5/28)/7.
    let data = Data::line(&[1.0, 2.0, 3.0], &[1.0, 2.0, 4.0]);
    let found = data.figures(&powers(&[1]));
    assert!((found.r2_adjusted.unwrap() - (1.0 - 5.0 / 196.0)).abs() < 1e-15, "{found:?}");
    assert!((found.r2.unwrap() - (1.0 - 5.0 / 294.0)).abs() < 1e-15);
    // With a constant: slope 1.5, residual square 1/6 with 1 degree, total 14/3 with 2: 1 - (1/6)/(7/3).
    let found = data.figures(&powers(&[0, 1]));
    assert!((found.r2_adjusted.unwrap() - (1.0 - 1.0 / 14.0)).abs() < 1e-15, "{found:?}");
    assert!((found.residual_sd.unwrap() - (1.0f64 / 6.0).sqrt()).abs() < 1e-15);
}

#[test]
fn a_negative_slope_is_as_significant_as_a_positive_one() {
    let (x, y) = ([1.0, 2.0, 3.0, 4.0], [1.0, 2.5, 2.0, 4.0]);
    let of = |y: &[f64]| Data::line(&x, y).figures(&powers(&[0, 1]));
    let (up, down) = (of(&y), of(&y.map(|y| -y)));
    assert!(down.terms[1].t.unwrap() < 0.0 && up.terms[1].t.unwrap() > 0.0);
    assert_eq!(up.terms[1].t.map(|t| -t), down.terms[1].t);
    assert_eq!(up.terms[1].p, down.terms[1].p);
}

/// Everything that is told of a fit, from the normal equations in rational arithmetic and from the definition of each figure: rows are really left
/// out for PRESS, replicates are found by comparing points.
fn compare(data: &Data, terms: &[Vec<u32>]) {
    let found = data.figures(terms);
    let problem = data.exact(terms);
    let answer = problem.solve().unwrap();
    let (rows, one) = (data.response.len(), integer(1));
    let freedom = rows - terms.len();
    let count = |n: usize| integer(n as i64);
    let weight_of = |rows: &[usize]| rows.iter().map(|row| problem.weights[*row].clone()).sum::<Rational>();
    let mean_of = |rows: &[usize]| {
        rows.iter().map(|row| &problem.weights[*row] * &problem.response[*row]).sum::<Rational>() / weight_of(rows)
    };
    let all: Vec<usize> = (0..rows).collect();
    let has_constant = terms.iter().any(|powers| powers.iter().all(|power| *power == 0));
    let centre = if has_constant { mean_of(&all) } else { integer(0) };
    let total: Rational = all
        .iter()
        .map(|row| &problem.weights[*row] * (&problem.response[*row] - &centre) * (&problem.response[*row] - &centre))
        .sum();
    let square = &answer.residual_square / count(freedom);
    is_near("residual sd", found.residual_sd, rounded(&square).sqrt());
    is_near("R2", found.r2, rounded(&(&one - &answer.residual_square / &total)));
    let spread = &total / count(rows - usize::from(has_constant));
    is_near("adjusted R2", found.r2_adjusted, rounded(&(&one - &square / spread)));
    for (k, term) in found.terms.iter().enumerate() {
        assert_eq!(term.powers, terms[k]);
        is_near("coefficient", Some(term.coefficient), rounded(&answer.coefficients[k]));
        let variance = &square * &answer.inverse[k][k];
        is_near("standard error", term.standard_error, rounded(&variance).sqrt());
        // t^2 is rational.
        let t = rounded(&(&answer.coefficients[k] * &answer.coefficients[k] / variance)).sqrt();
        let t = if answer.coefficients[k] < integer(0) { -t } else { t };
        is_near("t", term.t, t);
        assert_eq!(term.p, two_sided_t(term.t.unwrap(), freedom as f64));
    }
    let left_out = |row: usize| {
        let others = problem.without(row).solve().unwrap();
        let error = &problem.response[row] - dot(&problem.rows[row], &others.coefficients);
        &problem.weights[row] * &error * &error
    };
    let press: Rational = (0..rows).map(left_out).sum();
    is_near("PRESS", found.press, rounded(&press));
    is_near("predicted R2", found.r2_predicted, rounded(&(&one - press / &total)));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for row in 0..rows {
        let is_here = |group: &&mut Vec<usize>| data.columns.iter().all(|column| column[group[0]] == column[row]);
        match groups.iter_mut().find(is_here) {
            Some(group) => group.push(row),
            None => groups.push(vec![row]),
        }
    }
    let (mut lof, mut pure, mut zero) = (integer(0), integer(0), integer(0));
    for group in &groups {
        let (mean, weight) = (mean_of(group), weight_of(group));
        let gap = &mean - dot(&problem.rows[group[0]], &answer.coefficients);
        lof += &weight * &gap * &gap;
        zero += &weight * &mean * &mean;
        for row in group {
            let error = &problem.response[*row] - &mean;
            pure += &problem.weights[*row] * &error * &error;
        }
    }
    let confidence = integer(100) * (&one - &lof / zero);
    // One rounding of the share, one of its hundredfold.
    assert!((found.confidence_c.unwrap() - rounded(&confidence)).abs() < 1e-13 * (100.0 + rounded(&confidence).abs()));
    let df = [groups.len() - terms.len(), rows - groups.len()];
    if df.contains(&0) {
        assert_eq!(found.lack_of_fit, None);
        return;
    }
    let told = found.lack_of_fit.clone().unwrap();
    assert_eq!(told.df, df);
    if pure == integer(0) {
        assert_eq!((told.f, told.p), (None, None));
    } else {
        is_near("F", told.f, rounded(&(lof / count(df[0]) / (pure / count(df[1])))));
        assert_eq!(told.p, upper_f(told.f.unwrap(), df.map(|df| df as f64)));
    }
    // The same coefficients, held by constraints: the same residuals, and no distribution.
    let coefficients: Vec<f64> = found.terms.iter().map(|term| term.coefficient).collect();
    let held = data.observed(|rows| of_constrained(&data.design(terms), &coefficients, rows));
    let by_hand = problem.left_by(&coefficients.iter().map(|b| exact(*b)).collect::<Vec<_>>());
    is_near("residual sd", held.residual_sd, rounded(&(&by_hand / count(freedom))).sqrt());
    is_near("R2", held.r2, rounded(&(&one - by_hand / total)));
    assert_eq!((held.press, held.r2_predicted), (None, None));
    assert!(held.terms.iter().all(|term| term.standard_error.is_none() && term.t.is_none() && term.p.is_none()));
    assert!(held.lack_of_fit.as_ref().unwrap().p.is_none() && held.lack_of_fit.unwrap().f.is_some() == told.f.is_some());
    assert!(held.r2_adjusted.is_some() && held.confidence_c.is_some());
}

#[test]
fn every_figure_is_that_of_exact_arithmetic() {
    for seed in 0..15 {
        let mut random = Random::new(seed);
        let inputs = 1 + (seed % 2) as usize;
        let constant = if seed % 3 == 0 { 1 } else { 0 };
        let terms: Vec<Vec<u32>> = if inputs == 1 {
            powers(&[0, 1, 2][constant..])
        } else {
            [[0, 0], [1, 0], [0, 1], [1, 1]][constant..].iter().map(|powers| powers.to_vec()).collect()
        };
        // Every point of a small grid once, so that the terms are independent without any one row, and some again.
        let mut points: Vec<Vec<f64>> = Vec::new();
        for a in [-2.0, 1.0, 3.0, 4.0] {
            points.extend(if inputs == 1 { vec![vec![a]] } else { [-1.0, 2.0, 5.0].map(|b| vec![a, b]).to_vec() });
        }
        for _ in 0..seed % 5 {
            points.push(points[random.below(points.len() as u64) as usize].clone());
        }
        let rows = points.len();
        let data = Data {
            columns: (0..inputs).map(|k| points.iter().map(|point| point[k]).collect()).collect(),
            response: (0..rows).map(|_| whole(&mut random, 20) + 0.5).collect(),
            weights: if seed % 4 == 1 {
                (0..rows).map(|_| [0.25, 1.0, 2.25, 4.0][random.below(4) as usize]).collect()
            } else {
                Vec::new()
            },
        };
        compare(&data, &terms);
    }
}

#[test]
fn replicates_that_do_not_scatter_give_no_f() {
    let data = Data::line(&[0.0, 0.0, 1.0, 2.0, 3.0], &[1.0, 1.0, 3.0, 2.0, 4.0]);
    let found = data.figures(&powers(&[0, 1])).lack_of_fit.unwrap();
    assert_eq!(found, LackOfFit { f: None, p: None, df: [2, 1] });
    // As many points as terms: nothing can lack.
    let data = Data::line(&[0.0, 0.0, 1.0], &[1.0, 2.0, 3.0]);
    assert_eq!(data.figures(&powers(&[0, 1])).lack_of_fit, None);
    // The two zeros are one setting.
    let data = Data::line(&[0.0, -0.0, 1.0, 2.0], &[1.0, 2.0, 3.0, 5.0]);
    assert_eq!(data.figures(&powers(&[0, 1])).lack_of_fit.unwrap().df, [1, 1]);
    assert_eq!(data.observed(|rows| rows.replicates()), [vec![0, 1], vec![2], vec![3]]);
    let near = Data::line(&[0.0, 1e-20, 0.0], &[1.0, 2.0, 3.0]);
    assert_eq!(near.observed(|rows| rows.replicates()), [vec![0, 2], vec![1]]);
}

#[test]
fn what_rounding_leaves_of_zero_is_zero_and_nothing_more() {
    // y(0) = 2^84 and, at x = 2, twice the coefficient of x. As a share of |y| = 2^84 the part of the term is the threshold at |b| 2 = 1.
    let big = 2.0f64.powi(84);
    let of = |b: f64| Data::line(&[0.0, 2.0], &[big, 2.0 * b]).figures(&powers(&[1])).terms[0].coefficient;
    assert_eq!([of(0.5), of(-0.5), of(0.75), of(-0.75)], [0.0, 0.0, 0.75, -0.75]);
    // The residual at x = 0 alone: a share of 2^-84 of |y| = 2^86, and more.
    let of = |left: f64| Data::line(&[0.0, 1.0, 0.0], &[left, 4.0 * big, 0.0]).figures(&powers(&[1]));
    let nothing = of(4.0);
    assert_eq!((nothing.residual_sd, nothing.r2, nothing.press, nothing.r2_predicted), (Some(0.0), Some(1.0), None, None));
    assert_eq!((nothing.terms[0].t, nothing.terms[0].p), (None, None));
    is_near("residual sd", of(6.0).residual_sd, 6.0 / 2.0f64.sqrt());
    // No residual, and no row alone with a term: PRESS is nothing too.
    let line = Data::line(&[0.0, 1.0, 2.0, 4.0], &[0.1, 0.1 + 0.3, 0.1 + 0.6, 0.1 + 1.2]);
    let exact = Data { response: line.columns[0].iter().map(|x| 3.0 - x).collect(), ..line };
    let found = exact.figures(&powers(&[0, 1]));
    assert_eq!((found.press, found.r2_predicted, found.residual_sd), (Some(0.0), Some(1.0), Some(0.0)));
    assert_eq!(found.terms[0].standard_error, Some(0.0));
}

#[test]
fn a_row_that_alone_holds_a_term_has_no_error_without_it() {
    // A mean with two weights: what is left of the leverage of the first row is the share of the second.
    let of = |rest: f64| {
        let line = Data::line(&[0.0, 1.0], &[1.0, 2.0]);
        Data { weights: vec![1.0 - rest, rest], ..line }.figures(&powers(&[0]))
    };
    let share = 2.0f64.powi(-40);
    assert_eq!((of(share).press, of(share).r2_predicted), (None, None));
    // The error of each row without it is 1.
    is_near("PRESS", of(1.5 * share).press, 1.0);
    assert!(of(share).r2.is_some());
}

#[test]
fn figures_that_do_not_exist_are_none() {
    // As many rows as terms: no degree of freedom.
    let found = Data::line(&[0.0, 1.0], &[1.0, 2.0]).figures(&powers(&[0, 1]));
    assert_eq!((found.residual_sd, found.r2_adjusted, found.press), (None, None, None));
    assert_eq!((found.terms[1].standard_error, found.terms[1].t, found.terms[1].p), (None, None, None));
    assert_eq!(found.r2, Some(1.0));
    // One row: the spread has no degree of freedom with a constant, and one without.
    let one = |power| Data::line(&[1.0], &[2.0]).figures(&powers(&[power]));
    assert_eq!((one(0).r2, one(1).r2), (None, Some(1.0)));
    // A response of the same value everywhere has no spread; of 0 no C.
    let same = |y: f64| Data::line(&[0.0, 1.0, 2.0], &[y; 3]).figures(&powers(&[0, 1]));
    assert_eq!((same(2.0).r2, same(2.0).r2_adjusted, same(2.0).confidence_c), (None, None, Some(100.0)));
    assert_eq!(same(0.0).confidence_c, None);
}

/// y = 2 x held to [0, 6] over x in [0, 4].
fn judged(x: &[f64], y: &[f64], weights: &[f64], mean: f64) -> Judged {
    let surface = Surface { inputs: vec!["x".into()], coding: Coding::None, ..Surface::default() };
    let input = Input { name: "x".into(), unit: "1".into(), range: [0.0, 4.0], outside: Outside::Clamp };
    let design = Design::new(&surface, &[input], powers(&[1]));
    let columns: [&[f64]; 1] = [x];
    let rows = Observations { inputs: &columns, response: y, weights };
    Judged::of(&design, &[2.0], Some([1.0, 6.0]), rows, Dd::from(mean))
}

#[test]
fn judged_parts_add_up_to_the_whole() {
    // y = 2 x, held to 1..6, at 0, 1, 1, 4 and 5 (clamped to 4): predictions 1, 2, 2, 6, 6; errors 0, 1, -1, -2, 4.
    let whole = judged(&[0.0, 1.0, 1.0, 4.0, 5.0], &[1.0, 3.0, 1.0, 4.0, 10.0], &[], 3.0);
    let parts = judged(&[0.0, 1.0, 1.0], &[1.0, 3.0, 1.0], &[], 3.0).and(judged(&[4.0, 5.0], &[4.0, 10.0], &[], 3.0));
    assert_eq!(whole, parts);
    let found = whole.statistics().unwrap();
    assert_eq!((found.rows, found.mean_abs_error, found.max_abs_error), (5, 8.0 / 5.0, 4.0));
    assert_eq!(found.rmse, (22.0f64 / 5.0).sqrt());
    // By means of repeated points: 2 0 + 4 + 16 = 20 of 1 + 2 4 + 16 + 100 = 125 about zero, of 4 + 2 1 + 1 + 49 = 56 about 3.
    assert_eq!(found.confidence_c, Some(100.0 - 100.0 * 20.0 / 125.0));
    assert_eq!(whole.explained(), Some(36.0 / 56.0));
    // Whichever part is the larger.
    let (small, large) = (judged(&[1.0], &[3.0], &[], 3.0), judged(&[4.0], &[10.0], &[], 3.0));
    assert_eq!([small.and(large), large.and(small)].map(|both| both.statistics().unwrap().max_abs_error), [4.0, 4.0]);
}

#[test]
fn what_cannot_be_judged_is_none() {
    assert_eq!((Judged::NOTHING.statistics(), Judged::NOTHING.explained()), (None, None));
    // No spread about the mean, and responses of 0.
    let flat = judged(&[1.0, 2.0], &[3.0, 3.0], &[], 3.0);
    assert_eq!((flat.explained(), flat.statistics().unwrap().confidence_c), (None, Some(100.0 - 100.0 * 2.0 / 18.0)));
    assert_eq!(judged(&[1.0], &[0.0], &[], 3.0).statistics().unwrap().confidence_c, None);
}

#[test]
fn names_keep_their_order_in_a_map() {
    let named = Named(vec![("b".to_string(), 1.0), ("a".to_string(), 2.5)]);
    assert_eq!(serde_json::to_string(&named).unwrap(), r#"{"b":1.0,"a":2.5}"#);
}
