//! Piecewise linear functions of time.
//!
//! In: points and sample instants. Out: one value for each row. Independent of the plant.

/// A piecewise linear function through points (time in s, value). Before the first and after the last point it is constant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Path {
    points: Vec<(f64, f64)>,
}

impl Path {
    /// A path that begins at a value.
    #[must_use]
    pub(super) fn from(value: f64) -> Self {
        Path { points: vec![(0.0, value)] }
    }

    /// The instant of the last point, in s.
    #[must_use]
    pub(super) fn end(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.0)
    }

    /// The value of the last point.
    #[must_use]
    pub(super) fn last(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.1)
    }

    /// Adds a straight line to a value.
    pub(super) fn line_to(&mut self, value: f64, seconds: f64) {
        self.points.push((self.end() + seconds.max(0.0), value));
    }

    /// Adds a constant part.
    pub(super) fn hold(&mut self, seconds: f64) {
        self.line_to(self.last(), seconds);
    }

    /// The values at rows, and their slopes per second. At a corner the slope is that of the following part.
    #[must_use]
    pub(super) fn sampled(&self, rows: usize, period: f64) -> (Vec<f64>, Vec<f64>) {
        let mut values = Vec::with_capacity(rows);
        let mut slopes = Vec::with_capacity(rows);
        let mut place = 0;
        for row in 0..rows {
            let time = row as f64 * period;
            while place + 1 < self.points.len() && self.points[place + 1].0 <= time {
                place += 1;
            }
            let (start, value) = self.points[place];
            let slope = self.points.get(place + 1).map_or(0.0, |(end, next)| (next - value) / (end - start));
            values.push(value + slope * (time - start));
            slopes.push(slope);
        }
        (values, slopes)
    }
}

/// A sequence of +1 and -1 that changes at pseudo-random multiples of `hold` rows: the maximum-length sequence of a shift register of nine bits
/// (x^9 + x^5 + 1; S. W. Golomb, 1967). Its spectrum is flat up to 0.44/hold.
#[must_use]
pub(super) fn binary(rows: usize, hold: usize, skip: usize) -> Vec<f64> {
    let mut state = 0b1_0110_1001_u32;
    let mut bit = || {
        let next = (state ^ (state >> 4)) & 1;
        state = (state >> 1) | (next << 8);
        if state & 1 == 1 { 1.0 } else { -1.0 }
    };
    (0..skip).for_each(|_| {
        bit();
    });
    let mut values = Vec::with_capacity(rows);
    while values.len() < rows {
        let value = bit();
        values.extend(std::iter::repeat_n(value, hold.max(1)));
    }
    values.truncate(rows);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_straight_between_its_points() {
        let mut path = Path::from(1.0);
        path.hold(0.2);
        path.line_to(3.0, 0.4);
        let (values, slopes) = path.sampled(8, 0.1);
        let wanted = [1.0, 1.0, 1.0, 1.5, 2.0, 2.5, 3.0, 3.0];
        // Decimals of the instants are rounded.
        assert!(values.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{values:?}");
        assert!((slopes[3] - 5.0).abs() < 1e-9 && slopes[0] == 0.0 && slopes[7] == 0.0, "{slopes:?}");
    }

    #[test]
    fn the_register_goes_through_all_its_states() {
        let values = binary(1022, 1, 0);
        assert_eq!(values[..511], values[511..]);
        // A maximum-length sequence of 511 has one more of one sign: no shorter period has that sum.
        assert_eq!(values[..511].iter().sum::<f64>().abs(), 1.0);
        assert!((1..511).all(|shift| values[..511] != values[shift..shift + 511]));
    }
}
