//! The ladder of figure 1: grow a model term by term until the confidence C is reached, then take out what it does not need.
//!
//! In: the triangle of all candidate terms on the data to fit, and a [`Judge`] made from the validation data. Out: the chosen
//! terms and their C. The paper starts with first order (13) and adds interactions and higher orders until
//!
//! ```text
//! C = 100 - 100 SS_lof / SS_y,   SS_lof = sum n_i (ybar_i - yhat_i)^2 (14),   SS_y = sum n_i ybar_i^2 (15)
//! ```
//!
//! and wants the fewest regressors that reach C. Here: on each rung (order) the term that raises C most is added, until none
//! does; then the next order opens. When C is reached, terms leave one at a time while it still is, and two are exchanged for
//! one where that is possible. If this climb gets stuck below C, a second one adds by the residual of the fitted data instead,
//! which looks further ahead. The choice uses the validation data: they are not unseen any more in the strict sense, and the
//! evidence says so. Never solves with dependent columns.

use crate::dd::Dd;
use crate::design::order;
use crate::qr::{Dependent, Growing, Triangle};

/// Judges coefficients on validation data.
#[derive(Debug, Clone)]
pub struct Judge {
    triangle: Triangle,
    ss_y: Dd,
}

impl Judge {
    /// From rows sqrt(n_i) (terms, ybar_i), one a group of replicates.
    #[must_use]
    pub fn new(triangle: Triangle) -> Self {
        let ss_y = triangle.response_square();
        Judge { triangle, ss_y }
    }

    /// C of some terms with their coefficients, (14) and (15). NaN when every mean response is 0.
    #[must_use]
    pub fn confidence(&self, terms: &[usize], coefficients: &[Dd]) -> f64 {
        let ss_lof = self.triangle.sum_of_squares(terms, coefficients);
        100.0 - 100.0 * (ss_lof / self.ss_y).to_f64()
    }
}

/// Where a climb ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Climb {
    /// The chosen terms, in the order of the candidates.
    pub chosen: Vec<usize>,
    /// Their C.
    pub confidence: f64,
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

/// A term must take away more than this share of what is missing to 100; less is rounding of the f64 in which C is given.
const LEAST_GAIN: f64 = 1e-9;

/// Exchanges of two for one are tried up to so many terms: their number grows with the square.
const MOST_FOR_EXCHANGE: usize = 12;

#[derive(Clone, Copy, PartialEq)]
enum By {
    Confidence,
    Residual,
}

/// The order of the first rung: 1, or the lowest that there is where odd symmetry asks for more.
#[must_use]
pub fn first_rung(terms: &[Vec<u32>]) -> u32 {
    terms.iter().map(|powers| order(powers)).min().unwrap_or(0).max(1)
}

impl Ladder<'_> {
    /// Climbs. `progress` hears the order, the number of terms and C after each step.
    ///
    /// # Errors
    /// When already the first-order columns make each other up: the data cannot tell the inputs apart.
    pub fn climb(&self, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<Climb, Dependent> {
        let mut best = self.ascend(By::Confidence, progress)?;
        if best.confidence < self.wanted {
            let other = self.ascend(By::Residual, progress)?;
            if other.confidence > best.confidence {
                best = other;
            }
        }
        if best.confidence >= self.wanted {
            self.prune(&mut best);
            while self.exchange(&mut best) {
                self.prune(&mut best);
            }
        }
        best.chosen.sort_unstable();
        Ok(best)
    }

    fn ascend(&self, by: By, progress: &mut dyn FnMut(u32, usize, f64)) -> Result<Climb, Dependent> {
        let mut growing = Growing::new(self.fit);
        let lowest = first_rung(self.terms);
        for (k, powers) in self.terms.iter().enumerate() {
            if order(powers) <= lowest {
                growing.add(k)?;
            }
        }
        let confidence = self.judge.confidence(growing.chosen(), &growing.coefficients());
        let mut best = Climb { chosen: growing.chosen().to_vec(), confidence };
        let mut rung = lowest + 1;
        progress(lowest, best.chosen.len(), confidence);
        let mut now = confidence;
        while best.confidence < self.wanted && growing.chosen().len() < self.most_terms() {
            let step = self.best_addition(&growing, rung, by);
            let goes_up = step.is_some_and(|(_, next)| by == By::Residual || 100.0 - next < (100.0 - now) * (1.0 - LEAST_GAIN));
            match step {
                Some((term, next)) if goes_up => {
                    growing.add(term)?;
                    now = next;
                    progress(rung, growing.chosen().len(), next);
                    if next > best.confidence {
                        best = Climb { chosen: growing.chosen().to_vec(), confidence: next };
                    }
                }
                _ if rung < self.max_order => rung += 1,
                _ => break,
            }
        }
        Ok(best)
    }

    /// One row stays for the residual, where there is one to spare.
    fn most_terms(&self) -> usize {
        self.fit.rows().saturating_sub(1)
    }

    /// The best term up to an order, and C with it. Dependent terms are passed over: the data cannot tell what they would add.
    fn best_addition(&self, growing: &Growing, rung: u32, by: By) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64, f64)> = None;
        let mut terms = growing.chosen().to_vec();
        for (k, powers) in self.terms.iter().enumerate() {
            if order(powers) > rung || growing.chosen().contains(&k) {
                continue;
            }
            let Some(coefficients) = growing.coefficients_with(k) else { continue };
            terms.push(k);
            let confidence = self.judge.confidence(&terms, &coefficients);
            let merit = match by {
                By::Confidence => confidence,
                By::Residual => -self.fit.sum_of_squares(&terms, &coefficients).to_f64(),
            };
            terms.pop();
            if best.is_none_or(|(_, most, _)| merit > most) {
                best = Some((k, merit, confidence));
            }
        }
        best.map(|(k, _, confidence)| (k, confidence))
    }

    /// C of a set of terms; `None` when they make each other up.
    fn confidence_of(&self, terms: &[usize]) -> Option<f64> {
        let growing = Growing::of(self.fit, terms).ok()?;
        Some(self.judge.confidence(terms, &growing.coefficients()))
    }

    /// Takes out terms one at a time, the least missed first, while C is still reached. The constant is not a regressor and
    /// stays.
    fn prune(&self, climb: &mut Climb) {
        while climb.chosen.len() > 1 {
            let without = |out: &usize| -> Option<(Vec<usize>, f64)> {
                let rest: Vec<usize> = climb.chosen.iter().copied().filter(|term| term != out).collect();
                let confidence = self.confidence_of(&rest)?;
                (confidence >= self.wanted).then_some((rest, confidence))
            };
            let removable = climb.chosen.iter().filter(|term| order(&self.terms[**term]) > 0);
            let best = removable.filter_map(without).max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((chosen, confidence)) = best else { return };
            *climb = Climb { chosen, confidence };
        }
    }

    /// Puts one term in the place of two, if C is still reached. True when it did.
    fn exchange(&self, climb: &mut Climb) -> bool {
        let regressors: Vec<usize> = climb.chosen.iter().copied().filter(|term| order(&self.terms[*term]) > 0).collect();
        if regressors.len() < 2 || climb.chosen.len() > MOST_FOR_EXCHANGE {
            return false;
        }
        for (k, first) in regressors.iter().enumerate() {
            for second in &regressors[k + 1..] {
                let rest: Vec<usize> = climb.chosen.iter().copied().filter(|term| term != first && term != second).collect();
                // All candidates at once: one problem with `rest` solved, each appended in turn.
                let mut growing = Growing::new(self.fit);
                if rest.iter().any(|term| growing.add(*term).is_err()) {
                    continue;
                }
                let Some((term, confidence)) = self.best_addition(&growing, self.max_order, By::Confidence) else { continue };
                if confidence >= self.wanted {
                    let chosen = rest.into_iter().chain([term]).collect();
                    *climb = Climb { chosen, confidence };
                    return true;
                }
            }
        }
        false
    }
}
