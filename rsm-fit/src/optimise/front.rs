//! Fronts of responses that contradict one another: settings of which none is better than another in every response.
//!
//! In: a study with two or more objectives, and the number of points. Out: a [`Front`]. Each point minimises the largest weighted distance from the
//! ideal point, the best value of each objective alone (Bowman 1976, weighted Chebyshev distance; Steuer, Choo 1983, with a small sum of all losses
//! added). Other than weighted sums it also finds points where the front is not convex. All limits of the study hold. Low, high and importance of
//! goals do not take part: a front has directions and targets only.

use rsm_core::check::Checked;
use rsm_core::order;
use rsm_core::source::Faults;
use serde::Serialize;

use super::descent::minimum;
use super::pieces::{Group, Piece, value};
use super::{Optimum, PENALTY, STRONGER, Search, Study, Surfaces, Wish};

/// The smallest weight of an objective: at the ends of a front the others still count.
const LEAST_WEIGHT: f64 = 1e-3;

/// The factor of the sum of all losses: it excludes points that another one improves in one objective alone.
const SUM: f64 = 1e-4;

/// The number of searches for each point, beside one from the point before.
const STARTS: usize = 6;

/// Points whose losses differ by less, in units of the range of the front, are one point.
const SAME: f64 = 1e-6;

/// The largest number of points.
const MOST_POINTS: usize = 1000;

/// A front.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Front {
    /// The responses with an objective, in the order of the study.
    pub objectives: Vec<String>,
    /// The best value of each objective that the front has,
    pub best: Vec<f64>,
    /// and the worst one.
    pub worst: Vec<f64>,
    /// The points, ordered by the first objective, its best first. None is at least as good as another in all objectives and better in one.
    pub points: Vec<Optimum>,
    /// The number of points that were searched for. Points that were equal, dominated or outside a limit are left out.
    pub searched: usize,
}

/// A point of the search with its losses.
struct Candidate {
    coded: Vec<f64>,
    losses: Vec<f64>,
}

impl Study {
    /// A front of `count` points, fewer if some are equal.
    ///
    /// # Errors
    /// Every fault of the study with this model; fewer than two objectives; fewer points than objectives, or more than 1000.
    ///
    /// ```
    /// use rsm_core::{check::Checked, source::Source};
    /// use rsm_fit::optimise::{Goal, Study};
    ///
    /// let text = "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"1\"\nrange = [-1.0, 1.0]\n\
    ///     [surfaces.loss]\nunit = \"W\"\ninputs = [\"x\"]\n\
    ///     terms = [{ powers = [0], coefficient = 2.0 }, { powers = [1], coefficient = 1.0 }]\n\
    ///     [surfaces.noise]\nunit = \"dB\"\ninputs = [\"x\"]\n\
    ///     terms = [{ powers = [0], coefficient = 60.0 }, { powers = [1], coefficient = -5.0 }]\n";
    /// let model = Checked::read(&Source::new("m.toml", text))?;
    /// let front = Study::new("m")
    ///     .response("loss", Goal::Minimise { low: 1.0, high: 3.0, weight: 1.0 })
    ///     .response("noise", Goal::Minimise { low: 50.0, high: 70.0, weight: 1.0 })
    ///     .front(&model, 5)?;
    /// // Less loss is more noise along the whole range.
    /// assert_eq!(front.points.len(), 5);
    /// assert!(front.points.windows(2).all(|pair| pair[0].responses[1].value > pair[1].responses[1].value));
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    pub fn front(&self, checked: &Checked, count: usize) -> Result<Front, Faults> {
        self.check(checked)?;
        let objectives: Vec<usize> = (0..self.responses.len()).filter(|k| self.responses[*k].goal.is_objective()).collect();
        if objectives.len() < 2 {
            let what = format!(
                "a front needs two or more responses to maximise, minimise or bring to a target, found {}",
                objectives.len()
            );
            return Err(Faults::one(self.fault("responses", what)));
        }
        if !(objectives.len()..=MOST_POINTS).contains(&count) {
            let least = objectives.len();
            let what = format!("the front of {least} objectives has {count} points, expected {least} to {MOST_POINTS}");
            return Err(Faults::one(self.fault("responses", what)));
        }
        let names: Vec<&str> = self.responses.iter().map(|wish| wish.response.as_str()).collect();
        let limits = |input: &rsm_core::model::Input| self.limits_of(input);
        let surfaces = Surfaces::new(checked, &names, &limits);
        let search = Search::new(self, &surfaces);
        Ok(Tracer { search: &search, objectives: &objectives }.front(count))
    }
}

struct Tracer<'a> {
    search: &'a Search<'a>,
    objectives: &'a [usize],
}

impl Tracer<'_> {
    fn front(&self, count: usize) -> Front {
        let spreads: Vec<f64> = self.objectives.iter().map(|k| self.search.limits.spread(*k)).collect();
        let zeros = vec![0.0; self.objectives.len()];
        // The best point of each objective alone.
        let alone = |k: usize| {
            let direction: Vec<f64> = (0..zeros.len()).map(|j| f64::from(u8::from(j != k))).collect();
            let function = |coded: &[f64], penalty: f64| self.sums(coded, &direction, &spreads, penalty);
            self.best(&function, None)
        };
        let anchors: Vec<Candidate> = (0..zeros.len()).filter_map(alone).collect();
        let mut candidates = Vec::new();
        if !anchors.is_empty() {
            let of = |k: usize, pick: fn(f64, f64) -> f64, from: f64| anchors.iter().map(|it| it.losses[k]).fold(from, pick);
            let ideal: Vec<f64> = (0..zeros.len()).map(|k| of(k, f64::min, f64::INFINITY)).collect();
            let range = |k: usize| {
                let range = of(k, f64::max, f64::NEG_INFINITY) - ideal[k];
                // Objectives that agree have a front of one point.
                if range > SAME * spreads[k] { range } else { spreads[k] }
            };
            let ranges: Vec<f64> = (0..zeros.len()).map(range).collect();
            let mut before: Option<Vec<f64>> = None;
            for direction in directions(zeros.len(), count - zeros.len()) {
                let function = |coded: &[f64], penalty: f64| self.distance(coded, (&ideal, &ranges), &direction, penalty);
                if let Some(found) = self.best(&function, before.as_deref()) {
                    before = Some(found.coded.clone());
                    candidates.push(found);
                }
            }
        }
        candidates.extend(anchors);
        let mut kept = undominated(candidates);
        order::ascending(&mut kept, |it| it.losses[0]);
        let of_objective = |k: usize, place: usize| -> f64 {
            kept.get(place).map_or(f64::NAN, |it| {
                let settings = self.search.surfaces.settings(&it.coded);
                self.search.surfaces.value(self.objectives[k], &settings)
            })
        };
        let place_of = |k: usize, sign: f64| {
            let order = |a: &usize, b: &usize| (sign * kept[*a].losses[k]).total_cmp(&(sign * kept[*b].losses[k]));
            (0..kept.len()).min_by(order).unwrap_or(0)
        };
        let ends = |sign: f64| (0..zeros.len()).map(|k| of_objective(k, place_of(k, sign))).collect();
        Front {
            objectives: self.objectives.iter().map(|k| self.search.study.responses[*k].response.clone()).collect(),
            best: ends(1.0),
            worst: ends(-1.0),
            points: kept.iter().map(|it| self.search.optimum(&it.coded)).collect(),
            searched: count,
        }
    }

    /// The losses as pieces, by objective.
    fn losses(&self, responses: &[Piece]) -> Vec<Vec<Piece>> {
        let wish = |k: &usize| -> &Wish { &self.search.study.responses[*k] };
        self.objectives.iter().map(|k| wish(k).goal.losses(&responses[*k])).collect()
    }

    /// One objective, with a little of the others. `direction` is 0 for the objective.
    fn sums(&self, coded: &[f64], direction: &[f64], spreads: &[f64], penalty: f64) -> Vec<Group> {
        let responses = self.search.surfaces.responses(coded);
        let group = |((pieces, other), spread): ((Vec<Piece>, &f64), &f64)| {
            let weight = if *other > 0.0 { SUM } else { 1.0 };
            Group { weight, pieces: pieces.iter().map(|piece| scaled(piece, 0.0, *spread)).collect() }
        };
        let losses = self.losses(&responses).into_iter().zip(direction).zip(spreads);
        losses.map(group).chain(self.search.limits.penalties(coded, &responses, penalty)).collect()
    }

    /// The weighted Chebyshev distance from the ideal point, with a little of the sum.
    fn distance(&self, coded: &[f64], (ideal, ranges): (&[f64], &[f64]), direction: &[f64], penalty: f64) -> Vec<Group> {
        let responses = self.search.surfaces.responses(coded);
        let mut largest = Group { weight: 1.0, pieces: Vec::new() };
        let mut groups = Vec::new();
        for (k, pieces) in self.losses(&responses).into_iter().enumerate() {
            let far: Vec<Piece> = pieces.iter().map(|piece| scaled(piece, ideal[k], ranges[k])).collect();
            largest.pieces.extend(far.iter().map(|piece| scaled(piece, 0.0, direction[k].max(LEAST_WEIGHT))));
            groups.push(Group { weight: SUM, pieces: far });
        }
        groups.push(largest);
        groups.extend(self.search.limits.penalties(coded, &responses, penalty));
        groups
    }

    /// The best point that holds all limits, from some starts.
    fn best(&self, function: &dyn Fn(&[f64], f64) -> Vec<Group>, before: Option<&[f64]>) -> Option<Candidate> {
        let ends = &self.search.ends;
        let mut starts = self.search.starts(&|coded: &[f64]| function(coded, PENALTY), STARTS);
        starts.extend(before.map(<[f64]>::to_vec));
        let mut best: Option<(Vec<f64>, f64)> = None;
        for start in starts {
            let (mut x, _) = minimum(&|coded: &[f64]| function(coded, PENALTY), &start, ends);
            if self.search.excess(&x) > 0.0 {
                x = minimum(&|coded: &[f64]| function(coded, PENALTY * STRONGER), &x, ends).0;
            }
            let found = value(&function(&x, PENALTY));
            if self.search.limits.active_and_violated(&x).1.is_empty() && best.as_ref().is_none_or(|(_, least)| found < *least)
            {
                best = Some((x, found));
            }
        }
        let (coded, _) = best?;
        let settings = self.search.surfaces.settings(&coded);
        let loss = |k: &usize| self.search.study.responses[*k].goal.loss(self.search.surfaces.value(*k, &settings));
        let losses = self.objectives.iter().map(loss).collect();
        Some(Candidate { coded, losses })
    }
}

/// (piece - from)/scale.
fn scaled(piece: &Piece, from: f64, scale: f64) -> Piece {
    Piece { value: (piece.value - from) / scale, gradient: piece.gradient.iter().map(|g| g / scale).collect() }
}

/// Directions with entries from 0 to 1 whose sum is 1, evenly spread: all multiples of 1/h (Das, Dennis 1998), of which `count` are taken. Those of a
/// single objective are left out: its best point is known.
fn directions(width: usize, count: usize) -> Vec<Vec<f64>> {
    let mut parts = 2;
    while crate::design::count_of_terms(width - 1, parts) < count + width {
        parts += 1;
    }
    let is_inner = |powers: &Vec<u32>| powers.iter().sum::<u32>() == parts && !powers.contains(&parts);
    let all: Vec<Vec<u32>> = crate::design::monomials_up_to(width, parts).into_iter().filter(is_inner).collect();
    let place = |k: usize| if count > 1 { k * (all.len() - 1) / (count - 1) } else { all.len() / 2 };
    (0..count).map(|k| all[place(k)].iter().map(|power| f64::from(*power) / f64::from(parts)).collect()).collect()
}

/// The candidates that no other one dominates, each once.
fn undominated(candidates: Vec<Candidate>) -> Vec<Candidate> {
    let width = candidates.first().map_or(0, |it| it.losses.len());
    let range = |k: usize| {
        let of = |pick: fn(f64, f64) -> f64, from: f64| candidates.iter().map(|it| it.losses[k]).fold(from, pick);
        let range = of(f64::max, f64::NEG_INFINITY) - of(f64::min, f64::INFINITY);
        if range > 0.0 { range } else { 1.0 }
    };
    let ranges: Vec<f64> = (0..width).map(range).collect();
    let dominates = |a: &Candidate, b: &Candidate| {
        let pairs = || a.losses.iter().zip(&b.losses);
        pairs().all(|(a, b)| a <= b) && pairs().any(|(a, b)| a < b)
    };
    let is_same = |a: &Candidate, b: &Candidate| {
        a.losses.iter().zip(&b.losses).zip(&ranges).all(|((a, b), range)| (a - b).abs() <= SAME * range)
    };
    let is_best = |it: &Candidate| !candidates.iter().any(|other| dominates(other, it));
    let best: Vec<bool> = candidates.iter().map(is_best).collect();
    let mut kept: Vec<Candidate> = Vec::new();
    for (it, is_best) in candidates.into_iter().zip(best) {
        if is_best && !kept.iter().any(|other| is_same(other, &it)) {
            kept.push(it);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_spread_and_have_a_sum_of_one() {
        assert_eq!(directions(2, 3), [vec![0.75, 0.25], vec![0.5, 0.5], vec![0.25, 0.75]]);
        assert_eq!((directions(2, 1), directions(2, 0).len()), (vec![vec![0.5, 0.5]], 0));
        let of_three = directions(3, 12);
        assert_eq!(of_three.len(), 12);
        for direction in &of_three {
            assert!((direction.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{direction:?}");
        }
        assert!(of_three.iter().all(|it| !it.contains(&1.0)));
    }

    #[test]
    fn dominated_and_equal_candidates_are_left_out() {
        let candidate = |losses: [f64; 2]| Candidate { coded: Vec::new(), losses: losses.to_vec() };
        let all = [[0.0, 3.0], [1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [3.0, 0.0], [3.0, 0.0]].map(candidate);
        let kept: Vec<Vec<f64>> = undominated(all.into()).into_iter().map(|it| it.losses).collect();
        assert_eq!(kept, [[0.0, 3.0], [1.0, 1.0], [3.0, 0.0]]);
    }
}
