//! The dimension of a unit: the exponents of the seven base units, and its size in them.
//!
//! For code that computes with units instead of numbers: two sides of an equation, a product. Every size comes from the library. Here are only the
//! exponents of the units that the SI names (BIPM, 9th edition, table 4), by which the library's names are recognised.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use rsm_core::number::{Precision, Rational};

use super::{convert, words};

/// The dimension and the size of a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dimension {
    /// The exponents of kg, m, s, A, K, mol and cd. The radian is 1.
    pub exponents: [i32; 7],
    /// The size of the unit in base units.
    pub factor: f64,
    /// Whether zero of the unit is not zero in base units: degrees Celsius and Fahrenheit.
    pub has_offset: bool,
}

/// Units for recognising a name, the frequent ones first.
const KNOWN: &[(&str, [i32; 7])] = &[
    ("rad", [0, 0, 0, 0, 0, 0, 0]),
    ("m", [0, 1, 0, 0, 0, 0, 0]),
    ("s", [0, 0, 1, 0, 0, 0, 0]),
    ("kg", [1, 0, 0, 0, 0, 0, 0]),
    ("N", [1, 1, -2, 0, 0, 0, 0]),
    ("rad/s", [0, 0, -1, 0, 0, 0, 0]),
    ("A", [0, 0, 0, 1, 0, 0, 0]),
    ("V", [1, 2, -3, -1, 0, 0, 0]),
    ("W", [1, 2, -3, 0, 0, 0, 0]),
    ("K", [0, 0, 0, 0, 1, 0, 0]),
    ("Pa", [1, -1, -2, 0, 0, 0, 0]),
    ("J", [1, 2, -2, 0, 0, 0, 0]),
    ("Ω", [1, 2, -3, -2, 0, 0, 0]),
    ("H", [1, 2, -2, -2, 0, 0, 0]),
    ("F", [-1, -2, 4, 2, 0, 0, 0]),
    ("V*s", [1, 2, -2, -1, 0, 0, 0]),
    ("Wb/m^2", [1, 0, -2, -1, 0, 0, 0]),
    ("A*s", [0, 0, 1, 1, 0, 0, 0]),
    ("A/V", [-1, -2, 3, 2, 0, 0, 0]),
    ("m^3", [0, 3, 0, 0, 0, 0, 0]),
    ("m/s", [0, 1, -1, 0, 0, 0, 0]),
    ("m^2", [0, 2, 0, 0, 0, 0, 0]),
    ("N*m", [1, 2, -2, 0, 0, 0, 0]),
    ("m/s^2", [0, 1, -2, 0, 0, 0, 0]),
    ("mol", [0, 0, 0, 0, 0, 1, 0]),
    ("cd", [0, 0, 0, 0, 0, 0, 1]),
    ("m^2/s^2", [0, 2, -2, 0, 0, 0, 0]),
    ("kg/m^3", [1, -3, 0, 0, 0, 0, 0]),
    ("N*s", [1, 1, -1, 0, 0, 0, 0]),
];

/// A cache of recognised names.
static CACHE: Mutex<Option<HashMap<String, Option<Dimension>>>> = Mutex::new(None);

/// The dimension of a unit.
///
/// ```
/// use rsm_fit::units::dimension;
///
/// let torque = dimension("N*m")?;
/// assert_eq!(torque.exponents, [1, 2, -2, 0, 0, 0, 0]);
/// assert_eq!(dimension("kN*cm")?.factor, 10.0);
/// assert_eq!(dimension("kg*m^2/s^2")?, torque);
/// assert!(dimension("parsnip").is_err());
/// # Ok::<(), String>(())
/// ```
///
/// # Errors
/// If it is not a unit, or if no named unit of the SI has its dimension; as a sentence.
pub fn dimension(text: &str) -> Result<Dimension, String> {
    let words = words(text)?;
    let mut reader = Reader { words: &words, at: 0, text };
    reader.product()
}

struct Reader<'w> {
    words: &'w [String],
    at: usize,
    text: &'w str,
}

impl Reader<'_> {
    fn word(&self) -> Option<&str> {
        self.words.get(self.at).map(String::as_str)
    }

    fn product(&mut self) -> Result<Dimension, String> {
        let mut total = self.power()?;
        while let Some(sign @ ("*" | "/")) = self.word() {
            let sign = if sign == "*" { 1 } else { -1 };
            self.at += 1;
            let next = self.power()?;
            total = times(total, next, sign);
        }
        Ok(total)
    }

    fn power(&mut self) -> Result<Dimension, String> {
        let base = match self.word() {
            Some("(") => {
                self.at += 1;
                let inner = self.product()?;
                self.at += 1;
                inner
            }
            Some(name) => {
                let name = name.to_string();
                self.at += 1;
                of_name(&name).ok_or_else(|| format!("`{}`: the dimension of `{name}` is not known", self.text))?
            }
            None => Dimension { exponents: [0; 7], factor: 1.0, has_offset: false },
        };
        if self.word() != Some("^") {
            return Ok(base);
        }
        self.at += 1;
        let sign = if self.word() == Some("-") {
            self.at += 1;
            -1
        } else {
            1
        };
        let exponent: i32 = self.word().and_then(|word| word.parse().ok()).unwrap_or(1);
        self.at += 1;
        let one = Dimension { exponents: [0; 7], factor: 1.0, has_offset: false };
        Ok((0..exponent).fold(one, |total, _| times(total, base, sign)))
    }
}

fn times(a: Dimension, b: Dimension, sign: i32) -> Dimension {
    let mut exponents = a.exponents;
    for (exponent, other) in exponents.iter_mut().zip(b.exponents) {
        *exponent += sign * other;
    }
    // In a product, a temperature counts as a difference of temperatures.
    Dimension { exponents, factor: if sign > 0 { a.factor * b.factor } else { a.factor / b.factor }, has_offset: false }
}

fn of_name(name: &str) -> Option<Dimension> {
    let mut found = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    let found = found.get_or_insert_default();
    if let Some(known) = found.get(name) {
        return *known;
    }
    let dimension = find_dimension(name);
    found.insert(name.to_string(), dimension);
    dimension
}

fn find_dimension(name: &str) -> Option<Dimension> {
    if name == "1" {
        return Some(Dimension { exponents: [0; 7], factor: 1.0, has_offset: false });
    }
    let from = [name.to_string()];
    KNOWN.iter().find_map(|(unit, exponents)| {
        let to = words(unit).ok()?;
        let [zero, one] = [0, 1].map(|value| convert(value, &from, &to));
        let (zero, one) = (zero?, one?);
        let factor: Rational = one - &zero;
        Some(Dimension {
            exponents: *exponents,
            factor: Precision::F64.round(&factor),
            has_offset: Precision::F64.round(&zero) != 0.0,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_powers_are_those_of_the_base_units() {
        for (text, exponents, factor) in [
            ("1", [0, 0, 0, 0, 0, 0, 0], 1.0),
            ("kg*m^2", [1, 2, 0, 0, 0, 0, 0], 1.0),
            ("N*m*s/rad", [1, 2, -1, 0, 0, 0, 0], 1.0),
            ("W/(m^2*K)", [1, 0, -3, 0, -1, 0, 0], 1.0),
            ("km/h", [0, 1, -1, 0, 0, 0, 0], 1.0 / 3.6),
            ("mm^2", [0, 2, 0, 0, 0, 0, 0], 1e-6),
            ("s^-2", [0, 0, -2, 0, 0, 0, 0], 1.0),
            ("Ohm*F", [0, 0, 1, 0, 0, 0, 0], 1.0),
            ("V*s", [1, 2, -2, -1, 0, 0, 0], 1.0),
            ("Hz", [0, 0, -1, 0, 0, 0, 0], 1.0),
            ("bar", [1, -1, -2, 0, 0, 0, 0], 1e5),
            ("l/min", [0, 3, -1, 0, 0, 0, 0], 1e-3 / 60.0),
            ("deg", [0, 0, 0, 0, 0, 0, 0], std::f64::consts::PI / 180.0),
            ("T", [1, 0, -2, -1, 0, 0, 0], 1.0),
        ] {
            let found = dimension(text).unwrap();
            assert_eq!(found.exponents, exponents, "{text}");
            // A product of up to four rounded factors.
            assert!((found.factor - factor).abs() <= 1e-15 * factor, "{text}: {}", found.factor);
        }
    }

    #[test]
    fn a_temperature_from_another_zero_is_marked() {
        assert!(dimension("degC").unwrap().has_offset && dimension("degF").unwrap().has_offset);
        assert!(!dimension("K").unwrap().has_offset && !dimension("W/degC").unwrap().has_offset);
    }
}
