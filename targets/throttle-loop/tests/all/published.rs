//! The published surface (32), as it is shipped.

use throttle_loop::published::throttle::damping_ratio;

#[test]
fn the_damping_is_that_of_the_paper() {
    // (32) at x1 = -1 (10 mph), x2 = 0 (third gear): 0.4079 + 0.804 + 0.0519 = 1.2638. Three sums of numbers near 1 in f64, 1.1e-16 each.
    assert!((damping_ratio(10.0, 3.0) - 1.2638).abs() < 1e-15);
    // x1 = 0, x2 = 1 (fifth gear): 0.4079 + 0.3809 - 0.0429 = 0.7459.
    assert!((damping_ratio(40.0, 5.0) - 0.7459).abs() < 1e-15);
    // x1 = 0, x2 = -1 (first gear): 0.4079 - 0.3809 - 0.0429 = -0.0159: no driveline has that.
    assert!(damping_ratio(40.0, 1.0) < 0.0);
}

#[test]
fn the_misprint_shows_on_a_quarter_of_its_box() {
    let points = (1..=5).flat_map(|gear| (10..=70).map(move |speed| damping_ratio(f64::from(speed), f64::from(gear))));
    let negative = points.filter(|ratio| *ratio <= 0.0).count();
    assert!((40..=120).contains(&negative), "{negative} of 305");
}
