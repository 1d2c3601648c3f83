//! The README's use of the library, compiled and run. The README has the lines of this file between the two marks, and a test compares them.

use std::error::Error;
use std::path::Path;

use rsm_core::source::Source;
use rsm_fit::Specification;
use rsm_fit::fit::fit_sources;
use rsm_fit::table::{Table, Wanted};

/// The data of the README and of the tutorial.
const DATA: &str = "torque[N*m],speed[rpm],angle[deg]\n0,6500,14.1\n0,7500,34.8\n5,6500,19.2\n5,7500,31.9\n10,6500,27.4\n10,7500,36.5\n\
                    5,7000,25.8\n0,7000,24.7\n10,7000,32.2\n";

const SPECIFICATION: &str = "\
format = 1
model = \"motor\"
data = [\"dyno.csv\"]
inputs.torque.unit = \"N*m\"
inputs.speed.unit = \"rad/s\"
[responses.angle]
unit = \"deg\"
inputs = [\"torque\", \"speed\"]
select = { method = \"ladder\", max_order = 2, confidence = 99.0 }
";

fn as_the_readme_has_it(torque: &[f64], speed: &[f64], angle: &[f64]) -> Result<f64, Box<dyn Error>> {
    // README: begin
    use rsm_core::{lower, number::Precision, run::Interpreter};
    use rsm_fit::{Fit, Input, Response};

    let torque = Input::new("torque", torque).unit("N*m"); // slices, arrays, vectors
    let speed = Input::new("speed", speed).unit("rad/s");
    let angle = Response::new("angle", angle).unit("deg");
    let fitted = Fit::new([torque, speed], angle).order(2).ladder(99.0).fit()?; // data -> model
    let checked = fitted.checked()?; // the rules of the model file
    let tape = lower::surface(&checked, 0, Precision::F64); // the operations of the evaluator
    let value = Interpreter::<f64>::new(&tape).eval(&[7.0, 740.0]); // the bits of the emitted code
    // README: end
    Ok(value)
}

#[test]
fn the_library_does_what_the_readme_shows() {
    // The data of the file, in the units of the specification.
    let wanted = Wanted { every_number: true, ..Wanted::default() };
    let table = Table::read(&Source::new("dyno.csv", DATA), &wanted).unwrap();
    let column = |name: &str, unit: &str| table.values_in(name, Some(unit)).unwrap().0;
    let value = as_the_readme_has_it(&column("torque", "N*m"), &column("speed", "rad/s"), &column("angle", "deg"));
    // What `rsm eval` prints of the fit of the files, and the tutorial of the book.
    assert_eq!(value.unwrap(), 28.344893493458873);
    let specification = Specification::from_source(Source::new("fit.toml", SPECIFICATION), "".into()).unwrap();
    let fitted = fit_sources(&specification, &[Source::new("dyno.csv", DATA)], &mut |_| {}).unwrap();
    let tape = rsm_core::lower::surface(&fitted.checked().unwrap(), 0, rsm_core::number::Precision::F64);
    assert_eq!(rsm_core::run::Interpreter::<f64>::new(&tape).eval(&[7.0, 740.0]), 28.344893493458873);
}

#[test]
fn the_readme_has_the_lines_that_are_compiled_here() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let shown = readme.split_once("```rust\n").unwrap().1.split_once("```").unwrap().0;
    let (_, here) = include_str!("library.rs").split_once("    // README: begin\n").unwrap();
    let here: Vec<&str> = here
        .split_once("    // README: end")
        .unwrap()
        .0
        .lines()
        .map(|line| line.strip_prefix("    ").unwrap_or(line))
        .collect();
    assert_eq!(shown.trim_end(), here.join("\n"));
    for (data, name) in [(DATA, "dyno.csv"), (SPECIFICATION, "fit.toml")] {
        let lines: Vec<&str> = data.lines().collect();
        let has = |line: &&str| readme.lines().any(|it| it.trim_start().split(" #").next().unwrap().trim_end() == *line);
        assert!(lines.iter().all(has), "{name} of the README is another");
    }
}
