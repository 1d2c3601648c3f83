//! The rules for the parts of a fit specification. Each rule is one function.
//!
//! In: a [`Specification`] of the right shape. Out: faults. Rules that need the ranges run twice: here for ranges in the specification, and in the
//! fit for ranges from the data.

use rsm_core::model::{Outside, Symmetry};
use rsm_core::names;
use rsm_core::source::Collector;

use super::{
    Criterion, Form, Loss, MOST_FOR_SUBSETS, MOST_TERMS, Method, ResponseSpec, Search, SearchBy, Specification, Validation,
    categories, shape, transform,
};
use crate::design::{count_of_candidates, missing_odd_input};
use crate::units;

pub(super) fn check(specification: &Specification, faults: &mut Collector) {
    let rules = [
        check_model,
        check_validation,
        check_inputs,
        check_units,
        check_responses,
        check_basis,
        check_method,
        check_loss,
        check_noise,
        shape::check,
        categories::check,
        transform::check,
    ];
    for rule in rules {
        rule(specification, faults);
    }
    let written: Vec<_> = specification.inputs.iter().map(|input| input.range).collect();
    check_basis_against_ranges(specification, &written, faults);
}

fn check_model(specification: &Specification, faults: &mut Collector) {
    let stands = specification.source.is_none() || specification.places.place("model") != (0..0);
    if stands
        && let Some(reason) = names::refuse_model(&specification.model)
        && !specification.model.is_empty()
    {
        faults.push(specification.fault("model", format!("model name `{}` {reason}", specification.model)));
    }
}

fn check_validation(specification: &Specification, faults: &mut Collector) {
    for (key, rows) in [("validate", &specification.validation), ("test", &specification.test)] {
        let Validation::Split(split) = rows else { continue };
        if !(split.share > 0.0 && split.share < 1.0) {
            let what = format!("`{key}`: `share`: found {}, expected more than 0 and less than 1", split.share);
            faults.push(specification.fault(&format!("{key}.share"), what));
        }
        for name in &split.mirror {
            if specification.input(name).is_none() && !specification.places.is_broken(&format!("inputs.{name}")) {
                let known: Vec<String> = specification.inputs.iter().map(|input| format!("`{}`", input.name)).collect();
                let place = format!("{key}.mirror");
                let fault = specification.fault(&place, format!("`{key}`: `mirror`: there is no input `{name}`"));
                faults.push(fault.help(format!("the inputs are {}", known.join(", "))));
            }
        }
    }
}

fn check_inputs(specification: &Specification, faults: &mut Collector) {
    let inputs = &specification.inputs;
    for (k, input) in inputs.iter().enumerate() {
        let path = format!("inputs.{}", input.name);
        let clash = || inputs[..k].iter().find_map(|earlier| names::clash(&earlier.name, &input.name));
        if let Some(reason) = names::refuse(&input.name).or_else(clash) {
            faults.push(specification.fault(&path, format!("input name `{}` {reason}", input.name)));
        }
        if let Some([low, high]) = input.range
            && low >= high
        {
            let what = format!("input `{}`: `range`: low {low} is not below high {high}", input.name);
            let fault = specification.fault(&format!("{path}.range"), what);
            faults.push(if low > high { fault.help(format!("give the range as [{high}, {low}]")) } else { fault });
        }
        if let Some(period) = input.period {
            let place = format!("{path}.period");
            let who = format!("input `{}`", input.name);
            if input.outside == Outside::Extrapolate {
                let fault = specification.fault(&place, format!("{who}: `period`, and outside = \"extrapolate\""));
                faults.push(fault.help("a wave is known over one period only: use outside = \"clamp\""));
            }
            if let Some([low, high]) = input.range
                && high - low > period
            {
                let what = format!("{who}: the range from {low} to {high} is wider than the period {period}");
                faults.push(specification.fault(&place, what).help("give the input a range of one period at most"));
            }
        }
    }
    if inputs.is_empty() && !specification.places.has_broken_under("inputs") {
        faults.push(specification.fault("inputs", "`inputs`: found none, expected at least one"));
    }
}

fn check_units(specification: &Specification, faults: &mut Collector) {
    let of_inputs = specification.inputs.iter().map(|input| (format!("inputs.{}.unit", input.name), &input.unit));
    let of_responses = specification.responses.iter().map(|r| (format!("responses.{}.unit", r.surface.name), &r.unit));
    for (path, unit) in of_inputs.chain(of_responses) {
        if let Some(Err(reason)) = unit.as_ref().map(|unit| units::check(unit)) {
            faults.push(specification.fault(&path, format!("`unit`: {reason}")));
        }
    }
}

fn check_responses(specification: &Specification, faults: &mut Collector) {
    let responses = &specification.responses;
    for (k, response) in responses.iter().enumerate() {
        let name = &response.surface.name;
        let path = format!("responses.{name}");
        let clash = || responses[..k].iter().find_map(|earlier| names::clash_of_functions(&earlier.surface.name, name));
        if let Some(reason) = names::refuse_function(&specification.model, name).or_else(clash) {
            faults.push(specification.fault(&path, format!("response name `{name}` {reason}")));
        }
        if let Some([low, high]) = response.surface.output_range
            && low >= high
        {
            let what = format!("response `{name}`: `output_range`: low {low} is not below high {high}");
            faults.push(specification.fault(&format!("{path}.output_range"), what));
        }
        if response.surface.inputs.is_empty() {
            let what = format!("response `{name}`: `inputs`: found none, expected at least one");
            faults.push(specification.fault(&format!("{path}.inputs"), what));
        }
        for (k, input) in response.surface.inputs.iter().enumerate() {
            let place = format!("{path}.inputs.{k}");
            if response.surface.inputs[..k].contains(input) {
                faults.push(specification.fault(&place, format!("response `{name}`: input `{input}` is named twice")));
            } else if specification.input(input).is_none() && !specification.places.is_broken(&format!("inputs.{input}")) {
                let known: Vec<String> = specification.inputs.iter().map(|input| format!("`{}`", input.name)).collect();
                let fault = specification.fault(&place, format!("response `{name}`: there is no input `{input}`"));
                faults.push(fault.help(format!("the inputs are {}", known.join(", "))));
            }
        }
    }
    if responses.is_empty() && !specification.places.has_broken_under("responses") {
        faults.push(specification.fault("responses", "`responses`: found none, expected at least one"));
    }
}

/// Symmetry, knots, sigmoids and reciprocals must name inputs of the response, each once.
fn check_basis(specification: &Specification, faults: &mut Collector) {
    for response in &specification.responses {
        let surface = &response.surface;
        let who = format!("response `{}`", surface.name);
        let path = format!("responses.{}", surface.name);
        let mut known = |place: String, key: &str, input: &String| {
            if !surface.inputs.contains(input) {
                let what = format!("{who}: `{key}`: `{input}` is not an input of this response");
                faults.push(specification.fault(&place, what));
            }
        };
        for (input, _) in &surface.symmetry {
            known(format!("{path}.symmetry.{input}"), "symmetry", input);
        }
        for (k, knot) in surface.knots.iter().enumerate() {
            known(format!("{path}.knots.{k}"), "knots", &knot.input);
        }
        for (k, sigmoid) in surface.sigmoids.iter().enumerate() {
            known(format!("{path}.sigmoids.{k}"), "sigmoids", &sigmoid.input);
        }
        for (k, wave) in surface.waves.iter().enumerate() {
            known(format!("{path}.waves.{k}"), "waves", &wave.input);
        }
        for (k, input) in surface.reciprocal.iter().enumerate() {
            known(format!("{path}.reciprocal.{k}"), "reciprocal", input);
        }
        for (k, knot) in surface.knots.iter().enumerate() {
            if surface.knots[..k].contains(knot) {
                let what = format!("{who}: knot {}: occurs twice", k + 1);
                faults.push(specification.fault(&format!("{path}.knots.{k}"), what));
            }
        }
        for (k, sigmoid) in surface.sigmoids.iter().enumerate() {
            let place = format!("{path}.sigmoids.{k}");
            let who = format!("{who}: sigmoid {}", k + 1);
            if surface.sigmoids[..k].contains(sigmoid) {
                faults.push(specification.fault(&place, format!("{who}: occurs twice")));
            }
            if surface.reciprocal.contains(&sigmoid.input) {
                let what = format!("{who}: `{}` cannot have both `sigmoids` and `reciprocal`", sigmoid.input);
                faults.push(specification.fault(&place, what));
            }
        }
        for (k, input) in surface.reciprocal.iter().enumerate() {
            let place = format!("{path}.reciprocal.{k}");
            if surface.reciprocal[..k].contains(input) {
                faults.push(specification.fault(&place, format!("{who}: `reciprocal`: `{input}` occurs twice")));
            }
            if surface.symmetry.iter().any(|(symmetric, _)| symmetric == input) {
                let what = format!("{who}: `{input}` cannot have both `symmetry` and `reciprocal`");
                faults.push(specification.fault(&place, what));
            }
        }
    }
}

fn check_method(specification: &Specification, faults: &mut Collector) {
    for response in &specification.responses {
        let path = format!("responses.{}", response.surface.name);
        let who = format!("response `{}`", response.surface.name);
        match &response.method {
            Method::Fixed(_) if response.spline.is_some() => {}
            Method::Fixed(terms) => check_terms(specification, response, terms, faults),
            Method::FixedOrder(order) => check_count(specification, response, *order, &format!("{path}.select.order"), faults),
            Method::Ladder { max_order, confidence } => {
                check_count(specification, response, *max_order, &format!("{path}.select.max_order"), faults);
                if !(*confidence > 0.0 && *confidence <= 100.0) {
                    let what =
                        format!("{who}: `confidence`: found {confidence}, expected percent, more than 0 and at most 100");
                    faults.push(specification.fault(&format!("{path}.select.confidence"), what));
                }
            }
            Method::Search(search) => check_search(specification, response, search, faults),
        }
    }
}

/// A robust loss needs terms that are given or searched on weighted rows, and a form without a search: other criteria and proofs are for squared
/// errors.
fn check_loss(specification: &Specification, faults: &mut Collector) {
    for response in specification.responses.iter().filter(|response| response.loss != Loss::LeastSquares) {
        let name = &response.surface.name;
        let mut fault = |what: &str, help: &str| {
            let what = format!("response `{name}`: `loss`: \"{}\" {what}", response.loss.word());
            faults.push(specification.fault(&format!("responses.{name}.loss"), what).help(help));
        };
        let has_rows = specification.validation != Validation::None;
        let is_possible = match &response.method {
            Method::Fixed(_) | Method::FixedOrder(_) => true,
            Method::Ladder { .. } => false,
            Method::Search(search) => match search.criterion {
                Some(criterion) => matches!(criterion, Criterion::KFold | Criterion::Aicc),
                // The default is the error on validation rows.
                None => !has_rows,
            },
        };
        if !is_possible {
            fault(
                "needs given terms, or a search by \"k-fold\" or \"aicc\", which weights the rows: the other criteria are of squared errors of all rows",
                "use `select = { method = \"fixed\", ... }`, or \"stepwise\", \"best-subset\" or \"lasso\" with `criterion = \"k-fold\"`",
            );
        }
        if !response.constraints.is_empty() {
            fault("cannot be combined with `constraints`, which are proved for squared errors", "remove one of them");
        }
        if let Some((forms, given)) = searched_forms(specification, response) {
            fault(
                &format!("cannot be combined with a search of {forms}, which compares squared errors"),
                &format!("use `forms = [\"polynomial\"]`, and give {given} if they are known"),
            );
        }
    }
}

/// Autoregressive errors need terms that are given, or chosen by AICc, which is a function of whitened sums.
fn check_noise(specification: &Specification, faults: &mut Collector) {
    if !specification.series.is_empty() && !specification.has_series() {
        let fault = specification.fault("series", "`series` is for responses with `noise`, and no response has it");
        faults.push(fault.help("rows that must stay together in a split: `keep_together`"));
    }
    for response in specification.responses.iter().filter(|response| response.noise.is_some()) {
        let name = &response.surface.name;
        let mut fault = |what: &str, help: &str| {
            let what = format!("response `{name}`: `noise`: autoregressive errors {what}");
            faults.push(specification.fault(&format!("responses.{name}.noise"), what).help(help));
        };
        let is_possible = match &response.method {
            Method::Fixed(_) | Method::FixedOrder(_) => true,
            Method::Ladder { .. } => false,
            Method::Search(search) => search.criterion == Some(Criterion::Aicc) && search.by != SearchBy::Lasso,
        };
        if !is_possible {
            fault(
                "need given terms, or a choice by AICc of whitened rows: the other criteria take the rows as independent",
                "use `select = { method = \"fixed\", ... }`, or \"stepwise\" or \"best-subset\" with `criterion = \"aicc\"`",
            );
        }
        if !response.constraints.is_empty() {
            fault("cannot be combined with `constraints`, whose cost is that of independent rows", "remove one of them");
        }
        if response.loss != Loss::LeastSquares {
            fault("cannot be combined with a robust `loss`, whose weights take the rows as independent", "remove one of them");
        }
        if let Some((forms, given)) = searched_forms(specification, response) {
            fault(
                &format!("cannot be combined with a search of {forms}, which compares errors of independent rows"),
                &format!("use `forms = [\"polynomial\"]`, and give {given} if they are known"),
            );
        }
    }
}

/// The forms that the data choose, for a method that does not try them by itself, and the keys by which they are given.
fn searched_forms(specification: &Specification, response: &ResponseSpec) -> Option<(&'static str, &'static str)> {
    let is_periodic = |name: &String| specification.input(name).is_some_and(|input| input.period.is_some());
    let searches_waves = response.forms.is_none() && response.surface.inputs.iter().any(is_periodic);
    let forms = response.forms.as_deref().unwrap_or_default();
    if forms.contains(&Form::Hinge) {
        return Some(("hinges, sigmoids or waves", "`knots`, `sigmoids` or `waves`"));
    }
    (searches_waves || forms.iter().any(|form| *form != Form::Polynomial))
        .then_some(("sigmoids or waves", "`sigmoids` or `waves`"))
}

fn check_search(specification: &Specification, response: &ResponseSpec, search: &Search, faults: &mut Collector) {
    let path = format!("responses.{}.select", response.surface.name);
    let who = format!("response `{}`", response.surface.name);
    check_count(specification, response, search.max_order, &format!("{path}.max_order"), faults);
    let candidates = count_of_candidates(&response.surface, search.max_order);
    let mut fault = |key: &str, what: String, help: &str| {
        faults.push(specification.fault(&format!("{path}.{key}"), format!("{who}: {what}")).help(help));
    };
    if search.by == SearchBy::BestSubset && candidates > MOST_FOR_SUBSETS && candidates <= MOST_TERMS {
        let what = format!("method \"best-subset\": {candidates} candidates, at most {MOST_FOR_SUBSETS} are searched");
        fault("method", what, "lower `max_order`, or use \"stepwise\" or \"lasso\"");
    }
    if !(3..=100).contains(&search.parts) {
        let what = format!("`parts`: found {}, expected a whole number from 3 to 100", search.parts);
        fault("parts", what, "10 is usual");
    }
    match search.criterion {
        Some(Criterion::HeldOut) if specification.validation == Validation::None => {
            let what = "criterion \"held-out\" needs rows that are held out".to_string();
            fault("criterion", what, "add `validate = { share = 0.3, seed = 7 }`, or use \"k-fold\"");
        }
        Some(criterion @ (Criterion::Press | Criterion::Aicc)) => {
            if search.one_standard_error {
                let what = format!("`one_standard_error`: criterion \"{}\" has no standard error", criterion.word());
                fault("one_standard_error", what, "use it with \"k-fold\" or \"held-out\"");
            }
            if criterion == Criterion::Press && search.by == SearchBy::Lasso {
                let what = "criterion \"press\" is for least squares; method \"lasso\" penalises the coefficients".to_string();
                fault("criterion", what, "use \"k-fold\", \"held-out\" or \"aicc\"");
            }
        }
        _ => {}
    }
}

fn check_count(specification: &Specification, response: &ResponseSpec, order: u32, path: &str, faults: &mut Collector) {
    let surface = &response.surface;
    let width = surface.width();
    let count = count_of_candidates(surface, order);
    if count > MOST_TERMS {
        let what = format!(
            "response `{}`: {width} variables at order {order} make {count} terms, at most {MOST_TERMS} are accepted",
            surface.name
        );
        faults.push(specification.fault(path, what));
    } else if surface.symmetry.iter().filter(|(_, kind)| *kind == Symmetry::Odd).count() > order as usize {
        let what = format!("response `{}`: no term of order {order} holds every odd input", surface.name);
        faults.push(specification.fault(path, what));
    }
}

fn check_terms(specification: &Specification, response: &ResponseSpec, terms: &[Vec<u32>], faults: &mut Collector) {
    let surface = &response.surface;
    let path = format!("responses.{}.terms", surface.name);
    let who = format!("response `{}`", surface.name);
    if terms.is_empty() {
        faults.push(specification.fault(&path, format!("{who}: `terms`: found none, expected at least one")));
    }
    if terms.len() > MOST_TERMS {
        let what = format!("{who}: `terms`: found {}, at most {MOST_TERMS} are accepted", terms.len());
        faults.push(specification.fault(&path, what));
    }
    let (inputs, knots, sigmoids) = (surface.inputs.len(), surface.knots.len(), surface.sigmoids.len());
    for (k, powers) in terms.iter().enumerate() {
        let place = format!("{path}.{k}");
        if powers.len() != surface.width() {
            let knots = match knots {
                0 => String::new(),
                1 => " and for the knot".to_string(),
                _ => format!(" and {knots} knots"),
            };
            let sigmoids = match sigmoids {
                0 => String::new(),
                1 => " and for the sigmoid".to_string(),
                _ => format!(" and {sigmoids} sigmoids"),
            };
            let waves = match surface.waves.len() {
                0 => String::new(),
                waves => format!(" and two for each of {waves} waves"),
            };
            let expected = format!("one for each of {inputs} inputs{knots}{sigmoids}{waves}");
            let what = format!("{who}: term {}: found {} powers, expected {expected}", k + 1, powers.len());
            faults.push(specification.fault(&place, what));
            continue;
        }
        if let Some(first) = terms[..k].iter().position(|earlier| earlier == powers) {
            let what = format!("{who}: term {}: powers {powers:?} occur twice, first in term {}", k + 1, first + 1);
            faults.push(specification.fault(&place, what));
        }
        if let Some(input) = missing_odd_input(surface, powers) {
            let what = format!("{who}: term {}: `{input}` is odd, and this term does not contain it", k + 1);
            let help = format!("give every term a power of `{input}`, else the surface jumps at {input} = 0");
            faults.push(specification.fault(&place, what).help(help));
        }
    }
}

/// The requirements of symmetry, knots, sigmoids and reciprocals on the ranges; `ranges` has one entry for each input, if it is known.
pub(crate) fn check_basis_against_ranges(specification: &Specification, ranges: &[Option<[f64; 2]>], faults: &mut Collector) {
    let range_of = |name: &str| {
        let index = specification.inputs.iter().position(|input| input.name == name);
        index.and_then(|index| ranges[index])
    };
    for response in &specification.responses {
        let surface = &response.surface;
        let who = format!("response `{}`", surface.name);
        let path = format!("responses.{}", surface.name);
        for (input, _) in &surface.symmetry {
            if let Some([low, high]) = range_of(input)
                && surface.inputs.contains(input)
                && low != -high
            {
                let what = format!("{who}: `symmetry` of `{input}`: its range [{low}, {high}] is not symmetric about 0");
                faults.push(specification.fault(&format!("{path}.symmetry.{input}"), what));
            }
        }
        for (k, knot) in surface.knots.iter().enumerate() {
            let name = &knot.input;
            let Some([low, high]) = range_of(name) else { continue };
            let low = if surface.symmetry.iter().any(|(input, _)| input == name) { 0.0 } else { low };
            if !(low < knot.at && knot.at < high) {
                let what =
                    format!("{who}: knot {}: found {name} = {}, expected a value between {low} and {high}", k + 1, knot.at);
                faults.push(specification.fault(&format!("{path}.knots.{k}"), what));
            }
        }
        for (k, sigmoid) in surface.sigmoids.iter().enumerate() {
            let Some(range) = range_of(&sigmoid.input) else { continue };
            if let Err((what, help)) = rsm_core::check::sigmoid_fits(sigmoid, range) {
                let fault = specification.fault(&format!("{path}.sigmoids.{k}"), format!("{who}: sigmoid {}: {what}", k + 1));
                faults.push(fault.help(help));
            }
        }
        for (k, name) in surface.reciprocal.iter().enumerate() {
            if let Some([low, high]) = range_of(name)
                && low <= 0.0
                && high >= 0.0
            {
                let what = format!("{who}: `reciprocal` of `{name}`: its range [{low}, {high}] contains 0");
                let fault = specification.fault(&format!("{path}.reciprocal.{k}"), what);
                faults.push(fault.help("give the input a range on one side of 0"));
            }
        }
    }
}
