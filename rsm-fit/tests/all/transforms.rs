//! Transforms of a response: against a fit of the transformed column, against the interpreter, the choice of "box-cox" over families of responses
//! that are drawn from a seed, constraints, weights, parts, and what is refused.

use std::path::Path;

use rsm_core::lower;
use rsm_core::model::{Symmetry, Transform};
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_fit::fit::{Outcome, fit_sources};
use rsm_fit::partial::{merge, of_sources};
use rsm_fit::random::Random;
use rsm_fit::spec::{Constraint, Form, Loss, NoiseOrder};
use rsm_fit::statistics::{ResponseStatistics, TransformReport};
use rsm_fit::{Fit, Input, Response, Select};

use crate::data::specification;
use crate::forms::Draws;

fn figures(outcome: &Outcome) -> &ResponseStatistics {
    outcome.responses[0].statistics.as_ref().unwrap_or_else(|| panic!("{}", outcome.responses[0].verdict))
}

fn report(outcome: &Outcome) -> &TransformReport {
    figures(outcome).transform.as_ref().expect("there is a transform")
}

/// The value of the surface in f64.
fn value(outcome: &Outcome, at: &[f64]) -> f64 {
    let tape = lower::surface(&outcome.checked().unwrap(), 0, Precision::F64);
    Interpreter::<f64>::new(&tape).eval(at)
}

/// The response of a transform, by the standard library: nothing is shared with the project's own formulas.
fn response(transform: Option<Transform>, p: f64) -> f64 {
    match transform {
        None => p,
        Some(Transform::SquareRoot) => p * p,
        Some(Transform::CubeRoot) => p.powi(3),
        Some(Transform::FourthRoot) => p.powi(4),
        Some(Transform::Log) => p.exp(),
        Some(Transform::ReciprocalSquareRoot) => p.powi(-2),
        Some(Transform::Reciprocal) => 1.0 / p,
    }
}

/// Rows of two inputs in [-1, 1] whose terms are positive: 3 + a x + b z + c x z + noise.
struct Rows {
    x: Vec<f64>,
    z: Vec<f64>,
    /// The terms with noise.
    p: Vec<f64>,
}

impl Rows {
    fn drawn(seed: u64, count: usize, noise: f64) -> Rows {
        let mut draws = Draws(Random::new(seed));
        let [a, b, c] = [draws.between(0.5, 1.2), draws.between(-0.8, 0.8), draws.between(-0.4, 0.4)];
        let (mut x, mut z, mut p) = (vec![], vec![], vec![]);
        for _ in 0..count {
            let at = [draws.between(-1.0, 1.0), draws.between(-1.0, 1.0)];
            x.push(at[0]);
            z.push(at[1]);
            p.push(3.0 + a * at[0] + b * at[1] + c * at[0] * at[1] + draws.noise(noise));
        }
        Rows { x, z, p }
    }

    fn inputs(&self) -> [Input; 2] {
        [("x", &self.x), ("z", &self.z)].map(|(name, values)| Input::new(name, values).range([-1.0, 1.0]))
    }

    fn measured(&self, transform: Option<Transform>) -> Vec<f64> {
        self.p.iter().map(|p| response(transform, *p)).collect()
    }
}

#[test]
fn the_terms_are_those_of_the_transformed_column_and_the_surface_gives_the_response() {
    for (seed, transform) in Transform::ALL.into_iter().enumerate() {
        let rows = Rows::drawn(seed as u64, 60, 0.05);
        let apart = Rows::drawn(seed as u64, 90, 0.05);
        let measured = rows.measured(Some(transform));
        let of_apart = apart.measured(Some(transform));
        let fit = |response: Response, test: &[f64]| {
            Fit::new(rows.inputs(), response).order(2).test(apart.inputs(), Response::new("y", test)).fit().unwrap()
        };
        let found = fit(Response::new("y", &measured).transform(transform), &of_apart);
        let terms = fit(Response::new("y", &rows.p), &apart.p);
        // The column is rounded once: each of its numbers errs by a unit, and the logarithm of a number near 1 by more of its own.
        for (one, other) in figures(&found).terms.iter().zip(&figures(&terms).terms) {
            assert_eq!(one.powers, other.powers);
            assert!((one.coefficient - other.coefficient).abs() < 1e-13, "{transform:?}: {one:?} {other:?}");
        }
        assert_eq!(found.model.surfaces[0].transform, Some(transform));
        assert_eq!(report(&found).transform, transform.word());
        // Errors in the unit of the response, by the interpreter.
        let rmse = |x: &[f64], z: &[f64], y: &[f64]| {
            let square = (0..y.len()).map(|k| (value(&found, &[x[k], z[k]]) - y[k]).powi(2)).sum::<f64>();
            (square / y.len() as f64).sqrt()
        };
        let of_fit = report(&found).fitted.as_ref().unwrap().rmse;
        let of_test = figures(&found).test.as_ref().unwrap().rmse;
        // The formula of the exponential errs by up to 6e-11, the same in both.
        let near = |one: f64, other: f64| (one / other - 1.0).abs() < 1e-9;
        assert!(near(of_fit, rmse(&rows.x, &rows.z, &measured)), "{transform:?}");
        assert!(near(of_test, rmse(&apart.x, &apart.z, &of_apart)), "{transform:?}");
        let text = rsm_core::model_file::write(&found.model);
        assert!(text.contains(&format!("transform = \"{}\"", transform.word())) && text.contains("it was given"), "{text}");
    }
}

#[test]
fn box_cox_finds_the_transform_and_takes_none_where_none_belongs() {
    let (mut right, mut near, mut all) = (0, 0, 0);
    let (mut false_ones, mut nulls) = (0, 0);
    for seed in 0..8 {
        for truth in [None, Some(Transform::SquareRoot), Some(Transform::Log), Some(Transform::Reciprocal)] {
            let rows = Rows::drawn(100 + seed, 60, 0.15);
            let response = Response::new("y", rows.measured(truth)).box_cox();
            let found = Fit::new(rows.inputs(), response).order(2).fit().unwrap();
            let report = report(&found);
            assert_eq!(report.tried.len(), 7);
            let lambda = truth.map_or(1.0, Transform::lambda);
            all += 1;
            right += usize::from(report.lambda == lambda);
            near += usize::from((report.lambda - lambda).abs() <= 0.51);
            if truth.is_none() {
                nulls += 1;
                false_ones += usize::from(report.transform != "none");
            }
            // The likelihood is that of the definition, with errors of rows left out one at a time.
            let statistics = figures(&found);
            let own = report.tried.iter().find(|tried| tried.transform == report.transform).unwrap();
            let slopes: f64 = match found.model.surfaces[0].transform {
                None => 0.0,
                Some(transform) => rows.measured(truth).iter().map(|y| transform.slope(*y).ln()).sum(),
            };
            let expected = slopes - 30.0 * (statistics.press.unwrap() / 60.0).ln();
            assert!((own.log_likelihood.unwrap() - expected).abs() < 1e-9);
        }
    }
    println!("box-cox: {right} of {all} exact, {near} within a half; {false_ones} of {nulls} without a transform got one");
    assert!(near == all && 2 * right > all && false_ones <= 1, "{right} {near} of {all}, {false_ones} of {nulls}");
}

#[test]
fn without_noise_box_cox_takes_none_or_the_exact_transform() {
    let x: Vec<f64> = (0..24).map(|k| f64::from(k) / 8.0).collect();
    for truth in [None, Some(Transform::SquareRoot), Some(Transform::Log), Some(Transform::Reciprocal)] {
        // Whole multiples of 1/8: the line itself has no rounding error at all.
        let y: Vec<f64> = x.iter().map(|x| response(truth, 1.0 + 0.5 * x)).collect();
        let found = Fit::new([Input::new("x", &x)], Response::new("y", &y).box_cox()).order(1).fit().unwrap();
        assert_eq!(found.model.surfaces[0].transform, truth, "{}", report(&found).words());
        assert!(!report(&found).words().contains("inf"), "{}", report(&found).words());
    }
}

/// The viscosity of an oil by Vogel's equation, in mPa s, over 20 to 100 degrees Celsius and 0 to 2 kbar, with a relative error of 2 %.
fn viscosity([t, p]: [f64; 2]) -> f64 {
    0.05 * (1000.0 / (t + 90.0)).exp() * (1.2 * p).exp()
}

#[test]
fn over_decades_a_transform_leaves_less_relative_error_than_none() {
    let mut gains = vec![];
    for seed in 0..3 {
        let mut draws = Draws(Random::new(40 + seed));
        let points: Vec<[f64; 2]> = (0..120).map(|_| [draws.between(20.0, 100.0), draws.between(0.0, 2.0)]).collect();
        let measured: Vec<f64> = points.iter().map(|at| viscosity(*at) * (1.0 + draws.noise(0.02))).collect();
        let inputs = || {
            [("t", 0, [20.0, 100.0]), ("p", 1, [0.0, 2.0])]
                .map(|(name, k, range)| Input::new(name, points.iter().map(|at| at[k]).collect::<Vec<f64>>()).range(range))
        };
        let fit = |response: Response| Fit::new(inputs(), response).fit().unwrap();
        let (plain, chosen) = (fit(Response::new("eta", &measured)), fit(Response::new("eta", &measured).box_cox()));
        let error = |outcome: &Outcome| {
            let mut draws = Draws(Random::new(7));
            let square = (0..400).map(|_| {
                let at = [draws.between(20.0, 100.0), draws.between(0.0, 2.0)];
                (value(outcome, &at) / viscosity(at) - 1.0).powi(2)
            });
            (square.sum::<f64>() / 400.0).sqrt()
        };
        let (before, after) = (error(&plain), error(&chosen));
        println!(
            "viscosity, seed {seed}: {}, relative error {:.2} % in place of {:.2} %",
            report(&chosen).words(),
            100.0 * after,
            100.0 * before
        );
        assert!(report(&chosen).lambda <= 0.25, "{}", report(&chosen).words());
        gains.push(before / after);
    }
    assert!(gains.iter().all(|gain| *gain > 3.0), "{gains:?}");
}

#[test]
fn constraints_are_those_of_the_response() {
    let rows = Rows::drawn(5, 60, 0.3);
    for transform in [Transform::Log, Transform::SquareRoot, Transform::Reciprocal] {
        let measured = rows.measured(Some(transform));
        let mut sorted = measured.clone();
        sorted.sort_by(f64::total_cmp);
        // A tenth of the rows is beyond each bound.
        let (min, max) = (sorted[6], sorted[54]);
        let rises = transform != Transform::Reciprocal;
        let constraints = [
            Constraint::Bounds { min: Some(min), max: Some(max) },
            Constraint::Monotone { input: "x".into(), increasing: rises },
        ];
        let response =
            constraints.iter().fold(Response::new("y", &measured).transform(transform), |it, one| it.constraint(one.clone()));
        let found = Fit::new(rows.inputs(), response).order(2).fit().unwrap();
        let told = figures(&found).constraints.as_ref().unwrap();
        assert!(told.active);
        // In the words of the specification.
        let words: Vec<&String> = told.constraints.iter().map(|one| &one.constraint).collect();
        assert_eq!(words, constraints.iter().map(ToString::to_string).collect::<Vec<_>>().iter().collect::<Vec<_>>());
        let steps = || (0..=40).map(|k| f64::from(k) / 20.0 - 1.0);
        for z in steps() {
            let along: Vec<f64> = steps().map(|x| value(&found, &[x, z])).collect();
            // The rounding of coefficients and values.
            let slack = 1e-12 * max;
            assert!(along.iter().all(|y| min - slack <= *y && *y <= max + slack), "{transform:?} {along:?}");
            assert!(
                along.windows(2).all(|two| (two[1] >= two[0] - slack) == rises || two[0] == two[1]),
                "{transform:?} {along:?}"
            );
        }
    }
}

#[test]
fn an_output_range_is_that_of_the_response() {
    for transform in Transform::ALL {
        let rows = Rows::drawn(9, 60, 0.05);
        let measured = rows.measured(Some(transform));
        let mut sorted = measured.clone();
        sorted.sort_by(f64::total_cmp);
        let range = [sorted[20], sorted[40]];
        let response = Response::new("y", &measured).transform(transform).output_range(range);
        let found = Fit::new(rows.inputs(), response).order(2).fit().unwrap();
        assert_eq!(found.model.surfaces[0].output_range, Some(range));
        let square: f64 = (0..60).map(|k| (value(&found, &[rows.x[k], rows.z[k]]) - measured[k]).powi(2)).sum();
        let rmse = report(&found).fitted.as_ref().unwrap().rmse;
        assert!((rmse / (square / 60.0).sqrt() - 1.0).abs() < 1e-9, "{transform:?}");
        let warned =
            figures(&found).warnings.iter().find(|warning| warning.kind == "output-bound").expect("the range limits rows");
        let [low, high] = warned
            .what
            .split_once('[')
            .unwrap()
            .1
            .split_once(']')
            .unwrap()
            .0
            .split_once(", ")
            .map(|(low, high)| [low, high])
            .unwrap();
        let ends = [low, high].map(|end| end.parse::<f64>().unwrap());
        assert!((0..2).all(|k| (ends[k] / range[k] - 1.0).abs() < 1e-10), "{transform:?}: {}", warned.what);
    }
}

#[test]
fn weights_follow_the_slope() {
    for transform in Transform::ALL {
        let rows = Rows::drawn(11, 50, 0.1);
        let measured = rows.measured(Some(transform));
        let mut draws = Draws(Random::new(3));
        let sigma: Vec<f64> = measured.iter().map(|y| y.abs() * draws.between(0.01, 0.1)).collect();
        // The same error on the scale of the terms, by a difference quotient.
        let of_terms: Vec<f64> = measured
            .iter()
            .zip(&sigma)
            .map(|(y, sigma)| {
                let h = 1e-5 * y;
                let slope = (transform.transformed(y + h).unwrap() - transform.transformed(y - h).unwrap()).abs() / (2.0 * h);
                sigma * slope
            })
            .collect();
        let fit = |response: Response| Fit::new(rows.inputs(), response).order(2).fit().unwrap();
        let found = fit(Response::new("y", &measured).standard_errors(&sigma).transform(transform));
        let expected = fit(Response::new("y", &rows.p).standard_errors(&of_terms));
        for (one, other) in figures(&found).terms.iter().zip(&figures(&expected).terms) {
            // The difference quotient errs by h^2.
            assert!((one.coefficient - other.coefficient).abs() < 1e-8, "{transform:?}: {one:?} {other:?}");
            assert!((one.standard_error.unwrap() / other.standard_error.unwrap() - 1.0).abs() < 1e-7);
        }
    }
}

const TEXT: &str = "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n[inputs.x]\nunit = \"V\"\nrange = [0.0, 4.0]\n\
    [responses.y]\nunit = \"A\"\ninputs = [\"x\"]\nselect = { method = \"fixed\", order = 1 }\n";

fn csv(rows: &[(f64, f64)]) -> String {
    std::iter::once("x,y\n".to_string()).chain(rows.iter().map(|(x, y)| format!("{x},{y}\n"))).collect()
}

fn told(text: &str, csv: &str) -> String {
    let found = fit_sources(&specification(text, Path::new("")), &[Source::new("d.csv", csv)], &mut |_| {});
    found.map_or_else(|refused| refused.to_string(), |outcome| outcome.responses[0].verdict.to_string())
}

#[test]
fn parts_have_the_surface_of_one_fit() {
    for transform in ["log", "square-root", "reciprocal"] {
        let text = format!("{TEXT}transform = \"{transform}\"\nconstraints = [{{ kind = \"bounds\", max = 8.0 }}]\n");
        let rows: Vec<(f64, f64)> =
            (0..41).map(|k| (f64::from(k) / 10.0, 1.0 + f64::from(k * k % 17) / 10.0 + f64::from(k) / 8.0)).collect();
        let specification = specification(&text, Path::new(""));
        let whole = fit_sources(&specification, &[Source::new("d.csv", csv(&rows))], &mut |_| {}).unwrap();
        let parts = rows
            .chunks(15)
            .enumerate()
            .map(|(k, rows)| of_sources(&specification, &[Source::new(format!("d{k}.csv"), csv(rows))]).unwrap());
        let merged = merge(parts.collect()).unwrap().outcome;
        let (one, other) = (&whole.model.surfaces[0], &merged.model.surfaces[0]);
        assert_eq!((one.transform, one.output_range, &one.unit), (other.transform, other.output_range, &other.unit));
        for (one, other) in one.terms.iter().zip(&other.terms) {
            assert!((one.coefficient - other.coefficient).abs() < 1e-14, "{transform}");
        }
        assert_eq!(figures(&merged).constraints.as_ref().unwrap().constraints[0].constraint, "bounds max 8");
        assert_eq!(report(&merged).fitted, None);
    }
}

#[test]
fn responses_without_a_transform_are_named() {
    let rows = [(0.0, 1.0), (1.0, 2.0), (2.0, -0.5), (3.0, 0.0), (4.0, 5.0)];
    let with = |transform: &str| told(&format!("{TEXT}transform = \"{transform}\"\n"), &csv(&rows));
    let expected = "response `y`: `transform` \"log\": found -0.5 in the rows to fit, expected from e^-32 to e^32, 1.3e-14 to 7.9e13 (2 of 5 rows)";
    assert!(with("log").contains(expected), "{}", with("log"));
    assert!(with("square-root").contains("found -0.5 in the rows to fit, expected 0 or more (1 of 5 rows)"));
    assert!(with("box-cox").contains("`transform` \"box-cox\": found -0.5, expected more than 0 in every row to fit"));
    assert_eq!(with("cube-root"), "fitted");
    // The line through 1/y falls below 0 inside the range.
    let steep = [(0.0, 0.1), (1.0, 0.1), (2.0, 0.2), (3.0, 2.0), (4.0, 9.0)];
    let found = told(&format!("{TEXT}transform = \"reciprocal\"\n"), &csv(&steep));
    assert!(
        found.contains("`transform` \"reciprocal\": the value of the terms reaches -")
            && found.contains("expected more than 0 everywhere"),
        "{found}"
    );
    let held =
        told(&format!("{TEXT}transform = \"reciprocal\"\nconstraints = [{{ kind = \"bounds\", max = 20.0 }}]\n"), &csv(&steep));
    assert_eq!(held, "fitted");
    // A part finds the same.
    let specification = specification(&format!("{TEXT}transform = \"log\"\n"), Path::new(""));
    let refused = of_sources(&specification, &[Source::new("d.csv", csv(&rows))]).unwrap_err().to_string();
    assert!(refused.contains(expected), "{refused}");
}

#[test]
fn blocks_shift_the_terms() {
    let mut draws = Draws(Random::new(2));
    let (mut x, mut y, mut day) = (vec![], vec![], vec![]);
    for k in 0..60 {
        let (at, of_day) = (draws.between(0.0, 4.0), k % 2);
        x.push(at);
        // A factor of 1.5 from the first day to the second.
        y.push((0.5 * at + [0.0, 1.5f64.ln()][of_day] + draws.noise(0.01)).exp());
        day.push(["mon", "tue"][of_day]);
    }
    let text = format!("{TEXT}transform = \"log\"\n").replace("[inputs.x]", "blocks = [\"day\"]\n[inputs.x]");
    let data: String =
        std::iter::once("x,y,day\n".to_string()).chain((0..60).map(|k| format!("{},{},{}\n", x[k], y[k], day[k]))).collect();
    let found = fit_sources(&specification(&text, Path::new("")), &[Source::new("d.csv", data)], &mut |_| {}).unwrap();
    let effects = &figures(&found).blocks.as_ref().unwrap().effects;
    assert!((effects[1].effect - effects[0].effect - 1.5f64.ln()).abs() < 0.01);
    // Without the blocks the rows are as near to the surface as the noise.
    let without = found.without_blocks();
    let far = (0..60).map(|k| (without.fitted.responses[0][k] / value(&found, &[x[k]]) - 1.0).abs()).fold(0.0, f64::max);
    let before = (0..60).map(|k| (y[k] / value(&found, &[x[k]]) - 1.0).abs()).fold(0.0, f64::max);
    assert!(far < 0.04 && before > 0.15, "{far} {before}");
}

#[test]
fn methods_and_losses_work_on_the_terms() {
    let rows = Rows::drawn(21, 80, 0.1);
    let measured = rows.measured(Some(Transform::Log));
    let [plain, of_terms] = [Response::new("y", &measured).transform(Transform::Log), Response::new("y", &rows.p)];
    let fits = |change: &dyn Fn(Response) -> Response, select: Select| {
        [&plain, &of_terms]
            .map(|response| Fit::new(rows.inputs(), change(response.clone())).select(select.clone()).fit().unwrap())
    };
    let all: [(&dyn Fn(Response) -> Response, Select); 5] = [
        (&|it| it, Select::stepwise(2)),
        (&|it| it, Select::ladder(3, 99.0)),
        (&|it: Response| it.loss(Loss::Huber), Select::order(2)),
        (&|it: Response| it.noise(NoiseOrder::Given(1)), Select::order(2)),
        (&|it: Response| it.spline(rsm_fit::spec::SplineSpec::default()), Select::order(2)),
    ];
    for (place, (change, select)) in all.into_iter().enumerate() {
        let select = if place == 4 { None } else { Some(select) };
        let [found, expected] = match select {
            Some(select) => fits(change, select),
            None => [&plain, &of_terms].map(|response| Fit::new(rows.inputs(), change(response.clone())).fit().unwrap()),
        };
        let point = [0.3, -0.4];
        let (one, other) = (value(&found, &point), value(&expected, &point).exp());
        // Iterations end within their own tolerances.
        assert!((one / other - 1.0).abs() < 1e-7, "{place}: {one} {other}");
        assert_eq!(figures(&found).terms.len(), figures(&expected).terms.len());
    }
    // The errors that choices of a form compare are those of the terms.
    let bent: Vec<f64> = rows.p.iter().zip(&rows.x).map(|(p, x)| p + (6.0 * x).tanh()).collect();
    let measured: Vec<f64> = bent.iter().map(|p| response(Some(Transform::Log), *p)).collect();
    let tried = [Response::new("y", &measured).transform(Transform::Log), Response::new("y", &bent)].map(|response| {
        let response = response.forms([Form::Polynomial, Form::Sigmoid]);
        let outcome = Fit::new(rows.inputs(), response).select(Select::stepwise(3)).fit().unwrap();
        figures(&outcome).forms.as_ref().unwrap().tried.clone()
    });
    assert_eq!(tried[0].len(), 2);
    for (one, other) in tried[0].iter().zip(&tried[1]) {
        assert!((one.rmse.unwrap() / other.rmse.unwrap() - 1.0).abs() < 1e-6, "{one:?} {other:?}");
    }
    // A stationary point of the terms is one of the response, but a minimum of 1/y is a maximum of y.
    for transform in Transform::ALL {
        let response = Response::new("y", rows.measured(Some(transform))).transform(transform);
        let found = Fit::new(rows.inputs(), response).order(2).fit().unwrap();
        assert_eq!(figures(&found).canonical.is_some(), !transform.is_falling(), "{transform:?}");
    }
}

#[test]
fn what_does_not_fit_a_transform_is_refused() {
    let rows = Rows::drawn(1, 40, 0.1);
    let measured = rows.measured(Some(Transform::Log));
    let refused = |response: Response| Fit::new(rows.inputs(), response).order(2).fit().unwrap_err().to_string();
    let log = || Response::new("y", &measured).transform(Transform::Log);
    for (response, words) in [
        (log().constraint(Constraint::Convex), "`transform` cannot be combined with a convex or concave response"),
        (log().symmetry("x", Symmetry::Odd), "`transform` cannot be combined with the odd input `x`"),
        (
            log().constraint(Constraint::Bounds { min: Some(0.0), max: None }),
            "constraint 1: found 0, and `transform` \"log\" needs from e^-32 to e^32",
        ),
        (Response::new("y", &measured).box_cox().loss(Loss::Huber), "\"box-cox\" compares squared errors of independent rows"),
        (
            Response::new("y", &measured).box_cox().noise(NoiseOrder::Given(1)),
            "\"box-cox\" compares squared errors of independent rows",
        ),
    ] {
        let found = refused(response);
        assert!(found.contains(words), "{found}");
    }
}
