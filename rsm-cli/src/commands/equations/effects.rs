//! `rsm effects`: lists the catalogue, and the sites of a plant on which each effect can act.
//!
//! In: files of effects, optionally a plant. Out: a list.

use std::path::PathBuf;

use clap::Args;
use rsm_model::effects::{Effect, SiteKind};
use serde_json::json;

use super::{catalogue, file, room_lines, rooms_json};
use crate::outcome::{Answer, Outcome};
use crate::output;

#[derive(Args)]
pub struct Arguments {
    /// A plant file: list the effects that can act on this plant, and where
    plant: Option<PathBuf>,
    /// A folder of further effects, one TOML file each
    #[arg(long, value_name = "DIR")]
    effects: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// The parameters of an effect on one of its kinds of sites, with their units. In a unit, `{role}` is replaced by the unit of that role.
fn numbers(effect: &Effect, kind: SiteKind) -> Vec<(String, String)> {
    effect.numbers_on(kind).map(|it| (it.name.clone(), it.unit(kind).to_string())).collect()
}

pub fn run(arguments: &Arguments) -> Outcome {
    let catalogue = catalogue(arguments.effects.as_deref())?;
    let rooms = match &arguments.plant {
        Some(plant) => Some(file(plant, None, arguments.effects.as_deref())?.rooms()?),
        None => None,
    };
    if arguments.json {
        let effects: Vec<_> = catalogue
            .effects()
            .iter()
            .map(|it| {
                let sites: Vec<_> = it
                    .sites
                    .iter()
                    .map(|kind| {
                        let numbers: Vec<_> =
                            numbers(it, *kind).into_iter().map(|(name, unit)| json!({ "name": name, "unit": unit })).collect();
                        json!({ "site": kind.name(), "numbers": numbers })
                    })
                    .collect();
                json!({
                    "kind": it.kind, "sites": sites, "source": it.reference, "sentence": it.words.sentence, "check": it.words.check,
                    "looks_like": it.words.looks_like, "told_apart": it.words.told_apart,
                })
            })
            .collect();
        let room = rooms.as_deref().map(rooms_json);
        output::json(&json!({ "effects": effects, "places": room }))?;
        return Ok(Answer::Positive);
    }
    if let Some(rooms) = rooms {
        for line in room_lines(&rooms) {
            output::line(&line)?;
        }
        return Ok(Answer::Positive);
    }
    for effect in catalogue.effects() {
        output::line(&effect.kind)?;
        for kind in &effect.sites {
            let list: Vec<String> = numbers(effect, *kind).into_iter().map(|(name, unit)| format!("{name} [{unit}]")).collect();
            let list = if list.is_empty() { "no numbers".to_string() } else { list.join(", ") };
            output::line(&format!("  at {}: {list}", kind.name()))?;
        }
        output::line(&format!("  {}", effect.words.sentence))?;
    }
    Ok(Answer::Positive)
}
