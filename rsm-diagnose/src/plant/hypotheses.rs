//! The hypotheses: every effect of the catalogue that is possible on the plant, a parameter error for each parameter with a physical meaning, a
//! sensor effect for each output.
//!
//! In: a model and a survey of the records. Out: a list, and the model with a hypothesis added. Evaluates none.

use super::model::{Model, Place, Unknown};
use rsm_sim::configurations;
use rsm_sim::effect::{Argument, Arguments, Description, Guess, Role, Step, Subject, Survey};
use rsm_sim::equation_plant;
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::Entry;
use rsm_sim::schema::{self, Bound};

/// A possible cause of the residual.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// The effect.
    pub description: &'static Description,
    /// The parameter or output that it refers to, if any.
    pub subject: Option<&'static str>,
    /// The only configuration of the plant file in which it acts; `None` if it acts in all with the same numbers.
    pub configuration: Option<&'static str>,
    /// The starting points of a search.
    pub guesses: Vec<Guess>,
}

/// The name of a hypothesis in lists: KIND, `parameter-error:NAME` or `sensor-...:OUTPUT`.
#[must_use]
pub fn label(kind: &str, subject: Option<&str>) -> String {
    subject.map_or(kind.to_string(), |subject| format!("{kind}:{subject}"))
}

/// The name of an entry in lists. A cause that acts in some configurations only has their names in brackets: `KIND:SITE[loaded]`.
#[must_use]
pub fn label_of(entry: &Entry) -> String {
    let name = label(entry.description.kind, entry.arguments.subject.as_deref());
    let is_own = entry.arguments.numbers.iter().any(|it| configurations::parts(it.0).is_some());
    if !is_own || entry.acts_everywhere() {
        return name;
    }
    configurations::name_in(&name, &entry.acts_in().join(","))
}

/// The names of a model's causes.
#[must_use]
pub(super) fn labels(model: &Model) -> Vec<String> {
    model.file.effects.iter().map(label_of).collect()
}

/// Whether one cause contains another as a special case, by kinds or by names in lists. It then always fits at least as well, which is no evidence.
/// If both name a parameter or output, it must be the same, and so must be the configuration in which both act.
#[must_use]
pub fn generalises(general: &str, special: &str) -> bool {
    if let (Some((general, in_one)), Some((special, in_other))) =
        (configurations::parts(general), configurations::parts(special))
    {
        return in_one == in_other && generalises(general, special);
    }
    let parts = |name| str::split_once(name, ':').map_or((name, None), |(kind, at)| (kind, Some(at)));
    let ((general, at), (special, other)) = (parts(general), parts(special));
    let is_one_place = at.is_none() || other.is_none() || at == other;
    is_one_place && equation_plant::special_case(general) == Some(special)
}

/// All hypotheses of a plant. `outputs` are those that at least one record holds.
#[must_use]
pub fn all(kind: PlantKind, survey: &Survey, outputs: &[usize]) -> Vec<Hypothesis> {
    let mut list = Vec::new();
    for description in equation_plant::effects_on(kind) {
        let mut add = |subject: Option<&'static str>, survey: &Survey| {
            let guesses = description.guesses.of(survey);
            let finite = |guess: &Guess| {
                let mut arguments = description.arguments.iter();
                guess.values.iter().all(|value| {
                    let argument = arguments.next();
                    value.is_finite() || argument.is_some_and(|argument| argument.optional)
                })
            };
            let guesses: Vec<Guess> = guesses.into_iter().filter(finite).collect();
            if !guesses.is_empty() {
                list.push(Hypothesis { description, subject, configuration: None, guesses });
            }
        };
        match description.subject {
            Subject::None => add(None, survey),
            Subject::Site => add(description.at, survey),
            Subject::Parameter => {
                for nominal in schema::parameters(kind) {
                    let Some(value) = survey.parameters.optional(nominal.name) else { continue };
                    // A parameter that occurs in no equation of any record has no effect, such as the ratio of a gear that was not used.
                    let runs = !survey.unused.contains(&nominal.name);
                    // An integer parameter is exact too.
                    let is_counted = nominal.bound == Bound::Count;
                    if runs
                        && !is_counted
                        && !survey.exact.contains(&nominal.name)
                        && description.at.is_none_or(|at| at == nominal.name)
                    {
                        add(Some(nominal.name), &Survey { nominal: value, ..survey.clone() });
                    }
                }
            }
            Subject::Output => {
                let stands = |output: &&usize| description.at.is_none_or(|at| at == kind.outputs()[**output].name);
                for &output in outputs.iter().filter(stands) {
                    add(Some(kind.outputs()[output].name), &Survey { output, ..survey.clone() });
                }
            }
        }
    }
    list
}

/// The same hypotheses for each of these configurations of the plant file alone. A parameter with a value of its own in the configuration is already
/// a hypothesis of this configuration. Rounding and waves are properties of a machine, not of its load.
#[must_use]
pub fn by_configuration(kind: PlantKind, common: &[Hypothesis], present: &[usize]) -> Vec<Hypothesis> {
    let mut list = Vec::new();
    if present.len() < 2 {
        return list;
    }
    let configurations = &kind.configurations;
    let names: Vec<&'static str> = kind.configuration_names();
    for &place in present {
        for it in common {
            let is_of_machine = matches!(it.description.declared.role, Role::Rounding | Role::Waves);
            let parameter = it.subject.filter(|_| it.description.subject == Subject::Parameter);
            // A parameter that one configuration uses has no other hypothesis.
            let is_shared = |name: &str| {
                let uses = |place: &usize| configurations::parts(name).is_none() && !configurations.has_own(*place, name);
                uses(&place) && present.iter().filter(|it| uses(it)).count() > 1
            };
            if !is_of_machine && parameter.is_none_or(is_shared) {
                list.push(Hypothesis { configuration: Some(names[place]), ..it.clone() });
            }
        }
    }
    list
}

impl Hypothesis {
    /// Its name in lists.
    #[must_use]
    pub fn label(&self) -> String {
        let name = label(self.description.kind, self.subject);
        self.configuration.map_or(name.clone(), |configuration| configurations::name_in(&name, configuration))
    }

    /// Its entry in a plant file with these parameters.
    #[must_use]
    pub fn entry(&self, kind: PlantKind, values: &[f64]) -> Entry {
        let numbers = self.description.arguments.iter().zip(values);
        Entry {
            description: self.description,
            arguments: Arguments {
                plant: kind,
                subject: self.subject.map(str::to_string),
                numbers: numbers
                    .filter(|(_, value)| value.is_finite())
                    .map(|(it, value)| (self.name_of(kind, it.name), *value))
                    .collect(),
            },
        }
    }

    /// The name of a number in its configuration.
    fn name_of(&self, kind: PlantKind, number: &'static str) -> &'static str {
        self.configuration.map_or(number, |configuration| kind.number_in(number, configuration))
    }

    /// Whether the parameters have physically possible signs. The search determines their size.
    #[must_use]
    pub fn has_signs(&self, kind: PlantKind, values: &[f64]) -> bool {
        let entry = self.entry(kind, values);
        let mut numbers = entry.arguments.numbers.iter();
        numbers.all(|(name, value)| match bound_of(&entry, name) {
            Bound::Positive | Bound::Count => *value > 0.0,
            Bound::NotNegative => *value >= 0.0,
            Bound::Any | Bound::Between(..) => true,
        })
    }

    /// Whether an entry of a file is the effect of this hypothesis, in any configuration.
    #[must_use]
    pub fn describes(&self, entry: &Entry) -> bool {
        entry.description.kind == self.description.kind && entry.arguments.subject.as_deref() == self.subject
    }
}

/// The declaration of a parameter in the effect of an entry.
pub(super) fn declared(entry: &Entry, name: &str) -> Option<&'static Argument> {
    entry.description.argument(name)
}

/// The indices of those parameters of an entry that are levels of friction; its special case has one level.
pub(super) fn levels(entry: &Entry) -> Vec<usize> {
    let is_level = |(_, (name, _)): &(usize, &(&str, f64))| declared(entry, name).is_some_and(|it| it.is_level);
    entry.arguments.numbers.iter().enumerate().filter(is_level).map(|(place, _)| place).collect()
}

/// The physical limits of a parameter of an entry.
fn bound_of(entry: &Entry, name: &str) -> Bound {
    let plant = entry.arguments.plant;
    if entry.description.subject == Subject::Parameter {
        let subject = entry.arguments.subject.as_deref().unwrap_or("");
        return schema::parameters(plant)
            .iter()
            .find(|nominal| nominal.name == subject)
            .map_or(Bound::Any, |nominal| nominal.bound);
    }
    declared(entry, name).map_or(Bound::Any, |argument| argument.bound)
}

/// The unknowns of an entry: its parameters, except integers and rounding steps, for which a simulation has no derivative.
fn unknowns_of(entry: &Entry, place: usize) -> Vec<Unknown> {
    let mut unknowns = Vec::new();
    for (name, value) in &entry.arguments.numbers {
        let bound = bound_of(entry, name);
        if bound == Bound::Count || entry.description.declared.role == Role::Rounding {
            continue;
        }
        let mut unknown = Unknown::bounded(Place::Effect { entry: place, number: name }, bound, *value);
        match declared(entry, name).map_or(Step::Usual, |argument| argument.step) {
            _ if configurations::without(name) == "phase" => unknown.scale = 0.1,
            Step::PerCent if !unknown.logarithmic && *value != 0.0 => unknown.scale = 0.01 * value.abs(),
            _ => {}
        }
        unknowns.push(unknown);
    }
    unknowns
}

impl Model {
    /// The model with these causes and no others. If a cause is the error of a nominal parameter, that parameter is no longer calibrated.
    #[must_use]
    pub fn with_effects(&self, nominal: &Model, entries: Vec<Entry>) -> Model {
        let mut model = self.clone();
        let in_error = |name: &str| {
            // An error in some configurations leaves the common parameter to the others.
            let is_whole = |entry: &Entry| {
                entry.arguments.numbers.iter().all(|it| configurations::parts(it.0).is_none()) || entry.acts_everywhere()
            };
            entries.iter().any(|entry| {
                entry.description.subject == Subject::Parameter
                    && entry.arguments.subject.as_deref() == Some(name)
                    && is_whole(entry)
            })
        };
        let starts = model.unknowns.iter().filter(|it| matches!(it.place, Place::Start { .. })).cloned();
        let mut unknowns: Vec<Unknown> = Vec::new();
        for unknown in &nominal.unknowns {
            let Place::Nominal(name) = unknown.place else { continue };
            if in_error(name) {
                // The file keeps its value; the entry holds the difference.
                model.file.parameters.set(name, nominal.file.parameters.number(name));
            } else {
                unknowns.push(unknown.clone());
            }
        }
        for (place, entry) in entries.iter().enumerate() {
            unknowns.extend(unknowns_of(entry, place));
        }
        unknowns.extend(starts);
        model.unknowns = unknowns;
        model.file.effects = entries;
        model
    }

    /// The model with one more cause.
    #[must_use]
    pub fn with_cause(&self, nominal: &Model, entry: Entry) -> Model {
        let mut entries = self.file.effects.clone();
        entries.push(entry);
        self.with_effects(nominal, entries)
    }

    /// The model with one more cause in place of its special cases: friction is described by one law only.
    #[must_use]
    pub fn joined(&self, nominal: &Model, entry: Entry) -> Model {
        let mut entries = self.file.effects.clone();
        entries.retain(|it| !generalises(entry.description.kind, it.description.kind));
        entries.push(entry);
        self.with_effects(nominal, entries)
    }

    /// The model without one of its causes.
    #[must_use]
    pub fn without_cause(&self, nominal: &Model, place: usize) -> Model {
        let mut entries = self.file.effects.clone();
        entries.remove(place);
        self.with_effects(nominal, entries)
    }

    /// Whether the effects leave a positive inertia.
    #[must_use]
    pub fn is_possible(&self) -> bool {
        self.file.split() < 0.99
    }
}
