//! Desirabilities of Derringer and Suich.
//!
//! In: a goal and the value of a response. Out: its desirability from 0 to 1, and minus its logarithm as the largest of smooth pieces.
//!
//! ```text
//! maximise   d = 0 up to low, ((y - low)/(high - low))^weight, 1 from high on
//! minimise   d = 1 up to low, ((high - y)/(high - low))^weight, 0 from high on
//! target     d = ((y - low)/(target - low))^s below the target, ((high - y)/(high - target))^t above it, 0 outside low to high
//! range      d = 1 from low to high, else 0
//! all        D = (product of d^importance)^(1/sum of importances)
//! ```
//!
//! Source: Derringer, Suich 1980, Journal of Quality Technology 12, 214 to 219, importances: Derringer 1994, Quality Progress
//! 27(6), 51 to 58.

use super::pieces::Piece;

/// What a response shall be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// As large as possible.
    Maximise {
        /// Up to here it is not acceptable.
        low: f64,
        /// From here on, more gives no advantage.
        high: f64,
        /// The exponent: above 1, values near `high` count more.
        weight: f64,
    },
    /// As small as possible.
    Minimise {
        /// Down to here, less gives no advantage.
        low: f64,
        /// From here on it is not acceptable.
        high: f64,
        /// The exponent.
        weight: f64,
    },
    /// Near a value.
    Target {
        /// Up to here it is not acceptable.
        low: f64,
        /// The best value.
        target: f64,
        /// From here on it is not acceptable.
        high: f64,
        /// The exponents below and above the target.
        weights: [f64; 2],
    },
    /// Anywhere between two values.
    InRange {
        /// The lowest value, if there is one.
        low: Option<f64>,
        /// The highest value, if there is one.
        high: Option<f64>,
    },
}

impl Goal {
    /// Its name in the file.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Goal::Maximise { .. } => "maximise",
            Goal::Minimise { .. } => "minimise",
            Goal::Target { .. } => "target",
            Goal::InRange { .. } => "range",
        }
    }

    /// Whether it has a best value or direction; a range has none.
    #[must_use]
    pub fn is_objective(&self) -> bool {
        !matches!(self, Goal::InRange { .. })
    }

    /// The desirability of a value.
    ///
    /// ```
    /// use rsm_fit::optimise::Goal;
    ///
    /// let goal = Goal::Target { low: 400.0, target: 500.0, high: 600.0, weights: [1.0, 1.0] };
    /// assert_eq!([350.0, 450.0, 500.0, 575.0].map(|y| goal.desirability(y)), [0.0, 0.5, 1.0, 0.25]);
    /// ```
    #[must_use]
    pub fn desirability(&self, y: f64) -> f64 {
        match *self {
            Goal::InRange { low, high } => {
                f64::from(u8::from(low.is_none_or(|low| y >= low) && high.is_none_or(|high| y <= high)))
            }
            _ => self.shares(y).into_iter().map(|share| share.share.clamp(0.0, 1.0).powf(share.weight)).fold(1.0, f64::min),
        }
    }

    /// The shares of the way from the bounds to the best value.
    fn shares(&self, y: f64) -> Vec<Share> {
        let of = |from: f64, to: f64, weight: f64| Share { share: (y - from) / (to - from), slope: 1.0 / (to - from), weight };
        match *self {
            Goal::Maximise { low, high, weight } => vec![of(low, high, weight)],
            Goal::Minimise { low, high, weight } => vec![of(high, low, weight)],
            Goal::Target { low, target, high, weights } => vec![of(low, target, weights[0]), of(high, target, weights[1])],
            Goal::InRange { .. } => Vec::new(),
        }
    }

    /// -ln d as the largest of pieces. Below `least` of the way the logarithm goes on along its tangent: there a desirability of 0 has a gradient
    /// towards the acceptable values.
    pub(super) fn pieces(&self, response: &Piece, least: f64) -> Vec<Piece> {
        let none = Piece { value: 0.0, gradient: vec![0.0; response.gradient.len()] };
        let of_share = |it: Share| {
            let (log, slope) = if it.share > least {
                (it.share.ln(), 1.0 / it.share)
            } else {
                (least.ln() + (it.share - least) / least, 1.0 / least)
            };
            let factor = -it.weight * slope * it.slope;
            Piece { value: -it.weight * log, gradient: response.gradient.iter().map(|g| factor * g).collect() }
        };
        std::iter::once(none).chain(self.shares(response.value).into_iter().map(of_share)).collect()
    }

    /// The loss of a value, for a front: less is better.
    pub(super) fn losses(&self, response: &Piece) -> Vec<Piece> {
        let signed = |sign: f64, from: f64| Piece {
            value: sign * (response.value - from),
            gradient: response.gradient.iter().map(|g| sign * g).collect(),
        };
        match *self {
            Goal::Maximise { .. } => vec![signed(-1.0, 0.0)],
            Goal::Minimise { .. } => vec![signed(1.0, 0.0)],
            Goal::Target { target, .. } => vec![signed(1.0, target), signed(-1.0, target)],
            Goal::InRange { .. } => Vec::new(),
        }
    }

    /// The loss of a value: its largest piece.
    pub(super) fn loss(&self, y: f64) -> f64 {
        let pieces = self.losses(&Piece { value: y, gradient: Vec::new() });
        pieces.iter().map(|piece| piece.value).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// A share of the way from a bound to the best value, with its derivative by the response and its exponent.
struct Share {
    share: f64,
    slope: f64,
    weight: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn desirabilities_are_those_of_hand_and_of_their_pieces() {
        let goals = [
            Goal::Maximise { low: 10.0, high: 20.0, weight: 2.0 },
            Goal::Minimise { low: 10.0, high: 20.0, weight: 0.5 },
            Goal::Target { low: 10.0, target: 12.0, high: 20.0, weights: [1.0, 2.0] },
        ];
        // At 14: 0.4^2, 0.6^0.5, 0.75^2.
        for (goal, expected) in goals.iter().zip([0.16, 0.6f64.sqrt(), 0.5625]) {
            assert!((goal.desirability(14.0) - expected).abs() < 1e-15);
            for y in [11.0, 12.0, 14.0, 19.5] {
                let response = Piece { value: y, gradient: vec![1.0] };
                let value = |y: f64| {
                    let pieces = goal.pieces(&Piece { value: y, gradient: vec![1.0] }, 1e-6);
                    pieces.iter().map(|piece| piece.value).fold(f64::NEG_INFINITY, f64::max)
                };
                assert!((value(y) + goal.desirability(y).ln()).abs() < 1e-14, "{goal:?} {y}");
                let pieces = goal.pieces(&response, 1e-6);
                let largest = pieces.iter().max_by(|a, b| a.value.total_cmp(&b.value)).unwrap();
                if y != 12.0 {
                    // Central differences with a step of 1e-5: errors of 1e-9.
                    let slope = (value(y + 1e-5) - value(y - 1e-5)) / 2e-5;
                    assert!((largest.gradient[0] - slope).abs() < 1e-7, "{goal:?} {y}");
                }
            }
        }
        assert_eq!(goals.map(|goal| goal.desirability(9.0)), [0.0, 1.0, 0.0]);
        assert_eq!(goals.map(|goal| goal.desirability(20.0)), [1.0, 0.0, 0.0]);
        let range = Goal::InRange { low: Some(1.0), high: None };
        assert_eq!([0.5, 1.0, 7.0].map(|y| range.desirability(y)), [0.0, 1.0, 1.0]);
        assert_eq!(goals.map(|goal| goal.loss(13.0)), [-13.0, 13.0, 1.0]);
    }
}
