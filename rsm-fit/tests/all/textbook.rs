//! Textbook cases of response-surface methodology, compared with the results of another package.
//!
//! Tolerance: 1e-10 of the value. Both sides have about 13 digits (the data's README: cross-checks agree to 6e-13), and probabilities lose a few.

use std::path::Path;

use serde_json::Value;

use crate::data::{Files, fitted};
use crate::folders::shared;

struct Case {
    name: &'static str,
    /// The fitted rows of the file, counted from the header.
    rows: std::ops::Range<usize>,
    file: &'static str,
    inputs: &'static [(&'static str, [f64; 2])],
    response: &'static str,
    /// Our powers with the other package's name of the term.
    terms: &'static [(&'static [u32], &'static str)],
}

const CASES: [Case; 2] = [
    Case {
        name: "codata_SO",
        rows: 0..18,
        file: "codata.csv",
        inputs: &[("x1", [-1.0, 1.0]), ("x2", [-1.0, 1.0])],
        response: "y",
        terms: &[
            (&[0, 0], "(Intercept)"),
            (&[1, 0], "x1"),
            (&[0, 1], "x2"),
            (&[1, 1], "x1:x2"),
            (&[2, 0], "x1^2"),
            (&[0, 2], "x2^2"),
        ],
    },
    // That package codes x1 = (Time - 85)/5, x2 = (Temp - 175)/5: the ranges below.
    Case {
        name: "chemreact1_FO",
        rows: 0..7,
        file: "chemreact.csv",
        inputs: &[("Time", [80.0, 90.0]), ("Temp", [170.0, 180.0])],
        response: "Yield",
        terms: &[(&[0, 0], "(Intercept)"), (&[1, 0], "x1"), (&[0, 1], "x2")],
    },
];

fn close(what: &str, found: Option<f64>, expected: &Value) {
    let expected = expected.as_f64().unwrap_or_else(|| panic!("{what}: nothing to compare with: {expected}"));
    let found = found.unwrap_or_else(|| panic!("{what}: none, expected {expected}"));
    assert!((found - expected).abs() <= 1e-10 * expected.abs(), "{what}: found {found}, expected {expected}");
}

fn compare(case: &Case, folder: &Path, expected: &Value) {
    let files = Files::default();
    let text = std::fs::read_to_string(folder.join(case.file)).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let rows: Vec<&str> = lines.skip(case.rows.start).take(case.rows.len()).collect();
    files.file("data.csv", &format!("{header}\n{}\n", rows.join("\n")));
    let tables: String = case
        .inputs
        .iter()
        .map(|(name, range)| format!("[inputs.{name}]\nunit = \"1\"\nrange = {range:?}\noutside = \"extrapolate\"\n"))
        .collect();
    let names: Vec<&str> = case.inputs.iter().map(|(name, _)| *name).collect();
    let terms: Vec<&[u32]> = case.terms.iter().map(|(powers, _)| *powers).collect();
    let specification = format!(
        "format = 1\nmodel = \"textbook\"\ndata = [\"data.csv\"]\n{tables}[responses.{}]\nunit = \"1\"\ninputs = {names:?}\n\
         select = {{ method = \"fixed\" }}\nterms = {terms:?}\n",
        case.response
    );
    let outcome = fitted(&specification, &files);
    let found = outcome.responses[0].statistics.as_ref().unwrap();
    for (term, (_, name)) in found.terms.iter().zip(case.terms) {
        close(name, Some(term.coefficient), &expected["coef"][*name]);
        close(name, term.standard_error, &expected["se"][*name]);
        close(name, term.t, &expected["t"][*name]);
        close(name, term.p, &expected["p"][*name]);
    }
    close("R^2", found.r2, &expected["r2"]);
    close("adjusted R^2", found.r2_adjusted, &expected["adj_r2"]);
    close("sigma", found.residual_sd, &expected["sigma"]);
    close("PRESS", found.press, &expected["press"]);
    let lack = found.lack_of_fit.as_ref().expect("replicates exist");
    let theirs = &expected["anova"]["Lack of fit"];
    close("lack of fit F", lack.f, &theirs["f"]);
    close("lack of fit p", lack.p, &theirs["p"]);
    assert_eq!(lack.df[0] as f64, theirs["df"].as_f64().unwrap());
    assert_eq!(lack.df[1] as f64, expected["anova"]["Pure error"]["df"].as_f64().unwrap());
    match &found.canonical {
        None => assert!(expected["eigenvalues"].is_null(), "no canonical analysis"),
        Some(canonical) => {
            for (k, eigenvalue) in canonical.eigenvalues.iter().enumerate() {
                close("eigenvalue", Some(*eigenvalue), &expected["eigenvalues"][k]);
            }
            for (name, value) in &canonical.stationary_point.0 {
                close(name, Some(*value), &expected["xs"][name]);
            }
        }
    }
}

#[test]
fn second_order_and_first_order_with_replicates_agree() {
    let Some(folder) = shared("r-rsm") else { return };
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    for case in &CASES {
        println!("{}", case.name);
        compare(case, &folder, &expected["r_full_precision"][case.name]);
    }
}

#[test]
fn the_report_has_the_keys_of_the_contract_in_their_order() {
    let files = Files::default();
    files.file("d.csv", "x[A],z[V],y[1]\n0,0,1\n1,0,2\n2,0,5\n0,1,3\n1,1,2\n2,1,4\n0,2,2\n1,2,1\n2,2,0\n1,1,2.5\n");
    let text = "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\nvalidate = [\"d.csv\"]\n[inputs.x]\n[inputs.z]\n[responses.y]\n\
                inputs = [\"x\", \"z\"]\nselect = { method = \"fixed\", order = 2 }\n";
    let outcome = fitted(text, &files);
    let json = serde_json::to_value(outcome.report()).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    let response = &json["responses"]["y"];
    assert_eq!(keys(&json), ["model", "responses"]);
    let expected = [
        "terms",
        "rows",
        "residual_sd",
        "r2",
        "r2_adjusted",
        "r2_predicted",
        "press",
        "confidence_c",
        "lack_of_fit",
        "validation",
        "canonical",
        "test",
        "cross_validation",
        "rows_used",
        "warnings",
        "analysis",
    ];
    assert_eq!(keys(response), expected);
    assert_eq!(keys(&response["terms"][0]), ["powers", "coefficient", "standard_error", "t", "p"]);
    assert_eq!(keys(&response["lack_of_fit"]), ["f", "p", "df"]);
    assert_eq!(keys(&response["validation"]), ["rows", "mean_abs_error", "max_abs_error", "rmse", "confidence_c"]);
    assert_eq!(keys(&response["canonical"]), ["stationary_point", "eigenvalues", "kind"]);
    assert_eq!(keys(&response["canonical"]["stationary_point"]), ["x", "z"]);
    assert!(["maximum", "minimum", "saddle"].contains(&response["canonical"]["kind"].as_str().unwrap()));
}

#[test]
fn figures_that_do_not_exist_are_null() {
    let files = Files::default();
    // Two points and a line: no degrees of freedom remain. The leverage is 1 everywhere, so PRESS does not exist.
    files.file("d.csv", "x[A],y[1]\n0,1\n1,2\n");
    let text = "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n[inputs.x]\n[responses.y]\ninputs = [\"x\"]\n\
                select = { method = \"fixed\", order = 1 }\n";
    let outcome = fitted(text, &files);
    let json = serde_json::to_value(outcome.report()).unwrap();
    let response = &json["responses"]["y"];
    for key in ["residual_sd", "r2_adjusted", "r2_predicted", "press", "lack_of_fit", "validation", "canonical"] {
        assert!(response[key].is_null(), "{key}: {}", response[key]);
    }
    assert_eq!(response["r2"], 1.0);
    for key in ["standard_error", "t", "p"] {
        assert!(response["terms"][0][key].is_null());
    }
}
