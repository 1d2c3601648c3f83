//! What the macro makes of a good file, and what cargo and the compiler say about a bad, a mended and an edited one.

mod cargo_project;
mod edited;
mod guide;
mod refused;
#[path = "../../../tests/src/refused.rs"]
mod refused_files;

rsm_macros::include_model!("tests/models/two_inputs.toml");

mod only_f32 {
    rsm_macros::include_model!("tests/models/two_inputs.toml", precision = "f32");
}

mod only_f64 {
    rsm_macros::include_model!("tests/models/two_inputs.toml", precision = "f64",);
}

mod as_far_as_it_goes {
    rsm_macros::include_model!("tests/models/too_large.toml");
}

mod with_gradient {
    rsm_macros::include_model!("tests/models/two_inputs.toml", gradient = true, precision = "f64");
}

mod following {
    rsm_macros::include_model!(
        "tests/models/two_inputs.toml",
        recursive = "angle",
        noise = 0.5,
        forgetting = 1,
        precision = "f64"
    );
}

#[test]
fn a_surface_follows_measured_responses() {
    use following::two_inputs::{angle, angle_adapted, angle_init, angle_update};
    let mut state = angle_init();
    let [error, _, frozen] = angle_update(&mut state, 1.5, 0.5, angle(1.5, 0.5) + 1.0);
    // The noise is 0.5: an error of two standard deviations is taken, and the surface moves towards it. A division by the half range in place of a
    // product with its inverse rounds the error.
    assert!((error - 1.0).abs() < 1e-12 && frozen == 0.0);
    assert!(angle_adapted(&state, 1.5, 0.5) > angle(1.5, 0.5) + 0.1);
    assert_eq!(angle_update(&mut state, 1.5, 0.5, 100.0)[2], 3.0);
}

#[test]
fn gradients_come_where_they_are_wanted() {
    // By differences in the middle of the box, where the surface is smooth: a step of 2^-10 leaves less than 10^-6 of its curvature.
    let (torque, speed, step) = (1.25, 0.75, 2f64.powi(-10));
    let value = with_gradient::two_inputs::angle;
    let found = with_gradient::two_inputs::angle_gradient(torque, speed);
    let by_torque = (value(torque + step, speed) - value(torque - step, speed)) / (2.0 * step);
    let by_speed = (value(torque, speed + step) - value(torque, speed - step)) / (2.0 * step);
    assert!((found[0] - by_torque).abs() < 1e-6 && (found[1] - by_speed).abs() < 1e-6, "{found:?} {by_torque} {by_speed}");
    assert!(found[0] != 0.0 && found[1] != 0.0);
}

#[test]
fn the_module_holds_the_evaluators_of_both_precisions() {
    // Torque 2 is x1 = 1, speed 0.5 is x2 = 0.5: 1.5 - 0.25 * 0.5.
    assert_eq!(two_inputs::angle(2.0, 0.5), 1.375);
    assert_eq!(two_inputs::angle_f32(2.0, 0.5), 1.375);
    assert_eq!(only_f32::two_inputs::angle_f32(2.0, 0.5), 1.375);
    assert_eq!(only_f64::two_inputs::angle(2.0, 0.5), 1.375);
    // f32 cannot hold this one, and was not asked for by name.
    assert_eq!(as_far_as_it_goes::too_large::angle(1.0, 0.5), 1e300);
}
