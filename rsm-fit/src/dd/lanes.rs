//! The operations of `dd.rs` on several numbers at once.
//!
//! In: numbers of consecutive rows, one in each lane. Out: in each lane the bits that `Dd` gives there, by the same operations in the same order;
//! branches become choices between two results. A compiler makes vector instructions of the loops over lanes. The error of a product is that of a
//! fused multiply-add, with one where it is an instruction, and by splitting elsewhere.

use super::{Dd, exponent, fast_two_sum, is_exact, is_zero, product_with, split_error, sum, two_prod, two_sum};
use rsm_core::vector;

/// The number of lanes: one register of AVX-512, two of AVX, four of SSE2.
pub(crate) const LANES: usize = 8;

/// The exponent of numbers that are not finite.
const INFINITE: u64 = 0x7ff;

/// A number in each lane, in whole lines of the cache: a register is then one access.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes {
    high: [f64; LANES],
    low: [f64; LANES],
}

/// A loop over lanes. `compute` and everything that it calls on lanes must have the attribute `inline(always)`, as for [`vector::Work`].
pub(crate) trait Work {
    /// The result.
    type Found;

    /// The loop. `FUSED`: whether `f64::mul_add` is one instruction. The bits are the same.
    fn compute<const FUSED: bool>(self) -> Self::Found;
}

/// Runs a loop with the widest registers of this machine.
#[inline]
pub(crate) fn widest<W: Work>(work: W) -> W::Found {
    vector::widest(Either(work))
}

struct Either<W>(W);

impl<W: Work> vector::Work for Either<W> {
    type Found = W::Found;

    #[inline(always)]
    fn run(self) -> W::Found {
        self.0.compute::<false>()
    }

    #[inline(always)]
    fn run_fused(self) -> W::Found {
        self.0.compute::<true>()
    }
}

/// One operation in every lane.
#[inline(always)]
fn each(operation: impl Fn(usize) -> (f64, f64)) -> Lanes {
    let mut result = Lanes::ZERO;
    for lane in 0..LANES {
        (result.high[lane], result.low[lane]) = operation(lane);
    }
    result
}

/// One operation in every lane, with the rounded product of two numbers and its error. All steps are in one loop, of which a compiler makes vector
/// instructions.
#[inline(always)]
fn each_with_product<const FUSED: bool>(
    a: &[f64; LANES],
    b: &[f64; LANES],
    operation: impl Fn(usize, (f64, f64)) -> (f64, f64),
) -> Lanes {
    let mut result = Lanes::ZERO;
    let mut rare = 0;
    for k in 0..LANES {
        let (product, error) = fast_product::<FUSED>(a[k], b[k], &mut rare);
        (result.high[k], result.low[k]) = operation(k, (product, error));
    }
    if rare != 0 {
        let (products, errors) = rare_products(a, b);
        return each(|k| operation(k, (products[k], errors[k])));
    }
    result
}

/// The rounded product and its error. `rare` is set to 1 if the error is not that of a fused multiply-add; as a whole number, because a compiler
/// joins those of all lanes by vector instructions.
#[inline(always)]
fn fast_product<const FUSED: bool>(a: f64, b: f64, rare: &mut u64) -> (f64, f64) {
    let product = a * b;
    if FUSED {
        return (product, a.mul_add(b, -product));
    }
    let error = split_error(a, b, product);
    *rare |= u64::from(!(is_exact(product, error) | is_zero(a, b, product) & !error.is_nan()));
    (product, error)
}

/// The products of rare numbers, one after the other.
#[cold]
#[inline(never)]
fn rare_products(a: &[f64; LANES], b: &[f64; LANES]) -> ([f64; LANES], [f64; LANES]) {
    let (mut products, mut errors) = ([0.0; LANES], [0.0; LANES]);
    for k in 0..LANES {
        (products[k], errors[k]) = two_prod(a[k], b[k]);
    }
    (products, errors)
}

#[inline(always)]
fn choice(is_first: bool, first: f64, other: f64) -> f64 {
    if is_first { first } else { other }
}

impl Lanes {
    /// Zero in every lane.
    pub(crate) const ZERO: Lanes = Lanes { high: [0.0; LANES], low: [0.0; LANES] };
    /// One in every lane.
    pub(crate) const ONE: Lanes = Lanes { high: [1.0; LANES], low: [0.0; LANES] };

    /// f64 numbers, exactly.
    #[inline(always)]
    pub(crate) fn of(values: [f64; LANES]) -> Self {
        Lanes { high: values, low: [0.0; LANES] }
    }

    /// The same number in every lane.
    #[inline(always)]
    pub(crate) fn splat(value: Dd) -> Self {
        Lanes { high: [value.high; LANES], low: [value.low; LANES] }
    }

    /// The number of a lane.
    pub(crate) fn get(&self, lane: usize) -> Dd {
        Dd { high: self.high[lane], low: self.low[lane] }
    }

    /// Replaces the number of a lane.
    pub(crate) fn set(&mut self, lane: usize, value: Dd) {
        (self.high[lane], self.low[lane]) = (value.high, value.low);
    }

    #[inline(always)]
    pub(crate) fn add(self, other: Self) -> Self {
        each(|k| sum((self.high[k], self.low[k]), (other.high[k], other.low[k])))
    }

    #[inline(always)]
    pub(crate) fn neg(self) -> Self {
        each(|k| (-self.high[k], -self.low[k]))
    }

    #[inline(always)]
    pub(crate) fn sub(self, other: Self) -> Self {
        self.add(other.neg())
    }

    /// Outside of a [`Work`]. Within one, [`Lanes::times`] is faster.
    pub(crate) fn mul(self, other: Self) -> Self {
        self.times::<false>(other)
    }

    #[inline(always)]
    pub(crate) fn times<const FUSED: bool>(self, other: Self) -> Self {
        each_with_product::<FUSED>(&self.high, &other.high, |k, product| {
            product_with((self.high[k], self.low[k]), (other.high[k], other.low[k]), product)
        })
    }

    #[inline(always)]
    pub(crate) fn div(self, other: Self) -> Self {
        // A call of its own: with all its steps in one loop it becomes vector instructions whatever stands around it.
        widest(Quotient(self, other))
    }

    /// The quotient, within a [`Work`].
    #[inline(always)]
    pub(crate) fn over<const FUSED: bool>(self, other: Self) -> Self {
        Quotient(self, other).compute::<FUSED>()
    }

    pub(crate) fn sqrt(self) -> Self {
        self.root::<false>()
    }

    /// The square root, within a [`Work`].
    #[inline(always)]
    pub(crate) fn root<const FUSED: bool>(self) -> Self {
        let mut root = Lanes::ZERO;
        for k in 0..LANES {
            root.high[k] = self.high[k].sqrt();
        }
        let rest = self.sub(root.times::<FUSED>(root));
        each(|k| {
            let (high, low) = fast_two_sum(root.high[k], rest.high[k] / (2.0 * root.high[k]));
            let is_plain = self.high[k] <= 0.0;
            (choice(is_plain, root.high[k], high), choice(is_plain, 0.0, low))
        })
    }

    /// The product with one, which makes a negative zero positive.
    #[inline(always)]
    pub(crate) fn times_one(self) -> Self {
        each(|k| (self.high[k] + 0.0, self.low[k] + 0.0))
    }

    /// In each lane the negative of `value` where this is above zero, otherwise `value`.
    #[inline(always)]
    pub(crate) fn against(self, value: Self) -> Self {
        each(|k| {
            let is_above = self.high[k] > 0.0 || self.high[k] == 0.0 && self.low[k] > 0.0;
            (choice(is_above, -value.high[k], value.high[k]), choice(is_above, -value.low[k], value.low[k]))
        })
    }

    /// In each lane `value`, but 0 where this is 0.
    #[inline(always)]
    pub(crate) fn unless_zero(self, value: Self) -> Self {
        self.choose(Lanes::ZERO, value)
    }

    /// In each lane `zero` where this is 0, otherwise `other`.
    #[inline(always)]
    pub(crate) fn choose(self, zero: Self, other: Self) -> Self {
        each(|k| {
            let is_zero = self.high[k] == 0.0 && self.low[k] == 0.0;
            (choice(is_zero, zero.high[k], other.high[k]), choice(is_zero, zero.low[k], other.low[k]))
        })
    }
}

/// Whether every lane has finite numbers only.
pub(crate) fn are_finite(numbers: &[Lanes]) -> bool {
    widest(AreFinite(numbers))
}

struct AreFinite<'a>(&'a [Lanes]);

impl Work for AreFinite<'_> {
    type Found = bool;

    #[inline(always)]
    fn compute<const FUSED: bool>(self) -> bool {
        let mut rare = [0; LANES];
        for number in self.0 {
            for (k, rare) in rare.iter_mut().enumerate() {
                *rare |= u64::from(exponent(number.high[k]) == INFINITE) | u64::from(exponent(number.low[k]) == INFINITE);
            }
        }
        rare == [0; LANES]
    }
}

/// The steps of `Dd::div` without its branch. No closure, because a large one stays a call.
#[inline(always)]
fn quotient<const FUSED: bool>(a: (f64, f64), b: (f64, f64), rare: &mut u64) -> (f64, f64) {
    let first = a.0 / b.0;
    let rest = minus::<FUSED>(a, b, first, rare);
    let second = rest.0 / b.0;
    let rest = minus::<FUSED>(rest, b, second, rare);
    let third = rest.0 / b.0;
    sum(fast_two_sum(first, second), (third, 0.0))
}

/// a minus b times a digit.
#[inline(always)]
fn minus<const FUSED: bool>(a: (f64, f64), b: (f64, f64), digit: f64, rare: &mut u64) -> (f64, f64) {
    let (high, low) = product_with(b, (digit, 0.0), fast_product::<FUSED>(b.0, digit, rare));
    sum(a, (-high, -low))
}

/// The quotient in every lane.
struct Quotient(Lanes, Lanes);

impl Work for Quotient {
    type Found = Lanes;

    #[inline(always)]
    fn compute<const FUSED: bool>(self) -> Lanes {
        let Quotient(a, b) = self;
        let mut result = Lanes::ZERO;
        let mut rare = 0;
        for k in 0..LANES {
            (result.high[k], result.low[k]) = quotient::<FUSED>((a.high[k], a.low[k]), (b.high[k], b.low[k]), &mut rare);
        }
        if rare != 0 {
            (0..LANES).for_each(|k| result.set(k, a.get(k) / b.get(k)));
            return result;
        }
        // A first digit that is infinite or NaN makes the result NaN, and one that is 0 makes it 0 or NaN.
        let mut rare = 0;
        for k in 0..LANES {
            rare |= u64::from(exponent(result.high[k]).wrapping_sub(1) >= INFINITE - 1);
        }
        if rare != 0 {
            for k in 0..LANES {
                let first = a.high[k] / b.high[k];
                if !first.is_finite() || first == 0.0 {
                    (result.high[k], result.low[k]) = (first, 0.0);
                }
            }
        }
        result
    }
}

/// The sum of at most [`SUMMED`] products, with 14 operations for each in place of 31: the low parts are added as f64.
///
/// Its error is at most (h^2/2 + 5 h + 11) 2^-106 of the sum S of the magnitudes of h products. Each low part is at most 2^-53 (S + 3 |xy|): the
/// error of the sum of high parts and that of the product. So the sum of low parts is at most 2^-53 (h + 3) S, and each of its additions is rounded
/// by 2^-53 of that. What a product leaves out or rounds is at most 8 2^-106 of it. For 128 rows that is below 2 h 2^-100, as if each operation of
/// the product and of the sum had an error of 2^-100 (Ogita, Rump, Oishi, "Accurate sum and dot product" (2005), algorithm 5.3, for numbers of two
/// parts).
#[derive(Clone, Copy)]
pub(crate) struct Sum(Lanes);

/// The most products of a [`Sum`].
pub(crate) const SUMMED: usize = 128;

impl Sum {
    pub(crate) const ZERO: Sum = Sum(Lanes::ZERO);

    /// Adds a product.
    #[inline(always)]
    pub(crate) fn add_product<const FUSED: bool>(&mut self, x: Lanes, y: Lanes) {
        let before = self.0;
        self.0 = each_with_product::<FUSED>(&x.high, &y.high, |k, (product, error)| {
            let error = error + (x.high[k] * y.low[k] + x.low[k] * y.high[k]);
            let (sum, rest) = two_sum(before.high[k], product);
            (sum, before.low[k] + (rest + error))
        });
    }

    #[inline(always)]
    pub(crate) fn total(self) -> Lanes {
        each(|k| fast_two_sum(self.0.high[k], self.0.low[k]))
    }
}

/// x minus the product of a factor and v, with 17 operations for each lane in place of 31. The error is at most 2^-102 of the sum of the magnitudes
/// of both: where they cancel, that is more than of the difference.
#[inline(always)]
pub(crate) fn without<const FUSED: bool>(x: Lanes, factor: Lanes, v: Lanes) -> Lanes {
    each_with_product::<FUSED>(&factor.high, &v.high, |k, (product, error)| {
        let error = error + (factor.high[k] * v.low[k] + factor.low[k] * v.high[k]);
        let (difference, rest) = two_sum(x.high[k], -product);
        fast_two_sum(difference, (x.low[k] - error) + rest)
    })
}

/// The sum of the products of terms and coefficients.
pub(crate) fn value(terms: &[Lanes], coefficients: &[Lanes]) -> Lanes {
    widest(Value(terms, coefficients))
}

struct Value<'a>(&'a [Lanes], &'a [Lanes]);

impl Work for Value<'_> {
    type Found = Lanes;

    #[inline(always)]
    fn compute<const FUSED: bool>(self) -> Lanes {
        let mut sum = Lanes::ZERO;
        for (x, y) in self.0.iter().zip(self.1) {
            sum = sum.add(x.times::<FUSED>(*y));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn same(found: Lanes, expected: impl Fn(usize) -> Dd, what: &str) {
        for lane in 0..LANES {
            let bits = |value: Dd| value.parts().map(|part| if part.is_nan() { f64::NAN.to_bits() } else { part.to_bits() });
            assert_eq!(bits(found.get(lane)), bits(expected(lane)), "{what}: {:?} {:?}", found.get(lane), expected(lane));
        }
    }

    #[test]
    fn every_lane_has_the_bits_of_one_number() {
        let special = [0.0, -0.0, 1.0, -1.0, 1e300, -1e-300, 5e-324, f64::MAX, f64::INFINITY, f64::NAN];
        let mut random = Random::new(11);
        let mut number = || {
            let large = (random.normal()) * 10f64.powi(random.below(60) as i32 - 30);
            match random.below(8) {
                0 => Dd::from(special[random.below(special.len() as u64) as usize]),
                1 => Dd::from(large),
                _ => Dd::sum_of(large, large * 1e-17 * random.normal()),
            }
        };
        for _ in 0..2000 {
            let mut numbers = || std::array::from_fn::<Dd, LANES, _>(|_| number());
            let (a, b) = (numbers(), numbers());
            let lanes = |numbers: [Dd; LANES]| {
                let mut lanes = Lanes::ONE;
                (0..LANES).for_each(|k| lanes.set(k, numbers[k]));
                lanes
            };
            let (x, y) = (lanes(a), lanes(b));
            same(x.add(y), |k| a[k] + b[k], "add");
            same(x.sub(y), |k| a[k] - b[k], "sub");
            same(x.mul(y), |k| a[k] * b[k], "mul");
            same(x.div(y), |k| a[k] / b[k], "div");
            // Without the widest instructions of this machine, and with the function for a fused multiply-add.
            same(Quotient(x, y).compute::<false>(), |k| a[k] / b[k], "div");
            same(Quotient(x, y).compute::<true>(), |k| a[k] / b[k], "div");
            same(x.times::<true>(y), |k| a[k] * b[k], "mul");
            same(value(&[x, y], &[y, y]), |k| Dd::ZERO + a[k] * b[k] + b[k] * b[k], "value");
            same(x.sqrt(), |k| a[k].sqrt(), "sqrt");
            same(x.neg(), |k| -a[k], "neg");
            same(x.against(y), |k| if a[k] > Dd::ZERO { -b[k] } else { b[k] }, "against");
            same(x.choose(x, y), |k| if a[k] == Dd::ZERO { a[k] } else { b[k] }, "choose");
            same(x.unless_zero(y), |k| if a[k] == Dd::ZERO { Dd::ZERO } else { b[k] }, "unless_zero");
            assert_eq!(are_finite(&[y, x]), a.iter().chain(&b).all(|it| it.is_finite()));
        }
    }
}
