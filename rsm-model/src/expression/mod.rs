//! Expressions: one pool of shared nodes for a whole model.
//!
//! A node is stored once, however often it occurs. Its operands have smaller numbers, so every pass over a pool is a loop without recursion.
//! Construction simplifies only with operations that are exact in IEEE 754 (sums, products, quotients and roots of numbers). The value of a sine is
//! left to the operations of the tape, which give the same bits on every machine.

mod derive;
mod evaluate;
mod print;

use std::collections::HashMap;

pub(crate) use derive::Derivative;
pub use evaluate::Values;
pub(crate) use evaluate::{operate, operate_unary};

/// A node of a pool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Id(pub(crate) u32);

/// A name in expressions: a variable, the time, a value from before an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Symbol(pub(crate) u32);

/// An operation of one operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Unary {
    /// Minus.
    Negate,
    /// Absolute value.
    Absolute,
    /// -1, 0 or 1.
    Sign,
    /// Square root.
    Root,
    /// Sine of an angle in rad.
    Sine,
    /// Cosine of an angle in rad.
    Cosine,
    /// Tangent of an angle in rad.
    Tangent,
    /// Angle in rad whose sine is given.
    Arcsine,
    /// Angle in rad whose cosine is given.
    Arccosine,
    /// Angle in rad whose tangent is given.
    Arctangent,
    /// Hyperbolic sine.
    SineHyperbolic,
    /// Hyperbolic cosine.
    CosineHyperbolic,
    /// Hyperbolic tangent.
    TangentHyperbolic,
    /// Exponential.
    Exponential,
    /// Natural logarithm.
    Logarithm,
    /// Logarithm to the base 10.
    Logarithm10,
    /// The largest integer that is not above the operand.
    Floor,
    /// 1 for 0, else 0.
    Not,
}

/// An operation of two operands. Truth is 1, falsehood 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Binary {
    /// Sum.
    Add,
    /// Difference.
    Subtract,
    /// Product.
    Multiply,
    /// Quotient.
    Divide,
    /// Power of any exponent.
    Power,
    /// The smaller one.
    Minimum,
    /// The larger one.
    Maximum,
    /// The angle of the point (second, first) in rad.
    Arctangent2,
    /// Whether the first is below the second, as at the last event: a switch.
    Less,
    /// Whether the first is below the second now: inside `noEvent`.
    LessNow,
    /// Whether both are true.
    And,
    /// Whether at least one is true.
    Or,
}

/// A node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Node {
    /// A number, by its bits.
    Number(u64),
    /// A symbol.
    Symbol(Symbol),
    /// An operation of one operand.
    Unary(Unary, Id),
    /// An operation of two operands.
    Binary(Binary, Id, Id),
    /// The condition, the value if it is true, the value otherwise.
    If(Id, Id, Id),
    /// A response surface: its number, and the number of its list of arguments and orders of differentiation.
    Surface(u32, u32),
}

/// The arguments of a response surface, and the order of differentiation with respect to each.
pub(crate) type Arguments = (Box<[Id]>, Box<[u8]>);

/// The nodes of a model.
#[derive(Debug, Clone, Default)]
pub struct Pool {
    nodes: Vec<Node>,
    known: HashMap<Node, Id>,
    lists: Vec<Arguments>,
    known_lists: HashMap<Arguments, u32>,
}

impl Pool {
    /// The node with this number.
    #[must_use]
    pub fn node(&self, id: Id) -> Node {
        self.nodes[id.0 as usize]
    }

    pub(crate) fn list(&self, list: u32) -> &Arguments {
        &self.lists[list as usize]
    }

    fn intern(&mut self, node: Node) -> Id {
        if let Some(id) = self.known.get(&node) {
            return *id;
        }
        let id = Id(u32::try_from(self.nodes.len()).expect("fewer than 2^32 nodes"));
        self.nodes.push(node);
        self.known.insert(node, id);
        id
    }

    /// A number. Both zeros become +0; no rule here distinguishes them.
    pub fn number(&mut self, value: f64) -> Id {
        let value = if value == 0.0 { 0.0 } else { value };
        self.intern(Node::Number(value.to_bits()))
    }

    /// The number of a node, if it is one.
    #[must_use]
    pub fn value(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Number(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    pub(crate) fn is_number(&self, id: Id, value: f64) -> bool {
        self.value(id) == Some(value)
    }

    /// A symbol.
    pub fn symbol(&mut self, symbol: Symbol) -> Id {
        self.intern(Node::Symbol(symbol))
    }

    pub(crate) fn surface(&mut self, surface: u32, arguments: Vec<Id>, orders: Vec<u8>) -> Id {
        let list = (arguments.into_boxed_slice(), orders.into_boxed_slice());
        let number = if let Some(number) = self.known_lists.get(&list) {
            *number
        } else {
            let number = self.lists.len() as u32;
            self.lists.push(list.clone());
            self.known_lists.insert(list, number);
            number
        };
        self.intern(Node::Surface(surface, number))
    }

    /// An operation of one operand.
    pub fn unary(&mut self, operation: Unary, a: Id) -> Id {
        match (operation, self.node(a)) {
            (Unary::Negate, Node::Unary(Unary::Negate, inner)) => return inner,
            (Unary::Negate, Node::Binary(Binary::Subtract, x, y)) => return self.binary(Binary::Subtract, y, x),
            (Unary::Not, Node::Unary(Unary::Not, inner)) => return inner,
            (Unary::Absolute, Node::Unary(Unary::Negate, inner)) => return self.unary(Unary::Absolute, inner),
            _ => {}
        }
        if let Some(value) = self.value(a) {
            let exact =
                matches!(operation, Unary::Negate | Unary::Absolute | Unary::Sign | Unary::Root | Unary::Floor | Unary::Not);
            let result = operate_unary(operation, value);
            if exact && result.is_finite() {
                return self.number(result);
            }
            let at_zero = match operation {
                Unary::Cosine | Unary::CosineHyperbolic | Unary::Exponential => Some(1.0),
                Unary::Logarithm | Unary::Logarithm10 | Unary::Arccosine => None,
                _ => Some(0.0),
            };
            if value == 0.0
                && let Some(result) = at_zero
            {
                return self.number(result);
            }
        }
        self.intern(Node::Unary(operation, a))
    }

    /// An operation of two operands.
    pub fn binary(&mut self, operation: Binary, a: Id, b: Id) -> Id {
        if let Some(simple) = self.simplified(operation, a, b) {
            return simple;
        }
        // The order does not change the bits, so both orders share one node, in the order that came first.
        let commutes = matches!(operation, Binary::Add | Binary::Multiply | Binary::And | Binary::Or);
        if commutes && let Some(known) = self.known.get(&Node::Binary(operation, b, a)) {
            return *known;
        }
        self.intern(Node::Binary(operation, a, b))
    }

    fn simplified(&mut self, operation: Binary, a: Id, b: Id) -> Option<Id> {
        let (left, right) = (self.value(a), self.value(b));
        if let (Some(x), Some(y)) = (left, right) {
            let exact = !matches!(operation, Binary::Power | Binary::Arctangent2);
            let result = operate(operation, x, y);
            if exact && result.is_finite() {
                return Some(self.number(result));
            }
        }
        let is = |value: Option<f64>, number: f64| value == Some(number);
        let negated = |pool: &Self, id: Id| match pool.node(id) {
            Node::Unary(Unary::Negate, inner) => Some(inner),
            _ => None,
        };
        match operation {
            Binary::Add => {
                if is(left, 0.0) {
                    return Some(b);
                }
                if is(right, 0.0) {
                    return Some(a);
                }
                if let Some(inner) = negated(self, b) {
                    return Some(self.binary(Binary::Subtract, a, inner));
                }
                negated(self, a).map(|inner| self.binary(Binary::Subtract, b, inner))
            }
            Binary::Subtract => {
                if a == b {
                    return Some(self.number(0.0));
                }
                if is(right, 0.0) {
                    return Some(a);
                }
                if is(left, 0.0) {
                    return Some(self.unary(Unary::Negate, b));
                }
                negated(self, b).map(|inner| self.binary(Binary::Add, a, inner))
            }
            Binary::Multiply => {
                if is(left, 0.0) || is(right, 0.0) {
                    return Some(self.number(0.0));
                }
                match (left, right) {
                    (Some(1.0), _) => return Some(b),
                    (_, Some(1.0)) => return Some(a),
                    (Some(-1.0), _) => return Some(self.unary(Unary::Negate, b)),
                    (_, Some(-1.0)) => return Some(self.unary(Unary::Negate, a)),
                    _ => {}
                }
                let (sign_a, sign_b) = (negated(self, a), negated(self, b));
                if sign_a.is_some() || sign_b.is_some() {
                    let product = self.binary(Binary::Multiply, sign_a.unwrap_or(a), sign_b.unwrap_or(b));
                    let both = sign_a.is_some() && sign_b.is_some();
                    return Some(if both { product } else { self.unary(Unary::Negate, product) });
                }
                None
            }
            Binary::Divide => {
                if is(left, 0.0) && !is(right, 0.0) {
                    return Some(self.number(0.0));
                }
                if is(right, 1.0) {
                    return Some(a);
                }
                if is(right, -1.0) {
                    return Some(self.unary(Unary::Negate, a));
                }
                if let Some(inner) = negated(self, a) {
                    let quotient = self.binary(Binary::Divide, inner, b);
                    return Some(self.unary(Unary::Negate, quotient));
                }
                negated(self, b).map(|inner| {
                    let quotient = self.binary(Binary::Divide, a, inner);
                    self.unary(Unary::Negate, quotient)
                })
            }
            Binary::Power => self.simple_power(a, right),
            Binary::Minimum | Binary::Maximum => (a == b).then_some(a),
            Binary::And => match (left, right) {
                (Some(x), _) => Some(if x == 0.0 { self.number(0.0) } else { b }),
                (_, Some(y)) => Some(if y == 0.0 { self.number(0.0) } else { a }),
                _ => (a == b).then_some(a),
            },
            Binary::Or => match (left, right) {
                (Some(x), _) => Some(if x == 0.0 { b } else { self.number(1.0) }),
                (_, Some(y)) => Some(if y == 0.0 { a } else { self.number(1.0) }),
                _ => (a == b).then_some(a),
            },
            Binary::Less | Binary::LessNow => (a == b).then(|| self.number(0.0)),
            Binary::Arctangent2 => None,
        }
    }

    /// A power with a small integer exponent is a chain of products; with exponent one half it is a root.
    fn simple_power(&mut self, base: Id, exponent: Option<f64>) -> Option<Id> {
        let exponent = exponent?;
        if exponent == 0.0 {
            return Some(self.number(1.0));
        }
        if exponent == 0.5 {
            return Some(self.unary(Unary::Root, base));
        }
        if exponent.fract() != 0.0 || exponent.abs() > 64.0 {
            return None;
        }
        // From the highest bit of the exponent: square, then multiply by the base if the bit is set.
        let count = exponent.abs() as u32;
        let mut result = base;
        for bit in (0..31 - count.leading_zeros()).rev() {
            result = self.binary(Binary::Multiply, result, result);
            if count >> bit & 1 == 1 {
                result = self.binary(Binary::Multiply, result, base);
            }
        }
        if exponent < 0.0 {
            let one = self.number(1.0);
            result = self.binary(Binary::Divide, one, result);
        }
        Some(result)
    }

    /// One value or another.
    pub fn choose(&mut self, condition: Id, then: Id, otherwise: Id) -> Id {
        if then == otherwise {
            return then;
        }
        if let Some(value) = self.value(condition) {
            return if value == 0.0 { otherwise } else { then };
        }
        if let Node::Unary(Unary::Not, inner) = self.node(condition) {
            return self.choose(inner, otherwise, then);
        }
        self.intern(Node::If(condition, then, otherwise))
    }

    /// Sum.
    pub fn add(&mut self, a: Id, b: Id) -> Id {
        self.binary(Binary::Add, a, b)
    }

    /// Difference.
    pub fn subtract(&mut self, a: Id, b: Id) -> Id {
        self.binary(Binary::Subtract, a, b)
    }

    /// Product.
    pub fn multiply(&mut self, a: Id, b: Id) -> Id {
        self.binary(Binary::Multiply, a, b)
    }

    /// Quotient.
    pub fn divide(&mut self, a: Id, b: Id) -> Id {
        self.binary(Binary::Divide, a, b)
    }

    /// Minus.
    pub fn negate(&mut self, a: Id) -> Id {
        self.unary(Unary::Negate, a)
    }

    /// Calls `each` with every operand of a node.
    pub(crate) fn operands(&self, id: Id, mut each: impl FnMut(Id)) {
        match self.node(id) {
            Node::Number(_) | Node::Symbol(_) => {}
            Node::Unary(_, a) => each(a),
            Node::Binary(_, a, b) => {
                each(a);
                each(b);
            }
            Node::If(a, b, c) => {
                each(a);
                each(b);
                each(c);
            }
            Node::Surface(_, list) => self.list(list).0.iter().copied().for_each(each),
        }
    }

    /// All nodes of some expressions, operands first.
    #[must_use]
    pub fn reachable(&self, roots: &[Id]) -> Vec<Id> {
        let mut seen: std::collections::HashSet<Id> = roots.iter().copied().collect();
        let mut open: Vec<Id> = seen.iter().copied().collect();
        while let Some(id) = open.pop() {
            self.operands(id, |operand| {
                if seen.insert(operand) {
                    open.push(operand);
                }
            });
        }
        let mut all: Vec<Id> = seen.into_iter().collect();
        all.sort_unstable();
        all
    }

    /// The symbols that an expression depends on, in the order of their numbers.
    #[must_use]
    pub fn symbols(&self, root: Id) -> Vec<Symbol> {
        let mut symbols: Vec<Symbol> = self
            .reachable(&[root])
            .into_iter()
            .filter_map(|id| match self.node(id) {
                Node::Symbol(symbol) => Some(symbol),
                _ => None,
            })
            .collect();
        symbols.sort_unstable();
        symbols
    }

    /// A node with other operands.
    pub(crate) fn rebuilt(&mut self, id: Id, mut of: impl FnMut(Id) -> Id) -> Id {
        match self.node(id) {
            Node::Number(_) | Node::Symbol(_) => id,
            Node::Unary(operation, a) => {
                let a = of(a);
                self.unary(operation, a)
            }
            Node::Binary(operation, a, b) => {
                let (a, b) = (of(a), of(b));
                self.binary(operation, a, b)
            }
            Node::If(a, b, c) => {
                let (a, b, c) = (of(a), of(b), of(c));
                self.choose(a, b, c)
            }
            Node::Surface(surface, list) => {
                let (arguments, orders) = self.list(list).clone();
                let arguments = arguments.iter().map(|argument| of(*argument)).collect();
                self.surface(surface, arguments, orders.to_vec())
            }
        }
    }
}

/// A replacement of symbols by expressions, in many expressions of one pool, with a cache.
#[derive(Debug, Default)]
pub(crate) struct Replacement {
    /// The expression for each symbol.
    pub(crate) symbols: HashMap<Symbol, Id>,
    done: HashMap<Id, Id>,
}

impl Replacement {
    pub(crate) fn new(symbols: HashMap<Symbol, Id>) -> Self {
        Replacement { symbols, done: HashMap::new() }
    }

    /// The expression with its symbols replaced. The replacements themselves are not replaced again.
    pub(crate) fn of(&mut self, pool: &mut Pool, root: Id) -> Id {
        let mut open = vec![(root, false)];
        while let Some((id, is_ready)) = open.pop() {
            if self.done.contains_key(&id) {
                continue;
            }
            if is_ready {
                let done = &self.done;
                let new = match pool.node(id) {
                    Node::Symbol(symbol) => self.symbols.get(&symbol).copied().unwrap_or(id),
                    _ => pool.rebuilt(id, |operand| done[&operand]),
                };
                self.done.insert(id, new);
            } else {
                open.push((id, true));
                pool.operands(id, |operand| open.push((operand, false)));
            }
        }
        self.done[&root]
    }
}

#[cfg(test)]
mod tests;
