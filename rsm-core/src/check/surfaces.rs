//! Rules of surfaces: inputs, terms, reciprocal, support.
//!
//! In: the surfaces of a model. Out: faults at their parts.

use super::context::{Context, any_under, check_range};
use super::forms::{check_categories, check_knots, check_sigmoids, check_spline, check_symmetry, check_transform, check_waves};
use crate::model::{Input, Surface};
use crate::names;
use crate::source::{Collector, Faults};

pub(super) fn check_surfaces(context: &Context<'_>, faults: &mut Collector) {
    for surface in &context.model().surfaces {
        let path = format!("surfaces.{}", surface.name);
        if let Some(reason) = names::refuse_function(&context.model().name, &surface.name) {
            faults.push(context.fault(&path, format!("surface name `{}` {reason}", surface.name)));
        }
        let rules = [
            check_surface_inputs,
            check_terms,
            check_spline,
            check_symmetry,
            check_knots,
            check_sigmoids,
            check_waves,
            check_reciprocal,
            check_categories,
            check_support,
        ];
        let mut own = Collector::new();
        for rule in rules {
            rule(context, &mut own, surface, &path);
        }
        let is_sound = own.is_clean();
        own.finish(Some(())).err().iter().flat_map(Faults::list).for_each(|fault| faults.push(fault.clone()));
        if is_sound {
            check_transform(context, faults, surface, &path);
        }
        if let Some(range) = surface.output_range {
            let who = format!("surface `{}`: `output_range`", surface.name);
            check_range(context, faults, &who, &format!("{path}.output_range"), range, &surface.unit);
        }
    }
    if context.model().surfaces.is_empty() && !any_under(context, "surfaces") {
        faults.push(context.fault("surfaces", "`surfaces`: found none, expected at least one"));
    }
}

pub(super) fn check_surface_inputs(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    if surface.inputs.is_empty() && !context.is_broken(&format!("{path}.inputs")) {
        faults.push(context.fault(&format!("{path}.inputs"), format!("{who}: `inputs`: found none, expected at least one")));
    }
    for (k, name) in surface.inputs.iter().enumerate() {
        let place = format!("{path}.inputs.{k}");
        if surface.inputs[..k].contains(name) {
            faults.push(context.fault(&place, format!("{who}: input `{name}` is named twice")));
        } else if context.model().input(name).is_none() && context.knows_all("inputs", name) {
            let known: Vec<_> = context.model().inputs.iter().map(|input| format!("`{}`", input.name)).collect();
            let fault = context.fault(&place, format!("{who}: there is no input `{name}`"));
            faults.push(fault.help(format!("the inputs of this model are {}", known.join(", "))));
        }
    }
}

pub(super) fn check_terms(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    let has_spline = surface.spline.is_some() || context.is_broken(&format!("{path}.spline"));
    if surface.terms.is_empty() && !has_spline && !context.is_broken(&format!("{path}.terms")) {
        faults.push(context.fault(&format!("{path}.terms"), format!("{who}: `terms`: found none, expected at least one")));
    }
    let (inputs, knots, sigmoids) = (surface.inputs.len(), surface.knots.len(), surface.sigmoids.len());
    let waves = surface.waves.len();
    // The number of powers of a term can be checked only if the inputs and the coding could be read.
    let counts = !context.is_broken(&format!("{path}.inputs")) && !context.is_broken(&format!("{path}.basis"));
    for (k, term) in surface.terms.iter().enumerate() {
        let place = format!("{path}.terms.{k}");
        let found = term.powers.len();
        if counts && found != surface.width() {
            let expected = match (knots, sigmoids + waves) {
                (0, 0) => format!("{inputs}, one for each input"),
                (_, 0) => format!("{}: one for each of {inputs} inputs, then one for each of {knots} knots", inputs + knots),
                _ if waves == 0 => format!(
                    "{}: one for each of {inputs} inputs, then of {knots} knots, then of {sigmoids} sigmoids",
                    surface.width()
                ),
                _ => format!(
                    "{}: one for each of {inputs} inputs, then of {knots} knots, then of {sigmoids} sigmoids, then two for each of {waves} waves",
                    surface.width()
                ),
            };
            faults.push(context.fault(&place, format!("{who}: term {}: found {found} powers, expected {expected}", k + 1)));
        }
        if let Some(first) = surface.terms[..k].iter().position(|earlier| earlier.powers == term.powers) {
            let powers = &term.powers;
            let what = format!("{who}: term {}: powers {powers:?} occur twice, first in term {}", k + 1, first + 1);
            faults.push(context.fault(&place, what).help("add the two coefficients and keep one term"));
        }
    }
}

pub(super) fn check_reciprocal(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    for (k, name) in surface.reciprocal.iter().enumerate() {
        let place = format!("{path}.reciprocal.{k}");
        if !surface.inputs.contains(name) {
            faults.push(context.fault(&place, format!("{who}: `reciprocal`: `{name}` is not an input of this surface")));
        } else if surface.reciprocal[..k].contains(name) {
            faults.push(context.fault(&place, format!("{who}: `reciprocal`: `{name}` occurs twice")));
        } else if let Some(Input { range: [low, high], .. }) = context.model().input(name)
            && *low <= 0.0
            && *high >= 0.0
        {
            let what = format!("{who}: `reciprocal` of `{name}`: its range [{low}, {high}] contains 0");
            faults.push(context.fault(&place, what).help("give the input a range on one side of 0"));
        }
    }
}

pub(super) fn check_support(context: &Context<'_>, faults: &mut Collector, surface: &Surface, path: &str) {
    let who = format!("surface `{}`", surface.name);
    for (k, space) in surface.support.iter().enumerate() {
        let place = format!("{path}.support.{k}");
        let (found, expected) = (space.normal.len(), surface.inputs.len());
        if found != expected {
            let what =
                format!("{who}: half-space {}: found {found} numbers in `normal`, expected {expected}, one an input", k + 1);
            faults.push(context.fault(&place, what));
        } else if space.normal.iter().all(|entry| *entry == 0.0) {
            faults.push(context.fault(&place, format!("{who}: half-space {}: `normal` is zero", k + 1)));
        }
    }
}
