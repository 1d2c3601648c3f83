//! A transform of a response through every command that reads a model file: each works with it or refuses it with a sentence.

use std::fmt::Write as _;

use crate::calls::{folder, json, rsm, text};

const SPEC: &str = "format = 1\nmodel = \"oil\"\ndata = [\"oil.csv\"]\n[inputs.temperature]\nunit = \"degC\"\nrange = [20.0, 100.0]\n\
    [inputs.pressure]\nunit = \"bar\"\nrange = [0.0, 2000.0]\n[responses.eta]\nunit = \"mPa*s\"\ninputs = [\"temperature\", \"pressure\"]\n\
    select = { method = \"fixed\", order = 3 }\ntransform = \"log\"\n";

/// The viscosity of an oil by Vogel's equation, with a pattern of +-1 %; `factor` from row `from` on.
fn oil(factor: f64, from: usize) -> String {
    let mut csv = String::from("temperature[degC],pressure[bar],eta[mPa*s]\n");
    for k in 0..120 {
        let (t, p) = (20.0 + ((37 * k) % 81) as f64, 20.0 * ((11 * k) % 101) as f64);
        let eta = 0.05 * (1000.0 / (t + 90.0) + 0.0012 * p).exp() * (1.0 + 0.01 * (((7 * k) % 5) as f64 - 2.0) / 2.0);
        writeln!(csv, "{t},{p},{}", eta * if k < from { 1.0 } else { factor }).unwrap();
    }
    csv
}

#[test]
fn every_command_works_with_a_transform_or_refuses_it() {
    let here = folder();
    let write = |name: &str, text: &str| std::fs::write(here.path().join(name), text).unwrap();
    let run = |words: &[&str]| rsm(words, here.path());
    let good = |words: &[&str]| {
        let output = run(words);
        assert_eq!(output.status.code(), Some(0), "{words:?}: {}", text(&output.stderr));
        output
    };
    write("oil.csv", &oil(1.0, 0));
    write("fit.toml", SPEC);
    let found = json(&good(&["fit", "fit.toml", "--out", "oil.toml", "--report", "page", "--json"]));
    let eta = &found["responses"]["eta"];
    assert_eq!((eta["transform"]["transform"].as_str(), eta["transform"]["lambda"].as_f64()), (Some("log"), Some(0.0)));
    // The residual is that of the logarithm, a share; the errors of rows are in mPa s.
    let (sd, rmse) = (eta["residual_sd"].as_f64().unwrap(), eta["transform"]["fitted"]["rmse"].as_f64().unwrap());
    assert!((0.005..0.012).contains(&sd) && (0.5..20.0).contains(&rmse), "{eta}");
    assert!(eta["cross_validation"]["rmse"].as_f64().unwrap() > 0.5, "{eta}");
    let page = std::fs::read_to_string(here.path().join("page/report.html")).unwrap();
    assert!(page.contains("transform of the response") && page.contains("fitted rows, in the unit of the response"));

    let checked = json(&good(&["check", "oil.toml", "--json"]));
    let of_eta = &checked["surfaces"]["eta"];
    assert!(of_eta["range"][0].as_f64().unwrap() > 5.0 && of_eta["range"][1].as_f64().unwrap() < 1e4, "{checked}");
    assert!(of_eta["error"]["f64"].as_f64().unwrap() < 1e-9 && of_eta["error"]["f32"].as_f64().unwrap() < 1.0, "{checked}");
    let at = json(&good(&["eval", "oil.toml", "--at", "temperature=60,pressure=1000", "--json"]));
    let value = at["values"][0].as_f64().unwrap();
    let truth = 0.05 * (1000.0f64 / 150.0 + 1.2).exp();
    assert!((value / truth - 1.0).abs() < 0.01, "{at} {truth}");
    good(&["emit", "oil.toml", "--lang", "c", "--out", "code", "--gradient", "--inside"]);
    write(
        "goals.toml",
        "format = 1\nstudy = \"s\"\nseed = 1\nstarts = 8\n[responses.eta]\ngoal = \"minimise\"\nlow = 5\nhigh = 5000\n",
    );
    let settings = &json(&good(&["optimise", "oil.toml", "--goals", "goals.toml", "--json"]))["settings"];
    assert!(settings["temperature"].as_f64().unwrap() > 99.0 && settings["pressure"].as_f64().unwrap() < 20.0, "{settings}");

    // Parts: the differences of coefficients are in the unit of the terms.
    let (header, rows) = oil(1.0, 0).split_once('\n').map(|(header, rows)| (header.to_string(), rows.to_string())).unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    for (name, rows) in [("one.csv", &rows[..50]), ("two.csv", &rows[50..])] {
        write(name, &format!("{header}\n{}\n", rows.join("\n")));
        good(&["fit", "fit.toml", "--partial", &name.replace("csv", "rsm"), "--data", name]);
    }
    let merged = good(&["merge", "one.rsm", "two.rsm", "--out", "merged.toml"]);
    assert!(text(&merged.stdout).contains(" log(mPa*s)\n"), "{}", text(&merged.stdout));
    let terms = |name: &str| -> Vec<f64> {
        let model = std::fs::read_to_string(here.path().join(name)).unwrap();
        let numbers = model.lines().filter_map(|line| line.trim().strip_prefix("{ powers = ")?.split("coefficient = ").nth(1));
        numbers.map(|number| number.split(' ').next().unwrap().parse().unwrap()).collect()
    };
    assert!(
        terms("oil.toml").len() == 10 && terms("oil.toml").iter().zip(terms("merged.toml")).all(|(a, b)| (a - b).abs() < 1e-12)
    );

    // A factor of 1.1 from row 61 on is a step of the logarithm.
    write("new.csv", &oil(1.1, 60));
    let diagnosed = good(&["diagnose", "oil.toml", "--data", "new.csv", "--out", "diagnosis", "--json"]);
    let causes = json(&diagnosed)["causes"].clone();
    assert_eq!((causes[0]["kind"].as_str(), causes.as_array().map(Vec::len)), (Some("drift"), Some(1)), "{causes}");
    assert!(text(&diagnosed.stderr).contains("From run 61 on, eta is higher by 0.095"), "{}", text(&diagnosed.stderr));
    assert!(
        std::fs::read_to_string(here.path().join("diagnosis/report.html"))
            .unwrap()
            .contains("measured minus computed [log(mPa*s)]")
    );

    let refusals: [(&[&str], &str); 2] = [
        (&["emit", "oil.toml", "--lang", "c", "--out", "code", "--recursive"], "after the transform \"log\""),
        (&["track", "oil.toml", "--data", "oil.csv", "--out", "now.toml"], "after the transform \"log\""),
    ];
    for (words, wanted) in refusals {
        let output = run(words);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {}{}", text(&output.stdout), text(&output.stderr));
        assert!(text(&output.stderr).contains(wanted), "{words:?}: {}", text(&output.stderr));
    }
}
