//! Autoregressive errors: against dense generalised least squares, against another package, and intervals that contain the truth.

use rsm_core::model::Coding;
use rsm_fit::random::Random;
use rsm_fit::spec::{Criterion, Direction, NoiseOrder, Search, SearchBy};
use rsm_fit::statistics::ResponseStatistics;
use rsm_fit::{Fit, Missing, Outcome, Response, Select};

/// Rows in series: an input that changes slowly, y = 10 + 3 x - 2 x^2 + noise. `phi`: the noise, with innovations of standard deviation 1.
struct Rows {
    series: Vec<usize>,
    x: Vec<f64>,
    y: Vec<f64>,
}

fn rows(seed: u64, series: usize, each: usize, phi: &[f64]) -> Rows {
    let mut random = Random::new(seed);
    let mut rows = Rows { series: Vec::new(), x: Vec::new(), y: Vec::new() };
    for one in 0..series {
        let mut x = random.normal();
        let mut errors = vec![0.0; phi.len()];
        // A run-in of 200 rows: a correlation of 0.9 leaves 10^-9 of the start.
        for row in 0..200 + each {
            x = 0.9 * x + (1.0_f64 - 0.81).sqrt() * random.normal();
            let error = phi.iter().zip(&errors).map(|(phi, error)| phi * error).sum::<f64>() + random.normal();
            errors.insert(0, error);
            errors.truncate(phi.len());
            if row >= 200 {
                rows.series.push(one);
                rows.x.push(x);
                rows.y.push(10.0 + 3.0 * x - 2.0 * x * x + error);
            }
        }
    }
    rows
}

fn fitted(rows: &Rows, order: NoiseOrder) -> Outcome {
    let response = Response::new("y", &rows.y).coding(Coding::None).noise(order);
    Fit::new(&rows.x, response).order(2).series(&rows.series).fit().unwrap()
}

fn figures(outcome: &Outcome) -> ResponseStatistics {
    outcome.statistics("y").unwrap().clone()
}

/// The inverse and the logarithm of the determinant of a positive matrix, by elimination.
fn inverse(mut a: Vec<Vec<f64>>) -> (Vec<Vec<f64>>, f64) {
    let size = a.len();
    for (k, line) in a.iter_mut().enumerate() {
        line.extend((0..size).map(|j| f64::from(u8::from(j == k))));
    }
    let mut logs = 0.0;
    for k in 0..size {
        logs += a[k][k].ln();
        let own: Vec<f64> = a[k].iter().map(|entry| entry / a[k][k]).collect();
        for (_, line) in a.iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let share = line[k];
            line.iter_mut().zip(&own).for_each(|(entry, own)| *entry -= share * own);
        }
        a[k] = own;
    }
    (a.into_iter().map(|line| line[size..].to_vec()).collect(), logs)
}

/// Generalised least squares with the dense covariance of the errors: coefficients, standard errors, -2 of the restricted likelihood.
struct Dense {
    coefficients: Vec<f64>,
    standard_errors: Vec<f64>,
    deviance: f64,
}

/// The autocovariances for innovations of variance 1: the sum of products of the weights of a long moving average.
fn autocovariances(phi: &[f64], count: usize) -> Vec<f64> {
    let mut weights = vec![1.0];
    // Errors of these series halve in less than 20 rows; 3000 leave less than 2^-150.
    for row in 1..3000 {
        let from = row - phi.len().min(row);
        let next = (from..row).map(|k| phi[row - 1 - k] * weights[k]).sum();
        weights.push(next);
    }
    (0..count).map(|lag| weights[lag..].iter().zip(&weights).map(|(a, b)| a * b).sum()).collect()
}

/// `places`: the place of each row in its series.
fn dense(rows: &Rows, places: &[usize], phi: &[f64]) -> Dense {
    let count = rows.y.len();
    let covariances = autocovariances(phi, places.iter().max().unwrap() + 1);
    let v =
        |i: usize, j: usize| if rows.series[i] == rows.series[j] { covariances[places[i].abs_diff(places[j])] } else { 0.0 };
    let (w, log_v) = inverse((0..count).map(|i| (0..count).map(|j| v(i, j)).collect()).collect());
    let x: Vec<[f64; 3]> = rows.x.iter().map(|x| [1.0, *x, x * x]).collect();
    let product = |a: &dyn Fn(usize) -> f64, b: &dyn Fn(usize) -> f64| -> f64 {
        (0..count).map(|i| a(i) * (0..count).map(|j| w[i][j] * b(j)).sum::<f64>()).sum()
    };
    let normal = (0..3).map(|k| (0..3).map(|l| product(&|i| x[i][k], &|i| x[i][l])).collect()).collect();
    let right: Vec<f64> = (0..3).map(|k| product(&|i| x[i][k], &|i| rows.y[i])).collect();
    let (covariance, log_normal) = inverse(normal);
    let coefficients: Vec<f64> = covariance.iter().map(|line| line.iter().zip(&right).map(|(a, b)| a * b).sum()).collect();
    let error = |i: usize| rows.y[i] - x[i].iter().zip(&coefficients).map(|(x, b)| x * b).sum::<f64>();
    let square = product(&error, &error);
    let m = (count - 3) as f64;
    let standard_errors = (0..3).map(|k| (square / m * covariance[k][k]).sqrt()).collect();
    Dense { coefficients, standard_errors, deviance: m * (square / m).ln() + log_v + log_normal }
}

fn near(found: impl Iterator<Item = f64>, expected: &[f64], tolerance: f64) {
    for (found, expected) in found.zip(expected) {
        assert!((found - expected).abs() <= tolerance * expected.abs().max(1.0), "{found} {expected}");
    }
}

#[test]
fn the_fit_is_dense_generalised_least_squares_and_the_noise_most_likely() {
    for (seed, phi) in [(1, &[0.8][..]), (2, &[0.5, 0.3]), (3, &[1.1, -0.5, 0.2])] {
        let rows = rows(seed, 3, 40, phi);
        let found = figures(&fitted(&rows, NoiseOrder::Given(phi.len())));
        let noise = found.noise.as_ref().unwrap();
        assert_eq!((noise.order, noise.series, noise.gaps), (phi.len(), 3, 0));
        let places: Vec<usize> = (0..120).map(|row| row % 40).collect();
        let exact = dense(&rows, &places, &noise.coefficients);
        // Ten roundings of f64 times the condition of the covariance, about 10^3.
        near(found.terms.iter().map(|term| term.coefficient), &exact.coefficients, 1e-10);
        near(found.terms.iter().map(|term| term.standard_error.unwrap()), &exact.standard_errors, 1e-10);
        let half = found.terms[1].standard_error.unwrap() * 1.980_447_6; // Student's t with 117 degrees of freedom
        near(noise.intervals[1].into_iter(), &[exact.coefficients[1] - half, exact.coefficients[1] + half], 1e-6);
        // No noise beside it is more likely. A change of 0.001 lowers twice the likelihood by 0.0001 or more, since a standard error is about 0.1;
        // the search ends within 10^-6.
        for k in 0..phi.len() {
            for change in [-1e-3, 1e-3] {
                let mut beside = noise.coefficients.clone();
                beside[k] += change;
                let other = dense(&rows, &places, &beside);
                assert!(other.deviance > exact.deviance, "{seed} {k} {change} {} {}", other.deviance, exact.deviance);
            }
        }
    }
}

#[test]
fn rows_that_are_left_out_are_gaps() {
    let mut rows = rows(4, 2, 40, &[0.8]);
    let whole = Rows { series: rows.series.clone(), x: rows.x.clone(), y: rows.y.clone() };
    for row in [3, 4, 17, 40, 79] {
        rows.y[row] = f64::NAN;
    }
    let response = Response::new("y", &rows.y).coding(Coding::None).noise(NoiseOrder::Given(2));
    let outcome = Fit::new(&rows.x, response).order(2).series(&rows.series).missing(Missing::DropRow).fit().unwrap();
    let found = figures(&outcome);
    let kept: Vec<usize> = (0..80).filter(|row| ![3, 4, 17, 40, 79].contains(row)).collect();
    let of = |column: &[f64]| kept.iter().map(|row| column[*row]).collect::<Vec<f64>>();
    let some = Rows { series: kept.iter().map(|row| rows.series[*row]).collect(), x: of(&whole.x), y: of(&whole.y) };
    let places: Vec<usize> = kept.iter().map(|row| row % 40).collect();
    let noise = found.noise.as_ref().unwrap();
    assert_eq!((noise.series, noise.gaps), (2, 2));
    let exact = dense(&some, &places, &noise.coefficients);
    near(found.terms.iter().map(|term| term.coefficient), &exact.coefficients, 1e-10);
    near(found.terms.iter().map(|term| term.standard_error.unwrap()), &exact.standard_errors, 1e-10);
    // Rows that a split sets aside are gaps too; blocks of consecutive rows, as there are two series.
    let response = Response::new("y", &whole.y).coding(Coding::None).noise(NoiseOrder::Given(1));
    let outcome = Fit::new(&whole.x, response).order(2).series(&whole.series).test_share(0.2, 7).fit().unwrap();
    let noise = figures(&outcome).noise.unwrap();
    assert_eq!(figures(&outcome).test.unwrap().rows, 16);
    assert!(noise.gaps <= 2, "{}", noise.gaps);
    let places: Vec<usize> = outcome.fitted.numbers.iter().map(|row| row % 40).collect();
    let (x, y) = (outcome.fitted.inputs[0].clone(), outcome.fitted.responses[0].clone());
    let some = Rows { series: outcome.fitted.series.clone(), x, y };
    let exact = dense(&some, &places, &noise.coefficients);
    near(figures(&outcome).terms.iter().map(|term| term.coefficient), &exact.coefficients, 1e-10);
}

#[test]
fn weights_scale_the_errors() {
    // With weights w the errors times sqrt(w) are autoregressive: the same as a fit of rows that are all multiplied by sqrt(w).
    let rows = rows(5, 1, 60, &[0.7]);
    let weights: Vec<f64> = (0..60).map(|row| if row % 3 == 0 { 4.0 } else { 1.0 }).collect();
    let mean = weights.iter().sum::<f64>() / 60.0;
    let weighted = Response::new("y", &rows.y).coding(Coding::None).noise(NoiseOrder::Given(1)).weights(&weights);
    let found = figures(&Fit::new(&rows.x, weighted).terms([[0], [1]]).fit().unwrap());
    let root: Vec<f64> = weights.iter().map(|weight| (weight / mean).sqrt()).collect();
    let scaled: Vec<[f64; 2]> = rows.x.iter().zip(&root).map(|(x, root)| [*root, x * root]).collect();
    let y: Vec<f64> = rows.y.iter().zip(&root).map(|(y, root)| y * root).collect();
    let response = Response::new("y", y).coding(Coding::None).noise(NoiseOrder::Given(1));
    let other = figures(&Fit::new(&scaled, response).terms([[1, 0], [0, 1]]).fit().unwrap());
    // Products and their root are rounded once more.
    near(
        found.terms.iter().map(|term| term.coefficient),
        &other.terms.iter().map(|term| term.coefficient).collect::<Vec<_>>(),
        1e-9,
    );
    near(found.noise.unwrap().coefficients.into_iter(), &other.noise.unwrap().coefficients, 1e-6);
}

/// Intervals by the usual iteration for order 1: least squares on rows that are transformed as by Prais and Winsten, the correlation from the
/// residuals.
fn prais_winsten(rows: &Rows) -> Vec<[f64; 2]> {
    let count = rows.y.len();
    let is_first = |row: usize| row == 0 || rows.series[row] != rows.series[row - 1];
    let x = |row: usize| [1.0, rows.x[row], rows.x[row].powi(2), rows.y[row]];
    let mut r: f64 = 0.0;
    let mut intervals = Vec::new();
    for _ in 0..50 {
        let whitened = |row: usize| {
            let (own, root) = (x(row), (1.0 - r * r).sqrt());
            if is_first(row) { own.map(|x| root * x) } else { std::array::from_fn(|k| own[k] - r * x(row - 1)[k]) }
        };
        let w: Vec<[f64; 4]> = (0..count).map(whitened).collect();
        let sum = |k: usize, l: usize| w.iter().map(|row| row[k] * row[l]).sum::<f64>();
        let (covariance, _) = inverse((0..3).map(|k| (0..3).map(|l| sum(k, l)).collect()).collect());
        let b: Vec<f64> = covariance.iter().map(|line| (0..3).map(|k| line[k] * sum(k, 3)).sum()).collect();
        let left: f64 = w.iter().map(|row| (row[3] - (0..3).map(|k| b[k] * row[k]).sum::<f64>()).powi(2)).sum();
        let half = |k: usize| 1.97 * (left / (count - 3) as f64 * covariance[k][k]).sqrt();
        intervals = (0..3).map(|k| [b[k] - half(k), b[k] + half(k)]).collect();
        let error = |row: usize| x(row)[3] - (0..3).map(|k| b[k] * x(row)[k]).sum::<f64>();
        let inner: Vec<usize> = (0..count).filter(|row| !is_first(*row)).collect();
        let products: f64 = inner.iter().map(|row| error(*row) * error(row - 1)).sum();
        r = products / (0..count).map(|row| error(row).powi(2)).sum::<f64>();
    }
    intervals
}

/// The share of 95 % intervals of the slope and the square that contain the truth, over recordings from seeds.
struct Coverage {
    ordinary: f64,
    newey_west: f64,
    prais_winsten: f64,
    autoregressive: f64,
}

fn coverage(recordings: u64, series: usize, each: usize, phi: &[f64], order: NoiseOrder) -> Coverage {
    let (mut shares, mut all) = ([0; 4], 0);
    for seed in 0..recordings {
        let rows = rows(1000 + seed, series, each, phi);
        let noise = figures(&fitted(&rows, order)).noise.unwrap();
        let plain = Fit::new(&rows.x, Response::new("y", &rows.y).coding(Coding::None)).order(2).fit().unwrap();
        let plain = figures(&plain);
        let ordinary = |place: usize| plain.analysis.as_ref().unwrap().terms[place].interval;
        // Without a warning the ordinary intervals are all that the fit gives.
        let newey_west = |place: usize| plain.serial.as_ref().map_or_else(|| ordinary(place), |serial| serial.intervals[place]);
        let by_hand = prais_winsten(&rows);
        for (place, truth) in [(1, 3.0), (2, -2.0)] {
            let each = [ordinary(place), newey_west(place), by_hand[place], noise.intervals[place]];
            for (share, [low, high]) in shares.iter_mut().zip(each) {
                *share += usize::from(low <= truth && truth <= high);
            }
            all += 1;
        }
    }
    let [ordinary, newey_west, prais_winsten, autoregressive] = shares.map(|count| count as f64 / all as f64);
    println!(
        "| {series} x {each} | {phi:?} | {ordinary:.3} | {newey_west:.3} | {autoregressive:.3} | (Prais-Winsten {prais_winsten:.3})"
    );
    Coverage { ordinary, newey_west, prais_winsten, autoregressive }
}

#[test]
fn intervals_hold_the_truth_where_those_of_least_squares_do_not() {
    // Four runs of 50 rows, lag-1 correlation 0.8. The standard deviation of a share of 600 intervals near 0.95 is 0.009: 0.93 to 0.97 is more than
    // two of them.
    let found = coverage(300, 4, 50, &[0.8], NoiseOrder::UpTo(2));
    assert!((0.93..=0.97).contains(&found.autoregressive), "{}", found.autoregressive);
    assert!(found.ordinary < 0.8, "{}", found.ordinary);
    assert!(found.newey_west < found.autoregressive && found.prais_winsten <= found.autoregressive + 0.01);
}

/// The table of decision 094 and of the guide.
#[test]
#[ignore = "minutes: prints a table, no assertion; cargo test -p rsm-fit --release --test all -- --ignored --nocapture study_of_coverage"]
fn study_of_coverage() {
    for phi in [&[0.8][..], &[0.95], &[0.5, 0.3]] {
        for (series, each) in [(1, 60), (1, 200), (4, 50), (10, 20)] {
            coverage(500, series, each, phi, NoiseOrder::UpTo(4));
        }
    }
}

#[test]
fn the_order_is_that_of_the_noise_and_whitened_errors_are_not_alike() {
    // AICc takes a needless coefficient in one of six recordings, not in this one.
    let rows = rows(16, 4, 100, &[0.5, 0.4]);
    let found = figures(&fitted(&rows, NoiseOrder::UpTo(4)));
    let noise = found.noise.as_ref().unwrap();
    assert_eq!((noise.order, noise.aicc.len()), (2, 5));
    assert!(noise.aicc.iter().all(|aicc| *aicc >= noise.aicc[2]));
    // Durbin-Watson of 400 independent errors: 2 with a standard deviation of 2/sqrt(400).
    assert!((noise.durbin_watson.unwrap() - 2.0).abs() < 0.3);
    assert!(found.serial.is_none() && !found.warnings.iter().any(|warning| warning.kind == "correlated-residuals"));
    assert!(noise.ratio.unwrap() > 1.2, "{:?}", noise.ratio);
    assert_eq!((found.press, found.r2_predicted, found.analysis.is_none()), (None, None, true));
    let cross = found.cross_validation.as_ref().unwrap();
    assert!(cross.parts == 10 && found.rows_used.error.contains("blocks of consecutive rows"), "{:?}", found.rows_used);
    // phi = (0.5, 0.4): variance 1/((1 - (0.5/0.6)^2)(1 - 0.16)) = 3.896 of innovations of 1; 400 rows tell the root to 10 %.
    assert!((found.residual_sd.unwrap() - 3.896_f64.sqrt()).abs() < 0.4, "{:?}", found.residual_sd);
    assert!((cross.errors.rmse - 3.896_f64.sqrt()).abs() < 0.5, "{}", cross.errors.rmse);
    // Too low an order is told.
    let found = figures(&fitted(&rows, NoiseOrder::Given(1)));
    let told = found.warnings.iter().find(|warning| warning.kind == "correlated-residuals");
    assert!(found.serial.is_some() == told.is_some());
    // Independent errors have order 0, and the figures of least squares.
    let white = self::rows(7, 4, 50, &[]);
    let found = figures(&fitted(&white, NoiseOrder::UpTo(2)));
    assert_eq!(found.noise.as_ref().unwrap().order, 0);
    let plain = figures(&Fit::new(&white.x, Response::new("y", &white.y).coding(Coding::None)).order(2).fit().unwrap());
    near(
        found.terms.iter().map(|term| term.standard_error.unwrap()),
        &plain.terms.iter().map(|term| term.standard_error.unwrap()).collect::<Vec<_>>(),
        1e-14,
    );
}

#[test]
fn whole_series_are_left_out_if_there_are_many() {
    let rows = rows(8, 8, 20, &[0.8]);
    let found = figures(&fitted(&rows, NoiseOrder::Given(1)));
    assert!(found.rows_used.error.ends_with("a part has whole series"), "{}", found.rows_used.error);
    assert_eq!(found.cross_validation.unwrap().parts, 8);
}

#[test]
fn an_outlier_among_slow_errors_is_named() {
    let mut rows = rows(9, 2, 100, &[0.95]);
    // Six innovations, but only two standard deviations of the errors, 3.2.
    rows.y[60] += 6.0;
    let found = figures(&fitted(&rows, NoiseOrder::Given(1)));
    let told = found.warnings.iter().find(|warning| warning.kind == "outliers").expect("an outlier");
    assert!(told.what.contains(&format!("x1 = {}", rows.x[60])), "{}", told.what);
    let plain = figures(&Fit::new(&rows.x, Response::new("y", &rows.y).coding(Coding::None)).order(2).fit().unwrap());
    assert!(!plain.warnings.iter().any(|warning| warning.kind == "outliers"));
}

#[test]
fn terms_are_chosen_on_whitened_rows() {
    // Slow errors look like terms of a slow input: least squares takes some of them, the choice on whitened rows takes fewer.
    let (mut plain, mut whitened, mut has_all) = (0, 0, 0);
    for seed in 0..20 {
        let rows = rows(100 + seed, 4, 50, &[0.9]);
        let search = Search { criterion: Some(Criterion::Aicc), ..Search::new(SearchBy::Stepwise(Direction::Both), 6) };
        let response = || Response::new("y", &rows.y).select(Select::search(search)).forms([rsm_fit::spec::Form::Polynomial]);
        let free = Fit::new(&rows.x, response()).fit().unwrap();
        let found = Fit::new(&rows.x, response().noise(NoiseOrder::UpTo(2))).series(&rows.series).fit().unwrap();
        let found = figures(&found);
        plain += figures(&free).terms.len();
        whitened += found.terms.len();
        has_all += usize::from(found.terms.iter().any(|term| term.powers == [2]));
        assert!(found.selection.is_some() && found.noise.is_some());
        assert!(found.rows_used.terms.contains("AICc"), "{}", found.rows_used.terms);
    }
    println!("terms of least squares {plain}, of whitened rows {whitened}, square found {has_all} of 20");
    // Three terms are true: 60. AICc takes a needless term of 4 with a probability of about 15 %: 12 more, with a standard deviation of 3.
    assert!((60..=84).contains(&whitened), "{whitened}");
    assert!(plain > whitened + 10, "{plain} {whitened}");
    assert_eq!(has_all, 20);
}

#[test]
fn a_random_walk_is_told() {
    let mut random = Random::new(11);
    let mut level = 0.0;
    let x: Vec<f64> = (0..200).map(|row| f64::from(row % 10)).collect();
    let step = |x: &f64| {
        level += random.normal();
        2.0 * x + level
    };
    let y: Vec<f64> = x.iter().map(step).collect();
    let found = figures(&Fit::new(&x, Response::new("y", y).noise(NoiseOrder::Given(1))).order(1).fit().unwrap());
    assert!(found.warnings.iter().any(|warning| warning.kind == "near-random-walk"), "{:?}", found.noise);
}

#[test]
fn rows_without_noise_keep_their_coefficients() {
    let x: Vec<f64> = (0..30).map(f64::from).collect();
    let y: Vec<f64> = x.iter().map(|x| 1.0 + 2.0 * x).collect();
    let found =
        figures(&Fit::new(&x, Response::new("y", y).noise(NoiseOrder::UpTo(2)).coding(Coding::None)).order(1).fit().unwrap());
    assert_eq!(found.noise.unwrap().order, 0);
    near(found.terms.iter().map(|term| term.coefficient), &[1.0, 2.0], 1e-14);
}

/// statsmodels, if Python has it: GLSAR with the same phi drops the first rows, so `GLS` with the same covariance is the reference.
#[test]
fn another_package_has_the_same_figures() {
    let rows = rows(12, 1, 80, &[0.7, 0.1]);
    let found = figures(&fitted(&rows, NoiseOrder::Given(2)));
    let noise = found.noise.unwrap();
    let list = |values: &[f64]| format!("[{}]", values.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(","));
    let script = format!(
        "import sys\ntry:\n    import numpy as np\nexcept ImportError:\n    sys.exit(77)\n\
         x, y, phi = (np.array(v) for v in ({}, {}, {}))\n\
         n, p = len(x), len(phi)\n\
         psi = np.zeros(2000)\npsi[0] = 1\n\
         for k in range(1, 2000):\n    psi[k] = sum(phi[j] * psi[k - 1 - j] for j in range(min(k, p)))\n\
         g = np.array([psi[k:] @ psi[:2000 - k] for k in range(n)])\n\
         V = g[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))]\n\
         X = np.column_stack([np.ones(n), x, x * x])\n\
         try:\n    import statsmodels.api as sm\n    r = sm.GLS(y, X, sigma=V).fit()\n    b, e, who = r.params, r.bse, 'statsmodels'\n\
         except ImportError:\n    L = np.linalg.cholesky(V)\n    A, c = np.linalg.solve(L, X), np.linalg.solve(L, y)\n\
         \x20   b = np.linalg.lstsq(A, c, rcond=None)[0]\n    r = c - A @ b\n\
         \x20   e, who = np.sqrt(r @ r / (n - 3) * np.diag(np.linalg.inv(A.T @ A))), 'numpy'\n\
         print(who, *map(repr, map(float, [*b, *e])))\n",
        list(&rows.x),
        list(&rows.y),
        list(&noise.coefficients)
    );
    let output = std::process::Command::new("python3").args(["-c", &script]).output();
    let output = match output {
        Ok(output) if output.status.success() => output,
        Ok(output) if output.status.code() != Some(77) => panic!("{}", String::from_utf8_lossy(&output.stderr)),
        _ => {
            eprintln!("SKIPPED: python3 with numpy is not installed, so no other package was compared");
            return;
        }
    };
    let said = String::from_utf8(output.stdout).unwrap();
    println!("{said}");
    let numbers: Vec<f64> = said.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect();
    // Roundings of f64 times the condition of the covariance.
    near(found.terms.iter().map(|term| term.coefficient), &numbers[..3], 1e-9);
    near(found.terms.iter().map(|term| term.standard_error.unwrap()), &numbers[3..], 1e-9);
}
