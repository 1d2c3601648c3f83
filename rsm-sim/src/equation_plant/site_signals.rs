//! The quantities at the sites of a plant: which signals of the plant they are, and their values along a record.
//!
//! In: a kind of plant; or a plant file with a record. Out: [`Body`]s, [`SiteSignal`]s. A site gives a quantity its meaning: reports, corrections and
//! experiments need no name of a plant.

use rsm_model::effects::{Place, SiteKind};
use rsm_model::expression::Id;
use rsm_model::system::System;

use super::{plant_of, run};
use crate::effect::{AXIS_SIGN_WIDTH, ROTOR_SIGN_WIDTH};
use crate::equations::signals::spelled;
use crate::kind::PlantKind;
use crate::plant_file::PlantFile;
use crate::record::Record;

/// An element of a role of a site that is an input, an output or a state of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoleName {
    /// The name of the site.
    pub at: &'static str,
    /// The kind of the site.
    pub kind: SiteKind,
    /// The role.
    pub role: &'static str,
    /// The element, for a vector.
    pub part: usize,
    /// The name of the input, the output or the state.
    pub name: &'static str,
}

/// A body that moves: a site that is a rotation, a translation or a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Body {
    /// The name of the site.
    pub at: &'static str,
    /// The kind of the site.
    pub kind: SiteKind,
    /// The output or the state that is its position, if there is one.
    pub position: Option<&'static str>,
    /// The output or the state that is its speed, if there is one. For a vehicle: the speed on the road.
    pub speed: Option<&'static str>,
}

/// A role of a site along a record.
#[derive(Debug, Clone, PartialEq)]
pub struct SiteSignal {
    /// The name of the site.
    pub at: &'static str,
    /// The kind of the site.
    pub kind: SiteKind,
    /// The role.
    pub role: &'static str,
    /// The unit, as written in files; empty if it has none.
    pub unit: String,
    /// The value at each row, for each element of a vector.
    pub parts: Vec<Vec<f64>>,
}

impl SiteSignal {
    /// The length of the vector at each row; for a scalar, its value.
    #[must_use]
    pub fn length(&self) -> Vec<f64> {
        match &self.parts[..] {
            [one] => one.clone(),
            parts => {
                let rows = parts.first().map_or(0, Vec::len);
                (0..rows).map(|row| parts.iter().map(|it| it[row] * it[row]).sum::<f64>().sqrt()).collect()
            }
        }
    }
}

/// The width of the smooth sign of a speed at a kind of site, in m/s or in rad/s.
#[must_use]
pub fn sign_width(kind: SiteKind) -> f64 {
    if kind == SiteKind::Translation { AXIS_SIGN_WIDTH } else { ROTOR_SIGN_WIDTH }
}

/// The inputs, outputs and states that are elements of roles of the declared sites, in the order of the sites.
///
/// ```
/// use rsm_sim::equation_plant::{driveline, role_names};
///
/// let of_vehicle = role_names(driveline()).iter().filter(|it| it.at == "vehicle").map(|it| (it.role, it.name));
/// assert_eq!(of_vehicle.take(2).collect::<Vec<_>>(), [("road_speed", "road_speed"), ("wheel_speed", "wheel_speed")]);
/// ```
#[must_use]
pub fn role_names(kind: PlantKind) -> &'static [RoleName] {
    plant_of(kind.0).role_names.get_or_init(|| found(kind).unwrap_or_default())
}

/// The bodies of a plant, in the order of its sites.
///
/// ```
/// use rsm_sim::equation_plant::{bodies, driveline};
///
/// let speeds: Vec<_> = bodies(driveline()).iter().map(|it| (it.at, it.speed)).collect();
/// assert_eq!(speeds, [("engine", Some("engine_speed")), ("vehicle", Some("road_speed"))]);
/// ```
#[must_use]
pub fn bodies(kind: PlantKind) -> Vec<Body> {
    let one = |place: &'static Place| {
        let speed = match place.kind {
            SiteKind::Rotation | SiteKind::Translation => "speed",
            SiteKind::Vehicle => "road_speed",
            _ => return None,
        };
        let of = |role: &str| role_names(kind).iter().find(|it| it.at == place.at && it.role == role).map(|it| it.name);
        Some(Body { at: &place.at, kind: place.kind, position: of("position"), speed: of(speed) })
    };
    plant_of(kind.0).places.iter().filter_map(one).collect()
}

/// Whether a place is a site that a plant file declares.
fn is_declared(kind: SiteKind) -> bool {
    !matches!(kind, SiteKind::Input | SiteKind::Output | SiteKind::Parameter | SiteKind::State)
}

fn found(kind: PlantKind) -> Option<Vec<RoleName>> {
    let plant = plant_of(kind.0);
    let places = plant.file.places_of_effects().ok()?;
    let mut system = System::new(&places.flat).ok()?;
    let mut named: Vec<(Id, &'static str)> = Vec::new();
    for signal in kind.0.inputs.iter().chain(&kind.0.outputs).chain(&kind.0.starts) {
        let Some(symbol) = system.find(signal.name) else { continue };
        named.push((system.value(symbol), signal.name));
    }
    let mut list = Vec::new();
    for (own, place) in plant.places.iter().zip(&places.list).filter(|it| is_declared(it.0.kind)) {
        for (role, parts) in own.roles.iter().zip(&place.roles) {
            for (part, id) in parts.parts.iter().enumerate() {
                let id = system.expressed(*id);
                if let Some((_, name)) = named.iter().find(|it| it.0 == id) {
                    list.push(RoleName { at: &own.at, kind: own.kind, role: &role.role, part, name });
                }
            }
        }
    }
    Some(list)
}

/// The values of all roles of the declared sites along a record, at every row. `None` if the plant cannot follow the record. Effects of the file act;
/// the quantities are those of the equations without them.
///
/// ```
/// use rsm_core::source::Source;
/// use rsm_sim::{equation_plant::site_signals, plant_file::PlantFile, record::Record};
///
/// let axis = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\nviscous_friction = 0.0\ncommand_limit = 10.0\n";
/// let plant = PlantFile::read(&Source::new("axis.toml", axis))?;
/// let record = Record::in_memory(&plant, &[("time", &[0.0, 0.5]), ("command", &[1.0, 1.0]), ("position", &[0.0, 0.0])])?;
/// let signals = site_signals(&plant, &record).unwrap();
/// let speed = signals.iter().find(|it| it.role == "speed").unwrap();
/// assert!((speed.parts[0][1] - 1.0).abs() < 1e-9); // 4 N on 2 kg, for 0.5 s
/// # Ok::<(), rsm_core::source::Faults>(())
/// ```
#[must_use]
pub fn site_signals(file: &PlantFile, record: &Record) -> Option<Vec<SiteSignal>> {
    let kind = file.kind.driven_by(record.drive).0;
    let (whole, machine, points) = run::with_effects(file, record, 1).ok()?;
    let places = whole.places_of_effects().ok()?;
    let mut system = System::new(&places.flat).ok()?;
    let mut signals = Vec::new();
    let mut ids = Vec::new();
    for (own, place) in plant_of(kind).places.iter().zip(&places.list).filter(|it| is_declared(it.0.kind)) {
        for (role, part) in own.roles.iter().zip(&place.roles) {
            ids.extend(part.parts.iter().map(|id| system.expressed(*id)));
            let parts = vec![Vec::with_capacity(points.len()); part.parts.len()];
            signals.push(SiteSignal { at: &own.at, kind: own.kind, role: &role.role, unit: spelled(&role.unit), parts });
        }
    }
    for values in machine.evaluated_at(&whole, &system, &ids, &points).ok()? {
        let mut values = values.into_iter();
        signals.iter_mut().flat_map(|it| &mut it.parts).for_each(|part| part.extend(values.next()));
    }
    (points.len() == record.rows()).then_some(signals)
}
