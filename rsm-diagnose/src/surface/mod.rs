//! Diagnosis of a fitted surface with new data: its error by region, the causes with their confidence, and the extended surface.
//!
//! ```text
//!   model.toml, new.csv --data--> NewData --sample--> Sample (rows inside box and support)
//!       hypotheses: every cause as columns ----+
//!       null: distribution of chance alone ----+--explain, choice--> causes, outlying runs, noise
//!                                                 |  residual_tests: are the residuals noise?
//!                                                 |  estimate, narrative, causes: parameters, sentences, rivals
//!                                                 v
//!       extension: the surface with the causes --holdout--> gain on holdout rows
//! ```
//!
//! In: a checked model, new data. Out: [`Diagnosis`]. Coefficients of the file are estimates. A change within their uncertainty is calibration, not a cause. Thresholds come
//! from noise drawn on the data's own rows, at most 5 % of false alarms in all. Does not print or write files.

mod cause;
pub mod causes;
mod choice;
mod confidence;
pub mod data;
mod estimate;
mod explain;
mod explained;
mod extension;
pub mod holdout;
mod hypotheses;
mod narrative;
mod noise;
mod null;
pub mod regions;
mod residual_tests;
mod sample;
mod search;
mod whitening;

use rsm_core::check::Checked;
use rsm_core::model::{Evidence, Input, Model};

pub use crate::engine::combinations::Combinations;
pub use crate::engine::verdict::Verdict;
use crate::engine::work::Work;
use causes::Cause;
use data::NewData;
use estimate::Estimates;
use explained::Explained;
use extension::Extension;
use holdout::{Errors, Judged};
use hypotheses::Hypothesis;
use null::Thresholds;
use regions::Region;
pub use residual_tests::{Floor, Test};
use rsm_fit::table::MAGNITUDES;
use sample::{Sample, Taken};

/// False alarms of a whole diagnosis. 5 % are allowed; a fifth is kept back for the draws, which know a threshold to some 15 %.
const FALSE_ALARMS: f64 = 0.04;

/// The search for causes of a response may take this many multiplications, each of two explanations where there are two: some ten seconds. A hundred rows take a hundredth of it.
const MOST_WORK: usize = 6_000_000_000;

/// Each fold of a cross-validation may take this many.
const MOST_WORK_OF_FOLD: usize = 1_000_000_000;

/// With fewer rows inside there is nothing to test.
const LEAST_ROWS: usize = 6;

/// Numbers of each row inside, for plots: in run order.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// Place in the run order.
    pub places: Vec<usize>,
    /// Values of the inputs of the surface, in its order.
    pub points: Vec<Vec<f64>>,
    /// As measured.
    pub measured: Vec<f64>,
    /// By the file.
    pub nominal: Vec<f64>,
    /// By the explanation.
    pub explained: Vec<f64>,
    /// Whether the row counts: no outlying run.
    pub counts: Vec<bool>,
    /// What the mean becomes with each combination of the strongest causes that move it, all else fitted again.
    pub combinations: Combinations<Vec<f64>>,
}

/// One response.
#[derive(Debug, Clone)]
pub struct ResponseDiagnosis {
    /// The place of its surface in the model.
    pub surface: usize,
    /// How it ends.
    pub verdict: Verdict,
    /// The strongest first.
    pub causes: Vec<Cause>,
    /// Rows inside the box and the support.
    pub rows: usize,
    /// Places in the run order of rows that are not: left out.
    pub outside: Vec<usize>,
    /// Rows that made the file, from its evidence; none where it does not say: then as many as the new ones are taken.
    pub rows_of_file: Option<usize>,
    /// The noise.
    pub floor: Floor,
    /// Tests for structure that is left, with the share of false alarms of each.
    pub tests: Vec<Test>,
    /// What each of them must stay below to be structure.
    pub threshold_p_structure: f64,
    /// ln of the probability that a cause must stay below.
    pub ln_p_threshold: f64,
    /// 2 ln of the likelihood ratio that a cause of one unknown must reach.
    pub threshold: f64,
    /// What each hypothesis alone would win: label, 2 ln of the likelihood ratio, ln of the probability by chance.
    pub ranking: Vec<(String, f64, f64)>,
    /// Where the file is wrong.
    pub regions: Vec<Region>,
    /// Where the explanation is.
    pub regions_left: Vec<Region>,
    /// Unseen rows.
    pub judged: Judged,
    /// On what, in words.
    pub judged_on: String,
    /// The file's errors there.
    pub nominal: Errors,
    /// Those of the extended file with offsets of drift and blocks, where a row names them.
    pub extended: Errors,
    /// Those of the extended file alone.
    pub extended_file: Errors,
    /// The share of the squared error above the noise that goes away there.
    pub gain: f64,
    /// Figures of test rows, where there are any that can judge.
    pub tested: Option<Tested>,
    /// Whether the search met its limit of work before every kind of noise and every exchange of causes was tried.
    pub stopped: bool,
    /// What the reader of the extended file should know.
    pub notes: Vec<String>,
    /// Whether a part of the explanation (drift, offsets) is of the runs and stands in no file.
    pub has_offsets: bool,
    /// For plots.
    pub shown: Shown,
}

/// All responses that the data have.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The worst of all responses.
    pub verdict: Verdict,
    /// In the order of the model.
    pub responses: Vec<ResponseDiagnosis>,
    /// The model with the extended surfaces.
    pub extended: Model,
    /// Pooled over responses.
    pub gain: f64,
}

/// Figures on rows that nothing has seen.
#[derive(Debug, Clone)]
pub struct Tested {
    /// The file's errors there.
    pub nominal: Errors,
    /// Those of the extended file with offsets of drift and blocks, where a row names them.
    pub extended: Errors,
    /// The share of the squared error above the noise that goes away.
    pub gain: f64,
}

/// Diagnoses every response that the data have, without test rows. `progress` hears what is being done.
///
/// # Errors
/// A sentence, when too few rows are inside.
pub fn diagnose(
    checked: &Checked,
    data: &NewData,
    unseen: Option<&NewData>,
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, String> {
    diagnose_and_test(checked, data, unseen, None, progress)
}

/// Diagnoses every response that the data have. Test rows say at the end what the extension gains, and nothing else comes from them.
///
/// # Errors
/// A sentence, when too few rows are inside.
pub fn diagnose_and_test(
    checked: &Checked,
    data: &NewData,
    unseen: Option<&NewData>,
    test: Option<&NewData>,
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, String> {
    let model = checked.model();
    let compared: Vec<usize> = (0..model.surfaces.len()).filter(|index| data.responses[*index].is_some()).collect();
    let alpha = FALSE_ALARMS / compared.len().max(1) as f64;
    let mut responses = Vec::new();
    let mut extended = model.clone();
    for index in compared {
        let (response, extension) = of_response(model, index, (data, unseen, test), &model.inputs, alpha, progress)?;
        if response.verdict != Verdict::NoDiscrepancy {
            let mut attempt = extended.clone();
            attempt.surfaces[index] = extension.surface.clone();
            let own = model.surfaces[index].inputs.len();
            for input in &extension.inputs[own..] {
                add_input(&mut attempt, input);
            }
            // What the compiler would refuse (a knot that moved out of the range, a name of a compensator's argument) is not written.
            match Checked::from_model(&attempt) {
                Ok(_) => extended = attempt,
                Err(faults) => {
                    let mut response = response;
                    response
                        .notes
                        .push(format!("the extended surface cannot stand in a model file: {}", faults.list()[0].what));
                    responses.push(response);
                    continue;
                }
            }
        }
        responses.push(response);
    }
    let has = |verdict: Verdict| responses.iter().any(|it| it.verdict == verdict);
    let verdict = if has(Verdict::Unexplained) {
        Verdict::Unexplained
    } else if has(Verdict::Explained) {
        Verdict::Explained
    } else {
        Verdict::NoDiscrepancy
    };
    // A row counts as much as any other.
    let rows = responses.iter().map(|it| it.nominal.rows).sum::<usize>().max(1) as f64;
    let mean = |of: fn(&ResponseDiagnosis) -> &Errors| -> f64 {
        responses.iter().map(of).map(|it| it.rows as f64 / rows * it.excess()).sum()
    };
    let gain = holdout::gone(mean(|it| &it.nominal), mean(|it| &it.extended));
    Ok(Diagnosis { verdict, responses, extended, gain })
}

/// Two surfaces may lack the same input: it stands in the file once, with the range that it has in all the data.
fn add_input(model: &mut Model, input: &Input) {
    if !model.inputs.iter().any(|other| other.name == input.name) {
        model.inputs.push(input.clone());
    }
}

/// A sample with what explains it.
struct Answer {
    sample: Sample,
    hypotheses: Vec<Hypothesis>,
    thresholds: Thresholds,
    found: Explained,
    estimates: Estimates,
    tests: Vec<Test>,
    /// Whether the search met its limit of work.
    stopped: bool,
}

impl Answer {
    /// Thresholds on these rows, the explanation, its numbers, what is left.
    fn new(sample: Sample, alpha: f64, told: &dyn Fn(usize)) -> Self {
        let hypotheses = hypotheses::all(&sample);
        let every: Vec<usize> = (0..sample.rows()).collect();
        let even = whitening::Shape { scale: vec![1.0; sample.rows()], rho: 0.0 };
        let space = explained::space_of(&sample, &every, &even, explain::loosenesses(&sample)[0]);
        let carried: Vec<Vec<Vec<f64>>> =
            hypotheses.iter().map(|it| it.columns.iter().map(|column| space.carried(column)).collect()).collect();
        let thresholds = Thresholds::new(&carried, &sample.nominal, sample.rows(), alpha);
        let work = Work::telling(MOST_WORK, told);
        let mut found = explain::explain(&sample, &hypotheses, &thresholds, &work);
        estimate::refine(&sample, &mut found);
        let estimates = estimate::numbers(&sample, &found);
        let tests = residual_tests::tests(&sample, &found);
        Answer { sample, hypotheses, thresholds, found, estimates, tests, stopped: work.ran_out() }
    }

    /// What each test must stay below to be structure.
    fn threshold_p_structure(&self) -> f64 {
        self.thresholds.alpha_structure / self.tests.len().max(1) as f64
    }

    /// Whether structure is left that no cause explains.
    fn is_structure_left(&self) -> bool {
        self.tests.iter().any(|it| it.ln_p < self.threshold_p_structure().ln())
    }
}

/// Rows are chosen by an explanation, which rests on rows: so often in turns.
const CHOICES: usize = 4;

/// The answer, and the rows that it rests on. A reading beyond the range may be a faulty sensor's of a point inside, and such points (corners of a design) tell most about the sensor. So a second explanation begins
/// with the rows nearby too; it counts if it names an input's sensor, if the rows that it rests on are those that were inside by what it says of that sensor, and if it leaves nothing unexplained.
fn answer(sample_of: &dyn Fn(Taken<'_>) -> Sample, alpha: f64, told: &dyn Fn(usize)) -> Answer {
    let inside = sample_of(Taken::Inside);
    let near = sample_of(Taken::Near);
    if near.rows() == inside.rows() {
        return Answer::new(inside, alpha, told);
    }
    // Two searches: each has half of the false alarms.
    let (by_reading, mut places) = (Answer::new(inside, alpha / 2.0, told), near.places.clone());
    for _ in 0..CHOICES {
        let answer = Answer::new(sample_of(Taken::Places(&places)), alpha / 2.0, told);
        let Some(sensors) = estimate::sensors_believed(&answer.sample, &answer.found, &answer.estimates) else { break };
        let truly = near.truly_inside(&sensors);
        if truly == places {
            let better = by_reading.is_structure_left() || !answer.is_structure_left();
            return if better { answer } else { by_reading };
        }
        if truly.len() < LEAST_ROWS {
            break;
        }
        places = truly;
    }
    by_reading
}

fn of_response(
    model: &Model,
    index: usize,
    (data, unseen, test): (&NewData, Option<&NewData>, Option<&NewData>),
    taken: &[Input],
    alpha: f64,
    progress: &mut dyn FnMut(&str),
) -> Result<(ResponseDiagnosis, Extension), String> {
    let surface = &model.surfaces[index];
    let response = data.responses[index].as_ref().expect("a compared surface has a response");
    let sample_of = |taken: Taken<'_>| Sample::new(model, index, &data.inputs, response, &data.extras, taken);
    let inside = sample_of(Taken::Inside);
    if let Some(beyond) = inside.nominal.iter().find(|value| value.is_nan() || value.abs() > MAGNITUDES[1]) {
        return Err(format!(
            "`{}`: the model gives {beyond:?} at a row of the data, expected a magnitude up to {:e}: squares of what it errs must be finite",
            surface.name, MAGNITUDES[1]
        ));
    }
    let rows_inside = inside.rows();
    if rows_inside < LEAST_ROWS {
        return Err(format!(
            "`{}`: {rows_inside} of {} rows are inside the ranges and the support of the surface, and a diagnosis needs {LEAST_ROWS}",
            surface.name,
            response.len()
        ));
    }
    let progress = std::cell::RefCell::new(progress);
    let say = |what: &str| (progress.borrow_mut())(&format!("{}: {what}", surface.name));
    say("looking for causes");
    let answer =
        answer(&sample_of, alpha, &|percent| say(&format!("looking for causes, {percent} % of the work that is allowed")));
    let (threshold_p_structure, is_structure_left) = (answer.threshold_p_structure(), answer.is_structure_left());
    let Answer { sample, hypotheses, thresholds, found, estimates, tests, stopped } = answer;
    let floor = residual_tests::floor(&sample, &found);
    let mut causes = causes::all(&sample, &hypotheses, &thresholds, &found, &estimates);
    let extension = extension::extend(&sample, &found, &estimates, taken);
    // A search that was cut short has not shown that it knows the causes.
    let verdict = if is_structure_left || stopped {
        Verdict::Unexplained
    } else if causes.is_empty() {
        Verdict::NoDiscrepancy
    } else {
        Verdict::Explained
    };
    for cause in &mut causes {
        cause.believe(confidence::beside_the_unknown(cause.probability(), verdict));
    }
    let mut notes = extension.notes.clone();
    if stopped {
        notes.push(
            "the search met its limit of work: further kinds of noise and exchanges of causes were not asked".to_string(),
        );
    }
    let names = |data: &NewData| data.files.iter().map(|file| file.name.as_str()).collect::<Vec<_>>().join(", ");
    let on_files = unseen.map(|unseen| (unseen, holdout::on_files(model, index, &extension, unseen)));
    let (judged, judged_on) = match on_files {
        Some((_, Ok(judged))) => {
            (judged, "rows of the files for validation, from which nothing was chosen or estimated".to_string())
        }
        other => {
            if let Some((unseen, Err(why))) = &other {
                notes.push(format!("{} cannot judge the extension: {why}; rows of the data do in turns", names(unseen)));
            }
            say("judging by cross-validation");
            let judged = holdout::by_folds(&sample, &thresholds, &found, taken, MOST_WORK_OF_FOLD);
            (judged, format!("cross-validation in {} parts, causes chosen again without each", holdout::FOLDS))
        }
    };
    // The last that is done: nothing after it looks at what comes out.
    let tested = test.and_then(|test| match holdout::on_files(model, index, &extension, test) {
        Ok(judged) => {
            let judged = judged.of(verdict);
            let of = |computed: &[f64]| judged.errors(computed, floor.sd);
            Some(Tested { nominal: of(&judged.nominal), extended: of(&judged.extended), gain: judged.gain(floor.sd) })
        }
        Err(why) => {
            notes.push(format!("{} cannot test the extension: {why}", names(test)));
            None
        }
    });
    let judged = judged.of(verdict);
    let kept = found.kept();
    let left: Vec<f64> = sample.response.iter().zip(&found.fitted).map(|(y, f)| y - f).collect();
    let diagnosis = ResponseDiagnosis {
        surface: index,
        verdict,
        rows: sample.rows(),
        outside: sample.outside.clone(),
        rows_of_file: surface.evidence.iter().find_map(|(name, value)| match value {
            Evidence::Whole(rows) if name == "rows" => usize::try_from(*rows).ok(),
            _ => None,
        }),
        tests,
        threshold_p_structure,
        ln_p_threshold: thresholds.ln_p_mean,
        threshold: causes::needed(&thresholds),
        ranking: causes::ranking(&sample, &hypotheses, &thresholds, &found),
        regions: regions::regions(&sample, &sample.residual(), &kept),
        regions_left: regions::regions(&sample, &left, &kept),
        nominal: judged.errors(&judged.nominal, floor.sd),
        extended: judged.errors(&judged.extended, floor.sd),
        extended_file: judged.errors(&judged.file, floor.sd),
        gain: judged.gain(floor.sd),
        judged,
        judged_on,
        stopped,
        has_offsets: !extension.offsets.is_empty(),
        tested,
        notes: if verdict == Verdict::NoDiscrepancy { Vec::new() } else { notes },
        shown: Shown {
            places: sample.places.clone(),
            points: sample.points.clone(),
            measured: sample.response.clone(),
            nominal: sample.nominal.clone(),
            explained: found.fitted.clone(),
            counts: (0..sample.rows()).map(|row| !found.outliers.contains(&row)).collect(),
            combinations: causes::combinations(&sample, &found, &causes),
        },
        floor,
        causes,
    };
    Ok((diagnosis, extension))
}
