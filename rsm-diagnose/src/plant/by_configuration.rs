//! Numbers of causes that differ between the configurations of a plant file.
//!
//! In: the fit of a search. Out: the same causes; a number has a value for each configuration if the records need it, and a cause acts in some
//! configurations only if the records of the others show nothing of it. One value for all configurations is a special case of one for each: the
//! difference must gain as much as decides between two explanations on the training records, and lower the error of the validation records. Never
//! adds or removes a cause.

use super::levenberg::{self, Fit};
use super::model::Place;
use super::search::Search;
use super::validation;
use super::whitened_residuals::{Column, WhitenedResiduals};
use crate::engine::normal::Normal;
use rsm_sim::configurations::{parts, without};
use rsm_sim::effect::{Role, Subject};
use rsm_sim::plant_file::Entry;

/// Numbers for each configuration are fitted if the first order predicts this share of the needed gain, because it may predict too little. It is the
/// share that a guess of the screen needs.
const LEAST_PREDICTED_SHARE: f64 = 0.3;

/// The indices of the configurations of some records, in the order of the plant file.
#[must_use]
pub(super) fn present(whitened: &WhitenedResiduals) -> Vec<usize> {
    let mut list: Vec<usize> = whitened.records.iter().filter_map(|it| it.record.configuration).collect();
    list.sort_unstable();
    list.dedup();
    list
}

/// Whether an entry may have numbers by configuration. A parameter of one configuration is already separate. Rounding and waves are properties of a
/// machine, not of its load.
fn may_differ(entry: &Entry) -> bool {
    let is_own = entry.description.subject == Subject::Parameter
        && entry.arguments.subject.as_deref().is_some_and(|it| parts(it).is_some());
    !is_own && !matches!(entry.description.declared.role, Role::Rounding | Role::Waves)
}

/// Whether all numbers of an entry are those of all configurations.
fn is_shared(entry: &Entry) -> bool {
    entry.arguments.numbers.iter().all(|it| parts(it.0).is_none())
}

impl Search<'_> {
    /// Tests each cause with numbers for all configurations, or all causes if this is the last test of a search.
    pub(super) fn by_configuration(&self, mut fit: Fit, threshold: f64, is_last: bool) -> Fit {
        for place in 0..fit.model.file.effects.len() {
            if is_last || is_shared(&fit.model.file.effects[place]) {
                fit = self.with_own_numbers(fit, place, threshold);
            }
        }
        fit
    }

    /// The fit with numbers by configuration for one cause, where the records need them.
    pub(super) fn with_own_numbers(&self, fit: Fit, place: usize, threshold: f64) -> Fit {
        let names = self.configurations();
        let entry = &fit.model.file.effects[place];
        if names.len() < 2 || !may_differ(entry) {
            return fit;
        }
        let least = LEAST_PREDICTED_SHARE * self.deciding_difference(&fit, threshold);
        if is_shared(entry) && self.predicted_gain(&fit, place).is_some_and(|gain| gain < least) {
            return fit;
        }
        let all = separate(entry, &names);
        let found = if all.arguments.numbers == entry.arguments.numbers { None } else { self.with_entry(&fit, place, all) };
        match found.filter(|found| self.is_better(&fit, found, place, threshold)) {
            Some(found) => self.simplified(found, place, threshold),
            None if is_shared(entry) => fit,
            None => self.simplified(fit, place, threshold),
        }
    }

    /// The names of the configurations of the training records.
    fn configurations(&self) -> Vec<&'static str> {
        let names = self.nominal.file.kind.configuration_names();
        present(self.whitened).into_iter().map(|place| names[place]).collect()
    }

    /// The fit with an entry in place of one of its causes.
    fn with_entry(&self, fit: &Fit, place: usize, entry: Entry) -> Option<Fit> {
        let mut entries = fit.model.file.effects.clone();
        entries[place] = entry;
        let model = fit.model.with_effects(self.nominal, entries);
        if !model.is_possible() {
            return None;
        }
        levenberg::refit(self.whitened, model, self.limits.fit_steps, Some(fit))
    }

    /// Whether a fit with more numbers gains enough, and is no worse on validation records.
    fn is_better(&self, before: &Fit, after: &Fit, place: usize, threshold: f64) -> bool {
        let gains = before.cost - after.cost > self.deciding_difference(after, threshold);
        let unseen = |fit: &Fit| validation::squared_residual(self.unseen, &fit.model);
        let is_confirmed = || {
            self.unseen.records.is_empty()
                || matches!((unseen(before), unseen(after)), (Some(before), Some(after)) if after < before)
        };
        gains && self.is_plausible(&after.model.file.effects[place]) && is_confirmed()
    }

    /// The fit with fewer numbers of a cause: without the configurations in which it does nothing that matters, and with one value for numbers whose
    /// difference does not matter.
    fn simplified(&self, mut fit: Fit, place: usize, threshold: f64) -> Fit {
        for simpler in [without_one as fn(&Entry) -> Vec<Entry>, shared_one] {
            loop {
                let forms = simpler(&fit.model.file.effects[place]);
                let fits = forms.into_iter().filter_map(|entry| self.with_entry(&fit, place, entry));
                let best = fits.min_by(|a, b| a.cost.total_cmp(&b.cost));
                match best {
                    Some(best) if best.cost - fit.cost < self.deciding_difference(&fit, threshold) => fit = best,
                    _ => break,
                }
            }
        }
        fit
    }

    /// The first-order gain of numbers by configuration of a cause. `None` if one of its numbers is at a bound, where the first order shows nothing.
    fn predicted_gain(&self, fit: &Fit, place: usize) -> Option<f64> {
        let is_its = |k: usize| matches!(fit.model.unknowns[k].place, Place::Effect { entry, .. } if entry == place);
        if fit.held.iter().any(|it| is_its(it.unknown)) {
            return None;
        }
        let (mut free, mut columns) = (Vec::new(), Vec::new());
        for (k, column) in fit.free.iter().zip(&fit.columns) {
            let parts = if is_its(*k) { self.by_records(column) } else { vec![column.clone()] };
            free.extend(parts.iter().map(|_| *k));
            columns.extend(parts);
        }
        let gain = |free: &[usize], columns: &[Column]| {
            let matrix = levenberg::gram(&fit.model, free, columns);
            let right = levenberg::negative_gradient(&fit.model, free, columns, &fit.residual);
            Normal::new(&matrix, free.len(), 0.0).gain(&right).1
        };
        Some(gain(&free, &columns) - gain(&fit.free, &fit.columns))
    }

    /// The parts of a derivative on the records of each configuration.
    fn by_records(&self, column: &Column) -> Vec<Column> {
        let on = |place: usize| {
            let mut part = column.clone();
            for (record, prepared) in self.whitened.records.iter().enumerate() {
                if prepared.record.configuration != Some(place) {
                    let first = self.whitened.first(record) - column.first;
                    part.values[first..first + WhitenedResiduals::length(prepared)].fill(0.0);
                }
            }
            part
        };
        present(self.whitened).into_iter().map(on).collect()
    }
}

/// The entry with a value of each number for each configuration. A configuration in which it did not act begins with the value of another one.
fn separate(entry: &Entry, names: &[&'static str]) -> Entry {
    let mut all = entry.clone();
    all.arguments.numbers.clear();
    for argument in entry.description.arguments {
        let of_number: Vec<&(&'static str, f64)> =
            entry.arguments.numbers.iter().filter(|it| without(it.0) == argument.name).collect();
        let Some(first) = of_number.first() else { continue };
        // A whole number is not fitted, so it stays one for all.
        if argument.bound == rsm_sim::schema::Bound::Count {
            all.arguments.numbers.push(**first);
            continue;
        }
        for name in names {
            let own = of_number.iter().find(|it| parts(it.0).is_none_or(|it| it.1 == *name)).unwrap_or(first);
            all.arguments.numbers.push((entry.arguments.plant.number_in(argument.name, name), own.1));
        }
    }
    all
}

/// The forms of an entry that do not act in one of its configurations.
fn without_one(entry: &Entry) -> Vec<Entry> {
    let names: Vec<&'static str> = entry.acts_in();
    if is_shared(entry) || names.len() < 2 {
        return Vec::new();
    }
    // An effect acts where it has all of its numbers, and at least one of them is given by configuration.
    let form = |left_out: &str| {
        let mut form = entry.clone();
        form.arguments.numbers.retain(|it| parts(it.0).is_none_or(|it| it.1 != left_out));
        form
    };
    names.iter().map(|name| form(name)).collect()
}

/// The forms of an entry in which one of its numbers has one value for all configurations. An entry that acts in some of them only keeps a number of
/// its own, because it would act in the others too.
fn shared_one(entry: &Entry) -> Vec<Entry> {
    let mut numbers: Vec<&'static str> = entry.arguments.numbers.iter().filter_map(|it| parts(it.0)).map(|it| it.0).collect();
    numbers.dedup();
    if numbers.len() < 2 && !entry.acts_everywhere() {
        return Vec::new();
    }
    let form = |number: &str| {
        let its: Vec<f64> = entry.arguments.numbers.iter().filter(|it| without(it.0) == number).map(|it| it.1).collect();
        let mean = its.iter().sum::<f64>() / its.len() as f64;
        let mut form = entry.clone();
        let argument = entry.description.argument(number)?;
        let first = entry.arguments.numbers.iter().position(|it| without(it.0) == number)?;
        form.arguments.numbers[first] = (argument.name, mean);
        form.arguments.numbers.retain(|it| parts(it.0).is_none_or(|it| it.0 != number));
        Some(form)
    };
    numbers.iter().filter_map(|number| form(number)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::hypotheses::{self, label_of};
    use super::super::model::Model;
    use super::super::noise::NoiseFloor;
    use super::super::whitened_residuals::Prepared;
    use super::super::{axis_under_steps, survey};
    use super::*;
    use rsm_core::source::Source;
    use rsm_fit::random::Random;
    use rsm_sim::kind::OUTPUTS;
    use rsm_sim::plant_file::PlantFile;
    use rsm_sim::record::Record;
    use rsm_sim::simulate::Simulator;

    /// Standard deviation of the noise of the position, in m.
    const NOISE: f64 = 1e-5;

    const CONFIGURATIONS: &str = "[configurations]\ndiffer = [\"viscous_friction\"]\n[configurations.light]\nrecords = [\"light*\"]\n\
                                  [configurations.heavy]\nrecords = [\"heavy*\"]\nparameters = { mass = 4 }\n";

    fn file(effects: &str) -> PlantFile {
        axis_under_steps::file("mass = 0.02\nviscous_friction = 0.02", &format!("{CONFIGURATIONS}{effects}"))
    }

    fn friction(force: &str) -> String {
        format!("[[effects]]\nkind = \"coulomb-friction\"\nparameters = {{ force = {force} }}\n")
    }

    /// A record of 0.6 s of the true axis in each configuration, and the nominal plant.
    fn records(truth: &PlantFile) -> (WhitenedResiduals, Model) {
        let mut random = Random::new(7);
        let one = |name: &str| {
            let mut csv = "time[s],command[V],position[m]\n".to_string();
            for k in 0..600 {
                csv += &format!("{},{},0\n", f64::from(k) / 1000.0, if k % 200 < 100 { 2.0 } else { -1.5 });
            }
            let mut record = Record::read(&Source::new(name, csv), truth).unwrap();
            let simulated = Simulator::new(truth, &record).unwrap().run(&record).unwrap();
            let readings = simulated.of("position").unwrap().iter().map(|value| value + NOISE * random.normal());
            record.measured[0] = Some(readings.collect());
            record
        };
        let records: Vec<Record> = ["light.csv", "heavy.csv"].map(one).into();
        let model = Model::nominal(&file(""), &records.iter().collect::<Vec<_>>(), [NOISE; OUTPUTS]);
        let prepared = records.into_iter().map(|it| Prepared::new(it, 2)).collect();
        (WhitenedResiduals::new(prepared, [NoiseFloor::white(NOISE); OUTPUTS], 1), model)
    }

    /// The numbers of dry friction, fitted with one number and then tested for a difference.
    fn numbers(truth: &str) -> Vec<(&'static str, f64)> {
        let (whitened, nominal) = records(&file(truth));
        let calibrated = levenberg::fit(&whitened, nominal.clone(), 8).unwrap();
        let survey = survey::survey(&whitened, &calibrated);
        let hypotheses = hypotheses::all(nominal.file.kind, &survey, &[0]);
        let unseen = WhitenedResiduals::new(Vec::new(), whitened.floors, 1);
        let search = axis_under_steps::search(&whitened, &unseen, &nominal, &hypotheses, &survey);
        let shared = levenberg::fit(&whitened, nominal.with_effects(&nominal, file(&friction("0.8")).effects), 20).unwrap();
        let fit = search.by_configuration(shared, 30.0, true);
        fit.model.file.effects[0].arguments.numbers.clone()
    }

    #[test]
    fn a_number_differs_only_where_the_records_need_it() {
        let names = |found: &[(&'static str, f64)]| found.iter().map(|it| it.0).collect::<Vec<_>>();
        let common = numbers(&friction("0.8"));
        assert_eq!(names(&common), ["force"]);
        let each = numbers(&friction("{ light = 0.5, heavy = 1.2 }"));
        assert_eq!(names(&each), ["force[light]", "force[heavy]"]);
        // The noise tells a friction to some thousandths.
        assert!((each[0].1 - 0.5).abs() < 0.02 && (each[1].1 - 1.2).abs() < 0.02, "{each:?}");
        let one = numbers(&friction("{ heavy = 1.2 }"));
        assert_eq!(names(&one), ["force[heavy]"]);
        assert!((one[0].1 - 1.2).abs() < 0.02, "{one:?}");
    }

    #[test]
    fn a_difference_must_gain_and_hold_on_validation_records() {
        let differs = friction("{ light = 0.5, heavy = 1.2 }");
        let judged = |truth: &str, unseen: &str| {
            let (whitened, nominal) = records(&file(truth));
            let calibrated = levenberg::fit(&whitened, nominal.clone(), 8).unwrap();
            let survey = survey::survey(&whitened, &calibrated);
            let (unseen, _) = records(&file(unseen));
            let search = axis_under_steps::search(&whitened, &unseen, &nominal, &[], &survey);
            let shared = levenberg::fit(&whitened, nominal.with_effects(&nominal, file(&friction("0.8")).effects), 20).unwrap();
            let each = separate(&shared.model.file.effects[0], &search.configurations());
            let each = search.with_entry(&shared, 0, each).unwrap();
            let is_better = search.is_better(&shared, &each, 0, 30.0);
            let simplified = search.simplified(each, 0, 30.0);
            (is_better, simplified.model.file.effects[0].arguments.numbers.iter().map(|it| it.0).collect::<Vec<_>>())
        };
        assert_eq!(judged(&differs, &differs), (true, vec!["force[light]", "force[heavy]"]));
        // Noise alone: the difference gains no more than chance, and is taken out.
        let common = friction("0.8");
        assert_eq!(judged(&common, &common), (false, vec!["force"]));
        // The validation records show one friction.
        assert!(!judged(&differs, &friction("0.85")).0);
    }

    #[test]
    fn a_number_of_a_configuration_moves_its_records_alone() {
        let (whitened, nominal) = records(&file(""));
        let simulated = whitened.run(&nominal).unwrap();
        let place = |name: &str| {
            nominal.unknowns.iter().position(|it| matches!(it.place, Place::Nominal(found) if found == name)).unwrap()
        };
        let which = ["mass", "mass[heavy]", "viscous_friction[light]"].map(place);
        let columns = whitened.derivatives(&nominal, &simulated, &which).unwrap();
        let moves = |column: &Column, record: usize| column.values[whitened.first(record)..][..600].iter().any(|it| *it != 0.0);
        let moved: Vec<[bool; 2]> = columns.iter().map(|column| [0, 1].map(|record| moves(column, record))).collect();
        assert_eq!(moved, [[true, false], [false, true], [true, false]]);
    }

    #[test]
    fn hypotheses_of_one_configuration_have_its_name_and_leave_its_own_parameters_out() {
        let (whitened, nominal) = records(&file(""));
        let fit = levenberg::linearised(&whitened, nominal).unwrap();
        let kind = fit.model.file.kind;
        let common = hypotheses::all(kind, &survey::survey(&whitened, &fit), &[0]);
        let labels: Vec<String> = common.iter().map(hypotheses::Hypothesis::label).collect();
        // No record has the common viscous friction.
        assert!(labels.iter().any(|it| it == "parameter-error:viscous_friction[heavy]"));
        assert!(!labels.iter().any(|it| it == "parameter-error:viscous_friction"), "{labels:?}");
        let own = hypotheses::by_configuration(kind, &common, &present(&whitened));
        let labels: Vec<String> = own.iter().map(hypotheses::Hypothesis::label).collect();
        assert!(
            labels.iter().any(|it| it == "coulomb-friction[heavy]")
                && labels.iter().any(|it| it == "parameter-error:force_gain[light]")
        );
        // The mass of each configuration is a parameter already.
        assert!(!labels.iter().any(|it| it.contains("mass")), "{labels:?}");
        let heavy = own.iter().find(|it| it.label() == "coulomb-friction[heavy]").unwrap();
        let entry = heavy.entry(kind, &[0.7]);
        assert_eq!((entry.arguments.numbers.clone(), label_of(&entry)), (vec![("force[heavy]", 0.7)], heavy.label()));
        assert!(hypotheses::by_configuration(kind, &common, &[1]).is_empty());
    }
}
