//! What is certain about a model: theorems over the whole input box, not samples.
//!
//! In: `Checked`. Out: for each surface an enclosure of the true polynomial's range (before `output_range`), and for each precision a bound
//! of |tape - true polynomial, saturated alike| over all arguments of that type in the box, with operations and depth of the tape. Compensators have theirs in `compensator.rs`.

pub mod compensator;

use std::collections::BTreeMap;

use crate::basis::{Arithmetic, Factor, Variable};
use crate::bernstein::{self, Monomial};
use crate::check::Checked;
use crate::interval::Interval;
use crate::lower;
use crate::model::{Input, Surface, Symmetry};
use crate::number::{Precision, Rational, exact, integer};
use crate::rounding;
use crate::source::Faults;

/// What is certain about one surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceCertificate {
    /// The surface.
    pub name: String,
    /// Holds every value of the true polynomial over the box, before `output_range`; in the unit of the response.
    pub range: Interval,
    /// What holds in each precision that was asked for.
    pub tapes: Vec<TapeCertificate>,
}

/// What is certain about one tape.
#[derive(Debug, Clone, PartialEq)]
pub struct TapeCertificate {
    /// The scalar type.
    pub precision: Precision,
    /// Bounds |tape - true polynomial, saturated alike| in the unit of the response; infinite when none can be given.
    pub error: f64,
    /// Arithmetic operations, comparisons and selections.
    pub operations: usize,
    /// The longest chain of dependent operations.
    pub depth: usize,
}

/// The certificate of every surface, in the order of the file.
///
/// # Errors
/// The faults of a precision that cannot hold the model.
pub fn surfaces(checked: &Checked, precisions: &[Precision]) -> Result<Vec<SurfaceCertificate>, Faults> {
    for precision in precisions {
        if let Some(faults) = checked.refusal(*precision) {
            return Err(faults);
        }
    }
    Ok((0..checked.model().surfaces.len()).map(|index| surface(checked, index, precisions)).collect())
}

/// The certificate of one surface in precisions that can hold it.
#[must_use]
pub fn surface(checked: &Checked, index: usize, precisions: &[Precision]) -> SurfaceCertificate {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let ranges: Vec<[f64; 2]> = inputs.iter().map(|input| input.range).collect();
    let tapes = precisions.iter().map(|precision| {
        let tape = lower::surface(checked, index, *precision);
        let error = rounding::error_bound(&tape, &ranges);
        TapeCertificate { precision: *precision, error, operations: tape.operation_count(), depth: tape.depth() }
    });
    SurfaceCertificate { name: surface.name.clone(), range: range(surface, &inputs), tapes: tapes.collect() }
}

/// An enclosure of the true polynomial over the box.
#[must_use]
pub fn range(surface: &Surface, inputs: &[Input]) -> Interval {
    extent(surface, inputs).range
}

/// An enclosure of the true polynomial, and points of the box where its least and its greatest value were seen, in natural units.
#[derive(Debug, Clone, PartialEq)]
pub struct Extent {
    /// Holds every value.
    pub range: Interval,
    /// Where the least value was seen, in the order of the inputs.
    pub least_at: Vec<f64>,
    /// Where the greatest value was seen.
    pub greatest_at: Vec<f64>,
}

/// The extent of the true polynomial over the box. The box is cut at the knots: in each piece a hinge is 0 or a plain difference, so
/// the surface is a polynomial there.
#[must_use]
pub fn extent(surface: &Surface, inputs: &[Input]) -> Extent {
    let factors = Factor::all(surface, inputs);
    let pieces: Vec<Vec<[f64; 2]>> = inputs.iter().map(|input| pieces(surface, input)).collect();
    let mut whole: Option<Extent> = None;
    let mut chosen = vec![0usize; inputs.len()];
    loop {
        let cell: Vec<[f64; 2]> = pieces.iter().zip(&chosen).map(|(pieces, k)| pieces[*k]).collect();
        let here = extent_of_piece(surface, &factors, &cell);
        whole = Some(match whole {
            None => here,
            Some(whole) => whole.joined(here),
        });
        let Some(next) = (0..inputs.len()).find(|k| chosen[*k] + 1 < pieces[*k].len()) else { break };
        chosen[next] += 1;
        chosen[..next].fill(0);
    }
    let whole = whole.expect("a box has at least one piece");
    let is_odd = |input: &Input| surface.symmetry.contains(&(input.name.clone(), Symmetry::Odd));
    match inputs.iter().position(is_odd) {
        None => whole,
        // On the other side of an odd input every value has its opposite.
        Some(odd) => {
            let opposite = |mut point: Vec<f64>| {
                point[odd] = -point[odd];
                point
            };
            let (least_at, greatest_at) = (opposite(whole.greatest_at.clone()), opposite(whole.least_at.clone()));
            let opposite = Extent { range: -whole.range, least_at, greatest_at };
            whole.joined(opposite)
        }
    }
}

impl Extent {
    fn joined(self, other: Extent) -> Extent {
        let least_at = if other.range.low < self.range.low { other.least_at } else { self.least_at };
        let greatest_at = if other.range.high > self.range.high { other.greatest_at } else { self.greatest_at };
        Extent { range: self.range.hull(other.range), least_at, greatest_at }
    }
}

/// The natural value at which a variable is at a share of its way from its least to its greatest value over [low, high].
fn natural(variable: Variable, [low, high]: [f64; 2], share: f64) -> f64 {
    let xi = match variable {
        // 1/xi falls where xi rises.
        Variable::Reciprocal | Variable::CentredReciprocal { .. } => 1.0 / ((1.0 - share) / high + share / low),
        _ => low * (1.0 - share) + high * share,
    };
    xi.clamp(low, high)
}

/// The range of an input between its knots; of a symmetric input the half above 0, which stands for both.
fn pieces(surface: &Surface, input: &Input) -> Vec<[f64; 2]> {
    let symmetric = surface.symmetry.iter().any(|(name, _)| *name == input.name);
    let low = if symmetric { 0.0 } else { input.range[0] };
    let mut cuts: Vec<f64> = surface.knots.iter().filter(|knot| knot.input == input.name).map(|knot| knot.at).collect();
    cuts.extend([low, input.range[1]]);
    cuts.sort_by(f64::total_cmp);
    cuts.dedup();
    cuts.windows(2).map(|pair| [pair[0], pair[1]]).collect()
}

fn extent_of_piece(surface: &Surface, factors: &[Factor], cell: &[[f64; 2]]) -> Extent {
    let inputs = cell.len();
    // The main variable is monotone in xi within a piece, so its ends are the ends of its range.
    let sides: Vec<Interval> = factors[..inputs]
        .iter()
        .zip(cell)
        .map(|(factor, ends)| {
            let [one, other] = ends.map(|end| Interval::around(&factor.value(exact(end))));
            one.hull(other)
        })
        .collect();
    let mut monomials: BTreeMap<Vec<u32>, Interval> = BTreeMap::new();
    for term in surface.terms.iter().filter(|term| term.coefficient != 0.0) {
        let mut expanded = vec![(term.powers[..inputs].to_vec(), exact(term.coefficient))];
        for (factor, power) in factors[inputs..].iter().zip(&term.powers[inputs..]) {
            let [low, high] = cell[factor.input].map(exact);
            let open = factor.value((low + high) / integer(2)) > Rational::of(0.0);
            let at = factor.hinge.expect("factors after the inputs are hinges");
            let knot = factor.variable.value(exact(at));
            for _ in 0..*power {
                expanded = if open { times_difference(&expanded, factor.input, &knot) } else { vec![] };
            }
        }
        for (powers, coefficient) in expanded {
            let coefficient = Interval::around(&coefficient);
            let entry = monomials.entry(powers).or_insert(Interval::point(0.0));
            *entry = *entry + coefficient;
        }
    }
    let monomials: Vec<Monomial> =
        monomials.into_iter().map(|(powers, coefficient)| Monomial { powers, coefficient }).collect();
    let found = bernstein::extent(&monomials, &sides);
    let point = |shares: &[f64]| {
        let each = factors.iter().zip(cell).zip(shares);
        each.map(|((factor, ends), share)| natural(factor.variable, *ends, *share)).collect()
    };
    Extent { range: found.range, least_at: point(&found.least_at), greatest_at: point(&found.greatest_at) }
}

/// A polynomial times (x_k - knot).
fn times_difference(terms: &[(Vec<u32>, Rational)], input: usize, knot: &Rational) -> Vec<(Vec<u32>, Rational)> {
    let raised = terms.iter().map(|(powers, coefficient)| {
        let mut powers = powers.clone();
        powers[input] += 1;
        (powers, coefficient.clone())
    });
    let lowered = terms.iter().map(|(powers, coefficient)| (powers.clone(), -(coefficient * knot)));
    raised.chain(lowered).collect()
}
