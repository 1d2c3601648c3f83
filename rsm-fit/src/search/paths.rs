//! Paths of models, one for each size: stepwise, and the best of each size by branch and bound.
//!
//! In: a Gram matrix. Out: a [`Path`]: for each number of terms a model, or none. The constant and additive contrasts are in every model. With
//! heredity, a term requires the terms with one power less (x^2 z requires x z and x^2), so that a shift of an input's zero gives the same model.
//!
//! Sources: Efroymson 1960 and Pudil, Novovicova, Kittler 1994 (steps in both directions); Furnival, Wilson 1974, Regressions by leaps and
//! bounds (a subset leaves at least what its superset leaves).

use super::gram::{Gram, Swept};
use crate::spec::Direction;

/// Terms with the coefficients of scaled columns.
#[derive(Debug, Clone)]
pub(super) struct Model {
    pub terms: Vec<usize>,
    pub coefficients: Vec<f64>,
    /// Whether the coefficients are shrunken.
    pub is_shrunk: bool,
}

/// Models by key. The same key means the same model size, for any rows.
pub(super) type Path = Vec<Option<Model>>;

/// The terms that each term requires.
#[derive(Debug, Clone)]
pub(super) struct Heredity {
    parents: Vec<Vec<usize>>,
    children: Vec<Vec<usize>>,
}

impl Heredity {
    /// `is_asked`: whether heredity applies; otherwise no term requires another.
    pub(super) fn of(terms: &[Vec<u32>], is_asked: bool) -> Self {
        let mut parents = vec![Vec::new(); terms.len()];
        let mut children = vec![Vec::new(); terms.len()];
        if is_asked {
            for (k, powers) in terms.iter().enumerate() {
                for place in (0..powers.len()).filter(|place| powers[*place] > 0) {
                    let mut lower = powers.clone();
                    lower[place] -= 1;
                    // With odd symmetry there may be no lower term; the constant is in every model.
                    if let Some(parent) = terms.iter().position(|other| *other == lower) {
                        parents[k].push(parent);
                        children[parent].push(k);
                    }
                }
            }
        }
        Heredity { parents, children }
    }

    fn may_enter(&self, term: usize, is_in: &[bool]) -> bool {
        self.parents[term].iter().all(|parent| is_in[*parent])
    }

    fn may_leave(&self, term: usize, is_in: &[bool]) -> bool {
        self.children[term].iter().all(|child| !is_in[*child])
    }

    fn holds(&self, is_in: &[bool]) -> bool {
        (0..is_in.len()).all(|term| !is_in[term] || self.may_enter(term, is_in))
    }

    /// The terms with all the terms that they require.
    pub(super) fn closed(&self, terms: &[usize]) -> Vec<usize> {
        let mut is_in = vec![false; self.parents.len()];
        let mut open: Vec<usize> = terms.to_vec();
        while let Some(term) = open.pop() {
            if !is_in[term] {
                is_in[term] = true;
                open.extend(&self.parents[term]);
            }
        }
        (0..is_in.len()).filter(|term| is_in[*term]).collect()
    }
}

/// The best model of each size so far.
struct Best {
    left: Vec<f64>,
    models: Path,
}

impl Best {
    fn note(&mut self, swept: &Swept) {
        let terms = swept.terms();
        let Some(left) = terms.len().checked_sub(1).and_then(|k| self.left.get_mut(k)) else { return };
        if swept.left() < *left {
            *left = swept.left();
            let coefficients = swept.coefficients(&terms);
            let size = terms.len();
            self.models[size - 1] = Some(Model { terms, coefficients, is_shrunk: false });
        }
    }
}

/// Sweeps the terms of every model. One that depends linearly on others is left out, such as the contrast of a block without rows.
pub(super) fn sweep_all(swept: &mut Swept, always: &[usize]) {
    for term in always {
        if swept.has_own_part(*term) {
            swept.sweep(*term);
        }
    }
}

pub(super) struct Steps<'a> {
    /// The terms of every model.
    pub always: &'a [usize],
    pub heredity: &'a Heredity,
    /// The largest number of terms.
    pub most: usize,
}

impl Steps<'_> {
    fn start(&self, gram: &Gram) -> (Swept, Best) {
        let mut swept = Swept::new(gram);
        sweep_all(&mut swept, self.always);
        let mut best = Best { left: vec![f64::INFINITY; self.most], models: vec![None; self.most] };
        best.note(&swept);
        (swept, best)
    }

    /// The term with the largest gain, the first of equal ones.
    fn enters(&self, swept: &Swept, is_open: impl Fn(usize) -> bool) -> Option<usize> {
        let open = (0..swept.is_in.len())
            .filter(|k| !swept.is_in[*k] && is_open(*k) && self.heredity.may_enter(*k, &swept.is_in) && swept.has_own_part(*k));
        let gains = open.map(|k| (k, swept.gain(k)));
        gains.reduce(|best, other| if other.1 > best.1 { other } else { best }).map(|(k, _)| k)
    }

    /// The term with the smallest loss.
    fn leaves(&self, swept: &Swept) -> Option<(usize, f64)> {
        let removable = (0..swept.is_in.len())
            .filter(|k| swept.is_in[*k] && !self.always.contains(k) && self.heredity.may_leave(*k, &swept.is_in));
        removable.map(|k| (k, swept.loss(k))).reduce(|best, other| if other.1 < best.1 { other } else { best })
    }

    /// Adds the best term of the lowest rung that has one; `rungs`: the order of each term.
    pub(super) fn by_rungs(&self, gram: &Gram, rungs: &[u32]) -> Path {
        let (mut swept, mut best) = self.start(gram);
        let mut rung = rungs.iter().copied().filter(|order| *order > 0).min().unwrap_or(1);
        let highest = rungs.iter().copied().max().unwrap_or(0);
        while swept.terms().len() < self.most && rung <= highest {
            match self.enters(&swept, |k| rungs[k] <= rung) {
                Some(term) => swept.sweep(term),
                None => {
                    rung += 1;
                    continue;
                }
            }
            best.note(&swept);
        }
        best.models
    }

    /// Stepwise selection in one direction, or in both.
    pub(super) fn by_steps(&self, gram: &Gram, direction: Direction) -> Path {
        let (swept, best) = self.stepped(gram, direction);
        if direction == Direction::Backward { self.backward(swept, best).models } else { best.models }
    }

    fn stepped(&self, gram: &Gram, direction: Direction) -> (Swept, Best) {
        let (mut swept, mut best) = self.start(gram);
        // The number of backward steps is limited, because each is followed by forward steps.
        let mut steps_back = 2 * self.most;
        let mut size = swept.terms().len();
        while size < self.most {
            let Some(term) = self.enters(&swept, |_| true) else { break };
            swept.sweep(term);
            size += 1;
            best.note(&swept);
            while direction == Direction::Both && steps_back > 0 && size > 2 {
                let Some((out, loss)) = self.leaves(&swept).filter(|(out, _)| *out != term) else { break };
                // Only if the smaller model is better than any of its size so far; the factor is for rounding.
                if swept.left() + loss >= best.left[size - 2] * (1.0 - 1e-9) {
                    break;
                }
                swept.sweep(out);
                size -= 1;
                steps_back -= 1;
                best.note(&swept);
            }
        }
        (swept, best)
    }

    /// From the largest model down. If there are fewer rows than terms, that is the largest model that forward steps reach.
    fn backward(&self, mut swept: Swept, best: Best) -> Best {
        let mut down = Best { left: vec![f64::INFINITY; self.most], models: vec![None; self.most] };
        down.note(&swept);
        while let Some((out, _)) = self.leaves(&swept) {
            swept.sweep(out);
            down.note(&swept);
        }
        // The model with the terms of every model only.
        let least = self.always.len().max(1) - 1;
        if let Some(smallest) = down.models.get_mut(least) {
            *smallest = smallest.take().or_else(|| best.models.into_iter().nth(least).flatten());
        }
        down
    }

    /// The best model of each size, and whether it is proved. The search ends after this many nodes.
    pub(super) fn best_subsets(&self, gram: &Gram, nodes: usize) -> (Path, bool) {
        let (swept, mut best) = self.stepped(gram, Direction::Both);
        // A backward path first gives good bounds for the search.
        let down = self.backward(swept.clone(), Best { left: Vec::new(), models: Vec::new() });
        for (k, model) in down.models.into_iter().enumerate() {
            if model.is_some() && down.left[k] < best.left[k] {
                (best.left[k], best.models[k]) = (down.left[k], model);
            }
        }
        let free: Vec<usize> = swept.terms().into_iter().filter(|term| !self.always.contains(term)).collect();
        // Candidates that are not in the largest model: too few rows for them, or linearly dependent on others.
        let is_whole = (0..swept.is_in.len()).all(|k| swept.is_in[k] || !swept.has_own_part(k));
        let mut left_nodes = nodes;
        self.branch(&swept, free, &mut best, &mut left_nodes);
        (best.models, is_whole && left_nodes > 0)
    }

    /// All subsets without some of the fitted terms `free`.
    fn branch(&self, swept: &Swept, mut free: Vec<usize>, best: &mut Best, nodes: &mut usize) {
        // The term with the largest loss first, because its many subsets can be excluded at once.
        free.sort_by(|a, b| swept.loss(*b).total_cmp(&swept.loss(*a)).then(a.cmp(b)));
        let size = swept.terms().len();
        for (k, out) in free.iter().enumerate() {
            let left = swept.left() + swept.loss(*out);
            // The sizes of the subsets without it.
            let smallest = (size - 1).saturating_sub(free.len() - k - 1).max(1);
            let may_help = (smallest..size).any(|size| best.left.get(size - 1).is_some_and(|found| left < *found));
            if !may_help {
                continue;
            }
            if *nodes == 0 {
                return;
            }
            *nodes -= 1;
            let mut child = swept.clone();
            child.sweep(*out);
            if self.heredity.holds(&child.is_in) {
                best.note(&child);
            }
            self.branch(&child, free[k + 1..].to_vec(), best, nodes);
        }
    }
}
