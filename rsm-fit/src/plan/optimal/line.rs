//! Polynomials of one variable on an interval.
//!
//! In: coefficients, the lowest first. Out: values, the zeros of a polynomial, the maximum of a quotient of two, all inside the interval.

/// The value.
pub(super) fn value(p: &[f64], t: f64) -> f64 {
    p.iter().rev().fold(0.0, |sum, c| sum * t + c)
}

fn derivative(p: &[f64]) -> Vec<f64> {
    p.iter().enumerate().skip(1).map(|(k, c)| k as f64 * c).collect()
}

fn product(p: &[f64], q: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; (p.len() + q.len()).saturating_sub(1)];
    for (i, a) in p.iter().enumerate() {
        for (j, b) in q.iter().enumerate() {
            out[i + j] += a * b;
        }
    }
    out
}

/// The sign changes of a polynomial inside the interval, ascending. Between neighbouring sign changes of its derivative it is monotone.
pub(super) fn sign_changes(p: &[f64], low: f64, high: f64) -> Vec<f64> {
    let mut p = p;
    while let [rest @ .., last] = p
        && *last == 0.0
    {
        p = rest;
    }
    match p {
        [] | [_] => Vec::new(),
        [a, b] => {
            let root = -a / b;
            if root > low && root < high { vec![root] } else { Vec::new() }
        }
        _ => {
            let mut places = vec![low];
            places.extend(sign_changes(&derivative(p), low, high));
            places.push(high);
            places.windows(2).filter_map(|ends| crossing(p, ends[0], ends[1])).collect()
        }
    }
}

/// The zero of a polynomial that is monotone between two points and has different signs there.
fn crossing(p: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let (at_low, at_high) = (value(p, low), value(p, high));
    if at_low == 0.0 || at_high == 0.0 || (at_low > 0.0) == (at_high > 0.0) {
        return None;
    }
    let slope = derivative(p);
    let mut t = 0.5 * (low + high);
    // Newton's method; a step outside the interval is replaced by bisection. 60 bisections reach the last bit of any interval.
    for _ in 0..60 {
        let now = value(p, t);
        if now == 0.0 {
            break;
        }
        if (now > 0.0) == (at_low > 0.0) {
            low = t;
        } else {
            high = t;
        }
        let newton = t - now / value(&slope, t);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        // A step of 1e-14 of the interval does not change the criterion, which is flat there.
        if (next - t).abs() <= 1e-14 * (1.0 + t.abs()) {
            t = next;
            break;
        }
        t = next;
    }
    Some(t)
}

/// The objective along a line: `top`/`bottom`, or `top` alone.
#[derive(Debug)]
pub(super) struct Quotient {
    pub top: Vec<f64>,
    /// Positive where the quotient is defined.
    pub bottom: Option<Vec<f64>>,
    /// The quotient counts as undefined if `bottom` is below this.
    pub least: f64,
}

impl Quotient {
    /// Its value; `None` if it is undefined.
    pub(super) fn value(&self, t: f64) -> Option<f64> {
        let top = value(&self.top, t);
        match &self.bottom {
            None => Some(top),
            Some(bottom) => {
                let bottom = value(bottom, t);
                (bottom > self.least).then(|| top / bottom)
            }
        }
    }

    /// The point of the largest value between two ends, and the value.
    pub(super) fn largest(&self, low: f64, high: f64) -> Option<(f64, f64)> {
        let slope = match &self.bottom {
            None => derivative(&self.top),
            Some(bottom) => {
                let mut slope = product(&derivative(&self.top), bottom);
                for (to, from) in slope.iter_mut().zip(product(&self.top, &derivative(bottom))) {
                    *to -= from;
                }
                slope
            }
        };
        let mut places = vec![low, high];
        places.extend(sign_changes(&slope, low, high));
        self.largest_of(&places)
    }

    /// The same among given points.
    pub(super) fn largest_of(&self, places: &[f64]) -> Option<(f64, f64)> {
        let mut best: Option<(f64, f64)> = None;
        for t in places {
            if let Some(found) = self.value(*t)
                && best.is_none_or(|(_, most)| found > most)
            {
                best = Some((*t, found));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sign_changes_of_a_product_of_factors_are_its_zeros() {
        // (t + 0.5)(t - 0.25)(t - 0.75)(t^2 + 1): three real zeros.
        let p = [[0.5, 1.0], [-0.25, 1.0], [-0.75, 1.0]].iter().fold(vec![1.0, 0.0, 1.0], |p, q| product(&p, q));
        let found = sign_changes(&p, -1.0, 1.0);
        assert_eq!(found.len(), 3);
        for (found, zero) in found.iter().zip([-0.5, 0.25, 0.75]) {
            // The zeros are simple and 0.5 apart: the rounding of the coefficients over the slope.
            assert!((found - zero).abs() < 1e-14);
        }
        assert_eq!(sign_changes(&p, 0.3, 0.7).len(), 0);
        assert_eq!(sign_changes(&[0.0, 0.0], -1.0, 1.0).len(), 0);
        assert_eq!(sign_changes(&[0.5, 1.0, 0.0], -1.0, 1.0), [-0.5]);
    }

    #[test]
    fn the_largest_quotient_is_found_inside_and_at_the_ends() {
        let hill = Quotient { top: vec![1.0, 0.0, -1.0], bottom: None, least: 0.0 };
        assert_eq!(hill.largest(-1.0, 1.0), Some((0.0, 1.0)));
        assert_eq!(hill.largest(0.5, 1.0), Some((0.5, 0.75)));
        // t/(1 + t^2) is largest at 1; below 1e-3 the bottom does not count.
        let bent = Quotient { top: vec![0.0, 1.0], bottom: Some(vec![1.0, 0.0, 1.0]), least: 1e-3 };
        assert_eq!(bent.largest(0.0, 3.0).map(|(t, value)| ((t * 1e12).round() / 1e12, value)), Some((1.0, 0.5)));
        assert_eq!(Quotient { top: vec![1.0], bottom: Some(vec![-1.0]), least: 0.0 }.largest(0.0, 1.0), None);
    }
}
