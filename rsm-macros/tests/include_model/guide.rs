//! The book's guide "Embed in Rust": its macro and its build script, in one package.

use super::cargo_project::Project;

/// The Rust blocks of the guide, in order.
fn blocks() -> Vec<String> {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/book/src/guides/embed-rust.md");
    let page = std::fs::read_to_string(page).unwrap_or_else(|error| panic!("{page}: {error}"));
    let blocks = page.split("```rust").skip(1);
    blocks.map(|it| it.split_once('\n').unwrap().1.split_once("```").unwrap().0.to_string()).collect()
}

#[test]
fn the_guide_to_rust_compiles() {
    let project = Project::new("rsm-macros-guide");
    let manifest = project.read("Cargo.toml");
    let core = concat!(env!("CARGO_MANIFEST_DIR"), "/../rsm-core");
    project.write("Cargo.toml", &format!("{manifest}\n[build-dependencies]\nrsm-core = {{ path = {core:?} }}\n"));
    let angle = "[surfaces.angle]\nunit = \"deg\"\ninputs = [\"torque\", \"speed\"]\nterms = [{ powers = [0, 0], coefficient = 28.5 }]\n";
    let inputs =
        "[inputs.torque]\nunit = \"N*m\"\nrange = [0.0, 10.0]\n[inputs.speed]\nunit = \"rad/s\"\nrange = [680.0, 785.0]\n";
    project.write("models/motor.toml", &format!("format = 1\nmodel = \"motor\"\n{inputs}{angle}"));
    let [by_macro, build, by_script, _] = &blocks()[..] else { panic!("the guide has other blocks than this test") };
    let (item, calls) = by_macro.split_once("\n\n").unwrap();
    project.write("build.rs", &format!("fn main() {{\n{build}}}\n"));
    project.write("src/lib.rs", &format!("{by_script}\npub fn angle() -> f64 {{\n    motor::angle(7.0, 740.0)\n}}\n"));
    let print = "println!(\"{angle} {angle_f32} {}\", rsm_macros_guide::angle());";
    project.write("src/main.rs", &format!("{item}\n\nfn main() {{\n{calls}\n{print}\n}}\n"));
    let output = project.cargo(&["run"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert_eq!(String::from_utf8(output.stdout).unwrap(), "28.5 28.5 28.5\n");
}
