//! Elementary functions as sequences of operations of a tape: no call, no branch, the same bits on every machine.
//!
//! In: a builder and the registers of the arguments. Out: the register of the result. Its error, in units in the last place over the stated range, is
//! in the table below and in [`Function::error_in_units`], and `proof/` proves it. A NaN argument gives NaN. Range reduction and polynomials use only
//! operations of the tape; two of them, `Exponent` and `PowerOfTwo`, exist for this purpose. Only f64 tapes can hold these functions: f32 would need
//! separate reductions and proofs.
//!
//! | function | error, proved | range | beyond |
//! |---|---|---|---|
//! | `sqrt` | 0.501 | 0 to the largest number, infinity | NaN below 0 |
//! | `exp` | 0.84 | all numbers; from 709.78 on infinity, below -745.13 zero | |
//! | `log`, `log10` | 1.03, 0.93 | above 0, subnormal numbers too; -infinity at 0 | NaN below 0 |
//! | `sin`, `cos`, `tan` | 0.85, 0.85, 1.2 | magnitudes up to 800,000 | NaN |
//! | `asin`, `acos` | 1.19, 1.02 | -1 to 1 | NaN |
//! | `atan` | 1 | all numbers, infinities too | |
//! | `atan2` | 0.76 | all finite pairs; 0 at (0, 0) | NaN where both are infinite |
//! | `sinh`, `cosh` | 0.97 | all numbers; infinity from 710.48 on | |
//! | `tanh` | 1.44 | all numbers | |
//! | `floor` | 0 | all numbers | |
//!
//! Odd functions do not keep the sign of a zero: `atan(-0.0)` is +0.0. The error of `sqrt` may exceed half a unit, so it is not the IEEE square root.
//!
//! The tape records which operations belong to a function ([`Computed`]). The bound of rounding errors and the tangent treat the function as a whole.

mod circular;
// The file is written by a program, and the parts of pi need all their digits.
#[allow(clippy::approx_constant)]
#[rustfmt::skip]
mod coefficients;
#[cfg(test)]
mod derive;
mod direct;
mod exponential;
mod inverse;
mod logarithm;
mod pair;
#[cfg(test)]
mod proof;
pub(crate) mod range;
mod whole;

use crate::number::{Precision, Rational, exact};
use crate::tape::{Reg, TapeBuilder};

pub use crate::function::Function;
pub use crate::tape::Computed;
pub use direct::sin_cos;
pub use whole::{maximum, minimum, modulo, power, sign};

impl Function {
    /// The largest error of a result over the [`range`](Self::range), in units in the last place of the true value. It is proved: a test bounds every
    /// rounding, cell by cell over all arguments. The measured error at 10^7 points is below 1 for every function.
    ///
    /// ```
    /// use rsm_core::elementary::Function;
    ///
    /// assert!(Function::Atan.error_in_units() <= 1.0 && Function::Tan.error_in_units() <= 1.2); // rad, of angles up to 800,000 rad
    /// ```
    #[must_use]
    pub fn error_in_units(self) -> f64 {
        match self {
            Function::Sqrt => 0.501,
            Function::Exp => 0.84,
            Function::Log => 1.03,
            Function::Log10 => 0.93,
            Function::Sin | Function::Cos => 0.85,
            Function::Tan => 1.2,
            Function::Asin => 1.19,
            Function::Acos => 1.02,
            Function::Atan => 1.0,
            Function::Atan2 => 0.76,
            Function::Sinh | Function::Cosh => 0.97,
            Function::Tanh => 1.44,
            Function::Floor => 0.0,
        }
    }

    /// The range of arguments for which the stated error holds and the result is finite; for `Atan2` the same for both arguments.
    #[must_use]
    pub fn range(self) -> [f64; 2] {
        match self {
            Function::Sqrt => [0.0, f64::MAX],
            Function::Exp => [f64::MIN, 709.782_712_893_383_9],
            Function::Log | Function::Log10 => [5e-324, f64::MAX],
            Function::Sin | Function::Cos | Function::Tan => [-circular::LIMIT, circular::LIMIT],
            Function::Asin | Function::Acos => [-1.0, 1.0],
            Function::Sinh | Function::Cosh => [-710.475_860_073_943_8, 710.475_860_073_943_8],
            Function::Atan | Function::Atan2 | Function::Tanh | Function::Floor => [f64::MIN, f64::MAX],
        }
    }
}

/// Whether tapes of a precision can contain elementary functions: only f64 tapes can.
#[must_use]
pub fn holds(precision: Precision) -> bool {
    precision == Precision::F64
}

/// 1/log 10, to 80 bits.
pub(crate) fn inverse_log_of_ten() -> Rational {
    coefficients::INVERSE_LOG_OF_TEN.into_iter().map(exact).sum()
}

/// Appends the operations of a function, and returns the register of its result.
///
/// # Panics
/// If the tape is not in f64 (see [`holds`]), or if the number of arguments is not that of the function.
///
/// ```
/// use rsm_core::elementary::{self, Function};
/// use rsm_core::number::Precision;
/// use rsm_core::run::Interpreter;
/// use rsm_core::tape::TapeBuilder;
///
/// let mut tape = TapeBuilder::sharing(Precision::F64);
/// let angle = tape.input(0);
/// let sine = elementary::write(&mut tape, Function::Sin, &[angle]);
/// let tape = tape.finish("sine", vec!["angle".to_string()], sine);
/// assert_eq!(Interpreter::<f64>::new(&tape).eval(&[0.5]), 0.479425538604203);
/// ```
pub fn write(tape: &mut TapeBuilder, function: Function, arguments: &[Reg]) -> Reg {
    assert!(holds(tape.precision()), "elementary functions need a tape in f64");
    assert_eq!(arguments.len(), function.arity(), "{} has another number of arguments", function.name());
    let x = arguments[0];
    let result = match function {
        Function::Sqrt => logarithm::sqrt(tape, x),
        Function::Exp => exponential::exp(tape, x),
        Function::Log => logarithm::log(tape, x),
        Function::Log10 => logarithm::log10(tape, x),
        Function::Sin => circular::sin(tape, x),
        Function::Cos => circular::cos(tape, x),
        Function::Tan => circular::tan(tape, x),
        Function::Asin => inverse::asin(tape, x),
        Function::Acos => inverse::acos(tape, x),
        Function::Atan => inverse::atan(tape, x),
        Function::Atan2 => inverse::atan2(tape, x, arguments[1]),
        Function::Sinh => exponential::sinh(tape, x),
        Function::Cosh => exponential::cosh(tape, x),
        Function::Tanh => exponential::tanh(tape, x),
        Function::Floor => whole::floor(tape, x),
    };
    tape.mark(Computed { function, arguments: arguments.to_vec(), result });
    result
}

#[cfg(test)]
mod tests;
