//! Parts of the box on which every term is a polynomial, up to a known error.
//!
//! In: a surface. Out: its parts, and each term there as a polynomial, with bounds of what the polynomial leaves out. Without sigmoids and waves the
//! parts are the pieces between knots, the polynomials are exact, and their variables are the main variables. An input with a sigmoid or a wave is
//! divided further. There the variable of the polynomials is t in [-1, 1] over the part, and the sigmoid or wave is its Taylor polynomial in t. The
//! errors of its value and its derivatives are bounded. No coefficient of a surface is used here.
//!
//! ```text
//! sigmoid   s > 0: u = 1 - 1/(1 + s + s^2) = 1 - (2/sqrt 3) Im 1/(s - p), p = -1/2 + i sqrt(3)/2. The n-th Taylor coefficient at c is at most
//!           (2/sqrt 3)/D^(n+1) with D = |c - p|, so a part of half width q D leaves q^17 of it; s < 0: -u(-s)
//! wave      a part of half width 1.5 rad leaves 1.5^17/17!
//! ```

use rsm_core::basis::{Factor, Shape};
use rsm_core::interval::Interval;
use rsm_core::model::{HalfSpace, Input, Knot, Surface};
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::pieces::{self, Piece, Polynomial};

/// The degree of the Taylor polynomials.
const DEGREE: usize = 16;

/// Half the width of a part as a share of the distance to the nearest pole of a sigmoid. It leaves 2e-12 of the value and, after two derivatives over
/// a part of 1/30 of the range, 10^-6: less than the margin that the second derivative needs.
const SHARE_OF_POLE: f64 = 0.2;

/// Half the width of a part for a wave, in radians.
const HALF_TURN: f64 = 1.5;

/// Rounding of the coefficients of a Taylor polynomial, and of the sigmoid or wave itself (`rsm_core::range`).
const ROUNDING: f64 = 1e-14;

/// Bounds of the value and two derivatives of a function of t, and of the errors of its polynomial.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    most: [f64; 3],
    error: [f64; 3],
}

/// A function of one variable: a dense polynomial with bounds of its error.
#[derive(Debug, Clone)]
struct Along {
    polynomial: Vec<Rational>,
    bounds: Bounds,
}

/// A part of the box.
pub(super) struct Part {
    piece: Piece,
    /// For each input with steps, the middle and half of the main variable's range.
    local: Vec<Option<[Rational; 2]>>,
    /// For every sigmoid and wave variable, its input and the function.
    steps: Vec<(usize, Along)>,
    /// The input of each knot.
    knots: Vec<usize>,
}

/// Whether a surface has sigmoids or waves, used by its terms or not.
pub(super) fn has_steps(surface: &Surface) -> bool {
    !surface.sigmoids.is_empty() || !surface.waves.is_empty()
}

impl Part {
    /// All parts of a surface.
    pub(super) fn all(surface: &Surface, inputs: &[Input]) -> Vec<Part> {
        if !has_steps(surface) {
            let whole =
                |piece: Piece| Part { local: vec![None; piece.cell.len()], piece, steps: Vec::new(), knots: Vec::new() };
            return pieces::all(surface, inputs).into_iter().map(whole).collect();
        }
        let factors = Factor::all(surface, inputs);
        let cuts = cuts(surface, inputs, &factors);
        let mut plain = Surface { sigmoids: Vec::new(), waves: Vec::new(), ..surface.clone() };
        plain.knots.extend(cuts.into_iter().map(|(k, at)| Knot { input: inputs[k].name.clone(), at }));
        let place = |name: &String| inputs.iter().position(|input| input.name == *name).expect("a knot has an input");
        let knots: Vec<usize> = surface.knots.iter().map(|knot| place(&knot.input)).collect();
        let steps = &factors[inputs.len() + knots.len()..];
        let of_piece = |piece: Piece| {
            let is_bent = |k: usize| steps.iter().any(|step| step.input == k);
            let middle_and_half = |k: usize| {
                let [low, high] = piece.cell[k].map(|end| factors[k].variable.value(exact(end)));
                [(&high + &low) / integer(2), (high - low) / integer(2)]
            };
            let local = (0..inputs.len()).map(|k| is_bent(k).then(|| middle_and_half(k))).collect();
            let steps = steps.iter().map(|step| (step.input, taylor(step, piece.cell[step.input]))).collect();
            Part { local, steps, knots: knots.clone(), piece }
        };
        pieces::all(&plain, inputs).into_iter().map(of_piece).collect()
    }

    /// The number of parts.
    pub(super) fn count(surface: &Surface, inputs: &[Input]) -> usize {
        let factors = Factor::all(surface, inputs);
        let cuts = cuts(surface, inputs, &factors);
        let own = |k: usize| surface.knots.iter().filter(|knot| knot.input == inputs[k].name).count();
        let of_input = |k: usize| 1 + own(k) + cuts.iter().filter(|(input, _)| *input == k).count();
        (0..inputs.len()).map(of_input).product()
    }

    /// The index along each input.
    pub(super) fn place(&self) -> &[usize] {
        &self.piece.place
    }

    /// The upper end along an input, in natural units.
    pub(super) fn upper_end(&self, input: usize) -> f64 {
        self.piece.cell[input][1]
    }

    pub(super) fn is_local(&self, input: usize) -> bool {
        self.local[input].is_some()
    }

    /// The range of each main variable.
    pub(super) fn main(&self) -> Vec<Interval> {
        self.piece.sides.clone()
    }

    /// The range of each variable of the polynomials.
    pub(super) fn sides(&self) -> Vec<Interval> {
        let side = |(main, local): (&Interval, &Option<_>)| if local.is_some() { Interval::new(-1.0, 1.0) } else { *main };
        self.piece.sides.iter().zip(&self.local).map(side).collect()
    }

    /// The derivative of a variable of the polynomials with respect to the main variable.
    pub(super) fn slope(&self, input: usize) -> Rational {
        self.local[input].as_ref().map_or_else(|| integer(1), |[_, half]| integer(1) / half)
    }

    /// For each input whose variable is not the main one, the middle and half of the main variable.
    pub(super) fn units(&self) -> Vec<Option<[f64; 2]>> {
        self.local.iter().map(|local| local.as_ref().map(|both| both.each_ref().map(|x| Precision::F64.round(x)))).collect()
    }

    /// A term of coefficient 1.
    pub(super) fn term(&self, powers: &[u32]) -> Polynomial {
        if self.steps.is_empty() {
            return self.piece.term(powers);
        }
        let mut product: Polynomial = vec![(Vec::new(), integer(1))];
        for along in self.each_axis(powers) {
            let times = |(begun, factor): &(Vec<u32>, Rational)| {
                let each = along.polynomial.iter().enumerate().filter(|(_, coefficient)| **coefficient != integer(0));
                each.map(|(power, coefficient)| ([&begun[..], &[power as u32]].concat(), factor * coefficient))
                    .collect::<Vec<_>>()
            };
            product = product.iter().flat_map(times).collect();
        }
        product
    }

    /// A bound of the error of a term that is differentiated once for each entry of `by`, with respect to the variables of the polynomials.
    pub(super) fn error(&self, powers: &[u32], by: &[usize]) -> f64 {
        if self.steps.iter().zip(self.of_steps(powers)).all(|(_, power)| *power == 0) {
            return 0.0;
        }
        let (mut exact, mut with_error) = (1.0, 1.0);
        for (k, along) in self.each_axis(powers).into_iter().enumerate() {
            let order = by.iter().filter(|axis| **axis == k).count();
            exact *= along.bounds.most[order];
            with_error *= along.bounds.most[order] + along.bounds.error[order];
        }
        // The difference of two rounded products.
        (with_error - exact) + 1e-15 * with_error
    }

    fn of_steps<'a>(&self, powers: &'a [u32]) -> &'a [u32] {
        &powers[self.local.len() + self.knots.len()..]
    }

    /// The term as a product of functions of one variable each.
    fn each_axis(&self, powers: &[u32]) -> Vec<Along> {
        let inputs = self.local.len();
        let of_axis = |k: usize| {
            let own = |(place, power): (usize, &u32)| {
                let input = if place < inputs { place } else { self.knots[place - inputs] };
                if input == k { *power } else { 0 }
            };
            let powers_here: Vec<u32> = powers[..inputs + self.knots.len()].iter().enumerate().map(own).collect();
            let mut polynomial: Vec<Rational> = Vec::new();
            for (power, coefficient) in self.piece.term(&powers_here) {
                let power = power[k] as usize;
                polynomial.resize(polynomial.len().max(power + 1), integer(0));
                polynomial[power] += coefficient;
            }
            let radius = match &self.local[k] {
                None => self.piece.sides[k].magnitude(),
                Some([middle, half]) => {
                    polynomial = shifted(&polynomial, middle, half);
                    1.0
                }
            };
            let steps = self.steps.iter().zip(self.of_steps(powers)).filter(|((input, _), power)| *input == k && **power > 0);
            steps.fold(Along::exact(polynomial, radius), |product, ((_, step), power)| {
                (0..*power).fold(product, |product, _| product.times(step))
            })
        };
        (0..inputs).map(of_axis).collect()
    }
}

impl Along {
    fn exact(polynomial: Vec<Rational>, radius: f64) -> Self {
        let size = |coefficient: &Rational| Precision::F64.round(coefficient).abs();
        let most = |order: usize| {
            let part = |(power, coefficient): (usize, &Rational)| {
                if power < order {
                    return 0.0;
                }
                let falling: f64 = (0..order).map(|k| (power - k) as f64).product();
                size(coefficient) * falling * radius.powi((power - order) as i32)
            };
            // Rounded up by more than the roundings of these sums.
            polynomial.iter().enumerate().map(part).sum::<f64>() * (1.0 + 1e-12)
        };
        let bounds = Bounds { most: [most(0), most(1), most(2)], error: [0.0; 3] };
        Along { polynomial, bounds }
    }

    fn times(&self, other: &Along) -> Self {
        let length = (self.polynomial.len() + other.polynomial.len()).saturating_sub(1);
        let mut polynomial = vec![integer(0); if self.polynomial.is_empty() { 0 } else { length }];
        for (i, a) in self.polynomial.iter().enumerate() {
            for (j, b) in other.polynomial.iter().enumerate() {
                polynomial[i + j] += a * b;
            }
        }
        let (one, two) = (&self.bounds, &other.bounds);
        let pair = |i: usize, j: usize| {
            let (a, b) = (one.most[i], two.most[j]);
            [a * b, a * two.error[j] + one.error[i] * b + one.error[i] * two.error[j]]
        };
        let leibniz = |order: usize| match order {
            0 => pair(0, 0),
            1 => [0, 1].map(|k| pair(1, 0)[k] + pair(0, 1)[k]),
            _ => [0, 1].map(|k| pair(2, 0)[k] + 2.0 * pair(1, 1)[k] + pair(0, 2)[k]),
        };
        let [most, error] = [0, 1].map(|k| [0, 1, 2].map(|order| leibniz(order)[k] * (1.0 + 1e-12)));
        Along { polynomial, bounds: Bounds { most, error } }
    }
}

/// The polynomial in t for x = middle + half t.
fn shifted(polynomial: &[Rational], middle: &Rational, half: &Rational) -> Vec<Rational> {
    let mut sum: Vec<Rational> = Vec::new();
    for coefficient in polynomial.iter().rev() {
        // sum (middle + half t) + coefficient
        let mut next = vec![integer(0); sum.len() + 1];
        for (power, value) in sum.iter().enumerate() {
            next[power] += value * middle;
            next[power + 1] += value * half;
        }
        next[0] += coefficient;
        sum = next;
    }
    sum
}

/// The Taylor polynomial of a sigmoid or wave over a side in natural units.
fn taylor(step: &Factor, [low, high]: [f64; 2]) -> Along {
    let (middle, half) = (low / 2.0 + high / 2.0, high / 2.0 - low / 2.0);
    let (coefficients, left_out, rounding) = match step.shape {
        Shape::Sigmoid { at, width, is_symmetric } => {
            sigmoid((middle - at) / width, half / width, is_symmetric.then_some(at / width))
        }
        Shape::Wave { low: bottom, high: top, period, order, is_sine } => {
            let turns = std::f64::consts::TAU * f64::from(order) / period;
            let phase = turns * (middle - (bottom / 2.0 + top / 2.0)) - if is_sine { std::f64::consts::FRAC_PI_2 } else { 0.0 };
            let (coefficients, left_out) = cosine(phase, turns * half);
            (coefficients, left_out, ROUNDING * (f64::from(order) + 10.0))
        }
        _ => unreachable!("it is a sigmoid or a wave"),
    };
    let mut along = Along::exact(coefficients.iter().map(|c| exact(*c)).collect(), 1.0);
    // Errors of coefficients, after so many derivatives.
    along.bounds.error = [0, 1, 2].map(|order| 1.01 * left_out[order] + rounding * (DEGREE as f64).powi(order as i32));
    along
}

/// u(c + h t), and what the polynomial leaves out of it and its derivatives. `zero`: for |xi|, the negative argument at 0, whose value is taken off.
fn sigmoid(c: f64, h: f64, zero: Option<f64>) -> (Vec<f64>, [f64; 3], f64) {
    let sign = if c < 0.0 { -1.0 } else { 1.0 };
    // 1/(c - p) as a complex number, and its powers.
    let (re, im) = (c.abs() + 0.5, -(0.75f64.sqrt()));
    let square = re * re + im * im;
    let inverse = [re / square, -im / square];
    let mut power = inverse;
    let mut coefficients = Vec::new();
    let mut scale = 2.0 / 3f64.sqrt();
    for n in 0..=DEGREE {
        let own = scale * power[1];
        coefficients.push(if n == 0 { sign * (1.0 - own) } else { -sign * own });
        power = [power[0] * inverse[0] - power[1] * inverse[1], power[0] * inverse[1] + power[1] * inverse[0]];
        // (-1)^n from the series, sign^n from the mirror.
        scale *= -h * sign;
    }
    if let Some(zero) = zero {
        coefficients[0] += Shape::step(zero, 1.0);
    }
    let (q, next) = (h / square.sqrt(), (DEGREE + 1) as f64);
    let first = 2.0 / 3f64.sqrt() / square.sqrt() * q.powi(DEGREE as i32 + 1);
    let rest = 1.0 - q;
    // The sums of q^n, n q^n and n^2 q^n from n = next on.
    let left_out = [first / rest, first * next / rest.powi(2), first * next * next * (1.0 + q) / rest.powi(3)];
    (coefficients, left_out, ROUNDING)
}

/// cos(phase + h t), and what the polynomial leaves out of it and its derivatives.
fn cosine(phase: f64, h: f64) -> (Vec<f64>, [f64; 3]) {
    let mut scale = 1.0;
    let mut coefficients = Vec::new();
    for n in 0..=DEGREE {
        coefficients.push(scale * (phase + n as f64 * std::f64::consts::FRAC_PI_2).cos());
        scale *= h / (n + 1) as f64;
    }
    // scale is h^17/17!. Later terms fall by more than h/18.
    let (next, rest) = ((DEGREE + 1) as f64, 1.0 - h / (DEGREE + 1) as f64);
    (coefficients, [scale / rest, scale * next / rest, scale * next * (next - 1.0) / rest])
}

/// The inner ends of parts that sigmoids and waves need, each with its input.
fn cuts(surface: &Surface, inputs: &[Input], factors: &[Factor]) -> Vec<(usize, f64)> {
    let mut cuts: Vec<(usize, f64)> = Vec::new();
    for factor in factors {
        let input = &inputs[factor.input];
        let low = if surface.is_symmetric(&input.name) { 0.0 } else { input.range[0] };
        let high = input.range[1];
        let found: Vec<f64> = match factor.shape {
            Shape::Sigmoid { at, width, .. } => {
                let ends = |from: f64, to: f64| {
                    let mut ends = vec![from];
                    let mut s = from;
                    while s < to {
                        let half = |half: f64| 0.999 * SHARE_OF_POLE * ((s + half + 0.5).powi(2) + 0.75).sqrt();
                        // The width of the part depends on its middle: a contraction by less than 0.2.
                        s += 2.0 * (0..8).fold(0.0, |found, _| half(found));
                        ends.push(s);
                    }
                    ends
                };
                let (from, to) = ((low - at) / width, (high - at) / width);
                let above = ends(from.max(0.0), to.max(0.0)).into_iter().map(|s| at + width * s);
                let below = ends((-to).max(0.0), (-from).max(0.0)).into_iter().map(|s| at - width * s);
                above.chain(below).collect()
            }
            Shape::Wave { period, order, is_sine: false, .. } => {
                let angle = std::f64::consts::TAU * f64::from(order) / period * (high - low);
                let count = (angle / (2.0 * HALF_TURN)).ceil();
                (1..count as usize).map(|k| low + (high - low) * k as f64 / count).collect()
            }
            _ => continue,
        };
        cuts.extend(found.into_iter().filter(|at| low < *at && *at < high).map(|at| (factor.input, at)));
    }
    cuts.retain(|(k, at)| !surface.knots.iter().any(|knot| knot.input == inputs[*k].name && knot.at == *at));
    cuts.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    cuts.dedup();
    cuts
}

/// Half-spaces of the main variables as half-spaces of the variables of the polynomials, rounded outward.
pub(super) fn in_units(spaces: &[HalfSpace], units: &[Option<[f64; 2]>]) -> Vec<HalfSpace> {
    let of_one = |space: &HalfSpace| {
        let (mut bound, mut size) = (space.bound, space.bound.abs());
        let mut normal = space.normal.clone();
        for (n, unit) in normal.iter_mut().zip(units) {
            if let Some([middle, half]) = unit {
                bound -= *n * middle;
                size += n.abs() * (middle.abs() + half.abs());
                *n *= half;
            }
        }
        let is_same = units.iter().all(Option::is_none);
        // Some roundings of each product and sum.
        HalfSpace { normal, bound: if is_same { bound } else { bound + 1e-14 * size } }
    };
    spaces.iter().map(of_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The polynomial, its derivatives and their errors against the function, at points of parts.
    #[test]
    fn a_polynomial_errs_by_less_than_its_bound() {
        let value = |polynomial: &[f64], t: f64| polynomial.iter().rev().fold(0.0, |sum, c| sum * t + c);
        let slopes = |polynomial: &[f64]| (1..polynomial.len()).map(|k| k as f64 * polynomial[k]).collect::<Vec<f64>>();
        for c in [0.0f64, 0.21, -0.21, 1.0, -3.0, 30.0] {
            let h = (SHARE_OF_POLE * (c.abs() + 0.5).hypot(0.75f64.sqrt())).min(if c == 0.0 { 1.0 } else { c.abs() });
            let c = if c == 0.0 { h } else { c };
            let (polynomial, left_out, _) = sigmoid(c, h, None);
            assert!(left_out[0] < 1e-11 && left_out[2] < 1e-7, "{left_out:?}");
            let first = slopes(&polynomial);
            for t in [-1.0, -0.7, 0.0, 0.3, 1.0] {
                let s: f64 = c + h * t;
                let p = s.abs() + s * s;
                let slope = h * (1.0 + 2.0 * s.abs()) / (1.0 + p).powi(2);
                assert!((value(&polynomial, t) - Shape::step(s, 1.0)).abs() <= 1.01 * left_out[0] + ROUNDING, "{c} {t}");
                assert!((value(&first, t) - slope).abs() <= 1.01 * left_out[1] + 16.0 * ROUNDING, "{c} {t}");
            }
        }
        for phase in [0.0, 1.0, -2.5, 400.0] {
            let (polynomial, left_out) = cosine(phase, HALF_TURN);
            assert!(left_out[0] < 1e-11, "{left_out:?}");
            for t in [-1.0, -0.4, 0.0, 0.9, 1.0] {
                let error = (value(&polynomial, t) - f64::cos(phase + HALF_TURN * t)).abs();
                assert!(error <= 1.01 * left_out[0] + 10.0 * ROUNDING, "{phase} {t} {error:e}");
            }
        }
    }
}
