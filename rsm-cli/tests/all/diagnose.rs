//! `rsm diagnose` as a command: refused input, and the keys of the results.

use super::calls::{folder, json, keys, rsm, text};

fn shipped(name: &str) -> String {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants").join(name).display().to_string()
}

#[test]
fn a_diagnosis_without_a_record_or_of_a_surface_is_refused() {
    let here = folder();
    let plant = shipped("pmac.toml");
    let record = shipped("pmac.csv");
    let without = rsm(&["diagnose", &plant], here.path());
    assert_eq!((without.status.code(), without.stdout.len()), (Some(2), 0));
    assert!(text(&without.stderr).contains("--record: found none"));
    let surface = rsm(&["diagnose", &plant, "--data", &record], here.path());
    assert_eq!(surface.status.code(), Some(2));
    assert!(text(&surface.stderr).contains("is a plant file, whose records are given with --record"));
}

/// A plant that exists only as a text: the cause names its place, and the written folder can be used without other files.
#[test]
fn a_plant_of_equations_is_diagnosed_and_its_extended_file_runs() {
    let here = folder();
    let example = |name: &str| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/plants/road-vehicle").join(name);
        path.display().to_string()
    };
    let (plant, record, validation) = (example("plant.toml"), example("record.csv"), example("validation.csv"));
    let arguments = ["diagnose", &plant, "--record", &record, "--validate", &validation, "--json", "--out", "found"];
    let output = rsm(&arguments, here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found = json(&output);
    let cause = &found["causes"][0];
    assert_eq!((&found["verdict"], &cause["kind"], &cause["at"]), (&"explained".into(), &"headwind".into(), &"car".into()));
    let page = std::fs::read_to_string(here.path().join("found/report.html")).unwrap();
    assert!(page.contains("headwind"), "{page}");
    let simulated = rsm(&["simulate", "found/extended.toml", "--record", &validation, "--out", "simulated.csv"], here.path());
    assert_eq!(simulated.status.code(), Some(0), "{}", text(&simulated.stderr));
    for (arguments, message) in [
        (vec!["diagnose", &plant, "--record", &record, "--refit", "--out", "refitted"], "no experiment is designed"),
        (vec!["diagnose", &example("road-vehicle.mo"), "--record", &record], "expected a plant file that names it"),
        (vec!["diagnose", &plant, "--record", &record, "--effects", "nowhere"], "nowhere: cannot be read"),
        (
            vec!["diagnose", &shipped("pmac.toml"), "--record", &record, "--effects", "nowhere"],
            "--effects: found a plant file of format 1",
        ),
    ] {
        let refused = rsm(&arguments, here.path());
        assert_eq!((refused.status.code(), refused.stdout.len()), (Some(2), 0), "{arguments:?}");
        assert!(text(&refused.stderr).contains(message), "{}", text(&refused.stderr));
    }
    assert!(!here.path().join("refitted").exists());
}

/// The result of a diagnosis is diagnosed again: nothing remains to be found, and a claim that later records contradict is reported.
#[test]
fn an_extended_plant_is_monitored() {
    let here = folder();
    let with = |torque: f64| {
        std::fs::read_to_string(shipped("pmac.toml")).unwrap()
            + &format!("\n[[effects]]\nkind = \"coulomb-friction\"\nparameters = {{ torque = {torque} }}\n")
    };
    let write = |name: &str, text: String| std::fs::write(here.path().join(name), text).unwrap();
    write("true.toml", with(0.3));
    write("worn.toml", with(0.5));
    for (plant, name, seed) in [
        ("true.toml", "train.csv", 1),
        ("true.toml", "unseen.csv", 2),
        ("worn.toml", "worn.csv", 3),
        ("worn.toml", "worn-2.csv", 4),
    ] {
        let record = noisy(here.path(), plant, seed);
        write(name, record);
    }
    let diagnosed = |plant: &str, train: &str, unseen: &str, out: &str| {
        let output = rsm(&["diagnose", plant, "--record", train, "--validate", unseen, "--json", "--out", out], here.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        (json(&output), text(&output.stderr))
    };
    let (first, _) = diagnosed(&shipped("pmac.toml"), "train.csv", "unseen.csv", "found");
    assert_eq!((&first["verdict"], &first["causes"][0]["kind"]), (&"explained".into(), &"coulomb-friction".into()));
    assert_eq!(first["claims"], serde_json::json!([]));
    let (again, message) = diagnosed("found/extended.toml", "train.csv", "unseen.csv", "again");
    assert_eq!((&again["verdict"], again["causes"].as_array().unwrap().len()), (&"no-discrepancy".into(), 0), "{message}");
    assert_eq!((&again["claims"][0]["kind"], &again["claims"][0]["stands"]), (&"coulomb-friction".into(), &true.into()));
    assert!(message.contains("The plant file's coulomb-friction agrees with the records"), "{message}");
    let page = std::fs::read_to_string(here.path().join("again/report.html")).unwrap();
    assert!(page.contains("Effects of the plant file") && page.contains("coulomb-friction agrees with the records"), "{page}");
    // Since then the bearing has worn.
    let (worn, message) = diagnosed("found/extended.toml", "worn.csv", "worn-2.csv", "worn");
    assert_eq!(worn["verdict"], "explained", "{message}");
    let cause = &worn["causes"][0];
    assert_eq!(cause["kind"], "coulomb-friction");
    // Either the whole friction instead of the claim, or only the additional friction.
    let torque = cause["parameters"]["torque"]["value"].as_f64().unwrap();
    assert!((torque - 0.5).abs() < 0.05 || (torque - 0.2).abs() < 0.05, "{torque}");
    let run = rsm(&["simulate", "worn/extended.toml", "--record", "worn.csv", "--out", "simulated.csv"], here.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
}

/// A record without current: the plant that a diagnosis of it writes is simulated along the record.
#[test]
fn an_extended_plant_runs_on_the_record_that_it_came_from() {
    let here = folder();
    let record = noisy(here.path(), &shipped("pmac.toml"), 5);
    let mut without = String::new();
    for line in record.lines() {
        let cells: Vec<&str> = line.split(',').collect();
        without += &format!("{}\n", [&cells[..4], &cells[6..]].concat().join(","));
    }
    std::fs::write(here.path().join("speed.csv"), without).unwrap();
    let output = rsm(&["diagnose", &shipped("pmac.toml"), "--record", "speed.csv", "--out", "found"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let run = rsm(&["simulate", "found/extended.toml", "--record", "speed.csv", "--out", "simulated.csv"], here.path());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
}

#[test]
fn a_diagnosis_writes_its_json_the_extended_plant_and_a_report() {
    let here = folder();
    // The simulation of the shipped plant along its shipped record, with noise: there is no fault.
    std::fs::write(here.path().join("noisy.csv"), noisy(here.path(), &shipped("pmac.toml"), 1)).unwrap();
    let output = rsm(&["diagnose", &shipped("pmac.toml"), "--record", "noisy.csv", "--json", "--out", "found"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let value = json(&output);
    for key in ["verdict", "causes", "nominal", "extended", "gain", "where"] {
        assert!(keys(&value).contains(&key), "{key}");
    }
    assert_eq!(value["verdict"], "no-discrepancy");
    assert_eq!(value["causes"].as_array().unwrap().len(), 0);
    let written = std::fs::read_to_string(here.path().join("found/diagnosis.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&written).unwrap(), value);
    let page = std::fs::read_to_string(here.path().join("found/report.html")).unwrap();
    assert!(page.contains("These records show no error of the simulation"), "{page}");
    // The verdict contains the value of the worst output. Without unseen records the page reports this. There are no causes and no locations of
    // errors.
    let ratio = |key: &str| value["extended"]["validate"][key]["noise_ratio"].as_f64().unwrap();
    let worst = ["i_d", "i_q", "speed"].map(ratio).into_iter().fold(0.0, f64::max);
    assert!(
        page.contains(&format!("is {worst:.2} times its noise")) && page.contains("There is no validation record"),
        "{worst}"
    );
    assert!(!page.contains("<h2>Causes") && page.contains("In every region that was examined"));
    assert_eq!((&value["where"], &value["left"]), (&serde_json::json!([]), &serde_json::json!([])));
    assert!(value["correction"].is_null() && !here.path().join("found/correction.toml").exists());
    let again = rsm(&["simulate", "found/extended.toml", "--record", "noisy.csv", "--out", "again.csv"], here.path());
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
}

/// A tank that an unknown outflow empties: the level where it is largest is in no file. The diagnosis does not name a cause, and gives the law.
#[test]
fn a_law_that_is_in_no_textbook_has_a_curve_a_model_and_an_extended_plant_that_runs() {
    let here = folder();
    let examples = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/plants/coupled-tanks");
    std::fs::copy(examples.join("coupled-tanks.mo"), here.path().join("coupled-tanks.mo")).unwrap();
    let plant = std::fs::read_to_string(examples.join("plant.toml")).unwrap();
    let write = |name: &str, text: String| std::fs::write(here.path().join(name), text).unwrap();
    write("plant.toml", plant.clone());
    // The outflow is Q u/(1 + u^4) at u = level/0.3 m.
    write(
        "siphon.toml",
        "format = 1\nkind = \"siphon\"\nsites = [\"storage\"]\nsource = \"none\"\n[numbers]\nflow = { unit = \"m3/s\", guess = [\"0.1*effort_scale\"] }\n\
         [helpers]\nknee = { value = 0.3, unit = \"m\" }\n[changes]\nflow = \"-flow*(level/knee)/(1 + (level/knee)^4)\"\n\
         [words]\nsentence = \"A siphon.\"\ncheck = \"Look.\"\n"
            .replace("flow = \"-flow*", "flow = \"-rate*")
            .replace("flow = { unit", "rate = { unit"),
    );
    let own = "model = \"coupled-tanks.mo\"\neffect_files = [\"siphon.toml\"]";
    let hidden = "\n[[effects]]\nkind = \"siphon\"\nat = \"first_tank\"\nparameters = { rate = 4e-5 }\n";
    write("truth.toml", plant.replace("model = \"coupled-tanks.mo\"", own) + hidden);
    for (name, seed) in [("record", 1), ("validation", 2)] {
        let inputs = examples.join(format!("{name}.csv")).display().to_string();
        let record = noisy_record(here.path(), "truth.toml", &inputs, &[0.0, 0.0, 0.001, 0.001], seed);
        write(&format!("{name}.csv"), record);
    }
    let arguments =
        ["diagnose", "plant.toml", "--record", "record.csv", "--validate", "validation.csv", "--json", "--out", "found"];
    let output = rsm(&arguments, here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let found = json(&output);
    let law = &found["law"];
    assert_eq!(
        (&found["verdict"], &law["at"], &law["model"]),
        (&"unexplained".into(), &"first_tank".into(), &"law.toml".into()),
        "{found:#}"
    );
    assert!(law["gain"].as_f64().unwrap() > 0.95, "{law:#}");
    assert!(text(&output.stderr).contains("an unknown flow acts"), "{}", text(&output.stderr));
    // 95 % bands, and points that are not independent: most of them hold the truth.
    let points = law["curves"][0]["points"].as_array().unwrap();
    let is_inside = |it: &&serde_json::Value| {
        let [level, low, high] = [0, 2, 3].map(|k| it[k].as_f64().unwrap());
        let u = level / 0.3;
        (low..=high).contains(&(-4e-5 * u / (1.0 + u.powi(4))))
    };
    assert!(points.iter().filter(is_inside).count() * 10 >= points.len() * 8, "{points:?}");
    let page = std::fs::read_to_string(here.path().join("found/report.html")).unwrap();
    assert!(page.contains("A law that is in no textbook") && page.contains("the law over level"));
    for arguments in [
        &["check", "found/law.toml"][..],
        &["emit", "found/law.toml", "--lang", "c", "--out", "c"],
        &["simulate", "found/extended.toml", "--record", "validation.csv", "--out", "simulated.csv"],
    ] {
        let output = rsm(arguments, here.path());
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    }
    // The plant with the law follows the record: 0.001 m is the noise.
    let column = |name: &str| -> Vec<f64> {
        let text = std::fs::read_to_string(here.path().join(name)).unwrap();
        text.lines().skip(1).map(|line| line.split(',').nth(2).unwrap().parse().unwrap()).collect()
    };
    let (simulated, measured) = (column("simulated.csv"), column("validation.csv"));
    let square: f64 = simulated.iter().zip(&measured).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / measured.len() as f64;
    assert!(square.sqrt() < 0.0015, "{}", square.sqrt());
    // A file of effects that is not there, and one that is no list.
    for (line, message) in
        [("effect_files = [\"nowhere.toml\"]", "nowhere.toml"), ("effect_files = 3", "expected a list of file names")]
    {
        write("wrong.toml", plant.replace("model = \"coupled-tanks.mo\"", &format!("model = \"coupled-tanks.mo\"\n{line}")));
        let refused = rsm(&["simulate", "wrong.toml", "--record", "record.csv", "--out", "no.csv"], here.path());
        assert_eq!(refused.status.code(), Some(2));
        assert!(text(&refused.stderr).contains(message), "{}", text(&refused.stderr));
    }
}

/// The shipped motor's record as simulated from a plant file, with noise.
fn noisy(here: &std::path::Path, plant: &str, seed: u64) -> String {
    noisy_record(here, plant, &shipped("pmac.csv"), &[0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.3], seed)
}

/// A record as simulated from a plant file, with noise of these standard deviations, one for each column, from a linear congruential generator.
fn noisy_record(here: &std::path::Path, plant: &str, record: &str, sds: &[f64], seed: u64) -> String {
    let simulated = rsm(&["simulate", plant, "--record", record, "--out", "clean.csv"], here);
    assert_eq!(simulated.status.code(), Some(0), "{}", text(&simulated.stderr));
    let clean = std::fs::read_to_string(here.join("clean.csv")).unwrap();
    let mut state = seed;
    let mut noise = || {
        // The sum of twelve uniform numbers minus six has a variance of one. Constants: D. E. Knuth's MMIX.
        (0..12)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    };
    let mut noisy = String::new();
    for (k, line) in clean.lines().enumerate() {
        if k == 0 {
            noisy += line;
        } else {
            let read = |(cell, sd): (&str, &f64)| match *sd {
                0.0 => cell.to_string(),
                sd => (cell.parse::<f64>().unwrap() + sd * noise()).to_string(),
            };
            noisy += &line.split(',').zip(sds).map(read).collect::<Vec<String>>().join(",");
        }
        noisy.push('\n');
    }
    noisy
}

#[test]
fn the_report_lists_bad_data_first_and_has_the_numbers_of_the_json_for_a_cause() {
    let here = folder();
    let with_friction = std::fs::read_to_string(shipped("pmac.toml")).unwrap()
        + "\n[[effects]]\nkind = \"coulomb-friction\"\nparameters = { torque = 0.3 }\n";
    std::fs::write(here.path().join("true.toml"), with_friction).unwrap();
    let train = noisy(here.path(), "true.toml", 1);
    // A spike of a hundred standard deviations in data row 78 (line 79, after the header).
    let spiked: Vec<String> = train
        .lines()
        .enumerate()
        .map(|(k, line)| {
            let (rest, speed) = line.rsplit_once(',').unwrap();
            if k == 78 { format!("{rest},{}", speed.parse::<f64>().unwrap() + 30.0) } else { line.to_string() }
        })
        .collect();
    std::fs::write(here.path().join("train.csv"), spiked.join("\n") + "\n").unwrap();
    std::fs::write(here.path().join("unseen.csv"), noisy(here.path(), "true.toml", 2)).unwrap();
    std::fs::write(here.path().join("test.csv"), noisy(here.path(), "true.toml", 3)).unwrap();
    let plant = shipped("pmac.toml");
    let output = rsm(
        &[
            "diagnose",
            &plant,
            "--record",
            "train.csv",
            "--validate",
            "unseen.csv",
            "--test",
            "test.csv",
            "--json",
            "--out",
            "found",
        ],
        here.path(),
    );
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let value = json(&output);
    assert_eq!((value["verdict"].as_str(), value["causes"][0]["kind"].as_str()), (Some("explained"), Some("coulomb-friction")));
    let page = std::fs::read_to_string(here.path().join("found/report.html")).unwrap();

    let at = |message: &str| page.find(message).unwrap_or_else(|| panic!("the page does not contain: {message}"));
    assert!(at("What is wrong with the data") < at("<td>speed</td><td>jump</td><td>78 to 78</td>"));
    assert!(at("78 to 78") < at("<h2>Causes") && at("<h2>Causes") < at("<h2>Before and after, on 1 validation record</h2>"));
    at(&format!(
        "On 1 validation record (on the records that chose it) {:.1} % of the error above the noise is removed",
        100.0 * value["gain"].as_f64().unwrap()
    ));
    // The records that chose the causes are named as such; the test record has separate figures beside the others.
    assert_eq!(value["judged_on"], "on the records that chose it");
    assert!(
        value["test"]["judged_on"].as_str().unwrap().contains("which nothing has seen before: their starts are estimated on")
    );
    assert!(value["test"]["gain"].as_f64().unwrap() > 0.9, "{}", value["test"]);
    for plant in ["nominal", "extended"] {
        assert_eq!(keys(&value[plant]), ["test", "validate"]);
        assert_eq!(keys(&value[plant]["test"]), keys(&value[plant]["validate"]));
    }
    at(&format!("On 1 test record, not used before, {:.1} % is removed", 100.0 * value["test"]["gain"].as_f64().unwrap()));
    // Both contain every sentence of the evidence, and the cause reduces the error of the speed.
    let evidence = &value["causes"][0]["evidence"];
    let sentences: Vec<&str> = evidence["for"].as_array().unwrap().iter().map(|it| it.as_str().unwrap()).collect();
    assert!(
        sentences.iter().any(|it| it.starts_with("On validation records it lowers the error") && it.contains("speed from "))
    );
    assert!(sentences.iter().any(|it| it.contains("torque = 0.")), "{sentences:?}");
    for sentence in sentences.iter().chain([&evidence["check"].as_str().unwrap()]) {
        at(&sentence.replace('&', "&amp;").replace('"', "&quot;"));
    }
    // The torque in the table of parameters has the digits that its interval supports: two digits of the half width.
    let torque = |key: &str| value["causes"][0]["parameters"]["torque"][key].as_f64().unwrap();
    let digits = 1 - (0.5 * (torque("high") - torque("low"))).log10().floor() as i32;
    assert!((3..7).contains(&digits), "{digits}");
    at(&format!(
        "<td>coulomb-friction</td><td>torque</td><td>N*m</td><td class=\"number\">absent</td><td class=\"number\">{:.*}</td>",
        digits as usize,
        torque("value")
    ));
    // The shares of outputs add up to one, and regions have units.
    let places = value["where"].as_array().unwrap();
    let whole: f64 = places.iter().filter(|it| it["of"] == "output").map(|it| it["share_of_error"].as_f64().unwrap()).sum();
    assert!((whole - 1.0).abs() < 1e-9, "{places:?}");
    assert!(places.iter().any(|it| it["region"].as_str().unwrap().contains("rad/s")), "{places:?}");
    for it in places {
        at(&format!("<td>{}</td><td>{}</td>", it["output"].as_str().unwrap(), it["region"].as_str().unwrap()));
    }
    // Curves: the whole record, the worst section, the remaining error over time and by frequency, for three outputs.
    assert!(page.matches("<svg").count() >= 12);
    // Nothing is loaded: no source is named, and the page's own policy forbids it.
    assert!(!page.contains("src=") && !page.contains("<link") && !page.contains("url(") && page.contains("default-src 'none'"));
    // The summary comes first, and a switch removes the cause.
    assert!(at("<h1>") < at("class=\"numbers\"") && at("class=\"numbers\"") < at(">coulomb-friction</button>"));
    assert!(at(">coulomb-friction</button>") < at("<h2>"));
    // The text on standard error is short.
    let message = text(&output.stderr);
    assert!(message.lines().count() < 12 && message.contains("Check: Drive slowly both ways"), "{message}");
}

#[test]
fn a_refit_without_a_designed_experiment_is_refused_before_any_work() {
    let here = folder();
    // The records do not exist; the refusal comes before they are opened.
    let axis =
        rsm(&["diagnose", &shipped("servo-axis.toml"), "--record", "none.csv", "--refit", "--out", "found"], here.path());
    assert_eq!((axis.status.code(), axis.stdout.len()), (Some(2), 0));
    let message = text(&axis.stderr);
    assert!(
        message.contains("--refit: found the plant \"servo-axis\"")
            && message.contains("no experiment is designed for another one"),
        "{message}"
    );
    let (motor, car) = (shipped("pmac.toml"), shipped("driveline.toml"));
    let other = rsm(&["diagnose", &motor, "--record", "none.csv", "--refit", "--truth", &car, "--out", "found"], here.path());
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("--truth: found the plant \"driveline\", expected \"pmac\""));
    // Evaluators need an output folder.
    let nowhere = rsm(&["diagnose", &motor, "--record", "none.csv", "--refit"], here.path());
    assert_eq!(nowhere.status.code(), Some(2));
    assert!(text(&nowhere.stderr).contains("--out"));
    assert!(!here.path().join("found").exists());
}

/// Each shipped record contains the inputs of its plant, but no measured outputs: there is nothing to compare with.
#[test]
fn shipped_records_without_outputs_are_refused_with_the_reason() {
    let here = folder();
    for plant in ["pmac", "driveline", "servo-axis"] {
        let (file, record) = (shipped(&format!("{plant}.toml")), shipped(&format!("{plant}.csv")));
        let output = rsm(&["diagnose", &file, "--record", &record], here.path());
        assert_eq!(output.status.code(), Some(2), "{plant}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains("found no measured output"), "{}", text(&output.stderr));
    }
}
