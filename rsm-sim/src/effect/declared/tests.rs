//! Units and parts of declarations, compared with values worked out by hand.

use super::*;
use crate::equation_plant::pmac;

#[test]
fn a_unit_is_that_of_the_body_or_of_what_is_named() {
    let on = |unit: Unit, plant: PlantKind, subject: Option<&str>| unit.on(plant, subject);
    assert_eq!(on(Unit::Is("s"), pmac(), None), "s");
    let [rotor, carriage] = [pmac(), crate::equation_plant::servo_axis()];
    let cases = [
        (Unit::Effort, "N*m", "N"),
        (Unit::EffortPerSpeed, "N*m*s/rad", "N*s/m"),
        (Unit::Stiffness, "N*m/rad", "N/m"),
        (Unit::Speed, "rad/s", "m/s"),
    ];
    for (unit, of_rotor, of_carriage) in cases {
        assert_eq!([on(unit, rotor, None), on(unit, carriage, None)], [of_rotor, of_carriage]);
    }
    assert_eq!([crate::equation_plant::driveline(), carriage].map(|plant| on(Unit::Gap, plant, None)), ["rad", "m"]);
    // An output, a parameter, and no subject.
    assert_eq!(on(Unit::OfSubject, carriage, Some("position")), "m");
    assert_eq!(on(Unit::OfSubjectPerSecond, carriage, Some("position")), "m/s");
    assert_eq!(on(Unit::OfSubject, carriage, Some("mass")), "kg");
    assert_eq!(on(Unit::OfSubject, rotor, Some("inertia")), "kg*m^2");
    assert_eq!(on(Unit::OfSubject, carriage, None), "1");
}

#[test]
fn a_part_is_an_entry_with_the_one_number_of_its_effect() {
    for (plant, name) in [(pmac(), "torque"), (crate::equation_plant::servo_axis(), "force")] {
        let entry = Part::new("coulomb-friction", 2.5).entry(plant).unwrap();
        assert_eq!((entry.description.kind, entry.arguments.numbers), ("coulomb-friction", vec![(name, 2.5)]));
    }
    // For an effect with several numbers, the value is that of the first number.
    assert_eq!(Part::new("backlash", 0.1).entry(crate::equation_plant::servo_axis()).unwrap().arguments.numbers, [("gap", 0.1)]);
    assert!(Part::new("no-such-effect", 1.0).entry(pmac()).is_none());
}
