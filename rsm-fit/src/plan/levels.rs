//! Levels of a factor from `from`, `to` and a step or a count.
//!
//! In: the numbers of a specification. Out: levels as the decimals that a person would write (0.1, 0.2, 0.3), not sums of binary fractions; or a
//! message about a fault.

/// A finite number as its shortest decimal: the digits, and the number of decimal places.
struct Decimal {
    digits: i128,
    places: usize,
}

/// The largest number of decimal places. With more, the integers below would overflow.
const MOST_PLACES: usize = 15;

/// Above this, the digits of two levels times a count would overflow.
const LARGEST: f64 = 1e15;

impl Decimal {
    fn of(value: f64) -> Option<Self> {
        // Without an exponent, and as short as possible for the same bits.
        let text = format!("{value}");
        let places = text.split_once('.').map_or(0, |(_, behind)| behind.len());
        let digits = text.replace('.', "").parse().ok()?;
        (places <= MOST_PLACES && value.abs() <= LARGEST).then_some(Decimal { digits, places })
    }

    fn with(&self, places: usize) -> i128 {
        self.digits * 10i128.pow((places - self.places) as u32)
    }

    fn to_f64(digits: i128, places: usize) -> Option<f64> {
        format!("{digits}e-{places}").parse().ok().map(|value: f64| value + 0.0)
    }
}

/// `from`, `from + step`, ... to `to`, which must be reached exactly.
pub(super) fn stepped(from: f64, to: f64, step: f64, most: usize) -> Result<Vec<f64>, String> {
    if step == 0.0 {
        return Err("`step`: found 0, expected the distance between two levels".to_string());
    }
    let odd =
        || format!("levels from {from} to {to} by {step}: expected decimals of at most {MOST_PLACES} places below {LARGEST:e}");
    let [first, last, distance] = [from, to, step].map(Decimal::of).map(|found| found.ok_or_else(odd));
    let (first, last, distance) = (first?, last?, distance?);
    let places = first.places.max(last.places).max(distance.places);
    let (first, last, distance) = (first.with(places), last.with(places), distance.with(places));
    if (last - first) % distance != 0 {
        return Err(format!("{from} to {to} is not a whole number of steps of {step}"));
    }
    let steps = (last - first) / distance;
    if steps < 0 {
        return Err(format!("steps of {step} lead from {from} away from {to}"));
    }
    if steps >= most as i128 {
        return Err(format!("steps of {step} from {from} to {to} make {} levels, at most {most} are accepted", steps + 1));
    }
    let levels = (0..=steps).map(|k| Decimal::to_f64(first + k * distance, places));
    levels.collect::<Option<Vec<f64>>>().ok_or_else(odd)
}

/// `count` equidistant levels from `from` to `to`, both included.
pub(super) fn counted(from: f64, to: f64, count: usize) -> Vec<f64> {
    let last = (count - 1) as f64;
    // With weights instead of steps both ends are exact, and 0 to 1 in ten steps gives 0.3, not 3 * 0.1.
    (0..count).map(|k| (from * (last - k as f64) + to * k as f64) / last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_the_decimals_that_a_person_would_write() {
        assert_eq!(stepped(-0.3, 0.3, 0.1, 100).unwrap(), [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3]);
        assert_eq!(stepped(100.0, 10.0, -45.0, 100).unwrap(), [100.0, 55.0, 10.0]);
        assert_eq!(stepped(5.0, 5.0, 1.0, 100).unwrap(), [5.0]);
        assert_eq!(counted(1200.0, 4800.0, 5), [1200.0, 2100.0, 3000.0, 3900.0, 4800.0]);
        assert_eq!(counted(0.0, 1.0, 11)[3], 0.3);
    }

    #[test]
    fn steps_that_miss_the_end_are_refused() {
        assert_eq!(stepped(0.0, 1.0, 0.3, 100).unwrap_err(), "0 to 1 is not a whole number of steps of 0.3");
        assert_eq!(stepped(0.0, 1.0, -0.5, 100).unwrap_err(), "steps of -0.5 lead from 0 away from 1");
        assert!(stepped(0.0, 1.0, 1e-7, 100).unwrap_err().ends_with("make 10000001 levels, at most 100 are accepted"));
        assert!(stepped(0.0, 1e300, 1.0, 100).unwrap_err().contains("expected decimals"));
    }
}
