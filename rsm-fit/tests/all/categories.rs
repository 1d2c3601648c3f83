//! Categories as inputs, and blocks: against R, against a fit of each level by itself, and with families of rows that are drawn from a seed.

use std::path::Path;

use rsm_core::model::{Category, Model, Surface};
use rsm_core::{lower, number::Precision, run::Interpreter};
use rsm_fit::design::{count_of_candidates, terms_up_to};
use rsm_fit::fit::{Outcome, fit_sources};
use rsm_fit::random::Random;
use rsm_fit::spec::Constraint;
use rsm_fit::{Fit, Input, Response};
use serde_json::Value;

use crate::data::{Files, fitted, specification};
use crate::folders::shared;

fn coefficient(outcome: &Outcome, powers: &[u32]) -> f64 {
    let terms = &outcome.model.surfaces[0].terms;
    terms.iter().find(|term| term.powers == powers).unwrap_or_else(|| panic!("no term {powers:?} in {terms:?}")).coefficient
}

fn near(what: &str, found: f64, expected: f64, margin: f64) {
    assert!((found - expected).abs() <= margin, "{what}: found {found}, expected {expected}");
}

/// R's results have 13 digits; its treatment coding gives block 1 the effect 0, ours both effects add up to 0.
#[test]
fn two_blocks_agree_with_the_package_rsm_of_r() {
    let Some(folder) = shared("r-rsm") else { return };
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    for (name, file, block, response, factors) in [
        ("chemreact_block_SO", "chemreact.csv", "Block", "Yield", vec![("Time", [80.0, 90.0]), ("Temp", [170.0, 180.0])]),
        ("heli_block_SO", "heli.csv", "block", "ave", ["x1", "x2", "x3", "x4"].map(|name| (name, [-1.0, 1.0])).to_vec()),
    ] {
        let theirs = &expected["r_full_precision"][name];
        let number = |value: &Value| value.as_f64().unwrap();
        let mut text = format!("format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\nblocks = [\"{block}\"]\n");
        for (factor, [low, high]) in &factors {
            text += &format!("[inputs.{factor}]\nunit = \"1\"\nrange = [{low:?}, {high:?}]\n");
        }
        let inputs: Vec<String> = factors.iter().map(|(factor, _)| format!("\"{factor}\"")).collect();
        text += &format!("[responses.y]\ncolumn = \"{response}\"\nunit = \"1\"\ninputs = [{}]\n", inputs.join(", "));
        text += "select = { method = \"fixed\", order = 2 }\n";
        let data = std::fs::read_to_string(folder.join(file)).unwrap();
        let outcome = fitted(&text, &Files::of("d.csv", &data));
        let statistics = outcome.responses[0].statistics.as_ref().unwrap();
        let blocks = statistics.blocks.as_ref().unwrap();
        let key = format!("{block}2");
        let (half, error) = (number(&theirs["coef"][&key]) / 2.0, number(&theirs["se"][&key]) / 2.0);
        for (effect, sign) in blocks.effects.iter().zip([-1.0, 1.0]) {
            near("effect", effect.effect, sign * half, 1e-10 * half.abs());
            near("its error", effect.standard_error.unwrap(), error, 1e-10 * error);
        }
        assert_eq!(blocks.effects.iter().map(|effect| effect.rows).sum::<usize>(), statistics.rows);
        near("sd", blocks.sd, half.abs() * 2f64.sqrt(), 1e-10 * half.abs());
        near("constant", coefficient(&outcome, &vec![0; factors.len()]), number(&theirs["coef"]["(Intercept)"]) + half, 1e-8);
        for k in 0..factors.len() {
            let mut powers = vec![0; factors.len()];
            powers[k] = 1;
            near("slope", coefficient(&outcome, &powers), number(&theirs["coef"][format!("x{}", k + 1)]), 1e-9);
            powers[k] = 2;
            near("curvature", coefficient(&outcome, &powers), number(&theirs["coef"][format!("x{}^2", k + 1)]), 1e-9);
        }
        for term in statistics.terms.iter().filter(|term| term.powers.iter().sum::<u32>() == 1) {
            let k = term.powers.iter().position(|power| *power == 1).unwrap();
            let theirs = number(&theirs["se"][format!("x{}", k + 1)]);
            near("standard error", term.standard_error.unwrap(), theirs, 1e-10 * theirs);
        }
        near("sigma", statistics.residual_sd.unwrap(), number(&theirs["sigma"]), 1e-10);
        near("R^2", statistics.r2.unwrap(), number(&theirs["r2"]), 1e-10);
        near("PRESS", statistics.press.unwrap(), number(&theirs["press"]), 1e-9 * number(&theirs["press"]));
        let point = statistics.canonical.as_ref().unwrap();
        for (k, (_, [low, high])) in factors.iter().enumerate() {
            let coded = (point.stationary_point.0[k].1 - (low + high) / 2.0) / ((high - low) / 2.0);
            near("stationary point", coded, number(&theirs["xs"][format!("x{}", k + 1)]), 1e-8);
        }
        let analysis = statistics.analysis.as_ref().unwrap();
        assert_eq!(analysis.terms.len(), statistics.terms.len());
        let lines: Vec<(&str, f64)> = analysis.sequential.iter().map(|line| (line.source.as_str(), line.ss)).collect();
        assert_eq!(lines[0].0, block);
        near("sum of squares of blocks", lines[0].1, number(&theirs["anova"][block]["ss"]), 1e-8);
        let lack = &theirs["anova"]["Lack of fit"];
        let found = statistics.lack_of_fit.as_ref().map(|lack| lack.p);
        if !lack.is_null() {
            near("lack of fit", found.flatten().unwrap(), number(&lack["p"]), 1e-8);
        }
    }
}

/// Rows of a polynomial of its own for each level, with noise. `level,a[m],b[s],y[V]`, and the rows of each level by themselves.
fn rows_of_levels(random: &mut Random, levels: &[&str], rows: usize) -> (String, Vec<String>) {
    let head = "fuel,a[m],b[s],y[V]\n";
    let (mut all, mut each) = (head.to_string(), vec![head.to_string(); levels.len()]);
    let shapes: Vec<[f64; 5]> = levels.iter().map(|_| std::array::from_fn(|_| random.normal())).collect();
    for row in 0..rows {
        let k = row % levels.len();
        let (a, b) = (2.0 * random.share() - 1.0, 2.0 * random.share() - 1.0);
        let [c, p, q, r, s] = shapes[k];
        let y = c + p * a + q * b + r * a * a + s * a * b + 0.1 * random.normal();
        let line = format!("{},{a},{b},{y}\n", levels[k]);
        all += &line;
        each[k] += &line;
    }
    (all, each)
}

const RANGES: &str = "[inputs.a]\nrange = [-1.0, 1.0]\n[inputs.b]\nrange = [-1.0, 1.0]\n";

#[test]
fn a_surface_with_every_contrast_is_a_surface_of_each_level() {
    let mut random = Random::new(31);
    for levels in [&["diesel", "petrol"][..], &["E10", "gas, liquid", "diesel", "\u{e9}thanol"]] {
        let (all, each) = rows_of_levels(&mut random, levels, 30 * levels.len());
        let all: String = all.lines().map(|line| quoted(line, levels)).collect();
        let names: Vec<String> = levels.iter().map(|level| format!("{level:?}")).collect();
        let own = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];
        let width = levels.len() - 1;
        let mut terms: Vec<Vec<u32>> = Vec::new();
        for powers in own {
            for contrast in 0..levels.len() {
                let mut term = powers.to_vec();
                term.extend((0..width).map(|k| u32::from(k + 1 == contrast)));
                terms.push(term);
            }
        }
        let text = format!(
            "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n{RANGES}[inputs.fuel]\ncategories = [{}]\n[responses.y]\n\
             inputs = [\"a\", \"b\", \"fuel\"]\nterms = {terms:?}\nselect = {{ method = \"fixed\" }}\n",
            names.join(", ")
        );
        let outcome = fitted(&text, &Files::of("d.csv", &all));
        let surface = &outcome.model.surfaces[0];
        assert_eq!(surface.categories[0].levels, levels);
        let checked = outcome.checked().unwrap();
        let tape = lower::surface(&checked, 0, Precision::F64);
        for (level, rows) in levels.iter().zip(&each) {
            let rows: String = rows.lines().map(|line| quoted(line, levels)).collect();
            let text = format!(
                "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n{RANGES}[responses.y]\ninputs = [\"a\", \"b\"]\n\
                 select = {{ method = \"fixed\", order = 2 }}\n"
            );
            let alone = fitted(&text, &Files::of("d.csv", &rows));
            let alone = lower::surface(&alone.checked().unwrap(), 0, Precision::F64);
            for point in [[0.3, -0.9], [-1.0, 1.0], [0.0, 0.0]] {
                let with: Vec<f64> = point.into_iter().chain(surface.categories[0].contrasts(level).unwrap()).collect();
                let found = Interpreter::<f64>::new(&tape).eval(&with);
                let expected = Interpreter::<f64>::new(&alone).eval(&point);
                // Two solutions of the same least squares in double-double: only the sums in f64 differ.
                near(level, found, expected, 1e-13 * levels.len() as f64);
            }
        }
    }
}

/// A line of a CSV whose first cell may hold a comma.
fn quoted(line: &str, levels: &[&str]) -> String {
    match levels.iter().find(|level| line.starts_with(**level)) {
        Some(level) => format!("\"{level}\"{}\n", &line[level.len()..]),
        None => format!("{line}\n"),
    }
}

#[test]
fn candidates_are_the_independent_products_and_are_counted() {
    let mut random = Random::new(5);
    for case in 0..60 {
        let free = random.below(4) as usize;
        let mut surface = Surface { inputs: (0..free).map(|k| format!("x{k}")).collect(), ..Surface::default() };
        for number in 0..random.below(3) {
            let levels = (0..2 + random.below(3)).map(|k| k.to_string()).collect();
            let category = Category { additive: random.below(3) == 0, ..Category::new(format!("c{number}"), levels) };
            surface.inputs.extend(category.inputs.clone());
            surface.categories.push(category);
        }
        if surface.inputs.is_empty() {
            continue;
        }
        let order = 1 + random.below(4) as u32;
        let terms = terms_up_to(&surface, order);
        assert_eq!(terms.len(), count_of_candidates(&surface, order), "{case}: {surface:?}");
        let width = surface.inputs.len();
        // By brute force: every vector of powers, with the rules of contrasts.
        let mut expected = Vec::new();
        let mut powers = vec![0; width];
        loop {
            let of = |category: &Category| -> u32 {
                category.inputs.iter().map(|name| powers[surface.inputs.iter().position(|input| input == name).unwrap()]).sum()
            };
            let total: u32 = powers.iter().sum();
            let is_allowed = surface.categories.iter().all(|category| match (of(category), category.additive) {
                (0, _) => true,
                (1, additive) => !additive || total == 1,
                _ => false,
            });
            if total <= order && is_allowed {
                expected.push(powers.clone());
            }
            let Some(place) = powers.iter().position(|power| *power < order) else { break };
            powers[..place].fill(0);
            powers[place] += 1;
        }
        let mut sorted = terms.clone();
        sorted.sort();
        expected.sort();
        assert_eq!(sorted, expected, "{case}: {surface:?}");
    }
}

/// Rows of three days, with an offset for each: y = 1 + a - a^2 b + noise.
fn rows_of_days(seed: u64, rows: usize, offsets: [f64; 3]) -> String {
    let mut random = Random::new(seed);
    let mut text = "day,a[m],b[s],y[V]\n".to_string();
    let mut before = 0.0;
    for row in 0..rows {
        let (a, b) = (2.0 * random.share() - 1.0, 2.0 * random.share() - 1.0);
        before = 0.4 * before + 0.1 * random.normal();
        let day = row * 3 / rows;
        text += &format!("d{day},{a},{b},{}\n", 1.0 + a - a * a * b + before + offsets[day]);
    }
    text
}

#[test]
fn what_a_block_adds_to_all_its_rows_changes_only_its_effect() {
    for (keys, select) in [
        ("", "select = { method = \"fixed\", order = 3 }"),
        ("validate = { share = 0.3, seed = 4 }", "select = { method = \"ladder\", max_order = 4, confidence = 99.9 }"),
        ("", "select = { method = \"ladder\", max_order = 3, confidence = 90.0 }"),
        ("test = { share = 0.2, seed = 9 }", "select = { method = \"stepwise\", max_order = 4 }"),
        ("", "select = { method = \"stepwise\", max_order = 3, criterion = \"press\", direction = \"backward\" }"),
        ("", "select = { method = \"best-subset\", max_order = 3, criterion = \"aicc\" }"),
        ("", "select = { method = \"lasso\", max_order = 4 }"),
        ("", "loss = \"huber\"\nselect = { method = \"fixed\", order = 3 }"),
        ("", "noise = { order = 1 }\nselect = { method = \"fixed\", order = 3 }"),
    ] {
        let text = format!(
            "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\nblocks = [\"day\"]\n{keys}\n{RANGES}[responses.y]\n\
             inputs = [\"a\", \"b\"]\n{select}\n"
        );
        let offsets = [5.0, -20.0, 8.0];
        let plain = fitted(&text, &Files::of("d.csv", &rows_of_days(7, 120, [0.0; 3])));
        let moved = fitted(&text, &Files::of("d.csv", &rows_of_days(7, 120, offsets)));
        let (before, after) = (&plain.responses[0].statistics, &moved.responses[0].statistics);
        let (before, after) = (before.as_ref().unwrap(), after.as_ref().unwrap());
        let powers = |outcome: &Outcome| -> Vec<Vec<u32>> {
            outcome.model.surfaces[0].terms.iter().map(|term| term.powers.clone()).collect()
        };
        assert_eq!(powers(&plain), powers(&moved), "{select}");
        assert!(powers(&plain).iter().all(|powers| powers.len() == 2), "{select}");
        // The responses are 20 times as large: their rounding, through the steps of a search in f64.
        let margin = 1e-8;
        let mean = offsets.iter().sum::<f64>() / 3.0;
        for (one, other) in before.terms.iter().zip(&after.terms) {
            let shift = if one.powers == [0, 0] { mean } else { 0.0 };
            near(select, other.coefficient - shift, one.coefficient, margin);
            if let (Some(one), Some(other)) = (one.standard_error, other.standard_error) {
                near(select, one, other, margin);
            }
        }
        let effects = before.blocks.iter().flat_map(|blocks| &blocks.effects);
        for ((one, other), offset) in effects.zip(&after.blocks.as_ref().unwrap().effects).zip(offsets) {
            near(select, other.effect - (offset - mean), one.effect, margin);
        }
        let cross = |statistics: &rsm_fit::statistics::ResponseStatistics| {
            statistics.cross_validation.as_ref().map_or(0.0, |cross| cross.errors.rmse)
        };
        near(select, cross(after), cross(before), 1e-6);
        // Without blocks the offsets would be errors of 11.
        assert!(after.residual_sd.is_none_or(|sd| sd < 0.3), "{select}: {:?}", after.residual_sd);
        let json = serde_json::to_value(moved.report()).unwrap();
        assert_eq!(json["responses"]["y"]["blocks"]["effects"][1]["block"], "d1", "{select}");
    }
}

#[test]
fn rows_of_other_files_have_the_mean_of_the_blocks() {
    let text = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\ntest = [\"t.csv\"]\nblocks = [\"day\"]\n{RANGES}[responses.y]\n\
         inputs = [\"a\", \"b\"]\nselect = {{ method = \"fixed\", order = 3 }}\n"
    );
    let files = Files::of("d.csv", &rows_of_days(7, 240, [6.0, -9.0, 3.0]));
    files.file("t.csv", &rows_of_days(8, 60, [0.0; 3]).replace("day,", "note,"));
    let outcome = fitted(&text, &files);
    let errors = outcome.responses[0].statistics.as_ref().unwrap().test.as_ref().unwrap().rmse;
    assert!(errors < 0.15, "{errors}");
}

#[test]
fn an_additive_category_is_the_same_shift_for_all_points() {
    let text = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n{RANGES}[inputs.day]\ncategories = [\"d0\", \"d1\", \"d2\"]\nadditive = true\n\
         [responses.y]\ninputs = [\"a\", \"b\", \"day\"]\nselect = {{ method = \"lasso\", max_order = 4 }}\n"
    );
    let outcome = fitted(&text, &Files::of("d.csv", &rows_of_days(7, 120, [1.0, 0.0, -1.0])));
    let surface = &outcome.model.surfaces[0];
    let shifts: Vec<&Vec<u32>> =
        surface.terms.iter().map(|term| &term.powers).filter(|powers| powers[2] + powers[3] > 0).collect();
    assert_eq!(shifts, [&[0, 0, 1, 0], &[0, 0, 0, 1]], "both, and no product");
    near("first day", coefficient(&outcome, &[0, 0, 1, 0]), 1.0, 0.1);
    near("second day", coefficient(&outcome, &[0, 0, 0, 1]), 0.0, 0.1);
    let names: Vec<&str> = outcome.model.inputs.iter().map(|input| input.name.as_str()).collect();
    assert_eq!(names, ["a", "b", "day_d0", "day_d1"]);
    let read = |model: &Model| {
        let text = rsm_core::model_file::write(model);
        rsm_core::check::Checked::read(&rsm_core::source::Source::new("m.toml", text)).unwrap().model().clone()
    };
    assert_eq!(read(&outcome.model), outcome.model);
}

#[test]
fn what_does_not_fit_is_refused() {
    let refused = |head: &str, input: &str, response: &str, data: &str| {
        let text = format!(
            "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n{head}\n[inputs.a]\n[inputs.fuel]\n{input}\n[responses.y]\n{response}\n"
        );
        let source = rsm_core::source::Source::new("fit.toml", text.clone());
        match rsm_fit::Specification::from_source(source, Path::new("").into()) {
            Err(faults) => faults.to_string(),
            Ok(_) => {
                let data = rsm_core::source::Source::new("d.csv", data);
                fit_sources(&specification(&text, Path::new("")), &[data], &mut |_| {}).unwrap_err().to_string()
            }
        }
    };
    let fixed = "inputs = [\"a\", \"fuel\"]\nselect = { method = \"fixed\", order = 1 }";
    let two = "categories = [\"x\", \"y\"]";
    let data = "a[m],fuel,y[V],day\n1,x,2,p\n2,y,3,q\n3,Y,4,\n4,Y,5,q\n5,,6,p\n";
    for (head, input, response, wanted) in [
        ("", two, fixed, "d.csv:4: column 2 `fuel`: found `Y`, expected one of `x`, `y`; 2 cells have it"),
        ("", two, fixed, "d.csv:6: column 2 `fuel`: found an empty cell, expected one of `x`, `y`"),
        ("", two, fixed, "missing = \"drop-row\""),
        ("", "categories = [\"x\"]", fixed, "found 1 levels, expected 2 to 100"),
        ("", "categories = [\"x\", \"y\", \"x\"]", fixed, "`x` is given twice"),
        ("", "categories = [\"x 1\", \"x-1\", \"y\"]", fixed, "`x 1` and `x-1` both make an input `fuel_x_1`"),
        ("", "categories = [\"x\", \"y\"]\nunit = \"m\"", fixed, "`unit`"),
        (
            "",
            two,
            "inputs = [\"a\", \"fuel\"]\nspline = { cells = [2, 2] }\nselect = { method = \"fixed\" }",
            "a spline cannot have a category",
        ),
        (
            "",
            two,
            "inputs = [\"a\", \"fuel\"]\nknots = [{ input = \"fuel_x\", at = 0.0 }]\nselect = { method = \"fixed\", order = 1 }",
            "cannot have",
        ),
        (
            "",
            "categories = [\"x\", \"y\", \"z\"]",
            "inputs = [\"a\", \"fuel_x\"]\nselect = { method = \"fixed\", order = 1 }",
            "some of its contrasts",
        ),
        ("blocks = [\"fuel\"]", two, fixed, "is an input too"),
        ("blocks = [\"day\", \"day\"]", two, fixed, "column `day` is given twice"),
        (
            "blocks = [\"day\"]\nvalidate = { share = 0.5, seed = 1, keep_together = [\"day\"] }",
            two,
            fixed,
            "`keep_together` too",
        ),
        (
            "blocks = [\"day\"]",
            "column = \"a\"",
            "inputs = [\"a\"]\nselect = { method = \"fixed\", order = 1 }",
            "row 3 of `data` has no cell in column `day`",
        ),
    ] {
        let found = refused(head, input, response, data);
        assert!(found.contains(wanted), "{wanted}\n{found}");
    }
}

#[test]
fn shards_with_a_category_are_the_whole_fit_and_blocks_need_all_rows() {
    let rows = rows_of_days(7, 120, [1.0, 0.0, -1.0]);
    let text = |keys: &str, input: &str| {
        format!(
            "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\n{keys}{RANGES}{input}[responses.y]\n\
             inputs = [\"a\", \"b\"{}]\nselect = {{ method = \"fixed\", order = 2 }}\n",
            if input.is_empty() { "" } else { ", \"day\"" }
        )
    };
    let category = "[inputs.day]\ncategories = [\"d0\", \"d1\", \"d2\"]\n";
    let whole = fitted(&text("", category), &Files::of("d.csv", &rows));
    let (head, lines) = rows.split_once('\n').unwrap();
    let lines: Vec<&str> = lines.lines().collect();
    let spec = specification(&text("", category), Path::new(""));
    let part = |lines: &[&str]| {
        let source = rsm_core::source::Source::new("d.csv", format!("{head}\n{}\n", lines.join("\n")));
        rsm_fit::partial::of_sources(&spec, &[source]).unwrap()
    };
    // The second shard lacks the first day.
    let merged = rsm_fit::partial::merge(vec![part(&lines[..50]), part(&lines[50..])]).unwrap();
    for (one, other) in merged.outcome.model.surfaces[0].terms.iter().zip(&whole.model.surfaces[0].terms) {
        assert_eq!(one.powers, other.powers);
        near("merged", one.coefficient, other.coefficient, 1e-14);
    }
    assert_eq!(merged.outcome.model.surfaces[0].categories, whole.model.surfaces[0].categories);
    let spec = specification(&text("blocks = [\"day\"]\n", ""), Path::new(""));
    let source = rsm_core::source::Source::new("d.csv", rows.clone());
    let refused = rsm_fit::partial::of_sources(&spec, &[source]).unwrap_err().to_string();
    assert!(refused.contains("which blocks there are depends on the rows of all shards"), "{refused}");
    // A number of the row is no block.
    let many: String = rows.lines().skip(1).cycle().take(400).enumerate().map(|(k, line)| format!("{k}{line}\n")).collect();
    let source = rsm_core::source::Source::new("d.csv", format!("{head}\n{many}"));
    let refused = fit_sources(&spec, &[source], &mut |_| {}).unwrap_err().to_string();
    assert!(refused.contains("tells more than 300 blocks apart"), "{refused}");
}

/// Rows of three days on which y = 10 + 4 x - 6 x^2, shifted by the day, with noise: the data rise above 10.
fn of_days(seed: u64) -> (Vec<f64>, Vec<String>, Vec<f64>) {
    let mut random = Random::new(seed);
    let mut share = || random.below(1 << 20) as f64 / f64::from(1 << 20);
    let (mut x, mut day, mut y) = (vec![], vec![], vec![]);
    for row in 0..48 {
        let (at, of) = (2.0 * share() - 1.0, [0, 0, 1, 2][row % 4]);
        x.push(at);
        day.push(format!("d{of}"));
        y.push(10.0 + 4.0 * at - 6.0 * at * at + [-1.5, 0.5, 2.0][of] + 0.4 * (share() - 0.5));
    }
    (x, day, y)
}

/// The reference alternates between the surface for known effects and the effects for a known surface. It ends at the least sum of squares, because
/// the problem is convex and the constraints are on the surface alone.
#[test]
fn constraints_hold_on_the_mean_over_the_blocks_at_the_least_error() {
    for (seed, constraint) in [
        Constraint::Bounds { min: None, max: Some(10.2) },
        Constraint::Monotone { input: "x".into(), increasing: false },
        Constraint::Bounds { min: Some(-80.0), max: Some(50.0) },
    ]
    .into_iter()
    .enumerate()
    {
        let (x, day, y) = of_days(seed as u64);
        let fit = |y: &[f64], has_blocks: bool, has_constraint: bool| {
            let response = Response::new("y", y);
            let response = if has_constraint { response.constraint(constraint.clone()) } else { response };
            let fit = Fit::new([Input::new("x", &x).range([-1.0, 1.0])], response).order(3);
            let outcome = if has_blocks { fit.blocks(&day).fit() } else { fit.fit() }.unwrap();
            let tape = lower::surface(&outcome.checked().unwrap(), 0, Precision::F64);
            let value = move |at: f64| Interpreter::<f64>::new(&tape).eval(&[at]);
            (outcome, value)
        };
        let (outcome, value) = fit(&y, true, true);
        let statistics = outcome.responses[0].statistics.as_ref().unwrap();
        let is_active = statistics.constraints.as_ref().unwrap().active;
        assert_eq!(is_active, seed < 2);
        let effects = &statistics.blocks.as_ref().unwrap().effects;
        assert!(effects.iter().all(|one| one.standard_error.is_some() != is_active));
        let along: Vec<f64> = (0..=100).map(|k| value(f64::from(k) / 50.0 - 1.0)).collect();
        match &constraint {
            Constraint::Bounds { min, max } => {
                let (min, max) = (min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY));
                assert!(along.iter().all(|y| min - 1e-9 <= *y && *y <= max + 1e-9), "{along:?}");
            }
            _ => assert!(along.windows(2).all(|two| two[1] <= two[0] + 1e-9), "{along:?}"),
        }
        if !is_active {
            let (free, of_free) = fit(&y, true, false);
            assert_eq!(free.model.surfaces[0].terms, outcome.model.surfaces[0].terms);
            assert_eq!(value(0.3).to_bits(), of_free(0.3).to_bits());
            continue;
        }
        let mut shifts = [0.0; 3];
        let place = |row: usize| day[row][1..].parse::<usize>().unwrap();
        let mut alternating = along.clone();
        for _ in 0..40 {
            let less: Vec<f64> = (0..48).map(|row| y[row] - shifts[place(row)]).collect();
            let (_, known) = fit(&less, false, true);
            // The effects of the least sum of squares that add up to 0: each mean less a share that falls with the number of rows.
            let of_block = |k: usize| (0..48).filter(move |row| place(*row) == k);
            let counts = [0, 1, 2].map(|k| of_block(k).count() as f64);
            let means = [0, 1, 2].map(|k| of_block(k).map(|row| y[row] - known(x[row])).sum::<f64>() / counts[k]);
            let share = means.iter().sum::<f64>() / counts.iter().map(|count| 1.0 / count).sum::<f64>();
            shifts = [0, 1, 2].map(|k| means[k] - share / counts[k]);
            alternating = (0..=100).map(|k| known(f64::from(k) / 50.0 - 1.0)).collect();
        }
        // The exchange stops within 1e-4 of the spread of some 10.
        let far = along.iter().zip(&alternating).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < 5e-3, "{constraint}: {far}");
        for (one, shift) in effects.iter().zip(&shifts) {
            near("effect", one.effect, *shift, 5e-3);
        }
    }
}
