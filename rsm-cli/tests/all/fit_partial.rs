//! `rsm fit --partial` and `rsm merge`: the model of all shards in any order, whole files or none, and the example with Dask.

use std::path::Path;
use std::process::Command;

use crate::calls::{folder, json, rsm, text};
use crate::shell::{blocks, of_the_project, read};
use crate::sweep::{cluster, dask};

const SPECIFICATION: &str = "format = 1\nmodel = \"m\"\ndata = [\"0.csv\", \"1.csv\", \"2.csv\"]\n[inputs.x]\nunit = \"m\"\nrange = [0.0, 30.0]\n\
    [responses.y]\nunit = \"N\"\ninputs = [\"x\"]\nselect = { method = \"fixed\", order = 2 }\n";

/// A folder with a specification and three shards of 20 rows.
fn shards() -> tempfile::TempDir {
    let here = folder();
    for shard in 0..3 {
        let row = |k: usize| {
            let x = (20 * shard + k) as f64 * 0.5;
            format!("{x},{}\n", 3.0 + 0.7 * x - 0.01 * x * x + 0.1 * ((7 * (20 * shard + k)) % 11) as f64)
        };
        let csv = format!("x[m],y[N]\n{}", (0..20).map(row).collect::<String>());
        std::fs::write(here.path().join(format!("{shard}.csv")), csv).unwrap();
    }
    std::fs::write(here.path().join("fit.toml"), SPECIFICATION).unwrap();
    here
}

fn ok(arguments: &[&str], here: &Path) -> String {
    let output = rsm(arguments, here);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

fn refused(arguments: &[&str], here: &Path) -> String {
    let output = rsm(arguments, here);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stderr)
}

fn parts(here: &Path) {
    for shard in 0..3 {
        let (csv, part) = (format!("{shard}.csv"), format!("{shard}.rsm"));
        let said = ok(&["fit", "fit.toml", "--partial", &part, "--data", &csv], here);
        assert_eq!(said, format!("written: {part}, the sums of 20 rows of 1 file\n"));
    }
}

fn model(here: &Path, name: &str) -> String {
    std::fs::read_to_string(here.join(name)).unwrap()
}

/// The lines of the terms of a model.
fn terms(model: &str) -> Vec<&str> {
    model.lines().filter(|line| line.contains("coefficient =")).collect()
}

#[test]
fn a_merge_writes_the_model_of_one_fit_in_any_order() {
    let here = shards();
    let here = here.path();
    parts(here);
    let said = ok(&["merge", "2.rsm", "0.rsm", "1.rsm", "--out", "a.toml"], here);
    for words in [
        "3 terms from 60 rows",
        "60 rows in 3 parts",
        "differ by at most",
        "3 parts; they hold no rows",
        "press",
        "written: a.toml",
    ] {
        assert!(said.contains(words), "{words}\n{said}");
    }
    ok(&["merge", "0.rsm", "1.rsm", "2.rsm", "--out", "b.toml"], here);
    assert_eq!(model(here, "a.toml"), model(here, "b.toml"));
    ok(&["fit", "fit.toml", "--out", "single.toml"], here);
    let (merged, single) = (model(here, "a.toml"), model(here, "single.toml"));
    // The bound is two roundings; here both fits give the same bits.
    assert_eq!((terms(&merged).len(), terms(&merged)), (3, terms(&single)));
    assert!(merged.contains("parts = 3\n") && merged.contains("file = \"2.csv\"") && !merged.contains("press"), "{merged}");
    ok(&["check", "a.toml"], here);
    // All files of the specification in one part; and JSON of both commands.
    let part = json(&rsm(&["fit", "fit.toml", "--partial", "all.rsm", "--json"], here));
    assert_eq!((&part["rows"], &part["data"][2]["file"]), (&60.into(), &"2.csv".into()));
    let object = json(&rsm(&["merge", "all.rsm", "--json"], here));
    let whole = json(&rsm(&["fit", "fit.toml", "--json"], here));
    for key in ["coefficient", "standard_error"] {
        assert_eq!(object["responses"]["y"]["terms"][1][key], whole["responses"]["y"]["terms"][1][key]);
    }
    assert_eq!(object["responses"]["y"]["press"], serde_json::Value::Null);
    assert_eq!((&object["merged"]["parts"], &object["merged"]["needs_rows"][1]), (&1.into(), &"press".into()));
    assert_eq!(object["merged"]["largest_difference"]["y"].as_array().unwrap().len(), 3);
    // A merge in two steps; a shard that is compressed.
    let said = ok(&["merge", "1.rsm", "0.rsm", "--partial", "01.rsm"], here);
    assert_eq!(said, "written: 01.rsm, the sums of 40 rows of 2 files\n");
    ok(&["merge", "2.rsm", "01.rsm", "--out", "steps.toml"], here);
    assert_eq!(terms(&model(here, "steps.toml")), terms(&single));
    let packed = Command::new("gzip").args(["-k", "2.csv"]).current_dir(here).status();
    if packed.is_ok_and(|status| status.success()) {
        ok(&["fit", "fit.toml", "--partial", "2.rsm", "--data", "2.csv.gz"], here);
        ok(&["merge", "0.rsm", "1.rsm", "2.rsm", "--out", "packed.toml"], here);
        assert_eq!(terms(&model(here, "packed.toml")), terms(&single));
    } else {
        eprintln!("SKIPPED: no gzip, so no compressed shard was read");
        ok(&["fit", "fit.toml", "--partial", "2.rsm", "--data", "2.csv"], here);
    }
    // A part replaces a part, and nothing else.
    ok(&["fit", "fit.toml", "--partial", "0.rsm", "--data", "1.csv"], here);
    let said = refused(&["fit", "fit.toml", "--partial", "a.toml"], here);
    assert!(said.contains("not an rsm output of this kind"), "{said}");
}

#[test]
fn bad_parts_end_with_status_2_and_nothing_written() {
    let here = shards();
    let here = here.path();
    parts(here);
    let write = |name: &str, text: &str| std::fs::write(here.join(name), text).unwrap();
    let one = model(here, "1.rsm");
    write("cut.rsm", &one[..one.len() / 2]);
    write("newer.rsm", &one.replacen("format = 1", "format = 2", 1));
    write("twin.rsm", &one);
    write("other.toml", &SPECIFICATION.replace("order = 2", "order = 1"));
    ok(&["fit", "other.toml", "--partial", "other.rsm", "--data", "2.csv"], here);
    for (part, words) in [
        ("cut.rsm", "cut.rsm: is not whole: the hash at its end is missing"),
        ("newer.rsm", "newer.rsm:2:1: `format`: found 2, this version reads format 1"),
        ("twin.rsm", "twin.rsm: is the same part as 1.rsm"),
        (
            "other.rsm",
            "other.rsm: has another specification than 0.rsm: line 10 is `select = { method = \"fixed\", order = 1 }`",
        ),
        ("fit.toml", "fit.toml: is not a part of a fit"),
        ("none.rsm", "none.rsm: cannot be read"),
    ] {
        let said = refused(&["merge", "0.rsm", "1.rsm", part, "--out", "model.toml"], here);
        assert!(said.contains(words), "{words}\n{said}");
        assert!(!here.join("model.toml").exists(), "{part}");
    }
    // The faults of all files come together.
    let said = refused(&["merge", "cut.rsm", "newer.rsm"], here);
    assert!(said.contains("cut.rsm") && said.contains("newer.rsm"), "{said}");
    write("ladder.toml", &SPECIFICATION.replace("\"fixed\", order = 2", "\"ladder\", max_order = 2, confidence = 99.0"));
    let said = refused(&["fit", "ladder.toml", "--partial", "ladder.rsm"], here);
    assert!(said.contains("a ladder evaluates its terms on rows") && said.contains("criterion = \"aicc\""), "{said}");
    assert!(!here.join("ladder.rsm").exists());
    // Parts of one shard that is too small for the terms.
    write("few.csv", "x[m],y[N]\n1,2\n");
    ok(&["fit", "fit.toml", "--partial", "few.rsm", "--data", "few.csv"], here);
    let said = refused(&["merge", "few.rsm"], here);
    assert!(said.contains("found 1 rows to fit, expected at least 3"), "{said}");
}

#[test]
fn the_example_with_dask_gives_the_model_of_a_local_merge() {
    let Some(path) = dask("the example of shards on a cluster") else { return };
    let here = shards();
    let here = here.path();
    parts(here);
    ok(&["merge", "0.rsm", "1.rsm", "2.rsm", "--out", "local.toml"], here);
    let cluster = cluster(&path, here, 2);
    // The last block of the guide, with the names of this test.
    let guide = blocks(&read("docs/book/src/guides/fit.md"));
    let shown = guide.iter().rev().find(|block| block.language == "sh").unwrap().text.clone();
    let script = of_the_project("examples/shards/fit_on_dask.py").canonicalize().unwrap().display().to_string();
    let command = shown.trim().replace("PROJECT/examples/shards/fit_on_dask.py", &script);
    let command = command.replace("HOST:8786", &cluster.address);
    let command = command.replace("shards.toml motor.toml monday.csv tuesday.csv", "fit.toml dask.toml 2.csv 0.csv 1.csv");
    assert!(command.contains("dask.toml 2.csv"), "{command}");
    let mut shell = Command::new("sh");
    shell.args(["-c", &command]).env("PYTHONPATH", &path).env("RSM", env!("CARGO_BIN_EXE_rsm")).current_dir(here);
    let output = shell.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
    assert_eq!(model(here, "dask.toml"), model(here, "local.toml"));
}
