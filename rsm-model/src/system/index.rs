//! Index reduction: finds the equations that must be differentiated with respect to time, and the variables that are then no longer states.
//!
//! Example: two inertias on a rigid shaft. An equation without a derivative couples their angles. C. C. Pantelides, "The consistent initialization of
//! differential-algebraic systems", 1988, finds the equations to differentiate. S. E. Mattsson and G. Söderlind, "Index reduction in
//! differential-algebraic equations using dummy derivatives", 1993, select the variables that are no longer states. The choice is made once, near the
//! start.

use std::collections::{HashMap, HashSet};

use crate::expression::{Derivative, Id, Symbol};
use crate::flat::{Basic, Role};

use super::matching::Matching;
use super::work::{Residual, Work};

impl Work {
    /// Whether a symbol is an unknown of the equations.
    pub(super) fn is_unknown(&self, symbol: Symbol) -> bool {
        match self.flat.variable(symbol).role {
            Role::Unknown => !self.is_held(symbol),
            Role::Derivative(_) => true,
            _ => false,
        }
    }

    /// The unknowns of an expression.
    pub(super) fn unknowns_of(&self, id: Id) -> Vec<Symbol> {
        self.flat.pool.symbols(id).into_iter().filter(|symbol| self.is_unknown(*symbol)).collect()
    }

    /// The variable of which a symbol is a derivative of any order.
    fn bottom(&self, mut symbol: Symbol) -> Symbol {
        while let Role::Derivative(of) = self.flat.variable(symbol).role {
            symbol = of;
        }
        symbol
    }

    /// Reports redundant equations and undetermined unknowns, where a variable and its derivatives count as one. Without such a fault,
    /// `derive_equations` terminates.
    pub(super) fn check_counts(&mut self) {
        let mut variables: Vec<Symbol> = self
            .flat
            .symbols()
            .filter(|symbol| self.flat.variable(*symbol).role == Role::Unknown)
            .filter(|symbol| self.is_unknown(*symbol) && !self.aliases.contains_key(symbol))
            .collect();
        variables.sort_unstable();
        let place_of: HashMap<Symbol, usize> = variables.iter().enumerate().map(|(k, symbol)| (*symbol, k)).collect();
        let incidence: Vec<Vec<usize>> = self
            .equations
            .iter()
            .map(|equation| {
                let mut found: Vec<usize> = self
                    .unknowns_of(equation.residual)
                    .into_iter()
                    .filter_map(|symbol| place_of.get(&self.bottom(symbol)).copied())
                    .collect();
                found.sort_unstable();
                found.dedup();
                found
            })
            .collect();
        let mut matching = Matching::new(incidence, variables.len());
        let mut told = HashSet::new();
        for equation in 0..self.equations.len() {
            let Err(searched) = matching.augment(equation, |_| true) else { continue };
            if !told.insert(equation) {
                continue;
            }
            let mut lines: Vec<usize> = searched.equations.iter().map(|k| self.line(&self.equations[*k].place)).collect();
            lines.sort_unstable();
            lines.dedup();
            let names: Vec<String> =
                searched.unknowns.iter().map(|k| format!("`{}`", self.flat.variable(variables[*k]).name)).collect();
            let place = self.equations[equation].place.clone();
            let what = if names.is_empty() {
                "this equation contains no unknown for which it could be solved".to_string()
            } else {
                format!(
                    "one equation too many: the {} equations of lines {} contain only {} unknowns: {}",
                    searched.equations.len(),
                    listed(&lines.iter().map(usize::to_string).collect::<Vec<_>>()),
                    names.len(),
                    listed(&names)
                )
            };
            self.fault(place, what, "remove one of them, or declare the variable that it should determine");
        }
        for (k, symbol) in variables.iter().enumerate() {
            if matching.equation_of[k].is_some() {
                continue;
            }
            let variable = self.flat.variable(*symbol).clone();
            let mut lines: Vec<usize> = (0..self.equations.len())
                .filter(|equation| matching.unknowns[*equation].contains(&k))
                .map(|equation| self.line(&self.equations[equation].place))
                .collect();
            lines.dedup();
            let where_used = if lines.is_empty() {
                "it is in no equation".to_string()
            } else {
                let lines: Vec<String> = lines.iter().map(usize::to_string).collect();
                format!("the equations that contain it (lines {}) determine other unknowns", listed(&lines))
            };
            let help = if variable.is_discrete {
                "write its `when`; a text from rumoca leaves `when` out"
            } else {
                "write an equation, or declare it `input` or `parameter`"
            };
            self.fault(variable.place, format!("no equation is left that determines `{}`: {where_used}", variable.name), help);
        }
    }

    /// Differentiates equations until they determine the highest derivatives.
    pub(super) fn derive_equations(&mut self) {
        // The unknowns by number, in the order of their occurrence.
        let mut symbols: Vec<Symbol> = Vec::new();
        let mut number: HashMap<Symbol, usize> = HashMap::new();
        let mut matching = Matching::default();
        let mut has_derivative: Vec<bool> = Vec::new();
        let count = self.equations.len();
        // All chains of derivatives first: a variable whose derivative is in a later equation is not a highest derivative.
        for equation in 0..count {
            let unknowns = self.number_unknowns(equation, &mut symbols, &mut number, &mut matching, &mut has_derivative);
            matching.add(unknowns);
        }
        let mut derived: Vec<Option<usize>> = vec![None; count];
        for first in 0..count {
            let mut at = first;
            while let Err(searched) = matching.augment(at, |unknown| !has_derivative[unknown]) {
                // Every variable of the visited equations gets a derivative, and every visited equation is differentiated.
                for unknown in &searched.unknowns {
                    if self.flat.variable(symbols[*unknown]).basic != Basic::Real {
                        let place = self.equations[at].place.clone();
                        let what = format!("the time derivative of `{}` is needed", self.flat.variable(symbols[*unknown]).name);
                        self.fault(place, what, "only Real variables have derivatives");
                        return;
                    }
                    let derivative = self.flat.derived(Role::Derivative(symbols[*unknown]));
                    enter(derivative, &mut symbols, &mut number, &mut matching, &mut has_derivative);
                    has_derivative[*unknown] = true;
                }
                let mut new_of: HashMap<usize, usize> = HashMap::new();
                for equation in &searched.equations {
                    let Some(new) = self.derive(*equation) else { return };
                    let unknowns = self.number_unknowns(new, &mut symbols, &mut number, &mut matching, &mut has_derivative);
                    let added = matching.add(unknowns);
                    debug_assert_eq!(added, new, "equations have the same numbers in both lists");
                    derived.resize(new + 1, None);
                    derived[*equation] = Some(new);
                    new_of.insert(*equation, new);
                }
                for unknown in &searched.unknowns {
                    let owner = matching.equation_of[*unknown].expect("a searched unknown has an equation");
                    let higher = self.flat.derived(Role::Derivative(symbols[*unknown]));
                    let (higher, new) = (number[&higher], new_of[&owner]);
                    matching.equation_of[higher] = Some(new);
                    matching.unknown_of[new] = Some(higher);
                    matching.equation_of[*unknown] = None;
                    matching.unknown_of[owner] = None;
                }
                at = new_of[&at];
            }
        }
    }

    /// The unknowns of an equation by number.
    fn number_unknowns(
        &self,
        equation: usize,
        symbols: &mut Vec<Symbol>,
        number: &mut HashMap<Symbol, usize>,
        matching: &mut Matching,
        has_derivative: &mut Vec<bool>,
    ) -> Vec<usize> {
        let found = self.unknowns_of(self.equations[equation].residual);
        let mut numbers = Vec::new();
        for symbol in found {
            numbers.push(enter(symbol, symbols, number, matching, has_derivative));
            let mut inner = symbol;
            while let Role::Derivative(of) = self.flat.variable(inner).role {
                let lower = enter(of, symbols, number, matching, has_derivative);
                has_derivative[lower] = true;
                inner = of;
            }
        }
        numbers
    }

    /// The time derivative of an equation, as a new equation.
    fn derive(&mut self, equation: usize) -> Option<usize> {
        let old = self.equations[equation].clone();
        let mut seeds = HashMap::new();
        for symbol in self.flat.pool.symbols(old.residual) {
            let seed = match self.flat.variable(symbol).role {
                Role::Time => self.flat.pool.number(1.0),
                Role::Input => {
                    let what = format!(
                        "the time derivative of this equation is needed, but it contains the input `{}`, which has no derivative: it is held from row to row",
                        self.flat.variable(symbol).name
                    );
                    self.fault(old.place.clone(), what, "filter the input: der(y) = (u - y)/T, and use y");
                    return None;
                }
                _ if self.is_unknown(symbol) && self.flat.variable(symbol).basic == Basic::Real => {
                    let derivative = self.flat.derived(Role::Derivative(symbol));
                    self.flat.pool.symbol(derivative)
                }
                _ => continue,
            };
            seeds.insert(symbol, seed);
        }
        let mut derivative = Derivative::new(seeds);
        let residual = derivative.of(&mut self.flat.pool, old.residual);
        let sides = (derivative.of(&mut self.flat.pool, old.sides.0), derivative.of(&mut self.flat.pool, old.sides.1));
        self.equations.push(Residual { residual, sides, place: old.place, derived_from: Some(equation) });
        Some(self.equations.len() - 1)
    }

    /// The dummy derivatives: derivatives that are unknowns of equations and are not integrated.
    pub(super) fn dummies(&mut self) -> HashSet<Symbol> {
        let mut dummies = HashSet::new();
        let present: HashSet<Symbol> = self.equations.iter().flat_map(|equation| self.unknowns_of(equation.residual)).collect();
        let has_higher =
            |work: &Self, symbol: Symbol| work.derivative_of(symbol).is_some_and(|higher| present.contains(&higher));
        let is_derived: HashSet<usize> = self.equations.iter().filter_map(|equation| equation.derived_from).collect();
        let mut rows: Vec<usize> = (0..self.equations.len())
            .filter(|row| !is_derived.contains(row) && self.equations[*row].derived_from.is_some())
            .collect();
        let mut columns: Vec<Symbol> = rows
            .iter()
            .flat_map(|row| self.unknowns_of(self.equations[*row].residual))
            .filter(|symbol| matches!(self.flat.variable(*symbol).role, Role::Derivative(_)) && !has_higher(self, *symbol))
            .collect();
        while !rows.is_empty() {
            columns.sort_unstable();
            columns.dedup();
            let Some(chosen) = self.independent(&rows, &columns) else { break };
            dummies.extend(&chosen);
            rows = rows
                .iter()
                .filter_map(|row| self.equations[*row].derived_from)
                .filter(|row| self.equations[*row].derived_from.is_some())
                .collect();
            columns = chosen
                .iter()
                .filter_map(|symbol| match self.flat.variable(*symbol).role {
                    Role::Derivative(of) if matches!(self.flat.variable(of).role, Role::Derivative(_)) => Some(of),
                    _ => None,
                })
                .collect();
        }
        dummies
    }

    /// Selects as many columns as there are rows, so that the rows can be solved for them. Variables with the lowest preference as states come first.
    fn independent(&mut self, rows: &[usize], columns: &[Symbol]) -> Option<Vec<Symbol>> {
        let mut ordered: Vec<(Symbol, Vec<f64>, bool)> = Vec::new();
        for column in columns {
            let mut derivative = Derivative::by(&mut self.flat.pool, *column);
            let mut entries = Vec::new();
            let mut is_constant = true;
            for row in rows {
                let entry = derivative.of(&mut self.flat.pool, self.equations[*row].residual);
                is_constant &= self.is_constant(entry);
                entries.push(self.at_point(entry));
            }
            ordered.push((*column, entries, is_constant));
        }
        ordered.sort_by_cached_key(|(symbol, entries, is_constant)| {
            let Role::Derivative(of) = self.flat.variable(*symbol).role else { unreachable!("columns are derivatives") };
            let variable = self.flat.variable(of);
            let is_inner = matches!(variable.role, Role::Derivative(_));
            let fixed = variable.fixed == Some(true);
            // Coefficients that depend on the states: prefer the largest, which is unlikely to vanish. Positive values are ordered like their bits.
            let size =
                if *is_constant { 0 } else { entries.iter().fold(0.0_f64, |size, entry| size.max(entry.abs())).to_bits() };
            let wanted = (fixed, std::cmp::Reverse(size), variable.is_output, variable.start.is_some());
            (variable.preference, !is_inner, !is_constant, wanted, std::cmp::Reverse(*symbol))
        });
        // One column at a time. A column in the span of the selected ones is skipped.
        let mut reduced: Vec<(usize, Vec<f64>)> = Vec::new();
        let mut chosen = Vec::new();
        for (symbol, mut entries, _) in ordered {
            let size = entries.iter().fold(0.0_f64, |size, entry| size.max(entry.abs()));
            for (pivot, vector) in &reduced {
                let factor = entries[*pivot] / vector[*pivot];
                for (entry, other) in entries.iter_mut().zip(vector) {
                    *entry -= factor * other;
                }
            }
            let (pivot, largest) = entries
                .iter()
                .enumerate()
                .fold((0, 0.0_f64), |best, (k, entry)| if entry.abs() > best.1 { (k, entry.abs()) } else { best });
            // A dependent column leaves only rounding error of its size.
            if largest > 1e-9 * size {
                reduced.push((pivot, entries));
                chosen.push(symbol);
            }
            if chosen.len() == rows.len() {
                return Some(chosen);
            }
        }
        let lines: Vec<String> = rows.iter().map(|row| self.line(&self.equations[*row].place).to_string()).collect();
        let place = self.equations[rows[0]].place.clone();
        let what = format!(
            "the constraints of lines {} depend on each other: their derivatives determine fewer unknowns",
            listed(&lines)
        );
        self.fault(place, what, "remove a constraint that follows from the others");
        None
    }
}

/// Assigns a number to a symbol.
fn enter(
    symbol: Symbol,
    symbols: &mut Vec<Symbol>,
    number: &mut HashMap<Symbol, usize>,
    matching: &mut Matching,
    has_derivative: &mut Vec<bool>,
) -> usize {
    *number.entry(symbol).or_insert_with(|| {
        symbols.push(symbol);
        matching.equation_of.push(None);
        has_derivative.push(false);
        symbols.len() - 1
    })
}

/// A list for a message: at most twelve items are named.
pub(super) fn listed(items: &[String]) -> String {
    const MOST: usize = 12;
    let shown = items.iter().take(MOST).cloned().collect::<Vec<_>>().join(", ");
    if items.len() > MOST { format!("{shown} and {} more", items.len() - MOST) } else { shown }
}
