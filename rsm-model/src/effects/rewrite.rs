//! Adds effects to the equations of a plant.
//!
//! In: flat equations, sites, placed effects. Out: flat equations with the effects, with a parameter for each of their numbers; and the delays, which
//! equations cannot express.
//!
//! Input signals are changed first, then the inner laws, then the readings. In each group, effects are added in the order of the file. A law that
//! replaces a role refers to the value before the change, so a later effect acts on the result of the earlier ones.

mod laws;
mod places;

use std::collections::HashMap;
use std::ops::Range;

use rsm_core::source::{Collector, Faults, Source};

use crate::expression::{Id, Replacement, Symbol};
use crate::flat::{Equation, Flat, Role, Value};
use crate::syntax::tree::Expression;

use super::file::{Change, Effect, State};
use super::site::{Site, SiteKind};
use super::terms;
use places::Bound;

/// An effect at its place.
#[derive(Debug, Clone)]
pub struct Placed<'e> {
    /// The effect.
    pub effect: &'e Effect,
    /// The site, input, output, parameter or state; `None` if only one is possible.
    pub at: Option<String>,
    /// Its numbers.
    pub numbers: Vec<(String, f64)>,
    /// The file that contains it.
    pub source: Source,
    /// The position in that file.
    pub place: Range<usize>,
}

/// A delayed signal: an input of the extended plant that follows another signal.
#[derive(Debug, Clone, Copy)]
pub struct Delay {
    /// The delayed input in the equations.
    pub late: Symbol,
    /// The signal that it follows: an input, or a variable that a `when` assigns.
    pub of: Symbol,
    /// The delay in s: an expression of parameters.
    pub delay: Id,
}

/// An output with a delayed reading.
#[derive(Debug, Clone, Copy)]
pub struct LateReading {
    /// The output.
    pub output: Symbol,
    /// The delay in s: an expression of parameters.
    pub delay: Id,
}

/// A plant with effects.
#[derive(Debug, Clone)]
pub struct Extended {
    /// The equations.
    pub flat: Flat,
    /// Delayed signals.
    pub delays: Vec<Delay>,
    /// Outputs with delayed readings.
    pub late_readings: Vec<LateReading>,
    /// Outputs whose first reading is that of another variable, because the true value cannot be computed from the reading.
    pub read_of: Vec<(Symbol, Symbol)>,
    /// For each placed effect: its place, and its numbers with their parameters in the equations.
    pub placed: Vec<(String, Vec<(String, Symbol)>)>,
}
/// The data for the changes of an effect.
#[derive(Clone, Copy)]
struct Context<'c> {
    placed: &'c Placed<'c>,
    site: &'c Bound,
    /// The offset of positions in the effect's file.
    base: usize,
    names: &'c HashMap<String, Value>,
    /// For each role, which elements have a separate name for the value before the change.
    apart: &'c HashMap<String, Vec<bool>>,
}

struct Rewriter {
    flat: Flat,
    /// The first equation, and the first initial equation, that belong to the effect being placed. They refer to roles before the change.
    own: (usize, usize),
    sites: Vec<Bound>,
    delays: Vec<Delay>,
    late_readings: Vec<LateReading>,
    read_of: Vec<(Symbol, Symbol)>,
    placed: Vec<(String, Vec<(String, Symbol)>)>,
}

/// Adds effects to the equations of a plant.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_model::{effects::{Catalogue, Placed, extend}, flat::{Flat, Options}, system::System};
///
/// let text = "model Cart\n  parameter Real mass = 2;\n  input Real force;\n  output Real speed;\nequation\n  mass*der(speed) = force;\nend Cart;\n";
/// let flat = Flat::read(&Source::new("cart.mo", text), &Options::default())?;
/// let catalogue = Catalogue::shipped();
/// let plant = Source::new("cart.toml", "");
/// let effect = catalogue.find("input-gain").expect("a shipped effect");
/// let placed = Placed { effect, at: Some("force".to_string()), numbers: vec![("gain".to_string(), 3.0)], source: plant, place: 0..0 };
/// let extended = extend(&flat, &[], &[placed])?;
/// let system = System::new(&extended.flat)?;
/// assert_eq!(system.text(system.rates()[0]), "input-gain(force).gain*force/mass");
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
///
/// # Errors
/// If the equations contradict a site, if an effect is not possible at its place, or if a number is missing, unknown or out of its bounds.
pub fn extend(flat: &Flat, sites: &[Site], placed: &[Placed<'_>]) -> Result<Extended, Faults> {
    let mut rewriter = Rewriter::new(flat, placed.len());
    rewriter.bind_all(sites)?;
    let mut faults = Collector::new();
    let mut order: Vec<usize> = (0..placed.len()).collect();
    order.sort_by_key(|k| level(placed[*k].effect));
    for k in order {
        if let Err(found) = rewriter.place(k, &placed[k]) {
            found.list().iter().for_each(|it| faults.push(it.clone()));
        }
    }
    let Rewriter { flat, delays, late_readings, read_of, placed, .. } = rewriter;
    faults.finish(Some(Extended { flat, delays, late_readings, read_of, placed }))
}

/// The sites of a plant, bound to its equations, to find the possible effects.
pub(super) struct Standing {
    rewriter: Rewriter,
}

/// The data of one place.
pub(super) struct Offer {
    bound: Bound,
}

impl Offer {
    /// Whether the place has all roles of an effect.
    pub(super) fn stands(&self, effect: &Effect) -> bool {
        self.bound.missing(effect).is_none()
    }
}

impl Standing {
    pub(super) fn new(flat: &Flat, sites: &[Site]) -> Result<Standing, Faults> {
        let mut rewriter = Rewriter::new(flat, 0);
        rewriter.bind_all(sites)?;
        Ok(Standing { rewriter })
    }

    /// The names and kinds of declared sites, then of parameters, inputs and outputs, in the order of the text.
    pub(super) fn names(&self) -> Vec<(String, SiteKind)> {
        let mut list: Vec<(String, SiteKind)> = self.rewriter.sites.iter().map(|it| (it.name.clone(), it.kind)).collect();
        let flat = &self.rewriter.flat;
        for symbol in flat.symbols() {
            let variable = flat.variable(symbol);
            let kind = match variable.role {
                Role::Input => SiteKind::Input,
                Role::Parameter if !variable.name.contains('(') => SiteKind::Parameter,
                _ if variable.is_output => SiteKind::Output,
                _ => continue,
            };
            list.push((variable.name.clone(), kind));
        }
        list
    }

    fn bound(&mut self, at: &str, kind: SiteKind) -> Option<Bound> {
        if let Some(site) = self.rewriter.sites.iter().find(|it| it.name == at && it.kind == kind) {
            return Some(site.clone());
        }
        let value = self.rewriter.flat.value_of(at)?;
        Some(Bound { name: at.to_string(), kind, usual_for: Vec::new(), roles: vec![("signal".to_string(), value)] })
    }

    /// The units of an effect's numbers at a place; `None` if the place lacks a role that the effect needs.
    pub(super) fn units(&mut self, effect: &Effect, at: &str, kind: SiteKind) -> Option<Vec<String>> {
        let site = self.bound(at, kind).filter(|it| it.missing(effect).is_none())?;
        Some(effect.numbers_on(kind).map(|number| self.rewriter.unit(number.unit(kind), &site)).collect())
    }

    /// The roles of a declared site: the name, the parts, the unit.
    pub(super) fn roles(&self, at: &str) -> Vec<(String, Vec<Id>, String)> {
        let Some(site) = self.rewriter.sites.iter().find(|it| it.name == at) else { return Vec::new() };
        let flat = &self.rewriter.flat;
        let unit = |id: Id| terms::symbol_of(flat, id).and_then(|it| flat.variable(it).unit.clone()).unwrap_or_default();
        let one = |(role, value): &(String, Value)| {
            let unit = value.items.first().map_or(String::new(), |id| unit(*id));
            (role.clone(), value.items.clone(), unit)
        };
        site.roles.iter().map(one).collect()
    }

    /// The terms of the balance of a declared site, if it has one.
    pub(super) fn balance(&mut self, at: &str) -> Option<Vec<Id>> {
        let site = self.rewriter.sites.iter().find(|it| it.name == at)?.clone();
        let (state, inertia, _) = site.kind.balance()?;
        let symbol = site.symbol(&self.rewriter.flat, state)?;
        let inertia = match inertia {
            Some(role) => Some(site.item(role)?),
            None => None,
        };
        let balance = terms::balance(&mut self.rewriter.flat, symbol, inertia).ok()?;
        Some(terms::summands(&mut self.rewriter.flat, &balance))
    }

    /// The equations, with the expressions of all sites in their pool.
    pub(super) fn into_flat(self) -> Flat {
        self.rewriter.flat
    }

    /// Declared sites, inputs and outputs.
    pub(super) fn places(self) -> Vec<(String, SiteKind, Offer)> {
        let mut list: Vec<(String, SiteKind, Offer)> =
            self.rewriter.sites.iter().map(|it| (it.name.clone(), it.kind, Offer { bound: it.clone() })).collect();
        let flat = &self.rewriter.flat;
        for symbol in flat.symbols() {
            let variable = flat.variable(symbol);
            let kind = match variable.role {
                Role::Input => SiteKind::Input,
                _ if variable.is_output => SiteKind::Output,
                _ => continue,
            };
            list.push((variable.name.clone(), kind, Offer { bound: Bound::signal(&variable.name, kind) }));
        }
        list
    }
}

/// The order of application: from the record to the inner laws, then to the readings.
fn level(effect: &Effect) -> usize {
    let has = |wanted: &dyn Fn(&Change) -> bool| effect.changes.iter().any(wanted);
    let stands = |kind: SiteKind| effect.sites.contains(&kind);
    if stands(SiteKind::Parameter) {
        0
    } else if has(&|it| matches!(it, Change::Delay(_))) && stands(SiteKind::Input) {
        1
    } else if stands(SiteKind::Input) {
        2
    } else if stands(SiteKind::Machine) {
        3
    } else if stands(SiteKind::Output) {
        6
    } else if has(&|it| matches!(it, Change::Replace(role, _) if role == "load")) {
        // A second body that an effect splits off takes the whole load.
        5
    } else if effect.is_outermost {
        5
    } else {
        4
    }
}

impl Rewriter {
    fn new(flat: &Flat, placed: usize) -> Rewriter {
        Rewriter {
            flat: flat.clone(),
            own: (0, 0),
            sites: Vec::new(),
            delays: Vec::new(),
            late_readings: Vec::new(),
            read_of: Vec::new(),
            placed: vec![(String::new(), Vec::new()); placed],
        }
    }

    fn place(&mut self, number: usize, placed: &Placed<'_>) -> Result<(), Faults> {
        let site = self.site(placed)?;
        let effect = placed.effect;
        if let Some(role) = site.missing(effect) {
            let what = format!("effect `{}`: the site `{}` does not name its `{role}`", effect.kind, site.name);
            return Err(Faults::one(placed.source.fault(placed.place.clone(), what)));
        }
        let label = format!("{}({})", effect.kind, site.name);
        let base = self.flat.add_fragment(&effect.source);
        self.own = (self.flat.equations.len(), self.flat.initial_equations.len());
        let mut names: HashMap<String, Value> = site.roles.iter().cloned().collect();
        if let Some(time) = self.flat.value_of("time") {
            names.insert("time".to_string(), time);
        }
        let numbers = self.numbers(placed, &site, &label, &mut names)?;
        self.placed[number] = (site.name.clone(), numbers);
        let has = |role: &str| site.role(role).is_some();
        // Roles that an equation defines: the value before the change gets a separate name.
        let mut apart: HashMap<String, Vec<bool>> = HashMap::new();
        for change in effect.changes_on(&has) {
            if let Change::Replace(role, _) = change
                && !site.is_balanced(role)
                && role != "load"
                && site.kind != SiteKind::Output
            {
                let which = self.set_apart(&site, role, &mut names);
                apart.insert(role.clone(), which);
            }
        }
        for state in effect.states_on(site.kind) {
            let symbol = self.flat.declare(&format!("{label}.{}", state.name), Role::Unknown, base..base);
            self.flat.variables[symbol.0 as usize].unit = state.unit.as_ref().map(|unit| self.unit(unit, &site));
            names.insert(state.name.clone(), Value::scalar(self.flat.pool.symbol(symbol), crate::flat::Basic::Real));
        }
        let used = effect.names(site.kind, &has);
        for helper in effect.helpers.iter().filter(|it| used.contains(&it.name)) {
            let Some(expression) = helper.on(site.kind) else { continue };
            let mut value = self.flat.expression(&effect.source, expression, Some(&names))?;
            if let (Some(unit), Some(item)) = (&helper.unit, value.item()) {
                let symbol = self.flat.declare(&format!("{label}.{}", helper.name), Role::Constant, 0..0);
                let unit = self.unit(unit, &site);
                let constant = &mut self.flat.variables[symbol.0 as usize];
                (constant.value, constant.unit) = (Some(item), Some(unit).filter(|it| !it.is_empty()));
                value = Value::scalar(self.flat.pool.symbol(symbol), crate::flat::Basic::Real);
            }
            names.insert(helper.name.clone(), value);
        }
        for state in effect.states_on(site.kind) {
            self.state(effect, state, base, &names)?;
        }
        let context = Context { placed, site: &site, base, names: &names, apart: &apart };
        for change in effect.changes_on(&has) {
            self.change(&context, change)?;
        }
        Ok(())
    }

    /// Declares a parameter for each number of an effect.
    fn numbers(
        &mut self,
        placed: &Placed<'_>,
        site: &Bound,
        label: &str,
        names: &mut HashMap<String, Value>,
    ) -> Result<Vec<(String, Symbol)>, Faults> {
        let effect = placed.effect;
        let mut faults = Collector::new();
        let told = |what: String| placed.source.fault(placed.place.clone(), format!("effect `{}`: {what}", effect.kind));
        for (name, _) in &placed.numbers {
            if !effect.numbers_on(site.kind).any(|it| it.name == *name) {
                let known: Vec<String> = effect.numbers_on(site.kind).map(|it| format!("`{}`", it.name)).collect();
                let what = format!("it has no number `{name}` on a site of kind `{}`", site.kind.name());
                faults.push(told(what).help(format!("its numbers there are {}", known.join(", "))));
            }
        }
        let mut list = Vec::new();
        for number in effect.numbers_on(site.kind) {
            let given = placed.numbers.iter().find(|it| it.0 == number.name).map(|it| it.1);
            let value = match (given, &number.default) {
                (Some(value), _) => {
                    if let Some(what) = number.refuses(value) {
                        faults.push(told(format!("`{}`: {what}", number.name)));
                    }
                    let symbol = self.flat.declare(&format!("{label}.{}", number.name), Role::Parameter, 0..0);
                    let unit = self.unit(number.unit(site.kind), site);
                    let id = self.flat.pool.number(value);
                    let variable = &mut self.flat.variables[symbol.0 as usize];
                    (variable.value, variable.unit) = (Some(id), Some(unit).filter(|it| !it.is_empty()));
                    list.push((number.name.clone(), symbol));
                    Value::scalar(self.flat.pool.symbol(symbol), crate::flat::Basic::Real)
                }
                (None, Some(default)) => self.flat.expression(&effect.source, default, Some(names))?,
                (None, None) => {
                    faults.push(told(format!("`{}` is missing", number.name)));
                    continue;
                }
            };
            names.insert(number.name.clone(), value);
        }
        faults.finish(Some(list))
    }

    /// A unit with the units of roles inserted.
    fn unit(&self, unit: &str, site: &Bound) -> String {
        let mut text = unit.to_string();
        for (role, value) in &site.roles {
            let mark = format!("{{{role}}}");
            if text.contains(&mark) {
                let symbol = value.items.first().and_then(|id| terms::symbol_of(&self.flat, *id));
                let own = symbol.and_then(|it| self.flat.variable(it).unit.clone());
                let Some(own) = own else { return String::new() };
                text = text.replace(&mark, &format!("({own})"));
            }
        }
        match text.strip_prefix('(').and_then(|it| it.strip_suffix(')')) {
            Some(inner) if !inner.contains('(') => inner.to_string(),
            _ => text,
        }
    }

    fn state(&mut self, effect: &Effect, state: &State, base: usize, names: &HashMap<String, Value>) -> Result<(), Faults> {
        let rate = self.scalar(effect, &state.rate, names)?;
        let start = self.scalar(effect, &state.start, names)?;
        let Some(own) = names.get(&state.name).and_then(Value::item) else { return Ok(()) };
        let Some(symbol) = terms::symbol_of(&self.flat, own) else { return Ok(()) };
        let derivative = self.flat.derived(Role::Derivative(symbol));
        let left = self.flat.pool.symbol(derivative);
        self.equation(left, rate, base, &state.rate);
        let place = base + state.start.span.start..base + state.start.span.end;
        self.flat.initial_equations.push(Equation { left: own, right: start, place, pairs: Vec::new() });
        Ok(())
    }

    fn equation(&mut self, left: Id, right: Id, base: usize, law: &Expression) {
        let place = base + law.span.start..base + law.span.end;
        self.flat.equations.push(Equation { left, right, place, pairs: Vec::new() });
    }

    fn scalar(&mut self, effect: &Effect, law: &Expression, names: &HashMap<String, Value>) -> Result<Id, Faults> {
        let value = self.flat.expression(&effect.source, law, Some(names))?;
        value.item().ok_or_else(|| {
            let what = format!("found {}, expected a scalar", value.shape());
            Faults::one(effect.source.fault(law.span.clone(), what))
        })
    }

    fn change(&mut self, context: &Context<'_>, change: &Change) -> Result<(), Faults> {
        let Context { placed, site, base, names, .. } = *context;
        let effect = placed.effect;
        let refuse =
            |what: String| Faults::one(placed.source.fault(placed.place.clone(), format!("effect `{}`: {what}", effect.kind)));
        match change {
            Change::Balance(law) => {
                let added = self.scalar(effect, law, names)?;
                self.add(site, added).map_err(refuse)
            }
            Change::Load(law) => {
                let more = self.scalar(effect, law, names)?;
                let less = self.flat.pool.negate(more);
                self.add(site, less).map_err(refuse)?;
                let old = self.current(site, "load").unwrap_or(more);
                let new = self.flat.pool.add(old, more);
                self.set_role(site, "load", new);
                Ok(())
            }
            Change::Replace(role, law) => {
                let value = self.flat.expression(&effect.source, law, Some(names))?;
                self.replace(context, role, &value, law).map_err(refuse)
            }
            Change::Inside(role, laws) => {
                let mut replaced = HashMap::new();
                for (inner, law) in laws {
                    let new = self.scalar(effect, law, names)?;
                    let symbol = site.symbol(&self.flat, inner).ok_or_else(|| refuse(site.no_variable(inner)))?;
                    replaced.insert(symbol, new);
                }
                let equation = self.definition(site, role).map_err(refuse)?;
                let mut replacement = Replacement::new(replaced);
                let it = &mut self.flat.equations[equation];
                it.left = replacement.of(&mut self.flat.pool, it.left);
                it.right = replacement.of(&mut self.flat.pool, it.right);
                Ok(())
            }
            Change::Define(role, law) => {
                let new = self.scalar(effect, law, names)?;
                let equation = self.definition(site, role).map_err(refuse)?;
                let symbol = site.symbol(&self.flat, role).ok_or_else(|| refuse(site.no_variable(role)))?;
                let left = self.flat.pool.symbol(symbol);
                let place = base + law.span.start..base + law.span.end;
                self.flat.equations[equation] = Equation { left, right: new, place, pairs: Vec::new() };
                Ok(())
            }
            Change::Reading(role, law) => {
                let value = self.flat.expression(&effect.source, law, Some(names))?;
                self.reading(context, role, &value, law).map_err(refuse)
            }
            Change::Start(role, law) => {
                let new = self.scalar(effect, law, names)?;
                let symbol = site.symbol(&self.flat, role).ok_or_else(|| refuse(site.no_variable(role)))?;
                let mut replacement = Replacement::new(HashMap::from([(symbol, new)]));
                for it in &mut self.flat.initial_equations {
                    it.left = replacement.of(&mut self.flat.pool, it.left);
                    it.right = replacement.of(&mut self.flat.pool, it.right);
                }
                Ok(())
            }
            Change::Delay(law) => {
                let delay = self.scalar(effect, law, names)?;
                self.delay(site, delay).map_err(refuse)
            }
        }
    }

    /// Adds an effort to the balance of a site.
    fn add(&mut self, site: &Bound, effort: Id) -> Result<(), String> {
        let Some((state, inertia, _)) = site.kind.balance() else {
            return Err(format!("a site of kind `{}` has no balance", site.kind.name()));
        };
        let symbol = site.symbol(&self.flat, state).ok_or_else(|| site.no_variable(state))?;
        let inertia = match inertia {
            Some(role) => Some(site.item(role).ok_or_else(|| format!("the site `{}` does not name its `{role}`", site.name))?),
            None => None,
        };
        let balance = terms::balance(&mut self.flat, symbol, inertia)?;
        let pool = &mut self.flat.pool;
        let term = balance.share.map_or(effort, |share| pool.multiply(share, effort));
        let equation = &mut self.flat.equations[balance.equation];
        equation.right = pool.add(equation.right, term);
        if let Some((_, right)) = equation.pairs.first_mut() {
            *right = equation.right;
        }
        Ok(())
    }

    fn current(&self, site: &Bound, role: &str) -> Option<Id> {
        self.sites.iter().find(|it| it.name == site.name).unwrap_or(site).item(role)
    }

    fn set_role(&mut self, site: &Bound, role: &str, value: Id) {
        for it in self.sites.iter_mut().filter(|it| it.name == site.name) {
            it.roles.retain(|(name, _)| name != role);
            it.roles.push((role.to_string(), Value::scalar(value, crate::flat::Basic::Real)));
        }
    }

    fn definition(&self, site: &Bound, role: &str) -> Result<usize, String> {
        let symbol = site.symbol(&self.flat, role).ok_or_else(|| site.no_variable(role))?;
        terms::definition(&self.flat, symbol).ok_or_else(|| {
            format!(
                "no single equation gives `{}`, the `{role}` of `{}`: expected one of the form `{0} = ...`",
                self.flat.variable(symbol).name,
                site.name
            )
        })
    }

    /// Gives the value of a role before the change a separate name, if an equation defines the role.
    fn set_apart(&mut self, site: &Bound, role: &str, names: &mut HashMap<String, Value>) -> Vec<bool> {
        let Some(value) = site.role(role).cloned() else { return Vec::new() };
        let mut items = value.items.clone();
        let mut which = vec![false; items.len()];
        for (item, is_apart) in items.iter_mut().zip(&mut which) {
            let Some(symbol) = terms::symbol_of(&self.flat, *item) else { continue };
            if self.flat.variable(symbol).role != Role::Unknown {
                continue;
            }
            let Some(equation) = terms::definition(&self.flat, symbol) else { continue };
            let before = self.sibling(symbol, "before");
            let before = self.flat.pool.symbol(before);
            let it = &mut self.flat.equations[equation];
            let own = |id: Id| if id == *item { before } else { id };
            (it.left, it.right) = (own(it.left), own(it.right));
            (*item, *is_apart) = (before, true);
        }
        // A number of the effect may have the same name as the role.
        if which.contains(&true) || !names.contains_key(role) {
            names.insert(role.to_string(), Value { items, ..value });
        }
        which
    }
}
