//! Which form a response takes: powers of its inputs alone, or smooth steps of them too.
//!
//! In: a response, its rows, how its terms are chosen. Out: the sigmoids to add, if any, with what was tried and why. Sigmoids are found on the rows to
//! fit ([`sigmoids`]). Both forms are then fitted without each of five parts of the rows in turn: there the sigmoids are refined and the
//! terms are chosen anew, and the part judges. Sigmoids are taken where the error of the parts falls clearly. Rows that test choose nothing.

mod sigmoids;

use rsm_core::model::{Input, Sigmoid, Surface};

use crate::dd::Dd;
use crate::design::{self, Design};
use crate::qr::Growing;
use crate::search::Searcher;
use crate::selection::{Sample, Selection};
use crate::spec::{Form, Method};
use crate::split;
use crate::statistics::{FormsReport, Judged, Observations, Tried};

/// Rows are left out in so many parts.
const PARTS: usize = 5;

/// The error with sigmoids must be at most this share of that of powers alone: less is no clear gain, and costs operations.
const CLEAR: f64 = 0.85;

/// In so many parts at least the sigmoids must be better: a single lucky part is no evidence (with five parts chance gives 4 or 5 in 19 %).
const MOST_PARTS: usize = 4;

/// Fewer rows to fit than this say nothing of a bend.
const LEAST_ROWS: usize = 40;

/// More inputs than this have too many places for a step.
const MOST_INPUTS: usize = 4;

/// So many candidate terms at most: two operations each, and seven or eight a sigmoid, are some 150.
const MOST_CANDIDATES: usize = 52;

/// A response whose form is chosen.
pub(crate) struct Forms<'a> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    pub method: &'a Method,
    pub is_constrained: bool,
    pub fit: &'a Sample,
    pub validate: Option<&'a Sample>,
}

/// Sigmoids that were taken.
pub(crate) struct Taken {
    pub sigmoids: Vec<Sigmoid>,
    /// The highest order of a candidate term.
    pub order: u32,
    /// The errors on rows left out, and the number of parts.
    pub judged: Option<(Judged, usize)>,
}

impl Forms<'_> {
    /// What to add, and what is told of it; neither where no other form was looked at.
    pub(crate) fn choose(&self, wanted: Option<&[Form]>) -> (Option<Taken>, Option<FormsReport>) {
        let is_asked = wanted.is_some_and(|forms| forms.contains(&Form::Sigmoid));
        let is_only = is_asked && wanted.is_some_and(|forms| !forms.contains(&Form::Polynomial));
        let Some(highest) = self.highest_order() else { return (None, None) };
        let may = !self.is_constrained && self.surface.sigmoids.is_empty() && self.surface.reciprocal.is_empty();
        let is_worth = self.fit.rows() >= LEAST_ROWS && self.surface.inputs.len() <= MOST_INPUTS;
        if !may || !is_worth || wanted.is_some_and(|_| !is_asked) {
            let why =
                "there are too few rows, too many inputs, or inputs that enter by their reciprocal: no sigmoid was looked for";
            return (None, is_asked.then(|| self.kept(vec![], why.to_string())));
        }
        let search = sigmoids::Search { surface: self.surface, inputs: self.inputs, highest, most_candidates: MOST_CANDIDATES };
        let Some(found) = search.run(self.fit, is_only) else {
            let why = "no sigmoid explains clearly more of the fitted rows than powers do".to_string();
            return (None, is_asked.then(|| self.kept(vec![], why)));
        };
        let parts = self.judged(&search, &found.sigmoids, found.order);
        let total = |which: usize, parts: &[[Judged; 2]]| parts.iter().fold(Judged::NOTHING, |sum, part| sum.and(part[which]));
        let rmse = |judged: Judged| judged.statistics().map(|statistics| statistics.rmse);
        let count = found.sigmoids.len();
        let Some(parts) = parts else {
            if is_only {
                let tried = vec![Tried { form: Form::Sigmoid, sigmoids: count, rmse: None }];
                let why = "it was the only form asked for".to_string();
                let taken = Taken { sigmoids: found.sigmoids, order: found.order, judged: None };
                return (Some(taken), Some(FormsReport { tried, chosen: Form::Sigmoid, why }));
            }
            return (None, is_asked.then(|| self.kept(vec![], "the rows are too few to leave parts of them out".to_string())));
        };
        let [powers, steps] = [0, 1].map(|which| rmse(total(which, &parts)).unwrap_or(f64::INFINITY));
        let better = parts.iter().filter(|[powers, steps]| rmse(*steps) < rmse(*powers)).count();
        let tried = vec![
            Tried { form: Form::Polynomial, sigmoids: 0, rmse: Some(powers) },
            Tried { form: Form::Sigmoid, sigmoids: count, rmse: Some(steps) },
        ];
        let percent = 100.0 * (1.0 - steps / powers);
        let gain = format!(
            "on rows left out in {} parts in turn {count} sigmoids leave {percent:.0} % less error than powers alone, better in {better} parts",
            parts.len()
        );
        if is_only || (steps <= CLEAR * powers && better >= MOST_PARTS.min(parts.len())) {
            let why = if is_only { format!("it was the only form asked for; {gain}") } else { gain };
            let judged = Some((total(1, &parts), parts.len()));
            let taken = Taken { sigmoids: found.sigmoids, order: found.order, judged };
            return (Some(taken), Some(FormsReport { tried, chosen: Form::Sigmoid, why }));
        }
        let least = 100.0 * (1.0 - CLEAR);
        (None, Some(self.kept(tried, format!("{gain}: a clear gain is {least:.0} % and {MOST_PARTS} parts"))))
    }

    fn kept(&self, tried: Vec<Tried>, why: String) -> FormsReport {
        FormsReport { tried, chosen: Form::Polynomial, why }
    }

    /// The highest order of candidate terms; none where terms were given.
    fn highest_order(&self) -> Option<u32> {
        match self.method {
            Method::Fixed(_) => None,
            Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => Some(*order),
            Method::Search(search) => Some(search.max_order),
        }
    }

    /// The errors on each part of powers alone and of the sigmoids, refined without it.
    fn judged(&self, search: &sigmoids::Search<'_>, found: &[Sigmoid], order: u32) -> Option<Vec<[Judged; 2]>> {
        let part_of = split::parts(&self.fit.groups, PARTS, 3);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        if count < 2 {
            return None;
        }
        let round = |part: usize| {
            let (rest, out) = (self.fit.chosen(|row| part_of[row] != part), self.fit.chosen(|row| part_of[row] == part));
            let powers = self.errors(self.surface, self.highest_order()?, &rest, &out)?;
            let refined = search.refined(&rest, found, order)?;
            let bent = Surface { sigmoids: refined, ..self.surface.clone() };
            Some([powers, self.errors(&bent, order, &rest, &out)?])
        };
        (0..count).map(round).collect()
    }

    /// The errors on some rows of what is chosen and fitted on others.
    fn errors(&self, surface: &Surface, order: u32, fit: &Sample, out: &Sample) -> Option<Judged> {
        let all = Design::new(surface, self.inputs, design::terms_up_to(surface, order));
        let (method, output_range) = (self.method, surface.output_range);
        let (design, coefficients) = if Searcher::is_for(method, all.width(), fit.rows()) {
            let searcher = Searcher {
                design: &all,
                method,
                coding: surface.coding,
                output_range,
                least_squares_only: false,
                fit,
                validate: self.validate,
                lot: None,
            };
            let found = searcher.choose()?;
            (all.only(&found.terms), found.shrunk)
        } else {
            let triangle = fit.to_fit(&all);
            let selection =
                Selection { design: &all, method, output_range, fit, triangle: &triangle, validate: self.validate, lot: None };
            let chosen = selection.choose(&mut |_, _, _| {}).ok()?;
            (all.only(&chosen.terms), None)
        };
        let coefficients = match coefficients {
            Some(coefficients) => coefficients,
            None => {
                let terms: Vec<usize> = (0..design.width()).collect();
                let solved = Growing::of(&fit.to_fit(&design), &terms).ok()?;
                solved.coefficients().into_iter().map(Dd::to_f64).collect()
            }
        };
        let mean = fit.mean();
        Some(out.observed(|rows| Judged::of(&design, &coefficients, output_range, Observations { weights: &[], ..rows }, mean)))
    }
}
