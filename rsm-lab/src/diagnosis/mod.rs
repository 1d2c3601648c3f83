//! Diagnosis of a plant: what its simulation gets wrong, which cause of the catalogue explains it, and what that gains.
//!
//! ```text
//!   records --units, checks--> rows that count --noise--> floor --levenberg--> calibrated plant
//!      --screen--> ranked hypotheses --profile--> best numbers --selection--> causes --validation--> gain
//!      --excitations--> records that could be made --experiment--> the one that tells causes apart
//! ```
//!
//! In: a nominal plant file, training and validation records. Out: a [`Diagnosis`]. Sees the records and the nominal plant alone: nobody may look
//! into the plant that made a record. Never prints, never writes.

#[cfg(test)]
mod axis_under_steps;
pub mod beginnings;
pub mod bends;
pub mod blocks;
pub mod bootstrap;
pub mod bridges;
pub mod calibration;
pub mod chance;
pub mod checks;
pub mod claims;
pub mod compared;
pub mod compete;
mod confidence;
pub mod configurations;
pub mod correction;
pub mod equations;
pub mod everywhere;
pub mod excitations;
pub mod experiment;
pub mod finish;
pub mod free_run;
mod friction;
pub mod growth;
pub mod hypotheses;
pub mod kernel;
pub mod known_loop;
pub mod levenberg;
pub mod model;
pub mod noise;
pub mod normal;
pub mod nuisance;
pub mod octaves;
pub mod open;
pub mod orders;
pub mod plausible;
pub mod portrait;
pub mod posterior;
pub mod predicted;
pub mod profile;
pub mod quantities;
pub mod random;
pub mod regions;
pub mod rest;
pub mod rounding;
pub mod screen;
pub mod selection;
pub mod share;
pub mod spectrum;
pub mod steps;
pub mod survey;
pub mod tails;
pub mod tested;
pub mod tracks;
pub mod under_way;
pub mod units;
pub mod upper_band;
pub mod validation;
pub mod valleys;
pub mod verdict;
pub mod veto;
pub mod waves;
pub mod whiteness;
pub mod worth;

use calibration::{calibrate, floors, with_rounding};
use checks::Finding;
use kernel::Kernel;
use levenberg::Fit;
use model::Model;
use noise::Floor;
use selection::{Effort, Search};
use share::Share;

use crate::kind::PlantKind;
use crate::plant_file::{Entry, PlantFile};
use crate::record::Record;
pub use verdict::{Alias, Cause, Diagnosis, Interval, Verdict};

/// How a diagnosis runs.
pub struct Options<'a> {
    /// Simulations side by side; the answer does not depend on it.
    pub threads: usize,
    /// Told what happens.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

/// Why there is no diagnosis: a numerical outcome.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// No training record holds an output.
    NoOutputs,
    /// Every output that training records hold reads one value throughout, though the plant moves: channels with their records.
    OnlyInputs(Vec<String>),
    /// The nominal plant cannot be simulated along the records.
    CannotSimulate,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refused::NoOutputs => {
                write!(f, "no training record holds an output of the plant: there is nothing to compare with")
            }
            Refused::OnlyInputs(channels) => {
                write!(
                    f,
                    "the records hold inputs only: {} read one value in all rows, though the plant moves there; found nothing to compare with, expected measured outputs \
                     (`rsm simulate` makes them from the inputs)",
                    channels.join(", ")
                )
            }
            Refused::CannotSimulate => {
                write!(f, "the nominal plant cannot be simulated along the records: are their inputs those of this plant?")
            }
        }
    }
}

impl std::error::Error for Refused {}

/// A search may take as much as so many runs of the calibrated plant: half a minute on two cores for three records of 8000 rows. A cause that stands alone takes 500
/// to 1000; what takes more is outside the catalogue, and the search goes round among helpers.
const MOST_RUNS: u64 = 4000;

/// Sub-steps that a search may take at most, however long records are or fast the plant: a minute of one core, at 150 ns each.
const MOST_STEPS: u64 = 400_000_000;

/// Diagnoses a plant, without test records.
///
/// # Errors
/// [`Refused`], when there is nothing to compare.
pub fn diagnose(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    diagnose_and_test(file, training, validation, &[], options)
}

/// Diagnoses a plant; its effects, if it has any, are claims that the records judge too. Training records give the numbers, training and validation records together choose the causes, and test records, which nothing else sees, say at the end what the extension gains.
///
/// # Errors
/// [`Refused`], when there is nothing to compare.
pub fn diagnose_and_test(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let found = units::look(file, training, options.threads);
    let diagnosed = |training: &[Record], validation: &[Record], test: &[Record]| {
        if file.effects.is_empty() {
            of_nominal(file, training, validation, test, options)
        } else {
            claims::diagnose(file, training, validation, test, options)
        }
    };
    if found.is_empty() {
        return diagnosed(training, validation, test);
    }
    let mut all = [training, validation, test].map(<[Record]>::to_vec);
    for (one, right) in &found {
        (options.progress)(&one.to_string());
        all.iter_mut().flatten().for_each(|record| right.apply(record));
    }
    let mut whole = diagnosed(&all[0], &all[1], &all[2])?;
    let noise = &whole.noise;
    let gains = units::asked_again(&found, &whole.plant, &all[0], noise, options.threads);
    if whole.verdict != Verdict::Unexplained && gains.iter().any(Option::is_none) {
        // Beside the causes that were found the factor is another: no unit.
        return diagnosed(training, validation, test);
    }
    whole.units = found.into_iter().map(|it| it.0).collect();
    for (unit, gain) in whole.units.iter_mut().zip(gains) {
        unit.gain = gain.unwrap_or(unit.gain);
    }
    Ok(whole)
}

/// Diagnoses a plant whose effects, if it has any, are given.
fn of_nominal(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let found = searched(file, training, validation, test, options, true)?;
    if found.tails.is_empty() || found.verdict != Verdict::Unexplained {
        return Ok(found);
    }
    // What is explained as it was recorded had no tails: they were structure.
    let plain = searched(file, training, validation, test, options, false)?;
    Ok(if plain.verdict == Verdict::Unexplained { found } else { plain })
}

/// The same, with or without a look at the tails of the noise.
fn searched(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
    with_tails: bool,
) -> Result<Diagnosis, Refused> {
    let outputs = file.kind.outputs().len();
    let mut share = Share::of_rows(training, validation);
    let prepare = |records: &[Record]| checks::prepared(records.iter().flat_map(|record| share.pieces(record, file)), file);
    let ((trained, mut findings), (judging, more)) = (prepare(training), prepare(validation));
    findings.extend(more);
    let white = [Floor::white(1.0); 3];
    let mut kernel = Kernel::new(trained, white, options.threads);
    let mut unseen = Kernel::new(judging, white, options.threads);
    if kernel.records.iter().all(|it| it.outputs.is_empty()) {
        let constant = findings.iter().filter(|it| it.what == "constant");
        let channels: Vec<String> = constant.map(|it| format!("{} of {}", it.channel, regions::name_of(&it.record))).collect();
        return Err(if channels.is_empty() { Refused::NoOutputs } else { Refused::OnlyInputs(channels) });
    }
    share.cut(&mut kernel, &mut unseen, file);
    if let Some(not_seen) = share.not_seen() {
        (options.progress)(&not_seen.to_string());
    }
    (options.progress)("calibrating within tolerances");
    let (mut nominal, mut calibrated) = calibrate(&mut kernel, file, false).ok_or(Refused::CannotSimulate)?;
    unseen.floors = kernel.floors;
    if second_look(&mut kernel, &mut unseen, &calibrated, &mut findings) {
        (nominal, calibrated) = calibrate(&mut kernel, file, false).ok_or(Refused::CannotSimulate)?;
        unseen.floors = kernel.floors;
    }
    if under_way::shown(&kernel, &calibrated, &unseen) {
        (options.progress)("a record begins in the middle of a motion: torque and twist are unknown there");
        (nominal, calibrated) = calibrate(&mut kernel, file, true).ok_or(Refused::CannotSimulate)?;
        unseen.floors = kernel.floors;
    }
    if with_tails && tails::found(&mut kernel, &calibrated) {
        (options.progress)("noise with heavy tails: readings far off their neighbours count less");
        unseen = tails::tamed(kernel.on(unseen.records), &calibrated.model);
        (nominal, calibrated) = calibrate(&mut kernel, file, nominal.under_way).ok_or(Refused::CannotSimulate)?;
        unseen.floors = kernel.floors;
    }

    if let Some((records, fit)) = bridges::corrected(&kernel, &calibrated) {
        kernel.records = records;
        kernel.floors = floors(&kernel, &fit, file);
        calibrated = levenberg::fit(&kernel, fit.model, 4).ok_or(Refused::CannotSimulate)?;
        unseen.floors = kernel.floors;
    }
    correct_unseen(&mut unseen, &calibrated.model);

    let survey = survey::survey(&kernel, &calibrated);
    // Readings that are multiples of a coarse step say so themselves. A simulation that rounds has no derivatives: fits compare with the mean reading, and the
    // effect joins the plant at the end.
    let rounded: Vec<(usize, f64)> = (0..outputs)
        .filter_map(|k| survey.quantum[k].map(|step| (k, step)))
        .filter(|(k, step)| *step > kernel.floors[*k].sd)
        .collect();
    if !rounded.is_empty() {
        kernel.floors = with_rounding(&kernel, &calibrated, kernel.floors, &rounded);
        calibrated = levenberg::fit(&kernel, calibrated.model, 4).ok_or(Refused::CannotSimulate)?;
        kernel.floors = with_rounding(&kernel, &calibrated, floors(&kernel, &calibrated, file), &rounded);
        unseen.floors = kernel.floors;
        calibrated = levenberg::fit(&kernel, calibrated.model, 4).ok_or(Refused::CannotSimulate)?;
    }
    let mut present: Vec<usize> = kernel.records.iter().flat_map(|it| it.outputs.clone()).collect();
    present.sort_unstable();
    present.dedup();
    let mut hypotheses = hypotheses::all(file.kind, &survey, &present);
    let names = file.kind.outputs();
    hypotheses.retain(|it| {
        it.description.kind != "sensor-quantisation" || !rounded.iter().any(|(k, _)| it.subject == Some(names[*k].name))
    });
    (options.progress)("asking the equations along the records");
    let said = equations::look(&kernel, &nominal, &hypotheses);
    // What one run of the calibrated plant takes is the measure of all work that follows.
    let before = kernel.pace.taken();
    kernel.run(&calibrated.model).ok_or(Refused::CannotSimulate)?;
    let run = kernel.pace.taken() - before;
    let rows = kernel.records.iter().map(|it| it.record.rows()).sum();
    kernel.pace = kernel.pace.beside(run, rows);
    unseen.pace = kernel.pace.clone();
    // Of long records the answer is asked on all rows afterwards: that is work, too.
    let most = if share.not_seen().is_some() { MOST_STEPS / 2 } else { MOST_STEPS };
    let effort = Effort::within((MOST_RUNS * run).min(most));
    // A law that is known says which sensor is off before friction and mass are asked.
    let known_loop = known_loop::look(&kernel.records, file);
    let entries = known_loop.as_ref().map_or_else(Vec::new, |it| it.entries(file));
    let mut seed = seeded(&kernel, &nominal, &calibrated, &entries);
    if let (Some(fit), true) = (&seed, rounded.is_empty()) {
        (options.progress)("a sensor is off by the law of the loop");
        kernel.floors = floors(&kernel, fit, file);
        unseen.floors = kernel.floors;
        calibrated = levenberg::fit(&kernel, calibrated.model, 4).ok_or(Refused::CannotSimulate)?;
        seed = seeded(&kernel, &nominal, &calibrated, &entries);
    }
    let own = if rounded.is_empty() && seed.is_none() {
        configurations::apart(&kernel, &unseen, &nominal, &|kernel, fit| floors(kernel, fit, file))
    } else {
        None
    };
    if let Some(own) = own {
        let its = Search {
            kernel: &own.alone,
            unseen: &own.alone.on(Vec::new()),
            nominal: &own.nominal,
            hypotheses: &hypotheses,
            survey: &survey,
            looks: if file.kind == PlantKind::ServoAxis { 2 * waves::MOST } else { 0 },
            rounded: &rounded,
            effort,
            progress: options.progress,
        };
        let mut whole = of_one_record(file, &own, &its, findings, test, options)?;
        whole.not_seen = share.not_seen();
        whole.equations = said;
        return Ok(whole);
    }
    let mut selection = None;
    let mut start = calibrated;
    // The noise floor of the first round may hold structure: once causes are known, it is estimated again, and the search is repeated where it moved.
    for round in 0..2 {
        let search = Search {
            kernel: &kernel,
            unseen: &unseen,
            nominal: &nominal,
            hypotheses: &hypotheses,
            survey: &survey,
            // The wave lengths of an axis are the best of many.
            looks: if file.kind == PlantKind::ServoAxis { 2 * waves::MOST } else { 0 },
            rounded: &rounded,
            effort,
            progress: options.progress,
        };
        let found = search.run_from(start.clone(), seed.clone());
        // What hid a start in motion may be explained now.
        let begun = round == 0 && !found.causes.is_empty() && under_way::shown(&kernel, &found.fit, &unseen);
        // Tails that stood under structure are seen once causes have taken it away.
        let first_look = with_tails && round == 0 && !found.causes.is_empty() && kernel.tails.iter().all(Option::is_none);
        let tailed = first_look && tails::found(&mut kernel, &found.fit);
        if tailed {
            unseen = tails::tamed(kernel.on(unseen.records), &found.fit.model);
        }
        let floors = with_rounding(&kernel, &found.fit, floors(&kernel, &found.fit, file), &rounded);
        let moved = floors.iter().zip(&kernel.floors).any(|(new, old)| {
            (new.sd / old.sd - 1.0).abs() > 0.1
                || new.rounding.is_some() != old.rounding.is_some()
                || growth::differ(new.growth, old.growth)
        });
        // With causes in the plant, readings after a gap say more about what stood in it.
        let corrected = (round == 0 && !found.causes.is_empty()).then(|| bridges::corrected(&kernel, &found.fit)).flatten();
        let again = round == 0 && (moved || tailed || begun || corrected.is_some()) && !found.causes.is_empty();
        if !found.causes.is_empty() {
            correct_unseen(&mut unseen, &found.fit.model);
        }
        if let Some((records, _)) = corrected {
            kernel.records = records;
        }
        selection = Some(found);
        if !again {
            break;
        }
        kernel.floors = floors;
        unseen.floors = floors;
        if begun {
            let records: Vec<&Record> = kernel.records.iter().map(|it| &it.record).collect();
            for model in [&mut nominal, &mut start.model] {
                model.under_way = true;
                model.take_starts(&records, floors.map(|floor| floor.sd));
            }
            seed = None;
        }
        match levenberg::fit(&kernel, start.model.clone(), 4) {
            Some(fit) => start = fit,
            None => break,
        }
        seed = seed.and_then(|it| levenberg::fit(&kernel, it.model, 4));
    }
    let mut selection = selection.ok_or(Refused::CannotSimulate)?;
    selection.fit = finish::finish(&mut kernel, selection.fit, |kernel, fit| {
        with_rounding(kernel, fit, floors(kernel, fit, file), &rounded)
    });
    unseen.floors = kernel.floors;
    selection.known_loop = known_loop;
    if share.not_seen().is_some() {
        (options.progress)("asking all rows");
        let all: Vec<&Record> = training.iter().chain(validation).collect();
        selection.everywhere = Some(everywhere::look(&all, file, &kernel, &selection.fit));
    }
    let fit = selection.fit.clone();
    let mut found = verdict::conclude(file, &kernel, &unseen, &nominal, selection, findings, &rounded);
    found.next = experiment::next(&kernel, &fit, &found.aliases, found.verdict, options.progress);
    found.tested = tested::tested(file, test, &kernel, &nominal, &fit.model);
    found.not_seen = share.not_seen();
    found.equations = said;
    Ok(found)
}

/// The plant with causes that are known before a search, fitted; `None` where there are none, or where the calibrated plant does as well without them.
fn seeded(kernel: &Kernel, nominal: &Model, calibrated: &Fit, entries: &[Entry]) -> Option<Fit> {
    if entries.is_empty() {
        return None;
    }
    let from =
        [nominal, &calibrated.model].map(|model| levenberg::fit(kernel, model.with_effects(nominal, entries.to_vec()), 8));
    let best = from.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    (best.cost < calibrated.cost - worth::least(calibrated.cost, kernel.rows())).then_some(best)
}

/// What readings of unseen records say of their own gaps, the plant being that of a model.
fn correct_unseen(unseen: &mut Kernel, model: &Model) {
    if unseen.records.iter().all(|it| it.bridges.is_empty()) {
        return;
    }
    let there = validation::on(unseen, model);
    if let Some((records, _)) = there.and_then(|there| bridges::corrected(unseen, &there)) {
        unseen.records = records;
    }
}

/// The answer where one record alone is wrong: the others are a null, and its causes are its own.
fn of_one_record(
    file: &PlantFile,
    own: &configurations::Apart,
    search: &Search<'_>,
    findings: Vec<Finding>,
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let record = own.alone.records[0].record.file.clone();
    (options.progress)(&format!("looking at {record} alone"));
    let start = levenberg::fit(&own.alone, own.nominal.clone(), 8).ok_or(Refused::CannotSimulate)?;
    let found = search.run(start);
    let (ranking, threshold, stopped) = (found.ranking.clone(), found.threshold, found.stopped);
    let its = verdict::conclude(file, &own.alone, search.unseen, &own.nominal, found, Vec::new(), &[]);
    let nothing = selection::Selection {
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
    let mut nominal = Model::nominal(file, &[], own.kernel.floors.map(|floor| floor.sd));
    let records: Vec<&Record> = own.kernel.records.iter().map(|it| &it.record).collect();
    nominal.take_starts(&records, own.kernel.floors.map(|floor| floor.sd));
    let mut whole = verdict::conclude(file, &own.kernel, &own.unseen, &nominal, nothing, findings, &[]);
    whole.verdict = match (whole.verdict, its.verdict) {
        (Verdict::NoDiscrepancy, Verdict::Explained) => Verdict::Explained,
        _ => Verdict::Unexplained,
    };
    let of_record = |mut cause: Cause| {
        cause.only_in = Some(record.clone());
        cause.sentence =
            format!("In {} alone: {} The other records are noise without it.", regions::name_of(&record), cause.sentence);
        cause
    };
    whole.causes = its.causes.into_iter().map(of_record).collect();
    whole.helpers = its.helpers.into_iter().map(of_record).collect();
    whole.own_record = Some(record.clone());
    whole.tested = tested::tested(file, test, &own.kernel, &nominal, &own.fit.model);
    Ok(whole)
}

/// What only the simulation shows of the data; whether it changes what counts.
fn second_look(kernel: &mut Kernel, unseen: &mut Kernel, calibrated: &Fit, findings: &mut Vec<Finding>) -> bool {
    let before = findings.len();
    let kind = calibrated.model.file.kind;
    compared::take_back_motion(&mut kernel.records, &calibrated.simulated, kind, findings);
    let judged = validation::on(unseen, &calibrated.model).map_or_else(Vec::new, |fit| fit.simulated);
    compared::take_back_motion(&mut unseen.records[..judged.len()], &judged, kind, findings);
    let mut changed = findings.len() != before;
    let training = kernel.records.iter().zip(&calibrated.simulated);
    let all: Vec<_> = training.chain(unseen.records.iter().zip(&judged)).collect();
    let shifts = compared::shifts(&all);
    let trained = kernel.records.len();
    for shift in shifts {
        let place = shift.record;
        let prepared = if place < trained { &mut kernel.records[place] } else { &mut unseen.records[place - trained] };
        let rows = prepared.record.rows();
        findings.push(Finding {
            record: prepared.record.file.clone(),
            channel: kind.outputs()[prepared.outputs[shift.output]].name.to_string(),
            what: if shift.late > 0 { "shifted in time, late" } else { "shifted in time, early" },
            rows: (prepared.file_row(0), prepared.file_row(rows - 1)),
        });
        prepared.used[shift.output].fill(false);
        changed = true;
    }
    changed
}
