//! The passes in their order, from a flat system to a solved one.

use std::collections::{HashMap, HashSet};

use crate::expression::{Id, Pool, Replacement, Symbol};
use crate::flat::Role;
use crate::units::Checked;

use super::index;
use super::matching::Matching;
use super::solve::Solved;
use super::work::{Residual, Work};
use super::{Iterated, System};

/// Values, each expressed by the values before it.
pub(super) struct Known {
    pub(super) replacement: Replacement,
}

impl Known {
    pub(super) fn of(&mut self, pool: &mut Pool, symbol: Symbol) -> Id {
        let id = pool.symbol(symbol);
        self.replacement.symbols.get(&symbol).copied().unwrap_or(id)
    }
}

impl Work {
    pub(super) fn compile(&mut self, units: Checked) -> Option<System> {
        self.settle_numbers();
        self.take_aliases();
        self.take_switches();
        if self.has_fault {
            return None;
        }
        self.check_counts();
        if self.has_fault {
            return None;
        }
        self.derive_equations();
        if self.has_fault {
            return None;
        }
        let dummies = self.dummies();
        let (states, unknowns) = self.divide(&dummies);
        let equations = self.equations.clone();
        let matching = self.matched(&equations, &unknowns)?;
        let solved = self.solve_blocks(&equations, &matching, &unknowns);
        if self.has_fault {
            return None;
        }
        let (known, iterated) = self.in_known_symbols(&solved);
        let mut known = known.replacement;
        let mut switches = self.switches.clone();
        for switch in &mut switches {
            switch.left = known.of(&mut self.flat.pool, switch.left);
            switch.right = known.of(&mut self.flat.pool, switch.right);
        }
        for check in &mut self.flat.checks {
            check.condition = known.of(&mut self.flat.pool, check.condition);
        }
        let values = known.symbols;
        let (memories, events) = self.events(&states, &unknowns)?;
        Some(System {
            flat: self.flat.clone(),
            equations: self.equations.clone(),
            initial: self.initial.clone(),
            aliases: self.aliases.clone(),
            states,
            unknowns,
            values,
            solved: solved.values,
            blocks: solved.blocks,
            iterated,
            switches,
            units,
            memories,
            events,
        })
    }

    /// Splits the variables into states and unknowns of the equations.
    fn divide(&self, dummies: &HashSet<Symbol>) -> (Vec<Symbol>, Vec<Symbol>) {
        let mut present: HashSet<Symbol> = HashSet::new();
        for equation in &self.equations {
            for symbol in self.unknowns_of(equation.residual) {
                present.insert(symbol);
                let mut inner = symbol;
                while let Role::Derivative(of) = self.flat.variable(inner).role {
                    present.insert(of);
                    inner = of;
                }
            }
        }
        let mut all: Vec<Symbol> = present.iter().copied().collect();
        all.sort_unstable();
        let is_state = |symbol: &Symbol| {
            self.derivative_of(*symbol)
                .is_some_and(|derivative| present.contains(&derivative) && !dummies.contains(&derivative))
        };
        all.into_iter().partition(is_state)
    }

    pub(super) fn matched(&mut self, equations: &[Residual], unknowns: &[Symbol]) -> Option<Matching> {
        let number: HashMap<Symbol, usize> = unknowns.iter().enumerate().map(|(k, symbol)| (*symbol, k)).collect();
        let incidence: Vec<Vec<usize>> = equations.iter().map(|equation| self.numbers_of(equation.residual, &number)).collect();
        let mut matching = Matching::new(incidence, unknowns.len());
        for (equation, residual) in equations.iter().enumerate() {
            if let Err(searched) = matching.augment(equation, |_| true) {
                let names: Vec<String> =
                    searched.unknowns.iter().map(|k| format!("`{}`", self.flat.variable(unknowns[*k]).name)).collect();
                let what = format!("this equation is one too many for {}", index::listed(&names));
                self.fault(residual.place.clone(), what, "it follows from others, or contradicts them: take it out");
            }
        }
        (!self.has_fault).then_some(matching)
    }

    /// Solved values with every solved symbol replaced, in the order of solution.
    pub(super) fn in_known_symbols(&mut self, solved: &Solved) -> (Known, Vec<Iterated>) {
        let mut replacement = Replacement::default();
        for (symbol, value) in &solved.values {
            let value = replacement.of(&mut self.flat.pool, *value);
            replacement.symbols.insert(*symbol, value);
        }
        let iterated = solved
            .iterated
            .iter()
            .map(|it| Iterated {
                value: replacement.of(&mut self.flat.pool, it.value),
                residual: replacement.of(&mut self.flat.pool, it.residual),
                ..*it
            })
            .collect();
        (Known { replacement }, iterated)
    }
}
