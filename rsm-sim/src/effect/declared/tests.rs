//! Units and parts of declarations, compared with values worked out by hand.

use super::*;
use crate::equation_plant::{pmac, servo_axis};

#[test]
fn a_unit_is_fixed_or_that_of_the_named_parameter() {
    assert_eq!(Unit::Is("s").on(pmac(), None), "s");
    assert_eq!(Unit::OfSubject.on(servo_axis(), Some("mass")), "kg");
    assert_eq!(Unit::OfSubject.on(pmac(), Some("inertia")), "kg*m^2");
    assert_eq!(Unit::OfSubject.on(servo_axis(), None), "1");
}

#[test]
fn a_part_is_an_entry_with_the_one_number_of_its_effect() {
    let part = |kind, value| Part { kind, subject: None, value };
    for (plant, name) in [(pmac(), "torque"), (servo_axis(), "force")] {
        let entry = part("coulomb-friction", 2.5).entry(plant).unwrap();
        assert_eq!((entry.description.kind, entry.arguments.numbers), ("coulomb-friction", vec![(name, 2.5)]));
    }
    // For an effect with several numbers, the value is that of the first number.
    assert_eq!(part("backlash", 0.1).entry(servo_axis()).unwrap().arguments.numbers, [("gap", 0.1)]);
    assert!(part("no-such-effect", 1.0).entry(pmac()).is_none());
}
