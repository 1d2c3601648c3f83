//! Rewrites the equations of a plant by effects.
//!
//! In: flat equations, sites, placed effects. Out: flat equations that hold the effects, with a parameter for each of their numbers, and the delays that no equation can say.
//!
//! A signal that comes in is changed first, the inner laws follow, what is read is changed last; within these, effects act in the order of the file. A law that takes the
//! place of a role speaks of the role as it was before: later effects stand outside of earlier ones.

use std::collections::HashMap;
use std::ops::Range;

use rsm_core::source::{Collector, Faults, Source};

use crate::expression::{Id, Replacement, Symbol};
use crate::flat::{Equation, Flat, Role, Value};
use crate::syntax::tree::Expression;

use super::file::{Change, Effect, State};
use super::site::{Otherwise, Site, SiteKind};
use super::terms;

/// An effect where it stands.
#[derive(Debug, Clone)]
pub struct Placed<'e> {
    /// The effect.
    pub effect: &'e Effect,
    /// The site, input, output, parameter or state; `None` where only one fits.
    pub at: Option<String>,
    /// Its numbers.
    pub numbers: Vec<(String, f64)>,
    /// The file that places it.
    pub source: Source,
    /// Where that file does.
    pub place: Range<usize>,
}

/// A signal that acts later: an input of the extended plant that follows another signal.
#[derive(Debug, Clone, Copy)]
pub struct Delay {
    /// The input that the equations hold.
    pub late: Symbol,
    /// The signal that it follows: an input, or a variable that a `when` gives.
    pub of: Symbol,
    /// By how much, in s: an expression of parameters.
    pub delay: Id,
}

/// An output that is read late.
#[derive(Debug, Clone, Copy)]
pub struct LateReading {
    /// The output.
    pub output: Symbol,
    /// By how much, in s: an expression of parameters.
    pub delay: Id,
}

/// A plant with effects.
#[derive(Debug, Clone)]
pub struct Extended {
    /// The equations.
    pub flat: Flat,
    /// Signals that act later.
    pub delays: Vec<Delay>,
    /// Outputs that are read late.
    pub late_readings: Vec<LateReading>,
    /// Outputs whose first reading is that of another variable: what is read of that cannot be turned back.
    pub read_of: Vec<(Symbol, Symbol)>,
    /// Of each placed effect: where it stands, and its numbers with the parameters that hold them.
    pub placed: Vec<(String, Vec<(String, Symbol)>)>,
}

/// A site with its roles in the pool.
#[derive(Debug, Clone)]
struct Bound {
    name: String,
    kind: SiteKind,
    usual_for: Vec<String>,
    roles: Vec<(String, Value)>,
}

/// What a change of an effect needs to know.
#[derive(Clone, Copy)]
struct Context<'c> {
    placed: &'c Placed<'c>,
    site: &'c Bound,
    /// Where places of the effect's file begin.
    base: usize,
    names: &'c HashMap<String, Value>,
    /// Items of roles whose value from before has a name of its own.
    apart: &'c HashMap<String, Vec<bool>>,
}

struct Rewriter {
    flat: Flat,
    /// The equations, and those of the start, from which on they are the own ones of the effect that is placed: they speak of roles as they were before.
    own: (usize, usize),
    sites: Vec<Bound>,
    delays: Vec<Delay>,
    late_readings: Vec<LateReading>,
    read_of: Vec<(Symbol, Symbol)>,
    placed: Vec<(String, Vec<(String, Symbol)>)>,
}

/// Puts effects into the equations of a plant.
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
/// A site that the equations do not bear out; an effect that cannot stand where it is placed; a number that is missing, unknown or out of its bounds.
pub fn extend(flat: &Flat, sites: &[Site], placed: &[Placed<'_>]) -> Result<Extended, Faults> {
    let mut rewriter = Rewriter {
        flat: flat.clone(),
        own: (0, 0),
        sites: Vec::new(),
        delays: Vec::new(),
        late_readings: Vec::new(),
        read_of: Vec::new(),
        placed: vec![(String::new(), Vec::new()); placed.len()],
    };
    let mut faults = Collector::new();
    for site in sites {
        match rewriter.bind(site) {
            Ok(bound) => rewriter.sites.push(bound),
            Err(found) => found.list().iter().for_each(|it| faults.push(it.clone())),
        }
    }
    faults.finish(Some(()))?;
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

/// From the record inwards, and out again.
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
        // A body that is split off takes the whole load with it.
        5
    } else if effect.is_outermost {
        5
    } else {
        4
    }
}

impl Rewriter {
    fn bind(&mut self, site: &Site) -> Result<Bound, Faults> {
        let mut faults = Collector::new();
        let mut roles = Vec::new();
        for (role, list, is_vector) in &site.roles {
            let mut items = Vec::new();
            let mut whole = None;
            for expression in list {
                match self.flat.expression(&site.source, expression, None) {
                    Ok(value) if value.item().is_some() || !*is_vector => {
                        items.extend(&value.items);
                        whole = Some(value);
                    }
                    Ok(value) => {
                        let what = format!("`{role}`: found {}, expected a scalar in the list", value.shape());
                        faults.push(site.source.fault(expression.span.clone(), what));
                    }
                    Err(found) => found.list().iter().for_each(|it| faults.push(it.clone())),
                }
            }
            let Some(first) = whole else { continue };
            let value = if *is_vector { Value { sizes: vec![items.len()], items, basic: first.basic } } else { first };
            roles.push((role.clone(), value));
        }
        for (role, otherwise) in site.kind.roles() {
            if let Otherwise::Number(number) = otherwise
                && !roles.iter().any(|it| it.0 == *role)
            {
                roles.push(((*role).to_string(), Value::scalar(self.flat.pool.number(*number), crate::flat::Basic::Real)));
            }
        }
        faults.finish(Some(()))?;
        let bound = Bound { name: site.name.clone(), kind: site.kind, usual_for: site.usual_for.clone(), roles };
        self.check(site, &bound)?;
        Ok(bound)
    }

    /// Whether the equations bear a site out: a balance with its inertia; a speed that is the derivative of its position.
    fn check(&mut self, site: &Site, bound: &Bound) -> Result<(), Faults> {
        let refuse =
            |what: String| Err(Faults::one(site.source.fault(site.place.clone(), format!("[sites.{}]: {what}", site.name))));
        let Some((state, inertia, _)) = bound.kind.balance() else { return Ok(()) };
        let Some(symbol) = bound.symbol(&self.flat, state) else {
            return refuse(format!("`{state}` must be a variable of the text, not an expression"));
        };
        // A vehicle may leave the inertia at its wheel out: no effect of the balance can then stand there.
        if inertia.is_some_and(|role| bound.role(role).is_none()) {
            return Ok(());
        }
        let inertia = inertia.and_then(|role| bound.item(role));
        if let Err(what) = terms::balance(&mut self.flat, symbol, inertia) {
            return refuse(what);
        }
        let position =
            bound.role("position").filter(|it| it.items.len() == 1).and_then(|_| bound.symbol(&self.flat, "position"));
        let Some(position) = position else { return Ok(()) };
        let derivative = self.flat.find(&format!("der({})", self.flat.variable(position).name));
        let gives = |it: &Equation| {
            let side = |id: Id| terms::symbol_of(&self.flat, id);
            let pair = [side(it.left), side(it.right)];
            pair.contains(&Some(symbol)) && derivative.is_some() && pair.contains(&derivative)
        };
        let follows = terms::law(&self.flat, position).is_some();
        if !follows && !self.flat.equations.iter().any(gives) {
            let (speed, position) = (self.flat.variable(symbol).name.clone(), self.flat.variable(position).name.clone());
            return refuse(format!(
                "`{speed}` is not the derivative of `{position}`: the text has no equation der({position}) = {speed}"
            ));
        }
        Ok(())
    }

    /// The site at which an effect stands.
    fn site(&mut self, placed: &Placed<'_>) -> Result<Bound, Faults> {
        let effect = placed.effect;
        let refuse = |what: String, help: String| {
            let fault = placed.source.fault(placed.place.clone(), format!("effect `{}`: {what}", effect.kind));
            Err(Faults::one(if help.is_empty() { fault } else { fault.help(help) }))
        };
        let kinds: Vec<&str> = effect.sites.iter().map(|it| it.name()).collect();
        let kinds = kinds.join(" or ");
        if let Some(at) = &placed.at {
            let declared = self.sites.iter().find(|it| it.name == *at).cloned();
            if let Some(site) = declared {
                return if effect.sites.contains(&site.kind) {
                    Ok(site)
                } else {
                    let what = format!("`{at}` is a site of kind `{}`, expected {kinds}", site.kind.name());
                    refuse(what, String::new())
                };
            }
            return match self.implied(effect, at) {
                Some(site) => {
                    // What takes the place of a signal takes it for the next effect too.
                    if matches!(site.kind, SiteKind::Input | SiteKind::State) {
                        self.sites.push(site.clone());
                    }
                    Ok(site)
                }
                None => {
                    let mut names: Vec<String> = self
                        .sites
                        .iter()
                        .filter(|it| effect.sites.contains(&it.kind))
                        .map(|it| format!("`{}`", it.name))
                        .collect();
                    names.extend(self.signals(effect).into_iter().map(|it| format!("`{it}`")));
                    let help = if names.is_empty() {
                        format!("declare a site of kind {kinds} under [sites]")
                    } else {
                        format!("it can stand at {}", names.join(", "))
                    };
                    refuse(format!("the plant has no {kinds} `{at}`"), help)
                }
            };
        }
        let mut fit: Vec<Bound> =
            self.sites.iter().filter(|it| effect.sites.contains(&it.kind) && it.missing(effect).is_none()).cloned().collect();
        if fit.is_empty() {
            let signals = self.signals(effect);
            fit.extend(signals.iter().filter_map(|name| self.implied(effect, name)));
        }
        if fit.len() > 1
            && let Some(usual) = fit.iter().find(|it| it.usual_for.contains(&effect.kind))
        {
            return Ok(usual.clone());
        }
        match fit.len() {
            1 => Ok(fit.remove(0)),
            0 => refuse(
                format!("nothing says where it stands: it needs a {kinds}"),
                "declare one under [sites], and write at = \"NAME\"".into(),
            ),
            _ => {
                let names: Vec<String> = fit.iter().map(|it| format!("`{}`", it.name)).collect();
                refuse("nothing says where it stands".to_string(), format!("write at = one of {}", names.join(", ")))
            }
        }
    }

    /// Names at which an effect on inputs, outputs, parameters or states can stand.
    fn signals(&self, effect: &Effect) -> Vec<String> {
        let flat = &self.flat;
        let stands = |kind: SiteKind| effect.sites.contains(&kind);
        let list = flat.symbols().filter(|symbol| {
            let it = flat.variable(*symbol);
            let is_late = self.delays.iter().any(|delay| delay.late == *symbol);
            (stands(SiteKind::Input) && it.role == Role::Input && !is_late)
                || (stands(SiteKind::Output) && it.is_output)
                || (stands(SiteKind::Parameter) && it.role == Role::Parameter && !it.name.contains('('))
                || (stands(SiteKind::State) && flat.find(&format!("der({})", it.name)).is_some())
        });
        list.map(|symbol| flat.variable(symbol).name.clone()).collect()
    }

    /// An input, output, parameter or state as a site of its own.
    fn implied(&mut self, effect: &Effect, name: &str) -> Option<Bound> {
        let kind = *effect
            .sites
            .iter()
            .find(|it| matches!(it, SiteKind::Input | SiteKind::Output | SiteKind::Parameter | SiteKind::State))?;
        let symbol = self.flat.find(name)?;
        let it = self.flat.variable(symbol);
        let fits = |kind: SiteKind| match kind {
            SiteKind::Input => it.role == Role::Input,
            SiteKind::Output => it.is_output,
            SiteKind::Parameter => it.role == Role::Parameter,
            SiteKind::State => it.role == Role::Unknown && self.flat.find(&format!("der({name})")).is_some(),
            _ => false,
        };
        let kind = if fits(kind) { kind } else { *effect.sites.iter().find(|kind| fits(**kind))? };
        let value = self.flat.value_of(name)?;
        Some(Bound { name: name.to_string(), kind, usual_for: Vec::new(), roles: vec![("signal".to_string(), value)] })
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
        // Roles that are given by an equation of their own: what they were before has a name of its own.
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
                let what = format!("`{name}` is no number of it on a site of kind `{}`", site.kind.name());
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

    /// A unit with the units of roles in it.
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

    /// Gives what a role was before a name of its own, where an equation gives the role.
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
        // A number of the effect may have the role's own name.
        if which.contains(&true) || !names.contains_key(role) {
            names.insert(role.to_string(), Value { items, ..value });
        }
        which
    }

    /// A further variable like another one.
    fn sibling(&mut self, of: Symbol, word: &str) -> Symbol {
        let variable = self.flat.variable(of).clone();
        let symbol = self.flat.declare(&format!("{} ({word})", variable.name), Role::Unknown, variable.place.clone());
        let new = &mut self.flat.variables[symbol.0 as usize];
        (new.unit, new.nominal) = (variable.unit, variable.nominal);
        symbol
    }

    fn replace(&mut self, context: &Context<'_>, role: &str, law: &Value, written: &Expression) -> Result<(), String> {
        let Context { site, base, apart, .. } = *context;
        if site.kind == SiteKind::Output {
            return self.reading(context, role, law, written);
        }
        let old = site.role(role).cloned().ok_or_else(|| site.no_variable(role))?;
        if old.items.len() != law.items.len() {
            return Err(format!("the law of `{role}` gives {}, expected {}", law.shape(), old.shape()));
        }
        if site.is_balanced(role) || role == "load" {
            let (old, new) = (old.items[0], law.items[0]);
            let more = self.flat.pool.subtract(new, old);
            let less = self.flat.pool.negate(more);
            let effort = if role == "load" {
                self.set_role(site, role, new);
                less
            } else {
                let state = site.kind.balance().map_or("", |it| it.0);
                let symbol = site.symbol(&self.flat, state).ok_or_else(|| site.no_variable(state))?;
                let derivative = self.flat.derived(Role::Derivative(symbol));
                let derivative = self.flat.pool.symbol(derivative);
                self.flat.pool.multiply(less, derivative)
            };
            return self.add(site, effort);
        }
        let mut replaced = HashMap::new();
        let mut given = Vec::new();
        for (k, (item, law)) in old.items.iter().zip(&law.items).enumerate() {
            let symbol = terms::symbol_of(&self.flat, *item).ok_or_else(|| site.no_variable(role))?;
            if apart.get(role).is_some_and(|it| it[k]) {
                given.push((*item, *law));
                continue;
            }
            let is_number = |it: &Symbol| matches!(self.flat.variable(*it).role, Role::Parameter | Role::Constant);
            if is_number(&symbol) && self.flat.pool.symbols(*law).iter().all(is_number) {
                if self.flat.variable(symbol).is_structural {
                    return Err(format!(
                        "`{}` shapes the equations: set it under [parameters]",
                        self.flat.variable(symbol).name
                    ));
                }
                replaced.insert(symbol, *law);
                continue;
            }
            let new = self.sibling(symbol, "here");
            let new = self.flat.pool.symbol(new);
            replaced.insert(symbol, new);
            given.push((new, *law));
        }
        self.substitute(&replaced, false);
        for (left, right) in given {
            self.equation(left, right, base, written);
        }
        Ok(())
    }

    /// Changes what outputs say: the truth gets a name of its own, and everything but the outputs goes on with it.
    fn reading(&mut self, context: &Context<'_>, role: &str, law: &Value, written: &Expression) -> Result<(), String> {
        let Context { placed, site, base, .. } = *context;
        let items = site.role(role).map(|it| it.items.clone()).ok_or_else(|| site.no_variable(role))?;
        if items.len() != law.items.len() {
            return Err(format!("the law of `{role}` gives {}, expected as many as it has", law.shape()));
        }
        let mut replaced = HashMap::new();
        let mut given = Vec::new();
        for (item, law) in items.iter().zip(&law.items) {
            let symbol = terms::symbol_of(&self.flat, *item).ok_or_else(|| site.no_variable(role))?;
            if self.flat.variable(symbol).is_output {
                let truth = self.sibling(symbol, "true");
                self.hand_over(symbol, truth, &mut replaced);
                if !placed.effect.reads_back {
                    self.read_of.push((symbol, truth));
                }
                given.push((*item, *law));
                continue;
            }
            for k in 0..self.flat.equations.len() {
                let (left, right) = (self.flat.equations[k].left, self.flat.equations[k].right);
                for (own, other, is_left) in [(left, right, true), (right, left, false)] {
                    let reads = terms::symbol_of(&self.flat, other).is_some_and(|it| self.flat.variable(it).is_output);
                    if own == *item && reads {
                        let it = &mut self.flat.equations[k];
                        if is_left { it.left = *law } else { it.right = *law }
                    }
                }
            }
        }
        self.substitute(&replaced, true);
        let mut replacement = Replacement::new(replaced);
        for (left, law) in given {
            let right = replacement.of(&mut self.flat.pool, law);
            self.equation(left, right, base, written);
        }
        Ok(())
    }

    /// What belongs to the truth goes from a reading to it: start, bounds, derivatives, the value before an event.
    fn hand_over(&mut self, reading: Symbol, truth: Symbol, replaced: &mut HashMap<Symbol, Id>) {
        let old = self.flat.variable(reading).clone();
        let new = &mut self.flat.variables[truth.0 as usize];
        (new.start, new.fixed, new.min, new.max, new.nominal) = (old.start, old.fixed, old.min, old.max, old.nominal);
        (new.preference, new.basic, new.is_discrete, new.description) =
            (old.preference, old.basic, old.is_discrete, old.description);
        let it = &mut self.flat.variables[reading.0 as usize];
        (it.start, it.fixed, it.is_discrete, it.preference) = (None, None, false, crate::flat::Preference::Default);
        replaced.insert(reading, self.flat.pool.symbol(truth));
        let (mut from, mut to) = (reading, truth);
        while let Some(derivative) = self.flat.find(&format!("der({})", self.flat.variable(from).name)) {
            let new = self.flat.derived(Role::Derivative(to));
            replaced.insert(derivative, self.flat.pool.symbol(new));
            (from, to) = (derivative, new);
        }
        if let Some(before) = self.flat.find(&format!("pre({})", self.flat.variable(reading).name)) {
            let new = self.flat.derived(Role::Before(truth));
            replaced.insert(before, self.flat.pool.symbol(new));
        }
    }

    fn delay(&mut self, site: &Bound, delay: Id) -> Result<(), String> {
        let items = site.role("signal").map(|it| it.items.clone()).ok_or_else(|| site.no_variable("signal"))?;
        let mut replaced = HashMap::new();
        for item in items {
            let symbol = terms::symbol_of(&self.flat, item).ok_or_else(|| site.no_variable("signal"))?;
            if site.kind == SiteKind::Output {
                self.late_readings.push(LateReading { output: symbol, delay });
                continue;
            }
            let holds = |symbol: Symbol| {
                self.flat.variable(symbol).role == Role::Input
                    || self.flat.clauses.iter().any(|it| it.assigned.iter().any(|(to, _)| *to == symbol))
            };
            let of = if holds(symbol) {
                Some(symbol)
            } else {
                terms::law(&self.flat, symbol).and_then(|it| terms::symbol_of(&self.flat, it)).filter(|it| holds(*it))
            };
            let Some(of) = of else {
                return Err(format!(
                    "`{}` changes at every instant: only an input, or a signal that is held between instants, can be delayed",
                    self.flat.variable(symbol).name
                ));
            };
            let variable = self.flat.variable(of).clone();
            let late = self.flat.declare(&format!("{} (late)", variable.name), Role::Input, variable.place.clone());
            self.flat.variables[late.0 as usize].unit = variable.unit;
            let late_id = self.flat.pool.symbol(late);
            if symbol == of {
                replaced.insert(symbol, late_id);
            } else if let Some(equation) = terms::definition(&self.flat, symbol) {
                self.flat.equations[equation].left = item;
                self.flat.equations[equation].right = late_id;
            }
            self.delays.push(Delay { late, of, delay });
        }
        self.substitute(&replaced, false);
        Ok(())
    }

    /// Puts expressions in the place of symbols: in all equations and sites, and, where the symbol itself moves, also where a `when` gives it its value.
    fn substitute(&mut self, replaced: &HashMap<Symbol, Id>, moves: bool) {
        if replaced.is_empty() {
            return;
        }
        let mut replacement = Replacement::new(replaced.clone());
        let flat = &mut self.flat;
        let pool = &mut flat.pool;
        let (first, first_initial) = if moves { (usize::MAX, usize::MAX) } else { self.own };
        let (equations, initial) = (&mut flat.equations, &mut flat.initial_equations);
        for equation in equations.iter_mut().take(first).chain(initial.iter_mut().take(first_initial)) {
            equation.left = replacement.of(pool, equation.left);
            equation.right = replacement.of(pool, equation.right);
            for (left, right) in &mut equation.pairs {
                (*left, *right) = (replacement.of(pool, *left), replacement.of(pool, *right));
            }
        }
        let target = |symbol: &mut Symbol, pool: &crate::expression::Pool| {
            if let Some(new) = replaced.get(symbol).filter(|_| moves)
                && let crate::expression::Node::Symbol(new) = pool.node(*new)
            {
                *symbol = new;
            }
        };
        for clause in &mut flat.clauses {
            for condition in &mut clause.conditions {
                *condition = replacement.of(pool, *condition);
            }
            for (symbol, value) in clause.assigned.iter_mut().chain(&mut clause.restarted) {
                *value = replacement.of(pool, *value);
                target(symbol, pool);
            }
        }
        for check in &mut flat.checks {
            check.condition = replacement.of(pool, check.condition);
        }
        // A number that follows from a parameter follows from what takes its place, where that is a number too.
        for k in 0..flat.variables.len() {
            let is_number = |it: &Symbol, flat: &Flat| matches!(flat.variable(*it).role, Role::Parameter | Role::Constant);
            let role = flat.variables[k].role;
            if role == Role::Parameter && replaced.contains_key(&Symbol(k as u32)) {
                continue;
            }
            for which in 0..2 {
                let value = if which == 0 { flat.variables[k].value } else { flat.variables[k].start };
                let Some(value) = value else { continue };
                let new = replacement.of(&mut flat.pool, value);
                if flat.pool.symbols(new).iter().all(|it| is_number(it, flat)) {
                    let variable = &mut flat.variables[k];
                    if which == 0 { variable.value = Some(new) } else { variable.start = Some(new) }
                }
            }
        }
        for delay in &mut self.delays {
            if let Some(crate::expression::Node::Symbol(new)) =
                replaced.get(&delay.of).filter(|_| moves).map(|it| self.flat.pool.node(*it))
            {
                delay.of = new;
            }
        }
        for site in self.sites.iter_mut().filter(|it| it.kind != SiteKind::Output) {
            for (_, value) in &mut site.roles {
                for item in &mut value.items {
                    *item = replacement.of(&mut self.flat.pool, *item);
                }
            }
        }
    }
}

impl Bound {
    fn role(&self, role: &str) -> Option<&Value> {
        self.roles.iter().find(|it| it.0 == role).map(|it| &it.1)
    }

    fn item(&self, role: &str) -> Option<Id> {
        self.role(role).and_then(Value::item)
    }

    fn symbol(&self, flat: &Flat, role: &str) -> Option<Symbol> {
        self.item(role).and_then(|it| terms::symbol_of(flat, it))
    }

    fn no_variable(&self, role: &str) -> String {
        format!("the `{role}` of `{}` is not a name of the text alone, and cannot be given another law", self.name)
    }

    /// Whether a role is what multiplies the derivative in the balance of the site.
    fn is_balanced(&self, role: &str) -> bool {
        self.kind.balance().is_some_and(|it| it.1 == Some(role))
    }

    /// A role that an effect needs and the site does not name.
    fn missing(&self, effect: &Effect) -> Option<&'static str> {
        let has = |role: &str| self.role(role).is_some();
        let used = effect.names(self.kind, &has);
        let own = |name: &str| effect.numbers_on(self.kind).any(|it| it.name == name);
        let mut absent = self.kind.roles().iter().map(|it| it.0).filter(|role| !has(role));
        let changes_nothing = effect.changes_on(&has).next().is_none();
        absent.find(|role| changes_nothing || used.iter().any(|it| it == role && !own(it)))
    }
}
