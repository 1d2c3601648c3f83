//! The causes of a report, with their confidence and the rivals with the same trace.
//!
//! In: a sample, its explanation, estimates, all hypotheses. Out: the list of [`Cause`]s, the strongest first; `narrative` gives their sentences and
//! parameters. Does not change the set of causes.

pub use super::cause::{Cause, OutlyingRun, Parameter};
use super::choice::{Contribution, candidates, contribution};
use super::estimate::Estimates;
use super::explained::{self, Explained};
use super::hypotheses::{Hypothesis, HypothesisKind, Part};
use super::narrative::Narrative;
use super::null::Thresholds;
use super::sample::Sample;
use super::search::Search;
use crate::engine::combinations::{self, Combinations};
use crate::engine::probability::Probability;
use crate::engine::significance::f_of;
use rsm_core::order;

/// A rival that fits worse by less than this is not ruled out: 2 ln 19, odds of 95 to 5. A wrong rival is ahead of the truth by more only once in 20
/// cases, because the mean of a likelihood ratio under the truth is 1 (Markov's inequality).
const NOT_RULED_OUT: f64 = 5.9;

/// All causes of an explanation.
pub fn all(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    found: &Explained,
    estimates: &Estimates,
) -> Vec<Cause> {
    let narrative = Narrative { sample, found, estimates };
    let space = found.space(sample);
    // First the set itself, with the exact columns of its sensors; then all other hypotheses as rivals.
    let mut pool: Vec<Hypothesis> = found.set.clone();
    pool.extend(hypotheses.iter().cloned());
    let candidates = candidates(&pool, thresholds, &space);
    let search = Search::new(&candidates, &space.in_whitened_space(&sample.residual()));
    let set: Vec<usize> = (0..found.set.len()).collect();
    let steps = found.set.iter().filter(|it| matches!(it.kind, HypothesisKind::Step(_))).count();
    let mut causes: Vec<Cause> = Vec::new();
    let mut keys: Vec<String> = Vec::new();
    for member in 0..found.set.len() {
        let kind = &found.set[member].kind;
        let key = if steps > 1 && matches!(kind, HypothesisKind::Step(_)) {
            "steps".to_string()
        } else {
            format!("{:?}", part_of(kind))
        };
        if keys.contains(&key) {
            continue;
        }
        keys.push(key.clone());
        let same = |other: &usize| {
            let other = &found.set[*other].kind;
            part_of(other) == part_of(kind) || key == "steps" && matches!(other, HypothesisKind::Step(_))
        };
        let (members, rest): (Vec<usize>, Vec<usize>) = set.iter().copied().partition(same);
        let mut cause = if key == "steps" { narrative.change_points(&members) } else { narrative.cause(&members) };
        cause.members.clone_from(&members);
        let worths: Vec<Contribution> =
            members.iter().map(|member| contribution(&search, &candidates, &set, *member)).collect();
        cause.ln_p = worths.iter().map(|it| it.ln_p).fold(0.0, f64::min);
        let score = search.score(&set);
        let odds: f64 = members.iter().map(|member| pool[*member].prior).sum();
        cause.gain = candidates[0].columns[0].len() as f64 * (search.square(&rest) / search.square(&set)).ln();
        let label = cause.label.clone();
        // Only the data distinguish rivals. The prior odds (one of many places of a change, a high order) affect the confidence only.
        let mut rivals: Vec<(String, f64)> = Vec::new();
        let mut likely: Vec<(String, f64)> = Vec::new();
        for (candidate, of_rival) in search.joined(&rest) {
            let rival = pool[candidate].kind.label(sample);
            let group_is_own = members.iter().any(|member| pool[*member].group == pool[candidate].group);
            if rival == label || group_is_own {
                continue;
            }
            let by_data = of_rival - pool[candidate].prior - (score - odds);
            for (list, behind) in [(&mut rivals, by_data), (&mut likely, of_rival - score)] {
                let behind = behind.max(0.0);
                match list.iter_mut().find(|it| it.0 == rival) {
                    Some(it) => it.1 = it.1.min(behind),
                    None => list.push((rival.clone(), behind)),
                }
            }
        }
        order::ascending(&mut rivals, |it| it.1);
        cause.indistinguishable_from = rivals.iter().filter(|it| it.1 < NOT_RULED_OUT).map(|it| it.0.clone()).collect();
        // The probability that chance gives a hypothesis this good among all, relative to the threshold.
        let chance = (cause.ln_p - thresholds.ln_p_mean).min(0.0).exp() * 0.05;
        let evidence = likely.iter().map(|it| ((-it.1 / 2.0).exp(), cause.indistinguishable_from.contains(&it.0)));
        cause.set_probability(Probability::among(1.0 - chance, evidence));
        rivals.truncate(5);
        cause.rivals = rivals;
        causes.push(cause);
    }
    causes.extend(narrative.outlying(thresholds));
    causes.extend(narrative.growing_noise());
    causes.extend(narrative.autocorrelated());
    order::descending(&mut causes, |it| it.gain);
    causes
}

/// The mean at each row for each combination of the strongest causes that change it, with the other causes fitted again.
pub fn combinations(sample: &Sample, found: &Explained, causes: &[Cause]) -> Combinations<Vec<f64>> {
    let moving: Vec<&Cause> = causes.iter().filter(|it| !it.members.is_empty()).take(combinations::MOST).collect();
    Combinations::of(moving.iter().map(|it| it.label.clone()).collect(), |is_in| {
        let out = moving.iter().zip(is_in).filter(|(_, is_in)| !**is_in).flat_map(|(cause, _)| &cause.members);
        let out: Vec<usize> = out.copied().collect();
        let kept = found.set.iter().enumerate().filter(|(member, _)| !out.contains(member));
        let mut some = Explained { set: kept.map(|it| it.1.clone()).collect(), ..found.clone() };
        explained::refit(sample, &mut some);
        Some(some.fitted)
    })
}

/// The kind that all parts of one cause share.
fn part_of(kind: &HypothesisKind) -> HypothesisKind {
    match kind {
        HypothesisKind::Input(extra, _) => HypothesisKind::Input(*extra, Part::Linear),
        other => other.clone(),
    }
}

/// The gain of every hypothesis alone, with its best shape, best first: label, 2 ln of the likelihood ratio, ln of the probability by chance.
pub fn ranking(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    found: &Explained,
) -> Vec<(String, f64, f64)> {
    let alone = Explained { set: Vec::new(), ..found.clone() };
    let space = alone.space(sample);
    let candidates = candidates(hypotheses, thresholds, &space);
    let search = Search::new(&candidates, &space.in_whitened_space(&sample.residual()));
    let mut ranking: Vec<(String, f64, f64)> = Vec::new();
    for (candidate, hypothesis) in hypotheses.iter().enumerate() {
        let it = contribution(&search, &candidates, &[candidate], candidate);
        let label = hypothesis.kind.label(sample);
        match ranking.iter_mut().find(|other| other.0 == label) {
            Some(other) if other.2 <= it.ln_p => {}
            Some(other) => (other.1, other.2) = (it.gain, it.ln_p),
            None => ranking.push((label, it.gain, it.ln_p)),
        }
    }
    order::ascending(&mut ranking, |it| it.2);
    ranking
}

/// For reports: the largest 2 ln of the likelihood ratio that a cause with one unknown may need to exceed the threshold.
pub fn needed(thresholds: &Thresholds) -> f64 {
    f_of(thresholds.ln_p_mean, 1.0, 1e7)
}
