//! Many lanes: the bits of a lane do not depend on the other lanes, nor on the way of execution.

use rsm_core::source::{Faults, Source};
use rsm_sim::equations::{EquationFile, Inputs, Lane, Lanes, Machine, Method, Setting, run};

/// A bouncing ball with a drag that is not polynomial, and with a controller that samples its height ten times per second.
const BALL: &str = "model Ball\n  parameter Real loss = 0.8;\n  parameter Real drag = 0.02;\n  input Real wind;\n  output Real height(start = 1.0);\n  Real speed(start = 0.0);\n  \
    discrete output Real seen(start = 0.0);\nequation\n  der(height) = speed;\n  der(speed) = -9.81 - drag*(speed - wind)*sqrt((speed - wind)^2 + 0.01);\n  \
    when height < 0 then\n    reinit(speed, -loss*pre(speed));\n  end when;\n  when sample(0.0, 0.1) then\n    seen = height;\n  end when;\nend Ball;\n";

/// A motor: polynomial rates, no events.
const MOTOR: &str = "model Motor\n  parameter Real inertia = 0.01;\n  input Real v;\n  Real d, q;\n  output Real speed;\nequation\n  9e-4*der(d) = -0.08*d + 4*speed*9e-4*q;\n  \
    9e-4*der(q) = v - 0.08*q - 4*speed*(9e-4*d + 0.06);\n  inertia*der(speed) = 0.36*q - 1e-3*speed;\nend Motor;\n";

/// A rate that is too fast for the series.
const STIFF: &str = "model Stiff\n  parameter Real rate = 3e4;\n  input Real u;\n  output Real slow, fast;\nequation\n  der(slow) = fast - slow*slow;\n  der(fast) = rate*(u + cos(slow) - fast);\nend Stiff;\n";

/// A stiff contact that opens and closes, with a nonlinear rate and a rate that depends on time.
const CONTACT: &str = "model Contact\n  parameter Real stiffness = 4e5;\n  parameter Real w = 3;\n  input Real u;\n  output Real x(start = 0.1);\n  output Real v;\n  Real f;\nequation\n  f = if x < 0 then -stiffness*x - 2000*v else 0;\n  \
    der(x) = v;\n  der(v) = f - 9.81 + 0.5*u + sin(w*time) - 0.1*v*v*v;\nend Contact;\n";

/// A spring that is stiffer beyond a stop, a drag, and a wave in time: lanes change between the series, old linear parts and new ones.
const SPRING: &str = "model Spring\n  parameter Real stiffness = 1e4;\n  input Real u;\n  output Real x(start = 0.05);\n  output Real v;\n  Real f;\nequation\n  \
    f = if x > 0.02 then 20*stiffness*(x - 0.02) + 200*v else 0;\n  der(x) = v;\n  der(v) = u + sin(20*time) - f - stiffness*x - 3*v*abs(v) - 5e5*x^3;\nend Spring;\n";

fn machine(text: &str, numbers: &str) -> (EquationFile, Machine) {
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
    let plant = format!("format = 2\nmodel = \"m.mo\"\n[parameters]\n{numbers}");
    let file = EquationFile::read(&Source::new("m.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"));
    let machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    (file, machine)
}

fn bits(outputs: &[Vec<f64>]) -> Vec<u64> {
    outputs.iter().flatten().map(|it| it.to_bits()).collect()
}

/// Lanes with different parameters and starts. Each has the same bits as a run of its own machine, in any order and group, and also with the
/// interpreter.
fn check(text: &str, parameter: &str, values: [f64; 9], period: f64) {
    // With a loose tolerance an old linear part is used longer, so the bits show at which point it was computed.
    [1e-9, 1e-5, 1e-3].into_iter().for_each(|tolerance| check_at(text, parameter, values, period, tolerance));
}

fn check_at(text: &str, parameter: &str, values: [f64; 9], period: f64, tolerance: f64) {
    let time: Vec<f64> = (0..60).map(|k| f64::from(k) * period).collect();
    let inputs = vec![(0..60).map(|k| f64::from(k % 7) - 2.0).collect::<Vec<f64>>()];
    let inputs = Inputs { time: &time, values: &inputs };
    let (_, shared) = machine(text, "");
    let mut lanes = Vec::new();
    let mut alone = Vec::new();
    let setting = Setting::new(Method::Automatic, tolerance);
    for value in values {
        let (file, mut own) = machine(text, &format!("{parameter} = {value:?}\n"));
        let start = own.start(&file, 0.0, &[inputs.values[0][0]], &[]).unwrap_or_else(|faults| panic!("{faults}"));
        lanes.push(Lane::new(&own, start.clone()));
        let mut code = Lanes::new(&own);
        let found =
            code.run(&[Lane::new(&own, start)], inputs, setting).remove(0).unwrap_or_else(|stopped| panic!("{stopped}"));
        alone.push((bits(&found), code.work()[0]));
    }
    assert!(alone.windows(2).all(|pair| pair[0].0 != pair[1].0), "lanes differ");
    let compare = |order: &[usize], code: &mut Lanes<'_>| {
        let list: Vec<Lane> = order.iter().map(|k| lanes[*k].clone()).collect();
        for (found, k) in code.run(&list, inputs, setting).into_iter().zip(order) {
            assert!(bits(&found.unwrap_or_else(|stopped| panic!("{stopped}"))) == alone[*k].0, "lane {k} of {order:?}");
        }
        assert!(order.iter().zip(code.work()).all(|(k, work)| alone[*k].1 == *work), "the work of {order:?}");
    };
    let mut code = Lanes::new(&shared);
    for order in [&[0][..], &[0, 1], &[2, 1, 0], &[0, 1, 2, 3, 4, 5, 6, 7], &[8, 7, 6, 5, 4, 3, 2, 1, 0]] {
        compare(order, &mut code);
    }
    let mut interpreted = Lanes::interpreted(&shared);
    compare(&[3, 4, 5, 6, 7], &mut interpreted);
    compare(&[1], &mut interpreted);
    std::thread::scope(|scope| {
        for order in [[0, 1, 2, 3, 4], [4, 3, 2, 1, 0]] {
            scope.spawn(move || compare(&order, &mut Lanes::new(&shared_of(text))));
        }
    });
}

fn shared_of(text: &str) -> Machine {
    machine(text, "").1
}

#[test]
fn lanes_with_events_have_the_bits_that_they_have_alone() {
    check(BALL, "loss", [0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6, 0.55, 0.5], 0.03);
}

#[test]
fn lanes_of_a_motor_have_the_bits_that_they_have_alone() {
    check(MOTOR, "inertia", [0.01, 0.011, 0.012, 0.02, 0.005, 0.013, 0.014, 0.015, 1e-4], 2e-4);
}

#[test]
fn lanes_of_which_some_are_stiff_have_the_bits_that_they_have_alone() {
    check(STIFF, "rate", [3e4, 1.0, 3e5, 10.0, 3e3, 100.0, 2e4, 30.0, 1e6], 0.05);
}

#[test]
fn lanes_with_a_stiff_contact_have_the_bits_that_they_have_alone() {
    check(CONTACT, "stiffness", [4e5, 1e5, 3e6, 2e5, 8e5, 1e6, 1.5e5, 6e5, 7e4], 0.05);
}

#[test]
fn lanes_that_change_their_method_have_the_bits_that_they_have_alone() {
    // Rows shorter and longer than a period of the springs. Their stiffness is drawn from 1e2 to 1e6.
    let mut seed = 7_u64;
    for period in [2e-3, 5e-3, 1e-2, 3e-2] {
        let values = std::array::from_fn(|_| 100.0 * 1e4_f64.powf(crate::uniform(&mut seed)));
        check(SPRING, "stiffness", values, period);
    }
}

#[test]
fn a_lane_that_ends_early_says_why_and_the_others_go_on() {
    let text = "model Grows\n  parameter Real k = 1;\n  output Real x(start = 1.0);\nequation\n  der(x) = k*x*x;\nend Grows;\n";
    let (file, mut own) = machine(text, "");
    let time: Vec<f64> = (0..20).map(|k| f64::from(k) * 0.1).collect();
    let inputs = Inputs { time: &time, values: &[] };
    let start = own.start(&file, 0.0, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let (_, slow) = machine(text, "k = 0.25\n");
    let lanes = [Lane::new(&slow, start.clone()), Lane::new(&own, start.clone()), Lane::new(&slow, start)];
    let found = Lanes::new(&own).run(&lanes, inputs, Setting::new(Method::Explicit, 1e-8));
    // The solution is x = 1/(1 - k t): for k = 1 there is none at 1 s.
    assert!(found[1].is_err() && found[0].is_ok() && found[2].is_ok());
    let last = found[0].as_ref().unwrap_or_else(|stopped| panic!("{stopped}"))[0][19];
    assert!((last - 1.0 / (1.0 - 0.25 * 1.9)).abs() < 1e-7, "{last}");
}

#[test]
fn a_sample_that_changes_nothing_does_not_hide_the_next() {
    let text = "model Held\n  input Real u;\n  discrete output Real y(start = 0.0);\nequation\n  when sample(0.0, 0.1) then\n    y = u;\n  end when;\nend Held;\n";
    let (file, mut own) = machine(text, "");
    let start = own.start(&file, 0.0, &[0.0], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let (time, u): (Vec<f64>, Vec<f64>) = ([0.0, 0.1, 0.2, 0.3, 0.4].to_vec(), [0.0, 0.0, 5.0, 5.0, 7.0].to_vec());
    let found = run(&own, start, Inputs { time: &time, values: std::slice::from_ref(&u) }, Setting::default());
    assert_eq!(found.unwrap_or_else(|stopped| panic!("{stopped}")), [u]);
}

#[test]
fn a_kink_inside_a_step_is_not_stepped_over() {
    // The function |x| without an event: x = -1 + t. Up to 1 s, y is the integral of 1 - t; after it, y grows by (t - 1)^2/2.
    let text = "model Kink\n  output Real x(start = -1.0);\n  output Real y(start = 0.0);\nequation\n  der(x) = 1;\n  der(y) = noEvent(abs(x));\nend Kink;\n";
    let (file, mut own) = machine(text, "");
    let start = own.start(&file, 0.0, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let time = [0.0, 1.7];
    let found = run(&own, start, Inputs { time: &time, values: &[] }, Setting { tolerance: 1e-9, ..Setting::default() });
    let y = found.unwrap_or_else(|stopped| panic!("{stopped}"))[1][1];
    // At the end of a step the slope is checked with about ten times the tolerance, on both sides of the kink.
    assert!((y - (0.5 + 0.5 * 0.49)).abs() < 1e-7, "{y}");
}

/// A machine whose parameters are set must give the same results as a machine whose file contains them.
fn check_set(file: &EquationFile, sets: &[(&str, f64)], expected: &EquationFile, inputs: Inputs<'_>) {
    let first: Vec<f64> = inputs.values.iter().map(|it| it[0]).collect();
    let mut wanted = Machine::new(expected).unwrap_or_else(|faults| panic!("{faults}"));
    let start = wanted.start(expected, inputs.time[0], &first, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let wanted = run(&wanted, start, inputs, Setting::default()).unwrap_or_else(|stopped| panic!("{stopped}"));

    let mut machine = Machine::new(file).unwrap_or_else(|faults| panic!("{faults}"));
    let compiled = machine.clone();
    let mut code = Lanes::new(&compiled);
    let starts = machine.starts(file, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let own = Lane::new(&machine, starts.at(&machine, inputs.time[0], &first, &[]).unwrap_or_else(|faults| panic!("{faults}")));
    for (name, value) in sets {
        machine.set(name, *value).unwrap_or_else(|faults| panic!("{faults}"));
    }
    let start = starts.at(&machine, inputs.time[0], &first, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let found = code.run(&[own, Lane::new(&machine, start)], inputs, Setting::default());
    let [own, set] = &found[..] else { unreachable!("two lanes") };
    let set = set.as_ref().unwrap_or_else(|stopped| panic!("{stopped}"));
    assert_eq!(bits(set), bits(&wanted), "{sets:?}");
    assert_ne!(bits(own.as_ref().unwrap_or_else(|stopped| panic!("{stopped}"))), bits(set), "{sets:?}");
}

#[test]
fn what_follows_from_a_parameter_that_is_set_follows() {
    // A rate, a start, another parameter and the period of a controller depend on the inertia.
    let text = "model Wheel\n  parameter Real inertia = 2;\n  parameter Real friction = 0.3*inertia;\n  parameter Real period = 0.05*inertia;\n  input Real u;\n  \
                output Real speed(start = 5*inertia, fixed = true);\n  discrete output Real seen(start = inertia);\nequation\n  inertia*der(speed) = u - friction*speed^2;\n  \
                when sample(0.0, period) then\n    seen = speed;\n  end when;\nend Wheel;\n";
    let time: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.03).collect();
    let values = vec![vec![0.5; 40]];
    let inputs = Inputs { time: &time, values: &values };
    check_set(&machine(text, "").0, &[("inertia", 3.0)], &machine(text, "inertia = 3.0\n").0, inputs);
}

#[test]
fn numbers_of_effects_are_set_without_compiling_again() {
    let text = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  Real speed(unit = \"m/s\");\n  output Real position(unit = \"m\");\nequation\n  \
                mass*der(speed) = force;\n  der(position) = speed;\nend Cart;\n";
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
    let with = |gain: f64, delay: f64, late: f64| {
        let plant = format!(
            "format = 2\nmodel = \"m.mo\"\n[[effects]]\nkind = \"input-gain\"\nat = \"force\"\nparameters = {{ gain = {gain:?} }}\n\
             [[effects]]\nkind = \"input-delay\"\nat = \"force\"\nparameters = {{ delay = {delay:?} }}\n\
             [[effects]]\nkind = \"sensor-delay\"\nat = \"position\"\nparameters = {{ delay = {late:?} }}\n"
        );
        EquationFile::read(&Source::new("m.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"))
    };
    let time: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.03).collect();
    let values = vec![(0..40).map(|k| f64::from(k % 5) - 1.5).collect()];
    let file = with(1.1, 0.04, 0.05);
    let names: Vec<&str> = [(0, "gain"), (1, "delay"), (2, "delay")]
        .into_iter()
        .map(|(effect, number)| file.parameter_of(effect, number).unwrap_or_else(|| panic!("{number}")))
        .collect();
    // A sensor delay of 0 is no delay: the lanes differ in whether a signal is delayed.
    for (gain, delay, late) in [(0.7, 0.04, 0.05), (1.1, 0.1, 0.05), (1.1, 0.04, 0.0), (0.9, 0.02, 0.2)] {
        let sets = [(names[0], gain), (names[1], delay), (names[2], late)];
        check_set(&file, &sets, &with(gain, delay, late), Inputs { time: &time, values: &values });
    }
}

#[test]
fn an_input_that_comes_two_rows_late_has_the_value_of_two_rows_before() {
    let text = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  Real speed(unit = \"m/s\");\n  output Real position(unit = \"m\");\nequation\n  \
                mass*der(speed) = force;\n  der(position) = speed;\nend Cart;\n";
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
    let late =
        "format = 2\nmodel = \"m.mo\"\n[[effects]]\nkind = \"input-delay\"\nat = \"force\"\nparameters = { delay = 0.0625 }\n";
    let time: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.03125).collect();
    let force: Vec<f64> = (0..40).map(|k| f64::from(k % 5) - 1.5).collect();
    let shifted: Vec<f64> = (0..40_usize).map(|k| force[k.saturating_sub(2)]).collect();
    let [found, expected] = [(late, force), ("format = 2\nmodel = \"m.mo\"\n", shifted)].map(|(plant, values)| {
        let file = EquationFile::read(&Source::new("m.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"));
        let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
        let values = [values];
        let start = machine.start(&file, 0.0, &[values[0][0]], &[]).unwrap_or_else(|faults| panic!("{faults}"));
        run(&machine, start, Inputs { time: &time, values: &values }, Setting::default())
            .unwrap_or_else(|stopped| panic!("{stopped}"))
    });
    for (found, expected) in found[0].iter().zip(&expected[0]) {
        // Steps of the series are exact for a cart; rounding is left.
        assert!((found - expected).abs() < 1e-13, "{found}, expected {expected}");
    }
}

#[test]
fn what_cannot_be_set_is_refused_and_nothing_changes() {
    let text = "model Parts\n  parameter Integer n = 2;\n  parameter Boolean on = true;\n  parameter Real k = 1;\n  parameter Real twice = 2*k;\n  parameter Real gains[3] = {1, 2, 3};\n  \
                output Real x(start = 1.0);\nequation\n  der(x) = -gains[n]*x*(if on then twice else k);\nend Parts;\n";
    let (_, mut machine) = machine(text, "");
    let before = machine.parameters();
    assert_eq!(before.iter().find(|it| it.0 == "k").map(|it| it.2), Some(1.0));
    for (name, value, expected) in [
        ("n", 3.0, "changes the structure of the equations"),
        ("twice", 3.0, "is computed from other parameters"),
        ("x", 3.0, "no parameter is called `x`"),
        ("k", f64::NAN, "expected a finite number"),
        ("on", 0.5, "expected 0 or 1"),
    ] {
        let fault = machine.set(name, value).unwrap_err().to_string();
        assert!(fault.contains(expected), "{fault}");
    }
    assert_eq!(machine.parameters(), before);
    machine.set("on", 0.0).unwrap_or_else(|faults| panic!("{faults}"));
    machine.set("gains[2]", 7.0).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(machine.parameters().iter().find(|it| it.0 == "gains[2]").map(|it| it.2), Some(7.0));
}
