//! Aliases: variables that equal another variable or its negative.
//!
//! A flattened text has many aliases, because each connector repeats its variables. One variable of each group is kept, and the others refer to it.

use std::collections::HashMap;

use crate::expression::{Binary, Id, Node, Replacement, Symbol, Unary};
use crate::flat::{Basic, Role};

use super::Alias;
use super::work::Work;

/// The root of a symbol, with the relative sign.
fn root(parents: &HashMap<Symbol, Alias>, mut symbol: Symbol) -> Alias {
    let mut is_negative = false;
    while let Some(alias) = parents.get(&symbol) {
        symbol = alias.of;
        is_negative ^= alias.is_negative;
    }
    Alias { of: symbol, is_negative }
}

/// The two symbols that a residual sets equal, and whether with opposite signs.
fn pair(work: &Work, residual: Id) -> Option<(Symbol, Symbol, bool)> {
    let pool = &work.flat.pool;
    let residual = match pool.node(residual) {
        Node::Unary(Unary::Negate, inner) => inner,
        _ => residual,
    };
    let Node::Binary(operation @ (Binary::Add | Binary::Subtract), a, b) = pool.node(residual) else { return None };
    let (Node::Symbol(a), Node::Symbol(b)) = (pool.node(a), pool.node(b)) else { return None };
    Some((a, b, operation == Binary::Add))
}

impl Work {
    /// Removes equations that only state that two variables are equal or opposite.
    pub(super) fn take_aliases(&mut self) {
        let mut parents: HashMap<Symbol, Alias> = HashMap::new();
        let mut kept = Vec::new();
        for equation in std::mem::take(&mut self.equations) {
            let Some((a, b, opposite)) = pair(self, equation.residual) else {
                kept.push(equation);
                continue;
            };
            let (x, y) = (root(&parents, a), root(&parents, b));
            let (first, second) = (self.rank(x.of), self.rank(y.of));
            let (Some(first), Some(second)) = (first, second) else {
                kept.push(equation);
                continue;
            };
            let same_type = self.flat.variable(x.of).basic == self.flat.variable(y.of).basic;
            // No aliases: two equal inputs, a variable that equals itself, differences of Booleans.
            let both_known = first >= KNOWN && second >= KNOWN;
            let is_number = self.flat.variable(x.of).basic == Basic::Real;
            if x.of == y.of || both_known || !same_type || (opposite && !is_number) {
                kept.push(equation);
                continue;
            }
            let is_negative = x.is_negative ^ y.is_negative ^ opposite;
            // The variable with the higher rank is kept; of equal ranks, the one declared first.
            let x_stays = (first, std::cmp::Reverse(x.of)) > (second, std::cmp::Reverse(y.of));
            let (stays, goes) = if x_stays { (x.of, y.of) } else { (y.of, x.of) };
            parents.insert(goes, Alias { of: stays, is_negative });
        }
        self.equations = kept;
        let mut goes: Vec<Symbol> = parents.keys().copied().collect();
        goes.sort_unstable();
        let mut replaced = HashMap::new();
        for symbol in goes {
            let alias = root(&parents, symbol);
            self.hand_over(symbol, alias);
            let stays = self.flat.pool.symbol(alias.of);
            let value = if alias.is_negative { self.flat.pool.negate(stays) } else { stays };
            replaced.insert(symbol, value);
            let derivative = self.derivative_of(symbol);
            if let Some(derivative) = derivative {
                let its = self.derivative_value(alias, symbol);
                replaced.insert(derivative, its);
            }
            self.aliases.insert(symbol, alias);
        }
        self.replace(&mut Replacement::new(replaced));
    }

    /// The derivative of the remaining variable replaces that of an alias.
    fn derivative_value(&mut self, alias: Alias, symbol: Symbol) -> Id {
        match self.flat.variable(alias.of).role {
            Role::Parameter | Role::Constant => self.flat.pool.number(0.0),
            Role::Input => {
                let (name, place) = (self.flat.variable(symbol).name.clone(), self.flat.variable(symbol).place.clone());
                let input = self.flat.variable(alias.of).name.clone();
                self.fault(
                    place,
                    format!("the derivative of `{name}`, which is the input `{input}`: an input is held from row to row and has none"),
                    "filter it: der(y) = (u - y)/T gives der(y)",
                );
                self.flat.pool.number(0.0)
            }
            _ => {
                let derivative = self.flat.derived(Role::Derivative(alias.of));
                let value = self.flat.pool.symbol(derivative);
                if alias.is_negative { self.flat.pool.negate(value) } else { value }
            }
        }
    }

    /// The priority for keeping a symbol; `None` if it cannot be an alias.
    fn rank(&self, symbol: Symbol) -> Option<u32> {
        let variable = self.flat.variable(symbol);
        match variable.role {
            Role::Input => Some(KNOWN + 1),
            Role::Parameter => Some(KNOWN),
            Role::Unknown if !self.is_held(symbol) => {
                let mut rank = 0;
                if variable.is_output {
                    rank += 1;
                }
                if variable.start.is_some() {
                    rank += 2;
                }
                if self.derivative_of(symbol).is_some() {
                    rank += 4;
                }
                if variable.fixed == Some(true) {
                    rank += 8;
                }
                Some(rank + 16 * variable.preference as u32)
            }
            _ => None,
        }
    }

    /// Transfers the start attributes of an alias to the remaining variable.
    fn hand_over(&mut self, symbol: Symbol, alias: Alias) {
        let goes = self.flat.variable(symbol).clone();
        let stays = self.flat.variable(alias.of).clone();
        if goes.fixed == Some(true)
            && stays.fixed == Some(true)
            && let (Some(a), Some(b)) = (goes.start, stays.start)
        {
            let a = if alias.is_negative { self.flat.pool.negate(a) } else { a };
            if let (Some((x, _)), Some((y, _))) = (self.flat.known(a), self.flat.known(b))
                && (x - y).abs() > 1e-9 * x.abs().max(y.abs())
            {
                let what = format!("`{}` starts at {x} and its alias `{}` at {y}, and both are fixed", goes.name, stays.name);
                self.fault(goes.place.clone(), what, "leave one of the starts out");
            }
        }
        let takes_start = (stays.start.is_none() || stays.fixed != Some(true)) && goes.start.is_some();
        if takes_start && (stays.start.is_none() || goes.fixed == Some(true)) {
            let start = goes.start.map(|start| if alias.is_negative { self.flat.pool.negate(start) } else { start });
            let variable = &mut self.flat.variables[alias.of.0 as usize];
            variable.start = start;
            variable.fixed = goes.fixed.or(stays.fixed);
        }
        let variable = &mut self.flat.variables[alias.of.0 as usize];
        variable.preference = stays.preference.max(goes.preference);
        variable.nominal = stays.nominal.or(goes.nominal);
    }
}

/// Symbols with this rank or higher have a value from outside.
const KNOWN: u32 = 1000;
