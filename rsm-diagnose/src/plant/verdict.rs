//! The verdict: intervals, confidence, rivals, where the nominal plant is wrong, what the extension gains.
//!
//! In: a selection and the records. Out: a [`Diagnosis`], with all its figures from the fits. Never fits a cause.

mod own_noise;
mod resolution;
mod rivals;
mod told;

use std::collections::BTreeSet;

use super::bootstrap;
use super::bridges::{self, Bridged};
use super::bursts::BURST;
use super::checks::Finding;
use super::claims::Claim;
use super::confidence::{self, Case};
use super::effect_size;
use super::equations::Said;
use super::error_breakdown::{self, Compared, ErrorBreakdown, Witness};
use super::everywhere::Everywhere;
use super::experiment::NextExperiment;
use super::known_loop::KnownLoop;
use super::model::Model;
use super::nested_models::{self, Step};
use super::noise::Floor;
use super::polish;
use super::posterior::Posterior;
use super::predicted::{self, Predicted};
use super::selection::{Limit, Selection};
use super::share::NotSeen;
use super::tails::Tails;
use super::tested::Tested;
use super::units::InUnit;
use super::validation::{self, Error};
use super::veto::Refusal;
use super::whitened_residuals::WhitenedResiduals;
use super::whiteness::{self, Left};
use crate::engine::probability::Probability;
pub use crate::surface::Verdict;
use own_noise::by_own_noise;
pub(super) use own_noise::left_there;
use rsm_sim::effect::Subject;
use rsm_sim::plant_file::{Entry, PlantFile};
pub(super) use told::{cause, numbers, with_unit};
use told::{off_lattice, rounding, rounding_entry};

/// Structure smaller than this share of what the calibrated plant got wrong is none, in squares. Two simulations of the same equations, with steps of their own, differ
/// by up to 7e-4 of what an effect moves (a contact; the comparison of all effects in `tests/hidden-effects`): a right cause leaves the square of that.
const OF_THE_WHOLE: f64 = 5e-7;

/// Whatever the plant got wrong before: beyond so much energy of the noise, twice its r.m.s., nothing is explained and nothing is without discrepancy.
const MOST_LEFT: f64 = 3.0;

/// Rounding that is taken for noise is not white where the motion is slow, and noise that is not white before it is rounded has another colour at every speed: so much
/// of its energy comes back as structure.
const OF_ROUNDING: f64 = 0.3;

/// Structure of less than a hundredth of the noise's energy, half a per cent of its r.m.s., changes nothing that anybody does with a simulation.
const FOR_PRACTICE: f64 = 0.01;

/// And only beside causes that remove all but a thousandth of what was wrong.
const NEARLY_ALL: f64 = 0.999;

/// Where structure is left, a cause is named that is at least as probable as all else together; any other helps, and is listed as a helper.
pub(super) const NAMED: f64 = 0.5;

/// A number with its 95 % interval.
#[derive(Debug, Clone, PartialEq)]
pub struct Interval {
    /// Its name.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// The unit.
    pub unit: String,
}

/// A cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind of the catalogue.
    pub kind: &'static str,
    /// The named parameter or output.
    pub subject: Option<String>,
    /// Which of the two it is.
    pub of: Subject,
    /// Its numbers.
    pub parameters: Vec<Interval>,
    /// The probability that it is right.
    pub confidence: f64,
    /// The probability that it, or one of those that leave the same trace, is right.
    pub confidence_of_any: f64,
    /// Causes that leave the same trace in these records.
    pub indistinguishable_from: Vec<String>,
    /// How much worse the fit is without it, in squared standard deviations of the noise.
    pub gain: f64,
    /// Its rivals and how much worse they do, in the same unit.
    pub rivals: Vec<(String, f64)>,
    /// Whether rivals were looked for; false where the limit of work came first.
    pub asked: bool,
    /// A sentence of plain words.
    pub sentence: String,
    /// What to measure or look at to be sure.
    pub check: &'static str,
    /// What it does on the records that judge; of the strongest causes.
    pub witness: Option<Witness>,
    /// The only record in which it acts, by its file; absent where it acts in all.
    pub only_in: Option<String>,
}

/// What causes do, where they leave too little to matter for practice, though more than chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Practical {
    /// Share of the error beyond the noise that is gone, in squares.
    pub gone: f64,
    /// Energy of what is left over that of the noise.
    pub left: f64,
}

/// A rival that the records do not tell from a cause.
#[derive(Debug, Clone)]
pub struct Alias {
    /// The cause that is believed.
    pub cause: String,
    /// The rival.
    pub rival: String,
    /// The plant with the rival in place of the cause, fitted to the same records.
    pub model: Model,
    /// By how much one of them has to do worse before it is refused, in squared standard deviations of the noise.
    pub limit: f64,
}

/// A diagnosis.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The verdict.
    pub verdict: Verdict,
    /// Causes, the strongest first.
    pub causes: Vec<Cause>,
    /// Entries of the extended plant that help against what nothing explains, and are not believed to be its causes; the strongest first.
    pub helpers: Vec<Cause>,
    /// The record that alone is of another configuration, by its file: the causes are its own.
    pub own_record: Option<String>,
    /// What was believed for a while, and why it was refused.
    pub refused: Vec<Refusal>,
    /// Where causes explain for practical purposes only.
    pub practical: Option<Practical>,
    /// Errors of the nominal plant on validation records (on training records where there are none).
    pub nominal: Vec<Error>,
    /// Errors of the extended plant there.
    pub extended: Vec<Error>,
    /// Share of the validation error above the noise floor that the extension removes.
    pub gain: f64,
    /// Its 95 % interval over blocks of the rows.
    pub gain_interval: (f64, f64),
    /// The plant file with the causes filled in.
    pub plant: PlantFile,
    /// What is wrong with the data.
    pub findings: Vec<Finding>,
    /// Rows that were not looked at, where records are longer than a diagnosis may take.
    pub not_seen: Option<NotSeen>,
    /// What all rows say of the answer, where the search did not look at all of them.
    pub everywhere: Option<Everywhere>,
    /// Columns that are in another unit than the records say; they were converted before anything else.
    pub units: Vec<InUnit>,
    /// Gaps of a few rows that were bridged.
    pub bridged: Vec<Bridged>,
    /// Noise of each output that the records hold: place, standard deviation, correlation from row to row.
    pub noise: Vec<(usize, f64, f64)>,
    /// Outputs whose noise grows with the reading: its standard deviation at a reading of 0 and at the largest one.
    pub growing: Vec<(usize, f64, f64)>,
    /// Outputs whose readings are multiples of a step as coarse as their noise, with the step.
    pub rounded: Vec<(usize, f64)>,
    /// Outputs whose noise has heavy tails, with the law by which their readings were made tame.
    pub tails: Vec<(usize, Tails)>,
    /// What a cause had to gain.
    pub threshold: f64,
    /// What the screen of the calibrated plant predicted.
    pub ranking: Vec<(String, f64)>,
    /// What the last screen predicted, with the causes in the plant.
    pub remaining: Vec<(String, f64)>,
    /// How the error falls on the records that judge, cause by cause.
    pub steps: Vec<Step>,
    /// The limit of work at which the search stopped, if it did.
    pub stopped: Option<Limit>,
    /// What is left at the end on training records.
    pub left: Left,
    /// And on validation records, where there are any.
    pub left_unseen: Option<Left>,
    /// What the law of a known loop says of its sensors.
    pub known_loop: Option<KnownLoop>,
    /// What the equations say along the recorded signals, without a free run.
    pub equations: Option<Said>,
    /// What predicts a part of what is left, on the records where it predicts more.
    pub predicted: Option<Predicted>,
    /// Rivals that leave the same trace, the strongest of the strongest cause first.
    pub aliases: Vec<Alias>,
    /// The record that would tell them apart, or look where an error has no cause.
    pub next: Option<NextExperiment>,
    /// What a report shows beside all this.
    pub error_breakdown: ErrorBreakdown,
    /// Figures of test records, where there are any.
    pub tested: Option<Tested>,
    /// The effects that the plant file came with, judged.
    pub claims: Vec<Claim>,
}

impl Diagnosis {
    /// The entries of the extended plant, causes and helpers.
    pub fn entries(&self) -> impl Iterator<Item = &Cause> {
        self.causes.iter().chain(&self.helpers)
    }

    /// Whether noise was made even: readings of heavy tails count less, and rows of bursts not at all.
    #[must_use]
    pub fn has_uneven_noise(&self) -> bool {
        !self.tails.is_empty() || self.findings.iter().any(|it| it.what == BURST)
    }
}

/// Places of gains, the largest first.
fn by_gain(gains: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..gains.len()).collect();
    order.sort_by(|a, b| gains[*b].total_cmp(&gains[*a]));
    order
}

/// What rounding may leave beside noise: nothing where the floors of all rounded outputs know it, and their noise is white.
fn of_rounding<'a>(mut rounded: impl Iterator<Item = &'a Floor>) -> f64 {
    if rounded.all(|floor| floor.rounding.is_some() && floor.correlation == 0.0) { 0.0 } else { OF_ROUNDING }
}

/// Everything that there is to say.
#[must_use]
pub fn conclude(
    file: &PlantFile,
    whitened: &WhitenedResiduals,
    unseen: &WhitenedResiduals,
    nominal: &Model,
    selection: Selection,
    findings: Vec<Finding>,
    rounded: &[(usize, f64)],
) -> Diagnosis {
    let Selection {
        calibrated,
        fit,
        causes: believed,
        refused,
        threshold,
        ranking,
        remaining,
        stopped,
        known_loop,
        everywhere,
    } = selection;
    let judged = if unseen.records.is_empty() { whitened } else { unseen };
    let before = validation::on(judged, nominal);
    // From the calibrated plant's starts or from first readings, whichever suits.
    let plain = validation::on(judged, &fit.model);
    let guided = validation::on(judged, &calibrated.model);
    let guided = guided.and_then(|calibrated| validation::from_starts_of(judged, &fit.model, &calibrated));
    let after = plain.into_iter().chain(guided).min_by(|a, b| a.cost.total_cmp(&b.cost));
    let (nominal_errors, extended_errors) = (
        before.as_ref().map_or_else(Vec::new, |fit| validation::errors(judged, fit)),
        after.as_ref().map_or_else(Vec::new, |fit| validation::errors(judged, fit)),
    );
    let order = by_gain(&believed.iter().map(|it| it.gain).collect::<Vec<_>>());
    let steps = nested_models::steps(whitened, judged, nominal, &calibrated, &fit, &order);
    let left = whiteness::look(whitened, &fit);
    // On unseen records the numbers of the plant may move as far as they are unsure.
    let moved = after.as_ref().filter(|_| !unseen.records.is_empty());
    let moved = moved.and_then(|after| validation::within(unseen, &fit.model, Posterior::of(&fit).deviations(), after));
    let there = moved.map(|moved| by_own_noise(unseen, moved));
    let left_unseen = there.as_ref().map(|(there, fit)| whiteness::look(there, fit));
    let predicts = there.iter().filter_map(|(there, fit)| predicted::look(there, fit)).chain(predicted::look(whitened, &fit));
    let predicted = predicts.max_by(|a, b| a.excess.total_cmp(&b.excess));
    let wrong = wrong_a_row(calibrated.cost, calibrated.residual.len());
    let elsewhere = [
        left_unseen.as_ref().map(|it| it.excess),
        predicted.as_ref().map(|it| it.excess),
        everywhere.as_ref().map(|it| it.excess),
    ];
    let most_left = elsewhere.into_iter().flatten().fold(left.excess, f64::max);
    let allowed = allowed(of_rounding(rounded.iter().map(|(output, _)| &whitened.floors[*output])), wrong);
    let (structure, practical) = weighed(most_left, allowed, wrong, believed.is_empty());
    let calibrated_there = validation::on(judged, &calibrated.model);
    let compared = match (&before, &calibrated_there, &after) {
        (Some(nominal_there), Some(before), Some(after)) => {
            Some(Compared { whitened, unseen, nominal, fit: &fit, nominal_there, before, after, structure })
        }
        _ => None,
    };
    let error_breakdown = compared.as_ref().map(error_breakdown::error_breakdown).unwrap_or_default();
    let witnesses = compared.as_ref().map_or_else(Vec::new, |it| error_breakdown::witnesses(it, &believed));
    let mut aliases: Vec<(f64, Alias)> = Vec::new();
    let mut causes: Vec<Cause> = Vec::new();
    for (place, one) in believed.iter().enumerate() {
        let decides = effect_size::decides(threshold, fit.cost, fit.residual.len());
        let same = rivals::same(decides, one.gain);
        let one = &rivals::without_general(one);
        aliases.extend(rivals::aliases(one, same).into_iter().map(|it| (one.gain, it)));
        let alike = rivals::alike(one, same);
        let judged = Case {
            gain: one.gain,
            rivals: &one.rivals,
            same,
            not_fitted: rivals::not_fitted(one).count(),
            unit: decides,
            left: most_left * fit.residual.len() as f64,
            explained: is_explained(structure, stopped),
            asked: one.asked,
        };
        let by_law = known_loop.as_ref().is_some_and(|it| it.says(file, &fit.model.file.effects[place]));
        let confidence = sure(confidence::confidence(&judged), by_law);
        causes.push(cause(&fit, place, one, alike, confidence, witnesses.get(place).cloned().flatten()));
    }
    let present = outputs(whitened);
    let coarse = resolution::blamed(rounded, present.len(), &whitened.floors);
    for (output, step) in &coarse {
        causes.extend(rounding(file.kind, *output, *step, off_lattice(whitened, *output, *step), fit.residual.len() as f64));
    }
    let rows = whitened.records.iter().map(|it| it.record.rows()).sum();
    let by_law = known_loop.as_ref().map_or_else(Vec::new, |it| it.beside(file, &fit.model.file.effects, rows));
    let (told_by_law, by_law): (Vec<Cause>, Vec<Entry>) = by_law.into_iter().unzip();
    // What the law says of a sensor goes before what a search made of it.
    replace(&mut causes, told_by_law, |it| (it.kind, it.subject.clone()));
    causes.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    aliases.sort_by(|a, b| b.0.total_cmp(&a.0));
    let verdict = judged_by(structure, stopped, causes.is_empty());
    let (causes, helpers): (Vec<Cause>, Vec<Cause>) = causes.into_iter().partition(|it| is_named(verdict, it.confidence));
    let mut plant = polish::written(file, whitened, nominal, &fit);
    replace(&mut plant.effects, by_law, |it| (it.description.kind, it.arguments.subject.clone()));
    for (output, step) in coarse {
        plant.effects.extend(rounding_entry(file.kind, output, step));
    }
    let gain_interval = before
        .as_ref()
        .zip(after.as_ref())
        .map(|(before, after)| bootstrap::gain_interval(judged, &before.simulated, &after.simulated, gain_of));
    Diagnosis {
        verdict,
        causes,
        helpers,
        own_record: None,
        refused,
        practical,
        gain_interval: gain_interval.unwrap_or_default(),
        gain: gain(&nominal_errors, &extended_errors),
        nominal: nominal_errors,
        extended: extended_errors,
        plant,
        findings,
        not_seen: None,
        everywhere,
        units: Vec::new(),
        bridged: bridges::bridged(whitened.records.iter().chain(&unseen.records)),
        noise: present.iter().map(|k| (*k, whitened.floors[*k].sd, whitened.floors[*k].correlation)).collect(),
        growing: growing(whitened, &present),
        rounded: rounded.to_vec(),
        tails: present.iter().filter_map(|&output| Some((output, whitened.tails[output]?))).collect(),
        threshold,
        ranking,
        remaining,
        steps,
        stopped,
        left,
        left_unseen,
        known_loop,
        equations: None,
        predicted,
        aliases: aliases.into_iter().map(|it| it.1).collect(),
        next: None,
        error_breakdown,
        tested: None,
        claims: Vec::new(),
    }
}

/// The outputs that any record holds, by their place in the plant.
fn outputs(whitened: &WhitenedResiduals) -> Vec<usize> {
    let all: BTreeSet<usize> = whitened.records.iter().flat_map(|it| it.outputs.iter().copied()).collect();
    all.into_iter().collect()
}

/// Outputs whose noise grows, with its deviation at a reading of 0 and at the largest one.
fn growing(whitened: &WhitenedResiduals, present: &[usize]) -> Vec<(usize, f64, f64)> {
    let readings = |output: usize| {
        let of = move |it: &'_ super::whitened_residuals::Prepared| it.outputs.iter().position(|found| *found == output);
        whitened.records.iter().filter_map(move |it| of(it).map(|k| it.measured(k))).flatten()
    };
    let largest = |output: usize| readings(output).fold(0.0_f64, |most, value| most.max(value.abs()));
    let grows = present.iter().filter(|output| whitened.floors[**output].growth.is_some());
    grows.map(|&output| (output, whitened.floors[output].sd_at(0.0), whitened.floors[output].sd_at(largest(output)))).collect()
}

/// What a calibrated plant gets wrong, a row: its squared error over the noise's, beyond 1.
fn wrong_a_row(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64 - 1.0).max(0.0)
}

/// What causes do that leave so much, where that matters little for practice; `wrong` is what was wrong before.
fn practical(left: f64, wrong: f64) -> Option<Practical> {
    // Where nothing was wrong nothing is gone.
    // mutant `f64::MIN_POSITIVE doubled`: both are far below what anything leaves.
    let gone = 1.0 - left.max(0.0) / wrong.max(f64::MIN_POSITIVE);
    (left < FOR_PRACTICE && gone > NEARLY_ALL).then_some(Practical { gone, left })
}

/// The energy beyond the noise that may be left, over that of the noise, where the calibrated plant had so much a row.
fn allowed(of_rounding: f64, wrong: f64) -> f64 {
    of_rounding.max(OF_THE_WHOLE * wrong).min(MOST_LEFT)
}

/// Whether more is left than is allowed, and matters; and what causes do where it does not matter.
fn weighed(left: f64, allowed: f64, wrong: f64, nothing: bool) -> (bool, Option<Practical>) {
    let practical = if left > allowed && !nothing { practical(left, wrong) } else { None };
    (left > allowed && practical.is_none(), practical)
}

/// Whether causes leave noise, and nothing but the work ended the search.
fn is_explained(structure: bool, stopped: Option<Limit>) -> bool {
    !structure && stopped.is_none_or(|limit| limit == Limit::Steps)
}

/// A cause that the law of a known loop shows is as sure as one that has nothing against it.
fn sure(confidence: Probability, by_law: bool) -> Probability {
    confidence.at_least(if by_law { confidence::EXPLAINED } else { 0.0 })
}

/// Whether a cause is named, and no helper.
fn is_named(verdict: Verdict, confidence: f64) -> bool {
    verdict != Verdict::Unexplained || confidence >= NAMED
}

/// Adds to a list, in place of those with the name of a new one.
fn replace<T, Name: PartialEq>(list: &mut Vec<T>, new: Vec<T>, name: impl Fn(&T) -> Name) {
    list.retain(|old| !new.iter().any(|new| name(new) == name(old)));
    list.extend(new);
}

/// The verdict. Causes that leave noise stand, whatever work was still to be done about their rivals; a search that went round in a circle, or that added and exchanged
/// without end, has shown that it does not know.
fn judged_by(structure: bool, stopped: Option<Limit>, nothing: bool) -> Verdict {
    match (is_explained(structure, stopped), nothing) {
        (false, _) => Verdict::Unexplained,
        (true, true) => Verdict::NoDiscrepancy,
        (true, false) => Verdict::Explained,
    }
}

/// Share of the squared error above the noise that is gone, pooled over outputs in units of their noise.
pub fn gain(before: &[Error], after: &[Error]) -> f64 {
    let above = |errors: &[Error]| errors.iter().map(|it| (it.noise_ratio * it.noise_ratio - 1.0).max(0.0)).sum::<f64>();
    let all = above(before);
    // Without an error above the noise there is nothing to gain; 1e-3 of the noise's energy is its scatter over 10^6 rows.
    // mutant `< to <=`: a number of at least 1, less 1, is a multiple of 2^-52, and so is a sum of them; 1e-3 is none.
    if all < 1e-3 { 0.0 } else { (1.0 - above(after) / all).max(-1.0) }
}

/// The same from sums of squares over the noise and counts, by output.
pub fn gain_of(sums: &[[f64; 3]; 3]) -> f64 {
    let above = |which: usize| sums.iter().filter(|it| it[2] > 0.0).map(|it| (it[which] / it[2] - 1.0).max(0.0)).sum::<f64>();
    let all = above(0);
    // mutant `< to <=`: as above.
    if all < 1e-3 { 0.0 } else { (1.0 - above(1) / all).max(-1.0) }
}

#[cfg(test)]
mod tests;
