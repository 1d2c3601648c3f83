//! Units: whether a text is a unit, and the conversion between two units.
//!
//! In: texts such as `N*m`, `rad/s`, `degC`, `1` (no dimension). Out: a [`Conversion`] value -> factor value + offset, or a message. The factors come
//! from the library fend-core, exact as fractions (those with pi to more than 30 digits), so a converted value is rounded once. Equal texts are not
//! converted, so the bits stay. There is no table of factors here; other spellings (`Nm`, `m/s²`, `mbar`) are in `spellings.rs`.

mod dimension;
mod spellings;

pub use dimension::{Dimension, dimension};

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use fend_core::{Context, CustomUnitAttribute};
use num_traits::Zero;
use rsm_core::number::{Precision, Rational, exact};

use crate::dd::Dd;

/// A linear conversion from one unit to another.
#[derive(Debug, Clone, PartialEq)]
pub enum Conversion {
    /// The same text on both sides: the bits stay.
    Identity,
    /// factor value + offset.
    Linear {
        /// One of the first unit in the second unit.
        factor: Dd,
        /// Zero of the first unit in the second unit; nonzero only between temperature scales.
        offset: Dd,
    },
}

impl Conversion {
    /// The conversion from one unit to another.
    ///
    /// # Errors
    /// An unknown unit, or two units of different kinds; as a sentence.
    ///
    /// ```
    /// use rsm_fit::units::Conversion;
    ///
    /// assert_eq!(Conversion::between("km/h", "m/s")?.apply(108.0), 30.0);
    /// assert_eq!(Conversion::between("degC", "K")?.apply(20.0), 293.15);
    /// assert!(Conversion::between("rpm", "N*m").unwrap_err().contains("different things"));
    /// # Ok::<(), String>(())
    /// ```
    pub fn between(from: &str, to: &str) -> Result<Self, String> {
        let (from_words, to_words) = (words(from)?, words(to)?);
        if from == to {
            return Ok(Conversion::Identity);
        }
        let incompatible = || format!("`{from}` cannot be converted to `{to}`: they measure different things");
        let [zero, one] = [0, 1].map(|value| convert(value, &from_words, &to_words));
        let (Some(offset), Some(one)) = (zero, one) else { return Err(incompatible()) };
        refuse_cycles_for_angles(from, &from_words, to, &to_words)?;
        Ok(Conversion::Linear { factor: double_double(&(one - &offset)), offset: double_double(&offset) })
    }

    /// Converts a value to the second unit, rounded once.
    #[must_use]
    pub fn apply(&self, value: f64) -> f64 {
        match self {
            Conversion::Identity => value,
            Conversion::Linear { factor, offset } => (Dd::from(value) * *factor + *offset).to_f64(),
        }
    }

    /// The same for many numbers.
    pub(crate) fn apply_to_all(&self, values: &[f64]) -> Vec<f64> {
        match self {
            Conversion::Identity => values.to_vec(),
            Conversion::Linear { .. } => values.iter().map(|value| self.apply(*value)).collect(),
        }
    }
}

/// Whether a text is a unit that can be converted.
///
/// # Errors
/// What is wrong with it, as a sentence.
///
/// ```
/// use rsm_fit::units;
///
/// assert!(units::check("N*m").is_ok());
/// assert!(units::check("parsnip").is_err());
/// ```
pub fn check(text: &str) -> Result<(), String> {
    words(text).map(|_| ())
}

/// The largest length of a unit.
const LONGEST: usize = 80;

/// A unit split into names, exponents and operators; every name is known to the library.
fn words(text: &str) -> Result<Vec<String>, String> {
    // The length is limited, because the library's parser is recursive and computes powers.
    if text.chars().count() > LONGEST {
        return Err(format!("a text of more than {LONGEST} characters is not a unit"));
    }
    let grammar = || {
        format!(
            "`{text}` is not a unit: names joined by `*` and `/`, powers as `m^2`, `1` for no dimension, for example `N*m` or `rad/s`"
        )
    };
    let mut words: Vec<String> = Vec::new();
    let mut name = String::new();
    let meant = spellings::text(text);
    for symbol in meant.chars().chain(std::iter::once('\0')) {
        if symbol.is_alphanumeric() || "_%°".contains(symbol) {
            name.push(symbol);
            continue;
        }
        if !name.is_empty() {
            words.extend(with_power_apart(std::mem::take(&mut name)));
        }
        match symbol {
            '\0' => {}
            '*' | '/' | '^' | '(' | ')' | '-' => words.push(symbol.to_string()),
            _ => return Err(grammar()),
        }
    }
    let mut depth = 0;
    let mut wants_name = true;
    for (k, word) in words.iter_mut().enumerate() {
        match (word.as_str(), wants_name) {
            ("(", true) => depth += 1,
            (")", false) if depth > 0 => depth -= 1,
            ("*" | "/", false) => wants_name = true,
            ("^", false) => {}
            ("-", false) => {}
            (digits, false) if k > 0 && digits.len() < 3 && digits.bytes().all(|b| b.is_ascii_digit()) => {}
            ("1", true) => wants_name = false,
            (_, true) if word.starts_with(|c: char| !c.is_ascii_digit() && !"*/^()-".contains(c)) => {
                *word = match spellings::name(word) {
                    Some(meaning) => meaning.to_string(),
                    None => known_name(word)?,
                };
                wants_name = false;
            }
            _ => return Err(grammar()),
        }
    }
    let exponents_follow_hats = words.windows(2).all(|pair| match (pair[0].as_str(), pair[1].as_str()) {
        ("^", next) => next == "-" || next.bytes().all(|b| b.is_ascii_digit()),
        ("-", next) => next.bytes().all(|b| b.is_ascii_digit()),
        (before, "-") => before == "^",
        (before, next) => !next.bytes().all(|b| b.is_ascii_digit()) || "*/(".contains(before),
    });
    let product = words.windows(2).find(|pair| pair[0].len() > 1 && pair[0].ends_with(')') && pair[1] == "^");
    if product.is_some() {
        return Err(format!("`{text}` has two meanings: write products with `*` and the power where it belongs, as `N*m^2`"));
    }
    let open = words.last().is_some_and(|word| word == "^" || word == "-");
    if depth == 0 && !wants_name && exponents_follow_hats && !open { Ok(words) } else { Err(grammar()) }
}

/// `s2` as `s`, `^`, `2`, if the library does not know it as a name; all else unchanged.
fn with_power_apart(name: String) -> Vec<String> {
    match spellings::with_power(&name) {
        Some((base, power)) if spellings::name(base).is_some() || known_name(base).is_ok() => {
            vec![base.to_string(), "^".to_string(), power.to_string()]
        }
        _ => vec![name],
    }
}

/// The answers of [`find_name`]: a plant file asks for the same few units again and again, and the library takes 20 us for an answer.
static NAMES: Mutex<Option<HashMap<String, Result<String, String>>>> = Mutex::new(None);

fn known_name(name: &str) -> Result<String, String> {
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    names.get_or_insert_default().entry(name.to_string()).or_insert_with(|| find_name(name)).clone()
}

/// The name in the library's spelling. The library accepts `Nm` as the nautical mile `NM`; here upper and lower case differ.
fn find_name(name: &str) -> Result<String, String> {
    // The library's `ohm` accepts `milli` but not `m`; the symbol defined in [`evaluate`] does.
    let ohms =
        name.strip_suffix("ohm").or_else(|| name.strip_suffix(['\u{3a9}', '\u{2126}'])).map(|prefix| format!("{prefix}Ω"));
    let spelled = match name {
        "%" => "percent",
        "°" => "deg",
        "degC" => "°C",
        "degF" => "°F",
        _ => ohms.as_deref().unwrap_or(name),
    };
    let unknown = || format!("`{name}` is not a known unit");
    let answer = evaluate(&format!("1 {spelled}")).ok_or_else(unknown)?;
    // For a unit the library returns the unit in some spelling (`degs` for `deg`); for a function or a constant it does not.
    let found = answer.strip_prefix("1 ").ok_or_else(unknown)?;
    if found != spelled && found.eq_ignore_ascii_case(spelled) {
        return Err(format!("{}; capitals count: there is `{found}`", unknown()));
    }
    Ok(spelled.to_string())
}

/// `value` of one unit in another, as an exact fraction; `None` if they are of different kinds.
fn convert(value: i32, from: &[String], to: &[String]) -> Option<Rational> {
    let answer = evaluate(&format!("{value} ({}) in ({}) as fraction", from.concat(), to.concat()))?;
    let number = answer.trim_start_matches("approx. ").split(' ').next()?;
    let (numerator, denominator) = number.split_once('/').unwrap_or((number, "1"));
    let denominator: Rational = whole(denominator)?;
    (!denominator.is_zero()).then_some(whole(numerator)? / denominator)
}

fn whole(text: &str) -> Option<Rational> {
    text.parse().ok().map(Rational::from_integer)
}

fn evaluate(question: &str) -> Option<String> {
    let mut context = Context::new();
    context.disable_rng();
    // Otherwise C and F would be degrees Celsius and Fahrenheit.
    context.use_coulomb_and_farad();
    context.define_custom_unit_v1("Ω", "Ω", "ohm", &CustomUnitAttribute::AllowShortPrefix);
    fend_core::evaluate(question, &mut context).ok().map(|answer| answer.get_main_result().to_string())
}

fn double_double(value: &Rational) -> Dd {
    let high = Precision::F64.round(value);
    Dd::sum_of(high, Precision::F64.round(&(value - exact(high))))
}

/// In the SI the radian is 1, so 1 Hz would equal 1 rad/s, and a factor of 2 pi would be lost. An angle, or an angle per time, is converted only to
/// another such unit.
fn refuse_cycles_for_angles(from: &str, from_words: &[String], to: &str, to_words: &[String]) -> Result<(), String> {
    const ANGLES: [&str; 15] = [
        "rad",
        "radian",
        "radians",
        "deg",
        "degs",
        "degree",
        "degrees",
        "°",
        "rev",
        "revolution",
        "revolutions",
        "rpm",
        "rps",
        "arcmin",
        "arcsec",
    ];
    let is_angle =
        |words: &[String]| words.iter().any(|word| ANGLES.iter().any(|angle| word.trim_end_matches("/1000)").ends_with(angle)));
    let bare = |words: &[String]| ["rad", "rad/s"].iter().any(|of| convert(1, words, &[(*of).to_string()]).is_some());
    if is_angle(from_words) != is_angle(to_words) && bare(from_words) {
        return Err(format!("`{from}` and `{to}`: one counts an angle, the other does not; a factor of 2 pi would be lost"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_exact_or_good_to_the_last_bit() {
        let pi = std::f64::consts::PI;
        // Correctly rounded truths: products of the defining constants, worked out with exact decimals.
        let cases = [
            ("N*m", "lbf*ft", 1.3558179483314004, 1.0),
            ("lbf*ft", "N*m", 1.0, 1.3558179483314004),
            ("km/h", "m/s", 36.0, 10.0),
            ("mph", "m/s", 1.0, 0.44704),
            ("mph", "km/h", 1.0, 1.609344),
            ("rpm", "rad/s", 60.0, 2.0 * pi),
            ("deg", "rad", 180.0, pi),
            ("rad", "deg", pi, 180.0),
            ("mV*s", "V*s", 203.0, 0.203),
            ("V*s", "Wb", 0.5, 0.5),
            ("A", "mA", 0.5, 500.0),
            ("%", "1", 12.0, 0.12),
            ("percent", "1", 12.0, 0.12),
            ("degC", "K", 25.3, 298.45),
            ("K", "degC", 0.0, -273.15),
            ("degF", "degC", 212.0, 100.0),
            ("mohm", "V/A", 80.0, 0.08),
            ("kΩ", "ohm", 0.5, 500.0),
            ("kg*m^2", "g*cm^2", 1.0, 1e7),
            ("1/s", "Hz", 3.0, 3.0),
            ("s^-1", "Hz", 3.0, 3.0),
            ("C", "A*s", 2.0, 2.0),
            ("J/(kg*K)", "kJ/(kg*K)", 4186.0, 4.186),
        ];
        for (from, to, value, expected) in cases {
            let found = Conversion::between(from, to).unwrap().apply(value);
            assert_eq!(found.to_bits(), f64::to_bits(expected), "{value} {from} = {found:?} {to}, expected {expected:?}");
        }
    }

    #[test]
    fn equal_texts_leave_the_bits_alone() {
        assert_eq!(Conversion::between("degC", "degC"), Ok(Conversion::Identity));
        let value = f64::from_bits(0x3FB9_9999_9999_999B);
        assert_eq!(Conversion::between("rpm", "rpm").unwrap().apply(value).to_bits(), value.to_bits());
    }

    #[test]
    fn nonsense_is_refused_in_words() {
        for text in ["furlongz", "", "3", "N**m", "m^", "m^x", "(m", "m)", "sin", "pi", "1 m", "m*", "2*m", "m-s", "m2^3^"] {
            assert!(check(text).is_err(), "`{text}` was accepted");
        }
        for text in [
            "N*m", "rad/s", "1", "%", "degC", "V*s/A", "m/s^2", "ohm", "Ω", "µs", "uF", "1/s", "A", "V", "lbf*ft", "deg", "l",
            "bar",
        ] {
            assert_eq!(check(text), Ok(()));
        }
        assert_eq!(check("khz").unwrap_err(), "`khz` is not a known unit; capitals count: there is `kHz`");
        assert_eq!(Conversion::between("V", "A").unwrap_err(), "`V` cannot be converted to `A`: they measure different things");
        for (from, to) in [("Hz", "rad/s"), ("rpm", "Hz"), ("rpm", "1/s"), ("%", "deg")] {
            assert!(Conversion::between(from, to).unwrap_err().contains("2 pi"), "{from} to {to}");
        }
        assert!(Conversion::between("kW", "N*m*rad/s").is_ok());
    }
}
