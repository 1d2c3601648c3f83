//! The diagnosis of plants that exist only as texts: the examples, with records from a second implementation.
//!
//! In: `examples/plants`. The records come from `tests/hidden-effects`, which shares no code with the project.

use std::path::PathBuf;

use rsm_core::source::Source;
use rsm_diagnose::plant::calibrated_records::{CalibratedRecords, HeavyTails};
use rsm_diagnose::plant::checks::SWAPPED;
use rsm_diagnose::plant::row_share::Searched;
use rsm_diagnose::plant::{Diagnosis, Options, Verdict, diagnose, hypotheses};
use rsm_sim::equation_plant;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

fn folder(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../examples/plants").join(name)
}

fn source(name: &str, file: &str) -> Source {
    let path = folder(name).join(file);
    Source::new(file, std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
}

fn plant(name: &str) -> PlantFile {
    let open = |file: &str| Ok(source(name, file));
    equation_plant::read(&source(name, "plant.toml"), &open).unwrap_or_else(|faults| panic!("{faults}"))
}

fn diagnosed(name: &str, file: &PlantFile) -> Diagnosis {
    let read = |csv: &str| Record::read(&source(name, csv), file).unwrap_or_else(|faults| panic!("{faults}"));
    let options = Options { threads: 2, progress: &|_| {} };
    diagnose(file, &[read("record.csv")], &[read("validation.csv")], &options).unwrap()
}

/// The only cause of an example, with its first number.
fn cause(name: &str) -> (String, String, f64) {
    let found = diagnosed(name, &plant(name));
    assert_eq!((found.verdict, found.causes.len()), (Verdict::Explained, 1), "{name}");
    let cause = &found.causes[0];
    // On the records that chose it, everything except noise is removed.
    assert!(found.gain > 0.99, "{name}: {}", found.gain);
    (cause.kind.to_string(), cause.subject.clone().unwrap_or_default(), cause.parameters[0].value)
}

#[test]
fn a_dry_friction_behind_a_gear_is_named_with_its_place_and_its_level() {
    let (kind, at, torque) = cause("gear-motor");
    assert_eq!((kind.as_str(), at.as_str()), ("coulomb-friction", "shaft"));
    // The hidden torque is 0.35 N m; the records determine it to a thousandth.
    assert!((torque - 0.35).abs() < 0.005, "{torque}");
}

#[test]
fn radiation_of_a_heater_is_named() {
    let (kind, at, _) = cause("heated-block");
    assert_eq!((kind.as_str(), at.as_str()), ("radiation", "heater"));
}

#[test]
fn a_wind_against_a_car_is_named() {
    let (kind, at, speed) = cause("road-vehicle");
    assert_eq!((kind.as_str(), at.as_str()), ("headwind", "car"));
    assert!((speed - 4.0).abs() < 0.1, "{speed}");
}

#[test]
fn the_extended_plant_is_a_file_that_reads_back_and_runs_as_the_diagnosis_ran_it() {
    let name = "road-vehicle";
    let file = plant(name);
    let found = diagnosed(name, &file);
    let text = found.plant.write();
    let open = |file: &str| Ok(source(name, file));
    let again = equation_plant::read(&Source::new("extended.toml", text.clone()), &open)
        .unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    let record = Record::read(&source(name, "validation.csv"), &again).unwrap();
    let run = |file: &PlantFile| Simulator::new(file, &record).unwrap().run(&record).unwrap().values;
    assert_eq!(run(&again), run(&found.plant), "{text}");
    assert_ne!(run(&again), run(&file));
}

#[test]
fn a_plant_that_is_right_has_no_discrepancy() {
    let name = "road-vehicle";
    let truth = diagnosed(name, &plant(name)).plant;
    // The same machine with a known wind: nothing remains to be found.
    let nominal = PlantFile { given: truth.effects.clone(), effects: Vec::new(), ..truth };
    let found = diagnosed(name, &nominal);
    assert_eq!(found.verdict, Verdict::NoDiscrepancy);
    assert!(found.causes.is_empty());
}

#[test]
fn columns_under_each_others_headers_are_told_and_put_right() {
    let name = "coupled-tanks";
    let file = plant(name);
    let read = |csv: &str, swap: bool| {
        let mut record = Record::read(&source(name, csv), &file).unwrap();
        if swap {
            record.measured.swap(0, 1);
        }
        record
    };
    let options = Options { threads: 2, progress: &|_| {} };
    let found = diagnose(&file, &[read("record.csv", true)], &[read("validation.csv", false)], &options).unwrap();
    let told: Vec<(&str, &str, &str)> =
        found.findings.iter().map(|it| (it.record.as_str(), it.channel.as_str(), it.what)).collect();
    // The validation record has no fault.
    assert_eq!(told, [("record.csv", "level_1", SWAPPED), ("record.csv", "level_2", SWAPPED)]);
    assert_eq!((found.verdict, found.causes[0].kind), (Verdict::Explained, "leak"));
}

#[test]
fn a_number_that_the_file_calls_exact_is_no_hypothesis() {
    let name = "road-vehicle";
    let mut file = plant(name);
    let record = Record::read(&source(name, "record.csv"), &file).unwrap().piece(0..600);
    let errors = |file: &PlantFile| {
        let options = Options { threads: 1, progress: &|_| {} };
        let records = std::slice::from_ref(&record);
        let prepared = CalibratedRecords::of(file, records, &[], HeavyTails::Ignored, Searched::Most, &options).unwrap();
        let all = hypotheses::all(file.kind, &prepared.survey, &[0]);
        all.iter().filter(|it| it.description.kind == "parameter-error").filter_map(|it| it.subject).collect::<Vec<_>>()
    };
    assert!(errors(&file).contains(&"drag_area"), "{:?}", errors(&file));
    file.tolerance.retain(|it| it.0 != "drag_area");
    file.tolerance.push(("drag_area", 0.0));
    assert!(!errors(&file).contains(&"drag_area"));
}

/// Every effect that is possible on a plant is a hypothesis with a first guess: none is omitted without a message.
#[test]
fn every_effect_of_every_place_has_a_first_guess() {
    for name in ["gear-motor", "coupled-tanks", "road-vehicle", "heated-block", "two-mass-drive", "quadrotor-pitch"] {
        let file = plant(name);
        let record = Record::read(&source(name, "record.csv"), &file).unwrap().piece(0..1000);
        let options = Options { threads: 2, progress: &|_| {} };
        let prepared = CalibratedRecords::of(&file, &[record], &[], HeavyTails::Ignored, Searched::Most, &options).unwrap();
        let outputs: Vec<usize> = (0..file.kind.outputs().len()).collect();
        let all = hypotheses::all(file.kind, &prepared.survey, &outputs);
        let mut without = Vec::new();
        for it in equation_plant::effects_on(file.kind) {
            let is_there =
                all.iter().any(|one| one.description.kind == it.kind && it.at.is_none_or(|at| one.subject == Some(at)));
            if !is_there {
                without.push(format!("{} at {}", it.kind, it.at.unwrap_or("a parameter")));
            }
        }
        assert!(without.is_empty(), "{name}: no guess for {without:?}");
    }
}
