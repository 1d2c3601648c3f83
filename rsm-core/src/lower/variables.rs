//! Lowers the coding: argument -> clamped argument -> variable v with x = v * scale.
//!
//! Formulas, with xi the clamped argument, [lo, hi] its range and mid = (lo + hi)/2, half = (hi - lo)/2:
//!
//! ```text
//! centred                x = (xi - mid)/half                              v = xi - mid              scale = 1/half
//!   hinge at k           max(0, x - x(k)) = max(0, xi - k)/half           v = max(0, xi - k)        scale = 1/half
//! magnitude              x = |xi|/hi                                      v = |xi|                  scale = 1/hi
//! reciprocal, centred    x = (1/xi - m)/h over [1/hi, 1/lo]
//!                          = ((lo + hi)/(hi - lo)) (g - xi)/xi, g = 2 lo hi/(lo + hi)
//!                                                                         v = (g - xi)/xi           scale = (lo + hi)/(hi - lo)
//!   hinge at k           max(0, x - x(k)), x - x(k) = (2 lo hi/((hi - lo) k)) (k - xi)/xi
//! wave of period p        cos, sin of 2 pi n t, t = (xi - mid)/p          t, folded: see `basis.rs`            scale = 1
//! natural, reciprocal    x = xi, x = 1/xi                                 v = x                     scale = 1
//! sigmoid at m, width w  z = xi - m, a = |z|                              v = z (w + a)/(w^2 + a (w + a)), less its value at 0
//!                                                                             of a symmetric input      scale = 1
//! ```
//!
//! Subtracting in natural units, before any division, keeps narrow ranges far from 0 accurate: the difference of two numbers within a
//! factor of two of each other is exact (Sterbenz).

use num_traits::Signed;

use std::collections::HashMap;

use crate::basis::{Factor, QUARTER_TURN, Shape, Variable};
use crate::model::{Input, Surface};
use crate::number::{Rational, exact, integer};
use crate::tape::{Op, Reg, TapeBuilder};

use super::{Lowered, at_least, at_most, is_clamped};

/// The variables of one surface, each written to the tape when it is first needed.
pub(super) struct Variables<'a> {
    factors: Vec<Factor>,
    inputs: &'a [Input],
    arguments: Vec<Reg>,
    clamps: bool,
    seen: Vec<Option<Reg>>,
    lowered: Vec<Option<Lowered>>,
    /// Intermediate values that waves share: see [`Wavelet`].
    waves: HashMap<(usize, u64, Wavelet), Reg>,
}

/// An intermediate value for the waves of an input and a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Wavelet {
    /// The argument in turns.
    Turns,
    /// The cosine of this order.
    Cosine(u32),
    /// The sine of this order.
    Sine(u32),
    /// Cosine times sine.
    Both(u32),
}

impl<'a> Variables<'a> {
    /// `arguments`: the registers of the inputs, in the order of the surface.
    pub(super) fn new(surface: &Surface, inputs: &'a [Input], arguments: Vec<Reg>) -> Self {
        let factors = Factor::all(surface, inputs);
        let lowered = vec![None; factors.len()];
        Variables { factors, inputs, arguments, clamps: true, seen: vec![None; inputs.len()], lowered, waves: HashMap::new() }
    }

    /// Variables without clamps: a support test must see a value outside the range unchanged.
    pub(super) fn unclamped(surface: &Surface, inputs: &'a [Input], arguments: Vec<Reg>) -> Self {
        Variables { clamps: false, ..Variables::new(surface, inputs, arguments) }
    }

    /// The argument itself.
    pub(super) fn argument(&self, input: usize) -> Reg {
        self.arguments[input]
    }

    /// Whether a variable of this input is on the tape.
    pub(super) fn is_used(&self, input: usize) -> bool {
        self.factors.iter().zip(&self.lowered).any(|(factor, lowered)| factor.input == input && lowered.is_some())
    }

    /// The argument in the polynomial: its magnitude if it is symmetric, clamped if it clamps.
    pub(super) fn seen(&mut self, tape: &mut TapeBuilder, input: usize) -> Reg {
        if let Some(known) = self.seen[input] {
            return known;
        }
        let [low, high] = self.inputs[input].range;
        let clamps = self.clamps && is_clamped(&self.inputs[input]);
        let argument = self.arguments[input];
        let seen = match self.factors[input].variable {
            // The range is symmetric about 0, so one bound on the magnitude replaces two bounds.
            Variable::Magnitude | Variable::ScaledMagnitude { .. } => {
                let magnitude = tape.push(Op::Absolute(argument));
                if clamps { at_most(tape, magnitude, high) } else { magnitude }
            }
            _ if clamps => {
                let above = at_least(tape, argument, low);
                at_most(tape, above, high)
            }
            _ => argument,
        };
        self.seen[input] = Some(seen);
        seen
    }

    /// The variable of a factor, by its index in a term's powers.
    pub(super) fn of(&mut self, tape: &mut TapeBuilder, factor: usize) -> Lowered {
        if let Some(known) = &self.lowered[factor] {
            return known.clone();
        }
        let lowered = self.made(tape, factor);
        self.lowered[factor] = Some(lowered.clone());
        lowered
    }

    fn made(&mut self, tape: &mut TapeBuilder, factor: usize) -> Lowered {
        let Factor { input, variable, shape } = self.factors[factor];
        let xi = self.seen(tape, input);
        let hinge = match shape {
            Shape::Itself => None,
            Shape::Hinge { at } => Some(at),
            Shape::Sigmoid { at, width, is_symmetric } => {
                return Lowered { value: self.sigmoid(tape, input, xi, at, width, is_symmetric), scale: integer(1) };
            }
            Shape::Wave { low, high, period, order, is_sine } => {
                let middle = (exact(low) + exact(high)) / integer(2);
                let wave = Waves { input, xi, middle, period };
                let step = if is_sine { Wavelet::Sine(order) } else { Wavelet::Cosine(order) };
                return Lowered { value: self.wave(tape, &wave, step), scale: integer(1) };
            }
        };
        let scale = scale(variable, hinge);
        let value = match (variable, hinge) {
            (Variable::Natural | Variable::Magnitude | Variable::ScaledMagnitude { .. }, None) => xi,
            (Variable::Natural | Variable::Magnitude | Variable::ScaledMagnitude { .. }, Some(at)) => {
                difference(tape, xi, &exact(at), &self.half(input))
            }
            (Variable::Centred { low, high }, None) => {
                let middle = (exact(low) + exact(high)) / integer(2);
                difference(tape, xi, &middle, &self.half(input))
            }
            (Variable::Centred { .. }, Some(at)) => difference(tape, xi, &exact(at), &self.half(input)),
            (Variable::Reciprocal, None) => {
                let one = tape.constant(integer(1));
                tape.push(Op::Divide(one, xi))
            }
            (Variable::CentredReciprocal { low, high }, None) => {
                let (low, high) = (exact(low), exact(high));
                let middle = integer(2) * &low * &high / (low + high);
                self.relative_difference(tape, input, xi, &middle)
            }
            (Variable::Reciprocal | Variable::CentredReciprocal { .. }, Some(at)) => {
                self.relative_difference(tape, input, xi, &exact(at))
            }
        };
        let value = match hinge {
            None => value,
            Some(_) => {
                // The scale of a hinge may be negative (reciprocal of a negative input): then the hinge is active where v is negative.
                let zero = tape.constant(integer(0));
                // mutant `< to <=`: a scale is never 0.
                if scale < integer(0) { tape.at_most(value, zero) } else { tape.at_least(value, zero) }
            }
        };
        Lowered { value, scale }
    }

    /// Whether a factor is finite for every argument except NaN.
    pub(super) fn is_bounded(&self, factor: usize) -> bool {
        self.clamps && is_clamped(&self.inputs[self.factors[factor].input])
    }

    /// The largest |x| of a factor in its range: every x is monotone there or, for a magnitude, largest at the ends.
    pub(super) fn magnitude(&self, factor: usize) -> Rational {
        let factor = &self.factors[factor];
        if let Shape::Wave { .. } = factor.shape {
            return integer(1);
        }
        let [low, high] = self.inputs[factor.input].range.map(|end| factor.value(exact(end)).abs());
        low.max(high)
    }

    /// z (w + |z|)/(w^2 + |z| (w + |z|)) with z = xi - at: the sigmoid without a division by the width.
    fn sigmoid(&self, tape: &mut TapeBuilder, input: usize, xi: Reg, at: f64, width: f64, is_symmetric: bool) -> Reg {
        let z = difference(tape, xi, &exact(at), &self.half(input).min(exact(width)));
        let magnitude = tape.push(Op::Absolute(z));
        let width_here = tape.constant(exact(width));
        let sum = tape.push(Op::Add(magnitude, width_here));
        let square = tape.constant(exact(width) * exact(width));
        let product = tape.push(Op::Multiply(magnitude, sum));
        let denominator = tape.push(Op::Add(product, square));
        let numerator = tape.push(Op::Multiply(z, sum));
        let step = tape.push(Op::Divide(numerator, denominator));
        if !is_symmetric || at == 0.0 {
            return step;
        }
        let at_zero = tape.constant(Shape::step(-exact(at), width));
        tape.push(Op::Subtract(step, at_zero))
    }

    /// An intermediate value in the formulas of [`crate::basis::Turn`], written once for all waves.
    fn wave(&mut self, tape: &mut TapeBuilder, of: &Waves, step: Wavelet) -> Reg {
        let key = (of.input, of.period.to_bits(), step);
        if let Some(known) = self.waves.get(&key) {
            return *known;
        }
        let quarter = exact(0.25);
        let made = match step {
            Wavelet::Turns => {
                let z = difference(tape, of.xi, &of.middle, &self.half(of.input));
                tape.times(z, integer(1) / exact(of.period))
            }
            Wavelet::Cosine(1) => {
                let t = self.wave(tape, of, Wavelet::Turns);
                let magnitude = tape.push(Op::Absolute(t));
                let quarter = tape.constant(quarter);
                let b = tape.push(Op::Subtract(quarter, magnitude));
                quarter_turn(tape, b)
            }
            Wavelet::Sine(1) => {
                let t = self.wave(tape, of, Wavelet::Turns);
                let quarter = tape.constant(quarter);
                let (above, below) = (tape.push(Op::Add(t, quarter)), tape.push(Op::Subtract(t, quarter)));
                let (above, below) = (tape.push(Op::Absolute(above)), tape.push(Op::Absolute(below)));
                let both = tape.push(Op::Subtract(above, below));
                let b = tape.push(Op::Subtract(both, t));
                quarter_turn(tape, b)
            }
            Wavelet::Cosine(order) if order % 2 == 0 => {
                let cosine = self.wave(tape, of, Wavelet::Cosine(order / 2));
                let sine = self.wave(tape, of, Wavelet::Sine(order / 2));
                let (one, other) = (tape.push(Op::Multiply(cosine, cosine)), tape.push(Op::Multiply(sine, sine)));
                tape.push(Op::Subtract(one, other))
            }
            Wavelet::Sine(order) if order % 2 == 0 => {
                let both = self.wave(tape, of, Wavelet::Both(order / 2));
                tape.push(Op::Add(both, both))
            }
            Wavelet::Both(order) => {
                let cosine = self.wave(tape, of, Wavelet::Cosine(order));
                let sine = self.wave(tape, of, Wavelet::Sine(order));
                tape.push(Op::Multiply(cosine, sine))
            }
            Wavelet::Cosine(order) | Wavelet::Sine(order) => {
                let [cosine, sine, first_cosine, first_sine] =
                    [Wavelet::Cosine(order - 1), Wavelet::Sine(order - 1), Wavelet::Cosine(1), Wavelet::Sine(1)]
                        .map(|step| self.wave(tape, of, step));
                let is_sine = matches!(step, Wavelet::Sine(_));
                let (a, b) = if is_sine { (sine, cosine) } else { (cosine, sine) };
                let (a, b) = (tape.push(Op::Multiply(a, first_cosine)), tape.push(Op::Multiply(b, first_sine)));
                tape.push(if is_sine { Op::Add(a, b) } else { Op::Subtract(a, b) })
            }
        };
        self.waves.insert(key, made);
        made
    }

    fn half(&self, input: usize) -> Rational {
        let [low, high] = self.inputs[input].range;
        (exact(high) - exact(low)) / integer(2)
    }

    /// (centre - xi)/xi
    fn relative_difference(&self, tape: &mut TapeBuilder, input: usize, xi: Reg, centre: &Rational) -> Reg {
        let below = difference(tape, xi, centre, &self.half(input));
        let above = tape.push(Op::Negate(below));
        tape.push(Op::Divide(above, xi))
    }
}

/// The waves of a periodic input.
struct Waves {
    input: usize,
    xi: Reg,
    middle: Rational,
    period: f64,
}

/// sin(2 pi b) for |b| <= 1/4, the polynomial of `QUARTER_TURN`.
fn quarter_turn(tape: &mut TapeBuilder, b: Reg) -> Reg {
    let square = tape.push(Op::Multiply(b, b));
    let mut coefficients = QUARTER_TURN.iter().rev().map(|k| exact(*k));
    let mut sum = tape.constant(coefficients.next().expect("there are eight"));
    for k in coefficients {
        let product = tape.push(Op::Multiply(sum, square));
        let k = tape.constant(k);
        sum = tape.push(Op::Add(product, k));
    }
    tape.push(Op::Multiply(b, sum))
}

/// The scale in x = v * scale; see the table at the top of this file.
fn scale(variable: Variable, hinge: Option<f64>) -> Rational {
    let one = integer(1);
    match variable {
        Variable::Natural | Variable::Magnitude => one,
        Variable::ScaledMagnitude { high } => one / exact(high),
        Variable::Centred { low, high } => integer(2) / (exact(high) - exact(low)),
        // 1/xi - 1/k = (k - xi)/xi * 1/k
        Variable::Reciprocal => hinge.map_or(one.clone(), |at| one / exact(at)),
        Variable::CentredReciprocal { low, high } => {
            let (low, high) = (exact(low), exact(high));
            match hinge {
                None => (&low + &high) / (high - low),
                Some(at) => integer(2) * &low * &high / ((high - low) * exact(at)),
            }
        }
    }
}

/// xi - centre. The rounding error of `centre` in the tape's precision is corrected by a second subtraction if it would exceed two units of roundoff
/// of the coded variable. Below that it is not larger than the rounding error of the first subtraction.
fn difference(tape: &mut TapeBuilder, xi: Reg, centre: &Rational, half: &Rational) -> Reg {
    let precision = tape.precision();
    let rounded = exact(precision.round(centre));
    let rest = centre - &rounded;
    let tolerance = half * exact(2.0 * precision.unit_roundoff());
    if rest <= tolerance && -&rest <= tolerance {
        if rounded == integer(0) {
            return xi;
        }
        let centre = tape.constant(centre.clone());
        return tape.push(Op::Subtract(xi, centre));
    }
    let (centre, rest) = (tape.constant(rounded), tape.constant(rest));
    let coarse = tape.push(Op::Subtract(xi, centre));
    tape.push(Op::Subtract(coarse, rest))
}
