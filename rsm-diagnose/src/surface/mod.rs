//! Diagnosis of a fitted surface with new data: its error by region, the causes with their confidence, and the extended surface.
//!
//! ```text
//!   model.toml, new.csv --data--> NewData --faults: readings, proven_faults--> rows without faulty readings
//!                                         --sample--> Sample (rows inside box and support)
//!       hypotheses: every cause as columns ----+
//!       null: distribution of chance alone ----+--explain, choice--> causes, outlying runs, noise
//!                                                 |  residual_tests: are the residuals noise?
//!                                                 |  estimate, narrative, causes: parameters, sentences, rivals
//!                                                 v
//!       extension: the surface with the causes --holdout--> gain on holdout rows
//! ```
//!
//! In: a checked model, new data. Out: [`Diagnosis`]. Coefficients of the file are estimates. A change within their uncertainty is calibration, not a
//! cause. Thresholds come from noise drawn on the data's own rows, with at most 5 % of false alarms in all. Does not print or write files.

mod approach;
mod cause;
pub mod causes;
mod choice;
mod confidence;
pub mod data;
mod estimate;
mod explain;
mod explained;
mod extension;
pub mod fault;
mod faults;
pub mod holdout;
mod hypotheses;
mod narrative;
mod noise;
mod null;
mod proven_faults;
mod readings;
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
use fault::Fault;
use faults::CheckedRows;
use holdout::{Errors, HoldoutRows};
use hypotheses::Hypothesis;
use null::Thresholds;
use regions::Region;
pub use residual_tests::{NoiseFloor, Test};
use rsm_fit::table::MAGNITUDES;
use sample::{RowSet, Sample};

/// The probability of a false alarm in a whole diagnosis. The promise is 5 %; a fifth is reserved, because the draws give a threshold only to about
/// 15 %.
const FALSE_ALARMS: f64 = 0.04;

/// The limit of multiplications of the search for causes of a response; if there are two explanations, of each: about ten seconds. A hundred rows
/// take a hundredth of it.
const MOST_WORK: usize = 6_000_000_000;

/// The limit of multiplications of each fold of a cross-validation.
const MOST_WORK_OF_FOLD: usize = 1_000_000_000;

/// With fewer rows inside, nothing is tested.
const LEAST_ROWS: usize = 6;

/// Values of each row inside, for plots, in run order.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotValues {
    /// The index in the run order.
    pub places: Vec<usize>,
    /// Values of the inputs of the surface, in its order.
    pub points: Vec<Vec<f64>>,
    /// As measured.
    pub measured: Vec<f64>,
    /// By the nominal file.
    pub nominal: Vec<f64>,
    /// By the explanation.
    pub explained: Vec<f64>,
    /// Whether the row counts; false for outlying runs.
    pub counts: Vec<bool>,
    /// The mean for each combination of the strongest causes that change it, with all others fitted again.
    pub combinations: Combinations<Vec<f64>>,
}

/// The diagnosis of one response.
#[derive(Debug, Clone)]
pub struct ResponseDiagnosis {
    /// The index of its surface in the model.
    pub surface: usize,
    /// The verdict.
    pub verdict: Verdict,
    /// Causes, the strongest first.
    pub causes: Vec<Cause>,
    /// Rows inside the box and the support.
    pub rows: usize,
    /// Indices in the run order of the rows that are outside and left out.
    pub outside: Vec<usize>,
    /// The faults of the data.
    pub faults: Vec<Fault>,
    /// The number of rows that are left out because of them.
    pub left_out: usize,
    /// The number of rows from which the file was made, from its evidence. `None` if the file does not state it; then the number of new rows is used.
    pub rows_of_file: Option<usize>,
    /// The noise.
    pub floor: NoiseFloor,
    /// Tests for remaining structure.
    pub tests: Vec<Test>,
    /// A test shows structure if its probability is below this.
    pub threshold_p_structure: f64,
    /// The log probability below which a cause is significant.
    pub ln_p_threshold: f64,
    /// 2 ln of the likelihood ratio that a cause with one unknown needs.
    pub threshold: f64,
    /// The gain of each hypothesis alone: label, 2 ln of the likelihood ratio, ln of the probability by chance.
    pub ranking: Vec<(String, f64, f64)>,
    /// Regions in which the file is wrong.
    pub regions: Vec<Region>,
    /// Regions in which the explanation is wrong.
    pub regions_left: Vec<Region>,
    /// Holdout rows.
    pub holdout: HoldoutRows,
    /// The source of these rows, in words.
    pub holdout_source: String,
    /// The errors of the file on them.
    pub nominal: Errors,
    /// The errors of the extended file with offsets of drift and blocks, if a row determines them.
    pub extended: Errors,
    /// The errors of the extended file alone.
    pub extended_file: Errors,
    /// The removed share of the squared error above the noise on these rows.
    pub gain: f64,
    /// Figures on test rows, if there are any that can be evaluated.
    pub tested: Option<Tested>,
    /// Whether the work limit was reached before all noise models and all exchanges of causes were tried.
    pub stopped: bool,
    /// Notes for the reader of the extended file.
    pub notes: Vec<String>,
    /// Whether a part of the explanation (drift, offsets) belongs to the runs and is in no file.
    pub has_offsets: bool,
    /// Values for plots.
    pub shown: PlotValues,
}

/// The diagnosis of all responses in the data.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The worst verdict of all responses.
    pub verdict: Verdict,
    /// One entry for each response, in the order of the model.
    pub responses: Vec<ResponseDiagnosis>,
    /// Responses that are not diagnosed because they have one value in all rows: the index of the surface, and the fault.
    pub constant: Vec<(usize, Fault)>,
    /// The model with the extended surfaces.
    pub extended: Model,
    /// The gain over all responses together.
    pub gain: f64,
}

/// Figures on rows that were not used for anything else.
#[derive(Debug, Clone)]
pub struct Tested {
    /// The file's errors there.
    pub nominal: Errors,
    /// The errors of the extended file with offsets of drift and blocks, if a row determines them.
    pub extended: Errors,
    /// The removed share of the squared error above the noise.
    pub gain: f64,
}

/// Diagnoses every response in the data, without test rows. `progress` is called with progress messages.
///
/// # Errors
/// If too few rows are inside; as a sentence.
pub fn diagnose(
    checked: &Checked,
    data: &NewData,
    unseen: Option<&NewData>,
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, String> {
    diagnose_and_test(checked, data, unseen, None, progress)
}

/// Diagnoses every response in the data. Test rows are used only at the end, for the gain of the extension.
///
/// # Errors
/// If too few rows are inside; as a sentence.
pub fn diagnose_and_test(
    checked: &Checked,
    data: &NewData,
    unseen: Option<&NewData>,
    test: Option<&NewData>,
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, String> {
    let file = checked.model();
    let model = &of_terms(file);
    let compared = (0..model.surfaces.len()).filter(|index| data.responses[*index].is_some());
    let mut compared: Vec<(usize, CheckedRows)> = compared.map(|index| (index, CheckedRows::new(model, index, data))).collect();
    // A sensor that reads one value leaves the other responses as they are.
    let constant: Vec<(usize, Fault)> =
        compared.iter().filter_map(|(index, checked)| Some((*index, checked.constant()?))).collect();
    if constant.len() < compared.len() {
        compared.retain(|it| !constant.iter().any(|other| other.0 == it.0));
    }
    let alpha = FALSE_ALARMS / compared.len().max(1) as f64;
    let mut responses = Vec::new();
    let mut extended = model.clone();
    for (index, checked) in compared {
        let (response, extension) = of_response(model, (index, checked), (data, unseen, test), &model.inputs, alpha, progress)?;
        if response.verdict != Verdict::NoDiscrepancy {
            let mut attempt = extended.clone();
            attempt.surfaces[index] = extension.surface.clone();
            let own = model.surfaces[index].inputs.len();
            for input in &extension.inputs[own..] {
                add_input(&mut attempt, input);
            }
            // An extension that the compiler would reject (a knot that moved out of the range, the name of a compensator's argument) is not written.
            match Checked::from_model(&with_transforms(&attempt, file)) {
                Ok(_) => extended = attempt,
                Err(faults) => {
                    let mut response = response;
                    response
                        .notes
                        .push(format!("the extended surface cannot be written as a model file: {}", faults.list()[0].what));
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
    // Every row has the same weight.
    let rows = responses.iter().map(|it| it.nominal.rows).sum::<usize>().max(1) as f64;
    let mean = |of: fn(&ResponseDiagnosis) -> &Errors| -> f64 {
        responses.iter().map(of).map(|it| it.rows as f64 / rows * it.excess()).sum()
    };
    let gain = holdout::removed_share(mean(|it| &it.nominal), mean(|it| &it.extended));
    let extended = with_transforms(&extended, file);
    Ok(Diagnosis { verdict, responses, constant, extended, gain })
}

/// The model whose surfaces return the values of their terms. [`NewData`] has responses after their transforms, so causes are linear.
fn of_terms(model: &Model) -> Model {
    let mut of_terms = model.clone();
    for surface in &mut of_terms.surfaces {
        surface.unit = surface.unit_of_terms();
        if let Some(transform) = surface.transform.take() {
            surface.output_range = surface.output_range.map(|range| transform.transformed_range(range));
        }
    }
    of_terms
}

/// The model with the transforms, units and output ranges of the surfaces of the file.
fn with_transforms(of_terms: &Model, file: &Model) -> Model {
    let mut model = of_terms.clone();
    for (surface, own) in model.surfaces.iter_mut().zip(&file.surfaces) {
        surface.transform = own.transform;
        surface.unit.clone_from(&own.unit);
        if own.transform.is_some() {
            surface.output_range = own.output_range;
        }
    }
    model
}

/// Two surfaces may lack the same input. The file then contains it once, with its range in all the data.
fn add_input(model: &mut Model, input: &Input) {
    if !model.inputs.iter().any(|other| other.name == input.name) {
        model.inputs.push(input.clone());
    }
}

/// A sample with its explanation.
struct ExplainedSample {
    sample: Sample,
    hypotheses: Vec<Hypothesis>,
    thresholds: Thresholds,
    found: Explained,
    estimates: Estimates,
    tests: Vec<Test>,
    /// Whether the search reached its work limit.
    stopped: bool,
}

impl ExplainedSample {
    /// Computes thresholds on these rows, the explanation, its parameters, and the tests of the residual.
    fn new(sample: Sample, alpha: f64, progress: &dyn Fn(usize)) -> Self {
        let hypotheses = hypotheses::all(&sample);
        let every: Vec<usize> = (0..sample.rows()).collect();
        let even = whitening::Shape { scale: vec![1.0; sample.rows()], rho: 0.0 };
        let space = explained::space_of(&sample, &every, &even, explain::variance_factors(&sample)[0]);
        let whitened: Vec<Vec<Vec<f64>>> =
            hypotheses.iter().map(|it| it.columns.iter().map(|column| space.in_whitened_space(column)).collect()).collect();
        let thresholds = Thresholds::new(&whitened, &sample.nominal, sample.rows(), alpha);
        let work = Work::with_progress(MOST_WORK, progress);
        let mut found = explain::explain(&sample, &hypotheses, &thresholds, &work);
        estimate::refine(&sample, &mut found);
        let estimates = estimate::numbers(&sample, &found);
        let tests = residual_tests::tests(&sample, &found);
        ExplainedSample { sample, hypotheses, thresholds, found, estimates, tests, stopped: work.has_stopped_work() }
    }

    /// The probability below which a test shows structure.
    fn threshold_p_structure(&self) -> f64 {
        self.thresholds.alpha_structure / self.tests.len().max(1) as f64
    }

    /// Whether structure is left that no cause explains.
    fn is_structure_left(&self) -> bool {
        self.tests.iter().any(|it| it.ln_p < self.threshold_p_structure().ln())
    }
}

/// The explanation selects rows, and it is fitted to these rows. This is the largest number of repetitions.
const MOST_ROW_CHOICES: usize = 4;

/// The sample with its explanation, and the rows on which it is based. A reading beyond the range may come from a faulty sensor at a point inside,
/// and such points (corners of a design) contain the most information about the sensor. So a second explanation starts with nearby rows too. It is
/// used if it names an input sensor, if its rows are those that are inside after correction of that sensor, and if it leaves nothing unexplained.
fn explained_sample(sample_of: &dyn Fn(RowSet<'_>) -> Sample, alpha: f64, progress: &dyn Fn(usize)) -> ExplainedSample {
    let inside = sample_of(RowSet::Inside);
    let near = sample_of(RowSet::Near);
    if near.rows() == inside.rows() {
        return ExplainedSample::new(inside, alpha, progress);
    }
    // There are two searches; each has half of the allowed false alarms.
    let (by_reading, mut places) = (ExplainedSample::new(inside, alpha / 2.0, progress), near.places.clone());
    for _ in 0..MOST_ROW_CHOICES {
        let explained = ExplainedSample::new(sample_of(RowSet::Places(&places)), alpha / 2.0, progress);
        let Some(sensors) = estimate::plausible_sensors(&explained.sample, &explained.found, &explained.estimates) else {
            break;
        };
        let truly = near.truly_inside(&sensors);
        if truly == places {
            let better = by_reading.is_structure_left() || !explained.is_structure_left();
            return if better { explained } else { by_reading };
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
    (index, checked): (usize, CheckedRows),
    (data, unseen, test): (&NewData, Option<&NewData>, Option<&NewData>),
    taken: &[Input],
    alpha: f64,
    progress: &mut dyn FnMut(&str),
) -> Result<(ResponseDiagnosis, Extension), String> {
    let surface = &model.surfaces[index];
    let response = &checked.response;
    let sample_of = |taken: RowSet<'_>| Sample::new(model, index, &data.inputs, (response, &checked.used), &data.extras, taken);
    let inside = sample_of(RowSet::Inside);
    if let Some(beyond) = inside.nominal.iter().find(|value| value.is_nan() || value.abs() > MAGNITUDES[1]) {
        return Err(format!(
            "`{}`: the model gives {beyond:?} at a row of the data, expected a magnitude up to {:e}: the squares of its errors must be finite",
            surface.name, MAGNITUDES[1]
        ));
    }
    let rows_inside = inside.rows();
    if rows_inside < LEAST_ROWS {
        let faulty = match checked.left_out() {
            0 => String::new(),
            count => format!(", {count} have faulty readings ({})", checked.names()),
        };
        return Err(format!(
            "`{}`: {rows_inside} of {} rows are inside the ranges and the support of the surface{faulty}, and a diagnosis needs {LEAST_ROWS}",
            surface.name,
            response.len()
        ));
    }
    let progress = std::cell::RefCell::new(progress);
    let say = |what: &str| (progress.borrow_mut())(&format!("{}: {what}", surface.name));
    say("looking for causes");
    let explained = explained_sample(&sample_of, alpha, &|percent| {
        say(&format!("looking for causes, {percent} % of the work that is allowed"));
    });
    let (threshold_p_structure, is_structure_left) = (explained.threshold_p_structure(), explained.is_structure_left());
    let ExplainedSample { sample, hypotheses, thresholds, found, estimates, tests, stopped } = explained;
    let floor = residual_tests::floor(&sample, &found);
    let mut causes = causes::all(&sample, &hypotheses, &thresholds, &found, &estimates);
    let extension = extension::extend(&sample, &found, &estimates, taken);
    // A search that reached its work limit has not proved its causes.
    let verdict = if is_structure_left || stopped {
        Verdict::Unexplained
    } else if causes.is_empty() {
        Verdict::NoDiscrepancy
    } else {
        Verdict::Explained
    };
    for cause in &mut causes {
        cause.set_probability(confidence::with_unlisted_cause(cause.probability(), verdict));
    }
    let mut notes = extension.notes.clone();
    if stopped {
        notes.push(
            "the search reached its work limit: further kinds of noise and exchanges of causes were not tried".to_string(),
        );
    }
    let names = |data: &NewData| data.files.iter().map(|file| file.name.as_str()).collect::<Vec<_>>().join(", ");
    let on_files = unseen.map(|unseen| (unseen, holdout::on_files(model, index, &extension, unseen)));
    let (judged, holdout_source) = match on_files {
        Some((_, Ok(judged))) => {
            (judged, "rows of the files for validation, from which nothing was chosen or estimated".to_string())
        }
        other => {
            if let Some((unseen, Err(why))) = &other {
                notes.push(format!(
                    "{} cannot be used for validation: {why}; cross-validation on the data is used instead",
                    names(unseen)
                ));
            }
            say("judging by cross-validation");
            let judged = holdout::by_folds(&sample, &thresholds, &found, taken, MOST_WORK_OF_FOLD);
            (judged, format!("cross-validation in {} parts, causes chosen again without each", holdout::FOLDS))
        }
    };
    // This is the last step: nothing else uses the test rows.
    let tested = test.and_then(|test| match holdout::on_files(model, index, &extension, test) {
        Ok(judged) => {
            let judged = judged.of(verdict);
            let of = |computed: &[f64]| judged.errors(computed, floor.sd);
            Some(Tested { nominal: of(&judged.nominal), extended: of(&judged.extended), gain: judged.gain(floor.sd) })
        }
        Err(why) => {
            notes.push(format!("{} cannot be used as test data: {why}", names(test)));
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
        left_out: checked.left_out(),
        faults: checked.faults,
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
        holdout: judged,
        holdout_source,
        stopped,
        has_offsets: !extension.offsets.is_empty(),
        tested,
        notes: if verdict == Verdict::NoDiscrepancy { Vec::new() } else { notes },
        shown: PlotValues {
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
