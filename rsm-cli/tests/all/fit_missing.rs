//! Missing cells in `rsm fit`: words, JSON and report have the same counts. `rsm diagnose` refuses them.

use crate::calls::{folder, json, rsm, text};

const SPECIFICATION: &str = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\nmissing = \"drop-row\"\n[inputs.x]\n[inputs.z]\n\
    [responses.a]\ninputs = [\"x\", \"z\"]\nselect = { method = \"fixed\", order = 1 }\n\
    [responses.b]\ninputs = [\"x\"]\nselect = { method = \"fixed\", order = 1 }\n";

#[test]
fn left_out_rows_are_in_words_json_report_and_model() {
    let here = folder();
    let line = |row: usize| {
        let (x, z) = (row % 5, row / 5);
        let z = if row == 7 { "#N/A".to_string() } else { z.to_string() };
        let b = if row == 9 { String::new() } else { format!("{}", 5 + x) };
        format!("{x},{z},{}.{},{b}\n", 1 + 2 * x, row % 3)
    };
    let data = format!("x[1],z[1],a[V],b[V]\n{}", (0..25).map(line).collect::<String>());
    std::fs::write(here.path().join("data.csv"), &data).unwrap();
    std::fs::write(here.path().join("fit.toml"), SPECIFICATION).unwrap();
    let sentences =
        ["1 of 25 rows of `data` is left out because a cell is missing: 1 in `z` of data.csv", "1 in `b` of data.csv"];
    let output = rsm(&["fit", "fit.toml", "--out", "m.toml", "--report", "report"], here.path());
    let printed = text(&output.stdout);
    assert!(sentences.iter().all(|sentence| printed.contains(sentence)), "{printed}{}", text(&output.stderr));
    let report = std::fs::read_to_string(here.path().join("report/report.html")).unwrap();
    assert!(sentences.iter().all(|sentence| report.contains(sentence)));
    let model = std::fs::read_to_string(here.path().join("m.toml")).unwrap();
    assert_eq!(model.matches("rows_left_out = 1\n").count(), 2, "{model}");
    let object = json(&rsm(&["fit", "fit.toml", "--json"], here.path()));
    assert_eq!(object["missing"]["a"][0]["cells"][0]["column"], "z");
    assert_eq!((&object["missing"]["b"][0]["rows"], &object["responses"]["a"]["rows"]), (&1.into(), &24.into()));
    // Every other command that reads the model, and new data with a missing cell.
    let output = rsm(&["diagnose", "m.toml", "--data", "data.csv"], here.path());
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        message.contains("data.csv:9: column 2 `z`: found `#N/A`, expected a number; no other cell of this column"),
        "{message}"
    );
    assert!(message.contains("a diagnosis compares rows in their order and leaves none out"), "{message}");
}
