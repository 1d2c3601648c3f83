//! Values of expressions of constants and parameters, known before a simulation.

use std::collections::HashMap;

use crate::expression::{Id, Pool, Symbol, Values};

use super::{Role, Variable};

/// The value of an expression of constants and parameters, and the parameters that it depends on.
pub(crate) fn known(pool: &Pool, variables: &[Variable], id: Id) -> Option<(f64, Vec<Symbol>)> {
    if let Some(value) = pool.value(id) {
        return Some((value, Vec::new()));
    }
    // Values of symbols that depend on one another, depth first. If a symbol occurs again before it has a value, it depends on itself.
    let mut found: HashMap<Symbol, f64> = HashMap::new();
    let mut used = Vec::new();
    let mut open = vec![(None, id)];
    while let Some((symbol, root)) = open.last().copied() {
        let missing = pool.symbols(root).into_iter().find(|symbol| !found.contains_key(symbol));
        if let Some(missing) = missing {
            let variable = &variables[missing.0 as usize];
            let value = variable.value.filter(|_| matches!(variable.role, Role::Constant | Role::Parameter))?;
            if open.iter().any(|(symbol, _)| *symbol == Some(missing)) {
                return None;
            }
            if variable.role == Role::Parameter {
                used.push(missing);
            }
            open.push((Some(missing), value));
            continue;
        }
        let mut values = Values::new(pool);
        for (symbol, value) in &found {
            values.set(*symbol, *value);
        }
        let value = values.of(root);
        match symbol {
            Some(symbol) => {
                found.insert(symbol, value);
                open.pop();
            }
            None => return value.is_finite().then_some((value, used)),
        }
    }
    None
}
