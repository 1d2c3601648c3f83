//! Sigmoids as bends: their widths, their candidates, and what a term may hold.
//!
//! In: the search of bends ([`bends`](super::bends)). Out: its answers for sigmoids, which have a centre and a width.

use rsm_core::basis::Shape;
use rsm_core::model::{Sigmoid, Surface};
use rsm_core::order;

use super::bends::{Kind, Place, Rows, Search, Side, Step, rounded};
use crate::design;

/// Candidate widths, as shares of the range.
const WIDTHS: [f64; 4] = [0.5, 0.15, 0.05, 0.015];

/// Sigmoids. The second number of a place is the logarithm of the width, as a share of the range.
pub(super) struct Sigmoids;

impl Kind for Sigmoids {
    type Bend = Sigmoid;
    const NUMBERS: usize = 2;
    const COUNTED: usize = 2;
    const CENTRES: usize = 11;

    /// The highest order: terms of lower orders are among its terms.
    fn orders(highest: u32) -> Vec<u32> {
        vec![highest]
    }

    fn terms(surface: &Surface, bends: &[&str], order: u32) -> Vec<Vec<u32>> {
        let sigmoid = |input: &&str| Sigmoid { input: (*input).to_string(), at: 0.0, width: 1.0 };
        design::terms_up_to(&Surface { sigmoids: bends.iter().map(sigmoid).collect(), ..surface.clone() }, order)
    }

    fn values(side: &Side, place: Place, xi: &[f64]) -> Vec<f64> {
        let (at, width) = (side.low + place[0] * side.span, place[1].exp() * side.span);
        let offset = if side.is_symmetric { Shape::step(-at, width) } else { 0.0 };
        xi.iter().map(|xi| Shape::step(xi - at, width) - offset).collect()
    }

    /// The smallest width that the rows can show, as a share of the range: half of the median distance of neighbouring values. The largest is 4.
    fn limits(search: &Search<'_, Self>, rows: &Rows, input: usize, _: u32) -> [f64; 2] {
        let Side { span, .. } = search.side(input);
        let mut gaps: Vec<f64> = rows.sorted[input].windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > 0.0).collect();
        order::sort(&mut gaps);
        [(gaps.get(gaps.len() / 2).copied().unwrap_or(span) / span / 2.0).max(1e-3), 4.0]
    }

    fn starts(centres: &[f64], [narrowest, _]: [f64; 2]) -> Vec<Place> {
        let widths = WIDTHS.into_iter().filter(|width| *width >= narrowest);
        centres.iter().flat_map(|centre| widths.clone().map(|width| [*centre, width.ln()])).collect()
    }

    fn moved(place: Place, by: &[f64], [narrowest, widest]: [f64; 2]) -> Place {
        // At most about one width in a step, because the linear approximation is not valid further away.
        let width = place[1].exp();
        let centre = place[0] + by[0].clamp(-2.0 * width, 2.0 * width);
        let logarithm = place[1] + by[1].clamp(-1.0, 1.0);
        [centre.clamp(-0.5, 1.5), logarithm.clamp(narrowest.ln(), widest.ln())]
    }

    /// The limits of the width suffice.
    fn is_determined(_: &Search<'_, Self>, _: &Rows, _: &[Step], _: u32) -> bool {
        true
    }

    /// Rounds to 10^-5 of the width.
    fn bend(input: &str, side: &Side, place: Place) -> Sigmoid {
        let width = place[1].exp() * side.span;
        let unit = 10f64.powi((width.log10() - 4.0).floor() as i32);
        let at = rounded(side.low + place[0] * side.span, unit);
        Sigmoid { input: input.to_string(), at, width: rounded(width, unit) }
    }

    fn place(bend: &Sigmoid, side: &dyn Fn(&str) -> Option<(usize, Side)>) -> Option<Step> {
        let (input, side) = side(&bend.input)?;
        Some(Step { input, place: [(bend.at - side.low) / side.span, (bend.width / side.span).ln()] })
    }
}
