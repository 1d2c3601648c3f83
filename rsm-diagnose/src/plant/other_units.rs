//! Alternative units of a column whose record may state a wrong unit.
//!
//! In: a unit. Out: other units of the same quantity with their factors. Independent of plants and records.

use rsm_fit::units::Conversion;

/// A possible true unit of a column: its name, and how many of it equal one of the record's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlternativeUnit {
    /// The name in words.
    pub name: &'static str,
    /// The reading divided by the true value.
    pub factor: f64,
}

const fn other(name: &'static str, factor: f64) -> AlternativeUnit {
    AlternativeUnit { name, factor }
}

/// For every unit.
const PREFIXES: [AlternativeUnit; 2] = [other("thousandths (m...)", 1000.0), other("thousands (k...)", 0.001)];

/// For a quantity of a rotating frame. Its size stands for a wave, and a wave has several usual sizes.
pub(super) const OF_A_WAVE: [AlternativeUnit; 2] =
    [other("r.m.s. values", std::f64::consts::FRAC_1_SQRT_2), other("peak-to-peak values", 2.0)];

/// Lists by a unit of the quantity. 9.549297 is 30/pi, 57.29578 is 180/pi, 0.1591549 is 1/(2 pi), 0.1019716 is 1/9.80665. 0.7375621, 2.236936,
/// 0.2248089, 1.450377e-4 and 1.341022e-3 are for the pound-foot, the mile per hour, the pound-force, the pound-force per square inch and the
/// horsepower, from the international yard and pound (1959).
const KINDS: [(&str, &[AlternativeUnit]); 17] = [
    ("rad/s", &[other("rpm", 9.549_297), other("revolutions per second", 0.159_154_9), other("deg/s", 57.295_78)]),
    ("rad", &[other("deg", 57.295_78), other("revolutions", 0.159_154_9)]),
    ("rad/s^2", &[other("deg/s^2", 57.295_78)]),
    ("m/s", &[other("km/h", 3.6), other("mile/h", 2.236_936), other("mm/s", 1000.0), other("cm/s", 100.0)]),
    ("m", &[other("mm", 1000.0), other("cm", 100.0), other("inch", 39.370_08)]),
    ("m/s^2", &[other("g", 0.101_971_6)]),
    ("N*m", &[other("kgf m", 0.101_971_6), other("N cm", 100.0), other("N mm", 1000.0), other("lbf ft", 0.737_562_1)]),
    ("N", &[other("kgf", 0.101_971_6), other("lbf", 0.224_808_9)]),
    ("Pa", &[other("bar", 1e-5), other("mbar", 1e-2), other("MPa", 1e-6), other("psi", 1.450_377e-4)]),
    ("m^3/s", &[other("l/s", 1000.0), other("l/min", 60_000.0), other("m^3/h", 3600.0)]),
    ("m^3", &[other("l", 1000.0), other("cm^3", 1e6)]),
    ("m^2", &[other("cm^2", 1e4), other("mm^2", 1e6)]),
    ("kg/s", &[other("kg/min", 60.0), other("kg/h", 3600.0)]),
    ("W", &[other("horsepower", 1.341_022e-3)]),
    ("J", &[other("W h", 2.777_778e-4), other("kW h", 2.777_778e-7)]),
    ("s", &[other("min", 1.0 / 60.0), other("h", 1.0 / 3600.0)]),
    ("1", &[other("per cent", 100.0)]),
];

/// Other units of the same quantity. A quantity without a list has only its thousandths and thousands.
///
/// ```
/// use rsm_diagnose::plant::other_units::alternative_units;
///
/// let rpm = alternative_units("rad/s")[0];
/// assert_eq!((rpm.name, rpm.factor), ("rpm", 9.549297)); // readings over the truth
/// ```
#[must_use]
pub fn alternative_units(unit: &str) -> Vec<AlternativeUnit> {
    // The number of the list's units in one of the record's units.
    let scale = |of: &str| match Conversion::between(unit, of) {
        Ok(way) if way.apply(0.0) == 0.0 => Some(way.apply(1.0)),
        _ => None,
    };
    let known = KINDS.iter().find_map(|(of, list)| scale(of).map(|scale| (scale, *list)));
    let (scale, list) = known.unwrap_or((1.0, &[]));
    let mut all: Vec<AlternativeUnit> = list.iter().map(|it| AlternativeUnit { factor: it.factor * scale, ..*it }).collect();
    for prefix in PREFIXES {
        if !all.iter().any(|it| (it.factor / prefix.factor - 1.0).abs() < SAME) {
            all.push(prefix);
        }
    }
    // The record's own unit is left out.
    all.retain(|it| (it.factor - 1.0).abs() > SAME);
    all
}

/// Factors are given with seven digits.
const SAME: f64 = 1e-5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_those_of_the_library_of_units() {
        // Names that the library reads; "revolutions", r.m.s. and peak-to-peak values are no units there.
        let read = [
            ("rpm", "rad/s"),
            ("deg/s", "rad/s"),
            ("deg", "rad"),
            ("km/h", "m/s"),
            ("mm/s", "m/s"),
            ("cm", "m"),
            ("inch", "m"),
            ("kgf", "N"),
            ("lbf", "N"),
            ("bar", "Pa"),
            ("psi", "Pa"),
            ("kg/h", "kg/s"),
            ("horsepower", "W"),
            ("min", "s"),
        ];
        for (name, unit) in read {
            let one = Conversion::between(unit, name).expect(name).apply(1.0);
            let listed = alternative_units(unit).into_iter().find(|it| it.name == name).expect(name);
            assert!((listed.factor / one - 1.0).abs() < SAME, "{name}: {} {one}", listed.factor);
        }
    }

    #[test]
    fn every_unit_has_others_and_none_is_itself() {
        for unit in ["rad/s", "rpm", "deg", "N*m", "K", "W", "km/h", "m^3/s", "A", "1", "Wb"] {
            let all = alternative_units(unit);
            assert!(all.len() > 1 && all.iter().all(|it| (it.factor - 1.0).abs() > SAME), "{unit}: {all:?}");
        }
        // A record in km/h whose column is in mm/s reads 1000/3.6 times the truth.
        assert!(alternative_units("km/h").iter().any(|it| it.name == "mm/s" && (it.factor * 3.6 / 1000.0 - 1.0).abs() < SAME));
    }
}
