//! Values of expressions in double precision.
//!
//! Used for constants of a text, for choices of the compiler at the start, and for tests. The numbers of a simulation come from tapes, because the
//! functions here are those of the machine's library.

use std::collections::HashMap;

use super::{Binary, Id, Node, Pool, Symbol, Unary};

/// The values of symbols, and of expressions that follow from them.
///
/// The value of a symbol without a value is NaN, and so is that of a response surface and of everything that depends on them.
pub struct Values<'p> {
    pool: &'p Pool,
    symbols: HashMap<Symbol, f64>,
    done: HashMap<Id, f64>,
}

impl std::fmt::Debug for Values<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Values").field("symbols", &self.symbols).finish_non_exhaustive()
    }
}

impl<'p> Values<'p> {
    /// Values without any symbol set.
    #[must_use]
    pub fn new(pool: &'p Pool) -> Self {
        Values { pool, symbols: HashMap::new(), done: HashMap::new() }
    }

    /// Gives a symbol a value, and clears the cache.
    pub fn set(&mut self, symbol: Symbol, value: f64) {
        self.symbols.insert(symbol, value);
        self.done.clear();
    }

    /// The value of an expression.
    pub fn of(&mut self, root: Id) -> f64 {
        let mut open = vec![root];
        while let Some(id) = open.last().copied() {
            if self.done.contains_key(&id) {
                open.pop();
                continue;
            }
            let before = open.len();
            self.pool.operands(id, |operand| {
                if !self.done.contains_key(&operand) {
                    open.push(operand);
                }
            });
            if open.len() > before {
                continue;
            }
            open.pop();
            let of = |operand: Id| self.done[&operand];
            let value = match self.pool.node(id) {
                Node::Number(bits) => f64::from_bits(bits),
                Node::Symbol(symbol) => self.symbols.get(&symbol).copied().unwrap_or(f64::NAN),
                Node::Unary(operation, a) => operate_unary(operation, of(a)),
                Node::Binary(operation, a, b) => operate(operation, of(a), of(b)),
                Node::If(condition, then, otherwise) => {
                    if of(condition) == 0.0 {
                        of(otherwise)
                    } else {
                        of(then)
                    }
                }
                // The surface is in another file, so its value is unknown.
                Node::Surface(..) => f64::NAN,
            };
            self.done.insert(id, value);
        }
        self.done[&root]
    }
}

fn truth(is_true: bool) -> f64 {
    f64::from(u8::from(is_true))
}

/// The value of an operation of one operand.
pub(crate) fn operate_unary(operation: Unary, a: f64) -> f64 {
    match operation {
        Unary::Negate => -a,
        Unary::Absolute => a.abs(),
        Unary::Sign => {
            if a > 0.0 {
                1.0
            } else if a < 0.0 {
                -1.0
            } else {
                a
            }
        }
        Unary::Root => a.sqrt(),
        Unary::Sine => a.sin(),
        Unary::Cosine => a.cos(),
        Unary::Tangent => a.tan(),
        Unary::Arcsine => a.asin(),
        Unary::Arccosine => a.acos(),
        Unary::Arctangent => a.atan(),
        Unary::SineHyperbolic => a.sinh(),
        Unary::CosineHyperbolic => a.cosh(),
        Unary::TangentHyperbolic => a.tanh(),
        Unary::Exponential => a.exp(),
        Unary::Logarithm => a.ln(),
        Unary::Logarithm10 => a.log10(),
        Unary::Floor => a.floor(),
        Unary::Not => truth(a == 0.0),
    }
}

/// The value of an operation of two operands.
pub(crate) fn operate(operation: Binary, a: f64, b: f64) -> f64 {
    match operation {
        Binary::Add => a + b,
        Binary::Subtract => a - b,
        Binary::Multiply => a * b,
        Binary::Divide => a / b,
        Binary::Power => a.powf(b),
        Binary::Minimum => {
            if b < a {
                b
            } else {
                a
            }
        }
        Binary::Maximum => {
            if a < b {
                b
            } else {
                a
            }
        }
        Binary::Arctangent2 => a.atan2(b),
        Binary::Less | Binary::LessNow => truth(a < b),
        Binary::And => truth(a != 0.0 && b != 0.0),
        Binary::Or => truth(a != 0.0 || b != 0.0),
    }
}
