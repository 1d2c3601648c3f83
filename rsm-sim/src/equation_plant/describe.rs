//! Files of effects as descriptions: one for each place of a plant at which an effect is possible.
//!
//! In: the places of a plant, a catalogue. Out: [`Description`]s. This file contains no name of an effect.

use rsm_model::effects::{Catalogue, Effect as File, FormKind, Number, Place, SiteKind, Start, TraceRole};

use super::kept;
use crate::effect::declared::{
    Argument, Declared, Forms, FormsOf, Level, Part, Plausible, Possible, PossibleFromFile, Role, Step, Unit,
};
use crate::effect::{Arguments, Description, FromFile, Guess, Guesses, Scales, Subject, Survey, Wave};
use crate::equations::signals::spelled;
use crate::quantity::Bound;

/// A number is plausible up to this multiple of its largest first guess. The guesses cover the usual range.
const TIMES_THE_GUESS: f64 = 100.0;

/// Resonance frequencies at which a search starts, as shares of the sample rate, an octave apart: from a slow oscillation to the highest frequency
/// that the samples can just show.
const SHARES: [f64; 5] = [0.0125, 0.025, 0.05, 0.1, 0.2];

/// All descriptions of a plant.
pub(super) fn all(places: &[Place], parameters: &ParameterRoles, catalogue: &Catalogue) -> Vec<&'static Description> {
    let mut list: Vec<&'static Description> = Vec::new();
    for place in places {
        for offer in &place.effects {
            let Some(file) = catalogue.find(&offer.kind) else { continue };
            // A changed value of a parameter needs one description for all parameters, because no equation changes.
            if file.is_value() && list.iter().any(|it| it.kind == file.kind) {
                continue;
            }
            list.push(Box::leak(Box::new(one(place, file, &offer.units, parameters, true))));
        }
    }
    list
}

/// The descriptions of a plant of format 1, in the order of its list of effects. An effect acts at one place, which the plant file does not name,
/// except for outputs and parameters.
pub(super) fn of_first_format(
    places: &[Place],
    parameters: &ParameterRoles,
    catalogue: &Catalogue,
    kinds: &[String],
) -> Vec<&'static Description> {
    let mut list: Vec<&'static Description> = Vec::new();
    for kind in kinds {
        let Some(file) = catalogue.find(kind) else { continue };
        let offers = places.iter().filter_map(|place| Some((place, place.effects.iter().find(|it| it.kind == *kind)?)));
        let mut offers: Vec<_> = offers.collect();
        offers.sort_by_key(|(place, _)| !place.usual_for.contains(kind));
        for (place, offer) in offers {
            let is_one_place = place.kind != SiteKind::Output;
            if is_one_place && list.iter().any(|it| it.kind == *kind) {
                continue;
            }
            let mut found = one(place, file, &offer.units, parameters, false);
            if found.subject == Subject::Site {
                (found.subject, found.at) = (Subject::None, None);
                let prefix = format!("At {}: ", place.at);
                found.sentence = found.sentence.strip_prefix(prefix.as_str()).unwrap_or(found.sentence);
            }
            list.push(Box::leak(Box::new(found)));
        }
    }
    list
}

/// The roles of sites that are a parameter of the plant.
pub(super) struct ParameterRoles {
    /// For each the site, the role and the name of the parameter.
    pub(super) roles: Vec<(String, String, &'static str)>,
    /// The effect that changes the value of a parameter.
    pub(super) error: &'static str,
}

/// The simpler forms of an effect at a place. With `names_place` its parts name the place.
fn forms(file: &File, at: &'static str, parameters: &ParameterRoles, names_place: bool) -> FormsOf {
    if !file.has_forms() {
        return FormsOf::None;
    }
    let kinds: Vec<&'static str> = file.kinds_in_forms().map(kept).collect();
    let own: Vec<_> = parameters.roles.iter().filter(|it| it.0 == at).cloned().collect();
    let error_of_parameter = parameters.error;
    let file = file.clone();
    let of = move |arguments: &Arguments| -> Forms {
        let mut found = Forms::default();
        for form in file.forms(&arguments.numbers).unwrap_or_default() {
            let part = |(kind, value): &(String, f64)| {
                let kind = kinds.iter().find(|it| *it == kind)?;
                Some(Part { kind, subject: names_place.then_some(at), value: *value })
            };
            let Some(parts) = form.parts.iter().map(part).collect::<Option<Vec<Part>>>() else { continue };
            let error = |(role, value): &(String, f64)| {
                let parameter = own.iter().find(|it| it.1 == *role)?.2;
                Some(Part { kind: error_of_parameter, subject: Some(parameter), value: *value })
            };
            match form.is {
                FormKind::Special => found.special.push(parts),
                FormKind::Alike => found.alike = Some(parts),
                // A role that is no parameter has no error.
                FormKind::Level => {
                    let errors = form.values.iter().map(error).collect::<Option<Vec<Part>>>();
                    found.level = parts.first().zip(errors).map(|(of, errors)| Level { of: *of, errors });
                }
            }
        }
        found
    };
    FormsOf::File(Box::new(of))
}

/// Whether numbers of an effect are possible together, if its file has limits for them.
fn possible(file: &File) -> Possible {
    let file = Some(file.clone()).filter(File::has_limits);
    Possible(file.map(|file| -> Box<PossibleFromFile> { Box::new(move |it| file.are_possible(&it.numbers)) }))
}

fn one(place: &Place, file: &File, units: &[String], parameters: &ParameterRoles, names_place: bool) -> Description {
    let subject = match place.kind {
        SiteKind::Parameter => Subject::Parameter,
        SiteKind::Output => Subject::Output,
        _ => Subject::Site,
    };
    let is_value = file.is_value();
    let numbers: Vec<&Number> = file.numbers_on(place.kind).collect();
    let arguments: Vec<Argument> = numbers
        .iter()
        .zip(units)
        .map(|(number, unit)| argument(number, unit, is_value, file.has_default(&number.name)))
        .collect();
    let role = match file.role {
        _ if file.rounds_to.is_some() => Role::Rounding,
        Some(TraceRole::ReadingGain) => Role::ReadingGain,
        Some(TraceRole::ReadingLag) => Role::ReadingLag,
        Some(TraceRole::Delay) => Role::Delay,
        Some(TraceRole::Waves) => Role::Waves,
        None => Role::Ordinary,
    };
    let at = kept(&place.at);
    let (name, kind) = (kept(&file.kind), place.kind);
    let sentence = sentence(file, kind, is_value, at);
    let guesses: Box<FromFile> = if is_value {
        Box::new(|survey| vec![Guess::scaled(vec![another(survey.nominal)], survey.nominal)])
    } else {
        let file = file.clone();
        Box::new(move |survey| guesses(&file, kind, at, survey))
    };
    Description {
        kind: name,
        subject,
        at: (!is_value).then_some(at),
        arguments: Box::leak(arguments.into_boxed_slice()),
        sentence: kept(&sentence),
        check: kept(&file.words.check),
        guesses: Guesses(guesses),
        declared: Declared {
            role,
            generalises: file.generalises.as_deref().map(kept),
            forms: forms(file, at, parameters, names_place),
            possible: possible(file),
        },
    }
}

/// A changed value of a parameter: larger by 5 %. This is far more than finite differences need, and small enough for a linear response. A parameter
/// with the value 0 changes by 0.01 of its unit.
fn another(nominal: f64) -> f64 {
    if nominal == 0.0 { 0.01 } else { 1.05 * nominal }
}

fn argument(number: &Number, unit: &str, is_value: bool, is_optional: bool) -> Argument {
    let bound = match (number.min, number.max) {
        _ if number.is_whole => Bound::Count,
        (Some(low), Some(high)) => Bound::Between(low, high),
        (Some(min), None) if min >= 0.0 && (number.is_above_min || min > 0.0) => Bound::Positive,
        (Some(min), None) if min >= 0.0 => Bound::NotNegative,
        _ => Bound::Any,
    };
    let unit = if unit.is_empty() { "1".to_string() } else { without_brackets(&spelled(unit)) };
    let mut argument = Argument::new(kept(&number.name), Unit::Is(kept(&unit)), bound);
    (argument.is_level, argument.is_share) = (number.is_level, number.is_share);
    if is_value {
        argument = Argument { unit: Unit::OfSubject, ..argument }.plausible(Plausible::Parameter).step(Step::PerCent);
    } else if unit == "1" && number.scales_from_one() {
        argument = argument.step(Step::PerCent).plausible(Plausible::FactorOrUnit);
    } else {
        argument = argument.plausible(Plausible::TimesTheGuess(TIMES_THE_GUESS));
    }
    if is_optional { argument.optional() } else { argument }
}

/// A unit without brackets around its first part: `(rad/s)/s` is `rad/s/s`.
fn without_brackets(unit: &str) -> String {
    let parts = unit.strip_prefix('(').and_then(|it| it.split_once(')')).filter(|(inner, _)| !inner.contains('('));
    parts.map_or_else(|| unit.to_string(), |(inner, rest)| format!("{inner}{rest}"))
}

/// The sentence of a file at a place. Numbers that the effect does not have at this place are removed, and the name of the place is inserted.
fn sentence(file: &File, kind: SiteKind, is_value: bool, at: &str) -> String {
    let mut text = file.words.sentence.clone();
    for number in &file.numbers {
        if !file.numbers_on(kind).any(|it| it.name == number.name) {
            text = text.replace(&format!("{{{}}}", number.name), "");
        }
    }
    if is_value {
        return text.replace("{site}", "{parameter}");
    }
    let has_place = text.contains("{site}");
    let text = text.replace("{site}", at);
    // A sentence without the place gets it at its beginning, because the effect may be possible at several places.
    if has_place { text } else { format!("At {at}: {text}") }
}

/// Start points of a search.
fn guesses(file: &File, kind: SiteKind, at: &str, survey: &Survey) -> Vec<Guess> {
    if file.role == Some(TraceRole::Waves) && !survey.waves.is_empty() {
        return waves(file, kind, survey);
    }
    let mut sizes = sizes(at, survey);
    let mut starts: Vec<Start> = Vec::new();
    for share in SHARES {
        sizes.retain(|it| it.0 != "share");
        sizes.push(("share".to_string(), share));
        let named: Vec<(&str, f64)> = sizes.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        // If the place has no size that a guess needs, there is no guess.
        for start in file.starts(kind, &named).unwrap_or_default() {
            if !starts.contains(&start) {
                starts.push(start);
            }
        }
    }
    let order: Vec<&Number> = file.numbers_on(kind).collect();
    let place_of = |name: &str| order.iter().position(|it| it.name == name);
    starts
        .into_iter()
        .map(|start| {
            let value = |number: &&Number| start.numbers.iter().find(|it| it.0 == number.name).map_or(f64::NAN, |it| it.1);
            let own = |k: usize| start.numbers.get(k).and_then(|it| place_of(&it.0));
            Guess {
                values: order.iter().map(value).collect(),
                neutral: start.neutral.and_then(|(k, without)| Some((own(k)?, without))),
                phase: start.phase.and_then(own),
            }
        })
        .collect()
}

/// The waves over the position that the residuals show, as start points.
fn waves(file: &File, kind: SiteKind, survey: &Survey) -> Vec<Guess> {
    let order: Vec<&Number> = file.numbers_on(kind).collect();
    let place_of = |name: &str| order.iter().position(|it| it.name == name);
    let guess = |wave: &Wave| {
        let value = |number: &&Number| match number.name.as_str() {
            "amplitude" => wave.amplitude,
            "pitch" => wave.pitch,
            "phase" => wave.phase,
            _ => f64::NAN,
        };
        Guess {
            values: order.iter().map(value).collect(),
            neutral: place_of("amplitude").map(|place| (place, 0.0)),
            phase: place_of("phase"),
        }
    };
    survey.waves.iter().map(guess).collect()
}

/// The sizes that guesses at a place can use.
fn sizes(at: &str, survey: &Survey) -> Vec<(String, f64)> {
    let mut sizes: Vec<(String, f64)> =
        survey.scales.iter().find(|it: &&Scales| it.at == at).map_or_else(Vec::new, |it| it.sizes.clone());
    let mut add = |name: &str, value: f64| {
        if !sizes.iter().any(|it| it.0 == name) {
            sizes.push((name.to_string(), value));
        }
    };
    add("record_period", survey.period);
    add("record_length", survey.duration);
    if let Some(k) = survey.plant.output(at) {
        add("reading_scale", survey.largest[k]);
        add("reading_spread", survey.spread[k]);
        add("reading_lowest", survey.ends[k].0);
        add("reading_highest", survey.ends[k].1);
        add("reading_noise", survey.noise[k]);
        add("reading_step", survey.quantum[k].unwrap_or(3.0 * survey.noise[k]));
        add("signal", survey.largest[k]);
    }
    if let Some(value) = survey.parameters.optional(at) {
        add("signal", value);
    }
    add("input_scale", survey.input);
    add("input_lowest", -survey.input);
    add("input_highest", survey.input);
    sizes
}
