//! Steps of constant length: the method bit by bit, the rules for instants and comparisons, and the result of an invalid input.

use rsm_core::run::Interpreter;
use rsm_sim::equations::{Machine, Method, Setting, Step, Stopped};

use super::equations::{by, machine, outputs};

fn fixed(step: f64) -> Setting {
    by(Method::Fixed { step }, 1e-8)
}

#[test]
fn fixed_steps_are_the_classical_method_bit_for_bit() {
    // One state, so that the order of operations can be written here: dx/dt = u - 2 x + t, over rows of three steps.
    let text = "model M\n  input Real u;\n  output Real x(start = 0.7);\nequation\n  der(x) = u - 2*x + time;\nend M;\n";
    let found = outputs("", text, fixed(0.1), 4, 0.3, &[("u", &|time| time + 1.0)]);
    let (mut x, h) = (0.7_f64, 0.1_f64);
    for step in 0..9 {
        if step % 3 == 0 {
            assert_eq!(found[0][step / 3].to_bits(), x.to_bits(), "step {step}");
        }
        let u = (step / 3) as f64 * 0.3 + 1.0;
        let rate = |x: f64, share: f64| u - 2.0 * x + (0.0 + (step as f64 + share) * h);
        let k1 = rate(x, 0.0);
        let k2 = rate(x + h / 2.0 * k1, 0.5);
        let k3 = rate(x + h / 2.0 * k2, 0.5);
        let k4 = rate(x + h * k3, 1.0);
        let inner = k2 + k3;
        x += h / 6.0 * (k1 + k4 + inner + inner);
    }
    assert_eq!(found[0][3].to_bits(), x.to_bits());
}

#[test]
fn an_instant_of_a_sample_between_rows_acts_at_the_next_end_of_a_step() {
    let text = |period: f64| {
        format!(
            "model M\n  input Real u;\n  discrete output Real y(start = 0.0);\n  output Real x(start = 0.0);\nequation\n  der(x) = 1;\n  \
             when sample(0.0, {period}) then\n    y = pre(y) + u*time;\n  end when;\nend M;\n"
        )
    };
    // Rows of 4 ms in steps of 1 ms. Instants at 0, 2.5, 5, 7.5 ms, ... act at 0, 3, 5, 8 ms, with the input of the row at that time.
    let found = outputs("", &text(0.0025), fixed(0.001), 6, 0.004, &[("u", &|time| 1.0 + 100.0 * time)]);
    let mut wanted = [0.0; 6];
    for (row, wanted) in wanted.iter_mut().enumerate() {
        for at in [0, 3, 5, 8, 10, 13, 15, 18, 20_usize] {
            if at <= 4 * row {
                *wanted += (1.0 + 0.4 * (at / 4) as f64) * 1e-3 * at as f64;
            }
        }
        assert!((found[0][row] - *wanted).abs() < 1e-15, "row {row}: {} {wanted}", found[0][row]);
        // The position of the instants does not change the length of a step.
        assert!((found[1][row] - 0.004 * row as f64).abs() < 1e-16, "row {row}: {}", found[1][row]);
    }
    // Instants that coincide with every step act at every step, although their decimals are not exact in binary.
    let found = outputs("", &text(0.001), fixed(0.001), 101, 0.01, &[("u", &|_| 1.0)]);
    let sum: f64 = (0..=1000).map(|k| 0.001 * f64::from(k)).sum();
    assert!((found[0][100] - sum).abs() < 1e-10, "{} {sum}", found[0][100]);
}

#[test]
fn a_comparison_counts_as_it_is_at_each_point_of_a_step() {
    // A ramp with a bend at 0.25 of the second step: the method evaluates the comparison only at its own points.
    let text = "model M\n  output Real x(start = 0.0);\nequation\n  der(x) = if time < 1.25 then 0 else 6;\nend M;\n";
    let found = outputs("", text, fixed(1.0), 4, 1.0, &[]);
    // From 1 to 2: the rates at the four points are 0, 6, 6, 6.
    assert_eq!(found[0], [0.0, 0.0, 5.0, 11.0]);
}

#[test]
fn a_comparison_that_decides_about_its_own_sides_is_looked_at_between_steps() {
    // An ideal diode. When it conducts, s is the current; otherwise s is the voltage. The sign of s determines which of the two applies.
    let text = "model M\n  input Real u;\n  Real s(start = 1.0);\n  Boolean off;\n  output Real i;\n  output Real v(start = 0.0, fixed = true);\nequation\n  \
        off = s < 0;\n  u - v - i = if off then s else 0;\n  i = if off then 0 else s;\n  der(v) = i;\nend M;\n";
    let found = outputs("", text, fixed(0.001), 11, 0.1, &[("u", &|time| if time < 0.5 { 1.0 } else { 0.0 })]);
    for (row, (found_i, found_v)) in found[0].iter().zip(&found[1]).enumerate() {
        let time = 0.1 * row as f64;
        // While the source voltage is higher, the capacitor charges with a time constant of 1 s. Then it keeps its charge.
        let (v, i) = if row < 5 { (1.0 - (-time).exp(), (-time).exp()) } else { (1.0 - (-0.5_f64).exp(), 0.0) };
        assert!((found_v - v).abs() < 1e-12 && (found_i - i).abs() < 1e-12, "row {row}: {found_v} {v}");
    }
}

#[test]
fn what_one_event_causes_happens_at_the_same_instant() {
    let text = "model M\n  output Real x(start = 0.0);\n  output Integer first(start = 0);\n  output Integer second(start = 0);\nequation\n  der(x) = 1;\n  \
        when x > 0.95 then\n    first = pre(first) + 1;\n    reinit(x, 0.0);\n  end when;\n  when first > 2 then\n    second = 7;\n  end when;\nend M;\n";
    let found = outputs("", text, fixed(0.1), 41, 0.1, &[]);
    for (row, ((x, first), second)) in found[0].iter().zip(&found[1]).zip(&found[2]).enumerate() {
        assert_eq!(*first, (row / 10) as f64, "row {row}");
        assert_eq!(*second, if row < 30 { 0.0 } else { 7.0 }, "row {row}");
        assert!((x - 0.1 * (row % 10) as f64).abs() < 1e-15, "row {row}");
    }
}

#[test]
fn fixed_steps_meet_the_automatic_method_on_every_text() {
    let folder = "../rsm-model/tests/models/";
    let mut count = 0;
    let mut texts: Vec<_> = std::fs::read_dir(folder).unwrap().map(|it| it.unwrap().path()).collect();
    texts.sort();
    for path in texts {
        let text = std::fs::read_to_string(&path).unwrap();
        let (_, machine) = machine("", &text);
        let names = machine.inputs();
        let wave = |time: f64| 0.5 + 0.5 * (3.0 * time).sin();
        let inputs: Vec<(&str, &dyn Fn(f64) -> f64)> =
            names.iter().map(|it| (it.0.as_str(), &wave as &dyn Fn(f64) -> f64)).collect();
        let of = |setting| outputs("", &text, setting, 41, 0.01, &inputs);
        let (wanted, found) = (of(by(Method::Automatic, 1e-9)), of(fixed(2e-5)));
        for ((wanted, found), (name, _)) in wanted.iter().zip(&found).zip(&machine.outputs()) {
            let size = wanted.iter().fold(1e-9_f64, |most, it| most.max(it.abs()));
            let off = wanted.iter().zip(found).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            // An event acts up to one step late. A signal needs at least 1 ms to change by its size, so 2e-5 s are 2 %, once.
            assert!(off < 0.02 * size, "{}: {name} is off by {off} of {size}", path.display());
            count += 1;
        }
    }
    assert!(count > 12, "{count} outputs");
}

#[test]
fn a_bad_input_leaves_the_state_and_the_clock_goes_on() {
    let text = "model M\n  input Real u;\n  output Real x(start = 0.5);\n  output Real t;\nequation\n  der(x) = u - x;\n  t = time;\nend M;\n";
    let (file, mut machine) = machine("", text);
    let point = machine.start(&file, 0.0, &[0.0], &[]).unwrap();
    let step = Step::new(&machine, 0.1).unwrap();
    let mut interpreter = Interpreter::<f64>::new(&step.tape);
    interpreter.set_states(&step.start(&machine, &point));
    for (k, bad) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().enumerate() {
        interpreter.step(&[bad]);
        assert_eq!(interpreter.states()[0], 0.5);
        assert_eq!(interpreter.results().nth(1).unwrap(), 0.1 * k as f64);
    }
    interpreter.step(&[1.0]);
    assert!((interpreter.states()[0] - (1.0 - 0.5 * (-0.1_f64).exp())).abs() < 1e-7);
}

#[test]
fn a_step_that_does_not_suit_is_refused() {
    let text = "model M\n  discrete output Real y(start = 0.0);\nequation\n  when sample(0.0, 0.01) then\n    y = time;\n  end when;\nend M;\n";
    let (_, sampled) = machine("", text);
    let said = |machine: &Machine, length: f64| Step::new(machine, length).err().unwrap_or_default();
    assert_eq!(said(&sampled, 0.02), "a step of 0.02 s is longer than a `sample` of the text, every 0.01 s");
    assert_eq!(said(&sampled, 0.01), "");
    assert!(said(&sampled, 0.0).contains("expected a positive length"));
    assert!(said(&sampled, f64::NAN).contains("expected a positive length"));
    let (file, mut sampled) = machine("", text);
    let time: Vec<f64> = (0..4).map(|k| 0.01 * f64::from(k)).collect();
    let signals = rsm_sim::equations::Signals::in_memory(&file, &sampled, &[("time", &time)]).unwrap();
    let failed = signals.simulate(&file, &mut sampled, fixed(0.003)).unwrap_err();
    let rsm_sim::equations::signals::Failed::Run(Stopped::Step(what)) = failed else { panic!("{failed:?}") };
    assert!(what.contains("found a step of 0.003 s, expected the period of the record"), "{what}");
}

#[test]
fn a_record_may_begin_at_any_time() {
    let text = "model M\n  discrete output Real y(start = 0.0);\nequation\n  when sample(0.0, 0.01) then\n    y = time;\n  end when;\nend M;\n";
    let (file, mut sampled) = machine("", text);
    let time: Vec<f64> = (0..6).map(|k| 12.3 + 0.004 * f64::from(k)).collect();
    let signals = rsm_sim::equations::Signals::in_memory(&file, &sampled, &[("time", &time)]).unwrap();
    let found = signals.simulate(&file, &mut sampled, fixed(0.002)).unwrap();
    for (row, wanted) in [12.3, 12.3, 12.3, 12.31, 12.31, 12.32].into_iter().enumerate() {
        assert!((found[0][row] - wanted).abs() < 1e-13, "row {row}: {}", found[0][row]);
    }
}
