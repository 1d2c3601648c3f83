//! Expressions: text to tree.
//!
//! One function handles all operators by their rank, so a pair of parentheses takes two calls instead of nine.

use super::lexer::Token;
use super::parser::{Parser, Read};
use super::tree::{Compare, Expression, Joint, Kind, Part, Subscript};

// Ranks of operators, from the weakest. Operators of the same rank associate to the left.
const OR: u8 = 0;
const AND: u8 = 1;
const NOT: u8 = 2;
const RELATION: u8 = 3;
const SUM: u8 = 4;
const PRODUCT: u8 = 5;
const POWER: u8 = 6;

/// An operator between two operands.
#[derive(Clone, Copy)]
enum Operator {
    Or,
    And,
    Relation(Compare),
    Sum(bool),
    Product(Joint),
    Power(bool),
}

impl Operator {
    fn rank(self) -> u8 {
        match self {
            Operator::Or => OR,
            Operator::And => AND,
            Operator::Relation(_) => RELATION,
            Operator::Sum(_) => SUM,
            Operator::Product(_) => PRODUCT,
            Operator::Power(_) => POWER,
        }
    }
}

impl Parser<'_> {
    fn operator(&self) -> Option<Operator> {
        Some(match self.token() {
            Token::Keyword("or") => Operator::Or,
            Token::Keyword("and") => Operator::And,
            Token::Sign(sign) => match *sign {
                "<" => Operator::Relation(Compare::Less),
                "<=" => Operator::Relation(Compare::LessEqual),
                ">" => Operator::Relation(Compare::Greater),
                ">=" => Operator::Relation(Compare::GreaterEqual),
                "==" => Operator::Relation(Compare::Equal),
                "<>" => Operator::Relation(Compare::Different),
                "+" | ".+" => Operator::Sum(false),
                "-" | ".-" => Operator::Sum(true),
                "*" => Operator::Product(Joint::Times),
                "/" => Operator::Product(Joint::Over),
                ".*" => Operator::Product(Joint::EachTimes),
                "./" => Operator::Product(Joint::EachOver),
                "^" => Operator::Power(false),
                ".^" => Operator::Power(true),
                _ => return None,
            },
            _ => return None,
        })
    }

    /// An expression, ranges included.
    pub(crate) fn expression(&mut self) -> Read<Expression> {
        self.deeper(|parser| {
            let start = parser.span().start;
            let expression = if parser.is_keyword("if") { parser.if_expression(start) } else { parser.simple(start) };
            parser.skip_decoration();
            expression
        })
    }

    fn if_expression(&mut self, start: usize) -> Read<Expression> {
        self.advance();
        let mut branches = Vec::new();
        loop {
            let condition = self.expression()?;
            self.keyword("then", "after the condition of `if`")?;
            branches.push((condition, self.expression()?));
            if !self.takes_keyword("elseif") {
                break;
            }
        }
        self.keyword("else", "after the value of `if`: an if-expression needs both values")?;
        let otherwise = Box::new(self.expression()?);
        Ok(Expression { kind: Kind::If(branches, otherwise), span: self.since(start) })
    }

    /// An expression that is allowed on the left of `=`: all but an if-expression.
    pub(crate) fn simple(&mut self, start: usize) -> Read<Expression> {
        let first = self.climb(OR)?;
        if !self.takes_sign(":") {
            return Ok(first);
        }
        let second = self.climb(OR)?;
        let third = if self.takes_sign(":") { Some(self.climb(OR)?) } else { None };
        let kind = match third {
            Some(last) => Kind::Range(Box::new(first), Some(Box::new(second)), Box::new(last)),
            None => Kind::Range(Box::new(first), None, Box::new(second)),
        };
        Ok(Expression { kind, span: self.since(start) })
    }

    /// Operators of rank `lowest` or stronger.
    fn climb(&mut self, lowest: u8) -> Read<Expression> {
        let start = self.span().start;
        let mut left = if lowest <= NOT && self.takes_keyword("not") {
            let inner = Box::new(self.climb(RELATION)?);
            Expression { kind: Kind::Not(inner), span: self.since(start) }
        } else if lowest <= SUM && (self.is_sign("-") || self.is_sign("+") || self.is_sign(".-") || self.is_sign(".+")) {
            let is_minus = self.is_sign("-") || self.is_sign(".-");
            self.advance();
            let inner = self.climb(PRODUCT)?;
            Expression { kind: Kind::Sum(vec![(is_minus, inner)]), span: self.since(start) }
        } else {
            self.primary()?
        };
        let mut related = false;
        while let Some(operator) = self.operator() {
            if operator.rank() < lowest {
                break;
            }
            let place = self.span();
            if matches!(operator, Operator::Relation(_)) {
                if related {
                    return self.fault_with_help(
                        place,
                        format!("found {} after a comparison", self.found()),
                        "join two comparisons with `and`",
                    );
                }
                related = true;
            }
            self.advance();
            let right = self.climb(operator.rank() + 1)?;
            if matches!(operator, Operator::Power(_)) && matches!(self.operator(), Some(Operator::Power(_))) {
                let what = format!("found {} after a power", self.found());
                return self.fault_with_help(self.span(), what, "write parentheses around the power that is computed first");
            }
            left = Expression { kind: joined(left, operator, right), span: self.since(start) };
        }
        Ok(left)
    }

    fn primary(&mut self) -> Read<Expression> {
        let span = self.span();
        let start = span.start;
        let kind = match self.token().clone() {
            Token::Number(value, is_whole) => {
                self.advance();
                Kind::Number(value, is_whole)
            }
            Token::Text(text) => {
                self.advance();
                Kind::Text(text)
            }
            Token::Keyword(word @ ("true" | "false")) => {
                self.advance();
                Kind::Boolean(word == "true")
            }
            Token::Keyword("end") => {
                self.advance();
                Kind::End
            }
            Token::Keyword(word @ ("der" | "initial" | "pure")) => {
                self.advance();
                if !self.is_sign("(") {
                    return self.unexpected(&format!("`(` after `{word}`"));
                }
                self.call(word.to_string())?
            }
            Token::Name(_) => self.reference_or_call()?,
            Token::Sign(".") if matches!(self.ahead(), Token::Name(_)) => self.reference_or_call()?,
            Token::Sign("(") => {
                self.advance();
                let inner = self.expression()?;
                if self.is_sign(",") {
                    let what = "found a list of results in parentheses: only functions with one result are supported";
                    return self.fault_with_help(span, what, "write a function for each result");
                }
                self.sign(")", "after an expression in parentheses")?;
                if self.is_sign("[") {
                    let what = "subscripts after parentheses are not supported";
                    return self.fault_with_help(self.span(), what, "name the expression as a variable and take its part");
                }
                return Ok(inner);
            }
            Token::Sign("{") => {
                self.advance();
                let first = self.expression()?;
                if self.takes_keyword("for") {
                    let (index, range) = self.for_index()?;
                    self.sign("}", "at the end of an array")?;
                    Kind::Comprehension(Box::new(first), index, Box::new(range))
                } else {
                    let mut items = vec![first];
                    while self.takes_sign(",") {
                        items.push(self.expression()?);
                    }
                    self.sign("}", "at the end of an array")?;
                    Kind::Array(items)
                }
            }
            Token::Sign("[") => {
                self.advance();
                let mut rows = Vec::new();
                loop {
                    let mut row = vec![self.expression()?];
                    while self.takes_sign(",") {
                        row.push(self.expression()?);
                    }
                    rows.push(row);
                    if !self.takes_sign(";") {
                        break;
                    }
                }
                self.sign("]", "at the end of a matrix")?;
                Kind::Matrix(rows)
            }
            Token::Sign(sign @ ("-" | "+")) => {
                let what = format!("found `{sign}` after an operator");
                return self.fault_with_help(span, what, format!("write the operand in parentheses: ({sign}x)"));
            }
            _ => return self.unexpected("a number, a name, a function or `(`"),
        };
        Ok(Expression { kind, span: self.since(start) })
    }

    /// `name in range` of a for-loop.
    pub(crate) fn for_index(&mut self) -> Read<(String, Expression)> {
        let index = self.name("the name of an index after `for`")?;
        self.keyword("in", "after the index of `for`")?;
        let range = self.expression()?;
        if self.is_sign(",") {
            let what = "two indices in one `for` are not supported";
            return self.fault_with_help(self.span(), what, "write one `for` inside the other");
        }
        Ok((index, range))
    }

    /// A name with its parts and subscripts.
    pub(crate) fn reference(&mut self) -> Read<Vec<Part>> {
        self.takes_sign(".");
        let mut parts = Vec::new();
        loop {
            let name = self.name("a name")?;
            let subscripts = if self.is_sign("[") { self.subscripts()? } else { Vec::new() };
            parts.push(Part { name, subscripts });
            if !(self.is_sign(".") && matches!(self.ahead(), Token::Name(_))) {
                return Ok(parts);
            }
            self.advance();
        }
    }

    fn reference_or_call(&mut self) -> Read<Kind> {
        let parts = self.reference()?;
        if !self.is_sign("(") {
            return Ok(Kind::Name(parts));
        }
        if parts.iter().any(|part| !part.subscripts.is_empty()) {
            return self.unexpected("an operator after a name with subscripts");
        }
        let name = parts.into_iter().map(|part| part.name).collect::<Vec<_>>().join(".");
        self.call(name)
    }

    /// The arguments of a function, from `(` to `)`.
    fn call(&mut self, name: String) -> Read<Kind> {
        self.advance();
        let mut arguments = Vec::new();
        let mut named = Vec::new();
        if !self.is_sign(")") {
            loop {
                if matches!(self.token(), Token::Name(_)) && matches!(self.ahead(), Token::Sign("=")) {
                    let argument = self.name("the name of an argument")?;
                    self.advance();
                    named.push((argument, self.expression()?));
                } else if self.is_keyword("function") {
                    let what = "a function as an argument is not supported";
                    return self.fault_with_help(self.span(), what, "write the function that results as a function of its own");
                } else {
                    let argument = self.expression()?;
                    if self.takes_keyword("for") {
                        let (index, range) = self.for_index()?;
                        let span = argument.span.clone();
                        let kind = Kind::Comprehension(Box::new(argument), index, Box::new(range));
                        arguments.push(Expression { kind, span });
                    } else {
                        arguments.push(argument);
                    }
                }
                if !self.takes_sign(",") {
                    break;
                }
            }
        }
        self.sign(")", &format!("after the arguments of `{name}`"))?;
        Ok(Kind::Call(name, arguments, named))
    }

    /// Subscripts, from `[` to `]`.
    pub(crate) fn subscripts(&mut self) -> Read<Vec<Subscript>> {
        self.advance();
        let mut subscripts = Vec::new();
        loop {
            let is_all = self.is_sign(":") && matches!(self.ahead(), Token::Sign("," | "]"));
            subscripts.push(if is_all {
                self.advance();
                Subscript::All
            } else {
                Subscript::At(self.expression()?)
            });
            if !self.takes_sign(",") {
                break;
            }
        }
        self.sign("]", "after subscripts")?;
        Ok(subscripts)
    }
}

/// Joins two operands by an operator. If the left one is a list, the right one is added to it, because sums and products associate to the left.
fn joined(left: Expression, operator: Operator, right: Expression) -> Kind {
    match (operator, left.kind) {
        (Operator::Or, Kind::Or(mut items)) => {
            items.push(right);
            Kind::Or(items)
        }
        (Operator::And, Kind::And(mut items)) => {
            items.push(right);
            Kind::And(items)
        }
        (Operator::Sum(is_minus), Kind::Sum(mut items)) => {
            items.push((is_minus, right));
            Kind::Sum(items)
        }
        (Operator::Product(joint), Kind::Product(mut items)) => {
            items.push((joint, right));
            Kind::Product(items)
        }
        (operator, kind) => {
            let left = Expression { kind, span: left.span };
            match operator {
                Operator::Or => Kind::Or(vec![left, right]),
                Operator::And => Kind::And(vec![left, right]),
                Operator::Relation(compare) => Kind::Relation(compare, Box::new(left), Box::new(right)),
                Operator::Sum(is_minus) => Kind::Sum(vec![(false, left), (is_minus, right)]),
                Operator::Product(joint) => Kind::Product(vec![(Joint::Times, left), (joint, right)]),
                Operator::Power(each) => Kind::Power(Box::new(left), Box::new(right), each),
            }
        }
    }
}
