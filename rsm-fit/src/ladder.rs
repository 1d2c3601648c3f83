//! The ladder of figure 1: adds terms until the confidence C is reached, then removes the terms that are not needed.
//!
//! In: the triangle of all candidate terms on the data to fit, and a [`Judge`]: rows that are not fitted, or parts of the fitted rows that are left
//! out in turn. Out: the chosen terms and their rating. The paper starts with first order (13) and adds interactions and higher orders until
//!
//! ```text
//! C = 100 - 100 SS_lof / SS_y,   SS_lof = sum n_i (ybar_i - yhat_i)^2 (14),   SS_y = sum n_i ybar_i^2 (15)
//! ```
//!
//! reaches the required value, with the fewest regressors possible. Here, on each rung (order), the term that reduces the residual of the fitted rows
//! most is added, until none is left; then the next order begins. The judge determines the end: the first model that reaches C (and, if the judge
//! knows the spread about the mean, the same C about the mean), otherwise the one with the smallest error. If C is reached, terms are removed one at
//! a time while it still is, and two terms are exchanged for one where that is possible.
//!
//! The judge does not select the terms of the climb, because it has few rows and there are many candidates. With 5 inputs, 60 rows (18 of them for
//! the judge), order 4 and noise as large as the signal, selection by the judge gave a true error of 1.56 times the noise, selection by the fitted
//! rows 1.27, and leaving out parts of all 60 rows in turn 1.24. A one-standard-error rule changed these by less than 2 % and was as much worse on
//! rows with less noise, so the smallest error is used. The judge's rows do affect the choice, so their error is not that of unused rows. Linearly
//! dependent columns are never solved.

use crate::dd::Dd;
use crate::design::order;
use crate::qr::{Dependent, Growing, Triangle};

/// Evaluates coefficients on rows that are not used to compute them.
#[derive(Debug, Clone)]
pub struct Judge {
    parts: Vec<Part>,
    ss_y: Dd,
    about_mean: Option<Dd>,
}

/// The rows of a judge, and the rows that are fitted for them.
#[derive(Debug, Clone)]
struct Part {
    /// `None` for the rows of the ladder itself.
    fit: Option<Triangle>,
    rows: Triangle,
}

/// The rating of a model by a judge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rating {
    /// C of (14), (15), in percent. NaN when every mean response is 0.
    pub confidence: f64,
    /// The same about the mean response instead of zero; `None` if the judge does not know it, or if the responses have no spread.
    pub centred: Option<f64>,
}

impl Judge {
    /// A judge from rows sqrt(n_i) (terms, ybar_i), one for each group of replicates.
    #[must_use]
    pub fn new(triangle: Triangle) -> Self {
        let ss_y = triangle.response_square();
        Judge { parts: vec![Part { fit: None, rows: triangle }], ss_y, about_mean: None }
    }

    /// A judge from parts that are left out in turn: for each, the rows to fit without it, and its own rows as in [`Judge::new`].
    #[must_use]
    pub fn left_out(parts: Vec<(Triangle, Triangle)>) -> Self {
        let ss_y = parts.iter().map(|(_, rows)| rows.response_square()).sum();
        let part = |(fit, rows)| Part { fit: Some(fit), rows };
        Judge { parts: parts.into_iter().map(part).collect(), ss_y, about_mean: None }
    }

    /// Requires C about the mean too: `square` is sum n_i (ybar_i - mean)^2 of the judge's rows.
    #[must_use]
    pub(crate) fn about_the_mean(self, square: Dd) -> Self {
        Judge { about_mean: Some(square).filter(|square| *square > Dd::ZERO), ..self }
    }

    fn rating(&self, left: Dd) -> Rating {
        let share = |whole: Dd| 100.0 - 100.0 * (left / whole).to_f64();
        Rating { confidence: share(self.ss_y), centred: self.about_mean.map(share) }
    }
}

impl Rating {
    fn reaches(self, wanted: f64) -> bool {
        self.confidence >= wanted && self.centred.is_none_or(|centred| centred >= wanted)
    }
}

/// The result of a climb.
#[derive(Debug, Clone, PartialEq)]
pub struct LadderModel {
    /// The chosen terms, in the order of the candidates.
    pub chosen: Vec<usize>,
    /// Their C.
    pub confidence: f64,
    /// Their C about the mean, if the judge knows it.
    pub centred: Option<f64>,
}

/// A ladder with its data.
#[derive(Clone)]
pub struct Ladder<'a> {
    fit: &'a Triangle,
    judge: &'a Judge,
    terms: &'a [Vec<u32>],
    max_order: u32,
    wanted: f64,
    /// The candidates of every model, such as the constant.
    always: Vec<usize>,
    /// The candidates of the model without a surface, if that is more than the constant: C about the mean is then C about that model.
    level: Vec<usize>,
}

impl<'a> Ladder<'a> {
    /// `fit`: all candidates and the response on the data to fit. `terms`: the candidates, by order. `wanted`: the required C. The constant is in
    /// every model.
    #[must_use]
    pub fn new(fit: &'a Triangle, judge: &'a Judge, terms: &'a [Vec<u32>], max_order: u32, wanted: f64) -> Self {
        let always = (0..terms.len()).filter(|k| order(&terms[*k]) == 0).take(1).collect();
        Ladder { fit, judge, terms, max_order, wanted, always, level: Vec::new() }
    }

    /// With further candidates in every model, and those of the model without a surface.
    pub(crate) fn with(self, always: Vec<usize>, level: Vec<usize>) -> Self {
        Ladder { always, level, ..self }
    }
}

/// A larger model is preferred only if it reduces the error by at least this share; less is rounding.
const LEAST_GAIN: f64 = 1e-9;

/// Exchanges of two terms for one are tried up to this number of terms, because their number grows with its square.
const MOST_FOR_EXCHANGE: usize = 12;

/// The order of the first rung: 1, or the lowest order of a candidate if odd symmetry requires more.
#[must_use]
pub(crate) fn first_rung(terms: &[Vec<u32>]) -> u32 {
    terms.iter().map(|powers| order(powers)).min().map_or(1, |lowest| lowest.max(1))
}

/// The largest number of terms for this number of rows: one row is kept for the residual, if possible.
#[must_use]
pub(crate) fn most_terms(rows: usize) -> usize {
    rows.saturating_sub(1).max(1)
}

/// Adds a term of every model. Without the rows of one block its contrast depends on the others: the model is the same without it.
fn add_if_independent(growing: &mut Growing, term: usize) -> Result<(), Dependent> {
    if growing.effect_of_adding(term).is_some() { growing.add(term) } else { Ok(()) }
}

/// One climb: a growing problem, and the current order.
struct Climbing {
    growing: Growing,
    rung: u32,
    most: usize,
}

impl Ladder<'_> {
    /// Climbs. `progress` is called with the order, the number of terms and C after each step.
    ///
    /// # Errors
    /// If the first-order columns are already linearly dependent: the data do not distinguish the inputs.
    pub fn climb(&self, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<LadderModel, Dependent> {
        if self.level.is_empty() {
            return self.climb_about_the_mean(progress);
        }
        let judge = self.judge.clone().about_the_mean(self.left_by_level()?);
        Ladder { judge: &judge, ..self.clone() }.climb_about_the_mean(progress)
    }

    /// The sum of squares that the model without a surface leaves.
    fn left_by_level(&self) -> Result<Dd, Dependent> {
        let mut left = Dd::ZERO;
        for part in &self.judge.parts {
            let mut growing = Growing::judged_by(part.fit.as_ref().unwrap_or(self.fit), &part.rows);
            self.level.iter().try_for_each(|term| add_if_independent(&mut growing, *term))?;
            left += growing.judged();
        }
        Ok(left)
    }

    fn climb_about_the_mean(&self, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<LadderModel, Dependent> {
        let first = first_rung(self.terms);
        let lowest: Vec<usize> = (0..self.terms.len()).filter(|k| order(&self.terms[*k]) <= first).collect();
        Growing::of(self.fit, &lowest)?;
        let mut best = self.ascend(progress)?;
        if self.rating_of(&best.chosen).is_some_and(|rating| rating.reaches(self.wanted)) {
            self.prune(&mut best);
            while self.exchange(&mut best) {
                self.prune(&mut best);
            }
        }
        best.chosen.sort_unstable();
        Ok(best)
    }

    /// All climbs in parallel, one term at a time: that of the ladder's own rows, and one for each part that is left out.
    fn ascend(&self, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<LadderModel, Dependent> {
        let climbing = |fit: &Triangle, judging: Option<&Triangle>| {
            let growing = judging.map_or_else(|| Growing::new(fit), |rows| Growing::judged_by(fit, rows));
            Climbing { growing, rung: first_rung(self.terms), most: most_terms(fit.rows()) }
        };
        let mut own = None;
        let mut judging = Vec::new();
        for part in &self.judge.parts {
            match &part.fit {
                None => own = Some(climbing(self.fit, Some(&part.rows))),
                Some(fit) => judging.push(climbing(fit, Some(&part.rows))),
            }
        }
        let mut own = own.unwrap_or_else(|| climbing(self.fit, None));
        let mut best: Option<(usize, Dd)> = None;
        for climbing in std::iter::once(&mut own).chain(&mut judging) {
            self.start(climbing)?;
        }
        loop {
            let judges = judging.iter().map(|climbing| climbing.growing.judged());
            let left: Dd = if judging.is_empty() { own.growing.judged() } else { judges.sum() };
            let rating = self.judge.rating(left);
            let size = own.growing.chosen().len();
            progress(own.rung, size, rating.confidence);
            if best.is_none_or(|(_, least)| left.to_f64() < least.to_f64() * (1.0 - LEAST_GAIN)) {
                best = Some((size, left));
            }
            let went_on = !rating.reaches(self.wanted)
                && std::iter::once(&mut own).chain(&mut judging).all(|climbing| self.step(climbing));
            if !went_on {
                break;
            }
        }
        let (size, left) = best.expect("the first model was judged");
        let Rating { confidence, centred } = self.judge.rating(left);
        Ok(LadderModel { chosen: own.growing.chosen()[..size].to_vec(), confidence, centred })
    }

    /// The terms of every model; without one (an odd surface), the first term.
    fn start(&self, climbing: &mut Climbing) -> Result<(), Dependent> {
        if self.always.is_empty() {
            self.step(climbing);
        }
        self.always.iter().try_for_each(|term| add_if_independent(&mut climbing.growing, *term))
    }

    /// Adds the term that reduces the residual most, from the lowest order that has one. False if there is none. Linearly dependent terms are
    /// skipped.
    fn step(&self, climbing: &mut Climbing) -> bool {
        if climbing.growing.chosen().len() >= climbing.most {
            return false;
        }
        while climbing.rung <= self.max_order {
            let is_open = |k: &usize| order(&self.terms[*k]) <= climbing.rung && !climbing.growing.chosen().contains(k);
            let open = (0..self.terms.len()).filter(is_open);
            let gains = open.filter_map(|k| climbing.growing.effect_of_adding(k).map(|(gain, _)| (k, gain.to_f64())));
            // The first of equals.
            let best = gains.reduce(|best, other| if other.1 > best.1 { other } else { best });
            match best {
                Some((term, _)) => return climbing.growing.add(term).is_ok(),
                None => climbing.rung += 1,
            }
        }
        false
    }

    /// The rating of a set of terms; `None` if they are linearly dependent.
    fn rating_of(&self, terms: &[usize]) -> Option<Rating> {
        let left = |part: &Part| {
            let growing = Growing::of(part.fit.as_ref().unwrap_or(self.fit), terms).ok()?;
            Some(part.rows.sum_of_squares(terms, &growing.coefficients()))
        };
        self.judge.parts.iter().map(left).sum::<Option<Dd>>().map(|left| self.judge.rating(left))
    }

    /// Removes terms one at a time while C is still reached, the least important first. The constant is not a regressor and stays. Without any terms,
    /// C is 0.
    fn prune(&self, climb: &mut LadderModel) {
        loop {
            let without = |out: &usize| -> Option<LadderModel> {
                let chosen: Vec<usize> = climb.chosen.iter().copied().filter(|term| term != out).collect();
                let rating = self.rating_of(&chosen).filter(|rating| rating.reaches(self.wanted))?;
                Some(LadderModel { chosen, confidence: rating.confidence, centred: rating.centred })
            };
            let removable = climb.chosen.iter().filter(|term| !self.always.contains(term));
            let best = removable.filter_map(without).max_by(|a, b| a.confidence.total_cmp(&b.confidence));
            let Some(smaller) = best else { return };
            *climb = smaller;
        }
    }

    /// Replaces two terms by one, if C is still reached. Returns whether it did. Not tried if parts are left out in turn, because each trial would
    /// need one solution for each part.
    fn exchange(&self, climb: &mut LadderModel) -> bool {
        let regressors: Vec<usize> = climb.chosen.iter().copied().filter(|term| !self.always.contains(term)).collect();
        let [Part { fit: None, rows }] = &self.judge.parts[..] else { return false };
        if climb.chosen.len() > MOST_FOR_EXCHANGE {
            return false;
        }
        for (k, first) in regressors.iter().enumerate() {
            for second in &regressors[k + 1..] {
                let rest: Vec<usize> = climb.chosen.iter().copied().filter(|term| term != first && term != second).collect();
                // All candidates at once: one problem with `rest` solved, in which each candidate is evaluated.
                let mut growing = Growing::judged_by(self.fit, rows);
                if rest.iter().any(|term| growing.add(*term).is_err()) {
                    continue;
                }
                let others = (0..self.terms.len()).filter(|k| !rest.contains(k));
                let left = others.filter_map(|k| growing.effect_of_adding(k).map(|(_, left)| (k, left)));
                let Some((term, left)) = left.reduce(|best, other| if other.1 < best.1 { other } else { best }) else {
                    continue;
                };
                let rating = self.judge.rating(left);
                if rating.reaches(self.wanted) {
                    let chosen = rest.into_iter().chain([term]).collect();
                    *climb = LadderModel { chosen, confidence: rating.confidence, centred: rating.centred };
                    return true;
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests;
