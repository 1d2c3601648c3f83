//! Implausible parameters: for example a thousand times the resistance of a winding, a bias larger than the readings, or a storm as headwind.
//!
//! In: an entry with its parameters, a survey of the records. Out: the reason for rejecting it, in words, or `None`. A fit moves a parameter so far
//! only to compensate for an error that the catalogue does not contain. The effects declare the range of each parameter.

use super::hypotheses::declared;
use rsm_sim::effect::{Plausible, Survey};
use rsm_sim::plant_file::{Entry, PlantFile};

/// A parameter or gain may be wrong by this factor. That covers a wrong datasheet row and another size of the same series.
const FACTOR: f64 = 5.0;

/// Losses (friction, damping) are known only to an order of magnitude.
const FACTOR_OF_LOSSES: f64 = 30.0;

/// The slope of the steepest public roads, in rad: they climb by 35 to 38 %.
const STEEPEST_ROAD: f64 = 0.36;

/// Factors between units: rpm and rad/s, km/h and m/s, kp and N, degrees and radians, peak and r.m.s., decimal prefixes.
const UNITS: [f64; 7] = [9.549_297, 3.6, 9.806_65, 57.295_78, 10.0, 100.0, 1000.0];

/// A gain matches a factor between units within this share, because sensors may be wrong by some per cent.
const NEAR_UNIT: f64 = 0.02;

/// Why an entry is implausible; `None` if it is plausible.
#[must_use]
pub fn implausibility(entry: &Entry, survey: &Survey, file: &PlantFile) -> Option<String> {
    entry.variants().iter().find_map(|it| of_variant(it, survey, file))
}

fn of_variant(entry: &Entry, survey: &Survey, file: &PlantFile) -> Option<String> {
    let numbers = entry.arguments.numbers.iter();
    let mut beyond = numbers.filter_map(|(name, value)| {
        let (low, high) = range(entry, name, survey, file)?;
        let may_be_unit = declared(entry, name).is_some_and(|it| it.plausible == Plausible::FactorOrUnit);
        let of_unit = may_be_unit && is_unit(*value);
        (!(low..=high).contains(value) && !of_unit)
            .then(|| format!("{name} = {value:.4} is outside its plausible range, {low:.4} to {high:.4}"))
    });
    beyond.next()
}

/// Whether a gain is a factor between units.
fn is_unit(gain: f64) -> bool {
    UNITS.iter().any(|unit| [*unit, 1.0 / unit].iter().any(|factor| (gain.abs() / factor - 1.0).abs() < NEAR_UNIT))
}

/// The plausible range of a parameter; `None` if there is none.
fn range(entry: &Entry, name: &str, survey: &Survey, file: &PlantFile) -> Option<(f64, f64)> {
    let output = || entry.arguments.plant.output(entry.arguments.subject.as_deref()?);
    match declared(entry, name)?.plausible {
        Plausible::Any => None,
        Plausible::Parameter => {
            let subject = entry.arguments.subject.as_deref()?;
            if subject == "grade" {
                return Some((-STEEPEST_ROAD, STEEPEST_ROAD));
            }
            let was = file.parameters.optional(subject)?;
            let is_loss = ["friction", "damping", "rolling"].iter().any(|word| subject.contains(word));
            let factor = if is_loss { FACTOR_OF_LOSSES } else { FACTOR };
            let (low, high) = (if is_loss { 0.0 } else { was / factor }, was * factor);
            // If the nominal value is 0, there is no scale for a range.
            (was != 0.0).then_some((low.min(high), low.max(high)))
        }
        Plausible::FactorOrUnit => Some((1.0 / FACTOR, FACTOR)),
        Plausible::TimesTheGuess(times) => {
            let place = entry.arguments.numbers.iter().position(|(number, _)| *number == name)?;
            let output = output().unwrap_or(survey.output);
            let guesses = entry.description.guesses.of(&Survey { output, ..survey.clone() });
            let sizes = guesses.iter().filter_map(|it| it.values.get(place)).filter(|it| it.is_finite());
            let largest = sizes.fold(0.0_f64, |most, value| most.max(value.abs()));
            (largest > 0.0).then_some((-times * largest, times * largest))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{axis_under_steps, hypotheses, levenberg, survey};
    use super::*;

    #[test]
    fn what_no_machine_has_is_refused_and_what_one_may_have_is_not() {
        let file = axis_under_steps::file("mass = 0.02", "");
        let (whitened, nominal) = axis_under_steps::whitened(&file, &file, true);
        let fit = levenberg::fit(&whitened, nominal, 4).unwrap();
        let survey = survey::survey(&whitened, &fit);
        let all = hypotheses::all(file.kind, &survey, &[0]);
        let refused = |kind: &str, subject: Option<&str>, value: f64| {
            let it = all.iter().find(|it| it.description.kind == kind && it.subject == subject).unwrap();
            implausibility(&it.entry(file.kind, &[value]), &survey, &file).is_some()
        };
        // The axis has 2 kg, 4 N/V and steps of 2 V and -1.5 V; it moves by some centimetres.
        assert!(refused("parameter-error", Some("mass"), 46.0) && !refused("parameter-error", Some("mass"), 3.0));
        assert!(refused("sensor-gain", Some("position"), 0.000345) && !refused("sensor-gain", Some("position"), 0.001));
        assert!(refused("input-gain", None, 0.0169) && !refused("input-gain", None, 0.9));
        assert!(refused("sensor-bias", Some("position"), -396.0) && !refused("sensor-bias", Some("position"), 0.001));
        assert!(refused("coulomb-friction", None, 1009.0) && !refused("coulomb-friction", None, 1.0));
        assert!(refused("sensor-lag", Some("position"), 19_230.0) && !refused("sensor-lag", Some("position"), 0.01));
    }
}
