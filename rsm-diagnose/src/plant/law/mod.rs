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
    let records: Vec<&Record> = split.training.records.iter().map(|it| &it.record).collect();
    let scales = equation_plant::scales(&base.model.file, &records).ok()?;
    let values = visited(&split.training, &base.model, &sites.iter().collect::<Vec<_>>());
    let judged = |site: &added::Balance, values: &[Vec<f64>]| -> Option<(f64, Candidate, Fit)> {
        let sizes = scales.iter().filter(|it| it.at == site.at).flat_map(|it| &it.sizes);
        let effort = sizes.filter(|it| it.0 == "effort_scale").map(|it| it.1).find(|it| *it > 0.0)?;
        let candidate = Candidate::of(Form::new(site, values)?, effort, &split.training, nominal, &base)?;
        let after = validation::fit_initial_states(&split.judged, &candidate.law.fit.model)?;
        Some((gain(&errors_before, &validation::errors(&split.judged, &after)), candidate, after))
    };
    let mut best: Option<(f64, Candidate, Fit)> = None;
    for (site, values) in sites.iter().zip(&values) {
        progress(&format!("looking for an unknown law at {}", site.at));
        best = judged(site, values).filter(|it| best.as_ref().is_none_or(|best| it.0 > best.0)).or(best);
    }
    if let Some((most, several, _)) = &best
        && contain_several(&several.law.terms, several.form.variables.len())
        && let Some((site, values)) = sites.iter().zip(&values).find(|(site, _)| site.at == several.form.balance.at)
    {
        // Terms of a second variable may only do what the first one would do with more terms.
        let alone: Vec<Vec<f64>> =
            values.iter().enumerate().map(|(k, it)| if k == 0 { it.clone() } else { Vec::new() }).collect();
        best = judged(site, &alone).filter(|one| is_enough_alone(one.0, *most)).or(best);
    }
    let (gain, candidate, after) = best?;
    let interval = bootstrap::gain_interval(&split.judged, &before.simulated, &after.simulated, gain_of);
    let rows = split.judged.rows() as f64;
    let is_better = helped.is_none_or(|it| after.cost - rows < TIMES_THE_HELPERS * (it.cost - rows).max(0.0) + rows.sqrt());
    (gain >= LEAST_GAIN && interval.0 > 0.0 && is_better).then(|| candidate.law(whitened, &named, gain, interval)).flatten()
}

/// Whether terms contain more than one of the first so many variables.
fn contain_several(terms: &[Vec<u32>], variables: usize) -> bool {
    (0..variables).filter(|variable| terms.iter().any(|it| it[*variable] > 0)).count() > 1
}

/// Whether a law of one variable with this gain is preferred to one of several: the other variables add less than one term must.
fn is_enough_alone(gain: f64, of_several: f64) -> bool {
    gain > of_several - selection::LEAST_SHARE
}

/// A law at a site, fitted to the training records.
struct Candidate {
    form: Form,
    law: WithLaw,
}

impl Candidate {
    /// `effort`: the largest term of the balance.
    fn of(form: Form, effort: f64, training: &WhitenedResiduals, nominal: &Model, base: &Fit) -> Option<Candidate> {
        let text = form.text(&form.terms, "");
        let plant = added::with_effect(&base.model.file, EFFECT_FILE, &text).ok()?;
        let base = Model { file: plant, ..base.model.clone() };
        let law = selection::select(training, nominal, base, &form, effort)?;
        Some(Candidate { form, law })
    }

    /// The law, fitted to all training records, in a plant whose effect has the chosen terms only.
    fn law(self, whitened: &WhitenedResiduals, named: &Model, gain: f64, interval: (f64, f64)) -> Option<Law> {
        let Candidate { form, law: WithLaw { fit, terms, covariance } } = self;
        let at = form.balance.at.clone();
        let sentence = format!("An unknown {} acts at {at}. It is a surface fitted to records.", form.balance.term);
        let mut before = fit.model.file.clone();
        let entry = before.effects.pop()?;
        let before = PlantFile { kind: named.file.kind, ..before };
        let plain = added::with_effect(&before, EFFECT_FILE, &form.text(&terms, &sentence)).ok()?;
        let numbers: Vec<(String, f64)> =
            entry.arguments.numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
        let own = added::entry(plain.kind, &form.effect(), &at, &numbers)?;
        let unit = own.description.arguments.first().map_or(String::new(), |it| match it.unit {
            Unit::Is(unit) => unit.to_string(),
            _ => String::new(),
        });
        let effects: Vec<Entry> = plain.effects.iter().cloned().chain([own]).collect();
        let scales: Vec<f64> = selection::own(&fit.model).into_iter().map(|k| fit.model.unknowns[k].scale).collect();
        let mut model = Model { file: plain, ..named.clone() }.with_effects(named, effects);
        for (k, scale) in selection::own(&model).into_iter().zip(scales) {
            model.unknowns[k].scale = scale;
        }
        let fit = levenberg::fit(whitened, model, STEPS)?;
        let coefficients: Vec<f64> = selection::own(&fit.model).into_iter().map(|k| fit.model.value(k)).collect();
        let all = visited(whitened, &fit.model, &[&form.balance]).remove(0);
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

/// The values of the variables of some sites along all records, one after another. Records that the plant cannot follow are left out.
fn visited(whitened: &WhitenedResiduals, model: &Model, sites: &[&added::Balance]) -> Vec<Vec<Vec<f64>>> {
    let mut all: Vec<Vec<Vec<f64>>> = sites.iter().map(|site| vec![Vec::new(); site.variables.len()]).collect();
    for (k, prepared) in whitened.records.iter().enumerate() {
        let file = model.for_record(k, &prepared.record);
        let own = added::along(&file, &prepared.record, sites).unwrap_or_default();
        for (all, own) in all.iter_mut().flatten().zip(own.into_iter().flatten()) {
            all.extend(own);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_variable_is_enough_where_the_others_remove_less_than_a_term_must() {
        // Speed, position, the sign of the speed.
        assert!(!contain_several(&[vec![1, 0, 0], vec![3, 0, 1]], 2));
        assert!(contain_several(&[vec![1, 0, 0], vec![0, 2, 0]], 2) && contain_several(&[vec![1, 1, 0]], 2));
        assert!(!contain_several(&[vec![0, 0, 0]], 2));
        assert!(is_enough_alone(0.99, 0.995) && is_enough_alone(0.99, 0.95) && !is_enough_alone(0.9, 0.995));
    }
}
