//! The shipped records, and the measured EMPS axis in closed loop with its own column names.

use rsm_core::source::Source;
use rsm_diagnose::plant::inverse::{Friction, Motion, Regression};
use rsm_diagnose::plant::model::Model;
use rsm_diagnose::plant::{Options, Verdict, diagnose, free_run};
use rsm_fit::table::{Table, Wanted};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::{Drive, Record};

use super::super::{effect, path, plant, run};
use super::prose;

#[test]
fn every_shipped_plant_runs_along_its_record() {
    for name in ["pmac", "driveline", "servo-axis"] {
        let file = plant(name, "");
        let record = Record::read(&Source::read(&path(&format!("plants/{name}.csv"))).unwrap(), &file).unwrap();
        let outputs = run(&file, &record);
        assert!(outputs.values.iter().all(|values| values.len() == record.rows()), "{name}");
        if name == "pmac" {
            // The plant does not enforce the current limit (20); the shipped record must satisfy it.
            let (i_d, i_q) = (outputs.of("i_d").unwrap(), outputs.of("i_q").unwrap());
            assert!(i_d.iter().zip(i_q).all(|(i_d, i_q)| i_d.hypot(*i_q) < 60.0));
        }
    }
}

/// The measured axis with our column names; `None` with a message if the data are missing.
///
/// Its pulses are voltages that the experimenters added to the controller's output. The controller's output changes by velocity_gain * position_gain
/// volts for one metre of the reference, so a pulse is equivalent to a change of the reference. The recorded voltage already contains it.
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

/// The root mean square of a difference, divided by that of the first signal.
fn relative(measured: &[f64], simulated: &[f64]) -> f64 {
    let error: f64 = measured.iter().zip(simulated).map(|(a, b)| (a - b) * (a - b)).sum();
    (error / measured.iter().map(|a| a * a).sum::<f64>()).sqrt()
}

#[test]
fn the_measured_axis_is_followed_better_with_its_friction() {
    // Published values: Fc = 20.3935 N, offset -3.1648 N.
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
        // The limits are a tenth above the measured 0.0503 and 0.0564. The authors report 4.1 and 6.0 % for their filtered comparison of forces; an
        // unfiltered closed loop also contains the measured noise. With the pulses in newtons instead of volts, or without them, the result is 0.37.
        assert!(errors[1] < allowed && errors[1] < 0.5 * errors[0], "{errors:?}");
    }
}

/// Published: mass, viscous friction, dry friction and offset from the training record; then mass, and viscous and dry friction forward and backward.
const PUBLISHED: [&[f64]; 2] = [&[95.1089, 203.5034, 20.3935, -3.1648], &[95.154, 166.7061, 20.1440, 240.4236, 20.6277]];

/// The inverse model step by step, fitted to the training record, with its relative error on the other record, in per cent.
fn regressions(file: &PlantFile, training: &Record, pulses: &Record) -> Vec<(Friction, Regression, f64)> {
    let gain = file.parameters.number("force_gain");
    let [training, pulses] = [training, pulses].map(|record| Motion::of(record, file.kind).unwrap());
    let one = |friction| {
        let fit = training.regression(friction, gain);
        let unseen = 100.0 * pulses.relative_error(friction, &fit.coefficients, gain);
        (friction, fit, unseen)
    };
    [Friction::Viscous, Friction::Coulomb, Friction::Offset, Friction::Asymmetric].map(one).to_vec()
}

#[test]
fn the_inverse_model_of_the_measured_axis_has_the_published_errors_step_by_step() {
    let file = plant("servo-axis", "");
    let (Some(training), Some(pulses)) = (emps("emps_train.csv", &file), emps("emps_test_pulses.csv", &file)) else { return };
    // Per cent on the pulse record, which no regression has used: 5.98 is published, the others are known to a tenth.
    let steps = [17.9, 8.2, 6.0, 5.4];
    let mut fits = Vec::new();
    for ((friction, fit, unseen), expected) in regressions(&file, &training, &pulses).into_iter().zip(steps) {
        println!(
            "EMPS {friction:?}: {:.2} % on the training record, {unseen:.2} % under the pulses",
            100.0 * fit.relative_error
        );
        // The treatment of the ends of a record by a decimation changes the result by a few hundredths, and is not published.
        assert!((unseen - expected).abs() < 0.1, "{friction:?}: {unseen}");
        fits.push(fit);
    }
    for (fit, published, error) in [(&fits[2], PUBLISHED[0], 4.0834), (&fits[3], PUBLISHED[1], 3.1117)] {
        // The same reason: the axis accelerates from rest in the first rows. These change the friction by 0.5 %, the offset by 0.6 % and the error
        // by 0.15 points.
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
    let by_inverse = regressions(&file, &training, &pulses);
    let rows = 2 * training.rows();
    let options = Options { threads: 2, progress: &|_| {} };
    let found = diagnose(&file, &[training], &[pulses], &options).unwrap();
    super::tell("EMPS, judged under the pulses", &found);
    // A repeated trajectory is not a duplicated block: all rows are used.
    assert!(found.findings.iter().all(|it| !it.what.contains("block")), "{:?}", found.findings);
    // One friction that includes the dry friction, the offset and the asymmetry; no stribeck-friction, no sensor, no gear.
    assert_eq!(super::kinds(&found), ["asymmetric-friction"]);
    let number = |name: &str| found.entries().next().unwrap().parameters.iter().find(|it| it.name == name).unwrap().value;
    // Published values, from the inverse model with filtered positions. A free run gives more weight to the slow rows: the two differ by 1.3 % here;
    // the limit is three times that.
    let published =
        [("forward", 20.1440), ("backward", 20.6277), ("viscous_forward", 166.7061), ("viscous_backward", 240.4236)];
    for (name, value) in published {
        assert!((number(name) / value - 1.0).abs() < 0.04, "{name} {}", number(name));
    }
    // No entry explains the motion under the pulses (a flexibility, according to the authors), so the verdict is not explained.
    assert_eq!(found.verdict, Verdict::Unexplained);
    // The errors of free run and inverse model decrease together, step by step: 8.2, 6.0 and 5.4 % with sharp signs, here with the rounded signs of
    // the plant.
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
    // The lines of docs/book/src/results/measured.md.
    let lines = [
        "| mass and viscous friction, calibrated | {} um | {} V | {} % | {} % |",
        "| and dry friction | {} um | {} V | {} % | {} % |",
        "| and a constant force | {} um | {} V | {} % (published: 5.98) | {} % |",
        "| asymmetric friction in place of both | {} um | {} V | {} % | {} % |",
    ];
    for ((line, step), (_, _, unseen)) in lines.iter().zip(&found.steps).zip(&by_inverse) {
        let (position, command) = (1e6 * step.errors[0].rmse, step.errors[1].rmse);
        prose::tells(line, &[position, command, *unseen, 100.0 * step.force_error.unwrap()]);
    }
    let friction = found.entries().next().unwrap();
    assert!(found.causes.is_empty() && found.helpers.len() == 1);
    prose::tells(
        "The verdict is `unexplained`, and `asymmetric-friction` helps: {} N and {} N s/m forward, {} N and {} N s/m backward",
        &["forward", "viscous_forward", "backward", "viscous_backward"].map(number),
    );
    let left = found.steps.last().unwrap().errors[0].noise_ratio;
    prose::tells("(confidence {}): the remaining error is {} times the encoder's noise floor.", &[friction.confidence, left]);
    // The energy that remains on the fitted records, in the unit of the ranking: squared standard deviations of the noise.
    let (next, would_take) = &found.remaining[0];
    assert!(*would_take < 0.05 * found.left.excess * rows as f64, "{next} {would_take} {}", found.left.excess);
    prose::tells(
        &format!("The next best effect of the catalogue (`{next}`) would remove less than a twentieth of the remaining error"),
        &[],
    );
}

#[test]
fn from_command_to_position_the_measured_axis_is_followed_within_the_published_errors() {
    let file = plant("emps-open", "");
    let Some(folder) = super::folder("emps") else { return };
    let record = |name: &str| Record::read(&Source::read(&folder.join(name)).unwrap(), &file).unwrap();
    let (training, test) = (record("emps_train.csv"), record("emps_test_pulses.csv"));
    assert_eq!(training.drive, Drive::Open);
    let found = free_run::axis_free_runs(&file, &training, &test).unwrap();
    // A linear state-space model has 5.5 mm on the test record, a network of transfer functions and nonlinearities 2.64 (M. Forgione, D. Piga,
    // dynoNet, 2021).
    let lines = [
        "| training record, all parameters and the initial state fitted to it | {} mm |",
        "| test record under pulses, all parameters from the training record, the initial state fitted | {} mm |",
        "| test record, viscous friction and initial state fitted to its first quarter (6.2 s) | {} mm |",
        "| the last three quarters of it, which no fit used | {} mm |",
    ];
    for (line, (_, error)) in lines.iter().zip(&found.errors) {
        prose::tells(line, &[1e3 * error]);
    }
    // The drift comes from the training record: without it the error of the same plant there is more than a millimetre.
    let mut still = file.clone();
    still.effects.retain(|it| it.description.kind != "load-drift");
    let without = free_run::fitted(&still, &[&training], [5e-8; rsm_sim::kind::OUTPUTS], 1).unwrap();
    let rows = 0..training.rows();
    let without = 1e3 * free_run::errors(&without.model, &training, rows).unwrap()[0];
    let number = |model: &Model, name: &str| model.file.effects.iter().find_map(|it| it.arguments.optional(name)).unwrap();
    prose::tells(
        "On the training record a load grows by {} N a second; without it the error is {} mm.",
        &[number(&found.trained, "force_rate"), without],
    );
    let warmer = |name: &str| 100.0 * (number(&found.today, name) / number(&found.trained, name) - 1.0);
    let mut higher = [warmer("viscous_forward"), warmer("viscous_backward")];
    higher.sort_by(f64::total_cmp);
    let [(before, speed), (after, _)] =
        ["emps_train.csv", "emps_test_pulses.csv"].map(|name| at_steady_speed(&file, name).unwrap());
    prose::tells(
        "On the test record viscous friction is {} to {} % higher ({} N in place of {} N move the axis forward at a steady {} m/s)",
        &[higher[0], higher[1], after, before, speed],
    );
}

/// The mean force of the drive while the reference moves forward at its steady speed, and that speed, in N and m/s.
fn at_steady_speed(file: &PlantFile, name: &str) -> Option<(f64, f64)> {
    let source = Source::read(&super::folder("emps")?.join(name)).unwrap();
    let numbers = ["t_s", "q_ref_m", "u_V"].map(str::to_string).to_vec();
    let table = Table::read(&source, &Wanted { numbers, ..Wanted::default() }).unwrap();
    let [time, reference, command] = ["t_s", "q_ref_m", "u_V"].map(|name| &table.column(name).unwrap().values);
    let speed = |row: usize| (reference[row + 1] - reference[row - 1]) / (time[row + 1] - time[row - 1]);
    let rows = 1..table.rows() - 1;
    let steady = rows.clone().map(speed).fold(0.0, f64::max);
    // The reference has seven digits: a difference over two rows has an error of at most 1e-4 m/s.
    let held: Vec<f64> = rows.filter(|row| (speed(*row) - steady).abs() < 1e-4).map(|row| command[row]).collect();
    let gain = file.parameters.number("force_gain");
    Some((gain * held.iter().sum::<f64>() / held.len() as f64, steady))
}
