//! The demonstration: both cases of the paper.

use serde_json::Value;

use crate::calls::{folder, json, keys, rsm, text};

/// Both cases completely: results that do not depend on the clock must be reached, and the page must need no other files.
#[test]
fn the_demo_reaches_the_figures_of_the_paper() {
    let here = folder();
    let output = rsm(&["demo", "--seconds", "0.2", "--json", "--out", "made"], here.path());
    let found = json(&output);
    assert_eq!((output.status.code(), &found["ok"]), (Some(0), &Value::Bool(true)), "{}", text(&output.stderr));
    assert_eq!(keys(&found), ["driveline", "loop", "missed", "motor", "ok", "paper", "report"]);
    assert!(found["missed"].as_array().unwrap().is_empty());
    assert_eq!(found["paper"]["ticks"], 200.0);
    let paper = found["paper"].as_object().unwrap();
    assert!(paper.len() >= 21 && paper.values().all(Value::is_number), "{paper:?}");
    // The paper's own forms, of second order, have larger errors here than ours.
    for (ours, second) in [
        ("angle_error_mean_deg", "angle_error_mean_deg_second_order"),
        ("damping_residual_percent", "damping_residual_percent_second_order"),
    ] {
        assert!(paper[second].as_f64() > paper[ours].as_f64(), "{paper:?}");
    }
    let page = std::fs::read_to_string(here.path().join("made/report.html")).unwrap();
    assert!(page.contains("6, second order as the paper has it"));
    for figure in ["Figure 2", "Figure 5", "Figure 6", "Figure 7"] {
        assert!(page.contains(figure), "{figure}");
    }
    // Self-contained: links lead to files beside the page, and nothing is loaded.
    assert!(page.contains("<svg") && !page.contains("src=") && !page.contains("href=\"http"));
}
