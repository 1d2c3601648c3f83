//! The extended surface: the model file with the causes, and the offsets that a model file cannot represent.
//!
//! In: a sample, its explanation and the estimates. Out: [`Extension`]: a surface and its inputs, for readings as in the new data, and offsets
//! (drift, blocks) that a model file cannot contain. Coding, symmetry, reciprocals, knots and support stay the same. A correction of an input's
//! sensor is applied to powers and knots by exact expansion. Never changes another surface.

use std::collections::BTreeMap;

use rsm_core::basis::{Shape, Variable};
use rsm_core::model::{Coding, Evidence, Input, Outside, Surface, Term};

use super::estimate::Estimates;
use super::explained::{Explained, calibration};
use super::hypotheses::{HypothesisKind, Monomial, bias_fits_file};
use super::sample::Sample;
use rsm_fit::design::{Design, Physical};

/// The effect of a cause that a surface cannot represent.
#[derive(Debug, Clone, PartialEq)]
pub enum Offset {
    /// Proportional to the run order or to a column.
    Drift {
        /// The change over the span.
        amount: f64,
        /// The place where it is zero.
        from: f64,
        /// The length of the span, in the same unit.
        span: f64,
        /// The column; `None` for the run order.
        column: Option<String>,
    },
    /// A different value before some run and from that run on.
    Step {
        /// The first place after the change.
        at: usize,
        /// The values before and after.
        values: [f64; 2],
    },
    /// One offset for each level of a column.
    Block {
        /// The column.
        column: String,
        /// Each level with its offset.
        levels: Vec<(String, f64)>,
    },
}

/// The extension of one surface.
#[derive(Debug, Clone)]
pub struct Extension {
    /// The surface, with new inputs at the end.
    pub surface: Surface,
    /// Its inputs, in its order.
    pub inputs: Vec<Input>,
    /// The names of the data columns of the new inputs, in their order.
    pub columns: Vec<String>,
    /// The effects that no file can contain.
    pub offsets: Vec<Offset>,
    /// Causes that could not be written, with the reason, and other notes for the reader of the file.
    pub notes: Vec<String>,
}

/// A column's name as an input name of a model file: letters, digits and `_`.
fn identifier(name: &str, taken: &[Input]) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let starts = plain.chars().next().is_some_and(|c| c.is_ascii_alphabetic());
    let mut found = if starts { plain } else { format!("input_{plain}") };
    while rsm_core::names::refuse(&found).is_some() || taken.iter().any(|input| input.name.eq_ignore_ascii_case(&found)) {
        found.push_str("_2");
        if found.len() > 200 {
            break; // refused by the check of the file, with a message
        }
    }
    found
}

/// The extension.
pub(super) fn extend(sample: &Sample, found: &Explained, estimates: &Estimates, taken: &[Input]) -> Extension {
    let mut notes = Vec::new();
    let mut offsets = Vec::new();
    let mut surface = sample.surface.clone();
    let sensors = sensors(sample, found, estimates, &mut notes);
    let mut sums = moved_terms(sample, &mut surface, &sensors);
    for (it, numbers) in found.set.iter().zip(&estimates.causes) {
        if it.kind == HypothesisKind::ResponseGain {
            // gain - 1, for the polynomial after the corrections of input sensors.
            let gain = 1.0 + numbers.values[0];
            sums.values_mut().for_each(|value| *value *= gain);
        }
    }
    for (it, numbers) in found.set.iter().zip(&estimates.causes) {
        match &it.kind {
            HypothesisKind::Drift(clock) => offsets.push(drift(sample, *clock, &it.columns[0], numbers.values[0])),
            HypothesisKind::Step(at) => {
                let value = numbers.values[0];
                let before = it.columns[0][0] * value;
                offsets.push(Offset::Step { at: sample.places[*at], values: [before, before + value] });
            }
            HypothesisKind::Block(extra) => {
                let extra = &sample.extras[*extra];
                let (names, of) = extra.levels.as_ref().expect("a block has levels");
                let mut values = numbers.values.iter();
                let levels = (0..names.len()).filter(|level| of.contains(level)).map(|level| {
                    let value = if it.reference == Some(level) { 0.0 } else { *values.next().unwrap_or(&0.0) };
                    (names[level].clone(), value)
                });
                offsets.push(Offset::Block { column: extra.name.clone(), levels: levels.collect() });
            }
            HypothesisKind::ResponseGain | HypothesisKind::InputGain(_) | HypothesisKind::InputBias(_) => {}
            _ => {
                for (parts, value) in it.in_file.iter().zip(&numbers.values) {
                    if parts.is_empty() {
                        notes.push(format!(
                            "the model file cannot represent {}: the surface is odd in an input that this term does not contain",
                            it.kind.label(sample)
                        ));
                    }
                    for (factor, monomial) in parts {
                        *sums.entry(monomial.clone()).or_insert(0.0) += factor * value;
                    }
                }
            }
        }
    }
    let space = found.space(sample);
    let mut before = sample.nominal.clone();
    for (column, value) in found.set.iter().flat_map(|it| &it.columns).zip(estimates.causes.iter().flat_map(|it| &it.values)) {
        before.iter_mut().zip(column).for_each(|(f, x)| *f += value * x);
    }
    for (term, amount) in sample.surface.terms.iter().zip(calibration(sample, &space, &before)) {
        *sums.entry(Monomial { powers: term.powers.clone(), extra: None }).or_insert(0.0) += amount;
    }
    if !offsets.is_empty() {
        notes.push("drift, steps and offsets of blocks belong to the experiment: the model file does not contain them".into());
    }
    let (inputs, columns) = write(sample, &mut surface, sums, taken);
    surface.evidence = evidence(sample, found, estimates);
    Extension { surface, inputs, columns, offsets, notes }
}

/// (gain, bias) of every input, if a file can represent them.
fn sensors(sample: &Sample, found: &Explained, estimates: &Estimates, notes: &mut Vec<String>) -> Vec<(f64, f64)> {
    let mut sensors = vec![(1.0, 0.0); sample.inputs.len()];
    for (it, numbers) in found.set.iter().zip(&estimates.causes) {
        match it.kind {
            HypothesisKind::InputGain(input) => sensors[input].0 = 1.0 + numbers.values[0],
            HypothesisKind::InputBias(input) if bias_fits_file(sample, input) => sensors[input].1 = numbers.values[0],
            HypothesisKind::InputBias(input) => {
                let name = &sample.inputs[input].name;
                notes
                    .push(format!("the model file cannot represent the bias of {name}: {name} has `symmetry` or `reciprocal`"));
            }
            _ => {}
        }
    }
    if sensors.iter().any(|sensor| *sensor != (1.0, 0.0)) {
        notes.push(
            "the extended file is for the readings of the faulty sensor; when the sensor is corrected, use the nominal file"
                .into(),
        );
    }
    sensors
}

/// The terms of the file as functions of readings: x_true = s x + o for every factor, powers expanded.
fn moved_terms(sample: &Sample, surface: &mut Surface, sensors: &[(f64, f64)]) -> BTreeMap<Monomial, f64> {
    let factors = rsm_core::basis::Factor::all(&sample.surface, &sample.inputs);
    let lines: Vec<(f64, f64)> = factors
        .iter()
        .map(|factor| {
            let (gain, bias) = sensors[factor.input];
            let (s, o) = line(factor.variable, gain, bias);
            // The hinge max(0, x - x_k) begins where the true input is at the knot, so the knot moves, and the hinge is scaled.
            match factor.shape {
                Shape::Itself => (s, o),
                Shape::Hinge { .. } => (s, 0.0),
                // A sigmoid has no unit: only its centre and its width change.
                Shape::Sigmoid { .. } => (1.0, 0.0),
                // A correction of such an input is not a hypothesis.
                Shape::Wave { .. } => (1.0, 0.0),
            }
        })
        .collect();
    for (knot, factor) in surface.knots.iter_mut().zip(&factors[sample.inputs.len()..]) {
        let (gain, bias) = sensors[factor.input];
        knot.at = gain * knot.at + bias;
    }
    for (sigmoid, factor) in surface.sigmoids.iter_mut().zip(&factors[sample.inputs.len() + sample.surface.knots.len()..]) {
        let (gain, bias) = sensors[factor.input];
        (sigmoid.at, sigmoid.width) = (gain * sigmoid.at + bias, gain.abs() * sigmoid.width);
    }
    let mut sums = BTreeMap::new();
    for term in &sample.surface.terms {
        let mut parts = vec![(term.coefficient, Vec::new())];
        for (power, (s, o)) in term.powers.iter().zip(&lines) {
            parts = parts.iter().flat_map(|(value, powers)| times(*value, powers, *power, *s, *o)).collect();
        }
        for (value, powers) in parts {
            *sums.entry(Monomial { powers, extra: None }).or_insert(0.0) += value;
        }
    }
    sums
}

/// value times (s x + o)^power, as coefficients of powers of x.
fn times(value: f64, powers: &[u32], power: u32, s: f64, o: f64) -> Vec<(f64, Vec<u32>)> {
    let mut binomial = 1.0;
    let mut parts = Vec::new();
    for k in 0..=power {
        // The binomial coefficient of x^(power - k) o^k.
        if k > 0 {
            binomial *= f64::from(power + 1 - k) / f64::from(k);
        }
        let factor = binomial * s.powi((power - k) as i32) * o.powi(k as i32);
        if k == 0 || factor != 0.0 {
            let mut grown = powers.to_vec();
            grown.push(power - k);
            parts.push((value * factor, grown));
        }
    }
    parts
}

/// The line x(truth) = s x(reading) + o, where reading = gain truth + bias.
fn line(variable: Variable, gain: f64, bias: f64) -> (f64, f64) {
    if (gain, bias) == (1.0, 0.0) {
        return (1.0, 0.0);
    }
    match variable {
        Variable::Natural => (1.0 / gain, -bias / gain),
        Variable::Centred { low, high } => {
            let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
            (1.0 / gain, ((middle - bias) / gain - middle) / half)
        }
        Variable::Magnitude | Variable::ScaledMagnitude { .. } => (1.0 / gain, 0.0),
        Variable::Reciprocal => (gain, 0.0),
        Variable::CentredReciprocal { low, high } => {
            let (middle, half) = ((1.0 / low + 1.0 / high) / 2.0, (1.0 / low - 1.0 / high) / 2.0);
            (gain, middle * (gain - 1.0) / half)
        }
    }
}

fn drift(sample: &Sample, clock: Option<usize>, column: &[f64], amount: f64) -> Offset {
    let time: Vec<f64> = match clock.and_then(|k| sample.extras[k].values.clone()) {
        Some(values) => values,
        None => sample.places.iter().map(|place| *place as f64).collect(),
    };
    let span = (time[time.len() - 1] - time[0]).max(f64::MIN_POSITIVE);
    let from = time[0] - column[0] * span;
    Offset::Drift { amount, from, span, column: clock.map(|k| sample.extras[k].name.clone()) }
}

/// Writes terms, inputs and support of the surface. Returns the inputs and the column names of the new ones.
fn write(sample: &Sample, surface: &mut Surface, sums: BTreeMap<Monomial, f64>, taken: &[Input]) -> (Vec<Input>, Vec<String>) {
    let mut used: Vec<usize> = sums.keys().filter_map(|it| it.extra.map(|(extra, _)| extra)).collect();
    used.sort_unstable();
    used.dedup();
    let mut inputs = sample.inputs.clone();
    let mut all: Vec<Input> = taken.to_vec();
    let mut columns = Vec::new();
    let mut codings = Vec::new();
    for extra in &used {
        let it = &sample.extras[*extra];
        let (middle, half) = it.coding().expect("an input has numbers");
        let name = identifier(&it.name, &all);
        let input =
            Input { name: name.clone(), unit: it.unit.clone(), range: [middle - half, middle + half], outside: Outside::Clamp };
        inputs.push(input.clone());
        all.push(input);
        surface.inputs.push(name);
        columns.push(it.name.clone());
        // The columns are functions of z = (value - middle)/half; without coding, the file has powers of the value itself.
        codings.push(if surface.coding == Coding::None { (1.0 / half, -middle / half) } else { (1.0, 0.0) });
    }
    let own = sample.inputs.len();
    let mut terms: BTreeMap<Vec<u32>, f64> = BTreeMap::new();
    for (monomial, value) in sums {
        let place = monomial.extra.and_then(|(extra, _)| used.iter().position(|other| *other == extra));
        let expanded = match (place, monomial.extra) {
            (Some(place), Some((_, power))) => times(value, &[], power, codings[place].0, codings[place].1),
            _ => vec![(value, vec![0])],
        };
        for (value, of_extra) in expanded {
            let mut powers = monomial.powers[..own].to_vec();
            powers.extend((0..used.len()).map(|k| if Some(k) == place { of_extra[0] } else { 0 }));
            powers.extend(&monomial.powers[own..]);
            *terms.entry(powers).or_insert(0.0) += value;
        }
    }
    let nominal: Vec<Vec<u32>> = sample
        .surface
        .terms
        .iter()
        .map(|term| [&term.powers[..own], &vec![0; used.len()], &term.powers[own..]].concat())
        .collect();
    // Terms of the file first, in its order; then the new ones by order, with the highest powers of the first factor first, as the fitter writes
    // them.
    let mut new: Vec<(Vec<u32>, f64)> = terms
        .iter()
        .filter(|(powers, value)| !nominal.contains(powers) && **value != 0.0)
        .map(|(p, v)| (p.clone(), *v))
        .collect();
    new.sort_by_key(|(powers, _)| (rsm_fit::design::order(powers), std::cmp::Reverse(powers.clone())));
    let old = nominal.into_iter().map(|powers| (terms.get(&powers).copied().unwrap_or(0.0), powers));
    surface.terms = old
        .chain(new.into_iter().map(|(powers, value)| (value, powers)))
        .map(|(coefficient, powers)| Term { powers, coefficient })
        .collect();
    for space in &mut surface.support {
        space.normal.extend(vec![0.0; used.len()]);
    }
    (inputs, columns)
}

/// The evidence of the extended surface.
fn evidence(sample: &Sample, found: &Explained, estimates: &Estimates) -> Vec<(String, Evidence)> {
    let rows_of_file = sample.rows_of_file.unwrap_or(sample.rows() as f64).round() as i64;
    let labels = found.set.iter().map(|it| Evidence::Text(it.kind.label(sample))).collect();
    let mean_scale = found.scale.iter().map(|s| s * s).sum::<f64>() / found.scale.len().max(1) as f64;
    vec![
        ("rows".to_string(), Evidence::Whole(rows_of_file + found.kept().len() as i64)),
        ("method".to_string(), Evidence::Text("diagnosis of an earlier surface against new rows".to_string())),
        ("new_rows".to_string(), Evidence::Whole(found.kept().len() as i64)),
        ("causes".to_string(), Evidence::List(labels)),
        ("residual_sd".to_string(), Evidence::Number(estimates.sd * mean_scale.sqrt())),
    ]
}

/// The result of an evaluator of the surface at points, clamped and saturated as the file states.
pub(super) fn evaluate(surface: &Surface, inputs: &[Input], points: &[Vec<f64>]) -> Vec<f64> {
    let design = Design::new(surface, inputs, surface.terms.iter().map(|term| term.powers.clone()).collect());
    let rows = points.first().map_or(0, Vec::len);
    let value = |row: usize| {
        let point: Vec<Physical> = points.iter().map(|column| Physical(column[row])).collect();
        let sum: f64 = design.row(&point).iter().zip(&surface.terms).map(|(x, term)| x.to_f64() * term.coefficient).sum();
        match surface.output_range {
            Some([low, high]) => sum.clamp(low, high),
            None => sum,
        }
    };
    (0..rows).map(value).collect()
}

impl Offset {
    /// The offset of a row, from its place in the run order (if that is the order of the diagnosis) and the cell of a column; `None` if the row lacks
    /// them.
    pub fn at(
        &self,
        place: Option<usize>,
        number: &dyn Fn(&str) -> Option<f64>,
        level: &dyn Fn(&str) -> Option<String>,
    ) -> Option<f64> {
        match self {
            Offset::Drift { amount, from, span, column: None } => Some(amount * (place? as f64 - from) / span),
            Offset::Drift { amount, from, span, column: Some(column) } => Some(amount * (number(column)? - from) / span),
            Offset::Step { at, values } => Some(if place? < *at { values[0] } else { values[1] }),
            Offset::Block { column, levels } => {
                let level = level(column)?;
                levels.iter().find(|(name, _)| *name == level).map(|(_, value)| *value)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_of_a_faulty_sensor_give_the_truth_of_every_coding() {
        // reading = 1.2 truth + 0.3; the reciprocal without bias.
        for variable in [Variable::Natural, Variable::Centred { low: -1.0, high: 4.0 }] {
            let (s, o) = line(variable, 1.2, 0.3);
            for truth in [-0.5, 0.7, 3.0] {
                let reading: f64 = 1.2 * truth + 0.3;
                let x = |xi: f64| variable.value(rsm_fit::dd::Dd::from(xi)).to_f64();
                assert!((x(truth) - (s * x(reading) + o)).abs() < 1e-14);
            }
        }
        for variable in [Variable::Reciprocal, Variable::CentredReciprocal { low: 0.5, high: 4.0 }] {
            let (s, o) = line(variable, 1.2, 0.0);
            let x = |xi: f64| variable.value(rsm_fit::dd::Dd::from(xi)).to_f64();
            assert!((x(0.7) - (s * x(1.2 * 0.7) + o)).abs() < 1e-14);
        }
        // (2 x + 3)^2 = 4 x^2 + 12 x + 9.
        assert_eq!(times(1.0, &[], 2, 2.0, 3.0), [(4.0, vec![2]), (12.0, vec![1]), (9.0, vec![0])]);
    }
}
