//! The equations at events.

use std::collections::HashMap;

use crate::expression::{Replacement, Symbol};
use crate::flat::{Basic, Role};

use super::work::{Residual, Work};
use super::{Alias, Event, Memory};

impl Work {
    /// The events: the same equations, with the variables that a `when` assigns among the unknowns.
    pub(super) fn events(&mut self, states: &[Symbol], unknowns: &[Symbol]) -> Option<(Vec<Memory>, Vec<Event>)> {
        self.replace_before_of_states(states);
        let clauses = self.flat.clauses.clone();
        let acts: Vec<Symbol> = (0..clauses.len()).map(|k| self.flat.derived(Role::Acts(k as u32))).collect();
        let mut equations = self.equations.clone();
        let held: Vec<Symbol> = self.held.iter().copied().collect();
        for symbol in &held {
            let before = self.flat.derived(Role::Before(*symbol));
            let mut value = self.flat.pool.symbol(before);
            let mut place = self.flat.variable(*symbol).place.clone();
            for (clause, acts) in clauses.iter().zip(&acts).rev() {
                let Some((_, given)) = clause.assigned.iter().find(|(target, _)| target == symbol) else { continue };
                let acts = self.flat.pool.symbol(*acts);
                value = self.flat.pool.choose(acts, *given, value);
                place = clause.place.clone();
            }
            let left = self.flat.pool.symbol(*symbol);
            let residual = self.flat.pool.subtract(left, value);
            equations.push(Residual { residual, sides: (left, value), place, derived_from: None });
        }
        let befores: Vec<(Symbol, Symbol)> = self
            .flat
            .symbols()
            .filter_map(|symbol| match self.flat.variable(symbol).role {
                Role::Before(of) => Some((of, symbol)),
                _ => None,
            })
            .collect();
        if clauses.is_empty() && befores.is_empty() {
            return Some((Vec::new(), Vec::new()));
        }
        let mut all = unknowns.to_vec();
        all.extend(&held);
        let matching = self.matched(&equations, &all)?;
        let solved = self.solve_blocks(&equations, &matching, &all);
        if self.has_fault {
            return None;
        }
        let (mut known, _) = self.in_known_symbols(&solved);
        let memories = befores
            .into_iter()
            .map(|(variable, before)| Memory {
                variable,
                held: if self.is_held(variable) { variable } else { before },
                before,
                next: known.of(&mut self.flat.pool, variable),
            })
            .collect();
        let events = clauses
            .iter()
            .zip(acts)
            .map(|(clause, acts)| Event {
                conditions: clause.conditions.iter().map(|id| known.replacement.of(&mut self.flat.pool, *id)).collect(),
                unless: clause.unless.clone(),
                acts,
                restarted: clause
                    .restarted
                    .iter()
                    .map(|(state, value)| (*state, known.replacement.of(&mut self.flat.pool, *value)))
                    .collect(),
            })
            .collect();
        Some((memories, events))
    }

    /// Before an event, a state has its current value until the event resets it. Other continuous variables have no memory.
    fn replace_before_of_states(&mut self, states: &[Symbol]) {
        let mut replaced = HashMap::new();
        for symbol in self.flat.symbols() {
            let Role::Before(of) = self.flat.variable(symbol).role else { continue };
            // An alias of a state is that state.
            let alias = self.aliases.get(&of).copied().unwrap_or(Alias { of, is_negative: false });
            let variable = self.flat.variable(of).clone();
            if variable.basic != Basic::Real || self.is_held(of) {
                continue;
            }
            if states.contains(&alias.of) {
                let value = self.flat.pool.symbol(alias.of);
                let value = if alias.is_negative { self.flat.pool.negate(value) } else { value };
                replaced.insert(symbol, value);
            } else {
                let what =
                    format!("`pre({})`: it is neither a state nor a variable that a `when` gives a value", variable.name);
                self.fault(
                    variable.place,
                    what,
                    "write a discrete variable that takes its value in a `when`, and `pre` of that",
                );
            }
        }
        for clause in &self.flat.clauses.clone() {
            for (target, _) in &clause.restarted {
                let alias = self.aliases.get(target).copied();
                let is_state = alias.map_or(states.contains(target), |alias| states.contains(&alias.of));
                if !is_state {
                    let variable = self.flat.variable(*target).clone();
                    let what = format!("`reinit({}, ...)`: it is not a state", variable.name);
                    self.fault(clause.place.clone(), what, "only a variable that is integrated can be restarted");
                }
            }
        }
        let aliases = self.aliases.clone();
        for k in 0..self.flat.clauses.len() {
            for (target, value) in std::mem::take(&mut self.flat.clauses[k].restarted) {
                let alias = aliases.get(&target).copied().unwrap_or(Alias { of: target, is_negative: false });
                let value = if alias.is_negative { self.flat.pool.negate(value) } else { value };
                self.flat.clauses[k].restarted.push((alias.of, value));
            }
        }
        self.replace(&mut Replacement::new(replaced));
    }
}
