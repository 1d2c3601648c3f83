//! The data that a search needs about each place where effects can act: the possible effects, their units, and the scales of the quantities there.
//!
//! In: equations, sites, a catalogue. Out: [`Places`]. Evaluates no expression.

use rsm_core::source::Faults;

use crate::expression::Id;
use crate::flat::Flat;

use super::file::Effect;
use super::rewrite::Standing;
use super::shipped::Catalogue;
use super::site::{Site, SiteKind};

/// A role of a site. Its values over time give its scale.
#[derive(Debug, Clone)]
pub struct RoleValue {
    /// The name of the role.
    pub role: String,
    /// Its parts, one for each element of a vector: expressions of [`Places::flat`].
    pub parts: Vec<Id>,
    /// Its unit as written in the text; empty if it has none.
    pub unit: String,
}

/// An effect that is possible at a place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Offer {
    /// Its kind.
    pub kind: String,
    /// The unit of each of its parameters there, in their order.
    pub units: Vec<String>,
}

/// A place at which effects can act.
#[derive(Debug, Clone)]
pub struct Place {
    /// The name for `at`.
    pub at: String,
    /// Its kind.
    pub kind: SiteKind,
    /// The effects for which it has all roles.
    pub effects: Vec<Offer>,
    /// The effects that act here if a plant file names no place (`usual_for`).
    pub usual_for: Vec<String>,
    /// Its roles.
    pub roles: Vec<RoleValue>,
    /// The terms of its balance, each in the unit of an effort or a flow at the site. The term with the derivative is included.
    pub terms: Vec<Id>,
}

/// All places of a plant.
#[derive(Debug, Clone)]
pub struct Places {
    /// The equations, with the expressions of the places in their pool.
    pub flat: Flat,
    /// Declared sites, then inputs, outputs and parameters.
    pub list: Vec<Place>,
}

impl Places {
    /// The places of a plant with the possible effects of a catalogue. States that are not sites are left out.
    ///
    /// ```
    /// use rsm_core::source::Source;
    /// use rsm_model::{effects::{Catalogue, Places}, flat::{Flat, Options}};
    ///
    /// let text = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  \
    ///             output Real speed(unit = \"m/s\");\nequation\n  mass*der(speed) = force;\nend Cart;\n";
    /// let flat = Flat::read(&Source::new("cart.mo", text), &Options::default())?;
    /// let places = Places::of(&flat, &[], &Catalogue::shipped())?;
    /// let names: Vec<&str> = places.list.iter().map(|it| it.at.as_str()).collect();
    /// assert_eq!(names, ["mass", "force", "speed"]);
    /// let gain = places.list[2].effects.iter().find(|it| it.kind == "sensor-bias").expect("a shipped effect");
    /// assert_eq!(gain.units, ["m/s"]);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// If the equations contradict the sites.
    pub fn of(flat: &Flat, sites: &[Site], catalogue: &Catalogue) -> Result<Places, Faults> {
        let mut standing = Standing::new(flat, sites)?;
        let mut list = Vec::new();
        for (at, kind) in standing.names() {
            let offered = catalogue.effects().iter().filter(|it| it.sites.contains(&kind));
            let offer = |effect: &Effect, units| Offer { kind: effect.kind.clone(), units };
            let effects = offered.filter_map(|it| standing.units(it, &at, kind).map(|units| offer(it, units))).collect();
            let roles = standing.roles(&at).into_iter();
            let roles = roles.map(|(role, parts, unit)| RoleValue { role, parts, unit }).collect();
            let terms = standing.balance(&at).unwrap_or_default();
            let usual_for = sites.iter().find(|it| it.name == at).map(|it| it.usual_for.clone()).unwrap_or_default();
            list.push(Place { at, kind, effects, usual_for, roles, terms });
        }
        Ok(Places { flat: standing.into_flat(), list })
    }
}
