//! Rows of a design, as many at once as there are lanes.
//!
//! In: a design and columns of values. Out: for consecutive rows each term in all lanes, with the bits of a single row. Plain variables are evaluated
//! in lanes; hinges, sigmoids, waves, symmetric and reciprocal inputs and splines row by row.

use rsm_core::basis::{Shape, Variable};
use rsm_core::model::Outside;

use super::{Design, Physical};
use crate::dd::Dd;
use crate::dd::lanes::{LANES, Lanes, Work, widest};

/// How a point is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seen {
    /// As measured, for a fit.
    AsMeasured,
    /// As an evaluator sees it: clamped if an input is clamped.
    AsEvaluated,
}

/// The evaluation of a design in lanes, with its tables.
pub(crate) struct Eight<'a> {
    design: &'a Design,
    /// For each factor what is subtracted from twice its input and what this is divided by (23), or `None` for the input itself; empty if some
    /// factor is not evaluated in lanes.
    plain: Vec<Option<[Lanes; 2]>>,
    /// The powers of each factor, from 0 on.
    powers: Vec<Vec<Lanes>>,
    /// For each term its factors with their powers above 0.
    products: Vec<Vec<(usize, usize)>>,
    terms: Vec<Lanes>,
}

impl<'a> Eight<'a> {
    pub(crate) fn new(design: &'a Design) -> Self {
        let has_sign = !design.surface.symmetry.is_empty();
        let of_factor = |factor: &rsm_core::basis::Factor| match (factor.shape, factor.variable) {
            (Shape::Itself, Variable::Natural) => Some(None),
            (Shape::Itself, Variable::Centred { low, high }) => {
                let (low, high) = (Dd::from(low), Dd::from(high));
                Some(Some([Lanes::splat(high + low), Lanes::splat(high - low)]))
            }
            _ => None,
        };
        let is_row_by_row = design.surface.spline.is_some() || has_sign;
        let plain: Option<Vec<_>> = if is_row_by_row { None } else { design.factors.iter().map(of_factor).collect() };
        Eight {
            plain: plain.unwrap_or_default(),
            powers: design.highest.iter().map(|highest| vec![Lanes::ONE; *highest as usize + 1]).collect(),
            products: design.terms.iter().map(|exponents| factors_of(exponents)).collect(),
            terms: vec![Lanes::ONE; design.width()],
            design,
        }
    }

    /// The terms of the rows from `first` on. Lanes beyond the last row have the terms of the last row.
    pub(crate) fn rows(&mut self, columns: &[&[f64]], first: usize, seen: Seen) -> &[Lanes] {
        let mut terms = std::mem::take(&mut self.terms);
        self.write(columns, first, seen, &mut terms);
        self.terms = terms;
        &self.terms
    }

    /// Writes the terms of [`Eight::rows`].
    pub(crate) fn write(&mut self, columns: &[&[f64]], first: usize, seen: Seen, terms: &mut [Lanes]) {
        if self.plain.is_empty() {
            let last = columns.first().map_or(0, |column| column.len().saturating_sub(1));
            for lane in 0..LANES {
                let point: Vec<Physical> = columns.iter().map(|column| Physical(column[(first + lane).min(last)])).collect();
                let row = match seen {
                    Seen::AsMeasured => self.design.row_as_measured(&point),
                    Seen::AsEvaluated => self.design.row(&point),
                };
                terms.iter_mut().zip(row).for_each(|(term, value)| term.set(lane, value));
            }
            return;
        }
        let of_factors = self.design.factors.iter().zip(&self.plain).zip(&mut self.powers).zip(&self.design.inputs);
        for (((factor, plain), powers), input) in of_factors {
            // The factors are the inputs themselves here, in their order. An input that is in no term has no power.
            let range = (seen == Seen::AsEvaluated && input.outside == Outside::Clamp).then_some(input.range);
            if powers.len() > 1 {
                widest(Powers { column: columns[factor.input], first, range, plain, powers });
            }
        }
        widest(Terms { terms, powers: &self.powers, products: &self.products });
    }
}

/// The factors of a term with their powers above 0.
fn factors_of(exponents: &[u32]) -> Vec<(usize, usize)> {
    exponents.iter().enumerate().filter(|(_, exponent)| **exponent > 0).map(|(k, exponent)| (k, *exponent as usize)).collect()
}

/// The powers of a factor from 1 on.
struct Powers<'a> {
    column: &'a [f64],
    first: usize,
    /// Where the evaluator clamps the values.
    range: Option<[f64; 2]>,
    plain: &'a Option<[Lanes; 2]>,
    powers: &'a mut [Lanes],
}

impl Work for Powers<'_> {
    type Found = ();

    #[inline(always)]
    fn compute<const FUSED: bool>(self) {
        let Powers { column, first, range, plain, powers } = self;
        let mut values = eight(column, first);
        if let Some([low, high]) = range {
            for value in &mut values {
                let raised = if *value < low { low } else { *value };
                *value = if high < raised { high } else { raised };
            }
        }
        let xi = Lanes::of(values);
        let x = match plain {
            None => xi,
            Some([middle, width]) => xi.add(xi).sub(*middle).over::<FUSED>(*width),
        };
        // Powers by repeated multiplication, from one.
        powers[1] = x.times_one();
        for exponent in 2..powers.len() {
            powers[exponent] = powers[exponent - 1].times::<FUSED>(x);
        }
    }
}

/// The products of powers of all terms.
struct Terms<'a> {
    terms: &'a mut [Lanes],
    powers: &'a [Vec<Lanes>],
    products: &'a [Vec<(usize, usize)>],
}

impl Work for Terms<'_> {
    type Found = ();

    #[inline(always)]
    fn compute<const FUSED: bool>(self) {
        for (term, factors) in self.terms.iter_mut().zip(self.products) {
            let Some(((factor, exponent), others)) = factors.split_first() else {
                *term = Lanes::ONE;
                continue;
            };
            let mut product = self.powers[*factor][*exponent];
            for (factor, exponent) in others {
                product = product.times::<FUSED>(self.powers[*factor][*exponent]);
            }
            *term = product;
        }
    }
}

/// The values of some rows, one in each lane; the last value again beyond the end.
#[inline(always)]
pub(crate) fn eight(column: &[f64], first: usize) -> [f64; LANES] {
    if let Some(values) = column.get(first..).and_then(<[f64]>::first_chunk) {
        return *values;
    }
    let last = column.len() - 1;
    std::array::from_fn(|lane| column[(first + lane).min(last)])
}

#[cfg(test)]
mod tests {
    use rsm_core::model::{Coding, Input, Sigmoid, Surface, Symmetry, Wave};

    use super::*;
    use crate::design::terms_up_to;
    use crate::random::Random;

    #[test]
    fn lanes_have_the_bits_of_rows_for_every_kind_of_factor() {
        let input = |name: &str, outside| Input { name: name.into(), unit: "1".into(), range: [-0.7, 2.9], outside };
        let inputs = [input("a", Outside::Clamp), input("b", Outside::Extrapolate)];
        let plain = Surface { inputs: vec!["a".into(), "b".into()], ..Surface::default() };
        let sigmoids = vec![Sigmoid { input: "a".into(), at: 0.3, width: 0.4 }];
        let waves = vec![Wave { input: "b".into(), period: 3.6, order: 2 }];
        let surfaces = [
            plain.clone(),
            Surface { coding: Coding::None, ..plain.clone() },
            Surface { coding: Coding::None, reciprocal: vec!["a".into()], ..plain.clone() },
            Surface { sigmoids, waves, ..plain.clone() },
            Surface { coding: Coding::None, symmetry: vec![("b".into(), Symmetry::Odd)], ..plain.clone() },
            Surface { inputs: vec![], ..plain.clone() },
        ];
        let mut random = Random::new(2);
        for surface in surfaces {
            let inputs = &inputs[..surface.inputs.len()];
            let design = Design::new(&surface, inputs, terms_up_to(&surface, 3));
            let columns: Vec<Vec<f64>> =
                inputs.iter().map(|_| (0..21).map(|_| -1.5 + 6.0 * random.share()).collect()).collect();
            let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let mut evaluation = Eight::new(&design);
            for first in [0, 8, 16] {
                for seen in [Seen::AsMeasured, Seen::AsEvaluated] {
                    let terms = evaluation.rows(&columns, first, seen);
                    for lane in 0..LANES {
                        let point: Vec<Physical> =
                            columns.iter().map(|column| Physical(column[(first + lane).min(20)])).collect();
                        let row = if seen == Seen::AsMeasured { design.row_as_measured(&point) } else { design.row(&point) };
                        let found: Vec<Dd> = terms.iter().map(|term| term.get(lane)).collect();
                        assert_eq!(found, row, "{surface:?}");
                    }
                }
            }
        }
    }
}
