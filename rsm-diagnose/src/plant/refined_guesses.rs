//! The guesses of a screen: their order, and the fit of the best ones to first order in everything else.
//!
//! In: a fit and the results of its screen. Out: the forms that are worth a full fit, with their refined parameters. Forms with the same trace do not
//! displace other traces. Accepts no cause.

use super::effect_size::AS_GOOD;
use super::levenberg::Fit;
use super::nuisance::Nuisance;
use super::screen::Screened;
use super::search::Search;
use super::variable_projection::{Projected, project};
use super::waves;
use rsm_core::order;

/// The largest number of guesses that are refined for a hypothesis. Guesses of a resonance are at least an octave apart; further guesses would be
/// their neighbours.
const STARTS: usize = 6;

/// Steps of the rounds in which guesses are refined, before the remaining steps. After each round the better half continues, as in successive halving
/// (Z. Karnin, T. Koren, O. Somekh, 2013).
const ROUNDS: [usize; 2] = [1, 2];

/// A hypothesis is refined if the screen predicts at least this share of the needed gain. The screen is first order and may predict too little.
const LEAST_PREDICTED_SHARE: f64 = 0.3;

/// The largest number of forms with the same trace that are fitted: those with the largest predicted gain. More would displace other traces, and the
/// data do not distinguish them.
const MOST_OF_ONE_TRACE: usize = 4;

/// Forms with the same trace as others of larger predicted gain. They are not fitted. By group, with the predicted gain of the best of it.
pub(super) struct SplitGuesses {
    /// The guesses that are fitted.
    pub kept: Vec<Screened>,
    /// The group and the hypothesis of each guess that is not fitted.
    pub duplicates: Vec<(usize, usize)>,
}

/// Separates the guesses that are fitted from duplicates of the same trace. Predicted gains that differ by less than `least` count as equal.
#[must_use]
pub(super) fn split_duplicates(screened: &[Screened], least: f64) -> SplitGuesses {
    let mut forms: Vec<(usize, (usize, usize), f64)> = Vec::new();
    for it in best_guesses(screened, 1) {
        if let Some(group) = it.group {
            forms.push((group, form_of(it), it.gain));
        }
    }
    let mut out: Vec<(usize, usize)> = Vec::new();
    let mut aside = Vec::new();
    for (place, (group, form, gain)) in forms.iter().enumerate() {
        let before: Vec<f64> = forms[..place].iter().filter(|it| it.0 == *group).map(|it| it.2).collect();
        if before.len() >= MOST_OF_ONE_TRACE {
            out.push(*form);
            if before[0] - gain < least {
                aside.push((*group, form.0));
            }
        }
    }
    SplitGuesses { kept: screened.iter().filter(|it| !out.contains(&form_of(it))).cloned().collect(), duplicates: aside }
}

/// A group of forms with the same trace, or a form with its own trace.
type Trace = Result<usize, (usize, usize)>;

/// The index of each among the fitted ones; forms with the same trace have the same index.
fn places(traces: &[Trace]) -> Vec<usize> {
    let mut known: Vec<Trace> = Vec::new();
    let mut place = |its: &Trace| {
        known.iter().position(|it| it == its).unwrap_or_else(|| {
            known.push(*its);
            known.len() - 1
        })
    };
    traces.iter().map(&mut place).collect()
}

/// The identity of a form. A hypothesis with and without its optional parameters gives two forms. Each is fitted; in a tie the simpler one wins.
#[must_use]
pub fn form_of(it: &Screened) -> (usize, usize) {
    (it.hypothesis, it.values.iter().filter(|value| value.is_finite()).count())
}

/// The best guesses of each form, by gain.
#[must_use]
pub fn best_guesses(screened: &[Screened], each: usize) -> Vec<&Screened> {
    let mut order: Vec<&Screened> = screened.iter().collect();
    order::descending(&mut order, |it| it.gain);
    let mut taken: Vec<(usize, usize)> = Vec::new();
    order.retain(|it| {
        let before = taken.iter().filter(|form| **form == form_of(it)).count();
        taken.push(form_of(it));
        before < each
    });
    order
}

/// The first `forms` forms of a list in its order, each with its first `each` guesses.
#[must_use]
pub fn leading<T>(list: Vec<T>, forms: usize, each: usize, form: impl Fn(&T) -> (usize, usize)) -> Vec<T> {
    let mut taken: Vec<((usize, usize), usize)> = Vec::new();
    let mut kept = Vec::new();
    for it in list {
        let its = form(&it);
        let place = taken.iter().position(|(found, _)| *found == its).unwrap_or(taken.len());
        if place == taken.len() {
            if taken.len() == forms {
                continue;
            }
            taken.push((its, 0));
        }
        if taken[place].1 < each {
            taken[place].1 += 1;
            kept.push(it);
        }
    }
    kept
}

/// A list with one more element, unless it has one of that form already.
fn with_form<T>(mut list: Vec<T>, one: Option<T>, form: impl Fn(&T) -> (usize, usize)) -> Vec<T> {
    let new = one.filter(|it| list.iter().all(|other| form(other) != form(it)));
    list.extend(new);
    list
}

impl Search<'_> {
    /// The best forms with refined parameters; everything else is to first order.
    pub(super) fn refined(&self, fit: &Fit, screened: &[Screened], threshold: f64) -> Vec<Projected> {
        let nuisance = Nuisance::new(fit);
        let kind = fit.model.file.kind;
        let mut guesses = best_guesses(screened, STARTS);
        guesses.retain(|it| it.gain > LEAST_PREDICTED_SHARE * threshold);
        let mut forms = self.limits.profiled;
        let guesses = leading(guesses, forms, STARTS, |it| form_of(it));
        // The form that promises most is always fitted. Where an error is strong, the first order in everything else may rank it behind others.
        let first = guesses.first().map(|it| form_of(it));
        let most_promising = |list: &[Projected]| list.iter().find(|it| Some(it.form()) == first).cloned();
        let mut pool: Vec<Projected> = guesses
            .into_iter()
            .map(|it| Projected {
                hypothesis: it.hypothesis,
                entry: self.hypotheses[it.hypothesis].entry(kind, &it.values),
                cost: f64::INFINITY,
            })
            .collect();
        let rest = self.limits.profile_steps.saturating_sub(ROUNDS.iter().sum()).max(1);
        let mut starts = STARTS;
        for steps in ROUNDS.into_iter().chain([rest]) {
            let refined = self.side_by_side(&pool, |search, it| {
                if waves::is_wave(it.entry.description, kind) {
                    // A guess taken from the record is already the first-order optimum.
                    let joint = it
                        .cost
                        .is_infinite()
                        .then(|| waves::joint_fit(search.whitened, fit, self.nominal, &it.entry, &[]))
                        .flatten();
                    let entry = joint.and_then(|(model, cost)| Some((model.file.effects.last()?.clone(), cost)));
                    return Some(entry.map_or(it.clone(), |(entry, cost)| Projected {
                        hypothesis: it.hypothesis,
                        entry,
                        cost,
                    }));
                }
                let model = fit.model.joined(self.nominal, it.entry.clone());
                let place = model.file.effects.len() - 1;
                let (model, cost) = project(search.whitened, &nuisance, model, place, steps)?;
                Some(Projected { hypothesis: it.hypothesis, entry: model.file.effects[place].clone(), cost })
            });
            let mut next: Vec<Projected> = refined.into_iter().flatten().collect();
            order::ascending(&mut next, |it| it.cost);
            starts = starts.div_ceil(2);
            let always = most_promising(&next);
            pool = with_form(leading(next, forms, starts, Projected::form), always, Projected::form);
            // A full fit finds more than the first order, so twice as many forms as will be fitted enter the last round.
            forms = (2 * self.limits.fitted).min(forms);
        }
        // Forms with the same predicted gain as the best are always fitted: they have the same trace, and the answer must name them.
        let always = most_promising(&pool);
        let mut chosen = leading(pool, 2 * self.limits.fitted, 1, |it| it.form());
        let best = chosen.first().map_or(0.0, |it| it.cost);
        let alike = best + (1.0 - AS_GOOD) * (fit.cost - best);
        let traces: Vec<Trace> = chosen.iter().map(|it| group_of(screened, it.form()).ok_or(it.form())).collect();
        let mut places = places(&traces).into_iter();
        chosen.retain(|it| places.next().is_some_and(|place| place < self.limits.fitted) || it.cost <= alike);
        // The best form of each trace, and all forms of the best trace.
        let mut fitted: Vec<Trace> = Vec::new();
        chosen.retain(|it| {
            let its = group_of(screened, it.form()).ok_or(it.form());
            let again = fitted.contains(&its);
            fitted.push(its);
            !again || it.cost <= alike
        });
        with_form(chosen, always, Projected::form)
    }
}

impl Projected {
    /// Its hypothesis and its number of parameters.
    pub(super) fn form(&self) -> (usize, usize) {
        (self.hypothesis, self.entry.arguments.numbers.len())
    }
}

/// The group of a form's best guess.
#[must_use]
pub(super) fn group_of(screened: &[Screened], form: (usize, usize)) -> Option<usize> {
    let its = screened.iter().filter(|it| form_of(it) == form);
    its.max_by(|a, b| a.gain.total_cmp(&b.gain))?.group
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_form_leads_with_its_first_ones_in_the_order_of_the_list() {
        let list = vec![(0, 'a'), (0, 'b'), (1, 'c'), (0, 'd'), (2, 'e'), (1, 'f')];
        let kept: String = leading(list, 2, 2, |it| (it.0, 0)).into_iter().map(|it| it.1).collect();
        assert_eq!(kept, "abcf");
    }

    #[test]
    fn a_form_is_added_once() {
        let with = |list: &[(usize, char)], one| with_form(list.to_vec(), one, |it| (it.0, 0));
        assert_eq!(with(&[(0, 'a'), (1, 'b')], Some((2, 'c'))), [(0, 'a'), (1, 'b'), (2, 'c')]);
        assert_eq!(with(&[(0, 'a'), (1, 'b')], Some((1, 'c'))), [(0, 'a'), (1, 'b')]);
        assert_eq!(with(&[(0, 'a')], None), [(0, 'a')]);
    }

    #[test]
    fn four_forms_of_one_trace_compete_and_no_more() {
        // Six hypotheses of one trace promise most, and the seventh is another.
        let predicted = [100.0, 99.0, 98.0, 97.0, 96.0, 60.0, 50.0];
        let one =
            |(hypothesis, gain): (usize, &f64)| Screened::with_gain(hypothesis, *gain, Some(usize::from(hypothesis == 6)));
        let screened: Vec<Screened> = predicted.iter().enumerate().map(one).collect();
        let split = split_duplicates(&screened, 10.0);
        assert_eq!(split.kept.iter().map(|it| it.hypothesis).collect::<Vec<_>>(), [0, 1, 2, 3, 6]);
        // What promises as much is an alias; what promises less is none.
        assert_eq!(split.duplicates, [(0, 4)]);
    }

    #[test]
    fn four_forms_of_one_trace_do_not_keep_the_sixth_form_out() {
        // Of a car on a fast road: drag area, air density and two dampings are one; two others promise less than all four. Five are fitted.
        let traces = [Ok(0), Ok(0), Ok(0), Ok(0), Err((4, 1)), Ok(5)];
        assert_eq!(places(&traces), [0, 0, 0, 0, 1, 2]);
        // The two forms of a hypothesis are two, wherever they stand.
        assert_eq!(places(&[Err((4, 1)), Ok(0), Err((4, 2)), Ok(0)]), [0, 1, 2, 1]);
    }
}
