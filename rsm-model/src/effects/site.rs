//! Sites: the physical meaning of a part of the equations, at which an effect can act.
//!
//! ```toml
//! [sites.carriage]
//! kind = "translation"
//! position = "position"
//! speed = "speed"
//! inertia = "mass"
//! ```
//!
//! In: tables of a plant file. Out: [`Site`], its roles as expressions in the names of the text. `rewrite` compares a site with the equations.

use std::ops::Range;

use rsm_core::source::{Collector, Source};
use rsm_core::toml_reader::{TableReader, Value as Toml};

use crate::syntax::tree::Expression;

/// The kind of a part of the equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SiteKind {
    /// A body that turns.
    Rotation,
    /// A body that moves on a line.
    Translation,
    /// A spring between two bodies.
    Joint,
    /// A winding of an electrical machine, or any coil.
    Winding,
    /// An electrical machine with its rotor.
    Machine,
    /// A tank or another store.
    Storage,
    /// A heat capacity.
    Heat,
    /// A vehicle on its wheels.
    Vehicle,
    /// An input signal.
    Input,
    /// An output signal.
    Output,
    /// A parameter of the plant.
    Parameter,
    /// The balance of any state.
    State,
}

/// The value of a role that the plant file does not set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Otherwise {
    /// The plant file must set it.
    Required,
    /// This constant.
    Number(f64),
    /// None: an effect that needs the role is not possible there.
    Absent,
}

/// The name of a role, and its value if a plant file does not set it.
type RoleOf = (&'static str, Otherwise);

const BODY: &[RoleOf] = &[
    ("position", Otherwise::Absent),
    ("speed", Otherwise::Required),
    ("inertia", Otherwise::Required),
    ("load", Otherwise::Number(0.0)),
    ("viscous_friction", Otherwise::Number(0.0)),
    ("drive", Otherwise::Absent),
];

impl SiteKind {
    /// All kinds, with their names in files.
    pub const NAMES: [(&'static str, SiteKind); 12] = [
        ("rotation", SiteKind::Rotation),
        ("translation", SiteKind::Translation),
        ("joint", SiteKind::Joint),
        ("winding", SiteKind::Winding),
        ("machine", SiteKind::Machine),
        ("storage", SiteKind::Storage),
        ("heat", SiteKind::Heat),
        ("vehicle", SiteKind::Vehicle),
        ("input", SiteKind::Input),
        ("output", SiteKind::Output),
        ("parameter", SiteKind::Parameter),
        ("state", SiteKind::State),
    ];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Its roles.
    pub(crate) fn roles(self) -> &'static [RoleOf] {
        use Otherwise::{Absent, Number, Required};
        match self {
            SiteKind::Rotation | SiteKind::Translation => BODY,
            SiteKind::Joint => &[("twist", Required), ("rate", Required), ("effort", Required)],
            SiteKind::Winding => &[
                ("currents", Required),
                ("resistance", Required),
                ("inductance", Required),
                ("voltages", Absent),
                ("loss_factor", Number(1.0)),
            ],
            SiteKind::Machine => &[
                ("currents", Required),
                ("voltages", Absent),
                ("held_voltages", Absent),
                ("angle", Required),
                ("pole_pairs", Number(1.0)),
                ("flux_linkage", Absent),
            ],
            SiteKind::Storage => &[("level", Required), ("capacity", Required)],
            SiteKind::Heat => &[("temperature", Required), ("capacity", Required)],
            SiteKind::Vehicle => &[
                ("road_speed", Required),
                ("wheel_speed", Required),
                ("radius", Required),
                ("mass", Required),
                ("resistance", Required),
                ("wheel_inertia", Absent),
                ("grade", Absent),
                ("drag", Absent),
                ("acceleration", Absent),
            ],
            SiteKind::Input | SiteKind::Output | SiteKind::Parameter | SiteKind::State => &[("signal", Required)],
        }
    }

    /// The role whose derivative is in the balance, the role that multiplies it, and the name of an added term in effect files. `None` if the kind
    /// has no balance.
    #[must_use]
    pub fn balance(self) -> Option<(&'static str, Option<&'static str>, &'static str)> {
        match self {
            SiteKind::Rotation | SiteKind::Translation => Some(("speed", Some("inertia"), "effort")),
            SiteKind::Storage => Some(("level", Some("capacity"), "flow")),
            SiteKind::Heat => Some(("temperature", Some("capacity"), "flow")),
            SiteKind::Vehicle => Some(("wheel_speed", Some("wheel_inertia"), "effort")),
            SiteKind::State => Some(("signal", None, "rate")),
            _ => None,
        }
    }
}

/// A site of a plant file.
#[derive(Debug, Clone)]
pub struct Site {
    /// Its name in the plant file.
    pub name: String,
    /// Its kind.
    pub kind: SiteKind,
    /// Kinds of effects that act here if a plant file does not give their place.
    pub(crate) usual_for: Vec<String>,
    /// The roles in the file: expressions, several for a vector.
    pub(crate) roles: Vec<(String, Vec<Expression>, bool)>,
    /// The file with the roles.
    pub(crate) source: Source,
    /// The position in that file.
    pub(crate) place: Range<usize>,
}

impl Site {
    /// Reads a table of sites. Faults go to `faults`.
    pub fn read_all<'a>(source: &'a Source, value: Toml<'a>, faults: &mut Collector) -> Vec<Site> {
        let Some(table) = TableReader::of(source, value, "[sites]", faults) else { return Vec::new() };
        table.entries().filter_map(|(name, place, value)| Self::read(source, name, place, value, faults)).collect()
    }

    fn read<'a>(source: &'a Source, name: &str, place: Range<usize>, value: Toml<'a>, faults: &mut Collector) -> Option<Site> {
        let mut table = TableReader::of(source, value, format!("[sites.{name}]"), faults)?;
        let kind = table.choice("kind", &SiteKind::NAMES, faults)?;
        let usual_for = match table.optional("usual_for") {
            Some(value) => table.texts("`usual_for`", value, faults)?.into_iter().map(|it| it.0).collect(),
            None => Vec::new(),
        };
        let mut roles = Vec::new();
        for (role, otherwise) in kind.roles() {
            let value = if *otherwise == Otherwise::Required { table.required(role, faults) } else { table.optional(role) };
            let Some(value) = value else { continue };
            let is_vector = value.get_ref().as_array().is_some();
            let items: Vec<Toml<'_>> = match value.get_ref().as_array() {
                Some(items) => items.iter().collect(),
                None => vec![value],
            };
            let read: Option<Vec<Expression>> = items.into_iter().map(|it| expression(source, it, faults)).collect();
            roles.extend(read.map(|list| ((*role).to_string(), list, is_vector)));
        }
        table.finish(faults);
        Some(Site { name: name.to_string(), kind, usual_for, roles, source: source.clone(), place })
    }
}

/// An expression in a TOML file, given as a text or as a number.
pub(crate) fn expression(source: &Source, value: Toml<'_>, faults: &mut Collector) -> Option<Expression> {
    let span = value.span();
    let place = match value.get_ref().as_str() {
        Some(text) => {
            let inner = span.start + 1..span.end.saturating_sub(1);
            if source.text().get(inner.clone()) != Some(text) {
                let what = "an expression must be on one line, in one pair of quotes, without escapes";
                faults.push(source.fault(span, what));
                return None;
            }
            inner
        }
        None if value.get_ref().as_float().is_some() || value.get_ref().as_integer().is_some() => span,
        None => {
            faults.push(source.fault(span, "found no text and no number, expected an expression such as \"2*speed\""));
            return None;
        }
    };
    crate::syntax::expression(source, place, faults)
}
