//! The built-in plants, described in `schema` and `effects`: their equations, and the assignment of a plant file of format 1 to these equations.
//!
//! In: a plant file of kind ServoAxis, a record. Out: the name of its text, and the values of the parameters of the text. The
//! equations are built with the parameter values of the text, so the compiled code does not depend on the order of the calls.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use rsm_core::source::{Faults, Source};
use rsm_model::effects::Catalogue;

use crate::equations::extended::{Entry, NamedValue};
use crate::equations::file::{EquationFile, of_rows};
use crate::kind::PlantKind;
use crate::parameters::{Parameters, VelocityFrom};
use crate::plant_file::PlantFile;
use crate::record::{Drive, Record};
use crate::schema;

/// Parameters that an axis has only with its controller.
const OF_CONTROLLER: [&str; 2] = ["position_gain", "velocity_gain"];

/// The names of the texts, in the order of [`place`].
const TEXTS: [&str; 2] = ["servo-axis#ServoAxis", "servo-axis#ServoAxisClosedLoop"];

/// The index of the text for a record.
fn place(record: &Record) -> usize {
    usize::from(record.drive == Drive::Closed)
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
pub(super) fn text(record: &Record) -> &'static str {
    TEXTS[place(record)]
}

/// The equations of a plant file for a record, with effects.
pub(super) fn equations(file: &PlantFile, record: &Record, effects: &[Entry]) -> Result<EquationFile, Faults> {
    static WITHOUT_EFFECTS: [OnceLock<EquationFile>; TEXTS.len()] = [const { OnceLock::new() }; TEXTS.len()];
    let place = place(record);
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
    let counts = |name: &str| record.drive == Drive::Closed || name != "command";
    let own = file.initial.iter().filter(|it| counts(it.0));
    own.map(|(name, value)| NamedValue { name: (*name).to_string(), value: *value }).collect()
}

/// The instants of the rows: the first instant plus multiples of the period.
pub(super) fn instants(record: &Record) -> Cow<'_, [f64]> {
    let begin = record.first_time();
    Cow::Owned((0..record.rows()).map(|row| begin + row as f64 * record.period).collect())
}
