//! The bench: its points lie where the circle diagram says.

use rsm_rigs::bench::{Bench, Outcome, Setting, csv};
use rsm_rigs::motor::circle_diagram::CircleDiagram;

use super::motor;

fn settings() -> Vec<Setting> {
    let points =
        [(10.0, 20.0), (40.0, 50.0), (70.0, 40.0), (100.0, 0.0), (100.0, 40.0), (70.0, 140.0), (100.0, 170.0), (100.0, 90.0)];
    (1..).zip(points).map(|(run, (depth, advance))| Setting { run, depth, advance }).collect()
}

#[test]
fn measured_points_lie_on_the_circle_diagram() {
    let bench = Bench::default();
    let known = bench.drive.known(&motor());
    let diagram = CircleDiagram::new(known);
    let outcomes = bench.run(&motor(), &settings(), 3).unwrap();
    for outcome in &outcomes[..7] {
        let Outcome::AtLimit(point) = outcome else { panic!("{outcome:?}") };
        let Setting { depth, advance, .. } = point.setting;
        let length = depth / 100.0 * known.current_limit;
        // Five standard errors of a mean of 200 readings with 0.2 A.
        let wanted = (-length * advance.to_radians().sin(), length * advance.to_radians().cos());
        assert!((point.i_d - wanted.0).abs() < 0.08 && (point.i_q - wanted.1).abs() < 0.08, "{point:?}");
        // The weakening current that the diagram wants at the measured torque and speed is the one that was set. 0.83 rad/s was the largest error
        // of speed in 180 runs; 0.1 A a rad/s where the limit is steepest makes 0.1 A of it, and the reading's own error comes on top.
        let solved = diagram.solve(point.torque, point.speed, known.reference_voltage(known.bus_voltage));
        assert!((solved.i_d_a - point.i_d).abs() < 0.25, "{point:?} {solved:?}");
        // The flange is short of the air gap by friction, b w. The search moves the speed by some tenths of a rad/s in the window of 0.2 s, and 0.06
        // kg m^2 take 0.3 N m for each 1 rad/s of it.
        assert!((point.torque - point.shaft_torque - 0.001 * point.speed).abs() < 0.3, "{point:?}");
    }
    // 60 A along d all but cancel the flux: no dynamometer of this speed finds the limit, and the table says so instead of a row.
    assert!(matches!(outcomes[7], Outcome::BelowLimit(point) if point.speed > 849.0));
    let text = csv(&outcomes);
    assert_eq!(text.lines().filter(|line| !line.starts_with('#')).count(), 8, "{text}");
    assert!(text.contains("# run 8: depth 100 %, advance 90 deg"), "{text}");
}

#[test]
fn a_run_is_the_same_in_any_plan_and_another_with_another_seed() {
    let (bench, all) = (Bench::default(), settings());
    let one = bench.one(&motor(), all[1], 3).unwrap();
    assert_eq!(bench.run(&motor(), &all[1..4], 3).unwrap()[0], one);
    assert_ne!(bench.one(&motor(), all[1], 4).unwrap(), one);
}

#[test]
fn a_drive_that_loses_its_current_is_switched_off_and_the_other_runs_count() {
    // At 60 A the inductance is down to 0.52 mH, and falls with every further ampere: current control made for 0.9 mH loses it where the motor
    // brakes.
    let saturating = crate::plant("pmac", &crate::effect("magnetic-saturation", "saturation_current = 70.0"));
    let settings = [(1, 70.0, 0.0), (2, 100.0, 120.0)].map(|(run, depth, advance)| Setting { run, depth, advance });
    let outcomes = Bench::default().run(&saturating, &settings, 3).unwrap();
    assert!(matches!(outcomes[..], [Outcome::AtLimit(_), Outcome::Tripped(setting)] if setting.run == 2), "{outcomes:?}");
    assert!(csv(&outcomes).contains("# run 2: depth 100 %, advance 120 deg: more than twice the current limit"));
    // Nothing that is measured at all is no experiment.
    let refused = Bench::default().run(&saturating, &settings[1..], 3).unwrap_err().to_string();
    assert!(refused.contains("every run ends with more than twice the current limit"), "{refused}");
}
