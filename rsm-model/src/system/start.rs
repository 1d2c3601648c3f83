//! The initial values, from several sources in order of priority.
//!
//! The equations also hold at the start. Further conditions are added in this order: values given by the caller; the text's initial equations that
//! couple several unknowns; recorded values of outputs, while unknowns are undetermined; initial equations for a single unknown; fixed starts; and,
//! if something is still undetermined, the other starts of states. A surplus condition is a fault if it is a given value or if the text requires it.

use std::collections::HashMap;

use rsm_core::source::Faults;

use crate::expression::{Id, Replacement, Symbol};
use crate::flat::Role;

use super::matching::Matching;
use super::solve::Solved;
use super::work::{Residual, Work};
use super::{Alias, Iterated, System};

/// The start of a system.
#[derive(Debug, Clone)]
pub struct Start {
    /// The value of each state and of each variable that a `when` assigns, in terms of inputs, parameters, time, guesses and given values.
    pub values: Vec<(Symbol, Id)>,
    /// The unknowns that are found by iteration at the start.
    pub iterated: Vec<Iterated>,
    /// The variables whose start value in the text is used.
    pub used: Vec<Symbol>,
    /// The recorded variables that are used.
    pub recorded: Vec<Symbol>,
    /// Fixed starts in the text that the other conditions already determine. The expression is zero if they agree.
    pub redundant: Vec<(Symbol, Id)>,
}

/// A condition on the start.
struct Demand {
    equation: Residual,
    name: String,
    of: Of,
}

/// The source of a condition.
#[derive(Clone, Copy)]
enum Of {
    /// The text or a given value: a surplus condition is a fault.
    Text,
    /// An initial equation for a single unknown; a record has priority.
    Value,
    /// A record.
    Recorded(Symbol),
    /// The start of a variable.
    Start(Symbol),
}

impl System {
    /// Solves the start of the system if some of its variables are known: given ones, which are all used, and recorded ones, which are used in their
    /// order while something is undetermined. They are arguments of the result, under their own symbols.
    ///
    /// # Errors
    /// If the conditions of the text and the given values are too many, contradict one another, or leave something undetermined.
    pub fn start(&mut self, given: &[Symbol], recorded: &[Symbol]) -> Result<Start, Faults> {
        let mut work = self.again();
        let start = work.start(self, given, recorded);
        let faults = std::mem::take(&mut work.faults);
        // The pool of the system now has the expressions of the start.
        self.flat = work.flat;
        faults.finish(start)
    }
}

impl Work {
    fn start(&mut self, system: &System, given: &[Symbol], recorded: &[Symbol]) -> Option<Start> {
        let mut unknowns: Vec<Symbol> = system.unknowns.clone();
        unknowns.extend(&system.states);
        unknowns.extend(&self.held);
        let number: HashMap<Symbol, usize> = unknowns.iter().enumerate().map(|(k, symbol)| (*symbol, k)).collect();
        let mut equations = self.equations.clone();
        let incidence: Vec<Vec<usize>> = equations.iter().map(|equation| self.numbers_of(equation.residual, &number)).collect();
        let mut matching = Matching::new(incidence, unknowns.len());
        for equation in 0..equations.len() {
            // The matching is complete with fixed states, so it is complete here.
            let _ = matching.augment(equation, |_| true);
        }
        let mut wanted: Vec<Demand> = Vec::new();
        let mut known = HashMap::new();
        let mut replaced = Vec::new();
        for (symbol, is_recorded) in given.iter().map(|it| (it, false)).chain(recorded.iter().map(|it| (it, true))) {
            let alias = self.aliases.get(symbol).copied().unwrap_or(Alias { of: *symbol, is_negative: false });
            // The variable is an unknown of the start; the given value is an argument with its own symbol.
            let place = self.flat.variable(*symbol).place.clone();
            let argument = self.flat.derived(Role::Before(*symbol));
            let left = self.flat.pool.symbol(alias.of);
            let right = self.flat.pool.symbol(argument);
            let right = if alias.is_negative { self.flat.pool.negate(right) } else { right };
            known.insert(argument, *symbol);
            let name = format!("the given value of `{}`", self.flat.variable(*symbol).name);
            let equation = self.equation(left, right, place);
            if is_recorded {
                wanted.push(Demand { equation, name, of: Of::Recorded(*symbol) });
            } else {
                replaced.push(alias.of);
                wanted.push(Demand { equation, name, of: Of::Text });
            }
        }
        let mut tied = given.len();
        for equation in self.initial.clone() {
            let line = self.line(&equation.place);
            let name = format!("the initial equation of line {line}");
            // `x = 2` is like a start value: a record of x has priority.
            if self.numbers_of(equation.residual, &number).len() > 1 {
                wanted.insert(tied, Demand { equation, name, of: Of::Text });
                tied += 1;
            } else {
                wanted.push(Demand { equation, name, of: if recorded.is_empty() { Of::Text } else { Of::Value } });
            }
        }
        let mut optional = Vec::new();
        for symbol in &unknowns {
            let variable = self.flat.variable(*symbol).clone();
            let is_state = system.states.contains(symbol) || self.is_held(*symbol);
            if replaced.contains(symbol) || (!is_state && variable.fixed != Some(true)) {
                continue;
            }
            let left = self.flat.pool.symbol(*symbol);
            let right = variable.start.unwrap_or_else(|| self.flat.pool.number(0.0));
            let equation = self.equation(left, right, variable.place.clone());
            let entry = Demand { equation, name: format!("the start of `{}`", variable.name), of: Of::Start(*symbol) };
            if variable.fixed == Some(true) { wanted.push(entry) } else { optional.push(entry) }
        }
        let (mut used, mut redundant, mut taken) = (Vec::new(), Vec::new(), Vec::new());
        for Demand { equation, name, of } in wanted {
            let added = matching.add(self.numbers_of(equation.residual, &number));
            let place = equation.place.clone();
            equations.push(equation);
            match (matching.augment(added, |_| true).is_ok(), of) {
                (true, Of::Start(of)) => used.push(of),
                (true, Of::Recorded(of)) => taken.push(of),
                // A flattened text may fix the starts at both ends of a shaft. The second is checked when the first is solved.
                (false, Of::Start(of)) => redundant.push((of, equations[added].residual)),
                (true, Of::Text | Of::Value) | (false, Of::Recorded(_) | Of::Value) => {}
                (false, Of::Text) => self.fault(
                    place,
                    format!("{name} is one condition too many: the other conditions already determine the start"),
                    "leave it out, or write `fixed = false` at a start that is only a guess",
                ),
            }
        }
        for Demand { equation, of, .. } in optional {
            let added = matching.add(self.numbers_of(equation.residual, &number));
            equations.push(equation);
            if let (true, Of::Start(of)) = (matching.augment(added, |_| true).is_ok(), of) {
                used.push(of);
            }
        }
        for (k, symbol) in unknowns.iter().enumerate() {
            if matching.equation_of[k].is_none() {
                let variable = self.flat.variable(*symbol).clone();
                let what = format!("no condition determines `{}` at the start", variable.name);
                self.fault(variable.place, what, "give it `start = ...`, or write an initial equation");
            }
        }
        if self.has_fault {
            return None;
        }
        let solved = self.solve_blocks(&equations, &matching, &unknowns);
        if self.has_fault {
            return None;
        }
        let mut start = self.start_from(system, &solved, &known, (used, redundant));
        start.recorded = taken;
        self.check_redundant(&start);
        Some(start)
    }

    fn equation(&mut self, left: Id, right: Id, place: std::ops::Range<usize>) -> Residual {
        Residual { residual: self.flat.pool.subtract(left, right), sides: (left, right), place, derived_from: None }
    }

    pub(super) fn numbers_of(&self, id: Id, number: &HashMap<Symbol, usize>) -> Vec<usize> {
        self.flat.pool.symbols(id).into_iter().filter_map(|symbol| number.get(&symbol).copied()).collect()
    }

    /// The values of states in known symbols.
    fn start_from(
        &mut self,
        system: &System,
        solved: &Solved,
        known: &HashMap<Symbol, Symbol>,
        (used, redundant): (Vec<Symbol>, Vec<(Symbol, Id)>),
    ) -> Start {
        let (mut all, iterated) = self.in_known_symbols(solved);
        // A given value is an argument with the symbol of its variable.
        let mut given =
            Replacement::new(known.iter().map(|(argument, symbol)| (*argument, self.flat.pool.symbol(*symbol))).collect());
        let mut of = |work: &mut Self, id: Id| given.of(&mut work.flat.pool, id);
        let targets: Vec<Symbol> = system.states.iter().chain(&self.held).copied().collect();
        let values = targets
            .into_iter()
            .map(|symbol| {
                let value = all.of(&mut self.flat.pool, symbol);
                (symbol, of(self, value))
            })
            .collect();
        let iterated = iterated
            .into_iter()
            .map(|it| Iterated { value: of(self, it.value), residual: of(self, it.residual), ..it })
            .collect();
        let redundant = redundant
            .into_iter()
            .map(|(symbol, residual)| {
                let residual = all.replacement.of(&mut self.flat.pool, residual);
                (symbol, of(self, residual))
            })
            .collect();
        Start { values, iterated, used, recorded: Vec::new(), redundant }
    }

    /// Reports starts that contradict the other conditions, if the text alone shows it.
    fn check_redundant(&mut self, start: &Start) {
        for (symbol, residual) in &start.redundant {
            let Some((off, _)) = self.flat.known(*residual) else { continue };
            let variable = self.flat.variable(*symbol).clone();
            let value = variable.start.and_then(|start| self.flat.known(start)).map_or(0.0, |(value, _)| value);
            // Starts are written with at least six digits. For a start of 0, a thousandth of a unit counts as small.
            if off.abs() > 1e-6 * value.abs().max(variable.nominal.unwrap_or(1e-3).abs()) {
                let what = format!(
                    "the start of `{}` is one condition too many: the other conditions determine it as {}",
                    variable.name,
                    value + off
                );
                self.fault(variable.place, what, "leave it out, or write `fixed = false` where it is only a guess");
            }
        }
    }
}
