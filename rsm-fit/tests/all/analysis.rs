//! The analysis of linear models with blocks, compared with the results of R and its package rsm, for textbook cases of response surfaces.
//!
//! Tolerance: 1e-10 of the value, or of the largest value of a list if values are near 0. The results of R have about 13 digits (the data's README:
//! cross-checks agree to 6e-13). The paths of R are rounded to three decimals, and their values are those at the rounded points.

use std::path::Path;

use rsm_fit::analysis::{Analysis, Group, Quadratic};
use serde_json::Value;

use crate::folders::shared;

struct Case {
    name: &'static str,
    file: &'static str,
    rows: std::ops::Range<usize>,
    /// Columns with centre and half range; 0 and 1 if they are already coded.
    factors: &'static [(&'static str, f64, f64)],
    block: Option<&'static str>,
    response: &'static str,
    interactions: bool,
    squares: bool,
}

const CASES: [Case; 5] = [
    Case {
        name: "chemreact1_FO",
        file: "chemreact.csv",
        rows: 0..7,
        factors: &[("Time", 85.0, 5.0), ("Temp", 175.0, 5.0)],
        block: None,
        response: "Yield",
        interactions: false,
        squares: false,
    },
    Case {
        name: "chemreact1_FO_TWI",
        file: "chemreact.csv",
        rows: 0..7,
        factors: &[("Time", 85.0, 5.0), ("Temp", 175.0, 5.0)],
        block: None,
        response: "Yield",
        interactions: true,
        squares: false,
    },
    Case {
        name: "chemreact_block_SO",
        file: "chemreact.csv",
        rows: 0..14,
        factors: &[("Time", 85.0, 5.0), ("Temp", 175.0, 5.0)],
        block: Some("Block"),
        response: "Yield",
        interactions: true,
        squares: true,
    },
    Case {
        name: "heli_block_SO",
        file: "heli.csv",
        rows: 0..30,
        factors: &[("x1", 0.0, 1.0), ("x2", 0.0, 1.0), ("x3", 0.0, 1.0), ("x4", 0.0, 1.0)],
        block: Some("block"),
        response: "ave",
        interactions: true,
        squares: true,
    },
    Case {
        name: "codata_SO",
        file: "codata.csv",
        rows: 0..18,
        factors: &[("x1", 0.0, 1.0), ("x2", 0.0, 1.0)],
        block: None,
        response: "y",
        interactions: true,
        squares: true,
    },
];

fn close(what: &str, found: f64, expected: &Value, scale: f64) {
    let expected = expected.as_f64().unwrap_or_else(|| panic!("{what}: nothing to compare with: {expected}"));
    let margin = 1e-10 * expected.abs().max(scale);
    assert!((found - expected).abs() <= margin, "{what}: found {found}, expected {expected}");
}

fn list(what: &str, found: &[Option<f64>], expected: &Value) {
    let expected = expected.as_array().unwrap_or_else(|| panic!("{what}: nothing to compare with"));
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().filter_map(Value::as_f64).map(f64::abs).fold(0.0, f64::max);
    for (found, expected) in found.iter().zip(expected) {
        match found {
            Some(found) => close(what, *found, expected, scale),
            None => assert!(expected.is_null(), "{what}: none, expected {expected}"),
        }
    }
}

/// A column of a CSV, as text.
fn column(folder: &Path, case: &Case, name: &str) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join(case.file)).unwrap();
    let mut lines = text.lines();
    let place = lines.next().unwrap().split(',').position(|cell| cell == name).unwrap();
    lines.skip(case.rows.start).take(case.rows.len()).map(|line| line.split(',').nth(place).unwrap().to_string()).collect()
}

struct Made {
    analysis: Analysis,
    /// The names in R's results, of the constant and of each column.
    names: Vec<String>,
    powers: Vec<Vec<u32>>,
}

fn made(folder: &Path, case: &Case) -> Made {
    let number = |cell: &String| cell.parse::<f64>().unwrap();
    let x: Vec<Vec<f64>> = case
        .factors
        .iter()
        .map(|(name, middle, half)| column(folder, case, name).iter().map(|cell| (number(cell) - middle) / half).collect())
        .collect();
    let width = x.len();
    let (mut groups, mut names, mut powers) = (Vec::new(), vec!["(Intercept)".to_string()], vec![vec![0; width]]);
    if let Some(block) = case.block {
        let cells = column(folder, case, block);
        // Treatment coding: the first level is the base.
        let second: Vec<f64> = cells.iter().map(|cell| f64::from(u8::from(*cell != cells[0]))).collect();
        groups.push(Group::new(block, [second]));
        names.push(format!("{block}2"));
        powers.push(Vec::new());
    }
    let all: Vec<String> = (1..=width).map(|k| format!("x{k}")).collect();
    let all = all.join(", ");
    let unit = |places: &[usize]| {
        let mut powers = vec![0; width];
        places.iter().for_each(|k| powers[*k] += 1);
        powers
    };
    groups.push(Group::new(format!("FO({all})"), &x));
    for k in 0..width {
        names.push(format!("x{}", k + 1));
        powers.push(unit(&[k]));
    }
    if case.interactions {
        let mut columns = Vec::new();
        for j in 0..width {
            for k in j + 1..width {
                columns.push(x[j].iter().zip(&x[k]).map(|(a, b)| a * b).collect::<Vec<f64>>());
                names.push(format!("x{}:x{}", j + 1, k + 1));
                powers.push(unit(&[j, k]));
            }
        }
        groups.push(Group::new(format!("TWI({all})"), columns));
    }
    if case.squares {
        groups.push(Group::new(format!("PQ({all})"), x.iter().map(|x| x.iter().map(|x| x * x).collect::<Vec<f64>>())));
        for k in 0..width {
            names.push(format!("x{}^2", k + 1));
            powers.push(unit(&[k, k]));
        }
    }
    let response: Vec<f64> = column(folder, case, case.response).iter().map(number).collect();
    Made { analysis: Analysis::new(&groups, &response).unwrap(), names, powers }
}

#[test]
fn blocks_variance_influence_and_criteria_agree() {
    let Some(folder) = shared("r-rsm") else { return };
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    for case in &CASES {
        println!("{}", case.name);
        let theirs = &expected["r_full_precision"][case.name];
        let Made { analysis, names, .. } = made(&folder, case);
        let scale = analysis.coefficients.iter().skip(1).map(|it| it.value.abs()).fold(0.0, f64::max);
        for (found, name) in analysis.coefficients.iter().zip(&names) {
            close(name, found.value, &theirs["coef"][name], scale);
            close(name, found.standard_error, &theirs["se"][name], 0.0);
            close(name, found.t, &theirs["t"][name], 1.0);
            close(name, found.p, &theirs["p"][name], 0.0);
        }
        close("R^2", analysis.r2, &theirs["r2"], 0.0);
        close("adjusted R^2", analysis.r2_adjusted, &theirs["adj_r2"], 0.0);
        close("sigma", analysis.residual_sd, &theirs["sigma"], 0.0);
        close("PRESS", analysis.press.unwrap(), &theirs["press"], 0.0);
        close("log-likelihood", analysis.log_likelihood, &theirs["loglik"], 1.0);
        close("AIC", analysis.aic, &theirs["aic"], 1.0);
        close("BIC", analysis.bic, &theirs["bic"], 1.0);
        let lines = theirs["anova"].as_object().unwrap();
        assert_eq!(analysis.sequential.len(), lines.len(), "{:?}", analysis.sequential);
        for line in &analysis.sequential {
            let name = match line.source.as_str() {
                "residual" => "Residuals",
                "lack of fit" => "Lack of fit",
                "pure error" => "Pure error",
                other => other,
            };
            let theirs = &lines[name];
            assert_eq!(line.df as f64, theirs["df"].as_f64().unwrap(), "{name}");
            // A sum of squares of 0.06 in a total of 100 has lost three digits in R.
            let total: f64 = analysis.sequential.iter().map(|line| line.ss).sum();
            close(name, line.ss, &theirs["ss"], 1e-3 * total);
            match line.f {
                Some(f) => {
                    close(name, f, &theirs["f"], 1.0);
                    close(name, line.p.unwrap(), &theirs["p"], 0.0);
                }
                None => assert!(theirs["f"].is_null(), "{name}"),
            }
        }
        let rows = &analysis.rows;
        list("leverage", &rows.iter().map(|row| Some(row.leverage)).collect::<Vec<_>>(), &theirs["leverage"]);
        list("rstandard", &rows.iter().map(|row| row.standardised).collect::<Vec<_>>(), &theirs["rstandard"]);
        list("rstudent", &rows.iter().map(|row| row.studentised).collect::<Vec<_>>(), &theirs["rstudent"]);
        list("Cook's distance", &rows.iter().map(|row| row.cook).collect::<Vec<_>>(), &theirs["cooks"]);
    }
}

#[test]
fn stationary_points_axes_and_paths_agree() {
    let Some(folder) = shared("r-rsm") else { return };
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    for case in &CASES {
        println!("{}", case.name);
        let theirs = &expected["r_full_precision"][case.name];
        let Made { analysis, powers, .. } = made(&folder, case);
        let width = case.factors.len();
        // Without the block, at its first level.
        let terms = powers.iter().zip(&analysis.coefficients).filter(|(powers, _)| !powers.is_empty());
        let surface = Quadratic::of_terms(width, terms.map(|(powers, it)| (&powers[..], it.value))).unwrap();
        let of_point = |point: &Value| (1..=width).map(|k| point[format!("x{k}")].as_f64().unwrap()).collect::<Vec<f64>>();
        // R treats an eigenvalue below a tenth of the largest as 0. Without that rule its result is comparable with ours.
        let key = |name: &str| {
            if theirs.get(format!("{name}_threshold0")).is_some() { format!("{name}_threshold0") } else { name.to_string() }
        };
        if let Some(point) = theirs.get(key("xs")) {
            for (k, found) in surface.stationary_point().unwrap().iter().enumerate() {
                close("stationary point", *found, &point[format!("x{}", k + 1)], 1.0);
            }
        }
        if let Some(values) = theirs.get(key("eigenvalues")) {
            let axes = surface.axes();
            list("eigenvalues", &axes.iter().map(|(value, _)| Some(*value)).collect::<Vec<_>>(), values);
            for (k, (_, axis)) in axes.iter().enumerate() {
                let theirs = of_point(&theirs[format!("eigenvector{}", k + 1)]);
                let sign = axis.iter().zip(&theirs).map(|(a, b)| a * b).sum::<f64>().signum();
                assert!(axis.iter().zip(&theirs).all(|(a, b)| (sign * a - b).abs() < 1e-10), "{axis:?} {theirs:?}");
            }
        }
        // Half a unit of the third decimal; R's search for the distance stops about 1e-4 from it. The value is that of the rounded point, and is
        // itself rounded.
        let near = |found: &rsm_fit::analysis::PathPoint, theirs: &Value| {
            let at = of_point(theirs);
            assert!(found.at.iter().zip(&at).all(|(a, b)| (a - b).abs() <= 1e-3), "{found:?} {theirs}");
            let value = theirs["yhat"].as_f64().unwrap();
            assert!((surface.value(&at) - value).abs() <= 0.501e-3, "{found:?} {theirs}");
        };
        if let Some(direction) = theirs.get("steepest_direction") {
            let found = &surface.steepest(&[1.0], true)[0];
            for (k, x) in found.at.iter().enumerate() {
                close("direction", *x, &direction[format!("x{}", k + 1)], 1.0);
            }
        }
        for (distance, point) in theirs.get("steepest_path").and_then(Value::as_object).into_iter().flatten() {
            let found = surface.steepest(&[distance.parse().unwrap()], true);
            near(&found[0], point);
        }
        if let Some(path) = theirs.get("canonical_path").and_then(Value::as_object) {
            let own = |sign: f64| -> bool {
                path.iter().all(|(distance, point)| {
                    let found = surface.along_axis(0, &[sign * distance.parse::<f64>().unwrap()]).unwrap().remove(0);
                    found.at.iter().zip(of_point(point)).all(|(a, b)| (a - b).abs() <= 0.501e-3)
                })
            };
            // The sign of an axis is arbitrary.
            assert!(own(1.0) || own(-1.0), "{path:?}");
        }
    }
}
