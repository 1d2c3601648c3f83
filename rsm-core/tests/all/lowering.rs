//! The published surfaces through the whole compiler: the tape is compared with the exact reference, within the certified bound.

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
    // At the centre: b0. At the corner (1, -1): 38.19 + 25.46 + 7.28 - 11.04 + 6.23 + 5.85 = 71.97.
    assert!((run.eval(&[10.8, 400.0]) - 38.19).abs() < 1e-13);
    assert!((run.eval(&[21.6, 0.0]) - 71.97).abs() < 1e-13);
    // Outside the range the result is that of the corner. The result of NaN is NaN.
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
            // The worst-case bound of a dozen operations is usually within a small factor of the largest error found; 20 is a wide limit.
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
        // The powers x^2 and x^4 = (x^2)^2 are computed once each. Four operations of clamps, then six of the polynomial, then four of the
        // saturation; nested Horner throughout has 18.
        assert_eq!((squares(&tape), tape.depth()), (2, 14), "{tape}");
    }
}

#[test]
fn an_infinity_that_extrapolates_stays_one() {
    let at_infinity = |outside: &str| {
        let tape = lower::surface(&two_inputs(outside), 0, Precision::F64);
        (squares(&tape), Interpreter::<f64>::new(&tape).eval(&[f64::INFINITY, 0.5]))
    };
    // The terms -3 x and 25 x^2 are infinities with opposite signs: a sum of powers would be NaN.
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
    // At the end of the range x^4 is 1e48, which exceeds f32. The products of Horner do not: 1e-30 x is 1e-18, and the whole is 1e18.
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

/// A surface of x in [1, 2] and y in [1, 2], unless given otherwise; keys of the surface are in separate lines.
fn small(x: &str, y: Option<&str>, keys: &str, terms: &[(&[u32], f64)]) -> Checked {
    let terms: Vec<String> =
        terms.iter().map(|(powers, coefficient)| format!("{{ powers = {powers:?}, coefficient = {coefficient:?} }}")).collect();
    let second = y.map_or(String::new(), |y| format!("[inputs.y]\nunit = \"1\"\n{y}\n"));
    let names = if y.is_some() { "\"x\", \"y\"" } else { "\"x\"" };
    let text = format!(
        "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\n{x}\n{second}[surfaces.s]\nunit = \"1\"\ninputs = [{names}]\n{keys}\nterms = [{}]\n",
        terms.join(", ")
    );
    Checked::read(&Source::new("m.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

const FREE: &str = "range = [1.0, 2.0]\noutside = \"extrapolate\"";
const CLAMPED: &str = "range = [1.0, 2.0]";
const EVEN_SIDED: &str = "range = [-2.0, 2.0]";
const NATURAL: &str = "coding = \"none\"";

/// Operations and depth, counted by hand from the formulas.
#[test]
fn known_forms_cost_what_they_cost_by_hand() {
    let cost = |checked: &Checked| {
        let tape = lower::surface(checked, 0, Precision::F64);
        println!("{tape}");
        (tape.operation_count(), tape.depth())
    };
    let one = |x: &str, keys: &str, terms: &[(&[u32], f64)]| cost(&small(x, None, keys, terms));
    let (a, b, c) = (0.3, 0.5, 0.7);

    // Polynomials of one natural variable, by Horner only: a coefficient of 1 or -1 needs no product, and a sign needs no operation if a sum can
    // include it.
    assert_eq!(one(FREE, NATURAL, &[(&[1], 1.0)]), (0, 0));
    assert_eq!(one(FREE, NATURAL, &[(&[1], -1.0)]), (1, 1));
    assert_eq!(one(FREE, NATURAL, &[(&[1], b)]), (1, 1));
    assert_eq!(one(FREE, NATURAL, &[(&[0], a), (&[1], b)]), (2, 2));
    assert_eq!(one(FREE, NATURAL, &[(&[0], a), (&[1], -1.0)]), (1, 1));
    assert_eq!(one(FREE, NATURAL, &[(&[2], 1.0)]), (1, 1));
    assert_eq!(one(FREE, NATURAL, &[(&[2], -1.0)]), (2, 2));
    assert_eq!(one(FREE, NATURAL, &[(&[2], b)]), (2, 2));
    assert_eq!(one(FREE, NATURAL, &[(&[0], a), (&[1], b), (&[2], c)]), (4, 4));
    // A term with coefficient 0 is omitted: a remains, and x - x propagates NaN.
    assert_eq!(one(FREE, NATURAL, &[(&[0], a), (&[1], 0.0)]), (2, 2));
    // Without any term: 0, and x - x.
    assert_eq!(one(FREE, NATURAL, &[(&[1], 0.0)]), (2, 2));

    // (c x + (d y + e)) x + ((f y + g) y + h): five products and five sums. The longest path: d y, + e, + c x, times x, the last sum.
    let full: [(&[u32], f64); 6] =
        [(&[2, 0], 0.3), (&[1, 1], 0.4), (&[1, 0], 0.5), (&[0, 2], 0.6), (&[0, 1], 0.7), (&[0, 0], 0.8)];
    let two = |x: &str, y: &str, keys: &str| cost(&small(x, Some(y), keys, &full));
    assert_eq!(two(FREE, FREE, NATURAL), (10, 5));
    // One subtraction of the middle for each variable; its scale is included in the coefficients.
    assert_eq!(two(FREE, FREE, ""), (12, 6));
    // Before it: less, select, less, select.
    assert_eq!(two(CLAMPED, CLAMPED, ""), (20, 10));
    // The middle is 0.
    assert_eq!(two(EVEN_SIDED, EVEN_SIDED, ""), (18, 9));
    // A magnitude and one bound: three operations instead of four.
    assert_eq!(two(EVEN_SIDED, EVEN_SIDED, "symmetry = { x = \"even\", y = \"even\" }"), (16, 8));

    // Odd: b |x| clamped has depth 4, its negative 5, the selection 6; x < 0 depends on no other operation.
    assert_eq!(one(EVEN_SIDED, "symmetry = { x = \"odd\" }", &[(&[1], b)]), (7, 6));
    // For 1/x; (g - x)/x is computed as -(x - g)/x.
    assert_eq!(one(FREE, "coding = \"none\"\nreciprocal = [\"x\"]", &[(&[1], b)]), (2, 2));
    assert_eq!(one(FREE, "reciprocal = [\"x\"]", &[(&[1], b)]), (4, 4));
    // A hinge is x - k and a bound at 0; x has no other use. For a reciprocal, the same division comes before the bound.
    let hinge = "knots = [{ input = \"x\", at = 1.5 }]";
    assert_eq!(one(FREE, hinge, &[(&[0, 1], c)]), (4, 4));
    assert_eq!(one(FREE, &format!("{hinge}\nreciprocal = [\"x\"]"), &[(&[0, 1], c)]), (6, 6));
    // The middle of a range of 17 numbers of f32, 1000001 + 17/32, is not a number of f32: two subtractions. In f64 it is a number.
    let narrow = small("range = [1000001.0, 1000002.0625]\noutside = \"extrapolate\"", None, "", &[(&[1], b)]);
    assert_eq!(lower::surface(&narrow, 0, Precision::F32).operation_count(), 3);
    assert_eq!(lower::surface(&narrow, 0, Precision::F64).operation_count(), 2);
    // A saturation at both ends needs four operations, at one end two.
    assert_eq!(one(FREE, "output_range = [0.0, 1.0]", &[(&[1], c)]), (6, 6));
    // The surface 0.7 x is between 0.7 and 1.4.
    assert_eq!(one(CLAMPED, "coding = \"none\"\noutput_range = [1.0, 2.0]", &[(&[1], c)]), (7, 7));
    assert_eq!(one(CLAMPED, "coding = \"none\"\noutput_range = [0.0, 1.0]", &[(&[1], c)]), (7, 7));
    assert_eq!(one(CLAMPED, "coding = \"none\"\noutput_range = [0.0, 2.0]", &[(&[1], c)]), (5, 5));
}

/// Calculated by hand, in f32: 2^23 + 1/2 is between the numbers 2^23 and 2^23 + 1, and 2^23 + 3/2 is between 2^23 + 1 and 2^23 + 2. Both are ties
/// and are rounded to the even number, so 1/2 is lost, downwards and upwards. Two units of roundoff of the coded variable are 2^-23 times half of the
/// width of the range: 1/2 if half the width is 2^22.
#[test]
fn a_middle_is_mended_where_its_rounding_costs_more_than_two_units_of_roundoff() {
    for middle in [8_388_608.5, 8_388_609.5] {
        for (half, subtractions) in [(4_194_304.0, 1), (4_194_303.0, 2)] {
            let range = format!("range = [{:?}, {:?}]\noutside = \"extrapolate\"", middle - half, middle + half);
            let checked = small(&range, None, "", &[(&[1], 0.7)]);
            let tape = lower::surface(&checked, 0, Precision::F32);
            let found = tape.ops.iter().filter(|op| matches!(op, Op::Subtract(..))).count();
            assert_eq!(found, subtractions, "{middle} {half}\n{tape}");
        }
    }
}
