//! The system during compilation: equations as residuals, and data that the passes share.

use std::collections::{BTreeSet, HashMap};
use std::ops::Range;

use rsm_core::source::Collector;

use crate::expression::{Binary, Id, Node, Replacement, Symbol, operate, operate_unary};
use crate::flat::{Basic, Flat, Role};

use super::{Alias, Switch};

/// An equation: its residual is zero.
#[derive(Debug, Clone)]
pub(super) struct Residual {
    pub(super) residual: Id,
    /// The two sides as written, with aliases replaced.
    pub(super) sides: (Id, Id),
    pub(super) place: Range<usize>,
    /// The equation whose derivative this is.
    pub(super) derived_from: Option<usize>,
}

pub(super) struct Work {
    pub(super) flat: Flat,
    pub(super) faults: Collector,
    pub(super) has_fault: bool,
    pub(super) equations: Vec<Residual>,
    pub(super) initial: Vec<Residual>,
    /// Variables that a `when` assigns.
    pub(super) held: BTreeSet<Symbol>,
    pub(super) aliases: HashMap<Symbol, Alias>,
    pub(super) switches: Vec<Switch>,
    /// A point near the start, at which choices are made.
    point: HashMap<Symbol, f64>,
    /// Values at that point, and whether they are constant (a cache).
    looked: HashMap<Id, (f64, bool)>,
}

impl Work {
    pub(super) fn new(flat: Flat) -> Self {
        let held = flat.clauses.iter().flat_map(|clause| clause.assigned.iter().map(|(symbol, _)| *symbol)).collect();
        let mut work = Work {
            flat,
            faults: Collector::new(),
            has_fault: false,
            equations: Vec::new(),
            initial: Vec::new(),
            held,
            aliases: HashMap::new(),
            switches: Vec::new(),
            point: HashMap::new(),
            looked: HashMap::new(),
        };
        work.equations = work.residuals(&work.flat.equations.clone());
        work.initial = work.residuals(&work.flat.initial_equations.clone());
        work
    }

    fn residuals(&mut self, equations: &[crate::flat::Equation]) -> Vec<Residual> {
        equations
            .iter()
            .map(|equation| Residual {
                residual: self.flat.pool.subtract(equation.left, equation.right),
                sides: (equation.left, equation.right),
                place: equation.place.clone(),
                derived_from: None,
            })
            .collect()
    }

    pub(super) fn fault(&mut self, place: Range<usize>, what: impl Into<String>, help: &str) {
        self.has_fault = true;
        let fault = self.flat.fault(&place, what);
        self.faults.push(if help.is_empty() { fault } else { fault.help(help) });
    }

    /// Whether a `when` assigns the variable.
    pub(super) fn is_held(&self, symbol: Symbol) -> bool {
        self.held.contains(&symbol)
    }

    /// The symbol of a derivative, if it exists.
    pub(super) fn derivative_of(&self, symbol: Symbol) -> Option<Symbol> {
        self.flat.find(&format!("der({})", self.flat.variable(symbol).name))
    }

    /// The line of a position.
    pub(super) fn line(&self, place: &Range<usize>) -> usize {
        self.flat.line(place)
    }

    /// Replaces symbols everywhere.
    pub(super) fn replace(&mut self, replacement: &mut Replacement) {
        let pool = &mut self.flat.pool;
        for equation in self.equations.iter_mut().chain(&mut self.initial) {
            equation.residual = replacement.of(pool, equation.residual);
            equation.sides = (replacement.of(pool, equation.sides.0), replacement.of(pool, equation.sides.1));
        }
        for clause in &mut self.flat.clauses {
            for condition in &mut clause.conditions {
                *condition = replacement.of(pool, *condition);
            }
            for (_, value) in clause.assigned.iter_mut().chain(&mut clause.restarted) {
                *value = replacement.of(pool, *value);
            }
        }
        for check in &mut self.flat.checks {
            check.condition = replacement.of(pool, check.condition);
        }
        for sample in &mut self.flat.samples {
            sample.start = replacement.of(pool, sample.start);
            sample.period = replacement.of(pool, sample.period);
        }
        for variable in &mut self.flat.variables {
            variable.start = variable.start.map(|start| replacement.of(pool, start));
        }
        for switch in &mut self.switches {
            switch.left = replacement.of(pool, switch.left);
            switch.right = replacement.of(pool, switch.right);
        }
    }

    /// Substitutes constants, structural parameters and parameters that depend on others.
    pub(super) fn settle_numbers(&mut self) {
        let mut replaced: HashMap<Symbol, Id> = HashMap::new();
        for symbol in self.flat.symbols() {
            let mut open = vec![symbol];
            while let Some(at) = open.last().copied() {
                let variable = self.flat.variable(at);
                let value = variable.value.filter(|_| !replaced.contains_key(&at));
                let is_free = variable.role == Role::Parameter && !variable.is_structural;
                let Some(value) = value.filter(|value| !(is_free && self.flat.pool.value(*value).is_some())) else {
                    open.pop();
                    continue;
                };
                let missing = self.flat.pool.symbols(value).into_iter().find(|inner| {
                    let inner_variable = self.flat.variable(*inner);
                    let settles = inner_variable.value.is_some_and(|value| {
                        inner_variable.role == Role::Constant
                            || inner_variable.is_structural
                            || self.flat.pool.value(value).is_none()
                    });
                    settles && !replaced.contains_key(inner)
                });
                match missing {
                    Some(missing) if open.contains(&missing) => {
                        let (name, place) =
                            (self.flat.variable(missing).name.clone(), self.flat.variable(missing).place.clone());
                        self.fault(place, format!("the value of `{name}` depends on itself"), "");
                        return;
                    }
                    Some(missing) => open.push(missing),
                    None => {
                        let unknown = self
                            .flat
                            .pool
                            .symbols(value)
                            .into_iter()
                            .find(|inner| !matches!(self.flat.variable(*inner).role, Role::Constant | Role::Parameter));
                        if let Some(unknown) = unknown {
                            let what = format!(
                                "the value of `{}` depends on `{}`, which changes while the model runs",
                                self.flat.variable(at).name,
                                self.flat.variable(unknown).name
                            );
                            let place = self.flat.variable(at).place.clone();
                            self.fault(place, what, "declare it as a variable");
                        }
                        let settled = Replacement::new(replaced.clone()).of(&mut self.flat.pool, value);
                        replaced.insert(at, settled);
                        open.pop();
                    }
                }
            }
        }
        for (symbol, value) in &replaced {
            self.flat.variables[symbol.0 as usize].value = Some(*value);
        }
        self.replace(&mut Replacement::new(replaced));
    }

    /// Converts comparisons of continuous values to switches. Comparisons of values that change only at events stay as they are.
    pub(super) fn take_switches(&mut self) {
        let mut roots: Vec<Id> = self.equations.iter().flat_map(|e| [e.residual, e.sides.0, e.sides.1]).collect();
        roots.extend(self.flat.clauses.iter().flat_map(|clause| clause.conditions.iter().copied()));
        roots.extend(self.initial.iter().flat_map(|e| [e.residual, e.sides.0, e.sides.1]));
        let mut new: HashMap<Id, Id> = HashMap::new();
        for id in self.flat.pool.reachable(&roots) {
            let mut of = |operand: Id| new.get(&operand).copied().unwrap_or(operand);
            let rebuilt = match self.flat.pool.node(id) {
                Node::Binary(Binary::Less, a, b) => {
                    let (a, b) = (of(a), of(b));
                    if self.changes_between_events(a) || self.changes_between_events(b) {
                        let number = self.switches.len() as u32;
                        let held = self.flat.derived(Role::Held(number));
                        self.switches.push(Switch { left: a, right: b, held });
                        self.flat.pool.symbol(held)
                    } else {
                        self.flat.pool.binary(Binary::LessNow, a, b)
                    }
                }
                _ => self.flat.pool.rebuilt(id, &mut of),
            };
            if rebuilt != id {
                new.insert(id, rebuilt);
            }
        }
        let of = |id: Id| new.get(&id).copied().unwrap_or(id);
        for equation in self.equations.iter_mut().chain(&mut self.initial) {
            equation.residual = of(equation.residual);
            equation.sides = (of(equation.sides.0), of(equation.sides.1));
        }
        for clause in &mut self.flat.clauses {
            for condition in &mut clause.conditions {
                *condition = of(*condition);
            }
        }
    }

    fn changes_between_events(&self, id: Id) -> bool {
        self.flat.pool.symbols(id).into_iter().any(|symbol| {
            let variable = self.flat.variable(symbol);
            match variable.role {
                Role::Time | Role::Derivative(_) => true,
                Role::Unknown => variable.basic == Basic::Real && !variable.is_discrete,
                _ => false,
            }
        })
    }

    /// A generic point near the start: the starts in the text, slightly changed, so that a coefficient that is accidentally zero there is not taken
    /// for zero.
    pub(super) fn number_at(&mut self, symbol: Symbol) -> f64 {
        if let Some(value) = self.point.get(&symbol) {
            return *value;
        }
        let variable = self.flat.variable(symbol).clone();
        let start = variable.start.and_then(|start| self.flat.known(start)).map_or(0.0, |(value, _)| value);
        let value = match variable.role {
            Role::Constant | Role::Parameter => {
                variable.value.and_then(|value| self.flat.known(value)).map_or(f64::NAN, |(value, _)| value)
            }
            Role::Before(of) | Role::Guess(of) => self.number_at(of),
            Role::Sample(_) | Role::Acts(_) => 0.0,
            Role::Held(_) => 1.0,
            _ if variable.basic != Basic::Real => start,
            _ => {
                // Fractional parts of multiples of the golden section: evenly spread, and the same in every run.
                let spread = (f64::from(symbol.0) * 0.618_033_988_749_895).fract() + 0.5;
                start + 1e-2 * spread * variable.nominal.unwrap_or(1.0).abs().max(1e-2 * start.abs())
            }
        };
        self.point.insert(symbol, value);
        value
    }

    /// The value of an expression at that point, and whether it consists of numbers and parameters only. Results are cached, because elimination
    /// evaluates every entry many times.
    fn looked_at(&mut self, root: Id) -> (f64, bool) {
        let mut open = vec![root];
        while let Some(id) = open.last().copied() {
            if self.looked.contains_key(&id) {
                open.pop();
                continue;
            }
            let before = open.len();
            self.flat.pool.operands(id, |operand| {
                if !self.looked.contains_key(&operand) {
                    open.push(operand);
                }
            });
            if open.len() > before {
                continue;
            }
            open.pop();
            let of = |operand: Id| self.looked[&operand];
            let found = match self.flat.pool.node(id) {
                Node::Number(bits) => (f64::from_bits(bits), true),
                Node::Symbol(symbol) => {
                    let is_constant = matches!(self.flat.variable(symbol).role, Role::Parameter | Role::Constant);
                    (self.number_at(symbol), is_constant)
                }
                Node::Unary(operation, a) => (operate_unary(operation, of(a).0), of(a).1),
                Node::Binary(operation, a, b) => (operate(operation, of(a).0, of(b).0), of(a).1 && of(b).1),
                Node::If(condition, then, otherwise) => {
                    let chosen = if of(condition).0 == 0.0 { otherwise } else { then };
                    (of(chosen).0, of(condition).1 && of(then).1 && of(otherwise).1)
                }
                // The surface is in another file.
                Node::Surface(..) => (f64::NAN, false),
            };
            self.looked.insert(id, found);
        }
        self.looked[&root]
    }

    /// The value of an expression at that point.
    pub(super) fn at_point(&mut self, id: Id) -> f64 {
        self.looked_at(id).0
    }

    /// Whether an expression consists of numbers and parameters only.
    pub(super) fn is_constant(&mut self, id: Id) -> bool {
        self.looked_at(id).1
    }
}
