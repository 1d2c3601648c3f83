//! Two results, equal or not, and what to say when they are not.
//!
//! In: the interpreter's results and another evaluator's. Out: nothing, or a text with the input, both values in decimal and in bits, their
//! distance in ulp and the tape. Any NaN equals any other: the standard leaves its payload open.

use std::fmt::Write as _;

use rsm_core::emit::Function;

use crate::points::Number;

/// How many differing points of one function are worth reading.
const SHOWN: usize = 3;

/// Whether two results are the same.
#[must_use]
pub fn same<T: Number>(a: T, b: T) -> bool {
    a.bits() == b.bits() || (a.wide().is_nan() && b.wide().is_nan())
}

/// The first points at which an evaluator differs from the interpreter, with the tape. `None` when it does not.
#[must_use]
pub fn differences<T: Number>(
    model: &str,
    function: &Function,
    who: &str,
    points: &[T],
    expected: &[T],
    found: &[T],
) -> Option<String> {
    let arity = function.inputs.len();
    let wrong: Vec<usize> = (0..expected.len()).filter(|k| !same(expected[*k], found[*k])).collect();
    if wrong.is_empty() {
        return None;
    }
    let name = function.rust_name();
    let mut text =
        format!("{model}::{name}: {who} differs from the interpreter at {} of {} points\n", wrong.len(), expected.len());
    for k in wrong.iter().take(SHOWN) {
        text.push_str("  at");
        for (input, xi) in function.inputs.iter().zip(&points[k * arity..]) {
            write!(text, " {} = {}", input.name, shown(*xi)).expect("text");
        }
        let (expected, found) = (expected[*k], found[*k]);
        let distance = match ulp_distance(expected, found) {
            Some(ulp) => format!("{ulp} ulp apart"),
            None => "one of them NaN".to_string(),
        };
        writeln!(text, "\n    interpreter {}\n    {who} {}\n    {distance}", shown(expected), shown(found)).expect("text");
    }
    write!(text, "{}", function.tape).expect("text");
    Some(text)
}

fn shown<T: Number>(value: T) -> String {
    format!("{value:?} (0x{:0width$x})", value.bits(), width = size_of::<T>() * 2)
}

/// How many steps from number to number lie between two results; 1 between the zeros.
fn ulp_distance<T: Number>(a: T, b: T) -> Option<u64> {
    if a.wide().is_nan() || b.wide().is_nan() {
        return None;
    }
    let sign = 1u64 << (size_of::<T>() * 8 - 1);
    // In the order of the numbers: negative ones count down from -1, which is -0.
    let ordered = |value: T| {
        let bits = value.bits();
        if bits & sign == 0 { i128::from(bits) } else { -i128::from(bits & !sign) - 1 }
    };
    u64::try_from((ordered(a) - ordered(b)).unsigned_abs()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_numbers() {
        assert_eq!(ulp_distance(1.0f64, 1.0f64.next_up()), Some(1));
        assert_eq!(ulp_distance(1.0f32, 1.0f32.next_down().next_down()), Some(2));
        assert_eq!(ulp_distance(0.0f64, -0.0f64), Some(1));
        assert_eq!(ulp_distance(f64::NAN, 1.0), None);
        assert!(same(f32::NAN, -f32::NAN));
        assert!(!same(0.0f32, -0.0f32));
    }
}
