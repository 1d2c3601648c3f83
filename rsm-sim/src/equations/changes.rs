//! Comparisons that change inside a step.
//!
//! In: a walk at the end of a step, and a function that moves it to a share of that step. Out: for each lane, the two shares between which the first
//! comparison changes. In most steps all comparisons stay far from their borders; four points of the step are sufficient to show this.

use super::walk::{Walk, larger};
use crate::code::{Work, over_lanes};

/// The number of points, besides the start, at which the comparisons in a step are evaluated.
const POINTS: usize = 8;

/// A comparison is far from its border if its distance is more than this multiple of the cubic term of the distance. A motion that is invisible at
/// all four points would have to be twice as large as the cubic term.
const FAR: f64 = 2.0;

/// The rounding error of a distance, as a share of the largest distance: that of a dozen operations.
const ROUNDED: f64 = 16.0 * f64::EPSILON;

impl<const L: usize> Walk<'_, L> {
    /// Finds where a comparison changes inside a step. Returns a share before the change and a share after it. `place` moves the walk to a share; at
    /// the call the walk is at the end of the step. The comparisons are evaluated at the end and at [`POINTS`] points. Where a distance has its
    /// minimum between three of these points, they are also evaluated at the vertex of the parabola through the three. A lane whose comparisons stay
    /// far from their borders has no change.
    pub(super) fn changes_inside(
        &mut self,
        asked: [bool; L],
        place: &mut dyn FnMut(&mut Self, f64),
    ) -> [Option<(f64, f64)>; L] {
        let mut found = [None; L];
        let far = self.stay_far(place);
        let far: [bool; L] = std::array::from_fn(|lane| far[lane] || !asked[lane]);
        if far == [true; L] {
            return found;
        }
        let count = self.programs.counts.held;
        let mut distances: Vec<[f64; L]> = Vec::with_capacity((POINTS + 1) * count);
        for look in 0..=POINTS {
            let share = look as f64 / POINTS as f64;
            place(self, share);
            let differ = self.sides_differ();
            for lane in (0..L).filter(|lane| look > 0 && differ[*lane] && !far[*lane]) {
                found[lane] = found[lane].or(Some((share - 1.0 / POINTS as f64, share)));
            }
            distances.extend((0..count).map(|k| self.distance(k).map(f64::abs)));
        }
        for look in 1..POINTS {
            for k in 0..count {
                let at = |look: usize, lane: usize| distances[look * count + k][lane];
                for (lane, found) in found.iter_mut().enumerate().filter(|it| it.1.is_none() && !far[it.0]) {
                    let (a, b, c) = (at(look - 1, lane), at(look, lane), at(look + 1, lane));
                    if b <= a && b <= c && a + c > 2.0 * b {
                        let share = (look as f64 + 0.5 * (a - c) / (a - 2.0 * b + c)) / POINTS as f64;
                        place(self, share);
                        if self.sides_differ()[lane] {
                            *found = Some(((look - 1) as f64 / POINTS as f64, share));
                        }
                    }
                }
            }
        }
        found
    }

    /// For each lane, whether every comparison stays far from its border, judged by its distances at the start, an eighth, the middle and the end of
    /// a step.
    fn stay_far(&mut self, place: &mut dyn FnMut(&mut Self, f64)) -> [bool; L] {
        let count = self.programs.counts.held;
        let mut far = self.sides_differ().map(|differs| !differs);
        if far == [false; L] {
            return far;
        }
        let mut distances = std::mem::take(&mut self.distances);
        distances.clear();
        distances.extend((0..count).map(|k| self.distance(k)));
        for share in [0.0, 1.0 / POINTS as f64, 0.5] {
            place(self, share);
            let differ = self.sides_differ();
            (0..L).for_each(|lane| far[lane] &= share == 0.0 || !differ[lane]);
            distances.extend((0..count).map(|k| self.distance(k)));
        }
        let away = over_lanes::<L, _>(StayAway { distances: &distances, count });
        self.distances = distances;
        std::array::from_fn(|lane| far[lane] && away[lane])
    }

    /// The signed distance of a comparison from its border in each lane, at the last evaluation of the sides.
    fn distance(&self, comparison: usize) -> [f64; L] {
        let begin = self.programs.sides.as_ref().map_or(0, |it| it.results as usize) + 2 * comparison;
        let (left, right) = (self.slots[begin], self.slots[begin + 1]);
        std::array::from_fn(|lane| left[lane] - right[lane])
    }
}

/// Whether all distances stay far from 0 over a step, judged by their values at the end, the start, an eighth and the middle: one list after the
/// other. The cubic through these points (Newton's divided differences) must keep its sign at all eighths of the step. Its smallest magnitude there
/// must exceed the possible bend between two eighths plus [`FAR`] times the cubic term. Distances that are not finite do not stay far from 0.
struct StayAway<'a, const L: usize> {
    distances: &'a [[f64; L]],
    /// The number of distances at each point.
    count: usize,
}

impl<const L: usize> Work for StayAway<'_, L> {
    type Found = [bool; L];

    #[inline(always)]
    fn run(self) -> [bool; L] {
        let list = |place: usize| &self.distances[place * self.count..(place + 1) * self.count];
        let [ends, starts, eighths, middles] = std::array::from_fn(list);
        // As whole words, comparisons of lanes are vector instructions.
        let mut near = [0_u64; L];
        for ((end, start), (eighth, middle)) in ends.iter().zip(starts).zip(eighths.iter().zip(middles)) {
            for lane in 0..L {
                near[lane] |= u64::from(!stays_away([start[lane], eighth[lane], middle[lane], end[lane]]));
            }
        }
        near.map(|it| it == 0)
    }
}

/// The same for one distance at the start, an eighth, the middle and the end.
#[inline(always)]
fn stays_away(distances: [f64; 4]) -> bool {
    let [start, eighth, middle, end] = distances;
    let first = [8.0 * (eighth - start), (middle - eighth) / 0.375, 2.0 * (end - middle)];
    let second = [2.0 * (first[1] - first[0]), (first[2] - first[1]) / 0.875];
    let third = second[1] - second[0];
    let (mut least, mut most) = (start, start);
    for look in 1..=POINTS {
        let s = look as f64 / POINTS as f64;
        let value = start + s * (first[0] + (s - 0.125) * (second[0] + (s - 0.5) * third));
        least = if value < least { value } else { least };
        most = larger(value, most);
    }
    // The second derivative is 2 second + (6 s - 1.25) third. Between two points at a distance h, a curve differs from its chord by at most h^2/8
    // times the second derivative.
    let bend = (2.0 * second[0].abs() + 4.75 * third.abs()) / (8.0 * (POINTS * POINTS) as f64);
    // s (s - 1/8) (s - 1/2) is at most 7/16.
    let beyond = FAR * 0.4375 * third.abs() + bend + ROUNDED * larger(most.abs(), least.abs());
    let nearest = larger(least, -most);
    // The product of zero and a number that is not finite is NaN.
    let zero = 0.0 * start + 0.0 * eighth + 0.0 * middle + 0.0 * end;
    (zero == 0.0) & (nearest > beyond)
}

#[cfg(test)]
mod tests {
    use super::stays_away;

    /// A distance at the four points of a step.
    fn at_places(distance: impl Fn(f64) -> f64) -> [f64; 4] {
        [0.0, 0.125, 0.5, 1.0].map(distance)
    }

    #[test]
    fn a_distance_that_moves_far_from_its_border_stays_away() {
        // A long motion that ends before the border, and parabolas with a vertex before the border, on both sides.
        for sign in [1.0, -1.0] {
            assert!(stays_away(at_places(|s| sign * (1.0 - 0.99 * s))));
            assert!(stays_away(at_places(|s| sign * (0.1 + (s - 0.7) * (s - 0.7)))));
            assert!(stays_away(at_places(|s| sign * (2.0 + (2.0 * s).sin()))));
        }
    }

    #[test]
    fn a_distance_that_reaches_its_border_does_not() {
        // It crosses; it touches; it crosses twice between points; it is always at the border; its cubic term is larger than its smallest value; it
        // is NaN at some points.
        for distance in [
            |s: f64| 0.5 - s,
            |s: f64| (s - 0.75) * (s - 0.75),
            |s: f64| (s - 0.7) * (s - 0.8),
            |_: f64| 0.0,
            |s: f64| 0.5 + 0.4 * (12.0 * s).sin(),
            |s: f64| (s - 0.5).ln(),
        ] {
            for sign in [1.0, -1.0] {
                let places = at_places(|s| sign * distance(s));
                assert!(!stays_away(places), "{places:?}");
            }
        }
    }

    #[test]
    fn no_polynomial_of_order_three_that_stays_away_has_a_root_in_the_step() {
        // Coefficients from a Weyl sequence: all signs, and borders near and far.
        let mut far = 0;
        for k in 1..=20_000 {
            let of = |step: f64| 2.0 * (f64::from(k) * step).fract() - 1.0;
            let [a, b, c, d] = [2.0_f64, 3.0, 5.0, 7.0].map(|prime| of(prime.sqrt()));
            let distance = |s: f64| 0.6 * a + s * (b + s * (c + s * d));
            if stays_away(at_places(distance)) {
                far += 1;
                let first = distance(0.0) > 0.0;
                assert!((0..=1000).all(|look| (distance(f64::from(look) / 1000.0) > 0.0) == first), "{a} {b} {c} {d}");
            }
        }
        // The function returns both answers often.
        assert!((2_000..18_000).contains(&far), "{far}");
    }
}
