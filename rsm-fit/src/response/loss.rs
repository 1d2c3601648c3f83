//! The fit of given terms with a robust loss.
//!
//! In: the rows of a response. Out: its outcome. Figures that are defined for squared errors only do not exist, and a sentence says so.

use rsm_core::model::Surface;

use super::{Quality, Task, terms_of};
use crate::canonical;
use crate::dd::Dd;
use crate::design::Design;
use crate::distributions::two_sided_t;
use crate::left_out;
use crate::outcome::ResponseOutcome;
use crate::robust::{self, LossReport, Robust};
use crate::selection::{Choice, ChosenBy};
use crate::spec::PARTS;
use crate::split;
use crate::statistics::{self, CrossValidation, Judged, ResponseStatistics, TermStatistics, Warning};
use crate::verdict::Verdict;
use crate::warnings::Notes;

/// The limit of rows times terms squared for cross-validation: ten fits of about fifty steps, 10^9 double-double multiplications, take about ten
/// seconds.
const WORK: f64 = 2e6;

impl Task<'_> {
    /// Fits the terms of the design with the loss of the response.
    pub(super) fn run_robust(&self, surface: &mut Surface, design: &Design) -> ResponseOutcome {
        let loss = self.response.loss;
        let found = match self.fit.observed(|rows| robust::fit(design, rows, loss)) {
            Ok(found) => found,
            Err(dependent) => return self.ill_conditioned(design, &dependent),
        };
        let mut statistics = self.with_apart(surface, design, self.robust_figures(design, &found));
        surface.terms = terms_of(&statistics);
        statistics.canonical = canonical::analyse(surface, &self.inputs);
        statistics.support = self.support(surface);
        let is_judged = self.test.is_some() || self.validate.is_some();
        let cross_validated = if is_judged { None } else { self.robust_left_out(surface, design) };
        statistics.cross_validation.clone_from(&cross_validated);
        let choice = Choice { terms: (0..design.width()).collect(), by: ChosenBy::Nobody, climb: None };
        let quality = Quality { is_held: false, explained: None, centred: None, cross_validated };
        statistics.rows_used = quality.words(self, &choice, false);
        let report = self.fit.observed(|rows| LossReport::of(&found, loss, rows, &surface.inputs));
        let notes = Notes {
            surface,
            inputs: &self.inputs,
            design,
            fit: &self.fit,
            sequence: self.sequence,
            whitening: None,
            constraints: &self.response.constraints,
            statistics: &statistics,
            is_shrunk: true,
            free_residual_sd: Some(found.scale),
            highest_order: 0,
            explained: None,
            copies: &self.copies,
        };
        let mut warnings = notes.all().warnings;
        let mut warn = |kind, what: Option<String>| warnings.extend(what.map(|what| Warning { kind, what }));
        let rows = |outliers| format!("{} of {} rows: {outliers}", report.low_weight.len(), self.fit.rows());
        warn("low-weight", report.outliers().map(rows));
        let steps = || {
            format!("the fit with loss \"{}\" has not settled after {} steps: do not use it", report.loss, report.iterations)
        };
        warn("loss-not-settled", (!report.converged).then(steps));
        warnings.extend(left_out::warning(self.left_out));
        statistics.warnings = warnings;
        statistics.loss = Some(report);
        let rows_outside = self.rows_outside(design);
        let name = surface.name.clone();
        ResponseOutcome {
            name,
            verdict: Verdict::Fitted,
            rows_outside,
            statistics: Some(statistics),
            chosen_by: ChosenBy::Nobody,
        }
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
            confidence_c: None,
            lack_of_fit: None,
            ..all
        }
    }

    /// Errors on fitted rows that are left out in turn, with the same loss without them.
    fn robust_left_out(&self, surface: &Surface, design: &Design) -> Option<CrossValidation> {
        let (rows, width) = (self.fit.rows() as f64, design.width());
        if rows * (width * width) as f64 > WORK {
            return None;
        }
        let part_of = split::parts(&self.fit.groups, PARTS, 1);
        let parts = part_of.iter().max().map_or(0, |most| most + 1);
        let mut judged = Judged::NOTHING;
        for part in 0..parts {
            let rest = self.fit.chosen(|row| part_of[row] != part);
            if rest.rows() < width {
                return None;
            }
            let found = rest.observed(|rows| robust::fit(design, rows, self.response.loss)).ok()?;
            let coefficients: Vec<f64> = found.coefficients.into_iter().map(Dd::to_f64).collect();
            let out = self.fit.chosen(|row| part_of[row] == part);
            judged =
                judged.and(out.observed(|rows| Judged::of(design, &coefficients, surface.output_range, rows, rest.mean())));
        }
        Some(CrossValidation { errors: judged.statistics()?, parts, r2: None })
    }
}
