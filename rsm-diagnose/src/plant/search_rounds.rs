//! The whole diagnosis, from records to the result: the rounds of a search, and the tests of its result.
//!
//! In: a plant file, records. Out: a [`Diagnosis`]. Calls the parts in their order; `selection` decides whether a cause is accepted.

use super::calibrated_records::{CalibratedRecords, HeavyTails};
use super::cause::Cause;
use super::configurations::SeparateRecord;
use super::diagnosis::{Diagnosis, Verdict};
use super::equations::EquationScreen;
use super::law::{self, Law};
use super::levenberg::{self, Fit};
use super::model::Model;
use super::noise::NoiseFloor;
use super::row_share::{RowShare, Searched};
use super::search::{Ended, Search, WorkLimits};
use super::selection::Selection;
use super::verdict;
use super::whitened_residuals::WhitenedResiduals;
use super::{
    Options, Refused, all_rows, by_configuration, calibration, configurations, effect_size, equations, experiment, final_fit,
    growth, hypotheses, initial_motion, known_loop, more_rows, open_numbers, row_share, tested, waves, whiteness,
};
use rsm_sim::effect::{Role, Survey};
use rsm_sim::equation_plant::added;
use rsm_sim::equations::Setting;
use rsm_sim::kind::OUTPUTS;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;

/// The work limit of a search, in runs of the calibrated plant: half a minute on two cores for three records of 8000 rows. Finding a single cause
/// takes 500 to 1000. If a search needs more, the cause is probably not in the catalogue and the search only combines helpers.
const MOST_RUNS: u64 = 4000;

/// The work limit of a search on a part of the rows, in runs along this part: enough for one cause.
const RUNS_ON_A_PART: u64 = 1000;

/// The smallest work per row that a run counts as: four steps of the series. A plant with fewer gets a limit of more than 4,000 runs, which searches
/// for two and three causes need.
const LEAST_WORK_A_ROW: u64 = 4 * Setting::SERIES;

/// The work limit of a search, for long records and slow plants alike: a minute of one core, at 150 ns for a step of the
/// series.
const MOST_WORK: u64 = 400_000_000 * Setting::SERIES;

/// The number of rounds. In the first one the estimated noise may contain structure, in the second one it does not.
const ROUNDS: usize = 2;

/// A cause with a smaller confidence may be a law of the catalogue that was bent towards an unknown one: a law is looked for without it.
const SURE_BESIDE_A_LAW: f64 = 0.9;

/// What all rounds of a search share.
struct SearchInput<'a> {
    hypotheses: Vec<hypotheses::Hypothesis>,
    survey: Survey,
    rounded: Vec<(usize, f64)>,
    limits: WorkLimits,
    /// The equation errors with the recorded signals.
    equation_errors: Option<EquationScreen>,
    /// The number of guesses that were examined in addition to those of the catalogue.
    further_guesses: usize,
    progress: &'a (dyn Fn(&str) + Sync),
}

impl<'a> SearchInput<'a> {
    /// The hypotheses that the records can show. Also measures the work of one run of the calibrated plant, the unit of the work limit.
    fn of(
        prepared: &mut CalibratedRecords,
        file: &PlantFile,
        searched: Searched,
        options: &Options<'a>,
    ) -> Result<Self, Refused> {
        let mut present: Vec<usize> = prepared.whitened.records.iter().flat_map(|it| it.outputs.clone()).collect();
        present.sort_unstable();
        present.dedup();
        let mut hypotheses = hypotheses::all(file.kind, &prepared.survey, &present);
        let is_rounded = |name: &str| prepared.rounded.iter().any(|(k, _)| name == file.kind.outputs()[*k].name);
        hypotheses.retain(|it| it.description.declared.role != Role::Rounding || !it.subject.is_some_and(is_rounded));
        (options.progress)("evaluating the equations along the records");
        let equation_errors = equations::screen(&prepared.whitened, &prepared.nominal, &hypotheses);
        equation_errors.iter().for_each(|it| it.add_orders(&mut hypotheses));
        let present = by_configuration::present(&prepared.whitened);
        hypotheses.extend(hypotheses::by_configuration(file.kind, &hypotheses, &present));
        let whitened = &mut prepared.whitened;
        let before = whitened.work.done();
        whitened.run(&prepared.calibrated.model).ok_or(Refused::CannotSimulate)?;
        let run = whitened.work.done() - before;
        let rows = whitened.records.iter().map(|it| it.record.rows()).sum();
        whitened.work = whitened.work.for_candidates(run, rows, whitened.tolerance());
        prepared.unseen.work = whitened.work.clone();
        // For long records, the final check on all rows takes work too.
        let most = if prepared.share.unused_rows().is_some() { MOST_WORK / 2 } else { MOST_WORK };
        let runs = if searched == Searched::Part { RUNS_ON_A_PART } else { MOST_RUNS };
        // Wave lengths are the best of many, and so are the terms and orders of the equations.
        let waves = if waves::has_waves(file.kind) { 2 * waves::MOST } else { 0 };
        let terms =
            equation_errors.as_ref().filter(|it| !it.terms.is_empty() || !it.orders.is_empty()).map_or(0, |it| it.looks);
        let limits = WorkLimits::within((runs * run.max(LEAST_WORK_A_ROW * rows as u64)).min(most));
        Ok(SearchInput {
            hypotheses,
            survey: prepared.survey.clone(),
            rounded: prepared.rounded.clone(),
            limits: if searched == Searched::Part { limits.for_one_cause() } else { limits },
            equation_errors,
            further_guesses: waves + terms,
            progress: options.progress,
        })
    }

    fn search<'s>(
        &'s self,
        whitened: &'s WhitenedResiduals,
        unseen: &'s WhitenedResiduals,
        nominal: &'s Model,
        equation_error_fits: &'s [Fit],
    ) -> Search<'s> {
        Search {
            whitened,
            unseen,
            nominal,
            hypotheses: &self.hypotheses,
            survey: &self.survey,
            further_guesses: self.further_guesses,
            rounded: &self.rounded,
            equation_error_fits,
            limits: self.limits,
            progress: self.progress,
        }
    }
}

/// Diagnoses a plant with given effects, if it has any. `None` if a part of the rows does not give an
/// answer that holds on all of them, or if the plant cannot be simulated with the noise of its causes.
pub(super) fn diagnose_records(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
    tails: HeavyTails,
    searched: Searched,
) -> Result<Option<Diagnosis>, Refused> {
    let mut prepared = CalibratedRecords::of(file, training, validation, tails, searched, options)?;
    let input = SearchInput::of(&mut prepared, file, searched, options)?;
    // A known control law shows a wrong sensor before friction and mass are estimated.
    let known_loop = known_loop::check(&prepared.whitened.records, file);
    let entries = known_loop.as_ref().map_or_else(Vec::new, |it| it.entries(file));
    let mut seed = fit_with_known_causes(&prepared.whitened, &prepared.nominal, &prepared.calibrated, &entries);
    if let (Some(fit), true) = (&seed, prepared.rounded.is_empty()) {
        (options.progress)("a sensor is off by the law of the loop");
        prepared.whitened.floors = prepared.floors(fit, file);
        prepared.unseen.floors = prepared.whitened.floors;
        prepared.calibrated =
            levenberg::fit(&prepared.whitened, prepared.calibrated.model, 4).ok_or(Refused::CannotSimulate)?;
        seed = fit_with_known_causes(&prepared.whitened, &prepared.nominal, &prepared.calibrated, &entries);
    }
    if prepared.rounded.is_empty() && seed.is_none() {
        let floors = |whitened: &WhitenedResiduals, fit: &Fit| calibration::floors(whitened, fit, file);
        if let Some(own) = configurations::separate_record(&prepared.whitened, &prepared.unseen, &prepared.nominal, &floors) {
            if searched == Searched::Part {
                return Ok(None);
            }
            let none = own.alone.with_records(Vec::new());
            let search = input.search(&own.alone, &none, &own.nominal, &[]);
            (options.progress)(&format!("diagnosing {} alone", own.alone.records[0].record.file));
            let start = levenberg::fit(&own.alone, own.nominal.clone(), 8).ok_or(Refused::CannotSimulate)?;
            let its = search.run(start);
            // What only a holdout record excites cannot be fitted to the training records.
            let is_trained = own.whitened.records.len() < prepared.whitened.records.len();
            if !(is_trained && own.others_accept(&its.fit)) {
                let mut whole = of_one_record(file, &own, &search, its, prepared.findings, test);
                whole.unused_rows = prepared.share.unused_rows();
                whole.equations = input.equation_errors;
                return Ok(Some(whole));
            }
        }
    }
    let Some(mut selection) = in_rounds(&mut prepared, &input, seed, file, (tails, searched)) else { return Ok(None) };
    loop {
        selection.fit = final_fit::final_fit(&mut prepared.whitened, selection.fit, |whitened, fit| {
            calibration::with_rounding(whitened, fit, calibration::floors(whitened, fit, file), &prepared.rounded)
        });
        let search = input.search(&prepared.whitened, &prepared.unseen, &prepared.nominal, &[]);
        let (fit, causes, refused) = search.without_wrong_numbers(selection.fit, selection.causes);
        let is_final = refused.is_empty();
        (selection.fit, selection.causes) = (fit, causes);
        selection.refused.extend(refused);
        if is_final {
            break;
        }
    }
    let CalibratedRecords { whitened, mut unseen, nominal, findings, share, rounded, .. } = prepared;
    unseen.floors = whitened.floors;
    if searched == Searched::Part {
        (options.progress)("fitting the numbers to more rows");
        let share = RowShare::of_rows(training, validation, Searched::Most);
        let answer = (&selection.fit, selection.causes.as_slice());
        let found = more_rows::fit_to_more_rows(training, share, file, &whitened, answer, selection.threshold);
        let Some((numbers, causes)) = found else { return Ok(None) };
        (selection.numbers, selection.causes) = (Some(numbers), causes);
    }
    open_numbers::settle(&unseen, &mut selection.fit);
    selection.numbers.iter_mut().for_each(|it| open_numbers::settle(&unseen, &mut it.fit));
    selection.known_loop = known_loop;
    if share.unused_rows().is_some() {
        (options.progress)("testing all rows");
        let all: Vec<&Record> = training.iter().chain(validation).collect();
        let checked = all_rows::check(&all, file, &whitened, selection.final_fit(), &findings);
        if searched == Searched::Part && !checked.is_only_noise() {
            return Ok(None);
        }
        selection.all_rows = Some(checked);
    }
    let fit = selection.fit.clone();
    let mut final_model = selection.final_fit().model.clone();
    // A law can be found for a plant with sites only.
    let for_a_law = (!added::balances(file.kind).is_empty()).then(|| selection.clone());
    let concluded =
        |selection: Selection| verdict::conclude(file, &whitened, &unseen, &nominal, selection, findings.clone(), &rounded);
    let mut found = concluded(selection);
    if searched == Searched::Part && found.verdict == Verdict::Unexplained {
        return Ok(None);
    }
    found.next = experiment::next(&whitened, &fit, &found.aliases, found.verdict, options.progress);
    if found.verdict == Verdict::Unexplained
        && let Some(selection) = &for_a_law
        && let Some((law, with_law)) = with_law(selection, &found, &whitened, &unseen, &nominal, options)
    {
        let next = found.next.take();
        // What helped without the law is listed as before, and so is a cause that is not sure beside it.
        let doubtful = found.causes.into_iter().filter(|it| it.confidence < SURE_BESIDE_A_LAW);
        let helpers = doubtful.chain(found.helpers).collect();
        final_model = with_law.fit.model.clone();
        found = concluded(with_law);
        // A law names no cause.
        found.verdict = Verdict::Unexplained;
        (found.next, found.helpers, found.law) = (next, helpers, Some(law));
    }
    found.tested = tested::tested(file, test, &whitened, &nominal, &final_model);
    if let Some(it) = &found.all_rows {
        found.findings.extend_from_slice(&it.findings);
    }
    // Their rows are those of the file.
    found.findings.iter_mut().for_each(|it| it.record = row_share::file_of(&it.record).to_string());
    found.unused_rows = share.unused_rows();
    found.equations = input.equation_errors;
    Ok(Some(found))
}

/// A law for what the named causes leave, and the selection with these causes and the law in the plant.
fn with_law(
    selection: &Selection,
    found: &Diagnosis,
    whitened: &WhitenedResiduals,
    unseen: &WhitenedResiduals,
    nominal: &Model,
    options: &Options<'_>,
) -> Option<(Law, Selection)> {
    let is_named = |it: &Entry| {
        let subject = it.arguments.subject.as_deref();
        let is_it = |cause: &&Cause| cause.kind == it.description.kind && cause.subject.as_deref() == subject;
        found.causes.iter().filter(is_it).any(|cause| cause.confidence >= SURE_BESIDE_A_LAW)
    };
    let effects = selection.fit.model.file.effects.iter().zip(&selection.causes).filter(|(entry, _)| is_named(entry));
    let (entries, causes): (Vec<Entry>, Vec<_>) = effects.map(|(entry, cause)| (entry.clone(), cause.clone())).unzip();
    let law = law::find(whitened, unseen, nominal, &selection.fit, &entries, options.progress)?;
    let with = Selection { fit: law.fit.clone(), causes, numbers: None, ..selection.clone() };
    Some((law, with))
}

/// Whether a search ended by itself with at most one cause, and left only noise. If it did not on a part of the rows, it is not continued there.
fn is_whole(whitened: &WhitenedResiduals, found: &Selection) -> bool {
    found.stopped.is_none() && found.causes.len() <= 1 && whiteness::test(whitened, &found.fit).excess <= 0.0
}

/// Searches, and searches again if the causes of the first round show that noise, initial states or gaps were wrong with the calibrated plant. `None`
/// if a search on a part of the rows has no whole answer.
fn in_rounds(
    prepared: &mut CalibratedRecords,
    input: &SearchInput<'_>,
    mut seed: Option<Fit>,
    file: &PlantFile,
    (tails, searched): (HeavyTails, Searched),
) -> Option<Selection> {
    let mut equation_error_fits =
        input.equation_errors.as_ref().map_or_else(Vec::new, |it| it.fitted(&prepared.whitened, &prepared.calibrated));
    let mut selection = None;
    let mut has_restarted = false;
    let mut round = 0;
    while round < ROUNDS {
        let search = input.search(&prepared.whitened, &prepared.unseen, &prepared.nominal, &equation_error_fits);
        // A first cause that explains the records shows whether the noise was wrong. Then the search begins again at once; the next one is whole.
        let is_wrong = |fit: &Fit| !has_restarted && have_moved(&prepared.floors(fit, file), &prepared.whitened.floors);
        let fit = match search.run_until(prepared.calibrated.clone(), seed.clone(), &is_wrong) {
            Err(Ended::SeveralCauses) => return None,
            Err(Ended::WrongNoise(first_cause)) => {
                has_restarted = true;
                first_cause
            }
            Ok(found) => {
                round += 1;
                let found = selection.insert(found);
                if searched == Searched::Part && !is_whole(&prepared.whitened, found) {
                    return None;
                }
                if found.causes.is_empty() {
                    break;
                }
                Box::new(found.fit.clone())
            }
        };
        let fit = &fit;
        if round == ROUNDS {
            prepared.correct_unseen(&fit.model);
            break;
        }
        // A motion at the start may be visible now.
        let begun = initial_motion::is_visible(&prepared.whitened, fit, &prepared.unseen);
        let tailed = tails == HeavyTails::Corrected && prepared.correct_hidden_tails(fit);
        let burst = tails == HeavyTails::Corrected && prepared.leave_out_hidden_bursts(fit);
        let floors = prepared.floors(fit, file);
        let moved = have_moved(&floors, &prepared.whitened.floors);
        // With causes in the plant, the readings after a gap give better estimates of the inputs in the gap.
        let corrected = prepared.correct_gaps(fit);
        if !(moved || tailed || burst || begun || corrected) {
            break;
        }
        prepared.whitened.floors = floors;
        prepared.unseen.floors = floors;
        if begun {
            prepared.begins_in_motion();
            seed = None;
        }
        match levenberg::fit(&prepared.whitened, prepared.calibrated.model.clone(), 4) {
            Some(fit) => prepared.calibrated = fit,
            None => break,
        }
        seed = seed.and_then(|it| levenberg::fit(&prepared.whitened, it.model, 4));
        // From the initial states of the calibrated plant, which may now begin in motion.
        equation_error_fits =
            input.equation_errors.as_ref().map_or_else(Vec::new, |it| it.fitted(&prepared.whitened, &prepared.calibrated));
    }
    selection
}

/// Whether the noise differs by more than a tenth, or in its kind.
fn have_moved(floors: &[NoiseFloor; OUTPUTS], before: &[NoiseFloor; OUTPUTS]) -> bool {
    floors.iter().zip(before).any(|(new, old)| {
        (new.sd / old.sd - 1.0).abs() > 0.1
            || new.rounding.is_some() != old.rounding.is_some()
            || growth::differ(new.growth, old.growth)
    })
}

/// The fitted plant with causes known before the search; `None` if there are none, or if the calibrated plant fits as well without them.
fn fit_with_known_causes(whitened: &WhitenedResiduals, nominal: &Model, calibrated: &Fit, entries: &[Entry]) -> Option<Fit> {
    if entries.is_empty() {
        return None;
    }
    let from =
        [nominal, &calibrated.model].map(|model| levenberg::fit(whitened, model.with_effects(nominal, entries.to_vec()), 8));
    let best = from.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    (best.cost < calibrated.cost - effect_size::least_gain(calibrated.cost, whitened.rows())).then_some(best)
}

/// The result if only one record is wrong: the others have no discrepancy, and the causes belong to that record.
fn of_one_record(
    file: &PlantFile,
    own: &SeparateRecord,
    search: &Search<'_>,
    found: Selection,
    findings: Vec<super::checks::Finding>,
    test: &[Record],
) -> Diagnosis {
    let record = own.alone.records[0].record.file.clone();
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
        all_rows: None,
        numbers: None,
    };
    let records: Vec<&Record> = own.whitened.records.iter().map(|it| &it.record).collect();
    let nominal = Model::with_initial_motion(file, own.fit.model.at_start, &records, own.whitened.floors.map(|floor| floor.sd));
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
    whole
}
