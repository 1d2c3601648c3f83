//! Causes as they are told: kind, numbers with units and intervals, how sure, and what else would leave the same trace.
//!
//! In: a sample, its explanation, estimates, all hypotheses. Out: [`Cause`] after cause, the strongest first. Decides nothing about which causes there are.

use super::estimate::Estimates;
use super::explain::{Explained, Worth, candidates, worth};
use super::hypotheses::{Claim, Hypothesis, Monomial, Part, name_of};
use super::noise::{self, Growth};
use super::null::Thresholds;
use super::sample::Sample;
use super::search::Search;
use super::tails::{f_of, ln_two_sided_t, ln_upper_f};
use crate::design;

/// A number of a cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// The estimate.
    pub value: f64,
    /// The 95 % interval.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Its unit.
    pub unit: String,
}

/// A run that is left out.
#[derive(Debug, Clone, PartialEq)]
pub struct OutlyingRun {
    /// Its place in the run order, from 0.
    pub place: usize,
    /// Measured less what the explanation says.
    pub residual: f64,
    /// That over its standard deviation, which it has no part in.
    pub studentised: f64,
    /// Probability of as much among so many runs.
    pub p: f64,
}

/// A cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Cause {
    /// The kind.
    pub kind: &'static str,
    /// KIND, or KIND:NAME.
    pub label: String,
    /// What it is of, as (key, name): a term, a column, an input or a response.
    pub subject: Option<(&'static str, String)>,
    /// Its numbers.
    pub parameters: Vec<Parameter>,
    /// Further words for whoever reads JSON: shape, order, weights.
    pub details: Vec<(&'static str, String)>,
    /// Runs, of outlying ones.
    pub runs: Vec<OutlyingRun>,
    /// 0 to 1: beyond chance, and beyond its rivals.
    pub confidence: f64,
    /// By how much 2 ln of the likelihood falls without it.
    pub gain: f64,
    /// ln of the probability of as much by chance.
    pub ln_p: f64,
    /// Rivals that do nearly as well, best first: label and by how much they do worse (2 ln of the likelihood, unknowns counted).
    pub rivals: Vec<(String, f64)>,
    /// Those that the data do not rule out.
    pub indistinguishable_from: Vec<String>,
    /// In plain words.
    pub sentence: String,
}

/// A rival that does worse by less than this is not ruled out: 2 ln 19, odds of 95 to 5. What is true is ahead of a rival by more only once in 20 times: the mean of a likelihood ratio under the
/// truth is 1 (Markov's inequality).
const NEAR: f64 = 5.9;

/// The standard normal's 97.5 % point.
const NORMAL: f64 = 1.96;

/// All causes of an explanation.
pub fn all(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    found: &Explained,
    estimates: &Estimates,
) -> Vec<Cause> {
    let teller = Teller { sample, found, estimates };
    let space = found.space(sample);
    // The set itself first, with the exact columns of its sensors; then everything else as rivals.
    let mut pool: Vec<Hypothesis> = found.set.clone();
    pool.extend(hypotheses.iter().cloned());
    let candidates = candidates(&pool, thresholds, &space);
    let search = Search::new(&candidates, &space.carried(&sample.residual()));
    let set: Vec<usize> = (0..found.set.len()).collect();
    let steps = found.set.iter().filter(|it| matches!(it.claim, Claim::Step(_))).count();
    let mut causes: Vec<Cause> = Vec::new();
    let mut told: Vec<String> = Vec::new();
    for member in 0..found.set.len() {
        let claim = &found.set[member].claim;
        let key =
            if steps > 1 && matches!(claim, Claim::Step(_)) { "steps".to_string() } else { format!("{:?}", part_of(claim)) };
        if told.contains(&key) {
            continue;
        }
        told.push(key.clone());
        let same = |other: &usize| {
            let other = &found.set[*other].claim;
            part_of(other) == part_of(claim) || key == "steps" && matches!(other, Claim::Step(_))
        };
        let (members, rest): (Vec<usize>, Vec<usize>) = set.iter().copied().partition(same);
        let mut cause = if key == "steps" { teller.change_points(&members) } else { teller.cause(&members) };
        let worths: Vec<Worth> = members.iter().map(|member| worth(&search, &candidates, &set, *member)).collect();
        cause.ln_p = worths.iter().map(|it| it.ln_p).fold(0.0, f64::min);
        let score = search.score(&set);
        let odds: f64 = members.iter().map(|member| pool[*member].prior).sum();
        cause.gain = candidates[0].columns[0].len() as f64 * (search.square(&rest) / search.square(&set)).ln();
        let label = cause.label.clone();
        // What is to be told apart is told apart by the data: the odds before them (one of many places of a change, a high order) count for the confidence only.
        let mut rivals: Vec<(String, f64)> = Vec::new();
        let mut likely: Vec<(String, f64)> = Vec::new();
        for (candidate, of_rival) in search.joined(&rest) {
            let rival = pool[candidate].claim.label(sample);
            let group_is_own = members.iter().any(|member| pool[*member].group == pool[candidate].group);
            if rival == label || group_is_own {
                continue;
            }
            let by_data = of_rival - pool[candidate].prior - (score - odds);
            for (list, behind) in [(&mut rivals, by_data), (&mut likely, of_rival - score)] {
                let behind = behind.max(0.0);
                match list.iter_mut().find(|it| it.0 == rival) {
                    Some(it) => it.1 = it.1.min(behind),
                    None => list.push((rival.clone(), behind)),
                }
            }
        }
        rivals.sort_by(|a, b| a.1.total_cmp(&b.1));
        cause.indistinguishable_from = rivals.iter().filter(|it| it.1 < NEAR).map(|it| it.0.clone()).collect();
        let others: f64 = likely.iter().map(|it| (-it.1 / 2.0).exp()).sum();
        // Chance: the probability of so good a hypothesis among all, in units of its threshold.
        let chance = (cause.ln_p - thresholds.ln_p_mean).min(0.0).exp() * 0.05;
        cause.confidence = (1.0 - chance) / (1.0 + others);
        rivals.truncate(5);
        cause.rivals = rivals;
        causes.push(cause);
    }
    causes.extend(teller.outlying(thresholds));
    causes.extend(teller.growing());
    causes.extend(teller.following());
    causes.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    causes
}

/// Parts of one cause share this.
fn part_of(claim: &Claim) -> Claim {
    match claim {
        Claim::Input(extra, _) => Claim::Input(*extra, Part::Linear),
        other => other.clone(),
    }
}

struct Teller<'a> {
    sample: &'a Sample,
    found: &'a Explained,
    estimates: &'a Estimates,
}

/// A number in a sentence: four digits.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    let magnitude = value.abs().log10().floor() as i32;
    if (-4..7).contains(&magnitude) { format!("{value:.*}", (3 - magnitude).max(0) as usize) } else { format!("{value:.3e}") }
}

impl Teller<'_> {
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
            gain: 0.0,
            ln_p: 0.0,
            rivals: Vec::new(),
            indistinguishable_from: Vec::new(),
            sentence: String::new(),
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

    fn cause(&self, members: &[usize]) -> Cause {
        let member = members[0];
        let sample = self.sample;
        let response = &sample.surface.name;
        let claim = &self.found.set[member].claim;
        let label = claim.label(sample);
        match claim {
            Claim::Term(powers) => {
                let term = name_of(sample, &Monomial { powers: powers.clone(), extra: None });
                let parameter = self.parameter("coefficient", member, 0, (1.0, 0.0), self.unit());
                let sentence = format!(
                    "The surface lacks the term {term}: in coded variables it stands with {} ({} to {}).",
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
            Claim::Order(_) | Claim::Refit => self.several_terms(member, label),
            Claim::Coefficient(k) => {
                let old = sample.surface.terms[*k].coefficient;
                let term = name_of(sample, &Monomial { powers: sample.surface.terms[*k].powers.clone(), extra: None });
                let parameter = self.parameter("coefficient", member, 0, (1.0, old), self.unit());
                let sentence = format!(
                    "The coefficient of {term} is {} ({} to {}), where the file has {}.",
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
            Claim::Input(extra, _) => self.missing_input(*extra, members, label),
            Claim::Drift(clock) => self.drift(member, *clock, label),
            Claim::Step(at) => {
                let mut parameter = self.parameter("step", member, 0, (1.0, 0.0), self.unit());
                parameter.name = "step".to_string();
                let run = sample.places[*at] + 1;
                let sentence = format!(
                    "From run {run} on {response} is higher by {} ({} to {}) than the inputs say, against the runs before.",
                    self.with_unit(parameter.value),
                    number(parameter.low),
                    number(parameter.high)
                );
                let details = vec![("shape", "step".to_string()), ("from_run", run.to_string())];
                Cause { parameters: vec![parameter], details, sentence, ..self.empty("drift", label) }
            }
            Claim::Block(extra) => self.blocks(member, *extra, label),
            Claim::ResponseGain => self.sensor(response, member, "sensor-gain", ("gain", 1.0, "1"), "response", label),
            Claim::ResponseBias => self.sensor(response, member, "sensor-bias", ("bias", 0.0, self.unit()), "response", label),
            Claim::InputGain(input) => {
                let name = &sample.inputs[*input].name;
                self.sensor(name, member, "sensor-gain", ("gain", 1.0, "1"), "input", label)
            }
            Claim::InputBias(input) => {
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
        let interval = format!("({} to {})", number(parameter.low), number(parameter.high));
        let sentence = if kind == "sensor-gain" {
            format!("The sensor of {channel} reads {} times the truth {interval}.", number(parameter.value))
        } else {
            let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
            format!("The sensor of {channel} reads {}{unit} too much {interval}.", number(parameter.value))
        };
        Cause {
            subject: Some(("output", channel.to_string())),
            parameters: vec![parameter],
            details: vec![("channel", role.to_string())],
            sentence,
            ..self.empty(kind, label)
        }
    }

    /// A whole order that is missing, or all coefficients that have changed.
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
        let (kind, subject, order, sentence) = match hypothesis.claim {
            Claim::Order(order) => (
                "missing-term",
                format!("order {order}"),
                Some(("order", order.to_string())),
                format!("The surface lacks its terms of order {order}, none of which stands out alone: {}.", words.join(", ")),
            ),
            _ => (
                "coefficient-error",
                "all terms".to_string(),
                None,
                format!("The coefficients have changed, more than a sensor or a single one explains: {}.", words.join(", ")),
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
            let Claim::Input(_, part) = &hypothesis.claim else { continue };
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
            "{} acts on {} and is no input of the surface; coded to -1..1 over {} to {} {} its terms are {}.",
            it.name,
            sample.surface.name,
            number(middle - half),
            number(middle + half),
            it.unit,
            words.join(", ")
        );
        // With an offset of its own: the value of the column at which the file holds.
        if let Some(linear) = members.iter().find(|member| self.found.set[**member].claim == Claim::Input(extra, Part::Linear))
            && let [slope, offset] = self.estimates.causes[*linear].values[..]
            && slope != 0.0
        {
            let reference = middle - half * offset / slope;
            details.push(("reference", reference.to_string()));
            sentence += &format!(" The file as it is holds at {} {}.", number(reference), it.unit);
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
            sentence += &format!(" The file holds for {}, which has no offset here by that choice.", names[reference]);
        }
        let details = vec![("shape", "levels".to_string())];
        Cause { subject: Some(("column", it.name.clone())), parameters, details, sentence, ..self.empty("block-offset", label) }
    }

    /// Several changes between runs: blocks that no column names.
    fn change_points(&self, members: &[usize]) -> Cause {
        let mut steps: Vec<(usize, usize)> = members
            .iter()
            .filter_map(|member| match self.found.set[*member].claim {
                Claim::Step(at) => Some((at, *member)),
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

    fn outlying(&self, thresholds: &Thresholds) -> Option<Cause> {
        if self.found.outliers.is_empty() {
            return None;
        }
        let rows = self.sample.rows() as f64;
        let each = self.found.outliers.iter().map(|row| {
            let residual = self.sample.response[*row] - self.found.fitted[*row];
            let studentised = residual / (self.estimates.sd * self.found.scale[*row]);
            // Bonferroni over all runs.
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
            gain,
            ln_p: worst.max(1e-300).ln(),
            sentence: format!("Outlying runs, left out of every other figure: {}.", words.join(", ")),
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

    fn growing(&self) -> Option<Cause> {
        let growth = self.found.noise.growth?;
        let (residual, fitted, _) = self.kept();
        let ratio = noise::growth(&residual, &fitted).1.max(1e-9);
        // The likelihood ratio is the square of estimate over standard error (Wald).
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
                let (low, high) = fitted.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), f| (a.min(*f), b.max(*f)));
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
            "The noise changes with {}: its standard deviation at the highest fitted value is {} times that at the lowest. Fit with weights {weights}.",
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
            gain,
            ln_p,
            sentence,
            ..self.empty("growing-noise", "growing-noise".to_string())
        })
    }

    fn following(&self) -> Option<Cause> {
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
            "Errors follow each other in the run order: neighbours have a correlation of {}, Durbin and Watson's d is {} where 2 is none. Intervals here count that.",
            number(rho),
            number(watson)
        );
        let ln_p = ln_upper_f(ratio, 1.0, 1e7);
        Some(Cause {
            parameters,
            details: vec![("durbin_watson", watson.to_string())],
            confidence: 1.0 - ln_p.exp(),
            gain: ratio,
            ln_p,
            sentence,
            ..self.empty("correlated-errors", "correlated-errors".to_string())
        })
    }
}

/// What every hypothesis alone would win, the best shape of each label, best first: label, 2 ln of the likelihood ratio, ln of the probability by chance.
pub fn ranking(
    sample: &Sample,
    hypotheses: &[Hypothesis],
    thresholds: &Thresholds,
    found: &Explained,
) -> Vec<(String, f64, f64)> {
    let alone = Explained { set: Vec::new(), ..found.clone() };
    let space = alone.space(sample);
    let candidates = candidates(hypotheses, thresholds, &space);
    let search = Search::new(&candidates, &space.carried(&sample.residual()));
    let mut ranking: Vec<(String, f64, f64)> = Vec::new();
    for (candidate, hypothesis) in hypotheses.iter().enumerate() {
        let it = worth(&search, &candidates, &[candidate], candidate);
        let label = hypothesis.claim.label(sample);
        match ranking.iter_mut().find(|other| other.0 == label) {
            Some(other) if other.2 <= it.ln_p => {}
            Some(other) => (other.1, other.2) = (it.gain, it.ln_p),
            None => ranking.push((label, it.gain, it.ln_p)),
        }
    }
    ranking.sort_by(|a, b| a.2.total_cmp(&b.2));
    ranking
}

/// The upper limit of what a cause of one unknown must reach, for reports: 2 ln of the likelihood ratio at the threshold.
pub fn needed(thresholds: &Thresholds) -> f64 {
    f_of(thresholds.ln_p_mean, 1.0, 1e7)
}
