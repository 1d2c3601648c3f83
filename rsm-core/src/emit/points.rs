//! The points of a self-test.
//!
//! In: a function. Out: arguments and results of the interpreter as bits, and which points distinguish a fused multiply-add from a product and a sum.
//! Every comparison is true at some points and false at others, if random points of the box give both. For a compensator the points are one sequence
//! of steps, each from the state of the step before. The points are the same for the same function, because the random ones have a fixed seed. The
//! emitted text is not used.

use super::{Function, Kind};
use crate::model::Input;
use crate::run::{Interpreter, Scalar};
use crate::tape::{Op, Reg, Tape};

/// The number of points that a fused operation must change. With three, a compiler that fuses only some sums is probably detected.
const SENSITIVE: usize = 3;

/// The number of random candidates for these points, and for comparisons with a new outcome. For a second-order polynomial, fusing changes the last
/// bit of one point in three; if the constant term is a thousand times larger than the others, of one in a thousand.
const CANDIDATES: usize = 3000;

/// The number of random steps of an update, so that each of its states changes.
const STEPS: usize = 16;

/// A measured response of so many standard deviations of its noise is far from every prediction.
const FAR: f64 = 1e9;

/// One point: the bits of the arguments, then of the results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Point {
    pub arguments: Vec<u64>,
    pub results: Vec<u64>,
    /// Whether a result has other bits if every product that is an operand of a sum is fused into it.
    pub changes_under_fusing: bool,
}

/// A scalar with a fused multiply-add, to compute the result of an evaluator compiled with fusing.
trait Fused: Scalar {
    fn multiply_add(self, factor: Self, addend: Self) -> Self;
    fn of_f64(value: f64) -> Self;
}

impl Fused for f64 {
    fn multiply_add(self, factor: Self, addend: Self) -> Self {
        self.mul_add(factor, addend)
    }
    fn of_f64(value: f64) -> Self {
        value
    }
}

impl Fused for f32 {
    fn multiply_add(self, factor: Self, addend: Self) -> Self {
        self.mul_add(factor, addend)
    }
    fn of_f64(value: f64) -> Self {
        value as f32
    }
}

/// The points of a function: the middle, two corners, points outside on either side, infinities, -0, a NaN in each argument; then random points that
/// fusing changes, or at which a comparison has a new outcome.
pub(super) fn points(function: &Function) -> Vec<Point> {
    match function.tape.precision {
        crate::number::Precision::F64 => chosen::<f64>(function),
        crate::number::Precision::F32 => chosen::<f32>(function),
    }
}

fn chosen<T: Fused>(function: &Function) -> Vec<Point> {
    let (tape, inputs) = (&function.tape, &function.inputs);
    let mut interpreter = Interpreter::<T>::new(tape);
    let start: Vec<T> = function.start().into_iter().map(T::from_constant).collect();
    interpreter.set_states(&start);
    // For each comparison: whether it was false at some point, and whether it was true.
    let mut seen = vec![[false; 2]; tape.ops.len()];
    // `is_wanted` takes whether a comparison has a new outcome, and whether fusing changes the result.
    let mut point = |natural: &[f64], is_wanted: &dyn Fn(bool, bool) -> bool| {
        let mut arguments: Vec<T> = natural.iter().map(|xi| T::of_f64(*xi)).collect();
        let states = interpreter.states().to_vec();
        if function.kind == Kind::Update {
            // The measured response is drawn beside its prediction: elsewhere the step would be frozen, and its state would not be tested.
            let zero = T::of_f64(0.0);
            let measured = arguments.len() - 1;
            let drawn = std::mem::replace(&mut arguments[measured], zero);
            let predicted = -interpreter.step(&arguments);
            interpreter.set_states(&states);
            arguments[measured] = predicted + drawn;
        }
        interpreter.step(&arguments);
        let results: Vec<T> = interpreter.results().collect();
        // A compiler may fuse either of two products in a sum, so both results must differ.
        let changes = [false, true].iter().all(|left_first| {
            let fused = fused(tape, &states, &arguments, *left_first);
            fused.iter().zip(&results).any(|(fused, result)| !same(*fused, *result))
        });
        let is_new = interpreter.flags().iter().zip(&seen).any(|(flag, seen)| !seen[usize::from(*flag)]);
        if !is_wanted(is_new, changes) {
            // The point is not used, so the step is undone.
            interpreter.set_states(&states);
            return None;
        }
        for (flag, seen) in interpreter.flags().iter().zip(&mut seen) {
            seen[usize::from(*flag)] = true;
        }
        let arguments = arguments.iter().map(|xi| xi.bits()).collect();
        let results = results.iter().map(|result| result.bits()).collect();
        Some(Point { arguments, results, changes_under_fusing: changes })
    };
    let mut points: Vec<Point> = special(inputs).iter().filter_map(|natural| point(natural, &|_, _| true)).collect();
    if function.kind == Kind::Update {
        let mut random = SplitMix(0x57e9);
        for _ in 0..STEPS {
            let natural: Vec<f64> = inputs.iter().map(|input| between(input, random.next_share())).collect();
            points.extend(point(&natural, &|_, _| true));
        }
        // A response that every gate freezes.
        let mut far: Vec<f64> = inputs.iter().map(|input| between(input, 0.5)).collect();
        far.iter_mut().zip(inputs).last().into_iter().for_each(|(measured, input)| *measured = FAR * input.range[1]);
        points.extend(point(&far, &|_, _| true));
    }
    let mut random = SplitMix(0x5eed);
    let mut found = 0;
    for _ in 0..CANDIDATES {
        let natural: Vec<f64> = inputs.iter().map(|input| between(input, random.next_share())).collect();
        if let Some(point) = point(&natural, &|is_new, changes| is_new || changes && found < SENSITIVE) {
            found += usize::from(point.changes_under_fusing);
            points.push(point);
        }
    }
    points
}

/// The value of an input at a share of the way through its range.
fn between(input: &Input, share: f64) -> f64 {
    input.range[0] * (1.0 - share) + input.range[1] * share
}

/// The special points of every function.
fn special(inputs: &[Input]) -> Vec<Vec<f64>> {
    let at = |share: f64| -> Vec<f64> { inputs.iter().map(|input| between(input, share)).collect() };
    let mut points: Vec<Vec<f64>> = [0.5, 0.0, 1.0, 1.5, -0.5].into_iter().map(at).collect();
    points.extend([f64::INFINITY, f64::NEG_INFINITY, -0.0].map(|value| vec![value; inputs.len()]));
    points.extend((0..inputs.len()).map(|k| {
        let mut one_nan = at(0.5);
        one_nan[k] = f64::NAN;
        one_nan
    }));
    points
}

fn same<T: Scalar>(a: T, b: T) -> bool {
    let is_nan = |x: T| x.partial_cmp(&x).is_none();
    a.bits() == b.bits() || (is_nan(a) && is_nan(b))
}

/// The results of a tape if every product (negated or not) that is an operand of a sum or a difference is fused into it.
fn fused<T: Fused>(tape: &Tape, states: &[T], arguments: &[T], left_first: bool) -> Vec<T> {
    let mut values: Vec<T> = Vec::with_capacity(tape.ops.len());
    for op in &tape.ops {
        let r = |reg: Reg| values[reg.0 as usize];
        // A product, and whether it is negated before a sum.
        let product = |reg: Reg| match *tape.op(reg) {
            Op::Multiply(a, b) => Some((r(a), r(b))),
            Op::Negate(p) => match *tape.op(p) {
                Op::Multiply(a, b) => Some((-r(a), r(b))),
                _ => None,
            },
            _ => None,
        };
        let sum = |left: Reg, right: Reg, subtract: bool| {
            let (of_left, of_right) = (product(left), product(right));
            let right_signed = if subtract { -r(right) } else { r(right) };
            match (of_left, of_right) {
                (Some((a, b)), None) => a.multiply_add(b, right_signed),
                (Some((a, b)), Some(_)) if left_first => a.multiply_add(b, right_signed),
                (_, Some((a, b))) => (if subtract { -a } else { a }).multiply_add(b, r(left)),
                (None, None) => r(left) + right_signed,
            }
        };
        let value = match *op {
            Op::Constant(ref constant) => T::from_constant(constant.value),
            Op::Input(port) => arguments[port.0 as usize],
            Op::State(state) => states[state.0 as usize],
            Op::Negate(a) => -r(a),
            Op::Absolute(a) => r(a).absolute(),
            Op::Exponent(a) => r(a).exponent(),
            Op::PowerOfTwo(a) => r(a).power_of_two(),
            Op::Nearest(a) => r(a).to_nearest_whole(),
            Op::Load { ref table, index, offset } => T::from_constant(table.at(r(index).whole(), offset)),
            Op::Add(a, b) => sum(a, b, false),
            Op::Subtract(a, b) => sum(a, b, true),
            Op::Multiply(a, b) => r(a) * r(b),
            Op::Divide(a, b) => r(a) / r(b),
            // Unused: a selection makes the comparison itself.
            Op::Less(a, _) => r(a),
            Op::Select { condition, then, otherwise } => {
                let (left, right) = super::compared(tape, condition);
                if r(left) < r(right) { r(then) } else { r(otherwise) }
            }
        };
        values.push(value);
    }
    tape.outputs.iter().map(|output| values[output.reg.0 as usize]).collect()
}

/// Steele, Lea, Flood: "Fast splittable pseudorandom number generators" (2014), the finalizer of splitmix64.
pub(super) struct SplitMix(pub(super) u64);

impl SplitMix {
    /// In [0, 1), 53 bits.
    pub(super) fn next_share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53)
    }
}

#[cfg(test)]
mod tests;
