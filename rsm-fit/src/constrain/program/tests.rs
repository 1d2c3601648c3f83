//! Programs worked by hand, and against every set of rows that could hold the answer.

use super::*;
use crate::random::Random;
use crate::reference::whole;

fn row(normal: [f64; 2], distance: f64) -> Row {
    let length = Dd::from(normal[0] * normal[0] + normal[1] * normal[1]).sqrt();
    Row { normal: normal.map(|n| Dd::from(n) / length).to_vec(), distance: Dd::from(distance) / length }
}

fn solved(rows: &[Row]) -> ([f64; 2], Vec<usize>) {
    match shortest(rows, 2) {
        Solution::Shortest { c, active } => ([c[0].to_f64(), c[1].to_f64()], active),
        other => panic!("{other:?}"),
    }
}

#[test]
fn hand_worked_programs_are_met_to_the_last_digit() {
    // The foot of the perpendicular on x + 2 y = 5; the second row does not matter, nor does the double of the first.
    let rows = [row([1.0, 2.0], 5.0), row([1.0, 0.0], -3.0), row([2.0, 4.0], 10.0)];
    assert_eq!(solved(&rows).0, [1.0, 2.0]);
    // A corner: x >= 3, y >= 4, x + y >= 5 is implied.
    let rows = [row([1.0, 0.0], 3.0), row([0.0, 1.0], 4.0), row([1.0, 1.0], 5.0)];
    assert_eq!(solved(&rows), ([3.0, 4.0], vec![0, 1]));
    assert_eq!(solved(&[row([1.0, 0.0], 0.0)]), ([0.0, 0.0], vec![]));
}

#[test]
fn nearly_parallel_rows_are_told_apart_to_the_last_digit() {
    // Rows a thousandth of a radian apart that ask n . (c - (2, 0)) >= 1: by symmetry c is on the axis, and the outermost, at
    // 0.5 rad, ask most of it: c = 2 + 1/cos 0.5.
    let rows: Vec<Row> = (-500..=500)
        .map(|k| f64::from(k) * 1e-3)
        .map(|angle| row([angle.cos(), angle.sin()], 2.0 * angle.cos() + 1.0))
        .collect();
    let (c, active) = solved(&rows);
    assert_eq!(active.len(), 2);
    assert!(active.contains(&0) && active.contains(&1000), "{active:?}");
    // One rounding of cos 0.5 and of the quotient; the solver alone is 10^-10 off.
    assert!((c[0] - (2.0 + 1.0 / 0.5f64.cos())).abs() < 1e-15 && c[1].abs() < 1e-15, "{c:?}");
}

/// The shortest c by trying every set of at most two rows: the point of the plane that lies on them and is shortest, if it keeps all others. None
/// where none does.
fn tried(rows: &[([f64; 2], f64)]) -> Option<[f64; 2]> {
    let mut found: Option<[f64; 2]> = None;
    let mut candidates = vec![[0.0, 0.0]];
    for (k, (n, d)) in rows.iter().enumerate() {
        let square = n[0] * n[0] + n[1] * n[1];
        candidates.push(n.map(|n| n * d / square));
        for (m, e) in &rows[..k] {
            let cross = n[0] * m[1] - n[1] * m[0];
            if cross != 0.0 {
                candidates.push([(d * m[1] - e * n[1]) / cross, (e * n[0] - d * m[0]) / cross]);
            }
        }
    }
    let length = |c: [f64; 2]| c[0] * c[0] + c[1] * c[1];
    for c in candidates {
        let keeps = rows.iter().all(|(n, d)| n[0] * c[0] + n[1] * c[1] >= d - 1e-12);
        if keeps && found.is_none_or(|best| length(c) < length(best)) {
            found = Some(c);
        }
    }
    found
}

#[test]
fn drawn_programs_have_the_answer_of_trying_every_corner() {
    let mut random = Random::new(1);
    let mut infeasible = 0;
    for _ in 0..60 {
        let count = 1 + random.below(6) as usize;
        let drawn: Vec<([f64; 2], f64)> = (0..count)
            .map(|_| {
                loop {
                    let n = [whole(&mut random, 5), whole(&mut random, 5)];
                    if n != [0.0, 0.0] {
                        return (n, whole(&mut random, 6));
                    }
                }
            })
            .collect();
        let rows: Vec<Row> = drawn.iter().map(|(n, d)| row(*n, *d)).collect();
        match (tried(&drawn), shortest(&rows, 2)) {
            (Some(expected), Solution::Shortest { c, active }) => {
                // Corners of whole numbers below 100: 1e-14 of them.
                assert!(c.iter().zip(expected).all(|(c, e)| (c.to_f64() - e).abs() < 1e-12), "{drawn:?} {c:?} {expected:?}");
                // Every row that is called active holds c, in double-double.
                for k in &active {
                    assert!((product(&rows[*k].normal, &c) - rows[*k].distance).abs().to_f64() < 1e-25, "{drawn:?} {active:?}");
                }
            }
            (None, Solution::Infeasible) => infeasible += 1,
            (expected, found) => panic!("{drawn:?}: {expected:?} {found:?}"),
        }
    }
    assert!(infeasible > 5, "{infeasible}");
}

#[test]
fn the_polished_answer_keeps_every_row_to_sixteen_digits() {
    // The second row asks for 1.5e-16 more than the first, the third for 0.9e-16 more: only the one is missed.
    let asks = |more: f64| Row { normal: vec![Dd::ONE, Dd::ZERO], distance: Dd::sum_of(1.0, more) };
    let active = |more: f64| polished(&[asks(0.0), asks(more)], 2, vec![0], 1.0).map(|(_, active)| active);
    // 1e-16 is what may be missed.
    assert_eq!(active(1e-16), Some(vec![0]));
    // The two depend on each other: the second comes in for the first.
    assert_eq!(active(1.5e-16), Some(vec![1]));
    assert_eq!(polished(&[asks(0.0), asks(1.5e-16)], 2, vec![1], 1.0).map(|(_, active)| active), Some(vec![1]));
    // As a share of the largest distance.
    assert_eq!(polished(&[asks(0.0), asks(1.5e-16)], 2, vec![0], 2.0).map(|(_, active)| active), Some(vec![0]));
}

#[test]
fn from_any_guess_the_polished_answer_is_the_same() {
    let rows =
        [row([1.0, 2.0], 5.0), row([1.0, 0.0], -3.0), row([2.0, 4.0], 10.0), row([1.0, 0.0], 1.5), row([-1.0, 0.0], -9.0)];
    for guess in [vec![], vec![0], vec![1], vec![4], vec![3, 0], vec![1, 0], vec![0, 1, 2, 3, 4], vec![4, 1]] {
        let (c, active) = polished(&rows, 2, guess.clone(), 5.0).unwrap_or_else(|| panic!("{guess:?}"));
        // x >= 1.5 and x + 2 y >= 5: the corner (1.5, 1.75).
        assert!((c[0].to_f64() - 1.5).abs() < 1e-15 && (c[1].to_f64() - 1.75).abs() < 1e-15, "{guess:?} {c:?} {active:?}");
    }
}

#[test]
fn a_row_that_depends_on_active_ones_comes_in_for_the_one_that_falls_to_nothing_first() {
    // x >= 3 and y >= 4 hold c; x + y >= 8 depends on both and is missed. Multipliers 3 and 4, shares 1 and 1 (of x + y not scaled): x leaves, c =
    // (4, 4).
    let rows = [row([1.0, 0.0], 3.0), row([0.0, 1.0], 4.0), row([1.0, 1.0], 8.0)];
    let (c, active) = polished(&rows, 2, vec![0, 1], 8.0).unwrap();
    assert_eq!((c[0].to_f64(), c[1].to_f64(), active), (4.0, 4.0, vec![1, 2]));
    let number = |x: &[f64]| x.iter().copied().map(Dd::from).collect::<Vec<Dd>>();
    let leaving = |multipliers: &[f64], shares: &[f64]| leaving(&number(multipliers), &number(shares));
    assert_eq!(leaving(&[3.0, 4.0], &[1.0, 1.0]), Some(0));
    assert_eq!(leaving(&[3.0, 4.0], &[1.0, 2.0]), Some(1));
    // One that grows, or stays but for rounding, never falls to nothing.
    assert_eq!(leaving(&[0.0, 4.0, 1.0], &[-1.0, 1.0, 1e-13]), Some(1));
    assert_eq!([leaving(&[3.0, 4.0], &[-1.0, -2.0]), leaving(&[3.0], &[0.0])], [None, None]);
    assert_eq!([leaving(&[3.0], &[0.9e-12]), leaving(&[3.0], &[1.1e-12])], [None, Some(0)]);
}

#[test]
fn rows_of_one_normal_that_f64_cannot_tell_apart_end() {
    // Each normal many times, asked a little more each time; from every guess the answer is that of the greediest alone, and every row is kept.
    let mut random = Random::new(8);
    let mut ended = 0;
    for _ in 0..40 {
        let normals = [[3.0, 1.0], [1.0, 4.0], [-1.0, 2.0], [1.0, 1.0]];
        let asked: Vec<f64> = normals.iter().map(|_| whole(&mut random, 5)).collect();
        let mut rows = Vec::new();
        for (normal, asked) in normals.iter().zip(&asked) {
            let first = row(*normal, *asked);
            rows.extend((0..6).map(|_| Row { distance: first.distance + Dd::from(1e-16 * random.share()), ..first.clone() }));
        }
        random.shuffle(&mut rows);
        let largest = rows.iter().map(|row| row.distance.to_f64()).fold(0.0, f64::max);
        if largest == 0.0 {
            continue;
        }
        let guess: Vec<usize> = (0..rows.len()).filter(|_| random.share() < 0.3).collect();
        // A hundredth of what may be missed, so that each little more counts.
        let largest = largest / 100.0;
        let (c, active) = polished(&rows, 2, guess.clone(), largest).unwrap_or_else(|| panic!("{asked:?} {guess:?}"));
        assert!(active.len() <= 2, "{active:?}");
        assert!(rows.iter().all(|row| (row.distance - product(&row.normal, &c)).to_f64() <= ALLOWED_VIOLATION * largest));
        let multipliers = Factor::of(&rows, &mut active.clone()).solved(active.iter().map(|k| rows[*k].distance));
        assert!(multipliers.iter().all(|multiplier| *multiplier >= Dd::ZERO));
        ended += 1;
    }
    assert!(ended > 30, "{ended}");
}

#[test]
fn multipliers_put_every_active_row_at_its_distance() {
    // Three rows of three dimensions and one that depends on two of them, which is dropped.
    let unit = |n: [f64; 3], d: f64| {
        let length = Dd::from(n.iter().map(|x| x * x).sum::<f64>()).sqrt();
        Row { normal: n.map(|x| Dd::from(x) / length).to_vec(), distance: Dd::from(d) / length }
    };
    let rows =
        [unit([1.0, 2.0, 2.0], 3.0), unit([2.0, -1.0, 4.0], 1.0), unit([3.0, 1.0, 6.0], 7.0), unit([0.0, 3.0, -1.0], -2.0)];
    let mut active = vec![0, 1, 2, 3];
    let factor = Factor::of(&rows, &mut active);
    let found = factor.solved(active.iter().map(|k| rows[*k].distance));
    assert_eq!((active.clone(), found.len()), (vec![0, 1, 3], 3));
    let mut c = [Dd::ZERO; 3];
    for (k, multiplier) in active.iter().zip(&found) {
        for (entry, n) in c.iter_mut().zip(&rows[*k].normal) {
            *entry += *multiplier * *n;
        }
    }
    for k in active {
        assert!((product(&rows[k].normal, &c) - rows[k].distance).abs().to_f64() < 1e-29, "{c:?}");
    }
    // The pivot is the square of the own part: 1e-24 of it is none, twice as much is some.
    let kept = |own: f64| {
        let rows = [unit([1.0, 0.0, 0.0], 1.0), Row { normal: vec![Dd::ONE, Dd::from(own), Dd::ZERO], distance: Dd::ONE }];
        let mut active = vec![0, 1];
        Factor::of(&rows, &mut active);
        active.len()
    };
    assert_eq!([kept(0.9e-12), kept(1.1e-12), kept(1.3e-12), kept(1e-6)], [1, 2, 2, 2]);
}

#[test]
fn a_row_whose_multiplier_is_nothing_may_stay() {
    // x >= 3, and y >= 0 just so: it neither pushes nor is missed.
    let rows = [row([1.0, 0.0], 3.0), row([0.0, 1.0], 0.0)];
    let (c, active) = polished(&rows, 2, vec![0, 1], 3.0).unwrap();
    assert_eq!((c[0].to_f64(), c[1].to_f64(), active), (3.0, 0.0, vec![0, 1]));
}

#[test]
fn what_cannot_be_polished_is_what_the_solver_found() {
    // Two rows that contradict each other by less than f64 shows: the solver does not see it.
    let normal = [Dd::from(0.6), Dd::from(-0.8)];
    let rows = [
        Row { normal: normal.to_vec(), distance: Dd::sum_of(5.0, 7.5e-16) },
        Row { normal: normal.map(|n| Dd::ZERO - n).to_vec(), distance: Dd::from(-5.0) },
    ];
    assert!(polished(&rows, 2, vec![0], 5.0).is_none());
    let c = match shortest(&rows, 2) {
        Solution::Shortest { c, .. } => c,
        other => panic!("{other:?}"),
    };
    // The tolerance of the solver.
    assert!((c[0].to_f64() - 3.0).abs() < 1e-8 && (c[1].to_f64() + 4.0).abs() < 1e-8, "{c:?}");
}
