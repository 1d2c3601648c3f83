use super::*;
use crate::exact::ideal_all;
use crate::number::{Precision, exact};
use crate::rounding::error_bounds;
use crate::run::Interpreter;

/// splitmix64 (Steele, Lea, Flood, 2014)
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Sixteenths from -2 to 2: exact in both precisions.
    fn number(&mut self) -> f64 {
        self.below(65) as f64 / 16.0 - 2.0
    }
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_string()).collect()
}

/// The derivative of one operation after the other by the elementary rules, in rationals, without any simplification: a second implementation.
fn dual(tape: &Tape, point: &[Rational], variable: usize) -> Option<Vec<(Rational, Rational)>> {
    let zero = || integer(0);
    let mut registers: Vec<(Rational, Rational)> = vec![];
    for op in &tape.ops {
        let r = |reg: Reg| registers[reg.0 as usize].clone();
        registers.push(match *op {
            Op::Constant(ref constant) => (constant.exact.clone(), zero()),
            Op::Input(port) => (point[port.0 as usize].clone(), if port.0 as usize == variable { integer(1) } else { zero() }),
            Op::Negate(a) => (-r(a).0, -r(a).1),
            Op::Absolute(a) if r(a).0 < zero() => (-r(a).0, -r(a).1),
            Op::Absolute(a) => r(a),
            Op::Add(a, b) => (r(a).0 + r(b).0, r(a).1 + r(b).1),
            Op::Subtract(a, b) => (r(a).0 - r(b).0, r(a).1 - r(b).1),
            Op::Multiply(a, b) => (r(a).0 * r(b).0, r(a).1 * r(b).0 + r(b).1 * r(a).0),
            Op::Divide(_, b) if r(b).0 == zero() => return None,
            Op::Divide(a, b) => {
                let ((a, of_a), (b, of_b)) = (r(a), r(b));
                ((&a / &b), (of_a * &b - &a * of_b) / (&b * &b))
            }
            Op::Less(a, b) => (if r(a).0 < r(b).0 { integer(1) } else { zero() }, zero()),
            Op::Select { condition, then, otherwise } => {
                if r(condition).0 > zero() {
                    r(then)
                } else {
                    r(otherwise)
                }
            }
            Op::State(_) | Op::Exponent(_) | Op::PowerOfTwo(_) | Op::Nearest(_) | Op::Load { .. } => {
                unreachable!("not written here")
            }
        });
    }
    Some(registers)
}

fn any_tape(random: &mut Random, precision: Precision) -> Tape {
    let mut tape = TapeBuilder::new(precision);
    let mut registers: Vec<Reg> = (0..3).map(|port| tape.input(port)).collect();
    for _ in 0..3 {
        let value = [0.0, 1.0, -1.0, random.number()][random.below(4)];
        registers.push(tape.constant(exact(value)));
    }
    for _ in 0..12 {
        let any = |random: &mut Random| registers[random.below(registers.len())];
        let late = registers[registers.len() - 1 - random.below(3)];
        let (a, b, c) = (any(random), any(random), any(random));
        let (a, b) = if random.below(2) == 0 { (a, late) } else { (late, b) };
        let made = match random.below(10) {
            0 => tape.negate(a),
            1 => tape.absolute(a),
            2 => tape.add(a, b),
            3 => tape.subtract(a, b),
            4 => tape.multiply(a, a),
            5 => tape.multiply(a, b),
            6 => tape.divide(a, b),
            7 => tape.at_least(a, c),
            8 => tape.at_most(a, c),
            _ => tape.select_less(a, b, c, late),
        };
        registers.push(made);
    }
    let outputs = [("u", registers[registers.len() - 1]), ("v", registers[registers.len() - 2])];
    tape.finish_with_results("t", names(&["x", "y", "z"]), outputs, [] as [(&str, Reg); 0])
}

#[test]
fn tangents_of_random_tapes_are_the_exact_derivatives() {
    let mut random = Random(3);
    let mut compared = 0;
    for round in 0..400 {
        let tape = any_tape(&mut random, Precision::ALL[round % 2]);
        let tangent = tangent(&tape, &[Variable::Input(0), Variable::Input(1), Variable::Input(2)]);
        assert_eq!(tangent.outputs.len(), 8);
        for _ in 0..10 {
            let point = [0; 3].map(|_| exact(random.number()));
            let by_hand: Option<Vec<_>> = (0..3).map(|variable| dual(&tape, &point, variable)).collect();
            let (Some(by_hand), Some(found)) = (by_hand, ideal_all(&tangent, &point)) else { continue };
            for (k, output) in tape.outputs.iter().enumerate() {
                assert_eq!(found[k], by_hand[0][output.reg.0 as usize].0, "{tape}{tangent}");
                for (variable, registers) in by_hand.iter().enumerate() {
                    let wanted = &registers[output.reg.0 as usize].1;
                    assert_eq!(found[2 + 3 * k + variable], *wanted, "by {variable} at {point:?}\n{tape}{tangent}");
                }
            }
            compared += 1;
        }
    }
    assert!(compared > 2000, "{compared}");
}

#[test]
fn what_a_tangent_computes_differs_from_the_exact_derivative_by_less_than_its_bound() {
    let mut random = Random(4);
    let mut bounded = 0;
    for _ in 0..300 {
        let tape = any_tape(&mut random, Precision::F64);
        let tangent = tangent(&tape, &[Variable::Input(0)]);
        let ranges = [[-1.0, 1.5], [0.5, 2.0], [-2.0, -0.25]];
        let bounds = error_bounds(&tangent, &ranges);
        let mut run = Interpreter::<f64>::new(&tangent);
        for _ in 0..10 {
            let point = ranges.map(|[low, high]| low + (high - low) * (random.below(1000) as f64 / 999.0));
            run.eval(&point);
            let Some(ideal) = ideal_all(&tangent, &point.map(exact)) else { continue };
            for ((found, ideal), bound) in run.results().zip(&ideal).zip(&bounds) {
                if bound.is_finite() {
                    bounded += 1;
                    let distance = exact(found) - ideal;
                    assert!(distance <= exact(*bound) && -distance <= exact(*bound), "{tape}{tangent}");
                }
            }
        }
    }
    assert!(bounded > 3000, "{bounded}");
}

#[test]
fn zeros_and_ones_are_not_written() {
    // (x + 3) 2 + y: the derivative with respect to x is 2, with respect to y it is 1.
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let (x, y) = (tape.input(0), tape.input(1));
    let (two, three) = (tape.constant(integer(2)), tape.constant(integer(3)));
    let sum = tape.add(x, three);
    let product = tape.multiply(sum, two);
    let result = tape.add(product, y);
    let tape = tape.finish("t", names(&["x", "y"]), result);
    let tangent = tangent(&tape, &[Variable::Input(0), Variable::Input(1)]);
    assert_eq!(tangent.operation_count(), tape.operation_count());
    let derivative = |k: usize| tangent.op(tangent.outputs[k].reg).clone();
    assert!(matches!(derivative(1), Op::Constant(constant) if constant.value == 2.0));
    assert!(matches!(derivative(2), Op::Constant(constant) if constant.value == 1.0));
}

#[test]
fn a_clamp_costs_a_derivative_one_choice_a_bound() {
    // clamp(x)^3: the selections come at the end, not before every product.
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let x = tape.input(0);
    let (low, high) = (tape.constant(integer(-1)), tape.constant(integer(2)));
    let above = tape.at_least(x, low);
    let clamped = tape.at_most(above, high);
    let square = tape.multiply(clamped, clamped);
    let cube = tape.multiply(square, clamped);
    let tape = tape.finish("t", names(&["x"]), cube);
    let tangent = tangent(&tape, &[Variable::Input(0)]);
    let mut run = Interpreter::<f64>::new(&tangent);
    let mut slope = |x: f64| {
        run.eval(&[x]);
        run.results().nth(1).unwrap()
    };
    assert_eq!([-1.5, -1.0, 0.5, 2.0, 2.5].map(&mut slope), [0.0, 3.0, 0.75, 12.0, 0.0]);
    assert!(slope(-1.5).is_sign_positive());
    // 2 v, 2 v v, v^2, their sum, and two selections.
    assert_eq!(tangent.operation_count(), tape.operation_count() + 5, "{tangent}");
}

#[test]
fn states_are_inputs_of_the_tangent() {
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let (x, s) = (tape.input(0), tape.state(0));
    let product = tape.multiply(x, s);
    let next = tape.add(s, product);
    let tape = tape.finish_with_results("t", names(&["x"]), [("y", product)], [("s", next)]);
    let tangent = tangent(&tape, &[Variable::State(0), Variable::Input(0)]);
    assert_eq!(tangent.inputs, ["x", "s"]);
    let found: Vec<&str> = tangent.outputs.iter().map(|output| output.name.as_str()).collect();
    assert_eq!(found, ["y", "next s", "d y / d s", "d y / d x", "d next s / d s", "d next s / d x"]);
    let mut results = [0.0; 6];
    Interpreter::<f64>::new(&tangent).eval_all(&[3.0, 5.0], &mut results);
    assert_eq!(results, [15.0, 20.0, 3.0, 5.0, 4.0, 5.0]);
}

#[test]
#[should_panic(expected = "Input(1) is not of the tape")]
fn a_variable_that_the_tape_does_not_have_is_refused() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let x = tape.input(0);
    let _ = tangent(&tape.finish("t", names(&["x"]), x), &[Variable::Input(1)]);
}

/// Central differences of the function's own operations: with a step of 2^-17 the error of the curvature is 2^-34 and that of the rounding 2^-35.
#[test]
fn elementary_functions_have_their_derivatives() {
    let mut random = Random(9);
    for function in Function::ALL {
        let [low, high] = function.range();
        let (low, high) = (low.max(-4.0), high.min(4.0));
        let arity = function.arity();
        let mut tape = TapeBuilder::sharing(Precision::F64);
        let inputs: Vec<Reg> = (0..arity as u32).map(|port| tape.input(port)).collect();
        // 3/4 of each argument, to test the chain rule.
        let scaled: Vec<Reg> = inputs.iter().map(|x| tape.times(*x, exact(0.75))).collect();
        let result = elementary::write(&mut tape, function, &scaled);
        let tape = tape.finish("t", names(&["x", "y"][..arity]), result);
        let variables: Vec<Variable> = (0..arity).map(Variable::Input).collect();
        let tangent = tangent(&tape, &variables);
        let mut run = Interpreter::<f64>::new(&tangent);
        for _ in 0..60 {
            let share = |random: &mut Random| (random.bits() >> 11) as f64 * 2f64.powi(-53);
            let point: Vec<f64> = (0..arity).map(|_| low + (high - low) * (0.05 + 0.9 * share(&mut random))).collect();
            run.eval(&point);
            let found: Vec<f64> = run.results().collect();
            for variable in 0..arity {
                let step = 2f64.powi(-17);
                let beside = |sign: f64| {
                    let mut moved = point.clone();
                    moved[variable] += sign * step;
                    let scaled: Vec<f64> = moved.iter().map(|x| 0.75 * x).collect();
                    elementary::range::value(function, &scaled)
                };
                let difference = (beside(1.0) - beside(-1.0)) / (2.0 * step);
                // The difference is not a slope if there is a step of floor, a pole of tan or the cut of atan2 between the two points.
                if difference.abs() > 1e3 {
                    continue;
                }
                let slope = found[1 + variable];
                assert!(
                    (slope - difference).abs() <= 1e-6 * (1.0 + slope * slope),
                    "{function:?} at {point:?}: {slope} {difference}"
                );
            }
        }
    }
}

#[test]
fn an_elementary_function_is_differentiated_as_a_whole() {
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let x = tape.input(0);
    let y = elementary::write(&mut tape, Function::Exp, &[x]);
    let tape = tape.finish("t", names(&["x"]), y);
    // exp is its own derivative: no further operation is needed.
    let tangent = tangent(&tape, &[Variable::Input(0)]);
    assert_eq!(tangent.operation_count(), tape.operation_count());
    assert_eq!(tangent.outputs[0].reg, tangent.outputs[1].reg);
    // The error of both is about a unit in the last place of e.
    let bounds = error_bounds(&tangent, &[[0.0, 1.0]]);
    assert!(bounds.iter().all(|bound| *bound <= 2f64.powi(-50)), "{bounds:?}");
}
