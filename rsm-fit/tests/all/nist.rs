//! NIST's linear least-squares sets, with raw columns as published, compared with certified results.
//!
//! Digits of agreement are -log10 of the relative error with respect to the certified 15-digit decimal, at most 15; for a certified zero, -log10 of
//! the value. The lower limits are just below the accuracy that remains in the exact answer after the decimals are read into f64 (coefficients, from
//! the data's README: Norris 14.1, Pontius 13.5, NoInt1 14.7, Filip 14.0, Longley 14.6, Wampler2 13.2, others exact): no solver can be more accurate.

use rsm_fit::statistics::ResponseStatistics;
use serde_json::Value;

use crate::data::fitted_in;
use crate::folders::nist;

/// Coefficients, standard errors, residual standard deviation, R^2.
pub const FLOORS: &[(&str, [f64; 4])] = &[
    ("Norris", [14.0, 13.9, 14.0, 14.9]),
    ("Pontius", [13.5, 13.7, 13.7, 14.9]),
    ("NoInt1", [14.7, 14.9, 14.9, 14.9]),
    ("NoInt2", [14.9, 14.9, 14.9, 14.9]),
    ("Filip", [14.0, 14.8, 14.7, 14.9]),
    ("Longley", [14.6, 14.8, 14.9, 14.9]),
    ("Wampler1", [15.0, 15.0, 15.0, 15.0]),
    ("Wampler2", [13.1, 14.9, 14.9, 14.9]),
    // The certified decimals of these errors are themselves rounded in the 15th digit.
    ("Wampler3", [14.9, 14.4, 14.8, 14.9]),
    ("Wampler4", [14.9, 14.4, 14.8, 14.9]),
    ("Wampler5", [14.9, 14.4, 14.8, 14.9]),
];

fn digits(found: f64, certified: &str) -> f64 {
    let certified: f64 = certified.trim().parse().unwrap();
    let error = (found - certified).abs();
    let relative = if certified == 0.0 { error } else { error / certified.abs() };
    if relative == 0.0 { 15.0 } else { (-relative.log10()).min(15.0) }
}

/// The specification of a set: raw columns, given terms.
pub fn text_of(set: &str, certified: &Value) -> String {
    let inputs: Vec<&str> = certified["columns"].as_array().unwrap()[1..].iter().map(|name| name.as_str().unwrap()).collect();
    let width = inputs.len();
    let unit = |k: usize| -> Vec<u32> { (0..width).map(|j| u32::from(j == k)).collect() };
    let mut terms: Vec<Vec<u32>> = match certified["kind"].as_str().unwrap() {
        "polynomial" => (1..=certified["degree"].as_u64().unwrap() as u32).map(|power| vec![power]).collect(),
        _ => (0..width).map(unit).collect(),
    };
    if certified["intercept"].as_bool().unwrap() {
        terms.insert(0, vec![0; width]);
    }
    let tables: String = inputs.iter().map(|name| format!("[inputs.{name}]\nunit = \"1\"\n")).collect();
    format!(
        "format = 1\nmodel = \"nist\"\ndata = [\"{set}.csv\"]\n{tables}[responses.y]\nunit = \"1\"\ninputs = {inputs:?}\n\
         coding = \"none\"\nselect = {{ method = \"fixed\" }}\nterms = {terms:?}\n"
    )
}

/// The digits of the worst coefficient, of the worst standard error, of the residual standard deviation and of R^2.
pub fn agreement_of(statistics: &ResponseStatistics, certified: &Value) -> [f64; 4] {
    let worst = |found: Vec<f64>, key: &str| {
        let certified = certified[key].as_array().unwrap();
        assert_eq!(found.len(), certified.len());
        let pairs = found.iter().zip(certified);
        pairs.map(|(found, text)| digits(*found, text.as_str().unwrap())).fold(15.0, f64::min)
    };
    [
        worst(statistics.terms.iter().map(|term| term.coefficient).collect(), "coefficients"),
        worst(statistics.terms.iter().map(|term| term.standard_error.unwrap()).collect(), "standard_errors"),
        digits(statistics.residual_sd.unwrap(), certified["residual_sd"].as_str().unwrap()),
        digits(statistics.r2.unwrap(), certified["r_squared"].as_str().unwrap()),
    ]
}

#[test]
fn all_eleven_sets_keep_the_digits_that_the_data_hold() {
    let folder = nist();
    let certified: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("certified.json")).unwrap()).unwrap();
    println!("{:10} {:>12} {:>12} {:>12} {:>12}", "set", "coefficient", "error", "residual", "R^2");
    let mut failures = Vec::new();
    for (set, floor) in FLOORS {
        let outcome = fitted_in(&text_of(set, &certified[*set]), &folder);
        let statistics = outcome.responses[0].statistics.as_ref();
        let statistics = statistics.unwrap_or_else(|| panic!("{set}: {}", outcome.responses[0].verdict));
        let found = agreement_of(statistics, &certified[*set]);
        let [b, se, sd, r2] = found;
        println!("{set:10} {b:12.2} {se:12.2} {sd:12.2} {r2:12.2}");
        for (found, floor) in found.iter().zip(floor) {
            if found < floor {
                failures.push(format!("{set}: {found:.2} digits, expected {floor}"));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
