use std::fmt::Write as _;

use super::derive::{atan_of_half, half_pi, log_of_ten, log_of_two, parts, polynomials};
use crate::number::{Precision, Rational, decimal, integer};

fn text() -> String {
    let mut text = String::from(
        "//! Constants of the elementary functions, derived in exact rationals by `derive.rs`. Do not edit: a test compares and writes them\n\
         //! (`RSM_BLESS=1 cargo test -p rsm-core elementary`).\n",
    );
    for (name, about, derived) in polynomials() {
        let bound = Precision::F64.round_up(&derived.bound);
        let _ = write!(text, "\n/// {about}. Off by less than {bound:.1e}.\npub(super) const {name}: &[f64] = &[\n");
        for a in derived.coefficients {
            let _ = writeln!(text, "    {},", decimal(a));
        }
        text.push_str("];\n");
    }
    let half_pi = half_pi();
    let log_of_two = log_of_two();
    let log_of_ten = log_of_ten();
    let lists: Vec<(&str, &str, Vec<f64>)> = vec![
        (
            "HALF_PI",
            "pi/2 in parts of 33 bits, so that a product with a whole number below 2^20 is exact",
            parts(&half_pi, 33, 4),
        ),
        ("HALF_PI_PAIR", "pi/2 as a sum", parts(&half_pi, 53, 2)),
        ("PI_PAIR", "pi as a sum", parts(&(integer(2) * &half_pi), 53, 2)),
        ("ATAN_OF_HALF", "atan(1/2) as a sum", parts(&atan_of_half(), 53, 2)),
        ("QUARTER_PI", "pi/4 as a sum", parts(&(&half_pi / integer(2)), 53, 2)),
        (
            "LOG_OF_TWO",
            "log 2 in a part of 40 bits, so that a product with an exponent is exact, and the rest",
            parts(&log_of_two, 40, 2),
        ),
        ("LOG10_OF_TWO", "log10 2 alike", parts(&(&log_of_two / &log_of_ten), 40, 2)),
        ("INVERSE_LOG_OF_TEN", "1/log 10 in a part of 26 bits and the rest", parts(&(integer(1) / &log_of_ten), 26, 2)),
    ];
    for (name, about, values) in lists {
        let values: Vec<String> = values.into_iter().map(decimal).collect();
        let _ = write!(text, "\n/// {about}.\npub(super) const {name}: [f64; {}] = [{}];\n", values.len(), values.join(", "));
    }
    let singles: [(&str, &str, Rational); 2] =
        [("INVERSE_HALF_PI", "2/pi", integer(1) / &half_pi), ("INVERSE_LOG_OF_TWO", "1/log 2", integer(1) / &log_of_two)];
    for (name, about, value) in singles {
        let _ = write!(text, "\n/// {about}.\npub(super) const {name}: f64 = {};\n", decimal(Precision::F64.round(&value)));
    }
    text
}

#[test]
fn the_constants_are_the_derived_ones() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/src/elementary/coefficients.rs");
    let derived = text();
    if std::env::var_os("RSM_BLESS").is_some() {
        std::fs::write(path, &derived).unwrap();
    }
    assert_eq!(std::fs::read_to_string(path).unwrap(), derived, "RSM_BLESS=1 writes the file");
}
