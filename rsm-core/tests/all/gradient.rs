//! Gradients of surfaces: compared with the exact derivatives of the true polynomial, within the certified distance, for every form of a surface.

use rsm_core::certificate::gradient::derivatives;
use rsm_core::check::Checked;
use rsm_core::exact::{ideal_all, polynomial};
use rsm_core::lower;
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::run::{Interpreter, Scalar};
use rsm_core::source::Source;

/// Two inputs in every form: coded, with hinge, reciprocal, odd and even; clamped and not; saturated.
const MODEL: &str = r#"
format = 1
model = "m"

[inputs.torque]
unit = "N*m"
range = [0.0, 21.6]

[inputs.speed]
unit = "rad/s"
range = [100.0, 800.5]

[inputs.current]
unit = "A"
range = [-5.25, 5.25]
outside = "extrapolate"

[surfaces.plain]
unit = "deg"
inputs = ["torque", "speed"]
terms = [
  { powers = [0, 0], coefficient = 38.19 }, { powers = [1, 0], coefficient = 25.46 }, { powers = [0, 1], coefficient = -3.7 },
  { powers = [1, 1], coefficient = 1.25 }, { powers = [2, 0], coefficient = -4.0 }, { powers = [0, 3], coefficient = 0.3 },
]

[surfaces.natural]
unit = "deg"
inputs = ["torque", "current"]
coding = "none"
terms = [{ powers = [1, 0], coefficient = 0.1 }, { powers = [1, 2], coefficient = 0.3 }, { powers = [0, 3], coefficient = -0.7 }]

[surfaces.kinked]
unit = "N"
inputs = ["torque", "speed"]
knots = [{ input = "torque", at = 7.3 }]
terms = [{ powers = [1, 0, 0], coefficient = 2.0 }, { powers = [0, 1, 1], coefficient = 3.3 }, { powers = [0, 0, 2], coefficient = 5.0 }]

[surfaces.inverse]
unit = "s"
inputs = ["speed"]
reciprocal = ["speed"]
terms = [{ powers = [0], coefficient = 1.5 }, { powers = [1], coefficient = 0.8 }, { powers = [2], coefficient = -0.2 }]

[surfaces.odd]
unit = "V"
inputs = ["current", "torque"]
symmetry = { current = "odd" }
terms = [{ powers = [1, 0], coefficient = 3.3 }, { powers = [2, 1], coefficient = -0.4 }]

[surfaces.even]
unit = "V"
inputs = ["current"]
symmetry = { current = "even" }
terms = [{ powers = [0], coefficient = 3.3 }, { powers = [2], coefficient = -0.4 }]

[surfaces.saturated]
unit = "deg"
inputs = ["torque"]
output_range = [10.0, 50.0]
terms = [{ powers = [0], coefficient = 30.0 }, { powers = [1], coefficient = 30.0 }]

[surfaces.constant]
unit = "deg"
inputs = ["torque", "current"]
terms = [{ powers = [0, 0], coefficient = 30.0 }]
"#;

fn checked() -> Checked {
    Checked::read(&Source::new("m.toml", MODEL)).unwrap()
}

/// The exact derivative of a rational function of low degree. The error of the central difference quotient is even in its step. So Richardson's
/// scheme in rationals, with steps h, h/2, ..., removes every power of h up to twice the number of steps, which exceeds the degree of a polynomial.
fn derivative(function: impl Fn(&Rational) -> Rational, at: &Rational, step: &Rational) -> Rational {
    let mut table: Vec<Rational> = vec![];
    for k in 0..8u32 {
        let h = step / integer(1 << k);
        let mut entry = (function(&(at + &h)) - function(&(at - &h))) / (integer(2) * &h);
        for (j, previous) in table.iter_mut().enumerate() {
            let factor = integer(4i64.pow(j as u32 + 1));
            let better = (&factor * &entry - &*previous) / (factor - integer(1));
            *previous = std::mem::replace(&mut entry, better);
        }
        table.push(entry);
    }
    table.pop().unwrap()
}

fn shares() -> Vec<f64> {
    // Points away from the middle, where no surface has a knot; the last ones are near the ends.
    vec![0.06, 0.21, 0.49, 0.61, 0.83, 0.97]
}

fn compare<T: Scalar + Into<f64>>(checked: &Checked, index: usize, of: impl Fn(f64) -> T) {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let tape = lower::gradient(checked, index, T::PRECISION);
    let certified = derivatives(checked, index, T::PRECISION);
    assert_eq!(tape.outputs.len(), inputs.len());
    let mut run = Interpreter::<T>::new(&tape);
    for a in shares() {
        for b in shares() {
            let point: Vec<T> = inputs
                .iter()
                .zip([a, b])
                .map(|(input, share)| of(input.range[0] + share * (input.range[1] - input.range[0])))
                .collect();
            let at: Vec<Rational> = point.iter().map(|x| exact((*x).into())).collect();
            run.eval(&point);
            let found: Vec<f64> = run.results().map(Into::into).collect();
            let ideal = ideal_all(&tape, &at).unwrap();
            for (k, input) in inputs.iter().enumerate() {
                let along = |x: &Rational| {
                    let mut moved = at.clone();
                    moved[k] = x.clone();
                    polynomial(surface, &inputs, &moved).unwrap()
                };
                // A share of the range for which all points are on one side of knots and of zero.
                let step = exact(input.range[1] - input.range[0]) / integer(1000);
                let truth = derivative(along, &at[k], &step);
                // The function 1/x is not a polynomial: an error of about 10^-30 remains.
                let slack =
                    if surface.reciprocal.is_empty() { integer(0) } else { Rational::new(1.into(), 10i64.pow(15).into()) };
                let distance = |x: &Rational| if *x < truth { &truth - x } else { x - &truth };
                let name = &surface.name;
                assert!(distance(&ideal[k]) <= slack, "{name} by {}: the tape is not the derivative\n{tape}", input.name);
                let (range, error) = (certified[k].range, certified[k].error);
                // The knot 7.3 is not a number of f32. At the neighbouring number the other side of the knot applies, so no bound exists.
                let has_bound = !(name == "kinked" && input.name == "torque" && T::PRECISION == Precision::F32);
                assert_eq!(error.is_finite(), has_bound, "{name} by {} in {:?}", input.name, T::PRECISION);
                let bound = if has_bound { exact(error) } else { Rational::new(1.into(), 1000.into()) };
                assert!(distance(&exact(found[k])) <= bound + &slack, "{name} by {}: {} {error:e}", input.name, found[k]);
                assert!(range.low <= found[k] && found[k] <= range.high, "{name} by {}: {} {range:?}", input.name, found[k]);
            }
        }
    }
}

#[test]
fn gradients_are_the_derivatives_of_the_polynomial_within_the_certified_distance() {
    let checked = checked();
    for (index, surface) in checked.model().surfaces.iter().enumerate() {
        // Saturation is tested below.
        if surface.output_range.is_none() {
            compare::<f64>(&checked, index, |x| x);
            compare::<f32>(&checked, index, |x| x as f32);
        }
    }
}

fn gradient(checked: &Checked, name: &str, at: &[f64]) -> Vec<f64> {
    let index = checked.model().surfaces.iter().position(|surface| surface.name == name).unwrap();
    let tape = lower::gradient(checked, index, Precision::F64);
    let mut run = Interpreter::<f64>::new(&tape);
    run.eval(at);
    run.results().collect()
}

#[test]
fn beyond_the_range_the_derivative_by_an_input_that_clamps_is_zero() {
    let checked = checked();
    let inside = gradient(&checked, "plain", &[21.6, 400.0]);
    for outside in [21.7, 1e30, f64::INFINITY] {
        assert_eq!(gradient(&checked, "plain", &[outside, 400.0]), [0.0, inside[1]]);
    }
    assert_ne!(inside[0], 0.0);
    assert_eq!(gradient(&checked, "plain", &[-1.0, f64::NEG_INFINITY]), [0.0, 0.0]);
    // An input that extrapolates: the polynomial 0.9 i^2 - ... continues.
    let by_current = gradient(&checked, "natural", &[2.0, 10.0])[1];
    assert!((by_current - (0.6 * 2.0 * 10.0 - 2.1 * 100.0)).abs() < 1e-10, "{by_current}");
}

#[test]
fn where_the_result_saturates_all_derivatives_are_zero() {
    let checked = checked();
    // The surface is 30 + 30 x with x = (torque - 10.8)/10.8: between 10 and 50 from torque 3.6 to 18.
    let slope = 30.0 / 10.8;
    for (torque, wanted) in [(3.5, 0.0), (3.7, slope), (17.9, slope), (18.1, 0.0)] {
        let found = gradient(&checked, "saturated", &[torque])[0];
        assert!((found - wanted).abs() < 1e-12, "{torque}: {found}");
    }
}

#[test]
fn nan_in_gives_nan_in_every_derivative() {
    let checked = checked();
    for surface in &checked.model().surfaces {
        for k in 0..surface.inputs.len() {
            let mut point: Vec<f64> =
                checked.inputs_of(surface).iter().map(|input| 0.3 * input.range[0] + 0.7 * input.range[1]).collect();
            point[k] = f64::NAN;
            let found = gradient(&checked, &surface.name, &point);
            assert!(found.iter().all(|value| value.is_nan()), "{} {k}: {found:?}", surface.name);
        }
    }
}

#[test]
fn a_gradient_whose_name_another_function_has_is_refused() {
    let model = |other: &str| {
        format!(
            "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n\
             [surfaces.drag]\nunit = \"N\"\ninputs = [\"speed\"]\nterms = [{{ powers = [1], coefficient = 35.0 }}]\n\
             [surfaces.{other}]\nunit = \"N\"\ninputs = [\"speed\"]\nterms = [{{ powers = [1], coefficient = 35.0 }}]\n"
        )
    };
    let of = |other: &str| {
        let checked = Checked::read(&Source::new("car.toml", model(other))).unwrap();
        assert!(rsm_core::compile::unit(&checked, &[]).is_ok(), "without gradients nothing changes");
        rsm_core::compile::unit_with_gradients(&checked, &[])
    };
    assert!(of("lift").is_ok());
    for other in ["drag_gradient", "Drag_Gradient"] {
        let faults = of(other).unwrap_err().to_string();
        assert!(faults.contains("surface `drag`: its gradient and `") && faults.contains("rename one of them"), "{faults}");
    }
}
