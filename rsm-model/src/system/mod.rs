//! The sorted, solved and reduced system.
//!
//! ```text
//! Flat --aliases--> --switches--> --index--> --matching--> blocks --solve--> System --> programs
//! ```
//!
//! In: a flat system, as read or as changed by effects. Out: [`System`]: its states, and every other variable as an expression of states, inputs,
//! parameters and time. A singular, over- or underdetermined system is a fault that names the lines of the equations and the remaining unknowns.
//!
//! Between two events a condition does not change: each comparison of continuous values is a [`Switch`], and its value is an argument of the
//! programs. The integrator locates the sign change of `left - right`, sets the switch there, and evaluates the clauses.

mod alias;
mod compile;
mod events;
mod index;
mod linear;
mod lower;
mod matching;
mod print;
mod program;
mod solve;
mod start;
mod work;

use std::collections::HashMap;

use rsm_core::source::Faults;

use crate::expression::{Derivative, Id, Replacement, Symbol};
use crate::flat::{Flat, Role};
use crate::units::{self, Checked};

pub use lower::SurfaceRows;
pub use program::{Program, SurfaceValue};
pub use start::Start;

use work::{Residual, Work};

/// A comparison of values that change continuously: true while `left < right`.
#[derive(Debug, Clone, Copy)]
pub struct Switch {
    /// The left side.
    pub left: Id,
    /// The right side.
    pub right: Id,
    /// The argument of the programs with its value since the last event: 1 or 0.
    pub held: Symbol,
}

/// An alias: another symbol, with a sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alias {
    /// The variable that is kept.
    pub of: Symbol,
    /// Whether the alias is its negative.
    pub is_negative: bool,
}

/// How a block was solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The equation has the form `x = ...`.
    Given,
    /// An equation that is linear in its unknown was rearranged.
    Turned,
    /// Several equations that are linear in their unknowns, by elimination.
    Linear,
    /// Newton's method with a fixed number of steps from the last solution.
    Newton,
}

/// Equations that are solved together.
#[derive(Debug, Clone)]
pub struct Block {
    /// The unknowns that they determine.
    pub unknowns: Vec<Symbol>,
    /// The lines of the equations.
    pub lines: Vec<usize>,
    /// How they are solved.
    pub method: Method,
}

/// An unknown of a nonlinear block.
#[derive(Debug, Clone, Copy)]
pub struct Iterated {
    /// The unknown.
    pub unknown: Symbol,
    /// The argument with its value in the last solution.
    pub guess: Symbol,
    /// The first value of the iteration: the start in the text, or 0.
    pub start: Id,
    /// Its new value.
    pub value: Id,
    /// The residual of an equation of the block: zero if the steps were sufficient.
    pub residual: Id,
}

/// A value that is kept between events.
#[derive(Debug, Clone, Copy)]
pub struct Memory {
    /// The variable.
    pub variable: Symbol,
    /// The argument of the programs with its value: the variable itself if a `when` assigns it, otherwise its value before the event.
    pub held: Symbol,
    /// The argument of the event programs with its value before the event.
    pub before: Symbol,
    /// Its value after an event.
    pub next: Id,
}

/// A branch of a `when`, or a comparison of its conditions.
#[derive(Debug, Clone)]
pub struct Event {
    /// It acts when any of these becomes true.
    pub conditions: Vec<Id>,
    /// It does not act together with these earlier branches.
    pub unless: Vec<usize>,
    /// The argument of the event programs that is 1 if it acts.
    pub acts: Symbol,
    /// The states that are reset, with their new values.
    pub restarted: Vec<(Symbol, Id)>,
}

/// A system of ordinary differential equations with events.
#[derive(Debug, Clone)]
pub struct System {
    /// The original flat system, with the expressions.
    pub(crate) flat: Flat,
    equations: Vec<Residual>,
    initial: Vec<Residual>,
    aliases: HashMap<Symbol, Alias>,
    states: Vec<Symbol>,
    unknowns: Vec<Symbol>,
    /// Every unknown as a function of known symbols.
    values: HashMap<Symbol, Id>,
    /// The solution of each block for its unknowns.
    solved: Vec<(Symbol, Id)>,
    blocks: Vec<Block>,
    iterated: Vec<Iterated>,
    switches: Vec<Switch>,
    units: Checked,
    memories: Vec<Memory>,
    events: Vec<Event>,
}

impl System {
    /// Sorts, solves and reduces a flat system.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_model::{flat::{Flat, Options}, system::System};
    ///
    /// let text = "model Tank\n  input Real q;\n  Real level(start = 1.0);\n  output Real outflow;\nequation\n  \
    ///             2*der(level) = q - outflow;\n  outflow = 0.5*level;\nend Tank;\n";
    /// let flat = Flat::read(&Source::new("tank.mo", text), &Options::default())?;
    /// let system = System::new(&flat)?;
    /// let names: Vec<&str> = system.states().iter().map(|state| system.name(*state)).collect();
    /// assert_eq!(names, ["level"]);
    /// assert_eq!(system.text(system.rates()[0]), "(q - 0.5*level)/2");
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// All faults of one pass: units that do not agree, redundant equations, undetermined unknowns, blocks that cannot be solved.
    pub fn new(flat: &Flat) -> Result<System, Faults> {
        let units = units::check(flat)?;
        let mut work = Work::new(flat.clone());
        let system = work.compile(units);
        work.faults.finish(system)
    }

    /// The name of a symbol.
    #[must_use]
    pub fn name(&self, symbol: Symbol) -> &str {
        &self.flat.variable(symbol).name
    }

    /// The flat system behind it: names, units, starts, expressions.
    #[must_use]
    pub fn flat(&self) -> &Flat {
        &self.flat
    }

    /// An expression as text.
    #[must_use]
    pub fn text(&self, id: Id) -> String {
        self.flat.text(id)
    }

    /// The states, in the order of their declaration.
    #[must_use]
    pub fn states(&self) -> &[Symbol] {
        &self.states
    }

    /// The time derivative of each state, in known symbols.
    #[must_use]
    pub fn rates(&self) -> Vec<Id> {
        self.states.iter().map(|state| self.values[&self.rate_symbol(*state)]).collect()
    }

    fn rate_symbol(&self, state: Symbol) -> Symbol {
        self.flat.find(&format!("der({})", self.name(state))).expect("a state has a derivative")
    }

    /// The inputs, in the order of their declaration.
    #[must_use]
    pub fn inputs(&self) -> Vec<Symbol> {
        self.of_role(Role::Input)
    }

    /// The parameters that can be set without another compilation, in the order of their declaration.
    #[must_use]
    pub fn parameters(&self) -> Vec<Symbol> {
        let is_free = |symbol: &Symbol| {
            let variable = self.flat.variable(*symbol);
            !variable.is_structural && variable.value.is_some_and(|value| self.flat.pool.value(value).is_some())
        };
        self.of_role(Role::Parameter).into_iter().filter(is_free).collect()
    }

    /// The value of a parameter in the text, or the value that replaces it.
    #[must_use]
    pub fn parameter_value(&self, parameter: Symbol) -> Option<f64> {
        self.flat.variable(parameter).value.and_then(|value| self.flat.pool.value(value))
    }

    /// The outputs, in the order of their declaration.
    #[must_use]
    pub fn outputs(&self) -> Vec<Symbol> {
        self.flat.symbols().filter(|symbol| self.flat.variable(*symbol).is_output).collect()
    }

    fn of_role(&self, role: Role) -> Vec<Symbol> {
        self.flat.symbols().filter(|symbol| self.flat.variable(*symbol).role == role).collect()
    }

    /// The symbol of a name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Symbol> {
        self.flat.find(name)
    }

    /// The comparisons that are switches, with both sides in known symbols.
    #[must_use]
    pub fn switches(&self) -> &[Switch] {
        &self.switches
    }

    /// The values that are kept between events.
    #[must_use]
    pub fn memories(&self) -> &[Memory] {
        &self.memories
    }

    /// The branches of `when`.
    #[must_use]
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// The result of the check of units.
    #[must_use]
    pub fn units(&self) -> Checked {
        self.units
    }

    /// The blocks in the order of solution.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The unknowns of nonlinear blocks.
    #[must_use]
    pub fn iterated(&self) -> &[Iterated] {
        &self.iterated
    }

    /// The value of any variable in known symbols: states, inputs, parameters, the time, switches, memories, guesses.
    pub fn value(&mut self, symbol: Symbol) -> Id {
        if let Some(alias) = self.aliases.get(&symbol).copied() {
            let value = self.value(alias.of);
            return if alias.is_negative { self.flat.pool.negate(value) } else { value };
        }
        self.values.get(&symbol).copied().unwrap_or_else(|| self.flat.pool.symbol(symbol))
    }

    /// An expression of the equations in known symbols. Constants and dependent parameters are replaced by their expressions in the text.
    pub fn expressed(&mut self, id: Id) -> Id {
        let free = self.parameters();
        let mut id = id;
        loop {
            let symbols = self.flat.pool.symbols(id);
            let mut values = HashMap::new();
            for symbol in symbols {
                let variable = self.flat.variable(symbol);
                let follows = matches!(variable.role, Role::Constant | Role::Parameter) && !free.contains(&symbol);
                let value = if follows { variable.value } else { Some(self.value(symbol)) };
                values.extend(value.map(|value| (symbol, value)));
            }
            let next = Replacement::new(values).of(&mut self.flat.pool, id);
            // The reader rejects circular definitions of constants, so this loop ends.
            if next == id {
                return id;
            }
            id = next;
        }
    }

    /// The state, if a variable is a state or is equal or opposite to one.
    #[must_use]
    pub fn state_of(&self, symbol: Symbol) -> Option<Symbol> {
        let mut of = symbol;
        while let Some(alias) = self.aliases.get(&of) {
            of = alias.of;
        }
        let state = match self.values.get(&of) {
            None => of,
            Some(value) => {
                let [state] = self.flat.pool.symbols(*value)[..] else { return None };
                (self.text(*value).trim_start_matches('-') == self.name(state)).then_some(state)?
            }
        };
        self.states.contains(&state).then_some(state)
    }

    /// The program that computes some expressions from some arguments.
    ///
    /// # Errors
    /// A symbol that an expression needs and that is not an argument.
    pub fn program(&self, arguments: &[Symbol], results: &[Id]) -> Result<Program, Symbol> {
        Program::new(&self.flat.pool, arguments, results)
    }

    /// The exact derivative of an expression in known symbols with respect to one known symbol.
    pub fn derivative(&mut self, of: Id, by: Symbol) -> Id {
        Derivative::by(&mut self.flat.pool, by).of(&mut self.flat.pool, of)
    }

    /// The system in the form that the passes use, to solve its start.
    fn again(&self) -> Work {
        let mut work = Work::new(self.flat.clone());
        work.equations.clone_from(&self.equations);
        work.initial.clone_from(&self.initial);
        work.aliases.clone_from(&self.aliases);
        work
    }
}
