//! Robust losses in `rsm fit`: the wrong row is named in words, JSON and report, and withheld figures have a sentence.

use crate::calls::{folder, json, rsm, text};

#[test]
fn a_wrong_row_is_named_in_words_json_and_report() {
    let here = folder();
    // 1 + 2 x with errors of 0.1 in turn; row 8 is wrong by 50.
    let line = |row: usize| {
        format!("{row},{}\n", 1.0 + 2.0 * row as f64 + [0.1, -0.1, 0.05][row % 3] + if row == 7 { 50.0 } else { 0.0 })
    };
    std::fs::write(here.path().join("data.csv"), format!("x[1],y[V]\n{}", (0..24).map(line).collect::<String>())).unwrap();
    for loss in ["huber", "l1"] {
        let specification = format!(
            "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.x]\n[responses.y]\ninputs = [\"x\"]\nloss = \"{loss}\"\n\
             select = {{ method = \"fixed\", order = 1 }}\n"
        );
        std::fs::write(here.path().join("fit.toml"), specification).unwrap();
        let output = rsm(&["fit", "fit.toml", "--out", "m.toml", "--report", "report"], here.path());
        let printed = text(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{printed}{}", text(&output.stderr));
        assert!(printed.contains(&format!("  loss: {loss}")) && printed.contains("withheld: R2, residual sd"), "{printed}");
        assert!(printed.contains("warning: y: low-weight: 1 of 24 rows: row 8 (x = 7): error "), "{printed}");
        let report = std::fs::read_to_string(here.path().join("report/report.html")).unwrap();
        assert!(report.contains("row 8 (x = 7)") && report.contains("withheld: R2, residual sd"));
        let object = json(&rsm(&["fit", "fit.toml", "--json"], here.path()));
        let y = &object["responses"]["y"];
        assert_eq!((&y["loss"]["loss"], &y["loss"]["low_weight"][0]["row"]), (&loss.into(), &8.into()));
        assert!(y["r2"].is_null() && y["residual_sd"].is_null() && y.get("analysis").is_none());
        assert_eq!(y["terms"][0]["standard_error"].is_null(), loss == "l1");
        // The slope is 2 for each unit and 23 for the half range. Errors of 0.1 move it by less.
        assert!((y["terms"][1]["coefficient"].as_f64().unwrap() - 23.0).abs() < 0.1, "{y}");
        let model = std::fs::read_to_string(here.path().join("m.toml")).unwrap();
        assert!(model.contains("error_scale = "), "{model}");
    }
}
