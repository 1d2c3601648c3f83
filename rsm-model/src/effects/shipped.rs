//! The catalogue: the effects of the project, and a user's own effects.

use std::sync::{Arc, OnceLock};

use rsm_core::source::{Collector, Fault, Faults, Source};
use rsm_core::toml_reader::{TableReader, parse};

use super::file::Effect;
use super::site::Site;

/// Files of effects and sites that are part of the project, by name.
mod files {
    include!(concat!(env!("OUT_DIR"), "/files.rs"));
}

/// Effects by kind.
#[derive(Debug, Clone)]
pub struct Catalogue {
    /// Shared between clones: plant files are read often and rarely add an effect.
    effects: Arc<Vec<Effect>>,
}

impl Catalogue {
    /// The effects that come with the project, in the order of their kinds.
    ///
    /// # Panics
    /// Never: a test reads every file.
    #[must_use]
    pub fn shipped() -> Catalogue {
        static READ: OnceLock<Arc<Vec<Effect>>> = OnceLock::new();
        let read = |(name, text): &(&str, &str)| {
            Effect::read(&Source::new(format!("rsm:effects/{name}"), *text)).unwrap_or_else(|faults| panic!("{faults}"))
        };
        Catalogue { effects: READ.get_or_init(|| Arc::new(files::EFFECTS.iter().map(read).collect())).clone() }
    }

    /// Adds a user's effects. They are treated like the project's own; a kind that already exists is rejected.
    ///
    /// # Errors
    /// All faults of all files.
    pub fn add(&mut self, sources: &[Source]) -> Result<(), Faults> {
        let mut faults = Collector::new();
        for source in sources {
            match Effect::read(source) {
                Ok(effect) => match self.find(&effect.kind) {
                    Some(other) => {
                        let what = format!("the kind `{}` is in {} already", effect.kind, other.source.name());
                        faults.push(Fault::whole_file(source.name(), what));
                    }
                    None => Arc::make_mut(&mut self.effects).push(effect),
                },
                Err(found) => found.list().iter().for_each(|it| faults.push(it.clone())),
            }
        }
        faults.finish(Some(()))
    }

    /// The effect with this kind.
    #[must_use]
    pub fn find(&self, kind: &str) -> Option<&Effect> {
        self.effects.iter().find(|it| it.kind == kind)
    }

    /// All effects.
    #[must_use]
    pub fn effects(&self) -> &[Effect] {
        &self.effects
    }
}

/// The file that comes with a model of the project: its sites, and the parameters that a record sets.
#[must_use]
pub fn shipped_file(model: &str) -> Option<Source> {
    let (name, text) = files::SITES.iter().find(|(name, _)| *name == model)?;
    Some(Source::new(format!("rsm:sites/{name}"), *text))
}

/// The sites of a model that comes with the project.
///
/// # Panics
/// Never: a test reads every file.
#[must_use]
pub fn sites_of(model: &str) -> Vec<Site> {
    let Some(source) = shipped_file(model) else { return Vec::new() };
    let mut faults = Collector::new();
    let sites = parse(&source, &mut faults).map_or_else(Vec::new, |document| {
        let mut top = TableReader::document(&source, &document);
        top.optional("sites").map_or_else(Vec::new, |value| Site::read_all(&source, value, &mut faults))
    });
    if let Err(faults) = faults.finish(Some(())) {
        panic!("{faults}");
    }
    sites
}
