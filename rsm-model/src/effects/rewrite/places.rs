//! The site of a placed effect.
//!
//! In: sites of a plant file, placed effects. Out: [`Bound`] sites, or their faults in words. Changes no equation.

use rsm_core::source::{Collector, Faults};

use crate::expression::{Id, Symbol};
use crate::flat::{Equation, Flat, Role, Value};

use super::{Placed, Rewriter};
use crate::effects::file::Effect;
use crate::effects::site::{Otherwise, Site, SiteKind};
use crate::effects::terms;

/// A site with its roles as expressions in the pool.
#[derive(Debug, Clone)]
pub(super) struct Bound {
    pub name: String,
    pub kind: SiteKind,
    pub usual_for: Vec<String>,
    pub roles: Vec<(String, Value)>,
}

impl Bound {
    /// An input or an output as a site, to find the effects that are possible on its kind.
    pub(super) fn signal(name: &str, kind: SiteKind) -> Bound {
        let nothing = Value { sizes: Vec::new(), items: Vec::new(), basic: crate::flat::Basic::Real };
        Bound { name: name.to_string(), kind, usual_for: Vec::new(), roles: vec![("signal".to_string(), nothing)] }
    }

    pub(super) fn role(&self, role: &str) -> Option<&Value> {
        self.roles.iter().find(|it| it.0 == role).map(|it| &it.1)
    }

    pub(super) fn item(&self, role: &str) -> Option<Id> {
        self.role(role).and_then(Value::item)
    }

    pub(super) fn symbol(&self, flat: &Flat, role: &str) -> Option<Symbol> {
        self.item(role).and_then(|it| terms::symbol_of(flat, it))
    }

    pub(super) fn no_variable(&self, role: &str) -> String {
        format!("the `{role}` of `{}` is an expression, expected a single variable: the effect changes its equation", self.name)
    }

    /// Whether a role is the factor of the derivative in the balance of the site.
    pub(super) fn is_balanced(&self, role: &str) -> bool {
        self.kind.balance().is_some_and(|it| it.1 == Some(role))
    }

    /// A role that an effect needs and the site lacks.
    pub(super) fn missing(&self, effect: &Effect) -> Option<&'static str> {
        let has = |role: &str| self.role(role).is_some();
        let used = effect.names(self.kind, &has);
        let own = |name: &str| effect.numbers_on(self.kind).any(|it| it.name == name);
        let mut absent = self.kind.roles().iter().map(|it| it.0).filter(|role| !has(role));
        let changes_nothing = effect.changes_on(&has).next().is_none();
        absent.find(|role| changes_nothing || used.iter().any(|it| it == role && !own(it)))
    }
}

impl Rewriter {
    /// Binds all sites, and reports every fault.
    pub(super) fn bind_all(&mut self, sites: &[Site]) -> Result<(), Faults> {
        let mut faults = Collector::new();
        for site in sites {
            match self.bind(site) {
                Ok(bound) => self.sites.push(bound),
                Err(found) => found.list().iter().for_each(|it| faults.push(it.clone())),
            }
        }
        faults.finish(Some(()))
    }

    pub(super) fn bind(&mut self, site: &Site) -> Result<Bound, Faults> {
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

    /// Checks a site against the equations: a balance with its inertia; a speed that is the derivative of its position.
    pub(super) fn check(&mut self, site: &Site, bound: &Bound) -> Result<(), Faults> {
        let refuse =
            |what: String| Err(Faults::one(site.source.fault(site.place.clone(), format!("[sites.{}]: {what}", site.name))));
        let Some((state, inertia, _)) = bound.kind.balance() else { return Ok(()) };
        let Some(symbol) = bound.symbol(&self.flat, state) else {
            return refuse(format!("`{state}` must be a variable of the text, not an expression"));
        };
        // A vehicle may omit the inertia at its wheel. Effects on the balance are then not possible.
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

    /// The site of a placed effect.
    pub(super) fn site(&mut self, placed: &Placed<'_>) -> Result<Bound, Faults> {
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
                    // The replacement of a signal is also used by the next effect.
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
                format!("its place is missing: it needs a {kinds}"),
                "declare one under [sites], and write at = \"NAME\"".into(),
            ),
            _ => {
                let names: Vec<String> = fit.iter().map(|it| format!("`{}`", it.name)).collect();
                refuse("its place is missing".to_string(), format!("write at = one of {}", names.join(", ")))
            }
        }
    }

    /// Names of inputs, outputs, parameters or states on which an effect is possible.
    pub(super) fn signals(&self, effect: &Effect) -> Vec<String> {
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

    /// An input, output, parameter or state as a site.
    pub(super) fn implied(&mut self, effect: &Effect, name: &str) -> Option<Bound> {
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
}
