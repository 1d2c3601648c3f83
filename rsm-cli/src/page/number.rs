//! Numbers for reports, rounded to the digits that their uncertainty supports.
//!
//! In: values, the half widths of their intervals, units. Out: text. Files and JSON keep all digits; pages do not.

/// A multiple of the noise: two decimals, or two digits if it is a thousand or more, for a record with almost no noise.
pub fn multiple(value: f64) -> String {
    if value.abs() < 1000.0 { format!("{value:.2}") } else { format!("{value:.1e}") }
}

/// A number with five significant digits.
pub fn figure(value: Option<f64>) -> String {
    value.map_or("none".to_string(), |value| digits(value, 5))
}

/// A number with three significant digits: an error, or evidence, is not known more precisely.
pub fn short(value: f64) -> String {
    digits(value, 3)
}

/// A number with this many significant digits.
fn digits(value: f64, count: i32) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let before = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
        format!("{value:.*}", (count - 1 - before).max(0) as usize)
    } else {
        format!("{value:.*e}", (count - 1).max(0) as usize)
    }
}

/// A number rounded to the second significant digit of the half width of its interval. Without an interval, four significant digits.
pub fn known(value: f64, half_width: f64) -> String {
    if !(half_width > 0.0 && half_width.is_finite() && value.is_finite()) {
        return digits(value, 4);
    }
    // Without noise an interval is almost 0: six digits are enough for a page.
    let last = (half_width.log10().floor() as i32 - 1).max(value.abs().max(half_width).log10().floor() as i32 - 5);
    let largest = value.abs().max(half_width);
    if !(1e-3..1e6).contains(&largest) {
        // Scientific notation: from the first digit of the value to the last known digit.
        let first = if value == 0.0 { last } else { value.abs().log10().floor() as i32 };
        return format!("{value:.*e}", (first - last).clamp(0, 12) as usize);
    }
    if last > 0 {
        let unit = 10.0_f64.powi(last);
        return format!("{:.0}", (value / unit).round() * unit);
    }
    format!("{value:.*}", (-last).min(12) as usize)
}

/// The number of digits after the point: two significant digits of the uncertainty. Without an uncertainty, four significant digits of the size.
pub fn decimals(half_width: f64, size: f64) -> usize {
    let of = |value: f64, digits: i32| (digits - 1 - value.log10().floor() as i32).clamp(0, 9) as usize;
    if half_width > 0.0 && half_width.is_finite() {
        of(half_width, 2)
    } else if size > 0.0 && size.is_finite() {
        of(size, 4)
    } else {
        3
    }
}

/// A number with its unit. The unit "1" is not printed.
pub fn with_unit(number: &str, unit: &str) -> String {
    if unit == "1" || unit.is_empty() { number.to_string() } else { format!("{number} {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_ends_where_its_interval_begins() {
        assert_eq!(known(12.03461, 0.213), "12.03");
        assert_eq!(known(12.03461, 0.0213), "12.035");
        assert_eq!(known(1234.5, 87.0), "1234");
        assert_eq!(known(123456.0, 870.0), "123460");
        assert_eq!(known(-0.5, 3.0), "-0.5");
        assert_eq!(known(1.234567e-7, 2.0e-9), "1.235e-7");
        assert_eq!(known(0.0, 0.05), "0.000");
        assert_eq!(known(3.71828, f64::INFINITY), "3.718");
        assert_eq!(known(12.0, 2e-8), "12.0000");
    }

    #[test]
    fn figures_have_their_digits() {
        assert_eq!(figure(Some(12.345678)), "12.346");
        assert_eq!(figure(Some(1.5e-7)), "1.5000e-7");
        assert_eq!(short(0.012345), "0.0123");
        assert_eq!([decimals(0.42, 30.0), decimals(42.0, 3e4), decimals(0.0, 30.0), decimals(0.0, 0.0)], [2, 0, 2, 3]);
        assert_eq!(with_unit("3", "1"), "3");
        assert_eq!(with_unit("3", "N"), "3 N");
    }

    #[test]
    fn a_multiple_has_what_a_reader_can_use() {
        assert_eq!([0.0, 1.004, 41.98, 999.99].map(multiple), ["0.00", "1.00", "41.98", "999.99"]);
        assert_eq!([1000.0, 57676012.88].map(multiple), ["1.0e3", "5.8e7"]);
    }
}
