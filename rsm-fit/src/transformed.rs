//! The fit of a response whose terms describe a transform of it.
//!
//! In: a task with the measured responses. Out: the outcome of the same fit of transformed responses, with the surface that returns the response
//! itself. Bounds and the output range are transformed too. The weights of rows are divided by the square of the slope of the transform, so that they
//! stay proportional to 1/sigma^2. "box-cox" fits with every transform and takes the one with the largest likelihood of the measured responses (Box,
//! Cox 1964). Chooses no terms.

use rsm_core::check;
use rsm_core::model::{Input, Outside, Surface, Transform};
use rsm_core::number::Precision;
use rsm_core::source::{Fault, Faults};

use crate::outcome::{Progress, ResponseOutcome};
use crate::response::Task;
use crate::selection::{Sample, relative};
use crate::spec::{Constraint, ResponseSpec, Specification, TransformSpec};
use crate::statistics::{ResponseStatistics, TransformReport, TriedTransform};
use crate::verdict::Verdict;

/// Half of the 95 % point of chi squared with one degree of freedom: a transform is taken if the likelihood falls by more without it.
const DROP: f64 = 1.920_729_410_347_062;

/// Fits the response, with its transform if it has one.
pub(crate) fn run(
    task: &Task<'_>,
    surface: &mut Surface,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<ResponseOutcome, Faults> {
    match task.response.transform {
        None => task.run(surface, progress),
        Some(TransformSpec::Given(transform)) => {
            let (found, outcome) = with(transform, task, surface, progress)?;
            *surface = found;
            Ok(outcome)
        }
        Some(TransformSpec::BoxCox) => box_cox(task, surface, progress),
    }
}

/// The fit with a transform.
fn with(
    transform: Transform,
    task: &Task<'_>,
    surface: &Surface,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<(Surface, ResponseOutcome), Faults> {
    let response = of_terms(transform, task.response);
    let mut fit = task.fit.clone();
    let mut apart = [task.validate.clone(), task.test.clone()];
    let keys = ["to fit", "to validate", "to test"];
    for (rows, key) in std::iter::once(&mut fit).chain(apart.iter_mut().flatten()).zip(keys) {
        of_sample(task.specification, task.response, transform, rows, key)?;
        rows.weights = relative(&rows.weights);
    }
    let [validate, test] = apart;
    let of_terms = Task {
        response: &response,
        inputs: task.inputs.clone(),
        fit,
        validate,
        test,
        validate_weights: task.validate_weights.clone(),
        copies: task.copies.clone(),
        ..*task
    };
    let mut found = Surface { unit: surface.unit.clone(), ..response.surface.clone() };
    let mut outcome = of_terms.run(&mut found, progress)?;
    finish(task.specification, [task.response, &response], task.own_inputs(), &mut found, &mut outcome)?;
    Ok((found, outcome))
}

/// Completes a fit of transformed responses: the surface has the output range of the response, and constraints are told in the words of the
/// specification. `[response, of_terms]`: the response, and as it was fitted.
///
/// # Errors
/// If the fitted terms have no response somewhere in the box.
pub(crate) fn finish(
    specification: &Specification,
    [response, of_terms]: [&ResponseSpec; 2],
    inputs: &[Input],
    surface: &mut Surface,
    outcome: &mut ResponseOutcome,
) -> Result<(), Faults> {
    surface.output_range = response.surface.output_range;
    in_words_of(response, of_terms, outcome);
    let (Some(transform), Some(statistics)) = (surface.transform, &mut outcome.statistics) else { return Ok(()) };
    // It is about the measured response.
    statistics.analysis.iter_mut().for_each(|analysis| analysis.box_cox = None);
    if transform.is_falling() {
        // A maximum of the terms is a minimum of the response.
        statistics.canonical = None;
    }
    check::transform_fits(surface, inputs, Precision::F64).map_err(|(what, help)| {
        let what = format!("response `{}`: `transform` \"{}\": {what}", surface.name, transform.word());
        Faults::one(fault(specification, response, what).help(help))
    })
}

fn fault(specification: &Specification, response: &ResponseSpec, what: String) -> Fault {
    specification.fault(&format!("responses.{}.transform", response.surface.name), what)
}

/// The response as its terms see it: bounds, slopes and output range of the transformed response.
pub(crate) fn of_terms(transform: Transform, response: &ResponseSpec) -> ResponseSpec {
    let mut of_terms = response.clone();
    let ordered = |low: Option<f64>, high: Option<f64>| if transform.is_falling() { (high, low) } else { (low, high) };
    for constraint in &mut of_terms.constraints {
        *constraint = match constraint.clone() {
            Constraint::Bounds { min, max } => {
                let at = |bound: Option<f64>| bound.and_then(|bound| transform.transformed(bound));
                // The formula of a response is below the exact one, never above.
                let min = at(min).map(|p| p + transform.shortfall());
                let (min, max) = ordered(min, at(max));
                Constraint::Bounds { min, max }
            }
            Constraint::Monotone { input, increasing } => {
                Constraint::Monotone { input, increasing: increasing != transform.is_falling() }
            }
            other => other,
        };
    }
    of_terms.surface.output_range = response.surface.output_range.map(|range| transform.transformed_range(range));
    of_terms.surface.transform = Some(transform);
    of_terms
}

/// Transforms the responses of rows, and divides their weights by the squared slope. `key`: what the rows are for.
///
/// # Errors
/// If a response has no transform.
pub(crate) fn of_sample(
    specification: &Specification,
    response: &ResponseSpec,
    transform: Transform,
    rows: &mut Sample,
    key: &str,
) -> Result<(), Faults> {
    let is_weighted = !rows.weights.is_empty();
    // A slope without a limit would give the row no weight.
    let is_fine = |y: &f64| transform.transformed(*y).is_some() && (!is_weighted || transform.slope(*y).is_finite());
    let wrong: Vec<f64> = rows.response.iter().copied().filter(|y| !is_fine(y)).collect();
    if let Some(first) = wrong.first() {
        let accepted = match (is_weighted, *first) {
            (true, 0.0) => "other than 0, where a root has no slope for the weight",
            _ => transform.accepted(),
        };
        let (name, word) = (&response.surface.name, transform.word());
        let what = format!(
            "response `{name}`: `transform` \"{word}\": found {first} in the rows {key}, expected {accepted} ({} of {} rows)",
            wrong.len(),
            rows.rows()
        );
        let help = "use another transform, or leave these rows out";
        return Err(Faults::one(fault(specification, response, what).help(help)));
    }
    for (weight, y) in rows.weights.iter_mut().zip(&rows.response) {
        let slope = transform.slope(*y);
        *weight /= slope * slope;
    }
    for y in &mut rows.response {
        *y = transform.transformed(*y).expect("every response was looked at");
    }
    Ok(())
}

/// Writes constraints in the words of the specification.
fn in_words_of(response: &ResponseSpec, of_terms: &ResponseSpec, outcome: &mut ResponseOutcome) {
    let words: Vec<(String, String)> =
        of_terms.constraints.iter().zip(&response.constraints).map(|(one, own)| (one.to_string(), own.to_string())).collect();
    let replace = |text: &mut String| {
        if let Some((_, own)) = words.iter().find(|(one, _)| one == text) {
            text.clone_from(own);
        }
    };
    match &mut outcome.verdict {
        Verdict::Infeasible { constraints } => constraints.iter_mut().for_each(replace),
        Verdict::NotProven(why) => why.constraints.iter_mut().for_each(|one| replace(&mut one.constraint)),
        _ => {}
    }
    let Some(statistics) = &mut outcome.statistics else { return };
    let told = statistics.constraints.iter_mut().flat_map(|told| &mut told.constraints);
    told.for_each(|one| replace(&mut one.constraint));
    for warning in &mut statistics.warnings {
        for (one, own) in &words {
            warning.what = warning.what.replace(one, own);
        }
    }
}

/// A fit with a transform or none, and its likelihood.
struct Fitted {
    transform: Option<Transform>,
    surface: Surface,
    outcome: ResponseOutcome,
    likelihood: Option<f64>,
}

impl Fitted {
    fn word(&self) -> &'static str {
        self.transform.map_or("none", Transform::word)
    }

    fn tried(&self) -> TriedTransform {
        let terms = self.outcome.statistics.as_ref().map_or(0, |statistics| statistics.terms.len());
        let lambda = self.transform.map_or(1.0, Transform::lambda);
        TriedTransform { transform: self.word(), lambda, log_likelihood: self.likelihood, terms }
    }
}

/// The fit with the transform of the largest likelihood.
fn box_cox(task: &Task<'_>, surface: &mut Surface, progress: &mut dyn FnMut(Progress<'_>)) -> Result<ResponseOutcome, Faults> {
    if let Some(wrong) = task.fit.response.iter().find(|y| **y <= 0.0) {
        let what = format!(
            "response `{}`: `transform` \"box-cox\": found {wrong}, expected more than 0 in every row to fit",
            surface.name
        );
        return Err(Faults::one(
            fault(task.specification, task.response, what)
                .help("the family of powers is for positive responses: give \"cube-root\", or none"),
        ));
    }
    let mut alone = surface.clone();
    let outcome = task.run(&mut alone, progress)?;
    let of_none = likelihood(task, None, &outcome);
    let mut tried = vec![Fitted { transform: None, surface: alone, outcome, likelihood: of_none }];
    for transform in Transform::ALL {
        // One that the rows, a bound or the surface do not permit is left out.
        let has_bounds = task.response.constraints.iter().all(|constraint| match constraint {
            Constraint::Bounds { min, max } => {
                [min, max].into_iter().flatten().all(|bound| transform.transformed(*bound).is_some())
            }
            _ => true,
        });
        if !has_bounds || transform.needs_positive() && !task.inputs.iter().all(|it| it.outside == Outside::Clamp) {
            continue;
        }
        if let Ok((surface, outcome)) = with(transform, task, surface, &mut |_| {}) {
            let likelihood = likelihood(task, Some(transform), &outcome);
            tried.push(Fitted { transform: Some(transform), surface, outcome, likelihood });
        }
    }
    let reports: Vec<TriedTransform> = tried.iter().map(Fitted::tried).collect();
    let value = |fitted: &Fitted| fitted.likelihood.unwrap_or(f64::NEG_INFINITY);
    let best = (0..tried.len()).max_by(|a, b| value(&tried[*a]).total_cmp(&value(&tried[*b]))).unwrap_or(0);
    let (none, most) = (value(&tried[0]), value(&tried[best]));
    // Without a residual the likelihood is infinite: nothing is better than that.
    let is_taken = tried[best].transform.is_some() && none < f64::INFINITY && most - none > DROP;
    let best_word = tried[best].word();
    let why = match (tried[best].transform, is_taken) {
        _ if none == f64::INFINITY => "without a transform there is no residual".to_string(),
        (None, _) => "no transform has a larger likelihood".to_string(),
        (Some(_), true) if most == f64::INFINITY => "\"box-cox\" chose it: it leaves no residual".to_string(),
        (Some(_), true) if none.is_finite() => {
            format!(
                "\"box-cox\" chose it: the log likelihood of the measured responses is {most:.1}, {none:.1} without a transform"
            )
        }
        (Some(_), true) => "\"box-cox\" chose it: without a transform there is no surface".to_string(),
        (Some(_), false) => format!(
            "the largest log likelihood, {most:.1} with \"{best_word}\", is not clearly above {none:.1} without a transform: expected more than {DROP:.2} above"
        ),
    };
    let Fitted { surface: found, mut outcome, .. } = tried.swap_remove(if is_taken { best } else { 0 });
    *surface = found;
    if let Some(statistics) = &mut outcome.statistics {
        let given = statistics.transform.take();
        let none = TransformReport { transform: "none", lambda: 1.0, tried: vec![], why: String::new(), fitted: None };
        statistics.transform = Some(TransformReport { tried: reports, why, ..given.unwrap_or(none) });
        if statistics.cross_validation.is_some() {
            statistics.rows_used.error += "; the same rows also chose the transform";
        }
    }
    Ok(outcome)
}

/// The log likelihood of the measured responses for normal noise of the transformed ones, without the constant of the normal density. The variance is
/// that of rows left out one at a time: with few rows, residuals favour the transform with the most terms. Infinite without an error.
fn likelihood(task: &Task<'_>, transform: Option<Transform>, outcome: &ResponseOutcome) -> Option<f64> {
    let statistics = outcome.statistics.as_ref()?;
    let rows = statistics.rows as f64;
    let square = square_of_errors(statistics)? / rows;
    let slopes: f64 = match transform {
        Some(transform) => task.fit.response.iter().map(|y| transform.slope(*y).ln()).sum(),
        None => 0.0,
    };
    // A row whose weight is w has the variance s^2/w: half of log w is in the logarithm of its density. The slope is in the weight too.
    let of_row = |(weight, y): (&f64, &f64)| weight / transform.map_or(1.0, |transform| transform.slope(*y).powi(2));
    let weights: Vec<f64> = task.fit.weights.iter().zip(&task.fit.response).map(of_row).collect();
    let weights: f64 = relative(&weights).iter().map(|weight| 0.5 * weight.ln()).sum();
    let value = slopes + weights - 0.5 * rows * square.ln();
    (!value.is_nan()).then_some(value)
}

/// The sum of squared errors of rows left out one at a time; without it, for a spline or active constraints, of the residual mean square.
fn square_of_errors(statistics: &ResponseStatistics) -> Option<f64> {
    let rows = statistics.rows as f64;
    statistics.press.or_else(|| statistics.residual_sd.map(|sd| sd * sd * rows))
}
