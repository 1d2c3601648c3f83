//! Tests of enclosures against exact rationals, and of their width.

use super::*;
use crate::adversary::Random;

#[test]
fn operations_enclose_the_exact_result() {
    let values = [0.1, -0.3, 1e-300, 7.0, -1e200, 3.0e-5];
    for a in values {
        for b in values {
            let (x, y) = (Interval::point(a), Interval::point(b));
            for (enclosure, truth) in [(x + y, exact(a) + exact(b)), (x - y, exact(a) - exact(b)), (x * y, exact(a) * exact(b))]
            {
                assert!(enclosure.low.is_infinite() || exact(enclosure.low) <= truth, "{a} {b}");
                assert!(enclosure.high.is_infinite() || exact(enclosure.high) >= truth, "{a} {b}");
            }
        }
    }
    let third = Rational::new(1.into(), 3.into());
    let around = Interval::around(&third);
    assert!(exact(around.low) < third && third < exact(around.high) && around.low.next_up() == around.high);
}

/// Special numbers, and random ones of every size.
fn number(random: &mut Random) -> f64 {
    let hurtful = [0.0, -0.0, 1.0, -1.0, 5e-324, -5e-324, f64::MIN_POSITIVE, f64::MAX, -f64::MAX, 1e200, -1e200, 0.1, 2.0, 0.5];
    let sizes = [2f64.powi(-1060), 2f64.powi(-500), 1e-3, 1.0, 1e3, 2f64.powi(500)];
    if random.chance(3) { random.pick(&hurtful) } else { random.between(-1.0, 1.0) * random.pick(&sizes) }
}

fn interval(random: &mut Random) -> Interval {
    let (a, b) = (number(random), number(random));
    if random.chance(3) { Interval::point(a) } else { Interval::new(a.min(b), a.max(b)) }
}

/// Whether an interval contains the exact interval, with bounds at most two numbers beyond it.
fn is_snug(found: Interval, low: &Rational, high: &Rational) -> bool {
    let holds = |bound: f64, truth: &Rational| bound == f64::NEG_INFINITY || bound.is_finite() && exact(bound) <= *truth;
    let near = |bound: f64, truth: &Rational| {
        let inner = bound.next_up().next_up();
        !inner.is_finite() && inner > 0.0 || inner.is_finite() && exact(inner) >= *truth
    };
    let is_far_below = |truth: &Rational| *truth < exact(-f64::MAX);
    holds(found.low, low)
        && holds(-found.high, &-high)
        && (near(found.low, low) || is_far_below(low))
        && (near(-found.high, &-high) || is_far_below(&-high))
}

#[test]
fn sums_and_products_hold_every_exact_result_and_little_more() {
    let mut random = Random(1);
    for _ in 0..4000 {
        let (a, b) = (interval(&mut random), interval(&mut random));
        let [a_ends, b_ends] = [a, b].map(|x| [exact(x.low), exact(x.high)]);
        assert!(is_snug(a + b, &(&a_ends[0] + &b_ends[0]), &(&a_ends[1] + &b_ends[1])), "{a:?} + {b:?} = {:?}", a + b);
        assert!(is_snug(a - b, &(&a_ends[0] - &b_ends[1]), &(&a_ends[1] - &b_ends[0])), "{a:?} - {b:?} = {:?}", a - b);
        let products: Vec<Rational> = a_ends.iter().flat_map(|x| b_ends.iter().map(move |y| x * y)).collect();
        let (low, high) = (products.iter().min().unwrap(), products.iter().max().unwrap());
        assert!(is_snug(a * b, low, high), "{a:?} * {b:?} = {:?}", a * b);
        let half = exact(0.5);
        assert!(is_snug(a.halved(), &(&a_ends[0] * &half), &(&a_ends[1] * &half)), "{a:?}");
        assert!(
            exact(a.magnitude())
                == crate::adversary::magnitude(a_ends[0].clone()).max(crate::adversary::magnitude(a_ends[1].clone()))
        );
        let width = &a_ends[1] - &a_ends[0];
        assert!(
            a.width().is_infinite() || exact(a.width()) >= width && exact(a.width().next_down().next_down()) <= width,
            "{a:?}"
        );
        assert_eq!((-a).low, -a.high);
        assert_eq!((-a).high, -a.low);
        assert_eq!(a.hull(b), Interval::new(a.low.min(b.low), a.high.max(b.high)));
    }
}

#[test]
fn zero_and_one_cost_nothing() {
    let mut random = Random(2);
    let (zero, one) = (Interval::point(0.0), Interval::point(1.0));
    for _ in 0..200 {
        let a = interval(&mut random);
        assert_eq!([a + zero, zero + a, a - zero, a * one, one * a], [a; 5]);
        assert_eq!([a * zero, zero * a], [zero; 2]);
    }
}

#[test]
fn an_infinite_bound_stays_on_its_side() {
    let (from, to) = (Interval { low: 2.0, high: f64::INFINITY }, Interval { low: f64::NEG_INFINITY, high: -2.0 });
    let holds = |found: Interval, low: f64, high: f64| found.low <= low && found.high >= high;
    assert!(holds(from + from, 4.0, f64::INFINITY) && (from + from).low > 3.9);
    assert!(holds(from * to, f64::NEG_INFINITY, -4.0) && (from * to).high < -3.9);
    // Zero times an unbounded interval is zero: no bound becomes NaN.
    let share = Interval::new(0.0, 1.0);
    assert!(holds(from * share, 0.0, f64::INFINITY) && (from * share).low > -1e-300);
    assert!(holds(share * to, f64::NEG_INFINITY, 0.0) && (share * to).high < 1e-300);
    assert!(holds(from + to, f64::NEG_INFINITY, f64::INFINITY));
    assert_eq!(outward(f64::NAN, f64::NAN), Interval { low: f64::NEG_INFINITY, high: f64::INFINITY });
}

#[test]
fn around_a_rational_lie_its_two_neighbours() {
    let mut random = Random(3);
    for _ in 0..500 {
        let (a, b) = (number(&mut random), random.between(1.0, 3.0));
        let value = exact(a) / exact(b);
        let found = Interval::around(&value);
        assert!(exact(found.low) <= value && value <= exact(found.high), "{a} / {b}");
        let is_number = exact(found.low) == value || exact(found.high) == value;
        assert_eq!(found.high, if is_number { found.low } else { found.low.next_up() }, "{a} / {b}");
        assert_eq!(Interval::around(&exact(a)), Interval::point(a));
    }
    // Beyond the largest number: the enclosure is from the largest number to infinity.
    let beyond = exact(f64::MAX) * exact(3.0);
    assert_eq!(Interval::around(&beyond), Interval { low: f64::MAX, high: f64::INFINITY });
    assert_eq!(Interval::around(&-beyond), Interval { low: f64::NEG_INFINITY, high: -f64::MAX });
}

#[test]
fn a_power_of_two_exists_up_to_the_largest_exponent() {
    for (precision, largest) in [(Precision::F64, 1023_i32), (Precision::F32, 127)] {
        let of = |low: i32, high: i32| Interval { low: f64::from(low), high: f64::from(high) }.power_of_two(precision);
        let all = of(1 - largest, largest).unwrap();
        assert_eq!((all.low, all.high), (2.0_f64.powi(1 - largest), 2.0_f64.powi(largest)));
        assert!(of(0, largest + 1).is_none() && of(-largest, 0).is_none());
    }
}
