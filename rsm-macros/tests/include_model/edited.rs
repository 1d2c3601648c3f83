//! An edited coefficient file is compiled again, by the macro as by build.rs.

use super::cargo_project::Project;

const MODEL: &str = include_str!("../models/two_inputs.toml");

#[test]
fn editing_the_file_rebuilds() {
    let project = Project::new("rsm-macros-edited");
    let model = "../models beside the package/two_inputs.toml";
    project.write(
        "src/main.rs",
        &format!(
            "rsm_macros::include_model!({model:?});\n\nfn main() {{\n    print!(\"{{}}\", two_inputs::angle(1.0, 0.0));\n}}\n"
        ),
    );
    let run = |coefficient: &str| {
        assert!(MODEL.contains("= 1.5 "));
        project.write(model, &MODEL.replace("= 1.5 ", &format!("= {coefficient} ")));
        let output = project.cargo(&["run"]);
        (output.status.success(), String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    // At the centre of the box only the constant term is left.
    let (built, printed, said) = run("1.5");
    assert!(built && printed == "1.5", "{printed}\n{said}");
    let (built, printed, said) = run("2.25");
    assert!(built && printed == "2.25", "the edited file was not compiled again: {printed}\n{said}");
    let (built, _, said) = run("oops");
    assert!(!built && said.contains("two_inputs.toml:17:"), "{said}");
    let (built, printed, said) = run("-3");
    assert!(built && printed == "-3", "the mended file was not compiled again: {printed}\n{said}");
}
