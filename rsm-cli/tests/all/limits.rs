//! `rsm check --limits` as a command: status 0 if proved, 1 if violated at a point, 2 for wrong files and options.

use std::path::Path;

use serde_json::Value;

use crate::calls::{folder, rsm, text};
use crate::shell::published;

fn plants(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants").join(name).display().to_string()
}

/// The shipped surfaces, and surfaces of a loop with too little field weakening: the slope of the weakening current over the speed is 12 A instead of
/// 19 A.
fn inputs() -> tempfile::TempDir {
    let here = folder();
    let shipped = std::fs::read_to_string(published("motor.toml")).unwrap();
    let broken = shipped.replacen("19.209058159290976", "12.0", 1);
    assert!(broken != shipped, "the shipped surface has another coefficient");
    std::fs::write(here.path().join("motor.toml"), shipped).unwrap();
    std::fs::write(here.path().join("broken.toml"), broken).unwrap();
    here
}

#[test]
fn the_shipped_surfaces_pass() {
    let here = inputs();
    let plant = plants("pmac.toml");
    let output = rsm(&["check", "motor.toml", "--plant", &plant, "--limits"], here.path());
    let printed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{printed}{}", text(&output.stderr));
    assert!(printed.contains("limits of the loop: proved"), "{printed}");
    assert!(printed.contains("speeds of 800 rad/s both ways, bus 180 to 330 V"), "{printed}");
    assert!(!printed.contains("problem"), "{printed}");

    let output = rsm(&["check", "motor.toml", "--plant", &plant, "--limits", "--json"], here.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let limits = &json["limits"];
    assert_eq!((&json["ok"], &limits["verdict"]), (&Value::from(true), &Value::from("proved")));
    assert_eq!(
        (&limits["speed"], &limits["bus_voltage"]),
        (&Value::from([-800.0, 800.0].to_vec()), &Value::from([180.0, 330.0].to_vec()))
    );
    for what in ["voltage", "current"] {
        let share = |name: &str| limits[what][name].as_f64().unwrap();
        assert!(0.9 < share("seen") && share("seen") <= share("at_most") && share("at_most") <= 1.0, "{limits}");
    }
}

#[test]
fn a_surface_that_weakens_too_little_violates_a_limit_at_a_point() {
    let here = inputs();
    let plant = plants("pmac.toml");
    let output = rsm(&["check", "broken.toml", "--plant", &plant, "--limits"], here.path());
    let printed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{printed}{}", text(&output.stderr));
    assert!(
        printed.contains("violated at a point") && printed.contains("problem: limits: the voltage limit does not hold"),
        "{printed}"
    );

    let output = rsm(&["check", "broken.toml", "--plant", &plant, "--limits", "--json"], here.path());
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&json["ok"], &json["limits"]["verdict"]), (&Value::from(false), &Value::from("broken")));
    let at = &json["problems"][0]["at"];
    let [speed, bus, i_d, i_q] = ["speed", "bus_voltage", "i_d", "i_q"].map(|name| at[name].as_f64().unwrap());
    // Equations (17), (18) with the parameters of the shipped plant: the voltage of this point is above V/sqrt 3.
    let (r, l, lambda, w_e) = (0.08, 0.9e-3, 0.06, 4.0 * speed);
    let voltage = (r * i_d - w_e * l * i_q).hypot(r * i_q + w_e * (l * i_d + lambda));
    assert!(voltage > bus / 3f64.sqrt(), "{voltage} V at {at}");
}

#[test]
fn what_cannot_be_checked_is_refused() {
    let here = inputs();
    let (pmac, driveline) = (plants("pmac.toml"), plants("driveline.toml"));
    let (pmac, driveline) = (pmac.as_str(), driveline.as_str());
    let other = published("circle.toml");
    std::fs::write(here.path().join("torn.toml"), "kind = ").unwrap();
    let runs: [(&[&str], &str); 8] = [
        (&["motor.toml", "--limits"], "--plant"),
        (&["motor.toml", "--plant", pmac], "--limits"),
        (&["motor.toml", "--limits", "--plant", driveline], "found the plant `driveline`, --limits needs a `pmac`"),
        (&["motor.toml", "--limits", "--plant", "none.toml"], "none.toml"),
        (&["motor.toml", "--limits", "--plant", "torn.toml"], "torn.toml:1"),
        (&[&other, "--limits", "--plant", pmac], "the motor's loop needs the surface `weakening_current`"),
        (&["motor.toml", "--limits", "--plant", pmac, "--bus", "330,180"], "the lower one first"),
        (&["motor.toml", "--limits", "--plant", pmac, "--speed", "0"], "--speed: found 0, expected a positive speed"),
    ];
    for (arguments, expected) in runs {
        let output = rsm(&[&["check"], arguments].concat(), here.path());
        let printed = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {printed}");
        assert!(printed.contains(expected), "{arguments:?}: {printed}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
    // With too little work there is no result, and a message reports this.
    let output = rsm(&["check", "motor.toml", "--limits", "--plant", pmac, "--work", "500"], here.path());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("not decided after"), "{}", text(&output.stdout));
}
