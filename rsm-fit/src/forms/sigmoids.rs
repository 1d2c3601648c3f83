//! Finds where a response bends: the centres and widths of sigmoids, by variable projection.
//!
//! In: rows to fit. Out: sigmoids, or none. For given centres and widths the coefficients are a linear problem, so the residual sum of squares is a
//! function of centres and widths alone, and only these are searched (G. Golub, V. Pereyra, 1973). Sigmoids are added one at a time: candidate
//! centres and widths are tried at every input, the best are refined by Levenberg-Marquardt with Kaufman's derivative (1975), all sigmoids together.
//! The search ends when generalised cross-validation (P. Craven, G. Wahba, 1979), which counts centres and widths as coefficients, no longer falls.

use nalgebra::{DMatrix, DVector};
use rsm_core::basis::{Factor, Shape};
use rsm_core::model::{Input, Sigmoid, Surface};
use rsm_core::order;

use super::drawn;
use crate::design;
use crate::selection::Sample;

/// The largest number of sigmoids of one input.
const MOST_OF_AN_INPUT: usize = 3;

/// The largest number of sigmoids.
const MOST: usize = 5;

/// With more rows, a random sample is used: more rows cost time and hardly improve centres and widths.
const MOST_ROWS: usize = 1500;

/// Each sigmoid must reduce the criterion by this share.
const LEAST_GAIN: f64 = 0.05;

/// All sigmoids together must reduce the criterion of powers alone by this share; otherwise nothing else is tried.
const LEAST_TOTAL_GAIN: f64 = 0.25;

/// Candidate widths, as shares of the range.
const WIDTHS: [f64; 4] = [0.5, 0.15, 0.05, 0.015];

/// The number of candidate centres: quantiles of the input in the rows.
const CENTRES: usize = 11;

/// The largest number of Levenberg-Marquardt steps.
const STEPS: usize = 30;

/// The best candidate of each input is considered; this many of them are refined.
const REFINED: usize = 2;

/// The data of the search.
pub(super) struct Search<'a> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    /// The highest order of a candidate term.
    pub highest: u32,
    pub most_candidates: usize,
}

/// The result.
pub(super) struct Found {
    pub sigmoids: Vec<Sigmoid>,
    /// The highest order with an acceptable number of candidate terms.
    pub order: u32,
}

/// The centre as a share of the range, and the logarithm of the width in the same unit.
type Place = [f64; 2];

/// A sigmoid during the search.
#[derive(Clone, Debug)]
struct Step {
    input: usize,
    place: Place,
}

/// Rows in f64, with factors of powers.
struct Rows {
    /// The inputs; of symmetric ones the magnitude.
    inputs: Vec<Vec<f64>>,
    /// The factors of the surface without sigmoids.
    factors: Vec<Vec<f64>>,
    response: DVector<f64>,
    roots: Vec<f64>,
    /// The sign of each row, for an odd response.
    signs: Vec<f64>,
}

/// A linear fit for given sigmoids.
struct Fitted {
    q: DMatrix<f64>,
    coefficients: DVector<f64>,
    rest: DVector<f64>,
    terms: Vec<Vec<u32>>,
    /// The values of each sigmoid.
    steps: Vec<Vec<f64>>,
}

impl Fitted {
    fn square(&self) -> f64 {
        self.rest.norm_squared()
    }
}

impl Search<'_> {
    /// The sigmoids, if they are good enough for a comparison; with `anyway`, also if they are not.
    pub(super) fn run(&self, sample: &Sample, anyway: bool) -> Option<Found> {
        let rows = self.rows(sample);
        let order = (1..=self.highest).rev().find(|order| self.count(*order, 2) <= self.most_terms(&rows, 4))?;
        let powers = (1..=self.highest)
            .rev()
            .find_map(|order| self.fitted(&rows, &[], order).filter(|fit| fit.terms.len() * 2 < rows.len()))?;
        let alone = criterion(&powers, &rows, 0);
        let negligible = 1e-20 * rows.response.norm_squared();
        if !anyway && powers.square() <= negligible {
            return None;
        }
        let mut chosen: Vec<Step> = Vec::new();
        let mut best = f64::INFINITY;
        while chosen.len() < MOST {
            let Some((steps, fit)) = self.one_more(&rows, &chosen, order) else { break };
            let found = criterion(&fit, &rows, 2 * steps.len());
            if found.is_nan() || found > (1.0 - LEAST_GAIN) * best {
                break;
            }
            (chosen, best) = (steps, found);
            if fit.square() <= negligible {
                break;
            }
        }
        if chosen.is_empty() || !(anyway || best <= (1.0 - LEAST_TOTAL_GAIN) * alone) {
            return None;
        }
        chosen.sort_by(|a, b| a.input.cmp(&b.input).then(a.place[0].total_cmp(&b.place[0])));
        Some(Found { sigmoids: self.as_sigmoids(&chosen), order })
    }

    /// The same sigmoids, refined on other rows.
    pub(super) fn refined(&self, sample: &Sample, sigmoids: &[Sigmoid], order: u32) -> Option<Vec<Sigmoid>> {
        let rows = self.rows(sample);
        let step = |sigmoid: &Sigmoid| {
            let input = self.inputs.iter().position(|input| input.name == sigmoid.input)?;
            let (low, span) = self.side(input);
            Some(Step { input, place: [(sigmoid.at - low) / span, (sigmoid.width / span).ln()] })
        };
        let steps: Vec<Step> = sigmoids.iter().map(step).collect::<Option<_>>()?;
        Some(self.as_sigmoids(&self.levenberg(&rows, steps, order)?.0))
    }

    /// The lower end and the length of an input's range for sigmoids.
    fn side(&self, input: usize) -> (f64, f64) {
        let [low, high] = self.inputs[input].range;
        let low = if self.surface.is_symmetric(&self.inputs[input].name) { 0.0 } else { low };
        (low, high - low)
    }

    /// Rounds to 10^-5 of the width, so that the file has no meaningless digits.
    fn as_sigmoids(&self, steps: &[Step]) -> Vec<Sigmoid> {
        let sigmoid = |step: &Step| {
            let (low, span) = self.side(step.input);
            let width = step.place[1].exp() * span;
            let unit = 10f64.powi((width.log10() - 4.0).floor() as i32);
            // Through decimal text, because a multiple of a power of ten is not always the nearest number to its decimal.
            let digits = (-unit.log10()).round().max(0.0) as usize;
            let rounded = |value: f64| {
                let whole = (value / unit).round() * unit;
                format!("{whole:.digits$}").parse::<f64>().unwrap_or(value) + 0.0
            };
            Sigmoid {
                input: self.inputs[step.input].name.clone(),
                at: rounded(low + step.place[0] * span),
                width: rounded(width),
            }
        };
        steps.iter().map(sigmoid).collect()
    }

    /// An upper limit of the number of terms with this many sigmoids for each input.
    fn count(&self, order: u32, of_an_input: usize) -> usize {
        let free = self.inputs.iter().filter(|input| self.surface.category_of(&input.name).is_none());
        let steps = free.flat_map(|input| (0..of_an_input).map(move |k| (input, k)));
        let sigmoids = steps.map(|(input, k)| Sigmoid { input: input.name.clone(), at: k as f64, width: 1.0 }).collect();
        design::terms_up_to(&Surface { sigmoids, ..self.surface.clone() }, order).len()
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
        let inputs = self.inputs.iter().zip(&natural).map(seen).collect();
        Rows { inputs, factors: values, response, roots, signs }
    }

    /// The values of a sigmoid.
    fn values(&self, rows: &Rows, step: &Step) -> Vec<f64> {
        let (low, span) = self.side(step.input);
        let (at, width) = (low + step.place[0] * span, step.place[1].exp() * span);
        let is_symmetric = self.surface.is_symmetric(&self.inputs[step.input].name);
        let offset = if is_symmetric { Shape::step(-at, width) } else { 0.0 };
        rows.inputs[step.input].iter().map(|xi| Shape::step(xi - at, width) - offset).collect()
    }

    fn terms(&self, steps: &[Step], order: u32) -> Vec<Vec<u32>> {
        let sigmoid = |step: &Step| Sigmoid { input: self.inputs[step.input].name.clone(), at: step.place[0], width: 1.0 };
        let surface = Surface { sigmoids: steps.iter().map(sigmoid).collect(), ..self.surface.clone() };
        design::terms_up_to(&surface, order)
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
        if terms.len() + 2 * steps.len() >= rows.len() {
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

    /// Adds one sigmoid and refines all.
    fn one_more(&self, rows: &Rows, chosen: &[Step], order: u32) -> Option<(Vec<Step>, Fitted)> {
        let base = self.fitted(rows, chosen, order)?;
        let mut starts: Vec<(f64, Step)> = Vec::new();
        let is_free = |input: &usize| self.surface.category_of(&self.inputs[*input].name).is_none();
        for input in (0..self.inputs.len()).filter(is_free) {
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
        let (low, span) = self.side(input);
        let mut sorted = rows.inputs[input].clone();
        order::sort(&mut sorted);
        let quantile = |k: usize| (sorted[(sorted.len() - 1) * k / (CENTRES - 1)] - low) / span;
        let mut centres: Vec<f64> = (0..CENTRES).map(quantile).collect();
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
        let narrowest = self.narrowest(rows, input);
        let mut best: Option<(f64, Step)> = None;
        for centre in centres {
            for width in WIDTHS.into_iter().filter(|width| *width >= narrowest) {
                let step = Step { input, place: [centre, width.ln()] };
                let values = self.values(rows, &step);
                let columns =
                    partners.iter().flat_map(|column| column.iter().zip(&values).map(|(a, b)| a * b).collect::<Vec<_>>());
                let columns = DMatrix::from_vec(rows.len(), partners.len(), columns.collect());
                let own = &columns - &base.q * base.q.tr_mul(&columns);
                let taken = own.qr().q().tr_mul(&base.rest).norm_squared();
                if taken.is_finite() && best.as_ref().is_none_or(|(most, _)| taken > *most) {
                    best = Some((taken, step));
                }
            }
        }
        best
    }

    /// The smallest width that the rows can show, as a share of the range: half of the median distance of neighbouring values.
    fn narrowest(&self, rows: &Rows, input: usize) -> f64 {
        let (_, span) = self.side(input);
        let mut sorted = rows.inputs[input].clone();
        order::sort(&mut sorted);
        let mut gaps: Vec<f64> = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > 0.0).collect();
        order::sort(&mut gaps);
        (gaps.get(gaps.len() / 2).copied().unwrap_or(span) / span / 2.0).max(1e-3)
    }

    /// Refines all sigmoids together.
    fn levenberg(&self, rows: &Rows, mut steps: Vec<Step>, order: u32) -> Option<(Vec<Step>, Fitted)> {
        let narrowest: Vec<f64> = (0..self.inputs.len()).map(|input| self.narrowest(rows, input)).collect();
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
                    // At most about one width in a step, because the linear approximation is not valid further away.
                    let width = step.place[1].exp();
                    let centre = step.place[0] + move_by[2 * k].clamp(-2.0 * width, 2.0 * width);
                    let logarithm = step.place[1] + move_by[2 * k + 1].clamp(-1.0, 1.0);
                    step.place = [centre.clamp(-0.5, 1.5), logarithm.clamp(narrowest[step.input].ln(), 4f64.ln())];
                }
                match self.fitted(rows, &moved, order).filter(|found| found.square() < before) {
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

    /// The derivatives of the residual with respect to each centre and width, with the coefficients refitted (Kaufman).
    fn slopes(&self, rows: &Rows, steps: &[Step], fit: &Fitted) -> DMatrix<f64> {
        let mut slopes = DMatrix::zeros(rows.len(), 2 * steps.len());
        for (k, step) in steps.iter().enumerate() {
            let place = rows.factors.len() + k;
            let mut partner = vec![0.0; rows.len()];
            for (powers, b) in fit.terms.iter().zip(fit.coefficients.iter()).filter(|(powers, _)| powers[place] > 0) {
                let column = Self::column(rows, &fit.steps, powers, Some(place));
                partner.iter_mut().zip(&column).for_each(|(sum, x)| *sum += b * x);
            }
            for which in 0..2 {
                let h = 1e-6;
                let mut moved = [step.clone(), step.clone()];
                moved[0].place[which] += h;
                moved[1].place[which] -= h;
                let [above, below] = moved.map(|step| self.values(rows, &step));
                for row in 0..rows.len() {
                    slopes[(row, 2 * k + which)] = partner[row] * (above[row] - below[row]) / (2.0 * h);
                }
            }
        }
        let seen = fit.q.tr_mul(&slopes);
        slopes - &fit.q * seen
    }
}

impl Rows {
    fn len(&self) -> usize {
        self.response.len()
    }
}

/// Generalised cross-validation with this many parameters in addition to the coefficients.
fn criterion(fit: &Fitted, rows: &Rows, beside: usize) -> f64 {
    let n = rows.len() as f64;
    let free = 1.0 - (fit.terms.len() + beside) as f64 / n;
    fit.square() / n / (free * free)
}
