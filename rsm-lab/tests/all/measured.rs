//! The shipped records run, and so does the measured EMPS axis, in closed loop under its own column names.

use std::path::Path;

use rsm_core::source::Source;
use rsm_lab::record::{Drive, Record};

use super::{effect, path, plant, run};

#[test]
fn every_shipped_plant_runs_along_its_record() {
    for name in ["pmac", "driveline", "servo-axis"] {
        let file = plant(name, "");
        let record = Record::read(&Source::read(&path(&format!("plants/{name}.csv"))).unwrap(), &file).unwrap();
        let outputs = run(&file, &record);
        assert!(outputs.values.iter().all(|values| values.len() == record.rows()), "{name}");
        if name == "pmac" {
            // The plant does not enforce the current limit (20); a record that is shipped keeps it.
            let (i_d, i_q) = (outputs.of("i_d").unwrap(), outputs.of("i_q").unwrap());
            assert!(i_d.iter().zip(i_q).all(|(i_d, i_q)| i_d.hypot(*i_q) < 60.0));
        }
    }
}

/// Root mean square of a difference, over that of the first.
fn relative(measured: &[f64], simulated: &[f64]) -> f64 {
    let error: f64 = measured.iter().zip(simulated).map(|(a, b)| (a - b) * (a - b)).sum();
    (error / measured.iter().map(|a| a * a).sum::<f64>()).sqrt()
}

#[test]
fn the_measured_axis_is_followed_better_with_its_friction() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/emps");
    if !folder.is_dir() {
        assert!(std::env::var_os("CI").is_none(), "../shared/data/emps is missing, and in CI these tests must run");
        eprintln!("SKIPPED: ../shared/data/emps is missing; this test has shown NOTHING");
        return;
    }
    let columns = "\n[columns]\ntime = { column = \"t_s\", unit = \"s\" }\nreference = { column = \"q_ref_m\", unit = \"m\" }\n\
                   position = { column = \"q_m\", unit = \"m\" }\ncommand = { column = \"u_V\", unit = \"V\" }\n";
    // Published: Fc = 20.3935 N, offset -3.1648 N.
    let friction = effect("coulomb-friction", "force = 20.3935") + &effect("constant-load", "force = -3.1648");
    let mut errors = Vec::new();
    for more in ["", friction.as_str()] {
        let file = plant("servo-axis", &format!("{columns}{more}"));
        let source = Source::read(&folder.join("emps_train.csv")).unwrap();
        let record = Record::read(&source, &file).unwrap();
        assert_eq!((record.drive, record.rows()), (Drive::Closed, 24841));
        let outputs = run(&file, &record);
        errors.push(relative(record.measured[1].as_ref().unwrap(), outputs.of("command").unwrap()));
    }
    println!("EMPS: relative error of the command {:.4} nominal, {:.4} with the published friction", errors[0], errors[1]);
    // The authors report 4.1 % by their own filtered comparison of forces; an unfiltered closed loop has the measured noise on top.
    assert!(errors[1] < 0.1 && errors[1] < 0.5 * errors[0], "{errors:?}");
}
