//! The fit of a response as a tensor spline.
//!
//! In: the rows of a response, the wanted spline. Out: its outcome. A penalty shrinks the coefficients, so they have no standard errors, and tests of
//! least squares are not made.

use rsm_core::model::Surface;
use rsm_core::source::Faults;

use super::{Quality, Task};
use crate::dd::Dd;
use crate::forms::splines::{self, Fitted, Search};
use crate::left_out;
use crate::outcome::ResponseOutcome;
use crate::selection::{Choice, ChosenBy};
use crate::spec::{Form, SplineSpec};
use crate::statistics::{self, FormsReport, Judged, SplineReport, Tried, Warning, value};
use crate::support;
use crate::warnings;

impl Task<'_> {
    /// The spline as the only requested form.
    pub(super) fn run_only_spline(&self, surface: &mut Surface) -> Result<ResponseOutcome, Faults> {
        let mut outcome = self.run_spline(surface, &SplineSpec::default(), None)?;
        if let Some(statistics) = &mut outcome.statistics {
            let cells = surface.spline.as_ref().map_or_else(Vec::new, |spline| spline.cells.clone());
            let rmse = statistics.cross_validation.as_ref().map(|cross| cross.errors.rmse);
            let tried = vec![Tried { form: Form::Spline, sigmoids: 0, hinges: 0, orders: vec![], cells, rmse }];
            let why = "it was the only requested form".to_string();
            statistics.forms = Some(FormsReport { tried, chosen: Form::Spline, why });
        }
        Ok(outcome)
    }

    /// Fits a spline. `chosen`: the report on other forms, and the errors on parts of the rows.
    pub(super) fn run_spline(
        &self,
        surface: &mut Surface,
        wanted: &SplineSpec,
        chosen: Option<(FormsReport, Vec<Judged>)>,
    ) -> Result<ResponseOutcome, Faults> {
        let count = |cells: &Vec<u32>| cells.iter().map(|cells| (cells + wanted.degree) as usize).product::<usize>();
        let least = wanted.cells.as_ref().map_or_else(|| splines::least_rows(self.inputs.len()), count);
        if self.fit.rows() < least {
            let rows = self.fit.rows();
            let what = format!("response `{}`: found {rows} rows to fit, a spline needs at least {least} here", surface.name);
            let missing: String = self.left_out.iter().map(|one| format!("; {}", one.words())).collect();
            return Err(Faults::one(self.fault(what).help(format!("give fewer `cells` or measure more points{missing}"))));
        }
        if let Some(wanted) = self.response.support {
            surface.support = self.fit.observed(|fitted| support::of_data(surface, &self.inputs, fitted, wanted));
        }
        let search = Search { surface, inputs: &self.inputs, wanted };
        let Some((fitted, tried)) = search.run(&self.fit) else {
            let what = format!("response `{}`: the points do not determine a spline", surface.name);
            let help = "there must be points at several values of every input, in every combination of low and high";
            return Err(Faults::one(self.fault(what).help(help)));
        };
        let (report, parts) = chosen.unzip();
        let is_judged = self.test.is_some() || self.validate.is_some();
        let parts = parts.or_else(|| if is_judged { None } else { search.left_out(&self.fit) });
        let (design, coefficients) = splines::design_of(surface, &self.inputs, &fitted.spline);
        let mut free = self.fit.observed(|rows| statistics::of_constrained(&design, &coefficients, rows));
        (free.residual_sd, free.r2_adjusted, free.lack_of_fit) =
            (self.residual_sd(&design, &coefficients, &fitted), None, None);
        let mut statistics = self.with_apart(surface, &design, free);
        statistics.support = self.support(surface);
        let by = match (&wanted.cells, wanted.penalty) {
            (Some(_), Some(_)) => ChosenBy::Nobody,
            _ => ChosenBy::LeftOut { parts: splines::PARTS },
        };
        let chosen = Choice { terms: (0..design.width()).collect(), by, climb: None };
        let cross = || {
            let parts = parts.as_ref()?;
            Some((parts.iter().fold(Judged::NOTHING, |sum, part| sum.and(*part)), parts.len()))
        };
        let quality: Quality = self.quality(surface, &design, &statistics, &chosen, &cross);
        statistics.cross_validation.clone_from(&quality.cross_validated);
        statistics.rows_used = quality.words(self, &chosen, report.is_some());
        if by != ChosenBy::Nobody {
            let what = if wanted.cells.is_some() { "penalty" } else { "cells and penalty" };
            let rows = self.fit.rows();
            statistics.rows_used.terms =
                format!("{rows} fitted rows, left out in {} parts in turn, which chose {what}", splines::PARTS);
            if let (Some(cross), false) = (&quality.cross_validated, is_judged) {
                let form = if report.is_some() { "; the same rows also chose this form" } else { "" };
                let (rows, parts) = (cross.errors.rows, cross.parts);
                let words = format!(
                    "{rows} rows left out in {parts} parts in turn, fit and choice of {what} repeated without them{form}"
                );
                statistics.rows_used.error = words;
            }
        }
        statistics.warnings = self.notes_on(&fitted, &statistics, &quality);
        let verdict = self.verdict(&statistics, &chosen, &quality, false);
        let rows_outside = self.rows_outside(&design);
        let Fitted { spline, penalty, effective, empty_cells } = fitted;
        statistics.spline = Some(SplineReport {
            degree: spline.degree,
            cells: spline.cells.clone(),
            coefficients: spline.coefficients.len(),
            effective,
            penalty,
            empty_cells,
            tried,
        });
        statistics.forms = report;
        // The coefficients are in the surface; they are no terms.
        statistics.terms.clear();
        (surface.spline, surface.terms) = (Some(spline), vec![]);
        let name = surface.name.clone();
        Ok(ResponseOutcome { name, verdict, rows_outside, statistics: Some(statistics), chosen_by: by })
    }

    /// The residual standard deviation, with the coefficients that the spline is worth.
    fn residual_sd(&self, design: &crate::design::Design, coefficients: &[f64], fitted: &Fitted) -> Option<f64> {
        let coefficients: Vec<Dd> = coefficients.iter().copied().map(Dd::from).collect();
        let square = self.fit.observed(|rows| {
            let of_one = |row: usize| {
                let error = Dd::from(rows.response[row]) - value(&design.row_as_measured(&rows.point(row)), &coefficients);
                (rows.weight(row) * error * error).to_f64()
            };
            (0..rows.response.len()).map(of_one).sum::<f64>()
        });
        let freedom = self.fit.rows() as f64 - fitted.effective;
        (freedom > 0.5).then(|| (square / freedom).sqrt())
    }

    fn notes_on(&self, fitted: &Fitted, statistics: &statistics::ResponseStatistics, quality: &Quality) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let mut warn = |kind, what: Option<String>| warnings.extend(what.map(|what| Warning { kind, what }));
        let has_spread = self.fit.response.iter().any(|y| *y != self.fit.response[0]);
        let share = quality.explained.or(statistics.r2).filter(|_| has_spread);
        let rows = if quality.explained.is_some() { "holdout rows" } else { "the fitted rows" };
        warn("explains-little", share.and_then(|share| warnings::explains_little(share, rows)));
        let cells: usize = fitted.spline.cells.iter().map(|cells| *cells as usize).product();
        let empty = format!(
            "{} of {cells} cells contain no row: there the spline continues its neighbours in a straight line; `support = \"data\"` tests whether a point is inside the data",
            fitted.empty_cells
        );
        warn("cells-without-data", (fitted.empty_cells > 0).then_some(empty));
        for (key, count) in &self.copies {
            let what = format!("{count} rows of `{key}` are exact copies of fitted rows: they are no holdout rows");
            warn("rows-seen", Some(what));
        }
        warnings.extend(left_out::warning(self.left_out));
        warnings
    }
}
