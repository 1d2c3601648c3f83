//! Parameters that occur in the equations, and those on which only the start of a plant depends.
//!
//! In: flat equations. Out: names of parameters. A plant file may set parameters of the start under `[initial]`, and a fit of a record that begins in
//! motion may vary them. No data sheet contains them.

use rsm_model::expression::Symbol;
use rsm_model::flat::{Equation, Flat, Role};

/// The parameters of a text on which only the start depends.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_model::flat::{Flat, Options};
///
/// let text = "model Cart\n  parameter Real drag = 2;\n  parameter Real faster = 0;\n  output Real speed(start = 1);\ninitial equation\n  \
///             speed = 1 + faster;\nequation\n  der(speed) = -drag*speed;\nend Cart;\n";
/// let flat = Flat::read(&Source::new("cart.mo", text), &Options::default())?;
/// let found = rsm_sim::equations::start_parameters(&flat);
/// assert_eq!(found.iter().map(|it| flat.variable(*it).name.as_str()).collect::<Vec<_>>(), ["faster"]);
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn start_parameters(flat: &Flat) -> Vec<Symbol> {
    let (start, moving) = (of_equations(flat, &flat.initial_equations), moving(flat));
    let is_alone = |it: &Symbol| start.contains(it) && !moving.contains(it);
    flat.symbols().filter(|it| flat.variable(*it).role == Role::Parameter).filter(is_alone).collect()
}

/// The names of the parameters that occur in the equations or in the start, directly or through other parameters.
pub(crate) fn used_parameters(flat: &Flat) -> Vec<&str> {
    let mut found = moving(flat);
    found.extend(of_equations(flat, &flat.initial_equations));
    // A start value or another parameter may depend on a parameter.
    let starts = flat.symbols().filter_map(|it| flat.variable(it).start);
    found.extend(starts.flat_map(|id| flat.pool.symbols(id)));
    let mut next = 0;
    while next < found.len() {
        if let Some(value) = flat.variable(found[next]).value {
            let further: Vec<Symbol> = flat.pool.symbols(value).into_iter().filter(|it| !found.contains(it)).collect();
            found.extend(further);
        }
        next += 1;
    }
    let is_parameter = |it: &&Symbol| flat.variable(**it).role == Role::Parameter;
    found.iter().filter(is_parameter).map(|it| flat.variable(*it).name.as_str()).collect()
}

fn of_equations(flat: &Flat, list: &[Equation]) -> Vec<Symbol> {
    list.iter().flat_map(|it| [it.left, it.right]).flat_map(|id| flat.pool.symbols(id)).collect()
}

/// The symbols of the equations, also of those that hold at events.
fn moving(flat: &Flat) -> Vec<Symbol> {
    let at_events = flat
        .clauses
        .iter()
        .flat_map(|it| it.assigned.iter().chain(&it.restarted).map(|it| it.1).chain(it.conditions.iter().copied()))
        .chain(flat.samples.iter().flat_map(|it| [it.start, it.period]))
        .flat_map(|id| flat.pool.symbols(id));
    of_equations(flat, &flat.equations).into_iter().chain(at_events).collect()
}
