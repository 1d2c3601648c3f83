//! The ladder of figure 1: grow a model term by term until the confidence C is reached, then remove the terms that it does not need.
//!
//! In: the triangle of all candidate terms on the data to fit, and a [`Judge`]: rows that are not fitted, or parts of the fitted
//! rows that are left out in turn. Out: the chosen terms and how they are rated. The paper starts with first order (13) and adds
//! interactions and higher orders until
//!
//! ```text
//! C = 100 - 100 SS_lof / SS_y,   SS_lof = sum n_i (ybar_i - yhat_i)^2 (14),   SS_y = sum n_i ybar_i^2 (15)
//! ```
//!
//! and wants the fewest regressors that reach C. Here: on each rung (order) the term that takes most from the residual of the
//! fitted rows is added, until none is left; then the next order opens. The judge says how far to climb: to the first model that
//! reaches C (and, where the judge knows the spread about the mean, the same figure about the mean), else to the one with the
//! least error. When C is reached, terms leave one at a time while it still is, and two are exchanged for one where that is
//! possible.
//!
//! The judge does not pick the terms of the climb, because it has few rows and there are many candidates: on 5 inputs, 60 rows
//! (18 of them judging), order 4 and noise as large as the signal, picking by the judge gave a true error of 1.56 times the
//! noise, picking by the fitted rows 1.27, and leaving parts of all 60 rows out in turn 1.24. A rule of one standard error
//! changed these by less than 2 % and cost as much on rows with less noise, so the least error stands. Still the judging rows
//! have a say: their error is that of rows that chose. Never solves with dependent columns.

use crate::dd::Dd;
use crate::design::order;
use crate::qr::{Dependent, Growing, Triangle};

/// Judges coefficients on rows that do not take part in computing them.
#[derive(Debug, Clone)]
pub struct Judge {
    parts: Vec<Part>,
    ss_y: Dd,
    about_mean: Option<Dd>,
}

/// Rows that judge, and the rows that are fitted for them.
#[derive(Debug, Clone)]
struct Part {
    /// None: the rows of the ladder itself.
    fit: Option<Triangle>,
    rows: Triangle,
}

/// What a judge says of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rating {
    /// C of (14), (15), in percent. NaN when every mean response is 0.
    pub confidence: f64,
    /// The same about the mean response in place of zero; `None` where the judge does not know it or the responses have no spread.
    pub centred: Option<f64>,
}

impl Judge {
    /// From rows sqrt(n_i) (terms, ybar_i), one a group of replicates.
    #[must_use]
    pub fn new(triangle: Triangle) -> Self {
        let ss_y = triangle.response_square();
        Judge { parts: vec![Part { fit: None, rows: triangle }], ss_y, about_mean: None }
    }

    /// From parts that are left out in turn: for each the rows to fit without it, and its own rows as in [`Judge::new`].
    #[must_use]
    pub fn left_out(parts: Vec<(Triangle, Triangle)>) -> Self {
        let ss_y = parts.iter().map(|(_, rows)| rows.response_square()).sum();
        let part = |(fit, rows)| Part { fit: Some(fit), rows };
        Judge { parts: parts.into_iter().map(part).collect(), ss_y, about_mean: None }
    }

    /// Asks for C about the mean too: sum n_i (ybar_i - mean)^2 of the judging rows.
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

/// Where a climb ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Climb {
    /// The chosen terms, in the order of the candidates.
    pub chosen: Vec<usize>,
    /// Their C.
    pub confidence: f64,
    /// Their C about the mean, where the judge knows it.
    pub centred: Option<f64>,
}

/// A ladder and what stands around it.
pub struct Ladder<'a> {
    /// All candidates and the response on the data to fit.
    pub fit: &'a Triangle,
    /// What is judged on.
    pub judge: &'a Judge,
    /// The candidates, by order.
    pub terms: &'a [Vec<u32>],
    /// The highest order.
    pub max_order: u32,
    /// The wanted C.
    pub wanted: f64,
}

/// A model must leave less than the best by this share to be preferred over a smaller one; less is rounding.
const LEAST_GAIN: f64 = 1e-9;

/// Exchanges of two for one are tried up to so many terms: their number grows with the square.
const MOST_FOR_EXCHANGE: usize = 12;

/// The order of the first rung: 1, or the lowest that there is where odd symmetry asks for more.
#[must_use]
pub(crate) fn first_rung(terms: &[Vec<u32>]) -> u32 {
    terms.iter().map(|powers| order(powers)).min().map_or(1, |lowest| lowest.max(1))
}

/// How many terms so many rows may have: one row stays for the residual, where there is one to spare.
#[must_use]
pub(crate) fn most_terms(rows: usize) -> usize {
    rows.saturating_sub(1).max(1)
}

/// One climb: a problem that grows, and the order that is open.
struct Climber {
    growing: Growing,
    rung: u32,
    most: usize,
}

impl Ladder<'_> {
    /// Climbs. `progress` hears the order, the number of terms and C after each step.
    ///
    /// # Errors
    /// If the first-order columns are linearly dependent already: the data cannot tell the inputs apart.
    pub fn climb(&self, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<Climb, Dependent> {
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

    /// All climbs side by side, a term each at a time: that of the ladder's own rows, and one for each part that is left out.
    fn ascend(&self, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<Climb, Dependent> {
        let climber = |fit: &Triangle, judging: Option<&Triangle>| {
            let growing = judging.map_or_else(|| Growing::new(fit), |rows| Growing::judged_by(fit, rows));
            Climber { growing, rung: first_rung(self.terms), most: most_terms(fit.rows()) }
        };
        let mut own = None;
        let mut judging = Vec::new();
        for part in &self.judge.parts {
            match &part.fit {
                None => own = Some(climber(self.fit, Some(&part.rows))),
                Some(fit) => judging.push(climber(fit, Some(&part.rows))),
            }
        }
        let mut own = own.unwrap_or_else(|| climber(self.fit, None));
        let mut best: Option<(usize, Dd)> = None;
        for climber in std::iter::once(&mut own).chain(&mut judging) {
            self.start(climber)?;
        }
        loop {
            let judges = judging.iter().map(|climber| climber.growing.judged());
            let left: Dd = if judging.is_empty() { own.growing.judged() } else { judges.sum() };
            let rating = self.judge.rating(left);
            let size = own.growing.chosen().len();
            progress(own.rung, size, rating.confidence);
            if best.is_none_or(|(_, least)| left.to_f64() < least.to_f64() * (1.0 - LEAST_GAIN)) {
                best = Some((size, left));
            }
            let went_on =
                !rating.reaches(self.wanted) && std::iter::once(&mut own).chain(&mut judging).all(|climber| self.step(climber));
            if !went_on {
                break;
            }
        }
        let (size, left) = best.expect("the first model was judged");
        let Rating { confidence, centred } = self.judge.rating(left);
        Ok(Climb { chosen: own.growing.chosen()[..size].to_vec(), confidence, centred })
    }

    /// The constant, or where there is none (an odd surface) the first term.
    fn start(&self, climber: &mut Climber) -> Result<(), Dependent> {
        match (0..self.terms.len()).find(|k| order(&self.terms[*k]) == 0) {
            Some(constant) => climber.growing.add(constant),
            None => {
                self.step(climber);
                Ok(())
            }
        }
    }

    /// Adds the term that takes most from the residual, of the lowest order that has one. False when there is none. Dependent terms
    /// are passed over: the data cannot tell what they would add.
    fn step(&self, climber: &mut Climber) -> bool {
        if climber.growing.chosen().len() >= climber.most {
            return false;
        }
        while climber.rung <= self.max_order {
            let is_open = |k: &usize| order(&self.terms[*k]) <= climber.rung && !climber.growing.chosen().contains(k);
            let open = (0..self.terms.len()).filter(is_open);
            let gains = open.filter_map(|k| climber.growing.ahead(k).map(|(gain, _)| (k, gain.to_f64())));
            // The first of equals.
            let best = gains.reduce(|best, other| if other.1 > best.1 { other } else { best });
            match best {
                Some((term, _)) => return climber.growing.add(term).is_ok(),
                None => climber.rung += 1,
            }
        }
        false
    }

    /// How a set of terms is rated; `None` if they are linearly dependent.
    fn rating_of(&self, terms: &[usize]) -> Option<Rating> {
        let left = |part: &Part| {
            let growing = Growing::of(part.fit.as_ref().unwrap_or(self.fit), terms).ok()?;
            Some(part.rows.sum_of_squares(terms, &growing.coefficients()))
        };
        self.judge.parts.iter().map(left).sum::<Option<Dd>>().map(|left| self.judge.rating(left))
    }

    /// Takes out terms one at a time, the least missed first, while C is still reached. The constant is not a regressor and
    /// stays. No terms at all have a C of 0.
    fn prune(&self, climb: &mut Climb) {
        loop {
            let without = |out: &usize| -> Option<Climb> {
                let chosen: Vec<usize> = climb.chosen.iter().copied().filter(|term| term != out).collect();
                let rating = self.rating_of(&chosen).filter(|rating| rating.reaches(self.wanted))?;
                Some(Climb { chosen, confidence: rating.confidence, centred: rating.centred })
            };
            let removable = climb.chosen.iter().filter(|term| order(&self.terms[**term]) > 0);
            let best = removable.filter_map(without).max_by(|a, b| a.confidence.total_cmp(&b.confidence));
            let Some(smaller) = best else { return };
            *climb = smaller;
        }
    }

    /// Puts one term in the place of two, if C is still reached. True when it did. Not tried where parts are left out in turn:
    /// each of the many solutions would be one a part.
    fn exchange(&self, climb: &mut Climb) -> bool {
        let regressors: Vec<usize> = climb.chosen.iter().copied().filter(|term| order(&self.terms[*term]) > 0).collect();
        let [Part { fit: None, rows }] = &self.judge.parts[..] else { return false };
        if climb.chosen.len() > MOST_FOR_EXCHANGE {
            return false;
        }
        for (k, first) in regressors.iter().enumerate() {
            for second in &regressors[k + 1..] {
                let rest: Vec<usize> = climb.chosen.iter().copied().filter(|term| term != first && term != second).collect();
                // All candidates at once: one problem with `rest` solved, each looked at in turn.
                let mut growing = Growing::judged_by(self.fit, rows);
                if rest.iter().any(|term| growing.add(*term).is_err()) {
                    continue;
                }
                let others = (0..self.terms.len()).filter(|k| !rest.contains(k));
                let left = others.filter_map(|k| growing.ahead(k).map(|(_, left)| (k, left)));
                let Some((term, left)) = left.reduce(|best, other| if other.1 < best.1 { other } else { best }) else {
                    continue;
                };
                let rating = self.judge.rating(left);
                if rating.reaches(self.wanted) {
                    let chosen = rest.into_iter().chain([term]).collect();
                    *climb = Climb { chosen, confidence: rating.confidence, centred: rating.centred };
                    return true;
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests;
