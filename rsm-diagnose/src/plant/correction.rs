//! A black-box correction: a response surface for the remaining error of an extended simulation, as a function of its outputs and inputs.
//!
//! In: the extended plant along training and holdout records. Out: a model file with a surface for each output whose error it reduces on holdout
//! rows, or the gain of the best surface if nothing helps. The file means `measured = simulated + surface`. It names no cause, and it is valid only
//! in the range of the records.
//!
//! The surface is static, so it cannot represent a dependence on the past, such as a resonance or a lag. The ladder of the fitter chooses terms on
//! every second training record and tests them on the records between (a single record is divided into eight parts). The coefficients are then fitted
//! to all training records. Holdout rows are used only for the final evaluation.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::{Evidence, Input, Model, Outside, Surface, Term};
use rsm_core::number::Precision;
use rsm_core::order;
use rsm_core::run::Interpreter;
use rsm_core::tape::Tape;
use rsm_fit::dd::Dd;
use rsm_fit::design::{self, Design, Physical};
use rsm_fit::ladder::{Judge, Ladder};
use rsm_fit::qr::{Compressed, Growing, Triangle};

use super::quantities::of_output;
use super::regions::{SIGNIFICANT, scatter};
use super::whitened_residuals::{Prepared, Simulated, WhitenedResiduals};
use crate::engine::columns::dot;
use rsm_sim::effect::smooth_sign;
use rsm_sim::equation_plant::{self, Body, SiteKind, SiteSignal, sign_width};
use rsm_sim::kind::PlantKind;

/// The largest number of rows in a fit. Runs of rows are averaged to this many. Double-double least squares with fifty terms and 4000 rows takes half
/// a second.
const MOST_ROWS: usize = 4000;

/// The largest number of candidate terms. The polynomial order is as high as this allows.
const MOST_TERMS: usize = 60;

/// The highest order. A polynomial of higher order oscillates between rows.
const HIGHEST_ORDER: u32 = 5;

/// The largest number of variables of a surface: with five, a polynomial of third order has fewer than [`MOST_TERMS`] terms.
const MOST_VARIABLES: usize = 5;

/// A variable of which a linear function of the others gives more than 99 % is left out.
const LEAST_INDEPENDENT: f64 = 0.01;

/// A single record is divided into this many parts to choose terms.
const PARTS: usize = 8;

/// The smallest set of terms is chosen that explains this share of what the best set explains. The rest is specific to one record.
const SHARE_OF_BEST: f64 = 0.99;

/// The number of blocks of a record for the scatter of the gain. A block is long against the memory of a residual, and ten give a standard deviation.
const BLOCKS: usize = 10;

/// The one-sided normal point for a tail of 5 %, shared by three outputs.
const ONE_SIDED_POINT: f64 = 2.13;

/// The smallest useful gain: the share of an output's error above the noise that a surface must remove.
const LEAST_GAIN: f64 = 0.02;

/// An output with its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Corrected {
    /// The output, by its place in the plant.
    pub output: usize,
    /// The surface's name.
    pub surface: String,
    /// The variables it depends on.
    pub inputs: Vec<String>,
    /// Its terms, in words.
    pub terms: Vec<String>,
    /// Root mean square error over the noise without it, on the evaluation rows.
    pub before: f64,
    /// With it.
    pub after: f64,
}

/// A correction: a model file with its gain.
#[derive(Debug, Clone)]
pub struct Correction {
    /// The model file.
    pub model: Model,
    /// The outputs that have a surface.
    pub outputs: Vec<Corrected>,
    /// The share of the extended plant's error above the noise that it removes on the evaluation rows, over all outputs in units of their noise.
    pub gain: f64,
    /// The same minus its scatter: the lower end of a one-sided 95 % interval.
    pub low: f64,
    /// Whether the gain is of holdout records. Otherwise it is of the last third of every training record, which no fit used.
    pub unseen: bool,
}

/// The result of a fit of corrections.
#[derive(Debug, Clone)]
pub enum CorrectionResult {
    /// It gains on holdout rows.
    Useful(Box<Correction>),
    /// Nothing gains on holdout rows.
    NoGain {
        /// The share of the error above the noise that the surfaces would remove; negative if they increase it.
        gain: f64,
    },
}

/// Records with the extended plant's simulation, limited to a range of rows.
struct Rows<'a> {
    prepared: &'a Prepared,
    simulated: &'a Simulated,
    variables: Vec<Variable>,
    from: usize,
    to: usize,
}

/// Records with the simulation of the extended plant along them.
#[derive(Clone, Copy)]
pub struct Simulation<'a> {
    /// The records.
    pub whitened: &'a WhitenedResiduals,
    /// The simulated outputs of each record.
    pub simulated: &'a [Simulated],
    /// The quantities at the sites along each record.
    pub signals: &'a [Vec<SiteSignal>],
}

/// Fits the correction and computes its errors. `unseen` may have no records.
#[must_use]
pub fn correction(kind: PlantKind, own: Simulation<'_>, unseen: Simulation<'_>) -> CorrectionResult {
    let has_unseen = !unseen.whitened.records.is_empty();
    let whitened = own.whitened;
    let (training, judging) = if has_unseen {
        (parts(kind, own, 0.0, 1.0), parts(kind, unseen, 0.0, 1.0))
    } else {
        (parts(kind, own, 0.0, 2.0 / 3.0), parts(kind, own, 2.0 / 3.0, 1.0))
    };
    if training.is_empty() || judging.is_empty() {
        return CorrectionResult::NoGain { gain: 0.0 };
    }
    let (training, judging) = with_common_variables(training, judging);
    let mut model = Model { name: "correction".to_string(), ..Model::default() };
    let mut outputs = Vec::new();
    let (mut won, mut variance, mut all, mut lost) = (0.0, 0.0, 0.0, 0.0);
    for output in 0..kind.outputs().len() {
        let floor = &whitened.floors[output];
        let fitted = fit(kind, output, floor.sd, &training);
        let Some(judged) = holdout_gain(output, floor.sd, fitted.as_ref(), &judging) else { continue };
        let beyond = judged.before - judged.rows as f64;
        if beyond < SIGNIFICANT * scatter(floor, judged.rows) * judged.rows as f64 {
            continue;
        }
        all += beyond;
        lost += judged.gain;
        let Some(surface) = fitted else { continue };
        if judged.gain < LEAST_GAIN * beyond || judged.gain < ONE_SIDED_POINT * judged.variance.sqrt() {
            continue;
        }
        won += judged.gain;
        variance += judged.variance;
        let mean = |square: f64| (square / judged.rows as f64).sqrt();
        outputs.push(Corrected {
            output,
            surface: surface.surface.name.clone(),
            inputs: surface.surface.inputs.clone(),
            terms: surface.terms.clone(),
            before: mean(judged.before),
            after: mean(judged.before - judged.gain),
        });
        let mut with_evidence = surface.surface.clone();
        let text = format!(
            "black box, no physics: add to the simulated {}; fitted to the residuals of the extended simulation",
            kind.outputs()[output].name
        );
        with_evidence.evidence = vec![
            ("what".to_string(), Evidence::Text(text)),
            ("rows".to_string(), Evidence::Whole(surface.rows as i64)),
            ("unseen_rows".to_string(), Evidence::Whole(judged.rows as i64)),
            ("gain_on_unseen_rows".to_string(), Evidence::Number((judged.gain / beyond).min(1.0))),
        ];
        for input in surface.inputs {
            if !model.inputs.contains(&input) {
                model.inputs.push(input);
            }
        }
        model.surfaces.push(with_evidence);
    }
    if outputs.is_empty() || all <= 0.0 {
        return CorrectionResult::NoGain { gain: if all > 0.0 { lost / all } else { 0.0 } };
    }
    // A normal variable exceeds 1.645 standard deviations with a probability of 5 %.
    let low = (won - 1.645 * variance.sqrt()) / all;
    // The remaining error may be below the estimated noise. The gain is at most 1.
    let gain = (won / all).min(1.0);
    CorrectionResult::Useful(Box::new(Correction { model, outputs, gain, low: low.min(1.0), unseen: has_unseen }))
}

/// The correction to add to the simulated output, one value for each row; `None` if the output has no surface.
#[must_use]
pub fn added(
    kind: PlantKind,
    correction: &Correction,
    prepared: &Prepared,
    simulated: &Simulated,
    signals: &[SiteSignal],
    output: usize,
) -> Option<Vec<f64>> {
    let one = correction.outputs.iter().find(|it| it.output == output)?;
    let index = correction.model.surfaces.iter().position(|it| it.name == one.surface)?;
    let checked = Checked::from_model(&correction.model).ok()?;
    let tape = lower::surface(&checked, index, Precision::F64);
    let variables = variables(kind, prepared, simulated, signals);
    let surface = &correction.model.surfaces[index];
    let columns = columns_of(&variables, &surface.inputs)?;
    let mut interpreter = Interpreter::<f64>::new(&tape);
    Some((0..prepared.record.rows()).map(|row| interpreter.eval(&at(&variables, &columns, row))).collect())
}

/// The places of variables with these names; `None` if a record lacks one.
fn columns_of(variables: &[Variable], names: &[String]) -> Option<Vec<usize>> {
    names.iter().map(|name| variables.iter().position(|it| it.name == *name)).collect()
}

fn at(variables: &[Variable], columns: &[usize], row: usize) -> Vec<f64> {
    columns.iter().map(|column| variables[*column].values[row]).collect()
}

fn parts(kind: PlantKind, of: Simulation<'_>, from: f64, to: f64) -> Vec<Rows<'_>> {
    let each = of.whitened.records.iter().zip(of.simulated).zip(of.signals);
    each.map(|((prepared, simulated), signals)| {
        let rows = prepared.record.rows() as f64;
        let variables = variables(kind, prepared, simulated, signals);
        Rows { prepared, simulated, variables, from: (from * rows) as usize, to: (to * rows) as usize }
    })
    .collect()
}

/// The records with the variables that all of them have, in one order.
fn with_common_variables<'a>(mut training: Vec<Rows<'a>>, mut judging: Vec<Rows<'a>>) -> (Vec<Rows<'a>>, Vec<Rows<'a>>) {
    let holds = |rows: &Rows<'_>, name: &str| rows.variables.iter().any(|it| it.name == name);
    let mut names: Vec<String> =
        training.first().map_or_else(Vec::new, |it| it.variables.iter().map(|it| it.name.clone()).collect());
    names.retain(|name| training.iter().chain(&judging).all(|rows| holds(rows, name)));
    for rows in training.iter_mut().chain(&mut judging) {
        rows.variables.retain(|it| names.contains(&it.name));
        rows.variables.sort_by_key(|it| names.iter().position(|name| *name == it.name));
    }
    (training, judging)
}

/// A variable on which a correction can depend.
struct Variable {
    name: String,
    unit: String,
    values: Vec<f64>,
    /// Whether the values are nearly always +1 or -1.
    is_direction: bool,
}

/// The variables of a correction along a record, from the simulation of the extended plant or from the record: outputs, the speeds of bodies that are
/// no outputs, directions of motion, inputs, and parameters with whole values that the record determines.
fn variables(kind: PlantKind, prepared: &Prepared, simulated: &Simulated, signals: &[SiteSignal]) -> Vec<Variable> {
    let record = &prepared.record;
    let mut list: Vec<Variable> = Vec::new();
    let mut add = |name: &str, unit: &str, values: Vec<f64>, is_direction: bool| {
        if values.len() == record.rows() && !list.iter().any(|it| it.name == name) {
            list.push(Variable { name: name.to_string(), unit: unit.to_string(), values, is_direction });
        }
    };
    for (k, signal) in kind.outputs().iter().enumerate() {
        if let Some(values) = of_output(prepared, simulated, k) {
            add(signal.name, signal.unit, values.to_vec(), false);
        }
    }
    let is_body = |it: &&SiteSignal| matches!(it.kind, SiteKind::Rotation | SiteKind::Translation) && it.role == "speed";
    let bodies: Vec<&SiteSignal> = signals.iter().filter(is_body).collect();
    for body in &bodies {
        let named = |name: &str| if bodies.len() == 1 { name.to_string() } else { format!("{}_{name}", body.at) };
        let speed = &body.parts[0];
        let is_output = |it: &&Body| it.at == body.at && it.speed.is_some_and(|it| kind.output(it).is_some());
        if !equation_plant::bodies(kind).iter().any(|it| is_output(&it)) {
            add(&named("speed"), &body.unit, speed.clone(), false);
        }
        let direction = speed.iter().map(|speed| smooth_sign(*speed, sign_width(body.kind))).collect();
        add(&named("direction"), "1", direction, true);
    }
    for (signal, values) in kind.inputs().iter().zip(&record.inputs) {
        add(signal.name, signal.unit, values.clone(), false);
    }
    for it in kind.decisions.iter().filter(|it| it.is_whole) {
        if let Some((column, value)) = it.column.zip(record.setting(it.parameter)) {
            add(column, "1", vec![value; record.rows()], false);
        }
    }
    list
}

/// A fitted surface.
struct Fitted {
    surface: Surface,
    inputs: Vec<Input>,
    columns: Vec<usize>,
    terms: Vec<String>,
    rows: usize,
    tape: Tape,
}

/// A row of the fit: the mean over a run of rows, and the part of the data that holds it.
struct Averaged {
    point: Vec<f64>,
    error: f64,
    part: usize,
}

fn averaged(output: usize, training: &[Rows<'_>]) -> Vec<Averaged> {
    let count: usize = training.iter().map(|it| it.to - it.from).sum();
    let stride = count.div_ceil(MOST_ROWS).max(1);
    let mut list = Vec::new();
    for (record, rows) in training.iter().enumerate() {
        let Some(k) = rows.prepared.outputs.iter().position(|it| *it == output) else { continue };
        let (measured, used) = (rows.prepared.measured(k), &rows.prepared.used[k]);
        for first in (rows.from..rows.to).step_by(stride) {
            let run = first..(first + stride).min(rows.to);
            if used[run.clone()].iter().any(|used| !used) {
                continue;
            }
            let mean = |value: &dyn Fn(usize) -> f64| run.clone().map(value).sum::<f64>() / run.len() as f64;
            list.push(Averaged {
                point: rows.variables.iter().map(|it| mean(&|row| it.values[row])).collect(),
                error: mean(&|row| measured[row] - rows.simulated[k][row]),
                part: if training.len() > 1 { record } else { PARTS * (first - rows.from) / (rows.to - rows.from).max(1) },
            });
        }
    }
    list
}

/// The columns of the variables for a surface. The first ones, the outputs, are taken in their order. Then comes the variable with the largest share
/// that no linear function of those before gives, and so on. Variables with a share of nearly 0 are left out, constant ones among them.
fn independent(rows: &[Averaged], outputs: usize) -> Vec<usize> {
    let count = rows.first().map_or(0, |row| row.point.len());
    let centred = |column: usize| -> Vec<f64> {
        let values = rows.iter().map(|row| row.point[column]);
        let mean = values.clone().sum::<f64>() / rows.len() as f64;
        values.map(|value| value - mean).collect()
    };
    let energy = |values: &[f64]| dot(values, values);
    let mut left: Vec<(usize, f64, Vec<f64>)> = (0..count)
        .map(|column| {
            let values = centred(column);
            let largest = rows.iter().fold(0.0_f64, |most, row| most.max(row.point[column].abs()));
            // A variation below the accuracy of a simulation counts as none.
            let least = (1e-6 * largest).powi(2) * rows.len() as f64;
            (column, energy(&values).max(least), values)
        })
        .collect();
    let mut chosen = Vec::new();
    while chosen.len() < MOST_VARIABLES {
        let share = |it: &(usize, f64, Vec<f64>)| energy(&it.2) / it.1;
        left.retain(|it| share(it) > LEAST_INDEPENDENT);
        let output = left.iter().position(|it| it.0 < outputs);
        let by_share = (0..left.len()).max_by(|a, b| share(&left[*a]).total_cmp(&share(&left[*b])));
        let Some(next) = output.or(by_share) else { break };
        let (column, _, values) = left.remove(next);
        let whole = energy(&values);
        for it in &mut left {
            let factor = dot(&it.2, &values) / whole;
            it.2.iter_mut().zip(&values).for_each(|(own, value)| *own -= factor * value);
        }
        chosen.push(column);
    }
    chosen
}

/// The surface of an output over the variables that vary, if one is found that holds on all parts of the training records.
fn fit(kind: PlantKind, output: usize, sd: f64, training: &[Rows<'_>]) -> Option<Fitted> {
    let rows = averaged(output, training);
    let variables = &training.first()?.variables;
    let columns = independent(&rows, variables.iter().filter(|it| kind.output(&it.name).is_some()).count());
    let input = |column: &usize| {
        let values = rows.iter().map(|row| row.point[*column]);
        let (low, high) = order::ends(values);
        let of = &variables[*column];
        Input { name: of.name.clone(), unit: of.unit.clone(), range: [low, high], outside: Outside::Clamp }
    };
    let inputs: Vec<Input> = columns.iter().map(input).collect();
    let mut surface = Surface { inputs: inputs.iter().map(|input| input.name.clone()).collect(), ..Surface::default() };
    // A direction is +1 or -1: its square is a constant.
    let is_linear = |k: usize| variables[columns[k]].is_direction;
    let candidates = |order: u32| {
        let mut terms = design::terms_up_to(&surface, order);
        terms.retain(|powers| (0..powers.len()).all(|k| !is_linear(k) || powers[k] <= 1));
        terms
    };
    let max_order = (1..=HIGHEST_ORDER).rev().find(|order| candidates(*order).len() <= MOST_TERMS)?;
    let terms = candidates(max_order);
    if inputs.is_empty() || rows.len() < 4 * terms.len() {
        return None;
    }
    let design = Design::new(&surface, &inputs, terms.clone());
    let triangle = |chosen: &dyn Fn(usize) -> bool| -> Triangle {
        let mut compressed = Compressed::new(terms.len() + 1);
        for row in rows.iter().filter(|row| chosen(row.part)) {
            let point: Vec<Physical> = columns.iter().map(|column| Physical(row.point[*column])).collect();
            compressed.push(design.row_as_measured(&point).into_iter().chain([Dd::from(row.error / sd)]));
        }
        compressed.finish()
    };
    let (even, odd) = (triangle(&|part| part % 2 == 0), triangle(&|part| part % 2 == 1));
    let judge = Judge::new(odd);
    // No set of terms is good enough at first, so the ladder continues while the gain on the other parts grows. C is the explained share of the
    // squares. If it is below 0, no surface is better.
    let climb = |wanted: f64| {
        let ladder = Ladder::new(&even, &judge, &terms, max_order, wanted);
        ladder.climb(&mut |_, _, _| {}).ok().filter(|climb| climb.confidence > 0.0)
    };
    let climb = climb(SHARE_OF_BEST * climb(100.0)?.confidence)?;
    let whole = triangle(&|_| true);
    let coefficients = Growing::of(&whole, &climb.chosen).ok()?.coefficients();
    // An input that no chosen term contains is removed.
    let kept: Vec<usize> = (0..inputs.len()).filter(|k| climb.chosen.iter().any(|term| terms[*term][*k] > 0)).collect();
    if kept.is_empty() {
        return None;
    }
    let cut = |powers: &[u32]| kept.iter().map(|k| powers[*k]).collect::<Vec<u32>>();
    surface.inputs = kept.iter().map(|k| inputs[*k].name.clone()).collect();
    let inputs: Vec<Input> = kept.iter().map(|k| inputs[*k].clone()).collect();
    let columns: Vec<usize> = kept.iter().map(|k| columns[*k]).collect();
    surface.terms = climb
        .chosen
        .iter()
        .zip(&coefficients)
        .map(|(term, coefficient)| Term { powers: cut(&terms[*term]), coefficient: coefficient.to_f64() * sd })
        .collect();
    let signal = kind.outputs()[output];
    surface.name = format!("{}_correction", signal.name);
    surface.unit = signal.unit.to_string();
    let terms = surface.terms.iter().map(|term| surface.term_name(&term.powers)).collect();
    let model =
        Model { name: "correction".to_string(), inputs: inputs.clone(), surfaces: vec![surface.clone()], ..Model::default() };
    let checked = Checked::from_model(&model).ok()?;
    let tape = lower::surface(&checked, 0, Precision::F64);
    Some(Fitted { surface, inputs, columns, terms, rows: rows.len(), tape })
}

/// The result of a surface on rows that its fit did not use, in squared standard deviations of the noise.
struct HoldoutGain {
    rows: usize,
    before: f64,
    gain: f64,
    /// The variance of the gain, from its scatter over blocks.
    variance: f64,
}

fn holdout_gain(output: usize, sd: f64, fitted: Option<&Fitted>, judging: &[Rows<'_>]) -> Option<HoldoutGain> {
    let mut interpreter = fitted.map(|it| (Interpreter::<f64>::new(&it.tape), &it.columns));
    let (mut rows, mut before) = (0, 0.0);
    let mut blocks = Vec::new();
    for it in judging {
        let Some(k) = it.prepared.outputs.iter().position(|found| *found == output) else { continue };
        let (measured, used) = (it.prepared.measured(k), &it.prepared.used[k]);
        let mut sums = [(0.0, 0.0); BLOCKS];
        for row in (it.from..it.to).filter(|row| used[*row]) {
            let error = (measured[row] - it.simulated[k][row]) / sd;
            rows += 1;
            before += error * error;
            if let Some((interpreter, columns)) = &mut interpreter {
                let left = error - interpreter.eval(&at(&it.variables, columns, row)) / sd;
                let sum: &mut (f64, f64) = &mut sums[BLOCKS * (row - it.from) / (it.to - it.from)];
                *sum = (sum.0 + error * error, sum.1 + error * error - left * left);
            }
        }
        blocks.extend(sums);
    }
    if rows == 0 {
        return None;
    }
    let gain = blocks.iter().map(|it| it.1).sum::<f64>();
    // A ratio of sums over blocks (W. G. Cochran, Sampling Techniques, 1977, 6.4). Blocks differ in their amount of error; that does not change the
    // removed share.
    let share = if before > 0.0 { gain / before } else { 0.0 };
    let count = blocks.len() as f64;
    let variance = blocks.iter().map(|(error, gain)| (gain - share * error).powi(2)).sum::<f64>() * count / (count - 1.0);
    Some(HoldoutGain { rows, before, gain, variance })
}
