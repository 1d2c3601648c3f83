//! The built-in plants, described in `schema` and `effects`: their equations, and the assignment of a plant file of format 1 to these equations.
//!
//! In: a plant file of kind Driveline or ServoAxis, a record. Out: the name of its text, and the values of the parameters of the text. The
//! equations are built with the parameter values of the text, so the compiled code does not depend on the order of the calls.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use rsm_core::source::{Faults, Source};
use rsm_model::effects::Catalogue;

use crate::equations::extended::{Entry, NamedValue};
use crate::equations::file::{EquationFile, of_rows};
use crate::kind::{PlantKind, StartValues};
use crate::parameters::{Parameters, VelocityFrom};
use crate::plant_file::PlantFile;
use crate::record::{Drive, Record};
use crate::schema;

/// Parameters that an axis has only with its controller.
const OF_CONTROLLER: [&str; 2] = ["position_gain", "velocity_gain"];

/// Start values that are not states of the text: the differences of a car's start from steady rolling.
const OFFSETS: [&str; 3] = ["torque_offset", "twist_offset", "twist_rate"];

/// The names of the texts, in the order of [`place`].
const TEXTS: [&str; 3] = ["driveline", "servo-axis#ServoAxis", "servo-axis#ServoAxisClosedLoop"];

/// The index of the text for a record.
fn place(kind: PlantKind, record: &Record) -> usize {
    match (kind, record.drive) {
        (PlantKind::Driveline, _) => 0,
        (_, Drive::Closed) => 2,
        _ => 1,
    }
}

/// Values of a record and a file that determine the structure of the equations, besides effects.
pub(super) fn shapes(file: &PlantFile, record: &Record) -> Vec<NamedValue> {
    let given = |name: &str, is: bool| vec![NamedValue { name: name.to_string(), value: f64::from(u8::from(is)) }];
    match (file.kind, record.drive) {
        (PlantKind::ServoAxis, Drive::Closed) => {
            given("velocity_from_difference", file.parameters.velocity_from == VelocityFrom::Difference)
        }
        _ => Vec::new(),
    }
}

/// The name of the text that simulates a file along a record.
pub(super) fn text(file: &PlantFile, record: &Record) -> &'static str {
    TEXTS[place(file.kind, record)]
}

/// The equations of a plant file for a record, with effects.
pub(super) fn equations(file: &PlantFile, record: &Record, effects: &[Entry]) -> Result<EquationFile, Faults> {
    static WITHOUT_EFFECTS: [OnceLock<EquationFile>; TEXTS.len()] = [const { OnceLock::new() }; TEXTS.len()];
    let place = place(file.kind, record);
    let without_effects = WITHOUT_EFFECTS[place].get_or_init(|| {
        let source = Source::new("plant.toml", format!("format = 2\nmodel = \"rsm:{}\"\n", TEXTS[place]));
        let open = |name: &str| Ok::<_, Faults>(Source::new(name, ""));
        EquationFile::read_with(&source, &open, &Arc::new(Catalogue::shipped())).expect("a text of the project is right")
    });
    without_effects.with(&[], effects, &shapes(file, record))
}

/// The parameters of a plant along a record, with their names in the text.
pub(super) fn numbers(file: &PlantFile, parameters: &Parameters, record: &Record) -> Vec<(&'static str, f64)> {
    let is_closed = record.drive == Drive::Closed;
    let own = schema::parameters(file.kind).iter().map(|it| it.name);
    // Without gains, the output of the controller is 0.
    let own = own.filter(|name| is_closed || !OF_CONTROLLER.contains(name));
    let mut list: Vec<(&'static str, f64)> = own.map(|name| (name, parameters.optional(name).unwrap_or(0.0))).collect();
    match file.kind {
        PlantKind::Driveline => {
            // The text is always in first gear, and `gear_ratios[1]` gets the ratio of the record's gear. The ratio is a number; the gear would
            // change the structure of the equations.
            list.push(("gear_ratios[1]", parameters.gear_ratios[record.gear - 1]));
            let given = |name: &str| file.initial.iter().find(|it| it.0 == name).map_or(0.0, |it| it.1);
            list.extend(OFFSETS.map(|name| (name, given(name))));
        }
        PlantKind::ServoAxis if is_closed => {
            let [period, begin] = of_rows(record.period, record.first_time()).map(|it| it.value);
            list.extend([("record_period", period), ("record_start", begin)]);
        }
        _ => {}
    }
    list
}

/// The known start values, except first readings.
pub(super) fn initial(file: &PlantFile, record: &Record) -> Vec<NamedValue> {
    let counts = |name: &str| match file.kind {
        // The start of a car is determined by its road speed only.
        PlantKind::Driveline => name == "road_speed",
        _ => record.drive == Drive::Closed || name != "command",
    };
    let own = file.initial.iter().filter(|it| counts(it.0));
    own.map(|(name, value)| NamedValue { name: (*name).to_string(), value: *value }).collect()
}

/// The instants of the rows: the first instant plus multiples of the period.
pub(super) fn instants(record: &Record) -> Cow<'_, [f64]> {
    let begin = record.first_time();
    Cow::Owned((0..record.rows()).map(|row| begin + row as f64 * record.period).collect())
}

/// The standard deviations of the offsets of a car's start, at their indices in the start values. Torque: that of full throttle at the speed of the
/// largest torque of the map. Twist: the twist that transmits this torque to the wheel. Rate: that of an oscillation with this twist as its
/// amplitude.
#[must_use]
pub fn offset_scales(parameters: &Parameters, gear: usize) -> StartValues {
    let of = |name: &str| parameters.number(name);
    let torque = |speed: f64| of("torque_0") + of("torque_1") * speed + of("torque_2") * speed * speed;
    // The speed at which the map has its largest torque, if it has a maximum.
    let best = if of("torque_2") < 0.0 { (-0.5 * of("torque_1") / of("torque_2")).max(0.0) } else { 0.0 };
    let torque = torque(best).abs();
    let ratio = parameters.gear_ratios[gear - 1] * of("final_drive_ratio");
    let twist = ratio * torque / of("driveshaft_stiffness");
    // The engine oscillates against the wheel through the driveshaft.
    let swing = (of("driveshaft_stiffness") / (of("engine_inertia") * ratio * ratio)).sqrt();
    let mut scales = StartValues::default();
    let starts = PlantKind::Driveline.starts();
    for (name, scale) in OFFSETS.iter().zip([torque, twist, swing * twist]) {
        let place = starts.iter().position(|it| it.name == *name).expect("an offset is a place of a start");
        scales[place] = scale;
    }
    scales
}
