//! The terms of a law: chosen one by one from their traces in a free run, and fitted inside of the simulation.
//!
//! In: records, a fitted plant, the form of a law. Out: the plant with the chosen terms, fitted together with all other unknowns. Does not use
//! holdout records.
//!
//! Source: S. A. Billings, Nonlinear System Identification, 2013, chapter 3 (forward selection), with the other unknowns projected out of all traces.

use rsm_sim::equation_plant::added;

use super::terms::Form;
use crate::engine::columns::dot;
use crate::engine::normal::{Normal, symmetric};
use crate::engine::significance::best_gain_by_chance;
use crate::plant::levenberg::{self, Fit};
use crate::plant::model::{Model, Place};
use crate::plant::nuisance::Nuisance;
use crate::plant::posterior::Posterior;
use crate::plant::whitened_residuals::WhitenedResiduals;

/// The largest number of terms. A law with more is a table of its records.
const MOST_TERMS: usize = 12;

/// A term must remove this share of the error above the noise that is left.
pub(super) const LEAST_SHARE: f64 = 0.01;

/// Terms are chosen again from the traces of the fitted law. A free run is not linear in a force that moves it far, so later rounds see more.
const ROUNDS: usize = 5;

/// An exchange of two terms must gain this share more; less is rounding.
const LEAST_EXCHANGE: f64 = 1e-6;

/// Steps of a fit after each round.
const STEPS: usize = 8;

/// A coefficient below this many standard deviations is not determined by the records, and its term is left out.
const LEAST_DEVIATIONS: f64 = 2.0;

/// Makes the model with a law of these terms and coefficients.
type Build<'a> = dyn Fn(&[(usize, f64)]) -> Option<Model> + 'a;

/// A plant with a law.
pub struct WithLaw {
    /// The fit; the law is the last effect of its plant.
    pub fit: Fit,
    /// The terms, in the order of the numbers of the effect.
    pub terms: Vec<Vec<u32>>,
    /// The covariance of the coefficients of all terms of the form, also of those that were not chosen: the choice is a part of the uncertainty.
    pub covariance: Vec<Vec<f64>>,
}

/// Chooses and fits the terms. `base` has the effect of all terms in its catalogue. `None` if no term helps, or if the plant cannot be simulated.
#[must_use]
pub fn select(whitened: &WhitenedResiduals, nominal: &Model, base: Model, form: &Form, effort: f64) -> Option<WithLaw> {
    let (kind, others) = (base.file.kind, base.file.effects.len());
    let with = |of: &Model, chosen: &[(usize, f64)]| -> Option<Model> {
        let mut effects = of.file.effects[..others].to_vec();
        if !chosen.is_empty() {
            let numbers: Vec<(String, f64)> = chosen.iter().map(|(k, value)| (form.number(&form.terms[*k]), *value)).collect();
            effects.push(added::entry(kind, &form.effect(), &form.balance.at, &numbers)?);
        }
        let mut model = of.with_effects(nominal, effects);
        if !chosen.is_empty() {
            for k in own(&model) {
                model.unknowns[k].scale = 0.1 * effort;
            }
        }
        Some(model)
    };
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    let mut fit = levenberg::linearised(whitened, base)?;
    for _ in 0..ROUNDS {
        let wanted = reselected(whitened, &fit, form, &chosen, &|numbers| with(&fit.model, numbers))?;
        let is_new = wanted.iter().any(|it| !chosen.iter().any(|old| old.0 == it.0));
        if wanted.is_empty() || !is_new {
            break;
        }
        let better = with(&fit.model, &wanted).and_then(|it| levenberg::fit(whitened, it, STEPS));
        let Some(better) = better.filter(|it| it.cost < fit.cost) else { break };
        chosen = coefficients(&better, &wanted);
        fit = better;
    }
    let always = always(form, &chosen);
    let missing: Vec<(usize, f64)> =
        always.iter().filter(|k| !chosen.iter().any(|it| it.0 == **k)).map(|k| (*k, 0.0)).collect();
    if !chosen.is_empty() && !missing.is_empty() {
        chosen.extend(missing);
        fit = levenberg::fit(whitened, with(&fit.model, &chosen)?, STEPS)?;
        chosen = coefficients(&fit, &chosen);
    }
    while let Some(weakest) = undetermined(&fit, &chosen, &always) {
        chosen.remove(weakest);
        fit = levenberg::fit(whitened, with(&fit.model, &chosen)?, STEPS)?;
        chosen = coefficients(&fit, &chosen);
    }
    if chosen.is_empty() {
        return None;
    }
    let covariance = Traces::of(whitened, &fit, form, &chosen, &|numbers| with(&fit.model, numbers))?.covariance(&fit);
    Some(WithLaw { terms: chosen.iter().map(|it| form.terms[it.0].clone()).collect(), covariance, fit })
}

/// The indices of the unknowns of a model's last effect, the law, in the order of its numbers.
#[must_use]
pub fn own(model: &Model) -> Vec<usize> {
    let count = model.file.effects.len();
    let is_own = |k: &usize| matches!(model.unknowns[*k].place, Place::Effect { entry, .. } if entry + 1 == count);
    (0..model.unknowns.len()).filter(is_own).collect()
}

/// The chosen terms with the coefficients of a fit.
fn coefficients(fit: &Fit, chosen: &[(usize, f64)]) -> Vec<(usize, f64)> {
    chosen.iter().zip(own(&fit.model)).map(|((term, _), unknown)| (*term, fit.model.value(unknown))).collect()
}

/// The terms that every law has: the constant, and those of first order of its variables. Parameters of the plant often have the same traces (a
/// viscous friction, a rolling resistance). Without these terms such a parameter would take their part, and the band of the curve would be too
/// narrow.
fn always(form: &Form, chosen: &[(usize, f64)]) -> Vec<usize> {
    let is_used = |variable: usize| chosen.iter().any(|it| form.terms[it.0][variable] > 0);
    let is_low = |term: &Vec<u32>| {
        let has_sign = term.iter().skip(form.variables.len()).any(|power| *power > 0);
        let first = term.iter().position(|power| *power > 0);
        !has_sign && term.iter().sum::<u32>() <= 1 && first.is_none_or(is_used)
    };
    (0..form.terms.len()).filter(|k| is_low(&form.terms[*k])).collect()
}

/// The chosen term whose coefficient is the least determined, if it is below the limit; never one that every law has.
fn undetermined(fit: &Fit, chosen: &[(usize, f64)], always: &[usize]) -> Option<usize> {
    let posterior = Posterior::of(fit);
    let deviations = |unknown: usize| {
        let sd = posterior.deviations()[unknown].filter(|it| *it > 0.0)?;
        Some(fit.model.value(unknown).abs() / sd)
    };
    let open = own(&fit.model).into_iter().zip(0..chosen.len()).filter(|(_, place)| !always.contains(&chosen[*place].0));
    let each = open.map(|(unknown, place)| (place, deviations(unknown).unwrap_or(0.0)));
    each.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|it| it.1 < LEAST_DEVIATIONS).map(|it| it.0)
}

/// The traces of all terms at a fit, with the other unknowns projected out: the changes of the whitened simulation by their coefficients.
struct Traces {
    /// The terms in the order of the traces: first those of the law, then the others, each with its coefficient.
    all: Vec<(usize, f64)>,
    /// Inner products of the traces, row by row.
    gram: Vec<f64>,
    /// Inner products with the residual of the plant without the law.
    right: Vec<f64>,
    /// The squared residual of the plant without the law.
    whole: f64,
}

impl Traces {
    fn of(whitened: &WhitenedResiduals, fit: &Fit, form: &Form, chosen: &[(usize, f64)], with: &Build<'_>) -> Option<Traces> {
        let mut all = chosen.to_vec();
        all.extend((0..form.terms.len()).filter(|k| !chosen.iter().any(|it| it.0 == *k)).map(|k| (k, 0.0)));
        let model = with(&all)?;
        let columns = whitened.derivatives(&model, &fit.simulated, &own(&model))?;
        let others = without_law(fit, chosen.len());
        let nuisance = Nuisance::new(&others);
        let products: Vec<Vec<f64>> = columns.iter().map(|it| nuisance.products(&it.values)).collect();
        let n = columns.len();
        let gram = symmetric(n, |i, j| nuisance.between(columns[i].dot(&columns[j]), &products[i], &products[j], 0));
        // The residual without the law: to first order, what its terms explain now is added.
        let explained = |i: usize| chosen.iter().enumerate().map(|(j, it)| gram[i * n + j] * it.1).sum::<f64>();
        let right: Vec<f64> =
            (0..n).map(|i| nuisance.with_residual(&columns[i].values, &products[i], 0) + explained(i)).collect();
        let now: f64 = (0..chosen.len()).map(|i| chosen[i].1 * (2.0 * right[i] - explained(i))).sum();
        let whole = dot(&fit.residual, &fit.residual) + now;
        Some(Traces { all, gram, right, whole })
    }

    /// The covariance of the coefficients of all terms, in the order of the form, if all of them were free. If more than noise is left, it is larger
    /// accordingly.
    fn covariance(&self, fit: &Fit) -> Vec<Vec<f64>> {
        let spread = (fit.cost / fit.residual.len().max(1) as f64).max(1.0);
        let n = self.all.len();
        let normal = Normal::new(&self.gram, n, 0.0);
        let mut covariance = vec![vec![0.0; n]; n];
        for (i, (term, _)) in self.all.iter().enumerate() {
            for ((other, _), value) in self.all.iter().zip(normal.covariances(i)) {
                covariance[*term][*other] = spread * value;
            }
        }
        covariance
    }
}

/// All terms chosen again, from their traces at a fit: a step of Gauss and Newton in which the set of terms is free too. Each with a first
/// coefficient.
fn reselected(
    whitened: &WhitenedResiduals,
    fit: &Fit,
    form: &Form,
    chosen: &[(usize, f64)],
    with: &Build<'_>,
) -> Option<Vec<(usize, f64)>> {
    let Traces { all, gram, right, whole } = Traces::of(whitened, fit, form, chosen, with)?;
    let n = all.len();
    let rows = fit.residual.len() as f64;
    let gain_of = |set: &[usize]| solved(&gram, &right, n, set);
    let best_of = |sets: &mut dyn Iterator<Item = Vec<usize>>| {
        let each = sets.filter_map(|set| gain_of(&set).map(|(values, gain)| (set, values, gain)));
        each.max_by(|a, b| a.2.total_cmp(&b.2))
    };
    let (mut taken, mut shares, mut gain): (Vec<usize>, Vec<f64>, f64) = (Vec::new(), Vec::new(), 0.0);
    while taken.len() < MOST_TERMS {
        let open = (0..n).filter(|k| !taken.contains(k));
        let Some(mut next) = best_of(&mut open.map(|k| [taken.clone(), vec![k]].concat())) else { break };
        // A term that was best alone may be worse than another beside the later ones.
        loop {
            let exchanged = (0..next.0.len()).flat_map(|place| {
                let set = next.0.clone();
                (0..n).filter(|k| !next.0.contains(k)).map(move |k| {
                    let mut other = set.clone();
                    other[place] = k;
                    other
                })
            });
            match best_of(&mut exchanged.collect::<Vec<_>>().into_iter()) {
                Some(better) if better.2 > next.2 * (1.0 + LEAST_EXCHANGE) => next = better,
                _ => break,
            }
        }
        // What is left is no noise, so chance can gain as many times more.
        let left = whole - gain;
        let by_chance = best_gain_by_chance(n, 1) * (left / rows).max(1.0);
        if next.2 - gain < by_chance.max(LEAST_SHARE * (left - rows)) {
            break;
        }
        (taken, shares, gain) = next;
    }
    Some(taken.into_iter().zip(shares).map(|(k, share)| (all[k].0, share)).collect())
}

/// A fit in which the coefficients of the law, if it has one, are not free.
fn without_law(fit: &Fit, terms: usize) -> Fit {
    let own = if terms == 0 { Vec::new() } else { own(&fit.model) };
    let mut others = fit.clone();
    let kept: Vec<usize> = (0..fit.free.len()).filter(|k| !own.contains(&fit.free[*k])).collect();
    others.free = kept.iter().map(|k| fit.free[*k]).collect();
    others.columns = kept.iter().map(|k| fit.columns[*k].clone()).collect();
    others.held.retain(|it| !own.contains(&it.unknown));
    others
}

/// The coefficients of a set of traces and their gain; `None` if a trace of the set is a combination of the others.
fn solved(gram: &[f64], right: &[f64], n: usize, set: &[usize]) -> Option<(Vec<f64>, f64)> {
    let size = |k: usize| gram[k * n + k].sqrt();
    if set.iter().any(|k| size(*k).is_nan() || size(*k) == 0.0) {
        return None;
    }
    let scaled: Vec<f64> = set
        .iter()
        .flat_map(|i| set.iter().map(move |j| (*i, *j)))
        .map(|(i, j)| gram[i * n + j] / (size(i) * size(j)))
        .collect();
    let normal = Normal::fine(&scaled, set.len());
    // The variance of the last coefficient over what it would be alone: above a million the traces are the same within the errors of differences.
    let last = set.len() - 1;
    if normal.covariances(last)[last] > 1e6 {
        return None;
    }
    let values = normal.solve(&set.iter().map(|k| right[*k] / size(*k)).collect::<Vec<f64>>());
    let gain = values.iter().zip(set).map(|(value, k)| value * right[*k] / size(*k)).sum();
    Some((values.iter().zip(set).map(|(value, k)| value / size(*k)).collect(), gain))
}
