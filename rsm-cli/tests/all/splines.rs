//! Splines through every command that reads a model file: each works with them or refuses them with a sentence.

use std::fmt::Write as _;

use crate::calls::{folder, json, rsm, text};

const SPEC: &str = "format = 1\nmodel = \"bench\"\ndata = [\"map.csv\"]\n[inputs.speed]\nunit = \"rad/s\"\nrange = [0.0, 100.0]\n\
    [inputs.load]\nunit = \"N*m\"\nrange = [0.0, 1.0]\n[responses.losses]\nunit = \"W\"\ninputs = [\"speed\", \"load\"]\n";

/// Losses with a bend over the load, on a grid, with a pattern of +-0.02 W.
fn map() -> String {
    let mut csv = String::from("speed[rad/s],load[N*m],losses[W]\n");
    for k in 0..400 {
        let (speed, load) = (f64::from(k % 20) * 100.0 / 19.0, f64::from(k / 20) / 19.0);
        let noise = [0.02, -0.02, -0.02, 0.02, 0.02, -0.02, 0.02][k as usize % 7];
        writeln!(csv, "{speed},{load},{}", 2.0 + 0.05 * speed + 6.0 * (5.0 * load).tanh() + noise).unwrap();
    }
    csv
}

#[test]
fn every_command_works_with_a_spline_or_refuses_it() {
    let here = folder();
    let write = |name: &str, text: &str| std::fs::write(here.path().join(name), text).unwrap();
    write("map.csv", &map());
    write("fit.toml", &format!("{SPEC}select = {{ method = \"fixed\" }}\nspline = {{ degree = 3, cells = [2, 6] }}\n"));
    let run = |words: &[&str]| rsm(words, here.path());
    let fitted = run(&["fit", "fit.toml", "--out", "bench.toml", "--report", "page", "--json"]);
    assert_eq!(fitted.status.code(), Some(0), "{}", text(&fitted.stderr));
    let found = json(&fitted);
    let losses = &found["responses"]["losses"];
    assert_eq!(losses["spline"]["cells"], serde_json::json!([2, 6]));
    assert_eq!((losses["spline"]["coefficients"].as_u64(), losses["terms"].as_array().map(Vec::len)), (Some(45), Some(0)));
    assert!(losses["cross_validation"]["rmse"].as_f64().unwrap() < 0.1, "{losses}");
    let model = std::fs::read_to_string(here.path().join("bench.toml")).unwrap();
    assert!(
        model.contains("spline = { degree = 3, cells = [2, 6], coefficients = [") && !model.contains("terms = ["),
        "{model}"
    );
    let page = std::fs::read_to_string(here.path().join("page/report.html")).unwrap();
    // The numbers of its tables are compressed; `pages.rs` evaluates them in a browser.
    assert!(page.contains("<h3>Spline</h3>") && page.contains("data-packed"));
    let words = run(&["fit", "fit.toml", "--out", "again.toml"]);
    assert!(
        text(&words.stdout).contains("tensor product of cubic splines, 2 x 6 cells, 45 coefficients"),
        "{}",
        text(&words.stdout)
    );

    let checked = json(&run(&["check", "bench.toml", "--json"]));
    let of_losses = &checked["surfaces"]["losses"];
    assert!(
        of_losses["error"]["f64"].as_f64().unwrap() < 1e-12 && of_losses["error"]["f32"].as_f64().unwrap() < 1e-3,
        "{checked}"
    );
    assert_eq!(of_losses["operations"]["f64"], 99);
    let at = run(&["eval", "bench.toml", "--at", "speed=40,load=0.5"]);
    assert_eq!(at.status.code(), Some(0), "{}", text(&at.stderr));
    let emitted = run(&["emit", "bench.toml", "--lang", "c", "--out", "code", "--gradient", "--inside"]);
    assert_eq!(emitted.status.code(), Some(0), "{}", text(&emitted.stderr));
    write(
        "goals.toml",
        "format = 1\nstudy = \"s\"\nseed = 1\nstarts = 8\n[responses.losses]\ngoal = \"minimise\"\nlow = 2\nhigh = 13\n",
    );
    let optimised = run(&["optimise", "bench.toml", "--goals", "goals.toml", "--json"]);
    assert_eq!(optimised.status.code(), Some(0), "{}", text(&optimised.stderr));
    let settings = &json(&optimised)["settings"];
    assert!(settings["speed"].as_f64().unwrap() < 1.0 && settings["load"].as_f64().unwrap() < 0.01, "{settings}");

    let factors =
        "[factors.speed]\nunit = \"rad/s\"\nrange = [0.0, 100.0]\n[factors.load]\nunit = \"N*m\"\nrange = [0.0, 1.0]\n";
    let design = "format = 1\nplan = \"p\"\ndesign = \"optimal\"\nruns = 12\nterms_of = { file = \"bench.toml\" }\nseed = 1\n";
    write("design.toml", &format!("{design}{factors}"));
    let refusals: [(&[&str], &str); 5] = [
        (&["emit", "bench.toml", "--lang", "c", "--out", "code", "--recursive"], "it is a spline"),
        (&["track", "bench.toml", "--data", "map.csv", "--out", "now.toml"], "it is a spline"),
        (&["diagnose", "bench.toml", "--data", "map.csv"], "is a spline; only surfaces with terms can be diagnosed"),
        (&["fit", "fit.toml", "--partial", "part.rsm", "--data", "map.csv"], "the penalty of a spline is chosen on rows"),
        (&["design", "design.toml", "--out", "runs.csv"], "the surface is a spline"),
    ];
    for (words, wanted) in refusals {
        let output = run(words);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {}{}", text(&output.stdout), text(&output.stderr));
        assert!(text(&output.stderr).contains(wanted), "{words:?}: {}", text(&output.stderr));
    }
}

#[test]
fn the_output_says_which_form_was_chosen_and_why() {
    let here = folder();
    std::fs::write(here.path().join("map.csv"), map()).unwrap();
    let spec = format!("{SPEC}select = {{ method = \"stepwise\", max_order = 2 }}\nforms = [\"polynomial\", \"spline\"]\n");
    std::fs::write(here.path().join("fit.toml"), spec).unwrap();
    let output = rsm(&["fit", "fit.toml", "--out", "bench.toml", "--json"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("form: a spline: on rows left out in 5 parts in turn"), "{}", text(&output.stderr));
    let forms = &json(&output)["responses"]["losses"]["forms"];
    assert_eq!((forms["chosen"].as_str(), forms["tried"].as_array().map(Vec::len)), (Some("spline"), Some(2)));
    assert_eq!(forms["tried"][1]["cells"].as_array().map(Vec::len), Some(2));
}
