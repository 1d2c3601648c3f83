//! Robust losses: published results, optimality, and contaminated surfaces with a known truth.

use rsm_core::model::Coding;
use rsm_fit::random::Random;
use rsm_fit::spec::{Criterion, Direction, Form, Loss, Search, SearchBy};
use rsm_fit::statistics::ResponseStatistics;
use rsm_fit::{Fit, Input, Outcome, Response, Select};

/// Brownlee 1965, Statistical Theory and Methodology in Science and Engineering, 13.12: air flow, water temperature, acid concentration, loss.
const STACKLOSS: [[f64; 4]; 21] = [
    [80.0, 27.0, 89.0, 42.0],
    [80.0, 27.0, 88.0, 37.0],
    [75.0, 25.0, 90.0, 37.0],
    [62.0, 24.0, 87.0, 28.0],
    [62.0, 22.0, 87.0, 18.0],
    [62.0, 23.0, 87.0, 18.0],
    [62.0, 24.0, 93.0, 19.0],
    [62.0, 24.0, 93.0, 20.0],
    [58.0, 23.0, 87.0, 15.0],
    [58.0, 18.0, 80.0, 14.0],
    [58.0, 18.0, 89.0, 14.0],
    [58.0, 17.0, 88.0, 13.0],
    [58.0, 18.0, 82.0, 11.0],
    [58.0, 19.0, 93.0, 12.0],
    [50.0, 18.0, 89.0, 8.0],
    [50.0, 18.0, 86.0, 7.0],
    [50.0, 19.0, 72.0, 8.0],
    [50.0, 19.0, 79.0, 8.0],
    [50.0, 20.0, 80.0, 9.0],
    [56.0, 20.0, 82.0, 15.0],
    [70.0, 20.0, 91.0, 15.0],
];

fn stackloss(loss: Loss) -> ResponseStatistics {
    let inputs = ["air", "water", "acid"].iter().enumerate();
    let inputs: Vec<Input> = inputs.map(|(k, name)| Input::new(*name, STACKLOSS.map(|row| row[k]))).collect();
    let response = Response::new("loss", STACKLOSS.map(|row| row[3])).coding(Coding::None).loss(loss);
    let outcome = Fit::new(inputs, response).order(1).fit().unwrap();
    outcome.statistics("loss").unwrap().clone()
}

fn coefficients(statistics: &ResponseStatistics) -> Vec<f64> {
    statistics.terms.iter().map(|term| term.coefficient).collect()
}

fn near(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance), "{found:?} {expected:?}");
}

#[test]
fn huber_has_the_coefficients_of_another_package() {
    let found = stackloss(Loss::Huber);
    // R 4, MASS::rlm(stack.loss ~ ., stackloss) prints four decimals and stops when the errors change by less than 1e-4 of them.
    near(&coefficients(&found), &[-41.0265, 0.8294, 0.9261, -0.1278], 1e-4);
    let errors: Vec<f64> = found.terms.iter().map(|term| term.standard_error.unwrap()).collect();
    for (found, expected) in errors.iter().zip([9.8073, 0.1112, 0.3034, 0.1289]) {
        // Four decimals, and the same stop.
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }
    let loss = found.loss.unwrap();
    println!("{} steps", loss.iterations);
    assert!((loss.scale - 2.441).abs() < 1e-3, "{}", loss.scale);
    assert!(loss.converged && loss.iterations > 10 && loss.unique.is_none());
    // Row 21 is the outlier of the literature; rlm gives it the weight 0.368.
    assert_eq!(loss.low_weight[0].row, 21);
    assert!((loss.low_weight[0].weight - 0.368).abs() < 1e-3, "{:?}", loss.low_weight);
    assert_eq!(loss.low_weight[0].at.0[0], ("air".to_string(), 70.0));
    assert!(found.r2.is_none() && found.residual_sd.is_none() && found.press.is_none() && found.analysis.is_none());
    assert!(found.warnings.iter().any(|warning| warning.kind == "low-weight" && warning.what.contains("row 21 (air = 70, ")));
    assert!(found.cross_validation.is_some());
}

#[test]
fn least_absolute_errors_have_the_coefficients_of_another_package() {
    let found = stackloss(Loss::L1);
    // R 4, quantreg::rq(stack.loss ~ ., data = stackloss): five decimals.
    near(&coefficients(&found), &[-39.68986, 0.83188, 0.57391, -0.06087], 5e-6);
    let loss = found.loss.unwrap();
    println!("{} edges", loss.iterations);
    assert!(loss.converged);
    assert!(found.terms.iter().all(|term| term.standard_error.is_none()));
    assert!(loss.withheld.contains("standard errors need the density"));
}

/// The sum of absolute errors of every line through two of the rows, and through each row and the optimum.
#[test]
fn no_line_has_a_smaller_sum_of_absolute_errors() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        // Whole numbers have many ties: more than two rows on a line, and optima that are not unique.
        let draw = |random: &mut Random| if seed % 2 == 0 { (6.0 * random.share()).floor() } else { random.share() };
        let x: Vec<f64> = (0..11).map(|_| draw(&mut random)).collect();
        let y: Vec<f64> = (0..11).map(|_| draw(&mut random)).collect();
        let response = Response::new("y", &y).coding(Coding::None).loss(Loss::L1);
        let outcome = Fit::new(Input::new("x", &x), response).order(1).fit().unwrap();
        let found = outcome.statistics("y").unwrap();
        let sum = |a: f64, b: f64| x.iter().zip(&y).map(|(x, y)| (y - a - b * x).abs()).sum::<f64>();
        let own = coefficients(found);
        let own = sum(own[0], own[1]);
        let mut least = f64::INFINITY;
        for i in 0..11 {
            for j in (0..i).filter(|j| x[*j] != x[i]) {
                let b = (y[i] - y[j]) / (x[i] - x[j]);
                least = least.min(sum(y[i] - b * x[i], b));
            }
        }
        // An optimum goes through two rows. Some twenty roundings of numbers below 100.
        assert!((own - least).abs() < 1e-12, "{seed}: {own} {least}");
        assert!(found.loss.as_ref().unwrap().converged, "{seed}");
    }
}

#[test]
fn a_tie_is_told() {
    // Any constant from 1 to 2 has the sum 1 + 1.
    let terms = Select::terms([[0u32]]);
    let outcome =
        Fit::new(&[0.0, 1.0, 2.0, 3.0], Response::new("y", [0.0, 1.0, 2.0, 3.0]).loss(Loss::L1).select(terms)).fit().unwrap();
    let found = outcome.statistics("y").unwrap().loss.clone().unwrap();
    assert_eq!((found.unique, found.converged), (Some(false), true));
    assert!(found.words("V").contains("other coefficients have the same sum"));
}

#[test]
fn a_row_of_weight_four_is_a_row_twice_for_absolute_errors() {
    let (x, y) = ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1.0, 2.5, 2.75, 5.0, 4.5, 9.0, 6.75]);
    let weights = [1.0, 4.0, 1.0, 4.0, 1.0, 1.0, 1.0];
    let one = Response::new("y", y).loss(Loss::L1).weights(weights);
    let (mut twice_x, mut twice_y) = (x.to_vec(), y.to_vec());
    for row in [1, 3] {
        twice_x.push(x[row]);
        twice_y.push(y[row]);
    }
    let two = Response::new("y", twice_y).loss(Loss::L1);
    let of = |outcome: Outcome| coefficients(outcome.statistics("y").unwrap());
    let one = of(Fit::new(Input::new("x", x), one).order(1).fit().unwrap());
    let two = of(Fit::new(Input::new("x", twice_x), two).order(1).fit().unwrap());
    // Both pass through the same rows; each rounds once.
    near(&one, &two, 1e-14);
}

#[test]
fn without_outliers_beyond_k_huber_is_least_squares() {
    // Errors of one size: none is beyond 1.345 scales, and the first step has the weights of least squares.
    let x: Vec<f64> = (0..12).map(f64::from).collect();
    let y: Vec<f64> = x.iter().enumerate().map(|(row, x)| 2.0 + 0.5 * x + if row % 3 == 0 { 0.25 } else { -0.25 }).collect();
    let of = |loss| Fit::new(&x, Response::new("y", &y).loss(loss)).order(1).fit().unwrap();
    let (huber, plain) = (of(Loss::Huber), of(Loss::LeastSquares));
    assert_eq!(huber.model.surfaces[0].terms, plain.model.surfaces[0].terms);
    assert!(plain.statistics("y").unwrap().loss.is_none());
    assert_eq!(huber.statistics("y").unwrap().loss.as_ref().unwrap().low_weight, []);
}

/// Quadratics of two inputs, 60 rows with normal noise of 1; one row of ten is wrong by 10 to 40, upwards. The error is the root mean square distance
/// to the truth over a grid.
#[test]
fn contaminated_surfaces_keep_a_small_error() {
    let mut ratios: Vec<[f64; 2]> = Vec::new();
    for seed in 0..30 {
        let mut random = Random::new(seed);
        let truth: Vec<f64> = (0..6).map(|_| 20.0 * random.share() - 10.0).collect();
        let value =
            |x: f64, z: f64| truth[0] + truth[1] * x + truth[2] * z + truth[3] * x * x + truth[4] * x * z + truth[5] * z * z;
        let (mut x, mut z, mut y) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..60 {
            x.push(2.0 * random.share() - 1.0);
            z.push(2.0 * random.share() - 1.0);
            let wrong = if row % 10 == 3 { 10.0 + 30.0 * random.share() } else { 0.0 };
            y.push(value(x[row], z[row]) + random.normal() + wrong);
        }
        let error = |loss| {
            let response = Response::new("y", &y).coding(Coding::None).loss(loss);
            let outcome = Fit::new([Input::new("x", &x), Input::new("z", &z)], response).order(2).fit().unwrap();
            let terms = &outcome.model.surfaces[0].terms;
            let at = |x: f64, z: f64| {
                terms.iter().map(|it| it.coefficient * x.powi(it.powers[0] as i32) * z.powi(it.powers[1] as i32)).sum::<f64>()
            };
            let grid = (0..81).map(|k| (f64::from(k % 9) / 4.0 - 1.0, f64::from(k / 9) / 4.0 - 1.0));
            (grid.map(|(x, z)| (at(x, z) - value(x, z)).powi(2)).sum::<f64>() / 81.0).sqrt()
        };
        let plain = error(Loss::LeastSquares);
        ratios.push([error(Loss::Huber) / plain, error(Loss::L1) / plain]);
    }
    for k in 0..2 {
        let mut own: Vec<f64> = ratios.iter().map(|ratio| ratio[k]).collect();
        own.sort_by(f64::total_cmp);
        println!("{k}: {own:?}");
        // Wrong rows of 25 in the mean, a tenth of all, shift a surface of squares by 2.5 and scatter it by about as much; they shift a robust one by
        // 0.2, and the noise alone gives 0.3. So the ratio is about 0.4/3. The bounds: twice that in the median, four times in the worst of thirty.
        assert!(own[15] < 0.25 && own[29] < 0.5, "{own:?}");
    }
}

/// A surface of two inputs with five terms among the 15 of order 4, its rows with noise of 1, and a share of wrong rows.
struct Family {
    x: Vec<[f64; 2]>,
    y: Vec<f64>,
    is_wrong: Vec<bool>,
    truth: Vec<([u32; 2], f64)>,
}

fn family(seed: u64, rows: usize, wrong: f64) -> Family {
    let mut random = Random::new(seed);
    let x: Vec<[f64; 2]> = (0..rows).map(|_| [2.0 * random.share() - 1.0, 2.0 * random.share() - 1.0]).collect();
    let all: Vec<[u32; 2]> = (0..=4).flat_map(|order| (0..=order).map(move |k| [order - k, k])).collect();
    let mut others = all[1..].to_vec();
    random.shuffle(&mut others);
    let mut truth = vec![([0, 0], 10.0)];
    // Effects of 3 to 6 noises, so that a fit of clean rows finds nearly all of them.
    truth.extend(
        others[..4]
            .iter()
            .map(|powers| (*powers, (3.0 + 3.0 * random.share()) * if random.share() < 0.5 { -1.0 } else { 1.0 })),
    );
    let value =
        |[a, b]: [f64; 2]| truth.iter().map(|(powers, c)| c * a.powi(powers[0] as i32) * b.powi(powers[1] as i32)).sum::<f64>();
    let mut is_wrong: Vec<bool> = (0..rows).map(|row| (row as f64) < wrong * rows as f64).collect();
    random.shuffle(&mut is_wrong);
    let y = x.iter().zip(&is_wrong).map(|(x, is_wrong)| {
        // Wrong by 10 to 40 noises, mostly to one side.
        let by = if *is_wrong { (10.0 + 30.0 * random.share()) * if random.share() < 0.8 { 1.0 } else { -1.0 } } else { 0.0 };
        value(*x) + random.normal() + by
    });
    let y = y.collect();
    Family { x, y, is_wrong, truth }
}

impl Family {
    fn clean(&self) -> Family {
        let kept: Vec<usize> = (0..self.y.len()).filter(|row| !self.is_wrong[*row]).collect();
        let (x, y) = (kept.iter().map(|row| self.x[*row]).collect(), kept.iter().map(|row| self.y[*row]).collect());
        Family { x, y, is_wrong: vec![false; kept.len()], truth: self.truth.clone() }
    }

    fn fit(&self, loss: Loss, search: Search) -> ResponseStatistics {
        let inputs =
            [0, 1].map(|k| Input::new(["a", "b"][k], self.x.iter().map(|x| x[k]).collect::<Vec<f64>>()).range([-1.0, 1.0]));
        let response = Response::new("y", &self.y).loss(loss).select(Select::search(search)).forms([Form::Polynomial]);
        Fit::new(inputs, response).fit().unwrap().statistics("y").unwrap().clone()
    }

    /// The root mean square difference to the truth on a grid, and the numbers of needless and of absent terms.
    fn judged(&self, found: &ResponseStatistics) -> (f64, usize, usize) {
        let at = |[a, b]: [f64; 2], powers: &[u32]| a.powi(powers[0] as i32) * b.powi(powers[1] as i32);
        let error = |x: [f64; 2]| {
            let truth: f64 = self.truth.iter().map(|(powers, c)| c * at(x, powers)).sum();
            found.terms.iter().map(|term| term.coefficient * at(x, &term.powers)).sum::<f64>() - truth
        };
        let grid = (0..441).map(|k| [f64::from(k % 21) / 10.0 - 1.0, f64::from(k / 21) / 10.0 - 1.0]);
        let square: f64 = grid.map(|x| error(x).powi(2)).sum();
        let is_true = |powers: &[u32]| self.truth.iter().any(|(known, _)| known[..] == *powers);
        let needless = found.terms.iter().filter(|term| !is_true(&term.powers)).count();
        let absent = self.truth.len() + needless - found.terms.len();
        ((square / 441.0).sqrt(), needless, absent)
    }
}

#[test]
fn terms_are_chosen_as_on_rows_without_the_wrong_ones() {
    let searches = [
        ("stepwise, k-fold", SearchBy::Stepwise(Direction::Both), Criterion::KFold),
        ("stepwise, aicc", SearchBy::Stepwise(Direction::Both), Criterion::Aicc),
        ("lasso, k-fold", SearchBy::Lasso, Criterion::KFold),
    ];
    for (name, by, criterion) in searches {
        let search = Search { criterion: Some(criterion), ..Search::new(by, 4) };
        let mut figures: Vec<(&str, Vec<f64>, usize, usize)> =
            ["clean, least squares", "least squares", "huber", "l1"].map(|who| (who, Vec::new(), 0, 0)).to_vec();
        let surfaces = 20;
        for seed in 0..surfaces {
            let family = family(seed, 200, 0.05);
            let clean = family.clean();
            let fits = [
                clean.fit(Loss::LeastSquares, search),
                family.fit(Loss::LeastSquares, search),
                family.fit(Loss::Huber, search),
                family.fit(Loss::L1, search),
            ];
            for ((_, errors, needless, absent), found) in figures.iter_mut().zip(&fits) {
                let (error, more, fewer) = family.judged(found);
                errors.push(error);
                *needless += more;
                *absent += fewer;
            }
            // The wrong rows are named, and the report says how the terms were chosen.
            let huber = &fits[2];
            assert!(
                huber.selection.is_some() && huber.rows_used.terms.ends_with("with the weights of a robust fit"),
                "{:?}",
                huber.rows_used
            );
            let listed: Vec<usize> = huber.loss.as_ref().unwrap().low_weight.iter().map(|row| row.row - 1).collect();
            assert!((0..200).filter(|row| family.is_wrong[*row]).all(|row| listed.contains(&row)), "{seed}");
        }
        let median = |errors: &Vec<f64>| {
            let mut sorted = errors.clone();
            sorted.sort_by(f64::total_cmp);
            sorted[sorted.len() / 2]
        };
        for (who, errors, needless, absent) in &figures {
            println!(
                "{name}, {who}: error {:.3}, {needless} needless and {absent} absent terms of {surfaces} surfaces",
                median(errors)
            );
        }
        let [clean, least, huber, l1] = [0, 1, 2, 3].map(|k| median(&figures[k].1));
        // Huber's loss has 95 % of the efficiency of least squares on clean rows, which also are 5 % fewer, but wrong rows are to one side and pull
        // by k scales each. Least absolute errors have 64 %: errors 25 % larger. Measured: up to 1.07 and 1.17 times those on clean rows.
        assert!(huber < 1.2 * clean && l1 < 1.4 * clean, "{name}: {clean} {huber} {l1}");
        assert!(huber < 0.3 * least && l1 < 0.3 * least, "{name}: {least} {huber} {l1}");
        // All true terms, and as many needless ones as on clean rows: some twenty to ninety, whose difference has a standard deviation of about 5.
        for k in [2, 3] {
            assert_eq!((figures[k].3, figures[0].3), (0, 0), "{name}");
            assert!(figures[k].2 <= figures[0].2 + 12, "{name}");
        }
        assert!(figures[1].3 > 20, "{name}");
    }
}
