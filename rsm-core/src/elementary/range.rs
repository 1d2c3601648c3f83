//! Ranges and slopes of the elementary functions over intervals, for the bounds of rounding errors.
//!
//! In: a function and intervals of its arguments. Out: an enclosure of the true function, and bounds of its partial derivatives. The ends are
//! computed by the function's own operations, whose error is proved, and moved outward by more than that.

use std::f64::consts::PI;
use std::sync::OnceLock;

use super::Function;
use crate::interval::Interval;
use crate::number::Precision;
use crate::run::Interpreter;
use crate::tape::{Tape, TapeBuilder};

/// No information.
const ANYTHING: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };

/// The value of the function's own operations at a point.
pub(crate) fn value(function: Function, arguments: &[f64]) -> f64 {
    static TAPES: OnceLock<Vec<Tape>> = OnceLock::new();
    let tapes = TAPES.get_or_init(|| Function::ALL.into_iter().map(alone).collect());
    let place = Function::ALL.iter().position(|other| *other == function).expect("all are listed");
    Interpreter::<f64>::new(&tapes[place]).eval(arguments)
}

/// A tape with only this function.
pub(super) fn alone(function: Function) -> Tape {
    let mut tape = TapeBuilder::sharing(Precision::F64);
    let names = ["x", "y"][..function.arity()].iter().map(|name| (*name).to_string()).collect();
    let arguments: Vec<_> = (0..function.arity() as u32).map(|port| tape.input(port)).collect();
    let result = super::write(&mut tape, function, &arguments);
    tape.finish(function.name(), names, result)
}

/// Moved outward by two numbers, because the error is below one and a half units in the last place.
fn outward(low: f64, high: f64) -> Interval {
    if low.is_nan() || high.is_nan() {
        return ANYTHING;
    }
    Interval { low: low.next_down().next_down(), high: high.next_up().next_up() }
}

/// Every value of the true function for arguments in the intervals; unbounded if an argument is outside the function's range.
pub(crate) fn over(function: Function, arguments: &[Interval]) -> Interval {
    let [low, high] = function.range();
    // A NaN fails every comparison.
    if !arguments.iter().all(|x| x.low >= low && x.high <= high) {
        return ANYTHING;
    }
    let x = arguments[0];
    let at = |x: f64| value(function, &[x]);
    match function {
        Function::Floor => Interval { low: x.low.floor(), high: x.high.floor() },
        Function::Sqrt
        | Function::Exp
        | Function::Log
        | Function::Log10
        | Function::Asin
        | Function::Atan
        | Function::Sinh
        | Function::Tanh => {
            let found = outward(at(x.low), at(x.high));
            if function == Function::Sqrt || function == Function::Exp {
                return Interval { low: found.low.max(0.0), high: found.high };
            }
            found
        }
        Function::Acos => outward(at(x.high), at(x.low)),
        Function::Cosh => {
            let nearest = if x.low <= 0.0 && x.high >= 0.0 { 0.0 } else { x.low.abs().min(x.high.abs()) };
            outward(at(nearest), at(x.magnitude()))
        }
        // Their slope is at most 1.
        Function::Sin | Function::Cos => {
            let middle = x.low / 2.0 + x.high / 2.0;
            let reach = (x.high - middle).max(middle - x.low).next_up();
            let found = outward(at(middle) - reach, at(middle) + reach);
            Interval { low: found.low.max(-1.0), high: found.high.min(1.0) }
        }
        Function::Tan => {
            // There is a pole between two arguments if the number of half turns differs. Near a pole the result is unbounded.
            let turns = |x: f64| ((x / PI + 0.5) - 1e-9).floor();
            let (low, high) = (turns(x.low), turns(x.high));
            let near = |x: f64| (x / PI + 0.5 - (x / PI + 0.5).round()).abs() < 1e-8;
            if low == high && !near(x.low) && !near(x.high) { outward(at(x.low), at(x.high)) } else { ANYTHING }
        }
        Function::Atan2 => {
            let (y, x) = (arguments[0], arguments[1]);
            // Away from the cut and the origin the angle is monotone along each side, so its extremes are at corners.
            if x.low > 0.0 || y.low > 0.0 || y.high < 0.0 {
                let corners = [(y.low, x.low), (y.low, x.high), (y.high, x.low), (y.high, x.high)];
                let angles = corners.map(|(y, x)| value(function, &[y, x]));
                if angles.iter().any(|angle| angle.is_nan()) {
                    return ANYTHING;
                }
                let low = angles.into_iter().fold(f64::INFINITY, f64::min);
                outward(low, angles.into_iter().fold(f64::NEG_INFINITY, f64::max))
            } else {
                outward(-PI, PI)
            }
        }
    }
}

/// Bounds of the magnitudes of the partial derivatives over the intervals; infinite if there is none.
pub(crate) fn slopes(function: Function, arguments: &[Interval]) -> Vec<f64> {
    let x = arguments[0];
    let nearest = if x.low <= 0.0 && x.high >= 0.0 { 0.0 } else { x.low.abs().min(x.high.abs()) };
    let values = over(function, arguments);
    // Each formula has a few roundings: a share of 2^-48 covers them.
    let up = |slope: f64| if slope.is_nan() || slope < 0.0 { f64::INFINITY } else { slope * (1.0 + 2f64.powi(-48)) };
    let slope = match function {
        Function::Sqrt => 0.5 / values.low,
        Function::Exp => values.high,
        Function::Log => 1.0 / x.low,
        Function::Log10 => std::f64::consts::LOG10_E / x.low,
        Function::Sin | Function::Cos => 1.0,
        Function::Tan => 1.0 + values.magnitude() * values.magnitude(),
        Function::Asin | Function::Acos => {
            let root = value(Function::Sqrt, &[(1.0 - x.magnitude()) * (1.0 + x.magnitude())]);
            1.0 / root
        }
        Function::Atan => 1.0 / (1.0 + nearest * nearest),
        Function::Sinh | Function::Cosh => over(Function::Cosh, arguments).high,
        Function::Tanh => 1.0,
        // A step inside, or at an end that an error may cross, so no slope bounds it.
        Function::Floor if values.low == values.high => 0.0,
        Function::Floor => f64::INFINITY,
        Function::Atan2 => {
            let (y, x) = (arguments[0], arguments[1]);
            if !(x.low > 0.0 || y.low > 0.0 || y.high < 0.0) {
                return vec![f64::INFINITY; 2];
            }
            let least = |x: Interval| if x.low <= 0.0 && x.high >= 0.0 { 0.0 } else { x.low.abs().min(x.high.abs()) };
            let square = least(x) * least(x) + least(y) * least(y);
            return vec![up(x.magnitude() / square), up(y.magnitude() / square)];
        }
    };
    vec![up(slope)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// splitmix64 shares in [0, 1).
    fn share(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53)
    }

    #[test]
    fn values_lie_in_the_range_and_differences_below_the_slope() {
        let mut state = 5;
        for function in Function::ALL {
            let [low, high] = function.range().map(|end: f64| end.clamp(-6.0, 6.0));
            let mut bounded = 0;
            for _ in 0..400 {
                let mut side = || {
                    let (a, width) = (low + (high - low) * share(&mut state), share(&mut state));
                    Interval { low: a, high: (a + width * width).min(high) }
                };
                let cell: Vec<Interval> = (0..function.arity()).map(|_| side()).collect();
                let (range, slopes) = (over(function, &cell), slopes(function, &cell));
                bounded += usize::from(range != ANYTHING && slopes.iter().all(|slope| slope.is_finite()));
                let mut point = || -> Vec<f64> {
                    cell.iter().map(|x| x.low + (x.high - x.low) * (1.2 * share(&mut state) - 0.1).clamp(0.0, 1.0)).collect()
                };
                for _ in 0..20 {
                    let (a, b) = (point(), point());
                    let [of_a, of_b] = [&a, &b].map(|point| value(function, point));
                    assert!(range.low <= of_a && of_a <= range.high, "{function:?} {cell:?} {a:?}");
                    let most: f64 = slopes.iter().zip(a.iter().zip(&b)).map(|(slope, (a, b))| slope * (a - b).abs()).sum();
                    // Each of the two results has an error of up to one unit.
                    let rounding = 4.0 * f64::EPSILON * of_a.abs().max(of_b.abs());
                    assert!((of_a - of_b).abs() <= most + rounding || most.is_nan(), "{function:?} {cell:?} {a:?} {b:?}");
                }
            }
            // A cell may contain a pole, a cut or a step, but most cells do not.
            assert!(bounded > 150, "{function:?}: {bounded}");
        }
    }

    #[test]
    fn a_range_is_hardly_wider_than_the_values() {
        for function in Function::ALL {
            let cell = vec![Interval { low: 0.25, high: 0.5 }; function.arity()];
            let range = over(function, &cell);
            let ends: Vec<f64> = match function {
                Function::Atan2 => vec![value(function, &[0.25, 0.5]), value(function, &[0.5, 0.25])],
                _ => vec![value(function, &[0.25]), value(function, &[0.5])],
            };
            let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            // sin and cos are enclosed by their slope of at most 1, over a width of 1/4.
            let margin = if matches!(function, Function::Sin | Function::Cos) { 0.21 } else { 1e-15 };
            assert!(range.low >= low - margin && range.high <= high + margin, "{function:?} {range:?} {ends:?}");
        }
    }

    #[test]
    fn nothing_is_said_outside_of_the_range_of_a_function_or_across_a_pole() {
        let of = |function, low, high| over(function, &[Interval { low, high }]);
        assert_eq!(of(Function::Log, -1.0, 1.0), ANYTHING);
        assert_eq!(of(Function::Asin, 0.5, 1.5), ANYTHING);
        assert_eq!(of(Function::Sin, 0.0, 1e6), ANYTHING);
        assert_eq!(of(Function::Tan, 1.0, 2.0), ANYTHING);
        assert_eq!(of(Function::Tan, -0.1, 4.0), ANYTHING);
        assert_eq!(slopes(Function::Floor, &[Interval { low: 0.5, high: 1.5 }]), [f64::INFINITY]);
        assert_eq!(slopes(Function::Floor, &[Interval { low: 0.5, high: 0.75 }]), [0.0]);
        // The whole circle around the origin: the angle is bounded, its slope is not.
        let around = [Interval { low: -1.0, high: 1.0 }; 2];
        let range = over(Function::Atan2, &around);
        assert!(range.low < -PI && range.low > -PI - 2e-15 && range.high > PI && range.high < PI + 2e-15);
        assert_eq!(slopes(Function::Atan2, &around), [f64::INFINITY; 2]);
    }
}
