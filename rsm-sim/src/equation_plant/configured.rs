//! Plants with configurations: the kind with a parameter for each configuration that has its own value, and the plant of each record.
//!
//! In: a kind, the configurations of a plant file. Out: the kind with further parameters, such as `mass[loaded]`; a plant file without configurations
//! for each record. A configuration changes numbers only: all records have the same equations.

use std::borrow::Cow;

use super::kept;
use crate::configurations::{Configurations, name_in, parts, without};
use crate::effect::{Arguments, Subject};
use crate::kind::{Described, PlantKind};
use crate::parameters::Parameters;
use crate::plant_file::{Entry, Named, PlantFile};
use crate::quantity::Nominal;
use crate::record::Record;

/// The kind of a plant file with these configurations: the same kind if there are none.
pub(super) fn kind(common: &'static Described, configurations: &Configurations) -> &'static Described {
    if configurations.is_empty() {
        return common;
    }
    let (mut parameters, mut values, mut own) = (common.parameters.clone(), common.values.clone(), Vec::new());
    for (place, configuration) in configurations.list.iter().enumerate() {
        for (index, (nominal, value)) in common.parameters.iter().zip(&common.values).enumerate() {
            if configurations.has_own(place, nominal.name) {
                parameters.push(Nominal { name: kept(&name_in(nominal.name, &configuration.name)), ..*nominal });
                values.push(configurations.value(place, nominal.name, *value));
                own.push((index, place));
            }
        }
    }
    Box::leak(Box::new(Described {
        name: common.name,
        model: common.model,
        is_first_format: common.is_first_format,
        inputs: common.inputs.clone(),
        outputs: common.outputs.clone(),
        starts: common.starts.clone(),
        start_values: common.start_values.clone(),
        free_starts: common.free_starts.clone(),
        open_loop: common.open_loop,
        start_sizes: common.start_sizes.clone(),
        parameters,
        decisions: common.decisions.clone(),
        values,
        text: common.text.clone(),
        files: common.files.clone(),
        configurations: configurations.clone(),
        own,
        common: Some(PlantKind(common)),
        equations: common.equations,
    }))
}

/// The parameters of a kind with configurations, from those that all configurations have in common.
pub(super) fn parameters(kind: PlantKind, common: &Parameters) -> Parameters {
    let mut values = common.values.clone();
    for (index, place) in &kind.own {
        let name = kind.parameters[*index].name;
        values.push(common.values[*index].map(|value| kind.configurations.value(*place, name, value)));
    }
    Parameters { kind, values, velocity_from: common.velocity_from }
}

/// The tolerances of a kind, from those under `[tolerance]`.
pub(super) fn tolerances(kind: &'static Described, common: &[Named]) -> Vec<Named> {
    let known = |name: &str| kind.parameters.iter().find(|it| it.name == name).map(|it| it.name);
    let all = kind.configurations.tolerances(common);
    all.into_iter().map(|(name, value)| (known(&name).unwrap_or_else(|| kept(&name)), value)).collect()
}

/// The entries of an effect of a plant file. The error of a parameter with values by configuration is an error of the parameters of these
/// configurations.
pub(super) fn entries(kind: &'static Described, entry: &Entry) -> Vec<Entry> {
    let subject = entry.arguments.subject.clone().unwrap_or_default();
    let is_value = entry.description.subject == Subject::Parameter && entry.description.at.is_none();
    let parameter = |configuration: &str| {
        let name = name_in(&subject, configuration);
        kind.parameters.iter().find(|it| it.name == name).map(|it| it.name)
    };
    let mut list = Vec::new();
    let mut rest = entry.clone();
    rest.arguments.numbers.retain(|(name, value)| {
        let Some((number, its)) = parts(name).filter(|_| is_value) else { return true };
        let Some((parameter, number)) = parameter(its).zip(own_name(entry, number)) else { return true };
        let arguments =
            Arguments { subject: Some(parameter.to_string()), numbers: vec![(number, *value)], ..entry.arguments.clone() };
        list.push(Entry { description: entry.description, arguments });
        false
    });
    if !rest.arguments.numbers.is_empty() || list.is_empty() {
        list.insert(0, rest);
    }
    list
}

/// A number of an effect, with the lifetime of its description.
fn own_name(entry: &Entry, number: &str) -> Option<&'static str> {
    entry.description.arguments.iter().find(|it| it.name == number).map(|it| it.name)
}

impl Entry {
    /// The effect in a configuration of its plant, with the numbers of this configuration. `None` if it does not act there.
    #[must_use]
    pub fn in_configuration(&self, configuration: Option<&str>) -> Option<Entry> {
        let mut numbers: Vec<(&'static str, f64)> = Vec::with_capacity(self.arguments.numbers.len());
        for (name, value) in &self.arguments.numbers {
            match parts(name) {
                None => numbers.push((name, *value)),
                Some((number, its)) if Some(its) == configuration => numbers.push((own_name(self, number)?, *value)),
                Some(_) => {}
            }
        }
        // A number that is given for other configurations only is missing here.
        let has_all = self.arguments.numbers.iter().all(|it| numbers.iter().any(|own| own.0 == without(it.0)));
        let subject = match (self.arguments.subject.as_deref(), self.arguments.subject.as_deref().and_then(parts)) {
            (_, Some((parameter, its))) if self.description.subject == Subject::Parameter => {
                if Some(its) != configuration {
                    return None;
                }
                Some(parameter.to_string())
            }
            (subject, _) => subject.map(str::to_string),
        };
        has_all.then(|| Entry {
            description: self.description,
            arguments: Arguments { subject, numbers, ..self.arguments.clone() },
        })
    }

    /// The configurations of its plant in which it acts. Empty for a plant without configurations.
    #[must_use]
    pub fn acts_in(&self) -> Vec<&'static str> {
        let names = self.arguments.plant.0.configurations.names();
        names.filter(|name| self.in_configuration(Some(name)).is_some()).collect()
    }

    /// Whether it acts in all configurations of its plant.
    #[must_use]
    pub fn acts_everywhere(&self) -> bool {
        let is_common = |name: &str| parts(name).is_none();
        let subject = self.arguments.subject.as_deref().filter(|_| self.description.subject == Subject::Parameter);
        let plain = self.arguments.numbers.iter().all(|it| is_common(it.0)) && subject.is_none_or(is_common);
        plain || self.acts_in().len() == self.arguments.plant.0.configurations.list.len()
    }

    /// The effect as it acts in each of these configurations; itself, if no number depends on the configuration.
    #[must_use]
    pub fn variants(&self) -> Vec<Entry> {
        if self.arguments.numbers.iter().all(|it| parts(it.0).is_none()) {
            return vec![self.clone()];
        }
        let names = self.arguments.plant.0.configurations.names();
        names.filter_map(|name| self.in_configuration(Some(name))).collect()
    }
}

impl PlantFile {
    /// The plant of a record: with the parameters and numbers of its configuration, and without configurations.
    #[must_use]
    pub fn along(&self, record: &Record) -> Cow<'_, PlantFile> {
        self.in_configuration(record.configuration)
    }

    /// The plant in a configuration, given by its index. Without an index it has the parameters that the configurations have in common.
    #[must_use]
    pub fn in_configuration(&self, configuration: Option<usize>) -> Cow<'_, PlantFile> {
        let Some(common) = self.kind.common else { return Cow::Borrowed(self) };
        let count = common.parameters.len();
        let mut values = self.parameters.values[..count].to_vec();
        for ((index, place), value) in self.kind.own.iter().zip(&self.parameters.values[count..]) {
            if Some(*place) == configuration {
                values[*index] = *value;
            }
        }
        let name = configuration.and_then(|place| self.kind.configurations.list.get(place)).map(|it| it.name.as_str());
        let of_common = |entry: &Entry| {
            let mut entry = entry.in_configuration(name)?;
            entry.arguments.plant = common;
            Some(entry)
        };
        Cow::Owned(PlantFile {
            kind: common,
            parameters: Parameters { kind: common, values, velocity_from: self.parameters.velocity_from },
            tolerance: Vec::new(),
            noise: self.noise.clone(),
            initial: self.initial.clone(),
            given: self.given.iter().filter_map(of_common).collect(),
            effects: self.effects.iter().filter_map(of_common).collect(),
            columns: self.columns.clone(),
        })
    }
}
