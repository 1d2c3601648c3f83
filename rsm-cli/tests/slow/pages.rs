//! The pages in a browser: headless Chromium opens each page and uses every control, and no script may fail. Needs the Debian package chromium.

use std::path::{Path, PathBuf};
use std::process::Command;

use rsm_core::source::Source;
use rsm_diagnose::plant::{self, Options};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use serde_json::Value;

use crate::skipped::skipped;

/// The scripts that are added to a copy of a page.
const CLICK: &str = include_str!("../pages/click.js");

/// Virtual milliseconds for a page. A page that does not wait takes a few seconds of real time.
const BUDGET: &str = "--virtual-time-budget=120000";

/// Chromium on the search path. In CI it must be there.
fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path)
        .flat_map(|folder| ["chromium", "chromium-browser", "google-chrome"].map(|name| folder.join(name)))
        .find(|file| file.is_file());
    if found.is_none() {
        assert!(
            std::env::var_os("CI").is_none(),
            "chromium is missing, and in CI this test must run: apt-get install chromium"
        );
        skipped("chromium is missing (Debian: apt-get install chromium)");
    }
    found
}

fn rsm(arguments: &[&str], folder: &Path) {
    let output = Command::new(env!("CARGO_BIN_EXE_rsm")).args(arguments).current_dir(folder).output().unwrap();
    // A fit that did not reach its confidence also has a page.
    assert!(matches!(output.status.code(), Some(0 | 1)), "rsm {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The results of the clicks on a page, in a window with this size in pixels.
fn clicked(browser: &Path, page: &Path, size: &str) -> Value {
    let text = std::fs::read_to_string(page).unwrap();
    let copy = page.with_file_name(format!("clicked-{size}.html"));
    // Before the page's own scripts, so that all of their errors are recorded.
    let made = text.replacen("<style>", &format!("<script>\n{CLICK}</script>\n<style>"), 1);
    assert_ne!(made, text);
    std::fs::write(&copy, made).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-extensions"])
        .args(["--no-first-run", "--disable-background-networking", "--hide-scrollbars", "--dump-dom", BUDGET])
        .arg(format!("--window-size={size}"))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("file://{}", copy.display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&output.stdout);
    let result = dom.split_once("<pre id=\"told\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    let (result, _) = result
        .unwrap_or_else(|| panic!("{}: the clicks did not end: {}", page.display(), String::from_utf8_lossy(&output.stderr)));
    let result = result.replace("&lt;", "<").replace("&gt;", ">").replace("&nbsp;", "\u{a0}").replace("&amp;", "&");
    let value: Value = serde_json::from_str(&result).unwrap_or_else(|error| panic!("{error}: {result}"));
    assert_eq!(value["faults"], Value::Array(Vec::new()), "{}: {value:#}", page.display());
    value
}

fn count(value: &Value, key: &str) -> u64 {
    value[key].as_u64().unwrap_or_else(|| panic!("{key}: {value}"))
}

const FIT: &str = r#"format = 1
model = "motor"
data = ["DATA"]
INPUTS
[responses.angle]
unit = "deg"
inputs = NAMES
SELECT
"#;

const LADDER: &str = "select = { method = \"ladder\", max_order = 2, confidence = 90.0 }";

const SPLINE: &str = "select = { method = \"fixed\" }\nspline = { cells = [2, 3], penalty = 1e-3 }";

/// Fits artificial data with this number of inputs and opens its page.
fn fit(folder: &Path, inputs: usize, select: &str) -> PathBuf {
    let names = &["torque", "speed", "heat"][..inputs];
    let units = ["N*m", "rad/s", "K"];
    let mut csv = String::new();
    let heads: Vec<String> = names.iter().zip(units).map(|(name, unit)| format!("{name}[{unit}]")).collect();
    csv += &format!("{},angle[deg]\n", heads.join(","));
    for row in 0_u32..36 {
        let values: Vec<f64> = (0..inputs as u32).map(|k| f64::from(row / 3_u32.pow(k) % 3) * 5.0).collect();
        // A pattern that a polynomial of second order cannot follow.
        let scatter = f64::from(row * 7919 % 101) / 101.0 - 0.5;
        let angle = 20.0 + values.iter().enumerate().map(|(k, x)| (3.5 - k as f64) * x + 0.05 * x * x).sum::<f64>() + scatter;
        let cells: Vec<String> = values.iter().chain([&angle]).map(|value| format!("{value:.3}")).collect();
        csv += &format!("{}\n", cells.join(","));
    }
    let data = format!("data-{inputs}.csv");
    std::fs::write(folder.join(&data), csv).unwrap();
    let unit_lines: Vec<String> =
        names.iter().zip(units).map(|(name, unit)| format!("inputs.{name}.unit = \"{unit}\"")).collect();
    let text = FIT
        .replace("DATA", &data)
        .replace("INPUTS", &unit_lines.join("\n"))
        .replace("NAMES", &format!("{names:?}"))
        .replace("SELECT", select);
    let (specification, model, report) =
        (format!("fit-{inputs}.toml"), format!("model-{inputs}.toml"), format!("report-{inputs}"));
    std::fs::write(folder.join(&specification), text).unwrap();
    rsm(&["fit", &specification, "--out", &model, "--report", &report], folder);
    folder.join(report).join("report.html")
}

#[test]
fn every_control_of_a_fits_page_works_and_shows_the_bits_of_the_evaluator() {
    let Some(browser) = chromium() else { return };
    let here = tempfile::tempdir().unwrap();
    for (inputs, size, select) in
        [(1, "1300,900", LADDER), (2, "500,400", LADDER), (3, "500,400", LADDER), (2, "1300,900", SPLINE)]
    {
        let page = fit(here.path(), inputs, select);
        let result = clicked(&browser, &page, size);
        assert_eq!((count(&result, "sliders"), count(&result, "figures")), (inputs as u64, 3), "{result}");
        assert!(count(&result, "hovered") >= 2 && count(&result, "zoomed") >= 2, "{result}");
        let spaces = u64::from(inputs > 1);
        assert_eq!(["spaces", "dragged", "turned"].map(|key| count(&result, key)), [spaces; 3], "{result}");
        for it in result["values"].as_array().unwrap() {
            let point = it["point"].as_array().unwrap().iter().zip(["torque", "speed", "heat"]);
            let at: Vec<String> = point.map(|(value, name)| format!("{name}={:?}", value.as_f64().unwrap())).collect();
            let model = format!("model-{inputs}.toml");
            let output = Command::new(env!("CARGO_BIN_EXE_rsm"))
                .args(["eval", &model, "--surface", "angle", "--at", &at.join(","), "--bits"])
                .current_dir(here.path())
                .output()
                .unwrap();
            let bits = String::from_utf8(output.stdout).unwrap();
            assert_eq!(format!("{:016x}", it["value"].as_f64().unwrap().to_bits()), bits.trim(), "{it}");
        }
    }
}

#[test]
fn a_page_of_a_hundred_thousand_rows_has_less_than_a_megabyte() {
    let here = tempfile::tempdir().unwrap();
    let mut csv = "torque[N*m],speed[rad/s],angle[deg]\n".to_string();
    for row in 0_u32..100_000 {
        // The golden ratio and the root of two spread the rows over the square; 101 is a prime for the scatter.
        let (torque, speed) =
            (10.0 * (f64::from(row) * 0.618_034).fract(), 10.0 * (f64::from(row) * std::f64::consts::SQRT_2).fract());
        let scatter = f64::from(row * 7919 % 101) / 101.0 - 0.5;
        csv += &format!("{torque:.4},{speed:.4},{:.3}\n", 20.0 + 1.5 * torque + 0.05 * torque * torque + 0.5 * speed + scatter);
    }
    std::fs::write(here.path().join("many.csv"), csv).unwrap();
    let units = "inputs.torque.unit = \"N*m\"\ninputs.speed.unit = \"rad/s\"";
    let text = FIT
        .replace("DATA", "many.csv")
        .replace("INPUTS", units)
        .replace("NAMES", "[\"torque\", \"speed\"]")
        .replace("SELECT", "select = { method = \"stepwise\", max_order = 2 }");
    std::fs::write(here.path().join("fit.toml"), text).unwrap();
    rsm(&["fit", "fit.toml", "--out", "model.toml", "--report", "page"], here.path());
    let bytes = std::fs::metadata(here.path().join("page/report.html")).unwrap().len();
    // Plotly alone has 748 kB.
    assert!(bytes < 1_000_000, "{bytes}");
}

#[test]
fn a_cause_is_switched_off_by_a_click_and_no_name_from_data_is_a_script() {
    let Some(browser) = chromium() else { return };
    let here = tempfile::tempdir().unwrap();
    fit(here.path(), 2, LADDER);
    // The name of the rig's column would end a script and begin another one.
    let evil = "rig</script><script>console.error('escaped')</script><b>";
    let mut csv = format!("torque[N*m],speed[rad/s],\"{evil}\",angle[deg]\n");
    for row in 0_u32..40 {
        let (torque, speed) = (f64::from(row % 3) * 5.0, f64::from(row / 3 % 3) * 5.0);
        let scatter = f64::from(row * 7919 % 101) / 101.0 - 0.5;
        let rig = if row * 31 % 7 < 3 { ("b", 4.0) } else { ("<i>a", 0.0) };
        let angle = 20.0 + 1.5 * torque + 0.05 * torque * torque + 0.5 * speed + 0.05 * speed * speed + scatter + rig.1;
        let angle = if row == 17 { angle + 30.0 } else { angle };
        csv += &format!("{torque},{speed},{},{angle:.3}\n", rig.0);
    }
    std::fs::write(here.path().join("new.csv"), csv).unwrap();
    rsm(&["diagnose", "model-2.toml", "--data", "new.csv", "--out", "surface"], here.path());
    let page = here.path().join("surface/report.html");
    let text = std::fs::read_to_string(&page).unwrap();
    // Numbers are escaped or compressed: see the tests of `rsm-cli/src/page`.
    assert!(text.contains("rig&lt;/script&gt;") && !text.contains(evil));
    let result = clicked(&browser, &page, "1300,900");
    assert!(count(&result, "switched") >= 4 && count(&result, "figures") >= 6, "{result}");
}

/// A record of an axis with several faults that are not in its plant file.
fn faulty_axis(folder: &Path) {
    let plants = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants");
    let plant = std::fs::read_to_string(plants.join("servo-axis.toml")).unwrap();
    std::fs::copy(plants.join("servo-axis.csv"), folder.join("motion.csv")).unwrap();
    std::fs::write(folder.join("plant.toml"), &plant).unwrap();
    let faults = FAULTS.map(|(kind, numbers)| format!("\n[[effects]]\nkind = \"{kind}\"\nparameters = {{ {numbers} }}\n"));
    std::fs::write(folder.join("machine.toml"), plant + &faults.concat()).unwrap();
    rsm(&["simulate", "machine.toml", "--record", "motion.csv", "--out", "record.csv"], folder);
}

/// The faults, with their numbers.
const FAULTS: [(&str, &str); 3] = [
    ("coulomb-friction", "force = 12.0"),
    ("constant-load", "force = 8.0"),
    ("sensor-drift", "output = \"position\", rate = 2e-5"),
];

#[test]
fn every_combination_of_causes_shows_the_numbers_of_the_library() {
    let Some(browser) = chromium() else { return };
    let here = tempfile::tempdir().unwrap();
    faulty_axis(here.path());
    rsm(&["diagnose", "plant.toml", "--record", "record.csv", "--out", "found"], here.path());
    let result = clicked(&browser, &here.path().join("found/report.html"), "500,900");
    assert_eq!(count(&result, "hovered"), count(&result, "figures"), "{result}");

    let plant = PlantFile::read(&Source::read(&here.path().join("plant.toml")).unwrap()).unwrap();
    let record = Record::read(&Source::read(&here.path().join("record.csv")).unwrap(), &plant).unwrap();
    let found = plant::diagnose(&plant, &[record], &[], &Options { threads: 2, progress: &|_| {} }).unwrap();
    let breakdown = &found.error_breakdown;
    let combinations = &breakdown.combinations;
    assert_eq!((combinations.causes.len(), combinations.of.len()), (3, 8), "{:?}", combinations.causes);
    let groups = result["groups"].as_array().unwrap();
    // The summary, and each output.
    assert_eq!(groups.len(), 1 + plant.kind.outputs().len().min(breakdown.traces.len()));
    let (summary, output) = (&groups[0], found.worst_output().unwrap());
    let (place, trace) = breakdown.worst(output).unwrap();
    let names: Vec<&str> = summary["causes"].as_array().unwrap().iter().map(|it| it.as_str().unwrap()).collect();
    assert_eq!(names, combinations.causes);
    for (set, plant) in combinations.of.iter().enumerate() {
        let (plant, state) = (plant.as_ref().unwrap(), &summary["states"][set.to_string()]);
        let error = plant.errors.iter().find(|it| it.output == output).unwrap().noise_ratio;
        let words = state["told"].as_str().unwrap();
        let shown = words.strip_prefix("error ").and_then(|it| it.strip_suffix(" times the noise")).unwrap();
        // At least two digits are printed: half of the last one is 5 % of 1.0, and 0.005 for small numbers.
        let off = (shown.parse::<f64>().unwrap() - error).abs();
        assert!(off <= 0.051 * error || off <= 0.0051, "{set}: {words}, {error}");
        let curves: Vec<(&str, Vec<f64>)> = state["shown"].as_array().unwrap().iter().map(curve).collect();
        let simulated = &plant.simulated[place][trace.worst.clone()];
        let is_it =
            |values: &[f64]| values.len() == simulated.len() && values.iter().zip(simulated).all(|(a, b)| is_shown(*a, *b));
        let expected = match set {
            0 => "calibrated".to_string(),
            7 => "extended".to_string(),
            _ => format!("with {}", combinations.names(set).join(", ")),
        };
        assert!(curves.iter().any(|(name, values)| *name == expected && is_it(values)), "{set}: {:?}", state["shown"]);
        // The plot also contains the measured curve, and the plant of the file beside the calibrated one.
        assert_eq!(curves.len(), if set == 0 { 3 } else { 2 }, "{set}");
    }
}

fn curve(value: &Value) -> (&str, Vec<f64>) {
    (value["name"].as_str().unwrap(), value["y"].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect())
}

/// Whether a number of a plot is this value: seven digits are printed.
fn is_shown(shown: f64, value: f64) -> bool {
    (shown - value).abs() <= 5.1e-7 * value.abs()
}
