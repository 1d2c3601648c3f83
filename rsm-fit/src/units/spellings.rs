//! Other spellings of units with a single meaning.
//!
//! In: a text from a file's header. Out: the same unit in the grammar of [`super`]. A spelling that could mean two units is not in the table and is
//! rejected: a bare `1/min` for `rad/s`, `lb-ft` for a torque, `g` for gravity.
//!
//! The table has meanings, not factors; these come from the library.

use std::borrow::Cow;

/// Complete texts.
const TEXTS: &[(&str, &str)] = &[
    ("-", "1"),
    // Revolutions per minute. A bare `1/min` may count anything and is not changed.
    ("r/min", "rpm"),
    ("rev/min", "rpm"),
    ("U/min", "rpm"),
    ("tr/min", "rpm"),
    // Moments of inertia. Without a power, `kgm` is not in the table of names, because a power after it would belong only to the metre.
    ("kgm^2", "kg*m^2"),
    ("kgm2", "kg*m^2"),
    ("gcm^2", "g*cm^2"),
    ("gcm2", "g*cm^2"),
    ("N m", "N*m"),
    ("deg C", "degC"),
    ("℃", "degC"),
    ("lbf-ft", "lbf*ft"),
    ("ft-lbf", "lbf*ft"),
];

/// Names, and expressions that the library can evaluate. A product or a quotient is in parentheses, so that `V/Nm` is V/(N*m). No power may follow
/// it, because `Nm^2` may be read as N*m^2 or as (N*m)^2.
const NAMES: &[(&str, &str)] = &[
    ("Nm", "(N*m)"),
    ("mNm", "(mN*m)"),
    ("uNm", "(uN*m)"),
    ("µNm", "(uN*m)"),
    ("kNm", "(kN*m)"),
    ("MNm", "(MN*m)"),
    ("Ncm", "(N*cm)"),
    ("Nmm", "(N*mm)"),
    ("Nms", "(N*m*s)"),
    ("Ns", "(N*s)"),
    ("Vs", "(V*s)"),
    ("mVs", "(mV*s)"),
    ("As", "(A*s)"),
    ("Ws", "(W*s)"),
    ("VA", "(V*A)"),
    ("kVA", "(kV*A)"),
    ("mbar", "hPa"),
    ("T", "(Wb/m^2)"),
    ("mT", "(mWb/m^2)"),
    ("mrad", "(rad/1000)"),
    ("kmh", "(km/h)"),
    ("kmph", "(km/h)"),
    ("RPM", "rpm"),
    ("Celsius", "°C"),
    ("mohm", "mΩ"),
    ("Ohm", "Ω"),
    ("Ohms", "Ω"),
];

/// The text in the grammar: signs of products and of minus, and powers that are superscripts or follow a name.
pub(super) fn text(original: &str) -> Cow<'_, str> {
    let original = original.trim();
    let mut out = String::new();
    let symbols: Vec<char> = original.chars().collect();
    let mut is_raised = false;
    for (k, symbol) in symbols.iter().enumerate() {
        let raised = "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|it| it == *symbol).map(|digit| char::from(b'0' + digit as u8));
        let is_minus = *symbol == '⁻';
        if (raised.is_some() || is_minus) && !is_raised {
            out.push('^');
        }
        is_raised = raised.is_some() || is_minus;
        let between_letters = || {
            let is_letter = |at: Option<&char>| at.is_some_and(|it| it.is_alphabetic());
            k > 0 && is_letter(symbols.get(k - 1)) && is_letter(symbols.get(k + 1))
        };
        match (*symbol, raised) {
            (_, Some(digit)) => out.push(digit),
            ('⁻' | '−', _) => out.push('-'),
            ('·' | '⋅' | '×', _) => out.push('*'),
            ('.', _) if between_letters() => out.push('*'),
            // Two characters for the same prefix, and two for the same unit.
            ('μ', _) => out.push('µ'),
            ('\u{2126}', _) => out.push('\u{3a9}'),
            (other, _) => out.push(other),
        }
    }
    if let Some((_, meaning)) = TEXTS.iter().find(|(spelling, _)| *spelling == out) {
        return Cow::Borrowed(meaning);
    }
    if out == original { Cow::Borrowed(original) } else { Cow::Owned(out) }
}

/// The meaning of a name, if it is in the table.
pub(super) fn name(name: &str) -> Option<&'static str> {
    NAMES.iter().find(|(spelling, _)| *spelling == name).map(|(_, meaning)| *meaning)
}

/// A name with a power after it (`s2`, `m3`), split in two. Only square and cube; nothing else is written like this.
pub(super) fn with_power(name: &str) -> Option<(&str, &str)> {
    let cut = name.len().checked_sub(1)?;
    let (base, power) = (name.get(..cut)?, name.get(cut..)?);
    let is_base = !base.is_empty() && base.chars().all(char::is_alphabetic);
    (is_base && (power == "2" || power == "3")).then_some((base, power))
}

#[cfg(test)]
mod tests {
    use super::super::{Conversion, check};
    use super::*;

    /// Every entry, the unit in which its factor is a defined number, and that number: from the definitions of the SI (BIPM, 9th edition), of the
    /// international foot (0.3048 m) and pound (0.45359237 kg at 9.80665 m/s^2).
    const DEFINITIONS: &[(&str, &str, f64)] = &[
        ("-", "1", 1.0),
        ("r/min", "rev/s", 1.0 / 60.0),
        ("rev/min", "rev/s", 1.0 / 60.0),
        ("U/min", "rev/s", 1.0 / 60.0),
        ("tr/min", "rev/s", 1.0 / 60.0),
        ("RPM", "rev/s", 1.0 / 60.0),
        ("kgm^2", "kg*m^2", 1.0),
        ("kgm2", "kg*m^2", 1.0),
        ("gcm^2", "kg*m^2", 1e-7),
        ("gcm2", "kg*m^2", 1e-7),
        ("N m", "kg*m^2/s^2", 1.0),
        ("deg C", "degC", 1.0),
        ("℃", "degC", 1.0),
        ("Celsius", "degC", 1.0),
        ("lbf-ft", "N*m", 1.3558179483314004),
        ("ft-lbf", "N*m", 1.3558179483314004),
        ("Nm", "kg*m^2/s^2", 1.0),
        ("mNm", "kg*m^2/s^2", 1e-3),
        ("uNm", "kg*m^2/s^2", 1e-6),
        ("µNm", "kg*m^2/s^2", 1e-6),
        ("kNm", "kg*m^2/s^2", 1e3),
        ("MNm", "kg*m^2/s^2", 1e6),
        ("Ncm", "kg*m^2/s^2", 1e-2),
        ("Nmm", "kg*m^2/s^2", 1e-3),
        ("Nms", "kg*m^2/s", 1.0),
        ("Ns", "kg*m/s", 1.0),
        ("Vs", "kg*m^2/(s^2*A)", 1.0),
        ("mVs", "kg*m^2/(s^2*A)", 1e-3),
        ("As", "C", 1.0),
        ("Ws", "kg*m^2/s^2", 1.0),
        ("VA", "kg*m^2/s^3", 1.0),
        ("kVA", "kg*m^2/s^3", 1e3),
        ("mbar", "kg/(m*s^2)", 100.0),
        ("T", "kg/(s^2*A)", 1.0),
        ("mT", "kg/(s^2*A)", 1e-3),
        ("mrad", "rad", 1e-3),
        ("kmh", "m/s", 1.0 / 3.6),
        ("kmph", "m/s", 1.0 / 3.6),
        ("mohm", "kg*m^2/(s^3*A^2)", 1e-3),
        ("Ohm", "kg*m^2/(s^3*A^2)", 1.0),
        ("Ohms", "kg*m^2/(s^3*A^2)", 1.0),
    ];

    #[test]
    fn every_entry_means_what_it_says() {
        let of_table = TEXTS.iter().chain(NAMES).map(|(spelling, _)| *spelling);
        for spelling in of_table {
            let Some((_, unit, factor)) = DEFINITIONS.iter().find(|(it, ..)| *it == spelling) else {
                panic!("`{spelling}` has no line in the list of meanings");
            };
            let way = Conversion::between(spelling, unit).unwrap_or_else(|reason| panic!("{spelling}: {reason}"));
            // 1/3.6 and 1/60 of f64 are the rounded exact quotients, as the conversion's are.
            assert_eq!((way.apply(0.0), way.apply(1.0).to_bits()), (0.0, factor.to_bits()), "{spelling} in {unit}");
        }
    }

    #[test]
    fn signs_and_raised_powers_are_those_of_the_grammar() {
        for (spelling, unit) in [
            ("m/s²", "m/s^2"),
            ("m/s2", "m/s^2"),
            ("m·s⁻²", "m/s^2"),
            ("m·s^−2", "m/s^2"),
            ("N.m", "N*m"),
            ("N·m", "N*m"),
            ("N⋅m", "N*m"),
            ("kg·m²", "kg*m^2"),
            ("mm3", "mm^3"),
            ("V/Nm", "V/(N*m)"),
            ("Nm/rad", "N*m/rad"),
            ("Nms/rad", "N*m*s/rad"),
            ("°C", "degC"),
            ("μm", "um"),
            ("µm", "um"),
            ("\u{2126}", "ohm"),
            ("deg/s", "°/s"),
            ("kph", "km/h"),
            (" Nm ", "N*m"),
        ] {
            let way = Conversion::between(spelling, unit).unwrap_or_else(|reason| panic!("{spelling}: {reason}"));
            assert_eq!((way.apply(0.0), way.apply(1.0)), (0.0, 1.0), "{spelling} in {unit}");
        }
    }

    #[test]
    fn what_has_two_meanings_is_refused() {
        for text in [
            "Nm^2", "Nm2", "V/Nm²", "lb-ft", "1.5", "m.2", "N..m", "s22", "H2O", "nm2o", "khz", "kw", "NM", "vs", "--", ".",
            "²",
        ] {
            assert!(check(text).is_err() || text == "NM", "`{text}` was accepted");
        }
        // The nautical mile is spelt so, and is no torque.
        assert!(Conversion::between("NM", "N*m").is_err());
        // A bare rate is no speed of rotation.
        for (from, to) in [("1/min", "rad/s"), ("1/min", "rpm"), ("Hz", "mrad"), ("mrad", "1")] {
            assert!(Conversion::between(from, to).is_err(), "{from} to {to}");
        }
    }
}
