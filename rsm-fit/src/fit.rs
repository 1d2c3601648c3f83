//! The whole way from a specification to a model.
//!
//! In: a [`Specification`]. Out: an [`Outcome`]: the model, and for every response what became of it and its figures. Bad input
//! is an error with every fault; a numerical outcome (confidence not reached, columns that make each other up) is data. Never
//! writes a file.

use rsm_core::model::{Input, Model, Surface, Term};
use rsm_core::source::{Collector, Faults};

use crate::canonical;
use crate::constrain::{self, Constrained, ConstraintStatistics};
use crate::dd::Dd;
use crate::design::{self, Design};
use crate::evidence;
use crate::ladder::{Judge, Ladder, first_rung};
use crate::qr::{Compressed, Dependent, Growing, Triangle};
use crate::records::{DataFile, Records, Refused, Rows, Units};
use crate::spec::{Method, ResponseSpec, Specification, Validation, check_basis_against_ranges};
use crate::split;
use crate::statistics::{self, Named, Observations, ResponseStatistics};
use crate::support::{self, Region, SupportStatistics};

pub use crate::verdict::{JudgedOn, Verdict};

/// What a fit tells while it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress<'a> {
    /// A data file is being read.
    Reading {
        /// Its name, as the specification has it.
        file: &'a str,
    },
    /// A response is being fitted.
    Fitting {
        /// Its name.
        response: &'a str,
        /// Its place among all, from 1.
        number: usize,
        /// How many there are.
        of: usize,
    },
    /// A step of the ladder.
    Step {
        /// The response.
        response: &'a str,
        /// The order that is open.
        order: u32,
        /// Terms so far.
        terms: usize,
        /// C so far.
        confidence: f64,
    },
}

/// What became of a specification.
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
    pub unseen: Option<Records>,
}

/// What became of a response.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseOutcome {
    /// Its name.
    pub name: String,
    /// How it ended.
    pub verdict: Verdict,
    /// So many fitted rows lie outside the range of an input. They are fitted as measured.
    pub rows_outside: usize,
    /// Its figures; none when it could not be fitted.
    pub statistics: Option<ResponseStatistics>,
    /// What C was judged on.
    pub judged_on: JudgedOn,
}

impl Outcome {
    /// Whether every response was fitted and reached what was asked for.
    #[must_use]
    pub fn reached(&self) -> bool {
        self.responses.iter().all(|response| matches!(response.verdict, Verdict::Fitted | Verdict::Reached { .. }))
    }

    /// What `rsm fit --json` prints.
    #[must_use]
    pub fn report(&self) -> Report<'_> {
        let of_one = |response: &'_ ResponseOutcome| response.name.clone();
        let responses = self.responses.iter().map(|response| (of_one(response), response.statistics.as_ref())).collect();
        Report { model: &self.model.name, responses: Named(responses) }
    }
}

/// The object of DESIGN.md 5.1. A response that could not be fitted is null.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Report<'a> {
    /// The name of the model.
    pub model: &'a str,
    /// The figures of every response.
    pub responses: Named<Option<&'a ResponseStatistics>>,
}

/// Rows to fit and rows to validate.
struct Data {
    fit: Records,
    validate: Option<Records>,
    units: Units,
}

/// Fits every response of a specification.
///
/// # Errors
/// Every fault of the data files; then those that only data and specification together show.
pub fn fit(specification: &Specification, progress: &mut dyn FnMut(Progress<'_>)) -> Result<Outcome, Refused> {
    let data = read(specification, progress)?;
    let inputs = inputs(specification, &data)?;
    let mut model = Model { name: specification.model.clone(), inputs: inputs.clone(), ..Model::default() };
    let mut responses = Vec::new();
    for (k, response) in specification.responses.iter().enumerate() {
        let name = &response.surface.name;
        progress(Progress::Fitting { response: name, number: k + 1, of: specification.responses.len() });
        let used = response.surface.inputs.iter().map(|name| {
            let index = specification.inputs.iter().position(|input| input.name == *name);
            index.expect("a read specification names known inputs")
        });
        let used: Vec<usize> = used.collect();
        let mut surface = response.surface.clone();
        surface.unit = data.units.get(specification.inputs.len() + k).to_string();
        let task = Task {
            specification,
            response,
            inputs: used.iter().map(|k| inputs[*k].clone()).collect(),
            fit: columns(&data.fit, &used),
            fit_response: &data.fit.responses[k],
            fit_weights: relative(&data.fit.weights[k]),
            validate: data.validate.as_ref().map(|records| (columns(records, &used), &records.responses[k][..])),
        };
        let outcome = task.run(&mut surface, progress)?;
        if outcome.statistics.is_some() {
            surface.evidence = evidence::of(specification, response, &outcome, &data.fit, data.validate.as_ref());
            model.surfaces.push(surface);
        }
        responses.push(outcome);
    }
    let unseen = data.validate.iter().filter(|_| matches!(specification.validation, Validation::Files(_)));
    let files = data.fit.files.iter().chain(unseen.flat_map(|records| &records.files)).cloned().collect();
    Ok(Outcome { model, responses, files, fitted: data.fit, unseen: data.validate })
}

fn columns<'a>(records: &'a Records, used: &[usize]) -> Vec<&'a [f64]> {
    used.iter().map(|k| &records.inputs[*k][..]).collect()
}

fn read(specification: &Specification, progress: &mut dyn FnMut(Progress<'_>)) -> Result<Data, Refused> {
    let mut units = Units::of(specification);
    let mut reading = |file: &str| progress(Progress::Reading { file });
    let all = Records::read(specification, &specification.data, Rows::ToFit, &mut units, &mut reading);
    let mut data = match &specification.validation {
        Validation::None => Data { fit: all?, validate: None, units },
        Validation::Files(files) => {
            // Both are read before either is refused: all faults together.
            let unseen = Records::read(specification, files, Rows::Unseen, &mut units, &mut reading);
            match (all, unseen) {
                (Ok(fit), Ok(validate)) => Data { fit, validate: Some(validate), units },
                (Err(Refused(mut first)), Err(Refused(second))) => {
                    first.extend(second);
                    return Err(Refused(first));
                }
                (Err(refused), _) | (_, Err(refused)) => return Err(refused),
            }
        }
        Validation::Split(wanted) => {
            let all = all?;
            let sides = split::split(specification, wanted, &all);
            if sides.fit.is_empty() || sides.validate.is_empty() {
                let empty = if sides.fit.is_empty() { "to fit" } else { "to validate" };
                let what = format!("`validate`: the split of {} rows leaves none {empty}", all.rows());
                let fault = specification.fault("validate", what);
                return Err(Faults::one(fault.help("change `share`, or declare smaller groups")).into());
            }
            Data { fit: all.select(&sides.fit), validate: Some(all.select(&sides.validate)), units }
        }
    };
    data.fit.labels = Vec::new();
    Ok(data)
}

/// The inputs of the model. A range that the specification does not give is that of the data to fit; symmetric about 0 where a
/// symmetry asks for it.
fn inputs(specification: &Specification, data: &Data) -> Result<Vec<Input>, Faults> {
    let mut faults = Collector::new();
    let mut inputs = Vec::new();
    let mut from_data = Vec::new();
    for (k, input) in specification.inputs.iter().enumerate() {
        let values = &data.fit.inputs[k];
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let symmetric = |response: &ResponseSpec| response.surface.symmetry.iter().any(|(name, _)| *name == input.name);
        let most = low.abs().max(high.abs());
        let found = if specification.responses.iter().any(symmetric) { [-most, most] } else { [low, high] };
        if input.range.is_none() && found[0] >= found[1] {
            let what = format!("input `{}`: every row to fit has the value {low}", input.name);
            let fault = specification.fault(&format!("inputs.{}", input.name), what);
            faults.push(fault.help("measure at two values at least, or leave this input out"));
        }
        from_data.push(input.range.is_none().then_some(found).filter(|[low, high]| low < high));
        // + 0.0: a range from 0, not from -0.
        let range = input.range.unwrap_or(found).map(|bound| bound + 0.0);
        inputs.push(Input { name: input.name.clone(), unit: data.units.get(k).to_string(), range, outside: input.outside });
    }
    check_basis_against_ranges(specification, &from_data, &mut faults);
    faults.finish(Some(inputs))
}

/// Weights with a mean of 1, so that the residual standard deviation is that of a row of mean weight.
fn relative(weights: &[f64]) -> Vec<f64> {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter().map(|weight| weight / mean).collect()
}

fn terms_of(statistics: &ResponseStatistics) -> Vec<Term> {
    statistics.terms.iter().map(|term| Term { powers: term.powers.clone(), coefficient: term.coefficient }).collect()
}

/// One response with its data.
struct Task<'a> {
    specification: &'a Specification,
    response: &'a ResponseSpec,
    inputs: Vec<Input>,
    fit: Vec<&'a [f64]>,
    fit_response: &'a [f64],
    fit_weights: Vec<f64>,
    validate: Option<(Vec<&'a [f64]>, &'a [f64])>,
}

impl Task<'_> {
    fn fitted(&self) -> Observations<'_> {
        Observations { inputs: &self.fit, response: self.fit_response, weights: &self.fit_weights }
    }

    fn unseen(&self) -> Option<Observations<'_>> {
        self.validate.as_ref().map(|(inputs, response)| Observations { inputs, response, weights: &[] })
    }

    /// Fits and fills the surface's terms.
    fn run(&self, surface: &mut Surface, progress: &mut dyn FnMut(Progress<'_>)) -> Result<ResponseOutcome, Faults> {
        let terms = match &self.response.method {
            Method::Fixed(terms) => terms.clone(),
            Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => design::terms_up_to(surface, *order),
        };
        let least = match self.response.method {
            Method::Ladder { .. } => {
                let first = first_rung(&terms);
                terms.iter().filter(|powers| design::order(powers) <= first).count()
            }
            _ => terms.len(),
        };
        if self.fit_response.len() < least {
            let what =
                format!("response `{}`: at least {least} terms, but {} rows to fit", surface.name, self.fit_response.len());
            return Err(Faults::one(self.fault(what).help("fit fewer terms or measure more points")));
        }
        if let Some(wanted) = self.response.support {
            surface.support = support::of_data(surface, &self.inputs, self.fitted(), wanted);
        }
        let design = Design::new(surface, &self.inputs, terms);
        let triangle = self.rows_to_fit(&design)?;
        let judged_on = if self.validate.is_some() { JudgedOn::Validation } else { JudgedOn::FittedData };
        let chosen = match self.choose(&design, &triangle, progress)? {
            Ok(chosen) => chosen,
            Err(dependent) => return Ok(self.ill_conditioned(&design, &dependent, judged_on)),
        };
        let growing = match Growing::of(&triangle, &chosen) {
            Ok(growing) => growing,
            Err(dependent) => return Ok(self.ill_conditioned(&design, &dependent, judged_on)),
        };
        let design = Design::new(surface, &self.inputs, chosen.iter().map(|k| design.terms()[*k].clone()).collect());
        let mut statistics = self.with_validation(surface, &design, statistics::of_fit(&design, &growing, self.fitted()));
        surface.terms = terms_of(&statistics);
        if !self.response.constraints.is_empty() {
            statistics = match self.constrained(surface, &design, &growing, statistics) {
                Ok(statistics) => statistics,
                Err(verdict) => return Ok(self.without_surface(&design, verdict, judged_on)),
            };
            surface.terms = terms_of(&statistics);
        }
        statistics.canonical = canonical::analyse(surface, &self.inputs);
        statistics.support = self.support(surface);
        let verdict = self.verdict(&statistics);
        let rows_outside = self.rows_outside(&design);
        Ok(ResponseOutcome { name: surface.name.clone(), verdict, rows_outside, statistics: Some(statistics), judged_on })
    }

    fn with_validation(&self, surface: &Surface, design: &Design, mut statistics: ResponseStatistics) -> ResponseStatistics {
        let coefficients: Vec<f64> = statistics.terms.iter().map(|term| term.coefficient).collect();
        let judge = |unseen| statistics::of_validation(design, &coefficients, surface.output_range, unseen);
        statistics.validation = self.unseen().and_then(judge);
        statistics
    }

    /// The figures with constraints on the chosen terms; those that they are given where the constraints hold anyway.
    fn constrained(
        &self,
        surface: &Surface,
        design: &Design,
        problem: &Growing,
        free: ResponseStatistics,
    ) -> Result<ResponseStatistics, Verdict> {
        let constraints = &self.response.constraints;
        let low = self.fit_response.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.fit_response.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // Of a response that is everywhere the same, its magnitude; 1 for one that is 0.
        let spread = [high - low, high.abs()].into_iter().find(|spread| *spread > 0.0).unwrap_or(1.0);
        let task = constrain::Task { surface, inputs: &self.inputs, constraints, problem, spread };
        let shift = constrain::SHIFT * spread;
        let (mut statistics, told) = match task.run() {
            Constrained::Inactive { constraints } => {
                let told = ConstraintStatistics {
                    active: false,
                    constraints,
                    shift,
                    rounds: 0,
                    residual_sd_without: free.residual_sd,
                    validation_without: free.validation.clone(),
                    largest_change: None,
                };
                (free, told)
            }
            Constrained::Active { coefficients, constraints, rounds, largest_change } => {
                let statistics = statistics::of_constrained(design, &coefficients, self.fitted());
                let told = ConstraintStatistics {
                    active: true,
                    constraints,
                    shift,
                    rounds,
                    residual_sd_without: free.residual_sd,
                    validation_without: free.validation,
                    largest_change: Some(largest_change),
                };
                (self.with_validation(surface, design, statistics), told)
            }
            Constrained::Infeasible { constraints } => return Err(Verdict::Infeasible { constraints, is_certain: true }),
            Constrained::NotProven { constraints } => return Err(Verdict::Infeasible { constraints, is_certain: false }),
        };
        statistics.constraints = Some(told);
        Ok(statistics)
    }

    fn fault(&self, what: String) -> rsm_core::source::Fault {
        self.specification.fault(&format!("responses.{}", self.response.surface.name), what)
    }

    fn rows_outside(&self, design: &Design) -> usize {
        let fitted = self.fitted();
        (0..fitted.response.len()).filter(|row| !design.is_inside(&fitted.point(*row))).count()
    }

    /// How much of the box the support holds.
    fn support(&self, surface: &Surface) -> Option<SupportStatistics> {
        self.response.support?;
        let region = Region::new(surface, &self.inputs);
        let outside = |unseen: Observations<'_>| {
            let is_outside = |row: &usize| !support::holds(&surface.support, &region.coded(&unseen.point(*row)));
            (0..unseen.response.len()).filter(is_outside).count()
        };
        Some(SupportStatistics {
            half_spaces: surface.support.len(),
            share_of_box: region.share(&surface.support),
            unseen_rows_outside: self.unseen().map_or(0, outside),
        })
    }

    /// The triangle of all terms and the response on the data to fit.
    fn rows_to_fit(&self, design: &Design) -> Result<Triangle, Faults> {
        let fitted = self.fitted();
        let row = |row: usize| {
            let root = fitted.weight(row).sqrt();
            let terms = design.row_as_measured(&fitted.point(row)).into_iter().chain([Dd::from(fitted.response[row])]);
            if fitted.weights.is_empty() { terms.collect() } else { terms.map(|x| x * root).collect() }
        };
        self.triangle(design, (0..fitted.response.len()).map(row))
    }

    /// The same on the data that judge: a row a group of replicates, with the mean response and the weight sqrt(n_i).
    fn rows_to_judge(&self, design: &Design) -> Result<Triangle, Faults> {
        let unseen = self.unseen();
        let judging = unseen.unwrap_or(self.fitted());
        let row = |group: Vec<usize>| {
            let (point, weight) = (judging.point(group[0]), judging.weight_of(&group).sqrt());
            // The fitted data judge as they were fitted, unseen ones through the evaluator's eyes.
            let terms = if unseen.is_some() { design.row(&point) } else { design.row_as_measured(&point) };
            terms.into_iter().chain([judging.mean(&group)]).map(|x| x * weight).collect()
        };
        self.triangle(design, judging.replicates().into_iter().map(row))
    }

    fn triangle(&self, design: &Design, rows: impl Iterator<Item = Vec<Dd>>) -> Result<Triangle, Faults> {
        let mut compressed = Compressed::new(design.width() + 1);
        let mut finite = true;
        for row in rows {
            finite &= row.iter().all(|x| x.is_finite());
            compressed.push(row);
        }
        if !finite {
            let what = format!("response `{}`: in some row a term is not a finite number", self.response.surface.name);
            let help =
                "lower the order, use coding = \"range\", or leave out rows where an input that enters by its reciprocal is 0";
            return Err(Faults::one(self.fault(what).help(help)));
        }
        Ok(compressed.finish())
    }

    fn choose(
        &self,
        design: &Design,
        triangle: &Triangle,
        progress: &mut dyn FnMut(Progress<'_>),
    ) -> Result<Result<Vec<usize>, Dependent>, Faults> {
        let Method::Ladder { max_order, confidence } = self.response.method else {
            return Ok(Ok((0..design.width()).collect()));
        };
        let judge = Judge::new(self.rows_to_judge(design)?);
        let ladder = Ladder { fit: triangle, judge: &judge, terms: design.terms(), max_order, wanted: confidence };
        let name = &self.response.surface.name;
        let climb = ladder.climb(&mut |order, terms, confidence| {
            progress(Progress::Step { response: name, order, terms, confidence });
        });
        Ok(climb.map(|climb| climb.chosen))
    }

    fn verdict(&self, statistics: &ResponseStatistics) -> Verdict {
        let Method::Ladder { confidence: wanted, .. } = self.response.method else { return Verdict::Fitted };
        let validated = statistics.validation.as_ref().map_or(statistics.confidence_c, |validation| validation.confidence_c);
        match validated {
            Some(confidence) if confidence >= wanted => Verdict::Reached { confidence, wanted },
            best => Verdict::NotReached { best: best.unwrap_or(f64::NEG_INFINITY), wanted },
        }
    }

    fn ill_conditioned(&self, design: &Design, dependent: &Dependent, judged_on: JudgedOn) -> ResponseOutcome {
        let columns = dependent.candidates.iter().map(|k| design.name_of(*k)).collect();
        self.without_surface(design, Verdict::IllConditioned { condition: dependent.condition, columns }, judged_on)
    }

    fn without_surface(&self, design: &Design, verdict: Verdict, judged_on: JudgedOn) -> ResponseOutcome {
        ResponseOutcome {
            name: self.response.surface.name.clone(),
            verdict,
            rows_outside: self.rows_outside(design),
            statistics: None,
            judged_on,
        }
    }
}
