//! The fit of a response with a robust loss.
//!
//! In: the rows of a response. Out: its outcome. Terms are given, or searched on rows whose weights bound the influence of wrong rows; then the loss
//! is minimised on them. Figures that are defined for squared errors only do not exist, and a sentence says so.

use rsm_core::model::Surface;
use rsm_core::source::Faults;

use super::{Quality, Task, terms_of};
use crate::dd::Dd;
use crate::design::{Design, order};
use crate::distributions::two_sided_t;
use crate::left_out;
use crate::outcome::ResponseOutcome;
use crate::qr::Dependent;
use crate::robust::{self, LossReport, Robust};
use crate::search::{Found, Searcher};
use crate::selection::{Choice, ChosenBy, Sample};
use crate::spec::{Method, PARTS};
use crate::split;
use crate::statistics::{self, CrossValidation, Judged, ResponseStatistics, SelectionReport, TermStatistics, Warning};
use crate::verdict::Verdict;
use crate::warnings::{self, Notes};

/// The limit of rows times terms squared for cross-validation: ten fits of about fifty steps, 10^9 double-double multiplications, take about ten
/// seconds.
const WORK: f64 = 2e6;

/// The largest number of turns between weights and terms. Most choices settle in the third one.
const MOST_TURNS: usize = 6;

/// The first weights are those of the model of the highest order with at least this number of rows for each term: with fewer, wrong rows hide in it.
const ROWS_FOR_A_TERM: usize = 3;

/// An error beyond this number of scales is far: 0.7 % of normal errors are, as many as the report lists (`robust/report.rs`).
const FAR: f64 = 2.7;

/// The least weight of a row in a search: where the scale is 0, most rows lie on the surface, and a wrong one hardly counts.
const LEAST_WEIGHT: f64 = 1e-12;

/// The terms of a robust fit.
struct Chosen {
    /// The terms, by their places among the candidates.
    terms: Vec<usize>,
    by: ChosenBy,
    report: Option<SelectionReport>,
    robust: Robust,
}

/// Why there are none.
enum NotChosen {
    Dependent(Dependent),
    TooFew,
}

impl Task<'_> {
    /// Fits the terms of the design, or those of them that the method chooses, with the loss of the response.
    pub(super) fn run_robust(&self, surface: &mut Surface, all: &Design) -> Result<ResponseOutcome, Faults> {
        let loss = self.response.loss;
        let chosen = match self.robust_choice(surface, all, &self.fit) {
            Ok(chosen) => chosen,
            Err(NotChosen::Dependent(dependent)) => return Ok(self.ill_conditioned(all, &dependent)),
            Err(NotChosen::TooFew) => {
                let what =
                    format!("response `{}`: there are too few rows, or too few groups of rows, to choose terms", surface.name);
                return Err(Faults::one(self.fault(what).help("measure more points, or give terms with method \"fixed\"")));
            }
        };
        let (design, found, by) = (&all.only(&chosen.terms), &chosen.robust, chosen.by);
        let mut statistics = self.with_apart(surface, design, self.robust_figures(design, found));
        surface.terms = terms_of(&statistics);
        self.add_shape(surface, &mut statistics);
        statistics.blocks = self.blocks_of(&surface.terms, None);
        let is_judged = self.test.is_some() || self.validate.is_some();
        let cross_validated = if is_judged { None } else { self.robust_left_out(surface, all) };
        statistics.cross_validation.clone_from(&cross_validated);
        let choice = Choice { terms: chosen.terms.clone(), by, climb: None };
        let quality = Quality { is_held: false, explained: None, centred: None, cross_validated };
        statistics.rows_used = quality.words(self, &choice, false);
        if by != ChosenBy::Nobody {
            statistics.rows_used.terms += ", with the weights of a robust fit";
        }
        let report = self.fit.observed(|rows| LossReport::of(found, loss, rows, &surface.inputs));
        let notes = Notes {
            is_shrunk: true,
            free_residual_sd: Some(found.scale),
            highest_order: 0,
            ..self.notes(surface, [design, design], &statistics, &quality)
        };
        let mut warnings = notes.all().warnings;
        let mut warn = |kind, what: Option<String>| warnings.extend(what.map(|what| Warning { kind, what }));
        let rows = |outliers| format!("{} of {} rows: {outliers}", report.low_weight.len(), self.fit.rows());
        warn("low-weight", report.outliers().map(rows));
        let steps = || {
            format!("the fit with loss \"{}\" has not settled after {} steps: do not use it", report.loss, report.iterations)
        };
        warn("loss-not-settled", (!report.converged).then(steps));
        if by != ChosenBy::Nobody && !is_judged && statistics.cross_validation.is_none() {
            warnings.push(warnings::not_judged(&statistics.rows_used));
        }
        warnings.extend(left_out::warning(self.left_out));
        statistics.warnings = warnings;
        statistics.loss = Some(report);
        statistics.selection = chosen.report;
        let rows_outside = self.rows_outside(design);
        let name = surface.name.clone();
        Ok(ResponseOutcome { name, verdict: Verdict::Fitted, rows_outside, statistics: Some(statistics), chosen_by: by })
    }

    /// The terms of some rows, with their fit. A search is made on rows whose weights are those of a robust fit of the terms before, until terms and
    /// weights agree; the first ones are those of the largest model.
    fn robust_choice(&self, surface: &Surface, all: &Design, rows: &Sample) -> Result<Chosen, NotChosen> {
        let loss = self.response.loss;
        let robust = |terms: &[usize]| {
            let found = rows.observed(|rows| robust::fit(&all.only(terms), rows, loss));
            found.map_err(|dependent| {
                let candidates = dependent.candidates.iter().map(|k| terms[*k]).collect();
                NotChosen::Dependent(Dependent { candidates, ..dependent })
            })
        };
        let Method::Search(_) = self.response.method else {
            let terms: Vec<usize> = (0..all.width()).collect();
            let robust = robust(&terms)?;
            return Ok(Chosen { terms, by: ChosenBy::Nobody, report: None, robust });
        };
        let up_to = |highest: u32| (0..all.width()).filter(|k| order(&all.terms()[*k]) <= highest).collect::<Vec<usize>>();
        let highest = all.terms().iter().map(|powers| order(powers)).max().unwrap_or(0);
        let is_small = |terms: &Vec<usize>| !terms.is_empty() && ROWS_FOR_A_TERM * terms.len() <= rows.rows();
        let starts = (0..=highest).rev().map(up_to).filter(is_small);
        let mut now = starts.map(|terms| robust(&terms)).find_map(Result::ok).ok_or(NotChosen::TooFew)?;
        let mut chosen: Option<(Found, Vec<usize>)> = None;
        for _ in 0..MOST_TURNS {
            let weighted = Sample { weights: weighted(rows, &now), ..rows.clone() };
            let searcher =
                Searcher { least_squares_only: true, ..Searcher::of(all, &self.response.method, surface, &weighted) };
            let found = searcher.choose().ok_or(NotChosen::TooFew)?;
            now = robust(&found.terms)?;
            let terms = found.terms.clone();
            let has_settled = chosen.as_ref().is_some_and(|(_, before)| *before == terms);
            chosen = Some((found, terms));
            if has_settled {
                break;
            }
        }
        let (found, terms) = chosen.ok_or(NotChosen::TooFew)?;
        Ok(Chosen { terms, by: found.by, report: found.report, robust: now })
    }

    /// The figures of the coefficients. Those of squared errors are withheld.
    fn robust_figures(&self, design: &Design, found: &Robust) -> ResponseStatistics {
        let coefficients: Vec<f64> = found.coefficients.iter().map(|coefficient| coefficient.to_f64()).collect();
        let all = self.fit.observed(|rows| statistics::of_constrained(design, &coefficients, rows));
        let freedom = self.fit.rows() as f64 - coefficients.len() as f64;
        let tested = |(place, term): (usize, TermStatistics)| {
            let error = found.standard_errors.get(place).copied();
            let t = error.filter(|error| *error > 0.0).map(|error| term.coefficient / error);
            TermStatistics { standard_error: error, t, p: t.and_then(|t| two_sided_t(t, freedom)), ..term }
        };
        ResponseStatistics {
            terms: all.terms.into_iter().enumerate().map(tested).collect(),
            residual_sd: None,
            r2: None,
            r2_adjusted: None,
            transform: None,
            confidence_c: None,
            lack_of_fit: None,
            ..all
        }
    }

    /// Errors on fitted rows that are left out in turn, with the same loss and the choice of terms without them.
    fn robust_left_out(&self, surface: &Surface, all: &Design) -> Option<CrossValidation> {
        let (rows, width) = (self.fit.rows() as f64, all.width());
        if rows * (width * width) as f64 > WORK {
            return None;
        }
        let part_of = split::parts(&self.fit.groups, PARTS, 1);
        let parts = part_of.iter().max().map_or(0, |most| most + 1);
        let mut judged = Judged::NOTHING;
        for part in 0..parts {
            let rest = self.fit.chosen(|row| part_of[row] != part);
            if matches!(self.response.method, Method::Fixed(_) | Method::FixedOrder(_)) && rest.rows() < width {
                return None;
            }
            let found = self.robust_choice(surface, all, &rest).ok()?;
            let coefficients: Vec<f64> = found.robust.coefficients.into_iter().map(Dd::to_f64).collect();
            let design = all.only(&found.terms);
            let out = self.fit.chosen(|row| part_of[row] == part);
            judged =
                judged.and(out.observed(|rows| Judged::of(&design, &coefficients, surface.output_range, rows, rest.mean())));
        }
        Some(CrossValidation { errors: judged.statistics()?, parts, r2: None })
    }
}

/// The weights of rows for a search, with a mean of 1: those of the rows, times 1 up to [`FAR`] scales and (FAR scales/error)^4 beyond. Normal errors
/// keep their weights, so the choice on clean rows is that of least squares; the square of a weighted error falls beyond the limit, so that a wrong
/// row counts little in every sum of squares.
fn weighted(rows: &Sample, found: &Robust) -> Vec<f64> {
    let own = |row: usize| rows.weights.get(row).copied().unwrap_or(1.0);
    let limit = FAR * found.scale;
    let of_error = |error: f64| if error <= limit { 1.0 } else { (limit / error).powi(4).max(LEAST_WEIGHT) };
    let weights: Vec<f64> = (0..rows.rows()).map(|row| own(row) * of_error(found.errors[row].abs())).collect();
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter().map(|weight| weight / mean).collect()
}
