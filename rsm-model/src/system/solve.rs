//! Solves blocks of equations for their unknowns.
//!
//! In: equations and the unknowns of each block. Out: an expression of each unknown in earlier symbols. An equation that is linear in its unknown is
//! rearranged. A linear block is solved by elimination. A nonlinear block is solved by Newton's method with its exact Jacobian, with a fixed number
//! of steps from the last solution; its residual is a further result.

use std::collections::HashMap;
use std::ops::Range;

use crate::expression::{Binary, Derivative, Id, Node, Replacement, Symbol, Unary};
use crate::flat::{Basic, Role};

use super::index::listed;
use super::matching::{Matching, components};
use super::work::{Residual, Work};
use super::{Block, Iterated, Method};

/// Newton steps in one pass. From the solution of the last integration step, with error e, three steps leave an error of e^8.
pub(super) const NEWTON_STEPS: usize = 3;

/// The solution.
#[derive(Debug, Default)]
pub(super) struct Solved {
    /// Each unknown in terms of earlier symbols, in the order of solution.
    pub(super) values: Vec<(Symbol, Id)>,
    pub(super) blocks: Vec<Block>,
    pub(super) iterated: Vec<Iterated>,
}

impl Work {
    /// Sorts equations into blocks and solves them one after another. The matching must be complete.
    pub(super) fn solve_blocks(&mut self, equations: &[Residual], matching: &Matching, unknowns: &[Symbol]) -> Solved {
        // Equation equation_of[k] determines unknown k, which depends on the other unknowns of that equation.
        let depends: Vec<Vec<usize>> = (0..unknowns.len())
            .map(|k| {
                let equation = matching.equation_of[k].expect("the matching is complete");
                matching.unknowns[equation].iter().copied().filter(|other| *other != k).collect()
            })
            .collect();
        let mut solved = Solved::default();
        for component in components(&depends) {
            let block: Vec<(usize, Symbol)> =
                component.iter().map(|k| (matching.equation_of[*k].expect("the matching is complete"), unknowns[*k])).collect();
            match &block[..] {
                [(equation, unknown)] => self.solve_single(&equations[*equation].clone(), *unknown, &mut solved),
                _ => self.solve_several(equations, &block, &mut solved),
            }
        }
        solved
    }

    fn note(&self, equations: &[Residual], block: &[(usize, Symbol)], method: Method) -> Block {
        let mut lines: Vec<usize> = block.iter().map(|(equation, _)| self.line(&equations[*equation].place)).collect();
        lines.sort_unstable();
        lines.dedup();
        Block { unknowns: block.iter().map(|(_, symbol)| *symbol).collect(), lines, method }
    }

    fn solve_single(&mut self, equation: &Residual, unknown: Symbol, solved: &mut Solved) {
        let equations = std::slice::from_ref(equation);
        let id = self.flat.pool.symbol(unknown);
        for (side, other) in [equation.sides, (equation.sides.1, equation.sides.0)] {
            if side == id && self.flat.pool.symbols(other).binary_search(&unknown).is_err() {
                solved.blocks.push(self.note(equations, &[(0, unknown)], Method::Given));
                solved.values.push((unknown, other));
                return;
            }
        }
        let variable = self.flat.variable(unknown);
        if variable.basic != Basic::Real {
            let what = format!(
                "`{}` of type {} must stand alone on one side of its equation",
                variable.name,
                type_word(variable.basic)
            );
            self.fault(equation.place.clone(), what, "write it as `b = ...`");
            return;
        }
        let slope = Derivative::by(&mut self.flat.pool, unknown).of(&mut self.flat.pool, equation.residual);
        let depends =
            self.flat.pool.symbols(slope).binary_search(&unknown).is_ok() || self.jumps(equation.residual, &[unknown]);
        if self.flat.pool.is_number(slope, 0.0) {
            self.singular(equations, &[(0, unknown)]);
            return;
        }
        if depends {
            self.newton(equations, &[(0, unknown)], &[vec![slope]], solved);
            return;
        }
        let zero = self.flat.pool.number(0.0);
        let rest = Replacement::new(HashMap::from([(unknown, zero)])).of(&mut self.flat.pool, equation.residual);
        let moved = self.flat.pool.negate(rest);
        let value = self.flat.pool.divide(moved, slope);
        solved.blocks.push(self.note(equations, &[(0, unknown)], Method::Turned));
        solved.values.push((unknown, value));
    }

    fn solve_several(&mut self, equations: &[Residual], block: &[(usize, Symbol)], solved: &mut Solved) {
        if let Some((equation, unknown)) = block.iter().find(|(_, unknown)| self.flat.variable(*unknown).basic != Basic::Real) {
            let names: Vec<String> =
                block.iter().map(|(_, symbol)| format!("`{}`", self.flat.variable(*symbol).name)).collect();
            let what = format!("`{}` depends on itself through {}", self.flat.variable(*unknown).name, listed(&names));
            self.fault(equations[*equation].place.clone(), what, "use `pre(...)`: the value before the event");
            return;
        }
        let jacobian: Vec<Vec<Id>> = {
            let mut columns: Vec<Derivative> =
                block.iter().map(|(_, unknown)| Derivative::by(&mut self.flat.pool, *unknown)).collect();
            block
                .iter()
                .map(|(equation, _)| {
                    let residual = equations[*equation].residual;
                    columns.iter_mut().map(|column| column.of(&mut self.flat.pool, residual)).collect()
                })
                .collect()
        };
        let unknowns: Vec<Symbol> = block.iter().map(|(_, unknown)| *unknown).collect();
        let is_linear = jacobian
            .iter()
            .flatten()
            .all(|entry| self.flat.pool.symbols(*entry).iter().all(|symbol| !unknowns.contains(symbol)))
            && !block.iter().any(|(equation, _)| self.jumps(equations[*equation].residual, &unknowns));
        if !is_linear {
            self.newton(equations, block, &jacobian, solved);
            return;
        }
        let zero = self.flat.pool.number(0.0);
        let mut at_zero = Replacement::new(unknowns.iter().map(|unknown| (*unknown, zero)).collect());
        let right: Vec<Id> = block
            .iter()
            .map(|(equation, _)| {
                let rest = at_zero.of(&mut self.flat.pool, equations[*equation].residual);
                self.flat.pool.negate(rest)
            })
            .collect();
        match self.solve_linear(jacobian, right) {
            Some(values) => {
                solved.blocks.push(self.note(equations, block, Method::Linear));
                solved.values.extend(unknowns.into_iter().zip(values));
            }
            None => self.singular(equations, block),
        }
    }

    /// Whether an expression has a piecewise constant part, such as a sign, that depends on these symbols. Its derivative does not contain the jumps.
    fn jumps(&self, id: Id, symbols: &[Symbol]) -> bool {
        let pool = &self.flat.pool;
        let depends = |id: Id| pool.symbols(id).iter().any(|it| symbols.contains(it));
        pool.reachable(&[id]).into_iter().any(|id| match pool.node(id) {
            Node::Unary(Unary::Sign | Unary::Floor | Unary::Not, a) => depends(a),
            Node::Binary(Binary::Less | Binary::LessNow | Binary::And | Binary::Or, a, b) => depends(a) || depends(b),
            _ => false,
        })
    }

    fn newton(&mut self, equations: &[Residual], block: &[(usize, Symbol)], jacobian: &[Vec<Id>], solved: &mut Solved) {
        let unknowns: Vec<Symbol> = block.iter().map(|(_, unknown)| *unknown).collect();
        let guesses: Vec<Symbol> = unknowns.iter().map(|unknown| self.flat.derived(Role::Guess(*unknown))).collect();
        let mut now: Vec<Id> = guesses.iter().map(|guess| self.flat.pool.symbol(*guess)).collect();
        let residuals: Vec<Id> = block.iter().map(|(equation, _)| equations[*equation].residual).collect();
        for _ in 0..NEWTON_STEPS {
            let mut here = Replacement::new(unknowns.iter().copied().zip(now.iter().copied()).collect());
            let rows: Vec<Vec<Id>> =
                jacobian.iter().map(|row| row.iter().map(|entry| here.of(&mut self.flat.pool, *entry)).collect()).collect();
            let right: Vec<Id> = residuals.iter().map(|residual| here.of(&mut self.flat.pool, *residual)).collect();
            let Some(steps) = self.solve_linear(rows, right) else {
                self.singular(equations, block);
                return;
            };
            now = now.into_iter().zip(steps).map(|(now, step)| self.flat.pool.subtract(now, step)).collect();
        }
        let mut end = Replacement::new(unknowns.iter().copied().zip(now.iter().copied()).collect());
        let left: Vec<Id> = residuals.iter().map(|residual| end.of(&mut self.flat.pool, *residual)).collect();
        solved.blocks.push(self.note(equations, block, Method::Newton));
        for (k, unknown) in unknowns.iter().enumerate() {
            let start = self.flat.variable(*unknown).start.unwrap_or_else(|| self.flat.pool.number(0.0));
            solved.iterated.push(Iterated { unknown: *unknown, guess: guesses[k], start, value: now[k], residual: left[k] });
            solved.values.push((*unknown, now[k]));
        }
    }

    /// Reports that a block cannot be solved for its unknowns.
    fn singular(&mut self, equations: &[Residual], block: &[(usize, Symbol)]) {
        let names: Vec<String> = block.iter().map(|(_, symbol)| format!("`{}`", self.flat.variable(*symbol).name)).collect();
        let mut lines: Vec<usize> = block.iter().map(|(equation, _)| self.line(&equations[*equation].place)).collect();
        lines.sort_unstable();
        lines.dedup();
        let lines: Vec<String> = lines.iter().map(usize::to_string).collect();
        let place: Range<usize> = equations[block[0].0].place.clone();
        let what =
            format!("the equations of lines {} do not determine {}: they depend on each other", listed(&lines), listed(&names));
        self.fault(place, what, "replace one of them by an independent equation");
    }
}

fn type_word(basic: Basic) -> &'static str {
    match basic {
        Basic::Real => "Real",
        Basic::Integer => "Integer",
        Basic::Boolean => "Boolean",
    }
}

#[cfg(test)]
mod tests {
    use rsm_core::source::Source;

    use super::super::{Method, System};
    use crate::flat::{Flat, Options};

    #[test]
    fn an_equation_that_jumps_in_its_unknown_is_not_linear_in_it() {
        for law in ["y + sign(y) = 3*u", "y + floor(y) = u", "y + (if noEvent(y > 0) then 1 else 0) = u"] {
            let text = format!("model M\n  input Real u;\n  output Real y;\nequation\n  {law};\nend M;\n");
            let flat = Flat::read(&Source::new("m.mo", text), &Options::default()).unwrap();
            let system = System::new(&flat).unwrap_or_else(|faults| panic!("{law}: {faults}"));
            assert_eq!(system.blocks()[0].method, Method::Newton, "{law}");
        }
    }
}
