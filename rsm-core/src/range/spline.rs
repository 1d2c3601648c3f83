//! The range of a spline over its box.
//!
//! In: a spline and the ranges of its inputs. Out: an enclosure of its values, and points with small and large values. A spline of degree 1 is
//! between its coefficients. One of degree 3 is a polynomial in Bernstein form in each cell, and between the coefficients of these forms (Boehm,
//! "Inserting new knots into B-spline curves", 1980): with h the width of a cell, the excess is proportional to h^2.

use crate::basis;
use crate::interval::Interval;
use crate::model::{Input, Spline};

use super::Extent;

pub(super) fn extent(spline: &Spline, inputs: &[Input]) -> Extent {
    let mut counts = spline.counts();
    let mut values: Vec<Interval> = spline.coefficients.iter().map(|it| Interval::point(*it)).collect();
    if spline.degree == 3 {
        for k in 0..counts.len() {
            values = bernstein_along(&values, &counts, k);
            counts[k] = 3 * spline.cells[k] as usize + 1;
        }
    }
    let range = values.iter().copied().reduce(Interval::hull).expect("a spline has coefficients");
    // Every coefficient belongs to a point: the Greville abscissae.
    let ranges: Vec<[f64; 2]> = inputs.iter().map(|input| input.range).collect();
    let mut seen: [Option<(f64, Vec<f64>)>; 2] = [None, None];
    let mut place = vec![0usize; counts.len()];
    loop {
        let share = |k: usize| place[k] as f64 / (counts[k] - 1) as f64;
        let at = |k: usize, [low, high]: [f64; 2]| (low * (1.0 - share(k)) + high * share(k)).clamp(low, high);
        let point: Vec<f64> = ranges.iter().enumerate().map(|(k, range)| at(k, *range)).collect();
        let value = basis::spline(spline, &ranges, &point);
        for (best, value) in seen.iter_mut().zip([value, -value]) {
            if best.as_ref().is_none_or(|(least, _)| value < *least) {
                *best = Some((value, point.clone()));
            }
        }
        let Some(next) = (0..counts.len()).find(|k| place[*k] + 1 < counts[*k]) else { break };
        place[next] += 1;
        place[..next].fill(0);
    }
    let [least_at, greatest_at] = seen.map(|best| best.map_or_else(Vec::new, |(_, point)| point));
    Extent { range, least_at, greatest_at }
}

/// The coefficients of the Bernstein forms of all cells along one input, with the shared ones once.
fn bernstein_along(values: &[Interval], counts: &[usize], k: usize) -> Vec<Interval> {
    let inner: usize = counts[k + 1..].iter().product();
    let (third, sixth) = (share(3), share(6));
    let number = Interval::point;
    let mut found = Vec::new();
    for block in values.chunks(counts[k] * inner) {
        let at = |cell: usize, i: usize| block[cell * inner + i];
        let cells = counts[k] - 3;
        let end = |cell: usize, i: usize| (at(cell, i) + at(cell + 1, i) * number(4.0) + at(cell + 2, i)) * sixth;
        for cell in 0..cells {
            found.extend((0..inner).map(|i| end(cell, i)));
            found.extend((0..inner).map(|i| (at(cell + 1, i) * number(2.0) + at(cell + 2, i)) * third));
            found.extend((0..inner).map(|i| (at(cell + 1, i) + at(cell + 2, i) * number(2.0)) * third));
        }
        found.extend((0..inner).map(|i| end(cells, i)));
    }
    found
}

/// 1/n, enclosed.
fn share(n: i64) -> Interval {
    Interval::around(&(crate::number::integer(1) / crate::number::integer(n)))
}
