//! Equations: tree to scalar equations.

use crate::expression::{Id, Node, Symbol};
use crate::syntax::tree::{self, EquationKind, Expression, Kind, Span};

use super::builtins::text_of;
use super::translate::Translator;
use super::{Basic, Check, Clause, Equation, Role};

/// The equations that are written out.
#[derive(Debug, Default)]
pub(super) struct Written {
    pub(super) equations: Vec<Equation>,
    pub(super) clauses: Vec<Clause>,
    pub(super) checks: Vec<Check>,
}

impl Translator<'_> {
    /// Translates equations, and reports every fault in them.
    pub(super) fn write_out(&mut self, equations: &[tree::Equation], is_initial: bool, written: &mut Written) {
        for equation in equations {
            let _: Option<()> = self.equation(equation, is_initial, written);
        }
    }

    fn equation(&mut self, equation: &tree::Equation, is_initial: bool, written: &mut Written) -> Option<()> {
        match &equation.kind {
            EquationKind::Equal(left, right) => {
                let found = self.equal(left, right, &equation.span)?;
                written.equations.extend(found);
            }
            EquationKind::If(branches, otherwise) => {
                let found = self.if_equation(branches, otherwise, &equation.span, is_initial, written)?;
                written.equations.extend(found);
            }
            EquationKind::For(index, range, body) => {
                self.each(index, range, |translator| {
                    translator.write_out(body, is_initial, written);
                    Some(())
                })?;
            }
            EquationKind::When(_) if is_initial => {
                return self.fault(
                    &equation.span,
                    "found a `when` among the initial equations",
                    "write an equation for the start instead",
                );
            }
            EquationKind::When(branches) => self.when(branches, written)?,
            EquationKind::Call(call) => self.check(call, written)?,
        }
        Some(())
    }

    fn equal(&mut self, left: &Expression, right: &Expression, span: &Span) -> Option<Vec<Equation>> {
        let (a, b) = (self.value(left), self.value(right));
        let (a, b) = (a?, b?);
        if (a.basic == Basic::Boolean) != (b.basic == Basic::Boolean) {
            let what = format!("found an equation between {} and {}", a.basic.word(), b.basic.word());
            return self.fault(span, what, "write `if condition then 1 else 0`");
        }
        if a.sizes != b.sizes {
            let what = format!("found an equation between {} and {}", a.shape(), b.shape());
            return self.fault(span, what, "both sides of an equation must have the same shape");
        }
        // An integer unknown cannot be computed from real values.
        for (side, other, at) in [(&a, &b, left), (&b, &a, right)] {
            if side.basic == Basic::Integer && other.basic == Basic::Real && matches!(at.kind, Kind::Name(_)) {
                let what = "found an expression of type Real for an Integer variable";
                return self.fault(span, what, "declare it Real, or round: `integer(x)`");
            }
        }
        let pairs = a.items.into_iter().zip(b.items);
        Some(pairs.map(|(left, right)| Equation { left, right, place: span.clone(), pairs: Vec::new() }).collect())
    }

    /// `assert(condition, "message")` is the only call allowed as a statement outside of a `when`.
    fn check(&mut self, call: &Expression, written: &mut Written) -> Option<()> {
        let Kind::Call(name, arguments, named) = &call.kind else { return None };
        if name != "assert" {
            if name == "reinit" {
                return self.fault(
                    &call.span,
                    "`reinit` outside of a `when`",
                    "write it in the `when` that says at which event it acts",
                );
            }
            self.call(name, arguments, named, &call.span)?;
            return self.fault(&call.span, format!("the value of `{name}` is not used"), "write an equation");
        }
        let (Some(condition), Some(message)) = (arguments.first(), arguments.get(1)) else {
            return self.fault(&call.span, "`assert` has a condition and a message", "");
        };
        let condition = self.without_switches_condition(condition)?;
        let message = text_of(message).unwrap_or_else(|| self.source.text()[message.span.clone()].to_string());
        written.checks.push(Check { condition, message, place: call.span.clone() });
        Some(())
    }

    fn without_switches_condition(&mut self, condition: &Expression) -> Option<Id> {
        let outside = std::mem::replace(&mut self.without_events, true);
        let condition = self.condition(condition);
        self.without_events = outside;
        condition
    }

    /// An if-equation gives as many equations as each of its branches has.
    fn if_equation(
        &mut self,
        branches: &[(Expression, Vec<tree::Equation>)],
        otherwise: &[tree::Equation],
        span: &Span,
        is_initial: bool,
        written: &mut Written,
    ) -> Option<Vec<Equation>> {
        let mut conditions = Vec::new();
        let mut bodies = Vec::new();
        for (condition, body) in branches {
            conditions.push(self.condition(condition));
            bodies.push(self.branch(body, is_initial, written));
        }
        bodies.push(self.branch(otherwise, is_initial, written));
        let conditions: Option<Vec<Id>> = conditions.into_iter().collect();
        let bodies: Option<Vec<Vec<Equation>>> = bodies.into_iter().collect();
        let (conditions, mut bodies) = (conditions?, bodies?);
        let count = bodies[0].len();
        // A condition on Boolean parameters alone selects the equations of the plant, possibly with other states.
        let is_choice = conditions.iter().all(|condition| {
            let symbols = self.pool.symbols(*condition);
            let of = |symbol: &Symbol| &self.variables[symbol.0 as usize];
            symbols.iter().all(|it| of(it).role == Role::Parameter && of(it).basic == Basic::Boolean)
                && super::known::known(&self.pool, &self.variables, *condition).is_some()
        });
        if is_choice || bodies.iter().any(|body| body.len() != count) {
            // The branches have different lengths, so one of them is selected permanently.
            let mut chosen = bodies.len() - 1;
            for (k, condition) in conditions.iter().enumerate() {
                match self.known(*condition) {
                    Some(0.0) => {}
                    Some(_) => {
                        chosen = k;
                        break;
                    }
                    None => {
                        let counts: Vec<String> = bodies.iter().map(|body| body.len().to_string()).collect();
                        let what = format!("the branches of an if-equation have {} equations", counts.join(" and "));
                        return self.fault(span, what, "give every branch, `else` too, as many equations");
                    }
                }
            }
            return Some(bodies.swap_remove(chosen));
        }
        let last = bodies.pop()?;
        let mut merged = Vec::new();
        for (k, equation) in last.iter().enumerate() {
            merged.push(self.merge(k, equation, &conditions, &bodies, span));
        }
        Some(merged)
    }

    fn branch(&mut self, body: &[tree::Equation], is_initial: bool, written: &mut Written) -> Option<Vec<Equation>> {
        let mut inner = Written::default();
        let before = self.told;
        for equation in body {
            if matches!(equation.kind, EquationKind::When(_)) {
                let _: Option<()> =
                    self.fault(&equation.span, "a `when` inside an `if`", "write the condition into the `when`");
                continue;
            }
            let _: Option<()> = self.equation(equation, is_initial, &mut inner);
        }
        if let Some(check) = inner.checks.first() {
            let place = check.place.clone();
            let _: Option<()> =
                self.fault(&place, "an `assert` inside an `if`", "write the condition into it: assert(not c or ..., \"...\")");
        }
        written.clauses.append(&mut inner.clauses);
        (self.told == before).then_some(inner.equations)
    }

    /// Combines the corresponding equations of all branches into one.
    fn merge(&mut self, k: usize, last: &Equation, conditions: &[Id], bodies: &[Vec<Equation>], span: &Span) -> Equation {
        // Equations correspond by the symbol alone on the left, if every branch has it; otherwise by position.
        let is_name = matches!(self.pool.node(last.left), Node::Symbol(_));
        let same: Option<Vec<&Equation>> =
            bodies.iter().map(|body| body.iter().find(|equation| is_name && equation.left == last.left)).collect();
        if let Some(same) = same {
            let mut right = last.right;
            for (condition, equation) in conditions.iter().zip(&same).rev() {
                right = self.pool.choose(*condition, equation.right, right);
            }
            return Equation { left: last.left, right, place: span.clone(), pairs: Vec::new() };
        }
        let mut pairs = vec![(last.left, last.right)];
        let mut residual = self.pool.subtract(last.left, last.right);
        for (condition, body) in conditions.iter().zip(bodies).rev() {
            let equation = &body[k];
            pairs.push((equation.left, equation.right));
            let other = self.pool.subtract(equation.left, equation.right);
            residual = self.pool.choose(*condition, other, residual);
        }
        let zero = self.pool.number(0.0);
        Equation { left: residual, right: zero, place: span.clone(), pairs }
    }

    fn when(&mut self, branches: &[(Expression, Vec<tree::Equation>)], written: &mut Written) -> Option<()> {
        let first = written.clauses.len();
        for (condition, body) in branches {
            let conditions = match &condition.kind {
                // One of several conditions.
                Kind::Array(items) => items.iter().map(|item| self.condition(item)).collect::<Option<Vec<Id>>>()?,
                _ => vec![self.condition(condition)?],
            };
            let mut clause = Clause {
                conditions,
                unless: (first..written.clauses.len()).collect(),
                assigned: Vec::new(),
                restarted: Vec::new(),
                place: condition.span.clone(),
            };
            let was = std::mem::replace(&mut self.at_event, true);
            for equation in body {
                let _: Option<()> = self.event(equation, &mut clause);
            }
            self.at_event = was;
            written.clauses.push(clause);
        }
        Some(())
    }

    /// An equation inside a `when`. Its comparisons are evaluated at the event, so they are no switches.
    fn event(&mut self, equation: &tree::Equation, clause: &mut Clause) -> Option<()> {
        let outside = std::mem::replace(&mut self.without_events, true);
        let done = self.event_inside(equation, clause);
        self.without_events = outside;
        done
    }

    fn event_inside(&mut self, equation: &tree::Equation, clause: &mut Clause) -> Option<()> {
        match &equation.kind {
            EquationKind::Equal(left, right) => {
                for equation in self.equal(left, right, &equation.span)? {
                    let target = self.target(equation.left, &left.span)?;
                    self.variables[target.0 as usize].is_discrete = true;
                    clause.assigned.push((target, equation.right));
                }
                Some(())
            }
            EquationKind::Call(Expression { kind: Kind::Call(name, arguments, _), span }) if name == "reinit" => {
                let [state, value] = &arguments[..] else {
                    return self.fault(span, "`reinit` has a state and a value", "");
                };
                let (target, value) = (self.number(state), self.number(value));
                let target = self.target(target?, &state.span)?;
                clause.restarted.push((target, value?));
                Some(())
            }
            EquationKind::Call(call) => self.check_at_event(call),
            EquationKind::If(branches, otherwise) => {
                let mut parts = Vec::new();
                for (condition, body) in branches {
                    let condition = self.condition(condition);
                    let mut inner = Clause { assigned: Vec::new(), restarted: Vec::new(), ..clause.clone() };
                    for equation in body {
                        let _: Option<()> = self.event_inside(equation, &mut inner);
                    }
                    parts.push((condition, inner));
                }
                let mut rest = Clause { assigned: Vec::new(), restarted: Vec::new(), ..clause.clone() };
                for equation in otherwise {
                    let _: Option<()> = self.event_inside(equation, &mut rest);
                }
                for (condition, inner) in parts.into_iter().rev() {
                    let condition = condition?;
                    rest.assigned = self.chosen(condition, &inner.assigned, &rest.assigned, true);
                    rest.restarted = self.chosen(condition, &inner.restarted, &rest.restarted, false);
                }
                clause.assigned.extend(rest.assigned);
                clause.restarted.extend(rest.restarted);
                Some(())
            }
            EquationKind::For(index, range, body) => {
                self.each(index, range, |translator| {
                    for equation in body {
                        let _: Option<()> = translator.event_inside(equation, clause);
                    }
                    Some(())
                })?;
                Some(())
            }
            EquationKind::When(_) => {
                self.fault(&equation.span, "a `when` inside a `when`", "write `when` after `when`, or `elsewhen`")
            }
        }
    }

    fn check_at_event(&mut self, call: &Expression) -> Option<()> {
        self.fault(
            &call.span,
            "found a call, expected an equation `x = ...` or `reinit(x, ...)` inside a `when`",
            "write an `assert` outside of the `when`",
        )
    }

    /// The variable to which an equation of a `when` assigns a value.
    fn target(&mut self, id: Id, span: &Span) -> Option<Symbol> {
        match self.pool.node(id) {
            Node::Symbol(symbol) if self.variables[symbol.0 as usize].role == Role::Unknown => Some(symbol),
            _ => {
                self.fault(span, "found an expression, expected a variable that takes a value at the event", "write `x = ...`")
            }
        }
    }

    /// Assignments under a condition. A variable that only one branch assigns keeps its value in the other.
    fn chosen(&mut self, condition: Id, then: &[(Symbol, Id)], otherwise: &[(Symbol, Id)], holds: bool) -> Vec<(Symbol, Id)> {
        let mut symbols: Vec<Symbol> = then.iter().chain(otherwise).map(|(symbol, _)| *symbol).collect();
        symbols.sort_unstable();
        symbols.dedup();
        let mut all = Vec::new();
        for symbol in symbols {
            let kept = if holds { super::derived(&mut self.variables, &mut self.names, Role::Before(symbol)) } else { symbol };
            let kept = self.pool.symbol(kept);
            let of = |list: &[(Symbol, Id)]| list.iter().find(|(its, _)| *its == symbol).map_or(kept, |(_, value)| *value);
            let (a, b) = (of(then), of(otherwise));
            all.push((symbol, self.pool.choose(condition, a, b)));
        }
        all
    }
}
