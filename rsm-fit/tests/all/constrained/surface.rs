//! Values and derivatives of a surface, written a second time: it shares no code with the fitter, its proofs or the compiler.
//!
//! In: axes, functions of one axis each, powers. Out: for every term its value or a derivative at a point. Derivatives are with respect to the
//! natural input times half of its range, so that they have the unit of the response.

/// A value with its first and second derivative.
#[derive(Debug, Clone, Copy)]
struct Jet([f64; 3]);

impl Jet {
    fn times(self, other: Jet) -> Jet {
        let ([a, a1, a2], [b, b1, b2]) = (self.0, other.0);
        Jet([a * b, a1 * b + a * b1, a2 * b + 2.0 * a1 * b1 + a * b2])
    }
}

/// How an input enters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Entry {
    /// By itself.
    Plain,
    /// By its magnitude; the response is even in it.
    Even,
    /// By its magnitude; the response changes its sign with it.
    Odd,
    /// By its reciprocal.
    Reciprocal,
}

/// An input.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    pub range: [f64; 2],
    pub entry: Entry,
    /// Whether the variable runs from -1 to 1 over the range.
    pub is_coded: bool,
}

/// A function of one axis.
#[derive(Debug, Clone, Copy)]
pub enum Function {
    /// The variable of the input.
    Variable,
    /// The variable minus its value at a knot, where that is positive.
    Hinge(f64),
    /// s (1 + |s|)/(1 + |s| + s^2) with s = (x - at)/width.
    Sigmoid(f64, f64),
    /// The cosine of so many turns over a period, 0 at the middle of the range.
    Cosine(f64, u32),
    /// The sine.
    Sine(f64, u32),
}

impl Axis {
    /// The part of the range that represents all of it.
    pub fn side(&self) -> [f64; 2] {
        match self.entry {
            Entry::Even | Entry::Odd => [0.0, self.range[1]],
            _ => self.range,
        }
    }

    fn middle(&self) -> f64 {
        self.range[0] / 2.0 + self.range[1] / 2.0
    }

    fn half(&self) -> f64 {
        let [low, high] = self.side();
        (high - low) / 2.0
    }

    /// The variable at x.
    fn variable(&self, x: f64) -> Jet {
        let [low, high] = self.range;
        let jet = match (self.entry, self.is_coded) {
            (Entry::Plain, false) => [x, 1.0, 0.0],
            (Entry::Plain, true) => [(x - self.middle()) / ((high - low) / 2.0), 2.0 / (high - low), 0.0],
            (Entry::Even | Entry::Odd, false) => [x.abs(), 1.0, 0.0],
            (Entry::Even | Entry::Odd, true) => [x.abs() / high, 1.0 / high, 0.0],
            (Entry::Reciprocal, false) => [1.0 / x, -1.0 / (x * x), 2.0 / (x * x * x)],
            (Entry::Reciprocal, true) => {
                let [middle, half] = [(1.0 / low + 1.0 / high) / 2.0, (1.0 / low - 1.0 / high) / 2.0];
                [(1.0 / x - middle) / half, -1.0 / (x * x) / half, 2.0 / (x * x * x) / half]
            }
        };
        Jet(jet)
    }

    /// A function at x. `is_above`: at its knot, a hinge has the slope above it.
    fn function(&self, function: Function, x: f64, is_above: bool) -> Jet {
        match function {
            Function::Variable => self.variable(x),
            Function::Hinge(at) => {
                let (mut jet, knot) = (self.variable(x), self.variable(at));
                jet.0[0] -= knot.0[0];
                // The magnitude and the reciprocal are no variables of a knot here.
                if x > at || (x == at && is_above) { jet } else { Jet([0.0; 3]) }
            }
            Function::Sigmoid(at, width) => {
                let s = (x - at) / width;
                let (z, sign) = (s.abs(), s.signum());
                let p = z + z * z;
                let (slope, rise) = (1.0 + 2.0 * z, 1.0 + p);
                let second = (2.0 * rise - 2.0 * slope * slope) / rise.powi(3);
                Jet([sign * p / rise, slope / (rise * rise) / width, sign * second / (width * width)])
            }
            Function::Cosine(period, order) => {
                let w = std::f64::consts::TAU * f64::from(order) / period;
                let (sine, cosine) = (w * (x - self.middle())).sin_cos();
                Jet([cosine, -w * sine, -w * w * cosine])
            }
            Function::Sine(period, order) => {
                let w = std::f64::consts::TAU * f64::from(order) / period;
                let (sine, cosine) = (w * (x - self.middle())).sin_cos();
                Jet([sine, w * cosine, -w * w * sine])
            }
        }
    }
}

/// The terms of a surface without their coefficients.
pub struct Basis {
    pub axes: Vec<Axis>,
    /// The functions in the order of a term's powers, each with its axis.
    pub functions: Vec<(usize, Function)>,
    pub terms: Vec<Vec<u32>>,
}

impl Basis {
    /// Every term at a point in natural units, differentiated once for each entry of `axes`.
    pub fn row(&self, x: &[f64], by: &[usize], is_above: bool) -> Vec<f64> {
        let jets: Vec<Jet> =
            self.functions.iter().map(|(axis, function)| self.axes[*axis].function(*function, x[*axis], is_above)).collect();
        let order = |axis: usize| by.iter().filter(|k| **k == axis).count();
        let scale: f64 = by.iter().map(|axis| self.axes[*axis].half()).product();
        let of_term = |powers: &Vec<u32>| {
            let mut along = vec![Jet([1.0, 0.0, 0.0]); self.axes.len()];
            for ((jet, (axis, _)), power) in jets.iter().zip(&self.functions).zip(powers) {
                for _ in 0..*power {
                    along[*axis] = along[*axis].times(*jet);
                }
            }
            scale * along.iter().enumerate().map(|(axis, jet)| jet.0[order(axis)]).product::<f64>()
        };
        self.terms.iter().map(of_term).collect()
    }

    /// The sign of the response at a point.
    pub fn sign(&self, x: &[f64]) -> f64 {
        let negative = self.axes.iter().zip(x).filter(|(axis, x)| axis.entry == Entry::Odd && **x < 0.0).count();
        if negative % 2 == 1 { -1.0 } else { 1.0 }
    }

    /// The variables at a point.
    pub fn variables(&self, x: &[f64]) -> Vec<f64> {
        self.axes.iter().zip(x).map(|(axis, x)| axis.variable(*x).0[0]).collect()
    }

    /// The point at these shares of the sides.
    pub fn point(&self, shares: &[f64]) -> Vec<f64> {
        let at = |(axis, share): (&Axis, &f64)| {
            let [low, high] = axis.side();
            if *share == 1.0 { high } else { low + share * (high - low) }
        };
        self.axes.iter().zip(shares).map(at).collect()
    }
}
