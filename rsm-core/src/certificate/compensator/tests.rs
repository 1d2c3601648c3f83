//! Tests of limits at their ends, of sums as one polynomial against the exact surfaces, and of the points in the messages.

use super::*;
use crate::adversary::Random;
use crate::model::{Coding, Knot, Outside, Term};

fn input(name: &str, range: [f64; 2]) -> Input {
    Input { name: name.to_string(), unit: "1".to_string(), range, outside: Outside::Clamp }
}

/// A surface in natural powers.
fn surface(name: &str, inputs: &[&str], terms: &[(&[u32], f64)]) -> Surface {
    let terms = terms.iter().map(|(powers, coefficient)| Term { powers: powers.to_vec(), coefficient: *coefficient });
    Surface {
        name: name.to_string(),
        coding: Coding::None,
        inputs: inputs.iter().map(ToString::to_string).collect(),
        terms: terms.collect(),
        ..Surface::default()
    }
}

fn sum(names: &[&str]) -> Scheduled {
    Scheduled::Sum(names.iter().map(ToString::to_string).collect())
}

/// Two numbers around pi.
fn around_pi() -> [Rational; 2] {
    let of = |last: i64| integer(last) / integer(10i64.pow(18));
    [of(3_141_592_653_589_793_238), of(3_141_592_653_589_793_239)]
}

#[test]
fn a_quarter_of_the_sample_rate_is_never_above_it_and_close() {
    let mut random = Random(1);
    let [pi_below, pi_above] = around_pi();
    for _ in 0..300 {
        let sample_time = random.between(1e-5, 1.0);
        let found = quarter_of_sample_rate(sample_time);
        let product = |limit: f64| integer(2) * exact(limit) * exact(sample_time);
        assert!(product(found) < pi_below, "{sample_time}");
        assert!(product(found.next_up().next_up().next_up()) > pi_above, "{sample_time}");
    }
}

#[test]
fn a_condition_does_not_hold_at_its_limit() {
    let range = |low: f64, high: f64| Interval { low, high };
    for (condition, holds, breaks) in [
        (Condition::Positive, range(5e-324, 1.0), range(0.0, 1.0)),
        (Condition::Positive, range(1.0, f64::INFINITY), range(-0.0, 1.0)),
        (Condition::Below(2.0), range(-9.0, 2.0f64.next_down()), range(1.0, 2.0)),
        (Condition::Below(2.0), range(f64::NEG_INFINITY, -2.0), range(1.0, 2.0f64.next_up())),
    ] {
        assert!(condition.holds(holds) && !condition.holds(breaks), "{condition:?}");
    }
}

fn violation_of(model: &Model, scheduled: &Scheduled, condition: Condition) -> Violation {
    let enclosed = Enclosed::of(model, scheduled);
    assert!(!condition.holds(enclosed.range), "{:?}", enclosed.range);
    enclosed.violation(model, scheduled, 0, "key", condition)
}

#[test]
fn a_number_exactly_at_its_limit_breaks_it() {
    // The value is 0 at x = 1, and equals the limit at x = 3: both are found, and both are violations.
    let model = Model {
        inputs: vec![input("x", [1.0, 3.0])],
        surfaces: vec![surface("s", &["x"], &[(&[1], 1.0), (&[0], -1.0)])],
        ..Model::default()
    };
    let s = Scheduled::Surface("s".to_string());
    assert_eq!(violation_of(&model, &s, Condition::Positive).what, "found 0 at x = 1, expected more than 0");
    let expected = "found 2 at x = 3, expected less than a quarter of the sample rate, 2 rad/s";
    assert_eq!(violation_of(&model, &s, Condition::Below(2.0)).what, expected);
    let fixed = violation_of(&model, &Scheduled::Fixed(2.0), Condition::Below(2.0));
    assert_eq!(fixed.what, "found 2, expected less than a quarter of the sample rate, 2 rad/s");
}

/// Surfaces with the same kinds of variables, each over some of the inputs in any order, with knots of its own.
fn surfaces_of_one_kind(random: &mut Random) -> (Vec<Input>, Vec<Surface>) {
    let all = [input("x", [0.5, 2.0]), input("y", [-3.0, 3.0]), input("z", [-4.0, -1.0])];
    let coding = random.pick(&[Coding::None, Coding::Range]);
    let is_reciprocal = [0, 1, 2].map(|k| k != 1 && random.chance(2));
    let is_even = random.chance(2);
    let surfaces: Vec<Surface> = (0..1 + random.below(3))
        .map(|_| {
            let mut own: Vec<usize> = (0..3).filter(|_| random.chance(2)).collect();
            if own.is_empty() || random.chance(2) {
                own = vec![random.below(3), random.below(3)];
                own.dedup();
            }
            let names: Vec<&str> = own.iter().map(|k| all[*k].name.as_str()).collect();
            let mut made = Surface { coding, ..surface("s", &names, &[]) };
            for k in own {
                let name = all[k].name.clone();
                if is_reciprocal[k] {
                    made.reciprocal.push(name.clone());
                }
                if k == 1 && is_even {
                    made.symmetry.push((name.clone(), Symmetry::Even));
                }
                if random.chance(2) {
                    made.knots.push(Knot { input: name, at: [1.0, 1.5, -2.0][k] });
                }
            }
            let factors = made.inputs.len() + made.knots.len();
            for _ in 0..1 + random.below(4) {
                let powers = (0..factors).map(|_| random.below(3) as u32).collect();
                made.terms.push(Term { powers, coefficient: random.between(-2.0, 2.0) });
            }
            made
        })
        .collect();
    let used = all.into_iter().filter(|input| surfaces.iter().any(|it| it.inputs.contains(&input.name))).collect();
    (used, surfaces)
}

fn at(surface: &Surface, inputs: &[Input], point: &[Rational]) -> Rational {
    let place = |name: &String| inputs.iter().position(|input| input.name == *name).unwrap();
    let (own, point): (Vec<Input>, Vec<Rational>) =
        surface.inputs.iter().map(|name| (inputs[place(name)].clone(), point[place(name)].clone())).unzip();
    exact::polynomial(surface, &own, &point).unwrap()
}

#[test]
fn a_sum_of_surfaces_is_one_polynomial_everywhere() {
    let mut random = Random(2);
    for _ in 0..60 {
        let (inputs, surfaces) = surfaces_of_one_kind(&mut random);
        let each: Vec<&Surface> = surfaces.iter().collect();
        let sum = as_one(&each, &inputs).expect("all of one kind");
        for _ in 0..6 {
            let point: Vec<Rational> = inputs
                .iter()
                .map(|input| {
                    exact(random.between(input.range[0], input.range[1])) + integer(random.below(2) as i64) / integer(999)
                })
                .collect();
            let truth = each.iter().fold(integer(0), |sum, surface| sum + at(surface, &inputs, &point));
            assert_eq!(at(&sum, &inputs, &point), truth, "{surfaces:?}");
        }
    }
}

#[test]
fn surfaces_of_different_kinds_are_not_summed() {
    let inputs = [input("x", [0.5, 2.0]), input("y", [-3.0, 3.0])];
    let plain = surface("s", &["x", "y"], &[(&[1, 1], 1.0)]);
    let other = surface("s", &["y"], &[(&[1], 1.0)]);
    let symmetric = |kind: Symmetry| Surface { symmetry: vec![("y".to_string(), kind)], ..plain.clone() };
    let changed = [
        Surface { coding: Coding::Range, ..plain.clone() },
        Surface { reciprocal: vec!["x".to_string()], ..plain.clone() },
        Surface { output_range: Some([-1.0, 1.0]), ..plain.clone() },
        symmetric(Symmetry::Even),
        symmetric(Symmetry::Odd),
    ];
    assert!(as_one(&[&plain, &other, &plain], &inputs).is_some());
    for changed in &changed {
        assert_eq!(as_one(&[&plain, changed], &inputs), None, "{changed:?}");
        assert_eq!(as_one(&[changed, &plain], &inputs), None, "{changed:?}");
    }
    // Two equal surfaces have the same kind; only one that saturates or has an odd input cannot be summed.
    let is_one = changed.each_ref().map(|changed| as_one(&[changed, changed], &inputs).is_some());
    assert_eq!(is_one, [true, true, false, true, false]);
    assert_eq!(as_one(&[], &inputs), None);
}

#[test]
fn what_cancels_in_a_sum_is_not_counted_twice() {
    // (x y + 2) + (3 - x y) = 5; the surfaces list the inputs in different orders. The range of each alone is several units wide.
    let model = Model {
        inputs: vec![input("x", [1.0, 2.0]), input("y", [-1.0, 2.0]), input("z", [0.0, 9.0])],
        surfaces: vec![
            surface("a", &["y", "x"], &[(&[1, 1], 1.0), (&[0, 0], 2.0)]),
            surface("b", &["x", "y"], &[(&[1, 1], -1.0), (&[0, 0], 3.0)]),
            surface("c", &["x"], &[(&[1], 0.0), (&[0], 0.5)]),
        ],
        ..Model::default()
    };
    let found = Enclosed::of(&model, &sum(&["a", "b", "c"]));
    assert!((found.range.low - 5.5).abs() < 1e-14 && (found.range.high - 5.5).abs() < 1e-14, "{:?}", found.range);
    let names: Vec<&str> = found.inputs.iter().map(|input| input.name.as_str()).collect();
    assert_eq!(names, ["x", "y"]);
}

#[test]
fn the_point_that_is_named_may_lie_inside_for_one_and_in_the_middle_for_the_others() {
    // x (x - 2) over [0.5, 3] has its minimum -1 at 1. It does not depend on y, so the point has the y of the other summand's maximum: the middle of
    // [2, 4], where -(y - 3)^2/100 is 0. At the corners x (x - 2) is at least -0.75, and the other summand is -0.01.
    let bowl: &[(&[u32], f64)] = &[(&[2], 1.0), (&[1], -2.0)];
    let hill: &[(&[u32], f64)] = &[(&[2], -0.01), (&[1], 0.06), (&[0], -0.09)];
    let mut held = surface("hill", &["y"], hill);
    held.output_range = Some([-9.0, 9.0]);
    let mut model = Model {
        inputs: vec![input("x", [0.5, 3.0]), input("y", [2.0, 4.0])],
        surfaces: vec![surface("bowl", &["x"], bowl), held],
        ..Model::default()
    };
    let found = violation_of(&model, &sum(&["bowl", "hill"]), Condition::Positive);
    assert_eq!((found.at[1].0.as_str(), found.at[1].1), ("y", 3.0), "{found:?}");
    assert!((found.at[0].1 - 1.0).abs() < 1e-3 && found.what.starts_with("found -1 at x = "), "{found:?}");
    // The same with opposite signs, against the other limit.
    for surface in &mut model.surfaces {
        surface.terms.iter_mut().for_each(|term| term.coefficient = -term.coefficient);
    }
    let found = violation_of(&model, &sum(&["bowl", "hill"]), Condition::Below(0.9));
    assert_eq!(found.at[1].1, 3.0, "{found:?}");
    assert!((found.at[0].1 - 1.0).abs() < 1e-3 && found.what.starts_with("found 1 at x = "), "{found:?}");
}

#[test]
fn a_corner_is_named_where_the_sum_is_worst_there() {
    // Both surfaces saturate at -2.5. Each alone has this minimum along a part of the box. Of the candidates only the corner x = 3, y = -3 has the
    // minimum of both.
    let model = Model {
        inputs: vec![input("x", [-3.0, 3.0]), input("y", [-3.0, 3.0])],
        surfaces: vec![
            Surface { output_range: Some([-2.5, 9.0]), ..surface("a", &["x", "y"], &[(&[1, 0], -1.0), (&[0, 1], 0.1)]) },
            Surface { output_range: Some([-2.5, 9.0]), ..surface("b", &["x", "y"], &[(&[1, 0], 0.1), (&[0, 1], 1.0)]) },
        ],
        ..Model::default()
    };
    let found = violation_of(&model, &sum(&["a", "b"]), Condition::Positive);
    assert_eq!(found.at, [("x".to_string(), 3.0), ("y".to_string(), -3.0)], "{found:?}");
}

#[test]
fn the_corners_of_a_box_are_all_there_up_to_eight_inputs() {
    let box_of = |count: usize| -> Vec<Input> { (0..count).map(|k| input("x", [-(k as f64), k as f64 + 1.0])).collect() };
    assert_eq!(corners(&box_of(2)), [[0.0, -1.0], [1.0, -1.0], [0.0, 2.0], [1.0, 2.0]]);
    assert_eq!(corners(&box_of(0)), [[0.0; 0]]);
    let mut of_eight = corners(&box_of(8));
    of_eight.sort_by(|a, b| a.partial_cmp(b).unwrap());
    of_eight.dedup();
    assert_eq!(of_eight.len(), 256);
    assert!(corners(&box_of(9)).is_empty());
}

#[test]
fn numbers_for_a_reader_have_six_digits_and_an_exponent_only_where_they_need_it() {
    for (value, expected) in [
        (0.0, "0"),
        (-0.7559, "-0.7559"),
        (31.415926535, "31.4159"),
        (1e-4, "0.0001"),
        (1.5e-4, "0.00015"),
        (9.9999e-5, "9.9999e-5"),
        (-1e-5, "-1e-5"),
        (9_999_994.0, "9999990"),
        (1e7, "1e7"),
        (-1.5e7, "-1.5e7"),
        (1.0 / 3.0, "0.333333"),
    ] {
        assert_eq!(short(value), expected);
    }
}

#[test]
fn each_part_has_its_own_enclosure() {
    let model = Model {
        name: "m".to_string(),
        inputs: vec![input("x", [0.0, 1.0])],
        surfaces: vec![Surface { unit: "1".to_string(), ..surface("s", &["x"], &[(&[1], 1.0)]) }],
        compensators: vec![crate::model::Compensator {
            name: "k".to_string(),
            sample_time: 0.001,
            natural_frequency: Scheduled::Fixed(10.0),
            zero_damping: Scheduled::Fixed(0.25),
            pole_damping: Scheduled::Fixed(0.75),
            pole_frequency: Some(Scheduled::Fixed(9.0)),
        }],
    };
    let found = certify(&Checked::from_model(&model).unwrap_or_else(|faults| panic!("{faults}")), 0);
    let all = [found.natural_frequency, found.zero_damping, found.pole_damping, found.pole_frequency.unwrap()];
    assert_eq!(all, [10.0, 0.25, 0.75, 9.0].map(Interval::point));
}

#[test]
fn a_sum_with_a_sigmoid_is_no_one_polynomial() {
    let inputs = [input("a", [0.0, 1.0])];
    let plain = surface("p", &["a"], &[(&[1], 1.0)]);
    let step = crate::model::Sigmoid { input: "a".to_string(), at: 0.5, width: 0.1 };
    let bent = Surface { sigmoids: vec![step], ..surface("s", &["a"], &[(&[0, 1], 1.0)]) };
    assert!(as_one(&[&plain, &plain], &inputs).is_some());
    assert!(as_one(&[&plain, &bent], &inputs).is_none() && as_one(&[&bent], &inputs).is_none());
}
