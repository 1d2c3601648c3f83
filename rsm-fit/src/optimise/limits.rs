//! The limits of settings: bounds of responses, conditions on inputs, supports, operating limits.
//!
//! In: a study and its surfaces. Out: each limit as a function that is at most 0 where it holds, scaled; penalties for a search; what is active or
//! violated at a point, with names.

use serde::Serialize;

use super::desirability::Goal;
use super::pieces::{Group, Piece};
use super::study::Study;
use super::surfaces::Surfaces;

/// A search keeps this distance from a limit, so that the limit also holds after rounding. Limits of responses are scaled by their spread over the
/// box, those of inputs by half ranges.
const MARGIN: f64 = 1e-8;

/// A limit nearer than this is active: a hundred times what a search leaves.
const ACTIVE: f64 = 1e-6;

/// A bound of a response counts as met with this violation, in units of its spread: rounding of its evaluation.
const MET: f64 = 1e-12;

/// A limit that settings touch or violate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limit {
    /// `input`, `response`, `condition` or `support`.
    pub kind: &'static str,
    /// The name of the input, of the response or of the surface; the number of the condition.
    pub name: String,
    /// `low` or `high`.
    pub end: &'static str,
    /// The value of the bound; of a support 0.
    pub bound: f64,
    /// How far it is exceeded; negative inside. In the unit of the bound; for a support in coded units.
    pub excess: f64,
}

/// A bound of a response.
struct Bound {
    response: usize,
    end: &'static str,
    value: f64,
}

/// All limits but the box.
pub(super) struct Limits<'a> {
    study: &'a Study,
    surfaces: &'a Surfaces<'a>,
    bounds: Vec<Bound>,
    /// The spread of each response over the box.
    spreads: Vec<f64>,
    /// Weights of the inputs and the bound of each condition.
    conditions: Vec<(usize, &'static str, Vec<f64>, f64)>,
}

/// A limit at a point, scaled.
pub(super) struct Scaled {
    pub kind: &'static str,
    name: String,
    end: &'static str,
    bound: f64,
    scale: f64,
    /// At most 0 where it holds.
    pub excess: f64,
    gradient: Vec<f64>,
}

impl<'a> Limits<'a> {
    pub(super) fn new(study: &'a Study, surfaces: &'a Surfaces<'a>, pool: &[Vec<f64>]) -> Limits<'a> {
        let mut bounds = Vec::new();
        for (response, wish) in study.responses.iter().enumerate() {
            let [mut low, mut high] = [wish.at_least, wish.at_most];
            if let Goal::InRange { low: least, high: most } = wish.goal {
                let tighter = |one: Option<f64>, other: Option<f64>, pick: fn(f64, f64) -> f64| match (one, other) {
                    (Some(one), Some(other)) => Some(pick(one, other)),
                    (one, other) => one.or(other),
                };
                (low, high) = (tighter(low, least, f64::max), tighter(high, most, f64::min));
            }
            bounds.extend(low.map(|value| Bound { response, end: "low", value }));
            bounds.extend(high.map(|value| Bound { response, end: "high", value }));
        }
        let mut ends = vec![[f64::INFINITY, f64::NEG_INFINITY]; study.responses.len()];
        for point in pool {
            let settings = surfaces.settings(point);
            for (k, end) in ends.iter_mut().enumerate() {
                let value = surfaces.value(k, &settings);
                *end = [end[0].min(value), end[1].max(value)];
            }
        }
        // A response that does not change has any scale.
        let spreads = ends.iter().map(|[low, high]| if high > low { high - low } else { 1.0 }).collect();
        let mut conditions = Vec::new();
        for (k, sum) in study.conditions.iter().enumerate() {
            let mut weights = vec![0.0; surfaces.inputs.len()];
            for (name, weight) in &sum.weights {
                if let Some(place) = surfaces.inputs.iter().position(|input| input.name == *name) {
                    weights[place] += weight;
                }
            }
            conditions.extend(sum.at_least.map(|bound| (k, "low", weights.clone(), bound)));
            conditions.extend(sum.at_most.map(|bound| (k, "high", weights.clone(), bound)));
        }
        Limits { study, surfaces, bounds, spreads, conditions }
    }

    /// The spread of a response over the box.
    pub(super) fn spread(&self, response: usize) -> f64 {
        self.spreads[response]
    }

    /// The desirability of a value. A range that is met to rounding counts as met.
    pub(super) fn desirability(&self, response: usize, value: f64) -> f64 {
        let goal = self.study.responses[response].goal;
        let near = MET * self.spreads[response];
        let inside = match goal {
            Goal::InRange { low, high } => value.max(low.unwrap_or(value)).min(high.unwrap_or(f64::INFINITY)),
            _ => value,
        };
        goal.desirability(if (inside - value).abs() <= near { inside } else { value })
    }

    fn all(&self, coded: &[f64], responses: &[Piece]) -> Vec<Scaled> {
        let signed = |end: &str| if end == "high" { 1.0 } else { -1.0 };
        let mut all = Vec::new();
        for bound in &self.bounds {
            let (response, scale) = (&responses[bound.response], self.spreads[bound.response]);
            let sign = signed(bound.end) / scale;
            all.push(Scaled {
                kind: "response",
                name: self.study.responses[bound.response].response.clone(),
                end: bound.end,
                bound: bound.value,
                scale,
                excess: sign * (response.value - bound.value),
                gradient: response.gradient.iter().map(|g| sign * g).collect(),
            });
        }
        let settings = self.surfaces.settings(coded);
        for (k, end, weights, bound) in &self.conditions {
            let slopes: Vec<f64> =
                self.surfaces.free.iter().map(|place| weights[*place] * self.surfaces.half(*place)).collect();
            let length = slopes.iter().map(|slope| slope * slope).sum::<f64>().sqrt();
            let scale = if length > 0.0 { length } else { 1.0 };
            let sign = signed(end) / scale;
            let sum: f64 = weights.iter().zip(&settings).map(|(weight, x)| weight * x).sum();
            all.push(Scaled {
                kind: "condition",
                name: (k + 1).to_string(),
                end,
                bound: *bound,
                scale,
                excess: sign * (sum - bound),
                gradient: slopes.iter().map(|slope| sign * slope).collect(),
            });
        }
        if self.study.support {
            let supports = self.surfaces.supports(coded);
            all.extend(supports.into_iter().map(|(name, piece)| Scaled {
                kind: "support",
                name: name.to_string(),
                end: "high",
                bound: 0.0,
                scale: 1.0,
                excess: piece.value,
                gradient: piece.gradient,
            }));
        }
        all
    }

    /// All limits at a point.
    pub(super) fn at(&self, coded: &[f64]) -> Vec<Scaled> {
        self.all(coded, &self.surfaces.responses(coded))
    }

    /// The penalties of a search.
    pub(super) fn penalties(&self, coded: &[f64], responses: &[Piece], penalty: f64) -> Vec<Group> {
        let group = |limit: Scaled| {
            let none = Piece { value: 0.0, gradient: vec![0.0; coded.len()] };
            Group { weight: penalty, pieces: vec![none, Piece { value: limit.excess + MARGIN, gradient: limit.gradient }] }
        };
        self.all(coded, responses).into_iter().map(group).collect()
    }

    /// The limits that a point touches, and those that it violates.
    pub(super) fn active_and_violated(&self, coded: &[f64]) -> (Vec<Limit>, Vec<Limit>) {
        let mut active: Vec<Limit> = Vec::new();
        for (variable, place) in self.surfaces.free.iter().enumerate() {
            for (end, at) in [("low", -1.0), ("high", 1.0)] {
                let distance = (coded[variable] - at).abs();
                if distance <= ACTIVE {
                    let bound = self.surfaces.limits[*place][usize::from(at > 0.0)];
                    let name = self.surfaces.inputs[*place].name.clone();
                    let excess = -distance * self.surfaces.half(*place) + 0.0;
                    active.push(Limit { kind: "input", name, end, bound, excess });
                }
            }
        }
        let mut violated = Vec::new();
        for limit in self.at(coded) {
            let found = Limit {
                kind: limit.kind,
                name: limit.name,
                end: limit.end,
                bound: limit.bound,
                excess: limit.excess * limit.scale,
            };
            if limit.excess > MET {
                violated.push(found);
            } else if limit.excess >= -ACTIVE {
                active.push(found);
            }
        }
        (active, violated)
    }
}
