//! Measured data through the whole tool chain: the measured flux map, fitted with its symmetry, emitted as f32 C, equal to the interpreter bit for
//! bit.

use std::path::{Path, PathBuf};

use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::number::Precision;
use rsm_core::source::Source;
use rsm_fit::fit::fit;
use rsm_fit::spec::Specification;
use rsm_tests::backend::{Backend, Loaded, Reference};
use rsm_tests::cases;
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::points::Points;
use rsm_tests::report;

/// psi_d is even in i_q, psi_q odd: each with third order in each variable, the best continuous basis of that order that was tried.
const SPECIFICATION: &str = r#"
format = 1
model = "pmsyrm"
data = ["flux_map.csv"]
validate = { share = 0.3, seed = 7, mirror = ["i_q"] }

[inputs.i_d]
column = "i_d_A"
unit = "A"
[inputs.i_q]
column = "i_q_A"
unit = "A"

[responses.psi_d]
column = "psi_d_Vs"
unit = "V*s"
inputs = ["i_d", "i_q"]
symmetry = { i_q = "even" }
select = { method = "fixed" }
terms = [
  [0,0], [1,0], [2,0], [3,0], [0,1], [1,1], [2,1], [3,1], [0,2], [1,2], [2,2], [3,2], [0,3], [1,3], [2,3], [3,3],
]

[responses.psi_q]
column = "psi_q_Vs"
unit = "V*s"
inputs = ["i_d", "i_q"]
symmetry = { i_q = "odd" }
select = { method = "fixed" }
terms = [
  [0,1], [1,1], [2,1], [3,1], [0,2], [1,2], [2,2], [3,2], [0,3], [1,3], [2,3], [3,3],
]
"#;

/// The folder of the measured flux map, or `None` if it is missing: the test prints this, and fails in CI.
pub fn flux_map() -> Option<PathBuf> {
    let folder = cases::root().join("../shared/data/pmsyrm-flux-map");
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("CI").is_none(), "../shared/data/pmsyrm-flux-map is missing, and in CI this test must run");
    rsm_tests::skipped("../shared/data/pmsyrm-flux-map is missing");
    None
}

#[test]
fn the_measured_flux_map_becomes_c_with_the_bits_of_the_interpreter() {
    let Some(folder) = flux_map() else { return };
    let specification = Specification::from_source(Source::new("fit.toml", SPECIFICATION), folder).unwrap();
    let outcome = fit(&specification, &mut |_| {}).unwrap_or_else(|refused| panic!("{refused}"));
    for response in &outcome.responses {
        let validation = response.statistics.as_ref().unwrap().validation.as_ref().unwrap();
        println!("{}: largest held-out error {:.1} mV*s", response.name, 1000.0 * validation.max_abs_error);
        // 44 mV*s was measured with other tools for psi_q with symmetry, 203 without. One split scatters by a third or so: it is one row.
        if response.name == "psi_q" {
            assert!(validation.max_abs_error < 0.060, "{}", validation.max_abs_error);
        }
    }
    let checked = Checked::from_model(&outcome.model).unwrap();
    let unit = compile::unit(&checked, &[Precision::F32]).unwrap();
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), "measured");
    compilers::write_c([&unit], &folder);
    for (k, line) in ["gcc -std=c99 -O2", "gcc -std=gnu11 -O2 -mfma", "clang -std=c99 -O2"].iter().enumerate() {
        let library = compilers::c_library(&Compiler::new(line), &folder, &format!("measured-{k}"));
        let backend = Loaded::open(line, &library);
        for function in &unit.functions {
            let surface = checked.model().surface(&function.surface).unwrap();
            let mut points = Points::<f32>::new(function, surface);
            let rows = [points.hurtful(), points.random(20_000)].concat();
            let expected = Reference.evaluate(&unit, function, &rows);
            let found = backend.evaluate(&unit, function, &rows);
            if let Some(text) = report::differences(&unit.model, function, line, &rows, &expected, &found) {
                panic!("{text}");
            }
        }
        assert_eq!(backend.call("pmsyrm_self_test"), 0, "{line}");
    }
}
