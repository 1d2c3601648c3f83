//! The flat system: all names resolved, all arrays written out, all functions inlined.
//!
//! In: the tree of a text. Out: [`Flat`]: scalar variables and scalar equations over one pool of expressions. Effects change this form before the
//! equations are sorted. Faults of names, types and shapes are reported here, each with its place.

mod arithmetic;
mod builtins;
mod declare;
mod equations;
mod fragment;
mod functions;
mod known;
mod logic;
mod names;
mod translate;
mod value;

use std::collections::HashMap;
use std::ops::Range;

use rsm_core::source::{Collector, Faults, Source};

use crate::expression::{Id, Pool, Symbol};
use crate::syntax;

pub(crate) use value::Value;

/// The values that a variable can take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basic {
    /// A real number.
    Real,
    /// A whole number.
    Integer,
    /// True (1) or false (0).
    Boolean,
}

/// The meaning of a symbol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A constant.
    Constant,
    /// A parameter, which a plant file may set.
    Parameter,
    /// A signal from outside.
    Input,
    /// An unknown of the equations.
    Unknown,
    /// The time derivative of another symbol.
    Derivative(Symbol),
    /// The time in s.
    Time,
    /// The value of another symbol before an event.
    Before(Symbol),
    /// 1 at the instants of the [`Sample`] with this number, otherwise 0.
    Sample(u32),
    /// 1 while the [`Clause`] with this number acts, otherwise 0.
    Acts(u32),
    /// The value of a switch since the last event, by its number.
    Held(u32),
    /// The starting value of an iteration: the value of another symbol in the last solution.
    Guess(Symbol),
}

/// The preference for a variable as a state, from the attribute `stateSelect`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Preference {
    /// Never a state.
    Never,
    /// Only if there is no other.
    Avoid,
    /// No preference.
    #[default]
    Default,
    /// If possible.
    Prefer,
    /// A state.
    Always,
}

/// A scalar variable, or another symbol.
#[derive(Debug, Clone)]
pub struct Variable {
    /// The name in the text; an element of an array is `x[1]`.
    pub name: String,
    /// Its meaning.
    pub role: Role,
    /// The values that it can take.
    pub basic: Basic,
    /// Whether the text declares it `output`.
    pub is_output: bool,
    /// Whether the text declares it `discrete`, or a `when` gives it its value.
    pub is_discrete: bool,
    /// Its unit as the text writes it.
    pub unit: Option<String>,
    /// Its description in the text.
    pub description: String,
    /// The value of a constant or a parameter.
    pub value: Option<Id>,
    /// The value at the start.
    pub start: Option<Id>,
    /// Whether the start value must hold; otherwise it is a guess.
    pub fixed: Option<bool>,
    /// The smallest value.
    pub min: Option<f64>,
    /// The largest value.
    pub max: Option<f64>,
    /// Its typical size.
    pub nominal: Option<f64>,
    /// The preference for it as a state.
    pub preference: Preference,
    /// Whether its value changes the structure of the system, so that another value needs another compilation.
    pub is_structural: bool,
    /// The position of its declaration, in bytes of the text.
    pub place: Range<usize>,
}

/// An equation: both sides are equal.
#[derive(Debug, Clone)]
pub struct Equation {
    /// The left side.
    pub left: Id,
    /// The right side.
    pub right: Id,
    /// Its position, in bytes of the text.
    pub place: Range<usize>,
    /// The pairs of expressions whose units must agree, if these are not the two sides: for an if-equation whose branches have different quantities.
    pub pairs: Vec<(Id, Id)>,
}

/// The instants of a periodic sample.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The first instant in s.
    pub start: Id,
    /// The time between two instants in s.
    pub period: Id,
    /// Its position, in bytes of the text.
    pub place: Range<usize>,
}

/// The assignments at an event: a branch of a `when`.
#[derive(Debug, Clone)]
pub struct Clause {
    /// It acts when any of these becomes true.
    pub conditions: Vec<Id>,
    /// It does not act together with these earlier branches.
    pub unless: Vec<usize>,
    /// The assigned variables, which hold their new value.
    pub assigned: Vec<(Symbol, Id)>,
    /// The states that are reset, with their new values.
    pub restarted: Vec<(Symbol, Id)>,
    /// Its position, in bytes of the text.
    pub place: Range<usize>,
}

/// A condition that must hold: `assert`.
#[derive(Debug, Clone)]
pub struct Check {
    /// The condition.
    pub condition: Id,
    /// The message if it is false.
    pub message: String,
    /// Its position, in bytes of the text.
    pub place: Range<usize>,
}

/// A function without an algorithm: a response surface.
#[derive(Debug, Clone)]
pub struct Surface {
    /// The name in the text.
    pub name: String,
    /// Names and units of the arguments, in order.
    pub inputs: Vec<(String, Option<String>)>,
    /// The unit of the result.
    pub unit: Option<String>,
    /// The position of its declaration, in bytes of the text.
    pub place: Range<usize>,
}

/// A flat system of equations.
#[derive(Debug, Clone)]
pub struct Flat {
    /// The name of the model.
    pub name: String,
    /// The description in the text.
    pub description: String,
    /// The text.
    pub source: Source,
    /// The expressions.
    pub pool: Pool,
    /// The symbols of the pool, by number.
    pub variables: Vec<Variable>,
    /// Equations that hold at all times.
    pub equations: Vec<Equation>,
    /// Equations that hold at the start.
    pub initial_equations: Vec<Equation>,
    /// The assignments at events.
    pub clauses: Vec<Clause>,
    /// Instants of `sample`.
    pub samples: Vec<Sample>,
    /// Conditions that must hold.
    pub checks: Vec<Check>,
    /// Functions that response surfaces compute.
    pub surfaces: Vec<Surface>,
    /// Variables by name.
    pub(crate) names: HashMap<String, Symbol>,
    /// Scalars and arrays by name.
    declared: HashMap<String, translate::Declared>,
    /// Other files with equations: effects and sites.
    fragments: Vec<fragment::Fragment>,
}

/// Options of the reader.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// The model to read, if a text has several. Otherwise the last one is read.
    pub model: Option<String>,
    /// Values of parameters in place of those of the text, in its units; Boolean as 0 and 1.
    pub parameters: Vec<(String, f64)>,
}

impl Flat {
    /// Reads a text and translates it.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_model::flat::{Flat, Options};
    ///
    /// let text = "model Fall\n  Real v(start = 1.0);\nequation\n  der(v) = -9.81 - 0.1*v;\nend Fall;\n";
    /// let flat = Flat::read(&Source::new("fall.mo", text), &Options::default())?;
    /// assert_eq!(flat.equations.len(), 1);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// All faults of syntax; if there are none, all faults of names, types and shapes. Each has line and column.
    pub fn read(source: &Source, options: &Options) -> Result<Flat, Faults> {
        let mut faults = Collector::new();
        let text = syntax::read(source, &mut faults);
        // Stop here: a missing part would cause further faults.
        faults.finish(Some(()))?;
        let mut faults = Collector::new();
        let flat = declare::flat(&text, source, options, &mut faults);
        faults.finish(flat)
    }

    /// A symbol's variable.
    #[must_use]
    pub fn variable(&self, symbol: Symbol) -> &Variable {
        &self.variables[symbol.0 as usize]
    }

    /// The symbol of a name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Symbol> {
        self.names.get(name).copied()
    }

    /// The symbols, in the order in which they were declared.
    pub fn symbols(&self) -> impl Iterator<Item = Symbol> + use<> {
        (0..self.variables.len() as u32).map(Symbol)
    }

    /// The value of an expression of constants and parameters.
    pub(crate) fn known(&self, id: Id) -> Option<(f64, Vec<Symbol>)> {
        known::known(&self.pool, &self.variables, id)
    }

    /// The symbol of a derived role, such as a derivative. It is created if necessary.
    pub(crate) fn derived(&mut self, role: Role) -> Symbol {
        derived(&mut self.variables, &mut self.names, role)
    }

    /// The expression as text.
    #[must_use]
    pub fn text(&self, id: Id) -> String {
        self.pool.text(id, &|symbol| self.variable(symbol).name.clone(), &|surface| {
            self.surfaces.get(surface as usize).map_or_else(String::new, |surface| surface.name.clone())
        })
    }
}

/// The symbol of a derived role, such as a derivative. It is created if necessary, with the name that the text would use.
fn derived(variables: &mut Vec<Variable>, names: &mut HashMap<String, Symbol>, role: Role) -> Symbol {
    let of = |symbol: Symbol| &variables[symbol.0 as usize];
    let (name, basic, place) = match role {
        Role::Derivative(inner) => (format!("der({})", of(inner).name), Basic::Real, of(inner).place.clone()),
        Role::Before(inner) => (format!("pre({})", of(inner).name), of(inner).basic, of(inner).place.clone()),
        Role::Guess(inner) => (format!("last({})", of(inner).name), of(inner).basic, of(inner).place.clone()),
        Role::Sample(number) => (format!("sample {}", number + 1), Basic::Boolean, 0..0),
        Role::Acts(number) => (format!("when {}", number + 1), Basic::Boolean, 0..0),
        Role::Held(number) => (format!("switch {}", number + 1), Basic::Boolean, 0..0),
        Role::Constant | Role::Parameter | Role::Input | Role::Unknown | Role::Time => {
            unreachable!("a declared symbol is not derived")
        }
    };
    if let Some(symbol) = names.get(&name) {
        return *symbol;
    }
    let symbol = Symbol(variables.len() as u32);
    variables.push(Variable::new(name.clone(), role, basic, place));
    names.insert(name, symbol);
    symbol
}

impl Variable {
    fn new(name: String, role: Role, basic: Basic, place: Range<usize>) -> Self {
        Variable {
            name,
            role,
            basic,
            is_output: false,
            is_discrete: basic != Basic::Real,
            unit: None,
            description: String::new(),
            value: None,
            start: None,
            fixed: None,
            min: None,
            max: None,
            nominal: None,
            preference: Preference::Default,
            is_structural: false,
            place,
        }
    }
}

#[cfg(test)]
mod tests;
