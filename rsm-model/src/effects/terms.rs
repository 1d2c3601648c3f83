//! Finds the equation of a role: the equation that defines a variable, or the balance that contains a derivative.
//!
//! In: flat equations, a symbol. Out: the index of the equation, and the factor of the derivative. Changes no equation.

use std::collections::HashSet;

use crate::expression::{Binary, Derivative, Id, Node, Symbol, Unary};
use crate::flat::{Flat, Role};

/// The balance of a derivative.
pub(super) struct Balance {
    /// The index of the equation.
    pub equation: usize,
    /// The factor of the derivative in `left - right`, divided by the site's inertia or capacity; `None` if that is 1.
    pub share: Option<Id>,
}

/// The symbol, if an expression is only a symbol.
pub(super) fn symbol_of(flat: &Flat, id: Id) -> Option<Symbol> {
    match flat.pool.node(id) {
        Node::Symbol(symbol) => Some(symbol),
        _ => None,
    }
}

/// The equation that defines a symbol: the symbol is alone on one side and does not occur on the other. An equation of two symbols counts only if
/// there is no other; of several such equations, the one with the symbol on the left is used. `None` if there is none, or if it is ambiguous.
pub(super) fn definition(flat: &Flat, symbol: Symbol) -> Option<usize> {
    let rank = |it: &crate::flat::Equation| {
        let alone = |side: Id, other: Id| symbol_of(flat, side) == Some(symbol) && !flat.pool.symbols(other).contains(&symbol);
        let is_alias = symbol_of(flat, it.left).is_some() && symbol_of(flat, it.right).is_some();
        match (it.pairs.is_empty(), alone(it.left, it.right), alone(it.right, it.left)) {
            (true, true, _) => Some((is_alias, false)),
            (true, _, true) => Some((is_alias, true)),
            _ => None,
        }
    };
    let mut found: Vec<((bool, bool), usize)> =
        flat.equations.iter().enumerate().filter_map(|(k, it)| rank(it).map(|rank| (rank, k))).collect();
    found.sort_unstable();
    match found[..] {
        [] => None,
        [(_, first)] => Some(first),
        [(best, first), (next, _), ..] => (best != next).then_some(first),
    }
}

/// The other side of the equation that defines a symbol.
pub(super) fn law(flat: &Flat, symbol: Symbol) -> Option<Id> {
    let equation = &flat.equations[definition(flat, symbol)?];
    Some(if symbol_of(flat, equation.left) == Some(symbol) { equation.right } else { equation.left })
}

/// The allowed relative difference of an inertia and the factor of a derivative: rounding of the same sum in another order.
const SAME: f64 = 1e-9;

/// The balance with the derivative of `rate_of` and the site's inertia or capacity (1 if it has none).
///
/// # Errors
/// What is missing, in words.
pub(super) fn balance(flat: &mut Flat, rate_of: Symbol, inertia: Option<Id>) -> Result<Balance, String> {
    balance_through(flat, rate_of, Inertia { declared: inertia, here: inertia }, DEEPEST)
}

/// An inertia or a capacity: as declared at the site, and converted to the balance of the state, by the factor between the two speeds.
#[derive(Clone, Copy)]
struct Inertia {
    declared: Option<Id>,
    here: Option<Id>,
}

/// Whether an inertia is only a part of the derivative's factor, as `m` in `m + J/r^2`. If it is the whole factor, possibly times a constant, both
/// change in proportion with at least one of its parameters. If none of these parameters occurs in the factor, the equation was divided by the
/// inertia, and the result is false.
/// change in proportion with at least one of its parameters. If none of these parameters occurs, the equation was divided by the inertia, and the
/// result is false.
fn is_part(flat: &mut Flat, factor: Id, declared: Option<Id>, here: Id) -> bool {
    let Some(declared) = declared else { return false };
    let of_factor: HashSet<Symbol> = flat.pool.symbols(factor).into_iter().collect();
    let shared: Vec<Symbol> = flat.pool.symbols(declared).into_iter().filter(|it| of_factor.contains(it)).collect();
    let grows_alike = |flat: &mut Flat, symbol: Symbol| {
        let mut growth = |whole: Id| {
            let by = Derivative::by(&mut flat.pool, symbol).of(&mut flat.pool, whole);
            Some(flat.known(by)?.0 / flat.known(whole)?.0)
        };
        match (growth(factor), growth(here)) {
            (Some(one), Some(other)) => (one - other).abs() <= SAME * other.abs(),
            // If the values are unknown, no fault is reported.
            _ => true,
        }
    };
    !shared.is_empty() && !shared.into_iter().any(|symbol| grows_alike(flat, symbol))
}

/// The largest number of equations between a state and a speed that follows from it.
const DEEPEST: usize = 8;

fn balance_through(flat: &mut Flat, rate_of: Symbol, inertia: Inertia, depth: usize) -> Result<Balance, String> {
    let name = flat.variable(rate_of).name.clone();
    let Some(derivative) = flat.find(&format!("der({name})")) else {
        return followed(flat, rate_of, inertia, depth);
    };
    let holds: Vec<usize> = (0..flat.equations.len()).filter(|k| symbols(flat, *k).contains(&derivative)).collect();
    if holds.is_empty() {
        return followed(flat, rate_of, inertia, depth);
    }
    let one = flat.pool.number(1.0);
    let unit = inertia.here.unwrap_or(one);
    let wanted = flat.known(unit).map(|it| it.0.abs());
    let mut exact = Vec::new();
    let mut possible = Vec::new();
    let mut part_of = None;
    for k in holds {
        let (left, right) = (flat.equations[k].left, flat.equations[k].right);
        let residual = flat.pool.subtract(left, right);
        let factor = Derivative::by(&mut flat.pool, derivative).of(&mut flat.pool, residual);
        let found = flat.known(factor).map(|it| it.0.abs());
        let is_same = factor == unit || matches!((found, wanted), (Some(a), Some(b)) if (a - b).abs() <= SAME * b);
        if is_same {
            exact.push((k, factor));
        } else {
            let own: HashSet<Symbol> = symbols(flat, k).into_iter().collect();
            let of_inertia = flat.pool.symbols(unit);
            // An output that equals the derivative defines only itself; it is no balance.
            let gives_other = [left, right].into_iter().any(|side| {
                symbol_of(flat, side).is_some_and(|it| it != derivative && flat.variable(it).role == Role::Unknown)
            });
            let is_number = |it: &Symbol| matches!(flat.variable(*it).role, Role::Parameter | Role::Constant);
            if !gives_other && (of_inertia.is_empty() || of_inertia.iter().any(|it| is_number(it) && own.contains(it))) {
                if is_part(flat, factor, inertia.declared, unit) {
                    part_of = Some((k, factor));
                } else {
                    possible.push((k, factor));
                }
            }
        }
    }
    let list = if exact.is_empty() { possible } else { exact };
    match list[..] {
        [(equation, factor)] => {
            let share = if factor == unit {
                None
            } else if flat.pool.node(factor) == Node::Unary(Unary::Negate, unit) {
                Some(flat.pool.number(-1.0))
            } else {
                Some(flat.pool.divide(factor, unit))
            };
            Ok(Balance { equation, share })
        }
        [] if part_of.is_some() => {
            let (line, whole) = part_of.map_or((0, unit), |(k, whole)| (flat.line(&flat.equations[k].place.clone()), whole));
            Err(format!(
                "the balance of line {line} contains `der({name})` times `{}`; found `{}`, which is only a part of this factor, expected the whole inertia, mass or capacity",
                flat.text(whole),
                flat.text(unit)
            ))
        }
        [] => Err(format!(
            "no equation contains `der({name})` together with `{}`: expected the inertia, mass or capacity of that balance",
            flat.text(unit)
        )),
        _ => {
            let lines: Vec<String> = list.iter().map(|it| flat.line(&flat.equations[it.0].place.clone()).to_string()).collect();
            Err(format!("several equations contain `der({name})`, expected one: those of lines {}", lines.join(", ")))
        }
    }
}

/// The terms of `left - right`, divided by the factor of the balance.
pub(super) fn summands(flat: &mut Flat, balance: &Balance) -> Vec<Id> {
    let equation = &flat.equations[balance.equation];
    let mut open = vec![equation.left, equation.right];
    let mut found = Vec::new();
    while let Some(id) = open.pop() {
        match flat.pool.node(id) {
            Node::Binary(Binary::Add | Binary::Subtract, a, b) => open.extend([a, b]),
            Node::Unary(Unary::Negate, a) => open.push(a),
            _ => found.push(id),
        }
    }
    match balance.share {
        Some(share) => found.into_iter().map(|it| flat.pool.divide(it, share)).collect(),
        None => found,
    }
}

fn symbols(flat: &Flat, equation: usize) -> Vec<Symbol> {
    let it = &flat.equations[equation];
    let mut list = flat.pool.symbols(it.left);
    list.extend(flat.pool.symbols(it.right));
    list
}

/// The balance for a speed that is not a state but is computed from one, as `road_speed = radius*wheel_speed`. An effort on the speed acts on the
/// state through the same factor.
fn followed(flat: &mut Flat, symbol: Symbol, inertia: Inertia, depth: usize) -> Result<Balance, String> {
    let name = flat.variable(symbol).name.clone();
    let none = || format!("no equation contains `der({name})`, and `{name}` does not follow from a single state");
    let value = law(flat, symbol).filter(|_| depth > 0).ok_or_else(none)?;
    let unknown: Vec<Symbol> =
        flat.pool.symbols(value).into_iter().filter(|it| flat.variable(*it).role == Role::Unknown).collect();
    let [inner] = unknown[..] else { return Err(none()) };
    let factor = Derivative::by(&mut flat.pool, inner).of(&mut flat.pool, value);
    // m dv/dt = F and v = k w: the factor of dw/dt in its own balance is m k^2.
    let here = inertia.here.map(|it| {
        let square = flat.pool.multiply(factor, factor);
        flat.pool.multiply(it, square)
    });
    let balance = balance_through(flat, inner, Inertia { here, ..inertia }, depth - 1)?;
    let share = balance.share.unwrap_or_else(|| flat.pool.number(1.0));
    Ok(Balance { share: Some(flat.pool.multiply(share, factor)), ..balance })
}
