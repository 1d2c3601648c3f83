//! Expressions as text, in the notation of the source language.

use std::collections::HashMap;

use super::{Binary, Id, Node, Pool, Symbol, Unary};

/// The largest length of a line in a message or a listing; a longer one ends with "...".
const LONGEST: usize = 400;

// Ranks of operators. An operand with a lower rank is put in parentheses.
const IF: u8 = 0;
const OR: u8 = 1;
const AND: u8 = 2;
const NOT: u8 = 3;
const RELATION: u8 = 4;
const SUM: u8 = 5;
const PRODUCT: u8 = 6;
const ATOM: u8 = 8;

impl Pool {
    /// The expression as text; `name` gives the names of symbols and of surfaces.
    pub(crate) fn text(&self, root: Id, name: &dyn Fn(Symbol) -> String, surface: &dyn Fn(u32) -> String) -> String {
        let mut texts: HashMap<Id, (String, u8)> = HashMap::new();
        for id in self.reachable(&[root]) {
            let (mut text, rank) = self.node_text(id, &texts, name, surface);
            if text.chars().count() > LONGEST {
                text = text.chars().take(LONGEST).collect::<String>() + "...";
            }
            texts.insert(id, (text, rank));
        }
        texts.remove(&root).map_or_else(String::new, |(text, _)| text)
    }

    fn node_text(
        &self,
        id: Id,
        texts: &HashMap<Id, (String, u8)>,
        name: &dyn Fn(Symbol) -> String,
        surface: &dyn Fn(u32) -> String,
    ) -> (String, u8) {
        // An operand in parentheses if its rank is lower.
        let of = |operand: Id, rank: u8| {
            let (text, its) = &texts[&operand];
            if *its < rank { format!("({text})") } else { text.clone() }
        };
        match self.node(id) {
            Node::Number(bits) => {
                let value = f64::from_bits(bits);
                (format!("{value}"), if value < 0.0 { SUM } else { ATOM })
            }
            Node::Symbol(symbol) => (name(symbol), ATOM),
            Node::Unary(Unary::Negate, a) => (format!("-{}", of(a, PRODUCT)), SUM),
            Node::Unary(Unary::Not, a) => match self.node(a) {
                Node::Binary(Binary::Less | Binary::LessNow, x, y) => (format!("{} >= {}", of(x, SUM), of(y, SUM)), RELATION),
                _ => (format!("not {}", of(a, RELATION)), NOT),
            },
            Node::Unary(operation, a) => (format!("{}({})", word(operation), of(a, IF)), ATOM),
            Node::Binary(operation, a, b) => {
                let (sign, rank, right) = match operation {
                    Binary::Add => (" + ", SUM, SUM + 1),
                    Binary::Subtract => (" - ", SUM, SUM + 1),
                    Binary::Multiply => ("*", PRODUCT, PRODUCT + 1),
                    Binary::Divide => ("/", PRODUCT, PRODUCT + 1),
                    Binary::Power => return (format!("{}^{}", of(a, ATOM), of(b, ATOM)), PRODUCT + 1),
                    Binary::Less | Binary::LessNow => (" < ", RELATION, SUM),
                    Binary::And => (" and ", AND, AND),
                    Binary::Or => (" or ", OR, OR),
                    Binary::Minimum => return (format!("min({}, {})", of(a, IF), of(b, IF)), ATOM),
                    Binary::Maximum => return (format!("max({}, {})", of(a, IF), of(b, IF)), ATOM),
                    Binary::Arctangent2 => return (format!("atan2({}, {})", of(a, IF), of(b, IF)), ATOM),
                };
                let left = if rank == RELATION { SUM } else { rank };
                (format!("{}{sign}{}", of(a, left), of(b, right)), rank)
            }
            Node::If(condition, then, otherwise) => {
                (format!("if {} then {} else {}", of(condition, OR), of(then, OR), of(otherwise, IF)), IF)
            }
            Node::Surface(number, list) => {
                let (arguments, orders) = self.list(list);
                let inner: Vec<String> = arguments.iter().map(|argument| of(*argument, IF)).collect();
                let derived = if orders.iter().any(|order| *order > 0) { format!("_{orders:?}") } else { String::new() };
                (format!("{}{derived}({})", surface(number), inner.join(", ")), ATOM)
            }
        }
    }
}

fn word(operation: Unary) -> &'static str {
    match operation {
        Unary::Negate => "-",
        Unary::Absolute => "abs",
        Unary::Sign => "sign",
        Unary::Root => "sqrt",
        Unary::Sine => "sin",
        Unary::Cosine => "cos",
        Unary::Tangent => "tan",
        Unary::Arcsine => "asin",
        Unary::Arccosine => "acos",
        Unary::Arctangent => "atan",
        Unary::SineHyperbolic => "sinh",
        Unary::CosineHyperbolic => "cosh",
        Unary::TangentHyperbolic => "tanh",
        Unary::Exponential => "exp",
        Unary::Logarithm => "log",
        Unary::Logarithm10 => "log10",
        Unary::Floor => "floor",
        Unary::Not => "not",
    }
}
