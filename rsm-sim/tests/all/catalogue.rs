//! The effects of plant files of format 1 are the rows of docs/book/src/reference/plants.md, with words and simpler forms.

use std::collections::BTreeSet;

use rsm_core::source::Source;
use rsm_sim::effect::Arguments;
use rsm_sim::effect::declared::Part;
use rsm_sim::equation_plant;
use rsm_sim::plant_file::PlantFile;

use super::path;

/// The first column of the table of docs/book/src/reference/plants.md, section 3.
const KINDS: [&str; 33] = [
    "parameter-error",
    "coulomb-friction",
    "asymmetric-friction",
    "stribeck-friction",
    "windage",
    "constant-load",
    "load-drift",
    "cogging-torque",
    "torque-ripple",
    "magnetic-saturation",
    "resistance-heating",
    "inverter-dead-time",
    "voltage-limit",
    "angle-offset",
    "angle-eccentricity",
    "input-delay",
    "input-gain",
    "sensor-gain",
    "sensor-bias",
    "sensor-lag",
    "sensor-delay",
    "sensor-quantisation",
    "sensor-drift",
    "shaft-compliance",
    "backlash",
    "clutch-stiffening",
    "clutch-slip",
    "tyre-slip",
    "road-grade",
    "headwind",
    "brake-drag",
    "throttle-nonlinearity",
    "combustion-ripple",
];

#[test]
fn every_kind_is_possible_on_a_plant_of_format_1_and_no_other() {
    let plants = equation_plant::first_format();
    let possible: BTreeSet<&str> =
        plants.iter().flat_map(|(_, kind)| equation_plant::effects_on(*kind)).map(|it| it.kind).collect();
    assert_eq!(possible, BTreeSet::from(KINDS));
}

#[test]
fn the_reference_has_a_row_for_every_kind_in_this_order() {
    let page = std::fs::read_to_string(path("../docs/book/src/reference/plants.md")).unwrap();
    let section = page.split_once("## 3. The catalogue of effects").unwrap().1.split_once("\n## 4.").unwrap().0;
    let rows: Vec<&str> = section.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).collect();
    assert_eq!(rows, KINDS);
}

#[test]
fn the_reference_names_every_effect_that_is_a_file() {
    // Section 3 contains the effects of the built-in plants, the last table the other effects. A row may name two.
    let page = std::fs::read_to_string(path("../docs/book/src/reference/plants.md")).unwrap();
    let more = page.rsplit_once("These are in the catalogue beside those of section 3").unwrap().1;
    let first_cells = more.lines().filter(|line| line.starts_with("| `")).filter_map(|line| line.split('|').nth(1));
    let mut named: BTreeSet<String> =
        first_cells.flat_map(|cell| cell.split('`').skip(1).step_by(2).map(String::from)).collect();
    named.extend(KINDS.iter().map(|it| (*it).to_string()));
    let catalogue = rsm_model::effects::Catalogue::shipped();
    let files: BTreeSet<String> = catalogue.effects().iter().map(|it| it.kind.clone()).collect();
    assert_eq!(named, files);
}

#[test]
fn every_sentence_can_be_filled_and_every_check_is_its_own() {
    for (_, kind) in equation_plant::first_format() {
        let all = equation_plant::effects_on(kind);
        for description in &all {
            for part in description.sentence.split('{').skip(1) {
                let name = part.split('}').next().unwrap();
                let known = description.argument(name).is_some() || ["parameter", "output"].contains(&name);
                assert!(known, "{}: `{name}` is no argument", description.kind);
            }
            // A whole sentence without placeholders, also beside the same effect on another output.
            let check = description.check;
            assert!(check.ends_with('.') && !check.contains('{'), "{}: {check}", description.kind);
            let others: Vec<&str> =
                all.iter().filter(|it| it.check == check && it.kind != description.kind).map(|it| it.kind).collect();
            assert!(others.is_empty(), "{}: {others:?} are checked in the same words", description.kind);
        }
    }
}

#[test]
fn a_file_with_effects_is_written_and_read_back_to_the_same_bits() {
    for (_, kind) in equation_plant::first_format() {
        let mut text = std::fs::read_to_string(path(&format!("plants/{}.toml", kind.name()))).unwrap();
        for description in equation_plant::effects_on(kind) {
            let subject = match description.subject {
                rsm_sim::effect::Subject::None | rsm_sim::effect::Subject::Site => String::new(),
                rsm_sim::effect::Subject::Parameter => {
                    "parameter = \"mass\", ".replace("mass", if kind.is("pmac") { "inertia" } else { "mass" })
                }
                rsm_sim::effect::Subject::Output => {
                    format!("output = \"{}\", ", description.at.unwrap_or(kind.outputs()[0].name))
                }
            };
            let numbers: Vec<String> = description
                .arguments
                .iter()
                .map(|it| format!("{} = {}", it.name, if it.name == "cycles" { "24" } else { "0.3" }))
                .collect();
            text += &super::effect(description.kind, &(subject + &numbers.join(", ")));
        }
        let read = |text: &str| PlantFile::read(&Source::new("p.toml", text)).unwrap_or_else(|faults| panic!("{faults}"));
        let first = read(&text);
        let written = first.write();
        let second = read(&written);
        assert_eq!(first.parameters, second.parameters);
        assert_eq!((first.effects.len(), written), (second.effects.len(), second.write()));
    }
}

#[test]
fn simpler_forms_are_those_worked_out_by_hand() {
    let text = "format = 2\nmodel = \"rsm:servo-axis#ServoAxis\"\n";
    let open = |name: &str| Ok::<_, rsm_core::source::Faults>(Source::new(name, ""));
    let axis = equation_plant::read(&Source::new("axis.toml", text), &open).unwrap().kind;
    let forms = |kind: &str, numbers: &[(&'static str, f64)]| {
        let description = equation_plant::effect(axis, kind).unwrap();
        let arguments = Arguments { plant: axis, subject: Some("carriage".to_string()), numbers: numbers.to_vec() };
        description.declared.forms.of(&arguments)
    };
    let at = |kind: &'static str, value: f64| Part { kind, subject: Some("carriage"), value };
    let levels = [("forward", 30.0), ("backward", 20.0)];
    // Two levels: their mean as friction, half of their difference as a load. Viscous friction has no part in it.
    let found = forms("asymmetric-friction", &levels);
    assert_eq!(found.special, [vec![at("coulomb-friction", 25.0)]]);
    assert_eq!(found.alike, Some(vec![at("coulomb-friction", 25.0), at("constant-load", 5.0)]));
    assert_eq!(found.level.map(|it| (it.of, it.errors.len())), Some((at("coulomb-friction", 25.0), 0)));
    // Two dampings of 100 and 140 N s/m: the damping of the plant is their mean.
    let viscous = [("viscous_forward", 100.0), ("viscous_backward", 140.0)];
    let level = forms("asymmetric-friction", &[levels, viscous].concat()).level.unwrap();
    assert_eq!(level.errors, [Part { kind: "parameter-error", subject: Some("viscous_friction"), value: 120.0 }]);
    // A Stribeck friction whose static friction does not count.
    let found = forms("stribeck-friction", &[("coulomb", 5.0), ("static", 9.0), ("stribeck_velocity", 0.1)]);
    assert_eq!(found.special, [vec![at("coulomb-friction", 5.0)]]);
    assert!(found.special.iter().flatten().all(|it| it.entry(axis).is_some()));
}
