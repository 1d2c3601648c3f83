//! Finds where a response bends: the places of sigmoids or of hinges, by variable projection.
//!
//! In: rows to fit, the kind of bend. Out: bends, or none. For given places the coefficients are a linear problem, so the residual sum of squares is
//! a function of the places alone, and only these are searched (G. Golub, V. Pereyra, 1973). Bends are added one at a time: candidate places are
//! tried at every input, the best are refined by Levenberg-Marquardt with Kaufman's derivative (1975), all bends together. The search ends when
//! generalised cross-validation (P. Craven, G. Wahba, 1979), which counts places as coefficients, no longer falls.

use nalgebra::{DMatrix, DVector};
use rsm_core::basis::Factor;
use rsm_core::model::{Input, Surface};
use rsm_core::order;

use super::drawn;
use crate::selection::Sample;

/// The largest number of bends of one input.
const MOST_OF_AN_INPUT: usize = 3;

/// The largest number of bends.
const MOST: usize = 5;

/// With more rows, a random sample is used: more rows cost time and hardly improve places.
const MOST_ROWS: usize = 1500;

/// Each bend must reduce the criterion by this share.
const LEAST_GAIN: f64 = 0.05;

/// All bends together must reduce the criterion of powers alone by this share; otherwise nothing else is tried.
const LEAST_TOTAL_GAIN: f64 = 0.25;

/// The largest number of Levenberg-Marquardt steps.
const STEPS: usize = 30;

/// The best candidate of each input is considered; this many of them are refined.
const REFINED: usize = 2;

/// The numbers that are searched for a bend; the first is its place as a share of the range.
pub(super) type Place = [f64; 2];

/// A kind of bend.
pub(super) trait Kind: Sized {
    /// A bend in a model.
    type Bend;
    /// How many numbers of a [`Place`] are searched.
    const NUMBERS: usize;
    /// The number of coefficients that a bend counts for, in addition to its terms.
    const COUNTED: usize;
    /// The number of candidate places: quantiles of the input in the rows.
    const CENTRES: usize;

    /// The orders of candidate terms to be tried, if this is the highest possible one.
    fn orders(highest: u32) -> Vec<u32>;

    /// The terms of a surface with further bends of these inputs.
    fn terms(surface: &Surface, bends: &[&str], order: u32) -> Vec<Vec<u32>>;

    /// The values of a bend.
    fn values(side: &Side, place: Place, xi: &[f64]) -> Vec<f64>;

    /// The limits of a number of an input's bends, for terms up to an order.
    fn limits(search: &Search<'_, Self>, rows: &Rows, input: usize, order: u32) -> [f64; 2];

    /// The candidates with these places.
    fn starts(centres: &[f64], limits: [f64; 2]) -> Vec<Place>;

    /// A place after a step.
    fn moved(place: Place, by: &[f64], limits: [f64; 2]) -> Place;

    /// Whether the rows suffice for these bends together.
    fn is_determined(search: &Search<'_, Self>, rows: &Rows, steps: &[Step], order: u32) -> bool;

    /// The bend for a model file, without meaningless digits.
    fn bend(input: &str, side: &Side, place: Place) -> Self::Bend;

    /// The input and the place of a bend.
    fn place<'a>(bend: &'a Self::Bend, side: &dyn Fn(&str) -> Option<(usize, Side)>) -> Option<Step>;
}

/// The data of the search.
pub(super) struct Search<'a, K> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    /// The inputs that may have bends.
    pub open: Vec<usize>,
    /// The highest order of a candidate term.
    pub highest: u32,
    pub most_candidates: usize,
    pub kind: std::marker::PhantomData<K>,
}

/// The result.
pub(super) struct Found<B> {
    pub bends: Vec<B>,
    /// The highest order of the candidate terms.
    pub order: u32,
}

/// An input's range for bends: the half above 0 if it is symmetric.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    pub low: f64,
    pub span: f64,
    pub is_symmetric: bool,
}

/// A bend during the search.
#[derive(Clone, Debug)]
pub(super) struct Step {
    pub input: usize,
    pub place: Place,
}

/// Rows in f64, with factors of powers.
pub(super) struct Rows {
    /// The inputs; of symmetric ones the magnitude.
    pub inputs: Vec<Vec<f64>>,
    /// The same, sorted.
    pub sorted: Vec<Vec<f64>>,
    /// The factors of the surface without bends.
    factors: Vec<Vec<f64>>,
    response: DVector<f64>,
    roots: Vec<f64>,
    /// The sign of each row, for an odd response.
    signs: Vec<f64>,
}

/// A linear fit for given bends.
struct Fitted {
    q: DMatrix<f64>,
    coefficients: DVector<f64>,
    rest: DVector<f64>,
    terms: Vec<Vec<u32>>,
    /// The values of each bend.
    steps: Vec<Vec<f64>>,
}

impl Fitted {
    fn square(&self) -> f64 {
        self.rest.norm_squared()
    }
}

impl<K: Kind> Search<'_, K> {
    /// The bends, if they are good enough for a comparison; with `anyway`, also if they are not.
    pub(super) fn run(&self, sample: &Sample, anyway: bool) -> Option<Found<K::Bend>> {
        let rows = self.rows(sample);
        let highest = (1..=self.highest).rev().find(|order| self.count(*order, 2) <= self.most_terms(&rows, 4))?;
        let powers = (1..=self.highest)
            .rev()
            .find_map(|order| self.fitted(&rows, &[], order).filter(|fit| fit.terms.len() * 2 < rows.len()))?;
        let alone = criterion(&powers, &rows, 0);
        let negligible = 1e-20 * rows.response.norm_squared();
        if !anyway && powers.square() <= negligible {
            return None;
        }
        let (mut order, mut chosen, mut best) = (highest, Vec::new(), f64::INFINITY);
        for tried in K::orders(highest) {
            let (steps, found) = self.grown(&rows, tried, negligible);
            // A higher order must reduce the criterion by as much as a bend.
            if found <= (1.0 - LEAST_GAIN) * best {
                (order, chosen, best) = (tried, steps, found);
            }
        }
        if chosen.is_empty() || !(anyway || best <= (1.0 - LEAST_TOTAL_GAIN) * alone) {
            return None;
        }
        chosen.sort_by(|a, b| a.input.cmp(&b.input).then(a.place[0].total_cmp(&b.place[0])));
        Some(Found { bends: self.bends(&chosen), order })
    }

    /// The bends of terms up to an order, added one at a time, with the criterion.
    fn grown(&self, rows: &Rows, order: u32, negligible: f64) -> (Vec<Step>, f64) {
        let mut chosen: Vec<Step> = Vec::new();
        let mut best = f64::INFINITY;
        while chosen.len() < MOST {
            let Some((steps, fit)) = self.one_more(rows, &chosen, order) else { break };
            let found = criterion(&fit, rows, K::COUNTED * steps.len());
            if found.is_nan() || found > (1.0 - LEAST_GAIN) * best {
                break;
            }
            (chosen, best) = (steps, found);
            if fit.square() <= negligible {
                break;
            }
        }
        (chosen, best)
    }

    /// The same bends, refined on other rows.
    pub(super) fn refined(&self, sample: &Sample, bends: &[K::Bend], order: u32) -> Option<Vec<K::Bend>> {
        let rows = self.rows(sample);
        let side = |name: &str| {
            let input = self.inputs.iter().position(|input| input.name == name)?;
            Some((input, self.side(input)))
        };
        let steps: Vec<Step> = bends.iter().map(|bend| K::place(bend, &side)).collect::<Option<_>>()?;
        Some(self.bends(&self.levenberg(&rows, steps, order)?.0))
    }

    /// An input's range for bends.
    pub(super) fn side(&self, input: usize) -> Side {
        let [low, high] = self.inputs[input].range;
        let is_symmetric = self.surface.is_symmetric(&self.inputs[input].name);
        let low = if is_symmetric { 0.0 } else { low };
        Side { low, span: high - low, is_symmetric }
    }

    fn bends(&self, steps: &[Step]) -> Vec<K::Bend> {
        steps.iter().map(|step| K::bend(&self.inputs[step.input].name, &self.side(step.input), step.place)).collect()
    }

    /// An upper limit of the number of terms with this many bends for each input.
    fn count(&self, order: u32, of_an_input: usize) -> usize {
        let bends = self.open.iter().flat_map(|input| vec![self.inputs[*input].name.as_str(); of_an_input]);
        K::terms(self.surface, &bends.collect::<Vec<_>>(), order).len()
    }

    fn most_terms(&self, rows: &Rows, share: usize) -> usize {
        self.most_candidates.min(rows.len() / share)
    }

    fn rows(&self, sample: &Sample) -> Rows {
        let (picked, roots, response) = drawn(sample, MOST_ROWS);
        let factors = Factor::all(self.surface, self.inputs);
        let of = |column: &[f64]| picked.iter().map(|row| column[*row]).collect::<Vec<f64>>();
        let natural: Vec<Vec<f64>> = sample.columns.iter().map(|column| of(column)).collect();
        let values = factors.iter().map(|factor| natural[factor.input].iter().map(|xi| factor.value(*xi)).collect()).collect();
        let point = |row: usize| natural.iter().map(|column| column[row]).collect::<Vec<f64>>();
        let is_negated = |row: usize| rsm_core::basis::is_negated(self.surface, self.inputs, &point(row));
        let signs: Vec<f64> = (0..picked.len()).map(|row| if is_negated(row) { -1.0 } else { 1.0 }).collect();
        let seen = |(input, column): (&Input, &Vec<f64>)| match self.surface.is_symmetric(&input.name) {
            true => column.iter().map(|xi| xi.abs()).collect(),
            false => column.clone(),
        };
        let inputs: Vec<Vec<f64>> = self.inputs.iter().zip(&natural).map(seen).collect();
        let mut sorted = inputs.clone();
        sorted.iter_mut().for_each(|values| order::sort(values));
        Rows { inputs, sorted, factors: values, response, roots, signs }
    }

    fn values(&self, rows: &Rows, step: &Step) -> Vec<f64> {
        K::values(&self.side(step.input), step.place, &rows.inputs[step.input])
    }

    pub(super) fn terms(&self, steps: &[Step], order: u32) -> Vec<Vec<u32>> {
        let names: Vec<&str> = steps.iter().map(|step| self.inputs[step.input].name.as_str()).collect();
        K::terms(self.surface, &names, order)
    }

    /// The column of a term: the product of its factors, without those of `left_out`.
    fn column(rows: &Rows, steps: &[Vec<f64>], powers: &[u32], left_out: Option<usize>) -> Vec<f64> {
        let mut column: Vec<f64> = rows.roots.iter().zip(&rows.signs).map(|(root, sign)| root * sign).collect();
        let factors = rows.factors.iter().chain(steps);
        for (k, (values, power)) in factors.zip(powers).enumerate() {
            if *power > 0 && left_out != Some(k) {
                column.iter_mut().zip(values).for_each(|(product, x)| *product *= x.powi(*power as i32));
            }
        }
        column
    }

    fn fitted(&self, rows: &Rows, steps: &[Step], order: u32) -> Option<Fitted> {
        let terms = self.terms(steps, order);
        if terms.len() + K::NUMBERS * steps.len() >= rows.len() {
            return None;
        }
        let values: Vec<Vec<f64>> = steps.iter().map(|step| self.values(rows, step)).collect();
        let columns: Vec<f64> = terms.iter().flat_map(|powers| Self::column(rows, &values, powers, None)).collect();
        let qr = DMatrix::from_vec(rows.len(), terms.len(), columns).qr();
        let q = qr.q();
        let seen = q.tr_mul(&rows.response);
        let rest = &rows.response - &q * &seen;
        let coefficients = qr.r().solve_upper_triangular(&seen)?;
        coefficients.iter().all(|b| b.is_finite()).then_some(Fitted { q, coefficients, rest, terms, steps: values })
    }

    /// Adds one bend and refines all.
    fn one_more(&self, rows: &Rows, chosen: &[Step], order: u32) -> Option<(Vec<Step>, Fitted)> {
        let base = self.fitted(rows, chosen, order)?;
        let mut starts: Vec<(f64, Step)> = Vec::new();
        for input in self.open.iter().copied() {
            if chosen.iter().filter(|step| step.input == input).count() < MOST_OF_AN_INPUT {
                starts.extend(self.best_start(rows, chosen, &base, order, input));
            }
        }
        order::descending(&mut starts, |it| it.0);
        let refined =
            starts.into_iter().take(REFINED).filter_map(|(_, step)| self.levenberg(rows, [chosen, &[step]].concat(), order));
        refined.min_by(|a, b| a.1.square().total_cmp(&b.1.square()))
    }

    /// The best candidate of an input, with its reduction of the residual.
    fn best_start(&self, rows: &Rows, chosen: &[Step], base: &Fitted, order: u32, input: usize) -> Option<(f64, Step)> {
        let (Side { low, span, .. }, sorted) = (self.side(input), &rows.sorted[input]);
        let quantile = |k: usize| (sorted[(sorted.len() - 1) * k / (K::CENTRES - 1)] - low) / span;
        let mut centres: Vec<f64> = (0..K::CENTRES).map(quantile).collect();
        // Friction, dead bands and similar effects are centred at 0.
        centres.push(-low / span);
        centres.retain(|centre| (0.0..=1.0).contains(centre));
        centres.dedup();
        let with = [chosen, &[Step { input, place: [0.0, 0.0] }]].concat();
        let place = rows.factors.len() + chosen.len();
        let partners: Vec<Vec<f64>> = self
            .terms(&with, order)
            .iter()
            .filter(|powers| powers[place] > 0)
            .map(|powers| Self::column(rows, &base.steps, powers, Some(place)))
            .collect();
        if base.terms.len() + partners.len() > self.most_terms(rows, 3) {
            return None;
        }
        let mut best: Option<(f64, Step)> = None;
        for place in K::starts(&centres, K::limits(self, rows, input, order)) {
            let step = Step { input, place };
            if !K::is_determined(self, rows, &[chosen, std::slice::from_ref(&step)].concat(), order) {
                continue;
            }
            let values = self.values(rows, &step);
            let columns = partners.iter().flat_map(|column| column.iter().zip(&values).map(|(a, b)| a * b).collect::<Vec<_>>());
            let columns = DMatrix::from_vec(rows.len(), partners.len(), columns.collect());
            let own = &columns - &base.q * base.q.tr_mul(&columns);
            let taken = own.qr().q().tr_mul(&base.rest).norm_squared();
            if taken.is_finite() && best.as_ref().is_none_or(|(most, _)| taken > *most) {
                best = Some((taken, step));
            }
        }
        best
    }

    /// Refines all bends together.
    fn levenberg(&self, rows: &Rows, mut steps: Vec<Step>, order: u32) -> Option<(Vec<Step>, Fitted)> {
        let limits: Vec<[f64; 2]> = steps.iter().map(|step| K::limits(self, rows, step.input, order)).collect();
        let mut fit = self.fitted(rows, &steps, order)?;
        let mut damping = 1e-2;
        for _ in 0..STEPS {
            let slopes = self.slopes(rows, &steps, &fit);
            let square = slopes.tr_mul(&slopes);
            let gradient = slopes.tr_mul(&fit.rest);
            let before = fit.square();
            let mut is_better = false;
            for _ in 0..6 {
                let mut matrix = square.clone();
                for k in 0..matrix.nrows() {
                    matrix[(k, k)] += damping * square[(k, k)] + 1e-12 * square.trace() + f64::MIN_POSITIVE;
                }
                let Some(move_by) = matrix.cholesky().map(|factor| factor.solve(&gradient)) else { break };
                let mut moved = steps.clone();
                for (k, step) in moved.iter_mut().enumerate() {
                    let by = &move_by.as_slice()[K::NUMBERS * k..][..K::NUMBERS];
                    step.place = K::moved(step.place, by, limits[k]);
                }
                let found = if K::is_determined(self, rows, &moved, order) { self.fitted(rows, &moved, order) } else { None };
                match found.filter(|found| found.square() < before) {
                    Some(found) => {
                        (steps, fit, is_better) = (moved, found, true);
                        damping = (damping / 5.0).max(1e-8);
                        break;
                    }
                    None => damping *= 5.0,
                }
            }
            if !is_better || before - fit.square() <= 1e-4 * before {
                break;
            }
        }
        Some((steps, fit))
    }

    /// The derivatives of the residual with respect to each number of a place, with the coefficients refitted (Kaufman).
    fn slopes(&self, rows: &Rows, steps: &[Step], fit: &Fitted) -> DMatrix<f64> {
        let mut slopes = DMatrix::zeros(rows.len(), K::NUMBERS * steps.len());
        for (k, step) in steps.iter().enumerate() {
            let place = rows.factors.len() + k;
            let mut partner = vec![0.0; rows.len()];
            for (powers, b) in fit.terms.iter().zip(fit.coefficients.iter()).filter(|(powers, _)| powers[place] > 0) {
                let column = Self::column(rows, &fit.steps, powers, Some(place));
                partner.iter_mut().zip(&column).for_each(|(sum, x)| *sum += b * x);
            }
            for which in 0..K::NUMBERS {
                let h = 1e-6;
                let mut moved = [step.clone(), step.clone()];
                moved[0].place[which] += h;
                moved[1].place[which] -= h;
                let [above, below] = moved.map(|step| self.values(rows, &step));
                for row in 0..rows.len() {
                    slopes[(row, K::NUMBERS * k + which)] = partner[row] * (above[row] - below[row]) / (2.0 * h);
                }
            }
        }
        let seen = fit.q.tr_mul(&slopes);
        slopes - &fit.q * seen
    }
}

impl Rows {
    pub(super) fn len(&self) -> usize {
        self.response.len()
    }
}

/// Generalised cross-validation with this many parameters in addition to the coefficients.
fn criterion(fit: &Fitted, rows: &Rows, beside: usize) -> f64 {
    let n = rows.len() as f64;
    let free = 1.0 - (fit.terms.len() + beside) as f64 / n;
    fit.square() / n / (free * free)
}

/// A number as a multiple of a power of ten.
pub(super) fn rounded(value: f64, unit: f64) -> f64 {
    // Through decimal text, because a multiple of a power of ten is not always the nearest number to its decimal.
    let digits = (-unit.log10()).round().max(0.0) as usize;
    let whole = (value / unit).round() * unit;
    format!("{whole:.digits$}").parse::<f64>().unwrap_or(value) + 0.0
}
