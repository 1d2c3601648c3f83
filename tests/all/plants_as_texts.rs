//! The shipped plants as texts give the rates of the plants in Rust, at points without a pattern and without effects.

use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_model::flat::{Flat, Options};
use rsm_model::shipped;
use rsm_model::system::System;
use rsm_sim::hooks::Hooks;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::plants::Plant;
use rsm_sim::plants::driveline::Driveline;
use rsm_sim::plants::pmac::Pmac;
use rsm_sim::plants::servo_axis::ServoAxis;
use rsm_tests::cases;

fn plant_file(name: &str) -> PlantFile {
    let path = cases::root().join("rsm-sim/plants").join(format!("{name}.toml"));
    PlantFile::read(&Source::read(&path).unwrap()).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Numbers between -1 and 1 without a pattern: a linear congruence (D. E. Knuth's MMIX).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Compares rates and outputs at a hundred points. `states` are the names in the text, in the order of the plant in Rust, each with its typical size.
fn compare<P: Plant>(
    plant: &P,
    hooks: &Hooks,
    system: &mut System,
    states: &[(&str, f64)],
    inputs: &[(&str, f64)],
    outputs: &[&str],
) {
    let symbols = |system: &System, names: &[(&str, f64)]| -> Vec<_> {
        names.iter().map(|(name, _)| system.find(name).unwrap_or_else(|| panic!("{name}"))).collect()
    };
    let mut arguments = symbols(system, states);
    arguments.extend(symbols(system, inputs));
    arguments.extend(system.parameters());
    let mut results = Vec::new();
    for (name, _) in states {
        let rate = system.find(&format!("der({name})")).unwrap();
        results.push((format!("der({name})"), system.value(rate)));
    }
    for name in outputs {
        let symbol = system.find(name).unwrap();
        results.push(((*name).to_string(), system.value(symbol)));
    }
    let tape = system.tape("rates", &arguments, &results, &mut |_, _, _, _| None).unwrap();
    let mut evaluator = Interpreter::<f64>::new(&tape);
    let mut numbers = Numbers(7);
    for _ in 0..100 {
        let x: Vec<f64> = states.iter().map(|(_, size)| size * numbers.next()).collect();
        let mut u = [0.0; 3];
        for (u, (_, size)) in u.iter_mut().zip(inputs) {
            *u = size * numbers.next();
        }
        let mut at = x.clone();
        at.extend(&u[..inputs.len()]);
        at.extend(system.parameters().iter().map(|parameter| system.parameter_value(*parameter).unwrap()));
        let mut found = vec![0.0; results.len()];
        evaluator.eval_all(&at, &mut found);
        let (mut rates, mut read) = (vec![0.0; states.len()], [0.0; 3]);
        plant.evaluate(hooks, None, &u, &x, &mut rates, &mut read);
        for (k, wanted) in rates.iter().chain(&read[..outputs.len()]).enumerate() {
            // Sums of a handful of terms, in two orders; terms of large torques cancel to rates of some thousand 1/s^2.
            let tolerance = 1e-10 * wanted.abs().max(1e2);
            assert!((found[k] - wanted).abs() <= tolerance, "{}: {}, in Rust {wanted}", results[k].0, found[k]);
        }
    }
}

/// A shipped text with the values of a plant file.
fn system(name: &str, file: &PlantFile, more: &[(&str, f64)]) -> System {
    let source = shipped::text(name).unwrap();
    let mut parameters: Vec<(String, f64)> = more.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
    let text = Flat::read(&source, &Options::default()).unwrap_or_else(|faults| panic!("{faults}"));
    for variable in &text.variables {
        if variable.role == rsm_model::flat::Role::Parameter
            && let Some(value) = file.parameters.optional(&variable.name)
        {
            parameters.push((variable.name.clone(), value));
        }
    }
    assert!(parameters.len() > 3);
    let flat = Flat::read(&source, &Options { parameters, ..Options::default() }).unwrap_or_else(|faults| panic!("{faults}"));
    System::new(&flat).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn the_motor() {
    let file = plant_file("pmac");
    let hooks = Hooks::new(&file, Pmac::STATES);
    let states = [("current_d", 50.0), ("current_q", 50.0), ("speed", 700.0), ("angle", 3.0)];
    let inputs = [("v_d", 100.0), ("v_q", 100.0), ("load_torque", 20.0)];
    let mut text = system("pmac", &file, &[]);
    compare(&Pmac::new(&file.parameters, &hooks, false), &hooks, &mut text, &states, &inputs, &["i_d", "i_q", "speed"]);
}

#[test]
fn the_driveline_in_each_gear() {
    let file = plant_file("driveline");
    let hooks = Hooks::new(&file, Driveline::STATES);
    let states = [
        ("engine_torque", 200.0),
        ("engine_angle", 1.0),
        ("engine_speed", 500.0),
        ("shaft_angle", 1.0),
        ("shaft_speed", 300.0),
        ("wheel_angle", 1.0),
        ("wheel_speed", 90.0),
    ];
    for gear in 1..=5 {
        let mut text = system("driveline", &file, &[("gear", gear as f64)]);
        let outputs = ["engine_speed", "road_speed", "acceleration"];
        compare(&Driveline::new(&file.parameters, gear), &hooks, &mut text, &states, &[("throttle", 1.0)], &outputs);
    }
}

#[test]
fn the_driveline_starts_from_its_road_speed_alone() {
    let file = plant_file("driveline");
    let mut text = system("driveline", &file, &[("gear", 2.0)]);
    let road_speed = text.find("road_speed").unwrap();
    let start = text.start(&[road_speed], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    assert!(start.iterated.is_empty() && start.redundant.is_empty());
    let mut arguments = vec![road_speed, text.find("throttle").unwrap()];
    arguments.extend(text.parameters());
    let results: Vec<_> = start.values.iter().map(|(symbol, id)| (text.name(*symbol).to_string(), *id)).collect();
    let tape = text.tape("start", &arguments, &results, &mut |_, _, _, _| None).unwrap();
    let mut at = vec![16.0, 0.25];
    at.extend(text.parameters().iter().map(|parameter| text.parameter_value(*parameter).unwrap()));
    let mut found = vec![0.0; results.len()];
    Interpreter::<f64>::new(&tape).eval_all(&at, &mut found);
    // plants.md 2.2, by hand in second gear: w_w = 50, w_t = 185, w_e = 407.
    let torque: f64 = 0.25 * (120.0 + 0.6 * 407.0 - 0.001 * 407.0 * 407.0);
    let clutch = torque - 15.0 - 0.03 * 407.0;
    for (name, wanted) in [
        ("wheel_speed", 50.0),
        ("shaft_speed", 185.0),
        ("engine_speed", 407.0),
        ("engine_torque", torque),
        ("shaft_angle", 0.0),
        ("engine_angle", clutch / 10000.0),
        ("wheel_angle", -2.2 * 3.7 * clutch / 5000.0),
    ] {
        let k = results.iter().position(|(its, _)| its == name).unwrap_or_else(|| panic!("{name} is no state"));
        assert!((found[k] - wanted).abs() <= 1e-12 * wanted.abs().max(1.0), "{name}: {} {wanted}", found[k]);
    }
}

#[test]
fn the_axis() {
    let file = plant_file("servo-axis");
    let hooks = Hooks::new(&file, ServoAxis::STATES);
    let mut text = system("servo-axis", &file, &[]);
    let states = [("position", 0.3), ("speed", 0.5)];
    compare(&ServoAxis::new(&file.parameters, &hooks), &hooks, &mut text, &states, &[("command", 10.0)], &["position"]);
}
