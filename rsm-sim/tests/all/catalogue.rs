//! The list of effects contains the files of the folder and the rows of docs/book/src/reference/plants.md, and no plant contains code for an effect.

use std::collections::BTreeSet;

use rsm_core::source::Source;
use rsm_sim::effect::declared::Part;
use rsm_sim::effect::{Arguments, Description};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::{effects, equation_plant};

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
fn every_kind_has_a_file_and_a_place_in_the_list() {
    let listed: BTreeSet<String> = effects::ALL.iter().map(|it| it.kind.replace('-', "_")).collect();
    let entries = std::fs::read_dir(path("src/effects")).unwrap().map(|entry| entry.unwrap().path());
    let files: BTreeSet<String> = entries.map(|file| file.file_stem().unwrap().to_str().unwrap().to_string()).collect();
    let lacking: Vec<String> = files
        .iter()
        .filter(|name| *name != "mod" && !listed.contains(*name))
        .map(|name| format!("&{name}::DESCRIPTION,"))
        .collect();
    assert!(lacking.is_empty(), "effects/mod.rs lacks these lines: {lacking:?}");
    let expected: BTreeSet<String> = KINDS.iter().map(|kind| kind.replace('-', "_")).collect();
    assert_eq!(listed, expected);
    assert_eq!(files.len(), listed.len() + 1, "a file of effects/ is missing");
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
fn every_header_has_its_six_lines() {
    for description in effects::ALL {
        let file = path(&format!("src/effects/{}.rs", description.kind.replace('-', "_")));
        let text = std::fs::read_to_string(file).unwrap();
        for line in ["Formula ", "Source ", "Acts on ", "Looks like ", "Told apart ", "Report says "] {
            assert!(text.contains(&format!("//! {line}")), "{}: no line `{line}`", description.kind);
        }
        let says = format!("//! Report says  \"{}\"", description.sentence);
        assert!(text.contains(&says), "{}: the header says something else", description.kind);
        // The report can fill every placeholder of the sentence.
        for part in description.sentence.split('{').skip(1) {
            let name = part.split('}').next().unwrap();
            let known = description.arguments.iter().any(|it| it.name == name) || ["parameter", "output"].contains(&name);
            assert!(known, "{}: `{name}` is no argument", description.kind);
        }
        // Each effect has its own check text: a whole sentence without placeholders.
        let check = description.check;
        assert!(check.ends_with('.') && !check.contains('{'), "{}: {check}", description.kind);
        let same = effects::ALL.iter().filter(|it| it.check == check).count();
        assert_eq!(same, 1, "{}: another effect is checked in the same words", description.kind);
    }
}

#[test]
fn no_plant_knows_an_effect() {
    for name in ["pmac", "driveline", "servo_axis", "mod"] {
        let text = std::fs::read_to_string(path(&format!("src/plants/{name}.rs"))).unwrap();
        for kind in KINDS {
            let words = [kind.to_string(), kind.replace('-', "_"), format!("crate::effects::{kind}")];
            assert!(!words.iter().any(|word| text.contains(word.as_str())), "plants/{name}.rs names {kind}");
        }
        assert!(!text.contains("crate::effects"), "plants/{name}.rs imports the catalogue");
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
                .arguments_on(kind)
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
fn simpler_forms_in_files_are_those_in_code() {
    let text = "format = 2\nmodel = \"rsm:servo-axis#ServoAxis\"\n";
    let open = |name: &str| Ok::<_, rsm_core::source::Faults>(Source::new(name, ""));
    let axis = equation_plant::read(&Source::new("axis.toml", text), &open).unwrap().kind;
    let levels = [("forward", 30.0), ("backward", 20.0)];
    let viscous = [("viscous_forward", 100.0), ("viscous_backward", 140.0)];
    let cases = [
        ("asymmetric-friction", levels.to_vec()),
        ("asymmetric-friction", [levels, viscous].concat()),
        ("stribeck-friction", vec![("coulomb", 5.0), ("static", 9.0), ("stribeck_velocity", 0.1)]),
    ];
    for (kind, numbers) in cases {
        let by_code = effects::of(kind).unwrap();
        let by_file = equation_plant::effects_on(axis).into_iter().find(|it| it.kind == kind).unwrap();
        let forms = |of: &Description, plant, subject: Option<&str>| {
            let subject = subject.map(str::to_string);
            of.declared.forms.of(&Arguments { plant, subject, numbers: numbers.clone() })
        };
        let (code, file) = (forms(by_code, equation_plant::servo_axis(), None), forms(by_file, axis, Some("carriage")));
        // The parts of a file name their place.
        let plain = |part: &Part| Part { subject: part.subject.filter(|it| *it != "carriage"), ..*part };
        let list = |parts: &Vec<Part>| parts.iter().map(plain).collect::<Vec<Part>>();
        assert_eq!(file.special.iter().map(list).collect::<Vec<_>>(), code.special, "{kind}");
        assert_eq!(file.alike.as_ref().map(list), code.alike, "{kind}");
        let level = file.level.map(|it| (plain(&it.of), it.errors));
        assert_eq!(level, code.level.map(|it| (it.of, it.errors)), "{kind}");
        assert!(file.special.iter().flatten().all(|it| it.subject == Some("carriage")));
        assert!(file.special.iter().flatten().all(|it| it.entry(axis).is_some()));
    }
}
