//! `rsm emit` of the shipped plants: compiled by the C compiler of this machine, the code has the bits of `rsm simulate --fixed-step`.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use crate::calls::{folder, rsm, text};
use crate::shell::{of_the_project, published};

/// The columns of a record without units, and its rows.
fn table(text: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names = lines.next().expect("a header").split(',').map(|it| it.split('[').next().unwrap_or(it).to_string());
    let row = |line: &str| line.split(',').map(|it| it.parse().expect("a number")).collect();
    (names.collect(), lines.map(row).collect())
}

/// A program that runs the plant along a record: `steps` steps for each row with the inputs of this row. It prints the outputs at each row, as the
/// numbers of their bits.
fn program(plant: &str, inputs: &[Vec<f64>], steps: usize, outputs: usize) -> String {
    let width = inputs[0].len();
    let mut text =
        format!("#include <stdio.h>\n#include <string.h>\n#include \"{plant}.h\"\nstatic const double rows[][{width}] = {{\n");
    for row in inputs {
        let numbers: Vec<String> = row.iter().map(|it| format!("{it:?}")).collect();
        writeln!(text, "{{ {} }},", numbers.join(", ")).unwrap();
    }
    let arguments: Vec<String> = (0..width).map(|k| format!("rows[row][{k}]")).collect();
    let arguments = arguments.join(", ");
    write!(
        text,
        "}};\nint main(void) {{\n  {plant}_state state;\n  {plant}_outputs found, dropped;\n  {plant}_init(&state);\n  \
         for (int row = 0; row < {}; ++row) {{\n    {plant}_step(&state, {arguments}, &found);\n    \
         for (int more = 1; more < {steps}; ++more) {plant}_step(&state, {arguments}, &dropped);\n    \
         unsigned long long bits[{outputs}];\n    memcpy(bits, &found, sizeof bits);\n    \
         for (int k = 0; k < {outputs}; ++k) printf(\"%llu \", bits[k]);\n    puts(\"\");\n  }}\n  return 0;\n}}\n",
        inputs.len()
    )
    .unwrap();
    text
}

fn compile_and_run(folder: &Path, plant: &str) -> String {
    let output = Command::new("cc")
        .args(["-std=c99", "-O2", "-ffp-contract=off", "main.c", &format!("{plant}.c"), "-lm", "-o", "main"])
        .current_dir(folder)
        .output()
        .expect("a C compiler");
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&Command::new(folder.join("main")).output().expect("the program runs").stdout)
}

#[test]
fn every_shipped_plant_is_emitted_with_the_bits_of_its_simulation() {
    let file = |name: &str| of_the_project("rsm-sim/plants").join(name).canonicalize().unwrap().display().to_string();
    // Fixed steps, shorter than the fastest motion: the clutch of the car dies out in 44 us.
    for (plant, step, emitted) in
        [("pmac", "2.5e-5", "pmac"), ("driveline", "2.5e-5", "driveline"), ("servo-axis", "2.5e-4", "servo_axis_closed_loop")]
    {
        let here = folder();
        let (model, record) = (file(&format!("{plant}.toml")), file(&format!("{plant}.csv")));
        let simulate = ["simulate", &model, "--record", &record, "--out", "one.csv", "--fixed-step", step];
        let emit = ["emit", &model, "--record", &record, "--lang", "c", "--step", step, "--out", "."];
        for words in [&simulate[..], &emit] {
            let output = rsm(words, here.path());
            assert_eq!(output.status.code(), Some(0), "{plant}: {}", text(&output.stderr));
        }
        let read = |name: &str| std::fs::read_to_string(here.path().join(name)).unwrap();
        let (names, rows) = table(&read("one.csv"));
        let header = read(&format!("{emitted}.h"));
        let place =
            |name: &str| names.iter().position(|it| it == name).unwrap_or_else(|| panic!("{plant}: no {name}: {names:?}"));
        // The arguments of the step, and the members of the outputs.
        let step_of = header.lines().find(|line| line.starts_with(&format!("void {emitted}_step("))).expect("a step");
        let inputs: Vec<usize> =
            step_of.split("double ").skip(1).map(|it| place(it.split([',', ')']).next().unwrap())).collect();
        let members = header.split("typedef struct {").nth(2).expect("a struct of outputs").split('}').next().unwrap();
        let outputs: Vec<usize> = members.split("double ").skip(1).map(|it| place(it.split(';').next().unwrap())).collect();
        let period = rows[1][place("time")] - rows[0][place("time")];
        let steps = (period / step.parse::<f64>().unwrap()).round() as usize;
        let given: Vec<Vec<f64>> = rows.iter().map(|row| inputs.iter().map(|k| row[*k]).collect()).collect();
        std::fs::write(here.path().join("main.c"), program(emitted, &given, steps, outputs.len())).unwrap();
        let found = compile_and_run(here.path(), emitted);
        assert_eq!(found.lines().count(), rows.len(), "{plant}");
        for (row, (line, wanted)) in found.lines().zip(&rows).enumerate() {
            let found: Vec<f64> = line.split_whitespace().map(|it| f64::from_bits(it.parse().unwrap())).collect();
            let wanted: Vec<f64> = outputs.iter().map(|k| wanted[*k]).collect();
            let same = found.iter().zip(&wanted).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "{plant}, row {row}: {found:?}, expected {wanted:?}");
        }
    }
}

#[test]
fn what_is_no_plant_has_no_step() {
    let here = folder();
    let (surface, axis) = (published("motor.toml"), of_the_project("rsm-sim/plants/servo-axis.toml"));
    let axis = axis.canonicalize().unwrap().display().to_string();
    let emit = |model: &str, more: &[&str]| {
        let words = [&["emit", model, "--lang", "c", "--out", "."], more].concat();
        let output = rsm(&words, here.path());
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    for (model, more, expected) in [
        (&surface, &["--step", "1e-4"][..], "--step is for plants, and this is a model file"),
        (&axis, &[], "found a plant without --step"),
        (&axis, &["--step", "1e-4", "--effects", "."], "a plant file of format 1, which has built-in effects only"),
    ] {
        let found = emit(model, more);
        assert!(found.contains(expected), "{found}");
    }
    assert_eq!(here.path().read_dir().unwrap().count(), 0, "nothing is written");
}
