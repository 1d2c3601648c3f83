//! Writes the random models of the tests, and the code that takes them through the macro.
//!
//! Out, in OUT_DIR: `models/*.toml`, and `macro_models.rs` with one `include_model!` a model and the list of the evaluators that came
//! of it. The tests read the same model files, so the generator exists once. Never writes into a source folder.

mod random;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::emit::Kind;
use rsm_core::model_file;
use rsm_core::names;
use rsm_core::number::Precision;

fn main() {
    println!("cargo::rerun-if-changed=build");
    let rustc = std::env::var("RUSTC").expect("set by cargo");
    println!("cargo::rustc-env=RSM_TESTS_RUSTC={rustc}");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").expect("set by cargo"));
    let folder = out.join("models");
    // Models of an older generator must not stay behind.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).expect("OUT_DIR is ours");
    }
    std::fs::create_dir_all(&folder).expect("OUT_DIR can be written");
    let mut modules = String::new();
    let (mut of_f64, mut of_f32) = (String::new(), String::new());
    for (index, model) in random::models().into_iter().enumerate() {
        let name = model.name.clone();
        let path = folder.join(format!("{name}.toml"));
        std::fs::write(&path, model_file::write(&model)).expect("OUT_DIR can be written");
        let checked = Checked::from_model(&model).unwrap_or_else(|faults| panic!("the generator made a bad model\n{faults}"));
        let unit = compile::unit(&checked, &[]).unwrap_or_else(|faults| panic!("{faults}"));
        let holds_f32 = unit.functions.iter().any(|function| function.tape.precision == Precision::F32);
        let taken = Taken::of(index, holds_f32);
        modules.push_str(&taken.modules(&path));
        for function in unit.functions {
            let list = if function.tape.precision == Precision::F64 { &mut of_f64 } else { &mut of_f32 };
            let float = function.tape.precision.name();
            let arguments: Vec<String> = (0..function.inputs.len()).map(|k| format!("x[{k}]")).collect();
            let module = taken.module(&name, function.tape.precision);
            let call = |state: &str| format!("{module}::{}({state}{})", function.rust_name(), arguments.join(", "));
            let (before, value) = match function.kind {
                // The unit comes without gradients, parts and updates; `gradients.rs`, `firmware/` and `recursive.rs` compare them.
                Kind::Surface | Kind::Gradient | Kind::Inside | Kind::Once | Kind::Update | Kind::Adapted => {
                    (String::new(), call(""))
                }
                // A support test gives a whole number.
                Kind::Support => (String::new(), format!("{float}::from({} as i8)", call(""))),
                // One state goes through all rows.
                Kind::Step => {
                    let init = names::rust_init(&function.surface, function.tape.precision);
                    (format!("let mut state = {module}::{init}(); "), call("&mut state, "))
                }
            };
            let rows = format!("rows.chunks_exact({}).map(|x| {value}).collect()", function.inputs.len());
            writeln!(list, "    (\"{name}\", \"{}\", |rows: &[{float}]| {{ {before}{rows} }}),", function.rust_name())
                .expect("text");
        }
    }
    for (float, list) in [("f64", of_f64), ("f32", of_f32)] {
        writeln!(
            modules,
            "/// Model, function, and the function over rows of arguments.\n\
             pub const {}: &[rsm_tests::backend::Entry<{float}>] = &[\n{list}];",
            float.to_uppercase()
        )
        .expect("text");
    }
    std::fs::write(out.join("macro_models.rs"), modules).expect("OUT_DIR can be written");
}

/// How a model is taken through the macro: every way of naming precisions occurs.
enum Taken {
    /// `include_model!("m.toml")`
    Plainly,
    /// `include_model!("m.toml", precision = "both")`
    Both,
    /// Once for each precision, in modules of their own.
    Apart,
}

impl Taken {
    fn of(index: usize, holds_f32: bool) -> Self {
        match index % 3 {
            1 if holds_f32 => Taken::Both,
            2 if holds_f32 => Taken::Apart,
            _ => Taken::Plainly,
        }
    }

    fn modules(&self, path: &Path) -> String {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let apart = |precision: &str| {
            format!(
                "/// In {precision} alone.\npub mod {stem}_{precision} {{\n    rsm_macros::include_model!({path:?}, precision = \"{precision}\");\n}}\n"
            )
        };
        match self {
            Taken::Plainly => format!("rsm_macros::include_model!({path:?});\n"),
            Taken::Both => format!("rsm_macros::include_model!({path:?}, precision = \"both\");\n"),
            Taken::Apart => apart("f64") + &apart("f32"),
        }
    }

    fn module(&self, model: &str, precision: Precision) -> String {
        match self {
            Taken::Plainly | Taken::Both => model.to_string(),
            Taken::Apart => format!("{model}_{}::{model}", precision.name()),
        }
    }
}
