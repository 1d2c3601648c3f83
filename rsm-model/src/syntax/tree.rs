//! The syntax tree of a text, before names are resolved and arrays are written out.
//!
//! Sums, products and conjunctions are lists, so that a sum of thousands of terms does not make a deep tree.

use std::ops::Range;

/// The range of bytes of a part in its text.
pub(crate) type Span = Range<usize>;

/// A part of a name with its subscripts: `x[1, 2]`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub(crate) name: String,
    pub(crate) subscripts: Vec<Subscript>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Subscript {
    /// `:`
    All,
    At(Expression),
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Expression {
    pub(crate) kind: Kind,
    pub(crate) span: Span,
}

impl Expression {
    /// The first parts of all names in it.
    pub(crate) fn names(&self, names: &mut Vec<String>) {
        let each = |list: &[Expression], names: &mut Vec<String>| list.iter().for_each(|it| it.names(names));
        match &self.kind {
            Kind::Number(..) | Kind::Boolean(_) | Kind::Text(_) | Kind::End => {}
            Kind::Name(parts) => {
                names.extend(parts.first().map(|it| it.name.clone()));
                for subscript in parts.iter().flat_map(|it| &it.subscripts) {
                    if let Subscript::At(at) = subscript {
                        at.names(names);
                    }
                }
            }
            Kind::Call(_, list, named) => {
                each(list, names);
                named.iter().for_each(|it| it.1.names(names));
            }
            Kind::Sum(terms) => terms.iter().for_each(|it| it.1.names(names)),
            Kind::Product(factors) => factors.iter().for_each(|it| it.1.names(names)),
            Kind::Power(base, exponent, _) => [base, exponent].into_iter().for_each(|it| it.names(names)),
            Kind::Relation(_, left, right) => [left, right].into_iter().for_each(|it| it.names(names)),
            Kind::And(list) | Kind::Or(list) | Kind::Array(list) => each(list, names),
            Kind::Not(inner) => inner.names(names),
            Kind::If(branches, otherwise) => {
                branches.iter().for_each(|(condition, value)| [condition, value].into_iter().for_each(|it| it.names(names)));
                otherwise.names(names);
            }
            Kind::Comprehension(body, _, range) => [body, range].into_iter().for_each(|it| it.names(names)),
            Kind::Matrix(rows) => rows.iter().for_each(|row| each(row, names)),
            Kind::Range(first, step, last) => {
                [Some(first), step.as_ref(), Some(last)].into_iter().flatten().for_each(|it| it.names(names));
            }
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compare {
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Equal,
    Different,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    /// A number, and whether it is written as an integer.
    Number(f64, bool),
    Boolean(bool),
    Text(String),
    Name(Vec<Part>),
    /// A function with its positional and its named arguments.
    Call(String, Vec<Expression>, Vec<(String, Expression)>),
    /// Terms, each with its sign: true for minus.
    Sum(Vec<(bool, Expression)>),
    /// Factors, each with the operator before it. The first one has [`Joint::Times`].
    Product(Vec<(Joint, Expression)>),
    /// Base, exponent, and whether the power is elementwise.
    Power(Box<Expression>, Box<Expression>, bool),
    Relation(Compare, Box<Expression>, Box<Expression>),
    And(Vec<Expression>),
    Or(Vec<Expression>),
    Not(Box<Expression>),
    /// Conditions with their values, and the value of `else`.
    If(Vec<(Expression, Expression)>, Box<Expression>),
    /// `{a, b}`
    Array(Vec<Expression>),
    /// `{expression for index in range}`
    Comprehension(Box<Expression>, String, Box<Expression>),
    /// `[a, b; c, d]`
    Matrix(Vec<Vec<Expression>>),
    /// First, step, last.
    Range(Box<Expression>, Option<Box<Expression>>, Box<Expression>),
    /// `end` in a subscript.
    End,
}

/// The operator between a factor and those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Joint {
    Times,
    Over,
    /// Element by element.
    EachTimes,
    /// Element by element.
    EachOver,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Variability {
    Constant,
    Parameter,
    Discrete,
    Continuous,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    Input,
    Output,
    Neither,
}

/// A modification: attributes in parentheses, and a value after `=`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Modification {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) value: Option<Expression>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Attribute {
    pub(crate) name: String,
    pub(crate) value: AttributeValue,
    pub(crate) span: Span,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum AttributeValue {
    Text(String),
    Expression(Expression),
    /// `x(start(...))`: a nested modification.
    Nested,
}

#[derive(Debug, Clone)]
pub(crate) struct Declaration {
    pub(crate) variability: Variability,
    pub(crate) direction: Direction,
    /// The type as it is written: `Real`, or a name of the text.
    pub(crate) type_name: String,
    pub(crate) type_span: Span,
    pub(crate) name: String,
    pub(crate) span: Span,
    /// Sizes after the type follow those after the name.
    pub(crate) sizes: Vec<Subscript>,
    pub(crate) modification: Modification,
    pub(crate) description: String,
}

#[derive(Debug, Clone)]
pub(crate) struct Equation {
    pub(crate) kind: EquationKind,
    pub(crate) span: Span,
}

#[derive(Debug, Clone)]
pub(crate) enum EquationKind {
    Equal(Expression, Expression),
    /// Branches, then the equations of `else`.
    If(Vec<(Expression, Vec<Equation>)>, Vec<Equation>),
    /// Index, range, equations.
    For(String, Expression, Vec<Equation>),
    /// Branches: `when` and each `elsewhen`.
    When(Vec<(Expression, Vec<Equation>)>),
    /// `reinit(...)`, `assert(...)` and other calls used as equations.
    Call(Expression),
}

#[derive(Debug, Clone)]
pub(crate) struct Statement {
    pub(crate) kind: StatementKind,
    pub(crate) span: Span,
}

#[derive(Debug, Clone)]
pub(crate) enum StatementKind {
    /// Assigns a value to a name with subscripts.
    Assign(Vec<Part>, Expression),
    If(Vec<(Expression, Vec<Statement>)>, Vec<Statement>),
    For(String, Expression, Vec<Statement>),
    /// `assert(...)` and other calls used as statements.
    Call(Expression),
}

/// `type Voltage = Real(unit = "V");`
#[derive(Debug, Clone)]
pub(crate) struct TypeDefinition {
    pub(crate) name: String,
    pub(crate) base: String,
    pub(crate) sizes: Vec<Subscript>,
    pub(crate) modification: Modification,
}

#[derive(Debug, Clone)]
pub(crate) struct Function {
    pub(crate) name: String,
    pub(crate) span: Span,
    pub(crate) declarations: Vec<Declaration>,
    /// `None` if the text declares the function without an algorithm.
    pub(crate) algorithm: Option<Vec<Statement>>,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Model {
    pub(crate) name: String,
    pub(crate) description: String,
    pub(crate) declarations: Vec<Declaration>,
    pub(crate) equations: Vec<Equation>,
    pub(crate) initial_equations: Vec<Equation>,
}

/// A whole text.
#[derive(Debug, Clone, Default)]
pub(crate) struct Text {
    pub(crate) types: Vec<TypeDefinition>,
    pub(crate) functions: Vec<Function>,
    /// `constant` declarations of the package.
    pub(crate) constants: Vec<Declaration>,
    pub(crate) models: Vec<Model>,
}
