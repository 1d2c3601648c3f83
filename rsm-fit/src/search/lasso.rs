//! The path of the LASSO, and of least squares on its active terms.
//!
//! In: a Gram matrix. Out: for each penalty of a grid and each share of shrinkage a model. The exact path is followed from event to event (a term
//! enters, or its coefficient reaches 0); between two events it is a straight line. Share 1 is the LASSO, share 0 least squares on its active
//! terms, a half the mean of both: the relaxed LASSO. The penalty is on coefficients of coded variables as they are, so that high orders,
//! whose columns are smaller, pay more; of uncoded variables on scaled columns.
//!
//! Sources: Tibshirani 1996; Osborne, Presnell, Turlach 2000 and Efron and others 2004 (the path); Meinshausen 2007, Hastie, Tibshirani,
//! Tibshirani 2017 (the relaxed LASSO).

use super::gram::{Gram, Swept};
use super::paths::{Heredity, Model, Path, sweep_all};

/// The shares of shrinkage.
pub(super) const SHARES: [f64; 3] = [1.0, 0.5, 0.0];

/// The number of penalties, from the largest, at which no term is active, to a ten-thousandth of it.
const PENALTIES: usize = 80;
const LEAST_PENALTY: f64 = 1e-4;

pub(super) struct Lasso<'a> {
    /// The terms of every model, which are not penalised.
    pub always: &'a [usize],
    /// For each candidate: its scale if the penalty is on the unscaled coefficient, otherwise 1.
    pub units: &'a [f64],
    /// The penalties per row, falling.
    pub penalties: &'a [f64],
    pub most: usize,
    /// With heredity, required terms are added, and only least squares is used.
    pub heredity: Option<&'a Heredity>,
}

/// The grid of penalties for some rows; the same for all parts of them.
pub(super) fn penalties(gram: &Gram, always: &[usize], units: &[f64]) -> Vec<f64> {
    let mut swept = Swept::new(gram);
    sweep_all(&mut swept, always);
    let of_one = |k: usize| if always.contains(&k) { 0.0 } else { (units[k] * swept.at(k, gram.width - 1)).abs() };
    let largest = (0..units.len()).map(of_one).fold(0.0, f64::max) / gram.weight;
    (0..PENALTIES).map(|k| largest * LEAST_PENALTY.powf(k as f64 / (PENALTIES - 1) as f64)).collect()
}

/// A slope below this share of a candidate's square is rounding error.
const ROUNDING: f64 = 1e-12;

impl Lasso<'_> {
    /// The path. The key of a model is the index of its penalty times the number of shares, plus the index of its share.
    pub(super) fn path(&self, gram: &Gram) -> Path {
        let mut path: Path = vec![None; self.penalties.len() * SHARES.len()];
        let response = gram.width - 1;
        let width = gram.width - 1;
        // Columns in the units of the penalty: the matrix is scaled once.
        let mut scaled = gram.clone();
        for row in 0..gram.width {
            for column in 0..gram.width {
                let unit = |k: usize| self.units.get(k).copied().unwrap_or(1.0);
                scaled.sums[row * gram.width + column] *= unit(row) * unit(column) / gram.weight;
            }
        }
        let mut swept = Swept::new(&scaled);
        sweep_all(&mut swept, self.always);
        let mut signs = vec![0.0; width];
        let mut b = vec![0.0; width];
        for term in self.always.iter().filter(|term| swept.is_in[**term]) {
            b[*term] = swept.at(*term, response);
        }
        let is_free = |k: usize| !self.always.contains(&k);
        let mut slopes: Vec<f64> = (0..width).map(|k| if is_free(k) { swept.at(k, response) } else { 0.0 }).collect();
        let mut penalty = slopes.iter().map(|c| c.abs()).fold(0.0, f64::max);
        let mut next = 0;
        while next < self.penalties.len() && self.penalties[next] >= penalty {
            self.note(&mut path, next, &swept, &b, &signs);
            next += 1;
        }
        let mut dropped: Option<usize> = None;
        let mut events = 8 * width.min(gram.rows) + 16;
        let mut active = 0;
        let first =
            (0..width).filter(|k| is_free(*k)).max_by(|a, b| slopes[*a].abs().total_cmp(&slopes[*b].abs()).then(b.cmp(a)));
        let mut entering = first.filter(|k| slopes[*k] != 0.0 && swept.has_own_part(*k));
        while next < self.penalties.len() && events > 0 {
            events -= 1;
            if let Some(term) = entering.take() {
                signs[term] = slopes[term].signum();
                swept.sweep(term);
                active += 1;
            }
            // When the penalty falls by d, b changes by d direction and the slopes by d fall.
            let mut direction = vec![0.0; width];
            let mut fall = vec![0.0; width];
            for term in (0..width).filter(|k| signs[*k] != 0.0) {
                let row = &swept.entries[term * gram.width..term * gram.width + width];
                for ((k, entry), is_in) in row.iter().enumerate().zip(&swept.is_in) {
                    // Symmetric if both are active; otherwise the projection of the other on the active ones.
                    *if *is_in { &mut direction[k] } else { &mut fall[k] } += entry * signs[term];
                }
            }
            let mut step = penalty;
            let mut event = None;
            for k in (0..width).filter(|k| is_free(*k)) {
                if signs[k] != 0.0 {
                    let until = -b[k] / direction[k];
                    if until > 0.0 && until < step {
                        (step, event) = (until, Some((k, true)));
                    }
                } else if active < self.most && swept.has_own_part(k) {
                    for (gap, rate) in [(penalty - slopes[k], 1.0 - fall[k]), (penalty + slopes[k], 1.0 + fall[k])] {
                        let until = gap.max(0.0) / rate;
                        let is_again = dropped == Some(k) && gap <= ROUNDING * penalty * 1e3;
                        if rate > ROUNDING && until < step && !is_again {
                            (step, event) = (until, Some((k, false)));
                        }
                    }
                }
            }
            while next < self.penalties.len() && self.penalties[next] >= penalty - step {
                let part = penalty - self.penalties[next];
                let here: Vec<f64> = b.iter().zip(&direction).map(|(b, d)| b + part * d).collect();
                self.note(&mut path, next, &swept, &here, &signs);
                next += 1;
            }
            b.iter_mut().zip(&direction).for_each(|(b, d)| *b += step * d);
            slopes.iter_mut().zip(&fall).for_each(|(c, f)| *c -= step * f);
            penalty -= step;
            for k in (0..width).filter(|k| signs[*k] != 0.0) {
                slopes[k] = penalty * signs[k];
            }
            dropped = None;
            match event {
                Some((term, true)) => {
                    (signs[term], b[term]) = (0.0, 0.0);
                    swept.sweep(term);
                    active -= 1;
                    dropped = Some(term);
                }
                Some((term, false)) => entering = Some(term),
                None => break,
            }
        }
        path
    }

    fn note(&self, path: &mut Path, place: usize, swept: &Swept, b: &[f64], signs: &[f64]) {
        let response = swept.width - 1;
        let terms = swept.terms();
        let least_squares: Vec<f64> = terms.iter().map(|k| swept.at(*k, response) * self.units[*k]).collect();
        let shrunk: Vec<f64> = terms.iter().map(|k| b[*k] * self.units[*k]).collect();
        for (k, share) in SHARES.iter().enumerate() {
            let key = place * SHARES.len() + k;
            if let Some(heredity) = self.heredity {
                if *share == 0.0 {
                    path[key] = self.refitted(swept, &heredity.closed(&terms));
                }
                continue;
            }
            let coefficients = shrunk.iter().zip(&least_squares).map(|(b, free)| share * b + (1.0 - share) * free).collect();
            let is_shrunk = *share > 0.0 && signs.iter().any(|sign| *sign != 0.0);
            path[key] = Some(Model { terms: terms.clone(), coefficients, is_shrunk });
        }
    }

    /// Least squares with additional terms; `None` if there are too many.
    fn refitted(&self, swept: &Swept, terms: &[usize]) -> Option<Model> {
        let mut more = swept.clone();
        for term in terms {
            if !more.is_in[*term] && more.has_own_part(*term) {
                more.sweep(*term);
            }
        }
        let terms = more.terms();
        let coefficients = terms.iter().map(|k| more.at(*k, swept.width - 1) * self.units[*k]).collect();
        (terms.len() <= self.most).then_some(Model { terms, coefficients, is_shrunk: false })
    }
}
