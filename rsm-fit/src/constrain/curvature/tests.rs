//! Hessians worked by hand, and drawn matrices against the quotients of drawn directions.

use super::*;
use crate::random::Random;

fn monomial(powers: &[u32], coefficient: f64) -> Monomial {
    Monomial { powers: powers.to_vec(), coefficient: Interval::point(coefficient) }
}

fn points(values: &[f64]) -> Vec<Interval> {
    values.iter().copied().map(Interval::point).collect()
}

#[test]
fn the_entries_are_those_of_the_form() {
    // u = (1, v): x + 2 (2 v) + 3 x^2 v^2 has H = (x, 2; 2, 3 x^2).
    let found = entries(&[monomial(&[1, 0, 0], 1.0), monomial(&[0, 0, 1], 4.0), monomial(&[2, 0, 2], 3.0)], 2);
    // Half of a coefficient is moved outward by a unit at each end.
    let middle = |entry: &Vec<Monomial>| entry[0].coefficient.low.midpoint(entry[0].coefficient.high);
    let told = |entry: &Vec<Monomial>| (entry[0].powers.clone(), middle(entry));
    assert!(found[1][0].coefficient.low >= 2f64.next_down() && found[1][0].coefficient.high <= 2f64.next_up());
    assert!(found.iter().all(|entry| entry.len() == 1) && (middle(&found[1]) - 2.0).abs() < 1e-15);
    assert_eq!([&found[0], &found[2]].map(told), [(vec![1, 0], 1.0), (vec![2, 0], 3.0)]);
    assert_eq!(found[1][0].powers, [0, 0]);
    // Of three inputs each entry at its place: u'Hu of constants 1 to 6.
    let form = [
        (&[0, 0, 0, 0, 0][..], 1.0),
        (&[0, 0, 0, 1, 0], 4.0),
        (&[0, 0, 0, 0, 1], 6.0),
        (&[0, 0, 0, 2, 0], 4.0),
        (&[0, 0, 0, 1, 1], 10.0),
        (&[0, 0, 0, 0, 2], 6.0),
    ];
    let form: Vec<Monomial> = form.iter().map(|(powers, coefficient)| monomial(powers, *coefficient)).collect();
    let found: Vec<f64> = entries(&form, 3).iter().map(|entry| middle(entry).round()).collect();
    assert_eq!(found, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let measure = LeastEigenvalue(3);
    let at = |a, b| measure.entry(&points(&found), a, b).low;
    assert_eq!([at(0, 0), at(0, 1), at(2, 0), at(1, 1), at(2, 1), at(2, 2)], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert!(entries(&[], 3).iter().all(Vec::is_empty));
}

#[test]
fn known_eigenvalues_are_enclosed() {
    // Eigenvalues 1 and 3; 0 and 5; 2 - 3 and 2 + 3.
    for (matrix, least) in [([2.0, 1.0, 2.0], 1.0), ([1.0, 2.0, 4.0], 0.0), ([2.0, 3.0, 2.0], -1.0)] {
        let values = points(&matrix);
        let measure = LeastEigenvalue(2);
        let (low, high) = (measure.low(&values, f64::INFINITY), measure.high(&values));
        assert!(low <= least && least <= high, "{low} {least} {high}");
        // Two rows, 32 units of the largest entry each, twice.
        assert!(low > least - 130.0 * f64::EPSILON * 4.0 && high < least + 1e-14, "{low} {least} {high}");
        // What is known to be at least so much is not asked further, and what is not is.
        assert_eq!(measure.low(&values, least - 0.5), least - 0.5);
        assert!(measure.low(&values, least + 0.5) <= least);
    }
}

#[test]
fn an_input_in_which_nothing_bends_has_the_eigenvalue_zero_to_the_bit() {
    let measure = LeastEigenvalue(3);
    let of = |values: [f64; 6], than: f64| measure.low(&points(&values), than);
    assert_eq!(of([0.0; 6], f64::INFINITY), 0.0);
    // One live row: its entry, or 0.
    assert_eq!(of([0.0, 0.0, 0.0, 0.7, 0.0, 0.0], f64::INFINITY), 0.0);
    assert_eq!(of([0.0, 0.0, 0.0, -0.7, 0.0, 0.0], f64::INFINITY), -0.7);
    // Two: (2, 1; 1, 2) has 1 and 3.
    assert_eq!(of([2.0, 0.0, 1.0, 0.0, 0.0, 2.0], f64::INFINITY), 0.0);
    assert_eq!(of([2.0, 0.0, 1.0, 0.0, 0.0, 2.0], 0.5), 0.0);
    assert_eq!(of([2.0, 0.0, 1.0, 0.0, 0.0, 2.0], -0.5), -0.5);
    // A single input is its entry.
    let around = [Interval::new(0.25, 0.5)];
    assert_eq!([LeastEigenvalue(1).low(&around, f64::INFINITY), LeastEigenvalue(1).low(&around, 0.125)], [0.25; 2]);
    // Beyond the largest number nothing is known.
    let huge = [Interval::new(f64::MIN, f64::INFINITY), Interval::point(1.0), Interval::point(1.0)];
    assert_eq!(LeastEigenvalue(2).low(&huge, f64::INFINITY), f64::NEG_INFINITY);
    assert_eq!(LeastEigenvalue(2).high(&huge), f64::INFINITY);
}

#[test]
fn no_matrix_of_an_enclosure_has_a_smaller_eigenvalue() {
    let mut random = Random::new(3);
    for round in 0..400 {
        let size = 2 + random.below(4) as usize;
        let width = [0.0, 1e-12, 1e-3, 0.3][round % 4];
        let measure = LeastEigenvalue(size);
        let enclosure: Vec<Interval> = (0..size * (size + 1) / 2)
            .map(|_| {
                let middle = 2.0 * random.share() - 1.0;
                Interval::new(middle - width * random.share(), middle + width * random.share())
            })
            .collect();
        let low = measure.low(&enclosure, f64::INFINITY);
        let high = measure.high(&enclosure);
        let mut least = f64::INFINITY;
        for _ in 0..30 {
            // Entries at an end of their enclosure, where eigenvalues are extreme.
            let drawn: Vec<f64> =
                enclosure.iter().map(|entry| if random.share() < 0.5 { entry.low } else { entry.high }).collect();
            let matrix = DMatrix::from_fn(size, size, |a, b| drawn[place(a.min(b), a.max(b), size)]);
            least = least.min(matrix.symmetric_eigenvalues().min());
        }
        // Eigenvalues of matrices of entries up to 1.3 are known to some 1e-15.
        assert!(low <= least + 1e-14, "{low} {least} {enclosure:?}");
        assert!(high >= least - 1e-14, "{high} {least} {enclosure:?}");
        // Nor is it far below: twice the rows times half the width, and rounding.
        let loss = 2.0 * size as f64 * width + 1e-12;
        assert!(low >= least - 2.0 * loss && high <= least + 2.0 * loss, "{low} {least} {high} {width}");
    }
}

#[test]
fn the_worst_direction_belongs_to_its_largest_entry() {
    // H = (x, 2; 2, x) at x = 1: least along (1, -1). At the share 3/4 of [-1, 3] it is 2: (2, 2; 2, 2).
    let form = [monomial(&[1, 0, 0], 1.0), monomial(&[0, 0, 1], 4.0), monomial(&[1, 0, 2], 1.0)];
    let sides = [Interval::new(-1.0, 3.0), Interval::new(0.0, 1.0)];
    let measure = LeastEigenvalue(2);
    let (_, other) = measure.worst(&entries(&form, 2), &sides, &[0.75, 0.5]);
    assert!(other[0].abs() < 1e-12, "-1 stands at share 0: {other:?}");
    // diag(1, 2, -3) with a little beside it: along the last, the others next to nothing.
    let form = [
        monomial(&[0, 0, 0, 0, 0], 1.0),
        monomial(&[0, 0, 0, 2, 0], 2.0),
        monomial(&[0, 0, 0, 0, 2], -3.0),
        monomial(&[0, 0, 0, 0, 1], 0.8),
    ];
    let (largest, others) = LeastEigenvalue(3).worst(&entries(&form, 3), &[sides[0]; 3], &[0.5; 3]);
    // (1 - l) u = 0.4: l = -3 - 0.4^2/(1 - l), about -3.04; u = -0.4/(1 - l) = -0.4/4.04 of the last.
    let l = 0.5 * (-2.0 - (16.0f64 + 0.64).sqrt());
    assert_eq!(largest, 2);
    assert!((others[0] - (1.0 - 0.4 / (1.0 - l)) / 2.0).abs() < 1e-12 && (others[1] - 0.5).abs() < 1e-12, "{others:?} {l}");
}

/// a I - b J, J of ones, with every entry unsure by r: eigenvalues a and a - n b, and the least of the enclosure is a - n (b + r), along the ones.
/// Binary fractions: all of it is exact.
#[test]
fn the_worst_matrix_of_an_enclosure_is_not_called_better_than_it_is() {
    for size in 2..=6 {
        let n = size as f64;
        for (a, b, r) in [(1.0, 0.125, 0.0625), (8.0, 1.0, 2f64.powi(-20)), (0.5, 0.25, 0.5), (3.0, -0.25, 0.25)] {
            let measure = LeastEigenvalue(size);
            let entry = |row: usize, column: usize| (if row == column { a } else { 0.0 }) - b;
            let mut enclosure = vec![Interval::point(0.0); size * (size + 1) / 2];
            for row in 0..size {
                for column in row..size {
                    enclosure[place(row, column, size)] = Interval::new(entry(row, column) - r, entry(row, column) + r);
                }
            }
            let worst = if b + r > 0.0 { a - n * (b + r) } else { a };
            let low = measure.low(&enclosure, f64::INFINITY);
            assert!(low <= worst, "{size} {a} {b} {r}: {low}, and {worst} is there");
            // Three times the radius and the rounding below the least of the middle: the first try.
            let of_middle = if b > 0.0 { a - n * b } else { a };
            assert!(low >= of_middle - 2.0 * n * (r + 64.0 * f64::EPSILON * (a + b.abs())) - 1e-14, "{low} {of_middle}");
            let rows: Vec<usize> = (0..size).collect();
            let middle = Middle::of(&measure, &enclosure, &rows).unwrap();
            // Just above the worst is not above it; a hair below it is: the margin is no wider than the radius makes it, and rounding.
            assert!(!middle.is_above(worst + 2f64.powi(-40)), "{size} {a} {b} {r}");
            let hair = n * 64.0 * f64::EPSILON * (a + b.abs());
            assert!(b < 0.0 || middle.is_above(worst - hair), "{size} {a} {b} {r}");
            // From above no less than the least of them all, to the bit.
            assert!(measure.high(&enclosure) >= worst, "{size} {a} {b} {r}");
        }
    }
}

/// The margin holds half of the widest entry, rounded up, and the rounding of the largest one, whatever its sign; a pivot of 0 proves nothing.
#[test]
fn the_margin_is_no_less_than_what_may_be_missing() {
    let of = |entries: [Interval; 3]| Middle::of(&LeastEigenvalue(2), &entries, &[0, 1]).unwrap().margin;
    assert_eq!(of([-8.0, 1.0, 2.0].map(Interval::point)), 2.0 * (5e-324 + ROUNDING * 8.0));
    // The middle of 0 and the least number above is rounded to 0: all of the width lies above.
    let least = 5e-324;
    assert_eq!(0f64.midpoint(least), 0.0);
    assert_eq!(of([Interval::new(0.0, least), Interval::point(0.0), Interval::point(0.0)]), 2.0 * (2.0 * least));
    let exact = Middle { size: 2, entries: vec![2.0, 0.0, 0.0, 1.0], margin: 0.0 };
    assert!(exact.is_above(1f64.next_down()) && !exact.is_above(1.0));
}

#[test]
fn a_quotient_is_rounded_up() {
    let of = |high: f64| most_of_quotient(Interval::new(-9.0, high), Interval::new(2.0, 4.0));
    assert_eq!([of(0.5), of(-0.5), of(6.0), of(-6.0)], [0.25f64, -0.125, 3.0, -1.5].map(f64::next_up));
}

/// Sums of fewer squares than rows, of small whole numbers: every one is exact, and its least eigenvalue is 0. Rounded pivots say otherwise.
#[test]
fn a_matrix_that_is_singular_is_not_called_positive_by_rounding() {
    let mut random = Random::new(8);
    let mut by_pivots = 0;
    for _ in 0..400 {
        let size = 2 + random.below(5) as usize;
        let factor = DMatrix::from_fn(size, size - 1, |_, _| random.below(19) as f64 - 9.0);
        let singular = &factor * factor.transpose();
        let values: Vec<Interval> =
            (0..size).flat_map(|a| (a..size).map(move |b| (a, b))).map(|(a, b)| Interval::point(singular[(a, b)])).collect();
        let measure = LeastEigenvalue(size);
        let rows: Vec<usize> = (0..size).collect();
        let Some(mut middle) = Middle::of(&measure, &values, &rows) else { panic!("{singular}") };
        assert!(!middle.is_above(1e-300), "{singular}");
        let (low, high) = (measure.low(&values, f64::INFINITY), measure.high(&values));
        assert!(low <= 0.0 && high >= 0.0, "{low} {high} {singular}");
        // One margin for the pivots, one for the eigenvalue, and what the eigenvalue may be off the other way.
        assert!(low >= -3.0 * middle.margin, "{low} {singular}");
        middle.margin = 0.0;
        by_pivots += usize::from(middle.is_above(1e-300));
    }
    // The draw is hard enough: without a margin rounded pivots would call some of them positive.
    assert!(by_pivots > 10, "{by_pivots}");
}
