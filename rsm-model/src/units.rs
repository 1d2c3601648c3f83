//! Checks the units of every equation.
//!
//! In: a flat system. Out: how many equations were checked, or a fault for each sum, comparison, argument or equation whose parts have different
//! units.
//!
//! A variable without a unit matches every unit, and results computed from it are not checked. A number in a sum or a comparison matches every unit
//! too: in `T - 293.15` it has the unit of `T`. In a product, a multiple of 1/4 up to 16 is a pure number, as in `0.5*m*v^2`. Any other number may
//! have a unit that the text does not state, as 9.81 in `9.81*m`. Scale factors are checked too: km/h is not m/s. `rsm-fit` interprets the units,
//! with a library.

use std::collections::HashMap;
use std::ops::Range;

use rsm_core::source::{Collector, Faults};
use rsm_fit::units::{Dimension, dimension};

use crate::expression::{Binary, Id, Node, Symbol, Unary};
use crate::flat::{Basic, Flat, Role};

/// The result of the check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Checked {
    /// The number of equations whose sides have units that agree.
    pub equations: usize,
    /// The number of equations with a part without a unit, which cannot be checked completely.
    pub unchecked: usize,
}

/// Exponents are counted in twelfths, so that roots of products stay exact.
const TWELFTHS: i32 = 12;

/// The unit of an expression.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Measure {
    /// Unknown: matches every unit.
    Any,
    /// A number of the text, and whether it is a pure number in a product.
    Literal(bool),
    Known(Unit),
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Unit {
    exponents: [i32; 7],
    factor: f64,
    has_offset: bool,
}

const PURE: Unit = Unit { exponents: [0; 7], factor: 1.0, has_offset: false };

impl From<Dimension> for Unit {
    fn from(dimension: Dimension) -> Self {
        Unit {
            exponents: dimension.exponents.map(|exponent| TWELFTHS * exponent),
            factor: dimension.factor,
            has_offset: dimension.has_offset,
        }
    }
}

impl Unit {
    fn agrees(self, other: Unit) -> bool {
        // Factors are products of a few rounded numbers.
        self.exponents == other.exponents && (self.factor / other.factor - 1.0).abs() < 1e-9
    }

    fn times(self, other: Unit, sign: i32) -> Unit {
        let mut exponents = self.exponents;
        for (exponent, of) in exponents.iter_mut().zip(other.exponents) {
            *exponent += sign * of;
        }
        let factor = if sign > 0 { self.factor * other.factor } else { self.factor / other.factor };
        Unit { exponents, factor, has_offset: false }
    }

    /// In words: an SI name if there is one, otherwise base units.
    fn text(self) -> String {
        const NAMED: &[(&str, [i32; 7])] = &[
            ("no dimension (1 or rad)", [0, 0, 0, 0, 0, 0, 0]),
            ("N", [1, 1, -2, 0, 0, 0, 0]),
            ("N.m", [1, 2, -2, 0, 0, 0, 0]),
            ("W", [1, 2, -3, 0, 0, 0, 0]),
            ("Pa", [1, -1, -2, 0, 0, 0, 0]),
            ("V", [1, 2, -3, -1, 0, 0, 0]),
            ("Ohm", [1, 2, -3, -2, 0, 0, 0]),
            ("V.s", [1, 2, -2, -1, 0, 0, 0]),
        ];
        let named = NAMED.iter().find(|(_, exponents)| exponents.map(|exponent| TWELFTHS * exponent) == self.exponents);
        let kind = named.map_or_else(
            || {
                let bases = ["kg", "m", "s", "A", "K", "mol", "cd"];
                let of = |exponent: i32| match (exponent % TWELFTHS == 0, exponent / TWELFTHS) {
                    (true, 1) => String::new(),
                    (true, whole) => whole.to_string(),
                    (false, _) => format!("({exponent}/{TWELFTHS})"),
                };
                let parts: Vec<String> = bases
                    .iter()
                    .zip(self.exponents)
                    .filter(|(_, exponent)| *exponent != 0)
                    .map(|(base, exponent)| format!("{base}{}", of(exponent)))
                    .collect();
                parts.join(".")
            },
            |(name, _)| (*name).to_string(),
        );
        let kind = if self.has_offset { format!("{kind} from another zero") } else { kind };
        if (self.factor - 1.0).abs() < 1e-9 { kind } else { format!("{} times {kind}", self.factor) }
    }
}

struct Checker<'f> {
    flat: &'f Flat,
    faults: Collector,
    texts: HashMap<String, Measure>,
    done: HashMap<Id, Measure>,
    place: Range<usize>,
}

/// Checks the units of a flat system.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_model::{flat::{Flat, Options}, units};
///
/// let text = "model M\n  Real x(unit = \"m\");\n  Real v(unit = \"m/s\");\nequation\n  der(x) = v;\n  v = 2*x;\nend M;\n";
/// let flat = Flat::read(&Source::new("m.mo", text), &Options::default())?;
/// let told = units::check(&flat).unwrap_err().to_string();
/// assert!(told.starts_with("m.mo:6:3: the sides of an equation measure different things: `v` is in m.s-1, `2*x` in m"), "{told}");
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
///
/// # Errors
/// Every place where units do not agree, and every unknown unit.
pub fn check(flat: &Flat) -> Result<Checked, Faults> {
    let mut checker = Checker { flat, faults: Collector::new(), texts: HashMap::new(), done: HashMap::new(), place: 0..0 };
    let mut checked = Checked::default();
    for equation in flat.equations.iter().chain(&flat.initial_equations) {
        let sides = [(equation.left, equation.right)];
        let pairs = if equation.pairs.is_empty() { &sides[..] } else { &equation.pairs };
        let mut all = true;
        for (left, right) in pairs {
            all &= checker.equal(*left, *right, &equation.place, "the sides of an equation");
        }
        if all {
            checked.equations += 1;
        } else {
            checked.unchecked += 1;
        }
    }
    for clause in &flat.clauses {
        for condition in &clause.conditions {
            checker.measure(*condition, &clause.place);
        }
        for (symbol, value) in clause.assigned.iter().chain(&clause.restarted) {
            checker.given(*symbol, *value, &clause.place, "the value at an event");
        }
    }
    for check in &flat.checks {
        checker.measure(check.condition, &check.place);
    }
    for symbol in flat.symbols() {
        let variable = flat.variable(symbol);
        for value in variable.value.iter().chain(&variable.start) {
            checker.given(symbol, *value, &variable.place, "its value");
        }
    }
    checker.faults.finish(Some(checked))
}

impl Checker<'_> {
    fn fault(&mut self, what: String) {
        let help = "check the equation, and the units of the variables in it; a variable without a unit is not checked";
        self.faults.push(self.flat.fault(&self.place, what).help(help));
    }

    /// Whether both sides have units; these then agree.
    fn equal(&mut self, left: Id, right: Id, place: &Range<usize>, what: &str) -> bool {
        let (a, b) = (self.measure(left, place), self.measure(right, place));
        self.place = place.clone();
        let text = |id: Id| self.flat.text(id);
        let (left, right) = (text(left), text(right));
        self.same(a, b, what, &left, &right);
        let is_known = |measure: Measure| !matches!(measure, Measure::Any);
        is_known(a) && is_known(b)
    }

    fn given(&mut self, symbol: Symbol, value: Id, place: &Range<usize>, what: &str) {
        let (own, its) = (self.of_symbol(symbol), self.measure(value, place));
        self.place = place.clone();
        let (name, text) = (self.flat.variable(symbol).name.clone(), self.flat.text(value));
        self.same(own, its, &format!("`{name}` and {what}"), &name, &text);
    }

    /// The common unit of two expressions that must have the same unit.
    fn same(&mut self, a: Measure, b: Measure, what: &str, left: &str, right: &str) -> Measure {
        match (a, b) {
            (Measure::Known(x), Measure::Known(y)) => {
                if !x.agrees(y) || x.has_offset != y.has_offset {
                    self.fault(format!(
                        "{what} measure different things: `{left}` is in {}, `{right}` in {}",
                        x.text(),
                        y.text()
                    ));
                    return Measure::Any;
                }
                a
            }
            (Measure::Known(_), Measure::Literal(_)) => a,
            (Measure::Literal(_), Measure::Known(_)) => b,
            (Measure::Literal(x), Measure::Literal(y)) => Measure::Literal(x && y),
            _ => Measure::Any,
        }
    }

    fn of_text(&mut self, text: &str) -> Measure {
        if let Some(known) = self.texts.get(text) {
            return *known;
        }
        // In the notation of the language, a point is a product.
        let found = dimension(&text.replace('.', "*"));
        let measure = match found {
            Ok(dimension) => Measure::Known(dimension.into()),
            Err(what) => {
                self.fault(format!("the unit \"{text}\": {what}"));
                Measure::Any
            }
        };
        self.texts.insert(text.to_string(), measure);
        measure
    }

    fn of_symbol(&mut self, symbol: Symbol) -> Measure {
        let variable = self.flat.variable(symbol);
        match variable.role {
            Role::Derivative(of) => match self.of_symbol(of) {
                Measure::Known(unit) => {
                    let second = Unit { exponents: [0, 0, TWELFTHS, 0, 0, 0, 0], ..PURE };
                    Measure::Known(unit.times(second, -1))
                }
                _ => Measure::Any,
            },
            Role::Before(of) | Role::Guess(of) => self.of_symbol(of),
            Role::Sample(_) | Role::Acts(_) | Role::Held(_) => Measure::Known(PURE),
            _ => match (&variable.unit, variable.basic) {
                (Some(unit), _) => {
                    let (unit, place) = (unit.clone(), variable.place.clone());
                    let outside = std::mem::replace(&mut self.place, place);
                    let measure = self.of_text(&unit);
                    self.place = outside;
                    measure
                }
                (None, Basic::Real) => Measure::Any,
                (None, _) => Measure::Known(PURE),
            },
        }
    }

    /// The unit of an expression; faults are reported at `place`.
    fn measure(&mut self, root: Id, place: &Range<usize>) -> Measure {
        self.place = place.clone();
        let mut open = vec![(root, false)];
        while let Some((id, is_ready)) = open.pop() {
            if self.done.contains_key(&id) {
                continue;
            }
            if is_ready {
                let measure = self.of_node(id);
                self.done.insert(id, measure);
            } else {
                open.push((id, true));
                self.flat.pool.operands(id, |operand| open.push((operand, false)));
            }
        }
        self.done[&root]
    }

    fn of_node(&mut self, id: Id) -> Measure {
        let of = |checker: &Self, id: Id| checker.done[&id];
        match self.flat.pool.node(id) {
            Node::Number(bits) => {
                let value = f64::from_bits(bits);
                Measure::Literal((4.0 * value).fract() == 0.0 && value.abs() <= 16.0)
            }
            Node::Symbol(symbol) => self.of_symbol(symbol),
            Node::Unary(operation, a) => self.of_unary(operation, of(self, a), a),
            Node::Binary(operation, a, b) => self.of_binary(operation, (a, of(self, a)), (b, of(self, b))),
            Node::If(_, then, otherwise) => {
                let (a, b) = (of(self, then), of(self, otherwise));
                let (left, right) = (self.flat.text(then), self.flat.text(otherwise));
                self.same(a, b, "the values of `if`", &left, &right)
            }
            Node::Surface(number, list) => {
                let (arguments, orders) = self.flat.pool.list(list).clone();
                let surface = &self.flat.surfaces[number as usize];
                if orders.iter().any(|order| *order > 0) {
                    return Measure::Any;
                }
                let (inputs, unit, name) = (surface.inputs.clone(), surface.unit.clone(), surface.name.clone());
                for (argument, (input, unit)) in arguments.iter().zip(inputs) {
                    let Some(unit) = unit else { continue };
                    let (a, b) = (self.of_text(&unit), of(self, *argument));
                    let text = self.flat.text(*argument);
                    self.same(a, b, &format!("an argument of `{name}` and the given expression"), &input, &text);
                }
                unit.map_or(Measure::Any, |unit| self.of_text(&unit))
            }
        }
    }

    fn of_unary(&mut self, operation: Unary, a: Measure, inner: Id) -> Measure {
        match operation {
            Unary::Negate | Unary::Absolute | Unary::Floor => a,
            Unary::Root => match a {
                Measure::Known(unit) => Measure::Known(Unit {
                    exponents: unit.exponents.map(|exponent| exponent / 2),
                    factor: unit.factor.sqrt(),
                    has_offset: false,
                }),
                other => other,
            },
            Unary::Sign | Unary::Not => Measure::Known(PURE),
            _ => {
                if let Measure::Known(unit) = a
                    && !unit.agrees(PURE)
                {
                    let text = self.flat.text(inner);
                    self.fault(format!(
                        "the argument `{text}` of a function is in {}, expected rad or a pure number",
                        unit.text()
                    ));
                }
                Measure::Known(PURE)
            }
        }
    }

    fn of_binary(&mut self, operation: Binary, (left, a): (Id, Measure), (right, b): (Id, Measure)) -> Measure {
        let pure = |measure: Measure| match measure {
            Measure::Literal(true) => Some(PURE),
            Measure::Known(unit) => Some(unit),
            _ => None,
        };
        match operation {
            Binary::Multiply | Binary::Divide => {
                if let (Measure::Literal(x), Measure::Literal(y)) = (a, b) {
                    return Measure::Literal(x && y);
                }
                let sign = if operation == Binary::Multiply { 1 } else { -1 };
                match (pure(a), pure(b)) {
                    (Some(x), Some(y)) => Measure::Known(x.times(y, sign)),
                    _ => Measure::Any,
                }
            }
            Binary::Power => match (a, self.flat.pool.value(right)) {
                (Measure::Known(unit), Some(exponent)) if unit != PURE => {
                    let scaled = unit.exponents.map(|of| f64::from(of) * exponent);
                    if scaled.iter().any(|of| of.fract() != 0.0) {
                        return Measure::Any;
                    }
                    let exponents = scaled.map(|of| of as i32);
                    Measure::Known(Unit { exponents, factor: unit.factor.powf(exponent), has_offset: false })
                }
                (Measure::Known(unit), _) if unit.agrees(PURE) => a,
                _ => Measure::Any,
            },
            Binary::And | Binary::Or => Measure::Known(PURE),
            Binary::Add | Binary::Subtract if has_offset(a) || has_offset(b) => offset_sum(operation, a, b),
            _ => {
                let (x, y) = (self.flat.text(left), self.flat.text(right));
                let what = match operation {
                    Binary::Add | Binary::Subtract => "the terms of a sum",
                    Binary::Less | Binary::LessNow => "the sides of a comparison",
                    _ => "the arguments of a function",
                };
                let both = self.same(a, b, what, &x, &y);
                match operation {
                    Binary::Less | Binary::LessNow | Binary::Arctangent2 => Measure::Known(PURE),
                    _ => both,
                }
            }
        }
    }
}

fn has_offset(measure: Measure) -> bool {
    matches!(measure, Measure::Known(unit) if unit.has_offset)
}

/// Temperatures in degC: their difference is in K; a temperature plus a difference is a temperature.
fn offset_sum(operation: Binary, a: Measure, b: Measure) -> Measure {
    match (a, b) {
        (Measure::Known(x), Measure::Known(y)) if x.exponents == y.exponents && x.factor == y.factor => {
            Measure::Known(Unit { has_offset: !(x.has_offset && y.has_offset && operation == Binary::Subtract), ..x })
        }
        _ => Measure::Any,
    }
}

#[cfg(test)]
mod tests {
    use rsm_core::source::Source;

    use super::*;
    use crate::flat::Options;

    fn checked(declarations: &str, equations: &str) -> Result<Checked, String> {
        let text = format!("model M\n{declarations}\nequation\n{equations}\nend M;\n");
        let flat = Flat::read(&Source::new("m.mo", text), &Options::default()).unwrap_or_else(|faults| panic!("{faults}"));
        check(&flat).map_err(|faults| faults.to_string())
    }

    const MOTION: &str = "parameter Real m(unit = \"kg\") = 2; parameter Real b(unit = \"N.s/m\") = 0.1; input Real f(unit = \"N\"); \
                          Real v(unit = \"m/s\"), k(unit = \"km/h\"), a(unit = \"deg\"), p; parameter Real T(unit = \"degC\") = 20, U(unit = \"degC\") = 3, \
                          dT(unit = \"K\") = 1;";

    #[test]
    fn equations_that_agree_are_counted() {
        let found = checked(
            MOTION,
            "m*der(v) = f - b*v; f*v = 0.5*m*v^2*p; k = 3.6*v; f = 9.81*m; T - U = dT; v = sqrt(f/m)*p; v = max(v, 1); sin(3.0) = m/m;",
        );
        // p has no unit, 3.6 and 9.81 may have one.
        assert_eq!(found, Ok(Checked { equations: 4, unchecked: 4 }));
    }

    #[test]
    fn every_disagreement_is_told_with_its_line() {
        let told = checked(
            MOTION,
            "m*der(v) = f + b;\nk = v;\nsin(a) = 1;\nif v > f then p = 1; else p = 2; end if;\nT = dT;\nf = if p > 1 then v else f;\nv = 2*f;",
        )
        .unwrap_err();
        for (place, what) in [
            ("4:1", "the terms of a sum measure different things: `f` is in N, `b` in kg.s-1"),
            (
                "5:1",
                "the sides of an equation measure different things: `k` is in 0.2777777777777778 times m.s-1, `v` in m.s-1",
            ),
            ("6:1", "the argument `a` of a function is in 0.017453292519943295 times no dimension"),
            ("7:1", "the sides of a comparison"),
            ("8:1", "`T` is in K from another zero, `dT` in K"),
            ("9:1", "the values of `if`"),
            ("10:1", "`v` is in m.s-1, `2*f` in N"),
        ] {
            assert!(told.contains(&format!("m.mo:{place}: ")) && told.contains(what), "{place} {what}\n{told}");
        }
        assert_eq!(told.matches("m.mo:").count(), 7, "{told}");
    }

    #[test]
    fn a_text_that_is_no_unit_is_told_at_its_variable() {
        let told = checked("Real x(unit = \"parsnip\");", "x = 1;").unwrap_err();
        assert!(told.contains("m.mo:2:6: the unit \"parsnip\""), "{told}");
    }
}
