//! Descents on polynomials whose minima are known.

use super::*;
use rsm_core::interval::Interval;

#[test]
fn both_valleys_of_a_double_well_are_found_and_only_inside() {
    // (x^2 - 1/4)^2 + (y - x/2)^2 - 1/10 over [-1, 1]: minima -1/10 at (1/2, 1/4) and (-1/2, -1/4).
    let term = |powers: [u32; 2], value: f64| Monomial { powers: powers.to_vec(), coefficient: Interval::point(value) };
    let terms =
        [term([4, 0], 1.0), term([2, 0], -0.5 + 0.25), term([0, 2], 1.0), term([1, 1], -1.0), term([0, 0], 0.0625 - 0.1)];
    let polynomial_on_box = BoxPolynomial::new(&terms, vec![[-1.0, 1.0]; 2]);
    let starts: Vec<Vec<f64>> = (0..9).map(|k| vec![f64::from(k % 3) / 2.0, f64::from(k / 3) / 2.0]).collect();
    let found = polynomial_on_box.below(0.0, &starts, &|_| true);
    assert_eq!(found.len(), 2, "{found:?}");
    for minimum in &found {
        let sign = if minimum.shares[0] > 0.5 { 1.0 } else { -1.0 };
        // The last step is 5e-4 of a side; the vertex is far nearer.
        assert!((minimum.shares[0] - (0.5 + 0.25 * sign)).abs() < 5e-4, "{minimum:?}");
        assert!((minimum.shares[1] - (0.5 + 0.125 * sign)).abs() < 5e-4, "{minimum:?}");
        assert!((minimum.value + 0.1).abs() < 1e-6, "{minimum:?}");
    }
    assert_eq!(polynomial_on_box.below(0.0, &starts, &|shares| shares[0] >= 0.5).len(), 1);
    assert!(polynomial_on_box.below(-0.11, &starts, &|_| true).is_empty());
}

fn polynomial_on_box(terms: &[(&[u32], f64)], sides: &[[f64; 2]]) -> BoxPolynomial {
    let term = |(powers, value): &(&[u32], f64)| Monomial { powers: powers.to_vec(), coefficient: Interval::point(*value) };
    BoxPolynomial::new(&terms.iter().map(term).collect::<Vec<_>>(), sides.to_vec())
}

/// The only place that a descent from shares of the sides finds below a value.
fn only(polynomial_on_box: &BoxPolynomial, most: f64, start: &[f64]) -> LocalMinimum {
    let found = polynomial_on_box.below(most, &[start.to_vec()], &|_| true);
    assert_eq!(found.len(), 1, "{found:?}");
    found[0].clone()
}

#[test]
fn a_value_is_that_of_the_polynomial_at_shares_of_the_sides() {
    // 3 x^2 y - 2 y + 5 at x = 2 + 0.25 4 = 3, y = -1 + 0.5 8 = 3.
    let ground = polynomial_on_box(&[(&[2, 1], 3.0), (&[0, 1], -2.0), (&[0, 0], 5.0)], &[[2.0, 6.0], [-1.0, 7.0]]);
    assert_eq!(ground.value(&[0.25, 0.5]), 3.0 * 9.0 * 3.0 - 6.0 + 5.0);
    // The middle of an interval counts.
    let wide = Monomial { powers: vec![1], coefficient: Interval::new(1.0, 3.0) };
    assert_eq!(BoxPolynomial::new(&[wide], vec![[0.0, 4.0]]).value(&[0.5]), 4.0);
}

#[test]
fn a_parabola_is_left_at_its_vertex() {
    // (x - 0.3)^2 - 1/4 over [0, 1], from several starts: a step ends within 2^-11, the vertex within rounding of its value.
    let ground = polynomial_on_box(&[(&[2], 1.0), (&[1], -0.6), (&[0], 0.09 - 0.25)], &[[0.0, 1.0]]);
    for start in [0.0, 0.1, 0.29, 0.7, 1.0] {
        let found = only(&ground, 0.0, &[start]);
        assert!((found.shares[0] - 0.3).abs() < 1e-9 && (found.value + 0.25).abs() < 1e-15, "{start} {found:?}");
        assert_eq!(found.value, ground.value(&found.shares));
    }
    // At an end of the side there is no further way down.
    let slope = polynomial_on_box(&[(&[1], 1.0), (&[0], -2.0)], &[[0.0, 1.0]]);
    assert_eq!(only(&slope, 0.0, &[0.47]).shares, [0.0]);
    let rise = polynomial_on_box(&[(&[1], -1.0)], &[[0.0, 1.0]]);
    assert_eq!(only(&rise, 0.0, &[0.47]).shares, [1.0]);
}

#[test]
fn a_narrow_valley_across_the_sides_is_followed_to_its_end() {
    // 100 (x - y)^2 + (x + y - 1.6)^2 - 1: along the sides a step of a sixteenth climbs, and small ones are many.
    let terms: &[(&[u32], f64)] =
        &[(&[2, 0], 101.0), (&[0, 2], 101.0), (&[1, 1], -198.0), (&[1, 0], -3.2), (&[0, 1], -3.2), (&[0, 0], 2.56 - 1.0)];
    let ground = polynomial_on_box(terms, &[[0.0, 1.0], [0.0, 1.0]]);
    let looks = std::cell::Cell::new(0);
    let found = ground.below(0.0, &[vec![0.05, 0.1]], &|_| {
        looks.set(looks.get() + 1);
        true
    });
    // Without going on the same way it takes 286 looks.
    assert!(looks.get() <= 185 && found[0].value < -0.9999, "{} {found:?}", looks.get());
}

#[test]
fn a_descent_stays_in_the_region_and_begins_in_it() {
    // x + y over the unit square where x + y >= 0.75: the edge is the lowest.
    let ground = polynomial_on_box(&[(&[1, 0], 1.0), (&[0, 1], 1.0)], &[[0.0, 1.0], [0.0, 1.0]]);
    let inside = |shares: &[f64]| shares[0] + shares[1] >= 0.75;
    let found = ground.below(2.0, &[vec![0.9, 0.8], vec![0.1, 0.2]], &inside);
    assert_eq!(found.len(), 1);
    assert!(inside(&found[0].shares) && found[0].value < 0.75 + 2e-3, "{found:?}");
}

#[test]
fn places_are_told_apart_by_a_hundredth_of_a_side_and_come_by_depth() {
    // Flat ground: every start is its own place.
    let flat = polynomial_on_box(&[(&[0, 0], -1.0)], &[[0.0, 1.0], [0.0, 1.0]]);
    let count =
        |starts: &[[f64; 2]]| flat.below(0.0, &starts.iter().map(|start| start.to_vec()).collect::<Vec<_>>(), &|_| true).len();
    assert_eq!(count(&[[0.5, 0.5], [0.508, 0.492]]), 1);
    assert_eq!(count(&[[0.5, 0.5], [0.515, 0.5]]), 2);
    assert_eq!(count(&[[0.5, 0.5], [0.5, 0.485]]), 2);
    assert_eq!(count(&[[0.0, 0.5], [0.01, 0.5]]), 2, "just so far is apart");
    assert_eq!(flat.below(-1.0, &[vec![0.5, 0.5]], &|_| true).len(), 0, "below, not at");
    // Two wells of depth 1 and 2 in [0, 1]: (4 x - 1)^2 - 1 and (4 x - 3)^2 - 2 joined by a cubic is not needed: 16 (x - 1/4)^2 (x - 3/4)^2 * 4 - x.
    let wells = polynomial_on_box(
        &[(&[4], 64.0), (&[3], -128.0), (&[2], 64.0 * 1.375), (&[1], -64.0 * 0.375 - 1.0), (&[0], 64.0 * 0.03515625)],
        &[[0.0, 1.0]],
    );
    let found = wells.below(0.0, &[vec![0.2], vec![0.8]], &|_| true);
    assert!(found.len() == 2 && found[0].shares[0] > 0.7 && found[1].shares[0] < 0.3, "{found:?}");
}

#[test]
fn the_step_is_halved_from_a_sixteenth_to_a_2048th_and_of_equal_ways_the_upper_is_gone() {
    // On flat ground each of 8 steps looks at both sides of each of two axes, and once at where nothing has moved; and the start is looked at.
    let flat = polynomial_on_box(&[(&[0, 0], -1.0)], &[[0.0, 1.0], [0.0, 1.0]]);
    let looks = std::cell::Cell::new(0);
    flat.below(0.0, &[vec![0.5, 0.5]], &|_| {
        looks.set(looks.get() + 1);
        true
    });
    assert_eq!(looks.get(), 1 + 8 * (2 * 2 + 1));
    // -(x - 1/2)^2 from its top.
    let hill = polynomial_on_box(&[(&[2], -1.0), (&[1], 1.0), (&[0], -0.25)], &[[0.0, 1.0]]);
    assert_eq!(only(&hill, 0.0, &[0.5]).shares, [1.0]);
}

/// Powers and products are the plain ones, to the bit, in their order.
#[test]
fn values_are_those_of_the_plain_sum() {
    let mut random = crate::random::Random::new(5);
    let mut number = || 4.0 * random.share() - 2.0;
    let terms: Vec<([u32; 3], f64)> =
        [[0, 0, 0], [3, 0, 1], [0, 5, 0], [1, 1, 1], [0, 0, 2], [2, 4, 0]].map(|powers| (powers, number())).to_vec();
    let told: Vec<(&[u32], f64)> = terms.iter().map(|(powers, value)| (&powers[..], *value)).collect();
    let ground = polynomial_on_box(&told, &[[-1.0, 1.5], [0.25, 2.0], [-3.0, -1.0]]);
    for _ in 0..50 {
        let shares = [(); 3].map(|()| (number() + 2.0) / 4.0);
        let x: Vec<f64> = ground.sides.iter().zip(shares).map(|([low, high], share)| low + share * (high - low)).collect();
        let power = |(x, power): (&f64, &u32)| (0..*power).fold(1.0, |product, _| product * x);
        let plain = terms.iter().map(|(powers, value)| value * x.iter().zip(powers).map(power).product::<f64>()).sum::<f64>();
        assert_eq!(ground.value(&shares), plain, "{shares:?}");
    }
    assert_eq!(polynomial_on_box(&[], &[[0.0, 1.0]]).value(&[0.5]), 0.0);
}
