//! Columns of text through the commands: a fit with a category and blocks, then every command that reads its model.

use crate::calls::{folder, json, rsm, text};

/// The torque of an engine with two fuels on three days, with an offset of each day: drawn without the project's generators.
fn data(rows: usize, offsets: [f64; 3], gain: f64) -> String {
    let mut state: u64 = 88_172_645_463_325_252;
    // Marsaglia 2003, xorshift64.
    let mut share = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut out = "day,fuel,speed[rad/s],torque[N*m]\n".to_string();
    for row in 0..rows {
        let day = (3.0 * share()) as usize;
        let (fuel, slope) = if share() < 0.5 { ("diesel", 20.0) } else { ("petrol", 12.0) };
        let speed = 100.0 + 400.0 * share();
        let x = (speed - 300.0) / 200.0;
        let noise = share() + share() + share() - 1.5;
        out += &format!("d{day},{fuel},{speed},{}\n", gain * (150.0 + slope * x - 9.0 * x * x) + offsets[day] + noise);
        assert!(row < rows);
    }
    out
}

const FIT: &str = "format = 1\nmodel = \"engine\"\ndata = [\"engine.csv\"]\nblocks = [\"day\"]\n[inputs.speed]\nunit = \"rad/s\"\n\
    range = [100.0, 500.0]\n[inputs.fuel]\ncategories = [\"diesel\", \"petrol\"]\n[responses.torque]\nunit = \"N*m\"\n\
    inputs = [\"speed\", \"fuel\"]\nselect = { method = \"lasso\", max_order = 3 }\n";

#[test]
fn a_fuel_and_three_days_pass_through_every_command() {
    let here = folder();
    let file = |name: &str, text: &str| std::fs::write(here.path().join(name), text).unwrap();
    file("engine.csv", &data(300, [-6.0, 2.0, 4.0], 1.0));
    file("fit.toml", FIT);
    let words = ["fit", "fit.toml", "--out", "engine.toml", "--report", "page"];
    let fitted = rsm(&words, here.path());
    assert_eq!(fitted.status.code(), Some(0), "{}", text(&fitted.stderr));
    assert!(text(&fitted.stdout).contains("  blocks: 3 of day, effects N*m with sd "), "{}", text(&fitted.stdout));
    let pages = std::fs::read_dir(here.path().join("page")).unwrap();
    let page: String = pages.map(|page| std::fs::read_to_string(page.unwrap().path()).unwrap()).collect();
    assert!(page.contains("effects of day") && page.contains("Plots show measured values less these effects."));
    let found = json(&rsm(&["fit", "fit.toml", "--out", "again.toml", "--json"], here.path()));
    let torque = &found["responses"]["torque"];
    for (effect, expected) in torque["blocks"]["effects"].as_array().unwrap().iter().zip(["d0", "d1", "d2"]) {
        let offset = [-6.0, 2.0, 4.0][expected[1..].parse::<usize>().unwrap()];
        let found = torque["blocks"]["effects"].as_array().unwrap().iter().find(|it| it["block"] == expected).unwrap();
        // The noise has a standard deviation of a half, on 100 rows.
        assert!((found["effect"].as_f64().unwrap() - offset).abs() < 0.3, "{effect}");
    }
    let written = std::fs::read_to_string(here.path().join("engine.toml")).unwrap();
    assert!(
        written.contains("categories = [{ name = \"fuel\", levels = [\"diesel\", \"petrol\"], inputs = [\"fuel_diesel\"] }]")
    );
    assert!(written.contains("blocks = { columns = [\"day\"], count = 3, sd = "), "{written}");

    // A point of a file with the text, and the same point with the contrast.
    file("points.csv", "fuel,speed[rad/s]\ndiesel,420\npetrol,420\n");
    let evaluate = |words: &[&str]| text(&rsm(&[&["eval", "engine.toml"], words].concat(), here.path()).stdout);
    let of_file = evaluate(&["--data", "points.csv"]);
    let rows: Vec<&str> = of_file.lines().skip(1).map(|line| line.rsplit(',').next().unwrap()).collect();
    assert_eq!(rows[0], evaluate(&["--at", "speed=420,fuel_diesel=1"]).trim());
    assert_eq!(rows[1], evaluate(&["--at", "speed=420,fuel_diesel=-1"]).trim());
    assert_ne!(rows[0], rows[1]);
    file("points.csv", "fuel,speed[rad/s]\ndiesel,420\nhydrogen,420\n");
    let refused = rsm(&["eval", "engine.toml", "--data", "points.csv"], here.path());
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(said.contains("points.csv:3: column 1 `fuel`: found `hydrogen`, expected one of `diesel`, `petrol`"), "{said}");

    for (language, mark) in
        [("c", " * `fuel_diesel`: 1 for diesel, -1 for petrol."), ("rust", "`fuel_diesel`: 1 for diesel, -1 for petrol.")]
    {
        let emitted = rsm(&["emit", "engine.toml", "--lang", language, "--out", "out", "--gradient"], here.path());
        assert_eq!(emitted.status.code(), Some(0), "{}", text(&emitted.stderr));
        let files = std::fs::read_dir(here.path().join("out")).unwrap();
        let all: String = files.map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap()).collect();
        assert!(all.contains(mark), "{language}\n{all}");
        std::fs::remove_dir_all(here.path().join("out")).unwrap();
    }

    // New data of the same engine, and of one with a tenth more torque; the contrast is no sensor that could be wrong.
    for (gain, wanted) in [(1.0, "no-discrepancy"), (1.1, "explained")] {
        file("new.csv", &data(200, [0.0; 3], gain).replace("day,", "note,"));
        let output = rsm(&["diagnose", "engine.toml", "--data", "new.csv", "--json"], here.path());
        let found = json(&output);
        let found = &found["responses"]["torque"];
        assert_eq!(found["verdict"], wanted, "{gain}: {found}");
        assert!(!found.to_string().contains("fuel_diesel sensor"), "{found}");
    }

    let goals = |inputs: &str| {
        let goals = format!(
            "format = 1\nstudy = \"s\"\nseed = 1\n[responses.torque]\ngoal = \"maximise\"\nlow = 100\nhigh = 200\n{inputs}"
        );
        file("goals.toml", &goals);
        rsm(&["optimise", "engine.toml", "--goals", "goals.toml"], here.path())
    };
    let refused = goals("");
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(said.contains("category `fuel` is not held at one of its levels"), "{said}");
    assert!(said.contains("diesel: fuel_diesel = 1; petrol: fuel_diesel = -1"), "{said}");
    let held = goals("[inputs.fuel_diesel]\nvalue = 1\n");
    assert_eq!(held.status.code(), Some(0), "{}", text(&held.stderr));
}
