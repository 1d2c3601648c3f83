//! A plant file that already has effects (claims): the records confirm or contradict them.
//!
//! In: a plant file with `[[effects]]`, written by an earlier diagnosis or by an engineer. Out: a diagnosis that starts from them. Further causes explain what the claims do not. A claim that the
//! records contradict becomes a cause itself, with the value from the records beside the value of the file. The effects are part of the plant during the search, so two searches
//! decide: one keeps the claims, and the other, run where different numbers fit clearly better, uses those. The simpler explanation is accepted.

use super::cause::{Cause, Interval};
use super::confidence::{self, Case};
pub use super::diagnosis::Claim;
use super::diagnosis::Diagnosis;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::prepared::Piece;
use super::ready::{HeavyTails, Ready};
use super::search::Believed;
use super::verdict::{self, LEAST_CONFIDENCE};
use super::whitened_residuals::WhitenedResiduals;
use super::{Options, Refused, Verdict, bootstrap, checks, effect_size, of_nominal, taming, tested, validation};
use rsm_sim::effect::Subject;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;

/// Steps of the fit in which the numbers of the claims are free: a search of one cause takes as many.
const STEPS: usize = 40;

/// What chance gains with one free number, in squared standard deviations of the noise, with a wide margin: one in 10^6 is beyond 24.
const BY_CHANCE: f64 = 24.0;

/// The plant as the search takes it: errors of parameters are the parameters, all other effects are given.
fn as_given(file: &PlantFile) -> PlantFile {
    let mut given = file.clone();
    given.effects.clear();
    for entry in &file.effects {
        match (entry.description.subject, entry.arguments.subject.as_deref(), entry.arguments.optional("value")) {
            (Subject::Parameter, Some(name), Some(value)) => given.parameters.set(name, value),
            _ => given.given.push(entry.clone()),
        }
    }
    given
}

/// Diagnoses a plant with effects.
pub(super) fn diagnose(
    file: &PlantFile,
    training: &[Record],
    validation: &[Record],
    test: &[Record],
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let filed = as_given(file);
    let mut found = of_nominal(&filed, training, validation, test, options)?;
    // Tails and bursts that the answer has no use for were structure.
    let tails = if found.has_uneven_noise() { HeavyTails::LookedFor } else { HeavyTails::LeftAlone };
    if let Some(judged) = judged(&filed, training, validation, tails, options) {
        let moved: Vec<usize> = (0..judged.claims.len()).filter(|k| !judged.claims[*k].stands).collect();
        found.claims = judged.claims.clone();
        if judged.contradict && !moved.is_empty() && !matches!(found.verdict, Verdict::NoDiscrepancy) {
            (options.progress)("with other numbers of the plant file's effects");
            let mut other = filed.clone();
            for k in &moved {
                other.given[*k] = judged.fit.model.file.effects[*k].clone();
            }
            let anew = of_nominal(&other, training, validation, test, options)?;
            if is_better(&anew, moved.len(), &found) {
                found = contradicted(anew, &found, &judged, &moved, &Setting { filed: &filed, training, validation, test });
            }
        }
        if found.verdict == Verdict::NoDiscrepancy {
            found.claims.iter_mut().for_each(|claim| claim.stands = true);
        }
    }
    found.plant.effects = found.plant.given.drain(..).chain(std::mem::take(&mut found.plant.effects)).collect();
    Ok(found)
}

struct Judged {
    claims: Vec<Claim>,
    /// The plant with the claims' numbers free.
    fit: Fit,
    /// The plant with the file's numbers.
    filed: Fit,
    /// Whether free numbers gain what decides between two explanations.
    contradict: bool,
    decides: f64,
    /// Noise as the training records have it, without them.
    noise: WhitenedResiduals,
}

/// Fits the numbers of the claims to the training records; `None` where there are none, or nothing can be simulated.
fn judged(
    filed: &PlantFile,
    training: &[Record],
    validation: &[Record],
    tails: HeavyTails,
    options: &Options<'_>,
) -> Option<Judged> {
    if filed.given.is_empty() {
        return None;
    }
    // From the rows, the noise and the starts with which the search began.
    let Ready { whitened, nominal, calibrated, .. } = Ready::of(filed, training, validation, tails, options).ok()?;
    let without = |model: &Model| {
        let mut model = model.clone();
        model.file.given.clear();
        model
    };
    let free = without(&calibrated.model).with_effects(&without(&nominal), filed.given.clone());
    let fit = levenberg::fit(&whitened, free, STEPS)?;
    let numbers: usize = filed.given.iter().map(|entry| entry.arguments.numbers.len()).sum();
    let decides = effect_size::decides(BY_CHANCE + 2.0 * numbers as f64, fit.cost, whitened.rows());
    let claims = filed.given.iter().enumerate().map(|(place, entry)| claim(&fit, place, entry)).collect();
    let contradict = calibrated.cost - fit.cost > decides;
    Some(Judged { claims, contradict, decides, noise: whitened.on(Vec::new()), fit, filed: calibrated })
}

fn claim(fit: &Fit, place: usize, entry: &Entry) -> Claim {
    let records = verdict::numbers(fit, place);
    let file: Vec<f64> = entry.arguments.numbers.iter().map(|(_, value)| *value).collect();
    let stands = records.iter().zip(&file).all(|(it, file)| it.low <= *file && *file <= it.high);
    Claim { kind: entry.description.kind, subject: entry.arguments.subject.clone(), records, file, stands }
}

/// Whether an explanation that contradicts some claims is the one to believe.
fn is_better(anew: &Diagnosis, contradicted: usize, found: &Diagnosis) -> bool {
    let is_explained = |it: &Diagnosis| it.verdict != Verdict::Unexplained;
    let left = |it: &Diagnosis| it.extended.iter().map(|error| error.noise_ratio.powi(2)).sum::<f64>();
    match (is_explained(anew), is_explained(found)) {
        (true, false) => true,
        (false, true) => false,
        // Both explain: the fewest things that are wrong. Neither: what leaves less, by what a cause must be worth.
        (true, true) => anew.entries().count() + contradicted <= found.entries().count(),
        (false, false) => effect_size::least(left(found), found.extended.len()) < left(found) - left(anew),
    }
}

struct Setting<'a> {
    filed: &'a PlantFile,
    training: &'a [Record],
    validation: &'a [Record],
    test: &'a [Record],
}

/// The diagnosis of the plant with other numbers, told from the plant of the file: what was contradicted is a cause.
fn contradicted(mut anew: Diagnosis, before: &Diagnosis, judged: &Judged, moved: &[usize], setting: &Setting<'_>) -> Diagnosis {
    let explained = anew.verdict != Verdict::Unexplained;
    let rows = judged.fit.residual.len() as f64;
    let gain = judged.filed.cost - judged.fit.cost;
    for place in moved {
        let claim = &judged.claims[*place];
        let case = Case {
            gain,
            rivals: &[],
            same: judged.decides,
            not_fitted: 0,
            unit: judged.decides,
            left: anew.left.excess.max(0.0) * rows,
            explained,
            // The search in which the claims stand asked everything else, and did worse.
            asked: true,
        };
        let believed = Believed {
            label: claim.kind.to_string(),
            gain,
            rivals: Vec::new(),
            alike: Vec::new(),
            rival_models: Vec::new(),
            asked: true,
            without: judged.filed.model.clone(),
        };
        let mut cause = verdict::cause(&judged.fit, *place, &believed, Vec::new(), confidence::confidence(&case), None);
        cause.sentence = told(&cause.sentence, claim);
        let list = if explained || cause.confidence >= LEAST_CONFIDENCE { &mut anew.causes } else { &mut anew.helpers };
        list.push(cause);
    }
    let strongest = |list: &mut Vec<Cause>| list.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    strongest(&mut anew.causes);
    strongest(&mut anew.helpers);
    if anew.verdict == Verdict::NoDiscrepancy {
        anew.verdict = Verdict::Explained;
    }
    anew.claims = judged.claims.clone();
    // Errors before are those of the file, with its own numbers.
    anew.nominal = before.nominal.clone();
    anew.gain = validation::gain(&anew.nominal, &anew.extended);
    let judges = if setting.validation.is_empty() { setting.training } else { setting.validation };
    let (prepared, _) = checks::prepared(judges.iter().cloned().map(Piece::whole), setting.filed);
    let whitened = taming::tamed(judged.noise.on(prepared), &judged.filed.model);
    let records: Vec<&Record> = judges.iter().collect();
    let sds = judged.noise.floors.map(|floor| floor.sd);
    let [filed, extended] = [setting.filed, &anew.plant].map(|plant| Model::nominal(plant, &records, sds));
    if let (Some(filed), Some(extended)) = (validation::on(&whitened, &filed), validation::on(&whitened, &extended)) {
        anew.gain_interval = bootstrap::gain_interval(&whitened, &filed.simulated, &extended.simulated, validation::gain_of);
    }
    anew.tested = tested::tested(setting.filed, setting.test, &judged.noise, &filed, &extended);
    anew
}

/// What the file says of it, behind what the records say.
fn told(sentence: &str, claim: &Claim) -> String {
    let numbers: Vec<String> = claim
        .records
        .iter()
        .zip(&claim.file)
        .filter(|(it, file)| **file < it.low || it.high < **file)
        .map(|(it, file)| format!("{} = {}", it.name, verdict::with_unit(&Interval { value: *file, ..it.clone() })))
        .collect();
    format!("{sentence} The plant file says {}.", numbers.join(", "))
}

#[cfg(test)]
mod tests {
    use super::super::axis_under_steps::{self, friction};
    use super::*;
    use rsm_fit::random::Random;

    const TOLERANCES: &str = "mass = 0.01";

    fn records(truth: &PlantFile, count: u64) -> Vec<Record> {
        let nominal = axis_under_steps::file(TOLERANCES, "");
        (0..count)
            .map(|seed| {
                let (whitened, _) = axis_under_steps::whitened(&nominal, truth, false);
                let mut record = whitened.records[0].record.clone();
                let mut random = Random::new(seed + 1);
                record.file = format!("record {seed}");
                record.measured[0].as_mut().unwrap().iter_mut().for_each(|value| *value += 1e-5 * random.normal());
                record
            })
            .collect()
    }

    fn diagnosed(filed: &str, truth: &str) -> Diagnosis {
        let all = records(&axis_under_steps::file(TOLERANCES, truth), 2);
        let options = Options { threads: 2, progress: &|_| {} };
        super::super::diagnose(&axis_under_steps::file(TOLERANCES, filed), &all[..1], &all[1..], &options).unwrap()
    }

    fn windless(force: f64) -> String {
        format!("[[effects]]\nkind = \"constant-load\"\nparameters = {{ force = {force} }}\n")
    }

    #[test]
    fn a_claim_that_is_right_stands_and_what_is_beside_it_is_found() {
        let null = diagnosed(&friction(0.8), &friction(0.8));
        assert_eq!((null.verdict, null.entries().count()), (Verdict::NoDiscrepancy, 0), "{:?}", null.causes);
        assert!(null.claims[0].stands && null.claims[0].file == [0.8], "{:?}", null.claims);
        assert_eq!((null.plant.effects.len(), null.plant.given.len()), (1, 0));
        let beside = diagnosed(&friction(0.8), &(friction(0.8) + &windless(0.5)));
        let kinds: Vec<&str> = beside.entries().map(|cause| cause.kind).collect();
        assert_eq!((beside.verdict, kinds), (Verdict::Explained, vec!["constant-load"]));
        let written: Vec<&str> = beside.plant.effects.iter().map(|entry| entry.description.kind).collect();
        assert_eq!(written, ["coulomb-friction", "constant-load"]);
    }

    #[test]
    fn a_claim_that_is_wrong_is_contradicted_with_the_number_of_the_records() {
        let found = diagnosed(&friction(0.8), &friction(0.5));
        assert_eq!(found.verdict, Verdict::Explained, "{:?}", found.causes);
        let [cause] = &found.causes[..] else { panic!("{:?}", found.causes) };
        let number = &cause.parameters[0];
        assert_eq!(cause.kind, "coulomb-friction");
        assert!(number.low <= 0.5 && 0.5 <= number.high && (number.value - 0.5).abs() < 0.02, "{number:?}");
        assert!(cause.sentence.contains("The plant file says force = 0.8 N"), "{}", cause.sentence);
        assert!(!found.claims[0].stands && found.gain > 0.95 && cause.confidence > 0.9, "{found:?}");
        assert_eq!(found.plant.effects.len(), 1);
    }
}
