//! Matrices whose least eigenvalue is known and, in most of them, slightly above or below the bound in question.

use rsm_core::number::{Rational, exact};

use super::*;
use crate::random::Random;

/// More than any proof below takes.
const ENOUGH: u64 = 1 << 40;

fn monomial(powers: &[u32], coefficient: f64) -> Monomial {
    Monomial { powers: powers.to_vec(), coefficient: Interval::point(coefficient) }
}

fn around(low: f64, high: f64, dimensions: usize) -> Vec<Interval> {
    vec![Interval::new(low, high); dimensions]
}

/// A polynomial of small whole numbers and one over a power of 2, exact in f64.
type Exact = Vec<(Vec<u32>, f64)>;

fn entry(terms: &Exact) -> Vec<Monomial> {
    terms.iter().map(|(powers, value)| monomial(powers, *value)).collect()
}

fn proven(entries: &[Vec<Monomial>], sides: &[Interval], spaces: &[HalfSpace], aim: f64) -> Option<f64> {
    least_eigenvalue(entries, sides, spaces, aim, &mut Work { left: ENOUGH })
}

/// A matrix over a region.
struct Case {
    name: &'static str,
    entries: Vec<Exact>,
    sides: Vec<Interval>,
    spaces: Vec<HalfSpace>,
}

/// The least eigenvalue of each is 0: at one point inside, at a corner, along a curve, along a curve of matrices, along the edge of the region.
fn singular() -> Vec<Case> {
    let inside: Exact = vec![(vec![2, 0], 1.0), (vec![0, 2], 1.0), (vec![1, 0], -0.5), (vec![0, 0], 0.0625)];
    let corner: Exact = vec![(vec![0, 0], 3.0), (vec![1, 0], -1.0), (vec![0, 1], 2.0)];
    // (x - y^2)^2.
    let curve: Exact = vec![(vec![2, 0], 1.0), (vec![1, 2], -2.0), (vec![0, 4], 1.0)];
    // (1, x)'(1, x) has the eigenvalue 0 everywhere; with y^2 in one place where y is 0.
    let lines = [vec![(vec![0, 0], 1.0)], vec![(vec![1, 0], 1.0)], vec![(vec![2, 0], 1.0), (vec![0, 2], 1.0)]];
    let bilinear =
        [vec![(vec![1, 0], 1.0), (vec![0, 0], 1.0)], vec![(vec![0, 1], 0.0)], vec![(vec![0, 1], 1.0), (vec![0, 0], 1.0)]];
    let edge: Exact = vec![(vec![0, 0], 0.5), (vec![1, 0], -1.0), (vec![0, 1], -1.0)];
    let half_space = HalfSpace { normal: vec![1.0, 1.0], bound: 0.5 };
    let case = |name, entries: &[Exact], high: f64, spaces| {
        let (entries, sides) = (entries.to_vec(), around(-1.0, high, 2));
        Case { name, entries, sides, spaces }
    };
    vec![
        case("inside", &[inside], 1.0, vec![]),
        case("corner", &[corner], 1.0, vec![]),
        case("curve", &[curve], 1.0, vec![]),
        case("lines", &lines, 1.0, vec![]),
        case("corner of a matrix", &bilinear, 3.0, vec![]),
        case("edge", &[edge], 1.0, vec![half_space]),
    ]
}

/// With so much more on the diagonal.
fn with(entries: &[Exact], more: f64) -> Vec<Vec<Monomial>> {
    let size = (1..).find(|size| size * (size + 1) / 2 == entries.len()).unwrap();
    let is_diagonal = |k: usize| (0..size).any(|a| k == a * size - a * (a + 1) / 2 + a);
    let of_entry = |(k, terms): (usize, &Exact)| {
        let zeros = vec![0; terms[0].0.len()];
        let mut entry = entry(terms);
        if is_diagonal(k) {
            entry.push(monomial(&zeros, more));
        }
        entry
    };
    entries.iter().enumerate().map(of_entry).collect()
}

#[test]
fn a_hair_below_is_never_proven_and_a_hair_above_is() {
    for Case { name, entries, sides, spaces } in singular() {
        for hair in [1e-9, 1e-12] {
            assert_eq!(proven(&with(&entries, -hair), &sides, &spaces, -1e-3 * hair), None, "{name} {hair}");
        }
        for hair in [1e-9, 1e-6, 1.0] {
            let bound = proven(&with(&entries, hair), &sides, &spaces, -1e-3 * hair);
            assert!(bound.is_some_and(|bound| bound >= -1e-3 * hair && bound <= hair), "{name} {hair}: {bound:?}");
        }
    }
}

#[test]
fn no_bound_of_a_random_matrix_is_above_an_eigenvalue() {
    let mut random = Random::new(5);
    for round in 0..25 {
        let (size, dimensions) = (1 + random.below(3) as usize, 1 + random.below(3) as usize);
        let mut draw = || (64.0 * (random.share() - 0.5)).round() / 16.0;
        let quadratic = |draw: &mut dyn FnMut() -> f64| -> Exact {
            let mut terms = vec![(vec![0; dimensions], draw())];
            for a in 0..dimensions {
                for b in 0..=a {
                    let power = |k: usize| u32::from(k == a) + u32::from(k == b);
                    terms.push(((0..dimensions).map(power).collect(), draw()));
                }
            }
            terms
        };
        let entries: Vec<Vec<Monomial>> = (0..size * (size + 1) / 2).map(|_| entry(&quadratic(&mut draw))).collect();
        let sides = around(-0.75, 1.0, dimensions);
        // The least at the points of a grid.
        let value = |terms: &[Monomial], x: &[f64]| -> f64 {
            let of = |term: &Monomial| {
                x.iter().zip(&term.powers).map(|(x, p)| x.powi(*p as i32)).product::<f64>() * term.coefficient.low
            };
            terms.iter().map(of).sum()
        };
        let mut least = f64::INFINITY;
        for k in 0..13usize.pow(dimensions as u32) {
            let x: Vec<f64> =
                (0..dimensions).map(|axis| -0.75 + 1.75 * (k / 13usize.pow(axis as u32) % 13) as f64 / 12.0).collect();
            let place = |a: usize, b: usize| a.min(b) * size - a.min(b) * (a.min(b) + 1) / 2 + a.max(b);
            let matrix = nalgebra::DMatrix::from_fn(size, size, |a, b| value(&entries[place(a, b)], &x));
            least = least.min(matrix.symmetric_eigenvalues().min());
        }
        // Between the points of a grid of a sixth it may be some tenths less: curvatures are up to 8 times the size.
        for aim in [least - 1.0, least - 0.01, least + 1e-9] {
            let bound = least_eigenvalue(&entries, &sides, &[], aim, &mut Work { left: 1 << 28 });
            assert!(bound.is_none_or(|bound| bound >= aim && bound <= least + 1e-12), "{round}: {bound:?} {aim}");
            assert!(aim > least - 0.5 || bound.is_some(), "{round}: {aim}");
        }
    }
}

#[test]
fn a_bound_counts_what_a_coefficient_may_be() {
    // 1 + x^2, each coefficient unsure by a sixteenth: at least 15/16 at 0, and for -1 - x y of both 2 x 2 entries beside the diagonal one row more.
    let unsure = |value: f64| Interval::new(value - 0.0625, value + 0.0625);
    let entry =
        vec![Monomial { powers: vec![0], coefficient: unsure(1.0) }, Monomial { powers: vec![2], coefficient: unsure(1.0) }];
    let of = |aim: f64| proven(std::slice::from_ref(&entry), &around(-1.0, 1.0, 1), &[], aim);
    assert_eq!(of(0.9375 + 1e-9), None);
    assert!(of(0.85).is_some_and(|bound| bound <= 0.9375), "{:?}", of(0.85));
    let beside = vec![Monomial { powers: vec![0], coefficient: unsure(0.0) }];
    let matrix = [entry.clone(), beside, entry];
    let of = |aim: f64| proven(&matrix, &around(-1.0, 1.0, 1), &[], aim);
    assert_eq!(of(0.875 + 1e-9), None);
    assert!(of(0.75).is_some_and(|bound| bound <= 0.875), "{:?}", of(0.75));
}

#[test]
fn only_the_region_counts() {
    // x + 2 y over [0, 4] x [-1, 1], where it is at least 1.5 only in a part.
    let line = [vec![monomial(&[1, 0], 1.0), monomial(&[0, 1], 2.0)]];
    let sides = [Interval::new(0.0, 4.0), Interval::new(-1.0, 1.0)];
    let cut = |normal: [f64; 2], bound: f64| vec![HalfSpace { normal: normal.to_vec(), bound }];
    assert_eq!(proven(&line, &sides, &[], -2.0 + 1e-6), None);
    assert!(proven(&line, &sides, &[], -2.0 - 1e-6).is_some());
    assert!(proven(&line, &sides, &cut([-1.0, -2.0], -1.5), 1.5 - 1e-6).is_some());
    assert_eq!(proven(&line, &sides, &cut([-1.0, -2.0], -1.5), 1.5 + 1e-6), None);
    assert_eq!(proven(&line, &sides, &cut([1.0, 2.0], 1.5), 1.5 - 1e-6), None, "the other side");
    // No point of the box is in it.
    assert_eq!(proven(&line, &sides, &cut([1.0, 0.0], -0.5), 99.0), Some(f64::INFINITY));
    assert!(proven(&line, &sides, &cut([1.0, 0.0], 9.0), -2.0 - 1e-6).is_some(), "all of them are");
    // One corner, too small for the points that are drawn: it is found by halves.
    let bound = proven(&line, &sides, &cut([-1.0, -2.0], -5.999), 5.9);
    assert!(bound.is_some_and(|bound| (5.9..=6.0).contains(&bound)), "{bound:?}");
    // Across a variable of which nothing depends a half-space is left out.
    let flat = [vec![monomial(&[1, 0], 1.0)]];
    assert_eq!(proven(&flat, &sides, &cut([-1.0, -2.0], -5.5), 1.0), None);
    assert!(proven(&flat, &sides, &cut([-1.0, 0.0], -3.0), 2.9).is_some());
}

#[test]
fn what_does_not_bend_has_the_eigenvalue_zero_to_the_bit() {
    let nothing: Vec<Monomial> = Vec::new();
    let sides = around(-1.0, 1.0, 1);
    let of =
        |entries: &[&Vec<Monomial>], aim: f64| proven(&entries.iter().copied().cloned().collect::<Vec<_>>(), &sides, &[], aim);
    let two = vec![monomial(&[0], 2.0), monomial(&[1], 1.0)];
    assert_eq!(of(&[&nothing, &nothing, &nothing], -1e-12), Some(0.0));
    assert_eq!(of(&[&two, &nothing, &nothing], -1e-12), Some(0.0));
    assert_eq!(of(&[&two, &nothing, &nothing], 1e-12), None);
    assert!(of(&[&two, &nothing, &two], 0.9).is_some_and(|bound| bound <= 1.0));
    // A side without width is its place.
    let sides = [Interval::point(0.5), Interval::new(-1.0, 1.0)];
    let of = |aim| proven(&[vec![monomial(&[1, 0], 2.0), monomial(&[0, 1], 1.0)]], &sides, &[], aim);
    assert!(of(-1e-9).is_some() && of(1e-9).is_none());
    assert!(proven(&[vec![monomial(&[1, 0], 2.0)]], &sides[..1], &[], 1.0 - 1e-9).is_some_and(|bound| bound <= 1.0));
}

#[test]
fn work_is_counted_by_steps_and_ends_a_search() {
    // Two inputs and two rows of degree 2: 6 monomials times 3.
    let form = [
        vec![monomial(&[0, 0], 2.0), monomial(&[2, 0], 1.0)],
        vec![monomial(&[1, 1], 1.0)],
        vec![monomial(&[0, 0], 2.0), monomial(&[0, 2], 1.0)],
    ];
    let sides = around(-1.0, 1.0, 2);
    let mut work = Work { left: ENOUGH };
    assert!(least_eigenvalue(&form, &sides, &[], 1e-3, &mut work).is_some());
    let spent = ENOUGH - work.left;
    assert!(spent > 0 && spent.is_multiple_of(18u64.pow(3)) && spent <= 20 * 18u64.pow(3), "{spent}");
    let mut work = Work { left: spent - 1 };
    assert_eq!((least_eigenvalue(&form, &sides, &[], 1e-3, &mut work), work.left), (None, 18u64.pow(3) - 1));
    let mut work = Work { left: spent };
    assert!(least_eigenvalue(&form, &sides, &[], 1e-3, &mut work).is_some() && work.left == 0);
    // What is out of range or has too many moments is not asked.
    let huge = [vec![monomial(&[0, 0], 1e308), monomial(&[2, 0], 1e308), monomial(&[1, 0], f64::INFINITY)]];
    assert_eq!(proven(&huge, &sides, &[], 0.0), None);
    let powers = |k: usize| (0..8).map(|j| if j == k { 6 } else { 0 }).collect::<Vec<u32>>();
    let wide = [(0..8).map(|k| monomial(&powers(k), 1.0)).collect::<Vec<_>>()];
    let mut work = Work { left: ENOUGH };
    assert_eq!((least_eigenvalue(&wide, &around(-1.0, 1.0, 8), &[], -1.0, &mut work), work.left), (None, ENOUGH));
}

/// The scaled polynomial and the weights hold what they must for every point of the region, in exact arithmetic.
#[test]
fn the_region_in_its_own_variables_is_no_smaller() {
    let mut random = Random::new(11);
    let (mut inside, mut least) = (0, exact(1.0));
    for _ in 0..40 {
        let mut draw = |width: f64| width * (random.share() - 0.5);
        let sides: Vec<Interval> = (0..2)
            .map(|_| {
                let (a, b) = (draw(7.0), draw(7.0));
                Interval::new(a.min(b), a.max(b))
            })
            .collect();
        let normal = vec![draw(3.0), draw(3.0)];
        let at_middle: f64 = sides.iter().zip(&normal).map(|(side, n)| n * side.low.midpoint(side.high)).sum();
        let space = HalfSpace { bound: at_middle + draw(0.5), normal };
        let terms: Vec<Monomial> = [[0, 0], [1, 0], [2, 1], [0, 3]].map(|powers| monomial(&powers, draw(2.0))).to_vec();
        let scaling = Scaling::of(&sides);
        let polynomial = scaling.polynomial(&terms);
        let Some(weights) = scaling.weights(std::slice::from_ref(&space), &[0, 1]) else { continue };
        let (centres, halves) = scaling.exact();
        for round in 0..12 {
            let mut x: Vec<Rational> = sides
                .iter()
                .map(|side| {
                    exact(match round {
                        0 => side.low,
                        1 => side.high,
                        _ => (side.low + draw(1.0).abs() * 2.0 * (side.high - side.low)).clamp(side.low, side.high),
                    })
                })
                .collect();
            if round % 2 == 0 && space.normal[0] != 0.0 {
                // Onto the edge of the half-space, to the last digit.
                x[0] = (exact(space.bound) - exact(space.normal[1]) * &x[1]) / exact(space.normal[0]);
            }
            if x.iter().zip(&sides).any(|(x, side)| *x < exact(side.low) || *x > exact(side.high)) {
                continue;
            }
            let t: Vec<Rational> = (0..2).map(|k| (&x[k] - &centres[k]) / &halves[k]).collect();
            assert!(t.iter().all(|t| *t <= exact(1.0) && *t >= exact(-1.0)));
            let power = |t: &[Rational], powers: &[u32]| {
                t.iter().zip(powers).fold(exact(1.0), |product, (t, p)| (0..*p).fold(product, |product, _| product * t))
            };
            let value: Rational = terms.iter().map(|term| exact(term.coefficient.low) * power(&x, &term.powers)).sum();
            let [mut low, mut high] = [exact(0.0), exact(0.0)];
            for (powers, coefficient) in &polynomial {
                let power = power(&t, powers);
                let ends = [exact(coefficient.low) * &power, exact(coefficient.high) * &power];
                low += ends.iter().min().unwrap();
                high += ends.iter().max().unwrap();
            }
            assert!(low <= value && value <= high);
            // Some digits less than f64 has: no more is added than rounding takes.
            assert!(high - low < exact(1e-12));
            let left = exact(space.bound) - (0..2).map(|k| exact(space.normal[k]) * &x[k]).sum::<Rational>();
            if left < exact(0.0) {
                continue;
            }
            inside += 1;
            for weight in &weights {
                let value: Rational = weight.terms.iter().map(|(powers, factor)| exact(*factor) * power(&t, powers)).sum();
                assert!(value >= exact(0.0), "{weight:?}");
                if weight.terms.len() == 3 {
                    assert!(&value - &left < exact(1e-14));
                    least = least.min(value);
                }
            }
        }
    }
    // Points on the edge itself are among them, where what rounding takes counts.
    assert!(inside > 100 && least < exact(1e-15), "{inside}");
}

#[test]
fn entries_have_their_places() {
    assert_eq!([1, 3, 6, 10].map(rows_of), [1, 2, 3, 4]);
    let all: Vec<[usize; 2]> = (0..4).flat_map(|a| (a..4).map(move |b| [a, b])).collect();
    for (k, [a, b]) in all.iter().enumerate() {
        assert_eq!([place(4, *a, *b), place(4, *b, *a)], [k, k]);
    }
}

#[test]
fn a_cell_is_halved_across_what_varies_most_there() {
    let sides = [Interval::new(0.0, 4.0), Interval::new(-1.0, 1.0)];
    assert_eq!(widest(&sides, &sides, &[(0, 1.0), (1, 1.0)]), Some(0));
    assert_eq!(widest(&sides, &sides, &[(0, 1.0), (1, 1.5)]), Some(1));
    // A half of a side counts a quarter.
    let half = [Interval::new(2.0, 4.0), sides[1]];
    assert_eq!([3.9, 4.1].map(|of_first| widest(&half, &sides, &[(0, of_first), (1, 1.0)])), [Some(1), Some(0)]);
    let half = [sides[0], Interval::new(0.5, 1.0)];
    assert_eq!([15.0, 17.0].map(|of_second| widest(&half, &sides, &[(0, 1.0), (1, of_second)])), [Some(0), Some(1)]);
    assert_eq!(widest(&sides, &sides, &[]), None);
}

/// x + 2 y over a corner of [0, 4] x [-1, 1], where it is 6 and lower by so much at most; in so many cells.
fn in_corner(lower: f64, cells: usize) -> Option<f64> {
    let line = [vec![monomial(&[1, 0], 1.0), monomial(&[0, 1], 2.0)]];
    let sides = [Interval::new(0.0, 4.0), Interval::new(-1.0, 1.0)];
    let corner = [HalfSpace { normal: vec![-1.0, -2.0], bound: lower - 6.0 }];
    in_cells(&line, &sides, &corner, 6.0 - 10.0 * lower, &mut Work { left: ENOUGH }, cells)
}

#[test]
fn a_corner_is_found_by_halves_and_by_so_many() {
    // A corner of 0.7^17 takes eleven halves, two cells each.
    let lower = 0.7_f64.powi(17);
    assert_eq!([20, 21].map(|cells| in_corner(lower, cells)), [None; 2]);
    let bound = in_corner(lower, 22);
    assert!(bound.is_some_and(|bound| bound >= 6.0 - 10.0 * lower && bound <= 6.0 - lower), "{bound:?}");
    // One of 62 cells is found, and one of 66 is too small.
    let found = [37, 39].map(|power| {
        let lower = 0.7_f64.powi(power);
        let line = [vec![monomial(&[1, 0], 1.0), monomial(&[0, 1], 2.0)]];
        let corner = [HalfSpace { normal: vec![-1.0, -2.0], bound: lower - 6.0 }];
        proven(&line, &[Interval::new(0.0, 4.0), Interval::new(-1.0, 1.0)], &corner, 6.0 - 10.0 * lower).is_some()
    });
    assert_eq!(found, [true, false]);
}

#[test]
fn a_half_space_across_a_variable_of_which_nothing_depends_is_not_asked() {
    let flat = [vec![monomial(&[1, 0], 1.0)]];
    let sides = [Interval::new(0.0, 4.0), Interval::new(-1.0, 1.0)];
    let cut = |normal: [f64; 2], bound: f64| vec![HalfSpace { normal: normal.to_vec(), bound }];
    assert_eq!(proven(&flat, &sides, &cut([-1.0, -2.0], -5.5), 1.0), None);
    assert!(proven(&flat, &sides, &cut([-1.0, 0.0], -3.0), 2.9).is_some_and(|bound| bound <= 3.0));
}

#[test]
fn an_input_without_bend_may_be_asked_for_zero_itself() {
    let nothing: Vec<Monomial> = Vec::new();
    let two = vec![monomial(&[0], 2.0), monomial(&[1], 1.0)];
    assert_eq!(proven(&[two, nothing.clone(), nothing], &around(-1.0, 1.0, 1), &[], 0.0), Some(0.0));
}

#[test]
fn the_second_degree_is_tried_before_halves() {
    // (x^2 - 1/4)^2 beside a constant: its highest power counts.
    let quartic = [vec![monomial(&[0], 1.0625), monomial(&[2], -0.5), monomial(&[4], 1.0)]];
    assert!(proven(&quartic, &around(-1.0, 1.0, 1), &[], 0.99).is_some_and(|bound| bound <= 1.0));
    // xy + yz + zx is -1 at least; squares of the first degree give -3/2, and those of the second know three signs at once.
    let signs = [vec![monomial(&[1, 1, 0], 1.0), monomial(&[0, 1, 1], 1.0), monomial(&[1, 0, 1], 1.0)]];
    let mut work = Work { left: ENOUGH };
    let bound = least_eigenvalue(&signs, &around(-1.0, 1.0, 3), &[], -1.2, &mut work);
    assert!(bound.is_some_and(|bound| (-1.2..=-1.0).contains(&bound)), "{bound:?}");
    // Steps of 10 moments, then of 35.
    let spent = ENOUGH - work.left;
    assert_eq!(spent, 3 * 10u64.pow(3) + 8 * 35u64.pow(3));
}

/// 1 by 1, one variable: squares of (1, t) and of 1, the second times 1 - t^2.
#[test]
fn what_is_proven_is_what_the_squares_leave() {
    use super::matrix::Matrix;
    let weights = Scaling::of(&around(-1.0, 1.0, 1)).weights(&[], &[0]).unwrap();
    let polynomial =
        Scaling::of(&around(-1.0, 1.0, 1)).polynomial(&[monomial(&[0], 4.0), monomial(&[1], 1.0), monomial(&[2], -2.0)]);
    let program = Program::new(&[polynomial], 1, &weights, 1).unwrap();
    let square = |entries: &[f64], size: usize| Matrix { size, entries: entries.to_vec() };
    // 4 + t - 2 t^2 over the scale, 4, is 1 + t/4 - t^2/2. With (1/4, 1/8; 1/8, 1/4) and 3/4: nothing is left of 0 m, and of m = 1/4 just that.
    let exactly = [square(&[0.25, 0.125, 0.125, 0.25], 2), square(&[0.75], 1)];
    assert_near(program.proven(&exactly, 0.0), 0.0);
    assert_near(program.proven(&exactly, 0.25), 0.0);
    // A sixteenth less of one entry, twice beside the diagonal: it is left.
    let less = [square(&[0.25, 0.0625, 0.0625, 0.25], 2), square(&[0.75], 1)];
    assert_near(program.proven(&less, 0.0), -0.125);
    // What stands above the diagonal is not asked.
    let beyond = [square(&[0.25, 9.0, 0.125, 0.25], 2), square(&[0.75], 1)];
    assert_near(program.proven(&beyond, 0.0), 0.0);
    // A matrix that is not positive semidefinite is no square, whatever it leaves.
    for (one, other) in
        [([-0.25, 0.125, 0.125, 0.25], 1.25), ([0.25, 0.125, 0.125, -0.25], 0.25), ([0.01, 0.125, 0.125, 0.49], 0.99)]
    {
        assert_eq!(program.proven(&[square(&one, 2), square(&[other], 1)], 0.0), f64::NEG_INFINITY);
    }
}

fn assert_near(found: f64, expected: f64) {
    assert!(found <= expected && found > expected - 1e-14, "{found:e} {expected:e}");
}
