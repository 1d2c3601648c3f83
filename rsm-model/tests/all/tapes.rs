//! Tapes compute the same as programs, their derivatives agree with finite differences, and the listing shows what was understood.

use rsm_core::run::Interpreter;
use rsm_core::tangent::{Variable, tangent};

use crate::simulator::system;

const MODELS: [&str; 12] =
    ["axis", "two-inertias", "quoted", "gear-train", "rlc", "tank", "thermal", "pitch", "cylinder", "ball", "sampled", "diode"];

/// Pseudo-random numbers between 0.2 and 1.2: a linear congruential generator (D. E. Knuth's MMIX).
fn numbers(count: usize) -> Vec<f64> {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.2 + (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..count).map(|_| next()).collect()
}

#[test]
fn a_tape_computes_what_the_program_computes_and_its_tangent_the_slopes() {
    for name in MODELS {
        let system = system(name);
        let mut arguments = system.states().to_vec();
        arguments.extend(system.inputs());
        arguments.extend(system.switches().iter().map(|switch| switch.held));
        arguments.extend(system.memories().iter().map(|memory| memory.held));
        arguments.extend(system.iterated().iter().map(|it| it.guess));
        let varied = arguments.len();
        arguments.extend(system.parameters());
        let rates = system.rates();
        let program = system.program(&arguments, &rates).unwrap();
        let named: Vec<_> = rates.iter().enumerate().map(|(k, id)| (format!("r{k}"), *id)).collect();
        let tape = system.tape("rates", &arguments, &named, &mut |_, _, _, _| None).unwrap();
        let slopes = tangent(&tape, &[Variable::Input(0)]);
        let mut at = numbers(varied);
        at.extend(system.parameters().iter().map(|parameter| system.parameter_value(*parameter).unwrap()));
        let values = |at: &[f64]| program.values(at, &|_, _, _| f64::NAN);
        let wanted = values(&at);
        let mut found = vec![0.0; 2 * rates.len()];
        Interpreter::<f64>::new(&slopes).eval_all(&at, &mut found);
        for (k, wanted) in wanted.iter().enumerate() {
            // The operations are the same; functions differ by one or two units in the last place.
            assert!((found[k] - wanted).abs() <= 1e-12 * wanted.abs().max(1e-6), "{name} {k}: {} {wanted}", found[k]);
        }
        let (mut above, mut below) = (at.clone(), at.clone());
        above[0] += 1e-5;
        below[0] -= 1e-5;
        let (above, below) = (values(&above), values(&below));
        for k in 0..rates.len() {
            let difference = (above[k] - below[k]) / 2e-5;
            let exact = found[rates.len() + k];
            // The rounding of the values divided by the step, and the third derivative times the square of the step.
            let scale = exact.abs().max(1e-4 * wanted[k].abs()).max(1.0);
            assert!((exact - difference).abs() <= 1e-5 * scale, "{name} {k}: {exact} {difference}");
        }
    }
}

#[test]
fn the_listing_says_what_was_understood() {
    let text = system("gear-train").to_string();
    for line in [
        "model Mech_GearTrain",
        "  motor.phi[rad]  starts at 0, fixed",
        "  torque[N.m]",
        "  speed[rad/s]",
        "  motor.J[kg.m2]  = 0.1  inertia",
        ", a linear block",
        "  source.tau = torque",
        "equations; 2 contain a variable without a unit",
    ] {
        assert!(text.contains(line), "{line} is missing in\n{text}");
    }
}

#[test]
fn a_given_output_takes_the_place_of_its_start() {
    let mut system = system("two-inertias");
    let speed = system.find("speed").unwrap();
    let start = system.start(&[speed], &[]).unwrap();
    // The output is another name for the speed of the load, whose own start is fixed: the given value is used.
    let load = start.values.iter().find(|(symbol, _)| system.name(*symbol) == "load.w").unwrap();
    assert_eq!(system.text(load.1), "speed");
    let twist = system.find("shaft.twist").unwrap();
    // Both angles are fixed. Whether they agree with the given twist can be checked when it is known.
    assert_eq!(system.start(&[twist], &[]).unwrap().redundant.len(), 1);
    let mut axis = crate::simulator::system("axis");
    let position = axis.find("position").unwrap();
    let start = axis.start(&[position], &[]).unwrap();
    let of = |name: &str| start.values.iter().find(|(symbol, _)| axis.name(*symbol) == name).map(|(_, id)| axis.text(*id));
    assert_eq!((of("position"), of("speed")), (Some("position".to_string()), Some("0".to_string())));
}
