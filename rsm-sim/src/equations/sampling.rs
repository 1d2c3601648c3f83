//! Instants of `sample`.

/// The largest relative difference of two instants that are the same: sums and products of decimals agree to a few units in the last place.
pub(super) const SAME: f64 = 8.0 * f64::EPSILON;

/// The number of instants of a `sample` before a time.
pub(super) fn instants_before((first, period): (f64, f64), time: f64) -> f64 {
    let is_past = |count: f64| first + count * period < time - SAME * time.abs();
    let mut count = ((time - first) / period).floor().max(0.0);
    while count > 0.0 && !is_past(count - 1.0) {
        count -= 1.0;
    }
    while is_past(count) {
        count += 1.0;
    }
    count
}
