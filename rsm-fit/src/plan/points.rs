//! The points of the standard designs, in coded variables.
//!
//! In: the number of factors and the parameters of the design. Out: points with one coded number for each factor, in standard order (the first factor
//! changes fastest). Units, levels and run order are not used here.
//!
//! Sources: Box, Wilson 1951 (central composite); Box, Hunter 1957 (the rotatable axial distance F^(1/4) for F factorial
//! points); Box, Behnken 1960 (designs of three levels, with their incomplete blocks); McKay, Beckman, Conover 1979 (Latin
//! hypercube); Johnson, Moore, Ylvisaker 1990 (the largest least distance as its measure).

use crate::random::Random;

/// Coded points: one number for each factor.
pub(super) type Points = Vec<Vec<f64>>;

/// Every combination of the levels of each factor.
pub(super) fn full_factorial(levels: &[Vec<f64>]) -> Points {
    let mut points = vec![Vec::new()];
    for of_factor in levels {
        // The levels outside: the first factor changes fastest.
        points =
            of_factor.iter().flat_map(|level| points.iter().map(|point: &Vec<f64>| [&point[..], &[*level]].concat())).collect();
    }
    points
}

/// The axial distance for which the variance of a prediction depends only on the distance from the centre.
pub(super) fn rotatable_alpha(factors: usize) -> f64 {
    // The fourth root of 2^factors. Square roots are correctly rounded on every machine; powers are not.
    f64::from(1u32 << factors).sqrt().sqrt()
}

/// The corners of the cube, and two axial points for each factor.
pub(super) fn central_composite(factors: usize, alpha: f64) -> Points {
    let mut points = full_factorial(&vec![vec![-1.0, 1.0]; factors]);
    for factor in 0..factors {
        for end in [-alpha, alpha] {
            let mut point = vec![0.0; factors];
            point[factor] = end;
            points.push(point);
        }
    }
    points
}

/// The groups of factors that change together, while the others stay at their centre. `None` if no such design for this number is known here.
pub(super) fn box_behnken_groups(factors: usize) -> Option<Vec<Vec<usize>>> {
    match factors {
        3..=5 => Some((0..factors).flat_map(|a| (a + 1..factors).map(move |b| vec![a, b])).collect()),
        // Cyclic: every factor is in three groups.
        6 => Some((0..6).map(|k| vec![k, (k + 1) % 6, (k + 3) % 6]).collect()),
        // The lines of the projective plane of order 2: every pair of factors is in one group.
        7 => Some((0..7).map(|k| vec![k, (k + 1) % 7, (k + 3) % 7]).collect()),
        _ => None,
    }
}

/// The points at the middles of edges (of faces, for 6 and 7 factors).
pub(super) fn box_behnken(factors: usize) -> Option<Points> {
    let mut points = Vec::new();
    for group in box_behnken_groups(factors)? {
        for corner in full_factorial(&vec![vec![-1.0, 1.0]; group.len()]) {
            let mut point = vec![0.0; factors];
            for (factor, value) in group.iter().zip(corner) {
                point[*factor] = value;
            }
            points.push(point);
        }
    }
    Some(points)
}

/// The largest number of pairs whose distance is computed in the search for the best hypercube: about a second.
const PAIRS: usize = 20_000_000;

/// The largest number of candidates in that search; more hardly increase the smallest distance.
const CANDIDATES: usize = 100;

/// Of several Latin hypercubes, the one with the largest smallest distance between two runs. Each of the `runs` equal slices of a factor has one run,
/// at a random place in the slice.
pub(super) fn latin_hypercube(factors: usize, runs: usize, random: &mut Random) -> Points {
    let tries = (PAIRS / (runs * runs).max(1)).clamp(1, CANDIDATES);
    let mut best = (f64::NEG_INFINITY, Vec::new());
    for _ in 0..tries {
        let points = hypercube(factors, runs, random);
        let distance = if tries > 1 { least_distance(&points) } else { 0.0 };
        if distance > best.0 {
            best = (distance, points);
        }
    }
    best.1
}

fn hypercube(factors: usize, runs: usize, random: &mut Random) -> Points {
    let mut column = || -> Vec<f64> {
        let mut slices: Vec<usize> = (0..runs).collect();
        random.shuffle(&mut slices);
        slices.into_iter().map(|slice| 2.0 * (slice as f64 + random.share()) / runs as f64 - 1.0).collect()
    };
    let columns: Vec<Vec<f64>> = (0..factors).map(|_| column()).collect();
    (0..runs).map(|run| columns.iter().map(|column| column[run]).collect()).collect()
}

/// The square of the smallest distance between two points.
pub(super) fn least_distance(points: &Points) -> f64 {
    let mut least = f64::INFINITY;
    for (k, one) in points.iter().enumerate() {
        for other in &points[k + 1..] {
            least = least.min(one.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum());
        }
    }
    least
}

/// A uniformly distributed random point of the cube.
pub(super) fn anywhere(factors: usize, random: &mut Random) -> Vec<f64> {
    (0..factors).map(|_| 2.0 * random.share() - 1.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotatable_distances_and_box_behnken_counts_are_those_of_the_r_package_rsm() {
        // R rsm 2.10.6: alpha of ccd() for 2 to 5 factors, runs of bbd() without centre points for 3 to 7.
        for (factors, alpha) in [(2, 2f64.sqrt()), (3, 1.681793), (4, 2.0), (5, 2.378414)] {
            // Half a unit of its last printed digit.
            assert!((rotatable_alpha(factors) - alpha).abs() < 5e-7, "{factors}");
        }
        for (factors, runs) in [(3, 12), (4, 24), (5, 40), (6, 48), (7, 56)] {
            assert_eq!(box_behnken(factors).unwrap().len(), runs);
        }
        assert!(box_behnken(2).is_none() && box_behnken(8).is_none());
    }

    #[test]
    fn second_order_designs_have_balanced_moments() {
        // sum x_i = sum x_i x_j = sum x_i^2 x_j = 0, and sum x_i^2 the same for every factor; a wrong group breaks the last.
        let designs = (2..=5).map(|k| central_composite(k, rotatable_alpha(k))).chain((3..=7).filter_map(box_behnken));
        for points in designs {
            let factors = points[0].len();
            let moment = |of: &dyn Fn(&[f64]) -> f64| points.iter().map(|point| of(point)).sum::<f64>();
            for i in 0..factors {
                // Sums of products of +-1 and of pairs that cancel: exact.
                assert_eq!(moment(&|x| x[i]), 0.0);
                assert_eq!(moment(&|x| x[i] * x[i]), moment(&|x| x[0] * x[0]), "{factors} factors");
                for j in (0..factors).filter(|j| *j != i) {
                    assert_eq!((moment(&|x| x[i] * x[j]), moment(&|x| x[i] * x[i] * x[j])), (0.0, 0.0));
                }
            }
        }
        // Rotatable: sum x_i^4 = 3 sum x_i^2 x_j^2 (Box, Hunter 1957). For 4 factors all is exact: 16 + 2 * 16 = 3 * 16.
        let points = central_composite(4, rotatable_alpha(4));
        let fourth: f64 = points.iter().map(|x| x[0].powi(4)).sum();
        let mixed: f64 = points.iter().map(|x| x[0] * x[0] * x[1] * x[1]).sum();
        assert_eq!(fourth, 3.0 * mixed);
    }

    #[test]
    fn a_latin_hypercube_has_one_run_in_every_slice() {
        let runs = 17;
        let points = latin_hypercube(3, runs, &mut Random::new(5));
        for factor in 0..3 {
            let slice = |point: &Vec<f64>| ((point[factor] + 1.0) / 2.0 * runs as f64).floor() as usize;
            let mut slices: Vec<usize> = points.iter().map(slice).collect();
            slices.sort_unstable();
            assert_eq!(slices, (0..runs).collect::<Vec<_>>());
        }
        // The search is worth its time: no single hypercube of twenty other seeds is as good.
        let single = (20..40).map(|seed| least_distance(&hypercube(3, runs, &mut Random::new(seed)))).fold(0.0, f64::max);
        assert!(least_distance(&points) > single, "{single}");
    }

    #[test]
    fn a_full_factorial_comes_in_standard_order() {
        let points = full_factorial(&[vec![1.0, 2.0], vec![5.0, 6.0, 7.0]]);
        assert_eq!(points, [[1.0, 5.0], [2.0, 5.0], [1.0, 6.0], [2.0, 6.0], [1.0, 7.0], [2.0, 7.0]]);
    }
}
