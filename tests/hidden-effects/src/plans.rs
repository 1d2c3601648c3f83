//! The list of cases: families, and what each case hides.
//!
//! In: nothing. Out: [`Plan`]s. Draws no number.

use crate::bench::{Noise, Spoiled};
use crate::draw;
use crate::outside;
use crate::plant::Kind;

/// The hidden cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// Every effect of the catalogue, once for each plant where it is possible.
    Singles,
    /// Two effects of the catalogue.
    Pairs,
    /// Nothing.
    Nulls,
    /// An effect that is not in the catalogue.
    Outside,
    /// Only damaged data.
    Faults,
    /// An effect in only one of the records, which has a different configuration.
    Records,
    /// Causes together with a symmetry: the forces and the mass of an axis may change by the same factor.
    Symmetries,
    /// Nothing, but with tolerances four times as wide and parameters near their ends: a calibration with a distant start.
    Far,
    /// Effects of the catalogue beyond the usual range: waves of any order, long delays, friction that is most of the effort, large sensor errors.
    Beyond,
    /// An effect in records with a missing output; only on the plants of `examples/plants/`.
    Missing,
    /// Nothing or an effect, with noise that differs from the statement of the file.
    Noise,
    /// Only data that a logger damaged.
    Data,
    /// Records of two configurations in one diagnosis.
    Configurations,
}

impl Family {
    /// All families, in the order of the table.
    pub const ALL: [Family; 13] = [
        Family::Singles,
        Family::Nulls,
        Family::Pairs,
        Family::Outside,
        Family::Faults,
        Family::Records,
        Family::Symmetries,
        Family::Far,
        Family::Beyond,
        Family::Missing,
        Family::Noise,
        Family::Data,
        Family::Configurations,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Family::Singles => "singles",
            Family::Pairs => "pairs",
            Family::Nulls => "nulls",
            Family::Outside => "outside",
            Family::Faults => "faults",
            Family::Records => "records",
            Family::Symmetries => "symmetries",
            Family::Far => "far",
            Family::Beyond => "beyond",
            Family::Missing => "missing",
            Family::Noise => "noise",
            Family::Data => "data",
            Family::Configurations => "configurations",
        }
    }

    /// The share of correct answers that must be reached. Cases of the family `Faults` have no effect, so their share is that of `Nulls`.
    pub fn threshold(self) -> f64 {
        match self {
            Family::Singles | Family::Nulls | Family::Faults | Family::Far => 0.95,
            Family::Pairs | Family::Configurations | Family::Records | Family::Symmetries | Family::Beyond => 0.85,
            Family::Outside | Family::Missing | Family::Noise | Family::Data => 0.90,
        }
    }
}

/// A fault of the data in the first training record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Rows are missing.
    Gap,
    /// A channel keeps its value for some time.
    Stuck,
    /// A channel does not exceed a limit.
    Clipped,
    /// A section of the outputs occurs twice, the second time instead of the measured values.
    Duplicated,
    /// A channel is delayed by some rows.
    Shifted,
    /// A channel keeps its value from a row to the end.
    Frozen,
    /// A channel has one value in all training records.
    Constant,
}

impl Fault {
    const ALL: [Fault; 7] =
        [Fault::Gap, Fault::Stuck, Fault::Clipped, Fault::Duplicated, Fault::Shifted, Fault::Frozen, Fault::Constant];

    /// A word that a report of this fault must contain.
    pub fn word(self) -> &'static str {
        match self {
            Fault::Gap => "gap",
            Fault::Stuck | Fault::Frozen => "stuck",
            Fault::Constant => "constant",
            Fault::Clipped => "clip",
            Fault::Duplicated => "duplicat",
            Fault::Shifted => "shift",
        }
    }
}

/// The plan of a case.
pub(crate) struct Plan {
    pub(crate) name: String,
    pub(crate) family: Family,
    pub(crate) kind: Kind,
    /// The kinds of effects from the catalogue.
    pub(crate) effects: Vec<&'static str>,
    pub(crate) outside: Option<&'static str>,
    pub(crate) fault: Option<Fault>,
    /// The effect of one record only.
    pub(crate) own: Option<&'static str>,
    /// Noise that differs from the statement of the file.
    pub(crate) noise: Option<Noise>,
    /// The damage by a logger.
    pub(crate) spoiled: Option<Spoiled>,
}

impl Plan {
    fn new(name: String, family: Family, kind: Kind, effects: Vec<&'static str>) -> Self {
        Plan { name, family, kind, effects, outside: None, fault: None, own: None, noise: None, spoiled: None }
    }
}

/// Pairs with different effects on the records, whose order has no influence.
const PAIRS: [(Kind, &str, &str); 10] = [
    (Kind::Motor, "coulomb-friction", "windage"),
    (Kind::Motor, "magnetic-saturation", "inverter-dead-time"),
    (Kind::Motor, "angle-offset", "constant-load"),
    (Kind::Motor, "cogging-torque", "sensor-lag"),
    (Kind::Car, "backlash", "headwind"),
    (Kind::Car, "tyre-slip", "throttle-nonlinearity"),
    (Kind::Car, "brake-drag", "input-delay"),
    (Kind::ClosedAxis, "coulomb-friction", "constant-load"),
    (Kind::ClosedAxis, "cogging-torque", "input-delay"),
    (Kind::OpenAxis, "stribeck-friction", "parameter-error"),
];

/// Effects of only one record: a slope, a wind, or a load that was not recorded.
const OWN: [(Kind, &str); 4] =
    [(Kind::Car, "road-grade"), (Kind::Car, "headwind"), (Kind::Motor, "constant-load"), (Kind::ClosedAxis, "constant-load")];

/// Axes whose records show only the ratios of forces and mass: dry friction together with an error of the mass, in open and in closed loop, and
/// forces that all increase together.
const SYMMETRIES: &[(&str, Kind, &[&str])] = &[
    ("mass-open", Kind::OpenAxis, &["coulomb-friction", "mass-error"]),
    ("mass-closed", Kind::ClosedAxis, &["coulomb-friction", "mass-error"]),
    ("gain-open", Kind::OpenAxis, &["input-gain"]),
    ("gain-closed", Kind::ClosedAxis, &["input-gain", "coulomb-friction"]),
];

/// Effects beyond the usual range: see `draw::beyond`. Two waves together are not tested, because the catalogue contains a wave only once.
const BEYOND: &[(&str, Kind, &[&str])] = &[
    ("order-a", Kind::Motor, &["any-order"]),
    ("order-b", Kind::Motor, &["any-order"]),
    ("late-input", Kind::Motor, &["late-input"]),
    ("late-sensor", Kind::Motor, &["late-sensor"]),
    ("friction", Kind::Motor, &["heavy-friction"]),
    ("gain", Kind::Motor, &["far-gain"]),
    ("order+friction", Kind::Motor, &["any-order", "heavy-friction"]),
    ("order+gain", Kind::Motor, &["any-order", "sensor-gain"]),
    ("late-input", Kind::Car, &["late-input"]),
    ("late-sensor", Kind::Car, &["late-sensor"]),
    ("gain", Kind::Car, &["far-gain"]),
    ("friction", Kind::OpenAxis, &["heavy-friction"]),
    ("order+friction", Kind::OpenAxis, &["any-order", "heavy-friction"]),
    ("late-sensor-closed", Kind::ClosedAxis, &["late-sensor"]),
    ("gain-closed", Kind::ClosedAxis, &["sensor-gain", "heavy-friction"]),
];

/// The plants of the cases without an effect: three each of motor and car, and each mode of an axis twice.
const NULLS: [Kind; 10] = [
    Kind::Motor,
    Kind::Motor,
    Kind::Motor,
    Kind::Car,
    Kind::Car,
    Kind::Car,
    Kind::OpenAxis,
    Kind::OpenAxis,
    Kind::ClosedAxis,
    Kind::ClosedAxis,
];

/// The quick subset: a few cases for each plant, in seconds instead of minutes.
pub(crate) const QUICK: [&str; 8] = [
    "pmac-windage",
    "pmac-inverter-dead-time",
    "driveline-road-grade",
    "driveline-backlash",
    "servo-axis-coulomb-friction",
    "null-0-pmac",
    "null-8-servo-axis",
    "outside-servo-axis-square-spring",
];

pub(crate) fn plans() -> Vec<Plan> {
    let mut plans = vec![];
    for kind in [Kind::Motor, Kind::Car, Kind::ClosedAxis] {
        for effect in draw::catalogue(kind) {
            // Without a loop, the position contains nothing about friction that a command does not; with the loop both are visible. Half of the
            // effects of the axis run in open loop. A constant offset, a gain or a drift of a position in open loop is equivalent to another load,
            // another gain or another start, so sensors run in closed loop.
            let is_open = ["parameter-error", "stribeck-friction", "cogging-torque", "shaft-compliance"].contains(effect);
            let kind = if kind == Kind::ClosedAxis && is_open { Kind::OpenAxis } else { kind };
            let name = format!("{}-{effect}", kind.name());
            plans.push(Plan::new(name, Family::Singles, kind, vec![effect]));
        }
    }
    for (number, kind) in NULLS.into_iter().enumerate() {
        let name = format!("null-{number}-{}", kind.name());
        plans.push(Plan::new(name, Family::Nulls, kind, vec![]));
    }
    for (kind, one, other) in PAIRS {
        let name = format!("{}-{one}+{other}", kind.name());
        plans.push(Plan::new(name, Family::Pairs, kind, vec![one, other]));
    }
    for (kind, disturbance) in outside::ALL {
        let name = format!("outside-{}-{disturbance}", kind.name());
        plans.push(Plan { outside: Some(disturbance), ..Plan::new(name, Family::Outside, kind, vec![]) });
    }
    let damaged = [Kind::Motor, Kind::Car, Kind::ClosedAxis, Kind::Motor, Kind::Car, Kind::Motor, Kind::Car];
    for (fault, kind) in Fault::ALL.into_iter().zip(damaged) {
        let name = format!("fault-{}-{}", format!("{fault:?}").to_lowercase(), kind.name());
        plans.push(Plan { fault: Some(fault), ..Plan::new(name, Family::Faults, kind, vec![]) });
    }
    for (kind, effect) in OWN {
        let name = format!("record-{}-{effect}", kind.name());
        plans.push(Plan { own: Some(effect), ..Plan::new(name, Family::Records, kind, vec![]) });
    }
    for (name, kind, effects) in SYMMETRIES {
        plans.push(Plan::new(format!("symmetry-{name}"), Family::Symmetries, *kind, effects.to_vec()));
    }
    for (name, kind, effects) in BEYOND {
        plans.push(Plan::new(format!("beyond-{}-{name}", kind.name()), Family::Beyond, *kind, effects.to_vec()));
    }
    for kind in [Kind::Motor, Kind::Car, Kind::ClosedAxis] {
        for (name, noise) in Noise::ALL {
            let plan = Plan::new(format!("noise-{}-{name}", kind.name()), Family::Noise, kind, vec![]);
            plans.push(Plan { noise: Some(noise), ..plan });
        }
        for (name, spoiled) in Spoiled::ALL {
            let plan = Plan::new(format!("data-{}-{name}", kind.name()), Family::Data, kind, vec![]);
            plans.push(Plan { spoiled: Some(spoiled), ..plan });
        }
    }
    for kind in [Kind::Motor, Kind::Car, Kind::OpenAxis, Kind::ClosedAxis] {
        plans.push(Plan::new(format!("far-{kind:?}").to_lowercase(), Family::Far, kind, vec![]));
    }
    plans
}
