//! Lowers a surface that follows measured responses: the update step of recursive least squares, and the evaluator of the adapted surface.
//!
//! In: a checked surface and the settings. Out: a tape of the update (inputs and the measured response to the error of the prediction, its variance
//! and the reason of a frozen step), a tape of the evaluator, and the start of the state. No branch; never fails after [`Recursive::refusal`].
//!
//! A surface is linear in its coefficients b: y = phi b, with phi the products of powers of its coded variables. The state holds b and the factors of
//! the covariance P = U D U', U upper triangular with ones on the diagonal, D diagonal. All variances are in units of the variance of the noise. A
//! step has three parts (Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter V, for each measurement):
//!
//! ```text
//! D := D/lambda                                   forgetting: a row has the weight lambda^age
//! a measurement of b_k = b_k with variance s      k = 0, 1, ..., n - 1, 0, ... one coefficient a step: the bound of P
//! a measurement of phi b = y with variance 1
//! ```
//!
//! **Symmetric and positive.** P is never stored, so it is symmetric. A measurement with variance r multiplies each d_j by alpha_{j-1}/alpha_j with
//! alpha_0 = r and alpha_j = alpha_{j-1} + d_j f_j^2: a quotient of positive numbers, at most 1 also after rounding.
//!
//! **Bounded.** Let p be the largest variance, and s = p lambda^{n-1}/(1 - lambda^n). The information of the second part alone, in the direction of
//! coefficient k, is at least 1/(p lambda^{n-1}) after its measurement if it was so n steps before: lambda^n/(p lambda^{n-1}) + 1/s. Until the next
//! one it fades by lambda^{n-1}, to 1/p. Other measurements only add information. So P <= p I after every step, whatever the inputs. The start
//! fulfils it with variances of at most p lambda^n. The second part moves no coefficient, and its information is about that of one row of variance p
//! for each coefficient.
//!
//! **Frozen.** If a number is not finite, an input is outside its range, the point is outside the support, the error of the prediction is above
//! `gate` of its standard deviations, or a next state would not be finite, every state keeps its bits.
//!
//! A row moves a coefficient by at most `gate` times `limit`: |P phi|_k <= sqrt(P_kk phi P phi), and the error is at most gate sqrt(1 + phi P phi).

use std::collections::HashMap;

use crate::check::Checked;
use crate::model::{Coding, Input, Surface};
use crate::names::{self, Kind, MEASURED};
use crate::number::{Precision, Rational, exact, integer, power};
use crate::tape::{Op, Port, Reg, State, Tape, TapeBuilder};

use super::saturation::inward;
use super::variables::Variables;

/// The settings with which a surface follows measured responses.
#[derive(Debug, Clone, PartialEq)]
pub struct Recursive {
    /// The weight of a row fades by this factor with every later row: 1 forgets nothing, 0.99 has a memory of about 100 rows.
    pub forgetting: f64,
    /// The standard deviation of the noise of a measured response, in the unit of the response.
    pub noise: f64,
    /// A row is frozen if the error of its prediction is larger than this number of standard deviations.
    pub gate: f64,
    /// The largest standard deviation of a coefficient, in the unit of the response.
    pub limit: f64,
    /// The standard deviation of the coefficients at the start, at most the limit.
    pub start: f64,
}

/// The smallest forgetting factor: a memory of two rows.
const LEAST_FORGETTING: f64 = 0.5;

/// The largest ratio of `limit` and `start` to `noise`, and of 1 to it. The variances are then between 10^-12 and 10^12, and their products stay in
/// the exponent range of f32, 10^-38 to 10^38.
const WIDEST_RATIO: f64 = 1e6;

/// The allowed magnitudes of `gate` times `noise` and its inverse: well inside the exponent range of f32.
const WIDEST_GATE: f64 = 1e30;

/// The most terms. The step has about 7 operations for each square of their number: 29,000 here.
const MOST_TERMS: usize = 64;

impl Recursive {
    /// Settings with a known noise: a memory of about 1000 rows, a gate of 5 standard deviations, coefficients known to the noise of one row.
    #[must_use]
    pub fn new(noise: f64) -> Self {
        Recursive { forgetting: 0.999, noise, gate: 5.0, limit: noise, start: noise }
    }

    /// The reason why a surface cannot follow measured responses with these settings; `None` if it can.
    #[must_use]
    pub fn refusal(&self, surface: &Surface) -> Option<String> {
        let Recursive { forgetting, noise, gate, limit, start } = *self;
        let positive = [("noise", noise), ("gate", gate), ("limit", limit), ("start", start)];
        if !(LEAST_FORGETTING..=1.0).contains(&forgetting) {
            return Some(format!("forgetting: found {forgetting}, expected {LEAST_FORGETTING} to 1"));
        }
        if let Some((name, value)) = positive.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            return Some(format!("{name}: found {value}, expected a finite number above 0"));
        }
        if start > limit {
            return Some(format!("start: found {start}, expected at most the limit {limit}"));
        }
        let ratios = [("limit", limit / noise), ("start", start / noise)];
        if let Some((name, ratio)) = ratios.into_iter().find(|(_, ratio)| !(1.0 / WIDEST_RATIO..=WIDEST_RATIO).contains(ratio))
        {
            return Some(format!(
                "{name}: found {ratio:e} times the noise, expected {:e} to {WIDEST_RATIO:e}",
                1.0 / WIDEST_RATIO
            ));
        }
        if !(1.0 / WIDEST_GATE..=WIDEST_GATE).contains(&(gate * noise)) {
            return Some(format!(
                "noise: found {noise:e}, expected {:e} to {WIDEST_GATE:e} for the product with the gate; change the unit of the response",
                1.0 / WIDEST_GATE
            ));
        }
        if surface.coding == Coding::None {
            let what =
                "its variables are natural (`coding = \"none\"`), expected coded ones: one limit holds for all coefficients";
            return Some(what.to_string());
        }
        if surface.spline.is_some() {
            return Some("it is a spline, and only the coefficients of terms can follow measured responses".to_string());
        }
        if let Some(transform) = surface.transform {
            let word = transform.word();
            return Some(format!(
                "its terms describe the response after the transform \"{word}\", and a measured response cannot follow"
            ));
        }
        if surface.terms.is_empty() || surface.terms.len() > MOST_TERMS {
            return Some(format!("found {} terms, expected 1 to {MOST_TERMS}", surface.terms.len()));
        }
        surface.inputs.iter().find_map(|name| names::refuse_tracked(name).map(|why| format!("its input `{name}` {why}")))
    }

    /// Variances in units of the noise's: s of the measurement of one coefficient, `None` without forgetting; that of each coefficient at the start.
    fn variances(&self, terms: usize) -> (Option<Rational>, Rational) {
        let square = |sd: f64| power(&(exact(sd) / exact(self.noise)), 2);
        let (forgetting, terms) = (exact(self.forgetting), terms as u32);
        let largest = square(self.limit) * power(&forgetting, terms);
        let start = square(self.start).min(largest);
        if forgetting == integer(1) {
            return (None, start);
        }
        let variance = square(self.limit) * power(&forgetting, terms - 1) / (integer(1) - power(&forgetting, terms));
        (Some(variance), start)
    }
}

/// Why a step changed nothing: the third result of an update.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Frozen {
    /// An input or the measured response is NaN or infinite.
    NotFinite = 1,
    /// An input is outside its range, or the point is outside the support of the surface.
    Outside = 2,
    /// The error of the prediction is above the gate.
    Error = 3,
    /// A next state would not be finite.
    State = 4,
}

impl Frozen {
    /// All of them, in the order of their numbers.
    pub const ALL: [Frozen; 4] = [Frozen::NotFinite, Frozen::Outside, Frozen::Error, Frozen::State];

    /// The reason with the number of the third result; `None` for 0.
    #[must_use]
    pub fn of_number(number: f64) -> Option<Self> {
        Self::ALL.into_iter().find(|it| f64::from(*it as u8) == number)
    }
}

/// A surface that follows measured responses, in one precision.
#[derive(Debug, Clone, PartialEq)]
pub struct Follower {
    /// The step: inputs, then the measured response. Results: `error`, the measured response minus the prediction; `variance` of that error, in units
    /// of the noise's; `frozen`, 0 or the number of a [`Frozen`]. States: the coefficients `b0`, ..., the diagonal `d0`, ..., the factor `u0_1`, ...
    /// row by row, and `turn`, the coefficient that the next step measures (without forgetting absent).
    pub update: Tape,
    /// The evaluator of the surface with the coefficients of the state, limited to its `output_range`. Its states are the coefficients.
    pub adapted: Tape,
    /// The states of the update at the start: the coefficients of the model.
    pub start: Vec<f64>,
}

/// The tapes of a surface that follows measured responses, by its index in the model.
///
/// # Panics
/// When the precision cannot hold the model, or the settings do not suit: ask [`Checked::refusal`] and [`Recursive::refusal`] first.
///
/// ```
/// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
/// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [1], coefficient = 30.0 }]\n";
/// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
/// // A line from 5 N at rest to 65 N at 30 m/s. The car is 2 N worse than its map.
/// use rsm_core::{lower::{self, Recursive}, number::Precision, run::Interpreter};
///
/// let drag = lower::recursive(&checked, 0, Precision::F64, &Recursive::new(1.0));
/// let (mut update, mut adapted) = (Interpreter::<f64>::new(&drag.update), Interpreter::<f64>::new(&drag.adapted));
/// update.set_states(&drag.start);
/// for k in 0..300 {
///     let speed = f64::from(k % 31);
///     update.step(&[speed, 7.0 + 2.0 * speed]);
/// }
/// adapted.set_states(&update.states()[..2]);
/// assert!((adapted.step(&[15.0]) - 37.0).abs() < 0.05);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn recursive(checked: &Checked, index: usize, precision: Precision, settings: &Recursive) -> Follower {
    let surface = &checked.model().surfaces[index];
    let inputs = checked.inputs_of(surface);
    let terms = surface.terms.len();
    let (_, variance) = settings.variances(terms);
    let rounded = |value: &Rational| precision.round(value);
    let mut start: Vec<f64> = surface.terms.iter().map(|term| rounded(&exact(term.coefficient))).collect();
    start.resize(2 * terms, rounded(&variance));
    start.resize(names_of_states(terms, settings.forgetting < 1.0).len(), 0.0);
    Follower { update: update(surface, &inputs, precision, settings), adapted: adapted(surface, &inputs, precision), start }
}

/// The names of the states of an update.
fn names_of_states(terms: usize, forgets: bool) -> Vec<String> {
    let coefficients = (0..terms).map(|k| format!("b{k}"));
    let diagonal = (0..terms).map(|k| format!("d{k}"));
    let factor = (0..terms).flat_map(|i| (i + 1..terms).map(move |j| format!("u{i}_{j}")));
    coefficients.chain(diagonal).chain(factor).chain(forgets.then(|| "turn".to_string())).collect()
}

/// The variances of the coefficients in the state of an update, in units of the noise's: the diagonal of U D U'.
#[must_use]
pub fn variances_of(states: &[f64], terms: usize) -> Vec<f64> {
    let diagonal = &states[terms..2 * terms];
    let mut factor = states[2 * terms..].iter();
    let row = |i: usize| {
        let off: f64 = (i + 1..terms).map(|j| factor.next().map_or(0.0, |u| u * u * diagonal[j])).sum();
        diagonal[i] + off
    };
    (0..terms).map(row).collect()
}

fn name(surface: &Surface, kind: Kind) -> String {
    names::rust_function(&surface.name, kind, Precision::F64)
}

/// The regressors phi of the coefficients; `None` is the number 1.
fn regressors(tape: &mut TapeBuilder, variables: &mut Variables<'_>, surface: &Surface) -> Vec<Option<Reg>> {
    let mut powers: HashMap<(usize, u32), Reg> = HashMap::new();
    let mut factor_to = |tape: &mut TapeBuilder, factor: usize, exponent: u32| {
        let variable = variables.of(tape, factor);
        let coded = *powers.entry((factor, 1)).or_insert_with(|| {
            if variable.scale == integer(1) {
                variable.value
            } else {
                // A quotient, so that the coded variable is exactly 1 at the end of its range.
                let divisor = tape.constant(integer(1) / &variable.scale);
                tape.push(Op::Divide(variable.value, divisor))
            }
        });
        (2..=exponent).fold(coded, |lower, exponent| {
            *powers.entry((factor, exponent)).or_insert_with(|| tape.push(Op::Multiply(lower, coded)))
        })
    };
    let mut product = |powers: &[u32]| {
        let factors = powers.iter().enumerate().filter(|(_, exponent)| **exponent > 0);
        factors.fold(None, |product: Option<Reg>, (factor, exponent)| {
            let next = factor_to(tape, factor, *exponent);
            Some(product.map_or(next, |product| tape.push(Op::Multiply(product, next))))
        })
    };
    surface.terms.iter().map(|term| product(&term.powers)).collect()
}

/// A value times a regressor.
fn times(tape: &mut TapeBuilder, value: Reg, regressor: Option<Reg>) -> Reg {
    regressor.map_or(value, |regressor| tape.push(Op::Multiply(value, regressor)))
}

/// phi b, in the order of the terms.
fn prediction(tape: &mut TapeBuilder, coefficients: &[Reg], regressors: &[Option<Reg>]) -> Reg {
    let products = coefficients.iter().zip(regressors).map(|(b, phi)| times(tape, *b, *phi)).collect::<Vec<_>>();
    products.into_iter().reduce(|sum, product| tape.push(Op::Add(sum, product))).expect("a surface that follows has a term")
}

fn states(tape: &mut TapeBuilder, count: usize) -> Vec<Reg> {
    (0..count).map(|k| tape.push(Op::State(State(k as u32)))).collect()
}

/// The surface with the coefficients of the state.
fn adapted(surface: &Surface, inputs: &[Input], precision: Precision) -> Tape {
    let mut tape = TapeBuilder::sharing(precision);
    let arguments = super::arguments(&mut tape, inputs.len());
    let terms = surface.terms.len();
    let coefficients = states(&mut tape, terms);
    let mut variables = Variables::new(surface, inputs, arguments);
    let phi = regressors(&mut tape, &mut variables, surface);
    let value = prediction(&mut tape, &coefficients, &phi);
    let guarded = super::pass_nan_of_unused_inputs(&mut tape, &mut variables, inputs, value);
    let mut value = super::give_sign_of_odd_inputs(&mut tape, &variables, surface, inputs, guarded);
    if let Some([low, high]) = surface.output_range {
        let above = super::at_least(&mut tape, value, low);
        value = super::at_most(&mut tape, above, high);
    }
    let name = name(surface, Kind::Adapted);
    let states = names_of_states(terms, false).into_iter().zip(coefficients);
    tape.finish_with_results(name.clone(), surface.inputs.clone(), [(name, value)], states)
}

/// The covariance on the tape.
struct Covariance {
    diagonal: Vec<Reg>,
    /// Above the diagonal, by row and column.
    factor: Vec<Vec<Reg>>,
}

/// The results of a measurement.
struct Measured {
    /// P phi.
    gain: Vec<Reg>,
    /// r + phi P phi.
    variance: Reg,
    /// Its inverse.
    inverse: Reg,
}

impl Covariance {
    /// The covariance after a measurement with these regressors and this variance r (Bierman 1977, chapter V).
    fn measure(&mut self, tape: &mut TapeBuilder, phi: &[Option<Reg>], variance: Reg) -> Measured {
        let one = tape.constant(integer(1));
        let mut measured = Measured { gain: vec![], variance, inverse: one };
        for j in 0..self.diagonal.len() {
            // f = U' phi
            let above = (0..j).map(|i| times(tape, self.factor[i][j], phi[i])).collect::<Vec<_>>();
            let own = phi[j].unwrap_or(one);
            let f = above.into_iter().fold(own, |sum, product| tape.push(Op::Add(sum, product)));
            let v = tape.push(Op::Multiply(self.diagonal[j], f));
            let added = tape.push(Op::Multiply(v, f));
            let variance = tape.push(Op::Add(measured.variance, added));
            let inverse = tape.push(Op::Divide(one, variance));
            // alpha_{j-1} (1/alpha_j) is at most 1: the relative error of the quotient is at most half a unit, so the product rounds to 1 at most.
            let ratio = tape.push(Op::Multiply(measured.variance, inverse));
            self.diagonal[j] = tape.push(Op::Multiply(self.diagonal[j], ratio));
            if j > 0 {
                let lambda = tape.push(Op::Multiply(f, measured.inverse));
                for i in 0..j {
                    let old = self.factor[i][j];
                    let change = tape.push(Op::Multiply(measured.gain[i], lambda));
                    self.factor[i][j] = tape.push(Op::Subtract(old, change));
                    let more = tape.push(Op::Multiply(old, v));
                    measured.gain[i] = tape.push(Op::Add(measured.gain[i], more));
                }
            }
            measured.gain.push(v);
            (measured.variance, measured.inverse) = (variance, inverse);
        }
        measured
    }
}

/// The step.
fn update(surface: &Surface, inputs: &[Input], precision: Precision, settings: &Recursive) -> Tape {
    let mut tape = TapeBuilder::sharing(precision);
    let arguments = super::arguments(&mut tape, inputs.len());
    let measured = tape.push(Op::Input(Port(inputs.len() as u32)));
    let terms = surface.terms.len();
    let forgets = settings.forgetting < 1.0;
    let names = names_of_states(terms, forgets);
    let old = states(&mut tape, names.len());
    let (zero, one, half) = (tape.constant(integer(0)), tape.constant(integer(1)), tape.constant(exact(0.5)));

    let mut variables = Variables::new(surface, inputs, arguments.clone());
    let phi = regressors(&mut tape, &mut variables, surface);
    let coefficients = &old[..terms];
    let predicted = prediction(&mut tape, coefficients, &phi);
    // For an odd surface y = sign phi b, so phi b is compared with sign y.
    let signed = super::give_sign_of_odd_inputs(&mut tape, &variables, surface, inputs, measured);
    let error = tape.push(Op::Subtract(signed, predicted));

    let mut rows = old[2 * terms..].iter().copied();
    let row = |i: usize| (0..terms).map(|j| if j > i { rows.next().expect("a state of each pair") } else { zero }).collect();
    let mut covariance = Covariance { diagonal: old[terms..2 * terms].to_vec(), factor: (0..terms).map(row).collect() };
    let mut turned = None;
    if let (Some(variance), _) = settings.variances(terms) {
        let fading = integer(1) / exact(settings.forgetting);
        covariance.diagonal.iter_mut().for_each(|d| *d = tape.times(*d, fading.clone()));
        let turn = old[names.len() - 1];
        let is_measured = (0..terms).map(|k| {
            let k = tape.constant(integer(k as i64));
            let distance = tape.push(Op::Subtract(turn, k));
            let distance = tape.push(Op::Absolute(distance));
            Some(tape.select_less(distance, half, one, zero))
        });
        let is_measured: Vec<Option<Reg>> = is_measured.collect();
        let variance = tape.constant(variance);
        covariance.measure(&mut tape, &is_measured, variance);
        let next = tape.push(Op::Add(turn, one));
        let end = tape.constant(exact(terms as f64 - 0.5));
        turned = Some(tape.select_less(next, end, next, zero));
    }
    let found = covariance.measure(&mut tape, &phi, one);
    let weighted = tape.push(Op::Multiply(error, found.inverse));
    let mut next: Vec<Reg> = coefficients
        .iter()
        .zip(&found.gain)
        .map(|(b, gain)| {
            let change = tape.push(Op::Multiply(*gain, weighted));
            tape.push(Op::Add(*b, change))
        })
        .collect();
    next.extend(&covariance.diagonal);
    next.extend((0..terms).flat_map(|i| covariance.factor[i][i + 1..].to_vec()));
    next.extend(turned);

    // From the last condition to the first, so that the first one that is not met gives the reason.
    let reason = |tape: &mut TapeBuilder, it: Frozen| tape.constant(integer(it as i64));
    // The sum of all next states is finite only if each of them is; a - a is 0 for a number and NaN for anything else.
    let sum = next.iter().copied().reduce(|sum, state| tape.push(Op::Add(sum, state))).expect("there are states");
    let nothing = tape.push(Op::Subtract(sum, sum));
    let why = reason(&mut tape, Frozen::State);
    let mut frozen = tape.select_less(nothing, one, zero, why);
    let share = tape.times(error, integer(1) / (exact(settings.gate) * exact(settings.noise)));
    let square = tape.push(Op::Multiply(share, share));
    let why = reason(&mut tape, Frozen::Error);
    frozen = tape.select_less(square, found.variance, frozen, why);
    let inside = inside(&mut tape, surface, inputs, &arguments);
    let why = reason(&mut tape, Frozen::Outside);
    frozen = tape.select_less(half, inside, frozen, why);
    let nothings = arguments.iter().chain([&measured]).map(|it| tape.push(Op::Subtract(*it, *it))).collect::<Vec<_>>();
    let nothing = nothings.into_iter().reduce(|sum, it| tape.push(Op::Add(sum, it))).expect("a response is measured");
    let why = reason(&mut tape, Frozen::NotFinite);
    frozen = tape.select_less(nothing, one, frozen, why);

    let kept: Vec<Reg> = old.iter().zip(next).map(|(old, next)| tape.select_less(frozen, half, next, *old)).collect();
    let error = super::give_sign_of_odd_inputs(&mut tape, &variables, surface, inputs, error);
    let results = [("error", error), ("variance", found.variance), ("frozen", frozen)];
    let arguments = surface.inputs.iter().cloned().chain([MEASURED.to_string()]).collect();
    tape.finish_with_results(name(surface, Kind::Update), arguments, results, names.into_iter().zip(kept))
}

/// 1 if every input is in its range and every half-space of the support holds, else 0.
fn inside(tape: &mut TapeBuilder, surface: &Surface, inputs: &[Input], arguments: &[Reg]) -> Reg {
    let (zero, mut inside) = (tape.constant(integer(0)), tape.constant(integer(1)));
    for (input, argument) in inputs.iter().zip(arguments) {
        // The bounds of an evaluator's clamp.
        let [low, high] = inward(input.range, tape.precision());
        let bound = tape.rounded_constant(low, exact(input.range[0]));
        inside = tape.select_less(*argument, bound, zero, inside);
        let bound = tape.rounded_constant(high, exact(input.range[1]));
        inside = tape.select_less(bound, *argument, zero, inside);
    }
    let mut variables = Variables::unclamped(surface, inputs, arguments.to_vec());
    super::half_spaces(tape, surface, &mut variables, inside, zero)
}
