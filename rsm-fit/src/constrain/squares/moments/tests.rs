//! A program by its parts: moments and squares of points, directions by the equations that they solve, exact counts of steps.

use super::super::region::Scaling;
use super::*;

/// Polynomials of t with exact coefficients, and the weights of a box with so many sides.
fn scaled(entries: &[Vec<(Vec<u32>, f64)>], axes: usize) -> (Vec<Polynomial>, Vec<Weight>) {
    let of =
        |terms: &Vec<(Vec<u32>, f64)>| terms.iter().map(|(powers, value)| (powers.clone(), Interval::point(*value))).collect();
    let weights = Scaling::of(&vec![Interval::new(-1.0, 1.0); axes]).weights(&[], &(0..axes).collect::<Vec<_>>()).unwrap();
    (entries.iter().map(of).collect(), weights)
}

/// A half-space that cuts the box, with factors that are not 1.
fn cut() -> Weight {
    Weight { terms: vec![(vec![0, 0], 0.75), (vec![1, 0], -0.5), (vec![0, 1], 0.25)] }
}

/// Two inputs, two rows: 3 + x^2, x y - 1 beside the diagonal, 5 - y.
fn form() -> Program {
    let entries = [
        vec![(vec![0, 0], 3.0), (vec![2, 0], 1.0)],
        vec![(vec![1, 1], 1.0), (vec![0, 0], -1.0)],
        vec![(vec![0, 0], 5.0), (vec![0, 1], -1.0)],
    ];
    let (entries, mut weights) = scaled(&entries, 2);
    weights.push(cut());
    Program::new(&entries, 2, &weights, 1).unwrap()
}

/// Moments of a point t with a vector u: every monomial of t times every product of two entries of u.
fn of_point(program: &Program, half: u32, t: &[f64], u: &[f64]) -> Vec<f64> {
    let value = |powers: &Vec<u32>| t.iter().zip(powers).map(|(t, power)| t.powi(*power as i32)).product::<f64>();
    let all = monomials(t.len(), 2 * half);
    all.iter().flat_map(|powers| program.pairs.iter().map(move |[a, b]| value(powers) * u[*a] * u[*b])).collect()
}

/// Symmetric matrices of the sizes of a program, drawn; with so much on the diagonal besides.
fn drawn(program: &Program, random: &mut Random, more: f64) -> Vec<Matrix> {
    let of_block = |block: &Block| {
        let entries = (0..block.rows * block.rows).map(|_| random.share() - 0.5).collect();
        let mut matrix = Matrix { size: block.rows, entries }.symmetric();
        (0..block.rows).for_each(|k| matrix.entries[k * (block.rows + 1)] += more);
        matrix
    };
    program.blocks.iter().map(of_block).collect()
}

fn assert_close(found: f64, expected: f64, what: &str) {
    // Some hundred roundings of numbers of this size.
    assert!((found - expected).abs() <= 1e-11 * expected.abs().max(1.0), "{what}: {found:e} {expected:e}");
}

#[test]
fn monomials_come_by_their_degree() {
    let found = monomials(2, 2);
    assert_eq!(found, [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0]].map(|it| it.to_vec()));
    assert_eq!(monomials(0, 3), [Vec::<u32>::new()]);
    assert_eq!(monomials(3, 4).len(), 35);
}

#[test]
fn a_program_has_every_coefficient_in_its_place() {
    let program = form();
    assert_eq!((program.size, program.scale), (2, 8.0));
    assert_eq!(program.pairs, [[0, 0], [0, 1], [1, 1]]);
    // Moments by monomials 1, y, x, y^2, xy, x^2 with three pairs each; entries beside the diagonal twice; over 8.
    let mut expected = [0.0; 18];
    for (place, value) in [(0, 3.0), (1, -2.0), (2, 5.0), (5, -1.0), (13, 2.0), (15, 1.0)] {
        expected[place] = value / 8.0;
    }
    for (k, (found, expected)) in program.wanted.iter().zip(&expected).enumerate() {
        assert!(
            found.low <= *expected && *expected <= found.high && found.high - found.low < 1e-15,
            "{k}: {found:?} {expected}"
        );
    }
    let mut unit = [0.0; 18];
    (unit[0], unit[2]) = (1.0, 1.0);
    assert_eq!(program.unit, unit);
    assert_eq!(program.of_sides, [[2, 5], [1, 3]]);
    // 1 with the basis 1, y, x; 1 - x^2, 1 - y^2, four products and the half-space with 1 alone, for two rows each.
    assert_eq!(program.blocks.iter().map(|block| block.rows).collect::<Vec<_>>(), [6, 2, 2, 2, 2, 2, 2, 2]);
    assert_eq!(program.blocks.iter().map(|block| block.moments.len()).collect::<Vec<_>>(), [18, 3, 3, 3, 3, 3, 3, 3]);
}

#[test]
fn the_scale_is_the_next_power_of_two_and_numbers_out_of_range_have_none() {
    let of = |value: f64, half: u32| {
        let (entries, weights) = scaled(&[vec![(vec![0], value), (vec![1], -0.5 * value)]], 1);
        Program::new(&entries, 1, &weights, half).map(|program| program.scale)
    };
    assert_eq!(
        [of(3.0, 1), of(4.0, 1), of(0.3, 1), of(1e-300, 1)],
        [Some(4.0), Some(4.0), Some(0.5), Some(1e-300_f64.log2().ceil().exp2())]
    );
    assert_eq!([of(f64::MAX, 1), of(f64::INFINITY, 1), of(f64::NAN, 1), of(1e-310, 1)], [None; 4]);
    // Of one variable and half a degree of 1 three monomials times 666 pairs, times 703, and five times 378.
    let count = |half: u32, size: usize| {
        let (entries, _) = scaled(&vec![vec![(vec![1], 1.0)]; size * (size + 1) / 2], 1);
        // No weight has a basis, so that there are no blocks to build.
        let weight = Weight { terms: vec![(vec![2 * half + 1], 1.0)] };
        Program::new(&entries, size, &[weight], half).map(|program| (program.wanted.len(), program.blocks.len()))
    };
    assert_eq!([count(1, 36), count(1, 37), count(2, 27)], [Some((1998, 0)), None, Some((1890, 0))]);
}

#[test]
fn a_weight_has_the_squares_that_its_degree_leaves() {
    let rows = |degree: u32, half: u32| {
        let (entries, _) = scaled(&[vec![(vec![0], 1.0)]], 1);
        let weight = Weight { terms: vec![(vec![0], 1.0), (vec![degree], 1.0)] };
        let program = Program::new(&entries, 1, &[weight], half).unwrap();
        program.blocks.iter().map(|block| block.rows).collect::<Vec<_>>()
    };
    assert_eq!([rows(0, 1), rows(1, 1), rows(2, 1), rows(3, 1)], [vec![2], vec![1], vec![1], vec![]]);
    assert_eq!([rows(2, 2), rows(3, 2), rows(4, 2), rows(5, 2)], [vec![2], vec![1], vec![1], vec![]]);
}

#[test]
fn matrices_of_a_point_are_its_weights_times_squares() {
    let program = form();
    let (t, u) = ([0.5, -0.25], [2.0, 3.0]);
    let z = program.matrices(&of_point(&program, 1, &t, &u));
    let (_, mut weights) = scaled(&[], 2);
    weights.push(cut());
    for (k, (weight, z)) in weights.iter().zip(&z).enumerate() {
        let value = |powers: &Vec<u32>| t.iter().zip(powers).map(|(t, power)| t.powi(*power as i32)).product::<f64>();
        let g: f64 = weight.terms.iter().map(|(powers, factor)| factor * value(powers)).sum();
        let basis: Vec<f64> = if k == 0 { vec![1.0, t[1], t[0]] } else { vec![1.0] };
        let v: Vec<f64> = basis.iter().flat_map(|b| u.map(|u| b * u)).collect();
        for row in 0..z.size {
            for column in 0..z.size {
                assert_eq!(z.row(row)[column], g * v[row] * v[column], "{k} {row} {column}");
            }
        }
    }
    // In products of moments with coefficients, u'Hu of the point over the scale.
    let wanted: Vec<f64> = program.wanted.iter().map(|value| value.low.midpoint(value.high)).collect();
    let form = 4.0 * 3.25 + 2.0 * 6.0 * (-0.125 - 1.0) + 9.0 * 5.25;
    assert_close(dot(&wanted, &of_point(&program, 1, &t, &u)), form / 8.0, "form");
    assert_eq!(dot(&program.unit, &of_point(&program, 1, &t, &u)), 13.0);
}

#[test]
fn coefficients_and_equations_are_those_of_the_squares() {
    let program = form();
    let mut random = Random::new(3);
    for _ in 0..5 {
        let squares = drawn(&program, &mut random, 0.0);
        let coefficients = program.coefficients(&squares);
        // The products of the squares with the matrices of any moments are those of the coefficients with the moments.
        let moments: Vec<f64> = (0..18).map(|_| random.share() - 0.5).collect();
        let changes = program.matrices(&moments);
        assert_close(products(&squares, &changes), dot(&coefficients, &moments), "coefficients");
        // The equations times moments: the coefficients of x dZ z^-1.
        let (x, inverse) = (drawn(&program, &mut random, 2.0), drawn(&program, &mut random, 2.0));
        let bent: Vec<Matrix> = (0..x.len()).map(|k| x[k].times(&changes[k]).times(&inverse[k]).symmetric()).collect();
        let expected = program.coefficients(&bent);
        let equations = program.equations(&x, &inverse);
        for (k, expected) in expected.iter().enumerate() {
            assert_close(dot(equations.row(k), &moments), *expected, "equations");
        }
    }
}

#[test]
fn variances_are_those_of_the_points() {
    let program = form();
    // Of a half each, u of length 1: t_0 is -0.5 or 0.5, t_1 always 0.25.
    let points = [([-0.5, 0.25], [1.0, 0.0]), ([0.5, 0.25], [0.0, 1.0])];
    let moments: Vec<Vec<f64>> = points.iter().map(|(t, u)| of_point(&program, 1, t, u)).collect();
    let mean: Vec<f64> = (0..18).map(|k| 0.5 * (moments[0][k] + moments[1][k])).collect();
    assert_eq!(program.variances(&mean), [0.25, 0.0]);
    let aside = of_point(&program, 1, &[0.5, 0.25], &[0.0, 1.0]);
    assert_eq!(program.variances(&aside), [0.0, 0.0]);
}

#[test]
fn first_moments_are_those_of_points_of_the_region() {
    let program = form();
    let first = program.first.clone().unwrap();
    // u is of length 1 in the mean, in all directions alike.
    assert_eq!([first[0], first[1], first[2]], [0.5, 0.0, 0.5]);
    // 4096 points know a mean to a hundredth, and the mean of a square, 1/3, to half of that: four deviations.
    let mean = |k: usize| first[3 * k] + first[3 * k + 2];
    for (k, expected) in [(1, 0.0), (2, 0.0), (3, 1.0 / 3.0), (4, 0.0), (5, 1.0 / 3.0)] {
        let deviation = if k == 3 || k == 5 { 0.3 } else { 0.58 } / 64.0;
        assert!((mean(k) - expected).abs() < 4.0 * deviation && first[3 * k + 1] == 0.0, "{k}: {}", mean(k));
        assert!(mean(k) != expected);
    }
    // Of one variable they are the points of this seed, each once.
    let mut random = Random::new(0);
    let points: Vec<f64> = (0..4096).map(|_| 2.0 * random.share() - 1.0).collect();
    let all = monomials(1, 2);
    let everywhere = Weight { terms: vec![(vec![0], 1.0)] };
    let first = first_moments(&all, &[everywhere], &[[0, 0]], 1).unwrap();
    assert_eq!(first[1], points.iter().sum::<f64>() / 4096.0);
    // One of them is enough: the largest.
    let mut sorted = points.clone();
    sorted.sort_by(f64::total_cmp);
    let above = Weight { terms: vec![(vec![0], -sorted[4094].midpoint(sorted[4095])), (vec![1], 1.0)] };
    assert_eq!(first_moments(&all, &[above], &[[0, 0]], 1).unwrap()[1], sorted[4095]);
    // Only where every weight is above 0: x > 1/2 has the mean 3/4.
    let half = |constant: f64| Weight { terms: vec![(vec![0], constant), (vec![1], 1.0)] };
    let first = first_moments(&all, &[half(2.0), half(-0.5)], &[[0, 0]], 1).unwrap();
    assert!(first[0] == 1.0 && (first[1] - 0.75).abs() < 0.02 && (first[2] - 7.0 / 12.0).abs() < 0.03, "{first:?}");
    assert!(first_moments(&all, &[half(-1.0)], &[[0, 0]], 1).is_none());
    // A weight of 0 everywhere leaves no point.
    assert!(first_moments(&all, &[Weight { terms: vec![(vec![0], 0.0)] }], &[[0, 0]], 1).is_none());
}

#[test]
fn a_step_goes_as_far_as_all_matrices_stay_positive_definite() {
    let one = |value: f64| Matrix { size: 1, entries: vec![value] };
    let of = |by: &[f64]| longest(&vec![one(1.0); by.len()], &by.iter().map(|by| one(*by)).collect::<Vec<_>>());
    // Nothing is in the way, or only beyond the whole step.
    let all = 1.0 / SHARE_OF_WAY * SHARE_OF_WAY;
    assert_eq!([of(&[1.0]), of(&[-0.94]), of(&[0.0, 3.0])], [all; 3]);
    assert_close(all, 1.0, "all of it");
    // 1 - 2 s > 0 for s below a half: 0.9^k / 0.95 for the first time with k = 8.
    let expected = (0..8).fold(1.0 / SHARE_OF_WAY, |tried, _| tried * SHORTER) * SHARE_OF_WAY;
    assert_eq!([of(&[-2.0]), of(&[1.0, -2.0])], [expected; 2]);
    assert_close(expected, 0.9_f64.powi(8), "0.9^8");
    // A step to the edge itself is too long by a twentieth.
    assert_close(of(&[-1.0]), 0.9, "the edge");
    assert_close(of(&[-0.96]), 0.9, "nearly the edge");
    // The shortest is a ten-thousandth.
    assert!(of(&[-9e3]) > 1e-4 && of(&[-9e3]) < 1.1e-4 && of(&[-1e4]) == 0.0, "{} {}", of(&[-9e3]), of(&[-1e4]));
}

#[test]
fn inverses_and_sums_are_of_all_matrices() {
    let two = [Matrix { size: 1, entries: vec![4.0] }, Matrix { size: 2, entries: vec![2.0, 0.0, 0.0, 8.0] }];
    let found = inverses(&two).unwrap();
    for (found, expected) in found.iter().flat_map(|it| &it.entries).zip([0.25, 0.5, 0.0, 0.0, 0.125]) {
        assert_close(*found, expected, "inverse");
    }
    assert_eq!(products(&two, &two), 16.0 + 4.0 + 64.0);
    assert_eq!(moved(&two, 0.5, &two)[1].entries, [3.0, 0.0, 0.0, 12.0]);
    assert!(inverses(&[two[0].clone(), Matrix { size: 1, entries: vec![0.0] }]).is_none());
}

/// Squares x and matrices z of moments as a search has them on its way.
fn on_the_way(program: &Program) -> (Vec<f64>, Vec<Matrix>, Vec<Matrix>) {
    let wanted = program.wanted.iter().map(|value| value.low.midpoint(value.high)).collect();
    let z = program.matrices(program.first.as_ref().unwrap());
    let mut x = inverses(&z).unwrap();
    // Not in the middle: x times z is no multiple of 1.
    x[0].entries[0] += 0.5;
    (wanted, x, z)
}

#[test]
fn directions_solve_their_equations() {
    let program = form();
    let (wanted, x, z) = on_the_way(&program);
    let equations = Equations::of(&program, &wanted, &x, &z).unwrap();
    let rows: f64 = x.iter().map(|x| x.size as f64).sum();
    assert_eq!((rows, equations.mean), (20.0, products(&x, &z) / 20.0));
    // The diagonal of the equations is lifted, and nothing else.
    let mut increased = program.equations(&x, &inverses(&z).unwrap());
    increased.increase_diagonal(DIAGONAL_INCREASE);
    assert_eq!(equations.unit, increased.factor().unwrap().solved(&program.unit));
    // What is left of the coefficients after a direction is what the lift and rounding leave: LIFT and 2^-52 times the condition of the equations.
    let near = |list: &[f64], what: &str| assert!(list.iter().all(|value| value.abs() < 1e-9), "{what}: {list:?}");
    for share in [0.0, 0.3] {
        let targets: Vec<Matrix> = equations.inverse.iter().map(|z| z.scaled(share)).collect();
        let (m, moments, dz, squares) = equations.direction(&targets);
        near(&equations.excess(&squares, m), "excess");
        near(&[dot(&program.unit, &moments)], "u'u");
        for (one, other) in dz.iter().zip(&program.matrices(&moments)) {
            assert_eq!(one.entries, other.entries);
        }
        // squares = target - x dZ z^-1.
        for (k, square) in squares.iter().enumerate() {
            let bent = x[k].times(&dz[k]).times(&equations.inverse[k]).symmetric();
            for (place, entry) in square.entries.iter().enumerate() {
                assert_close(*entry, targets[k].entries[place] - bent.entries[place], "squares");
            }
        }
    }
    let (m, squares) = equations.centre();
    let targets: Vec<Matrix> = equations.inverse.iter().map(|z| z.scaled(equations.mean)).collect();
    let (expected, _, _, same) = equations.direction(&targets);
    assert!(m == expected && squares.iter().zip(&same).all(|(one, other)| one.entries == other.entries));
}

#[test]
fn an_excess_is_what_squares_have_too_much() {
    let program = form();
    let (wanted, x, z) = on_the_way(&program);
    let equations = Equations::of(&program, &wanted, &x, &z).unwrap();
    let coefficients = program.coefficients(&x);
    for (k, excess) in equations.excess(&x, 0.25).into_iter().enumerate() {
        assert_eq!(excess, coefficients[k] + (0.25 * program.unit[k] - wanted[k]), "{k}");
    }
    // Twice what rounding leaves is taken away.
    let mut expected = x.clone();
    for _ in 0..REFINEMENTS {
        let missing = program.matrices(&equations.factor.solved(&equations.excess(&expected, 0.25)));
        for (k, square) in expected.iter_mut().enumerate() {
            *square = square.plus(-1.0, &x[k].times(&missing[k]).times(&equations.inverse[k]).symmetric());
        }
    }
    // Refined squares have no more than rounding leaves.
    let norm = |list: Vec<f64>| list.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let refined = equations.refined(0.25, x.clone());
    assert!(norm(equations.excess(&x, 0.25)) > 0.1 && norm(equations.excess(&refined, 0.25)) < 1e-13);
    for (refined, expected) in refined.iter().zip(&expected) {
        assert_eq!(refined.entries, expected.entries);
    }
}

#[test]
fn a_step_corrects_what_its_first_half_did() {
    let program = form();
    let (wanted, x, z) = on_the_way(&program);
    let equations = Equations::of(&program, &wanted, &x, &z).unwrap();
    let nothing: Vec<Matrix> = x.iter().map(|x| Matrix::zeros(x.size)).collect();
    let tried = equations.step_to(&nothing);
    let after = products(&moved(&x, tried.of_squares, &tried.squares), &moved(&z, tried.of_moments, &tried.dz));
    let share = (after / products(&x, &z)).clamp(0.0, 1.0).powi(3);
    assert!(share > 0.0 && share < 0.5, "{share}");
    let bent: Vec<Matrix> =
        (0..x.len()).map(|k| tried.squares[k].times(&tried.dz[k]).times(&equations.inverse[k]).symmetric()).collect();
    let targets: Vec<Matrix> =
        (0..x.len()).map(|k| equations.inverse[k].scaled(share * equations.mean).plus(-1.0, &bent[k])).collect();
    let (expected, found) = (equations.step_to(&targets), equations.step());
    assert_eq!((found.m, found.of_squares, found.of_moments), (expected.m, expected.of_squares, expected.of_moments));
    assert_eq!(found.moments, expected.moments);
    // The change of the squares leads from x to those of the direction.
    let (_, _, _, squares) = equations.direction(&targets);
    for (k, change) in found.squares.iter().enumerate() {
        assert_eq!(change.entries, squares[k].plus(-1.0, &x[k]).entries);
        assert!(x[k].plus(found.of_squares, change).factor().is_some());
        assert_eq!(found.whole(&x)[k].entries, x[k].plus(1.0, change).entries);
    }
}

#[test]
fn a_share_of_the_mean_is_that_which_was_left_to_the_third_power() {
    assert_eq!([share_of_mean(1.0, 2.0), share_of_mean(3.0, 2.0), share_of_mean(-1.0, 2.0)], [0.125, 1.0, 0.0]);
    let of = |of_squares: f64, of_moments: f64| {
        let (squares, moments, dz) = (Vec::new(), Vec::new(), Vec::new());
        Step { m: 0.0, squares, moments, dz, of_squares, of_moments }.is_too_short()
    };
    assert_eq!([of(SHORTEST, 0.0), of(0.0, SHORTEST), of(9e-5, 9e-5), of(1.5e-4, 0.0)], [false, false, true, false]);
}

/// What is left of the coefficients is taken from m by rows, and never too little of it: rounding goes down.
#[test]
fn what_squares_leave_is_counted_in_its_rows() {
    assert!(less(1.0, 1e-20) < 1.0 && less(1.0, 0.25) < 0.75 && less(1.0, 0.25) > 0.7499);
    let program = form();
    for (diagonal, beside) in [(0.125, 0.0), (0.0625, 0.03125), (0.25, -0.03125)] {
        let square = |block: &Block| {
            let entry = |k: usize| if k / block.rows == k % block.rows { diagonal } else { beside };
            Matrix { size: block.rows, entries: (0..block.rows * block.rows).map(entry).collect() }
        };
        let squares: Vec<Matrix> = program.blocks.iter().map(square).collect();
        for m in [0.0, 0.5, -0.5] {
            // In f64 without rounding: all numbers are multiples of 2^-12.
            let coefficients = program.coefficients(&squares);
            let mut rows = [0.0, 0.0];
            for (k, coefficient) in coefficients.iter().enumerate() {
                let wanted = program.wanted[k].low.midpoint(program.wanted[k].high);
                let left = (wanted - m * program.unit[k] - coefficient).abs();
                match k % 3 {
                    0 => rows[0] += left,
                    2 => rows[1] += left,
                    _ => rows.iter_mut().for_each(|row| *row += 0.5 * left),
                }
            }
            let (expected, found) = (m - rows[0].max(rows[1]), program.proven(&squares, m));
            assert!(rows[0] != rows[1] && found <= expected && found > expected - 1e-13, "{found:e} {expected:e}");
        }
    }
}

#[test]
fn where_no_point_was_found_every_variable_is_as_wide() {
    let program = Program { first: None, ..form() };
    let mut work = Work { left: 1 << 30 };
    assert!(matches!(program.solved(0.0, &mut work), Outcome::Open(spreads) if spreads == [(0, 1.0), (1, 1.0)]));
    assert_eq!(work.left, 1 << 30);
}

/// What became of a program, and after how many steps.
fn told(program: &Program, aim: f64) -> (Outcome, u64) {
    let of_step = (program.wanted.len() as u64).pow(3);
    let mut work = Work { left: 100 * of_step };
    let outcome = program.solved(aim, &mut work);
    (outcome, 100 - work.left / of_step)
}

/// The bound that is proven, and after how many steps.
fn bound(program: &Program, aim: f64) -> (f64, u64) {
    match told(program, aim) {
        (Outcome::Bound(bound), steps) => (bound, steps),
        _ => panic!("no bound of {aim}"),
    }
}

#[test]
fn a_bound_that_was_proven_is_proven_in_as_many_steps() {
    let program = form();
    let mut last = 0;
    for aim in [-9.0, 0.0, 1.0, 1.5] {
        let (found, steps) = bound(&program, aim);
        assert!(found >= aim && steps >= last, "{aim}: {found} {steps}");
        // The least eigenvalue is that at some point, and no more than at the corner (0, 1).
        assert!(found <= 3.5 - 1.25_f64.sqrt(), "{aim}: {found}");
        assert_eq!(bound(&program, found), (found, steps));
        last = steps;
    }
}

#[test]
fn a_number_that_a_form_only_reaches_costs_steps() {
    // The constant 2: its moments give 2 for ever, and no m of 2 is proven.
    let (entries, weights) = scaled(&[vec![(vec![0], 2.0)]], 1);
    let program = Program::new(&entries, 1, &weights, 1).unwrap();
    assert!(matches!(told(&program, 2.0), (Outcome::Open(_), steps) if steps > 0));
    assert!(matches!(told(&program, 2.0_f64.next_up()), (Outcome::Open(_), 0)));
}

#[test]
fn a_proof_takes_so_many_steps() {
    // What a change of the search's constants or of its formulas makes longer is seen here; all sums have a fixed order.
    let program = form();
    assert_eq!([-9.0, 1.0, 1.9, 1.99].map(|aim| bound(&program, aim).1), [3, 4, 5, 7]);
    // Where there are no squares of this degree, after so many.
    let open = [2.1, 2.5, 3.0, 4.0].map(|aim| {
        let (outcome, steps) = told(&program, aim);
        assert!(matches!(outcome, Outcome::Open(_)));
        steps
    });
    assert_eq!(open, [5, 4, 3, 2]);
}
