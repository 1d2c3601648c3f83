//! The plants of plant files of format 1 as plants of equations.
//!
//! In: a text that is shipped with the project, with its sites. Out: a [`Described`] with the name of format 1, read once a process. All plant files
//! of a kind share it: their values are numbers, and change no equation.

use std::cell::RefCell;
use std::sync::{Arc, OnceLock};

use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{TableReader, parse};
use rsm_model::effects::{Catalogue, shipped_file};

use super::described;
use crate::equations::file::{EquationFile, NamedValue};
use crate::kind::{Described, PlantKind};
use crate::parameters::{Parameters, VelocityFrom};

/// The key in a file of sites: the effects of format 1, in the order of docs/book/src/reference/plants.md, section 3.
const EFFECTS: &str = "effects_of_format_1";

/// The kinds of plant files of format 1, with their names in a file.
#[must_use]
pub fn kinds() -> [(&'static str, PlantKind); 3] {
    [("pmac", pmac()), ("driveline", driveline()), ("servo-axis", servo_axis())]
}

/// The kind of plant files with `plant = "pmac"`.
///
/// # Panics
/// Never: a test reads the texts of the project.
#[must_use]
pub fn pmac() -> PlantKind {
    static KIND: OnceLock<&'static Described> = OnceLock::new();
    PlantKind(KIND.get_or_init(|| read("pmac", "pmac", None).expect("a text of the project is right")))
}

/// The kind of plant files with `plant = "driveline"`.
///
/// # Panics
/// Never: a test reads the texts of the project.
#[must_use]
pub fn driveline() -> PlantKind {
    static KIND: OnceLock<&'static Described> = OnceLock::new();
    PlantKind(KIND.get_or_init(|| read("driveline", "driveline", None).expect("a text of the project is right")))
}

/// The kind of plant files with `plant = "servo-axis"`: the axis with its controller. Its `open_loop` is the axis alone.
///
/// # Panics
/// Never: a test reads the texts of the project.
#[must_use]
pub fn servo_axis() -> PlantKind {
    static KIND: OnceLock<&'static Described> = OnceLock::new();
    let both = || {
        let open = PlantKind(read("servo-axis", "servo-axis#ServoAxis", None)?);
        read("servo-axis", "servo-axis#ServoAxisClosedLoop", Some(open))
    };
    PlantKind(KIND.get_or_init(|| both().expect("a text of the project is right")))
}

/// The parameters of a text that are true or false, as a plant file of format 1 sets them.
pub(super) fn switches(parameters: &Parameters) -> [NamedValue; 1] {
    let from_difference = f64::from(u8::from(parameters.velocity_from == VelocityFrom::Difference));
    [NamedValue { name: "velocity_from_difference".to_string(), value: from_difference }]
}

fn read(name: &'static str, text: &str, open_loop: Option<PlantKind>) -> Result<&'static Described, Faults> {
    let source = Source::new("plant.toml", format!("format = 2\nmodel = \"rsm:{text}\"\n"));
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, ""));
    let catalogue = Arc::new(Catalogue::shipped());
    let file = EquationFile::read_with(&source, &open, &catalogue)?;
    let effects = effects(&file.system.flat().name)?;
    described(&source, RefCell::new(Vec::new()), file, catalogue, Some(&FirstFormat { name, effects, open_loop }))
}

/// The properties of a plant of format 1 that its text does not contain.
pub(super) struct FirstFormat {
    /// The name in a plant file.
    pub(super) name: &'static str,
    /// The kinds of effects.
    pub(super) effects: Vec<String>,
    /// The same plant without its controller.
    pub(super) open_loop: Option<PlantKind>,
}

/// The effects that a file of sites lists for format 1.
fn effects(model: &str) -> Result<Vec<String>, Faults> {
    let mut faults = Collector::new();
    let list = shipped_file(model).and_then(|source| {
        let document = parse(&source, &mut faults)?;
        let mut top = TableReader::document(&source, &document);
        let value = top.required(EFFECTS, &mut faults)?;
        top.texts("`effects_of_format_1`", value, &mut faults)
    });
    faults.finish(list).map(|list| list.into_iter().map(|it| it.0).collect())
}
