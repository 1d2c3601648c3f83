//! The design matrix: from points in natural units to the rows of a least-squares problem.
//!
//! In: a surface (its factors, symmetry and terms) and its inputs with their ranges. Out: a row of double-doubles for each point, one number for each
//! term, computed by the same [`Factor`]s as in the surface. Points are used as measured for the fit, and as the evaluator sees them for errors.
//! Powers are computed in double-double: in f64, NIST's Filip data would lose half of their digits. Responses are not used.

use rsm_core::basis::{self, Factor};
use rsm_core::model::{Category, Input, Spline, Surface, Symmetry, Transform};
use rsm_core::order;

use crate::dd::Dd;

pub(crate) mod eight;

/// The beginning of the name of a block's contrast among the inputs of a fit. No input of a model has a space in its name.
pub(crate) const BLOCK: &str = "block ";

/// A value of an input in its natural unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Physical(pub f64);

/// A value of a coded variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coded(pub f64);

/// The columns of a surface.
#[derive(Debug, Clone)]
pub struct Design {
    surface: Surface,
    inputs: Vec<Input>,
    factors: Vec<Factor>,
    terms: Vec<Vec<u32>>,
    highest: Vec<u32>,
}

impl Design {
    /// The design of a surface with the given terms in place of its own. `inputs` are those of the surface, in its order.
    #[must_use]
    pub fn new(surface: &Surface, inputs: &[Input], terms: Vec<Vec<u32>>) -> Self {
        let factors = Factor::all(surface, inputs);
        let highest = (0..factors.len()).map(|k| terms.iter().map(|powers| powers[k]).max().unwrap_or(0)).collect();
        Design { surface: surface.clone(), inputs: inputs.to_vec(), factors, terms, highest }
    }

    /// The design of some of the terms.
    #[must_use]
    pub fn only(&self, terms: &[usize]) -> Self {
        Design::new(&self.surface, &self.inputs, terms.iter().map(|k| self.terms[*k].clone()).collect())
    }

    /// The number of terms.
    #[must_use]
    pub fn width(&self) -> usize {
        self.terms.len()
    }

    /// The terms that are in every model of a choice: the constant, and the contrasts of additive categories, the constant first.
    #[must_use]
    pub(crate) fn always(&self) -> Vec<usize> {
        let (_, additive) = contrasts(&self.surface);
        let is_constant = |k: &usize| order(&self.terms[*k]) == 0;
        (0..self.terms.len()).filter(is_constant).chain(self.alone(&additive)).collect()
    }

    /// The terms of blocks: they explain differences between rows, and are no part of the surface.
    pub(crate) fn of_blocks(&self) -> Vec<usize> {
        let inputs: Vec<usize> =
            (0..self.surface.inputs.len()).filter(|k| self.surface.inputs[*k].starts_with(BLOCK)).collect();
        let is_own = |powers: &Vec<u32>| inputs.iter().any(|input| powers[*input] > 0);
        (0..self.terms.len()).filter(|k| !inputs.is_empty() && is_own(&self.terms[*k])).collect()
    }

    /// The terms of the model without a surface, which has the mean of each block; empty without blocks.
    pub(crate) fn level(&self) -> Vec<usize> {
        let of_blocks = self.of_blocks();
        let constant = (0..self.terms.len()).filter(|k| order(&self.terms[*k]) == 0 && !of_blocks.is_empty());
        constant.chain(of_blocks.iter().copied()).collect()
    }

    /// For each category the terms of its contrasts alone, with its name: first those of additive ones. Only categories with such terms.
    pub(crate) fn shifts(&self) -> Vec<(String, Vec<usize>)> {
        let mut categories: Vec<&Category> = self.surface.categories.iter().collect();
        categories.sort_by_key(|category| !category.additive);
        let of_one = |category: &Category| (category.name.clone(), self.alone(&places(&self.surface, category)).collect());
        categories.into_iter().map(of_one).filter(|(_, terms): &(String, Vec<usize>)| !terms.is_empty()).collect()
    }

    /// The terms of one of these factors alone, to the first power.
    fn alone(&self, factors: &[usize]) -> impl Iterator<Item = usize> {
        let is_alone = move |powers: &[u32]| order(powers) == 1 && factors.iter().any(|factor| powers[*factor] == 1);
        (0..self.terms.len()).filter(move |k| is_alone(&self.terms[*k]))
    }

    /// The transform of the response that the terms describe.
    pub(crate) fn transform(&self) -> Option<Transform> {
        self.surface.transform
    }

    /// The terms, as powers of the factors.
    #[must_use]
    pub fn terms(&self) -> &[Vec<u32>] {
        &self.terms
    }

    /// The row of a point as an evaluator sees it: clamped if an input is clamped.
    #[must_use]
    pub fn row(&self, point: &[Physical]) -> Vec<Dd> {
        let clamped = |(input, value): (&Input, &Physical)| basis::clamped(input, Dd::from(value.0));
        self.terms_at(&self.inputs.iter().zip(point).map(clamped).collect::<Vec<Dd>>())
    }

    /// The row of a point as measured, for the fit. If it were clamped, a point beyond the range would distort the surface at the edge.
    #[must_use]
    pub fn row_as_measured(&self, point: &[Physical]) -> Vec<Dd> {
        self.terms_at(&point.iter().map(|value| Dd::from(value.0)).collect::<Vec<Dd>>())
    }

    /// Whether every value of every input is in its range. `columns`: without NaN.
    pub(crate) fn holds_all(&self, columns: &[&[f64]]) -> bool {
        self.inputs.iter().zip(columns).all(|(input, column)| {
            let (low, high) = order::ends(*column);
            input.range[0] <= low && high <= input.range[1]
        })
    }

    /// Whether a value is outside of the range of its input.
    pub(crate) fn has_outside(&self, point: impl Iterator<Item = f64>) -> bool {
        !self.inputs.iter().zip(point).all(|(input, value)| input.range[0] <= value && value <= input.range[1])
    }

    /// Whether a point lies within all ranges.
    #[must_use]
    pub fn is_inside(&self, point: &[Physical]) -> bool {
        self.inputs.iter().zip(point).all(|(input, value)| input.range[0] <= value.0 && value.0 <= input.range[1])
    }

    /// The value of every term, with the sign that odd symmetry gives.
    fn terms_at(&self, xi: &[Dd]) -> Vec<Dd> {
        if let Some(spline) = &self.surface.spline {
            return self.basis_functions_at(spline, xi);
        }
        let negated = basis::is_negated(&self.surface, &self.inputs, xi);
        let powers: Vec<Vec<Dd>> = self
            .factors
            .iter()
            .zip(&self.highest)
            .map(|(factor, highest)| {
                let x = factor.value(xi[factor.input]);
                (0..=*highest).map(|exponent| basis::power(&x, exponent)).collect()
            })
            .collect();
        let product = |term: &Vec<u32>| {
            let factors = term.iter().zip(&powers).filter(|(exponent, _)| **exponent > 0);
            let product = factors.fold(Dd::ONE, |product, (exponent, table)| product * table[*exponent as usize]);
            if negated { -product } else { product }
        };
        self.terms.iter().map(product).collect()
    }

    /// The products of the basis functions of a spline: the powers of a term are their indices.
    fn basis_functions_at(&self, spline: &Spline, xi: &[Dd]) -> Vec<Dd> {
        let of_input = |(k, input): (usize, &Input)| basis::spline_weights(spline.degree, spline.cells[k], input.range, xi[k]);
        let each: Vec<(usize, Vec<Dd>)> = self.inputs.iter().enumerate().map(of_input).collect();
        let product = |term: &Vec<u32>| {
            let mut product = Dd::ONE;
            for ((first, weights), index) in each.iter().zip(term) {
                match (*index as usize).checked_sub(*first).and_then(|place| weights.get(place)) {
                    Some(weight) => product = product * *weight,
                    None => return Dd::ZERO,
                }
            }
            product
        };
        self.terms.iter().map(product).collect()
    }

    /// The name of a term in messages: `1`, `speed`, `torque^2*speed`, `hinge(speed, 465)`.
    #[must_use]
    pub fn name_of(&self, term: usize) -> String {
        self.surface.term_name(&self.terms[term])
    }
}

/// The order of a term: the sum of its powers.
#[must_use]
pub fn order(powers: &[u32]) -> u32 {
    powers.iter().sum()
}

/// All allowed terms of a surface up to an order: the constant first, then by order; within an order, those with the highest powers of the first
/// factors come first. With odd symmetry every term must contain the odd inputs. A term has at most one sigmoid for each input, to the first power,
/// and at most one contrast of each category, whose square and products follow from the contrasts themselves. Contrasts of additive categories come
/// last, each by itself.
#[must_use]
pub fn terms_up_to(surface: &Surface, highest_order: u32) -> Vec<Vec<u32>> {
    terms_with_hinges(surface, 0, highest_order)
}

/// The terms of [`terms_up_to`] if the data chose the last `chosen` knots: a term has at most one of these hinges for each input, to the first power.
#[must_use]
pub(crate) fn terms_with_hinges(surface: &Surface, chosen: usize, highest_order: u32) -> Vec<Vec<u32>> {
    let (contrasts, additive) = contrasts(surface);
    let is_plain = |powers: &Vec<u32>| {
        missing_odd_input(surface, powers).is_none()
            && has_plain_steps(surface, powers)
            && has_plain_hinges(surface, chosen, powers)
    };
    if contrasts.is_empty() && additive.is_empty() {
        let mut terms = monomials_up_to(surface.width(), highest_order);
        terms.retain(is_plain);
        return terms;
    }
    let is_contrast = |k: &usize| additive.contains(k) || contrasts.iter().flatten().any(|place| place == k);
    let others: Vec<usize> = (0..surface.width()).filter(|k| !is_contrast(k)).collect();
    // Without any other factor only the constant.
    let highest = if others.is_empty() { 0 } else { highest_order };
    let full = |powers: Vec<u32>| {
        let mut term = vec![0; surface.width()];
        others.iter().zip(powers).for_each(|(place, power)| term[*place] = power);
        term
    };
    let mut terms: Vec<Vec<u32>> = monomials_up_to(others.len(), highest).into_iter().map(full).collect();
    for category in &contrasts {
        let lower: Vec<Vec<u32>> = terms.iter().filter(|term| order(term) < highest_order).cloned().collect();
        terms.extend(lower.iter().flat_map(|term| category.iter().map(|place| with_one(term, *place))));
    }
    terms.retain(is_plain);
    terms.sort_by(|a, b| order(a).cmp(&order(b)).then_with(|| b.cmp(a)));
    terms.extend(additive.iter().map(|place| with_one(&vec![0; surface.width()], *place)));
    terms
}

fn with_one(term: &[u32], place: usize) -> Vec<u32> {
    let mut more = term.to_vec();
    more[place] = 1;
    more
}

/// The factors that are contrasts: those of each category that may be in products, and those of all additive categories.
fn contrasts(surface: &Surface) -> (Vec<Vec<usize>>, Vec<usize>) {
    let places = |category: &Category| places(surface, category);
    let (additive, others): (Vec<&Category>, Vec<&Category>) =
        surface.categories.iter().partition(|category| category.additive);
    (others.into_iter().map(places).collect(), additive.into_iter().flat_map(places).collect())
}

/// The factors that are contrasts of a category.
fn places(surface: &Surface, category: &Category) -> Vec<usize> {
    category.inputs.iter().filter_map(|name| surface.inputs.iter().position(|input| input == name)).collect()
}

/// The powers of `width` factors in the order of [`terms_up_to`], without the restrictions of a surface.
pub(crate) fn monomials_up_to(width: usize, highest_order: u32) -> Vec<Vec<u32>> {
    let mut terms = Vec::new();
    for order in 0..=highest_order {
        push_terms_of_order(order, width, &mut Vec::new(), &mut terms);
    }
    terms
}

/// Whether a term has at most one sigmoid or wave of each input, to the first power. Their powers and products add little to the sigmoids themselves.
/// A power of a periodic input would jump at the end of the period.
fn has_plain_steps(surface: &Surface, powers: &[u32]) -> bool {
    let made = &powers[surface.inputs.len() + surface.knots.len()..];
    let steps = surface.sigmoids.iter().map(|sigmoid| &sigmoid.input);
    let names: Vec<&String> = steps.chain(surface.waves.iter().flat_map(|wave| [&wave.input; 2])).collect();
    let of = |name: &String| names.iter().zip(made).filter(|(input, _)| **input == name).map(|(_, power)| power).sum::<u32>();
    let is_periodic = |name: &String| surface.waves.iter().any(|wave| wave.input == *name);
    let own = surface.inputs.iter().zip(powers);
    surface.inputs.iter().all(|name| of(name) <= 1) && own.into_iter().all(|(name, power)| *power == 0 || !is_periodic(name))
}

/// Whether a term has at most one of the last `chosen` hinges of each input, to the first power: higher powers have no kink, and they are not what
/// was looked for.
fn has_plain_hinges(surface: &Surface, chosen: usize, powers: &[u32]) -> bool {
    let given = surface.knots.len() - chosen;
    let own: Vec<(&String, u32)> = surface.knots[given..]
        .iter()
        .map(|knot| &knot.input)
        .zip(powers[surface.inputs.len() + given..].iter().copied())
        .filter(|(_, power)| *power > 0)
        .collect();
    own.iter().enumerate().all(|(k, (name, power))| *power == 1 && own[..k].iter().all(|(other, _)| other != name))
}

fn push_terms_of_order(order: u32, width: usize, begun: &mut Vec<u32>, terms: &mut Vec<Vec<u32>>) {
    if begun.len() + 1 >= width {
        let mut powers = begun.clone();
        if width > 0 {
            powers.push(order);
        }
        terms.push(powers);
        return;
    }
    for power in (0..=order).rev() {
        begun.push(power);
        push_terms_of_order(order - power, width, begun, terms);
        begun.pop();
    }
}

/// An odd input that a term does not contain, if there is one. Such a term would jump where the input changes sign. A hinge of the input is 0 up to a
/// knot above 0, and a sigmoid minus its value at 0 is 0 there, so both can replace the input itself.
#[must_use]
pub fn missing_odd_input<'a>(surface: &'a Surface, powers: &[u32]) -> Option<&'a str> {
    let (own, hinges) = powers.split_at(surface.inputs.len().min(powers.len()));
    let contains = |name: &str| {
        let by_itself = surface.inputs.iter().zip(own).any(|(input, power)| input == name && *power > 0);
        let made = surface.knots.iter().map(|knot| &knot.input).chain(surface.sigmoids.iter().map(|sigmoid| &sigmoid.input));
        by_itself || made.zip(hinges).any(|(input, power)| input == name && *power > 0)
    };
    let odd = surface.symmetry.iter().filter(|(_, kind)| *kind == Symmetry::Odd);
    odd.map(|(name, _)| name.as_str()).find(|name| !contains(name))
}

/// An upper limit of the number of terms of [`terms_up_to`]: exact without odd symmetry, sigmoids and waves; saturates.
#[must_use]
pub fn count_of_candidates(surface: &Surface, highest_order: u32) -> usize {
    let (contrasts, additive) = contrasts(surface);
    let others = surface.width() - additive.len() - contrasts.iter().map(Vec::len).sum::<usize>();
    // The number of ways to take s contrasts, at most one of each category: the elementary symmetric polynomials.
    let mut ways = vec![1usize];
    for category in &contrasts {
        let with = |k: usize| k.checked_sub(1).map_or(0, |k| ways[k].saturating_mul(category.len()));
        ways = (0..=ways.len()).map(|k| ways.get(k).copied().unwrap_or(0).saturating_add(with(k))).collect();
    }
    let with = |(taken, ways): (usize, &usize)| {
        let left = highest_order.checked_sub(taken as u32);
        left.map_or(0, |left| ways.saturating_mul(count_of_terms(others, left)))
    };
    ways.iter().enumerate().map(with).fold(additive.len(), usize::saturating_add)
}

/// The number of products of powers up to an order: the binomial coefficient (width + order) over width; saturates.
#[must_use]
pub fn count_of_terms(width: usize, order: u32) -> usize {
    let mut count: usize = 1;
    for k in 1..=order as usize {
        // Exact at every step, because it is a binomial coefficient.
        count = count.saturating_mul(width + k) / k;
    }
    count
}

#[cfg(test)]
mod tests {
    use rsm_core::model::Knot;

    use super::*;

    fn input(name: &str) -> Input {
        Input { name: name.into(), unit: "1".into(), range: [-1.0, 3.0], outside: Default::default() }
    }

    #[test]
    fn terms_come_by_order() {
        let surface = Surface { inputs: vec!["a".into(), "b".into()], ..Surface::default() };
        let terms = terms_up_to(&surface, 2);
        assert_eq!(terms, [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]);
        let names: Vec<_> = terms.iter().map(|powers| surface.term_name(powers)).collect();
        assert_eq!(names, ["1", "a", "b", "a^2", "a*b", "b^2"]);
        for (width, order) in [(1, 10), (2, 3), (6, 5)] {
            let surface = Surface { inputs: vec!["x".to_string(); width], ..Surface::default() };
            assert_eq!(terms_up_to(&surface, order).len(), count_of_terms(width, order));
        }
    }

    #[test]
    fn hinges_that_the_data_chose_are_at_most_one_of_each_input_in_a_term() {
        let knot = |input: &str, at: f64| Knot { input: input.into(), at };
        let knots = vec![knot("a", 0.0), knot("a", 1.0), knot("a", 2.0), knot("b", 1.0)];
        let surface = Surface { inputs: vec!["a".into(), "b".into()], knots, ..Surface::default() };
        let terms = terms_with_hinges(&surface, 3, 2);
        let has = |powers: [u32; 6]| terms.iter().any(|term| term[..] == powers);
        // The first knot was given.
        assert!(has([0, 0, 2, 0, 0, 0]) && has([0, 0, 1, 1, 0, 0]));
        assert!(has([0, 0, 0, 1, 0, 1]) && has([1, 0, 0, 1, 0, 0]));
        assert!(!has([0, 0, 0, 2, 0, 0]) && !has([0, 0, 0, 1, 1, 0]) && !has([0, 0, 0, 0, 0, 2]));
        // Without the squares of three hinges and the product of the two of `a`.
        assert_eq!(terms.len() + 4, terms_up_to(&surface, 2).len());
        assert_eq!(terms_up_to(&surface, 2).len(), count_of_candidates(&surface, 2));
    }

    #[test]
    fn an_odd_input_is_in_every_term_and_turns_the_sign() {
        let symmetric = Input { range: [-2.0, 2.0], ..input("b") };
        let surface =
            Surface { inputs: vec!["a".into(), "b".into()], symmetry: vec![("b".into(), Symmetry::Odd)], ..Surface::default() };
        let inputs = [input("a"), symmetric];
        let terms = terms_up_to(&surface, 2);
        assert_eq!(terms, [[0, 1], [1, 1], [0, 2]]);
        let design = Design::new(&surface, &inputs, terms);
        // a = 2 is x1 = (2 - 1)/2 = 0.5; b = -1 is x2 = |-1|/2 = 0.5 with the sign turned.
        let row: Vec<f64> = design.row(&[Physical(2.0), Physical(-1.0)]).iter().map(|x| x.to_f64()).collect();
        assert_eq!(row, [-0.5, -0.25, -0.25]);
        // Outside the range as at its end: the evaluator clamps.
        let far = [Physical(9.0), Physical(-7.0)];
        assert_eq!(design.row(&far), design.row(&[Physical(3.0), Physical(-2.0)]));
        // As measured x1 = 4, x2 = 3.5, with the sign turned.
        let row: Vec<f64> = design.row_as_measured(&far).iter().map(|x| x.to_f64()).collect();
        assert_eq!(row, [-3.5, -14.0, -12.25]);
        assert!(!design.is_inside(&far) && design.is_inside(&[Physical(3.0), Physical(-2.0)]));
    }
}
