//! The fit of one response, from its rows to a surface with its figures.
//!
//! In: the rows of a response, its specification. Out: the terms of the surface, the figures and the outcome. Linearly dependent columns and
//! constraints that cannot be met are outcomes; too few rows and terms that are not finite are faults.

mod blocks;
mod constrained;
mod loss;
mod noise;
mod quality;
mod spline;

use std::cell::OnceCell;

use rsm_core::model::{Input, Surface, Term};
use rsm_core::source::Faults;

use crate::analysis;
use crate::blocks::Blocks;
use crate::constrain;
use crate::design::eight::Seen;
use crate::design::{self, Design};
use crate::forms::{Forms, Taken, splines};
use crate::ladder::{LadderModel, first_rung};
use crate::left_out::{self, LeftOut};
use crate::outcome::{Progress, ResponseOutcome};
use crate::qr::{Dependent, Growing};
use crate::search::{Found, Searcher};
use crate::selection::{Choice, ChosenBy, Sample, Selection};
use crate::sequence::Sequence;
use crate::spec::{Form, Loss, Method, ResponseSpec, Specification, SplineSpec, Validation};
use crate::statistics::{self, CrossValidation, Judged, Observations, ResponseStatistics, TransformReport};
use crate::support::{self, Region, SupportStatistics};
use crate::verdict::{self, Criterion, Verdict};
use crate::warnings::{self, Noted, Notes};
use constrained::is_held;
use quality::Quality;

/// The result of a search as a choice.
fn choice_of(found: &Found) -> Choice {
    let climb = |(confidence, centred)| LadderModel { chosen: found.terms.clone(), confidence, centred };
    Choice { terms: found.terms.clone(), by: found.by, climb: found.climb.map(climb) }
}

/// Whether other forms may be tried without a request: if the terms are searched for the smallest error, or if a ladder did not reach its confidence.
/// A ladder that reached it already has the fewest terms.
fn is_open(method: &Method, outcome: &Result<ResponseOutcome, Faults>) -> bool {
    match (method, outcome) {
        (Method::Search(_), Ok(outcome)) => outcome.statistics.is_some(),
        (Method::Ladder { .. }, Ok(outcome)) => !matches!(outcome.verdict, Verdict::Reached { .. }),
        _ => false,
    }
}

/// The smallest number of rows for a search: it evaluates models of a constant and one term by cross-validation.
pub(crate) const LEAST_FOR_SEARCH: usize = 6;

pub(crate) fn terms_of(statistics: &ResponseStatistics) -> Vec<Term> {
    statistics.terms.iter().map(|term| Term { powers: term.powers.clone(), coefficient: term.coefficient }).collect()
}

/// One response with its data.
pub(crate) struct Task<'a> {
    pub specification: &'a Specification,
    pub response: &'a ResponseSpec,
    /// The inputs of the surface, then the contrasts of its blocks.
    pub inputs: Vec<Input>,
    pub blocks: Option<&'a Blocks>,
    pub fit: Sample,
    /// The order of the rows to fit.
    pub sequence: &'a Sequence,
    pub validate: Option<Sample>,
    /// The weights of the validation rows, if they are part of the data.
    pub validate_weights: Vec<f64>,
    pub test: Option<Sample>,
    /// The files with copies of fitted rows, and their number.
    pub copies: Vec<(&'static str, usize)>,
    /// The rows that are left out because a cell is missing.
    pub left_out: &'a [LeftOut],
}

impl Task<'_> {
    /// The fit of the surface with the contrasts of blocks as inputs.
    fn run_whole(&self, surface: &mut Surface, progress: &mut dyn FnMut(Progress<'_>)) -> Result<ResponseOutcome, Faults> {
        if let Some(wanted) = &self.response.spline {
            return self.run_spline(surface, wanted, None);
        }
        // Other forms are compared by errors that both of these do not have.
        if self.response.noise.is_some() || self.response.loss != Loss::LeastSquares {
            return self.run_form(surface, None, progress);
        }
        let empty = surface.clone();
        let allowed = self.response.forms.as_deref().unwrap_or_default();
        if *allowed == [Form::Spline] {
            return self.run_only_spline(surface);
        }
        let powers = self.run_form(surface, None, progress);
        let forms = self.response.forms.as_deref();
        let periods: Vec<Option<f64>> = empty.inputs.iter().map(|name| self.period_of(name)).collect();
        let is_periodic = periods.iter().any(Option::is_some);
        if forms.is_none() && !is_periodic && !is_open(&self.response.method, &powers) {
            return powers;
        }
        let of = Forms {
            surface: &empty,
            inputs: &self.inputs,
            method: &self.response.method,
            is_constrained: !self.response.constraints.is_empty(),
            fit: &self.fit,
            validate: self.validate.as_ref(),
            periods,
            is_open: is_open(&self.response.method, &powers),
            powers: OnceCell::new(),
        };
        let (taken, mut report) = of.choose(forms);
        if allowed.contains(&Form::Spline) {
            let wanted = SplineSpec::default();
            let search = splines::Search { surface: &empty, inputs: &self.inputs, wanted: &wanted };
            let (judged, said) = of.with_spline(&search, report);
            if let Some(judged) = judged {
                *surface = empty;
                return self.run_spline(surface, &wanted, Some((said, judged)));
            }
            report = Some(said);
        }
        let mut outcome = match &taken {
            None => powers?,
            Some(taken) => {
                let waves = [&empty.waves[..], &taken.waves].concat();
                let sigmoids = [&empty.sigmoids[..], &taken.sigmoids].concat();
                let knots = [&empty.knots[..], &taken.knots].concat();
                *surface = Surface { knots, sigmoids, waves, ..empty };
                self.run_form(surface, Some(taken), progress)?
            }
        };
        if let Some(statistics) = &mut outcome.statistics {
            statistics.forms = report;
        }
        Ok(outcome)
    }

    fn period_of(&self, input: &str) -> Option<f64> {
        self.specification.inputs.iter().find(|known| known.name == input)?.period
    }

    /// Fits with the surface's variables. `taken`: the form chosen by the data.
    fn run_form(
        &self,
        surface: &mut Surface,
        taken: Option<&Taken>,
        progress: &mut dyn FnMut(Progress<'_>),
    ) -> Result<ResponseOutcome, Faults> {
        let method = &self.response.method;
        let chosen_hinges = taken.map_or(0, |taken| taken.knots.len());
        let up_to = |order: u32| design::terms_with_hinges(surface, chosen_hinges, taken.map_or(order, |taken| taken.order));
        let terms = match method {
            Method::Fixed(terms) => match self.blocks {
                Some(blocks) => blocks.with_terms(terms, self.own_inputs().len()),
                None => terms.clone(),
            },
            Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => up_to(*order),
            Method::Search(search) => up_to(search.max_order),
        };
        let least = match method {
            Method::Ladder { .. } => {
                let first = first_rung(&terms);
                terms.iter().filter(|powers| design::order(powers) <= first).count()
            }
            // A constant and possibly one term, plus rows that evaluate them.
            Method::Search(_) => LEAST_FOR_SEARCH,
            _ => terms.len(),
        };
        if self.fit.rows() < least {
            let rows = self.fit.rows();
            let what = match method {
                Method::Search(_) => {
                    format!("response `{}`: found {rows} rows to fit, a search of terms needs at least {least}", surface.name)
                }
                _ => format!(
                    "response `{}`: found {rows} rows to fit, expected at least {least}, one for each term",
                    surface.name
                ),
            };
            let missing: String = self.left_out.iter().map(|one| format!("; {}", one.words())).collect();
            return Err(Faults::one(self.fault(what).help(format!("fit fewer terms or measure more points{missing}"))));
        }
        if let Some(wanted) = self.response.support {
            let own = self.own(surface);
            surface.support = self.fit.observed(|fitted| support::of_data(&own, self.own_inputs(), fitted, wanted));
        }
        if !self.response.constraints.is_empty()
            && let Some(count) = constrain::too_many_parts(&self.own(surface), self.own_inputs())
        {
            let place = format!("responses.{}.constraints.0", surface.name);
            let most = constrain::MOST_PARTS;
            let what = format!(
                "response `{}`: constraints: its sigmoids and waves divide the box into {count} parts, and at most {most} are proved",
                surface.name
            );
            let help = "use fewer sigmoids, waves of lower orders, or no constraints";
            return Err(Faults::one(self.specification.fault(&place, what).help(help)));
        }
        let all = Design::new(surface, &self.inputs, terms);
        self.require_finite(&all)?;
        if self.response.loss != Loss::LeastSquares {
            return self.run_robust(surface, &all);
        }
        if let Some(order) = self.response.noise {
            return self.run_autoregressive(surface, &all, order);
        }
        let random_split = match &self.specification.validation {
            Validation::Split(split) => Some((split.share, &self.validate_weights[..])),
            _ => None,
        };
        let searcher = Searcher {
            least_squares_only: !self.response.constraints.is_empty(),
            validate: self.validate.as_ref(),
            random_split,
            ..Searcher::of(&all, method, surface, &self.fit)
        };
        let is_searched = Searcher::is_for(method, all.width(), self.fit.rows());
        let found = if is_searched { searcher.choose() } else { None };
        if is_searched && found.is_none() {
            let what =
                format!("response `{}`: there are too few rows, or too few groups of rows, to choose terms", surface.name);
            return Err(Faults::one(self.fault(what).help("measure more points, or give terms with method \"fixed\"")));
        }
        // For a search, only the chosen candidates: reducing all of them in double-double would take too long.
        let triangle = match &found {
            Some(found) => self.fit.to_fit(&all.only(&found.terms)),
            None => self.fit.to_fit(&all),
        };
        let selection = Selection {
            design: &all,
            method,
            output_range: surface.output_range,
            fit: &self.fit,
            triangle: &triangle,
            validate: self.validate.as_ref(),
            random_split,
        };
        let name = surface.name.clone();
        let solved = match &found {
            Some(found) => {
                let places: Vec<usize> = (0..found.terms.len()).collect();
                let numbered = |dependent: Dependent| Dependent {
                    candidates: dependent.candidates.iter().map(|k| found.terms[*k]).collect(),
                    ..dependent
                };
                Growing::of(&triangle, &places).map_err(numbered).map(|growing| (growing, choice_of(found)))
            }
            None => {
                let chosen = selection.choose(&mut |order, terms, confidence| {
                    progress(Progress::Step { response: &name, order, terms, confidence });
                });
                chosen.and_then(|chosen| Ok((Growing::of(&triangle, &chosen.terms)?, chosen)))
            }
        };
        let (growing, chosen) = match solved {
            Ok(solved) => solved,
            Err(dependent) => return Ok(self.ill_conditioned(&all, &dependent)),
        };
        let design = all.only(&chosen.terms);
        let shrunk = found.as_ref().and_then(|found| found.shrunk.as_ref());
        let (free, leverages) = self.fit.observed(|fitted| match shrunk {
            // Shrunken coefficients have no standard errors either.
            Some(coefficients) => (statistics::of_constrained(&design, coefficients, fitted), None),
            None => {
                let (figures, leverages) = statistics::of_fit_with_leverages(&design, &growing, fitted);
                (figures, Some(leverages))
            }
        });
        // The triangle is of the chosen terms alone, unless a ladder left some out or took them in another order.
        let has_all = found.is_some() || chosen.terms.iter().copied().eq(0..all.width());
        let residual_sd = free.residual_sd;
        let mut statistics = self.with_apart(surface, &design, free);
        surface.terms = terms_of(&statistics);
        if !self.response.constraints.is_empty() {
            statistics = match self.constrained(surface, &design, &growing, statistics) {
                Ok(statistics) => statistics,
                Err(verdict) => return Ok(self.without_surface(&design, verdict)),
            };
            surface.terms = terms_of(&statistics);
        }
        self.add_shape(surface, &mut statistics);
        let has_errors = shrunk.is_none() && !is_held(&statistics);
        let mean_square = statistics.residual_sd.filter(|_| has_errors).map(|sd| sd * sd);
        statistics.blocks = self.blocks_of(&surface.terms, mean_square.map(|square| (&growing, square)));
        if has_errors {
            statistics.analysis = self.fit.observed(|rows| analysis::report(&design, rows, self.sequence));
        }
        statistics.selection = found.as_ref().and_then(|found| found.report.clone());
        let cross = || {
            // If the data chose sigmoids, these are refined without each part too.
            if let Some(taken) = taken {
                return taken.judged;
            }
            if is_searched {
                searcher.cross_validated(chosen.terms.len())
            } else {
                selection.cross_validated(chosen.terms.len())
            }
        };
        let quality = self.quality(surface, &design, &statistics, &chosen, &cross);
        if !quality.is_held {
            statistics.cross_validation = quality.cross_validated.clone();
        }
        statistics.rows_used = quality.words(self, &chosen, taken.is_some());
        let notes = Notes {
            is_shrunk: shrunk.is_some(),
            free_residual_sd: residual_sd,
            triangle: has_all.then_some(&triangle),
            leverages: leverages.as_deref().filter(|_| has_all),
            ..self.notes(surface, [&all, &design], &statistics, &quality)
        };
        let Noted { mut warnings, is_lacking, serial } = notes.all();
        if quality.explained.is_none() && chosen.by != ChosenBy::Nobody {
            warnings.push(warnings::not_judged(&statistics.rows_used));
        }
        warnings.extend(left_out::warning(self.left_out));
        statistics.warnings = warnings;
        statistics.serial = serial;
        let verdict = self.verdict(&statistics, &chosen, &quality, is_lacking);
        let rows_outside = self.rows_outside(&design);
        Ok(ResponseOutcome { name, verdict, rows_outside, statistics: Some(statistics), chosen_by: chosen.by })
    }

    /// The figures from which warnings follow, for least squares without constraints. `[all, design]`: the possible and the chosen terms.
    fn notes<'n>(
        &'n self,
        surface: &'n Surface,
        [all, design]: [&'n Design; 2],
        statistics: &'n ResponseStatistics,
        quality: &Quality,
    ) -> Notes<'n> {
        Notes {
            surface,
            inputs: &self.inputs,
            design,
            fit: &self.fit,
            sequence: self.sequence,
            whitening: None,
            constraints: &self.response.constraints,
            statistics,
            is_shrunk: false,
            free_residual_sd: statistics.residual_sd,
            highest_order: all.terms().iter().map(|powers| design::order(powers)).max().unwrap_or(0),
            explained: quality.explained,
            copies: &self.copies,
            is_grouped: !self.specification.groups().is_empty(),
            triangle: None,
            leverages: None,
        }
    }

    /// Adds the errors on rows that were set aside.
    fn with_apart(&self, surface: &Surface, design: &Design, mut statistics: ResponseStatistics) -> ResponseStatistics {
        let judged = |rows: &Option<Sample>| self.judged(surface, design, &statistics, rows.as_ref()?)?.statistics();
        (statistics.validation, statistics.test) = (judged(&self.validate), judged(&self.test));
        statistics.transform = surface.transform.map(|transform| {
            let fitted = self.judged(surface, design, &statistics, &self.fit).and_then(|judged| judged.statistics());
            TransformReport::given(transform, fitted)
        });
        statistics
    }

    fn judged(&self, surface: &Surface, design: &Design, statistics: &ResponseStatistics, rows: &Sample) -> Option<Judged> {
        let coefficients: Vec<f64> = statistics.terms.iter().map(|term| term.coefficient).collect();
        let mean = self.fit.mean();
        Some(rows.observed(|rows| Judged::of(design, &coefficients, surface.output_range, rows, mean)))
    }

    /// The explained share on rows that were not used for any choice: test rows, otherwise validation rows if terms were given, otherwise
    /// cross-validation.
    fn quality(
        &self,
        surface: &Surface,
        design: &Design,
        statistics: &ResponseStatistics,
        chosen: &Choice,
        cross: &dyn Fn() -> Option<(Judged, usize)>,
    ) -> Quality {
        let explained = |rows: &Option<Sample>| self.judged(surface, design, statistics, rows.as_ref()?)?.explained();
        let validated = explained(&self.validate);
        let centred = match chosen.by {
            ChosenBy::Nobody => None,
            ChosenBy::Validation => validated,
            ChosenBy::LeftOut { .. } => chosen.climb.as_ref().and_then(|climb| climb.centred).map(|centred| centred / 100.0),
            ChosenBy::FittedRows | ChosenBy::Formula(_) => statistics.r2,
        };
        let is_held = is_held(statistics);
        let mut quality = Quality { is_held, explained: None, centred, cross_validated: None };
        if self.test.is_some() {
            quality.explained = explained(&self.test);
        } else if chosen.by != ChosenBy::Validation && self.validate.is_some() {
            quality.explained = validated;
        } else if let Some((judged, parts)) = cross() {
            quality.explained = judged.explained();
            let errors = judged.statistics();
            quality.cross_validated = errors.map(|errors| CrossValidation { errors, parts, r2: judged.explained() });
        }
        // Cross-validation is for the surface without constraints. The constrained surface explains at most as much as on fitted rows.
        if is_held && self.test.is_none() {
            quality.explained = quality.explained.zip(statistics.r2).map(|(free, held)| free.min(held));
        }
        quality
    }

    fn fault(&self, what: String) -> rsm_core::source::Fault {
        self.specification.fault(&format!("responses.{}", self.response.surface.name), what)
    }

    fn rows_outside(&self, design: &Design) -> usize {
        self.fit.observed(|fitted| fitted.rows_outside(design))
    }

    /// The share of the box inside the support.
    fn support(&self, surface: &Surface) -> Option<SupportStatistics> {
        self.response.support?;
        let region = Region::new(surface, self.own_inputs());
        let outside = |unseen: Observations<'_>| {
            let is_outside = |row: &usize| !support::holds(&surface.support, &region.coded(&unseen.point(*row)));
            (0..unseen.response.len()).filter(is_outside).count()
        };
        Some(SupportStatistics {
            half_spaces: surface.support.len(),
            share_of_box: region.share(&surface.support),
            unseen_rows_outside: [&self.validate, &self.test].into_iter().flatten().map(|rows| rows.observed(outside)).sum(),
        })
    }

    /// Checks that every term is a finite number in every row.
    fn require_finite(&self, design: &Design) -> Result<(), Faults> {
        let is_finite = |rows: &Sample, seen: Seen| rows.observed(|rows| !rows.has_infinite_term(design, seen));
        let mut apart = [&self.validate, &self.test].into_iter().flatten();
        if is_finite(&self.fit, Seen::AsMeasured) && apart.all(|rows| is_finite(rows, Seen::AsEvaluated)) {
            return Ok(());
        }
        let what = format!("response `{}`: in some row a term is not a finite number", self.response.surface.name);
        let help =
            "lower the order, use coding = \"range\", or leave out rows where an input that enters by its reciprocal is 0";
        Err(Faults::one(self.fault(what).help(help)))
    }

    fn verdict(&self, statistics: &ResponseStatistics, chosen: &Choice, quality: &Quality, is_lacking: bool) -> Verdict {
        let Method::Ladder { confidence: wanted, .. } = self.response.method else { return Verdict::Fitted };
        let confidence = match (chosen.by, &statistics.validation, &chosen.climb) {
            (ChosenBy::Validation, Some(validation), _) => validation.confidence_c,
            (ChosenBy::LeftOut { .. }, _, Some(climb)) => Some(climb.confidence).filter(|confidence| confidence.is_finite()),
            _ => statistics.confidence_c,
        };
        let has_no_spread = self.fit.response.iter().all(|y| *y == self.fit.response[0]);
        let criterion = Criterion { wanted, centred: quality.centred, explained: quality.explained, is_lacking, has_no_spread };
        verdict::of_ladder(confidence, &criterion)
    }

    fn ill_conditioned(&self, design: &Design, dependent: &Dependent) -> ResponseOutcome {
        let columns = dependent.candidates.iter().map(|k| design.name_of(*k)).collect();
        self.without_surface(design, Verdict::IllConditioned { condition: dependent.condition, columns })
    }

    fn without_surface(&self, design: &Design, verdict: Verdict) -> ResponseOutcome {
        let chosen_by = match (&self.response.method, &self.validate) {
            (Method::Ladder { .. } | Method::Search(_), Some(_)) => ChosenBy::Validation,
            (Method::Ladder { .. } | Method::Search(_), None) => ChosenBy::FittedRows,
            _ => ChosenBy::Nobody,
        };
        let rows_outside = self.rows_outside(design);
        ResponseOutcome { name: self.response.surface.name.clone(), verdict, rows_outside, statistics: None, chosen_by }
    }
}
