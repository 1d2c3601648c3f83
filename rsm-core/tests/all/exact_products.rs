//! Products without rounding: products by 1 and -1 are not written, products by other powers of two add nothing to the error bound.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::number::{Precision, exact, integer};
use rsm_core::rounding;
use rsm_core::run::Interpreter;
use rsm_core::source::Source;
use rsm_core::tape::{Op, Port, Tape, TapeBuilder};

/// A surface of x and y in natural powers, over [-2, 4] each.
fn tape(terms: &str, precision: Precision) -> Tape {
    let input = "unit = \"1\"\nrange = [-2.0, 4.0]\n";
    let text = format!(
        "format = 1\nmodel = \"m\"\n[inputs.x]\n{input}[inputs.y]\n{input}[surfaces.s]\nunit = \"1\"\ncoding = \"none\"\n\
         inputs = [\"x\", \"y\"]\nterms = [{terms}]\n"
    );
    let checked = Checked::read(&Source::new("m.toml", text)).unwrap_or_else(|faults| panic!("{faults}"));
    lower::surface(&checked, 0, precision)
}

fn count(tape: &Tape, wanted: impl Fn(&Op) -> bool) -> usize {
    tape.ops.iter().filter(|op| wanted(op)).count()
}

fn is_unit(tape: &Tape, op: &Op) -> bool {
    let one = |reg| matches!(tape.op(reg), Op::Constant(constant) if constant.value.abs() == 1.0);
    matches!(*op, Op::Multiply(a, b) if one(a) || one(b))
}

#[test]
fn products_by_one_are_not_written() {
    // The number of remaining products, of sums and differences, and of changes of sign.
    for (terms, products, sums, signs) in [
        ("{ powers = [1, 0], coefficient = 1.0 }, { powers = [0, 1], coefficient = -1.0 }", 0, 1, 0),
        ("{ powers = [2, 0], coefficient = 1.0 }, { powers = [0, 2], coefficient = 1.0 }", 2, 1, 0),
        ("{ powers = [2, 0], coefficient = -1.0 }, { powers = [0, 1], coefficient = -1.0 }", 1, 1, 1),
        ("{ powers = [1, 1], coefficient = -1.0 }, { powers = [0, 0], coefficient = 0.3 }", 1, 1, 0),
        ("{ powers = [3, 0], coefficient = -1.0 }, { powers = [0, 1], coefficient = 0.7 }", 3, 1, 0),
        ("{ powers = [1, 1], coefficient = -1.0 }", 1, 0, 1),
    ] {
        for precision in Precision::ALL {
            let tape = tape(terms, precision);
            assert_eq!(count(&tape, |op| is_unit(&tape, op)), 0, "{tape}");
            let found = [
                count(&tape, |op| matches!(op, Op::Multiply(..))),
                count(&tape, |op| matches!(op, Op::Add(..) | Op::Subtract(..))),
                count(&tape, |op| matches!(op, Op::Negate(_))),
            ];
            assert_eq!(found, [products, sums, signs], "{terms}\n{tape}");
        }
    }
}

/// The sum -x - y with x = -y: both ways to write it must give +0.
#[test]
fn a_sum_of_opposites_keeps_its_zero() {
    let terms = "{ powers = [1, 0], coefficient = -1.0 }, { powers = [0, 1], coefficient = -1.0 }";
    let tape = tape(terms, Precision::F64);
    let mut run = Interpreter::<f64>::new(&tape);
    for x in [0.5, -0.5, 0.0, -0.0, 2.0] {
        for y in [-x, x] {
            let expected = (-x) + (-y);
            assert_eq!(run.eval(&[x, y]).to_bits(), expected.to_bits(), "{x} {y}\n{tape}");
        }
    }
}

/// The product x * factor or the quotient x / factor.
fn scaled(factor: f64, divides: bool, precision: Precision) -> Tape {
    let mut tape = TapeBuilder::new(precision);
    let x = tape.push(Op::Input(Port(0)));
    let by = tape.constant(exact(factor));
    let result = tape.push(if divides { Op::Divide(x, by) } else { Op::Multiply(x, by) });
    tape.finish("s", vec!["x".to_string()], result)
}

#[test]
fn a_power_of_two_costs_nothing_while_results_are_normal() {
    for precision in Precision::ALL {
        for factor in [0.5, -0.25, 2.0, -1024.0, 1.0] {
            for divides in [false, true] {
                let tape = scaled(factor, divides, precision);
                assert_eq!(rounding::error_bound(&tape, &[[0.1, 7.0]]), 0.0, "{factor} {divides} {precision:?}");
            }
        }
        let mut third = TapeBuilder::new(precision);
        let x = third.push(Op::Input(Port(0)));
        let by = third.constant(integer(1) / integer(3));
        let product = third.push(Op::Multiply(x, by));
        assert!(rounding::error_bound(&third.finish("s", vec!["x".to_string()], product), &[[0.1, 7.0]]) > 0.0);
    }
}

/// If the result is subnormal, its last bit is lost: at most half the smallest number, and some number has this error. (2 - 2^-23) 2^-126 divided by
/// two is rounded up to the smallest normal number, so a result that is normal does not show that nothing was lost.
#[test]
fn a_power_of_two_is_charged_where_results_are_subnormal() {
    let half = scaled(0.5, false, Precision::F32);
    let of = |range: [f64; 2]| rounding::error_bound(&half, &[range]);
    let smallest_normal = f64::from(f32::MIN_POSITIVE);
    let odd = f64::from(f32::MIN_POSITIVE.next_up());
    let last_subnormal_twice = f64::from((2.0 * f32::MIN_POSITIVE).next_down());
    let half_of_smallest = f64::from(f32::from_bits(1)) / 2.0;
    for (x, range) in [(odd, [odd, odd]), (last_subnormal_twice, [last_subnormal_twice, 1.0]), (odd, [-1.0, 1.0])] {
        let computed = f64::from(Interpreter::<f32>::new(&half).eval(&[x as f32]));
        assert_eq!((computed - x / 2.0).abs(), half_of_smallest, "the error is made at {x:e}");
        assert_eq!(of(range), half_of_smallest, "{range:?}");
    }
    assert_eq!(of([2.0 * smallest_normal * (1.0 + 1e-6), 1.0]), 0.0);
    assert_eq!(of([-1.0, -2.0 * smallest_normal * (1.0 + 1e-6)]), 0.0);
    // A product by 2 loses nothing, for any small number.
    assert_eq!(rounding::error_bound(&scaled(2.0, false, Precision::F32), &[[0.0, 1e-44]]), 0.0);
    // An overflow has no bound.
    assert!(rounding::error_bound(&scaled(2.0, false, Precision::F32), &[[1.0, 2e38]]).is_infinite());
}
