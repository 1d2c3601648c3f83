//! Hinges as bends: where a response has a kink, as in multivariate adaptive regression splines (J. Friedman, Annals of Statistics 19, 1991).
//!
//! In: the search of bends ([`bends`](super::bends)). Out: its answers for hinges, max(0, x - x_knot), which have a place and no width.

use rsm_core::model::{Knot, Surface};

use super::bends::{Kind, Place, Rows, Search, Side, Step, rounded};
use crate::design;

/// The largest move of a place in one step, as a share of the range. The derivative with respect to a place changes at every row that the place
/// passes, so a longer step leaves the linear approximation.
const LONGEST_MOVE: f64 = 0.1;

/// A place keeps this distance to the ends of the range, as a share of it: a narrower kink is a jump at the end. Readings that are closer to each
/// other are one value.
const INSIDE: f64 = 1e-3;

/// The probability with which a run of errors of one sign at an end may pass for a kink, in the number of rows that an end must have (Friedman's
/// equation 45, with his value).
const BY_CHANCE: f64 = 0.05;

/// Hinges. The second number of a place is not used.
pub(super) struct Hinges;

impl Hinges {
    /// The readings that must be on each side of a place: one for each term of the hinge, which is 0 on one side of it, and not fewer than Friedman's
    /// 3 - log2(0.05/inputs), so that a few large errors at an end do not look like a kink.
    fn least_rows(search: &Search<'_, Self>, input: usize, order: u32) -> usize {
        let one = [Step { input, place: [0.5, 0.0] }];
        let hinge = search.surface.inputs.len() + search.surface.knots.len();
        let terms = search.terms(&one, order).iter().filter(|powers| powers[hinge] > 0).count();
        let of_errors = 3.0 - (BY_CHANCE / search.open.len() as f64).log2();
        terms.max(of_errors.ceil() as usize)
    }
}

/// Whether an interval above `low` up to `high` has `least` readings, and `order` or more values that are at least `apart` from each other: a hinge
/// times powers up to order - 1 is a polynomial with `order` coefficients there. Readings of one level differ by noise, and are one value.
fn has_enough(sorted: &[f64], [low, high]: [f64; 2], [least, order]: [usize; 2], apart: f64) -> bool {
    let first = sorted.partition_point(|xi| *xi <= low);
    let within = &sorted[first..sorted.partition_point(|xi| *xi <= high).max(first)];
    let (mut values, mut last) = (0, f64::NEG_INFINITY);
    for xi in within.iter().filter(|_| within.len() >= least) {
        if values == order {
            break;
        }
        if *xi >= last + apart {
            (values, last) = (values + 1, *xi);
        }
    }
    within.len() >= least && values == order
}

impl Kind for Hinges {
    type Bend = Knot;
    const NUMBERS: usize = 1;
    /// A place is looked for among all readings, so it fits noise as three coefficients do (Friedman 1991, section 3.6).
    const COUNTED: usize = 3;
    /// A candidate has no width, so there are fewer candidates for each place than with sigmoids, and more places.
    const CENTRES: usize = 21;

    /// All orders: the place of a kink between two straight lines is known much better than that between two curves, so the order matters.
    fn orders(highest: u32) -> Vec<u32> {
        (1..=highest).collect()
    }

    fn terms(surface: &Surface, bends: &[&str], order: u32) -> Vec<Vec<u32>> {
        let mut with = surface.clone();
        with.knots.extend(bends.iter().map(|input| Knot { input: (*input).to_string(), at: 0.0 }));
        design::terms_with_hinges(&with, bends.len(), order)
    }

    fn values(side: &Side, place: Place, xi: &[f64]) -> Vec<f64> {
        xi.iter().map(|xi| ((xi - side.low) / side.span - place[0]).max(0.0)).collect()
    }

    /// The lowest and the highest place.
    fn limits(_: &Search<'_, Self>, _: &Rows, _: usize, _: u32) -> [f64; 2] {
        [INSIDE, 1.0 - INSIDE]
    }

    fn starts(centres: &[f64], [low, high]: [f64; 2]) -> Vec<Place> {
        centres.iter().filter(|centre| low <= **centre && **centre <= high).map(|centre| [*centre, 0.0]).collect()
    }

    fn moved(place: Place, by: &[f64], [low, high]: [f64; 2]) -> Place {
        [(place[0] + by[0].clamp(-LONGEST_MOVE, LONGEST_MOVE)).clamp(low, high), 0.0]
    }

    /// Whether there are enough readings between neighbouring places, those of given knots too, and beyond the outermost ones.
    fn is_determined(search: &Search<'_, Self>, rows: &Rows, steps: &[Step], order: u32) -> bool {
        search.open.iter().filter(|input| steps.iter().any(|step| step.input == **input)).all(|input| {
            let (side, name) = (search.side(*input), &search.inputs[*input].name);
            let given = search.surface.knots.iter().filter(|knot| knot.input == *name).map(|knot| knot.at);
            let found = steps.iter().filter(|step| step.input == *input).map(|step| side.low + step.place[0] * side.span);
            let mut ends: Vec<f64> = given.chain(found).chain([f64::NEG_INFINITY, f64::INFINITY]).collect();
            ends.sort_by(f64::total_cmp);
            let least = [Self::least_rows(search, *input, order), order as usize];
            let apart = INSIDE * side.span;
            ends.windows(2).all(|pair| has_enough(&rows.sorted[*input], [pair[0], pair[1]], least, apart))
        })
    }

    /// Rounds to 10^-5 of the range or finer. The response changes there by 10^-5 of the change of slope times the range, far below errors of
    /// readings.
    fn bend(input: &str, side: &Side, place: Place) -> Knot {
        let unit = 10f64.powi((side.span.log10() - 5.0).floor() as i32);
        Knot { input: input.to_string(), at: rounded(side.low + place[0] * side.span, unit) }
    }

    fn place(bend: &Knot, side: &dyn Fn(&str) -> Option<(usize, Side)>) -> Option<Step> {
        let (input, side) = side(&bend.input)?;
        Some(Step { input, place: [(bend.at - side.low) / side.span, 0.0] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_at_a_place_count_below_it_and_near_ones_as_one_value() {
        let sorted = [0.0, 1.0, 1.001, 2.0, 3.0];
        let has = |low, high, least| has_enough(&sorted, [low, high], least, 0.01);
        assert!(has(f64::NEG_INFINITY, 1.001, [3, 2]));
        assert!(!has(f64::NEG_INFINITY, 1.001, [4, 2]));
        assert!(!has(f64::NEG_INFINITY, 1.001, [3, 3]));
        assert!(has(1.001, f64::INFINITY, [2, 2]));
        assert!(!has(1.001, f64::INFINITY, [3, 1]));
        assert!(!has(3.0, f64::INFINITY, [1, 1]));
    }

    #[test]
    fn a_place_has_six_digits_of_the_range() {
        let side = Side { low: -200.0, span: 1000.0, is_symmetric: false };
        let bend = Hinges::bend("a", &side, [0.123_456_789, 0.0]);
        assert_eq!(bend.at, -76.54);
        let back = Hinges::place(&bend, &|_| Some((0, side))).unwrap();
        // Half a unit of 10^-2 as a share of the range.
        assert!((back.place[0] - 0.123_456_789).abs() <= 0.5e-5, "{back:?}");
    }
}
