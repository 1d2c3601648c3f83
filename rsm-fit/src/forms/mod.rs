//! Chooses the form of a response: powers of its inputs, also sigmoids of them, or waves over a periodic input.
//!
//! In: a response, its rows, the method of choosing terms. Out: the sigmoids to add, if any, with a report of what was tried. Sigmoids are found on
//! the rows to fit ([`sigmoids`]), orders of waves too ([`waves`]). Both forms are then fitted without each of five parts of the rows in turn: the
//! sigmoids are refined, the terms are chosen again, and the errors on the omitted part are computed. Sigmoids are accepted if these errors are
//! clearly smaller. Test rows are not used.

mod sigmoids;
pub(crate) mod splines;
mod waves;

use nalgebra::DVector;
use rsm_core::model::{Input, Sigmoid, Surface, Wave};

use crate::dd::Dd;
use crate::design::{self, Design};
use crate::qr::Growing;
use crate::random::Random;
use crate::search::Searcher;
use crate::selection::{Sample, Selection};
use crate::spec::{Form, Method};
use crate::split;
use crate::statistics::{FormsReport, Judged, Observations, Tried};

/// The number of parts that are left out in turn.
const PARTS: usize = 5;

/// The error with sigmoids must be at most this share of the error with powers alone. A smaller gain is not worth the operations.
const CLEAR: f64 = 0.85;

/// The number of parts in which sigmoids must be better. One part may be better by chance (with five parts, 4 or 5 are better by chance in 19 % of
/// cases).
const MOST_PARTS: usize = 4;

/// With fewer rows to fit, no bend can be found.
const LEAST_ROWS: usize = 40;

/// With more inputs, there are too many places for a sigmoid.
const MOST_INPUTS: usize = 4;

/// The largest number of candidate terms: two operations each, plus seven or eight for each sigmoid, are about 150.
const MOST_CANDIDATES: usize = 52;

/// A random sample of at most `most` rows, with the square roots of their weights, and their responses times these.
fn drawn(sample: &Sample, most: usize) -> (Vec<usize>, Vec<f64>, DVector<f64>) {
    let mut picked: Vec<usize> = (0..sample.rows()).collect();
    if picked.len() > most {
        Random::new(5).shuffle(&mut picked);
        picked.truncate(most);
    }
    let roots: Vec<f64> = picked.iter().map(|row| sample.weights.get(*row).map_or(1.0, |weight| weight.sqrt())).collect();
    let response =
        DVector::from_iterator(picked.len(), picked.iter().zip(&roots).map(|(row, root)| sample.response[*row] * root));
    (picked, roots, response)
}

/// A response with the data for the choice of its form.
pub(crate) struct Forms<'a> {
    pub surface: &'a Surface,
    pub inputs: &'a [Input],
    pub method: &'a Method,
    pub is_constrained: bool,
    pub fit: &'a Sample,
    pub validate: Option<&'a Sample>,
    /// The period of each input that has one.
    pub periods: Vec<Option<f64>>,
    /// Whether sigmoids may be tried without a request.
    pub is_open: bool,
}

/// The accepted form.
pub(crate) struct Taken {
    pub sigmoids: Vec<Sigmoid>,
    pub waves: Vec<Wave>,
    /// The highest order of a candidate term.
    pub order: u32,
    /// The errors on omitted rows, and the number of parts.
    pub judged: Option<(Judged, usize)>,
}

impl Forms<'_> {
    /// The form to add and the report; neither if no other form was tried.
    pub(crate) fn choose(&self, wanted: Option<&[Form]>) -> (Option<Taken>, Option<FormsReport>) {
        let Some(highest) = self.highest_order() else { return (None, None) };
        let may = |form| wanted.is_none_or(|forms| forms.contains(&form));
        let is_only = wanted.is_some_and(|forms| !forms.contains(&Form::Polynomial));
        // Without a request, constraints keep the form that they were given for.
        let may_be_constrained = |form| !self.is_constrained || wanted.is_some_and(|forms| forms.contains(&form));
        let is_free = self.surface.width() == self.surface.inputs.len() + self.surface.knots.len();
        let has_rows = is_free && self.fit.rows() >= LEAST_ROWS && design::free_inputs(self.surface) <= MOST_INPUTS;
        let mut report = None;
        if has_rows && may(Form::Wave) && may_be_constrained(Form::Wave) && self.periods.iter().any(Option::is_some) {
            let search = waves::Search { surface: self.surface, inputs: self.inputs, periods: &self.periods, highest };
            let (taken, said) = match search.run(self.fit) {
                Some(found) => self.compared(Form::Wave, &found, highest, is_only, &|rest| search.run(rest)),
                None => (None, self.kept(vec![], "no wave over an input with a period is above the noise".to_string())),
            };
            if taken.is_some() {
                return (taken, Some(said));
            }
            report = Some(said);
        }
        if !may(Form::Sigmoid) || !may_be_constrained(Form::Sigmoid) || (wanted.is_none() && !self.is_open) {
            return (None, report);
        }
        let is_asked = wanted.is_some();
        if !has_rows || !self.surface.reciprocal.is_empty() {
            let why =
                "there are too few rows, too many inputs, or inputs that enter by their reciprocal: no sigmoid was looked for";
            return (None, report.or(is_asked.then(|| self.kept(vec![], why.to_string()))));
        }
        let search = sigmoids::Search { surface: self.surface, inputs: self.inputs, highest, most_candidates: MOST_CANDIDATES };
        let Some(found) = search.run(self.fit, is_only) else {
            let why = "no sigmoid explains clearly more of the fitted rows than powers do".to_string();
            return (None, report.or(is_asked.then(|| self.kept(vec![], why))));
        };
        let order = found.order;
        let bent = |sigmoids: Vec<Sigmoid>| Surface { sigmoids, ..self.surface.clone() };
        let again = |rest: &Sample| search.refined(rest, &found.sigmoids, order).map(bent);
        let (taken, said) = self.compared(Form::Sigmoid, &bent(found.sigmoids.clone()), order, is_only, &again);
        (taken, Some(said))
    }

    /// Compares a form with powers alone. `again` finds the same form from other rows.
    fn compared(
        &self,
        form: Form,
        found: &Surface,
        order: u32,
        is_only: bool,
        again: &dyn Fn(&Sample) -> Option<Surface>,
    ) -> (Option<Taken>, FormsReport) {
        let orders: Vec<u32> = found.waves.iter().map(|wave| wave.order).collect();
        let taken = |judged| Taken { sigmoids: found.sigmoids.clone(), waves: found.waves.clone(), order, judged };
        let tried = |rmse| Tried { form, sigmoids: found.sigmoids.len(), orders: orders.clone(), cells: vec![], rmse };
        let Some(parts) = self.judged(order, again) else {
            if is_only {
                let why = "it was the only requested form".to_string();
                return (Some(taken(None)), FormsReport { tried: vec![tried(None)], chosen: form, why });
            }
            return (None, self.kept(vec![], "the rows are too few to leave parts of them out".to_string()));
        };
        let total = |which: usize| parts.iter().fold(Judged::NOTHING, |sum, part| sum.and(part[which]));
        let rmse = |judged: Judged| judged.statistics().map(|statistics| statistics.rmse);
        let [powers, other] = [0, 1].map(|which| rmse(total(which)).unwrap_or(f64::INFINITY));
        let better = parts.iter().filter(|[powers, other]| rmse(*other) < rmse(*powers)).count();
        let alone = Tried { form: Form::Polynomial, sigmoids: 0, orders: vec![], cells: vec![], rmse: Some(powers) };
        let tried = vec![alone, tried(Some(other))];
        let percent = 100.0 * (1.0 - other / powers);
        let what = match (form, &orders[..]) {
            (Form::Wave, [one]) => format!("a wave of order {one} leaves"),
            (Form::Wave, orders) => {
                let orders: Vec<String> = orders.iter().map(u32::to_string).collect();
                format!("waves of orders {} leave", orders.join(", "))
            }
            _ if found.sigmoids.len() == 1 => "a sigmoid leaves".to_string(),
            _ => format!("{} sigmoids leave", found.sigmoids.len()),
        };
        let count = parts.len();
        let gain = format!(
            "on rows left out in {count} parts in turn {what} {percent:.0} % less error than powers alone, better in {better} parts"
        );
        if is_only || (other <= CLEAR * powers && better >= MOST_PARTS.min(count)) {
            let why = if is_only { format!("it was the only requested form; {gain}") } else { gain };
            return (Some(taken(Some((total(1), count)))), FormsReport { tried, chosen: form, why });
        }
        let least = 100.0 * (1.0 - CLEAR);
        (None, self.kept(tried, format!("{gain}: a clear gain is {least:.0} % and {MOST_PARTS} parts")))
    }

    /// Compares a spline with the form that was accepted so far, which is better by cross-validation than the others. Returns whether the spline is
    /// accepted, its errors on each part, and the report.
    pub(crate) fn with_spline(
        &self,
        search: &splines::Search<'_>,
        report: Option<FormsReport>,
    ) -> (Option<Vec<Judged>>, FormsReport) {
        let before = report.unwrap_or_else(|| self.kept(vec![], String::new()));
        let refused = |why: &str| {
            let why = if before.why.is_empty() { why.to_string() } else { format!("{}; {why}", before.why) };
            (None, FormsReport { why, ..before.clone() })
        };
        if self.fit.rows() < LEAST_ROWS {
            return refused(&format!("a spline is not tried with fewer than {LEAST_ROWS} rows"));
        }
        let (Some(spline), Some(powers)) = (search.left_out(self.fit), self.powers_left_out()) else {
            return refused("the rows are too few, or too much on a line, for a spline");
        };
        let rmse = |judged: Judged| judged.statistics().map_or(f64::INFINITY, |statistics| statistics.rmse);
        let total = |parts: &[Judged]| rmse(parts.iter().fold(Judged::NOTHING, |sum, part| sum.and(*part)));
        let (own, alone) = (total(&spline), total(&powers));
        let better = spline.iter().zip(&powers).filter(|(spline, powers)| rmse(**spline) < rmse(**powers)).count();
        let mut tried = before.tried.clone();
        if tried.is_empty() {
            tried.push(Tried { form: Form::Polynomial, sigmoids: 0, orders: vec![], cells: vec![], rmse: Some(alone) });
        }
        let best = tried.iter().filter_map(|one| one.rmse).fold(f64::INFINITY, f64::min);
        let cells = search.run(self.fit).map_or_else(Vec::new, |(fitted, _)| fitted.spline.cells);
        tried.push(Tried { form: Form::Spline, sigmoids: 0, orders: vec![], cells, rmse: Some(own) });
        let count = spline.len();
        let percent = 100.0 * (1.0 - own / best);
        let gain = format!(
            "on rows left out in {count} parts in turn a spline leaves {percent:.0} % less error than the best other form, better than powers in {better} parts"
        );
        if own <= CLEAR * best && better >= MOST_PARTS.min(count) {
            return (Some(spline), FormsReport { tried, chosen: Form::Spline, why: gain });
        }
        let least = 100.0 * (1.0 - CLEAR);
        let why = format!("{gain}: a clear gain is {least:.0} % and {MOST_PARTS} parts");
        let why = if before.why.is_empty() { why } else { format!("{}; {why}", before.why) };
        (None, FormsReport { tried, chosen: before.chosen, why })
    }

    /// The errors of powers alone on each part.
    fn powers_left_out(&self) -> Option<Vec<Judged>> {
        let part_of = split::parts(&self.fit.groups, PARTS, 3);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        let round = |part: usize| {
            let (rest, out) = (self.fit.chosen(|row| part_of[row] != part), self.fit.chosen(|row| part_of[row] == part));
            self.errors(self.surface, self.highest_order()?, &rest, &out)
        };
        if count < 2 { None } else { (0..count).map(round).collect() }
    }

    fn kept(&self, tried: Vec<Tried>, why: String) -> FormsReport {
        FormsReport { tried, chosen: Form::Polynomial, why }
    }

    /// The highest order of candidate terms; `None` if terms were given.
    fn highest_order(&self) -> Option<u32> {
        match self.method {
            Method::Fixed(_) => None,
            Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => Some(*order),
            Method::Search(search) => Some(search.max_order),
        }
    }

    /// The errors on each part, for powers alone and for the form found again without that part.
    fn judged(&self, order: u32, again: &dyn Fn(&Sample) -> Option<Surface>) -> Option<Vec<[Judged; 2]>> {
        let part_of = split::parts(&self.fit.groups, PARTS, 3);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        if count < 2 {
            return None;
        }
        let round = |part: usize| {
            let (rest, out) = (self.fit.chosen(|row| part_of[row] != part), self.fit.chosen(|row| part_of[row] == part));
            let powers = self.errors(self.surface, self.highest_order()?, &rest, &out)?;
            // Without the form, if these rows do not show it.
            let other = again(&rest).unwrap_or_else(|| self.surface.clone());
            Some([powers, self.errors(&other, order, &rest, &out)?])
        };
        (0..count).map(round).collect()
    }

    /// The errors on some rows of a model chosen and fitted on others.
    fn errors(&self, surface: &Surface, order: u32, fit: &Sample, out: &Sample) -> Option<Judged> {
        let all = Design::new(surface, self.inputs, design::terms_up_to(surface, order));
        let (method, output_range) = (self.method, surface.output_range);
        let (design, coefficients) = if Searcher::is_for(method, all.width(), fit.rows()) {
            let searcher = Searcher { validate: self.validate, ..Searcher::of(&all, method, surface, fit) };
            let found = searcher.choose()?;
            (all.only(&found.terms), found.shrunk)
        } else {
            let triangle = fit.to_fit(&all);
            let selection = Selection {
                design: &all,
                method,
                output_range,
                fit,
                triangle: &triangle,
                validate: self.validate,
                random_split: None,
            };
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
