//! Simpler forms of friction that describe the same records.
//!
//! In: the fit of a search. Out: a fit with simpler causes, if it is as good. The effects declare the simpler forms. Adds no other cause.

use super::candidates::{count, within_tolerance};
use super::hypotheses::{generalises, levels};
use super::levenberg::{self, Fit};
use super::model::Model;
use super::search::Search;
use crate::engine::significance::best_gain_by_chance;
use rsm_sim::configurations::parts;
use rsm_sim::effect::declared::{Forms, Part};
use rsm_sim::plant_file::Entry;

/// The simpler forms of an entry.
fn forms(entry: &Entry) -> Forms {
    entry.description.declared.forms.of(&entry.arguments)
}

impl Search<'_> {
    /// Replaces two levels of friction by their mean and a constant load of half their difference, if the records do not distinguish them. The load
    /// also acts at rest, where the sum can exceed the friction. Both descriptions have two parameters and nothing was searched, so chance gains
    /// little.
    pub(super) fn split(&self, fit: Fit) -> Fit {
        let entries = &fit.model.file.effects;
        let found = entries.iter().enumerate().find_map(|(place, it)| Some((place, forms(it).alike?)));
        let Some((place, parts)) = found else { return fit };
        let is_there = |part: &Part| entries.iter().any(|it| it.description.kind == part.kind);
        if parts.iter().any(is_there) || entries.len() == self.limits.causes {
            return fit;
        }
        let Some(parts) = parts.iter().map(|part| self.entry(part)).collect::<Option<Vec<Entry>>>() else { return fit };
        let bare = fit.model.without_cause(self.nominal, place);
        let model = parts.into_iter().fold(bare, |model, part| model.with_cause(self.nominal, part));
        self.simpler_if_as_good(fit, model, best_gain_by_chance(1, 1))
    }

    /// Replaces asymmetric friction by one level and one viscous friction, if both directions agree. If a curve beside it already has a level, the
    /// level becomes part of that one. The simpler fit is used if its loss is no more than chance gives for the extra parameters.
    pub(super) fn levelled(&self, fit: Fit) -> Fit {
        let entries = &fit.model.file.effects;
        let found = entries.iter().enumerate().find_map(|(place, it)| Some((place, forms(it).level?)));
        let Some((place, level)) = found else { return fit };
        let mut model = fit.model.without_cause(self.nominal, place);
        let curve = model.file.effects.iter().position(|it| generalises(it.description.kind, level.of.kind));
        match curve {
            Some(curve) => {
                let mut entries = model.file.effects.clone();
                for place in levels(&entries[curve]) {
                    entries[curve].arguments.numbers[place].1 += level.of.value;
                }
                model = model.with_effects(self.nominal, entries);
            }
            None => {
                let Some(friction) = self.entry(&level.of) else { return fit };
                model = model.with_cause(self.nominal, friction);
            }
        }
        for error in &level.errors {
            let Some(error) = self.entry(error) else { return fit };
            if !within_tolerance(self.nominal, &error) {
                model = model.with_cause(self.nominal, error);
            }
        }
        let fewer = count(&fit.model).saturating_sub(count(&model));
        if fewer == 0 {
            return fit;
        }
        self.simpler_if_as_good(fit, model, best_gain_by_chance(1, fewer))
    }

    /// Replaces a law by its special case with fewer parameters, if the records do not distinguish them: a Stribeck curve or two levels by one level.
    pub(super) fn narrowed(&self, fit: Fit, threshold: f64) -> Fit {
        let entries = &fit.model.file.effects;
        // At the same site, if the plant has several.
        let special = |it: &Entry| {
            let at = it.arguments.subject.as_deref();
            self.hypotheses.iter().find(|other| generalises(it.description.kind, other.description.kind) && other.subject == at)
        };
        let Some((place, special)) = entries.iter().enumerate().find_map(|(place, it)| Some((place, special(it)?))) else {
            return fit;
        };
        if entries.iter().any(|it| special.describes(it)) {
            return fit;
        }
        // If no parameter of the law is a level, the special case starts from its own guess.
        let guess = special.guesses.first().and_then(|it| it.values.first()).copied().unwrap_or(0.0);
        let level = |entry: &Entry| {
            let levels = levels(entry);
            let sum: f64 = levels.iter().map(|number| entry.arguments.numbers[*number].1).sum();
            if levels.is_empty() { guess } else { sum / levels.len() as f64 }
        };
        let kind = self.nominal.file.kind;
        let mut simpler = special.entry(kind, &[level(&entries[place])]);
        // A law with numbers by configuration has a special case with a number for each.
        if entries[place].arguments.numbers.iter().any(|it| parts(it.0).is_some())
            && let Some((number, _)) = simpler.arguments.numbers.pop()
        {
            for name in entries[place].acts_in() {
                let own = entries[place].in_configuration(Some(name));
                simpler.arguments.numbers.extend(own.map(|own| (kind.number_in(number, name), level(&own))));
            }
        }
        let model = fit.model.without_cause(self.nominal, place).with_cause(self.nominal, simpler);
        let worse = self.deciding_difference(&fit, threshold);
        self.simpler_if_as_good(fit, model, worse)
    }

    /// The entry of a part of a simpler form, if it is a hypothesis on this plant.
    fn entry(&self, part: &Part) -> Option<Entry> {
        let found = self.hypotheses.iter().find(|it| it.description.kind == part.kind && it.subject == part.subject);
        found.map(|it| it.entry(self.nominal.file.kind, &[part.value]))
    }

    /// The fit of a simpler model, if it is worse by less than `worse`; otherwise the given fit.
    fn simpler_if_as_good(&self, fit: Fit, model: Model, worse: f64) -> Fit {
        match levenberg::refit(self.whitened, model, self.limits.fit_steps, Some(&fit)) {
            Some(other) if other.cost < fit.cost + worse => other,
            _ => fit,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::whitened_residuals::WhitenedResiduals;
    use super::super::{axis_under_steps, hypotheses, survey};
    use super::*;

    /// Kinds that friction of two levels comes to, on an axis that has these effects, with these entries in the plant at first.
    fn plainer(truth: &str, entries: &str) -> Vec<(&'static str, Vec<f64>)> {
        let tolerances = "mass = 0.02\nviscous_friction = 0.02";
        let file = |effects: &str| axis_under_steps::file(tolerances, effects);
        let (whitened, nominal) = axis_under_steps::whitened(&file(""), &file(truth), true);
        let calibrated = levenberg::fit(&whitened, nominal.clone(), 8).unwrap();
        let survey = survey::survey(&whitened, &calibrated);
        let hypotheses = hypotheses::all(nominal.file.kind, &survey, &[0]);
        let unseen = WhitenedResiduals::new(Vec::new(), whitened.floors, 1);
        let search = axis_under_steps::search(&whitened, &unseen, &nominal, &hypotheses, &survey);
        let model = nominal.with_effects(&nominal, file(entries).effects);
        let fit = search.narrowed(search.levelled(levenberg::fit(&whitened, model, 20).unwrap()), 30.0);
        let kinds = fit.model.file.effects.iter();
        kinds.map(|it| (it.description.kind, it.arguments.numbers.iter().map(|number| number.1).collect())).collect()
    }

    fn levels(forward: f64, backward: f64, rest: &str) -> String {
        format!(
            "[[effects]]\nkind = \"asymmetric-friction\"\nparameters = {{ forward = {forward}, backward = {backward}{rest} }}\n"
        )
    }

    #[test]
    fn levels_that_are_the_same_are_one() {
        let found = plainer(&axis_under_steps::friction(1.2), &levels(1.0, 1.1, ""));
        assert_eq!((found.len(), found[0].0), (1, "coulomb-friction"));
        // The noise tells a level to some thousandths.
        assert!((found[0].1[0] - 1.2).abs() < 0.02, "{found:?}");
        let found = plainer(&levels(1.5, 0.9, ""), &levels(1.4, 1.0, ""));
        assert_eq!((found.len(), found[0].0), (1, "asymmetric-friction"));
    }

    #[test]
    fn viscous_friction_that_is_the_same_both_ways_is_a_parameter_error() {
        let truth = axis_under_steps::friction(1.2)
            + "[[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"viscous_friction\", value = 4.2 }\n";
        let found = plainer(&truth, &levels(1.0, 1.1, ", viscous_forward = 4.0, viscous_backward = 4.1"));
        let kinds: Vec<&str> = found.iter().map(|it| it.0).collect();
        assert_eq!(kinds, ["coulomb-friction", "parameter-error"]);
        assert!((found[1].1[0] / 4.2 - 1.0).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn a_level_beside_a_stribeck_curve_is_a_part_of_it() {
        let curve = |coulomb: f64, rest: f64| {
            format!(
                "[[effects]]\nkind = \"stribeck-friction\"\nparameters = {{ coulomb = {coulomb}, static = {rest}, stribeck_velocity = 0.05 }}\n"
            )
        };
        // A curve that the records do not show gives way to one level.
        let found = plainer(&axis_under_steps::friction(1.2), &curve(1.1, 1.3));
        assert_eq!((found.len(), found[0].0), (1, "coulomb-friction"));
        assert!((found[0].1[0] - 1.2).abs() < 0.02, "{found:?}");
        let found = plainer(&curve(1.0, 2.0), &(levels(0.6, 0.6, "") + &curve(0.4, 1.4)));
        assert_eq!((found.len(), found[0].0), (1, "stribeck-friction"));
        assert!((found[0].1[0] - 1.0).abs() < 0.05, "{found:?}");
    }
}
