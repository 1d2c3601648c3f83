//! Chooses the form of a response: powers of its inputs, also sigmoids or hinges of them, or waves over a periodic input.
//!
//! In: a response, its rows, the method of choosing terms. Out: the bends or waves to add, if any, with a report of what was tried. Sigmoids and
//! hinges are found on the rows to fit ([`bends`]), orders of waves too ([`waves`]). Each form is then fitted without each of five parts of the rows
//! in turn: its places are refined, the terms are chosen again, and the errors on the omitted part are computed. A form is accepted if these errors
//! are clearly smaller than those of powers. Of sigmoids and hinges the better one is taken. Test rows are not used.

mod bends;
mod hinges;
mod sigmoids;
pub(crate) mod splines;
mod waves;

use std::cell::OnceCell;
use std::marker::PhantomData;

use nalgebra::DVector;
use rsm_core::model::{Input, Knot, Sigmoid, Surface, Wave};

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

/// Why a form without a gain is taken.
const ONLY: &str = "it was the only requested form";

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
    /// The errors of powers alone on each part, once they are known.
    pub powers: OnceCell<Option<Vec<Judged>>>,
}

/// The accepted form.
pub(crate) struct Taken {
    pub knots: Vec<Knot>,
    pub sigmoids: Vec<Sigmoid>,
    pub waves: Vec<Wave>,
    /// The highest order of a candidate term.
    pub order: u32,
    /// The errors on omitted rows, and the number of parts.
    pub judged: Option<(Judged, usize)>,
}

impl FormsReport {
    /// The same with a further reason.
    fn with(self, why: &str) -> Self {
        let why = [&self.why[..], why].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ");
        FormsReport { why, ..self }
    }

    /// The same with a first reason.
    fn because(mut self, why: &str) -> Self {
        let own = std::mem::replace(&mut self.why, why.to_string());
        self.with(&own)
    }
}

/// The result of a search of sigmoids or hinges: their comparison with powers, or why there is none.
type Attempt = Result<(Option<Taken>, FormsReport), String>;

impl Forms<'_> {
    /// The form to add and the report; neither if no other form was tried.
    pub(crate) fn choose(&self, wanted: Option<&[Form]>) -> (Option<Taken>, Option<FormsReport>) {
        let Some(highest) = self.highest_order() else { return (None, None) };
        let may = |form| wanted.is_none_or(|forms| forms.contains(&form));
        let is_only = wanted.is_some_and(|forms| !forms.contains(&Form::Polynomial));
        // Without a request, constraints keep the form that they were given for.
        let may_be_constrained = |form| !self.is_constrained || wanted.is_some_and(|forms| forms.contains(&form));
        let is_free = self.surface.width() == self.surface.inputs.len() + self.surface.knots.len();
        let has_rows = is_free && self.fit.rows() >= LEAST_ROWS && self.free_inputs().len() <= MOST_INPUTS;
        let mut report = None;
        if has_rows && may(Form::Wave) && may_be_constrained(Form::Wave) && self.periods.iter().any(Option::is_some) {
            let search = waves::Search { surface: self.surface, inputs: self.inputs, periods: &self.periods, highest };
            let (taken, said) = match search.run(self.fit) {
                Some(found) => self.compared(Form::Wave, &found, highest, is_only, &|rest| search.run(rest)),
                None => (None, self.kept(vec![], "no wave over an input with a period is above the noise".to_string())),
            };
            if taken.is_some() {
                return (taken, Some(if is_only { said.because(ONLY) } else { said }));
            }
            report = Some(said);
        }
        let tries = |form| may(form) && may_be_constrained(form);
        let mut attempts = Vec::new();
        if tries(Form::Sigmoid) && (wanted.is_some() || self.is_open) {
            attempts.push(self.sigmoids(has_rows, highest, is_only));
        }
        if tries(Form::Hinge) && wanted.is_some() {
            attempts.push(self.hinges(has_rows, highest, is_only));
        }
        if attempts.is_empty() {
            return (None, report);
        }
        let (judged, missing): (Vec<_>, Vec<_>) = attempts.into_iter().partition(Result::is_ok);
        let judged = judged.into_iter().flatten().reduce(better);
        let missing: Vec<String> = missing.into_iter().filter_map(Result::err).collect();
        match judged {
            Some((taken, said)) => {
                let said = missing.into_iter().fold(said, |said, why| said.with(&why));
                let only = if tries(Form::Sigmoid) && tries(Form::Hinge) { "powers alone were not requested" } else { ONLY };
                let said = if is_only && taken.is_some() { said.because(only) } else { said };
                (taken, Some(said))
            }
            None => (None, report.or(wanted.map(|_| self.kept(vec![], missing.join("; "))))),
        }
    }

    /// Looks for sigmoids and compares them with powers.
    fn sigmoids(&self, has_rows: bool, highest: u32, is_only: bool) -> Attempt {
        if !has_rows || !self.surface.reciprocal.is_empty() {
            let why =
                "there are too few rows, too many inputs, or inputs that enter by their reciprocal: no sigmoid was looked for";
            return Err(why.to_string());
        }
        let search = self.search::<sigmoids::Sigmoids>(self.free_inputs(), highest);
        let Some(found) = search.run(self.fit, is_only) else {
            return Err("no sigmoid explains clearly more of the fitted rows than powers do".to_string());
        };
        let bent = |sigmoids: Vec<Sigmoid>| Surface { sigmoids, ..self.surface.clone() };
        let again = |rest: &Sample| search.refined(rest, &found.bends, found.order).map(bent);
        Ok(self.compared(Form::Sigmoid, &bent(found.bends.clone()), found.order, is_only, &again))
    }

    /// Looks for hinges and compares them with powers.
    fn hinges(&self, has_rows: bool, highest: u32, is_only: bool) -> Attempt {
        let is_open = |input: &usize| {
            let name = &self.surface.inputs[*input];
            self.periods.get(*input).is_none_or(Option::is_none) && !self.surface.reciprocal.contains(name)
        };
        let open: Vec<usize> = self.free_inputs().into_iter().filter(is_open).collect();
        if !has_rows || open.is_empty() {
            let why =
                "there are too few rows, too many inputs, or only inputs that cannot have a hinge: no hinge was looked for";
            return Err(why.to_string());
        }
        let search = self.search::<hinges::Hinges>(open, highest);
        let Some(found) = search.run(self.fit, is_only) else {
            return Err("no hinge explains clearly more of the fitted rows than powers do".to_string());
        };
        let bent = |knots: Vec<Knot>| Surface { knots: [&self.surface.knots[..], &knots].concat(), ..self.surface.clone() };
        let again = |rest: &Sample| search.refined(rest, &found.bends, found.order).map(bent);
        Ok(self.compared(Form::Hinge, &bent(found.bends.clone()), found.order, is_only, &again))
    }

    fn search<K: bends::Kind>(&self, open: Vec<usize>, highest: u32) -> bends::Search<'_, K> {
        let (surface, inputs) = (self.surface, self.inputs);
        bends::Search { surface, inputs, open, highest, most_candidates: MOST_CANDIDATES, kind: PhantomData }
    }

    /// The inputs that are no contrasts.
    fn free_inputs(&self) -> Vec<usize> {
        (0..self.inputs.len()).filter(|k| !self.surface.is_contrast(&self.inputs[*k].name)).collect()
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
        let knots = &found.knots[self.surface.knots.len()..];
        let taken = |judged| {
            let (knots, sigmoids, waves) = (knots.to_vec(), found.sigmoids.clone(), found.waves.clone());
            Taken { knots, sigmoids, waves, order, judged }
        };
        let (sigmoids, hinges) = (found.sigmoids.len(), knots.len());
        let tried = |rmse| Tried { form, sigmoids, hinges, orders: orders.clone(), cells: vec![], rmse };
        let Some(parts) = self.judged(order, again) else {
            if is_only {
                return (Some(taken(None)), FormsReport { tried: vec![tried(None)], chosen: form, why: String::new() });
            }
            return (None, self.kept(vec![], "the rows are too few to leave parts of them out".to_string()));
        };
        let total = |which: usize| parts.iter().fold(Judged::NOTHING, |sum, part| sum.and(part[which]));
        let rmse = |judged: Judged| judged.rmse_of_terms();
        let [powers, other] = [0, 1].map(|which| rmse(total(which)).unwrap_or(f64::INFINITY));
        let better = parts.iter().filter(|[powers, other]| rmse(*other) < rmse(*powers)).count();
        let tried = vec![without_bends(Form::Polynomial, vec![], powers), tried(Some(other))];
        let percent = 100.0 * (1.0 - other / powers);
        let what = match (form, &orders[..]) {
            (Form::Wave, [one]) => format!("a wave of order {one} leaves"),
            (Form::Wave, orders) => {
                let orders: Vec<String> = orders.iter().map(u32::to_string).collect();
                format!("waves of orders {} leave", orders.join(", "))
            }
            (Form::Hinge, _) if hinges == 1 => "a hinge leaves".to_string(),
            (Form::Hinge, _) => format!("{hinges} hinges leave"),
            _ if sigmoids == 1 => "a sigmoid leaves".to_string(),
            _ => format!("{sigmoids} sigmoids leave"),
        };
        let count = parts.len();
        let gain = format!(
            "on rows left out in {count} parts in turn {what} {percent:.0} % less error than powers alone, better in {better} parts"
        );
        if is_only || (other <= CLEAR * powers && better >= MOST_PARTS.min(count)) {
            return (Some(taken(Some((total(1), count)))), FormsReport { tried, chosen: form, why: gain });
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
        let refused = |why: &str| (None, before.clone().with(why));
        if self.fit.rows() < LEAST_ROWS {
            return refused(&format!("a spline is not tried with fewer than {LEAST_ROWS} rows"));
        }
        let (Some(spline), Some(powers)) = (search.left_out(self.fit), self.powers_left_out()) else {
            return refused("the rows are too few, or too much on a line, for a spline");
        };
        let rmse = |judged: Judged| judged.rmse_of_terms().unwrap_or(f64::INFINITY);
        let total = |parts: &[Judged]| rmse(parts.iter().fold(Judged::NOTHING, |sum, part| sum.and(*part)));
        let (own, alone) = (total(&spline), total(&powers));
        let better = spline.iter().zip(&powers).filter(|(spline, powers)| rmse(**spline) < rmse(**powers)).count();
        let mut tried = before.tried.clone();
        if tried.is_empty() {
            tried.push(without_bends(Form::Polynomial, vec![], alone));
        }
        let best = tried.iter().filter_map(|one| one.rmse).fold(f64::INFINITY, f64::min);
        let cells = search.run(self.fit).map_or_else(Vec::new, |(fitted, _)| fitted.spline.cells);
        tried.push(without_bends(Form::Spline, cells, own));
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
        (None, FormsReport { tried, ..before }.with(&why))
    }

    /// The errors of powers alone on each part.
    fn powers_left_out(&self) -> Option<Vec<Judged>> {
        let errors = |rest: &Sample, out: &Sample| self.errors(self.surface, self.highest_order()?, rest, out);
        self.powers.get_or_init(|| self.left_out(&errors)).clone()
    }

    /// Calls a function for each part, with the rows of the other parts and its own; `None` if there are too few parts, or if a call returns `None`.
    fn left_out(&self, errors: &dyn Fn(&Sample, &Sample) -> Option<Judged>) -> Option<Vec<Judged>> {
        let part_of = split::parts(&self.fit.groups, PARTS, 3);
        let count = part_of.iter().max().map_or(0, |most| most + 1);
        let round =
            |part: usize| errors(&self.fit.chosen(|row| part_of[row] != part), &self.fit.chosen(|row| part_of[row] == part));
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
        let powers = self.powers_left_out()?;
        let other = self.left_out(&|rest, out| {
            // Without the form, if these rows do not show it.
            let other = again(rest).unwrap_or_else(|| self.surface.clone());
            self.errors(&other, order, rest, out)
        })?;
        Some(powers.into_iter().zip(other).map(|(powers, other)| [powers, other]).collect())
    }

    /// The errors on some rows of a model chosen and fitted on others.
    fn errors(&self, surface: &Surface, order: u32, fit: &Sample, out: &Sample) -> Option<Judged> {
        let chosen_hinges = surface.knots.len() - self.surface.knots.len();
        let all = Design::new(surface, self.inputs, design::terms_with_hinges(surface, chosen_hinges, order));
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

/// A form that was tried and has neither bends nor waves.
fn without_bends(form: Form, cells: Vec<u32>, rmse: f64) -> Tried {
    Tried { form, sigmoids: 0, hinges: 0, orders: vec![], cells, rmse: Some(rmse) }
}

/// Of two forms that were compared with powers, the accepted one, or the one with the smaller error if both were accepted. The report is of both.
fn better(
    (taken, said): (Option<Taken>, FormsReport),
    (other_taken, other_said): (Option<Taken>, FormsReport),
) -> (Option<Taken>, FormsReport) {
    let error = |taken: &Option<Taken>| {
        let (judged, _) = taken.as_ref()?.judged?;
        judged.rmse_of_terms()
    };
    let is_other = match (&taken, &other_taken) {
        (Some(_), Some(_)) => error(&other_taken).unwrap_or(f64::INFINITY) < error(&taken).unwrap_or(f64::INFINITY),
        (first, _) => first.is_none(),
    };
    let mut tried = said.tried.clone();
    tried.extend(other_said.tried.iter().filter(|one| !said.tried.iter().any(|known| known.form == one.form)).cloned());
    let (taken, said, other) = if is_other { (other_taken, other_said, said) } else { (taken, said, other_said) };
    (taken, FormsReport { tried, ..said.with(&other.why) })
}
