//! Sensitivities, compared with closed forms up to rounding, and with central differences, also over events. They must not depend on other directions
//! in the same run.

use rsm_core::source::{Faults, Source};
use rsm_sim::equations::{By, EquationFile, Inputs, Lane, Lanes, Machine, Method, Sensitive, Sensitivities, Setting, run};

fn file(text: &str, numbers: &str) -> EquationFile {
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
    let plant = format!("format = 2\nmodel = \"m.mo\"\n[parameters]\n{numbers}");
    EquationFile::read(&Source::new("m.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

fn by(names: &[&str]) -> Vec<By> {
    names.iter().map(|name| By::Parameter((*name).to_string())).collect()
}

const FINE: Setting = Setting::new(Method::Explicit, 1e-15);

fn found(file: &EquationFile, names: &[&str], inputs: Inputs<'_>, setting: Setting) -> Sensitivities {
    let mut machine = Machine::new(file).unwrap_or_else(|faults| panic!("{faults}"));
    let starts = machine.starts(file, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let first: Vec<f64> = inputs.values.iter().map(|it| it[0]).collect();
    let of =
        Sensitive::new(&machine, &starts, inputs.time[0], &first, &[], &by(names)).unwrap_or_else(|faults| panic!("{faults}"));
    let mut lanes = Lanes::new(&machine);
    lanes.sensitivities(&of, inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"))
}

fn rows(count: usize, period: f64) -> Vec<f64> {
    (0..count).map(|k| k as f64 * period).collect()
}

#[test]
fn a_linear_plant_has_the_derivatives_of_its_closed_form() {
    let text = "model Lag\n  parameter Real a = 1.7;\n  parameter Real b = 0.6;\n  parameter Real x0 = 3;\n  input Real u;\n  output Real x(start = x0, fixed = true);\nequation\n  der(x) = b*u - a*x;\nend Lag;\n";
    let (a, b, x0, u) = (1.7_f64, 0.6, 3.0, 2.5);
    let time = rows(40, 0.05);
    let values = vec![vec![u; 40]];
    let all = found(&file(text, ""), &["a", "b", "x0"], Inputs { time: &time, values: &values }, FINE);
    for (row, t) in time.iter().enumerate() {
        let e = (-a * t).exp();
        // The solution is x = x0 e + b u/a (1 - e).
        let exact = [-t * e * x0 + b * u * (t * e / a - (1.0 - e) / (a * a)), u / a * (1.0 - e), e];
        for (k, exact) in exact.into_iter().enumerate() {
            let off = (all.derivatives[k][0][row] - exact).abs();
            // 40 steps, each with about ten roundings of numbers up to 3.
            assert!(off <= 40.0 * 10.0 * 3.0 * f64::EPSILON * 0.5, "row {row}, {k}: {off:e}");
        }
    }
}

#[test]
fn the_instant_of_a_bounce_moves_with_the_parameters() {
    let text = "model Ball\n  parameter Real g = 9.81;\n  parameter Real loss = 0.8;\n  parameter Real h0 = 1;\n  output Real height(start = h0, fixed = true);\n  output Real speed(start = 0.0, fixed = true);\n\
                equation\n  der(height) = speed;\n  der(speed) = -g;\n  when height < 0 then\n    reinit(speed, -loss*pre(speed));\n  end when;\nend Ball;\n";
    let (g, loss, h0) = (9.81_f64, 0.8, 1.0_f64);
    let time = rows(90, 0.01);
    let all = found(&file(text, ""), &["g", "loss", "h0"], Inputs { time: &time, values: &[] }, FINE);
    let bounce = (2.0 * h0 / g).sqrt();
    assert!(time[89] > bounce && time[89] < bounce * (1.0 + 2.0 * loss), "one bounce");
    for (row, t) in time.iter().enumerate() {
        let (heights, speeds) = if *t < bounce {
            ([-0.5 * t * t, 0.0, 1.0], [-t, 0.0, 0.0])
        } else {
            // The formulas after the bounce: height = loss g T (t - T) - g/2 (t - T)^2, speed = loss g T - g (t - T), with T = sqrt(2 h0/g).
            let s = t - bounce;
            let (by_g, by_h) = (-0.5 * bounce / g, 0.5 * bounce / h0);
            let moved = |by: f64| loss * g * (by * s - bounce * by) + g * s * by;
            let sped = |by: f64| loss * g * by + g * by;
            (
                [moved(by_g) + loss * bounce * s - 0.5 * s * s, g * bounce * s, moved(by_h)],
                [sped(by_g) + loss * bounce - s, g * bounce, sped(by_h)],
            )
        };
        for k in 0..3 {
            let off = (all.derivatives[k][0][row] - heights[k]).abs().max((all.derivatives[k][1][row] - speeds[k]).abs());
            // The instant is a number in f64: neighbours differ by 6e-17 s, and speeds are 8 m/s. The 90 steps add roundings of numbers up to 10.
            assert!(off <= 90.0 * 10.0 * f64::EPSILON, "row {row}, {k}: {off:e}");
        }
    }
}

/// Derivatives by central differences with two step lengths, extrapolated: for each parameter, for each output.
fn differences(file: &EquationFile, names: &[&str], inputs: Inputs<'_>, setting: Setting, share: f64) -> Vec<Vec<Vec<f64>>> {
    let compiled = Machine::new(file).unwrap_or_else(|faults| panic!("{faults}"));
    let mut machine = compiled.clone();
    let starts = machine.starts(file, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let first: Vec<f64> = inputs.values.iter().map(|it| it[0]).collect();
    let mut lanes = Lanes::new(&compiled);
    let mut list = Vec::new();
    for name in names {
        let value = compiled.parameters().iter().find(|it| it.0 == *name).map_or(f64::NAN, |it| it.2);
        let step = share * value.abs();
        let mut at = |value: f64| {
            machine.set(name, value).unwrap_or_else(|faults| panic!("{faults}"));
            let start = starts.at(&machine, inputs.time[0], &first, &[]).unwrap_or_else(|faults| panic!("{faults}"));
            let found = lanes.run(&[Lane::new(&machine, start)], inputs, setting).remove(0);
            found.unwrap_or_else(|stopped| panic!("{stopped}"))
        };
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|k| at(value + k * step));
        at(value);
        let slope = |a: f64, b: f64, c: f64, d: f64| (8.0 * (c - b) - (d - a)) / (12.0 * step);
        let each = |k: usize| (0..inputs.time.len()).map(|row| slope(a[k][row], b[k][row], c[k][row], d[k][row])).collect();
        list.push((0..a.len()).map(each).collect());
    }
    list
}

fn compare(text: &str, names: &[&str], inputs: Inputs<'_>, (share, allowed): (f64, f64)) {
    let file = file(text, "");
    let setting = Setting::new(Method::Explicit, 1e-14);
    let all = found(&file, names, inputs, setting);
    let expected = differences(&file, names, inputs, setting, share);
    for ((name, found), expected) in names.iter().zip(&all.derivatives).zip(&expected) {
        for (output, (found, expected)) in found.iter().zip(expected).enumerate() {
            let size = expected.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
            let off = found.iter().zip(expected).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(off <= allowed * size.max(1e-3), "{name}, output {output}: {off:e} of {size:e}");
        }
    }
}

#[test]
fn a_motor_has_the_derivatives_that_central_differences_find() {
    let text = "model Motor\n  parameter Real r = 0.08;\n  parameter Real l = 9e-4;\n  parameter Real flux = 0.06;\n  parameter Real poles = 4;\n  parameter Real inertia = 0.0015;\n  parameter Real friction = 8e-4;\n  \
                input Real v;\n  output Real d, q, speed;\nequation\n  l*der(d) = -r*d + poles*speed*l*q;\n  l*der(q) = v - r*q - poles*speed*(l*d + flux);\n  \
                inertia*der(speed) = 1.5*poles*flux*q - friction*tanh(speed);\nend Motor;\n";
    let time = rows(400, 2.5e-4);
    let values = vec![(0..400).map(|k| f64::from((k / 50) % 5) * 4.0 - 7.0).collect()];
    // Steps of 1e-3 leave a relative error of 1e-12, of fourth order. Such a step of the friction changes a current of 80 A by 5e-6 A. So about a
    // hundred roundings of 1e-14 A are at most 1e-7 of its derivative.
    compare(text, &["r", "l", "flux", "poles", "inertia", "friction"], Inputs { time: &time, values: &values }, (1e-3, 1e-7));
}

#[test]
fn a_stiff_driveline_with_its_start_has_the_derivatives_that_central_differences_find() {
    let open = |name: &str| Err(Faults::one(rsm_core::source::Fault::whole_file(name, "a shipped text stands in the program")));
    let plant = "format = 2\nmodel = \"rsm:driveline\"\n[parameters]\ngear = 3\n[initial]\nroad_speed = 15.0\n";
    let file = EquationFile::read(&Source::new("plant.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"));
    let compiled = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    let time = rows(12, 0.01);
    let values = vec![(0..12).map(|k| if k < 3 { 0.05 } else { 0.6 }).collect::<Vec<f64>>()];
    let inputs = Inputs { time: &time, values: &values };
    let setting = Setting::new(Method::Explicit, 1e-13);
    let mut machine = compiled.clone();
    let starts = machine.starts(&file, &["road_speed".to_string()], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let names = ["clutch_stiffness", "driveshaft_damping", "mass", "torque_lag", "drag_area", "final_drive_ratio"];
    let of = Sensitive::new(&machine, &starts, 0.0, &[0.05], &[15.0], &by(&names)).unwrap_or_else(|faults| panic!("{faults}"));
    let found = Lanes::new(&compiled).sensitivities(&of, inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
    for (k, name) in names.iter().enumerate() {
        let value = compiled.parameters().iter().find(|it| it.0 == *name).map_or(f64::NAN, |it| it.2);
        let mut at = |value: f64| {
            machine.set(name, value).unwrap_or_else(|faults| panic!("{faults}"));
            let start = starts.at(&machine, 0.0, &[0.05], &[15.0]).unwrap_or_else(|faults| panic!("{faults}"));
            Lanes::new(&compiled)
                .run(&[Lane::new(&machine, start)], inputs, setting)
                .remove(0)
                .unwrap_or_else(|it| panic!("{it}"))
        };
        let step = 1e-3 * value;
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|k| at(value + k * step));
        at(value);
        for (output, found) in found.derivatives[k].iter().enumerate() {
            let slope =
                |row: usize| (8.0 * (c[output][row] - b[output][row]) - (d[output][row] - a[output][row])) / (12.0 * step);
            let size = (0..12).map(|row| slope(row).abs()).fold(0.0, f64::max);
            for (row, found) in found.iter().enumerate() {
                // At this tolerance, angles of 50 rad have an error of 5e-12. With a clutch stiffness of 10,000 N m/rad this is 1e-11 m/s^2 or more:
                // with a step of 1e-3, 1e-5 of the smallest derivative here.
                assert!(
                    (found - slope(row)).abs() <= 2e-5 * size,
                    "{name}, output {output}, row {row}: {found:e} {:e}",
                    slope(row)
                );
            }
        }
    }
}

/// Switches by state, by time and by parameter, a sampled controller with a memory, a restart, an iterated block, and a start that depends on a
/// parameter.
const EVENTS: &str = "model Events\n  parameter Real stiffness = 40;\n  parameter Real gap = 0.05;\n  parameter Real gain = 3;\n  parameter Real late = 0.313;\n  parameter Real loss = 0.7;\n  parameter Real begin = 0.2;\n  \
    input Real u;\n  output Real x(start = 2*begin, fixed = true);\n  output Real v(start = 0.0, fixed = true);\n  output Real y(start = 2.0);\n  discrete output Real command(start = 0.0);\n  Real force;\n  Real push;\n\
    equation\n  force = if x > gap then stiffness*(x - gap) else if x < -gap then stiffness*(x + gap) else 0;\n  push = if time > late then 2*gain else 0;\n  \
    der(x) = v;\n  der(v) = command + push - force - 0.1*v*v*v;\n  y + 0.1*y*y*y = 2 + x;\n  when sample(0.0, 0.1) then\n    command = 0.5*pre(command) + gain*(u - x);\n  end when;\n  \
    when x < -0.5 then\n    reinit(v, -loss*pre(v));\n  end when;\nend Events;\n";

#[test]
fn events_of_every_kind_have_the_derivatives_that_central_differences_find() {
    let time = rows(60, 0.025);
    let values = vec![(0..60).map(|k| f64::from(k / 20) * -2.0).collect()];
    let inputs = Inputs { time: &time, values: &values };
    let plain = found(&file(EVENTS, ""), &["gap"], inputs, FINE).outputs;
    assert!(
        plain[0].iter().any(|it| *it < -0.49) && plain[0].iter().any(|it| *it > 0.05),
        "every switch is crossed: {:?}",
        plain[0]
    );
    // An event is located to the last bits of the time, about 1e-16 s. With a step of 1e-4 this is 1e-11 times speeds of 10.
    compare(EVENTS, &["stiffness", "gap", "gain", "late", "loss", "begin"], inputs, (1e-4, 1e-7));
}

#[test]
fn directions_have_the_bits_that_they_have_alone_by_the_interpreter_too() {
    let time = rows(60, 0.025);
    let values = vec![(0..60).map(|k| f64::from(k / 20) * -2.0).collect()];
    let inputs = Inputs { time: &time, values: &values };
    let file = file(EVENTS, "");
    let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    let starts = machine.starts(&file, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let names = ["loss", "gap", "late", "begin", "stiffness", "gain"];
    let of = |names: &[&str]| {
        Sensitive::new(&machine, &starts, 0.0, &[0.0], &[], &by(names)).unwrap_or_else(|faults| panic!("{faults}"))
    };
    let setting = Setting::new(Method::Explicit, 1e-8);
    let mut lanes = Lanes::new(&machine);
    let bits = |list: &[Vec<f64>]| -> Vec<u64> { list.iter().flatten().map(|it| it.to_bits()).collect() };
    let all = lanes.sensitivities(&of(&names), inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
    let start = starts.at(&machine, 0.0, &[0.0], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let plain = run(&machine, start, inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
    assert_eq!(bits(&all.outputs), bits(&plain), "the walk is the one that it is alone");
    for (k, name) in names.iter().enumerate() {
        let alone = lanes.sensitivities(&of(&[name]), inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
        assert_eq!(bits(&alone.derivatives[0]), bits(&all.derivatives[k]), "{name}");
        let again = lanes.sensitivities(&of(&[name]), inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
        assert_eq!(again, alone, "nothing is left of a run");
    }
    let interpreted = Lanes::interpreted(&machine).sensitivities(&of(&names), inputs, setting);
    assert_eq!(interpreted.unwrap_or_else(|stopped| panic!("{stopped}")), all);
}

#[test]
fn what_has_no_derivative_is_refused() {
    let text = "model Held\n  parameter Real period = 0.1;\n  parameter Real k = 1;\n  input Real u;\n  discrete output Real y(start = 0.0);\nequation\n  when sample(0.0, period) then\n    y = k*u;\n  end when;\nend Held;\n";
    let file = file(text, "");
    let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    let starts = machine.starts(&file, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let ask = |name: &str| Sensitive::new(&machine, &starts, 0.0, &[1.0], &[], &by(&[name]));
    for (name, expected) in [("period", "moves the instants of a `sample`"), ("none", "no parameter is called `none`")] {
        let fault = ask(name).unwrap_err().to_string();
        assert!(fault.contains(expected), "{fault}");
    }
    let of = ask("k").unwrap_or_else(|faults| panic!("{faults}"));
    let (time, values) = ([0.0, 0.1, 0.2], vec![vec![1.0, 2.0, 3.0]]);
    let inputs = Inputs { time: &time, values: &values };
    let stiff = Lanes::new(&machine).sensitivities(&of, inputs, Setting::new(Method::Stiff, 1e-6));
    assert!(stiff.unwrap_err().to_string().contains("take the method `explicit`"));
    let found =
        Lanes::new(&machine).sensitivities(&of, inputs, Setting::default()).unwrap_or_else(|stopped| panic!("{stopped}"));
    assert_eq!(found.derivatives[0][0], [1.0, 2.0, 3.0]);
}

#[test]
fn the_start_moves_with_what_is_known_of_it() {
    let text = "model Two\n  parameter Real k = 2;\n  output Real x(start = 1.0);\n  output Real y(start = 1.0);\ninitial equation\n  y*y*y = k*x;\nequation\n  der(x) = -k*x;\n  der(y) = -y;\nend Two;\n";
    let file = file(text, "");
    let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    let starts = machine.starts(&file, &["x".to_string()], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let by = [By::Start(0), By::Parameter("k".to_string())];
    let of = Sensitive::new(&machine, &starts, 0.0, &[], &[4.0], &by).unwrap_or_else(|faults| panic!("{faults}"));
    let time = [0.0, 1.0];
    let found = Lanes::new(&machine).sensitivities(&of, Inputs { time: &time, values: &[] }, FINE);
    let found = found.unwrap_or_else(|stopped| panic!("{stopped}")).derivatives;
    // The solution is y = cbrt(k x0) e^-t. At the start, with k = 2 and x0 = 4: y = 2, dy/dx0 = k/(3 y^2) and dy/dk = x0/(3 y^2).
    let e = (-1.0_f64).exp();
    for (found, exact) in [(&found[0][1], 2.0 / 12.0), (&found[1][1], 4.0 / 12.0)] {
        // An iterated block has converged to 1e-12.
        assert!((found[0] - exact).abs() < 1e-11 && (found[1] - exact * e).abs() < 1e-11, "{found:?} {exact}");
    }
    assert!((found[0][0][1] - (-2.0_f64).exp()).abs() < 1e-15);
}

/// The largest difference of derivatives in each direction, as a share of the largest derivative of the output.
fn apart(found: &[Vec<Vec<f64>>], expected: &[Vec<Vec<f64>>]) -> Vec<f64> {
    let of = |(found, expected): (&Vec<Vec<f64>>, &Vec<Vec<f64>>)| {
        found.iter().zip(expected).fold(0.0_f64, |most, (found, expected)| {
            let size = expected.iter().fold(0.0_f64, |most, it| most.max(it.abs())).max(1e-300);
            found.iter().zip(expected).fold(most, |most, (a, b)| most.max((a - b).abs() / size))
        })
    };
    found.iter().zip(expected).map(of).collect()
}

#[test]
fn a_linear_plant_has_the_derivatives_of_its_exact_solution_in_steps_of_any_length() {
    // x'' + 2 d x' + k x = k time: x = time - c + e^(-d t) (c cos w t + s sin w t), c = 2 d/k, s = (d c - 1)/w, w = sqrt(k - d^2). A row has 1.6
    // periods, and the tolerance is 1e-2: these are the derivatives of the matrices alone.
    let text = "model Swing\n  parameter Real k = 1e4;\n  parameter Real d = 2;\n  output Real x(start = 0.0, fixed = true);\n  Real v(start = 0.0, fixed = true);\n\
                equation\n  der(x) = v;\n  der(v) = k*(time - x) - 2*d*v;\nend Swing;\n";
    let time = rows(20, 0.1);
    let all = found(&file(text, ""), &["k", "d"], Inputs { time: &time, values: &[] }, Setting::new(Method::Stiff, 1e-2));
    let (k, d) = (1e4_f64, 2.0_f64);
    let (w, c) = ((k - d * d).sqrt(), 2.0 * d / k);
    let s = (d * c - 1.0) / w;
    // The derivatives of w, c and s by k and by d.
    let (by_k, by_d) = ([0.5 / w, -c / k], [-d / w, 2.0 / k]);
    let (s_by_k, s_by_d) = ((d * by_k[1] - s * by_k[0]) / w, (c + d * by_d[1] - s * by_d[0]) / w);
    for (row, t) in time.iter().enumerate() {
        let (decay, sin, cos) = ((-d * t).exp(), (w * t).sin(), (w * t).cos());
        let moved =
            |[w_by, c_by]: [f64; 2], s_by: f64| -c_by + decay * (c_by * cos + s_by * sin + w_by * t * (s * cos - c * sin));
        let exact = [moved(by_k, s_by_k), moved(by_d, s_by_d) - t * decay * (c * cos + s * sin)];
        for (found, (exact, size)) in all.derivatives.iter().zip(exact.into_iter().zip([9e-6, 2e-3])) {
            // The matrices are doubled five times, and numbers near 1 pass through about 20 roundings each time: 2^5 * 20 * 1e-16, over 20 rows.
            assert!((found[0][row] - exact).abs() < 2e-12 * size * 20.0, "row {row}: {:e} {exact:e}", found[0][row]);
        }
    }
}

/// A stiff plant whose matrices change with states, time and parameters.
const BENT: &str = "model Bent\n  parameter Real rate = 200;\n  parameter Real w = 1.3;\n  parameter Real gain = 0.7;\n  parameter Real begin = 0.5;\n  input Real force;\n  \
    output Real x(start = 1.0, fixed = true);\n  output Real u(start = begin, fixed = true);\n  output Real y(start = 0.2, fixed = true);\nequation\n  \
    der(x) = -rate*(x - cos(w*time)) + gain*u*x;\n  der(u) = gain*u*(1 - u*x) + y + force;\n  der(y) = rate*(u*u - y) - time*y;\nend Bent;\n";

/// Its parameters.
const BENT_BY: [&str; 4] = ["rate", "w", "gain", "begin"];

/// Instants, and a force that is 0 and 1 for ten rows each.
fn pushed() -> (Vec<f64>, Vec<Vec<f64>>) {
    (rows(40, 0.02), vec![(0..40).map(|k| f64::from((k / 10) % 2)).collect()])
}

#[test]
fn a_step_by_a_linear_part_has_the_derivative_of_what_it_computes() {
    let (time, values) = pushed();
    let inputs = Inputs { time: &time, values: &values };
    let file = file(BENT, "");
    // With these tolerances the errors are in the fourth digit or the seventh. The differences are of runs with the same tolerance, and their steps
    // of 1e-4 are so small that all runs have the same steps and compute their linear parts at the same instants. So they have the derivatives of the
    // steps as they are, with their errors: to 1e-16/1e-4 of a difference, times some hundred roundings.
    for tolerance in [1e-3, 1e-6] {
        let setting = Setting::new(Method::Stiff, tolerance);
        let exact = found(&file, &BENT_BY, inputs, setting);
        let expected = differences(&file, &BENT_BY, inputs, setting, 1e-4);
        for (name, off) in BENT_BY.iter().zip(apart(&exact.derivatives, &expected)) {
            assert!(off < 1e-9, "{tolerance:e}, {name}: {off:e}");
        }
    }
}

#[test]
fn sensitivities_by_linear_parts_become_those_of_the_series() {
    let (time, values) = pushed();
    let inputs = Inputs { time: &time, values: &values };
    let file = file(BENT, "");
    let series = found(&file, &BENT_BY, inputs, FINE).derivatives;
    let mut last = f64::INFINITY;
    for tolerance in [1e-4, 1e-7, 1e-10] {
        let found = found(&file, &BENT_BY, inputs, Setting::new(Method::Stiff, tolerance));
        let off = apart(&found.derivatives, &series).into_iter().fold(0.0, f64::max);
        println!("{tolerance:e} {off:e}");
        // The error of a derivative is that of the states times the fastest rate and the length of a row, 4, and there are a hundred steps.
        assert!(off < 400.0 * tolerance && off < last, "{tolerance:e}: {off:e}");
        last = off;
    }
}

#[test]
fn events_inside_of_long_steps_have_the_derivatives_of_the_series() {
    // The plant of all kinds of events, with a stiff state in it, so that matrices have large norms.
    let text = EVENTS
        .replace("  Real force;", "  output Real late_x(start = 0.0, fixed = true);\n  Real force;")
        .replace("  der(x) = v;", "  der(late_x) = 20*stiffness*(x - late_x) - time;\n  der(x) = v + 0.01*late_x;");
    let time = rows(60, 0.025);
    let values = vec![(0..60).map(|k| f64::from(k / 20) * -2.0).collect()];
    let inputs = Inputs { time: &time, values: &values };
    let names = ["stiffness", "gap", "gain", "late", "loss", "begin"];
    let file = file(&text, "");
    let series = found(&file, &names, inputs, Setting::new(Method::Explicit, 1e-14));
    assert!(series.outputs[0].iter().any(|it| *it < -0.49) && series.outputs[0].iter().any(|it| *it > 0.05));
    let linear = found(&file, &names, inputs, Setting::new(Method::Stiff, 1e-11));
    for (name, off) in names.iter().zip(apart(&linear.derivatives, &series.derivatives)) {
        println!("{name} {off:e}");
        // The tolerance times a thousand steps.
        assert!(off < 1e-8, "{name}: {off:e}");
    }
}

#[test]
fn directions_by_linear_parts_have_the_bits_that_they_have_alone_by_the_interpreter_too() {
    let (time, values) = pushed();
    let inputs = Inputs { time: &time, values: &values };
    for (text, first) in [(BENT, 0.0), (EVENTS, 0.0)] {
        let names: Vec<&str> = if text == BENT {
            vec!["begin", "rate", "gain", "w", "rate"]
        } else {
            vec!["loss", "gap", "late", "begin", "stiffness", "gain"]
        };
        let file = file(text, "");
        let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
        let starts = machine.starts(&file, &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
        let of = |names: &[&str]| {
            Sensitive::new(&machine, &starts, 0.0, &[first], &[], &by(names)).unwrap_or_else(|faults| panic!("{faults}"))
        };
        let setting = Setting::new(Method::Stiff, 1e-6);
        let mut lanes = Lanes::new(&machine);
        let bits = |list: &[Vec<f64>]| -> Vec<u64> { list.iter().flatten().map(|it| it.to_bits()).collect() };
        let all = lanes.sensitivities(&of(&names), inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
        let start = starts.at(&machine, 0.0, &[first], &[]).unwrap_or_else(|faults| panic!("{faults}"));
        let plain = run(&machine, start, inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
        assert_eq!(bits(&all.outputs), bits(&plain), "the walk is the one that it is alone");
        for (k, name) in names.iter().enumerate() {
            let alone = lanes.sensitivities(&of(&[name]), inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
            assert_eq!(bits(&alone.derivatives[0]), bits(&all.derivatives[k]), "{name}");
            let again = lanes.sensitivities(&of(&[name]), inputs, setting).unwrap_or_else(|stopped| panic!("{stopped}"));
            assert_eq!(again, alone, "nothing is left of a run");
        }
        let interpreted = Lanes::interpreted(&machine).sensitivities(&of(&names), inputs, setting);
        assert_eq!(interpreted.unwrap_or_else(|stopped| panic!("{stopped}")), all);
    }
}

/// A slow motion, and a fast one that follows it: a lag, or a damped vibration. `fast`: rate of the fast one in 1/s.
const FOLLOWERS: [&str; 2] = [
    "model Lag\n  parameter Real fast = 200;\n  parameter Real gain = 0.7;\n  input Real force;\n  output Real x(start = 1.0, fixed = true);\n  \
     output Real y(start = 1.0, fixed = true);\nequation\n  der(x) = gain*(force - x*x*x);\n  der(y) = fast*(x - y) - 0.3*y*y;\nend Lag;\n",
    "model Vibration\n  parameter Real fast = 200;\n  parameter Real gain = 0.7;\n  input Real force;\n  output Real x(start = 1.0, fixed = true);\n  \
     output Real y(start = 1.0, fixed = true);\n  Real v(start = 0.0, fixed = true);\nequation\n  der(x) = gain*(force - x*x*x);\n  der(y) = fast*v;\n  \
     der(v) = fast*(x - y - 0.6*v);\nend Vibration;\n",
];

#[test]
fn derivatives_of_a_motion_that_the_states_hardly_show_are_as_accurate_as_the_states() {
    // The states rest on the slow motion, so the fast one is no reason for short steps. Beyond the region of stability of such a step, the
    // derivatives by `fast` would grow up to 1e5 times the output.
    let (period, rows_of_record) = (0.01, 200);
    let time = rows(rows_of_record, period);
    let values = vec![(0..rows_of_record).map(|k| 1.0 + 0.5 * f64::from((k as u32 / 50) % 2)).collect::<Vec<f64>>()];
    let inputs = Inputs { time: &time, values: &values };
    let names = ["fast", "gain"];
    for (k, text) in FOLLOWERS.iter().enumerate() {
        for case in 0..24 {
            // From 2 to 300 time constants in a row, and tolerances from 1e-2 to 1e-9 (a Weyl sequence).
            let drawn = |by: f64| (f64::from(case * 2 + k as u32) * by).fract();
            let (stiffness, tolerance) =
                (2.0 * 150.0_f64.powf(drawn(2.0_f64.sqrt())), 10.0_f64.powf(-2.0 - 7.0 * drawn(3.0_f64.sqrt())));
            let file = file(text, &format!("fast = {}\n", stiffness / period));
            let exact = found(&file, &names, inputs, Setting::new(Method::Stiff, 1e-11));
            for method in [Method::Automatic, Method::Explicit] {
                let it = found(&file, &names, inputs, Setting::new(method, tolerance));
                for (parameter, (found, exact)) in it.derivatives.iter().zip(&exact.derivatives).enumerate() {
                    let value = [stiffness / period, 0.7][parameter];
                    let off =
                        found.iter().zip(exact).flat_map(|(found, exact)| found.iter().zip(exact).map(|(a, b)| (a - b).abs()));
                    let off = value * off.fold(0.0, f64::max);
                    // The outputs are about 1. Each row has at most a few errors of the tolerance: one by one they are below 50 tolerances, and in
                    // sum at most one a row.
                    let allowed = tolerance * rows_of_record as f64;
                    assert!(off < allowed, "{k} {method:?} {stiffness:.0} {tolerance:.0e} {}: {off:.1e}", names[parameter]);
                }
            }
        }
    }
}
