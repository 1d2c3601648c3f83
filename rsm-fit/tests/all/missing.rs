//! Missing cells: what is refused, what is left out, and that nothing else changes.

use std::path::Path;

use rsm_fit::fit::{Outcome, fit_sources};
use rsm_fit::random::Random;
use rsm_fit::statistics::ResponseStatistics;
use rsm_fit::{Fit, Input, Missing, Response};

use crate::data::{Files, fitted, specification};

const LINE: &str = "select = { method = \"fixed\", order = 1 }";

fn text(head: &str, rest: &str) -> String {
    format!("format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n{head}\n[inputs.x]\n{rest}\n")
}

fn refused(text: &str, files: &[(&str, &str)]) -> String {
    let all = Files::default();
    for (name, text) in files {
        all.file(name, text);
    }
    let sources: Vec<_> = files.iter().map(|(name, _)| all.get(name)).collect();
    fit_sources(&specification(text, Path::new("")), &sources, &mut |_| {}).unwrap_err().to_string()
}

/// Figures without those of neighbouring rows, and without the warnings.
fn without_neighbours(outcome: &Outcome) -> ResponseStatistics {
    let mut statistics = outcome.responses[0].statistics.clone().unwrap();
    statistics.serial = None;
    statistics.warnings.clear();
    if let Some(analysis) = &mut statistics.analysis {
        analysis.durbin_watson = None;
    }
    statistics
}

fn kinds(outcome: &Outcome) -> Vec<&str> {
    outcome.responses[0].statistics.iter().flat_map(|statistics| &statistics.warnings).map(|warning| warning.kind).collect()
}

/// 120 rows of y = 2 + x - x^2 with noise, weights and groups of three; in each of the columns some cells are empty or marked.
fn rows() -> (String, String) {
    let mut random = Random::new(11);
    let (mut marked, mut without) = ("x[1],y[V],w,day,note\n".to_string(), "x[1],y[V],w,day,note\n".to_string());
    let marks = ["", "NaN", "NA", "#N/A", "null", " n/a "];
    for row in 0..120 {
        let x = 4.0 * random.share() - 2.0;
        let y = 2.0 + x - x * x + 0.1 * random.normal();
        let mut cells =
            [format!("{x}"), format!("{y}"), format!("{}", 1.0 + random.share()), format!("d{}", row / 3), String::new()];
        if row % 17 == 5 {
            cells[(row / 17) % 4] = marks[row % marks.len()].to_string();
        } else {
            without += &format!("{}\n", cells.join(","));
        }
        marked += &format!("{}\n", cells.join(","));
    }
    (marked, without)
}

#[test]
fn a_fit_has_the_bits_of_the_files_without_these_rows() {
    let (marked, without) = rows();
    let keys = "unit = \"1\"\n[responses.y]\nunit = \"V\"\ninputs = [\"x\"]\nweights = \"w\"";
    let split = "validate = { share = 0.3, seed = 4, keep_together = [\"day\"] }\ntest = { share = 0.1, seed = 5 }";
    for (apart, select) in [
        (split, "select = { method = \"ladder\", max_order = 4, confidence = 95.0 }"),
        ("validate = { share = 0.2, seed = 9, keep_together = [\"day\"] }", "select = { method = \"fixed\", order = 2 }"),
        ("test = { share = 0.2, seed = 9, keep_together = [\"day\"] }", "select = { method = \"stepwise\", max_order = 4 }"),
    ] {
        let rest = format!("{keys}\n{select}");
        let dropped = fitted(&text(&format!("missing = \"drop-row\"\n{apart}"), &rest), &Files::of("data.csv", &marked));
        let deleted = fitted(&text(apart, &rest), &Files::of("data.csv", &without));
        assert_eq!(without_neighbours(&dropped), without_neighbours(&deleted), "{select}");
        let plain = |outcome: &Outcome| {
            let mut model = outcome.model.clone();
            model.surfaces[0].evidence.clear();
            model
        };
        assert_eq!(plain(&dropped), plain(&deleted));
        // Rows 5, 22, 39, ... 107: seven, in turn in x, y, w and day.
        let left_out = &dropped.left_out[0][0];
        let cells: Vec<(&str, usize)> = left_out.cells.iter().map(|it| (it.column.as_str(), it.cells)).collect();
        assert_eq!((left_out.key, left_out.rows, left_out.of), ("data", 7, 120));
        assert_eq!(cells, [("x", 2), ("y", 2), ("w", 2), ("day", 1)]);
        assert!(deleted.left_out[0].is_empty());
    }
}

#[test]
fn each_response_leaves_out_its_own_rows() {
    let data =
        "x[1],z[1],a[V],b[V],note\n0,0,1,1,NaN\n1,,3,2,\n2,3,,3,NA\n3,2,7,,ok\nNaN,1,9,5,\n4,5,9,8,\n7,,NA,9,\n6,3,13,10,\n";
    let rest = format!("[inputs.z]\n[responses.a]\ninputs = [\"x\"]\n{LINE}\n[responses.b]\ninputs = [\"z\"]\n{LINE}\n");
    let outcome = fitted(&text("missing = \"drop-row\"", &rest), &Files::of("data.csv", data));
    let words: Vec<String> = outcome.left_out.iter().flatten().map(|one| one.words()).collect();
    assert_eq!(
        words,
        [
            "3 of 8 rows of `data` are left out because cells are missing: 1 in `x` of data.csv, 2 in `a` of data.csv",
            "3 of 8 rows of `data` are left out because cells are missing: 2 in `z` of data.csv, 1 in `b` of data.csv"
        ]
    );
    // a = 1 + 2 x in its rows, whatever stands in z and b; x = 7 belongs to no row of a, and z = 2 to none of b.
    let a = &outcome.responses[0].statistics.as_ref().unwrap();
    assert_eq!((a.rows, a.terms[0].coefficient, a.terms[1].coefficient), (5, 7.0, 6.0));
    assert_eq!(outcome.model.inputs[0].range, [0.0, 6.0]);
    assert_eq!(outcome.responses[1].statistics.as_ref().unwrap().rows, 5);
    let json = serde_json::to_value(outcome.report()).unwrap();
    assert_eq!(
        json["missing"]["b"],
        serde_json::json!([{ "key": "data", "rows": 3, "of": 8, "cells": [
            { "file": "data.csv", "column": "z", "cells": 2 }, { "file": "data.csv", "column": "b", "cells": 1 }] }])
    );
    assert_eq!(kinds(&outcome).iter().filter(|kind| **kind == "missing-rows").count(), 1, "{:?}", kinds(&outcome));
}

#[test]
fn marks_in_other_columns_change_nothing() {
    let data = |note: &str| format!("x[1],y[V],note\n0,1,{note}\n1,3,\n2,5,{note}\n3,8,NaN\n");
    let rest = format!("[responses.y]\ninputs = [\"x\"]\n{LINE}");
    let with = fitted(&text("missing = \"drop-row\"", &rest), &Files::of("data.csv", &data("NA")));
    let plain = fitted(&text("", &rest), &Files::of("data.csv", &data("good")));
    assert_eq!(with.responses, plain.responses);
    assert!(with.left_out[0].is_empty());
    assert!(serde_json::to_value(with.report()).unwrap().get("missing").is_none());
}

#[test]
fn more_than_a_tenth_warns() {
    let rest = format!("[responses.y]\ninputs = [\"x\"]\n{LINE}");
    for (marked, warns) in [(2, false), (3, true)] {
        let line = |row: usize| if row < marked { format!("{row},\n") } else { format!("{row},{}\n", row * row) };
        let data = format!("x[1],y[V]\n{}", (0..20).map(line).collect::<String>());
        let outcome = fitted(&text("missing = \"drop-row\"", &rest), &Files::of("data.csv", &data));
        // 2 of 20 are exactly a tenth, 3 are more.
        assert_eq!(kinds(&outcome).contains(&"missing-rows"), warns, "{marked}");
    }
}

#[test]
fn without_the_key_missing_cells_are_counted() {
    let rest = format!("[responses.y]\ninputs = [\"x\"]\n{LINE}");
    let data = "x[1],y[V],note\n0,1,\n1,,\n2,NaN,\n3,4,\nNA,5,\n6,inf,\n";
    let help = "help: fill the cells, or leave such rows out with `missing = \"drop-row\"` in the specification";
    let expected = format!(
        "data.csv:3: column 2 `y`: found an empty cell, expected a number; 2 cells of this column are missing\n  {help}\n\
         data.csv:6: column 1 `x`: found `NA`, expected a number; no other cell of this column is missing\n  {help}\n\
         data.csv:7: column 2 `y`: found `inf`, expected a finite number"
    );
    for head in ["", "missing = \"error\""] {
        assert_eq!(refused(&text(head, &rest), &[("data.csv", data)]), expected);
    }
    // An infinity is no missing cell.
    let said = refused(&text("missing = \"drop-row\"", &rest), &[("data.csv", data)]);
    assert_eq!(said, "data.csv:7: column 2 `y`: found `inf`, expected a finite number");
}

#[test]
fn no_row_left_is_said() {
    let rest = format!("[responses.y]\ninputs = [\"x\"]\n{LINE}");
    let said = refused(&text("missing = \"drop-row\"", &rest), &[("data.csv", "x[1],y[V]\n0,\n,1\n")]);
    assert!(said.contains("`data`: every row misses a number in a column that each response uses"), "{said}");
    // One of two responses has no row: its input has no range, but the rows are the fault.
    let other = format!("[inputs.u]\n{rest}\n[responses.z]\ninputs = [\"u\"]\n{LINE}");
    let said =
        refused(&text("missing = \"drop-row\"", &other), &[("data.csv", "x[1],u[1],y[V],z[V]\n0,,1,2\n1,1,3,\n2,,5,1\n")]);
    assert!(said.contains("response `z`: every row of `data` misses a number"), "{said}");
    let two = format!("{rest}\n[responses.z]\ninputs = [\"x\"]\n{LINE}");
    let files = [("data.csv", "x[1],y[V],z[V]\n0,1,2\n1,2,3\n2,4,5\n"), ("more.csv", "x[1],y[V],z[V]\n0,1,\n1,2,NaN\n")];
    let said = refused(&text("missing = \"drop-row\"\nvalidate = [\"more.csv\"]", &two), &files);
    assert!(said.contains("response `z`: every row of `validate` misses a number in a column that it uses"), "{said}");
    assert!(said.contains("2 of 2 rows of `validate` are left out"), "{said}");
    let square = rest.replace("order = 1", "order = 2");
    let said = refused(&text("missing = \"drop-row\"", &square), &[("data.csv", "x[1],y[V]\n0,1\n1,2\n2,\n")]);
    assert!(said.contains("found 2 rows to fit") && said.contains("1 of 3 rows of `data` is left out"), "{said}");
}

#[test]
fn a_run_number_may_be_missing_where_its_row_is() {
    let line =
        |k: usize| if k == 7 { ",,\n".to_string() } else { format!("{},{},{}\n", 30 - k, k % 5, (k / 5 % 2 * 2) as f64 - 1.0) };
    let data = |line: &dyn Fn(usize) -> String| format!("run[1],x[1],y[V]\n{}", (0..30).map(line).collect::<String>());
    let rest = format!("[responses.y]\ninputs = [\"x\"]\n{LINE}");
    let order = |data: &str| {
        let outcome = fitted(&text("missing = \"drop-row\"", &rest), &Files::of("data.csv", data));
        outcome.responses[0].statistics.as_ref().unwrap().serial.as_ref().map(|serial| serial.order)
    };
    assert_eq!(order(&data(&line)), Some("run-order"));
    // A kept row without its number: the run order is not known.
    let lacking = |k: usize| if k == 8 { format!(",{},1\n", k % 5) } else { line(k) };
    assert_eq!(order(&data(&lacking)), Some("rows"));
}

/// The errors of a slow wave correlate. Every second row is left out, so that no two rows are neighbours, and nothing is said of neighbours.
#[test]
fn rows_beside_a_gap_are_no_neighbours() {
    let x: Vec<f64> = (0..200).map(|row| f64::from(row % 7)).collect();
    let y: Vec<f64> = (0..200).map(|row| (0.02 * f64::from(row)).sin()).collect();
    let gaps: Vec<f64> = y.iter().enumerate().map(|(row, y)| if row % 2 == 0 { *y } else { f64::NAN }).collect();
    let correlated = |y: &[f64]| {
        let outcome = Fit::new(&x, &y.to_vec()).order(1).missing(Missing::DropRow).fit().unwrap();
        let statistics = outcome.responses[0].statistics.clone().unwrap();
        (statistics.serial.is_some(), statistics.analysis.and_then(|analysis| analysis.durbin_watson).is_some())
    };
    assert_eq!(correlated(&y), (true, true));
    assert_eq!(correlated(&gaps), (false, false));
}

#[test]
fn rows_in_memory_are_left_out_alike() {
    let (nan, x) = (f64::NAN, [0.0, 1.0, 2.0, f64::NAN, 4.0, 5.0, 6.0]);
    let y = [1.0, 2.5, nan, 4.0, 4.5, 7.0, 6.5];
    let weights = [1.0, nan, 1.0, 1.0, 2.0, 1.0, 1.0];
    let fit = |missing| {
        let response = Response::new("y", y).unit("V").weights(weights);
        Fit::new(Input::new("x", x), response).order(1).missing(missing).fit()
    };
    let outcome = fit(Missing::DropRow).unwrap();
    let data = "x[1],y[V],w\n0,1,1\n1,2.5,NaN\n2,NaN,1\nNaN,4,1\n4,4.5,2\n5,7,1\n6,6.5,1\n";
    let rest = format!("[responses.y]\ninputs = [\"x\"]\nweights = \"w\"\n{LINE}");
    let from_file = fitted(&text("missing = \"drop-row\"", &rest), &Files::of("data.csv", data));
    assert_eq!(outcome.responses, from_file.responses);
    assert_eq!(outcome.responses[0].statistics.as_ref().unwrap().rows, 4);
    let said = fit(Missing::Error).unwrap_err().to_string();
    let help = "help: `Fit::missing(Missing::DropRow)` leaves such rows out";
    assert!(
        said.contains(&format!("input `x`: row 4: found NaN, expected a finite number; no other value is NaN\n  {help}")),
        "{said}"
    );
    assert!(said.contains("the weight of row 2: found NaN"), "{said}");
    // An infinity is refused in any case.
    let said = Fit::new(&[0.0, f64::INFINITY, 2.0], &[1.0, 2.0, 3.0]).order(1).missing(Missing::DropRow).fit().unwrap_err();
    assert!(said.to_string().contains("row 2: found inf"), "{said}");
}
