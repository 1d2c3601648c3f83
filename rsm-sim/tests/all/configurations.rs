//! Plants with `[configurations]`: records take their parameters and effects from their configuration, in both formats, and files are read back.

use rsm_core::source::{Faults, Source};
use rsm_sim::configurations::name_in;
use rsm_sim::equation_plant;
use rsm_sim::equations::EquationFile;
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;

const COMMON: &str = "format = 1\nplant = \"servo-axis\"\n[parameters]\nmass = 2.0\nforce_gain = 4.0\nviscous_friction = 3.0\ncommand_limit = 10.0\n\
                      [tolerance]\nmass = 0.02\nviscous_friction = 0.1\n";

const CONFIGURATIONS: &str = "[configurations]\ndiffer = [\"viscous_friction\"]\n[configurations.light]\nrecords = [\"light-*.csv\"]\n\
                              [configurations.heavy]\nrecords = [\"heavy-*.csv\"]\nparameters = { mass = 5.0 }\ntolerance = { mass = 0.05 }\n";

/// Dry friction with a number for each configuration, and a load in one.
const EFFECTS: &str = "[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = { light = 0.5, heavy = 0.9 } }\n\
                       [[effects]]\nkind = \"constant-load\"\nparameters = { force = { heavy = 0.3 } }\n\
                       [[effects]]\nkind = \"parameter-error\"\nparameters = { parameter = \"viscous_friction\", value = { heavy = 4.0 } }\n";

fn read(text: &str) -> PlantFile {
    PlantFile::read(&Source::new("axis.toml", text)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// The position along 300 rows of steps of the command.
fn position(plant: &PlantFile, name: &str) -> Vec<f64> {
    let time: Vec<f64> = (0..300).map(|row| f64::from(row) * 0.01).collect();
    let command: Vec<f64> = (0..300).map(|row| if row % 100 < 50 { 2.0 } else { -1.5 }).collect();
    let columns: [(&str, &[f64]); 3] = [("time", &time), ("command", &command), ("position", &[0.0; 300])];
    let record = Record::in_memory_as(name, plant, &columns).unwrap_or_else(|faults| panic!("{faults}"));
    let found = Simulator::new(plant, &record).unwrap_or_else(|faults| panic!("{faults}")).run(&record).unwrap();
    found.of("position").unwrap().to_vec()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|it| it.to_bits()).collect()
}

/// The same axis as a plant without configurations.
fn heavy() -> PlantFile {
    let common = COMMON.replace("mass = 2.0", "mass = 5.0").replace("viscous_friction = 3.0", "viscous_friction = 4.0");
    let effects = "[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 0.9 }\n\
                   [[effects]]\nkind = \"constant-load\"\nparameters = { force = 0.3 }\n";
    read(&(common + effects))
}

fn light() -> PlantFile {
    read(&(COMMON.to_string() + "[[effects]]\nkind = \"coulomb-friction\"\nparameters = { force = 0.5 }\n"))
}

#[test]
fn a_record_runs_with_the_numbers_of_its_configuration() {
    let plant = read(&format!("{COMMON}{CONFIGURATIONS}{EFFECTS}"));
    assert_eq!(bits(&position(&plant, "runs/heavy-1.csv")), bits(&position(&heavy(), "any.csv")));
    assert_eq!(bits(&position(&plant, "light-2.csv")), bits(&position(&light(), "any.csv")));
    assert_ne!(position(&heavy(), "any.csv"), position(&light(), "any.csv"));
}

#[test]
fn parameters_of_a_configuration_are_parameters_with_tolerances_of_their_own() {
    let plant = read(&format!("{COMMON}{CONFIGURATIONS}"));
    let of = |name: &str| plant.tolerance.iter().find(|it| it.0 == name).map(|it| it.1);
    assert_eq!((of("mass"), of(&name_in("mass", "heavy")), of("mass[light]")), (Some(0.02), Some(0.05), None));
    assert_eq!((of("viscous_friction"), of("viscous_friction[light]")), (None, Some(0.1)));
    assert_eq!(plant.parameters.optional("mass[heavy]"), Some(5.0));
    assert_eq!(plant.parameters.optional("viscous_friction[heavy]"), Some(3.0));
}

#[test]
fn a_written_file_is_the_same_plant() {
    let mut plant = read(&format!("{COMMON}{CONFIGURATIONS}{EFFECTS}"));
    plant.parameters.set("mass[heavy]", 5.25);
    plant.parameters.set("viscous_friction[light]", 2.75);
    let text = plant.write();
    let again = read(&text);
    assert_eq!(again.parameters.optional("mass[heavy]"), Some(5.25), "{text}");
    assert_eq!(again.tolerance.len(), plant.tolerance.len(), "{text}");
    for name in ["light-1.csv", "heavy-1.csv"] {
        assert_eq!(bits(&position(&again, name)), bits(&position(&plant, name)), "{text}");
    }
}

const CART: &str = "model Cart\n  parameter Real mass(unit = \"kg\", min = 0) = 2;\n  parameter Real friction(unit = \"N.s/m\", min = 0) = 1;\n  \
                    parameter Integer count = 2;\n  Real[count] twice;\n  \
                    input Real force(unit = \"N\");\n  output Real speed(unit = \"m/s\");\nequation\n  mass*der(speed) = force - friction*speed;\n  \
                    for k in 1:count loop\n    twice[k] = k*speed;\n  end for;\nend Cart;\n";

const CART_FILE: &str = "format = 2\nmodel = \"cart.mo\"\n[tolerance]\nfriction = 0.1\n[sites.cart]\nkind = \"translation\"\nspeed = \"speed\"\ninertia = \"mass\"\n\
                         [configurations]\ndiffer = [\"friction\"]\n[configurations.light]\nrecords = [\"light*\"]\n\
                         [configurations.heavy]\nrecords = [\"heavy*\"]\nparameters = { mass = 6 }\n";

const CART_EFFECT: &str =
    "[[effects]]\nkind = \"coulomb-friction\"\nat = \"cart\"\nparameters = { force = { heavy = 0.25 } }\n";

fn open(name: &str) -> Result<Source, Faults> {
    Ok(Source::new(name, CART))
}

#[test]
fn a_plant_of_equations_has_the_equations_of_its_record() {
    let source = Source::new("cart.toml", format!("{CART_FILE}{CART_EFFECT}"));
    let file = EquationFile::read(&source, &open).unwrap_or_else(|faults| panic!("{faults}"));
    let record = |name: &str| Source::new(name, "time[s],force[N],speed[m/s]\n0,1,0\n1,1,0\n");
    let value = |file: &EquationFile, name: &str| file.system.parameter_value(file.system.find(name).unwrap());
    let heavy = file.of_record(&record("heavy.csv")).unwrap();
    assert_eq!((value(&heavy, "mass"), heavy.places()), (Some(6.0), vec!["cart"]));
    let light = heavy.of_record(&record("light.csv")).unwrap();
    assert_eq!((value(&light, "mass"), light.places().len()), (Some(2.0), 0));
    assert_eq!(value(&file.in_configuration("heavy").unwrap(), "mass"), Some(6.0));
    let unknown = file.in_configuration("empty").err().map(|it| it.to_string()).unwrap_or_default();
    assert!(unknown.contains("found the configuration `empty`, expected `light`, `heavy`"), "{unknown}");
    let none = file.of_record(&record("runs/other.csv")).err().map(|it| it.to_string()).unwrap_or_default();
    assert!(none.contains("cart.toml:9: the record runs/other.csv is of no configuration"), "{none}");
    // The same plant for a diagnosis, written and read again.
    let plant = equation_plant::read(&source, &open).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(plant.effects[0].acts_in(), ["heavy"]);
    let text = plant.write();
    let again = equation_plant::read(&Source::new("cart.toml", text.clone()), &open)
        .unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    assert_eq!((again.effects[0].acts_in(), again.tolerance.len()), (vec!["heavy"], plant.tolerance.len()), "{text}");
}

#[test]
fn faults_of_configurations_have_their_places() {
    let text = CART_FILE.replace("mass = 6", "mass = -6, lenght = 1, count = 3") + &CART_EFFECT.replace("heavy", "huge");
    let faults =
        equation_plant::read(&Source::new("cart.toml", text), &open).err().map(|it| it.to_string()).unwrap_or_default();
    for part in [
        "cart.toml:15:23: [configurations.heavy]: `parameters`: `mass`: found -6, expected a number above 0",
        "`parameters`: found `lenght`, expected a parameter of the plant that a file may set",
        // It changes the structure of the equations.
        "`parameters`: found `count`, expected a parameter of the plant that a file may set",
        "[[effects]]: `coulomb-friction`: `force`: found the configuration `huge`, expected `light`, `heavy`",
    ] {
        assert!(faults.contains(part), "{part}\n{faults}");
    }
}
