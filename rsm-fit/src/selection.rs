//! Chooses the terms of a response, and estimates the error on rows that were not used for any choice.
//!
//! In: the design of all candidates, and rows. Out: the chosen terms with their rating; and the errors of cross-validation, in which the whole
//! procedure (including the choice of terms) is repeated without each part of the rows. A part never evaluates a choice for which it was used, and
//! rows of one group are never in two parts.
//!
//! Sources: Stone 1974, Cross-validatory choice and assessment (choosing and judging need rows of their own); Cawley, Talbot 2010,
//! On over-fitting in model selection; Breiman, Spector 1992 (five to ten parts).

use crate::dd::Dd;
use crate::dd::lanes::{self, Lanes};
use crate::design::Design;
use crate::design::eight::{Eight, Seen};
use crate::ladder::{Judge, Ladder, LadderModel, most_terms};
use crate::points::Groups;
use crate::qr::{Compressed, Dependent, Growing, Triangle, table};
use crate::random::Random;
use crate::spec::{Method, PARTS};
use crate::split;
use crate::statistics::{Judged, Observations};
use crate::threads;

/// Rows of one response.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sample {
    /// The values of every input of the surface.
    pub columns: Vec<Vec<f64>>,
    pub response: Vec<f64>,
    /// The weights, with a mean of 1; empty if all rows count equally.
    pub weights: Vec<f64>,
    /// Rows with the same number stay together.
    pub groups: Vec<usize>,
}

/// Weights scaled to a mean of 1, so that the residual standard deviation is that of a row with mean weight.
pub(crate) fn relative(weights: &[f64]) -> Vec<f64> {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter().map(|weight| weight / mean).collect()
}

impl Sample {
    pub(crate) fn rows(&self) -> usize {
        self.response.len()
    }

    pub(crate) fn observed<T>(&self, act: impl FnOnce(Observations<'_>) -> T) -> T {
        let columns: Vec<&[f64]> = self.columns.iter().map(Vec::as_slice).collect();
        act(Observations { inputs: &columns, response: &self.response, weights: &self.weights })
    }

    /// The rows for which the predicate is true.
    pub(crate) fn chosen(&self, is_chosen: impl Fn(usize) -> bool) -> Sample {
        self.some(&(0..self.rows()).filter(|row| is_chosen(*row)).collect::<Vec<usize>>())
    }

    /// Some of the rows.
    pub(crate) fn some(&self, rows: &[usize]) -> Sample {
        let of = |column: &Vec<f64>| rows.iter().filter_map(|row| column.get(*row).copied()).collect();
        Sample {
            columns: self.columns.iter().map(of).collect(),
            response: of(&self.response),
            weights: of(&self.weights),
            groups: rows.iter().map(|row| self.groups[*row]).collect(),
        }
    }

    /// The rows of both. Equal group numbers mean the same group.
    pub(crate) fn and(&self, other: &Sample) -> Sample {
        let both = |one: &Vec<f64>, other: &Vec<f64>| [&one[..], &other[..]].concat();
        Sample {
            columns: self.columns.iter().zip(&other.columns).map(|(one, other)| both(one, other)).collect(),
            response: both(&self.response, &other.response),
            weights: both(&self.weights, &other.weights),
            groups: [&self.groups[..], &other.groups[..]].concat(),
        }
    }

    /// One row for each group of replicates: the mean response, with the sum of the weights.
    pub(crate) fn by_replicates(&self) -> Sample {
        self.observed(|rows| {
            let groups = rows.replicates();
            let first: Vec<usize> = groups.iter().map(|group| group[0]).collect();
            Sample {
                columns: self.columns.iter().map(|column| first.iter().map(|row| column[*row]).collect()).collect(),
                response: groups.iter().map(|group| rows.mean(group).to_f64()).collect(),
                weights: groups.iter().map(|group| rows.weight_of(group).to_f64()).collect(),
                groups: first.iter().map(|row| self.groups[*row]).collect(),
            }
        })
    }

    pub(crate) fn mean(&self) -> Dd {
        self.observed(|rows| rows.mean_of(0..rows.response.len()))
    }

    /// The triangle of all terms and the response, as they were measured.
    pub(crate) fn to_fit(&self, design: &Design) -> Triangle {
        self.observed(|rows| {
            let rows_at = |terms: &mut Eight<'_>, first: usize, out: &mut [Lanes]| _ = rows_at(rows, terms, first, out);
            table::triangle(design.width() + 1, rows.response.len(), || Eight::new(design), rows_at)
        })
    }

    /// The same for a judge: one row for each group of replicates, with the mean response and the weight sqrt(n_i). `as_measured`: points as
    /// measured; otherwise as the evaluator sees them.
    pub(crate) fn to_judge(&self, design: &Design, as_measured: bool) -> Triangle {
        self.observed(|rows| {
            let row = |group: Vec<usize>| {
                let (point, weight) = (rows.point(group[0]), rows.weight_of(&group).sqrt());
                let terms = if as_measured { design.row_as_measured(&point) } else { design.row(&point) };
                terms.into_iter().chain([rows.mean(&group)]).map(|x| x * weight).collect::<Vec<Dd>>()
            };
            triangle(design, rows.replicates().into_iter().map(row))
        })
    }

    /// sum n_i (ybar_i - mean)^2.
    fn square_about(&self, mean: Dd) -> Dd {
        self.observed(|rows| {
            let of_one = |group: &Vec<usize>| {
                let gap = rows.mean(group) - mean;
                rows.weight_of(group) * gap * gap
            };
            rows.replicates().iter().map(of_one).sum()
        })
    }
}

/// Writes the terms and the response of some rows, times the roots of their weights, one row in each lane. Returns whether all terms are finite.
pub(crate) fn rows_at(rows: Observations<'_>, terms: &mut Eight<'_>, first: usize, out: &mut [Lanes]) -> bool {
    let (response, row) = out.split_last_mut().expect("the response is behind the terms");
    terms.write(rows.inputs, first, Seen::AsMeasured, row);
    let is_finite = lanes::are_finite(row);
    *response = rows.responses(first);
    if !rows.weights.is_empty() {
        let root = rows.weights(first).sqrt();
        out.iter_mut().for_each(|x| *x = x.mul(root));
    }
    is_finite
}

fn triangle(design: &Design, rows: impl Iterator<Item = Vec<Dd>>) -> Triangle {
    let mut compressed = Compressed::new(design.width() + 1);
    for row in rows {
        compressed.push(row);
    }
    compressed.finish()
}

/// The basis of the choice of terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChosenBy {
    /// The terms were given.
    Nobody,
    /// Validation rows.
    Validation,
    /// Cross-validation on the fitted rows.
    LeftOut {
        /// The number of parts.
        parts: usize,
    },
    /// The fitted rows themselves, because there are too few for cross-validation. The rating is then too good.
    FittedRows,
    /// A criterion on the fitted rows that corrects for the number of terms: AICc or PRESS.
    Formula(&'static str),
}

/// Terms with their rating.
pub(crate) struct Choice {
    pub terms: Vec<usize>,
    pub by: ChosenBy,
    /// C and C about the mean on the rows used for the choice; `None` if the terms were given.
    pub climb: Option<LadderModel>,
}

/// The number of parts for a large problem.
const FEWER_PARTS: usize = 5;

/// From this number of double-double multiplications of one climb, fewer parts are used: 56 climbs of 3 * 10^6 take two seconds.
const LARGE_WORK: f64 = 3e6;

/// Above this number the choice is not repeated without each part: 16 climbs of 2 * 10^8 take a minute.
const TOO_MUCH_WORK: f64 = 2e8;

/// Parts of some rows, each with its triangles.
struct Part {
    rows: Sample,
    fit: Triangle,
    judge: Triangle,
}

/// A response with the data for the choice of terms.
pub(crate) struct Selection<'a> {
    /// All candidates.
    pub design: &'a Design,
    pub method: &'a Method,
    pub output_range: Option<[f64; 2]>,
    pub fit: &'a Sample,
    /// The triangle of all rows of `fit`.
    pub triangle: &'a Triangle,
    /// Validation rows for the choice of a ladder.
    pub validate: Option<&'a Sample>,
    /// If the rows to fit and the validation rows were split from the same data: the share of the validation rows, and their weights.
    pub random_split: Option<(f64, &'a [f64])>,
}

/// A progress function: order, number of terms, C.
type OnProgress<'a> = &'a mut dyn FnMut(u32, usize, f64);

impl Selection<'_> {
    /// Chooses the terms.
    pub(crate) fn choose(&self, progress: OnProgress<'_>) -> Result<Choice, Dependent> {
        let Method::Ladder { .. } = self.method else {
            return Ok(Choice { terms: (0..self.design.width()).collect(), by: ChosenBy::Nobody, climb: None });
        };
        let (by, climb) = match self.validate {
            Some(validate) => (ChosenBy::Validation, self.climb(self.triangle, &self.judge(validate, false), progress)?),
            None => {
                let parts = self.parts(self.fit);
                let parts: Vec<&Part> = parts.iter().collect();
                match self.judge_of(&parts) {
                    Some(judge) => (ChosenBy::LeftOut { parts: parts.len() }, self.climb(self.triangle, &judge, progress)?),
                    None => (ChosenBy::FittedRows, self.climb(self.triangle, &self.judge(self.fit, true), progress)?),
                }
            }
        };
        Ok(Choice { terms: climb.chosen.clone(), by, climb: Some(climb) })
    }

    fn climb(&self, fit: &Triangle, judge: &Judge, progress: OnProgress<'_>) -> Result<LadderModel, Dependent> {
        let Method::Ladder { max_order, confidence } = *self.method else { panic!("only a ladder climbs") };
        let ladder = Ladder::new(fit, judge, self.design.terms(), max_order, confidence);
        ladder.with(self.design.always(), self.design.level()).climb(progress)
    }

    fn judge(&self, rows: &Sample, as_measured: bool) -> Judge {
        Judge::new(rows.to_judge(self.design, as_measured)).about_the_mean(rows.square_about(rows.mean()))
    }

    fn parts(&self, rows: &Sample) -> Vec<Part> {
        let wanted = if self.work() > LARGE_WORK { FEWER_PARTS } else { PARTS };
        let part_of = split::parts(&rows.groups, wanted, 1);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        let of_one = |part: usize| {
            let rows = rows.chosen(|row| part_of[row] == part);
            Part { fit: rows.to_fit(self.design), judge: rows.to_judge(self.design, true), rows }
        };
        (0..count).map(of_one).collect()
    }

    /// The multiplications of one climb: every step uses every entry. If there are more rows than columns, each part is a triangle.
    fn work(&self) -> f64 {
        let Method::Ladder { .. } = self.method else { return 0.0 };
        let width = self.design.width() as f64;
        let rows = (self.fit.rows() as f64).min(PARTS as f64 * width);
        width * rows * width.min(rows)
    }

    /// A judge that leaves out each part in turn; `None` if there are fewer than two parts.
    fn judge_of(&self, parts: &[&Part]) -> Option<Judge> {
        if parts.len() < 3 {
            return None;
        }
        let of_one = |out: usize| (without(parts, out), parts[out].judge.clone());
        let all = parts.iter().skip(1).fold(parts[0].rows.clone(), |all, part| all.and(&part.rows));
        Some(Judge::left_out((0..parts.len()).map(of_one).collect()).about_the_mean(all.square_about(all.mean())))
    }

    /// The largest number of terms of a ladder that fits these parts and leaves out each in turn.
    fn reach(parts: &[&Part]) -> usize {
        let rows = |part: &&Part| part.rows.rows();
        let all: usize = parts.iter().map(rows).sum();
        most_terms(all - parts.iter().map(rows).max().unwrap_or(0))
    }

    /// The errors on rows that were not used for the choice, and the number of parts. `None` if there are too few rows, if one part alone determines
    /// some term, or if it is too much work. There are too few rows if without a part a ladder cannot choose as many terms as were chosen.
    pub(crate) fn cross_validated(&self, chosen: usize) -> Option<(Judged, usize)> {
        if self.work() > TOO_MUCH_WORK {
            return None;
        }
        let quiet = &mut |_: u32, _: usize, _: f64| {};
        let is_ladder = matches!(self.method, Method::Ladder { .. });
        match (self.validate, self.random_split) {
            // The rows to fit are the same in each round, as for the model. A part of the validation rows evaluates.
            (Some(validate), None) if is_ladder => {
                let part_of = split::parts(&validate.groups, PARTS, 1);
                let count = part_of.iter().max().map_or(0, |most| most + 1);
                let round = |part: usize| {
                    let choosing = validate.chosen(|row| part_of[row] != part);
                    let terms = self.climb(self.triangle, &self.judge(&choosing, false), quiet).ok()?.chosen;
                    self.judged(self.triangle, &terms, &validate.chosen(|row| part_of[row] == part), self.fit.mean())
                };
                sum((0..count).map(round), count)
            }
            // Rows to fit and validation rows come from the same data, so the split is repeated with the remaining rows.
            (Some(validate), Some((share, weights))) if is_ladder => {
                // The group numbers of the two are separate.
                let groups = validate.groups.iter().map(|group| group + self.fit.rows()).collect();
                let all = self.fit.and(&Sample { weights: weights.to_vec(), groups, ..validate.clone() });
                let part_of = split::parts(&all.groups, PARTS, 1);
                let count = part_of.iter().max().map_or(0, |most| most + 1);
                let round = |part: usize| {
                    let rest = all.chosen(|row| part_of[row] != part);
                    let is_aside = held_out(&rest.groups, share, part as u64 + 2);
                    let (fit, choosing) = (rest.chosen(|row| !is_aside[row]), rest.chosen(|row| is_aside[row]));
                    let choosing = Sample { weights: Vec::new(), ..choosing };
                    if fit.rows() < 2 || choosing.rows() == 0 || most_terms(fit.rows()) < chosen {
                        return None;
                    }
                    let triangle = fit.to_fit(self.design);
                    let terms = self.climb(&triangle, &self.judge(&choosing, false), quiet).ok()?.chosen;
                    self.judged(&triangle, &terms, &all.chosen(|row| part_of[row] == part), fit.mean())
                };
                sum((0..count).map(round), count)
            }
            _ => {
                if !is_ladder {
                    return self.given_left_out();
                }
                let parts = self.parts(self.fit);
                let count = parts.len();
                let round = |out: usize| {
                    let rest: Vec<&Part> = (0..count).filter(|k| *k != out).map(|k| &parts[k]).collect();
                    let all: Vec<&Triangle> = rest.iter().map(|part| &part.fit).collect();
                    let triangle = Triangle::stacked(&all);
                    if Self::reach(&rest) < chosen {
                        return None;
                    }
                    let terms = self.climb(&triangle, &self.judge_of(&rest)?, quiet).ok()?.chosen;
                    let others = rest.iter().skip(1).fold(rest[0].rows.clone(), |all, part| all.and(&part.rows));
                    self.judged(&triangle, &terms, &parts[out].rows, others.mean())
                };
                if count < 2 { None } else { sum((0..count).map(round), count) }
            }
        }
    }

    /// The errors on parts of the rows that are left out in turn, if the terms are given.
    fn given_left_out(&self) -> Option<(Judged, usize)> {
        let part_of = split::parts(&self.fit.groups, PARTS, 1);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        if count < 2 {
            return None;
        }
        let parts = Groups::of_numbers(&part_of, count);
        let rows_of = |part: usize| self.fit.some(parts.get(part));
        let triangles = threads::all(count, self.fit.rows() / count, |part| rows_of(part).to_fit(self.design));
        let terms: Vec<usize> = (0..self.design.width()).collect();
        let round = |out: usize| {
            let rest = || (0..count).filter(|part| *part != out);
            let triangle = Triangle::stacked(&rest().map(|part| &triangles[part]).collect::<Vec<&Triangle>>());
            let mean = self.fit.observed(|rows| rows.mean_of(rest().flat_map(|part| parts.get(part)).copied()));
            self.judged(&triangle, &terms, &rows_of(out), mean)
        };
        sum(threads::all(count, self.fit.rows() / count, round).into_iter(), count)
    }

    /// The errors on some rows of these terms, fitted to other rows.
    fn judged(&self, fit: &Triangle, terms: &[usize], rows: &Sample, mean: Dd) -> Option<Judged> {
        let coefficients: Vec<f64> = Growing::of(fit, terms).ok()?.coefficients().into_iter().map(Dd::to_f64).collect();
        let design = self.design.only(terms);
        Some(rows.observed(|rows| {
            Judged::of(&design, &coefficients, self.output_range, Observations { weights: &[], ..rows }, mean)
        }))
    }
}

fn without(parts: &[&Part], out: usize) -> Triangle {
    let rest: Vec<&Triangle> = (0..parts.len()).filter(|k| *k != out).map(|k| &parts[k].fit).collect();
    Triangle::stacked(&rest)
}

fn sum(rounds: impl Iterator<Item = Option<Judged>>, count: usize) -> Option<(Judged, usize)> {
    let mut all = Judged::NOTHING;
    for judged in rounds {
        all = all.and(judged?);
    }
    Some((all, count))
}

/// Marks the rows to set aside: groups in random order until the share is reached.
pub(crate) fn held_out(groups: &[usize], share: f64, seed: u64) -> Vec<bool> {
    let mut order: Vec<usize> = groups.to_vec();
    order.sort_unstable();
    order.dedup();
    Random::new(seed).shuffle(&mut order);
    let wanted = (share * groups.len() as f64).round() as usize;
    let mut is_aside = vec![false; groups.len()];
    let mut count = 0;
    for group in order {
        if count >= wanted {
            break;
        }
        for (row, other) in groups.iter().enumerate() {
            if *other == group {
                is_aside[row] = true;
                count += 1;
            }
        }
    }
    is_aside
}
