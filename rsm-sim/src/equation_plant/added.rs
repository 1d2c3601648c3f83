//! An effect that belongs to one plant: it is added to the plant's catalogue, and its sites are described.
//!
//! In: a plant file of format 2, the text of an effect. Out: the same plant, on which the effect is possible; and what a law at a site can depend on,
//! with its values along a record.

use std::sync::Arc;

use rsm_core::source::{Fault, Faults, Source};
use rsm_model::effects::SiteKind;
use rsm_model::expression::Id;
use rsm_model::system::System;

use super::{effects_on, plant_of, read_with, run};
use crate::effect::Arguments;
use crate::equations::effect_files::KEY;
use crate::kind::PlantKind;
use crate::plant_file::{Entry, PlantFile};
use crate::record::Record;

/// A site with a balance, to which a law can add a term.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Balance {
    /// The name of the site in the plant file.
    pub at: String,
    /// The kind of the site, as effect files name it.
    pub kind: &'static str,
    /// The name of the added term in effect files.
    pub term: &'static str,
    /// The unit of the added term, as effect files write it.
    pub unit: &'static str,
    /// The variables of the site on which a law can depend, with their units. The first is the one in whose balance the term is.
    pub variables: Vec<(String, String)>,
}

/// The sites of a plant that have a balance.
#[must_use]
pub fn balances(kind: PlantKind) -> Vec<Balance> {
    if kind.is_first_format {
        return Vec::new();
    }
    let one = |place: &rsm_model::effects::Place| {
        let (state, _, term) = place.kind.balance()?;
        let (unit, further) = match place.kind {
            SiteKind::Rotation => ("N.m", Some("position")),
            SiteKind::Translation => ("N", Some("position")),
            SiteKind::Vehicle => ("N.m", None),
            SiteKind::Storage => ("{capacity}.{level}/s", None),
            SiteKind::Heat => ("{capacity}.{temperature}/s", None),
            _ => return None,
        };
        let names = [Some(state), further];
        let role = |name: &&str| place.roles.iter().find(|it| it.role == *name && it.parts.len() == 1);
        let variables: Vec<(String, String)> =
            names.iter().flatten().filter_map(role).map(|it| (it.role.clone(), it.unit.clone())).collect();
        let is_whole = variables.first().is_some_and(|it| it.0 == state);
        is_whole.then(|| Balance { at: place.at.clone(), kind: place.kind.name(), term, unit, variables })
    };
    plant_of(kind.0).places.iter().filter_map(one).collect()
}

/// The values of the variables of some sites along a record, at a few hundred rows, evenly spread: for each site, for each variable. `None` if the
/// plant cannot follow the record. Effects of the file act; the variables are those of the equations without them.
#[must_use]
pub fn along(file: &PlantFile, record: &Record, sites: &[&Balance]) -> Option<Vec<Vec<Vec<f64>>>> {
    let (whole, machine, points) = run::with_effects(file, record, run::spread(record)).ok()?;
    let places = whole.places_of_effects().ok()?;
    let part = |at: &str, name: &str| {
        let place = places.list.iter().find(|it| it.at == at)?;
        place.roles.iter().find(|it| it.role == name).map(|it| it.parts[0])
    };
    let all = sites.iter().flat_map(|site| site.variables.iter().map(|it| part(&site.at, &it.0)));
    let roles: Vec<Id> = all.collect::<Option<_>>()?;
    let mut system = System::new(&places.flat).ok()?;
    let roles: Vec<Id> = roles.into_iter().map(|id| system.expressed(id)).collect();
    let rows = machine.evaluated_at(&whole, &system, &roles, &points).ok()?;
    let mut columns = (0..roles.len()).map(|k| rows.iter().map(|row| row[k]).collect());
    Some(sites.iter().map(|site| columns.by_ref().take(site.variables.len()).collect()).collect())
}

/// The plant with one more file of an effect. Its parameters, its other effects and all other data stay.
///
/// # Errors
/// Faults of the file; a kind of effect that exists already; a plant file of format 1.
pub fn with_effect(file: &PlantFile, name: &str, text: &str) -> Result<PlantFile, Faults> {
    let kind = file.kind;
    if kind.is_first_format {
        return Err(of_first_format(name));
    }
    let wrong = |what: String| Faults::one(Fault::whole_file(kind.name, what));
    let mut whole: toml::Table = kind.text.parse().map_err(|error: toml::de::Error| wrong(error.to_string()))?;
    let list = whole.entry(KEY).or_insert_with(|| toml::Value::Array(Vec::new()));
    list.as_array_mut().ok_or_else(|| wrong(format!("`{KEY}` is no list")))?.push(toml::Value::String(name.to_string()));
    // Effects are added below, with their present numbers.
    whole.remove("effects");
    let open = |wanted: &str| {
        let own = (wanted == name).then_some(text);
        let found = own.or_else(|| kind.files.iter().find(|it| it.0 == wanted).map(|it| it.1.as_str()));
        found
            .map(|text| Source::new(wanted, text))
            .ok_or_else(|| wrong(format!("the file {wanted} was not read with the plant")))
    };
    let catalogue = plant_of(kind.0).given.clone();
    let mut added = read_with(&Source::new(kind.name, whole.to_string()), &open, &catalogue)?;
    let new = added.kind;
    let moved =
        |list: &[Entry]| -> Result<Vec<Entry>, Faults> { list.iter().map(|it| on(new, it).ok_or_else(|| lost(it))).collect() };
    (added.given, added.effects) = (moved(&file.given)?, moved(&file.effects)?);
    added.parameters.values.clone_from(&file.parameters.values);
    (added.tolerance, added.noise, added.initial) = (file.tolerance.clone(), file.noise.clone(), file.initial.clone());
    Ok(added)
}

fn of_first_format(name: &str) -> Faults {
    Faults::one(Fault::whole_file(name, "found a plant file of format 1, expected one of format 2"))
}

fn lost(entry: &Entry) -> Faults {
    Faults::one(Fault::whole_file(entry.description.kind, "this effect is not possible on the extended plant"))
}

/// An entry of a plant, on the same plant with another catalogue.
fn on(kind: PlantKind, entry: &Entry) -> Option<Entry> {
    let old = entry.description;
    let description = effects_on(kind).into_iter().find(|it| it.kind == old.kind && it.at == old.at)?;
    Some(Entry { description, arguments: Arguments { plant: kind, ..entry.arguments.clone() } })
}

/// The entry of an added effect at a site, with these numbers.
#[must_use]
pub fn entry(kind: PlantKind, effect: &str, at: &str, numbers: &[(String, f64)]) -> Option<Entry> {
    let description = effects_on(kind).into_iter().find(|it| it.kind == effect && it.at == Some(at))?;
    let one =
        |(name, value): &(String, f64)| description.arguments.iter().find(|it| it.name == name).map(|it| (it.name, *value));
    let numbers = numbers.iter().map(one).collect::<Option<Vec<_>>>()?;
    Some(Entry { description, arguments: Arguments { plant: kind, subject: Some(at.to_string()), numbers } })
}

/// A catalogue as it was given to the reader of a plant file.
pub(super) type Given = Arc<rsm_model::effects::Catalogue>;
