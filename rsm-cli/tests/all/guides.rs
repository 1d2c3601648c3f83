//! The specifications and commands of three guides of the book, run on the data of the tutorial.

use std::path::Path;
use std::process::Command;

const DATA: &str = "torque[N*m],speed[rpm],angle[deg]\n0,6500,14.1\n0,7500,34.8\n5,6500,19.2\n5,7500,31.9\n10,6500,27.4\n10,7500,36.5\n\
                    5,7000,25.8\n0,7000,24.7\n10,7000,32.2\n";

/// The first block of a language on a page.
fn block(page: &str, language: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/book/src/guides").join(page);
    let text = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let opening = format!("```{language}\n");
    let found = text.split_once(&opening).and_then(|(_, rest)| rest.split_once("```"));
    found.unwrap_or_else(|| panic!("{page} has no block of {language}")).0.to_string()
}

/// Runs a block of commands, `rsm` being the command under test; what it prints.
fn run(script: &str, folder: &Path) -> String {
    let programs = Path::new(env!("CARGO_BIN_EXE_rsm")).parent().unwrap().to_path_buf();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path = std::env::join_paths(std::iter::once(programs).chain(std::env::split_paths(&path))).unwrap();
    let script = format!("exec 2>&1\n{script}");
    let output = Command::new("sh").args(["-e", "-c", &script]).env("PATH", path).current_dir(folder).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn the_guides_to_fits_and_designs_do_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("dyno.csv", DATA);
    write("fit.toml", &block("fit.md", "toml"));
    let text = run(&block("fit.md", "sh"), folder.path());
    assert!(text.contains("reached (99 % wanted)") && text.contains("error to be believed"), "{text}");
    assert!(folder.path().join("report/report.html").is_file());
    // What the guide to C does with it.
    run(&block("embed-c.md", "sh"), folder.path());
    assert!(folder.path().join("src/motor.c").is_file());
    // The response of the guide to constraints, in a specification.
    let inputs = "format = 1\nmodel = \"constrained\"\ndata = [\"dyno.csv\"]\n[inputs.torque]\n[inputs.speed]\n\n";
    write("constrained.toml", &format!("{inputs}{}", block("constrain.md", "toml")));
    let text = run("rsm fit constrained.toml --out constrained-model.toml", folder.path());
    assert_eq!(text.matches("proven over the whole region").count(), 2, "{text}");
    write("design.toml", &block("design.md", "toml"));
    let text = run(&block("design.md", "sh"), folder.path());
    assert!(text.contains("central-composite"), "{text}");
}
