//! Tests of coefficients, cells and searches against exact rationals.

use super::*;
use crate::adversary::Random;
use crate::number::{Precision, Rational, exact, integer};

mod cuts;

const WHOLE_BOX: Search<'_> = Search { place: &|_| Place::Inside, spaces: &[], finest: 1.0, enough: f64::INFINITY };

fn range_of(terms: &[Monomial], sides: &[Interval]) -> Interval {
    extent(terms, sides).range
}

fn monomial(powers: &[u32], coefficient: f64) -> Monomial {
    Monomial { powers: powers.to_vec(), coefficient: Interval::point(coefficient) }
}

#[test]
fn a_parabola_has_its_hand_worked_range() {
    // x^2 - x over [0, 2]: the minimum is -1/4 at 1/2, the maximum is 2 at 2.
    let found = range_of(&[monomial(&[2], 1.0), monomial(&[1], -1.0)], &[Interval::new(0.0, 2.0)]);
    assert!(found.low <= -0.25 && found.low > -0.25 - 1e-6, "{found:?}");
    assert!(found.high >= 2.0 && found.high < 2.0 + 1e-12, "{found:?}");
}

#[test]
fn the_places_of_the_extremes_are_found() {
    // x^2 - x over [0, 2]: the minimum is at 1/2, a quarter of the side; the maximum is at the end. The second variable has no influence.
    let terms = [monomial(&[2, 0], 1.0), monomial(&[1, 0], -1.0)];
    let found = extent(&terms, &[Interval::new(0.0, 2.0), Interval::new(0.0, 1.0)]);
    assert!((found.least_at[0] - 0.25).abs() < 1e-4 && found.greatest_at[0] == 1.0, "{found:?}");
}

#[test]
fn two_variables_with_an_inner_saddle() {
    // x y over [-1, 1]^2: from -1 to 1, both at corners.
    let side = Interval::new(-1.0, 1.0);
    let found = range_of(&[monomial(&[1, 1], 1.0)], &[side, side]);
    assert!(found.low <= -1.0 && found.low > -1.0 - 1e-12 && found.high >= 1.0 && found.high < 1.0 + 1e-12);
}

#[test]
fn a_search_leaves_out_what_does_not_belong_to_the_region() {
    // x + y over [0, 1]^2, only where x >= 0.7: the minimum is 0.7 at (0.7, 0). The whole box also has smaller values.
    let terms = [monomial(&[1, 0], 1.0), monomial(&[0, 1], 1.0)];
    let place = |cell: &[[f64; 2]]| match (cell[0][0] >= 0.7, cell[0][1] < 0.7) {
        (true, _) => Place::Inside,
        (_, true) => Place::Outside,
        _ => Place::Partly,
    };
    let side = Interval::new(0.0, 1.0);
    let find = |enough| least(&terms, &[side, side], &Search { place: &place, spaces: &[], finest: 1.0 / 1024.0, enough });
    let found = find(f64::INFINITY);
    // The cell that contains 0.7 counts as inside the region, so the bound may be as low as 0.7 - 1/1024.
    assert!(found.bound > 0.7 - 1.0 / 1024.0 && found.bound <= 0.7 && found.at[1] == 0.0, "{found:?}");
    assert!(find(0.69).bound >= 0.69);
    let too_much = find(0.8);
    assert!(too_much.seen < 0.8 && too_much.bound <= too_much.seen, "{too_much:?}");
    // The polynomial does not depend on the variable that bounds the region.
    let nowhere = |cell: &[[f64; 2]]| if cell[0][0] <= 2.0 { Place::Outside } else { Place::Inside };
    let empty = Search { place: &nowhere, spaces: &[], finest: 0.5, enough: 0.0 };
    let root = Cell::new(&[&[monomial(&[0, 1], -1.0)]], &[side, side]);
    let (found, work) = search_within(&root, &Value, &[], &empty, BUDGET);
    assert_eq!((found.bound, work), (f64::INFINITY, 0));
}

#[test]
fn every_side_of_every_cell_gets_short() {
    // A tilted bowl with values just above 0: (x - y)^2 + (x + y - 1)^2/16 + 10^-6. Its small values are along a diagonal of the box. When sides were
    // halved in turn over all cells, the proof used the whole budget and failed.
    let terms = [
        monomial(&[2, 0], 17.0 / 16.0),
        monomial(&[0, 2], 17.0 / 16.0),
        monomial(&[1, 1], -2.0 + 2.0 / 16.0),
        monomial(&[1, 0], -2.0 / 16.0),
        monomial(&[0, 1], -2.0 / 16.0),
        monomial(&[0, 0], 1.0 / 16.0 + 1e-6),
    ];
    let sides = [Interval::new(-1.0, 1.3), Interval::new(-0.9, 1.2)];
    let found = least(&terms, &sides, &Search { place: &|_| Place::Inside, spaces: &[], finest: 1.0, enough: 0.0 });
    assert!(found.bound >= 0.0, "{found:?}");
}

#[test]
fn a_constant_is_itself() {
    let found = range_of(&[monomial(&[0, 0], 3.5)], &[Interval::new(-1.0, 1.0), Interval::new(0.0, 1.0)]);
    assert_eq!(found, Interval::point(3.5));
}

fn random_terms(random: &mut Random, dimensions: usize, most: u32, count: usize) -> Vec<Monomial> {
    (0..count)
        .map(|_| {
            let powers: Vec<u32> = (0..dimensions).map(|_| random.below(most as usize + 1) as u32).collect();
            monomial(&powers, random.between(-2.0, 2.0))
        })
        .collect()
}

fn random_side(random: &mut Random) -> Interval {
    let low = random.between(-2.0, 2.0);
    Interval::new(low, low + random.between(0.1, 3.0))
}

/// The exact value of the polynomial; every coefficient is a number.
fn value(terms: &[Monomial], at: &[Rational]) -> Rational {
    let of_term = |term: &Monomial| {
        let powers = term.powers.iter().zip(at).map(|(power, x)| crate::number::power(x, *power));
        powers.fold(exact(term.coefficient.low), |product, power| product * power)
    };
    terms.iter().map(of_term).fold(integer(0), |sum, term| sum + term)
}

/// The point at these shares of the sides.
fn place(sides: &[Interval], shares: &[f64]) -> Vec<Rational> {
    let of_side = |(side, share): (&Interval, &f64)| exact(side.low) + (exact(side.high) - exact(side.low)) * exact(*share);
    sides.iter().zip(shares).map(of_side).collect()
}

fn choose(n: usize, k: usize) -> Rational {
    (0..k).fold(integer(1), |product, j| product * integer((n - j) as i64) / integer(j as i64 + 1))
}

fn is_held(found: Interval, truth: &Rational) -> bool {
    exact(found.low) <= *truth && *truth <= exact(found.high)
}

#[test]
fn one_power_has_its_exact_coefficients() {
    // t^j over [0, 1] has b_i = C(i, j)/C(n, j). Of the coefficients only the first one that is not zero is tested with several hundred multiples of
    // t^j: it is a product with a rounded inverse, without any other rounding. Degrees go up to 40: the hinge of a power of 20 times a power of 20.
    let mut random = Random(1);
    for n in (1..=20usize).chain([27, 33, 40]) {
        for j in 0..=n {
            for round in 0..12 {
                let multiple = random.between(1.0, 2.0);
                let mut line = vec![Interval::point(0.0); n + 1];
                line[j] = Interval::point(multiple);
                to_bernstein(&mut line, Interval::new(0.0, 1.0));
                // In the first round all coefficients are tested, in the others only the first one that is not zero.
                for (i, found) in
                    line.iter().enumerate().take(if round == 0 { n + 1 } else { j + 1 }).skip(if round == 0 { 0 } else { j })
                {
                    let truth = if i < j { integer(0) } else { exact(multiple) * choose(i, j) / choose(n, j) };
                    assert!(is_held(*found, &truth), "{multiple} t^{j} of degree {n}, coefficient {i}: {found:?}");
                    // 2^-52 for each operation: an inverse, a product and n sums of increasing size.
                    let width = found.high - found.low;
                    assert!(width <= (n as f64 + 4.0) * 4.0 * f64::EPSILON * found.magnitude(), "{found:?}");
                    assert!(j > 0 || found.low == multiple && found.high == multiple, "a constant is exact: {found:?}");
                }
            }
        }
    }
}

#[test]
fn the_coefficients_of_any_line_are_held() {
    // By the binomial theorem: a_k x^k with x = low + w t contains C(k, j) low^(k - j) w^j t^j.
    let mut random = Random(2);
    for _ in 0..50 {
        let n = 1 + random.below(9);
        let side = random_side(&mut random);
        let powers: Vec<f64> = (0..=n).map(|_| random.between(-1.0, 1.0)).collect();
        let mut line: Vec<Interval> = powers.iter().map(|a| Interval::point(*a)).collect();
        to_bernstein(&mut line, side);
        let (low, width) = (exact(side.low), exact(side.high) - exact(side.low));
        let of_power = |j: usize| {
            (j..=n).fold(integer(0), |sum, k| {
                sum + exact(powers[k])
                    * choose(k, j)
                    * crate::number::power(&low, (k - j) as u32)
                    * crate::number::power(&width, j as u32)
            })
        };
        for (i, found) in line.iter().enumerate() {
            let truth = (0..=i).fold(integer(0), |sum, j| sum + choose(i, j) / choose(n, j) * of_power(j));
            assert!(is_held(*found, &truth), "{powers:?} over {side:?}, coefficient {i}: {found:?}");
            // The magnitudes of partial sums are at most sum |a_k| (|low| + w)^k.
            let reach = side.low.abs() + side.width();
            let size: f64 = powers.iter().enumerate().map(|(k, a)| a.abs() * reach.powi(k as i32)).sum();
            assert!(found.width() <= 100.0 * f64::EPSILON * size, "{found:?} of {size}");
        }
    }
}

#[test]
fn a_width_that_no_f64_holds_is_enclosed() {
    // x over [low, high], where the rounding error of high - low is far larger than high itself.
    let mut random = Random(7);
    for _ in 0..100 {
        let (low, high) = (-random.between(1.0, 2.0), random.between(1.0, 2.0) * 2f64.powi(-20 - random.below(60) as i32));
        for (low, high) in [(low, high), (-high, -low)] {
            let mut line = [Interval::point(0.0), Interval::point(1.0)];
            to_bernstein(&mut line, Interval::new(low, high));
            assert!(is_held(line[0], &exact(low)) && is_held(line[1], &exact(high)), "{line:?} over {low} {high}");
        }
    }
}

#[test]
fn both_halves_have_the_coefficients_of_the_same_polynomial() {
    let mut random = Random(3);
    for _ in 0..40 {
        let dimensions = 1 + random.below(3);
        let terms = random_terms(&mut random, dimensions, 3, 5);
        let sides: Vec<Interval> = (0..dimensions).map(|_| random_side(&mut random)).collect();
        let mut cell = Cell::new(&[&terms[..]], &sides);
        for _ in 0..4 {
            let axis = random.below(dimensions);
            let (left, right) = cell.halved(axis);
            cell = if random.chance(2) { left } else { right };
            // Coefficients at corners are values; all coefficients enclose every value of the cell.
            let whole = cell.bounds();
            for corner in 0..1usize << dimensions {
                let shares: Vec<f64> = cell.spans.iter().enumerate().map(|(k, span)| span[corner >> k & 1]).collect();
                let truth = value(&terms, &place(&sides, &shares));
                let index = (0..dimensions)
                    .fold(0, |index, k| index * (cell.degrees[k] + 1) + if corner >> k & 1 == 1 { cell.degrees[k] } else { 0 });
                assert!(is_held(cell.coefficients[index], &truth), "{terms:?} at {shares:?}");
                assert!(cell.coefficients[index].width() < 1e-9);
            }
            for _ in 0..5 {
                let shares: Vec<f64> = cell.spans.iter().map(|span| random.between(span[0], span[1])).collect();
                let truth = value(&terms, &place(&sides, &shares));
                assert!(is_held(whole, &truth));
            }
        }
    }
}

#[test]
fn an_enclosure_is_reached() {
    let mut random = Random(4);
    for _ in 0..16 {
        let dimensions = 1 + random.below(2);
        let count = 2 + random.below(6);
        let terms = random_terms(&mut random, dimensions, 4, count);
        let sides: Vec<Interval> = (0..dimensions).map(|_| random_side(&mut random)).collect();
        let found = extent(&terms, &sides);
        let box_of_shares = vec![[0.0, 1.0]; dimensions];
        let spread = found.range.width().max(1e-6);
        for (sign, bound, at) in [(1.0, found.range.low, &found.least_at), (-1.0, -found.range.high, &found.greatest_at)] {
            // The adversary finds no value beyond the bound.
            let height = |shares: &[f64]| -sign * Precision::F64.round(&value(&terms, &place(&sides, shares)));
            let (_, worst) = crate::adversary::climb(&mut random, Precision::F64, &box_of_shares, 100, height);
            let seen = value(&terms, &place(&sides, &worst)) * exact(sign);
            assert!(exact(bound) <= seen, "{terms:?} over {sides:?}: {bound} at {worst:?}");
            // The value at the returned point is as near to the bound as required.
            let named = Precision::F64.round(&(value(&terms, &place(&sides, at)) * exact(sign)));
            let promised = TIGHT_ENOUGH * 10.0 * spread.max(1.0) + 1e-10;
            assert!(bound <= named && named - bound <= promised, "{terms:?} over {sides:?}: {bound} but {named} at {at:?}");
        }
    }
}

#[test]
fn what_is_said_to_be_seen_is_seen_there() {
    let mut random = Random(6);
    for _ in 0..40 {
        let dimensions = 1 + random.below(2);
        let terms = random_terms(&mut random, dimensions, 3, 4);
        let sides: Vec<Interval> = (0..dimensions).map(|_| random_side(&mut random)).collect();
        let found = least(&terms, &sides, &WHOLE_BOX);
        let truth = value(&terms, &place(&sides, &found.at));
        // Values may be as large as some hundred.
        assert!(truth <= exact(found.seen) && exact(found.seen - 1e-10) < truth, "{found:?} of {terms:?} over {sides:?}");
        assert!(exact(found.bound) <= truth);
    }
}

#[test]
fn a_least_value_inside_is_found_as_closely_as_promised() {
    // (x - a)^2 + (y - b)^2 + c over [-1, 1]^2: the minimum is c at (a, b); the spread is below 10.
    let mut random = Random(5);
    let side = Interval::new(-1.0, 1.0);
    for _ in 0..10 {
        let (a, b, c) = (random.between(-0.9, 0.9), random.between(-0.9, 0.9), random.between(-3.0, 3.0));
        let terms = [
            monomial(&[2, 0], 1.0),
            monomial(&[0, 2], 1.0),
            monomial(&[1, 0], -2.0 * a),
            monomial(&[0, 1], -2.0 * b),
            monomial(&[0, 0], a * a + b * b + c),
        ];
        let found = extent(&terms, &[side, side]);
        assert!(found.range.low <= c + 1e-14 && c - found.range.low <= TIGHT_ENOUGH * 10.0 + 1e-14, "{found:?} {c}");
        for (share, place) in found.least_at.iter().zip([a, b]) {
            // If a value is within 1e-8 of the minimum, its point is within 1e-4 of the point of the minimum.
            assert!((share * 2.0 - 1.0 - place).abs() <= 1e-4, "{found:?} {a} {b}");
        }
    }
    // The required accuracy is 1e-9 of the spread; the constants must not be larger.
    assert_eq!((TIGHT_ENOUGH, ROUNDING), (1e-9, 1e-12));
}

#[test]
fn the_corners_of_the_whole_box_are_seen_before_any_cut() {
    // A constant cannot be divided along any side.
    let everywhere = Search { place: &|_| Place::Inside, spaces: &[], finest: 1.0, enough: f64::INFINITY };
    let found = least(&[monomial(&[0], 3.5)], &[Interval::new(-1.0, 1.0)], &everywhere);
    assert_eq!((found.bound, found.seen), (3.5, 3.5));
}

#[test]
fn every_corner_is_seen_and_of_equals_the_first_is_named() {
    let side = Interval::new(-1.0, 1.0);
    for corner in 0..8usize {
        let sign = |k: usize| if corner >> k & 1 == 1 { -1.0 } else { 1.0 };
        let power = |k: usize| (0..3).map(|j| u32::from(j == k)).collect::<Vec<u32>>();
        let terms: Vec<Monomial> = (0..3).map(|k| monomial(&power(k), sign(k) * [1.0, 2.0, 4.0][k])).collect();
        let found = least(&terms, &[side; 3], &WHOLE_BOX);
        assert_eq!(found.at, (0..3).map(|k| (corner >> k & 1) as f64).collect::<Vec<f64>>());
        assert!(found.bound <= -7.0 && found.bound > -7.0 - 1e-14);
    }
    assert_eq!(least(&[monomial(&[1, 1], 0.0)], &[side; 2], &WHOLE_BOX).at, [0.0, 0.0]);
    // A polynomial without terms has one coefficient.
    assert_eq!(Cell::new(&[&[]], &[side; 2]).coefficients, [Interval::point(0.0)]);
}

/// The smaller of two values: a concave function of them.
struct Lesser;

impl Measure for Lesser {
    fn low(&self, values: &[Interval], _than: f64) -> f64 {
        values[0].low.min(values[1].low)
    }
    fn high(&self, values: &[Interval]) -> f64 {
        values[0].high.min(values[1].high)
    }
}

#[test]
fn polynomials_side_by_side_have_each_their_own_coefficients() {
    let mut random = Random(8);
    for _ in 0..40 {
        let dimensions = 1 + random.below(3);
        let terms: Vec<Vec<Monomial>> = (0..3).map(|_| random_terms(&mut random, dimensions, 3, 4)).collect();
        // All polynomials together have the degrees of the largest. A term with coefficient 0 gives these degrees to each polynomial alone.
        let degree = |k: usize| terms.iter().flatten().map(|term| term.powers[k]).max().unwrap();
        let top = monomial(&(0..dimensions).map(degree).collect::<Vec<u32>>(), 0.0);
        let sides: Vec<Interval> = (0..dimensions).map(|_| random_side(&mut random)).collect();
        let slices: Vec<&[Monomial]> = terms.iter().map(Vec::as_slice).collect();
        let mut together = Cell::new(&slices, &sides);
        let with_top = |terms: &Vec<Monomial>| [&terms[..], std::slice::from_ref(&top)].concat();
        let mut alone: Vec<Cell> = terms.iter().map(|terms| Cell::new(&[&with_top(terms)[..]], &sides)).collect();
        for _ in 0..3 {
            for (which, cell) in alone.iter().enumerate() {
                let own: Vec<Interval> = together.coefficients.iter().skip(which).step_by(3).copied().collect();
                assert_eq!(own, cell.coefficients);
            }
            for axis in 0..dimensions {
                let bends = alone.iter().map(|cell| cell.bend(axis)).fold(0.0, f64::max);
                assert_eq!(together.bend(axis), bends);
            }
            let (axis, is_left) = (random.below(dimensions), random.chance(2));
            let half = |cell: &Cell| if is_left { cell.halved(axis).0 } else { cell.halved(axis).1 };
            (together, alone) = (half(&together), alone.iter().map(half).collect());
        }
    }
}

#[test]
fn the_least_of_a_concave_measure_is_that_of_its_worst_place() {
    let mut random = Random(9);
    for _ in 0..20 {
        let dimensions = 1 + random.below(2);
        let terms: Vec<Vec<Monomial>> = (0..2).map(|_| random_terms(&mut random, dimensions, 3, 4)).collect();
        let sides: Vec<Interval> = (0..dimensions).map(|_| random_side(&mut random)).collect();
        let found = least_measure(&terms, &sides, &Lesser, &WHOLE_BOX);
        let each = terms.iter().map(|terms| least(terms, &sides, &WHOLE_BOX));
        let expected = each.map(|found| found.bound).fold(f64::INFINITY, f64::min);
        // Each search ends within 10^-9 of a spread of up to some hundred.
        assert!((found.bound - expected).abs() < 1e-6, "{found:?} {expected}");
        let there = terms.iter().map(|terms| value(terms, &place(&sides, &found.at))).reduce(|a, b| if a < b { a } else { b });
        let there = there.expect("two");
        assert!(exact(found.bound) <= there && there <= exact(found.seen), "{found:?}");
    }
    // With two polynomials a cell has twice as many coefficients, so the same budget gives a bound that is no better than for one.
    let valley = vec![monomial(&[2, 0], 1.0), monomial(&[1, 1], -2.0), monomial(&[0, 2], 1.0), monomial(&[20, 20], 0.0)];
    let sides = [Interval::new(-1.0, 1.3), Interval::new(-0.9, 1.2)];
    let both = [valley.clone(), valley.clone()];
    let (one, two) = (least(&valley, &sides, &WHOLE_BOX).bound, least_measure(&both, &sides, &Lesser, &WHOLE_BOX).bound);
    assert!(two < one && one <= 0.0, "{two} {one}");
}
