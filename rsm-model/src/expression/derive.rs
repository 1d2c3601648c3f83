//! Exact derivatives of expressions.
//!
//! The caller gives the derivative of each symbol: 1 for the variable of differentiation, or the time derivative of the symbol.
//! A condition has no derivative, because it does not change between two events.

use std::collections::HashMap;

use super::{Binary, Id, Node, Pool, Symbol, Unary};

/// A derivative of many expressions, with a cache.
#[derive(Debug, Default)]
pub(crate) struct Derivative {
    seeds: HashMap<Symbol, Id>,
    done: HashMap<Id, Option<Id>>,
}

impl Derivative {
    /// The derivative in which the derivative of each symbol is given by `seeds`; other symbols are constant.
    pub(crate) fn new(seeds: HashMap<Symbol, Id>) -> Self {
        Derivative { seeds, done: HashMap::new() }
    }

    /// The derivative with respect to one symbol.
    pub(crate) fn by(pool: &mut Pool, symbol: Symbol) -> Self {
        let one = pool.number(1.0);
        Derivative::new(HashMap::from([(symbol, one)]))
    }

    /// The derivative of an expression.
    pub(crate) fn of(&mut self, pool: &mut Pool, root: Id) -> Id {
        let mut open = vec![(root, false)];
        while let Some((id, is_ready)) = open.pop() {
            if self.done.contains_key(&id) {
                continue;
            }
            if is_ready {
                let derived = self.derived(pool, id).filter(|derived| !pool.is_number(*derived, 0.0));
                self.done.insert(id, derived);
            } else {
                open.push((id, true));
                pool.operands(id, |operand| open.push((operand, false)));
            }
        }
        let zero = pool.number(0.0);
        self.done[&root].unwrap_or(zero)
    }

    /// The derivative of a node whose operands are derived; `None` where it is 0.
    fn derived(&self, pool: &mut Pool, id: Id) -> Option<Id> {
        let of = |operand: Id| self.done.get(&operand).copied().flatten();
        match pool.node(id) {
            Node::Number(_) => None,
            Node::Symbol(symbol) => self.seeds.get(&symbol).copied(),
            Node::Unary(operation, a) => {
                let inner = of(a)?;
                let factor = slope(pool, operation, a, id)?;
                Some(pool.multiply(factor, inner))
            }
            Node::Binary(operation, a, b) => derived_binary(pool, operation, (a, of(a)), (b, of(b)), id),
            Node::If(condition, then, otherwise) => {
                let (then, otherwise) = (of(then), of(otherwise));
                if then.is_none() && otherwise.is_none() {
                    return None;
                }
                let zero = pool.number(0.0);
                Some(pool.choose(condition, then.unwrap_or(zero), otherwise.unwrap_or(zero)))
            }
            Node::Surface(surface, list) => {
                let (arguments, orders) = pool.list(list).clone();
                let mut sum: Option<Id> = None;
                for (k, argument) in arguments.iter().enumerate() {
                    let Some(inner) = of(*argument) else { continue };
                    let mut higher = orders.to_vec();
                    higher[k] += 1;
                    let factor = pool.surface(surface, arguments.to_vec(), higher);
                    let term = pool.multiply(factor, inner);
                    sum = Some(sum.map_or(term, |sum| pool.add(sum, term)));
                }
                sum
            }
        }
    }
}

/// d operation(a)/da, where `whole` is operation(a).
fn slope(pool: &mut Pool, operation: Unary, a: Id, whole: Id) -> Option<Id> {
    let one = pool.number(1.0);
    let square = |pool: &mut Pool, id: Id| pool.multiply(id, id);
    Some(match operation {
        Unary::Negate => pool.number(-1.0),
        Unary::Absolute => pool.unary(Unary::Sign, a),
        // Constant except at their steps.
        Unary::Sign | Unary::Floor | Unary::Not => return None,
        Unary::Root => {
            let half = pool.number(0.5);
            pool.divide(half, whole)
        }
        Unary::Sine => pool.unary(Unary::Cosine, a),
        Unary::Cosine => {
            let sine = pool.unary(Unary::Sine, a);
            pool.negate(sine)
        }
        Unary::Tangent => {
            let squared = square(pool, whole);
            pool.add(one, squared)
        }
        Unary::Arcsine | Unary::Arccosine => {
            let squared = square(pool, a);
            let rest = pool.subtract(one, squared);
            let root = pool.unary(Unary::Root, rest);
            let slope = pool.divide(one, root);
            if operation == Unary::Arcsine { slope } else { pool.negate(slope) }
        }
        Unary::Arctangent => {
            let squared = square(pool, a);
            let sum = pool.add(one, squared);
            pool.divide(one, sum)
        }
        Unary::SineHyperbolic => pool.unary(Unary::CosineHyperbolic, a),
        Unary::CosineHyperbolic => pool.unary(Unary::SineHyperbolic, a),
        Unary::TangentHyperbolic => {
            let squared = square(pool, whole);
            pool.subtract(one, squared)
        }
        Unary::Exponential => whole,
        Unary::Logarithm => pool.divide(one, a),
        Unary::Logarithm10 => {
            let factor = pool.number(std::f64::consts::LOG10_E);
            pool.divide(factor, a)
        }
    })
}

fn derived_binary(
    pool: &mut Pool,
    operation: Binary,
    (a, da): (Id, Option<Id>),
    (b, db): (Id, Option<Id>),
    whole: Id,
) -> Option<Id> {
    if da.is_none() && db.is_none() {
        return None;
    }
    let zero = pool.number(0.0);
    let (x, y) = (da.unwrap_or(zero), db.unwrap_or(zero));
    Some(match operation {
        Binary::Add => pool.add(x, y),
        Binary::Subtract => pool.subtract(x, y),
        Binary::Multiply => {
            let (left, right) = (pool.multiply(x, b), pool.multiply(a, y));
            pool.add(left, right)
        }
        Binary::Divide => {
            // (x - (a/b) y)/b
            let product = pool.multiply(whole, y);
            let rest = pool.subtract(x, product);
            pool.divide(rest, b)
        }
        Binary::Power => {
            // b a^(b-1) x + a^b log(a) y
            let one = pool.number(1.0);
            let lower = pool.subtract(b, one);
            let power = pool.binary(Binary::Power, a, lower);
            let factor = pool.multiply(b, power);
            let by_base = pool.multiply(factor, x);
            if db.is_none() {
                return Some(by_base);
            }
            let logarithm = pool.unary(Unary::Logarithm, a);
            let factor = pool.multiply(whole, logarithm);
            let by_exponent = pool.multiply(factor, y);
            pool.add(by_base, by_exponent)
        }
        Binary::Minimum => {
            let condition = pool.binary(Binary::LessNow, a, b);
            pool.choose(condition, x, y)
        }
        Binary::Maximum => {
            let condition = pool.binary(Binary::LessNow, a, b);
            pool.choose(condition, y, x)
        }
        Binary::Arctangent2 => {
            // (b x - a y)/(a^2 + b^2)
            let (left, right) = (pool.multiply(b, x), pool.multiply(a, y));
            let rest = pool.subtract(left, right);
            let (aa, bb) = (pool.multiply(a, a), pool.multiply(b, b));
            let sum = pool.add(aa, bb);
            pool.divide(rest, sum)
        }
        Binary::Less | Binary::LessNow | Binary::And | Binary::Or => return None,
    })
}
