//! The ladder of figure 1 for large problems, where double-double would take minutes: the same steps with sums of products in f64.
//!
//! In: Gram matrices of the rows to fit and of the judge's rows. Out: the chosen terms with C. The rules are those of `crate::ladder`, except that
//! two terms are not exchanged for one.

use super::gram::{Gram, Scales, Swept};
use super::paths::{Heredity, Model, Path, Steps, sweep_all};
use super::{Found, Part, Searcher};
use crate::design::order;
use crate::ladder::most_terms;
use crate::selection::ChosenBy;
use crate::spec::Method;

/// From this number of double-double multiplications of one climb, this ladder is used: in double-double that takes about 20 seconds with ten parts.
/// Five inputs at order four are below it.
const LARGE: f64 = 3e7;

/// A larger model is preferred only if it reduces the error by at least this share; less is rounding.
const LEAST_GAIN: f64 = 1e-9;

pub(super) fn is_large(width: usize, rows: usize) -> bool {
    let width = width as f64;
    let rows = (rows as f64).min(10.0 * width);
    width * rows * width.min(rows) > LARGE
}

/// The judge's rows, and the sums of the rows that are fitted for them.
struct Judge<'a> {
    fit: Gram,
    rows: &'a Gram,
}

struct Ratings {
    about_zero: f64,
    about_mean: f64,
    wanted: f64,
}

impl Ratings {
    /// C, and C about the mean if there is a spread.
    fn of(&self, left: f64) -> (f64, Option<f64>) {
        let share = |whole: f64| 100.0 - 100.0 * left / whole;
        (share(self.about_zero), (self.about_mean > 0.0).then(|| share(self.about_mean)))
    }

    fn is_reached(&self, left: f64) -> bool {
        let (confidence, centred) = self.of(left);
        confidence >= self.wanted && centred.is_none_or(|centred| centred >= self.wanted)
    }
}

impl Searcher<'_> {
    /// The climb of a ladder.
    pub(super) fn climbed(&self, scales: &Scales, total: &Gram, parts: &[&Part], held: Option<&[&Part]>) -> Option<Found> {
        let Method::Ladder { confidence: wanted, .. } = *self.method else { return None };
        let always = self.always();
        let heredity = Heredity::of(self.design.terms(), false);
        let rungs: Vec<u32> = self.design.terms().iter().map(|powers| order(powers)).collect();
        let judges: Vec<Judge<'_>> = match held {
            Some(held) => held.iter().map(|part| Judge { fit: total.clone(), rows: judging(part) }).collect(),
            None if parts.len() < 3 => return None,
            None => (0..parts.len()).map(|out| Judge { fit: self.sum(parts, Some(out)), rows: judging(parts[out]) }).collect(),
        };
        let least_rows = judges.iter().map(|judge| judge.fit.rows).min()?;
        let most = most_terms(least_rows.min(total.rows)).min(self.design.width());
        let steps = Steps { always: &always, heredity: &heredity, most };
        let full = steps.by_rungs(total, &rungs);
        // Validation rows evaluate the same fit, so its path is computed once.
        let paths: Vec<Path> = match held {
            Some(_) => vec![full.clone(); judges.len()],
            None => judges.iter().map(|judge| steps.by_rungs(&judge.fit, &rungs)).collect(),
        };
        let ratings = self.ratings(scales, &judges, wanted);
        let mut best: Option<(usize, f64)> = None;
        for size in 0..most {
            let squares = judges.iter().zip(&paths).map(|(judge, path)| Some(square(judge.rows, path[size].as_ref()?)));
            let (Some(left), true) = (squares.sum::<Option<f64>>(), full[size].is_some()) else { continue };
            if best.is_none_or(|(_, least)| left < least * (1.0 - LEAST_GAIN)) {
                best = Some((size, left));
            }
            if ratings.is_reached(left) {
                break;
            }
        }
        let (size, mut left) = best?;
        let mut terms = full[size].as_ref()?.terms.clone();
        if ratings.is_reached(left) {
            (terms, left) = pruned(&terms, &always, &judges, &ratings);
        }
        let coefficients = fitted(total, &terms).coefficients(&terms);
        let by = match held {
            Some(_) => ChosenBy::Validation,
            None => ChosenBy::LeftOut { parts: parts.len() },
        };
        let model = Model { terms, coefficients, is_shrunk: false };
        Some(Found { climb: Some(ratings.of(left)), ..self.as_found(scales, &model, by, None) })
    }

    /// The spreads of the judge's rows about zero and about their mean, in the scale of the sums.
    fn ratings(&self, scales: &Scales, judges: &[Judge<'_>], wanted: f64) -> Ratings {
        let response = self.design.width();
        let of = |judge: &Judge<'_>| {
            let sum = match scales.constant {
                Some(constant) => judge.rows.at(constant, response),
                None => 0.0,
            };
            (judge.rows.at(response, response), sum, judge.rows.weight)
        };
        let add = |all: (f64, f64, f64), one: (f64, f64, f64)| (all.0 + one.0, all.1 + one.1, all.2 + one.2);
        let (square, sum, weight) = judges.iter().map(of).fold((0.0, 0.0, 0.0), add);
        // The response is (y - middle)/scale: sum y^2/scale^2 = sum z^2 + 2 m sum z + n m^2.
        let middle = scales.middles[response] / scales.scales[response];
        let level = self.design.level();
        let about_level = || -> f64 {
            let of_one = |judge: &Judge<'_>| {
                let mut swept = Swept::new(&judge.fit);
                sweep_all(&mut swept, &level);
                let terms = swept.terms();
                judge.rows.square(&terms, &swept.coefficients(&terms))
            };
            judges.iter().map(of_one).sum()
        };
        Ratings {
            about_zero: square + 2.0 * middle * sum + weight * middle * middle,
            about_mean: match scales.constant {
                Some(_) if level.is_empty() => square - sum * sum / weight,
                Some(_) => about_level(),
                None => 0.0,
            },
            wanted,
        }
    }
}

fn judging(part: &Part) -> &Gram {
    part.judge.as_ref().unwrap_or(&part.gram)
}

fn square(rows: &Gram, model: &Model) -> f64 {
    rows.square(&model.terms, &model.coefficients)
}

fn fitted(gram: &Gram, terms: &[usize]) -> Swept {
    let mut swept = Swept::new(gram);
    terms.iter().for_each(|term| swept.sweep(*term));
    swept
}

/// The data to evaluate a model without each of its terms, updated as terms are removed. With the fitted inverse V, its column v for a term, its
/// coefficient b and s = b/v_own, the coefficients without the term are b - s v, and the errors on the judge's rows are e + s X v.
struct Without {
    /// V, and V G V with G of the judge's rows, for the terms in their order.
    inverse: Vec<Vec<f64>>,
    judged: Vec<Vec<f64>>,
    coefficients: Vec<f64>,
    /// V X'e.
    slopes: Vec<f64>,
    left: f64,
}

impl Without {
    fn of(judge: &Judge<'_>, terms: &[usize]) -> Self {
        let swept = fitted(&judge.fit, terms);
        let response = swept.width - 1;
        let pick = |from: &dyn Fn(usize, usize) -> f64| -> Vec<Vec<f64>> {
            terms.iter().map(|row| terms.iter().map(|column| from(*row, *column)).collect()).collect()
        };
        let inverse = pick(&|row, column| swept.at(row, column));
        let rows = pick(&|row, column| judge.rows.at(row, column));
        let coefficients = swept.coefficients(terms);
        let times = |matrix: &[Vec<f64>], x: &[f64]| -> Vec<f64> {
            matrix.iter().map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
        };
        let of_fit = times(&rows, &coefficients);
        let errors: Vec<f64> = terms.iter().zip(&of_fit).map(|(term, y)| judge.rows.at(*term, response) - y).collect();
        // V and G are symmetric: a row is a column.
        let judged = inverse.iter().map(|v| times(&inverse, &times(&rows, v))).collect();
        let slopes = times(&inverse, &errors);
        let left = judge.rows.square(terms, &coefficients);
        Without { inverse, judged, coefficients, slopes, left }
    }

    fn share(&self, out: usize) -> f64 {
        self.coefficients[out] / self.inverse[out][out]
    }

    /// The sum of squared errors without a term.
    fn left_without(&self, out: usize) -> f64 {
        let share = self.share(out);
        self.left + 2.0 * share * self.slopes[out] + share * share * self.judged[out][out]
    }

    fn leave(&mut self, out: usize) {
        let (share, own, square) = (self.share(out), self.inverse[out][out], self.judged[out][out]);
        self.left = self.left_without(out);
        let (v, w) = (self.inverse[out].clone(), self.judged[out].clone());
        let slope = (self.slopes[out] + share * square) / own;
        for row in 0..v.len() {
            self.coefficients[row] -= share * v[row];
            self.slopes[row] += share * w[row] - slope * v[row];
            let (by_v, by_w) = (w[row] / own - square * v[row] / (own * own), v[row] / own);
            for (entry, (v, w)) in self.judged[row].iter_mut().zip(v.iter().zip(&w)) {
                *entry -= by_v * v + by_w * w;
            }
            for (entry, v) in self.inverse[row].iter_mut().zip(&v) {
                *entry -= by_w * v;
            }
        }
    }
}

/// Removes terms one at a time while C is still reached, the least important first.
fn pruned(terms: &[usize], always: &[usize], judges: &[Judge<'_>], ratings: &Ratings) -> (Vec<usize>, f64) {
    let mut all: Vec<Without> = judges.iter().map(|judge| Without::of(judge, terms)).collect();
    let mut stays = vec![true; terms.len()];
    loop {
        let removable = (0..terms.len()).filter(|place| stays[*place] && !always.contains(&terms[*place]));
        let left = removable.map(|out| (out, all.iter().map(|one| one.left_without(out)).sum::<f64>()));
        let best = left.min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((out, _)) = best.filter(|(_, left)| ratings.is_reached(*left)) else { break };
        stays[out] = false;
        all.iter_mut().for_each(|one| one.leave(out));
    }
    let kept: Vec<usize> = terms.iter().zip(&stays).filter(|(_, stays)| **stays).map(|(term, _)| *term).collect();
    // Computed again from the sums, to avoid the rounding errors of many removed terms.
    let of_one = |judge: &Judge<'_>| judge.rows.square(&kept, &fitted(&judge.fit, &kept).coefficients(&kept));
    let left = judges.iter().map(of_one).sum();
    (kept, left)
}
