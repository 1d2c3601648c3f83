//! Replaces laws: substitution in equations, readings, delays.
//!
//! In: a role of a site and a law. Out: equations with the law.

use std::collections::HashMap;

use crate::expression::{Id, Replacement, Symbol};
use crate::flat::{Flat, Role, Value};
use crate::syntax::tree::Expression;

use super::places::Bound;
use super::{Context, Delay, LateReading, Rewriter};
use crate::effects::site::SiteKind;
use crate::effects::terms;

impl Rewriter {
    /// Declares another variable with the properties of an existing one.
    pub(super) fn sibling(&mut self, of: Symbol, word: &str) -> Symbol {
        let variable = self.flat.variable(of).clone();
        let symbol = self.flat.declare(&format!("{} ({word})", variable.name), Role::Unknown, variable.place.clone());
        let new = &mut self.flat.variables[symbol.0 as usize];
        (new.unit, new.nominal) = (variable.unit, variable.nominal);
        symbol
    }

    pub(super) fn replace(
        &mut self,
        context: &Context<'_>,
        role: &str,
        law: &Value,
        written: &Expression,
    ) -> Result<(), String> {
        let Context { site, base, apart, .. } = *context;
        if site.kind == SiteKind::Output {
            return self.reading(context, role, law, written);
        }
        let old = site.role(role).cloned().ok_or_else(|| site.no_variable(role))?;
        if old.items.len() != law.items.len() {
            return Err(format!("the law of `{role}` gives {}, expected {}", law.shape(), old.shape()));
        }
        if site.is_balanced(role) || role == "load" {
            let (old, new) = (old.items[0], law.items[0]);
            let more = self.flat.pool.subtract(new, old);
            let less = self.flat.pool.negate(more);
            let effort = if role == "load" {
                self.set_role(site, role, new);
                less
            } else {
                let state = site.kind.balance().map_or("", |it| it.0);
                let symbol = site.symbol(&self.flat, state).ok_or_else(|| site.no_variable(state))?;
                let derivative = self.flat.derived(Role::Derivative(symbol));
                let derivative = self.flat.pool.symbol(derivative);
                self.flat.pool.multiply(less, derivative)
            };
            return self.add(site, effort);
        }
        let mut replaced = HashMap::new();
        let mut given = Vec::new();
        for (k, (item, law)) in old.items.iter().zip(&law.items).enumerate() {
            let symbol = terms::symbol_of(&self.flat, *item).ok_or_else(|| site.no_variable(role))?;
            if apart.get(role).is_some_and(|it| it[k]) {
                given.push((*item, *law));
                continue;
            }
            let is_number = |it: &Symbol| matches!(self.flat.variable(*it).role, Role::Parameter | Role::Constant);
            if is_number(&symbol) && self.flat.pool.symbols(*law).iter().all(is_number) {
                if self.flat.variable(symbol).is_structural {
                    return Err(format!(
                        "`{}` determines the structure of the equations, so an effect cannot change it: set it under [parameters]",
                        self.flat.variable(symbol).name
                    ));
                }
                replaced.insert(symbol, *law);
                continue;
            }
            let new = self.sibling(symbol, "here");
            let new = self.flat.pool.symbol(new);
            replaced.insert(symbol, new);
            given.push((new, *law));
        }
        self.substitute(&replaced, false);
        for (left, right) in given {
            self.equation(left, right, base, written);
        }
        Ok(())
    }

    /// Changes readings: the true value gets a separate name, and everything except the outputs uses it.
    pub(super) fn reading(
        &mut self,
        context: &Context<'_>,
        role: &str,
        law: &Value,
        written: &Expression,
    ) -> Result<(), String> {
        let Context { placed, site, base, .. } = *context;
        let items = site.role(role).map(|it| it.items.clone()).ok_or_else(|| site.no_variable(role))?;
        if items.len() != law.items.len() {
            return Err(format!("the law of `{role}` gives {}, expected the shape of `{role}`", law.shape()));
        }
        let mut replaced = HashMap::new();
        let mut given = Vec::new();
        for (item, law) in items.iter().zip(&law.items) {
            let symbol = terms::symbol_of(&self.flat, *item).ok_or_else(|| site.no_variable(role))?;
            if self.flat.variable(symbol).is_output {
                let truth = self.sibling(symbol, "true");
                self.hand_over(symbol, truth, &mut replaced);
                if !placed.effect.reads_back {
                    self.read_of.push((symbol, truth));
                }
                given.push((*item, *law));
                continue;
            }
            for k in 0..self.flat.equations.len() {
                let (left, right) = (self.flat.equations[k].left, self.flat.equations[k].right);
                for (own, other, is_left) in [(left, right, true), (right, left, false)] {
                    let reads = terms::symbol_of(&self.flat, other).is_some_and(|it| self.flat.variable(it).is_output);
                    if own == *item && reads {
                        let it = &mut self.flat.equations[k];
                        if is_left { it.left = *law } else { it.right = *law }
                    }
                }
            }
        }
        self.substitute(&replaced, true);
        let mut replacement = Replacement::new(replaced);
        for (left, law) in given {
            let right = replacement.of(&mut self.flat.pool, law);
            self.equation(left, right, base, written);
        }
        Ok(())
    }

    /// Moves properties from the reading to the true value: start, bounds, derivatives, the value before an event.
    pub(super) fn hand_over(&mut self, reading: Symbol, truth: Symbol, replaced: &mut HashMap<Symbol, Id>) {
        let old = self.flat.variable(reading).clone();
        let new = &mut self.flat.variables[truth.0 as usize];
        (new.start, new.fixed, new.min, new.max, new.nominal) = (old.start, old.fixed, old.min, old.max, old.nominal);
        (new.preference, new.basic, new.is_discrete, new.description) =
            (old.preference, old.basic, old.is_discrete, old.description);
        let it = &mut self.flat.variables[reading.0 as usize];
        (it.start, it.fixed, it.is_discrete, it.preference) = (None, None, false, crate::flat::Preference::Default);
        replaced.insert(reading, self.flat.pool.symbol(truth));
        let (mut from, mut to) = (reading, truth);
        while let Some(derivative) = self.flat.find(&format!("der({})", self.flat.variable(from).name)) {
            let new = self.flat.derived(Role::Derivative(to));
            replaced.insert(derivative, self.flat.pool.symbol(new));
            (from, to) = (derivative, new);
        }
        if let Some(before) = self.flat.find(&format!("pre({})", self.flat.variable(reading).name)) {
            let new = self.flat.derived(Role::Before(truth));
            replaced.insert(before, self.flat.pool.symbol(new));
        }
    }

    pub(super) fn delay(&mut self, site: &Bound, delay: Id) -> Result<(), String> {
        let items = site.role("signal").map(|it| it.items.clone()).ok_or_else(|| site.no_variable("signal"))?;
        let mut replaced = HashMap::new();
        for item in items {
            let symbol = terms::symbol_of(&self.flat, item).ok_or_else(|| site.no_variable("signal"))?;
            if site.kind == SiteKind::Output {
                self.late_readings.push(LateReading { output: symbol, delay });
                continue;
            }
            let holds = |symbol: Symbol| {
                self.flat.variable(symbol).role == Role::Input
                    || self.flat.clauses.iter().any(|it| it.assigned.iter().any(|(to, _)| *to == symbol))
            };
            let of = if holds(symbol) {
                Some(symbol)
            } else {
                terms::law(&self.flat, symbol).and_then(|it| terms::symbol_of(&self.flat, it)).filter(|it| holds(*it))
            };
            let Some(of) = of else {
                return Err(format!(
                    "`{}` changes continuously: only an input, or a signal that is held between samples, can be delayed",
                    self.flat.variable(symbol).name
                ));
            };
            let variable = self.flat.variable(of).clone();
            let late = self.flat.declare(&format!("{} (late)", variable.name), Role::Input, variable.place.clone());
            self.flat.variables[late.0 as usize].unit = variable.unit;
            let late_id = self.flat.pool.symbol(late);
            if symbol == of {
                replaced.insert(symbol, late_id);
            } else if let Some(equation) = terms::definition(&self.flat, symbol) {
                self.flat.equations[equation].left = item;
                self.flat.equations[equation].right = late_id;
            }
            self.delays.push(Delay { late, of, delay });
        }
        self.substitute(&replaced, false);
        Ok(())
    }

    /// Replaces symbols by expressions in all equations and sites. With `moves`, also in the assignments of a `when`.
    pub(super) fn substitute(&mut self, replaced: &HashMap<Symbol, Id>, moves: bool) {
        if replaced.is_empty() {
            return;
        }
        let mut replacement = Replacement::new(replaced.clone());
        let flat = &mut self.flat;
        let pool = &mut flat.pool;
        let (first, first_initial) = if moves { (usize::MAX, usize::MAX) } else { self.own };
        let (equations, initial) = (&mut flat.equations, &mut flat.initial_equations);
        for equation in equations.iter_mut().take(first).chain(initial.iter_mut().take(first_initial)) {
            equation.left = replacement.of(pool, equation.left);
            equation.right = replacement.of(pool, equation.right);
            for (left, right) in &mut equation.pairs {
                (*left, *right) = (replacement.of(pool, *left), replacement.of(pool, *right));
            }
        }
        let target = |symbol: &mut Symbol, pool: &crate::expression::Pool| {
            if let Some(new) = replaced.get(symbol).filter(|_| moves)
                && let crate::expression::Node::Symbol(new) = pool.node(*new)
            {
                *symbol = new;
            }
        };
        for clause in &mut flat.clauses {
            for condition in &mut clause.conditions {
                *condition = replacement.of(pool, *condition);
            }
            for (symbol, value) in clause.assigned.iter_mut().chain(&mut clause.restarted) {
                *value = replacement.of(pool, *value);
                target(symbol, pool);
            }
        }
        for check in &mut flat.checks {
            check.condition = replacement.of(pool, check.condition);
        }
        // A parameter that depends on a replaced one now depends on the replacement, if that is constant too.
        for k in 0..flat.variables.len() {
            let is_number = |it: &Symbol, flat: &Flat| matches!(flat.variable(*it).role, Role::Parameter | Role::Constant);
            let role = flat.variables[k].role;
            if role == Role::Parameter && replaced.contains_key(&Symbol(k as u32)) {
                continue;
            }
            for which in 0..2 {
                let value = if which == 0 { flat.variables[k].value } else { flat.variables[k].start };
                let Some(value) = value else { continue };
                let new = replacement.of(&mut flat.pool, value);
                if flat.pool.symbols(new).iter().all(|it| is_number(it, flat)) {
                    let variable = &mut flat.variables[k];
                    if which == 0 { variable.value = Some(new) } else { variable.start = Some(new) }
                }
            }
        }
        for delay in &mut self.delays {
            if let Some(crate::expression::Node::Symbol(new)) =
                replaced.get(&delay.of).filter(|_| moves).map(|it| self.flat.pool.node(*it))
            {
                delay.of = new;
            }
        }
        for site in self.sites.iter_mut().filter(|it| it.kind != SiteKind::Output) {
            for (_, value) in &mut site.roles {
                for item in &mut value.items {
                    *item = replacement.of(&mut self.flat.pool, *item);
                }
            }
        }
    }
}
