//! What is fed: every reader, and behind it what a subcommand does with a text that is valid.
//!
//! Costly work is done for one text in so many, so that a million inputs take minutes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rsm_core::certificate;
use rsm_core::check::Checked;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Faults, Source};
use rsm_core::{compile, emit, lower};
use rsm_diagnose::surface::data::NewData;
use rsm_diagnose::surface::diagnose;
use rsm_fit::fit::fit;
use rsm_fit::optimise::Study;
use rsm_fit::partial;
use rsm_fit::plan::{DesignSpecification, Plan, Runs};
use rsm_fit::records::hash;
use rsm_fit::spec::Specification;
use rsm_fit::table::{Table, Wanted};
use rsm_import::{File, Wishes};
use rsm_link::scenario::Scenario;
use rsm_model::effects::{Catalogue, Effect};
use rsm_sim::equations::{Entry, EquationFile, Inputs, Machine, Method, Setting, Signals, linearise, run};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;
use rsm_sim::simulate::Simulator;
use rsm_sweep::scenario::Scenario as Sweep;
use rsm_sweep::tasks;

use crate::mutate::Random;

/// Something that reads a text, with texts to change.
pub struct Subject {
    pub name: &'static str,
    pub texts: Vec<String>,
    pub feed: fn(&Ground, &str, &mut Random),
}

/// Valid files that a changed one meets.
pub struct Ground {
    folder: PathBuf,
    model: Checked,
    plants: Vec<(PlantFile, String)>,
}

impl Ground {
    /// # Panics
    /// When the shipped files are not there, or not valid.
    #[must_use]
    pub fn new(root: &Path) -> Self {
        let read = |name: &str| Source::read(&root.join(name)).unwrap_or_else(|faults| panic!("{faults}"));
        let plant = |name: &str| {
            let plant =
                PlantFile::read(&read(&format!("rsm-sim/plants/{name}.toml"))).unwrap_or_else(|faults| panic!("{faults}"));
            (plant, head(read(&format!("rsm-sim/plants/{name}.csv")).text(), 30))
        };
        Ground {
            folder: root.join("rsm-cli/demo/motor"),
            model: Checked::read(&Source::new("m.toml", MODEL)).unwrap_or_else(|faults| panic!("{faults}")),
            plants: ["pmac", "driveline", "servo-axis"].map(plant).into(),
        }
    }
}

const MODEL: &str = "format = 1\nmodel = \"m\"\n[inputs.x]\nunit = \"bar\"\nrange = [0.0, 4.0]\n[surfaces.y]\nunit = \"W\"\ninputs = [\"x\"]\n\
    terms = [{ powers = [0], coefficient = 1.0 }, { powers = [1], coefficient = 2.0 }, { powers = [2], coefficient = 0.5 }]\n";

const DATA: &str = "x[bar],y[W]\n0,-0.5\n1,0.1\n1,0.12\n2,1\n2,1.02\n3,2.13\n3,2.1\n4,3.5\n4,3.48\n0,-0.49\n";

const FIT: &str = "format = 1\nmodel = \"m\"\ndata = [\"dyno.csv\"]\n[inputs.torque]\nunit = \"N*m\"\nrange = [-21.6, 21.6]\n[inputs.speed]\nunit = \"rad/s\"\n\
    range = [440.0, 800.0]\n[responses.weakening_current]\nunit = \"A\"\ninputs = [\"torque\", \"speed\"]\noutput_range = [0.0, 60.0]\n\
    select = { method = \"ladder\", max_order = 2, confidence = 90.0 }\n\
    constraints = [{ kind = \"monotone\", input = \"speed\", direction = \"increasing\" }]\nsupport = \"data\"\n";

const LOGS: [&str; 4] = [
    "Logger 3;;\nZeit [ms];Speed (rpm);Gang\n0,0;10;1\n1,3;11,5;1\n1,9;-;2\n3,1;13;2\n3,9;14;2\n9,0;15;3\n",
    "t\tx\ns\tm\n0.000\t1\n0.000\t2\n0.001\t3\n0.001\t4\n0.002\t5\n0.002\t5\n0.003\t7\n",
    "date/time,x[m],x[m]\n31.12.2024 23:59:59.9,1,2\n2025-01-01T00:00:00Z,2,3\n2025/01/01 00:00:00.1,3,4\n",
    "time[s],speed[rad/s]\n0,1\n1,2\n2,2\n3,1\n",
];

/// The first rows.
fn head(text: &str, rows: usize) -> String {
    text.lines().take(rows).map(|line| format!("{line}\n")).collect()
}

/// Every file below a folder with one of the endings that holds a word; none of more than 20 kB, which only slow the search.
fn files(root: &Path, folders: &[&str], ending: &str, word: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut open: Vec<PathBuf> = folders.iter().map(|folder| root.join(folder)).collect();
    while let Some(folder) = open.pop() {
        let mut entries: Vec<PathBuf> =
            std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        entries.sort();
        for path in entries {
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|it| it == ending)
                && let Ok(text) = std::fs::read_to_string(&path)
                && text.contains(word)
            {
                found.push(if text.len() > 20_000 { head(&text, 30) } else { text });
            }
        }
    }
    found
}

const EXTENDED: &str = r#"format = 2
model = "rsm:servo-axis#ServoAxis"
[initial]
speed = 0.1
[sites.carriage]
kind = "translation"
position = "position"
speed = "speed"
inertia = "mass"
[[effects]]
kind = "backlash"
at = "carriage"
parameters = { gap = 0.001, mass_ratio = 0.4, stiffness = 10000.0, damping = 20.0 }
[[effects]]
kind = "sensor-delay"
at = "position"
parameters = { delay = 0.015 }
[[effects]]
kind = "input-delay"
parameters = { delay = 0.004 }
"#;

const EXTENDED_CAR: &str = r#"format = 2
model = "rsm:driveline"
[[effects]]
kind = "tyre-slip"
parameters = { slip_stiffness = 200000.0 }
[[effects]]
kind = "clutch-slip"
at = "clutch"
parameters = { capacity = 150.0 }
[record]
gear = "gear"
start = ["road_speed"]
"#;

/// All subjects.
#[must_use]
pub fn all(root: &Path) -> Vec<Subject> {
    let with = |mut texts: Vec<String>, more: &[&str]| {
        texts.extend(more.iter().map(|text| (*text).to_string()));
        texts
    };
    let cases = ["rsm-core/tests/cases", "generated/coefficients", "rsm-cli/tests/cases", "rsm-cli/demo"];
    let plants = ["rsm-sim/plants", "rsm-sim/tests/cases", "rsm-cli/tests/cases"];
    vec![
        Subject { name: "model", texts: with(files(root, &cases, "toml", "[surfaces"), &[MODEL]), feed: model },
        Subject {
            name: "fit",
            texts: with(
                files(root, &["rsm-fit/tests/cases", "rsm-cli/tests/cases", "rsm-cli/demo"], "toml", "[responses"),
                &[FIT],
            ),
            feed: specification,
        },
        Subject { name: "part", texts: vec![part_text()], feed: part },
        Subject { name: "table", texts: with(files(root, &["rsm-fit/tests/cases"], "csv", ""), &[DATA]), feed: table },
        Subject {
            name: "design",
            texts: files(
                root,
                &["rsm-cli/demo", "rsm-fit/tests/cases/rejected-plans", "rsm-cli/tests/cases"],
                "toml",
                "[factors",
            ),
            feed: design,
        },
        Subject { name: "study", texts: files(root, &["rsm-fit/tests/cases/rejected-studies"], "toml", "study"), feed: study },
        Subject { name: "scenario", texts: files(root, &["examples/federation"], "toml", "scenario"), feed: scenario },
        Subject { name: "sweep", texts: files(root, &["rsm-sweep/tests/cases"], "toml", "sweep"), feed: sweep },
        Subject {
            name: "plan",
            texts: with(files(root, &["rsm-fit/tests/cases/rejected-plans"], "csv", ""), &["run,a[m]\n1,2\n2,3\n"]),
            feed: plan,
        },
        Subject { name: "plant", texts: files(root, &plants, "toml", "plant ="), feed: plant },
        Subject {
            name: "equations",
            texts: files(root, &["rsm-model/models", "rsm-model/tests/models"], "mo", "model"),
            feed: equations,
        },
        Subject { name: "effect", texts: files(root, &["rsm-model/effects"], "toml", "[changes]"), feed: effect },
        Subject { name: "extended plant", texts: vec![EXTENDED.to_string(), EXTENDED_CAR.to_string()], feed: extended },
        Subject { name: "record", texts: files(root, &["rsm-sim/plants", "rsm-sim/tests/cases"], "csv", "time"), feed: record },
        Subject { name: "import", texts: LOGS.map(String::from).to_vec(), feed: import },
        Subject { name: "new data", texts: vec![DATA.to_string()], feed: new_data },
    ]
}

/// `rsm check`, `rsm emit`, `rsm eval`.
fn model(_: &Ground, text: &str, random: &mut Random) {
    let Ok(checked) = Checked::read(&Source::new("m.toml", text)) else { return };
    if random.below(8) != 0 {
        return;
    }
    let held: Vec<Precision> = Precision::ALL.into_iter().filter(|precision| checked.refusal(*precision).is_none()).collect();
    let _ = certificate::surfaces(&checked, &held);
    for index in 0..checked.model().compensators.len() {
        let _ = certificate::compensator::certify(&checked, index);
    }
    if let Ok(unit) = compile::unit(&checked, &[]) {
        let _ = (emit::c::emit(&unit), emit::rust::emit(&unit));
    }
    if compile::held(&checked, &[Precision::F64]).is_ok() {
        for index in 0..checked.model().surfaces.len() {
            let tape = lower::surface(&checked, index, Precision::F64);
            let mut interpreter = Interpreter::<f64>::new(&tape);
            for value in [0.0, f64::NAN, f64::INFINITY, -1e308] {
                let _ = interpreter.step(&vec![value; tape.inputs.len()]);
            }
        }
    }
}

/// `rsm fit`.
fn specification(ground: &Ground, text: &str, random: &mut Random) {
    let Ok(specification) = Specification::from_source(Source::new("fit.toml", text), ground.folder.clone()) else { return };
    if random.below(50) == 0 {
        let _ = fit(&specification, &mut |_| {});
    }
}

/// The text of a part before its hash, from sums of DATA.
fn part_text() -> String {
    let text = "format = 1\nmodel = \"m\"\ndata = [\"d.csv\"]\nmissing = \"drop-row\"\n[inputs.x]\nunit = \"bar\"\nrange = [0.0, 4.0]\n[responses.y]\n\
        unit = \"W\"\ninputs = [\"x\"]\nselect = { method = \"fixed\", order = 2 }\n";
    let specification = Specification::from_source(Source::new("fit.toml", text), PathBuf::new());
    let specification = specification.unwrap_or_else(|faults| panic!("{faults}"));
    let part = partial::of_sources(&specification, &[Source::new("d.csv", format!("{DATA}5,\n"))]);
    let written = part.unwrap_or_else(|refused| panic!("{refused}")).write();
    written.split_once("\n[end]").expect("a part has an end").0.to_string()
}

/// `rsm merge`: a changed part with the hash of what it contains, which would otherwise be all that is read.
fn part(_: &Ground, text: &str, random: &mut Random) {
    let ended = |text: &str| format!("{text}\n[end]\nsha256 = \"{}\"\n", hash(text));
    let read = |text: &str| partial::Part::read(&Source::new("a.rsm", ended(text)));
    let _ = partial::Part::read(&Source::new("b.rsm", text));
    let Ok(changed) = read(text) else { return };
    let mut parts = vec![changed];
    if random.below(2) == 0 {
        parts.extend(read(&part_text()));
    }
    if let Ok(merged) = partial::merge(parts) {
        let _ = merged.report();
    }
}

fn table(_: &Ground, text: &str, _: &mut Random) {
    let source = Source::new("t.csv", text);
    let _ = Table::read(&source, &Wanted { every_number: true, run: true, ..Wanted::default() });
    if let Ok(table) = Table::read(&source, &Wanted { numbers: vec!["x".into(), "y".into()], ..Wanted::default() }) {
        let _ = (table.values_in("x", Some("Pa")), table.values_in("y", None));
    }
}

/// `rsm design`.
fn design(_: &Ground, text: &str, random: &mut Random) {
    if let Ok(specification) = DesignSpecification::from_source(Source::new("d.toml", text))
        && random.below(4) == 0
        && let Ok(plan) = Plan::make(&specification)
    {
        let _ = Plan::read(&Source::new("p.csv", plan.csv()))
            .unwrap_or_else(|faults| panic!("a plan that is not read again: {faults}"));
        // Larger ones take a second each.
        if plan.runs.len() < 100 && specification.terms.len() < 30 {
            let _ = specification.evaluate(&Runs::of(&plan));
        }
    }
}

/// `rsm optimise`.
fn study(ground: &Ground, text: &str, random: &mut Random) {
    let Ok(mut study) = Study::from_source(Source::new("goals.toml", text)) else { return };
    study.starts = 1;
    // The responses of the model, under which most changed studies are valid.
    for (wish, surface) in study.responses.iter_mut().zip(&ground.model.model().surfaces) {
        wish.response.clone_from(&surface.name);
    }
    if random.below(8) == 0 {
        let _ = (study.optimise(&ground.model), study.front(&ground.model, 4));
    }
}

fn scenario(_: &Ground, text: &str, _: &mut Random) {
    if let Ok(scenario) = Scenario::read(&Source::new("s.toml", text)) {
        // The broker, and a process for each of the file.
        assert_eq!(scenario.commands("out").len(), scenario.processes.len() + 1);
        assert!(scenario.loops().count() > 0 && scenario.federates() >= 2);
    }
}

/// `rsm sweep`: the scenario changed, or one of its files.
fn sweep(ground: &Ground, text: &str, random: &mut Random) {
    let cases = ground.folder.join("../../../rsm-sweep/tests/cases");
    let open = |name: &str| Source::read(&cases.join(name.rsplit('/').next().unwrap_or(name)));
    let Ok(sweep) = Sweep::read(&Source::new("sweep.toml", text), &open) else { return };
    // A million tasks are no fault, and take a second.
    let is_long = text.split(|it: char| !it.is_ascii_digit()).any(|it| it.len() > 4);
    if is_long && random.below(20) != 0 {
        return;
    }
    if let Ok(tasks) = tasks::list(&sweep)
        && random.below(4) == 0
        && let Some(task) = tasks.first()
    {
        let result = task.run(&sweep, 1, &rsm_sweep::no_diagnosis);
        assert_eq!(result["task"].as_str(), Some(task.hash.as_str()));
    }
}

fn plan(_: &Ground, text: &str, _: &mut Random) {
    let _ = Plan::read(&Source::new("p.csv", text));
}

/// `rsm simulate`, the plant changed.
fn plant(ground: &Ground, text: &str, random: &mut Random) {
    let Ok(plant) = PlantFile::read(&Source::new("plant.toml", text)) else { return };
    if random.below(8) == 0 {
        for (_, record) in &ground.plants {
            simulate(&plant, record);
        }
    }
}

/// `rsm inspect`, `rsm linearise`, `rsm simulate` of a text of equations.
fn equations(_: &Ground, text: &str, random: &mut Random) {
    let Ok(file) = EquationFile::of_text(&Source::new("plant.mo", text)) else { return };
    let _ = file.system.to_string();
    if random.below(8) != 0 {
        return;
    }
    let Ok(mut machine) = Machine::new(&file) else { return };
    let inputs = vec![0.5; machine.inputs().len()];
    let Ok(start) = machine.start(&file, 0.0, &inputs, &[]) else { return };
    let _ = linearise(&file, &machine, &start);
    let time = [0.0, 0.01, 0.02, 0.03];
    let values: Vec<Vec<f64>> = inputs.iter().map(|it| vec![*it; time.len()]).collect();
    let setting = Setting { method: Method::Fixed { step: 0.005 }, ..Setting::default() };
    let _ = run(&machine, start, Inputs { time: &time, values: &values }, setting);
}

/// `rsm effects --effects`: a file of an effect, changed, wherever it can stand.
fn effect(_: &Ground, text: &str, random: &mut Random) {
    let Ok(effect) = Effect::read(&Source::new("effect.toml", text)) else { return };
    let plants = ["rsm:pmac", "rsm:driveline", "rsm:servo-axis#ServoAxis", "rsm:servo-axis#ServoAxisClosedLoop"];
    let plant = format!("format = 2\nmodel = \"{}\"\n", plants[random.below(plants.len())]);
    let mut catalogue = Catalogue::shipped();
    let kind = "of the fuzzer".to_string();
    let renamed = text.replacen(&format!("\"{}\"", effect.kind), &format!("\"{kind}\""), 1);
    if catalogue.add(&[Source::new("effect.toml", renamed)]).is_err() {
        return;
    }
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, ""));
    let Ok(file) = EquationFile::read_with(&Source::new("plant.toml", plant), &open, &Arc::new(catalogue)) else { return };
    for room in file.rooms().unwrap_or_default() {
        for site in effect.sites.iter().filter(|it| **it == room.kind) {
            let numbers: Vec<(&str, f64)> = effect.numbers_on(*site).map(|it| (it.name.as_str(), 0.5)).collect();
            let _ = file.with_effects(&[Entry::new(&kind, Some(&room.at), &numbers)]);
        }
    }
}

/// `rsm inspect`, `rsm simulate` of a plant file of format 2 with sites and effects.
fn extended(_: &Ground, text: &str, random: &mut Random) {
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, ""));
    let Ok(file) = EquationFile::read(&Source::new("plant.toml", text), &open) else { return };
    let _ = (file.rooms(), file.proposals());
    let time: Vec<f64> = (0..5).map(|k| 0.01 * f64::from(k)).collect();
    let some = [0.5; 5];
    let gear = [2.0; 5];
    let names = ["throttle", "command", "reference", "v_q", "load_torque"];
    let mut columns: Vec<(&str, &[f64])> = vec![("time", &time), ("gear", &gear)];
    columns.extend(names.iter().map(|it| (*it, &some[..])));
    let Ok(file) = file.of_columns(&columns) else { return };
    if random.below(4) != 0 {
        return;
    }
    let Ok(mut machine) = Machine::new(&file) else { return };
    let Ok(signals) = Signals::in_memory(&file, &machine, &columns) else { return };
    let setting = Setting { tolerance: 1e-4, ..Setting::default() };
    let _ = signals.simulate(&file, &mut machine, setting);
}

/// `rsm simulate`, the record changed.
fn record(ground: &Ground, text: &str, random: &mut Random) {
    for (plant, _) in &ground.plants {
        let _ = Record::read_with_gaps(&Source::new("r.csv", text), plant);
    }
    if random.below(8) == 0 {
        let (plant, _) = &ground.plants[random.below(ground.plants.len())];
        simulate(plant, text);
    }
}

fn simulate(plant: &PlantFile, text: &str) {
    if let Ok(record) = Record::read(&Source::new("r.csv", head(text, 40)), plant)
        && let Ok(mut simulator) = Simulator::new(plant, &record)
    {
        let _ = simulator.run(&record);
    }
}

/// `rsm diagnose` of a surface.
fn new_data(ground: &Ground, text: &str, random: &mut Random) {
    if let Ok(data) = NewData::read(ground.model.model(), &[Source::new("n.csv", text).into()], None)
        && random.below(50) == 0
    {
        let _ = diagnose(&ground.model, &data, None, &mut |_| {});
    }
}

/// A text as a log, and as one of two.
fn import(_: &Ground, text: &str, random: &mut Random) {
    let file = |name: &str, text: &str| File { name: name.into(), bytes: text.as_bytes().to_vec() };
    let wishes = Wishes { period: (random.below(4) == 0).then_some(0.5), ..Wishes::default() };
    if let Ok(record) = rsm_import::import(&[file("a", text)], &wishes) {
        assert!(record.columns.iter().all(|column| column.values.len() == record.rows()));
        let _ = record.csv();
    }
    if random.below(20) == 0 {
        let other: String = (0..80).fold("time[s],speed[rad/s]\n".into(), |all, k| all + &format!("{k},{}\n", k * k % 17));
        let _ = rsm_import::import(&[file("a", text), file("b", &other)], &wishes);
    }
}
