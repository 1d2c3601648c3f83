//! Proposes sites of a plant, and lists the effects that can act at each place.
//!
//! In: equations with units. Out: proposed sites as text for a plant file, and lists of effects. The user must declare the sites, because units and
//! equations show only what a part may be.

use std::fmt::Write as _;

use rsm_core::source::Faults;

use crate::expression::{Derivative, Symbol};
use crate::flat::{Flat, Role};

use super::rewrite::Standing;
use super::shipped::Catalogue;
use super::site::{Site, SiteKind};
use super::terms;

/// A site that equations and units suggest.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// A name for it.
    pub name: String,
    /// What it may be.
    pub kind: SiteKind,
    /// Its roles, as texts.
    pub roles: Vec<(&'static str, String)>,
}

impl Proposal {
    /// The table for a plant file.
    #[must_use]
    pub fn toml(&self) -> String {
        let plain = |it: char| it.is_ascii_alphanumeric() || it == '_' || it == '-';
        let name = if self.name.chars().all(plain) { self.name.clone() } else { format!("\"{}\"", self.name) };
        let mut text = format!("[sites.{name}]\nkind = \"{}\"\n", self.kind.name());
        for (role, value) in &self.roles {
            let _ = writeln!(text, "{role} = \"{value}\"");
        }
        text
    }
}

/// A place where effects can act (a site, input, output, parameter or state), with the effects for which it has all roles.
#[derive(Debug, Clone, PartialEq)]
pub struct Room {
    /// The name for `at`.
    pub at: String,
    /// Its kind.
    pub kind: SiteKind,
    /// The effects, by kind.
    pub effects: Vec<String>,
}

/// The effects of a catalogue that are possible on a plant, by place. Parameters and states are left out, because the same effects are possible on
/// each of them.
///
/// # Errors
/// If the equations contradict the sites.
pub fn rooms(flat: &Flat, sites: &[Site], catalogue: &Catalogue) -> Result<Vec<Room>, Faults> {
    let standing = Standing::new(flat, sites)?;
    let mut rooms = Vec::new();
    for (at, kind, has) in standing.places() {
        let stands = catalogue.effects().iter().filter(|it| it.sites.contains(&kind));
        let effects = stands.filter(|it| has.stands(it)).map(|it| it.kind.clone()).collect();
        rooms.push(Room { at, kind, effects });
    }
    Ok(rooms)
}

/// Sites that units and the form of equations suggest, without those already declared.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_model::{effects::propose, flat::{Flat, Options}};
///
/// let text = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  Real x(unit = \"m\");\n  \
///             output Real v(unit = \"m/s\");\nequation\n  mass*der(v) = force;\n  der(x) = v;\nend Cart;\n";
/// let flat = Flat::read(&Source::new("cart.mo", text), &Options::default())?;
/// let found = propose(&flat, &[]);
/// assert_eq!(found[0].toml(), "[sites.v]\nkind = \"translation\"\nposition = \"x\"\nspeed = \"v\"\ninertia = \"mass\"\n");
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn propose(flat: &Flat, sites: &[Site]) -> Vec<Proposal> {
    let mut flat = flat.clone();
    let derivatives: Vec<(Symbol, Symbol)> = flat
        .symbols()
        .filter_map(|it| match flat.variable(it).role {
            Role::Derivative(of) => Some((it, of)),
            _ => None,
        })
        .collect();
    let mut list = Vec::new();
    for (derivative, state) in &derivatives {
        let proposal = body(&mut flat, &derivatives, *derivative, *state);
        list.extend(proposal.filter(|it| !is_declared(&it.roles, sites)));
    }
    for equation in 0..flat.equations.len() {
        let proposal = joint(&flat, &derivatives, equation);
        list.extend(proposal.filter(|it| !is_declared(&it.roles, sites)));
    }
    list
}

/// Whether a declared site has the first two roles of a proposal.
fn is_declared(roles: &[(&'static str, String)], sites: &[Site]) -> bool {
    sites.iter().any(|site| {
        let text = |name: &str| {
            let role = site.roles.iter().find(|it| it.0 == name)?;
            let spans: Vec<&str> = role.1.iter().map(|it| &site.source.text()[it.span.clone()]).collect();
            Some(spans.join(", "))
        };
        roles.iter().take(2).all(|(role, value)| text(role).as_deref() == Some(value))
    })
}

fn unit(flat: &Flat, symbol: Symbol) -> &str {
    flat.variable(symbol).unit.as_deref().unwrap_or_default()
}

/// Proposes a body, a store, a heat capacity or a winding from the equation with the derivative of a state.
fn body(flat: &mut Flat, derivatives: &[(Symbol, Symbol)], derivative: Symbol, state: Symbol) -> Option<Proposal> {
    let name = flat.variable(state).name.clone();
    let kind = match unit(flat, state) {
        "rad/s" | "1/s" => SiteKind::Rotation,
        "m/s" => SiteKind::Translation,
        "K" | "degC" => SiteKind::Heat,
        "A" => SiteKind::Winding,
        "m" | "m3" | "Pa" | "kg" => SiteKind::Storage,
        _ => return None,
    };
    // The balance has the derivative times a constant of the plant, and more than one other signal.
    let found = (0..flat.equations.len()).find_map(|k| {
        let (left, right) = (flat.equations[k].left, flat.equations[k].right);
        // An equation that only defines the derivative, as an acceleration, is not a balance.
        let says = |side| {
            terms::symbol_of(flat, side).is_some_and(|it| {
                let variable = flat.variable(it);
                let is_rate = matches!(unit(flat, it), "m/s2" | "rad/s2" | "K/s" | "A/s" | "m/s" | "rad/s");
                it != derivative && variable.role == Role::Unknown && (variable.is_output || is_rate)
            })
        };
        let is_balance = ![left, right].into_iter().any(says);
        let residual = flat.pool.subtract(left, right);
        if !flat.pool.symbols(residual).contains(&derivative) || !is_balance {
            return None;
        }
        let factor = Derivative::by(&mut flat.pool, derivative).of(&mut flat.pool, residual);
        flat.known(factor).map(|_| (k, factor))
    });
    let (equation, factor) = found?;
    let factor = match flat.pool.node(factor) {
        crate::expression::Node::Unary(crate::expression::Unary::Negate, inner) => inner,
        _ => factor,
    };
    let inertia = flat.text(factor);
    let roles = match kind {
        SiteKind::Rotation | SiteKind::Translation => {
            let position = derivatives.iter().find(|(rate, _)| {
                flat.equations.iter().any(|it| {
                    let pair = [terms::symbol_of(flat, it.left), terms::symbol_of(flat, it.right)];
                    pair.contains(&Some(*rate)) && pair.contains(&Some(state))
                })
            });
            let position = position.map(|it| ("position", flat.variable(it.1).name.clone()));
            position.into_iter().chain([("speed", name.clone()), ("inertia", inertia)]).collect()
        }
        SiteKind::Winding => {
            let residual = flat.pool.subtract(flat.equations[equation].left, flat.equations[equation].right);
            let slope = Derivative::by(&mut flat.pool, state).of(&mut flat.pool, residual);
            let resistance = flat.pool.symbols(slope).into_iter().find(|it| unit(flat, *it) == "Ohm")?;
            vec![("currents", name.clone()), ("resistance", flat.variable(resistance).name.clone()), ("inductance", inertia)]
        }
        SiteKind::Heat => vec![("temperature", name.clone()), ("capacity", inertia)],
        _ => vec![("level", name.clone()), ("capacity", inertia)],
    };
    Some(Proposal { name, kind, roles })
}

/// Proposes a spring: one equation gives an effort from a twist and its rate.
fn joint(flat: &Flat, derivatives: &[(Symbol, Symbol)], equation: usize) -> Option<Proposal> {
    let it = &flat.equations[equation];
    let effort = terms::symbol_of(flat, it.left)?;
    let units = match unit(flat, effort) {
        "N.m" => ("rad", "rad/s"),
        "N" => ("m", "m/s"),
        _ => return None,
    };
    let variables: Vec<Symbol> =
        flat.pool.symbols(it.right).into_iter().filter(|it| flat.variable(*it).role == Role::Unknown).collect();
    let of = |wanted: &str| variables.iter().copied().find(|it| unit(flat, *it) == wanted);
    let (twist, rate) = (of(units.0)?, of(units.1)?);
    // A spring depends only on its twist and the rate of the twist. A twist is a difference, not a state.
    let is_state = |symbol: Symbol| derivatives.iter().any(|it| it.1 == symbol);
    if variables.len() != 2 || is_state(twist) || is_state(rate) {
        return None;
    }
    let name = |symbol: Symbol| flat.variable(symbol).name.clone();
    let roles = vec![("twist", name(twist)), ("rate", name(rate)), ("effort", name(effort))];
    Some(Proposal { name: name(effort), kind: SiteKind::Joint, roles })
}
