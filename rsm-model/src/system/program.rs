//! Straight-line programs of a system, and their values in double precision.

use std::collections::HashMap;

use crate::expression::{Id, Node, Pool, Symbol, operate, operate_unary};

/// The value of a response surface: its number, its arguments, the order of differentiation with respect to each.
pub type SurfaceValue<'s> = &'s dyn Fn(u32, &[f64], &[u8]) -> f64;

/// A sequence of operations from arguments to results.
#[derive(Debug, Clone)]
pub struct Program {
    /// The arguments, in order.
    pub arguments: Vec<Symbol>,
    /// The operations; operands come first.
    steps: Vec<Step>,
    /// The step of each result.
    results: Vec<usize>,
}

#[derive(Debug, Clone)]
enum Step {
    Number(f64),
    Argument(usize),
    Unary(crate::expression::Unary, usize),
    Binary(crate::expression::Binary, usize, usize),
    If(usize, usize, usize),
    Surface(u32, Vec<usize>, Vec<u8>),
}

impl Program {
    /// The program for some expressions. `Err` holds a symbol that is not an argument.
    pub(super) fn new(pool: &Pool, arguments: &[Symbol], results: &[Id]) -> Result<Program, Symbol> {
        let place: HashMap<Symbol, usize> = arguments.iter().enumerate().map(|(k, symbol)| (*symbol, k)).collect();
        let reachable = pool.reachable(results);
        let step_of: HashMap<Id, usize> = reachable.iter().enumerate().map(|(k, id)| (*id, k)).collect();
        let mut steps = Vec::with_capacity(reachable.len());
        for id in &reachable {
            let of = |id: Id| step_of[&id];
            steps.push(match pool.node(*id) {
                Node::Number(bits) => Step::Number(f64::from_bits(bits)),
                Node::Symbol(symbol) => Step::Argument(*place.get(&symbol).ok_or(symbol)?),
                Node::Unary(operation, a) => Step::Unary(operation, of(a)),
                Node::Binary(operation, a, b) => Step::Binary(operation, of(a), of(b)),
                Node::If(condition, then, otherwise) => Step::If(of(condition), of(then), of(otherwise)),
                Node::Surface(surface, list) => {
                    let (arguments, orders) = pool.list(list);
                    Step::Surface(surface, arguments.iter().map(|argument| of(*argument)).collect(), orders.to_vec())
                }
            });
        }
        Ok(Program { arguments: arguments.to_vec(), steps, results: results.iter().map(|id| step_of[id]).collect() })
    }

    /// The number of operations, without constants and arguments.
    #[must_use]
    pub fn operation_count(&self) -> usize {
        self.steps.iter().filter(|step| !matches!(step, Step::Number(_) | Step::Argument(_))).count()
    }

    /// The results for some arguments, in double precision with the functions of the machine's library; for checks.
    #[must_use]
    pub fn values(&self, arguments: &[f64], surface: SurfaceValue<'_>) -> Vec<f64> {
        let mut values: Vec<f64> = Vec::with_capacity(self.steps.len());
        for step in &self.steps {
            let value = match step {
                Step::Number(value) => *value,
                Step::Argument(place) => arguments[*place],
                Step::Unary(operation, a) => operate_unary(*operation, values[*a]),
                Step::Binary(operation, a, b) => operate(*operation, values[*a], values[*b]),
                Step::If(condition, then, otherwise) => values[if values[*condition] == 0.0 { *otherwise } else { *then }],
                Step::Surface(number, inner, orders) => {
                    let inner: Vec<f64> = inner.iter().map(|at| values[*at]).collect();
                    surface(*number, &inner, orders)
                }
            };
            values.push(value);
        }
        self.results.iter().map(|result| values[*result]).collect()
    }
}
