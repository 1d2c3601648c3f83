//! First guesses for the parameters of an effect.
//!
//! In: an effect, scales of the records and of the site. Out: lists of its parameters, and the values at which it has no effect. This module reads
//! no records.

use std::collections::HashMap;

use rsm_core::source::Faults;

use super::file::{Effect, Number};
use super::known::{known_number, scratch};
use super::site::SiteKind;
use crate::flat::Flat;
use crate::syntax::tree::Expression;

/// Scales that guesses may use in addition to the roles of the site: the effort that the inputs can cause at the site; typical speed; largest
/// position, level, twist or temperature, its lowest value and its span; largest value and spread of the reading, its lowest and highest value, its
/// step and its noise; largest magnitude, lowest and highest value of the input; heat flow; sample period and length of the longest record in s; a
/// resonance frequency as a share of the sample rate.
pub const SCALES: [&str; 18] = [
    "effort_scale",
    "speed_scale",
    "position_scale",
    "position_lowest",
    "position_span",
    "reading_scale",
    "reading_spread",
    "reading_lowest",
    "reading_highest",
    "reading_step",
    "reading_noise",
    "input_scale",
    "input_lowest",
    "input_highest",
    "loss_scale",
    "record_period",
    "record_length",
    "share",
];

/// A starting point for the parameters of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Each parameter with its name and value. Omitted ones have their defaults.
    pub numbers: Vec<(String, f64)>,
    /// The index of the parameter that scales the effect, and its value without effect.
    pub neutral: Option<(usize, f64)>,
    /// The index of the parameter that is a phase.
    pub phase: Option<usize>,
}

impl Effect {
    /// The starting points on a kind of site: every combination of the guesses in its file. `scales` gives [`SCALES`] and the roles of the site.
    ///
    /// Numbers with a default are omitted first. If some of them have guesses too, further starting points give all of these numbers. They are
    /// left out if the site lacks a role that a guess needs.
    ///
    /// ```
    /// use rsm_model::effects::{Catalogue, SiteKind};
    ///
    /// let catalogue = Catalogue::shipped();
    /// let friction = catalogue.find("coulomb-friction").expect("a shipped effect");
    /// let starts = friction.starts(SiteKind::Rotation, &[("effort_scale", 10.0)])?;
    /// let torques: Vec<f64> = starts.iter().map(|it| it.numbers[0].1).collect();
    /// assert_eq!(torques, [0.05, 0.5, 2.0]);
    /// assert_eq!(starts[0].neutral, Some((0, 0.0)));
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// If a guess uses a name that is not given, or has no finite value.
    pub fn starts(&self, kind: SiteKind, scales: &[(&str, f64)]) -> Result<Vec<Start>, Faults> {
        let required: Vec<&Number> = self.numbers_on(kind).filter(|it| it.default.is_none()).collect();
        let all: Vec<&Number> = self.numbers_on(kind).filter(|it| it.default.is_none() || !it.guesses.is_empty()).collect();
        let mut starts = self.starts_of(&required, kind, scales)?;
        if all.len() > required.len() {
            starts.extend(self.starts_of(&all, kind, scales).unwrap_or_default());
        }
        Ok(starts)
    }

    /// Every combination of the guesses of some numbers.
    fn starts_of(&self, of: &[&Number], kind: SiteKind, scales: &[(&str, f64)]) -> Result<Vec<Start>, Faults> {
        let mut scratch = scratch()?;
        let given: HashMap<String, f64> = scales.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
        let mut open = vec![(Vec::new(), given)];
        for number in of {
            let mut longer = Vec::new();
            for (numbers, known) in open {
                for (_, guess) in number.guesses.iter().filter(|it| it.0.is_none_or(|on| on == kind)) {
                    let value = self.number(&mut scratch, guess, &known)?;
                    let value = if number.is_whole { value.round() } else { value };
                    let (mut numbers, mut known): (Vec<(String, f64)>, _) = (Vec::clone(&numbers), known.clone());
                    numbers.push((number.name.clone(), value));
                    known.insert(number.name.clone(), value);
                    longer.push((numbers, known));
                }
            }
            open = longer;
        }
        let mut starts = Vec::new();
        for (numbers, known) in open {
            let neutral = match of.iter().enumerate().find_map(|(k, it)| it.neutral.as_ref().map(|it| (k, it))) {
                Some((k, law)) => {
                    let mut before: HashMap<String, f64> =
                        scales.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
                    known.iter().for_each(|(name, value)| {
                        before.entry(name.clone()).or_insert(*value);
                    });
                    Some((k, self.number(&mut scratch, law, &before)?))
                }
                None => None,
            };
            starts.push(Start { numbers, neutral, phase: of.iter().position(|it| it.is_phase) });
        }
        Ok(starts)
    }

    /// The value of an expression of its file with known names.
    pub(super) fn number(&self, scratch: &mut Flat, law: &Expression, known: &HashMap<String, f64>) -> Result<f64, Faults> {
        known_number(&self.source, scratch, law, known)
    }
}
