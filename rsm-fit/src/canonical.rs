//! Canonical analysis: the stationary point of a second-order surface, and whether it is a maximum, a minimum or a saddle.
//!
//! In: a second-order surface of plain coded (or natural) variables and its inputs. Out: the stationary point in natural units, and the eigenvalues
//! of the matrix of second-order coefficients in the variables of the polynomial, largest first. `None` for any other surface, and for a singular
//! matrix (a ridge has no single stationary point). The stationary point may be outside the data; the reader must check this.
//!
//! Source: Myers, Montgomery, Anderson-Cook, Response Surface Methodology, 6.3: y = b0 + x'b + x'Bx, x_s = -1/2 B^-1 b.

use nalgebra::{DMatrix, DVector};
use rsm_core::model::{Coding, Input, Surface};
use rsm_core::order;
use serde::Serialize;

use crate::design::{Coded, Physical, order};
use crate::observations::Named;

/// The form of a second-order surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Canonical {
    /// The point with zero gradient, in natural units.
    pub stationary_point: Named<f64>,
    /// Curvatures along the principal axes, the largest first.
    pub eigenvalues: Vec<f64>,
    /// The kind of the stationary point.
    pub kind: Kind,
}

/// The kind of a stationary point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// All curvatures are negative.
    Maximum,
    /// All curvatures are positive.
    Minimum,
    /// Some curvatures are positive, some negative.
    Saddle,
}

/// Analyses a fitted surface. `inputs` are those of the surface, in its order.
#[must_use]
pub(crate) fn analyse(surface: &Surface, inputs: &[Input]) -> Option<Canonical> {
    let has_own_variables = surface.width() == surface.inputs.len() && surface.reciprocal.is_empty();
    // Between two levels of a category there is no point.
    let plain = surface.symmetry.is_empty() && has_own_variables && surface.categories.is_empty();
    let highest = surface.terms.iter().map(|term| order(&term.powers)).max()?;
    if !plain || highest != 2 {
        return None;
    }
    let width = inputs.len();
    let mut slope = DVector::zeros(width);
    let mut matrix = DMatrix::zeros(width, width);
    for term in &surface.terms {
        let active: Vec<usize> = (0..width).filter(|k| term.powers[*k] > 0).collect();
        match active[..] {
            [k] if term.powers[k] == 1 => slope[k] = term.coefficient,
            [k] => matrix[(k, k)] = term.coefficient,
            [j, k] => {
                matrix[(j, k)] = term.coefficient / 2.0;
                matrix[(k, j)] = term.coefficient / 2.0;
            }
            _ => {}
        }
    }
    let mut eigenvalues: Vec<f64> = matrix.clone().symmetric_eigenvalues().iter().copied().collect();
    order::descending(&mut eigenvalues, |it| *it);
    let (least, most) =
        eigenvalues.iter().fold((f64::INFINITY, 0.0f64), |(low, high), e| (low.min(e.abs()), high.max(e.abs())));
    // The eigenvalues have the rounding error of f64, 2^-53 of the largest. A curvature below a hundred times that has no certain sign.
    if least <= 1e-14 * most {
        return None;
    }
    let stationary = matrix.lu().solve(&(slope * -0.5))?;
    let natural = |(input, x): (&Input, &f64)| (input.name.clone(), natural(surface.coding, input, Coded(*x)).0);
    // mutant `> to >=`: none of them is 0, which is at most 1e-14 of the largest.
    let kind = match (eigenvalues.first()? > &0.0, eigenvalues.last()? > &0.0) {
        (true, true) => Kind::Minimum,
        (false, _) => Kind::Maximum,
        (true, false) => Kind::Saddle,
    };
    Some(Canonical { stationary_point: Named(inputs.iter().zip(stationary.iter()).map(natural).collect()), eigenvalues, kind })
}

/// xi = mid + half x, the inverse of (22), (23).
fn natural(coding: Coding, input: &Input, x: Coded) -> Physical {
    let [low, high] = input.range;
    match coding {
        Coding::None => Physical(x.0),
        Coding::Range => Physical((high + low) / 2.0 + (high - low) / 2.0 * x.0),
    }
}

#[cfg(test)]
mod tests {
    use rsm_core::model::{Outside, Term};

    use super::*;

    fn analysed(coding: Coding, range: [f64; 2], terms: &[([u32; 3], f64)], inputs: usize) -> Option<Canonical> {
        let names: Vec<String> = (0..inputs).map(|k| format!("x{k}")).collect();
        let inputs: Vec<Input> =
            names.iter().map(|name| Input { name: name.clone(), unit: "1".into(), range, outside: Outside::Clamp }).collect();
        let term = |(powers, coefficient): &([u32; 3], f64)| Term {
            powers: powers[..names.len()].to_vec(),
            coefficient: *coefficient,
        };
        let surface = Surface { inputs: names.clone(), coding, terms: terms.iter().map(term).collect(), ..Surface::default() };
        analyse(&surface, &inputs)
    }

    fn is_near(found: &[f64], expected: &[f64]) {
        assert!(
            found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-13),
            "{found:?} {expected:?}"
        );
    }

    #[test]
    fn a_product_of_two_inputs_turns_the_axes() {
        // B = [[1, 2], [2, 1]] has eigenvalues 3 and -1; b = (2, -4): x_s = -1/2 B^-1 b = (5/3, -4/3).
        let terms =
            [([0, 0, 0], 5.0), ([1, 0, 0], 2.0), ([0, 1, 0], -4.0), ([2, 0, 0], 1.0), ([1, 1, 0], 4.0), ([0, 2, 0], 1.0)];
        let found = analysed(Coding::None, [-9.0, 9.0], &terms, 2).unwrap();
        is_near(&found.eigenvalues, &[3.0, -1.0]);
        is_near(&found.stationary_point.0.iter().map(|(_, x)| *x).collect::<Vec<_>>(), &[5.0 / 3.0, -4.0 / 3.0]);
        assert_eq!(found.kind, Kind::Saddle);
        // Coded, over 0 to 10: xi = 5 + 5 x.
        let found = analysed(Coding::Range, [0.0, 10.0], &terms, 2).unwrap();
        is_near(&found.stationary_point.0.iter().map(|(_, x)| *x).collect::<Vec<_>>(), &[5.0 + 25.0 / 3.0, 5.0 - 20.0 / 3.0]);
    }

    #[test]
    fn three_inputs_and_every_kind() {
        // B = [[2, 0, 1], [0, 3, 0], [1, 0, 2]]: eigenvalues 3, 3, 1; b = (0, 6, 2): x_s = -1/2 (-2/3, 2, 4/3).
        let terms =
            [([2, 0, 0], 2.0), ([0, 2, 0], 3.0), ([0, 0, 2], 2.0), ([1, 0, 1], 2.0), ([0, 1, 0], 6.0), ([0, 0, 1], 2.0)];
        let found = analysed(Coding::None, [-9.0, 9.0], &terms, 3).unwrap();
        is_near(&found.eigenvalues, &[3.0, 3.0, 1.0]);
        is_near(&found.stationary_point.0.iter().map(|(_, x)| *x).collect::<Vec<_>>(), &[1.0 / 3.0, -1.0, -2.0 / 3.0]);
        assert_eq!(found.kind, Kind::Minimum);
        let turned: Vec<([u32; 3], f64)> = terms.iter().map(|(powers, b)| (*powers, -b)).collect();
        assert_eq!(analysed(Coding::None, [-9.0, 9.0], &turned, 3).unwrap().kind, Kind::Maximum);
        // A ridge, a plane and a cubic have no single stationary point that this form tells.
        assert_eq!(analysed(Coding::None, [-9.0, 9.0], &[([2, 0, 0], 1.0), ([1, 1, 0], 2.0), ([0, 2, 0], 1.0)], 2), None);
        assert_eq!(analysed(Coding::None, [-9.0, 9.0], &[([1, 0, 0], 1.0)], 1), None);
        assert_eq!(analysed(Coding::None, [-9.0, 9.0], &[([3, 0, 0], 1.0), ([2, 0, 0], 1.0)], 1), None);
    }

    /// The surface in natural variables, by its definition.
    fn value(terms: &[([u32; 3], f64)], x: &[f64]) -> f64 {
        terms
            .iter()
            .map(|(powers, b)| x.iter().zip(powers).fold(*b, |product, (x, power)| product * x.powi(*power as i32)))
            .sum()
    }

    #[test]
    fn around_the_stationary_point_the_surface_is_the_sum_of_its_curvatures() {
        // y(x_s + d) - y(x_s) = d'Bd for every d: no slope is left. Its sum over an orthonormal basis is the sum of the eigenvalues, and over the
        // range that coded variables have it is the same surface.
        let mut random = crate::random::Random::new(4);
        for inputs in 1..=3 {
            for _ in 0..20 {
                let mut draw = || crate::reference::whole(&mut random, 9) + 0.5;
                let powers: [[u32; 3]; 10] = [
                    [0, 0, 0],
                    [1, 0, 0],
                    [0, 1, 0],
                    [0, 0, 1],
                    [2, 0, 0],
                    [1, 1, 0],
                    [1, 0, 1],
                    [0, 2, 0],
                    [0, 1, 1],
                    [0, 0, 2],
                ];
                let is_here = |powers: &&[u32; 3]| powers[inputs..].iter().all(|power| *power == 0);
                let terms: Vec<([u32; 3], f64)> = powers.iter().filter(is_here).map(|powers| (*powers, draw())).collect();
                let Some(found) = analysed(Coding::None, [-9.0, 9.0], &terms, inputs) else { continue };
                let at: Vec<f64> = found.stationary_point.0.iter().map(|(_, x)| *x).collect();
                let size = 1.0 + at.iter().fold(0.0f64, |size, x| size.max(x.abs()));
                let moved = |k: usize, by: f64| {
                    at.iter().enumerate().map(|(j, x)| if j == k { x + by } else { *x }).collect::<Vec<_>>()
                };
                let mut trace = 0.0;
                for k in 0..inputs {
                    let (above, below) = (value(&terms, &moved(k, size)), value(&terms, &moved(k, -size)));
                    // Of 2^-53 of values of 10 * 10 * size^2, some of them.
                    assert!((above - below).abs() < 1e-11 * size * size, "{terms:?} {found:?}");
                    trace += ((above + below) / 2.0 - value(&terms, &at)) / (size * size);
                }
                assert!((trace - found.eigenvalues.iter().sum::<f64>()).abs() < 1e-11, "{terms:?} {found:?}");
                assert!(found.eigenvalues.is_sorted_by(|a, b| a >= b) && found.eigenvalues.len() == inputs);
                let kind = match found.eigenvalues.iter().filter(|e| **e > 0.0).count() {
                    0 => Kind::Maximum,
                    up if up == inputs => Kind::Minimum,
                    _ => Kind::Saddle,
                };
                assert_eq!(found.kind, kind);
                // Coded over [2, 12]: xi = 7 + 5 x.
                let coded = analysed(Coding::Range, [2.0, 12.0], &terms, inputs).unwrap();
                is_near(&coded.eigenvalues, &found.eigenvalues);
                for ((_, natural), x) in coded.stationary_point.0.iter().zip(&at) {
                    assert!((natural - (7.0 + 5.0 * x)).abs() < 1e-14 * (7.0 + 5.0 * x.abs()));
                }
            }
        }
    }

    #[test]
    fn a_curvature_that_rounding_may_have_made_is_a_ridge() {
        let of =
            |a: f64, b: f64| analysed(Coding::None, [-9.0, 9.0], &[([2, 0, 0], a), ([0, 2, 0], b)], 2).map(|found| found.kind);
        for small in [1.0, 1e-20] {
            assert_eq!([of(small, 1e-14 * small), of(small, -0.5e-14 * small)], [None, None]);
            assert_eq!([of(-small, -1e-14 * small), of(-small, 0.5e-14 * small)], [None, None]);
            assert_eq!(of(small, 1.5e-14 * small), Some(Kind::Minimum));
            assert_eq!(of(-small, -1.5e-14 * small), Some(Kind::Maximum));
            assert_eq!([of(small, -small), of(-small, 1.5e-14 * small)], [Some(Kind::Saddle); 2]);
            assert_eq!(of(-small, -0.5 * small), Some(Kind::Maximum));
        }
    }

    #[test]
    fn surfaces_of_other_forms_have_no_canonical_analysis() {
        use rsm_core::model::{Knot, Symmetry};
        let input = Input { name: "x".into(), unit: "1".into(), range: [1.0, 9.0], outside: Outside::Clamp };
        let parabola = |powers: &[u32]| Surface {
            inputs: vec!["x".into()],
            terms: vec![Term { powers: powers.to_vec(), coefficient: 1.0 }],
            ..Surface::default()
        };
        let of = |surface: &Surface| analyse(surface, std::slice::from_ref(&input)).is_some();
        assert!(of(&parabola(&[2])));
        assert!(!of(&Surface { symmetry: vec![("x".into(), Symmetry::Even)], ..parabola(&[2]) }));
        assert!(!of(&Surface { reciprocal: vec!["x".into()], ..parabola(&[2]) }));
        assert!(!of(&Surface { knots: vec![Knot { input: "x".into(), at: 5.0 }], ..parabola(&[2, 0]) }));
        assert!(!of(&Surface { terms: Vec::new(), ..parabola(&[2]) }));
    }
}
