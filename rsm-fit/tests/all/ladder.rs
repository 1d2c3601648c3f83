//! The ladder of figure 1 on data with a known truth.

use rsm_core::model::{Input, Outside, Surface};
use rsm_fit::dd::Dd;
use rsm_fit::design::{self, Design, Physical};
use rsm_fit::fit::{ChosenBy, Outcome, Verdict};
use rsm_fit::ladder::{Judge, Ladder};
use rsm_fit::qr::Compressed;

use crate::data::{Files, fitted};

/// A grid of x in 0..10 and z in -3..3 with y = f(coded x, coded z), and a shifted grid for validation.
fn grids(f: impl Fn(f64, f64) -> f64) -> Files {
    let files = Files::default();
    let grid = |shift: f64, steps: u32| {
        let mut text = "x[A],z[V],y[N*m]\n".to_string();
        for i in 0..=steps {
            for j in 0..=steps {
                let [x1, x2] = [i, j].map(|k| (f64::from(k) * 2.0 / f64::from(steps) - 1.0) * shift);
                // Natural values whose coding in f64 is as exact as decimals permit.
                text += &format!("{},{},{:e}\n", 5.0 + 5.0 * x1, 3.0 * x2, f(x1, x2));
            }
        }
        text
    };
    files.file("fit.csv", &grid(1.0, 6)).file("unseen.csv", &grid(0.9, 5));
    files
}

fn ladder(files: &Files, rest: &str, validate: bool) -> Outcome {
    let validate = if validate { "validate = [\"unseen.csv\"]\n" } else { "" };
    let text = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"fit.csv\"]\n{validate}[inputs.x]\nunit = \"A\"\n[inputs.z]\nunit = \"V\"\n\
         [responses.y]\nunit = \"N*m\"\ninputs = [\"x\", \"z\"]\n{rest}\n"
    );
    fitted(&text, files)
}

fn powers(outcome: &Outcome) -> Vec<Vec<u32>> {
    outcome.model.surfaces[0].terms.iter().map(|term| term.powers.clone()).collect()
}

#[test]
fn it_finds_the_terms_that_are_there_and_no_other() {
    // Six terms of order up to 4. The first-order term of z is not one of them.
    let truth = |x: f64, z: f64| 2.0 + 3.0 * x - 1.5 * x * z + 0.75 * z * z + 0.5 * x * x * z - 0.25 * x * x * z * z;
    let files = grids(truth);
    let outcome = ladder(&files, "select = { method = \"ladder\", max_order = 5, confidence = 99.9999999 }", true);
    assert!(outcome.reached(), "{}", outcome.responses[0].verdict);
    assert_eq!(powers(&outcome), [[0, 0], [1, 0], [1, 1], [0, 2], [2, 1], [2, 2]]);
    for (term, expected) in outcome.model.surfaces[0].terms.iter().zip([2.0, 3.0, -1.5, 0.75, 0.5, -0.25]) {
        // The natural values of the grid are decimals rounded to f64: a few times 2^-53 each.
        assert!((term.coefficient - expected).abs() < 1e-14, "{term:?}");
    }
}

#[test]
fn it_stops_at_the_fewest_regressors_that_reach_the_confidence() {
    let truth = |x: f64, z: f64| 10.0 + 3.0 * x + 0.4 * z * z + 0.001 * x * z;
    let files = grids(truth);
    let of = |confidence: f64| {
        ladder(&files, &format!("select = {{ method = \"ladder\", max_order = 4, confidence = {confidence} }}"), true)
    };
    // C is computed about zero (15), and a constant alone has 90 % of it and more. So the ladder continues until C about the mean also reaches the
    // goal: x leaves the variance of 0.4 z^2, a 200th of that of 3 x.
    assert_eq!(powers(&of(90.0)), [[0, 0], [1, 0]]);
    assert_eq!(powers(&of(99.0)), [[0, 0], [1, 0]]);
    assert_eq!(powers(&of(99.9)), [[0, 0], [1, 0], [0, 2]]);
    assert_eq!(powers(&of(99.9999)), [[0, 0], [1, 0], [0, 2]]);
}

#[test]
fn what_cannot_be_reached_is_said_with_the_best_that_was_found() {
    let files = grids(|x: f64, z: f64| (9.0 * x).sin() * (7.0 * z).cos());
    let outcome = ladder(&files, "select = { method = \"ladder\", max_order = 3, confidence = 99.0 }", true);
    assert!(!outcome.reached());
    let Verdict::NotReached { best, wanted } = outcome.responses[0].verdict else { panic!("{}", outcome.responses[0].verdict) };
    assert!(best < wanted && wanted == 99.0);
    assert_eq!(outcome.model.surfaces.len(), 1, "the best model found is still there to look at");
    assert_eq!(outcome.responses[0].chosen_by, ChosenBy::Validation);
}

#[test]
fn without_validation_data_fitted_rows_are_left_out_in_turn_and_it_says_so() {
    let files = grids(|x: f64, z: f64| 1.0 + x + z);
    let outcome = ladder(&files, "select = { method = \"ladder\", max_order = 3, confidence = 99.0 }", false);
    assert_eq!(outcome.responses[0].chosen_by, ChosenBy::LeftOut { parts: 10 });
    let evidence = &outcome.model.surfaces[0].evidence;
    let judged = &evidence.iter().find(|(name, _)| name == "terms_chosen_on").unwrap().1;
    assert_eq!(*judged, rsm_core::model::Evidence::Text("fitted rows left out in turn, which chose the terms".into()));
}

#[test]
fn a_hinge_is_found_where_the_response_has_a_kink() {
    let files = grids(|x: f64, z: f64| 1.0 + 0.5 * z + 2.0 * (x - 0.5).max(0.0));
    let rest = "knots = [{ input = \"x\", at = 7.5 }]\nselect = { method = \"ladder\", max_order = 2, confidence = 99.99999 }";
    let outcome = ladder(&files, rest, true);
    assert!(outcome.reached(), "{}", outcome.responses[0].verdict);
    assert_eq!(powers(&outcome), [[0, 0, 0], [0, 1, 0], [0, 0, 1]]);
}

#[test]
fn rows_beyond_the_range_are_fitted_as_measured_and_counted() {
    let files = Files::default();
    let rows: String = (-3i32..=3).map(|k| format!("{k},{}\n", 1 + 2 * k * k)).collect();
    files.file("fit.csv", &format!("x[A],y[V]\n{rows}")).file("unseen.csv", "x[A],y[V]\n9,9\n");
    let text = "format = 1\nmodel = \"m\"\ndata = [\"fit.csv\"]\nvalidate = [\"unseen.csv\"]\n[inputs.x]\nrange = [-2.0, 2.0]\n\
                [responses.y]\ninputs = [\"x\"]\nselect = { method = \"fixed\", order = 2 }\n";
    let outcome = fitted(text, &files);
    let coefficients: Vec<f64> = outcome.model.surfaces[0].terms.iter().map(|term| term.coefficient).collect();
    // y = 1 + 2 xi^2 = 1 + 8 x^2 with x = xi/2, although the points at -3 and 3 are outside the range.
    assert_eq!(coefficients, [1.0, 0.0, 8.0]);
    assert_eq!(outcome.responses[0].rows_outside, 2);
    // The evaluator clamps the input 9 to 2, where the surface is 9.
    assert_eq!(outcome.responses[0].statistics.as_ref().unwrap().validation.as_ref().unwrap().max_abs_error, 0.0);
}

#[test]
fn columns_that_make_each_other_up_are_named_and_give_no_surface() {
    let files = Files::default();
    // z is 3 x + 1 in every row.
    let rows: String = (0..8).map(|k| format!("{k},{},{}\n", 3 * k + 1, k * k)).collect();
    files.file("fit.csv", &format!("x[A],z[V],y[N*m]\n{rows}"));
    for select in ["method = \"ladder\", max_order = 3, confidence = 99.0", "method = \"fixed\", order = 1"] {
        let outcome = ladder(&files, &format!("select = {{ {select} }}"), false);
        let Verdict::IllConditioned { condition, columns } = &outcome.responses[0].verdict else {
            panic!("{}", outcome.responses[0].verdict)
        };
        assert!(*condition > 1e13, "{condition}");
        // In coded variables they are the same column.
        assert_eq!(columns, &["x", "z"]);
        assert!(!outcome.reached() && outcome.model.surfaces.is_empty());
        assert!(serde_json::to_value(outcome.report()).unwrap()["responses"]["y"].is_null());
    }
}

#[test]
fn replicates_of_the_unseen_data_weigh_by_their_number() {
    let files = Files::default();
    let rows: String = (-4i32..=4).map(|k| format!("{k},{}\n", 40 + k)).collect();
    let unseen = "0,40\n".repeat(9) + "4,44\n";
    files.file("fit.csv", &format!("x[A],y[V]\n{rows}")).file("unseen.csv", &format!("x[A],y[V]\n{unseen}"));
    let of = |select: &str| {
        let text = format!(
            "format = 1\nmodel = \"m\"\ndata = [\"fit.csv\"]\nvalidate = [\"unseen.csv\"]\n[inputs.x]\n[responses.y]\n\
             inputs = [\"x\"]\n{select}\n"
        );
        fitted(&text, &files)
    };
    // Only the constant 40: SS_lof = 9 0^2 + 1 4^2 = 16, SS_y = 9 40^2 + 44^2 = 16336, C = 99.90206. Without the n_i it would be 99.548.
    let outcome = of("select = { method = \"fixed\" }\nterms = [[0]]");
    let confidence = outcome.responses[0].statistics.as_ref().unwrap().validation.as_ref().unwrap().confidence_c.unwrap();
    assert!((confidence - (100.0 - 1600.0 / 16336.0)).abs() < 1e-12, "{confidence}");
    assert_eq!(powers(&of("select = { method = \"ladder\", max_order = 2, confidence = 99.91 }")), [[0], [1]]);
}

#[test]
fn one_term_takes_the_place_of_two() {
    // For 10 + 4 x^2 z^2, the second rung reaches 99.7 with x^2 and z^2; x^2 z^2 alone, two rungs above, is better than both. This uses the criterion
    // of C about zero alone, as a correction of a plant does.
    let surface = Surface { inputs: vec!["x".into(), "z".into()], ..Surface::default() };
    let input = |name: &str| Input { name: name.into(), unit: "1".into(), range: [-1.0, 1.0], outside: Outside::Clamp };
    let of = |max_order: u32| {
        let terms = design::terms_up_to(&surface, max_order);
        let design = Design::new(&surface, &[input("x"), input("z")], terms.clone());
        let grid = |shift: f64, steps: u32| {
            let mut rows = Compressed::new(terms.len() + 1);
            for k in 0..(steps + 1).pow(2) {
                let at = |k: u32| shift * (2.0 * f64::from(k) / f64::from(steps) - 1.0);
                let (x, z) = (at(k / (steps + 1)), at(k % (steps + 1)));
                let y = 10.0 + 4.0 * x * x * z * z;
                rows.push(design.row(&[Physical(x), Physical(z)]).into_iter().chain([Dd::from(y)]));
            }
            rows.finish()
        };
        let (fit, judge) = (grid(1.0, 6), Judge::new(grid(0.9, 5)));
        let climb = Ladder::new(&fit, &judge, &terms, max_order, 99.7).climb(&mut |_, _, _| {}).unwrap();
        climb.chosen.iter().map(|k| terms[*k].clone()).collect::<Vec<_>>()
    };
    assert_eq!(of(3), [[0, 0], [2, 0], [0, 2]]);
    assert_eq!(of(4), [[0, 0], [2, 2]]);
}

#[test]
fn validation_sees_the_saturation_of_the_written_model() {
    let files = Files::default();
    files.file("fit.csv", "x[A],y[V]\n-1,-1\n0,0\n1,1\n").file("unseen.csv", "x[A],y[V]\n-1,0\n0.5,0.5\n1,0.75\n");
    let text = "format = 1\nmodel = \"m\"\ndata = [\"fit.csv\"]\nvalidate = [\"unseen.csv\"]\n[inputs.x]\n[responses.y]\n\
                inputs = [\"x\"]\noutput_range = [0.0, 0.75]\nselect = { method = \"fixed\", order = 1 }\n";
    let outcome = fitted(text, &files);
    let statistics = outcome.responses[0].statistics.as_ref().unwrap();
    assert_eq!(statistics.validation.as_ref().unwrap().max_abs_error, 0.0);
    assert_eq!(outcome.model.surfaces[0].output_range, Some([0.0, 0.75]));
}

#[test]
fn the_judging_rows_do_not_pick_the_terms() {
    // Validated only on the upper quarter of the range, no single term added to 1, x, x^2 raises C, although the truth has all terms up to x^5.
    let truth = |x: f64| 10.0 - 5.0 * x - 5.0 * x * x - x.powi(3) - 3.0 * x.powi(4) + 2.0 * x.powi(5);
    let grid = |from: f64, steps: u32| -> String {
        let x = |k: u32| from + (1.0 - from) * f64::from(k) / f64::from(steps);
        "x[A],y[V]\n".to_string() + &(0..=steps).map(|k| format!("{},{}\n", x(k), truth(x(k)))).collect::<String>()
    };
    let files = Files::default();
    files.file("fit.csv", &grid(-1.0, 12)).file("unseen.csv", &grid(0.5, 8));
    let text = "format = 1\nmodel = \"m\"\ndata = [\"fit.csv\"]\nvalidate = [\"unseen.csv\"]\n[inputs.x]\n[responses.y]\n\
                inputs = [\"x\"]\nselect = { method = \"ladder\", max_order = 5, confidence = 99.99 }\n";
    let outcome = fitted(text, &files);
    assert!(outcome.reached(), "{}", outcome.responses[0].verdict);
}
