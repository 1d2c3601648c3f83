//! Finds the unknown that each equation determines, and the order of solution: matching and strongly connected components of graphs.
//!
//! Equations and unknowns are numbers here. No pass is recursive, because a chain of a hundred thousand equations is a path of that length.

/// Equations with their unknowns, and the current matching.
#[derive(Debug, Clone, Default)]
pub(super) struct Matching {
    /// The unknowns of each equation.
    pub(super) unknowns: Vec<Vec<usize>>,
    /// The equation of each unknown.
    pub(super) equation_of: Vec<Option<usize>>,
    /// The unknown of each equation.
    pub(super) unknown_of: Vec<Option<usize>>,
}

/// The equations and unknowns that a search visited.
#[derive(Debug, Default)]
pub(super) struct Searched {
    pub(super) equations: Vec<usize>,
    pub(super) unknowns: Vec<usize>,
}

impl Matching {
    pub(super) fn new(unknowns: Vec<Vec<usize>>, count: usize) -> Self {
        let equations = unknowns.len();
        Matching { unknowns, equation_of: vec![None; count], unknown_of: vec![None; equations] }
    }

    /// Adds an equation that is not matched yet.
    pub(super) fn add(&mut self, unknowns: Vec<usize>) -> usize {
        self.unknowns.push(unknowns);
        self.unknown_of.push(None);
        self.unknowns.len() - 1
    }

    /// Finds an unknown for an equation; other equations may change their unknown. `may` returns whether an unknown is allowed.
    ///
    /// # Errors
    /// The equations and unknowns that the search visited, if there is no augmenting path: these equations have no other unknowns.
    pub(super) fn augment(&mut self, equation: usize, may: impl Fn(usize) -> bool) -> Result<(), Searched> {
        let mut seen_unknowns = vec![false; self.equation_of.len()];
        let mut seen = Searched::default();
        // The path: an equation, and the number of its unknowns already tried.
        let mut path: Vec<(usize, usize)> = vec![(equation, 0)];
        seen.equations.push(equation);
        while let Some((at, tried)) = path.last().copied() {
            // An unmatched unknown ends the path.
            if tried == 0
                && let Some(free) = self.unknowns[at].iter().copied().find(|u| may(*u) && self.equation_of[*u].is_none())
            {
                let mut unknown = free;
                while let Some((equation, _)) = path.pop() {
                    let before = self.unknown_of[equation].replace(unknown);
                    self.equation_of[unknown] = Some(equation);
                    match before {
                        Some(before) => unknown = before,
                        None => break,
                    }
                }
                return Ok(());
            }
            let next = self.unknowns[at][tried..].iter().position(|u| may(*u) && !seen_unknowns[*u]).map(|k| tried + k);
            match next {
                Some(k) => {
                    let unknown = self.unknowns[at][k];
                    path.last_mut().expect("the path is not empty").1 = k + 1;
                    seen_unknowns[unknown] = true;
                    seen.unknowns.push(unknown);
                    let owner = self.equation_of[unknown].expect("a free unknown ends the path");
                    seen.equations.push(owner);
                    path.push((owner, 0));
                }
                None => {
                    path.pop();
                }
            }
        }
        Err(seen)
    }
}

/// The components of a graph, each after those on which it depends. Node k depends on the nodes `depends[k]`.
pub(super) fn components(depends: &[Vec<usize>]) -> Vec<Vec<usize>> {
    const NONE: usize = usize::MAX;
    let count = depends.len();
    let (mut index, mut low) = (vec![NONE; count], vec![0; count]);
    let mut on_stack = vec![false; count];
    let (mut stack, mut found) = (Vec::new(), Vec::new());
    let mut next = 0;
    for root in 0..count {
        if index[root] != NONE {
            continue;
        }
        let mut calls = vec![(root, 0)];
        while let Some((at, tried)) = calls.last().copied() {
            if tried == 0 {
                index[at] = next;
                low[at] = next;
                next += 1;
                stack.push(at);
                on_stack[at] = true;
            }
            if let Some(to) = depends[at].get(tried).copied() {
                calls.last_mut().expect("a call is open").1 += 1;
                if index[to] == NONE {
                    calls.push((to, 0));
                } else if on_stack[to] {
                    low[at] = low[at].min(index[to]);
                }
                continue;
            }
            calls.pop();
            if let Some((parent, _)) = calls.last() {
                low[*parent] = low[*parent].min(low[at]);
            }
            if low[at] == index[at] {
                let mut component = Vec::new();
                while let Some(member) = stack.pop() {
                    on_stack[member] = false;
                    component.push(member);
                    if member == at {
                        break;
                    }
                }
                component.sort_unstable();
                found.push(component);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matching_makes_room_along_a_path() {
        // 0: a b; 1: a; 2: b c
        let mut matching = Matching::new(vec![vec![0, 1], vec![0], vec![1, 2]], 3);
        for equation in 0..3 {
            matching.augment(equation, |_| true).unwrap();
        }
        assert_eq!(matching.unknown_of, [Some(1), Some(0), Some(2)]);
        assert_eq!(matching.equation_of, [Some(1), Some(0), Some(2)]);
    }

    #[test]
    fn too_many_equations_are_named() {
        let mut matching = Matching::new(vec![vec![0, 1], vec![0, 1], vec![1, 0], vec![2]], 3);
        matching.augment(0, |_| true).unwrap();
        matching.augment(1, |_| true).unwrap();
        matching.augment(3, |_| true).unwrap();
        let mut searched = matching.augment(2, |_| true).unwrap_err();
        searched.equations.sort_unstable();
        assert_eq!(searched.equations, [0, 1, 2]);
    }

    #[test]
    fn components_come_after_what_they_depend_on() {
        // 0 -> 1 -> 2 -> 1, 3 alone, 2 -> 3
        let found = components(&[vec![1], vec![2], vec![1, 3], vec![]]);
        assert_eq!(found, [vec![3], vec![1, 2], vec![0]]);
        // A long chain causes no recursion.
        let chain: Vec<Vec<usize>> = (0..200_000).map(|k| if k == 0 { vec![] } else { vec![k - 1] }).collect();
        assert_eq!(components(&chain).len(), 200_000);
    }
}
