//! The parts of a verdict by hand: shares, limits, numbers with their units, sentences.

use super::super::axis_under_steps;
use super::super::cause::Interval;
use super::super::levenberg;
use super::*;
mod whole;

use super::super::levenberg::Fit;
use super::super::search::AcceptedCause;
use super::cause_report::{estimate, unit};
use rsm_sim::effect::Subject;
use rsm_sim::equation_plant::{driveline, pmac, servo_axis};

#[test]
fn numbers_in_sentences_have_four_digits_and_their_unit() {
    let of =
        |value: f64, unit: &str| with_unit(&Interval { name: "x", value, low: value, high: value, unit: unit.to_string() });
    assert_eq!(of(8.04761, "N*m"), "8.048 N m");
    assert_eq!(of(1.0757, "1"), "1.076");
    assert_eq!(of(-4.2e-7, "m/s"), "-0.00000042 m/s");
    let limit = Interval { name: "high", value: 112.6, low: f64::NEG_INFINITY, high: f64::INFINITY, unit: "W".to_string() };
    assert_eq!(estimate(&limit), "112.6 W (not determined)");
}

#[test]
fn twice_the_noise_is_never_explained_however_wrong_the_plant_was() {
    // A plant that is wrong by 1000 times the noise may leave 0.5 of its energy; one that is wrong by 10^7 times no more than makes twice the noise
    // of the whole.
    assert_eq!(allowed_excess(0.0, 1e6), 0.5);
    assert_eq!(allowed_excess(OF_ROUNDING, 1.0), OF_ROUNDING);
    assert_eq!((1.0 + allowed_excess(0.0, 1e14)).sqrt(), 2.0);
}

#[test]
fn causes_that_leave_noise_stand_when_only_the_work_ran_out() {
    assert_eq!(verdict_of(false, None, false), Verdict::Explained);
    assert_eq!(verdict_of(false, None, true), Verdict::NoDiscrepancy);
    assert_eq!(verdict_of(false, Some(Limit::Work), false), Verdict::Explained);
    assert_eq!(verdict_of(true, Some(Limit::Work), false), Verdict::Unexplained);
    assert_eq!(verdict_of(false, Some(Limit::Cycle), false), Verdict::Unexplained);
}

#[test]
fn a_plant_in_order_gets_nothing_wrong_and_causes_are_practical_that_remove_nearly_all() {
    assert_eq!(mean_excess(900.0, 300), 2.0);
    // Less than the noise is not wrong; without rows there is no mean.
    assert_eq!([mean_excess(200.0, 300), mean_excess(3.0, 1), mean_excess(5.0, 0)], [0.0, 2.0, 4.0]);
    let of = |left: f64, wrong: f64| practical(left, wrong);
    assert_eq!(of(0.005, 10.0), Some(Practical { removed: 1.0 - 0.0005, left: 0.005 }));
    // A hundredth of the noise matters; a hair less does not.
    assert!(of(0.0099, 1e3).is_some());
    assert_eq!([of(FOR_PRACTICE, 1e3), of(0.015, 1e3)], [None, None]);
    // So does a thousandth of what was wrong.
    assert!(of(0.009, 9.1).is_some());
    assert_eq!([of(0.009, 8.9), of(0.005, 5.0), of(0.009, 0.0)], [None, None, None]);
    // A strong error hides more: three thousandths of it, and a tenth of the noise at most.
    assert!(of(0.049, 5e3).is_some() && of(0.051, 5e3).is_none());
    assert!(of(0.099, 1e6).is_some() && of(0.101, 1e6).is_none());
    // What is left may be below the noise by chance: all is gone, and not more.
    assert_eq!(of(-0.5, 10.0), Some(Practical { removed: 1.0, left: -0.5 }));
}

#[test]
fn a_step_is_known_to_the_digits_of_the_readings_or_to_what_their_changes_miss() {
    let (mut whitened, _) = axis_under_steps::whitened(&axis_under_steps::file("", ""), &axis_under_steps::file("", ""), false);
    let mut off = |values: &[f64]| {
        whitened.records[0].record.measured[0] = Some(values.to_vec());
        step_uncertainty(&whitened, 0, 0.25)
    };
    // Multiples to the last bit: the digits of the largest reading.
    assert_eq!(off(&[0.5, 0.25, -4.0, 1.0]), 16.0 * f64::EPSILON);
    // Changes of three steps that miss by 0.001, up or down, in the last pair; one that misses by 0.004 is no multiple.
    for last in [1.751, 1.749] {
        let miss = (last - 1.0 - 0.75_f64).abs();
        assert_eq!(off(&[1.0, 1.75, 1.0, last]), miss, "{last}");
    }
    assert_eq!(off(&[1.0, 1.754]), 4.0 * f64::EPSILON * 1.754);
    // A hundredth of a step is too far by a hair.
    assert_eq!(off(&[0.0, 0.0025]), 4.0 * f64::EPSILON * 0.0025);
    // Another output is not recorded.
    assert_eq!(step_uncertainty(&whitened, 1, 0.25), 0.0);
}

#[test]
fn rounding_is_a_cause_of_its_own_and_an_entry_of_the_file() {
    let found = rounding(servo_axis(), 0, 0.5, 0.125, 600.0).unwrap();
    let step = &found.parameters[0];
    assert_eq!((step.value, step.low, step.high, step.unit.as_str()), (0.5, 0.375, 0.625, "m"));
    assert_eq!((found.confidence, found.gain, found.rivals_tested), (0.99, 600.0, true));
    assert_eq!(found.subject.as_deref(), Some("position"));
    let entry = rounding_entry(servo_axis(), 0, 0.5).unwrap();
    assert_eq!((entry.description.kind, entry.arguments.subject.as_deref()), ("sensor-quantisation", Some("position")));
    assert_eq!(entry.arguments.numbers, [("step", 0.5)]);
}

#[test]
fn every_number_has_the_unit_of_what_it_stands_for() {
    let (motor, car, axis) = (pmac(), driveline(), servo_axis());
    let of = |kind: &str, plant, subject: Option<&str>, name: &str| {
        let fits = |it: &&rsm_sim::effect::Description| it.kind == kind && (it.at.is_none() || it.at == subject);
        let description = rsm_sim::equation_plant::effects_on(plant).into_iter().find(fits);
        unit(plant, description.expect("a kind"), subject, name)
    };
    for (kind, plant, subject, name, expected) in [
        ("windage", motor, None, "coefficient", "N*m*s^2/rad^2"),
        ("parameter-error", motor, Some("inertia"), "value", "kg*m^2"),
        ("parameter-error", axis, Some("mass"), "value", "kg"),
        ("sensor-gain", motor, Some("speed"), "gain", "1"),
        ("sensor-drift", motor, Some("speed"), "rate", "rad/s/s"),
        ("sensor-bias", motor, Some("i_q"), "bias", "A"),
        ("sensor-quantisation", axis, Some("position"), "step", "m"),
        ("backlash", car, None, "gap", "rad"),
        ("backlash", axis, None, "gap", "m"),
        ("backlash", axis, None, "mass_ratio", "1"),
        ("shaft-compliance", motor, None, "stiffness", "N*m/rad"),
        ("shaft-compliance", axis, None, "stiffness", "N/m"),
        ("shaft-compliance", motor, None, "damping", "N*m*s/rad"),
        ("shaft-compliance", axis, None, "damping", "N*s/m"),
        ("asymmetric-friction", motor, None, "viscous_forward", "N*m*s/rad"),
        ("asymmetric-friction", axis, None, "viscous_backward", "N*s/m"),
        ("stribeck-friction", motor, None, "stribeck_velocity", "rad/s"),
        ("stribeck-friction", axis, None, "stribeck_velocity", "m/s"),
        ("stribeck-friction", motor, None, "static", "N*m"),
        ("stribeck-friction", axis, None, "coulomb", "N"),
    ] {
        assert_eq!(of(kind, plant, subject, name), expected, "{kind} {plant:?} {name}");
    }
}

/// An axis with effects, fitted to a record of its own.
fn fitted(effects: &str, tolerances: &str) -> Fit {
    let file = axis_under_steps::file(tolerances, effects);
    let (whitened, nominal) = axis_under_steps::whitened(&axis_under_steps::file(tolerances, ""), &file, true);
    let model = nominal.with_effects(&nominal, file.effects.clone());
    levenberg::fit(&whitened, model, 8).unwrap()
}

fn named(fit: &Fit, place: usize) -> Cause {
    let accepted = AcceptedCause {
        label: String::new(),
        gain: 7.0,
        rivals: Vec::new(),
        aliases_not_fitted: Vec::new(),
        rival_models: Vec::new(),
        rivals_tested: true,
        without: fit.model.clone(),
    };
    cause(fit, place, &accepted, Vec::new(), Probability::plain(0.5), None)
}

#[test]
fn a_cause_is_told_in_its_sentence_with_the_numbers_of_its_own_entry() {
    let two = axis_under_steps::friction(0.8)
        + "[[effects]]\nkind = \"sensor-drift\"\nparameters = { output = \"position\", rate = 0.01 }\n";
    let fit = fitted(&two, "mass = 0.02");
    let friction = named(&fit, 0);
    let [force] = &friction.parameters[..] else { panic!("{:?}", friction.parameters) };
    // The name of the other plant's number is left out of the sentence.
    assert_eq!(friction.sentence, format!("A dry friction of {} is missing from the model.", with_unit(force)));
    assert_eq!((force.name, force.unit.as_str(), friction.kind, friction.gain), ("force", "N", "coulomb-friction", 7.0));
    // Its own interval, which holds the truth and is no point.
    assert!(force.low < force.value && force.value < force.high && force.low < 0.8 && force.high > 0.8, "{force:?}");
    let drift = named(&fit, 1);
    assert_eq!(drift.sentence, format!("The sensor of position drifts by {}.", with_unit(&drift.parameters[0])));
    assert_eq!((drift.subject.as_deref(), drift.of), (Some("position"), Subject::Output));
    let error = "[[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"mass\", value = 2.1 }\n";
    let mass = named(&fitted(error, ""), 0);
    assert_eq!(
        mass.sentence,
        format!("The parameter mass is {}, not what the plant file says.", with_unit(&mass.parameters[0]))
    );
}

#[test]
fn causes_are_told_by_their_gain() {
    assert_eq!(by_gain(&[2.0, 5.0, 1.0, 3.0]), [1, 3, 0, 2]);
}

#[test]
fn rounding_may_leave_something_where_one_floor_does_not_know_it() {
    let plain = NoiseFloor::white(0.1);
    let known = NoiseFloor { rounding: Some(super::super::rounding::Rounding { step: 0.3, noise: 0.1 }), ..plain };
    let slow = NoiseFloor { correlation: 0.2, ..known };
    assert_eq!(of_rounding([].into_iter()), 0.0);
    assert_eq!(of_rounding([&known, &known].into_iter()), 0.0);
    for one in [&plain, &slow] {
        assert_eq!(of_rounding([&known, one].into_iter()), OF_ROUNDING);
    }
}

#[test]
fn what_is_left_counts_where_it_is_beyond_what_is_allowed_and_matters() {
    // So much is allowed.
    assert_eq!(remaining_structure(0.5, 0.5, 1e6, false), (false, None));
    assert_eq!(remaining_structure(0.6, 0.5, 1e6, false), (true, None));
    // Little beside much that is gone; without a cause nothing is gone.
    assert_eq!(remaining_structure(0.005, 1e-9, 10.0, false), (false, Some(Practical { removed: 1.0 - 0.0005, left: 0.005 })));
    assert_eq!(remaining_structure(0.005, 1e-9, 10.0, true), (true, None));
    // What is allowed needs no excuse.
    assert_eq!(remaining_structure(0.005, 0.005, 10.0, false), (false, None));
}

#[test]
fn what_the_law_shows_is_as_sure_as_what_has_nothing_against_it() {
    let sure = |own: f64, by_law| with_known_law(Probability { own, of_any: 0.99 }, by_law);
    assert_eq!([sure(0.3, false).own, sure(-0.1, false).own], [0.3, 0.0]);
    assert_eq!([sure(0.3, true).own, sure(0.985, true).own], [confidence::EXPLAINED, 0.985]);
    assert_eq!(sure(0.3, true).of_any, 0.99);
}

#[test]
fn beside_structure_only_probable_causes_are_named() {
    assert!(is_named(Verdict::Explained, 0.1) && is_named(Verdict::NoDiscrepancy, 0.1));
    assert!(is_named(Verdict::Unexplained, LEAST_CONFIDENCE) && is_named(Verdict::Unexplained, 0.9));
    assert!(!is_named(Verdict::Unexplained, 0.499));
}

#[test]
fn new_ones_take_the_place_of_those_of_the_same_name() {
    let mut list = vec![("gain", 1), ("bias", 2), ("gain", 3)];
    replace(&mut list, vec![("gain", 10), ("drift", 11)], |it| it.0);
    assert_eq!(list, [("bias", 2), ("gain", 10), ("drift", 11)]);
}

fn accepted(label: &str, gain: f64, rivals: &[(&str, f64)], model: &Model) -> AcceptedCause {
    AcceptedCause {
        label: label.to_string(),
        gain,
        rivals: rivals.iter().map(|(name, behind)| (name.to_string(), *behind)).collect(),
        aliases_not_fitted: Vec::new(),
        rival_models: Vec::new(),
        rivals_tested: true,
        without: model.clone(),
    }
}

#[test]
fn rivals_are_alike_that_do_worse_by_less_than_decides() {
    // What decides, or a hundred-thousandth of the gain.
    assert_eq!([effect_size::equal(30.0, 1e6), effect_size::equal(30.0, 5e6)], [30.0, 1e-5 * 5e6]);
    let (_, nominal) = axis_under_steps::whitened(&axis_under_steps::file("", ""), &axis_under_steps::file("", ""), false);
    let fitted = [("asymmetric-friction", 1.0), ("near", 29.0), ("at the limit", 30.0), ("far", 900.0), ("nearer", 2.0)];
    let mut one = accepted("coulomb-friction", 1e6, &fitted, &nominal);
    one.aliases_not_fitted = vec!["far".to_string(), "same trace".to_string()];
    let [mut first, mut second, third] = [0; 3].map(|_| nominal.clone());
    first.file.effects = axis_under_steps::file("", &axis_under_steps::friction(1.0)).effects;
    second.file.effects = axis_under_steps::file("", &axis_under_steps::friction(2.0)).effects;
    one.rival_models = [("far", third), ("nearer", first.clone()), ("near", second.clone())]
        .map(|(name, model)| (name.to_string(), model))
        .to_vec();
    // Friction that differs by direction holds dry friction as its special case, and is no rival of it.
    let one = rivals::without_general(&one);
    assert_eq!(one.rivals.iter().map(|it| it.0.as_str()).collect::<Vec<_>>(), ["near", "at the limit", "far", "nearer"]);
    // Of the same trace the one that was fitted and does worse is distinguished.
    assert_eq!(rivals::equal_rivals(&one, 30.0), ["near", "nearer", "same trace"]);
    let aliases = rivals::aliases(&one, 30.0);
    let told: Vec<_> = aliases.iter().map(|it| (it.cause.as_str(), it.rival.as_str(), it.limit)).collect();
    assert_eq!(told, [("coulomb-friction", "near", 30.0), ("coulomb-friction", "nearer", 30.0)]);
    for (alias, model) in aliases.iter().zip([second, first]) {
        assert_eq!(alias.model.file.effects[0].arguments, model.file.effects[0].arguments);
    }
}

#[test]
fn outputs_are_told_once_and_noise_that_grows_with_its_ends() {
    let file = axis_under_steps::file("", "");
    let (mut whitened, _) = axis_under_steps::whitened(&file, &file, false);
    let mut second = whitened.records[0].clone();
    second.record.measured = vec![Some(vec![1.0, -3.0, 2.0]), Some(vec![0.5, 0.25])];
    second.outputs = vec![1, 0];
    whitened.records.push(second);
    let mut first = whitened.records.remove(0);
    first.record.measured[0] = Some(vec![0.0, 2.5]);
    whitened.records.push(first);
    assert_eq!(outputs(&whitened), [0, 1]);
    assert_eq!(growing(&whitened, &[0, 1]), []);
    // By a half a unit of the reading.
    let growth = super::super::growth::Growth { rate: 0.5, sum: true, norm: 1.0, largest: 3.0 };
    whitened.floors[0] = NoiseFloor { growth: Some(growth), ..NoiseFloor::white(0.1) };
    assert_eq!(growing(&whitened, &[0, 1]), [(0, 0.1, 0.1 * 2.5)]);
    whitened.floors[1] = NoiseFloor { growth: Some(growth), ..NoiseFloor::white(0.2) };
    assert_eq!(growing(&whitened, &[0, 1]), [(0, 0.1, 0.1 * 2.5), (1, 0.2, 0.2 * 1.25)]);
    assert_eq!(growing(&whitened, &[1]), [(1, 0.2, 0.2 * 1.25)]);
}
