//! The shipped records run, and so does the measured EMPS axis, in closed loop under its own column names.

use rsm_core::source::Source;
use rsm_fit::table::{Table, Wanted};
use rsm_lab::diagnosis::{Options, Verdict, diagnose, free_run};
use rsm_lab::inverse::{Friction, Motion};
use rsm_lab::plant_file::PlantFile;
use rsm_lab::record::{Drive, Record};

use super::super::{effect, path, plant, run};

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

/// The measured axis under our column names; `None`, said loudly, without the data.
///
/// Its pulses are volts that the experimenters added to what the controller said. The controller says velocity_gain * position_gain volts for a metre of the reference,
/// so that a pulse is a change of the reference; the recorded voltage already holds it.
fn emps(name: &str, file: &PlantFile) -> Option<Record> {
    let folder = super::folder("emps")?;
    let renamed = plant("emps", "");
    let source = Source::read(&folder.join(name)).unwrap();
    let mut record = Record::read(&source, &renamed).unwrap();
    assert_eq!((record.drive, record.rows()), (Drive::Closed, 24841));
    let pulse = Wanted { numbers: vec!["pulse".to_string()], ..Wanted::default() };
    if let Ok(table) = Table::read(&source, &pulse) {
        let gain = file.parameters.number("position_gain") * file.parameters.number("velocity_gain");
        let volts = &table.column("pulse").unwrap().values;
        record.inputs[0].iter_mut().zip(volts).for_each(|(reference, volts)| *reference += volts / gain);
    }
    Some(record)
}

/// Root mean square of a difference, over that of the first.
fn relative(measured: &[f64], simulated: &[f64]) -> f64 {
    let error: f64 = measured.iter().zip(simulated).map(|(a, b)| (a - b) * (a - b)).sum();
    (error / measured.iter().map(|a| a * a).sum::<f64>()).sqrt()
}

#[test]
fn the_measured_axis_is_followed_better_with_its_friction() {
    // Published: Fc = 20.3935 N, offset -3.1648 N.
    let friction = effect("coulomb-friction", "force = 20.3935") + &effect("constant-load", "force = -3.1648");
    for (name, allowed) in [("emps_train.csv", 0.055), ("emps_test_pulses.csv", 0.062)] {
        let mut errors = Vec::new();
        for more in ["", friction.as_str()] {
            let file = plant("servo-axis", more);
            let Some(record) = emps(name, &file) else { return };
            let outputs = run(&file, &record);
            errors.push(relative(record.measured[1].as_ref().unwrap(), outputs.of("command").unwrap()));
        }
        println!(
            "{name}: relative error of the command {:.4} nominal, {:.4} with the published friction",
            errors[0], errors[1]
        );
        // Measured 0.0503 and 0.0564, a tenth above: the authors report 4.1 and 6.0 % by their own filtered comparison of forces; an unfiltered closed loop has
        // the measured noise on top. With the pulses as newtons in place of volts, or left out, it is 0.37.
        assert!(errors[1] < allowed && errors[1] < 0.5 * errors[0], "{errors:?}");
    }
}

/// Published: mass, viscous friction, dry friction and offset from the training record; then mass, and viscous and dry friction forward and backward.
const PUBLISHED: [&[f64]; 2] = [&[95.1089, 203.5034, 20.3935, -3.1648], &[95.154, 166.7061, 20.1440, 240.4236, 20.6277]];

#[test]
fn the_inverse_model_of_the_measured_axis_has_the_published_errors_step_by_step() {
    let file = plant("servo-axis", "");
    let (Some(training), Some(pulses)) = (emps("emps_train.csv", &file), emps("emps_test_pulses.csv", &file)) else { return };
    let gain = file.parameters.number("force_gain");
    let [training, pulses] = [training, pulses].map(|record| Motion::of(&record, file.kind).unwrap());
    // Per cent on the pulse record, which no regression has seen: 5.98 is published, the others are known to a tenth.
    let steps = [(Friction::Viscous, 17.9), (Friction::Coulomb, 8.2), (Friction::Offset, 6.0), (Friction::Asymmetric, 5.4)];
    let mut fits = Vec::new();
    for (friction, expected) in steps {
        let fit = training.regression(friction, gain);
        let unseen = 100.0 * pulses.relative_error(friction, &fit.coefficients, gain);
        println!(
            "EMPS {friction:?}: {:.2} % on the training record, {unseen:.2} % under the pulses",
            100.0 * fit.relative_error
        );
        // How a decimation treats the ends of a record is worth a few hundredths, and nobody has published theirs.
        assert!((unseen - expected).abs() < 0.1, "{friction:?}: {unseen}");
        fits.push(fit);
    }
    for (fit, published, error) in [(&fits[2], PUBLISHED[0], 4.0834), (&fits[3], PUBLISHED[1], 3.1117)] {
        // The same ends: the axis accelerates from rest in the first rows. They move the friction by 0.5 %, the offset by 0.6 % and the error by 0.15 points.
        assert!((100.0 * fit.relative_error - error).abs() < 0.2, "{}", fit.relative_error);
        for (found, published) in fit.coefficients.iter().zip(published) {
            assert!((found / published - 1.0).abs() < 0.01, "{found} {published}");
        }
    }
}

#[test]
fn the_diagnosis_of_the_measured_axis_names_its_friction_and_nothing_that_is_not_there() {
    let file = plant("emps", "");
    let (Some(training), Some(pulses)) = (emps("emps_train.csv", &file), emps("emps_test_pulses.csv", &file)) else { return };
    let options = Options { threads: 2, progress: &|_| {} };
    let found = diagnose(&file, &[training], &[pulses], &options).unwrap();
    super::tell("EMPS, judged under the pulses", &found);
    // A trajectory that repeats is no block that stands twice: all rows count.
    assert!(found.findings.iter().all(|it| !it.what.contains("block")), "{:?}", found.findings);
    // One friction that holds the dry one, the offset and the asymmetry; no stribeck-friction, no sensor, no gear.
    assert_eq!(super::kinds(&found), ["asymmetric-friction"]);
    let number = |name: &str| found.entries().next().unwrap().parameters.iter().find(|it| it.name == name).unwrap().value;
    // Published, by the inverse model of filtered positions; a free run weighs the slow rows more: 1.3 % between the two here, three times that allowed.
    let published =
        [("forward", 20.1440), ("backward", 20.6277), ("viscous_forward", 166.7061), ("viscous_backward", 240.4236)];
    for (name, value) in published {
        assert!((number(name) / value - 1.0).abs() < 0.04, "{name} {}", number(name));
    }
    // What the axis does under the pulses (a flexibility, its authors say) no entry explains: it is not called explained.
    assert_eq!(found.verdict, Verdict::Unexplained);
    // Free run and inverse model fall together, step by step: 8.2, 6.0 and 5.4 % by sharp signs, here with the rounded ones of the plant.
    let names: Vec<String> = found.steps.iter().map(|it| it.causes.join(" ")).collect();
    assert_eq!(names, ["", "coulomb-friction", "coulomb-friction constant-load", "asymmetric-friction"]);
    for (step, expected) in found.steps[1..].iter().zip([0.082, 0.060, 0.054]) {
        assert!((step.force_error.unwrap() - expected).abs() < 0.003, "{:?}", step.force_error);
    }
    for pair in found.steps.windows(2) {
        for (before, after) in pair[0].errors.iter().zip(&pair[1].errors) {
            assert!(after.rmse < 0.95 * before.rmse, "{before:?} {after:?}");
        }
    }
}

#[test]
fn from_command_to_position_the_measured_axis_is_followed_within_the_published_errors() {
    let file = plant("emps-open", "");
    let Some(folder) = super::folder("emps") else { return };
    let record = |name: &str| Record::read(&Source::read(&folder.join(name)).unwrap(), &file).unwrap();
    let (training, test) = (record("emps_train.csv"), record("emps_test_pulses.csv"));
    assert_eq!(training.drive, Drive::Open);
    let found = free_run::follow_axis(&file, &training, &test).unwrap();
    let error = |at: usize| found[at].1;
    // Measured: 0.43, 8.06, 2.02 and 2.33 mm; a tenth more is allowed. A linear state space has 5.5 mm on the test record, a network of transfer functions and nonlinearities 2.64
    // (M. Forgione, D. Piga, dynoNet, 2021).
    for (at, most) in [(0, 0.47e-3), (1, 8.9e-3), (2, 2.23e-3), (3, 2.57e-3)] {
        assert!(error(at) < most, "{found:?}");
    }
    // The drift is what the training record tells: without it the same plant is more than a millimetre off there.
    let mut still = file.clone();
    still.effects.retain(|it| it.description.kind != "load-drift");
    let without = free_run::fitted(&still, &[&training], [5e-8; 3], 1).unwrap();
    let rows = 0..training.rows();
    assert!(free_run::errors(&without.model, &training, rows).unwrap()[0] > 1.5e-3);
}
