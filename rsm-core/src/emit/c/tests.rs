//! Tests of the products that need a barrier, and of the helpers in the file: tapes written by hand, and the expected lines.

use super::*;
use crate::model::{Input, Outside};
use crate::number::exact;
use crate::tape::{Constant, Port, Reg, TapeBuilder};

/// A unit of one function of three inputs.
fn unit(kind: Kind, precision: Precision, write: impl FnOnce(&mut TapeBuilder, [Reg; 3]) -> Reg) -> Unit {
    let mut tape = TapeBuilder::new(precision);
    let inputs = [0, 1, 2].map(|k| tape.push(Op::Input(Port(k))));
    let output = write(&mut tape, inputs);
    let names = ["x", "y", "z"].map(str::to_owned);
    let input =
        |name: &String| Input { name: name.clone(), unit: "1".to_owned(), range: [-1.0, 1.0], outside: Outside::Extrapolate };
    let function = Function {
        surface: "s".to_owned(),
        kind,
        unit: "1".to_owned(),
        inputs: names.iter().map(input).collect(),
        saturation: None,
        derivatives: vec![],
        kept: vec![],
        rules: vec![],
        tape: tape.finish("s", names.to_vec(), output),
    };
    Unit { model: "m".to_owned(), functions: vec![function] }
}

/// The lines of the function's body from the first register on.
fn body(unit: &Unit) -> Vec<String> {
    let text = define(unit, &unit.functions[0]);
    let (_, body) = text.split_once(c_idioms::IN_ORDER).expect("a body begins so");
    body.lines().map(|line| line.trim().to_owned()).filter(|line| line != "}").collect()
}

type Write<'w> = &'w dyn Fn(&mut TapeBuilder, [Reg; 3]) -> Reg;

fn product(tape: &mut TapeBuilder, a: Reg, b: Reg) -> Reg {
    tape.push(Op::Multiply(a, b))
}

/// A product passes the barrier if a sum may use it, directly or through a sign, in the function or in its caller. No other product does.
#[test]
fn a_product_is_kept_from_sums_and_callers_alone() {
    let kept = "m_rsm_keep(r0 * r1)";
    let plain = "r0 * r1";
    let cases: [(&str, Write<'_>, &str); 15] = [
        ("result", &|t, [x, y, _]| product(t, x, y), kept),
        (
            "opposite of it is the result",
            &|t, [x, y, _]| {
                let p = product(t, x, y);
                t.push(Op::Negate(p))
            },
            kept,
        ),
        (
            "magnitude of it is the result",
            &|t, [x, y, _]| {
                let p = product(t, x, y);
                t.push(Op::Absolute(p))
            },
            kept,
        ),
        (
            "opposite of its magnitude is the result",
            &|t, [x, y, _]| {
                let p = product(t, x, y);
                let p = t.push(Op::Absolute(p));
                t.push(Op::Negate(p))
            },
            kept,
        ),
        ("sum, left", &|t, [x, y, z]| in_quotient(t, z, |t| Op::Add(product(t, x, y), z)), kept),
        ("sum, right", &|t, [x, y, z]| in_quotient(t, z, |t| Op::Add(z, product(t, x, y))), kept),
        ("difference, left", &|t, [x, y, z]| in_quotient(t, z, |t| Op::Subtract(product(t, x, y), z)), kept),
        ("difference, right", &|t, [x, y, z]| in_quotient(t, z, |t| Op::Subtract(z, product(t, x, y))), kept),
        (
            "sum with its opposite",
            &|t, [x, y, z]| {
                in_quotient(t, z, |t| {
                    let p = product(t, x, y);
                    Op::Add(z, t.push(Op::Negate(p)))
                })
            },
            kept,
        ),
        (
            "sum with its magnitude",
            &|t, [x, y, z]| {
                in_quotient(t, z, |t| {
                    let p = product(t, x, y);
                    Op::Add(t.push(Op::Absolute(p)), z)
                })
            },
            kept,
        ),
        ("quotient", &|t, [x, y, z]| in_quotient(t, z, |t| Op::Divide(product(t, x, y), z)), plain),
        ("product", &|t, [x, y, z]| in_quotient(t, z, |t| Op::Multiply(product(t, x, y), z)), plain),
        (
            "product of its opposite",
            &|t, [x, y, z]| {
                in_quotient(t, z, |t| {
                    let p = product(t, x, y);
                    Op::Multiply(t.push(Op::Negate(p)), z)
                })
            },
            plain,
        ),
        (
            "choice",
            &|t, [x, y, z]| {
                let p = product(t, x, y);
                let condition = t.push(Op::Less(p, z));
                t.push(Op::Select { condition, then: p, otherwise: x })
            },
            plain,
        ),
        (
            // The sum uses the opposite of another register, and the result is the opposite of another register.
            "beside a sum and a result",
            &|t, [x, y, z]| {
                let p = product(t, x, y);
                let q = t.push(Op::Divide(p, z));
                let opposite = t.push(Op::Negate(z));
                let sum = t.push(Op::Add(q, opposite));
                t.push(Op::Negate(sum))
            },
            plain,
        ),
    ];
    for (what, write, expected) in cases {
        for precision in Precision::ALL {
            let unit = unit(Kind::Surface, precision, write);
            let found = body(&unit);
            let expected = expected.replace("keep", &format!("keep{}", suffix(precision)));
            let line = found.iter().find(|line| line.contains("r0 * r1")).expect("the product is written");
            assert!(line.ends_with(&format!("= {expected};")), "{what}: {line}");
        }
    }
}

/// A quotient of an operation by z: no sum and no caller uses the operation itself.
fn in_quotient(tape: &mut TapeBuilder, z: Reg, write: impl FnOnce(&mut TapeBuilder) -> Op) -> Reg {
    let op = write(tape);
    let value = tape.push(op);
    tape.push(Op::Divide(value, z))
}

#[test]
fn every_operation_is_a_line_and_what_is_not_read_has_none() {
    // Every kind of operation except selections. y + y passes the barrier, because gcc makes it a product; x and y are operands of a sum, z is not.
    let unit = unit(Kind::Surface, Precision::F32, |t, [x, y, z]| {
        let constant = t.push(Op::Constant(Constant { value: 0.5, exact: exact(0.5) }));
        let twice = t.push(Op::Add(y, y));
        let sum = t.push(Op::Add(x, twice));
        let difference = t.push(Op::Subtract(sum, constant));
        let magnitude = t.push(Op::Absolute(difference));
        let _nobody_reads_it = t.push(Op::Divide(x, y));
        t.push(Op::Divide(magnitude, z))
    });
    let expected = [
        "const float r0 = m_rsm_keep_f32(x);",
        "const float r1 = m_rsm_keep_f32(y);",
        "const float r2 = z;",
        "const float r3 = 0.5f;",
        "const float r4 = m_rsm_keep_f32(r1 + r1);",
        "const float r5 = r0 + r4;",
        "const float r6 = r5 - r3;",
        "const float r7 = m_rsm_absolute_f32(r6);",
        "const float r9 = r7 / m_rsm_hide_f32(r2);",
        "return r9;",
    ];
    assert_eq!(body(&unit), expected);
}

/// A support test that does not depend on an input, because its weight is 0.
#[test]
fn an_argument_that_nothing_reads_is_said_to_be_so() {
    let unit = unit(Kind::Support, Precision::F64, |t, [_, y, _]| {
        let [zero, one] = [0.0, 1.0].map(|value| t.constant(exact(value)));
        let condition = t.push(Op::Less(y, one));
        t.push(Op::Select { condition, then: one, otherwise: zero })
    });
    let expected = [
        "(void)x;",
        "(void)z;",
        "const double r1 = y;",
        "const double r3 = 0.0;",
        "const double r4 = 1.0;",
        "const double r6 = m_rsm_select(r1, r4, r4, r3);",
        "return (int)r6;",
    ];
    assert_eq!(body(&unit), expected);
    let rust = super::super::rust::emit(&unit);
    assert!(rust.contains("    let _ = x;\n    let _ = z;\n    let r1: f64 = y;\n"), "{rust}");
}

/// Tapes that need different helpers, in all pairs of an f64 function and an f32 function.
#[test]
fn a_helper_stands_in_the_file_if_it_is_called() {
    let choice = |t: &mut TapeBuilder, [x, y, z]: [Reg; 3]| {
        let condition = t.push(Op::Less(x, y));
        t.push(Op::Select { condition, then: z, otherwise: x })
    };
    let tapes: [Write<'_>; 14] = [
        &|_, [x, _, _]| x,
        &|t, [x, y, _]| t.push(Op::Divide(x, y)),
        &|t, [x, y, _]| t.push(Op::Multiply(x, y)),
        &|t, [x, y, _]| t.push(Op::Add(x, y)),
        // Its operands are no products: only the sum of a register with itself passes the barrier.
        &|t, [x, y, _]| {
            let quotient = t.push(Op::Divide(x, y));
            t.push(Op::Add(quotient, quotient))
        },
        &|t, [x, _, _]| t.push(Op::Absolute(x)),
        &|t, [x, y, _]| t.at_least(x, y),
        &|t, [x, y, _]| t.at_most(x, y),
        &choice,
        &|t, [x, _, _]| t.push(Op::Negate(x)),
        &|t, [x, _, _]| t.push(Op::Subtract(x, x)),
        &|t, [x, y, _]| t.push(Op::Subtract(x, y)),
        // The same for the larger of two numbers: no other operation passes the barrier. The sum of two different registers needs no barrier.
        &|t, [x, y, _]| {
            let larger = t.at_least(x, y);
            t.push(Op::Add(larger, larger))
        },
        &|t, [x, y, _]| {
            let (larger, smaller) = (t.at_least(x, y), t.at_most(x, y));
            t.push(Op::Add(larger, smaller))
        },
    ];
    let names = ["keep", "hide", "absolute", "choose", "select", "at_least", "at_most"];
    // Where clang needs `hide`, other compilers use `keep`.
    let hidden: &[&str] = &["keep", "hide"];
    let calls_by_hand: [&[&str]; 14] = [
        &[],
        hidden,
        &["keep"],
        &["keep"],
        hidden,
        &["absolute"],
        &["at_least"],
        &["at_most"],
        &["select"],
        hidden,
        hidden,
        &["keep"],
        &["keep", "at_least"],
        &["at_least", "at_most"],
    ];
    for (write, by_hand) in tapes.iter().zip(calls_by_hand) {
        for (other, other_by_hand) in tapes.iter().zip(calls_by_hand) {
            let mut both = unit(Kind::Surface, Precision::F64, write);
            both.functions.extend(unit(Kind::Surface, Precision::F32, other).functions);
            let text = source(&both);
            for (precision, by_hand) in [(Precision::F64, by_hand), (Precision::F32, other_by_hand)] {
                for name in names {
                    let helper = format!("m_rsm_{name}{}(", suffix(precision));
                    let is_defined =
                        [format!("static inline {} {helper}", c_type(precision)), format!("#define {helper}value)")]
                            .iter()
                            .any(|definition| text.contains(definition));
                    // Every selection is written with masks on a machine without an idiom.
                    let is_choice = by_hand.iter().any(|name| ["select", "at_least", "at_most"].contains(name));
                    let expected = if name == "choose" { is_choice } else { by_hand.contains(&name) };
                    assert_eq!(is_defined, expected, "{helper} {by_hand:?}");
                }
            }
            let asks_the_machine = [by_hand, other_by_hand].concat().iter().any(|name| *name != "absolute");
            assert_eq!(text.contains("/* Which machine this is"), asks_the_machine, "{by_hand:?} {other_by_hand:?}");
        }
    }
}

/// rustfmt breaks a line of more than 100 characters.
#[test]
fn a_signature_of_rust_is_one_line_up_to_the_width() {
    let with_name = |letters: usize| {
        let mut unit = unit(Kind::Surface, Precision::F64, |_, [x, _, _]| x);
        let tape = &mut unit.functions[0].tape;
        tape.inputs[0] = "x".repeat(letters);
        super::super::rust::emit(&unit)
    };
    let line = |letters: usize| format!("pub fn s({}: f64, y: f64, z: f64) -> f64 {{", "x".repeat(letters));
    let letters = 100 - line(0).len();
    let (fits, breaks) = (with_name(letters), with_name(letters + 1));
    assert!(fits.contains(&format!("\n{}\n", line(letters))), "{fits}");
    let argument = "x".repeat(letters + 1);
    let broken = format!("\npub fn s(\n    {argument}: f64,\n    y: f64,\n    z: f64,\n) -> f64 {{\n    let _ = y;\n");
    assert!(breaks.contains(&broken), "{breaks}");
}

/// The next states of a step are results too.
#[test]
fn a_register_is_a_result_if_it_is_one_of_several() {
    // Registers 2 and 3 are the product and the quotient; register 4 is the opposite of the product.
    let [product, quotient, opposite] = [2, 3, 4].map(Reg);
    let finished = |output: Reg, next: &[Reg]| {
        let mut tape = TapeBuilder::new(Precision::F64);
        let [x, y] = [0, 1].map(|k| tape.push(Op::Input(Port(k))));
        for op in [Op::Multiply(x, y), Op::Divide(x, y), Op::Negate(product)] {
            tape.push(op);
        }
        tape.finish_with_states("s", ["x", "y"].map(str::to_owned).to_vec(), output, next.to_vec())
    };
    for (output, next, expected) in [
        (product, &[quotient][..], true),
        (quotient, &[product], true),
        (quotient, &[quotient, product], true),
        (quotient, &[opposite, quotient], true),
        (quotient, &[quotient], false),
    ] {
        assert_eq!(Reads::of(&finished(output, next)).is_result[product.0 as usize], expected, "{output:?} {next:?}");
    }
}

#[test]
fn a_power_of_two_well_inside_the_exponents_has_an_exact_reciprocal() {
    let is_exact = |value: f64| {
        let mut tape = TapeBuilder::new(Precision::F64);
        let x = tape.push(Op::Input(Port(0)));
        let divisor = tape.push(Op::Constant(Constant { value, exact: exact(value) }));
        let output = tape.push(Op::Divide(x, divisor));
        let tape = tape.finish("s", vec!["x".to_owned()], output);
        assert!(!has_exact_reciprocal(&tape, x), "an input is no constant");
        has_exact_reciprocal(&tape, divisor)
    };
    for exponent in [0, 1, -1, 2, 7, 99, 100, -99, -100] {
        assert!(is_exact(2f64.powi(exponent)) && is_exact(-(2f64.powi(exponent))), "{exponent}");
    }
    let others = [2f64.powi(101), 2f64.powi(-101), 3.0, 1.5, 1f64.next_up(), 2f64.next_down(), 1.0 + 2f64.powi(-26), 0.0, 0.1];
    for value in others {
        assert!(!is_exact(value) && !is_exact(-value), "{value}");
    }
}
