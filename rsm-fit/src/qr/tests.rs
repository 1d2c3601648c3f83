//! Against normal equations in exact rational arithmetic, and at the boundary of dependence.

use rsm_core::number::{Rational, exact, integer};

use super::*;
use crate::random::Random;
use crate::reference::{Problem, agree, dot, rational, whole};

/// What a hundred double-double operations on numbers of some thousands leave, with a wide margin: 2^-104 each, and a condition of 1000.
const CLOSE: f64 = 1e-24;

fn is(what: &str, found: Dd, expected: &Rational) {
    assert!(agree(&rational(found), expected, CLOSE), "{what}: {found:?}, expected {expected}");
}

/// Rows of candidates with a response behind them.
fn pushed(problem: &Problem, rows: &[Vec<f64>]) -> Compressed {
    let mut compressed = Compressed::new(rows[0].len() + 1);
    for (row, y) in rows.iter().zip(&problem.response) {
        compressed.push(row.iter().map(|x| Dd::from(*x)).chain([rounded(y)]));
    }
    compressed
}

fn rounded(value: &Rational) -> Dd {
    Dd::from(rsm_core::number::Precision::F64.round(value))
}

/// Small whole numbers.
fn drawn(random: &mut Random, count: usize, width: usize) -> (Vec<Vec<f64>>, Problem) {
    let rows: Vec<Vec<f64>> = (0..count).map(|_| (0..width).map(|_| whole(random, 9)).collect()).collect();
    let response: Vec<f64> = (0..count).map(|_| whole(random, 30)).collect();
    let problem = Problem::of(&rows, &response);
    (rows, problem)
}

fn triangle(rows: &[[f64; 4]]) -> Triangle {
    let mut compressed = Compressed::new(4);
    for row in rows {
        compressed.push(row.map(Dd::from));
    }
    compressed.finish()
}

#[test]
fn a_line_through_points_that_lie_on_one() {
    // y = 3 - 2 x, with x^2 as third candidate; more rows than a block, so that the triangle is folded in.
    let rows: Vec<[f64; 4]> = (0..1500).map(|k| f64::from(k) / 8.0).map(|x| [1.0, x, x * x, 3.0 - 2.0 * x]).collect();
    let triangle = triangle(&rows);
    assert_eq!(triangle.rows(), 1500);
    let mut growing = Growing::new(&triangle);
    growing.add(0).unwrap();
    growing.add(1).unwrap();
    assert_eq!(growing.coefficients().iter().map(|x| x.to_f64()).collect::<Vec<_>>(), [3.0, -2.0]);
    assert!(growing.residual_square().to_f64() < 1e-40);
}

#[test]
fn a_column_that_others_make_up_is_named_with_them() {
    // Third column = first + 2 second; the fourth candidate is free.
    let rows: Vec<[f64; 4]> = (0..9).map(f64::from).map(|x| [0.1, x.sin(), 0.1 + 2.0 * x.sin(), x]).collect();
    let triangle = triangle(&rows);
    let dependent = Growing::of(&triangle, &[1, 0, 2]).unwrap_err();
    assert_eq!(dependent.candidates, [1, 0, 2]);
    assert!(dependent.condition > 1e14);
    // Fewer rows than columns is the same case.
    assert_eq!(Growing::of(&self::triangle(&rows[1..2]), &[0, 1]).unwrap_err().candidates, [0, 1]);
}

#[test]
fn every_figure_is_that_of_the_normal_equations() {
    for seed in 0..12 {
        let mut random = Random::new(seed);
        let width = 4;
        let ((rows, problem), (judging, judge)) =
            (drawn(&mut random, 5 + 2 * seed as usize, width), drawn(&mut random, 7, width));
        let (fit, judging) = (pushed(&problem, &rows).finish(), pushed(&judge, &judging).finish());
        assert_eq!((fit.rows(), fit.width()), (rows.len(), width));
        is("response", fit.response_square(), &problem.left_by(&[]));
        let order = [2, 0, 3, 1];
        let mut growing = Growing::judged_by(&fit, &judging);
        for k in 0..width {
            let chosen = &order[..k];
            assert_eq!(growing.chosen(), chosen);
            let before = problem.only(chosen).solve().unwrap();
            // What each candidate would do.
            for candidate in order[k..].iter().copied() {
                let with = [chosen, &[candidate]].concat();
                let after = problem.only(&with).solve().unwrap();
                let (gain, left) = growing.effect_of_adding(candidate).unwrap();
                is("gain", gain, &(&before.residual_square - &after.residual_square));
                is("left", left, &judge.only(&with).left_by(&after.coefficients));
            }
            growing.add(order[k]).unwrap();
            let chosen = &order[..=k];
            let answer = problem.only(chosen).solve().unwrap();
            let of = Growing::of(&fit, chosen).unwrap();
            let left = judge.only(chosen).left_by(&answer.coefficients);
            is("judged", growing.judged(), &left);
            is("not judged", of.judged(), &integer(0));
            let coefficients = growing.coefficients();
            is("sum of squares", judging.sum_of_squares(chosen, &coefficients), &left);
            assert_eq!(coefficients.len(), chosen.len());
            for one in [&growing, &of] {
                is("residual", one.residual_square(), &answer.residual_square);
                assert_eq!(one.variances().len(), chosen.len());
                for (place, (found, variance)) in one.coefficients().iter().zip(one.variances()).enumerate() {
                    is("coefficient", *found, &answer.coefficients[place]);
                    is("variance", variance, &answer.inverse[place][place]);
                    let square: Rational = problem.rows.iter().map(|row| &row[order[place]] * &row[order[place]]).sum();
                    // A norm is told in f64.
                    let norm = one.norm(place);
                    assert!(agree(&exact(norm * norm), &square, 4e-16), "{norm} {square}");
                }
            }
            // A linear function x b of the coefficients, seen from c = R b: R^-T x . c = x b, and the length of R^-T x is the leverage.
            let point: Vec<f64> = chosen.iter().map(|_| whole(&mut random, 5)).collect();
            let (x, exact_x) =
                (point.iter().map(|x| Dd::from(*x)).collect::<Vec<_>>(), point.iter().map(|x| exact(*x)).collect::<Vec<_>>());
            let seen = growing.projected(x.clone());
            is("leverage", growing.leverage(&x), &answer.leverage(&exact_x));
            is("length", seen.iter().map(|x| *x * *x).sum(), &answer.leverage(&exact_x));
            let c: Vec<Dd> = chosen.iter().map(|_| Dd::from(whole(&mut random, 5))).collect();
            let b: Vec<Rational> = growing.coefficients_of(c.clone()).into_iter().map(rational).collect();
            is("projected", seen.iter().zip(&c).map(|(x, c)| *x * *c).sum(), &dot(&exact_x, &b));
        }
        // Nothing is left to choose from what is chosen already.
        assert!(growing.effect_of_adding(0).is_none());
    }
}

#[test]
fn triangles_of_parts_stack_to_that_of_the_whole() {
    let mut random = Random::new(5);
    for counts in [[9, 12, 3], [2, 1, 0], [2, 1, 1], [1, 3, 1], [20, 0, 0]] {
        let (rows, problem) = drawn(&mut random, counts.iter().sum(), 3);
        let mut parts = Vec::new();
        let mut from = 0;
        for count in counts {
            let part = Problem { response: problem.response[from..from + count].to_vec(), ..problem.clone() };
            let mut compressed = Compressed::new(4);
            if count > 0 {
                compressed = pushed(&part, &rows[from..from + count]);
            }
            assert_eq!(compressed.rows(), count);
            parts.push(compressed.finish());
            from += count;
        }
        let stacked = Triangle::stacked(&parts.iter().collect::<Vec<_>>());
        assert_eq!(stacked.rows(), rows.len());
        assert!(stacked.columns.iter().all(|column| column.len() == rows.len().min(4)));
        let growing = Growing::of(&stacked, &[0, 1, 2][..rows.len().min(3)]).unwrap();
        let answer = problem.only(&[0, 1, 2][..rows.len().min(3)]).solve().unwrap();
        growing.coefficients().iter().zip(&answer.coefficients).for_each(|(found, expected)| is("stacked", *found, expected));
        is("left", growing.residual_square(), &answer.residual_square);
    }
}

#[test]
fn a_factor_of_all_rows_leaves_the_coefficients_and_scales_the_residual() {
    let (rows, problem) = drawn(&mut Random::new(6), 12, 3);
    let triangle = pushed(&problem, &rows).finish();
    let all = [0, 1, 2];
    let before = Growing::of(&triangle, &all).unwrap();
    // A power of two scales without rounding.
    let scaled = triangle.clone().times(Dd::from(8.0));
    let after = Growing::of(&scaled, &all).unwrap();
    assert_eq!(after.coefficients(), before.coefficients());
    assert_eq!(after.residual_square(), before.residual_square() * Dd::from(64.0));
    assert_eq!(scaled.rows(), 12);
}

#[test]
fn rows_are_kept_in_blocks_and_no_longer() {
    let mut random = Random::new(9);
    let (rows, problem) = drawn(&mut random, 2 * BLOCK + 9, 2);
    let mut compressed = Compressed::new(3);
    for (count, (row, y)) in rows.iter().zip(&problem.response).enumerate() {
        compressed.push(row.iter().map(|x| Dd::from(*x)).chain([rounded(y)]));
        let seen = count + 1;
        // A triangle of three rows after the first block, which has three rows more, and each later one.
        let kept = if seen < BLOCK + 3 { seen } else { 3 + (seen - BLOCK - 3) % BLOCK };
        assert!(compressed.columns.iter().all(|column| column.len() == kept), "{seen}");
    }
    assert_eq!(compressed.rows(), rows.len());
    let triangle = compressed.finish();
    assert!(
        triangle
            .columns
            .iter()
            .enumerate()
            .all(|(k, column)| column.len() == 3 && column[k + 1..].iter().all(|x| *x == Dd::ZERO))
    );
    let growing = Growing::of(&triangle, &[0, 1]).unwrap();
    let answer = problem.solve().unwrap();
    growing.coefficients().iter().zip(&answer.coefficients).for_each(|(found, expected)| is("in blocks", *found, expected));
    is("left", growing.residual_square(), &answer.residual_square);
    // More columns than a block has rows: as many rows again as the triangle has.
    let width = BLOCK + 8;
    let mut wide = Compressed::new(width);
    for k in 0..2 * width - 1 {
        // The first column alone is not zero: nothing to turn behind it.
        wide.push((0..width).map(|column| if column == 0 { Dd::from(k as f64) } else { Dd::ZERO }));
    }
    assert_eq!(wide.columns[0].len(), 2 * width - 1);
    wide.push((0..width).map(|_| Dd::ONE));
    assert_eq!(wide.columns[0].len(), width);
}

#[test]
fn few_rows_stay_as_they_are() {
    let mut random = Random::new(2);
    for count in 1..=3 {
        let (rows, problem) = drawn(&mut random, count, 2);
        let triangle = pushed(&problem, &rows).finish();
        for (k, column) in triangle.columns[..2].iter().enumerate() {
            assert_eq!(*column, rows.iter().map(|row| Dd::from(row[k])).collect::<Vec<_>>());
        }
    }
}

#[test]
fn a_column_that_is_nearly_turned_already_loses_no_digit() {
    // The norm of (0.7, 1e-14) is 0.7 + 7e-29: a difference of the two would keep 4 digits of 32.
    for sign in [1.0, -1.0] {
        let rows = vec![vec![0.7 * sign, 1.0], vec![1e-14, 2.0], vec![-1e-14, 5.0], vec![2e-14, -3.0]];
        let problem = Problem::of(&rows, &[1.0, 2.0, -4.0, 7.0]);
        let growing = Growing::of(&pushed(&problem, &rows).finish(), &[0, 1]).unwrap();
        let answer = problem.solve().unwrap();
        growing.coefficients().iter().zip(&answer.coefficients).for_each(|(found, expected)| is("turned", *found, expected));
    }
}

/// Columns that need no reflection: each row of the triangle is as it is written here.
fn as_written(columns: &[&[f64]]) -> Triangle {
    let columns: Columns = columns.iter().map(|column| column.iter().copied().map(Dd::from).collect()).collect();
    Triangle { rows: columns[0].len(), columns }
}

#[test]
fn the_own_part_of_a_column_is_judged_against_the_whole() {
    // The own part of the second is `own`, its length is 8 to the last bit.
    let of = |own: f64| Growing::of(&as_written(&[&[1.0, 0.0, 0.0], &[8.0, own, 0.0], &[1.0, 1.0, 1.0]]), &[0, 1]);
    let dependent = of(8.0 * DEPENDENT).unwrap_err();
    assert_eq!(dependent, Dependent { condition: 1.0 / DEPENDENT, candidates: vec![0, 1] });
    assert_eq!(of(1.5 * 8.0 * DEPENDENT).unwrap().chosen(), [0, 1]);
    assert_eq!(of(0.0).unwrap_err().condition, f64::INFINITY);
    // A candidate that is zero everywhere, and a second that is the first with the sign turned.
    let zero = as_written(&[&[1.0, 0.0], &[0.0, 0.0], &[-2.0, 0.0], &[1.0, 1.0]]);
    assert_eq!(Growing::of(&zero, &[0, 1]).unwrap_err(), Dependent { condition: f64::INFINITY, candidates: vec![1] });
    assert_eq!(Growing::of(&zero, &[0, 2]).unwrap_err(), Dependent { condition: f64::INFINITY, candidates: vec![0, 2] });
    // A column of large numbers, whose own part is above 0 and far above 1.
    let large = 2.0f64.powi(60);
    let found = Growing::of(&as_written(&[&[1.0, 0.0], &[large, 0.5], &[1.0, 1.0]]), &[0, 1]).unwrap_err();
    assert_eq!(found.condition, 2.0 * large);
    // Fewer rows than columns: the chosen ones take them all.
    let mut growing = Growing::new(&as_written(&[&[1.0], &[2.0], &[3.0], &[4.0]]));
    growing.add(0).unwrap();
    let refused = growing.add(1).unwrap_err();
    assert_eq!((refused.condition, refused.candidates), (f64::INFINITY, vec![0, 1]));
    assert_eq!((growing.chosen(), growing.residual_square()), (&[0][..], Dd::ZERO));
    let (short, none) = (as_written(&[&[1.0], &[2.0], &[4.0]]), Growing::new(&as_written(&[&[], &[], &[]])));
    assert!(Growing::of(&short, &[0]).unwrap().effect_of_adding(1).is_none() && none.effect_of_adding(0).is_none());
}

#[test]
fn columns_with_a_share_in_another_are_named() {
    // 2^46 - 1 = 8388607^2 + 4093^2 + 153^2 + 34^2: with 1 behind them the length is 2^23, and 1 is the root of the threshold of it. Not above: not
    // involved; -1.25 is.
    let unit = |place: usize| (0..5).map(|k| f64::from(u8::from(k == place))).collect::<Vec<f64>>();
    let units: Vec<Vec<f64>> = (0..5).map(unit).collect();
    let named = |last: f64| {
        let made_up = [8_388_607.0, -4093.0, 153.0, 34.0, last];
        let columns: Vec<&[f64]> = units.iter().map(Vec::as_slice).chain([&made_up[..], &made_up[..]]).collect();
        Growing::of(&as_written(&columns), &[4, 0, 1, 2, 3, 5]).unwrap_err().candidates
    };
    assert_eq!(named(1.0), [0, 1, 2, 3, 5]);
    assert_eq!(named(1.25), [4, 0, 1, 2, 3, 5]);
    assert_eq!(named(-1.25), [4, 0, 1, 2, 3, 5]);
    // The share is that of the column, not of its weight: 0.75 times a column of length 0.5 is 0.375, and the threshold here 0.5.
    let short = as_written(&[&[0.0, 0.5], &[1.0, 0.0], &[2.0f64.powi(22), 0.375], &[1.0, 1.0]]);
    assert_eq!(Growing::of(&short, &[0, 1, 2]).unwrap_err().candidates, [1, 2]);
    // Twice the second column, which itself has a part in the first.
    let leaning = as_written(&[&[1.0, 0.0], &[1.0, 1.0], &[2.0, 2.0], &[1.0, 1.0]]);
    assert_eq!(Growing::of(&leaning, &[0, 1, 2]).unwrap_err().candidates, [1, 2]);
}

#[test]
fn leverages_sum_to_the_number_of_terms() {
    let rows: Vec<[f64; 4]> = (0..20).map(f64::from).map(|x| [1.0, x, x * x, x.cos()]).collect();
    let growing = Growing::of(&triangle(&rows), &[0, 1, 2]).unwrap();
    let sum: Dd = rows.iter().map(|row| growing.leverage(&[row[0], row[1], row[2]].map(Dd::from))).sum();
    assert!((sum.to_f64() - 3.0).abs() < 1e-15);
    // The variance of the mean of 20: 1/20 for a constant alone.
    let mean = Growing::of(&triangle(&rows), &[0]).unwrap();
    assert!((mean.variances()[0].to_f64() - 0.05).abs() < 1e-17);
}
