//! The whole diagnosis, from records to the result: the rounds of a search, and the tests of its result.
//!
//! In: a plant file, records. Out: a [`Diagnosis`]. Calls the parts in their order; `selection` decides whether a cause is accepted.

use super::cause::Cause;
use super::configurations::Apart;
use super::diagnosis::{Diagnosis, Verdict};
use super::equations::Said;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::ready::{HeavyTails, Ready};
use super::search::{Effort, Search};
use super::selection::Selection;
use super::verdict;
use super::whitened_residuals::WhitenedResiduals;
use super::{
    Options, Refused, calibration, configurations, effect_size, equations, everywhere, experiment, growth, hypotheses,
    known_loop, polish, tested, under_way, waves,
};
use rsm_sim::effect::{Role, Survey};
use rsm_sim::kind::PlantKind;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;

/// The work limit of a search, in runs of the calibrated plant: half a minute on two cores for three records of 8000 rows. Finding a single cause
/// takes 500 to 1000. If a search needs more, the cause is probably not in the catalogue and the search only combines helpers.
const MOST_RUNS: u64 = 4000;

/// The smallest number of integration steps per row that a run counts as. A plant with one step per row gets a limit of 16,000 runs: searches for two
/// and three causes need more than 4,000.
const LEAST_STEPS_A_ROW: u64 = 4;

/// The work limit of a search in sub-steps, for long records and slow plants alike: a minute of one core, at 150 ns each.
const MOST_STEPS: u64 = 400_000_000;

/// The number of rounds. In the first one the estimated noise may contain structure, in the second one it does not.
const ROUNDS: usize = 2;

/// What all rounds of a search share.
struct Asked<'a> {
    hypotheses: Vec<hypotheses::Hypothesis>,
    survey: Survey,
    rounded: Vec<(usize, f64)>,
    effort: Effort,
    /// The equation errors with the recorded signals.
    said: Option<Said>,
    /// The number of guesses that were examined in addition to those of the catalogue.
    looks: usize,
    progress: &'a (dyn Fn(&str) + Sync),
}

impl<'a> Asked<'a> {
    /// The hypotheses that the records can show. Also measures the work of one run of the calibrated plant, the unit of the work limit.
    fn of(ready: &mut Ready, file: &PlantFile, options: &Options<'a>) -> Result<Self, Refused> {
        let mut present: Vec<usize> = ready.whitened.records.iter().flat_map(|it| it.outputs.clone()).collect();
        present.sort_unstable();
        present.dedup();
        let mut hypotheses = hypotheses::all(file.kind, &ready.survey, &present);
        let is_rounded = |name: &str| ready.rounded.iter().any(|(k, _)| name == file.kind.outputs()[*k].name);
        hypotheses.retain(|it| it.description.declared.role != Role::Rounding || !it.subject.is_some_and(is_rounded));
        (options.progress)("evaluating the equations along the records");
        let said = equations::look(&ready.whitened, &ready.nominal, &hypotheses);
        said.iter().for_each(|it| it.hand_over(&mut hypotheses));
        let whitened = &mut ready.whitened;
        let before = whitened.pace.taken();
        whitened.run(&ready.calibrated.model).ok_or(Refused::CannotSimulate)?;
        let run = whitened.pace.taken() - before;
        let rows = whitened.records.iter().map(|it| it.record.rows()).sum();
        whitened.pace = whitened.pace.beside(run, rows);
        ready.unseen.pace = whitened.pace.clone();
        // For long records, the final check on all rows takes work too.
        let most = if ready.share.not_seen().is_some() { MOST_STEPS / 2 } else { MOST_STEPS };
        // The wave lengths of an axis are the best of many, and so are the terms and orders of the equations.
        let waves = if file.kind == PlantKind::ServoAxis { 2 * waves::MOST } else { 0 };
        let terms = said.as_ref().filter(|it| !it.terms.is_empty() || !it.orders.is_empty()).map_or(0, |it| it.looks);
        Ok(Asked {
            hypotheses,
            survey: ready.survey.clone(),
            rounded: ready.rounded.clone(),
            effort: Effort::within((MOST_RUNS * run.max(LEAST_STEPS_A_ROW * rows as u64)).min(most)),
            said,
            looks: waves + terms,
            progress: options.progress,
        })
    }

    fn search<'s>(
        &'s self,
        whitened: &'s WhitenedResiduals,
        unseen: &'s WhitenedResiduals,
        nominal: &'s Model,
        said: &'s [Fit],
    ) -> Search<'s> {
        Search {
            whitened,
            unseen,
            nominal,
            hypotheses: &self.hypotheses,
            survey: &self.survey,
            looks: self.looks,
            rounded: &self.rounded,
            said,
            effort: self.effort,
            progress: self.progress,
        }
    }
}

/// Diagnoses a plant with given effects, if it has any.
pub(super) fn searched(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
    tails: HeavyTails,
) -> Result<Diagnosis, Refused> {
    let mut ready = Ready::of(file, training, validation, tails, options)?;
    let asked = Asked::of(&mut ready, file, options)?;
    // A known control law shows a wrong sensor before friction and mass are estimated.
    let known_loop = known_loop::look(&ready.whitened.records, file);
    let entries = known_loop.as_ref().map_or_else(Vec::new, |it| it.entries(file));
    let mut seed = seeded(&ready.whitened, &ready.nominal, &ready.calibrated, &entries);
    if let (Some(fit), true) = (&seed, ready.rounded.is_empty()) {
        (options.progress)("a sensor is off by the law of the loop");
        ready.whitened.floors = ready.floors(fit, file);
        ready.unseen.floors = ready.whitened.floors;
        ready.calibrated = levenberg::fit(&ready.whitened, ready.calibrated.model, 4).ok_or(Refused::CannotSimulate)?;
        seed = seeded(&ready.whitened, &ready.nominal, &ready.calibrated, &entries);
    }
    if ready.rounded.is_empty() && seed.is_none() {
        let floors = |whitened: &WhitenedResiduals, fit: &Fit| calibration::floors(whitened, fit, file);
        if let Some(own) = configurations::apart(&ready.whitened, &ready.unseen, &ready.nominal, &floors) {
            let none = own.alone.on(Vec::new());
            let search = asked.search(&own.alone, &none, &own.nominal, &[]);
            let mut whole = of_one_record(file, &own, &search, ready.findings, test, options)?;
            whole.not_seen = ready.share.not_seen();
            whole.equations = asked.said;
            return Ok(whole);
        }
    }
    let mut selection = in_rounds(&mut ready, &asked, seed, file, tails).ok_or(Refused::CannotSimulate)?;
    selection.fit = polish::polish(&mut ready.whitened, selection.fit, |whitened, fit| {
        calibration::with_rounding(whitened, fit, calibration::floors(whitened, fit, file), &ready.rounded)
    });
    let Ready { whitened, mut unseen, nominal, findings, share, rounded, .. } = ready;
    unseen.floors = whitened.floors;
    selection.known_loop = known_loop;
    if share.not_seen().is_some() {
        (options.progress)("testing all rows");
        let all: Vec<&Record> = training.iter().chain(validation).collect();
        selection.everywhere = Some(everywhere::look(&all, file, &whitened, &selection.fit));
    }
    let fit = selection.fit.clone();
    let mut found = verdict::conclude(file, &whitened, &unseen, &nominal, selection, findings, &rounded);
    found.next = experiment::next(&whitened, &fit, &found.aliases, found.verdict, options.progress);
    found.tested = tested::tested(file, test, &whitened, &nominal, &fit.model);
    found.not_seen = share.not_seen();
    found.equations = asked.said;
    Ok(found)
}

/// Searches, and searches again if the causes of the first round show that noise, initial states or gaps were wrong with the calibrated plant.
fn in_rounds(
    ready: &mut Ready,
    asked: &Asked<'_>,
    mut seed: Option<Fit>,
    file: &PlantFile,
    tails: HeavyTails,
) -> Option<Selection> {
    let mut said = asked.said.as_ref().map_or_else(Vec::new, |it| it.fitted(&ready.whitened, &ready.calibrated));
    let mut selection = None;
    for round in 1..=ROUNDS {
        let search = asked.search(&ready.whitened, &ready.unseen, &ready.nominal, &said);
        let found = selection.insert(search.run_from(ready.calibrated.clone(), seed.clone()));
        if found.causes.is_empty() {
            break;
        }
        let fit = &found.fit;
        if round == ROUNDS {
            ready.correct_unseen(&fit.model);
            break;
        }
        // A motion at the start may be visible now.
        let begun = under_way::shown(&ready.whitened, fit, &ready.unseen);
        let tailed = tails == HeavyTails::LookedFor && ready.tails_beside(fit);
        let floors = ready.floors(fit, file);
        let moved = floors.iter().zip(&ready.whitened.floors).any(|(new, old)| {
            (new.sd / old.sd - 1.0).abs() > 0.1
                || new.rounding.is_some() != old.rounding.is_some()
                || growth::differ(new.growth, old.growth)
        });
        // With causes in the plant, the readings after a gap give better estimates of the inputs in the gap.
        let corrected = ready.correct_gaps(fit);
        if !(moved || tailed || begun || corrected) {
            break;
        }
        ready.whitened.floors = floors;
        ready.unseen.floors = floors;
        if begun {
            ready.begins_in_motion();
            seed = None;
        }
        match levenberg::fit(&ready.whitened, ready.calibrated.model.clone(), 4) {
            Some(fit) => ready.calibrated = fit,
            None => break,
        }
        seed = seed.and_then(|it| levenberg::fit(&ready.whitened, it.model, 4));
        // From the initial states of the calibrated plant, which may now begin in motion.
        said = asked.said.as_ref().map_or_else(Vec::new, |it| it.fitted(&ready.whitened, &ready.calibrated));
    }
    selection
}

/// The fitted plant with causes known before the search; `None` if there are none, or if the calibrated plant fits as well without them.
fn seeded(whitened: &WhitenedResiduals, nominal: &Model, calibrated: &Fit, entries: &[Entry]) -> Option<Fit> {
    if entries.is_empty() {
        return None;
    }
    let from =
        [nominal, &calibrated.model].map(|model| levenberg::fit(whitened, model.with_effects(nominal, entries.to_vec()), 8));
    let best = from.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    (best.cost < calibrated.cost - effect_size::least(calibrated.cost, whitened.rows())).then_some(best)
}

/// The result if only one record is wrong: the others have no discrepancy, and the causes belong to that record.
fn of_one_record(
    file: &PlantFile,
    own: &Apart,
    search: &Search<'_>,
    findings: Vec<super::checks::Finding>,
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let record = own.alone.records[0].record.file.clone();
    (options.progress)(&format!("diagnosing {record} alone"));
    let start = levenberg::fit(&own.alone, own.nominal.clone(), 8).ok_or(Refused::CannotSimulate)?;
    let found = search.run(start);
    let (ranking, threshold, stopped) = (found.ranking.clone(), found.threshold, found.stopped);
    let its = verdict::conclude(file, &own.alone, search.unseen, &own.nominal, found, Vec::new(), &[]);
    let nothing = Selection {
        calibrated: own.fit.clone(),
        fit: own.fit.clone(),
        causes: Vec::new(),
        refused: its.refused,
        threshold,
        ranking,
        remaining: Vec::new(),
        stopped,
        known_loop: None,
        everywhere: None,
    };
    let records: Vec<&Record> = own.whitened.records.iter().map(|it| &it.record).collect();
    let nominal = Model::beginning(file, own.fit.model.at_start, &records, own.whitened.floors.map(|floor| floor.sd));
    let mut whole = verdict::conclude(file, &own.whitened, &own.unseen, &nominal, nothing, findings, &[]);
    whole.verdict = match (whole.verdict, its.verdict) {
        (Verdict::NoDiscrepancy, Verdict::Explained) => Verdict::Explained,
        _ => Verdict::Unexplained,
    };
    let of_record = |mut cause: Cause| {
        cause.only_in = Some(record.clone());
        cause.sentence = format!(
            "Only in {}: {} The residuals of the other records are noise without it.",
            super::regions::name_of(&record),
            cause.sentence
        );
        cause
    };
    whole.causes = its.causes.into_iter().map(of_record).collect();
    whole.helpers = its.helpers.into_iter().map(of_record).collect();
    whole.own_record = Some(record.clone());
    whole.tested = tested::tested(file, test, &own.whitened, &nominal, &own.fit.model);
    Ok(whole)
}
