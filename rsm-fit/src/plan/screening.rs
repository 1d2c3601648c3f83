//! Definitive screening designs: three levels, 2 m + 1 runs for an even number m of factors.
//!
//! In: the number of factors. Out: points of -1, 0 and 1. Main effects are not aliased with squares and interactions, and no two second-order effects
//! are completely aliased (Jones, Nachtsheim 2011). The rows of a conference matrix C, with C C' = (m - 1) I, and their mirror images (Xiao, Lin, Bai
//! 2012); for an odd number of factors one column is omitted. The matrices are Paley's of 1933 for a prime or 9, and for 16 the doubling of a skew
//! one.

use super::points::Points;

/// The points: rows, their mirror images, the centre. `None` for fewer than 3 or more than 16 factors.
pub(super) fn points(factors: usize) -> Option<Points> {
    let order = (factors + factors % 2).max(4);
    let matrix = (factors >= 3).then(|| conference(order)).flatten()?;
    let mut points = Points::new();
    for row in &matrix {
        points.push(row[..factors].iter().map(|x| f64::from(*x)).collect());
        points.push(row[..factors].iter().map(|x| f64::from(-*x)).collect());
    }
    points.push(vec![0.0; factors]);
    Some(points)
}

/// A matrix with zeros on the diagonal, -1 and 1 elsewhere, and orthogonal rows.
fn conference(order: usize) -> Option<Vec<Vec<i8>>> {
    match order {
        4 | 6 | 8 | 10 | 12 | 14 => Some(paley(order - 1)),
        16 => {
            // [C, C + I; C - I, -C] of a skew C.
            let small = paley(7);
            let at = |i: usize, j: usize| {
                let one = i8::from(i % 8 == j % 8);
                let c = small[i % 8][j % 8];
                match (i < 8, j < 8) {
                    (true, true) => c,
                    (true, false) => c + one,
                    (false, true) => c - one,
                    (false, false) => -c,
                }
            };
            Some((0..16).map(|i| (0..16).map(|j| at(i, j)).collect()).collect())
        }
        _ => None,
    }
}

/// Paley's matrix with a border of ones: the entry of two elements of the field of `q` is 1 if their difference is a square, otherwise -1.
fn paley(q: usize) -> Vec<Vec<i8>> {
    // The field of 9: a + 3 b is a + b i, and i^2 = -1.
    let minus = |a: usize, b: usize| match q {
        9 => (3 + a % 3 - b % 3) % 3 + 3 * ((3 + a / 3 - b / 3) % 3),
        _ => (q + a - b) % q,
    };
    let square = |a: usize| match q {
        9 => (a % 3 * (a % 3) + 2 * (a / 3) * (a / 3)) % 3 + 3 * (2 * (a % 3) * (a / 3) % 3),
        _ => a * a % q,
    };
    let squares: Vec<usize> = (1..q).map(square).collect();
    // If -1 is not a square, the matrix is skew, and the border has two signs.
    let border = if q % 4 == 3 { -1 } else { 1 };
    let entry = |i: usize, j: usize| match (i, j) {
        (0, 0) => 0,
        (0, _) => 1,
        (_, 0) => border,
        _ if i == j => 0,
        _ => {
            if squares.contains(&minus(i - 1, j - 1)) {
                1
            } else {
                -1
            }
        }
    };
    (0..=q).map(|i| (0..=q).map(|j| entry(i, j)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn main_effects_are_at_right_angles_to_each_other_and_to_all_of_second_order() {
        for factors in 3..=16 {
            let points = points(factors).unwrap();
            let even = factors + factors % 2;
            assert_eq!(points.len(), 2 * even + 1, "{factors}");
            let moment = |of: &dyn Fn(&[f64]) -> f64| points.iter().map(|x| of(x)).sum::<f64>();
            for a in 0..factors {
                assert_eq!(moment(&|x| x[a] * x[a]), 2.0 * (even as f64 - 1.0), "{factors} {a}");
                for b in 0..factors {
                    assert!(a == b || moment(&|x| x[a] * x[b]) == 0.0, "{factors}: {a} {b}");
                    for c in 0..factors {
                        assert_eq!(moment(&|x| x[a] * x[b] * x[c]), 0.0);
                    }
                }
            }
        }
        assert!(points(2).is_none() && points(17).is_none());
    }
}
