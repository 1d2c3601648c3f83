//! A complete fit, from a specification to a model.
//!
//! In: a [`Specification`]. Out: an [`Outcome`]: the model, and the outcome and the figures of every response. Bad input is an
//! error with every fault; a numerical outcome (confidence not reached, linearly dependent columns) is data. The way of one
//! response is in `response.rs`. Never writes a file.

use rsm_core::order;
use std::borrow::Cow;

use rsm_core::check::Checked;
use rsm_core::model::{Input, Model};
use rsm_core::source::{Collector, Fault, Faults, Source};

use crate::blocks::Blocks;
use crate::constrain::NotProven;
use crate::content::Content;
use crate::evidence;
use crate::left_out::{self, LeftOut, OfResponse};
use crate::points;
use crate::records::{DataFile, Records, Refused, Rows, Units};
use crate::response::Task;
use crate::selection::{Sample, relative};
use crate::series;
use crate::spec::{ResponseSpec, Specification, Validation, check_basis_against_ranges};
use crate::split;
use crate::statistics::{Named, ResponseStatistics};
use crate::transformed;

pub use crate::outcome::{Progress, ResponseOutcome};
pub use crate::selection::ChosenBy;
pub use crate::verdict::Verdict;

/// The outcome of a specification.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The model: a surface for every response that could be fitted.
    pub model: Model,
    /// Every response, in the order of the specification.
    pub responses: Vec<ResponseOutcome>,
    /// The data files, those for validation included.
    pub files: Vec<DataFile>,
    /// The rows that were fitted, in the units of the model.
    pub fitted: Records,
    /// The rows that were kept for validation.
    pub validation: Option<Records>,
    /// The test rows, which are used only for the final errors.
    pub test: Option<Records>,
    /// For each response the rows that it leaves out because a cell is missing.
    pub left_out: Vec<Vec<LeftOut>>,
    /// The columns of [`Records::labels`] of the rows to fit, and of rows that were set aside from them.
    pub labels: Vec<String>,
}

impl Outcome {
    /// The same outcome with rows whose responses have the effects of their blocks taken off, as a plot beside the surface needs them.
    #[must_use]
    pub fn without_blocks(&self) -> Cow<'_, Outcome> {
        let has_blocks = |response: &ResponseOutcome| response.statistics.as_ref().is_some_and(|it| it.blocks.is_some());
        if !self.responses.iter().any(has_blocks) {
            return Cow::Borrowed(self);
        }
        let mut other = self.clone();
        let rows = [Some(&mut other.fitted), other.validation.as_mut(), other.test.as_mut()];
        for records in rows.into_iter().flatten() {
            for (k, response) in self.responses.iter().enumerate() {
                let Some(blocks) = response.statistics.as_ref().and_then(|it| it.blocks.as_ref()) else { continue };
                let transform = self.model.surface(&response.name).and_then(|surface| surface.transform);
                for row in 0..records.rows() {
                    let effect = blocks.effect_of(&self.labels, records, row);
                    let y = records.responses[k][row];
                    // The effects are those of the terms.
                    records.responses[k][row] = match transform {
                        Some(transform) => transform.transformed(y).map_or(y, |p| transform.response(p - effect)),
                        None => y - effect,
                    };
                }
            }
        }
        Cow::Owned(other)
    }

    /// Whether every response was fitted and reached the required confidence.
    #[must_use]
    pub fn reached(&self) -> bool {
        self.responses.iter().all(|response| matches!(response.verdict, Verdict::Fitted | Verdict::Reached { .. }))
    }

    /// The outcome of a response.
    #[must_use]
    pub fn response(&self, name: &str) -> Option<&ResponseOutcome> {
        self.responses.iter().find(|response| response.name == name)
    }

    /// The figures of a response; `None` if there is no such response, or if it could not be fitted.
    #[must_use]
    pub fn statistics(&self, response: &str) -> Option<&ResponseStatistics> {
        self.response(response)?.statistics.as_ref()
    }

    /// The model with a proof that it is consistent. Evaluators are generated from this.
    ///
    /// # Errors
    /// Every fault of the model, as [`Checked::from_model`]: a model without any surface, or names that no language can have.
    ///
    /// ```
    /// use rsm_core::{lower, number::Precision, run::Interpreter};
    /// use rsm_fit::Fit;
    ///
    /// let outcome = Fit::new(&[0.0, 1.0, 2.0], &[1.0, 3.0, 5.0]).order(1).fit()?;
    /// let tape = lower::surface(&outcome.checked()?, 0, Precision::F64);
    /// assert_eq!(Interpreter::<f64>::new(&tape).eval(&[1.5]), 4.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn checked(&self) -> Result<Checked, Faults> {
        Checked::from_model(&self.model)
    }

    /// What `rsm fit --json` prints.
    ///
    /// ```
    /// use rsm_fit::Fit;
    ///
    /// let outcome = Fit::new(&[0.0, 1.0, 2.0], &[1.0, 3.0, 5.0]).order(1).fit()?;
    /// let json = serde_json::to_value(outcome.report())?;
    /// assert_eq!(json["responses"]["y"]["terms"][0]["coefficient"], 3.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn report(&self) -> Report<'_> {
        let of_one = |response: &'_ ResponseOutcome| response.name.clone();
        let responses = self.responses.iter().map(|response| (of_one(response), response.statistics.as_ref())).collect();
        let without = self.responses.iter().filter(|response| response.statistics.is_none());
        let not_fitted = without.map(|response| (of_one(response), NotFitted::new(&response.verdict))).collect();
        let missing = self.responses.iter().zip(&self.left_out).filter(|(_, left_out)| !left_out.is_empty());
        let missing = missing.map(|(response, left_out)| (of_one(response), &left_out[..])).collect();
        Report { model: &self.model.name, responses: Named(responses), not_fitted: Named(not_fitted), missing: Named(missing) }
    }
}

/// The object of docs/book/src/reference/formats.md 4.1. A response that could not be fitted is null.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Report<'a> {
    /// The name of the model.
    pub model: &'a str,
    /// The figures of every response.
    pub responses: Named<Option<&'a ResponseStatistics>>,
    /// Why a response is null; omitted if none is.
    #[serde(skip_serializing_if = "is_empty")]
    pub not_fitted: Named<NotFitted<'a>>,
    /// The rows that a response leaves out because a cell is missing; omitted if there are none.
    #[serde(skip_serializing_if = "is_empty")]
    pub missing: Named<&'a [LeftOut]>,
}

/// Why a response could not be fitted.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct NotFitted<'a> {
    /// In words.
    pub why: String,
    /// Its unproven constraints, and what ended the search; omitted for other reasons.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_proven: Option<&'a NotProven>,
}

impl<'a> NotFitted<'a> {
    fn new(verdict: &'a Verdict) -> Self {
        let not_proven = if let Verdict::NotProven(why) = verdict { Some(why) } else { None };
        NotFitted { why: verdict.to_string(), not_proven }
    }
}

fn is_empty<T>(named: &Named<T>) -> bool {
    named.0.is_empty()
}

/// Rows for the fit, for validation and for the test.
pub(crate) struct Data {
    pub fit: Records,
    pub validate: Option<Records>,
    pub test: Option<Records>,
    pub units: Units,
}

/// Fits every response of a specification.
///
/// # Errors
/// Every fault of the data files; then those that only data and specification together show.
pub fn fit(specification: &Specification, progress: &mut dyn FnMut(Progress<'_>)) -> Result<Outcome, Refused> {
    let data = read(specification, &mut |file| {
        progress(Progress::Reading { file });
        Content::read(&specification.path_of(file))
    })?;
    fit_rows(specification, data, progress)
}

/// Fits every response of a specification whose data files are in memory: `sources` have the names of the specification.
///
/// # Errors
/// Those of [`fit`]; a file that the specification names and that is not there.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_fit::{Specification, fit};
///
/// let text = r#"
///     format = 1
///     model = "car"
///     data = ["bench.csv"]
///     inputs.speed.unit = "m/s"
///     [responses.drag]
///     inputs = ["speed"]
///     select = { method = "fixed", order = 1 }
/// "#;
/// let specification = Specification::from_source(Source::new("fit.toml", text), "".into())?;
/// let data = Source::new("bench.csv", "speed[km/h],drag[N]\n0,5\n54,35\n108,65\n");
/// let outcome = fit::fit_sources(&specification, &[data], &mut |_progress| {})?;
/// assert_eq!(outcome.model.inputs[0].range, [0.0, 30.0]); // 108 km/h, in the unit of the model
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn fit_sources(
    specification: &Specification,
    sources: &[Source],
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Outcome, Refused> {
    let data = read(specification, &mut |file| {
        progress(Progress::Reading { file });
        let found = sources.iter().find(|source| source.name() == file).cloned();
        found.map(Content::from).ok_or_else(|| Faults::one(Fault::whole_file(file, "is not among the files in memory")))
    })?;
    fit_rows(specification, data, progress)
}

/// Fits every response to rows in memory. All fits use this function. It also makes the splits of the specification.
pub(crate) fn fit_rows(
    specification: &Specification,
    data: Data,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Outcome, Refused> {
    let mut data = in_one_period(specification, data);
    let left_out = left_out::remove(specification, &mut data.fit, data.validate.as_mut(), data.test.as_mut())?;
    if specification.has_series() {
        series::mark(specification, &mut data.fit)?;
    }
    let data = set_aside(specification, data)?;
    let rows = [Some(&data.fit), data.validate.as_ref(), data.test.as_ref()];
    let of_one = |(k, left_out): (usize, &Vec<LeftOut>)| left_out::of_response(specification, rows, k, left_out);
    let own: Vec<OfResponse<'_>> = left_out.iter().enumerate().map(of_one).collect::<Result<_, Faults>>()?;
    let spans = (0..specification.inputs.len()).map(|k| span(&left_out::used_values(specification, &data.fit, k)));
    let inputs = inputs(specification, &data.units, &spans.collect::<Vec<_>>())?;
    let blocks = own.iter().map(|own| Blocks::of(specification, &own.fit)).collect::<Result<Vec<_>, Faults>>()?;
    let mut model = Model { name: specification.model.clone(), inputs: inputs.clone(), ..Model::default() };
    let mut responses = Vec::new();
    for (k, response) in specification.responses.iter().enumerate() {
        let name = &response.surface.name;
        progress(Progress::Fitting { response: name, number: k + 1, of: specification.responses.len() });
        let used = left_out::inputs_of(specification, response);
        let mut surface = response.surface.clone();
        surface.unit = data.units.get(specification.inputs.len() + k).to_string();
        let own = &own[k];
        let blocks = blocks[k].as_ref();
        let apart = |records: &Option<Cow<'_, Records>>| {
            records.as_ref().map(|records| sample(specification, records, (&used, blocks), k, Vec::new()))
        };
        let task = Task {
            specification,
            response,
            inputs: used.iter().map(|k| inputs[*k].clone()).chain(blocks.iter().flat_map(|blocks| blocks.inputs())).collect(),
            blocks,
            fit: sample(specification, &own.fit, (&used, blocks), k, relative(&own.fit.weights[k])),
            sequence: &own.sequence,
            validate: apart(&own.validate),
            validate_weights: own.validate.as_ref().map_or_else(Vec::new, |records| relative(&records.weights[k])),
            test: apart(&own.test),
            copies: copies(specification, own),
            left_out: &left_out[k],
        };
        let outcome = transformed::run(&task, &mut surface, progress)?;
        if outcome.statistics.is_some() {
            let (validate, test) = (own.validate.as_deref(), own.test.as_deref());
            surface.evidence = evidence::of(specification, response, &outcome, &left_out[k], [Some(&own.fit), validate, test]);
            model.surfaces.push(surface);
        }
        responses.push(outcome);
    }
    let of_files = |records: &Option<Records>, rows: &Validation| match (records, rows) {
        (Some(records), Validation::Files(_)) => records.files.clone(),
        _ => Vec::new(),
    };
    let apart = [of_files(&data.validate, &specification.validation), of_files(&data.test, &specification.test)];
    let files = data.fit.files.iter().cloned().chain(apart.into_iter().flatten()).collect();
    let labels = specification.labels().into_iter().map(str::to_string).collect();
    Ok(Outcome { model, responses, files, fitted: data.fit, validation: data.validate, test: data.test, left_out, labels })
}

/// The rows of a response, with the contrasts of its blocks behind its inputs. Rows with the same values of its inputs stay together, as do the
/// groups of the specification.
fn sample(
    specification: &Specification,
    records: &Records,
    (used, blocks): (&[usize], Option<&Blocks>),
    response: usize,
    weights: Vec<f64>,
) -> Sample {
    let columns: Vec<Vec<f64>> = used.iter().map(|k| records.inputs[*k].clone()).collect();
    let groups = split::group_of(specification, records);
    let response = records.responses[response].clone();
    let mut sample = Sample { columns, response, weights, groups };
    if records.series.is_empty() {
        let firsts = sample.observed(|rows| points::firsts_of_columns(rows.response.len(), rows.inputs));
        sample.groups = split::joined(&sample.groups, &firsts);
    }
    sample.columns.extend(blocks.into_iter().flat_map(|blocks| blocks.contrasts(specification, records)));
    sample
}

/// Converts readings of periodic inputs to one period, from the lower end of the given range or from 0.
fn in_one_period(specification: &Specification, mut data: Data) -> Data {
    for (k, input) in specification.inputs.iter().enumerate() {
        let Some(period) = input.period else { continue };
        let low = input.range.map_or(0.0, |[low, _]| low);
        let every = [Some(&mut data.fit), data.validate.as_mut(), data.test.as_mut()];
        for value in every.into_iter().flatten().flat_map(|records| &mut records.inputs[k]) {
            *value = (*value - period * ((*value - low) / period).floor()).clamp(low, low + period);
        }
    }
    data
}

/// The number of rows in other files that are exact copies of fitted rows. The fit has already used these.
fn copies(specification: &Specification, data: &OfResponse<'_>) -> Vec<(&'static str, usize)> {
    let of = |key, rows: &Validation, records: &Option<Cow<'_, Records>>| match (rows, records) {
        (Validation::Files(_), Some(records)) => Some((key, records.copies_of(&data.fit))).filter(|(_, count)| *count > 0),
        _ => None,
    };
    let validate = of("validate", &specification.validation, &data.validate);
    validate.into_iter().chain(of("test", &specification.test, &data.test)).collect()
}

/// Reads the data files. `open` returns the content of the file with a name.
fn read(specification: &Specification, open: &mut dyn FnMut(&str) -> Result<Content, Faults>) -> Result<Data, Refused> {
    let mut units = Units::of(specification);
    let all = Records::read(specification, &specification.data, Rows::ToFit, &mut units, open);
    let mut apart = |rows: &Validation| match rows {
        Validation::Files(files) => Records::read(specification, files, Rows::Unseen, &mut units, open).map(Some),
        _ => Ok(None),
    };
    // All files are read before any is rejected, so that all faults are reported together.
    let (validate, test) = (apart(&specification.validation), apart(&specification.test));
    match (all, validate, test) {
        (Ok(fit), Ok(validate), Ok(test)) => Ok(Data { fit, validate, test, units }),
        (all, validate, test) => {
            let refused = [all.err(), validate.err(), test.err()].into_iter().flatten();
            Err(Refused(refused.flat_map(|Refused(faults)| faults).collect()))
        }
    }
}

/// Moves the rows of a split out of those to fit.
fn set_aside(specification: &Specification, data: Data) -> Result<Data, Refused> {
    let Data { mut fit, mut validate, mut test, units } = data;
    let set_aside = |key: &str, rows: &Validation, fit: &mut Records| -> Result<Option<Records>, Refused> {
        let Validation::Split(wanted) = rows else { return Ok(None) };
        let sides = split::split(specification, wanted, fit);
        if sides.fit.is_empty() || sides.validate.is_empty() {
            let empty = if sides.fit.is_empty() {
                "to fit"
            } else if key == "test" {
                "to test"
            } else {
                "to validate"
            };
            let what = format!("`{key}`: the split of {} rows leaves none {empty}", fit.rows());
            let fault = specification.fault(key, what);
            return Err(Faults::one(fault.help("change `share`, or declare smaller groups")).into());
        }
        let aside = fit.select(&sides.validate);
        let gaps: Vec<f64> = sides.validate.iter().map(|row| fit.place(*row)).collect();
        *fit = fit.select(&sides.fit);
        if specification.has_series() {
            fit.left_out.extend(gaps);
        }
        Ok(Some(aside))
    };
    // Test rows are removed first, so that nothing else can depend on them.
    test = set_aside("test", &specification.test, &mut fit)?.or(test);
    validate = set_aside("validate", &specification.validation, &mut fit)?.or(validate);
    Ok(Data { fit, validate, test, units })
}

/// The smallest and the largest value.
pub(crate) fn span(values: &[f64]) -> [f64; 2] {
    order::ends(values).into()
}

/// The inputs of the model. `spans`: the smallest and the largest value of each input in the fitted data. If the specification gives no range, it is
/// this one, made symmetric about 0 if a symmetry requires it.
pub(crate) fn inputs(specification: &Specification, units: &Units, spans: &[[f64; 2]]) -> Result<Vec<Input>, Faults> {
    let mut faults = Collector::new();
    let mut inputs = Vec::new();
    let mut from_data = Vec::new();
    for (k, input) in specification.inputs.iter().enumerate() {
        let [low, high] = spans[k];
        let symmetric = |response: &ResponseSpec| response.surface.symmetry.iter().any(|(name, _)| *name == input.name);
        let most = low.abs().max(high.abs());
        let found = if specification.responses.iter().any(symmetric) { [-most, most] } else { [low, high] };
        if input.range.is_none() && input.period.is_none() && found[0] >= found[1] {
            let what = format!("input `{}`: every row to fit has the value {low}", input.name);
            let fault = specification.fault(&format!("inputs.{}", input.name), what);
            faults.push(fault.help("measure at two values at least, or leave this input out"));
        }
        from_data.push(input.range.is_none().then_some(found).filter(|[low, high]| low < high));
        // + 0.0: the range starts at 0, not at -0.
        let whole_period = input.period.map(|period| [0.0, period]);
        let range = input.range.or(whole_period).unwrap_or(found).map(|bound| bound + 0.0);
        inputs.push(Input { name: input.name.clone(), unit: units.get(k).to_string(), range, outside: input.outside });
    }
    check_basis_against_ranges(specification, &from_data, &mut faults);
    faults.finish(Some(inputs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constrain::{Stop, Unproven};

    #[test]
    fn a_response_without_a_surface_says_why() {
        let one = Unproven {
            constraint: "convex".into(),
            quantity: "curvature per half range squared",
            bound: -0.5,
            share_of_spread: -0.125,
            seen: Some(0.25),
            at: Some(Named(vec![("x".into(), 2.0)])),
        };
        let why = NotProven { constraints: vec![one], stopped_by: Stop::LargestShift, shift: 1e-4, rounds: 9, work: 0.5 };
        let (verdict, contradiction) = (Verdict::NotProven(why), Verdict::Infeasible { constraints: vec!["convex".into()] });
        let object = |verdict| serde_json::to_value(NotFitted::new(verdict)).unwrap();
        let expected = serde_json::json!({
            "constraints": [{ "constraint": "convex", "quantity": "curvature per half range squared", "bound": -0.5, "share_of_spread": -0.125,
                "seen": 0.25, "at": { "x": 2.0 } }],
            "stopped_by": "largest-shift", "shift": 1e-4, "rounds": 9, "work": 0.5
        });
        assert_eq!(object(&verdict)["not_proven"], expected);
        assert_eq!(object(&verdict)["why"], verdict.to_string());
        assert_eq!(
            object(&contradiction),
            serde_json::json!({ "why": "infeasible: no coefficients of the chosen terms fulfil: convex" })
        );
        let responses = Named(vec![("y".to_string(), None)]);
        let fine = Report { model: "m", responses: responses.clone(), not_fitted: Named(vec![]), missing: Named(vec![]) };
        assert_eq!(serde_json::to_string(&fine).unwrap(), "{\"model\":\"m\",\"responses\":{\"y\":null}}");
        let not_fitted = Named(vec![("y".to_string(), NotFitted::new(&contradiction))]);
        assert_eq!(serde_json::to_value(Report { not_fitted, ..fine }).unwrap()["not_fitted"]["y"], object(&contradiction));
    }
}
