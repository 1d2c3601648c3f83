//! The behaviour of the plants in the loops, without a clock: short versions of the runs.

#[test]
fn the_motor_goes_up_through_flux_weakening_and_down_again() {
    let (figures, times) = host_runners::motor::simulate(2.5);
    println!("{figures:?}, {times:.0} times real time");
    // Turned back at 750 rad/s by the encoder; 8 N m on 0.01 kg m^2 are 0.8 rad/s a tick, and a coarse encoder is a few ticks late.
    assert!((748.0..=760.0).contains(&figures.highest_speed_rad_s), "{figures:?}");
    assert!(figures.most_weakening_a > 5.0, "the weakening region was not reached: {figures:?}");
    // The limit of 60 A is never reached by 8 N m, with a tenth for transients.
    assert!(figures.longest_current_a < 66.0, "{figures:?}");
    // 5 % of the demand: two reversals of 16 N m, each a few milliseconds of 2500, are 0.05 N m of it.
    assert!(figures.torque_error_nm < 0.4, "{figures:?}");
}

#[test]
fn the_throttle_follows_its_pedal_without_a_bump() {
    let (figures, times) = host_runners::throttle::simulate(8.0);
    println!("{figures:?}, {times:.0} times real time");
    // 60 % of throttle in second gear, and what a shuffle adds.
    assert!((1.0..=6.0).contains(&figures.highest_acceleration), "{figures:?}");
    assert!(figures.most_compensated > 0.02, "the compensator did nothing: {figures:?}");
    // The pedal itself steps by 0.5.
    assert!(figures.largest_step < 0.52, "{figures:?}");
}
