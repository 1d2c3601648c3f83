//! The damping surface follows a car that wears.

use throttle_loop::driveline::{damping_ratio_f32, damping_ratio_support_f32};
use throttle_loop::wear::Wear;

/// Numbers from 0 to 1 that fill the interval evenly (the golden section).
fn share(k: u16, turns: f32) -> f32 {
    (f32::from(k) * turns).fract()
}

#[test]
fn the_surface_follows_a_car_that_loses_a_third_of_its_damping() {
    let mut wear = Wear::new();
    let (mut with, mut without, mut used) = (0.0_f32, 0.0_f32, 0);
    for k in 0..400 {
        let (speed, gear) = (5.0 + 40.0 * share(k, 0.618_034), 1 + (5.0 * share(k, 0.414_214)) as u8);
        let left = 1.0 - f32::from(k) / 1200.0;
        // The shown damping has an error of 0.01 in turn.
        let noise = if k % 2 == 0 { 0.01 } else { -0.01 };
        let file = damping_ratio_f32(speed, f32::from(gear));
        let truth = left * file;
        if k >= 300 && damping_ratio_support_f32(speed, f32::from(gear)) == 1 {
            with = with.max((wear.damping_ratio(speed, gear) - truth).abs());
            without = without.max((file - truth).abs());
        }
        let update = wear.measured(speed, gear, truth + noise);
        // Some gears have no such speed: these points are outside the support.
        assert!(update.frozen == 0.0 || update.frozen == 2.0, "{k} {update:?}");
        used += u32::from(update.frozen == 0.0);
    }
    // A memory of 50 rows for 15 coefficients has errors of 0.01 sqrt(15/50), and is behind by 50 rows: a twenty-fourth of the damping.
    assert!(without > 0.05 && with < 0.5 * without, "{with} {without}");
    assert!(used > 200, "{used}");
}

#[test]
fn a_bad_value_changes_no_bit() {
    let mut wear = Wear::new();
    wear.measured(10.0, 2, 0.2);
    let before = wear.damping_ratio(20.0, 3).to_bits();
    for (speed, gear, damping, frozen) in
        [(f32::NAN, 2, 0.2, 1.0), (10.0, 2, f32::INFINITY, 1.0), (90.0, 2, 0.2, 2.0), (10.0, 9, 0.2, 2.0), (10.0, 2, 3.0, 3.0)]
    {
        assert_eq!(wear.measured(speed, gear, damping).frozen, frozen, "{speed} {gear} {damping}");
        assert_eq!(wear.damping_ratio(20.0, 3).to_bits(), before);
    }
}
