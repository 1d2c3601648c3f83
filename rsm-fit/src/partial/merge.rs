//! The fit of all parts from their sums.
//!
//! In: parts of one specification. Out: [`Merged`]: the model and the figures that need no rows, or every reason why the parts do not belong
//! together. Parts are sorted by the names of their data files and by their hash before anything is summed, so their order does not count.

use rsm_core::model::{Evidence, Input, Model, Surface};
use rsm_core::source::{Collector, Fault, Faults};
use serde::Serialize;

use super::bound::{self, Work};
use super::{Part, Sums, design_of, file, plain};
use crate::analysis;
use crate::canonical;
use crate::constrain::{self, Constrained, ConstraintStatistics};
use crate::dd::Dd;
use crate::design::{self, Design};
use crate::evidence;
use crate::fit::{self, Outcome, Report};
use crate::hash::hash;
use crate::left_out::{self, LeftOut};
use crate::observations::Named;
use crate::outcome::ResponseOutcome;
use crate::qr::table::reductions;
use crate::qr::{Dependent, Growing, Triangle};
use crate::records::{Records, Units};
use crate::response::{LEAST_FOR_SEARCH, terms_of};
use crate::search::{Found, Searcher};
use crate::selection::{ChosenBy, Sample};
use crate::spec::{Method, ResponseSpec, Specification, TransformSpec};
use crate::statistics::{self, ResponseStatistics, RowsUsed, TransformReport, Warning};
use crate::transformed;
use crate::verdict::Verdict;
use crate::warnings;

/// The figures of a fit that a merge does not have, by their names in `rsm fit --json`, and the tests behind warnings.
const NEED_ROWS: [&str; 15] = [
    "r2_predicted",
    "press",
    "confidence_c",
    "lack_of_fit",
    "cross_validation",
    "serial",
    "analysis.durbin_watson",
    "analysis.influential",
    "analysis.box_cox",
    "warnings.lack-of-fit",
    "warnings.outliers",
    "warnings.correlated-residuals",
    "warnings.output-bound",
    "warnings.bounds-off-data",
    "report",
];

/// The fit of all parts.
#[derive(Debug)]
pub struct Merged {
    /// The model, and the outcome and figures of every response. The records have no rows.
    pub outcome: Outcome,
    /// What is particular to a merge.
    pub merge: MergeReport,
}

/// What is particular to a merge, for `rsm merge --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MergeReport {
    /// The number of parts.
    pub parts: usize,
    /// Figures that need rows, which the parts do not hold.
    pub needs_rows: Vec<&'static str>,
    /// For each response and term, in the unit of the response: the coefficient of one fit of all rows differs by at most this. Null without
    /// coefficients of least squares, and if columns are too nearly dependent.
    pub largest_difference: Named<Option<Vec<f64>>>,
}

/// What `rsm merge --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MergedReport<'a> {
    /// The object of `rsm fit --json`.
    #[serde(flatten)]
    pub fit: Report<'a>,
    /// What is particular to a merge.
    pub merged: &'a MergeReport,
}

impl Merged {
    /// What `rsm merge --json` prints.
    #[must_use]
    pub fn report(&self) -> MergedReport<'_> {
        MergedReport { fit: self.outcome.report(), merged: &self.merge }
    }
}

/// Fits the rows of all parts.
///
/// # Errors
/// Parts of different specifications or units, a part or a data file that is there twice; what only the data of all parts show, as for
/// [`fit::fit`].
///
/// # Panics
/// If there is no part.
pub fn merge(parts: Vec<Part>) -> Result<Merged, Faults> {
    let parts = sorted(parts)?;
    let first = &parts[0];
    let specification = &first.specification;
    let left_out: Vec<Vec<LeftOut>> = (0..specification.responses.len()).map(|k| left_out_of(&parts, k)).collect();
    let mut faults = Collector::new();
    for (k, response) in specification.responses.iter().enumerate() {
        faults_of_rows(specification, response, rows_of(&parts, k), &left_out[k])
            .into_iter()
            .for_each(|fault| faults.push(fault));
    }
    faults.finish(Some(()))?;
    let spans: Vec<[f64; 2]> =
        (0..specification.inputs.len()).map(|k| joined(&mut parts.iter().map(|part| part.spans[k]))).collect();
    let inputs = fit::inputs(specification, &Units::known(first.units.clone()), &spans)?;
    let files = parts.iter().flat_map(|part| part.files.iter().cloned()).collect();
    let records = Records { files, ..Records::default() };
    let mut model = Model { name: specification.model.clone(), inputs: inputs.clone(), ..Model::default() };
    let (mut responses, mut differences) = (Vec::new(), Vec::new());
    for (k, response) in specification.responses.iter().enumerate() {
        let sums: Vec<&Sums> = parts.iter().map(|part| &part.sums[k]).collect();
        let of_terms = match response.transform {
            Some(TransformSpec::Given(transform)) => transformed::of_terms(transform, response),
            _ => response.clone(),
        };
        let (used, design) = design_of(specification, &of_terms, &inputs);
        let task = Task {
            specification,
            response: &of_terms,
            inputs: used,
            design,
            parts: parts.len(),
            span: joined(&mut sums.iter().map(|sums| sums.span)),
            rows_outside: sums.iter().map(|sums| sums.rows_outside).sum(),
            left_out: &left_out[k],
            all: All::of(&sums, &parts),
        };
        let mut surface = of_terms.surface.clone();
        surface.unit = first.units[specification.inputs.len() + k].clone();
        let (mut outcome, difference) = task.run(&mut surface)?;
        transformed::finish(specification, [response, &of_terms], &task.inputs, &mut surface, &mut outcome)?;
        if outcome.statistics.is_some() {
            let mut evidence = evidence::of(specification, response, &outcome, &left_out[k], [Some(&records), None, None]);
            let place = evidence.iter().position(|(name, _)| name == "specification").unwrap_or(evidence.len());
            let count = Evidence::Whole(i64::try_from(parts.len()).unwrap_or(i64::MAX));
            evidence.insert(place, ("parts".to_string(), count));
            surface.evidence = evidence;
            model.surfaces.push(surface);
        }
        differences.push((outcome.name.clone(), difference));
        responses.push(outcome);
    }
    let files = records.files.clone();
    let outcome =
        Outcome { model, responses, files, fitted: records, validation: None, test: None, left_out, labels: Vec::new() };
    let merge = MergeReport { parts: parts.len(), needs_rows: NEED_ROWS.to_vec(), largest_difference: Named(differences) };
    Ok(Merged { outcome, merge })
}

/// The parts as one part, for a merge in several steps: parts of machines, then of sites.
///
/// # Errors
/// Those of [`merge`] about parts that do not belong together.
///
/// # Panics
/// If there is no part.
pub fn combine(parts: Vec<Part>) -> Result<Part, Faults> {
    let parts = sorted(parts)?;
    let first = &parts[0];
    let specification = first.specification.clone();
    let of_response = |k: usize| {
        let sums: Vec<&Sums> = parts.iter().map(|part| &part.sums[k]).collect();
        let triangles: Vec<&Triangle> = sums.iter().map(|sums| &sums.triangle).collect();
        let triangle = Triangle::stacked(&triangles);
        let columns = triangle.columns().iter().map(|column| column.iter().copied().map(plain).collect()).collect();
        let weights = sums.iter().filter_map(|sums| sums.weights);
        let weights = weights.reduce(|[weight, logs], [more, further]| [plain(weight + more), plain(logs + further)]);
        Sums {
            triangle: Triangle::of_columns(columns, triangle.rows()),
            span: joined(&mut sums.iter().map(|sums| sums.span)),
            rows_outside: sums.iter().map(|sums| sums.rows_outside).sum(),
            left_out: sums.iter().map(|sums| sums.left_out).sum(),
            cells: sums.iter().flat_map(|sums| sums.cells.iter().cloned()).collect(),
            weights,
        }
    };
    let part = Part {
        name: String::new(),
        files: parts.iter().flat_map(|part| part.files.iter().cloned()).collect(),
        units: first.units.clone(),
        spans: (0..specification.inputs.len()).map(|k| joined(&mut parts.iter().map(|part| part.spans[k]))).collect(),
        sums: (0..specification.responses.len()).map(of_response).collect(),
        specification,
        sha256: String::new(),
    };
    let sha256 = hash(&file::body(&part));
    Ok(Part { sha256, ..part })
}

fn joined(spans: &mut dyn Iterator<Item = [f64; 2]>) -> [f64; 2] {
    spans.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], span| [low.min(span[0]), high.max(span[1])])
}

/// The parts in an order that does not depend on the caller, if they belong together.
fn sorted(mut parts: Vec<Part>) -> Result<Vec<Part>, Faults> {
    belong_together(&parts)?;
    let names = |part: &Part| part.files.iter().map(|file| file.name.clone()).collect::<Vec<String>>();
    parts.sort_by(|a, b| names(a).cmp(&names(b)).then(a.sha256.cmp(&b.sha256)));
    Ok(parts)
}

/// Checks that the parts have one specification and one set of units, and that no rows are there twice.
fn belong_together(parts: &[Part]) -> Result<(), Faults> {
    let mut faults = Collector::new();
    let first = parts.first().expect("a merge has a part");
    let text = |part: &Part| part.specification.source().map_or("", |source| source.text()).to_string();
    for (k, part) in parts.iter().enumerate().skip(1) {
        let fault = |what: String| Fault::whole_file(&part.name, what);
        if let Some(same) = parts[..k].iter().find(|other| other.sha256 == part.sha256) {
            let what = format!("is the same part as {}", same.name);
            faults.push(fault(what).help("name each part once: its rows would count twice"));
            continue;
        }
        for file in &part.files {
            let is_same = |other: &&Part| other.files.iter().any(|known| known.sha256 == file.sha256);
            if let Some(same) = parts[..k].iter().find(is_same) {
                let what = format!("its data file `{}` is in {} too", file.name, same.name);
                faults.push(fault(what).help("a row must be in one part only: its weight would be twice that of the others"));
            }
        }
        if text(part) != text(first) {
            let what = format!("has another specification than {}: {}", first.name, difference(&text(part), &text(first)));
            let help = "make all parts with one specification; `--data` names the files of a shard";
            faults.push(fault(what).help(help));
            continue;
        }
        let names = first.specification.inputs.iter().map(|input| ("input", &input.name, "inputs"));
        let responses = first.specification.responses.iter().map(|it| ("response", &it.surface.name, "responses"));
        for (place, (what, name, section)) in names.chain(responses).enumerate() {
            let (own, other) = (&part.units[place], &first.units[place]);
            if own != other {
                let what = format!("{what} `{name}` is in `{own}`, in {} it is in `{other}`", first.name);
                let help = format!("give `unit` under [{section}.{name}] of the specification: the data are then converted");
                faults.push(fault(what).help(help));
            }
        }
    }
    faults.finish(Some(()))
}

/// The first line in which two texts differ.
fn difference(own: &str, other: &str) -> String {
    let (mut own, mut other) = (own.lines(), other.lines());
    let mut line = 1;
    loop {
        match (own.next(), other.next()) {
            (Some(a), Some(b)) if a == b => line += 1,
            (Some(a), Some(b)) => return format!("line {line} is `{a}`, there it is `{b}`"),
            (Some(a), None) => return format!("line {line} is `{a}`, there it is missing"),
            (None, Some(b)) => return format!("line {line} is missing, there it is `{b}`"),
            (None, None) => return "the ends of their lines differ".to_string(),
        }
    }
}

fn rows_of(parts: &[Part], k: usize) -> usize {
    parts.iter().map(|part| part.sums[k].triangle.rows()).sum()
}

fn left_out_of(parts: &[Part], k: usize) -> Vec<LeftOut> {
    let rows: usize = parts.iter().map(|part| part.sums[k].left_out).sum();
    let cells = parts.iter().flat_map(|part| part.sums[k].cells.iter().cloned()).collect();
    let all = LeftOut { key: "data", rows, of: rows + rows_of(parts, k), cells };
    if rows > 0 { vec![all] } else { Vec::new() }
}

/// The fault of too few rows, as in a fit.
fn faults_of_rows(specification: &Specification, response: &ResponseSpec, rows: usize, left_out: &[LeftOut]) -> Option<Fault> {
    let name = &response.surface.name;
    let (least, what) = match &response.method {
        Method::Search(_) => (LEAST_FOR_SEARCH, format!("a search of terms needs at least {LEAST_FOR_SEARCH}")),
        Method::Fixed(terms) => (terms.len(), format!("expected at least {}, one for each term", terms.len())),
        Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => {
            let terms = design::terms_up_to(&response.surface, *order).len();
            (terms, format!("expected at least {terms}, one for each term"))
        }
    };
    let missing: String = left_out.iter().map(|one| format!("; {}", one.words())).collect();
    (rows < least).then(|| {
        let what = format!("response `{name}`: found {rows} rows to fit, {what}");
        let fault = specification.fault(&format!("responses.{name}"), what);
        fault.help(format!("fit fewer terms or measure more points{missing}"))
    })
}

/// The sums of all parts of one response, with weights of mean 1.
struct All {
    triangle: Triangle,
    /// The sum of the logarithms of the weights.
    logs: f64,
    /// The number of reductions of the parts and of the merge.
    reductions: usize,
}

impl All {
    fn of(sums: &[&Sums], parts: &[Part]) -> Self {
        let triangles: Vec<&Triangle> = sums.iter().map(|sums| &sums.triangle).collect();
        let triangle = Triangle::stacked(&triangles);
        let reductions = triangles.iter().map(|triangle| reductions(triangle.rows())).sum::<usize>() + 1;
        // A part of several files may be combined of as many parts, in as many steps.
        let files = parts.iter().map(|part| part.files.len()).filter(|files| *files > 1);
        let reductions = reductions + 2 * files.sum::<usize>();
        let totals = sums.iter().filter_map(|sums| sums.weights);
        let total = totals.reduce(|[weight, logs], [more, further]| [weight + more, logs + further]);
        match total {
            Some([weight, logs]) if triangle.rows() > 0 => {
                let rows = Dd::from(triangle.rows() as f64);
                let mean = weight / rows;
                let logs = logs.to_f64() - rows.to_f64() * mean.to_f64().ln();
                All { triangle: triangle.times(Dd::ONE / mean.sqrt()), logs, reductions }
            }
            _ => All { triangle, logs: 0.0, reductions },
        }
    }
}

/// One response with the sums of all parts.
struct Task<'a> {
    specification: &'a Specification,
    response: &'a ResponseSpec,
    inputs: Vec<Input>,
    /// All candidates.
    design: Design,
    parts: usize,
    /// The smallest and the largest response.
    span: [f64; 2],
    rows_outside: usize,
    left_out: &'a [LeftOut],
    all: All,
}

impl Task<'_> {
    fn run(&self, surface: &mut Surface) -> Result<(ResponseOutcome, Option<Vec<f64>>), Faults> {
        let triangle = &self.all.triangle;
        let found = self.search()?;
        let chosen = found.as_ref().map_or_else(|| (0..self.design.width()).collect(), |found| found.terms.clone());
        let chosen_by = found.as_ref().map_or(ChosenBy::Nobody, |found| found.by);
        let growing = match Growing::of(triangle, &chosen) {
            Ok(growing) => growing,
            Err(dependent) => return Ok((self.ill_conditioned(&dependent), None)),
        };
        // Numbered as in the triangle.
        let solved = Solved { triangle: Self::only(triangle, &chosen), growing, chosen };
        let design = self.design.only(&solved.chosen);
        let shrunk = found.as_ref().and_then(|found| found.shrunk.as_deref());
        let mut statistics = statistics::of_triangle(&design, &solved.growing, &solved.triangle, shrunk);
        let coefficients =
            |statistics: &ResponseStatistics| -> Vec<f64> { statistics.terms.iter().map(|term| term.coefficient).collect() };
        surface.terms = terms_of(&statistics);
        if !self.response.constraints.is_empty() {
            statistics = match self.constrained(surface, &design, &solved, statistics) {
                Ok(statistics) => statistics,
                Err(verdict) => return Ok((self.without_surface(verdict), None)),
            };
            surface.terms = terms_of(&statistics);
        }
        let is_held = statistics.constraints.as_ref().is_some_and(|constraints| constraints.active);
        statistics.canonical = canonical::analyse(surface, &self.inputs);
        let mut difference = None;
        if shrunk.is_none() && !is_held {
            let places: Vec<usize> = (0..solved.chosen.len()).collect();
            statistics.analysis = analysis::report_of_triangle(&design, &solved.triangle, &places, self.all.logs);
            let rows = triangle.rows();
            let work =
                Work { rows, reductions: self.all.reductions + reductions(rows), is_weighted: self.response.weights.is_some() };
            difference = bound::of(&solved.triangle, &solved.growing, &coefficients(&statistics), &work);
        }
        statistics.transform = surface.transform.map(|transform| TransformReport::given(transform, None));
        statistics.selection = found.and_then(|found| found.report);
        statistics.rows_used = self.rows_used(chosen_by, triangle.rows());
        statistics.warnings = self.warnings(&statistics, chosen_by);
        let outcome = ResponseOutcome {
            name: surface.name.clone(),
            verdict: Verdict::Fitted,
            rows_outside: self.rows_outside,
            statistics: Some(statistics),
            chosen_by,
        };
        Ok((outcome, difference))
    }

    /// The choice of terms by AICc; `None` if they are given.
    fn search(&self) -> Result<Option<Found>, Faults> {
        let Method::Search(_) = self.response.method else { return Ok(None) };
        // Rows are not needed: their sums choose.
        let nothing = Sample::default();
        let searcher = Searcher {
            least_squares_only: !self.response.constraints.is_empty(),
            ..Searcher::of(&self.design, &self.response.method, &self.response.surface, &nothing)
        };
        let found = searcher.choose_by_triangle(&self.all.triangle);
        found.map(Some).ok_or_else(|| {
            let name = &self.response.surface.name;
            let what = format!("response `{name}`: there are too few rows to choose terms");
            let fault = self.specification.fault(&format!("responses.{name}"), what);
            Faults::one(fault.help("measure more points, or give terms with method \"fixed\""))
        })
    }

    /// The triangle with only some of the candidates.
    fn only(triangle: &Triangle, chosen: &[usize]) -> Triangle {
        let columns = chosen.iter().chain([&triangle.width()]).map(|k| triangle.columns()[*k].clone()).collect();
        Triangle::of_columns(columns, triangle.rows())
    }

    fn constrained(
        &self,
        surface: &Surface,
        design: &Design,
        solved: &Solved,
        free: ResponseStatistics,
    ) -> Result<ResponseStatistics, Verdict> {
        let [low, high] = self.span;
        // For a constant response its magnitude, or 1 if that is 0, as in a fit.
        let spread = [high - low, high.abs()].into_iter().find(|spread| *spread > 0.0).unwrap_or(1.0);
        let constraints = &self.response.constraints;
        let places: Vec<usize> = (0..solved.chosen.len()).collect();
        let problem = &solved.growing;
        let task = constrain::Task { surface, inputs: &self.inputs, constraints, problem, places: &places, spread };
        let residual_sd_without = free.residual_sd;
        let told = |active, constraints, shift, rounds, largest_change| ConstraintStatistics {
            active,
            constraints,
            shift,
            rounds,
            residual_sd_without,
            validation_without: None,
            largest_change,
        };
        let (statistics, told) = match task.run() {
            Constrained::Inactive { constraints } => (free, told(false, constraints, constrain::SHIFT * spread, 0, None)),
            Constrained::Active { coefficients, constraints, rounds, shift, largest_change } => {
                let held = statistics::of_triangle(design, &solved.growing, &solved.triangle, Some(&coefficients));
                (held, told(true, constraints, shift * spread, rounds, Some(largest_change)))
            }
            Constrained::Infeasible { constraints } => return Err(Verdict::Infeasible { constraints }),
            Constrained::NotProven(why) => return Err(Verdict::NotProven(why)),
        };
        Ok(ResponseStatistics { constraints: Some(told), ..statistics })
    }

    fn rows_used(&self, chosen_by: ChosenBy, rows: usize) -> RowsUsed {
        let terms = match chosen_by {
            ChosenBy::Formula(name) => format!("the fitted rows themselves, by {name}"),
            _ => "none: the terms were given".to_string(),
        };
        RowsUsed {
            coefficients: format!("{rows} rows in {} parts", self.parts),
            terms,
            validation: "none".to_string(),
            error: "none: the parts hold sums, and no row can be left out of them".to_string(),
        }
    }

    fn warnings(&self, statistics: &ResponseStatistics, chosen_by: ChosenBy) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let has_spread = self.span[0] < self.span[1];
        if let Some(what) = statistics.r2.filter(|_| has_spread).and_then(|r2| warnings::explains_little(r2, "the fitted rows"))
        {
            warnings.push(Warning { kind: "explains-little", what });
        }
        if chosen_by != ChosenBy::Nobody {
            warnings.push(warnings::not_judged(&statistics.rows_used));
        }
        warnings.extend(left_out::warning(self.left_out));
        warnings
    }

    fn ill_conditioned(&self, dependent: &Dependent) -> ResponseOutcome {
        let columns = dependent.candidates.iter().map(|k| self.design.name_of(*k)).collect();
        self.without_surface(Verdict::IllConditioned { condition: dependent.condition, columns })
    }

    fn without_surface(&self, verdict: Verdict) -> ResponseOutcome {
        let name = self.response.surface.name.clone();
        let chosen_by = match self.response.method {
            Method::Search(_) => ChosenBy::FittedRows,
            _ => ChosenBy::Nobody,
        };
        ResponseOutcome { name, verdict, rows_outside: self.rows_outside, statistics: None, chosen_by }
    }
}

/// The solution with the chosen candidates.
struct Solved {
    triangle: Triangle,
    growing: Growing,
    chosen: Vec<usize>,
}
