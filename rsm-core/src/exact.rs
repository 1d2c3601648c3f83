//! The exact reference: the value of a surface in rational arithmetic.
//!
//! In: a checked surface and a point. Out: the value of the true polynomial, without rounding. It is slow, and it shares no code with lowering. The
//! interpreter and the emitters use the same tape, so their agreement does not test the tape itself. This module also executes a tape in exact
//! arithmetic, with its constants before rounding; that must give the same polynomial.

use num_traits::Signed;

use crate::basis::{self, Arithmetic, Factor};
use crate::model::{Input, Surface};
use crate::number::{Precision, Rational, exact, integer};
use crate::tape::{Op, Reg, Tape};

/// The value of a surface at a point, with clamped inputs, before `output_range`: the true polynomial, or the response of its transform (for a
/// logarithm with an error below 2^-500 of it). `None` at a pole (a reciprocal input at 0, which is possible only by extrapolation).
#[must_use]
pub fn polynomial(surface: &Surface, inputs: &[Input], point: &[Rational]) -> Option<Rational> {
    let terms = before_transform(surface, inputs, point)?;
    Some(match surface.transform {
        Some(transform) => transform.exact_response(terms),
        None => terms,
    })
}

/// The value of the terms or of the spline.
fn before_transform(surface: &Surface, inputs: &[Input], point: &[Rational]) -> Option<Rational> {
    let zero = Rational::of(0.0);
    let seen: Vec<Rational> = inputs.iter().zip(point).map(|(input, xi)| basis::clamped(input, xi.clone())).collect();
    if surface.reciprocal.iter().any(|name| inputs.iter().zip(&seen).any(|(input, xi)| input.name == *name && *xi == zero)) {
        return None;
    }
    if let Some(spline) = &surface.spline {
        let ranges: Vec<[f64; 2]> = inputs.iter().map(|input| input.range).collect();
        return Some(basis::spline(spline, &ranges, &seen));
    }
    let factors = Factor::all(surface, inputs);
    let values: Vec<Rational> = factors.iter().map(|factor| factor.value(seen[factor.input].clone())).collect();
    let sum = surface.terms.iter().fold(zero, |sum, term| {
        let product = term.powers.iter().zip(&values).map(|(power, value)| basis::power(value, *power));
        sum + product.fold(exact(term.coefficient), |product, power| product * power)
    });
    Some(if basis::is_negated(surface, inputs, point) { -sum } else { sum })
}

/// The result of an evaluator without rounding errors: the polynomial, limited to `output_range`.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s.
/// use rsm_core::{exact, number};
///
/// let surface = &checked.model().surfaces[0];
/// let found = exact::value(surface, &checked.inputs_of(surface), &[number::exact(10.0)]);
/// assert_eq!(found, Some(number::integer(25))); // without any rounding
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn value(surface: &Surface, inputs: &[Input], point: &[Rational]) -> Option<Rational> {
    Some(saturated(surface, polynomial(surface, inputs, point)?))
}

/// A value of the polynomial, limited to `output_range`.
#[must_use]
pub fn saturated(surface: &Surface, y: Rational) -> Rational {
    match surface.output_range {
        Some([low, _]) if y < exact(low) => exact(low),
        Some([_, high]) if y > exact(high) => exact(high),
        _ => y,
    }
}

/// The result of a tape executed without rounding, with its constants before rounding. `None` for a division by zero, and for an elementary function,
/// whose values are not rational.
#[must_use]
pub fn ideal(tape: &Tape, point: &[Rational]) -> Option<Rational> {
    ideal_step(tape, &mut [], point)
}

/// All results of a tape, executed without rounding as in [`ideal`].
#[must_use]
pub fn ideal_all(tape: &Tape, point: &[Rational]) -> Option<Vec<Rational>> {
    let registers = registers(tape, &[], point)?;
    Some(tape.outputs.iter().map(|output| registers[output.reg.0 as usize].clone()).collect())
}

/// One step of a tape without rounding; `states` are updated. Returns the first result. `None` for a division by zero.
#[must_use]
pub fn ideal_step(tape: &Tape, states: &mut [Rational], point: &[Rational]) -> Option<Rational> {
    let registers = registers(tape, states, point)?;
    for (state, next) in states.iter_mut().zip(&tape.states) {
        *state = registers[next.reg.0 as usize].clone();
    }
    Some(registers[tape.output().0 as usize].clone())
}

/// The results of all operations without rounding.
fn registers(tape: &Tape, states: &[Rational], point: &[Rational]) -> Option<Vec<Rational>> {
    if !tape.computed.is_empty() {
        return None;
    }
    let mut registers: Vec<Rational> = Vec::with_capacity(tape.ops.len());
    for op in &tape.ops {
        let r = |reg: &Reg| registers[reg.0 as usize].clone();
        let zero = Rational::of(0.0);
        let value = match op {
            Op::Constant(constant) => constant.exact.clone(),
            Op::Input(port) => point[port.0 as usize].clone(),
            Op::State(state) => states[state.0 as usize].clone(),
            Op::Negate(a) => -r(a),
            Op::Absolute(a) if r(a) < zero => -r(a),
            Op::Absolute(a) => r(a),
            Op::Exponent(a) => integer(exponent(&r(a), tape.precision)),
            Op::PowerOfTwo(a) => power_of_two(&r(a), tape.precision)?,
            // The magnitude of the sum is rounded to the even integer, as the numbers do.
            Op::Nearest(a) => nearest(&r(a)),
            Op::Load { table, index, offset } => {
                let index = r(index);
                let whole = u32::try_from(index.numer()).ok().filter(|whole| index.is_integer() && *whole <= table.mask)?;
                table.entries[(whole + offset) as usize].exact.clone()
            }
            Op::Add(a, b) => r(a) + r(b),
            Op::Subtract(a, b) => r(a) - r(b),
            Op::Multiply(a, b) => r(a) * r(b),
            Op::Divide(_, b) if r(b) == zero => return None,
            Op::Divide(a, b) => r(a) / r(b),
            Op::Less(a, b) => Rational::of(if r(a) < r(b) { 1.0 } else { 0.0 }),
            Op::Select { condition, then, otherwise } => {
                if r(condition) > zero {
                    r(then)
                } else {
                    r(otherwise)
                }
            }
        };
        registers.push(value);
    }
    Some(registers)
}

/// The nearest integer, of two equally near the even one.
fn nearest(value: &Rational) -> Rational {
    let below = value.floor();
    let half = integer(1) / integer(2);
    let rest = value - &below;
    let is_odd = (&below / integer(2)).is_integer();
    if rest > half || (rest == half && !is_odd) { below + integer(1) } else { below }
}

/// floor(log2 |value|); for subnormals and zero one below the smallest exponent.
fn exponent(value: &Rational, precision: Precision) -> i64 {
    let bias = bias(precision);
    let power = |exponent: i64| {
        let power = Rational::from_integer(num_bigint::BigInt::from(1) << exponent.unsigned_abs());
        if exponent < 0 { power.recip() } else { power }
    };
    let magnitude = value.abs();
    if magnitude < power(1 - bias) {
        return -bias;
    }
    // floor(log2) is this or one less.
    let above = value.numer().bits() as i64 - value.denom().bits() as i64;
    if magnitude < power(above) { above - 1 } else { above }
}

/// 2^value for an integer with a normal result; otherwise `None`.
fn power_of_two(value: &Rational, precision: Precision) -> Option<Rational> {
    let bias = bias(precision);
    if !value.is_integer() || *value < integer(1 - bias) || *value > integer(bias) {
        return None;
    }
    let whole = i64::try_from(value.numer()).expect("it is at most the bias");
    // An exponent of f32 is one of f64 too.
    Some(exact(crate::number::power_of_two(whole)))
}

/// The largest exponent.
fn bias(precision: Precision) -> i64 {
    match precision {
        Precision::F64 => 1023,
        Precision::F32 => 127,
    }
}
