//! Chooses terms by stepwise selection, best subsets or the LASSO, and repeats the whole choice for cross-validation.
//!
//! In: a design of all candidates, and rows. Out: the chosen terms, with coefficients if these are shrunken; and the errors on rows that were not
//! used for the choice. Large ladders are climbed here too, with sums of products in f64 ([`gram`]): a choice among 495 terms takes a second, in
//! double-double minutes. A row never evaluates a choice for which it was used.

mod gram;
mod ladder;
mod lasso;
mod paths;
mod rating;

use rsm_core::model::{Coding, Surface};

use crate::dd::Dd;
use crate::design::{Design, order};
use crate::ladder::most_terms;
use crate::qr::{Growing, Triangle};
use crate::selection::{ChosenBy, Sample, held_out};
use crate::spec::{Criterion, Method, PARTS, Search, SearchBy};
use crate::split;
use crate::statistics::{Judged, Observations, SelectionReport};
use crate::threads;
use gram::{Gram, Scales};
use lasso::{Lasso, SHARES};
use paths::{Heredity, Model, Path, Steps};

/// From this number of multiplications of all paths of a nested search, five parts are used: 3 * 10^9 take about two seconds.
const LARGE_WORK: f64 = 3e9;
const FEWER_PARTS: usize = 5;

/// The largest number of nodes of a search for best subsets: a second with 40 candidates.
const NODES: usize = 20_000;

/// Up to this number of double-double multiplications, a round of cross-validation is solved in double-double, otherwise in f64.
const EXACT_WORK: f64 = 2e7;

/// The result of a search.
pub(crate) struct Found {
    /// The terms, in the order of the candidates.
    pub terms: Vec<usize>,
    /// The coefficients, if they are not those of least squares.
    pub shrunk: Option<Vec<f64>>,
    /// The coefficients from f64 sums, for a large problem.
    coefficients: Vec<f64>,
    pub by: ChosenBy,
    pub report: Option<SelectionReport>,
    /// C and C about the mean, for a ladder.
    pub climb: Option<(f64, Option<f64>)>,
}

/// Rows that are left out together.
struct Part {
    rows: Sample,
    gram: Gram,
    /// Groups of replicates by their means, for the C of a ladder.
    judge: Option<Gram>,
    /// Scaled rows, for PRESS.
    scaled: Vec<Vec<f64>>,
}

/// A response with the data of the search.
pub(crate) struct Searcher<'a> {
    pub design: &'a Design,
    pub method: &'a Method,
    pub coding: Coding,
    pub output_range: Option<[f64; 2]>,
    /// Coefficients with constraints cannot be shrunken as well.
    pub least_squares_only: bool,
    pub fit: &'a Sample,
    pub validate: Option<&'a Sample>,
    /// If the rows to fit and the validation rows were split from the same data: the share of the validation rows, and their weights.
    pub random_split: Option<(f64, &'a [f64])>,
}

impl<'a> Searcher<'a> {
    /// A search on rows, without validation rows.
    pub(crate) fn of(design: &'a Design, method: &'a Method, surface: &Surface, fit: &'a Sample) -> Self {
        let (coding, output_range) = (surface.coding, surface.output_range);
        Searcher { design, method, coding, output_range, least_squares_only: false, fit, validate: None, random_split: None }
    }
}

impl Searcher<'_> {
    /// Whether this method is handled here: every search, and a ladder that would take minutes in double-double.
    pub(crate) fn is_for(method: &Method, width: usize, rows: usize) -> bool {
        match method {
            Method::Search(_) => true,
            Method::Ladder { .. } => ladder::is_large(width, rows),
            _ => false,
        }
    }

    fn search(&self) -> Option<&Search> {
        if let Method::Search(search) = self.method { Some(search) } else { None }
    }

    fn criterion(&self) -> Criterion {
        let by_rows = if self.validate.is_some() { Criterion::HeldOut } else { Criterion::KFold };
        self.search().and_then(|search| search.criterion).unwrap_or(by_rows)
    }

    fn constant(&self) -> Option<usize> {
        self.design.terms().iter().position(|powers| order(powers) == 0)
    }

    /// The terms of every model.
    fn always(&self) -> Vec<usize> {
        self.design.always()
    }

    fn wanted_parts(&self) -> usize {
        let wanted = self.search().map_or(PARTS, |search| search.parts);
        let width = self.design.width() as f64;
        let paths = ((wanted + 1) * (wanted + 1)) as f64;
        let work = width * width * width.min(self.fit.rows() as f64) * paths;
        if work > LARGE_WORK { wanted.min(FEWER_PARTS) } else { wanted }
    }

    /// Chooses the terms; `None` if there are too few rows for a choice.
    pub(crate) fn choose(&self) -> Option<Found> {
        let scales = self.scales();
        let parts = self.parts(&scales, self.fit, self.wanted_parts(), true);
        let parts: Vec<&Part> = parts.iter().collect();
        let held = match (self.criterion(), self.validate) {
            (Criterion::HeldOut, Some(validate)) => Some(self.parts(&scales, validate, PARTS, false)),
            _ => None,
        };
        let held: Option<Vec<&Part>> = held.as_ref().map(|parts| parts.iter().collect());
        self.found(&scales, &parts, held.as_deref())
    }

    /// The same choice by AICc from the triangle of all candidates, without rows; `None` if there are too few rows for a choice. `fit` is not used.
    pub(crate) fn choose_by_triangle(&self, triangle: &Triangle) -> Option<Found> {
        let scales = Scales::of_triangle(triangle, self.constant());
        let gram = Gram::of_triangle(triangle, &scales);
        let whole = Part { rows: Sample::default(), gram, judge: None, scaled: Vec::new() };
        self.found(&scales, &[&whole], None)
    }

    fn scales(&self) -> Scales {
        Scales::of(self.design, self.fit, self.constant())
    }

    /// `as_measured`: rows to fit; otherwise rows as an evaluator sees them.
    fn parts(&self, scales: &Scales, rows: &Sample, wanted: usize, as_measured: bool) -> Vec<Part> {
        let part_of = split::parts(&rows.groups, wanted, 1);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        let of_one = |part: usize| self.part(scales, rows.chosen(|row| part_of[row] == part), as_measured);
        (0..count).map(of_one).collect()
    }

    fn part(&self, scales: &Scales, rows: Sample, as_measured: bool) -> Part {
        let is_ladder = self.search().is_none();
        let judge = is_ladder.then(|| Gram::of(self.design, &rows.by_replicates(), scales, as_measured));
        let scaled = match self.criterion() {
            Criterion::Press => gram::scaled_rows(self.design, &rows, scales),
            _ => Vec::new(),
        };
        Part { gram: Gram::of(self.design, &rows, scales, as_measured), rows, judge, scaled }
    }

    /// The choice with these parts of the rows to fit, and with parts that are held out.
    fn found(&self, scales: &Scales, parts: &[&Part], held: Option<&[&Part]>) -> Option<Found> {
        let total = self.sum(parts, None);
        let Some(search) = self.search() else { return self.climbed(scales, &total, parts, held) };
        let criterion = self.criterion();
        let least_rows = match criterion {
            Criterion::KFold => total.rows - parts.iter().map(|part| part.gram.rows).max()?,
            _ => total.rows,
        };
        let most = match criterion {
            // A residual needs one row more than terms, and AICc two.
            Criterion::Aicc => least_rows.saturating_sub(3).max(1),
            Criterion::Press => rating::most_for_press(total.rows).min(most_terms(total.rows)),
            _ => most_terms(least_rows),
        };
        let paths = Paths::of(self, search, scales, &total, most.min(self.design.width()));
        let (full, proved) = paths.path(&total);
        let square = total.at(total.width - 1, total.width - 1);
        let mut ratings = match (criterion, held) {
            (Criterion::KFold, _) => {
                if parts.len() < 3 {
                    return None;
                }
                let of_one = |out: usize| {
                    let (path, _) = paths.path(&self.sum(parts, Some(out)));
                    rating::errors(&path, &parts[out].gram)
                };
                rating::by_parts(&(0..parts.len()).map(of_one).collect::<Vec<_>>(), &full, square)
            }
            (Criterion::HeldOut, Some(held)) => {
                rating::by_parts(&held.iter().map(|part| rating::errors(&full, &part.gram)).collect::<Vec<_>>(), &full, square)
            }
            (Criterion::HeldOut, None) => return None,
            (Criterion::Aicc, _) => rating::by_aicc(&full, &total),
            (Criterion::Press, _) => {
                let rows: Vec<&Vec<f64>> = parts.iter().flat_map(|part| &part.scaled).collect();
                rating::by_press(&full, &total, &rows)
            }
        };
        if self.least_squares_only && matches!(search.by, SearchBy::Lasso) {
            for (rating, model) in ratings.iter_mut().zip(&full) {
                *rating = rating.take().filter(|_| model.as_ref().is_some_and(|model| !model.is_shrunk));
            }
        }
        let key = rating::chosen(&ratings, &full, search.one_standard_error)?;
        let model = full[key].clone().expect("a rated key has a model");
        let by = match (criterion, held) {
            (Criterion::HeldOut, _) => ChosenBy::Validation,
            (Criterion::KFold, _) => ChosenBy::LeftOut { parts: parts.len() },
            (Criterion::Aicc, _) => ChosenBy::Formula("AICc"),
            (Criterion::Press, _) => ChosenBy::Formula("PRESS"),
        };
        let is_lasso = matches!(search.by, SearchBy::Lasso);
        let report = SelectionReport {
            method: search.by.word(),
            criterion: criterion.word(),
            heredity: search.heredity,
            one_standard_error: search.one_standard_error,
            candidates: self.design.width(),
            proved: proved.filter(|_| matches!(search.by, SearchBy::BestSubset)),
            shrinkage: is_lasso.then(|| if model.is_shrunk { SHARES[key % SHARES.len()] } else { 0.0 }),
            path: rating::by_size(&ratings, &full, criterion, scales.scales[self.design.width()]),
        };
        Some(self.as_found(scales, &model, by, Some(report)))
    }

    fn as_found(&self, scales: &Scales, model: &Model, by: ChosenBy, report: Option<SelectionReport>) -> Found {
        let coefficients = scales.natural(&model.terms, &model.coefficients);
        // Terms with a LASSO coefficient of 0 are removed; those of every model stay.
        let always = self.always();
        let is_kept = |k: &usize| !model.is_shrunk || coefficients[*k] != 0.0 || always.contains(&model.terms[*k]);
        let kept: Vec<usize> = (0..model.terms.len()).filter(is_kept).collect();
        let terms: Vec<usize> = kept.iter().map(|k| model.terms[*k]).collect();
        let coefficients: Vec<f64> = kept.iter().map(|k| coefficients[*k]).collect();
        let shrunk = model.is_shrunk.then(|| coefficients.clone());
        Found { terms, shrunk, coefficients, by, report, climb: None }
    }

    fn sum(&self, parts: &[&Part], without: Option<usize>) -> Gram {
        let rest = parts.iter().enumerate().filter(|(k, _)| Some(*k) != without);
        rest.fold(Gram::nothing(self.design.width() + 1), |sum, (_, part)| sum.and(&part.gram))
    }

    /// The errors on rows that were not used for the choice, and the number of parts. `None` if there are too few rows.
    pub(crate) fn cross_validated(&self, chosen: usize) -> Option<(Judged, usize)> {
        let scales = self.scales();
        match (self.criterion(), self.validate, self.random_split) {
            // The rows to fit are the same in each round, as for the model. A part of the validation rows evaluates.
            (Criterion::HeldOut, Some(validate), None) => {
                let whole = self.part(&scales, self.fit.clone(), true);
                let held = self.parts(&scales, validate, PARTS, false);
                let round = |out: usize| {
                    let choosing: Vec<&Part> = (0..held.len()).filter(|k| *k != out).map(|k| &held[k]).collect();
                    let found = self.found(&scales, &[&whole], Some(&choosing))?;
                    self.judged(&found, &[&whole], &held[out].rows)
                };
                rounds(held.len(), round)
            }
            // Rows to fit and validation rows come from the same data, so the split is repeated with the remaining rows.
            (Criterion::HeldOut, Some(validate), Some((share, weights))) => {
                let groups = validate.groups.iter().map(|group| group + self.fit.rows()).collect();
                let all = self.fit.and(&Sample { weights: weights.to_vec(), groups, ..validate.clone() });
                let part_of = split::parts(&all.groups, PARTS, 1);
                let count = part_of.iter().max().map_or(0, |most| most + 1);
                let round = |part: usize| {
                    let rest = all.chosen(|row| part_of[row] != part);
                    let is_aside = held_out(&rest.groups, share, part as u64 + 2);
                    let choosing = Sample { weights: Vec::new(), ..rest.chosen(|row| is_aside[row]) };
                    let fit = rest.chosen(|row| !is_aside[row]);
                    if fit.rows() < 2 || choosing.rows() == 0 {
                        return None;
                    }
                    let (fit, held) = (self.part(&scales, fit, true), self.parts(&scales, &choosing, PARTS, false));
                    let held: Vec<&Part> = held.iter().collect();
                    let found = self.found(&scales, &[&fit], Some(&held))?;
                    self.judged(&found, &[&fit], &all.chosen(|row| part_of[row] == part))
                };
                rounds(count, round)
            }
            _ => {
                let parts = self.parts(&scales, self.fit, self.wanted_parts(), true);
                let round = |out: usize| {
                    let rest: Vec<&Part> = (0..parts.len()).filter(|k| *k != out).map(|k| &parts[k]).collect();
                    let found = self.found(&scales, &rest, None)?;
                    // With fewer rows than terms the model would be a different one.
                    let rows: usize = rest.iter().map(|part| part.gram.rows).sum();
                    if found.shrunk.is_none() && most_terms(rows) < chosen {
                        return None;
                    }
                    self.judged(&found, &rest, &parts[out].rows)
                };
                rounds(parts.len(), round)
            }
        }
    }

    /// The errors on some rows of a result from other rows.
    fn judged(&self, found: &Found, fitted: &[&Part], rows: &Sample) -> Option<Judged> {
        let design = self.design.only(&found.terms);
        let all = fitted.iter().skip(1).fold(fitted.first()?.rows.clone(), |all, part| all.and(&part.rows));
        let work = all.rows() as f64 * (found.terms.len() as f64).powi(2);
        let coefficients = match &found.shrunk {
            None if work <= EXACT_WORK => {
                let terms: Vec<usize> = (0..design.width()).collect();
                let solved = Growing::of(&all.to_fit(&design), &terms).ok()?;
                solved.coefficients().into_iter().map(Dd::to_f64).collect()
            }
            _ => found.coefficients.clone(),
        };
        let mean = all.mean();
        Some(rows.observed(|rows| {
            Judged::of(&design, &coefficients, self.output_range, Observations { weights: &[], ..rows }, mean)
        }))
    }
}

/// The sum of all rounds in their order, run on all available threads; `None` if any round fails.
fn rounds(count: usize, round: impl Fn(usize) -> Option<Judged> + Sync) -> Option<(Judged, usize)> {
    if count < 2 {
        return None;
    }
    let mut sum = Some(Judged::NOTHING);
    threads::in_order(count, round, |judged| sum = sum.take().and_then(|sum| Some(sum.and(judged?))));
    sum.map(|sum| (sum, count))
}

/// The methods that make a path of models from rows.
struct Paths {
    by: SearchBy,
    always: Vec<usize>,
    heredity: Heredity,
    is_hereditary: bool,
    units: Vec<f64>,
    penalties: Vec<f64>,
    most: usize,
}

impl Paths {
    fn of(searcher: &Searcher<'_>, search: &Search, scales: &Scales, total: &Gram, most: usize) -> Self {
        let always = searcher.always();
        let width = searcher.design.width();
        let units: Vec<f64> = match searcher.coding {
            Coding::Range => scales.scales[..width].to_vec(),
            Coding::None => vec![1.0; width],
        };
        let penalties = match search.by {
            SearchBy::Lasso => lasso::penalties(total, &always, &units),
            _ => Vec::new(),
        };
        let heredity = Heredity::of(searcher.design.terms(), search.heredity);
        let (by, is_hereditary) = (search.by, search.heredity);
        Paths { by, always, heredity, is_hereditary, units, penalties, most }
    }

    /// The path, and whether best subsets are proved.
    fn path(&self, gram: &Gram) -> (Path, Option<bool>) {
        let steps = Steps { always: &self.always, heredity: &self.heredity, most: self.most };
        match self.by {
            SearchBy::Stepwise(direction) => (steps.by_steps(gram, direction), None),
            SearchBy::BestSubset => {
                let (path, proved) = steps.best_subsets(gram, NODES);
                (path, Some(proved))
            }
            SearchBy::Lasso => {
                let heredity = self.is_hereditary.then_some(&self.heredity);
                let (units, penalties) = (&self.units[..], &self.penalties[..]);
                (Lasso { always: &self.always, units, penalties, most: self.most, heredity }.path(gram), None)
            }
        }
    }
}
