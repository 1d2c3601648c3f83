//! The fit of a response with autoregressive errors.
//!
//! In: the rows of a response, in series. Out: its outcome. Terms are given, or chosen by AICc of whitened rows, in turns with the noise. Figures
//! that need independent rows do not exist; errors on new rows are those of whole series, or of blocks of consecutive rows.

use rsm_core::model::Surface;
use rsm_core::source::Faults;

use super::{Quality, Task, terms_of};
use crate::autoregressive::{self, Estimate, NoiseReport, autocovariances, least_rows};
use crate::dd::Dd;
use crate::design::Design;
use crate::distributions::{quantile_t, two_sided_t};
use crate::left_out;
use crate::outcome::ResponseOutcome;
use crate::qr::{Dependent, Growing};
use crate::search::Searcher;
use crate::selection::{Choice, ChosenBy, Sample};
use crate::sequence::Sequence;
use crate::spec::{Method, NoiseOrder, PARTS};
use crate::split;
use crate::statistics::{self, Judged, ResponseStatistics, SelectionReport, TermStatistics, Warning};
use crate::warnings::{self, Noted, Notes};

/// The limit of rows times terms squared for cross-validation: ten estimates of the noise of some ten likelihoods each, and ten reductions in
/// double-double, take about ten seconds.
const WORK: f64 = 5e6;

/// The largest number of turns between the choice of terms and the noise. Most choices settle in the second one.
const MOST_TURNS: usize = 8;

/// Terms with noise.
struct Solved {
    /// The terms, by their places among the candidates.
    terms: Vec<usize>,
    estimate: Estimate,
    growing: Growing,
    report: Option<SelectionReport>,
}

impl Solved {
    fn freedom(&self, rows: usize) -> usize {
        rows.saturating_sub(self.terms.len()).max(1)
    }

    /// The residual mean square of whitened rows.
    fn mean_square(&self, rows: usize) -> f64 {
        (self.growing.residual_square() / Dd::from(self.freedom(rows) as f64)).to_f64()
    }
}

/// Why there is none.
enum Unsolved {
    Dependent(Dependent),
    TooFew,
}

impl Task<'_> {
    pub(super) fn run_autoregressive(
        &self,
        surface: &mut Surface,
        all: &Design,
        order: NoiseOrder,
    ) -> Result<ResponseOutcome, Faults> {
        let given = if let NoiseOrder::Given(order) = order { order } else { 0 };
        let terms = if matches!(self.response.method, Method::Search(_)) { 1 } else { all.width() };
        let least = least_rows(terms, given);
        if self.fit.rows() < least {
            let rows = self.fit.rows();
            let what = format!(
                "response `{}`: found {rows} rows to fit, {terms} terms with autoregressive errors need at least {least}",
                surface.name
            );
            return Err(Faults::one(self.fault(what).help("fit fewer terms, or take the errors as independent")));
        }
        let solved = match self.solve(surface, all, &self.fit, self.sequence, order, None) {
            Ok(solved) => solved,
            Err(Unsolved::Dependent(dependent)) => return Ok(self.ill_conditioned(all, &dependent)),
            Err(Unsolved::TooFew) => {
                let what = format!("response `{}`: there are too few rows to choose terms", surface.name);
                return Err(Faults::one(self.fault(what).help("measure more points, or give terms with method \"fixed\"")));
            }
        };
        let design = all.only(&solved.terms);
        let by = solved.report.as_ref().map_or(ChosenBy::Nobody, |_| ChosenBy::Formula("AICc"));
        let (figures, noise) = self.noise_figures(&design, &solved);
        let mut statistics = self.with_apart(surface, &design, figures);
        surface.terms = terms_of(&statistics);
        self.add_shape(surface, &mut statistics);
        statistics.blocks = self.blocks_of(&surface.terms, Some((&solved.growing, solved.mean_square(self.fit.rows()))));
        let choice = Choice { terms: solved.terms.clone(), by, climb: None };
        let cross = || self.sections_left_out(surface, all, &solved);
        let quality: Quality = self.quality(surface, &design, &statistics, &choice, &cross);
        statistics.cross_validation.clone_from(&quality.cross_validated);
        statistics.rows_used = quality.words(self, &choice, false);
        if quality.cross_validated.is_some() {
            let what = if split::has_blocks(&self.sequence.series) { "blocks of consecutive rows" } else { "whole series" };
            statistics.rows_used.error += &format!("; a part has {what}");
        }
        let notes =
            Notes { whitening: Some(&solved.estimate.whitening), ..self.notes(surface, [all, &design], &statistics, &quality) };
        let Noted { mut warnings, is_lacking, serial } = notes.all();
        warnings.extend(noise.near_walk().map(|what| Warning { kind: "near-random-walk", what }));
        if quality.explained.is_none() && by != ChosenBy::Nobody {
            warnings.push(warnings::not_judged(&statistics.rows_used));
        }
        warnings.extend(left_out::warning(self.left_out));
        (statistics.warnings, statistics.serial, statistics.noise) = (warnings, serial, Some(noise));
        statistics.selection = solved.report;
        let verdict = self.verdict(&statistics, &choice, &quality, is_lacking);
        let rows_outside = self.rows_outside(&design);
        let name = surface.name.clone();
        Ok(ResponseOutcome { name, verdict, rows_outside, statistics: Some(statistics), chosen_by: by })
    }

    /// Terms and noise of some rows. Chosen terms are those of smallest AICc on rows that are whitened by the noise of the terms before, until both
    /// agree. `start`: noise near the result.
    fn solve(
        &self,
        surface: &Surface,
        all: &Design,
        rows: &Sample,
        sequence: &Sequence,
        order: NoiseOrder,
        start: Option<&[f64]>,
    ) -> Result<Solved, Unsolved> {
        let estimate = |terms: &[usize]| {
            let found = rows.observed(|rows| autoregressive::estimate(&all.only(terms), rows, sequence, order, start));
            found.map_err(|dependent| Unsolved::Dependent(renumbered(&dependent, terms)))
        };
        let mut terms: Vec<usize> = (0..all.width()).collect();
        let (mut noise, mut report) = (None, None);
        if matches!(self.response.method, Method::Search(_)) {
            let searcher = Searcher { least_squares_only: true, ..Searcher::of(all, &self.response.method, surface, rows) };
            for _ in 0..MOST_TURNS {
                let triangle = match &noise {
                    None => rows.to_fit(all),
                    Some(Estimate { whitening, .. }) => rows.observed(|rows| whitening.triangle(all, rows, sequence)),
                };
                let found = searcher.choose_by_triangle(&triangle).ok_or(Unsolved::TooFew)?;
                let has_settled = noise.is_some() && found.terms == terms;
                (terms, report) = (found.terms, found.report);
                if has_settled {
                    break;
                }
                noise = Some(estimate(&terms)?);
            }
        }
        let estimate = match noise {
            Some(noise) => noise,
            None => estimate(&terms)?,
        };
        let places: Vec<usize> = (0..terms.len()).collect();
        let growing = Growing::of(&estimate.triangle, &places);
        let growing = growing.map_err(|dependent| Unsolved::Dependent(renumbered(&dependent, &terms)))?;
        Ok(Solved { terms, estimate, growing, report })
    }

    /// The figures of the coefficients and of the noise.
    fn noise_figures(&self, design: &Design, solved: &Solved) -> (ResponseStatistics, NoiseReport) {
        let Solved { estimate, growing, .. } = solved;
        let exact = growing.coefficients();
        let coefficients: Vec<f64> = exact.iter().map(|coefficient| coefficient.to_f64()).collect();
        let rows = self.fit.rows();
        let (freedom, mean_square) = (solved.freedom(rows), solved.mean_square(rows));
        let all = self.fit.observed(|rows| statistics::of_constrained(design, &coefficients, rows));
        let whitened: Vec<f64> = self.fit.observed(|fit| {
            let rows = estimate.whitening.rows(design, fit, self.sequence);
            let error = |row: &Vec<Dd>| (row[exact.len()] - statistics::value(&row[..exact.len()], &exact)).to_f64();
            rows.iter().map(error).collect()
        });
        let errors: Vec<f64> = growing.variances().iter().map(|variance| (mean_square * variance.to_f64()).sqrt()).collect();
        let tested = |(term, error): (TermStatistics, &f64)| {
            let t = Some(term.coefficient / error).filter(|t| t.is_finite());
            let p = t.and_then(|t| two_sided_t(t, freedom as f64));
            TermStatistics { standard_error: Some(*error), t, p, ..term }
        };
        let mut noise = NoiseReport::of(estimate, self.sequence, mean_square.sqrt(), &whitened);
        let half = quantile_t(0.95, freedom);
        noise.intervals = coefficients.iter().zip(&errors).map(|(b, error)| [b - half * error, b + half * error]).collect();
        noise.ratio = self.ratio_to_independent(design, &errors);
        let variance = autocovariances(&estimate.partial, 1)[0];
        let figures = ResponseStatistics {
            terms: all.terms.into_iter().zip(&errors).map(tested).collect(),
            rows,
            residual_sd: Some((variance * mean_square).sqrt()),
            r2_adjusted: None,
            lack_of_fit: None,
            ..all
        };
        (figures, noise)
    }

    /// The largest ratio of standard errors to those of least squares.
    fn ratio_to_independent(&self, design: &Design, errors: &[f64]) -> Option<f64> {
        let places: Vec<usize> = (0..design.width()).collect();
        let free = Growing::of(&self.fit.to_fit(design), &places).ok()?;
        let freedom = self.fit.rows().checked_sub(design.width()).filter(|freedom| *freedom > 0)?;
        let mean_square = free.residual_square().to_f64() / freedom as f64;
        let ordinary = free.variances().into_iter().map(|variance| (mean_square * variance.to_f64()).sqrt());
        let ratios = errors.iter().zip(ordinary).map(|(error, ordinary)| error / ordinary);
        ratios.filter(|ratio| ratio.is_finite()).reduce(f64::max)
    }

    /// The errors on series or blocks that are left out in turn: terms, if they are chosen, and noise are found again without them. The order of the
    /// noise is kept.
    fn sections_left_out(&self, surface: &Surface, all: &Design, solved: &Solved) -> Option<(Judged, usize)> {
        let (rows, width) = (self.fit.rows() as f64, all.width());
        if rows * (width * width) as f64 > WORK {
            return None;
        }
        let part_of = split::parts(&self.fit.groups, PARTS, 1);
        let parts = part_of.iter().max().map_or(0, |most| most + 1);
        if parts < 2 {
            return None;
        }
        let partial = &solved.estimate.partial;
        let order = NoiseOrder::Given(partial.len());
        let mut judged = Judged::NOTHING;
        for part in 0..parts {
            let rest = self.fit.chosen(|row| part_of[row] != part);
            if rest.rows() < least_rows(solved.terms.len(), partial.len()) {
                return None;
            }
            let sequence = self.sequence.only(|row| part_of[row] != part);
            let found = self.solve(surface, all, &rest, &sequence, order, Some(partial)).ok()?;
            let coefficients: Vec<f64> = found.growing.coefficients().into_iter().map(Dd::to_f64).collect();
            let design = all.only(&found.terms);
            let out = self.fit.chosen(|row| part_of[row] == part);
            let (range, mean) = (surface.output_range, rest.mean());
            judged = judged.and(out.observed(|rows| Judged::of(&design, &coefficients, range, rows, mean)));
        }
        Some((judged, parts))
    }
}

/// A dependence numbered as the candidates.
fn renumbered(dependent: &Dependent, terms: &[usize]) -> Dependent {
    Dependent { candidates: dependent.candidates.iter().map(|k| terms[*k]).collect(), condition: dependent.condition }
}
