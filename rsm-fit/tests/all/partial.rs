//! Fits of parts: a merge has the digits of one fit, within the bound that it computes, and the same bits in any order; bad parts are refused.

use std::io::Write as _;
use std::path::Path;

use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_fit::fit::{Outcome, fit_sources};
use rsm_fit::partial::{Merged, Part, combine, merge, of_files, of_sources};
use rsm_fit::random::Random;
use rsm_fit::statistics::ResponseStatistics;
use serde_json::Value;

use crate::data::specification;
use crate::folders::nist;
use crate::nist::{FLOORS, agreement_of, text_of};

/// The rows of a CSV in some parts: whole blocks, or every n-th row.
fn shards(csv: &str, count: usize, in_blocks: bool) -> Vec<Source> {
    let (header, rows) = csv.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().filter(|line| !line.is_empty()).collect();
    let block = rows.len().div_ceil(count);
    let of_one = |part: usize| {
        let is_in = |k: usize| if in_blocks { k / block == part } else { k % count == part };
        let own: String = (0..rows.len()).filter(|k| is_in(*k)).map(|k| format!("{}\n", rows[k])).collect();
        (!own.is_empty()).then(|| Source::new(format!("shard-{part}.csv"), format!("{header}\n{own}")))
    };
    (0..count).filter_map(of_one).collect()
}

/// Parts of a specification, written and read again.
fn parts(text: &str, shards: &[Source]) -> Vec<Part> {
    let specification = specification(text, Path::new(""));
    let of_one = |shard: &Source| {
        let part = of_sources(&specification, std::slice::from_ref(shard)).unwrap_or_else(|refused| panic!("{refused}"));
        let name = shard.name().replace(".csv", ".rsm");
        let read = Part::read(&Source::new(name, part.write())).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!(read.write(), part.write(), "a part that is read is the one that was written");
        read
    };
    shards.iter().map(of_one).collect()
}

fn merged(text: &str, shards: &[Source]) -> Merged {
    merge(parts(text, shards)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// One fit of all rows.
fn single(text: &str, csv: &str) -> Outcome {
    let sources = [Source::new("data.csv", csv)];
    fit_sources(&specification(text, Path::new("")), &sources, &mut |_| {}).unwrap_or_else(|refused| panic!("{refused}"))
}

fn figures(outcome: &Outcome, place: usize) -> &ResponseStatistics {
    outcome.responses[place].statistics.as_ref().unwrap_or_else(|| panic!("{}", outcome.responses[place].verdict))
}

/// Everything that a merge gives, as text.
fn bits(merged: &Merged) -> String {
    format!("{}{}", model_file::write(&merged.outcome.model), serde_json::to_string(&merged.report()).unwrap())
}

/// The largest ratio of a difference of coefficients to its bound; at most 1 if the bound is right.
fn against_bound(merged: &Merged, single: &Outcome) -> f64 {
    let mut worst = 0.0f64;
    for (place, (name, bounds)) in merged.merge.largest_difference.0.iter().enumerate() {
        let (found, expected) = (figures(&merged.outcome, place), figures(single, place));
        let bounds = bounds.as_ref().unwrap_or_else(|| panic!("{name} has no bound"));
        assert_eq!(bounds.len(), expected.terms.len());
        for ((found, expected), bound) in found.terms.iter().zip(&expected.terms).zip(bounds) {
            assert_eq!(found.powers, expected.powers);
            let gap = (found.coefficient - expected.coefficient).abs();
            worst = worst.max(if gap == 0.0 { 0.0 } else { gap / bound });
        }
    }
    worst
}

fn is_near(found: Option<f64>, expected: Option<f64>, share: f64) -> bool {
    match (found, expected) {
        (Some(found), Some(expected)) => (found - expected).abs() <= share * expected.abs(),
        (found, expected) => found == expected,
    }
}

#[test]
fn nist_sets_in_parts_keep_the_digits_that_the_data_hold() {
    let folder = nist();
    let certified: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("certified.json")).unwrap()).unwrap();
    let mut failures = Vec::new();
    for (set, floor) in FLOORS {
        let csv = std::fs::read_to_string(folder.join(format!("{set}.csv"))).unwrap();
        let text = text_of(set, &certified[*set]).replace(&format!("{set}.csv"), "data.csv");
        let single = single(&text, &csv);
        for (count, in_blocks) in [(1, true), (3, true), (4, false), (7, true)] {
            let merged = merged(&text, &shards(&csv, count, in_blocks));
            let found = agreement_of(figures(&merged.outcome, 0), &certified[*set]);
            let ratio = against_bound(&merged, &single);
            let bounds = merged.merge.largest_difference.0[0].1.clone().unwrap();
            let relative = figures(&single, 0).terms.iter().zip(&bounds).map(|(term, bound)| bound / term.coefficient.abs());
            let relative = relative.fold(0.0, f64::max);
            println!("{set:10} {count} parts: {found:.2?}, {ratio:.1e} of the bound, which is {relative:.1e} of a coefficient");
            if found.iter().zip(floor).any(|(found, floor)| found < floor) || ratio > 1.0 {
                failures.push(format!("{set} in {count} parts: {found:?} digits, expected {floor:?}; {ratio} of the bound"));
            }
            // The bound is small: two roundings to f64, and for Filip, whose condition is 10^10 in coded columns, little more.
            if relative.is_nan() || relative >= 1e-13 {
                failures.push(format!("{set} in {count} parts: a bound of {relative} of a coefficient"));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// 300 rows of two responses with noise, weights, missing cells; one response is the same for both fits.
fn table() -> String {
    let mut random = Random::new(5);
    let mut csv = "a[m],b[s],y[V],z[N],sigma\n".to_string();
    for row in 0..300 {
        let (a, b) = (10.0 * random.share(), 2.0 * random.share() - 1.0);
        let sigma = 0.1 + random.share();
        let y = 3.0 + a - 0.2 * a * b + 0.05 * a * a + sigma * random.normal();
        let z = 1e3 - 2.0 * b + 0.01 * random.normal();
        let y = if row % 13 == 4 { "NA".to_string() } else { y.to_string() };
        csv += &format!("{a},{b},{y},{z},{sigma}\n");
    }
    csv
}

fn head(rest: &str) -> String {
    format!(
        "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\nmissing = \"drop-row\"\n[inputs.a]\nunit = \"cm\"\nrange = [0.0, 900.0]\n[inputs.b]\nunit = \"ms\"\n\
         range = [-1000.0, 1000.0]\n{rest}"
    )
}

const BOTH: &str = "[responses.y]\nunit = \"mV\"\ninputs = [\"a\", \"b\"]\nweights = { standard_error = \"sigma\" }\n\
                    select = { method = \"fixed\", order = 2 }\n[responses.z]\nunit = \"N\"\ninputs = [\"b\"]\n\
                    select = { method = \"fixed\" }\nterms = [[0], [1]]\n";

#[test]
fn a_merge_has_the_figures_of_one_fit_and_the_same_bits_in_any_order() {
    let (csv, text) = (table(), head(BOTH));
    let single = single(&text, &csv);
    let shards = shards(&csv, 5, false);
    let found = merged(&text, &shards);
    assert!(against_bound(&found, &single) <= 1.0, "{}", against_bound(&found, &single));
    let mut random = Random::new(8);
    let mut order: Vec<usize> = (0..5).collect();
    for _ in 0..6 {
        random.shuffle(&mut order);
        let shuffled: Vec<Source> = order.iter().map(|k| shards[*k].clone()).collect();
        assert_eq!(bits(&merged(&text, &shuffled)), bits(&found), "{order:?}");
    }
    for place in 0..2 {
        let (found, expected) = (figures(&found.outcome, place), figures(&single, place));
        assert_eq!(found.rows, expected.rows);
        // Weights are divided by their mean in f64 by one fit, with an error of 2^-53 for each row.
        let share = 300.0 * f64::EPSILON;
        for (found, expected) in found.terms.iter().zip(&expected.terms) {
            assert!(is_near(found.standard_error, expected.standard_error, share), "{found:?} {expected:?}");
            assert!(is_near(found.p, expected.p, 1e3 * share) || found.p < Some(1e-200), "{found:?} {expected:?}");
        }
        assert!(is_near(found.residual_sd, expected.residual_sd, share));
        assert!(is_near(found.r2, expected.r2, share) && is_near(found.r2_adjusted, expected.r2_adjusted, share));
        assert!(is_near(
            found.canonical.as_ref().map(|it| it.eigenvalues[0]),
            expected.canonical.as_ref().map(|it| it.eigenvalues[0]),
            1e-12
        ));
        assert!(found.press.is_none() && found.confidence_c.is_none() && found.lack_of_fit.is_none());
        let (analysis, whole) = (found.analysis.as_ref().unwrap(), expected.analysis.as_ref().unwrap());
        assert!(is_near(analysis.aicc, whole.aicc, 1e-12) && is_near(Some(analysis.bic), Some(whole.bic), 1e-12));
        for (line, known) in analysis.sequential.iter().zip(&whole.sequential) {
            assert_eq!((&line.source, line.df), (&known.source, known.df));
            assert!(is_near(Some(line.ss), Some(known.ss), 1e-12) && is_near(line.f, known.f, 1e-12), "{line:?} {known:?}");
        }
        for (term, known) in analysis.terms.iter().zip(&whole.terms) {
            assert!(is_near(term.vif, known.vif, 1e-12) && is_near(Some(term.interval[1]), Some(known.interval[1]), 1e-12));
        }
    }
    assert_eq!(found.outcome.responses[0].rows_outside, single.responses[0].rows_outside);
    let (own, whole) = (&found.outcome.left_out[0][0], &single.left_out[0][0]);
    assert_eq!((own.rows, own.of, own.cells.len()), (whole.rows, whole.of, 5));
    assert_eq!(found.outcome.model.inputs, single.model.inputs);
    assert_eq!(found.outcome.files.iter().map(|file| file.rows).sum::<usize>(), 300);
    let evidence = &found.outcome.model.surfaces[0].evidence;
    assert!(evidence.iter().any(|(name, value)| name == "parts" && *value == rsm_core::model::Evidence::Whole(5)));
}

#[test]
fn parts_of_parts_have_the_figures_of_all_parts() {
    let (csv, text) = (table(), head(BOTH));
    let shards = shards(&csv, 6, true);
    let all = parts(&text, &shards);
    let mut groups = all.into_iter();
    let mut next = |count: usize| combine(groups.by_ref().take(count).collect()).unwrap();
    let (one, two, three) = (next(3), next(2), next(1));
    let read = |part: &Part| Part::read(&Source::new("p.rsm", part.write())).unwrap();
    let found = merge(vec![read(&three), read(&combine(vec![one, two]).unwrap())]).unwrap();
    let expected = single(&text, &csv);
    assert!(against_bound(&found, &expected) <= 1.0, "{}", against_bound(&found, &expected));
    let (own, whole) = (figures(&found.outcome, 0), figures(&expected, 0));
    // Weights are divided by their mean in f64 by one fit, with an error of 2^-53 for each row.
    assert!(own.rows == whole.rows && is_near(own.residual_sd, whole.residual_sd, 300.0 * f64::EPSILON));
    assert_eq!(found.outcome.left_out[0][0].rows, expected.left_out[0][0].rows);
    assert_eq!(found.outcome.files.len(), 6);
    // A shard in two parts.
    let again = parts(&text, &shards[..2]);
    let refused =
        combine(again.into_iter().chain([three]).chain(parts(&text, &shards[..1])).collect()).unwrap_err().to_string();
    assert!(refused.contains("is the same part as"), "{refused}");
}

/// Some MB, so that the file is read in several blocks; a comment and a quoted cell with an end of line within.
#[test]
fn a_file_in_blocks_has_the_part_of_the_whole_text() {
    let mut random = Random::new(9);
    let mut csv = "# bench 3\na[m],note,b[s],y[V],z[N],sigma\n".to_string();
    for row in 0..40_000 {
        let (a, b) = (10.0 * random.share(), 2.0 * random.share() - 1.0);
        let y = if row % 9001 == 4000 { String::new() } else { (3.0 + a * b).to_string() };
        let note = if row % 977 == 0 { "\"cold,\nthen \"\"warm\"\"\"" } else { "x" };
        csv += &format!("{a},{note},{b},{y},{},{}\n", 1e3 - b, 0.1 + random.share());
    }
    let folder = std::env::temp_dir().join(format!("rsm-blocks-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("packed")).unwrap();
    let specification = specification(&head(BOTH), &folder);
    let plain = folder.join("data.csv");
    std::fs::write(&plain, &csv).unwrap();
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(csv.as_bytes()).unwrap();
    let packed = folder.join("packed").join("data.csv");
    std::fs::write(&packed, encoder.finish().unwrap()).unwrap();
    let expected = of_sources(&specification, &[Source::new("data.csv", csv.clone())]).unwrap().write();
    assert!(csv.len() > 3 << 20 && expected.contains("rows = 40000") && expected.contains("cells = 4"), "{}", csv.len());
    for path in [&plain, &packed] {
        assert_eq!(of_files(&specification, &[path], &mut |_| {}).unwrap().write(), expected, "{}", path.display());
    }
    // The file of the specification, and the whole fit of a compressed file.
    assert_eq!(of_files(&specification, &[] as &[&Path], &mut |_| {}).unwrap().write(), expected);
    // A fault far down has its line.
    let line = csv.lines().count();
    std::fs::write(&plain, format!("{csv}1,x,2,3,four,5\n")).unwrap();
    let refused = of_files(&specification, &[&plain], &mut |_| {}).unwrap_err().to_string();
    assert!(refused.contains(&format!("data.csv:{}: column 5 `z`: found `four`", line + 1)), "{refused}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn aicc_chooses_the_same_terms_from_sums() {
    let csv = table();
    for method in ["stepwise", "best-subset", "lasso"] {
        for heredity in [true, false] {
            let select =
                format!("select = {{ method = \"{method}\", max_order = 3, criterion = \"aicc\", heredity = {heredity} }}");
            let text =
                head(&format!("[responses.y]\nunit = \"V\"\ninputs = [\"a\", \"b\"]\nforms = [\"polynomial\"]\n{select}\n"));
            let (found, single) = (merged(&text, &shards(&csv, 4, true)), single(&text, &csv));
            let (found, expected) = (figures(&found.outcome, 0), figures(&single, 0));
            assert!(found.terms.len() < 10, "some terms are not needed");
            for (term, known) in found.terms.iter().zip(&expected.terms) {
                assert_eq!(term.powers, known.powers, "{select}");
                // Shrunken coefficients are computed in f64, whose sums over 300 rows have errors of 300 * 2^-53, times the condition of ten terms.
                assert!(is_near(Some(term.coefficient), Some(known.coefficient), 1e-11), "{select}: {term:?} {known:?}");
            }
            assert_eq!(found.terms.len(), expected.terms.len());
            let (own, whole) = (found.selection.as_ref().unwrap(), expected.selection.as_ref().unwrap());
            assert_eq!((own.candidates, own.proved, own.path.len()), (whole.candidates, whole.proved, whole.path.len()));
            assert!(found.warnings.iter().any(|warning| warning.kind == "judged-by-choosers"));
        }
    }
}

#[test]
fn constraints_hold_for_a_merge() {
    let csv = table();
    let text = head(
        "[responses.y]\nunit = \"V\"\ninputs = [\"a\", \"b\"]\nselect = { method = \"fixed\", order = 2 }\n\
         constraints = [{ kind = \"monotone\", input = \"b\", direction = \"increasing\" }]\n",
    );
    let (found, single) = (merged(&text, &shards(&csv, 3, true)), single(&text, &csv));
    assert_eq!(found.merge.largest_difference.0[0].1, None, "constrained coefficients have no bound");
    let (found, expected) = (figures(&found.outcome, 0), figures(&single, 0));
    let (own, whole) = (found.constraints.as_ref().unwrap(), expected.constraints.as_ref().unwrap());
    assert!(own.active && whole.active);
    for (term, known) in found.terms.iter().zip(&expected.terms) {
        // The solver of the constrained problem stops at 1e-9 of the spread (`constrain/program.rs`); the spread is some ten V.
        assert!((term.coefficient - known.coefficient).abs() < 1e-7, "{term:?} {known:?}");
    }
    assert!(is_near(found.residual_sd, expected.residual_sd, 1e-8));
    assert!(found.analysis.is_none());
}

#[test]
fn ranges_without_coding_come_from_all_parts() {
    let csv = "x[m],y[N]\n1,3\n2,5.5\n3,7\n4,9.25\n5,11\n";
    let text = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.x]\n[responses.y]\ninputs = [\"x\"]\ncoding = \"none\"\n\
                select = { method = \"fixed\", order = 1 }\n";
    let found = merged(text, &shards(csv, 5, true));
    assert_eq!(found.outcome.model, {
        let mut model = single(text, csv).model;
        model.surfaces[0].evidence.clone_from(&found.outcome.model.surfaces[0].evidence);
        model
    });
    assert_eq!(found.outcome.model.inputs[0].range, [1.0, 5.0]);
    // Two parts of one row each cannot determine two terms with a residual, but they determine two terms.
    let two = merged(text, &shards(csv, 5, true)[..2]);
    assert_eq!(figures(&two.outcome, 0).residual_sd, None);
    assert!(two.outcome.reached());
    let faults = merge(parts(text, &shards(csv, 5, true)[..1])).unwrap_err().to_string();
    assert!(faults.contains("found 1 rows to fit, expected at least 2"), "{faults}");
}

fn refused(text: &str) -> String {
    let csv = Source::new("data.csv", table());
    of_sources(&specification(text, Path::new("")), &[csv]).unwrap_err().to_string()
}

#[test]
fn what_needs_rows_is_refused_with_what_is_possible() {
    let response = |rest: &str| head(&format!("[responses.z]\nunit = \"N\"\ninputs = [\"a\", \"b\"]\n{rest}\n"));
    let fixed = "select = { method = \"fixed\", order = 1 }\n";
    for (text, expected) in [
        (response("select = { max_order = 2 }"), "criterion \"k-fold\" evaluates terms on rows"),
        (
            response("forms = [\"polynomial\"]\nselect = { method = \"stepwise\", max_order = 2, criterion = \"press\" }"),
            "criterion \"press\" evaluates terms on rows",
        ),
        (
            response("select = { method = \"ladder\", max_order = 2, confidence = 99.0 }"),
            "a ladder evaluates its terms on rows",
        ),
        (
            response("select = { method = \"lasso\", max_order = 2, criterion = \"aicc\" }"),
            "sigmoids, waves and splines are found on rows",
        ),
        (
            response(&format!("{fixed}forms = [\"polynomial\", \"hinge\"]")),
            "hinges, sigmoids, waves and splines are found on rows",
        ),
        (
            response("select = { method = \"fixed\" }\nspline = { degree = 1, cells = [2, 2] }"),
            "the penalty of a spline is chosen on rows",
        ),
        (response(&format!("{fixed}loss = \"huber\"")), "`loss = \"huber\"` weights each row"),
        (response(&format!("{fixed}support = \"data\"")), "`support` is found on rows"),
        (response(fixed).replace("range = [0.0, 900.0]\n", ""), "input `a`: without `range` its coding depends on the rows"),
        (response(fixed).replace("range = [0.0, 900.0]\n", "period = 900.0\n"), "the orders of waves are found on rows"),
        (response(fixed).replace("missing =", "test = { share = 0.2, seed = 1 }\nmissing ="), "`test` needs rows"),
        (response(fixed).replace("missing =", "validate = [\"v.csv\"]\nmissing ="), "`validate` needs rows"),
    ] {
        let found = refused(&text);
        assert!(found.contains(expected) && found.contains("help: "), "{text}\n{found}");
    }
    let found = refused(&response("select = { method = \"ladder\", max_order = 2, confidence = 99.0 }"));
    assert!(found.contains("criterion = \"aicc\""), "{found}");
}

#[test]
fn bad_parts_are_refused() {
    let (csv, text) = (table(), head(BOTH));
    let shards = shards(&csv, 2, true);
    let of = |text: &str, shard: usize| parts(text, &shards[shard..=shard]).remove(0);
    let written = of(&text, 0).write();
    let read = |text: String| Part::read(&Source::new("one.rsm", text)).unwrap_err().to_string();
    // Cut anywhere, up to the last line.
    let step = written.len() / 60;
    for end in (0..written.len() - 1).step_by(step).chain([written.len() - 2]) {
        let found = read(written[..end].to_string());
        assert!(found.starts_with("one.rsm") && found.contains("is not"), "{end}: {found}");
    }
    let changed = written.replacen("rows = 150", "rows = 151", 1);
    assert!(read(changed).contains("was changed: its text does not have the hash at its end"));
    assert!(read(written.replacen("format = 1", "format = 2", 1)).contains("found 2, this version reads format 1"));
    assert!(read("format = 1\nmodel = \"m\"\n".to_string()).contains("is not a part of a fit"));
    // A changed text with a new hash is refused for what it contains, without a panic.
    let rehashed = |from: &str, to: &str| {
        let (body, _) = written.split_once("\n[end]\n").unwrap();
        assert!(body.contains(from), "{from}");
        let body = body.replacen(from, to, 1);
        let hash = rsm_fit::records::hash(&body);
        read(format!("{body}\n[end]\nsha256 = \"{hash}\"\n"))
    };
    assert!(rehashed("height = 7", "height = 700").contains("columns of at most 7"));
    assert!(rehashed("[sums.z]", "[sums.zz]").contains("`z` is missing"));
    assert!(rehashed("\nunit = \"cm\"", "\nunits = \"cm\"").contains("`unit` is missing"));
    assert!(rehashed("order = 2", "order = 3").contains("expected 11 columns"));
    assert!(rehashed("columns = [\n  [", "columns = [\n  [1.0, ").contains("found a column of"));
    // Twice the same rows.
    let found = merge(vec![of(&text, 0), of(&text, 1), of(&text, 0)]).unwrap_err().to_string();
    assert!(found.contains("shard-0.rsm: is the same part as shard-0.rsm"), "{found}");
    let specification = specification(&text, Path::new(""));
    let both = of_sources(&specification, &shards).unwrap();
    let found = merge(vec![of(&text, 0), both]).unwrap_err().to_string();
    assert!(found.contains("its data file `shard-0.csv` is in shard-0.rsm too"), "{found}");
    // Another specification, other units.
    let found = merge(vec![of(&text, 0), of(&text.replace("order = 2", "order = 3"), 1)]).unwrap_err().to_string();
    assert!(found.contains("line 15 is `select = { method = \"fixed\", order = 3 }`, there it is"), "{found}");
    let open = text.replace("unit = \"N\"\n", "");
    let other = Source::new("shard-1.csv", shards[1].text().replace("z[N]", "z[kN]"));
    let found = merge(vec![of(&open, 0), parts(&open, &[other]).remove(0)]).unwrap_err().to_string();
    assert!(found.contains("response `z` is in `kN`, in shard-0.rsm it is in `N`"), "{found}");
    assert!(found.contains("give `unit` under [responses.z]"), "{found}");
}
