//! The region in which the data support a surface: half-spaces in coded variables that contain every fitted row.
//!
//! In: a surface without terms, its inputs, the rows to fit. Out: half-spaces for the model file. For one input: from the smallest to the largest
//! value. For two: their box, then one edge of the convex hull after another, each time the one that cuts off most, until the allowed number is
//! reached or no further edge cuts off enough. For more: for each direction of {-1, 0, 1}^n the tightest half-space that contains the points. No row
//! is cut off: bounds are rounded outward by more than the rounding error of the emitted test. Responses are not used.
//!
//! Inside the convex hull a surface interpolates, without hidden extrapolation (Brooks, Carroll, Verdini 1988; Montgomery, Peck, Vining, Introduction
//! to Linear Regression Analysis, 3.8).

use rsm_core::basis::Factor;
use rsm_core::model::{Coding, HalfSpace, Input, Surface};
use serde::Serialize;

use crate::dd::Dd;
use crate::design::Physical;
use crate::observations::Observations;
use crate::random::Random;
use crate::spec::SupportSpec;

/// The report on the support of a surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SupportStatistics {
    /// The number of half-spaces.
    pub half_spaces: usize,
    /// The share of the box in which all of them hold.
    pub share_of_box: f64,
    /// The number of unseen rows outside.
    pub unseen_rows_outside: usize,
}

/// With more inputs there would be hundreds of half-spaces; then a direction has at most two nonzero entries.
const ALL_DIRECTIONS: usize = 4;

/// The number of decimals of a bound below the magnitude of its sum,
const DECIMALS: i32 = 4;

/// and the smallest distance between the outermost row and the bound, as a share of the last decimal: 10^-5 of the magnitude. In f32 a coded variable
/// has an error of a few times 2^-24 = 6 * 10^-8, so the emitted test is 1 at every row in both precisions.
const GAP: f64 = 0.1;

/// The coded variables of points.
#[derive(Debug)]
pub struct Region {
    factors: Vec<Factor>,
    /// The ranges of the coded variables.
    pub(crate) sides: Vec<[f64; 2]>,
    /// The half range of natural variables; 1 for coded ones.
    scales: Vec<f64>,
}

impl Region {
    /// The region of a surface with its inputs.
    #[must_use]
    pub fn new(surface: &Surface, inputs: &[Input]) -> Self {
        let factors = Factor::all(surface, inputs);
        let sides: Vec<[f64; 2]> = inputs
            .iter()
            .zip(&factors)
            .map(|(input, factor)| {
                let symmetric = surface.symmetry.iter().any(|(name, _)| *name == input.name);
                let low = if symmetric { 0.0 } else { input.range[0] };
                let ends = [low, input.range[1]].map(|xi| factor.variable.value(Dd::from(xi)).to_f64());
                // 1/xi decreases with xi.
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            })
            .collect();
        let scale = |[low, high]: &[f64; 2]| if surface.coding == Coding::Range { 1.0 } else { (high - low) / 2.0 };
        let scales = sides.iter().map(scale).collect();
        Region { factors, sides, scales }
    }

    /// The coded variables of a point as measured.
    #[must_use]
    pub fn coded(&self, point: &[Physical]) -> Vec<Dd> {
        point.iter().zip(&self.factors).map(|(value, factor)| factor.variable.value(Dd::from(value.0))).collect()
    }

    /// The share of the box inside all half-spaces: exact for one and two inputs, otherwise by counting points.
    #[must_use]
    pub fn share(&self, spaces: &[HalfSpace]) -> f64 {
        let corners = |side: &[f64; 2]| side[1] - side[0];
        match self.sides.as_slice() {
            [side] => {
                let (mut low, mut high) = (side[0], side[1]);
                for space in spaces {
                    let cut = space.bound / space.normal[0];
                    if space.normal[0] > 0.0 { high = high.min(cut) } else { low = low.max(cut) }
                }
                (high - low).max(0.0) / corners(side)
            }
            [a, b] => {
                let rectangle = vec![[a[0], b[0]], [a[1], b[0]], [a[1], b[1]], [a[0], b[1]]];
                area(&spaces.iter().fold(rectangle, |polygon, space| clipped(&polygon, space))) / (corners(a) * corners(b))
            }
            sides => {
                // 2^16 points from a fixed seed: the standard deviation of the share is below 0.002.
                let count = 1 << 16;
                let mut random = Random::new(0);
                let mut point =
                    || -> Vec<Dd> { sides.iter().map(|side| Dd::from(side[0] + random.share() * corners(side))).collect() };
                let inside = (0..count).filter(|_| holds(spaces, &point())).count();
                inside as f64 / f64::from(count)
            }
        }
    }
}

/// Whether all half-spaces contain a point in coded variables.
#[must_use]
pub fn holds(spaces: &[HalfSpace], coded: &[Dd]) -> bool {
    spaces.iter().all(|space| sum(&space.normal, coded) <= Dd::from(space.bound))
}

/// Half-spaces that contain all rows.
#[must_use]
pub(crate) fn of_data(surface: &Surface, inputs: &[Input], rows: Observations<'_>, wanted: SupportSpec) -> Vec<HalfSpace> {
    let region = Region::new(surface, inputs);
    let coded: Vec<Vec<Dd>> = (0..rows.response.len()).map(|row| region.coded(&rows.point(row))).collect();
    let hull = if inputs.len() == 2 { hull_normals(&region, &coded, wanted.faces) } else { None };
    let is_hull = hull.is_some();
    let normals = hull.unwrap_or_else(|| directions(inputs.len()));
    let space = |normal: &Vec<f64>| half_space(&region, normal, &coded, wanted.margin);
    let spaces: Vec<HalfSpace> = normals.iter().map(space).collect();
    if is_hull { spaces } else { without_redundant(spaces) }
}

fn sum(normal: &[f64], coded: &[Dd]) -> Dd {
    normal.iter().zip(coded).map(|(n, x)| Dd::from(*n) * *x).sum()
}

/// The tightest half-space with this normal, in units of `scales`, that contains all points, plus a margin and a rounding.
fn half_space(region: &Region, normal: &[f64], coded: &[Vec<Dd>], margin: f64) -> HalfSpace {
    let length = normal.iter().map(|n| n * n).sum::<f64>().sqrt();
    let normal: Vec<f64> = normal.iter().zip(&region.scales).map(|(n, scale)| n / scale).collect();
    let farthest = coded.iter().map(|x| sum(&normal, x)).fold(Dd::from(f64::NEG_INFINITY), |a, b| if a < b { b } else { a });
    // The magnitude of the terms in the emitted test, and so of its rounding error.
    let part = |k: usize| normal[k].abs() * coded.iter().map(|x| x[k].to_f64().abs()).fold(0.0, f64::max);
    let magnitude = (0..normal.len()).map(part).fold(0.0, f64::max);
    let bound = rounded_up(farthest.to_f64() + margin * length, magnitude);
    HalfSpace { normal, bound }
}

/// The next decimal that is at least [`GAP`] of its last place above the value.
fn rounded_up(value: f64, magnitude: f64) -> f64 {
    let exponent: i32 = format!("{magnitude:e}").split_once('e').and_then(|(_, text)| text.parse().ok()).unwrap_or(0);
    let last = exponent - DECIMALS;
    let unit: f64 = format!("1e{last}").parse().expect("a decimal");
    let count = (value / unit + GAP).ceil();
    format!("{count}e{last}").parse::<f64>().expect("a decimal") + 0.0
}

/// Directions of {-1, 0, 1}^n, those along the axes first.
fn directions(inputs: usize) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new()];
    for _ in 0..inputs {
        let entries = |begun: &Vec<f64>| [-1.0, 0.0, 1.0].map(|entry| [&begun[..], &[entry]].concat());
        all = all.iter().flat_map(entries).collect();
        all.retain(|normal| inputs <= ALL_DIRECTIONS || entries_of(normal) <= 2);
    }
    all.retain(|normal| entries_of(normal) > 0);
    all.sort_by_key(|normal| entries_of(normal));
    all
}

fn entries_of(normal: &[f64]) -> usize {
    normal.iter().filter(|entry| **entry != 0.0).count()
}

/// Removes half-spaces that the box of those along the axes implies.
fn without_redundant(spaces: Vec<HalfSpace>) -> Vec<HalfSpace> {
    let axes: Vec<HalfSpace> = spaces.iter().filter(|space| entries_of(&space.normal) == 1).cloned().collect();
    let most = |input: usize, entry: f64| {
        let of_axis = |axis: &&HalfSpace| axis.normal[input] * entry > 0.0;
        axes.iter().find(of_axis).map_or(0.0, |axis| axis.bound * entry / axis.normal[input])
    };
    let cuts = |space: &HalfSpace| {
        let corner: f64 = space.normal.iter().enumerate().map(|(input, entry)| most(input, *entry)).sum();
        entries_of(&space.normal) == 1 || space.bound < corner
    };
    spaces.into_iter().filter(cuts).collect()
}

type Point = [f64; 2];

fn cross(o: Point, a: Point, b: Point) -> f64 {
    (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
}

fn area(polygon: &[Point]) -> f64 {
    let next = |k: usize| polygon[(k + 1) % polygon.len()];
    (0..polygon.len()).map(|k| polygon[k][0] * next(k)[1] - polygon[k][1] * next(k)[0]).sum::<f64>() / 2.0
}

/// The convex hull, counter-clockwise, without points on its edges (Andrew 1979).
fn convex_hull(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = &Point>| {
        let mut chain: Vec<Point> = Vec::new();
        for point in points {
            while chain.len() >= 2 && cross(chain[chain.len() - 2], chain[chain.len() - 1], *point) <= FLAT {
                chain.pop();
            }
            chain.push(*point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter());
    hull.extend(half(&mut points.iter().rev()));
    hull
}

/// A smaller turn is no corner, so rounded coded values of a grid give no additional edges.
const FLAT: f64 = 1e-9;

/// Normals of the hull of the points, at most this many. `None` if the points are on a line.
fn hull_normals(region: &Region, coded: &[Vec<Dd>], faces: usize) -> Option<Vec<Vec<f64>>> {
    let scaled = |x: &Vec<Dd>| [0, 1].map(|k| x[k].to_f64() / region.scales[k]);
    let hull = convex_hull(coded.iter().map(scaled).collect());
    if hull.len() < 3 {
        return None;
    }
    let edge = |k: usize| {
        let (from, to) = (hull[k], hull[(k + 1) % hull.len()]);
        let outward = [to[1] - from[1], from[0] - to[0]];
        let largest = outward[0].abs().max(outward[1].abs());
        // Four decimals turn an edge by up to 0.003 degrees. The bound is computed for the rounded normal.
        let normal = outward.map(|entry| (entry / largest * 1e4).round() / 1e4 + 0.0).to_vec();
        let reach = |point: &Point| normal[0] * point[0] + normal[1] * point[1];
        HalfSpace { bound: hull.iter().map(reach).fold(f64::NEG_INFINITY, f64::max), normal }
    };
    let candidates: Vec<HalfSpace> = (0..hull.len()).map(edge).collect();
    let ends = |k: usize| {
        let values = || hull.iter().map(|point| point[k]);
        [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
    };
    let ([left, right], [bottom, top]) = (ends(0), ends(1));
    let mut polygon = vec![[left, bottom], [right, bottom], [right, top], [left, top]];
    // The bounding box first, because points outside the range of an input are not supported.
    let mut normals = vec![vec![-1.0, 0.0], vec![1.0, 0.0], vec![0.0, -1.0], vec![0.0, 1.0]];
    let whole = area(&polygon);
    while normals.len() < faces {
        let cut = |space: &HalfSpace| clipped(&polygon, space);
        let least = candidates.iter().min_by(|a, b| area(&cut(a)).total_cmp(&area(&cut(b))));
        let Some(space) = least.filter(|space| area(&polygon) - area(&cut(space)) > LEAST_CUT * whole) else { break };
        polygon = cut(space);
        normals.push(space.normal.clone());
    }
    Some(normals)
}

/// A face that cuts off a smaller share of the box is not worth its operations.
const LEAST_CUT: f64 = 1e-3;

/// The part of a polygon in a half-space (Sutherland, Hodgman 1974).
fn clipped(polygon: &[Point], space: &HalfSpace) -> Vec<Point> {
    let excess = |point: &Point| space.normal[0] * point[0] + space.normal[1] * point[1] - space.bound;
    let mut kept = Vec::new();
    for (k, to) in polygon.iter().enumerate() {
        let from = polygon[(k + polygon.len() - 1) % polygon.len()];
        let (a, b) = (excess(&from), excess(to));
        if (a > 0.0) != (b > 0.0) {
            let share = a / (a - b);
            kept.push([from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])]);
        }
        if b <= 0.0 {
            kept.push(*to);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(name: &str, range: [f64; 2]) -> Input {
        Input { name: name.into(), unit: "1".into(), range, outside: Default::default() }
    }

    fn support(surface: &Surface, inputs: &[Input], columns: &[Vec<f64>], wanted: SupportSpec) -> Vec<HalfSpace> {
        let response = vec![0.0; columns[0].len()];
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        of_data(surface, inputs, Observations { inputs: &columns, response: &response, weights: &[] }, wanted)
    }

    fn surface(names: &[&str]) -> Surface {
        Surface { inputs: names.iter().map(|name| name.to_string()).collect(), ..Surface::default() }
    }

    const PLAIN: SupportSpec = SupportSpec { margin: 0.0, faces: 8 };

    #[test]
    fn a_corner_that_was_never_run_is_cut_off() {
        // A grid over [0, 10]^2 without what lies above a + b = 12: coded x + y <= 0.4.
        let points: Vec<(f64, f64)> = (0..=10).flat_map(|a| (0..=10).map(move |b| (f64::from(a), f64::from(b)))).collect();
        let kept: Vec<(f64, f64)> = points.into_iter().filter(|(a, b)| a + b <= 12.0).collect();
        let columns = [kept.iter().map(|p| p.0).collect(), kept.iter().map(|p| p.1).collect()];
        let inputs = [input("a", [0.0, 10.0]), input("b", [0.0, 10.0])];
        let spaces = support(&surface(&["a", "b"]), &inputs, &columns, PLAIN);
        let mut normals: Vec<Vec<f64>> = spaces.iter().map(|space| space.normal.clone()).collect();
        normals.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(normals, [[-1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
        let diagonal = spaces.iter().find(|space| space.normal == [1.0, 1.0]).unwrap();
        // 0.4, rounded outward to four decimals with a gap.
        assert_eq!(diagonal.bound, 0.4001);
        // The square of side 2 without a triangle of legs 1.6: 1 - 1.28/4 = 0.68, and 1.6 * 10^-4/4 for the rounding.
        let region = Region::new(&surface(&["a", "b"]), &inputs);
        assert!((region.share(&spaces) - 0.68).abs() < 1e-4, "{}", region.share(&spaces));
        assert!(!holds(&spaces, &region.coded(&[Physical(7.0), Physical(6.0)])));
        assert!(holds(&spaces, &region.coded(&[Physical(7.0), Physical(5.0)])));
        assert!(!holds(&spaces, &region.coded(&[Physical(-1.0), Physical(5.0)])));
        // A margin of 0.1 coded units moves the diagonal by 0.1 sqrt 2.
        let wide = support(&surface(&["a", "b"]), &inputs, &columns, SupportSpec { margin: 0.1, faces: 8 });
        let bound = wide.iter().find(|space| space.normal == [1.0, 1.0]).unwrap().bound;
        assert!((bound - 0.4 - 0.1 * 2f64.sqrt()).abs() < 2e-4, "{bound}");
    }

    #[test]
    fn few_faces_hold_the_points_of_a_disc() {
        let angle = |k: u32| f64::from(k) * std::f64::consts::TAU / 100.0;
        let columns = [(0..100).map(|k| angle(k).cos()).collect::<Vec<f64>>(), (0..100).map(|k| angle(k).sin()).collect()];
        let inputs = [input("a", [-1.0, 1.0]), input("b", [-1.0, 1.0])];
        let surface = surface(&["a", "b"]);
        let region = Region::new(&surface, &inputs);
        let mut last = 0.0;
        for faces in [100, 16, 8, 6, 4] {
            let spaces = support(&surface, &inputs, &columns, SupportSpec { margin: 0.0, faces });
            assert!(spaces.len() <= faces, "{faces}: {}", spaces.len());
            for (a, b) in columns[0].iter().zip(&columns[1]) {
                assert!(holds(&spaces, &[*a, *b].map(Dd::from)), "{faces}, {a}, {b}");
            }
            // Fewer faces hold more; 100 sides have 12.5 sin(2 pi/100) = 0.7849 of the box, the least octagon around the disc 0.8284.
            let share = region.share(&spaces);
            assert!(share >= last, "{faces}: {share}");
            assert!(share > 0.7848 && (faces < 8 || share < 0.84), "{faces}: {share}");
            last = share;
        }
    }

    #[test]
    fn three_inputs_are_bounded_in_all_directions_and_points_on_a_line_too() {
        // A simplex: a, b, c >= 0, a + b + c <= 10.
        let columns = [vec![0.0, 10.0, 0.0, 0.0], vec![0.0, 0.0, 10.0, 0.0], vec![0.0, 0.0, 0.0, 10.0]];
        let inputs = [input("a", [0.0, 10.0]), input("b", [0.0, 10.0]), input("c", [0.0, 10.0])];
        let surface3 = surface(&["a", "b", "c"]);
        let spaces = support(&surface3, &inputs, &columns, PLAIN);
        let face = spaces.iter().find(|space| space.normal == [1.0, 1.0, 1.0]).unwrap();
        // Coded a + b + c <= 10 is x + y + z <= -1.
        assert!(face.bound > -1.0 && face.bound < -0.9998, "{face:?}");
        // A sixth of the cube; 5 standard deviations of the count.
        let share = Region::new(&surface3, &inputs).share(&spaces);
        assert!((share - 1.0 / 6.0).abs() < 0.008, "{share}");
        // Two inputs that were only varied together: the hull has no inside.
        let line = [vec![0.0, 5.0, 10.0], vec![0.0, 5.0, 10.0]];
        let spaces = support(&surface(&["a", "b"]), &inputs[..2], &line, PLAIN);
        let region = Region::new(&surface(&["a", "b"]), &inputs[..2]);
        assert!(holds(&spaces, &region.coded(&[Physical(5.0), Physical(5.0)])));
        assert!(!holds(&spaces, &region.coded(&[Physical(5.0), Physical(5.1)])) && region.share(&spaces) < 0.001);
    }

    #[test]
    fn natural_and_reciprocal_variables_have_their_own_scale() {
        let natural = Surface { coding: Coding::None, reciprocal: vec!["w".into()], ..surface(&["w", "t"]) };
        let inputs = [input("w", [100.0, 400.0]), input("t", [0.0, 2000.0])];
        // Constant power: t <= 200000/w; without the corner at high speed and high torque.
        let columns = [vec![100.0, 100.0, 200.0, 400.0, 400.0], vec![0.0, 2000.0, 1000.0, 500.0, 0.0]];
        let spaces = support(&natural, &inputs, &columns, PLAIN);
        let region = Region::new(&natural, &inputs);
        assert_eq!(region.sides, [[0.0025, 0.01], [0.0, 2000.0]]);
        // t <= 200000 x with x = 1/w: a straight edge in the coded variable, 400 rad/s and 600 lies outside.
        assert!(holds(&spaces, &region.coded(&[Physical(150.0), Physical(1330.0)])));
        assert!(!holds(&spaces, &region.coded(&[Physical(400.0), Physical(510.0)])));
        let expected = 1.0 - 0.5 * 1500.0 / 2000.0;
        assert!((region.share(&spaces) - expected).abs() < 1e-3, "{}", region.share(&spaces));
    }
}
