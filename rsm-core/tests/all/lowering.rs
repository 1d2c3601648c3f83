//! The published surfaces through the whole compiler: tape against the exact reference, within the certified bound.

use std::path::Path;

use rsm_core::certificate;
use rsm_core::check::Checked;
use rsm_core::exact;
use rsm_core::lower;
use rsm_core::number::{Precision, Rational, exact};
use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_core::tape::{Op, Tape};

fn published(name: &str) -> Checked {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../generated/coefficients").join(name);
    Checked::read(&Source::read(&path).unwrap()).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn the_published_surface_26_has_its_hand_worked_values() {
    let checked = published("pmac.toml");
    let tape = lower::surface(&checked, 0, Precision::F64);
    println!("{tape}");
    let mut run = Interpreter::<f64>::new(&tape);
    // Centre: b0. Corner (1, -1): 38.19 + 25.46 + 7.28 - 11.04 + 6.23 + 5.85 = 71.97.
    assert!((run.eval(&[10.8, 400.0]) - 38.19).abs() < 1e-13);
    assert!((run.eval(&[21.6, 0.0]) - 71.97).abs() < 1e-13);
    // Outside: the corner again. NaN: NaN.
    assert_eq!(run.eval(&[1e9, f64::NEG_INFINITY]), run.eval(&[21.6, 0.0]));
    assert!(run.eval(&[f64::NAN, 0.0]).is_nan() && run.eval(&[0.0, f64::NAN]).is_nan());
}

#[test]
fn certified_bounds_hold_and_are_not_vain() {
    for name in ["pmac.toml", "throttle.toml"] {
        let checked = published(name);
        let surface = &checked.model().surfaces[0];
        let inputs = checked.inputs_of(surface);
        let found = certificate::surface(&checked, 0, &Precision::ALL);
        println!("{found:?}");
        for certified in &found.tapes {
            let tape = lower::surface(&checked, 0, certified.precision);
            let mut worst = 0.0f64;
            for k in 0..=12 {
                for j in 0..=12 {
                    let at = |input: usize, k: i32| {
                        let [low, high] = inputs[input].range;
                        let xi = low + (high - low) * f64::from(k) / 12.0;
                        if certified.precision == Precision::F32 { f64::from(xi as f32) } else { xi }
                    };
                    let point = [at(0, k), at(1, j)];
                    let rational: Vec<Rational> = point.iter().map(|xi| exact(*xi)).collect();
                    let truth = exact::value(surface, &inputs, &rational).unwrap();
                    let computed = match certified.precision {
                        Precision::F64 => Interpreter::<f64>::new(&tape).eval(&point),
                        Precision::F32 => f64::from(Interpreter::<f32>::new(&tape).eval(&point.map(|xi| xi as f32))),
                    };
                    let polynomial = exact::polynomial(surface, &inputs, &rational).unwrap();
                    assert!(exact(found.range.low) <= polynomial && polynomial <= exact(found.range.high));
                    let error = Precision::F64.round(&(exact(computed) - truth)).abs();
                    worst = worst.max(error);
                }
            }
            assert!(worst <= certified.error, "{worst:e} > {:e}", certified.error);
            // Worst-case bounds of a dozen operations are known to lie within a small factor of what is met; 20 is generous.
            assert!(certified.error < 20.0 * worst, "{:e} says nothing about {worst:e}", certified.error);
        }
    }
}

fn two_inputs(outside: &str) -> Checked {
    let terms: Vec<String> =
        [([0, 0], 0.3), ([1, 0], -3.0), ([2, 0], 25.0), ([4, 0], 11.6), ([0, 1], 19.2), ([2, 1], 9.7), ([4, 1], 8.3)]
            .iter()
            .map(|(powers, coefficient)| format!("{{ powers = {powers:?}, coefficient = {coefficient:?} }}"))
            .collect();
    let text = format!(
        "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [-2.0, 2.0]\noutside = \"{outside}\"\n\
         [inputs.y]\nunit = \"1\"\nrange = [-2.0, 2.0]\noutside = \"{outside}\"\n\
         [surfaces.s]\nunit = \"1\"\ninputs = [\"x\", \"y\"]\nterms = [{}]\n",
        terms.join(", ")
    );
    Checked::read(&Source::new("m.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

fn squares(tape: &Tape) -> usize {
    tape.ops.iter().filter(|op| matches!(op, Op::Multiply(a, b) if a == b)).count()
}

#[test]
fn powers_are_shared_where_that_makes_the_chain_shorter() {
    let checked = published("motor.toml");
    for precision in Precision::ALL {
        let tape = lower::surface(&checked, 0, precision);
        println!("{tape}");
        // x^2 and x^4 = (x^2)^2, each once. Four operations of clamps, then six of the polynomial, then four of the saturation; nested Horner
        // throughout has 18.
        assert_eq!((squares(&tape), tape.depth()), (2, 14), "{tape}");
    }
}

#[test]
fn an_infinity_that_extrapolates_stays_one() {
    let at_infinity = |outside: &str| {
        let tape = lower::surface(&two_inputs(outside), 0, Precision::F64);
        (squares(&tape), Interpreter::<f64>::new(&tape).eval(&[f64::INFINITY, 0.5]))
    };
    // -3 x and 25 x^2 are infinities of both signs: a sum of powers would be NaN.
    assert_eq!(at_infinity("extrapolate"), (0, f64::INFINITY));
    let (shared, clamped) = at_infinity("clamp");
    assert!(shared == 2 && clamped.is_finite(), "{shared} {clamped}");
}

#[test]
fn second_order_in_two_inputs_is_nested_horner() {
    for name in ["pmac.toml", "throttle.toml"] {
        assert_eq!(squares(&lower::surface(&published(name), 0, Precision::F64)), 0);
    }
}

#[test]
fn powers_that_leave_the_exponents_are_not_written() {
    // x^4 is 1e48 at the end of the range, beyond f32; Horner's products are not: 1e-30 x is 1e-18, and the whole 1e18.
    let text = |high: &str, fourth: &str| {
        let term = |powers: &str, coefficient: &str| format!("{{ powers = {powers}, coefficient = {coefficient} }}");
        let terms = [
            term("[0, 0]", "0.3"),
            term("[1, 0]", "-3.0"),
            term("[2, 0]", "25.0"),
            term("[4, 0]", fourth),
            term("[0, 1]", "19.2"),
            term("[2, 1]", "9.7"),
            term("[4, 1]", fourth),
        ];
        format!(
            "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [1.0, {high}]\n[inputs.y]\nunit = \"1\"\nrange = [-2.0, 2.0]\n\
             [surfaces.s]\nunit = \"1\"\ninputs = [\"x\", \"y\"]\ncoding = \"none\"\nterms = [{}]\n",
            terms.join(", ")
        )
    };
    let lowered = |high: &str, fourth: &str| {
        let checked = Checked::read(&Source::new("m.toml", text(high, fourth))).unwrap_or_else(|faults| panic!("{faults}"));
        lower::surface(&checked, 0, Precision::F32)
    };
    let near = lowered("2.0", "11.6");
    assert!(squares(&near) > 0, "the form of powers is the shorter one where it may stand\n{near}");
    let far = lowered("1e12", "1e-30");
    assert_eq!(squares(&far), 0, "{far}");
    assert!(Interpreter::<f32>::new(&far).eval(&[1e12, 1.5]).is_finite());
    assert!(rsm_core::rounding::error_bound(&far, &[[1.0, 1e12], [-2.0, 2.0]]).is_finite());
}
