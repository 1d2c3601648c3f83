//! Tests of series against known solutions.

use crate::elementary::{self, Function};
use crate::number::{Precision, exact};
use crate::run::Interpreter;
use crate::tape::{Reg, Tape, TapeBuilder};

use super::{Argument, Series};

/// The terms of all states by order, computed in parts with these numbers of orders.
fn terms(rates: &Tape, arguments: &[Argument], slots: &mut Vec<f64>, parts: &[usize]) -> (Vec<Vec<f64>>, Vec<f64>) {
    let states = rates.outputs.len();
    let mut series = Series::new(rates, arguments, 0, slots.len() as u32);
    let mut last = None;
    for orders in parts {
        let part = series.part(*orders);
        slots.resize(series.free() as usize, f64::NAN);
        let at: Vec<f64> = part.arguments.iter().map(|slot| slots[*slot as usize]).collect();
        let mut found = vec![0.0; part.results.len()];
        Interpreter::<f64>::new(&part.tape).eval_all(&at, &mut found);
        part.results.iter().zip(&found).for_each(|(slot, value)| slots[*slot as usize] = *value);
        last = Some(part);
    }
    let part = last.unwrap();
    let end = series.end() as usize;
    let list = part.terms.iter().map(|slot| slots[*slot as usize..*slot as usize + states].to_vec()).collect();
    (list, slots[end..end + states].to_vec())
}

/// x' = f(x) for one state x in slot 1; slot 0 is the step length, slot 2 the time.
fn alone(write: impl Fn(&mut TapeBuilder, Reg, Reg) -> Reg) -> Tape {
    let mut builder = TapeBuilder::sharing(Precision::F64);
    let (x, t) = (builder.input(0), builder.input(1));
    let rate = write(&mut builder, x, t);
    builder.finish("rates", vec!["x".to_string(), "t".to_string()], rate)
}

const ARGUMENTS: [Argument; 2] = [Argument::State(1, 0), Argument::Time(2)];

/// Checks the state after one step against a solution, for every division of the orders into parts.
fn check(name: &str, rates: &Tape, (t, x): (f64, f64), h: f64, solution: impl Fn(f64) -> f64) {
    // 24 orders with steps of a tenth of the radius of convergence: only rounding errors remain.
    for parts in [vec![24], vec![4; 6], vec![1; 24], vec![5, 2, 2, 15]] {
        let mut slots = vec![h, x, t];
        let (_, end) = terms(rates, &ARGUMENTS, &mut slots, &parts);
        let expected = solution(t + h);
        assert!(
            (end[0] - expected).abs() < 2e-14 * (1.0 + expected.abs()),
            "{name} {parts:?}: {}, expected {expected}",
            end[0]
        );
    }
}

#[test]
fn solutions_that_are_known() {
    let constant = |builder: &mut TapeBuilder, value: f64| builder.constant(exact(value));
    // x' = x^2: x = x0/(1 - x0 t)
    check("square", &alone(|b, x, _| b.multiply(x, x)), (0.0, 0.5), 0.2, |t| 0.5 / (1.0 - 0.5 * t));
    // x' = -x/(1 + t): x = x0/(1 + t)
    let rates = alone(|b, x, t| {
        let one = constant(b, 1.0);
        let below = b.add(one, t);
        let quotient = b.divide(x, below);
        b.negate(quotient)
    });
    check("quotient", &rates, (0.5, 2.0), 0.1, |t| 3.0 / (1.0 + t));
    // x' = |x| and one branch of a selection
    let rates = alone(|b, x, t| {
        let (magnitude, zero) = (b.absolute(x), constant(b, 0.0));
        b.select_less(x, zero, magnitude, t)
    });
    check("choices", &rates, (0.5, -2.0), 0.1, |t| -2.0 * (0.5 - t).exp());
}

#[test]
fn a_function_of_the_time_integrates_to_its_integral() {
    // x' = g(2 t - 0.3) at t = 0.4: compared with the difference of the integral in closed form, or with composite Gauss quadrature below.
    for function in Function::ALL {
        let rates = alone(|b, _, t| {
            let (two, shift) = (b.constant(exact(2.0)), b.constant(exact(0.3)));
            let scaled = b.multiply(two, t);
            let u = b.subtract(scaled, shift);
            let square = b.multiply(t, t);
            let arguments = if function == Function::Atan2 { vec![u, square] } else { vec![u] };
            elementary::write(b, function, &arguments)
        });
        let value = |t: f64| {
            let (u, v) = (2.0 * t - 0.3, t * t);
            match function {
                Function::Sqrt => u.sqrt(),
                Function::Exp => u.exp(),
                Function::Log => u.ln(),
                Function::Log10 => u.log10(),
                Function::Sin => u.sin(),
                Function::Cos => u.cos(),
                Function::Tan => u.tan(),
                Function::Asin => u.asin(),
                Function::Acos => u.acos(),
                Function::Atan => u.atan(),
                Function::Atan2 => u.atan2(v),
                Function::Sinh => u.sinh(),
                Function::Cosh => u.cosh(),
                Function::Tanh => u.tanh(),
                Function::Floor => u.floor(),
            }
        };
        // The rule of Gauss and Legendre with 5 points on 8 pieces of 0.005: the error is below rounding.
        let (points, weights) = (
            [0.0, 0.538_469_310_105_683_1, 0.906_179_845_938_664],
            [0.568_888_888_888_888_9, 0.478_628_670_499_366_47, 0.236_926_885_056_189_08],
        );
        let integral = |end: f64| {
            let (from, pieces) = (0.4, 8);
            let half = (end - from) / (2 * pieces) as f64;
            (0..pieces)
                .map(|piece| {
                    let middle = from + (2 * piece + 1) as f64 * half;
                    let sides =
                        (1..3).map(|k| weights[k] * (value(middle - half * points[k]) + value(middle + half * points[k])));
                    half * (weights[0] * value(middle) + sides.sum::<f64>())
                })
                .sum::<f64>()
        };
        check(function.name(), &rates, (0.4, 1.0), 0.02, |t| 1.0 + integral(t));
    }
}

#[test]
fn a_function_of_the_state() {
    // x' = cos(x)^2: tan x = tan x0 + t. x' = tanh x: sinh x = sinh x0 e^t. x' = exp(-x): e^x = e^x0 + t. x' = sqrt x: sqrt x = sqrt x0 + t/2.
    let of = |function: Function| alone(move |b, x, _| elementary::write(b, function, &[x]));
    let rates = alone(|b, x, _| {
        let cosine = elementary::write(b, Function::Cos, &[x]);
        b.multiply(cosine, cosine)
    });
    check("cos", &rates, (0.0, 0.3), 0.1, |t| (0.3_f64.tan() + t).atan());
    check("tanh", &of(Function::Tanh), (0.0, 0.4), 0.1, |t| (0.4_f64.sinh() * t.exp()).asinh());
    check("sqrt", &of(Function::Sqrt), (0.0, 2.0), 0.2, |t| (2.0_f64.sqrt() + t / 2.0).powi(2));
    // x' = log x has no solution in closed form; x' = 1/exp(x) does.
    let rates = alone(|b, x, _| {
        let (power, one) = (elementary::write(b, Function::Exp, &[x]), b.constant(exact(1.0)));
        b.divide(one, power)
    });
    check("exp", &rates, (0.0, 0.3), 0.1, |t| (0.3_f64.exp() + t).ln());
}

#[test]
fn terms_are_the_scaled_derivatives() {
    // An oscillator with a held stiffness: x'' = -9 x. Terms of x: cos at t = 0.
    let mut builder = TapeBuilder::sharing(Precision::F64);
    let (x, v, k) = (builder.input(0), builder.input(1), builder.input(2));
    let pull = builder.multiply(k, x);
    let rate = builder.negate(pull);
    let names = ["x", "v", "k"].map(str::to_string).to_vec();
    let rates = builder.finish_with_results("rates", names, [("x", v), ("v", rate)], [] as [(&str, Reg); 0]);
    let arguments = [Argument::State(1, 0), Argument::State(2, 1), Argument::Held(3)];
    let (found, _) = terms(&rates, &arguments, &mut vec![0.1, 1.0, 0.0, 9.0], &[3, 2]);
    let x: Vec<f64> = found.iter().map(|it| it[0]).collect();
    for (found, expected) in x.iter().zip([0.0, -0.045, 0.0, 0.000_337_5, 0.0]) {
        assert!((found - expected).abs() < 1e-17, "{x:?}");
    }
}
