//! Steps by a linear part: their exact results, their error estimate, and the location of events.

use rsm_core::source::Source;
use rsm_sim::equations::{EquationFile, Inputs, Machine, Method, Setting, run};

fn outputs(text: &str, time: &[f64], setting: Setting) -> Vec<Vec<f64>> {
    let file = EquationFile::of_text(&Source::new("m.mo", text)).unwrap_or_else(|faults| panic!("{faults}"));
    let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    let start = machine.start(&file, time[0], &[], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    run(&machine, start, Inputs { time, values: &[] }, setting).unwrap_or_else(|stopped| panic!("{stopped}"))
}

fn rows(count: u32, period: f64) -> Vec<f64> {
    (0..count).map(|k| f64::from(k) * period).collect()
}

#[test]
fn what_is_linear_is_exact_at_any_tolerance() {
    // The state x follows a ramp with a time constant of 0.1 ms: x = t - 1/r + e^(-r t)/r; y is its integral.
    let text = "model Ramp\n  parameter Real rate = 1e4;\n  output Real x(start = 0.0);\n  output Real y(start = 0.0);\nequation\n  \
                der(x) = rate*(time - x);\n  der(y) = x;\nend Ramp;\n";
    let time = rows(30, 0.1);
    let found = outputs(text, &time, Setting::new(Method::Stiff, 1e-2));
    for (row, t) in time.iter().enumerate() {
        let r = 1e4;
        let decayed = (-r * t).exp();
        let (x, y) = (t - 1.0 / r + decayed / r, t * t / 2.0 - t / r + (1.0 - decayed) / (r * r));
        // The tolerance covers twelve doublings of numbers near 1, over 30 rows.
        assert!(
            (found[0][row] - x).abs() < 1e-11 && (found[1][row] - y).abs() < 1e-11,
            "{t}: {} {}",
            found[0][row],
            found[1][row]
        );
    }
}

#[test]
fn a_switch_inside_of_a_long_step_is_located() {
    let text = "model Passes\n  parameter Real rate = 1e4;\n  output Real x(start = 0.0);\n  discrete output Real seen(start = -1.0);\n  output Real y(start = 0.0);\nequation\n  \
                der(x) = rate*(time - x);\n  der(y) = if x > 0.25 then 1 else 0;\n  when x > 0.25 then\n    seen = time;\n  end when;\nend Passes;\n";
    let time = rows(6, 0.1);
    let found = outputs(text, &time, Setting::new(Method::Stiff, 1e-3));
    // There x = t - 1/r, because the decaying part is e^(-2500).
    let expected = 0.25 + 1e-4;
    // The instant is located to neighbouring numbers; x has the accuracy of the matrices.
    assert!((found[1][5] - expected).abs() < 1e-12, "{}", found[1][5]);
    assert!((found[2][5] - (0.5 - expected)).abs() < 1e-11, "{}", found[2][5]);
}

#[test]
fn the_error_follows_the_tolerance_where_the_rates_bend() {
    // The problem of Prothero and Robinson: x = cos t, for any rate. The state u adds a nonlinear rate.
    let text = "model Bent\n  parameter Real rate = 1e5;\n  parameter Real w = 1;\n  output Real x(start = 1.0);\n  output Real u(start = 0.5);\nequation\n  \
                der(x) = -rate*(x - cos(w*time)) - sin(w*time);\n  der(u) = u*(1 - u)*x;\nend Bent;\n";
    let time = rows(40, 0.2);
    let mut last = f64::INFINITY;
    for (tolerance, allowed) in [(1e-4, 1e-4), (1e-6, 1e-6), (1e-8, 1e-8)] {
        let found = outputs(text, &time, Setting::new(Method::Stiff, tolerance));
        let mut worst = 0.0_f64;
        for (row, t) in time.iter().enumerate() {
            // The logarithm ln(u/(1 - u)) grows by the integral of cos t.
            let (x, u) = (t.cos(), 1.0 / (1.0 + (-t.sin()).exp()));
            worst = worst.max((found[0][row] - x).abs()).max((found[1][row] - u).abs());
        }
        // The error of a step may be the tolerance, and there are about a hundred steps. Most errors are far smaller, and they decay.
        assert!(worst < 30.0 * allowed && worst < last, "{tolerance}: {worst}");
        last = worst;
    }
}

/// The errors at the last row over the permitted error of a step, for plants that leave a stiff region: for time constants, or widths, and tolerances
/// drawn from a seed. `text` writes the plant, `exact` gives its value.
fn errors_after_leaving(
    text: &dyn Fn(f64) -> String,
    exact: &dyn Fn(f64, &str) -> f64,
    time: &[f64],
    decades: [f64; 2],
) -> Vec<(f64, f64, f64)> {
    let mut seed = 7;
    let mut drawn = |[low, high]: [f64; 2]| 10.0_f64.powf(low + (high - low) * crate::uniform(&mut seed));
    let one = |_| {
        let (width, tolerance) = (drawn(decades), drawn([-10.0, -4.0]));
        let text = text(width);
        let found = outputs(&text, time, Setting { tolerance, ..Setting::default() });
        let largest = found[0].iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let error = found[0].last().unwrap() - exact(width, &text);
        (width, tolerance, error.abs() / (tolerance * largest))
    };
    (0..60).map(one).collect()
}

#[test]
fn a_tank_that_no_longer_overflows_is_not_held_at_its_rim() {
    // From 5 s on the level falls below the rim, where no flow holds it. Then the linear part of the overflow is wrong, but its own time constant
    // hides this: the estimate of the error is that of a step as long as the time constant.
    let text = |settling: f64| {
        format!(
            "model Tank\n  output Real level(start = 0.4);\n  Real inflow;\nequation\n  inflow = if time < 5 then 1e-3 else -5e-4;\n  \
             der(level) = inflow - noEvent(max(level - 0.4, 0))/{settling:e};\nend Tank;\n"
        )
    };
    let time = rows(16, 1.0);
    // From the rest 1e-3 settling above the rim towards the one 5e-4 settling below; the rim is passed after settling ln 3.
    let exact = |settling: f64, _: &str| 0.4 - 5e-4 * (10.0 - settling * 3.0_f64.ln());
    for (settling, tolerance, error) in errors_after_leaving(&text, &exact, &time, [-6.0, -1.0]) {
        // Ten rows with an error of one sign, and a factor of 2 for the estimate.
        assert!(error < 20.0, "{settling} {tolerance}: {error}");
    }
}

#[test]
fn a_body_that_starts_to_slip_is_not_held_by_its_friction() {
    let text = |width: f64| {
        format!(
            "model Slip\n  parameter Real w = 5;\n  output Real speed(start = 0.0);\nequation\n  der(speed) = 9 + 1.3*sin(w*time) - 10*tanh(speed/{width:e});\nend Slip;\n"
        )
    };
    let time = rows(120, 0.01);
    // From 0.18 s on the body slips. Its speed at the end, with steps whose error is far smaller.
    let exact = |_: f64, text: &str| *outputs(text, &time, Setting::new(Method::Explicit, 1e-13))[0].last().unwrap();
    for (width, tolerance, error) in errors_after_leaving(&text, &exact, &time, [-4.0, -2.0]) {
        // The 100 rows in which it slips, with an error of one sign.
        assert!(error < 100.0, "{width} {tolerance}: {error}");
    }
}
