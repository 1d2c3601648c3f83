//! Compares the reported error with the true error, for random surfaces from a seed. The truth is known, and is evaluated at new points.
//!
//! Surfaces, noise and the true error are computed in `truth.rs`. Tests about files and warnings write files; the others fit in memory.

use rsm_fit::fit::{Outcome, Verdict};
use rsm_fit::random::Random;
use rsm_fit::statistics::ResponseStatistics;
use rsm_fit::{Fit, Select};

use crate::data::{Files, fitted};
use crate::truth::Truth;

/// A specification of y on x0, x1, ... in [-1, 1].
fn text(inputs: usize, top: &str, select: &str) -> String {
    let sections: String = (0..inputs).map(|k| format!("[inputs.x{k}]\nrange = [-1.0, 1.0]\n")).collect();
    let names: Vec<String> = (0..inputs).map(|k| format!("\"x{k}\"")).collect();
    format!(
        "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n{top}\n{sections}[responses.y]\ninputs = [{}]\n{select}\n",
        names.join(", ")
    )
}

fn ladder(order: u32, confidence: f64) -> String {
    format!("select = {{ method = \"ladder\", max_order = {order}, confidence = {confidence} }}")
}

fn statistics(outcome: &Outcome) -> &ResponseStatistics {
    outcome.responses[0].statistics.as_ref().unwrap_or_else(|| panic!("{}", outcome.responses[0].verdict))
}

fn kinds(outcome: &Outcome) -> Vec<&'static str> {
    statistics(outcome).warnings.iter().map(|warning| warning.kind).collect()
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The rows that a fit keeps for validation.
type Aside = fn(Fit) -> Fit;

/// (reported error / true error, error on the rows for the choice / true error) of random surfaces.
fn told_over_true(
    seeds: std::ops::Range<u64>,
    aside: Aside,
    mut draw: impl FnMut(&mut Random) -> (usize, usize, u32, f64),
) -> Vec<(f64, Option<f64>)> {
    let of_one = |seed: u64| {
        let mut random = Random::new(seed);
        let (inputs, rows, order, noise) = draw(&mut random);
        let truth = Truth::random(inputs, order, noise, &mut random);
        let fit = truth.fit(truth.rows(rows, &mut random));
        let outcome = aside(fit).select(Select::ladder(order, 99.99)).fit().unwrap();
        let found = statistics(&outcome);
        let told = found.test.as_ref().map(|test| test.rmse).or(found.cross_validation.as_ref().map(|cross| cross.errors.rmse));
        // With 2000 rows the true error is known to 1/sqrt(4000) = 1.6 %.
        let truth = truth.error_of(&outcome, 2000, &mut random);
        (told.unwrap() / truth, found.validation.as_ref().map(|validation| validation.rmse / truth))
    };
    seeds.map(of_one).collect()
}

/// 1 to 6 inputs, 30 to 500 rows, noise of 0.1 to 3 times the signal, each uniform in its logarithm.
fn anything(most_rows: f64) -> impl FnMut(&mut Random) -> (usize, usize, u32, f64) {
    move |random| {
        let inputs = 1 + random.below(6) as usize;
        let rows = 30.0 * (most_rows / 30.0).powf(random.share());
        let order = 2 + random.below(if inputs > 4 { 2 } else { 3 }) as u32;
        (inputs, rows as usize, order, 0.1 * 30f64.powf(random.share()))
    }
}

/// The median of |reported error / true error - 1|.
fn off(pairs: &[(f64, Option<f64>)]) -> f64 {
    median(&mut pairs.iter().map(|(told, _)| (told - 1.0).abs()).collect::<Vec<f64>>())
}

/// The median of reported error / true error: 1 if the reported error is unbiased.
fn ratio(pairs: &[(f64, Option<f64>)]) -> f64 {
    median(&mut pairs.iter().map(|(told, _)| *told).collect::<Vec<f64>>())
}

#[test]
fn the_error_that_is_told_is_the_true_one() {
    // A hundred surfaces and every kind of split are in the ignored test below.
    let pairs = told_over_true(0..24, |fit| fit, anything(500.0));
    assert!((ratio(&pairs) - 1.0).abs() < 0.1, "{} {pairs:?}", ratio(&pairs));
    // For a single surface the requirement must be weaker: the r.m.s. of n errors has a relative standard deviation of 1/sqrt(2 n), 13 % for 30 rows
    // and 3 % for 500. The medians over a hundred surfaces in the test below are 0.05 to 0.08. Here, half of the 24 surfaces must be within a tenth.
    let near = pairs.iter().filter(|(told, _)| (told - 1.0).abs() < 0.1).count();
    assert!(2 * near >= pairs.len(), "{near} {pairs:?}");
}

#[test]
fn the_rows_that_chose_flatter_and_the_others_do_not() {
    // A ladder that chose terms with the validation rows reported a third of the true error here. The error on 60 rows is itself known only to 9 %
    // (one over the root of twice 60). So the median of reported / true must be near 1, not the median of each distance.
    let pairs = told_over_true(0..15, |fit| fit.validate_share(0.3, 7), |_| (5, 60, 4, 1.0));
    let chose = median(&mut pairs.iter().map(|(_, validation)| validation.unwrap()).collect::<Vec<f64>>());
    let told = median(&mut pairs.iter().map(|(told, _)| *told).collect::<Vec<f64>>());
    assert!((told - 1.0).abs() < 0.1, "{told} {pairs:?}");
    assert!(chose < told, "{chose} {told}");
}

#[test]
#[ignore = "minutes: 1 to 6 inputs, 30 to 500 rows, with and without validation and test rows; cargo test -p rsm-fit --release --test all -- --ignored told"]
fn the_error_that_is_told_is_the_true_one_whatever_the_rows() {
    let ways: [(&str, Aside); 4] = [
        ("all rows fitted", |fit| fit),
        ("validate", |fit| fit.validate_share(0.3, 7)),
        ("test", |fit| fit.test_share(0.3, 3)),
        ("validate and test", |fit| fit.validate_share(0.3, 7).test_share(0.3, 3)),
    ];
    for (name, aside) in ways {
        let pairs = told_over_true(100..200, aside, anything(500.0));
        println!("{name}: median of told / true {:.3}, of its distance from 1 {:.3}", ratio(&pairs), off(&pairs));
        assert!((ratio(&pairs) - 1.0).abs() < 0.1 && off(&pairs) < 0.1, "{name}");
    }
}

#[test]
fn few_rows_are_told_an_error_of_their_surface_or_none() {
    // A line with noise of a hundredth of its slope. Without one row of four, and without another for the choice, two rows remained, and a ladder may
    // fit a constant to them. The error of that constant, a hundred times that of the line, was reported as the error of the line.
    let (mut told, mut none) = (0, 0);
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let truth = Truth { inputs: 1, terms: vec![(vec![1], 1.0)], offset: 0.0, noise: 0.01 };
        let rows = 3 + (seed % 6) as usize;
        let outcome = truth.fit(truth.rows(rows, &mut random)).select(Select::ladder(2, 99.0)).fit().unwrap();
        match &statistics(&outcome).cross_validation {
            Some(cross) => {
                told += 1;
                // Far from the rows of a fit, an error of ten times the noise is possible; the error of a constant is fifty times the noise and more.
                assert!(cross.errors.rmse < 0.3, "seed {seed}, {rows} rows: {}", cross.errors.rmse);
            }
            None => {
                none += 1;
                let words = outcome.responses[0].verdict.to_string();
                let is_honest = match rows {
                    // Two rows are fitted and one is used for validation: only a constant can be chosen, and the report says that it is not
                    // sufficient.
                    3 => words.starts_with("confidence 99 % not reached, best"),
                    4 | 5 => words.contains("no rows are left that were not used to choose the model"),
                    _ => false,
                };
                assert!(is_honest, "seed {seed}, {rows} rows: {words}");
                assert_eq!(
                    statistics(&outcome).rows_used.error,
                    "none: the only error is that on the rows that chose the terms"
                );
            }
        }
    }
    assert!(told > 10 && none > 10, "{told} {none}");
}

#[test]
fn noise_is_never_reached_at_any_offset() {
    let (mut alarms, mut tried) = (0, 0);
    for seed in 0..90 {
        let mut random = Random::new(seed);
        let offset = [0.0, 350.0, -1e4][(seed % 3) as usize];
        let inputs = 1 + random.below(3) as usize;
        let rows = 8 + random.below(50) as usize;
        let truth = Truth { inputs, terms: Vec::new(), offset, noise: 8.0 };
        let fit = truth.fit(truth.rows(rows, &mut random)).select(Select::ladder(3, 99.9));
        let fit = match seed / 3 % 3 {
            0 => fit,
            _ if rows < 20 => continue,
            1 => fit.validate_share(0.3, 1),
            _ => fit.test_share(0.3, 1),
        };
        let outcome = fit.fit().unwrap();
        tried += 1;
        alarms += usize::from(outcome.reached());
        if !outcome.reached() {
            let warned = kinds(&outcome);
            assert!(warned.contains(&"explains-little") || warned.contains(&"judged-by-choosers"), "seed {seed}: {warned:?}");
        }
        if offset == 350.0 && !outcome.reached() {
            // About zero, all of the response is explained: (8/350)^2 is 0.05 %.
            let verdict = &outcome.responses[0].verdict;
            let is_about_zero = matches!(verdict, Verdict::ReachedAboutZero { .. } | Verdict::NotReached { .. });
            assert!(is_about_zero, "seed {seed}: {verdict}");
        }
    }
    // The stated rate is 1 % of fits of pure noise with 8 rows and more. Of 80 fits, three alarms would have a probability of 1 in 20.
    assert!(tried > 60 && alarms <= 2, "{alarms} of {tried}");
}

#[test]
fn a_plane_does_not_reach_clean_quadratic_data_at_any_offset() {
    for seed in 0..12 {
        let mut random = Random::new(seed);
        let offset = [0.0, 350.0, -1e4][(seed % 3) as usize];
        let curved = [0.2, 1.0, 5.0][(seed / 3 % 3) as usize];
        let truth = Truth { inputs: 2, terms: vec![(vec![1, 0], 1.0), (vec![0, 2], curved)], offset, noise: 0.0 };
        let fit = truth.fit(truth.rows(25, &mut random));
        let of = |order: u32| fit.clone().select(Select::ladder(order, 99.9)).fit().unwrap();
        let (plane, curved) = (of(1), of(2));
        assert!(!plane.reached(), "seed {seed}: {}", plane.responses[0].verdict);
        assert!(kinds(&plane).contains(&"lack-of-fit"), "seed {seed}: {:?}", kinds(&plane));
        assert!(
            curved.reached() && kinds(&curved).is_empty(),
            "seed {seed}: {} {:?}",
            curved.responses[0].verdict,
            kinds(&curved)
        );
        let powers: Vec<_> = curved.model.surfaces[0].terms.iter().map(|term| term.powers.clone()).collect();
        assert_eq!(powers, [vec![0, 0], vec![1, 0], vec![0, 2]], "seed {seed}");
    }
}

#[test]
fn a_good_surface_through_noisy_data_is_reached() {
    // A fifth of the spread is noise: no surface explains 99.9 % about the mean, and the true terms explain the rest.
    let mut reached = 0;
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let truth = Truth { inputs: 2, terms: vec![(vec![1, 0], 20.0), (vec![0, 2], 30.0)], offset: 350.0, noise: 6.0 };
        let fit = truth.fit(truth.rows(60, &mut random)).select(Select::ladder(3, 99.9));
        reached += usize::from(fit.fit().unwrap().reached());
    }
    assert!(reached >= 19, "{reached} of 20");
}

/// A correct model with normal noise, replicates and a run order. `spoil` may change the response of a row, depending on its number in the run order.
fn clean(seed: u64, spoil: impl Fn(usize, f64) -> f64) -> String {
    let mut random = Random::new(seed);
    let mut runs: Vec<usize> = (0..40).collect();
    random.shuffle(&mut runs);
    let mut rows = "x0[1],x1[1],run,y[K]\n".to_string();
    for (place, run) in runs.iter().enumerate() {
        // 32 points of a grid, 8 of them twice.
        let point = place % 32;
        let [x, z] = [point % 8, point / 8].map(|k| k as f64);
        let (x, z) = (x / 3.5 - 1.0, z / 1.5 - 1.0);
        let y = spoil(*run, 300.0 + 3.0 * x - 2.0 * z + x * z + 0.5 * random.normal());
        rows += &format!("{x:e},{z:e},{},{y:e}\n", run + 1);
    }
    rows
}

const RIGHT: &str = "select = { method = \"fixed\" }\nterms = [[0, 0], [1, 0], [0, 1], [1, 1]]";

#[test]
fn warnings_on_clean_data_are_as_rare_as_stated() {
    let files = Files::default();
    let mut count = std::collections::BTreeMap::new();
    let fits = 300;
    for seed in 0..fits {
        files.file("data.csv", &clean(seed, |_, y| y));
        for kind in kinds(&fitted(&text(2, "", RIGHT), &files)) {
            *count.entry(kind).or_insert(0) += 1;
        }
    }
    // The rate is 1 % each, and 2 % for lack of fit, which has two tests: 3 and 6 of 300, with standard deviations 1.7 and 2.4. The limit is four
    // standard deviations above.
    let most = |kind: &str| if kind == "lack-of-fit" { 15 } else { 9 };
    assert!(count.iter().all(|(kind, n)| *n <= most(kind)), "{count:?}");
    assert!(count.keys().all(|kind| ["lack-of-fit", "outliers", "correlated-residuals"].contains(kind)), "{count:?}");
}

#[test]
fn each_thing_wrong_is_warned_of_by_its_name() {
    let files = Files::default();
    let of = |name: &str, data: &str, top: &str, rest: &str| {
        files.file("data.csv", data);
        let found = fitted(&text(2, top, rest), &files);
        let warnings = &statistics(&found).warnings;
        assert!(warnings.iter().any(|warning| warning.kind == name), "{name}: {warnings:?}");
        warnings.iter().find(|warning| warning.kind == name).unwrap().what.clone()
    };
    for seed in 0..5 {
        let data = clean(seed, |_, y| y);
        // The product is missing in the model: replicates have a standard deviation of 0.5, the product is 1.
        let words = of("lack-of-fit", &data, "", "select = { method = \"fixed\", order = 1 }");
        assert!(words.contains("repeated points") || words.contains("x0*x1"), "{words}");
        let words = of("outliers", &clean(seed, |run, y| if run == 17 { y + 5.0 } else { y }), "", RIGHT);
        assert!(words.starts_with("1 row has an error") && words.contains("x0 = "), "{words}");
        of("correlated-residuals", &clean(seed, |run, y| y + 0.06 * run as f64), "", RIGHT);
        let words = of("output-bound", &data, "", &format!("output_range = [296.0, 302.0]\n{RIGHT}"));
        assert!(words.contains("of 40 fitted rows"), "{words}");
        let bounds = format!("{RIGHT}\nconstraints = [{{ kind = \"bounds\", min = 100.0, max = 101.0 }}]");
        let words = of("bounds-off-data", &data, "", &bounds);
        assert!(words.starts_with("40 of 40 responses lie far beyond the bounds [100, 101]"), "{words}");
        of("explains-little", &data, "", &bounds);
        files.file("again.csv", &data);
        let words = of("rows-seen", &data, "test = [\"again.csv\"]", RIGHT);
        assert!(words.contains("40 rows of `test`"), "{words}");
    }
}

#[test]
fn test_rows_choose_nothing_and_judge() {
    let files = Files::default();
    let mut random = Random::new(5);
    let truth = Truth::random(2, 2, 0.3, &mut random);
    files.file("data.csv", &truth.csv(40, &mut random)).file("test.csv", &truth.csv(20, &mut random));
    let one = fitted(&text(2, "test = [\"test.csv\"]", &ladder(3, 90.0)), &files);
    files.file("test.csv", &Truth { offset: 5.0, ..Truth::random(2, 2, 0.3, &mut random) }.csv(20, &mut random));
    let other = fitted(&text(2, "test = [\"test.csv\"]", &ladder(3, 90.0)), &files);
    assert_eq!(one.model.surfaces[0].terms, other.model.surfaces[0].terms);
    let errors = [&one, &other].map(|outcome| statistics(outcome).test.as_ref().unwrap().rmse);
    assert!(errors[0] < 0.5 && errors[1] > 2.0, "{errors:?}");
    assert!(statistics(&one).cross_validation.is_none() && statistics(&one).validation.is_none());
    assert!(
        statistics(&one).rows_used.error.starts_with("20 test rows, not used for anything else"),
        "{:?}",
        statistics(&one).rows_used
    );
    assert!(one.reached() && !other.reached(), "a surface that fails the test rows is not reached");
    let written = rsm_core::model_file::write(&one.model);
    assert!(written.contains("test = { data = [{ file = \"test.csv\""), "{written}");
}

#[test]
fn the_words_say_who_chose() {
    let files = Files::default();
    let mut random = Random::new(6);
    let truth = Truth::random(2, 2, 0.3, &mut random);
    files.file("data.csv", &truth.csv(40, &mut random)).file("more.csv", &truth.csv(20, &mut random));
    let used = |top: &str, rest: &str| {
        let outcome = fitted(&text(2, top, rest), &files);
        let evidence = rsm_core::model_file::write(&outcome.model);
        (statistics(&outcome).rows_used.clone(), evidence)
    };
    let files = "validate = [\"more.csv\"]";
    let (rows, evidence) = used(files, &ladder(3, 90.0));
    assert_eq!(rows.validation, "20 rows, which also chose the terms");
    assert!(rows.error.contains("20 rows left out in 10 parts in turn, fit and choice of terms repeated"), "{rows:?}");
    assert!(
        evidence.contains("errors = \"on the rows that chose it\"") && evidence.contains("cross_validation = {"),
        "{evidence}"
    );
    let given = "select = { method = \"fixed\", order = 2 }";
    let (rows, evidence) = used(files, given);
    assert_eq!(
        (rows.validation.as_str(), rows.terms.as_str()),
        ("20 holdout rows, not used for any choice", "none: the terms were given")
    );
    assert!(!evidence.contains("on the rows that chose it") && !evidence.contains("cross_validation"), "{evidence}");
    let (rows, _) = used("", given);
    assert_eq!(rows.error, "40 rows left out in 10 parts in turn, the fit repeated without them");
}

#[test]
fn repetitions_of_a_point_are_never_on_two_sides() {
    let mut random = Random::new(3);
    for _ in 0..50 {
        let groups: Vec<usize> = (0..40).map(|_| random.below(25) as usize).collect();
        let parts = rsm_fit::split::parts(&groups, 10, random.below(1000));
        for (a, part) in groups.iter().zip(&parts) {
            assert!(groups.iter().zip(&parts).all(|(b, other)| a != b || part == other));
        }
        let sizes: Vec<usize> = (0..10).map(|part| parts.iter().filter(|other| **other == part).count()).collect();
        assert!(sizes.iter().all(|size| (1..=9).contains(size)), "{sizes:?}");
    }
    // With every point twice, and the second reading a copy, leaving out single rows would predict each row from its copy.
    let truth = Truth { inputs: 1, terms: Vec::new(), offset: 0.0, noise: 1.0 };
    let (points, response) = truth.rows(12, &mut random);
    let twice = ([&points[..], &points].concat(), [&response[..], &response].concat());
    let found = truth.fit(twice).select(Select::order(8)).fit().unwrap();
    // Order 8 through 12 points of noise explains these points, but no row that was left out.
    assert!(statistics(&found).r2.unwrap() > 0.5);
    assert!(statistics(&found).cross_validation.as_ref().unwrap().r2.unwrap() < 0.0);
}
