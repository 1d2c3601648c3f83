//! A law that is in no textbook: where structure is left that no effect of the catalogue explains, an unknown term in the balance of a site.
//!
//! ```text
//!   plant with the named causes --added::balances--> sites --terms--> candidate terms
//!       --selection--> terms and coefficients, inside of the simulation --holdout--> the site with the largest gain --curve--> curve, band, forms
//! ```
//!
//! In: records, the plant of a diagnosis that ended `unexplained`. Out: a [`Law`] if it removes error on rows that did not fit it, and leaves about
//! as little there as all helpers do. The law names no cause: the verdict stays `unexplained`. Only plants of equations have sites.

pub mod curve;
pub mod selection;
pub mod terms;

use rsm_core::model::{Evidence, Model as SurfaceModel};
use rsm_sim::effect::Unit;
use rsm_sim::equation_plant::{self, added};
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;

use super::bootstrap;
use super::levenberg::{self, Fit};
use super::model::{Model, Place};
use super::validation::{self, gain, gain_of};
use super::whitened_residuals::WhitenedResiduals;
use curve::{Curve, Fitted, Textbook, joined};
use selection::WithLaw;
use terms::Form;

/// The file of the effect that the extended plant names.
pub const EFFECT_FILE: &str = "law-effect.toml";

/// The model file with the law as a surface.
pub const MODEL_FILE: &str = "law.toml";

/// Steps of a fit of the plant with the named causes alone.
const STEPS: usize = 8;

/// The smallest useful gain: the share of the error above the noise that a law must remove on holdout rows.
const LEAST_GAIN: f64 = 0.1;

/// A law may leave this many times the error above the noise that all helpers together leave: it is one statement about one site, and they are
/// several about different places.
const TIMES_THE_HELPERS: f64 = 2.0;

/// A law of a site.
#[derive(Debug, Clone)]
pub struct Law {
    /// The site.
    pub at: String,
    /// The variables of the site on which it depends.
    pub inputs: Vec<String>,
    /// The surface in [`Law::model`].
    pub surface: String,
    /// The unit of the term that it adds to the balance.
    pub unit: String,
    /// The law as a model file.
    pub model: SurfaceModel,
    /// The share of the error above the noise that it removes on holdout rows, from the plant with the named causes.
    pub gain: f64,
    /// The 95 % interval of the gain.
    pub gain_interval: (f64, f64),
    /// The law over each of its variables.
    pub curves: Vec<Curve>,
    /// The nearest textbook forms, the nearest first.
    pub textbook: Vec<Textbook>,
    /// One sentence.
    pub words: String,
    /// The plant with the named causes and the law, fitted to all training records. The law is its last effect.
    pub fit: Fit,
}

/// Records that fit a law, and records that judge it.
struct Split {
    training: WhitenedResiduals,
    judged: WhitenedResiduals,
}

impl Split {
    /// Validation records judge. Without any, the last training record does.
    fn of(whitened: &WhitenedResiduals, unseen: &WhitenedResiduals) -> Option<Split> {
        if !unseen.records.is_empty() {
            return Some(Split { training: whitened.clone(), judged: unseen.clone() });
        }
        let (last, first) = whitened.records.split_last()?;
        if first.is_empty() {
            return None;
        }
        Some(Split { training: whitened.with_records(first.to_vec()), judged: whitened.with_records(vec![last.clone()]) })
    }

    /// The model for the training records alone.
    fn cut(&self, model: &Model) -> Model {
        let mut cut = model.clone();
        let count = self.training.records.len();
        cut.starts.truncate(count);
        cut.unknowns.retain(|it| !matches!(it.place, Place::Start { record, .. } if record >= count));
        cut
    }
}

/// Looks for a law at each site. `fit` is the plant with all causes and helpers, and `named` those of its effects that are named causes.
#[must_use]
pub fn find(
    whitened: &WhitenedResiduals,
    unseen: &WhitenedResiduals,
    nominal: &Model,
    fit: &Fit,
    named: &[Entry],
    progress: &dyn Fn(&str),
) -> Option<Law> {
    let sites = added::balances(fit.model.file.kind);
    if sites.is_empty() {
        return None;
    }
    let split = Split::of(whitened, unseen)?;
    let named = fit.model.with_effects(nominal, named.to_vec());
    let base = levenberg::fit(&split.training, split.cut(&named), STEPS)?;
    let before = validation::fit_initial_states(&split.judged, &base.model)?;
    let errors_before = validation::errors(&split.judged, &before);
    let helped = validation::fit_initial_states(&split.judged, &fit.model);
    let mut best: Option<(f64, Candidate, Fit)> = None;
    for site in &sites {
        progress(&format!("looking for an unknown law at {}", site.at));
        let Some(candidate) = Candidate::at(&split.training, nominal, &base, site) else { continue };
        let Some(after) = validation::fit_initial_states(&split.judged, &candidate.law.fit.model) else { continue };
        let gain = gain(&errors_before, &validation::errors(&split.judged, &after));
        if best.as_ref().is_none_or(|it| gain > it.0) {
            best = Some((gain, candidate, after));
        }
    }
    let (gain, candidate, after) = best?;
    let interval = bootstrap::gain_interval(&split.judged, &before.simulated, &after.simulated, gain_of);
    let rows = split.judged.rows() as f64;
    let is_better = helped.is_none_or(|it| after.cost - rows < TIMES_THE_HELPERS * (it.cost - rows).max(0.0) + rows.sqrt());
    (gain >= LEAST_GAIN && interval.0 > 0.0 && is_better).then(|| candidate.law(whitened, &named, gain, interval)).flatten()
}

/// A law at a site, fitted to the training records.
struct Candidate {
    form: Form,
    law: WithLaw,
}

impl Candidate {
    fn at(training: &WhitenedResiduals, nominal: &Model, base: &Fit, site: &added::Balance) -> Option<Candidate> {
        let form = Form::new(site, &visited(training, &base.model, site))?;
        let text = form.text(&form.terms, "");
        let plant = added::with_effect(&base.model.file, EFFECT_FILE, &text).ok()?;
        let records: Vec<&Record> = training.records.iter().map(|it| &it.record).collect();
        let scales = equation_plant::scales(&base.model.file, &records).ok()?;
        let sizes = &scales.iter().find(|it| it.at == site.at)?.sizes;
        let effort = sizes.iter().find(|it| it.0 == "effort_scale").map(|it| it.1).filter(|it| *it > 0.0)?;
        let law = selection::select(training, nominal, base, &plant, &form, effort)?;
        Some(Candidate { form, law })
    }

    /// The law, fitted to all training records, in a plant whose effect has the chosen terms only.
    fn law(self, whitened: &WhitenedResiduals, named: &Model, gain: f64, interval: (f64, f64)) -> Option<Law> {
        let Candidate { form, law: WithLaw { fit, terms, covariance } } = self;
        let at = form.balance.at.clone();
        let sentence = format!("An unknown {} acts at {at}. It is a surface fitted to records.", form.balance.term);
        let mut before = fit.model.file.clone();
        let entry = before.effects.pop()?;
        let plain = PlantFile { kind: named.file.kind, effects: named.file.effects.clone(), ..before.clone() };
        let mut plain = added::with_effect(&plain, EFFECT_FILE, &form.text(&terms, &sentence)).ok()?;
        for (own, fitted) in plain.effects.iter_mut().zip(&before.effects) {
            own.arguments.numbers.clone_from(&fitted.arguments.numbers);
        }
        for unknown in &named.unknowns {
            if let Place::Nominal(name) = unknown.place {
                plain.parameters.set(name, before.parameters.number(name));
            }
        }
        let numbers: Vec<(String, f64)> =
            entry.arguments.numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
        let own = added::entry(plain.kind, &form.effect(), &at, &numbers)?;
        let unit = own.description.arguments.first().map_or(String::new(), |it| match it.unit {
            Unit::Is(unit) => unit.to_string(),
            _ => String::new(),
        });
        let effects: Vec<Entry> = plain.effects.iter().cloned().chain([own]).collect();
        let scales: Vec<f64> = selection::own(&fit.model).into_iter().map(|k| fit.model.unknowns[k].scale).collect();
        let mut model = Model { file: plain, ..named.clone() };
        let nominal = named.clone();
        model = model.with_effects(&nominal, effects);
        for (k, scale) in selection::own(&model).into_iter().zip(scales) {
            model.unknowns[k].scale = scale;
        }
        let fit = levenberg::fit(whitened, model, STEPS)?;
        let coefficients: Vec<f64> = selection::own(&fit.model).into_iter().map(|k| fit.model.value(k)).collect();
        let all = visited(whitened, &fit.model, &form.balance);
        // Only the variables of the form, which vary.
        let is_kept = |name: &str| form.variables.iter().any(|it| it.name == name);
        let kept: Vec<Vec<f64>> =
            form.balance.variables.iter().zip(all).filter(|(it, _)| is_kept(&it.0)).map(|(_, values)| values).collect();
        if kept.iter().any(|values| !values.iter().any(|it| it.is_finite())) {
            return None;
        }
        let fitted =
            Fitted { form: &form, terms: &terms, coefficients: &coefficients, covariance: &covariance, visited: &kept };
        let (inputs, textbook, curves) = (fitted.inputs(), fitted.textbook(), fitted.curves());
        let nearest = textbook.first().map_or(String::new(), |it| {
            format!(" The nearest textbook form is {} (misfit {:.0} %).", it.words, 100.0 * it.misfit)
        });
        let words = format!(
            "At {at} an unknown {} acts. It depends on {}. It removes {:.1} % of the error above the noise on rows that did not fit it.{nearest}",
            form.balance.term,
            joined(&inputs),
            100.0 * gain,
        );
        let mut model = form.model(&terms, &coefficients, &unit);
        model.surfaces[0].evidence = vec![
            (
                "what".to_string(),
                Evidence::Text(format!("an unknown {} at {at}, fitted to records: no textbook law", form.balance.term)),
            ),
            ("gain_on_unseen_rows".to_string(), Evidence::Number(gain)),
        ];
        let surface = form.surface();
        Some(Law { at, inputs, surface, unit, model, gain, gain_interval: interval, curves, textbook, words, fit })
    }
}

/// The values of the variables of a site along all records, one after another. Records that the plant cannot follow are left out.
fn visited(whitened: &WhitenedResiduals, model: &Model, site: &added::Balance) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = vec![Vec::new(); site.variables.len()];
    for (k, prepared) in whitened.records.iter().enumerate() {
        let file = model.for_record(k, &prepared.record);
        for (all, own) in all.iter_mut().zip(added::along(&file, &prepared.record, site).unwrap_or_default()) {
            all.extend(own);
        }
    }
    all
}
