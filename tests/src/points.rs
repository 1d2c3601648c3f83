//! Points at which evaluators are compared.
//!
//! In: the inputs and knots of a surface, or those that a compensator uses. Out: points that hurt (corners, bounds and knots with both neighbours,
//! both zeros, subnormals, the largest numbers, outside, infinities, NaN) and any number of random ones from a fixed seed. Rows of arguments, one
//! after another.

use rsm_core::emit::Function;
use rsm_core::model::{Input, Knot, Surface};
use rsm_core::number::Precision;
use rsm_core::run::Scalar;

/// A scalar type in which evaluators are compared.
pub trait Number: Scalar + Send + Sync + std::fmt::Debug + 'static {
    /// The number nearest to an f64.
    fn nearest(value: f64) -> Self;
    /// As f64, exactly.
    fn wide(self) -> f64;
    /// The next number above.
    fn above(self) -> Self;
    /// The next number below.
    fn below(self) -> Self;
    /// The smallest subnormal, the smallest normal number and the largest number.
    const EXTREMES: [Self; 3];
}

macro_rules! number {
    ($float:ty) => {
        impl Number for $float {
            fn nearest(value: f64) -> Self {
                value as $float
            }
            fn wide(self) -> f64 {
                f64::from(self)
            }
            fn above(self) -> Self {
                self.next_up()
            }
            fn below(self) -> Self {
                self.next_down()
            }
            const EXTREMES: [Self; 3] = [<$float>::from_bits(1), <$float>::MIN_POSITIVE, <$float>::MAX];
        }
    };
}
number!(f64);
number!(f32);

/// Up to this many inputs, every combination of the values that hurt is a point.
const ALL_COMBINATIONS: usize = 2;

/// With more inputs: how many random combinations of them are taken.
const SOME_COMBINATIONS: usize = 400;

/// Makes the points of one evaluator.
#[derive(Debug)]
pub struct Points<T> {
    ranges: Vec<[T; 2]>,
    hurtful: Vec<Vec<T>>,
    random: Random,
}

impl<T: Number> Points<T> {
    /// The points of a function of a surface.
    ///
    /// # Panics
    /// When the function was lowered for another precision.
    #[must_use]
    pub fn new(function: &Function, surface: &Surface) -> Self {
        Self::with_knots(function, &surface.knots)
    }

    /// The points of a function whose surfaces have these knots.
    ///
    /// # Panics
    /// When the function was lowered for another precision.
    #[must_use]
    pub fn with_knots(function: &Function, knots: &[Knot]) -> Self {
        assert_eq!(function.tape.precision, T::PRECISION);
        let hurtful = function.inputs.iter().map(|input| hurtful_values(input, knots)).collect();
        let ranges = function.inputs.iter().map(|input| input.range.map(T::nearest)).collect();
        // A seed of its own for every function, the same in every run.
        let seed =
            function.rust_name().bytes().fold(0x5eed_u64, |seed, byte| seed.wrapping_mul(31).wrapping_add(u64::from(byte)));
        Points { ranges, hurtful, random: Random(seed) }
    }

    /// The points that hurt.
    pub fn hurtful(&mut self) -> Vec<T> {
        let arity = self.ranges.len();
        let mut rows = Vec::new();
        if arity <= ALL_COMBINATIONS {
            let count: usize = self.hurtful.iter().map(Vec::len).product();
            for mut index in 0..count {
                for values in &self.hurtful {
                    rows.push(values[index % values.len()]);
                    index /= values.len();
                }
            }
            return rows;
        }
        for corner in 0..1usize << arity {
            rows.extend(self.ranges.iter().enumerate().map(|(k, range)| range[corner >> k & 1]));
        }
        // Each value once, with the other inputs inside their ranges.
        for k in 0..arity {
            for v in 0..self.hurtful[k].len() {
                let start = rows.len();
                self.push_inside(&mut rows);
                rows[start + k] = self.hurtful[k][v];
            }
        }
        for _ in 0..SOME_COMBINATIONS {
            for values in &self.hurtful {
                rows.push(values[self.random.below(values.len())]);
            }
        }
        rows
    }

    /// Random points: most of them inside, some near and outside the bounds, some with one value that hurts.
    pub fn random(&mut self, count: usize) -> Vec<T> {
        let mut rows = Vec::with_capacity(count * self.ranges.len());
        for _ in 0..count {
            let start = rows.len();
            match self.random.below(8) {
                0 => {
                    let shares: Vec<f64> = self.ranges.iter().map(|_| self.random.share() * 3.0 - 1.0).collect();
                    rows.extend(self.ranges.iter().zip(shares).map(|(range, share)| between(*range, share)));
                }
                1 => {
                    self.push_inside(&mut rows);
                    let k = self.random.below(self.ranges.len());
                    rows[start + k] = self.hurtful[k][self.random.below(self.hurtful[k].len())];
                }
                _ => self.push_inside(&mut rows),
            }
        }
        rows
    }

    /// A sequence for a step. The signal, which is the first argument, is random at one of several magnitudes, subnormal ones included; the
    /// others are held for a while and then jump, as a gear does. One sample in twenty has a value that hurts, NaN and infinities among
    /// them, and one in a thousand a signal so large that states overflow.
    pub fn sequence(&mut self, count: usize) -> Vec<T> {
        let [_, smallest_normal, largest] = T::EXTREMES;
        let magnitude = [1.0, 1.0, 1e-30, smallest_normal.wide(), 1e30][self.random.below(5)];
        let mut rows: Vec<T> = Vec::with_capacity(count * self.ranges.len());
        let mut held = vec![];
        for _ in 0..count {
            if held.is_empty() || self.random.below(40) == 0 {
                held.clear();
                self.push_inside(&mut held);
            }
            let start = rows.len();
            rows.push(T::nearest(magnitude * (2.0 * self.random.share() - 1.0)));
            rows.extend(&held[1..]);
            if self.random.below(20) == 0 {
                let k = self.random.below(self.ranges.len());
                let value = self.hurtful[k][self.random.below(self.hurtful[k].len())];
                // A huge signal would hide all smaller ones that follow.
                if k > 0 || value.wide().is_nan() || value.wide().abs() <= magnitude || value.wide().is_infinite() {
                    rows[start + k] = value;
                }
            }
            if self.random.below(1000) == 0 {
                rows[start] = largest;
            }
        }
        rows
    }

    fn push_inside(&mut self, rows: &mut Vec<T>) {
        for range in &self.ranges {
            rows.push(between(*range, self.random.share()));
        }
    }
}

fn between<T: Number>([low, high]: [T; 2], share: f64) -> T {
    // In f64, so that a wide range does not overflow and f32 uses all of its bits.
    T::nearest(low.wide() * (1.0 - share) + high.wide() * share)
}

fn hurtful_values<T: Number>(input: &Input, knots: &[Knot]) -> Vec<T> {
    let [low, high] = input.range;
    let width = high - low;
    let at_knots = knots.iter().filter(|knot| knot.input == input.name).map(|knot| knot.at);
    let places = [low, high].into_iter().chain(at_knots).map(T::nearest);
    let mut values: Vec<T> = places.flat_map(|place| [place.below(), place, place.above()]).collect();
    // The bounds as lowering rounds them into the range.
    if T::PRECISION == Precision::F32 {
        values.extend(values.clone().into_iter().flat_map(|value| [value.below(), value.above()]));
    }
    values.extend([low - width, high + 0.3 * width, (low + high) / 2.0, 1.0, -1.0].map(T::nearest));
    values.extend([0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN].map(T::nearest));
    values.extend(T::EXTREMES.into_iter().flat_map(|extreme| [extreme, -extreme]));
    values.extend([-high, -low].map(T::nearest));
    values.sort_by_key(|value| value.bits());
    values.dedup_by_key(|value| value.bits());
    values
}

/// Splitmix64 (Steele, Lea, Flood 2014), from a seed.
#[derive(Debug)]
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.bits() % limit as u64) as usize
    }

    /// In [0, 1).
    pub fn share(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }
}
