//! A plant file that already has effects (claims): the records confirm or contradict them.
//!
//! In: a plant file with `[[effects]]`, written by an earlier diagnosis or by an engineer. Out: a diagnosis that starts from them. Further causes
//! explain what the claims do not. If the records contradict a claim, it becomes a cause, with the value from the records and the value of the file.
//! Two searches may be needed: one with the parameters of the file, and one with free parameters if these fit clearly better. The simpler explanation
//! is accepted.

use super::calibrated_records::{CalibratedRecords, HeavyTails};
use super::cause::{Cause, Interval};
use super::confidence::{self, Evidence};
pub use super::diagnosis::Claim;
use super::diagnosis::Diagnosis;
use super::levenberg::{self, Fit};
use super::model::Model;
use super::prepared::Piece;
use super::row_share::Searched;
use super::search::AcceptedCause;
use super::verdict::{self, LEAST_CONFIDENCE};
use super::whitened_residuals::WhitenedResiduals;
use super::{Options, Refused, Verdict, bootstrap, checks, effect_size, of_nominal, outlier_correction, tested, validation};
use rsm_core::order;
use rsm_sim::effect::Subject;
use rsm_sim::plant_file::{Entry, PlantFile};
use rsm_sim::record::Record;

/// The number of steps of the fit with the parameters of the claims free: the same as in the search for one cause.
const STEPS: usize = 40;

/// The gain that chance may give with one free parameter, in squared standard deviations of the noise, with a wide margin: it exceeds 24 once in 10^6
/// cases.
const GAIN_BY_CHANCE: f64 = 24.0;

/// The plant for the search: parameter errors are written into the parameters; all other effects are fixed.
fn with_fixed_effects(file: &PlantFile) -> PlantFile {
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
    let filed = with_fixed_effects(file);
    let mut found = of_nominal(&filed, training, validation, test, options)?;
    // If the accepted answer needs no heavy tails or bursts, they were structure.
    let tails = if found.has_uneven_noise() { HeavyTails::Corrected } else { HeavyTails::Ignored };
    if let Some(judged) = test_claims(&filed, training, validation, tails, options) {
        let moved: Vec<usize> = (0..judged.claims.len()).filter(|k| !judged.claims[*k].stands).collect();
        found.claims = judged.claims.clone();
        if judged.contradict && !moved.is_empty() && !matches!(found.verdict, Verdict::NoDiscrepancy) {
            (options.progress)("repeating the diagnosis with other numbers of the plant file's effects");
            let mut other = filed.clone();
            for k in &moved {
                other.given[*k] = judged.fit.model.file.effects[*k].clone();
            }
            let anew = of_nominal(&other, training, validation, test, options)?;
            if is_better(&anew, moved.len(), &found) {
                found = with_contradicted_claims(
                    anew,
                    &found,
                    &judged,
                    &moved,
                    &ClaimRecords { filed: &filed, training, validation, test },
                );
            }
        }
        if found.verdict == Verdict::NoDiscrepancy {
            found.claims.iter_mut().for_each(|claim| claim.stands = true);
        }
    }
    found.plant.effects = found.plant.given.drain(..).chain(std::mem::take(&mut found.plant.effects)).collect();
    Ok(found)
}

struct ClaimTest {
    claims: Vec<Claim>,
    /// The fit with free parameters of the claims.
    fit: Fit,
    /// The fit with the parameters of the file.
    filed: Fit,
    /// Whether the free parameters gain as much as decides between two explanations.
    contradict: bool,
    decides: f64,
    /// The training records with their noise, without the claims.
    noise: WhitenedResiduals,
}

/// Fits the parameters of the claims to the training records. `None` if there are no claims, or if nothing can be simulated.
fn test_claims(
    filed: &PlantFile,
    training: &[Record],
    validation: &[Record],
    tails: HeavyTails,
    options: &Options<'_>,
) -> Option<ClaimTest> {
    if filed.given.is_empty() {
        return None;
    }
    // Uses the rows, noise and initial states of a whole search.
    let CalibratedRecords { whitened, nominal, calibrated, .. } =
        CalibratedRecords::of(filed, training, validation, tails, Searched::Most, options).ok()?;
    let without = |model: &Model| {
        let mut model = model.clone();
        model.file.given.clear();
        model
    };
    let free = without(&calibrated.model).with_effects(&without(&nominal), filed.given.clone());
    let fit = levenberg::fit(&whitened, free, STEPS)?;
    let numbers: usize = filed.given.iter().map(|entry| entry.arguments.numbers.len()).sum();
    let decides = effect_size::deciding_difference(GAIN_BY_CHANCE + 2.0 * numbers as f64, fit.cost, whitened.rows());
    let claims = filed.given.iter().enumerate().map(|(place, entry)| claim(&fit, place, entry)).collect();
    let contradict = calibrated.cost - fit.cost > decides;
    Some(ClaimTest { claims, contradict, decides, noise: whitened.with_records(Vec::new()), fit, filed: calibrated })
}

fn claim(fit: &Fit, place: usize, entry: &Entry) -> Claim {
    let records = verdict::numbers(fit, place);
    let file: Vec<f64> = entry.arguments.numbers.iter().map(|(_, value)| *value).collect();
    let stands = records.iter().zip(&file).all(|(it, file)| it.low <= *file && *file <= it.high);
    Claim { kind: entry.description.kind, subject: entry.arguments.subject.clone(), records, file, stands }
}

/// Whether the explanation that contradicts some claims is the better one.
fn is_better(anew: &Diagnosis, contradicted: usize, found: &Diagnosis) -> bool {
    let is_explained = |it: &Diagnosis| it.verdict != Verdict::Unexplained;
    let left = |it: &Diagnosis| it.extended.iter().map(|error| error.noise_ratio.powi(2)).sum::<f64>();
    match (is_explained(anew), is_explained(found)) {
        (true, false) => true,
        (false, true) => false,
        // If both explain the error, the one with fewer corrections and causes wins. If neither does, the new one must leave less, by the gain that a
        // cause needs.
        (true, true) => anew.entries().count() + contradicted <= found.entries().count(),
        (false, false) => effect_size::least_gain(left(found), found.extended.len()) < left(found) - left(anew),
    }
}

struct ClaimRecords<'a> {
    filed: &'a PlantFile,
    training: &'a [Record],
    validation: &'a [Record],
    test: &'a [Record],
}

/// The diagnosis of the plant with changed parameters, reported relative to the plant of the file: each contradicted claim is a cause.
fn with_contradicted_claims(
    mut anew: Diagnosis,
    before: &Diagnosis,
    judged: &ClaimTest,
    moved: &[usize],
    setting: &ClaimRecords<'_>,
) -> Diagnosis {
    let explained = anew.verdict != Verdict::Unexplained;
    let rows = judged.fit.residual.len() as f64;
    let gain = judged.filed.cost - judged.fit.cost;
    for place in moved {
        let claim = &judged.claims[*place];
        let case = Evidence {
            gain,
            rivals: &[],
            same: judged.decides,
            not_fitted: 0,
            left: anew.left.excess.max(0.0) * rows,
            explained,
            // The search with the claims unchanged tested all alternatives, and they fitted worse.
            rivals_tested: true,
        };
        let accepted = AcceptedCause {
            label: claim.kind.to_string(),
            gain,
            rivals: Vec::new(),
            aliases_not_fitted: Vec::new(),
            rival_models: Vec::new(),
            rivals_tested: true,
            without: judged.filed.model.clone(),
        };
        let mut cause = verdict::cause(&judged.fit, *place, &accepted, Vec::new(), confidence::confidence(&case), None);
        cause.sentence = with_sentence_about_file(&cause.sentence, claim);
        let list = if explained || cause.confidence >= LEAST_CONFIDENCE { &mut anew.causes } else { &mut anew.helpers };
        list.push(cause);
    }
    let strongest = |list: &mut Vec<Cause>| order::descending(list, |it| it.gain);
    strongest(&mut anew.causes);
    strongest(&mut anew.helpers);
    if anew.verdict == Verdict::NoDiscrepancy {
        anew.verdict = Verdict::Explained;
    }
    anew.claims = judged.claims.clone();
    // The errors before are those of the file with its own parameters.
    anew.nominal = before.nominal.clone();
    anew.gain = validation::gain(&anew.nominal, &anew.extended);
    let judges = if setting.validation.is_empty() { setting.training } else { setting.validation };
    let (prepared, _) = checks::prepared(judges.iter().cloned().map(Piece::whole), setting.filed);
    let whitened = outlier_correction::corrected(judged.noise.with_records(prepared), &judged.filed.model);
    let records: Vec<&Record> = judges.iter().collect();
    let sds = judged.noise.floors.map(|floor| floor.sd);
    let [filed, extended] = [setting.filed, &anew.plant].map(|plant| Model::nominal(plant, &records, sds));
    if let (Some(filed), Some(extended)) =
        (validation::fit_initial_states(&whitened, &filed), validation::fit_initial_states(&whitened, &extended))
    {
        anew.gain_interval = bootstrap::gain_interval(&whitened, &filed.simulated, &extended.simulated, validation::gain_of);
    }
    anew.tested = tested::tested(setting.filed, setting.test, &judged.noise, &filed, &extended);
    anew
}

/// The sentence about the file, added to the sentence about the records.
fn with_sentence_about_file(sentence: &str, claim: &Claim) -> String {
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
