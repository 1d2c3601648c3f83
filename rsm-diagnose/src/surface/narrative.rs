//! Sentences and parameters of causes: kind, name, unit, interval.
//!
//! In: a sample, its explanation, estimates. Out: the list of [`Cause`]s without rivals; [`super::causes`] adds the confidence and the rivals with
//! the same trace. Makes no decision.

use super::cause::{Cause, OutlyingRun, Parameter};
use super::estimate::Estimates;
use super::explained::Explained;
use super::hypotheses::{HypothesisKind, Monomial, Part, name_of};
use super::noise::{self, Growth};
use super::null::Thresholds;
use super::sample::Sample;
use crate::engine::significance::{ln_two_sided_t, ln_upper_f};
use rsm_core::order;
use rsm_fit::design;

/// The standard normal's 97.5 % point.
const NORMAL: f64 = 1.96;

/// The data for the sentences.
pub(super) struct Narrative<'a> {
    /// The rows.
    pub sample: &'a Sample,
    /// Their explanation.
    pub found: &'a Explained,
    /// The estimated parameters.
    pub estimates: &'a Estimates,
}

/// A number with four digits.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    let magnitude = value.abs().log10().floor() as i32;
    if (-4..7).contains(&magnitude) { format!("{value:.*}", (3 - magnitude).max(0) as usize) } else { format!("{value:.3e}") }
}

/// The word for a number's sign ("higher" or "lower"), and its magnitude with interval. "3 too low" is easier to read than "-3 too high".
fn either_way<'a>(it: &Parameter, [positive, negative]: [&'a str; 2]) -> (&'a str, f64, f64, f64) {
    if it.value < 0.0 { (negative, -it.value, -it.high, -it.low) } else { (positive, it.value, it.low, it.high) }
}

impl Narrative<'_> {
    fn unit(&self) -> &str {
        &self.sample.surface.unit
    }

    fn empty(&self, kind: &'static str, label: String) -> Cause {
        Cause {
            kind,
            label,
            subject: None,
            parameters: Vec::new(),
            details: Vec::new(),
            runs: Vec::new(),
            confidence: 0.0,
            confidence_of_any: 0.0,
            gain: 0.0,
            ln_p: 0.0,
            rivals: Vec::new(),
            indistinguishable_from: Vec::new(),
            sentence: String::new(),
            members: Vec::new(),
        }
    }

    /// factor times an unknown of a member, plus an offset.
    fn parameter(&self, name: &str, member: usize, column: usize, (factor, offset): (f64, f64), unit: &str) -> Parameter {
        let numbers = &self.estimates.causes[member];
        let (value, half) = (offset + factor * numbers.values[column], (factor * numbers.halves[column]).abs());
        Parameter { name: name.to_string(), value, low: value - half, high: value + half, unit: unit.to_string() }
    }

    fn with_unit(&self, value: f64) -> String {
        if self.unit() == "1" { number(value) } else { format!("{} {}", number(value), self.unit()) }
    }

    /// A cause that changes the mean, from one or several members of the set.
    pub(super) fn cause(&self, members: &[usize]) -> Cause {
        let member = members[0];
        let sample = self.sample;
        let response = &sample.surface.name;
        let kind = &self.found.set[member].kind;
        let label = kind.label(sample);
        match kind {
            HypothesisKind::Term(powers) => {
                let term = name_of(sample, &Monomial { powers: powers.clone(), extra: None });
                let parameter = self.parameter("coefficient", member, 0, (1.0, 0.0), self.unit());
                let sentence = format!(
                    "The surface lacks the term {term}: its coefficient in coded variables is {} ({} to {}).",
                    self.with_unit(parameter.value),
                    number(parameter.low),
                    number(parameter.high)
                );
                let order = design::order(powers);
                let present = sample.surface.terms.iter().map(|term| design::order(&term.powers)).max().unwrap_or(0);
                let place = if order > present { "above the order of the file" } else { "within the order of the file" };
                let details =
                    vec![("powers", format!("{powers:?}")), ("order", order.to_string()), ("place", place.to_string())];
                Cause {
                    subject: Some(("term", term)),
                    parameters: vec![parameter],
                    details,
                    sentence,
                    ..self.empty("missing-term", label)
                }
            }
            HypothesisKind::Order(_) | HypothesisKind::Refit => self.several_terms(member, label),
            HypothesisKind::Coefficient(k) => {
                let old = sample.surface.terms[*k].coefficient;
                let term = name_of(sample, &Monomial { powers: sample.surface.terms[*k].powers.clone(), extra: None });
                let parameter = self.parameter("coefficient", member, 0, (1.0, old), self.unit());
                let sentence = format!(
                    "The coefficient of {term} is {} ({} to {}); the file has {}.",
                    self.with_unit(parameter.value),
                    number(parameter.low),
                    number(parameter.high),
                    number(old)
                );
                Cause {
                    subject: Some(("term", term)),
                    parameters: vec![parameter],
                    sentence,
                    ..self.empty("coefficient-error", label)
                }
            }
            HypothesisKind::Input(extra, _) => self.missing_input(*extra, members, label),
            HypothesisKind::Drift(clock) => self.drift(member, *clock, label),
            HypothesisKind::Step(at) => {
                let mut parameter = self.parameter("step", member, 0, (1.0, 0.0), self.unit());
                parameter.name = "step".to_string();
                let run = sample.places[*at] + 1;
                let (way, size, low, high) = either_way(&parameter, ["higher", "lower"]);
                let sentence = format!(
                    "From run {run} on, {response} is {way} by {} ({} to {}) than before, at the same inputs.",
                    self.with_unit(size),
                    number(low),
                    number(high)
                );
                let details = vec![("shape", "step".to_string()), ("from_run", run.to_string())];
                Cause { parameters: vec![parameter], details, sentence, ..self.empty("drift", label) }
            }
            HypothesisKind::Block(extra) => self.blocks(member, *extra, label),
            HypothesisKind::ResponseGain => self.sensor(response, member, "sensor-gain", ("gain", 1.0, "1"), "response", label),
            HypothesisKind::ResponseBias => {
                self.sensor(response, member, "sensor-bias", ("bias", 0.0, self.unit()), "response", label)
            }
            HypothesisKind::InputGain(input) => {
                let name = &sample.inputs[*input].name;
                self.sensor(name, member, "sensor-gain", ("gain", 1.0, "1"), "input", label)
            }
            HypothesisKind::InputBias(input) => {
                let input = &sample.inputs[*input];
                self.sensor(&input.name, member, "sensor-bias", ("bias", 0.0, &input.unit), "input", label)
            }
        }
    }

    fn sensor(
        &self,
        channel: &str,
        member: usize,
        kind: &'static str,
        (name, offset, unit): (&str, f64, &str),
        role: &'static str,
        label: String,
    ) -> Cause {
        let parameter = self.parameter(name, member, 0, (1.0, offset), unit);
        let sentence = if kind == "sensor-gain" {
            format!(
                "The sensor of {channel} reads {} times the true value ({} to {}).",
                number(parameter.value),
                number(parameter.low),
                number(parameter.high)
            )
        } else {
            let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
            let (way, size, low, high) = either_way(&parameter, ["much", "little"]);
            format!("The sensor of {channel} reads {}{unit} too {way} ({} to {}).", number(size), number(low), number(high))
        };
        Cause {
            subject: Some(("output", channel.to_string())),
            parameters: vec![parameter],
            details: vec![("channel", role.to_string())],
            sentence,
            ..self.empty(kind, label)
        }
    }

    /// A complete missing order, or a change of all coefficients.
    fn several_terms(&self, member: usize, label: String) -> Cause {
        let sample = self.sample;
        let hypothesis = &self.found.set[member];
        let old = |monomial: &Monomial| {
            let term = sample.surface.terms.iter().find(|term| term.powers == monomial.powers);
            term.map_or(0.0, |term| term.coefficient)
        };
        let own = hypothesis.in_file.iter().enumerate().filter_map(|(column, parts)| {
            let (_, monomial) = parts.first()?;
            let name = name_of(sample, monomial);
            Some(self.parameter(&name, member, column, (1.0, old(monomial)), self.unit()))
        });
        let parameters: Vec<Parameter> = own.collect();
        let words: Vec<String> = parameters.iter().map(|it| format!("{} {}", it.name, number(it.value))).collect();
        let (kind, subject, order, sentence) = match hypothesis.kind {
            HypothesisKind::Order(order) => (
                "missing-term",
                format!("order {order}"),
                Some(("order", order.to_string())),
                format!(
                    "The surface lacks the terms of order {order}; no single one is significant alone: {}.",
                    words.join(", ")
                ),
            ),
            _ => (
                "coefficient-error",
                "all terms".to_string(),
                None,
                format!(
                    "The coefficients have changed, by more than a sensor fault or a single coefficient explains: {}.",
                    words.join(", ")
                ),
            ),
        };
        let details = order.into_iter().collect();
        Cause { subject: Some(("term", subject)), parameters, details, sentence, ..self.empty(kind, label) }
    }

    fn missing_input(&self, extra: usize, members: &[usize], label: String) -> Cause {
        let sample = self.sample;
        let it = &sample.extras[extra];
        let (middle, half) = it.coding().expect("a missing input has numbers");
        let mut parameters = Vec::new();
        let mut terms = Vec::new();
        let mut words = Vec::new();
        for member in members {
            let hypothesis = &self.found.set[*member];
            let HypothesisKind::Input(_, part) = &hypothesis.kind else { continue };
            let name = match part {
                Part::Linear => it.name.clone(),
                Part::Square => format!("{}^2", it.name),
                Part::With(input) => format!("{}*{}", sample.inputs[*input].name, it.name),
            };
            if *part == Part::Linear {
                let unit = match (self.unit(), it.unit.as_str()) {
                    (own, "1") => own.to_string(),
                    (own, of) => format!("{own}/({of})"),
                };
                parameters.push(self.parameter("slope", *member, 0, (1.0 / half, 0.0), &unit));
            }
            let coefficient = self.parameter(&format!("coefficient of {name}"), *member, 0, (1.0, 0.0), self.unit());
            words.push(format!("{name} with {}", self.with_unit(coefficient.value)));
            parameters.push(coefficient);
            terms.push(name);
        }
        let mut details = vec![("terms", terms.join(", ")), ("range", format!("{} to {}", middle - half, middle + half))];
        let mut sentence = format!(
            "{} acts on {} but is not an input of the surface. Coded to -1..1 over {} to {} {}, its terms are {}.",
            it.name,
            sample.surface.name,
            number(middle - half),
            number(middle + half),
            it.unit,
            words.join(", ")
        );
        // With its own offset: the value of the column for which the file is valid.
        if let Some(linear) =
            members.iter().find(|member| self.found.set[**member].kind == HypothesisKind::Input(extra, Part::Linear))
            && let [slope, offset] = self.estimates.causes[*linear].values[..]
            && slope != 0.0
        {
            let reference = middle - half * offset / slope;
            details.push(("reference", reference.to_string()));
            sentence += &format!(" The original file is valid at {} {}.", number(reference), it.unit);
        }
        Cause { subject: Some(("input", it.name.clone())), parameters, details, sentence, ..self.empty("missing-input", label) }
    }

    fn drift(&self, member: usize, clock: Option<usize>, label: String) -> Cause {
        let sample = self.sample;
        let response = &sample.surface.name;
        let (span, per, unit) = match clock.map(|k| &sample.extras[k]) {
            Some(extra) => {
                let (_, half) = extra.coding().expect("a clock has numbers");
                (2.0 * half, format!("{} of {}", extra.unit, extra.name), format!("{}/({})", self.unit(), extra.unit))
            }
            None => {
                let span = (sample.places[sample.rows() - 1] - sample.places[0]).max(1) as f64;
                (span, "run".to_string(), format!("{}/run", self.unit()))
            }
        };
        let rate = self.parameter("rate", member, 0, (1.0 / span, 0.0), &unit);
        let total = self.parameter("total", member, 0, (1.0, 0.0), self.unit());
        let sentence = format!(
            "{response} drifts by {} from the first run to the last ({} to {}), {} per {per}.",
            self.with_unit(total.value),
            number(total.low),
            number(total.high),
            number(rate.value)
        );
        let details = vec![("shape", "linear".to_string())];
        Cause { parameters: vec![rate, total], details, sentence, ..self.empty("drift", label) }
    }

    fn blocks(&self, member: usize, extra: usize, label: String) -> Cause {
        let it = &self.sample.extras[extra];
        let (names, of) = it.levels.as_ref().expect("a block has levels");
        let hypothesis = &self.found.set[member];
        let mut column = 0;
        let mut parameters = Vec::new();
        for (level, name) in names.iter().enumerate().filter(|(level, _)| of.contains(level)) {
            if hypothesis.reference == Some(level) {
                let unit = self.unit().to_string();
                parameters.push(Parameter { name: name.clone(), value: 0.0, low: 0.0, high: 0.0, unit });
            } else {
                parameters.push(self.parameter(name, member, column, (1.0, 0.0), self.unit()));
                column += 1;
            }
        }
        let words: Vec<String> = parameters.iter().map(|it| format!("{} {}", it.name, self.with_unit(it.value))).collect();
        let mut sentence = format!("{} differs by levels of {}: {}.", self.sample.surface.name, it.name, words.join(", "));
        if let Some(reference) = hypothesis.reference {
            sentence += &format!(" The file is valid for {}; this choice sets its offset to 0.", names[reference]);
        }
        let details = vec![("shape", "levels".to_string())];
        Cause { subject: Some(("column", it.name.clone())), parameters, details, sentence, ..self.empty("block-offset", label) }
    }

    /// Several changes of level between runs: blocks without a column.
    pub(super) fn change_points(&self, members: &[usize]) -> Cause {
        let mut steps: Vec<(usize, usize)> = members
            .iter()
            .filter_map(|member| match self.found.set[*member].kind {
                HypothesisKind::Step(at) => Some((at, *member)),
                _ => None,
            })
            .collect();
        steps.sort_unstable();
        let mut parameters = Vec::new();
        let mut words = Vec::new();
        for (at, member) in &steps {
            let run = self.sample.places[*at] + 1;
            let parameter = self.parameter(&format!("step at run {run}"), *member, 0, (1.0, 0.0), self.unit());
            words.push(format!("{} at run {run}", self.with_unit(parameter.value)));
            parameters.push(parameter);
        }
        let sentence = format!("{} changes between blocks of runs, by {}.", self.sample.surface.name, words.join(", "));
        let details = vec![("shape", "change points".to_string())];
        Cause {
            subject: Some(("column", "run order".to_string())),
            parameters,
            details,
            sentence,
            ..self.empty("block-offset", "block-offset".to_string())
        }
    }

    /// Runs that are left out.
    pub(super) fn outlying(&self, thresholds: &Thresholds) -> Option<Cause> {
        if self.found.outliers.is_empty() {
            return None;
        }
        let rows = self.sample.rows() as f64;
        let each = self.found.outliers.iter().map(|row| {
            let residual = self.sample.response[*row] - self.found.fitted[*row];
            let studentised = residual / (self.estimates.sd * self.found.scale[*row]);
            // Bonferroni correction over all runs.
            let p = (ln_two_sided_t(studentised, self.estimates.freedom).exp() * rows).min(1.0);
            OutlyingRun { place: self.sample.places[*row], residual, studentised, p }
        });
        let runs: Vec<OutlyingRun> = each.collect();
        let words: Vec<String> =
            runs.iter().map(|it| format!("run {} ({} standard deviations)", it.place + 1, number(it.studentised))).collect();
        let worst = runs.iter().map(|it| it.p).fold(0.0, f64::max);
        let gain = runs.iter().map(|it| it.studentised.powi(2)).sum();
        let count = runs.len() as f64;
        Some(Cause {
            parameters: vec![Parameter { name: "count".into(), value: count, low: count, high: count, unit: "1".into() }],
            details: vec![("threshold_p", thresholds.alpha_outliers.to_string())],
            confidence: 1.0 - worst.min(1.0),
            confidence_of_any: 1.0 - worst.min(1.0),
            gain,
            ln_p: worst.max(1e-300).ln(),
            sentence: format!("Outlying runs, left out of all other figures: {}.", words.join(", ")),
            runs,
            ..self.empty("outlying-runs", "outlying-runs".to_string())
        })
    }

    /// Residuals, fitted values and rows that count.
    fn kept(&self) -> (Vec<f64>, Vec<f64>, Vec<usize>) {
        let kept = self.found.kept();
        let residual = kept.iter().map(|row| self.sample.response[*row] - self.found.fitted[*row]).collect();
        (residual, kept.iter().map(|row| self.found.fitted[*row]).collect(), kept)
    }

    /// Noise that grows with the response.
    pub(super) fn growing_noise(&self) -> Option<Cause> {
        let growth = self.found.noise.growth?;
        let (residual, fitted, _) = self.kept();
        let ratio = noise::growth(&residual, &fitted).1.max(1e-9);
        // By Wald's approximation, the likelihood ratio is the square of estimate over standard error.
        let error = growth.exponent().abs() / ratio.sqrt();
        let with = |exponent: f64| match growth {
            Growth::Exponential(_) => Growth::Exponential(exponent),
            Growth::Power(_) => Growth::Power(exponent),
        };
        let ends = [growth.exponent() - NORMAL * error, growth.exponent() + NORMAL * error];
        let ratios = ends.map(|end| with(end).ratio(&fitted));
        let of_sd = growth.ratio(&fitted);
        let (form, name, weights) = match growth {
            Growth::Exponential(rate) => {
                let (low, high) = order::ends(fitted);
                let per_unit = 4.0 * rate / (high - low);
                ("exponential", "rate", format!("exp({} {})", number(-per_unit), self.sample.surface.name))
            }
            Growth::Power(power) => ("power", "power", format!("{}^{}", self.sample.surface.name, number(-2.0 * power))),
        };
        let parameters = vec![
            Parameter {
                name: "sd_ratio".into(),
                value: of_sd,
                low: ratios[0].min(ratios[1]),
                high: ratios[0].max(ratios[1]),
                unit: "1".into(),
            },
            Parameter { name: name.into(), value: growth.exponent(), low: ends[0], high: ends[1], unit: "1".into() },
        ];
        let sentence = format!(
            "The noise changes with {}: its standard deviation at the highest fitted value is {} times that at the lowest. Fit with the weights {weights}.",
            self.sample.surface.name,
            number(of_sd)
        );
        let ln_p = ln_upper_f(ratio, 1.0, 1e7);
        let details = vec![("form", form.to_string()), ("weights", weights)];
        let (confidence, gain) = (1.0 - ln_p.exp(), ratio);
        Some(Cause {
            parameters,
            details,
            confidence,
            confidence_of_any: confidence,
            gain,
            ln_p,
            sentence,
            ..self.empty("growing-noise", "growing-noise".to_string())
        })
    }

    /// Autocorrelated noise.
    pub(super) fn autocorrelated(&self) -> Option<Cause> {
        let rho = self.found.noise.rho?;
        let (residual, _, kept) = self.kept();
        let even: Vec<f64> = residual.iter().zip(&kept).map(|(e, row)| e / self.found.scale[*row]).collect();
        let ratio = noise::correlation(&even, &kept).1.max(1e-9);
        let error = rho.abs() / ratio.sqrt();
        let pairs = even.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>();
        let watson = pairs / even.iter().map(|e| e * e).sum::<f64>();
        let ends = [rho - NORMAL * error, rho + NORMAL * error].map(|end| end.clamp(-1.0, 1.0));
        let parameters =
            vec![Parameter { name: "correlation".into(), value: rho, low: ends[0], high: ends[1], unit: "1".into() }];
        let sentence = format!(
            "Errors are correlated in the run order: neighbours have a correlation of {}, and the Durbin-Watson statistic is {} (2 without correlation). The intervals here take this into account.",
            number(rho),
            number(watson)
        );
        let ln_p = ln_upper_f(ratio, 1.0, 1e7);
        Some(Cause {
            parameters,
            details: vec![("durbin_watson", watson.to_string())],
            confidence: 1.0 - ln_p.exp(),
            confidence_of_any: 1.0 - ln_p.exp(),
            gain: ratio,
            ln_p,
            sentence,
            ..self.empty("correlated-errors", "correlated-errors".to_string())
        })
    }
}
