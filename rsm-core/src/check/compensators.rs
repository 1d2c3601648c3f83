//! Rules of compensators and their schedules.
//!
//! In: the compensators of a model. Out: faults at their parts.

use super::context::Context;
use super::fits::{BEYOND, beyond_ratio, fits_fixed, fits_ratio, schedule};
use crate::model::Compensator;
use crate::names;
use crate::number::Precision;
use crate::source::Collector;

pub(super) fn check_compensators(context: &Context<'_>, faults: &mut Collector) {
    for compensator in &context.model().compensators {
        let path = format!("compensators.{}", compensator.name);
        if let Some(reason) = names::refuse_function(&context.model().name, &compensator.name) {
            faults.push(context.fault(&path, format!("compensator name `{}` {reason}", compensator.name)));
        }
        if compensator.sample_time <= 0.0 {
            let what = format!(
                "compensator `{}`: `sample_time`: found {} s, expected more than 0",
                compensator.name, compensator.sample_time
            );
            faults.push(context.fault(&format!("{path}.sample_time"), what));
        }
        if compensator.sample_time > 0.0 && !fits_fixed(Precision::F64, compensator.sample_time) {
            let what =
                format!("compensator `{}`: `sample_time`: {:e} s is {BEYOND} f64", compensator.name, compensator.sample_time);
            faults.push(context.fault(&format!("{path}.sample_time"), what));
        }
        check_scheduled(context, faults, compensator, &path);
        if !fits_ratio(Precision::F64, compensator) {
            faults.push(context.fault(&format!("{path}.pole_frequency"), beyond_ratio(compensator, "f64")));
        }
        for input in schedule(context.model(), compensator) {
            if let Some(reason) = names::refuse_scheduled(&input.name) {
                let what = format!("compensator `{}`: the input name `{}` {reason}", compensator.name, input.name);
                faults.push(context.fault(&format!("inputs.{}", input.name), what));
            }
        }
    }
}

pub(super) fn check_scheduled(context: &Context<'_>, faults: &mut Collector, compensator: &Compensator, path: &str) {
    let who = format!("compensator `{}`", compensator.name);
    for (key, scheduled) in compensator.parts() {
        let place = format!("{path}.{key}");
        if let Some(value) = scheduled.fixed()
            && value <= 0.0
        {
            faults.push(context.fault(&place, format!("{who}: `{key}`: found {value}, expected more than 0")));
        } else if let Some(value) = scheduled.fixed()
            && !fits_fixed(Precision::F64, value)
        {
            faults.push(context.fault(&place, format!("{who}: `{key}`: {value:e} is {BEYOND} f64")));
        }
        for name in scheduled.surfaces() {
            if context.model().surface(name).is_some_and(|surface| surface.spline.is_some()) {
                let what = format!("{who}: `{key}`: the surface `{name}` is a spline");
                let help = "the proof of stability is about polynomials: give the surface terms";
                faults.push(context.fault(&place, what).help(help));
            }
            if let Some(transform) = context.model().surface(name).and_then(|surface| surface.transform) {
                let what = format!("{who}: `{key}`: the surface `{name}` has the transform \"{}\"", transform.word());
                let help = "the proof of stability is about polynomials: fit the surface without a transform";
                faults.push(context.fault(&place, what).help(help));
            }
            if context.model().surface(name).is_none() && context.knows_all("surfaces", name) {
                faults.push(context.fault(&place, format!("{who}: `{key}`: there is no surface `{name}`")));
            }
        }
    }
}
