//! Grids, rows and the exchange of points, one at a time.

use super::*;
use crate::constrain::tests::{Case, bounds, line};
use crate::random::Random;
use crate::reference::whole;

/// Points without any, of a case.
fn with<T>(case: &Case, act: impl FnOnce(&mut Points<'_>) -> T) -> T {
    let (task, free, claims) = (case.task(), case.problem.coefficients(), case.claims());
    act(&mut Points { task: &task, free: &free, claims: &claims, lengths: Vec::new(), points: Vec::new() })
}

#[test]
fn the_first_grid_has_some_hundred_points_for_all_claims_together() {
    let steps = |inputs: usize, claims: usize| {
        let rows: Vec<(Vec<f64>, f64)> = (0..2).map(|k| (vec![f64::from(k); inputs], f64::from(k))).collect();
        let constant = vec![0; inputs];
        let case = Case::new(&vec![[0.0, 1.0]; inputs], &[&constant], &rows, &vec![bounds(Some(-1.0), None); claims]);
        with(&case, |points| {
            points.first().unwrap();
            assert_eq!(points.points.len() % claims, 0);
            points.points.len() / claims
        })
    };
    assert_eq!([steps(1, 1), steps(1, 9), steps(1, 10), steps(1, 50), steps(1, 51), steps(1, 151)], [16, 16, 15, 3, 2, 2]);
    assert_eq!([steps(2, 1), steps(2, 16), steps(2, 17), steps(3, 1), steps(4, 1), steps(5, 1)], [144, 9, 4, 125, 81, 32]);
}

#[test]
fn the_grid_spans_the_sides_and_leaves_out_what_is_not_supported() {
    let mut case = Case::new(&[[2.0, 5.0]], &[&[0], &[1]], &line(&[2.0, 5.0], |x| x), &[bounds(Some(0.0), None)]);
    let shares = |case: &Case| {
        with(case, |points| {
            points.first().unwrap();
            points.points.iter().map(|point| point.shares[0]).collect::<Vec<_>>()
        })
    };
    assert_eq!(shares(&case), (0..16).map(|k| f64::from(k) / 15.0).collect::<Vec<_>>());
    // Up to 3.5, half of them.
    case.surface.support = vec![rsm_core::model::HalfSpace { normal: vec![1.0], bound: 3.5 }];
    assert_eq!(shares(&case), (0..8).map(|k| f64::from(k) / 15.0).collect::<Vec<_>>());
}

#[test]
fn a_row_asks_what_its_claim_asks_of_the_coefficients() {
    // n . c >= d is g(b + R^-1 c) >= shift spread, divided by the length of the row; near a place where no coefficient counts, a share of the shift.
    let mut random = Random::new(3);
    let rows: Vec<(Vec<f64>, f64)> = [-2.0, 0.0, 1.0, 3.0, 4.0].into_iter().map(|x| (vec![x], whole(&mut random, 5))).collect();
    for (terms, shares_of_shift) in [(&[&[0][..], &[1], &[2]][..], [1.0, 1.0]), (&[&[1], &[2]], [1.0, 0.0])] {
        let case = Case::new(&[[-2.0, 4.0]], terms, &rows, &[bounds(Some(-0.5), Some(3.5))]);
        with(&case, |points| {
            points.first().unwrap();
            let (first, longest) = (points.points.len(), points.lengths[0]);
            // At x = 4 is the longest row of the grid: its squares are 1, 16 and 256, or the last two.
            assert_eq!(longest, (terms.len() as f64 - 2.0 + 16.0 + 256.0).sqrt());
            let at = |x: f64| (x + 2.0) / 6.0;
            points.push(1, vec![at(2.5)], false).unwrap();
            // Near 0 a row (x, x^2) has the length x.
            points.push(0, vec![at(0.0625)], false).unwrap();
            let shift = 0.125;
            let asked = points.rows(shift);
            assert_eq!(asked.len(), points.points.len());
            for (k, (point, row)) in points.points.iter().zip(&asked).enumerate() {
                let claim = &points.claims[point.claim];
                let place = claim.point(&point.shares);
                let of = claim.row(&place);
                let length = point.normal.iter().map(|x| *x * *x).sum::<Dd>().to_f64();
                assert!((length - 1.0).abs() < 1e-15);
                let c: Vec<Dd> = terms.iter().map(|_| Dd::from(whole(&mut random, 5))).collect();
                let step = points.task.problem.coefficients_of(c.clone());
                let moved: Dd = of.iter().zip(points.free.iter().zip(&step)).map(|(x, (b, step))| *x * (*b + *step)).sum();
                let norm = norm(&of);
                let share = if k < first || shares_of_shift[1] == 1.0 { 1.0 } else { (100.0 * norm / longest).min(1.0) };
                let share = if k < first { (100.0 * norm / points.lengths[point.claim]).min(1.0) } else { share };
                let value = moved + claim.offset() - Dd::from(shift * points.task.spread * share);
                let projected: Vec<Dd> = points.task.problem.projected(of);
                let own = projected.iter().map(|x| *x * *x).sum::<Dd>().sqrt();
                let found = row.normal.iter().zip(&c).map(|(n, c)| *n * *c).sum::<Dd>() - row.distance;
                assert!((found - value / own).abs().to_f64() < 1e-13, "{k}: {found:?} {:?}", value / own);
            }
            // The share matters there.
            let last = points.points.last().unwrap();
            let full = points.task.spread
                / points
                    .task
                    .problem
                    .projected(points.claims[0].row(&[0.0625]))
                    .iter()
                    .map(|x| *x * *x)
                    .sum::<Dd>()
                    .sqrt()
                    .to_f64();
            let share = last.gain.to_f64() / full;
            let expected = if shares_of_shift[1] == 1.0 { 1.0 } else { 100.0 * 0.0625f64.hypot(0.00390625) / longest };
            assert!((share - expected.min(1.0)).abs() < 1e-14, "{share} {expected}");
        });
    }
}

#[test]
fn where_no_coefficient_counts_a_claim_holds_or_is_named() {
    let x = [1.0, 2.0, 3.0];
    let pushed = |constraint: crate::spec::Constraint, k: usize| {
        let case = Case::new(&[[0.0, 4.0]], &[&[1]], &line(&x, |x| x), &[bounds(Some(-9.0), None), constraint]);
        with(&case, |points| {
            points.lengths = vec![4.0; 2];
            let answer = points.push(k, vec![0.0], false);
            (answer, points.points.len())
        })
    };
    // The spread is 2: what a proof may miss is 2e-12 of it.
    assert_eq!(pushed(bounds(Some(0.0), None), 1), (Ok(()), 0));
    assert_eq!(pushed(bounds(Some(2e-12), None), 1), (Ok(()), 0));
    assert_eq!(pushed(bounds(Some(2.5e-12), None), 1), (Err(1), 0));
    assert_eq!(pushed(bounds(Some(1.0), None), 1), (Err(1), 0));
    assert_eq!(pushed(bounds(Some(1.0), None), 0), (Ok(()), 0));
}

#[test]
fn points_come_where_a_claim_is_broken_and_go_when_they_are_idle() {
    let case = Case::new(&[[0.0, 4.0]], &[&[0], &[1]], &line(&[0.0, 4.0], |x| x), &[bounds(Some(-9.0), Some(9.0))]);
    let spread = 4.0;
    with(&case, |points| {
        points.first().unwrap();
        let first = points.points.len();
        let found = |seen: f64, share: f64| Found { bound: seen, seen, shares: vec![share] };
        let slack = crate::constrain::SLACK * spread;
        // Not where it holds, to the slack.
        assert_eq!(points.exchange(&[], &[found(0.0, 0.3), found(-slack, 0.41)], &[]), Ok(false));
        assert_eq!(points.points.len(), first);
        // The second is broken, and a valley of the first is given.
        assert_eq!(points.exchange(&[], &[found(1.0, 0.3), found(-1.25 * slack, 0.41)], &[(0, vec![0.35])]), Ok(true));
        let new =
            |points: &Points<'_>| points.points[first..].iter().map(|point| (point.claim, point.shares[0])).collect::<Vec<_>>();
        assert_eq!(new(points), [(1, 0.41), (0, 0.35)]);
        // Known places are not new; the same place of another claim is.
        assert_eq!(points.exchange(&[], &[found(1.0, 0.3), found(-1.0, 0.41)], &[(0, vec![0.35])]), Ok(false));
        assert_eq!(points.exchange(&[], &[found(-1.0, 0.41), found(1.0, 0.3)], &[]), Ok(true));
        assert_eq!(new(points), [(1, 0.41), (0, 0.35), (0, 0.41)]);
        // The first held in the round before; the others, and the grid, do not hold.
        let nothing = [found(1.0, 0.3), found(1.0, 0.3)];
        assert_eq!(points.exchange(&[first], &nothing, &[]), Ok(false));
        for _ in 0..2 {
            assert_eq!(points.exchange(&[], &nothing, &[]), Ok(false));
        }
        // The second came with two rounds before the third.
        assert_eq!(new(points).len(), 3);
        points.exchange(&[], &nothing, &[]).unwrap();
        assert_eq!(new(points), [(1, 0.41), (0, 0.41)], "six rounds idle");
        points.exchange(&[], &nothing, &[]).unwrap();
        assert_eq!(new(points), [(1, 0.41), (0, 0.41)]);
        points.exchange(&[], &nothing, &[]).unwrap();
        assert_eq!(new(points), [(1, 0.41)]);
        points.exchange(&[], &nothing, &[]).unwrap();
        assert_eq!(new(points), []);
        assert_eq!(points.points.len(), first, "the grid stays");
    });
}

#[test]
fn local_minima_are_looked_for_where_points_hold_and_where_chance_wants() {
    // 5 - x^2 below 4, and above -20, which it is.
    let rows = line(&[-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0], |x| 5.0 - x * x);
    let case = Case::new(&[[-4.0, 4.0]], &[&[0], &[2]], &rows, &[bounds(Some(-20.0), Some(4.0))]);
    with(&case, |points| {
        points.first().unwrap();
        let mut random = Random::new(0);
        let found = points.local_minima(&[5.0, -1.0], &[], &mut random);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].0 == 1 && (found[0].1[0] - 0.5).abs() < 1e-8, "{found:?}");
        assert_eq!(points.local_minima(&[4.0, -1.0], &[], &mut random), [], "4 at most");
        // To the slack, 15e-12.
        assert_eq!(points.local_minima(&[4.0 + 14e-12, -1.0], &[], &mut random), []);
        assert_eq!(points.local_minima(&[4.0 + 20e-12, -1.0], &[], &mut random).len(), 1);
    });
    // x^4 with a dent of a thousandth of the range, which chance does not meet, but a point that holds does.
    let terms: &[&[u32]] = &[&[0], &[1]];
    let mut case =
        Case::new(&[[0.0, 1.0]], terms, &line(&[0.0, 1.0], |x| x), &[bounds(Some(0.0), None), bounds(None, Some(1.0))]);
    case.surface.support = vec![rsm_core::model::HalfSpace { normal: vec![1.0], bound: 1e-4 }];
    with(&case, |points| {
        points.first().unwrap();
        assert_eq!(points.points.iter().map(|point| (point.claim, point.shares[0])).collect::<Vec<_>>(), [(0, 0.0), (1, 0.0)]);
        // -1 everywhere: only the point at 0 lies in the region, and it is one of the first claim.
        assert_eq!(points.local_minima(&[-1.0, 0.0], &[], &mut Random::new(0)), []);
        assert_eq!(points.local_minima(&[-1.0, 0.0], &[0], &mut Random::new(0)), [(0, vec![0.0])]);
        assert_eq!(points.local_minima(&[-1.0, 0.0], &[1], &mut Random::new(0)), []);
    });
}

#[test]
fn the_longest_row_of_a_claim_is_that_of_its_grid() {
    let case = Case::new(&[[0.0, 0.5]], &[&[1]], &line(&[0.0, 0.5], |x| x), &[bounds(Some(-9.0), None)]);
    with(&case, |points| {
        points.first().unwrap();
        assert_eq!(points.lengths, [0.5]);
    });
}
