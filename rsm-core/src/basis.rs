//! The factors of a surface: the variables whose powers make a term.
//!
//! In: a surface and the ranges of its inputs. Out: one [`Factor`] for each input, then one for each knot, one for each sigmoid, and two for each
//! wave, in the order of a term's powers. The formulas are written once, generic over the arithmetic: the rational reference and the fitter both use
//! them. Lowering has its own folded form, which tests compare with this one.

use crate::model::{Coding, Input, Outside, Sigmoid, Spline, Surface, Symmetry, Wave};

/// Arithmetic in which a factor can be evaluated: rationals, double-doubles.
pub trait Arithmetic:
    Clone
    + PartialOrd
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
    + std::ops::Div<Output = Self>
    + std::ops::Neg<Output = Self>
{
    /// A finite f64, exactly.
    fn of(value: f64) -> Self;
}

/// Rounded at every step, for approximate values.
impl Arithmetic for f64 {
    fn of(value: f64) -> Self {
        value
    }
}

impl Arithmetic for crate::number::Rational {
    fn of(value: f64) -> Self {
        crate::number::exact(value)
    }
}

/// The conversion of a natural variable to the variable x of the polynomial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Variable {
    /// x = xi.
    Natural,
    /// x = (xi - mid)/half (22), (23).
    Centred {
        /// The lower end of the range.
        low: f64,
        /// The upper end of the range.
        high: f64,
    },
    /// x = |xi| (coding none).
    Magnitude,
    /// x = |xi|/high.
    ScaledMagnitude {
        /// The upper end of the symmetric range.
        high: f64,
    },
    /// x = 1/xi (coding none).
    Reciprocal,
    /// x = (1/xi - mid)/half over [1/high, 1/low].
    CentredReciprocal {
        /// The lower end of the range of xi.
        low: f64,
        /// The upper end of the range of xi.
        high: f64,
    },
}

/// The base of one power of a term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor {
    /// The index of the surface's input.
    pub input: usize,
    /// The coding of that input.
    pub variable: Variable,
    /// The function of that variable, or of the input itself.
    pub shape: Shape,
}

/// The function of a factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// The variable x.
    Itself,
    /// The hinge max(0, x(xi) - x(at)).
    Hinge {
        /// The natural value of the knot.
        at: f64,
    },
    /// The sigmoid u = s (1 + |s|)/(1 + |s| + s^2), s = (xi - at)/width, of the natural value; for a symmetric input u(|xi|) - u(0). It is rational,
    /// so a target needs no root. It rises from -1 to 1, and its first three derivatives are continuous.
    Sigmoid {
        /// The natural value at which it is 0.
        at: f64,
        /// 1 over its slope there.
        width: f64,
        /// Whether it is of |xi|, and 0 at 0.
        is_symmetric: bool,
    },
    /// Cosine or sine of 2 pi order (xi - middle)/period: see [`Turn`].
    Wave {
        /// The lower end of the range of xi.
        low: f64,
        /// The upper end of the range.
        high: f64,
        /// The period of order 1.
        period: f64,
        /// The number of waves in a period.
        order: u32,
        /// Sine; otherwise the cosine.
        is_sine: bool,
    },
}

/// sin(2 pi b) = b (K(0) + K(1) b^2 + ...) for |b| <= 1/4, with an error below 3e-16: an interpolation at the zeros of a Chebyshev polynomial, in 60
/// digits. These numbers define a wave: its exact reference uses them too.
pub(crate) const QUARTER_TURN: [f64; 8] = [
    6.283185307179585,
    -41.341702240398284,
    81.60524927557977,
    -76.70585968962867,
    42.05868995395094,
    -15.09450614073429,
    3.817365633469135,
    -0.6925067010720717,
];

/// Cosine and sine of 2 pi order t, t in turns from -1/2 to 1/2.
///
/// For order 1 by folding, cos = S(1/4 - |t|), sin = S(|t + 1/4| - |t - 1/4| - t), with the polynomial S of `QUARTER_TURN`. For higher orders as the
/// power of a complex number, by squaring, along its binary digits from the highest.
#[derive(Debug, Clone, PartialEq)]
pub struct Turn<T> {
    /// The cosine.
    pub cosine: T,
    /// The sine.
    pub sine: T,
}

impl<T: Arithmetic> Turn<T> {
    /// Cosine and sine for t in turns.
    #[must_use]
    pub fn of(t: T, order: u32) -> Self {
        let magnitude = |x: T| if x < T::of(0.0) { -x } else { x };
        let quarter = T::of(0.25);
        let fold = magnitude(t.clone() + quarter.clone()) - magnitude(t.clone() - quarter.clone()) - t.clone();
        let first = Turn { cosine: quarter_turn(quarter - magnitude(t)), sine: quarter_turn(fold) };
        let mut power = first.clone();
        for digit in (0..order.ilog2()).rev() {
            let both = power.cosine.clone() * power.sine.clone();
            let cosine = power.cosine.clone() * power.cosine - power.sine.clone() * power.sine;
            power = Turn { cosine, sine: both.clone() + both };
            if order >> digit & 1 == 1 {
                power = Turn {
                    cosine: power.cosine.clone() * first.cosine.clone() - power.sine.clone() * first.sine.clone(),
                    sine: power.sine * first.cosine.clone() + power.cosine * first.sine.clone(),
                };
            }
        }
        power
    }
}

/// sin(2 pi b) for |b| <= 1/4.
fn quarter_turn<T: Arithmetic>(b: T) -> T {
    let square = b.clone() * b.clone();
    let (last, others) = QUARTER_TURN.split_last().expect("there are eight");
    let sum = others.iter().rev().fold(T::of(*last), |sum, k| sum * square.clone() + T::of(*k));
    b * sum
}

impl Shape {
    /// The sigmoid of z = xi - at: z (w + |z|)/(w^2 + |z| (w + |z|)).
    #[must_use]
    pub fn step<T: Arithmetic>(z: T, width: f64) -> T {
        let width = T::of(width);
        let magnitude = if z < T::of(0.0) { -z.clone() } else { z.clone() };
        let sum = width.clone() + magnitude.clone();
        z * sum.clone() / (width.clone() * width + magnitude * sum)
    }
}

impl Variable {
    /// The variable of an input of a surface.
    #[must_use]
    pub fn of(surface: &Surface, input: &Input) -> Self {
        let [low, high] = input.range;
        let symmetric = surface.is_symmetric(&input.name);
        let reciprocal = surface.reciprocal.contains(&input.name);
        match (surface.coding, symmetric, reciprocal) {
            (Coding::None, false, false) => Variable::Natural,
            (Coding::None, true, _) => Variable::Magnitude,
            (Coding::None, false, true) => Variable::Reciprocal,
            (Coding::Range, false, false) => Variable::Centred { low, high },
            (Coding::Range, true, _) => Variable::ScaledMagnitude { high },
            (Coding::Range, false, true) => Variable::CentredReciprocal { low, high },
        }
    }

    /// x of xi.
    #[must_use]
    pub fn value<T: Arithmetic>(&self, xi: T) -> T {
        let magnitude = |xi: T| if xi < T::of(0.0) { -xi } else { xi };
        match *self {
            Variable::Natural => xi,
            Variable::Magnitude => magnitude(xi),
            Variable::ScaledMagnitude { high } => magnitude(xi) / T::of(high),
            Variable::Reciprocal => T::of(1.0) / xi,
            // (xi - (high + low)/2) / ((high - low)/2)
            Variable::Centred { low, high } => {
                let (low, high) = (T::of(low), T::of(high));
                (xi.clone() + xi - (high.clone() + low.clone())) / (high - low)
            }
            // (1/xi - (1/low + 1/high)/2) / ((1/low - 1/high)/2)
            Variable::CentredReciprocal { low, high } => {
                let (top, bottom) = (T::of(1.0) / T::of(low), T::of(1.0) / T::of(high));
                let inverse = T::of(1.0) / xi;
                (inverse.clone() + inverse - (top.clone() + bottom.clone())) / (top - bottom)
            }
        }
    }
}

impl Factor {
    /// The factors of a surface in the order of a term's powers: inputs, knots, sigmoids, waves. `inputs` are those of the surface, in its order.
    ///
    /// # Panics
    /// If a knot or a sigmoid has an input that the surface does not have: [`crate::check`] rejects such a file.
    #[must_use]
    pub fn all(surface: &Surface, inputs: &[Input]) -> Vec<Factor> {
        let main = inputs.iter().enumerate();
        let mut factors: Vec<Factor> =
            main.map(|(k, input)| Factor { input: k, variable: Variable::of(surface, input), shape: Shape::Itself }).collect();
        let place = |name: &str| inputs.iter().position(|input| input.name == name).expect("it is of an input of the surface");
        for knot in &surface.knots {
            factors.push(Factor { shape: Shape::Hinge { at: knot.at }, ..factors[place(&knot.input)] });
        }
        for Sigmoid { input, at, width } in &surface.sigmoids {
            let shape = Shape::Sigmoid { at: *at, width: *width, is_symmetric: surface.is_symmetric(input) };
            factors.push(Factor { shape, ..factors[place(input)] });
        }
        for Wave { input, period, order } in &surface.waves {
            let [low, high] = inputs[place(input)].range;
            for is_sine in [false, true] {
                let shape = Shape::Wave { low, high, period: *period, order: *order, is_sine };
                factors.push(Factor { shape, ..factors[place(input)] });
            }
        }
        factors
    }

    /// The value of the factor at xi, which is not clamped here.
    #[must_use]
    pub fn value<T: Arithmetic>(&self, xi: T) -> T {
        match self.shape {
            Shape::Itself => self.variable.value(xi),
            Shape::Hinge { at } => {
                let above = self.variable.value(xi) - self.variable.value(T::of(at));
                if above < T::of(0.0) { T::of(0.0) } else { above }
            }
            Shape::Sigmoid { at, width, is_symmetric: false } => Shape::step(xi - T::of(at), width),
            Shape::Sigmoid { at, width, is_symmetric: true } => {
                let magnitude = if xi < T::of(0.0) { -xi } else { xi };
                Shape::step(magnitude - T::of(at), width) - Shape::step(-T::of(at), width)
            }
            Shape::Wave { low, high, period, order, is_sine } => {
                let twice = xi.clone() + xi - (T::of(high) + T::of(low));
                let Turn { cosine, sine } = Turn::of(twice / (T::of(period) + T::of(period)), order);
                if is_sine { sine } else { cosine }
            }
        }
    }
}

/// The spline of a surface at a point inside the ranges of its inputs.
#[must_use]
pub fn spline<T: Arithmetic>(spline: &Spline, ranges: &[[f64; 2]], point: &[T]) -> T {
    let strides = spline.strides();
    // The products of the weights so far, each with the place of its coefficient.
    let mut products: Vec<(usize, T)> = vec![(0, T::of(1.0))];
    for (k, xi) in point.iter().enumerate() {
        let (first, weights) = spline_weights(spline.degree, spline.cells[k], ranges[k], xi.clone());
        let times = |(place, product): &(usize, T)| -> Vec<(usize, T)> {
            let at = |(i, weight): (usize, &T)| (place + (first + i) * strides[k], product.clone() * weight.clone());
            weights.iter().enumerate().map(at).collect()
        };
        products = products.iter().flat_map(times).collect();
    }
    products.into_iter().fold(T::of(0.0), |sum, (place, product)| sum + product * T::of(spline.coefficients[place]))
}

/// The values of the degree + 1 basis functions that are not zero at xi, and the index of the first of them.
#[must_use]
pub fn spline_weights<T: Arithmetic>(degree: u32, cells: u32, [low, high]: [f64; 2], xi: T) -> (usize, Vec<T>) {
    let (low, high) = (T::of(low), T::of(high));
    let t = (xi - low.clone()) * T::of(f64::from(cells)) / (high - low);
    let mut cell = 0;
    while cell + 1 < cells && t >= T::of(f64::from(cell + 1)) {
        cell += 1;
    }
    let u = t - T::of(f64::from(cell));
    let v = T::of(1.0) - u.clone();
    let weights = if degree == 1 {
        vec![v, u]
    } else {
        // De Boor, "A Practical Guide to Splines" (1978), for uniform knots: the cubes of the outer ones, the others from 4 - 3 u^2 (2 - u).
        let [one, three, four, six] = [1.0, 3.0, 4.0, 6.0].map(T::of);
        let inner = |it: &T, other: &T| four.clone() - three.clone() * it.clone() * it.clone() * (one.clone() + other.clone());
        let cube = |it: &T| it.clone() * it.clone() * it.clone();
        [cube(&v), inner(&u, &v), inner(&v, &u), cube(&u)].map(|weight| weight / six.clone()).to_vec()
    };
    (cell as usize, weights)
}

/// xi as in the evaluator: clamped to the range if the input clamps.
#[must_use]
pub fn clamped<T: Arithmetic>(input: &Input, xi: T) -> T {
    let [low, high] = input.range.map(T::of);
    match input.outside {
        Outside::Extrapolate => xi,
        Outside::Clamp if xi < low => low,
        Outside::Clamp if high < xi => high,
        Outside::Clamp => xi,
    }
}

/// Whether odd symmetry makes the result negative: an odd number of odd inputs is negative.
#[must_use]
pub fn is_negated<T: Arithmetic>(surface: &Surface, inputs: &[Input], point: &[T]) -> bool {
    let odd = |name: &str| surface.symmetry.iter().any(|(input, symmetry)| input == name && *symmetry == Symmetry::Odd);
    inputs.iter().zip(point).filter(|(input, xi)| odd(&input.name) && **xi < T::of(0.0)).count() % 2 == 1
}

/// A factor to a power, by repeated multiplication; 1 for power 0.
#[must_use]
pub fn power<T: Arithmetic>(base: &T, exponent: u32) -> T {
    (0..exponent).fold(T::of(1.0), |product, _| product * base.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number::{Rational, exact, integer};

    /// sin x by its series, for |x| <= 4: the error after 40 terms is less than 10^-60.
    fn sine(x: &Rational) -> Rational {
        let square = x * x;
        let mut term = x.clone();
        let mut sum = x.clone();
        for k in 1..40 {
            term = -term * &square / integer(2 * k * (2 * k + 1));
            sum += &term;
        }
        sum
    }

    #[test]
    fn a_wave_is_a_cosine_and_a_sine_but_for_less_than_is_said() {
        // Between pi/2 and pi there are at most 12 turns: an error of 1e-19 in pi is far below 1e-15.
        let pi = integer(3_141_592_653_589_793_238) / integer(1_000_000_000_000_000_000);
        for t in [-0.5, -0.4375, -0.25, -0.1, 0.0, 0.03125, 0.2, 0.25, 0.3, 0.5] {
            for order in [1, 2, 3, 6, 7, 12] {
                let found = Turn::of(exact(t), order);
                // Remove whole turns, so that the series is short.
                let turns = exact(t) * integer(i64::from(order));
                let rest = &turns - turns.round();
                let angle = integer(2) * &pi * rest;
                let quarter = &pi / integer(2);
                let within = exact(1e-15) * integer(i64::from(order) + 1);
                for (what, found, truth) in
                    [("sin", found.sine, sine(&angle)), ("cos", found.cosine, sine(&(quarter - &angle)))]
                {
                    let off = found - truth;
                    assert!(off < within && -off < within, "{what} of order {order} at {t}");
                }
            }
        }
    }
}
