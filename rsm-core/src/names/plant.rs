//! Names of a plant's signals and states in emitted code.
//!
//! A flattened text has names such as `shaft.flange_a.w` and `'motor (1)'`. Unlike in a model file, such names are changed: every character that C
//! does not allow becomes an underscore, and a number is appended to a name that already exists.

use super::{OUTPUTS, STATE, clash, refuse};

/// The name of a model in emitted code: `ServoAxis` is `servo_axis`.
///
/// ```
/// use rsm_core::names::plant;
///
/// assert_eq!(plant::model("ServoAxis"), "servo_axis");
/// assert_eq!(plant::model("Drive.PMSM2"), "drive_pmsm2");
/// ```
#[must_use]
pub fn model(name: &str) -> String {
    let mut text = String::new();
    let mut before = ' ';
    for sign in name.chars() {
        if sign.is_ascii_uppercase() && before.is_ascii_lowercase() {
            text.push('_');
        }
        text.push(sign.to_ascii_lowercase());
        before = sign;
    }
    fitting(&text, "plant")
}

/// The names of signals in one scope, all different.
///
/// ```
/// use rsm_core::names::plant;
///
/// let names = plant::signals(["shaft.w", "shaft_w", "w'", "while", "r1"]);
/// assert_eq!(names, ["shaft_w", "shaft_w_2", "w", "while_2", "r1_2"]);
/// ```
#[must_use]
pub fn signals<'n>(names: impl IntoIterator<Item = &'n str>) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for name in names {
        let plain = fitting(name, "x");
        let is_free = |name: &String| {
            name != STATE && name != OUTPUTS && refuse(name).is_none() && all.iter().all(|other| clash(other, name).is_none())
        };
        let numbered = (2..).map(|k| format!("{plain}_{k}"));
        let free = std::iter::once(plain.clone()).chain(numbered).find(is_free).expect("there are more numbers than names");
        all.push(free);
    }
    all
}

/// A name of letters, digits and single underscores between them; `instead` if nothing is left.
fn fitting(name: &str, instead: &str) -> String {
    let parts: Vec<&str> = name.split(|sign: char| !sign.is_ascii_alphanumeric()).filter(|part| !part.is_empty()).collect();
    let text = parts.join("_");
    if text.is_empty() {
        instead.to_string()
    } else if text.starts_with(|sign: char| sign.is_ascii_digit()) || text.to_ascii_lowercase().starts_with("rsm") {
        format!("{instead}_{text}")
    } else {
        text
    }
}
